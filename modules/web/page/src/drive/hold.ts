// Hold to run. The robot is driven only while a hand is on the pad, the keys or a gamepad's dead-man button; a press that
// ended, for whatever reason, is over for good. A second input, held beside it, lets the robot creep past its guard. Pure:
// events and the page's clock in, commands out.
import type { Command } from "../protocol";

export type Source = "pad" | "keys" | "gamepad";

/** Where the hand is, as a share of what is allowed, -1 to 1: forward, turning to the left, and going to the left. */
export interface Wish {
  speed: number;
  steering: number;
  sideways?: number;
}

/** What is commanded: m/s and rad; of a base that does not steer its rotation, rad/s, and m/s to the left if it can. */
export interface Demand {
  speed: number;
  steering: number;
  rotation?: number;
  sideways?: number;
}

export type DriveCommand = Extract<Command, { type: "drive" | "zero" }>;

/** ms between two commands: 20 Hz. */
export const PERIOD = 50;
/** The robot ends a hold that says nothing for so long, and so does the page when it was not running. ms. */
export const STALL = 200;

interface Current {
  source: Source;
  hold: number;
  wish: Wish;
  /** When it spoke last. */
  spoke: number;
  /** When it shall speak next. */
  next: number;
  /** The second input is held. */
  creep: boolean;
}

export class Hold {
  private current: Current | null = null;
  private hold = 0;
  private seq = 0;
  private max: Demand = { speed: 0, steering: 0 };
  private whyNot: string | null = "Nothing is known of the robot yet.";
  /** Why the last one ended, in English; empty: the hand let go. */
  ended = "";

  constructor(private readonly say: (command: DriveCommand) => void) {}

  /** Who drives; null: nobody. */
  get holding(): Source | null {
    return this.current?.source ?? null;
  }

  /** What is commanded now. */
  get commanded(): Demand | null {
    return this.current && this.scaled(this.current.wish);
  }

  /** The second input is held, and counts. */
  get creeping(): boolean {
    return this.current?.creep ?? false;
  }

  /** m/s and rad at the ends of the pad. With a rotation, rad/s, the base does not steer; it may go sideways, m/s. */
  limit(speed: number, steering: number, free: { rotation?: number; sideways?: number } = {}): void {
    this.max = { speed, steering, ...free };
  }

  /** Whether driving is allowed; when it ceases to be, a hold ends. */
  allow(whyNot: string | null): void {
    this.whyNot = whyNot;
    if (whyNot !== null) this.end(whyNot);
  }

  /** A hand takes hold. While another one does, that ends, and this does not begin: two hands are one too many. */
  press(source: Source, wish: Wish, at: number): boolean {
    if (this.current) {
      this.end("Two hands at once.");
      return false;
    }
    if (this.whyNot !== null || !finite(wish)) return false;
    this.hold += 1;
    this.ended = "";
    this.current = { source, hold: this.hold, wish, spoke: at, next: at, creep: false };
    this.tick(at);
    return true;
  }

  /** The hand moves. It is said with the next command. */
  move(source: Source, wish: Wish): void {
    if (this.current?.source !== source) return;
    if (finite(wish)) this.current.wish = wish;
    else this.end("The hand's place was not a number.");
  }

  /** The second input was pressed, or let go. It counts from a press while a hand drives, and its end is reported at once. */
  second(held: boolean, at: number): void {
    const current = this.current;
    if (!current || current.creep === held) return;
    current.creep = held;
    if (!held) current.next = at;
    this.tick(at);
  }

  /** The hand is off, or may be: zero at once. */
  release(source: Source, why = ""): void {
    if (this.current?.source === source) this.end(why);
  }

  /** For any input: the page is hidden, left, or Stop was pressed. */
  letGo(why: string): void {
    this.end(why);
  }

  /** The robot ended it. Nothing is said: it has stopped already. */
  endedByRobot(hold: number, why: string): void {
    if (this.current?.hold !== hold) return;
    this.current = null;
    this.ended = why;
  }

  /** To be called often while somebody drives. Says what is due. */
  tick(at: number): void {
    const current = this.current;
    if (!current || at < current.next) return;
    if (at - current.spoke > STALL) {
      this.end("The page was not running for a moment.");
      return;
    }
    current.spoke = at;
    // From the last due time, so that the rate holds; what was missed is dropped.
    current.next = Math.max(current.next + PERIOD, at + PERIOD / 2);
    this.seq += 1;
    const creep = current.creep ? { creep: true } : {};
    this.say({ type: "drive", hold: current.hold, seq: this.seq, t: at, ...this.scaled(current.wish), ...creep });
  }

  private end(why: string): void {
    const current = this.current;
    if (!current) return;
    this.current = null;
    this.ended = why;
    this.seq += 1;
    this.say({ type: "zero", hold: current.hold, seq: this.seq });
  }

  private scaled(wish: Wish): Demand {
    const { speed, steering, rotation, sideways } = this.max;
    const ahead = share(wish.speed) * speed;
    if (rotation === undefined) return { speed: ahead, steering: share(wish.steering) * steering };
    const aside = sideways === undefined ? {} : { sideways: share(wish.sideways ?? 0) * sideways };
    return { speed: ahead, steering: 0, rotation: share(wish.steering) * rotation, ...aside };
  }
}

const share = (value: number): number => Math.max(-1, Math.min(1, value));
const finite = (wish: Wish): boolean => [wish.speed, wish.steering, wish.sideways ?? 0].every(Number.isFinite);
