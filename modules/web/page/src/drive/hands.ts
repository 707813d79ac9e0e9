// What hands do with keys and with a gamepad, as presses, moves and releases. Pure: the browser's events in.
import type { Wish } from "./hold";

export type Act = { act: "press" | "move"; wish: Wish } | { act: "release" } | null;

/** Held beside the keys that drive, it creeps. */
export const CREEP_KEY = "KeyC";

/** By the place of the key, so that WASD is where it should be on every layout. */
const KEYS: Record<string, Wish> = {
  ArrowUp: { speed: 1, steering: 0 },
  ArrowDown: { speed: -1, steering: 0 },
  ArrowLeft: { speed: 0, steering: 1 },
  ArrowRight: { speed: 0, steering: -1 },
  KeyW: { speed: 1, steering: 0 },
  KeyS: { speed: -1, steering: 0 },
  KeyA: { speed: 0, steering: 1 },
  KeyD: { speed: 0, steering: -1 },
};
/** These, too, where the base can go sideways. */
const SIDE_KEYS: Record<string, number> = { KeyQ: 1, KeyE: -1 };

/** The keys that are held. */
export class Keys {
  private readonly held = new Set<string>();
  /** The base goes sideways. */
  sideways = false;

  /** A key that drives. */
  drives(code: string): boolean {
    return code in KEYS || (this.sideways && code in SIDE_KEYS);
  }
  /** A key went down. A repeat is none: of it we may have missed everything that came before. */
  down(code: string, repeat: boolean): Act {
    if (!this.drives(code) || repeat || this.held.has(code)) return null;
    this.held.add(code);
    return { act: this.held.size === 1 ? "press" : "move", wish: this.wish() };
  }
  up(code: string): Act {
    if (!this.held.delete(code)) return null;
    return this.held.size === 0 ? { act: "release" } : { act: "move", wish: this.wish() };
  }
  /** Key-ups may have been missed: all count as up. */
  lost(): Act {
    const had = this.held.size > 0;
    this.held.clear();
    return had ? { act: "release" } : null;
  }
  private wish(): Wish {
    const sum = { speed: 0, steering: 0, sideways: 0 };
    for (const code of this.held) {
      sum.speed += KEYS[code]?.speed ?? 0;
      sum.steering += KEYS[code]?.steering ?? 0;
      sum.sideways += SIDE_KEYS[code] ?? 0;
    }
    const wish = { speed: Math.sign(sum.speed), steering: Math.sign(sum.steering) };
    return this.sideways ? { ...wish, sideways: Math.sign(sum.sideways) } : wish;
  }
}

/** A gamepad as the browser shows it now; null: there is none, or it may not be used. */
export interface Stick {
  deadMan: boolean;
  /** The second input is held: both shoulders. */
  second: boolean;
  /** -1 to 1: forward, and to the left. */
  speed: number;
  steering: number;
  /** Of a base that goes sideways. */
  sideways?: number;
}

/** Around its middle a stick is in the middle. */
const DEAD_ZONE = 0.12;

/** A gamepad drives while its dead-man button is held, which was seen let go before; sticks begin in their middle. */
export class Gamepads {
  private seenReleased = false;
  private driving = false;
  /** The second input, as it was seen last; null: nobody drives. */
  private was: boolean | null = null;

  read(stick: Stick | null): Act {
    if (!stick || !stick.deadMan) {
      const was = this.driving;
      this.driving = false;
      this.seenReleased = stick !== null;
      return was ? { act: "release" } : null;
    }
    const wish: Wish = { speed: outside(stick.speed), steering: outside(stick.steering) };
    if (stick.sideways !== undefined) wish.sideways = outside(stick.sideways);
    if (this.driving) return { act: "move", wish };
    if (!this.seenReleased) return null;
    this.seenReleased = false;
    if (wish.speed !== 0 || wish.steering !== 0 || (wish.sideways ?? 0) !== 0) return null;
    this.driving = true;
    return { act: "press", wish };
  }

  /** The second input, if it changed while the gamepad drives: one that was already held at the press does not count
   *  until it is released. */
  second(stick: Stick | null): boolean | null {
    const [before, now] = [this.was, this.driving && stick ? stick.second : null];
    this.was = now;
    return before === null || now === null || before === now ? null : now;
  }

  /** Its hold has ended: the button must be let go first. */
  over(): void {
    this.driving = false;
  }
}

/** Nothing in the middle, then from nothing on. */
function outside(value: number): number {
  const size = Math.abs(value);
  return size < DEAD_ZONE ? 0 : (Math.sign(value) * (size - DEAD_ZONE)) / (1 - DEAD_ZONE);
}
