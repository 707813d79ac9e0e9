// The newest message of the chosen channel, field by field.
import { signal } from "@preact/signals";
import { ArrowLeft, ChartSpline, ChevronDown, ChevronRight } from "lucide-preact";
import { useEffect, useState } from "preact/hooks";
import { span } from "../../format";
import type { MessagePart } from "../../protocol";
import { Badge, Button, Card, Empty, toast } from "../../ui";
import { figure, moment } from "../format";
import { Publish } from "./publish";
import { choose, chosen, latest, series, toggle } from "./store";
import { type Field, fields, FIELDS_MAX, isInstant } from "./tree";
import { Unit } from "./unit";

/** ms between two drawings: faster nobody reads. */
const DRAWN = 200;
/** Branches of this size are open from the start. */
const SMALL = 6;

/** Branches that were opened and closed by hand, by channel and way. */
const turned = signal<ReadonlyMap<string, boolean>>(new Map());

export function Inspected() {
  const channel = chosen.value;
  const [, tick] = useState(0);
  useEffect(() => {
    if (channel === null) return;
    const timer = setInterval(() => tick((n) => n + 1), DRAWN);
    return () => clearInterval(timer);
  }, [channel]);
  if (channel === null) {
    return (
      <Card title="Message" class="p-hint">
        <Empty>Choose a channel to see its messages live, and any number in them over time.</Empty>
      </Card>
    );
  }
  const held = latest(channel);
  return (
    <Card
      title={channel}
      flush
      aside={
        <span class="p-aside">
          {held ? <span class={held.age > 2 ? "age is-stale" : "age"}>{span(held.age)} ago</span> : null}
          <Publish key={channel} channel={channel} />
          <Button kind="quiet" icon={ArrowLeft} label="Back to the channels" class="p-back" onClick={() => choose(null)} />
        </span>
      }
    >
      {held ? <Body channel={channel} part={held.part} /> : <Empty>Waiting for a message. What is said on change only may take long.</Empty>}
    </Card>
  );
}

function Body({ channel, part }: { channel: string; part: MessagePart }) {
  if (!part.value) {
    return (
      <p class="p-pad">
        <Badge tone="warn">{part.error ?? "It cannot be read."}</Badge>
      </p>
    );
  }
  const message = part.value;
  const root = Object.keys(message).length;
  const isOpen = (path: string) => turned.value.get(`${channel} ${path}`) ?? (root <= SMALL && !path.includes("["));
  const { lines, more } = fields(message, isOpen);
  const turn = (path: string) => {
    turned.value = new Map(turned.value).set(`${channel} ${path}`, !isOpen(path));
  };
  return (
    <>
      <p class="p-type muted">{part.type}</p>
      <ul class="p-tree" aria-label={`Fields of ${channel}`}>
        {lines.map((field) => (
          <Line key={field.path} channel={channel} type={part.type} field={field} open={isOpen(field.path)} turn={turn} />
        ))}
      </ul>
      {more ? <p class="muted p-pad">Only the first {FIELDS_MAX} lines are listed: close a branch to see those below it.</p> : null}
    </>
  );
}

function Line(props: { channel: string; type: string; field: Field; open: boolean; turn: (path: string) => void }) {
  const { channel, field, open } = props;
  const indent = { paddingInlineStart: `${0.75 + 1.25 * field.depth}rem` };
  if (field.size !== null) {
    return (
      <li>
        <button type="button" class="p-branch" style={indent} aria-expanded={open} onClick={() => props.turn(field.path)}>
          {open ? <ChevronDown size={16} aria-hidden /> : <ChevronRight size={16} aria-hidden />}
          {field.name}
          <span class="muted">{field.list ? `${field.size} in the list` : `${field.size} fields`}</span>
        </button>
      </li>
    );
  }
  const isPlotted = series(channel, field.path);
  const isTime = isInstant(props.type, field);
  // A moment over time tells nothing.
  const canPlot = !isTime && (typeof field.value === "number" || typeof field.value === "boolean" || isPlotted || field.value === null);
  return (
    <li class="p-leaf" style={indent}>
      <span class="p-field">{field.name}</span>
      <span class="p-value">
        <output class="figure" aria-live="off">
          {isTime ? moment(field.value as number) : written(field.value)}
        </output>
        {isTime ? null : <Unit type={props.type} path={field.path} />}
      </span>
      {canPlot ? (
        <button
          type="button"
          class={isPlotted ? `p-toggle p-series-${isPlotted.style}` : "p-toggle"}
          aria-pressed={isPlotted !== undefined}
          aria-label={`Plot ${field.path}`}
          title={isPlotted ? "End the plot" : "Plot it"}
          onClick={() => {
            const why = toggle(channel, field.path);
            if (why) toast(why, "warn");
          }}
        >
          <ChartSpline size={18} aria-hidden />
        </button>
      ) : (
        <span class="p-toggle" aria-hidden />
      )}
    </li>
  );
}

/** A number with as many digits as it is worth; text in quotation marks. */
function written(value: Field["value"]): string {
  if (value === null) return "– (no number)";
  if (typeof value === "string") return `“${value}”`;
  if (typeof value === "boolean") return value ? "true" : "false";
  return Number.isInteger(value) ? String(value).replace("-", "−") : figure(value);
}
