//! The start-up of a YDLIDAR, and its packets to sectors.

use super::wire::{
    self, LENGTH_MAX, Packet, RATES, TURN_Q6, ahead_q6, answer, command, correction_rad, far_rad, radians,
};
use super::{Config, Model, serial};
use crate::builder::{Builder, SIXTEENTHS, Sample, Step};
use crate::dialog::{Dialog, Received};
use crate::engine::{Bytes, Optics, Progress, Protocol, Shared};
use crate::event::{Fault, Health, LostReason, text};
use crate::framing::Framing;
use crate::rplidar::wire::{Descriptor, Info, encode};
use base::{Duration, Instant};
use core::f64::consts::TAU;
use core::ops::RangeInclusive;
use heapless::Vec;

/// Time limit of the first packet after a scan was asked for: the motor spins up.
const DATA_WITHIN: Duration = Duration::from_millis(3000);
/// Speed of the motor, Hz: 5 Hz to 12 Hz (*Dataset*), and a tenth for the angles of one packet.
const RATE_HZ: RangeInclusive<f64> = 4.5..=13.2;
/// A packet whose samples are farther apart than at this speed is not believed, Hz.
const RATE_MAX_HZ: f64 = 25.0;
/// Samples of a packet by which the speed is judged.
const JUDGED: usize = 8;
/// A packet begins at most so far before the end of the last one, 1/64°: angles are rounded.
const BEHIND_Q6: u16 = 64;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Ask {
    Info,
    Health,
    Rate,
    Scan,
}

impl Ask {
    fn command(self) -> Bytes {
        let command = match self {
            Self::Info => command::GET_INFO,
            Self::Health => command::GET_HEALTH,
            Self::Rate => command::GET_RATE,
            Self::Scan => command::SCAN,
        };
        encode(command, &[])
    }
}

/// The protocol of YDLIDARs.
#[derive(Debug)]
pub struct Commands {
    config: Config,
    dialog: Dialog<Ask>,
    /// A device that reported an error was restarted.
    was_restarted: bool,
    samples_per_s: u32,
    range_min_m: f32,
    rx: Vec<u8, LENGTH_MAX>,
    framing: Framing,
    /// Angles of the first and the last sample of the last packet, 1/64°.
    ends: Option<(u16, u16)>,
    /// From one sample to the next, rad, by the last packet that was long enough.
    step_rad: Option<f64>,
    /// Revolutions per second, by the device, Hz.
    said_hz: Option<f64>,
    builder: Builder,
}

impl Commands {
    pub(super) fn new(config: Config) -> Self {
        Self {
            config,
            dialog: Dialog::new(Ask::Info),
            was_restarted: false,
            samples_per_s: config.model.samples_per_s(),
            range_min_m: config.model.range_m().0,
            rx: Vec::new(),
            framing: Framing::default(),
            ends: None,
            step_rad: None,
            said_hz: None,
            builder: Builder::new(true, SIXTEENTHS),
        }
    }

    fn ask(&mut self, now: Instant, ask: Ask, shared: &mut Shared) -> Progress {
        self.dialog.ask(now, ask, ask.command(), shared)
    }

    fn answered(
        &mut self,
        now: Instant,
        ask: Ask,
        descriptor: Descriptor,
        answer: &[u8],
        shared: &mut Shared,
    ) -> Progress {
        shared.accept();
        match (ask, descriptor.kind, answer) {
            (Ask::Info, answer::VALUE, bytes) => match Info::decode(bytes) {
                Some(info) => self.identified(now, &info, shared),
                None => self.unfit(shared),
            },
            (Ask::Health, answer::HEALTH, [status, low, high]) => {
                self.healthy(now, *status, u16::from_le_bytes([*low, *high]).into(), shared)
            }
            (Ask::Rate, answer::VALUE, [number]) => {
                let Some((samples_per_s, range_min_m)) = RATES.get(usize::from(*number)) else {
                    return Progress::Lost(LostReason::Refused { code: u32::from(*number) });
                };
                (self.samples_per_s, self.range_min_m) = (*samples_per_s, *range_min_m);
                shared.optics = self.optics();
                self.ask(now, Ask::Scan, shared)
            }
            (Ask::Scan, answer::PACKETS, _) if descriptor.many => self.dialog.scan(now + DATA_WITHIN),
            _ => self.unfit(shared),
        }
    }

    /// An answer that does not fit; the command is repeated when its time is over.
    fn unfit(&mut self, shared: &mut Shared) -> Progress {
        shared.reject();
        Progress::Pending
    }

    fn identified(&mut self, now: Instant, info: &Info, shared: &mut Shared) -> Progress {
        let (major, minor) = info.firmware;
        let serial = serial(info);
        shared.identify(text(format_args!(
            "YDLIDAR model {} firmware {major}.{minor} hardware {} serial {}",
            info.model,
            info.hardware,
            core::str::from_utf8(&serial).unwrap_or_default()
        )));
        if !self.config.model.may_have(info.model) {
            return Progress::Lost(LostReason::Identity);
        }
        self.ask(now, Ask::Health, shared)
    }

    fn healthy(&mut self, now: Instant, status: u8, code: u32, shared: &mut Shared) -> Progress {
        let health = match status {
            0 => Health::Good,
            1 => Health::Warning { code },
            _ => Health::Error { code },
        };
        shared.health(health);
        if matches!(health, Health::Error { .. }) {
            if !self.was_restarted {
                shared.send(&encode(self.config.model.restart(), &[]));
            }
            self.was_restarted = !self.was_restarted;
            return Progress::Lost(LostReason::Device { code });
        }
        self.was_restarted = false;
        let ask = match self.config.model {
            Model::X4 => Ask::Scan,
            Model::G4 => Ask::Rate,
        };
        self.ask(now, ask, shared)
    }

    fn take_data(&mut self, now: Instant, byte: u8, shared: &mut Shared) {
        let samples_max = self.config.model.samples_max();
        // There is room: a whole packet is taken below.
        let _ = self.rx.push(byte);
        while !self.rx.is_empty() {
            let may_begin = Packet::may_begin(&self.rx, samples_max);
            let is_whole = Packet::length(&self.rx).is_some_and(|length| length <= self.rx.len());
            if may_begin && !is_whole {
                return;
            }
            match Packet::decode(&self.rx).filter(|_| may_begin) {
                Some(packet) => {
                    self.rx.clear();
                    self.framing.found();
                    self.dialog.scanned();
                    self.take(now, &packet, shared);
                }
                None => {
                    let may_begin = |rest: &[u8]| Packet::may_begin(rest, samples_max);
                    self.framing.skip(&mut self.rx, LENGTH_MAX, may_begin, shared);
                }
            }
        }
    }

    fn take(&mut self, now: Instant, packet: &Packet, shared: &mut Shared) {
        let count = packet.samples.len();
        let ends = (packet.first_q6, packet.last_q6);
        let is_behind = |(_, last): (u16, u16)| {
            let ahead = ahead_q6(last, packet.first_q6);
            (TURN_Q6 / 2..TURN_Q6 - BEHIND_Q6).contains(&ahead)
        };
        let before = self.ends.replace(ends);
        if before == Some(ends) || before.is_some_and(is_behind) || count > 1 && packet.span_q6() == 0 {
            // It is repeated, or the motor stands.
            self.builder.reset();
            return shared.stale();
        }
        let step_rad = radians(f64::from(packet.span_q6())) / (count - 1).max(1) as f64;
        let rate_hz = step_rad / TAU * f64::from(self.samples_per_s);
        if rate_hz > RATE_MAX_HZ {
            self.builder.reset();
            return shared.reject();
        }
        shared.accept();
        if packet.speed > 0 {
            self.said_hz = Some(f64::from(packet.speed) / 10.0);
        }
        if count >= JUDGED {
            self.step_rad = Some(step_rad);
            let is_slow = |rate_hz: f64| !RATE_HZ.contains(&rate_hz);
            shared.fault(Fault::Slow, is_slow(rate_hz) || self.said_hz.is_some_and(is_slow));
        }
        self.take_samples(now, packet, step_rad, shared);
    }

    fn take_samples(&mut self, now: Instant, packet: &Packet, step_rad: f64, shared: &mut Shared) {
        let Some(usual_rad) = self.step_rad else { return };
        let (count, period_s) = (packet.samples.len(), 1.0 / f64::from(self.samples_per_s));
        let on_wire_s = (wire::HEAD + 2 * count) as f64 * 10.0 / f64::from(self.config.model.baud());
        // The last sample was measured when the packet began on the wire.
        let first = now - Duration::from_secs_f64(on_wire_s + count as f64 * period_s);
        let step = Step { angle_rad: usual_rad, time_s: period_s };
        for (n, range) in packet.samples.iter().enumerate() {
            let range_mm = f64::from(*range) / 4.0;
            let head_rad = radians(f64::from(packet.first_q6)) + n as f64 * step_rad;
            let at = first + Duration::from_secs_f64(n as f64 * period_s);
            let angle_rad = head_rad + self.beside_rad(range_mm);
            let intensity = if *range > 0 { 1.0 } else { 0.0 };
            self.builder.push(Sample { angle_rad, at, range_m: self.range_m(range_mm), intensity }, step, shared);
        }
    }

    /// Angle from the head to what was measured, rad clockwise. A beam that met nothing points to where it would have
    /// met something far away; a range below the shortest one counts as that, since the angle of a range near 0 would
    /// be anywhere.
    fn beside_rad(&self, range_mm: f64) -> f64 {
        if range_mm > 0.0 { correction_rad(range_mm.max(f64::from(self.range_min_m) * 1000.0)) } else { far_rad() }
    }

    fn range_m(&self, range_mm: f64) -> f32 {
        let range_m = (range_mm / 1000.0) as f32;
        match range_m {
            _ if range_m <= 0.0 => self.config.no_echo.range_m(),
            _ if range_m < self.range_min_m => f32::NEG_INFINITY,
            _ => range_m,
        }
    }
}

impl Protocol for Commands {
    fn start(&mut self, now: Instant, shared: &mut Shared) {
        self.rx.clear();
        self.framing.reset();
        (self.ends, self.step_rad, self.said_hz) = (None, None, None);
        self.builder.reset();
        self.dialog.start(now, &encode(command::STOP, &[]), Ask::Info, Ask::Info.command(), shared);
    }

    fn handle_rx(&mut self, now: Instant, bytes: &[u8], shared: &mut Shared) -> Progress {
        for byte in bytes {
            match self.dialog.receive(*byte, shared) {
                Received::Nothing => {}
                Received::Data => self.take_data(now, *byte, shared),
                Received::Answer { ask, descriptor, bytes } => {
                    let progress = self.answered(now, ask, descriptor, &bytes, shared);
                    if progress != Progress::Pending {
                        return progress;
                    }
                }
            }
        }
        Progress::Pending
    }

    fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) -> Progress {
        self.dialog.handle_timeout(now, shared)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.dialog.poll_timeout()
    }

    fn optics(&self) -> Optics {
        let range_max_m = self.config.model.range_m().1;
        Optics { range_min_m: self.range_min_m, range_max_m, view_rad: TAU, rate_min_hz: *RATE_HZ.start() }
    }
}
