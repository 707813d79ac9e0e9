import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import { controllerState, driveError, nmtState, powerState, statusBits } from "./cia402";

test("a statusword names its state whatever its other bits say", () => {
  const states: [number, string][] = [
    [0x0000, "Not ready to switch on"],
    [0x0240, "Switch on disabled"],
    [0x0260, "Switch on disabled"],
    [0x0231, "Ready to switch on"],
    [0x0233, "Switched on"],
    [0x1637, "Operation enabled"],
    [0x0217, "Quick stop active"],
    [0x021f, "Fault reaction active"],
    [0x023f, "Fault reaction active"],
    [0x0218, "Fault"],
    [0x0238, "Fault"],
    [0x0004, "no state of CiA 402"],
  ];
  for (const [word, name] of states) equal(powerState(word).name, name, word.toString(16));
});

test("each statusword of 16 bits has one state at most", () => {
  const all = new Set(Array.from({ length: 0x10000 }, (_, word) => powerState(word).name));
  equal(all.size, 9);
  equal(powerState(0x27).sort, "moves");
  equal(powerState(0x08).sort, "fault");
  equal(powerState(0x07).sort, "stands");
  equal(powerState(0x40).sort, "rests");
});

test("a motor controller without CANopen has plain words, and none of CiA 402", () => {
  const said = ([nmt, word]: [number, number]) => controllerState(nmt, word).name;
  const all = ([[5, 0x27], [5, 0x07], [127, 0x40], [127, 0x08], [-1, 0], [5, 0]] as [number, number][]).map(said);
  deepEqual(all, ["follows commands", "quick stop", "off or starting", "fault", "not available", "not known"]);
  equal(controllerState(-1, 0x27).sort, "fault", "what is not heard follows nothing");
});

test("bits that are no part of the state are named", () => {
  deepEqual(statusBits(0x1637), ["voltage", "remote", "target reached", "bit 12"]);
  deepEqual(statusBits(0x0000), []);
});

test("errors are named by their code, else by their group", () => {
  deepEqual([0, 0x8611, 0x2340, 0x8133, 0x1234, 0x7305, 0xfedc].map(driveError), [
    "none",
    "following error",
    "current, on the output side",
    "communication",
    "generic error",
    "additional modules",
    "additional functions",
  ]);
});

test("a node's state is a word, also one that there is not", () => {
  deepEqual([0, 4, 5, 127, -1, 9].map(nmtState), ["Initialising", "Stopped", "Operational", "Pre-operational", "not received", "unknown (9)"]);
});
