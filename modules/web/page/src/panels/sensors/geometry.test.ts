import { deepEqual, equal, ok } from "node:assert/strict";
import { test } from "node:test";
import { beam, front, onPicture, polygon, side, tilt } from "./geometry";
import { floor, near } from "./near";
import type { Known } from "./readings";

test("ahead is up, to the left is left", () => {
  deepEqual(onPicture(1, 0).map((value) => value + 0), [0, -1]);
  deepEqual(onPicture(0, 1).map((value) => value + 0), [-1, 0]);
  equal(polygon([[1, 0.5]]), "-0.500,-1.000");
});

test("a beam is a wedge whose front goes counter-clockwise from right to left", () => {
  equal(front({ x: 0, y: 0, theta: 0 }, 1, Math.PI), "M1.000 -0.000A1.000 1.000 0 0 0 -1.000 -0.000");
  equal(beam({ x: 1, y: 2, theta: Math.PI / 2 }, 1, 0), "M-2.000 -1.000L-3.000 -1.000A1.000 1.000 0 0 0 -3.000 -1.000Z");
});

test("a direction is a side, whichever way it was turned", () => {
  const sides = [0, 0.7854, 1.5708, 2.7053, 3.1415, -3.1415, -1.5708, -1.0472, 2 * Math.PI].map(side);
  deepEqual(sides, ["front", "front left", "left", "rear left", "rear", "rear", "right", "front right", "front"]);
});

test("the floor is where it should be, or it is none, or that is not known", () => {
  const range = (distance: number | null, known: Known = "measured") => ({ distance, known });
  deepEqual([0.08, 0.12, 0.2].map((distance) => floor(range(distance))), ["floor", "floor", "floor"]);
  deepEqual([range(0.079), range(0.21), range(null, "silent"), range(null, "unknown")].map(floor), ["hole", "hole", "hole", "unknown"]);
});

test("what is near is told from what is close", () => {
  deepEqual([0.49, 0.5, 0.99, 1].map(near), ["close", "near", "near", "far"]);
});

test("the tilt of a quaternion is its roll and pitch, whatever its heading", () => {
  const [roll, pitch, heading] = [0.1, -0.2, 2.5];
  const [sr, sp, sy] = [roll, pitch, heading].map((angle) => Math.sin(angle / 2)) as [number, number, number];
  const [cr, cp, cy] = [roll, pitch, heading].map((angle) => Math.cos(angle / 2)) as [number, number, number];
  const turned = tilt([sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy]);
  ok(turned && Math.abs(turned[0] - roll) < 1e-9 && Math.abs(turned[1] - pitch) < 1e-9, String(turned));
  equal(tilt([0, 0, null, 1]), null);
  equal(tilt([]), null);
});
