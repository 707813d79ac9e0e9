//! Block transfers frame by frame: one end under test, the other one written down.

use super::line::Store;
use super::script::{Node, Side, check, hex};
use crate::sdo::{Client, Error, Server, TIMEOUT};
use crate::{Abort, Payload};
use base::Instant;
use std::vec::Vec;

/// 50 bytes; their CRC is 0x6A15, as CANopenNode says too.
const NAME: &[u8; 50] = b"Position drive, simulated, with a long device name";

const BEGUN: Instant = Instant::from_millis(1000);

fn reads() -> Client {
    let mut client = Client::new(TIMEOUT);
    assert!(client.read_block(BEGUN, 0x2F00, 0));
    client
}

fn writes(data: &[u8]) -> Client {
    let mut client = Client::new(TIMEOUT);
    assert!(client.write_block(BEGUN, 0x2F00, 0, Payload::from(data)));
    client
}

fn serves(data: &[u8]) -> Node {
    Node { server: Server::new(TIMEOUT), store: Store { data: data.to_vec(), writes: 0 }, told: 0 }
}

fn serves_by(blksize: u8) -> Node {
    Node { server: Server::new(TIMEOUT).with_block_size(blksize), ..serves(b"") }
}

/// What the client says last, and how it ends, when all it is answered is `frames`.
fn ends(client: Client, frames: &[[u8; 8]]) -> (Option<[u8; 8]>, Option<Error>) {
    let (mut client, mut last) = (client, None);
    for frame in frames {
        client.handle_rx(BEGUN, frame);
        while let Some(words) = client.poll_tx() {
            last = Some(words);
        }
    }
    (last, client.poll_done().and_then(|done| done.result.err()))
}

/// What the server says last when all it is asked is `frames`.
fn answers(node: Node, frames: &[[u8; 8]]) -> Option<[u8; 8]> {
    let mut node = node;
    frames.iter().fold(None, |last, frame| node.hears(BEGUN, *frame).or(last))
}

fn abort(code: Abort) -> [u8; 8] {
    let [a, b, c, d] = code.0.to_le_bytes();
    [0x80, 0x00, 0x2F, 0, a, b, c, d]
}

#[test]
fn a_text_is_read_in_one_block() {
    check(
        reads(),
        "
        < A4 00 2F 00 7F 1C                   # CRC, blocks of 127, up to 28 bytes in any way
        > C6 00 2F 00 32                      # CRC, 50 bytes
        < A3
        > 01 50 6F 73 69 74 69 6F
        > 02 6E 20 64 72 69 76 65
        > 03 2C 20 73 69 6D 75 6C
        > 04 61 74 65 64 2C 20 77
        > 05 69 74 68 20 61 20 6C
        > 06 6F 6E 67 20 64 65 76
        > 07 69 63 65 20 6E 61 6D
        > 88 65
        < A2 08 7F
        > D9 15 6A                            # 6 bytes of the last segment do not count
        < A1
        done Position drive, simulated, with a long device name
        ",
    );
    check(
        serves(NAME),
        "
        > A4 00 2F 00 7F 1C
        < C6 00 2F 00 32
        > A3
        < 01 50 6F 73 69 74 69 6F
        < 02 6E 20 64 72 69 76 65
        < 03 2C 20 73 69 6D 75 6C
        < 04 61 74 65 64 2C 20 77
        < 05 69 74 68 20 61 20 6C
        < 06 6F 6E 67 20 64 65 76
        < 07 69 63 65 20 6E 61 6D
        < 88 65
        > A2 08 7F
        < D9 15 6A
        > A1
        > A1                                  # once more: nothing
        > 60                                  # of no transfer
        < 80 00 00 00 01 00 04 05
        ",
    );
}

#[test]
fn a_text_is_written_in_one_block() {
    check(
        writes(NAME),
        "
        < C6 00 2F 00 32
        > A4 00 2F 00 7F
        < 01 50 6F 73 69 74 69 6F
        < 02 6E 20 64 72 69 76 65
        < 03 2C 20 73 69 6D 75 6C
        < 04 61 74 65 64 2C 20 77
        < 05 69 74 68 20 61 20 6C
        < 06 6F 6E 67 20 64 65 76
        < 07 69 63 65 20 6E 61 6D
        < 88 65
        > A2 08 7F
        < D9 15 6A
        > A1
        done
        ",
    );
    check(
        serves(b""),
        "
        > C6 00 2F 00 32
        < A4 00 2F 00 7F
        > 01 50 6F 73 69 74 69 6F
        > 02 6E 20 64 72 69 76 65
        > 03 2C 20 73 69 6D 75 6C
        > 04 61 74 65 64 2C 20 77
        > 05 69 74 68 20 61 20 6C
        > 06 6F 6E 67 20 64 65 76
        > 07 69 63 65 20 6E 61 6D
        > 88 65
        < A2 08 7F
        > D9 15 6A
        < A1
        written Position drive, simulated, with a long device name
        ",
    );
}

#[test]
fn the_size_of_a_block_changes_with_every_acknowledge_and_what_was_lost_comes_again() {
    check(
        writes(NAME),
        "
        < C6 00 2F 00 32
        > A4 00 2F 00 03
        < 01 50 6F 73 69 74 69 6F
        < 02 6E 20 64 72 69 76 65
        < 03 2C 20 73 69 6D 75 6C
        > A2 01 02                            # the second was lost: again from there
        < 01 6E 20 64 72 69 76 65
        < 02 2C 20 73 69 6D 75 6C
        > A2 00 04                            # all was lost
        < 01 6E 20 64 72 69 76 65
        < 02 2C 20 73 69 6D 75 6C
        < 03 61 74 65 64 2C 20 77
        < 04 69 74 68 20 61 20 6C
        > A2 04 7F
        < 01 6F 6E 67 20 64 65 76
        < 02 69 63 65 20 6E 61 6D
        < 83 65
        > A2 03 7F
        < D9 15 6A
        > A1
        done
        ",
    );
    check(
        serves_by(3),
        "
        > C6 00 2F 00 32
        < A4 00 2F 00 03
        > 01 50 6F 73 69 74 69 6F
        > 03 6F 6E 20 64 72 69 76             # 2 was lost
        < A2 01 03
        > 01 6E 20 64 72 69 76 65
        > 02 2C 20 73 69 6D 75 6C
        > 03 61 74 65 64 2C 20 77
        < A2 03 03
        > 82 65                               # the end, but 1 was lost
        < A2 00 03
        > 01 78
        > 80 00 2F 00 00 00 00 08             # given up
        > 60
        < 80 00 00 00 01 00 04 05
        ",
    );
}

#[test]
fn the_lost_end_of_a_block_is_acknowledged_after_a_silence() {
    check(
        serves(b""),
        "
        > C6 00 2F 00 32
        < A4 00 2F 00 7F
        > 01 50 6F 73 69 74 69 6F
        > 02 6E 20 64 72 69 76 65
        > 03 2C 20 73 69 6D 75 6C
        > 04 61 74 65 64 2C 20 77
        > 05 69 74 68 20 61 20 6C
        + 124
        + 1                                   # a quarter of the time-out
        < A2 05 7F
        > 01 6F 6E 67 20 64 65 76
        > 02 69 63 65 20 6E 61 6D
        > 83 65
        < A2 03 7F
        > D9 15 6A
        < A1
        written Position drive, simulated, with a long device name
        ",
    );
    // The sender was only slow: what it still had on the way is not of the new block, whose segments begin at 1.
    check(
        reads(),
        "
        < A4 00 2F 00 7F 1C
        > C6 00 2F 00 32
        < A3
        > 01 50 6F 73 69 74 69 6F
        > 02 6E 20 64 72 69 76 65
        > 03 2C 20 73 69 6D 75 6C
        > 04 61 74 65 64 2C 20 77
        > 05 69 74 68 20 61 20 6C
        + 125
        < A2 05 7F
        > 06 6F 6E 67 20 64 65 76
        > 07 69 63 65 20 6E 61 6D
        > 88 65
        + 125
        > 01 6F 6E 67 20 64 65 76
        > 02 69 63 65 20 6E 61 6D
        > 83 65
        < A2 03 7F
        > D9 15 6A
        < A1
        done Position drive, simulated, with a long device name
        ",
    );
}

#[test]
fn who_sends_nothing_new_is_given_up_and_what_still_comes_is_not_obeyed() {
    check(
        serves(b""),
        "
        > C6 00 2F 00 C8
        < A4 00 2F 00 7F
        > 01 50 6F 73 69 74 69 6F
        > 02 6E 20 64 72 69 76 65
        + 125
        < A2 02 7F
        + 374
        + 1                                   # since the last segment
        < 80 00 2F 00 00 00 04 05
        > 01 00 2F 00 41                      # a new block, too late; byte 0 of any command
        > 02 00 2F 00 41
        > 2F 00 2F 00 41                      # but this is a request
        < 60 00 2F 00
        written A
        ",
    );
    check(
        reads(),
        "
        < A4 00 2F 00 7F 1C
        > C6 00 2F 00 C8
        < A3
        + 500
        < 80 00 2F 00 00 00 04 05
        failed no answer in time
        ",
    );
    let mut client = Client::new(TIMEOUT);
    client.read_block(BEGUN, 0x2F00, 0);
    for frame in ["C6 00 2F 00 C8", "01", "02"] {
        client.handle_rx(BEGUN, &hex(frame));
    }
    client.cancel();
    assert!(client.read(BEGUN, 0x2F00, 0));
    client.handle_rx(BEGUN, &hex("03 00 2F 00"));
    check(
        client,
        "
        < 40 00 2F 00
        > 04                                  # of the block that was given up
        > 4F 00 2F 00 41
        done A
        ",
    );
}

#[test]
fn who_acknowledges_nothing_is_given_up() {
    check(
        writes(b"twenty-two bytes more!"),
        "
        < C6 00 2F 00 16
        > A4 00 2F 00 02
        < 01 74 77 65 6E 74 79 2D
        < 02 74 77 6F 20 62 79 74
        + 500                                 # segments left meanwhile: the time counts from here
        + 499
        + 1
        < 80 00 2F 00 00 00 04 05
        failed no answer in time
        ",
    );
    check(
        serves(b"text"),
        "
        > A4 00 2F 00 7F
        < C6 00 2F 00 04
        + 499
        + 1                                   # never started
        < 80 00 2F 00 00 00 04 05
        ",
    );
    // One that takes nothing, for ever.
    let mut begun = Vec::from([hex("A4 00 2F 00 7F")]);
    begun.extend([hex("A2 00 7F"); 8]);
    assert_eq!(ends(writes(NAME), &begun[..8]).1, None);
    assert_eq!(ends(writes(NAME), &begun), (Some(abort(Abort::SEQUENCE)), Some(Error::Protocol(Abort::SEQUENCE))));
}

#[test]
fn without_a_word_about_crc_none_is_checked() {
    check(
        reads(),
        "
        < A4 00 2F 00 7F 1C
        > C2 00 2F 00 04
        < A3
        > 81 74 65 78 74
        < A2 01 7F
        > CD 11 11
        < A1
        done text
        ",
    );
    check(
        serves(b""),
        "
        > C0 00 2F 00                         # nor about the size
        < A0 00 2F 00 7F
        > 01 41 20 74 65 78 74 2C
        > 82 20 6D 6F 72 65
        < A2 02 7F
        > C9
        < A1
        written A text, more
        ",
    );
    check(
        serves(b"text"),
        "
        > A0 00 2F 00 7F
        < C2 00 2F 00 04
        > A3
        < 81 74 65 78 74
        > A2 01 7F
        < CD
        > A1
        ",
    );
}

#[test]
fn a_server_may_answer_in_its_own_way() {
    for (answers, last) in [
        (&["43 00 2F 00 74 65 78 74"][..], "40"),
        (&["41 00 2F 00 04", "07 74 65 78 74"], "60"),
        (&["80 00 2F 00 01 00 04 05", "43 00 2F 00 74 65 78 74"], "40 00 2F 00"),
    ] {
        let mut client = reads();
        client.poll_tx();
        let mut said = hex("40");
        for answer in answers {
            client.handle_rx(BEGUN, &hex(answer));
            said = client.poll_tx().unwrap_or(said);
        }
        assert_eq!(said, hex(last));
        assert_eq!(client.tells().as_deref(), Some("done text"));
    }
    check(
        writes(b"text"),
        "
        < C6 00 2F 00 04
        > 80 00 2F 00 01 00 04 05
        < 23 00 2F 00 74 65 78 74
        > 60 00 2F 00
        done
        ",
    );
    check(
        writes(b"a text"),
        "
        < C6 00 2F 00 06
        > 80 00 2F 00 01 00 04 05
        < 21 00 2F 00 06
        > 60 00 2F 00
        < 03 61 20 74 65 78 74
        > 80 00 2F 00 01 00 04 05             # now it is a refusal
        failed refused: unknown command specifier (0x05040001)
        ",
    );
    check(
        serves(b"a text"),
        "
        > A4 00 2F 00 7F 06                   # six bytes in any way
        < 41 00 2F 00 06
        > A4 00 2F 00 7F 05
        < C6 00 2F 00 06
        ",
    );
}

#[test]
fn an_acknowledge_may_come_before_the_last_segment_left() {
    let mut client = writes(NAME);
    client.poll_tx();
    client.handle_rx(BEGUN, &hex("A4 00 2F 00 06"));
    let mut next = || client.poll_tx().map(|frame| frame[0]);
    assert_eq!([next(), next(), next()], [Some(1), Some(2), Some(3)]);
    // More than was sent: of no block of this transfer. Then two of the three.
    client.handle_rx(BEGUN, &hex("A2 04 06"));
    client.handle_rx(BEGUN, &hex("A2 02 06"));
    let rest: Vec<_> = core::iter::from_fn(|| client.poll_tx()).collect();
    let third = hex("01 2C 20 73 69 6D 75 6C");
    assert_eq!((rest.len(), rest[0], rest[5]), (6, third, hex("86 65")));
}

#[test]
fn the_client_aborts_what_breaks_the_rules_of_blocks() {
    let read = hex("C6 00 2F 00 08");
    let segments = [read, hex("01 61 62 63 64 65 66 67"), hex("82 68")];
    let both = |more: &[[u8; 8]]| [&segments[..], more].concat();
    for (client, frames, code) in [
        (writes(b"A"), Vec::from([hex("A4 00 2F 00 00")]), Abort::BLOCK_SIZE),
        (writes(b"A"), Vec::from([hex("A4 00 2F 00 80")]), Abort::BLOCK_SIZE),
        (writes(NAME), Vec::from([hex("A4 00 2F 00 02"), hex("A2 02 00")]), Abort::BLOCK_SIZE),
        (writes(NAME), Vec::from([hex("A4 00 2F 00 02"), hex("A2 80 02")]), Abort::SEQUENCE),
        (reads(), Vec::from([hex("C6 00 2F 00 01 00 10")]), Abort::OUT_OF_MEMORY),
        (reads(), Vec::from([read, hex("00 61")]), Abort::SEQUENCE),
        (reads().with_block_size(4), Vec::from([read, hex("05 61")]), Abort::SEQUENCE),
        (reads(), Vec::from([hex("C6 00 2F 00 06"), segments[1]]), Abort::TOO_LONG),
        (reads(), both(&[hex("D5 00 00")]), Abort::TOO_LONG),
        (reads(), both(&[hex("DD 00 00")]), Abort::TOO_SHORT),
        (reads(), both(&[hex("D9 00 00")]), Abort::CRC),
    ] {
        assert_eq!(ends(client, &frames), (Some(abort(code)), Some(Error::Protocol(code))), "{frames:02X?}");
    }
    let refused = both(&[hex("80 00 2F 00 24 00 00 08")]);
    assert_eq!(ends(reads(), &refused), (Some(hex("A2 02 7F")), Some(Error::Refused(Abort::NO_DATA))));
    // Another object's abort is nobody's segment, and what is no end is not taken for one.
    let other = hex("80 01 2F 00 24 00 00 08");
    let others = [read, other, segments[1], other, segments[2], other, hex("01"), hex("A1"), hex("82 68"), [0xE0; 8]];
    assert_eq!(ends(reads(), &others), (Some(hex("A2 02 7F")), None));
}

#[test]
fn the_server_aborts_what_breaks_the_rules_of_blocks() {
    let write = hex("C6 00 2F 00 08");
    let segments = [write, hex("01 61 62 63 64 65 66 67"), hex("82 68")];
    let both = |more: &str| [&segments[..], &[hex(more)]].concat();
    let (read, start) = (hex("A4 00 2F 00 04"), hex("A3"));
    for (node, frames, code) in [
        (serves(NAME), Vec::from([hex("A4 00 2F 00 00")]), Abort::BLOCK_SIZE),
        (serves(NAME), Vec::from([hex("A4 00 2F 00 80")]), Abort::BLOCK_SIZE),
        (serves(NAME), Vec::from([read, start, hex("A2 80 7F")]), Abort::SEQUENCE),
        (serves(NAME), Vec::from([read, start, hex("A2 00 80")]), Abort::BLOCK_SIZE),
        (serves(NAME), Vec::from([read, hex("A2 00 7F")]), Abort::UNKNOWN_COMMAND),
        (serves(NAME), Vec::from([read, hex("60")]), Abort::UNKNOWN_COMMAND),
        (serves(b""), Vec::from([hex("C6 00 2F 00 01 00 10")]), Abort::TOO_LONG),
        (serves(b""), Vec::from([write, hex("00 61")]), Abort::SEQUENCE),
        (serves_by(4), Vec::from([write, hex("05 61")]), Abort::SEQUENCE),
        (serves(b""), Vec::from([hex("C6 00 2F 00 06"), segments[1]]), Abort::TOO_LONG),
        (serves(b""), both("D5 00 00"), Abort::TOO_LONG),
        (serves(b""), both("DD 00 00"), Abort::TOO_SHORT),
        (serves(b""), both("D9 00 00"), Abort::CRC),
        (serves(b""), both("40 00 2F 00"), Abort::UNKNOWN_COMMAND),
    ] {
        assert_eq!(answers(node, &frames), Some(abort(code)), "{frames:02X?}");
    }
    let nowhere = |command| answers(serves(b""), &[[command, 0x00, 0x50, 0, 1, 0, 0, 0]]);
    assert_eq!(nowhere(0xC6), Some(hex("80 00 50 00 00 00 02 06")));
    assert_eq!(nowhere(0xA4), nowhere(0xC6));
    // python-canopen does not say what it gives up.
    let given_up = [write, segments[1], hex("80 00 00 00 00 00 00 08"), hex("4F")];
    assert_eq!(answers(serves(b""), &given_up), Some(hex("80 00 00 00 00 00 02 06")));
}

#[test]
fn a_last_segment_that_looks_like_the_end_is_told_from_it() {
    // 455 zeros: the 65th segment is C1 and seven zeros, and so is the end.
    for (begin, written) in [("C6 00 2F 00 C7 01", 1), ("C0 00 2F 00", 0)] {
        let mut node = serves(b"");
        node.hears(BEGUN, hex(begin));
        for number in 1..=64 {
            assert_eq!(node.hears(BEGUN, [number, 0, 0, 0, 0, 0, 0, 0]), None);
        }
        assert_eq!(node.hears(BEGUN, hex("C1")), Some(hex("A2 41 7F")));
        node.hears(BEGUN, hex("C1"));
        assert_eq!(node.store.writes, written);
    }
    // Another 65th segment comes twice: as an end it would be a wrong one.
    let mut node = serves(b"");
    node.hears(BEGUN, hex("C6 00 2F 00 C7 01"));
    for number in 1..=64 {
        node.hears(BEGUN, [number, 0, 0, 0, 0, 0, 0, 0]);
    }
    let last = hex("C1 00 00 00 00 00 00 01");
    assert_eq!([node.hears(BEGUN, last), node.hears(BEGUN, last)], [Some(hex("A2 41 7F")), None]);
    assert_eq!(node.hears(BEGUN, hex("C1 21 10")), Some(hex("A1")));
    assert_eq!((node.store.writes, node.store.data.last()), (1, Some(&1)));
}
