//! The other end: a URG-04LX or a UTM-30LX that answers and scans, with lines as in C-42-03320B.

use super::wire::{BLOCK, LF, Parameters, checksum, encode};
use crate::emulated::{Faults, Line, Scene};
use alloc::boxed::Box;
use base::{Duration, Instant, earliest};
use core::f64::consts::TAU;
use core::fmt::{self, Write};
use heapless::Vec;

/// Longest answer: 1081 ranges of three characters, with the checksums of their lines.
const ANSWER_MAX: usize = 6000;
/// Request at most.
const REQUEST_MAX: usize = 40;
/// The laser is on, and scans follow.
const MEASURES: u8 = 1;

type Answer = Box<Vec<u8, ANSWER_MAX>>;

/// A model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Model {
    /// Name, as in `MODL`.
    pub name: &'static str,
    /// Parameters.
    pub parameters: Parameters,
    /// Bytes per second of the line.
    pub bytes_per_s: u32,
}

impl Model {
    /// URG-04LX (parameters as in C-42-03320B, 8.12).
    pub const URG_04LX: Self = Self {
        name: "URG-04LX(Hokuyo Automatic Co.,Ltd.)",
        parameters: Parameters {
            range_min_mm: 20,
            range_max_mm: 5600,
            steps_per_turn: 1024,
            first: 44,
            last: 725,
            front: 384,
            rpm: 600,
        },
        bytes_per_s: 60_000,
    };
    /// UTM-30LX, 270° in steps of 0.25°.
    pub const UTM_30LX: Self = Self {
        name: "UTM-30LX",
        parameters: Parameters {
            range_min_mm: 23,
            range_max_mm: 60_000,
            steps_per_turn: 1440,
            first: 0,
            last: 1080,
            front: 540,
            rpm: 2400,
        },
        bytes_per_s: 400_000,
    };
}

#[derive(Clone, Copy, Debug)]
struct Scan {
    first: u32,
    last: u32,
    width: usize,
    /// Scans that are left; `None`: for ever.
    left: Option<u32>,
}

/// A device.
#[derive(Debug)]
pub struct Device {
    model: Model,
    faults: Faults,
    scene: Scene,
    line: Line,
    rx: Vec<u8, REQUEST_MAX>,
    laser: u8,
    scan: Option<(Scan, Vec<u8, REQUEST_MAX>)>,
    next: Option<Instant>,
    answer: Answer,
}

/// Writes a line of text and its checksum, which leaves the semicolon out as real sensors do.
fn info(answer: &mut Answer, arguments: fmt::Arguments<'_>) {
    let begin = answer.len();
    // Answers are shorter than the buffer.
    let _ = answer.write_fmt(arguments);
    let sum = checksum(&answer[begin..]);
    let _ = answer.extend_from_slice(&[b';', sum, LF]);
}

fn line(answer: &mut Answer, data: &[u8]) {
    // Answers are shorter than the buffer.
    let _ = answer.extend_from_slice(data);
    let _ = answer.extend_from_slice(&[checksum(data), LF]);
}

fn digits(text: &[u8]) -> Option<u32> {
    text.iter().try_fold(0, |value, digit| digit.is_ascii_digit().then(|| value * 10 + u32::from(digit - b'0')))
}

impl Device {
    /// A device at power-on.
    #[must_use]
    pub fn new(model: Model) -> Self {
        Self {
            model,
            faults: Faults::default(),
            scene: Scene::default(),
            line: Line::new(model.bytes_per_s),
            rx: Vec::new(),
            laser: 0,
            scan: None,
            next: None,
            answer: Box::default(),
        }
    }

    fn period(&self) -> Duration {
        let period = Duration::from_secs_f64(60.0 / f64::from(self.model.parameters.rpm));
        if self.faults.motor_slow { period * 2 } else { period }
    }

    fn time_ms(now: Instant) -> u32 {
        (now.as_nanos() / 1_000_000 % (1 << 24)) as u32
    }

    /// Sends the echo, the status, and what was written by `more`.
    fn reply(&mut self, request: &[u8], status: &[u8], more: impl FnOnce(&mut Answer, &Self)) {
        let mut answer = core::mem::take(&mut self.answer);
        answer.clear();
        let _ = answer.extend_from_slice(request);
        let _ = answer.push(LF);
        line(&mut answer, status);
        more(&mut answer, self);
        let _ = answer.push(LF);
        self.line.send(&answer, &self.faults);
        self.answer = answer;
    }

    fn serve(&mut self, now: Instant, request: &[u8]) {
        if self.faults.hangs {
            return;
        }
        if self.faults.refuses {
            return self.reply(request, b"0E", |_, _| {});
        }
        match request {
            b"QT" | b"RS" => {
                (self.laser, self.scan) = (0, None);
                self.reply(request, b"00", |_, _| {});
            }
            b"BM" => {
                let status = if self.laser == MEASURES { b"02" } else { b"00" };
                self.laser = MEASURES;
                self.next.get_or_insert(now + self.period());
                self.reply(request, status, |_, _| {});
            }
            b"VV" => self.reply(request, b"00", |answer, _| {
                info(answer, format_args!("VEND:Hokuyo Automatic Co.,Ltd."));
                info(answer, format_args!("PROD:SOKUIKI Sensor"));
                info(answer, format_args!("FIRM:3.1.00(18/Jan./2007)"));
                info(answer, format_args!("PROT:SCIP 2.0"));
                info(answer, format_args!("SERI:H0614967"));
            }),
            b"PP" => self.reply(request, b"00", |answer, device| {
                let it = &device.model.parameters;
                let name = if device.faults.stranger { "PBS-03JN" } else { device.model.name };
                info(answer, format_args!("MODL:{name}"));
                info(answer, format_args!("DMIN:{}", it.range_min_mm));
                info(answer, format_args!("DMAX:{}", it.range_max_mm));
                info(answer, format_args!("ARES:{}", it.steps_per_turn));
                info(answer, format_args!("AMIN:{}", it.first));
                info(answer, format_args!("AMAX:{}", it.last));
                info(answer, format_args!("AFRT:{}", it.front));
                info(answer, format_args!("SCAN:{}", it.rpm));
            }),
            b"II" => self.reply(request, b"00", |answer, device| {
                info(answer, format_args!("MODL:{}", device.model.name));
                info(answer, format_args!("LASR:{}", if device.laser == MEASURES { "ON" } else { "OFF" }));
                info(
                    answer,
                    format_args!("SCSP:Initial({}[rpm])<-Default setting by user", device.model.parameters.rpm),
                );
                info(answer, format_args!("MESM:IDLE"));
                info(answer, format_args!("SBPS:19200[bps]<-Default setting by user"));
                info(answer, format_args!("TIME:{:06X}", Self::time_ms(now)));
                let state = if device.faults.error { "Laser or motor malfunction" } else { "Sensor works well." };
                info(answer, format_args!("STAT:{state}"));
            }),
            b"TM0" | b"TM2" => self.reply(request, b"00", |_, _| {}),
            b"TM1" => self.reply(request, b"00", |answer, _| {
                let mut time = [0; 4];
                encode(Self::time_ms(now), &mut time);
                line(answer, &time);
            }),
            _ => self.measure(now, request),
        }
    }

    fn measure(&mut self, now: Instant, request: &[u8]) {
        let Some(([kind, letter], rest)) = request.split_first_chunk::<2>() else {
            return self.reply(request, b"0E", |_, _| {});
        };
        let width = if *letter == b'S' { 2 } else { 3 };
        let numbers = match rest.len() {
            // First, last, group; and for many scans: interval, number.
            10 if *kind == b'G' => [digits(&rest[..4]), digits(&rest[4..8]), Some(1)],
            13 if *kind == b'M' => [digits(&rest[..4]), digits(&rest[4..8]), digits(&rest[11..])],
            _ => [None; 3],
        };
        let ([Some(first), Some(last), Some(count)], b'S' | b'D') = (numbers, *letter) else {
            return self.reply(request, b"0E", |_, _| {});
        };
        if first > last || last > self.model.parameters.last || first < self.model.parameters.first {
            return self.reply(request, b"04", |_, _| {});
        }
        if *kind == b'G' && self.laser == MEASURES {
            return self.reply(request, b"00", |answer, device| device.data(answer, now, first, last, width));
        }
        if self.faults.error {
            return self.reply(request, b"10", |_, _| {});
        }
        self.laser = MEASURES;
        self.reply(request, b"00", |_, _| {});
        let scan = Scan { first, last, width, left: (count > 0).then_some(count) };
        self.scan = Some((scan, Vec::from_slice(request).unwrap_or_default()));
        self.next.get_or_insert(now + self.period());
    }

    /// Writes clock and ranges.
    fn data(&self, answer: &mut Answer, now: Instant, first: u32, last: u32, width: usize) {
        let mut time = [0; 4];
        encode(Self::time_ms(now), &mut time);
        line(answer, &time);
        let it = &self.model.parameters;
        let mut block = Vec::<u8, { BLOCK + 3 }>::new();
        for step in first..=last {
            let angle = (f64::from(step) - f64::from(it.front)) / f64::from(it.steps_per_turn) * TAU;
            let range_m = self.scene.range_m(angle);
            let limit_mm = it.range_max_mm.min(if width == 2 { 4095 } else { 262_143 });
            let range_mm = match libm::roundf(range_m * 1000.0) as u32 {
                // 0: no object within 22 m; a sensor whose optics are covered reads 6, "others".
                _ if self.faults.blocked => 6,
                range if range > limit_mm => 0,
                range => range,
            };
            let mut characters = [0; 3];
            encode(range_mm, &mut characters[..width]);
            for byte in &characters[..width] {
                if block.len() == BLOCK {
                    line(answer, &block);
                    block.clear();
                }
                let _ = block.push(*byte);
            }
        }
        line(answer, &block);
    }

    fn scan(&mut self, at: Instant) {
        let Some((mut scan, mut request)) = self.scan.take() else { return };
        if self.faults.error {
            return self.reply(&request, b"10", |_, _| {});
        }
        if let Some(left) = &mut scan.left {
            *left -= 1;
            let at = request.len() - 2;
            request[at..].copy_from_slice(&[b'0' + (*left / 10 % 10) as u8, b'0' + (*left % 10) as u8]);
        }
        self.reply(&request, b"99", |answer, device| device.data(answer, at, scan.first, scan.last, scan.width));
        if scan.left != Some(0) {
            self.scan = Some((scan, request));
        }
    }
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
            if *byte == LF || *byte == b'\r' {
                let request = core::mem::take(&mut self.rx);
                if !request.is_empty() {
                    self.serve(now, &request);
                }
            } else if self.rx.push(*byte).is_err() {
                self.rx.clear();
            }
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.faults.unpowered {
            (self.laser, self.scan, self.next) = (0, None, None);
            self.rx.clear();
            self.line.clear();
            return;
        }
        while let Some(next) = self.next.filter(|next| *next <= now) {
            if !self.faults.hangs && !self.faults.motor_stopped {
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
