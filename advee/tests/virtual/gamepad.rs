//! A gamepad moves the robot in virtual time, and disappears in every possible way.

use super::*;
use base::gamepad::{ABS_RX, ABS_Y, Axis, BTN_SOUTH, BTN_TL, BTN_TR, Button, Device, Event};
use messages::Hold;
use messages::simulation::CmdFault;

/// Commanded stop from the manual limit: 0.6 m/s at 0.8 m/s², and some periods of loops and drives.
const STANDS: Duration = Duration::from_millis(750 + 150);
/// Stop without a zero command: a command's validity, then a quick stop at 1.5 m/s².
const STANDS_UNTOLD: Duration = Duration::from_millis(250 + 400 + 150);

impl Robot {
    fn pad(&mut self, fault: &str, value: f64) {
        let (target, fault) = ("gamepad".into(), fault.into());
        let now = self.machine.now();
        self.machine.inject(now, CmdFault { timestamp: 0, target, fault, value, duration: 0.0 });
        self.pass(0.01);
    }

    /// The gamepad is plugged in, the button held, and the stick pushed, in this order.
    fn grip(&mut self, speed: f64) {
        for (what, value) in [("release", 0.0), ("speed", 0.0), ("plug", 0.0), ("hold", 0.0), ("speed", speed)] {
            self.pad(what, value);
        }
    }

    /// Time until standstill from now on.
    #[track_caller]
    fn stands_within(&mut self, bound: Duration, why: &str) {
        let begin = self.machine.now();
        while self.speed().abs() >= 0.01 {
            self.pass(0.01);
            let took = self.machine.now().since(begin);
            assert!(took <= bound, "{why}: {} m/s after {took:?}", self.speed());
        }
        // And remains at standstill.
        self.pass(0.6);
        assert!(self.speed().abs() < 0.01, "{why}: it moves again");
    }
}

#[test]
fn it_drives_while_the_button_is_held_and_stops_when_it_is_released() {
    let mut robot = Robot::ready(3);
    robot.grip(1.0);
    robot.pass(2.0);
    assert!((robot.speed() - 0.6).abs() < 0.02, "{} {}", robot.speed(), robot.motion().reason);
    assert_eq!(robot.motion().source, "gamepad");
    robot.pad("steering", 1.0);
    robot.pass(1.0);
    assert!(robot.motion().steering > 0.5, "left is left");
    robot.pad("release", 0.0);
    robot.stands_within(STANDS, "let go");
}

#[test]
fn unplugged_in_any_phase_of_its_commands_the_robot_stops_within_its_bound() {
    let mut robot = Robot::ready(4);
    for phase in 0..25_u32 {
        robot.grip(if phase % 2 == 0 { 1.0 } else { -0.7 });
        // From the first tenths of a second to full speed, and over all of the 50 ms between two commands.
        robot.pass(0.1 + f64::from(phase) * 0.053);
        robot.pad("unplug", 0.0);
        robot.stands_within(STANDS, &format!("unplugged in phase {phase}"));
        robot.pad("plug", 0.0);
        robot.pass(0.3);
        assert!(robot.speed().abs() < 0.01, "plugged in again with everything pushed");
    }
}

#[test]
fn whatever_its_driver_does_the_robot_stops_within_a_command_s_validity_and_a_quick_stop() {
    let mut robot = Robot::ready(5);
    for phase in 0..12_u32 {
        robot.grip(0.8);
        robot.pass(0.8 + f64::from(phase) * 0.029);
        assert!(robot.speed() > 0.1, "phase {phase}: {}", robot.motion().reason);
        let pid = robot.machine.pid("driver_joydev").expect("it runs");
        if phase % 2 == 0 {
            robot.machine.kill(pid);
        } else {
            robot.machine.hang(pid);
        }
        robot.stands_within(STANDS_UNTOLD, &format!("its driver is gone in phase {phase}"));
        // The watchdog delays restarts more and more, up to ten seconds.
        let runs = |robot: &Robot| {
            let new = robot.machine.pid("driver_joydev").filter(|new| *new != pid);
            new.and_then(|new| robot.machine.state(new)) == Some(State::Run)
        };
        let begin = robot.machine.now();
        while !runs(&robot) {
            robot.pass(0.1);
            assert!(robot.machine.now().since(begin) < Duration::from_secs(15), "phase {phase}: it is not back");
        }
        robot.pass(1.0);
        assert!(robot.speed().abs() < 0.01, "phase {phase}: with the button still held");
    }
}

#[test]
fn a_gamepad_that_disappears_with_its_simulator_stops_the_robot_too() {
    let mut robot = Robot::ready(6);
    let mut pad = Device::new("of the test");
    for code in [ABS_Y, ABS_RX] {
        pad.add_axis(Axis { code, min: -100, max: 100, fuzz: 0, flat: 0, value: 0 });
    }
    for code in [BTN_SOUTH, BTN_TL] {
        pad.add_button(Button { code, pressed: false });
    }
    for event in [
        Event::Found(Box::new(pad)),
        Event::Button { code: BTN_TL, pressed: true },
        Event::Frame,
        Event::Axis { code: ABS_Y, value: -50 },
        Event::Frame,
    ] {
        assert!(robot.machine.gamepad("joystick", event));
        robot.pass(0.06);
    }
    robot.pass(2.0);
    assert!(robot.speed() > 0.15, "{} {}", robot.speed(), robot.motion().reason);
    assert!(robot.machine.gamepad("joystick", Event::Gone));
    robot.stands_within(STANDS, "gone");
}

#[test]
fn it_creeps_past_the_guard_while_its_second_button_is_held() {
    let mut place = place();
    // The front is 0.19 m before a wall.
    place.sets.extend(["guard.ranging=\"sonar\"", "world.start=[19.06, 6.0, 0.0]"].map(String::from));
    let mut robot = Robot::at(&place, Config { seed: 7, ..Config::default() });
    robot.machine.run_until(at(12.0));
    assert!(robot.motion().homed, "{}", robot.motion().reason);
    let mut pad = Device::new("of the test");
    for code in [ABS_Y, ABS_RX] {
        pad.add_axis(Axis { code, min: -100, max: 100, fuzz: 0, flat: 0, value: 0 });
    }
    for code in [BTN_SOUTH, BTN_TL, BTN_TR] {
        pad.add_button(Button { code, pressed: false });
    }
    let feel = |robot: &mut Robot, event: Event| {
        for event in [event, Event::Frame] {
            assert!(robot.machine.gamepad("joystick", event));
        }
        robot.pass(0.1);
    };
    let button = |code, pressed| Event::Button { code, pressed };
    feel(&mut robot, Event::Found(Box::new(pad)));
    feel(&mut robot, button(BTN_TL, true));
    feel(&mut robot, Event::Axis { code: ABS_Y, value: -60 });
    robot.pass(0.3);
    assert!(robot.speed().abs() < 0.01, "the guard permits nothing: {} m/s", robot.speed());
    feel(&mut robot, button(BTN_TR, true));
    robot.pass(0.2);
    assert!((0.03..=0.16).contains(&robot.speed()), "{} m/s {}", robot.speed(), robot.motion().reason);
    let creeps = |robot: &Robot| robot.seen.borrow().holds.has(Hold::GuardCreep);
    assert!(creeps(&robot), "{:?}", robot.seen.borrow().holds);
    feel(&mut robot, button(BTN_TR, false));
    robot.pass(0.3);
    assert!(robot.speed().abs() < 0.01 && !creeps(&robot), "{} m/s", robot.speed());
}

#[test]
fn a_session_with_a_gamepad_is_reproducible_bit_for_bit() {
    let session = |seed| {
        let mut robot = Robot::ready(seed);
        robot.grip(0.9);
        robot.pad("steering", -0.4);
        robot.pass(2.0);
        robot.pad("unplug", 0.0);
        robot.pass(2.0);
        robot.machine.digest()
    };
    assert_eq!(session(11), session(11));
    assert_ne!(session(11), session(12));
}
