//! What both drives have in common: a node that boots, is lost and comes back, an axis that is walked through its
//! states, faults that are told once and reset calmly.

use base::{Duration, Fault, Instant, Severity, Ticker};
use canopen::Master;
use canopen::axis::{Axis, AxisConfig, AxisEvent, Goal, PowerState, StatusBits};
use canopen::master::{BootError, LostReason, Step};
use canopen::wire::Emergency;
use messages::lowlevel;
use module::Actions;

/// A command that must arrive is repeated this often: a frame may be lost where CAN is carried by UDP.
const REPEAT: Duration = Duration::from_millis(50);
/// A fault is reset this often; whether anything moves then is not decided here.
const RESET: Duration = Duration::from_secs(1);
/// An axis that did not obey, or left by itself, stands against motion at least this long.
const TROUBLE: Duration = Duration::from_millis(500);
/// Event-driven PDOs tell changes only: after this long without one the drive is asked what it measures.
const QUIET: Duration = Duration::from_millis(400);
/// What was measured longer ago is not known any more.
const KNOWN: Duration = Duration::from_secs(1);

/// So many questions in a row without an answer, and it counts as deaf.
const UNANSWERED: u8 = 2;
/// Deaf for so long, it is booted anew: what made it so (a foreign SDO, an NMT command) ends with a reset of its communication.
const DEAF: Duration = Duration::from_secs(2);

/// One drive.
pub(super) struct Drive {
    /// `propulsion` or `steering`.
    pub(super) name: &'static str,
    pub(super) node: u8,
    pub(super) axis: Axis,
    booted: bool,
    /// Why it is not booted, for people.
    why: String,
    /// Of the last emergency since it was booted.
    error_code: u16,
    trouble: Option<(Instant, String)>,
    reset: Option<Instant>,
    repeat: Ticker,
    sent: Option<[u8; 6]>,
    changed: bool,
    /// What was seen last may not be so: the drive is to be asked.
    doubt: bool,
    /// When it last told what it measures, and when it is asked.
    measured: Instant,
    ask: Instant,
    /// Questions under way.
    asked: u8,
    /// Questions in a row that it did not answer.
    unanswered: u8,
    /// It was asked again and again and did not answer, whatever its heartbeat says: when it is booted anew.
    deaf: Option<Instant>,
}

impl Drive {
    pub(super) fn new(name: &'static str, node: u8, config: AxisConfig) -> Self {
        Self {
            name,
            node,
            axis: Axis::new(config),
            booted: false,
            why: "is being booted".into(),
            error_code: 0,
            trouble: None,
            reset: None,
            repeat: Ticker::new(Instant::NEVER, REPEAT),
            sent: None,
            changed: true,
            doubt: false,
            measured: Instant::ZERO,
            ask: Instant::NEVER,
            asked: 0,
            unanswered: 0,
            deaf: None,
        }
    }

    pub(super) fn is_booted(&self) -> bool {
        self.booted
    }

    pub(super) fn on_booted(&mut self, now: Instant, out: &mut Actions) {
        self.booted = true;
        self.sent = None;
        self.error_code = 0;
        self.repeat = Ticker::new(now, REPEAT);
        self.ask = now + QUIET;
        self.changed = true;
        // A fault that it had is gone with its reset, or told anew.
        for fault in [Fault::DriveLost, Fault::DriveBootFailed, Fault::DriveMismatch, Fault::DriveFault] {
            out.clear(fault, self.name, format!("{} drive (node {}) is there and set up", self.name, self.node));
        }
    }

    pub(super) fn on_boot_failed(&mut self, step: Step, reason: BootError, out: &mut Actions) {
        let fault = match reason {
            BootError::Mismatch { .. } => Fault::DriveMismatch,
            _ => Fault::DriveBootFailed,
        };
        self.why = format!("cannot be booted: {step}: {reason}");
        let message = format!("{} drive (node {}) {}; tried again each second", self.name, self.node, self.why);
        out.raise(Severity::Error, fault, self.name, message);
    }

    pub(super) fn on_lost(&mut self, reason: LostReason, out: &mut Actions) {
        self.booted = false;
        self.axis.lost();
        (self.trouble, self.reset, self.doubt) = (None, None, false);
        (self.asked, self.unanswered, self.deaf) = (0, 0, None);
        self.why = format!("is lost: {reason}");
        self.changed = true;
        let message = format!("{} drive (node {}) {}; the robot stops", self.name, self.node, self.why);
        out.raise(Severity::Error, Fault::DriveLost, self.name, message);
    }

    pub(super) fn on_emergency(&mut self, emergency: &Emergency, suppressed: u32, out: &mut Actions) {
        self.error_code = emergency.code;
        self.changed = true;
        // The statusword that goes with it may have been lost.
        self.doubt |= emergency.code != 0;
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

    /// Its fault for people. A drive that broke before it was booted has told its emergency to nobody, and the reset
    /// of the boot-up takes its error history.
    fn fault(&self) -> String {
        match self.error_code {
            0 => "in fault since before it was booted".into(),
            code => format!("in fault, error code 0x{code:04X}"),
        }
    }

    /// Where the axis shall be; a drive that is not booted is not asked.
    pub(super) fn set_goal(&mut self, now: Instant, goal: Goal) {
        if self.booted {
            self.axis.set_goal(now, goal);
        }
    }

    pub(super) fn on_statusword(&mut self, now: Instant, statusword: u16, out: &mut Actions) {
        self.axis.handle_statusword(now, statusword);
        self.drain(now, out);
    }

    /// It told what it measures.
    pub(super) fn on_measured(&mut self, now: Instant) {
        self.measured = now;
        self.ask = now + QUIET;
        self.deaf = None;
    }

    /// A question is under way.
    pub(super) fn on_asked(&mut self) {
        self.asked = self.asked.saturating_add(1);
    }

    /// A question has ended, without an answer or with one.
    pub(super) fn on_answer(&mut self, now: Instant, answered: bool, out: &mut Actions) {
        self.asked = self.asked.saturating_sub(1);
        if answered {
            self.unanswered = 0;
            return;
        }
        // One frame that is lost is asked for again.
        self.unanswered = self.unanswered.saturating_add(1);
        self.doubt = true;
        if self.unanswered >= UNANSWERED && self.booted && self.deaf.is_none() {
            self.deaf = Some(now + DEAF);
            let message =
                format!("{} drive (node {}) lives but does not answer; the robot stops", self.name, self.node);
            out.report(Severity::Error, Fault::DriveFault, self.name, message);
        }
    }

    /// Whether it is to be booted anew, as it has been deaf for too long; said again where that did not help.
    pub(super) fn gives_up(&mut self, now: Instant) -> bool {
        let due = self.deaf.is_some_and(|until| until <= now);
        if due {
            self.deaf = Some(now + DEAF);
        }
        due
    }

    /// Whether what it measured is still so, as far as can be known.
    pub(super) fn is_known(&self, now: Instant) -> bool {
        self.booted && now.since(self.measured) < KNOWN
    }

    /// It does not do as it is told: stands against motion until it was seen stopped.
    pub(super) fn distrust(&mut self, now: Instant, why: String) {
        self.trouble = Some((now + TROUBLE, why));
        self.doubt = true;
    }

    fn drain(&mut self, now: Instant, out: &mut Actions) {
        while let Some(event) = self.axis.poll_event() {
            self.changed = true;
            match event {
                AxisEvent::Fault { statusword } => {
                    self.reset = Some(now + RESET);
                    let fault = self.fault();
                    let message =
                        format!("{} drive (node {}) is {fault}; statusword 0x{statusword:04X}", self.name, self.node);
                    out.raise(Severity::Error, Fault::DriveFault, self.name, message);
                }
                AxisEvent::Dropped { to, statusword } => {
                    let why = format!("left by itself to {to}, statusword 0x{statusword:04X}");
                    self.trouble = Some((now + TROUBLE, why));
                }
                AxisEvent::Stuck { state, goal, statusword, controlword, why } => {
                    let state = state.map_or("unseen".into(), |state| state.to_string());
                    let bits = StatusBits(statusword);
                    let why = format!(
                        "stays {state} on the way to {goal}: {why}; controlword 0x{controlword:04X}, statusword 0x{statusword:04X} ({bits})"
                    );
                    out.report(Severity::Error, Fault::DriveFault, self.name, format!("{} drive {why}", self.name));
                    self.distrust(now, why);
                }
                AxisEvent::State { from: Some(PowerState::Fault), .. } => {
                    self.reset = None;
                    out.clear(Fault::DriveFault, self.name, format!("{} drive: fault reset", self.name));
                }
                AxisEvent::State { .. } | AxisEvent::Reached(_) => {}
            }
        }
    }

    /// Serves what is due; to be called after every event, before the frames are made.
    pub(super) fn handle_timeout(&mut self, now: Instant, out: &mut Actions) {
        if let Some((_, why)) = self.trouble.take_if(|(until, _)| *until <= now)
            && !self.axis.is_reached()
        {
            // It was told to stop and does not: that is no passing trouble.
            self.distrust(now, why);
        }
        if self.booted && self.ask <= now {
            self.ask = now + QUIET;
            self.doubt = true;
        }
        if self.reset.is_some_and(|at| at <= now) {
            self.reset = Some(now + RESET);
            self.axis.reset_fault(now);
            self.doubt = true;
        }
        self.axis.handle_timeout(now);
        self.drain(now, out);
    }

    /// Sends its frame when it says something new, or something that has not been seen done.
    pub(super) fn send(&mut self, now: Instant, master: &mut Master, rpdo: u8, data: [u8; 6]) {
        if !self.booted {
            return;
        }
        let repeat = self.repeat.due(now) && !self.is_at_rest();
        if (self.sent != Some(data) || repeat) && master.send_pdo(self.node, rpdo, &data).is_ok() {
            self.sent = Some(data);
        }
    }

    /// Nothing is on its way: what was commanded has been seen, and it is not motion.
    fn is_at_rest(&self) -> bool {
        match self.axis.goal() {
            Goal::Enabled => false,
            Goal::QuickStop | Goal::Disabled => self.axis.is_reached() && self.axis.poll_timeout().is_none(),
        }
    }

    /// What stands against motion from this drive's side.
    pub(super) fn objection(&self) -> Option<String> {
        if !self.booted {
            return Some(format!("the {} drive {}", self.name, self.why));
        }
        if self.deaf.is_some() {
            return Some(format!("the {} drive does not answer", self.name));
        }
        if let Some((_, why)) = &self.trouble {
            return Some(format!("the {} drive {why}", self.name));
        }
        match self.axis.state() {
            Some(PowerState::Fault | PowerState::FaultReactionActive) => {
                Some(format!("the {} drive is {}", self.name, self.fault()))
            }
            None => Some(format!("the {} drive has not told its state", self.name)),
            Some(_) => None,
        }
    }

    /// Its row in `LL_DATA_AXES`, but for what it measures.
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

    /// Its node, and whether it is to be asked for its state; once.
    pub(super) fn take_doubt(&mut self) -> (u8, bool) {
        (self.node, std::mem::take(&mut self.doubt) && self.booted && self.asked == 0)
    }

    /// Whether something of its state changed since the last call.
    pub(super) fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let repeat = (self.booted && !self.is_at_rest()).then(|| self.repeat.next());
        let trouble = self.trouble.as_ref().map(|(until, _)| *until);
        let ask = self.booted.then_some(self.ask);
        [self.axis.poll_timeout(), self.reset, self.deaf, repeat, trouble, ask].into_iter().flatten().min()
    }
}
