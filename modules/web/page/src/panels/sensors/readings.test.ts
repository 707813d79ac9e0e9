import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { Range, Reading, SensorsPart, Shown } from "../../protocol";
import { receive } from "../../state";
import { infrareds, sonars } from "./readings";

const shown = <T>(value: T | null, freshness: Shown<T>["freshness"] = "fresh"): Shown<T> => ({ age: value ? 0 : null, period: 0.25, freshness, value });
const reading = (id: number, status: number, distance: number | null, kind = 0): Reading => ({ timestamp: 9_825_000, id, kind, status, distance, x: 0, y: 0, theta: 0, beam: 0.96 });
const range = (id: number, distance: number | null): Range => ({ id, x: 0, y: 0, theta: 0, distance, valid: distance !== null });

function part(readings: Reading[] | null, srfs: Range[] | null): SensorsPart {
  const part: SensorsPart = {
    part: "sensors",
    sonars: shown(srfs ? { timestamp: 1, srfs } : null),
    infrareds: shown<{ timestamp: number; irs: Range[] }>(null),
    ranges: shown(readings ? { timestamp: 10_000_000, readings } : null),
    scans: [],
    beacons: shown<{ timestamp: number; beacons: [] }>(null),
    scanner: shown<never>(null),
    imus: [],
    persons: shown<{ timestamp: number; persons: [] }>(null),
    people: shown<{ timestamp: number; x: number[]; y: number[]; radius: number[] }>(null),
  };
  receive(part);
  return part;
}

test("a reading is measured, silent or not known, and has its age", () => {
  const all = part([reading(0, 2, 1.5), reading(1, 1, null), reading(2, 0, null), reading(3, 2, null), reading(4, 9, 1), reading(0, 2, 0.1, 1)], null);
  const rows = sonars(all, 0).rows ?? [];
  deepEqual(rows.map(({ known }) => known), ["measured", "silent", "unknown", "unknown", "unknown"]);
  deepEqual([rows[0]?.distance, rows[0]?.age, rows[0]?.beam], [1.5, 0.175, 0.96]);
  equal(infrareds(all).rows?.length, 1);
});

test("the view of 2011 does where nothing better comes, and what is not valid there is not known", () => {
  const rows = sonars(part(null, [range(0, 2), range(1, null)]), 0.5).rows ?? [];
  deepEqual(rows.map(({ known, beam, age }) => [known, beam, age]), [["measured", 0.5, null], ["unknown", 0.5, null]]);
  equal(sonars(part([reading(7, 1, null)], [range(0, 2)]), 0).rows?.[0]?.id, 7);
  equal(sonars(part(null, null), 0).rows, undefined);
});
