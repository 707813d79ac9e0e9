// A scenario: a world with boxes, people, a start and a way that were drawn on the map, as the text of a world's file.
// The text of the world that it was drawn in stays as it is, but for its start; what was drawn follows a line of its own,
// and is read again from there. Pure. Metres and radians, map frame.

export type Point = [number, number];

/** A box on the floor, by its middle; `theta`: direction of its length. */
export interface Box {
  kind: "box";
  x: number;
  y: number;
  length: number;
  width: number;
  theta: number;
}
/** A person who stands at the one point, or walks to and fro between two. */
export interface Walker {
  kind: "walker";
  points: Point[];
}
/** Where the robot begins: the middle of its rear axle. */
export interface Start {
  kind: "start";
  x: number;
  y: number;
  theta: number;
}
/** A waypoint of the way that was drawn. */
export interface Waypoint {
  kind: "waypoint";
  x: number;
  y: number;
}
export type Item = Box | Walker | Start | Waypoint;

export interface Scenario {
  /** Text of the world that it was drawn in. */
  base: string;
  /** Name of the drawn way. */
  route: string;
  /** Names of the world's own ways. */
  taken: readonly string[];
  items: readonly Item[];
}

/** What follows this line was drawn. */
export const MARK = "# ---- drawn on the map; below this line the scenario editor writes anew";
/** Bytes of a text that the robot takes; people in a world; size of a box, m; distance of a person from the start, m. */
export const TEXT_MAX = 32 * 1024;
export const PEOPLE_MAX = 200;
const SIZE = { least: 0.05, most: 1000, usual: 0.5 };
export const APART = 1.5;
/** Size of a person, of the start and of a waypoint for a finger, m. */
const REACH = { walker: 0.3, start: 0.45, waypoint: 0.25 };

const START = /^[ \t]*start[ \t]*=[ \t]*\[([^\]]*)\]/m;

/** Where the keys before the first table end: a `start` behind it is of that table. */
function head(base: string): number {
  // A list over several lines has lines that begin with a bracket, too: only `[name]` and `[[name]]` are tables.
  const table = /^[ \t]*\[{1,2}[ \t]*[A-Za-z_"'][^\],]*\]{1,2}[ \t]*(#.*)?$/m.exec(base);
  return table?.index ?? base.length;
}

function startOf(base: string): Start | null {
  const numbers = START.exec(base.slice(0, head(base)))?.[1]?.split(",").map((each) => each.trim()).filter((each) => each !== "").map(Number);
  if (numbers?.length !== 3 || !numbers.every(Number.isFinite)) return null;
  const [x, y, theta] = numbers as [number, number, number];
  return { kind: "start", x, y, theta };
}

/** Why a text cannot be edited: it has no `start` that can be moved, or this line below the mark was not written here. */
export interface Unreadable {
  unreadable: "start" | { line: number; text: string };
}

const json = (text: string): unknown => {
  try {
    return JSON.parse(text) as unknown;
  } catch {
    return undefined;
  }
};
const isPoint = (value: unknown): value is Point => Array.isArray(value) && value.length === 2 && value.every((each) => Number.isFinite(each));
const points = (text: string): Point[] | null => {
  const value = json(text);
  return Array.isArray(value) && value.length > 0 && value.every(isPoint) ? value : null;
};
const SIDES = ["x", "y", "length", "width", "theta"];

/** What the lines below the mark have. Whatever they do not have in its place ends it with its line: nothing is lost. */
function drawnIn(lines: readonly string[], first: number): { items: Item[]; route: string | null } | Unreadable {
  const items: Item[] = [];
  let route: string | null = null;
  // The table that is read, where it begins, and its keys.
  let [table, begin, keys] = ["", 0, new Map<string, string>()];
  const at = (n: number): Unreadable => ({ unreadable: { line: first + n, text: lines[n] ?? "" } });
  const end = (): boolean => {
    const numbers = SIDES.map((side) => Number(keys.get(side) ?? (side === "theta" ? "0" : NaN)));
    const [x, y, length, width, theta] = numbers as [number, number, number, number, number];
    const list = points(keys.get(table === "walkers" ? "points" : "waypoints") ?? "");
    const name = json(keys.get("name") ?? "");
    const only = (...known: string[]): boolean => [...keys.keys()].every((key) => known.includes(key));
    if (table === "boxes" && only(...SIDES) && numbers.every(Number.isFinite)) items.push({ kind: "box", x, y, length, width, theta });
    else if (table === "walkers" && only("points") && list && list.length <= 2) items.push({ kind: "walker", points: list });
    else if (table === "routes" && only("name", "waypoints") && list && typeof name === "string" && route === null) {
      route = name;
      for (const [px, py] of list) items.push({ kind: "waypoint", x: px, y: py });
    } else return table === "";
    return true;
  };
  for (const [n, line] of lines.entries()) {
    const [, name] = /^\s*\[\[\s*(\w+)\s*\]\]\s*(?:#.*)?$/.exec(line) ?? [];
    const [, key, value] = /^\s*(\w+)\s*=\s*(.*?)\s*$/.exec(line) ?? [];
    if (name) {
      if (!end()) return at(begin);
      [table, begin, keys] = [name, n, new Map()];
    } else if (key && value && table && !keys.has(key)) keys.set(key, value);
    else if (!/^\s*(#.*)?$/.test(line)) return at(n);
  }
  return end() ? { items, route } : at(begin);
}

/** A scenario from the text of a world, with what was drawn in it before. `routes`: names of all ways of that world. */
export function read(text: string, routes: readonly string[] = []): Scenario | Unreadable {
  const cut = text.indexOf(`${MARK}\n`);
  const base = cut < 0 ? text : text.slice(0, cut);
  const start = startOf(base);
  if (start === null) return { unreadable: "start" };
  const drawn = drawnIn(cut < 0 ? [] : text.slice(cut).split("\n"), base.split("\n").length);
  if ("unreadable" in drawn) return drawn;
  const taken = routes.filter((name) => name !== drawn.route);
  let route = drawn.route ?? "scenario";
  // Of the world's own ways none has its name.
  for (let n = 2; taken.includes(route); n += 1) route = `scenario ${n}`;
  return { base, route, taken, items: [start, ...drawn.items] };
}

/** To a millimetre, and always with a point: what TOML takes for a number with decimals. */
const metres = (value: number): string => {
  const text = String(Math.round(value * 1000) / 1000 + 0);
  return text.includes(".") ? text : `${text}.0`;
};
const radians = (value: number): string => {
  const text = String(Math.round(value * 10000) / 10000 + 0);
  return text.includes(".") ? text : `${text}.0`;
};
const pair = ([x, y]: Point): string => `[${metres(x)}, ${metres(y)}]`;

/** The text of its file. */
export function write(scenario: Scenario): string {
  const { base, items, route } = scenario;
  const start = items.find((item) => item.kind === "start");
  const end = head(base);
  const old = startOf(base);
  const moved = start && (old?.x !== start.x || old.y !== start.y || old.theta !== start.theta);
  const text = moved ? base.slice(0, end).replace(START, () => `start = [${metres(start.x)}, ${metres(start.y)}, ${radians(start.theta)}]`) + base.slice(end) : base;
  const blocks = items.flatMap((item) => {
    if (item.kind === "box")
      return [`[[boxes]]\nx = ${metres(item.x)}\ny = ${metres(item.y)}\nlength = ${metres(item.length)}\nwidth = ${metres(item.width)}\ntheta = ${radians(item.theta)}\n`];
    return item.kind === "walker" ? [`[[walkers]]\npoints = [${item.points.map(pair).join(", ")}]\n`] : [];
  });
  const way = items.flatMap((item): Point[] => (item.kind === "waypoint" ? [[item.x, item.y]] : []));
  if (way.length > 0) blocks.push(`[[routes]]\nname = ${JSON.stringify(route)}\nwaypoints = [${way.map(pair).join(", ")}]\n`);
  if (blocks.length === 0) return text;
  return `${text}${text.endsWith("\n") ? "" : "\n"}${MARK}\n\n${blocks.join("\n")}`;
}

/** A box between two corners; one that is hardly dragged has the usual size. */
export function boxBetween([ax, ay]: Point, [bx, by]: Point): Box {
  const dragged = Math.max(Math.abs(bx - ax), Math.abs(by - ay)) >= 0.15;
  const side = (length: number): number => (dragged ? Math.min(SIZE.most, Math.max(SIZE.least, Math.abs(length))) : SIZE.usual);
  return { kind: "box", x: dragged ? (ax + bx) / 2 : ax, y: dragged ? (ay + by) / 2 : ay, length: side(bx - ax), width: side(by - ay), theta: 0 };
}

/** A person from one point to another; one that is hardly dragged stands. */
export const walkerBetween = (a: Point, b: Point): Walker => ({ kind: "walker", points: Math.hypot(b[0] - a[0], b[1] - a[1]) < 0.5 ? [a] : [a, b] });

/** Corners of a box, in order. */
export function corners({ x, y, length, width, theta }: Box): Point[] {
  const [cos, sin] = [Math.cos(theta), Math.sin(theta)];
  return ([[-1, -1], [1, -1], [1, 1], [-1, 1]] as Point[]).map(([a, b]) => {
    const [dx, dy] = [(a * length) / 2, (b * width) / 2];
    return [x + cos * dx - sin * dy, y + sin * dx + cos * dy];
  });
}

/** Index of what is at a point, and of its point there if it is a person; `more`: m that a finger may miss it by. */
export function hit(items: readonly Item[], [px, py]: Point, more = 0): { item: number; point: number } | null {
  const near = (x: number, y: number, reach: number): boolean => Math.hypot(px - x, py - y) <= reach + more;
  for (let item = items.length - 1; item >= 0; item -= 1) {
    const each = items[item] as Item;
    if (each.kind === "walker") {
      const point = each.points.findIndex(([x, y]) => near(x, y, REACH.walker));
      if (point >= 0) return { item, point };
    } else if (each.kind === "box") {
      const [cos, sin] = [Math.cos(each.theta), Math.sin(each.theta)];
      const [dx, dy] = [px - each.x, py - each.y];
      if (Math.abs(cos * dx + sin * dy) <= each.length / 2 + more && Math.abs(cos * dy - sin * dx) <= each.width / 2 + more) return { item, point: 0 };
    } else if (near(each.x, each.y, REACH[each.kind])) return { item, point: 0 };
  }
  return null;
}

/** The same item elsewhere; of a person who walks, one end of his way. */
export function moved(item: Item, point: number, [dx, dy]: Point): Item {
  if (item.kind !== "walker") return { ...item, x: item.x + dx, y: item.y + dy };
  return { ...item, points: item.points.map(([x, y], n): Point => (n === point ? [x + dx, y + dy] : [x, y])) };
}

/** The same item turned counter-clockwise by an angle; a person and a waypoint have no direction. */
export function turned(item: Item, by: number): Item {
  return item.kind === "box" || item.kind === "start" ? { ...item, theta: Math.atan2(Math.sin(item.theta + by), Math.cos(item.theta + by)) } : item;
}

/** The walls of a world without those of the boxes that were drawn in it: the robot rounds them to a millimetre. */
export function withoutBoxes(walls: ReadonlyArray<readonly [number, number, number, number]>, items: readonly Item[]): ReadonlyArray<readonly [number, number, number, number]> {
  const sides = items.flatMap((item) => {
    const all = item.kind === "box" ? corners(item) : [];
    return all.map((from, n) => [...from, ...(all[(n + 1) % all.length] as Point)]);
  });
  if (sides.length === 0) return walls;
  return walls.filter((wall) => !sides.some((side) => side.every((value, n) => Math.abs(value - (wall[n] as number)) < 0.002)));
}

export type Flaw = "people" | "near" | "unnamed" | "taken" | "map" | "long";

/** What keeps a scenario from being run, that can be seen here. The robot checks all of it. */
export function flaw(scenario: Scenario): Flaw | null {
  const { base, items, route, taken } = scenario;
  const start = items.find((item) => item.kind === "start");
  const walkers = items.filter((item) => item.kind === "walker");
  if (walkers.length > PEOPLE_MAX) return "people";
  if (start && walkers.some(({ points: [at] }) => at && Math.hypot(at[0] - start.x, at[1] - start.y) < APART)) return "near";
  if (items.some(({ kind }) => kind === "waypoint")) {
    if (route.trim() === "") return "unnamed";
    if (taken.includes(route)) return "taken";
  }
  if (/^[ \t]*map[ \t]*=/m.test(base.slice(0, head(base)))) return "map";
  return new TextEncoder().encode(write(scenario)).length > TEXT_MAX ? "long" : null;
}
