// What the inspector remembers: which channel is looked at, which fields are plotted, and their pasts. It outlives the view, so
// that one finds things as one left them; messages come only while somebody looks.
import { effect, signal } from "@preact/signals";
import { MOST_WATCHED, watch } from "../../connection/view";
import type { MessagePart } from "../../protocol";
import { clock, message } from "../../state";
import { STYLES } from "../plot/plot";
import { Ring } from "../plot/ring";
import { at, plotted } from "./tree";

/** The longest window, s, at the rate that messages come at most, Hz. */
export const LONGEST = 300;
const RATE = 20;

export interface Plotted {
  channel: string;
  path: string;
  ring: Ring;
  style: number;
}

export const chosen = signal<string | null>(null);
export const plots = signal<Plotted[]>([]);
/** The newest message of each watched channel, and when it came, ms of the page. */
const newest = new Map<string, { part: MessagePart; came: number }>();
/** What the messages' scale of time is ahead of the page's clock, s. */
let ahead: number | null = null;

export const series = (channel: string, path: string): Plotted | undefined =>
  plots.value.find((each) => each.channel === channel && each.path === path);

/** Begins to plot a field, or ends it. Why it cannot; null: it was done. */
export function toggle(channel: string, path: string): string | null {
  if (series(channel, path)) {
    plots.value = plots.value.filter((each) => each.channel !== channel || each.path !== path);
    return null;
  }
  const style = Array.from({ length: STYLES }, (_, n) => n).find((n) => plots.value.every((each) => each.style !== n));
  if (style === undefined) return `At most ${STYLES} fields are plotted at once.`;
  plots.value = [...plots.value, { channel, path, style, ring: new Ring(LONGEST * RATE + 100) }];
  return null;
}

/** Looks at a channel. Why it cannot; null: it was done. */
export function choose(channel: string | null): string | null {
  if (channel !== null && channels(channel).length > MOST_WATCHED) {
    return `At most ${MOST_WATCHED} channels are watched at once: end a plot first.`;
  }
  chosen.value = channel;
  return null;
}

function channels(looked: string | null): string[] {
  const all = plots.value.map((each) => each.channel);
  return [...new Set(looked === null ? all : [looked, ...all])];
}

/** What came last of a channel, and its age on the page, s. */
export function latest(channel: string): { part: MessagePart; age: number } | null {
  const held = newest.get(channel);
  return held ? { part: held.part, age: (clock() - held.came) / 1000 } : null;
}

/** Now, on the messages' scale. */
export function end(): number {
  return clock() / 1000 + (ahead ?? 0);
}

function take(part: MessagePart): void {
  newest.set(part.channel, { part, came: clock() });
  const offset = part.at - clock() / 1000;
  // The least delayed message tells best; a scale that began anew tells by a leap.
  ahead = ahead === null || Math.abs(offset - ahead) > 5 ? offset : Math.max(ahead, offset);
  for (const each of plots.peek()) {
    if (each.channel === part.channel) each.ring.push(part.at, part.value ? plotted(at(part.value, each.path)) : null);
  }
}

/** Watches while a view is there; what it answers ends that. */
export function look(): () => void {
  const watched = new Map<string, () => void>();
  const endWatching = effect(() => {
    const wanted = channels(chosen.value);
    for (const [channel, unwatch] of watched) {
      if (wanted.includes(channel)) continue;
      unwatch();
      watched.delete(channel);
      newest.delete(channel);
    }
    for (const channel of wanted) if (!watched.has(channel)) watched.set(channel, watch(channel));
  });
  const endHearing = effect(() => {
    if (message.value) take(message.value);
  });
  return () => {
    endWatching();
    endHearing();
    for (const unwatch of watched.values()) unwatch();
    newest.clear();
  };
}
