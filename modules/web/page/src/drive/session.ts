// The hands of this page: its pad, keys and gamepad, and one hold for all of them. Whatever takes the page out of sight or
// the hand off ends it.
import { computed, effect, signal } from "@preact/signals";
import { listen, send } from "../connection/command";
import { onStop, sentence, stopped } from "../operate";
import { barred, pausedByWords, waitsForHand } from "../holds";
import { clock, connection, drive, fresh, roundTrip, scene, stale, TOO_SLOW, whyNot } from "../state";
import { types } from "../shell/keys";
import { keysRest } from "../ui/rest";
import { t } from "../words";
import { holdWords } from "../words/said";
import { type Act, CREEP_KEY, Gamepads, Keys, type Stick } from "./hands";
import { type Demand, Hold, type Source } from "./hold";

/** How often it is looked whether something is due, ms; and every how many turns while nobody drives. */
const TURN = 10;
const IDLE_TURNS = 4;

/** Share of the limit that a hand gets. */
export const PACES = { slow: 1 / 3, normal: 1 } as const;
export const pace = signal<keyof typeof PACES>("slow");

/** Why the pad is off; null: it is not. */
export const whyNoDrive = computed<string | null>(() => {
  if (whyNot.value !== null) return whyNot.value;
  const link = connection.value;
  if (link.state === "live" && link.quality === "bad") {
    return t("The connection is too slow to drive: {trip} ms there and back, more than {most} ms.", { trip: Math.round(roundTrip.value ?? 0), most: TOO_SLOW });
  }
  if (stopped.value) return t("The robot is stopped. Resume first.");
  const line = fresh(drive.value?.stop);
  if (line?.engaged) return t("PAUSE: {who} stops the robot.", { who: pausedByWords(drive.value) });
  const part = drive.value;
  const bar = barred(part?.holds ?? []);
  if (bar) return sentence(holdWords(bar));
  if (part && (part.status.word === "fault" || part.status.word === "silent") && !waitsForHand(part.holds)) {
    return sentence(part.status.reason);
  }
  return null;
});

/** Turns on the spot, and ways to a side, that the base can and the guard does not permit; its words are of the others. */
export const closedWays = computed<string[]>(() => {
  const guard = fresh(drive.value?.guard);
  const limits = scene.value?.limits;
  if (guard === null || !limits) return [];
  // What is not a number permits nothing.
  const closed = (bound: number | null, can: number, words: string): string[] => (can > 0 && (bound ?? 0) <= 0 ? [words] : []);
  return [
    ...closed(guard.turn_left, limits.rotation, t("It must not turn left.")),
    ...closed(guard.turn_right, limits.rotation, t("It must not turn right.")),
    ...closed(guard.left, limits.sideways, t("It must not move to the left.")),
    ...closed(guard.right, limits.sideways, t("It must not move to the right.")),
  ];
});

/** Why the second input has no effect now; null: it has. */
export const whyNoCreep = computed<string | null>(() => {
  if (whyNoDrive.value !== null) return whyNoDrive.value;
  if (stale(drive.value?.guard)) return t("The guard does not report.");
  return drive.value?.bound?.limits || closedWays.value.length > 0 ? null : t("Nothing is in the way.");
});
/** The second input is held, and reported. */
export const creeping = signal(false);

/** What the hand wants now; null: no hand. */
export const commanded = signal<({ source: Source } & Demand) | null>(null);
/** A finger is on the pad, whether it drives or its hold has ended. */
export const fingerOn = signal(false);
/** The base goes sideways; and the pad's sides mean that, not turning. */
export const goesSideways = computed(() => (scene.value?.limits.sideways ?? 0) > 0);
export const padSideways = signal(false);
/** Why the last hold ended, other than by letting go; in English. */
export const endedWhy = signal("");
/** A gamepad is there. */
export const gamepadName = signal<string | null>(null);

export const hold = new Hold((command) => send(command));
const keys = new Keys();
const gamepads = new Gamepads();

/** To be called after each event: shows what the hold does. */
export function shown(): void {
  const now = hold.commanded;
  const next = now && hold.holding ? { source: hold.holding, ...now } : null;
  const old = commanded.peek();
  const same = (["source", "speed", "steering", "rotation", "sideways"] as const).every((each) => next?.[each] === old?.[each]);
  if (!same) commanded.value = next;
  creeping.value = hold.creeping;
  if (hold.holding !== "gamepad") gamepads.over();
  endedWhy.value = hold.ended;
}

/** The second input was pressed or released. A press that has no effect is ignored. */
export function second(held: boolean): void {
  if (held && whyNoCreep.value !== null) return;
  hold.second(held, clock());
  shown();
}

function act(source: Source, what: Act): void {
  if (what === null) return;
  if (what.act === "press") hold.press(source, what.wish, clock());
  else if (what.act === "move") hold.move(source, what.wish);
  else hold.release(source);
  shown();
}

export function letGo(why: string): void {
  keys.lost();
  hold.letGo(why);
  shown();
}

/** Takes part while the drive view is shown; what it answers ends it. */
export function begin(): () => void {
  const gone = new AbortController();
  const on = { signal: gone.signal };
  const down = (event: KeyboardEvent) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return letGo("Another key was held.");
    const at = event.target instanceof HTMLElement ? event.target : null;
    if (event.code === CREEP_KEY && !event.repeat && !types(at)) return second(true);
    if (!keys.drives(event.code) || event.defaultPrevented || types(at)) return;
    event.preventDefault();
    if (keysRest()) {
      endedWhy.value = "Focus the pad, then drive with the keys.";
      return;
    }
    act("keys", keys.down(event.code, event.repeat));
  };
  addEventListener("keydown", down, on);
  addEventListener("keyup", (event) => (event.code === CREEP_KEY ? second(false) : act("keys", keys.up(event.code))), on);
  addEventListener("blur", () => letGo("The page lost the focus."), on);
  addEventListener("pagehide", () => letGo("The page was left."), on);
  document.addEventListener("visibilitychange", () => document.hidden && letGo("The page was hidden."), on);
  document.addEventListener("freeze", () => letGo("The page was frozen."), on);

  const ends = [
    () => gone.abort(),
    onStop(() => letGo("Stop was pressed.")),
    listen({
      authority: (holds, why) => holds || letGo(why || "You have no control any more."),
      ended: (number, why) => (hold.endedByRobot(number, why), shown()),
      closed: () => letGo("The connection was lost."),
    }),
    effect(() => {
      const { speed, steering, rotation, sideways } = scene.value?.limits ?? { speed: 0, steering: 0, rotation: 0, sideways: 0 };
      const share = PACES[pace.value];
      const aside = sideways > 0 ? { sideways: sideways * share } : {};
      hold.limit(speed * share, steering, rotation > 0 ? { rotation: rotation * share, ...aside } : {});
      keys.sideways = goesSideways.value;
      hold.allow(whyNoDrive.value);
      queueMicrotask(shown);
    }),
  ];
  let turns = 0;
  const turn = setInterval(() => {
    turns += 1;
    if (hold.holding === null && turns % IDLE_TURNS !== 0) return;
    const stick = readGamepad();
    act("gamepad", gamepads.read(stick));
    const change = gamepads.second(stick);
    if (change !== null) second(change);
    if (hold.holding === null) return;
    hold.tick(clock());
    shown();
  }, TURN);
  return () => {
    clearInterval(turn);
    letGo("The view was left.");
    for (const end of ends) end();
  };
}

/** The first gamepad of the usual layout: left stick forward and back, and to the sides where the base can; the right
 *  stick's sides steer or turn, a shoulder is the dead man, both creep. */
function readGamepad(): Stick | null {
  const pad = navigator.getGamepads?.().find((each) => each?.connected && each.mapping === "standard") ?? null;
  const name = pad?.id.replace(/\s*\(.*$/, "") ?? null;
  if (name !== gamepadName.peek()) gamepadName.value = name;
  if (!pad || document.hidden || !document.hasFocus()) return null;
  const pressed = (button: number): boolean => pad.buttons[button]?.pressed ?? false;
  const [deadMan, second, speed] = [pressed(4) || pressed(5), pressed(4) && pressed(5), -(pad.axes[1] ?? 0)];
  if (goesSideways.value) return { deadMan, second, speed, steering: -(pad.axes[2] ?? 0), sideways: -(pad.axes[0] ?? 0) };
  return { deadMan, second, speed, steering: -(pad.axes[2] ?? pad.axes[0] ?? 0) };
}
