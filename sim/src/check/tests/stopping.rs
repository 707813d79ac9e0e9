//! Wheels that turn by themselves, drives that do not stop, and a watchdog that is late.

use super::*;

/// Statusword of a steering without a reference, and with one.
const LOST: &str = "frame 282 27 00";
const HOMED: &str = "frame 282 27 80";
/// The robot drives at 0.5 m/s, and is told to stop.
const TOLD_TO_STOP: &str = "frame 181 27 00 \n speed 0.5 \n begin pad 0.5 \n +50 stop";
/// The same, on a bus that is disturbed until 50 ms ago.
const DISTURBED: &str = "frame 181 27 00 \n speed 0.5 \n begin pad 0.5 \n fault can noise 100 \n +50 stop \n +200";

#[test]
fn homing_needs_a_release() {
    check(&format!("{LOST} \n turn 0.03 2 ! released"));
    let modes = ["mode home", "mode approach"];
    let releases = ["home", "goal", "operator planner RUN", "operator driver RUN", "operator * RUN", "begin pad 0.1"];
    for release in releases.into_iter().chain(modes) {
        check(&format!("{LOST} \n {release} \n stop \n turn 0.03 20"));
    }
    let modes = ["mode manual", "mode route", "mode wait", "network mode home"];
    for other in ["program planner RUN", "operator power RUN", "say pad 0", "network home"].into_iter().chain(modes) {
        check(&format!("{LOST} \n {other} \n turn 0.03 2 ! released"));
    }
}

#[test]
fn a_cause_of_a_stop_voids_the_releases_before_it() {
    for cause in ["line engaged \n +10 line free", "list driver \n +10 list power,driver", "frame 702 00"] {
        check(&format!("{LOST} \n home \n +50 {cause} \n +500 turn 0.03 1 ! released"));
        check(&format!("{LOST} \n home \n +50 {cause} \n +500 home \n turn 0.03 20"));
    }
}

#[test]
fn a_steering_with_a_reference_turns_for_a_source_of_motion_and_after_homing() {
    check(&format!("{HOMED} \n turn 0.03 39 \n turn 0.03 1 ! released"));
    check(&format!("{HOMED} \n +3000 say pad 0 \n turn 0.03 40"));
}

#[test]
fn whether_a_drive_that_does_not_say_it_has_a_reference_is_as_its_driver_tells() {
    let silent = |script: &str| {
        let mut bench = Bench::with(Limits { homed: 0, ..limits() });
        script.lines().for_each(|line| bench.line(line.trim()));
    };
    silent(&format!("{HOMED} \n turn 0.03 1 ! released"));
    silent("motion homed - 0 \n +3000 say pad 0 \n turn 0.03 40");
    silent("motion homed - 0 \n motion not_homed - 0 \n +3000 say pad 0 \n turn 0.03 1 ! released");
}

#[test]
fn under_a_cause_the_wheels_come_to_a_stand() {
    check(&format!(
        "{HOMED}
        quiet power
        line engaged
        say pad 0
        turn 0.03 10
        turn 0.03 1 ! released"
    ));
}

#[test]
fn the_wheels_of_another_simulator_have_not_turned() {
    check(&format!("{LOST} \n turn 0 1 \n simulator 7 0.5 \n turn 0 1"));
    check(&format!("{LOST} \n turn 0 1 \n simulator 7 0.5 \n turn 0 1 \n turn 0.03 1 ! released"));
}

#[test]
fn the_start_releases_the_first_homing_only() {
    let start = |script: &str| {
        let mut bench = Bench::with(Limits { homing_at_start: true, ..limits() });
        script.lines().for_each(|line| bench.line(line.trim()));
    };
    start(&format!("{LOST} \n turn 0.03 20 \n {HOMED} \n +100 {LOST} \n turn 0.03 1 ! released"));
    start(&format!("{LOST} \n turn 0.03 9 \n line engaged \n +10 line free \n +500 turn 0.03 1 ! released"));
    start(&format!("{LOST} \n line engaged \n +10 line free \n turn 0.03 9"));
    start(&format!(
        "{LOST}
        exit driver
        start driver
        state driver RUN
        line free
        list power,driver
        +600 turn 0.03 1 ! released"
    ));
}

#[test]
fn a_drive_that_does_not_brake_is_cut_off_its_feed() {
    check(&format!("{TOLD_TO_STOP} \n fault propulsion unbraked 2000 \n faster 0 13 \n cut \n faster 0 20"));
    check(&format!("{TOLD_TO_STOP} \n fault propulsion unbraked 2000 \n faster 0 14 \n faster 0 1 ! feed"));
    check(&format!("{DISTURBED} \n fault propulsion unbraked 2000 \n faster 0 5 \n cut \n faster 0 20"));
    check(&format!("{DISTURBED} \n fault propulsion unbraked 2000 \n faster 0 13 \n faster 0 1 ! feed"));
    // It brakes, is without power, or under the PAUSE line.
    check(&format!("{TOLD_TO_STOP} \n fault propulsion unbraked 2000 \n faster -0.05 3 \n faster 0 20"));
    check(&format!("{TOLD_TO_STOP} \n fault propulsion fault 0 \n frame 181 08 00 \n faster 0 20"));
    check(&format!("{TOLD_TO_STOP} \n fault propulsion fault 0 \n quiet power \n line engaged \n faster 0 20"));
}

#[test]
fn a_drive_that_brakes_as_told_keeps_its_feed() {
    check(&format!("{TOLD_TO_STOP} \n faster -0.075 5 \n cut ! feed"));
    check(&format!("{TOLD_TO_STOP} \n faster -0.02 5 \n cut \n +500 cut"));
    check("frame 181 27 00 \n speed 0.5 \n begin pad 0.5 \n +50 cut ! feed");
    // A person switches the motors on; the order is repeated only where the driver may not have heard that.
    for (fault, after, rule) in [("", 200, "! feed"), ("", 2, ""), ("fault lcm loss 900 \n", 200, "")] {
        let released = format!("frame 181 40 00 \n {fault} +300 begin pad 0.0 \n feed");
        check(&format!("{TOLD_TO_STOP} \n faster -0.02 5 \n cut \n {released} \n +{after} cut {rule}"));
    }
    // The order was sent while the bus was disturbed, and is not repeated afterwards.
    check(&format!("{DISTURBED} \n faster -0.075 5 \n cut ! feed"));
}

#[test]
fn a_robot_that_stood_and_is_moved_again_has_its_feed_cut_within_the_time_from_then() {
    let stood =
        format!("{TOLD_TO_STOP} \n faster -0.05 10 \n faster 0 60 \n fault propulsion runaway 3000 \n speed -0.49");
    check(&format!("{stood} \n faster 0 12"));
    check(&format!("{stood} \n faster 0 16 ! feed"));
}

#[test]
fn a_robot_that_is_faster_than_commanded_is_stopped() {
    let drives = |seconds: usize| "+50 say pad 0.2 \n drive 0.2 \n".repeat(20 * seconds);
    let begin = format!("frame 181 27 00 \n speed 0.2 \n begin pad 0.2 \n {} speed 0.4 \n", drives(3));
    check(&format!("{begin} {} +50 ! feed", "+50 say pad 0.2 \n drive 0.2 \n".repeat(15)));
    check(&format!("{begin} {} stop", "+50 say pad 0.2 \n drive 0.2 \n".repeat(12)));
}

#[test]
fn after_a_cut_only_a_person_who_switches_the_motors_on_lets_it_move() {
    let script = |release: &str, rule: &str| {
        check(&format!("{TOLD_TO_STOP} \n faster -0.02 10 \n cut \n +10 {release} \n begin pad 0.3 {rule}"));
    };
    script("feed", "");
    // The driver repeats its order before it hears that one, and once more where it never does.
    script("feed \n +2 cut", "");
    script("feed \n +2 cut \n +500 cut", "! feed");
    script("operator driver RUN", "! feed");
    script("network feed", "! feed");
}

#[test]
fn a_watchdog_that_is_late_again_and_again_stops_the_robot() {
    let passes = "+240 say pad 0.4 \n".repeat(6);
    check(&format!("begin pad 0.4 \n crawl watchdog 120 \n {passes} drive 0.4 \n +70 drive 0.4 ! late_watchdog"));
    check(&format!("begin pad 0.4 \n crawl watchdog 90 \n {passes} drive 0.4 \n +70 drive 0.4"));
    check(&format!(
        "begin pad 0.4 \n crawl watchdog 120 \n +240 crawl watchdog 0 \n say pad 0.4 \n {passes} drive 0.4"
    ));
}
