// Who may what: pairing by link and by code, watching, and who is paired.
import { deepEqual, equal, match, ok } from "node:assert/strict";
import { NAME, PROFILES } from "./support/browser";
import { scene } from "./support/scene";
import { until } from "./support/until";

for (const profile of PROFILES) {
  scene(`the link of \`advee web code\` pairs, and the code stays in no address (${profile})`, async ({ robot, visit }) => {
    const codes = await robot.codes();
    const v = await visit({ profile, path: `/#${codes.engineer}` });
    equal(new URL(v.page.url()).hash, "#/access", "the code is gone from the address");
    await v.page.getByLabel("Name of this device").fill(`Ada's ${profile}`);
    await v.press(v.button("Pair"));
    await v.page.getByText("This device is paired.").waitFor();
    await v.go("This device");
    await v.card(`Ada's ${profile}`).getByText("engineer", { exact: true }).waitFor();
    const cookie = (await v.context.cookies()).find(({ name }) => name === `advee-${v.proxy.port}`);
    ok(cookie?.httpOnly && cookie.sameSite === "Strict", "the session is nobody's but the browser's");
    await v.page.reload();
    await v.card(`Ada's ${profile}`).getByText("engineer", { exact: true }).waitFor();
    await v.press(v.button("End the pairing"));
    await v.card("Pair this device").getByText("viewer", { exact: true }).waitFor();
  });
}

scene("the operator's code pairs when it is typed; a wrong one is refused in words", async ({ robot, visit }) => {
  const v = await visit({ path: "/#/access", complaints: /403/ });
  const code = v.page.getByLabel("Code from the robot's console");
  await code.fill("1234");
  await v.button("Pair").click();
  await v.page.getByRole("alert").filter({ hasText: "eight digits" }).waitFor();
  const { operator, engineer } = await robot.codes();
  const wrong = ["00000000", "00000001", "00000002"].find((each) => each !== operator && each !== engineer) ?? "";
  await code.fill(wrong);
  await v.button("Pair").click();
  await v.page.getByRole("alert").filter({ hasText: /not a code/ }).waitFor();
  await code.fill(`${operator.slice(0, 4)} ${operator.slice(4)}`);
  await v.page.getByLabel("Name of this device").fill("Desk");
  await v.button("Pair").click();
  await v.button("Take control").waitFor();
  match(new URL(v.page.url()).hash, /drive/);
});

for (const profile of PROFILES) {
  scene(`who is not paired sees all, commands nothing, and is told why (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile });
    await v.shows("Ready");
    await v.live();
    equal(await v.pad.count(), 0, "no pad");
    await v.card("You are watching").getByText("enter the code from the robot's console").waitFor();
    await v.go("Map");
    equal(await v.button("Go to").count(), 0);
    await v.go("Modules");
    await v.press(v.page.getByRole("button", { name: "Details and commands of driver_aux" }));
    const run = v.page.getByRole("dialog").getByRole("button", { name: "Run", exact: true });
    equal(await run.getAttribute("aria-disabled"), "true");
    const why = await v.page.locator(`[id="${await run.getAttribute("aria-describedby")}"]`).textContent();
    match(why ?? "", /engineer|pair/i);
    await run.click({ force: true });
    await v.press(v.button("Close").first());
    await v.go("Logs");
    equal(await v.button("Set marker").getAttribute("aria-disabled"), "true");
    // The Stop is there, and explains.
    await v.press(v.stop);
    await v.page.getByRole("dialog", { name: "You are watching" }).getByText("red button on the robot").waitFor();
    deepEqual(v.said, [], "the page said nothing");
    deepEqual(robot.bus.commands, [], "nothing was commanded");
    await v.press(v.page.getByRole("dialog").getByRole("link", { name: "Pair this device" }));
    await v.page.getByLabel("Code from the robot's console").waitFor();
  });
}

scene("an engineer shows a phone a QR code; its link pairs the phone as an operator's", async ({ visit }) => {
  // As a page that other devices reach: at the robot's name.
  const v = await visit({ as: "engineer", host: NAME });
  await v.go("This device");
  await v.press(v.button("Show a code"));
  const dialog = v.page.getByRole("dialog", { name: "Pair another device" });
  const picture = dialog.getByRole("img", { name: /^QR code/ });
  await picture.waitFor();
  const side = Number((await picture.getAttribute("viewBox"))?.split(" ")[2]);
  ok(side >= 29 && side <= 45, `${side} modules with the margin`);
  ok(((await picture.locator("path").getAttribute("d")) ?? "").startsWith("M4 4h7v1h-7z"), "the first row of a corner");
  const link = new URL((await dialog.locator(".qr-link").textContent()) ?? "");
  equal(link.origin, v.origin);
  const phone = await visit({ profile: "phone", path: `/${link.hash}` });
  await phone.page.getByLabel("Name of this device").fill("New phone");
  await phone.press(phone.button("Pair"));
  await phone.button("Take control").waitFor();
  await v.press(v.button("Close").first());
  await v.row("New phone").getByText("operator", { exact: true }).waitFor();
}, [`web.hosts=["${NAME}"]`]);

scene("where a phone does not reach the page there is the code alone", async ({ robot, visit }) => {
  const v = await visit({ profile: "phone", as: "engineer" });
  await v.go("This device");
  await v.press(v.button("Show a code"));
  const dialog = v.page.getByRole("dialog", { name: "Pair another device" });
  await dialog.getByText("A phone does not reach this address").waitFor();
  equal(await dialog.getByRole("img").count(), 0);
  const { operator } = await robot.codes();
  equal(await dialog.locator(".code").textContent(), `${operator.slice(0, 4)} ${operator.slice(4)}`);
});

scene("an engineer sees who is paired, and forgets one: its page watches from then on", async ({ visit }) => {
  const phone = await visit({ profile: "phone", as: "operator", name: "Lost phone", complaints: /40[13]|WebSocket/ });
  await phone.takeControl();
  const desk = await visit({ as: "engineer" });
  await desk.go("This device");
  await desk.row("Lost phone").getByText("connected").waitFor();
  await desk.row("desktop engineer (this one)").waitFor();
  const thumb = desk.row("Lost phone").getByRole("slider");
  const [box, track] = [await thumb.boundingBox(), await thumb.locator("..").boundingBox()];
  ok(box && track);
  const hand = desk.hand();
  await hand.down(box.x + box.width / 2, box.y + box.height / 2);
  await hand.move(track.x + track.width, box.y + box.height / 2);
  await hand.up();
  await desk.row("Lost phone").waitFor({ state: "detached" });
  await phone.page.getByRole("heading", { name: "You are watching" }).waitFor();
  await until("its control is over", 5, async () => (await desk.page.locator(".chip.control").textContent())?.includes("Nobody has control"));
});
