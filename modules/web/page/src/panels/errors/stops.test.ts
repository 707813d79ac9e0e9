import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import { HOLD } from "../../numbers";
import { stopOf, stops } from "./stops";

const error = (number: number, subject: string, of: { standing?: boolean; last?: number } = {}) => ({ number, subject, standing: true, last: 100e6, ...of });
const cause = (code: number, subject: string, since: number | null = 100e6) => ({ code, subject, since });

const PAUSE = cause(HOLD.PauseBumper, "bumper2");
const DRIVE = cause(HOLD.DriveFault, "steering");

test("what the drives report in PAUSE is under the bumper, not under the drive", () => {
  equal(stopOf(error(0x0205, "steering"), [PAUSE, DRIVE]), PAUSE);
  equal(stopOf(error(0x0202, "propulsion"), [PAUSE, DRIVE]), PAUSE);
  equal(stopOf(error(0x0205, "steering"), [DRIVE]), DRIVE);
  equal(stopOf(error(0x0205, "propulsion"), [DRIVE]), null, "another drive");
  equal(stopOf(error(0x0703, "fan2"), [PAUSE, DRIVE]), null);
});

test("an error without a subject, as in older logs, is not left out", () => {
  equal(stopOf(error(0x0205, ""), [DRIVE]), DRIVE);
});

test("a cleared error belongs to a stop that it came with, not to a later one", () => {
  const cleared = (last: number) => error(0x0202, "steering", { standing: false, last });
  deepEqual([99e6, 98e6, 97e6].map((last) => stopOf(cleared(last), [PAUSE])), [PAUSE, PAUSE, null]);
  equal(stopOf(cleared(100e6), [cause(HOLD.PauseBumper, "bumper2", null)]), null, "since when it stands is not known");
});

test("causes with errors are in their order, those without have no heading", () => {
  const lost = cause(HOLD.EstimateLost, "");
  deepEqual(stops([error(0x0804, "pose"), error(0x0202, "steering")], [PAUSE, cause(HOLD.BusDown, "can.main"), lost]), [PAUSE, lost]);
  deepEqual(stops([error(0x0703, "fan2")], [PAUSE]), []);
  deepEqual(stops([error(0x0205, "steering")], [cause(9999, "")]), [], "a cause of a later version");
});
