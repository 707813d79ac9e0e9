// What can be broken in the simulation, in words: modules/simulator/src/faults.rs has the table, and says which values each takes.
import { hex } from "../format";

/** What a fault's value says. */
export interface Quantity {
  name: string;
  unit: string;
  low: number;
  high: number;
  step: number;
  /** What is offered; where the simulator has a usual value that is it. */
  usual: number;
  /** It is written as hexadecimal. */
  hex?: true;
}

export interface Known {
  /** What happens. */
  means: string;
  /** None: the value is not looked at. */
  value?: Quantity;
  /** It is of the moment: a duration does nothing. */
  momentary?: true;
}

const probability = (usual: number): Quantity => ({ name: "Probability", unit: "", low: 0.0001, high: 1, step: 0.0001, usual });
const late = (usual: number): Quantity => ({ name: "Delay", unit: "s", low: 0.001, high: 1, step: 0.001, usual });
const number = (name: string, low: number, high: number, usual: number): Quantity => ({ name, unit: "", low, high, step: 1, usual });
const stick: Quantity = { name: "Stick", unit: "", low: -1, high: 1, step: 0.05, usual: 0.5 };
const warm: Quantity = { name: "Temperature", unit: "°C", low: 1, high: 200, step: 1, usual: 90 };

const FAULTS: Readonly<Record<string, Known>> = {
  silent: { means: "It neither hears nor answers." },
  slow: { means: "It answers late.", value: late(0.03) },
  garbled: { means: "Each word that it sends may be wrong.", value: probability(0.1) },
  bad_crc: { means: "Its answers have a wrong CRC." },
  bad_length: { means: "Its answers have a byte too many, and a right CRC." },
  babble: { means: "It talks all the time, unasked." },
  clash: { means: "A second one has its address, and answers too." },
  reset: { means: "As after a short loss of its supply: its settings are lost.", momentary: true },
  refuses: { means: "It refuses every instruction as unknown." },
  stuck: { means: "What it measures does not change." },
  wrap: { means: "Its counters stand just before they wrap.", momentary: true },
  blind: { means: "Its sonars receive no echo." },
  crosstalk: { means: "A sonar may receive another's pulse.", value: probability(0.1) },
  hidden: { means: "Somebody stands before a beacon; 0: before all.", value: number("Beacon", 0, 255, 0) },
  false: { means: "A sighting may be of something else.", value: probability(0.2) },
  glare: { means: "It rejects this many pulses a second: sun, lamps.", value: { name: "Rate", unit: "1/s", low: 1, high: 5000, step: 1, usual: 100 } },
  supply: { means: "Its supply has this voltage.", value: { name: "Voltage", unit: "V", low: 0.1, high: 60, step: 0.1, usual: 4 } },
  bumper: { means: "A bumper switch is pressed.", value: number("Switch", 1, 8, 1) },
  stop_button: { means: "The stop button is pressed." },
  battery: { means: "The battery has this voltage at rest.", value: { name: "Voltage", unit: "V", low: 8, high: 40, step: 0.1, usual: 24 } },
  power_off: {
    means: "The main switch is turned: the supply is cut after this time.",
    value: { name: "After", unit: "s", low: 1, high: 255, step: 1, usual: 30 },
    momentary: true,
  },
  cold: { means: "Its main switch is turned on: all channels are off, and start one after the other.", momentary: true },
  trip: { means: "A channel switches itself off, as at an over-current.", value: number("Channel", 1, 7, 5), momentary: true },
  overload: { means: "What a channel feeds draws 12 A more.", value: number("Channel", 0, 7, 5) },
  wrong: { means: "What it says is damaged." },
  biased: {
    means: "It measures this much more rotation than there is.",
    value: { name: "Rotation", unit: "rad/s", low: 0.01, high: 30, step: 0.01, usual: 0.2 },
  },
  hold: { means: "It blocks its bus: no node can send." },
  stall: { means: "A fan is blocked.", value: number("Fan", 1, 2, 1) },
  hot: { means: "It is this warm.", value: warm },
  fault: { means: "It sends an emergency of this error code and goes into its fault state.", value: { ...number("Error code", 1, 0xffff, 0x1000), hex: true }, momentary: true },
  reboot: { means: "As after a short loss of its supply.", momentary: true },
  unbraked: { means: "It does not brake, whatever it is told; without its feed it rolls out." },
  runaway: {
    means: "Once it turns, it is faster than it is told.",
    value: { name: "Faster by", unit: "m/s", low: 0.05, high: 2, step: 0.05, usual: 0.3 },
  },
  encoder: {
    means: "Its encoder counts this times the truth: 0 dead, -1 reversed.",
    value: { name: "Factor", unit: "", low: -2, high: 2, step: 0.01, usual: 0 },
  },
  swapped: { means: "It has the encoder of another wheel.", value: number("Wheel", 1, 255, 2) },
  opened: { means: "Its digital input is open.", value: number("Bit", 3, 31, 16) },
  layout: { means: "It is another version, with other PDOs; it starts anew." },
  noise: { means: "Each bit on it may be wrong.", value: { ...probability(0.0001), low: 0.000001, step: 0.000001 } },
  corrupt: { means: "Each frame whose number this divides is destroyed, and sent again.", value: number("Divisor", 1, 100_000, 10) },
  lose: { means: "The frame of this number from now on is lost.", value: number("Frame", 1, 100_000, 1), momentary: true },
  bus_off: { means: "The master's controller goes bus-off." },
  cut: { means: "The master is cut off the others." },
  loss: { means: "Each frame may be lost, though it was sent.", value: probability(0.05) },
  duplicate: { means: "Each frame may be received twice.", value: probability(0.05) },
  delay: { means: "What is sent is received late, in order.", value: late(0.01) },
  reorder: { means: "Messages come late, and others overtake them.", value: late(0.01) },
  kidnap: { means: "It is carried somewhere else; its wheels do not turn.", momentary: true },
  plug: { means: "It is plugged in." },
  unplug: { means: "It is unplugged.", momentary: true },
  hold_pad: { means: "Its dead-man button is held." },
  release: { means: "Its dead-man button is released.", momentary: true },
  speed: { means: "Its left stick is pushed: forward above 0.", value: stick },
  steering: { means: "Its right stick is pushed: to the left above 0.", value: stick },
};

/** The target of what is done to the robot as a whole. */
export const ROBOT = "robot";
const GAMEPAD = "gamepad";

/** What a fault of a target is; one that this page has not heard of takes any value. */
export function fault(target: string, name: string): Known {
  if (target === GAMEPAD && name === "hold") return FAULTS["hold_pad"] as Known;
  const known = Object.hasOwn(FAULTS, name) ? FAULTS[name] : undefined;
  return known ?? { means: "", value: { name: "Value", unit: "", low: -1e6, high: 1e6, step: 0.001, usual: 0 } };
}

/** What stands in the field of a value before somebody writes there. */
export function usual(quantity: Quantity | undefined): string {
  if (!quantity) return "0";
  return quantity.hex ? hex(quantity.usual) : String(quantity.usual);
}

/** Those of a target that one chooses from a list: none of the ways to end one, nor carrying it to a pose. */
export function listed(faults: readonly string[]): string[] {
  return faults.filter((name) => name !== "none" && !name.startsWith("put"));
}

/** How a fault of a target ends before its time. */
export function ending(target: string, name: string): { fault: string; value: number } {
  if (target !== GAMEPAD) return { fault: "none", value: 0 };
  if (name === "plug") return { fault: "unplug", value: 0 };
  if (name === "hold") return { fault: "release", value: 0 };
  return { fault: name, value: 0 };
}

/** The fault that carries the robot to a pose of the map. */
export function put(x: number, y: number, theta: number): string {
  return `put:${x.toFixed(3)},${y.toFixed(3)},${theta.toFixed(4)}`;
}
