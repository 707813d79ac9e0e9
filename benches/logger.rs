//! What recording costs: `cargo bench -p logger --bench logger`.
//!
//! Through the module, with a disk that takes 120 MB/s and 5 ms for each synchronization, in its own time: 50 MB/s of
//! mixed messages, and the simulated robot's own traffic of 60 kB/s. Computing time is measured, what is lost is counted.
#![allow(clippy::disallowed_methods, reason = "a bench reads what the kernel has counted")]
#![allow(clippy::unwrap_used, reason = "a bench fails by panicking")]

use base::store::{Answer, Request};
use base::{Duration, Epoch, Instant};
use logger::ros::{RobotScene, Translator};
use logger::{Compression, Config, Logger};
use messages::{Message, common, lowlevel, middlelevel};
use module::{Action, Actions, Event, Input, Module, Output, PortId};

const RATE: f64 = 120e6;
const SYNC: Duration = Duration::from_millis(5);

/// A logger on a disk that only counts.
struct Rig {
    logger: Logger,
    out: Actions,
    asked: Option<(Instant, Request)>,
    written: u64,
    syncs: u64,
    dropped: i64,
}

impl Rig {
    fn new(compression: Compression) -> Self {
        let config = Config { compression, ..Config::default() };
        let logger = Logger::new(config, Translator::new(RobotScene::default()));
        let out = Actions::new(Epoch::default());
        let mut rig = Self { logger, out, asked: None, written: 0, syncs: 0, dropped: 0 };
        rig.event(Instant::ZERO, Event::Start);
        rig.event(Instant::ZERO, Event::Port { port: PortId(0), input: Input::Up });
        rig.until(Instant::from_millis(100));
        rig
    }

    fn event(&mut self, now: Instant, event: Event<'_>) {
        self.logger.handle(now, event, &mut self.out);
        for action in self.out.drain() {
            match action {
                Action::Send(_, Output::Store(request)) => {
                    let takes = match &request {
                        Request::Append { bytes, sync } => {
                            let sync = if *sync { SYNC } else { Duration::ZERO };
                            Duration::from_secs_f64(bytes.len() as f64 / RATE) + sync
                        }
                        _ => SYNC,
                    };
                    self.asked = Some((now + takes, request));
                }
                Action::Publish(Message::CmDataLog(told)) => self.dropped = told.dropped,
                _ => {}
            }
        }
    }

    fn until(&mut self, end: Instant) {
        loop {
            let timer = self.logger.poll_timeout().unwrap_or(Instant::NEVER);
            let answer = self.asked.as_ref().map_or(Instant::NEVER, |(due, _)| *due);
            let next = timer.min(answer);
            if next > end {
                return;
            }
            if answer > next {
                self.event(next, Event::Timer);
                continue;
            }
            let answer = match self.asked.take() {
                Some((_, Request::List)) => Answer::Listed { entries: Vec::new(), free: 1 << 40 },
                Some((_, Request::Append { bytes, sync })) => {
                    self.written += bytes.len() as u64;
                    self.syncs += u64::from(sync);
                    Answer::Done { free: 1 << 40 }
                }
                _ => Answer::Done { free: 1 << 40 },
            };
            self.event(next, Event::Port { port: PortId(0), input: Input::Store(&answer) });
        }
    }

    /// Says these messages over and over until there were so many bytes, at so many a second. Returns the bytes, and the
    /// computing time in seconds.
    fn say(&mut self, messages: &[(String, Vec<u8>)], total: f64, rate: f64) -> (f64, f64) {
        let (mut bytes, begin) = (0.0, computed());
        let first = 0.1;
        for (channel, data) in messages.iter().cycle() {
            let at = Instant::ZERO + Duration::from_secs_f64(first + bytes / rate);
            self.until(at);
            self.event(at, Event::RawMessage { at, channel, data });
            bytes += data.len() as f64;
            if bytes >= total {
                break;
            }
        }
        let end = Instant::ZERO + Duration::from_secs_f64(first + bytes / rate + 2.0);
        self.until(end);
        (bytes, computed() - begin)
    }
}

fn encoded(message: impl Into<Message>) -> (String, Vec<u8>) {
    let message = message.into();
    let mut data = Vec::new();
    message.encode(&mut data).unwrap();
    (message.channel_name().into_owned(), data)
}

/// Readings that change a little, as those of a robot do.
fn wobble(number: usize) -> f64 {
    let noise = (number as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
    1.0 + number as f64 * 1e-4 + noise as f64 * 1e-9
}

/// A second of what the robot says: some 60 kB.
fn robot() -> Vec<(String, Vec<u8>)> {
    let mut messages = Vec::new();
    for tick in 0..20 {
        let timestamp = 1_795_302_110_000_000 + tick as i64 * 50_000;
        let value = |of: usize| wobble(tick * 100 + of);
        messages.push(encoded(lowlevel::DataOdo {
            timestamp,
            translation: value(0),
            path: value(1),
            ..Default::default()
        }));
        messages.push(encoded(lowlevel::DataMotion {
            timestamp,
            speed: value(2),
            steering: value(3),
            source: "planner".into(),
            ..Default::default()
        }));
        messages.push(encoded(middlelevel::DataEstimate { timestamp, x: value(4), y: value(5), ..Default::default() }));
        let range = |id: usize| lowlevel::Range {
            id: id as i32,
            x: value(6),
            y: 0.2,
            theta: 0.5,
            distance: value(10 + id),
            valid: true,
        };
        messages.push(encoded(lowlevel::DataSrfs { timestamp, srfs: (0..16).map(range).collect() }));
        let cells: Vec<f64> = (0..80).map(|cell| value(20 + cell)).collect();
        messages.push(encoded(middlelevel::DataObstacles { timestamp, size: 0.1, x: cells.clone(), y: cells }));
        let process =
            |pid: i32| common::Process { module: format!("driver_{pid}"), pid, cpu: 0.01, ..Default::default() };
        let processes = (0..9).map(process).collect();
        messages.push(encoded(common::DataProcesses { timestamp, processes }));
    }
    messages
}

/// The same, and pictures and scans that nobody has a type for: 64 kB and 8 kB that do not shrink much.
fn mixed() -> Vec<(String, Vec<u8>)> {
    let mut messages = robot();
    let mut state = 1_u64;
    for (channel, size) in [("CAMERA", 65_536), ("SCAN", 8_192), ("CAMERA", 65_536), ("IMU", 200)] {
        let noise = std::iter::repeat_with(|| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 58) as u8
        });
        messages.push((channel.into(), noise.take(size).collect()));
    }
    messages
}

/// Seconds that this process has had a core.
fn computed() -> f64 {
    let text = std::fs::read_to_string("/proc/self/schedstat").unwrap();
    text.split_whitespace().next().and_then(|ns| ns.parse::<f64>().ok()).unwrap() / 1e9
}

fn memory() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kb| kb.parse::<f64>().ok()).unwrap_or(0.0) / 1000.0
}

fn main() {
    println!(
        "| traffic | compression | written / heard | a core, % | ms of a core per MB | syncs/s | lost | peak MB |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let kinds = [("none", Compression::None), ("lz4", Compression::Lz4), ("zstd", Compression::Zstd)];
    for (traffic, messages, total, rate) in [("60 kB/s", robot(), 6e6, 60e3), ("50 MB/s mixed", mixed(), 500e6, 50e6)] {
        for (name, compression) in kinds {
            let mut rig = Rig::new(compression);
            let (bytes, seconds) = rig.say(&messages, total, rate);
            println!(
                "| {traffic} | {name} | {:.2} | {:.2} | {:.2} | {:.1} | {} | {:.0} |",
                rig.written as f64 / bytes,
                100.0 * seconds / (bytes / rate),
                seconds * 1e3 / (bytes / 1e6),
                rig.syncs as f64 / (bytes / rate),
                rig.dropped,
                memory(),
            );
        }
    }
}
