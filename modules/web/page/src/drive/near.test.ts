import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { Sounding } from "../panels/sensors/readings";
import { level, nearest, ring } from "./near";

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
