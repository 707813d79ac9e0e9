//! The start-up of a SICK lidar, and its scans to sectors.

use super::results::{Read, Reads, Results};
use super::wire::{
    Dialect, ETX, FIELDS_MAX, HEADER_B, OUTPUTS_MAX, Reader, STX, Scan, TELEGRAM_MAX, VALID_MIN, Writer, checksum,
    fields, outputs,
};
use super::{Config, Family};
use crate::clock::Clock;
use crate::engine::{Optics, Progress, Protocol, Shared};
use crate::event::{Fault, FieldResult, Health, LostReason, Zone, text};
use crate::framing::Framing;
use crate::scan::{BEAMS_MAX, EIGHTH_RAD};
use alloc::boxed::Box;
use base::{Duration, Instant, earliest};
use core::f64::consts::{FRAC_PI_2, TAU};
use core::mem::replace;
use heapless::Vec;

/// Time limit of an answer.
const ANSWER_WITHIN: Duration = Duration::from_millis(250);
/// Attempts of a request.
const TRIES: u8 = 3;
/// Time limit of the first scan after it was asked for.
const SCAN_WITHIN: Duration = Duration::from_millis(1000);
/// From the request for scans on, the time until the contamination is read.
const CONTAMINATION_AFTER: Duration = Duration::from_secs(1);
/// Password of the user level "authorized client", as it travels (telegram listing, log in).
const CLIENT: (u8, u32) = (3, 0xF472_4744);
/// Telegrams with results of the device's own evaluation: what they are of, and whether they are answers.
const RESULTS: [(&str, Read, bool); 4] = [
    ("sSN LFErec", Read::Fields, false),
    ("sRA LFErec", Read::Fields, true),
    ("sSN LIDoutputstate", Read::Outputs, false),
    ("sRA LIDoutputstate", Read::Outputs, true),
];

#[derive(Clone, Copy, Debug, PartialEq)]
enum Ask {
    Identity,
    State,
    Login,
    Start,
    Run,
    Scans,
    Fields,
    Outputs,
}

impl Ask {
    /// Kind and name of the answer.
    fn answer(self) -> &'static str {
        match self {
            Self::Identity => "sRA DeviceIdent",
            Self::State => "sRA SCdevicestate",
            Self::Login => "sAN SetAccessMode",
            Self::Start => "sAN LMCstartmeas",
            Self::Run => "sAN Run",
            Self::Scans => "sEA LMDscandata",
            Self::Fields => "sEA LFErec",
            Self::Outputs => "sEA LIDoutputstate",
        }
    }
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Off,
    Asking {
        ask: Ask,
        tries: u8,
        until: Instant,
    },
    /// The first scan is due by `until`.
    Scanning {
        until: Option<Instant>,
    },
}

/// The protocol of SICK lidars.
#[derive(Debug)]
pub struct Cola {
    config: Config,
    phase: Phase,
    /// Always there, except while its bytes are handled: it is allocated once.
    rx: Option<Rx>,
    framing: Framing,
    clock: Clock,
    /// Number and clock of the last scan, µs.
    last: Option<(u16, u32)>,
    /// A scan has come since the start.
    scans: bool,
    revolution: u64,
    reads: Reads,
    view: Optics,
    fields: Results<FIELDS_MAX>,
    outputs: Results<OUTPUTS_MAX>,
}

impl Cola {
    pub(super) fn new(config: Config) -> Self {
        Self {
            config,
            phase: Phase::Off,
            rx: Some(Rx::default()),
            framing: Framing::default(),
            clock: Clock::new(1 << 32, 1000),
            last: None,
            scans: false,
            revolution: 0,
            reads: Reads::default(),
            view: Optics {
                range_min_m: config.range_min_m,
                range_max_m: config.range_max_m,
                view_rad: 0.0,
                rate_min_hz: 0.0,
            },
            fields: Results::new(Zone::Field),
            outputs: Results::new(Zone::Output),
        }
    }

    fn ask(&mut self, now: Instant, ask: Ask, tries: u8, shared: &mut Shared) {
        let new = |name| Writer::<80>::new(self.config.dialect, name);
        let request = match ask {
            Ask::Identity => new("sRN DeviceIdent"),
            Ask::State => new("sRN SCdevicestate"),
            Ask::Login => {
                let level = new("sMN SetAccessMode").blank();
                match self.config.dialect {
                    // As text the level has two digits.
                    Dialect::Text => level.fixed("03").u32(CLIENT.1),
                    Dialect::Binary => level.u8(CLIENT.0).u32(CLIENT.1),
                }
            }
            Ask::Start => new("sMN LMCstartmeas"),
            Ask::Run => new("sMN Run"),
            Ask::Scans => new("sEN LMDscandata").blank().u8(1),
            Ask::Fields => new("sEN LFErec").blank().u8(1),
            Ask::Outputs => new("sEN LIDoutputstate").blank().u8(1),
        };
        shared.send(&request.frame());
        self.phase = Phase::Asking { ask, tries, until: now + ANSWER_WITHIN };
    }

    fn next(&mut self, now: Instant, ask: Ask, shared: &mut Shared) -> Progress {
        self.ask(now, ask, TRIES, shared);
        Progress::Pending
    }

    /// What follows a request that was answered, or can be left out.
    fn proceed(&mut self, now: Instant, ask: Ask, shared: &mut Shared) -> Progress {
        let next = match ask {
            Ask::Identity => Ask::State,
            Ask::State if self.config.family == Family::Lms1xx => Ask::Login,
            Ask::Login => Ask::Start,
            Ask::Start => Ask::Run,
            Ask::State | Ask::Run if self.config.fields => Ask::Fields,
            Ask::State | Ask::Run | Ask::Fields if self.config.outputs => Ask::Outputs,
            Ask::State | Ask::Run | Ask::Fields | Ask::Outputs => Ask::Scans,
            Ask::Scans => {
                self.phase = Phase::Scanning { until: Some(now + SCAN_WITHIN) };
                return Progress::Pending;
            }
        };
        self.next(now, next, shared)
    }

    fn begin_reading(&mut self, now: Instant) {
        self.reads.begin(Read::Contamination, now + CONTAMINATION_AFTER);
        if self.config.fields {
            self.reads.begin(Read::Fields, now);
        }
        if self.config.outputs {
            self.reads.begin(Read::Outputs, now);
        }
    }

    /// Takes one whole telegram.
    fn take(&mut self, now: Instant, telegram: &[u8], shared: &mut Shared) -> Progress {
        let dialect = self.config.dialect;
        let read = |name| Reader::new(dialect, telegram, name);
        if let Some(values) = read("sSN LMDscandata").or_else(|| read("sRA LMDscandata")) {
            if matches!(self.phase, Phase::Scanning { .. }) {
                match Scan::decode(values) {
                    Some(scan) => self.scan(now, &scan, shared),
                    None => shared.reject(),
                }
            }
            return Progress::Pending;
        }
        for (name, of, is_answer) in RESULTS {
            if let Some(values) = read(name) {
                self.evaluated(values, of, is_answer, shared);
                return Progress::Pending;
            }
        }
        if let Some(mut values) = read("sRA LCMstate") {
            self.reads.answered(Read::Contamination);
            match values.u8() {
                Some(level) => self.contaminated(level, shared),
                None => shared.reject(),
            }
            return Progress::Pending;
        }
        if let Some(mut values) = read("sFA") {
            let code = match dialect {
                Dialect::Text => values.u16(),
                Dialect::Binary => values.u16().or(Some(0)),
            };
            return self.refused(now, code.unwrap_or(0).into(), shared);
        }
        match self.phase {
            Phase::Asking { ask, .. } => match read(ask.answer()) {
                Some(values) => self.answered(now, ask, values, shared),
                // The answer to an earlier request.
                None => Progress::Pending,
            },
            _ => Progress::Pending,
        }
    }

    fn refused(&mut self, now: Instant, code: u32, shared: &mut Shared) -> Progress {
        match self.phase {
            Phase::Asking { ask: Ask::Identity | Ask::Scans, .. } => Progress::Lost(LostReason::Refused { code }),
            Phase::Asking { ask, .. } => self.proceed(now, ask, shared),
            Phase::Scanning { .. } => {
                // It does not know it. Results that stop a robot are asked for all the same, and are unknown.
                if self.reads.refused() == Some(Read::Contamination) {
                    self.reads.end(Read::Contamination);
                }
                Progress::Pending
            }
            Phase::Off => Progress::Pending,
        }
    }

    fn answered(&mut self, now: Instant, ask: Ask, mut values: Reader<'_>, shared: &mut Shared) -> Progress {
        match ask {
            Ask::Identity => {
                let (Some(name), Some(version)) = (values.text(), values.text()) else {
                    shared.reject();
                    return Progress::Pending;
                };
                let [shown, of] = [name, version].map(|part| core::str::from_utf8(part).unwrap_or("?").trim());
                shared.identify(text(format_args!("{shown} {of}")));
                if !name.starts_with(self.config.family.name_begins().as_bytes()) {
                    return Progress::Lost(LostReason::Identity);
                }
            }
            Ask::State => match values.u8() {
                Some(1) => shared.health(Health::Good),
                // Busy: asked again when the time of the answer is over.
                Some(0) => return Progress::Pending,
                Some(code) => {
                    let meaning = match code {
                        2 => "state: error",
                        3 => "state: standby",
                        _ => "",
                    };
                    let code = code.into();
                    shared.health_of(Health::Error { code }, text(format_args!("{meaning}")));
                    return Progress::Lost(LostReason::Device { code });
                }
                None => {
                    shared.reject();
                    return Progress::Pending;
                }
            },
            Ask::Scans if values.u8() != Some(1) => return Progress::Lost(LostReason::Refused { code: 0 }),
            _ => {}
        }
        self.proceed(now, ask, shared)
    }

    fn contaminated(&mut self, level: u8, shared: &mut Shared) {
        let code = level.into();
        let (health, meaning) = match level {
            0 => (Health::Good, ""),
            1 => (Health::Warning { code }, "contamination of the optics"),
            _ => (Health::Error { code }, "optics too dirty to measure"),
        };
        shared.health_of(health, text(format_args!("{meaning}")));
        shared.fault(Fault::Dirty, level == 1);
        shared.fault(Fault::Blocked, level > 1);
    }

    /// Takes results of the field evaluation, or states of the outputs: an answer, or the report of a change.
    fn evaluated(&mut self, values: Reader<'_>, of: Read, is_answer: bool, shared: &mut Shared) {
        let asked = if is_answer { self.reads.answered(of) } else { None };
        let taken = match of {
            Read::Outputs => outputs(values).map(|states| self.outputs.take(&states, asked, shared)),
            _ => fields(values).map(|results| self.fields.take(&results, asked, shared)),
        };
        if taken.is_none() {
            shared.reject();
        }
    }

    fn scan(&mut self, now: Instant, scan: &Scan<'_>, shared: &mut Shared) {
        if !replace(&mut self.scans, true) {
            // Before its first scan what it answers is of none: its outputs are not active yet.
            self.begin_reading(now);
        }
        let Some(sent) = self.clock.at(now, scan.sent_us.into()) else {
            self.last = None;
            return shared.stale();
        };
        let frequency_hz = f64::from(scan.frequency) / 100.0;
        if let Some((number, scanned_us)) = self.last.replace((scan.number, scan.scanned_us)) {
            let scans = scan.number.wrapping_sub(number);
            let period_s = f64::from(scan.scanned_us.wrapping_sub(scanned_us)) / 1e6 / f64::from(scans.max(1));
            let slow = !(0.8..1.25).contains(&(period_s * frequency_hz));
            if scans == 0 {
                return shared.stale();
            }
            shared.fault(Fault::Slow, slow);
        }
        let has_error = scan.status & 0b101 == 0b001;
        shared.error(has_error.then(|| (scan.status.into(), text(format_args!("device state in its scans: error")))));
        if !self.reads.has(Read::Contamination) || scan.status & 0b110 != 0 {
            shared.fault(Fault::Dirty, scan.status & 0b110 == 0b010);
            shared.fault(Fault::Blocked, scan.status & 0b100 != 0);
        }
        shared.accept();
        self.phase = Phase::Scanning { until: None };

        let distances = &scan.distances;
        let step_rad = f64::from(distances.step) / 3_600_000.0 * TAU;
        let start_rad = f64::from(distances.start) / 3_600_000.0 * TAU - FRAC_PI_2;
        let beam_time_s = step_rad / TAU / frequency_hz;
        let count = usize::from(distances.count);
        // The clock at the scan is that of its begin or, on some models, of its end.
        let lasted = beam_time_s * count as f64;
        let before_s = (f64::from(scan.sent_us.wrapping_sub(scan.scanned_us)) / 1e6).clamp(lasted, lasted + 1.0);
        let first = sent - Duration::from_secs_f64(before_s);
        shared.optics = Optics { view_rad: step_rad * count as f64, rate_min_hz: 0.8 * frequency_hz, ..self.view };

        let per_sector = ((EIGHTH_RAD / step_rad + 1e-6) as usize + 1).min(BEAMS_MAX);
        let (no_echo, range_min_m) = (self.config.no_echo, self.config.range_min_m);
        let range_m = |value: u16| match value {
            0 => no_echo.range_m(),
            _ if value < VALID_MIN => f32::NAN,
            _ => match (f32::from(value) * distances.scale + distances.offset) / 1000.0 {
                range if range < range_min_m => f32::NEG_INFINITY,
                range => range,
            },
        };
        let mut ranges = distances.values();
        let mut intensities =
            scan.intensities.as_ref().map(|channel| (channel.values(), channel.scale, channel.offset));
        for begin in (0..count).step_by(per_sector) {
            let beams = per_sector.min(count - begin);
            shared.sector(self.revolution, |sector| {
                sector.at = first + Duration::from_secs_f64(begin as f64 * beam_time_s);
                sector.angle_min_rad = start_rad + begin as f64 * step_rad;
                (sector.angle_step_rad, sector.beam_time_s) = (step_rad, beam_time_s);
                // At most BEAMS_MAX.
                sector.ranges_m.extend(ranges.by_ref().take(beams).map(range_m));
                if let Some((values, scale, offset)) = &mut intensities {
                    let scaled = values.by_ref().take(beams).map(|value| f32::from(value) * *scale + *offset);
                    sector.intensities.extend(scaled);
                }
            });
        }
        self.revolution += 1;
    }

    /// Frame at the begin of the buffer: its telegram, and its whole length.
    fn frame(&self, rx: &[u8]) -> Frame {
        match self.config.dialect {
            Dialect::Text => match rx {
                [] => Frame::More,
                [STX, rest @ ..] => match rest.last() {
                    Some(&ETX) => Frame::Whole(1, rx.len() - 1),
                    // A frame inside a frame: the first was cut.
                    Some(&STX) => Frame::Wrong,
                    _ => Frame::More,
                },
                _ => Frame::Wrong,
            },
            Dialect::Binary => {
                let begins = rx.iter().take(4).all(|byte| *byte == STX);
                let Some(length) = rx.get(4..HEADER_B).map(|it| u32::from_be_bytes([it[0], it[1], it[2], it[3]]))
                else {
                    return if begins { Frame::More } else { Frame::Wrong };
                };
                let length = length as usize;
                if !begins || length == 0 || length > TELEGRAM_MAX - HEADER_B - 1 {
                    return Frame::Wrong;
                }
                let end = HEADER_B + length;
                match rx.get(end) {
                    None => Frame::More,
                    Some(sum) if *sum == checksum(&rx[HEADER_B..end]) => Frame::Whole(HEADER_B, end),
                    Some(_) => Frame::Wrong,
                }
            }
        }
    }

    fn receive(&mut self, now: Instant, bytes: &[u8], rx: &mut Rx, shared: &mut Shared) -> Progress {
        for byte in bytes {
            if rx.push(*byte).is_err() {
                // A telegram of CoLa A without an end.
                rx.clear();
                shared.reject();
                let _ = rx.push(*byte);
            }
            loop {
                match self.frame(rx) {
                    Frame::More => break,
                    Frame::Wrong => self.framing.skip(rx, SKIPPED, |rest| rest[0] == STX, shared),
                    Frame::Whole(begin, end) => {
                        self.framing.found();
                        shared.arrived_valid();
                        let progress = self.take(now, &rx[begin..end], shared);
                        rx.clear();
                        if progress != Progress::Pending {
                            return progress;
                        }
                    }
                }
            }
        }
        Progress::Pending
    }
}

/// Bytes that belong to no telegram, after which another one is counted as lost.
const SKIPPED: usize = 1000;

type Rx = Box<Vec<u8, TELEGRAM_MAX>>;

enum Frame {
    More,
    Wrong,
    /// Begin and end of the telegram.
    Whole(usize, usize),
}

impl Protocol for Cola {
    fn start(&mut self, now: Instant, shared: &mut Shared) {
        self.rx.get_or_insert_default().clear();
        self.framing.reset();
        (self.last, self.reads) = (None, Reads::default());
        self.clock.reset();
        self.scans = false;
        self.fields.forget(shared);
        self.outputs.forget(shared);
        self.ask(now, Ask::Identity, TRIES, shared);
    }

    fn handle_rx(&mut self, now: Instant, bytes: &[u8], shared: &mut Shared) -> Progress {
        let mut rx = self.rx.take().unwrap_or_default();
        let progress = self.receive(now, bytes, &mut rx, shared);
        self.rx = Some(rx);
        progress
    }

    fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) -> Progress {
        match self.phase {
            Phase::Asking { ask, tries: 1, until } if until <= now => {
                if matches!(ask, Ask::Fields | Ask::Outputs) {
                    return self.proceed(now, ask, shared);
                }
                self.phase = Phase::Off;
                return Progress::Lost(LostReason::Silent);
            }
            Phase::Asking { ask, tries, until } if until <= now => self.ask(now, ask, tries - 1, shared),
            Phase::Scanning { until: Some(until) } if until <= now => {
                self.phase = Phase::Off;
                return Progress::Lost(LostReason::Silent);
            }
            _ => {}
        }
        if let Some(read) = self.reads.next(now) {
            shared.send(&Writer::<80>::new(self.config.dialect, read.name()).frame());
        }
        self.fields.expire(now, shared);
        self.outputs.expire(now, shared);
        Progress::Pending
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let until = match self.phase {
            Phase::Off => None,
            Phase::Asking { until, .. } => Some(until),
            Phase::Scanning { until } => until,
        };
        earliest([until, self.reads.poll_timeout(), self.fields.poll_timeout(), self.outputs.poll_timeout()])
    }

    fn optics(&self) -> Optics {
        self.view
    }

    fn result(&self, zone: Zone) -> FieldResult {
        match zone {
            Zone::Field(number) => self.fields.get(number),
            Zone::Output(number) => self.outputs.get(number),
        }
    }
}
