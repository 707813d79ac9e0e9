//! Simulated robot that is driven, observed and harmed.

use super::can::{Can, Sign};
use crate::support;
use lcm::live::Lcm;
use messages::{Channel, Hold, Message, common, lowlevel};
use module::State;
use sim::check::wire::Drive;
use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Period of the operator's commands.
const COMMANDS: Duration = Duration::from_millis(50);
/// Longest iteration of the bench's loop.
const STEP: Duration = Duration::from_millis(5);
/// Speed at which the table "What stops the robot" was measured, m/s, on a circle that has room anywhere.
const SPEED: f64 = 0.8;
/// Speed of another robot, m/s: each of its wheels stays within its limit on the circle.
const SPEED_OTHER: f64 = 0.4;
const STEERING: f64 = 0.4;
/// Speed below which the body stands, m/s, and its deceleration between two samples of the truth, m/s².
const STANDS: f64 = 0.01;
const DECELERATION: f64 = 1.5;
/// Number of last log lines that are kept.
const LINES: usize = 40;

/// Robot with the last messages received from it.
pub struct Rig {
    pub run_dir: PathBuf,
    up: Child,
    bus: Lcm,
    can: Can,
    log: Arc<Mutex<VecDeque<String>>>,
    reader: Option<JoinHandle<()>>,
    pub processes: BTreeMap<String, common::Process>,
    homed: bool,
    /// Speed at which it is driven, m/s.
    speed_driven: f64,
    /// It is homed before it drives.
    steers: bool,
    /// It is the robot whose figures the table "What stops the robot" has.
    pub reference: bool,
    /// Homing was interrupted, and waits for an operator's release; when it is sent.
    to_be_homed: bool,
    release: Instant,
    /// Since [`Rig::mark`]: the driver of the drives has stopped the robot because it did not hear the watchdog.
    pub missed_watchdog: bool,
    reason: String,
    speed: f64,
    /// Speed commanded by the operator, and the time of the next command.
    wanted: f64,
    next: Instant,
    /// Last sign on the CAN bus.
    sign: Option<(Instant, Sign)>,
    /// Since [`Rig::mark`]: first sign of a stop, longest iteration of this loop, number of the watchdog's
    /// announcements.
    pub stop: Option<Instant>,
    /// Instant from which the body stood, since [`Rig::mark`].
    pub stood: Option<Instant>,
    moved: Option<(Instant, f64)>,
    pub slowest: Duration,
    pub announced: Option<Instant>,
    turn: Instant,
    marked: Instant,
}

/// How a robot drives.
pub struct Ride {
    /// The drives of its wheels, or of its driven axle.
    pub drives: Vec<Drive>,
    /// It steers, so that it is homed first.
    pub homes: bool,
    /// The robot of the table "What stops the robot".
    pub reference: bool,
}

/// Environment in which robots are started.
pub struct Yard<'a> {
    /// Configuration.
    pub config: &'a Path,
    /// How it drives.
    pub ride: Ride,
    /// Library loaded into every process.
    pub saboteur: &'a Path,
    /// Parent of the robots' folders.
    pub folder: &'a Path,
}

impl Rig {
    /// Starts a robot; no other one has `number`.
    pub fn start(yard: &Yard<'_>, number: u16) -> Self {
        let port = 50_000 + (std::process::id() as u16).wrapping_mul(31) % 450 * 32 + number % 32;
        let url = format!("udpm://239.255.76.67:{port}?ttl=0&shm=auto");
        let run_dir = yard.folder.join(number.to_string());
        let logs = run_dir.with_extension("log");
        let bus = support::listen(&url);
        let can = Can::listen(robot::topology::can_port_beside(port), yard.ride.drives.clone());
        let world = support::workspace().join("conf/worlds/empty.toml");
        // The watchdog has no limit of its own: it is set by the process that starts the robot (systemd: LimitDATA=).
        let advee = support::advee(&url, &run_dir);
        let limits = format!("ulimit -c 0; ulimit -d {}; exec \"$0\" \"$@\"", super::MEMORY_MAX >> 10);
        let mut up = Command::new("/bin/sh")
            .current_dir(support::workspace())
            .args(["-c", &limits])
            .arg(advee.get_program())
            .args(advee.get_args())
            .arg("--config")
            .arg(yard.config)
            .args(["--set", &format!("log.folder={:?}", logs), "--set", "limits.speed_manual_mps=0.8"])
            // Another robot may sense nothing, which limits it to less.
            .args(["--set", "guard.speed_blind_mps=2.0"].iter().filter(|_| !yard.ride.reference))
            .args(["up", "--sim", "--headless", "--goal", "none", "--world"])
            .arg(world)
            .env("LD_PRELOAD", yard.saboteur)
            .env("ADVEE_SABOTAGE", run_dir.with_extension("fifo"))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the executable is built");
        let log = Arc::new(Mutex::new(VecDeque::new()));
        let (stderr, kept) = (up.stderr.take().expect("it is piped"), log.clone());
        let reader = Some(std::thread::spawn(move || keep(stderr, &kept)));
        let now = Instant::now();
        Self {
            run_dir,
            up,
            bus,
            can,
            log,
            reader,
            processes: BTreeMap::new(),
            homed: !yard.ride.homes,
            speed_driven: if yard.ride.reference { SPEED } else { SPEED_OTHER },
            steers: yard.ride.homes,
            reference: yard.ride.reference,
            to_be_homed: false,
            release: now,
            missed_watchdog: false,
            reason: String::new(),
            speed: 0.0,
            wanted: 0.0,
            next: now,
            sign: None,
            stop: None,
            stood: None,
            moved: None,
            slowest: Duration::ZERO,
            announced: None,
            turn: now,
            marked: now,
        }
    }

    /// Resets the measurement.
    pub fn mark(&mut self) -> Instant {
        self.turn();
        self.marked = Instant::now();
        (self.stop, self.slowest, self.announced, self.turn) = (None, Duration::ZERO, None, self.marked);
        (self.stood, self.moved, self.missed_watchdog) = (None, None, false);
        self.marked
    }

    /// Sets the operator's command; effective at once if it is a stop.
    pub fn drive(&mut self, on: bool) {
        let before = std::mem::replace(&mut self.wanted, if on { self.speed_driven } else { 0.0 });
        if self.wanted < before {
            self.next = Instant::now();
        }
    }

    /// Waits until the robot drives again: a stopped source must release first. False if it does not within 40 s.
    pub fn until_driving(&mut self) -> bool {
        let begin = Instant::now();
        let mut calm = Instant::now();
        self.drive(false);
        while begin.elapsed() < Duration::from_secs(40) {
            self.turn();
            if !self.all_run() || !self.homed {
                self.drive(false);
                calm = Instant::now();
                self.release_homing(calm);
            } else if self.wanted == 0.0 && calm.elapsed() >= Duration::from_millis(150) {
                self.drive(true);
            } else if self.wanted != 0.0 && calm.elapsed() >= Duration::from_millis(2500) && !self.drives() {
                // Stopped once more.
                self.drive(false);
                calm = Instant::now();
            } else if self.drives() && self.speed > 0.95 * self.speed_driven {
                return true;
            }
        }
        false
    }

    /// Homes the steering as an operator does, once a second while it waits for that.
    fn release_homing(&mut self, now: Instant) {
        if !self.to_be_homed || now < self.release {
            return;
        }
        self.release = now + Duration::from_secs(1);
        self.publish(lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() });
    }

    fn publish(&mut self, message: impl Into<Message>) {
        let (message, mut bytes) = (message.into(), Vec::new());
        message.encode(&mut bytes).expect("encodable");
        self.bus.publish(&message.channel_name(), &bytes).expect("the bus takes it");
    }

    /// True if the drive turns, by its last command.
    pub fn drives(&self) -> bool {
        matches!(self.sign, Some((_, Sign::Drives)))
    }

    pub fn all_run(&self) -> bool {
        !self.processes.is_empty() && self.processes.values().all(|process| process.state == State::Run as i8)
    }

    /// Process of a module that was not commanded to end, in any state: a new watchdog does not know the state at once.
    pub fn process(&self, module: &str) -> Option<i32> {
        let process = self.processes.get(module).filter(|process| process.phase == common::Process::RUNNING);
        process.map(|process| process.pid)
    }

    /// Process of a module, or of the watchdog, which is in no list, by its command line; `None` without one.
    pub fn pid(&self, module: &str) -> Option<i32> {
        if module != watchdog::NAME {
            return self.processes.get(module).map(|process| process.pid).filter(|pid| *pid > 0);
        }
        let own = self.run_dir.to_string_lossy().into_owned();
        let entries = fs::read_dir("/proc").expect("/proc").filter_map(Result::ok);
        let mut pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok());
        pids.find(|pid| {
            let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            let words: Vec<_> = line.split(|byte| *byte == 0).map(String::from_utf8_lossy).collect();
            words.len() > 2 && words[1] == "run" && words[2] == watchdog::NAME && words.iter().any(|word| *word == own)
        })
    }

    /// True if the module is in RUN in a process other than `old`.
    pub fn is_back(&self, module: &str, old: i32) -> bool {
        if module == watchdog::NAME {
            return self.announced.is_some() && self.pid(module).is_some_and(|pid| pid != old);
        }
        self.processes.get(module).is_some_and(|process| {
            process.pid != old && process.phase == common::Process::RUNNING && process.state == State::Run as i8
        })
    }

    /// Runs the loop for a while.
    pub fn pass(&mut self, time: Duration) {
        let end = Instant::now() + time;
        while Instant::now() < end {
            self.turn();
        }
    }

    /// Sends the operator's command if due, and receives messages.
    pub fn turn(&mut self) {
        let now = Instant::now();
        self.slowest = self.slowest.max(now - self.turn);
        self.turn = now;
        if self.next <= now {
            self.next = now + COMMANDS;
            let (speed, source) = (self.wanted, "bench".into());
            self.publish(lowlevel::CmdMotion { timestamp: 0, speed, steering: STEERING, priority: 1, source });
        }
        let wait = STEP.min(self.next.saturating_duration_since(Instant::now()));
        self.bus.wait(wait).expect("the bus can be waited for");
        while let Some(received) = self.bus.recv().expect("the bus can be read") {
            let Some(channel) = Channel::from_name(received.channel) else { continue };
            match Message::decode(channel, received.payload) {
                Ok(Message::SimDataTruth(truth)) => {
                    self.speed = truth.speed.abs();
                    self.look();
                }
                Ok(Message::LlDataMotion(motion)) => {
                    (self.homed, self.reason) = (motion.homed || !self.steers, motion.reason);
                }
                Ok(Message::LlDataHold(list)) if list.is_of_motion() => {
                    self.to_be_homed = list.has(Hold::ToBeHomed);
                    self.missed_watchdog |= list.has(Hold::WatchdogSilent);
                }
                Ok(Message::CmDataProcesses(list)) => {
                    self.processes =
                        list.processes.into_iter().map(|process| (process.module.clone(), process)).collect();
                }
                Ok(Message::CmDataState(state))
                    if state.module == watchdog::NAME && state.state == State::Run as i8 =>
                {
                    self.announced = Some(Instant::now());
                }
                _ => {}
            }
        }
        while let Ok((at, sign)) = self.can.signs.try_recv() {
            self.sign = Some((at, sign));
            if sign == Sign::Stops && at >= self.marked {
                self.stop.get_or_insert(at);
            }
        }
    }

    /// Notes when the body stands: samples are 50 ms apart, and between them it brakes.
    fn look(&mut self) {
        let now = Instant::now();
        if self.speed >= STANDS {
            self.moved = Some((now, self.speed));
        } else if let Some((at, speed)) = self.moved {
            self.stood.get_or_insert(now.min(at + Duration::from_secs_f64(speed / DECELERATION)));
        }
    }

    /// Why it stands, in words.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// Last lines of the log.
    pub fn lines(&self) -> Vec<String> {
        self.log.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        support::signal(self.up.id() as i32, "TERM");
        let begin = Instant::now();
        while self.up.try_wait().is_ok_and(|status| status.is_none()) && begin.elapsed() < Duration::from_secs(15) {
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.up.kill();
        let _ = self.up.wait();
        let _ = self.reader.take().map(JoinHandle::join);
    }
}

fn keep(stderr: ChildStderr, log: &Mutex<VecDeque<String>>) {
    let (mut stderr, mut line) = (BufReader::with_capacity(1 << 16, stderr), Vec::new());
    while stderr.read_until(b'\n', &mut line).is_ok_and(|length| length > 0) {
        if !line.ends_with(b"and again\n") {
            let mut log = log.lock().unwrap_or_else(PoisonError::into_inner);
            log.push_back(String::from_utf8_lossy(&line).trim_end().to_string());
            if log.len() > LINES {
                log.pop_front();
            }
        }
        line.clear();
    }
}
