// Errors under what stops the robot: which error belongs to which cause (docs/holds.md, docs/faults.md).
import { HOLD_FAULTS } from "../../numbers";
import type { ErrorGroup, HoldRow } from "../../protocol";

type Named = Pick<ErrorGroup, "number" | "subject" | "standing" | "last">;
type Cause = Pick<HoldRow, "code" | "subject" | "since">;

/** µs before a cause within which an error may have begun that belongs to it. */
const BEFORE = 2e6;

function belongs(group: Named, cause: Cause): boolean {
  const now = group.standing || (cause.since !== null && group.last >= cause.since - BEFORE);
  const its = group.subject === "" || cause.subject === "" || group.subject === cause.subject;
  return now && (HOLD_FAULTS.get(cause.code) ?? []).some(({ number, same }) => number === group.number && (its || !same));
}

/** The cause that an error belongs to: of several the weightiest, as they are in order; null: none. */
export function stopOf<C extends Cause>(group: Named, causes: readonly C[]): C | null {
  return causes.find((cause) => belongs(group, cause)) ?? null;
}

/** The causes that have errors, in their order. */
export function stops<C extends Cause>(groups: readonly Named[], causes: readonly C[]): C[] {
  const found = new Set(groups.map((group) => stopOf(group, causes)));
  return causes.filter((cause) => found.has(cause));
}
