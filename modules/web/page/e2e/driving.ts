// The hand on the pad, the keys and the gamepad: while it is there the robot drives; whatever takes it off is zero at once,
// then silence, and nothing begins again by itself.
import { deepEqual, equal, match, ok } from "node:assert/strict";
import type { Visit } from "./support/browser";
import { PROFILES } from "./support/browser";
import { scene } from "./support/scene";
import { pass, until } from "./support/until";

for (const profile of PROFILES) {
  scene(`the pad drives while it is held, at 20 Hz; let go it is zero at once, then silence (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "operator" });
    if (profile === "desktop") {
      await v.pad.getByText("Nobody has control").waitFor();
      const early = await v.hold();
      await early.up();
      deepEqual(v.said, [], "without control the pad says nothing");
    }
    await v.takeControl();
    const hand = await v.drive();
    await v.shows("Driving");
    match((await v.reason.textContent()) ?? "", /\(web\)/);
    const driven = robot.bus.driven();
    deepEqual([...new Set(driven.map(({ source }) => source))], [`web:${profile} operator`]);
    // To the left and back: steering follows.
    await hand.move(hand.x - hand.half * 0.6, hand.y - hand.half * 0.5);
    await until("it steers to the left", 5, () => (robot.bus.driven().at(-1)?.steering ?? 0) > 0.1);
    const from = robot.bus.driven().length;
    await pass(2000);
    const rate = (robot.bus.driven().length - from) / 2;
    ok(rate > 15 && rate <= 21, `${rate} commands a second`);
    await hand.up();
    await robot.bus.stops();
    await v.gaveZero();
  });
}

for (const profile of PROFILES) {
  scene(`backwards, too; slow is a third of what is allowed (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "operator" });
    await v.takeControl();
    const most = async () => {
      const hand = await v.drive(-1.2);
      const speed = robot.bus.driven().at(-1)?.speed ?? 0;
      await hand.up();
      await robot.bus.stops();
      return -speed;
    };
    const slow = await most();
    await v.press(v.button(/^Normal/));
    robot.bus.forget();
    const normal = await most();
    ok(Math.abs(normal / slow - 3) < 0.1, `${slow} and ${normal} m/s`);
  });
}

scene("on a phone there is the map from behind the robot until control is taken, and then the pad", async ({ visit }) => {
  const v = await visit({ profile: "phone", as: "operator" });
  const strip = v.page.getByRole("img", { name: /^Map from behind the robot\. At .*fine/ });
  await strip.waitFor();
  equal(await v.pad.isVisible(), false);
  const box = await strip.boundingBox();
  ok(box && box.height > 0.4 * 844 && box.y + box.height < 844 - 130, "half of the screen, and all of it above Stop");
  // The robot in its colour is where it is drawn: on the middle line, below the middle.
  const colour = await strip.evaluate((canvas) => {
    const { width, height } = canvas as HTMLCanvasElement;
    const [r, g, b] = (canvas as HTMLCanvasElement).getContext("2d")?.getImageData(width / 2 + 0.03 * width, 0.66 * height, 1, 1).data ?? [];
    return [r, g, b];
  });
  deepEqual(colour, [10, 95, 180]);
  await v.takeControl();
  await v.pad.waitFor();
  equal(await strip.isVisible(), false);
  const [status, notices] = await v.page.evaluate(() => ["header.status", ".toasts"].map((each) => document.querySelector(each)?.getBoundingClientRect()));
  ok(status && notices && status.bottom <= 200 && notices.top >= status.bottom, `notices from ${notices?.top} on, the status to ${status?.bottom}`);
  await v.press(v.button("Release control"));
  await strip.waitFor();
});

scene("a second finger on the pad ends it, and neither drives on", async ({ robot, visit }) => {
  const v = await visit({ profile: "phone", as: "operator" });
  await v.takeControl();
  const hand = await v.drive();
  await hand.also(hand.x + 40, hand.y);
  await robot.bus.stops();
  await hand.up();
  await v.text("A second finger was on the pad.").waitFor();
  await robot.bus.silent();
});

scene("a touch that the system takes away ends it", async ({ robot, visit }) => {
  const v = await visit({ profile: "phone", as: "operator" });
  await v.takeControl();
  const hand = await v.drive();
  await hand.lose();
  await robot.bus.stops();
  await v.gaveZero();
});

scene("a pointer that is lost ends it, though its button is still down", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  await v.takeControl();
  const hand = await v.drive();
  await v.pad.evaluate((pad) => {
    for (let id = 0; id < 100; id += 1) if (pad.hasPointerCapture(id)) pad.releasePointerCapture(id);
  });
  await robot.bus.stops();
  await hand.move(hand.x, hand.y - hand.half * 0.4);
  await robot.bus.silent();
  await hand.up();
});

scene("arrow keys and WASD drive while they are held", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  await v.takeControl();
  const { keyboard } = v.page;
  await v.driveByKey("ArrowUp");
  await keyboard.down("ArrowLeft");
  await until("it steers to the left", 5, () => (robot.bus.driven().at(-1)?.steering ?? 0) > 0.1);
  await keyboard.up("ArrowLeft");
  await keyboard.up("ArrowUp");
  await robot.bus.stops();
  robot.bus.forget();
  await v.driveByKey("s", false);
  await keyboard.up("s");
  await robot.bus.stops();
});

scene(
  "a base that can goes sideways by Q and E, and by the pad, and the status shows it",
  async ({ robot, visit }) => {
    const v = await visit({ as: "operator" });
    await v.takeControl();
    const { bus } = robot;
    const start = bus.truth();
    /** How far it has gone to its left and ahead since the start, m. */
    const gone = () => {
      const [dx, dy, { theta }] = [bus.truth().x - start.x, bus.truth().y - start.y, start];
      return { left: dy * Math.cos(theta) - dx * Math.sin(theta), ahead: dx * Math.cos(theta) + dy * Math.sin(theta) };
    };
    const speed = v.page.getByRole("list", { name: "Speed, position, battery" }).getByText(/^Speed [\d.]+/);
    const goes = async () => {
      await v.shows("Driving");
      await until("the status shows the speed", 5, async () => Number(/[\d.]+/.exec((await speed.textContent()) ?? "")?.[0]) > 0.05);
    };
    const { keyboard } = v.page;
    for (const [key, side] of [["q", 1], ["e", -1]] as const) {
      bus.forget();
      const before = gone();
      // Should a busy machine have let the first press go, it is pressed anew.
      for (await keyboard.down(key); !(await bus.goesSideways(side)); await keyboard.down(key)) await keyboard.up(key);
      await goes();
      await until(`it has gone to side ${side}`, 10, () => side * (gone().left - before.left) > 0.2);
      await keyboard.up(key);
      await bus.endsSideways();
      ok(Math.abs(gone().ahead - before.ahead) < 0.1, `${gone().ahead - before.ahead} m ahead`);
    }
    await v.press(v.button("Go sideways"));
    bus.forget();
    const aside = async () => {
      const hand = await v.hold(0);
      await hand.move(hand.x - hand.half * 0.6, hand.y);
      return hand;
    };
    let hand = await aside();
    while (!(await bus.goesSideways(1))) {
      await hand.up();
      hand = await aside();
    }
    await goes();
    await hand.up();
    await bus.endsSideways();
    await v.gaveZero();
    await v.shows("Ready");
  },
  [],
  "conf/porter",
);

scene("a gamepad drives while its shoulder button is held, and its going away is zero", async ({ robot, visit }) => {
  const v = await visit({
    as: "operator",
    before: () => {
      const button = () => ({ pressed: false, touched: false, value: 0 });
      const pad = { id: "Test pad (Vendor: 1)", index: 0, connected: true, mapping: "standard", axes: [0, 0, 0, 0], buttons: Array.from({ length: 17 }, button), timestamp: 0 };
      Object.assign(globalThis, { testPad: pad });
      navigator.getGamepads = () => [pad.connected ? (pad as unknown as Gamepad) : null];
    },
  });
  const pad = (change: { stick?: number; dead?: boolean; there?: boolean }) =>
    v.page.evaluate(({ stick, dead, there }) => {
      const { testPad } = globalThis as unknown as { testPad: { axes: number[]; buttons: { pressed: boolean }[]; connected: boolean } };
      if (stick !== undefined) testPad.axes[1] = -stick;
      if (dead !== undefined) testPad.buttons[4] = { pressed: dead };
      if (there !== undefined) testPad.connected = there;
    }, change);
  await v.takeControl();
  await v.text("Test pad: hold a shoulder button").waitFor();
  await pad({ stick: 0.9 });
  await robot.bus.silent(400);
  equal(robot.bus.driven().length, 0, "without the button it says nothing");
  await pad({ stick: 0 });
  await pad({ dead: true });
  await pass(100);
  await pad({ stick: 0.9 });
  await robot.bus.moves();
  await pad({ dead: false });
  await robot.bus.stops();
  robot.bus.forget();
  await pad({ stick: 0 });
  await pass(100);
  await pad({ dead: true });
  await pass(100);
  await pad({ stick: -0.9 });
  await robot.bus.moves(false);
  await pad({ there: false });
  await robot.bus.stops();
});

scene("a drive that is lost while the pad is held turns the pad off under the finger, with the reason; then it takes a new press", async ({ robot, visit }) => {
  const v = await visit({ profile: "phone", as: "operator" });
  await v.takeControl();
  const hand = await v.drive();
  await robot.fault("propulsion", "silent");
  await v.pad.getByText(/^The propulsion drive /).waitFor();
  await v.page.locator(".status-second").filter({ hasText: "the propulsion drive" }).waitFor();
  await robot.bus.stops();
  await robot.advee("fault", "propulsion", "none");
  await until("the pad is on again", 30, async () => (await v.pad.getAttribute("aria-disabled")) === "false");
  await hand.move(hand.x, hand.y - hand.half * 0.7);
  await robot.bus.silent();
  await hand.up();
  const again = await v.drive();
  await again.up();
  await robot.bus.stops();
});

/** What takes the page out of the hand. */
const GONE: [string, (v: Visit) => Promise<void>][] = [
  [
    "another tab in front",
    async (v) => {
      await v.cdp.send("Emulation.setFocusEmulationEnabled", { enabled: false });
      const other = await v.context.newPage();
      await other.bringToFront();
      await until("the page is hidden, or without the focus", 5, () => v.page.evaluate(() => document.hidden || !document.hasFocus()));
    },
  ],
  ["a page that lost the focus", (v) => v.page.evaluate(() => void dispatchEvent(new Event("blur")))],
  [
    "a page that is hidden",
    (v) =>
      v.page.evaluate(() => {
        Object.defineProperty(document, "hidden", { value: true, configurable: true });
        document.dispatchEvent(new Event("visibilitychange"));
      }),
  ],
  ["a page that is left", (v) => v.page.goto("about:blank").then(() => {})],
  ["a tab that is closed", (v) => v.page.close()],
  ["another view", (v) => v.page.evaluate(() => void (location.hash = "#/modules"))],
  ["another key beside it", (v) => v.page.keyboard.down("Control").then(() => v.page.keyboard.down("x"))],
];
for (const [name, leave] of GONE) {
  scene(`${name} is zero at once, and nothing resumes`, async ({ robot, visit }) => {
    const v = await visit({ as: "operator" });
    await v.takeControl();
    await v.driveByKey("ArrowUp");
    await leave(v);
    await robot.bus.stops();
    if (v.page.isClosed() || v.page.url() === "about:blank") return;
    // The key is still down, and says so again and again: that is no new press.
    await v.page.bringToFront();
    for (let n = 0; n < 5; n += 1) await v.page.keyboard.down("ArrowUp");
    await robot.bus.silent();
  });
}
