// The map in words, for who does not see it and for who wants figures.
import { deg, num } from "../format";
import { HOLD } from "../numbers";
import type { DataGoal, DrivePart } from "../protocol";
import { type Plain, t } from "../words";
import { holdWords, said } from "../words/said";

const QUALITIES = ["lost", "searching", "coarse", "fine"] as const satisfies Plain[];

/** Semi-major axis of two standard deviations, m, from which a position that is searched means nothing. */
const NOWHERE = 50;

/** The estimate is no place: the robot is lost, or anywhere. */
export function isLost(part: DrivePart | null): boolean {
  const quality = part?.estimate.value?.quality ?? 0;
  return quality === 0 || (quality === 1 && (part?.ellipse?.long ?? Infinity) > NOWHERE);
}

/** The state of a goal that is driven to. */
const DRIVES = 1;

/** The robot is on its way to it, or held on the way. */
export const isActive = (goal: DataGoal): boolean => [1, 3].includes(goal.status);

export function positionWords(part: DrivePart | null): string {
  const estimate = part?.estimate.value;
  if (!part || !estimate) return t("The position of the robot is not known yet.");
  const quality = t(QUALITIES[estimate.quality] ?? "unknown");
  if (isLost(part)) return t("The robot does not know where it is.");
  const at = { x: num(estimate.x, 2), y: num(estimate.y, 2, "m"), heading: deg(estimate.theta), quality };
  if (!part.ellipse) return t("At {x}, {y}, heading {heading}; {quality}.", at);
  return t("At {x}, {y}, heading {heading}; {quality}, ±{place} and ±{turn}.", { ...at, place: num(part.ellipse.long, 2, "m"), turn: deg(part.ellipse.heading, 1) });
}

/** Length of a line through these places, and the direction of its last piece. */
export function measureWords(all: readonly { x: number; y: number }[]): string {
  const pieces = all.slice(1).map(({ x, y }, n) => ({ dx: x - (all[n]?.x ?? x), dy: y - (all[n]?.y ?? y) }));
  const last = pieces.at(-1);
  if (!last) return all.length === 0 ? t("Tap the map where to begin.") : t("Tap the next place.");
  const length = pieces.reduce((sum, { dx, dy }) => sum + Math.hypot(dx, dy), 0);
  const line = { length: num(length, 2, "m"), heading: deg(Math.atan2(last.dy, last.dx)) };
  if (pieces.length === 1) return t("{length}, to {heading}.", line);
  return t("{length} over {n} pieces, the last of {last}, to {heading}.", { ...line, n: pieces.length, last: num(Math.hypot(last.dx, last.dy), 2, "m") });
}

/** m/s below which a robot counts as standing, as in the guard. */
const STANDS = 0.02;

/** Speed forward that the source asks for which moves the robot, or would; null: nobody does. */
function asked(part: DrivePart): number | null {
  const { source } = part.motion.value ?? { source: "" };
  const velocity = part.velocity_commands.find((each) => each.source === source);
  return velocity?.vx ?? part.commands.find((each) => each.source === source)?.speed ?? null;
}

/** The bound of the guard in sentences without a stop: the robot's words, which at standstill are of the way that is bounded
 *  most; of the other way where somebody asks for that, and of both where neither is free. */
export function boundWords(part: DrivePart): string[] {
  const [bound, guard] = [part.bound, part.guard.value];
  if (!bound) return [];
  const [speed, wish] = [part.motion.value?.speed ?? 0, asked(part) ?? 0];
  const [ahead, back] = [guard?.forward ?? NaN, guard?.backward ?? NaN];
  const told = speed > STANDS ? 1 : speed < -STANDS || back < ahead ? -1 : 1;
  if (guard === null || bound.creeping || wish === 0 || Math.sign(wish) === told) return [said(bound.words)];
  const most = wish > 0 ? ahead : back;
  const limit = { speed: num(most, 2, "m/s") };
  // What is not a number permits nothing.
  if (most > 0) return [wish > 0 ? t("at most {speed} forward", limit) : t("at most {speed} backward", limit)];
  return [wish > 0 ? t("must not move forward") : t("must not move backward"), said(bound.words)];
}

/** What the guard permits, and what is in its fields; empty for a robot without a guard. */
export function guardWords(part: DrivePart | null): string {
  if (!part?.bound) return "";
  const fields = (part.guard.value?.fields ?? []).filter((field) => field.occupied);
  const [near, far] = [fields.some(({ kind }) => kind === 0), fields.some(({ kind }) => kind !== 0)];
  const occupied = near && far ? t("Something is in the protective and the warning field.") : near ? t("Something is in the protective field.") : far ? t("Something is in the warning field.") : "";
  return [...boundWords(part).map((words) => `${words[0]?.toUpperCase()}${words.slice(1)}.`), ...(occupied ? [occupied] : [])].join(" ");
}

/** Causes by which the guard makes the robot stand. */
const GUARD: readonly number[] = [HOLD.GuardStops, HOLD.GuardSlows, HOLD.GuardUnknown, HOLD.GuardBlind, HOLD.GuardMotion, HOLD.GuardLate, HOLD.GuardBounds];

/** Why the robot stands, where the planner's words say something else: it takes space that is not known for somebody, and
 *  says that it drives while the guard holds it, or before it begins. Empty: the planner's words are right. */
export function standsWhy(part: DrivePart | null): string {
  const goal = part?.goal.value;
  if (!part || !goal || part.status.word !== "waiting" || part.status.reason !== goal.message) return "";
  const guard = part.guard.value;
  // What is not a number permits nothing. Where the robot stands, the cause is that of the way that is bounded most.
  const closed = guard !== null && Math.min(guard.forward ?? 0, guard.backward ?? 0) <= 0;
  const unknown = closed && guard.code === HOLD.GuardUnknown ? t("no data of {sensor}", { sensor: said(guard.subject) }) : "";
  const own = part.holds.filter(({ module }) => module === "planner");
  if (own.some((row) => row.code === HOLD.SomebodyNear)) return unknown;
  if (goal.status !== DRIVES || own.length > 0) return "";
  const notice = part.holds.find((row) => row.module === "driver_canbus" && GUARD.includes(row.code));
  return unknown || (notice ? holdWords(notice) : t("stands for a moment on the way to waypoint {n}", { n: goal.waypoint + 1 }));
}

/** The planner's own words where it has some, except that it waits because an operator stopped the robot, or stands for
 *  another reason, `why`. */
export function goalWords(goal: DataGoal | null | undefined, stopped = false, why = ""): string {
  if (goal && stopped && isActive(goal)) return t("Waits: an operator stopped the robot.");
  if (!goal) return t("No data of the planner yet.");
  const left = goal.remaining === null || !isActive(goal) ? "" : `, ${t("{distance} to go", { distance: num(goal.remaining, 1, "m") })}`;
  if (why) return `${t("Waits: {why}", { why })}${left}.`;
  const own = said(goal.message);
  if (own) return `${own[0]?.toUpperCase()}${own.slice(1)}${left}.`;
  const to = { n: goal.waypoint + 1 };
  const words = [t("No goal"), t("Drives to waypoint {n}", to), t("The goal is reached"), t("Blocked on the way to waypoint {n}", to), t("The goal failed"), t("The goal was cancelled")];
  return `${words[goal.status] ?? t("The state of the goal is not known")}${left}.`;
}
