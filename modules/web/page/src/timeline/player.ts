// The recorded run that is played: where it is, how fast, and what happened in it.
import { computed, effect, signal } from "@preact/signals";
import { onOpen, play as say } from "../connection/view";
import type { RunEvents } from "../protocol";
import { demo, drive, recorded } from "../state";
import { momentLink, momentOf } from "./moments";

/** s of the run per s. */
export const RATES = [0.5, 1, 2, 5, 10, 20] as const;
/** ms between two jumps while a hand is on the bar; until it is asked for the events again. */
const JUMP_EVERY = 150;
const AGAIN = 2000;

/** Where the server says that it is; null: nothing is played. */
export const playing = computed(() => (demo.value ? (drive.value?.play ?? null) : null));
/** What was asked for last: shown at once, until the server is there. */
const wished = signal<{ rate: number; at: number } | null>(null);
export const rate = computed(() => wished.value?.rate ?? playing.value?.rate ?? 1);
export const at = computed(() => wished.value?.at ?? playing.value?.at ?? 0);
/** The rate that Play goes on with. */
let before = 1;

/** Near enough to what was asked for, s. */
const NEAR = 1;
let timer: ReturnType<typeof setTimeout> | undefined;
effect(() => {
  const [is, asked] = [playing.value, wished.peek()];
  // While a jump is not sent yet the server cannot have followed it.
  if (timer === undefined && is && asked && is.rate === asked.rate && Math.abs(is.at - asked.at) < NEAR + asked.rate) wished.value = null;
});

/** Jumps; while a hand is on the bar not for each of its pixels. */
export function jump(to: number): void {
  const length = demo.value?.seconds ?? 0;
  wished.value = { rate: rate.value, at: Math.min(length, Math.max(0, to)) };
  timer ??= setTimeout(() => {
    timer = undefined;
    if (wished.value) say(wished.value.rate, wished.value.at);
    address();
  }, JUMP_EVERY);
}

export function setRate(next: number): void {
  if (next > 0) before = next;
  wished.value = { rate: next, at: at.value };
  say(next);
  if (next === 0) address();
}

export const pause = (): void => setRate(0);
export const goOn = (): void => setRate(before);
export const toggle = (): void => (rate.value === 0 ? goOn() : pause());

/** The address names the moment: it is a link to it. */
function address(): void {
  if (demo.value) history.replaceState(history.state, "", momentLink(demo.value.run, at.value, location.hash));
}

// From the moment that the address names; after a lost connection from where it was.
let first = momentOf(new URLSearchParams(globalThis.location?.search ?? "").get("at"));
if (recorded) {
  onOpen(() => {
    const [to, is] = [first ?? at.peek(), rate.peek()];
    first = null;
    if (to > 0 || is !== 1) say(is, to);
  });
}

// ------------------------------------------------------------------------------------------------ what happened

export const events = signal<RunEvents | null>(null);
/** Why they are not known, in words. */
export const trouble = signal("");
let asked = "";
effect(() => {
  const run = demo.value?.run;
  if (!run || run === asked) return;
  asked = run;
  void load(run);
});

async function load(run: string): Promise<void> {
  try {
    const response = await fetch(`/api/runs/${encodeURIComponent(run)}/events`);
    if (response.ok) {
      events.value = (await response.json()) as RunEvents;
      trouble.value = "";
      return;
    }
    const { why } = (await response.json()) as { why: string };
    trouble.value = why;
    // Another run is being read.
    if (response.status !== 503) return;
  } catch {
    trouble.value = "the robot does not answer";
  }
  setTimeout(() => void load(run), AGAIN);
}
