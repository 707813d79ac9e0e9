// The pictures of docs/web.md: each view on a desk and on a phone, of one robot that does the same each time.
import { mkdir, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { HOLD } from "../src/numbers";
import { hasChromium, launch, type Profile, Visit } from "./support/browser";
import { small } from "./support/picture";
import { Robot, ROOT } from "./support/robot";
import { pass, until } from "./support/until";

const FOLDER = join(ROOT, "docs/pictures/web");
/** By the name of the file. */
const VIEWS = { drive: "Drive", map: "Map", modules: "Modules", errors: "Errors", sensors: "Sensors", power: "Power", buses: "Buses", messages: "Messages", logs: "Logs", simulator: "Simulator", access: "This device" };
/** Those that are shown dark, too. */
const DARK = ["drive", "map"];

if (!hasChromium) throw new Error("there is no chromium: tools/require chromium");
const robot = await Robot.start();
const browser = await launch();
try {
  await mkdir(FOLDER, { recursive: true });
  // Something to tell of: a board that was silent for a while, and one that still is.
  await robot.advee("fault", "sd1_rear", "silent", "--for", "3");
  await robot.advee("fault", "fan1", "stall");
  const painter = await browser.newPage();
  for (const profile of ["desktop", "phone"] as Profile[]) {
    await robot.calm();
    const v = await Visit.open(browser, robot, { profile, as: "engineer", name: profile === "phone" ? "Jana's phone" : "Workshop" });
    const save = async (file: string) => writeFile(join(FOLDER, `${file}.png`), await small(painter, await v.page.screenshot({ scale: "css" })));
    if (profile === "phone") {
      await v.page.getByRole("img", { name: /^Map from behind the robot\. At / }).waitFor();
      await pass(1500);
      await save("watching-phone");
    }
    await v.takeControl();
    await v.go("Map");
    await v.press(v.button("Drive to…"));
    await v.press(v.button("patrol"));
    await until("it is on its way", 60, async () => {
      // Where a busy machine made it stop once, the planner waits for an operator.
      if (robot.bus.stands(HOLD.PlannerLatched)) await robot.advee("state", "planner", "RUN");
      return Math.abs(robot.bus.truth().speed) > 0.4;
    });
    for (const [file, view] of Object.entries(VIEWS)) {
      await v.go(view);
      if (view === "Messages") {
        await v.page.getByPlaceholder("Channel or type").fill("LL_DATA_MOTION");
        await v.press(v.row("LL_DATA_MOTION").getByRole("button"));
        for (const field of ["speed", "steering"]) await v.press(v.button(`Plot ${field}`));
        await pass(5000);
      }
      if (view === "Buses") await v.press(v.button("Read"));
      // Until short news are gone, and values that come once a second are there.
      await until("nothing stands before it", 20, async () => (await v.page.locator(".toast").count()) === 0);
      await pass(1500);
      for (const dark of DARK.includes(file) ? [false, true] : [false]) {
        await v.page.emulateMedia({ colorScheme: dark ? "dark" : "light" });
        await pass(500);
        await save(`${file}-${profile}${dark ? "-dark" : ""}`);
      }
      await v.page.emulateMedia({ colorScheme: "light" });
    }
    await v.go("Map");
    await v.press(v.button("Cancel goal"));
    await v.close();
  }
} finally {
  await browser.close();
  await robot.end();
}
