// What is being placed on the map by hand, before it is said: a goal, a way of several, or the robot's own position.
import { effect, signal } from "@preact/signals";
import { order, sentence } from "../operate";
import type { Route } from "../protocol";
import { drive, system } from "../state";
import { toast } from "../ui/news";
import { t } from "../words";
import { waypoints } from "./destinations";
import { follow, type Follows, refusal } from "./follow";

/** `measure` commands nothing; `edit` draws a scenario: editor.ts. */
export type Mode = "look" | "go" | "route" | "pose" | "measure" | "edit";

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
/** Its name; empty for places that were placed by hand. */
export const sentAs = signal("");
/** The planner has it: what is reported of a goal is about what was sent. */
export const taken = signal(false);

let follows: Follows = "over";
let before: number | null = null;
effect(() => {
  const goal = drive.value?.goal.value ?? null;
  if (sent.peek().length === 0) {
    taken.value = false;
    return;
  }
  follows = follow(follows, before, goal, performance.now() / 1000);
  if (follows === "over") sent.value = [];
  taken.value = typeof follows === "object" && "id" in follows;
});

/** ms after a goal was sent in which a refusal is the answer to it. */
const ANSWERED = 15_000;
/** When it was sent, ms of the page, and the time of the latest refusal before it, of the robot. */
let asked = { at: -Infinity, after: 0 };
effect(() => {
  const latest = refusal(system.value?.reports ?? []);
  if (latest === null || latest.timestamp <= asked.after || performance.now() - asked.at > ANSWERED) return;
  asked = { at: -Infinity, after: latest.timestamp };
  follows = "over";
  sent.value = [];
  toast(sentence(latest.message), "bad");
});

/** What the planner has and has refused, before it is sent another goal. */
function note(): void {
  before = drive.value?.goal.value?.id ?? null;
  asked = { at: performance.now(), after: refusal(system.value?.reports ?? [])?.timestamp ?? 0 };
}

/** As many as a way may have. */
const MOST = 32;

export function begin(next: Mode): void {
  mode.value = next;
  places.value = [];
}

/** A new place: the next of a way or of a measured line, else the one there is. A position needs a heading: the one it has had. */
export function put(x: number, y: number, heading: number): void {
  const place: Place = { x, y, theta: mode.value === "pose" ? heading : null };
  places.value = mode.value === "route" || mode.value === "measure" ? [...places.value, place].slice(0, MOST) : [place];
}

/** Turns the last place towards a point. */
export function turn(x: number, y: number): void {
  if (mode.value === "measure") return;
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
  if (!posing) note();
  const well = posing
    ? await order({ type: "pose", x: last.x, y: last.y, theta: last.theta ?? 0 }, t("The pose is sent to the robot."))
    : await order({ type: "goal", waypoints: all.map(({ x, y, theta }) => (theta === null ? { x, y } : { x, y, theta })), loop: loop.value && all.length > 1 }, t("The goal is sent to the robot."));
  if (!well) return;
  if (!posing) show(all, "");
  begin("look");
}

/** Sends the robot to a named destination. */
export async function goRoute(route: Route): Promise<void> {
  note();
  if (!(await order({ type: "route", name: route.name }, t("The robot is commanded to drive to {name}.", { name: route.name })))) return;
  show(waypoints(route).points.map(([x, y]) => ({ x, y, theta: null })), route.name);
}

/** Shows what was sent as long as it is the goal of the robot. */
function show(all: Place[], name: string): void {
  follows = { since: performance.now() / 1000 };
  taken.value = false;
  sentAs.value = name;
  sent.value = all;
}
