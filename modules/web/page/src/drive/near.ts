// What is near while driving: the range finders by direction, judged by the guard's fields. Pure; robot frame, m, rad.
import type { DataGuard, Scan } from "../protocol";
import { near as byDistance } from "../panels/sensors/near";
import { type Side, side } from "../panels/sensors/geometry";
import type { Sounding } from "../panels/sensors/readings";

/** `close`: within the distance that the robot needs to stop; `near`: within that in which it is slowed. */
export type Level = "free" | "unknown" | "near" | "close";

/** From harmless to grave: not known is graver than free. */
const ORDER: Level[] = ["free", "unknown", "near", "close"];

/** Directions of the ring. */
export const SECTORS = 12;

type Fields = DataGuard["fields"];
/** Corners of the robot. */
type Outline = readonly (readonly [number, number])[];

/** Whether a point is within a field, by the number of its edges that are crossed on the way to the left. */
function within(x: number, y: number, field: Fields[number]): boolean {
  let inside = false;
  const count = field.x.length;
  for (let n = 0, last = count - 1; n < count; last = n++) {
    const [ax, ay, bx, by] = [field.x[n], field.y[n], field.x[last], field.y[last]];
    if (typeof ax !== "number" || typeof ay !== "number" || typeof bx !== "number" || typeof by !== "number") continue;
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
  }
  return inside;
}

/** One reading; without fields (a robot without a guard) by its distance alone. */
export function level({ known, distance, x, y, theta }: Sounding, fields: Fields | null): Level {
  if (known === "unknown") return "unknown";
  if (known === "silent" || distance === null) return "free";
  if (fields === null) return ({ close: "close", near: "near", far: "free" } as const)[byDistance(distance)];
  const [px, py] = [x + distance * Math.cos(theta), y + distance * Math.sin(theta)];
  const isIn = (kind: number) => fields.some((field) => field.kind === kind && within(px, py, field));
  return isIn(0) ? "close" : isIn(1) ? "near" : "free";
}

/** m from a point to the robot's outline; 0 within it. */
function apart(x: number, y: number, outline: Outline): number {
  let [nearest, inside] = [Infinity, false];
  outline.forEach(([ax, ay], n) => {
    const [bx, by] = outline[(n + 1) % outline.length] ?? [ax, ay];
    const [dx, dy] = [bx - ax, by - ay];
    const part = Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1), 0), 1);
    nearest = Math.min(nearest, Math.hypot(x - ax - part * dx, y - ay - part * dy));
    if (ay > y !== by > y && x < (dx * (y - ay)) / dy + ax) inside = !inside;
  });
  return inside ? 0 : nearest;
}

/** What the beams of a lidar have met, from the robot's outline on; nothing is known while it is silent, or reports a
 *  fault. */
export function beams(scan: Scan, known: boolean, outline: Outline): Sounding[] {
  const step = (2 * Math.PI) / SECTORS;
  if (!known) return Array.from({ length: SECTORS }, (_, n) => ({ id: 0, x: 0, y: 0, theta: n * step, beam: step, known: "unknown", distance: null, age: null }));
  return scan.x.flatMap((x, k): Sounding[] => {
    const y = scan.y[k] ?? NaN;
    const [theta, distance] = [Math.atan2(y, x), apart(x, y, outline)];
    if (!Number.isFinite(theta) || !Number.isFinite(distance)) return [];
    return [{ id: 0, x: x - distance * Math.cos(theta), y: y - distance * Math.sin(theta), theta, beam: 0, known: "measured", distance, age: null }];
  });
}

/** The gravest level of each direction, the first one ahead, counter-clockwise; null where nothing looks. */
export function ring(rows: readonly Sounding[], fields: Fields | null): (Level | null)[] {
  const all = Array<Level | null>(SECTORS).fill(null);
  for (const row of rows) {
    if (!Number.isFinite(row.theta)) continue;
    const is = level(row, fields);
    const half = Math.max(row.beam / 2, Math.PI / SECTORS) - 0.01;
    for (let n = 0; n < SECTORS; n += 1) {
      const off = (2 * Math.PI * n) / SECTORS - row.theta;
      if (Math.abs(Math.atan2(Math.sin(off), Math.cos(off))) > half) continue;
      const before = all[n] ?? null;
      if (before === null || ORDER.indexOf(is) > ORDER.indexOf(before)) all[n] = is;
    }
  }
  return all;
}

export interface Nearest {
  level: Level;
  distance: number;
  side: Side;
}

/** The nearest that was measured; null: nothing. */
export function nearest(rows: readonly Sounding[], fields: Fields | null): Nearest | null {
  let found: Sounding | null = null;
  for (const row of rows) {
    if (row.distance !== null && (found?.distance == null || row.distance < found.distance)) found = row;
  }
  return found?.distance == null ? null : { level: level(found, fields), distance: found.distance, side: side(found.theta) };
}
