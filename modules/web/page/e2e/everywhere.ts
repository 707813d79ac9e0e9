// What holds on every view: nothing from elsewhere, small, installable, for every hand and eye.
import { deepEqual, equal, ok } from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { HOLD } from "../src/numbers";
import { PROFILES, type Visit } from "./support/browser";
import { scene } from "./support/scene";
import { until } from "./support/until";

const VIEWS = ["Drive", "Map", "Modules", "Errors", "Sensors", "Power", "Buses", "Messages", "Logs", "Simulator", "This device"];
const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const SMALLEST = 48;

interface Violation {
  id: string;
  impact: string;
  nodes: { target: string[]; failureSummary: string }[];
}

async function violations(v: Visit): Promise<string[]> {
  await v.page.evaluate(AXE);
  const found = await v.page.evaluate(async () => {
    const { axe } = globalThis as unknown as { axe: { run(on: Document, options: object): Promise<{ violations: Violation[] }> } };
    return (await axe.run(document, { resultTypes: ["violations"] })).violations;
  });
  const bad = found.filter(({ impact }) => impact === "serious" || impact === "critical");
  return bad.flatMap(({ id, nodes }) => nodes.map(({ target, failureSummary }) => `${id} at ${target.join(" ")}: ${failureSummary.replace(/\s+/g, " ")}`));
}

for (const [profile, dark] of [["desktop", false], ["desktop", true], ["phone", false]] as const) {
  scene(`no serious barrier on any view (${profile}, ${dark ? "dark" : "light"})`, async ({ visit }) => {
    const v = await visit({ profile, dark, as: "engineer" });
    await v.takeControl();
    const all: string[] = [];
    for (const view of VIEWS) {
      await v.go(view);
      await until(`${view} has something to show`, 15, async () => (await v.page.locator("main").innerText()).length > 40);
      all.push(...(await violations(v)).map((each) => `${view}: ${each}`));
    }
    deepEqual(all, []);
  });
}

for (const profile of PROFILES) {
  scene(`no serious barrier in a recorded run (${profile})`, async ({ visit }) => {
    const v = await visit({ profile, path: "/?demo=1" });
    const line = v.page.getByRole("region", { name: "Time line" });
    await line.waitFor();
    if (profile === "desktop") {
      // So low that what is beside the map must be scrolled.
      await v.page.setViewportSize({ width: 1440, height: 560 });
      await until("the side scrolls", 15, () => v.page.locator(".drive-side").evaluate((side) => side.scrollHeight > side.clientHeight + 20));
      deepEqual(await violations(v), []);
    }
    await v.press(line.getByRole("button", { name: "What happened" }));
    await v.page.getByRole("dialog", { name: "What happened" }).waitFor();
    deepEqual(await violations(v), []);
  });
}

scene("all that is pressed on a phone is at least 48 px", async ({ visit }) => {
  const v = await visit({ profile: "phone", as: "engineer" });
  await v.takeControl();
  const small: string[] = [];
  for (const view of VIEWS) {
    await v.go(view);
    await until(`${view} has something to show`, 15, async () => (await v.page.locator("main").innerText()).length > 40);
    const found = await v.page.evaluate((smallest) => {
      const list: string[] = [];
      for (const each of document.querySelectorAll("a[href], button, input, select, textarea, summary, [role=slider], [role=button]")) {
        // A field may be pressed on its label.
        const box = (each instanceof HTMLInputElement && each.closest("label") ? (each.closest("label") as Element) : each).getBoundingClientRect();
        // So far may its edge be missed.
        const beyond = getComputedStyle(each, "::after");
        const more = beyond.position === "absolute" && beyond.content !== "none" ? -2 * Math.min(0, parseFloat(beyond.top) || 0) : 0;
        if (box.width === 0 || each.closest(".visually-hidden, .skip")) continue;
        if (box.width < smallest - 0.5 || box.height + more < smallest - 0.5) list.push(`${each.tagName} ${each.getAttribute("aria-label") ?? each.textContent?.slice(0, 30)} ${Math.round(box.width)}×${Math.round(box.height)}`);
      }
      return list;
    }, SMALLEST);
    small.push(...found.map((each) => `${view}: ${each}`));
  }
  deepEqual(small, []);
});

for (const width of [320, 390, 768, 1440, 2560]) {
  scene(`nothing is wider than a screen of ${width} px`, async ({ visit }) => {
    const v = await visit({ as: "engineer" });
    await v.page.setViewportSize({ width, height: 800 });
    for (const view of VIEWS) {
      await v.page.goto(`${v.origin}/#/${view === "This device" ? "access" : view.toLowerCase()}`);
      await v.page.locator(`main[aria-label="${view}"]`).waitFor();
      const [wide, main] = await v.page.evaluate(() => [document.documentElement.scrollWidth, document.querySelector("main")?.scrollWidth ?? 0]);
      ok((wide ?? 0) <= width && (main ?? 0) <= width, `${view}: ${wide}, ${main}`);
      const high = await v.page.evaluate(() => document.documentElement.scrollHeight);
      ok(high <= 800, `${view}: the view scrolls, not the document: ${high}`);
    }
  });
}

scene("the first load is at most 500 kB, compressed", async ({ visit }) => {
  const v = await visit();
  await v.shows("Ready");
  let bytes = 0;
  for (const response of v.answers) {
    const { pathname } = new URL(response.url());
    if (pathname.startsWith("/api/")) continue;
    bytes += (await response.request().sizes()).responseBodySize;
    if (/\.(js|css)$|^\/$/.test(pathname)) equal((await response.allHeaders())["content-encoding"], "gzip", pathname);
  }
  ok(bytes > 10_000 && bytes <= 500_000, `${bytes} bytes`);
});

scene("it can be installed, and shows itself without the robot", async ({ visit }) => {
  const v = await visit({ complaints: /ERR_|Failed to (load|fetch)|WebSocket/ });
  const manifest = await v.page.evaluate(async () => {
    const link = document.querySelector<HTMLLinkElement>('link[rel="manifest"]');
    return link ? ((await (await fetch(link.href)).json()) as { name: string; start_url: string; display: string; icons: { src: string; sizes: string; type: string }[] }) : null;
  });
  ok(manifest?.name && manifest.start_url && manifest.display === "standalone");
  for (const size of ["192x192", "512x512"]) {
    const icon: { src: string } | undefined = manifest.icons.find(({ sizes }) => sizes === size);
    ok(icon, size);
    const is: string = await v.page.evaluate(async (src) => {
      const image = await createImageBitmap(await (await fetch(src)).blob());
      return `${image.width}x${image.height}`;
    }, icon.src);
    equal(is, size);
  }
  const { installabilityErrors } = (await v.cdp.send("Page.getInstallabilityErrors" as never)) as unknown as { installabilityErrors: { errorId: string }[] };
  // A private window is never one to install from.
  deepEqual(installabilityErrors.map(({ errorId }) => errorId).filter((each) => each !== "in-incognito"), []);
  await v.page.evaluate(() => navigator.serviceWorker.ready.then(() => {}));
  await v.page.reload();
  await v.shows("Ready");
  v.proxy.cut();
  await v.page.reload();
  await v.shows("Connecting");
  await v.page.getByText("the robot does not answer yet").first().waitFor();
  await v.page.getByRole("navigation").first().waitFor();
  v.proxy.mend();
  await v.shows("Ready", 20);
});

scene("with the keyboard alone: past the navigation, control taken, driven, stopped, let go on", async ({ robot, visit }) => {
  const v = await visit({ as: "operator" });
  const { keyboard } = v.page;
  /** Tabs until it is there; each stop on the way is to be seen. */
  const tabTo = async (name: RegExp) => {
    for (let n = 0; n < 80; n += 1) {
      await keyboard.press("Tab");
      const at = await v.page.evaluate(() => {
        const each = document.activeElement as HTMLElement;
        // What had the focus is gone, or the end was reached: the next one is the first.
        if (each === document.body) return null;
        const style = getComputedStyle(each);
        const box = each.getBoundingClientRect();
        return { name: each.getAttribute("aria-label") ?? each.textContent ?? "", ring: style.outlineStyle !== "none" || style.boxShadow !== "none", seen: box.width > 0 && box.bottom > 0 && box.top < innerHeight };
      });
      if (at === null) continue;
      ok(at.ring && at.seen, `the focus is to be seen at “${at.name}”`);
      if (name.test(at.name)) return;
    }
    throw new Error(`${name} is not reached`);
  };
  await tabTo(/^Skip to the view/);
  await keyboard.press("Enter");
  equal(await v.page.evaluate(() => document.activeElement?.tagName), "MAIN");
  await tabTo(/^Take control/);
  await keyboard.press("Enter");
  await v.page.getByText("You have control", { exact: true }).first().waitFor();
  await v.driveByKey("ArrowUp");
  await keyboard.up("ArrowUp");
  await robot.bus.stops();
  await keyboard.press("Escape");
  await v.shows("Stopped");
  await tabTo(/^Resume/);
  for (let n = 0; n < 4; n += 1) await keyboard.press("ArrowRight");
  await v.stop.waitFor();
  await until("it may go on", 10, () => !robot.bus.stands(HOLD.ModulePaused));
  // One of another view, by its link.
  await tabTo(/^Messages/);
  await keyboard.press("Enter");
  await v.page.locator('main[aria-label="Messages"]').waitFor();
});

for (const profile of PROFILES) {
  scene(`light, dark or as the device: chosen once, and kept (${profile})`, async ({ visit }) => {
    const v = await visit({ profile, dark: true });
    const shown = () => v.page.evaluate(() => document.documentElement.dataset["theme"]);
    equal(await shown(), "dark");
    await v.go("This device");
    await v.press(v.button("Light"));
    equal(await shown(), "light");
    await v.page.reload();
    await v.word.waitFor();
    equal(await shown(), "light");
  });
}
