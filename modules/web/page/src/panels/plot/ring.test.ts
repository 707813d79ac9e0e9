import { deepEqual, equal, ok } from "node:assert/strict";
import { test } from "node:test";
import { align, csv, Ring, thin } from "./ring";

test("the oldest sample makes room for the newest", () => {
  const ring = new Ring(3);
  equal(ring.newest(), null);
  for (const n of [1, 2, 3, 4, 5]) ring.push(n, 10 * n);
  deepEqual(ring.from(0), { at: [3, 4, 5], values: [30, 40, 50] });
  deepEqual(ring.from(4.5), { at: [5], values: [50] });
  equal(ring.length, 3);
  equal(ring.newest(), 50);
});

test("at an instant the sample before it holds", () => {
  const ring = new Ring(3);
  for (const n of [1, 2, 3, 4]) ring.push(n, n === 3 ? null : 10 * n);
  deepEqual([1.9, 2, 2.9, 3.5, 4, 99].map((instant) => ring.at(instant)), [null, 20, 20, null, 40, 40]);
});

test("a null is a gap", () => {
  const ring = new Ring(4);
  ring.push(1, 1);
  ring.push(2, null);
  ring.push(3, 3);
  deepEqual(ring.from(0).values, [1, null, 3]);
});

test("what is not newer is left out; a scale that began anew drops what was", () => {
  const ring = new Ring(4);
  for (const at of [100, 100, 99.5, NaN, 101]) ring.push(at, at);
  deepEqual(ring.from(0).at, [100, 101]);
  ring.push(2, 7);
  deepEqual(ring.from(0), { at: [2], values: [7] });
});

test("series share a scale, and one that has no sample there leaves it out", () => {
  const columns = align([
    { at: [1, 3], values: [10, null] },
    { at: [1, 2], values: [5, 6] },
  ]);
  deepEqual(columns, [
    [1, 2, 3],
    [10, undefined, null],
    [5, 6, undefined],
  ]);
  deepEqual(align([]), [[]]);
});

test("thinned, a course keeps its peaks and its gaps", () => {
  const at = Array.from({ length: 1000 }, (_, n) => n);
  const values: (number | null)[] = at.map(() => 0);
  values[123] = 9;
  values[654] = -9;
  values[800] = null;
  const few = thin({ at, values }, 100);
  ok(few.at.length <= 150, String(few.at.length));
  ok(few.values.includes(9) && few.values.includes(-9) && few.values.includes(null));
  deepEqual(few.at, [...few.at].sort((a, b) => a - b));
  deepEqual(thin({ at: [1, 2], values: [1, 2] }, 100), { at: [1, 2], values: [1, 2] });
});

test("a plot is written as comma-separated values, with nothing where a series has no sample", () => {
  const text = csv(["A x", 'B "y", z'], [{ at: [1, 2], values: [0.5, null] }, { at: [2], values: [7] }]);
  equal(text, 's,A x,"B ""y"", z"\n1.000000,0.5,\n2.000000,,7\n');
});
