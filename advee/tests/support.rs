//! A whole simulated robot of one's own: `advee up --sim` on ports and a run folder that no other test has, its bus
//! listened to, its processes ended by pid.
#![allow(dead_code, reason = "each test binary uses its part")]

use lcm::live::Lcm;
use messages::{Channel, Hold, Message, common, lowlevel, simulation};
use module::State;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError, Weak};
use std::time::{Duration, Instant};

pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("robot lies in the workspace").into()
}

/// A port that no other test of this machine uses now: as long as this process lives nobody else can listen on it by TCP.
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

/// A CAN bus over UDP that no other test uses now.
pub fn can_port() -> u16 {
    robot::topology::can_port_beside(unique_port())
}

/// A Python with all packages of `tools/requirements.txt`, or the test is skipped.
pub fn python() -> Option<PathBuf> {
    static PYTHON: OnceLock<testing::Found<PathBuf>> = OnceLock::new();
    const PACKAGES: [&str; 9] =
        ["lcm", "can", "msgpack", "canopen", "durand", "serial", "rosbags", "mcap_ros2", "websockets"];
    testing::peer_or_skip(PYTHON.get_or_init(|| testing::python(&PACKAGES)).clone())
}

/// A share of this machine, returned when the last clone is dropped. Whatever runs in real time holds one: at most as
/// many at a time as there are cores, however many threads the tests run in.
pub struct Turn(usize);

/// Waiting turns, first come, first served.
struct Turns {
    free: usize,
    /// Number of the next one to come, and of the next one to be served.
    next: usize,
    served: usize,
}

static TURNS: Mutex<Option<Turns>> = Mutex::new(None);
static RETURNED: Condvar = Condvar::new();

thread_local! {
    /// The turn of the test that runs in this thread: whoever has one gets it again.
    static OWN: RefCell<Weak<Turn>> = const { RefCell::new(Weak::new()) };
}

/// One core's share, as every [`Robot`] takes it.
pub fn turn() -> Arc<Turn> {
    take(1)
}

/// The whole machine, for a test that loads it or measures it closely; called first in the test.
pub fn alone() -> Arc<Turn> {
    take(usize::MAX)
}

fn take(shares: usize) -> Arc<Turn> {
    if let Some(own) = OWN.with_borrow(Weak::upgrade) {
        return own;
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let shares = shares.min(cores);
    let mut turns = TURNS.lock().unwrap_or_else(PoisonError::into_inner);
    let all = turns.get_or_insert(Turns { free: cores, next: 0, served: 0 });
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
    let turn = Arc::new(Turn(shares));
    OWN.set(Arc::downgrade(&turn));
    turn
}

impl Drop for Turn {
    fn drop(&mut self) {
        if let Some(turns) = TURNS.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            turns.free += self.0;
        }
        RETURNED.notify_all();
    }
}

/// The message types as Python classes, made by the official `lcm-gen` that belongs to `python`, in the folder `build`.
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

/// What was last heard on the bus.
#[derive(Default)]
pub struct View {
    pub truth: Option<simulation::DataTruth>,
    pub motion: Option<lowlevel::DataMotion>,
    /// What stands against acting, by module.
    pub holds: BTreeMap<String, lowlevel::DataHold>,
    pub odo: Option<lowlevel::DataOdo>,
    pub joydev: Option<lowlevel::DataJoydev>,
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
            Ok(Message::LlDataJoydev(joydev)) => self.joydev = Some(joydev),
            Ok(Message::CmDataProcesses(list)) => {
                self.processes = list.processes.into_iter().map(|process| (process.module.clone(), process)).collect();
            }
            Ok(Message::CmEventError(error)) => self.errors.push(error),
            Ok(Message::CmEventText(text)) => self.texts.push(text),
            _ => {}
        }
    }

    /// Speed of the body, m/s; NaN before anything was heard.
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

    /// What stands against motion, the weightiest first.
    pub fn causes(&self) -> Vec<Hold> {
        let list = self.holds.get(messages::MOTION_MODULE);
        list.into_iter().flat_map(|list| &list.holds).filter_map(lowlevel::Hold::cause).collect()
    }

    /// Nothing stands against motion but that nobody commands it.
    pub fn is_free(&self) -> bool {
        self.holds.get(messages::MOTION_MODULE).is_some_and(lowlevel::DataHold::is_free)
    }

    /// For people only.
    pub fn reason(&self) -> String {
        self.motion.as_ref().map_or("no LL_DATA_MOTION".into(), |motion| motion.reason.clone())
    }
}

/// A running robot.
pub struct Robot {
    pub url: String,
    pub port: u16,
    pub run_dir: PathBuf,
    pub view: View,
    pub bus: Lcm,
    up: Child,
    _turn: Arc<Turn>,
}

impl Robot {
    /// Starts a robot in a hall without visitors; `extra` are further arguments of `advee up --sim`.
    pub fn start(extra: &[&str]) -> Self {
        Self::start_on(0, extra)
    }

    /// The same with a time to live of its messages.
    pub fn start_on(ttl: u8, extra: &[&str]) -> Self {
        let turn = turn();
        let port = unique_port();
        let url = format!("udpm://239.255.76.67:{port}?ttl={ttl}&shm=auto");
        let run_dir = std::env::temp_dir().join(format!("advee-test-{}-{port}", std::process::id()));
        let bus = listen(&url);
        // With a web server only where the test has an address for it.
        let headless: &[&str] = if extra.contains(&"--http") { &[] } else { &["--headless"] };
        let up = advee(&url, &run_dir)
            .args(["up", "--sim", "--goal", "none"])
            .args(headless)
            .args(["--set", &format!("log.folder={:?}", logs(&run_dir)), "--set", "world.people=0"])
            .args(extra)
            .stdin(Stdio::null())
            .spawn()
            .expect("the executable is built");
        Self { url, port, run_dir, view: View::default(), bus, up, _turn: turn }
    }

    /// The same, waited for until every module runs and the steering is homed.
    pub fn ready(extra: &[&str]) -> Self {
        Self::ready_on(0, extra)
    }

    /// The same with a time to live of its messages.
    pub fn ready_on(ttl: u8, extra: &[&str]) -> Self {
        let mut robot = Self::start_on(ttl, extra);
        robot.until("all modules RUN and the steering homed", 20.0, |view| view.all_run() && view.is_homed());
        robot
    }

    /// A command of `advee` on this robot's bus.
    pub fn advee(&self, args: &[&str]) -> Output {
        advee(&self.url, &self.run_dir).args(args).output().expect("the executable is built")
    }

    /// The same, not waited for.
    pub fn spawn(&self, args: &[&str]) -> Child {
        let mut command = advee(&self.url, &self.run_dir);
        command.args(args).stdin(Stdio::null()).stdout(Stdio::null()).spawn().expect("the executable is built")
    }

    /// Listens until `condition` holds.
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

    /// Listens for a while.
    pub fn pass(&mut self, seconds: f64) {
        let end = Instant::now() + Duration::from_secs_f64(seconds);
        while let Some(left) = end.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) {
            self.listen(left.min(Duration::from_millis(50)));
        }
    }

    fn listen(&mut self, patience: Duration) {
        self.bus.wait(patience).expect("the bus can be waited for");
        while let Some(received) = self.bus.recv().expect("the bus can be read") {
            self.view.take(received.channel, received.payload);
        }
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

    /// Ends one of the robot's processes the hard way.
    pub fn kill(&self, module: &str) {
        signal(self.view.pid(module), "KILL");
    }

    /// Ctrl-C; returns the exit code of `advee up`.
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

    /// Pids of processes that run with this robot's run folder on their command line.
    pub fn processes(&self) -> Vec<u32> {
        let run_dir = self.run_dir.to_string_lossy().into_owned();
        let pids = std::fs::read_dir("/proc")
            .expect("/proc")
            .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
        pids.filter(|pid: &u32| {
            *pid != std::process::id()
                && std::fs::read(format!("/proc/{pid}/cmdline"))
                    .is_ok_and(|line| String::from_utf8_lossy(&line).contains(&run_dir))
        })
        .collect()
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

/// Where a robot of that run folder keeps its logs.
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

pub fn listen(url: &str) -> Lcm {
    let (url, _) = lcm::Url::parse(url).expect("a good url");
    let mut bus = Lcm::new(&url).expect("the bus opens");
    bus.subscribe(".*").expect("a good pattern");
    bus
}
