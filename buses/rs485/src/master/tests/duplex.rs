//! The full-duplex link to the PSC1: transactions, and what the board says beside them.

use super::*;
use crate::boards::psc1;

fn link() -> Master {
    let mut master = Master::new(Config { full_duplex: true, unasked: psc1::UNASKED, ..config() });
    assert!(master.add_node(psc1::ADDRESS, Duration::from_millis(20)));
    master
}

#[test]
fn what_a_board_says_unasked_is_told_from_the_answer_by_its_instruction() {
    let master = check_with(
        link(),
        "
         0.5ms > rx 40! 80 00 02 01 03 ed      # before anything was asked
         0.5ms < unasked 40 80 01 03
         0.6ms > ask 40 01
         0.6ms < tx 40! 01 00 00 42            # at once: the board's own pair is its own
         1ms   > rx 40! 80 00 02 00 03 a1      # while the request is under way
         1ms   < unasked 40 80 00 03
         1.1ms > sent
         1.6ms > rx 40! 81 00 01 1e 00         # while the answer is waited for
         1.6ms < unasked 40 81 1e
         2.2ms > rx 40! 01 00 01 ff 9a
         2.2ms < reply 40 01 Ok ff
    ",
    );
    let statistics = master.statistics(psc1::ADDRESS).unwrap();
    assert_eq!((statistics.unasked, statistics.round_trips.count(), statistics.retries), (3, 1, 0));
    assert_eq!(master.bus_statistics().stray_frames, 0);
}

#[test]
fn a_frame_half_received_when_a_request_goes_out_is_not_lost() {
    check_with(
        link(),
        "
         1ms   > rx 40! 80 00
         1ms   > ask 40 01
         1ms   < tx 40! 01 00 00 42
         1.3ms > rx 02 01 03 ed
         1.3ms < unasked 40 80 01 03
         1.5ms > sent
         2.2ms > rx 40! 01 00 01 ff 9a
         2.2ms < reply 40 01 Ok ff
    ",
    );
}

#[test]
fn a_damaged_unasked_frame_leaves_the_answer_its_time() {
    check_with(
        link(),
        "
          1ms   > ask 40 01
          1ms   < tx 40! 01 00 00 42
          1.5ms > sent
          2ms   > rx 40! 80 00 02 01 02 ed
          2.6ms > rx 40! 01 00 01 ff 9a
          2.6ms < reply 40 01 Ok ff
          3ms   > ask 40 01
          3ms   < tx 40! 01 00 00 42
          3.5ms > sent
          4ms   > rx 40! 01 00 01 fe 9a        # this one is the answer's
          4ms   < tx 40! 01 01 00 0e
          4.5ms > sent
          5ms   > rx 40! 80 00 02 01 02 ed     # was it the answer, and damaged beyond recognition?
         24.5ms < tx 40! 01 00 00 42
    ",
    );
}

#[test]
fn what_the_board_may_not_say_is_not_believed() {
    let master = check_with(
        link(),
        "
         1ms > rx 40! 82 00 00 0e              # no such instruction
         2ms > rx 40! 80 00 01 01 eb           # too short
         3ms > rx 40! 01 00 01 ff 9a           # an answer that nobody waits for
         4ms > rx 40! 80 01 00 41              # a status where there is none
    ",
    );
    assert_eq!(master.bus_statistics().stray_frames, 4);
}

#[test]
fn an_instruction_that_is_asked_for_is_an_answer_even_if_it_may_come_unasked() {
    check_with(
        link(),
        "
         1ms   > ask 40 80
         1ms   < tx 40! 80 00 00 0d
         1.5ms > sent
         2.2ms > rx 40! 80 00 02 01 03 ed
         2.2ms < reply 40 80 Ok 01 03
         3ms   > rx 40! 80 00 02 00 03 a1
         3ms   < unasked 40 80 00 03
    ",
    );
}

#[test]
fn a_flood_of_unasked_frames_does_not_hide_the_answer() {
    let mut master = link();
    master.request(Request::new(0x40, 1, &[])).unwrap();
    assert!(master.poll_tx(Instant::ZERO).is_some());
    let flood: Vec<Word> = (0..1000).flat_map(|_| words("40! 80 00 02 01 03 ed")).collect();
    master.handle_rx(Instant::from_millis(5), &flood);
    master.handle_rx(Instant::from_millis(6), &words("40! 01 00 01 ff 9a"));
    let events: Vec<String> = core::iter::from_fn(|| master.poll_event()).map(|event| write_event(&event)).collect();
    assert_eq!(events.len(), 5);
    assert_eq!(events[4], "reply 40 01 Ok ff");
    assert_eq!(master.statistics(0x40).unwrap().unasked, 1000);
}

#[test]
fn unasked_frames_are_served_between_polls_on_a_half_duplex_bus_too() {
    let master = Master::new(Config { unasked: psc1::UNASKED, ..config() });
    check_with(
        master,
        "
         1ms   > rx 40! 80 00 02 01 03 ed
         1ms   < unasked 40 80 01 03
         1ms   > ask 40 01
         1.2ms < tx 40! 01 00 00 42
    ",
    );
}
