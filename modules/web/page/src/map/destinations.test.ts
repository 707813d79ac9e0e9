import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { DataGoal } from "../protocol";
import { progress, waypoints, what } from "./destinations";

const LOOP = { name: "patrol", points: [[1, 2], [3, 4], [1, 2]] as [number, number][] };

test("a loop has each waypoint once, and a route of one waypoint is a place", () => {
  deepEqual(waypoints(LOOP), { points: [[1, 2], [3, 4]], looped: true });
  equal(what(LOOP), "route of 2 waypoints, repeated");
  equal(what({ name: "tour", points: [[1, 2], [3, 4]] }), "route of 2 waypoints");
  equal(what({ name: "start", points: [[3, -6.04]] }), "place at 3.0, −6.0 m");
});

test("progress is counted from 1, and only on the way", () => {
  const goal: DataGoal = { timestamp: 0, id: 1, waypoint: 2, status: 1, remaining: 4, message: "" };
  deepEqual(progress(goal, 12), { at: 3, of: 12 });
  deepEqual(progress({ ...goal, status: 3 }, 2), { at: 2, of: 2 });
  for (const status of [0, 2, 4, 5]) equal(progress({ ...goal, status }, 12), null);
  deepEqual([progress(goal, 0), progress(null, 3)], [null, null]);
});
