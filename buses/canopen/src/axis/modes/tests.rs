//! The handshakes against a drive that follows the text.

use super::cyclic::{Cyclic, CyclicConfig, Stopped, interpolation_period};
use super::hm::{Homing, HomingConfig, HomingError, Progress};
use super::method::{self, Method};
use super::pp::{Move, Setpoint, SetpointEvent};
use super::switch::{Access, Switch, SwitchError};
use super::*;
use crate::drives::{epos, icla};
use crate::{Dictionary, Payload, sdo};
use base::{Duration, Instant};
use std::vec::Vec;

const MS: Duration = Duration::from_millis(1);

/// A drive that samples the set-point bits each millisecond (CiA 402-2, Figure 14).
#[derive(Default)]
struct Positioner {
    raised: bool,
    taken: Vec<i32>,
    deaf: u32,
}

impl Positioner {
    fn sample(&mut self, (bits, target): (u16, i32)) -> u16 {
        let new = bits & 0x10 != 0;
        if new && !self.raised {
            if self.deaf > 0 {
                self.deaf -= 1;
                self.raised = true;
                return 0x0237;
            }
            self.taken.push(target);
        }
        self.raised = new;
        if new && self.taken.last() == Some(&target) { 0x1237 } else { 0x0237 }
    }
}

fn drive_to(setpoint: &mut Setpoint, positioner: &mut Positioner, now: &mut Instant, millis: u32) {
    for _ in 0..millis {
        let statusword = positioner.sample(setpoint.command());
        setpoint.handle_statusword(*now, statusword);
        *now += MS;
        setpoint.handle_timeout(*now);
    }
}

#[test]
fn each_target_gets_its_edge_and_the_newest_wins() {
    let mut setpoint = Setpoint::new(Duration::from_millis(100));
    let (mut positioner, mut now) = (Positioner::default(), Instant::ZERO);
    drive_to(&mut setpoint, &mut positioner, &mut now, 5);
    assert!(positioner.taken.is_empty());
    setpoint.set(now, 100);
    setpoint.set(now, 200);
    setpoint.set(now, 300);
    drive_to(&mut setpoint, &mut positioner, &mut now, 20);
    assert_eq!(positioner.taken, [100, 300]);
    setpoint.set(now, 300);
    drive_to(&mut setpoint, &mut positioner, &mut now, 20);
    assert_eq!((&positioner.taken[..], setpoint.accepted()), (&[100, 300][..], Some(300)));
    assert!(setpoint.is_reached(0x0637) && !setpoint.is_reached(0x0237));
    assert_eq!((setpoint.command(), setpoint.poll_timeout()), ((0x20, 300), None));
}

#[test]
fn a_lost_edge_is_repeated_with_a_fresh_one() {
    let mut setpoint = Setpoint::new(Duration::from_millis(100));
    let (mut positioner, mut now) = (Positioner { deaf: 2, ..Positioner::default() }, Instant::ZERO);
    setpoint.set(now, 7);
    drive_to(&mut setpoint, &mut positioner, &mut now, 110);
    setpoint.set(now, 9);
    drive_to(&mut setpoint, &mut positioner, &mut now, 300);
    assert_eq!(positioner.taken, [9]);
    let events: Vec<_> = core::iter::from_fn(|| setpoint.poll_event()).collect();
    let retried = |target, tries| SetpointEvent::Retried { target, tries };
    assert_eq!(events, [retried(7, 1), retried(9, 2), SetpointEvent::Accepted { target: 9 }]);
}

#[test]
fn an_acknowledge_left_over_is_waited_for() {
    let mut setpoint = Setpoint::new(Duration::from_millis(100));
    setpoint.handle_statusword(Instant::ZERO, 0x1237);
    setpoint.set(Instant::ZERO, 5);
    assert_eq!(setpoint.command().0 & 0x10, 0);
    setpoint.handle_statusword(Instant::ZERO + MS, 0x0237);
    assert_eq!(setpoint.command(), (0x30, 5));
    setpoint.reset(42);
    assert_eq!((setpoint.command(), setpoint.accepted()), ((0x20, 42), None));
}

fn homing() -> Homing {
    Homing::new(HomingConfig {
        method: 27,
        switch_speed: 300,
        zero_speed: 60,
        acceleration: None,
        offset: Some(-5),
        mode_after: 1,
        timeout: Duration::from_secs(30),
    })
}

/// Answers the transfers from a dictionary whose mode display follows at once; gives what was written.
fn serve(homing: &mut Homing, objects: &mut Dictionary, now: Instant) -> Vec<(u16, u32)> {
    let mut written = Vec::new();
    for _ in 0..100 {
        let Some(access) = homing.poll_sdo() else {
            break;
        };
        let result = match access {
            Access::Read { index, sub } => objects.read(index, sub).map_err(sdo::Error::Refused),
            Access::Write { index, sub, data } => {
                written.push((index, data.bits().unwrap()));
                let result = objects.write(index, sub, &data);
                objects.set(0x6061, 0, objects.get(0x6060, 0).unwrap());
                result.map(|()| Payload::EMPTY).map_err(sdo::Error::Refused)
            }
        };
        homing.handle_sdo(now, result);
    }
    written
}

#[test]
fn homing_sets_up_starts_waits_and_goes_back() {
    let (mut homing, mut objects, now) = (homing(), icla::dictionary(2), Instant::ZERO);
    objects.set(0x6060, 0, 1);
    homing.handle_statusword(now, 0x1637);
    homing.start();
    let written = serve(&mut homing, &mut objects, now);
    assert_eq!(written, [(0x6098, 27), (0x6099, 300), (0x6099, 60), (0x607C, 0xFFFF_FFFB), (0x6060, 6)]);
    assert_eq!(homing.controlword_bits(), 0x10);
    homing.handle_statusword(now, 0x1637); // the old "done" is no news
    assert_eq!(homing.controlword_bits(), 0x10);
    for running in [0x0237, 0x1237] {
        homing.handle_statusword(now, running);
        assert_eq!(homing.controlword_bits(), 0x10);
    }
    homing.handle_statusword(now, 0x1637);
    assert_eq!((homing.controlword_bits(), homing.poll_finished()), (0, None));
    assert_eq!(serve(&mut homing, &mut objects, now), [(0x6060, 1)]);
    assert_eq!((homing.poll_finished(), homing.is_running()), (Some(Ok(())), false));
    assert_eq!(homing.poll_timeout(), None);
}

#[test]
fn what_a_statusword_says_of_homing() {
    use Progress::*;
    for (word, progress) in [
        (0x0237, Running),
        (0x0637, NotStarted),
        (0x1237, AttainedMoving),
        (0x1637, Done),
        (0x2237, ErrorMoving),
        (0x2637, ErrorStopped),
    ] {
        assert_eq!(Progress::decode(word), progress, "{word:04X}");
    }
}

/// Homing that is running; the drive had said "not started".
fn running(now: Instant) -> (Homing, Dictionary) {
    let (mut homing, mut objects) = (homing(), icla::dictionary(2));
    homing.handle_statusword(now, 0x0637);
    homing.start();
    serve(&mut homing, &mut objects, now);
    assert_eq!(homing.controlword_bits(), 0x10);
    (homing, objects)
}

#[test]
fn homing_fails_with_its_reason_and_restores_the_mode() {
    let now = Instant::ZERO;
    let end = |homing: &mut Homing, objects: &mut Dictionary, at| {
        assert_eq!(homing.controlword_bits(), 0);
        assert_eq!(serve(homing, objects, at), [(0x6060, 1)]);
        homing.poll_finished()
    };
    let (mut homing, mut objects) = running(now);
    homing.handle_statusword(now, 0x2637);
    assert_eq!(end(&mut homing, &mut objects, now), Some(Err(HomingError::Refused)));

    let (mut homing, mut objects) = running(now);
    homing.handle_statusword(now, 0x0237);
    homing.handle_statusword(now, 0x0637);
    assert_eq!(end(&mut homing, &mut objects, now), Some(Err(HomingError::Interrupted)));

    let (mut homing, mut objects) = running(now);
    let react = homing.poll_timeout().unwrap();
    homing.handle_timeout(react);
    assert_eq!(end(&mut homing, &mut objects, react), Some(Err(HomingError::NotStarted)));

    let (mut homing, mut objects) = running(now);
    homing.handle_statusword(now, 0x0237);
    let limit = homing.poll_timeout().unwrap();
    assert_eq!(limit, now + Duration::from_secs(30));
    homing.handle_timeout(limit);
    assert_eq!(end(&mut homing, &mut objects, limit), Some(Err(HomingError::Timeout)));

    let (mut homing, mut objects) = running(now);
    homing.cancel();
    assert_eq!(end(&mut homing, &mut objects, now), Some(Err(HomingError::Cancelled)));

    let (mut homing, _) = running(now);
    homing.lost();
    assert_eq!(homing.poll_finished(), Some(Err(HomingError::Cancelled)));
}

#[test]
fn a_mode_that_does_not_follow_ends_homing() {
    let mut homing = homing();
    let mut now = Instant::ZERO;
    homing.start();
    while homing.is_running() {
        match homing.poll_sdo() {
            Some(Access::Read { .. }) => homing.handle_sdo(now, Ok(Payload::from(&[1][..]))),
            Some(Access::Write { .. }) => homing.handle_sdo(now, Ok(Payload::EMPTY)),
            None => {
                now = homing.poll_timeout().expect("it waits for something").max(now);
                homing.handle_timeout(now);
            }
        }
        assert_eq!(homing.controlword_bits(), 0);
        assert!(now < Instant::from_millis(5000));
    }
    assert_eq!(homing.poll_finished(), Some(Err(HomingError::Mode)));
}

#[test]
fn a_refused_object_ends_homing_with_its_name() {
    let mut homing = homing();
    homing.start();
    assert!(homing.poll_sdo().is_some());
    let error = sdo::Error::Refused(crate::Abort::RANGE);
    homing.handle_sdo(Instant::ZERO, Err(error));
    assert!(matches!(homing.poll_sdo(), Some(Access::Write { index: 0x6060, .. })));
    homing.handle_sdo(Instant::ZERO, Err(sdo::Error::Timeout));
    assert_eq!(homing.poll_finished(), Some(Err(HomingError::Sdo { index: 0x6098, sub: 0, error })));
}

#[test]
fn modes_have_their_codes_and_their_bits_in_0x6502() {
    for mode in Mode::ALL {
        assert_eq!(Mode::from_code(mode.code()), Some(mode));
    }
    assert_eq!([0, 5, 11, -1, -128, 127].map(Mode::from_code), [None; 6]);
    let of = |dictionary: Dictionary| dictionary.get(0x6502, 0).unwrap() as u32;
    let supported = |bits| Mode::ALL.into_iter().filter(|mode| mode.is_supported(bits)).collect::<Vec<_>>();
    let three = [Mode::ProfilePosition, Mode::ProfileVelocity, Mode::Homing];
    assert_eq!((supported(of(epos::dictionary(1))), supported(of(icla::dictionary(2)))), (three.into(), three.into()));
    let expect = Mode::expect(&[Mode::ProfileVelocity, Mode::CyclicPosition]);
    assert_eq!((expect.index, expect.mask, expect.min), (0x6502, 0x84, 0x84));
}

#[test]
fn homing_methods_are_named() {
    let named: Vec<_> = (i8::MIN..=i8::MAX).filter_map(Method::of).map(Method::number).collect();
    let all: Vec<_> = (1..=14).chain(17..=30).chain(33..=35).chain([37]).collect();
    assert_eq!(named, all);
    assert!(method::EPOS.iter().all(|number| Method::of(*number).is_some()));
    let show = |number| std::format!("{}", Method::of(number).unwrap());
    assert_eq!(show(27), "27 (home switch, right edge from within, search negative)");
    assert_eq!(show(7), "7 (home switch, left edge from within, search positive, then index)");
    assert_eq!((show(33).as_str(), show(37).as_str()), ("33 (next index pulse, negative)", "37 (here)"));
}

#[test]
fn a_mirrored_homing_method_moves_in_the_other_directions() {
    for method in (i8::MIN..=i8::MAX).filter_map(Method::of) {
        let plan = method.plan();
        let Some(other) = method.mirrored() else {
            assert_eq!(plan.search, None, "{method}");
            continue;
        };
        assert_eq!((other.mirrored(), other.has_index()), (Some(method), method.has_index()));
        let switch = |switch| match switch {
            method::Switch::NegativeLimit => method::Switch::PositiveLimit,
            method::Switch::PositiveLimit => method::Switch::NegativeLimit,
            method::Switch::Home => method::Switch::Home,
        };
        let leg = |leg: method::Leg| method::Leg { direction: leg.direction.reversed(), ..leg };
        let mirrored = method::Plan {
            search: plan.search.map(|(of, direction)| (switch(of), direction.reversed())),
            legs: plan.legs.map(|own| own.map(leg)),
            index: plan.index.map(method::Direction::reversed),
        };
        assert_eq!(other.plan(), mirrored, "{method}");
    }
}

#[test]
fn a_mode_is_switched_when_it_is_shown() {
    let (mut switch, now) = (Switch::new(MS * 100), Instant::ZERO);
    switch.start(Mode::ProfileVelocity);
    assert_eq!(switch.poll_sdo(), Some(Access::write(0x6060, 0, 3_i8)));
    assert_eq!((switch.poll_sdo(), switch.is_running()), (None, true));
    switch.handle_display(3); // of before it was written
    assert_eq!(switch.poll_finished(), None);
    switch.handle_sdo(now, Ok(Payload::EMPTY));
    assert_eq!(switch.poll_sdo(), Some(Access::Read { index: 0x6061, sub: 0 }));
    switch.handle_sdo(now, Ok(Payload::from(&[1][..])));
    assert_eq!((switch.poll_sdo(), switch.poll_timeout()), (None, Some(now + MS * 20)));
    switch.handle_display(3);
    assert_eq!((switch.poll_finished(), switch.poll_timeout()), (Some(Ok(())), None));
}

#[test]
fn a_mode_that_is_not_shown_in_time_or_not_taken_is_told() {
    let (mut switch, now) = (Switch::new(MS * 100), Instant::ZERO);
    switch.start(Mode::CyclicPosition);
    switch.poll_sdo();
    switch.handle_sdo(now, Ok(Payload::EMPTY));
    switch.poll_sdo();
    switch.handle_sdo(now, Ok(Payload::from(&[1][..])));
    switch.handle_timeout(now + MS * 100);
    assert_eq!(switch.poll_finished(), Some(Err(SwitchError::NotShown { shown: Some(1) })));

    switch.start(Mode::CyclicPosition);
    switch.poll_sdo();
    let error = sdo::Error::Refused(crate::Abort::RANGE);
    switch.handle_sdo(now, Err(error));
    assert_eq!(switch.poll_finished(), Some(Err(SwitchError::Sdo { index: 0x6060, error })));
    assert!(!switch.is_running());

    // Another one while the first is being written: the first one's end is no news.
    switch.start(Mode::CyclicPosition);
    switch.poll_sdo();
    switch.start(Mode::Homing);
    assert_eq!(switch.poll_sdo(), None);
    switch.handle_sdo(now, Err(error));
    assert_eq!(switch.poll_sdo(), Some(Access::write(0x6060, 0, 6_i8)));
}

#[test]
fn moves_have_the_bits_of_the_controlword() {
    let bits = |next| {
        let mut setpoint = Setpoint::new(MS * 100);
        assert!(setpoint.push(Instant::ZERO, next));
        setpoint.command()
    };
    assert_eq!(bits(Move::to(7)), (0x30, 7));
    assert_eq!(bits(Move::by(7)), (0x70, 7));
    assert_eq!(bits(Move::to(7).after()), (0x10, 7));
    assert_eq!(bits(Move::by(7).blending()), (0x250, 7));
    let mut setpoint = Setpoint::new(MS * 100);
    for n in 0..9 {
        assert!(setpoint.push(Instant::ZERO, Move::to(n).after()), "one is sent, eight wait");
    }
    assert!(!setpoint.push(Instant::ZERO, Move::to(9).after()));
}

#[test]
fn a_full_buffer_of_the_drive_is_waited_for() {
    let (mut setpoint, mut now) = (Setpoint::new(MS * 100), Instant::ZERO);
    setpoint.push(now, Move::to(1));
    setpoint.handle_statusword(now, 0x1237);
    setpoint.handle_statusword(now, 0x0237);
    setpoint.push(now, Move::to(2).after());
    setpoint.push(now, Move::to(3).after());
    setpoint.handle_statusword(now, 0x1237);
    assert_eq!((setpoint.command(), setpoint.poll_timeout()), ((0, 2), None));
    now += MS * 5000;
    setpoint.handle_timeout(now);
    setpoint.handle_statusword(now, 0x1237);
    assert_eq!(setpoint.command().1, 2, "the drive still holds it");
    setpoint.handle_statusword(now, 0x0237);
    assert_eq!(setpoint.command(), (0x10, 3));
}

#[test]
fn set_points_of_a_cyclic_mode_are_watched() {
    let config = CyclicConfig { mode: Mode::CyclicPosition, patience: 2, max_step: 100 };
    let mut cyclic = Cyclic::new(config);
    assert!(!cyclic.set(1), "not begun");
    assert_eq!(cyclic.sync(), (0, 0));
    cyclic.restart(1000);
    assert_eq!(cyclic.sync(), (0, 1000));
    assert!(cyclic.set(1100));
    assert_eq!(cyclic.sync(), (0, 1100));
    assert_eq!([cyclic.sync(), cyclic.sync()], [(0, 1100); 2]);
    assert_eq!(cyclic.stopped(), None);
    cyclic.sync();
    assert_eq!((cyclic.stopped(), cyclic.set(1101), cyclic.sync()), (Some(Stopped::Starved), false, (0, 1100)));

    cyclic.restart(i32::MIN);
    assert!(!cyclic.set(i32::MAX));
    assert_eq!(cyclic.stopped(), Some(Stopped::Step { from: i32::MIN, to: i32::MAX }));
    assert_eq!(cyclic.sync(), (0, i32::MIN));

    let mut velocity = Cyclic::new(CyclicConfig { mode: Mode::CyclicVelocity, ..config });
    velocity.restart(500);
    for _ in 0..3 {
        velocity.sync();
    }
    assert_eq!((velocity.sync(), velocity.stopped()), ((0, 0), Some(Stopped::Starved)));

    let mut ip = Cyclic::new(CyclicConfig { mode: Mode::Interpolated, ..config });
    ip.restart(5);
    assert_eq!(ip.sync(), (0x10, 5));
    ip.reset(7);
    assert_eq!(ip.sync(), (0, 7));
}

#[test]
fn the_interpolation_period_is_mantissa_and_exponent() {
    let period = |micros| interpolation_period(Duration::from_micros(micros));
    assert_eq!(
        [period(10_000), period(4000), period(250), period(1_000_000)].map(Option::unwrap),
        [(1, -2), (4, -3), (25, -5), (1, 0)]
    );
    assert_eq!((period(0), period(1234)), (None, None));
}
