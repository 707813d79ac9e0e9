// What the guard permits, as it is shown; and the second input, by which a person creeps past it.
import { deepEqual, equal, ok } from "node:assert/strict";
import { HOLD } from "../src/numbers";
import { AT_ONCE } from "./support/bus";
import type { Visit } from "./support/browser";
import { scene } from "./support/scene";
import { pass, until } from "./support/until";

/** Number of pixels of the map in about the colour of this name: the ellipse of a position that is searched lies over it. */
const pixels = (v: Visit, ink: string): Promise<number> =>
  v.page.evaluate((name) => {
    const canvas = document.querySelector<HTMLCanvasElement>("canvas.map-canvas");
    const on = canvas?.getContext("2d");
    if (!canvas || !on) return 0;
    const colour = Number.parseInt(getComputedStyle(document.documentElement).getPropertyValue(name).trim().slice(1), 16);
    const { data } = on.getImageData(0, 0, canvas.width, canvas.height);
    const near = (n: number, shift: number) => Math.abs((data[n] as number) - ((colour >> shift) & 255)) < 24;
    let count = 0;
    for (let n = 0; n < data.length; n += 4) if (near(n, 16) && near(n + 1, 8) && near(n + 2, 0)) count += 1;
    return count;
  }, ink);

/** Its front is 0.19 m before the wall of the hall: nothing forward is permitted. */
const BEFORE_A_WALL = ["guard.ranging=\"sonar\"", "world.start=[19.06, 6.0, 0.0]"];

scene("before a wall the page shows the fields and the bound; a second input creeps, and its release ends that at once", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  await v.takeControl();
  await v.text(/^Must not move forward: sonar \d+\./).waitFor();
  await v.text(/Something is in the protective and the warning field\./).waitFor();
  // While the position is searched nothing is drawn at it.
  await robot.advee("pose", "19.06,6,0");
  await until("the fields are on the map", 10, async () => (await pixels(v, "--map-protective")) > 50 && (await pixels(v, "--map-warning")) > 50);
  const creep = v.button("Creep");
  equal(await creep.getAttribute("aria-disabled"), "true", "no hand is on the pad");
  const { keyboard, mouse } = v.page;
  const box = await creep.boundingBox();
  ok(box && box.height >= 48);
  await keyboard.down("ArrowUp");
  await until("the page drives", 5, () => (robot.bus.driven().at(-1)?.speed ?? 0) > 0);
  await pass(400);
  ok(Math.abs(robot.bus.truth().speed) < 0.02, "the guard permits nothing");
  deepEqual(robot.bus.said("LL_CMD_CREEP"), []);
  await mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await mouse.down();
  await until("the robot creeps", 5, () => robot.bus.truth().speed > 0.03 && robot.bus.stands(HOLD.GuardCreep));
  const released = Date.now();
  await mouse.up();
  const end = await until("the second input is let go", 5, () => robot.bus.said("LL_CMD_CREEP").find(({ message }) => message["held"] === false));
  ok(end.at - released < AT_ONCE, `${end.at - released} ms`);
  const said = robot.bus.said("LL_CMD_CREEP");
  deepEqual([...new Set(said.map(({ message }) => message["source"]))], ["web:desktop operator"]);
  equal(said.at(-1), end, "then it is silent");
  await until("the robot stands, though it is driven", 5, () => Math.abs(robot.bus.truth().speed) < 0.02);
  ok((robot.bus.driven().at(-1)?.speed ?? 0) > 0, "the key is still held");
  ok(robot.bus.stands(HOLD.GuardStops, HOLD.GuardSlows) && !robot.bus.stands(HOLD.GuardCreep));
  await keyboard.up("ArrowUp");
  await robot.bus.stops();
}, BEFORE_A_WALL);
