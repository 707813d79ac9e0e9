//! Settings of the CAN bus and its drives; SI units.

use super::axis::Axis;
use super::cia402::{Cia402, Cia402Config};
use super::feed_output::{GpioConfig, OutputConfig};
use super::keys::{ControllerConfig, not_zero, refuse_canopen};
use super::line_keys::LineConfig;
use super::odrive::{OdriveConfig, is_ambiguous};
use super::protection;
use super::ranging::RangingBoard;
use super::requests::may_be_listed;
use super::table::{self, BUILT_IN, DriveTable};
use super::vesc::VescConfig;
use crate::io::Canopen;
use base::Duration;
use canopen::axis::modes::method::{Direction, Method, Switch};
use canopen::drives::derive::Refusal;
use canopen::eds::Eds;
use settings::robot::{Base, Geometry, Limits, Traction};
use settings::{Blank, Off, Rows, Rule, Section, Table, Value, ZeroOr, settings};
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

settings! {
    /// Keys of `[can.<name>]` for the driver.
    #[derive(Clone, Debug, PartialEq)]
    pub struct BusConfig {
        /// Bit rate; of a kernel's interface it must have been set before.
        bitrate: u32 = 500_000, 10_000..=1_000_000;
        /// CANopen node of the master.
        master: u8 = 127, 1..=127;
        /// Period of SYNC; 0: no SYNC.
        sync_s as sync: Option<Duration> = None, Off(ZeroOr(0.001..=10.0));
        /// Period of TIME (CiA 301, 7.2.6), the date and time of this computer for nodes that keep a clock; 0: no TIME.
        time_s as time: Option<Duration> = None, Off(ZeroOr(0.1..=3600.0));
        /// Who releases the first homing of the axes after the start of the robot: it moves the wheels. Every later one
        /// needs an operator.
        homing_release: HomingRelease = HomingRelease::Operator;
        /// Drives.
        nodes: Vec<Node> = [];
    }
    check BusConfig::check;
}

settings! {
    /// `[[can.<name>.nodes]]`: a drive.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Node {
        /// CANopen node; of an ODrive its node id, of a VESC its VESC id.
        id: u8 = required, 1..=127;
        /// Axis that it moves.
        axis: Axis = required;
        /// Indices of objects that `LL_CMD_SDO` may write while the robot stands, beside the error history: none that
        /// moves or supervises the drive or on which its stop depends, and none of the maker's.
        writable: Vec<u16> = Vec::new(), 0x6000..=0x9FFF;
        /// Electronic data sheet, beside `robot.toml`: `cia402` drives by it; it must agree with another driver,
        /// and names objects in `advee can`. Absent: the sheet that is built in.
        eds: Option<PathBuf> = None, Blank;
        /// Greatest speed of the motor that motor and gear can bear. Limits of the robot that demand more with this
        /// gear are refused. Written to 0x6080 of a drive that is driven by its sheet, where that can be written.
        /// Absent: neither checked nor written.
        motor_rpm_max: Option<f64> = optional, 1.0..=1e6;
        /// The sheet of a drive that is driven by it.
        sheet: Option<Arc<Eds>> = unset None;
        drive: Drive = flat;
    }
    check Node::check;
}

settings! {
    /// `[stop]`: how the robot comes to a stand. Where the drive cannot be relied on, the speed is capped so that it
    /// stands within `distance_m`.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Stop {
        /// What cuts the motors' feed if the robot does not brake as commanded.
        second_way: SecondWay = SecondWay::Power;
        /// The output that `second_way = "canopen"` switches.
        output: Option<OutputConfig> = optional;
        /// CAN bus of that output, where the drives are on several: `"can.second"`. Absent: the first one, `can.main`
        /// if there is one.
        output_bus: Option<String> = optional;
        /// The line that `second_way = "gpio"` switches.
        gpio: Option<GpioConfig> = optional;
        /// What becomes of a wheel that gains speed against its own brake, as one whose encoder counts backwards does,
        /// where nothing cuts the motors' feed.
        unbraked: UnbrakedStop = UnbrakedStop::Coast;
        /// What the PAUSE line does to the motors.
        pause: PauseStop = PauseStop::Coast;
        /// Deceleration without power, least that is to be expected.
        coasting_mps2: f64 = 0.15, 0.01..=20.0;
        /// Deceleration by a brake that acts without power.
        brake_mps2: f64 = 1.5, 0.01..=20.0;
        /// Delay after which the line cuts the feed, while the drive brakes: only with `pause = "delayed"`.
        delay_s as delay: Duration = 0.6, 0.05..=5.0;
        /// Greatest distance in which the robot must stand after the PAUSE line was engaged, and after a drive that
        /// rolls without commands gets none; caps the speed.
        distance_m: f64 = 0.6, 0.05..=100.0;
        /// Inputs that stop the robot as PAUSE does (docs/safety.md).
        inputs: Vec<StopInput> = [];
    }
    check Stop::check;
}

settings! {
    /// `[[stop.inputs]]`: an input that stops the robot while it is open or not known: a `signal`, or `axis` and `bit`.
    #[derive(Clone, Debug, PartialEq)]
    pub struct StopInput {
        /// Name of a signal of `[io]` that is an input, 1 while it is closed.
        signal: Option<String> = optional;
        /// Axis whose drive, of CANopen, reads the input (0x60FD).
        axis: Option<Axis> = optional;
        /// Bit of the drive's digital inputs, 1 while it is closed: by CiA 402 0 to 2 are limit and reference switches,
        /// 16 to 31 the maker's.
        bit: Option<u8> = optional, 0..=31;
    }
    check StopInput::check;
}

impl StopInput {
    fn check(&self, table: &Table<'_>) {
        match (&self.signal, self.axis, self.bit) {
            (Some(_), None, None) | (None, Some(_), Some(_)) => {}
            (Some(_), Some(_), _) => table.refuse("axis", "either a signal, or an axis and a bit"),
            (Some(_), None, Some(_)) => table.refuse("bit", "either a signal, or an axis and a bit"),
            (None, Some(_), None) => table.refuse_missing("bit", "the bit of the drive's digital inputs (0x60FD)"),
            (None, None, _) => table.refuse_missing("signal", "a signal of [io], or an axis and a bit"),
        }
    }

    /// Its name as a source of PAUSE: `io.estop`, `drive.left.3`.
    #[must_use]
    pub fn source(&self) -> String {
        match (&self.signal, self.axis) {
            (Some(signal), _) => format!("io.{signal}"),
            (None, Some(axis)) => format!("drive.{}.{}", axis.name(), self.bit.unwrap_or_default()),
            (None, None) => String::new(),
        }
    }
}

settings! {
    /// Second way to stop.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum SecondWay {
        /// The power controller switches its channel `motors` off; as `"none"` without a power controller.
        Power = "power",
        /// A digital output of a CANopen node, the table `output`.
        Canopen = "canopen",
        /// A GPIO line of the computer, the table `gpio`.
        Gpio = "gpio",
        /// None; reported at each start and by `advee doctor`.
        None = "none",
    }
}

settings! {
    /// Effect of the PAUSE line on the motors.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum PauseStop {
        /// Their feed is cut at once, and the robot rolls (IEC 60204-1, stop category 0).
        Coast = "coast",
        /// Their feed is cut at once, and a brake acts that needs no power: a spring-applied one, or the motor shorted
        /// over a resistor.
        Brake = "brake",
        /// The drive brakes by its quick stop, and the feed is cut after the delay (stop category 1).
        Delayed = "delayed",
    }
}

settings! {
    /// What becomes of a wheel that gains more than 0.1 m/s, by at least half the quick stop's deceleration, since it
    /// was ordered to stop at speed.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum UnbrakedStop {
        /// Its drive is switched off, and the wheel rolls: the drive itself accelerates it.
        Coast = "coast",
        /// Its drive goes on braking: for a robot on slopes that its brakes cannot hold.
        Brake = "brake",
    }
}

impl Stop {
    fn check(&self, table: &Table<'_>) {
        if self.second_way == SecondWay::Canopen && self.output.is_none() && !table.has("output") {
            table.refuse_missing("output", "the output that cuts the motors' feed");
        }
        if self.second_way == SecondWay::Gpio && self.gpio.is_none() && !table.has("gpio") {
            table.refuse_missing("gpio", "the line that cuts the motors' feed");
        }
    }

    /// Signals of `[io]` that stop the robot.
    pub fn signals(&self) -> impl Iterator<Item = &str> {
        self.inputs.iter().filter_map(|input| input.signal.as_deref())
    }

    /// The output that cuts the motors' feed, if it is the second way.
    #[must_use]
    pub fn feed_output(&self) -> Option<OutputConfig> {
        self.output.filter(|_| self.second_way == SecondWay::Canopen)
    }

    /// True if something cuts the motors' feed where the drives do not brake; `has_power`: the robot has a power
    /// controller.
    #[must_use]
    pub fn has_second_way(&self, has_power: bool) -> bool {
        match self.second_way {
            SecondWay::Power => has_power,
            SecondWay::Canopen => self.output.is_some(),
            SecondWay::Gpio => self.gpio.is_some(),
            SecondWay::None => false,
        }
    }

    /// The GPIO line that cuts the motors' feed, if it is the second way.
    #[must_use]
    pub fn feed_line(&self) -> Option<&GpioConfig> {
        self.gpio.as_ref().filter(|_| self.second_way == SecondWay::Gpio)
    }

    /// Greatest speed, m/s, from which the robot stands within `distance_m` after the PAUSE line was engaged;
    /// `quick_stop_mps2`: deceleration of the drive's quick stop; `rolls`: without commands, too, nothing brakes.
    #[must_use]
    pub fn speed_max_mps(&self, quick_stop_mps2: f64, rolls: bool) -> f64 {
        let within = |deceleration: f64| libm::sqrt(2.0 * deceleration * self.distance_m);
        let without_commands = if rolls { within(self.coasting_mps2) } else { f64::INFINITY };
        let paused = match self.pause {
            PauseStop::Coast => within(self.coasting_mps2),
            PauseStop::Brake => within(self.brake_mps2),
            // Later it would coast.
            PauseStop::Delayed => within(quick_stop_mps2).min(quick_stop_mps2 * self.delay.as_secs_f64()),
        };
        paused.min(without_commands)
    }
}

settings! {
    /// Release of the first homing.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum HomingRelease {
        /// An operator's act: motion by hand after zero, a goal, RUN by hand, `advee home`.
        Operator = "operator",
        /// The operator's start of the robot.
        Start = "start",
    }
}

/// Drives with a driver: CANopen nodes, and motor controllers without CANopen.
#[derive(Clone, Debug, PartialEq)]
pub enum Drive {
    /// A wheel, by a table of objects: `epos`, or a file of the user's.
    Wheel(WheelKeys),
    /// The steering, by a table of objects: `icla`, or a file of the user's.
    Steering(SteeringKeys),
    /// Any drive of CiA 402, by its data sheet (`docs/adding-a-drive.md`).
    Cia402(Cia402Config),
    /// ODrive by CAN Simple, for a wheel (`docs/motor-controllers.md`).
    Odrive(OdriveConfig),
    /// VESC on CAN, for a wheel (`docs/motor-controllers.md`).
    Vesc(VescConfig),
}

settings! {
    /// A wheel's drive by a table of objects.
    #[derive(Clone, Debug, PartialEq)]
    pub struct WheelKeys {
        /// Motor turns per wheel turn, not 0; negative when the motor is mounted the other way round.
        gear: f64 = required, -1000.0..=1000.0;
        /// The table of the drive.
        table: Option<Arc<DriveTable>> = unset None;
    }
    check WheelKeys::check;
}

settings! {
    /// A steering drive by a table of objects.
    #[derive(Clone, Debug, PartialEq)]
    pub struct SteeringKeys {
        /// Motor turns per turn of the equivalent single front wheel, not 0; negative when counts fall
        /// counter-clockwise.
        gear: f64 = required, -10_000.0..=10_000.0;
        /// Position counts per turn of the motor.
        counts_per_turn: f64 = 4096.0, 1.0..=1e6;
        /// Angle at which the homing switch closes.
        switch_rad as switch: f64 = required, -2.0..=2.0;
        /// CiA 402 homing method; 27: onto the switch from above, and off it.
        homing_method: i8 = 27, -128..=127;
        /// Speed towards the switch.
        homing_speed_radps as homing_speed: f64 = required, 0.001..=10.0;
        /// Longest homing.
        homing_timeout_s as homing_timeout: Duration = 15.0, 1.0..=120.0;
        /// Maps the PDOs of a drive that has others; else such a drive is refused.
        remap: bool = false;
        /// The table of the drive.
        table: Option<Arc<DriveTable>> = unset None;
    }
    check SteeringKeys::check;
}

/// Error of a configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConfigError {
    /// Invalid in CANopen.
    CanOpen(canopen::master::ConfigError),
    /// No base has these quantities.
    Base(kinematics::Error),
    /// The data sheet of a drive was not read.
    NoSheet(Axis),
    /// A drive cannot be driven by its data sheet.
    Drive {
        /// What it should move.
        axis: Axis,
        /// Why not.
        refusal: Refusal,
    },
    /// A wheel is to be turned by a motor that its serial line does not have.
    NoMotor,
    /// A motor controller cannot be driven with its keys.
    Controller {
        /// What it should move.
        axis: Axis,
        /// Why not.
        error: motorctl::ConfigError,
    },
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::CanOpen(error) => error.fmt(f),
            Self::Base(error) => error.fmt(f),
            Self::NoSheet(axis) => write!(f, "the data sheet of the {} drive was not read", axis.name()),
            Self::NoMotor => f.write_str("a serial line has no motor for a wheel"),
            Self::Drive { axis, refusal } => write!(f, "the {} drive is refused: {refusal}", axis.name()),
            Self::Controller { axis, error } => write!(f, "the {} drive is refused: {error}", axis.name()),
        }
    }
}

impl std::error::Error for ConfigError {}

impl From<canopen::master::ConfigError> for ConfigError {
    fn from(error: canopen::master::ConfigError) -> Self {
        Self::CanOpen(error)
    }
}

impl From<kinematics::Error> for ConfigError {
    fn from(error: kinematics::Error) -> Self {
        Self::Base(error)
    }
}

/// Configuration of `driver_canbus`.
#[derive(Clone, Debug)]
pub struct Config {
    /// The CAN bus's name: `can.main`; none: all drives are on serial lines.
    pub bus: Option<String>,
    /// Further CAN buses, with the axes whose drives are on them; all others are on the first bus or on a line.
    pub further: Vec<FurtherBus>,
    /// Serial lines, each with the device that turns one or two wheels.
    pub lines: Vec<LineConfig>,
    /// bit/s.
    pub bitrate: u32,
    /// Node id of this master, 1..=127.
    pub node_id: u8,
    /// Period of SYNC, if any drive needs it.
    pub sync: Option<Duration>,
    /// Period of TIME, if any node keeps a clock.
    pub time: Option<Duration>,
    /// Fixed to steered axle, m; of a base without steering: of the base as whose steering it takes the angle of
    /// `LL_CMD_MOTION`.
    pub wheelbase: f64,
    /// Circumference of a driven wheel, m.
    pub wheel_circumference: f64,
    /// What the propulsion of a base that steers drives.
    pub traction: Traction,
    /// Wheels of a base without steering; none: a driven rear axle and steered front wheels.
    pub base: Option<Base>,
    /// Bounds on commands and on what is done.
    pub limits: Limits,
    /// Modules without which the robot must not move.
    pub critical: Vec<String>,
    /// Modules without which the planner must not move it.
    pub planning: Vec<String>,
    /// The robot has a power controller that reports the PAUSE line.
    pub has_pause_line: bool,
    /// Lidars whose own fields stop the robot, as `driver_lidar` reports them: `lidar.front`.
    pub fields: Vec<String>,
    /// A watchdog started this process: without its list of processes the robot does not move.
    pub guarded: bool,
    /// Release of the first homing.
    pub homing_release: HomingRelease,
    /// How the robot comes to a stand.
    pub stop: Stop,
    /// What senses what is in the way, and the speed where nothing does.
    pub protection: protection::Config,
    /// Boards of range finders that must measure while the robot moves; empty: there are none.
    pub ranging: Vec<RangingBoard>,
    /// Greatest age of a measurement of theirs.
    pub ranging_age_max: Duration,
    /// A device of its own measures the motion of the body (`LL_DATA_ODO`), so that a drive which stands may be
    /// believed for longer. Without it the encoder of the only driven wheel, and that of the steering, have no other
    /// witness.
    pub odometry: bool,
    /// The drive of the rear axle, or of each wheel of `base`, in their order.
    pub wheels: Vec<PropulsionConfig>,
    /// The drive of the front wheels' steering; none with a `base`.
    pub steering: Option<SteeringConfig>,
    /// Devices with inputs and outputs on the CAN bus.
    pub devices: Vec<Canopen>,
}

/// A further CAN bus of the drives; node ids are its own.
#[derive(Clone, Debug, PartialEq)]
pub struct FurtherBus {
    /// Its name: `can.second`.
    pub bus: String,
    /// bit/s.
    pub bitrate: u32,
    /// Node id of this master there, 1..=127.
    pub node_id: u8,
    /// Period of SYNC, if any drive there needs it.
    pub sync: Option<Duration>,
    /// Period of TIME, if any node there keeps a clock.
    pub time: Option<Duration>,
    /// What its drives move.
    pub axes: Vec<Axis>,
}

impl Config {
    /// Number of the CAN bus of an axis's drive: 0 is the first one, and that of a drive on a serial line.
    pub(super) fn bus_of(&self, axis: Axis) -> usize {
        self.further.iter().position(|bus| bus.axes.contains(&axis)).map_or(0, |place| place + 1)
    }

    /// A node on the CAN bus of this number, for people: with the bus where there are several.
    pub(super) fn place(&self, bus: usize, node: u8) -> String {
        let name = match bus.checked_sub(1) {
            Some(further) => self.further.get(further).map(|bus| &bus.bus),
            None => self.bus.as_ref().filter(|_| !self.further.is_empty()),
        };
        name.map_or_else(|| format!("node {node}"), |name| format!("node {node} on {name}"))
    }

    /// Number of the CAN bus of this name; the first one without a name, or of a name that no further bus has.
    pub(super) fn bus_number(&self, name: Option<&str>) -> usize {
        let named = |name: &str| self.further.iter().position(|bus| bus.bus == name);
        name.and_then(named).map_or(0, |place| place + 1)
    }

    /// Period of SYNC and node id of the master, on the CAN bus of an axis's drive.
    pub(super) fn sync_and_master(&self, axis: Axis) -> (Option<Duration>, u8) {
        let further = self.bus_of(axis).checked_sub(1).and_then(|place| self.further.get(place));
        further.map_or((self.sync, self.node_id), |bus| (bus.sync, bus.node_id))
    }

    /// The same of several CAN buses, in their order, with their names: each axis of the base has a drive on one of
    /// them or on a line. Ids of nodes are those of their buses. Absent: an axis has no drive.
    #[must_use]
    pub fn on_buses(
        buses: &[(String, &BusConfig)],
        lines: Vec<LineConfig>,
        base: Option<Base>,
        geometry: &Geometry,
        limits: Limits,
    ) -> Option<Self> {
        let ((name, first), others) = buses.split_first()?;
        let nodes = buses.iter().flat_map(|(_, bus)| bus.nodes.iter().cloned()).collect();
        let steers = buses.iter().find(|(_, bus)| bus.node(Axis::Steering).is_some());
        let homing_release = steers.map_or(first, |(_, bus)| bus).homing_release;
        let together = BusConfig { nodes, homing_release, ..(*first).clone() };
        let further = |(name, bus): &(String, &BusConfig)| FurtherBus {
            bus: name.clone(),
            bitrate: bus.bitrate,
            node_id: bus.master,
            sync: bus.sync,
            time: bus.time,
            axes: bus.nodes.iter().map(|node| node.axis).collect(),
        };
        let config = together.driver_with(Some(name.clone()), lines, base, geometry, limits)?;
        Some(Self { further: others.iter().map(further).collect(), ..config })
    }
}

/// The drive of a wheel, or of an axle, in profile velocity mode.
#[derive(Clone, Debug)]
pub struct PropulsionConfig {
    /// What it moves.
    pub axis: Axis,
    /// Node id, 1..=127; of an ODrive at most 62; the id of a VESC; the address of a RoboClaw.
    pub node: u8,
    /// Which one.
    pub drive: PropulsionDrive,
    /// Objects that engineers may write.
    pub writable: Vec<u16>,
}

/// Kind of such a drive.
#[derive(Clone, Debug)]
pub enum PropulsionDrive {
    /// A drive of CiA 402 by a table of objects.
    Table {
        /// The table.
        table: Arc<DriveTable>,
        /// Velocity in the unit of the drive at 1 m/s; negative when the motor is mounted the other way round.
        units_per_mps: f64,
    },
    /// Any drive of CiA 402.
    Cia402 {
        /// Its sheet and keys.
        drive: Cia402,
        /// Circumference of the wheel, m.
        circumference: f64,
    },
    /// A motor controller without CANopen, on CAN.
    Controller(ControllerConfig),
    /// A motor of the device on a serial line.
    OnLine {
        /// Number of the line in the configuration.
        line: usize,
        /// Number of the motor among those of its device.
        motor: usize,
    },
}

/// The steering drive, in profile position mode.
#[derive(Clone, Debug)]
pub struct SteeringConfig {
    /// Node id, 1..=127.
    pub node: u8,
    /// Which one.
    pub drive: SteeringDrive,
    /// Angle at which the homing switch closes, rad.
    pub switch: f64,
    /// CiA 402 homing method.
    pub homing_method: i8,
    /// Speed towards the switch, rad/s.
    pub homing_speed: f64,
    /// Longest homing.
    pub homing_timeout: Duration,
    /// Speed of the steering, rad/s.
    pub speed: f64,
    /// Objects that engineers may write.
    pub writable: Vec<u16>,
}

/// Kind of a steering drive.
#[derive(Clone, Debug)]
pub enum SteeringDrive {
    /// A drive of CiA 402 by a table of objects.
    Table {
        /// The table.
        table: Arc<DriveTable>,
        /// Motor turns per turn of the equivalent single front wheel.
        gear: f64,
        /// Position counts per turn of the motor.
        counts_per_turn: f64,
        /// Maps the PDOs of a drive that has others.
        remap: bool,
    },
    /// Any drive of CiA 402.
    Cia402(Cia402),
}

impl BusConfig {
    fn check(&self, table: &Table<'_>) {
        let ids: Vec<u8> = self.nodes.iter().map(|node| node.id).collect();
        table.unique("nodes", "id", &ids, "one that no other node of the bus has");
        for n in (0..ids.len()).filter(|n| ids[*n] == self.master) {
            let _ = table.item("nodes", n).map(|item| item.refuse("id", "one that is not the master's"));
        }
        let axes: Vec<Axis> = self.nodes.iter().map(|node| node.axis).collect();
        table.unique("nodes", "axis", &axes, "one that no other node has");
        self.check_hosts(table);
        let is_odrive = |node: &Node| matches!(node.drive, Drive::Odrive(_));
        for (n, node) in self.nodes.iter().enumerate().filter(|(_, node)| is_odrive(node)) {
            if self.canopen_ids().any(|other| is_ambiguous(node.id, other)) {
                let expected = "one whose 32 identifiers no CANopen node of the bus has";
                let _ = table.item("nodes", n).map(|item| item.refuse("id", expected));
            }
        }
    }

    /// A VESC answers to an id of its own, which no VESC has.
    fn check_hosts(&self, table: &Table<'_>) {
        let vescs = self.nodes.iter().enumerate().filter_map(|(n, node)| match &node.drive {
            Drive::Vesc(keys) => Some((n, node.id, keys.host(node.id))),
            _ => None,
        });
        for (n, _, host) in vescs.clone() {
            let is_taken = |(other, id, taken): (usize, u8, u8)| id == host || other != n && taken == host;
            if vescs.clone().any(is_taken) {
                let expected = "one by which no other VESC of the bus is answered, and that is no VESC's id";
                let _ = table.item("nodes", n).map(|item| item.refuse("host_id", expected));
            }
        }
    }

    /// Node ids of CANopen on the bus: that of the master counts if there are others.
    fn canopen_ids(&self) -> impl Iterator<Item = u8> + '_ {
        let nodes = self.nodes.iter().filter(|node| node.is_canopen()).map(|node| node.id);
        let master = nodes.clone().next().map(|_| self.master);
        nodes.chain(master)
    }

    /// True if a drive without CANopen uses identifiers of this node of CANopen, or of the master.
    #[must_use]
    pub fn is_ambiguous(&self, canopen: u8) -> bool {
        let others = self.nodes.iter().filter(|node| !node.is_canopen());
        let odrives = others.filter(|node| matches!(node.drive, Drive::Odrive(_)));
        odrives.clone().any(|node| [canopen, self.master].iter().any(|other| is_ambiguous(node.id, *other)))
    }

    /// True if the robot rolls, braked by nothing, once its drives get no commands: on motor controllers without
    /// CANopen.
    #[must_use]
    pub fn rolls_without_commands(&self) -> bool {
        self.nodes.iter().any(|node| !node.is_canopen())
    }

    fn node(&self, axis: Axis) -> Option<&Node> {
        self.nodes.iter().find(|node| node.axis == axis)
    }

    fn wheel_drive(&self, node: &Node, circumference: f64) -> Option<PropulsionConfig> {
        let controller = |gear, device| PropulsionDrive::Controller(ControllerConfig { gear, device, circumference });
        let drive = match &node.drive {
            Drive::Wheel(keys) => {
                let table = keys.table.clone()?;
                let units_per_mps = table.units_per_turn * keys.gear / circumference;
                PropulsionDrive::Table { table, units_per_mps }
            }
            Drive::Cia402(keys) => PropulsionDrive::Cia402 { drive: node.by_sheet(keys), circumference },
            Drive::Odrive(keys) => controller(keys.gear, keys.device(node.id)),
            Drive::Vesc(keys) => controller(keys.motor.gear, keys.device(node.id)),
            Drive::Steering(_) => return None,
        };
        Some(PropulsionConfig { axis: node.axis, node: node.id, drive, writable: node.writable.clone() })
    }

    /// The drive of the steering, without the speed.
    fn steering(&self) -> Option<SteeringConfig> {
        let node = self.node(Axis::Steering)?;
        let steering = |drive, switch, homing_method, homing_speed, homing_timeout| SteeringConfig {
            node: node.id,
            drive,
            switch,
            homing_method,
            homing_speed,
            homing_timeout,
            speed: 0.0,
            writable: node.writable.clone(),
        };
        Some(match &node.drive {
            Drive::Steering(keys) => {
                let &SteeringKeys { gear, counts_per_turn, remap, .. } = keys;
                let drive = SteeringDrive::Table { table: keys.table.clone()?, gear, counts_per_turn, remap };
                steering(drive, keys.switch, keys.homing_method, keys.homing_speed, keys.homing_timeout)
            }
            Drive::Cia402(keys) => {
                let drive = SteeringDrive::Cia402(node.by_sheet(keys));
                steering(drive, keys.switch?, keys.homing_method, keys.homing_speed?, keys.homing_timeout)
            }
            Drive::Wheel(_) | Drive::Odrive(_) | Drive::Vesc(_) => return None,
        })
    }

    /// Configuration of the driver for the bus of this name; absent unless all drives of the base are on it. The other
    /// modules are to be set.
    #[must_use]
    pub fn driver(&self, bus: String, base: Option<Base>, geometry: &Geometry, limits: Limits) -> Option<Config> {
        self.driver_with(Some(bus), Vec::new(), base, geometry, limits)
    }

    /// The same for drives that may be on these serial lines, too; without a `bus` all of them are.
    #[must_use]
    pub fn driver_with(
        &self,
        bus: Option<String>,
        lines: Vec<LineConfig>,
        base: Option<Base>,
        geometry: &Geometry,
        limits: Limits,
    ) -> Option<Config> {
        let circumference = geometry.wheel_circumference_m();
        let axes = base.as_ref().map_or(&["propulsion"][..], Base::axes);
        let of_bus = |axis: &str| self.nodes.iter().find(|node| node.axis.name() == axis);
        let drive = |axis: &&str| match of_bus(axis) {
            Some(node) => self.wheel_drive(node, circumference),
            None => on_line(axis, &lines),
        };
        let wheels = axes.iter().map(drive).collect::<Option<Vec<_>>>()?;
        let steering = match base {
            Some(_) => None,
            None => Some(SteeringConfig { speed: limits.steering_rate_radps, ..self.steering()? }),
        };
        Some(Config {
            bus,
            further: Vec::new(),
            lines,
            bitrate: self.bitrate,
            node_id: self.master,
            sync: self.sync,
            time: self.time,
            wheelbase: geometry.wheelbase_m,
            wheel_circumference: circumference,
            traction: geometry.traction(),
            base,
            limits,
            critical: Vec::new(),
            planning: Vec::new(),
            has_pause_line: false,
            fields: Vec::new(),
            ranging: Vec::new(),
            ranging_age_max: Duration::ZERO,
            odometry: false,
            guarded: false,
            homing_release: self.homing_release,
            stop: Stop::usual(),
            wheels,
            protection: protection::Config::default(),
            steering,
            devices: Vec::new(),
        })
    }
}

/// The drive of a wheel on a serial line.
fn on_line(axis: &str, lines: &[LineConfig]) -> Option<PropulsionConfig> {
    lines.iter().enumerate().find_map(|(number, line)| {
        let motor = line.motors.iter().position(|(own, _)| own.name() == axis)?;
        let (axis, drive) = (line.motors[motor].0, PropulsionDrive::OnLine { line: number, motor });
        Some(PropulsionConfig { axis, node: line.device.address(), drive, writable: Vec::new() })
    })
}

impl Node {
    fn check(&self, table: &Table<'_>) {
        let steers = self.axis == Axis::Steering;
        if let Some(other) = self.drive.homing().and_then(HomingSwitch::to_the_other_end).filter(|_| steers)
            && other.plan().search.is_some_and(|(switch, _)| switch != Switch::Home)
        {
            let expected =
                format!("{}, the limit switch on the side of switch_rad by the sign of gear", other.number());
            table.refuse("homing_method", expected);
        }
        match &self.drive {
            Drive::Wheel(_) | Drive::Odrive(_) | Drive::Vesc(_) if steers => {
                table.refuse("axis", r#""propulsion" or a wheel: this driver cannot steer"#);
            }
            Drive::Steering(_) if !steers => {
                table.refuse("axis", r#""steering", which is all that this driver can move"#);
            }
            Drive::Cia402(keys) => keys.check_axis(self.axis, table),
            Drive::Odrive(_) => OdriveConfig::check_node(self.id, table),
            Drive::Vesc(_) => refuse_canopen(table),
            Drive::Wheel(_) | Drive::Steering(_) => {}
        }
        if !self.writable.iter().all(|index| may_be_listed(*index)) {
            table.refuse("writable", "indices of the device profile on which no motion, supervision or stop depends");
        }
    }
}

impl Node {
    /// True for a CANopen node.
    #[must_use]
    pub fn is_canopen(&self) -> bool {
        !matches!(self.drive, Drive::Odrive(_) | Drive::Vesc(_))
    }

    fn by_sheet(&self, keys: &Cia402Config) -> Cia402 {
        Cia402 { keys: keys.clone(), sheet: self.sheet.clone(), motor_rpm_max: self.motor_rpm_max }
    }
}

/// The switch by which a steering is homed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HomingSwitch {
    /// Angle at which it closes, rad.
    pub angle: f64,
    /// Homing method, a number of CiA 402 or one of the maker's.
    pub method: i8,
    /// True if counts of the drive rise to the right.
    pub reversed: bool,
}

impl HomingSwitch {
    /// True if the method searches for its switch to the left; absent: it searches for none.
    fn seeks_left(self) -> Option<bool> {
        let (_, direction) = Method::of(self.method)?.plan().search?;
        Some((direction == Direction::Positive) != self.reversed)
    }

    /// True if it is closed to the left of its edge: it is a switch at the end on its side of straight ahead. One at
    /// straight ahead is where the method searches for it.
    #[must_use]
    pub fn is_left(self) -> bool {
        self.angle > 0.0 || self.angle == 0.0 && self.seeks_left() == Some(true)
    }

    /// The like method that searches on the side of the switch, if this one searches on the other side.
    fn to_the_other_end(self) -> Option<Method> {
        let away = self.angle != 0.0 && self.seeks_left()? != (self.angle > 0.0);
        Method::of(self.method).filter(|_| away)?.mirrored()
    }

    /// What may not be meant with its method: a search that ends at the switch only after it was turned back at the
    /// other end, by a limit switch of the drive.
    #[must_use]
    pub fn remark(self) -> Option<String> {
        let Self { angle, method, .. } = self;
        let other = self.to_the_other_end()?.number();
        let [there, here] = if angle < 0.0 { ["left", "right"] } else { ["right", "left"] };
        Some(format!(
            "homing_method = {method} searches to the {there} by the sign of gear, and switch_rad = {angle} is on the \
             {here}, where {other} searches"
        ))
    }
}

impl Drive {
    /// How it is homed, if it steers.
    #[must_use]
    pub fn homing(&self) -> Option<HomingSwitch> {
        let (angle, method) = match self {
            Self::Steering(keys) => (keys.switch, keys.homing_method),
            Self::Cia402(keys) => (keys.switch?, keys.homing_method),
            Self::Wheel(_) | Self::Odrive(_) | Self::Vesc(_) => return None,
        };
        Some(HomingSwitch { angle, method, reversed: self.gear().is_some_and(|gear| gear < 0.0) })
    }

    /// Motor turns per turn of what it moves; absent: its data sheet states them.
    #[must_use]
    pub fn gear(&self) -> Option<f64> {
        match self {
            Self::Wheel(keys) => Some(keys.gear),
            Self::Steering(keys) => Some(keys.gear),
            Self::Cia402(keys) => keys.gear,
            Self::Odrive(keys) => Some(keys.gear),
            Self::Vesc(keys) => Some(keys.motor.gear),
        }
    }

    /// The keys of a drive that is driven by its data sheet.
    #[must_use]
    pub fn by_sheet(&self) -> Option<&Cia402Config> {
        match self {
            Self::Cia402(keys) => Some(keys),
            Self::Wheel(_) | Self::Steering(_) | Self::Odrive(_) | Self::Vesc(_) => None,
        }
    }

    /// The table of objects by which it is driven.
    #[must_use]
    pub fn table(&self) -> Option<&Arc<DriveTable>> {
        match self {
            Self::Wheel(keys) => keys.table.as_ref(),
            Self::Steering(keys) => keys.table.as_ref(),
            Self::Cia402(_) | Self::Odrive(_) | Self::Vesc(_) => None,
        }
    }
}

/// Names of drivers that are no tables.
pub(super) const DRIVERS: [&str; 3] = ["cia402", "odrive", "vesc"];
/// Before the name of a table of objects, in the key `driver`: a table that turns a wheel, and one that steers. The
/// reader of a node knows by it which keys the node has. No name of a file contains a colon.
pub(super) const TURNS: &str = "wheel:";
pub(super) const STEERS: &str = "steering:";

/// The name of a driver, or of a table.
struct DriverName;

impl Rule<String> for DriverName {
    fn accept(&self, value: &Value) -> Option<String> {
        let Value::String(name) = value else { return None };
        let is_table = [TURNS, STEERS].iter().any(|kind| name.starts_with(kind));
        let is_known = is_table || DRIVERS.contains(&name.as_str()) || table::built_in(name).is_some();
        is_known.then(|| name.clone())
    }

    fn expected(&self) -> String {
        let names = BUILT_IN.iter().map(|(name, _)| *name).chain(DRIVERS);
        let names: Vec<String> = names.map(|name| format!("{name:?}")).collect();
        format!("{}, or the NAME of a file drives/NAME.toml", names.join(" or "))
    }

    fn stand_in(&self) -> String {
        BUILT_IN[0].0.into()
    }

    fn shown(&self, name: &String) -> String {
        format!("{name:?}")
    }
}

impl Section for Drive {
    fn read(table: &mut Table<'_>) -> Self {
        let driver = table.required("driver", &DriverName);
        let read = |table: &mut Table<'_>| match driver.as_str() {
            "cia402" => Self::Cia402(Section::read(table)),
            "odrive" => Self::Odrive(Section::read(table)),
            "vesc" => Self::Vesc(Section::read(table)),
            name if name.starts_with(STEERS) => Self::Steering(Section::read(table)),
            name if name.starts_with(TURNS) => Self::Wheel(Section::read(table)),
            name => {
                let of_name = table::built_in(name);
                if of_name.as_ref().is_some_and(|table| !table.turns_wheels()) {
                    Self::Steering(SteeringKeys { table: of_name, ..Section::read(table) })
                } else {
                    Self::Wheel(WheelKeys { table: of_name, ..Section::read(table) })
                }
            }
        };
        read(table)
    }

    fn rows(rows: &mut Rows) {
        let about = "`epos`: maxon EPOS 70/10, for a driven wheel. `icla`: Berger Lahr IclA, for the steering. \
                     `cia402`: any drive of CiA 402, by its data sheet (`docs/adding-a-drive.md`). `odrive`: ODrive by \
                     CAN Simple, for a wheel, `vesc`: VESC on CAN, for a wheel (`docs/motor-controllers.md`). `NAME`: \
                     the drive of the file `drives/NAME.toml`, whose keys are below; what the node states, too, counts \
                     in place of them. With `form = \"sheet\"` the node has the keys of `cia402`, with `form = \
                     \"objects\"` those of `epos` for a wheel, those of `icla` for the steering.";
        rows.key("driver", None, about);
        rows.required::<String, _>(&DriverName);
        rows.only("epos", WheelKeys::rows);
        rows.only("icla", SteeringKeys::rows);
        rows.only("cia402", Cia402Config::rows);
        rows.only("odrive", OdriveConfig::rows);
        rows.only("vesc", VescConfig::rows);
    }
}

impl WheelKeys {
    fn check(&self, table: &Table<'_>) {
        not_zero(table, self.gear);
    }
}

/// A homing method is one of CiA 402, or one of the maker's, which are negative.
pub(super) fn check_method(table: &Table<'_>, number: i8) {
    if number >= 0 && Method::of(number).is_none() {
        table.refuse("homing_method", "1 to 14, 17 to 30, 33 to 35, 37 (CiA 402), or below 0 (the maker's)");
    }
}

/// Bit of the statusword that says that an axis has its reference: bits 9 to 13 (remote, target reached, internal
/// limit, and two of the mode; CiA 402-2, 8.4.2) are set without a homing, too.
pub(super) fn check_homed_bit(table: &Table<'_>, bit: Option<u8>) {
    if bit.is_some_and(|bit| (9..=13).contains(&bit)) {
        table.refuse("homed_bit", "8, 14 or 15: the others are those of CiA 402");
    }
}

impl SteeringKeys {
    fn check(&self, table: &Table<'_>) {
        not_zero(table, self.gear);
        check_method(table, self.homing_method);
    }
}
