// The scenario editor: what is drawn, what is chosen, what was before, and that the simulation runs it.
import { effect, signal } from "@preact/signals";
import { ordered, sentence } from "../operate";
import { fresh, scene, system } from "../state";
import { toast } from "../ui/news";
import { t } from "../words";
import { begin, mode } from "./draft";
import { boxBetween, hit, type Item, moved, type Point, read, type Scenario, turned, type Unreadable, walkerBetween, withoutBoxes, write } from "./scenario";

/** `move` chooses and moves what is there; the others draw. */
export type Tool = "move" | "box" | "walker" | "start" | "waypoint";

export const scenario = signal<Scenario | null>(null);
/** Why the text of the world that runs cannot be edited; null: it can. */
export const unreadable = signal<Unreadable["unreadable"] | null>(null);
export const tool = signal<Tool>("move");
/** Index of the chosen item. */
export const chosen = signal<number | null>(null);
/** What was before each change, the latest last. */
export const history = signal<readonly Pick<Scenario, "items" | "route">[]>([]);
/** Why the simulation refused the scenario that it was sent last; empty: it did not. */
export const refused = signal("");
/** The simulation has not answered in time. */
export const unanswered = signal(false);
/** The scenario that was sent, and the timestamp of its command, by which the simulation answers, once the robot has
 *  published it; null: no answer is awaited. */
const sent = signal<{ text: string; command: number | null } | null>(null);
let patience: ReturnType<typeof setTimeout> | undefined;
/** ms after which a missing answer is shown: a new start takes some time. */
const PATIENCE = 10_000;

/** As many changes are taken back. */
const MOST = 100;

/** Text of the world that what is drawn was begun in. */
let begun = "";
/** The boxes that were drawn in that world before: their walls are among its walls. */
let standing: readonly Item[] = [];

/** Begins to draw in the world that runs, or goes on with what was drawn in it. */
export function edit(): void {
  const here = scene.value;
  if (!here) return;
  if (scenario.value === null || begun !== here.world) {
    begun = here.world;
    const drawn = read(here.world, here.routes.map(({ name }) => name));
    [scenario.value, unreadable.value] = "unreadable" in drawn ? [null, drawn.unreadable] : [drawn, null];
    standing = items();
    history.value = [];
  }
  chosen.value = null;
  tool.value = "move";
  begin("edit");
}

const items = (): readonly Item[] => scenario.value?.items ?? [];
const now = (): Pick<Scenario, "items" | "route"> => ({ items: items(), route: scenario.value?.route ?? "" });

type Walls = ReadonlyArray<readonly [number, number, number, number]>;
/** Result of {@link wallsBelow}, and from what it was made: it is needed in each frame. */
let below: [Walls, readonly Item[], Walls] = [[], [], []];

/** The walls that are drawn below what is edited: boxes are drawn where they are now. */
export function wallsBelow(walls: Walls): Walls {
  if (mode.value !== "edit") return walls;
  if (below[0] !== walls || below[1] !== standing) below = [walls, standing, withoutBoxes(walls, standing)];
  return below[2];
}

/** Shows other items; what is there now can be had back. */
function change(next: readonly Item[]): void {
  if (!scenario.value) return;
  history.value = [...history.value, now()].slice(-MOST);
  scenario.value = { ...scenario.value, items: next };
}

export function undo(): void {
  const last = history.value.at(-1);
  if (!last || !scenario.value) return;
  abandon();
  history.value = history.value.slice(0, -1);
  scenario.value = { ...scenario.value, ...last };
  chosen.value = null;
}

/** Whether the chosen one may be removed: a robot begins somewhere. */
export const removable = (): boolean => chosen.value !== null && items()[chosen.value]?.kind !== "start";

export function remove(): void {
  if (!removable()) return;
  const gone = chosen.value;
  chosen.value = null;
  change(items().filter((_, n) => n !== gone));
}

export function turn(by: number): void {
  const which = chosen.value;
  if (which !== null) change(items().map((item, n) => (n === which ? turned(item, by) : item)));
}

export function rename(route: string): void {
  if (!scenario.value) return;
  // The letters of one name are one change.
  if (history.value.at(-1)?.items !== items()) history.value = [...history.value, now()].slice(-MOST);
  scenario.value = { ...scenario.value, route };
}

// ---- hands

/** What a press does until it is let go: from where, what was there before, what moves. */
let drag: { from: Point; before: readonly Item[]; item: number; point: number; drawn: boolean } | null = null;

/** A press at a place; `reach`: m that a finger may miss by. False: there is nothing, the map is moved. */
export function press(at: Point, reach: number): boolean {
  const all = items();
  if (!scenario.value) return false;
  const kind = tool.value;
  if (kind === "move") {
    const found = hit(all, at, reach);
    chosen.value = found?.item ?? null;
    if (found) drag = { from: at, before: all, ...found, drawn: false };
    return found !== null;
  }
  const start = all.findIndex((item) => item.kind === "start");
  if (kind === "start" && start < 0) return false;
  const item = kind === "start" ? start : all.length;
  drag = { from: at, before: all, item, point: 0, drawn: true };
  chosen.value = item;
  pull(at);
  return true;
}

/** The finger is at a place. */
export function pull(at: Point): void {
  if (!drag || !scenario.value) return;
  const { from, before: all, item, point, drawn } = drag;
  const now = all[item];
  let next: Item;
  if (!drawn && now) next = moved(now, point, [at[0] - from[0], at[1] - from[1]]);
  else if (tool.value === "box") next = boxBetween(from, at);
  else if (tool.value === "walker") next = walkerBetween(from, at);
  else if (tool.value === "waypoint") next = { kind: "waypoint", x: at[0], y: at[1] };
  else if (now?.kind === "start") next = { ...now, x: from[0], y: from[1], theta: Math.hypot(at[0] - from[0], at[1] - from[1]) > 0.3 ? Math.atan2(at[1] - from[1], at[0] - from[0]) : now.theta };
  else return;
  scenario.value = { ...scenario.value, items: item < all.length ? all.map((each, n) => (n === item ? next : each)) : [...all, next] };
}

/** The finger has gone: what it did can be taken back. */
export function drop(): void {
  if (!drag) return;
  const { before: all } = drag;
  drag = null;
  const is = (list: readonly Item[]): string => JSON.stringify(list);
  if (is(all) !== is(items())) history.value = [...history.value, { ...now(), items: all }].slice(-MOST);
}

/** A second finger came, or Escape: what the press did is not done. */
export function abandon(): void {
  if (!drag || !scenario.value) return;
  scenario.value = { ...scenario.value, items: drag.before };
  chosen.value = null;
  drag = null;
}

/** Keys while the editor is shown; whether it was one of them. */
export function key(event: Pick<KeyboardEvent, "key" | "ctrlKey" | "metaKey" | "altKey">): boolean {
  if (mode.value !== "edit" || event.altKey) return false;
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z") undo();
  else if (event.ctrlKey || event.metaKey) return false;
  else if (event.key === "Delete" || event.key === "Backspace") remove();
  else if (event.key !== "Escape") return false;
  else if (drag) abandon();
  else if (chosen.value !== null) chosen.value = null;
  else if (tool.value !== "move") tool.value = "move";
  else begin("look");
  return true;
}

// ---- what it is drawn for

/** The simulation begins anew in what is drawn; its answer shows whether it does. */
export async function run(): Promise<void> {
  if (!scenario.value || !fresh(system.value?.run)) return;
  forget();
  refused.value = "";
  const mine = (sent.value = { text: write(scenario.value), command: null });
  patience = setTimeout(() => (unanswered.value = true), PATIENCE);
  const reply = await ordered({ type: "scenario", text: mine.text });
  if (sent.value !== mine) return;
  // The answer of the simulation may have come before.
  if (reply.type === "done") sent.value = { ...mine, command: reply.timestamp };
  else forget();
}

/** No answer is awaited any more. */
function forget(): void {
  clearTimeout(patience);
  sent.value = null;
  unanswered.value = false;
}

effect(() => {
  const state = fresh(system.value?.run);
  // The last answer may be to a command of another sender.
  if (sent.value === null || !state || state.command !== sent.value.command) return;
  const { text } = sent.value;
  forget();
  refused.value = state.refusal ? sentence(state.refusal) : "";
  if (state.refusal) toast(refused.value, "bad");
  else {
    // What runs now is what was sent: it is gone on with, and what was changed since then is kept.
    begun = text;
    const drawn = read(text);
    standing = "unreadable" in drawn ? [] : drawn.items;
    toast(t("The simulation runs the scenario."), "good");
  }
});

/** Name of the downloaded file. */
export const FILE = "scenario.toml";

export function download(): void {
  if (!scenario.value) return;
  const url = URL.createObjectURL(new Blob([write(scenario.value)], { type: "application/toml" }));
  const link = Object.assign(document.createElement("a"), { href: url, download: FILE });
  link.click();
  // The browser reads it after the click.
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}
