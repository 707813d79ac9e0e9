//! The robot runs as one user and its web server as another, as installed: with real processes of both.

#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use crate::operator;
use crate::page::free;
use crate::support::{self, Robot};
use base::Fault;
use messages::common;
use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use testing::{GROUP, USERS};

/// Users of the robot, of its web server, and of neither.
const ROBOT: u32 = USERS[0];
const WEB: u32 = USERS[1];
const OTHER: u32 = USERS[2];

/// A folder of a user.
fn folder(path: &Path, user: u32, mode: u32) {
    fs::create_dir_all(path).unwrap();
    chown(path, Some(user), Some(GROUP)).unwrap();
    fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
}

/// The keeper of the web server.
struct Keeper {
    process: Child,
    folder: PathBuf,
}

impl Keeper {
    fn start(folder: &Path) -> Self {
        self::folder(folder, WEB, 0o750);
        let mut command = Command::new(env!("CARGO_BIN_EXE_advee"));
        command.current_dir(support::workspace()).args(["keep", "web", "--robot", &ROBOT.to_string(), "--folder"]);
        let process = command.arg(folder).uid(WEB).gid(GROUP).stdin(Stdio::null()).spawn().unwrap();
        Self { process, folder: folder.into() }
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = fs::remove_dir_all(&self.folder);
    }
}

fn user_of(pid: i32) -> u32 {
    fs::metadata(format!("/proc/{pid}")).unwrap().uid()
}

/// Owners of the places in shared memory of this robot's bus, and the modes of the folder.
fn places(robot: &Robot) -> (u32, Vec<u32>) {
    let end = format!("-{}", robot.port);
    let mut folders = fs::read_dir("/dev/shm").unwrap().flatten().map(|entry| entry.path());
    let folder = folders.find(|path| {
        path.to_str().is_some_and(|name| name.ends_with(&end)) && fs::metadata(path).is_ok_and(|it| it.uid() == ROBOT)
    });
    let folder = folder.expect("the robot shares memory");
    let files = fs::read_dir(&folder).unwrap().flatten().map(|entry| entry.path());
    let stations = files.filter(|path| path.extension().is_some_and(|kind| kind == "station"));
    (fs::metadata(&folder).unwrap().mode() & 0o7777, stations.map(|path| fs::metadata(path).unwrap().uid()).collect())
}

#[test]
fn the_web_server_of_another_user_is_guarded_adopted_and_commands_and_a_stranger_does_not() {
    if testing::machine_or_skip(testing::users()).is_none() {
        return;
    }
    let at = free();
    let mut keeper = None;
    let extra = ["--http", &at.to_string(), "--set", "bus.commands=\"memory\""];
    let mut robot = Robot::start_with(0, &extra, |up, run_dir| {
        let kept = run_dir.with_extension("web");
        folder(run_dir, ROBOT, 0o755);
        folder(&support::logs(run_dir), ROBOT, 0o750);
        up.uid(ROBOT).gid(GROUP).env(host::keepers::VARIABLE, format!("web={}", kept.display()));
        keeper = Some(Keeper::start(&kept));
    });
    let is_ready = |view: &support::View| view.processes.len() == 12 && view.all_run() && view.is_homed();
    robot.until("all modules RUN, and the steering homed", 30.0, is_ready);
    let (web, watchdog) = (robot.view.pid("web"), super::supervision::watchdog(&robot));
    assert_eq!(["web", "driver_canbus"].map(|name| user_of(robot.view.pid(name))), [WEB, ROBOT]);
    let (mode, owners) = places(&robot);
    assert_eq!(mode, 0o1770);
    assert!(owners.contains(&WEB) && owners.contains(&ROBOT), "{owners:?}");
    // An operator pairs; the web server's Stop is obeyed, and so are users that may command through shared memory.
    let code = serde_json::from_slice::<serde_json::Value>(&robot.advee(&["web", "code", "--json"]).stdout).unwrap();
    let pair = serde_json::json!({ "code": code["operator"], "name": "test" });
    let cookie = operator::post(at, "/api/pair", "", &pair).cookie();
    assert!(!cookie.is_empty());
    // A new watchdog adopts it.
    support::signal(watchdog, "KILL");
    robot.until("a new watchdog", 5.0, |view| view.processes.values().all(|row| row.restarts == 0) && view.all_run());
    while super::supervision::find(&robot, "\0run\0watchdog\0").is_none_or(|pid| pid == watchdog) {
        robot.pass(0.02);
    }
    robot.pass(0.5);
    robot.until("all modules RUN", 5.0, support::View::all_run);
    assert_eq!(robot.view.pid("web"), web, "it goes on under the new watchdog");
    // A hang is found by its heartbeats, and a new process takes its place.
    let most = std::time::Duration::from_secs_f64(super::supervision::STOP_S);
    support::within("a hang of the web server of another user is found", most, || {
        robot.until("all modules RUN", 5.0, support::View::all_run);
        support::signal(robot.view.pid("web"), "STOP");
        robot.until("it is ended", 4.0, |view| view.processes["web"].phase != common::Process::RUNNING)
    });
    robot.until("it is back", 5.0, |view| view.runs("web") && view.pid("web") != web);
    let reports = super::supervision::reported(&robot, Fault::ModuleHung);
    assert!(reports.iter().any(|why| why.starts_with("web hangs, its thread ")), "{reports:?}");
    assert_eq!(user_of(robot.view.pid("web")), WEB);
    // Permission to drive: the web server's user has it, another user of the group does not, although its place in
    // memory is the same.
    let url = robot.url.replace("shm=auto", &format!("shm={ROBOT}"));
    let mut drive = |user: u32| {
        let mut command = support::advee(&url, &robot.run_dir);
        command.args(["drive", "0.1", "0", "--for", "1"]).uid(user).gid(GROUP).stdin(Stdio::null());
        let mut driver = command.stdout(Stdio::null()).spawn().unwrap();
        let mut moved = false;
        while driver.try_wait().unwrap().is_none() {
            robot.pass(0.05);
            moved |= robot.view.speed() > 0.01;
        }
        moved
    };
    assert!(!drive(OTHER), "a user of the group that the unit does not name");
    assert!(drive(WEB));
    let refused = super::supervision::reported(&robot, Fault::SenderRefused);
    assert!(refused.iter().any(|why| why.contains("LL_CMD_MOTION")), "{refused:?}");
    let web = robot.view.pid("web");
    assert_eq!(robot.stop(), 0);
    assert!(!Path::new(&format!("/proc/{web}")).exists(), "it ends with the robot");
    assert_eq!(keeper.as_mut().unwrap().process.try_wait().unwrap(), None, "its keeper waits for the next");
}
