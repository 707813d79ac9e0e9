//! A drive on the CAN bus: a CANopen node with an EPOS or an IclA behind its objects.

use super::epos::{self, Emergency, Epos};
use super::icla::{Gearing, Icla};
use crate::body::Body;
use base::can::Frame;
use base::{Duration, Instant};
use canopen::drives;
use canopen::{Dictionary, NmtState, Node, NodeEvent};

/// From power or reset to the boot-up message.
const BOOT_TIME: Duration = Duration::from_millis(100);

/// Kind of a drive.
#[derive(Debug)]
pub(crate) enum Kind {
    Epos(Epos),
    Icla(Icla),
}

/// The objects of such a drive.
pub(crate) fn dictionary(kind: &Kind, id: u8) -> Dictionary {
    match kind {
        Kind::Epos(_) => drives::epos::dictionary(id),
        Kind::Icla(_) => drives::icla::dictionary(id),
    }
}

/// PDO mapping of an IclA.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layout {
    /// Position in RPDO2.
    Usual,
    /// Position in RPDO3.
    Profile,
}

/// How a propulsion drive disobeys while its power stage is on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Disobedience {
    /// It does not brake.
    Unbraked,
    /// It is faster than commanded by this, m/s.
    Runaway(f64),
}

/// A drive and its injected faults.
pub(crate) struct Drive {
    /// Axis: `propulsion`, `steering`.
    pub name: &'static str,
    pub kind: Kind,
    pub id: u8,
    layout: Layout,
    node: Node,
    /// Neither receives nor sends until this instant.
    pub silent_until: Instant,
    /// Disobeys until this instant.
    disobeys: Option<(Disobedience, Instant)>,
    now: Instant,
    turned: f64,
}

impl Drive {
    /// The propulsion, switched off.
    pub fn propulsion(id: u8) -> Self {
        Self::new("propulsion", Kind::Epos(Epos::new(epos::ENABLING)), id)
    }

    /// The steering, switched off.
    pub fn steering(id: u8, gearing: Gearing, body: &Body) -> Self {
        Self::new("steering", Kind::Icla(Icla::new(gearing, body)), id)
    }

    fn new(name: &'static str, kind: Kind, id: u8) -> Self {
        let node = Node::new(dictionary(&kind, id), BOOT_TIME).without_block();
        Self {
            name,
            kind,
            id,
            layout: Layout::Usual,
            node,
            silent_until: Instant::ZERO,
            disobeys: None,
            now: Instant::ZERO,
            turned: 0.0,
        }
    }

    /// Switches it on, or off and on again.
    pub fn power_on(&mut self, now: Instant, body: &Body) {
        self.node.power_on(now);
        self.renew(body);
        self.serve(now, body);
    }

    /// Replaces it by an IclA with this mapping; false for another kind of drive.
    pub fn set_layout(&mut self, now: Instant, layout: Layout, body: &Body) -> bool {
        if !matches!(self.kind, Kind::Icla(_)) {
            return false;
        }
        if std::mem::replace(&mut self.layout, layout) != layout {
            let dictionary = match layout {
                Layout::Usual => drives::icla::dictionary(self.id),
                Layout::Profile => drives::icla::dictionary_of_profile(self.id),
            };
            self.node = Node::new(dictionary, BOOT_TIME).without_block();
            self.power_on(now, body);
        }
        true
    }

    /// From now until then it disobeys, or obeys; false for another kind of drive.
    pub fn disobey(&mut self, how: Option<Disobedience>, until: Instant) -> bool {
        self.disobeys = how.map(|how| (how, until));
        matches!(self.kind, Kind::Epos(_))
    }

    /// Speed of a propulsion drive that is commanded to drive at `demand`, m/s.
    fn disobeyed(&self, now: Instant, demand: f64, body: &Body) -> f64 {
        let speed = body.speed();
        match self.disobeys.filter(|(_, until)| now < *until) {
            Some((Disobedience::Unbraked, _)) if demand.abs() < speed.abs() || demand * speed < 0.0 => speed,
            Some((Disobedience::Runaway(by), _)) if demand != 0.0 => demand + by.copysign(demand),
            Some((Disobedience::Runaway(by), _)) if speed != 0.0 => by.copysign(speed),
            _ => demand,
        }
    }

    fn renew(&mut self, body: &Body) {
        match &mut self.kind {
            Kind::Epos(epos) => epos.renew(self.node.dictionary()),
            Kind::Icla(icla) => icla.renew(self.node.dictionary(), body),
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
        let emergency = match &mut self.kind {
            Kind::Epos(epos) => epos.fault(code),
            Kind::Icla(icla) => icla.fault(code),
        };
        self.report(emergency);
        self.stepped(now, body, self.turned);
    }

    /// The motor's feed comes or goes; what the drive thinks with has a supply of its own. The IclA, whose gear holds
    /// the wheels, has no feed of its own.
    pub fn feed_motor(&mut self, now: Instant, fed: bool, body: &Body) {
        if let Kind::Epos(epos) = &mut self.kind {
            let emergency = epos.feed(fed);
            self.report(emergency);
            self.stepped(now, body, self.turned);
        }
    }

    /// The PAUSE line is wired to the propulsion's input for a stop by its quick stop ramp.
    pub fn brake(&mut self, now: Instant, body: &Body) {
        if let Kind::Epos(epos) = &mut self.kind {
            epos.brake();
            self.stepped(now, body, self.turned);
        }
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
        match &mut self.kind {
            Kind::Epos(epos) => {
                epos.set_remote(operational);
                if initialised {
                    epos.initialised();
                }
            }
            Kind::Icla(icla) => {
                icla.set_remote(operational);
                if initialised {
                    icla.initialised();
                }
            }
        }
    }

    fn written(&mut self, now: Instant, index: u16, body: &Body) {
        let emergency = match &mut self.kind {
            Kind::Epos(epos) => epos.written(now, index, self.node.dictionary()),
            Kind::Icla(icla) => icla.written(now, index, self.node.dictionary(), body),
        };
        self.report(emergency);
    }

    fn heartbeat_lost(&mut self) {
        let emergency = match &mut self.kind {
            Kind::Epos(epos) => epos.fault(epos::HEARTBEAT),
            Kind::Icla(icla) => Some(icla.heartbeat_lost()),
        };
        self.report(emergency);
    }

    /// The node has sent the emergency; the EPOS brakes as for any fault of communication.
    fn pdo_too_short(&mut self) {
        if let Kind::Epos(epos) = &mut self.kind {
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
        match &self.kind {
            Kind::Epos(epos) => epos.rests(),
            Kind::Icla(icla) => icla.rests(),
        }
    }

    /// Goes on by `dt` s; answers what the drive demands of the body: speed, m/s, or angle, rad.
    pub fn step(&mut self, now: Instant, body: &Body, dt: f64) -> Option<f64> {
        match &mut self.kind {
            Kind::Epos(epos) => {
                let rpm = epos.step(now, dt)?;
                let demand = rpm / 60.0 / body.parameters().motor_turns_per_metre();
                Some(self.disobeyed(now, demand, body))
            }
            Kind::Icla(icla) => icla.step(now, body, dt),
        }
    }

    /// After the body's step, in which the steering turned by `turned` rad/s.
    pub fn stepped(&mut self, now: Instant, body: &Body, turned: f64) {
        self.now = now;
        self.turned = turned;
        if let Kind::Epos(epos) = &mut self.kind {
            let emergency = epos.poll_fault();
            self.report(emergency);
        }
        self.measure(body);
        self.node.handle_timeout(now);
        self.serve(now, body);
    }

    /// Copies the drive's measurements to the node's objects.
    fn measure(&mut self, body: &Body) {
        match &mut self.kind {
            Kind::Epos(epos) => epos.feedback(&mut self.node, body),
            Kind::Icla(icla) => icla.feedback(&mut self.node, body, self.turned),
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
