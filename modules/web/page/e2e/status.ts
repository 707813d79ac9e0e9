// The status word with its reason, in words.
import { equal, match } from "node:assert/strict";
import { PROFILES } from "./support/browser";
import { scene } from "./support/scene";
import { until } from "./support/until";

for (const profile of PROFILES) {
  scene(`the status says in a word and a sentence what the robot does, and why not (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile });
    await v.shows("Ready");
    const driving = robot.advee("drive", "0.2", "0", "--for", "3");
    await v.shows("Driving");
    match((await v.reason.textContent()) ?? "", /m\/s/);
    await driving;
    await robot.fault("psc1", "bumper", 2);
    await v.shows("Paused");
    match((await v.reason.textContent()) ?? "", /bumper ?2/);
    await v.card(/^PAUSE: bumper 2/).getByText("Clear what touches bumper 2.").waitFor();
    await robot.advee("fault", "psc1", "none");
    await robot.release();
    await v.shows("Ready");
    await robot.fault("propulsion", "silent");
    await until("the status tells of the drive", 20, async () => /propulsion/.test((await v.reason.textContent()) ?? ""));
    await v.page.locator(".status-second").filter({ hasText: /^the propulsion drive / }).waitFor();
    await v.card(/^The propulsion drive /).getByText(/supply.*cable.*node id/).waitFor();
    await robot.advee("fault", "propulsion", "none");
    await v.shows("Ready", 30);
  });
}

scene("beside whether it may be driven the status says whether it is well, also to who comes late", async ({ robot, visit }) => {
  const v = await visit();
  await v.shows("Ready");
  const second = v.page.locator(".status-second");
  equal(await second.count(), 0);
  await v.page.getByRole("list", { name: "Speed, position, battery" }).getByText(/^Battery \d+\u202F%/).waitFor({ state: "attached" });
  await robot.fault("fan1", "stall");
  await second.filter({ hasText: /fan/i }).waitFor({ timeout: 30_000 });
  await v.shows("Ready");
  equal(await v.page.locator(".status.tone-good").count(), 0, "ready is not green while a fan is dead");
  const late = await visit({ profile: "phone", dark: true });
  await late.page.locator(".status-second").filter({ hasText: /fan/i }).waitFor();
  await late.press(late.page.locator(".status-second"));
  await late.page.locator('main[aria-label="Errors"]').waitFor();
  await robot.advee("fault", "fan1", "none");
  await until("all is well", 30, async () => (await second.count()) === 0);
});
