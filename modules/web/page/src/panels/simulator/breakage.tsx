// Faults: chosen, let loose, and ended.
import { signal } from "@preact/signals";
import { Bug, X } from "lucide-preact";
import { span } from "../../format";
import { clock, now, scene } from "../../state";
import { Badge, Button, Card, type Column, Empty, Table, toast } from "../../ui";
import { order } from "../../operate";
import { lacks } from "../lacks";
import { ending, fault, listed, ROBOT, usual } from "./faults";

interface Active {
  target: string;
  fault: string;
  value: number;
  /** The page's clock, ms; null: until it is ended. */
  until: number | null;
}

/** What was set from this page and is not over, the newest first. What others set is not known here. */
const active = signal<Active[]>([]);
const ACTIVE = 100;

const DURATIONS = [1, 5, 10, 30, 60, 300] as const;
const form = signal<{ target: string; fault: string; value: string; duration: number }>({ target: "", fault: "", value: "", duration: 10 });

const going = (): Active[] => active.value.filter((each) => each.until === null || each.until > now.value);

async function begin(target: string, name: string, value: number, duration: number): Promise<void> {
  if (!(await order({ type: "fault", target, fault: name, value, duration }, `${target}: ${name} was asked for.`))) return;
  if (fault(target, name).momentary) return;
  const rest = going().filter((each) => each.target !== target || each.fault !== name);
  active.value = [{ target, fault: name, value, until: duration > 0 ? clock() + 1000 * duration : null }, ...rest].slice(0, ACTIVE);
}

async function finish(each: Active): Promise<void> {
  const { fault: name, value } = ending(each.target, each.fault);
  const done = name === "none" ? `The faults of ${each.target} are over.` : `${each.target}: ${each.fault} is over.`;
  if (!(await order({ type: "fault", target: each.target, fault: name, value, duration: 0 }, done))) return;
  active.value = active.value.filter((other) => (name === "none" ? other.target !== each.target : other !== each));
}

/** Ends what was set here and, as nobody here knows it, whatever others have set. */
async function finishAll(): Promise<void> {
  const targets = (scene.value?.faults ?? []).filter(({ faults }) => faults.includes("none")).map(({ target }) => target);
  for (const each of going()) if (!targets.includes(each.target)) await finish(each);
  for (const target of targets) {
    if (!(await order({ type: "fault", target, fault: "none", value: 0, duration: 0 }))) return;
    active.value = active.value.filter((each) => each.target !== target);
  }
  toast("All faults ended.", "good");
}

const COLUMNS: Column<Active>[] = [
  { head: "Target", title: true, cell: (each) => each.target },
  { head: "Fault", cell: (each) => each.fault },
  { head: "Value", figure: true, cell: (each) => (fault(each.target, each.fault).value ? each.value : "–") },
  {
    head: "Ends",
    figure: true,
    cell: (each) => (each.until === null ? "when it is ended" : `in ${span(Math.max(0, each.until - now.value) / 1000)}`),
  },
  {
    head: "End",
    cell: (each) => (
      <Button kind="quiet" icon={X} label={`End ${each.fault} of ${each.target}`} whyNot={lacks("engineer")} onClick={() => void finish(each)} />
    ),
  },
];

export function Breakage() {
  const targets = (scene.value?.faults ?? []).filter(({ target, faults }) => target !== ROBOT && listed(faults).length > 0);
  if (targets.length === 0) {
    return (
      <Card title="Faults">
        <Empty>Nothing can be broken here.</Empty>
      </Card>
    );
  }
  const rows = going();
  const whyNot = lacks("engineer");
  return (
    <Card
      title="Faults"
      icon={Bug}
      aside={
        rows.length ? (
          <Badge tone="warn">{`${rows.length} set here`}</Badge>
        ) : (
          <Badge tone="off">none set here</Badge>
        )
      }
    >
      <Form targets={targets} />
      {rows.length ? <Table caption="Faults that were set from this page" columns={COLUMNS} rows={rows} id={(each) => `${each.target} ${each.fault}`} /> : null}
      <p class="row">
        <Button icon={X} whyNot={whyNot} onClick={() => void finishAll()}>
          End all faults
        </Button>
        <span class="muted">Those that others have set, too.</span>
      </p>
    </Card>
  );
}

function Form({ targets }: { targets: { target: string; faults: string[] }[] }) {
  const asked = form.value;
  const set = (change: Partial<typeof asked>) => (form.value = { ...form.value, ...change });
  const target = targets.find((each) => each.target === asked.target) ?? targets[0];
  if (!target) return null;
  const names = listed(target.faults);
  const name = names.includes(asked.fault) ? asked.fault : (names[0] as string);
  const { means, value: quantity, momentary } = fault(target.target, name);
  const text = asked.value === "" ? usual(quantity) : asked.value;
  const value = Number(text.replace(",", "."));
  const bad = quantity && !(Number.isFinite(value) && text.trim() !== "" && value >= quantity.low && value <= quantity.high);
  const whyNot = lacks("engineer") ?? (bad ? `${quantity.name} is ${quantity.low} to ${quantity.high}${quantity.unit && ` ${quantity.unit}`}.` : null);
  return (
    <form
      class="p-form"
      onSubmit={(event) => {
        event.preventDefault();
        if (whyNot === null) void begin(target.target, name, quantity ? value : 0, momentary ? 0 : asked.duration);
      }}
    >
      <label class="field">
        Target
        <select value={target.target} onChange={(event) => set({ target: event.currentTarget.value, value: "" })}>
          {targets.map((each) => (
            <option key={each.target} value={each.target}>
              {each.target}
            </option>
          ))}
        </select>
      </label>
      <label class="field">
        Fault
        <select value={name} onChange={(event) => set({ fault: event.currentTarget.value, value: "" })}>
          {names.map((each) => (
            <option key={each} value={each}>
              {each.replaceAll("_", " ")}
            </option>
          ))}
        </select>
      </label>
      {quantity ? (
        <label class="field">
          {quantity.name}
          {quantity.unit && `, ${quantity.unit}`}
          <input inputMode="decimal" size={8} value={text} aria-invalid={bad === true} onInput={(event) => set({ value: event.currentTarget.value })} />
        </label>
      ) : null}
      {momentary ? null : (
        <label class="field">
          For
          <select value={String(asked.duration)} onChange={(event) => set({ duration: Number(event.currentTarget.value) })}>
            {DURATIONS.map((seconds) => (
              <option key={seconds} value={String(seconds)}>
                {span(seconds)}
              </option>
            ))}
            <option value="0">until it is ended</option>
          </select>
        </label>
      )}
      <Button type="submit" kind="danger" icon={Bug} whyNot={whyNot} onClick={() => {}}>
        Inject fault
      </Button>
      <p class="muted p-full">
        {means} {whyNot}
      </p>
    </form>
  );
}
