//! A drive reduced to its objects, which obeys at once. Realistic behaviour is up to the simulator.

use base::can::{Frame, Id};
use base::{Duration, Instant};
use canopen::axis::drive::Drive;
use canopen::axis::{PowerState, status};
use canopen::drives::icla;
use canopen::{Dictionary, Node, NodeEvent};

pub struct Fake {
    pub node: Node,
    pub power: Drive,
    /// Takes part in the bus.
    pub alive: bool,
    /// Frames that it sends are lost, except heartbeats.
    pub mute: bool,
    /// All frames that it sends are lost.
    pub silent: bool,
    /// Its SDO server is silent.
    pub deaf: bool,
    /// Its motor does not turn, whatever it is commanded.
    pub blocked: bool,
    /// Added to the velocity that it measures while it turns, in its unit.
    pub misread: i64,
    /// Ignores its controlword, and the silence of the master.
    pub stubborn: bool,
    /// Number of homings begun.
    pub homings: u32,
    homing: Option<Instant>,
    bits: u16,
}

impl Fake {
    pub fn new(dictionary: Dictionary, quick_stop_option: i16) -> Self {
        let mut node = Node::new(dictionary, Duration::from_millis(5));
        node.power_on(Instant::ZERO);
        let power = Drive::new(quick_stop_option, true);
        Self {
            node,
            power,
            alive: true,
            mute: false,
            silent: false,
            deaf: false,
            blocked: false,
            misread: 0,
            stubborn: false,
            homings: 0,
            homing: None,
            bits: status::REMOTE,
        }
    }

    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        if self.alive {
            self.node.handle_rx(now, frame);
            self.serve(now);
        }
    }

    pub fn handle_timeout(&mut self, now: Instant) {
        if !self.alive {
            return;
        }
        if self.homing.is_some_and(|at| at <= now) {
            self.homing = None;
            self.bits |= status::MODE_12 | status::TARGET_REACHED | icla::HOMED;
            let home = self.node.get(0x607C, 0).unwrap_or(0);
            self.node.set(0x6064, 0, home);
        }
        self.node.handle_timeout(now);
        self.serve(now);
    }

    pub fn poll_tx(&mut self) -> Option<Frame> {
        while let Some(frame) = self.node.poll_tx() {
            let heartbeat = matches!(frame.id(), Id::Standard(id) if id & 0x780 == 0x700);
            let answer = matches!(frame.id(), Id::Standard(id) if id & 0x780 == 0x580);
            if self.alive && !self.silent && (heartbeat || !self.mute) && !(answer && self.deaf) {
                return Some(frame);
            }
        }
        None
    }

    /// Switches it off and on: it loses its reference.
    pub fn power_on(&mut self, now: Instant) {
        self.bits = status::REMOTE;
        self.homing = None;
        self.node.power_on(now);
    }

    /// Simulates an internal failure: the drive sends an emergency and stops.
    pub fn fault(&mut self, now: Instant, code: u16) {
        self.power.fault();
        self.power.fault_reaction_done();
        self.node.emergency(code, 0x20, [0; 5]);
        self.serve(now);
    }

    fn serve(&mut self, now: Instant) {
        while let Some(event) = self.node.poll_event() {
            match event {
                NodeEvent::ObjectWritten { index: 0x6040, .. } => self.obey(now),
                NodeEvent::ObjectWritten { index: 0x6060, .. } => {
                    let mode = self.get(0x6060);
                    self.node.set(0x6061, 0, mode);
                    self.bits &= !(status::MODE_12 | status::TARGET_REACHED);
                }
                NodeEvent::HeartbeatLost { .. } if !self.stubborn => self.fault(now, 0x8130),
                _ => {}
            }
        }
        let word = self.power.statusword() | self.bits;
        self.node.set(0x6041, 0, i64::from(word));
        self.node.handle_timeout(now);
    }

    fn obey(&mut self, now: Instant) {
        if self.stubborn {
            return;
        }
        let word = self.get(0x6040) as u16;
        self.power.apply(word);
        let enabled = self.power.state() == PowerState::OperationEnabled;
        match self.get(0x6061) {
            3 | 9 => {
                let velocity = if enabled && !self.blocked { self.get(0x60FF) } else { 0 };
                let misread = if velocity == 0 { 0 } else { self.misread };
                self.node.set(0x606C, 0, velocity + misread);
            }
            1 if enabled && word & 0x10 != 0 => {
                self.bits |= status::MODE_12;
                if !self.blocked {
                    let target = self.get(0x607A);
                    self.node.set(0x6064, 0, target);
                }
            }
            1 => self.bits &= !status::MODE_12,
            6 if enabled && word & 0x10 != 0 && self.homing.is_none() && self.bits & status::MODE_12 == 0 => {
                self.homings += 1;
                self.homing = Some(now + Duration::from_millis(100));
            }
            _ => {}
        }
    }

    fn get(&self, index: u16) -> i64 {
        self.node.get(index, 0).unwrap_or(0)
    }
}
