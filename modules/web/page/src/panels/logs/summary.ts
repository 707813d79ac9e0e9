// Runs in figures. The robot reads a whole run for them, so they are asked for one after another, while somebody looks.
import { signal } from "@preact/signals";
import { num, span } from "../../format";
import type { LogRun, RunSummary } from "../../protocol";
import { t } from "../../words";
import { count } from "../format";
import { summaryLink } from "./names";

/** As many runs, the newest, and none longer than this, bytes: what the robot reads in seconds. */
const MOST = 10;
const LONGEST = 256e6;
/** ms until it is asked again while the robot reads another run. */
const AGAIN = 1500;

/** What is known, by run; null: it cannot be had. */
export const summaries = signal<ReadonlyMap<string, RunSummary | null>>(new Map());

/** The runs whose figures are still to be asked for: those that are written to have none yet. */
export function wanted(runs: readonly LogRun[], known: ReadonlyMap<string, unknown>): string[] {
  const newest = runs.filter((run) => !run.recording && run.bytes > 0).slice(0, MOST);
  return newest.filter((run) => run.bytes <= LONGEST && !known.has(run.run)).map((run) => run.run);
}

/** `20 min 13 s, 314 m, 2 contacts, 1 error`: what there was none of is left out, except for contacts of a simulation. */
export function words({ seconds, distance, contacts, stops, errors, warnings }: RunSummary): string {
  const parts = [span(seconds), num(distance, distance < 100 ? 1 : 0, "m")];
  if (contacts !== null) parts.push(contacts === 0 ? t("no contact") : t("{n} {n|contact|contacts}", { n: count(contacts) }));
  if (stops > 0) parts.push(t("{n} {n|stop|stops}", { n: count(stops) }));
  if (errors > 0) parts.push(t("{n} {n|error|errors}", { n: count(errors) }));
  if (warnings > 0) parts.push(t("{n} {n|warning|warnings}", { n: count(warnings) }));
  return parts.join(", ");
}

/** Asks for what is missing of these runs, until it is told to stop. */
export async function summarize(runs: () => readonly LogRun[], gone: AbortSignal): Promise<void> {
  while (!gone.aborted) {
    const [run] = document.hidden ? [] : wanted(runs(), summaries.value);
    const answer = run === undefined ? "later" : await ask(run, gone);
    if (run !== undefined && answer !== "later") summaries.value = new Map(summaries.value).set(run, answer);
    else await new Promise((after) => setTimeout(after, AGAIN));
  }
}

async function ask(run: string, signal: AbortSignal): Promise<RunSummary | null | "later"> {
  try {
    const response = await fetch(summaryLink(run), { signal });
    if (response.ok) return (await response.json()) as RunSummary;
    return response.status === 503 ? "later" : null;
  } catch {
    return "later";
  }
}
