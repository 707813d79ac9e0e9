import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { Concern, DataEstimate, DataPower, HoldRow } from "../protocol";
import { battery, position, second, worse } from "./health";

const concern = (words: string, weight: Concern["weight"] = "warning"): Concern => ({ weight, words });

test("the colour is that of the worst", () => {
  equal(worse("good", "warn"), "warn");
  equal(worse("bad", "warn"), "bad");
  equal(worse("info", "good"), "info");
});

test("what is not well is the second word, with how many more there are", () => {
  equal(second([], "x"), null);
  deepEqual(second([concern("a board is lost", "error"), concern("position lost")], ""), { tone: "bad", words: "a board is lost", more: 1 });
  deepEqual(second([concern("same"), concern("position lost")], "same"), { tone: "warn", words: "position lost", more: 0 });
});

test("what bars the motion comes before what follows from it", () => {
  const lost = { words: "the left drive is lost", who: "left drive" } as HoldRow;
  const follows = [concern("silent: the estimate does not know how the robot moves", "error"), concern("left drive (node 1) is silent", "error"), concern("position lost")];
  deepEqual(second(follows, "left drive (node 1) cannot be started", lost), { tone: "bad", words: "the left drive is lost", more: 2 });
  deepEqual(second(follows, "", { ...lost, who: "" }), { tone: "bad", words: "the left drive is lost", more: 3 });
});

test("a lost position is never a good one", () => {
  const at = (quality: number) => position({ quality } as DataEstimate, { long: 0.11, short: 0.1, angle: 0, heading: 0 });
  deepEqual([0, 1, 2, 3].map((quality) => at(quality).tone), ["warn", "warn", "info", "good"]);
  deepEqual([0, 1, 3].map((quality) => at(quality).text), ["lost", "searching", "±0.11 m"]);
  equal(position(null, null).text, "not known");
});

test("the battery has its charge, and how long it lasts in hours", () => {
  const of = (charge: number | null, remaining: number | null) => battery({ charge, remaining } as DataPower);
  deepEqual(of(0.71, 22440), { tone: "good", text: "71\u202F%", title: "Battery 71\u202F%, 6 h 14 min left", more: "6 h 14 min" });
  deepEqual([0.1, 0.2].map((charge) => of(charge, null).tone), ["bad", "warn"]);
  equal(of(null, null).text, "not known");
  equal(of(0.71, null).more, undefined);
});
