//! A complete emulated CiA 402 drive: a [`Node`] with its dictionary, a [`Servo`] behind it, and a motor that follows
//! it. Sans-IO, like the node: what a new drive is tested against (docs/adding-a-drive.md).

use super::{Config, Sensed, Servo, error_register};
use crate::{Dictionary, NmtState, Node, NodeEvent};
use base::can::Frame;
use base::{Duration, Instant, earliest};

/// The servo goes on in steps of this.
const STEP: Duration = Duration::from_millis(1);

/// Load of the motor. It follows the drive exactly, and coasts to a stop without it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Counts.
    pub position: f64,
    /// Counts/s.
    pub speed: f64,
    /// Without power it loses speed so, counts/s².
    pub friction: f64,
    /// Something holds it.
    pub blocked: bool,
    /// The negative limit switch is active up to here.
    pub negative: f64,
    /// The positive one from here.
    pub positive: f64,
    /// The home switch is active from here to there.
    pub home: [f64; 2],
}

impl Default for Load {
    /// At 0, with limits at ±20 000 and the home switch from -2300 to 2300.
    fn default() -> Self {
        Self {
            position: 0.0,
            speed: 0.0,
            friction: 1000.0,
            blocked: false,
            negative: -20_000.0,
            positive: 20_000.0,
            home: [-2300.0, 2300.0],
        }
    }
}

impl Load {
    fn sensed(&self) -> Sensed {
        Sensed {
            position: self.position,
            speed: self.speed,
            negative: self.position <= self.negative,
            positive: self.position >= self.positive,
            home: (self.home[0]..=self.home[1]).contains(&self.position),
        }
    }

    fn roll(&mut self, dt: f64) {
        let lost = (self.friction * dt).min(libm::fabs(self.speed));
        self.speed -= libm::copysign(lost, self.speed);
        self.position += self.speed * dt;
    }
}

/// The drive.
pub struct Twin {
    node: Node,
    config: Config,
    servo: Servo,
    /// Load, for inspection and manipulation by tests.
    pub load: Load,
    next: Instant,
}

impl Twin {
    /// A drive that is switched off, with these objects; from an EDS they come by `Eds::dictionary`.
    #[must_use]
    pub fn new(dictionary: Dictionary, boot_time: Duration, config: Config, load: Load) -> Self {
        let servo = Servo::new(config, load.position);
        Self { node: Node::new(dictionary, boot_time), config, servo, load, next: Instant::ZERO }
    }

    /// Switches it on, or off and on again.
    pub fn power_on(&mut self, now: Instant) {
        self.node.power_on(now);
        self.next = now + STEP;
        self.renew();
        self.serve(now);
    }

    fn renew(&mut self) {
        self.servo = Servo::new(self.config, self.load.position);
        self.servo.configure(self.node.dictionary());
    }

    /// The node: to look at its objects.
    #[must_use]
    pub fn node(&self) -> &Node {
        &self.node
    }

    /// The servo.
    #[must_use]
    pub fn servo(&self) -> &Servo {
        &self.servo
    }

    /// A frame from the bus.
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        self.node.handle_rx(now, frame);
        self.serve(now);
    }

    /// Raises an internal fault, with the stop of 0x605E.
    pub fn fault(&mut self, now: Instant, code: u16) {
        if self.servo.fault() {
            self.tell(code);
        }
        self.serve(now);
    }

    fn tell(&mut self, code: u16) {
        self.node.set(0x603F, 0, i64::from(code));
        self.node.emergency(code, error_register(code), [0; 5]);
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        while self.next <= now {
            let (at, dt) = (self.next, STEP.as_nanos() as f64 / 1e9);
            match self.servo.step(at, &self.load.sensed(), dt) {
                _ if self.load.blocked => self.load.speed = 0.0,
                Some(demand) => (self.load.position, self.load.speed) = (demand.demand, demand.speed),
                None => self.load.roll(dt),
            }
            if let Some(code) = self.servo.poll_fault() {
                self.tell(code);
            }
            self.next += STEP;
            self.measure();
        }
        self.node.handle_timeout(now);
        self.serve(now);
    }

    fn serve(&mut self, now: Instant) {
        while let Some(event) = self.node.poll_event() {
            let sensed = self.load.sensed();
            match event {
                NodeEvent::ObjectWritten { index, .. }
                    if self.servo.written(now, index, self.node.dictionary(), &sensed) =>
                {
                    self.tell(0);
                }
                NodeEvent::ResetApplication => self.renew(),
                NodeEvent::NmtState(NmtState::PreOperational) => self.servo.initialised(),
                NodeEvent::HeartbeatLost { .. } | NodeEvent::GuardLost => {
                    self.servo.connection_lost();
                    self.tell(0x8130);
                }
                _ => {}
            }
        }
        self.measure();
        self.node.handle_timeout(now);
    }

    fn measure(&mut self) {
        let sensed = self.load.sensed();
        self.servo.sense(&sensed);
        for (index, value) in self.servo.measured(&sensed) {
            self.node.set(index, 0, value);
        }
        self.node.set(0x60FD, 0, sensed.inputs());
        let remote = self.node.nmt_state() == Some(NmtState::Operational);
        let status = self.servo.statusword(&sensed) | super::status::VOLTAGE;
        let status = if remote { status | super::status::REMOTE } else { status };
        self.node.set(0x6041, 0, i64::from(status));
    }

    /// A frame to send.
    pub fn poll_tx(&mut self) -> Option<Frame> {
        self.node.poll_tx()
    }

    /// Instant of the next [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let rests = self.servo.rests() && (self.servo.is_powered() || self.load.speed == 0.0);
        let step = (!rests).then_some(self.next);
        earliest([self.node.poll_timeout(), step])
    }
}
