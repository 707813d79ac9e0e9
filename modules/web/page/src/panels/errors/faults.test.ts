import { deepEqual, equal, ok } from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { fault } from "./faults";

test("faults are those of docs/faults.md", () => {
  const rows = [...readFileSync("../../../docs/faults.md", "utf8").matchAll(/^\| 0x([0-9A-F]{4}) \| (\w+) \| \w+ \| ([^|]+) \| ([^|]+) \|$/gm)];
  ok(rows.length > 50, String(rows.length));
  for (const [, number, name, means, remedy] of rows) deepEqual(fault(parseInt(number as string, 16)), { name, means, remedy });
  let known = 0;
  for (let number = 0; number < 0x8000; number++) if (fault(number).name !== "Unknown") known += 1;
  equal(known, rows.length);
});

test("others' numbers are said to be others'", () => {
  deepEqual([0x8000, 0x8001, 0x7fff, -1].map((number) => fault(number).name), ["Uncaught", "Foreign", "Unknown", "Unknown"]);
});
