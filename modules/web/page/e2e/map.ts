// The map under the hand: a goal by a tap and a confirmation, a route, the robot's own position.
import { deepEqual, equal, match, ok } from "node:assert/strict";
import { readFile } from "node:fs/promises";
import type { Locator } from "playwright-core";
import { HOLD } from "../src/numbers";
import { PROFILES, type Visit } from "./support/browser";
import { scene } from "./support/scene";
import { until } from "./support/until";

/** Taps the map at a share of its width and height; with `to` it drags from there. */
async function touch(v: Visit, [x, y]: [number, number], to?: [number, number]): Promise<void> {
  const canvas = v.page.locator("canvas.map-canvas");
  await canvas.scrollIntoViewIfNeeded();
  const box = await canvas.boundingBox();
  if (!box) throw new Error("the map is not to be seen");
  const hand = v.hand();
  await hand.down(box.x + box.width * x, box.y + box.height * y);
  if (to) for (let n = 1; n <= 4; n += 1) await hand.move(box.x + box.width * (x + ((to[0] - x) * n) / 4), box.y + box.height * (y + ((to[1] - y) * n) / 4));
  await hand.up();
}
const field = async (v: Visit, label: string): Promise<number> => Number(await v.page.getByLabel(label).inputValue());

for (const profile of PROFILES) {
  scene(`a tap and a confirmation send it somewhere; cancelled it stands (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "operator" });
    await v.takeControl();
    await v.go("Map");
    await v.press(v.button("Go to"));
    await touch(v, [0.4, 0.5]);
    const tapped = await until("the place is in the fields", 5, async () => (await v.page.getByLabel("x, m").inputValue()) && [await field(v, "x, m"), await field(v, "y, m")]);
    deepEqual(robot.bus.said("ML_CMD_GOAL"), [], "a tap alone says nothing");
    await touch(v, [0.5, 0.5]);
    ok((await field(v, "x, m")) > (tapped[0] as number), "to the right is east");
    // A place that is surely free, typed.
    await v.page.getByLabel("x, m").fill("6");
    await v.page.getByLabel("y, m").fill("6");
    await v.page.getByLabel("y, m").blur();
    await v.press(v.button("Go there"));
    const goal = (await robot.bus.hears("ML_CMD_GOAL")) as { waypoints: { x: number; y: number }[]; loop: boolean };
    // A field that shows what was tapped keeps what is behind its last figure.
    const at = goal.waypoints.map(({ x, y }) => [Math.round(x * 100) / 100, Math.round(y * 100) / 100]);
    deepEqual([at, goal.loop], [[[6, 6]], false]);
    await until("it drives", 30, async () => {
      // Where a busy machine made it stop once, the planner waits for an operator.
      if (robot.bus.stands(HOLD.PlannerLatched)) await robot.advee("state", "planner", "RUN");
      return (await v.word.textContent())?.includes("Driving");
    });
    await v.text(/^Drives to waypoint 1/).waitFor();
    await v.press(v.button("Cancel goal"));
    await v.text(/^Cancelled/).waitFor();
    await until("it stands", 10, () => Math.abs(robot.bus.truth().speed) < 0.02);
  });

  scene(`the position is set by hand: tap, drag to the heading, confirm (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "operator" });
    await v.takeControl();
    await v.go("Map");
    await v.press(v.button("Set position"));
    await touch(v, [0.5, 0.6], [0.5, 0.4]);
    const heading = await until("a heading", 5, () => field(v, "heading, °"));
    ok(Math.abs(heading - 90) < 2, `up on the map is north, not ${heading}°`);
    // What it says on the bus is where it really is, so that it still knows.
    const { x, y, theta } = robot.bus.truth();
    for (const [label, value] of [["x, m", x], ["y, m", y], ["heading, °", (theta * 180) / Math.PI]] as const) {
      await v.page.getByLabel(label).fill(value.toFixed(2));
      await v.page.getByLabel(label).blur();
    }
    await v.press(v.button("The robot is here"));
    const said = (await robot.bus.hears("ML_CMD_ESTIMATE")) as { x: number; y: number; theta: number };
    ok(Math.hypot(said.x - x, said.y - y) < 0.02 && Math.cos(said.theta - theta) > 0.99);
  });
}

scene("a long press on the map begins a goal; looking around commands nothing", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  await v.takeControl();
  await v.go("Map");
  const canvas = v.page.locator("canvas.map-canvas");
  await touch(v, [0.5, 0.5], [0.6, 0.6]);
  await canvas.hover();
  await v.page.mouse.wheel(0, -300);
  for (const name of ["Nearer", "Farther", "Show all", "Follow the robot"]) await v.button(name).click();
  equal(await v.page.getByLabel("x, m").count(), 0);
  const box = await canvas.boundingBox();
  ok(box);
  await v.page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await v.page.mouse.down();
  await v.button("Go there").waitFor();
  await v.page.mouse.up();
  await v.button("Cancel").click();
  deepEqual(robot.bus.commands, []);
});

for (const profile of PROFILES) {
  scene(`a planner that waits for an operator is resumed from the map, once control is taken (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "operator" });
    await v.go("Map");
    const slide = v.page.locator(".map").getByRole("slider", { name: /^Resume/ });
    equal(await slide.count(), 0, "nothing waits");
    // A goal far away, and a stop on the way to it.
    await robot.advee("goal", "18.5,3");
    await until("it drives", 30, async () => {
      if (robot.bus.stands(HOLD.PlannerLatched)) await robot.advee("state", "planner", "RUN");
      return robot.bus.truth().speed > 0.05;
    });
    await v.press(v.stop);
    await v.shows("Stopped");
    await robot.goOn();
    await slide.waitFor();
    equal(await slide.getAttribute("aria-disabled"), "true", "without control");
    await (v.touches ? slide.tap({ force: true }) : slide.click({ force: true }));
    await v.press(v.page.locator(".toast").getByRole("button", { name: "Take control" }));
    await until("it may be resumed", 10, async () => (await slide.getAttribute("aria-disabled")) === "false");
    deepEqual(v.said.map(({ type }) => type), ["stop", "take"], "control alone resumes nothing");
    await v.slide(/^Resume/);
    await slide.waitFor({ state: "detached" });
    deepEqual(v.said.map(({ type }) => type), ["stop", "take", "resume"]);
    await until("it drives on", 20, () => robot.bus.truth().speed > 0.05);
  });
}

scene("a way of waypoints and the world's own route are said as they are", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  await v.takeControl();
  await v.go("Map");
  await v.button("Route").click();
  await touch(v, [0.4, 0.5]);
  await touch(v, [0.5, 0.5]);
  await touch(v, [0.6, 0.5]);
  await v.button("Take the last one back").click();
  await v.button("Loop").click();
  await v.button("Drive 2 waypoints").click();
  const goal = (await robot.bus.hears("ML_CMD_GOAL")) as { waypoints: object[]; loop: boolean };
  deepEqual([goal.waypoints.length, goal.loop], [2, true]);
  await v.button("Cancel goal").click();
  await v.text(/^Cancelled/).waitFor();
  robot.bus.forget();
  await v.button("Drive to…").click();
  await v.page.getByRole("dialog", { name: "Drive to" }).getByText("route of 12 waypoints, repeated").waitFor();
  await v.button("patrol").click();
  const route = (await robot.bus.hears("ML_CMD_GOAL")) as { waypoints: object[]; loop: boolean };
  deepEqual([route.waypoints.length, route.loop], [12, true]);
  await v.text(/^patrol: waypoint \d+ of 12$/).waitFor();
  await v.button("Cancel goal").click();
  await v.text(/^Cancelled/).waitFor();
});

scene("a named place is driven to from the drive view of a phone, with its progress, and cancelled there", async ({ robot, visit }) => {
  const v = await visit({ profile: "phone", as: "operator" });
  await v.takeControl();
  const card = v.card("Destination");
  await v.press(card.getByRole("button", { name: "Drive to…" }));
  await v.press(v.button("upper left"));
  const goal = (await robot.bus.hears("ML_CMD_GOAL")) as { waypoints: { x: number; y: number }[]; loop: boolean };
  deepEqual([goal.waypoints.map(({ x, y }) => [x, y]), goal.loop], [[[3, 10]], false]);
  await card.getByText("upper left: waypoint 1 of 1").waitFor();
  await v.press(card.getByRole("button", { name: "Cancel goal" }));
  await card.getByText(/^Cancelled/).waitFor();
  equal(await card.getByRole("progressbar").count(), 0);
});

scene("on a phone no button lies on the map, and all of them are in sight", async ({ visit }) => {
  const v = await visit({ profile: "phone", as: "operator" });
  await v.go("Map");
  const box = async (what: Locator) => {
    const found = await what.boundingBox();
    if (!found) throw new Error("it is not to be seen");
    return found;
  };
  const [canvas, main] = [await box(v.page.locator("canvas.map-canvas")), await box(v.page.locator("main"))];
  const names = ["Nearer", "Farther", "Show all", "Follow the robot", "Take control", "Drive to…", "Go to", "Route", "Set position"];
  for (const what of [...names.map((name) => v.page.getByRole("region", { name: "Map" }).getByRole("button", { name, exact: true })), v.page.locator(".map-layers summary")]) {
    const { x, y, width, height } = await box(what);
    ok(y >= canvas.y + canvas.height || y + height <= canvas.y, `${await what.textContent()} is on the map`);
    ok(x >= 0 && x + width <= 390 && y + height <= main.y + main.height, `${await what.textContent()} is out of sight`);
  }
});

scene("the map has words for who does not see it", async ({ robot, visit }) => {
  const v = await visit();
  await v.go("Map");
  const { x } = robot.bus.truth();
  const words = await until("position in words", 20, async () => /At (-?[0-9.]+), /.exec((await v.page.locator(".map-words").textContent()) ?? ""));
  ok(Math.abs(Number(words[1]) - x) < 0.5, words[0]);
  match((await v.page.locator("canvas.map-canvas").getAttribute("aria-label")) ?? "", /^Map\. At /);
});

scene("each layer of the map is on or off, and stays so; people are shown where they are", async ({ robot, visit }) => {
  const v = await visit();
  await v.go("Map");
  await until("people are told", 15, () => ((robot.bus.last["SIM_DATA_PEOPLE"] as { x?: number[] } | undefined)?.x?.length ?? 0) > 0);
  const ink = () => v.page.locator("canvas.map-canvas").evaluate((canvas: HTMLCanvasElement) => canvas.toDataURL());
  await v.page.locator(".map-layers summary").click();
  const people = v.page.getByRole("checkbox", { name: /^people \(simulation\)/ });
  ok(await people.isChecked());
  ok(!(await v.page.getByRole("checkbox", { name: /^sonar/ }).isChecked()), "the fans of the sonars cover the plan");
  const before = await ink();
  await people.uncheck();
  await until("the picture changes", 5, async () => (await ink()) !== before);
  await v.page.reload();
  await v.page.locator(".map-layers summary").click();
  ok(!(await people.isChecked()), "kept on this device");
}, ["world.people=5"]);

for (const profile of PROFILES) {
  scene(`a distance is measured by taps, which command nothing; for who watches, too (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile });
    await v.go("Map");
    await v.press(v.button("Measure"));
    const said = v.page.getByRole("group", { name: "Measure" }).getByRole("status");
    await touch(v, [0.3, 0.3]);
    await touch(v, [0.6, 0.3]);
    const metres = async () => Number(/^([0-9.]+) m/.exec((await said.textContent()) ?? "")?.[1]);
    const first = await metres();
    ok(first > 2 && first < 20, `${first} m`);
    match((await said.textContent()) ?? "", /to 0°/);
    await touch(v, [0.6, 0.6]);
    ok((await metres()) > first + 1);
    await v.press(v.button("Take the last one back"));
    equal(await metres(), first);
    await v.press(v.button("Done"));
    deepEqual([v.said, robot.bus.commands], [[], []], "nothing was commanded");
  });
}

scene("a control that lacks control alone offers to take it, and does then what was pressed", async ({ visit }) => {
  const v = await visit({ profile: "phone", as: "operator" });
  await v.go("Map");
  await v.button("Go to").click({ force: true });
  await v.press(v.button("Take control and continue"));
  await v.page.getByRole("form", { name: "Place on the map" }).waitFor();
  deepEqual(v.said.map(({ type }) => type), ["take"]);
});

scene("mode and speed limit are set from the map; without a home place it does not go home", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  await v.takeControl();
  await v.go("Map");
  await v.button("Mode: Wait").click();
  const command = (await robot.bus.hears("ML_CMD_MODE")) as { mode: number; source: string };
  deepEqual([command.mode, command.source.startsWith("web:")], [2, true]);
  await v.text(/^Mode: Wait, waits for people\.$/).waitFor();
  equal(await v.button("Mode: Wait").getAttribute("aria-pressed"), "true");
  equal(await v.button("Mode: Home").getAttribute("aria-disabled"), "true");
  const summary = v.page.locator(".map-parameters summary");
  await summary.click();
  await v.page.getByRole("slider", { name: /^Speed limit/ }).fill("0.3");
  const change = (await robot.bus.hears("ML_CMD_PARAMETER")) as { parameter: string; value: number };
  deepEqual([change.parameter, change.value], ["speed_mps", 0.3]);
  await until("the robot shows it", 5, async () => (await summary.textContent())?.includes("0.30 m/s"));
  await v.button("Mode: Route").click();
  await until("it is in route", 5, async () => (await v.button("Mode: Route").getAttribute("aria-pressed")) === "true");
});

for (const profile of PROFILES) {
  scene(`a scenario is drawn, taken back and downloaded (${profile})`, async ({ visit }) => {
    const v = await visit({ profile, as: "engineer" });
    await v.go("Map");
    await v.press(v.button("Edit the scenario"));
    const text = async (): Promise<string> => {
      const [file] = await Promise.all([v.page.waitForEvent("download"), v.press(v.button("Download"))]);
      equal(file.suggestedFilename(), "scenario.toml");
      return readFile(await file.path(), "utf8");
    };
    const world = await text();
    match(world, /^start = /m);
    await v.press(v.button("Box"));
    await touch(v, [0.5, 0.5], [0.6, 0.6]);
    await v.press(v.button("Person"));
    await touch(v, [0.7, 0.3]);
    const drawn = await text();
    ok(drawn.startsWith(world) && drawn.includes("[[boxes]]") && drawn.includes("[[walkers]]"), drawn.slice(world.length));
    await v.press(v.button("Remove"));
    ok(!(await text()).includes("[[walkers]]"), "the person was chosen");
    await v.press(v.button("Undo"));
    equal(await text(), drawn);
    // This simulation is one in real time.
    await v.text(/advee up --sim --speed 1 --world/).waitFor();
    await v.press(v.button("Close the editor"));
    await v.button("Edit the scenario").waitFor();
  });
}
