// Channels by the level that their names begin with. Pure.

const LEVELS = [
  ["CM_", "Common: states, faults, texts, the recorder (CM_)"],
  ["LL_", "Low level: drives, sensors, power (LL_)"],
  ["ML_", "Middle level: position, goals, plans (ML_)"],
  ["HL_", "High level: actions (HL_)"],
  ["SIM_", "Simulation (SIM_)"],
] as const;
const OTHERS = "Others";

/** The headings, in order. */
export const GROUPS: readonly string[] = [...LEVELS.map(([, head]) => head), OTHERS];

/** The heading of a channel. */
export const group = (channel: string): string => LEVELS.find(([level]) => channel.startsWith(level))?.[1] ?? OTHERS;
