//! A drive on the CAN bus: a CANopen node with an EPOS, an IclA, or a drive by its data sheet behind its objects.

use super::cia402::{self, Cia402, Cia402Config};
use super::encoder::{Encoder, Reading, Wrong};
use super::epos::{self, Emergency, Epos};
use super::icla::{Gearing, Icla};
use crate::body::Body;
use base::can::Frame;
use base::{Duration, Instant};
use canopen::drives;
use canopen::{Dictionary, NmtState, Node, NodeEvent};

/// From power or reset to the boot-up message.
const BOOT_TIME: Duration = Duration::from_millis(100);

/// What a drive moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// The driven wheel of this number; 0 of a driven axle. Its drive loses its motor's feed with the PAUSE line and the
    /// second way to stop.
    Wheel(u8),
    /// The front wheels' angle. The gear holds them; their drive has a supply of its own.
    Steering,
}

/// A drive of the bus.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveConfig {
    /// Name, the target of faults: `propulsion`.
    pub name: String,
    /// Node id.
    pub node: u8,
    /// Which one.
    pub kind: DriveKind,
}

/// Kinds of drives.
#[derive(Clone, Debug, PartialEq)]
pub enum DriveKind {
    /// maxon EPOS 70/10, which drives a wheel, or the driven axle.
    Epos {
        /// Number of the wheel.
        wheel: u8,
        /// Motor turns per turn of the wheel.
        gear: f64,
    },
    /// Berger Lahr IclA, which steers.
    Icla(Gearing),
    /// Any drive of CiA 402, by its data sheet.
    Cia402(Box<Cia402Config>),
}

impl DriveKind {
    /// What it moves.
    #[must_use]
    pub fn axis(&self) -> Axis {
        match self {
            Self::Epos { wheel, .. } => Axis::Wheel(*wheel),
            Self::Icla(_) => Axis::Steering,
            Self::Cia402(config) => config.axis,
        }
    }

    /// The objects of a new drive with this node id.
    pub(crate) fn dictionary(&self, node: u8) -> Dictionary {
        match self {
            Self::Epos { .. } => drives::epos::dictionary(node),
            Self::Icla(_) => drives::icla::dictionary(node),
            Self::Cia402(config) => config.sheet.dictionary(node),
        }
    }

    /// The same of another version, with other PDOs; none: there is no other.
    fn other_version(&self, node: u8) -> Option<Dictionary> {
        match self {
            Self::Epos { .. } => None,
            Self::Icla(_) => Some(drives::icla::dictionary_of_profile(node)),
            Self::Cia402(config) => Some(cia402::other_version(&config.sheet, node)),
        }
    }
}

/// What is behind the objects.
enum Device {
    Epos(Epos),
    Icla(Icla),
    Cia402(Box<Cia402>),
}

/// PDO mapping of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layout {
    /// That of its kind.
    Usual,
    /// That of another version.
    Other,
}

/// How the drive of a wheel disobeys while its power stage is on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Disobedience {
    /// It does not brake.
    Unbraked,
    /// It is faster than commanded by this, m/s.
    Runaway(f64),
}

/// A drive and its injected faults.
pub(crate) struct Drive {
    pub config: DriveConfig,
    device: Device,
    layout: Layout,
    node: Node,
    /// Neither receives nor sends until this instant.
    pub silent_until: Instant,
    /// Disobeys until this instant.
    disobeys: Option<(Disobedience, Instant)>,
    /// Of a wheel.
    encoder: Option<Encoder>,
    now: Instant,
    turned: f64,
}

impl Drive {
    /// A drive of `body`, switched off.
    pub fn new(config: DriveConfig, body: &Body) -> Self {
        let dictionary = config.kind.dictionary(config.node);
        let encoder = match config.kind.axis() {
            Axis::Wheel(wheel) => Some(Encoder::new(wheel)),
            Axis::Steering => None,
        };
        let reading = read(encoder.as_ref(), body);
        let device = match &config.kind {
            DriveKind::Epos { wheel, gear } => Device::Epos(Epos::new(*wheel, *gear, epos::ENABLING)),
            DriveKind::Icla(gearing) => Device::Icla(Icla::new(*gearing, body)),
            DriveKind::Cia402(own) => {
                Device::Cia402(Box::new(Cia402::new((**own).clone(), &dictionary, body, reading)))
            }
        };
        Self {
            config,
            device,
            layout: Layout::Usual,
            node: Node::new(dictionary, BOOT_TIME).without_block(),
            silent_until: Instant::ZERO,
            disobeys: None,
            encoder,
            now: Instant::ZERO,
            turned: 0.0,
        }
    }

    /// What it moves.
    pub fn axis(&self) -> Axis {
        self.config.kind.axis()
    }

    /// Switches it on, or off and on again.
    pub fn power_on(&mut self, now: Instant, body: &Body) {
        self.node.power_on(now);
        self.renew(body);
        self.serve(now, body);
    }

    /// Replaces it by one of its kind with this mapping; false if there is none.
    pub fn set_layout(&mut self, now: Instant, layout: Layout, body: &Body) -> bool {
        let (kind, id) = (&self.config.kind, self.config.node);
        let Some(other) = kind.other_version(id) else {
            return false;
        };
        if self.layout != layout {
            let dictionary = if layout == Layout::Other { other } else { kind.dictionary(id) };
            self.layout = layout;
            self.node = Node::new(dictionary, BOOT_TIME).without_block();
            self.power_on(now, body);
        }
        true
    }

    /// From now until then it disobeys, or obeys; false for the steering.
    pub fn disobey(&mut self, how: Option<Disobedience>, until: Instant) -> bool {
        self.disobeys = how.map(|how| (how, until));
        matches!(self.axis(), Axis::Wheel(_))
    }

    /// From now until then its encoder is wrong, or true; false for the steering.
    pub fn misread(&mut self, wrong: Option<Wrong>, until: Instant, body: &Body) -> bool {
        self.encoder.as_mut().map(|encoder| encoder.deviate(wrong, until, body)).is_some()
    }

    /// Demand for a wheel that is commanded to roll at `demand` and does so at `speed`, m/s.
    fn disobeyed(&self, now: Instant, demand: f64, speed: f64) -> f64 {
        match self.disobeys.filter(|(_, until)| now < *until) {
            Some((Disobedience::Unbraked, _)) if demand.abs() < speed.abs() || demand * speed < 0.0 => speed,
            Some((Disobedience::Runaway(by), _)) if demand != 0.0 => demand + by.copysign(demand),
            Some((Disobedience::Runaway(by), _)) if speed != 0.0 => by.copysign(speed),
            _ => demand,
        }
    }

    fn renew(&mut self, body: &Body) {
        let reading = read(self.encoder.as_ref(), body);
        match &mut self.device {
            Device::Epos(epos) => epos.renew(self.node.dictionary()),
            Device::Icla(icla) => icla.renew(self.node.dictionary(), body),
            Device::Cia402(cia402) => cia402.renew(&mut self.node, body, reading),
        }
    }

    /// A frame from the bus.
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame, body: &Body) {
        if self.silent_until <= now {
            self.node.handle_rx(now, frame);
            self.serve(now, body);
        }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant, body: &Body) {
        if self.node.poll_timeout().is_some_and(|due| due <= now) {
            self.node.handle_timeout(now);
            self.serve(now, body);
        }
    }

    /// Raises an internal fault.
    pub fn fault(&mut self, now: Instant, code: u16, body: &Body) {
        let emergency = match &mut self.device {
            Device::Epos(epos) => epos.fault(code),
            Device::Icla(icla) => icla.fault(code),
            Device::Cia402(cia402) => cia402.fault(code),
        };
        self.report(emergency);
        self.stepped(now, body, self.turned);
    }

    /// The feed of the wheels' motor comes or goes; what the drive thinks with has a supply of its own.
    pub fn feed_motor(&mut self, now: Instant, fed: bool, body: &Body) {
        let emergency = match &mut self.device {
            Device::Epos(epos) => epos.feed(fed),
            Device::Cia402(cia402) if cia402.config().axis != Axis::Steering => cia402.feed(fed),
            Device::Icla(_) | Device::Cia402(_) => return,
        };
        self.report(emergency);
        self.stepped(now, body, self.turned);
    }

    /// The PAUSE line is wired to the input of each wheel's drive for a stop by its quick stop ramp.
    pub fn brake(&mut self, now: Instant, body: &Body) {
        match &mut self.device {
            Device::Epos(epos) => epos.brake(),
            Device::Cia402(cia402) if cia402.config().axis != Axis::Steering => cia402.brake(),
            Device::Icla(_) | Device::Cia402(_) => return,
        }
        self.stepped(now, body, self.turned);
    }

    /// The node's news go to the drive, and what follows from them to the node.
    fn serve(&mut self, now: Instant, body: &Body) {
        self.now = now;
        while self.pass_news(now, body) {
            self.measure(body);
            self.node.handle_timeout(now);
        }
    }

    /// True if there was any.
    fn pass_news(&mut self, now: Instant, body: &Body) -> bool {
        let mut news = false;
        while let Some(event) = self.node.poll_event() {
            news = true;
            match event {
                NodeEvent::ObjectWritten { index, .. } => self.written(now, index, body),
                NodeEvent::ResetApplication => self.renew(body),
                NodeEvent::HeartbeatLost { .. } | NodeEvent::GuardLost => self.heartbeat_lost(),
                NodeEvent::NmtState(state) => self.nmt_state(state),
                NodeEvent::PdoTooShort { .. } => self.pdo_too_short(),
                NodeEvent::HeartbeatBack { .. }
                | NodeEvent::GuardBack
                | NodeEvent::PdoTooLong { .. }
                | NodeEvent::PdoLate { .. }
                | NodeEvent::Time(_)
                | NodeEvent::BitRate(_)
                | NodeEvent::LssStored { .. } => {}
            }
        }
        news
    }

    fn nmt_state(&mut self, state: NmtState) {
        let (operational, initialised) = (state == NmtState::Operational, state != NmtState::Initialising);
        match &mut self.device {
            Device::Epos(epos) => {
                epos.set_remote(operational);
                if initialised {
                    epos.initialised();
                }
            }
            Device::Icla(icla) => {
                icla.set_remote(operational);
                if initialised {
                    icla.initialised();
                }
            }
            Device::Cia402(cia402) => {
                cia402.set_nmt_state(state, self.node.dictionary());
                if initialised {
                    cia402.initialised();
                }
            }
        }
    }

    fn written(&mut self, now: Instant, index: u16, body: &Body) {
        let objects = self.node.dictionary();
        let emergency = match &mut self.device {
            Device::Epos(epos) => epos.written(now, index, objects),
            Device::Icla(icla) => icla.written(now, index, objects, body),
            Device::Cia402(cia402) => cia402.written(now, index, objects),
        };
        self.report(emergency);
    }

    fn heartbeat_lost(&mut self) {
        let emergency = match &mut self.device {
            Device::Epos(epos) => epos.fault(epos::HEARTBEAT),
            Device::Icla(icla) => Some(icla.heartbeat_lost()),
            Device::Cia402(cia402) => Some(cia402.heartbeat_lost()),
        };
        self.report(emergency);
    }

    /// The node has sent the emergency; the EPOS brakes as for any fault of communication.
    fn pdo_too_short(&mut self) {
        if let Device::Epos(epos) = &mut self.device {
            epos.fault(0x8210);
        }
    }

    fn report(&mut self, emergency: Option<Emergency>) {
        if let Some(Emergency { code, register }) = emergency {
            self.node.set(0x603F, 0, i64::from(code));
            self.node.emergency(code, register, [0; 5]);
        }
    }

    /// True if time alone changes nothing.
    pub fn rests(&self) -> bool {
        match &self.device {
            Device::Epos(epos) => epos.rests(),
            Device::Icla(icla) => icla.rests(),
            Device::Cia402(cia402) => cia402.rests(),
        }
    }

    /// Goes on by `dt` s; answers what the drive demands of its axis: speed, m/s, or angle, rad.
    pub fn step(&mut self, now: Instant, body: &Body, dt: f64) -> Option<f64> {
        if let Some(encoder) = &mut self.encoder {
            encoder.expire(now, body);
        }
        let demand = match &mut self.device {
            Device::Epos(epos) => epos.step(now, body, dt),
            Device::Icla(icla) => icla.step(now, body, dt),
            Device::Cia402(cia402) => cia402.step(now, body, dt),
        }?;
        match (self.axis(), &self.encoder) {
            (Axis::Wheel(wheel), Some(encoder)) => {
                encoder.controlled(self.disobeyed(now, demand, body.wheel_speed(wheel.into())), body)
            }
            _ => Some(demand),
        }
    }

    /// After the body's step, in which the steering turned by `turned` rad/s.
    pub fn stepped(&mut self, now: Instant, body: &Body, turned: f64) {
        self.now = now;
        self.turned = turned;
        let emergency = match &mut self.device {
            Device::Epos(epos) => epos.poll_fault(),
            Device::Cia402(cia402) => cia402.poll_fault(),
            Device::Icla(_) => None,
        };
        self.report(emergency);
        self.measure(body);
        self.node.handle_timeout(now);
        self.serve(now, body);
    }

    /// Copies the drive's measurements to the node's objects.
    fn measure(&mut self, body: &Body) {
        let reading = read(self.encoder.as_ref(), body);
        match &mut self.device {
            Device::Epos(epos) => epos.feedback(&mut self.node, body, reading),
            Device::Icla(icla) => icla.feedback(&mut self.node, body, self.turned),
            Device::Cia402(cia402) => cia402.feedback(&mut self.node, body, self.turned, reading),
        }
    }

    /// A frame to send.
    pub fn poll_tx(&mut self) -> Option<Frame> {
        while let Some(frame) = self.node.poll_tx() {
            if self.silent_until <= self.now {
                return Some(frame);
            }
        }
        None
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        self.node.poll_timeout()
    }
}

/// What the encoder of a wheel reads; nothing of the steering.
fn read(encoder: Option<&Encoder>, body: &Body) -> Reading {
    encoder.map_or_else(Reading::default, |encoder| encoder.read(body))
}
