//! A gamepad drives the simulated robot, live: that of the simulator, one played by the test, and one of the kernel if
//! available.

use crate::support::{self, Robot};
use base::Fault;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Child, Stdio};

const PAD: &str = "device Test's pad\naxis ABS_X -100 100 0 0 0\naxis ABS_Y -100 100 0 0 0\nbutton BTN_TL 0\nfound\n";

/// FIFO in place of a gamepad, written by the test.
struct Hand {
    path: PathBuf,
    fifo: Option<std::fs::File>,
}

impl Hand {
    fn new() -> Self {
        let path = std::env::temp_dir().join(format!("advee-gamepad-{}.fifo", std::process::id()));
        let _ = std::fs::remove_file(&path);
        nix::unistd::mkfifo(&path, nix::sys::stat::Mode::S_IRWXU).expect("a FIFO");
        Self { path, fifo: None }
    }

    fn setting(&self) -> String {
        format!("gamepad.device=\"file:{}\"", self.path.display())
    }

    fn plug(&mut self) {
        self.fifo = Some(OpenOptions::new().write(true).open(&self.path).expect("the driver listens"));
        self.say(PAD);
    }

    fn say(&mut self, lines: &str) {
        self.fifo.as_mut().expect("it is plugged in").write_all(lines.as_bytes()).expect("the driver listens");
    }

    fn unplug(&mut self) {
        self.fifo = None;
    }
}

impl Drop for Hand {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

fn moves(robot: &Robot) -> bool {
    robot.view.speed() > 0.2
}

#[track_caller]
fn stands(robot: &mut Robot, why: &str) {
    robot.until(why, 3.0, |view| view.speed().abs() < 0.01);
}

#[test]
fn a_stream_of_events_drives_the_robot_and_its_end_stops_it() {
    support::undisturbed(|| {
        let mut hand = Hand::new();
        let mut robot = Robot::ready(&["--set", &hand.setting()]);
        robot
            .until("it is told that there is none", 2.0, |view| view.joydev.as_ref().is_some_and(|pad| !pad.connected));
        hand.plug();
        robot.until("it is told", 2.0, |view| view.joydev.as_ref().is_some_and(|pad| pad.name == "Test's pad"));
        // Not without the dead-man button.
        hand.say("abs ABS_Y -100\nframe\n");
        robot.pass(0.5);
        assert!(!moves(&robot));
        hand.say("abs ABS_Y 0\nframe\nkey BTN_TL 1\nframe\nabs ABS_Y -100\nframe\n");
        robot.until("the gamepad moves the robot", 3.0, |view| view.speed() > 0.4);
        assert_eq!(robot.view.motion.as_ref().map(|motion| motion.source.as_str()), Some("gamepad"));
        let pad = robot.view.joydev.clone().expect("5 Hz");
        assert!(pad.connected && pad.dead_man && (pad.speed - 0.6).abs() < 1e-9, "{pad:?}");

        hand.say("key BTN_TL 0\nframe\n");
        stands(&mut robot, "let go");
        assert!(!robot.view.motion.as_ref().is_some_and(|motion| motion.quick_stop && motion.speed_target > 0.0));

        // The stick was not released: it must be, first.
        hand.say("key BTN_TL 1\nframe\n");
        robot.pass(1.0);
        assert!(robot.view.speed().abs() < 0.01);
        let waits = |error: &&messages::common::Error| error.number == Fault::GamepadNotReleased as i32;
        assert!(robot.view.errors.iter().find(waits).is_some_and(|error| error.message.contains("ABS_Y")));
        hand.say("abs ABS_Y 0\nframe\nabs ABS_Y -100\nframe\n");
        // Both within one turn would hide the centre position; each frame is processed.
        robot.until("it moves again", 3.0, |view| view.speed() > 0.4);

        let begin = std::time::Instant::now();
        hand.unplug();
        robot.until("the stop has begun", 1.0, |view| {
            view.motion.as_ref().is_some_and(|motion| motion.speed_target == 0.0)
        });
        assert!(begin.elapsed().as_millis() < 300, "{:?}", begin.elapsed());
        stands(&mut robot, "unplugged");

        // Plugged in again with everything pressed.
        hand.plug();
        hand.say(&PAD.replace("BTN_TL 0", "BTN_TL 1").replace("0 0 0\nbutton", "0 0 -100\nbutton"));
        robot.pass(1.0);
        assert!(robot.view.speed().abs() < 0.01, "nothing resumes by itself");
        hand.say("key BTN_TL 0\nabs ABS_Y 0\nframe\nkey BTN_TL 1\nframe\nabs ABS_Y 100\nframe\n");
        robot.until("backwards", 3.0, |view| view.speed() < -0.3);
        assert!(robot.view.all_run(), "{:?}", robot.view.processes);
        assert_eq!(robot.stop(), 0);
    });
}

#[test]
fn the_simulator_s_gamepad_is_held_from_the_shell_and_survives_its_driver() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        let pad = |robot: &Robot, args: &[&str]| {
            let done = robot.advee(&[&["fault", "gamepad"], args].concat());
            assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        };
        pad(&robot, &["plug"]);
        pad(&robot, &["hold"]);
        pad(&robot, &["speed", "0.8"]);
        robot.until("it moves", 3.0, |view| view.speed() > 0.2);
        // The driver dies with the button held: the robot stops, and the new process waits for the button.
        robot.kill("driver_joydev");
        stands(&mut robot, "its driver is dead");
        robot.until("it is back", 5.0, |view| view.runs("driver_joydev"));
        robot.pass(1.0);
        assert!(robot.view.speed().abs() < 0.01, "nothing resumes by itself");
        pad(&robot, &["speed", "0"]);
        pad(&robot, &["release"]);
        pad(&robot, &["hold"]);
        pad(&robot, &["speed", "0.8", "--for", "2"]);
        robot.until("it moves again", 3.0, |view| view.speed() > 0.2);
        stands(&mut robot, "the stick is let go after its time");

        let refused = robot.advee(&["fault", "gamepad", "eat"]);
        assert!(!refused.status.success());
        // Another gamepad connects to the socket.
        let mut player = std::os::unix::net::UnixStream::connect(robot.run_dir.join("gamepad")).expect("it is there");
        player.write_all(PAD.as_bytes()).expect("it listens");
        player.write_all(b"key BTN_TL 1\nframe\nabs ABS_Y -50\nframe\n").expect("it listens");
        robot.until("it moves for another one", 3.0, |view| {
            view.speed() > 0.05 && view.joydev.as_ref().is_some_and(|pad| pad.name == "Test's pad")
        });
        drop(player);
        stands(&mut robot, "he has hung up");
        assert_eq!(robot.stop(), 0);
        assert!(!robot.run_dir.exists(), "the socket is left over");
    });
}

#[test]
fn a_gamepad_of_the_kernel_drives_the_robot() {
    support::undisturbed(|| {
        let Some(mut pad) = Uinput::new() else { return };
        let mut robot = Robot::ready(&["--set", "gamepad.device=\"auto\""]);
        robot.until("it is found", 5.0, |view| view.joydev.as_ref().is_some_and(|pad| pad.name == "advee uinput pad"));
        pad.say("key 1\nabs -20000\n");
        robot.until("it moves", 3.0, |view| view.speed() > 0.2);
        pad.end();
        stands(&mut robot, "it was destroyed");
        robot.until("it is gone", 1.0, |view| view.joydev.as_ref().is_some_and(|pad| !pad.connected));
    });
}

/// Gamepad made with `/dev/uinput`, in a Python process that needs only the standard library.
struct Uinput(Child);

impl Uinput {
    fn new() -> Option<Self> {
        let device = OpenOptions::new().write(true).open("/dev/uinput");
        testing::machine_or_skip(device.map_err(|error| format!("/dev/uinput: {error}")))?;
        let script = support::workspace().join("advee/tests/it/gamepad/uinput.py");
        let child = std::process::Command::new(support::python()?).arg(script).stdin(Stdio::piped()).spawn();
        Some(Self(child.expect("Python runs")))
    }

    fn say(&mut self, lines: &str) {
        self.0.stdin.as_mut().expect("it listens").write_all(lines.as_bytes()).expect("it listens");
    }

    /// The end of its input removes the device.
    fn end(&mut self) {
        self.0.stdin = None;
        let _ = self.0.wait();
    }
}

impl Drop for Uinput {
    fn drop(&mut self) {
        self.end();
    }
}
