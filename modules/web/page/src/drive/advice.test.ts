import { deepEqual, equal, ok } from "node:assert/strict";
import { test } from "node:test";
import { HOLD } from "../numbers";
import type { DrivePart, HoldRow } from "../protocol";
import { advice } from "./advice";

/** A robot for which these numbers stand, with words that are never read. */
function part(of: { word?: string; homed?: boolean; stop?: string; holds?: [number, Partial<HoldRow>?][]; reason?: string }): DrivePart {
  const shown = (value: object) => ({ age: 0, period: null, freshness: "fresh", value });
  const row = ([code, more]: [number, Partial<HoldRow>?]) => ({ module: "driver_canbus", code, name: "", subject: "", who: "", words: "reworded", remedy: "", latched: false, since: 0, ...more });
  return {
    status: { word: of.word ?? "ready", reason: of.reason ?? "reworded" },
    motion: shown({ reason: of.reason ?? "reworded", homed: of.homed ?? true }),
    holds: (of.holds ?? []).map(row),
    stop: shown({ engaged: of.stop !== undefined, source: of.stop ?? "" }),
    goal: shown({ message: "reworded" }),
  } as unknown as DrivePart;
}

test("each cause that needs a hand has its advice, whatever its words", () => {
  const bumper = advice(part({ word: "paused", stop: "bumper1", holds: [[HOLD.PauseBumper, { who: "bumper 1", remedy: "Clear what touches bumper 1." }]] }), false);
  equal(bumper?.title, "PAUSE: bumper 1 stops the robot");
  equal(bumper?.steps[0], "Clear what touches bumper 1.");
  equal(advice(part({ word: "stopped", holds: [[HOLD.ModulePaused]] }), true)?.offer, null);
  equal(advice(part({ word: "waiting", holds: [[HOLD.PlannerLatched]] }), false)?.offer, "resume");
  equal(advice(part({ word: "waiting", holds: [[HOLD.NobodyCommands], [HOLD.PlannerLatched, { module: "planner" }]] }), false)?.offer, "resume");
  ok(advice(part({ word: "waiting", holds: [[HOLD.NotReleased]] }), false)?.steps[0]?.startsWith("Let go"));
  equal(advice(part({ word: "fault", holds: [[301]] }), false)?.offer, "modules");
  equal(advice(part({ word: "stopped", holds: [[221]], homed: false }), false)?.offer, "home");
  equal(advice(part({ word: "stopped", holds: [[HOLD.Homing]], homed: false }), false)?.offer, null);
  equal(advice(part({ word: "stopped", holds: [[HOLD.Centering]], homed: false }), false)?.offer, null);
});

test("who has control is not told to take it", () => {
  const steps = (yours: boolean) => advice(part({ word: "stopped", holds: [[HOLD.ModulePaused]] }), true, yours)?.steps;
  deepEqual(steps(false), ["Take control, if nobody has it.", "Slide “Resume”, where Stop was."]);
  deepEqual(steps(true), ["Slide “Resume”, where Stop was."]);
});

test("a cause that no hand ends is the title, with what to check", () => {
  const lost = advice(part({ word: "fault", reason: "left drive (node 1) cannot be started", holds: [[HOLD.DriveLost, { subject: "left", words: "the left drive is lost" }], [HOLD.NotReleased]] }), false);
  deepEqual([lost?.title, lost?.steps[0], lost?.offer], ["The left drive is lost", "left drive (node 1) cannot be started", "modules"]);
  for (const what of [/supply/, /cable/, /node id/]) ok(what.test(lost?.steps[1] ?? ""), String(what));
  const stopping = advice(part({ word: "stopped", reason: "the robot is stopping: the left drive is lost", holds: [[HOLD.DriveLost]] }), false);
  ok(stopping?.steps[0]?.includes("supply"));
  const resumed = advice(part({ word: "fault", holds: [[HOLD.DriveFault, { words: "the left drive is in fault", remedy: "Check the errors." }], [HOLD.PlannerLatched, { module: "planner" }]] }), false);
  deepEqual([resumed?.title, resumed?.steps, resumed?.offer], ["The left drive is in fault", ["Check the errors."], "modules"]);
});

test("what comes after a weightier cause is not advised yet", () => {
  equal(advice(part({ word: "stopped", holds: [[213, { subject: "steering" }], [HOLD.PlannerLatched]] }), false)?.offer, "modules");
});

test("a recording from before the numbers shows its text", () => {
  const old = part({ word: "stopped", holds: [[0]], reason: "planner must be let go by an operator first" });
  equal(advice(old, false)?.steps[0], "planner must be let go by an operator first");
  equal(advice(part({ word: "paused", stop: "bumper1" }), false)?.title, "PAUSE: bumper1 stops the robot");
});

test("where there is nothing to be done there is no advice", () => {
  equal(advice(part({ word: "driving" }), false), null);
  equal(advice(part({ word: "ready", holds: [[HOLD.NobodyCommands]] }), false), null);
});
