// A web socket that comes back by itself. What was under way when it broke is gone: nothing is said again.
import type { Signal } from "@preact/signals";
import { clock, type Link } from "../state";

/** Waits before the next try, ms: doubling, and shorter once the browser says that there is a network again. */
const FIRST = 250;
const LONGEST = 4000;
/** A socket that stays without a sound for so long is given up, ms. */
const SILENCE = 5000;

export interface Hooks {
  opened(): void;
  heard(frame: unknown): void;
  closed(): void;
}

export class Socket {
  private socket: WebSocket | null = null;
  private wait = FIRST;
  private again: ReturnType<typeof setTimeout> | undefined;
  private lastSound = 0;

  constructor(
    private readonly path: string,
    private readonly link: Signal<Link>,
    private readonly hooks: Hooks,
  ) {
    addEventListener("online", () => this.retryNow());
    document.addEventListener("visibilitychange", () => !document.hidden && this.retryNow());
    setInterval(() => {
      if (this.socket && clock() - this.lastSound > SILENCE) this.drop("it has been silent for too long");
    }, 1000);
  }

  /** Opens it, or opens it anew: after pairing, say, when we are somebody else. */
  open(): void {
    clearTimeout(this.again);
    this.forget();
    const url = new URL(this.path, location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(url);
    this.socket = socket;
    this.lastSound = clock();
    socket.onopen = () => {
      this.lastSound = clock();
      this.link.value = { open: true, heard: null, why: "" };
      this.hooks.opened();
    };
    socket.onmessage = (event) => {
      this.lastSound = clock();
      this.wait = FIRST;
      const frame = parsed(event.data);
      if (frame !== undefined) this.hooks.heard(frame);
    };
    socket.onclose = (event) => {
      if (this.socket === socket) this.lost(event.reason);
    };
  }

  /** Whether it was handed to the network. */
  send(frame: object): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(frame));
    return true;
  }

  close(): void {
    clearTimeout(this.again);
    if (this.forget()) this.hooks.closed();
    this.link.value = { open: false, heard: null, why: "" };
  }

  private drop(why: string): void {
    if (this.forget()) this.lost(why);
  }

  private lost(why: string): void {
    this.socket = null;
    this.link.value = { open: false, heard: null, why };
    this.hooks.closed();
    clearTimeout(this.again);
    this.again = setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(2 * this.wait, LONGEST);
  }

  private retryNow(): void {
    if (this.socket === null && this.again !== undefined) this.open();
  }

  /** Lets go of the socket that there is; its late events are nobody's. */
  private forget(): boolean {
    const socket = this.socket;
    this.socket = null;
    if (!socket) return false;
    socket.onopen = socket.onmessage = socket.onclose = null;
    socket.close();
    return true;
  }
}

function parsed(data: unknown): unknown {
  if (typeof data !== "string") return undefined;
  try {
    return JSON.parse(data);
  } catch {
    return undefined;
  }
}

