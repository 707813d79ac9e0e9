// What of the map's frame a plan shows, m.
import type { ScenePart } from "../../protocol";

export interface Frame {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** Around all that there is, with a margin; null where nothing is. */
export function frame(scene: Pick<ScenePart, "walls" | "columns" | "beacons">): Frame | null {
  const xs = [...scene.walls.flatMap(([x1, , x2]) => [x1, x2]), ...scene.columns.flatMap(([x, , r]) => [x - r, x + r]), ...scene.beacons.map(({ x }) => x)];
  const ys = [...scene.walls.flatMap(([, y1, , y2]) => [y1, y2]), ...scene.columns.flatMap(([, y, r]) => [y - r, y + r]), ...scene.beacons.map(({ y }) => y)];
  if (xs.length === 0) return null;
  const least = (values: number[]) => values.reduce((a, b) => Math.min(a, b), Infinity);
  const most = (values: number[]) => values.reduce((a, b) => Math.max(a, b), -Infinity);
  const [left, right, bottom, top] = [least(xs), most(xs), least(ys), most(ys)];
  const margin = 0.03 * Math.max(right - left, top - bottom, 1);
  return { x: left - margin, y: bottom - margin, width: right - left + 2 * margin, height: top - bottom + 2 * margin };
}
