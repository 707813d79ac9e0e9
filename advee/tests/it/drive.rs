//! Main scenarios, live: `advee up --sim`, driven, harmed and ended, as from the shell.

use crate::support::{self, Robot};
use base::Fault;
use messages::{Hold, lowlevel};
use module::State;
use std::io::{BufRead, BufReader};
use std::process::Stdio;

const MOVES: f64 = 0.05;

#[test]
fn it_drives_as_commanded_and_ctrl_c_leaves_nothing() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        let start = robot.view.truth.clone().unwrap();
        let mut drive = robot.spawn(&["drive", "0.4", "0.1", "--for", "3"]);
        robot.until("the robot moves", 5.0, |view| view.speed() > 0.35);
        robot.until("the command has ended and the robot stands", 10.0, |view| view.speed().abs() < 0.01);
        assert!(drive.wait().unwrap().success());

        // 3 s at 0.4 m/s, minus the ramps of 0.5 m/s²; at 0.1 rad the yaw rate is 0.4 · tan(0.1) / 0.6.
        let end = robot.view.truth.clone().unwrap();
        let path = (end.x - start.x).hypot(end.y - start.y);
        let turn = end.theta - start.theta;
        assert!((0.7..1.3).contains(&path), "moved {path} m");
        assert!((0.10..0.25).contains(&turn), "turned {turn} rad");
        assert_eq!(end.collisions, 0);
        // The odometry agrees.
        let odo = robot.view.odo.clone().unwrap();
        assert!((odo.path - path).abs() < 0.1, "odometry {} m, truth {path} m", odo.path);

        let echo = robot.advee(&["lcm", "echo", "LL_DATA_ODO", "--for", "1"]);
        let text = String::from_utf8_lossy(&echo.stdout).into_owned();
        assert!(echo.status.success() && text.contains("LL_DATA_ODO") && text.contains("ticks_left="), "{text}");

        assert_eq!(robot.stop(), 0);
        assert!(robot.processes().is_empty(), "processes left over: {:?}", robot.processes());
        assert!(!robot.run_dir.exists(), "the run folder is left over");
    });
}

#[test]
fn a_second_command_to_drive_waits_for_the_first_one_and_drives_at_once_after_its_end() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        let mut first = robot.spawn(&["drive", "0.3", "0"]);
        robot.until("the robot moves", 5.0, |view| view.speed() > MOVES);
        let mut second = support::advee(&robot.url, &robot.run_dir);
        second.args(["drive", "0.3", "0", "--for", "1"]).stdout(Stdio::piped());
        let mut second = second.spawn().unwrap();
        let mut lines = BufReader::new(second.stdout.take().unwrap()).lines().map(Result::unwrap);
        let waiting = lines.next().unwrap();
        // Bus and programs have the name with the process, people the words for it.
        let source = robot.view.motion.as_ref().map_or("", |motion| &motion.source);
        assert!(source.starts_with("drive@") && source.ends_with(&format!(":{}", first.id())), "{source}");
        let words = Hold::OtherSource.words(source);
        assert!(words.starts_with("advee drive on ") && words.ends_with(" drives the robot"), "{words}");
        assert_eq!(waiting, format!("waiting, at most 20 s: {words}"));
        support::signal(first.id() as i32, "INT");
        assert!(first.wait().unwrap().success());
        // The cause may change while the first one stops.
        let lines = lines.filter(|line| !line.starts_with("waiting, "));
        assert_eq!(lines.collect::<Vec<_>>(), ["driving at 0.3 m/s, 0 rad", "the robot stands"]);
        assert!(second.wait().unwrap().success());
        // The last zero of the second one is still valid.
        let third = robot.advee(&["drive", "0.3", "0", "--for", "1"]);
        assert!(third.status.success(), "{}", String::from_utf8_lossy(&third.stderr));
    });
}

#[test]
fn silence_begins_a_quick_stop() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        robot.drive(0.4, 0.0, 1.5);
        assert!(robot.view.speed() > 0.35, "{}", robot.view.reason());
        // From here on there are no commands: a quick stop at 1.5 m/s² takes 0.27 s after the 0.25 s of the command's
        // validity.
        let stopping = robot.until("the quick stop begins", 1.0, |view| view.motion.as_ref().unwrap().quick_stop);
        assert!(stopping.as_millis() < 400, "begun after {stopping:?}");
        robot.until("the robot stands", 1.0, |view| view.speed().abs() < 0.01);
        assert_eq!(
            (robot.view.causes(), robot.view.reason()),
            (vec![Hold::NobodyCommands], "nobody commands the motion".into())
        );
    });
}

#[test]
fn the_death_of_a_critical_module_stops_the_robot_until_a_new_command() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        robot.drive(0.4, 0.0, 1.2);
        let pid = robot.view.pid("driver_rs485a");
        robot.kill("driver_rs485a");
        // The source continues unchanged: it must not move the robot when the module is back.
        robot.drive(0.4, 0.0, 1.5);
        assert!(robot.view.runs("driver_rs485a") && robot.view.pid("driver_rs485a") != pid, "it is back");
        assert!(robot.view.speed().abs() < MOVES, "it resumed by itself");
        assert_eq!(robot.view.causes(), [Hold::NotReleased], "{}", robot.view.reason());
        let critical = |error: &&messages::common::Error| error.number == Fault::CriticalModule as i32;
        assert_eq!(robot.view.errors.iter().filter(critical).count(), 2, "reported once, cleared once");
        robot.drive(0.0, 0.0, 0.2);
        robot.drive(0.4, 0.0, 1.2);
        assert!(robot.view.speed() > 0.35, "{}", robot.view.reason());
    });
}

#[test]
fn the_death_of_the_drives_driver_is_noticed_by_the_drives_themselves() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        robot.drive(0.4, 0.0, 1.2);
        robot.kill("driver_canbus");
        robot.until("the robot stands", 2.0, |view| view.speed().abs() < 0.01);
        robot.until("it is back and homed", 15.0, |view| view.runs("driver_canbus"));
        robot.view.motion = None;
        robot.until("the steering is homed again", 15.0, support::View::is_homed);
        robot.drive(0.0, 0.0, 0.2);
        robot.drive(0.4, 0.0, 1.2);
        assert!(robot.view.speed() > 0.35, "{}", robot.view.reason());
    });
}

/// Of modules that are not critical, and of which the motion needs nothing: without `driver_rs485a` the ranging boards
/// would be lost.
#[test]
fn the_death_of_any_other_module_does_not_stop_it() {
    const OTHERS: [&str; 2] = ["driver_rs485b", "driver_aux"];
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        robot.drive(0.4, 0.0, 1.2);
        let pids = OTHERS.map(|module| robot.view.pid(module));
        OTHERS.iter().for_each(|module| robot.kill(module));
        for _ in 0..40 {
            robot.drive(0.4, 0.0, 0.05);
            assert!(robot.view.speed() > 0.3, "{}", robot.view.reason());
        }
        for (module, pid) in OTHERS.into_iter().zip(pids) {
            robot.until("it is back", 10.0, |view| view.runs(module) && view.pid(module) != pid);
        }
    });
}

#[test]
fn a_watchdog_that_dies_is_followed_by_one_that_takes_its_modules_over() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        robot.drive(0.4, 0.0, 1.2);
        let pids = |robot: &Robot| -> Vec<_> {
            robot.view.processes.iter().map(|(name, process)| (name.clone(), process.pid)).collect()
        };
        let before = pids(&robot);
        let watchdog = robot.processes().into_iter().find(|pid| {
            std::fs::read(format!("/proc/{pid}/cmdline"))
                .is_ok_and(|line| String::from_utf8_lossy(&line).contains("run\0watchdog"))
        });
        support::signal(watchdog.expect("the watchdog runs") as i32, "KILL");
        robot.view.processes.clear();
        robot.view.motion = None;
        robot.until("all modules run again, homed", 20.0, |view| view.all_run() && view.is_homed());
        assert_eq!(pids(&robot), before, "the same processes, taken over");
        // No commands since.
        robot.until("it stands", 2.0, |view| view.speed().abs() < 0.01);
    });
}

#[test]
fn a_hung_module_is_killed_and_restarted() {
    let mut robot = Robot::ready(&[]);
    let pid = robot.view.pid("driver_canbus");
    robot.drive(0.4, 0.0, 1.2);
    support::signal(pid, "STOP");
    // The drives miss the master's heartbeat, the watchdog the module's.
    robot.until("the robot stands", 2.0, |view| view.speed().abs() < 0.01);
    robot.until("it is back", 6.0, |view| view.runs("driver_canbus") && view.pid("driver_canbus") != pid);
    let hung = |error: &messages::common::Error| error.number == Fault::ModuleHung as i32;
    assert!(robot.view.errors.iter().any(hung), "{:?}", robot.view.errors);
}

#[test]
fn a_module_follows_state_commands_and_keeps_its_state_after_a_restart() {
    let mut robot = Robot::ready(&[]);
    let done = robot.advee(&["state", "driver_rs485a", "STOP"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let stopped = |view: &support::View| view.processes["driver_rs485a"].state == State::Stop as i8;
    robot.until("STOP is shown", 2.0, stopped);
    let pid = robot.view.pid("driver_rs485a");
    robot.kill("driver_rs485a");
    robot.until("it is back, in STOP", 5.0, |view| stopped(view) && view.pid("driver_rs485a") != pid);
    let refused = robot.advee(&["state", "driver_rs485a", "INIT"]);
    assert!(!refused.status.success(), "INIT cannot be commanded");
    let table = robot.advee(&["state"]);
    let text = String::from_utf8_lossy(&table.stdout).into_owned();
    assert!(text.lines().any(|line| line.contains("driver_rs485a") && line.contains("STOP")), "{text}");
}

#[test]
fn what_the_guard_permits_is_told_in_the_shell_and_in_the_terminal() {
    let robot = Robot::ready(&["--set", "guard.ranging=\"sonar\""]);
    let said = |args: &[&str]| String::from_utf8_lossy(&robot.advee(args).stdout).into_owned();
    let table = said(&["state"]);
    let permits = |line: &str| line.contains("at most ") && line.contains(" m/s forward") || line.contains("must not");
    assert!(table.lines().any(|line| line.starts_with("GUARD            ") && permits(line)), "{table}");
    let alone = said(&["state", "driver_canbus"]);
    assert!(!alone.contains("GUARD"), "{alone}");
    let view = said(&["diag", "--once", "--view", "overview"]);
    assert!(view.lines().any(|line| line.contains("guard ") && permits(line)), "{view}");
}

#[test]
fn malformed_messages_are_reported_once_and_survived() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        let odo = lowlevel::DataOdo::default();
        let mut wrong = Vec::new();
        messages::Message::from(odo).encode(&mut wrong).unwrap();
        for _ in 0..50 {
            // An odometry message on the command's channel, a truncated command, a datagram that is not LCM at all.
            robot.bus.publish("LL_CMD_MOTION", &wrong).unwrap();
            robot.bus.publish("LL_CMD_MOTION", &wrong[..5]).unwrap();
            let socket = std::net::UdpSocket::bind("0.0.0.0:0").unwrap();
            socket.set_multicast_ttl_v4(0).unwrap();
            socket.send_to(b"nonsense", ("239.255.76.67", robot.port)).unwrap();
        }
        robot.drive(0.0, 0.0, 0.5);
        robot.drive(0.4, 0.0, 1.2);
        assert!(robot.view.speed() > 0.35, "{}", robot.view.reason());
        let reported = |module: &str, what: &str| {
            let malformed = robot.view.errors.iter().filter(|error| error.number == Fault::MessageMalformed as i32);
            malformed.filter(|error| error.module == module && error.message.contains(what)).count()
        };
        for what in ["fingerprint", "truncated"] {
            assert_eq!(reported("driver_canbus", what), 1, "{what}: once by cause: {:?}", robot.view.errors);
        }
        assert_eq!(reported("watchdog", "is not LCM's"), 1, "{:?}", robot.view.errors);

        for (speed, steering) in [(f64::NAN, 0.0), (9.0, 0.0), (0.4, 2.0)] {
            robot.drive(0.0, 0.0, 0.6);
            robot.drive(0.4, 0.0, 1.0);
            assert!(robot.view.speed() > 0.3, "{}", robot.view.reason());
            robot.view.errors.clear();
            robot.command(speed, steering);
            robot.until("the robot stands", 2.0, |view| view.speed().abs() < 0.01);
            let refused = |error: &&messages::common::Error| {
                error.number == Fault::MotionRefused as i32 && error.severity == messages::common::Error::ERROR
            };
            assert_eq!(robot.view.errors.iter().filter(refused).count(), 1);
        }
    });
}

#[test]
fn a_command_to_drive_releases_what_pause_has_latched() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        let pause = |robot: &mut Robot| {
            let pressed = robot.advee(&["fault", "psc1", "bumper", "2", "--for", "0.3"]);
            assert!(pressed.status.success(), "{pressed:?}");
            robot.until("it is open, and latched", 3.0, |view| view.causes().contains(&Hold::PauseLatched));
        };
        for command in [&["drive", "0.3", "0", "--for", "1"][..], &["goal", "5,6", "--when-ready"]] {
            pause(&mut robot);
            let mut released = robot.spawn(command);
            robot.until("the robot moves", 15.0, |view| view.speed() > MOVES);
            let status = released.wait().unwrap();
            assert!(status.success(), "{command:?}: {status}");
        }
        // What stops it on its way stays as it is.
        let mut drive = robot.spawn(&["drive", "0.3", "0", "--for", "4"]);
        robot.until("the robot moves", 15.0, |view| view.speed() > MOVES);
        pause(&mut robot);
        assert!(drive.wait().unwrap().success());
        assert!(robot.view.speed().abs() < 0.01 && robot.view.causes().contains(&Hold::PauseLatched));
    });
}

#[test]
fn a_goal_directly_after_a_command_to_drive_is_driven_to() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        let drove = robot.advee(&["drive", "0.3", "0", "--for", "1"]);
        assert!(drove.status.success(), "{drove:?}");
        let goal = robot.advee(&["goal", "5,6"]);
        assert!(goal.status.success(), "{goal:?}");
        // What was received meanwhile is of the drive.
        robot.pass(0.3);
        robot.until("the robot moves", 15.0, |view| view.speed().abs() > MOVES);
    });
}

#[test]
fn a_power_channel_is_switched_and_shown() {
    let robot = Robot::ready(&[]);
    let said = |args: &[&str]| {
        let output = robot.advee(args);
        (output.status.success(), String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned())
    };
    assert_eq!(said(&["power", "monitor", "off"]), (true, "monitor is off\n".into()));
    let shown = said(&["power", "monitor"]).1;
    assert!(shown.starts_with("monitor    off "), "{shown}");
    assert_eq!(said(&["power", "monitor", "reboot"]), (true, "monitor is on\n".into()));
    let json: serde_json::Value = serde_json::from_str(&said(&["power", "--json"]).1).unwrap();
    assert_eq!(json["channels"].as_array().map(Vec::len), Some(8));
    assert!(!said(&["power", "toaster", "on"]).0);
}
