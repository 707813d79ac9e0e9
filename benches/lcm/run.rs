//! One measurement: its processes, their CPU time from outside, and the detection of disturbances.

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::time::{clock_getcpuclockid, clock_gettime};
use nix::unistd::{Pid, SysconfVar, sysconf};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs;
use std::io::{Error, ErrorKind, Read, Result, Write};
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio, id};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Figures by their names.
pub type Figures = BTreeMap<&'static str, f64>;

/// Longest time for the next line of a process.
const PATIENCE: Duration = Duration::from_secs(30);
/// Longest time for messages in transit after the last was sent.
const DRAIN: Duration = Duration::from_millis(300);
/// Share of one CPU taken by others above which a measurement counts as disturbed.
pub const DISTURBED: f64 = 0.04;
const TRIES: usize = 5;
/// Longest wait for a quiet machine, per measurement.
const QUIET_WITHIN: Duration = Duration::from_secs(120);

/// Receive buffer of all sockets; with Talos's traffic, the recommendation of `advee doctor`.
const RECV_BUF: usize = 2 << 20;
const RECV_BUF_LOADED: usize = 8 << 20;

const TALOS_PER_SECOND: u64 = 67_750;
const SUBSCRIBERS: usize = 3;
const CROWD: usize = 20;
const CROWD_SIZE: usize = 1024;
const CROWD_PER_SECOND: u64 = 1000;

/// Measured quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Test {
    /// Round trips of a message of this size, bytes.
    Trip(usize),
    /// Messages of this size to one subscriber, as fast as possible, bytes.
    Flood(usize),
    /// A paced publisher and twenty subscribers of which one is interested.
    Crowd,
    /// Ten times Talos's traffic to three subscribers.
    Talos,
    /// Highest rate of the same mix without losses.
    Top,
    /// A subscriber without messages.
    Idle,
}

impl Test {
    /// Name on the command line and in JSON.
    pub fn name(self) -> String {
        match self {
            Self::Trip(size) => format!("trip-{size}"),
            Self::Flood(size) => format!("flood-{size}"),
            Self::Crowd => "crowd".into(),
            Self::Talos => "talos".into(),
            Self::Top => "top".into(),
            Self::Idle => "idle".into(),
        }
    }
}

/// Configuration of the measurements.
pub struct Bench {
    /// Program that plays the roles of `raw` and `official`.
    pub c_peer: PathBuf,
    /// True for short measurements, to try the bench.
    pub quick: bool,
    /// True to measure on a loaded machine.
    pub loaded: bool,
    /// Smallest receive buffer granted by the kernel where more was requested.
    pub granted: Cell<Option<usize>>,
    port: u16,
}

impl Bench {
    pub fn new(c_peer: PathBuf, quick: bool, loaded: bool) -> Self {
        Self { c_peer, quick, loaded, granted: Cell::default(), port: 20_000 }
    }

    /// Measures until a run is undisturbed; after some attempts the least disturbed one counts. The second value is the
    /// share of one CPU taken by others.
    pub fn measure(&mut self, transport: &'static str, test: Test) -> Result<(Figures, f64)> {
        let mut best: Option<(Figures, f64)> = None;
        for _ in 0..if self.loaded { 1 } else { TRIES } {
            if !self.loaded {
                wait_for_quiet();
            }
            let (before, begin) = (foreign(), Instant::now());
            let figures = self.once(transport, test)?;
            let share = (foreign() - before).max(0.0) / begin.elapsed().as_secs_f64();
            if best.as_ref().is_none_or(|(_, least)| share < *least) {
                best = Some((figures, share));
            }
            if share < DISTURBED {
                break;
            }
        }
        best.ok_or_else(|| Error::other("not measured"))
    }

    fn once(&mut self, transport: &'static str, test: Test) -> Result<Figures> {
        let ms = if self.quick { 200 } else { 1000 };
        match test {
            Test::Trip(size) => self.trip(transport, size),
            Test::Flood(size) => self.publish(transport, RECV_BUF, 0, ms, size, 1, 0),
            Test::Crowd => self.publish(transport, RECV_BUF, CROWD_PER_SECOND, 2 * ms, CROWD_SIZE, 1, CROWD - 1),
            Test::Talos => self.talos(transport, TALOS_PER_SECOND, 3 * ms),
            Test::Top => self.top(transport, ms),
            Test::Idle => self.idle(transport, ms),
        }
    }

    /// Unused pair of ports, so that packets of an earlier measurement do not interfere.
    fn next_port(&mut self) -> u16 {
        self.port += 2;
        self.port
    }

    fn trip(&mut self, transport: &'static str, size: usize) -> Result<Figures> {
        let trips = (if size > 10_000 { 4000 } else { 16_000 }) / if self.quick { 20 } else { 1 };
        let port = self.next_port();
        let echo = self.start(transport, port, RECV_BUF, &["echo", "0"])?;
        let mut ping = self.start(transport, port, RECV_BUF, &["ping", &size.to_string(), &trips.to_string()])?;
        sleep(settling(transport));
        let before = ping.cpu()? + echo.cpu()?;
        let said = ping.go()?;
        let cpu = ping.cpu()? + echo.cpu()? - before;
        Ok(Figures::from([
            ("p50", value(&said, "p50")? / 1e3),
            ("p99", value(&said, "p99")? / 1e3),
            ("cpu", cpu * 1e6 / value(&said, "trips")?),
        ]))
    }

    /// One publisher (`rate` 0: as fast as it can), and the numbers of counting and of idle subscribers.
    #[allow(clippy::too_many_arguments, reason = "each is one number of the measurement")]
    fn publish(
        &mut self,
        transport: &'static str,
        buffer: usize,
        rate: u64,
        ms: u64,
        size: usize,
        counters: usize,
        idlers: usize,
    ) -> Result<Figures> {
        let port = self.next_port();
        let size = size.to_string();
        let start = |role: &[&str]| self.start(transport, port, buffer, role);
        let mut counters = (0..counters).map(|_| start(&["count", &size])).collect::<Result<Vec<_>>>()?;
        let idlers = (0..idlers).map(|_| start(&["idle", "0"])).collect::<Result<Vec<_>>>()?;
        let mut sender = start(&["send", &rate.to_string(), &ms.to_string(), &size])?;
        sleep(settling(transport));
        let cpu = |peers: &[Peer]| peers.iter().map(Peer::cpu).sum::<Result<f64>>();
        let before = sender.cpu()? + cpu(&counters)? + cpu(&idlers)?;
        let said = sender.go()?;
        sleep(DRAIN);
        let sender_cpu = sender.cpu()?;
        sender.say()?;
        let counted = counters.iter_mut().map(Peer::line).collect::<Result<Vec<_>>>()?;
        let cpu = sender_cpu + cpu(&counters)? + cpu(&idlers)? - before;
        let sent = value(&said, "sent")?;
        let of_all = |key| counted.iter().map(|said| value(said, key)).collect::<Result<Vec<f64>>>();
        let (received, spans, wrong) = (of_all("received")?, of_all("span")?, of_all("wrong")?);
        if wrong.iter().sum::<f64>() > 0.0 {
            return Err(Error::other(format!("wrong messages: {counted:?}")));
        }
        let least = received.iter().copied().fold(f64::INFINITY, f64::min);
        Ok(Figures::from([
            ("sent", sent / (value(&said, "span")? / 1e9)),
            ("received", received.iter().zip(&spans).map(|(n, span)| n / (span.max(1.0) / 1e9)).fold(0.0, f64::max)),
            ("loss", 100.0 * (sent - least) / sent),
            ("cpu", cpu * 1e6 / received.iter().copied().fold(1.0, f64::max)),
        ]))
    }

    fn talos(&mut self, transport: &'static str, rate: u64, ms: u64) -> Result<Figures> {
        self.publish(transport, RECV_BUF_LOADED, rate, ms, 0, SUBSCRIBERS, 0)
    }

    /// Bisection on the logarithm of the rate, to 4 %; a rate with losses is tried once more.
    fn top(&mut self, transport: &'static str, ms: u64) -> Result<Figures> {
        let (mut good, mut bad) = (2000.0_f64, 1_000_000.0_f64);
        while bad / good > 1.04 {
            let rate = (good * bad).sqrt();
            let mut passes = false;
            for _ in 0..2 {
                let figures = self.talos(transport, rate as u64, ms)?;
                passes |= figures["loss"] == 0.0 && figures["sent"] > 0.98 * rate;
                if passes {
                    break;
                }
            }
            *(if passes { &mut good } else { &mut bad }) = rate;
        }
        Ok(Figures::from([("rate", good)]))
    }

    fn idle(&mut self, transport: &'static str, ms: u64) -> Result<Figures> {
        let port = self.next_port();
        let peer = self.start(transport, port, RECV_BUF, &["idle", "0"])?;
        sleep(settling(transport));
        let (cpu, wakes, begin) = (peer.cpu()?, peer.sleeps(), Instant::now());
        sleep(Duration::from_millis(5 * ms));
        let seconds = begin.elapsed().as_secs_f64();
        let folder = PathBuf::from(format!("/proc/{}", peer.child.id()));
        Ok(Figures::from([
            ("cpu", (peer.cpu()? - cpu) * 1e6 / seconds),
            ("wakes", (peer.sleeps() - wakes) / seconds),
            ("threads", peer.threads().count() as f64),
            ("rss", status(&folder, "VmRSS")),
            ("private", status(&folder, "RssAnon")),
        ]))
    }

    fn start(&self, transport: &str, port: u16, buffer: usize, role: &[&str]) -> Result<Peer> {
        let ours = !matches!(transport, "raw" | "official");
        let program = if ours { std::env::current_exe()? } else { self.c_peer.clone() };
        // The placement of the two ends of a round trip by the scheduler has more effect than the code: a wake-up
        // across processors costs several times that on one. So both run on the same one.
        let mut command = if matches!(role[0], "echo" | "ping") {
            let mut command = Command::new("taskset");
            command.args(["-c", "0"]).arg(program);
            command
        } else {
            Command::new(program)
        };
        if ours {
            command.arg("peer");
        }
        command.args([transport, &port.to_string(), &buffer.to_string()]).args(role);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn()?;
        let pipes = child.stdin.take().zip(child.stdout.take());
        let (input, output) = pipes.ok_or_else(|| Error::other("no pipes"))?;
        let mut peer = Peer { child, input, output, text: String::new() };
        let granted = value(&peer.line()?, "ready")? as usize;
        if (1..buffer).contains(&granted) {
            self.granted.set(Some(self.granted.get().map_or(granted, |least| least.min(granted))));
        }
        Ok(peer)
    }
}

/// Time until programs of one kind know each other: the local bus searches for others once a second.
fn settling(transport: &str) -> Duration {
    Duration::from_millis(if transport.starts_with("shm") { 1500 } else { 100 })
}

/// Process at one end, ended with this value.
struct Peer {
    child: Child,
    input: ChildStdin,
    output: ChildStdout,
    text: String,
}

impl Peer {
    /// User and system time so far, all threads, s.
    fn cpu(&self) -> Result<f64> {
        let clock = clock_getcpuclockid(Pid::from_raw(self.child.id() as i32))?;
        Ok(Duration::from(clock_gettime(clock)?).as_secs_f64())
    }

    /// Folders of its threads, proc(5).
    fn threads(&self) -> impl Iterator<Item = PathBuf> {
        let tasks = fs::read_dir(format!("/proc/{}/task", self.child.id()));
        tasks.into_iter().flatten().flatten().map(|entry| entry.path())
    }

    /// Number of times that its threads have slept so far.
    fn sleeps(&self) -> f64 {
        self.threads().map(|thread| status(&thread, "voluntary_ctxt_switches")).sum()
    }

    fn say(&mut self) -> Result<()> {
        self.input.write_all(b"\n")
    }

    fn go(&mut self) -> Result<String> {
        self.say()?;
        self.line()
    }

    fn line(&mut self) -> Result<String> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            if let Some((line, rest)) = self.text.split_once('\n') {
                let line = line.to_owned();
                self.text = rest.to_owned();
                return Ok(line);
            }
            let left = deadline.saturating_duration_since(Instant::now()).as_millis() as u16;
            if poll(&mut [PollFd::new(self.output.as_fd(), PollFlags::POLLIN)], PollTimeout::from(left))? == 0 {
                return Err(Error::new(ErrorKind::TimedOut, "a peer says nothing"));
            }
            let mut part = [0; 256];
            match self.output.read(&mut part)? {
                0 => return Err(Error::new(ErrorKind::UnexpectedEof, "a peer has ended")),
                len => self.text.push_str(&String::from_utf8_lossy(&part[..len])),
            }
        }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Number after a name in a peer's line.
fn value(said: &str, name: &str) -> Result<f64> {
    let mut words = said.split(' ').skip_while(|word| *word != name);
    let number = words.nth(1).and_then(|word| word.parse().ok());
    number.ok_or_else(|| Error::other(format!("a peer says {said:?}, no {name}")))
}

/// Number in `status` of a process or thread, proc(5).
fn status(folder: &Path, name: &str) -> f64 {
    let text = fs::read_to_string(folder.join("status")).unwrap_or_default();
    let mut fields = text.lines().filter_map(|line| line.split_once(':')).filter(|(key, _)| *key == name);
    let number = fields.next().and_then(|(_, value)| value.split_whitespace().next()?.parse().ok());
    number.unwrap_or(f64::NAN)
}

/// CPU time taken by all other programs so far, and withheld by the hypervisor, s. Kernel threads work for any process
/// and are left out.
fn foreign() -> f64 {
    let (me, mut ticks) = (id(), 0.0);
    for entry in fs::read_dir("/proc").into_iter().flatten().flatten() {
        let pid = entry.file_name().to_str().and_then(|name| name.parse::<u32>().ok());
        let Some(pid) = pid.filter(|&pid| pid != me && pid != 2) else { continue };
        let stat = fs::read_to_string(entry.path().join("stat")).unwrap_or_default();
        // proc(5), after the name in parentheses: state, parent, and from the twelfth on four times.
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
        let parent = fields.get(1).and_then(|text| text.parse::<u32>().ok());
        if pid != me && parent != Some(me) && parent != Some(2) {
            ticks += fields.iter().skip(11).take(4).filter_map(|text| text.parse::<f64>().ok()).sum::<f64>();
        }
    }
    let stat = fs::read_to_string("/proc/stat").unwrap_or_default();
    let stolen = stat.split_whitespace().nth(8).and_then(|text| text.parse::<f64>().ok());
    let per_second = sysconf(SysconfVar::CLK_TCK).ok().flatten().unwrap_or(100);
    (ticks + stolen.unwrap_or(0.0)) / per_second as f64
}

/// Waits until others take less than a tenth of a CPU, with a timeout.
fn wait_for_quiet() {
    let (begin, window) = (Instant::now(), Duration::from_millis(200));
    while begin.elapsed() < QUIET_WITHIN {
        let before = foreign();
        sleep(window);
        if foreign() - before < 0.1 * window.as_secs_f64() {
            return;
        }
    }
}
