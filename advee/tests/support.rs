//! Simulated robot for a test: `advee up --sim` on unused ports and a run folder of its own; the test subscribes to its
//! bus and ends its processes by pid.
#![allow(dead_code, reason = "each test binary uses its part")]

use lcm::live::Lcm;
use lcm::origin::Origin;
use messages::{Channel, Hold, Message, common, lowlevel, middlelevel, simulation};
use module::State;
use nix::fcntl::{Flock, FlockArg};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::net::{Ipv4Addr, TcpListener};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError, Weak};
use std::time::{Duration, Instant};

pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("robot lies in the workspace").into()
}

/// Unused port: while this process runs, no other process can listen on it by TCP.
pub fn unique_port() -> u16 {
    static HELD: Mutex<Vec<TcpListener>> = Mutex::new(Vec::new());
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    let first = std::process::id() as u16;
    let free = (0..9600).map(|n| 20_000 + (first.wrapping_mul(31).wrapping_add(n)) % 9600 * 2);
    let listener = free.filter_map(|port| TcpListener::bind((Ipv4Addr::LOCALHOST, port)).ok()).next();
    let listener = listener.expect("some port is free");
    let port = listener.local_addr().expect("it is bound").port();
    held.push(listener);
    port
}

/// CAN bus over UDP that no other test uses.
pub fn can_port() -> u16 {
    robot::topology::can_port_beside(unique_port())
}

/// Python with all packages of `tools/requirements.txt`; skips the test without one.
pub fn python() -> Option<PathBuf> {
    static PYTHON: OnceLock<testing::Found<PathBuf>> = OnceLock::new();
    const PACKAGES: [&str; 9] =
        ["lcm", "can", "msgpack", "canopen", "durand", "serial", "rosbags", "mcap_ros2", "websockets"];
    testing::peer_or_skip(PYTHON.get_or_init(|| testing::python(&PACKAGES)).clone())
}

/// Share of this machine, returned when the last clone is dropped. Each test in real time holds one: at most
/// [`shares_of_machine`], however many threads run tests, and with `ADVEE_TURNS` however many test programs do.
pub struct Turn {
    shares: usize,
    _locks: Vec<Flock<File>>,
}

/// Waiting turns, first come, first served.
struct Turns {
    free: usize,
    /// Number of the next one to arrive, and of the next one to be served.
    next: usize,
    served: usize,
}

static TURNS: Mutex<Option<Turns>> = Mutex::new(None);
static RETURNED: Condvar = Condvar::new();

thread_local! {
    /// Turn of the test in this thread, which gets the same one again.
    static OWN: RefCell<Weak<Turn>> = const { RefCell::new(Weak::new()) };
}

/// Shares of this machine: three for two processors. A running robot needs only a part of a processor; one that starts
/// needs a whole one.
fn shares_of_machine() -> usize {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    processors + processors / 2
}

/// One share, as held by every [`Robot`].
pub fn turn() -> Arc<Turn> {
    take(1)
}

/// Whole machine, for a test that loads it or measures it closely; called first in the test.
pub fn alone() -> Arc<Turn> {
    take(usize::MAX)
}

fn take(shares: usize) -> Arc<Turn> {
    if let Some(own) = OWN.with_borrow(Weak::upgrade) {
        return own;
    }
    let all_shares = shares_of_machine();
    let shares = shares.min(all_shares);
    let mut turns = TURNS.lock().unwrap_or_else(PoisonError::into_inner);
    let all = turns.get_or_insert(Turns { free: all_shares, next: 0, served: 0 });
    let number = all.next;
    all.next += 1;
    let waits =
        |turns: &mut Option<Turns>| turns.as_ref().is_some_and(|turns| turns.served != number || turns.free < shares);
    turns = RETURNED.wait_while(turns, waits).unwrap_or_else(PoisonError::into_inner);
    if let Some(turns) = turns.as_mut() {
        turns.served += 1;
        turns.free -= shares;
    }
    RETURNED.notify_all();
    drop(turns);
    let turn = Arc::new(Turn { shares, _locks: locks(shares, all_shares) });
    OWN.set(Arc::downgrade(&turn));
    turn
}

/// Shares against other test programs: a locked file each in the folder `ADVEE_TURNS`, which `tools/run-tests` sets.
fn locks(shares: usize, all: usize) -> Vec<Flock<File>> {
    let Some(folder) = std::env::var_os("ADVEE_TURNS").map(PathBuf::from) else { return Vec::new() };
    let lock = |number: usize, how| {
        let path = folder.join(number.to_string());
        let file = OpenOptions::new().create(true).truncate(false).write(true).open(path);
        Flock::lock(file.expect("the folder ADVEE_TURNS is writable"), how).ok()
    };
    if shares == all {
        // In this order everywhere, so that two tests that need the whole machine do not block each other.
        return (0..all).map(|number| lock(number, FlockArg::LockExclusive).expect("a file is locked")).collect();
    }
    loop {
        if let Some(own) = (0..all).find_map(|number| lock(number, FlockArg::LockExclusiveNonblock)) {
            return vec![own];
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        if let Some(turns) = TURNS.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            turns.free += self.shares;
        }
        RETURNED.notify_all();
    }
}

/// Delay of a thread of this process, beyond its sleep, from which the machine counts as held up.
const HELD_UP: Duration = Duration::from_millis(40);
/// Attempts of a test in real time, each on a machine that was held up meanwhile.
const ATTEMPTS: u32 = 5;

/// Runs a test whose robot must be served in time: sources that send at 20 Hz, a watchdog that is never late. A failure
/// while the machine was held up, as a thread of this process measures, proves nothing, since the robot then stops
/// rightly: the test is repeated. Any other failure counts.
pub fn undisturbed(test: impl Fn()) {
    for attempt in 1.. {
        let (outcome, late) = beside_canary(|| catch_unwind(AssertUnwindSafe(&test)));
        match outcome {
            Err(_) if late >= HELD_UP && attempt < ATTEMPTS => {
                eprintln!("attempt {attempt} is void: the machine was held up by {} ms", late.as_millis());
            }
            Err(failure) => resume_unwind(failure),
            Ok(()) => return,
        }
    }
}

/// Measures a time, which must not exceed `most`. A time that was measured while the machine was held up proves nothing
/// and is measured again; if the machine is held up each time, that is reported as a skip.
#[track_caller]
pub fn within(what: &str, most: Duration, mut measure: impl FnMut() -> Duration) {
    for _ in 0..2 * ATTEMPTS {
        let (took, late) = beside_canary(&mut measure);
        println!("{what}: {} ms, with a machine that was late by {} ms", took.as_millis(), late.as_millis());
        if late < HELD_UP {
            return assert!(took <= most, "{what}: {took:?}, and the machine was late by {late:?} only");
        }
    }
    let _skipped: Option<()> =
        testing::machine_or_skip(Err(format!("a machine that runs a test in time, for: {what}")));
}

/// Runs something; its outcome, and the longest delay of another thread of this process meanwhile.
fn beside_canary<T>(run: impl FnOnce() -> T) -> (T, Duration) {
    let ended = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let canary = scope.spawn(|| latest(&ended));
        // The scope waits for the other thread, whatever becomes of this one.
        let outcome = catch_unwind(AssertUnwindSafe(run));
        ended.store(true, Ordering::Relaxed);
        let late = canary.join().expect("it only sleeps");
        match outcome {
            Ok(outcome) => (outcome, late),
            Err(failure) => resume_unwind(failure),
        }
    })
}

/// Sleeps again and again until the end; the longest delay.
fn latest(ended: &AtomicBool) -> Duration {
    let mut late = Duration::ZERO;
    while !ended.load(Ordering::Relaxed) {
        let (begin, sleep) = (Instant::now(), Duration::from_millis(5));
        std::thread::sleep(sleep);
        late = late.max(begin.elapsed().saturating_sub(sleep));
    }
    late
}

/// Message types as Python classes, generated by the official `lcm-gen` of `python`, in the folder `build`.
pub fn python_types(python: &Path, build: &Path) {
    let mut files = Vec::new();
    for folder in std::fs::read_dir(workspace().join("messages")).expect("messages") {
        let entries = std::fs::read_dir(folder.expect("an entry").path()).into_iter().flatten();
        let paths = entries.map(|entry| entry.expect("an entry").path());
        files.extend(paths.filter(|path| path.extension().is_some_and(|extension| extension == "lcm")));
    }
    let generator = python.with_file_name("lcm-gen");
    let generated = Command::new(generator).arg("-p").arg("--ppath").arg(build).args(&files).output();
    let generated = generated.expect("lcm-gen runs");
    assert!(generated.status.success(), "{}", String::from_utf8_lossy(&generated.stderr));
}

/// Processes of a robot, by whether they are.
#[derive(Default)]
struct OwnProcesses(BTreeMap<u32, bool>);

impl OwnProcesses {
    fn knows(&mut self, origin: Origin, run_dir: &Path) -> bool {
        let Origin::Memory(process) = origin else { return false };
        // Not a tool that plays its log.
        let runs = |pid| is_of(pid, run_dir) && arguments(pid).split('\0').any(|argument| argument == "run");
        *self.0.entry(process.pid).or_insert_with(|| runs(process.pid))
    }
}

/// True if a process has the run folder in its command line.
fn is_of(pid: u32, run_dir: &Path) -> bool {
    arguments(pid).contains(&*run_dir.to_string_lossy())
}

/// Command line of a process, its arguments separated by zeroes.
fn arguments(pid: u32) -> String {
    let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    String::from_utf8_lossy(&line).into_owned()
}

/// Last messages received on the bus.
#[derive(Default)]
pub struct View {
    pub truth: Option<simulation::DataTruth>,
    pub motion: Option<lowlevel::DataMotion>,
    /// Causes that hold the modules, by module.
    pub holds: BTreeMap<String, lowlevel::DataHold>,
    pub odo: Option<lowlevel::DataOdo>,
    pub estimate: Option<middlelevel::DataEstimate>,
    pub plan: Option<middlelevel::DataPlan>,
    pub joydev: Option<lowlevel::DataJoydev>,
    pub clock: Option<simulation::DataClock>,
    /// Time and world of a robot in virtual time.
    pub time: Option<simulation::DataRun>,
    pub processes: BTreeMap<String, common::Process>,
    pub errors: Vec<common::Error>,
    pub texts: Vec<common::EventText>,
    pub seen: BTreeMap<String, u32>,
}

impl View {
    fn take(&mut self, channel: &str, payload: &[u8]) {
        *self.seen.entry(channel.into()).or_default() += 1;
        let Some(channel) = Channel::from_name(channel) else { return };
        match Message::decode(channel, payload) {
            Ok(Message::SimDataTruth(truth)) => self.truth = Some(truth),
            Ok(Message::LlDataMotion(motion)) => self.motion = Some(motion),
            Ok(Message::LlDataHold(list)) => drop(self.holds.insert(list.module.clone(), list)),
            Ok(Message::LlDataOdo(odo)) => self.odo = Some(odo),
            Ok(Message::MlDataEstimate(estimate)) => self.estimate = Some(estimate),
            Ok(Message::MlDataPlan(plan)) => self.plan = Some(plan),
            Ok(Message::LlDataJoydev(joydev)) => self.joydev = Some(joydev),
            Ok(Message::SimDataClock(clock)) => self.clock = Some(clock),
            Ok(Message::SimDataRun(time)) => self.time = Some(time),
            Ok(Message::CmDataProcesses(list)) => {
                self.processes = list.processes.into_iter().map(|process| (process.module.clone(), process)).collect();
            }
            Ok(Message::CmEventError(error)) => self.errors.push(error),
            Ok(Message::CmEventText(text)) => self.texts.push(text),
            _ => {}
        }
    }

    /// Speed of the body, m/s; NaN before the first message.
    pub fn speed(&self) -> f64 {
        self.truth.as_ref().map_or(f64::NAN, |truth| truth.speed)
    }

    pub fn is_homed(&self) -> bool {
        self.motion.as_ref().is_some_and(|motion| motion.homed)
    }

    pub fn runs(&self, module: &str) -> bool {
        self.processes.get(module).is_some_and(|process| process.state == State::Run as i8)
    }

    pub fn all_run(&self) -> bool {
        !self.processes.is_empty() && self.processes.values().all(|process| process.state == State::Run as i8)
    }

    pub fn pid(&self, module: &str) -> i32 {
        self.processes[module].pid
    }

    /// Causes that hold the motion, the most important first.
    pub fn causes(&self) -> Vec<Hold> {
        let list = self.holds.get(messages::MOTION_MODULE);
        list.into_iter().flat_map(|list| &list.holds).filter_map(lowlevel::Hold::cause).collect()
    }

    /// True if nothing but a missing command holds the motion.
    pub fn is_free(&self) -> bool {
        self.holds.get(messages::MOTION_MODULE).is_some_and(lowlevel::DataHold::is_free)
    }

    /// Sentence for people.
    pub fn reason(&self) -> String {
        self.motion.as_ref().map_or("no LL_DATA_MOTION".into(), |motion| motion.reason.clone())
    }
}

/// Running robot.
pub struct Robot {
    pub url: String,
    pub port: u16,
    pub run_dir: PathBuf,
    pub view: View,
    pub bus: Lcm,
    up: Child,
    /// Whose messages the view takes; everybody's without.
    own: Option<OwnProcesses>,
    _turn: Arc<Turn>,
}

/// Settings of a robot that is as fast as it is commanded: tests of the guard switch it on.
const UNGUARDED: &[&str] = &["--set", "guard.ranging=none", "--set", "guard.speed_blind_mps=2.0"];

impl Robot {
    /// Starts a robot in a hall without visitors; `extra` are further arguments of `advee up --sim`.
    pub fn start(extra: &[&str]) -> Self {
        Self::start_on(0, extra)
    }

    /// Starts a robot with this time to live of its multicast packets.
    pub fn start_on(ttl: u8, extra: &[&str]) -> Self {
        Self::start_with(ttl, extra, |_, _| ())
    }

    /// Starts a robot whose process and run folder are prepared first.
    pub fn start_with(ttl: u8, extra: &[&str], prepare: impl FnOnce(&mut Command, &Path)) -> Self {
        let turn = turn();
        let port = unique_port();
        let url = format!("udpm://239.255.76.67:{port}?ttl={ttl}&shm=auto");
        let run_dir = std::env::temp_dir().join(format!("advee-test-{}-{port}", std::process::id()));
        let bus = listen(&url);
        // The web server runs only if the test has an address for it.
        let headless: &[&str] = if extra.contains(&"--http") { &[] } else { &["--headless"] };
        let mut up = advee(&url, &run_dir);
        up.args(["up", "--sim", "--goal", "none"])
            .args(headless)
            .args(["--set", &format!("log.folder={:?}", logs(&run_dir)), "--set", "world.people=0"])
            .args(extra)
            .stdin(Stdio::null());
        prepare(&mut up, &run_dir);
        let up = up.spawn().expect("the executable is built");
        Self { url, port, run_dir, view: View::default(), bus, up, own: None, _turn: turn }
    }

    /// Starts the robot of a folder without a simulator: its devices are on the CAN bus beside its LCM bus.
    pub fn of(folder: &Path) -> Self {
        let turn = turn();
        let port = unique_port();
        let url = format!("udpm://239.255.76.67:{port}?ttl=0&shm=auto");
        let run_dir = std::env::temp_dir().join(format!("advee-test-{}-{port}", std::process::id()));
        let bus = listen(&url);
        let mut up = advee(&url, &run_dir);
        up.args(["up", "--headless", "--config"]).arg(folder).stdin(Stdio::null());
        let up = up.spawn().expect("the executable is built");
        Self { url, port, run_dir, view: View::default(), bus, up, own: None, _turn: turn }
    }

    /// Starts a robot without a guard, as fast as it is commanded, and waits until every module runs and the steering
    /// is homed. If a busy machine made the watchdog restart a module meanwhile, the start no longer releases homing,
    /// and an operator does.
    pub fn ready(extra: &[&str]) -> Self {
        Self::ready_on(0, extra)
    }

    /// As [`Self::ready`], with this time to live of its multicast packets.
    pub fn ready_on(ttl: u8, extra: &[&str]) -> Self {
        let mut robot = Self::start_on(ttl, &[UNGUARDED, extra].concat());
        let is_ready = |view: &View| view.all_run() && view.is_homed();
        let waits = |view: &View| view.all_run() && view.causes().first() == Some(&Hold::ToBeHomed);
        for _ in 0..10 {
            robot.until("all modules RUN and the steering homed", 20.0, |view| is_ready(view) || waits(view));
            if is_ready(&robot.view) {
                break;
            }
            // Refused while something else still stops the robot.
            if !robot.advee(&["home"]).status.success() {
                std::thread::sleep(Duration::from_millis(500));
                robot.listen(Duration::ZERO);
            }
        }
        robot.until("the steering homed", 20.0, is_ready);
        robot
    }

    /// Runs a command of `advee` on this robot's bus.
    pub fn advee(&self, args: &[&str]) -> Output {
        advee(&self.url, &self.run_dir).args(args).output().expect("the executable is built")
    }

    /// Starts a command of `advee` without waiting for it.
    pub fn spawn(&self, args: &[&str]) -> Child {
        let mut command = advee(&self.url, &self.run_dir);
        command.args(args).stdin(Stdio::null()).stdout(Stdio::null()).spawn().expect("the executable is built")
    }

    /// Receives until `condition` is true.
    #[track_caller]
    pub fn until(&mut self, what: &str, seconds: f64, mut condition: impl FnMut(&View) -> bool) -> Duration {
        let begin = Instant::now();
        while !condition(&self.view) {
            let left = Duration::from_secs_f64(seconds).saturating_sub(begin.elapsed());
            assert!(!left.is_zero(), "not within {seconds} s: {what}; reason: {:?}", self.view.reason());
            self.listen(left.min(Duration::from_millis(50)));
        }
        begin.elapsed()
    }

    /// Receives for a while.
    pub fn pass(&mut self, seconds: f64) {
        let end = Instant::now() + Duration::from_secs_f64(seconds);
        while let Some(left) = end.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) {
            self.listen(left.min(Duration::from_millis(50)));
        }
    }

    fn listen(&mut self, patience: Duration) {
        self.bus.wait(patience).expect("the bus can be waited for");
        while let Some(received) = self.bus.recv().expect("the bus can be read") {
            let known = self.own.as_mut().is_none_or(|own| own.knows(received.origin, &self.run_dir));
            if known {
                self.view.take(received.channel, received.payload);
            }
        }
    }

    /// From now on the view is of what the robot's processes publish in shared memory, whatever others forge.
    pub fn believe_own(&mut self) {
        self.own = Some(OwnProcesses::default());
    }

    /// Publishes one motion command as a remote operator.
    pub fn command(&mut self, speed: f64, steering: f64) {
        self.publish(lowlevel::CmdMotion { timestamp: 0, speed, steering, priority: 1, source: "test".into() });
    }

    pub fn publish(&mut self, message: impl Into<Message>) {
        let (message, mut bytes) = (message.into(), Vec::new());
        message.encode(&mut bytes).expect("encodable");
        self.bus.publish(message.channel().name(), &bytes).expect("the bus takes it");
    }

    /// Commands at 20 Hz for a while.
    pub fn drive(&mut self, speed: f64, steering: f64, seconds: f64) {
        for _ in 0..(seconds * 20.0) as u32 {
            self.command(speed, steering);
            self.pass(0.05);
        }
    }

    /// Kills one of the robot's processes.
    pub fn kill(&self, module: &str) {
        signal(self.view.pid(module), "KILL");
    }

    /// Sends Ctrl-C; returns the exit code of `advee up`.
    pub fn stop(&mut self) -> i32 {
        signal(self.up.id() as i32, "INT");
        let begin = Instant::now();
        loop {
            if let Some(status) = self.up.try_wait().expect("it is our child") {
                return status.code().unwrap_or(-1);
            }
            assert!(begin.elapsed() < Duration::from_secs(10), "advee up does not end");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Pids of processes with this robot's run folder on their command line.
    pub fn processes(&self) -> Vec<u32> {
        let pids = std::fs::read_dir("/proc")
            .expect("/proc")
            .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
        pids.filter(|pid: &u32| *pid != std::process::id() && is_of(*pid, &self.run_dir)).collect()
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        if self.up.try_wait().is_ok_and(|status| status.is_none()) {
            signal(self.up.id() as i32, "TERM");
            let begin = Instant::now();
            while self.up.try_wait().is_ok_and(|status| status.is_none()) && begin.elapsed() < Duration::from_secs(8) {
                std::thread::sleep(Duration::from_millis(20));
            }
            let _ = self.up.kill();
            let _ = self.up.wait();
        }
        let _ = std::fs::remove_dir_all(&self.run_dir);
        let _ = std::fs::remove_dir_all(logs(&self.run_dir));
    }
}

/// Log folder of a robot with this run folder.
pub fn logs(run_dir: &Path) -> PathBuf {
    run_dir.with_extension("log")
}

pub fn signal(pid: i32, name: &str) {
    assert!(pid > 1, "no such process");
    let signal: nix::sys::signal::Signal = format!("SIG{name}").parse().expect("a signal");
    let _ = nix::sys::signal::kill(nix::unistd::Pid::from_raw(pid), signal);
}

pub fn advee(url: &str, run_dir: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_advee"));
    command.current_dir(workspace()).args(["--lcm-url", url, "--run-dir"]).arg(run_dir);
    command
}

/// Starts a command of `advee` that has neither a bus nor a run folder, without waiting for it.
pub fn offline(args: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_advee"));
    command.current_dir(workspace()).args(args).stdin(Stdio::null()).stdout(Stdio::null());
    command.spawn().expect("the executable is built")
}

pub fn listen(url: &str) -> Lcm {
    let (url, _) = lcm::Url::parse(url).expect("a good url");
    let mut bus = Lcm::new(&url).expect("the bus opens");
    bus.subscribe(".*").expect("a good pattern");
    bus
}
