//! Guarding, SYNC, TIME, emergencies and start-up, as frames.

use super::*;
use crate::Abort;
use std::vec;

/// A node 3 with the objects that CiA 301 lets a node leave out.
pub(super) fn node(more: &[Entry]) -> Node {
    use Access::ReadWrite;
    use DataType::{I32, U8, U16, U32};
    let objects = Dictionary::new(3)
        .with(&[
            Entry::new(0x1001, 0, U8, Access::ReadOnly, 0).mappable(),
            Entry::new(0x1005, 0, U32, ReadWrite, 0x80),
            Entry::new(0x1006, 0, U32, ReadWrite, 0),
            Entry::new(0x100C, 0, U16, ReadWrite, 0),
            Entry::new(0x100D, 0, U8, ReadWrite, 0),
            Entry::new(0x1012, 0, U32, ReadWrite, 0x8000_0100),
            Entry::new(0x1014, 0, U32, ReadWrite, 0x80).plus_node_id(),
            Entry::new(0x1015, 0, U16, ReadWrite, 0),
            Entry::new(0x1017, 0, U16, ReadWrite, 0),
            Entry::new(0x1019, 0, U8, ReadWrite, 0),
            Entry::new(0x1020, 0, U8, Access::Const, 2),
            Entry::new(0x1020, 1, U32, ReadWrite, 0),
            Entry::new(0x1020, 2, U32, ReadWrite, 0),
            Entry::new(0x1029, 0, U8, Access::Const, 1),
            Entry::new(0x1029, 1, U8, ReadWrite, 0),
            Entry::new(0x2000, 0, I32, ReadWrite, 0).mappable(),
        ])
        .with_rpdo(1, 0x200, &[0x2000_0020], true)
        .with_tpdo(1, 0x180, &[0x2000_0020], true)
        .with(&[Entry::new(0x1800, 6, U8, ReadWrite, 0)])
        .with(more);
    Node::new(objects, Duration::ZERO)
}

pub(super) const BOOT: &str = "
         0ms > on
         0ms < 703 00
         0ms < state Initialising
         0ms < state PreOperational
";

fn play(node: &mut Node, script: &str) {
    check(node, &std::format!("{BOOT}{script}"));
}

/// A write by SDO to a node that runs: what it answers.
pub(super) fn write(node: &mut Node, now: Instant, (index, sub): (u16, u8), value: i64) -> Result<(), Abort> {
    let width = node.dictionary().read(index, sub).map_or(4, |data| data.len());
    let ([low, high], value) = (index.to_le_bytes(), value.to_le_bytes());
    let [a, b, c, d] = [0, 1, 2, 3].map(|at| if at < width { value[at] } else { 0 });
    let id = u16::from(node.id());
    node.handle_rx(now, &Frame::standard(0x600 + id, &[0x23 | (4 - width as u8) << 2, low, high, sub, a, b, c, d]));
    let answers: Vec<_> = core::iter::from_fn(|| node.poll_tx()).filter(|frame| frame.id() == sdo_id(id)).collect();
    assert_eq!(answers.len(), 1);
    match *answers[0].data() {
        [0x60, ..] => Ok(()),
        [0x80, _, _, _, a, b, c, d] => Err(Abort(u32::from_le_bytes([a, b, c, d]))),
        _ => panic!("{answers:?}"),
    }
}

fn sdo_id(id: u16) -> Id {
    Id::Standard(0x580 + id)
}

#[test]
fn the_state_is_told_to_who_asks_and_who_stops_asking_is_missed() {
    play(
        &mut node(&[]),
        "
         1ms > 703 R
         1ms < 703 7F                           # the first toggle is 0
         2ms > 703 R
         2ms < 703 FF
         3ms > 704 R                            # another node
         4ms > 603 2B 0C 10 00 64 00 00 00      # guard time 100 ms
         4ms < 583 60 0C 10 00 00 00 00 00
         4ms < written 100C 0
         5ms > 603 2F 0D 10 00 03 00 00 00      # three of them
         5ms < 583 60 0D 10 00 00 00 00 00
         5ms < written 100D 0
       400ms > 000 01 03                        # nothing is missed before the first request
       400ms < 183 00 00 00 00
       400ms < state Operational
       410ms > 703 R
       410ms < 703 05
       709ms > 703 R
       709ms < 703 85
      1009ms < guard lost
      1009ms < state PreOperational             # 0x1029:1 = 0
      1010ms > 703 R
      1010ms < 703 7F
      1010ms < guard back
      1011ms > 000 02 03
      1011ms < state Stopped
      1012ms > 703 R                            # in any state
      1012ms < 703 84
      1013ms > 000 80 03
      1013ms < state PreOperational
      1014ms > 603 2B 17 10 00 E8 03 00 00      # heartbeats exclude guarding
      1014ms < 583 60 17 10 00 00 00 00 00
      1014ms < 703 7F
      1014ms < written 1017 0
      1015ms > 703 R
      2014ms < 703 7F
      2015ms > 000 82 03                        # reset communication
      2015ms < 703 00
      2015ms < state Initialising
      2015ms < state PreOperational
      2016ms > 703 R
      2016ms < 703 7F
      9999ms > 703 R                            # the times are forgotten
      9999ms < 703 FF
        ",
    );
}

#[test]
fn a_communication_error_does_what_0x1029_says() {
    let at = Instant::from_millis;
    for (behaviour, operational, pre_operational) in [
        (0, NmtState::PreOperational, NmtState::PreOperational),
        (1, NmtState::Operational, NmtState::PreOperational),
        (2, NmtState::Stopped, NmtState::Stopped),
    ] {
        for (command, expected) in
            [(NmtCommand::Start, operational), (NmtCommand::EnterPreOperational, pre_operational)]
        {
            let mut node = node(&[]);
            node.power_on(at(0));
            node.handle_timeout(at(0));
            for (key, value) in [((0x1029, 1), behaviour), ((0x100C, 0), 10), ((0x100D, 0), 1)] {
                assert_eq!(write(&mut node, at(1), key, value), Ok(()));
            }
            node.handle_rx(at(2), &wire::nmt(command, 3));
            node.handle_rx(at(3), &wire::guard_request(3));
            assert_eq!(node.poll_timeout(), Some(if command == NmtCommand::Start { at(2) } else { at(13) }));
            node.handle_timeout(at(13));
            assert_eq!(node.nmt_state(), Some(expected), "{behaviour} {command:?}");
        }
    }
}

#[test]
fn a_counted_sync_starts_a_pdo_at_its_counter() {
    play(
        &mut node(&[Entry::new(0x1019, 0, DataType::U8, Access::ReadWrite, 4)]),
        "
         1ms > 603 23 00 18 01 83 01 00 80      # off, to change it
         1ms < 583 60 00 18 01 00 00 00 00
         1ms < written 1800 1
         2ms > 603 2F 00 18 02 02 00 00 00      # every second SYNC
         2ms < 583 60 00 18 02 00 00 00 00
         2ms < written 1800 2
         3ms > 603 2F 00 18 06 03 00 00 00      # the first of which counts 3
         3ms < 583 60 00 18 06 00 00 00 00
         3ms < written 1800 6
         4ms > 603 23 00 18 01 83 01 00 00
         4ms < 583 60 00 18 01 00 00 00 00
         4ms < written 1800 1
         5ms > 000 01 03
         5ms < state Operational
         6ms > 080 01
         7ms > 080 02
         8ms > 080 03
         9ms > 080 04
         9ms < 183 00 00 00 00
        10ms > 080 01
        11ms > 080 02
        11ms < 183 00 00 00 00
        12ms > 080                              # without its counter: told once, taken anyway
        12ms < 083 40 82 10 00 00 00 00 00
        13ms > 080
        13ms < 183 00 00 00 00
        14ms > 080 02
        15ms > 080 01 02                        # too long: told again
        15ms < 083 40 82 10 00 00 00 00 00
        15ms < 183 00 00 00 00
        ",
    );
}

#[test]
fn a_node_can_be_the_one_that_sends_sync() {
    play(
        &mut node(&[]),
        "
         1ms > 603 2F 19 10 00 03 00 00 00      # counts 1 to 3
         1ms < 583 60 19 10 00 00 00 00 00
         1ms < written 1019 0
         2ms > 603 23 06 10 00 10 27 00 00      # every 10 ms
         2ms < 583 60 06 10 00 00 00 00 00
         2ms < written 1006 0
         3ms > 603 2F 19 10 00 00 00 00 00      # too late to change the counter
         3ms < 583 80 19 10 00 22 00 00 08
         4ms > 603 2F 00 18 02 01 00 00 00
         4ms < 583 60 00 18 02 00 00 00 00
         4ms < written 1800 2
         5ms > 603 23 05 10 00 80 00 00 40
         5ms < 583 60 05 10 00 00 00 00 00
         5ms < written 1005 0
        15ms < 080 01
        20ms > 603 23 05 10 00 90 00 00 40      # the identifier stays while it is sent
        20ms < 583 80 05 10 00 30 00 09 06
        25ms < 080 02
        30ms > 000 01 03
        30ms < state Operational
        35ms < 080 03
        35ms < 183 00 00 00 00                  # its own PDOs follow it
        40ms > 000 02 03
        40ms < state Stopped
        80ms > 000 80 03
        80ms < state PreOperational
        90ms < 080 01                           # counts from 1 again
        91ms > 603 23 06 10 00 00 00 00 00
        91ms < 583 60 06 10 00 00 00 00 00
        91ms < written 1006 0
       200ms > 704 00                           # no more of them
        ",
    );
}

#[test]
fn the_time_of_day_is_told_where_0x1012_wants_it() {
    let mut silent = node(&[Entry::new(0x1012, 0, DataType::U32, Access::ReadWrite, 0x100)]);
    play(&mut silent, "1ms > 100 00 2E 93 02 1D 27");
    play(
        &mut node(&[]),
        "
         1ms > 100 00 2E 93 02 1D 27
         1ms < time 10013 43200000
         2ms > 100 00 2E 93 02 1D               # too short
         3ms > 000 02 03
         3ms < state Stopped
         4ms > 100 00 2E 93 02 1D 27
        ",
    );
}

#[test]
fn emergencies_keep_their_distance() {
    let at = Instant::from_millis;
    let mut node = node(&[]);
    node.power_on(at(0));
    node.handle_timeout(at(0));
    assert_eq!(write(&mut node, at(1), (0x1015, 0), 100), Ok(())); // 10 ms
    for code in 1..=3 {
        node.emergency(0x1000 + code, 1, [0; 5]);
    }
    let mut sent = Vec::new();
    let mut now = at(5);
    for _ in 0..10 {
        node.handle_timeout(now);
        sent.extend(core::iter::from_fn(|| node.poll_tx()).map(|frame| (now, frame.data()[0])));
        let Some(next) = node.poll_timeout() else { break };
        assert!(next > now);
        now = next;
    }
    assert_eq!(sent, [(at(5), 1), (at(15), 2), (at(25), 3)]);
    // A node that is stopped, or off, forgets what it had to say; what waits is bounded.
    for _ in 0..100 {
        node.emergency(0x1004, 1, [0; 5]);
    }
    node.handle_rx(at(26), &wire::nmt(NmtCommand::Stop, 3));
    node.handle_timeout(at(1000));
    assert_eq!((node.poll_tx(), node.poll_timeout()), (None, None));
    // An emergency object that does not exist is not sent.
    node.handle_rx(at(1001), &wire::nmt(NmtCommand::EnterPreOperational, 3));
    for (key, value) in [((0x1015, 0), 0), ((0x1014, 0), 0x8000_0083)] {
        assert_eq!(write(&mut node, at(1001), key, value), Ok(()));
    }
    node.emergency(0x1005, 1, [0; 5]);
    assert_eq!(node.poll_tx(), None);
}

#[test]
fn each_object_of_the_communication_profile_refuses_what_it_must() {
    let now = Instant::from_millis(1);
    let range = Err(Abort::RANGE);
    let state = Err(Abort::DEVICE_STATE);
    for (key, values) in [
        ((0x1005, 0), vec![(0x2000_0080, range), (0x0000_0880, range), (0x701, range), (0x0, range), (0x90, Ok(()))]),
        ((0x1005, 0), vec![(0x4000_0080, Ok(())), (0x4000_0090, range), (0x80, Ok(())), (0x90, Ok(()))]),
        ((0x1006, 0), vec![(1, range), (499, range), (500, Ok(())), (0, Ok(()))]),
        ((0x1012, 0), vec![(0xC000_0100, range), (0x4000_0100, range), (0x8000_0110, range), (0x100, Ok(()))]),
        ((0x1012, 0), vec![(0x8000_0081, range), (0x100, Ok(())), (0x8000_0088, Ok(())), (0x181, Ok(()))]),
        (
            (0x1014, 0),
            vec![(0x84, range), (0x8000_0083, Ok(())), (0x84, Ok(())), (0x8000_0080, Ok(())), (0x601, range)],
        ),
        ((0x1019, 0), vec![(1, range), (241, range), (240, Ok(())), (2, Ok(())), (0, Ok(()))]),
        ((0x1029, 1), vec![(3, range), (255, range), (2, Ok(())), (1, Ok(())), (0, Ok(()))]),
        ((0x1800, 2), vec![(241, range), (251, range), (252, Ok(())), (253, Ok(())), (254, Ok(()))]),
        ((0x1400, 2), vec![(241, range), (252, range), (253, range), (240, Ok(())), (255, Ok(()))]),
        ((0x1800, 6), vec![(1, Err(Abort::UNSUPPORTED_ACCESS)), (241, range)]),
    ] {
        let mut node = node(&[]);
        node.power_on(now);
        node.handle_timeout(now);
        for (value, expected) in values {
            assert_eq!(write(&mut node, now, key, value), expected, "{key:04X?} {value:08X}");
            let kept = node.get(key.0, key.1) == Some(value);
            assert_eq!(kept, expected.is_ok(), "{key:04X?} {value:08X}");
        }
    }
    let mut node = node(&[]);
    node.power_on(now);
    node.handle_timeout(now);
    assert_eq!(write(&mut node, now, (0x1006, 0), 1000), Ok(()));
    assert_eq!(write(&mut node, now, (0x1019, 0), 2), state);
    // Without remote frames a PDO that needs them is none.
    assert_eq!(write(&mut node, now, (0x1800, 1), 0x4000_0183), Ok(()));
    assert_eq!(write(&mut node, now, (0x1800, 2), 253), range);
}

#[test]
fn another_configuration_has_no_date() {
    let now = Instant::from_millis(1);
    let mut node = node(&[]);
    node.power_on(now);
    node.handle_timeout(now);
    for ((key, value), kept) in [(((0x1015, 0), 5), false), (((0x2000, 0), 7), true), (((0x1005, 0), 0x1FF), true)] {
        for sub in [1, 2] {
            assert_eq!(write(&mut node, now, (0x1020, sub), 777), Ok(()));
        }
        // Process data are no configuration, and what is refused changes nothing.
        let _ = write(&mut node, now, key, if key.0 == 0x1005 { 0 } else { value });
        assert_eq!([1, 2].map(|sub| node.get(0x1020, sub) == Some(777)), [kept; 2], "{key:04X?}");
    }
}

#[test]
fn a_node_starts_itself_when_0x1f80_does_not_forbid_it() {
    let started = |startup| {
        let mut node = node(&[Entry::new(0x1F80, 0, DataType::U32, Access::ReadWrite, startup)]);
        node.power_on(Instant::ZERO);
        node.handle_timeout(Instant::ZERO);
        let boot_up = node.poll_tx();
        assert_eq!(boot_up, Some(wire::heartbeat(3, NmtState::Initialising)));
        node.nmt_state()
    };
    assert_eq!(
        [0, 4, 8, 12].map(started),
        [NmtState::Operational, NmtState::PreOperational, NmtState::Operational, NmtState::PreOperational].map(Some)
    );
}
