//! The engine: the life of a device, the same for every protocol.
//!
//! ```text
//!     first handle_timeout           first sample               lost
//!     New -----------------> Starting -----------> Running ----------------+
//!                             ^    | no answer, wrong device                 |
//!                             |    +----------------> Resting <--------------+
//!                             +------- REST ------------+
//! ```

use crate::bno055::Registers;
use crate::event::{Counters, Event, Fault, LostReason, State};
use crate::judge::{Judge, Limits, WINDOW};
use crate::shared::{Progress, Shared};
use crate::witmotion::Packets;
use crate::xsens::Frames;
use base::can::Frame;
use base::i2c::{Address, Outcome, Transfer};
use base::{Disturbance, Duration, Instant, earliest};

/// A device without new measurements for this time is lost.
pub const SILENT_AFTER: Duration = Duration::from_millis(400);
/// Pause between a loss and the next start-up.
pub const REST: Duration = Duration::from_millis(200);
/// Time limit of a start-up until the first sample; a BNO055 answers 0.65 s after its supply came.
const START_WITHIN: Duration = Duration::from_millis(1000);
/// A device: its protocol, and where it is on its bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// Bosch BNO055 on I2C, mode IMU: acceleration and rotation, orientation without a magnetometer.
    Bno055 {
        /// Its address: [`crate::bno055::ADDRESS`] or the next one.
        address: Address,
    },
    /// WitMotion with the standard protocol on a serial line: WT61, WT901, HWT905 and others.
    WitMotion,
    /// Xsens MTi-600 series on CAN, with the identifiers as delivered.
    Xsens,
}

/// The protocols.
#[derive(Debug)]
enum Protocol {
    Bno055(Registers),
    WitMotion(Packets),
    Xsens(Frames),
}

impl Protocol {
    fn new(model: Model) -> Self {
        match model {
            Model::Bno055 { address } => Self::Bno055(Registers::new(address)),
            Model::WitMotion => Self::WitMotion(Packets::new()),
            Model::Xsens => Self::Xsens(Frames::new()),
        }
    }

    fn limits(&self) -> Limits {
        match self {
            Self::Bno055(_) => crate::bno055::LIMITS,
            Self::WitMotion(_) => crate::witmotion::LIMITS,
            Self::Xsens(_) => crate::xsens::LIMITS,
        }
    }

    fn start(&mut self, now: Instant) {
        match self {
            Self::Bno055(registers) => registers.start(now),
            Self::WitMotion(packets) => packets.start(),
            Self::Xsens(frames) => frames.start(),
        }
    }

    fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) {
        if let Self::Bno055(registers) = self {
            registers.handle_timeout(now, shared);
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self {
            Self::Bno055(registers) => registers.poll_timeout(),
            Self::WitMotion(_) | Self::Xsens(_) => None,
        }
    }
}

#[derive(Clone, Copy, Debug)]
enum Life {
    New,
    Starting { until: Instant },
    Running { until: Instant },
    Resting { until: Instant },
}

/// A device. Reads no clock and owns no port: feed it what arrives and time, and after any call drain
/// [`Imu::poll_transfer`], then [`Imu::poll_event`], then arm one timer for [`Imu::poll_timeout`].
#[derive(Debug)]
pub struct Imu {
    protocol: Protocol,
    shared: Shared,
    life: Life,
    window: Instant,
    /// When the loss that was not yet ended began, and its reason; `None` before the first start.
    lost: Option<(Instant, LostReason)>,
}

impl Imu {
    /// The engine of a device; its first [`Self::handle_timeout`] starts it.
    #[must_use]
    pub fn new(model: Model) -> Self {
        let protocol = Protocol::new(model);
        let shared = Shared::new(protocol.limits());
        Self { protocol, shared, life: Life::New, window: Instant::ZERO, lost: None }
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

    /// Number of the last [`Fault::Device`], as the data sheet of the device has it.
    #[must_use]
    pub fn error(&self) -> u8 {
        self.shared.error
    }

    /// What a number of an error means, in words; `None`: only the data sheet of the device says it.
    #[must_use]
    pub fn meaning(&self, code: u8) -> Option<&'static str> {
        match self.protocol {
            Protocol::Bno055(_) => crate::bno055::meaning(code),
            Protocol::Xsens(_) => crate::xsens::meaning(code),
            Protocol::WitMotion(_) => None,
        }
    }

    /// Counters.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.shared.counters
    }

    /// Takes bytes of a serial line that arrived at `now`; ignored by a device on another bus.
    pub fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        self.shared.now = now;
        let awake = self.is_awake();
        if let (Protocol::WitMotion(packets), true) = (&mut self.protocol, awake) {
            for byte in bytes {
                packets.handle_byte(now, *byte, &mut self.shared);
            }
            self.measured(now);
        }
    }

    /// Takes a frame of a CAN bus that arrived at `now`; frames of others, and of a device on another bus, are ignored.
    pub fn handle_frame(&mut self, now: Instant, frame: &Frame) {
        self.shared.now = now;
        let awake = self.is_awake();
        if let (Protocol::Xsens(frames), true) = (&mut self.protocol, awake) {
            frames.handle_frame(now, frame, &mut self.shared);
            self.measured(now);
        }
    }

    /// Takes the outcome of the transfer that was polled last.
    pub fn handle_outcome(&mut self, now: Instant, outcome: &Outcome) {
        self.shared.now = now;
        let awake = self.is_awake();
        if let Protocol::Bno055(registers) = &mut self.protocol {
            let progress = registers.handle_outcome(now, outcome, awake, &mut self.shared);
            if let Progress::Lost(reason) = progress {
                self.lose(now, reason);
            }
            self.measured(now);
        }
    }

    /// The port is closed: the device is lost at once, and a transfer under way has no outcome. What the host opens
    /// afterwards is used by the next start-up.
    pub fn handle_closed(&mut self, now: Instant) {
        if let Protocol::Bno055(registers) = &mut self.protocol {
            registers.forget();
        }
        self.shared.transfer = None;
        if self.is_awake() {
            self.lose(now, LostReason::Closed);
        }
    }

    /// Serves deadlines; late and needless calls do no harm. The first call starts the engine.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.shared.now = now;
        match self.life {
            Life::New => {
                self.window = now + WINDOW;
                self.start(now);
            }
            Life::Resting { until } if until <= now => self.start(now),
            Life::Starting { until } | Life::Running { until } if until <= now => self.lose(now, self.reason(now)),
            _ => {}
        }
        if self.is_awake() {
            self.protocol.handle_timeout(now, &mut self.shared);
        }
        if self.window <= now {
            self.window = now + WINDOW;
            // What nothing says anything about stays as it is.
            if let Some(implausible) = self.shared.judge.window() {
                let running = matches!(self.life, Life::Running { .. });
                self.shared.fault(Fault::Implausible, implausible && running);
            }
        }
        let disturbed = self.shared.line.is_disturbed(now);
        self.shared.fault(Fault::Noise, disturbed);
    }

    /// The next transfer on an I2C bus; the host answers with [`Self::handle_outcome`].
    pub fn poll_transfer(&mut self) -> Option<Transfer> {
        self.shared.transfer.take()
    }

    /// The next thing that happened.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.shared.events.pop()
    }

    /// Instant of the next [`Self::handle_timeout`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let quiet = self.shared.line.poll_timeout();
        match self.life {
            Life::New => Some(Instant::ZERO),
            Life::Resting { until } => earliest([Some(until), Some(self.window), quiet]),
            Life::Starting { until } | Life::Running { until } => {
                earliest([Some(until), Some(self.window), quiet, self.protocol.poll_timeout()])
            }
        }
    }

    fn is_awake(&self) -> bool {
        matches!(self.life, Life::Starting { .. } | Life::Running { .. })
    }

    fn start(&mut self, now: Instant) {
        (self.shared.arrived, self.shared.valid, self.shared.measured) = (None, None, false);
        self.shared.judge = Judge::default();
        self.protocol.start(now);
        self.life = Life::Starting { until: now + START_WITHIN };
    }

    /// Why no measurements come, by what arrived last.
    fn reason(&self, now: Instant) -> LostReason {
        let is_recent = |at: Option<Instant>| at.is_some_and(|at| now.since(at) < SILENT_AFTER / 2);
        match (is_recent(self.shared.arrived), is_recent(self.shared.valid)) {
            (false, _) => LostReason::Silent,
            (true, false) => LostReason::Garbled,
            (true, true) => LostReason::Incomplete,
        }
    }

    /// Takes note of samples that were added.
    fn measured(&mut self, now: Instant) {
        if !core::mem::take(&mut self.shared.measured) {
            return;
        }
        if matches!(self.life, Life::Starting { .. }) {
            let after = self.lost.take().map_or(Duration::ZERO, |(since, _)| now.since(since));
            self.shared.push(Event::Recovered { after });
        }
        if self.is_awake() {
            self.life = Life::Running { until: now + SILENT_AFTER };
            self.shared.runs = true;
        }
    }

    fn lose(&mut self, now: Instant, reason: LostReason) {
        let since = self.lost.map_or(now, |(since, _)| since);
        if self.lost.is_none_or(|(_, told)| told != reason) {
            self.shared.push(Event::Lost { reason });
        }
        self.lost = Some((since, reason));
        // A line so disturbed that the device is lost by it, again and again, is so until it has been quiet.
        let garbled = matches!(reason, LostReason::Garbled | LostReason::Incomplete);
        if core::mem::take(&mut self.shared.runs) && !garbled {
            self.shared.line = Disturbance::default();
        }
        let noise = self.shared.line.is_disturbed(now);
        for fault in Fault::ALL {
            self.shared.fault(fault, fault == Fault::Noise && noise);
        }
        self.life = Life::Resting { until: now + REST };
    }
}
