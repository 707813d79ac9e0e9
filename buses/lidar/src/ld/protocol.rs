//! Packets to sectors.

use super::Config;
use super::wire::{BAUD, CLOCK_MODULUS_MS, HEADER, LENGTH, Packet, SAMPLES, TYPE_AND_COUNT};
use crate::builder::{Builder, EIGHTHS, Sample, Step};
use crate::clock::Clock;
use crate::engine::{Optics, Progress, Protocol, Shared};
use crate::event::{Fault, LostReason};
use crate::framing::Framing;
use base::{Duration, Instant};
use core::f64::consts::TAU;
use heapless::Vec;

/// Time limit for the first packet.
const FIRST_WITHIN: Duration = Duration::from_millis(600);
/// Speeds in which the device measures, degrees per second: 5 Hz to 13 Hz (data sheets, "scan frequency").
const SPEED_DEG_PER_S: core::ops::RangeInclusive<u16> = 1800..=4680;
/// Samples of a packet may lie apart by at most this much more than the speed lets expect.
const SPREAD_MAX: f64 = 1.5;
/// Time on the wire of a packet.
const ON_WIRE: Duration = Duration::from_nanos(LENGTH as u64 * 10 * 1_000_000_000 / BAUD as u64);
/// Shortest and longest range, m (data sheets; the LD06 measures 12 m on white).
const RANGE_M: (f32, f32) = (0.02, 12.0);

/// The protocol of LDROBOT lidars.
#[derive(Debug)]
pub struct Packets {
    config: Config,
    rx: Vec<u8, LENGTH>,
    framing: Framing,
    clock: Clock,
    builder: Builder,
    /// When the first packet must have arrived.
    first_by: Option<Instant>,
}

/// True if this is the begin of a packet, as far as it goes.
fn may_begin(rx: &[u8]) -> bool {
    rx[0] == HEADER && rx.get(1).is_none_or(|byte| *byte == TYPE_AND_COUNT)
}

impl Packets {
    pub(super) fn new(config: Config) -> Self {
        Self {
            config,
            rx: Vec::new(),
            framing: Framing::default(),
            clock: Clock::new(u64::from(CLOCK_MODULUS_MS), 1_000_000),
            builder: Builder::new(true, EIGHTHS),
            first_by: None,
        }
    }

    fn take(&mut self, now: Instant, packet: &Packet, shared: &mut Shared) {
        shared.fault(Fault::Slow, !SPEED_DEG_PER_S.contains(&packet.speed));
        let samples_per_s = f64::from(self.config.model.samples_per_s());
        let spread = f64::from(packet.speed) * 100.0 * (SAMPLES - 1) as f64 / samples_per_s;
        let span = f64::from(packet.span());
        let Some(measured) = self.clock.at(now, u64::from(packet.timestamp_ms)) else {
            self.builder.reset();
            return shared.stale();
        };
        if packet.span() == 0 || span > spread * SPREAD_MAX {
            self.builder.reset();
            return shared.stale();
        }
        shared.accept();
        self.first_by = None;
        let step_rad = span / (SAMPLES - 1) as f64 / 36_000.0 * TAU;
        let sample_s = 1.0 / samples_per_s;
        // The last sample was measured when the packet began on the wire.
        let first = measured - ON_WIRE - Duration::from_secs_f64((SAMPLES - 1) as f64 * sample_s);
        for (n, sample) in packet.samples.iter().enumerate() {
            let range_m = f32::from(sample.range_mm) / 1000.0;
            let range_m = match sample.range_mm {
                0 => self.config.no_echo.range_m(),
                _ if range_m < RANGE_M.0 => f32::NEG_INFINITY,
                _ => range_m,
            };
            let angle_rad = f64::from(packet.start_angle) / 36_000.0 * TAU + n as f64 * step_rad;
            let at = first + Duration::from_secs_f64(n as f64 * sample_s);
            let sample = Sample { angle_rad, at, range_m, intensity: sample.intensity.into() };
            self.builder.push(sample, Step { angle_rad: step_rad, time_s: sample_s }, shared);
        }
    }
}

impl Protocol for Packets {
    fn start(&mut self, now: Instant, _: &mut Shared) {
        self.rx.clear();
        self.framing.reset();
        self.clock.reset();
        self.builder.reset();
        self.first_by = Some(now + FIRST_WITHIN);
    }

    fn handle_rx(&mut self, now: Instant, bytes: &[u8], shared: &mut Shared) -> Progress {
        for byte in bytes {
            // There is room: a full buffer is emptied below.
            let _ = self.rx.push(*byte);
            while !self.rx.is_empty() {
                if may_begin(&self.rx) && self.rx.len() < LENGTH {
                    break;
                }
                let packet = <&[u8; LENGTH]>::try_from(&self.rx[..]).ok().and_then(Packet::decode);
                if let Some(packet) = packet {
                    self.rx.clear();
                    self.framing.found();
                    self.take(now, &packet, shared);
                } else {
                    self.framing.skip(&mut self.rx, LENGTH, may_begin, shared);
                }
            }
        }
        Progress::Pending
    }

    fn handle_timeout(&mut self, now: Instant, _: &mut Shared) -> Progress {
        if self.first_by.is_some_and(|by| by <= now) {
            self.first_by = None;
            return Progress::Lost(LostReason::Silent);
        }
        Progress::Pending
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.first_by
    }

    fn optics(&self) -> Optics {
        let rate_min_hz = f64::from(*SPEED_DEG_PER_S.start()) / 360.0;
        Optics { range_min_m: RANGE_M.0, range_max_m: RANGE_M.1, view_rad: TAU, rate_min_hz }
    }
}
