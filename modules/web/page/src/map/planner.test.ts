import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { DataMode } from "../protocol";
import { meant, MODES, modeWhyNot, modeWords, parameterName, stepOf, usable, valueWords } from "./planner";

const MODE: DataMode = { timestamp: 0, mode: 3, state: 2, text: "waits for people", has_home: false };

test("a mode is told with what the robot does in it, but for that in which the goal says it", () => {
  equal(modeWords(MODE), "Mode: Approach, waits for people.");
  equal(modeWords({ ...MODE, mode: 4, text: "" }), "Mode: Home.");
  equal(modeWords({ ...MODE, mode: 9 }), "Mode: not known, waits for people.");
  equal(modeWords({ ...MODE, mode: 1, text: "there is no goal" }), "");
  equal(modeWords(null), "");
});

test("home needs a home place", () => {
  deepEqual(MODES.map((_, number) => modeWhyNot(number, MODE) === null), [true, true, true, true, false]);
  equal(modeWhyNot(4, { has_home: true }), null);
});

test("parameters have names, units and steps, those of a newer robot their own name", () => {
  deepEqual(["speed_mps", "people_margin_m", "newer_m"].map(parameterName), ["Speed limit", "Distance from people on the way", "newer_m"]);
  deepEqual([valueWords("speed_mps", 0.5), valueWords("margin_m", 0.15), valueWords("patience_s", 1.5)], ["0.50 m/s", "0.15 m", "1.5 s"]);
  deepEqual([stepOf("speed_mps"), stepOf("patience_s")], [0.01, 0.5]);
});

test("a slider reaches both ends of the range exactly", () => {
  const speed = { name: "speed_mps", value: 0.5, minimum: 0.05, maximum: 0.505, configured: 0.505 };
  deepEqual([0, 0.052, 0.3, 0.5, 0.6].map((slid) => meant(speed, slid)), [0.05, 0.05, 0.3, 0.505, 0.505]);
});

test("what is no number is not offered", () => {
  const good = { name: "a", value: 1, minimum: 0, maximum: 2, configured: 1 };
  deepEqual(usable([good, { ...good, value: null }, { ...good, maximum: null }, { ...good, minimum: 3 }]), [good]);
});
