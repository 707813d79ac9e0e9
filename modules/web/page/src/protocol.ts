// What the page and the robot's web server say to each other: the contract of both (server: modules/web/src/center).
//
// Two sockets, so that pictures never delay commands:
//
//   /ws/view      server -> page   parts of the view, each as often as it is worth; a slow page gets the newest only
//   /ws/command   both ways        commands, answers, round-trip time, who holds the motion authority
//
// Text frames, one JSON object each. Fields of messages are those of docs/design.md 5; SI units, radians, counter-clockwise;
// NaN is null. What is longer than 4 KiB, or more than 100 a second, closes the command socket.

// ---------------------------------------------------------------------------------------------------- HTTP

/** Who somebody is. Nobody: no part of the view; viewer: sees; operator: drives; engineer: everything. */
export type Role = "nobody" | "viewer" | "operator" | "engineer";

/** GET /api/me. For everybody. */
export interface Me {
  robot: string;
  version: string;
  role: Role;
  /** The name that was given when pairing; empty for who is not paired. */
  name: string;
}

/** POST /api/pair: with the code from the robot's console. Answers Me and sets the session's cookie (HttpOnly,
 *  SameSite=Strict); 403 Refused for a wrong code, 429 Refused after too many. POST /api/unpair ends it. */
export interface Pair {
  /** Eight digits; blanks are ignored. */
  code: string;
  /** How others see who it is: 1 to 40 characters. */
  name: string;
}

/** Body of every answer that is no success. */
export interface Refused {
  why: string;
}

/** GET /api/devices (engineer): who is paired. POST /api/devices/forget {id} ends a session. */
export interface Device {
  id: number;
  name: string;
  role: Role;
  /** s since it was seen last. */
  idle: number;
  connected: boolean;
  /** The asking one itself. */
  you: boolean;
}

/** GET /api/logs (viewer): runs on the robot's disk, the newest first. Files: GET /api/logs/RUN/FILE. */
export interface LogRun {
  run: string;
  bytes: number;
  /** It is being written. */
  recording: boolean;
  files: { name: string; bytes: number }[];
}

// ---------------------------------------------------------------------------------------------------- messages

export interface Motion {
  timestamp: number;
  speed: number | null;
  steering: number | null;
  speed_target: number | null;
  steering_target: number | null;
  enabled: boolean;
  homed: boolean;
  quick_stop: boolean;
  source: string;
  reason: string;
}
export interface MotionCommand {
  timestamp: number;
  speed: number | null;
  steering: number | null;
  priority: number;
  source: string;
}
export interface StopLine {
  timestamp: number;
  engaged: boolean;
  source: string;
}
export interface Odometry {
  timestamp: number;
  translation: number | null;
  rotation: number | null;
  path: number | null;
  heading: number | null;
  ticks_left: number;
  ticks_right: number;
}
export interface Range {
  id: number;
  x: number;
  y: number;
  theta: number;
  distance: number | null;
  valid: boolean;
}
export interface Sonars {
  timestamp: number;
  srfs: Range[];
}
export interface Infrareds {
  timestamp: number;
  irs: Range[];
}
/** The last measurement of one range finder. */
export interface Reading {
  /** When it fired; of an unknown one when it measured last, 0: never. */
  timestamp: number;
  id: number;
  /** 0 sonar, 1 infrared, 2 other */
  kind: number;
  /** 0 unknown, 1 silent: nothing within range, 2 measured */
  status: number;
  distance: number | null;
  x: number;
  y: number;
  theta: number;
  /** Full opening angle, rad. */
  beam: number | null;
}
export interface Ranges {
  timestamp: number;
  readings: Reading[];
}
export interface Beacons {
  timestamp: number;
  beacons: { timestamp: number; id: number; bearing: number | null; strength: number | null }[];
}
export interface Axes {
  timestamp: number;
  axes: {
    name: string;
    nmt_state: number;
    statusword: number;
    error_code: number;
    position: number | null;
    velocity: number | null;
    current: number | null;
  }[];
}
export interface Power {
  timestamp: number;
  voltage: number | null;
  /** 0..1 */
  charge: number | null;
  /** s; null: not known. */
  remaining: number | null;
  channels: { name: string; on: boolean; current: number | null }[];
}
export interface Temperatures {
  timestamp: number;
  temperatures: { name: string; value: number | null; over: boolean }[];
  fans: { name: string; duty: number | null; rpm: number | null; failed: boolean }[];
}
export interface BusState {
  timestamp: number;
  bus: string;
  /** 0..1 */
  load: number | null;
  frames: number;
  errors: number;
  /** ACTIVE 0, WARNING 1, PASSIVE 2, OFF 3, CLOSED 4 */
  state: number;
  nodes: {
    name: string;
    address: number;
    /** OK 0, DEGRADED 1, LOST 2 */
    state: number;
    requests: number;
    retries: number;
    timeouts: number;
    crc_errors: number;
    /** s */
    round_trip_min: number | null;
    round_trip_mean: number | null;
    round_trip_max: number | null;
  }[];
}
export interface Gamepad {
  timestamp: number;
  name: string;
  connected: boolean;
  dead_man: boolean;
  speed: number | null;
  steering: number | null;
}
export interface Estimate {
  timestamp: number;
  x: number | null;
  y: number | null;
  theta: number | null;
  speed: number | null;
  rotation: number | null;
  covariance: (number | null)[][];
  /** LOST 0, SEARCHING 1, COARSE 2, FINE 3 */
  quality: number;
}
export interface Goal {
  timestamp: number;
  id: number;
  waypoint: number;
  /** IDLE 0, DRIVING 1, REACHED 2, BLOCKED 3, FAILED 4, CANCELLED 5 */
  status: number;
  remaining: number | null;
  message: string;
}
export interface Plan {
  timestamp: number;
  x: (number | null)[];
  y: (number | null)[];
}
export interface Obstacles {
  timestamp: number;
  size: number;
  x: (number | null)[];
  y: (number | null)[];
}
export interface Truth {
  timestamp: number;
  x: number | null;
  y: number | null;
  theta: number | null;
  speed: number | null;
  steering: number | null;
  clearance: number | null;
  collisions: number;
}
export interface Recorder {
  timestamp: number;
  recording: boolean;
  run: string;
  bytes: number;
  dropped: number;
  free: number;
}
export interface Clock {
  timestamp: number;
  rate: number | null;
}

// ---------------------------------------------------------------------------------------------------- the view

/** A value and how old it was when the part was sent; the page lets it grow older by itself. */
export interface Shown<T> {
  /** s since it was heard; null: never. */
  age: number | null;
  /** It should come this often, s; null: on change only, so it never grows stale. Older than twice this: stale, shown grey. */
  period: number | null;
  freshness: "never" | "fresh" | "stale";
  value: T | null;
}

export type StatusWord = "silent" | "paused" | "fault" | "stopped" | "waiting" | "driving" | "ready";

/** A cause for which a module does not act: docs/holds.md. The motion's first, then the goal's, each the weightiest first. */
export interface HoldRow {
  module: string;
  /** 0: only the words are known, of a recording from before the numbers. */
  code: number;
  /** The number's name; empty: not known to the robot's web server. */
  name: string;
  /** Which drive, bus, module, source or waypoint; and as people call it. */
  subject: string;
  who: string;
  words: string;
  /** What to do about it; may be empty. */
  remedy: string;
  /** Stays until a person acts. */
  latched: boolean;
  /** Microseconds since the UNIX epoch; null: not known. */
  since: number | null;
}

/** Two standard deviations around the estimate: half axes in m, angles in rad. */
export interface Ellipse {
  long: number;
  short: number;
  angle: number;
  heading: number;
}

export interface ModuleRow {
  module: string;
  state: string;
  /** Empty: no watchdog guards it. */
  wanted: string;
  /** running, ending, down, stranger */
  phase: string;
  /** 0: none. */
  pid: number;
  /** s */
  uptime: number;
  restarts: number;
  /** In words; empty when it never ended. */
  last_exit: string;
  /** Cores. */
  cpu: number;
  /** Bytes. */
  rss: number;
  critical: boolean;
  well: boolean;
  /** s since it announced itself; null: never. */
  age: number | null;
  /** Number of its active faults; null: not known. */
  faults: number | null;
}

/** A fault of a module and subject. */
export interface ErrorGroup {
  module: string;
  /** docs/faults.md */
  number: number;
  /** Which of several: a board, a drive; empty where there is one, or nobody knows. */
  subject: string;
  count: number;
  /** Microseconds since the UNIX epoch. */
  first: number;
  last: number;
  /** NOTICE 0, WARNING 1, ERROR 2 */
  severity: number;
  standing: boolean;
  /** False while it is not known which faults of its module are active: `standing` is as it was then. */
  known: boolean;
  message: string;
}

/** A line that a module said. */
export interface Text {
  /** Microseconds since the UNIX epoch. */
  timestamp: number;
  module: string;
  /** DEBUG 0, INFO 1, WARNING 2, ERROR 3 */
  level: number;
  text: string;
}

export interface ChannelRow {
  channel: string;
  type: string;
  count: number;
  /** Messages, bytes a second. */
  rate: number;
  bandwidth: number;
  bytes: number;
  /** s */
  age: number;
}

/** Who holds the motion authority. */
export interface Holder {
  id: number;
  name: string;
  role: Role;
  /** A hand is on the drive pad. */
  driving: boolean;
  /** s */
  since: number;
}

/** Once after connecting, and whenever it changes: what stays as it is. */
export interface ScenePart {
  part: "scene";
  robot: string;
  version: string;
  simulated: boolean;
  /** Set while a recorded run is played (?demo=): nothing can be commanded then. */
  demo: { run: string; seconds: number } | null;
  /** Corners, robot frame, m. */
  outline: [number, number][];
  wheelbase: number;
  /** What a manual source gets at most: m/s, rad. */
  limits: { speed: number; steering: number };
  /** Beam width, rad; nearest and farthest that is measured, m. */
  sonar: { field_of_view: number; min: number; max: number };
  infrared: { field_of_view: number; min: number; max: number };
  /** Map frame, m. */
  beacons: { id: number; x: number; y: number }[];
  /** x1, y1, x2, y2 */
  walls: [number, number, number, number][];
  /** x, y, radius */
  columns: [number, number, number][];
  routes: { name: string; points: [number, number][] }[];
  /** Names for the power channels, drives' CANopen nodes, and what can be broken in the simulation. */
  power_channels: string[];
  drives: { name: string; node: number }[];
  faults: { target: string; faults: string[] }[];
}

/** 10 Hz, always: when none has come for 1 s, the connection is lost. */
export interface DrivePart {
  part: "drive";
  status: { word: StatusWord; reason: string };
  motion: Shown<Motion>;
  /** All for which it does not act; empty: it acts. */
  holds: HoldRow[];
  /** Who commands the motion. */
  commands: MotionCommand[];
  stop: Shown<StopLine>;
  odometry: Shown<Odometry>;
  estimate: Shown<Estimate>;
  ellipse: Ellipse | null;
  goal: Shown<Goal>;
  truth: Shown<Truth>;
  gamepad: Shown<Gamepad>;
  /** The motion authority among those on the web. */
  holder: Holder | null;
}

/** 5 Hz. */
export interface SensorsPart {
  part: "sensors";
  sonars: Shown<Sonars>;
  infrareds: Shown<Infrareds>;
  /** All of them, each with its own instant; `sonars` and `infrareds` are the view of 2011. */
  ranges: Shown<Ranges>;
  beacons: Shown<Beacons>;
}

/** On change, 2 Hz at most; and each 5 s. */
export interface MapPart {
  part: "map";
  plan: Shown<Plan>;
  obstacles: Shown<Obstacles>;
}

/** 1 Hz. */
export interface SystemPart {
  part: "system";
  modules: ModuleRow[];
  axes: Shown<Axes>;
  power: Shown<Power>;
  temperatures: Shown<Temperatures>;
  busses: Shown<BusState>[];
  log: Shown<Recorder>;
  clock: Shown<Clock>;
  errors: ErrorGroup[];
  /** The latest first, 100 at most. */
  texts: Text[];
  channels: ChannelRow[];
  viewers: number;
}

/** The newest message of a channel that the page watches, 20 Hz at most. `error`: it is none of the robot's types. */
export interface MessagePart {
  part: "message";
  channel: string;
  type: string;
  /** s on a scale that only grows. */
  at: number;
  value: Record<string, unknown> | null;
  error?: string;
}

export type Part = ScenePart | DrivePart | SensorsPart | MapPart | SystemPart | MessagePart;

/** Page -> /ws/view: the channels whose messages it wants, eight at most; replaces those before. */
export interface Watch {
  watch: string[];
}

// ---------------------------------------------------------------------------------------------------- commands

/** Page -> /ws/command. `id`: a number of the page's choice, by which it is answered. */
export type Command =
  /** Each 250 ms; answered at once. `t`: the page's clock, ms, that only grows. */
  | { type: "ping"; t: number }
  /** Takes the motion authority. `from`: who holds it, as the page was shown; null: nobody. When somebody else holds it
   *  meanwhile it is refused, so that nobody is taken over from by mistake. */
  | { type: "take"; id: number; from: number | null }
  | { type: "release"; id: number }
  /** 20 Hz while a hand is on the pad. `hold`: one more than at the last press; `seq`: one more than the last, from any
   *  hold; `t`: the page's clock when it was said. Late, repeated and out of order ones are not passed on. A hold that has
   *  ended is over for good: the robot moves again only for a new press. */
  | { type: "drive"; hold: number; seq: number; t: number; speed: number; steering: number }
  /** The hand is off: zero at once, then silence. */
  | { type: "zero"; hold: number; seq: number }
  /** Every operator, holder or not: zero, and driver_canbus into PAUSE: the quick stop is held until `resume`. */
  | { type: "stop"; id: number }
  /** driver_canbus, and planner, are let go on. Needs authority. */
  | { type: "resume"; id: number }
  /** These need authority. */
  | { type: "goal"; id: number; waypoints: { x: number; y: number; theta?: number; tolerance?: number }[]; loop: boolean }
  | { type: "route"; id: number; name: string }
  | { type: "pose"; id: number; x: number; y: number; theta: number }
  | { type: "home"; id: number; axis: string }
  /** Operators. */
  | { type: "cancel"; id: number }
  | { type: "log"; id: number; action: "start" | "stop" | "mark"; text: string }
  /** Engineers. `data`: hexadecimal, least significant byte first; without it the object is read. */
  | { type: "state"; id: number; module: string; state: "RUN" | "PAUSE" | "STOP" | "TERMINATE" }
  | { type: "power"; id: number; channel: string; action: "on" | "off" | "reboot" }
  | { type: "sdo"; id: number; node: number; index: number; subindex: number; data?: string }
  | { type: "fault"; id: number; target: string; fault: string; value: number; duration: number };

/** /ws/command -> page. */
export type Answer =
  | { type: "welcome"; you: number; name: string; role: Role; limits: { speed: number; steering: number } }
  | { type: "pong"; t: number }
  /** After the welcome and on each change. `why`: what happened, in words for the one who reads it; empty at the start. */
  | { type: "authority"; holder: Holder | null; yours: boolean; why: string }
  /** The server has ended a hold: zero was sent. */
  | { type: "ended"; hold: number; why: string }
  /** It was said on the bus; whether it works is seen in the view. */
  | { type: "done"; id: number }
  | { type: "refused"; id: number | null; why: string }
  /** Of `sdo`. `abort`: of CiA 301, 0 where there is data. */
  | { type: "sdo"; id: number; data: string; abort: number; why: string };
