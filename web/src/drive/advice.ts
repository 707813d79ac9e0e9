// Why the robot does not move, and what to do about it. The reason is the robot's own words; the advice is by what they say.
import type { DrivePart } from "../protocol";

export interface Advice {
  title: string;
  /** What to do, step by step. */
  steps: string[];
  /** What is offered besides. */
  offer: "home" | "resume" | "modules" | null;
}

/** Where a PAUSE comes from, in words: the names that the power board gives. */
export function stopSource(source: string): string {
  const bumper = /^bumper([1-8])$/.exec(source);
  if (bumper) return `bumper ${bumper[1]}`;
  if (source === "sd1_front") return "the front distance sensors";
  if (source === "sd1_rear") return "the rear distance sensors";
  if (source === "button") return "the red button";
  return source || "somebody";
}

/** null: there is nothing to be done, it moves or only waits to be told. */
export function advice(part: DrivePart, held: boolean): Advice | null {
  const reason = part.motion.value?.reason ?? "";
  const line = part.stop.value;
  if (line?.engaged) {
    const what = line.source === "button" ? "Turn the red button until it springs out." : `Clear what touches ${stopSource(line.source)}.`;
    return {
      title: `PAUSE: ${stopSource(line.source)} stops the robot`,
      steps: [what, "The status goes back to ready by itself.", "Then drive by hand, or let the robot go on with what it did."],
      offer: null,
    };
  }
  if (held) return { title: "Stopped by an operator", steps: ["Take control, if nobody has it.", "Slide “Let it go on”, where Stop was."], offer: null };
  const waits = `${reason} ${part.goal.value?.message ?? ""}`;
  if (/waits for an operator|must be let go by an operator/.test(waits)) {
    return { title: "It waits to be let go on", steps: ["After a stop, or after a hand drove it, it goes on only when an operator says so."], offer: "resume" };
  }
  if (/must send zero first/.test(reason)) return { title: "The hand was never off", steps: ["Let go of the pad, then press anew."], offer: null };
  if (part.status.word === "fault" || part.status.word === "silent") {
    return { title: "Something is wrong", steps: [part.status.reason, "Look at the modules and errors; a module that failed is started anew by itself."], offer: "modules" };
  }
  if (/is being homed|is homed and turns straight/.test(reason)) {
    return { title: "The steering is being homed", steps: ["It looks for its switch, then turns straight. Wait some seconds."], offer: null };
  }
  if (part.motion.value && !part.motion.value.homed) {
    return { title: "The steering is not homed", steps: [reason || "The steering does not know where straight ahead is.", "Home it, with room at the front wheels."], offer: "home" };
  }
  if (part.status.word === "stopped") return { title: "It does not move", steps: [part.status.reason], offer: "modules" };
  return null;
}
