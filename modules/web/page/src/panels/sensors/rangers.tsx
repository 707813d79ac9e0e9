// Sonars and infrared rangers in figures.
import type { ComponentChildren } from "preact";
import { deg, num } from "../../format";
import { scene, sensors, stale } from "../../state";
import { Age, Badge, Card, type Column, Empty, Table, type Tone } from "../../ui";
import { type Plain, t } from "../../words";
import { side } from "./geometry";
import { type Floor, floor, near } from "./near";
import { has, infrareds, type Sounding, type Soundings, sonars } from "./readings";

const columns = (heard: (range: Sounding) => ComponentChildren): Column<Sounding>[] => [
  { head: t("No."), title: true, by: (range) => range.id, cell: (range) => range.id },
  { head: t("Direction"), by: (range) => range.theta, cell: (range) => `${t(side(range.theta))} (${deg(range.theta)})` },
  {
    head: t("Position"),
    cell: (range) => t("{x}, {y}", { x: num(range.x, 2), y: num(range.y, 2, "m") }),
  },
  {
    head: t("Distance"),
    figure: true,
    by: (range) => range.distance ?? Infinity,
    cell: (range) => num(range.distance, 2, "m"),
  },
  {
    head: t("Age when sent"),
    figure: true,
    by: (range) => range.age ?? Infinity,
    cell: (range) => num(range.age, 2, "s"),
  },
  {
    head: t("Status"),
    by: (range) => (range.known === "unknown" ? -1 : (range.distance ?? Infinity)),
    cell: heard,
  },
];
const sonar = (range: Sounding) => <Near range={range} />;
const FLOORS: Readonly<Record<Floor, [Tone, Plain]>> = { floor: ["good", "floor"], hole: ["bad", "no floor"], unknown: ["bad", "not known"] };
function infrared(range: Sounding) {
  const [tone, word] = FLOORS[floor(range)];
  return <Badge tone={tone}>{t(word)}</Badge>;
}

function Near({ range }: { range: Sounding }) {
  if (range.known === "unknown") return <Badge tone="bad">{t("not known")}</Badge>;
  if (range.distance === null) return <Badge tone="off">{t("no echo")}</Badge>;
  const how = near(range.distance);
  if (how === "close") return <Badge tone="bad">{t("close")}</Badge>;
  return how === "near" ? <Badge tone="warn">{t("near")}</Badge> : <Badge tone="good">{t("clear")}</Badge>;
}

function Rangers(props: { title: string; soundings: Soundings; status: (range: Sounding) => ComponentChildren }) {
  const { title } = props;
  const { shown, rows } = props.soundings;
  return (
    <Card title={title} class="p-fits p-rangers" flush aside={<Age shown={shown} />}>
      {rows ? (
        <Table caption={title} columns={columns(props.status)} rows={rows} id={(range) => range.id} stale={() => stale(shown)} />
      ) : (
        <Empty>{t("No data yet.")}</Empty>
      )}
    </Card>
  );
}

export function RangerTables() {
  const part = sensors.value;
  if (!part) return null;
  const [sound, light] = [sonars(part, scene.value?.sonar.field_of_view ?? 0), infrareds(part)];
  return (
    <>
      {has(part, sound) ? <Rangers title={t("Sonars")} soundings={sound} status={sonar} /> : null}
      {has(part, light) ? <Rangers title={t("Infrared, at the floor")} soundings={light} status={infrared} /> : null}
    </>
  );
}
