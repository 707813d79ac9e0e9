// The modules and their processes, those in trouble first: what each is, what it should be, and commands to change that.
import { SlidersHorizontal } from "lucide-preact";
import { useState } from "preact/hooks";
import { bytes, num, span } from "../../format";
import type { ModuleRow } from "../../protocol";
import { system } from "../../state";
import { Badge, Button, Card, type Column, Empty, Table } from "../../ui";
import { t } from "../../words";
import { percent } from "../format";
import { lost } from "../lacks";
import { ModuleDialog } from "./dialog";
import { announced, asWanted, isStale, lastExit, phase, State } from "./row";
import "../panels.css";

const shown = (): Column<ModuleRow>[] => [
  {
    head: t("Module"),
    title: true,
    by: (row) => row.module,
    cell: (row) => (
      <span class="p-name">
        {row.module}
        {row.critical ? <span class="p-tag" title={t("The robot does not move without it.")}>{t("critical")}</span> : null}
      </span>
    ),
  },
  { head: t("State"), by: (row) => `${row.well ? 1 : 0}${row.state}`, cell: (row) => <State row={row} /> },
  { head: t("Process"), by: (row) => row.phase, cell: (row) => phase(row) },
  { head: t("PID"), figure: true, by: (row) => row.pid, cell: (row) => (row.pid ? row.pid : "–") },
  { head: t("Up"), figure: true, by: (row) => row.uptime, cell: (row) => (row.pid ? span(row.uptime) : "–") },
  { head: t("Restarts"), figure: true, by: (row) => row.restarts, cell: (row) => row.restarts },
  { head: t("Last exit"), by: (row) => row.last_exit, cell: lastExit },
  { head: t("CPU"), figure: true, by: (row) => row.cpu, cell: (row) => (row.pid ? percent(row.cpu, 1) : "–") },
  { head: t("Memory"), figure: true, by: (row) => row.rss, cell: (row) => (row.pid ? bytes(row.rss) : "–") },
  { head: t("Last message"), figure: true, by: (row) => row.age ?? Infinity, cell: (row) => <Heard row={row} /> },
];

/** How long ago it announced itself; said in words where that is too long. */
function Heard({ row }: { row: ModuleRow }) {
  const age = announced(row);
  if (age === null) return <>{t("never")}</>;
  return <>{isStale(row) ? t("silent {time}", { time: span(age) }) : span(age)}</>;
}

export function Modules() {
  const [chosen, choose] = useState<string | null>(null);
  const rows = system.value?.modules;
  if (!rows) return <Empty>{t("No data yet.")}</Empty>;
  const isIll = (row: ModuleRow) => !asWanted(row) || (row.phase !== "down" && isStale(row));
  const ill = rows.filter(isIll);
  const cpu = rows.reduce((sum, row) => sum + row.cpu, 0);
  const rss = rows.reduce((sum, row) => sum + row.rss, 0);
  const columns: Column<ModuleRow>[] = [
    ...shown(),
    {
      head: t("Command"),
      cell: (row) => (
        <Button kind="quiet" icon={SlidersHorizontal} label={t("Details and commands of {module}", { module: row.module })} onClick={() => choose(row.module)} />
      ),
    },
  ];
  const row = rows.find((each) => each.module === chosen);
  return (
    <Card
      title={t("Modules")}
      class="p-three p-modules"
      flush
      aside={
        <span class="p-aside">
          {lost() ? (
            <Badge tone="off">{t("not known now")}</Badge>
          ) : ill.length ? (
            <Badge tone="bad">{t("{n} of {all} not in the wanted state", { n: ill.length, all: rows.length })}</Badge>
          ) : (
            <Badge tone="good">{t("all {n} in the wanted state", { n: rows.length })}</Badge>
          )}
          <span class="muted">
            {t("{load} CPU, {memory}", { load: num(100 * cpu, 1, "%"), memory: bytes(rss) })}
          </span>
        </span>
      }
    >
      <Table
        caption={t("Modules with their states and processes")}
        columns={columns}
        rows={lost() ? rows : [...ill, ...rows.filter((row) => !isIll(row))]}
        id={(each) => each.module}
        stale={isStale}
        empty={t("No module is known.")}
      />
      {row ? <ModuleDialog row={row} onClose={() => choose(null)} /> : null}
    </Card>
  );
}
