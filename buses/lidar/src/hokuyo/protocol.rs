//! The start-up of a sensor with SCIP 2.0, and its scans to sectors.

use super::wire::{BLOCK, LF, Parameters, checked, checksum, decode};
use super::{Characters, Config};
use crate::clock::Clock;
use crate::engine::{Bytes, Optics, Progress, Protocol, Shared};
use crate::event::{Fault, Health, LostReason, Text, text};
use crate::scan::{BEAMS_MAX, EIGHTH_RAD};
use alloc::boxed::Box;
use base::{Duration, Instant};
use core::f64::consts::TAU;
use core::fmt::Write;
use heapless::{String, Vec};

/// Time after a quit in which what was under way arrives.
const QUITTING: Duration = Duration::from_millis(40);
/// Time limit of an answer.
const ANSWER_WITHIN: Duration = Duration::from_millis(250);
/// Attempts of a request.
const TRIES: u8 = 3;
/// Time limit of the first scan.
const SCAN_WITHIN: Duration = Duration::from_millis(1200);
/// Most steps of a scan.
const STEPS_MAX: usize = 8192;
/// Longest line, checksum included.
const LINE_MAX: usize = 128;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Ask {
    Version,
    Parameters,
    State,
    Laser,
    Scans,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Off,
    Quitting { until: Instant },
    Asking { ask: Ask, tries: u8, until: Instant },
    Scanning { until: Option<Instant> },
}

/// Place in an answer or a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    /// The echo of the request.
    Echo,
    Status,
    /// Lines of an answer.
    Lines,
    /// Clock of a scan.
    Time,
    /// Ranges of a scan.
    Data,
    /// What follows belongs to nothing, up to an empty line.
    Lost,
}

/// The protocol of sensors with SCIP 2.0.
#[derive(Debug)]
pub struct Scip {
    config: Config,
    phase: Phase,
    line: Vec<u8, LINE_MAX>,
    place: Place,
    /// The request under way, without its end.
    request: Bytes,
    parameters: Parameters,
    model: Bytes,
    firmware: Bytes,
    serial: Bytes,
    /// State of the sensor is good; else its code, 0 where it has none, and its words.
    works: bool,
    trouble: (u32, Bytes),
    clock: Clock,
    time: u32,
    /// Ranges of the scan, mm; characters of a range whose rest is in the next line.
    ranges: Box<Vec<u32, STEPS_MAX>>,
    rest: Vec<u8, 4>,
    last_first: Option<Instant>,
    revolution: u64,
}

impl Scip {
    pub(super) fn new(config: Config) -> Self {
        Self {
            config,
            phase: Phase::Off,
            line: Vec::new(),
            place: Place::Echo,
            request: Bytes::new(),
            parameters: Parameters::default(),
            model: Bytes::new(),
            firmware: Bytes::new(),
            serial: Bytes::new(),
            works: true,
            trouble: (0, Bytes::new()),
            clock: Clock::new(1 << 24, 1_000_000),
            time: 0,
            ranges: Box::default(),
            rest: Vec::new(),
            last_first: None,
            revolution: 0,
        }
    }

    fn width(&self) -> usize {
        match self.config.characters {
            Characters::Two => 2,
            Characters::Three => 3,
        }
    }

    fn ask(&mut self, now: Instant, ask: Ask, tries: u8, shared: &mut Shared) {
        let mut request = String::<16>::new();
        let letter = if self.width() == 2 { 'S' } else { 'D' };
        let written = match ask {
            Ask::Version => request.write_str("VV"),
            Ask::Parameters => request.write_str("PP"),
            Ask::State => request.write_str("II"),
            Ask::Laser => request.write_str("BM"),
            // From the first step to the last, each, all scans, for ever.
            Ask::Scans => {
                write!(request, "M{letter}{:04}{:04}01000", self.parameters.first, self.parameters.last)
            }
        };
        // All of them have room.
        let _ = written;
        self.request.clear();
        let _ = self.request.extend_from_slice(request.as_bytes());
        let _ = request.write_char('\n');
        shared.send(request.as_bytes());
        (self.place, self.works) = (Place::Echo, true);
        self.phase = Phase::Asking { ask, tries, until: now + ANSWER_WITHIN };
    }

    fn next(&mut self, now: Instant, ask: Ask, shared: &mut Shared) -> Progress {
        self.ask(now, ask, TRIES, shared);
        Progress::Pending
    }

    /// A line that does not fit: the rest of the answer or scan is left out.
    fn lose_step(&mut self, shared: &mut Shared) {
        if self.place != Place::Lost {
            shared.reject();
        }
        self.place = Place::Lost;
    }

    fn take_line(&mut self, now: Instant, line: &[u8], shared: &mut Shared) -> Progress {
        match (self.place, line) {
            (Place::Lost | Place::Echo, []) => {
                self.place = Place::Echo;
                Progress::Pending
            }
            (Place::Lost, _) => Progress::Pending,
            (Place::Echo, _) => {
                let is_scan = matches!(self.phase, Phase::Scanning { .. });
                // In a scan the last two digits are the scans that are left: 00.
                let is_echo = if is_scan {
                    line.starts_with(&self.request[..self.request.len() - 2])
                } else {
                    line == self.request
                };
                if is_echo {
                    self.place = Place::Status;
                } else {
                    self.lose_step(shared);
                }
                Progress::Pending
            }
            (Place::Status, _) => match checked(line) {
                Some(&[a, b]) => self.status(now, [a, b], shared),
                _ => {
                    self.lose_step(shared);
                    Progress::Pending
                }
            },
            (Place::Lines, []) => {
                self.place = Place::Echo;
                shared.accept();
                self.answered(now, shared)
            }
            (Place::Lines, _) => {
                match checked(line) {
                    Some(line) => self.info(line, shared),
                    None => self.lose_step(shared),
                }
                Progress::Pending
            }
            (Place::Time, _) => {
                match checked(line).filter(|it| it.len() == 4).and_then(decode) {
                    Some(time) => {
                        self.time = time;
                        self.ranges.clear();
                        self.rest.clear();
                        self.place = Place::Data;
                    }
                    None => self.lose_step(shared),
                }
                Progress::Pending
            }
            (Place::Data, []) => {
                self.place = Place::Echo;
                if self.ranges.len() == self.parameters.count() && self.rest.is_empty() {
                    self.scan(now, shared);
                } else {
                    shared.reject();
                }
                Progress::Pending
            }
            (Place::Data, _) => {
                let width = self.width();
                let data = checked_data(line);
                let taken = data.is_some_and(|data| self.append(data, width));
                if !taken {
                    self.lose_step(shared);
                }
                Progress::Pending
            }
        }
    }

    /// Appends ranges; a range may continue in the next line. False: a character is not valid, or there are too many.
    fn append(&mut self, data: &[u8], width: usize) -> bool {
        for byte in data {
            // There is room: it is emptied at the width.
            let _ = self.rest.push(*byte);
            if self.rest.len() == width {
                let Some(range) = decode(&self.rest) else { return false };
                self.rest.clear();
                if self.ranges.len() >= self.parameters.count() || self.ranges.push(range).is_err() {
                    return false;
                }
            }
        }
        true
    }

    fn status(&mut self, now: Instant, status: [u8; 2], shared: &mut Shared) -> Progress {
        let code = status.iter().fold(0, |code, byte| code << 8 | u32::from(*byte));
        match (self.phase, &status) {
            (Phase::Scanning { .. }, b"99") => self.place = Place::Time,
            // The echo of the request before the first scan.
            (Phase::Scanning { .. }, b"00") => self.place = Place::Lost,
            (Phase::Scanning { .. }, _) => {
                self.place = Place::Lost;
                shared.health_of(Health::Error { code }, status_meaning(status));
                return Progress::Lost(LostReason::Device { code });
            }
            (Phase::Asking { ask: Ask::Scans, .. }, b"00") => {
                shared.accept();
                self.place = Place::Lost;
                self.phase = Phase::Scanning { until: Some(now + SCAN_WITHIN) };
            }
            // 02: the laser is on already.
            (Phase::Asking { ask: Ask::Laser, .. }, b"00" | b"02") | (Phase::Asking { .. }, b"00") => {
                self.place = Place::Lines;
            }
            (Phase::Asking { .. }, _) => {
                self.place = Place::Lost;
                return Progress::Lost(LostReason::Refused { code });
            }
            _ => self.place = Place::Lost,
        }
        Progress::Pending
    }

    fn info(&mut self, line: &[u8], shared: &mut Shared) {
        let Phase::Asking { ask, .. } = self.phase else { return };
        let value = |name: &[u8]| line.strip_prefix(name).map(|value| value.strip_suffix(b";").unwrap_or(value));
        let keep = |place: &mut Bytes, name: &[u8]| {
            if let Some(value) = value(name) {
                place.clear();
                place.extend(value.iter().copied().take(40));
            }
        };
        match ask {
            Ask::Version => {
                keep(&mut self.firmware, b"FIRM:");
                keep(&mut self.serial, b"SERI:");
            }
            Ask::Parameters => {
                keep(&mut self.model, b"MODL:");
                if !self.parameters.take(line) {
                    self.lose_step(shared);
                }
            }
            Ask::State => {
                if let Some(state) = value(b"STAT:") {
                    let state = state.trim_ascii();
                    // "Sensor works well.", or "Stable 000 no error." and codes below 100 of later sensors.
                    let code = state
                        .split(|byte| *byte == b' ')
                        .find(|word| word.len() == 3 && word.iter().all(u8::is_ascii_digit));
                    self.works = state.starts_with(b"Sensor works well") || code.is_some_and(|code| code[0] == b'0');
                    let digits = code.unwrap_or_default().iter();
                    let code = digits.fold(0, |code, digit| 10 * code + u32::from(digit - b'0'));
                    self.trouble = (code, state.iter().copied().take(40).collect());
                }
            }
            Ask::Laser | Ask::Scans => {}
        }
    }

    fn answered(&mut self, now: Instant, shared: &mut Shared) -> Progress {
        let Phase::Asking { ask, .. } = self.phase else { return Progress::Pending };
        match ask {
            Ask::Version => self.next(now, Ask::Parameters, shared),
            Ask::Parameters => {
                let [model, firmware, serial] =
                    [&self.model, &self.firmware, &self.serial].map(|part| core::str::from_utf8(part).unwrap_or("?"));
                shared.identify(text(format_args!("{model} firmware {firmware} serial {serial}")));
                if !self.model.starts_with(self.config.model.as_bytes()) {
                    return Progress::Lost(LostReason::Identity);
                }
                if !self.parameters.is_valid() {
                    shared.reject();
                    return Progress::Lost(LostReason::Garbled);
                }
                shared.optics = self.optics();
                self.next(now, Ask::State, shared)
            }
            Ask::State => {
                if !self.works {
                    let (code, words) = &self.trouble;
                    let words = core::str::from_utf8(words).unwrap_or("?");
                    shared.health_of(Health::Error { code: *code }, text(format_args!("{words}")));
                    return Progress::Lost(LostReason::Device { code: *code });
                }
                shared.health(Health::Good);
                self.next(now, Ask::Laser, shared)
            }
            Ask::Laser => self.next(now, Ask::Scans, shared),
            Ask::Scans => Progress::Pending,
        }
    }

    fn scan(&mut self, now: Instant, shared: &mut Shared) {
        let Some(sent) = self.clock.at(now, self.time.into()) else {
            self.last_first = None;
            return shared.stale();
        };
        shared.accept();
        self.phase = Phase::Scanning { until: None };
        let parameters = &self.parameters;
        let turn_s = 60.0 / f64::from(parameters.rpm);
        let beam_time_s = turn_s / f64::from(parameters.steps_per_turn);
        let step_rad = TAU / f64::from(parameters.steps_per_turn);
        // The clock is taken as that of the first step; its scan arrives a turn's part and the line's time later.
        let count = self.ranges.len();
        let bytes = count * self.width() + count / 21 + 40;
        let on_line_s =
            if self.config.bytes_per_s == 0 { 0.0 } else { bytes as f64 / f64::from(self.config.bytes_per_s) };
        // A line on which a scan takes longer than a turn could not carry them all: USB is faster than the rate set.
        let on_line_s = if on_line_s < turn_s { on_line_s } else { 0.0 };
        let first = sent - Duration::from_secs_f64(beam_time_s * count as f64 + on_line_s);
        if let Some(before) = self.last_first.replace(first) {
            let turns = first.since(before).as_secs_f64() / turn_s;
            // A lost scan and a motor at half its speed look the same; either is no longer right.
            shared.fault(Fault::Slow, !(0.8..1.25).contains(&turns));
        }
        let start_rad = (f64::from(parameters.first) - f64::from(parameters.front)) * step_rad;
        let per_sector = ((EIGHTH_RAD / step_rad + 1e-6) as usize + 1).min(BEAMS_MAX);
        let range_m = |mm: &u32| match *mm {
            mm if mm < parameters.range_min_mm => f32::NAN,
            mm if mm > parameters.range_max_mm => f32::INFINITY,
            mm => mm as f32 / 1000.0,
        };
        for (n, ranges) in self.ranges.chunks(per_sector).enumerate() {
            let begin = (n * per_sector) as f64;
            shared.sector(self.revolution, |sector| {
                sector.at = first + Duration::from_secs_f64(begin * beam_time_s);
                sector.angle_min_rad = start_rad + begin * step_rad;
                (sector.angle_step_rad, sector.beam_time_s) = (step_rad, beam_time_s);
                // At most BEAMS_MAX.
                sector.ranges_m.extend(ranges.iter().map(range_m));
            });
        }
        self.revolution += 1;
    }
}

/// What a status other than that of a scan means (C-42-03320B, 8.4, `MD`): its two characters, and what is known.
fn status_meaning(status: [u8; 2]) -> Text {
    let known = match &status {
        [b'2'..=b'4', _] => ": it stopped to check an error",
        [b'5'..=b'9', _] if status < *b"98" => ": hardware trouble, such as of laser or motor",
        _ => "",
    };
    let [a, b] = status.map(|byte| if byte.is_ascii_graphic() { char::from(byte) } else { '?' });
    text(format_args!("status {a}{b}{known}"))
}

/// Data of a line, whose checksum does not leave a semicolon out.
fn checked_data(line: &[u8]) -> Option<&[u8]> {
    let (sum, data) = line.split_last()?;
    (data.len() <= BLOCK && *sum == checksum(data)).then_some(data)
}

impl Protocol for Scip {
    fn start(&mut self, now: Instant, shared: &mut Shared) {
        self.line.clear();
        self.clock.reset();
        (self.place, self.last_first, self.parameters) = (Place::Lost, None, Parameters::default());
        shared.send(b"QT\n");
        self.phase = Phase::Quitting { until: now + QUITTING };
    }

    fn handle_rx(&mut self, now: Instant, bytes: &[u8], shared: &mut Shared) -> Progress {
        if matches!(self.phase, Phase::Off | Phase::Quitting { .. }) {
            return Progress::Pending;
        }
        for byte in bytes {
            if *byte != LF {
                if self.line.push(*byte).is_err() {
                    self.line.clear();
                    self.place = Place::Lost;
                    shared.reject();
                }
                continue;
            }
            let line = core::mem::take(&mut self.line);
            let progress = self.take_line(now, &line, shared);
            if progress != Progress::Pending {
                return progress;
            }
        }
        Progress::Pending
    }

    fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) -> Progress {
        match self.phase {
            Phase::Quitting { until } if until <= now => self.next(now, Ask::Version, shared),
            Phase::Asking { tries: 1, until, .. } if until <= now => {
                self.phase = Phase::Off;
                Progress::Lost(LostReason::Silent)
            }
            Phase::Asking { ask, tries, until } if until <= now => {
                self.ask(now, ask, tries - 1, shared);
                Progress::Pending
            }
            Phase::Scanning { until: Some(until) } if until <= now => {
                self.phase = Phase::Off;
                Progress::Lost(LostReason::Silent)
            }
            _ => Progress::Pending,
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self.phase {
            Phase::Off => None,
            Phase::Quitting { until } | Phase::Asking { until, .. } => Some(until),
            Phase::Scanning { until } => until,
        }
    }

    fn optics(&self) -> Optics {
        let parameters = &self.parameters;
        let steps = f64::from(parameters.steps_per_turn.max(1));
        Optics {
            range_min_m: parameters.range_min_mm as f32 / 1000.0,
            range_max_m: parameters.range_max_mm as f32 / 1000.0,
            view_rad: TAU * f64::from(parameters.last.saturating_sub(parameters.first)) / steps,
            rate_min_hz: 0.8 * f64::from(parameters.rpm) / 60.0,
        }
    }
}
