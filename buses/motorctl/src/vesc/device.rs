//! The other end: a VESC with its motor, by the source of the firmware that [`super`] names. For the simulator and for
//! tests.
//!
//! Assumed: the configuration behind its first fields is zeros; a brake current brakes with the strongest torque.

use super::payload::{Request, Values};
use super::{Device as Identity, Link};
use crate::motor::{Drive, Motor};
use base::{Duration, Instant, Ticker};
use heapless::Vec;

/// Interval at which the device checks its timeout.
const CHECK: Duration = Duration::from_millis(10);
/// Bytes of the application's configuration with its command; the real length differs from version to version.
const APPCONF_LEN: usize = 400;
/// Signature of the configuration in firmware 7.01.
const SIGNATURE: u32 = 982_638_166;
/// COMM_FW_VERSION and COMM_GET_APPCONF.
const FIRMWARE: u8 = 0;
const APPCONF: u8 = 17;

/// Default of `m_fault_stop_time_ms` in the firmware.
pub const FAULT_STOP: Duration = Duration::from_millis(500);

/// What is wrong with the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Neither receives nor sends; the motor runs on as the timeout lets it.
    pub unplugged: bool,
    /// Receives, acts, and does not answer.
    pub mute: bool,
    /// The timeout is configured, and never acts.
    pub timeout_dead: bool,
    /// Receives questions only.
    pub deaf: bool,
}

/// A VESC.
#[derive(Debug)]
pub struct Device<L> {
    identity: Identity,
    link: L,
    /// What is wrong with it.
    pub faults: Faults,
    /// Its motor.
    pub motor: Motor,
    /// Major and minor version of the firmware.
    pub firmware: [u8; 2],
    /// Kind of hardware.
    pub kind: u8,
    /// Timeout, ms; 0: none.
    pub timeout_ms: u32,
    /// Brake current when it acts, A.
    pub brake_current_a: f32,
    /// Kill switch.
    pub killed: bool,
    /// Tachometer at power-on.
    pub offset: i32,
    /// Time for which a fault holds the motor free and is reported (`m_fault_stop_time_ms`); 0: until it is cleared.
    pub fault_stop: Duration,
    fault: u8,
    /// When the fault was first seen by [`Self::handle_timeout`].
    faulted: Option<Instant>,
    commanded: Instant,
    timed_out: bool,
    check: Ticker,
}

impl<L: Link> Device<L> {
    /// A device at power-on, with firmware 6.05 and a timeout of 200 ms, after which it brakes with 10 A.
    #[must_use]
    pub fn new(identity: Identity, link: L) -> Self {
        Self {
            identity,
            link,
            faults: Faults::default(),
            motor: Motor::new(),
            firmware: [6, 5],
            kind: super::payload::MOTOR_CONTROLLER,
            timeout_ms: 200,
            brake_current_a: 10.0,
            killed: false,
            offset: 0,
            fault_stop: Duration::ZERO,
            fault: 0,
            faulted: None,
            commanded: Instant::ZERO,
            timed_out: true,
            check: Ticker::new(Instant::ZERO, CHECK),
        }
    }

    /// Raises a fault, or clears it with 0; the motor is released.
    pub fn raise(&mut self, fault: u8) {
        (self.fault, self.faulted) = (fault, None);
        self.motor.drive = Drive::Free;
    }

    /// True while the timeout acts.
    #[must_use]
    pub fn is_timed_out(&self) -> bool {
        self.timed_out
    }

    /// Takes a frame, or bytes.
    pub fn handle_rx(&mut self, now: Instant, rx: &L::Rx) {
        if self.faults.unplugged {
            return;
        }
        self.handle_timeout(now);
        let mut requests: Vec<Request, 16> = Vec::new();
        self.link.receive(now, rx, &mut |payload| {
            // More than there is room for are lost, as in the device.
            Request::decode(payload).into_iter().for_each(|request| _ = requests.push(request));
        });
        requests.into_iter().for_each(|request| self.execute(now, request));
    }

    fn execute(&mut self, now: Instant, request: Request) {
        match request {
            Request::Firmware => self.answer_firmware(),
            Request::AppConf => self.answer_appconf(),
            Request::Values => {
                let bytes = self.values().bytes();
                self.answer(&bytes);
            }
            _ if self.faults.deaf => {}
            Request::SetCurrent(_) => self.command(now, Drive::Free),
            Request::SetBrake(current) => self.command(now, brake(current)),
            Request::SetRpm(erpm) => {
                let erpm = f64::from(erpm);
                let is_slow = erpm.abs() < self.identity.erpm_min;
                let turns = erpm / self.identity.erpm_per_turn();
                self.command(now, if is_slow { Drive::Free } else { Drive::Velocity(turns) });
            }
        }
    }

    fn command(&mut self, now: Instant, drive: Drive) {
        self.commanded = now;
        if self.fault == 0 && !self.killed {
            self.motor.drive = drive;
        }
    }

    fn values(&self) -> Values {
        let steps = libm::round(self.motor.turns() * self.identity.steps_per_turn()) as i64;
        Values {
            temperature_dc: 330,
            current_ca: 120,
            erpm: libm::round(self.motor.measured() * self.identity.erpm_per_turn()) as i32,
            supply_dv: 241,
            // The tachometer wraps at 32 bits.
            tachometer: (steps + i64::from(self.offset)) as i32,
            fault: self.fault,
            id: self.identity.id,
            timed_out: self.timed_out,
            killed: self.killed,
        }
    }

    fn answer(&mut self, payload: &[u8]) {
        if !self.faults.mute {
            self.link.send(payload);
        }
    }

    fn answer_firmware(&mut self) {
        let [major, minor] = self.firmware;
        let head = [FIRMWARE, major, minor].into_iter().chain(*b"60_MK5\0");
        // The processor's number, pairing and test version.
        let bytes: Vec<u8, 64> = head.chain([0xAB; 12]).chain([0, 0, self.kind, 0]).collect();
        self.answer(&bytes);
    }

    fn answer_appconf(&mut self) {
        let head = [APPCONF].into_iter().chain(SIGNATURE.to_be_bytes()).chain([self.identity.id]);
        let fields = head.chain(self.timeout_ms.to_be_bytes()).chain(self.brake_current_a.to_be_bytes());
        let bytes: Vec<u8, APPCONF_LEN> = fields.chain(core::iter::repeat(0)).take(APPCONF_LEN).collect();
        self.answer(&bytes);
    }

    /// Moves the motor, and checks the timeout.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.motor.advance(now);
        if !self.check.due(now) {
            return;
        }
        if self.fault != 0 && !self.fault_stop.is_zero() {
            let since = *self.faulted.get_or_insert(now);
            if now.since(since) >= self.fault_stop {
                self.raise(0);
            }
        }
        let limit = Duration::from_millis(self.timeout_ms.into());
        let is_over = self.timeout_ms != 0 && now.since(self.commanded) > limit && !self.faults.timeout_dead;
        self.timed_out = is_over;
        if is_over && self.fault == 0 {
            self.motor.drive = brake(self.brake_current_a.into());
        }
    }

    /// Next output.
    pub fn poll_tx(&mut self) -> Option<L::Tx> {
        let tx = self.link.poll_tx()?;
        (!self.faults.unplugged).then_some(tx)
    }

    /// Instant of the next [`Self::handle_timeout`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        Some(self.check.next())
    }
}

fn brake(current_a: f64) -> Drive {
    if current_a > 0.0 { Drive::Brake } else { Drive::Free }
}
