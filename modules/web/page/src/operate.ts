// What an operator does from anywhere in the page, each with its outcome said: stop, let go on, take and give back control.
import { computed, signal } from "@preact/signals";
import { listen, type Reply, say, type Sayable } from "./connection/command";
import { post } from "./access/pairing";
import { isHeld } from "./holds";
import { clock, commandLink, drive, fresh, holder, may, role, system, UNHELD } from "./state";
import { toast } from "./ui/news";
import { t } from "./words";
import { said } from "./words/said";

/** Says a command; a refusal is shown in its own words. Whether it was done. */
export async function order(command: Sayable, done?: string): Promise<boolean> {
  return (await ordered(command, done)).type !== "refused";
}

/** The same; gives the answer. */
export async function ordered(command: Sayable, done?: string): Promise<Reply> {
  const reply = await say(command);
  if (reply.type === "refused") toast(sentence(reply.why), "bad");
  else if (done) toast(done, "good");
  return reply;
}

/** The robot's words as a sentence, in the language of the page: a capital at the beginning, a stop at the end. */
export function sentence(words: string): string {
  if (!words) return t("It was refused.");
  const text = said(words);
  const end = /[.!?]$/.test(text) ? "" : ".";
  // The name of a module is written as it is.
  const first = /^\w*_/.test(text) ? text[0] : text[0]?.toUpperCase();
  return `${first}${text.slice(1)}${end}`;
}

// -------------------------------------------------------------------------------------------------- stop

/** When the Stop was pressed and the view does not show it yet. */
export const stopping = signal(false);
/** A Stop that could not be said, in words. */
export const stopFailed = signal<string | null>(null);
/** It explains how to pair, to who may not stop the robot. */
export const stopExplained = signal(false);

/** It was stopped by an operator: driver_canbus holds the quick stop until it is let go on. */
export const stopped = computed(() => {
  const part = drive.value;
  // The module's state comes once a second only.
  const held = part && fresh(part.motion) ? isHeld(part.holds) : null;
  if (held !== null) return held;
  const row = system.value?.modules.find((each) => each.module === "driver_canbus");
  return row !== undefined && /^(PAUSE|STOP)$/.test(row.state);
});

/** Hands that must let go when the robot is stopped. */
const hands = new Set<() => void>();
export function onStop(letGo: () => void): () => void {
  hands.add(letGo);
  return () => hands.delete(letGo);
}

/** Through the command socket; if there is none, or it does not accept the command, by a request of its own. Returns what
 *  failed, or null. */
async function sayStop(): Promise<string | null> {
  if (commandLink.value.open) {
    const reply = await say({ type: "stop" });
    if (reply.type !== "refused") return null;
  }
  return post<unknown>("/api/stop", {}).then((answer) => (typeof answer === "string" ? answer : null));
}

let stops = 0;
/** Needs no authority. For a viewer it explains how to pair instead. */
export async function stop(): Promise<void> {
  for (const letGo of [...hands]) letGo();
  if (!may("operator")) {
    stopExplained.value = true;
    return;
  }
  const mine = ++stops;
  stopping.value = true;
  stopFailed.value = null;
  const why = await sayStop();
  if (mine !== stops) return;
  if (why !== null) {
    stopping.value = false;
    if (!stopped.value) stopFailed.value = why;
  } else {
    // The view shows it within two of its parts; should it not, the button is itself again.
    setTimeout(() => mine === stops && (stopping.value = false), 1000);
  }
}

export const resume = (): Promise<boolean> => order({ type: "resume" }, t("Resumed."));

// -------------------------------------------------------------------------------------------------- motion authority

/** Who took control from us, or why it ended, in English; shown until it is read. */
export const lostControl = signal<string | null>(null);
let held = false;
/** ms after a press of "Take control and continue" in which the robot's word that we have it may come. */
const GRANTED = 2000;
/** What that press continues with, and until when, ms of the page's clock. */
let waiting: { then: () => void; until: number } | null = null;
listen({
  authority(holds, why) {
    if (holds && waiting) {
      // Once the page shows what may be done now.
      if (clock() < waiting.until) requestAnimationFrame(waiting.then);
      waiting = null;
    }
    if (held && !holds && why) lostControl.value = why;
    if (holds) lostControl.value = null;
    held = holds;
  },
  closed() {
    if (held) lostControl.value = "The connection was lost, and with it the control.";
    held = false;
  },
});

/** Takes control, from exactly the one that is shown. Whether it was granted. */
export function take(): Promise<boolean> {
  const from = holder.value;
  return order({ type: "take", from: from?.id ?? null }, t("You have control."));
}

/** Says why something may not be done. Where control is all that is missing it offers to take it, and to go on with `then`;
 *  null: what is risky is done anew. */
export function explain(why: string, then: (() => void) | null): void {
  const run = async () => {
    const mine = then && { then, until: clock() + GRANTED };
    waiting = mine;
    if (!(await take()) && waiting === mine) waiting = null;
  };
  const label = then ? t("Take control and continue") : t("Take control");
  toast(why, "warn", why === t(UNHELD) ? { label, run: () => void run() } : undefined);
}

export async function release(): Promise<void> {
  held = false;
  await order({ type: "release" }, t("Control released."));
}

/** What is wanting to drive, in words for who is not paired; null: paired. */
export const unpaired = computed(() => role.value === "nobody" || role.value === "viewer");
