//! Logger for a test: `advee run logger` on an unused bus and in a folder of its own, ended by its pid; and its output,
//! read by an independent reader.
#![allow(dead_code, reason = "each test binary uses its part")]

use crate::support::{Turn, advee, can_port, listen, signal, turn};
use lcm::live::{Lcm, PublishError};
use mcap::read::{MessageStream, Options};
use messages::{Channel, Message, common};
use std::fs::{self, OpenOptions};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Bus, folder, and the recording processes.
pub struct Rig {
    pub url: String,
    pub root: PathBuf,
    pub bus: Lcm,
    /// Last status of the logger, and the received reports.
    pub last: Option<common::DataLog>,
    pub errors: Vec<common::Error>,
    _turn: Arc<Turn>,
}

/// Recorded message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    pub topic: String,
    pub sequence: u32,
    pub log_time: u64,
    pub data: Vec<u8>,
}

impl Rig {
    pub fn new() -> Self {
        let port = can_port();
        let root = std::env::temp_dir().join(format!("advee-log-{}-{port}", std::process::id()));
        Self::at(port, root)
    }

    /// Creates a rig in an existing folder.
    pub fn at(port: u16, root: PathBuf) -> Self {
        let turn = turn();
        let url = format!("udpm://239.255.76.67:{port}?ttl=0&shm=auto");
        fs::create_dir_all(&root).expect("the folder can be made");
        let bus = listen(&url);
        Self { url, root, bus, last: None, errors: Vec::new(), _turn: turn }
    }

    pub fn folder(&self) -> PathBuf {
        self.root.join("log")
    }

    /// Standard error of all loggers of this rig.
    pub fn said(&self) -> String {
        fs::read_to_string(self.stderr()).unwrap_or_default()
    }

    /// Outside the folder, whose disk may be full.
    fn stderr(&self) -> PathBuf {
        self.root.with_extension("stderr")
    }

    /// Starts a logger; `sets` are overrides of `robot.toml`.
    pub fn spawn(&self, sets: &[&str]) -> Logger {
        let said = OpenOptions::new().append(true).create(true).open(self.stderr()).expect("a file");
        let mut command = advee(&self.url, &self.root.join("run"));
        command.args(["run", "logger", "--set", &format!("log.folder={:?}", self.folder())]);
        command.args(sets.iter().flat_map(|set| ["--set", set]));
        Logger(command.stdin(Stdio::null()).stderr(said).spawn().expect("the executable is built"))
    }

    /// Starts a logger, and waits until it records.
    pub fn start(&mut self, sets: &[&str]) -> Logger {
        self.last = None;
        let logger = self.spawn(sets);
        self.until("it records", 20.0, |rig| rig.last.as_ref().is_some_and(|log| log.recording));
        logger
    }

    #[track_caller]
    pub fn until(&mut self, what: &str, seconds: f64, mut condition: impl FnMut(&Self) -> bool) {
        let begin = Instant::now();
        while !condition(self) {
            assert!(begin.elapsed().as_secs_f64() < seconds, "not within {seconds} s: {what}\n{}", self.said());
            self.bus.wait(Duration::from_millis(20)).expect("the bus can be waited for");
            self.listen();
        }
    }

    /// Processes received messages.
    pub fn listen(&mut self) {
        while let Some(received) = self.bus.recv().expect("the bus can be read") {
            match Channel::from_name(received.channel).map(|channel| Message::decode(channel, received.payload)) {
                Some(Ok(Message::CmDataLog(log))) => self.last = Some(log),
                Some(Ok(Message::CmEventError(error))) => self.errors.push(error),
                _ => {}
            }
        }
    }

    /// Publishes, and retries while the kernel's buffer is full.
    pub fn publish(&mut self, channel: &str, data: &[u8]) {
        publish(&mut self.bus, channel, data);
    }

    /// All files of all runs, in order.
    pub fn files(&self) -> Vec<PathBuf> {
        let entries = |folder: &Path| {
            let mut paths: Vec<PathBuf> =
                fs::read_dir(folder).into_iter().flatten().map(|entry| entry.expect("an entry").path()).collect();
            paths.sort();
            paths
        };
        let files = entries(&self.folder()).into_iter().flat_map(|run| entries(&run));
        files.filter(|file| file.extension().is_some_and(|extension| extension == "mcap")).collect()
    }

    /// All recorded raw messages.
    pub fn raw(&self) -> Vec<Recorded> {
        self.files().iter().flat_map(|file| raw(file)).collect()
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.root);
        let _ = fs::remove_file(self.stderr());
    }
}

/// Publishes, and retries while the kernel's buffer is full.
pub fn publish(bus: &mut Lcm, channel: &str, data: &[u8]) {
    while let Err(error) = bus.publish(channel, data) {
        assert!(matches!(error, PublishError::Busy), "{error}");
        std::thread::sleep(Duration::from_micros(100));
    }
}

/// Raw messages of a file, up to its end or the first damage.
pub fn raw(file: &Path) -> Vec<Recorded> {
    let bytes = fs::read(file).expect("the file can be read");
    let stream = MessageStream::new_with_options(&bytes, Options::IgnoreEndMagic.into()).expect("no file is refused");
    let lcm = stream.map_while(Result::ok).filter(|message| message.channel.message_encoding == "lcm");
    let recorded = lcm.map(|message| Recorded {
        topic: message.channel.topic.clone(),
        sequence: message.sequence,
        log_time: message.log_time,
        data: message.data.into_owned(),
    });
    recorded.collect()
}

/// Kills a logger that has recorded a publisher at 500 Hz for a while; returns the ms of data lost before the kill. The
/// recorded part is without a gap.
pub fn cut(rig: &mut Rig, after: Duration) -> u64 {
    let before = rig.files();
    let logger = rig.start(&[]);
    let begin = Instant::now();
    let mut count = 0u64;
    while begin.elapsed() < after {
        rig.publish("COUNT", &[count.to_le_bytes(), wall().to_le_bytes()].concat());
        count += 1;
        std::thread::sleep(Duration::from_millis(2));
    }
    let killed = wall();
    logger.kill();
    rig.listen();
    let new: Vec<PathBuf> = rig.files().into_iter().filter(|file| !before.contains(file)).collect();
    let messages: Vec<Recorded> = new.iter().flat_map(|file| raw(file)).filter(|m| m.topic == "COUNT").collect();
    let number =
        |message: &Recorded, at: usize| u64::from_le_bytes(message.data[at..at + 8].try_into().expect("8 bytes"));
    assert!(messages.iter().enumerate().all(|(n, message)| number(message, 0) == n as u64), "a gap");
    let last = messages.last().map_or_else(|| killed - after.as_nanos() as u64, |message| number(message, 8));
    killed.saturating_sub(last) / 1_000_000
}

fn wall() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970").as_nanos() as u64
}

/// Process of a logger, which ends with this value.
pub struct Logger(Child);

impl Logger {
    pub fn pid(&self) -> u32 {
        self.0.id()
    }

    /// Kills it.
    pub fn kill(mut self) {
        self.0.kill().expect("it is our child");
        self.0.wait().expect("it is our child");
    }

    /// Ends it normally; returns its exit code.
    pub fn stop(mut self) -> i32 {
        signal(self.0.id() as i32, "TERM");
        let begin = Instant::now();
        loop {
            if let Some(status) = self.0.try_wait().expect("it is our child") {
                return status.code().unwrap_or(-1);
            }
            assert!(begin.elapsed() < Duration::from_secs(20), "the logger does not end");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// True while it runs.
    pub fn runs(&mut self) -> bool {
        self.0.try_wait().expect("it is our child").is_none()
    }

    /// Proportional memory of the process, bytes (`Pss`).
    pub fn pss(&self) -> u64 {
        let text = fs::read_to_string(format!("/proc/{}/smaps_rollup", self.0.id())).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("Pss:"));
        1024 * line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok()).unwrap_or(0)
    }

    /// Processor time used, s.
    pub fn cpu(&self) -> f64 {
        let text = fs::read_to_string(format!("/proc/{}/stat", self.0.id())).unwrap_or_default();
        let fields = text.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11).take(2);
        let ticks: u64 = fields.filter_map(|field| field.parse::<u64>().ok()).sum();
        ticks as f64 / 100.0
    }
}

impl Drop for Logger {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
