// Temperatures against their limits, and fans.
import { Fan, Thermometer } from "lucide-preact";
import { num } from "../../format";
import type { Fan as FanRow, Temperature } from "../../protocol";
import { scene, stale, system } from "../../state";
import { Age, Badge, Card, type Column, Empty, Table } from "../../ui";
import { t } from "../../words";
import { against, percent } from "../format";

const limit = (name: string): number | undefined => scene.value?.temperature_limits.find((each) => each.name === name)?.celsius;

const temperatures = (): Column<Temperature>[] => [
  { head: t("Where"), title: true, by: (row) => row.name, cell: (row) => row.name },
  { head: t("Temperature"), figure: true, by: (row) => row.value ?? -Infinity, cell: (row) => against(row.value, limit(row.name), "°C") },
  {
    head: t("Status"),
    by: (row) => (row.over ? 0 : 1),
    cell: (row) => {
      if (row.value === null) return <Badge tone="warn">{t("not measured")}</Badge>;
      return row.over ? <Badge tone="bad">{t("too hot")}</Badge> : <Badge tone="good">{t("OK")}</Badge>;
    },
  },
];

const fans = (): Column<FanRow>[] => [
  { head: t("Fan"), title: true, by: (row) => row.name, cell: (row) => row.name },
  { head: t("Duty"), figure: true, by: (row) => row.duty ?? -Infinity, cell: (row) => percent(row.duty) },
  { head: t("Speed"), figure: true, by: (row) => row.rpm ?? -Infinity, cell: (row) => num(row.rpm, 0, t("rpm")) },
  {
    head: t("Status"),
    by: (row) => (row.failed ? 0 : 1),
    cell: (row) => (row.failed ? <Badge tone="bad">{t("failed")}</Badge> : <Badge tone="good">{t("OK")}</Badge>),
  },
];

export function Thermometers() {
  const shown = system.value?.temperatures;
  const rows = shown?.value?.temperatures;
  return (
    <Card title={t("Temperatures")} icon={Thermometer} class="p-fits" flush aside={<Age shown={shown} />}>
      {rows ? (
        <Table caption={t("Temperatures")} columns={temperatures()} rows={rows} id={(row) => row.name} stale={() => stale(shown)} />
      ) : (
        <Empty>{t("No data yet.")}</Empty>
      )}
    </Card>
  );
}

export function Fans() {
  const shown = system.value?.temperatures;
  const rows = shown?.value?.fans;
  return (
    <Card title={t("Fans")} icon={Fan} class="p-fits" flush aside={<Age shown={shown} />}>
      {rows ? (
        <Table caption={t("Fans")} columns={fans()} rows={rows} id={(row) => row.name} stale={() => stale(shown)} />
      ) : (
        <Empty>{t("No data yet.")}</Empty>
      )}
    </Card>
  );
}
