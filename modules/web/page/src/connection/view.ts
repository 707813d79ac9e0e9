// The view's socket: parts come in, the channels that the page watches go out.
import type { Part } from "../protocol";
import { receive, viewLink } from "../state";
import { Socket } from "./socket";

/** Channels that panels want to see, with how many want each. */
const wanted = new Map<string, number>();
/** Number of channels that the server lets one page watch, beside `ALL`. */
export const MOST_WATCHED = 8;
/** In place of a channel: the latest messages of all, as `recent` parts. */
export const ALL = "*";

let opened: (() => void) | undefined;

const run = new URLSearchParams(location.search).get("demo");
const socket = new Socket(run === null ? "/ws/view" : `/ws/view?demo=${encodeURIComponent(run || "1")}`, viewLink, {
  opened: () => {
    tell();
    opened?.();
  },
  heard: (frame) => isPart(frame) && receive(frame),
  closed: () => {},
});

/** Sends the messages of `channel` as `message` parts, until what it answers is called. */
export function watch(channel: string): () => void {
  wanted.set(channel, (wanted.get(channel) ?? 0) + 1);
  tell();
  let ended = false;
  return () => {
    if (ended) return;
    ended = true;
    const left = (wanted.get(channel) ?? 1) - 1;
    if (left > 0) wanted.set(channel, left);
    else wanted.delete(channel);
    tell();
  };
}

/** How the recorded run is played on; `at` in s: from there. */
export function play(rate: number, at?: number): void {
  socket.send(at === undefined ? { rate } : { rate, at });
}

/** Called each time the socket is open. */
export const onOpen = (call: () => void): void => void (opened = call);

/** Set by a fixture, which stands in for the server. */
export const hooks: { watching?: (channels: string[]) => void } = {};

function tell(): void {
  const few = [...wanted.keys()].filter((channel) => channel !== ALL).slice(0, MOST_WATCHED);
  const channels = wanted.has(ALL) ? [...few, ALL] : few;
  hooks.watching?.(channels);
  socket.send({ watch: channels });
}

export const openView = (): void => socket.open();
export const closeView = (): void => socket.close();

function isPart(frame: unknown): frame is Part {
  return typeof frame === "object" && frame !== null && "part" in frame;
}
