//! The engine: the life of a lidar, the same for every protocol.
//!
//! ```text
//!     first handle_timeout           first sector               lost
//!     New -----------------> Starting -----------> Running ----------------+
//!                             ^    | no answer, refused                      |
//!                             |    +----------------> Resting <--------------+
//!                             +------- REST ------------+
//! ```

use crate::event::{Counters, Event, Fault, FieldResult, Health, LostReason, State, Text, Zone};
use crate::scan::{Sector, Sectors, Status, wrap};
use base::{Disturbance, Duration, Instant, Queue, earliest};
use heapless::Vec;

/// A device without new measurements for this time is lost.
pub const SILENT_AFTER: Duration = Duration::from_millis(400);
/// Pause between a loss and the next start-up.
pub const REST: Duration = Duration::from_millis(200);
/// Time over which arrivals are judged.
const WINDOW: Duration = Duration::from_millis(500);
/// Least part of the field of view that must arrive.
const COVERED_MIN: f64 = 0.7;
/// Items that wait to be drained, sectors included.
const ITEMS: usize = 64;

/// What is sent at once: a request.
pub type Bytes = Vec<u8, 80>;

/// What a protocol made of an input or a deadline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Nothing that changes the life.
    Pending,
    /// The start-up failed, or the device is lost.
    Lost(LostReason),
}

#[derive(Clone, Copy, Debug)]
enum Item {
    Identity,
    Health(Health),
    Sector,
    Zone { zone: Zone, result: FieldResult },
    Fault { fault: Fault, active: bool },
    Lost(LostReason),
    Recovered(Duration),
}

/// Figures of the device that every sector repeats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// Shortest range, m.
    pub range_min_m: f32,
    /// Longest range, m.
    pub range_max_m: f32,
    /// Field of view, rad.
    pub view_rad: f64,
    /// Least revolutions per second in which the device works.
    pub rate_min_hz: f64,
}

/// What a protocol works with, beside its own state.
#[derive(Debug)]
pub struct Shared {
    tx: Queue<Bytes, 8>,
    sectors: Sectors,
    items: Queue<Item, ITEMS>,
    identity: Text,
    health: Option<Health>,
    /// What the last health means; and the error that it measures with: its code, and what that means.
    meaning: Text,
    error: Option<(u32, Text)>,
    faults: [bool; Fault::ALL.len()],
    pub(crate) optics: Optics,
    counters: Counters,
    /// Instant of the input that is handled.
    now: Instant,
    /// When the last bytes arrived, and the last valid message.
    arrived: Option<Instant>,
    valid: Option<Instant>,
    /// Sectors since the last check.
    measured: u32,
    covered_rad: f64,
    /// It measures: what is rejected disturbs its line.
    runs: bool,
    line: Disturbance,
}

impl Shared {
    fn new(optics: Optics) -> Self {
        Self {
            tx: Queue::new(),
            sectors: Sectors::new(),
            items: Queue::new(),
            identity: Text::new(),
            health: None,
            meaning: Text::new(),
            error: None,
            faults: [false; Fault::ALL.len()],
            optics,
            counters: Counters::default(),
            now: Instant::ZERO,
            arrived: None,
            valid: None,
            measured: 0,
            covered_rad: 0.0,
            runs: false,
            line: Disturbance::default(),
        }
    }

    /// Sends a request; one that has no room is left out, as if it were lost on the wire.
    pub(crate) fn send(&mut self, bytes: &[u8]) {
        let mut request = Bytes::new();
        if request.extend_from_slice(bytes).is_ok() {
            self.tx.push(request);
        }
    }

    /// Counts a valid message.
    pub(crate) fn accept(&mut self) {
        self.valid = Some(self.now);
        self.counters.messages = self.counters.messages.saturating_add(1);
    }

    /// Counts input that the protocol does not allow.
    pub(crate) fn reject(&mut self) {
        // In a start-up what is left of the time before it is rejected, too; it may only keep a disturbed line so.
        self.count_rejected(self.runs || self.is_active(Fault::Noise));
    }

    fn count_rejected(&mut self, disturbs: bool) {
        self.counters.rejected = self.counters.rejected.saturating_add(1);
        if disturbs && self.line.damaged(self.now) {
            self.fault(Fault::Noise, true);
        }
    }

    /// Notes that something valid arrived, which is not counted.
    pub(crate) fn arrived_valid(&mut self) {
        self.valid = Some(self.now);
    }

    /// Counts a valid message without new measurements: the device repeats itself, or its motor stands.
    pub(crate) fn stale(&mut self) {
        self.valid = Some(self.now);
        self.count_rejected(self.runs);
    }

    pub(crate) fn identify(&mut self, identity: Text) {
        self.identity = identity;
        self.items.push(Item::Identity);
    }

    pub(crate) fn health(&mut self, health: Health) {
        self.health_of(health, Text::new());
    }

    /// The same with what its code means.
    pub(crate) fn health_of(&mut self, health: Health, meaning: Text) {
        if self.health.replace(health) != Some(health) {
            self.meaning = meaning;
            self.items.push(Item::Health(health));
        }
    }

    /// Sets the fault that the device reports an error and measures, by its code and what that means; `None` clears it.
    pub(crate) fn error(&mut self, error: Option<(u32, Text)>) {
        self.error = error;
        self.fault(Fault::Device, self.error.is_some());
    }

    pub(crate) fn zone(&mut self, zone: Zone, result: FieldResult) {
        self.items.push(Item::Zone { zone, result });
    }

    /// Sets or clears a fault; reported on change.
    pub(crate) fn fault(&mut self, fault: Fault, active: bool) {
        let known = &mut self.faults[fault as usize];
        if *known != active {
            *known = active;
            self.items.push(Item::Fault { fault, active });
        }
    }

    fn is_active(&self, fault: Fault) -> bool {
        self.faults[fault as usize]
    }

    fn status(&self) -> Status {
        if self.is_active(Fault::Device) || self.is_active(Fault::Noise) {
            Status::Fault
        } else if self.is_active(Fault::Blocked) {
            Status::Blocked
        } else if self.is_active(Fault::Slow) {
            Status::Slow
        } else {
            Status::Ok
        }
    }

    /// Adds a sector that `fill` completes: ranges, intensities, direction, times. One without room is counted.
    pub(crate) fn sector(&mut self, revolution: u64, fill: impl FnOnce(&mut Sector)) {
        let (status, optics) = (self.status(), self.optics);
        self.measured = self.measured.saturating_add(1);
        // Room is left for what else happens.
        let slot = if self.items.len() < ITEMS / 2 { self.sectors.push() } else { None };
        let Some(sector) = slot else {
            self.counters.dropped = self.counters.dropped.saturating_add(1);
            return;
        };
        fill(sector);
        sector.angle_min_rad = wrap(sector.angle_min_rad);
        (sector.revolution, sector.status) = (revolution, status);
        (sector.range_min_m, sector.range_max_m) = (optics.range_min_m, optics.range_max_m);
        self.covered_rad += sector.angle_step_rad.abs() * sector.ranges_m.len() as f64;
        self.items.push(Item::Sector);
    }
}

/// A protocol: what is sent, and what answers mean. Implemented in this crate only.
pub trait Protocol {
    /// Begins the start-up, from whatever state.
    fn start(&mut self, now: Instant, shared: &mut Shared);
    /// Takes bytes that arrived at `now`.
    fn handle_rx(&mut self, now: Instant, bytes: &[u8], shared: &mut Shared) -> Progress;
    /// Serves deadlines.
    fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) -> Progress;
    /// Next deadline.
    fn poll_timeout(&self) -> Option<Instant>;
    /// Figures of the device, before it was asked.
    fn optics(&self) -> Optics;
    /// What the device said last, and recently, of a field or an output of its own.
    fn result(&self, zone: Zone) -> FieldResult {
        let _ = zone;
        FieldResult::Unknown
    }
}

#[derive(Clone, Copy, Debug)]
enum Life {
    New,
    Starting { until: Instant },
    Resting { until: Instant },
    Running { until: Instant, window: Instant },
}

/// Time limit of a start-up until its first sector, the spin-up of the motor included.
const START_WITHIN: Duration = Duration::from_secs(4);

/// A lidar. Reads no clock and owns no port: feed it bytes and time, and after any call drain [`Lidar::poll_tx`], then
/// [`Lidar::poll_event`], then arm one timer for [`Lidar::poll_timeout`].
#[derive(Debug)]
pub struct Lidar<P> {
    protocol: P,
    shared: Shared,
    life: Life,
    /// When the loss that was not yet ended was reported; `None` before the first start.
    lost: Option<(Instant, LostReason)>,
}

impl<P: Protocol> Lidar<P> {
    pub(crate) fn with(protocol: P) -> Self {
        let shared = Shared::new(protocol.optics());
        Self { protocol, shared, life: Life::New, lost: None }
    }

    /// Progress.
    #[must_use]
    pub fn state(&self) -> State {
        match self.life {
            Life::New | Life::Starting { .. } => State::Starting,
            Life::Resting { .. } => State::Resting,
            Life::Running { .. } => State::Running,
        }
    }

    /// True while this fault is active.
    #[must_use]
    pub fn is_active(&self, fault: Fault) -> bool {
        self.shared.is_active(fault)
    }

    /// What the device says of a field or an output of its own, as of the last call: unknown unless it measures without
    /// a fault that marks its sectors, and has said so within the time limit of its protocol.
    #[must_use]
    pub fn result(&self, zone: Zone) -> FieldResult {
        let measures = matches!(self.life, Life::Running { .. }) && self.shared.status() == Status::Ok;
        if measures { self.protocol.result(zone) } else { FieldResult::Unknown }
    }

    /// What the code of the last [`Health`] means, in words; empty: only the device's manual says it.
    #[must_use]
    pub fn meaning(&self) -> &Text {
        &self.shared.meaning
    }

    /// Code of the error that the device reports while it measures, and what it means, in words; empty: only the
    /// device's manual says it.
    #[must_use]
    pub fn error(&self) -> Option<(u32, &Text)> {
        self.shared.error.as_ref().map(|(code, meaning)| (*code, meaning))
    }

    /// Counters.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.shared.counters
    }

    /// Takes bytes that arrived at `now`.
    pub fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        if bytes.is_empty() {
            return;
        }
        (self.shared.now, self.shared.arrived) = (now, Some(now));
        if matches!(self.life, Life::Starting { .. } | Life::Running { .. }) {
            let progress = self.protocol.handle_rx(now, bytes, &mut self.shared);
            self.apply(now, progress);
            self.measured(now);
        }
    }

    /// The connection was closed, or the port has gone: the device is lost at once. What the host opens afterwards is
    /// used by the next start-up.
    pub fn handle_closed(&mut self, now: Instant) {
        if matches!(self.life, Life::Starting { .. } | Life::Running { .. }) {
            while self.shared.tx.pop().is_some() {}
            self.lose(now, LostReason::Closed);
        }
    }

    /// Serves deadlines; late and needless calls do no harm. The first call starts the engine.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.shared.now = now;
        match self.life {
            Life::New => self.start(now),
            Life::Resting { until } if until <= now => self.start(now),
            Life::Starting { until } if until <= now => self.lose(now, self.reason(now)),
            Life::Running { until, .. } if until <= now => self.lose(now, self.reason(now)),
            _ => {}
        }
        if matches!(self.life, Life::Starting { .. } | Life::Running { .. }) {
            let progress = self.protocol.handle_timeout(now, &mut self.shared);
            self.apply(now, progress);
            self.measured(now);
        }
        self.judge(now);
        let disturbed = self.shared.line.is_disturbed(now);
        self.shared.fault(Fault::Noise, disturbed);
    }

    /// Next output, to be sent in order.
    pub fn poll_tx(&mut self) -> Option<Bytes> {
        self.shared.tx.pop()
    }

    /// The next thing that happened.
    pub fn poll_event(&mut self) -> Option<Event<'_>> {
        Some(match self.shared.items.pop()? {
            Item::Identity => Event::Identity(&self.shared.identity),
            Item::Health(health) => Event::Health(health),
            // Each of these items was added together with a sector.
            Item::Sector => Event::Sector(self.shared.sectors.pop()?),
            Item::Zone { zone, result } => Event::Zone { zone, result },
            Item::Fault { fault, active } => Event::Fault { fault, active },
            Item::Lost(reason) => Event::Lost { reason },
            Item::Recovered(after) => Event::Recovered { after },
        })
    }

    /// Instant of the next [`Self::handle_timeout`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let quiet = self.shared.line.poll_timeout();
        match self.life {
            Life::New => Some(Instant::ZERO),
            Life::Resting { until } => earliest([Some(until), quiet]),
            Life::Starting { until } => earliest([Some(until), quiet, self.protocol.poll_timeout()]),
            Life::Running { until, window } => {
                earliest([Some(until), Some(window), quiet, self.protocol.poll_timeout()])
            }
        }
    }

    fn start(&mut self, now: Instant) {
        while self.shared.tx.pop().is_some() {}
        self.shared.health = None;
        (self.shared.arrived, self.shared.valid, self.shared.measured) = (None, None, 0);
        self.protocol.start(now, &mut self.shared);
        self.life = Life::Starting { until: now + START_WITHIN };
    }

    /// Why no measurements come, by what arrived last.
    fn reason(&self, now: Instant) -> LostReason {
        let is_recent = |at: Option<Instant>| at.is_some_and(|at| now.since(at) < SILENT_AFTER / 2);
        match (is_recent(self.shared.arrived), is_recent(self.shared.valid)) {
            (false, _) => LostReason::Silent,
            (_, false) => LostReason::Garbled,
            _ => LostReason::Stalled,
        }
    }

    fn apply(&mut self, now: Instant, progress: Progress) {
        if let Progress::Lost(reason) = progress {
            // A silence that is not one: something arrives.
            let reason = if reason == LostReason::Silent { self.reason(now) } else { reason };
            self.lose(now, reason);
        }
    }

    /// Takes note of sectors that were added.
    fn measured(&mut self, now: Instant) {
        if self.shared.measured == 0 {
            return;
        }
        match &mut self.life {
            Life::Starting { .. } => {
                self.life = Life::Running { until: now + SILENT_AFTER, window: now + WINDOW };
                (self.shared.covered_rad, self.shared.runs) = (0.0, true);
                let after = self.lost.take().map_or(Duration::ZERO, |(since, _)| now.since(since));
                self.shared.items.push(Item::Recovered(after));
            }
            Life::Running { until, .. } => *until = now + SILENT_AFTER,
            _ => {}
        }
        self.shared.measured = 0;
    }

    /// Judges the arrivals of a window.
    fn judge(&mut self, now: Instant) {
        let Life::Running { window, .. } = &mut self.life else { return };
        if *window > now {
            return;
        }
        // A window that was served late is not judged by what had no time to arrive.
        let late = now.since(*window);
        let optics = self.shared.optics;
        let expected = optics.view_rad * optics.rate_min_hz * WINDOW.as_secs_f64();
        let incomplete = self.shared.covered_rad < COVERED_MIN * expected;
        *window = now + WINDOW;
        self.shared.covered_rad = 0.0;
        if late < WINDOW {
            self.shared.fault(Fault::Incomplete, incomplete);
        }
    }

    fn lose(&mut self, now: Instant, reason: LostReason) {
        self.life = Life::Resting { until: now + REST };
        // A line so disturbed that the device is lost by it, again and again, is so until it has been quiet.
        let garbled = matches!(reason, LostReason::Garbled | LostReason::Stalled);
        if core::mem::take(&mut self.shared.runs) && !garbled {
            self.shared.line = Disturbance::default();
        }
        let noise = self.shared.line.is_disturbed(now);
        for fault in Fault::ALL {
            self.shared.fault(fault, fault == Fault::Noise && noise);
        }
        let since = self.lost.map_or(now, |(since, _)| since);
        if self.lost.is_none_or(|(_, before)| before != reason) {
            self.shared.items.push(Item::Lost(reason));
            self.shared.counters.losses = self.shared.counters.losses.saturating_add(1);
        }
        self.lost = Some((since, reason));
    }
}
