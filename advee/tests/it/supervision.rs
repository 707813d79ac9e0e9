//! No hang is undetected and no process is left over: the watchdog, its parent and the guards of both, on real
//! processes.

#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use crate::support::{self, Robot, View};
use base::Fault;
use messages::{Channel, Hold, Message, common};
use module::State;
use std::fs;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const MODULES: [&str; 11] = [
    "simulator",
    "logger",
    "driver_power",
    "driver_rs485a",
    "driver_rs485b",
    "estimator",
    "guard",
    "driver_canbus",
    "driver_joydev",
    "driver_aux",
    "planner",
];

/// Maximum time from a hang or a death to the stop, s.
pub const STOP_S: f64 = 0.3;

/// Robot with all modules in RUN; its steering need not be homed.
fn running(extra: &[&str]) -> Robot {
    let mut robot = Robot::start(extra);
    robot.until("all modules RUN", 10.0, |view| view.processes.len() == MODULES.len() && view.all_run());
    robot
}

pub fn find(robot: &Robot, words: &str) -> Option<i32> {
    let is_it = |pid: &u32| {
        let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        String::from_utf8_lossy(&line).contains(words)
    };
    robot.processes().into_iter().find(is_it).map(|pid| pid as i32)
}

fn up(robot: &Robot) -> i32 {
    find(robot, "\0up\0").expect("advee up runs")
}

pub fn watchdog(robot: &Robot) -> i32 {
    find(robot, "\0run\0watchdog\0").expect("the watchdog runs")
}

fn pids(robot: &Robot) -> Vec<i32> {
    MODULES.map(|module| robot.view.pid(module)).into()
}

#[track_caller]
fn gone_within(robot: &Robot, seconds: f64) {
    let begin = Instant::now();
    while !robot.processes().is_empty() {
        assert!(begin.elapsed().as_secs_f64() < seconds, "left over: {:?}", robot.processes());
        std::thread::sleep(Duration::from_millis(10));
    }
    println!("all gone after {:.2} s", begin.elapsed().as_secs_f64());
}

pub fn reported(robot: &Robot, fault: Fault) -> Vec<String> {
    let of_it = robot.view.errors.iter().filter(|error| error.number == fault as i32);
    of_it.map(|error| error.message.clone()).collect()
}

/// Copy of the configuration, with `head` before the content of `modules.toml`.
struct Conf(PathBuf);

impl Conf {
    fn new(name: &str, head: &str) -> Self {
        let path = std::env::temp_dir().join(format!("advee-conf-{name}-{}", std::process::id()));
        let from = support::workspace().join("conf");
        for folder in ["advee", "worlds"] {
            fs::create_dir_all(path.join(folder)).unwrap();
            for entry in fs::read_dir(from.join(folder)).unwrap().map(Result::unwrap) {
                fs::copy(entry.path(), path.join(folder).join(entry.file_name())).unwrap();
            }
        }
        let conf = Self(path);
        conf.change(|text| format!("{head}\n{text}"));
        conf
    }

    fn folder(&self) -> PathBuf {
        self.0.join("advee")
    }

    fn change(&self, change: impl FnOnce(String) -> String) {
        let path = self.folder().join("modules.toml");
        fs::write(&path, change(fs::read_to_string(&path).unwrap())).unwrap();
    }
}

impl Drop for Conf {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[test]
fn each_stopped_module_is_killed_and_restarted() {
    support::undisturbed(|| {
        let mut robot = running(&[]);
        for module in MODULES {
            // The logger may be busy for longer: within its beat_timeout of 1.5 s its announcement may be missed first.
            let (most, sign) = if module == "logger" { (4.0, "") } else { (STOP_S, "its thread main") };
            support::within(&format!("a hang of {module} is found"), Duration::from_secs_f64(most), || {
                robot.until("all run", 5.0, support::View::all_run);
                let old = robot.view.pid(module);
                support::signal(old, "STOP");
                robot.until("it is ended", 4.0, |view| view.processes[module].phase != common::Process::RUNNING)
            });
            robot.until("it is back", 5.0, |view| view.runs(module));
            let hung = reported(&robot, Fault::ModuleHung);
            assert!(hung.iter().any(|why| why.starts_with(&format!("{module} hangs, {sign}"))), "{hung:?}");
            robot.until("all run", 5.0, support::View::all_run);
        }
        assert_eq!(robot.stop(), 0);
    });
}

#[test]
fn a_critical_module_that_hangs_or_dies_stops_a_driving_robot_within_300_ms() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        for (signal, what) in [("STOP", "from a hang to the stop"), ("KILL", "from a death to the stop")] {
            support::within(what, Duration::from_secs_f64(STOP_S), || {
                robot.until("all run", 10.0, support::View::all_run);
                let mut driver = robot.spawn(&["drive", "0.3", "0.4", "--for", "20"]);
                robot.until("it drives", 15.0, |view| view.speed() > 0.2 && view.is_free());
                support::signal(robot.view.pid("driver_rs485a"), signal);
                // The driver of the drives publishes its causes at once when they change.
                let stop = robot.until("a stop", 4.0, |view| !view.is_free());
                assert!(robot.view.causes().contains(&Hold::CriticalModule), "{:?}", robot.view.causes());
                robot.until("it stands", 3.0, |view| view.speed().abs() < 0.001);
                let _ = driver.kill();
                let _ = driver.wait();
                stop
            });
        }
        assert_eq!(robot.stop(), 0);
    });
}

#[test]
fn a_watchdog_killed_repeatedly_loses_no_module() {
    support::undisturbed(|| {
        let mut robot = running(&[]);
        let modules = pids(&robot);
        for _ in 0..5 {
            let old = watchdog(&robot);
            support::signal(old, "KILL");
            let begin = Instant::now();
            while find(&robot, "\0run\0watchdog\0").is_none_or(|pid| pid == old) {
                assert!(begin.elapsed() < Duration::from_secs(3), "no new watchdog");
                std::thread::sleep(Duration::from_millis(5));
            }
            robot.pass(0.3);
        }
        robot.until("the last one has heard of all", 5.0, support::View::all_run);
        assert_eq!(pids(&robot), modules);
        // An adopted process is like any other: its end is detected, and it is restarted.
        support::signal(modules[2], "KILL");
        robot.until("it is back", 3.0, |view| view.runs(MODULES[2]) && view.pid(MODULES[2]) != modules[2]);
        assert_eq!(robot.view.processes[MODULES[2]].last_exit, 128 + 9);
        assert_eq!(robot.stop(), 0);
        assert!(robot.processes().is_empty() && !robot.run_dir.exists());
    });
}

#[test]
fn a_watchdog_that_hangs_is_replaced_and_its_modules_live_on() {
    support::undisturbed(|| {
        let mut robot = running(&[]);
        let (modules, old) = (pids(&robot), watchdog(&robot));
        support::signal(old, "STOP");
        let begin = Instant::now();
        while find(&robot, "\0run\0watchdog\0").is_none_or(|pid| pid == old) {
            assert!(begin.elapsed() < Duration::from_secs(3), "no new watchdog");
            std::thread::sleep(Duration::from_millis(5));
        }
        println!("there was a new one after {} ms", begin.elapsed().as_millis());
        robot.pass(0.2);
        robot.until("the new one has heard of all", 5.0, support::View::all_run);
        assert_eq!(pids(&robot), modules);
    });
}

#[test]
fn no_process_is_left_whatever_is_killed_in_any_order() {
    support::undisturbed(|| {
        for order in [["watchdog", "up"], ["up", "watchdog"], ["frozen up", "watchdog"]] {
            let robot = running(&[]);
            let (parent, child) = (up(&robot), watchdog(&robot));
            for who in order {
                match who {
                    "up" => support::signal(parent, "KILL"),
                    "watchdog" => support::signal(child, "KILL"),
                    _ => support::signal(parent, "STOP"),
                }
            }
            if order[0] == "frozen up" {
                std::thread::sleep(Duration::from_secs(5));
                let left: Vec<_> = robot.processes().into_iter().filter(|pid| *pid as i32 != parent).collect();
                assert!(left.is_empty(), "left over: {left:?}");
                support::signal(parent, "KILL");
            }
            gone_within(&robot, 5.0);
        }
    });
}

#[test]
fn a_hung_module_ends_even_if_all_its_guards_are_killed() {
    support::undisturbed(|| {
        for how in ["STOP", "a program that knows nothing of us", "both"] {
            let extra =
                ["--set", "modules.driver_rs485b.command=\"sleep\"", "--set", "modules.driver_rs485b.args=[\"100\"]"];
            let mut robot = Robot::start(if how == "STOP" { &[] } else { &extra });
            robot.until("it runs", 10.0, |view| {
                view.runs("driver_canbus") && view.processes["driver_rs485b"].phase == common::Process::RUNNING
            });
            let (module, up) = (robot.view.pid("driver_rs485b"), up(&robot));
            let begin = Instant::now();
            if how != "a program that knows nothing of us" {
                support::signal(module, "STOP");
                // The kernel does not notice a process that is stopped after its guards have ended.
                let stopped =
                    || fs::read_to_string(format!("/proc/{module}/stat")).is_ok_and(|stat| stat.contains(") T "));
                while !stopped() && begin.elapsed() < Duration::from_secs(5) {
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
            support::signal(up, "KILL");
            while fs::read_to_string(format!("/proc/{module}/stat")).is_ok_and(|stat| !stat.contains(") Z ")) {
                assert!(begin.elapsed() < Duration::from_secs(5), "{how}: it is left over");
                std::thread::sleep(Duration::from_millis(10));
            }
            println!("{how}: ended after {:.2} s", begin.elapsed().as_secs_f64());
            gone_within(&robot, 5.0);
        }
    });
}

#[test]
fn a_foreign_program_is_supervised_like_a_module() {
    support::undisturbed(|| {
        let extra =
            ["--set", "modules.driver_rs485b.command=\"sleep\"", "--set", "modules.driver_rs485b.args=[\"100\"]"];
        let mut robot = Robot::start(&extra);
        let is_running = |view: &support::View| {
            view.processes.get("driver_rs485b").is_some_and(|process| process.phase == common::Process::RUNNING)
        };
        robot.until("it runs", 5.0, is_running);
        let first = robot.view.pid("driver_rs485b");
        support::signal(first, "KILL");
        robot.until("it runs again", 2.0, |view| is_running(view) && view.pid("driver_rs485b") != first);
        assert_eq!(
            robot.view.processes["driver_rs485b"].last_exit,
            128 + 9,
            "whoever waits for it, how it ended is seen"
        );
        let second = robot.view.pid("driver_rs485b");
        robot.until("it has not announced itself", 4.0, |view| view.pid("driver_rs485b") != second && is_running(view));
        assert!(
            reported(&robot, Fault::ModuleHung)
                .iter()
                .any(|why| why.starts_with("driver_rs485b hangs, it has not announced"))
        );
        assert_eq!(robot.stop(), 0);
    });
}

fn end(up: &mut Child) {
    support::signal(up.id() as i32, "TERM");
    assert!(up.wait().unwrap().success());
}

#[test]
fn the_next_start_adopts_running_modules_and_keeps_their_wanted_states() {
    support::undisturbed(|| {
        // The same command line for both instances: processes started with another are not adopted.
        let mut robot = running(&[]);
        assert!(robot.advee(&["state", "driver_rs485b", "STOP"]).status.success());
        assert!(robot.advee(&["state", "driver_rs485a", "TERMINATE"]).status.success());
        let wanted = |view: &support::View| {
            view.processes["driver_rs485b"].state == State::Stop as i8
                && view.processes["driver_rs485a"].phase == common::Process::TERMINATED
        };
        robot.until("they obey", 3.0, wanted);
        let (power, beacons) = (robot.view.pid("driver_power"), robot.view.pid("driver_rs485b"));
        let old = up(&robot);
        let first = fs::read(format!("/proc/{old}/cmdline")).unwrap();
        support::signal(old, "KILL");
        while robot.processes().contains(&(old as u32)) {
            std::thread::sleep(Duration::from_millis(1));
        }
        robot.view.processes.clear();
        let words: Vec<String> = first
            .split(|byte| *byte == 0)
            .map(|word| String::from_utf8_lossy(word).into_owned())
            .filter(|word| !word.is_empty())
            .collect();
        let mut next = Command::new(&words[0])
            .current_dir(support::workspace())
            .args(&words[1..])
            .stdin(Stdio::null())
            .spawn()
            .unwrap();
        robot.until("it knows them", 5.0, |view| !view.processes.is_empty() && wanted(view));
        assert_eq!((robot.view.pid("driver_power"), robot.view.pid("driver_rs485b")), (power, beacons));
        // After a restart it is in the state that an operator commanded.
        support::signal(beacons, "KILL");
        robot.until("it is back", 3.0, |view| view.pid("driver_rs485b") != beacons && wanted(view));
        end(&mut next);
        gone_within(&robot, 1.0);
    });
}

#[test]
fn a_record_of_reused_process_ids_harms_no_process() {
    support::undisturbed(|| {
        let nobody = Robot::start(&["--no-such-option"]);
        let (url, run_dir) = (nobody.url.clone(), nobody.run_dir.with_extension("stale"));
        let mut bystander = Command::new("sleep").arg("60").spawn().unwrap();
        let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap();
        let stat = fs::read_to_string(format!("/proc/{}/stat", bystander.id())).unwrap();
        let start: u64 = stat.rsplit(')').next().unwrap().split_whitespace().nth(19).unwrap().parse().unwrap();
        let record = |modules: &str| {
            let text = format!("advee processes 1\nboot {}\n{modules}", boot.trim());
            fs::create_dir_all(&run_dir).unwrap();
            fs::write(run_dir.join("processes"), text).unwrap();
        };
        for start in [start, start + 1] {
            record(&format!("driver_power {0} {start} RUN\nof_old {0} {start} RUN\n", bystander.id()));
            let mut bus = support::listen(&url);
            let mut up = support::advee(&url, &run_dir).args(["up", "--sim", "--headless"]).spawn().unwrap();
            let begin = Instant::now();
            let mut runs = false;
            while !runs {
                assert!(begin.elapsed() < Duration::from_secs(10), "it does not run");
                bus.wait(Duration::from_millis(50)).unwrap();
                while let Some(received) = bus.recv().unwrap() {
                    let Some(Channel::CmDataProcesses) = Channel::from_name(received.channel) else { continue };
                    let Ok(Message::CmDataProcesses(list)) =
                        Message::decode(Channel::CmDataProcesses, received.payload)
                    else {
                        continue;
                    };
                    assert!(list.processes.iter().all(|process| process.pid != bystander.id() as i32));
                    runs = list.processes.iter().all(|process| process.state == State::Run as i8);
                }
            }
            end(&mut up);
            assert!(bystander.try_wait().unwrap().is_none(), "it was left alone");
        }
        bystander.kill().unwrap();
        bystander.wait().unwrap();
    });
}

#[test]
fn a_module_that_is_no_longer_listed_is_ended_by_the_next_watchdog() {
    support::undisturbed(|| {
        let conf = Conf::new("listed", "");
        let mut robot = running(&["--config", conf.folder().to_str().unwrap()]);
        let old = robot.view.pid("driver_rs485b");
        conf.change(|text| {
            let entries: Vec<&str> =
                text.split("[[modules]]").filter(|entry| !entry.contains("driver_rs485b")).collect();
            entries.join("[[modules]]")
        });
        support::signal(watchdog(&robot), "KILL");
        robot.pass(0.2);
        robot.until("the others run", 5.0, |view| view.processes.len() == MODULES.len() - 1 && view.all_run());
        assert!(!robot.processes().contains(&(old as u32)));
        assert_eq!(robot.stop(), 0);
    });
}

#[test]
fn a_module_lives_within_its_limits() {
    support::undisturbed(|| {
        let limits = ["nice=7", "cpus=[0]", "memory_max=200e6"].map(|limit| format!("modules.driver_rs485b.{limit}"));
        let robot = running(&limits.iter().flat_map(|limit| ["--set", limit]).collect::<Vec<_>>());
        let read =
            |file: &str| fs::read_to_string(format!("/proc/{}/{file}", robot.view.pid("driver_rs485b"))).unwrap();
        assert_eq!(read("stat").rsplit(')').next().unwrap().split_whitespace().nth(16), Some("7"));
        let line = |text: String, begin: &str| text.lines().find(|line| line.starts_with(begin)).unwrap().to_string();
        assert_eq!(line(read("status"), "Cpus_allowed_list"), "Cpus_allowed_list:\t0");
        let data = line(read("limits"), "Max data size");
        // If a cgroup limits the memory, no other limit is needed.
        assert!(data.contains("200000000") || data.contains("unlimited"), "{data}");
    });
}

#[test]
fn restarts_are_reported_once_and_a_missing_executable_by_name_and_reason() {
    support::undisturbed(|| {
        let extra =
            ["--set", "modules.driver_rs485b.command=\"false\"", "--set", "modules.driver_power.command=\"/no/such\""];
        let mut robot = Robot::start(&extra);
        robot.until("it storms", 10.0, |view| {
            view.errors.iter().any(|error| error.number == Fault::RestartStorm as i32)
        });
        robot.pass(3.0);
        let died = reported(&robot, Fault::ModuleDied);
        assert_eq!(died.len(), 1, "{died:?}");
        assert_eq!(reported(&robot, Fault::RestartStorm).len(), 1);
        let why = reported(&robot, Fault::ModuleUnstartable);
        assert!(why.len() == 1 && why[0].contains("/no/such: No such file or directory"), "{why:?}");
        assert!(robot.view.processes["driver_rs485b"].restarts >= 5);
        assert!(robot.view.runs("driver_rs485a"), "nothing else is harmed");
    });
}

#[test]
fn an_announcement_under_another_s_name_is_reported_and_harms_no_module() {
    support::undisturbed(|| {
        let mut robot = running(&[]);
        assert!(robot.advee(&["state", "driver_rs485b", "TERMINATE"]).status.success());
        robot.until("it is down", 3.0, |view| view.processes["driver_rs485b"].phase == common::Process::TERMINATED);
        for _ in 0..15 {
            let (module, state) = ("driver_rs485b".into(), State::Run as i8);
            robot.publish(common::DataState { timestamp: 0, module, state });
            robot.pass(0.1);
        }
        assert_eq!(
            reported(&robot, Fault::NameClaimed),
            ["driver_rs485b RUN is announced, but its process does not run"]
        );
        assert_eq!(robot.view.processes["driver_rs485b"].phase, common::Process::TERMINATED);
    });
}

#[test]
fn that_a_module_works_is_believed_from_its_own_process_alone() {
    let mut robot = running(&[]);
    assert!(robot.advee(&["state", "driver_rs485b", "STOP"]).status.success());
    let state = |view: &View| view.processes["driver_rs485b"].state;
    robot.until("it is in STOP", 3.0, |view| state(view) == common::DataState::STOP);
    let announce = |robot: &mut Robot, state: State| {
        let module = "driver_rs485b".into();
        robot.publish(common::DataState { timestamp: 0, module, state: state as i8 });
    };
    for _ in 0..15 {
        announce(&mut robot, State::Run);
        robot.pass(0.1);
        assert_eq!(state(&robot.view), common::DataState::STOP);
    }
    let refused = reported(&robot, Fault::SenderRefused);
    assert!(refused.len() == 1 && refused[0].starts_with("CM_DATA_STATE dropped: process "), "{refused:?}");
    // What makes it worse is believed, until the module announces itself.
    announce(&mut robot, State::Error);
    robot.until("it is in ERROR", 1.0, |view| state(view) == common::DataState::ERROR);
    robot.until("it is in STOP again", 3.0, |view| state(view) == common::DataState::STOP);
}

/// Notifications of `advee up` to the service manager within a time.
fn notified(name: &str, extra: &[&str], seconds: f64) -> (Vec<String>, bool) {
    let address = SocketAddr::from_abstract_name(name).unwrap();
    let manager = UnixDatagram::bind_addr(&address).unwrap();
    manager.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    let place = Robot::start(&["--no-such-option"]);
    let run_dir = place.run_dir.with_extension("notify");
    let mut up = support::advee(&place.url, &run_dir)
        .args(["up", "--sim", "--headless"])
        .args(extra)
        .envs([("NOTIFY_SOCKET", format!("@{name}")), ("WATCHDOG_USEC", "400000".into())])
        .spawn()
        .unwrap();
    let mut lines = Vec::new();
    let hear = |lines: &mut Vec<String>| {
        let mut text = [0; 1000];
        if let Ok(length) = manager.recv(&mut text) {
            lines.extend(String::from_utf8_lossy(&text[..length]).lines().map(ToString::to_string));
        }
    };
    let begin = Instant::now();
    while begin.elapsed().as_secs_f64() < seconds {
        hear(&mut lines);
    }
    support::signal(up.id() as i32, "TERM");
    let fine = up.wait().unwrap().success();
    hear(&mut lines);
    (lines, fine)
}

#[test]
fn the_service_manager_is_notified_while_all_critical_modules_are_healthy() {
    support::undisturbed(|| {
        let (lines, fine) = notified(&format!("advee-well-{}", std::process::id()), &[], 4.0);
        let count = |word: &str| lines.iter().filter(|line| *line == word).count();
        assert!(fine && count("READY=1") == 1 && count("STOPPING=1") == 1, "{lines:?}");
        assert!(lines.iter().any(|line| *line == format!("STATUS={0} of {0} modules RUN", MODULES.len())), "{lines:?}");
        // At least every 400 ms, four times as often in practice.
        assert!((8..=40).contains(&count("WATCHDOG=1")), "{}", count("WATCHDOG=1"));

        let ill = ["--set", "modules.driver_power.command=\"/no/such\""];
        let (lines, fine) = notified(&format!("advee-ill-{}", std::process::id()), &ill, 2.0);
        let has = |word: &str| lines.iter().any(|line| line == word);
        assert!(fine && !has("READY=1") && !has("WATCHDOG=1"), "{lines:?}");
        assert!(has("STATUS=driver_power does not run"), "{lines:?}");
    });
}

#[test]
fn the_hardware_watchdog_is_fed_and_disarmed_by_a_clean_end_alone() {
    support::undisturbed(|| {
        let device = std::env::temp_dir().join(format!("advee-fake-watchdog-{}", std::process::id()));
        let conf = Conf::new("hardware", &format!("hardware_watchdog = {device:?}\nhardware_watchdog_timeout_s = 3"));
        let conf = conf.folder();
        let fed = |device: &Path| fs::read(device).unwrap();

        fs::write(&device, "").unwrap();
        let mut robot = running(&["--config", conf.to_str().unwrap()]);
        robot.pass(2.5);
        let count = fed(&device).len();
        assert!((2..=5).contains(&count) && fed(&device).iter().all(|byte| *byte == 0), "{:?}", fed(&device));
        // Nothing confirms the critical modules any more.
        support::signal(watchdog(&robot), "STOP");
        support::signal(up(&robot), "STOP");
        robot.pass(1.0);
        let count = fed(&device).len();
        robot.pass(1.5);
        assert_eq!(fed(&device).len(), count);
        support::signal(up(&robot), "CONT");
        robot.pass(0.5);
        robot.until("all run", 5.0, support::View::all_run);
        robot.pass(1.2);
        assert!(fed(&device).len() > count);
        assert_eq!(robot.stop(), 0);
        assert_eq!(fed(&device).last(), Some(&b'V'));

        fs::write(&device, "").unwrap();
        let mut robot = running(&["--config", conf.to_str().unwrap()]);
        robot.pass(1.5);
        support::signal(up(&robot), "KILL");
        gone_within(&robot, 5.0);
        assert!(!fed(&device).is_empty() && !fed(&device).contains(&b'V'), "it goes on counting");
        fs::remove_file(&device).unwrap();
    });
}

#[test]
fn cron_starts_a_robot_that_does_not_run_and_leaves_one_that_does() {
    support::undisturbed(|| {
        let mut robot = Robot::start(&["--no-such-option"]);
        let home = robot.run_dir.with_extension("home");
        for folder in ["bin", "conf"] {
            fs::create_dir_all(home.join(folder)).unwrap();
        }
        std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_advee"), home.join("bin/advee")).unwrap();
        let guard = || {
            let status = Command::new("sh")
                .arg(support::workspace().join("packaging/cron/advee-guard"))
                .current_dir(support::workspace())
                .env("ADVEE_HOME", &home)
                .env("ADVEE_RUN", &robot.run_dir)
                .env("ADVEE_ARGS", "--sim")
                .env("LCM_DEFAULT_URL", &robot.url)
                .status()
                .unwrap();
            assert!(status.success());
        };
        let log = || fs::read_to_string(home.join("log/guard.log")).unwrap_or_default();
        fs::write(home.join("conf/off"), "").unwrap();
        guard();
        assert_eq!(log(), "", "it is held off");
        fs::remove_file(home.join("conf/off")).unwrap();
        guard();
        let begin = Instant::now();
        while find(&robot, "\0up\0").is_none() || !robot.run_dir.join("processes").exists() {
            assert!(begin.elapsed() < Duration::from_secs(5), "it does not start");
            std::thread::sleep(Duration::from_millis(10));
        }
        let first = up(&robot);
        guard();
        assert_eq!(log().lines().count(), 1, "one that runs is left alone: {}", log());
        support::signal(first, "KILL");
        gone_within(&robot, 5.0);
        guard();
        robot.until("it runs again", 10.0, support::View::all_run);
        assert_eq!(log().lines().count(), 2);
        support::signal(up(&robot), "TERM");
        gone_within(&robot, 8.0);
        fs::remove_dir_all(&home).unwrap();
    });
}

#[test]
fn cron_s_script_passes_its_arguments_and_is_headless_unless_they_have_a_server() {
    let home = std::env::temp_dir().join(format!("advee-guard-words-{}", std::process::id()));
    fs::create_dir_all(home.join("bin")).unwrap();
    let called = home.join("called");
    // In place of the executable: one that records its arguments, a line for each.
    let program = home.join("bin/advee");
    fs::write(&program, "#!/bin/sh\nprintf '%s\\n' \"$@\" >\"$0.new\"\nmv \"$0.new\" \"$CALLED\"\n").unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let run = home.join("run");
    let start = ["up", "--run-dir", run.to_str().unwrap()];
    let cases: [(Option<&str>, &[&str], &[&str]); 8] = [
        (None, &[], &["--headless"]),
        (Some(""), &[], &["--headless"]),
        (Some("--sim --goal none"), &[], &["--headless", "--sim", "--goal", "none"]),
        (None, &["--sim", "--set", "a.b=\"c d\""], &["--headless", "--sim", "--set", "a.b=\"c d\""]),
        (None, &["--http", "127.0.0.1:8080"], &["--http", "127.0.0.1:8080"]),
        (Some("--sim"), &["--http=[::1]:80"], &["--sim", "--http=[::1]:80"]),
        (Some("--http 127.0.0.1:80"), &["--sim"], &["--http", "127.0.0.1:80", "--sim"]),
        (Some("--headless"), &["--force"], &["--headless", "--force"]),
    ];
    for (variable, arguments, expected) in cases {
        let _ = fs::remove_file(&called);
        let mut script = Command::new("sh");
        script.arg(support::workspace().join("packaging/cron/advee-guard")).args(arguments);
        script.env("ADVEE_HOME", &home).env("ADVEE_RUN", &run).env("CALLED", &called).env_remove("ADVEE_ARGS");
        script.envs(variable.map(|words| ("ADVEE_ARGS", words)));
        assert!(script.status().unwrap().success());
        let begin = Instant::now();
        while !called.exists() {
            assert!(begin.elapsed() < Duration::from_secs(10), "it does not start with {arguments:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
        let told = fs::read_to_string(&called).unwrap();
        assert_eq!(told.lines().collect::<Vec<_>>(), [&start[..], expected].concat(), "{variable:?} {arguments:?}");
    }
    fs::remove_dir_all(&home).unwrap();
}
