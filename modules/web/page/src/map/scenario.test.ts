import { deepEqual, equal, ok } from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { APART, type Box, boxBetween, corners, flaw, hit, type Item, MARK, moved, read, type Scenario, turned, walkerBetween, withoutBoxes, write } from "./scenario";

const HALL = readFileSync("../../../conf/worlds/hall.toml", "utf8");

const scenarioOf = (text: string, routes: readonly string[] = []): Scenario => read(text, routes) as Scenario;

/** A scenario in the hall with one of everything: robot/src/config/tests.rs loads the same text. */
function drawn(): Scenario {
  const scenario = read(HALL, ["patrol"]) as Scenario;
  const [start, ...others] = scenario.items as [Item];
  const items: Item[] = [
    { ...start, x: 2.5, theta: Math.PI / 2 } as Item,
    ...others,
    turned(boxBetween([9, 5.5], [10, 6]), Math.PI / 4),
    walkerBetween([12, 6], [14, 8]),
    walkerBetween([5, 9], [5.1, 9]),
    { kind: "waypoint", x: 5, y: 6 },
    { kind: "waypoint", x: 8, y: 7 },
  ];
  return { ...scenario, items };
}

test("what is drawn in the hall is the file that the robot's own test loads", () => {
  const text = write(drawn());
  equal(text, readFileSync("src/map/scenario.fixture.toml", "utf8"));
});

test("the text of the world stays as it is, but for its start", () => {
  const scenario = read(HALL) as Scenario;
  equal(write(scenario), HALL, "nothing was drawn");
  const [before, after] = write(drawn()).split(MARK) as [string, string];
  equal(before.replace("start = [2.5, 6.0, 1.5708]", "start = [3.0, 6.0, 0.0]"), HALL);
  ok(after.includes("[[boxes]]") && after.includes("[[walkers]]") && after.includes("[[routes]]"));
});

test("what was drawn is read again, and written as it was", () => {
  const text = write(drawn());
  const again = read(text, ["patrol", "scenario"]) as Scenario;
  equal(write(again), text);
  deepEqual(again.items.map(({ kind }) => kind), ["start", "box", "walker", "walker", "waypoint", "waypoint"]);
  equal(write({ ...again, items: again.items.filter(({ kind }) => kind === "start") }).includes(MARK), false);
});

test("a way has no name that the world has given", () => {
  equal(scenarioOf(HALL, ["scenario", "scenario 2"]).route, "scenario 3");
});

test("a start is that of the world, not of a table, and one that is not found is not guessed", () => {
  deepEqual(read("walls = [\n  [0, 0, 1, 1],\n]\n[people]\ncount = 1\nstart = [1, 2, 3]\n"), { unreadable: "start" });
  deepEqual(read("walls = []\n"), { unreadable: "start" });
  deepEqual(scenarioOf("walls = [\n  [0, 0, 1, 1],\n]\nstart = [1, 2,\n 3, ]").items, [{ kind: "start", x: 1, y: 2, theta: 3 }]);
});

test("numbers are written as TOML has them", () => {
  const scenario: Scenario = { base: "start = [0, 0, 0]", route: 'a "b"', taken: [], items: [{ kind: "waypoint", x: -0.00001, y: 1e-9 }, { kind: "box", x: 1000, y: 2, length: 1, width: 0.12345, theta: -0 }] };
  const text = write(scenario);
  ok(text.startsWith("start = [0, 0, 0]\n# ----"), text);
  ok(text.includes("waypoints = [[0.0, 0.0]]") && text.includes('name = "a \\"b\\""') && text.includes("width = 0.123\n") && text.includes("theta = 0.0\n"), text);
});

test("a tap makes a box of the usual size, and a person who stands", () => {
  deepEqual(boxBetween([1, 1], [1.01, 1]), { kind: "box", x: 1, y: 1, length: 0.5, width: 0.5, theta: 0 });
  deepEqual(boxBetween([3, 4], [1, 1]), { kind: "box", x: 2, y: 2.5, length: 2, width: 3, theta: 0 });
  deepEqual(walkerBetween([1, 1], [1.1, 1]).points, [[1, 1]]);
});

test("a box is hit where it is when it is turned, and the uppermost first", () => {
  const long = turned({ kind: "box", x: 0, y: 0, length: 4, width: 0.5, theta: 0 }, Math.PI / 2) as Box;
  const items: Item[] = [long, { kind: "walker", points: [[5, 0], [8, 0]] }];
  deepEqual([hit(items, [0, 1.9]), hit(items, [1.9, 0]), hit(items, [8.1, 0])], [{ item: 0, point: 0 }, null, { item: 1, point: 1 }]);
  deepEqual(hit(items, [0.4, 0], 0.2), { item: 0, point: 0 });
  ok(corners(long).every(([x, y]) => Math.abs(Math.abs(x) - 0.25) < 1e-9 && Math.abs(Math.abs(y) - 2) < 1e-9));
  deepEqual(moved(items[1] as Item, 1, [1, 1]), { kind: "walker", points: [[5, 0], [9, 1]] });
});

test("lines below the mark that were edited by hand are read, or refused with their line", () => {
  const of = (lines: string) => read(`start = [0, 0, 0]\n${MARK}\n${lines}`);
  const by = of('\n# mine\n[[ boxes ]] # one\nx=1\ny = 2 \nlength = 1\nwidth = 1.5\n\n[[walkers]]\npoints = [[1,2]]') as Scenario;
  deepEqual(by.items.slice(1), [{ kind: "box", x: 1, y: 2, length: 1, width: 1.5, theta: 0 }, { kind: "walker", points: [[1, 2]] }]);
  for (const [lines, line] of [
    ["[[walkers]]\npoints = [[1, 2]", 3],
    ["[[walkers]]\npoints = [[1, 2], [3, 4], [5, 6]]", 3],
    ["[[walkers]]\npoints = [[1, null]]", 3],
    ["[[walkers]]\n", 3],
    ["[[routes]]\nname = 'a'\nwaypoints = [[1, 2]]", 3],
    ["[[routes]]\nname = 3\nwaypoints = [[1, 2]]", 3],
    ['[[routes]]\nname = "a"\nwaypoints = [[1, 2]]\nloop = true', 3],
    ['[[routes]]\nname = "a"\nwaypoints = [[1, 2]]\n[[routes]]\nname = "b"\nwaypoints = [[1, 2]]', 6],
    ["[[boxes]]\nx = 1\ny = one\nlength = 1\nwidth = 1", 3],
    ["[[boxes]]\nx = 1\nx = 1", 5],
    ["\n[[columns]]\n", 4],
    ["points = [[1, 2]]", 3],
    ["[[walkers]]\npoints = [\n[1, 2],\n]", 5],
    ["__proto__ = 1", 3],
  ] as [string, number][]) {
    const refused = of(lines);
    if (!("unreadable" in refused) || refused.unreadable === "start") throw new Error(lines);
    deepEqual([refused.unreadable.line, refused.unreadable.text], [line, `start\n${MARK}\n${lines}`.split("\n")[line - 1]], lines);
  }
});

test("a way needs a name that the world has not, and a map file is not sent", () => {
  const scenario = scenarioOf(write(drawn()), ["patrol", "scenario"]);
  deepEqual([scenario.taken, flaw(scenario)], [["patrol"], null]);
  equal(flaw({ ...scenario, route: "patrol" }), "taken");
  equal(flaw({ ...scenario, route: " " }), "unnamed");
  equal(flaw({ ...scenario, route: "", items: scenario.items.filter(({ kind }) => kind !== "waypoint") }), null);
  equal(flaw(scenarioOf('start = [0, 0, 0]\nmap = "hall.yaml"\n')), "map");
  equal(flaw(scenarioOf('start = [0, 0, 0]\n# map = "hall.yaml"\n')), null);
});

test("walls of boxes that were drawn are left out, and no others", () => {
  const box: Box = { kind: "box", x: 1, y: 2, length: 1, width: 0.5, theta: 0.3 };
  const round = (value: number): number => Math.round(value * 1000) / 1000;
  const all = corners(box);
  const walls = all.map(([x, y], n): [number, number, number, number] => {
    const [a, b] = all[(n + 1) % 4] as [number, number];
    return [round(x), round(y), round(a), round(b)];
  });
  const other: [number, number, number, number] = [0, 0, 20, 0];
  deepEqual(withoutBoxes([other, ...walls], [box]), [other]);
  deepEqual(withoutBoxes([other, ...walls], [{ ...box, x: 1.1 }]), [other, ...walls]);
});

test("what the robot would refuse is said before", () => {
  const scenario = read("start = [0.0, 0.0, 0.0]\n") as Scenario;
  const at = (x: number): Item => ({ kind: "walker", points: [[x, 0]] });
  equal(flaw({ ...scenario, items: [...scenario.items, at(APART)] }), null);
  equal(flaw({ ...scenario, items: [...scenario.items, at(APART - 0.1)] }), "near");
  equal(flaw({ ...scenario, items: [...scenario.items, ...Array.from({ length: 201 }, () => at(5))] }), "people");
  equal(flaw({ ...scenario, base: `start = [0.0, 0.0, 0.0]\n${"# x\n".repeat(9000)}` }), "long");
});
