// Causes for which the robot does not act, by number (docs/holds.md). The words are the robot's; nothing here reads them.
import { HOLD } from "./numbers";
import type { DrivePart, HoldRow } from "./protocol";
import { t } from "./words";
import { holdWho } from "./words/said";

const PAUSE: readonly number[] = [HOLD.PauseBumper, HOLD.PauseFloor, HOLD.PauseButton, HOLD.PauseField, HOLD.PauseInput, HOLD.PauseOther];
const IDLE: readonly number[] = [HOLD.NobodyCommands, HOLD.NoGoal, HOLD.ModeManual, HOLD.WaitsForPeople];

/** Causes that end by themselves, or by what is done at the robot: no press of a pad moves it while one stands. */
const BARS: readonly number[] = [
  HOLD.PauseUnknown, HOLD.PauseFieldUnknown, HOLD.PauseInputUnknown,
  HOLD.BusDown, HOLD.BusUnacknowledged, HOLD.SecondMaster,
  HOLD.DriveBooting, HOLD.DriveBootFailed, HOLD.DriveLost, HOLD.DriveDeaf, HOLD.DriveDropped, HOLD.DriveStuck, HOLD.DriveNoTarget, HOLD.DriveFault, HOLD.DriveUnseen,
  HOLD.SpeedExceeded, HOLD.FeedCut, HOLD.SecondWayLost, HOLD.FeedOff, HOLD.WheelStood,
  HOLD.CriticalModule, HOLD.WatchdogSilent, HOLD.SecondRobot, HOLD.RangingLost,
];

/** The weightiest cause against the motion that no hand ends; null: none. */
export function barred(holds: readonly HoldRow[]): HoldRow | null {
  return holds.find(({ module, code }) => module === "driver_canbus" && BARS.includes(code)) ?? null;
}

/** A drive that does not answer, whatever its protocol. */
export const isDriveGone = ({ code }: HoldRow): boolean => code === HOLD.DriveLost || code === HOLD.DriveBootFailed || code === HOLD.DriveDeaf;

/** The weightiest of each module: they are in order, those of a module together. */
export function leading(holds: readonly HoldRow[]): HoldRow[] {
  return holds.filter((row, n) => row.module !== holds[n - 1]?.module);
}

/** Whether one of these numbers is the weightiest of a module. */
export function leads(holds: readonly HoldRow[], ...codes: number[]): boolean {
  return leading(holds).some(({ code }) => codes.includes(code));
}

/** What engages the PAUSE line. */
export function pausedBy(holds: readonly HoldRow[]): HoldRow | null {
  return holds.find(({ code }) => PAUSE.includes(code)) ?? null;
}

/** The same as people call it; of a recording from before the numbers by the name on the line. */
export function pausedByWords(part: DrivePart | null): string {
  const row = pausedBy(part?.holds ?? []);
  return (row && holdWho(row)) || part?.stop.value?.source || t("somebody");
}

/** A latched cause that a hand ends by its press; that of the planner, a goal ends, and a hand that must let go first ends
 *  nothing else. */
export function waitsForHand(holds: readonly HoldRow[]): boolean {
  return holds.some(({ code, latched }) => latched && code !== HOLD.PlannerLatched && code !== HOLD.NotReleased);
}

/** driver_canbus was commanded into PAUSE or STOP; null: its list is not known. */
export function isHeld(holds: readonly HoldRow[]): boolean | null {
  // A recording from before the numbers.
  if (holds.some(({ code }) => code === 0)) return null;
  return holds.some(({ code, subject }) => subject === "driver_canbus" && (code === HOLD.ModulePaused || code === HOLD.ModuleStopped));
}

/** All but that nobody asks for anything. */
export function standing(holds: readonly HoldRow[]): HoldRow[] {
  return holds.filter(({ code }) => !IDLE.includes(code));
}
