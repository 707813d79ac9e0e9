// Operation mode and parameters of the planner: their names, and what is said of them. Pure.
import { num } from "../format";
import type { DataMode, LiveParameter } from "../protocol";
import { type Plain, t } from "../words";
import { said } from "../words/said";

/** Modes by their numbers: as they are commanded, and as they are shown. */
export const MODES: readonly (readonly [command: string, shown: Plain])[] = [
  ["manual", "Manual"],
  ["route", "Route"],
  ["wait", "Wait"],
  ["approach", "Approach"],
  ["home", "Home¦place"],
];
const ROUTE = 1;
const HOME = 4;

/** Why the robot cannot enter this mode; null: it can. */
export function modeWhyNot(number: number, current: Pick<DataMode, "has_home">): string | null {
  return number === HOME && !current.has_home ? t("No home place is configured.") : null;
}

/** What the robot does in its mode; empty in the mode route, where the goal says it. */
export function modeWords(current: DataMode | null | undefined): string {
  if (!current || current.mode === ROUTE) return "";
  const shown = MODES[current.mode]?.[1];
  const text = said(current.text);
  return `${t("Mode: {name}", { name: t(shown ?? "not known") })}${text ? `, ${text}` : ""}.`;
}

/** A parameter whose values are all numbers. */
export interface Usable {
  name: string;
  value: number;
  minimum: number;
  maximum: number;
  configured: number;
}

export function usable(parameters: readonly LiveParameter[]): Usable[] {
  return parameters.flatMap(({ name, value, minimum, maximum, configured }) =>
    value === null || minimum === null || maximum === null || configured === null || minimum > maximum ? [] : [{ name, value, minimum, maximum, configured }],
  );
}

const NAMES: Readonly<Record<string, Plain>> = {
  speed_mps: "Speed limit",
  speed_reverse_mps: "Speed in reverse",
  speed_unseen_mps: "Speed where it does not see",
  speed_approach_mps: "Speed towards a person",
  margin_m: "Distance beside obstacles",
  stop_distance_m: "Distance before obstacles",
  people_margin_m: "Distance from people on the way",
  approach_distance_m: "Distance from a person it approaches",
  patience_s: "Patience",
};

/** A parameter as people call it; one of a newer robot by its own name. */
export function parameterName(name: string): string {
  const known = NAMES[name];
  return known ? t(known) : name;
}

/** The end of a name is the unit. */
const UNITS: readonly (readonly [end: string, unit: string, step: number])[] = [["_mps", "m/s", 0.01], ["_m", "m", 0.01], ["_s", "s", 0.5]];

const unitOf = (name: string) => UNITS.find(([end]) => name.endsWith(end));

export function valueWords(name: string, value: number): string {
  const [, unit, step] = unitOf(name) ?? ["", "", 0.01];
  return num(value, step < 0.1 ? 2 : 1, unit);
}

/** What one step of its slider changes. */
export const stepOf = (name: string): number => unitOf(name)?.[2] ?? 0.01;

/** The value that a slider means: its ends are the ends of the range, whatever its steps are. */
export function meant({ name, minimum, maximum }: Usable, slid: number): number {
  const near = stepOf(name) * 0.75;
  if (slid >= maximum - near) return maximum;
  return slid <= minimum + near ? minimum : Math.round(slid * 1000) / 1000;
}
