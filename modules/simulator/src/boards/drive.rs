//! A drive on the CAN bus: a CANopen node, or a motor controller without CANopen, and what is wrong with it.

use super::canopen_drive::CanopenDrive;
use super::cia402::{self, Cia402Config};
use super::controller::Controller;
use super::encoder::{Axis, Encoder, Wrong};
use super::icla::Gearing;
use crate::body::Body;
use base::Instant;
use base::can::Frame;
use canopen::{Dictionary, drives};
use motorctl::can;

/// A drive of the bus.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveConfig {
    /// Name, the target of faults: `propulsion`.
    pub name: String,
    /// Node id; of an ODrive that of CAN Simple, of a VESC its VESC id.
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
    /// A motor controller without CANopen, which drives a wheel.
    Controller {
        /// Number of the wheel.
        wheel: u8,
        /// Motor turns per turn of the wheel.
        gear: f64,
        /// Which one it is.
        device: can::Device,
    },
}

impl DriveKind {
    /// What it moves.
    #[must_use]
    pub fn axis(&self) -> Axis {
        match self {
            Self::Epos { wheel, .. } | Self::Controller { wheel, .. } => Axis::Wheel(*wheel),
            Self::Icla(_) => Axis::Steering,
            Self::Cia402(config) => config.axis,
        }
    }

    /// Node id and endpoints of an ODrive; none: it is another drive.
    #[must_use]
    pub fn odrive(&self) -> Option<(u8, motorctl::odrive::Endpoints)> {
        match self {
            Self::Controller { device: can::Device::Odrive(device), .. } => Some((device.node, device.endpoints)),
            _ => None,
        }
    }

    /// The objects of a new drive with this node id; none: it is no CANopen node.
    pub(crate) fn dictionary(&self, node: u8) -> Option<Dictionary> {
        match self {
            Self::Epos { .. } => Some(drives::epos::dictionary(node)),
            Self::Icla(_) => Some(drives::icla::dictionary(node)),
            Self::Cia402(config) => Some(config.sheet.dictionary(node)),
            Self::Controller { .. } => None,
        }
    }

    /// The same of another version, with other PDOs; none: there is no other.
    pub(super) fn other_version(&self, node: u8) -> Option<Dictionary> {
        match self {
            Self::Epos { .. } | Self::Controller { .. } => None,
            Self::Icla(_) => Some(drives::icla::dictionary_of_profile(node)),
            Self::Cia402(config) => Some(cia402::other_version(&config.sheet, node)),
        }
    }
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

/// Whether the drive of a wheel obeys, and until when it does not.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Obedience(Option<(Disobedience, Instant)>);

impl Obedience {
    /// From now until then it disobeys, or obeys.
    pub fn set(&mut self, how: Option<Disobedience>, until: Instant) {
        self.0 = how.map(|how| (how, until));
    }

    /// Demand for a wheel that is commanded to roll at `demand` and does so at `speed`, m/s.
    pub fn demand(self, now: Instant, demand: f64, speed: f64) -> f64 {
        match self.0.filter(|(_, until)| now < *until) {
            Some((Disobedience::Unbraked, _)) if demand.abs() < speed.abs() || demand * speed < 0.0 => speed,
            Some((Disobedience::Runaway(by), _)) if demand != 0.0 => demand + by.copysign(demand),
            Some((Disobedience::Runaway(by), _)) if speed != 0.0 => by.copysign(speed),
            _ => demand,
        }
    }
}

/// What is behind the frames.
enum End {
    Canopen(Box<CanopenDrive>),
    Controller(Box<Controller>),
}

/// A drive and its injected faults.
pub(crate) struct Drive {
    pub config: DriveConfig,
    /// Number of its CAN bus: set by what makes it.
    pub bus: usize,
    end: End,
    /// Neither receives nor sends until this instant.
    pub silent_until: Instant,
    obedience: Obedience,
    now: Instant,
}

impl Drive {
    /// A drive of `body`, switched off.
    pub fn new(config: DriveConfig, body: &Body) -> Self {
        let end = match (CanopenDrive::new(&config, body), &config.kind) {
            (_, DriveKind::Controller { wheel, gear, device }) => {
                End::Controller(Box::new(Controller::new(*wheel, *gear, *device)))
            }
            (Some(node), _) => End::Canopen(Box::new(node)),
            (None, _) => unreachable!("every other kind has a node"),
        };
        Self { config, bus: 0, end, silent_until: Instant::ZERO, obedience: Obedience::default(), now: Instant::ZERO }
    }

    /// What it moves.
    pub fn axis(&self) -> Axis {
        self.config.kind.axis()
    }

    /// Switches it on, or off and on again.
    pub fn power_on(&mut self, now: Instant, body: &Body) {
        self.now = now;
        match &mut self.end {
            End::Canopen(node) => node.power_on(now, body),
            End::Controller(controller) => controller.power_on(now, body),
        }
    }

    /// Replaces it by one of its kind with this mapping; false if there is none.
    pub fn set_layout(&mut self, now: Instant, layout: Layout, body: &Body) -> bool {
        self.now = now;
        match &mut self.end {
            End::Canopen(node) => node.set_layout(now, layout, &self.config, body),
            End::Controller(_) => false,
        }
    }

    /// Opens a digital input until then, or closes all; false for a drive that has none.
    pub fn open(&mut self, bit: Option<u8>, until: Instant) -> bool {
        match &mut self.end {
            End::Canopen(node) => node.open(bit, until),
            End::Controller(_) => false,
        }
    }

    /// From now until then it disobeys, or obeys; false for the steering.
    pub fn disobey(&mut self, how: Option<Disobedience>, until: Instant) -> bool {
        self.obedience.set(how, until);
        matches!(self.axis(), Axis::Wheel(_))
    }

    /// From now until then its encoder is wrong, or true; false for the steering with that of a wheel.
    pub fn misread(&mut self, wrong: Option<Wrong>, until: Instant, body: &Body) -> bool {
        if self.axis() == Axis::Steering && matches!(wrong, Some(Wrong::Of(_))) {
            return false;
        }
        self.encoder().deviate(wrong, until, body);
        true
    }

    fn encoder(&mut self) -> &mut Encoder {
        match &mut self.end {
            End::Canopen(node) => &mut node.encoder,
            End::Controller(controller) => &mut controller.encoder,
        }
    }

    /// A frame from the bus.
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame, body: &Body) {
        if self.silent_until > now {
            return;
        }
        self.now = now;
        match &mut self.end {
            End::Canopen(node) => node.handle_rx(now, frame, body),
            End::Controller(controller) => controller.handle_rx(now, frame, body),
        }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant, body: &Body) {
        if self.poll_timeout().is_some_and(|due| due <= now) {
            self.now = now;
            match &mut self.end {
                End::Canopen(node) => node.handle_timeout(now, body),
                End::Controller(controller) => controller.handle_timeout(now, body),
            }
        }
    }

    /// Raises an internal fault.
    pub fn fault(&mut self, now: Instant, code: u16, body: &Body) {
        self.now = now;
        match &mut self.end {
            End::Canopen(node) => node.fault(now, code, body),
            End::Controller(controller) => controller.fault(code),
        }
    }

    /// The feed of the wheels' motor comes or goes. What a CANopen drive thinks with has a supply of its own.
    pub fn feed_motor(&mut self, now: Instant, fed: bool, body: &Body) {
        self.now = now;
        match &mut self.end {
            End::Canopen(node) => node.feed_motor(now, fed, body),
            End::Controller(controller) => controller.feed(now, fed, body),
        }
    }

    /// The PAUSE line is wired to the input of each wheel's CANopen drive for a stop by its quick stop ramp.
    pub fn brake(&mut self, now: Instant, body: &Body) {
        self.now = now;
        if let End::Canopen(node) = &mut self.end {
            node.brake(now, body);
        }
    }

    /// True if time alone changes nothing.
    pub fn rests(&self) -> bool {
        match &self.end {
            End::Canopen(node) => node.rests(),
            End::Controller(controller) => controller.rests(),
        }
    }

    /// Goes on by `dt` s; answers what the drive demands of its axis: speed, m/s, or angle, rad.
    pub fn step(&mut self, now: Instant, body: &Body, dt: f64) -> Option<f64> {
        self.encoder().expire(now, body);
        let demand = match &mut self.end {
            End::Canopen(node) => node.step(now, body, dt),
            End::Controller(controller) => controller.demand(body),
        }?;
        let demand = match self.axis() {
            Axis::Wheel(wheel) => self.obedience.demand(now, demand, body.wheel_speed(wheel.into())),
            Axis::Steering => demand,
        };
        self.encoder().controlled(demand, body)
    }

    /// After the body's step, in which the steering turned by `turned` rad/s.
    pub fn stepped(&mut self, now: Instant, body: &Body, turned: f64) {
        self.now = now;
        match &mut self.end {
            End::Canopen(node) => node.stepped(now, body, turned),
            End::Controller(controller) => controller.handle_timeout(now, body),
        }
    }

    /// A frame to send.
    pub fn poll_tx(&mut self) -> Option<Frame> {
        loop {
            let frame = match &mut self.end {
                End::Canopen(node) => node.poll_tx(),
                End::Controller(controller) => controller.poll_tx(),
            }?;
            if self.silent_until <= self.now {
                return Some(frame);
            }
        }
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        match &self.end {
            End::Canopen(node) => node.poll_timeout(),
            End::Controller(controller) => controller.poll_timeout(),
        }
    }
}
