// The course of the chosen fields.
import { signal } from "@preact/signals";
import { Download, Pause, Play, Trash2, X } from "lucide-preact";
import { NONE, num } from "../../format";
import { now, system } from "../../state";
import { Button, Card } from "../../ui";
import { figure } from "../format";
import { Plot } from "../plot/plot";
import { csv, type Ring } from "../plot/ring";
import { end, LONGEST, plots, toggle } from "./store";
import { unit } from "./tree";

const WINDOWS = [
  { seconds: 10, label: "10 s" },
  { seconds: 60, label: "60 s" },
  { seconds: LONGEST, label: "5 min" },
] as const;

const window = signal<number>(10);
/** The right edge while it stands still; null: it moves. */
const frozen = signal<number | null>(null);

/** s from the right edge to where the plot is pointed at; null: nowhere. */
const pointed = signal<number | null>(null);

/** The value where the plot is pointed at, else what came last; it is drawn as often as ages are. */
function Value({ ring }: { ring: Ring }) {
  void now.value;
  const value = pointed.value === null ? ring.newest() : ring.at((frozen.value ?? end()) + pointed.value);
  return (
    <output class="figure" aria-live="off">
      {value === null ? NONE : figure(value)}
    </output>
  );
}

/** All that is kept of the plotted fields, as a file. */
function save(): void {
  const all = plots.value;
  const text = csv(all.map(({ channel, path }) => `${channel} ${path}`), all.map(({ ring }) => ring.from(-Infinity)));
  const url = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  const link = Object.assign(document.createElement("a"), { href: url, download: "plot.csv" });
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 1000);
}

export function Plots() {
  if (plots.value.length === 0) return null;
  const unitOf = (channel: string, path: string) => unit(system.value?.channels.find((row) => row.channel === channel)?.type ?? "", path);
  return (
    <Card
      title="Plot"
      aside={
        <span class="p-aside">
          <Button
            kind="quiet"
            icon={frozen.value === null ? Pause : Play}
            pressed={frozen.value !== null}
            onClick={() => (frozen.value = frozen.value === null ? end() : null)}
          >
            {frozen.value === null ? "Pause" : "Continue"}
          </Button>
          <Button kind="quiet" icon={Download} label="Download as CSV" onClick={save} />
          <Button kind="quiet" icon={Trash2} label="End all plots" onClick={() => (plots.value = [])} />
        </span>
      }
    >
      <div class="choice p-window" role="group" aria-label="How far back is shown">
        {WINDOWS.map(({ seconds, label }) => (
          <Button key={seconds} pressed={window.value === seconds} onClick={() => (window.value = seconds)}>
            {label}
          </Button>
        ))}
      </div>
      <Plot
        label={`Course of ${plots.value.map((each) => `${each.channel} ${each.path}`).join(", ")}`}
        series={plots.value.map(({ channel, path, ring, style }) => ({ label: `${channel} ${path}`, ring, style, unit: unitOf(channel, path) }))}
        onPoint={(at) => (pointed.value = at)}
        window={window.value}
        end={() => frozen.value ?? end()}
        height={280}
      />
      <p class="p-pointed muted">
        {pointed.value === null ? "The newest values; pointed at, those of that moment:" : `Values ${num(Math.abs(pointed.value), 2, "s")} ${frozen.value === null ? "ago" : "before the right edge"}:`}
      </p>
      <ul class="p-list">
        {plots.value.map(({ channel, path, ring, style }) => (
          <li key={`${channel} ${path}`}>
            <svg class={`p-key p-series-${style}`} width={32} height={8} aria-hidden>
              <line x1={0} y1={4} x2={32} y2={4} />
            </svg>
            <span>
              <b>{path}</b> <span class="muted">{channel}</span>
            </span>
            <span class="p-value">
              <Value ring={ring} />
              {unitOf(channel, path) ? <span class="p-unit">{unitOf(channel, path)}</span> : null}
            </span>
            <Button kind="quiet" icon={X} label={`End the plot of ${channel} ${path}`} onClick={() => toggle(channel, path)} />
          </li>
        ))}
      </ul>
    </Card>
  );
}
