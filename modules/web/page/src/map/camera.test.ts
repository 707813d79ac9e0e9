import { deepEqual, ok } from "node:assert/strict";
import { test } from "node:test";
import { barLength, behind, type Camera, fitted, panned, type Point, toMap, toScreen, zoomed } from "./camera";

const SIZE = { width: 400, height: 300 };
const CAMERA: Camera = { x: 3, y: -2, scale: 50, turn: 0 };
const TURNED: Camera = { ...CAMERA, turn: 2.1 };
const near = (a: Point, b: Point) => ok(Math.hypot(a[0] - b[0], a[1] - b[1]) < 1e-9, `${a} is not ${b}`);

test("the map's y grows upwards", () => {
  deepEqual(toScreen(CAMERA, SIZE, [3, -2]), [200, 150]);
  deepEqual(toScreen(CAMERA, SIZE, [4, -1]), [250, 100]);
});

test("there and back is the same place", () => {
  for (const camera of [CAMERA, TURNED]) near(toMap(camera, SIZE, toScreen(camera, SIZE, [1.5, 7])), [1.5, 7]);
});

test("what is under the pointer stays there, nearer and moved", () => {
  const at: Point = [320, 40];
  for (const camera of [CAMERA, TURNED]) {
    const before = toMap(camera, SIZE, at);
    near(toMap(zoomed(camera, SIZE, 1.7, at), SIZE, at), before);
    near(toMap(panned(camera, at, [10, 90]), SIZE, [10, 90]), before);
  }
});

test("from behind, the robot is below the middle and its heading is up", () => {
  for (const theta of [0, 2.5, -1.2]) {
    const robot = { x: 4, y: 7, theta };
    const camera = behind(robot, SIZE, 8);
    near(toScreen(camera, SIZE, [4, 7]), [200, 210]);
    near(toScreen(camera, SIZE, [4 + Math.cos(theta), 7 + Math.sin(theta)]), [200, 160]);
    near(toScreen(camera, SIZE, [4 - Math.sin(theta), 7 + Math.cos(theta)]), [150, 210]);
  }
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
