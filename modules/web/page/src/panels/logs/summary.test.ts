import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { LogRun, RunSummary } from "../../protocol";
import { wanted, words } from "./summary";

test("a run is told by what there was of it", () => {
  const run: RunSummary = { seconds: 1213, distance: 314.2, contacts: 2, stops: 1, errors: 0, warnings: 3 };
  equal(words(run), "20 min 13 s, 314 m, 2 contacts, 1 stop, 3 warnings");
  equal(words({ ...run, distance: 0, contacts: 0, stops: 0, warnings: 0 }), "20 min 13 s, 0.0 m, no contact");
  equal(words({ ...run, contacts: null, errors: 1 }), "20 min 13 s, 314 m, 1 stop, 1 error, 3 warnings");
});

test("the newest runs are asked for, but none that is written to, very long, or known", () => {
  const run = (name: string, more: Partial<LogRun> = {}): LogRun => ({ run: name, bytes: 1e6, recording: false, files: [], ...more });
  const runs = [run("now", { recording: true }), run("long", { bytes: 3e8 }), run("empty", { bytes: 0 }), ...Array.from({ length: 20 }, (_, n) => run(`r${n}`))];
  deepEqual(wanted(runs, new Map([["r0", null], ["r2", null]])), ["r1", "r3", "r4", "r5", "r6", "r7", "r8"]);
});
