// What went wrong, those of one kind together.
import { signal } from "@preact/signals";
import { Search } from "lucide-preact";
import type { ErrorGroup } from "../../protocol";
import { system } from "../../state";
import { Badge, Button, Card, type Column, Empty, Table, type Tone } from "../../ui";
import { count, hex, moment } from "../format";
import { lost } from "../lacks";
import { fault } from "./faults";
import "../panels.css";

const SEVERITIES: readonly (readonly [Tone, string])[] = [
  ["info", "notice"],
  ["warn", "warning"],
  ["bad", "error"],
];

const filter = signal("");
const standingOnly = signal(false);

function severity(group: ErrorGroup): readonly [Tone, string] {
  return SEVERITIES[group.severity] ?? ["bad", `unknown (${group.severity})`];
}

/** Whether a group has all words that were typed, anywhere. */
function found(group: ErrorGroup, words: string[]): boolean {
  const text = `${group.module} ${hex(group.number)} ${fault(group.number).name} ${group.message} ${severity(group)[1]}`.toLowerCase();
  return words.every((word) => text.includes(word));
}

const COLUMNS: Column<ErrorGroup>[] = [
  {
    head: "What",
    title: true,
    by: (group) => group.message,
    cell: (group) => (
      <span class="p-what">
        {group.standing && group.message ? group.message : fault(group.number).means}
        <span class="muted">
          <b>
            {hex(group.number)} {fault(group.number).name}
          </b>
          {group.standing ? `: ${fault(group.number).means}` : group.message && `, said last: ${group.message}`}
        </span>
      </span>
    ),
  },
  {
    head: "Is",
    by: (group) => (group.standing ? 0 : 1),
    cell: (group) => (group.standing ? <Badge tone={severity(group)[0]}>stands</Badge> : <Badge tone="off">over</Badge>),
  },
  { head: "Severity", by: (group) => -group.severity, cell: (group) => severity(group)[1] },
  { head: "Module", by: (group) => group.module, cell: (group) => group.module },
  { head: "Count", figure: true, by: (group) => group.count, cell: (group) => count(group.count) },
  { head: "First seen", figure: true, by: (group) => group.first, cell: (group) => moment(group.first) },
  { head: "Last seen", figure: true, by: (group) => group.last, cell: (group) => moment(group.last) },
];

/** How many stand that are more than a notice: what the navigation shows. */
export function standing(): number {
  return system.value?.errors.filter((group) => group.standing && group.severity > 0).length ?? 0;
}

function Summary() {
  const now = standing();
  if (lost()) return <Badge tone="off">not known now</Badge>;
  return now ? <Badge tone="bad">{`${now} standing`}</Badge> : <Badge tone="good">none stands</Badge>;
}

export function Errors() {
  const groups = system.value?.errors;
  if (!groups) return <Empty>Not heard yet.</Empty>;
  const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
  const rows = groups.filter((group) => (group.standing || !standingOnly.value) && found(group, words));
  return (
    <Card title="Errors" class="p-three" flush aside={<Summary />}>
      <div class="p-bar">
        <label class="p-search">
          <Search size={18} aria-hidden />
          <span class="visually-hidden">Filter by module, number or words</span>
          <input
            type="search"
            value={filter.value}
            placeholder="Module, number or words"
            onInput={(event) => (filter.value = event.currentTarget.value)}
          />
        </label>
        <Button pressed={standingOnly.value} onClick={() => (standingOnly.value = !standingOnly.value)}>
          Standing only
        </Button>
        <p class="muted p-grow">
          An error <b>stands</b> from its report until the module says that it is <b>over</b>. What is over is kept here with its count; nothing needs to be
          acknowledged.
        </p>
      </div>
      <Table
        caption="Errors by kind"
        columns={COLUMNS}
        rows={rows}
        id={(group) => `${group.module} ${group.number}`}
        stale={(group) => lost() || !group.standing}
        empty={groups.length ? "None of them matches." : "Nothing has been reported since the server started."}
      />
    </Card>
  );
}
