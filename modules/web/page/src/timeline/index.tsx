// The time line of a recorded run, where Stop is on a live robot: play, pause, speed, jumps, and what happened when.
import { Link, ListVideo, Pause, Play, RotateCcw, RotateCw, SkipForward } from "lucide-preact";
import { useEffect, useState } from "preact/hooks";
import { types } from "../shell/keys";
import { demo } from "../state";
import { Badge, Button, Dialog } from "../ui";
import { toast } from "../ui/news";
import { clock, KINDS, LEAD, momentLink, nextTrouble } from "./moments";
import { at, events, jump, rate, RATES, setRate, toggle, trouble } from "./player";
import "./timeline.css";

/** s of a jump by hand. */
const STEP = 10;

export function Timeline() {
  const [listed, list] = useState(false);
  const run = demo.value;
  useEffect(watchKeys, []);
  if (!run) return null;
  const now = at.value;
  const paused = rate.value === 0;
  const next = nextTrouble(events.value?.events ?? [], now);
  const noNext = events.value === null ? (trouble.value ? `The events are not known: ${trouble.value}.` : "The run is being read.") : next ? null : "There is no further error or stop.";
  return (
    <section class="timeline" aria-label="Time line">
      <div class="timeline-bar">
        <Marks seconds={run.seconds} />
        <input
          type="range"
          min={0}
          max={run.seconds}
          step={0.1}
          value={now}
          aria-label="Moment of the run"
          aria-valuetext={`${clock(now)} of ${clock(run.seconds)}`}
          onInput={(event) => jump(event.currentTarget.valueAsNumber)}
        />
      </div>
      <div class="timeline-tools">
        <Button kind="primary" icon={paused ? Play : Pause} label={paused ? "Play" : "Pause"} onClick={toggle} />
        <Button kind="quiet" icon={RotateCcw} label="10 s back" onClick={() => jump(now - STEP)} />
        <Button kind="quiet" icon={RotateCw} label="10 s ahead" onClick={() => jump(now + STEP)} />
        <p class="timeline-clock figure">
          {clock(now)} <span class="muted">/ {clock(run.seconds)}</span>
        </p>
        <select class="timeline-rate" aria-label="Speed" value={String(rate.value)} onChange={(event) => setRate(Number(event.currentTarget.value))}>
          {paused ? <option value="0">paused</option> : null}
          {RATES.map((each) => (
            <option key={each} value={String(each)}>
              {each}×
            </option>
          ))}
        </select>
        <Button kind="quiet" icon={SkipForward} label="Next error or stop" whyNot={noNext} onClick={() => next && jump(next.at - LEAD)} />
        <Button kind="quiet" icon={ListVideo} label="What happened" onClick={() => list(true)} />
        <Button kind="quiet" icon={Link} label="Link to this moment" onClick={() => void copy(run.run, now)} />
      </div>
      <Dialog title="What happened" open={listed} onClose={() => list(false)}>
        <Happened onJump={(to) => (list(false), jump(to))} />
      </Dialog>
    </section>
  );
}

/** What happened, as ticks over the bar; the list has the same in words. */
function Marks({ seconds }: { seconds: number }) {
  return (
    <div class="timeline-marks" aria-hidden>
      {(events.value?.events ?? []).map(({ at, kind, words }, n) => (
        <i key={n} class={`is-${kind}`} title={`${clock(at)} ${words}`} style={{ left: `${(100 * at) / Math.max(seconds, 0.1)}%` }} />
      ))}
    </div>
  );
}

function Happened({ onJump }: { onJump: (at: number) => void }) {
  const all = events.value;
  if (all === null) return <p>{trouble.value ? `It is not known: ${trouble.value}.` : "The run is being read."}</p>;
  if (all.events.length === 0) return <p>No marks, stops, errors or contacts.</p>;
  return (
    <>
      <ol class="timeline-list">
        {all.events.map(({ at, kind, words }, n) => (
          <li key={n}>
            <button type="button" onClick={() => onJump(at - LEAD)}>
              <span class="figure">{clock(at)}</span>
              <Badge tone={KINDS[kind].tone}>{KINDS[kind].word}</Badge>
              <span>{words || "without a text"}</span>
            </button>
          </li>
        ))}
      </ol>
      {all.left_out > 0 ? <p class="muted">{all.left_out} more are not listed.</p> : null}
    </>
  );
}

async function copy(run: string, at: number): Promise<void> {
  const link = new URL(momentLink(run, at, location.hash), location.href).href;
  history.replaceState(history.state, "", link);
  try {
    // Where the browser does not trust the address it has no clipboard.
    await navigator.clipboard.writeText(link);
    toast(`Link to ${clock(at)} copied.`, "good");
  } catch {
    toast(`The address of this page is now that of ${clock(at)}: copy it from there.`, "info");
  }
}

/** Space plays and pauses, the arrows jump; not where keys are for something else. */
function watchKeys(): () => void {
  const key = (event: KeyboardEvent) => {
    const on = event.target instanceof HTMLElement ? event.target : null;
    if (!demo.value || event.ctrlKey || event.altKey || event.metaKey || types(on) || on?.closest("button, a, summary, [role=slider], canvas")) return;
    if (event.key === " ") toggle();
    else if (event.key === "ArrowLeft") jump(at.value - STEP);
    else if (event.key === "ArrowRight") jump(at.value + STEP);
    else return;
    event.preventDefault();
  };
  addEventListener("keydown", key);
  return () => removeEventListener("keydown", key);
}
