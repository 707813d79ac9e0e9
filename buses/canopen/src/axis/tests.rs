//! The tables of CiA 402 as text, and the walk of a master against a drive.

use super::drive::{Drive, Kind, Motion, Passage};
use super::options::{Options, Stop};
use super::*;
use base::{Duration, Instant};
use std::string::String;
use std::vec::Vec;
use std::{format, vec};

const MS: Duration = Duration::from_millis(1);

#[test]
fn statuswords_name_the_states_of_the_facts() {
    use PowerState::*;
    // EPOS's full patterns (Firmware Specification, 8.1), Refresh and Measure Init among them, then others' plain ones.
    for (word, state) in [
        (0x0100, NotReady),
        (0x0140, SwitchOnDisabled),
        (0x0121, ReadyToSwitchOn),
        (0x0123, SwitchedOn),
        (0x4123, SwitchedOn),
        (0x0133, SwitchedOn),
        (0x0137, OperationEnabled),
        (0x0117, QuickStopActive),
        (0x010F, FaultReactionActive),
        (0x011F, FaultReactionActive),
        (0x0108, Fault),
        (0x0250, SwitchOnDisabled),
        (0x0231, ReadyToSwitchOn),
        (0x0637, OperationEnabled),
        (0x0028, Fault),
    ] {
        assert_eq!(PowerState::decode(word), Some(state), "{word:04X}");
    }
    assert_eq!(PowerState::decode(0x0001), None);
    for state in PowerState::ALL {
        assert_eq!(PowerState::decode(state.encode()), Some(state));
        assert_eq!(PowerState::decode(state.encode() | 0xFF80), Some(state));
    }
}

/// A drive in `state`.
fn drive_in(state: PowerState, option: i16) -> Drive {
    use PowerState::*;
    let mut drive = Drive::new(option, false);
    let words: &[u16] = match state {
        NotReady => panic!("left by itself"),
        SwitchOnDisabled => &[],
        ReadyToSwitchOn => &[6],
        SwitchedOn => &[6, 7],
        OperationEnabled | FaultReactionActive | Fault => &[6, 7, 15],
        QuickStopActive => &[6, 7, 15, 2],
    };
    for word in words {
        drive.apply(*word);
    }
    if matches!(state, FaultReactionActive | Fault) {
        drive.fault();
    }
    if state == Fault {
        drive.fault_reaction_done();
    }
    assert_eq!(drive.state(), state);
    drive
}

#[test]
fn a_drive_takes_the_transitions_of_the_standard_and_no_others() {
    let mut table = String::new();
    for state in &PowerState::ALL[1..] {
        table += &format!("{state:24}");
        for word in [0x00, 0x06, 0x07, 0x0F, 0x02, 0x0B, 0x80] {
            let mut drive = drive_in(*state, 6);
            let taken = drive.apply(word);
            table += &match taken.first() {
                Some(transition) => format!("{transition:4}"),
                None => String::from("   -"),
            };
        }
        table += "\n";
    }
    let expected = "
                          00  06  07  0F  02  0B  80
switch on disabled         -   2   -   -   -   -   -
ready to switch on         7   -   3   3   7   7   -
switched on               10   6   -   4  10  10   -
operation enabled          9   8   5   -  11  11   -
quick stop active         12   -   -  16   -   -   -
fault reaction active      -   -   -   -   -   -   -
fault                      -   -   -   -   -   -  15
";
    let rows: Vec<_> = expected.lines().skip(2).collect();
    assert_eq!(table.lines().collect::<Vec<_>>(), rows);
}

#[test]
fn options_of_quick_stop_and_faults_are_obeyed() {
    let mut drive = drive_in(PowerState::QuickStopActive, 2);
    assert!(drive.apply(0x0F).is_empty(), "option 2 does not resume");
    assert_eq!((drive.stands(), drive.state()), (Some(12), PowerState::SwitchOnDisabled));
    assert_eq!(drive_in(PowerState::QuickStopActive, 6).stands(), None);
    assert_eq!(drive_in(PowerState::OperationEnabled, 0).apply(0x02).as_slice(), [11, 12]);

    let mut drive = drive_in(PowerState::OperationEnabled, 6);
    assert_eq!((drive.fault(), drive.fault()), (Some(13), None));
    drive.apply(0x80);
    assert_eq!(drive.fault_reaction_done(), Some(14));
    assert!(drive.apply(0x80).is_empty(), "no rising edge");
    drive.apply(0x00);
    assert_eq!(drive.apply(0x8F).as_slice(), [15]);

    let mut quick = Drive::new(6, true);
    quick.apply(6);
    assert_eq!(quick.apply(0x0F).as_slice(), [3, 4]);
}

/// What a master commands for goal and state.
#[test]
fn the_commands_for_each_goal_and_state() {
    let mut table = String::new();
    for state in PowerState::ALL {
        table += &format!("{state:24}");
        for (goal, resumes) in
            [(Goal::Disabled, true), (Goal::Enabled, false), (Goal::Enabled, true), (Goal::QuickStop, true)]
        {
            let mut axis = Axis::new(AxisConfig { resumes, ..AxisConfig::default() });
            axis.handle_statusword(Instant::ZERO, state.encode());
            axis.set_goal(Instant::ZERO, goal);
            table += &format!("  {:02X}", axis.controlword());
        }
        table += "\n";
    }
    let expected = "
                         dis  en  en* quick     (* T16 allowed; after a fault Enabled is QuickStop)
not ready to switch on    00  00  00  02
switch on disabled        00  06  06  02
ready to switch on        00  07  07  02
switched on               06  0F  0F  02
operation enabled         07  0F  0F  02
quick stop active         00  00  0F  02
fault reaction active     00  02  02  02
fault                     00  00  00  00
";
    let rows: Vec<_> = expected.lines().skip(2).collect();
    assert_eq!(table.lines().collect::<Vec<_>>(), rows);
}

/// An axis and a drive that answers each controlword at once, for `steps` ms.
fn walk(axis: &mut Axis, drive: &mut Drive, now: &mut Instant, steps: u32) -> Vec<AxisEvent> {
    let mut events = vec![];
    for _ in 0..steps {
        drive.apply(axis.controlword());
        axis.handle_statusword(*now, drive.statusword());
        *now += MS;
        axis.handle_timeout(*now);
        events.extend(core::iter::from_fn(|| axis.poll_event()));
    }
    events
}

#[test]
fn an_axis_walks_up_stops_resumes_and_walks_down() {
    for resumes in [false, true] {
        let mut axis = Axis::new(AxisConfig { resumes, ..AxisConfig::default() });
        let (mut drive, mut now) = (Drive::new(6, false), Instant::ZERO);
        walk(&mut axis, &mut drive, &mut now, 100);
        assert_eq!(drive.state(), PowerState::SwitchOnDisabled, "never without being told");
        for _ in 0..3 {
            axis.set_goal(now, Goal::Enabled);
            let events = walk(&mut axis, &mut drive, &mut now, 10);
            assert_eq!((events.last(), axis.is_enabled()), (Some(&AxisEvent::Reached(Goal::Enabled)), true));
            axis.set_goal(now, Goal::QuickStop);
            let events = walk(&mut axis, &mut drive, &mut now, 10);
            assert_eq!(events.last(), Some(&AxisEvent::Reached(Goal::QuickStop)));
            assert_eq!(drive.state(), PowerState::QuickStopActive);
        }
        axis.set_goal(now, Goal::Enabled);
        walk(&mut axis, &mut drive, &mut now, 10);
        axis.set_goal(now, Goal::Disabled);
        let events = walk(&mut axis, &mut drive, &mut now, 10);
        assert_eq!(events.last(), Some(&AxisEvent::Reached(Goal::Disabled)));
        assert_eq!((drive.state(), axis.poll_timeout()), (PowerState::SwitchOnDisabled, None));
    }
}

#[test]
fn a_fault_is_told_once_and_needs_a_reset_and_a_new_goal() {
    let mut axis = Axis::new(AxisConfig::default());
    let (mut drive, mut now) = (Drive::new(6, false), Instant::ZERO);
    axis.set_goal(now, Goal::Enabled);
    walk(&mut axis, &mut drive, &mut now, 10);
    drive.fault();
    let mut events = walk(&mut axis, &mut drive, &mut now, 10);
    drive.fault_reaction_done();
    events.extend(walk(&mut axis, &mut drive, &mut now, 3000));
    let faults = events.iter().filter(|event| matches!(event, AxisEvent::Fault { .. })).count();
    assert_eq!((faults, axis.goal(), drive.state()), (1, Goal::Disabled, PowerState::Fault));
    axis.reset_fault(now);
    assert_eq!(axis.controlword(), 0, "first low");
    walk(&mut axis, &mut drive, &mut now, 100);
    assert_eq!(drive.state(), PowerState::SwitchOnDisabled, "reset, not enabled");
    // A caller that repeats its goal is no deliberate act.
    axis.set_goal(now, Goal::Enabled);
    walk(&mut axis, &mut drive, &mut now, 100);
    assert_eq!((axis.is_locked(), drive.state()), (true, PowerState::SwitchOnDisabled));
    axis.release();
    axis.set_goal(now, Goal::Enabled);
    walk(&mut axis, &mut drive, &mut now, 10);
    assert!(axis.is_enabled());
}

#[test]
fn a_release_during_a_fault_is_none() {
    let mut axis = Axis::new(AxisConfig::default());
    axis.handle_statusword(Instant::ZERO, 0x08);
    axis.release();
    assert!(axis.is_locked());
}

#[test]
fn a_fault_that_stays_is_reset_by_a_fresh_edge_each_time() {
    let mut axis = Axis::new(AxisConfig::default());
    let mut now = Instant::ZERO;
    axis.handle_statusword(now, 0x08);
    for _ in 0..3 {
        let mut words = vec![];
        axis.reset_fault(now);
        for _ in 0..2000 {
            words.push(axis.controlword());
            now += MS;
            axis.handle_timeout(now);
        }
        let edges = words.windows(2).filter(|pair| pair[0] & 0x80 == 0 && pair[1] & 0x80 != 0).count();
        assert_eq!((words[0], edges, words.last()), (0, 1, Some(&0)));
        let stuck = core::iter::from_fn(|| axis.poll_event()).any(|event| matches!(event, AxisEvent::Stuck { .. }));
        assert!(stuck);
    }
}

#[test]
fn an_axis_that_drops_out_is_not_enabled_again_by_itself() {
    let mut axis = Axis::new(AxisConfig::default());
    let (mut drive, mut now) = (Drive::new(6, false), Instant::ZERO);
    axis.set_goal(now, Goal::Enabled);
    walk(&mut axis, &mut drive, &mut now, 10);
    let mut drive = Drive::new(6, false);
    let events = walk(&mut axis, &mut drive, &mut now, 100);
    let dropped = AxisEvent::Dropped { to: PowerState::SwitchOnDisabled, statusword: 0x40 };
    assert!(events.contains(&dropped), "{events:?}");
    assert_eq!((axis.goal(), drive.state()), (Goal::Disabled, PowerState::SwitchOnDisabled));
    axis.set_goal(now, Goal::Enabled);
    walk(&mut axis, &mut drive, &mut now, 100);
    assert_eq!(drive.state(), PowerState::SwitchOnDisabled);
    axis.release();
    axis.set_goal(now, Goal::Enabled);
    walk(&mut axis, &mut drive, &mut now, 10);
    assert_eq!(drive.state(), PowerState::OperationEnabled);
    axis.lost();
    assert!(axis.is_locked());
    assert_eq!((axis.state(), axis.goal(), axis.controlword()), (None, Goal::Disabled, 0));
}

#[test]
fn a_transition_that_does_not_come_is_named_once() {
    let mut axis = Axis::new(AxisConfig::default());
    axis.handle_statusword(Instant::ZERO, 0x0221);
    axis.set_goal(Instant::ZERO, Goal::Enabled);
    let until = Instant::from_millis(1000);
    assert_eq!(axis.poll_timeout(), Some(until));
    axis.handle_timeout(until);
    axis.handle_timeout(until + MS);
    let events: Vec<_> = core::iter::from_fn(|| axis.poll_event()).collect();
    let state = Some(PowerState::ReadyToSwitchOn);
    let stuck =
        AxisEvent::Stuck { state, goal: Goal::Enabled, statusword: 0x0221, controlword: 7, why: Why::NoVoltage };
    assert_eq!(events.iter().filter(|event| **event == stuck).count(), 1, "{events:?}");
    assert_eq!(axis.poll_timeout(), None);
}

#[test]
fn a_stop_and_a_start_in_one_breath_are_no_drop() {
    let mut axis = Axis::new(AxisConfig { resumes: true, ..AxisConfig::default() });
    let (mut drive, mut now) = (Drive::new(6, false), Instant::ZERO);
    axis.set_goal(now, Goal::Enabled);
    walk(&mut axis, &mut drive, &mut now, 10);
    axis.set_goal(now, Goal::QuickStop);
    drive.apply(axis.controlword());
    axis.set_goal(now, Goal::Enabled);
    let events = walk(&mut axis, &mut drive, &mut now, 10);
    assert!(!events.iter().any(|event| matches!(event, AxisEvent::Dropped { .. })), "{events:?}");
    assert!(axis.is_enabled());
}

#[test]
fn a_drive_that_is_switched_on_is_not_ready_until_its_self_test_is_over() {
    let mut drive = Drive::power_on(Kind::Standard { enables_from_ready: false }, Options::default());
    assert_eq!((drive.state(), drive.motion()), (PowerState::NotReady, Motion::Off));
    assert!(drive.apply(0x06).is_empty(), "it does not listen yet");
    assert_eq!((drive.initialised(), drive.initialised()), (Some(1), None));
    assert_eq!(drive.state(), PowerState::SwitchOnDisabled);
    let mut broken = Drive::power_on(Kind::Epos, Options::EPOS);
    assert_eq!((broken.fault(), broken.state(), broken.initialised()), (Some(13), PowerState::Fault, None));
}

#[test]
fn an_epos_passes_through_refresh_and_measure_init() {
    let up = || {
        let mut epos = Drive::power_on(Kind::Epos, Options::EPOS);
        epos.initialised();
        epos.apply(0x06);
        assert_eq!(epos.apply(0x0F).as_slice(), [3, 4]);
        epos
    };
    let mut epos = up();
    assert_eq!((epos.state(), epos.passage()), (PowerState::SwitchedOn, Some(Passage::Refresh)));
    assert_eq!((epos.passed(), epos.passage()), (Some(20), Some(Passage::MeasureInit)));
    assert_eq!((epos.state(), epos.motion(), epos.statusword()), (PowerState::SwitchedOn, Motion::Off, 0x23));
    assert!(epos.apply(0x0F).is_empty(), "it is on its way");
    assert_eq!((epos.passed(), epos.state(), epos.passed()), (Some(21), PowerState::OperationEnabled, None));
    // Out of the passages by every command but enable.
    for (word, taken, state) in [
        (0x00, 10, PowerState::SwitchOnDisabled),
        (0x02, 10, PowerState::SwitchOnDisabled),
        (0x0B, 10, PowerState::SwitchOnDisabled),
        (0x06, 6, PowerState::ReadyToSwitchOn),
        (0x07, 5, PowerState::SwitchedOn),
    ] {
        let mut epos = up();
        epos.passed();
        assert_eq!(epos.apply(word).as_slice(), [taken], "{word:02X}");
        assert_eq!((epos.state(), epos.passage()), (state, None));
    }
    // A fault on the way up has nothing to brake; one in motion is T17 and T18.
    let mut epos = up();
    assert_eq!((epos.fault_by(Stop::QuickStop), epos.state()), (Some(13), PowerState::Fault));
    let mut epos = up();
    assert_eq!([epos.passed(), epos.passed()], [Some(20), Some(21)]);
    assert_eq!((epos.fault_by(Stop::QuickStop), epos.stands()), (Some(17), Some(18)));
    assert_eq!((epos.state(), epos.apply(0x80).as_slice()), (PowerState::Fault, &[15][..]));
}

#[test]
fn every_option_code_says_how_it_stops() {
    use Stop::*;
    let options = |code| Options { quick_stop: code, halt: code, fault: code, ..Options::default() };
    let stops = [Coast, SlowDown, QuickStop, CurrentLimit, VoltageLimit];
    for (code, stop) in (0..).zip(stops) {
        assert_eq!((options(code).quick_stop(), options(code).fault()), ((stop, false), stop), "{code}");
        let halts = if stop == Coast { SlowDown } else { stop };
        assert_eq!(options(code).halt(), halts, "a halt keeps the power: {code}");
        if stop != Coast {
            assert_eq!(options(code + 4).quick_stop(), (stop, true), "{code}");
        }
    }
    for code in [-1, 9, i16::MIN, i16::MAX] {
        let unknown = options(code);
        assert_eq!((unknown.quick_stop(), unknown.halt(), unknown.fault()), ((QuickStop, false), SlowDown, QuickStop));
    }
}

#[test]
fn a_ramp_on_the_way_out_can_be_taken_back() {
    let options = Options { shutdown: 1, ..Options::default() };
    let mut drive = Drive::power_on(Kind::Standard { enables_from_ready: true }, options);
    drive.initialised();
    for word in [0x06, 0x0F] {
        drive.apply(word);
    }
    assert!(drive.apply(0x07).is_empty());
    assert_eq!((drive.state(), drive.motion()), (PowerState::OperationEnabled, Motion::Stop(Stop::SlowDown)));
    assert!(drive.apply(0x0F).is_empty());
    assert_eq!((drive.motion(), drive.stands()), (Motion::Follow, None));
    drive.apply(0x06);
    assert_eq!((drive.stands(), drive.state()), (Some(8), PowerState::ReadyToSwitchOn));
}

#[test]
fn a_lost_connection_is_what_0x6007_makes_of_it() {
    use PowerState::{FaultReactionActive, OperationEnabled, QuickStopActive, SwitchOnDisabled};
    for (code, transition, state) in [
        (0, None, OperationEnabled),
        (1, Some(13), FaultReactionActive),
        (2, Some(9), SwitchOnDisabled),
        (3, Some(11), QuickStopActive),
    ] {
        let options = Options { abort_connection: code, ..Options::default() };
        let mut drive = Drive::power_on(Kind::Standard { enables_from_ready: true }, options);
        drive.initialised();
        for word in [0x06, 0x0F] {
            drive.apply(word);
        }
        assert_eq!((drive.connection_lost(), drive.state()), (transition, state), "{code}");
    }
}

#[test]
fn halt_is_a_bit_of_the_enabled_axis_alone() {
    let mut axis = Axis::new(AxisConfig { resumes: true, ..AxisConfig::default() });
    let (mut drive, mut now) = (Drive::new(6, false), Instant::ZERO);
    axis.halt(true);
    axis.set_goal(now, Goal::Enabled);
    walk(&mut axis, &mut drive, &mut now, 10);
    assert_eq!((axis.controlword(), axis.is_enabled()), (0x010F, true));
    axis.halt(false);
    assert_eq!(axis.controlword(), 0x000F);
    axis.halt(true);
    axis.set_goal(now, Goal::QuickStop);
    assert_eq!(axis.controlword(), 0x0002);
}

#[test]
fn what_is_stuck_says_why_as_far_as_the_statusword_tells() {
    let told = |statusword: Option<u16>, goal| {
        let mut axis = Axis::new(AxisConfig::default());
        if let Some(statusword) = statusword {
            axis.handle_statusword(Instant::ZERO, statusword);
        }
        axis.set_goal(Instant::ZERO, goal);
        axis.handle_timeout(axis.poll_timeout().unwrap());
        core::iter::from_fn(|| axis.poll_event()).find_map(|event| match event {
            AxisEvent::Stuck { why, .. } => Some(why),
            _ => None,
        })
    };
    for (statusword, goal, why) in [
        (None, Goal::Enabled, Why::Unseen),
        (Some(0x0200), Goal::Enabled, Why::NotReady),
        (Some(0x0040), Goal::Enabled, Why::NotRemote),
        (Some(0x0231), Goal::Enabled, Why::Refused),
        (Some(0x0221), Goal::Enabled, Why::NoVoltage),
        (Some(0x0237), Goal::Disabled, Why::Ramp),
        (Some(0x021F), Goal::Enabled, Why::Braking),
    ] {
        assert_eq!(told(statusword, goal), Some(why), "{statusword:04X?}");
    }
    assert_eq!(format!("{}", StatusBits(0x1637)), "voltage, remote, target reached, bit 12");
    assert_eq!(format!("{}", StatusBits(0x0040)), "no bit");
}
