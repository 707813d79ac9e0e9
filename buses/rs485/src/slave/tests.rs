//! The answering side against frames typed from docs/facts/boards.md.

use super::*;
use crate::testing::{text, words};
use std::string::String;

const MS: Duration = Duration::from_millis(1);

/// The board at 20; at 110 000 Bd a word takes 0.1 ms.
fn slave() -> Slave {
    Slave::new(Config { baud: 110_000, ..Config::new(0x20) })
}

/// Feeds words that end now, lets the board answer with `answer`, and says what is sent within 10 ms.
fn ask(slave: &mut Slave, now: Instant, request: &str, answer: Option<(Status, &[u8])>) -> String {
    slave.handle_rx(now, &words(request));
    let asked = slave.poll_request().is_some();
    if let Some((status, data)) = answer {
        assert!(asked, "the board is not asked");
        slave.respond(status, data);
    } else {
        assert!(!asked, "the board is asked");
    }
    let due = now + slave.config().delay;
    assert!(slave.poll_tx(due - Duration::from_nanos(1)).is_none());
    slave.poll_tx(due).map(|transmit| text(transmit.words)).unwrap_or_default()
}

const TICKS: Option<(Status, &[u8])> = Some((Status::Ok, &[1, 0, 0xFF, 0xFF]));

fn at(ms: u64) -> Instant {
    Instant::from_millis(ms)
}

#[test]
fn a_request_is_answered_after_200_us() {
    let mut slave = slave();
    assert_eq!(ask(&mut slave, at(1), "20! 01 00 00 9c", TICKS), "20! 01 00 04 01 00 ff ff 36");
    assert_eq!(slave.poll_timeout(), None);
    slave.handle_rx(at(5), &words("20! 01 00 00 9c"));
    slave.respond(Status::Ok, &[]);
    assert_eq!(slave.poll_timeout(), Some(at(5) + Duration::from_micros(200)));
}

#[test]
fn resend_repeats_the_last_answer_without_asking_the_board() {
    let mut slave = slave();
    let first = ask(&mut slave, at(1), "20! 01 00 00 9c", TICKS);
    assert_eq!(ask(&mut slave, at(10), "20! 01 01 00 d0", None), first);
    assert_eq!(ask(&mut slave, at(20), "20! 01 01 00 d0", None), first, "as often as asked");
}

#[test]
fn resend_of_what_was_never_answered_asks_the_board() {
    let mut slave = slave();
    assert_eq!(ask(&mut slave, at(1), "20! 01 01 00 d0", TICKS), "20! 01 00 04 01 00 ff ff 36");
    // Another instruction came between.
    assert_eq!(ask(&mut slave, at(10), "20! 02 00 00 10", Some((Status::Ok, &[]))), "20! 02 00 00 10");
    assert_eq!(ask(&mut slave, at(20), "20! 01 01 00 d0", TICKS), "20! 01 00 04 01 00 ff ff 36");
}

#[test]
fn a_damaged_request_is_answered_with_badcrc_and_not_given_to_the_board() {
    let mut slave = slave();
    assert_eq!(ask(&mut slave, at(1), "20! 01 00 00 9d", None), "20! 01 02 00 04");
    assert_eq!(ask(&mut slave, at(10), "20! 01 01 00 d0", TICKS), "20! 01 00 04 01 00 ff ff 36", "nothing to repeat");
}

#[test]
fn an_unknown_instruction_is_answered_with_unkinstr() {
    assert_eq!(ask(&mut slave(), at(1), "20! 01 00 00 9c", Some((Status::UnknownInstruction, &[]))), "20! 01 03 00 48");
}

#[test]
fn a_broadcast_and_no_ack_are_done_and_never_answered() {
    let mut slave = slave();
    for request in ["ff! ff 00 00 f1", "20! 02 02 00 88"] {
        slave.handle_rx(at(1), &words(request));
        assert!(!slave.poll_request().unwrap().answered);
        slave.respond(Status::Ok, &[]);
        assert_eq!((slave.poll_timeout(), slave.poll_tx(at(100))), (None, None));
    }
    assert_eq!(ask(&mut slave, at(200), "ff! ff 00 00 f0", None), "", "not even when damaged");
}

#[test]
fn what_is_meant_for_another_is_not_answered() {
    assert_eq!(ask(&mut slave(), at(1), "10! 10 00 00 64", None), "");
    assert_eq!(ask(&mut slave(), at(1), "10! 10 00 00 65", None), "", "not even when damaged");
}

#[test]
fn a_gap_of_more_than_5_ms_drops_the_request() {
    let mut slave = slave();
    slave.handle_rx(at(1), &words("20! 01"));
    // Three words that end at 6.25 ms: the first of them ended at 6.05 ms, 5.05 ms after the one before.
    assert_eq!(ask(&mut slave, at(6) + MS / 4, "00 00 9c", None), "");
    slave.handle_rx(at(11), &words("20! 01"));
    assert_ne!(ask(&mut slave, at(16) + MS / 5, "00 00 9c", TICKS), "", "exactly 5 ms");
    assert_eq!(slave.reception().gaps, 1);
}

#[test]
fn a_board_that_does_not_answer_in_time_is_silent() {
    let mut slave = slave();
    slave.handle_rx(at(1), &words("20! 01 00 00 9c"));
    let until = slave.poll_timeout().unwrap();
    assert_eq!(until, at(21) + Duration::from_micros(200));
    slave.handle_timeout(until);
    slave.respond(Status::Ok, &[]);
    assert_eq!((slave.poll_timeout(), slave.poll_tx(at(100))), (None, None));
    assert_eq!(slave.poll_request(), None);
}

#[test]
fn a_reset_forgets_what_is_to_be_sent_and_repeated() {
    let mut slave = slave();
    slave.handle_rx(at(1), &words("20! 01 00 00 9c"));
    slave.respond(Status::Ok, &[]);
    slave.reset();
    assert_eq!(slave.poll_tx(at(100)), None);
    assert_ne!(ask(&mut slave, at(200), "20! 01 01 00 d0", TICKS), "", "nothing to repeat: the board is asked");
}

#[test]
fn after_any_garbage_the_next_request_is_answered() {
    let mut random = crate::testing::Random::new(8);
    let mut slave = slave();
    for n in 1..20_000 {
        let share = 1 + random.next() % 64;
        let garbage: std::vec::Vec<Word> =
            (0..random.next() % 300).map(|_| Word { byte: random.next() as u8, ninth: random.one_in(share) }).collect();
        slave.handle_rx(at(100 * n), &garbage);
        // What the garbage may have asked is forgotten.
        while slave.poll_request().is_some() {}
        slave.handle_timeout(at(100 * n + 50));
        assert_eq!(ask(&mut slave, at(100 * n + 60), "20! 01 00 00 9c", TICKS), "20! 01 00 04 01 00 ff ff 36");
    }
}
