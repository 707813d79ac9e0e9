//! The courier with its lidar on a line between two ports, as on a robot: the driver has one end, the simulator the
//! other. The line is interrupted and unplugged while the robot drives.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{self, Robot, View, signal};
use base::Fault;
use nix::errno::Errno;
use nix::fcntl::OFlag;
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
use nix::unistd::{read, write};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::Duration;

const MOVES: f64 = 0.1;
const STANDS: f64 = 0.01;

/// A pseudo-terminal, and a link to it in place of a device file's name.
struct End {
    master: PtyMaster,
    terminal: PathBuf,
}

impl End {
    fn at(link: &Path) -> Self {
        let master = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let mut settings = tcgetattr(&master).unwrap();
        cfmakeraw(&mut settings);
        tcsetattr(&master, SetArg::TCSANOW, &settings).unwrap();
        let terminal = PathBuf::from(ptsname_r(&master).unwrap());
        let _ = std::fs::remove_file(link);
        symlink(&terminal, link).unwrap();
        Self { master, terminal }
    }
}

/// A line between two ends, until dropped: the driver's, which may be unplugged, and the device's.
struct Cable {
    folder: PathBuf,
    driver: Arc<Mutex<Option<End>>>,
    /// The terminal of the device.
    device: PathBuf,
    /// Bytes are lost.
    cut: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Cable {
    fn new() -> Self {
        let folder = std::env::temp_dir().join(format!("advee-lidar-line-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let (plugged, right) = (End::at(&folder.join("port")), End::at(&folder.join("device")));
        let (device, driver) = (right.terminal.clone(), Arc::new(Mutex::new(Some(plugged))));
        let (cut, stop) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let (left, is_cut, ends) = (driver.clone(), cut.clone(), stop.clone());
        let thread = spawn(move || {
            while !ends.load(Ordering::Relaxed) {
                let lost = is_cut.load(Ordering::Relaxed);
                {
                    let left = left.lock().unwrap();
                    let left = left.as_ref().map(|end| &end.master).filter(|_| !lost);
                    pass(Some(&right.master), left);
                    pass(left, Some(&right.master));
                }
                sleep(Duration::from_millis(1));
            }
        });
        Self { folder, driver, device, cut, stop, thread: Some(thread) }
    }

    fn path(&self, end: &str) -> String {
        self.folder.join(end).display().to_string()
    }

    /// The terminal of the driver.
    fn plugged(&self) -> PathBuf {
        self.driver.lock().unwrap().as_ref().unwrap().terminal.clone()
    }

    fn unplug(&self) {
        std::fs::remove_file(self.folder.join("port")).unwrap();
        *self.driver.lock().unwrap() = None;
    }

    /// The adapter returns, under the same name, and perhaps another number.
    fn plug(&self) {
        *self.driver.lock().unwrap() = Some(End::at(&self.folder.join("port")));
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// Transfers what one end has sent; without another end, or one whose buffer is full, it is lost.
fn pass(from: Option<&PtyMaster>, to: Option<&PtyMaster>) {
    let mut bytes = [0; 4096];
    let Some(from) = from else { return };
    // EIO: nobody has the terminal open.
    let length = match read(from, &mut bytes) {
        Ok(length) => length,
        Err(Errno::EAGAIN | Errno::EIO | Errno::EINTR) => return,
        Err(errno) => panic!("{errno}"),
    };
    if let Some(to) = to {
        let _ = write(to, &bytes[..length]);
    }
}

/// True if a process has the file open.
fn holds(pid: i32, file: &Path) -> bool {
    let open = std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap();
    open.filter_map(|entry| std::fs::read_link(entry.ok()?.path()).ok()).any(|target| target == file)
}

/// Number of reports that the lidar is lost, with `ended` that it measures again.
fn reports(view: &View, ended: bool) -> usize {
    let is_it = |error: &&messages::common::Error| {
        error.number == Fault::LidarLost as i32 && ended == (error.severity == messages::common::Error::NOTICE)
    };
    view.errors.iter().filter(is_it).count()
}

/// While it drives something happens to the line: it stops, and reports that the lidar is lost; afterwards it drives
/// on.
fn stops_while(robot: &mut Robot, begin: impl FnOnce(), end: impl FnOnce()) {
    robot.until("it drives", 20.0, |view| view.speed() > MOVES);
    let [lost, ended] = [false, true].map(|ended| reports(&robot.view, ended));
    begin();
    robot.until("it stands", 5.0, |view| view.speed().abs() < STANDS);
    robot.until("the loss is reported", 2.0, |view| reports(view, false) > lost);
    robot.pass(1.0);
    assert!(robot.view.speed().abs() < STANDS, "it moves without its lidar");
    assert_eq!(reports(&robot.view, true), ended);
    end();
    robot.until("it drives on", 10.0, |view| view.speed() > MOVES);
    robot.until("the end is reported", 2.0, |view| reports(view, true) == ended + 1);
}

#[test]
fn a_lidar_whose_line_is_cut_or_unplugged_stops_the_robot_until_it_is_back() {
    support::undisturbed(|| {
        let cable = Cable::new();
        let ends = [("port", "port"), ("simulated_at", "device")];
        let sets = ends.map(|(key, end)| format!("lidar.top.{key}={:?}", cable.path(end)));
        let mut robot = Robot::start(&["--config", "conf/courier", "--set", &sets[0], "--set", &sets[1]]);
        robot.until("all modules RUN", 30.0, View::all_run);
        robot.until("a scan", 10.0, |view| view.seen.contains_key("LL_DATA_SCAN"));
        let driver = robot.view.pid("driver_lidar");
        assert!(holds(driver, &cable.plugged()) && !holds(driver, &cable.device), "the driver's end");
        let simulator = robot.view.pid("simulator");
        assert!(holds(simulator, &cable.device) && !holds(simulator, &cable.plugged()), "the simulator's end");
        assert!(!robot.run_dir.join("lidar-top").exists(), "the simulator has another end, too");

        let mut drive = robot.spawn(&["--config", "conf/courier", "drive", "0.3", "--rotation", "0.3"]);
        let cut = |cut| cable.cut.store(cut, Ordering::Relaxed);
        stops_while(&mut robot, || cut(true), || cut(false));
        stops_while(&mut robot, || cable.unplug(), || cable.plug());
        assert_eq!((robot.view.pid("driver_lidar"), robot.view.pid("simulator")), (driver, simulator), "no restart");
        assert!(holds(driver, &cable.plugged()));
        signal(drive.id() as i32, "INT");
        assert!(drive.wait().unwrap().success());
        assert_eq!(robot.stop(), 0);
    });
}
