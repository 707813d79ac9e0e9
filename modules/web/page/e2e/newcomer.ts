// Somebody who has never seen it, with nothing but what is to be seen: drives, finds out why it does not move, drives on,
// takes a log home.
import { deepEqual, ok } from "node:assert/strict";
import { PROFILES } from "./support/browser";
import { scene } from "./support/scene";

for (const profile of PROFILES) {
  scene(`a newcomer drives, meets a PAUSE, reads why, drives again and takes the log along (${profile})`, async ({ robot, visit }) => {
    // The link that the robot's computer shows on request; it is in no line of its log.
    const link = /http:\/\/[^\s/]+\/#([0-9]{8})/.exec(await robot.advee("web", "code"))?.[1];
    const v = await visit({ profile, path: `/#${link}` });
    ok(link !== undefined && !robot.console.includes(link));
    await v.press(v.button("Pair"));
    await v.press(v.button("Take control").first());
    let hand = await v.drive();
    await v.shows("Driving");
    await robot.fault("psc1", "bumper", 3);
    await v.shows("Paused");
    await robot.bus.stops();
    await hand.up();
    // What is written there: which, and what to do.
    const why = v.card(/^PAUSE: bumper 3/);
    await why.waitFor();
    ok(((await v.reason.textContent()) ?? "").length > 10);
    deepEqual(await why.locator("li").first().textContent(), "Clear what touches bumper 3.");
    await robot.advee("fault", "psc1", "none");
    await why.waitFor({ state: "detached" });
    robot.bus.forget();
    hand = await v.drive(-0.8);
    await hand.up();
    await robot.bus.stops();
    await v.go("Logs");
    const { bytes } = await v.download();
    ok(bytes.subarray(1, 5).equals(Buffer.from("MCAP")));
  });
}
