// Each bus: load and errors; each node on it: how often it is asked, and how it answers.
import { num } from "../../format";
import type { DataBus, Node, Shown } from "../../protocol";
import { stale, system } from "../../state";
import { Age, Badge, Card, type Column, Empty, Facts, Table, type Tone } from "../../ui";
import { count, hex, milliseconds, percent } from "../format";

const BUS: readonly (readonly [Tone, string])[] = [
  ["good", "active"],
  ["warn", "warning"],
  ["bad", "error passive"],
  ["bad", "off"],
  ["bad", "closed"],
];
const NODE: readonly (readonly [Tone, string])[] = [
  ["good", "ok"],
  ["warn", "degraded"],
  ["bad", "lost"],
];

function word(words: readonly (readonly [Tone, string])[], state: number) {
  const [tone, text] = words[state] ?? (["bad", `unknown (${state})`] as const);
  return <Badge tone={tone}>{text}</Badge>;
}

/** Of what was asked. */
function share(part: number, row: Node): string {
  return row.requests > 0 && part > 0 ? ` (${percent(part / row.requests, 2)})` : "";
}

const COLUMNS: Column<Node>[] = [
  { head: "Node", title: true, by: (row) => row.name, cell: (row) => row.name },
  { head: "Address", by: (row) => row.address, cell: (row) => hex(row.address, 2) },
  { head: "State", by: (row) => row.state, cell: (row) => word(NODE, row.state) },
  { head: "Requests", figure: true, by: (row) => row.requests, cell: (row) => count(row.requests) },
  { head: "Retries", figure: true, by: (row) => row.retries, cell: (row) => count(row.retries) + share(row.retries, row) },
  { head: "Timeouts", figure: true, by: (row) => row.timeouts, cell: (row) => count(row.timeouts) + share(row.timeouts, row) },
  { head: "CRC errors", figure: true, by: (row) => row.crc_errors, cell: (row) => count(row.crc_errors) + share(row.crc_errors, row) },
  {
    head: "Round trip, ms",
    figure: true,
    by: (row) => row.round_trip_mean ?? Infinity,
    cell: (row) =>
      row.round_trip_mean === null ? (
        "–"
      ) : (
        <span title="least, mean, most">
          {milliseconds(row.round_trip_min)} / <b>{milliseconds(row.round_trip_mean)}</b> / {milliseconds(row.round_trip_max)}
        </span>
      ),
  },
];

export function BusList() {
  const buses = system.value?.busses;
  if (!buses?.length) {
    return (
      <Card title="Buses">
        <Empty>No bus is known.</Empty>
      </Card>
    );
  }
  return (
    <>
      {buses.map((shown) => (
        <Bus key={shown.value?.bus} shown={shown} />
      ))}
    </>
  );
}

function Bus({ shown }: { shown: Shown<DataBus> }) {
  const bus = shown.value;
  if (!bus) return null;
  return (
    <Card title={`Bus ${bus.bus}`} class="p-three p-nodes" aside={<Age shown={shown} />}>
      <div class={stale(shown) ? "is-stale" : ""}>
        <Facts
          facts={[
            { name: "State", value: word(BUS, bus.state) },
            { name: "Load", value: <Load share={bus.load} /> },
            { name: "Frames", value: count(bus.frames) },
            { name: "Errors", value: count(bus.errors) },
          ]}
        />
      </div>
      {bus.nodes.length ? (
        <Table
          caption={`Nodes of ${bus.bus}`}
          columns={COLUMNS}
          rows={bus.nodes}
          id={(row) => `${row.address} ${row.name}`}
          stale={() => stale(shown)}
        />
      ) : null}
    </Card>
  );
}

function Load({ share }: { share: number | null }) {
  if (share === null) return <>{num(null)}</>;
  return (
    <span class="p-load">
      {percent(share, 1)}
      <meter class="p-meter" min={0} max={1} low={0.7} high={0.9} optimum={0} value={share} aria-hidden />
    </span>
  );
}
