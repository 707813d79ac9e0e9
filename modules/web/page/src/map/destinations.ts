// The named destinations of the world, and how far the robot is on its way to one. Pure.
import { num } from "../format";
import type { DataGoal, Route } from "../protocol";
import { t } from "../words";
import { isActive } from "./words";

/** The waypoints of a route without the first again at the end of a loop, and whether it is one. */
export function waypoints({ points }: Route): { points: [number, number][]; looped: boolean } {
  const [first, last] = [points[0], points.at(-1)];
  const looped = points.length > 1 && first !== undefined && last !== undefined && first[0] === last[0] && first[1] === last[1];
  return { points: looped ? points.slice(0, -1) : points, looped };
}

/** A route of one waypoint is a place. */
export function what(route: Route): string {
  const { points, looped } = waypoints(route);
  const [only] = points;
  if (points.length === 1 && only) return t("place at {x}, {y}", { x: num(only[0], 1), y: num(only[1], 1, "m") });
  return looped ? t("route of {n} waypoints, repeated", { n: points.length }) : t("route of {n} waypoints", { n: points.length });
}

/** Which waypoint of how many, from 1; null: the robot is not on its way, or the number is not known. */
export function progress(goal: DataGoal | null | undefined, of: number): { at: number; of: number } | null {
  if (!goal || !isActive(goal) || of < 1) return null;
  return { at: Math.min(goal.waypoint + 1, of), of };
}
