//! Causes for which the robot does not act: one list for all modules, by number, with their text for people.
//!
//! Modules publish numbers on `LL_DATA_HOLD` and programs compare numbers. Texts are made only here, at the reader:
//! [`lowlevel::Hold::words`]. `make generate` makes the table of `docs/holds.md` from this list.
//!
//! | numbers | about |
//! |---|---|
//! | 100 to 199 | the PAUSE line |
//! | 200 to 299 | the CAN bus and its drives |
//! | 300 to 399 | modules |
//! | 400 to 499 | sources of motion commands, and what they command |
//! | 500 to 599 | position and sensors |
//! | 600 to 699 | the goal |
//! | 700 to 799 | the guard: what is sensed, or not known, around the robot |

use crate::{StopSource, lowlevel, source_in_words};

macro_rules! holds {
    ($(#[doc = $means:literal] $name:ident = $code:literal, $words:literal, $remedy:literal;)*) => {
        /// Cause. A number is never used for another one; a new cause gets a new number.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(i32)]
        pub enum Hold { $(#[doc = $means] $name = $code),* }

        impl Hold {
            /// All causes, in order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$name),*];

            /// Name in `docs/holds.md`.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => stringify!($name)),* }
            }

            /// Meaning, and the kind of its subject.
            #[must_use]
            pub const fn means(self) -> &'static str {
                match self { $(Self::$name => $means.trim_ascii_start()),* }
            }

            /// Sentence with `{}` in the place of the subject's name.
            #[must_use]
            pub const fn sentence(self) -> &'static str {
                match self { $(Self::$name => $words),* }
            }

            /// Action of an operator, with `{}` in the place of the subject as people call it.
            #[must_use]
            pub const fn what_to_do(self) -> &'static str {
                match self { $(Self::$name => $remedy),* }
            }
        }
    };
}

holds! {
    /// The power controller does not report the PAUSE line. No subject.
    PauseUnknown = 101, "the state of the PAUSE line is unknown",
        "Check that the power controller is on and that its link is plugged in.";
    /// The PAUSE line was engaged and is not any more; it remains until a deliberate act. No subject.
    PauseLatched = 102, "PAUSE was engaged: the robot waits for an operator",
        "Clear the cause; then release the controls and press again, or send the goal again.";
    /// The state of a lidar's own fields that stop the robot is not known yet, or not any more. Subject: the lidar.
    PauseFieldUnknown = 103, "the fields of {} are not known to be free",
        "Check its errors, and the modules: driver_lidar must run. Then release the controls and press again.";
    /// The state of an input that stops the robot (`[stop]`) is not known yet, or not any more. Subject: the input.
    PauseInputUnknown = 104, "the state of {} is not known",
        "Check supply and cable of what reads {}, and the modules. Then release the controls and press again.";
    /// A bumper engages the PAUSE line. Subject: `bumper1` to `bumper8`.
    PauseBumper = 111, "PAUSE is engaged by {}", "Clear what touches {}.";
    /// Floor sensors engage the PAUSE line. Subject: `sd1_front` or `sd1_rear`.
    PauseFloor = 112, "PAUSE is engaged by {}", "Push the robot back by hand until {} are over a flat floor.";
    /// The stop button engages the PAUSE line. Subject: `button`.
    PauseButton = 113, "PAUSE is engaged by {}", "Turn the red button until it springs out.";
    /// A field of a lidar that stops the robot is infringed, or not known. Subject: the lidar, such as `lidar.front`.
    PauseField = 114, "PAUSE is engaged by the fields of {}",
        "Clear what is in the fields of {}; if nothing is, check its errors.";
    /// An input that stops the robot (`[stop]`) is open. Subject: the input, such as `io.estop` or `drive.left.3`.
    PauseInput = 115, "PAUSE is engaged by {}",
        "Close {}: release the emergency stop. If it is not pressed, check its wires.";
    /// Another source engages the PAUSE line. Subject: its name as it was reported.
    PauseOther = 119, "PAUSE is engaged by {}", "Release the PAUSE line at {}.";

    /// The CAN bus is not open. Subject: the bus.
    BusDown = 201, "{} is down", "Check the CAN adapter of {}; it is reopened automatically.";
    /// No node acknowledges frames. Subject: the bus.
    BusUnacknowledged = 202, "nobody on {} acknowledges what is sent",
        "Check cable, termination and bit rate of {}, and that the drives have power.";
    /// Another CANopen master is on the bus. Subject: the bus.
    SecondMaster = 203, "another master commands the drives", "End the other program that commands the drives on {}.";
    /// A drive is booting. Subject: its axis, such as `propulsion` or `steering`.
    DriveBooting = 211, "the {} drive is being booted", "Wait some seconds.";
    /// A step of a drive's boot-up failed; it is retried each second. Subject: the drive.
    DriveBootFailed = 212, "the {} drive cannot be booted", "Check the errors, and type and power of the {}.";
    /// A drive's heartbeat is missing, or it left operation. Subject: the drive.
    DriveLost = 213, "the {} drive is lost", "Check power and cable of the {}; it is booted again automatically.";
    /// A drive sends heartbeats but does not answer requests. Subject: the drive.
    DriveDeaf = 214, "the {} drive does not answer", "Wait some seconds: the {} is booted again automatically.";
    /// A drive left operation without a command. Subject: the drive.
    DriveDropped = 215, "the {} drive changed its state by itself", "Check the errors of the {}.";
    /// A drive does not reach the commanded state. Subject: the drive.
    DriveStuck = 216, "the {} drive does not reach the state that is commanded", "Check the errors of the {}.";
    /// A drive does not acknowledge its set-point, or does not move as commanded. Subject: the drive.
    DriveNoTarget = 217, "the {} drive does not take its target", "Check the errors of the {}.";
    /// A drive is in its fault state; the fault is reset each second. Subject: the drive.
    DriveFault = 218, "the {} drive is in fault", "Check the errors of the {}; the fault is reset automatically.";
    /// A drive is booted, but its state was not received yet. Subject: the drive.
    DriveUnseen = 219, "the {} drive has not reported its state", "Wait some seconds.";
    /// The steering has no reference. Subject: the axis.
    NotHomed = 221, "the {} is not homed yet", "Home it, with room at the front wheels.";
    /// The steering is being homed. Subject: the axis.
    Homing = 222, "the {} is being homed", "Wait some seconds: it moves to its switch, then to straight ahead.";
    /// The steering is homed and moves to straight ahead. Subject: the axis.
    Centering = 223, "the {} is homed and turns straight", "Wait some seconds.";
    /// Homing failed; it is not retried automatically. Subject: the axis.
    HomingFailed = 224, "homing the {} failed", "Home it again, with room at the front wheels.";
    /// The steering has no reference, and homing moves the wheels: it waits for a release. Subject: the axis.
    ToBeHomed = 225, "the {} is to be homed: it waits for an operator",
        "Keep clear of the front wheels; then home it, send a goal, or drive by hand from zero.";
    /// An object of a drive on which the stop depends was changed; it is written again. Subject: the drive.
    DriveParameter = 231, "the {} drive does not hold its configuration",
        "Find out who writes to the {}; it is configured again automatically.";
    /// The robot was measured to be faster than commanded, and braked. No subject.
    SpeedExceeded = 232, "the robot was faster than commanded",
        "Find out why; then command driver_canbus to RUN by hand.";
    /// The robot did not brake as commanded, and the motors' feed was cut. No subject.
    FeedCut = 233, "the motors' feed was cut: the robot did not brake as commanded",
        "Find out why; then switch the power channel motors on by hand.";
    /// The output or line that cuts the motors' feed does not answer or obey, or its state is unknown. No subject.
    SecondWayLost = 234, "the second way to stop does not answer",
        "Check what cuts the motors' feed: power and cable of its node, or its GPIO line.";
    /// What feeds the motors is off, power channel, output or GPIO line, and not by this driver's order. No subject.
    FeedOff = 235, "the motors' feed is switched off",
        "Check that the robot may move; then switch the power channel motors on by hand.";
    /// No motion has the speeds of the wheels, or they work against each other; until the robot stands. No subject.
    WheelsDisagree = 236, "the wheels contradict each other",
        "Check encoders, wheels and their order on the bus; then command zero first.";
    /// The only driven wheel was measured to stand although it was to turn: its encoder may be dead. No subject.
    WheelStood = 237, "the driven wheel stood although it was commanded to turn",
        "Free the robot, or check the wheel's encoder; then command driver_canbus to RUN by hand.";

    /// A module without which the robot must not move does not run. Subject: the module.
    CriticalModule = 301, "critical module {} is not running",
        "Wait some seconds: {} is restarted automatically. If not, check the modules.";
    /// The watchdog's list of processes is missing. No subject.
    WatchdogSilent = 302, "the watchdog does not report", "Wait some seconds: the watchdog is restarted automatically.";
    /// The watchdog of another robot is on the message bus. No subject.
    SecondRobot = 303, "another robot is on the message bus",
        "End the other robot, or give it a message bus of its own (--lcm-url).";
    /// The module has not started working. Subject: the module.
    ModuleInit = 311, "{} is in INIT", "Wait some seconds; the errors show the reason.";
    /// The module was commanded into PAUSE. Subject: the module.
    ModulePaused = 312, "{} is in PAUSE", "Command {} to RUN.";
    /// The module was commanded into STOP. Subject: the module.
    ModuleStopped = 313, "{} is in STOP", "Command {} to RUN by hand.";
    /// The module lost its device. Subject: the module.
    ModuleError = 314, "{} is in ERROR", "Check the errors of {}.";
    /// The module ends. Subject: the module.
    ModuleEnding = 315, "{} is in TERMINATE", "Command {} to RUN.";
    /// Required messages of a module are missing. Subject: the module.
    ModuleSilent = 321, "{} does not report", "Check the modules: {} must run.";

    /// No source commands the motion: nothing is wrong. No subject.
    NobodyCommands = 401, "nobody commands the motion", "Drive by hand, or send the robot to a goal.";
    /// A command was out of limits or not a number; ends when no such command arrives for its time to live. No subject.
    CommandRefused = 402, "a command was out of limits", "Check the errors: they name the source and the value.";
    /// A source sends commands while another one of higher priority moves the robot. Subject: the source.
    Overruled = 403, "{} is overruled by a higher priority", "Wait until the other source releases the robot.";
    /// A source sends commands while another one of equal priority moves the robot. Subject: the source.
    Contested = 404, "{} must wait: another source of its priority moves the robot",
        "Wait until the other source releases the robot.";
    /// The robot was stopped, or the source was silent, and it has not sent zero since. Subject: the source.
    NotReleased = 405, "{} must send zero first: the robot was stopped", "Release the controls, then press again.";
    /// The robot was stopped, or driven by hand, and no operator has resumed the planner since. Subject: the source.
    PlannerLatched = 406, "{} waits: an operator must resume it", "Send the goal or the mode again, or resume it.";
    /// Another source moves the robot. Subject: that source.
    OtherSource = 407, "{} drives the robot", "Wait until {} releases the robot, then resume.";
    /// The cause of a quick stop has ended, and the robot still brakes: it is served when it stands. No subject.
    Stopping = 408, "the robot finishes its stop", "Wait a moment: it stands within a second.";

    /// A velocity to the side is commanded: the base has none, and it is left out. A notice. Subject: the source.
    NoSideways = 411, "{} commands motion to the side, which the base cannot do",
        "Nothing is wrong: {} must command forward speed and rotation only.";
    /// A turn on the spot is commanded: the base cannot do it, and stands. A notice. Subject: the source.
    NoTurnOnSpot = 412, "{} commands a turn on the spot, which the base cannot do",
        "Nothing is wrong: {} must command a forward speed with the rotation.";
    /// A narrower turn is commanded than the base reaches: it drives the narrowest. A notice. Subject: the source.
    TurnTooNarrow = 413, "{} commands a narrower turn than the base can do: it turns as tightly as it can",
        "Nothing is wrong: {} must command more speed or less rotation.";
    /// The distance in which the robot must stop bounds the speed (`stop.distance_m`). A notice. No subject.
    StopDistance = 414, "the robot drives no faster than PAUSE can stop it within its stopping distance",
        "Nothing is wrong: command a lower speed.";

    /// No estimate was received since the start. No subject.
    NoEstimate = 501, "no estimate of the position has come yet", "Wait some seconds; the estimator must run.";
    /// The estimator does not know the position. No subject.
    EstimateLost = 502, "the estimator is lost",
        "Set the position by hand, or move the robot to where beacons are visible.";
    /// The estimator searches for the position. No subject.
    EstimateSearching = 503, "the estimator searches where the robot is", "Keep three beacons in sight; else set the position by hand.";
    /// The estimate is too old, or not a number. No subject.
    EstimateBad = 504, "the estimate is old or no number", "Check the modules: the estimator must run.";
    /// Readings of the sonars are missing. No subject.
    SonarsSilent = 505, "the sonars do not report", "Check the modules and buses: the ranging boards must answer.";
    /// The state of the sonars in the direction of travel is unknown. Subject: `front` or `rear`.
    SonarsUnknown = 506, "nothing is known of the sonars at the {}",
        "Check the errors: the ranging board at the {} must answer.";
    /// A ranging board does not measure: what its sonars and floor sensors would detect is unknown. Subject: the board.
    RangingLost = 507, "ranging board {} does not answer",
        "Check power and cable of {}. When it answers, release the controls and press again, or send the goal again.";
    /// A module without which the planner must not drive does not run. Subject: the module.
    PlannerModule = 511, "the planner may not drive: {} is not running",
        "Wait some seconds: {} is restarted automatically. Then resume.";
    /// The estimate is missing, lost or too old for driving. No subject.
    PlannerNoEstimate = 512, "the planner has no estimate to drive by",
        "Wait until the estimator knows the position, then resume.";

    /// The planner has no goal: nothing is wrong. No subject.
    NoGoal = 601, "there is no goal", "Send the robot to a goal.";
    /// The planner starts: its first command is under way. No subject.
    Starting = 602, "the planner begins to drive", "Wait a moment.";
    /// A path is being searched. No subject.
    Planning = 603, "the planner looks for a way", "Wait some seconds.";
    /// An obstacle is on the path. Subject: its position, `X, Y` in m in the map frame.
    InTheWay = 604, "somebody stands in the way at {}", "Clear the path; after a while the robot tries another one.";
    /// An obstacle is too close to drive. No subject.
    SomebodyNear = 605, "somebody stands near", "Step back; after a while the robot tries another path.";
    /// The robot backs out before another path is searched. No subject.
    BackingOut = 606, "the planner backs out", "Wait some seconds.";
    /// A loop of one waypoint: the robot is there. No subject.
    AtLoop = 607, "the robot stands at the only waypoint of its loop", "Send the robot to another goal.";
    /// The operation mode is MANUAL: the planner drives nowhere. No subject.
    ModeManual = 608, "mode manual: only people drive the robot",
        "Set the mode to route, then send the robot to a goal.";
    /// The operation mode is HOME, and no home place is configured. No subject.
    NoHome = 609, "no home place is configured", "Configure planner.home, or send the robot to a goal.";
    /// The operation mode is WAIT or APPROACH, and there is nobody to turn or to drive to. No subject.
    WaitsForPeople = 610, "the planner waits for people", "Wait for somebody, or set the mode to route.";
    /// No path: the robot does not fit in at the waypoint. Subject: the waypoint, counted from 1.
    GoalBlocked = 611, "no way to waypoint {}: the robot does not fit in at the goal",
        "Clear the place, or send the robot to another one.";
    /// No path: the robot is in an obstacle or outside the map. Subject: the waypoint, counted from 1.
    StartBlocked = 612, "no way to waypoint {}: the robot stands in an obstacle or outside of the map",
        "Check the position; drive the robot free by hand.";
    /// No path: everything within reach was tried. Subject: the waypoint, counted from 1.
    Unreachable = 613, "no way to waypoint {}: no way leads to the goal",
        "Clear the passage, or send the robot to another place.";
    /// No path was found within the computing budget. Subject: the waypoint, counted from 1.
    SearchExhausted = 614, "no way to waypoint {}: no way was found with the work allowed",
        "Clear the passage, or send the robot there in shorter legs.";
    /// No path: a coordinate is not a number. Subject: the waypoint, counted from 1.
    GoalInvalid = 615, "no way to waypoint {}: a coordinate is no number", "Send a valid goal.";
    /// No path: start and goal are farther apart than a floor without a map can hold. Subject: the waypoint, from 1.
    FloorTooLarge = 616, "no way to waypoint {}: the floor between is too large",
        "Send the robot there in shorter legs, or give it a map.";
    /// The robot did not move although motion was commanded. Subject: the waypoint, counted from 1.
    NotMoving = 617, "no way to waypoint {}: the robot was commanded to drive and does not move",
        "Check that nothing blocks the wheels.";
    /// The robot came to a stop beside the waypoint. Subject: the waypoint, counted from 1.
    StoppedBeside = 618, "no way to waypoint {}: the robot came to stand beside it",
        "Wait some seconds: the robot tries again.";
    /// No path: the obstacle in the way remains. Subject: the waypoint, counted from 1.
    WayBlocked = 619, "no way to waypoint {}: something stands in the way", "Clear the passage.";

    /// `LL_DATA_GUARD` is missing: the robot stands until a source releases it. No subject.
    GuardSilent = 701, "the guard does not report", "Wait some seconds: the guard is restarted automatically.";
    /// Something is too near for the commanded speed. A notice: the speed is less, or 0. Subject: the sensor.
    GuardStops = 711, "something is near: {}", "Clear what stands before {}.";
    /// Somebody could walk into the way. A notice: the speed is less. Subject: the sensor.
    GuardSlows = 712, "the robot slows for what is ahead: {}", "Clear what stands before {}, or wait.";
    /// Nothing is known of a sensor: its space counts as occupied. A notice: less speed, or none. Subject: the sensor.
    GuardUnknown = 713, "nothing is known of {}: its space counts as occupied",
        "Check the errors: the board of {} must answer.";
    /// Nothing senses what is in the way. A notice: the speed is less. No subject.
    GuardBlind = 714, "nothing senses what is in the way: the robot drives slowly",
        "Give the robot sensors: table guard of robot.toml.";
    /// The measured motion is missing. A notice: the speed is 0. No subject.
    GuardMotion = 715, "the guard does not know the motion", "Check the modules: driver_canbus must run.";
    /// `LL_DATA_GUARD` was missing for a moment. A notice: the speed is 0 until it returns. No subject.
    GuardLate = 716, "the guard did not report for a moment", "Wait some seconds.";
    /// The guard bounds this direction, and names no cause for it. A notice: the speed is less, or 0. No subject.
    GuardBounds = 717, "the guard permits no more this way", "Clear what stands this way, or wait.";
    /// The reach of the sensors bounds the speed. A notice: the speed is less. No subject.
    GuardReach = 718, "the sensors reach no farther: the robot drives as fast as it can stop within their reach",
        "Nothing is wrong: command a lower speed.";
    /// A person creeps past the guard by a second input. A notice. Subject: the source.
    GuardCreep = 721, "{} creeps past the guard", "Release the second input when the way is free.";
}

impl Hold {
    /// Number on the wire.
    #[must_use]
    pub const fn code(self) -> i32 {
        self as i32
    }

    /// Cause of a number; `None` for one from a later version.
    #[must_use]
    pub fn from_code(code: i32) -> Option<Self> {
        Self::ALL.iter().copied().find(|hold| hold.code() == code)
    }

    /// True if nothing is wrong: the module acts as soon as it is commanded to.
    #[must_use]
    pub const fn is_idle(self) -> bool {
        matches!(self, Self::NobodyCommands | Self::NoGoal | Self::ModeManual | Self::WaitsForPeople)
    }

    /// True if the module acts, but not as far as it is commanded to: a speed is bounded, or the base cannot do a part
    /// of the motion.
    #[must_use]
    pub const fn is_notice(self) -> bool {
        matches!(
            self,
            Self::NoSideways
                | Self::NoTurnOnSpot
                | Self::TurnTooNarrow
                | Self::StopDistance
                | Self::GuardStops
                | Self::GuardSlows
                | Self::GuardUnknown
                | Self::GuardBlind
                | Self::GuardMotion
                | Self::GuardLate
                | Self::GuardBounds
                | Self::GuardReach
                | Self::GuardCreep
        )
    }

    /// True if the cause alone shows that it remains until a person acts: a command, or a new press.
    #[must_use]
    pub const fn is_latched(self) -> bool {
        matches!(
            self,
            Self::PauseLatched
                | Self::ToBeHomed
                | Self::SpeedExceeded
                | Self::FeedCut
                | Self::FeedOff
                | Self::WheelStood
                | Self::ModulePaused
                | Self::ModuleStopped
                | Self::HomingFailed
                | Self::NotReleased
                | Self::PlannerLatched
        )
    }

    /// True if its subject is a drive, and faults of the drive belong to it.
    #[must_use]
    pub const fn is_about_a_drive(self) -> bool {
        matches!(
            self,
            Self::DriveBooting
                | Self::DriveBootFailed
                | Self::DriveLost
                | Self::DriveDeaf
                | Self::DriveDropped
                | Self::DriveStuck
                | Self::DriveNoTarget
                | Self::DriveFault
                | Self::DriveUnseen
                | Self::DriveParameter
        )
    }

    /// True if its subject is a source of commands.
    const fn is_about_a_source(self) -> bool {
        matches!(
            self,
            Self::Overruled
                | Self::Contested
                | Self::NotReleased
                | Self::PlannerLatched
                | Self::OtherSource
                | Self::NoSideways
                | Self::NoTurnOnSpot
                | Self::TurnTooNarrow
                | Self::GuardCreep
        )
    }

    /// Sentence about a subject: a source as people call it, anything else by its name.
    #[must_use]
    pub fn words(self, subject: &str) -> String {
        let subject = match self {
            _ if self.is_about_a_source() => source_in_words(subject),
            Self::PauseOther if subject.is_empty() => StopSource::Unknown.words().into(),
            _ => subject.into(),
        };
        self.sentence().replace("{}", &subject)
    }

    /// Subject as people call it: `bumper 3`, `propulsion drive`, `Jana (web)`.
    #[must_use]
    pub fn who(self, subject: &str) -> String {
        match self {
            Self::PauseBumper
            | Self::PauseFloor
            | Self::PauseButton
            | Self::PauseInput
            | Self::PauseInputUnknown
            | Self::PauseOther => StopSource::in_words(subject),
            Self::PauseField | Self::PauseFieldUnknown => subject.replacen('.', " ", 1),
            _ if self.is_about_a_drive() => format!("{subject} drive"),
            _ if self.is_about_a_source() => source_in_words(subject),
            _ => subject.into(),
        }
    }

    /// Action of an operator.
    #[must_use]
    pub fn remedy(self, subject: &str) -> String {
        self.what_to_do().replace("{}", &self.who(subject))
    }
}

impl lowlevel::Hold {
    /// Cause; `None` if the number is from a later version.
    #[must_use]
    pub fn cause(&self) -> Option<Hold> {
        Hold::from_code(self.code)
    }

    /// Sentence for people.
    #[must_use]
    pub fn words(&self) -> String {
        match self.cause() {
            Some(hold) => hold.words(&self.subject),
            None if self.subject.is_empty() => format!("cause {}, which this version does not know", self.code),
            None => format!("cause {} of {}, which this version does not know", self.code, self.subject),
        }
    }
}

/// Module that lists the causes that hold the motion.
pub const MOTION_MODULE: &str = "driver_canbus";
/// Module that lists the causes that hold the goal.
pub const GOAL_MODULE: &str = "planner";

impl lowlevel::DataHold {
    /// True if the list concerns the motion.
    #[must_use]
    pub fn is_of_motion(&self) -> bool {
        self.module == MOTION_MODULE
    }

    /// True if the list concerns the goal.
    #[must_use]
    pub fn is_of_goal(&self) -> bool {
        self.module == GOAL_MODULE
    }

    /// True if the cause is listed, with any subject.
    #[must_use]
    pub fn has(&self, cause: Hold) -> bool {
        self.holds.iter().any(|hold| hold.cause() == Some(cause))
    }

    /// Most important cause; `None` if the module acts, or the number is from a later version.
    #[must_use]
    pub fn first(&self) -> Option<Hold> {
        self.holds.first()?.cause()
    }

    /// True if the module acts, be it with a bounded speed, or would act as soon as it is commanded to.
    #[must_use]
    pub fn is_free(&self) -> bool {
        self.holds.iter().all(|hold| hold.cause().is_some_and(|cause| cause.is_idle() || cause.is_notice()))
    }

    /// True if the module would act as soon as it is commanded to, and has no command.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.is_free() && self.holds.iter().any(|hold| hold.cause().is_some_and(Hold::is_idle))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hold(code: i32, subject: &str) -> lowlevel::Hold {
        lowlevel::Hold { code, subject: subject.into(), latched: false, since: 0 }
    }

    #[test]
    fn numbers_are_in_order_each_once_and_lead_back() {
        assert!(Hold::ALL.is_sorted_by(|a, b| a.code() < b.code()), "{:?}", Hold::ALL);
        for cause in Hold::ALL {
            assert_eq!(Hold::from_code(cause.code()), Some(*cause));
        }
        assert_eq!((Hold::from_code(0), Hold::from_code(-1), Hold::from_code(999)), (None, None, None));
    }

    /// The sentences of `LL_DATA_MOTION.reason` are a contract: other programs print them.
    #[test]
    fn sentences_are_those_of_the_contract() {
        for (code, subject, words) in [
            (101, "", "the state of the PAUSE line is unknown"),
            (111, "bumper2", "PAUSE is engaged by bumper2"),
            (112, "sd1_front", "PAUSE is engaged by sd1_front"),
            (113, "button", "PAUSE is engaged by button"),
            (114, "lidar.front", "PAUSE is engaged by the fields of lidar.front"),
            (119, "a hand", "PAUSE is engaged by a hand"),
            (119, "", "PAUSE is engaged by an unknown source"),
            (201, "can.main", "can.main is down"),
            (202, "can.main", "nobody on can.main acknowledges what is sent"),
            (203, "can.main", "another master commands the drives"),
            (211, "propulsion", "the propulsion drive is being booted"),
            (212, "steering", "the steering drive cannot be booted"),
            (213, "steering", "the steering drive is lost"),
            (214, "steering", "the steering drive does not answer"),
            (217, "steering", "the steering drive does not take its target"),
            (218, "propulsion", "the propulsion drive is in fault"),
            (219, "propulsion", "the propulsion drive has not reported its state"),
            (221, "steering", "the steering is not homed yet"),
            (222, "steering", "the steering is being homed"),
            (223, "steering", "the steering is homed and turns straight"),
            (224, "steering", "homing the steering failed"),
            (301, "driver_power", "critical module driver_power is not running"),
            (302, "", "the watchdog does not report"),
            (312, "driver_canbus", "driver_canbus is in PAUSE"),
            (401, "", "nobody commands the motion"),
            (402, "", "a command was out of limits"),
            (403, "planner", "planner is overruled by a higher priority"),
            (404, "web:Jana", "Jana (web) must wait: another source of its priority moves the robot"),
            (405, "web:Jana", "Jana (web) must send zero first: the robot was stopped"),
            (406, "planner", "planner waits: an operator must resume it"),
            (411, "web:Jana", "Jana (web) commands motion to the side, which the base cannot do"),
            (412, "web:Jana", "Jana (web) commands a turn on the spot, which the base cannot do"),
            (413, "pad", "pad commands a narrower turn than the base can do: it turns as tightly as it can"),
            (608, "", "mode manual: only people drive the robot"),
            (609, "", "no home place is configured"),
            (610, "", "the planner waits for people"),
            (511, "estimator", "the planner may not drive: estimator is not running"),
            (512, "", "the planner has no estimate to drive by"),
        ] {
            assert_eq!(hold(code, subject).words(), words);
        }
        assert_eq!(hold(999, "x").words(), "cause 999 of x, which this version does not know");
        assert_eq!(hold(0, "").words(), "cause 0, which this version does not know");
    }

    #[test]
    fn a_remedy_names_its_subject_as_people_do() {
        assert_eq!(Hold::PauseBumper.remedy("bumper3"), "Clear what touches bumper 3.");
        assert_eq!(Hold::PauseOther.remedy(""), "Release the PAUSE line at an unknown source.");
        assert_eq!(Hold::PauseOther.remedy("rope"), "Release the PAUSE line at rope.");
        assert_eq!(Hold::PauseField.who("lidar.front"), "lidar front");
        assert_eq!(Hold::PauseInput.who("io.estop"), "the input estop");
        assert_eq!(Hold::PauseInputUnknown.who("drive.left.3"), "digital input 3 of the left drive");
        assert_eq!(Hold::DriveDropped.remedy("steering"), "Check the errors of the steering drive.");
        let side = "Nothing is wrong: advee drive on robot must command forward speed and rotation only.";
        assert_eq!(Hold::NoSideways.remedy("drive@robot:8"), side);
        assert_eq!(Hold::GuardCreep.who("diag:6323"), "a terminal (advee diag)");
    }

    #[test]
    fn causes_about_a_drive_name_it_so_and_list_its_faults() {
        for cause in Hold::ALL {
            let is_named = cause.sentence().contains("the {} drive");
            assert_eq!(cause.is_about_a_drive(), is_named, "{cause:?}");
            assert_eq!(cause.who("steering") == "steering drive", is_named, "{cause:?}");
            let lists = cause.faults().iter().any(|related| related.is(base::Fault::DriveLost as i32, "steering", ""));
            // The input that stops the robot may be one of a drive.
            let is_input = matches!(cause, Hold::PauseInput | Hold::PauseInputUnknown);
            assert_eq!(lists, is_named || is_input, "{cause:?}");
        }
    }

    #[test]
    fn each_cause_has_sentence_and_remedy_and_no_subject_is_lost() {
        for cause in Hold::ALL {
            let (words, remedy) = (cause.words("SUBJECT"), cause.remedy("SUBJECT"));
            assert!(!words.contains(['{', '|', '\n']) && !words.ends_with('.'), "{words}");
            assert!(!remedy.contains(['{', '|', '\n']) && remedy.ends_with('.'), "{remedy}");
        }
    }

    #[test]
    fn a_list_without_a_cause_is_free_and_an_unknown_cause_holds() {
        let list = |holds| lowlevel::DataHold { holds, ..Default::default() };
        let idle = list(vec![hold(401, "")]);
        assert!(idle.is_free() && idle.is_idle() && idle.first() == Some(Hold::NobodyCommands));
        let acting = list(vec![]);
        assert!(acting.is_free() && !acting.is_idle() && acting.first().is_none());
        for holds in [vec![hold(999, "")], vec![hold(401, ""), hold(999, "")], vec![hold(111, "bumper1")]] {
            assert!(!list(holds.clone()).is_free() && !list(holds).is_idle());
        }
    }
}
