//! A logger, and a disk that takes its time and loses in a power cut what was not synchronized.

use crate::ros::{RobotScene, Translator};
use crate::{Config, Logger, NAME};
use base::store::{Answer, Entry, Request, Trouble};
use base::{Duration, Instant, Report};
use mcap::read::{MessageStream, Options};
use messages::common::{CmdLog, DataLog};
use messages::{Channel, Message, lowlevel};
use module::bench::Bench;
use module::{Action, Event, Input, Output, PortId, Shell, ShellConfig};
use std::collections::BTreeMap;

pub const PORT: PortId = PortId(0);

pub struct Store {
    /// Content, and how much of it is on the medium.
    pub files: BTreeMap<String, (Vec<u8>, usize)>,
    pub open: Option<String>,
    pub capacity: usize,
    pub bytes_per_ms: usize,
    pub sync: Duration,
    pub trouble: Option<Trouble>,
    pub asked: Option<(Instant, Request)>,
    pub syncs: u64,
    pub appends: u64,
}

impl Default for Store {
    fn default() -> Self {
        Self {
            files: BTreeMap::new(),
            open: None,
            capacity: 1 << 30,
            bytes_per_ms: 40_000,
            sync: Duration::from_millis(5),
            trouble: None,
            asked: None,
            syncs: 0,
            appends: 0,
        }
    }
}

impl Store {
    pub fn send_now(&mut self, now: Instant, request: Request) {
        assert!(self.asked.is_none(), "one at a time");
        let takes = match &request {
            Request::Append { bytes, sync } => {
                let sync = if *sync { self.sync } else { Duration::ZERO };
                Duration::from_micros((bytes.len() * 1000 / self.bytes_per_ms) as u64) + sync
            }
            Request::Create { .. } => self.sync,
            Request::Remove { .. } | Request::List => Duration::from_micros(100),
        };
        self.asked = Some((now + takes, request));
    }

    pub fn due(&self) -> Option<Instant> {
        self.asked.as_ref().map(|(due, _)| *due)
    }

    /// What is on its way is never answered.
    pub fn forget(&mut self) {
        (self.asked, self.open) = (None, None);
    }

    pub fn free(&self) -> usize {
        self.capacity.saturating_sub(self.files.values().map(|(bytes, _)| bytes.len()).sum())
    }

    pub fn put(&mut self, name: &str, bytes: usize) {
        self.files.insert(name.into(), (vec![0; bytes], bytes));
    }

    pub fn folders(&self) -> Vec<&str> {
        let mut folders: Vec<&str> = self.files.keys().filter_map(|name| name.split('/').next()).collect();
        folders.dedup();
        folders
    }

    fn perform(&mut self) -> Answer {
        let Some((_, request)) = self.asked.take() else { panic!("nothing was asked") };
        if let Some(trouble) = &self.trouble
            && request != Request::List
        {
            return Answer::Failed(trouble.clone());
        }
        match request {
            Request::Create { name } => {
                assert!(base::store::is_name(&name), "{name}");
                if self.files.contains_key(&name) {
                    return Answer::Failed(Trouble::Other("it is there already".into()));
                }
                self.close();
                self.files.insert(name.clone(), (Vec::new(), 0));
                self.open = Some(name);
            }
            Request::Append { bytes, sync } => {
                if bytes.len() > self.free() {
                    return Answer::Failed(Trouble::Full);
                }
                let Some(file) = self.open.as_ref().and_then(|name| self.files.get_mut(name)) else {
                    return Answer::Failed(Trouble::Other("no file is open".into()));
                };
                file.0.extend_from_slice(&bytes);
                if sync {
                    file.1 = file.0.len();
                }
                self.syncs += u64::from(sync);
                self.appends += 1;
            }
            Request::Remove { name } => {
                let inside = format!("{name}/");
                self.files.retain(|path, _| *path != name && !path.starts_with(&inside));
            }
            Request::List => {
                let mut entries: Vec<Entry> = Vec::new();
                for (path, (bytes, _)) in &self.files {
                    let (name, bytes) = (path.split('/').next().unwrap(), bytes.len() as u64);
                    match entries.last_mut().filter(|last| last.name == name) {
                        Some(last) => last.bytes += bytes,
                        None => entries.push(Entry { name: name.into(), bytes }),
                    }
                }
                return Answer::Listed { entries, free: self.free() as u64 };
            }
        }
        Answer::Done { free: self.free() as u64 }
    }

    fn close(&mut self) {
        if let Some(file) = self.open.take().and_then(|name| self.files.get_mut(&name)) {
            file.1 = file.0.len();
        }
    }
}

pub struct Rig {
    pub bench: Bench,
    pub store: Store,
    pub reports: Vec<Report>,
    pub told: Vec<DataLog>,
    pub ended: bool,
}

impl Rig {
    /// One that has started, on this disk.
    pub fn on(store: Store, config: Config) -> Self {
        let shell =
            Shell::new(ShellConfig::new(NAME), Box::new(Logger::new(config, Translator::new(RobotScene::default()))));
        let bench = Bench::new(shell);
        let mut rig = Self { bench, store, reports: Vec::new(), told: Vec::new(), ended: false };
        rig.bench.start();
        rig.collect();
        rig
    }

    pub fn new(config: Config) -> Self {
        let mut rig = Self::on(Store::default(), config);
        rig.ms(20);
        rig
    }

    fn collect(&mut self) {
        for (at, action) in self.bench.done() {
            match action {
                Action::Send(PORT, Output::Store(request)) => self.store.send_now(at, request),
                Action::Report(report) => self.reports.push(report),
                Action::Publish(Message::CmDataLog(told)) => self.told.push(told),
                Action::Exit(_) => self.ended = true,
                _ => {}
            }
        }
    }

    pub fn pass(&mut self, duration: Duration) {
        let end = self.bench.now() + duration;
        loop {
            self.collect();
            let until = self.store.due().map_or(end, |due| due.min(end));
            if self.bench.step(until) {
                continue;
            }
            self.bench.pass(until.since(self.bench.now()));
            if self.store.due().is_some_and(|due| due <= until) {
                let answer = self.store.perform();
                self.bench.store(PORT, &answer);
            } else if until == end {
                return;
            }
        }
    }

    pub fn ms(&mut self, millis: u64) {
        self.pass(Duration::from_millis(millis));
    }

    pub fn hear(&mut self, channel: &str, data: &[u8]) {
        self.bench.event(Event::RawMessage { at: self.bench.now(), channel, data });
        self.collect();
    }

    pub fn heard(&mut self, message: impl Into<Message>) {
        self.bench.raw_message(message);
        self.collect();
    }

    pub fn odo(&mut self, ticks: i32) {
        let timestamp = (self.bench.now().as_nanos() / 1000) as i64;
        self.heard(lowlevel::DataOdo { timestamp, ticks_left: ticks, ..Default::default() });
    }

    pub fn order(&mut self, action: i8, text: &str) {
        let timestamp = (self.bench.now().as_nanos() / 1000) as i64;
        self.heard(CmdLog { timestamp, action, text: text.into() });
    }

    pub fn port(&mut self, input: Input<'_>) {
        self.bench.event(Event::Port { port: PORT, input });
        self.collect();
    }

    pub fn file(&self, name: &str) -> &[u8] {
        &self.store.files[name].0
    }

    /// The files that are there, in order.
    pub fn names(&self) -> Vec<&str> {
        self.store.files.keys().map(String::as_str).collect()
    }

    /// How often a fault was reported: begun, ended.
    pub fn faults(&self, fault: base::Fault) -> (usize, usize) {
        let of = |notice: bool| {
            let is = |report: &&Report| report.fault == fault && (report.severity == base::Severity::Notice) == notice;
            self.reports.iter().filter(is).count()
        };
        (of(false), of(true))
    }
}

/// A message that was read again.
#[derive(Clone, Debug, PartialEq)]
pub struct Read {
    pub topic: String,
    pub encoding: String,
    /// Name and encoding.
    pub schema: Option<(String, String)>,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
    pub data: Vec<u8>,
}

/// All messages of a file, whole or not, up to where it cannot be read on.
pub fn read(bytes: &[u8]) -> Vec<Read> {
    let Ok(stream) = MessageStream::new_with_options(bytes, Options::IgnoreEndMagic.into()) else { return Vec::new() };
    stream
        .map_while(Result::ok)
        .map(|message| Read {
            topic: message.channel.topic.clone(),
            encoding: message.channel.message_encoding.clone(),
            schema: message.channel.schema.as_ref().map(|schema| (schema.name.clone(), schema.encoding.clone())),
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.publish_time,
            data: message.data.into_owned(),
        })
        .collect()
}

/// Those as they were on the bus.
pub fn raw(bytes: &[u8]) -> Vec<Read> {
    read(bytes).into_iter().filter(|message| message.encoding == "lcm").collect()
}

/// The values of the metadata of one name, in order.
pub fn notes(bytes: &[u8], name: &str) -> Vec<BTreeMap<String, String>> {
    let summary = mcap::Summary::read(bytes).unwrap().unwrap();
    let indexes = summary.metadata_indexes.iter().filter(|index| index.name == name);
    indexes.map(|index| mcap::read::metadata(bytes, index).unwrap().metadata).collect()
}

/// Odometry as it is on the bus.
pub fn odo_ticks(data: &[u8]) -> i32 {
    match Message::decode(Channel::LlDataOdo, data) {
        Ok(Message::LlDataOdo(odo)) => odo.ticks_left,
        other => panic!("{other:?}"),
    }
}
