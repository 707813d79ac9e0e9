// Temperatures against their limits, and fans.
import { Fan, Thermometer } from "lucide-preact";
import { num } from "../../format";
import type { Fan as FanRow, Temperature } from "../../protocol";
import { scene, stale, system } from "../../state";
import { Age, Badge, Card, type Column, Empty, Table } from "../../ui";
import { against, percent } from "../format";

const limit = (name: string): number | undefined => scene.value?.temperature_limits.find((each) => each.name === name)?.celsius;

const TEMPERATURES: Column<Temperature>[] = [
  { head: "Where", title: true, by: (row) => row.name, cell: (row) => row.name },
  { head: "Temperature", figure: true, by: (row) => row.value ?? -Infinity, cell: (row) => against(row.value, limit(row.name), "°C") },
  {
    head: "Status",
    by: (row) => (row.over ? 0 : 1),
    cell: (row) => {
      if (row.value === null) return <Badge tone="warn">not measured</Badge>;
      return row.over ? <Badge tone="bad">too hot</Badge> : <Badge tone="good">OK</Badge>;
    },
  },
];

const FANS: Column<FanRow>[] = [
  { head: "Fan", title: true, by: (row) => row.name, cell: (row) => row.name },
  { head: "Duty", figure: true, by: (row) => row.duty ?? -Infinity, cell: (row) => percent(row.duty) },
  { head: "Speed", figure: true, by: (row) => row.rpm ?? -Infinity, cell: (row) => num(row.rpm, 0, "rpm") },
  {
    head: "Status",
    by: (row) => (row.failed ? 0 : 1),
    cell: (row) => (row.failed ? <Badge tone="bad">failed</Badge> : <Badge tone="good">OK</Badge>),
  },
];

export function Thermometers() {
  const shown = system.value?.temperatures;
  const rows = shown?.value?.temperatures;
  return (
    <Card title="Temperatures" icon={Thermometer} class="p-fits" flush aside={<Age shown={shown} />}>
      {rows ? (
        <Table caption="Temperatures" columns={TEMPERATURES} rows={rows} id={(row) => row.name} stale={() => stale(shown)} />
      ) : (
        <Empty>No data yet.</Empty>
      )}
    </Card>
  );
}

export function Fans() {
  const shown = system.value?.temperatures;
  const rows = shown?.value?.fans;
  return (
    <Card title="Fans" icon={Fan} class="p-fits" flush aside={<Age shown={shown} />}>
      {rows ? (
        <Table caption="Fans" columns={FANS} rows={rows} id={(row) => row.name} stale={() => stale(shown)} />
      ) : (
        <Empty>No data yet.</Empty>
      )}
    </Card>
  );
}
