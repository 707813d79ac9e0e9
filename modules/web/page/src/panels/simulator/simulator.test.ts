import { deepEqual, equal, ok } from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { drift } from "./drift";
import { ending, fault, listed, put } from "./faults";
import { frame } from "./plan";
import { inWords, offered, SPEEDS } from "./speeds";

const POSE = { timestamp: 0, speed: 0, steering: 0, clearance: 1, collisions: 0 };
const ESTIMATE = { timestamp: 0, speed: 0, rotation: 0, covariance: [], quality: 3 };

test("the difference is told along and across the robot, and turns the short way", () => {
  const off = drift({ ...POSE, x: 1, y: 1, theta: Math.PI / 2 }, { ...ESTIMATE, x: 0.7, y: 1.4, theta: -Math.PI + 0.1 });
  ok(off);
  if (!off) return;
  ok(Math.abs(off.distance - 0.5) < 1e-12 && Math.abs(off.ahead - 0.4) < 1e-12 && Math.abs(off.left - 0.3) < 1e-12);
  ok(Math.abs(off.heading - (Math.PI / 2 + 0.1)) < 1e-12);
  equal(drift({ ...POSE, x: 1, y: null, theta: 0 }, { ...ESTIMATE, x: 0, y: 0, theta: 0 }), null);
  equal(drift({ ...POSE, x: 1, y: 0, theta: 0 }, { ...ESTIMATE, x: null, y: 0, theta: 0 }), null);
});

test("every fault that the simulator knows is explained", () => {
  const source = readFileSync("../../simulator/src/faults.rs", "utf8");
  const names = [...source.matchAll(/^ {12}"(\w+)" =>/gm)].map(([, name]) => name as string);
  ok(names.length > 35, String(names.length));
  for (const name of names) if (name !== "none") ok(fault("a board", name).means !== "", name);
  for (const name of ["plug", "unplug", "hold", "release", "speed", "steering", "sideways"]) ok(fault("gamepad", name).means !== "", name);
});

test("what it does not know takes any value, and no name of the language's own is known", () => {
  for (const name of ["on fire", "constructor", "__proto__"]) equal(fault("a board", name).means, "");
});

test("a usual value is one of those that are offered", () => {
  for (const name of ["slow", "garbled", "hidden", "bumper", "battery", "stall", "hot", "fault", "noise", "loss", "reorder", "speed"]) {
    const value = fault("a", name).value;
    ok(value && value.usual >= value.low && value.usual <= value.high, name);
  }
});

test("a fault ends by none, what is done with a gamepad by its opposite", () => {
  deepEqual(ending("sd1_front", "silent"), { fault: "none", value: 0 });
  deepEqual(ending("gamepad", "hold"), { fault: "release", value: 0 });
  deepEqual(ending("gamepad", "plug"), { fault: "unplug", value: 0 });
  deepEqual(ending("gamepad", "speed"), { fault: "speed", value: 0 });
  deepEqual(listed(["silent", "none", "put:X,Y,THETA", "put"]), ["silent"]);
  equal(put(3, -4.5, Math.PI / 2), "put:3.000,-4.500,1.5708");
});

test("a plan shows all that there is, and is none where nothing is", () => {
  const plan = frame({ walls: [[0, 0, 10, 0]], columns: [[5, 5, 1]], beacons: [{ id: 1, x: -2, y: 3 }] });
  ok(plan && plan.x < -2 && plan.y < 0 && plan.x + plan.width > 10 && plan.y + plan.height > 6);
  equal(frame({ walls: [], columns: [], beacons: [] }), null);
});

test("a speed set elsewhere is among those offered", () => {
  deepEqual(offered(20), [...SPEEDS]);
  deepEqual(offered(3.5).slice(0, 2), [3.5, 0.05]);
  deepEqual(offered(null), [...SPEEDS]);
  deepEqual([0, 0.2, null].map(inWords), ["as fast as possible", "0.2 ×", "not known"]);
});
