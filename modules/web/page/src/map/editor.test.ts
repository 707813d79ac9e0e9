import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { ScenePart, SystemPart } from "../protocol";
import { MARK } from "./scenario";

// What the page's modules take from a browser as they are loaded.
const none = () => undefined;
const navigator = { onLine: true, userAgent: "", language: "en", languages: ["en"], maxTouchPoints: 0 };
const storage = { getItem: () => null, setItem: none, removeItem: none };
// Nothing is watched, and the test ends.
Object.assign(globalThis, { setInterval: () => 0 });
Object.assign(globalThis, { addEventListener: none, removeEventListener: none, localStorage: storage, sessionStorage: storage });
Object.defineProperty(globalThis, "navigator", { value: navigator, configurable: true });
Object.assign(globalThis, { location: new URL("http://robot/"), document: { addEventListener: none, documentElement: {}, visibilityState: "visible" } });
const { scene, system } = await import("../state");
const { hear, hooks } = await import("../connection/command");
const { mode } = await import("./draft");
const { drop, edit, history, press, refused, rename, run, scenario, tool, undo, unreadable, wallsBelow } = await import("./editor");

/** What of a scene the editor uses. */
const SCENE = { robot: "advee", simulated: true, walls: [], columns: [], routes: [], world: "" } as unknown as ScenePart;
const BOX = "[[boxes]]\nx = 5.0\ny = 5.0\nlength = 1.0\nwidth = 1.0\n";
const SIDES: [number, number, number, number][] = [[4.5, 4.5, 5.5, 4.5], [5.5, 4.5, 5.5, 5.5], [5.5, 5.5, 4.5, 5.5], [4.5, 5.5, 4.5, 4.5]];

test("undo takes a new name back as one change, and what was drawn before and after it", () => {
  scene.value = { ...SCENE, world: "start = [0, 0, 0]\n", routes: [] };
  edit();
  tool.value = "waypoint";
  press([1, 1], 0.1);
  drop();
  for (const name of ["t", "to", "tour"]) rename(name);
  press([2, 2], 0.1);
  drop();
  const shown = () => [scenario.value?.route, scenario.value?.items.length];
  const seen = [shown()];
  for (let n = 0; n < 3; n += 1) {
    undo();
    seen.push(shown());
  }
  deepEqual(seen, [["tour", 3], ["tour", 2], ["scenario", 2], ["scenario", 1]]);
  equal(history.value.length, 0);
});

test("boxes that stand in the world are drawn where they are moved to, and only there while it is edited", () => {
  const outer: [number, number, number, number] = [0, 0, 20, 0];
  scene.value = { ...SCENE, world: `start = [0, 0, 0]\n${MARK}\n${BOX}`, routes: [], walls: [outer, ...SIDES] };
  edit();
  deepEqual(wallsBelow(scene.value.walls), [outer]);
  mode.value = "look";
  equal(wallsBelow(scene.value.walls).length, 5);
});

test("a world that was edited by hand in a way that is not understood is shown with the line, and not edited", () => {
  scene.value = { ...SCENE, world: `start = [0, 0, 0]\n${MARK}\n[[walkers]]\npoints = [[1,\n`, routes: [] };
  edit();
  deepEqual([scenario.value, unreadable.value], [null, { line: 3, text: "[[walkers]]" }]);
});

test("the answer of the simulation to another sender's command is not taken for the one to the scenario", async () => {
  // The last answer, to a command with this timestamp.
  const answers = (command: number, refusal: string) => (system.value = { run: { age: 0, value: { command, refusal } } } as unknown as SystemPart);
  const ids: number[] = [];
  hooks.send = (command) => ids.push("id" in command ? command.id : 0) > 0;
  scene.value = { ...SCENE, world: "start = [0, 0, 0]\n", routes: [] };
  edit();
  answers(5, "");
  const running = run();
  answers(6, "there is no such world");
  hear({ type: "done", id: ids[0] ?? 0, timestamp: 8 });
  await running;
  answers(7, "there is no such speed");
  equal(refused.value, "");
  answers(8, "line 3 is not understood");
  equal(refused.value, "Line 3 is not understood.");
  // It may be shown before the robot confirms that the command was published.
  const again = run();
  answers(9, "line 4 is not understood");
  equal(refused.value, "");
  hear({ type: "done", id: ids[1] ?? 0, timestamp: 9 });
  await again;
  equal(refused.value, "Line 4 is not understood.");
});
