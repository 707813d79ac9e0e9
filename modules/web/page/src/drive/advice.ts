// Why the robot does not move, and what to do about it. The words are the robot's own; the advice is by the numbers of what stands.
import { barred, isDriveGone, leads, pausedBy, pausedByWords } from "../holds";
import { HOLD } from "../numbers";
import type { DrivePart, HoldRow } from "../protocol";
import { t } from "../words";
import { holdRemedy, holdWords, said } from "../words/said";

export interface Advice {
  title: string;
  /** What to do, step by step. */
  steps: string[];
  /** What is offered besides. */
  offer: "home" | "resume" | "modules" | null;
}

/** `held`: an operator stopped it; `yours`: this page has control. null: there is nothing to be done, it moves or only waits to
 *  be told. */
export function advice(part: DrivePart, held: boolean, yours = false): Advice | null {
  if (part.stop.value?.engaged) {
    const who = pausedByWords(part);
    const row = pausedBy(part.holds);
    return {
      title: t("PAUSE: {who} stops the robot", { who }),
      steps: [
        (row && holdRemedy(row)) || t("Release the PAUSE line at {who}.", { who }),
        t("The status goes back to ready by itself."),
        t("Then drive by hand, or resume what the robot did."),
      ],
      offer: null,
    };
  }
  if (held) return { title: t("Stopped by an operator"), steps: [...(yours ? [] : [t("Take control, if nobody has it.")]), t("Slide “Resume”, where Stop was.")], offer: null };
  const bar = barred(part.holds);
  if (bar) return { title: capital(holdWords(bar)), steps: mended(bar, part), offer: "modules" };
  if (leads(part.holds, HOLD.PlannerLatched)) {
    return { title: t("It waits for an operator to resume"), steps: [t("After a stop, or after a hand drove it, it goes on only when an operator says so.")], offer: "resume" };
  }
  if (leads(part.holds, HOLD.NotReleased)) return { title: t("The hand was never off"), steps: [t("Let go of the pad, then press anew.")], offer: null };
  if (part.status.word === "fault" || part.status.word === "silent") {
    return { title: t("Something is wrong"), steps: [said(part.status.reason), t("Look at the modules and errors; a module that failed is started anew by itself.")], offer: "modules" };
  }
  if (leads(part.holds, HOLD.Homing, HOLD.Centering)) {
    return { title: t("The steering is being homed"), steps: [t("It looks for its switch, then turns straight. Wait some seconds.")], offer: null };
  }
  if (part.motion.value && !part.motion.value.homed) {
    const why = said(part.motion.value.reason) || t("The steering does not know where straight ahead is.");
    return { title: t("The steering is not homed"), steps: [why, t("Home it, with room at the front wheels.")], offer: "home" };
  }
  if (part.status.word === "stopped") return { title: t("It does not move"), steps: [said(part.status.reason)], offer: "modules" };
  return null;
}

/** What to do about a cause that no hand ends. Of a drive that is gone: what it says of itself, and what to check. */
function mended(bar: HoldRow, { status }: DrivePart): string[] {
  if (!isDriveGone(bar)) return [holdRemedy(bar)].filter(Boolean);
  const reason = status.word === "fault" ? said(status.reason) : "";
  return [
    ...(reason ? [reason] : []),
    t("Check the supply of the drive, its cable with both plugs, and that its node id is that of the configuration."),
    t("It is started again by itself once it answers; then press the pad anew."),
  ];
}

const capital = (words: string): string => `${words[0]?.toUpperCase() ?? ""}${words.slice(1)}`;
