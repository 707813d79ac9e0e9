// The pictures of docs/web.md: each view on a desk and on a phone, of one robot that does the same each time; and those of
// docs/your-robot.md: each other robot driven by hand, and its map on the way to a goal. BASES=yes takes the latter alone.
import { mkdir, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { HOLD } from "../src/numbers";
import { hasChromium, launch, type Profile, Visit } from "./support/browser";
import { small } from "./support/picture";
import { Robot, ROOT } from "./support/robot";
import { pass, until } from "./support/until";

const FOLDER = join(ROOT, "docs/pictures/web");
const BASES_FOLDER = join(ROOT, "docs/pictures/bases");
const FOYER = { world: "foyer", goal: "9.5,5.5" };
const EMPTY = { world: "empty", goal: "15,9" };
/** Folders of conf/, where each robot drives, and to which place: those without a lidar sense nothing. `unplugged`: what is
 *  then without a line while it is driven by hand. */
const BASES: Record<string, { world: string; goal: string; unplugged?: string }> = {
  courier: { ...FOYER, unplugged: "lidar.top" },
  tug: EMPTY,
  rover: { ...EMPTY, unplugged: "left" },
  porter: EMPTY,
  tripod: EMPTY,
  "advee-lidar": FOYER,
};
/** By the name of the file. */
const VIEWS = { drive: "Drive", map: "Map", modules: "Modules", errors: "Errors", sensors: "Sensors", power: "Power", buses: "Buses", messages: "Messages", logs: "Logs", simulator: "Simulator", access: "This device" };
/** Those that are shown dark, too. */
const DARK = ["drive", "map"];

if (!hasChromium) throw new Error("there is no chromium: tools/require chromium");
const browser = await launch();
try {
  if (process.env["BASES"] === undefined) await views();
  await bases();
} finally {
  await browser.close();
}

/** Each other robot in a hand's curve, and on the map, while it drives to a goal. */
async function bases(): Promise<void> {
  await mkdir(BASES_FOLDER, { recursive: true });
  const painter = await browser.newPage();
  for (const [name, { world, goal, unplugged }] of Object.entries(BASES)) {
    const robot = await Robot.start(["--world", `conf/worlds/${world}.toml`], ["--config", `conf/${name}`]);
    try {
      const v = await Visit.open(browser, robot, { profile: "desktop", as: "engineer", name: "Workshop" });
      const save = async (file: string) => writeFile(join(BASES_FOLDER, `${file}.png`), await small(painter, await v.page.screenshot({ scale: "css" })));
      await v.takeControl();
      let from = robot.bus.truth();
      const hand = await v.hold();
      await hand.move(hand.x + hand.half * 0.3, hand.y - hand.half * 0.5);
      await until(`${name} is driven`, 30, () => Math.hypot(robot.bus.truth().x - from.x, robot.bus.truth().y - from.y) > 0.5);
      await pass(1500);
      await save(`${name}-by-hand`);
      if (unplugged !== undefined) {
        await robot.fault(unplugged, "silent");
        await until(`${name} stands without ${unplugged}`, 30, () => Math.abs(robot.bus.truth().speed) < 0.01);
        await pass(1500);
        await save(`${name}-unplugged`);
      }
      await hand.up();
      await robot.calm();
      await v.go("Map");
      from = robot.bus.truth();
      await robot.advee("goal", goal, "--when-ready");
      await until(`${name} is on its way`, 60, () => Math.hypot(robot.bus.truth().x - from.x, robot.bus.truth().y - from.y) > 1.5);
      await save(name);
      await v.close();
    } finally {
      await robot.end();
    }
  }
}

async function views(): Promise<void> {
  const robot = await Robot.start();
  try {
    await mkdir(FOLDER, { recursive: true });
    // Something to report: a board that was silent for a while, and one that still is.
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
    await robot.end();
  }
}
