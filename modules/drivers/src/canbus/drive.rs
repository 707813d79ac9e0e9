//! Common part of both drives: booting, loss and return of the node, the axis state machine, and faults, which are
//! reported once and reset with pauses.

use super::brake::{Brake, Wheel};
use super::controller::Availability;
use super::motor_watch::MotorWatch;
use super::net::NodeAt;
use base::can::Frame;
use base::{Deadlines, Duration, Fault, Instant, Level, Severity, earliest};
use canopen::axis::modes::Mode;
use canopen::axis::modes::switch::Access;
use canopen::axis::modes::watch::{ModeWatch, WrongMode};
use canopen::axis::{Axis, AxisEvent, Goal, NotFollowing, PowerState, StatusBits, Why};
use canopen::drives::cia402::Table;
use canopen::drives::derive::Refusal;
use canopen::drives::motor::Reading;
use canopen::master::{BootError, LostReason, Step, Ticket};
use canopen::pdo::Data;
use canopen::wire::{Emergency, Service};
use canopen::{Master, Payload, sdo};
use messages::{Hold, lowlevel};
use module::Actions;
use std::fmt;

/// Period of repeating a command that has not taken effect: a frame may be lost if CAN is carried by UDP.
const REPEAT_PERIOD: Duration = Duration::from_millis(50);
/// Period of stop commands to a drive that is not booted: that of the master's heartbeat, which keeps a drive at its
/// last command.
const BLIND_STOP_PERIOD: Duration = Duration::from_millis(50);
/// Period of resetting a fault; motion is decided elsewhere.
const FAULT_RESET_PERIOD: Duration = Duration::from_secs(1);
/// Minimum time for which an axis that did not obey, or left operation by itself, blocks motion.
const TROUBLE_MIN: Duration = Duration::from_millis(500);
/// Time without a PDO after which the drive's measured values are read, because event-driven PDOs report changes only.
const READ_AFTER: Duration = Duration::from_millis(400);
/// The same while it should be changing its speed: a drive that keeps its speed sends no PDO.
const READ_AFTER_ORDER: Duration = Duration::from_millis(50);
/// Age beyond which measured values count as unknown.
const MEASURED_AGE_MAX: Duration = Duration::from_secs(1);
/// The same of a lost drive.
const LOST_AGE_MAX: Duration = Duration::from_millis(200);

/// Greatest speed of the motor, 1/min. It is compared at boot-up, where it is not written.
const MOTOR_SPEED: u16 = 0x6080;
/// Period of reading the mode of operation while the drive is enabled.
const MODE_PERIOD: Duration = Duration::from_millis(200);
/// An emergency that is repeated is reported once in this time, with the number of repetitions.
const REPEATED_PERIOD: Duration = Duration::from_secs(10);
/// Number of emergencies whose repetitions are counted, also where they alternate.
const EMERGENCIES_MAX: usize = 4;

/// Number of consecutive unanswered requests after which the drive counts as not answering.
const UNANSWERED_MAX: u8 = 2;
/// Time without answers after which the drive is booted again: a reset of its communication ends possible causes (a
/// foreign SDO, an NMT command).
const UNANSWERED_TIMEOUT: Duration = Duration::from_secs(2);

/// Reason why a drive is not booted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Absence {
    Booting,
    BootFailed(Step, BootError),
    Lost(LostReason),
}

/// Uncommanded action of a drive, or failure to obey.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Trouble {
    /// The axis left operation.
    Dropped { to: PowerState, statusword: u16 },
    /// The axis does not reach a state.
    Stuck { state: Option<PowerState>, goal: Goal, statusword: u16, controlword: u16, why: Why },
    /// The drive does not acknowledge its set-point.
    NoTarget,
    /// The drive is enabled and does not move as commanded; with the unit of target and measured value.
    NotFollowing(NotFollowing, &'static str),
    /// The drive is in another mode of operation. It is booted again once the robot stands.
    Mode(WrongMode),
    /// Its holding brake is not known to be released.
    Brake,
}

/// Objection of a drive to motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Objection {
    Absent(Absence),
    /// The drive does not answer requests.
    NotAnswering,
    Trouble(Trouble),
    Fault(InFault),
    /// The drive's state was not received yet.
    StateUnknown,
    /// A motor controller without CANopen is not ready.
    Controller(Availability),
}

impl Objection {
    /// Cause in `LL_DATA_HOLD`.
    pub(super) fn hold(self) -> Hold {
        match self {
            Self::Absent(Absence::Booting) => Hold::DriveBooting,
            Self::Absent(Absence::BootFailed(..)) => Hold::DriveBootFailed,
            Self::Absent(Absence::Lost(_)) => Hold::DriveLost,
            Self::NotAnswering => Hold::DriveDeaf,
            Self::Trouble(Trouble::Dropped { .. }) => Hold::DriveDropped,
            Self::Trouble(Trouble::Stuck { .. } | Trouble::Brake) => Hold::DriveStuck,
            Self::Trouble(Trouble::NoTarget | Trouble::NotFollowing(..)) => Hold::DriveNoTarget,
            Self::Trouble(Trouble::Mode(_)) => Hold::DriveParameter,
            Self::Fault(_) => Hold::DriveFault,
            Self::StateUnknown => Hold::DriveUnseen,
            Self::Controller(availability) => availability.hold(),
        }
    }
}

/// Predicate of a sentence whose subject is the drive.
impl fmt::Display for Objection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Absent(absence) => absence.fmt(f),
            Self::NotAnswering => f.write_str("does not answer"),
            Self::Trouble(trouble) => trouble.fmt(f),
            Self::Fault(fault) => write!(f, "is {fault}"),
            Self::StateUnknown => f.write_str("has not reported its state"),
            Self::Controller(availability) => availability.fmt(f),
        }
    }
}

impl fmt::Display for Absence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Booting => f.write_str("is being booted"),
            Self::BootFailed(_, BootError::Mismatch { index: MOTOR_SPEED, expected, found, .. }) => {
                write!(f, "cannot be booted: it permits {found} rpm of its motor (0x6080), ")?;
                write!(f, "the limits of the robot demand {expected} rpm")
            }
            Self::BootFailed(step, reason) => write!(f, "cannot be booted: {step}: {reason}"),
            Self::Lost(reason) => write!(f, "is lost: {reason}"),
        }
    }
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Dropped { to, statusword } => {
                write!(f, "left by itself to {to}, statusword 0x{statusword:04X}")
            }
            Self::Stuck { state, goal, statusword, controlword, why } => {
                match state {
                    Some(state) => write!(f, "stays in the state {state}")?,
                    None => f.write_str("does not report its state")?,
                }
                write!(f, " on the way to {goal}: {why}; controlword 0x{controlword:04X}")?;
                write!(f, ", statusword 0x{statusword:04X} ({})", StatusBits(statusword))
            }
            Self::NoTarget => f.write_str("does not take its target"),
            Self::Brake => f.write_str("does not release its brake: bit 0 of 0x60FE:1 is not read back as 0"),
            Self::NotFollowing(NotFollowing { target, measured }, unit) => {
                write!(f, "does not take its target: {measured:.2} instead of {target:.2} {unit}")
            }
            Self::Mode(WrongMode { asked, shown }) => {
                write!(f, "does not hold its configuration: its mode is {}, not {}", ModeName(shown), ModeName(asked))
            }
        }
    }
}

/// A mode of operation with its name.
struct ModeName(i8);

impl fmt::Display for ModeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match Mode::from_code(self.0) {
            Some(mode) => write!(f, "{} ({mode})", self.0),
            None => self.0.fmt(f),
        }
    }
}

/// What is known of a drive's fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum InFault {
    /// The first state that was seen after the boot-up. Its emergency was lost, and the reset at boot-up clears its
    /// error history.
    Inherited,
    /// No emergency was received yet.
    NoCode,
    /// Error code of its emergency.
    Code(u16),
}

impl fmt::Display for InFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Inherited => f.write_str("in fault since before it was booted"),
            Self::NoCode => f.write_str("in fault, its emergency was not received"),
            Self::Code(code) => write!(f, "in fault, error code 0x{code:04X}"),
        }
    }
}

/// An emergency that was reported, when, and how often it came since.
#[derive(Clone, Copy, Debug)]
struct Reported {
    emergency: Emergency,
    at: Instant,
    repeated: u32,
}

impl Reported {
    /// True for the same error, whatever the manufacturer's own bytes, which may count or measure.
    fn is_of(&self, emergency: &Emergency) -> bool {
        (self.emergency.code, self.emergency.register) == (emergency.code, emergency.register)
    }
}

base::deadlines! {
    /// Deadlines of a drive, apart from those of its axis.
    enum Timer {
        /// The drive's measured values are read. Set while it is booted.
        Ask,
        /// The last command is sent again. Set while it is booted.
        Repeat,
        /// A fault is reset. Set while the drive is in fault.
        Reset,
        /// Trouble with the drive is evaluated again. Set while it blocks motion.
        Trouble,
        /// The drive is booted again because it does not answer, although its heartbeat continues. Set while that is
        /// so.
        NotAnswering,
        /// The repetitions of emergencies are reported. Set since the first one.
        Repeated,
        /// A quick stop is sent without knowing the drive's state. Set while it is not booted and the bus is up.
        BlindStop,
        /// The measured values of a lost drive are read. Set while it is lost and its heartbeat is received again.
        AskLost,
    }
}

/// State of one drive.
pub(super) struct Drive {
    /// `propulsion` or `steering`.
    pub(super) name: &'static str,
    /// Number of its CAN bus.
    pub(super) bus: usize,
    pub(super) node: u8,
    /// Where it is, for people: `node 1`, of several buses `node 1 on can.main`.
    place: String,
    pub(super) axis: Axis,
    /// What it lacks to stop by itself.
    pub(super) reservations: Vec<Refusal>,
    booted: bool,
    /// The power stage was on by its last statusword, also by one that was read while it was lost.
    powered: bool,
    /// Reason why it is not booted.
    why: Absence,
    /// Error code of the last emergency since it was booted.
    error_code: u16,
    /// The fault is the first state that was seen after the boot-up.
    inherited: bool,
    trouble: Option<Trouble>,
    /// [`Fault::DriveFault`] was raised.
    alarmed: bool,
    /// The last different emergencies, at most [`EMERGENCIES_MAX`].
    reported: Vec<Reported>,
    mode: ModeWatch,
    /// Current read of the mode.
    mode_ticket: Option<Ticket>,
    deadlines: Deadlines<Timer>,
    sent: Option<Data>,
    changed: bool,
    /// The last known state may be outdated: the drive is to be read.
    outdated: bool,
    /// Its speed should be changing.
    changing: bool,
    /// Faults are not reset: the robot may still roll.
    holds_fault: bool,
    /// The motors' feed is cut, or is to be: it has no torque, whatever its state.
    unfed: bool,
    /// Time of its last measured value.
    measured: Instant,
    /// Number of pending requests.
    pending: u8,
    /// Number of consecutive requests without an answer.
    unanswered: u8,
    /// It sent a measured value, or answered, since the motor was looked at last.
    shown: bool,
    /// Current, torque and temperature.
    motor: MotorWatch,
    /// Its holding brake, if this driver switches that.
    brake: Option<Brake>,
}

impl Drive {
    pub(super) fn new(name: &'static str, node: u8, table: &Table, reservations: Vec<Refusal>) -> Self {
        Self {
            name,
            bus: 0,
            node,
            place: format!("node {node}"),
            axis: Axis::new(table.axis_config()),
            reservations,
            booted: false,
            powered: false,
            why: Absence::Booting,
            error_code: 0,
            inherited: false,
            trouble: None,
            alarmed: false,
            reported: Vec::new(),
            mode: ModeWatch::new(MODE_PERIOD),
            mode_ticket: None,
            deadlines: Deadlines::new(),
            sent: None,
            changed: true,
            outdated: false,
            changing: false,
            holds_fault: false,
            unfed: false,
            measured: Instant::ZERO,
            pending: 0,
            unanswered: 0,
            shown: false,
            motor: MotorWatch::new(node, &table.motor),
            brake: None,
        }
    }

    /// Its node.
    pub(super) fn at(&self) -> NodeAt {
        NodeAt { bus: self.bus, id: self.node }
    }

    /// With a holding brake that this driver switches.
    pub(super) fn with_brake(self, brake: Option<Brake>) -> Self {
        Self { brake, ..self }
    }

    /// On the bus of this number; `place`: for people.
    pub(super) fn on_bus(self, bus: usize, place: String) -> Self {
        Self { bus, place, ..self }
    }

    /// Name and place, for people.
    pub(super) fn in_words(&self) -> String {
        format!("{} drive ({})", self.name, self.place)
    }

    /// True if no brake holds the axis, as far as this driver switches it.
    pub(super) fn is_free(&self) -> bool {
        self.brake.as_ref().is_none_or(Brake::is_free)
    }

    /// The goal, as long as the brake permits it: an axis that has torque keeps it until its brake is set.
    pub(super) fn held_until_braked(&self, goal: Goal) -> Goal {
        let has_torque = matches!(self.axis.state(), Some(PowerState::OperationEnabled | PowerState::QuickStopActive));
        let awaits = self.brake.as_ref().is_some_and(|brake| !brake.is_set()) && has_torque && self.booted;
        if goal == Goal::Disabled && awaits { Goal::QuickStop } else { goal }
    }

    /// Switches the brake; `goal`: of the axis, `stands`: it is known to stand.
    pub(super) fn advance_brake(
        &mut self,
        now: Instant,
        goal: Goal,
        stands: bool,
        master: &mut Master,
        out: &mut Actions,
    ) {
        let Some(brake) = &mut self.brake else { return };
        let state = self.axis.state();
        let is_on = matches!(
            state,
            Some(PowerState::OperationEnabled | PowerState::QuickStopActive | PowerState::FaultReactionActive)
        );
        let has_torque = is_on && !self.unfed;
        let wheel = match goal {
            Goal::Enabled if state == Some(PowerState::OperationEnabled) => Wheel::Moves,
            Goal::Disabled if stands => Wheel::Rests,
            _ if stands && state.is_some() && !has_torque => Wheel::Rests,
            _ => Wheel::Other,
        };
        if !brake.advance(now, self.booted, wheel, master) {
            return;
        }
        match wheel {
            Wheel::Moves => {
                let why = Trouble::Brake;
                self.alarm(format!("{} drive ({}) {why}: the robot stops", self.name, self.place), out);
                self.block_until_stopped(now, why);
            }
            _ => out.say(
                Level::Warning,
                format!("{} drive ({}): its brake (0x60FE:1) is not known to be set", self.name, self.place),
            ),
        }
    }

    /// A transfer has ended; false if it is not one of the brake.
    pub(super) fn on_brake(&mut self, now: Instant, ticket: Ticket, result: Result<&[u8], sdo::Error>) -> bool {
        self.brake.as_mut().is_some_and(|brake| brake.on_sdo(now, ticket, result))
    }

    pub(super) fn is_booted(&self) -> bool {
        self.booted
    }

    pub(super) fn on_booted(&mut self, now: Instant, out: &mut Actions) {
        self.booted = true;
        self.sent = None;
        self.error_code = 0;
        self.deadlines.set(Timer::Repeat, now);
        self.deadlines.set(Timer::Ask, now + READ_AFTER);
        self.changed = true;
        // An earlier fault was cleared by the reset, or will be reported again.
        self.alarmed = false;
        let faults = [Fault::DriveLost, Fault::DriveBootFailed, Fault::DriveMismatch];
        for fault in faults.into_iter().chain([Fault::DriveFault, Fault::DriveParameter]) {
            out.clear(fault, self.name, format!("{} drive ({}) is booted and configured", self.name, self.place));
        }
    }

    pub(super) fn on_boot_failed(&mut self, step: Step, reason: BootError, out: &mut Actions) {
        let fault = match reason {
            BootError::Mismatch { .. } => Fault::DriveMismatch,
            _ => Fault::DriveBootFailed,
        };
        self.why = Absence::BootFailed(step, reason);
        let message = format!("{} drive ({}) {}; retried each second", self.name, self.place, self.why);
        out.raise(Severity::Error, fault, self.name, message);
    }

    pub(super) fn on_lost(&mut self, reason: LostReason, out: &mut Actions) {
        self.booted = false;
        self.axis.lost();
        self.deadlines.clear_all();
        (self.trouble, self.outdated) = (None, false);
        (self.pending, self.unanswered) = (0, 0);
        for reported in std::mem::take(&mut self.reported) {
            self.report_repetitions(&reported, out);
        }
        self.mode.lost();
        self.mode_ticket = None;
        self.why = Absence::Lost(reason);
        self.changed = true;
        let message = format!("{} drive ({}) {}; the robot stops", self.name, self.place, self.why);
        out.raise(Severity::Error, Fault::DriveLost, self.name, message);
    }

    pub(super) fn on_emergency(&mut self, now: Instant, emergency: &Emergency, suppressed: u32, out: &mut Actions) {
        self.error_code = emergency.code;
        self.changed = true;
        // The accompanying statusword may have been lost.
        self.outdated |= emergency.code != 0;
        if self.is_in_fault() {
            self.raise_fault(out);
        }
        let known = self.reported.iter_mut().find(|reported| reported.is_of(emergency));
        if let Some(reported) = known.filter(|reported| now.since(reported.at) < REPEATED_PERIOD) {
            reported.repeated = reported.repeated.saturating_add(1).saturating_add(suppressed);
            if !self.deadlines.is_set(Timer::Repeated) {
                self.deadlines.set(Timer::Repeated, reported.at + REPEATED_PERIOD);
            }
            return;
        }
        self.remember(now, emergency, out);
        let more = if suppressed > 0 { format!(", {suppressed} more before it") } else { String::new() };
        self.report_emergency(emergency, &more, out);
    }

    /// The emergency is about to be reported. It takes the place of its last report, or of the oldest one.
    fn remember(&mut self, now: Instant, emergency: &Emergency, out: &mut Actions) {
        self.report_repeated(now, out);
        self.reported.retain(|reported| !reported.is_of(emergency));
        if self.reported.len() == EMERGENCIES_MAX {
            let oldest = self.reported.remove(0);
            self.report_repetitions(&oldest, out);
        }
        self.reported.push(Reported { emergency: *emergency, at: now, repeated: 0 });
    }

    /// Reports the repetitions of emergencies whose last report is old enough.
    fn report_repeated(&mut self, now: Instant, out: &mut Actions) {
        let is_due = |reported: &Reported| now.since(reported.at) >= REPEATED_PERIOD;
        let (due, mut rest): (Vec<_>, Vec<_>) = self.reported.drain(..).partition(is_due);
        for reported in due {
            self.report_repetitions(&reported, out);
            if reported.repeated > 0 {
                rest.push(Reported { at: now, repeated: 0, ..reported });
            }
        }
        self.reported = rest;
        let next = self.reported.iter().filter(|reported| reported.repeated > 0).map(|reported| reported.at).min();
        match next {
            Some(at) => self.deadlines.set(Timer::Repeated, at + REPEATED_PERIOD),
            None => self.deadlines.clear(Timer::Repeated),
        }
    }

    fn report_repetitions(&self, reported: &Reported, out: &mut Actions) {
        let more = match reported.repeated {
            0 => return,
            1 => ", repeated once".to_owned(),
            times => format!(", repeated {times} times"),
        };
        self.report_emergency(&reported.emergency, &more, out);
    }

    fn report_emergency(&self, emergency: &Emergency, more: &str, out: &mut Actions) {
        let severity = if emergency.code == 0 { Severity::Notice } else { Severity::Error };
        let message = format!(
            "{} drive ({}): emergency 0x{:04X} ({}), register 0x{:02X}{more}",
            self.name,
            self.place,
            emergency.code,
            emergency.class(),
            emergency.register
        );
        out.report(severity, Fault::DriveEmergency, self.name, message);
    }

    /// True if the drive has no torque, or is not reached at all.
    pub(super) fn is_off(&self) -> bool {
        !self.booted || self.axis.goal() == Goal::Disabled && self.axis.is_reached()
    }

    /// A deliberate act: the axis may be enabled again after a fault, a drop or a loss.
    pub(super) fn release(&mut self) {
        self.axis.release();
    }

    /// Sets the goal of the axis; ignored while the drive is not booted.
    pub(super) fn set_goal(&mut self, now: Instant, goal: Goal) {
        if self.booted {
            self.axis.set_goal(now, goal);
        }
    }

    /// True if the power stage was on by the last statusword.
    pub(super) fn is_powered(&self) -> bool {
        self.powered
    }

    pub(super) fn on_statusword(&mut self, now: Instant, statusword: u16, out: &mut Actions) {
        self.powered = matches!(
            PowerState::decode(statusword),
            Some(PowerState::OperationEnabled | PowerState::QuickStopActive | PowerState::FaultReactionActive)
        );
        if !self.booted {
            return;
        }
        self.axis.handle_statusword(now, statusword);
        self.drain(now, out);
    }

    /// A measured value was received.
    pub(super) fn on_measured(&mut self, now: Instant) {
        (self.measured, self.shown) = (now, true);
        if self.booted {
            self.deadlines.set(Timer::Ask, now + self.read_after());
        }
    }

    /// Reads the measured values soon while the speed should be changing: a drive that keeps it reports no change.
    pub(super) fn set_changing(&mut self, now: Instant, changing: bool) {
        if std::mem::replace(&mut self.changing, changing) != changing && changing && self.booted {
            self.deadlines.set(Timer::Ask, now + READ_AFTER_ORDER);
        }
    }

    fn read_after(&self) -> Duration {
        if self.changing { READ_AFTER_ORDER } else { READ_AFTER }
    }

    /// A request was sent.
    pub(super) fn on_asked(&mut self) {
        self.pending = self.pending.saturating_add(1);
    }

    /// A request has ended; `error`: the reason why nothing was read. A refusal is an answer. A drive that sends PDOs
    /// and does not answer is in doubt until it answers: whether it can be stopped by a new boot-up is not known.
    pub(super) fn on_answer(&mut self, now: Instant, error: Option<sdo::Error>, out: &mut Actions) {
        self.pending = self.pending.saturating_sub(1);
        match error {
            None | Some(sdo::Error::Refused(_)) => {
                (self.unanswered, self.shown) = (0, true);
                self.deadlines.clear(Timer::NotAnswering);
                return;
            }
            Some(sdo::Error::Cancelled) => return,
            Some(sdo::Error::Timeout | sdo::Error::Protocol(_)) => {}
        }
        // A single lost frame is requested again.
        self.unanswered = self.unanswered.saturating_add(1);
        self.outdated = true;
        if self.unanswered >= UNANSWERED_MAX && self.booted && !self.is_not_answering() {
            self.deadlines.set(Timer::NotAnswering, now + UNANSWERED_TIMEOUT);
            let message =
                format!("{} drive ({}) sends heartbeats but does not answer; the robot stops", self.name, self.place);
            self.alarm(message, out);
        }
    }

    /// Raises the fault of the drive itself; it is cleared when the drive answers, obeys and is not in fault.
    pub(super) fn alarm(&mut self, message: String, out: &mut Actions) {
        self.alarmed = true;
        out.raise(Severity::Error, Fault::DriveFault, self.name, message);
    }

    fn raise_fault(&mut self, out: &mut Actions) {
        let (fault, statusword) = (self.in_fault(), self.axis.statusword());
        let message = format!("{} drive ({}) is {fault}; statusword 0x{statusword:04X}", self.name, self.place);
        self.alarm(message, out);
    }

    /// Clears the fault of the drive itself when no reason for it is left.
    fn settle(&mut self, out: &mut Actions) {
        if self.alarmed && self.booted && self.trouble.is_none() && !self.is_in_fault() && !self.is_not_answering() {
            self.alarmed = false;
            out.clear(Fault::DriveFault, self.name, format!("{} drive: no fault any more", self.name));
        }
    }

    fn is_in_fault(&self) -> bool {
        matches!(self.axis.state(), Some(PowerState::Fault | PowerState::FaultReactionActive))
    }

    fn in_fault(&self) -> InFault {
        match self.error_code {
            0 if self.inherited => InFault::Inherited,
            0 => InFault::NoCode,
            code => InFault::Code(code),
        }
    }

    /// The mode in which the drive must be while it is enabled; `None` while it is switched.
    pub(super) fn expect_mode(&mut self, now: Instant, mode: Option<i8>, master: &mut Master) {
        let enabled = self.booted && self.axis.state() == Some(PowerState::OperationEnabled);
        self.mode.expect(now, mode.filter(|_| enabled && !matches!(self.trouble, Some(Trouble::Mode(_)))));
        if let Some(Access::Read { index, sub }) = self.mode.poll_sdo(now) {
            match master.sdo_read(now, self.node, index, sub) {
                Ok(ticket) => self.mode_ticket = Some(ticket),
                Err(_) => self.mode.handle_sdo(now, Err(sdo::Error::Cancelled)),
            }
        }
    }

    /// A transfer has ended; false if it is not the one that reads the mode.
    pub(super) fn on_mode(&mut self, now: Instant, ticket: Ticket, result: Result<&[u8], sdo::Error>) -> bool {
        if self.mode_ticket.take_if(|own| *own == ticket).is_none() {
            return false;
        }
        self.mode.handle_sdo(now, result.map(Payload::from));
        true
    }

    /// Reads what the drive measures of its motor, at moments when that delays nothing, and only while we are `alone`:
    /// a drive has one SDO server, whose transfers with another master this would end.
    pub(super) fn watch_motor(&mut self, now: Instant, alone: bool, master: &mut Master) {
        let shown = std::mem::take(&mut self.shown);
        let may_ask = alone && shown && self.pending == 0 && self.unanswered == 0 && !self.outdated;
        self.motor.advance(now, self.booted, may_ask, master);
    }

    /// The torque in a PDO, per mille of the rated one.
    pub(super) fn on_torque(&mut self, now: Instant, per_mille: i16) {
        self.motor.on_torque(now, per_mille);
    }

    /// Rated torque of the motor, N m, above 0; `None` until it is read.
    pub(super) fn rated_torque(&self) -> Option<f64> {
        self.motor.motor().rated_torque
    }

    /// A transfer has ended; false if it is not one that reads something of the motor.
    pub(super) fn on_motor(
        &mut self,
        now: Instant,
        ticket: Ticket,
        result: Result<&[u8], sdo::Error>,
        out: &mut Actions,
    ) -> bool {
        let Some(given_up) = self.motor.on_sdo(now, ticket, result) else { return false };
        if let Some(Reading { topic, index, sub, .. }) = given_up {
            let (name, place) = (self.name, &self.place);
            out.note(format!("{name} drive ({place}) does not give 0x{index:04X}:{sub} ({topic}): it is unknown"));
        }
        true
    }

    /// True if the drive is to be booted again: because it has not answered for too long, repeated if that does not
    /// help, or because it is in another mode and the robot stands.
    pub(super) fn must_reboot(&mut self, now: Instant, standing: bool) -> bool {
        if self.booted && standing && self.axis.is_reached() && matches!(self.trouble, Some(Trouble::Mode(_))) {
            return true;
        }
        let due = self.deadlines.is_due(Timer::NotAnswering, now);
        if due {
            self.deadlines.set(Timer::NotAnswering, now + UNANSWERED_TIMEOUT);
        }
        due
    }

    /// True while requests are not answered although the drive sends heartbeats.
    fn is_not_answering(&self) -> bool {
        self.deadlines.is_set(Timer::NotAnswering)
    }

    /// Keeps a fault of the drive while `hold` is true: a reset would let it move again.
    pub(super) fn hold_fault_reset(&mut self, hold: bool) {
        self.holds_fault = hold;
    }

    /// The motors' feed is cut, or is to be; or it is not. A drive with a logic supply of its own may not show that.
    pub(super) fn set_unfed(&mut self, unfed: bool) {
        self.unfed = unfed;
    }

    /// True if its measured values are recent, as far as can be known.
    pub(super) fn is_known(&self, now: Instant) -> bool {
        self.booted && now.since(self.measured) < MEASURED_AGE_MAX
    }

    /// True if a measured value was received within the time in which a lost drive is asked a few times.
    pub(super) fn is_fresh(&self, now: Instant) -> bool {
        now.since(self.measured) < LOST_AGE_MAX
    }

    /// The drive does not obey: blocks motion until it was seen stopped.
    pub(super) fn block_until_stopped(&mut self, now: Instant, why: Trouble) {
        self.set_trouble(now, why);
        self.outdated = true;
    }

    fn set_trouble(&mut self, now: Instant, why: Trouble) {
        self.trouble = Some(why);
        self.deadlines.set(Timer::Trouble, now + TROUBLE_MIN);
    }

    fn drain(&mut self, now: Instant, out: &mut Actions) {
        while let Some(event) = self.axis.poll_event() {
            self.changed = true;
            match event {
                AxisEvent::Fault { .. } => {
                    self.deadlines.set(Timer::Reset, now + FAULT_RESET_PERIOD);
                    self.raise_fault(out);
                }
                AxisEvent::Dropped { to, statusword } => {
                    self.set_trouble(now, Trouble::Dropped { to, statusword });
                }
                AxisEvent::Stuck { state, goal, statusword, controlword, why } => {
                    let why = Trouble::Stuck { state, goal, statusword, controlword, why };
                    self.alarm(format!("{} drive {why}", self.name), out);
                    self.block_until_stopped(now, why);
                }
                AxisEvent::State { from, to } => {
                    if from == Some(PowerState::Fault) {
                        self.deadlines.clear(Timer::Reset);
                    }
                    let inherited = from.is_none() || self.inherited && from == Some(PowerState::FaultReactionActive);
                    self.inherited = inherited && matches!(to, PowerState::Fault | PowerState::FaultReactionActive);
                }
                AxisEvent::Reached(_) => {}
            }
        }
    }

    /// Serves the deadlines; called after every event, before frames are generated.
    pub(super) fn handle_timeout(&mut self, now: Instant, out: &mut Actions) {
        if self.deadlines.take(Timer::Trouble, now)
            && let Some(why) = self.trouble.take()
            && (!self.axis.is_reached() || matches!(why, Trouble::Mode(_)))
        {
            // The drive does not obey a stop, or is to be booted again: not a temporary problem.
            self.block_until_stopped(now, why);
        }
        if self.deadlines.is_due(Timer::Ask, now) {
            self.deadlines.set(Timer::Ask, now + self.read_after());
            self.outdated = true;
        }
        if self.deadlines.is_due(Timer::Reset, now) {
            self.deadlines.set(Timer::Reset, now + FAULT_RESET_PERIOD);
            if !self.holds_fault {
                self.axis.reset_fault(now);
            }
            self.outdated = true;
        }
        if self.deadlines.is_due(Timer::Repeated, now) {
            self.report_repeated(now, out);
        }
        self.axis.handle_timeout(now);
        self.drain(now, out);
        if let Some(wrong) = self.mode.wrong().filter(|_| !matches!(self.trouble, Some(Trouble::Mode(_)))) {
            let why = Trouble::Mode(wrong);
            let message = format!("{} drive {why}: the robot stops, the drive is booted again", self.name);
            out.raise(Severity::Error, Fault::DriveParameter, self.name, message);
            self.block_until_stopped(now, why);
        }
        self.settle(out);
    }

    /// Sends the command frame if it differs from the last one, or has not taken effect.
    pub(super) fn send(&mut self, now: Instant, master: &mut Master, rpdo: u8, data: Data) {
        if !self.booted {
            return;
        }
        let repeat = self.deadlines.tick(Timer::Repeat, now, REPEAT_PERIOD) && !self.is_at_rest();
        if (self.sent.as_ref() != Some(&data) || repeat) && master.send_pdo(self.node, rpdo, &data).is_ok() {
            self.sent = Some(data);
        }
    }

    /// The next command is sent although it is the last one: the drive awaits one each period.
    pub(super) fn send_again(&mut self) {
        self.sent = None;
    }

    /// Quick stop of a drive that is not booted, by the PDO `rpdo` and its `data`. It may still carry out its
    /// last command: after a restart of this module, or a bus failure shorter than the drive's timeout, it receives our
    /// heartbeat again. To be called after every event, and sent before all other frames: a reset of its communication
    /// makes it deaf without stopping it. Repeated until it is booted, because a drive that is not operational ignores
    /// PDOs. The target, 0, is no new one.
    pub(super) fn blind_stop(&mut self, now: Instant, bus_is_up: bool, rpdo: u8, data: &[u8]) -> Option<Frame> {
        if !bus_is_up || self.booted {
            self.deadlines.clear(Timer::BlindStop);
            return None;
        }
        if self.deadlines.is_set(Timer::BlindStop) && !self.deadlines.is_due(Timer::BlindStop, now) {
            return None;
        }
        self.deadlines.set(Timer::BlindStop, now + BLIND_STOP_PERIOD);
        let rpdo = Service::Rpdo { node: self.node, number: rpdo };
        Some(Frame::standard(rpdo.cob_id(), data))
    }

    /// True if the measured values of a drive that was lost, or could not be booted since, are to be read: its
    /// heartbeat is received, and it may turn. Its PDOs are event-driven, and those of a drive that keeps its speed
    /// never come.
    pub(super) fn must_ask_lost(&mut self, now: Instant, heard: bool) -> bool {
        if self.booted || !heard || !matches!(self.why, Absence::Lost(_) | Absence::BootFailed(..)) {
            self.deadlines.clear(Timer::AskLost);
            return false;
        }
        if !self.deadlines.is_set(Timer::AskLost) {
            self.deadlines.set(Timer::AskLost, now);
        }
        self.deadlines.tick(Timer::AskLost, now, READ_AFTER_ORDER) && self.pending == 0
    }

    /// True if nothing is pending: the command took effect, and it is not motion.
    fn is_at_rest(&self) -> bool {
        match self.axis.goal() {
            Goal::Enabled => false,
            Goal::QuickStop | Goal::Disabled => self.axis.is_reached() && self.axis.poll_timeout().is_none(),
        }
    }

    /// Objection of this drive to motion.
    pub(super) fn objection(&self) -> Option<Objection> {
        if !self.booted {
            return Some(Objection::Absent(self.why));
        }
        if self.is_not_answering() {
            return Some(Objection::NotAnswering);
        }
        if let Some(why) = self.trouble {
            return Some(Objection::Trouble(why));
        }
        match self.axis.state() {
            Some(PowerState::Fault | PowerState::FaultReactionActive) => Some(Objection::Fault(self.in_fault())),
            None => Some(Objection::StateUnknown),
            Some(_) => None,
        }
    }

    /// Row of the drive in `LL_DATA_AXES`, without measured values.
    pub(super) fn row(&self, master: &Master, position: f64, velocity: f64) -> lowlevel::Axis {
        lowlevel::Axis {
            name: self.name.into(),
            nmt_state: master.nmt_state(self.node).map_or(-1, |state| state as i8),
            statusword: i32::from(self.axis.statusword()),
            error_code: i32::from(self.error_code),
            position,
            velocity,
            current: self.motor.motor().current_a(),
        }
    }

    /// Row of the drive in `LL_DATA_WHEELS`.
    pub(super) fn wheel_row(&self, steering: f64, speed: f64) -> lowlevel::Wheel {
        let motor = self.motor.motor();
        lowlevel::Wheel {
            name: self.name.into(),
            steering,
            rotation: f64::NAN,
            speed,
            torque: motor.torque_nm(),
            current: motor.current_a(),
            temperature: motor.temperature_c(),
            load: motor.load(),
        }
    }

    /// Its node, and true once if its state is to be read.
    pub(super) fn take_outdated(&mut self) -> (NodeAt, bool) {
        (self.at(), std::mem::take(&mut self.outdated) && self.booted && self.pending == 0)
    }

    /// True if the drive's state changed since the last call.
    pub(super) fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let mut due = self.deadlines;
        // Nothing to repeat, but the period is kept.
        if self.is_at_rest() {
            due.clear(Timer::Repeat);
        }
        let brake = self.brake.as_ref().and_then(Brake::poll_timeout).filter(|_| self.booted);
        earliest([self.axis.poll_timeout(), due.next(), self.mode.poll_timeout(), brake])
    }
}
