// A robot that is none, for looking at the page without one: `npm run dev`, then ?fixture. Built into no release.
// ?fixture=viewer, paused, lost, slow, other, stopped … show what is rare; without a word an engineer watches a patrol.
import * as command from "./connection/command";
import * as view from "./connection/view";
import { MODES } from "./map/planner";
import { HOLD } from "./numbers";
import { events } from "./timeline/player";
import type { Answer, Bound, Command, DataGuard, DrivePart, Field, Holder, HoldRow, Part, Range, Reading, Role, RunEvent, Shown } from "./protocol";
import { authority, commandLink, me, receive, viewLink } from "./state";

const mode = new URLSearchParams(location.search).get("fixture") ?? "";
const started = performance.now();
const elapsed = (): number => (performance.now() - started) / 1000;
const micros = (): number => Date.now() * 1000;

const role: Role = mode === "viewer" ? "viewer" : mode === "nobody" ? "nobody" : "engineer";
const ROUTE: [number, number][] = [[3, 6], [12.5, 6], [14.5, 8], [18.5, 7.6], [18.5, 3], [16, 1.7], [12, 1.7], [9, 3], [8, 6], [8, 10], [3, 10]];
const BEACONS = [[0.1, 0.1], [10, 0.1], [19.9, 0.1], [19.9, 11.9], [8, 11.9], [0.1, 11.9]] as const;

const robot = {
  x: 4.2, y: 6.05, theta: 0.02, speed: 0, steering: 0, want: { speed: 0, steering: 0 }, path: 0, collisions: 0,
  held: mode === "stopped", paused: mode === "paused", goal: 3, recording: true, creep: false, bytes: 4.2e6, patrol: mode === "" || mode === "viewer", mode: 1, speedLimit: 0.5, margin: 0.15,
};
let holder: Holder | null = mode === "other" ? { id: 7, name: "Jana’s phone", role: "operator", driving: true, since: 42 } : null;
let hold = { number: 0, at: -1 };

function shown<T>(value: T, period: number | null, age = 0.03): Shown<T> {
  const freshness = period !== null && age > 2 * period ? "stale" : "fresh";
  return { age, period, freshness, value };
}
const wave = (period: number, size: number, middle = 0): number => middle + size * Math.sin((elapsed() * 2 * Math.PI) / period);

function reason(): string {
  if (robot.paused) return "the PAUSE line is engaged by bumper 1";
  if (robot.held) return "driver_canbus is in PAUSE";
  return robot.patrol || robot.want.speed !== 0 ? "" : "nobody commands the motion";
}

function holds(): HoldRow[] {
  const row = (code: number, words: string, more: Partial<HoldRow> = {}): HoldRow => ({
    module: "driver_canbus", code, name: "", subject: "driver_canbus", who: "driver_canbus", words, remedy: "", latched: false, since: micros() - 4e6, ...more,
  });
  const all: HoldRow[] = [];
  if (robot.paused) all.push(row(HOLD.PauseBumper, "PAUSE is engaged by bumper1", { subject: "bumper1", who: "bumper 1", remedy: "Clear what touches bumper 1." }));
  if (robot.held) all.push(row(HOLD.ModulePaused, "driver_canbus is in PAUSE", { latched: true }));
  if (all.length === 0 && reason()) all.push(row(HOLD.NobodyCommands, reason(), { subject: "", who: "" }));
  return all;
}

function move(dt: number): void {
  if (performance.now() - hold.at > 250) robot.want = { speed: 0, steering: 0 };
  let { speed, steering } = robot.want;
  if (robot.patrol && !holder) {
    const [x, y] = ROUTE[robot.goal % ROUTE.length] as [number, number];
    if (Math.hypot(x - robot.x, y - robot.y) < 0.7) robot.goal += 1;
    const turn = Math.atan2(y - robot.y, x - robot.x) - robot.theta;
    steering = Math.max(-0.6, Math.min(0.6, 1.2 * Math.atan2(Math.sin(turn), Math.cos(turn))));
    speed = 0.7 - 0.5 * Math.abs(steering);
  }
  if (robot.held || robot.paused) speed = 0;
  robot.speed += Math.max(-1.2 * dt, Math.min(0.6 * dt, speed - robot.speed));
  robot.steering += Math.max(-0.7 * dt, Math.min(0.7 * dt, steering - robot.steering));
  robot.theta += ((robot.speed * Math.tan(robot.steering)) / 0.6) * dt;
  robot.x += robot.speed * Math.cos(robot.theta) * dt;
  robot.y += robot.speed * Math.sin(robot.theta) * dt;
  robot.path += Math.abs(robot.speed) * dt;
}

/** A guard that senses somebody 0.6 m ahead with ?fixture=near. */
function guard(): DataGuard {
  const near = mode === "near";
  const field = (kind: number, length: number): Field => {
    const [front, half] = [0.9 + length, 0.45];
    return { kind, occupied: near, x: [-0.3, front, front, -0.3], y: [-half, -half, half, half] };
  };
  const speed = Math.max(Math.abs(robot.speed), 0.1);
  const fields = [field(0, 0.05 + 0.37 * speed + 2 * speed * speed), field(1, 0.64 + 2.4 * speed)];
  return { timestamp: micros(), forward: near ? 0.1 : 0.66, backward: 0.66, left: 0, right: 0, turn_left: 0, turn_right: 0, code: near ? HOLD.GuardStops : 0, subject: near ? "sonar 3" : "", fields };
}

function bound(): Bound {
  const near = mode === "near";
  const words = near ? "at most 0.10 m/s forward: sonar 3" : "at most 0.66 m/s forward";
  return { words: robot.creep ? `creeping; otherwise ${words}` : words, speed: near ? 0.1 : 0.66, limits: near, creeping: robot.creep };
}

function drivePart(): DrivePart {
  const why = reason();
  const patrols = robot.patrol && !holder;
  const moves = Math.abs(robot.speed) > 0.01;
  const driver = patrols ? "planner" : holder?.driving ? `${holder.name} (web)` : "";
  const word = robot.paused ? "paused" : robot.held ? "stopped" : moves ? "driving" : "ready";
  const said = robot.paused
    ? "the PAUSE line is engaged by bumper 1; release it, then resume"
    : robot.held ? why : moves ? `${robot.speed.toFixed(2)} m/s; commanded by ${driver}` : "the robot is at standstill without a command";
  const [gx, gy] = ROUTE[robot.goal % ROUTE.length] as [number, number];
  const quality = mode === "search" ? 1 : 3;
  return {
    part: "drive",
    status: { word, reason: said },
    concerns: mode === "ill" ? [{ weight: "error", words: "sd1_front does not answer" }, { weight: "warning", words: "position lost" }, { weight: "warning", words: "fan 2 does not turn" }] : mode === "search" ? [{ weight: "warning", words: "position lost" }] : [],
    motion: shown({
      timestamp: micros(), speed: robot.speed, steering: robot.steering, speed_target: robot.held ? 0 : robot.want.speed || robot.speed,
      steering_target: robot.steering, enabled: !robot.held && !robot.paused, homed: mode !== "unhomed", quick_stop: robot.held || robot.paused,
      source: patrols ? "planner" : holder?.driving ? `web:${holder.name}` : "", reason: why,
    }, 0.05),
    velocity: shown({
      timestamp: micros(), vx: robot.speed, vy: 0, omega: (robot.speed * Math.tan(robot.steering)) / 0.6, vx_target: robot.held ? 0 : robot.want.speed || robot.speed,
      vy_target: 0, omega_target: 0, residual: 0, enabled: !robot.held && !robot.paused, ready: mode !== "unhomed", quick_stop: robot.held || robot.paused, source: "",
    }, 0.05),
    driver,
    holds: holds(),
    commands: patrols ? [{ timestamp: micros(), speed: robot.speed, steering: robot.steering, priority: 0, source: "planner" }] : [],
    velocity_commands: [],
    guard: shown(guard(), 0.075),
    bound: bound(),
    stop: shown({ timestamp: micros(), engaged: robot.paused, source: robot.paused ? "bumper1" : "" }, 0.5),
    odometry: shown({ timestamp: micros(), translation: robot.speed, rotation: (robot.speed * Math.tan(robot.steering)) / 0.6, path: robot.path, heading: robot.theta, ticks_left: Math.round(robot.path * 6500), ticks_right: Math.round(robot.path * 6510) }, 0.05),
    estimate: shown({ timestamp: micros(), x: robot.x + wave(7, 0.04), y: robot.y + wave(5, 0.03), theta: robot.theta, speed: robot.speed, rotation: 0, covariance: [[0.0016, 0, 0], [0, 0.0009, 0], [0, 0, 0.0004]], quality }, 0.05),
    ellipse: { long: 0.22, short: 0.12, angle: robot.theta + 0.4, heading: 0.06 },
    goal: shown({ timestamp: micros(), id: 3, waypoint: robot.goal % ROUTE.length, status: patrols ? 1 : 0, remaining: patrols ? Math.hypot(gx - robot.x, gy - robot.y) : null, message: "" }, null),
    mode: shown({ timestamp: micros(), mode: robot.mode, state: robot.mode === 1 ? (patrols ? 1 : 0) : 2, text: robot.mode === 0 ? "mode manual: only people drive the robot" : robot.mode === 1 ? "" : "waits for people", has_home: false }, 1),
    truth: shown({ timestamp: micros(), x: robot.x, y: robot.y, theta: robot.theta, speed: robot.speed, steering: robot.steering, clearance: 1.1, collisions: 0 }, 0.05),
    gamepad: shown({ timestamp: micros(), name: "Logitech F710", connected: true, dead_man: false, speed: 0, steering: 0 }, 0.2),
    holder,
    play: mode === "demo" ? { at: 300 + elapsed(), rate: 1 } : null,
  };
}

const SONARS: [number, number, number][] = [
  [0.73, 0.28, 1.0472], [0.75, 0.15, 0.4363], [0.75, 0, 0], [0.75, -0.15, -0.4363], [0.73, -0.28, -1.0472], [0.6, 0.3, 1.5708],
  [0.3, 0.3, 1.5708], [0.6, -0.3, -1.5708], [0.3, -0.3, -1.5708], [0, -0.3, -1.5708], [-0.13, -0.28, -2.0944], [-0.15, -0.15, -2.7053],
  [-0.15, 0, 3.1415], [-0.15, 0.15, 2.7053], [-0.13, 0.28, 2.0944], [0, 0.3, 1.5708],
];
const IRS: [number, number, number][] = [[0.75, 0.3, 0.7854], [0.75, -0.3, -0.7854], [-0.15, -0.3, -2.3562], [-0.15, 0.3, 2.3562]];
function range([x, y, theta]: [number, number, number], id: number, most: number): Range {
  const valid = id % 5 !== 3;
  return { id, x, y, theta, distance: valid ? Math.abs(wave(6 + id, most * 0.3, most * 0.5)) : null, valid };
}

/** A sonar of each kind: measured, silent, not known. */
function reading(range: Range, kind: number): Reading {
  const { id, x, y, theta, distance } = range;
  const status = distance !== null ? 2 : id % 10 === 3 ? 0 : 1;
  return { timestamp: micros() - 175_000, id, kind, status, distance, x, y, theta, beam: kind === 0 ? 0.96 : 0 };
}

function system(): Part {
  const names: [string, string, boolean][] = [
    ["driver_canbus", "RUN", true], ["driver_rs485a", "RUN", true], ["driver_rs485b", "RUN", false], ["driver_power", "RUN", true], ["driver_aux", "ERROR", false],
    ["driver_joydev", "RUN", false], ["estimator", "RUN", true], ["planner", "RUN", true], ["logger", "RUN", false], ["web", "RUN", false],
  ];
  const at = micros();
  return {
    part: "system",
    modules: names.map(([module, state, critical], i) => ({
      module, state: robot.held && module === "driver_canbus" ? "PAUSE" : state, wanted: robot.held && module === "driver_canbus" ? "PAUSE" : "RUN", phase: "running", pid: 4711 + i, uptime: 3 * 3600 + elapsed() + i,
      restarts: i === 4 ? 2 : 0, last_exit: i === 4 ? "killed by signal 11 (SIGSEGV)" : "", cpu: 0.004 + 0.003 * i, rss: (4 + i) * 1e6, critical, well: state === "RUN", age: 0.4,
      faults: i === 4 ? 1 : i === 9 ? null : 0, print_from: i === 5 ? "WARNING" : i === 9 ? "" : "INFO", send_from: i === 9 ? "" : "INFO", levels_changed: i === 5,
    })),
    axes: shown({ timestamp: at, axes: [
      { name: "propulsion", nmt_state: 5, statusword: 0x1637, error_code: 0, position: robot.path, velocity: robot.speed, current: wave(3, 0.4, 1.2) },
      { name: "steering", nmt_state: 5, statusword: 0x1637, error_code: 0, position: robot.steering, velocity: 0, current: 0.3 },
    ] }, 0.2),
    wheels: shown({ timestamp: at, wheels: [
      { name: "propulsion", steering: null, rotation: null, speed: robot.speed / 0.1, torque: null, current: wave(3, 0.4, 1.2), temperature: 41, load: wave(3, 0.08, 0.24) },
      { name: "steering", steering: robot.steering, rotation: null, speed: null, torque: null, current: 0.3, temperature: null, load: 0.06 },
    ] }, 0.2),
    power: shown({ timestamp: at, voltage: wave(60, 0.2, 25.4), charge: 0.71, remaining: 2 * 3600 + 600, channels: ["host", "computer1", "computer2", "motors", "monitor", "audio", "sensors", "switch"].map((name, i) => ({ name, on: i !== 5, current: i === 5 ? 0 : 0.3 + 0.2 * i })) }, 1),
    temperatures: shown({ timestamp: at, temperatures: [{ name: "cpu", value: 52.5, over: false }, { name: "motor", value: 71, over: true }, { name: "battery", value: 28.5, over: false }], fans: [{ name: "fan1", duty: 0.6, rpm: 2340, failed: false }, { name: "fan2", duty: 0.6, rpm: 0, failed: true }] }, 1),
    busses: [
      shown({ timestamp: at, bus: "main", load: 0.12, frames: Math.round(elapsed() * 240), errors: 0, state: 0, nodes: [] }, 1),
      shown({ timestamp: at, bus: "a", load: 0.22, frames: Math.round(elapsed() * 80), errors: 3, state: 0, nodes: [
        { name: "so1", address: 0x20, state: 0, requests: 21_431, retries: 2, timeouts: 1, crc_errors: 0, round_trip_min: 0.0009, round_trip_mean: 0.0012, round_trip_max: 0.0046 },
        { name: "sd1_front", address: 0x10, state: 0, requests: 4_288, retries: 0, timeouts: 0, crc_errors: 0, round_trip_min: 0.002, round_trip_mean: 0.0023, round_trip_max: 0.004 },
        { name: "sd1_rear", address: 0x11, state: 1, requests: 4_288, retries: 31, timeouts: 12, crc_errors: 4, round_trip_min: 0.002, round_trip_mean: 0.0031, round_trip_max: 0.011 },
      ] }, 1),
      shown({ timestamp: at, bus: "b", load: 0.02, frames: Math.round(elapsed() * 2), errors: 0, state: 0, nodes: [{ name: "sbs1", address: 0x30, state: 0, requests: 1_071, retries: 0, timeouts: 0, crc_errors: 0, round_trip_min: 0.004, round_trip_mean: 0.005, round_trip_max: 0.006 }] }, 1, 4.2),
    ],
    parameters: shown({ timestamp: at, parameters: [
      { name: "speed_mps", value: robot.speedLimit, minimum: 0.1, maximum: 0.5, configured: 0.5 },
      { name: "margin_m", value: robot.margin, minimum: 0.15, maximum: 0.3, configured: 0.15 },
    ] }, 1),
    log: shown({ timestamp: at, recording: robot.recording, run: "2026_11_22_09_12_40", bytes: (robot.bytes += 12_000), dropped: 0, free: 21.4e9 }, 1),
    beacon_use: shown({ timestamp: at, beacons: BEACONS.map(([x, y], i) => ({ id: i + 1, x, y, active: i < 5, permitted: !excluded.has(i + 1), last: i < 4 ? at - i * 2e5 : 0, residual: i < 4 ? (i === 3 ? 0.21 : wave(7 + i, 0.01)) : null, deviation: i < 4 ? 0.012 : null, fits: i < 3, accepted: i < 4 ? 600 - 90 * i : 0, refused: i === 3 ? 41 : 0 })) }, 1),
    clock: shown({ timestamp: at, rate: 1 }, 1),
    run: shown({ timestamp: at, paused: false, speed: 1, world: "hall", command: 0, refusal: "", refused: 0, in_step: [], not_in_step: [] }, 1),
    errors: [
      { module: "driver_aux", number: 0x0703, subject: "fan2", cause: "fan2 does not turn though it is commanded to", count: 14, first: at - 900e6, last: at - 2e6, severity: 2, standing: true, known: true, message: "fan2 does not turn though it is commanded to" },
      { module: "driver_rs485a", number: 0x0101, subject: "sd1_rear", cause: "sd1_rear does not answer", count: 12, first: at - 3400e6, last: at - 64e6, severity: 1, standing: false, known: true, message: "sd1_rear answers again" },
      { module: "estimator", number: 0x0804, subject: "", cause: "", count: 1, first: at - 10_000e6, last: at - 10_000e6, severity: 0, standing: false, known: true, message: "found itself by 4 beacons" },
      { module: "driver_joydev", number: 0x0711, subject: "", cause: "the gamepad has no dead-man button", count: 1, first: at - 40e6, last: at - 40e6, severity: 1, standing: true, known: false, message: "the gamepad has no dead-man button" },
    ],
    reports: [
      { timestamp: at - 2e6, module: "driver_aux", number: 0x0703, subject: "fan2", severity: 2, message: "fan2 does not turn though it is commanded to", fatal: false, file: "modules/drivers/src/auxiliary/fans.rs", line: 214 },
      { timestamp: at - 2.5e6, module: "driver_power", number: 0x0501, subject: "", severity: 1, message: "the current of the fans is low", fatal: false, file: "modules/drivers/src/power.rs", line: 388 },
      { timestamp: at - 63e6, module: "driver_rs485a", number: 0x0101, subject: "sd1_rear", severity: 0, message: "sd1_rear answers again", fatal: false, file: "modules/drivers/src/line/health.rs", line: 97 },
      { timestamp: at - 64e6, module: "driver_rs485a", number: 0x0101, subject: "sd1_rear", severity: 1, message: "sd1_rear does not answer", fatal: false, file: "modules/drivers/src/line/health.rs", line: 83 },
    ],
    texts: [
      { timestamp: at - 3e6, module: "driver_canbus", level: 1, text: "the steering is homed: the robot may be driven" },
      { timestamp: at - 9e6, module: "battery_watch", level: 2, text: "the battery sags under load" },
      { timestamp: at - 12e6, module: "watchdog", level: 1, text: "all 10 modules RUN after 0.42 s" },
    ],
    channels: [["LL_DATA_MOTION", "lowlevel.data_motion_t", 20, 94], ["LL_DATA_ODO", "lowlevel.data_odo_t", 20, 64], ["ML_DATA_ESTIMATE", "middlelevel.data_estimate_t", 20, 137], ["LL_DATA_SRFS", "lowlevel.data_srfs_t", 4, 664], ["CM_DATA_STATE", "common.data_state_t", 11, 37], ["LL_DATA_POWER", "lowlevel.data_power_t", 1, 190]].map(([channel, type, rate, size], i) => ({
      channel: channel as string, type: type as string, count: Math.round(elapsed() * (rate as number)), rate: rate as number, bandwidth: (rate as number) * (size as number), bytes: size as number, age: 0.02 + i / 100,
    })),
    viewers: 3,
  };
}

function mapPart(): Part {
  const plan = [...ROUTE.slice(robot.goal % ROUTE.length), ...ROUTE.slice(0, robot.goal % ROUTE.length)].slice(0, 4);
  const cells = Array.from({ length: 60 }, (_, i) => [7.2 + 0.1 * (i % 12) + wave(30, 1), 7.1 + 0.1 * Math.floor(i / 12)] as const);
  return {
    part: "map",
    plan: shown({ timestamp: micros(), x: [robot.x, ...plan.map(([x]) => x)], y: [robot.y, ...plan.map(([, y]) => y)] }, null),
    obstacles: shown({ timestamp: micros(), size: 0.1, x: cells.map(([x]) => x), y: cells.map(([, y]) => y) }, null),
  };
}

const SCENE: Part = {
  part: "scene", robot: "advee", version: "0.1.0", simulated: true, demo: mode === "demo" ? { run: "2026_11_21_17_03_11", seconds: 1840 } : null,
  outline: [[0.75, 0.3], [0.75, -0.3], [-0.15, -0.3], [-0.15, 0.3]], wheelbase: 0.6, limits: { speed: 0.6, steering: 0.6109, sideways: 0, rotation: 0 }, blind: mode === "blind" ? 0.3 : null,
  sonar: { field_of_view: 0.96, min: 0.05, max: 4 }, infrared: { field_of_view: 0.1, min: 0.1, max: 0.8 },
  beacons: BEACONS.map(([x, y], i) => ({ id: i + 1, x, y })),
  world: "start = [3.0, 6.0, 0.0]\n",
  walls: [[0, 0, 20, 0], [20, 0, 20, 12], [20, 12, 0, 12], [0, 12, 0, 0], [4, 0, 4, 2.5], [8, 0, 8, 2.5], [11, 12, 11, 9.5], [11, 9.5, 14, 9.5], [14, 9.5, 14, 12], [15, 4.5, 17, 4.5], [17, 4.5, 17, 6.5], [17, 6.5, 15, 6.5], [15, 6.5, 15, 4.5]],
  columns: [[6, 4, 0.25], [10, 4, 0.25], [14, 3, 0.25], [6, 8, 0.25], [10, 8, 0.25], [18, 9, 0.25]],
  routes: [{ name: "patrol", points: [...ROUTE, ROUTE[0] as [number, number]] }, { name: "start", points: [[3, 6]] }, { name: "upper left", points: [[3, 10]] }], power_channels: ["host", "computer1", "computer2", "motors", "monitor", "audio", "sensors", "switch"],
  temperature_limits: [{ name: "cpu", celsius: 80 }, { name: "motor", celsius: 70 }],
  drives: [{ name: "propulsion", node: 1 }, { name: "steering", node: 2 }],
  faults: [{ target: "sd1_front", faults: ["silent", "garbled"] }, { target: "can", faults: ["drop", "off"] }, { target: "robot", faults: ["kidnap"] }, { target: "psc1", faults: ["pause", "silent"] }],
  publish: [{ channel: "LL_CMD_POWER", type: "lowlevel.cmd_power_t", message: '{"timestamp":0,"device":0,"action":0}' }],
};

function tell(answer: Answer): void {
  setTimeout(() => command.hear(answer), mode === "slow" ? 320 : mode === "bad" ? 640 : 18);
}
function authorityIs(why: string): void {
  tell({ type: "authority", holder, yours: holder?.id === 1, why });
}

/** Numbers of beacons that are left out. */
const excluded = new Set<number>();

/** What the page said, for who looks at it from outside. */
const heard: Command[] = [];
Object.assign(globalThis, { said: heard });

function said(each: Command): boolean {
  if (each.type !== "ping") heard.push(each);
  switch (each.type) {
    case "ping":
      tell({ type: "pong", t: each.t });
      return true;
    case "drive":
      if (holder?.id !== 1) return true;
      hold = { number: each.hold, at: performance.now() };
      robot.want = { speed: each.speed, steering: each.steering };
      robot.creep = mode === "near" && each.creep === true;
      if (mode === "near") robot.want.speed = Math.min(robot.want.speed, robot.creep ? 0.15 : 0.1);
      holder = { ...holder, driving: true };
      return true;
    case "zero":
      robot.creep = false;
      robot.want = { speed: 0, steering: 0 };
      if (holder) holder = { ...holder, driving: false };
      return true;
    case "take":
      holder = { id: 1, name: "You", role: "engineer", driving: false, since: 0 };
      robot.patrol = false;
      authorityIs("");
      break;
    case "release":
      holder = null;
      authorityIs("");
      break;
    case "stop":
      robot.held = true;
      break;
    case "resume":
      robot.held = false;
      break;
    case "log":
      if (each.action !== "mark") robot.recording = each.action === "start";
      break;
    case "pose":
      robot.x = each.x;
      robot.y = each.y;
      robot.theta = each.theta;
      break;
    case "beacon":
      if (each.permitted) excluded.delete(each.beacon);
      else excluded.add(each.beacon);
      break;
    case "sdo":
      tell({ type: "sdo", id: each.id, data: "92010200", abort: 0, why: "" });
      return true;
    case "goal":
    case "route":
      robot.patrol = true;
      if (robot.mode !== 0) robot.mode = 1;
      break;
    case "mode":
      robot.mode = MODES.findIndex(([name]) => name === each.mode);
      robot.patrol = false;
      break;
    case "parameter":
      if (each.name === "speed_mps") robot.speedLimit = each.value;
      if (each.name === "margin_m") robot.margin = each.value;
      break;
  }
  tell({ type: "done", id: each.id, timestamp: null });
  return true;
}

let watched: string[] = [];
function messages(): void {
  for (const channel of watched) {
    if (channel === "*") {
      const [at, odometry] = [elapsed(), "translation 0.412, rotation 0.031, path 112.204, heading 3.481"];
      receive({ part: "recent", at, recent: [
        { channel: "LL_CMD_MOTION", since: at - 2, until: at, count: 40, words: "speed 0.400, steering 0.100, priority 2, source web", length: 61 },
        { channel: "LL_EVENT_STOP", since: at - 31, until: at - 31, count: 1, words: "engaged true, source bumper2", length: 29 },
        { channel: "LL_DATA_ODO", since: at - 400, until: at, count: 8000, words: odometry, length: 66 },
      ] });
      continue;
    }
    const value = channel === "LL_DATA_ODO" ? drivePart().odometry.value : channel === "ML_DATA_ESTIMATE" ? drivePart().estimate.value : drivePart().motion.value;
    receive({ part: "message", channel, type: "lowlevel.data_motion_t", at: elapsed(), value: { ...value } });
  }
}

/** Stands in for the server. */
export function begin(): void {
  me.value = { robot: "advee", version: "0.1.0", role, name: role === "engineer" ? "Workshop" : "" };
  if (role === "nobody") return;
  view.hooks.watching = (channels) => (watched = channels);
  command.hooks.send = said;
  viewLink.value = { open: true, heard: null, why: "" };
  commandLink.value = { open: true, heard: null, why: "" };
  authority.value = { holder, yours: false };
  tell({ type: "welcome", you: 1, name: "You", role, limits: { speed: 0.6, steering: 0.61, sideways: 0, rotation: 0 } });
  if (mode === "taken") {
    setTimeout(() => command.hear({ type: "authority", holder: (holder = { id: 1, name: "You", role, driving: false, since: 0 }), yours: true, why: "" }), 100);
    setTimeout(() => command.hear({ type: "authority", holder: (holder = { id: 7, name: "Jana’s phone", role: "operator", driving: false, since: 0 }), yours: false, why: "Jana’s phone took control." }), 900);
  }
  if (mode === "mine") setTimeout(() => said({ type: "take", id: 0, from: null }), 50);
  receive(SCENE);
  if (mode === "demo") {
    events.value = { left_out: 0, events: [[60, "mark", "the door opens"], [312, "error", "driver_rs485a: sd1_rear does not answer"], [700, "stop", "PAUSE: bumper 2"], [900, "warning", "driver_aux: fan2 is slow"], [1500, "contact", "the robot touched something"]].map(([at, kind, words]) => ({ at, kind, words }) as RunEvent) };
  }
  let silent = false;
  if (mode === "lost") setTimeout(() => ((silent = true), (viewLink.value = { open: false, heard: null, why: "" })), 1500);
  const every = (ms: number, run: () => void) => (run(), setInterval(() => silent || run(), ms));
  every(20, () => move(0.02));
  every(100, () => receive(drivePart()));
  every(200, () => {
    const srfs = SONARS.map((each, id) => range(each, id, 3));
    const irs = IRS.map(([x, y, theta], id) => ({ id, x, y, theta, distance: 0.12 + 0.003 * Math.sin(elapsed()), valid: true }));
    receive({ part: "sensors",
      sonars: shown({ timestamp: micros(), srfs }, 0.25),
      infrareds: shown({ timestamp: micros(), irs }, 0.25),
      ranges: shown({ timestamp: micros(), readings: [...srfs.map((each) => reading(each, 0)), ...irs.map((each) => reading(each, 1))] }, 0.25),
      scans: [],
      scanner: shown({ timestamp: micros(), name: "sbs1", sweeps: Math.round(elapsed()), rejected: Math.round(elapsed() * 0.14), rejected_rate: 0.1, supply: 4.98 }, 10),
      imus: [shown({ timestamp: micros(), name: "base", status: 0, acceleration: [wave(3, 0.2), wave(4, 0.1), 9.81], rotation: [0, 0, wave(5, 0.3)], orientation: [0.01, -0.02, 0.38, 0.92], oriented: true, temperature: 31 }, 0.02)],
      beacons: shown({ timestamp: micros(), beacons: BEACONS.slice(0, 4).map(([x, y], i) => ({ timestamp: micros() - i * 1e5, id: i + 1, bearing: Math.atan2(y - robot.y, x - robot.x) - robot.theta, strength: 0.4 + 0.1 * i })) }, 1),
      persons: shown({ timestamp: micros(), persons: [1, 2].map((n) => ({ id: n, x: robot.x + 1.2 + n / 2, y: robot.y + wave(8, 0.8, n), vx: 0.1, vy: 0.4, sigma: 0.1, velocity_sigma: 0.2 })) }, 0.2),
      people: shown({ timestamp: micros(), x: [0, 1, 2, 3, 4].map((n) => wave(20 + 3 * n, 2, 3 + 3.5 * n)), y: [0, 1, 2, 3, 4].map((n) => wave(17 + 5 * n, 2, 9 - n)), radius: [0.25, 0.3, 0.22, 0.28, 0.25] }, 0.2),
    });
  });
  every(500, () => receive(mapPart()));
  every(1000, () => receive(system()));
  setInterval(messages, 50);
}
