// Debian's Chromium, on a desk and as a phone, and what a visit to the robot's page is watched for.
import { deepEqual, equal } from "node:assert/strict";
import { existsSync } from "node:fs";
import { readFile } from "node:fs/promises";
import { type Browser, type BrowserContext, chromium, type CDPSession, type Locator, type Page, type Response } from "playwright-core";
import { Proxy } from "./proxy";
import type { Paired, Robot } from "./robot";

const CHROMIUM = process.env["CHROMIUM"] ?? "/usr/bin/chromium";
export const hasChromium = existsSync(CHROMIUM);

/** A name by which the browser reaches this computer, as it would a robot elsewhere. */
export const NAME = "robot.test";

export const launch = (): Promise<Browser> =>
  chromium.launch({ executablePath: CHROMIUM, chromiumSandbox: process.getuid?.() !== 0, args: [`--host-resolver-rules=MAP ${NAME} 127.0.0.1`] });

export type Profile = "desktop" | "phone";
export const PROFILES: Profile[] = ["desktop", "phone"];
const CONTEXTS = {
  desktop: { viewport: { width: 1440, height: 900 } },
  phone: { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 2 },
};

/** A socket that is opened anew while it opens, since it was found out who we are: Chromium calls that an error. */
const RENEWED = /before receiving a handshake response|before the connection is established/;
/** ms that anything on the page may take on a slow machine. */
const PATIENCE = 15_000;

export interface Wish {
  profile?: Profile;
  /** Not paired without it. */
  as?: Paired;
  name?: string;
  dark?: boolean;
  /** Language of the browser; without it English. */
  locale?: string;
  path?: string;
  /** The name in its address, which the robot must have in `web.hosts`. */
  host?: string;
  /** Runs in the page before anything else. */
  before?: () => void;
  /** What the browser itself may complain of: a connection that a test cuts. */
  complaints?: RegExp;
}

interface Seen {
  csp: string[];
}
declare global {
  // In the page.
  var seen: Seen;
}

/** One page that somebody has open. */
export class Visit {
  /** What it said on the command socket, pings left out. */
  readonly said: Record<string, unknown>[] = [];
  /** What was loaded, from the first request on. */
  readonly answers: Response[] = [];
  private readonly complaints: string[] = [];
  private readonly foreign: string[] = [];

  private constructor(
    readonly robot: Robot,
    readonly profile: Profile,
    readonly proxy: Proxy,
    readonly context: BrowserContext,
    readonly page: Page,
    readonly cdp: CDPSession,
    private readonly wish: Wish,
  ) {}

  static async open(browser: Browser, robot: Robot, wish: Wish = {}): Promise<Visit> {
    const profile = wish.profile ?? "desktop";
    const proxy = await Proxy.open(robot.port);
    const context = await browser.newContext({ ...CONTEXTS[profile], colorScheme: wish.dark ? "dark" : "light", acceptDownloads: true, locale: wish.locale ?? "en-GB" });
    if (wish.as) {
      const value = await robot.key(wish.as, wish.name ?? `${profile} ${wish.as}`);
      await context.addCookies([{ name: `advee-${proxy.port}`, value, domain: wish.host ?? "127.0.0.1", path: "/", httpOnly: true, sameSite: "Strict" }]);
    }
    await context.addInitScript(() => {
      globalThis.seen = { csp: [] };
      addEventListener("securitypolicyviolation", (event) => seen.csp.push(`${event.violatedDirective} ${event.blockedURI}`));
    });
    if (wish.before) await context.addInitScript(wish.before);
    const page = await context.newPage();
    page.setDefaultTimeout(PATIENCE);
    const visit = new Visit(robot, profile, proxy, context, page, await context.newCDPSession(page), wish);
    visit.watch();
    await page.goto(`${visit.origin}${wish.path ?? "/"}`);
    await page.locator(".status-word strong").waitFor();
    return visit;
  }

  get origin(): string {
    return `http://${this.wish.host ?? "127.0.0.1"}:${this.proxy.port}`;
  }

  private watch(): void {
    const { page, context } = this;
    context.on("request", (request) => {
      const url = request.url();
      if (!/^(data|blob):/.test(url) && new URL(url).origin !== this.origin) this.foreign.push(url);
    });
    page.on("websocket", (socket) => {
      if (new URL(socket.url()).host !== new URL(this.origin).host) this.foreign.push(socket.url());
      if (!socket.url().endsWith("/ws/command")) return;
      socket.on("framesent", ({ payload }) => {
        const frame = JSON.parse(String(payload)) as Record<string, unknown>;
        if (frame["type"] !== "ping") this.said.push(frame);
      });
    });
    page.on("response", (response) => this.answers.push(response));
    page.on("pageerror", (error) => this.complaints.push(String(error)));
    page.on("console", (line) => line.type() === "error" && this.complaints.push(line.text()));
  }

  /** Closes it. Whatever a test is about: nothing from elsewhere, nothing that the policy forbids, no error of the page. */
  async close(): Promise<void> {
    const csp = this.page.isClosed() ? [] : await this.page.evaluate(() => seen.csp);
    await this.context.close();
    this.proxy.close();
    deepEqual(this.foreign, [], "requests to elsewhere");
    deepEqual(csp, [], "against the content security policy");
    deepEqual(this.complaints.filter((each) => !RENEWED.test(each) && !this.wish.complaints?.test(each)), [], "errors of the page");
  }

  // ------------------------------------------------------------------------------------------------ looking

  get word(): Locator {
    return this.page.locator(".status-word strong");
  }
  get reason(): Locator {
    return this.page.locator(".status-word p");
  }
  get pad(): Locator {
    return this.page.locator(".pad");
  }
  button(name: string | RegExp): Locator {
    return this.page.getByRole("button", { name, exact: typeof name === "string" });
  }
  card(title: string | RegExp): Locator {
    return this.page.getByRole("region", { name: title });
  }
  text(text: string | RegExp): Locator {
    return this.page.locator("main").getByText(text).first();
  }
  /** The row of a table that is called so. */
  row(name: string): Locator {
    return this.page.getByRole("row").filter({ has: this.page.getByRole("rowheader", { name }) });
  }

  /** The status is shown so. */
  async shows(word: string, seconds = 15): Promise<void> {
    await this.word.filter({ hasText: new RegExp(`^\\s*${word}\\s*$`) }).waitFor({ timeout: 1000 * seconds });
  }
  async live(): Promise<void> {
    await this.page.locator(".status-side .chip").getByText(/\d ms/).waitFor({ state: "attached" });
  }

  // ------------------------------------------------------------------------------------------------ doing

  get touches(): boolean {
    return this.profile === "phone";
  }
  async press(what: Locator): Promise<void> {
    await (this.touches ? what.tap() : what.click());
  }

  /** Goes to a view as people do: by the navigation; on a phone some are under "More". */
  async go(view: string): Promise<void> {
    const nav = this.page.getByRole("navigation");
    const link = nav.getByRole("link", { name: new RegExp(`^${view}`) });
    const current = this.page.locator(`main[aria-label="${view}"]`);
    if (await current.isVisible()) return;
    if (!(await link.first().isVisible())) await this.press(nav.locator(".more button"));
    await this.press(link.locator("visible=true").first());
    await current.waitFor();
  }

  /** The thumb of a slide, to `way` of its track, and let go there. */
  async slide(label: string | RegExp, way = 1): Promise<void> {
    const thumb = this.page.getByRole("slider", { name: label });
    await thumb.scrollIntoViewIfNeeded();
    const box = await thumb.boundingBox();
    const track = await thumb.locator("..").boundingBox();
    if (!box || !track) throw new Error(`${label} is not to be seen`);
    const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
    const end = x + (track.width - box.width) * way + (way === 1 ? 4 : 0);
    const hand = this.hand();
    await hand.down(x, y);
    for (let n = 1; n <= 8; n += 1) await hand.move(x + ((end - x) * n) / 8, y);
    await hand.up();
  }

  /** A mouse, or a finger. */
  hand(): { down(x: number, y: number): Promise<void>; move(x: number, y: number): Promise<void>; up(): Promise<void>; also(x: number, y: number): Promise<void>; lose(): Promise<void> } {
    const { mouse } = this.page;
    if (!this.touches) {
      return {
        down: async (x, y) => (await mouse.move(x, y), await mouse.down()),
        move: (x, y) => mouse.move(x, y),
        up: () => mouse.up(),
        also: () => Promise.reject(new Error("a mouse is one")),
        lose: () => Promise.reject(new Error("a mouse is not lost")),
      };
    }
    let points: { x: number; y: number; id: number }[] = [];
    const touch = (type: "touchStart" | "touchMove" | "touchEnd" | "touchCancel") => this.cdp.send("Input.dispatchTouchEvent", { type, touchPoints: points }).then(() => {});
    return {
      down: (x, y) => ((points = [{ x, y, id: 0 }]), touch("touchStart")),
      move: (x, y) => ((points = [{ x, y, id: 0 }]), touch("touchMove")),
      also: (x, y) => ((points = [...points, { x, y, id: 1 }]), touch("touchStart")),
      up: () => ((points = []), touch("touchEnd")),
      lose: () => ((points = []), touch("touchCancel")),
    };
  }

  /** A hand on the pad: from its middle, 1 is the upper end. Another one on it, and off. */
  async hold(forward = 0.8): Promise<ReturnType<Visit["hand"]> & { x: number; y: number; half: number }> {
    await this.pad.scrollIntoViewIfNeeded();
    const box = await this.pad.boundingBox();
    if (!box) throw new Error("the pad is not to be seen");
    const half = box.height / 2;
    const [x, y] = [box.x + box.width / 2, box.y + half];
    const hand = this.hand();
    await hand.down(x, y);
    await hand.move(x, y - half * forward * 0.7);
    return { ...hand, x, y, half };
  }

  /** The newest run's record, taken home; a run of many files shows them when it is asked to. */
  async download(): Promise<{ name: string; bytes: Buffer }> {
    const file = this.page.locator("a.p-download", { hasText: ".mcap" }).first();
    await file.waitFor({ state: "attached" });
    if (!(await file.isVisible())) await this.press(this.page.locator("details.p-files summary").first());
    const [download] = await Promise.all([this.page.waitForEvent("download"), this.press(file)]);
    return { name: download.suggestedFilename(), bytes: await readFile(await download.path()) };
  }

  async takeControl(): Promise<void> {
    await this.go("Drive");
    await this.press(this.button("Take control").first());
    await this.page.getByText("You have control", { exact: true }).first().waitFor();
  }
  /** A hand on the pad, and the robot follows. Should a busy machine have let the first press go, the hand is taken off and pressed anew, as people do. */
  async drive(forward = 0.8): Promise<Awaited<ReturnType<Visit["hold"]>>> {
    for (;;) {
      const hand = await this.hold(forward);
      if (await this.robot.bus.follows(forward > 0)) return hand;
      await hand.up();
    }
  }
  /** The same by a key. */
  async driveByKey(key: string, forward = true): Promise<void> {
    for (;;) {
      await this.page.keyboard.down(key);
      if (await this.robot.bus.follows(forward)) return;
      await this.page.keyboard.up(key);
    }
  }
  get stop(): Locator {
    return this.page.locator(".stop-button");
  }
  async gaveZero(): Promise<void> {
    equal(this.said.filter(({ type }) => type === "drive" || type === "zero").at(-1)?.["type"], "zero", "the page's last word is zero");
  }
}
