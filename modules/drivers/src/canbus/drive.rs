//! Common part of both drives: booting, loss and return of the node, the axis state machine, and faults, which are
//! reported once and reset with pauses.

use base::can::Frame;
use base::{Deadlines, Duration, Fault, Instant, Severity, earliest};
use canopen::Master;
use canopen::axis::{Axis, AxisConfig, AxisEvent, Goal, PowerState, StatusBits, Why};
use canopen::drives::cia402;
use canopen::master::{BootError, LostReason, Step};
use canopen::wire::{Emergency, Service};
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
}

/// Objection of a drive to motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Objection {
    Absent(Absence),
    /// The drive does not answer requests.
    NotAnswering,
    Trouble(Trouble),
    /// The drive is in fault, with the error code of its emergency; 0 if none was received.
    Fault(u16),
    /// The drive's state was not received yet.
    StateUnknown,
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
            Self::Trouble(Trouble::Stuck { .. }) => Hold::DriveStuck,
            Self::Trouble(Trouble::NoTarget) => Hold::DriveNoTarget,
            Self::Fault(_) => Hold::DriveFault,
            Self::StateUnknown => Hold::DriveUnseen,
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
            Self::Fault(code) => write!(f, "is {}", InFault(*code)),
            Self::StateUnknown => f.write_str("has not told its state"),
        }
    }
}

impl fmt::Display for Absence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Booting => f.write_str("is being booted"),
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
                    Some(state) => write!(f, "stays {state}")?,
                    None => f.write_str("stays unseen")?,
                }
                write!(f, " on the way to {goal}: {why}; controlword 0x{controlword:04X}")?;
                write!(f, ", statusword 0x{statusword:04X} ({})", StatusBits(statusword))
            }
            Self::NoTarget => f.write_str("does not take its target"),
        }
    }
}

/// Displays a fault with its error code. The emergency of a drive that failed before it was booted was lost, and the
/// reset at boot-up clears its error history.
struct InFault(u16);

impl fmt::Display for InFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => f.write_str("in fault since before it was booted"),
            code => write!(f, "in fault, error code 0x{code:04X}"),
        }
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
        /// A quick stop is sent without knowing the drive's state. Set while it is not booted and the bus is up.
        BlindStop,
    }
}

/// State of one drive.
pub(super) struct Drive {
    /// `propulsion` or `steering`.
    pub(super) name: &'static str,
    pub(super) node: u8,
    pub(super) axis: Axis,
    booted: bool,
    /// Reason why it is not booted.
    why: Absence,
    /// Error code of the last emergency since it was booted.
    error_code: u16,
    trouble: Option<Trouble>,
    deadlines: Deadlines<Timer>,
    sent: Option<[u8; 6]>,
    changed: bool,
    /// The last known state may be outdated: the drive is to be read.
    outdated: bool,
    /// Its speed should be changing.
    changing: bool,
    /// Faults are not reset: the robot may still roll.
    holds_fault: bool,
    /// Time of its last measured value.
    measured: Instant,
    /// Number of pending requests.
    pending: u8,
    /// Number of consecutive requests without an answer.
    unanswered: u8,
}

impl Drive {
    pub(super) fn new(name: &'static str, node: u8, config: AxisConfig) -> Self {
        Self {
            name,
            node,
            axis: Axis::new(config),
            booted: false,
            why: Absence::Booting,
            error_code: 0,
            trouble: None,
            deadlines: Deadlines::new(),
            sent: None,
            changed: true,
            outdated: false,
            changing: false,
            holds_fault: false,
            measured: Instant::ZERO,
            pending: 0,
            unanswered: 0,
        }
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
        for fault in [Fault::DriveLost, Fault::DriveBootFailed, Fault::DriveMismatch, Fault::DriveFault] {
            out.clear(fault, self.name, format!("{} drive (node {}) is booted and configured", self.name, self.node));
        }
    }

    pub(super) fn on_boot_failed(&mut self, step: Step, reason: BootError, out: &mut Actions) {
        let fault = match reason {
            BootError::Mismatch { .. } => Fault::DriveMismatch,
            _ => Fault::DriveBootFailed,
        };
        self.why = Absence::BootFailed(step, reason);
        let message = format!("{} drive (node {}) {}; retried each second", self.name, self.node, self.why);
        out.raise(Severity::Error, fault, self.name, message);
    }

    pub(super) fn on_lost(&mut self, reason: LostReason, out: &mut Actions) {
        self.booted = false;
        self.axis.lost();
        self.deadlines.clear_all();
        (self.trouble, self.outdated) = (None, false);
        (self.pending, self.unanswered) = (0, 0);
        self.why = Absence::Lost(reason);
        self.changed = true;
        let message = format!("{} drive (node {}) {}; the robot stops", self.name, self.node, self.why);
        out.raise(Severity::Error, Fault::DriveLost, self.name, message);
    }

    pub(super) fn on_emergency(&mut self, emergency: &Emergency, suppressed: u32, out: &mut Actions) {
        self.error_code = emergency.code;
        self.changed = true;
        // The accompanying statusword may have been lost.
        self.outdated |= emergency.code != 0;
        let severity = if emergency.code == 0 { Severity::Notice } else { Severity::Error };
        let more = if suppressed > 0 { format!(", {suppressed} more before it") } else { String::new() };
        let message = format!(
            "{} drive (node {}): emergency 0x{:04X} ({}), register 0x{:02X}{more}",
            self.name,
            self.node,
            emergency.code,
            emergency.class(),
            emergency.register
        );
        out.report(severity, Fault::DriveEmergency, self.name, message);
    }

    /// Sets the goal of the axis; ignored while the drive is not booted.
    pub(super) fn set_goal(&mut self, now: Instant, goal: Goal) {
        if self.booted {
            self.axis.set_goal(now, goal);
        }
    }

    pub(super) fn on_statusword(&mut self, now: Instant, statusword: u16, out: &mut Actions) {
        self.axis.handle_statusword(now, statusword);
        self.drain(now, out);
    }

    /// A measured value was received.
    pub(super) fn on_measured(&mut self, now: Instant) {
        self.measured = now;
        if self.booted {
            self.deadlines.set(Timer::Ask, now + self.read_after());
        }
        self.deadlines.clear(Timer::NotAnswering);
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

    /// A request has ended, with or without an answer.
    pub(super) fn on_answer(&mut self, now: Instant, answered: bool, out: &mut Actions) {
        self.pending = self.pending.saturating_sub(1);
        if answered {
            self.unanswered = 0;
            return;
        }
        // A single lost frame is requested again.
        self.unanswered = self.unanswered.saturating_add(1);
        self.outdated = true;
        if self.unanswered >= UNANSWERED_MAX && self.booted && !self.is_not_answering() {
            self.deadlines.set(Timer::NotAnswering, now + UNANSWERED_TIMEOUT);
            let message = format!(
                "{} drive (node {}) sends heartbeats but does not answer; the robot stops",
                self.name, self.node
            );
            out.report(Severity::Error, Fault::DriveFault, self.name, message);
        }
    }

    /// True if the drive is to be booted again because it has not answered for too long; repeated if that does not
    /// help.
    pub(super) fn must_reboot(&mut self, now: Instant) -> bool {
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

    /// True if its measured values are recent, as far as can be known.
    pub(super) fn is_known(&self, now: Instant) -> bool {
        self.booted && now.since(self.measured) < MEASURED_AGE_MAX
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
                AxisEvent::Fault { statusword } => {
                    self.deadlines.set(Timer::Reset, now + FAULT_RESET_PERIOD);
                    let fault = InFault(self.error_code);
                    let message =
                        format!("{} drive (node {}) is {fault}; statusword 0x{statusword:04X}", self.name, self.node);
                    out.raise(Severity::Error, Fault::DriveFault, self.name, message);
                }
                AxisEvent::Dropped { to, statusword } => {
                    self.set_trouble(now, Trouble::Dropped { to, statusword });
                }
                AxisEvent::Stuck { state, goal, statusword, controlword, why } => {
                    let why = Trouble::Stuck { state, goal, statusword, controlword, why };
                    out.report(Severity::Error, Fault::DriveFault, self.name, format!("{} drive {why}", self.name));
                    self.block_until_stopped(now, why);
                }
                AxisEvent::State { from: Some(PowerState::Fault), .. } => {
                    self.deadlines.clear(Timer::Reset);
                    out.clear(Fault::DriveFault, self.name, format!("{} drive: fault reset", self.name));
                }
                AxisEvent::State { .. } | AxisEvent::Reached(_) => {}
            }
        }
    }

    /// Serves the deadlines; called after every event, before frames are generated.
    pub(super) fn handle_timeout(&mut self, now: Instant, out: &mut Actions) {
        if self.deadlines.take(Timer::Trouble, now)
            && let Some(why) = self.trouble.take()
            && !self.axis.is_reached()
        {
            // The drive does not obey a stop: not a temporary problem.
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
        self.axis.handle_timeout(now);
        self.drain(now, out);
    }

    /// Sends the command frame if it differs from the last one, or has not taken effect.
    pub(super) fn send(&mut self, now: Instant, master: &mut Master, rpdo: u8, data: [u8; 6]) {
        if !self.booted {
            return;
        }
        let repeat = self.deadlines.tick(Timer::Repeat, now, REPEAT_PERIOD) && !self.is_at_rest();
        if (self.sent != Some(data) || repeat) && master.send_pdo(self.node, rpdo, &data).is_ok() {
            self.sent = Some(data);
        }
    }

    /// Quick stop of a drive that is not booted, by the PDO `rpdo` and its `controlword`. It may still carry out its
    /// last command: after a restart of this module, or a bus failure shorter than the drive's timeout, it receives our
    /// heartbeat again. To be called after every event, and sent before all other frames: a reset of its communication
    /// makes it deaf without stopping it. Repeated until it is booted, because a drive that is not operational ignores
    /// PDOs. The target, 0, is no new one.
    pub(super) fn blind_stop(&mut self, now: Instant, bus_is_up: bool, rpdo: u8, controlword: u16) -> Option<Frame> {
        if !bus_is_up || self.booted {
            self.deadlines.clear(Timer::BlindStop);
            return None;
        }
        if self.deadlines.is_set(Timer::BlindStop) && !self.deadlines.is_due(Timer::BlindStop, now) {
            return None;
        }
        self.deadlines.set(Timer::BlindStop, now + BLIND_STOP_PERIOD);
        let rpdo = Service::Rpdo { node: self.node, number: rpdo };
        Some(Frame::standard(rpdo.cob_id(), &cia402::pack(controlword, 0)))
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
            Some(PowerState::Fault | PowerState::FaultReactionActive) => Some(Objection::Fault(self.error_code)),
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
            current: f64::NAN,
        }
    }

    /// Node id, and true once if its state is to be read.
    pub(super) fn take_outdated(&mut self) -> (u8, bool) {
        (self.node, std::mem::take(&mut self.outdated) && self.booted && self.pending == 0)
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
        earliest([self.axis.poll_timeout(), due.next()])
    }
}
