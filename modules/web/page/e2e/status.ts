// The status word with its reason, in words.
import { match } from "node:assert/strict";
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
    await robot.advee("fault", "propulsion", "none");
    await v.shows("Ready", 30);
  });
}
