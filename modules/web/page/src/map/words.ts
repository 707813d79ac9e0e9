// The map in words, for who does not see it and for who wants figures.
import { deg, num } from "../format";
import type { DataGoal, DrivePart } from "../protocol";

export const QUALITIES = ["lost", "searching", "coarse", "fine"] as const;

/** Semi-major axis of two standard deviations, m, from which a position that is searched means nothing. */
const NOWHERE = 50;

/** The estimate is no place: the robot is lost, or anywhere. */
export function isLost(part: DrivePart | null): boolean {
  const quality = part?.estimate.value?.quality ?? 0;
  return quality === 0 || (quality === 1 && (part?.ellipse?.long ?? Infinity) > NOWHERE);
}

/** The robot is on its way to it, or held on the way. */
export const isActive = (goal: DataGoal): boolean => [1, 3].includes(goal.status);

export function positionWords(part: DrivePart | null): string {
  const estimate = part?.estimate.value;
  if (!part || !estimate) return "The position of the robot is not known yet.";
  const quality = QUALITIES[estimate.quality] ?? "unknown";
  if (isLost(part)) return "The robot does not know where it is.";
  const sure = part.ellipse ? `, ±${num(part.ellipse.long, 2, "m")} and ±${deg(part.ellipse.heading, 1)}` : "";
  return `At ${num(estimate.x, 2)}, ${num(estimate.y, 2, "m")}, heading ${deg(estimate.theta)}; ${quality}${sure}.`;
}

/** Length of a line through these places, and the direction of its last piece. */
export function measureWords(all: readonly { x: number; y: number }[]): string {
  const pieces = all.slice(1).map(({ x, y }, n) => ({ dx: x - (all[n]?.x ?? x), dy: y - (all[n]?.y ?? y) }));
  const last = pieces.at(-1);
  if (!last) return all.length === 0 ? "Tap the map where to begin." : "Tap the next place.";
  const length = pieces.reduce((sum, { dx, dy }) => sum + Math.hypot(dx, dy), 0);
  const of = pieces.length > 1 ? ` over ${pieces.length} pieces, the last of ${num(Math.hypot(last.dx, last.dy), 2, "m")}` : "";
  return `${num(length, 2, "m")}${of}, to ${deg(Math.atan2(last.dy, last.dx))}.`;
}

/** What the guard permits, and what is in its fields; empty for a robot without a guard. */
export function guardWords(part: DrivePart | null): string {
  const bound = part?.bound;
  if (!part || !bound) return "";
  const occupied = (part.guard.value?.fields ?? []).filter((field) => field.occupied).map(({ kind }) => (kind === 0 ? "protective" : "warning"));
  const fields = occupied.length === 0 ? "" : ` Something is in the ${occupied.join(" and the ")} field.`;
  return `${bound.words[0]?.toUpperCase()}${bound.words.slice(1)}.${fields}`;
}

/** The planner's own words where it has some, except that it waits because an operator stopped the robot. */
export function goalWords(goal: DataGoal | null | undefined, stopped = false): string {
  if (goal && stopped && isActive(goal)) return "Waits: an operator stopped the robot.";
  if (!goal) return "No data of the planner yet.";
  const left = goal.remaining === null || !isActive(goal) ? "" : `, ${num(goal.remaining, 1, "m")} to go`;
  if (goal.message) return `${goal.message[0]?.toUpperCase()}${goal.message.slice(1)}${left}.`;
  const to = `waypoint ${goal.waypoint + 1}`;
  const words = ["No goal", `Drives to ${to}`, "The goal is reached", `Blocked on the way to ${to}`, "The goal failed", "The goal was cancelled"];
  return `${words[goal.status] ?? "The state of the goal is not known"}${left}.`;
}
