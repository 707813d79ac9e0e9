// Where the map is looked at: a place in its middle, pixels a metre, and how far it is turned. Pure. The map's y grows
// upwards, the screen's down.
export interface Camera {
  x: number;
  y: number;
  scale: number;
  /** rad, counter-clockwise, by which the map is turned on the screen; 0: its x is to the right. */
  turn: number;
}
export interface Size {
  width: number;
  height: number;
}
export type Point = [number, number];

/** Pixels a metre. */
const LEAST = 4;
const MOST = 400;

export function toScreen(camera: Camera, size: Size, [x, y]: Point): Point {
  const [right, up] = turned([x - camera.x, y - camera.y], camera.turn);
  return [size.width / 2 + right * camera.scale, size.height / 2 - up * camera.scale];
}

export function toMap(camera: Camera, size: Size, [x, y]: Point): Point {
  const [dx, dy] = turned([(x - size.width / 2) / camera.scale, (size.height / 2 - y) / camera.scale], -camera.turn);
  return [camera.x + dx, camera.y + dy];
}

function turned([x, y]: Point, by: number): Point {
  const [cos, sin] = [Math.cos(by), Math.sin(by)];
  return [cos * x - sin * y, sin * x + cos * y];
}

/** The robot's heading upwards, `across` metres from left to right, and more of what is ahead of it than behind. */
export function behind(robot: { x: number; y: number; theta: number }, size: Size, across: number): Camera {
  const scale = Math.min(MOST, Math.max(LEAST, size.width / across));
  const ahead = (0.2 * size.height) / scale;
  return { x: robot.x + ahead * Math.cos(robot.theta), y: robot.y + ahead * Math.sin(robot.theta), scale, turn: Math.PI / 2 - robot.theta };
}

/** Nearer by `factor`; what is under `at` on the screen stays there. */
export function zoomed(camera: Camera, size: Size, factor: number, at: Point): Camera {
  const scale = Math.min(MOST, Math.max(LEAST, camera.scale * factor));
  const [x, y] = toMap(camera, size, at);
  const [nextX, nextY] = toMap({ ...camera, scale }, size, at);
  return { ...camera, x: camera.x + x - nextX, y: camera.y + y - nextY, scale };
}

/** Moved so that what was under `from` is under `to`. */
export function panned(camera: Camera, from: Point, to: Point): Camera {
  const [dx, dy] = turned([to[0] - from[0], from[1] - to[1]], -camera.turn);
  return { ...camera, x: camera.x - dx / camera.scale, y: camera.y - dy / camera.scale };
}

/** All points in sight, with `margin` pixels around, `side` more at the right and `below` more at the bottom. Without points: 10 m around the origin. */
export function fitted(points: Point[], size: Size, margin: number, side = 0, below = 0): Camera {
  let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const [x, y] of points) {
    left = Math.min(left, x);
    right = Math.max(right, x);
    low = Math.min(low, y);
    high = Math.max(high, y);
  }
  if (left > right) [left, right, low, high] = [-5, 5, -5, 5];
  const across = Math.max(1, size.width - 2 * margin - side) / Math.max(1, right - left);
  const up = Math.max(1, size.height - 2 * margin - below) / Math.max(1, high - low);
  const scale = Math.min(MOST, Math.max(LEAST, Math.min(across, up)));
  return { x: (left + right) / 2 + side / 2 / scale, y: (low + high) / 2 - below / 2 / scale, scale, turn: 0 };
}

/** A round length that is between 60 and 150 pixels: for the scale bar. */
export function barLength(scale: number): number {
  return [0.2, 0.5, 1, 2, 5, 10, 20].find((metres) => metres * scale >= 60) ?? 50;
}
