// What the range finders measured, from the message that says whether a reading is known, or where only the view of 2011
// comes, from that one: what is not valid there may be silence or a dead sensor, so it is not known.
import { type Range, type Reading, type SensorsPart, type Shown } from "../../protocol";
import { stale } from "../../state";

export type Known = "measured" | "silent" | "unknown";

/** A reading as it is drawn. */
export interface Sounding {
  id: number;
  x: number;
  y: number;
  theta: number;
  /** Full opening angle, rad. */
  beam: number;
  known: Known;
  /** m; null unless measured. */
  distance: number | null;
  /** s from its measurement to the message; null where nobody knows. */
  age: number | null;
}

export interface Soundings {
  shown: Shown<unknown>;
  /** Undefined where nothing came yet. */
  rows: Sounding[] | undefined;
}

const KNOWN: readonly Known[] = ["unknown", "silent", "measured"];

/** NaN where a sender has none: nothing is drawn there. */
function place(x: number | null, y: number | null, theta: number | null): Pick<Sounding, "x" | "y" | "theta"> {
  return { x: x ?? NaN, y: y ?? NaN, theta: theta ?? NaN };
}

function ofReading(reading: Reading, timestamp: number): Sounding {
  const { id, x, y, theta, distance } = reading;
  const known = KNOWN[reading.status] ?? "unknown";
  const measured = known === "measured" && distance !== null;
  return {
    id,
    ...place(x, y, theta),
    beam: reading.beam ?? 0,
    known: known === "measured" && !measured ? "unknown" : known,
    distance: measured ? distance : null,
    age: reading.timestamp > 0 ? (timestamp - reading.timestamp) / 1e6 : null,
  };
}

function ofRange({ id, x, y, theta, distance, valid }: Range, beam: number): Sounding {
  const measured = valid && distance !== null;
  return { id, ...place(x, y, theta), beam, known: measured ? "measured" : "unknown", distance: measured ? distance : null, age: null };
}

function of(part: SensorsPart, kind: number, old: Shown<unknown>, rows: Range[] | undefined, beam: number): Soundings {
  const { value } = part.ranges;
  if (value && (!stale(part.ranges) || rows === undefined || stale(old))) {
    const own = value.readings.filter((reading) => reading.kind === kind);
    return { shown: part.ranges, rows: own.map((reading) => ofReading(reading, value.timestamp)) };
  }
  return { shown: old, rows: rows?.map((range) => ofRange(range, beam)) };
}

/** The sonars; `beam` of those of 2011, rad. */
export function sonars(part: SensorsPart, beam: number): Soundings {
  return of(part, 0, part.sonars, part.sonars.value?.srfs, beam);
}

/** The infrared rangers that look at the floor. */
export function infrareds(part: SensorsPart): Soundings {
  return of(part, 1, part.infrareds, part.infrareds.value?.irs, 0);
}

/** True where such rangers were heard; a robot with a lidar may have none, and none is missed. */
export function has(part: SensorsPart, { rows }: Soundings): boolean {
  return rows !== undefined || part.scans.length === 0;
}
