// The recorder, its markers, the download of a run, and a run played on the page.
import { deepEqual, equal, match, ok } from "node:assert/strict";
import { PROFILES } from "./support/browser";
import { scene } from "./support/scene";
import { pass, until } from "./support/until";

/** What an MCAP file begins with. */
const MAGIC = Buffer.from([0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 0x0d, 0x0a]);

for (const profile of PROFILES) {
  scene(`a marker is set, and a run downloaded (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "operator" });
    await v.go("Logs");
    await v.page.getByLabel("Marker: what happens now").fill("the door opens");
    await v.press(v.button("Set marker"));
    const mark = await robot.bus.hears("CM_CMD_LOG");
    deepEqual([mark["action"], mark["text"]], [2, "the door opens"]);
    const { name, bytes } = await v.download();
    deepEqual(bytes.subarray(0, MAGIC.length), MAGIC);
    ok(bytes.length > 10_000);
    match(name, /^\d{4}_.*\.mcap$/);
  });
}

scene("the recorder is stopped and started", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  await v.go("Logs");
  const card = v.card("Recorder");
  await v.button("Stop recording").click();
  await card.getByText("not recording", { exact: true }).waitFor();
  await v.button("Start recording").click();
  await card.getByText("recording", { exact: true }).waitFor();
  deepEqual(robot.bus.said("CM_CMD_LOG").map(({ message }) => message["action"]), [0, 1]);
});

for (const profile of PROFILES) {
  scene(`a recorded run is played as if it were now, and commands nothing (${profile})`, async ({ robot, visit }) => {
    // Something to look at.
    await robot.advee("drive", "0.2", "0", "--for", "1");
    await pass(500);
    robot.bus.forget();
    const v = await visit({ profile, as: "engineer", path: "/?demo=1" });
    await v.page.getByRole("note").filter({ hasText: /Recorded run.*Nothing can be commanded/ }).waitFor();
    await until("the run is shown", 20, async () => !/Connecting|No contact/.test((await v.word.textContent()) ?? ""));
    await v.go("Map");
    await v.text(/^At -?[0-9.]+, /).waitFor();
    equal(await v.stop.count(), 0, "there is nothing to stop");
    await v.page.keyboard.press("ArrowUp");
    await v.page.keyboard.press(" ");
    await v.go("Drive");
    equal(await v.button("Take control").count(), 0);
    deepEqual(v.said, []);
    deepEqual(robot.bus.commands, []);
    await v.press(v.page.getByRole("link", { name: "Leave" }));
    await v.button("Take control").first().waitFor();
  });
}

for (const profile of PROFILES) {
  scene(`a recorded run has a time line: pause, jumps, marks, speeds, and a link to each moment (${profile})`, async ({ robot, visit }) => {
    const begun = await visit({ as: "operator" });
    await begun.go("Logs");
    const run = /\d{4}(_\d\d){5}/.exec((await begun.page.locator("a.p-download").first().getAttribute("href")) ?? "")?.[0] ?? "";
    await begun.page.getByLabel("Marker: what happens now").fill("the door opens");
    await begun.press(begun.button("Set marker"));
    await robot.advee("fault", "psc1", "bumper", "2", "--for", "1");
    await robot.release();
    await pass(1500);
    robot.bus.forget();
    const v = await visit({ profile, path: `/?demo=${run}&at=1#/map` });
    const bar = v.page.getByRole("slider", { name: "Moment of the run" });
    const at = async () => Number(await bar.inputValue());
    await until("it plays from the moment in the address on", 20, async () => (await at()) > 1.5);
    await v.press(v.button("Pause"));
    await until("it pauses", 5, async () => {
      const before = await at();
      await pass(400);
      return (await at()) === before;
    });
    await bar.fill("3");
    await until("it has jumped, and the address with it", 5, async () => new URL(v.page.url()).searchParams.get("at") === "3");
    await v.press(v.button("What happened"));
    const list = v.page.getByRole("dialog", { name: "What happened" });
    await list.getByText("the door opens").first().waitFor();
    await v.press(list.getByRole("button", { name: /PAUSE: bumper 2/ }).first());
    equal(await list.count(), 0);
    const there = await at();
    await v.press(v.button("Play"));
    await v.page.getByLabel("Speed", { exact: true }).selectOption("0.5");
    await v.page.locator(".status-word strong").filter({ hasText: "Paused" }).waitFor();
    ok((await at()) > there);
    await v.press(v.button("10 s back"));
    deepEqual(robot.bus.commands, []);
  });
}

scene("the picture of a run is drawn on demand", async ({ robot, visit }) => {
  await robot.advee("drive", "0.2", "0", "--for", "1");
  const v = await visit();
  await v.go("Logs");
  await v.page.getByRole("button", { name: /^Report of the run/ }).first().click();
  const picture = v.page.getByRole("dialog", { name: /^Report of/ }).getByRole("img");
  await picture.waitFor({ timeout: 60_000 });
  const size = await picture.evaluate(async (image: HTMLImageElement) => (await image.decode(), [image.naturalWidth, image.naturalHeight]));
  ok((size[0] ?? 0) > 500 && (size[1] ?? 0) > 300, String(size));
});

scene("a finished run is told in figures in the list", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  await robot.advee("drive", "0.3", "0", "--for", "2");
  await v.go("Logs");
  await v.button("Stop recording").click();
  await v.card("Recorder").getByText("not recording", { exact: true }).waitFor();
  const figures = v.page.locator(".p-figures").first();
  await figures.waitFor({ timeout: 60_000 });
  const [, metres] = /^[^,]+, ([0-9.]+) m, no contact/.exec((await figures.textContent()) ?? "") ?? [];
  ok(Number(metres) > 0.1, (await figures.textContent()) ?? "");
  await v.button("Start recording").click();
  await v.card("Recorder").getByText("recording", { exact: true }).waitFor();
});
