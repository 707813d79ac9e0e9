// What the panels show is what the bus says, and their commands reach it.
import { deepEqual, equal, match, ok } from "node:assert/strict";
import { HOLD } from "../src/numbers";
import { PROFILES } from "./support/browser";
import { scene } from "./support/scene";
import { pass, until } from "./support/until";

for (const profile of PROFILES) {
  scene(`a module is paused and let run; its row follows (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "engineer" });
    await v.go("Modules");
    const row = v.row("driver_aux");
    await row.getByText("RUN", { exact: true }).waitFor();
    await v.press(v.page.getByRole("button", { name: "Details and commands of driver_aux" }));
    const dialog = v.page.getByRole("dialog", { name: "driver_aux" });
    await v.press(dialog.getByRole("button", { name: "Pause" }));
    deepEqual((await robot.bus.hears("CM_CMD_STATE"))["module"], "driver_aux");
    await dialog.getByText("PAUSE", { exact: true }).first().waitFor();
    await v.press(dialog.getByRole("button", { name: "Run" }));
    await dialog.getByText("RUN", { exact: true }).first().waitFor();
    await v.press(dialog.getByRole("button", { name: "Close" }));
    equal(await dialog.count(), 0);
  });
}

scene("the modules' table has processes as the watchdog has them, and how one ended in words", async ({ robot, visit }) => {
  const v = await visit({ as: "engineer" });
  await v.go("Modules");
  const pid = () => {
    const { processes } = robot.bus.last["CM_DATA_PROCESSES"] as unknown as { processes: { module: string; pid: number; restarts: number }[] };
    return processes.find(({ module }) => module === "driver_joydev")?.pid ?? 0;
  };
  const before = pid();
  await v.row("driver_joydev").getByText(String(before), { exact: true }).waitFor();
  ok(before > 1);
  process.kill(before, "SIGKILL");
  await until("it is started anew", 20, () => pid() !== before && pid() > 1);
  await v.row("driver_joydev").getByText(String(pid()), { exact: true }).waitFor();
  await v.row("driver_joydev").getByText(/kill/i).waitFor();
});

scene("what stops a critical module is confirmed by a slide", async ({ robot, visit }) => {
  const v = await visit({ as: "engineer" });
  await v.go("Modules");
  await v.page.getByRole("button", { name: "Details and commands of driver_power" }).click();
  const dialog = v.page.getByRole("dialog", { name: "driver_power" });
  equal(await dialog.getByRole("button", { name: /Pause|Stop|Terminate/ }).count(), 0, "no button does it");
  await dialog.getByRole("slider", { name: /^Pause driver_power/ }).click();
  await v.slide(/^Pause driver_power/, 0.6);
  await pass(200);
  deepEqual(v.said, []);
  await v.slide(/^Pause driver_power/);
  await dialog.getByText("PAUSE", { exact: true }).first().waitFor();
  await dialog.getByRole("button", { name: "Run" }).click();
  await dialog.getByText("RUN", { exact: true }).first().waitFor();
  await until("it runs", 10, () => !robot.bus.stands(HOLD.CriticalModule));
});

for (const profile of PROFILES) {
  scene(`a power channel is switched off by a slide, and on again (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "engineer" });
    await v.go("Power");
    const row = v.row("monitor");
    await row.getByText("on", { exact: true }).waitFor();
    await v.press(v.button("Switch monitor"));
    await v.slide(/^Switch monitor off/);
    await robot.bus.hears("LL_CMD_POWER");
    await row.getByText("off", { exact: true }).waitFor();
    await v.press(v.button("Switch monitor"));
    await v.press(v.button("Switch on"));
    await row.getByText("on", { exact: true }).waitFor();
  });
}

scene("battery, temperatures and fans are shown with figures", async ({ visit }) => {
  const v = await visit();
  await v.go("Power");
  const all = await until("figures", 15, async () => /\d.* V[\s\S]*°C/.exec((await v.page.locator("main").innerText()) ?? ""));
  match(all[0], /°C/);
  match(await v.page.locator("main").innerText(), /fan/i);
});

scene("buses and drives: nodes with their figures, NMT and CiA 402 in words; an object is read", async ({ visit }) => {
  const v = await visit({ as: "engineer" });
  await v.go("Buses");
  for (const name of ["so1", "sd1_front", "sd1_rear", "sbs1", "psc1"]) await v.row(name).waitFor();
  const drive = v.card("Drive: propulsion");
  await drive.getByText(/operational/i).first().waitFor();
  await drive.getByText(/^0x[0-9a-f]{4}/i).first().waitFor();
  await v.page.getByLabel("Index, hex").fill("1000");
  await v.page.getByLabel("Sub-index").fill("0");
  await v.button("Read").click();
  const result = v.row("node 1, 0x1000:0").locator("b.figure");
  await result.waitFor();
  // CiA 402 drives say 402 in the lower half.
  equal(Number((await result.textContent())?.replace(/\D/g, "")) & 0xffff, 402);
  await v.page.getByLabel("Index, hex").fill("5fff");
  await v.button("Read").click();
  await v.row("node 1, 0x5FFF:0").or(v.row("node 1, 0x5fff:0")).getByText(/0x06020000|not exist/i).first().waitFor();
});

scene("sensors are shown with distance and age", async ({ visit }) => {
  const v = await visit();
  await v.go("Sensors");
  await v.page.locator("main").getByText(/ m$/).first().waitFor();
  ok((await v.page.getByRole("row").count()) >= 20, "sixteen sonars and four infrareds");
  await until("none is stale", 10, async () => (await v.page.locator("main .age.is-stale").count()) <= 1);
});

for (const profile of PROFILES) {
  scene(`the inspector shows a channel's fields live, and plots any (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile });
    await v.go("Messages");
    await v.page.getByPlaceholder("Channel or type").fill("SIM_DATA_TRUTH");
    await v.row("SIM_DATA_TRUTH").getByText(/Hz/).waitFor();
    deepEqual(await v.page.getByRole("rowheader", { name: /_\)$/ }).allTextContents(), ["Simulation (SIM_)"]);
    await v.press(v.row("SIM_DATA_TRUTH").getByRole("button"));
    const tree = v.page.getByRole("list", { name: "Fields of SIM_DATA_TRUTH" });
    const x = await tree.locator("li", { hasText: "x" }).locator("output").first().textContent();
    ok(Math.abs(Number(x?.replace("−", "-")) - robot.bus.truth().x) < 0.1, `${x}`);
    equal(await tree.locator("li", { hasText: /^speed/ }).locator(".p-unit").textContent(), "m/s");
    await v.press(tree.getByRole("button", { name: "Plot x", exact: true }));
    const plot = v.page.getByRole("img", { name: "Course of SIM_DATA_TRUTH x" });
    await plot.locator("canvas").waitFor();
    // The line grows: the picture of it changes.
    const ink = () => plot.locator("canvas").evaluate((canvas: HTMLCanvasElement) => canvas.toDataURL());
    const before = await ink();
    await until("the plot goes on", 10, async () => (await ink()) !== before);
    // A second unit has an axis of its own.
    equal(await plot.locator(".u-axis").count(), 2, "time, and metres");
    await v.press(tree.getByRole("button", { name: "Plot theta", exact: true }));
    const both = v.page.getByRole("img", { name: "Course of SIM_DATA_TRUTH x, SIM_DATA_TRUTH theta" });
    await both.locator(".u-axis").nth(2).waitFor();
    if (profile === "desktop") {
      await both.locator(".u-over").hover();
      await v.page.getByText(/^Values [0-9.]+ s ago:/).waitFor();
    }
  });
}

for (const profile of PROFILES) {
  scene(`an engineer with control publishes a message, and nothing that moves the robot (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "engineer" });
    await v.go("Messages");
    await v.press(v.button("Publish…").first());
    const dialog = v.page.getByRole("dialog", { name: "Publish a message" });
    const [channel, text, why] = [dialog.getByLabel("Channel"), dialog.getByLabel("Message", { exact: true }), dialog.locator(".p-note")];
    await channel.fill("CM_CMD_LOG");
    deepEqual(JSON.parse(await text.inputValue()), { action: 0, text: "" }, "without the time, which the robot sets");
    await why.getByText("Nobody has control. Take control first.").waitFor();
    await v.press(dialog.getByRole("button", { name: "Take control" }));
    await text.fill('{ "action": 2, "text": 5 }');
    await v.slide(/^Publish on CM_CMD_LOG/);
    await v.page.getByText("Text: expected a text, found a number.").waitFor();
    await text.fill('{ "action": 2, "text": "by hand" }');
    await v.slide(/^Publish on CM_CMD_LOG/);
    const mark = await robot.bus.hears("CM_CMD_LOG");
    deepEqual([mark["action"], mark["text"]], [2, "by hand"]);
    ok((mark["timestamp"] as number) > 1.6e15, "the robot's time");
    // A channel of motion that is typed all the same: the robot refuses it.
    await channel.fill("LL_CMD_VELOCITY");
    await dialog.getByLabel("Type of its messages").fill("lowlevel.cmd_velocity_t");
    await text.fill('{ "vx": 0.2, "vy": 0, "omega": 0, "priority": 3, "session": 1 }');
    await v.slide(/^Publish on LL_CMD_VELOCITY/);
    await v.page.getByText(/^It moves the robot, or releases it from a stop/).waitFor();
    await pass(200);
    deepEqual(robot.bus.said("LL_CMD_VELOCITY"), []);
    deepEqual(v.said.filter(({ type }) => type === "publish").length, 3);
    const [above, below] = [await dialog.boundingBox(), await v.page.locator(".toast").last().boundingBox()];
    ok(above && below && above.y + above.height <= below.y, "the notice is below the dialog");
    await v.press(dialog.getByRole("button", { name: "Close" }));
  });
}

scene("who is no engineer publishes nothing, and a message begins as the last one of its channel was", async ({ visit }) => {
  const operator = await visit({ as: "operator", name: "no engineer" });
  await operator.go("Messages");
  await operator.page.getByPlaceholder("Channel or type").waitFor();
  equal(await operator.button("Publish…").count(), 0);
  const v = await visit({ as: "engineer" });
  await v.go("Messages");
  await v.page.getByPlaceholder("Channel or type").fill("SIM_DATA_CLOCK");
  await v.press(v.row("SIM_DATA_CLOCK").getByRole("button"));
  await v.page.getByRole("list", { name: "Fields of SIM_DATA_CLOCK" }).waitFor();
  await v.press(v.card("SIM_DATA_CLOCK").getByRole("button", { name: "Publish…" }));
  const text = await v.page.getByRole("dialog", { name: "Publish a message" }).getByLabel("Message", { exact: true }).inputValue();
  ok((JSON.parse(text) as { rate: number }).rate > 0, text);
});

scene("errors are grouped, with count and when they were seen, and whether they stand", async ({ robot, visit }) => {
  const v = await visit();
  await robot.fault("sd1_rear", "silent");
  await v.go("Errors");
  const row = v.page.getByRole("row").filter({ hasText: "sd1_rear" }).filter({ hasText: "driver_rs485a" }).first();
  await row.getByText("active", { exact: true }).waitFor();
  await v.page.getByRole("navigation").getByText(/to look at/).first().waitFor({ state: "attached" });
  await row.getByRole("button").click();
  const dialog = v.page.getByRole("dialog", { name: /BoardLost|sd1_rear/ });
  await dialog.getByText("Its reports").waitFor();
  await dialog.getByRole("link", { name: /^Play the run .* from this report on/ }).waitFor();
  await dialog.getByRole("button", { name: "Close" }).click();
  await robot.advee("fault", "sd1_rear", "none");
  await row.getByText("cleared", { exact: true }).waitFor();
  await v.button("Active only").click();
  equal(await row.count(), 0);
});

scene("the steering is homed by the page", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  await v.takeControl();
  await v.slide(/^Home the steering anew/);
  deepEqual((await robot.bus.hears("LL_CMD_HOMING"))["axis"], "steering");
  await until("it homes", 10, () => !robot.bus.motion()?.homed);
  await v.card("Steering").getByText("homed", { exact: true }).waitFor({ timeout: 20_000 });
});

scene("the latest messages stand beside every view, and a channel opens from there", async ({ visit }) => {
  const v = await visit({ as: "engineer" });
  await v.press(v.page.getByRole("button", { name: "Recent", exact: true }));
  const list = v.page.getByRole("complementary", { name: "Recent messages" });
  const line = (channel: string) => list.getByRole("listitem").filter({ has: v.page.getByRole("button", { name: channel, exact: true }) });
  await list.getByRole("listitem").first().waitFor();
  await v.go("Modules");
  await v.press(v.page.getByRole("button", { name: "Details and commands of driver_aux" }));
  const dialog = v.page.getByRole("dialog", { name: "driver_aux" });
  await v.press(dialog.getByRole("button", { name: "Pause" }));
  await line("CM_CMD_STATE").first().getByText(/module driver_aux/).waitFor();
  await v.press(dialog.getByRole("button", { name: "Run" }));
  await v.press(dialog.getByRole("button", { name: "Close" }));
  await list.getByRole("searchbox").fill("cmd_state driver_aux");
  const all = list.getByRole("listitem");
  await until("only those that match", 5, async () => (await all.count()) === (await line("CM_CMD_STATE").count()));
  await v.press(line("CM_CMD_STATE").first().getByRole("button"));
  await v.page.getByRole("heading", { name: "CM_CMD_STATE" }).waitFor();
  await v.press(list.getByRole("button", { name: "Close" }));
  equal(await list.count(), 0);
});
