// The modules and their processes, those in trouble first: what each is, what it should be, and commands to change that.
import { SlidersHorizontal } from "lucide-preact";
import { useState } from "preact/hooks";
import { bytes, num, span } from "../../format";
import type { ModuleRow } from "../../protocol";
import { system } from "../../state";
import { Badge, Button, Card, type Column, Empty, Table } from "../../ui";
import { percent } from "../format";
import { lost } from "../lacks";
import { ModuleDialog } from "./dialog";
import { announced, asWanted, isStale, phase, State } from "./row";
import "../panels.css";

const COLUMNS: Column<ModuleRow>[] = [
  {
    head: "Module",
    title: true,
    by: (row) => row.module,
    cell: (row) => (
      <span class="p-name">
        {row.module}
        {row.critical ? <span class="p-tag" title="The robot does not move without it.">critical</span> : null}
      </span>
    ),
  },
  { head: "State", by: (row) => `${row.well ? 1 : 0}${row.state}`, cell: (row) => <State row={row} /> },
  { head: "Process", by: (row) => row.phase, cell: (row) => phase(row) },
  { head: "PID", figure: true, by: (row) => row.pid, cell: (row) => (row.pid ? row.pid : "–") },
  { head: "Up", figure: true, by: (row) => row.uptime, cell: (row) => (row.pid ? span(row.uptime) : "–") },
  { head: "Restarts", figure: true, by: (row) => row.restarts, cell: (row) => row.restarts },
  { head: "Last exit", by: (row) => row.last_exit, cell: (row) => row.last_exit || "–" },
  { head: "CPU", figure: true, by: (row) => row.cpu, cell: (row) => (row.pid ? percent(row.cpu, 1) : "–") },
  { head: "Memory", figure: true, by: (row) => row.rss, cell: (row) => (row.pid ? bytes(row.rss) : "–") },
  { head: "Last message", figure: true, by: (row) => row.age ?? Infinity, cell: (row) => <Heard row={row} /> },
];

/** How long ago it announced itself; said in words where that is too long. */
function Heard({ row }: { row: ModuleRow }) {
  const age = announced(row);
  if (age === null) return <>never</>;
  return <>{isStale(row) ? `silent ${span(age)}` : span(age)}</>;
}

export function Modules() {
  const [chosen, choose] = useState<string | null>(null);
  const rows = system.value?.modules;
  if (!rows) return <Empty>No data yet.</Empty>;
  const isIll = (row: ModuleRow) => !asWanted(row) || (row.phase !== "down" && isStale(row));
  const ill = rows.filter(isIll);
  const cpu = rows.reduce((sum, row) => sum + row.cpu, 0);
  const rss = rows.reduce((sum, row) => sum + row.rss, 0);
  const columns: Column<ModuleRow>[] = [
    ...COLUMNS,
    {
      head: "Command",
      cell: (row) => (
        <Button kind="quiet" icon={SlidersHorizontal} label={`Details and commands of ${row.module}`} onClick={() => choose(row.module)} />
      ),
    },
  ];
  const row = rows.find((each) => each.module === chosen);
  return (
    <Card
      title="Modules"
      class="p-three p-modules"
      flush
      aside={
        <span class="p-aside">
          {lost() ? (
            <Badge tone="off">not known now</Badge>
          ) : ill.length ? (
            <Badge tone="bad">
              {ill.length} of {rows.length} not in the wanted state
            </Badge>
          ) : (
            <Badge tone="good">all {rows.length} in the wanted state</Badge>
          )}
          <span class="muted">
            {num(100 * cpu, 1, "%")} CPU, {bytes(rss)}
          </span>
        </span>
      }
    >
      <Table
        caption="Modules with their states and processes"
        columns={columns}
        rows={lost() ? rows : [...ill, ...rows.filter((row) => !isIll(row))]}
        id={(each) => each.module}
        stale={isStale}
        empty="No module is known."
      />
      {row ? <ModuleDialog row={row} onClose={() => choose(null)} /> : null}
    </Card>
  );
}
