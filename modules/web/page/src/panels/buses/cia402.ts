// What drives say of themselves, in words: CiA 301 (NMT), CiA 402-2 6.1 (statusword), error codes of CiA 402-2 and of the
// maxon EPOS (docs/facts/canopen.md 2.5).

/** State of a node; −1: never heard. */
export function nmtState(state: number): string {
  switch (state) {
    case 0x00:
      return "Initialising";
    case 0x04:
      return "Stopped";
    case 0x05:
      return "Operational";
    case 0x7f:
      return "Pre-operational";
    case -1:
      return "not received";
    default:
      return `unknown (${state})`;
  }
}

/** How a power state is to be taken: it can move, it rests without power as it does while nobody drives, it is held, or something is wrong. */
export type Sort = "moves" | "rests" | "stands" | "fault";

export interface PowerState {
  name: string;
  sort: Sort;
}

const STATES: readonly (readonly [mask: number, bits: number, name: string, sort: Sort])[] = [
  [0x4f, 0x00, "Not ready to switch on", "rests"],
  [0x4f, 0x40, "Switch on disabled", "rests"],
  [0x6f, 0x21, "Ready to switch on", "rests"],
  [0x6f, 0x23, "Switched on", "rests"],
  [0x6f, 0x27, "Operation enabled", "moves"],
  [0x6f, 0x07, "Quick stop active", "stands"],
  [0x4f, 0x0f, "Fault reaction active", "fault"],
  [0x4f, 0x08, "Fault", "fault"],
];

/** The state that a statusword names; patterns that the standard does not have are said to be that. */
export function powerState(statusword: number): PowerState {
  const found = STATES.find(([mask, bits]) => (statusword & mask) === bits);
  return found ? { name: found[2], sort: found[3] } : { name: "no state of CiA 402", sort: "fault" };
}

/** What a motor controller without CANopen does: driver_canbus translates it into those of these states that it has. */
const PLAIN: readonly (readonly [statusword: number, name: string, sort: Sort])[] = [
  [0x27, "follows commands", "moves"],
  [0x07, "quick stop", "stands"],
  [0x40, "off or starting", "rests"],
  [0x08, "fault", "fault"],
];

/** State of a motor controller without CANopen, in plain words: it knows neither NMT nor statusword. */
export function controllerState(nmt: number, statusword: number): PowerState {
  const found = nmt === -1 ? undefined : PLAIN.find(([word]) => word === statusword);
  return found ? { name: found[1], sort: found[2] } : { name: nmt === -1 ? "not available" : "not known", sort: "fault" };
}

const BITS: readonly (readonly [bit: number, name: string])[] = [
  [4, "voltage"],
  [7, "warning"],
  [9, "remote"],
  [10, "target reached"],
  [11, "internal limit"],
  [12, "bit 12"],
  [13, "bit 13"],
];

/** The set bits of a statusword that are no part of the state. */
export function statusBits(statusword: number): string[] {
  return BITS.filter(([bit]) => statusword & (1 << bit)).map(([, name]) => name);
}

const ERRORS: ReadonlyMap<number, string> = new Map([
  [0x1000, "generic error"],
  [0x2310, "overcurrent"],
  [0x3210, "overvoltage"],
  [0x3220, "undervoltage"],
  [0x4210, "overtemperature"],
  [0x5113, "5 V supply too low"],
  [0x6100, "internal software error"],
  [0x6320, "parameter error"],
  [0x7320, "position sensor error"],
  [0x8110, "CAN overrun"],
  [0x8111, "CAN overrun"],
  [0x8120, "CAN error passive"],
  [0x8130, "heartbeat or life guard missing"],
  [0x8140, "recovered from bus-off"],
  [0x8150, "its identifier is sent by another node"],
  [0x81fd, "CAN bus-off"],
  [0x81fe, "CAN receive queue overrun"],
  [0x81ff, "CAN transmit queue overrun"],
  [0x8210, "PDO too short"],
  [0x8611, "following error"],
  [0xff01, "Hall sensor error"],
  [0xff02, "encoder index error"],
  [0xff03, "encoder resolution error"],
  [0xff04, "Hall sensor not found"],
  [0xff06, "negative limit switch"],
  [0xff07, "positive limit switch"],
  [0xff08, "Hall angle not found"],
  [0xff09, "software position limit"],
  [0xff0a, "position sensor breach"],
  [0xff0b, "overload"],
]);

/** Groups of CiA 301 Table 21, for codes that have no name of their own. */
const GROUPS: ReadonlyMap<number, string> = new Map([
  [0x10, "generic error"],
  [0x20, "current"],
  [0x21, "current, on the input side"],
  [0x22, "current inside"],
  [0x23, "current, on the output side"],
  [0x30, "voltage"],
  [0x31, "mains voltage"],
  [0x32, "voltage inside"],
  [0x33, "output voltage"],
  [0x40, "temperature"],
  [0x41, "ambient temperature"],
  [0x42, "temperature of the device"],
  [0x50, "hardware"],
  [0x60, "software"],
  [0x61, "software"],
  [0x62, "user software"],
  [0x63, "data set"],
  [0x70, "additional modules"],
  [0x80, "monitoring"],
  [0x81, "communication"],
  [0x82, "protocol"],
  [0x90, "external error"],
  [0xf0, "additional functions"],
  [0xff, "specific to the device"],
]);

/** An emergency's error code in words; 0: none. */
export function driveError(code: number): string {
  if (code === 0) return "none";
  return ERRORS.get(code) ?? GROUPS.get(code >> 8) ?? GROUPS.get((code >> 8) & 0xf0) ?? "unknown";
}
