//! What a drive with a CANopen node is made of: the node with its objects, and an EPOS, an IclA, or a drive by its data
//! sheet behind them.

use super::cia402::Cia402;
use super::drive::{Axis, DriveConfig, DriveKind, Layout};
use super::encoder::{Encoder, Reading};
use super::epos::{self, Emergency, Epos};
use super::icla::Icla;
use crate::body::Body;
use base::can::Frame;
use base::{Duration, Instant};
use canopen::{Dictionary, NmtState, Node, NodeEvent};

/// From power or reset to the boot-up message.
const BOOT_TIME: Duration = Duration::from_millis(100);

/// What is behind the objects.
enum Device {
    Epos(Epos),
    Icla(Icla),
    Cia402(Box<Cia402>),
}

/// Digital inputs that are no limit or reference switches (CiA 402: bits 0 to 2): closed, unless one is opened.
const CLOSED: i64 = 0xFFFF_FFF8;

/// A node and what is behind it.
pub(super) struct CanopenDrive {
    device: Device,
    layout: Layout,
    node: Node,
    turned: f64,
    /// Of a wheel.
    pub encoder: Option<Encoder>,
    /// A digital input that is open, and until when.
    opened: Option<(u8, Instant)>,
}

impl CanopenDrive {
    /// A drive of `body` with these objects, switched off; `None`: this kind is no CANopen node.
    pub fn new(config: &DriveConfig, body: &Body) -> Option<Self> {
        let dictionary = config.kind.dictionary(config.node)?;
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
            DriveKind::Controller { .. } => return None,
        };
        let node = node(dictionary);
        Some(Self { device, layout: Layout::Usual, node, turned: 0.0, encoder, opened: None })
    }

    /// Switches it on, or off and on again.
    pub fn power_on(&mut self, now: Instant, body: &Body) {
        self.node.power_on(now);
        self.renew(body);
        self.serve(now, body);
    }

    /// Replaces it by one of its kind with this mapping; false if there is none.
    pub fn set_layout(&mut self, now: Instant, layout: Layout, config: &DriveConfig, body: &Body) -> bool {
        let (kind, id) = (&config.kind, config.node);
        let (Some(other), Some(usual)) = (kind.other_version(id), kind.dictionary(id)) else {
            return false;
        };
        if self.layout != layout {
            self.layout = layout;
            self.node = node(if layout == Layout::Other { other } else { usual });
            self.power_on(now, body);
        }
        true
    }

    fn renew(&mut self, body: &Body) {
        let reading = read(self.encoder.as_ref(), body);
        match &mut self.device {
            Device::Epos(epos) => epos.renew(self.node.dictionary()),
            Device::Icla(icla) => icla.renew(self.node.dictionary(), body),
            Device::Cia402(cia402) => cia402.renew(&mut self.node, body, reading),
        }
    }

    pub fn handle_rx(&mut self, now: Instant, frame: &Frame, body: &Body) {
        self.node.handle_rx(now, frame);
        self.serve(now, body);
    }

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
        while self.pass_news(now, body) {
            self.measure(now, body);
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

    pub fn rests(&self) -> bool {
        // The end of an open input is noticed by a step.
        self.opened.is_none()
            && match &self.device {
                Device::Epos(epos) => epos.rests(),
                Device::Icla(icla) => icla.rests(),
                Device::Cia402(cia402) => cia402.rests(),
            }
    }

    /// Goes on by `dt` s; answers what it demands of its axis.
    pub fn step(&mut self, now: Instant, body: &Body, dt: f64) -> Option<f64> {
        match &mut self.device {
            Device::Epos(epos) => epos.step(now, body, dt),
            Device::Icla(icla) => icla.step(now, body, dt),
            Device::Cia402(cia402) => cia402.step(now, body, dt),
        }
    }

    /// After the body's step, in which the steering turned by `turned` rad/s.
    pub fn stepped(&mut self, now: Instant, body: &Body, turned: f64) {
        self.turned = turned;
        let emergency = match &mut self.device {
            Device::Epos(epos) => epos.poll_fault(),
            Device::Cia402(cia402) => cia402.poll_fault(),
            Device::Icla(_) => None,
        };
        self.report(emergency);
        self.measure(now, body);
        self.node.handle_timeout(now);
        self.serve(now, body);
    }

    /// Copies the drive's measurements to the node's objects.
    fn measure(&mut self, now: Instant, body: &Body) {
        let reading = read(self.encoder.as_ref(), body);
        self.opened.take_if(|(_, until)| *until <= now);
        let inputs = self.opened.map_or(CLOSED, |(bit, _)| CLOSED & !(1 << bit));
        match &mut self.device {
            Device::Epos(epos) => epos.feedback(&mut self.node, body, reading),
            Device::Icla(icla) => icla.feedback(&mut self.node, body, self.turned, inputs),
            Device::Cia402(cia402) => cia402.feedback(now, &mut self.node, body, (self.turned, inputs), reading),
        }
    }

    /// Opens a digital input until then, or closes all; false for a drive that has none.
    pub fn open(&mut self, bit: Option<u8>, until: Instant) -> bool {
        match (bit, &mut self.opened) {
            (Some(bit), opened) => *opened = Some((bit, until)),
            (None, Some((_, end))) => *end = until,
            (None, None) => {}
        }
        self.node.get(0x60FD, 0).is_some()
    }

    pub fn poll_tx(&mut self) -> Option<Frame> {
        self.node.poll_tx()
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        self.node.poll_timeout()
    }
}

/// What the encoder of a wheel reads; nothing of the steering.
fn read(encoder: Option<&Encoder>, body: &Body) -> Reading {
    encoder.map_or_else(Reading::default, |encoder| encoder.read(body))
}

fn node(dictionary: Dictionary) -> Node {
    Node::new(dictionary, BOOT_TIME).without_block()
}
