// Faults by number, as docs/faults.md has them; a test holds the two together.

export interface Fault {
  name: string;
  means: string;
}

const FAULTS: ReadonlyMap<number, Fault> = new Map([
  [0x0001, { name: "CommandForbidden", means: "A state command that the transition table forbids; nothing changed." }],
  [0x0002, { name: "MessageMalformed", means: "A message on a channel of ours could not be decoded; it was dropped." }],
  [0x0003, { name: "PortDown", means: "A port could not be opened, or was lost." }],
  [0x0004, { name: "PortOverrun", means: "A port lost data: a queue or a kernel buffer was full." }],
  [0x0101, { name: "BoardDegraded", means: "A board fails to answer now and then (error counter at 96)." }],
  [
    0x0102,
    {
      name: "BoardLost",
      means: "A board does not answer (error counter at 128): it is asked once a second only.",
    },
  ],
  [0x0103, { name: "BoardRefused", means: "A board does not know an instruction of its kind." }],
  [0x0104, { name: "BoardImplausible", means: "A board answered what its kind cannot answer." }],
  [0x0105, { name: "BusBabble", means: "Somebody talks on a bus without being asked." }],
  [0x0106, { name: "AddressClash", means: "Two boards answer at one address." }],
  [0x0201, { name: "DriveLost", means: "A drive does not answer, or its heartbeat is missing." }],
  [0x0202, { name: "DriveEmergency", means: "A drive sent an emergency message." }],
  [0x0203, { name: "DriveBootFailed", means: "A drive could not be brought up: a step of its boot-up failed." }],
  [0x0204, { name: "DriveMismatch", means: "A drive is not the one that the configuration names." }],
  [0x0205, { name: "DriveFault", means: "A drive is in its fault state." }],
  [0x0206, { name: "HomingFailed", means: "Homing an axis failed." }],
  [0x0207, { name: "MotionRefused", means: "A motion command was out of limits or not a number: the robot stops." }],
  [0x0208, { name: "MotionContested", means: "Two sources of the same priority command the motion; the first holds." }],
  [0x0209, { name: "CriticalModule", means: "A module that the motion depends on is not running: the robot stops." }],
  [0x020a, { name: "WatchdogSilent", means: "The watchdog is not heard: the robot stops." }],
  [0x020b, { name: "CanMalformed", means: "A CAN frame that CANopen does not allow came from a node." }],
  [0x020c, { name: "SecondMaster", means: "Another CANopen master with our node id is on the bus: the robot stops." }],
  [
    0x020d,
    {
      name: "CanPassive",
      means: "The CAN controller is error-passive: much of what it sends or hears is broken.",
    },
  ],
  [0x020e, { name: "CanUnacknowledged", means: "Nobody acknowledges what is sent on a CAN bus: the robot stops." }],
  [0x020f, { name: "CanErrors", means: "Frames with errors on a CAN bus." }],
  [0x0210, { name: "CanBabble", means: "A node, or somebody whom nobody can name, floods a CAN bus." }],
  [0x0211, { name: "NodeClash", means: "Two nodes of a CAN bus have the same id: the robot stops." }],
  [0x0301, { name: "ModuleDied", means: "A module's process ended unasked and is started again." }],
  [0x0302, { name: "ModuleHung", means: "A module does not announce its state: it is ended and started again." }],
  [0x0303, { name: "ModuleUnstartable", means: "A module's process could not be started." }],
  [0x0304, { name: "BeatsBad", means: "A module's page of beats cannot be read: it is judged by its announcements." }],
  [
    0x0305,
    {
      name: "NameClaimed",
      means: "Somebody announces the name of a module that does not run, or that announces itself as well.",
    },
  ],
  [0x0306, { name: "RestartStorm", means: "A module was started again and again: told once, not each time." }],
  [
    0x0307,
    {
      name: "ModuleDown",
      means: "A module has no process: which of its faults are active is not known (only on `CM_DATA_FAULTS`).",
    },
  ],
  [0x0401, { name: "FaultUnknown", means: "A simulated fault was asked for that the simulator does not know." }],
  [
    0x0501,
    {
      name: "PauseUnknown",
      means: "The power controller does not tell the state of the PAUSE line: the robot stops.",
    },
  ],
  [
    0x0502,
    {
      name: "PowerOff",
      means: "The supply is cut soon, or an operator ordered it: the modules are ended, the computer is halted.",
    },
  ],
  [0x0503, { name: "BatteryLow", means: "The battery's charge is below the reserve." }],
  [0x0504, { name: "ChannelStuck", means: "A power channel does not do what it was told." }],
  [
    0x0601,
    {
      name: "InputsLost",
      means: "What a module is told is not all written down for replay: the disk is slow, full or broken.",
    },
  ],
  [
    0x0602,
    {
      name: "LogLost",
      means: "Messages are not written to the log: the disk takes them too slowly, or not at all.",
    },
  ],
  [0x0603, { name: "LogRefused", means: "The disk takes no log: it is full, read-only or broken; it is tried again." }],
  [
    0x0604,
    {
      name: "LogCrowded",
      means: "More channels are heard than a log holds: messages of further ones are left out.",
    },
  ],
  [0x0701, { name: "ChipLost", means: "A chip on an I2C bus does not answer, or another one does." }],
  [0x0702, { name: "OverTemperature", means: "Something is hotter than its limit." }],
  [0x0703, { name: "FanFailed", means: "A fan does not turn although it is driven." }],
  [0x0704, { name: "ThermometerBad", means: "What a 1-Wire thermometer says is damaged, or no temperature." }],
  [
    0x0711,
    {
      name: "GamepadRefused",
      means: "A gamepad cannot drive the robot: it lacks an axis or a button, or an axis has no range.",
    },
  ],
  [
    0x0712,
    {
      name: "GamepadNotReleased",
      means: "The dead-man button is held and moves nothing: it was held before, or pressed with a stick off its middle.",
    },
  ],
  [0x0801, { name: "OdometrySilent", means: "No odometry is heard: the estimate goes by the drives, or by nothing." }],
  [
    0x0802,
    {
      name: "OdometryStuck",
      means: "Odometry says otherwise than the drives: a wheel or its encoder is stuck, or wheels slip.",
    },
  ],
  [0x0803, { name: "BeaconUnknown", means: "A beacon was sighted that is not on the map." }],
  [
    0x0804,
    {
      name: "PoseLost",
      means: "Where the robot is was known and is not: it was carried away, or saw no beacons for too long.",
    },
  ],
  [
    0x0805,
    {
      name: "MeasurementBad",
      means: "A measurement or a pose by hand was refused: a number that is none, or beyond what any robot does.",
    },
  ],
  [0x0811, { name: "GoalRefused", means: "A goal that no robot can be sent to was refused." }],
  [
    0x0812,
    {
      name: "EstimateBad",
      means: "The estimate that the planner drives by is no number, or its time runs backwards: the robot stands.",
    },
  ],
]);

/** From here on numbers are those of foreign modules, each module's own (docs/writing-a-module.md). */
const FOREIGN = 0x8000;

/** What a number stands for. */
export function fault(number: number): Fault {
  const known = FAULTS.get(number);
  if (known) return known;
  if (number === FOREIGN) return { name: "Uncaught", means: "A foreign module was ended by an error that nothing in it caught." };
  if (number > FOREIGN) return { name: "Foreign", means: "A number of the module's own: read it with the module's name." };
  return { name: "Unknown", means: "This page does not know the number: the robot's software is newer or older than it." };
}
