// Stop: in the same place on every view, for every operator, and what comes after it.
import { deepEqual, equal, match, ok } from "node:assert/strict";
import { HOLD } from "../src/numbers";
import { PROFILES } from "./support/browser";
import { scene } from "./support/scene";
import { until } from "./support/until";

const VIEWS = ["Drive", "Map", "Modules", "Errors", "Sensors", "Power", "Buses", "Messages", "Logs", "Simulator", "This device"];

for (const profile of PROFILES) {
  scene(`Stop stands in the same place on every view, and stops from each without control (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "operator" });
    let place: object | null = null;
    for (const view of VIEWS) {
      await v.go(view);
      const box = await v.stop.boundingBox();
      ok(box && box.width >= 48 && box.height >= 48, `${view}: large enough`);
      deepEqual(box, (place ??= box), `${view}: in the same place`);
      await v.press(v.stop);
      await v.shows("Stopped");
      await until("the quick stop is held", 10, () => robot.bus.stands(HOLD.ModulePaused));
      await robot.goOn();
      await v.stop.waitFor();
    }
    deepEqual([...new Set(v.said.map(({ type }) => type))], ["stop"]);
  });
}

for (const profile of PROFILES) {
  scene(`Stop while driving: at once; it is held until a slide lets it go on (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "operator" });
    await v.takeControl();
    if (profile === "desktop") {
      await v.driveByKey("ArrowUp");
      await v.page.keyboard.press(" ");
      await robot.bus.stops();
      await v.page.keyboard.up("ArrowUp");
    } else {
      const hand = await v.drive();
      const box = await v.stop.boundingBox();
      ok(box);
      await hand.also(box.x + box.width / 2, box.y + box.height / 2);
      await robot.bus.stops();
      await hand.up();
    }
    await v.shows("Stopped");
    match((await v.reason.textContent()) ?? "", /operator stopped it/);
    match((await v.pad.textContent()) ?? "", /stopped. Resume first/);
    robot.bus.forget();
    const vain = await v.hold();
    await robot.bus.silent();
    equal(robot.bus.driven().length, 0, "a stopped robot is not driven");
    await vain.up();
    const on = v.page.locator(".stop").getByRole("slider", { name: /^Resume/ });
    await v.press(on);
    await v.slide(/^Resume/, 0.5);
    equal(v.said.filter(({ type }) => type === "resume").length, 0, "half a slide is none");
    const box = await on.boundingBox();
    const track = await on.locator("..").boundingBox();
    ok(box && track);
    const hand = v.hand();
    await hand.down(box.x + box.width / 2, box.y + box.height / 2);
    await hand.move(track.x + track.width - 2, box.y + box.height / 2);
    await hand.up();
    await v.stop.waitFor();
    await until("it may go on", 10, () => !robot.bus.stands(HOLD.ModulePaused));
    equal(robot.bus.driven().length, 0, "and does nothing by itself");
    const again = await v.drive(-0.8);
    await again.up();
    await robot.bus.stops();
  });
}

scene("Space and Escape stop from anywhere; in a text Space is a blank, and Escape still stops", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  await v.go("Logs");
  const text = v.page.getByLabel("Marker: what happens now");
  await text.fill("a");
  await text.press(" ");
  await text.press("b");
  equal(await text.inputValue(), "a b");
  equal(v.said.length, 0);
  await text.press("Escape");
  await v.shows("Stopped");
  await robot.goOn();
  await v.stop.waitFor();
  await v.button("Stop recording").focus();
  await v.page.keyboard.press(" ");
  await v.shows("Stopped");
  deepEqual(v.said.map(({ type }) => type), ["stop", "stop"], "and Space pressed no button");
});

scene("another operator's Stop is told to all; one without control does not let it go on", async ({ visit }) => {
  const first = await visit({ as: "operator", name: "First" });
  const second = await visit({ as: "operator", name: "Second" });
  await first.takeControl();
  await second.stop.click();
  await first.shows("Stopped");
  await second.shows("Stopped");
  await second.page.locator(".stop").getByText("First has control and may resume.").waitFor();
  await first.page.locator(".stop").getByRole("slider", { name: /^Resume/ }).waitFor();
});

scene("one arrow key too many after a slide drives nothing; with the pad focused it drives", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  await v.takeControl();
  const { keyboard } = v.page;
  await keyboard.press("Escape");
  await v.shows("Stopped");
  await v.page.locator(".stop").getByRole("slider").focus();
  for (let n = 0; n < 8; n += 1) await keyboard.press("ArrowRight");
  await v.stop.waitFor();
  await until("it is resumed", 10, () => !robot.bus.stands(HOLD.ModulePaused));
  await keyboard.press("ArrowRight");
  deepEqual(v.said.filter(({ type }) => type === "drive"), []);
  await v.pad.focus();
  await v.driveByKey("ArrowUp");
  await keyboard.up("ArrowUp");
  await robot.bus.stops();
});
