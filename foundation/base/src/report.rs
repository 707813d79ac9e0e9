//! Error reports, the thesis's *liberror*: what the operator reads and the watchdog acts on.

use crate::listed;
use alloc::borrow::Cow;
use alloc::string::String;
use core::panic;

/// How grave a report is. Values are those of `common.error_t`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(i8)]
pub enum Severity {
    /// News: something is as it should be, or is so again.
    Notice = 0,
    /// Something is not as it should be; the work goes on.
    Warning = 1,
    /// Work that was asked for is not being done.
    Error = 2,
}

impl Severity {
    /// The equivalent level of a text.
    #[must_use]
    pub const fn level(self) -> Level {
        match self {
            Self::Notice => Level::Info,
            Self::Warning => Level::Warning,
            Self::Error => Level::Error,
        }
    }
}

listed! {
    /// Level of a line of text. Values are those of `common.event_text_t`.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    #[repr(i8)]
    pub enum Level {
        /// Details that help to find a defect.
        Debug = 0 => "DEBUG",
        /// News.
        Info = 1 => "INFO",
        /// Something is not as it should be; the work goes on.
        Warning = 2 => "WARNING",
        /// Work that was asked for is not being done.
        Error = 3 => "ERROR",
    }
}

impl Level {
    /// The level of a value on the wire; none for other values.
    #[must_use]
    pub fn from_value(value: i8) -> Option<Self> {
        Self::ALL.into_iter().find(|level| *level as i8 == value)
    }
}

/// What a report is about. Values are those of `common.error_t`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(i8)]
pub enum Kind {
    /// None of the others.
    Unknown = 0,
    /// Something did not come in time.
    Timeout = 1,
    /// The machine refused something: memory, a file, a right.
    Resource = 2,
    /// A device or its bus.
    Device = 3,
}

macro_rules! faults {
    ($($(#[doc = $means:literal])+ $name:ident = $number:literal, $kind:ident;)*) => {
        /// What can go wrong, by number. Numbers are never reused; `make generate` makes the table of
        /// `docs/faults.md` from this list.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u16)]
        pub enum Fault { $($(#[doc = $means])+ $name = $number),* }

        impl Fault {
            /// All of them, in order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$name),*];

            /// Name as it stands in `docs/faults.md`.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => stringify!($name)),* }
            }

            /// Meaning, as a sentence.
            #[must_use]
            pub const fn means(self) -> &'static str {
                match self { $(Self::$name => concat!($($means),+).trim_ascii_start()),* }
            }

            /// What it is about.
            #[must_use]
            pub const fn kind(self) -> Kind {
                match self { $(Self::$name => Kind::$kind),* }
            }
        }
    };
}

faults! {
    /// A state command that the transition table forbids; nothing changed.
    CommandForbidden = 0x0001, Unknown;
    /// A message on a channel of ours could not be decoded; it was dropped.
    MessageMalformed = 0x0002, Unknown;
    /// A port could not be opened, or was lost.
    PortDown = 0x0003, Device;
    /// A port lost data: a queue or a kernel buffer was full.
    PortOverrun = 0x0004, Resource;
    /// A message came from a sender who may not publish it (`commands` of `[bus]` in robot.toml); it was dropped.
    SenderRefused = 0x0005, Unknown;
    /// Another watchdog publishes on this bus: another robot, or a simulated one. The robot stops.
    SecondRobot = 0x0006, Unknown;

    /// A board fails to answer now and then (error counter at 96).
    BoardDegraded = 0x0101, Device;
    /// A board does not answer (error counter at 128): it is asked once a second only.
    BoardLost = 0x0102, Device;
    /// A board does not know an instruction of its kind.
    BoardRefused = 0x0103, Device;
    /// A board answered what its kind cannot answer, is deaf (it answers, and its sonars receive nothing any more), or
    /// is frozen (it repeats one measurement).
    BoardImplausible = 0x0104, Device;
    /// Something sends on a bus without being asked.
    BusBabble = 0x0105, Device;
    /// Two boards answer at one address.
    AddressClash = 0x0106, Device;

    /// A ranging board does not measure, which the motion depends on: the robot stops.
    RangingLost = 0x0107, Timeout;
    /// A floor sensor of a distance board sees no floor and engages the PAUSE line; the message names the corner.
    FloorMissing = 0x0108, Device;
    /// The supply voltage of a board is out of its range.
    BoardSupply = 0x0109, Device;

    /// A drive does not answer, or its heartbeat is missing.
    DriveLost = 0x0201, Device;
    /// A drive sent an emergency message.
    DriveEmergency = 0x0202, Device;
    /// A drive could not be brought up: a step of its boot-up failed.
    DriveBootFailed = 0x0203, Device;
    /// A drive is not the one that the configuration names.
    DriveMismatch = 0x0204, Device;
    /// A drive is in its fault state, does not answer although it sends heartbeats, or does not obey.
    DriveFault = 0x0205, Device;
    /// Homing an axis failed.
    HomingFailed = 0x0206, Device;
    /// A motion command was out of limits or not a number: the robot stops.
    MotionRefused = 0x0207, Unknown;
    /// Two sources of the same priority command the motion; the first holds.
    MotionContested = 0x0208, Unknown;
    /// A module that the motion depends on is not running: the robot stops.
    CriticalModule = 0x0209, Timeout;
    /// The watchdog's list of processes is missing: the robot stops.
    WatchdogSilent = 0x020A, Timeout;
    /// A CAN frame that CANopen does not allow came from a node.
    CanMalformed = 0x020B, Device;
    /// Another program commands the drives, or has our node id: the robot stops.
    SecondMaster = 0x020C, Device;
    /// The CAN controller is error-passive: much of what it sends or receives is broken.
    CanPassive = 0x020D, Device;
    /// Nobody acknowledges what is sent on a CAN bus: the robot stops.
    CanUnacknowledged = 0x020E, Device;
    /// Frames with errors on a CAN bus.
    CanErrors = 0x020F, Device;
    /// A node, or an unknown sender, floods a CAN bus.
    CanBabble = 0x0210, Device;
    /// Two nodes of a CAN bus have the same id: the robot stops.
    NodeClash = 0x0211, Device;
    /// The robot is measured to be faster than commanded: it is braked.
    SpeedExceeded = 0x0212, Device;
    /// The robot does not brake as commanded: the motors' feed is cut, where there is a way to.
    StopFailed = 0x0213, Device;
    /// An object of a drive on which its motion or stop depends does not hold what was written: the robot stops.
    DriveParameter = 0x0214, Device;
    /// The output or GPIO line that cuts the motors' feed does not answer or obey: the robot stops.
    SecondWayLost = 0x0215, Device;
    /// No motion of the base has the speeds that its wheels measure, or the wheels work against each other: the robot
    /// stops.
    WheelsDisagree = 0x0216, Device;

    /// A module's process ended unasked and is started again.
    ModuleDied = 0x0301, Unknown;
    /// A module does not announce its state: it is ended and started again.
    ModuleHung = 0x0302, Timeout;
    /// A module's process could not be started.
    ModuleUnstartable = 0x0303, Resource;
    /// A module's page of beats cannot be read: it is judged by its announcements.
    BeatsBad = 0x0304, Unknown;
    /// Somebody announces the name of a module that does not run, or that announces itself as well.
    NameClaimed = 0x0305, Unknown;
    /// A module was started again and again: reported once, not each time.
    RestartStorm = 0x0306, Unknown;
    /// A module has no process: which of its faults are active is not known (only on `CM_DATA_FAULTS`).
    ModuleDown = 0x0307, Unknown;
    /// The watchdog's own checks are late again and again: a hang would be found too late, so the robot stops.
    WatchdogLate = 0x0308, Timeout;

    /// A simulated fault was asked for that the simulator does not know.
    FaultUnknown = 0x0401, Unknown;

    /// The power controller does not report the state of the PAUSE line: the robot stops.
    PauseUnknown = 0x0501, Timeout;
    /// The supply is cut soon, or an operator ordered it: the modules are ended, the computer is halted.
    PowerOff = 0x0502, Device;
    /// The battery's charge is below the reserve.
    BatteryLow = 0x0503, Resource;
    /// A power channel does not switch as commanded.
    ChannelStuck = 0x0504, Device;
    /// A power channel switched itself off, which it does at an over-current.
    ChannelTripped = 0x0505, Device;
    /// A power channel draws nearly as much current as it may.
    ChannelCurrent = 0x0506, Resource;
    /// A computer did not shut down in its time, and lost its supply nevertheless.
    ComputerStuck = 0x0507, Timeout;

    /// Not all inputs of a module are recorded for replay: the disk is slow, full or broken.
    InputsLost = 0x0601, Resource;
    /// Messages are not written to the log: the disk takes them too slowly, or not at all.
    LogLost = 0x0602, Resource;
    /// The disk takes no log: it is full, read-only or broken; it is tried again.
    LogRefused = 0x0603, Resource;
    /// More channels are received than a log holds: messages of further ones are left out.
    LogCrowded = 0x0604, Resource;

    /// A chip on an I2C bus does not answer, or another one does.
    ChipLost = 0x0701, Device;
    /// Something is hotter than its limit.
    OverTemperature = 0x0702, Device;
    /// A fan does not turn although it is driven.
    FanFailed = 0x0703, Device;
    /// The reading of a 1-Wire thermometer is damaged, or is not a temperature.
    ThermometerBad = 0x0704, Device;
    /// The computer slows itself down, by its temperature or a supply voltage that is too low.
    HostThrottled = 0x0705, Resource;

    /// A gamepad cannot drive the robot: it lacks an axis or a button, or an axis has no range.
    GamepadRefused = 0x0711, Device;
    /// The dead-man button is held and moves nothing: it was held before, or pressed with a stick off its middle.
    GamepadNotReleased = 0x0712, Unknown;

    /// A device of inputs and outputs does not answer: its inputs are unknown, its outputs as it leaves them.
    IoDeviceLost = 0x0721, Device;
    /// A device of inputs and outputs refuses an address or a value.
    IoDeviceRefused = 0x0722, Device;
    /// A command for an output was refused: an unknown name, no output, no number, or out of its limits.
    OutputRefused = 0x0723, Unknown;

    /// A lidar does not measure: what it looks at is unknown.
    LidarLost = 0x0731, Device;
    /// The optics of a lidar are dirty; it still measures.
    LidarDirty = 0x0732, Device;
    /// The optics of a lidar are too dirty to measure.
    LidarBlocked = 0x0733, Device;
    /// The motor of a lidar is too slow or too fast.
    LidarSpeed = 0x0734, Device;
    /// Part of what a lidar should measure does not arrive.
    LidarIncomplete = 0x0735, Device;
    /// The line of a lidar is disturbed.
    LidarDisturbed = 0x0736, Device;
    /// A lidar reports an error of its own.
    LidarError = 0x0737, Device;
    /// A lidar that measures gives no valid result of a field or an output that stops the robot: the robot stands.
    LidarNoResult = 0x0738, Device;
    /// A lidar warns that it may fail; it still measures.
    LidarWarning = 0x0739, Device;

    /// An inertial measurement unit does not measure: nothing goes by it.
    ImuLost = 0x0741, Device;
    /// The line of an inertial measurement unit is disturbed.
    ImuDisturbed = 0x0742, Device;
    /// An inertial measurement unit measures what no robot does, or turns at standstill: nothing goes by it.
    ImuImplausible = 0x0743, Device;
    /// An inertial measurement unit repeats the same values: nothing goes by it.
    ImuFrozen = 0x0744, Device;
    /// The gyroscope of an inertial measurement unit is not calibrated: nothing goes by it.
    ImuUncalibrated = 0x0745, Device;
    /// An inertial measurement unit reports an error of its own.
    ImuError = 0x0746, Device;

    /// No odometry is received: the estimate uses the motion of the drives, or none.
    OdometrySilent = 0x0801, Timeout;
    /// Odometry contradicts the drives: a wheel or its encoder is stuck, or wheels slip.
    OdometryStuck = 0x0802, Device;
    /// A beacon was sighted that is not on the map.
    BeaconUnknown = 0x0803, Unknown;
    /// Where the robot is was known and is not: it was carried away, or saw no beacons for too long.
    PoseLost = 0x0804, Unknown;
    /// A measurement or a pose by hand was refused: not a number, or beyond what any robot does.
    MeasurementBad = 0x0805, Unknown;
    /// The wheels turn the robot otherwise than an inertial unit measures: wheels slip, or one of both errs.
    RotationDisagrees = 0x0806, Device;

    /// A goal that no robot can be sent to was refused.
    GoalRefused = 0x0811, Unknown;
    /// The estimate that the planner uses is not a number, or its time runs backwards: the robot stands.
    EstimateBad = 0x0812, Unknown;
    /// An operation mode was commanded that does not exist, or that this robot cannot carry out.
    ModeRefused = 0x0813, Unknown;
    /// A parameter was to be changed that does not exist, or to a value that is out of its range.
    ParameterRefused = 0x0814, Unknown;

    /// There is no connection to another computer of the robot; where it is critical, the robot stops.
    BridgeDown = 0x0901, Timeout;
    /// The bridge refused somebody without the key, or a record that was changed, repeated or left out.
    BridgeRefused = 0x0902, Unknown;
    /// A module of another computer that has to work does not; where the connection is critical, the robot stops.
    RemoteModule = 0x0903, Timeout;
    /// The wall clocks of two computers of the robot differ too much.
    ClocksDiffer = 0x0904, Unknown;
}

/// One report, as a module makes it; its host prints it and sends it as `common.error_t`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Report {
    /// What it is.
    pub fault: Fault,
    /// Which of several: a board, a drive, a module, a channel; may be empty. Together with `fault` it tells one
    /// lasting fault from another, so it holds nothing that changes from report to report.
    pub subject: String,
    /// How grave.
    pub severity: Severity,
    /// One line for people: what, where, what is done about it.
    pub message: String,
    /// True if the module ends because of it.
    pub fatal: bool,
    /// Where in the source it was made.
    pub location: Location,
}

/// A line of the source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Location {
    /// The file, from the root of the checkout.
    pub file: Cow<'static, str>,
    /// Line, from 1.
    pub line: u32,
}

impl Location {
    /// Where this is called.
    #[must_use]
    #[track_caller]
    pub fn caller() -> Self {
        let caller = panic::Location::caller();
        Self { file: Cow::Borrowed(caller.file()), line: caller.line() }
    }
}

impl Report {
    /// A report that is not fatal, made where it is called.
    #[must_use]
    #[track_caller]
    pub fn new(severity: Severity, fault: Fault, subject: impl Into<String>, message: impl Into<String>) -> Self {
        Self {
            fault,
            subject: subject.into(),
            severity,
            message: message.into(),
            fatal: false,
            location: Location::caller(),
        }
    }

    /// The same, fatal.
    #[must_use]
    pub fn fatal(mut self) -> Self {
        self.fatal = true;
        self
    }
}
