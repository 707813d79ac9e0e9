//! Transcripts: `>` is what the world does, `<` what the master answers; time jumps to the next deadline by itself.
//! At 110 000 Bd a word takes exactly 0.1 ms.

use super::*;
use crate::testing::{Random, text, words};
use std::format;
use std::string::String;
use std::vec::Vec;

fn config() -> Config {
    Config { baud: 110_000, ..Config::default() }
}

/// A master with the nodes 10 and 20 that are given 20 ms, and 30 that is given 5 ms.
fn master() -> Master {
    let mut master = Master::new(config());
    assert!(master.add_node(0x10, Duration::from_millis(20)));
    assert!(master.add_node(0x20, Duration::from_millis(20)));
    assert!(master.add_node(0x30, Duration::from_millis(5)));
    master
}

fn parse_time(text: &str) -> Instant {
    let ms: f64 = text.strip_suffix("ms").expect("a time in ms").parse().expect("a number");
    Instant::from_nanos((ms * 1e6 + 0.5) as u64)
}

fn write_time(at: Instant) -> String {
    format!("{}ms", at.as_nanos() as f64 / 1e6)
}

fn parse_bytes(tokens: &[&str]) -> Vec<u8> {
    tokens.iter().map(|token| u8::from_str_radix(token, 16).unwrap()).collect()
}

fn write_event(event: &Event) -> String {
    match event {
        Event::Reply { to, instruction, status, data, .. } => {
            let data: String = data.iter().map(|byte| format!(" {byte:02x}")).collect();
            format!("reply {to:02x} {instruction:02x} {status:?}{data}")
        }
        Event::Sent { to, instruction } => format!("sent {to:02x} {instruction:02x}"),
        Event::Silent { to, instruction } => format!("silent {to:02x} {instruction:02x}"),
        Event::Garbled { to, instruction, why } => format!("garbled {to:02x} {instruction:02x} {why:?}"),
        Event::Unsent { to, instruction } => format!("unsent {to:02x} {instruction:02x}"),
        Event::Degraded { node } => format!("degraded {node:02x}"),
        Event::Recovered { node } => format!("recovered {node:02x}"),
        Event::Lost { node } => format!("lost {node:02x}"),
        Event::Back { node } => format!("back {node:02x}"),
        Event::Unasked { from, instruction, data } => {
            let data: String = data.iter().map(|byte| format!(" {byte:02x}")).collect();
            format!("unasked {from:02x} {instruction:02x}{data}")
        }
        Event::Babble { who } => format!("babble {}", who_text(*who)),
        Event::BabbleOver { who } => format!("babble over {}", who_text(*who)),
        Event::Clash { node, certain } => format!("clash {node:02x}{}", if *certain { "" } else { " perhaps" }),
        Event::ClashOver { node } => format!("clash over {node:02x}"),
    }
}

fn who_text(who: Option<u8>) -> String {
    who.map_or("?".into(), |who| format!("{who:02x}"))
}

struct Transcript {
    master: Master,
    lines: Vec<String>,
    /// The host does not drain while it is stalled.
    stalled: bool,
}

impl Transcript {
    fn drain(&mut self, now: Instant) {
        if self.stalled {
            return;
        }
        if let Some(transmit) = self.master.poll_tx(now) {
            self.lines.push(format!("{} < tx {}", write_time(now), text(transmit.words)));
        }
        while let Some(event) = self.master.poll_event() {
            self.lines.push(format!("{} < {}", write_time(now), write_event(&event)));
        }
        assert!(self.master.poll_timeout().is_none_or(|due| due > now), "due after a drain");
    }

    /// Serves all deadlines up to `end`.
    fn pass(&mut self, end: Instant) {
        while let Some(due) = self.master.poll_timeout().filter(|due| *due < end) {
            self.master.handle_timeout(due);
            self.drain(due);
        }
    }

    fn input(&mut self, now: Instant, tokens: &[&str]) {
        self.pass(now);
        match *tokens {
            ["ask", to, instruction, ref data @ ..] => {
                let data = parse_bytes(data);
                let [to, instruction] = [to, instruction].map(|byte| u8::from_str_radix(byte, 16).unwrap());
                let answer = if to == 0x20 { Lengths::exactly(4) } else { Lengths::ANY };
                self.master.request(Request { answer, ..Request::new(to, instruction, &data) }).unwrap();
            }
            ["tell", to, instruction] => {
                let [to, instruction] = [to, instruction].map(|byte| u8::from_str_radix(byte, 16).unwrap());
                self.master.request(Request { no_ack: true, ..Request::new(to, instruction, &[]) }).unwrap();
            }
            ["rx", ref rest @ ..] => self.master.handle_rx(now, &words(&rest.join(" "))),
            ["sent"] => self.master.handle_tx_done(now),
            ["stall"] => self.stalled = true,
            ["go"] => self.stalled = false,
            ["cancel"] => self.master.cancel(),
            ref other => panic!("no such input: {other:?}"),
        }
        self.drain(now);
    }
}

fn check_with(master: Master, transcript: &str) -> Master {
    let strip = |line: &str| line.split('#').next().unwrap_or("").split_whitespace().collect::<Vec<_>>().join(" ");
    let expected: Vec<String> = transcript.lines().map(strip).filter(|line| !line.is_empty()).collect();
    let mut run = Transcript { master, lines: Vec::new(), stalled: false };
    let mut last = Instant::ZERO;
    for line in &expected {
        let tokens: Vec<&str> = line.split(' ').collect();
        last = parse_time(tokens[0]);
        if tokens[1] == ">" {
            run.pass(last);
            run.lines.push(line.clone());
            run.input(last, &tokens[2..]);
        }
    }
    run.pass(last + Duration::from_nanos(1));
    assert_eq!(run.lines.join("\n"), expected.join("\n"));
    run.master
}

fn check(transcript: &str) -> Master {
    check_with(master(), transcript)
}

#[test]
fn an_answer_comes_back_to_who_asked() {
    let mut master = check(
        "
         1ms   > ask 20 01
         1ms   < tx 20! 01 00 00 9c
         1.5ms > sent
         2.6ms > rx 20! 01 00 04 01 00
         2.9ms > rx ff ff 36              # reads may be split anywhere
         2.9ms < reply 20 01 Ok 01 00 ff ff
    ",
    );
    let statistics = master.statistics(0x20).unwrap();
    assert_eq!((statistics.requests, statistics.retries, statistics.round_trips.count()), (1, 0, 1));
    assert_eq!(statistics.round_trips.mean(), Some(Duration::from_micros(1900)));
    assert_eq!(master.take_recent(0x20).count(), 1);
    assert_eq!(master.take_recent(0x20).count(), 0);
    assert_eq!(master.bus_statistics(), BusStatistics { words: 14, frames: 2, ..BusStatistics::default() });
}

#[test]
fn two_word_times_of_silence_come_before_every_request() {
    check(
        "
         1ms   > ask 20 01
         1ms   < tx 20! 01 00 00 9c
         1.5ms > sent
         2.6ms > rx 20! 01 00 04 01 00 ff ff 36
         2.6ms < reply 20 01 Ok 01 00 ff ff
         2.6ms > ask 20 01
         2.8ms < tx 20! 01 00 00 9c
    ",
    );
}

#[test]
fn a_damaged_answer_is_asked_for_again_with_resend() {
    let master = check(
        "
         1ms   > ask 20 01
         1ms   < tx 20! 01 00 00 9c
         1.5ms > sent
         2.6ms > rx 20! 01 00 04 01 00 fe ff 36
         2.8ms < tx 20! 01 01 00 d0       # RESEND
         3.3ms > sent
         4.4ms > rx 20! 01 00 04 01 00 ff ff 36
         4.4ms < reply 20 01 Ok 01 00 ff ff
    ",
    );
    let statistics = master.statistics(0x20).unwrap();
    assert_eq!(
        (statistics.requests, statistics.retries, statistics.crc_errors, statistics.round_trips.count()),
        (1, 1, 1, 1)
    );
    assert_eq!(master.error_count(0x20), Some(0));
}

#[test]
fn silence_gets_full_requests_and_the_third_is_the_last() {
    let master = check(
        "
          1ms   > ask 20 01
          1ms   < tx 20! 01 00 00 9c
          1.5ms > sent
         21.5ms < tx 20! 01 00 00 9c
         22ms   > sent
         42ms   < tx 20! 01 00 00 9c
         42.5ms > sent
         62.5ms < silent 20 01
    ",
    );
    let statistics = master.statistics(0x20).unwrap();
    assert_eq!((statistics.requests, statistics.retries, statistics.timeouts), (1, 2, 3));
    assert_eq!(master.error_count(0x20), Some(8));
}

#[test]
fn a_second_damaged_answer_gets_a_full_request_and_a_third_is_garbled() {
    let master = check(
        "
         1ms   > ask 20 01
         1ms   < tx 20! 01 00 00 9c
         1.5ms > sent
         2.6ms > rx 20! 01 00 04 01 00 fe ff 36
         2.8ms < tx 20! 01 01 00 d0
         3.3ms > sent
         4.4ms > rx 20! 01 00 04 01 00 fe ff 36
         4.6ms < tx 20! 01 00 00 9c
         5.1ms > sent
         6ms   > rx 20! 01 00 04 01 00 fe ff 36
         6ms   < garbled 20 01 Crc
    ",
    );
    assert_eq!((master.error_count(0x20), master.bus_statistics().errors), (Some(8), 3));
}

#[test]
fn an_answer_that_breaks_off_is_damaged_when_its_time_is_over() {
    check(
        "
          1ms   > ask 20 01
          1ms   < tx 20! 01 00 00 9c
          1.5ms > sent
          2.2ms > rx 20! 01 00 04 01
         21.5ms < tx 20! 01 01 00 d0
    ",
    );
}

#[test]
fn an_answer_longer_than_its_time_is_heard_to_its_end() {
    // 255 bytes take 26 ms at 110 000 Bd, and 20 ms are given.
    let mut answer = Words::new();
    Frame { address: 0x10, instruction: 1, flags: 0, data: &[7; 255] }.encode(config().crc, &mut answer);
    let mut master = master();
    let run = |master: &mut Master, words: &[Word]| {
        master.request(Request::new(0x10, 1, &[])).unwrap();
        let mut now = Instant::from_millis(1000 * master.statistics(0x10).unwrap().requests);
        assert!(master.poll_tx(now).is_some());
        now += Duration::from_micros(500);
        master.handle_tx_done(now);
        for word in words {
            now += Duration::from_micros(100);
            master.handle_timeout(now);
            master.handle_rx(now, &[*word]);
        }
        let waits = master.poll_timeout().map(|due| due.since(now));
        (master.poll_event().map(|event| write_event(&event)[..14].into()), waits)
    };
    assert_eq!(run(&mut master, &answer), (Some(String::from("reply 10 01 Ok")), None));
    // It breaks off after its time was over: 5 ms later it is damaged at the latest.
    let (_, waits) = run(&mut master, &answer[..230]);
    assert!(waits.is_some_and(|waits| waits <= Duration::from_millis(5)), "{waits:?}");
    master.cancel();
    // One that never ends is not waited for longer than the longest frame takes.
    let endless: Vec<Word> = (0..1000).map(|n| Word { byte: 0xFF, ninth: n % 100 == 0 }).collect();
    run(&mut master, &endless);
    assert_eq!(master.statistics(0x10).unwrap().crc_errors, 1);
}

#[test]
fn an_answer_whose_ninth_bit_is_lost_is_damaged() {
    check(
        "
          1ms   > ask 20 01
          1ms   < tx 20! 01 00 00 9c
          1.5ms > sent
          2.6ms > rx 20 01 00 04 01 00 ff ff 36
         21.5ms < tx 20! 01 01 00 d0
    ",
    );
}

#[test]
fn a_node_that_could_not_read_the_request_gets_it_again_in_full() {
    check(
        "
         1ms   > ask 20 01
         1ms   < tx 20! 01 00 00 9c
         1.5ms > sent
         2.2ms > rx 20! 01 02 00 04       # BADCRC
         2.4ms < tx 20! 01 00 00 9c
         2.9ms > sent
         3.6ms > rx 20! 01 02 00 04
         3.8ms < tx 20! 01 00 00 9c
         4.3ms > sent
         5ms   > rx 20! 01 02 00 04
         5ms   < garbled 20 01 Request
    ",
    );
}

#[test]
fn a_node_that_refuses_is_alive_and_not_asked_again() {
    let master = check(
        "
         1ms   > ask 20 01
         1ms   < tx 20! 01 00 00 9c
         1.5ms > sent
         2.2ms > rx 20! 01 03 00 48
         2.2ms < reply 20 01 UnknownInstruction
    ",
    );
    assert_eq!((master.error_count(0x20), master.statistics(0x20).unwrap().round_trips.count()), (Some(0), 1));
}

#[test]
fn a_length_that_the_instruction_does_not_allow_is_damage() {
    check(
        "
         1ms   > ask 20 01
         1ms   < tx 20! 01 00 00 9c
         1.5ms > sent
         2.2ms > rx 20! 01 00 00 9c
         2.4ms < tx 20! 01 01 00 d0
    ",
    );
}

#[test]
fn the_ninth_bit_starts_the_answer_anew_in_the_middle_of_a_frame() {
    check(
        "
         1ms   > ask 20 01
         1ms   < tx 20! 01 00 00 9c
         1.5ms > sent
         3.2ms > rx 20! 01 00 ff 33 20! 01 00 04 01 00 ff ff 36
         3.2ms < reply 20 01 Ok 01 00 ff ff
    ",
    );
}

#[test]
fn a_late_answer_to_another_request_is_not_taken_for_the_current_one() {
    // 10 is asked and gives up; its answer comes when 20 is asked, 20's answer to another instruction too.
    let master = check(
        "
          0ms   > ask 30 01
          0ms   < tx 30! 01 00 00 b9
          0.5ms > sent
          5.5ms < tx 30! 01 00 00 b9
          6ms   > sent
         11ms   < tx 30! 01 00 00 b9
         11.5ms > sent
         16.5ms < silent 30 01
         17ms   > ask 20 01
         17ms   < tx 20! 01 00 00 9c
         17.5ms > sent
         18.5ms > rx 30! 01 00 04 01 00 ff ff af
         19ms   > rx 20! 02 00 00 10
         20ms   > rx 20! 01 00 04 01 00 ff ff 36
         20ms   < reply 20 01 Ok 01 00 ff ff
    ",
    );
    assert_eq!(master.bus_statistics().stray_frames, 2);
}

#[test]
fn a_stray_answer_alone_leaves_the_asked_node_silent() {
    check(
        "
          1ms   > ask 20 01
          1ms   < tx 20! 01 00 00 9c
          1.5ms > sent
          2.2ms > rx 20! 02 00 00 10
         21.5ms < tx 20! 01 00 00 9c      # a full request, not RESEND
    ",
    );
}

#[test]
fn an_answer_may_come_before_the_host_says_that_it_sent() {
    check(
        "
         1ms   > ask 20 01
         1ms   < tx 20! 01 00 00 9c
         2.6ms > rx 20! 01 00 04 01 00 ff ff 36
         2.6ms < reply 20 01 Ok 01 00 ff ff
         2.7ms > sent
         2.7ms > ask 20 01
         2.8ms < tx 20! 01 00 00 9c
    ",
    );
}

#[test]
fn a_broadcast_and_a_request_without_answer_end_with_their_last_bit() {
    check(
        "
         1ms   > ask ff ff
         1ms   < tx ff! ff 00 00 f1
         1.5ms > sent
         1.5ms < sent ff ff
         1.6ms > tell 20 02
         1.7ms < tx 20! 02 02 00 88
         2.2ms > sent
         2.2ms < sent 20 02
    ",
    );
}

#[test]
fn data_goes_out_and_stays_the_same_when_repeated() {
    check(
        "
          0ms   > ask 30 01 07 08
          0ms   < tx 30! 01 00 02 07 08 b2
          0.7ms > sent
          5.7ms < tx 30! 01 00 02 07 08 b2
    ",
    );
}

#[test]
fn a_host_that_does_not_send_is_not_the_node_s_fault() {
    let master = check(
        "
           1ms   > ask 20 01
           1ms   < tx 20! 01 00 00 9c
         101.5ms < unsent 20 01           # 0.5 ms on the wire, 100 ms of patience
         102ms   > stall
         102ms   > ask 20 01
         203ms   > go                     # ready at 102 ms, given up at 202 ms
         203ms   < unsent 20 01
    ",
    );
    assert_eq!((master.error_count(0x20), master.bus_statistics().unsent), (Some(0), 2));
}

#[test]
fn a_cancelled_transaction_leaves_nothing_behind() {
    check(
        "
         1ms   > ask 20 01
         1ms   < tx 20! 01 00 00 9c
         1.5ms > sent
         2ms   > cancel
         3ms   > rx 20! 01 00 04 01 00 ff ff 36
         4ms   > ask 20 02
         4ms   < tx 20! 02 00 00 10
    ",
    );
}

#[test]
fn a_talker_that_never_stops_wedges_nothing() {
    let mut master = master();
    let mut random = Random::new(5);
    let mut now = Instant::ZERO;
    let mut ended = 0;
    for _ in 0..100_000 {
        // A word every word time, for 10 s.
        now += Duration::from_micros(100);
        let bits = random.next();
        master.handle_rx(now, &[Word { byte: bits as u8, ninth: bits & 0x1F00 == 0 }]);
        while master.poll_timeout().is_some_and(|due| due <= now) {
            master.handle_timeout(now);
        }
        if master.poll_tx(now).is_some() {
            master.handle_tx_done(now);
        }
        while let Some(event) = master.poll_event() {
            ended += usize::from(matches!(event, Event::Silent { .. } | Event::Garbled { .. }));
        }
        if master.is_idle() {
            master.request(Request::new(0x10, 0x10, &[])).unwrap();
        }
    }
    // At most 3 x (100 ms for silence, 0.5 ms to send, 20 ms for an answer) each, and one attempt when it is lost.
    assert!(ended >= 10_000 / 362, "{ended}");
    assert_eq!(master.health(0x10), Health::Lost);
}

#[test]
fn a_node_is_degraded_lost_and_back() {
    let mut master = master();
    let mut said = String::new();
    let mut ask = |master: &mut Master, now: Instant, answer: bool| {
        master.request(Request::new(0x10, 0x10, &[])).unwrap();
        let mut attempts = 0;
        let mut at = now;
        while !master.is_idle() {
            if master.poll_tx(at).is_some() {
                attempts += 1;
                master.handle_tx_done(at);
            }
            if answer {
                master.handle_rx(at, &words("10! 10 00 00 64"));
            }
            at = master.poll_timeout().unwrap_or(at);
            master.handle_timeout(at);
        }
        while let Some(event) = master.poll_event() {
            if !matches!(event, Event::Silent { .. } | Event::Reply { .. }) {
                said += &format!("{} ", write_event(&event));
            }
        }
        attempts
    };
    let at = |n: u64| Instant::from_millis(n * 1000);
    // Degraded after 12, it is not asked again when its time is over.
    assert_eq!((0..16).map(|n| ask(&mut master, at(n), false)).sum::<u32>(), 12 * 3 + 4);
    assert_eq!(master.health(0x10), Health::Lost);
    // A lost node is probed once, not three times.
    assert_eq!(ask(&mut master, at(16), false), 1);
    assert_eq!(ask(&mut master, at(17), true), 1);
    assert_eq!((master.health(0x10), master.error_count(0x10)), (Health::Ok, Some(0)));
    assert_eq!(ask(&mut master, at(18), false), 3);
    assert_eq!(said, "degraded 10 lost 10 back 10 ");
}

#[test]
fn what_the_caller_does_wrong_is_refused_and_sends_nothing() {
    let mut master = master();
    let long = [0; 256];
    let refused = master.request(Request::new(0x10, 1, &long));
    assert_eq!(refused, Err(RequestError::TooLong { len: 256, max: 255 }));
    assert!(master.poll_tx(Instant::ZERO).is_none());
    master.request(Request::new(0x10, 1, &[])).unwrap();
    assert_eq!(master.request(Request::new(0x20, 1, &[])), Err(RequestError::Busy));
    assert_eq!(master.poll_tx(Instant::ZERO).unwrap().words[0], Word::address(0x10));
}

#[test]
fn there_is_room_for_so_many_nodes_and_any_may_be_asked() {
    let mut master = Master::new(config());
    let added = (0..=40).filter(|address| master.add_node(*address, Duration::ZERO)).count();
    assert_eq!(added, NODES_MAX);
    assert!(master.add_node(0, Duration::from_millis(1)), "known already");
    master.request(Request::new(40, 1, &[])).unwrap();
    assert!(master.poll_tx(Instant::ZERO).is_some());
    assert_eq!((master.health(40), master.statistics(40)), (Health::Ok, None));
}

#[test]
fn after_any_garbage_the_next_answer_is_understood() {
    let mut random = Random::new(11);
    for full_duplex in [false, true] {
        let mut master = Master::new(Config { full_duplex, ..config() });
        assert!(master.add_node(0x20, Duration::from_millis(20)));
        let mut now = Instant::ZERO;
        for _ in 0..20_000 {
            now += Duration::from_millis(100);
            let share = 1 + random.next() % 64;
            let garbage: Vec<Word> = (0..random.next() % 300)
                .map(|_| Word { byte: random.next() as u8, ninth: random.one_in(share) })
                .collect();
            let answer = words("20! 01 00 04 01 00 ff ff 36");
            let request = Request { answer: Lengths::exactly(4), ..Request::new(0x20, 0x01, &[]) };
            master.request(request).unwrap();
            let mut heard = false;
            // Garbage comes while it waits or before it sends; each attempt after that is answered.
            while let Some(due) = master.poll_timeout() {
                now = now.max(due);
                master.handle_timeout(now);
                if random.one_in(2) && !heard {
                    master.handle_rx(now, &garbage);
                    heard = true;
                }
                if master.poll_tx(now).is_some() {
                    master.handle_tx_done(now);
                    now += Duration::from_millis(2);
                    if random.one_in(2) && !heard {
                        master.handle_rx(now, &garbage);
                        heard = true;
                    }
                    master.handle_rx(now, &answer);
                }
            }
            let replied = core::iter::from_fn(|| master.poll_event())
                .any(|event| matches!(event, Event::Reply { data, .. } if data[..] == [1, 0, 0xFF, 0xFF]));
            assert!(replied);
        }
        assert_eq!(master.statistics(0x20).map(|node| node.failures), Some(0));
    }
}

#[test]
fn random_words_and_calls_never_panic_and_leave_nothing_due() {
    let mut random = Random::new(7);
    let mut master = master();
    let mut now = Instant::ZERO;
    for _ in 0..300_000 {
        now += Duration::from_micros(random.next() % 3000);
        match random.next() % 6 {
            0 => master.handle_tx_done(now),
            1 | 2 => {
                let words: Vec<Word> = (0..random.next() % 20)
                    .map(|_| Word { byte: random.next() as u8 & 0x33, ninth: random.one_in(6) })
                    .collect();
                master.handle_rx(now, &words);
            }
            3 => drop(master.request(Request::new(random.next() as u8 & 0x33, random.next() as u8 & 3, &[]))),
            _ => master.handle_timeout(now),
        }
        master.handle_timeout(now);
        master.poll_tx(now);
        while master.poll_event().is_some() {}
        assert!(master.poll_timeout().is_none_or(|due| due > now));
    }
}

mod culprits;
mod duplex;
mod table;
