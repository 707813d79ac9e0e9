//! Client against server, and both against literal frames.

mod block;
mod faults;
mod line;
mod script;

use super::*;
use crate::dictionary::{Access, DataType, Entry};
use crate::testing::Random;
use crate::{Abort, Dictionary, Payload};
use base::Instant;
use std::vec::Vec;

const NOW: Instant = Instant::from_millis(1);

fn objects() -> Dictionary {
    Dictionary::new(1).with(&[
        Entry::new(0x2F00, 0, DataType::Domain, Access::ReadWrite, 0),
        Entry::new(0x2F01, 0, DataType::U16, Access::WriteOnly, 0),
        Entry::new(0x6083, 0, DataType::U32, Access::ReadWrite, 10_000),
    ])
}

/// Runs the client's transfer against the server to its end.
fn finish(client: &mut Client, server: &mut Server, objects: &mut Dictionary) -> Result<Payload, Error> {
    for _ in 0..100_000 {
        while let Some(request) = client.poll_tx() {
            let answer = server.handle_rx(NOW, &request, objects);
            for answer in answer.into_iter().chain(core::iter::from_fn(|| server.poll_tx())) {
                client.handle_rx(NOW, &answer);
            }
        }
        if let Some(done) = client.poll_done() {
            return done.result;
        }
    }
    panic!("the transfer does not end");
}

fn pair() -> (Client, Server, Dictionary) {
    (Client::new(TIMEOUT), Server::new(TIMEOUT), objects())
}

#[test]
fn every_size_travels_both_ways() {
    let (mut client, mut server, mut objects) = pair();
    for len in (0..=200).chain([888, 889, 890, crate::dictionary::MAX_BYTES]) {
        let data: Vec<u8> = (0..len).map(|at| at as u8 ^ len as u8).collect();
        assert!(client.write(NOW, 0x2F00, 0, Payload::from(&data[..])));
        assert_eq!(finish(&mut client, &mut server, &mut objects), Ok(Payload::EMPTY), "{len}");
        assert!(client.read(NOW, 0x2F00, 0));
        assert_eq!(finish(&mut client, &mut server, &mut objects).as_deref(), Ok(&data[..]), "{len}");
    }
    assert!(client.write(NOW, 0x2F00, 0, Payload::from(&std::vec![0; crate::dictionary::MAX_BYTES + 1][..])));
    assert_eq!(finish(&mut client, &mut server, &mut objects), Err(Error::Refused(Abort::TOO_LONG)));
}

#[test]
fn a_refusal_reaches_the_client_with_its_code() {
    let (mut client, mut server, mut objects) = pair();
    let mut read = |index, sub| {
        client.read(NOW, index, sub);
        finish(&mut client, &mut server, &mut objects)
    };
    assert_eq!(read(0x5000, 0), Err(Error::Refused(Abort::NO_OBJECT)));
    assert_eq!(read(0x6083, 1), Err(Error::Refused(Abort::NO_SUB_INDEX)));
    assert_eq!(read(0x2F01, 0), Err(Error::Refused(Abort::WRITE_ONLY)));
    assert_eq!(read(0x6083, 0), Ok(Payload::from(&10_000_u32.to_le_bytes()[..])));
}

/// Server answers, one literal frame after the other.
fn serve(frames: &[([u8; 8], Option<[u8; 8]>)]) {
    let (mut server, mut objects) = (Server::new(TIMEOUT).without_block(), objects());
    for (at, (request, answer)) in frames.iter().enumerate() {
        let given = server.handle_rx(NOW, request, &mut objects);
        assert_eq!(given, *answer, "frame {at}: {request:02X?} answered {given:02X?}");
    }
}

#[test]
fn the_server_aborts_with_the_codes_of_the_standard() {
    // A repeated toggle, on both ways.
    serve(&[
        ([0x21, 0x00, 0x2F, 0, 10, 0, 0, 0], Some([0x60, 0x00, 0x2F, 0, 0, 0, 0, 0])),
        ([0x00, 1, 2, 3, 4, 5, 6, 7], Some([0x20, 0, 0, 0, 0, 0, 0, 0])),
        ([0x00, 1, 2, 3, 4, 5, 6, 7], Some([0x80, 0x00, 0x2F, 0, 0, 0, 0x03, 0x05])),
        ([0x60, 0, 0, 0, 0, 0, 0, 0], Some([0x80, 0, 0, 0, 0x01, 0, 0x04, 0x05])),
        ([0x40, 0x00, 0x2F, 0, 0, 0, 0, 0], Some([0x41, 0x00, 0x2F, 0, 0, 0, 0, 0])),
        ([0x70, 0, 0, 0, 0, 0, 0, 0], Some([0x80, 0x00, 0x2F, 0, 0, 0, 0x03, 0x05])),
    ]);
    // More, and less, than was promised.
    serve(&[
        ([0x21, 0x00, 0x2F, 0, 5, 0, 0, 0], Some([0x60, 0x00, 0x2F, 0, 0, 0, 0, 0])),
        ([0x01, 1, 2, 3, 4, 5, 6, 7], Some([0x80, 0x00, 0x2F, 0, 0x12, 0, 0x07, 0x06])),
        ([0x21, 0x00, 0x2F, 0, 9, 0, 0, 0], Some([0x60, 0x00, 0x2F, 0, 0, 0, 0, 0])),
        ([0x01, 1, 2, 3, 4, 5, 6, 7], Some([0x80, 0x00, 0x2F, 0, 0x13, 0, 0x07, 0x06])),
    ]);
    // No data, and more to follow.
    serve(&[
        ([0x20, 0x00, 0x2F, 0, 0, 0, 0, 0], Some([0x60, 0x00, 0x2F, 0, 0, 0, 0, 0])),
        ([0x0E, 1, 2, 3, 4, 5, 6, 7], Some([0x80, 0x00, 0x2F, 0, 0x13, 0, 0x07, 0x06])),
    ]);
    // Block transfer that is not spoken, a reserved specifier, an abort (not answered), a write that does not say its
    // size.
    serve(&[
        ([0xC6, 0x00, 0x2F, 0, 5, 0, 0, 0], Some([0x80, 0x00, 0x2F, 0, 0x01, 0, 0x04, 0x05])),
        ([0xA4, 0x00, 0x2F, 0, 127, 0, 0, 0], Some([0x80, 0x00, 0x2F, 0, 0x01, 0, 0x04, 0x05])),
        ([0xE0, 0x00, 0x2F, 0, 0, 0, 0, 0], Some([0x80, 0x00, 0x2F, 0, 0x01, 0, 0x04, 0x05])),
        ([0x80, 0x00, 0x2F, 0, 0, 0, 0x04, 0x05], None),
        ([0x22, 0x01, 0x2F, 0, 0x34, 0x12, 0, 0], Some([0x60, 0x01, 0x2F, 0, 0, 0, 0, 0])),
        ([0x2F, 0x01, 0x2F, 0, 0x34, 0, 0, 0], Some([0x80, 0x01, 0x2F, 0, 0x13, 0, 0x07, 0x06])),
        ([0x23, 0x01, 0x2F, 0, 0x34, 0, 0, 0], Some([0x80, 0x01, 0x2F, 0, 0x12, 0, 0x07, 0x06])),
    ]);
}

#[test]
fn who_does_not_say_the_size_is_aborted_when_there_is_no_room_for_more() {
    let too_long = Some([0x80, 0x00, 0x2F, 0, 0x12, 0, 0x07, 0x06]);
    let most = crate::dictionary::MAX_BYTES / 7;
    for (begin, first) in [([0x20, 0x00, 0x2F, 0, 0, 0, 0, 0], 0x00), ([0xC0, 0x00, 0x2F, 0, 0, 0, 0, 0], 0x01)] {
        let (mut server, mut objects) = (Server::new(TIMEOUT), objects());
        server.handle_rx(NOW, &begin, &mut objects);
        let mut send = |at: usize| {
            let command = if first == 0 { (at as u8 & 1) << 4 } else { (at % 127) as u8 + 1 };
            server.handle_rx(NOW, &[command, 1, 2, 3, 4, 5, 6, 7], &mut objects)
        };
        assert!((0..most).all(|at| send(at).is_none_or(|answer| answer[0] != 0x80)));
        assert_eq!(send(most), too_long);
    }
}

#[test]
fn a_silent_client_is_aborted() {
    let (mut server, mut objects) = (Server::new(TIMEOUT), objects());
    server.handle_rx(NOW, &[0x21, 0x00, 0x2F, 0, 10, 0, 0, 0], &mut objects);
    let until = NOW + TIMEOUT;
    assert_eq!(server.poll_timeout(), Some(until));
    assert_eq!(server.handle_timeout(NOW), None);
    assert_eq!(server.handle_timeout(until), Some([0x80, 0x00, 0x2F, 0, 0, 0, 0x04, 0x05]));
    assert_eq!((server.poll_timeout(), server.handle_timeout(until)), (None, None));
}

/// The client reads 0x2F00 and is answered by these frames; gives how it ended and its last words.
fn answered(frames: &[[u8; 8]]) -> (Option<Result<Payload, Error>>, Option<[u8; 8]>) {
    let mut client = Client::new(TIMEOUT);
    client.read(NOW, 0x2F00, 0);
    let mut last = client.poll_tx();
    for frame in frames {
        client.handle_rx(NOW, frame);
        while let Some(words) = client.poll_tx() {
            last = Some(words);
        }
    }
    (client.poll_done().map(|done| done.result), last)
}

fn abort(code: Abort) -> Option<[u8; 8]> {
    let [a, b, c, d] = code.0.to_le_bytes();
    Some([0x80, 0x00, 0x2F, 0, a, b, c, d])
}

#[test]
fn the_client_aborts_what_answers_nonsense() {
    let begin = |size| [0x41, 0x00, 0x2F, 0, size, 0, 0, 0];
    for (frames, code) in [
        (&[begin(10), [0x10, 1, 2, 3, 4, 5, 6, 7]][..], Abort::TOGGLE),
        (&[begin(3), [0x01, 1, 2, 3, 4, 5, 6, 7]], Abort::TOO_LONG),
        (&[begin(10), [0x01, 1, 2, 3, 4, 5, 6, 7]], Abort::TOO_SHORT),
        (&[begin(10), [0x0E, 1, 2, 3, 4, 5, 6, 7]], Abort::TOO_SHORT),
        (&[[0x41, 0x00, 0x2F, 0, 1, 0, 0x10, 0]], Abort::OUT_OF_MEMORY),
        (&[[0xE2, 0x00, 0x2F, 0, 9, 0, 0, 0]], Abort::UNKNOWN_COMMAND),
    ] {
        assert_eq!(answered(frames), (Some(Err(Error::Protocol(code))), abort(code)), "{frames:02X?}");
    }
    let refused = [0x80, 0x00, 0x2F, 0, 0xC0, 0xFF, 0x00, 0x0F];
    assert_eq!(answered(&[refused]).0, Some(Err(Error::Refused(Abort(0x0F00_FFC0)))));
}

#[test]
fn answers_to_what_was_not_asked_are_ignored() {
    // Another object, another sub-index, segments that nobody asked for, an abort of another object, too short.
    let ask = Some([0x40, 0x00, 0x2F, 0, 0, 0, 0, 0]);
    for late in [
        [0x4F, 0x83, 0x60, 0, 1, 0, 0, 0],
        [0x4F, 0x00, 0x2F, 1, 1, 0, 0, 0],
        [0x60, 0x00, 0x2F, 0, 0, 0, 0, 0],
        [0x01, 1, 2, 3, 4, 5, 6, 7],
        [0x30, 0, 0, 0, 0, 0, 0, 0],
        [0x80, 0x83, 0x60, 0, 0, 0, 0x02, 0x06],
    ] {
        assert_eq!(answered(&[late]), (None, ask), "{late:02X?}");
        let answer = [0x4F, 0x00, 0x2F, 0, 7, 0, 0, 0];
        assert_eq!(answered(&[late, answer]).0, Some(Ok(Payload::from(&[7][..]))), "{late:02X?}");
    }
}

#[test]
fn what_comes_late_of_a_transfer_that_was_given_up_is_not_of_the_next_one() {
    let begin = [0x41, 0x00, 0x2F, 0, 10, 0, 0, 0];
    let segment = [0x00, 1, 2, 3, 4, 5, 6, 7];
    let aborted = [0x80, 0x00, 0x2F, 0, 0, 0, 0x04, 0x05];
    for (heard, late) in [
        (&[][..], &[begin, segment][..]),
        (&[begin], &[segment, aborted]),
        (&[begin, segment], &[[0x19, 8, 9, 10, 0, 0, 0, 0]]),
    ] {
        let mut client = Client::new(TIMEOUT);
        client.read(NOW, 0x2F00, 0);
        heard.iter().for_each(|frame| client.handle_rx(NOW, frame));
        let then = NOW + TIMEOUT;
        client.handle_timeout(then);
        assert_eq!(client.poll_done().map(|done| done.result), Some(Err(Error::Timeout)));
        client.read(then, 0x6083, 0);
        late.iter().for_each(|frame| client.handle_rx(then, frame));
        assert_eq!((client.poll_done(), client.ignored()), (None, late.len() as u32));
        client.handle_rx(then, &[0x43, 0x83, 0x60, 0, 1, 2, 3, 4]);
        assert_eq!(client.poll_done().map(|done| done.result), Some(Ok(Payload::from(&[1, 2, 3, 4][..]))));
    }
}

#[test]
fn an_answer_that_comes_twice_is_no_toggle_error_until_nothing_else_comes() {
    let begin = [0x41, 0x00, 0x2F, 0, 10, 0, 0, 0];
    let (first, last) = ([0x00, 1, 2, 3, 4, 5, 6, 7], [0x19, 8, 9, 10, 0, 0, 0, 0]);
    let read = Payload::from(&[1, 2, 3, 4, 5, 6, 7, 8, 9, 10][..]);
    assert_eq!(answered(&[begin, begin, first, first, last]).0, Some(Ok(read)));
    assert_eq!(answered(&[begin, first, [0x00, 7, 6, 5, 4, 3, 2, 1]]).1, abort(Abort::TOGGLE));
    // A server that answers every segment alike.
    let mut client = Client::new(TIMEOUT);
    client.write(NOW, 0x2F00, 0, Payload::from(&[1; 20][..]));
    for answer in [[0x60, 0x00, 0x2F, 0, 0, 0, 0, 0], [0x20, 0, 0, 0, 0, 0, 0, 0], [0x20, 0, 0, 0, 0, 0, 0, 0]] {
        client.handle_rx(NOW, &answer);
    }
    assert_eq!(client.poll_done(), None);
    client.handle_timeout(NOW + TIMEOUT);
    assert_eq!(client.poll_done().map(|done| done.result), Some(Err(Error::Protocol(Abort::TOGGLE))));
}

#[test]
fn silence_is_aborted_once_and_the_channel_is_free_again() {
    let mut client = Client::new(TIMEOUT);
    assert!(client.read(NOW, 0x2F00, 0) && !client.read(NOW, 0x2F00, 0));
    assert!(client.poll_tx().is_some());
    let until = NOW + TIMEOUT;
    assert_eq!(client.poll_timeout(), Some(until));
    client.handle_timeout(until);
    client.handle_timeout(until);
    assert_eq!((client.poll_tx(), client.poll_tx()), (abort(Abort::TIMEOUT), None));
    let done = client.poll_done().unwrap();
    assert_eq!((done.result, done.took), (Err(Error::Timeout), TIMEOUT));
    client.handle_rx(until, &[0x4F, 0x00, 0x2F, 0, 7, 0, 0, 0]);
    assert_eq!((client.poll_done(), client.ignored()), (None, 1));
    assert!(client.read(until, 0x6083, 0));
}

#[test]
fn no_bytes_in_any_state_panic() {
    let mut random = Random::new(7);
    let (mut client, mut server, mut objects) = pair();
    for round in 0..300_000_u64 {
        let now = Instant::from_millis(round);
        let len = if random.below(10) == 0 { random.below(9) } else { 8 } as usize;
        let mut data = random.next().to_le_bytes();
        if random.below(2) == 0 {
            data[1..4].copy_from_slice(&[0x00, 0x2F, 0]);
        }
        match random.below(4) {
            // Often what a block needs to go on.
            0 => data[0] = [0xA0, 0xA1, 0xA2, 0xA3, 0xC0, 0xC1, 0xC6, 0x80][random.below(8) as usize],
            1 => data[0] = random.below(4) as u8,
            _ => {}
        }
        client.handle_rx(now, &data[..len]);
        server.handle_rx(now, &data[..len], &mut objects);
        client.handle_timeout(now);
        server.handle_timeout(now);
        let drained =
            core::iter::from_fn(|| client.poll_tx()).count() + core::iter::from_fn(|| server.poll_tx()).count();
        assert!(drained <= 2 * 127 + 4);
        client.poll_done();
        match random.below(20) {
            0 => client.read(now, 0x2F00, 0),
            1 => client.write(now, 0x2F00, 0, Payload::from(&[1; 20][..])),
            2 => client.read_block(now, 0x2F00, 0),
            3 => client.write_block(now, 0x2F00, 0, Payload::from(&[1; 2000][..])),
            _ => false,
        };
    }
}
