//! A line of devices with simple request and answer: what is asked and written when, and which devices answer.

use super::config::ConfigError;
use super::serial::{FieldKeys, RequestKeys, Serial};
use super::signal::{Signal, place};
use base::serial::Word;
use base::{Duration, Fault, Instant, Severity};
use exchange::value::Place;
use exchange::{Answer, Bytes, Config, Expected, Failure, Master, Protocol};
use messages::lowlevel::{DataBus, Node};
use module::{Actions, Input, PortId};

/// A device that is lost is tried again after this time.
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
struct Device {
    name: String,
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
    name: String,
    device: usize,
    /// Data of the request; outputs are written into a copy.
    request: Bytes,
    answer: Answer,
    /// The signals in it.
    members: Vec<(usize, Place)>,
    writes: bool,
    /// Of a job that writes: what the device confirmed last. Absent: it must be written.
    written: Option<Vec<f64>>,
    due: Instant,
}

/// A line.
#[derive(Debug)]
pub(super) struct Line {
    port: PortId,
    name: String,
    protocol: Protocol,
    config: Config,
    period: Duration,
    refresh: Duration,
    master: Master,
    devices: Vec<Device>,
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

impl Line {
    /// A line whose port is not open.
    ///
    /// # Errors
    /// A request is too long, or its answer has neither a length nor an end.
    pub fn new(serial: &Serial, port: PortId, signals: &[Signal]) -> Result<Self, ConfigError> {
        let keys = &serial.keys;
        let config = Config { baud: serial.baud, time_limit: keys.time_limit, retries: keys.retries, gap: keys.gap };
        let mut devices: Vec<Device> = Vec::new();
        let mut jobs = Vec::new();
        for request in &keys.requests {
            let device = devices.iter().position(|device| device.name == request.device).unwrap_or_else(|| {
                devices.push(Device::new(&request.device));
                devices.len() - 1
            });
            jobs.push(Job::new(request, device, signals));
        }
        let protocol = keys.protocol();
        if jobs.iter().any(|job| job.frame(&protocol, &job.targets(signals)).is_none()) {
            return Err(ConfigError::Request);
        }
        Ok(Self {
            port,
            name: serial.bus.clone(),
            protocol,
            config,
            period: keys.period,
            refresh: keys.refresh,
            master: Master::new(config),
            devices,
            jobs,
            asked: None,
            preferred: false,
            up: None,
            characters: 0,
        })
    }

    /// Whether all devices answer; `None` while that is not known.
    pub fn works(&self) -> Option<bool> {
        let contact = |contact| self.devices.iter().any(|device| device.contact == contact);
        match self.up {
            Some(true) if contact(Contact::Lost) => Some(false),
            Some(true) if contact(Contact::Unknown) => None,
            up => up,
        }
    }

    /// True if all outputs that can be reached have been confirmed as they should be.
    pub fn is_settled(&self, signals: &[Signal]) -> bool {
        let settled =
            |job: &Job| self.devices[job.device].contact == Contact::Lost || !job.writes || !job.has_changed(signals);
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
        self.devices.iter_mut().for_each(|device| device.gate = now);
        for job in &mut self.jobs {
            (job.due, job.written) = (now, None);
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
        let (changes, values, device) = (urgent(job), job.targets(signals), job.device);
        let taken = job.frame(&self.protocol, &values);
        if taken.is_some_and(|(frame, expected)| self.master.request(now, frame, expected)) {
            self.preferred = changes;
            self.devices[device].requests += 1;
            self.asked = Some((n, values));
        } else {
            // The configuration was checked; whatever it is, it must not be due again at once.
            self.devices[device].gate = now + RETRY;
        }
    }

    fn take_event(&mut self, now: Instant, signals: &mut [Signal], out: &mut Actions) {
        let Some(event) = self.master.poll_event() else { return };
        let Some((n, values)) = self.asked.take() else { return };
        let period = if self.jobs[n].writes { self.refresh } else { self.period };
        self.jobs[n].due = self.jobs[n].due.min(event.sent).next_on_grid(now, period);
        match event.result {
            Ok(data) => {
                self.answered(n, now.since(event.sent), out);
                self.jobs[n].take(event.sent, &data, values, signals);
            }
            Err(failure) => self.lost(now, n, failure, out),
        }
    }

    fn subject(&self, device: usize) -> String {
        format!("{} {}", self.name, self.devices[device].name)
    }

    fn answered(&mut self, job: usize, took: Duration, out: &mut Actions) {
        let place = self.jobs[job].device;
        let subject = self.subject(place);
        let Device { contact, round_trips, .. } = &mut self.devices[place];
        if std::mem::replace(contact, Contact::Answers) == Contact::Lost {
            out.clear(Fault::IoDeviceLost, subject.as_str(), format!("{subject} answers"));
        }
        round_trips.push(took.as_secs_f64());
    }

    fn lost(&mut self, now: Instant, job: usize, failure: Failure, out: &mut Actions) {
        let place = self.jobs[job].device;
        let subject = self.subject(place);
        let device = &mut self.devices[place];
        (device.contact, device.gate) = (Contact::Lost, now + RETRY);
        match failure {
            Failure::Damaged => device.damaged += 1,
            _ => device.timeouts += 1,
        }
        // It may have been switched off, and its outputs with it.
        self.jobs.iter_mut().filter(|job| job.device == place).for_each(|job| job.written = None);
        let message = format!("{subject}: request {:?}: {failure}; asked once a second", self.jobs[job].name);
        out.raise(Severity::Error, Fault::IoDeviceLost, subject, message);
    }

    /// When a job is to be done; `None`: not in this state.
    fn deadline(&self, job: &Job, signals: &[Signal], reads: bool) -> Option<Instant> {
        let gate = self.devices[job.device].gate;
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
        let load = self.config.time_of(std::mem::take(&mut self.characters)).as_secs_f64();
        let devices = self.devices.iter_mut().enumerate();
        out.publish(DataBus {
            timestamp: out.timestamp(now),
            bus: self.name.clone(),
            load: load.min(1.0),
            frames: i64::from(counters.sent) + i64::from(counters.answers),
            errors: i64::from(counters.silent) + i64::from(counters.rejected()),
            state: if self.up == Some(true) { DataBus::ACTIVE } else { DataBus::CLOSED },
            nodes: devices.map(|(n, device)| device.shown(n)).collect(),
        });
    }
}

impl Device {
    fn new(name: &str) -> Self {
        Self {
            name: name.into(),
            contact: Contact::Unknown,
            gate: Instant::ZERO,
            requests: 0,
            timeouts: 0,
            damaged: 0,
            round_trips: Vec::new(),
        }
    }

    fn shown(&mut self, number: usize) -> Node {
        let trips = std::mem::take(&mut self.round_trips);
        let least = |pick: fn(f64, f64) -> f64| trips.iter().copied().reduce(pick).unwrap_or(f64::NAN);
        Node {
            name: self.name.clone(),
            address: number as i32,
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

impl Job {
    fn new(keys: &RequestKeys, device: usize, signals: &[Signal]) -> Self {
        let member = |field: &FieldKeys| (place(signals, &field.name), field.place());
        let members = keys.signals.iter().map(member).filter_map(|(signal, place)| Some((signal?, place)));
        Self {
            name: keys.name.clone(),
            device,
            request: keys.request.as_slice().iter().copied().collect(),
            answer: keys.answer(),
            members: members.collect(),
            writes: keys.writes(),
            written: None,
            due: Instant::ZERO,
        }
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

    /// The request with these values in it, and what is answered.
    fn frame(&self, protocol: &Protocol, values: &[f64]) -> Option<(Bytes, Expected)> {
        let mut data = self.request.clone();
        let mut members = self.members.iter().filter(|_| self.writes).zip(values);
        if !members.all(|((_, place), value)| place.write(*value, &mut data)) {
            return None;
        }
        let frame = protocol.request(&data)?;
        let expected = protocol.expect(&self.answer, &frame)?;
        Some((frame, expected))
    }

    /// Takes the answer to a request that was sent at `at`.
    fn take(&mut self, at: Instant, data: &Bytes, values: Vec<f64>, signals: &mut [Signal]) {
        if self.writes {
            for ((signal, _), value) in self.members.iter().zip(&values) {
                signals[*signal].take(at, *value);
            }
            self.written = Some(values);
            return;
        }
        for (signal, place) in &self.members {
            match place.value(data) {
                Some(value) => signals[*signal].take(at, value),
                None => signals[*signal].lose(),
            }
        }
    }
}
