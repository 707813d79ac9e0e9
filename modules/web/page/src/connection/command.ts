// The command socket: what is said to the robot, its answers, the round-trip time, and who holds the motion authority.
import type { Answer, Command } from "../protocol";
import { authority, clock, commandLink, me, ourId, roundTrip } from "../state";
import { Socket } from "./socket";

/** ms between pings; how long an answer may take. */
const PING = 250;
const PATIENCE = 3000;

type Numbered = Extract<Command, { id: number }>;
/** A command without the number that `say` gives it. */
export type Sayable = Numbered extends infer C ? (C extends Numbered ? Omit<C, "id"> : never) : never;
/** What comes back for one. */
export type Reply = Extract<Answer, { type: "done" | "refused" | "sdo" }>;

/** Hears what is nobody's answer: that the authority went, that a hold has ended, that the socket is gone. */
export interface Listener {
  authority?(holds: boolean, why: string): void;
  ended?(hold: number, why: string): void;
  closed?(): void;
}
const listeners = new Set<Listener>();
export function listen(listener: Listener): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

const open = new Map<number, { take: (reply: Reply) => void; timer: ReturnType<typeof setTimeout> }>();
let number = 0;
/** Pings without an answer, by when they were said. */
let unanswered: number[] = [];

const socket = new Socket("/ws/command", commandLink, { opened, heard: (frame) => isAnswer(frame) && hear(frame), closed });

/** Says it and waits for the answer. What cannot be said, or is not answered, is refused with the reason. */
export function say(command: Sayable): Promise<Reply> {
  const id = ++number;
  return new Promise((take) => {
    const timer = setTimeout(() => answer({ type: "refused", id, why: "the robot did not answer within 3 s" }), PATIENCE);
    open.set(id, { take, timer });
    if (!send({ ...command, id } as Command)) answer({ type: "refused", id, why: "there is no connection to the robot" });
  });
}

/** Says it without waiting: for `drive`, `zero`, and pings. Whether it was handed to the network. */
export function send(command: Command): boolean {
  return hooks.send ? hooks.send(command) : socket.send(command);
}

/** Set by a fixture, which stands in for the server. */
export const hooks: { send?: (command: Command) => boolean } = {};

export const openCommand = (): void => socket.open();
export const closeCommand = (): void => socket.close();

export function hear(heard: Answer): void {
  switch (heard.type) {
    case "welcome":
      ourId.value = heard.you;
      if (me.value && (me.value.role !== heard.role || me.value.name !== heard.name)) {
        me.value = { ...me.value, role: heard.role, name: heard.name };
      }
      break;
    case "pong":
      unanswered = unanswered.filter((t) => t > heard.t);
      commandLink.value = { ...commandLink.value, heard: clock() };
      roundTrip.value = Math.max(clock() - heard.t, overdue());
      break;
    case "authority":
      authority.value = { holder: heard.holder, yours: heard.yours };
      for (const each of [...listeners]) each.authority?.(heard.yours, heard.why);
      break;
    case "ended":
      for (const each of [...listeners]) each.ended?.(heard.hold, heard.why);
      break;
    default:
      answer(heard);
  }
}

function answer(reply: Reply): void {
  const waiting = reply.id === null ? undefined : open.get(reply.id);
  if (!waiting || reply.id === null) return;
  open.delete(reply.id);
  clearTimeout(waiting.timer);
  waiting.take(reply);
}

export function opened(): void {
  unanswered = [];
  roundTrip.value = null;
  ping();
}

function closed(): void {
  ourId.value = null;
  roundTrip.value = null;
  unanswered = [];
  authority.value = { holder: null, yours: false };
  for (const id of [...open.keys()]) answer({ type: "refused", id, why: "the connection was lost; it is not known whether it was done" });
  for (const each of [...listeners]) each.closed?.();
}

/** How long the oldest ping waits, ms. */
function overdue(): number {
  return unanswered.length ? clock() - (unanswered[0] as number) : 0;
}

function ping(): void {
  if (!commandLink.value.open) return;
  const t = clock();
  if (send({ type: "ping", t })) unanswered.push(t);
}

setInterval(() => {
  if (overdue() > (roundTrip.value ?? PING)) roundTrip.value = overdue();
  ping();
}, PING);

function isAnswer(frame: unknown): frame is Answer {
  return typeof frame === "object" && frame !== null && "type" in frame;
}
