// The map in words, for who does not see it and for who wants figures.
import { deg, num } from "../format";
import type { DrivePart, Goal } from "../protocol";

export const QUALITIES = ["lost", "searching", "coarse", "fine"] as const;

export function positionWords(part: DrivePart | null): string {
  const estimate = part?.estimate.value;
  if (!part || !estimate) return "Where the robot is has not been said yet.";
  const quality = QUALITIES[estimate.quality] ?? "unknown";
  if (estimate.quality === 0) return "The robot does not know where it is.";
  const sure = part.ellipse ? `, sure to ${num(part.ellipse.long, 2, "m")} and ${deg(part.ellipse.heading)}` : "";
  return `At ${num(estimate.x, 2)}, ${num(estimate.y, 2, "m")}, heading ${deg(estimate.theta)}; ${quality}${sure}.`;
}

export function goalWords(goal: Goal | null | undefined): string {
  if (!goal) return "Nothing is known of a goal.";
  const to = `waypoint ${goal.waypoint + 1}`;
  const left = goal.remaining === null ? "" : `, ${num(goal.remaining, 1, "m")} to go`;
  const why = goal.message ? `: ${goal.message}` : "";
  switch (goal.status) {
    case 0:
      return `No goal${why}.`;
    case 1:
      return `Drives to ${to}${left}${why}.`;
    case 2:
      return "The goal is reached.";
    case 3:
      return `Blocked on the way to ${to}${left}${why}.`;
    case 4:
      return `The goal failed${why}.`;
    case 5:
      return `The goal was cancelled${why}.`;
    default:
      return "The state of the goal is not known.";
  }
}
