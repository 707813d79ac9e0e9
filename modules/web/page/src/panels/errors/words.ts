// What is said of faults and texts, apart from how it is shown.
import type { ErrorGroup, Text } from "../../protocol";
import type { Tone } from "../../ui";
import { hex } from "../format";
import { fault } from "./faults";

/** Whether a fault is active: `unknown` when its module does not list its faults any more; it was active when it did. */
export type Standing = "stands" | "unknown" | "over";

export function standing(group: Pick<ErrorGroup, "standing" | "known">): Standing {
  if (!group.standing) return "over";
  return group.known ? "stands" : "unknown";
}

/** `0x0102 BoardLost, sd1_rear` */
export function about(group: Pick<ErrorGroup, "number" | "subject">): string {
  const name = `${hex(group.number)} ${fault(group.number).name}`;
  return group.subject ? `${name}, ${group.subject}` : name;
}

const LEVELS: readonly (readonly [Tone, string])[] = [
  ["off", "debug"],
  ["info", "info"],
  ["warn", "warning"],
  ["bad", "error"],
];

/** A text's level. */
export function level(text: Pick<Text, "level">): readonly [Tone, string] {
  return LEVELS[text.level] ?? ["bad", `unknown (${text.level})`];
}

/** Whether a text, of whatever parts, has all words that were typed, anywhere. */
export function hasAll(parts: string[], words: string[]): boolean {
  const text = parts.join(" ").toLowerCase();
  return words.every((word) => text.includes(word));
}
