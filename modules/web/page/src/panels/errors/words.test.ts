import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { Report } from "../../protocol";
import { about, beside, hasAll, level, of, standing } from "./words";

test("a fault stands, is over, or nobody knows; never over because nobody says so", () => {
  equal(standing({ standing: true, known: true }), "stands");
  equal(standing({ standing: true, known: false }), "unknown");
  deepEqual([true, false].map((known) => standing({ standing: false, known })), ["over", "over"]);
});

test("two boards are two faults", () => {
  equal(about({ number: 0x0102, subject: "sd1_rear" }), "0x0102 BoardLost, sd1_rear");
  equal(about({ number: 0x020a, subject: "" }), "0x020A WatchdogSilent");
});

test("texts have their level in words", () => {
  deepEqual([0, 1, 2, 3, 9].map((value) => level({ level: value })[1]), ["debug", "info", "warning", "error", "unknown (9)"]);
});

test("all words must be there, in any part", () => {
  equal(hasAll(["driver_rs485a", "SD1_front does not answer"], ["sd1_front", "rs485"]), true);
  equal(hasAll(["driver_rs485a"], ["sd1"]), false);
  equal(hasAll([], []), true);
});

test("a fault has its reports, and beside them what was reported of others at the time", () => {
  const report = (module: string, subject: string, timestamp: number, severity = 2): Report => ({ module, number: 1, subject, timestamp, severity, message: "", fatal: false, file: "", line: 0 });
  const group = { module: "m", number: 1, subject: "a", last: 10e6 };
  deepEqual(["a", "", "b"].map((subject) => of(group, report("m", subject, 0))), [true, true, false]);
  const found = beside(group, [report("m", "a", 10e6), report("n", "", 11.9e6), report("n", "", 12.1e6), report("n", "", 9e6, 0), report("m", "b", 8e6)]);
  deepEqual(found.map(({ module, subject }) => module + subject), ["n", "mb"]);
});
