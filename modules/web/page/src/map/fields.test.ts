import { deepEqual, equal, ok } from "node:assert/strict";
import { test } from "node:test";
import type { DataGuard, Field } from "../protocol";
import { fieldsOn, hatch } from "./fields";

const SQUARE = { x: [1, 2, 2, 1], y: [-1, -1, 1, 1] };
const field = (kind: number, of: Partial<Field> = {}): Field => ({ kind, occupied: false, ...SQUARE, ...of });
const guard = (...fields: Field[]): DataGuard => ({ timestamp: 0, forward: 0.3, backward: 0.3, left: 0, right: 0, turn_left: 0, turn_right: 0, code: 0, subject: "", fields });

test("fields are turned and moved with the robot, the warning field below the protective one", () => {
  const shown = fieldsOn({ x: 10, y: 5, theta: Math.PI / 2 }, guard(field(0, { occupied: true }), field(1)));
  deepEqual(shown.map(({ kind, occupied }) => [kind, occupied]), [["warning", false], ["protective", true]]);
  const rounded = shown[1]?.corners.map(([x, y]) => [Math.round(x * 1e6) / 1e6, Math.round(y * 1e6) / 1e6]);
  // A metre ahead is a metre up, its right side is east.
  deepEqual(rounded, [[11, 6], [11, 7], [9, 7], [9, 6]]);
});

test("what is no polygon, or of no known kind, is not drawn", () => {
  const pose = { x: 0, y: 0, theta: 0 };
  equal(fieldsOn(pose, guard(field(7), field(-1), field(0, { x: [1, 2], y: [0, 0] }))).length, 0);
  equal(fieldsOn(pose, guard(field(0, { x: [1, null, null, 1] }))).length, 0);
  equal(fieldsOn(pose, guard(field(0, { y: [1, 2] }))).length, 0);
  equal(fieldsOn(pose, guard()).length, 0);
});

test("a hatch covers the box around a field, stands still while the field grows, and is bounded", () => {
  const lines = hatch([[0, 0], [30, 0], [30, 20]], 10);
  ok(lines.length >= 3 && lines.length <= 5, String(lines.length));
  for (const [[x1, y1], [x2, y2]] of lines) {
    deepEqual([y1, y2], [20, 0]);
    equal(x2 - x1, 20, "they rise to the right");
  }
  const [first, second] = lines.map(([[x]]) => x);
  ok(Math.abs((second ?? 0) - (first ?? 0) - 10 * Math.SQRT2) < 1e-9);
  // On the sum of both coordinates they are multiples of the step, wherever the box begins.
  const sums = (all: ReturnType<typeof hatch>) => all.map(([[x, y]]) => Math.round(((x + y) / (10 * Math.SQRT2)) * 1e6) / 1e6);
  for (const sum of [...sums(lines), ...sums(hatch([[-7, 3], [44, 3], [44, 21]], 10))]) equal(sum, Math.round(sum));
  equal(hatch([[0, 0], [1e9, 1], [0, 1]], 1).length, 500);
});
