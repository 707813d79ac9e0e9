// The panel of the simulation: something is broken and mended, and the robot is put elsewhere.
import { ok } from "node:assert/strict";
import { PROFILES } from "./support/browser";
import { scene } from "./support/scene";
import { until } from "./support/until";

for (const profile of PROFILES) {
  scene(`a bumper is pressed and let go in the simulation (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "engineer" });
    robot.breaks("psc1");
    await v.go("Simulator");
    await v.page.getByLabel("Target").selectOption("psc1");
    await v.page.locator("label.field", { hasText: /^Fault/ }).locator("select").selectOption("bumper");
    await v.page.getByLabel("For").selectOption("0");
    await v.press(v.button("Inject fault"));
    await v.shows("Paused");
    await v.press(v.button("End bumper of psc1"));
    await robot.release();
    await v.shows("Ready");
    ok(robot.bus.said("SIM_CMD_FAULT").length >= 2);
  });
}

scene("all faults are ended at once", async ({ robot, visit }) => {
  const v = await visit({ as: "engineer" });
  await robot.fault("psc1", "stop_button");
  await v.go("Simulator");
  await v.shows("Paused");
  await v.button("End all faults").click();
  await robot.release();
  await v.shows("Ready");
});

scene("the robot is carried elsewhere, and finds out where it is", async ({ robot, visit }) => {
  const v = await visit({ as: "engineer" });
  await v.go("Simulator");
  const before = robot.bus.truth();
  const x = before.x < 6 ? before.x + 1 : before.x - 1;
  await v.page.getByLabel("x, m").fill(x.toFixed(2));
  await v.page.getByLabel("y, m").fill(before.y.toFixed(2));
  await v.button("Put it there").click();
  await until("it is there", 10, () => Math.abs(robot.bus.truth().x - x) < 0.05);
  await robot.advee("pose", `${x.toFixed(2)},${before.y.toFixed(2)},${before.theta.toFixed(3)}`);
  await v.card("Truth and estimate").getByText("fine").waitFor({ timeout: 30_000 });
});
