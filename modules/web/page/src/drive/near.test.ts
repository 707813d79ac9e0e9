import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { Sounding } from "../panels/sensors/readings";
import { beams, level, nearest, ring } from "./near";

const row = (theta: number, known: Sounding["known"], distance: number | null = null): Sounding => ({ id: 0, x: 0.7 * Math.cos(theta), y: 0.3 * Math.sin(theta), theta, beam: 0.5, known, distance, age: null });
const box = (kind: number, front: number) => ({ kind, occupied: true, x: [-0.2, front, front, -0.2], y: [-0.5, -0.5, 0.5, 0.5] });
const fields = [box(0, 1.2), box(1, 2.5)];

test("near is what the robot needs to stop, not a fixed distance", () => {
  deepEqual([0.4, 1, 2].map((distance) => level(row(0, "measured", distance), fields)), ["close", "near", "free"]);
  deepEqual([0.4, 0.8, 2].map((distance) => level(row(0, "measured", distance), null)), ["close", "near", "free"]);
  // Beside the way nothing stops it.
  equal(level(row(Math.PI / 2, "measured", 0.4), fields), "free");
});

test("not known is neither free nor measured", () => {
  equal(level(row(0, "unknown"), fields), "unknown");
  equal(level(row(0, "silent"), fields), "free");
});

test("each direction has the gravest of what looks there, and nothing where nothing looks", () => {
  const shown = ring([row(0, "silent"), row(0.1, "unknown"), row(Math.PI, "measured", 0.1)], [box(0, 1)]);
  equal(shown[0], "unknown");
  equal(shown[3], null);
  equal(ring([row(0, "unknown"), row(0, "measured", 0.2)], fields)[0], "close");
});

test("the nearest has its distance and its side", () => {
  deepEqual(nearest([row(0, "measured", 1.4), row(Math.PI / 2, "measured", 0.6), row(1, "silent")], fields), { level: "free", distance: 0.6, side: "left" });
  equal(nearest([row(0, "silent")], fields), null);
});

test("of a lidar the nearest to the outline counts in each direction, and nothing is known while it is silent", () => {
  const outline: [number, number][] = [[0.35, 0.25], [-0.35, 0.25], [-0.35, -0.25], [0.35, -0.25]];
  const scan = { name: "top", status: 0, x: [0.6, 0.75, 3, 0, 0.1], y: [0, 0.05, 0, 0.55, 0.1] };
  const rows = beams(scan, true, outline);
  deepEqual(nearest(rows.filter(({ distance }) => distance !== 0), fields), { level: "close", distance: 0.25, side: "front" });
  equal(rows.find(({ theta }) => Math.abs(theta - Math.PI / 2) < 0.1)?.distance?.toFixed(2), "0.30");
  equal(rows.find(({ distance }) => distance === 0)?.known, "measured");
  deepEqual([ring(rows, fields)[0], ring(rows, fields)[3], ring(rows, fields)[6]], ["close", "free", null]);
  deepEqual(ring(beams(scan, false, outline), fields), Array(12).fill("unknown"));
});
