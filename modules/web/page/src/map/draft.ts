// What is being placed on the map by hand, before it is said: a goal, a way of several, or the robot's own position.
import { effect, signal } from "@preact/signals";
import { order } from "../operate";
import { drive } from "../state";
import { follow, type Follows } from "./follow";

export type Mode = "look" | "go" | "route" | "pose";

export interface Place {
  x: number;
  y: number;
  /** rad; null: whichever way it comes. */
  theta: number | null;
}

export const mode = signal<Mode>("look");
export const places = signal<Place[]>([]);
export const loop = signal(false);
/** What was sent last, shown while it is the goal of the robot. */
export const sent = signal<Place[]>([]);

let follows: Follows = "over";
let before: number | null = null;
effect(() => {
  const goal = drive.value?.goal.value ?? null;
  if (sent.peek().length === 0) return;
  follows = follow(follows, before, goal, performance.now() / 1000);
  if (follows === "over") sent.value = [];
});

/** As many as a way may have. */
const MOST = 32;

export function begin(next: Mode): void {
  mode.value = next;
  places.value = [];
}

/** A new place: the next of a way, else the one there is. A position needs a heading: the one it has had. */
export function put(x: number, y: number, heading: number): void {
  const place: Place = { x, y, theta: mode.value === "pose" ? heading : null };
  places.value = mode.value === "route" ? [...places.value, place].slice(0, MOST) : [place];
}

/** Turns the last place towards a point. */
export function turn(x: number, y: number): void {
  const last = places.value.at(-1);
  if (last) change({ theta: Math.atan2(y - last.y, x - last.x) });
}

export function change(part: Partial<Place>): void {
  const last = places.value.at(-1);
  if (last) places.value = [...places.value.slice(0, -1), { ...last, ...part }];
}

export function undo(): void {
  places.value = places.value.slice(0, -1);
}

/** Says it. */
export async function confirm(): Promise<void> {
  const all = places.value;
  const last = all.at(-1);
  if (!last) return;
  const posing = mode.value === "pose";
  before = drive.value?.goal.value?.id ?? null;
  const well = posing
    ? await order({ type: "pose", x: last.x, y: last.y, theta: last.theta ?? 0 }, "The pose is sent to the robot.")
    : await order({ type: "goal", waypoints: all.map(({ x, y, theta }) => (theta === null ? { x, y } : { x, y, theta })), loop: loop.value && all.length > 1 }, "The goal is sent to the robot.");
  if (!well) return;
  if (!posing) {
    follows = { since: performance.now() / 1000 };
    sent.value = all;
  }
  begin("look");
}
