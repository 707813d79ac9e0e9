//! Two ends with a cable of the test between them: handshake, wrong key, replay, changes, silence.

use crate::auth::Key;
use crate::connection::{Connection, Event, HANDSHAKE_TIMEOUT, Refusal, SILENCE_MAX, TX_MAX, Time};
use crate::wire::{BODY_MAX, PAYLOAD_MAX, WireError};
use base::{Duration, Instant};

/// The connector's wall clock is 30 ms ahead, its monotonic clock 5 s.
const AHEAD: (u64, u64) = (5000, 30);

fn key(byte: u8) -> Key {
    Key::new([byte; 32])
}

/// Time of both ends, ms.
fn times(ms: u64) -> (Time, Time) {
    let at = |mono: u64, wall: u64| Time {
        now: Instant::from_millis(1000 + ms + mono),
        wall_ns: (1_700_000_000_000 + ms + wall) * 1_000_000,
    };
    (at(AHEAD.0, AHEAD.1), at(0, 0))
}

/// A connector, a listener, and what crossed.
struct Pair {
    near: Connection,
    far: Connection,
    ms: u64,
    to_far: Vec<u8>,
    delay_ms: u64,
}

impl Pair {
    fn new(near: u8, far: u8) -> Self {
        let (here, there) = times(0);
        let near = Connection::connect(key(near), [1; 32], here);
        let far = Connection::listen(key(far), [2; 32], there);
        Self { near, far, ms: 0, to_far: Vec::new(), delay_ms: 0 }
    }

    /// Passes a millisecond, in which bytes cross.
    fn step(&mut self) -> Result<(), Refusal> {
        self.ms += 1;
        let (here, there) = times(self.ms);
        let bytes = self.near.take_tx();
        self.to_far.extend_from_slice(&bytes);
        self.far.handle_rx(times(self.ms + self.delay_ms).1, &bytes)?;
        let bytes = self.far.take_tx();
        self.near.handle_rx(here, &bytes)?;
        self.near.handle_timeout(here)?;
        self.far.handle_timeout(there)
    }

    fn open() -> Self {
        let mut pair = Self::new(7, 7);
        for _ in 0..20 {
            pair.step().unwrap();
        }
        assert!(pair.near.is_open() && pair.far.is_open());
        while pair.far.poll_event().is_some() {}
        pair
    }

    fn send(&mut self, channel: &str, payload: &[u8]) -> bool {
        let (here, _) = times(self.ms);
        self.near.send(here.now, channel, payload)
    }
}

fn received(connection: &mut Connection) -> Vec<(Option<Duration>, String, Vec<u8>)> {
    let message = |event| match event {
        Event::Message { age, channel, payload } => Some((age, channel, payload)),
        _ => None,
    };
    std::iter::from_fn(|| connection.poll_event()).filter_map(message).collect()
}

#[test]
fn two_ends_with_one_key_exchange_messages_and_compare_clocks() {
    let mut pair = Pair::open();
    assert!(pair.send("LL_CMD_MOTION", b"forward"));
    pair.step().unwrap();
    let messages = received(&mut pair.far);
    let [(Some(age), channel, payload)] = &messages[..] else { panic!("{messages:?}") };
    assert_eq!((channel.as_str(), &payload[..]), ("LL_CMD_MOTION", &b"forward"[..]));
    assert!(*age <= Duration::from_millis(3), "{age:?}");

    let (_, there) = times(pair.ms);
    let clocks = pair.far.clocks().compare(there.now).unwrap();
    assert!((clocks.offset_s - 0.03).abs() <= clocks.round_trip_s, "{clocks:?}");
}

#[test]
fn a_late_message_is_known_to_be_late() {
    let mut pair = Pair::open();
    assert!(pair.send("LL_CMD_MOTION", b"forward"));
    let bytes = pair.near.take_tx();
    pair.far.handle_rx(times(pair.ms + 300).1, &bytes).unwrap();
    let age = received(&mut pair.far)[0].0;
    assert!(age.is_some_and(|age| age >= Duration::from_millis(300)), "{age:?}");
}

#[test]
fn who_has_another_key_is_refused_and_sends_and_receives_nothing() {
    let mut pair = Pair::new(7, 8);
    let refusal = (0..20).find_map(|_| pair.step().err());
    assert_eq!(refusal, Some(Refusal::Key));
    assert!(!pair.near.is_open() && !pair.far.is_open());
    assert!(!pair.send("LL_CMD_MOTION", b"forward"));

    // Nor does a connector get in that does not check the listener.
    let (here, there) = times(0);
    let mut far = Connection::listen(key(7), [2; 32], there);
    let mut thief = Connection::connect(key(8), [1; 32], here);
    far.handle_rx(there, &thief.take_tx()).unwrap();
    let proof = [&32_u32.to_be_bytes()[..], &[0; 32]].concat();
    assert_eq!(far.handle_rx(there, &proof), Err(Refusal::Key));
}

#[test]
fn a_recorded_session_is_refused_when_it_is_replayed() {
    let mut pair = Pair::open();
    pair.send("LL_CMD_MOTION", b"forward");
    pair.step().unwrap();
    let (_, there) = times(pair.ms);
    // A session has a nonce of the listener that it never had before.
    let mut far = Connection::listen(key(7), [3; 32], there);
    assert_eq!(far.handle_rx(there, &pair.to_far), Err(Refusal::Key));
    assert!(received(&mut far).is_empty());
}

#[test]
fn a_record_that_is_repeated_changed_or_left_out_ends_the_session() {
    type Forge = fn(&[u8], &[u8]) -> Vec<u8>;
    let forge: [(&str, Forge); 4] = [
        ("repeated", |first, _| [first, first].concat()),
        ("changed", |first, _| {
            let mut bytes = first.to_vec();
            bytes[20] ^= 1;
            bytes
        }),
        ("left out", |_, second| second.to_vec()),
        ("in another order", |first, second| [second, first].concat()),
    ];
    for (what, forge) in forge {
        let mut pair = Pair::open();
        let [first, second] = [b"first!", b"second"].map(|payload| {
            pair.send("LL_CMD_MOTION", payload);
            pair.near.take_tx()
        });
        let (_, there) = times(pair.ms);
        assert_eq!(pair.far.handle_rx(there, &forge(&first, &second)), Err(Refusal::Record), "{what}");
        let messages = received(&mut pair.far);
        assert!(messages.iter().all(|(.., payload)| payload == b"first!"), "{what}: {messages:?}");
        assert!(messages.len() <= 1, "{what}");
    }
}

#[test]
fn what_does_not_identify_itself_is_refused_in_time() {
    let (_, there) = times(0);
    let mut far = Connection::listen(key(7), [2; 32], there);
    assert_eq!(far.poll_timeout(), there.now + HANDSHAKE_TIMEOUT);
    let late = Time { now: there.now + HANDSHAKE_TIMEOUT, ..there };
    assert_eq!(far.handle_timeout(late), Err(Refusal::Unfinished));
    for bytes in [&b"GET / HTTP/1.1\r\n\r\n"[..], &[0; 4], &[0, 0, 0, 48, 1]] {
        let mut far = Connection::listen(key(7), [2; 32], there);
        let padded = [bytes, &[1; 64]].concat();
        assert_eq!(far.handle_rx(there, &padded), Err(Refusal::Protocol), "{bytes:?}");
    }
}

#[test]
fn a_pulled_cable_is_noticed_and_signs_of_life_prevent_that() {
    let mut pair = Pair::open();
    for _ in 0..2000 {
        pair.step().unwrap();
    }
    let (_, there) = times(pair.ms);
    let due = there.now + SILENCE_MAX;
    // The last sign of life came at most a period of them ago.
    assert_eq!(pair.far.handle_timeout(Time { now: due, ..there }), Err(Refusal::Silent));
    assert!(!Refusal::Silent.is_foreign() && Refusal::Key.is_foreign());
}

#[test]
fn what_waits_is_bounded_and_a_message_that_is_too_long_is_left_out() {
    let mut pair = Pair::open();
    assert!(!pair.send("LL_DATA_SCAN", &vec![0; PAYLOAD_MAX + 1]));
    assert!(pair.send("LL_DATA_SCAN", &vec![0; PAYLOAD_MAX]));
    let mut sent = 1;
    while pair.send("LL_DATA_SCAN", &vec![0; 10_000]) {
        sent += 1;
    }
    assert!(sent < 100 && pair.near.poll_tx().len() <= TX_MAX);
    // A stop still has room.
    assert!(pair.near.send_stop(times(pair.ms).0.now, "LL_EVENT_STOP", &[1; 100]));
    sent += 1;
    pair.step().unwrap();
    assert_eq!(received(&mut pair.far).len(), sent, "those that were taken arrive, in their order");

    let (_, there) = times(pair.ms);
    let long = [(BODY_MAX as u32 + 1).to_be_bytes(), [0; 4]].concat();
    let refusal = Refusal::Wire(WireError::Length { len: BODY_MAX + 1, max: BODY_MAX });
    assert_eq!(pair.far.handle_rx(there, &long), Err(refusal));
}

#[test]
fn the_modules_of_the_other_computer_are_known() {
    let mut pair = Pair::open();
    let modules = vec![("camera".to_owned(), true), ("planner".to_owned(), false)];
    assert!(pair.near.send_modules(&modules));
    pair.step().unwrap();
    let events: Vec<Event> = std::iter::from_fn(|| pair.far.poll_event()).collect();
    assert!(events.contains(&Event::Modules(modules)), "{events:?}");
}
