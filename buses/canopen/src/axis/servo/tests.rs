//! Each mode between master and drive, in virtual time: a bus with one drive that has them all.

mod rig;

use super::super::modes::Mode;
use super::super::modes::cyclic::{Cyclic, CyclicConfig, CyclicStatus, Stopped};
use super::super::modes::hm::HomingError;
use super::super::modes::method::Method;
use super::super::modes::pp::{Move, SetpointEvent};
use super::super::modes::pv::VelocityStatus;
use super::super::modes::switch::SwitchError;
use super::super::{Goal, PowerState, status};
use super::twin::Load;
use base::Duration;
use rig::{PERIOD, Piece, Rig};
use std::vec::Vec;

#[test]
fn set_points_are_reached_one_after_the_other_or_at_once() {
    let mut rig = Rig::enabled(Mode::ProfilePosition);
    rig.setpoint.set(rig.now, 5000);
    rig.run(500);
    assert!((100..4900).contains(&rig.position), "under way: {}", rig.position);
    rig.setpoint.set(rig.now, -3000);
    rig.run(5000);
    assert_eq!((rig.position, rig.setpoint.is_reached(rig.statusword)), (-3000, true), "changed on the way");

    // A set of set-points: each is reached, none is skipped.
    for target in [1000, 3000, 2000] {
        assert!(rig.setpoint.push(rig.now, Move::to(target).after()));
    }
    let mut turns = Vec::new();
    for _ in 0..12_000 {
        let (before, speed) = (rig.twin.load.speed, rig.twin.load.position);
        rig.run(1);
        if before != 0.0 && rig.twin.load.speed == 0.0 {
            turns.push(speed.round() as i32);
        }
    }
    assert_eq!((turns, rig.setpoint.is_reached(rig.statusword)), ([1000, 3000, 2000].to_vec(), true));
}

#[test]
fn set_points_that_blend_are_passed_without_a_stop() {
    let mut rig = Rig::enabled(Mode::ProfilePosition);
    rig.setpoint.push(rig.now, Move::to(3000));
    rig.setpoint.push(rig.now, Move::to(6000).blending());
    let mut stops = 0;
    for _ in 0..8000 {
        let before = rig.twin.load.speed;
        rig.run(1);
        stops += u32::from(before != 0.0 && rig.twin.load.speed == 0.0);
    }
    assert_eq!((rig.position, stops), (6000, 1));
}

#[test]
fn a_relative_move_counts_from_the_target_before_it_and_is_never_made_twice() {
    let mut rig = Rig::enabled(Mode::ProfilePosition);
    rig.setpoint.set(rig.now, 1000);
    rig.run(3000);
    rig.setpoint.push(rig.now, Move::by(500));
    rig.run(3000);
    rig.setpoint.push(rig.now, Move::by(-200));
    rig.run(3000);
    assert_eq!(rig.position, 1300);
    while rig.setpoint.poll_event().is_some() {}
    // The drive takes it, but what it says is lost: nobody knows, so nobody repeats it.
    rig.mute = true;
    rig.setpoint.push(rig.now, Move::by(100));
    rig.run(500);
    rig.mute = false;
    rig.run(3000);
    assert_eq!(rig.setpoint.poll_event(), Some(SetpointEvent::Lost { distance: 100 }));
    assert_eq!((rig.setpoint.poll_event(), rig.twin.load.position.round()), (None, 1400.0));
}

#[test]
fn halt_keeps_the_target_and_goes_on_to_it() {
    let mut rig = Rig::enabled(Mode::ProfilePosition);
    rig.setpoint.set(rig.now, 8000);
    rig.run(1000);
    rig.axis.halt(true);
    rig.run(1000);
    let halted = rig.position;
    rig.run(1000);
    assert_eq!((rig.position, rig.twin.load.speed, rig.axis.is_enabled()), (halted, 0.0, true));
    assert_ne!(rig.statusword & status::TARGET_REACHED, 0, "it stands");
    assert!(halted < 8000);
    rig.axis.halt(false);
    rig.run(9000);
    assert_eq!(rig.position, 8000);
}

#[test]
fn the_way_of_a_halt_is_that_of_its_option_code() {
    // 2000 counts/s; 0x6084 = 2000, 0x6085 = 10 000, the current limit 1 000 000 counts/s².
    for (option, way) in [(1, 1000.0), (2, 200.0), (3, 2.0), (4, 2.0)] {
        let mut rig = Rig::with(&[(0x605D, option)]);
        rig.enable(Mode::ProfileVelocity);
        rig.piece = Piece::Velocity(2000);
        rig.run(2000);
        let from = rig.twin.load.position;
        rig.axis.halt(true);
        rig.run(3000);
        let went = rig.twin.load.position - from;
        assert!((way..way + 8.0).contains(&went), "{option}: {went}");
        assert!(rig.axis.is_enabled());
    }
}

#[test]
fn a_velocity_is_tracked_by_its_ramps_and_its_bits_say_so() {
    let mut rig = Rig::enabled(Mode::ProfileVelocity);
    assert!(VelocityStatus::decode(rig.statusword).stands);
    rig.piece = Piece::Velocity(2000);
    rig.run(500);
    assert!((rig.twin.load.speed - 1000.0).abs() < 10.0, "2000 counts/s²: {}", rig.twin.load.speed);
    let status = VelocityStatus::decode(rig.statusword);
    assert!(!status.reached && !status.stands);
    rig.run(600);
    assert!(VelocityStatus::decode(rig.statusword).reached);
    // Its limit (0x607F) is 5000.
    rig.piece = Piece::Velocity(-9000);
    rig.run(5000);
    assert_eq!((rig.velocity, rig.twin.load.speed), (-5000, -5000.0));
}

#[test]
fn quick_stop_options_stop_their_way_and_end_in_their_state() {
    use PowerState::{QuickStopActive, SwitchOnDisabled};
    for (option, way, end) in [
        (0, 2000.0, SwitchOnDisabled), // friction alone: 1000 counts/s²
        (1, 1000.0, SwitchOnDisabled),
        (2, 200.0, SwitchOnDisabled),
        (3, 2.0, SwitchOnDisabled),
        (4, 2.0, SwitchOnDisabled),
        (5, 1000.0, QuickStopActive),
        (6, 200.0, QuickStopActive),
        (7, 2.0, QuickStopActive),
        (8, 2.0, QuickStopActive),
    ] {
        let mut rig = Rig::with(&[(0x605A, option)]);
        rig.enable(Mode::ProfileVelocity);
        rig.piece = Piece::Velocity(2000);
        rig.run(2000);
        let from = rig.twin.load.position;
        rig.axis.set_goal(rig.now, Goal::QuickStop);
        rig.run(3000);
        let went = rig.twin.load.position - from;
        assert!((way..way + 8.0).contains(&went), "{option}: {went}");
        assert_eq!(rig.axis.state(), Some(end), "{option}");
        rig.piece = Piece::Velocity(0);
        rig.axis.set_goal(rig.now, Goal::Enabled);
        rig.run(100);
        assert!(rig.axis.is_enabled(), "{option}: up again from {end}");
    }
}

#[test]
fn disabling_by_ramp_or_at_once_and_shutting_down() {
    // Object, option, controlword, way, state.
    for (object, option, word, way, end) in [
        (0x605C, 0, 0x07, 2000.0, PowerState::SwitchedOn),
        (0x605C, 1, 0x07, 1000.0, PowerState::SwitchedOn),
        (0x605B, 0, 0x06, 2000.0, PowerState::ReadyToSwitchOn),
        (0x605B, 1, 0x06, 1000.0, PowerState::ReadyToSwitchOn),
        (0x605B, 1, 0x00, 2000.0, PowerState::SwitchOnDisabled),
    ] {
        let mut rig = Rig::with(&[(object, option)]);
        rig.enable(Mode::ProfileVelocity);
        rig.piece = Piece::Velocity(2000);
        rig.run(2000);
        let from = rig.twin.load.position;
        rig.word = Some(word);
        rig.run(3000);
        let went = rig.twin.load.position - from;
        assert!((way..way + 8.0).contains(&went), "{object:04X} = {option}: {went}");
        assert_eq!(rig.twin.servo().drive().state(), end, "{object:04X} = {option}");
    }
}

#[test]
fn a_fault_on_the_way_stops_as_its_option_says_and_ends_in_fault() {
    for (option, way) in [(0, 2000.0), (1, 1000.0), (2, 200.0), (3, 2.0), (4, 2.0)] {
        let mut rig = Rig::with(&[(0x605E, option)]);
        rig.enable(Mode::ProfileVelocity);
        rig.piece = Piece::Velocity(2000);
        rig.run(2000);
        let from = rig.twin.load.position;
        rig.twin.fault(rig.now, 0x2310);
        rig.run(3000);
        let went = rig.twin.load.position - from;
        assert!((way - 2.0..way + 8.0).contains(&went), "{option}: {went}");
        assert_eq!((rig.axis.state(), rig.axis.goal()), (Some(PowerState::Fault), Goal::Disabled));
        assert_eq!(rig.emergencies, [(0x2310, 0x03)]);
        rig.axis.reset_fault(rig.now);
        rig.run(100);
        assert_eq!(rig.axis.state(), Some(PowerState::SwitchOnDisabled));
        assert_eq!(rig.emergencies.last(), Some(&(0, 0)));
        rig.axis.release();
        rig.axis.set_goal(rig.now, Goal::Enabled);
        rig.run(2000);
        assert!(rig.axis.is_enabled() && rig.velocity == 2000);
    }
}

#[test]
fn a_silent_master_is_what_0x6007_makes_of_it() {
    use PowerState::{Fault, OperationEnabled, SwitchOnDisabled};
    for (option, way, end) in
        [(0, 5000.0, OperationEnabled), (1, 200.0, Fault), (2, 2000.0, SwitchOnDisabled), (3, 200.0, SwitchOnDisabled)]
    {
        let mut rig = Rig::with(&[(0x6007, option)]);
        rig.enable(Mode::ProfileVelocity);
        rig.piece = Piece::Velocity(2000);
        rig.run(2000);
        rig.master_dead = true;
        // From the last heartbeat on: 200 ms at most at 2000 counts/s.
        let from = rig.twin.load.position;
        rig.run(2500);
        let went = rig.twin.load.position - from;
        assert!((way..way + 410.0).contains(&went) || option == 0 && went == way, "{option}: {went}");
        assert_eq!(rig.twin.servo().drive().state(), end, "{option}");
    }
}

#[test]
fn cyclic_positions_are_followed_and_a_starved_axis_holds() {
    for mode in [Mode::CyclicPosition, Mode::Interpolated] {
        let mut rig = Rig::enabled(mode);
        let config = CyclicConfig { mode, patience: 3, max_step: 100 };
        let mut cyclic = Cyclic::new(config);
        cyclic.restart(rig.position);
        rig.piece = Piece::Cyclic(cyclic);
        // 20 counts each 10 ms.
        for n in 1..=200 {
            assert!(rig.cyclic().set(n * 20));
            rig.run(PERIOD);
            assert!(
                (rig.twin.load.position - f64::from(n * 20)).abs() < 61.0,
                "{mode} {n}: {}",
                rig.twin.load.position
            );
            if n > 10 {
                assert!((rig.twin.load.speed - 2000.0).abs() < 1.0, "in a straight line: {}", rig.twin.load.speed);
            }
        }
        assert!(CyclicStatus::decode(rig.statusword).follows);
        rig.run(10 * PERIOD);
        assert_eq!(rig.cyclic().stopped(), Some(Stopped::Starved), "{mode}");
        assert_eq!((rig.twin.load.position, rig.twin.load.speed), (4000.0, 0.0), "{mode}");
        assert!(!rig.cyclic().set(4020), "what comes late is refused");
        rig.run(PERIOD);
        let here = rig.position;
        rig.cyclic().restart(here);
        assert!(!rig.cyclic().set(here + 101), "a jump is refused");
        assert_eq!(rig.cyclic().stopped(), Some(Stopped::Step { from: here, to: here + 101 }));
        rig.run(20 * PERIOD);
        assert_eq!(rig.twin.load.position, 4000.0);
    }
}

#[test]
fn cyclic_velocities_are_followed_and_a_starved_axis_stands() {
    let mut rig = Rig::enabled(Mode::CyclicVelocity);
    let mut cyclic = Cyclic::new(CyclicConfig { mode: Mode::CyclicVelocity, patience: 3, max_step: 50 });
    cyclic.restart(0);
    rig.piece = Piece::Cyclic(cyclic);
    for n in 1..=50 {
        assert!(rig.cyclic().set(n * 20));
        rig.run(PERIOD);
    }
    assert!((980.0..=1000.0).contains(&rig.twin.load.speed), "{}", rig.twin.load.speed);
    rig.run(6 * PERIOD);
    assert_eq!((rig.cyclic().stopped(), rig.twin.load.speed), (Some(Stopped::Starved), 0.0));
}

#[test]
fn a_drive_that_cannot_follow_says_so_and_faults() {
    let mut rig = Rig::enabled(Mode::CyclicPosition);
    let mut cyclic = Cyclic::new(CyclicConfig { mode: Mode::CyclicPosition, patience: 3, max_step: 100 });
    cyclic.restart(0);
    rig.piece = Piece::Cyclic(cyclic);
    rig.twin.load.blocked = true;
    let mut lagged = false;
    for n in 1..=60 {
        rig.cyclic().set(n * 20);
        rig.run(PERIOD);
        lagged |= CyclicStatus::decode(rig.statusword).following_error;
    }
    // 0x6065 = 500 for 0x6066 = 100 ms.
    assert_eq!(rig.emergencies, [(0x8611, 0x21)]);
    assert_eq!(rig.axis.state(), Some(PowerState::Fault));
    assert!(!lagged, "fault and bit 13 are of one moment, and the fault forgets the mode's bits");
}

#[test]
fn the_mode_is_switched_while_enabled_and_in_motion() {
    let mut rig = Rig::enabled(Mode::ProfileVelocity);
    rig.piece = Piece::Velocity(2000);
    rig.run(2000);
    rig.switch(Mode::ProfilePosition);
    rig.piece = Piece::Position;
    rig.run(1500);
    assert_eq!((rig.twin.load.speed, rig.axis.is_enabled()), (0.0, true), "without a target it stands");
    let target = rig.position + 1000;
    rig.setpoint.set(rig.now, target);
    rig.run(4000);
    assert_eq!(rig.position, target);
    rig.piece = Piece::Velocity(-1000);
    rig.switch(Mode::ProfileVelocity);
    rig.run(2000);
    assert_eq!(rig.velocity, -1000);
}

#[test]
fn a_mode_that_the_drive_does_not_have_is_not_shown() {
    let mut rig = Rig::with(&[(0x6502, 0x25)]);
    rig.enable(Mode::ProfileVelocity);
    assert_eq!(rig.try_switch(Mode::CyclicPosition), Err(SwitchError::NotShown { shown: Some(3) }));
    assert_eq!(rig.twin.servo().mode(), Some(Mode::ProfileVelocity));
}

/// Where the home position lies, in counts from the middle of the home switch.
fn home_of(method: i8, start: f64) -> Result<f64, HomingError> {
    let mut rig = Rig::at(Load { position: start, ..Load::default() });
    rig.enable(Mode::ProfilePosition);
    rig.home(method, 100)?;
    // The raw position that counts as 100 is home.
    Ok(rig.twin.load.position - f64::from(rig.read(0x6064)) + 100.0)
}

#[test]
fn homing_methods_end_at_the_edges_that_the_standard_draws() {
    // From left of the switch, on it, right of it. Switch from -2300 to 2300, index each 1000, limits at ±20 000.
    for (methods, home, index) in [
        ([1, 17], -20_000.0, -19_000.0),
        ([2, 18], 20_000.0, 19_000.0),
        ([7, 23], -2300.0, -3000.0),
        ([8, 24], -2300.0, -2000.0),
        ([9, 25], 2300.0, 2000.0),
        ([10, 26], 2300.0, 3000.0),
        ([11, 27], 2300.0, 3000.0),
        ([12, 28], 2300.0, 2000.0),
        ([13, 29], -2300.0, -2000.0),
        ([14, 30], -2300.0, -3000.0),
    ] {
        for start in [-6000.0, 300.0, 6000.0] {
            for (method, expected) in [(methods[0], index), (methods[1], home)] {
                let found = home_of(method, start).unwrap_or_else(|error| panic!("{method} from {start}: {error}"));
                assert!((found - expected).abs() <= 2.0, "{method} from {start}: {found}, not {expected}");
            }
        }
    }
    assert!((home_of(33, 300.0).unwrap() - 0.0).abs() <= 2.0);
    assert!((home_of(34, 300.0).unwrap() - 1000.0).abs() <= 2.0);
    assert!((home_of(35, 300.0).unwrap() - 300.0).abs() <= 2.0);
    assert!((home_of(37, 300.0).unwrap() - 300.0).abs() <= 2.0);
}

#[test]
fn homing_to_a_one_sided_home_switch_needs_no_limit() {
    // Active from 2300 on for 3, 4, 19, 20; up to -2300 for 5, 6, 21, 22.
    for (methods, home, index, switch) in [
        ([3, 19], 2300.0, 2000.0, [2300.0, 1e9]),
        ([4, 20], 2300.0, 3000.0, [2300.0, 1e9]),
        ([5, 21], -2300.0, -2000.0, [-1e9, -2300.0]),
        ([6, 22], -2300.0, -3000.0, [-1e9, -2300.0]),
    ] {
        for start in [-5000.0, 5000.0] {
            for (method, expected) in [(methods[0], index), (methods[1], home)] {
                let mut rig = Rig::at(Load { position: start, home: switch, ..Load::default() });
                rig.enable(Mode::ProfilePosition);
                rig.home(method, 0).unwrap_or_else(|error| panic!("{method} from {start}: {error}"));
                let found = rig.twin.load.position - f64::from(rig.read(0x6064));
                assert!((found - expected).abs() <= 2.0, "{method} from {start}: {found}, not {expected}");
            }
        }
    }
}

#[test]
fn homing_without_a_switch_fails_at_the_second_limit() {
    let nowhere = Load { home: [1e9, 1e9], ..Load::default() };
    let mut rig = Rig::at(nowhere);
    rig.enable(Mode::ProfilePosition);
    assert_eq!(rig.home(23, 0), Err(HomingError::Refused));
    assert!(rig.twin.load.position <= -19_000.0, "it looked on both sides: {}", rig.twin.load.position);
    for number in [0, 15, 31, 36, 99, -1] {
        assert!(Method::of(number).is_none());
        assert_eq!(rig.home(number, 0), Err(HomingError::Refused), "{number}");
    }
}

#[test]
fn a_fault_ends_homing_and_the_axis_is_not_homed() {
    let mut rig = Rig::at(Load { position: -15_000.0, ..Load::default() });
    rig.enable(Mode::ProfilePosition);
    rig.start_homing(23, 0);
    rig.run(1000);
    rig.twin.fault(rig.now, 0x2310);
    rig.run(Duration::from_secs(3).as_millis() as u32);
    assert!(!rig.twin.servo().is_homed());
    assert_eq!(rig.axis.state(), Some(PowerState::Fault));
}

#[test]
fn a_drive_at_rest_wakes_for_its_heartbeat_alone() {
    let mut rig = Rig::enabled(Mode::ProfilePosition);
    rig.setpoint.set(rig.now, 1000);
    rig.run(4000);
    let next = rig.twin.poll_timeout().unwrap();
    assert!(next > rig.now + Duration::from_millis(1), "{next:?} at {:?}", rig.now);
}
