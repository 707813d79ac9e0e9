//! Others than this robot's own: on the PAUSE line, on the message bus, on the CAN bus.

use super::*;

#[test]
fn one_source_of_pause_does_not_release_another_one() {
    check("line engaged rope \n +600 begin pad 0.4 ! pause");
    check("line engaged rope \n line free rope \n begin pad 0.4 \n +21 drive 0.4");
    // A person overrules a source that fell silent, and no other.
    check("line engaged rope \n +1250 operator driver RUN \n begin pad 0.4 \n +21 drive 0.4");
    check("line engaged rope \n +1150 operator driver RUN \n begin pad 0.4 ! pause");
    check("line engaged rope \n +1250 operator planner RUN \n begin pad 0.4 ! pause");
}

#[test]
fn the_power_controller_does_not_release_what_another_sender_engaged_in_its_name() {
    check("line engaged button by 300 \n line free \n +600 begin pad 0.4 ! pause");
    check("line engaged button by 300 \n line free button by 301 \n +600 begin pad 0.4 ! pause");
    check("line engaged button by 300 \n line free button by 300 \n line free \n begin pad 0.4 \n +21 drive 0.4");
    // Nor does a sender release the line itself.
    check(
        "quiet power \n line engaged button \n \
         line engaged button by 300 \n line free button by 300 \n +600 begin pad 0.4 ! pause",
    );
    // It does not stand in for a silent power controller.
    check(
        "quiet power \n +1190 line engaged button by 300 \n \
         line free button by 300 \n begin pad 0.4 \n +12 drive 0.4 ! pause",
    );
}

#[test]
fn a_source_of_pause_with_a_module_is_freed_by_its_processes_alone_and_stops_the_robot_if_silent() {
    for power in [Some("power".into()), None] {
        let judge = |script: &str| {
            let stops = vec![StopReport { source: "io.estop".into(), module: "io".into() }];
            let mut bench = Bench::with(Limits { stops, power: power.clone(), ..limits() });
            bench.act(&["start", "io"]);
            assert_eq!(bench.pids["io"], 5);
            check_with(bench, script);
        };
        judge("begin pad 0.4 ! pause");
        judge("line free io.estop by 300 \n begin pad 0.4 ! pause");
        judge("line free io.estop by 5 \n begin pad 0.4 \n +490 \n say pad 0.4 \n +5 drive 0.4");
        judge("line free io.estop by 5 \n begin pad 0.4 \n +490 \n say pad 0.4 \n +25 drive 0.4 ! pause");
        judge("line engaged io.estop by 5 \n +300 line free io.estop by 300 \n +300 begin pad 0.4 ! pause");
        // Another process of the module reports for the same source.
        judge(
            "line engaged io.estop by 5
            exit io
            start io
            line free io.estop by 105
            begin pad 0.4
            +21 drive 0.4",
        );
        // Nobody overrules it.
        judge(
            "line engaged io.estop by 5
            +1250 operator driver RUN
            begin pad 0.4 ! pause",
        );
        // What another process engaged in its name is its own.
        judge(
            "line engaged io.estop by 300
            line free io.estop by 5
            begin pad 0.4
            +21 drive 0.4 ! pause",
        );
    }
}

#[test]
fn who_may_not_command_moves_nothing() {
    check("network say lan 0 \n network say lan 0.3 \n drive 0.3 ! foreign");
    check("host say other 0 \n host say other 0.3 \n drive 0.3");
    // A command that the robot may follow asks for the same.
    check("network say lan 0.4 \n begin pad 0.4");
}

#[test]
fn who_is_not_due_releases_nothing() {
    for who in ["host", "network"] {
        check(&format!(
            "quiet power
            +1190 {who} line free
            begin pad 0.4
            +12 drive 0.4 ! pause"
        ));
        check(&format!(
            "fault lcm loss 300
            quiet watchdog
            list driver
            {who} list power,driver
            +3 begin pad 0.4 ! critical"
        ));
    }
    check(
        "state power STOP
        network operator power RUN
        state power RUN ! stopped",
    );
    check("network goal \n estimate \n say planner 0.7 \n drive 0.7 ! resumes");
}

#[test]
fn the_motion_that_another_one_reports_is_not_the_driver_s() {
    check("motion not_homed - 0.1 ! homed");
    check("host motion not_homed - 0.1");
    check("network motion not_homed - 0.1");
}

#[test]
fn the_watchdog_of_another_robot_stops_this_one() {
    for who in ["host", "network"] {
        check(&format!("begin pad 0.4 \n {who} list power,driver \n +19 drive 0.4 \n +4 drive 0.4 ! second_robot"));
    }
    check("begin pad 0.4 \n host list power \n stop \n +2100 begin pad 0.4");
    // Messages that may be lost or late say nothing.
    check("begin pad 0.4 \n fault lcm loss 300 \n host list power \n +23 drive 0.4");
    check("begin pad 0.4 \n host list power \n +1 crawl driver 1 \n +23 drive 0.4");
}

#[test]
fn another_master_stops_the_robot() {
    for frame in ["501 0F 00 64 00 00 00", "000 02 02", "000 81 00", "080", "602 23 85 60 00 3C 00 00 00"] {
        check(&format!("begin pad 0.4 \n other {frame} \n +1 drive 0.4 \n +2 drive 0.4 ! rival"));
    }
    check("begin pad 0.4 \n other 501 0F 00 64 00 00 00 \n stop \n +1000 begin pad 0.4");
    // To other nodes, and on a bus that loses frames.
    check("begin pad 0.4 \n other 000 02 09 \n other 609 40 \n +3 drive 0.4");
    check("begin pad 0.4 \n fault can loss 300 \n other 501 0F 00 64 00 00 00 \n +3 drive 0.4");
    check("begin pad 0.4 \n fault can loss 100 \n other 501 0F 00 64 00 00 00 \n +300 say pad 0.4 \n drive 0.4");
    // A driver whose controller has not come back does not receive it; one that sends does.
    let after = "begin pad 0.4 \n fault can bus_off 100 \n +400 other 501 0F 00 64 00 00 00 \n +300 say pad 0.4";
    check(&format!("quiet propulsion \n quiet steering \n {after} \n drive 0.4"));
    check(&format!("{after} \n drive 0.4 ! rival"));
}
