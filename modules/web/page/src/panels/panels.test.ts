import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import { against, count, figure, hex, milliseconds, minutes, moment, percent } from "./format";
import { place } from "./errors/faults";
import { begun, demoLink, fileLink, reportLink, started } from "./logs/names";

test("figures are written as people read them", () => {
  deepEqual([0.123, 1, null].map((share) => percent(share, 1)), ["12.3 %", "100.0 %", "–"]);
  deepEqual([0.00123, null].map(milliseconds), ["1.2", "–"]);
  deepEqual([0x20, 0x8611, 0x12345].map((value) => hex(value)), ["0x0020", "0x8611", "0x12345"]);
  equal(hex(-1, 2), "0xFF");
  deepEqual([0, 999, 1234567, NaN].map(count), ["0", "999", "1\u202F234\u202F567", "–"]);
  deepEqual([against(36, 60, "°C"), against(null, 60, "°C"), against(36.04, undefined, "°C")], ["36.0 of 60 °C", "– of 60 °C", "36.0 °C"]);
  deepEqual([7800, 59, 0, -1, null, NaN].map(minutes), ["2 h 10 min", "less than a minute", "less than a minute", "not known", "not known", "not known"]);
});

test("any number has as many digits as tell", () => {
  deepEqual([0, -1.5, 0.1 + 0.2, 123456.789, 1234567.89, 0.00012, -9.87654321e-9].map(figure), ["0", "−1.5", "0.3", "123457", "1.23457e+6", "1.2e−4", "−9.87654e−9"]);
});

test("a moment of another day has its date", () => {
  const noon = new Date(2026, 4, 17, 12, 0, 0);
  equal(moment(noon.getTime() * 1000, noon).includes("2026"), false);
  equal(moment((noon.getTime() - 86_400_000) * 1000, noon).startsWith("2026-05-16 "), true);
  deepEqual([0, -5, NaN, 1e30].map((at) => moment(at)), ["–", "–", "–", "–"]);
});

test("a run is named by when it began, and addressed without its name doing harm", () => {
  equal(started("2026_11_22_09_12_40"), "2026-11-22 09:12:40");
  equal(started("2026_11_22_09_12_40_2"), "2026-11-22 09:12:40 (2)");
  equal(started("else"), "else");
  equal(fileLink("a b", "inputs/x?y.mcap"), "/api/logs/a%20b/inputs/x%3Fy.mcap");
  equal(demoLink("a&b"), "/?demo=a%26b#/map");
  equal(reportLink("a/b"), "/api/runs/a%2Fb/report.png");
  deepEqual([begun("1970_01_02_00_00_01"), begun("else")], [86401, NaN]);
});

test("the documentation is named by file and by what is found there", () => {
  deepEqual(place(0x0104), { file: "docs/faults.md", entry: "0x0104 BoardImplausible" });
  deepEqual(place(0x7fff), { file: "docs/faults.md", entry: "0x7FFF" });
  deepEqual([0x8000, 0x8001].map(place), Array(2).fill({ file: "docs/writing-a-module.md", entry: "0x8000" }));
});
