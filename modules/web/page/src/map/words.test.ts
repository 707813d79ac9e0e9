import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { DataGoal, DrivePart } from "../protocol";
import { boundWords, goalWords, guardWords, measureWords, positionWords, standsWhy } from "./words";

const GOAL: DataGoal = { timestamp: 0, id: 1, waypoint: 3, status: 1, remaining: 2.04, message: "" };

test("a goal is told in the planner's words, else in ours", () => {
  equal(goalWords(GOAL), "Drives to waypoint 4, 2.0 m to go.");
  equal(goalWords({ ...GOAL, message: "drives to waypoint 4 of 12, for ever" }), "Drives to waypoint 4 of 12, for ever, 2.0 m to go.");
  equal(goalWords({ ...GOAL, status: 2 }), "The goal is reached.");
  equal(goalWords({ ...GOAL, status: 99, remaining: null }), "The state of the goal is not known.");
  equal(goalWords({ ...GOAL, status: 3, message: "driver_canbus is in PAUSE" }, true), "Waits: an operator stopped the robot.");
  equal(goalWords({ ...GOAL, status: 2 }, true), "The goal is reached.", "nothing waits");
  equal(goalWords(null), "No data of the planner yet.");
});

test("a robot that stands is not told to drive, and what is not known is nobody", () => {
  const row = (module: string, code: number, words: string) => ({ module, code, words, name: "", subject: "", who: "", remedy: "", latched: false, since: 0 });
  const part = (status: number, message: string, holds: object[], guard: number, word = "waiting", reason = message, forward = 0) =>
    ({ status: { word, reason }, goal: { value: { ...GOAL, status, message } }, holds, guard: { value: { code: guard, subject: "lidar top", forward, backward: 0.8 } } }) as unknown as DrivePart;
  const near = row("planner", 605, "somebody stands near");
  equal(standsWhy(part(3, "waits for whoever stands near", [near], 713)), "no data of lidar top");
  equal(standsWhy(part(3, "waits for whoever stands near", [near], 711)), "", "somebody does");
  const drives = "drives to waypoint 4 of 4";
  equal(standsWhy(part(1, drives, [], 713)), "no data of lidar top");
  equal(standsWhy(part(1, drives, [row("driver_canbus", 711, "something is near: lidar top")], 711)), "something is near: lidar top");
  equal(standsWhy(part(1, drives, [], 0)), "stands for a moment on the way to waypoint 4");
  equal(standsWhy(part(1, drives, [], 713, "waiting", drives, 0.3)), "stands for a moment on the way to waypoint 4", "what is unknown is not in the way");
  equal(standsWhy(part(1, drives, [], 711, "driving", "0.30 m/s; commanded by planner")), "", "it drives");
  equal(standsWhy(part(1, drives, [], 0, "waiting", "simulation paused")), "");
  equal(standsWhy(part(1, "looks for a way", [row("planner", 603, "")], 0)), "", "its own words are right");
  equal(standsWhy(null), "");
  equal(goalWords({ ...GOAL, status: 3, message: "waits for whoever stands near" }, false, "no data of lidar top"), "Waits: no data of lidar top, 2.0 m to go.");
});

test("a position is told with how sure it is, and not at all when the robot is lost", () => {
  const estimate = { timestamp: 0, x: 1.234, y: -2, theta: Math.PI / 2, speed: 0, rotation: 0, covariance: [], quality: 3 };
  const part = (quality: number) =>
    ({ estimate: { age: 0, period: 0.05, freshness: "fresh", value: { ...estimate, quality } }, ellipse: { long: 0.1, short: 0.05, angle: 0, heading: 0.02 } }) as unknown as DrivePart;
  equal(positionWords(part(3)), "At 1.23, −2.00 m, heading 90°; fine, ±0.10 m and ±1.1°.");
  equal(positionWords({ ...part(1), ellipse: { long: 2000, short: 2000, angle: 0, heading: 6 } }), "The robot does not know where it is.");
  equal(positionWords(part(0)), "The robot does not know where it is.");
  equal(positionWords(null), "The position of the robot is not known yet.");
});

test("a measured line is told with its length and where its end leads", () => {
  const all = [{ x: 1, y: 1 }, { x: 4, y: 5 }, { x: 4, y: 3 }];
  equal(measureWords([]), "Tap the map where to begin.");
  equal(measureWords(all.slice(0, 1)), "Tap the next place.");
  equal(measureWords(all.slice(0, 2)), "5.00 m, to 53°.");
  equal(measureWords(all), "7.00 m over 2 pieces, the last of 2.00 m, to −90°.");
});

test("what the guard permits is told with what is in its fields", () => {
  const part = (words: string | null, ...occupied: boolean[]) =>
    ({
      bound: words === null ? null : { words, speed: 0.32, limits: true, creeping: false },
      guard: { value: { fields: occupied.map((each, kind) => ({ kind, occupied: each })) } },
      motion: { value: { speed: 0, source: "" } },
      commands: [],
      velocity_commands: [],
    }) as unknown as DrivePart;
  equal(guardWords(part("at most 0.32 m/s forward: sonar 3", false, true)), "At most 0.32 m/s forward: sonar 3. Something is in the warning field.");
  equal(guardWords(part("must not move forward: sonar 3", true, true)), "Must not move forward: sonar 3. Something is in the protective and the warning field.");
  equal(guardWords(part("at most 0.66 m/s forward", false, false)), "At most 0.66 m/s forward.");
  equal(guardWords(part(null)), "", "a robot without a guard");
  equal(guardWords(null), "");
});

test("the bound is told of the way that is asked for, and of both where neither is free", () => {
  const part = (wish: number, forward: number | null, backward: number | null, speed = 0, more: object = {}) =>
    ({
      bound: { words: "must not move forward: lidar top", speed: 0, limits: true, creeping: false, ...more },
      guard: { value: { forward, backward } },
      motion: { value: { speed, source: "web:Jana" } },
      commands: [{ source: "planner", speed: 0.3 }, { source: "web:Jana", speed: wish }],
      velocity_commands: [],
    }) as unknown as DrivePart;
  const told = "must not move forward: lidar top";
  deepEqual(boundWords(part(0.3, 0, 0.8)), [told]);
  deepEqual(boundWords(part(0, 0, 0.8)), [told], "nobody asks");
  deepEqual(boundWords(part(-0.3, 0, 0.8)), ["at most 0.80 m/s backward"]);
  deepEqual(boundWords(part(-0.3, 0, 0)), ["must not move backward", told]);
  deepEqual(boundWords(part(-0.3, 0, null)), ["must not move backward", told], "what is no number permits nothing");
  deepEqual(boundWords(part(-0.3, 0, 0.8, -0.3)), [told], "the robot's words are of the way that it drives");
  deepEqual(boundWords(part(-0.3, 0, 0, 0, { creeping: true })), [told]);
  const velocity = { ...part(0.3, 0, 0.8), velocity_commands: [{ source: "web:Jana", vx: -0.2 }] } as unknown as DrivePart;
  deepEqual(boundWords(velocity), ["at most 0.80 m/s backward"]);
});
