// What is said of faults and texts, apart from how it is shown.
import type { ErrorGroup, Report, Text } from "../../protocol";
import type { Tone } from "../../ui";
import { type Plain, t } from "../../words";
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

const SEVERITIES: readonly (readonly [Tone, Plain])[] = [
  ["info", "notice"],
  ["warn", "warning"],
  ["bad", "error"],
];

export function severity(group: Pick<ErrorGroup, "severity">): readonly [Tone, string] {
  return inWords(SEVERITIES, group.severity);
}

function inWords(all: readonly (readonly [Tone, Plain])[], value: number): readonly [Tone, string] {
  const [tone, word] = all[value] ?? [];
  return tone === undefined || word === undefined ? ["bad", t("unknown ({value})", { value })] : [tone, t(word)];
}

type Named = Pick<ErrorGroup, "module" | "number" | "subject">;

/** Whether a report is of this fault; one whose subject is not known may be. */
export function of(group: Named, report: Report): boolean {
  return report.module === group.module && report.number === group.number && (report.subject === group.subject || report.subject === "");
}

/** µs around a report within which others may have the same cause. */
const BESIDE = 2e6;

/** Reports of other faults at the time of the last one of this. */
export function beside(group: Named & Pick<ErrorGroup, "last">, reports: readonly Report[]): Report[] {
  return reports.filter((report) => !of(group, report) && report.severity > 0 && Math.abs(report.timestamp - group.last) <= BESIDE);
}

const LEVELS: readonly (readonly [Tone, Plain])[] = [
  ["off", "debug"],
  ["info", "info"],
  ["warn", "warning"],
  ["bad", "error"],
];

/** A text's level. */
export function level(text: Pick<Text, "level">): readonly [Tone, string] {
  return inWords(LEVELS, text.level);
}

/** Whether a text, of whatever parts, has all words that were typed, anywhere. */
export function hasAll(parts: string[], words: string[]): boolean {
  const text = parts.join(" ").toLowerCase();
  return words.every((word) => text.includes(word));
}
