// One holder of control at a time, whom all see; taking over is a gesture, and the loser is told.
import { deepEqual, equal, match } from "node:assert/strict";
import { scene } from "./support/scene";
import { pass, until } from "./support/until";

scene("control is taken over by a slide that names who has it; the loser stops and is told", async ({ robot, visit }) => {
  const phone = await visit({ profile: "phone", as: "operator", name: "Jana's phone" });
  const desk = await visit({ as: "operator", name: "Petr's desk" });
  await phone.takeControl();
  const chip = desk.page.locator(".chip.control");
  await until("the desk sees who has control", 5, async () => (await chip.textContent())?.includes("Jana's phone has control"));
  const hand = await phone.drive();
  await until("and that it drives", 5, async () => (await chip.textContent())?.includes("Jana's phone drives"));
  match((await desk.pad.textContent()) ?? "", /Jana's phone has control/);
  // A tap, and half of the way, are not enough.
  const label = /^Take over from Jana's phone/;
  await desk.page.getByRole("slider", { name: label }).click();
  await desk.slide(label, 0.7);
  await pass(300);
  equal(desk.said.filter(({ type }) => type === "take").length, 0);
  await desk.slide(label);
  await desk.page.getByText("You have control", { exact: true }).first().waitFor();
  await robot.bus.stops();
  await phone.page.getByRole("alert").filter({ hasText: /You have no control any more.*Petr's desk/ }).waitFor();
  await hand.move(hand.x, hand.y - hand.half * 0.5);
  await robot.bus.silent();
  await hand.up();
  robot.bus.forget();
  await desk.driveByKey("ArrowDown", false);
  await desk.page.keyboard.up("ArrowDown");
  await robot.bus.stops();
  await desk.button("Release control").click();
  await until("nobody has control", 5, async () => (await phone.page.locator(".chip.control").getAttribute("title"))?.includes("Nobody has control"));
});

scene("two pages of one device are two; control ends with the page that has it", async ({ visit }) => {
  const first = await visit({ as: "engineer" });
  await first.takeControl();
  const second = await visit({ as: "engineer" });
  await second.page.getByRole("slider", { name: /^Take over from/ }).waitFor();
  await first.page.goto("about:blank");
  await second.button("Take control").first().waitFor();
  equal(second.said.length, 0, "nothing is taken by itself");
});

scene("who has no control commands no motion: goals, positions and homing wait, and say why", async ({ robot, visit }) => {
  const v = await visit({ as: "engineer" });
  for (const name of ["Go to", "Route", "Set position"]) {
    const button = v.button(name);
    equal(await button.getAttribute("aria-disabled"), "true", name);
    const why = await v.page.locator(`[id="${await button.getAttribute("aria-describedby")}"]`).textContent();
    match(why ?? "", /Nobody has control/);
    await button.click({ force: true });
  }
  await v.slide(/^Home the steering anew/);
  deepEqual([v.said, robot.bus.commands], [[], []], "nothing was commanded");
});
