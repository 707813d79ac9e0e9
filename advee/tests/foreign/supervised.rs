//! Foreign modules under the watchdog of a simulated robot.

use crate::built::Built;
use crate::support::{Robot, View, signal, workspace};
use base::Fault;
use lcm::live::Lcm;
use messages::{Message, common};
use module::State;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Faults of the battery watch and of the sonar watch (docs/writing-a-module.md).
const WATCHED: i32 = 0x8002;
/// Modules supervised by heartbeats, by their announcements only, and one with an invalid heartbeat page.
const BEATING: [&str; 2] = ["battery_watch", "nearest_obstacle"];
const QUIET: &str = "battery_quiet";
const TORN: &str = "torn_page";

#[test]
fn foreign_modules_live_under_the_watchdog() {
    let Some(built) = Built::on_the_wheel() else { return };
    let mut test = Supervised::start(built);
    test.they_run();
    test.a_torn_page_is_told_and_the_module_lives_on();
    test.they_obey();
    test.a_fault_is_reported_and_cleared();
    test.the_watchdog_answers_for_them_with_their_levels();
    test.a_hung_one_is_restarted();
    test.a_killed_one_comes_back_into_its_wanted_state();
    test.terminate_keeps_it_down();
    test.they_outlive_their_watchdog_and_serve_the_next();
    assert_eq!(test.robot.view.pid(TORN), test.torn, "the one with the torn page has lived through all of it");
    test.ends();
}

/// A virtual machine starts slowly, and its loop is interrupted by its collector: it is supervised as all others.
#[test]
fn modules_in_java_and_csharp_are_restarted_after_a_hang() {
    let java = Built::in_java().map(|built| ("watch_java", built.command(("java", "battery_watch"))));
    let csharp = Built::in_csharp().map(|built| ("watch_csharp", built.command(("csharp", "battery_watch"))));
    let modules: Vec<(&str, Vec<String>)> = java.into_iter().chain(csharp).collect();
    if modules.is_empty() {
        return;
    }
    let config = std::env::temp_dir().join(format!("advee-foreign-machines-{}", std::process::id()));
    configure(&modules, &config);
    let folder = config.join("advee");
    let mut robot = Robot::start(&["--config", folder.to_str().expect("UTF-8")]);
    robot.until("the watchdog is heard", 10.0, |view| !view.processes.is_empty());
    robot.until("all modules RUN", 30.0, View::all_run);
    for (module, _) in &modules {
        let before = robot.view.pid(module);
        signal(before, "STOP");
        robot.until("another process", 10.0, |view| ![0, before].contains(&view.pid(module)));
        robot.until("all RUN again", 30.0, View::all_run);
        let start = format!("{module} hangs, its thread main has sent no heartbeat for ");
        let is_hang =
            |error: &common::Error| error.number == Fault::ModuleHung as i32 && error.message.starts_with(&start);
        assert!(robot.view.errors.iter().any(is_hang), "{:?}", robot.view.errors);
    }
    assert_eq!(robot.stop(), 0);
    let _ = fs::remove_dir_all(&config);
}

struct Supervised {
    robot: Robot,
    /// Subscribed to all announcements, for the order of states.
    announced: Lcm,
    config: PathBuf,
    torn: i32,
}

impl Supervised {
    fn start(built: &Built) -> Self {
        let config = std::env::temp_dir().join(format!("advee-foreign-{}", std::process::id()));
        configure(&foreign(built), &config);
        let folder = config.join("advee");
        let folder = folder.to_str().expect("UTF-8");
        let robot = Robot::start(&["--config", folder]);
        let mut announced = Lcm::new(&lcm::Url::parse(&robot.url).expect("a good url").0).expect("the bus opens");
        announced.subscribe("CM_DATA_STATE").expect("a good name");
        Self { robot, announced, config, torn: 0 }
    }

    fn they_run(&mut self) {
        self.robot.until("the watchdog is heard", 10.0, |view| !view.processes.is_empty());
        let took = self.robot.until("all modules RUN", 5.0, View::all_run);
        println!("all RUN after {:.2} s", took.as_secs_f64());
    }

    fn a_torn_page_is_told_and_the_module_lives_on(&mut self) {
        let told = |error: &&common::Error| error.number == Fault::BeatsBad as i32;
        self.robot.until("BeatsBad", 2.0, |view| view.errors.iter().any(|error| told(&error)));
        let told: Vec<_> = self.robot.view.errors.iter().filter(told).collect();
        let [told] = told[..] else { panic!("once: {told:?}") };
        assert!(told.module == "watchdog" && told.message.starts_with("torn_page: its heartbeat page "), "{told:?}");
        self.torn = self.robot.view.pid(TORN);
    }

    fn they_obey(&mut self) {
        self.command("battery_watch", State::Pause, false);
        self.reaches("battery_watch", State::Pause);
        self.command("*", State::Stop, false);
        self.reaches("battery_watch", State::Pause);
        for module in [BEATING[0], BEATING[1], QUIET, TORN] {
            self.robot.until("the refusal", 2.0, |view| view.errors.iter().any(|error| refused(error, module, "STOP")));
        }
        self.command("battery_watch", State::Run, false);
        self.reaches("battery_watch", State::Run);
        // With the rights of a person.
        let output = self.robot.advee(&["state", "nearest_obstacle", "STOP"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        self.reaches("nearest_obstacle", State::Stop);
        self.command("nearest_obstacle", State::Run, false);
        let module = "nearest_obstacle";
        self.robot.until("the refusal", 2.0, |view| view.errors.iter().any(|error| refused(error, module, "RUN")));
        self.command_manually("nearest_obstacle", State::Run);
        self.reaches("nearest_obstacle", State::Run);
    }

    fn a_fault_is_reported_and_cleared(&mut self) {
        let of = |severity| {
            move |error: &common::Error| {
                let own = error.module == "battery_watch" && error.number == WATCHED;
                own && error.severity == severity && error.r#type == common::Error::RESOURCE
            }
        };
        let output = self.robot.advee(&["fault", "psc1", "battery", "22"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        self.robot.until("its report", 4.0, |view| view.errors.iter().any(of(common::Error::WARNING)));
        self.robot.advee(&["fault", "psc1", "none"]);
        self.robot.until("its end", 4.0, |view| view.errors.iter().any(of(common::Error::NOTICE)));
    }

    /// All of them, ours and foreign ones; a foreign one's lines are printed and sent by the watchdog.
    fn the_watchdog_answers_for_them_with_their_levels(&mut self) {
        let levels = |robot: &Robot, args: &[&str]| {
            let output = robot.advee(&[&["level", "--json"], args].concat());
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            String::from_utf8_lossy(&output.stdout).into_owned()
        };
        let all = levels(&self.robot, &[]);
        for module in [BEATING[0], BEATING[1], QUIET, "watchdog", "driver_power"] {
            assert!(all.contains(&format!("\"module\":\"{module}\"")), "{module}: {all}");
        }
        let changed = levels(&self.robot, &["battery_watch", "--send", "debug"]);
        assert!(changed.contains("\"send_from\":\"debug\"") && changed.contains("\"changed\":true"), "{changed}");
        let reset = levels(&self.robot, &["battery_watch", "--reset"]);
        assert!(reset.contains("\"send_from\":\"info\"") && reset.contains("\"changed\":false"), "{reset}");
    }

    /// Restarted within a second with heartbeats, within two by announcements; on a loaded machine in one of three
    /// attempts.
    fn a_hung_one_is_restarted(&mut self) {
        let in_time = (0..3).any(|_| {
            let took = self.hang();
            println!("another process so long after it hung: {took:.2?} s");
            self.robot.until("all RUN again", 5.0, View::all_run);
            matches!(took, [..1.0, ..1.0, 0.9..3.0])
        });
        assert!(in_time, "not once in three attempts");
        let hung = |module: &str, why: &str, errors: &[common::Error]| {
            let start = format!("{module} hangs, {why}");
            errors.iter().any(|error| error.number == Fault::ModuleHung as i32 && error.message.starts_with(&start))
        };
        let errors = &self.robot.view.errors;
        for module in BEATING {
            assert!(hung(module, "its thread main has sent no heartbeat for ", errors), "{errors:?}");
        }
        assert!(hung(QUIET, "it has not announced itself for ", errors), "{errors:?}");
    }

    /// Stops three at once; returns the seconds until each has a new process.
    fn hang(&mut self) -> [f64; 3] {
        let modules = [BEATING[0], BEATING[1], QUIET];
        let before = modules.map(|module| self.robot.view.pid(module));
        before.iter().for_each(|pid| signal(*pid, "STOP"));
        let stopped = Instant::now();
        let mut took = [f64::INFINITY; 3];
        self.robot.until("another process each", 10.0, |view| {
            for (index, took) in took.iter_mut().enumerate().filter(|(_, took)| took.is_infinite()) {
                if ![0, before[index]].contains(&view.pid(modules[index])) {
                    *took = stopped.elapsed().as_secs_f64();
                }
            }
            took.iter().all(|took| took.is_finite())
        });
        took
    }

    /// In STOP before and after, and never in a state that acts in between.
    fn a_killed_one_comes_back_into_its_wanted_state(&mut self) {
        for module in BEATING {
            self.command_manually(module, State::Stop);
            self.reaches(module, State::Stop);
            let before = self.robot.view.pid(module);
            self.states_of(module);
            signal(before, "KILL");
            self.robot.until("another process", 2.0, |view| ![0, before].contains(&view.pid(module)));
            self.reaches(module, State::Stop);
            let states = self.states_of(module);
            let calm = states.iter().all(|state| [State::Init, State::Stop].contains(state));
            assert!(calm && states.contains(&State::Init), "{module}: {states:?}");
            self.command_manually(module, State::Run);
            self.reaches(module, State::Run);
        }
    }

    fn terminate_keeps_it_down(&mut self) {
        for module in BEATING {
            self.command(module, State::Terminate, false);
            self.robot.until("its end", 3.0, |view| view.processes[module].pid == 0);
            assert_eq!(self.robot.view.processes[module].last_exit, 0, "it ended in good order");
            assert_eq!(self.states_of(module).last(), Some(&State::Terminate));
        }
        self.robot.pass(1.5);
        for module in BEATING {
            assert_eq!(self.robot.view.pid(module), 0, "{module} stays down");
            self.command(module, State::Run, false);
            self.reaches(module, State::Run);
        }
    }

    fn they_outlive_their_watchdog_and_serve_the_next(&mut self) {
        let modules = [BEATING[0], BEATING[1], QUIET, TORN];
        let before = modules.map(|module| self.robot.view.pid(module));
        let line = "\0run\0watchdog\0";
        let watchdog = |robot: &Robot| {
            robot.processes().into_iter().find(|pid| {
                let own = fs::read(format!("/proc/{pid}/cmdline"));
                own.is_ok_and(|own| String::from_utf8_lossy(&own).contains(line))
            })
        };
        let old = watchdog(&self.robot).expect("it runs");
        signal(old as i32, "KILL");
        let begin = Instant::now();
        while watchdog(&self.robot).is_none_or(|pid| pid == old) {
            assert!(begin.elapsed() < Duration::from_secs(3), "no new watchdog");
            self.robot.pass(0.02);
        }
        // Longer than they wait for a watchdog.
        self.robot.pass(3.5);
        assert_eq!(modules.map(|module| self.robot.view.pid(module)), before);
        // The new watchdog supervises them.
        signal(before[0], "STOP");
        self.robot.until("another process", 3.0, |view| ![0, before[0]].contains(&view.pid(BEATING[0])));
        self.reaches(BEATING[0], State::Run);
    }

    /// No process is left over.
    fn ends(mut self) {
        let foreign = [BEATING[0], BEATING[1], QUIET, TORN].map(|module| self.robot.view.pid(module));
        assert_eq!(self.robot.stop(), 0);
        for pid in foreign {
            assert!(!Path::new(&format!("/proc/{pid}")).exists(), "{pid} is left over");
        }
    }

    fn command(&mut self, module: &str, state: State, manual: bool) {
        let (module, source, state) = (module.into(), "test".into(), state as i8);
        self.robot.publish(common::CmdState { timestamp: 0, module, state, manual, source });
    }

    fn command_manually(&mut self, module: &str, state: State) {
        self.command(module, state, true);
    }

    #[track_caller]
    fn reaches(&mut self, module: &str, state: State) {
        self.robot.until(&format!("{module} in {state}"), 4.0, |view| view.processes[module].state == state as i8);
    }

    /// States announced since the last call.
    fn states_of(&mut self, module: &str) -> Vec<State> {
        let mut states = Vec::new();
        while self.announced.wait(Duration::from_millis(50)).expect("the bus can be waited for") {
            let received = self.announced.recv().expect("the bus can be read");
            let heard = received.and_then(|received| Message::receive(received.channel, received.payload));
            if let Some(Ok(Message::CmDataState(state))) = heard
                && state.module == module
            {
                states.extend(State::from_value(state.state));
            }
        }
        states
    }
}

impl Drop for Supervised {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.config);
    }
}

fn refused(error: &common::Error, module: &str, state: &str) -> bool {
    let message = format!("command {state} from test refused in ");
    error.number == Fault::CommandForbidden as i32 && error.module == module && error.message.starts_with(&message)
}

/// The example modules, each with its command line.
fn foreign(built: &Built) -> [(&'static str, Vec<String>); 4] {
    let below = |mut line: Vec<String>| {
        line.extend(["--below", "24"].map(String::from));
        line
    };
    let quiet = ["env", "-u", "ADVEE_BEATS"].map(String::from).to_vec();
    [
        (BEATING[0], below(built.command(("python", "battery_watch")))),
        (BEATING[1], [built.command(("cpp", "nearest_obstacle")), vec!["0.02".into()]].concat()),
        (QUIET, [quiet, below(built.command(("python", "battery_watch")))].concat()),
        (TORN, built.command(("python", "torn_page"))),
    ]
}

/// Shipped robot with these modules instead of the drives'.
fn configure(foreign: &[(&str, Vec<String>)], config: &Path) {
    let (advee, worlds) = (config.join("advee"), config.join("worlds"));
    for (from, to) in [("conf/advee", &advee), ("conf/worlds", &worlds)] {
        fs::create_dir_all(to).expect("a folder");
        for entry in fs::read_dir(workspace().join(from)).expect("shipped") {
            let entry = entry.expect("an entry");
            fs::copy(entry.path(), to.join(entry.file_name())).expect("copied");
        }
    }
    let mut modules = String::from("[[modules]]\nname = \"simulator\"\n");
    for driver in ["driver_power", "driver_rs485a"] {
        modules += &format!("[[modules]]\nname = \"{driver}\"\ndepends = [\"simulator\"]\ncritical = true\n");
    }
    for (name, line) in foreign {
        modules += &format!("[[modules]]\nname = {name:?}\ncommand = {:?}\nargs = {:?}\n", line[0], &line[1..]);
    }
    fs::write(advee.join("modules.toml"), modules).expect("written");
}
