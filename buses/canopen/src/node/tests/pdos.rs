//! PDOs beyond the plain ones: deadlines, lengths, remote frames, single bits.

use super::supervision::{BOOT, node, write};
use super::*;

fn play(node: &mut Node, script: &str) {
    check(node, &std::format!("{BOOT}{script}"));
}

#[test]
fn an_rpdo_that_stops_coming_is_missed_once() {
    play(
        &mut node(&[]),
        "
         1ms > 603 2B 00 14 05 64 00 00 00      # a deadline of 100 ms
         1ms < 583 60 00 14 05 00 00 00 00
         1ms < written 1400 5
         2ms > 000 01 03
         2ms < 183 00 00 00 00
         2ms < state Operational
       500ms > 203 01 00 00 00                  # the first one starts it
       500ms < 183 01 00 00 00
       500ms < written 2000 0
       550ms > 203 01 00 00 00
       550ms < 183 01 00 00 00                  # written is an event, though the same
       550ms < written 2000 0
       650ms < 083 50 82 10 00 00 00 00 00
       650ms < late 1
       900ms > 203 02 00 00 00
       900ms < 183 02 00 00 00
       900ms < written 2000 0
       950ms > 203 02 00 00                     # too short: has not come
       950ms < 083 10 82 10 00 00 00 00 00
       950ms < short 1
      1000ms < 083 50 82 10 00 00 00 00 00
      1000ms < late 1
      1100ms > 203 02 00 00 00
      1100ms < 183 02 00 00 00
      1100ms < written 2000 0
      1110ms > 000 80 03                        # nobody sends PDOs then
      1110ms < state PreOperational
      1300ms > 000 01 03
      1300ms < 183 02 00 00 00
      1300ms < state Operational
      1500ms > 080
        ",
    );
}

#[test]
fn an_rpdo_that_is_too_long_is_taken_and_told_once() {
    play(
        &mut node(&[]),
        "
         2ms > 000 01 03
         2ms < 183 00 00 00 00
         2ms < state Operational
         3ms > 203 01 00 00 00 09
         3ms < 083 20 82 10 00 00 00 00 00
         3ms < 183 01 00 00 00
         3ms < written 2000 0
         3ms < long 1
         4ms > 203 02 00 00 00 09
         4ms < 183 02 00 00 00
         4ms < written 2000 0
         5ms > 203 03 00 00 00
         5ms < 183 03 00 00 00
         5ms < written 2000 0
         6ms > 203 04 00 00 00 09
         6ms < 083 20 82 10 00 00 00 00 00
         6ms < 183 04 00 00 00
         6ms < written 2000 0
         6ms < long 1
        ",
    );
}

#[test]
fn remote_frames_fetch_what_their_type_says() {
    play(
        &mut node(&[]),
        "
         1ms > 603 2F 00 18 02 FD 00 00 00      # 253: as it is
         1ms < 583 60 00 18 02 00 00 00 00
         1ms < written 1800 2
         2ms > 183 R                            # no PDO before Operational
         3ms > 000 01 03
         3ms < state Operational
         4ms > set 2000 0 1
         5ms > 080
         6ms > 183 R
         6ms < 183 01 00 00 00
         7ms > 603 2F 00 18 02 FC 00 00 00      # 252: as it was at SYNC
         7ms < 583 60 00 18 02 00 00 00 00
         7ms < written 1800 2
         8ms > 183 R                            # there was none yet
         9ms > 080
        10ms > set 2000 0 2
        11ms > 183 R
        11ms < 183 01 00 00 00
        12ms > 080
        13ms > 183 R
        13ms < 183 02 00 00 00
        14ms > 603 2F 00 18 02 FF 00 00 00      # 255: besides its events
        14ms < 583 60 00 18 02 00 00 00 00
        14ms < 183 02 00 00 00
        14ms < written 1800 2
        15ms > 183 R
        15ms < 183 02 00 00 00
        16ms > 603 2F 00 18 02 01 00 00 00      # 1: at SYNC only
        16ms < 583 60 00 18 02 00 00 00 00
        16ms < written 1800 2
        17ms > 183 R
        18ms > 203 R                            # nobody asks for an RPDO
        19ms > 603 23 00 18 01 83 01 00 40      # and not at all
        19ms < 583 60 00 18 01 00 00 00 00
        19ms < written 1800 1
        20ms > 603 2F 00 18 02 FF 00 00 00
        20ms < 583 60 00 18 02 00 00 00 00
        20ms < written 1800 2
        21ms > 183 R
        ",
    );
}

#[test]
fn objects_are_packed_bit_by_bit() {
    let now = Instant::from_millis(5);
    let bool = |sub| Entry::new(0x2001, sub, DataType::Bool, Access::ReadWrite, 0).mappable();
    let objects = Dictionary::new(3)
        .with(&[bool(1), bool(2), Entry::new(0x2002, 0, DataType::I16, Access::ReadWrite, 0).mappable()])
        // A bit, three of nothing, a bit, a number across bytes, 1 + 3 + 1 + 16 = 21 bits: three bytes.
        .with_rpdo(1, 0x200, &[0x2001_0101, 0x0001_0003, 0x2001_0201, 0x2002_0010], false)
        .with_tpdo(1, 0x180, &[0x2001_0201, 0x2002_0010, 0x2001_0108], false);
    let mut node = Node::new(objects, Duration::ZERO);
    node.power_on(now);
    node.handle_timeout(now);
    node.handle_rx(now, &wire::nmt(NmtCommand::Start, 0));
    node.handle_timeout(now);
    while node.poll_tx().is_some() {}
    node.handle_rx(now, &Frame::standard(0x203, &[0b0101_1111, 0xDF]));
    assert_eq!(node.get(0x2002, 0), Some(0), "two bytes are too short");
    while node.poll_tx().is_some() {}
    let word = (-2_i16).cast_unsigned();
    let frame = 1 | 1 << 4 | u32::from(word) << 5;
    node.handle_rx(now, &Frame::standard(0x203, &frame.to_le_bytes()[..3]));
    assert_eq!([node.get(0x2001, 1), node.get(0x2001, 2), node.get(0x2002, 0)], [Some(1), Some(1), Some(-2)]);
    node.handle_timeout(now);
    let sent = 1 | u32::from(word) << 1 | 1 << 17;
    assert_eq!(node.poll_tx(), Some(Frame::standard(0x183, &sent.to_le_bytes())));
}

#[test]
fn a_mapping_of_64_single_bits_fits_and_of_65_does_not() {
    let now = Instant::from_millis(5);
    let bits: Vec<_> =
        (1..=65).map(|sub| Entry::new(0x2001, sub, DataType::Bool, Access::ReadWrite, 0).mappable()).collect();
    let map = |sub: u8| Entry::new(0x1A00, sub, DataType::U32, Access::ReadWrite, 0x2001_0001 | i64::from(sub) << 8);
    let maps: Vec<_> = (1..=65).map(map).collect();
    let objects = Dictionary::new(3).with(&bits).with_tpdo(1, 0x8000_0180, &[], false).with(&maps);
    let mut node = Node::new(objects, Duration::ZERO);
    node.power_on(now);
    node.handle_timeout(now);
    while node.poll_tx().is_some() {}
    assert_eq!(write(&mut node, now, (0x1A00, 0), 65), Err(crate::Abort::PDO_LENGTH));
    assert_eq!(write(&mut node, now, (0x1A00, 0), 64), Ok(()));
    assert_eq!(write(&mut node, now, (0x1800, 1), 0x183), Ok(()));
    node.handle_rx(now, &wire::nmt(NmtCommand::Start, 0));
    for sub in [1, 8, 33, 64] {
        node.set(0x2001, sub, 1);
    }
    node.handle_timeout(now);
    let sent = core::iter::from_fn(|| node.poll_tx()).last();
    assert_eq!(sent, Some(Frame::standard(0x183, &[0x81, 0, 0, 0, 0x01, 0, 0, 0x80])));
}
