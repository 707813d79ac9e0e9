// A message that is written by hand, before it is published. Pure: the server judges it, this only says early what it would refuse.
import type { Publishable } from "../../protocol";

/** Bytes of a frame to the robot: a longer one closes the socket. */
const FRAME_MAX = 4096;

export interface Draft {
  channel: string;
  /** Type of its messages, of a channel that is not the robot's; else empty. */
  type: string;
  /** JSON. */
  text: string;
}

/** What the server sets by itself: the time, and in commands who sends them. */
const isSet = (channel: string, name: string): boolean => name === "timestamp" || (name === "source" && channel.includes("_CMD_"));

/** The fields of a message as text to begin with, without what the server sets. */
export function written(channel: string, message: Record<string, unknown>): string {
  return JSON.stringify(Object.fromEntries(Object.entries(message).filter(([name]) => !isSet(channel, name))), null, 2);
}

/** The text to begin with on a channel: its last message, else one in which everything is zero. */
export function beginning(channel: string, last: Record<string, unknown> | null, offers: readonly Publishable[]): string {
  const offer = offers.find((each) => each.channel === channel);
  return written(channel, last ?? (offer ? (JSON.parse(offer.message) as Record<string, unknown>) : {}));
}

/** The frame that publishes it. */
export function command({ channel, type, text }: Draft): { type: "publish"; channel: string; message_type: string; message: string } {
  // Without the blanks that it has for people.
  return { type: "publish", channel, message_type: type, message: JSON.stringify(JSON.parse(text)) };
}

/** Why it cannot be published as it is; null: the robot may be asked. `heard`: the channels and the types that were heard on them. */
export function wrong(draft: Draft, offers: readonly Publishable[], heard: readonly { channel: string; type: string }[]): string | null {
  const { channel, type, text } = draft;
  if (channel === "") return "Choose a channel first.";
  const isOffered = offers.some((offer) => offer.channel === channel);
  if (!isOffered && heard.some((row) => row.channel === channel && row.type !== "")) return "The robot itself speaks on this channel: nobody else may.";
  if (!isOffered && type === "") return "The channel is not one of the robot's: choose the type of its messages.";
  let value: unknown;
  try {
    value = JSON.parse(text);
  } catch (error) {
    return `This is no JSON: ${error instanceof Error ? error.message : error}`;
  }
  if (typeof value !== "object" || value === null || Array.isArray(value)) return "A message is an object: {\"field\": value, …}.";
  // The number that the frame gets on its way.
  const frame = JSON.stringify({ ...command(draft), id: Number.MAX_SAFE_INTEGER });
  return new TextEncoder().encode(frame).length > FRAME_MAX ? "The message is too long: at most 4 kB are sent at once." : null;
}
