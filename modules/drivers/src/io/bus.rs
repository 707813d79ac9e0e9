//! A Modbus line: what is read and written when, and which devices answer.

use super::config::{ConfigError, Modbus, SignalKeys};
use super::signal::{Signal, place};
use base::serial::Word;
use base::{Duration, Fault, Instant, Severity};
use messages::lowlevel::{DataBus, Node};
use modbus::pdu::Data;
use modbus::value::{Kind, Number, Place};
use modbus::{Failure, Line, Master, Request, Table};
use module::{Actions, Input, PortId};

/// A device that is lost, and a request that was refused, are tried again after this time.
const RETRY: Duration = Duration::from_secs(1);

/// Whether a device answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Contact {
    /// It has not been asked yet.
    Unknown,
    /// It answers.
    Answers,
    /// It does not.
    Lost,
}

/// A device of the line.
#[derive(Debug)]
struct Unit {
    number: u8,
    contact: Contact,
    /// It is not asked before.
    gate: Instant,
    requests: i64,
    timeouts: i64,
    damaged: i64,
    /// Times from request to answer since the last statistics, s.
    round_trips: Vec<f64>,
}

/// One request, again and again.
#[derive(Debug)]
struct Job {
    unit: usize,
    table: Table,
    /// Its first address.
    address: u16,
    /// Number of addresses.
    count: u16,
    /// The signals in it.
    members: Vec<(usize, Place)>,
    /// Of a job that writes: what the device confirmed last. Absent: it must be written.
    written: Option<Vec<f64>>,
    writes: bool,
    several: bool,
    due: Instant,
    /// After a refusal: not before.
    gate: Instant,
    refused: bool,
}

/// A line.
#[derive(Debug)]
pub(super) struct Bus {
    port: PortId,
    name: String,
    line: Line,
    period: Duration,
    refresh: Duration,
    master: Master,
    units: Vec<Unit>,
    jobs: Vec<Job>,
    /// The job that is under way, and of one that writes its values.
    asked: Option<(usize, Vec<f64>)>,
    /// The last request was a change of an output: a read that is due comes next.
    preferred: bool,
    /// `None` until the host has reported the port.
    up: Option<bool>,
    /// Characters on the line since the last statistics.
    characters: usize,
}

impl Bus {
    pub fn new(config: &Modbus, port: PortId, signals: &[Signal]) -> Result<Self, ConfigError> {
        let keys = &config.keys;
        let mut units: Vec<Unit> = Vec::new();
        for number in keys.signals.iter().map(|signal| signal.unit(keys.unit)) {
            if config.line != Line::Tcp && !(1..=247).contains(&number) {
                return Err(ConfigError::Unit);
            }
            if !units.iter().any(|unit| unit.number == number) {
                units.push(Unit::new(number));
            }
        }
        let usual = modbus::Config::new(config.line);
        let times = modbus::Config { time_limit: keys.time_limit, quarantine: keys.time_limit, ..usual };
        let master = Master::new(modbus::Config { retries: keys.retries, ..times }).map_err(|_| ConfigError::Line)?;
        let jobs = jobs(&keys.signals, keys.unit, &units, signals);
        Ok(Self {
            port,
            name: config.bus.clone(),
            line: config.line,
            period: keys.period,
            refresh: keys.refresh,
            master,
            units,
            jobs,
            asked: None,
            preferred: false,
            up: None,
            characters: 0,
        })
    }

    /// Whether all devices answer; `None` while that is not known.
    pub fn works(&self) -> Option<bool> {
        let contact = |contact| self.units.iter().any(|unit| unit.contact == contact);
        match self.up {
            Some(true) if contact(Contact::Lost) => Some(false),
            Some(true) if contact(Contact::Unknown) => None,
            up => up,
        }
    }

    /// True if all outputs that can be reached have been confirmed as they should be.
    pub fn is_settled(&self, signals: &[Signal]) -> bool {
        let settled = |job: &Job| {
            job.refused || self.units[job.unit].contact == Contact::Lost || !job.writes || !job.has_changed(signals)
        };
        self.up != Some(true) || self.jobs.iter().all(settled)
    }

    pub fn on_port(&mut self, now: Instant, input: &Input<'_>, out: &mut Actions) {
        match input {
            Input::Up => {
                out.clear(Fault::PortDown, self.name.as_str(), format!("{} is up", self.name));
                self.begin_anew(now);
                self.up = Some(true);
            }
            Input::Down(why) => {
                let message = format!("{} is down: {why}; retrying", self.name);
                out.raise(Severity::Error, Fault::PortDown, self.name.as_str(), message);
                self.begin_anew(now);
                self.up = Some(false);
            }
            Input::Words(words) if self.up == Some(true) => {
                self.characters += words.len();
                let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
                self.master.handle_rx(now, &bytes);
            }
            _ => {}
        }
    }

    /// The devices may be others, or were switched off: all is asked and written again.
    fn begin_anew(&mut self, now: Instant) {
        self.master.reset(now);
        let _ = self.master.poll_event();
        self.asked = None;
        self.units.iter_mut().for_each(|unit| unit.gate = now);
        for job in &mut self.jobs {
            (job.due, job.gate, job.written) = (now, now, None);
        }
    }

    /// Takes what came, and sends what is due.
    pub fn serve(&mut self, now: Instant, signals: &mut [Signal], reads: bool, out: &mut Actions) {
        self.master.handle_timeout(now);
        self.take_event(now, signals, out);
        if self.up == Some(true) && self.master.is_idle() {
            self.ask(now, signals, reads);
        }
        while let Some(frame) = self.master.poll_tx(now) {
            self.characters += frame.len();
            let words: Vec<Word> = frame.iter().copied().map(Word::data).collect();
            out.send_words(self.port, &words);
        }
    }

    fn ask(&mut self, now: Instant, signals: &[Signal], reads: bool) {
        let due = |job: &Job| self.deadline(job, signals, reads).is_some_and(|due| due <= now);
        let urgent = |job: &Job| job.writes && !self.preferred && job.has_changed(signals);
        let ready = self.jobs.iter().enumerate().filter(|(_, job)| due(job));
        let Some((n, job)) = ready.min_by_key(|(_, job)| (!urgent(job), job.due)) else { return };
        let changes = urgent(job);
        let values = job.targets(signals);
        let unit = job.unit;
        let request = job.request(&values);
        match request.map(|request| self.master.request(self.units[unit].number, request)) {
            Some(Ok(())) => {
                self.preferred = changes;
                self.units[unit].requests += 1;
                self.asked = Some((n, values));
            }
            // The configuration was checked; whatever it is, it must not be due again at once.
            _ => self.jobs[n].gate = now + RETRY,
        }
    }

    fn take_event(&mut self, now: Instant, signals: &mut [Signal], out: &mut Actions) {
        let Some(event) = self.master.poll_event() else { return };
        let Some((n, values)) = self.asked.take() else { return };
        let period = if self.jobs[n].writes { self.refresh } else { self.period };
        self.jobs[n].due = self.jobs[n].due.min(event.sent).next_on_grid(now, period);
        match event.result {
            Ok(data) => {
                self.answered(n, Some(now.since(event.sent)), out);
                let name = self.subject_of(n);
                let job = &mut self.jobs[n];
                if std::mem::take(&mut job.refused) {
                    out.clear(Fault::IoDeviceRefused, name.as_str(), format!("{name}: accepted"));
                }
                job.take(event.sent, &data, values, signals);
            }
            Err(Failure::Exception(exception)) => {
                self.answered(n, None, out);
                let name = self.subject_of(n);
                let message = format!("{name}: {}; tried once a second", Failure::Exception(exception));
                out.raise(Severity::Error, Fault::IoDeviceRefused, name, message);
                let job = &mut self.jobs[n];
                (job.refused, job.gate, job.written) = (true, now + RETRY, None);
            }
            Err(failure) => self.lost(now, n, failure, out),
        }
    }

    fn subject(&self, unit: usize) -> String {
        format!("{} unit {}", self.name, self.units[unit].number)
    }

    fn subject_of(&self, job: usize) -> String {
        let Job { unit, table, address, .. } = self.jobs[job];
        format!("{} {table} {address}", self.subject(unit))
    }

    fn answered(&mut self, job: usize, took: Option<Duration>, out: &mut Actions) {
        let unit = self.jobs[job].unit;
        let subject = self.subject(unit);
        let Unit { contact, round_trips, .. } = &mut self.units[unit];
        if std::mem::replace(contact, Contact::Answers) == Contact::Lost {
            out.clear(Fault::IoDeviceLost, subject.as_str(), format!("{subject} answers"));
        }
        round_trips.extend(took.map(|took| took.as_secs_f64()));
    }

    fn lost(&mut self, now: Instant, job: usize, failure: Failure, out: &mut Actions) {
        let place = self.jobs[job].unit;
        let subject = self.subject(place);
        let unit = &mut self.units[place];
        (unit.contact, unit.gate) = (Contact::Lost, now + RETRY);
        match failure {
            Failure::Damaged => unit.damaged += 1,
            _ => unit.timeouts += 1,
        }
        // It may have been switched off, and its outputs with it.
        self.jobs.iter_mut().filter(|job| job.unit == place).for_each(|job| job.written = None);
        let message = format!("{subject}: {failure}; asked once a second");
        out.raise(Severity::Error, Fault::IoDeviceLost, subject, message);
    }

    /// When a job is to be done; `None`: not in this state.
    fn deadline(&self, job: &Job, signals: &[Signal], reads: bool) -> Option<Instant> {
        let gate = self.units[job.unit].gate.max(job.gate);
        match (job.writes, job.writes && job.has_changed(signals)) {
            (true, true) => Some(gate),
            (true, false) => Some(gate.max(job.due)),
            (false, _) => reads.then(|| gate.max(job.due)),
        }
    }

    pub fn poll_timeout(&self, signals: &[Signal], reads: bool) -> Option<Instant> {
        if self.up != Some(true) || !self.master.is_idle() {
            return self.master.poll_timeout();
        }
        self.jobs.iter().filter_map(|job| self.deadline(job, signals, reads)).min()
    }

    /// Publishes `LL_DATA_BUS`, and begins a new second.
    pub fn publish(&mut self, now: Instant, out: &mut Actions) {
        let counters = self.master.counters();
        let load = self.line.time_of(std::mem::take(&mut self.characters)).as_secs_f64();
        out.publish(DataBus {
            timestamp: out.timestamp(now),
            bus: self.name.clone(),
            load: load.min(1.0),
            frames: i64::from(counters.sent) + i64::from(counters.answers) + i64::from(counters.exceptions),
            errors: i64::from(counters.silent) + i64::from(counters.rejected()),
            state: if self.up == Some(true) { DataBus::ACTIVE } else { DataBus::CLOSED },
            nodes: self.units.iter_mut().map(Unit::shown).collect(),
        });
    }
}

impl Unit {
    fn new(number: u8) -> Self {
        Self {
            number,
            contact: Contact::Unknown,
            gate: Instant::ZERO,
            requests: 0,
            timeouts: 0,
            damaged: 0,
            round_trips: Vec::new(),
        }
    }

    fn shown(&mut self) -> Node {
        let trips = std::mem::take(&mut self.round_trips);
        let least = |pick: fn(f64, f64) -> f64| trips.iter().copied().reduce(pick).unwrap_or(f64::NAN);
        Node {
            name: format!("unit {}", self.number),
            address: self.number.into(),
            state: if self.contact == Contact::Lost { Node::LOST } else { Node::OK },
            requests: self.requests,
            retries: 0,
            timeouts: self.timeouts,
            crc_errors: self.damaged,
            round_trip_min: least(f64::min),
            round_trip_mean: trips.iter().sum::<f64>() / trips.len() as f64,
            round_trip_max: least(f64::max),
        }
    }
}

/// Jobs of a line: adjacent inputs are read at once; outputs are written one by one, bits of a register together.
fn jobs(keys: &[SignalKeys], unit: u8, units: &[Unit], signals: &[Signal]) -> Vec<Job> {
    let mut keys: Vec<&SignalKeys> = keys.iter().collect();
    keys.sort_by_key(|keys| (keys.output, keys.unit(unit), keys.table, keys.address, keys.bit));
    let mut jobs: Vec<Job> = Vec::new();
    for keys in keys {
        let place_of = keys.place();
        let number = keys.unit(unit);
        let of_unit = units.iter().position(|unit| unit.number == number).unwrap_or_default();
        let member = (place(signals, &keys.name).unwrap_or_default(), place_of);
        match jobs.last_mut().filter(|job| job.unit == of_unit && job.takes(keys, &place_of)) {
            Some(job) => job.add(member),
            None => jobs.push(Job::new(of_unit, keys, member)),
        }
    }
    jobs
}

impl Job {
    fn new(unit: usize, keys: &SignalKeys, (signal, place): (usize, Place)) -> Self {
        Self {
            unit,
            table: keys.table,
            address: keys.address,
            count: place.width(),
            members: vec![(signal, place)],
            written: None,
            writes: keys.output,
            several: keys.write_several,
            due: Instant::ZERO,
            gate: Instant::ZERO,
            refused: false,
        }
    }

    /// True if the signal can be in this request; they come in the order of their addresses.
    fn takes(&self, keys: &SignalKeys, place: &Place) -> bool {
        if (self.table, self.writes) != (keys.table, keys.output) {
            return false;
        }
        if self.writes {
            return place.kind == Kind::Bit && !self.table.is_bits() && self.address == keys.address;
        }
        let (end, next) = (u32::from(self.address) + u32::from(self.count), u32::from(keys.address));
        let count = next + u32::from(place.width()) - u32::from(self.address);
        next <= end && count <= u32::from(self.table.read_max())
    }

    fn add(&mut self, (signal, place): (usize, Place)) {
        self.count = self.count.max(place.address - self.address + place.width());
        self.members.push((signal, place));
    }

    /// What is to be written; of inputs nothing.
    fn targets(&self, signals: &[Signal]) -> Vec<f64> {
        self.members.iter().filter_map(|(signal, _)| signals[*signal].target()).collect()
    }

    /// True if the device has not confirmed what is to be written.
    fn has_changed(&self, signals: &[Signal]) -> bool {
        let targets = self.members.iter().filter_map(|(signal, _)| signals[*signal].target());
        self.written.as_ref().is_none_or(|written| !targets.eq(written.iter().copied()))
    }

    fn request(&self, values: &[f64]) -> Option<Request> {
        let Self { table, address, count, .. } = *self;
        if !self.writes {
            return Some(Request::Read { table, address, count });
        }
        let numbers = self.members.iter().zip(values).map(|((_, place), value)| Some((place, place.number(*value)?)));
        let mut bits = 0;
        for number in numbers {
            match number? {
                (_, Number::Bit(on)) if table.is_bits() => return Some(Request::WriteCoil { address, on }),
                (place, Number::Bit(on)) => bits |= u16::from(on) << place.bit,
                (_, Number::Words(words)) => return Some(self.write(&words)),
            }
        }
        Some(self.write(&[bits]))
    }

    fn write(&self, words: &[u16]) -> Request {
        let address = self.address;
        match words {
            [word] if !self.several => Request::WriteRegister { address, word: *word },
            words => Request::WriteRegisters { address, words: words.iter().copied().collect() },
        }
    }

    /// Takes the answer to a request that was sent at `at`.
    fn take(&mut self, at: Instant, data: &Data, values: Vec<f64>, signals: &mut [Signal]) {
        if self.writes {
            for ((signal, _), value) in self.members.iter().zip(&values) {
                signals[*signal].take(at, *value);
            }
            self.written = Some(values);
            return;
        }
        for (signal, place) in &self.members {
            let first = usize::from(place.address - self.address);
            let value = if self.table.is_bits() {
                data.bit(first).map(|bit| place.of_bit(bit))
            } else {
                // The second one is used by values of two registers only.
                data.word(first).map(|word| place.of_words([word, data.word(first + 1).unwrap_or_default()]))
            };
            if let Some(value) = value {
                signals[*signal].take(at, value);
            }
        }
    }
}
