// Sonars and infrared rangers in figures.
import type { ComponentChildren } from "preact";
import { deg, num } from "../../format";
import type { Range, Shown } from "../../protocol";
import { sensors, stale } from "../../state";
import { Age, Badge, Card, type Column, Empty, Table } from "../../ui";
import { side } from "./geometry";
import { floor, measured, near } from "./near";

const columns = (heard: (range: Range) => ComponentChildren): Column<Range>[] => [
  { head: "No.", title: true, by: (range) => range.id, cell: (range) => range.id },
  { head: "Looks to", by: (range) => range.theta, cell: (range) => `${side(range.theta)} (${deg(range.theta)})` },
  {
    head: "Sits at",
    cell: (range) => (
      <>
        {num(range.x, 2)}, {num(range.y, 2, "m")}
      </>
    ),
  },
  {
    head: "Distance",
    figure: true,
    by: (range) => measured(range) ?? Infinity,
    cell: (range) => num(measured(range), 2, "m"),
  },
  {
    head: "Heard",
    by: (range) => measured(range) ?? Infinity,
    cell: heard,
  },
];
const SONARS = columns((range) => <Near range={range} />);
const INFRARED = columns((range) => (floor(range) ? <Badge tone="good">floor</Badge> : <Badge tone="bad">no floor</Badge>));

function Near({ range }: { range: Range }) {
  const distance = measured(range);
  if (distance === null) return <Badge tone="off">nothing</Badge>;
  const how = near(distance);
  if (how === "close") return <Badge tone="bad">close</Badge>;
  return how === "near" ? <Badge tone="warn">near</Badge> : <Badge tone="good">clear</Badge>;
}

function Rangers(props: { title: string; shown: Shown<unknown>; rows: Range[] | undefined; columns: Column<Range>[] }) {
  const { title, shown, rows } = props;
  return (
    <Card title={title} class="p-fits p-rangers" flush aside={<Age shown={shown} />}>
      {rows ? (
        <Table caption={title} columns={props.columns} rows={rows} id={(range) => range.id} stale={() => stale(shown)} />
      ) : (
        <Empty>Not heard yet.</Empty>
      )}
    </Card>
  );
}

export function RangerTables() {
  const part = sensors.value;
  if (!part) return null;
  return (
    <>
      <Rangers title="Sonars" shown={part.sonars} rows={part.sonars.value?.srfs} columns={SONARS} />
      <Rangers title="Infrared, at the floor" shown={part.infrareds} rows={part.infrareds.value?.irs} columns={INFRARED} />
    </>
  );
}
