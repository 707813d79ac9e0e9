import { deepEqual, ok } from "node:assert/strict";
import { test } from "node:test";
import { barLength, type Camera, fitted, panned, type Point, toMap, toScreen, zoomed } from "./camera";

const SIZE = { width: 400, height: 300 };
const CAMERA: Camera = { x: 3, y: -2, scale: 50 };
const near = (a: Point, b: Point) => ok(Math.hypot(a[0] - b[0], a[1] - b[1]) < 1e-9, `${a} is not ${b}`);

test("the map's y grows upwards", () => {
  deepEqual(toScreen(CAMERA, SIZE, [3, -2]), [200, 150]);
  deepEqual(toScreen(CAMERA, SIZE, [4, -1]), [250, 100]);
});

test("there and back is the same place", () => near(toMap(CAMERA, SIZE, toScreen(CAMERA, SIZE, [1.5, 7])), [1.5, 7]));

test("what is under the pointer stays there, nearer and moved", () => {
  const at: Point = [320, 40];
  const before = toMap(CAMERA, SIZE, at);
  near(toMap(zoomed(CAMERA, SIZE, 1.7, at), SIZE, at), before);
  near(toMap(panned(CAMERA, at, [10, 90]), SIZE, [10, 90]), before);
});

test("nearer and farther have ends", () => {
  ok(zoomed(CAMERA, SIZE, 1e6, [0, 0]).scale <= 400 && zoomed(CAMERA, SIZE, 1e-6, [0, 0]).scale >= 4);
});

test("all that there is fits in sight", () => {
  const camera = fitted([[0, 0], [20, 12]], SIZE, 20);
  for (const corner of [[0, 0], [20, 12]] as Point[]) {
    const [x, y] = toScreen(camera, SIZE, corner);
    ok(x >= 19.9 && x <= 380.1 && y >= 19.9 && y <= 280.1);
  }
  const free = fitted([[0, 0], [20, 12]], SIZE, 20, 48, 40);
  for (const corner of [[0, 0], [20, 12]] as Point[]) {
    const [x, y] = toScreen(free, SIZE, corner);
    ok(x >= 19.9 && x <= 332.1 && y >= 19.9 && y <= 240.1, "what is at the right and at the bottom covers nothing");
  }
  ok(Number.isFinite(fitted([], SIZE, 20).scale));
});

test("the scale bar is neither short nor long", () => {
  for (const scale of [5, 20, 73, 390]) ok(barLength(scale) * scale >= 60 && barLength(scale) * scale <= 250);
});
