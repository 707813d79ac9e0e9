// The guard's fields on the map, and their strokes. Pure.
import type { DataGuard } from "../protocol";
import type { Point } from "./camera";

/** Place of the robot on the map. */
export interface Pose {
  x: number;
  y: number;
  theta: number;
}

/** A point of the robot's frame on the map. */
export function from({ x, y, theta }: Pose, dx: number, dy: number): Point {
  const [c, s] = [Math.cos(theta), Math.sin(theta)];
  return [x + c * dx - s * dy, y + s * dx + c * dy];
}

/** What is in a protective field stops the robot; what is in a warning field slows it. */
export interface ShownField {
  kind: "protective" | "warning";
  /** Something sensed or unknown is in it. */
  occupied: boolean;
  corners: Point[];
}

const KINDS = ["protective", "warning"] as const;

/** The warning fields first: they are below the protective ones. */
export function fieldsOn(pose: Pose, guard: DataGuard): ShownField[] {
  const all = guard.fields.flatMap(({ kind, occupied, x, y }): ShownField[] => {
    const name = KINDS[kind];
    const corners = x.flatMap((dx, n): Point[] => {
      const dy = y[n];
      return dx === null || typeof dy !== "number" ? [] : [from(pose, dx, dy)];
    });
    return name === undefined || corners.length < 3 ? [] : [{ kind: name, occupied, corners }];
  });
  return all.sort((a, b) => b.kind.localeCompare(a.kind));
}

/** Lines that rise to the right at this distance from each other, over the box around these points; for a field that is
 *  occupied, so that it is known without its colour. */
export function hatch(points: readonly Point[], apart: number): [Point, Point][] {
  const [xs, ys] = [points.map(([x]) => x), points.map(([, y]) => y)];
  const [left, right, top, bottom] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const high = bottom - top;
  const step = apart * Math.SQRT2;
  const lines: [Point, Point][] = [];
  // From a multiple of the step on, so that the lines stand still while the field grows.
  for (let x = Math.ceil((left + top) / step) * step - top; x - high <= right && lines.length < 500; x += step) {
    lines.push([[x - high, bottom], [x, top]]);
  }
  return lines;
}
