//! The bus itself: its load, what its controller says, and what stands against motion from its side.

use base::can::{BusState, Frame, Health, INTERMISSION, Notice, frame_bits};
use base::{Deadlines, Duration, Fault, Instant, Severity};
use canopen::Master;
use canopen::master::State;
use messages::Hold;
use messages::lowlevel::{DataBus, Node};
use module::Actions;

/// `LL_DATA_BUS` is sent, and what was counted is judged, this often.
const PERIOD: Duration = Duration::from_secs(1);
/// So many frames with errors within a period are told of: a good bus has none.
const ERRORS_MAX: u32 = 10;
/// A frame that nobody acknowledged stands against motion this long: while it lasts it is repeated at once.
const UNACKNOWLEDGED: Duration = Duration::from_millis(500);

base::deadlines! {
    /// What the bus waits for.
    enum Timer {
        /// `LL_DATA_BUS` is published. Set from the start on.
        Statistics,
        /// A frame without acknowledgement no longer stands against motion. Set while it does.
        Unacknowledged,
    }
}

/// One CAN bus, as its driver sees it.
pub(super) struct Bus {
    name: String,
    bitrate: u32,
    up: bool,
    health: Health,
    frames: i64,
    errors: i64,
    /// Since the last period's end: bits on the wire, frames with errors.
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

    /// A frame crossed the wire, from us or to us.
    pub(super) fn crossed(&mut self, frame: &Frame) {
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
        // What is down is neither passive nor alone.
        self.deadlines.clear(Timer::Unacknowledged);
        self.clear_passive(out);
        self.clear_unacknowledged(out);
    }

    /// What the controller tells.
    pub(super) fn on_notice(&mut self, now: Instant, notice: Notice, out: &mut Actions) {
        match notice {
            Notice::Health(health) => self.on_health(health, out),
            Notice::Errors(count) => {
                self.errors = self.errors.saturating_add(i64::from(count));
                self.recent_errors = self.recent_errors.saturating_add(count);
            }
            // The host has told it already.
            Notice::Lost(count) => self.errors = self.errors.saturating_add(i64::from(count)),
            Notice::NoAcknowledge => {
                self.errors = self.errors.saturating_add(1);
                self.deadlines.set(Timer::Unacknowledged, now + UNACKNOWLEDGED);
                let name = self.name.as_str();
                let message = format!("nobody on {name} acknowledges what is sent: the cable, its ends, the bit rate?");
                out.raise(Severity::Error, Fault::CanUnacknowledged, name, message);
            }
        }
    }

    fn on_health(&mut self, health: Health, out: &mut Actions) {
        self.health = health;
        match health.state {
            BusState::Active | BusState::Warning => return self.clear_passive(out),
            BusState::Passive => {}
            // The port says so at once.
            BusState::Off => return,
        }
        let Health { transmit_errors, receive_errors, .. } = health;
        let name = self.name.as_str();
        let message = format!(
            "the controller of {name} is error-passive: transmit errors {transmit_errors}, receive errors {receive_errors}"
        );
        out.raise(Severity::Warning, Fault::CanPassive, name, message);
    }

    fn clear_passive(&self, out: &mut Actions) {
        let name = self.name.as_str();
        out.clear(Fault::CanPassive, name, format!("the controller of {name} is error-active"));
    }

    fn clear_unacknowledged(&self, out: &mut Actions) {
        let name = self.name.as_str();
        out.clear(Fault::CanUnacknowledged, name, format!("what is sent on {name} is acknowledged"));
    }

    /// What stands against motion from the bus's side.
    pub(super) fn objection(&self) -> Option<Hold> {
        match (self.up, self.deadlines.get(Timer::Unacknowledged)) {
            (false, _) => Some(Hold::BusDown),
            (true, Some(_)) => Some(Hold::BusUnacknowledged),
            (true, None) => None,
        }
    }

    /// Serves what is due; true when it is time for [`Self::message`].
    pub(super) fn handle_timeout(&mut self, now: Instant, out: &mut Actions) -> bool {
        if self.deadlines.take(Timer::Unacknowledged, now) {
            self.clear_unacknowledged(out);
        }
        let due = self.deadlines.tick(Timer::Statistics, now, PERIOD);
        if due {
            self.judge(out);
        }
        due
    }

    fn judge(&mut self, out: &mut Actions) {
        let name = self.name.as_str();
        match std::mem::take(&mut self.recent_errors) {
            0 => out.clear(Fault::CanErrors, name, format!("the wire of {name} is clean")),
            count if count >= ERRORS_MAX => {
                let message =
                    format!("{count} frames with errors within a second on {name}: the cable, its ends, noise?");
                out.raise(Severity::Warning, Fault::CanErrors, name, message);
            }
            _ => {}
        }
    }

    /// `LL_DATA_BUS`, but for its nodes; begins a new period.
    pub(super) fn message(&mut self, timestamp: i64) -> DataBus {
        let wire = f64::from(self.bitrate.max(1)) * PERIOD.as_secs_f64();
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

/// A node's row in `LL_DATA_BUS`: its SDO transfers, as these alone are asked and answered.
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
        // CAN's own CRC leaves none to be seen here.
        crc_errors: 0,
        round_trip_min: seconds(recent.min),
        round_trip_mean: seconds(recent.mean()),
        round_trip_max: seconds(recent.max),
    }
}
