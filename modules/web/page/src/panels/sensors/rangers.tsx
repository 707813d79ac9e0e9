// Sonars and infrared rangers in figures.
import type { ComponentChildren } from "preact";
import { deg, num } from "../../format";
import { scene, sensors, stale } from "../../state";
import { Age, Badge, Card, type Column, Empty, Table } from "../../ui";
import { side } from "./geometry";
import { type Floor, floor, near } from "./near";
import { infrareds, type Sounding, type Soundings, sonars } from "./readings";

const columns = (heard: (range: Sounding) => ComponentChildren): Column<Sounding>[] => [
  { head: "No.", title: true, by: (range) => range.id, cell: (range) => range.id },
  { head: "Direction", by: (range) => range.theta, cell: (range) => `${side(range.theta)} (${deg(range.theta)})` },
  {
    head: "Position",
    cell: (range) => (
      <>
        {num(range.x, 2)}, {num(range.y, 2, "m")}
      </>
    ),
  },
  {
    head: "Distance",
    figure: true,
    by: (range) => range.distance ?? Infinity,
    cell: (range) => num(range.distance, 2, "m"),
  },
  {
    head: "Age when sent",
    figure: true,
    by: (range) => range.age ?? Infinity,
    cell: (range) => num(range.age, 2, "s"),
  },
  {
    head: "Status",
    by: (range) => (range.known === "unknown" ? -1 : (range.distance ?? Infinity)),
    cell: heard,
  },
];
const SONARS = columns((range) => <Near range={range} />);
const FLOORS: Readonly<Record<Floor, ComponentChildren>> = {
  floor: <Badge tone="good">floor</Badge>,
  hole: <Badge tone="bad">no floor</Badge>,
  unknown: <Badge tone="bad">not known</Badge>,
};
const INFRARED = columns((range) => FLOORS[floor(range)]);

function Near({ range }: { range: Sounding }) {
  if (range.known === "unknown") return <Badge tone="bad">not known</Badge>;
  if (range.distance === null) return <Badge tone="off">no echo</Badge>;
  const how = near(range.distance);
  if (how === "close") return <Badge tone="bad">close</Badge>;
  return how === "near" ? <Badge tone="warn">near</Badge> : <Badge tone="good">clear</Badge>;
}

function Rangers(props: { title: string; soundings: Soundings; columns: Column<Sounding>[] }) {
  const { title } = props;
  const { shown, rows } = props.soundings;
  return (
    <Card title={title} class="p-fits p-rangers" flush aside={<Age shown={shown} />}>
      {rows ? (
        <Table caption={title} columns={props.columns} rows={rows} id={(range) => range.id} stale={() => stale(shown)} />
      ) : (
        <Empty>No data yet.</Empty>
      )}
    </Card>
  );
}

export function RangerTables() {
  const part = sensors.value;
  if (!part) return null;
  return (
    <>
      <Rangers title="Sonars" soundings={sonars(part, scene.value?.sonar.field_of_view ?? 0)} columns={SONARS} />
      <Rangers title="Infrared, at the floor" soundings={infrareds(part)} columns={INFRARED} />
    </>
  );
}
