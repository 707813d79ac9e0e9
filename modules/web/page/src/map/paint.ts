// Draws the map on a canvas, from the signals as they are.
import { united, written } from "../format";
import { floor } from "../panels/sensors/near";
import { infrareds, sonars } from "../panels/sensors/readings";
import type { DrivePart, MapPart, ScenePart, SensorsPart } from "../protocol";
import { drive, fresh, map, scene, sensors, stale, system } from "../state";
import { type BeaconState, statesOf } from "./beacons";
import { barLength, type Camera, type Point, type Size, toScreen } from "./camera";
import { mode, type Place, places, sent } from "./draft";
import { chosen, scenario, wallsBelow } from "./editor";
import { isOn } from "./layers";
import { fieldsOn, from, hatch, type Pose } from "./fields";
import { corners } from "./scenario";
import { trail } from "./trail";
import { isLost } from "./words";

const INKS = ["floor", "out", "grid", "wall", "plan", "trail", "obstacle", "person", "scan", "sonar", "ir", "robot", "truth", "beacon", "goal", "protective", "warning"] as const;
export type Inks = Record<(typeof INKS)[number] | "ink" | "surface" | "muted", string>;

/** The colours of the theme that is shown. */
export function inks(): Inks {
  const style = getComputedStyle(document.documentElement);
  const of = (name: string): string => style.getPropertyValue(name).trim();
  const all = Object.fromEntries(INKS.map((ink) => [ink, of(`--map-${ink}`)]));
  return { ...all, ink: of("--ink"), surface: of("--surface"), muted: of("--muted") } as Inks;
}

interface Brush {
  on: CanvasRenderingContext2D;
  camera: Camera;
  size: Size;
  ink: Inks;
  at: (x: number, y: number) => Point;
}

export function paint(on: CanvasRenderingContext2D, camera: Camera, size: Size, ink: Inks): void {
  const at = (x: number, y: number): Point => toScreen(camera, size, [x, y]);
  const brush: Brush = { on, camera, size, ink, at };
  on.fillStyle = ink.floor;
  on.fillRect(0, 0, size.width, size.height);
  on.lineJoin = on.lineCap = "round";
  grid(brush);
  if (map.value && isOn("obstacles")) obstacles(brush, map.value);
  if (scene.value) walls(brush, scene.value);
  if (sensors.value && isOn("people")) people(brush, sensors.value);
  if (sensors.value && isOn("persons")) persons(brush, sensors.value);
  if (isOn("trail")) line(brush, trail.value, ink.trail, 2, [1, 5]);
  if (map.value && isOn("plan")) plan(brush, map.value);
  if (scene.value && isOn("beacons")) beacons(brush, scene.value, drive.value, sensors.value, statesOf(fresh(system.value?.beacon_use)));
  if (scene.value && drive.value) {
    if (isOn("fields")) fields(brush, drive.value);
    if (sensors.value && isOn("scan")) scans(brush, drive.value, sensors.value);
    if (sensors.value && isOn("sonar")) cones(brush, scene.value, drive.value, sensors.value);
    if (isOn("truth")) truth(brush, scene.value, drive.value);
    robot(brush, scene.value, drive.value);
    if (sensors.value && isOn("floor")) holes(brush, drive.value, sensors.value);
  }
  if (mode.value === "edit") drawn(brush);
  marks(brush);
  if (camera.turn === 0) figures(brush);
  bar(brush);
}

/** What was drawn in the scenario editor; the chosen one in the colour of goals. */
function drawn(brush: Brush): void {
  const { on, at, ink, camera } = brush;
  const all = scenario.value?.items ?? [];
  const way = all.flatMap((item): Point[] => (item.kind === "waypoint" ? [at(item.x, item.y)] : []));
  if (way.length > 1) {
    on.setLineDash([6, 4]);
    on.strokeStyle = ink.goal;
    on.lineWidth = 2;
    on.beginPath();
    stroke(on, way);
    on.stroke();
    on.setLineDash([]);
  }
  let waypoint = 0;
  for (const [n, item] of all.entries()) {
    const colour = n === chosen.value ? ink.goal : item.kind === "walker" ? ink.truth : item.kind === "box" ? ink.wall : ink.robot;
    on.strokeStyle = on.fillStyle = colour;
    on.lineWidth = n === chosen.value ? 4 : 3;
    on.beginPath();
    if (item.kind === "box") {
      stroke(on, corners(item).map(([x, y]) => at(x, y)));
      on.closePath();
      on.stroke();
    } else if (item.kind === "walker") {
      stroke(on, item.points.map(([x, y]) => at(x, y)));
      on.stroke();
      for (const [x, y] of item.points) disc(on, at(x, y), Math.max(5, 0.22 * camera.scale), colour);
    } else if (item.kind === "start") {
      const [length, side] = [0.6, 0.3];
      const local = ([a, b]: Point): Point => at(item.x + Math.cos(item.theta) * a - Math.sin(item.theta) * b, item.y + Math.sin(item.theta) * a + Math.cos(item.theta) * b);
      stroke(on, ([[length, 0], [-side, side], [-side, -side]] as Point[]).map(local));
      on.closePath();
      on.stroke();
    } else flag(brush, [item.x, item.y], n === chosen.value ? ink.goal : ink.robot, String((waypoint += 1)));
  }
}

/** px between two figures at an edge, at least. */
const APART = 56;

/** The coordinates of the grid, m, along the upper and the left edge. */
function figures({ on, camera, size, ink, at }: Brush): void {
  const step = [1, 2, 5, 10, 20].find((metres) => metres * camera.scale >= APART) ?? 50;
  on.font = "11px system-ui, sans-serif";
  on.textBaseline = "middle";
  on.fillStyle = ink.muted;
  on.textAlign = "center";
  const [right, up] = [size.width / camera.scale / 2, size.height / camera.scale / 2];
  for (let x = Math.ceil((camera.x - right) / step) * step; x <= camera.x + right; x += step) {
    const [sx] = at(x, 0);
    if (sx > 40) on.fillText(minus(x), sx, 8);
  }
  on.textAlign = "start";
  for (let y = Math.ceil((camera.y - up) / step) * step; y <= camera.y + up; y += step) {
    const [, sy] = at(0, y);
    // At the ends are the figures of the other edge and the scale bar.
    if (sy > 20 && sy < size.height - 36) on.fillText(minus(y), 4, sy);
  }
}

const minus = (figure: number): string => written(String(figure)).replace("-", "−");

function grid({ on, camera, size, ink, at }: Brush): void {
  const step = camera.scale >= 18 ? 1 : 5;
  // As far as the farthest corner, whichever way it is turned.
  const far = Math.hypot(size.width, size.height) / camera.scale / 2;
  const [left, low] = [camera.x - far, camera.y - far];
  on.strokeStyle = ink.grid;
  on.lineWidth = 1;
  on.beginPath();
  // Sharp where they are not turned.
  const pixel = ([x, y]: Point): Point => (camera.turn === 0 ? [Math.round(x) + 0.5, Math.round(y) + 0.5] : [x, y]);
  for (let x = Math.ceil(left / step) * step; x <= left + 2 * far; x += step) {
    on.moveTo(...pixel(at(x, low)));
    on.lineTo(...pixel(at(x, low + 2 * far)));
  }
  for (let y = Math.ceil(low / step) * step; y <= low + 2 * far; y += step) {
    on.moveTo(...pixel(at(left, y)));
    on.lineTo(...pixel(at(left + 2 * far, y)));
  }
  on.stroke();
}

function walls({ on, camera, ink, at }: Brush, scene: ScenePart): void {
  on.strokeStyle = on.fillStyle = ink.wall;
  on.lineWidth = Math.min(5, Math.max(2, 0.06 * camera.scale));
  on.beginPath();
  for (const [x1, y1, x2, y2] of wallsBelow(scene.walls)) {
    on.moveTo(...at(x1, y1));
    on.lineTo(...at(x2, y2));
  }
  on.stroke();
  for (const [x, y, radius] of scene.columns) disc(on, at(x, y), Math.max(2, radius * camera.scale));
}

function obstacles({ on, camera, ink, at }: Brush, part: MapPart): void {
  const cells = part.obstacles.value;
  if (!cells) return;
  const side = Math.max(2, (cells.size ?? 0) * camera.scale);
  on.fillStyle = ink.obstacle;
  on.globalAlpha = stale(part.obstacles) ? 0.25 : 0.75;
  cells.x.forEach((x, i) => {
    const y = cells.y[i];
    if (x === null || typeof y !== "number") return;
    const [sx, sy] = at(x, y);
    on.fillRect(sx - side / 2, sy - side / 2, side, side);
  });
  on.globalAlpha = 1;
}

/** Where people really are: only the simulation knows. */
function people({ on, camera, ink, at }: Brush, sensors: SensorsPart): void {
  const all = fresh(sensors.people);
  if (!all) return;
  on.lineWidth = 1.5;
  all.x.forEach((x, n) => {
    const [y, radius] = [all.y[n], all.radius[n]];
    if (x === null || typeof y !== "number" || typeof radius !== "number") return;
    on.globalAlpha = 0.45;
    disc(on, at(x, y), Math.max(3, radius * camera.scale), ink.truth);
    on.globalAlpha = 1;
    on.strokeStyle = ink.truth;
    on.stroke();
  });
}

/** Radius with which a tracked person is drawn, m: its width is not measured. */
const PERSON_M = 0.25;

/** People that the robot tracks: a ring with a dot, and a line to where each is in a second. */
function persons({ on, camera, ink, at }: Brush, sensors: SensorsPart): void {
  const all = fresh(sensors.persons);
  if (!all) return;
  on.strokeStyle = ink.person;
  on.lineWidth = 2;
  for (const { x, y, vx, vy } of all.persons) {
    if (x === null || y === null) continue;
    const place = at(x, y);
    const radius = Math.max(5, PERSON_M * camera.scale);
    on.globalAlpha = 0.25;
    disc(on, place, radius, ink.person);
    on.globalAlpha = 1;
    on.stroke();
    disc(on, place, 2.5, ink.person);
    if (vx === null || vy === null) continue;
    on.beginPath();
    on.moveTo(...place);
    on.lineTo(...at(x + vx, y + vy));
    on.stroke();
  }
}

function plan(brush: Brush, part: MapPart): void {
  const { x, y } = part.plan.value ?? { x: [], y: [] };
  const points = x.flatMap((px, i): Point[] => (px === null || typeof y[i] !== "number" ? [] : [[px, y[i]]]));
  if (points.length < 2) return;
  line(brush, points, brush.ink.plan, 3, stale(part.plan) ? [4, 8] : []);
  if (sent.value.length === 0 && mode.value === "look") flag(brush, points.at(-1) as Point, brush.ink.goal, "");
}

/** Those that are used or seen are filled and joined with the robot, refused ones crossed, others hollow. */
function beacons({ on, ink, at, camera }: Brush, scene: ScenePart, drive: DrivePart | null, sensors: SensorsPart | null, states: ReadonlyMap<number, BeaconState>): void {
  const seen = new Set(fresh(sensors?.beacons)?.beacons.map((beacon) => beacon.id));
  const robot = pose(drive);
  on.font = "600 11px system-ui, sans-serif";
  on.textBaseline = "middle";
  for (const { id, x, y } of scene.beacons) {
    const place = at(x, y);
    const state = states.get(id);
    // Until the estimator has said what it makes of it: whether the scanner sees it.
    const is = state ? state === "used" : seen.has(id);
    const color = state === "refused" ? ink.ir : state === "unselected" || state === "excluded" ? ink.muted : ink.beacon;
    if (is && robot) {
      on.strokeStyle = ink.beacon;
      on.globalAlpha = 0.35;
      on.lineWidth = 1;
      on.setLineDash([2, 6]);
      stroke(on, [at(robot.x, robot.y), place]);
      on.setLineDash([]);
      on.globalAlpha = 1;
    }
    const half = Math.min(9, Math.max(6, 0.12 * camera.scale));
    on.beginPath();
    on.moveTo(place[0], place[1] - half);
    on.lineTo(place[0] + half, place[1]);
    on.lineTo(place[0], place[1] + half);
    on.lineTo(place[0] - half, place[1]);
    on.closePath();
    on.fillStyle = is ? color : ink.floor;
    on.fill();
    on.strokeStyle = color;
    on.lineWidth = 2;
    on.setLineDash(state === "excluded" ? [3, 3] : []);
    on.stroke();
    on.setLineDash([]);
    // Not by its colour alone.
    if (state === "refused") {
      stroke(on, [[place[0] - half / 2, place[1] - half / 2], [place[0] + half / 2, place[1] + half / 2]]);
      stroke(on, [[place[0] - half / 2, place[1] + half / 2], [place[0] + half / 2, place[1] - half / 2]]);
    }
    on.fillStyle = ink.muted;
    on.fillText(String(id), place[0] + half + 4, place[1]);
  }
}

/** Where it believes itself to be; null also where it is lost: nothing is drawn at a place that means nothing. */
export function pose(drive: DrivePart | null): Pose | null {
  if (isLost(drive)) return null;
  const { x, y, theta } = drive?.estimate.value ?? {};
  return typeof x === "number" && typeof y === "number" && typeof theta === "number" ? { x, y, theta } : null;
}

/** Beams without an echo are drawn to here, m. */
const QUIET = 0.35;

/** What sonars measured; a dotted front where nothing is in range, a dashed red one where it is not known. */
function cones(brush: Brush, scene: ScenePart, drive: DrivePart, sensors: SensorsPart): void {
  const robot = pose(drive);
  if (!robot) return;
  const { on, ink, at, camera } = brush;
  const { shown, rows } = sonars(sensors, scene.sonar.field_of_view);
  const grey = stale(shown);
  on.lineWidth = 1.5;
  for (const { x, y, theta, beam, known, distance } of rows ?? []) {
    const [sx, sy] = at(...from(robot, x, y));
    const middle = -(robot.theta + theta + camera.turn);
    const radius = (distance ?? QUIET) * camera.scale;
    on.fillStyle = on.strokeStyle = grey ? ink.truth : known === "unknown" ? ink.ir : ink.sonar;
    if (known === "measured") {
      on.beginPath();
      on.moveTo(sx, sy);
      on.arc(sx, sy, radius, middle - beam / 2, middle + beam / 2);
      on.closePath();
      on.globalAlpha = grey ? 0.05 : 0.09;
      on.fill();
    }
    on.globalAlpha = grey ? 0.35 : 0.9;
    on.setLineDash(known === "measured" ? [] : known === "silent" ? [1, 4] : [5, 3]);
    on.beginPath();
    on.arc(sx, sy, radius, middle - beam / 2, middle + beam / 2);
    on.stroke();
  }
  on.setLineDash([]);
  on.globalAlpha = 1;
}

/** What the beams of lidars met, from where the robot is now. */
function scans({ on, ink, at }: Brush, drive: DrivePart, sensors: SensorsPart): void {
  const robot = pose(drive);
  if (!robot) return;
  on.fillStyle = ink.scan;
  for (const scan of sensors.scans) {
    if (!scan.value) continue;
    const { status, x, y } = scan.value;
    on.globalAlpha = stale(scan) || status !== 0 ? 0.3 : 0.95;
    for (let k = 0; k < x.length; k++) {
      const [sx, sy] = at(...from(robot, x[k] ?? 0, y[k] ?? 0));
      on.fillRect(sx - 1.5, sy - 1.5, 3, 3);
    }
  }
  on.globalAlpha = 1;
}

/** px between the lines over an occupied field. */
const HATCH = 9;

/** The guard's fields: the protective one with a solid outline, the warning one with a dashed one; hatched while something is in it. */
function fields({ on, ink, at }: Brush, drive: DrivePart): void {
  const robot = pose(drive);
  const guard = fresh(drive.guard);
  if (!robot || !guard) return;
  for (const { kind, occupied, corners } of fieldsOn(robot, guard)) {
    const points = corners.map((corner) => at(...corner));
    on.beginPath();
    for (const point of points) on.lineTo(...point);
    on.closePath();
    on.fillStyle = on.strokeStyle = ink[kind];
    on.globalAlpha = 0.1;
    on.fill();
    on.globalAlpha = 1;
    on.lineWidth = 2;
    on.setLineDash(kind === "warning" ? [7, 5] : []);
    on.stroke();
    on.setLineDash([]);
    if (!occupied) continue;
    on.save();
    on.clip();
    on.lineWidth = 1.5;
    on.globalAlpha = 0.75;
    for (const ends of hatch(points, HATCH)) stroke(on, ends);
    on.restore();
  }
}

/** The infrared rangers look at the floor: where it is missing there is a mark, a little outside; an open one where it is not known. */
function holes({ on, ink, at }: Brush, drive: DrivePart, sensors: SensorsPart): void {
  const robot = pose(drive);
  const { shown, rows } = infrareds(sensors);
  if (!robot || stale(shown)) return;
  for (const range of rows ?? []) {
    const seen = floor(range);
    if (seen === "floor") continue;
    const [sx, sy] = at(...from(robot, range.x + 0.12 * Math.cos(range.theta), range.y + 0.12 * Math.sin(range.theta)));
    on.beginPath();
    on.moveTo(sx - 8, sy - 6);
    on.lineTo(sx + 8, sy - 6);
    on.lineTo(sx, sy + 8);
    on.closePath();
    if (seen === "hole") {
      on.fillStyle = ink.ir;
      on.fill();
    }
    on.strokeStyle = seen === "hole" ? ink.floor : ink.ir;
    on.lineWidth = 1.5;
    on.stroke();
  }
}

/** Where it really is: only the simulation knows. */
function truth(brush: Brush, scene: ScenePart, drive: DrivePart): void {
  const { x, y, theta } = fresh(drive.truth) ?? {};
  if (typeof x !== "number" || typeof y !== "number" || typeof theta !== "number") return;
  const { on, ink } = brush;
  outline(brush, scene, { x, y, theta });
  on.setLineDash([5, 4]);
  on.strokeStyle = ink.truth;
  on.lineWidth = 1.5;
  on.stroke();
  on.setLineDash([]);
}

/** Where it believes itself to be, with two standard deviations around. Hollow while it is not sure. */
function robot(brush: Brush, scene: ScenePart, drive: DrivePart): void {
  const is = pose(drive);
  if (!is) return;
  const { on, ink, at, camera } = brush;
  const known = !stale(drive.estimate) && (drive.estimate.value?.quality ?? 0) >= 2;
  const colour = known ? ink.robot : ink.truth;
  const middle = at(is.x, is.y);
  if (drive.ellipse) {
    const { long, short, angle } = drive.ellipse;
    on.beginPath();
    on.ellipse(...middle, Math.min(long * camera.scale, 4000), Math.min(short * camera.scale, 4000), -(angle + camera.turn), 0, 2 * Math.PI);
    on.fillStyle = on.strokeStyle = colour;
    on.globalAlpha = 0.14;
    on.fill();
    on.globalAlpha = 0.7;
    on.lineWidth = 1.5;
    on.stroke();
    on.globalAlpha = 1;
  }
  // From afar it is a mark that can still be seen.
  if (camera.scale < 22) {
    on.fillStyle = colour;
    disc(on, middle, 8);
    on.strokeStyle = colour;
    on.lineWidth = 3;
    const shown = is.theta + camera.turn;
    stroke(on, [middle, [middle[0] + 16 * Math.cos(shown), middle[1] - 16 * Math.sin(shown)]]);
    return;
  }
  outline(brush, scene, is);
  on.fillStyle = known ? colour : ink.floor;
  on.globalAlpha = known ? 1 : 0.6;
  on.fill();
  on.globalAlpha = 1;
  on.strokeStyle = colour;
  on.lineWidth = 2;
  on.stroke();
  // Its nose.
  const front = Math.max(...scene.outline.map(([x]) => x));
  on.strokeStyle = known ? ink.floor : colour;
  on.lineWidth = Math.max(2, 0.05 * camera.scale);
  on.beginPath();
  on.moveTo(...at(...from(is, front - 0.22, 0.13)));
  on.lineTo(...at(...from(is, front - 0.08, 0)));
  on.lineTo(...at(...from(is, front - 0.22, -0.13)));
  on.stroke();
  disc(on, middle, 3, known ? ink.floor : colour);
}

function outline({ on, at }: Brush, scene: ScenePart, is: Pose): void {
  on.beginPath();
  for (const [x, y] of scene.outline) on.lineTo(...at(...from(is, x, y)));
  on.closePath();
}

/** What was placed by hand, and what was sent last. */
function marks(brush: Brush): void {
  const { on, ink, at, camera } = brush;
  const draw = (all: Place[], colour: string) => {
    if (all.length > 1) line(brush, all.map(({ x, y }): Point => [x, y]), colour, 2, [6, 6]);
    all.forEach(({ x, y, theta }, i) => {
      flag(brush, [x, y], colour, all.length > 1 ? String(i + 1) : "");
      if (theta === null) return;
      const [sx, sy] = at(x, y);
      const shown = theta + camera.turn;
      const [tx, ty] = [sx + 44 * Math.cos(shown), sy - 44 * Math.sin(shown)];
      on.strokeStyle = colour;
      on.lineWidth = 3;
      stroke(on, [[sx, sy], [tx, ty]]);
      for (const side of [2.6, -2.6]) stroke(on, [[tx, ty], [tx + 12 * Math.cos(shown + side), ty - 12 * Math.sin(shown + side)]]);
    });
  };
  if (places.value.length === 0) draw(sent.value, ink.goal);
  draw(places.value, mode.value === "pose" ? ink.robot : mode.value === "measure" ? ink.ink : ink.goal);
}

function flag({ on, at, ink }: Brush, [x, y]: Point, colour: string, label: string): void {
  const place = at(x, y);
  disc(on, place, 9, ink.floor);
  disc(on, place, label ? 9 : 5, colour);
  on.strokeStyle = colour;
  on.lineWidth = 2;
  on.beginPath();
  on.arc(...place, 9, 0, 2 * Math.PI);
  on.stroke();
  if (!label) return;
  on.fillStyle = ink.floor;
  on.font = "700 11px system-ui, sans-serif";
  on.textAlign = "center";
  on.fillText(label, place[0], place[1] + 0.5);
  on.textAlign = "start";
}

function bar({ on, camera, size, ink }: Brush): void {
  const length = barLength(camera.scale);
  const [x, y] = [14, size.height - 14];
  on.strokeStyle = on.fillStyle = ink.ink;
  on.lineWidth = 2;
  stroke(on, [[x, y - 5], [x, y], [x + length * camera.scale, y], [x + length * camera.scale, y - 5]]);
  on.font = "12px system-ui, sans-serif";
  on.textBaseline = "alphabetic";
  on.fillText(united(written(String(length)), "m"), x + 5, y - 5);
  on.textBaseline = "middle";
}

function line({ on, at }: Brush, points: Point[], colour: string, width: number, dash: number[]): void {
  on.strokeStyle = colour;
  on.lineWidth = width;
  on.setLineDash(dash);
  stroke(on, points.map((point) => at(...point)));
  on.setLineDash([]);
}

function stroke(on: CanvasRenderingContext2D, points: Point[]): void {
  on.beginPath();
  for (const point of points) on.lineTo(...point);
  on.stroke();
}

function disc(on: CanvasRenderingContext2D, at: Point, radius: number, colour?: string): void {
  if (colour) on.fillStyle = colour;
  on.beginPath();
  on.arc(...at, radius, 0, 2 * Math.PI);
  on.fill();
}
