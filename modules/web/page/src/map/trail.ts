// Where the robot has been, as it believed itself.
import { effect, signal } from "@preact/signals";
import { drive, stale } from "../state";
import type { Point } from "./camera";

/** m between two points of it; how many are kept; a greater step is a jump: the trail begins anew. */
const STEP = 0.08;
const MOST = 1500;
const JUMP = 1.0;

export const trail = signal<Point[]>([]);

effect(() => {
  const estimate = drive.value?.estimate;
  const { x, y, quality } = estimate?.value ?? { x: null, y: null, quality: 0 };
  if (!estimate || stale(estimate) || x === null || y === null || quality < 2) return;
  const old = trail.peek();
  const last = old.at(-1);
  const step = last ? Math.hypot(x - last[0], y - last[1]) : Infinity;
  if (step < STEP) return;
  trail.value = step > JUMP ? [[x, y]] : [...old.slice(-MOST), [x, y]];
});
