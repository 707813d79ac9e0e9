import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { RunEvent } from "../protocol";
import { clock, momentLink, momentOf, nextTrouble } from "./moments";

test("moments are written as players write them", () => {
  deepEqual([0, 59.9, 62, 3661, -1].map(clock), ["0:00", "0:59", "1:02", "1:01:01", "0:00"]);
});

test("a moment in the address is a number of seconds, or none", () => {
  deepEqual(["312", "0", "1.5", "", "-1", "x", "Infinity", null].map(momentOf), [312, 0, 1.5, null, null, null, null, null]);
  equal(momentLink("a&b", 312.7, "#/map"), "/?demo=a%26b&at=312#/map");
});

test("the next trouble is not the one that is being shown", () => {
  const event = (at: number, kind: RunEvent["kind"]): RunEvent => ({ at, kind, words: "" });
  const events = [event(5, "mark"), event(10, "error"), event(20, "warning"), event(30, "stop")];
  equal(nextTrouble(events, 0)?.at, 10);
  // Two seconds before it, where a jump leads.
  equal(nextTrouble(events, 8)?.at, 30);
  equal(nextTrouble(events, 29), null);
});
