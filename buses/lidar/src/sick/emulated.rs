//! The other end: an LMS1xx, TiM5xx or TiM7xx that answers and scans.
//!
//! Its fields are polygons, evaluated with each scan: what it measures in one infringes it. Each has an output of the
//! same number, which is active while the field is free; further outputs are not used.
//!
//! Assumed, where the listing is silent: results and outputs are sent when they change, and once when they are asked
//! for; without a valid measurement a field is not valid. A TiM5xx sends no results.

use super::Family;
use super::wire::{Dialect, ETX, HEADER_B, Reader, STX, TELEGRAM_MAX, Writer, checksum};
use crate::emulated::{Faults, Line, Scene};
use alloc::vec;
use alloc::vec::Vec;
use base::{Duration, Instant, earliest};
use core::f64::consts::{FRAC_PI_2, TAU};

/// Corners of a field, m: forward from the device's front, and to the left.
pub type Field = Vec<[f32; 2]>;

/// Its serial number.
const SERIAL: &str = "18520122";
/// Outputs that it has, used or not.
const OUTPUTS: usize = 4;
/// Range up to which it measures, m.
const REACH_M: f32 = 20.0;
/// Request at most.
const REQUEST_MAX: usize = 200;

/// A device.
#[derive(Debug)]
pub struct Device {
    family: Family,
    dialect: Dialect,
    faults: Faults,
    scene: Scene,
    line: Line,
    rx: heapless::Vec<u8, REQUEST_MAX>,
    sends: Sends,
    /// An LMS1xx measures after it was started.
    measures: bool,
    logged_in: bool,
    next: Option<Instant>,
    numbers: (u16, u16),
    fields: Vec<Field>,
    /// Results of the fields; empty before the first scan for somebody who asked for them.
    results: Vec<u8>,
}

/// What is asked for.
#[derive(Clone, Copy, Debug, Default)]
struct Sends {
    scans: bool,
    results: bool,
    outputs: bool,
}

impl Device {
    /// A device at power-on, with one field: a square of 2 m around it.
    #[must_use]
    pub fn new(family: Family, dialect: Dialect) -> Self {
        Self {
            family,
            dialect,
            faults: Faults::default(),
            scene: Scene::default(),
            // Bytes per second: twice what it sends as text.
            line: Line::new(match family {
                Family::Lms1xx | Family::Tim7xx => 200_000,
                Family::Tim5xx => 60_000,
            }),
            rx: heapless::Vec::new(),
            sends: Sends::default(),
            measures: family != Family::Lms1xx,
            logged_in: false,
            next: None,
            numbers: (0, 0),
            fields: vec![vec![[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]],
            results: Vec::new(),
        }
    }

    /// The same with these fields, by number from 1.
    #[must_use]
    pub fn with_fields(self, fields: Vec<Field>) -> Self {
        Self { fields, ..self }
    }

    /// Scans per second, 1/100 Hz; first direction and step, 1/10000°; number of beams.
    fn figures(&self) -> (u32, i32, u16, u16) {
        match self.family {
            Family::Lms1xx => (2500, -450_000, 5000, 541),
            Family::Tim5xx => (1500, -450_000, 10_000, 271),
            Family::Tim7xx => (1500, -450_000, 3333, 811),
        }
    }

    fn new_telegram(&self, name: &str) -> Writer<TELEGRAM_MAX> {
        Writer::new(self.dialect, name)
    }

    fn send(&mut self, telegram: Writer<TELEGRAM_MAX>) {
        self.line.send(&telegram.frame(), &self.faults);
    }

    fn serve(&mut self, now: Instant, telegram: &[u8]) {
        if self.faults.hangs {
            return;
        }
        let dialect = self.dialect;
        let is = |name| Reader::new(dialect, telegram, name);
        if self.faults.refuses {
            let refused = self.new_telegram("sFA").blank();
            return self.send(if dialect == Dialect::Text { refused.u8(3) } else { refused.u16(3) });
        }
        let answer = if is("sRN DeviceIdent").is_some() {
            let name = match (self.faults.stranger, self.family) {
                (true, _) => "NAV350-3232",
                (_, Family::Lms1xx) => "LMS10x_FieldEval",
                (_, Family::Tim5xx) => "TiM551-2050001  ",
                (_, Family::Tim7xx) => "TiM781-2174101  ",
            };
            self.new_telegram("sRA DeviceIdent").blank().text(name).text("V2.46-18.12.13")
        } else if is("sRN SerialNumber").is_some() {
            self.new_telegram("sRA SerialNumber").blank().text(SERIAL)
        } else if is("sRN LMPscancfg").is_some() {
            // One sector: frequency, sectors, resolution, first and last direction.
            let (frequency, start, step, count) = self.figures();
            let last = start + i32::from(step) * (i32::from(count) - 1);
            let telegram = self.new_telegram("sRA LMPscancfg").blank().u32(frequency).u16(1).u32(step.into());
            telegram.u32(start.cast_unsigned()).u32(last.cast_unsigned())
        } else if is("sRN SCdevicestate").is_some() {
            self.new_telegram("sRA SCdevicestate").blank().u8(if self.faults.error { 2 } else { 1 })
        } else if let Some(mut values) = is("sMN SetAccessMode") {
            self.logged_in = values.u8() == Some(3) && values.u32() == Some(0xF472_4744);
            self.new_telegram("sAN SetAccessMode").blank().u8(u8::from(self.logged_in))
        } else if is("sMN LMCstartmeas").is_some() && self.logged_in {
            self.measures = true;
            self.new_telegram("sAN LMCstartmeas").blank().u8(0)
        } else if is("sMN Run").is_some() {
            self.logged_in = false;
            self.new_telegram("sAN Run").blank().u8(1)
        } else if let Some(mut values) = is("sEN LMDscandata") {
            self.sends.scans = values.u8() == Some(1);
            self.next = self.sends.scans.then_some(now + self.period());
            self.new_telegram("sEA LMDscandata").blank().u8(u8::from(self.sends.scans))
        } else if let Some(mut values) = is("sEN LFErec").filter(|_| self.family != Family::Tim5xx) {
            self.sends.results = values.u8() == Some(1);
            self.results.clear();
            self.new_telegram("sEA LFErec").blank().u8(u8::from(self.sends.results))
        } else if let Some(mut values) = is("sEN LIDoutputstate") {
            self.sends.outputs = values.u8() == Some(1);
            self.results.clear();
            self.new_telegram("sEA LIDoutputstate").blank().u8(u8::from(self.sends.outputs))
        } else if is("sRN LFErec").filter(|_| self.family != Family::Tim5xx).is_some() {
            self.result_telegram("sRA LFErec")
        } else if is("sRN LIDoutputstate").is_some() {
            self.output_telegram("sRA LIDoutputstate", now)
        } else if is("sRN LCMstate").filter(|_| self.family != Family::Tim7xx).is_some() {
            let level = match self.faults {
                Faults { blocked: true, .. } => 2,
                Faults { dirty: true, .. } => 1,
                _ => 0,
            };
            self.new_telegram("sRA LCMstate").blank().u8(level)
        } else {
            let refused = self.new_telegram("sFA").blank();
            if dialect == Dialect::Text { refused.u8(1) } else { refused.u16(1) }
        };
        self.send(answer);
    }

    fn period(&self) -> Duration {
        let period = Duration::from_secs_f64(100.0 / f64::from(self.figures().0));
        if self.faults.motor_slow { period * 2 } else { period }
    }

    fn scan(&mut self, at: Instant) {
        let (frequency, start, step, count) = self.figures();
        let status = match self.faults {
            Faults { blocked: true, .. } => 5,
            Faults { dirty: true, .. } => 2,
            Faults { error: true, .. } => 1,
            _ => 0,
        };
        self.numbers = (self.numbers.0.wrapping_add(1), self.numbers.1.wrapping_add(1));
        let us = (at.as_nanos() / 1000) as u32;
        let period_us = 100_000_000 / frequency;
        let angle = |n: u16| (f64::from(start) + f64::from(n) * f64::from(step)) / 3_600_000.0 * TAU - FRAC_PI_2;
        let range_m = |n: u16| self.scene.range_m(angle(n));
        let range_mm = |n: u16| match range_m(n) {
            range if range < REACH_M && !self.faults.blocked => libm::roundf(range * 1000.0) as u16,
            _ => 0,
        };
        let telegram = self
            .new_telegram("sSN LMDscandata")
            .blank()
            .u16(1)
            .u16(1)
            .u32(0x0107_375C)
            .u8(0)
            .u8(status)
            .u16(self.numbers.0)
            .u16(self.numbers.1)
            .u32(us.wrapping_sub(period_us))
            .u32(us)
            .u8(0)
            .u8(0)
            .u8(7)
            .u8(0)
            .u16(0)
            .u32(frequency)
            .u32(frequency * 360 / u32::from(step))
            .u16(0)
            .u16(1)
            .fixed("DIST1")
            .u32(0x3F80_0000)
            .u32(0)
            .u32(start.cast_unsigned())
            .u16(step)
            .u16(count)
            .samples(true, (0..count).map(range_mm))
            .u16(1)
            .fixed("RSSI1")
            .u32(0x3F80_0000)
            .u32(0)
            .u32(start.cast_unsigned())
            .u16(step)
            .u16(count)
            .samples(false, (0..count).map(|n| if range_mm(n) > 0 { 0x9A } else { 0 }));
        // No position; no name; no comment; no time; no event.
        let telegram = telegram.u16(0).u16(0).u16(0).u16(0).u16(0);
        self.send(telegram);
        if self.sends.results || self.sends.outputs {
            self.evaluate(at);
        }
    }

    /// Evaluates the fields by what it measures, and reports a change.
    fn evaluate(&mut self, now: Instant) {
        let (_, start, step, count) = self.figures();
        let point = |n: u16| {
            let angle = (f64::from(start) + f64::from(n) * f64::from(step)) / 3_600_000.0 * TAU - FRAC_PI_2;
            let (sin, cos) = libm::sincos(angle);
            let range = self.scene.range_m(angle);
            (range < REACH_M).then_some([range * cos as f32, range * sin as f32])
        };
        let points: Vec<[f32; 2]> = (0..count).filter_map(point).collect();
        let measures = !self.faults.blocked && !self.faults.error;
        let result = |field: &Field| match points.iter().any(|point| contains(field, *point)) {
            _ if !measures => 0,
            false => 1,
            true => 2,
        };
        let results: Vec<u8> = self.fields.iter().map(result).collect();
        if results == self.results {
            return;
        }
        self.results = results;
        if self.sends.results {
            self.send(self.result_telegram("sSN LFErec"));
        }
        if self.sends.outputs {
            self.send(self.output_telegram("sSN LIDoutputstate", now));
        }
    }

    /// Telegram with the results of its fields.
    fn result_telegram(&self, name: &str) -> Writer<TELEGRAM_MAX> {
        let telegram = self.new_telegram(name).blank().u16(self.results.len() as u16);
        (1..).zip(&self.results).fold(telegram, |telegram, (number, result)| {
            let telegram = telegram.u16(1).u8(number).u32(0).u32(0x3F80_0000).u32(0).u32(0xD05);
            let telegram = telegram.u32((-450_000_i32).cast_unsigned()).u8(*result).u16(0).u16(0).u16(0);
            telegram.u16(1).u16(1970).u8(1).u8(1).u8(8).u8(51).u8(46).u32(634_000)
        })
    }

    /// Telegram with the states of its outputs.
    fn output_telegram(&self, name: &str, now: Instant) -> Writer<TELEGRAM_MAX> {
        let telegram = self.new_telegram(name).blank().u16(1).u32((now.as_nanos() / 1000) as u32);
        let telegram = (0..OUTPUTS).fold(telegram, |telegram, place| {
            let state = match self.results.get(place) {
                Some(1) => 1,
                _ if place < self.fields.len() => 0,
                _ => 2,
            };
            telegram.u8(state).u32(7)
        });
        // No time.
        telegram.u16(0)
    }
}

/// True if a point is within a polygon: it crosses an odd number of edges on its way to the left.
fn contains(corners: &[[f32; 2]], [x, y]: [f32; 2]) -> bool {
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    let crossed = edges.filter(|([ax, ay], [bx, by])| {
        let passes = (*ay > y) != (*by > y);
        passes && x < (bx - ax) * (y - ay) / (by - ay) + ax
    });
    crossed.count() % 2 == 1
}

impl crate::emulated::Device for Device {
    fn faults(&mut self) -> &mut Faults {
        &mut self.faults
    }

    fn scene(&mut self) -> &mut Scene {
        &mut self.scene
    }

    fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        if self.faults.unpowered || self.faults.cut || self.faults.deaf || self.faults.wrong_baud {
            return;
        }
        for byte in bytes {
            if self.rx.push(*byte).is_err() || self.rx[0] != STX {
                self.rx.clear();
                continue;
            }
            let telegram = match self.dialect {
                Dialect::Text if *byte == ETX => 1..self.rx.len() - 1,
                Dialect::Text => continue,
                Dialect::Binary => {
                    let Some(length) = self.rx.get(4..HEADER_B) else { continue };
                    let length = u32::from_be_bytes([length[0], length[1], length[2], length[3]]) as usize;
                    match self.rx.len().checked_sub(HEADER_B + 1) {
                        Some(there) if there == length => HEADER_B..HEADER_B + length,
                        _ => continue,
                    }
                }
            };
            let rx = core::mem::take(&mut self.rx);
            let sum = rx.last().copied().unwrap_or(0);
            if self.dialect == Dialect::Text || sum == checksum(&rx[telegram.clone()]) {
                self.serve(now, &rx[telegram]);
            }
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.faults.unpowered {
            (self.sends, self.next, self.logged_in) = (Sends::default(), None, false);
            self.results.clear();
            self.measures = self.family != Family::Lms1xx;
            self.rx.clear();
            self.line.clear();
            return;
        }
        while let Some(next) = self.next.filter(|next| *next <= now) {
            if self.measures && !self.faults.hangs && !self.faults.motor_stopped {
                self.scan(next);
            }
            self.next = Some(next + self.period());
        }
    }

    fn poll_tx(&mut self, now: Instant, bytes: &mut [u8]) -> usize {
        self.line.poll(now, bytes, &self.faults)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        earliest([self.next, self.line.is_busy().then_some(Instant::ZERO)])
    }
}
