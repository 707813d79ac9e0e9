//! A node against literal frames; identifiers and bytes typed from CiA 301 v4.02 and maxon's documents.

mod layer;
mod pdos;
mod supervision;

use super::*;
use crate::dictionary::{Access, DataType, Entry};
use crate::drives::{epos, icla};
use crate::testing::{Random, check};
use std::vec::Vec;

fn epos() -> Node {
    Node::new(epos::dictionary(1), Duration::from_millis(5))
}

fn icla() -> Node {
    Node::new(icla::dictionary(2), Duration::from_millis(5))
}

#[test]
fn a_node_boots_answers_and_moves_its_wheel() {
    check(
        &mut epos(),
        "
         0ms > on
         0ms < state Initialising
         5ms < 701 00
         5ms < state PreOperational
        10ms > 601 40 41 60 00 00 00 00 00      # statusword
        10ms < 581 4B 41 60 00 00 00 00 00
        11ms > 601 40 00 10 00 00 00 00 00      # device type
        11ms < 581 43 00 10 00 92 01 02 00
        12ms > 601 2F 60 60 00 03 00 00 00      # profile velocity
        12ms < 581 60 60 60 00 00 00 00 00
        12ms < written 6060 0
        13ms > 501 0F 00 DC 05 00 00            # not Operational: no PDO
        20ms > 000 01 01
        20ms < 181 00 00                        # event-driven PDOs are sent once
        20ms < state Operational
        21ms > 501 0F 00 DC 05 00 00            # enable, 1500 rpm
        21ms < written 60FF 0                   # the set-point before its controlword
        21ms < written 6040 0
        22ms > set 6041 0 567                   # 0x0237
        22ms < 181 37 02
        23ms > set 6041 0 567                   # no change, no frame
        24ms > 000 81 00                        # reset all
        24ms < reset
        24ms < state Initialising
        29ms < 701 00
        29ms < state PreOperational
        30ms > 601 40 60 60 00 00 00 00 00      # the mode is forgotten
        30ms < 581 4F 60 60 00 01 00 00 00
        ",
    );
}

#[test]
fn refusals_carry_their_codes() {
    check(
        &mut epos(),
        "
         0ms > on
         0ms < state Initialising
         5ms < 701 00
         5ms < state PreOperational
        10ms > 601 40 00 50 00 00 00 00 00      # no such object
        10ms < 581 80 00 50 00 00 00 02 06
        11ms > 601 40 18 10 09 00 00 00 00      # no such sub-index
        11ms < 581 80 18 10 09 11 00 09 06
        12ms > 601 23 00 10 00 00 00 00 00      # read only
        12ms < 581 80 00 10 00 02 00 01 06
        13ms > 601 23 7F 60 00 A9 61 00 00      # 25001 rpm
        13ms < 581 80 7F 60 00 31 00 09 06
        14ms > 601 23 7F 60 00 00 00 00 00      # 0 rpm
        14ms < 581 80 7F 60 00 32 00 09 06
        15ms > 601 2F 40 60 00 06 00 00 00      # one byte for a controlword
        15ms < 581 80 40 60 00 13 00 07 06
        16ms > 601 23 16 10 01 C8 00 7F 00      # watch 127
        16ms < 581 60 16 10 01 00 00 00 00
        16ms < written 1016 1
        17ms > 601 23 16 10 02 C8 00 7F 00      # and again: incompatible
        17ms < 581 80 16 10 02 43 00 04 06
        18ms > 601 23 10 10 01 6C 6F 61 64      # store with the signature of restore
        18ms < 581 80 10 10 01 20 00 00 08
        19ms > 601 2B 03 10 00 01 00 00 00      # two bytes for one
        19ms < 581 80 03 10 00 12 00 07 06
        20ms > 601 2F 03 10 00 01 00 00 00      # only 0 clears the history
        20ms < 581 80 03 10 00 30 00 09 06
        21ms > 601 E0 00 2F 00 00 00 00 00      # a reserved specifier
        21ms < 581 80 00 2F 00 01 00 04 05
        22ms > 601 40 41 60                     # too short: no answer
        23ms > 602 40 41 60 00 00 00 00 00      # not for us
        ",
    );
}

#[test]
fn remapping_takes_the_procedure_and_no_shortcut() {
    check(
        &mut epos(),
        "
         0ms > on
         0ms < state Initialising
         5ms < 701 00
         5ms < state PreOperational
        10ms > 601 2F 03 1A 00 00 00 00 00      # TPDO4 does not exist: may be mapped
        10ms < 581 60 03 1A 00 00 00 00 00
        10ms < written 1A03 0
        11ms > 601 23 03 1A 02 20 00 28 20      # 2028, averaged velocity
        11ms < 581 60 03 1A 02 00 00 00 00
        11ms < written 1A03 2
        12ms > 601 23 03 1A 02 20 00 40 50      # no such object
        12ms < 581 80 03 1A 02 00 00 02 06
        13ms > 601 23 03 1A 02 10 00 28 20      # wrong length
        13ms < 581 80 03 1A 02 41 00 04 06
        14ms > 601 23 03 1A 02 20 00 7F 60      # not mappable
        14ms < 581 80 03 1A 02 41 00 04 06
        15ms > 601 23 03 1A 03 20 00 6C 60      # 2 + 4 + 4 bytes
        15ms < 581 60 03 1A 03 00 00 00 00
        15ms < written 1A03 3
        16ms > 601 2F 03 1A 00 03 00 00 00
        16ms < 581 80 03 1A 00 42 00 04 06
        17ms > 601 2F 03 1A 00 02 00 00 00
        17ms < 581 60 03 1A 00 00 00 00 00
        17ms < written 1A03 0
        18ms > 601 2F 03 18 02 FD 00 00 00      # type 253 answers remote frames: not here
        18ms < 581 80 03 18 02 30 00 09 06
        19ms > 601 2B 03 18 03 64 00 00 00      # inhibit 10 ms
        19ms < 581 60 03 18 03 00 00 00 00
        19ms < written 1803 3
        20ms > 601 23 03 18 01 01 07 00 40      # a restricted identifier
        20ms < 581 80 03 18 01 30 00 09 06
        21ms > 601 23 03 18 01 81 04 00 40
        21ms < 581 60 03 18 01 00 00 00 00
        21ms < written 1803 1
        22ms > 601 23 03 18 01 82 04 00 40      # another identifier while it exists
        22ms < 581 80 03 18 01 30 00 09 06
        23ms > 601 2B 03 18 03 00 00 00 00      # inhibit time while it exists
        23ms < 581 80 03 18 03 00 00 01 06
        24ms > 601 2F 03 1A 00 01 00 00 00      # mapping while it exists
        24ms < 581 80 03 1A 00 00 00 01 06
        25ms > 000 01 00
        25ms < 181 00 00
        25ms < 481 00 00 00 00 00 00
        25ms < state Operational
        26ms > set 2028 0 -1500
        30ms > set 2028 0 -1499
        35ms < 481 00 00 25 FA FF FF            # once, when the inhibit time is over
        40ms > 601 2F 01 1A 00 00 00 00 00      # no remapping while Operational
        40ms < 581 80 01 1A 00 22 00 00 08
        ",
    );
}

#[test]
fn sync_and_timers_send_and_apply_what_their_type_says() {
    check(
        &mut icla(),
        "
         0ms > on
         0ms < state Initialising
         5ms < 702 00
         5ms < state PreOperational
        10ms > 602 2F 00 18 02 02 00 00 00      # TPDO1 at every second SYNC
        10ms < 582 60 00 18 02 00 00 00 00
        10ms < written 1800 2
        11ms > 602 2F 01 18 02 00 00 00 00      # TPDO2 at the SYNC after a change
        11ms < 582 60 01 18 02 00 00 00 00
        11ms < written 1801 2
        12ms > 602 2F 01 14 02 01 00 00 00      # RPDO2 applied at SYNC
        12ms < 582 60 01 14 02 00 00 00 00
        12ms < written 1401 2
        13ms > 000 01 02
        13ms < state Operational
        20ms > 080
        20ms < 282 00 00 00 00 00 00            # it was new
        21ms > 080
        21ms < 182 00 00
        22ms > 302 1F 00 E8 03 00 00
        23ms > set 6064 0 -2
        24ms > 080
        24ms < 282 00 00 FE FF FF FF
        24ms < written 607A 0
        24ms < written 6040 0
        25ms > 080
        25ms < 182 00 00
        26ms > 302 1F 00 E8                     # too short: not processed
        26ms < 082 10 82 10 00 00 00 00 00
        26ms < short 2
        27ms > 602 40 03 10 01 00 00 00 00      # and remembered
        27ms < 582 43 03 10 01 10 82 00 00
        28ms > 602 2B 02 18 05 0A 00 00 00      # event timer 10 ms on TPDO3
        28ms < 582 60 02 18 05 00 00 00 00
        28ms < written 1802 5
        29ms > 602 23 02 18 01 82 03 00 40
        29ms < 582 60 02 18 01 00 00 00 00
        29ms < 382 00 00 00 00 00 00            # its first
        29ms < written 1802 1
        39ms < 382 00 00 00 00 00 00
        49ms < 382 00 00 00 00 00 00
        50ms > 000 02 02
        50ms < state Stopped
        70ms > 080                              # silence
        ",
    );
}

#[test]
fn heartbeats_are_sent_on_a_grid_and_watched_from_the_first() {
    check(
        &mut icla(),
        "
          0ms > on
          0ms < state Initialising
          5ms < 702 00
          5ms < state PreOperational
         10ms > 602 2B 17 10 00 64 00 00 00     # every 100 ms, at once
         10ms < 582 60 17 10 00 00 00 00 00
         10ms < 702 7F
         10ms < written 1017 0
         20ms > 602 23 16 10 01 C8 00 7F 00     # watch 127 for 200 ms
         20ms < 582 60 16 10 01 00 00 00 00
         20ms < written 1016 1
        110ms < 702 7F
        210ms < 702 7F
        300ms > 000 01 02
        300ms < 182 00 00
        300ms < 282 00 00 00 00 00 00
        300ms < state Operational
        310ms < 702 05
        320ms > 77F 00                          # a boot-up message starts nothing
        410ms < 702 05
        510ms < 702 05
        520ms > 77F 05
        610ms < 702 05
        710ms < 702 05
        720ms < lost 127
        720ms < state PreOperational            # 0x1029:1 = 0
        730ms > 77F 05
        730ms < back 127
        810ms < 702 7F
        ",
    );
}

/// CiA 301, Table 37, as a table: state, then what lives in it.
#[test]
fn services_live_in_the_states_of_the_standard() {
    let mut table = Vec::new();
    for (name, command) in [
        ("Pre-operational", NmtCommand::EnterPreOperational),
        ("Operational", NmtCommand::Start),
        ("Stopped", NmtCommand::Stop),
    ] {
        let now = Instant::from_millis(100);
        let mut node = icla();
        node.power_on(now);
        node.handle_timeout(now + Duration::from_millis(5));
        node.handle_rx(now, &wire::nmt(command, 2));
        while node.poll_tx().is_some() || node.poll_event().is_some() {}
        let mut lives = Vec::new();
        let mut probe = |name, act: &dyn Fn(&mut Node), seen: &dyn Fn(&mut Node) -> bool| {
            act(&mut node);
            if seen(&mut node) {
                lives.push(name);
            }
        };
        let rx = |id, data: &[u8]| {
            let frame = Frame::standard(id, data);
            move |node: &mut Node| node.handle_rx(now, &frame)
        };
        probe("RPDO", &rx(0x302, &[0, 0, 7, 0, 0, 0]), &|node| node.get(0x607A, 0) == Some(7));
        probe("TPDO", &|node| node.set(0x6041, 0, 0x37), &|node| {
            node.handle_timeout(now);
            node.poll_tx().is_some()
        });
        probe("SDO", &rx(0x602, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]), &|node| node.poll_tx().is_some());
        probe("EMCY", &|node| node.emergency(0x1000, 1, [0; 5]), &|node| node.poll_tx().is_some());
        probe("NMT", &rx(0x000, &[0x82, 2]), &|node| node.nmt_state() == Some(NmtState::Initialising));
        table.push(std::format!("{name}: {}", lives.join(" ")));
    }
    assert_eq!(table, ["Pre-operational: SDO EMCY NMT", "Operational: RPDO TPDO SDO EMCY NMT", "Stopped: NMT"]);
}

#[test]
fn the_error_history_keeps_the_newest_first_and_is_cleared() {
    let mut node = epos();
    node.power_on(Instant::ZERO);
    node.handle_timeout(Instant::from_millis(5));
    for code in 1..=7 {
        node.emergency(0x3000 + code, 4, [code as u8, 0, 9, 9, 9]);
    }
    node.emergency(0, 0, [0; 5]);
    let history: Vec<_> = (0..=5).map(|sub| node.get(0x1003, sub).unwrap()).collect();
    assert_eq!(history, [5, 0x7_3007, 0x6_3006, 0x5_3005, 0x4_3004, 0x3_3003]);
    assert_eq!(node.get(0x1001, 0), Some(0));
    node.handle_rx(Instant::ZERO, &Frame::standard(0x601, &[0x2F, 0x03, 0x10, 0, 0, 0, 0, 0]));
    assert_eq!((node.get(0x1003, 0), node.get(0x1003, 1)), (Some(0), Some(0)));
}

#[test]
fn a_dummy_entry_skips_bytes() {
    let now = Instant::from_millis(5);
    let objects = Dictionary::new(3)
        .with(&[Entry::new(0x2000, 0, DataType::U8, Access::ReadWrite, 0).mappable()])
        .with_rpdo(1, 0x200, &[0x0005_0008, 0x0006_0010, 0x2000_0008], false);
    let mut node = Node::new(objects, Duration::ZERO);
    node.power_on(now);
    node.handle_timeout(now);
    node.handle_rx(now, &wire::nmt(NmtCommand::Start, 0));
    node.handle_rx(now, &Frame::standard(0x203, &[1, 2, 3, 4, 5]));
    assert_eq!(node.get(0x2000, 0), Some(4));
}

#[test]
fn no_frames_panic_and_nothing_stays_due() {
    let mut random = Random::new(3);
    let mut node = icla();
    node.power_on(Instant::ZERO);
    for round in 0..200_000_u64 {
        let now = Instant::from_millis(round);
        let ids = [0x000, 0x080, 0x202, 0x302, 0x602, 0x602, 0x602, 0x77F];
        let id = ids[random.below(8) as usize];
        let mut data = random.next().to_le_bytes();
        if id == 0 {
            data[0] = [1, 1, 1, 2, 0x80, 0x81, 0x82][random.below(7) as usize];
            data[1] = 0;
        }
        if id == 0x602 {
            data[0] = [0x23, 0x2F, 0x2B, 0x40, data[0]][random.below(5) as usize];
            let index = [0x1400, 0x1600, 0x1801, 0x1A01, 0x1016, 0x1017, 0x2F00][random.below(7) as usize];
            data[1..3].copy_from_slice(&u16::to_le_bytes(index));
            data[3] %= 10;
        }
        let len = if id == 0 { 2 } else { random.below(9) as usize };
        node.handle_rx(now, &Frame::standard(id, &data[..len]));
        node.handle_timeout(now);
        while node.poll_tx().is_some() || node.poll_event().is_some() {}
        assert!(node.poll_timeout().is_none_or(|next| next > now));
    }
}

#[test]
fn a_value_out_of_its_limits_changes_nothing_by_pdo_either() {
    let now = Instant::from_millis(5);
    let objects = Dictionary::new(3)
        .with(&[
            Entry::new(0x6081, 0, DataType::U16, Access::ReadWrite, 5).limits(1, 100).mappable(),
            Entry::new(0x6040, 0, DataType::U16, Access::ReadWrite, 0).mappable(),
        ])
        .with_rpdo(1, 0x200, &[0x6081_0010, 0x6040_0010], false);
    let mut node = Node::new(objects, Duration::ZERO);
    node.power_on(now);
    node.handle_timeout(now);
    node.handle_rx(now, &wire::nmt(NmtCommand::Start, 0));
    while node.poll_event().is_some() {}
    node.handle_rx(now, &Frame::standard(0x203, &[101, 0, 6, 0]));
    assert_eq!((node.get(0x6081, 0), node.get(0x6040, 0)), (Some(5), Some(6)));
    let written = NodeEvent::ObjectWritten { index: 0x6040, sub: 0 };
    assert_eq!((node.poll_event(), node.poll_event()), (Some(written), None));
}

#[test]
fn a_drive_without_0x1029_is_told_of_a_dead_master_and_reacts_itself() {
    check(
        &mut epos(),
        "
          0ms > on
          0ms < state Initialising
          5ms < 701 00
          5ms < state PreOperational
         20ms > 601 23 16 10 01 C8 00 7F 00     # watch 127 for 200 ms
         20ms < 581 60 16 10 01 00 00 00 00
         20ms < written 1016 1
         30ms > 000 01 01
         30ms < 181 00 00
         30ms < state Operational
         40ms > 77F 05
         90ms > 77F 05
        290ms < lost 127
        300ms > set 6041 0 567                  # still Operational: its statusword leaves
        300ms < 181 37 02
        ",
    );
}
