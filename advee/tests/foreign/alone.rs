//! One foreign module against a robot simulated by the test: the state table as implemented by native modules, reports,
//! bad input, the first state, and every way to end.

use crate::built::{Built, Foreign};
use crate::support::{can_port, listen, signal};
use lcm::live::Lcm;
use messages::lowlevel::{DataPower, DataSrfs, Range};
use messages::{Channel, Message, common};
use module::{Cause, State};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Timeout, long enough for a loaded machine.
const PATIENCE: Duration = Duration::from_secs(20);
/// Period of the devices' messages.
const PERIOD: Duration = Duration::from_millis(100);

const FORBIDDEN: i32 = 0x0001;
const MALFORMED: i32 = 0x0002;
const UNHANDLED: i32 = 0x8000;
const SILENT: i32 = 0x8001;
/// Low battery, or obstacle too near.
const WATCHED: i32 = 0x8002;

const IN_PYTHON: Foreign = ("python", "battery_watch");
const IN_C: Foreign = ("c", "battery_watch");
const IN_CPP: Foreign = ("cpp", "nearest_obstacle");
const IN_JAVA: Foreign = ("java", "battery_watch");
const IN_CSHARP: Foreign = ("csharp", "battery_watch");

#[test]
fn a_module_in_python_keeps_the_contract() {
    let Some(built) = Built::on_the_wheel() else { return };
    keeps_the_contract(built, IN_PYTHON);
}

#[test]
fn modules_in_c_and_cpp_keep_the_contract() {
    let Some(built) = Built::on_the_wheel() else { return };
    keeps_the_contract(built, IN_C);
    keeps_the_contract(built, IN_CPP);
}

#[test]
fn modules_in_c_and_cpp_on_debian_s_library_keep_the_contract() {
    let Some(built) = Built::on_debians() else { return };
    keeps_the_contract(built, IN_C);
    keeps_the_contract(built, IN_CPP);
}

#[test]
fn a_module_in_java_keeps_the_contract() {
    let Some(built) = Built::in_java() else { return };
    keeps_the_contract(built, IN_JAVA);
}

#[test]
fn a_module_in_csharp_keeps_the_contract() {
    let Some(built) = Built::in_csharp() else { return };
    keeps_the_contract(built, IN_CSHARP);
}

/// The examples of all languages that this machine can build.
fn examples() -> Vec<(&'static Built, Foreign)> {
    let wheel = Built::on_the_wheel().into_iter().flat_map(|built| [IN_PYTHON, IN_C, IN_CPP].map(|it| (built, it)));
    wheel.chain(Built::in_java().map(|it| (it, IN_JAVA))).chain(Built::in_csharp().map(|it| (it, IN_CSHARP))).collect()
}

/// The modules that fail.
fn broken() -> Vec<(&'static Built, Foreign)> {
    let name = |language| match language {
        "python" => "broken",
        "c" => "broken_c",
        "cpp" => "broken_cpp",
        "java" => "broken_java",
        _ => "broken_csharp",
    };
    examples().into_iter().map(|(built, (language, _))| (built, (language, name(language)))).collect()
}

fn keeps_the_contract(built: &Built, module: Foreign) {
    let mut robot = Robot::start(built, module, &[], &[]);
    robot.expect_state(State::Init);
    robot.obeys_its_table_in(State::Init);
    robot.device = true;
    robot.expect_change(State::Init, State::Run);
    for from in [State::Run, State::Pause, State::Stop] {
        robot.obeys_its_table_in(from);
    }
    robot.go(State::Run);
    robot.hears_of_others_nothing();
    robot.reports_what_it_watches_and_its_end();
    robot.reports_a_bad_message_once();
    robot.sends_reports_from_the_commanded_level();
    robot.reports_that_its_device_is_lost_and_found();
    robot.command("*", State::Terminate as i8, false);
    assert!(robot.ends(State::Run).success());
}

#[test]
fn the_first_state_is_given_by_the_watchdog_or_an_argument() {
    for (built, module) in examples() {
        let given: [(&[&str], _, _); 3] = [
            (&[], ("ADVEE_STATE", "PAUSE"), State::Pause),
            (&[], ("ADVEE_STATE", "STOP"), State::Stop),
            (&["--state", "STOP"], ("ADVEE_STATE", "RUN"), State::Stop),
        ];
        for (args, environment, first) in given {
            let mut robot = Robot::start(built, module, args, &[environment]);
            robot.device = true;
            robot.expect_state(State::Init);
            robot.expect_change(State::Init, first);
            signal(robot.module.id() as i32, "TERM");
            assert!(robot.ends(first).success());
        }
    }
}

#[test]
fn held_in_init_it_stops_and_stays_there() {
    for (built, module) in examples() {
        let mut robot = Robot::start(built, module, &[], &[]);
        robot.expect_state(State::Init);
        robot.command(module.1, State::Stop as i8, true);
        robot.expect_change(State::Init, State::Stop);
        robot.device = true;
        for _ in 0..2 {
            robot.expect_state(State::Stop);
        }
    }
}

#[test]
fn a_module_without_a_watchdog_ends_after_three_seconds() {
    let of = |built, module| {
        let mut robot = Robot::start(built, module, &[], &[("ADVEE_GUARDED", "yes")]);
        (robot.device, robot.watchdog) = (true, true);
        robot.expect_state(State::Init);
        robot.expect_change(State::Init, State::Run);
        // Longer than the timeout for a missing watchdog.
        let heard = Instant::now();
        while heard.elapsed() < Duration::from_secs(4) {
            robot.expect_state(State::Run);
        }
        robot.watchdog = false;
        let gone = Instant::now();
        assert!(robot.ends(State::Run).success());
        let took = gone.elapsed().as_secs_f64();
        assert!((2.4..6.0).contains(&took), "{took} s");
    };
    let all = examples();
    thread::scope(|scope| all.iter().for_each(|(built, module)| drop(scope.spawn(move || of(built, *module)))));
}

#[test]
fn an_exception_in_a_handler_is_reported_and_ends_the_module_with_its_exit_code() {
    for (built, module) in broken() {
        let kind = match module.0 {
            "python" => "RuntimeError: ",
            "java" => "IllegalStateException: ",
            "csharp" => "InvalidOperationException: ",
            _ => "",
        };
        let mut robot = Robot::start(built, module, &["device"], &[]);
        assert_eq!(robot.fatal(), (0x8001, "the device burns".into()));
        assert_eq!(robot.module.wait().unwrap().code(), Some(0x23));
        if module.0 == "c" {
            // It has no exceptions.
            continue;
        }
        let mut robot = Robot::start(built, module, &["timer"], &[]);
        assert_eq!(robot.fatal(), (UNHANDLED, format!("{kind}in a timer")));
        assert_eq!(robot.module.wait().unwrap().code(), Some(0x40));

        let mut robot = Robot::start(built, module, &["state"], &[]);
        robot.expect_state(State::Init);
        robot.expect_change(State::Init, State::Run);
        robot.command(module.1, State::Pause as i8, false);
        robot.expect_change(State::Run, State::Pause);
        assert_eq!(robot.fatal(), (UNHANDLED, format!("{kind}on a command")));
        assert_eq!(robot.module.wait().unwrap().code(), Some(0x40));

        let mut robot = Robot::start(built, module, &["constructor"], &[]);
        assert_eq!(robot.module.wait().unwrap().code(), Some(0x40));
    }
}

/// Heartbeat page in the format of docs/beats.md.
#[test]
fn each_thread_sends_heartbeats_unless_it_hangs() {
    for (built, module) in broken() {
        let name = module.1;
        let path = std::env::temp_dir().join(format!("advee-page-of-{name}-{}", std::process::id()));
        std::fs::write(&path, [0; 4096]).unwrap();
        let mut robot = Robot::start(built, module, &["worker"], &[("ADVEE_BEATS", path.to_str().unwrap())]);
        robot.expect_state(State::Init);
        robot.expect_change(State::Init, State::Run);
        robot.expect_state(State::Run);
        let page = std::fs::read(&path).unwrap();
        let number = |page: &[u8], at: usize| u32::from_le_bytes(page[at..at + 4].try_into().unwrap());
        assert_eq!((page.len(), &page[..4]), (4096, &b"BEAT"[..]));
        assert_eq!([4, 8, 12].map(|at| number(&page, at)), [1, robot.module.id(), 2]);
        let name_of =
            |thread: usize| std::str::from_utf8(&page[64 + 64 * thread..][..48]).unwrap().trim_end_matches('\0');
        let main = usize::from(name_of(1) == "main");
        assert_eq!([name_of(main), name_of(1 - main)], ["main", "worker"]);

        // Heartbeats of both within about 0.6 s.
        let counts = |page: &[u8]| [main, 1 - main].map(|thread| number(page, 64 + 64 * thread + 48));
        let beats = || {
            let before = counts(&std::fs::read(&path).unwrap());
            thread::sleep(Duration::from_millis(600));
            let after = counts(&std::fs::read(&path).unwrap());
            [after[0] - before[0], after[1] - before[1]]
        };
        let both = beats();
        // Every 50 ms on an idle machine; never more often.
        assert!(both.iter().all(|beats| (2..=13).contains(beats)), "{name}: {both:?}");
        robot.command(name, State::Pause as i8, false);
        robot.expect_change(State::Run, State::Pause);
        thread::sleep(Duration::from_millis(100));
        let one = beats();
        assert!(one[0] >= 2 && one[1] == 0, "{name}: {one:?}");
        signal(robot.module.id() as i32, "TERM");
        assert!(robot.ends(State::Pause).success());
        std::fs::remove_file(&path).unwrap();
    }
}

#[test]
fn an_invalid_command_line_is_refused_with_a_reason() {
    for (built, module) in examples() {
        let bad: [(&[&str], &str); 4] = [
            (&["--state", "ERROR"], "ERROR: expected RUN, PAUSE or STOP"),
            (&["--state"], "--state"),
            (&["far"], "far"),
            (&["--lcm-url", "nowhere://"], "LCM at nowhere://"),
        ];
        for (args, why) in bad {
            let output = command(built, module).args(args).output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(0x10), "{args:?}: {said}");
            assert!(said.contains(why) || (module == IN_CPP && said.contains("expected one number")), "{said}");
        }
    }
}

/// Message of a module.
#[derive(Debug, PartialEq)]
enum Said {
    State(State),
    Report { number: i32, severity: i8, kind: i8, message: String },
    Fatal { number: i32, message: String },
}

/// Starts a module without what a watchdog passes.
pub fn command(built: &Built, module: Foreign) -> Command {
    let line = built.command(module);
    let mut command = Command::new(&line[0]);
    command.args(&line[1..]).stdin(Stdio::null());
    for variable in ["ADVEE_MODULE", "ADVEE_STATE", "ADVEE_BEATS", "ADVEE_GUARDED"] {
        command.env_remove(variable);
    }
    command
}

/// Process of a module with the simulated robot around it.
struct Robot {
    name: &'static str,
    module: Child,
    bus: Lcm,
    /// True while the sonars and the power controller publish, with their values and the next deadline.
    device: bool,
    volts: f64,
    metres: f64,
    due: Instant,
    /// True if there is a watchdog.
    watchdog: bool,
    /// Last state and timestamp of the module, µs.
    state: State,
    stamp: i64,
    /// Active faults, by its last list.
    active: Vec<common::Fault>,
}

impl Robot {
    fn start(built: &Built, foreign: Foreign, args: &[&str], environment: &[(&str, &str)]) -> Self {
        let url = format!("udpm://239.255.76.67:{}?ttl=0", can_port());
        let bus = listen(&url);
        let mut command = command(built, foreign);
        let module = command.args(args).env("LCM_DEFAULT_URL", &url).envs(environment.iter().copied()).spawn();
        let (module, due) = (module.expect("it was built"), Instant::now());
        Self {
            name: foreign.1,
            module,
            bus,
            device: false,
            volts: 26.0,
            metres: 2.0,
            due,
            watchdog: false,
            state: State::Unknown,
            stamp: 0,
            active: Vec::new(),
        }
    }

    /// Every command in this state has the same effect as on a native module.
    fn obeys_its_table_in(&mut self, from: State) {
        for (to, manual) in State::ALL.into_iter().flat_map(|to| [(to, false), (to, true)]) {
            let cause = if manual { Cause::Manual } else { Cause::Command };
            // Transitions from INIT and ERROR have other tests, and TERMINATE is tested at the end.
            let back = matches!(from, State::Run | State::Pause | State::Stop);
            let spoils = to == State::Terminate || (!back && from.allows(to, cause));
            if to == from || spoils {
                continue;
            }
            self.go(from);
            self.command(self.name, to as i8, manual);
            if from.allows(to, cause) {
                self.expect_change(from, to);
            } else {
                let manner = if manual { "manual " } else { "" };
                self.expect_warning(FORBIDDEN, &format!("{manner}command {to} from test refused in {from}"));
            }
        }
        self.command("*", 99, true);
        self.expect_warning(FORBIDDEN, "command from test refused: 99 is no state");
        self.go(from);
    }

    /// Brings the module into a state that a person can reach from the current one.
    fn go(&mut self, to: State) {
        if self.state != to {
            self.command("*", to as i8, true);
            while self.next() != Said::State(to) {}
        }
    }

    fn hears_of_others_nothing(&mut self) {
        self.command("another", State::Stop as i8, true);
        for _ in 0..2 {
            self.expect_state(State::Run);
        }
    }

    /// The module acts in RUN only.
    fn reports_what_it_watches_and_its_end(&mut self) {
        self.go(State::Pause);
        (self.volts, self.metres) = (20.0, 0.1);
        for _ in 0..2 {
            self.expect_state(State::Pause);
        }
        self.go(State::Run);
        let (kind, low, well) = match self.name == IN_PYTHON.1 {
            true => {
                (common::Error::RESOURCE, "the battery has 20.0 V, less than 25.0 V", "the battery has 26.0 V again")
            }
            false => (common::Error::UNKNOWN, "something is nearer than 0.25 m", "nothing is nearer than 0.35 m"),
        };
        self.expect_report(WATCHED, common::Error::WARNING, kind, low);
        // Reported once.
        for _ in 0..2 {
            self.expect_state(State::Run);
        }
        (self.volts, self.metres) = (26.0, 2.0);
        self.expect_report(WATCHED, common::Error::NOTICE, kind, well);
    }

    fn reports_a_bad_message_once(&mut self) {
        for _ in 0..3 {
            for channel in [Channel::LlDataPower, Channel::LlDataSrfs] {
                self.bus.publish(channel.name(), b"nonsense").expect("the bus takes it");
            }
        }
        let Said::Report { number, severity, message, .. } = self.report() else { panic!("no report") };
        assert_eq!((number, severity), (MALFORMED, common::Error::WARNING), "{message}");
        assert!(message.contains("a message of 8 bytes is dropped"), "{message}");
        self.expect_state(State::Run);
    }

    /// Below the level faults are listed and not reported; what is no level is refused, and a flood of it counted.
    fn sends_reports_from_the_commanded_level(&mut self) {
        const RESET: i8 = common::CmdLevel::CONFIGURED;
        let is_watched = |robot: &Self| robot.active.iter().any(|fault| fault.number == WATCHED);
        self.level("another", 0, 3);
        self.level(self.name, common::CmdLevel::UNCHANGED, 3);
        (self.volts, self.metres) = (20.0, 0.1);
        while !is_watched(self) {
            self.expect_state(State::Run);
        }
        (self.volts, self.metres) = (26.0, 2.0);
        while is_watched(self) {
            self.expect_state(State::Run);
        }
        self.level("*", RESET, RESET);
        for _ in 0..3 {
            self.level(self.name, 0, 9);
        }
        self.expect_warning(FORBIDDEN, "command from test refused: 9 is no level");
        for _ in 0..3 {
            self.expect_state(State::Run);
        }
        self.level("*", -2, 0);
        self.expect_warning(FORBIDDEN, "command from test refused: -2 is no level; 3 refused since the last report");
    }

    fn level(&mut self, module: &str, print_from: i8, send_from: i8) {
        let (module, source) = (module.into(), "test".into());
        self.publish(common::CmdLevel { timestamp: 0, module, print_from, send_from, source });
    }

    /// From RUN to STOP and back.
    fn reports_that_its_device_is_lost_and_found(&mut self) {
        let (lost, found) = match self.name {
            "battery_watch" => ("no LL_DATA_POWER: is driver_power there?", "LL_DATA_POWER is heard again"),
            _ => ("no LL_DATA_SRFS: is driver_rs485a there?", "the sonars are heard again"),
        };
        self.device = false;
        self.expect_report(SILENT, common::Error::ERROR, common::Error::TIMEOUT, lost);
        self.expect_change(State::Run, State::Error);
        self.obeys_its_table_in(State::Error);
        self.command(self.name, State::Stop as i8, true);
        self.expect_change(State::Error, State::Stop);
        self.command(self.name, State::Pause as i8, true);
        self.expect_change(State::Stop, State::Pause);
        self.expect_change(State::Pause, State::Error);
        self.device = true;
        self.expect_report(SILENT, common::Error::NOTICE, common::Error::TIMEOUT, found);
        self.expect_change(State::Error, State::Pause);
        self.go(State::Run);
    }

    /// Publishes TERMINATE as its last state.
    fn ends(&mut self, from: State) -> ExitStatus {
        self.expect_change(from, State::Terminate);
        self.module.wait().expect("it is our child")
    }

    fn command(&mut self, module: &str, state: i8, manual: bool) {
        let (module, source) = (module.into(), "test".into());
        self.publish(common::CmdState { timestamp: 0, module, state, manual, source });
    }

    fn publish(&mut self, message: impl Into<Message>) {
        let (message, mut bytes) = (message.into(), Vec::new());
        message.encode(&mut bytes).expect("encodable");
        self.bus.publish(message.channel().name(), &bytes).expect("the bus takes it");
    }

    /// Publishes the messages of the simulated robot that are due.
    fn play(&mut self) {
        if self.due > Instant::now() {
            return;
        }
        self.due = Instant::now() + PERIOD;
        if self.device {
            self.publish(DataPower { voltage: self.volts, ..DataPower::default() });
            let near = Range { distance: self.metres, valid: true, ..Range::default() };
            let srfs = vec![Range { distance: f64::NAN, ..Range::default() }, near];
            self.publish(DataSrfs { timestamp: 0, srfs });
        }
        if self.watchdog {
            self.publish(common::DataProcesses::default());
        }
    }

    /// The list before a report contains its fault since the same instant; a report of the end follows a list without
    /// it.
    fn is_listed(&self, error: &common::Error) {
        let active: Vec<_> = self.active.iter().filter(|fault| fault.number == error.number).collect();
        match (error.number, error.severity) {
            (FORBIDDEN, _) => assert!(active.is_empty(), "{active:?}: it happened, and that is all"),
            _ if error.fatal => {}
            (_, common::Error::NOTICE) => assert!(active.is_empty(), "{active:?} is cleared by {error:?}"),
            _ => {
                let same = |fault: &&common::Fault| {
                    (fault.since, fault.severity, &fault.message) == (error.timestamp, error.severity, &error.message)
                };
                assert!(active.into_iter().any(|fault| same(&fault)), "{error:?} is not in {:?}", self.active);
            }
        }
    }

    /// Next message of the module.
    fn next(&mut self) -> Said {
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            self.play();
            let Some(received) = self.bus.recv().expect("the bus can be read") else {
                self.bus.wait(PERIOD / 4).expect("the bus can be waited for");
                continue;
            };
            let heard = Message::receive(received.channel, received.payload);
            match heard.transpose().ok().flatten() {
                Some(Message::CmDataState(state)) => {
                    assert_eq!(state.module, self.name);
                    self.stamped(state.timestamp);
                    self.state = State::from_value(state.state).expect("a state");
                    return Said::State(self.state);
                }
                Some(Message::CmDataFaults(list)) => {
                    assert_eq!(list.module, self.name);
                    self.active = list.faults;
                }
                Some(Message::CmEventError(error)) => {
                    assert!(error.module == self.name && error.line > 0 && !error.file.contains('/'), "{error:?}");
                    self.stamped(error.timestamp);
                    self.is_listed(&error);
                    let common::Error { number, severity, r#type: kind, message, fatal, .. } = error;
                    return match fatal {
                        true => Said::Fatal { number, message },
                        false => Said::Report { number, severity, kind, message },
                    };
                }
                _ => {}
            }
        }
        panic!("{} says nothing within {PATIENCE:?}", self.name);
    }

    fn stamped(&mut self, stamp: i64) {
        assert!(stamp >= self.stamp.max(1_600_000_000_000_000), "{stamp} after {}", self.stamp);
        self.stamp = stamp;
    }

    #[track_caller]
    fn expect_state(&mut self, state: State) {
        assert_eq!(self.next(), Said::State(state));
    }

    /// Waits for state `to`; periodic announcements of `from` may precede it.
    #[track_caller]
    fn expect_change(&mut self, from: State, to: State) {
        loop {
            match self.next() {
                Said::State(state) if state == from => {}
                said => return assert_eq!(said, Said::State(to)),
            }
        }
    }

    /// Next report; announcements may precede it.
    fn report(&mut self) -> Said {
        std::iter::repeat_with(|| self.next()).find(|said| !matches!(said, Said::State(_))).expect("one")
    }

    #[track_caller]
    fn expect_report(&mut self, number: i32, severity: i8, kind: i8, message: &str) {
        assert_eq!(self.report(), Said::Report { number, severity, kind, message: message.into() });
    }

    #[track_caller]
    fn expect_warning(&mut self, number: i32, message: &str) {
        self.expect_report(number, common::Error::WARNING, common::Error::UNKNOWN, message);
    }

    fn fatal(&mut self) -> (i32, String) {
        match self.report() {
            Said::Fatal { number, message } => (number, message),
            said => panic!("{said:?}"),
        }
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        let _ = self.module.kill();
        let _ = self.module.wait();
    }
}
