import { equal, ok } from "node:assert/strict";
import { test } from "node:test";
import type { DrivePart } from "../protocol";
import { advice, stopSource } from "./advice";

/** A robot of which this is said. */
function part(of: { word?: string; reason?: string; homed?: boolean; stop?: string; goal?: string }): DrivePart {
  const shown = (value: object) => ({ age: 0, period: null, freshness: "fresh", value });
  return {
    status: { word: of.word ?? "ready", reason: of.reason ?? "" },
    motion: shown({ reason: of.reason ?? "", homed: of.homed ?? true }),
    stop: shown({ engaged: of.stop !== undefined, source: of.stop ?? "" }),
    goal: shown({ message: of.goal ?? "" }),
  } as unknown as DrivePart;
}

test("who stops the robot is named as people name it", () => {
  equal(stopSource("bumper3"), "bumper 3");
  equal(stopSource("button"), "the red button");
  equal(stopSource("somewhere else"), "somewhere else");
});

test("each reason that driver_canbus and planner give has its advice", () => {
  ok(advice(part({ word: "paused", stop: "bumper1" }), false)?.title.includes("bumper 1"));
  equal(advice(part({ word: "stopped", reason: "driver_canbus is in PAUSE" }), true)?.offer, null);
  equal(advice(part({ word: "waiting", reason: "planner must be let go by an operator first" }), false)?.offer, "resume");
  equal(advice(part({ word: "waiting", goal: "waits for an operator: a goal given anew, or planner RUN by hand" }), false)?.offer, "resume");
  ok(advice(part({ word: "waiting", reason: "web:Anna must send zero first: the robot was stopped" }), false)?.steps[0]?.startsWith("Let go"));
  equal(advice(part({ word: "fault", reason: "planner is down" }), false)?.offer, "modules");
  equal(advice(part({ word: "stopped", reason: "the steering is not homed", homed: false }), false)?.offer, "home");
  equal(advice(part({ word: "stopped", reason: "the steering is being homed", homed: false }), false)?.offer, null);
});

test("where there is nothing to be done there is no advice", () => {
  equal(advice(part({ word: "driving" }), false), null);
  equal(advice(part({ word: "ready", reason: "nobody commands the motion" }), false), null);
});
