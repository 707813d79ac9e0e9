// A network that is slow, stalls, and is gone.
import { equal, match, ok } from "node:assert/strict";
import { PROFILES } from "./support/browser";
import { TIMED_OUT } from "./support/bus";
import { scene } from "./support/scene";
import { until } from "./support/until";

const GONE = /WebSocket|ERR_|Failed to load/;

for (const profile of PROFILES) {
  scene(`a round trip is always shown: amber over 200 ms, red over 500 ms and no driving (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "operator" });
    const chip = v.page.locator(".status-side .chip").first();
    await v.takeControl();
    const shown = (tone: string) => until(() => `the round trip is ${tone}`, 20, async () => (await chip.getAttribute("class"))?.includes(tone));
    await shown("tone-good");
    match((await chip.textContent()) ?? "", /\d ms/);
    v.proxy.delay = 130;
    await shown("tone-warn");
    match((await chip.textContent()) ?? "", /Slow.*\d{3} ms/);
    equal(await v.pad.getAttribute("aria-disabled"), "false", "slow is slow, and may be driven");
    v.proxy.delay = 300;
    await shown("tone-bad");
    match((await chip.textContent()) ?? "", /Too slow/);
    await until("the pad is off", 5, async () => (await v.pad.getAttribute("aria-disabled")) === "true");
    match((await v.pad.textContent()) ?? "", /too slow to drive.*more than 500 ms/);
    robot.bus.forget();
    const hand = await v.hold();
    await robot.bus.silent();
    equal(robot.bus.driven().length, 0);
    await hand.up();
    v.proxy.mend();
    await shown("tone-good");
    await until("the pad is on again", 5, async () => (await v.pad.getAttribute("aria-disabled")) === "false");
    equal(robot.bus.driven().length, 0, "nothing began by itself");
  });
}

for (const profile of PROFILES) {
  scene(`a cut while driving: the robot stops, a banner within 1 s, values grey, and nothing resumes (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "operator", complaints: GONE });
    await v.takeControl();
    const hand = await v.drive();
    const banner = v.page.getByRole("alert").filter({ hasText: "Connection lost" });
    const begun = performance.now();
    v.proxy.cut();
    await banner.waitFor();
    const took = performance.now() - begun;
    ok(took <= 1500, `the banner after ${Math.round(took)} ms`);
    await robot.bus.stops();
    await v.shows("Not known");
    await v.page.locator(".gauge.is-stale, .is-stale .gauge").first().waitFor();
    await v.page.getByRole("alert").filter({ hasText: "You have no control any more" }).waitFor();
    robot.bus.forget();
    v.proxy.mend();
    await v.live();
    await banner.waitFor({ state: "detached" });
    // The hand has been on the pad all the time.
    await hand.move(hand.x, hand.y - hand.half * 0.5);
    await robot.bus.silent(1000);
    equal(robot.bus.driven().length, 0, "nothing was driven");
    await hand.up();
    match((await v.pad.textContent()) ?? "", /Nobody has control/);
    // By a new press, after taking control anew, it drives.
    await v.press(v.button("OK"));
    await v.takeControl();
    const again = await v.drive(-0.8);
    await again.up();
    await robot.bus.stops();
  });
}

scene("a network that stalls: the robot stops by itself, the page says within 1 s that it knows nothing", async ({ robot, visit }) => {
  const v = await visit({ as: "operator", complaints: GONE });
  await v.takeControl();
  const hand = await v.drive();
  await v.page.evaluate(() => {
    // Measured in the page, so that a busy test does not count.
    const seen = globalThis as unknown as { lostAfter: number };
    const looked = performance.now();
    new MutationObserver((_, self) => {
      if (!document.querySelector('.banner[role="alert"]')) return;
      seen.lostAfter = performance.now() - looked;
      self.disconnect();
    }).observe(document.body, { childList: true, subtree: true });
  });
  v.proxy.stalled = true;
  await robot.bus.stops(TIMED_OUT);
  await v.page.getByRole("alert").filter({ hasText: "Connection lost" }).waitFor();
  const after = await v.page.evaluate(() => (globalThis as unknown as { lostAfter: number }).lostAfter);
  ok(after <= 1200, `the banner after ${Math.round(after)} ms`);
  robot.bus.forget();
  // What was under way arrives late: it is not passed on.
  v.proxy.mend();
  await v.live();
  await robot.bus.silent(1000);
  await hand.up();
});

scene("what the robot does not say any more goes grey by itself", async ({ robot, visit }) => {
  const v = await visit();
  await v.go("Power");
  const battery = v.card(/^Power channels/);
  await battery.getByText("age < 1 s").or(battery.locator(".age:not(.is-stale)")).first().waitFor();
  equal(await battery.locator(".age.is-stale").count(), 0);
  await robot.advee("state", "driver_power", "TERMINATE");
  try {
    await battery.locator("tr.is-stale").first().waitFor({ timeout: 15_000 });
    await battery.locator(".age.is-stale").waitFor();
  } finally {
    await robot.advee("state", "driver_power", "RUN");
  }
  await until("it is heard again", 20, async () => (await battery.locator("tr.is-stale").count()) === 0);
});
