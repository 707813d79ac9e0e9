// The time line of a recorded run, where Stop is on a live robot: play, pause, speed, jumps, and what happened when.
import { Link, ListVideo, Pause, Play, RotateCcw, RotateCw, SkipForward } from "lucide-preact";
import { useEffect, useState } from "preact/hooks";
import { written } from "../format";
import { types } from "../shell/keys";
import { demo } from "../state";
import { Badge, Button, Dialog } from "../ui";
import { toast } from "../ui/news";
import { t } from "../words";
import { said } from "../words/said";
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
  const noNext = events.value === null ? (trouble.value ? t("The events are not known: {why}.", { why: said(trouble.value) }) : t("The run is being read.")) : next ? null : t("There is no further error or stop.");
  return (
    <section class="timeline" aria-label={t("Time line")}>
      <div class="timeline-bar">
        <Marks seconds={run.seconds} />
        <input
          type="range"
          min={0}
          max={run.seconds}
          step={0.1}
          value={now}
          aria-label={t("Moment of the run")}
          aria-valuetext={t("{at} of {length}", { at: clock(now), length: clock(run.seconds) })}
          onInput={(event) => jump(event.currentTarget.valueAsNumber)}
        />
      </div>
      <div class="timeline-tools">
        <Button kind="primary" icon={paused ? Play : Pause} label={paused ? t("Play") : t("Pause")} onClick={toggle} />
        <Button kind="quiet" icon={RotateCcw} label={t("10 s back")} onClick={() => jump(now - STEP)} />
        <Button kind="quiet" icon={RotateCw} label={t("10 s ahead")} onClick={() => jump(now + STEP)} />
        <p class="timeline-clock figure">
          {clock(now)} <span class="muted">/ {clock(run.seconds)}</span>
        </p>
        <select class="timeline-rate" aria-label={t("Speed")} value={String(rate.value)} onChange={(event) => setRate(Number(event.currentTarget.value))}>
          {paused ? <option value="0">{t("paused")}</option> : null}
          {RATES.map((each) => (
            <option key={each} value={String(each)}>
              {written(String(each))}×
            </option>
          ))}
        </select>
        <Button kind="quiet" icon={SkipForward} label={t("Next error or stop")} whyNot={noNext} onClick={() => next && jump(next.at - LEAD)} />
        <Button kind="quiet" icon={ListVideo} label={t("What happened")} onClick={() => list(true)} />
        <Button kind="quiet" icon={Link} label={t("Link to this moment")} onClick={() => void copy(run.run, now)} />
      </div>
      <Dialog title={t("What happened")} open={listed} onClose={() => list(false)}>
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
        <i key={n} class={`is-${kind}`} title={`${clock(at)} ${said(words)}`} style={{ left: `${(100 * at) / Math.max(seconds, 0.1)}%` }} />
      ))}
    </div>
  );
}

function Happened({ onJump }: { onJump: (at: number) => void }) {
  const all = events.value;
  if (all === null) return <p>{trouble.value ? t("It is not known: {why}.", { why: said(trouble.value) }) : t("The run is being read.")}</p>;
  if (all.events.length === 0) return <p>{t("No marks, stops, errors or contacts.")}</p>;
  return (
    <>
      <ol class="timeline-list">
        {all.events.map(({ at, kind, words }, n) => (
          <li key={n}>
            <button type="button" onClick={() => onJump(at - LEAD)}>
              <span class="figure">{clock(at)}</span>
              <Badge tone={KINDS[kind].tone}>{t(KINDS[kind].word)}</Badge>
              <span>{words ? said(words) : t("without a text")}</span>
            </button>
          </li>
        ))}
      </ol>
      {all.left_out > 0 ? <p class="muted">{t("{n} more are not listed.", { n: all.left_out })}</p> : null}
    </>
  );
}

async function copy(run: string, at: number): Promise<void> {
  const link = new URL(momentLink(run, at, location.hash), location.href).href;
  history.replaceState(history.state, "", link);
  try {
    // Where the browser does not trust the address it has no clipboard.
    await navigator.clipboard.writeText(link);
    toast(t("Link to {moment} copied.", { moment: clock(at) }), "good");
  } catch {
    toast(t("The address of this page is now that of {moment}: copy it from there.", { moment: clock(at) }), "info");
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
