// How far the estimate is from the truth.
import type { DataEstimate, DataTruth } from "../../protocol";

export interface Drift {
  /** m */
  distance: number;
  /** Along the robot's true heading, and to its left, m. */
  ahead: number;
  left: number;
  /** rad, −π to π. */
  heading: number;
}

/** Null where either is not known. */
export function drift(truth: DataTruth, estimate: DataEstimate): Drift | null {
  const { x, y, theta } = truth;
  if (x === null || y === null || theta === null) return null;
  if (estimate.x === null || estimate.y === null || estimate.theta === null) return null;
  const [dx, dy] = [estimate.x - x, estimate.y - y];
  const turn = estimate.theta - theta;
  return {
    distance: Math.hypot(dx, dy),
    ahead: dx * Math.cos(theta) + dy * Math.sin(theta),
    left: -dx * Math.sin(theta) + dy * Math.cos(theta),
    heading: Math.atan2(Math.sin(turn), Math.cos(turn)),
  };
}
