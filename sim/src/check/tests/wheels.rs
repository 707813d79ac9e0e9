//! Rules for a base that turns by its wheels: set-points of several wheels, and the loss of one.

use super::*;
use kinematics::{Chassis, Limits as OfWheel};

/// A differential base with a track of 0.6 m: the drives of the other tests turn its left and its right wheel.
pub(super) fn differential() -> Limits {
    let limits = limits();
    let of_wheel = OfWheel { speed_mps: 1.2, acceleration_mps2: 0.5, deceleration_mps2: 0.8 };
    let wheel = |name: &str, drive: &wire::Drive| wire::Wheel {
        name: name.into(),
        drive: drive.clone(),
        stop_word: 0x0B,
        units_per_mps: 1000.0,
    };
    let (left, right) =
        (&limits.wheels[0].drive, limits.steering.as_ref().expect("the robot of the other tests steers"));
    Limits {
        wheels: vec![wheel("left", left), wheel("right", right)],
        steering: None,
        base: Some(Base {
            chassis: Chassis::differential(0.6, of_wheel).expect("a track of 0.6 m"),
            deceleration_mps2: 0.8,
        }),
        homed: 0,
        promise: None,
        feed_is_cut: false,
        ..limits
    }
}

/// A bench whose wheels have these set-points in turn; lines as in other scripts, and `wheels` with both speeds, or
/// `stop`.
#[track_caller]
fn check_wheels(script: &str) {
    check_with(Bench::with(differential()), script);
}

#[test]
fn the_fastest_wheel_is_what_a_command_asks_for_or_less() {
    check_wheels("velocity pad 0 0 \n +10 velocity pad 0 0.5 \n wheels -0.15 0.15 \n wheels -0.1 0.1");
    check_wheels("velocity pad 0 0 \n +10 velocity pad 0 0.5 \n wheels -0.15 0.16 ! fresh");
    check_wheels("velocity pad 0 0 \n +10 velocity pad 0.4 0.5 \n wheels 0.25 0.55 \n wheels 0.25 0.56 ! fresh");
    // A manual source drives at most at 0.6 m/s.
    check_wheels("velocity pad 0 0 \n +10 velocity pad 1.0 0 \n wheels 0.6 0.6 \n wheels 0.61 0.6 ! fresh");
}

#[test]
fn wheels_slow_down_in_steps_for_a_source_that_still_commands() {
    check_wheels(
        "velocity pad 0 0
        +10 velocity pad 0.4 0
        wheels 0.4 0.4
        +20 velocity pad 0 0
        +20 wheels 0.38 0.38
        +20 wheels 0.36 0.36
        +20 wheels 0.41 0.36 ! fresh",
    );
    check_wheels(
        "velocity pad 0 0
        +10 velocity pad 0.4 0
        wheels 0.4 0.4
        +20 velocity pad 0 0
        +260 wheels 0.1 0.1 ! fresh",
    );
}

#[test]
fn a_source_that_takes_over_by_zero_ends_a_motion_and_begins_none() {
    let taken_over = |from: &str, by: &str| {
        format!(
            "say {from} 0
            +10 say {from} 0.4
            wheels 0.4 0.4
            +185 say {by} 0
            +50 say {by} 0
            +10 wheels 0.36 0.36
            +20 say {by} 0"
        )
    };
    // The shell has expired.
    let by_pad = taken_over("shell", "pad");
    check_wheels(&format!("{by_pad} \n +30 say pad 0 \n wheels 0.34 0.34 \n +20 wheels 0.32 0.32"));
    check_wheels(&format!("{by_pad} \n +30 say pad 0 \n wheels 0.34 0.34 \n +20 wheels 0.35 0.35 ! resumes"));
    check_wheels(&format!("{by_pad} \n +30 wheels stop stop \n +20 say pad 0 \n wheels 0.32 0.32 ! resumes"));
    // The shell commands zero itself before it falls silent, and the pad takes over then, or only after its expiry.
    let ended = "say shell 0
        +10 say shell 0.4
        wheels 0.4 0.4
        +100 say shell 0
        wheels 0.36 0.36";
    let (by_shell, by_pad) = (slower(0.36, 7, ""), slower(0.248, 9, "say pad 0"));
    check_wheels(&format!("{ended} {by_shell} \n +10 say pad 0 {by_pad}"));
    check_wheels(&format!("{ended} \n +290 say pad 0 \n +50 say pad 0 \n wheels 0.2 0.2 ! resumes"));
    // One of no higher priority does not take over: the pad's silence is a stop.
    for other in ["twin", "shell", "planner"] {
        let script = taken_over("pad", other);
        check_wheels(&format!("{script} \n +30 say {other} 0 \n wheels 0.34 0.34 ! resumes"));
    }
}

#[test]
fn the_motion_that_a_source_ends_by_zero_slows_down_on_its_ramp() {
    // Taken over from a source that has expired; the ramp of 0.8 m/s² needs 0.45 s.
    let taken_over = "say shell 0
        +10 say shell 0.4
        wheels 0.4 0.4
        +185 say pad 0
        +50 say pad 0
        +10 wheels 0.36 0.36";
    check_wheels(&format!("{taken_over} {}", slower(0.36, 21, "say pad 0")));
    // It keeps its speed, or slows down by half of the ramp.
    let kept = "\n +20 say pad 0 \n wheels 0.36 0.36".repeat(3);
    check_wheels(&format!("{taken_over} {kept} \n +20 wheels 0.36 0.36 ! resumes"));
    let half: String = (1..=7)
        .map(|n| 0.36 - 0.008 * f64::from(n))
        .fold(String::new(), |lines, speed| format!("{lines} \n +20 say pad 0 \n wheels {speed:.3} {speed:.3}"));
    check_wheels(&format!("{taken_over} {half} \n +20 wheels 0.296 0.296 ! resumes"));
}

/// Wheels that slow down from `speed` by 0.8 m/s² in steps; `line` before each.
fn slower(speed: f64, steps: u32, line: &str) -> String {
    let wheels = (1..=steps).map(|step| speed - 0.016 * f64::from(step));
    wheels.fold(String::new(), |lines, speed| format!("{lines} \n +20 {line} \n wheels {speed:.3} {speed:.3}"))
}

#[test]
fn a_robot_that_lost_its_power_at_speed_rolls_until_it_is_powered_again() {
    let limits = differential();
    let wheels = [("left", 1), ("right", 2)].map(|(name, node)| wire::Wheel {
        name: name.into(),
        drive: wire::Drive::can_simple(0, node, 251),
        stop_word: 0x0F,
        units_per_mps: 15.0,
    });
    let limits = Limits { wheels: wheels.into(), coasting: Some(0.15), ..limits };
    // From 0.4 m/s for 2.7 s, of which an operator commands on for 1.5 s.
    let rolled = |state: &str| {
        let mut bench = Bench::with(limits.clone());
        for line in ["velocity pad 0 0", "+10 velocity pad 0.4 0", "speed 0.4", "fault can cut 270"] {
            bench.line(line);
        }
        for sample in 0..53 {
            if sample < 30 {
                bench.line("velocity pad 0.4 0");
            }
            bench.act(&["faster", "-0.0075", "1"]);
            bench.act(&["frame", "021", "00", "00", "00", "00", state]);
            bench.act(&["frame", "041", "00", "00", "00", "00", "01"]);
        }
        bench.line("speed 0");
        bench.pass(500);
        bench.checkers.violation().map(|violation| violation.rule)
    };
    assert_eq!(rolled("01"), None);
    assert_eq!(rolled("08"), None, "the other one has no power");
    let mut bench = Bench::with(limits.clone());
    for line in ["velocity pad 0 0", "+10 velocity pad 0.4 0", "speed 0.4", "fault can cut 270", "+400"] {
        bench.line(line);
    }
    // Both are powered again, and the robot rolls all the same.
    for line in ["frame 021 00 00 00 00 08", "frame 041 00 00 00 00 08"] {
        bench.line(line);
    }
    for _ in 0..30 {
        bench.line("velocity pad 0.4 0");
        bench.pass(50);
    }
    bench.line("speed 0.12");
    bench.pass(900);
    assert_eq!(bench.checkers.violation().map(|violation| violation.rule), Some("body"));
}

#[test]
fn wheels_that_slow_down_come_to_stand() {
    let mut bench = Bench::with(differential());
    for line in ["velocity pad 0 0", "+10 velocity pad 0.4 0", "wheels 0.4 0.4"] {
        bench.line(line);
    }
    // From one way at full speed to the other they take 3 s.
    for _ in 0..29 {
        bench.line("+100 velocity pad 0 0");
        bench.line("wheels 0.2 0.2");
    }
    bench.line("+100 velocity pad 0 0");
    bench.line("+200 velocity pad 0 0");
    bench.line("wheels 0.2 0.2 ! fresh");
}

#[test]
fn no_wheel_is_driven_without_another_one() {
    check_wheels(
        "velocity pad 0 0
        +10 velocity pad 0.4 0
        wheels 0.4 0.4
        frame 182 08 00               # in fault
        +3 wheels 0.4 0.4 ! drives",
    );
    check_wheels(
        "velocity pad 0 0
        +10 velocity pad 0.4 0
        quiet propulsion
        +190 velocity pad 0.4 0
        +50 wheels 0.4 0.4 ! drives",
    );
}

#[test]
fn all_wheels_are_told_to_stop_when_one_is_lost() {
    let lost = "velocity pad 0 0
        +10 velocity pad 0.4 0
        wheels 0.4 0.4
        frame 181 27 00
        frame 182 27 00
        speed 0.4
        +60 frame 182 08 00";
    check_wheels(&format!("{lost} \n +200 wheels 0 stop \n +40 wheels stop stop \n speed 0 \n +2000"));
    check_wheels(&format!("{lost} \n +299 \n +50 ! drives"));
    // It stands.
    check_wheels(&format!("{lost} \n speed 0 \n +400"));
}

/// The right drive restarts, and the master is off the bus until 100 ms before the last line. The left drive stops by
/// itself, and its wheel is what the body turns about, at 0.3 m/s of the right one, which has no power.
const MASTER_LOST: &str = "velocity pad 0 0
    +10 velocity pad 0.4 0
    wheels 0.4 0.4
    frame 181 27 00
    frame 182 27 00
    speed 0.4
    +90 velocity pad 0.4 0
    fault can bus_off 1600
    quiet steering
    frame 702 00
    +50
    quiet propulsion
    +150 LEFT
    speed 0.3
    +250 speed 0.15
    rotation 0.5
    +1150";

#[test]
fn a_wheel_without_power_rolls_on_while_another_one_stands_by_itself() {
    // CiA 301: emergency 0x8130, and the heartbeat of a drive that has left Operational.
    for report in ["frame 081 30 81 11 00 00 00 00 00", "frame 701 7F"] {
        check_wheels(&format!("{} \n +200", MASTER_LOST.replace("LEFT", report)));
    }
}

#[test]
fn a_drive_that_reports_no_stop_of_its_own_or_does_not_stop_is_found() {
    let lost = |report: &str| MASTER_LOST.replace("LEFT", report);
    let stops = "frame 081 30 81 11 00 00 00 00 00";
    // No report; that of another drive; an emergency for another reason; the right one's, which has restarted.
    for report in ["", "frame 083 30 81 11 00 00 00 00 00", "frame 081 10 23 03 00 00 00 00 00", "frame 082 30 81 11"] {
        check_wheels(&format!("{} \n +100 ! drives", lost(report)));
    }
    // It reports, and the body drives straight on, or turns the other way about.
    check_wheels(&format!("{} \n rotation 0 \n +100 ! drives", lost(stops)));
    check_wheels(&format!("{} \n rotation -0.5 \n +100 ! drives", lost(stops)));
    // It is enabled again after its report.
    check_wheels(&format!("{} \n frame 181 27 00 \n +100 ! drives", lost(stops)));
}
