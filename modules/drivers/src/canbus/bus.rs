//! State of the bus: its load, its controller's reports, and its objections to motion.

use base::can::{BusState, Frame, Health, INTERMISSION, Notice, frame_bits};
use base::{Deadlines, Duration, Fault, Instant, Severity};
use canopen::Master;
use canopen::master::State;
use messages::Hold;
use messages::lowlevel::{DataBus, Node};
use module::Actions;

/// Period of `LL_DATA_BUS` and of evaluating the error counts.
const STATISTICS_PERIOD: Duration = Duration::from_secs(1);
/// Number of frames with errors within a period that is reported: a good bus has none.
const ERRORS_MAX: u32 = 10;
/// Time for which a missing acknowledgement blocks motion: while the cause lasts the frame is repeated at once.
const UNACKNOWLEDGED_TIMEOUT: Duration = Duration::from_millis(500);

base::deadlines! {
    /// Deadlines of the bus.
    enum Timer {
        /// `LL_DATA_BUS` is published. Set from the start on.
        Statistics,
        /// A missing acknowledgement no longer blocks motion. Set while it does.
        Unacknowledged,
        /// Another master on the bus has been silent for long enough. Set while it blocks motion.
        SecondMaster,
    }
}

/// A CAN bus as seen by its driver.
pub(super) struct Bus {
    name: String,
    bitrate: u32,
    up: bool,
    health: Health,
    frames: i64,
    errors: i64,
    /// Since the end of the last period: bits on the wire, frames with errors.
    bits: u64,
    recent_errors: u32,
    deadlines: Deadlines<Timer>,
}

impl Bus {
    pub(super) fn new(name: &str, bitrate: u32) -> Self {
        Self {
            name: name.into(),
            bitrate,
            up: false,
            health: Health::default(),
            frames: 0,
            errors: 0,
            bits: 0,
            recent_errors: 0,
            deadlines: Deadlines::new(),
        }
    }

    pub(super) fn start(&mut self, now: Instant) {
        self.deadlines.set(Timer::Statistics, now);
    }

    pub(super) fn is_up(&self) -> bool {
        self.up
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// True unless another master has been seen recently.
    pub(super) fn is_alone(&self) -> bool {
        !self.deadlines.is_set(Timer::SecondMaster)
    }

    /// Another master blocks motion until then.
    pub(super) fn set_second_master(&mut self, until: Instant) {
        self.deadlines.set(Timer::SecondMaster, until);
    }

    /// Ends the block by another master that has been silent for long enough.
    pub(super) fn expire_second_master(&mut self, now: Instant, out: &mut Actions) {
        if self.deadlines.take(Timer::SecondMaster, now) {
            let name = self.name.as_str();
            out.clear(Fault::SecondMaster, name, format!("no other master on {name}"));
        }
    }

    /// Counts a frame on the wire, sent or received.
    pub(super) fn count_frame(&mut self, frame: &Frame) {
        self.frames = self.frames.saturating_add(1);
        self.bits += u64::from(frame_bits(frame) + INTERMISSION);
    }

    pub(super) fn on_port(&mut self, down: Option<&str>, out: &mut Actions) {
        let name = self.name.as_str();
        self.up = down.is_none();
        self.health = Health::default();
        match down {
            Some(why) => {
                out.raise(Severity::Error, Fault::PortDown, name, format!("{name} is down: {why}; tried again"));
            }
            None => out.clear(Fault::PortDown, name, format!("{name} is up")),
        }
        // A bus that is down is neither error-passive nor without acknowledgement.
        self.deadlines.clear(Timer::Unacknowledged);
        self.clear_passive(out);
        self.clear_unacknowledged(out);
    }

    /// Processes a notice of the controller.
    pub(super) fn on_notice(&mut self, now: Instant, notice: Notice, out: &mut Actions) {
        match notice {
            Notice::Health(health) => self.on_health(health, out),
            Notice::Errors(count) => {
                self.errors = self.errors.saturating_add(i64::from(count));
                self.recent_errors = self.recent_errors.saturating_add(count);
            }
            // Already reported by the host.
            Notice::Lost(count) => self.errors = self.errors.saturating_add(i64::from(count)),
            Notice::NoAcknowledge => {
                self.errors = self.errors.saturating_add(1);
                self.deadlines.set(Timer::Unacknowledged, now + UNACKNOWLEDGED_TIMEOUT);
                let name = self.name.as_str();
                let message =
                    format!("nobody on {name} acknowledges what is sent: check cable, termination and bit rate");
                out.raise(Severity::Error, Fault::CanUnacknowledged, name, message);
            }
        }
    }

    fn on_health(&mut self, health: Health, out: &mut Actions) {
        self.health = health;
        match health.state {
            BusState::Active | BusState::Warning => return self.clear_passive(out),
            BusState::Passive => {}
            // The port reports it at once.
            BusState::Off => return,
        }
        let Health { transmit_errors, receive_errors, .. } = health;
        let name = self.name.as_str();
        let message = format!(
            "the controller of {name} is error-passive: transmit errors {transmit_errors}, receive errors \
             {receive_errors}"
        );
        out.raise(Severity::Warning, Fault::CanPassive, name, message);
    }

    fn clear_passive(&self, out: &mut Actions) {
        let name = self.name.as_str();
        out.clear(Fault::CanPassive, name, format!("the controller of {name} is error-active"));
    }

    fn clear_unacknowledged(&self, out: &mut Actions) {
        let name = self.name.as_str();
        out.clear(Fault::CanUnacknowledged, name, format!("frames on {name} are acknowledged"));
    }

    /// Objection of the bus to motion.
    pub(super) fn objection(&self) -> Option<Hold> {
        match (self.up, self.deadlines.get(Timer::Unacknowledged)) {
            (false, _) => Some(Hold::BusDown),
            (true, Some(_)) => Some(Hold::BusUnacknowledged),
            (true, None) => None,
        }
    }

    /// Serves the deadlines; true if [`Self::message`] is due.
    pub(super) fn handle_timeout(&mut self, now: Instant, out: &mut Actions) -> bool {
        if self.deadlines.take(Timer::Unacknowledged, now) {
            self.clear_unacknowledged(out);
        }
        let due = self.deadlines.tick(Timer::Statistics, now, STATISTICS_PERIOD);
        if due {
            self.report_errors(out);
        }
        due
    }

    fn report_errors(&mut self, out: &mut Actions) {
        let name = self.name.as_str();
        match std::mem::take(&mut self.recent_errors) {
            0 => out.clear(Fault::CanErrors, name, format!("the wire of {name} is clean")),
            count if count >= ERRORS_MAX => {
                let message =
                    format!("{count} frames with errors within a second on {name}: check cable, termination and noise");
                out.raise(Severity::Warning, Fault::CanErrors, name, message);
            }
            _ => {}
        }
    }

    /// `LL_DATA_BUS` without its nodes; starts a new period.
    pub(super) fn message(&mut self, timestamp: i64) -> DataBus {
        let wire = f64::from(self.bitrate.max(1)) * STATISTICS_PERIOD.as_secs_f64();
        let state = match (self.up, self.health.state) {
            (false, _) => DataBus::CLOSED,
            (true, BusState::Active) => DataBus::ACTIVE,
            (true, BusState::Warning) => DataBus::WARNING,
            (true, BusState::Passive) => DataBus::PASSIVE,
            (true, BusState::Off) => DataBus::OFF,
        };
        DataBus {
            timestamp,
            bus: self.name.clone(),
            load: (std::mem::take(&mut self.bits) as f64 / wire).min(1.0),
            frames: self.frames,
            errors: self.errors,
            state,
            nodes: Vec::new(),
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.deadlines.next()
    }
}

/// Row of a node in `LL_DATA_BUS`: its SDO transfers, the only requests with answers.
pub(super) fn node(name: &str, id: u8, master: &mut Master) -> Node {
    let stats = master.stats(id).copied().unwrap_or_default();
    let recent = master.take_round_trips(id);
    let seconds = |time: Duration| if recent.count == 0 { f64::NAN } else { time.as_secs_f64() };
    let state = match (master.state(id), master.nmt_state(id)) {
        (Some(State::Operational), _) => Node::OK,
        (_, Some(_)) => Node::DEGRADED,
        (_, None) => Node::LOST,
    };
    Node {
        name: name.into(),
        address: i32::from(id),
        state,
        requests: stats.requests.into(),
        retries: stats.retries.into(),
        timeouts: stats.timeouts.into(),
        // Never detectable here: CAN controllers drop frames with CRC errors.
        crc_errors: 0,
        round_trip_min: seconds(recent.min),
        round_trip_mean: seconds(recent.mean()),
        round_trip_max: seconds(recent.max),
    }
}
