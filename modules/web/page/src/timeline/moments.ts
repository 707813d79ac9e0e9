// Moments of a recorded run: how they are written, and which event is the next. Pure.
import type { EventKind, RunEvent } from "../protocol";
import type { Tone } from "../ui/badge";
import type { Plain } from "../words";

/** `1:02`, `1:01:02`. */
export function clock(seconds: number): string {
  const s = Math.max(0, Math.floor(seconds));
  const two = (value: number) => String(value).padStart(2, "0");
  const [h, m] = [Math.floor(s / 3600), Math.floor(s / 60) % 60];
  return h > 0 ? `${h}:${two(m)}:${two(s % 60)}` : `${m}:${two(s % 60)}`;
}

export const KINDS: Record<EventKind, { word: Plain; tone: Tone }> = {
  mark: { word: "mark", tone: "info" },
  stop: { word: "stop", tone: "warn" },
  error: { word: "error", tone: "bad" },
  warning: { word: "warning", tone: "warn" },
  contact: { word: "contact", tone: "bad" },
};

/** What a jump to the next error goes to: all that is wrong, and no mark. */
const isTrouble = ({ kind }: RunEvent): boolean => kind === "error" || kind === "stop" || kind === "contact";

/** s before an event from which on it is shown: what led to it is seen, too. */
export const LEAD = 2;

/** The first trouble after a moment, and after the lead of the one that was jumped to; null: there is none. */
export function nextTrouble(events: readonly RunEvent[], at: number): RunEvent | null {
  return events.find((event) => isTrouble(event) && event.at > at + LEAD + 0.5) ?? null;
}

/** A moment in a query, s; null: none, or not a moment. */
export function momentOf(query: string | null): number | null {
  const at = query === null || query === "" ? NaN : Number(query);
  return Number.isFinite(at) && at >= 0 ? at : null;
}

/** The address of a moment: this page, playing the run from there on. */
export function momentLink(run: string, at: number, view: string): string {
  return `/?demo=${encodeURIComponent(run)}&at=${Math.floor(at)}${view}`;
}
