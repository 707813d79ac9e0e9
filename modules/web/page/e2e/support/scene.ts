// One robot and one browser for all scenes, but for scenes that need a robot of their own; each scene begins with a robot
// that stands and is well.
import { after, test } from "node:test";
import { appendFileSync } from "node:fs";
import type { Browser } from "playwright-core";
import { hasChromium, launch, Visit, type Wish } from "./browser";
import { Robot } from "./robot";

let sharedRobot: Promise<Robot> | null = null;
let sharedBrowser: Promise<Browser> | null = null;
after(async () => {
  await (await sharedBrowser)?.close();
  await (await sharedRobot)?.end();
});

// Ended by a signal it ends what it has started, too.
for (const signal of ["SIGINT", "SIGTERM"] as const) process.once(signal, () => process.exit(1));

/** s that a scene may take on the slowest of machines. */
const PATIENCE = 90;
/** Delay of this process, ms, from which the machine counts as held up. */
const HELD_UP = 40;
/** Attempts of a scene, each on a machine that was held up meanwhile. */
const ATTEMPTS = 4;
let skipped = 0;
process.once("exit", () => {
  if (!skipped) return;
  const why = "there is no chromium (make test installs it)";
  console.error(`skipped: ${skipped} tests of the page in a browser: ${why}`);
  // The list that make test prints at its end: foundation/testing.
  const list = process.env["ADVEE_SKIPPED"];
  if (list) appendFileSync(list, `peer\tpage: ${skipped} tests in a browser\t${why}\n`);
});

/** Characters of the robot's console that are shown with a failure. */
const CONSOLE_SHOWN = 2000;

export interface Stage {
  robot: Robot;
  visit(wish?: Wish): Promise<Visit>;
}

/** A test with any number of visits, which are watched and closed. `sets`: settings of a robot of its own, as `--set` has them;
 *  `config`: the folder of its configuration, where it is another one. */
export function scene(name: string, body: (stage: Stage) => Promise<void>, sets?: string[], config?: string): void {
  if (!hasChromium && process.env["ADVEE_PEERS"] !== "required") {
    skipped += 1;
    test(name, { skip: "no chromium" }, () => {});
    return;
  }
  test(name, { timeout: 1000 * PATIENCE * ATTEMPTS }, async () => {
    for (let attempt = 1; ; attempt += 1) {
      const canary = new Canary();
      const failed = await play(name, body, sets, config).finally(() => canary.end());
      if (!failed) return;
      // On a machine that stood still a robot stops rightly, and a press is no press: that proves nothing.
      if (canary.late < HELD_UP || attempt === ATTEMPTS) throw failed.error;
      console.error(`${name}: attempt ${attempt} is void: the machine was held up by ${Math.round(canary.late)} ms`);
    }
  });
}

/** Longest delay of a timer of this process, ms. */
class Canary {
  late = 0;
  private last = performance.now();
  private readonly timer = setInterval(() => {
    const now = performance.now();
    this.late = Math.max(this.late, now - this.last - 5);
    this.last = now;
  }, 5);

  end() {
    clearInterval(this.timer);
  }
}

/** Plays a scene once; its error, if it failed. */
async function play(name: string, body: (stage: Stage) => Promise<void>, sets?: string[], config?: string): Promise<{ error: unknown } | null> {
  const own = sets && Robot.start(sets.flatMap((set) => ["--set", set]), config ? ["--config", config] : []);
  const [robot, browser] = await Promise.all([own ?? (sharedRobot ??= Robot.start()), (sharedBrowser ??= launch())]);
  const visits: Visit[] = [];
  const visit = async (wish?: Wish) => {
    const opened = await Visit.open(browser, robot, wish);
    visits.push(opened);
    return opened;
  };
  let failed: { error: unknown } | null = null;
  try {
    await robot.calm();
    await body({ robot, visit });
  } catch (error) {
    failed = { error };
    for (const [n, each] of visits.entries()) {
      await each.page.screenshot({ path: `node_modules/.e2e/${name.replace(/[^a-z0-9]+/gi, "-")}-${n}.png`, timeout: 5000 }).catch(() => {});
    }
  }
  for (const each of visits) await each.close().catch((error: unknown) => (failed ??= { error }));
  if (own) await robot.end();
  if (failed) console.error(`${name}: the robot's console:\n${robot.console.slice(-CONSOLE_SHOWN)}`);
  return failed;
}
