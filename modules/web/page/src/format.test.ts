import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import { bytes, deg, num, span } from "./format";

test("a number has its unit, no minus zero, and a dash where there is none", () => {
  equal(num(1.234, 2, "m/s"), "1.23 m/s");
  equal(num(-0.001, 2), "0.00");
  equal(num(-1.5, 1), "−1.5");
  equal(num(null, 1, "V"), "–");
  equal(num(Number.NaN), "–");
  equal(deg(Math.PI / 2), "90°");
});

test("a time span is written in its two greatest units", () => {
  const spans = [0.04, 0.25, 3.21, 59.4, 125, 3600, 12_000, 180_000].map(span);
  deepEqual(spans, ["0 s", "0.3 s", "3.2 s", "59 s", "2 min 5 s", "1 h", "3 h 20 min", "2 d 2 h"]);
});

test("a size keeps three figures", () => {
  deepEqual([0, 999, 1234, 99_960, 1_500_000].map(bytes), ["0 B", "999 B", "1.2 kB", "100 kB", "1.5 MB"]);
});
