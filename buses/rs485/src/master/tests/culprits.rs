//! Who is named, and who is not, word by word; over a whole simulated bus: `wire::culprits`.

use super::*;

/// Polls node 20 every 10 ms; it answers, and after that `more` is heard. Says what the master says of it.
fn poll(master: &mut Master, from: u64, polls: u64, more: &str) -> String {
    let mut said = String::new();
    for n in from..from + polls {
        let now = Instant::from_millis(10 * n);
        master.request(Request { answer: Lengths::exactly(4), ..Request::new(0x20, 0x01, &[]) }).unwrap();
        assert!(master.poll_tx(now).is_some());
        master.handle_tx_done(now);
        master.handle_rx(now + Duration::from_millis(2), &words("20! 01 00 04 01 00 ff ff 36"));
        master.handle_rx(now + Duration::from_millis(4), &words(more));
        while let Some(event) = master.poll_event() {
            if !matches!(event, Event::Reply { .. }) {
                said += &format!("{}: {} ", n, write_event(&event));
            }
        }
    }
    said
}

#[test]
fn two_answers_to_one_request_time_and_again_are_a_clash() {
    let mut master = master();
    assert_eq!(poll(&mut master, 1, 10, "20! 01 00 04 01 00 fe ff 7a"), "5: clash 20 ");
    // The second device is taken away: so many answers alone as there were pairs, eight at most.
    assert_eq!(poll(&mut master, 11, 20, ""), "19: clash over 20 ");
}

#[test]
fn the_second_answer_s_address_alone_tells_too() {
    assert_eq!(poll(&mut master(), 1, 5, "20! 33 44"), "5: clash 20 ");
}

#[test]
fn an_answer_that_comes_late_is_no_second_one() {
    let mut master = master();
    for n in 1..20 {
        let now = Instant::from_millis(100 * n);
        master.request(Request { answer: Lengths::exactly(4), ..Request::new(0x20, 0x01, &[]) }).unwrap();
        assert!(master.poll_tx(now).is_some());
        master.handle_tx_done(now);
        let late = now + Duration::from_millis(25);
        master.handle_timeout(late);
        // The answer to the first attempt comes when the second was sent; then the answer to that one.
        assert!(master.poll_tx(late).is_some());
        master.handle_tx_done(late);
        for ms in [2, 4] {
            master.handle_rx(late + Duration::from_millis(ms), &words("20! 01 00 04 01 00 ff ff 36"));
        }
        while let Some(event) = master.poll_event() {
            assert!(matches!(event, Event::Reply { .. }), "{event:?}");
        }
    }
    assert_eq!(master.bus_statistics().surplus_words, 0);
}

#[test]
fn more_than_two_answers_are_babble() {
    let thrice = "20! 01 00 04 01 00 ff ff 36 20! 01 00 04 01 00 ff ff 36";
    assert_eq!(poll(&mut master(), 1, 10, thrice), "4: babble 20 ");
}

#[test]
fn a_neighbour_that_misreads_a_request_does_not_babble() {
    // 20's address came out as 30: that one finds the CRC wrong and says so.
    let mut master = master();
    for n in 1..20 {
        let now = Instant::from_millis(100 * n);
        master.request(Request::new(0x20, 0x01, &[])).unwrap();
        assert!(master.poll_tx(now).is_some());
        master.handle_tx_done(now);
        master.handle_rx(now + Duration::from_millis(2), &words("30! 01 02 00 21"));
        master.handle_rx(now + Duration::from_millis(4), &words("20! 01 00 04 01 00 ff ff 36"));
    }
    while let Some(event) = master.poll_event() {
        assert!(matches!(event, Event::Reply { .. }), "{event:?}");
    }
}

#[test]
fn however_much_is_heard_the_transaction_s_end_is_told() {
    let mut master = master();
    master.request(Request::new(0x20, 0x01, &[])).unwrap();
    assert!(master.poll_tx(Instant::ZERO).is_some());
    for address in 0x50..0x70_u8 {
        for _ in 0..4 {
            let mut frame = Words::new();
            Frame { address, instruction: 1, flags: 0, data: &[] }.encode(config().crc, &mut frame);
            master.handle_rx(Instant::from_millis(1), &frame);
        }
    }
    master.handle_rx(Instant::from_millis(2), &words("20! 01 00 04 01 00 ff ff 36"));
    let events: Vec<String> = core::iter::from_fn(|| master.poll_event()).map(|event| write_event(&event)).collect();
    assert_eq!(events, ["babble 50", "reply 20 01 Ok 01 00 ff ff"]);
}
