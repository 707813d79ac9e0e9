// The channels that were heard.
import { signal } from "@preact/signals";
import { ChevronRight, Search } from "lucide-preact";
import { bytes, num, span } from "../../format";
import type { ChannelRow } from "../../protocol";
import { since, system } from "../../state";
import { Card, type Column, Empty, Table, toast } from "../../ui";
import { count } from "../format";
import { lost } from "../lacks";
import { GROUPS, group } from "./groups";
import { Publish } from "./publish";
import { choose, chosen } from "./store";

const filter = signal("");

const age = (row: ChannelRow): number => row.age + (system.value ? since(system.value) : 0);
/** Silent for twice as long as its rate lets expect, and for a while. */
const quiet = (row: ChannelRow): boolean => lost() || row.age > Math.max(2, row.rate > 0 ? 2 / row.rate : 2);

const COLUMNS: Column<ChannelRow>[] = [
  {
    head: "Channel",
    title: true,
    by: (row) => row.channel,
    cell: (row) => (
      <button
        type="button"
        class="p-link"
        aria-current={chosen.value === row.channel}
        onClick={() => {
          const why = choose(row.channel);
          if (why) toast(why, "warn");
        }}
      >
        <span>
          {chosen.value === row.channel ? <ChevronRight size={14} aria-hidden /> : null}
          {row.channel}
        </span>
        <span class="muted">{row.type.replace(/^\w+\./, "") || "not one of the robot's types"}</span>
      </button>
    ),
  },
  { head: "Rate", figure: true, by: (row) => row.rate, cell: (row) => num(row.rate, 1, "Hz") },
  { head: "Bandwidth", figure: true, by: (row) => row.bandwidth, cell: (row) => `${bytes(row.bandwidth)}/s` },
  { head: "Count", figure: true, by: (row) => row.count, cell: (row) => count(row.count) },
  { head: "Age", figure: true, by: (row) => row.age, cell: (row) => span(age(row)) },
];

export function Channels() {
  const all = system.value?.channels;
  if (!all) return <Empty>No data yet.</Empty>;
  const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
  const rows = all.filter((row) => words.every((word) => `${row.channel} ${row.type}`.toLowerCase().includes(word)));
  const rate = rows.reduce((sum, row) => sum + row.rate, 0);
  const bandwidth = rows.reduce((sum, row) => sum + row.bandwidth, 0);
  return (
    <Card
      title="Channels"
      class="p-channels p-three"
      flush
      aside={
        <span class="muted">
          {rows.length}: {num(rate, 0, "Hz")}, {bytes(bandwidth)}/s
        </span>
      }
    >
      <div class="p-bar">
        <label class="p-search">
          <Search size={18} aria-hidden />
          <span class="visually-hidden">Filter by channel or type</span>
          <input
            type="search"
            value={filter.value}
            placeholder="Channel or type"
            onInput={(event) => (filter.value = event.currentTarget.value)}
          />
        </label>
        <Publish />
      </div>
      <Table
        caption="Channels with their rates"
        columns={COLUMNS}
        rows={rows}
        id={(row) => row.channel}
        stale={quiet}
        groups={{ of: (row) => group(row.channel), heads: GROUPS }}
        empty={all.length ? "None of them matches." : "No message has been received."}
      />
    </Card>
  );
}
