// The SDO browser: reads and writes objects of a drive's dictionary.
import { signal } from "@preact/signals";
import { BookOpen, Download, PencilLine } from "lucide-preact";
import { useState } from "preact/hooks";
import { say } from "../../connection/command";
import { scene } from "../../state";
import { Badge, Button, Card, type Column, Empty, Slide, Table } from "../../ui";
import { lacks } from "../lacks";
import { hex } from "../format";
import { encode, fromHex, index as asIndex, interpret, interpretations, known, OBJECTS, toHex, type Type, TYPES, wholeNumber } from "./sdo";

interface Entry {
  number: number;
  at: Date;
  node: number;
  index: number;
  subindex: number;
  type: Type;
  /** What was written; null: it was read. */
  written: string | null;
  /** Hexadecimal. */
  data: string;
  /** Why it was not done; empty: it was. */
  why: string;
}

/** What was asked, the newest first. It outlives the view, not the page. */
const history = signal<Entry[]>([]);
const HISTORY = 50;
let asked = 0;

interface Asked {
  node: string;
  index: string;
  subindex: string;
  type: Type;
  value: string;
}
const form = signal<Asked>({ node: "", index: "1000", subindex: "0", type: "u32", value: "" });
const busy = signal(false);

async function ask(node: number, index: number, subindex: number, type: Type, written: string | null, data?: Uint8Array): Promise<void> {
  busy.value = true;
  const command = { type: "sdo" as const, node, index, subindex };
  const reply = await say(data === undefined ? command : { ...command, data: toHex(data) });
  busy.value = false;
  const answer = reply.type === "sdo" ? { data: reply.data, why: refusal(reply.abort, reply.why) } : { data: "", why: reply.type === "refused" ? reply.why : "" };
  const entry: Entry = { number: ++asked, at: new Date(), node, index, subindex, type, written, ...answer };
  history.value = [entry, ...history.value].slice(0, HISTORY);
}

function refusal(abort: number, why: string): string {
  if (abort === 0) return why;
  const code = hex(abort, 8);
  return why.toUpperCase().includes(code.slice(2)) ? why : `${why || "aborted"} (${code})`;
}

/** What an answer means as the type that was asked for; as hexadecimal where it does not fit. */
function meaning(entry: Entry): string {
  const data = fromHex(entry.data) ?? new Uint8Array();
  return interpret(data, entry.type) ?? interpret(data, "hex") ?? "";
}

const COLUMNS: Column<Entry>[] = [
  { head: "Time", cell: (entry) => entry.at.toLocaleTimeString() },
  {
    head: "Object",
    title: true,
    cell: (entry) => (
      <span>
        node {entry.node}, {hex(entry.index)}:{entry.subindex} <span class="muted">{known(entry.index, entry.subindex)?.name}</span>
      </span>
    ),
  },
  {
    head: "Result",
    cell: (entry) => {
      if (entry.why) return <Badge tone="bad">{entry.why}</Badge>;
      if (entry.written !== null) return <Badge tone="good">wrote {entry.written}</Badge>;
      return <b class="figure">{meaning(entry)}</b>;
    },
  },
  {
    head: "As",
    cell: (entry) => {
      const data = fromHex(entry.data);
      if (entry.why || entry.written !== null || !data) return entry.type;
      const others = interpretations(data).filter(({ type }) => type !== entry.type);
      return (
        <span>
          {entry.type} <span class="muted">{others.map(({ type, value }) => `${type} ${value}`).join(" · ")}</span>
        </span>
      );
    },
  },
  {
    head: "Again",
    cell: (entry) => (
      <Button
        kind="quiet"
        icon={Download}
        label={`Read ${hex(entry.index)}:${entry.subindex} of node ${entry.node} again`}
        whyNot={lacks("engineer") ?? (busy.value ? "The last one is not answered yet." : null)}
        onClick={() => void ask(entry.node, entry.index, entry.subindex, entry.type, null)}
      />
    ),
  },
];

export function SdoBrowser() {
  const drives = scene.value?.drives ?? [];
  return (
    <Card title="Objects of a drive (SDO)" icon={BookOpen}>
      {drives.length ? <Form drives={drives} /> : <Empty>The robot has no drive with CANopen.</Empty>}
      {history.value.length ? <Table caption="What was read and written" columns={COLUMNS} rows={history.value} id={(entry) => entry.number} /> : null}
    </Card>
  );
}

/** A node of the first bus, or one of the drives, whose numbers are 1000 more for each bus before theirs. */
function asNode(text: string, drives: { node: number }[]): number | null {
  return wholeNumber(text, 1, 127) ?? drives.find(({ node }) => String(node) === text.trim())?.node ?? null;
}

function Form({ drives }: { drives: { name: string; node: number }[] }) {
  const [writing, setWriting] = useState(false);
  const asks = form.value;
  const set = (change: Partial<Asked>) => (form.value = { ...form.value, ...change });
  const node = asks.node === "" ? (drives[0]?.node ?? null) : asNode(asks.node, drives);
  const index = asIndex(asks.index);
  const subindex = wholeNumber(asks.subindex, 0, 255);
  const encoded = encode(asks.value, asks.type);
  const wrong =
    node === null ? "The node is 1 to 127." : index === null ? "The index is 0000 to FFFF, hexadecimal." : subindex === null ? "The sub-index is 0 to 255." : null;
  const whyNot = lacks("engineer") ?? wrong ?? (busy.value ? "The last one is not answered yet." : null);
  const read = () => {
    if (node !== null && index !== null && subindex !== null) void ask(node, index, subindex, asks.type, null);
  };
  const write = () => {
    if (node === null || index === null || subindex === null || !("data" in encoded)) return;
    void ask(node, index, subindex, asks.type, asks.value.trim(), encoded.data);
    setWriting(false);
  };
  const pick = (key: string) => {
    const object = OBJECTS.find((each) => `${each.index}:${each.subindex}` === key);
    if (object) set({ index: hex(object.index).slice(2), subindex: String(object.subindex), type: object.type });
  };
  const current = index !== null && subindex !== null ? known(index, subindex) : undefined;
  return (
    <form
      class="p-form"
      onSubmit={(event) => {
        event.preventDefault();
        if (whyNot === null) read();
      }}
    >
      <label class="field">
        Drive
        <select value={String(node ?? "")} onChange={(event) => set({ node: event.currentTarget.value })}>
          {drives.map((drive) => (
            <option key={drive.node} value={String(drive.node)}>
              {drive.name} ({drive.node})
            </option>
          ))}
        </select>
      </label>
      <label class="field p-grow">
        Object
        <select value={current ? `${current.index}:${current.subindex}` : ""} onChange={(event) => pick(event.currentTarget.value)}>
          <option value="">another one</option>
          {OBJECTS.map((object) => (
            <option key={`${object.index}:${object.subindex}`} value={`${object.index}:${object.subindex}`}>
              {hex(object.index)}:{object.subindex} {object.name}
            </option>
          ))}
        </select>
      </label>
      <label class="field">
        Index, hex
        <input value={asks.index} size={6} spellcheck={false} autocomplete="off" aria-invalid={index === null} onInput={(event) => set({ index: event.currentTarget.value })} />
      </label>
      <label class="field">
        Sub-index
        <input value={asks.subindex} size={4} inputMode="numeric" autocomplete="off" aria-invalid={subindex === null} onInput={(event) => set({ subindex: event.currentTarget.value })} />
      </label>
      <label class="field">
        As
        <select value={asks.type} onChange={(event) => set({ type: event.currentTarget.value as Type })}>
          {TYPES.map((type) => (
            <option key={type} value={type}>
              {type}
            </option>
          ))}
        </select>
      </label>
      <div class="row p-full">
        <Button type="submit" kind="primary" icon={Download} whyNot={whyNot} onClick={() => {}}>
          Read
        </Button>
        <Button icon={PencilLine} pressed={writing} whyNot={lacks("engineer")} onClick={() => setWriting(!writing)}>
          Write…
        </Button>
        {whyNot ? <span class="muted">{whyNot}</span> : null}
      </div>
      {writing ? (
        <div class="p-full p-write">
          <label class="field">
            Value as {asks.type}
            <input
              value={asks.value}
              spellcheck={false}
              autocomplete="off"
              aria-invalid={!("data" in encoded)}
              onInput={(event) => set({ value: event.currentTarget.value })}
            />
          </label>
          {current && !current.writable ? <p class="p-note">{current.name} can usually only be read.</p> : null}
          <Slide
            label={`Write ${hex(index ?? 0)}:${subindex ?? 0}`}
            tone="danger"
            whyNot={whyNot ?? ("why" in encoded ? encoded.why : null)}
            onConfirm={write}
          />
        </div>
      ) : null}
    </form>
  );
}
