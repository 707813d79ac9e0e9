// Whether a goal that was sent from here is still the robot's. Pure.
import type { DataGoal, Report } from "../protocol";

/** Whether the goal that was sent is the robot's; `waiting`: the planner does not have it yet. */
export type Follows = { since: number } | { id: number } | "over";

/** s within which the planner takes a goal. */
const TAKEN = 3;

/** Number of the fault by which the planner says that it refuses a goal (docs/faults.md). */
export const GOAL_REFUSED = 0x0811;

/** The latest report that a goal was refused; null: there is none. `reports`: the latest first. */
export function refusal<R extends Pick<Report, "number">>(reports: readonly R[]): R | null {
  return reports.find(({ number }) => number === GOAL_REFUSED) ?? null;
}

/** How it goes on by what the planner reports: it takes the goal, and later ends it, or is given another one. `at` in s. */
export function follow(was: Follows, before: number | null, goal: Pick<DataGoal, "id" | "status"> | null, at: number): Follows {
  const active = goal !== null && (goal.status === 1 || goal.status === 3);
  if (was === "over") return was;
  if ("id" in was) return active && goal.id === was.id ? was : "over";
  if (active && goal.id !== before) return { id: goal.id };
  return at - was.since < TAKEN ? was : "over";
}
