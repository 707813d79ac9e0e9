import { deepEqual, equal, ok } from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { barred, isHeld, leading, leads, pausedByWords, standing, waitsForHand } from "./holds";
import { HOLD } from "./numbers";
import type { DrivePart, HoldRow } from "./protocol";

/** A row with this number; its words are never read. */
export function row(code: number, of: Partial<HoldRow> = {}): HoldRow {
  return { module: "driver_canbus", code, name: "", subject: "", who: "", words: `words ${code}`, remedy: `do ${code}`, latched: false, since: 0, ...of };
}

test("numbers are those of docs/holds.md", () => {
  const rows = [...readFileSync("../../../docs/holds.md", "utf8").matchAll(/^\| (\d+) \| (\w+) \|/gm)];
  const numbers = new Map(rows.map(([, number, name]) => [name, Number(number)]));
  ok(numbers.size > 50, String(numbers.size));
  for (const [name, number] of Object.entries(HOLD)) equal(numbers.get(name), number, name);
});

test("the first row of each module leads", () => {
  const rows = [row(111), row(406), row(502, { module: "planner" }), row(406, { module: "planner" })];
  deepEqual(leading(rows).map(({ code }) => code), [111, 502]);
  deepEqual([leads(rows, 502), leads(rows, 406), leads([], 406)], [true, false, false]);
});

test("who engages PAUSE is named as people name it", () => {
  const part = (holds: HoldRow[], source: string) => ({ holds, stop: { value: { engaged: true, source } } }) as unknown as DrivePart;
  equal(pausedByWords(part([row(218), row(HOLD.PauseBumper, { who: "bumper 3" })], "bumper3")), "bumper 3");
  equal(pausedByWords(part([], "somewhere else")), "somewhere else");
  equal(pausedByWords(part([], "")), "somebody");
  equal(pausedByWords(null), "somebody");
});

test("an operator's stop is seen by its number, whatever else stands", () => {
  const held = row(HOLD.ModulePaused, { subject: "driver_canbus" });
  deepEqual([isHeld([row(111), held]), isHeld([row(HOLD.ModulePaused, { subject: "planner" })]), isHeld([])], [true, false, false]);
  equal(isHeld([row(0)]), null, "a recording from before the numbers");
  deepEqual(standing([row(401), row(601), row(405)]).map(({ code }) => code), [405]);
});

test("a hand ends what is latched, but for the planner's cause", () => {
  const [fault, planner, other] = [row(213), row(HOLD.PlannerLatched, { latched: true }), row(HOLD.PauseLatched, { latched: true })];
  deepEqual([[fault], [fault, planner], [fault, planner, other]].map((rows) => waitsForHand(rows)), [false, false, true]);
});

test("a fault bars the pad although the hand on it must let go first, or the line is latched", () => {
  const [lost, hand, pause] = [row(HOLD.DriveLost, { subject: "left" }), row(HOLD.NotReleased, { latched: true }), row(HOLD.PauseLatched, { latched: true })];
  deepEqual([[lost], [lost, hand], [lost, pause], [hand], [pause], []].map((rows) => barred(rows)?.code ?? null), [213, 213, 213, null, null, null]);
  equal(barred([row(HOLD.RangingLost, { module: "planner" })]), null, "what only the planner minds");
  deepEqual([[lost, hand], [hand]].map((rows) => waitsForHand(rows)), [false, false]);
});
