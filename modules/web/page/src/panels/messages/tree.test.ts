import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import { GROUPS, group } from "./groups";
import { at, fields, FIELDS_MAX, isInstant, plotted, unit } from "./tree";

const MESSAGE = { timestamp: 1, srfs: [{ id: 0, valid: true }, { id: 1, valid: false }], name: "a", covariance: [[1, 2], [3, null]] };

test("closed branches say how much is in them", () => {
  const { lines, more } = fields(MESSAGE, () => false);
  deepEqual(
    lines.map(({ path, size, value }) => [path, size, value]),
    [
      ["timestamp", null, 1],
      ["srfs", 2, null],
      ["name", null, "a"],
      ["covariance", 2, null],
    ],
  );
  equal(more, false);
});

test("each line has the way to its value", () => {
  const { lines } = fields(MESSAGE, () => true);
  for (const { path, size, value } of lines) if (size === null) deepEqual(at(MESSAGE, path), value);
  deepEqual(lines.find(({ path }) => path === "covariance[1][0]")?.value, 3);
  deepEqual(lines.find(({ path }) => path === "srfs[1].valid")?.depth, 2);
});

test("a place that is not there is undefined, and no place of the language's own", () => {
  for (const path of ["srfs[7].id", "nothing", "name.length", "srfs.length", "constructor", "__proto__.x"]) equal(at(MESSAGE, path), undefined, path);
});

test("a long message is cut, and said to be", () => {
  const { lines, more } = fields({ list: Array.from({ length: 10_000 }, (_, n) => n) }, () => true);
  equal(lines.length, FIELDS_MAX);
  equal(more, true);
});

test("numbers and switches are plotted, all else is a gap", () => {
  deepEqual([1.5, true, false, null, "1", undefined, NaN].map(plotted), [1.5, 1, 0, null, null, null, null]);
});

test("a field has the unit of its definition, in each place of a list", () => {
  equal(unit("lowlevel.data_srfs_t", "srfs[12].distance"), "m");
  equal(unit("lowlevel.data_odo_t", "rotation"), "rad/s");
  equal(unit("middlelevel.data_estimate_t", "covariance[1][2]"), "m², m rad, rad²");
  for (const [type, path] of [["lowlevel.data_srfs_t", "srfs[0].id"], ["lowlevel.data_srfs_t", "constructor"], ["foreign_t", "x"], ["", ""]] as const) equal(unit(type, path), "", path);
});

test("instants are known by the definition, whatever their names", () => {
  const now = 1.79e15;
  const is = (type: string, path: string, value: number | null = now) => isInstant(type, { path, value });
  equal(is("middlelevel.data_beacon_use_t", "beacons[3].last"), true);
  equal(is("middlelevel.data_beacon_use_t", "beacons[3].last", 0), true);
  for (const [type, path] of [["lowlevel.data_beacons_t", "timestamp"], ["lowlevel.data_hold_t", "holds[0].since"], ["common.data_faults_t", "faults[1].since"]] as const) equal(is(type, path), true, path);
  for (const [type, path] of [["middlelevel.data_beacon_use_t", "beacons[3].x"], ["lowlevel.data_srfs_t", "srfs[0].id"]] as const) equal(is(type, path), false, path);
  // Of a type that is not ours nothing else is known.
  deepEqual([is("foreign_t", "head.timestamp"), is("foreign_t", "timestamp", 12), is("foreign_t", "last"), is("foreign_t", "since", null)], [true, false, false, false]);
});

test("a channel is in the group of its level", () => {
  deepEqual(["LL_DATA_ODO", "CM_DATA_STATE", "SIM_DATA_TRUTH", "ML_DATA_GOAL", "HL_DATA_ACTION", "MY_OWN"].map((channel) => GROUPS.indexOf(group(channel))), [1, 0, 4, 2, 3, 5]);
});
