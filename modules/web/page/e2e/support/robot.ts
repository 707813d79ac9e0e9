// A whole simulated robot of one's own: `advee up --sim` on ports and in folders that nobody else has, its bus listened to,
// ended by its process.
import { type ChildProcess, execFile, spawn } from "node:child_process";
import { existsSync } from "node:fs";
import { mkdtemp, rm } from "node:fs/promises";
import { request } from "node:http";
import { createServer, type Server } from "node:net";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { promisify } from "node:util";
import { HOLD } from "../../src/numbers";
import { Bus } from "./bus";
import { pass, until } from "./until";

export const ROOT = resolve("../../..");
export const ADVEE = resolve(process.env["ADVEE"] ?? join(ROOT, "target/debug/advee"));
const run = promisify(execFile);

/** driver_canbus does not act before it is commanded to. */
const HELD = [HOLD.ModulePaused, HOLD.ModuleStopped];
/** Stops that last until an operator releases them, once their cause is over. */
const LATCHED = [HOLD.PauseLatched, HOLD.RangingLost, HOLD.SpeedExceeded];
/** The steering has no reference, as after a restart of driver_canbus, which a busy machine may cause. */
const UNREFERENCED = [HOLD.ToBeHomed, HOLD.HomingFailed];

export type Paired = "operator" | "engineer";

/** A port that no other test of this machine uses now, held by TCP as the robot's own tests hold theirs; the next one is free. */
async function uniquePorts(): Promise<{ port: number; held: Server }> {
  for (let n = 0; n < 9600; n += 1) {
    const port = 20_000 + ((process.pid * 31 + n) % 9600) * 2;
    const held = await listening(port);
    const next = held && (await listening(port + 1));
    if (held && next) {
      await new Promise((closed) => next.close(closed));
      return { port, held };
    }
    held?.close();
  }
  throw new Error("no port is free");
}

function listening(port: number): Promise<Server | null> {
  return new Promise((take) => {
    const server = createServer((socket) => socket.destroy());
    server.once("error", () => take(null));
    server.listen(port, "127.0.0.1", () => take(server.unref()));
  });
}

export class Robot {
  /** Where its web server listens. */
  readonly port: number;
  readonly bus: Bus;
  /** What its console says. */
  console = "";
  private readonly keys = new Map<string, string>();
  /** When an operator last released it, ms since the epoch. */
  private released = 0;
  /** It has a PAUSE line, whose state is published: the shipped robot, unlike the others in conf/. */
  private readonly hasLine: boolean;
  /** Targets with faults. */
  private readonly broken = new Set<string>();

  private constructor(
    private readonly folder: string,
    private readonly base: string[],
    private readonly held: Server,
    port: number,
    private readonly up: ChildProcess,
  ) {
    this.port = port;
    this.hasLine = !base.includes("--config");
    up.stdout?.on("data", (text: Buffer) => (this.console += text));
    up.stderr?.on("data", (text: Buffer) => (this.console += text));
    this.bus = new Bus(spawn(ADVEE, [...base, "lcm", "echo", ".*MOTION|LL_DATA_VELOCITY|LL_DATA_HOLD|SIM_.*|ML_CMD.*|CM_CMD.*|LL_CMD.*|LL_EVENT_STOP|CM_DATA_PROCESSES", "--json"], { cwd: ROOT, stdio: ["ignore", "pipe", "ignore"] }));
  }

  /** Starts one in a hall without visitors, that stands until it is commanded to move, and waits until it may be driven; `all`:
   *  options of each of its commands, such as its configuration. */
  static async start(extra: string[] = [], all: string[] = []): Promise<Robot> {
    if (!existsSync(ADVEE)) throw new Error(`there is no ${ADVEE}: cargo build -p advee makes it; ADVEE=… names another one`);
    const { port, held } = await uniquePorts();
    const folder = await mkdtemp(join(tmpdir(), "advee-e2e-"));
    const base = ["--lcm-url", `udpm://239.255.76.67:${port}?ttl=0&shm=auto`, "--run-dir", join(folder, "run"), ...all];
    const sets = [`log.folder=${JSON.stringify(join(folder, "log"))}`, "world.people=0"].flatMap((each) => ["--set", each]);
    const args = [...base, "up", "--sim", "--goal", "none", "--http", `127.0.0.1:${port + 1}`, ...sets, ...extra];
    const robot = new Robot(folder, base, held, port + 1, spawn(ADVEE, args, { cwd: ROOT, stdio: ["ignore", "pipe", "pipe"] }));
    process.once("exit", () => robot.up.kill("SIGTERM"));
    try {
      await until("the robot may be driven and its web server answers", 60, async () => {
        if (robot.up.exitCode !== null) throw new Error(`advee up ended:\n${robot.console}`);
        await robot.letGo();
        return robot.bus.motion()?.homed && (await robot.ask("GET", "/api/me")).status === 200;
      });
    } catch (error) {
      await robot.end();
      throw new Error(`${error}\n${robot.console}`);
    }
    return robot;
  }

  /** `advee …` on its bus; what it prints. */
  async advee(...args: string[]): Promise<string> {
    return (await run(ADVEE, [...this.base, ...args], { cwd: ROOT })).stdout;
  }

  /** The codes and links that are valid now, as the command on the robot's computer shows them. */
  async codes(): Promise<Record<Paired, string>> {
    return JSON.parse(await this.advee("web", "code", "--json"));
  }

  /** The key of a paired device of that name: paired once, known from then on. */
  async key(role: Paired, name: string): Promise<string> {
    const known = this.keys.get(`${role} ${name}`);
    if (known !== undefined) return known;
    const code = (await this.codes())[role];
    const answer = await this.ask("POST", "/api/pair", { code, name });
    const key = /^advee-[0-9]+=([0-9a-f]+);/.exec(answer.cookie)?.[1];
    if (answer.status !== 200 || key === undefined) throw new Error(`pairing: ${answer.status} ${answer.body}`);
    this.keys.set(`${role} ${name}`, key);
    return key;
  }

  private ask(method: string, path: string, body?: object): Promise<{ status: number; cookie: string; body: string }> {
    const own = `127.0.0.1:${this.port}`;
    const headers = { Host: own, ...(body ? { Origin: `http://${own}`, "Content-Type": "application/json" } : {}) };
    return new Promise((take) => {
      const asked = request({ host: "127.0.0.1", port: this.port, path, method, headers, agent: false }, (answer) => {
        let text = "";
        answer.on("data", (part: Buffer) => (text += part));
        answer.on("end", () => take({ status: answer.statusCode ?? 0, cookie: answer.headers["set-cookie"]?.[0] ?? "", body: text }));
      });
      asked.on("error", () => take({ status: 0, cookie: "", body: "" }));
      asked.end(body && JSON.stringify(body));
    });
  }

  /** Releases the quick stop. The web server publishes a Stop three times within 0.1 s, as a datagram may be lost: a RUN
   *  that comes before the last of them is undone by it, so it is repeated until it holds. */
  async goOn(): Promise<void> {
    await until("driver_canbus runs", 10, async () => {
      await this.advee("state", "driver_canbus", "RUN");
      await pass(200);
      return !this.bus.stands(...HELD);
    });
  }

  /** The source that engaged PAUSE has opened it: it is latched, until an operator releases the robot. */
  async release(): Promise<void> {
    await until("PAUSE is latched", 20, () => this.bus.stands(HOLD.PauseLatched));
    await this.advee("state", "driver_canbus", "RUN");
  }

  /** Does what an operator does after a stop that waits for one, at most every two seconds. */
  private async letGo(): Promise<void> {
    if (Date.now() - this.released < 2000 || !this.bus.stands(...LATCHED, ...UNREFERENCED)) return;
    this.released = Date.now();
    if (this.bus.stands(...LATCHED)) await this.advee("state", "driver_canbus", "RUN");
    if (this.bus.stands(...UNREFERENCED)) await this.advee("home").catch(() => {});
  }

  /** As it was at the start: nothing broken, nothing held, nobody's goal, standing. */
  async calm(): Promise<void> {
    const { bus } = this;
    if (this.broken.size) {
      for (const target of this.broken) await this.advee("fault", target, "none");
      this.broken.clear();
    }
    if (bus.stands(...HELD)) await this.goOn();
    bus.forget();
    // After a stop it waits for an operator.
    await this.advee("goal", "cancel");
    await this.advee("state", "planner", "RUN");
    await until(() => `the robot stands, and may be driven (${bus.motion()?.reason})`, 30, async () => {
      const motion = bus.motion();
      await this.letGo();
      return bus.quietAfter("ML_CMD_GOAL", "CM_CMD_STATE") && motion?.homed && Math.abs(motion.speed ?? 1) < 0.02 && !bus.stands(...HELD, ...LATCHED, HOLD.PauseUnknown) && (!this.hasLine || bus.last["LL_EVENT_STOP"]?.["engaged"] === false);
    });
    bus.forget();
  }

  /** Breaks something until the test is over. */
  async fault(target: string, fault: string, value = 0): Promise<void> {
    this.broken.add(target);
    await this.advee("fault", target, fault, String(value));
  }
  /** What a test broke by the page, to be mended after it. */
  breaks(target: string): void {
    this.broken.add(target);
  }

  async end(): Promise<void> {
    this.bus.end();
    if (this.up.exitCode === null && this.up.signalCode === null) {
      const over = new Promise((ended) => this.up.once("exit", ended));
      this.up.kill("SIGINT");
      const late = setTimeout(() => this.up.kill("SIGKILL"), 10_000);
      await over;
      clearTimeout(late);
    }
    this.held.close();
    await rm(this.folder, { recursive: true, force: true, maxRetries: 5 });
  }
}
