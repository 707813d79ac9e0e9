// A message as a tree of fields, each with the way to it: "srfs[3].distance".
import { UNITS } from "../../units";

export type Leaf = number | string | boolean | null;

export interface Field {
  /** The way to it from the message. */
  path: string;
  /** Its own name: "distance", "[3]". */
  name: string;
  depth: number;
  /** Of a branch: how much is in it; a leaf has none. */
  size: number | null;
  /** A list, not a record. */
  list: boolean;
  value: Leaf;
}

/** Lines that are shown of one message. */
export const FIELDS_MAX = 400;

function isBranch(value: unknown): value is Record<string, unknown> | unknown[] {
  return typeof value === "object" && value !== null;
}

/** The lines of a message whose branches `open` opens, and whether there are more than are listed. */
export function fields(message: Record<string, unknown>, open: (path: string) => boolean): { lines: Field[]; more: boolean } {
  const lines: Field[] = [];
  let more = false;
  const walk = (value: Record<string, unknown> | unknown[], path: string, depth: number) => {
    const list = Array.isArray(value);
    for (const [name, inner] of Object.entries(value)) {
      if (lines.length >= FIELDS_MAX) {
        more = true;
        return;
      }
      const way = list ? `${path}[${name}]` : path ? `${path}.${name}` : name;
      const shown = list ? `[${name}]` : name;
      if (!isBranch(inner)) {
        lines.push({ path: way, name: shown, depth, size: null, list: false, value: leaf(inner) });
        continue;
      }
      const size = Array.isArray(inner) ? inner.length : Object.keys(inner).length;
      lines.push({ path: way, name: shown, depth, size, list: Array.isArray(inner), value: null });
      if (open(way)) walk(inner, way, depth + 1);
    }
  };
  walk(message, "", 0);
  return { lines, more };
}

function leaf(value: unknown): Leaf {
  if (typeof value === "number" || typeof value === "string" || typeof value === "boolean") return value;
  return null;
}

/** Unit of instants: what a definition states in µs is µs since 1970. */
const INSTANT = "µs";

/** Whether a field is an instant, µs since 1970: by the definition of its type, or in a type that is not ours by its name and size. */
export function isInstant(type: string, { path, value }: Pick<Field, "path" | "value">): boolean {
  if (typeof value !== "number") return false;
  if (UNITS.has(type)) return unit(type, path) === INSTANT;
  return /(^|\.)(timestamp|since)$/.test(path) && value > 1e14;
}

/** The unit of a field of a type, as its definition states it; empty: none, or a type that is not ours. */
export function unit(type: string, path: string): string {
  return UNITS.get(type)?.get(path.replace(/\[\d+\]/g, "")) ?? "";
}

/** What stands at a way; undefined where the message has no such place. */
export function at(message: Record<string, unknown>, path: string): unknown {
  let here: unknown = message;
  for (const step of path.match(/[^.[\]]+/g) ?? []) {
    if (!isBranch(here) || !Object.hasOwn(here, step) || (Array.isArray(here) && !/^\d+$/.test(step))) return undefined;
    here = (here as Record<string, unknown>)[step];
  }
  return here;
}

/** What a plot takes of a value: numbers; true and false as 1 and 0; a gap for all else. */
export function plotted(value: unknown): number | null {
  if (typeof value === "number") return Number.isFinite(value) ? value : null;
  if (typeof value === "boolean") return value ? 1 : 0;
  return null;
}
