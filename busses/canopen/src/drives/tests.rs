//! The drives' tables against their EDS and literal frames; the handshakes against a drive that follows the text.

use super::homing::{Access, Homing, HomingConfig, HomingError, Progress};
use super::pp::{Setpoint, SetpointEvent};
use super::{epos, icla};
use crate::eds::Eds;
use crate::{Dictionary, Payload, sdo};
use base::{Duration, Instant};
use std::vec::Vec;

const MS: Duration = Duration::from_millis(1);

/// Same objects, same defaults, same types, same access, same limits.
fn compare(dictionary: &Dictionary, eds: &[u8]) {
    let eds = Eds::parse(eds).unwrap();
    assert!(eds.objects().len() > 150, "{} objects", eds.objects().len());
    let (ours, theirs) = (dictionary.described(), eds.dictionary(dictionary.node()).described());
    let differ: Vec<_> = ours.iter().filter(|object| !theirs.contains(object)).collect();
    let missing: Vec<_> = theirs.iter().filter(|object| !ours.contains(object)).collect();
    assert!(differ.is_empty() && missing.is_empty(), "table: {differ:#?}\nEDS: {missing:#?}");
}

#[test]
fn the_dictionaries_are_those_of_the_eds_files() {
    compare(&epos::dictionary(1), include_bytes!("../../eds/epos_sim.eds"));
    compare(&icla::dictionary(2), include_bytes!("../../eds/icla_sim.eds"));
}

#[test]
fn pdos_are_packed_as_on_the_wire() {
    assert_eq!(epos::pack(0x0F, 1500), [0x0F, 0x00, 0xDC, 0x05, 0x00, 0x00]);
    assert_eq!(epos::pack(0x0F, -1500), [0x0F, 0x00, 0x24, 0xFA, 0xFF, 0xFF]);
    let status = epos::Status { statusword: 0x0237, velocity_rpm: Some(-1500) };
    assert_eq!(epos::unpack(4, &[0x37, 0x02, 0x24, 0xFA, 0xFF, 0xFF]), Some(status));
    assert_eq!(epos::unpack(1, &[0x37, 0x02]), Some(epos::Status { velocity_rpm: None, ..status }));
    assert_eq!((epos::unpack(4, &[0x37, 0x02, 0, 0, 0]), epos::unpack(2, &[0; 8])), (None, None));
    assert_eq!(icla::pack(0x3F, 1000), [0x3F, 0x00, 0xE8, 0x03, 0x00, 0x00]);
    let status = icla::Status { statusword: 0x1237, position: Some(-2) };
    assert_eq!(icla::unpack(2, &[0x37, 0x12, 0xFE, 0xFF, 0xFF, 0xFF]), Some(status));
    assert_eq!((icla::unpack(1, &[0x37]), icla::unpack(3, &[0; 8])), (None, None));
}

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
            Access::ReadMode => objects.read(0x6061, 0).map_err(sdo::Error::Refused),
            Access::Write(write) => {
                let data = write.value;
                written.push((write.index, data.bits().unwrap()));
                let result = objects.write(write.index, write.sub, &data);
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
            Some(Access::ReadMode) => homing.handle_sdo(now, Ok(Payload::from(&[1][..]))),
            Some(Access::Write(_)) => homing.handle_sdo(now, Ok(Payload::EMPTY)),
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
    assert!(matches!(homing.poll_sdo(), Some(Access::Write(write)) if write.index == 0x6060));
    homing.handle_sdo(Instant::ZERO, Err(sdo::Error::Timeout));
    assert_eq!(homing.poll_finished(), Some(Err(HomingError::Sdo { index: 0x6098, sub: 0, error })));
}
