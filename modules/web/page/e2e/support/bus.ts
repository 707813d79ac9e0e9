// What is said on the robot's bus, as `advee lcm echo --json` tells it.
import { ok } from "node:assert/strict";
import type { ChildProcess } from "node:child_process";
import { createInterface } from "node:readline";
import type { CmdMotion, DataMotion } from "../../src/protocol";
import { pass, until } from "./until";

export interface Heard {
  channel: string;
  /** When it was received, ms since the UNIX epoch. */
  at: number;
  message: Record<string, unknown>;
}

/** A hand that goes off says zero: it comes sooner than the server's own end of a hold, 200 ms after its last command. */
export const AT_ONCE = 150;
/** What the server allows a hold that says nothing more, with what the last command may be late. */
export const TIMED_OUT = 300;
/** The server says zero three times, 50 ms apart; then nothing. */
const ZEROS = 250;
const SILENCE = 600;
/** Modules that command others by themselves, such as RUN after a restart. */
const OWN = ["watchdog", "driver_power"];
/** What is under way when a test begins, as the zeros of a hold that the last one left, has come by then. */
const UNDER_WAY = 300;

export class Bus {
  readonly last: Record<string, Record<string, unknown>> = {};
  /** What stands against acting, by module: numbers of docs/holds.md. */
  private readonly lists: Record<string, { code: number }[]> = {};
  /** Commands of all kinds since `forget`, but those that modules give by themselves. */
  commands: Heard[] = [];
  /** When the last of them was received. */
  private lastCommand = 0;

  constructor(private readonly echo: ChildProcess) {
    process.once("exit", () => echo.kill());
    createInterface({ input: echo.stdout as NodeJS.ReadableStream }).on("line", (line) => {
      const { channel, utime, message } = JSON.parse(line) as { channel: string; utime: number; message: Record<string, unknown> };
      this.last[channel] = message;
      if (channel === "LL_DATA_HOLD") this.lists[message["module"] as string] = message["holds"] as { code: number }[];
      if (!channel.includes("_CMD_") || OWN.includes(message["source"] as string)) return;
      this.commands.push({ channel, at: utime / 1000, message });
      this.lastCommand = performance.now();
    });
  }

  end(): void {
    this.echo.kill();
  }
  forget(): void {
    this.commands = [];
  }
  /** Whether commands on all these channels have been received since `forget`, and nothing for a while. */
  quietAfter(...channels: string[]): boolean {
    return performance.now() - this.lastCommand > UNDER_WAY && channels.every((channel) => this.said(channel).length);
  }

  motion(): DataMotion | undefined {
    return this.last["LL_DATA_MOTION"] as unknown as DataMotion | undefined;
  }
  /** Whether driver_canbus lists one of these causes. */
  stands(...codes: number[]): boolean {
    return (this.lists["driver_canbus"] ?? []).some(({ code }) => codes.includes(code));
  }
  /** Where it really is, and how fast. */
  truth(): { x: number; y: number; theta: number; speed: number } {
    return this.last["SIM_DATA_TRUTH"] as unknown as { x: number; y: number; theta: number; speed: number };
  }

  /** Commands of one kind since `forget`. */
  said(channel: string): Heard[] {
    return this.commands.filter((each) => each.channel === channel);
  }
  /** What pages have driven since `forget`. */
  driven(): (CmdMotion & { at: number })[] {
    const all = this.said("LL_CMD_MOTION").map(({ at, message }) => ({ ...(message as unknown as CmdMotion), at }));
    return all.filter(({ source }) => source.startsWith("web:"));
  }
  async hears(channel: string): Promise<Record<string, unknown>> {
    return (await until(`${channel} is said`, 10, () => this.said(channel).at(-1))).message;
  }

  /** Until a page drives, and the robot with it. */
  async moves(forward = true, seconds = 15): Promise<void> {
    const sign = forward ? 1 : -1;
    await until(() => `the robot moves (${this.motion()?.reason})`, seconds, () => {
      const last = this.driven().at(-1);
      return last && sign * (last.speed ?? 0) > 0 && sign * this.truth().speed > 0.03;
    });
  }
  /** Whether it does soon. */
  follows(forward: boolean): Promise<boolean> {
    return this.moves(forward, 3).then(() => true, () => false);
  }

  /** Speed to the left that pages last commanded, and the measured one, m/s. */
  sideways(): { commanded: number; measured: number } {
    // A hold ends with zeros as LL_CMD_MOTION.
    const moves = ({ channel, message }: Heard) => /^LL_CMD_(MOTION|VELOCITY)$/.test(channel) && String(message["source"]).startsWith("web:");
    const vy = (message?: Record<string, unknown>) => Number(message?.["vy"] ?? 0);
    return { commanded: vy(this.commands.filter(moves).at(-1)?.message), measured: vy(this.last["LL_DATA_VELOCITY"]) };
  }
  /** Whether a page and the robot with it go to this side soon: 1 to the left, -1 to the right. */
  goesSideways(side: number): Promise<boolean> {
    const goes = () => side * this.sideways().commanded > 0 && side * this.sideways().measured > 0.03;
    return until("the robot goes sideways", 3, goes).then(() => true, () => false);
  }
  /** Zero is commanded, and the robot does not go sideways any more. */
  async endsSideways(): Promise<void> {
    await until(() => `it goes nowhere (${JSON.stringify(this.sideways())})`, 10, () => this.sideways().commanded === 0 && Math.abs(this.sideways().measured) < 0.02);
  }

  /** A hold is over: zero within so many ms after its last command, then silence, and the robot stands. */
  async stops(within = AT_ONCE): Promise<void> {
    await until("zero on the bus", 5, () => this.driven().at(-1)?.speed === 0);
    await pass(SILENCE);
    const all = this.driven();
    const drives = all.map(({ speed, steering }) => speed !== 0 || steering !== 0);
    const [held, zero, last] = [all[drives.lastIndexOf(true)], all[drives.lastIndexOf(true) + 1], all.at(-1)];
    ok(held && zero && last, "it was driven, and then zero was said");
    ok(zero.at - held.at <= within, `zero came ${Math.round(zero.at - held.at)} ms after the last command`);
    ok(last.at - zero.at <= ZEROS, `silence: the last zero came ${Math.round(last.at - zero.at)} ms after the first`);
    await until("the robot stands", 10, () => Math.abs(this.truth().speed) < 0.02);
  }

  /** Nothing that moves is said by a page for a while. */
  async silent(ms = SILENCE): Promise<void> {
    const before = this.driven().length;
    await pass(ms);
    ok(this.driven().slice(before).every((each) => each.speed === 0), "no page drives");
  }
}
