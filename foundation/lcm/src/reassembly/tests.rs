use super::*;
use core::net::Ipv4Addr;

const A: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 1);
const B: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 2);

fn payload(len: usize) -> Vec<u8> {
    (0..len).map(|i| (7 * i + (i >> 8)) as u8).collect()
}

fn fragments(sequence: u32, channel: &str, len: usize, size: usize) -> Vec<Vec<u8>> {
    let payload = payload(len);
    let message = udpm::Message::new(sequence, channel, &payload, size).unwrap();
    let datagram = |number| {
        let (header, rest) = message.datagram(number);
        [&header[..], rest].concat()
    };
    (0..message.count()).map(datagram).collect()
}

struct Bench {
    reassembly: Reassembly,
    datagram: Buffer,
    now: i64,
}

impl Bench {
    fn new(limits: Limits) -> Self {
        Self { reassembly: Reassembly::new(limits), datagram: Buffer::default(), now: 0 }
    }

    fn insert(&mut self, from: SocketAddrV4, bytes: &[u8]) -> Outcome {
        self.datagram.room()[..bytes.len()].copy_from_slice(bytes);
        self.reassembly.insert(self.now, from, &mut self.datagram, bytes.len(), |channel, _| channel != "UNWANTED")
    }

    fn all(&mut self, from: SocketAddrV4, datagrams: &[Vec<u8>]) -> Vec<Outcome> {
        datagrams.iter().map(|bytes| self.insert(from, bytes)).collect()
    }

    fn complete(&self) -> (&str, &[u8]) {
        let Complete { channel, payload } = self.reassembly.complete().unwrap();
        (channel, payload)
    }
}

#[test]
fn fragments_make_a_message_in_any_order() {
    for (len, size) in [(65_600, DATAGRAM_MAX), (10_000, 600), (1 << 20, DATAGRAM_MAX), (3_000_000, 1452)] {
        let datagrams = fragments(7, "BIG", len, size);
        let last = datagrams.len() - 1;
        let rotated: Vec<_> = [&datagrams[last / 2..], &datagrams[..last / 2]].concat();
        let backwards: Vec<_> = datagrams.iter().rev().cloned().collect();
        for order in [datagrams, rotated, backwards] {
            let mut bench = Bench::new(Limits::default());
            let outcomes = bench.all(A, &order);
            assert!(outcomes[..last].iter().all(|outcome| *outcome == Outcome::Incomplete));
            assert_eq!(outcomes[last], Outcome::Complete);
            assert!(bench.complete() == ("BIG", &payload(len)[..]), "{len} {size}");
        }
    }
}

#[test]
fn a_datagram_that_comes_twice_fills_no_hole() {
    let datagrams = fragments(0, "BIG", 2000, 1000);
    let mut bench = Bench::new(Limits::default());
    assert_eq!(bench.insert(A, &datagrams[0]), Outcome::Incomplete);
    assert_eq!(bench.insert(A, &datagrams[0]), Outcome::Needless);
    assert_eq!(bench.insert(A, &datagrams[1]), Outcome::Incomplete);
    assert_eq!(bench.insert(A, &datagrams[2]), Outcome::Complete);
    assert_eq!(bench.insert(A, &datagrams[2]), Outcome::Needless, "and begins no new message");
    assert_eq!(bench.reassembly.bytes(), 0);
}

#[test]
fn messages_of_many_senders_interleave() {
    let (mine, other) = (fragments(0, "X", 5000, 1000), fragments(0, "Y", 5000, 1000));
    let next = fragments(1, "Z", 5000, 1000);
    let mut bench = Bench::new(Limits::default());
    for ((mine, other), next) in mine.iter().zip(&other).zip(&next).take(mine.len() - 1) {
        bench.insert(A, mine);
        bench.insert(B, other);
        bench.insert(A, next);
    }
    let last = mine.len() - 1;
    for (from, datagrams, channel) in [(A, &next, "Z"), (B, &other, "Y"), (A, &mine, "X")] {
        assert_eq!(bench.insert(from, &datagrams[last]), Outcome::Complete);
        assert!(bench.complete() == (channel, &payload(5000)[..]));
    }
}

#[test]
fn what_nobody_wants_is_not_put_together() {
    let datagrams = fragments(0, "UNWANTED", 5000, 1000);
    let mut bench = Bench::new(Limits::default());
    assert_eq!(bench.insert(A, &datagrams[3]), Outcome::Incomplete, "nobody can tell yet");
    assert_eq!(bench.insert(A, &datagrams[0]), Outcome::Unwanted);
    assert_eq!(bench.insert(A, &datagrams[1]), Outcome::Needless);
    assert_eq!((bench.reassembly.bytes(), bench.reassembly.given_up()), (0, 0));
}

#[test]
fn what_does_not_come_to_an_end_is_given_up() {
    let datagrams = fragments(0, "BIG", 5000, 1000);
    let mut bench = Bench::new(Limits::default());
    bench.insert(A, &datagrams[0]);
    bench.now += 500_000_000;
    bench.insert(A, &datagrams[1]);
    bench.now += 500_000_001;
    bench.insert(B, &datagrams[0]);
    assert_eq!(bench.reassembly.given_up(), 1);
    assert_eq!(bench.insert(A, &datagrams[2]), Outcome::Incomplete, "the rest is the start of nothing");
}

#[test]
fn a_sender_that_begins_anew_does_not_mix_two_messages() {
    let mut bench = Bench::new(Limits::default());
    bench.insert(A, &fragments(0, "OLD", 6000, 1000)[0]);
    let datagrams = fragments(0, "NEW", 5000, 1000);
    assert_eq!(bench.all(A, &datagrams).pop(), Some(Outcome::Complete));
    assert!(bench.complete() == ("NEW", &payload(5000)[..]));
    assert_eq!(bench.reassembly.given_up(), 1);
}

#[test]
fn endless_first_fragments_cost_a_fixed_amount_of_memory() {
    let largest = MESSAGE_MAX as usize;
    let limits = Limits::default();
    let mut bench = Bench::new(limits);
    let mut first = fragments(0, "BIG", 200_000, DATAGRAM_MAX).swap_remove(0);
    first[8..12].copy_from_slice(&MESSAGE_MAX.to_be_bytes());
    let mut last = fragments(0, "BIG", 200_000, DATAGRAM_MAX).swap_remove(1);
    last[8..12].copy_from_slice(&MESSAGE_MAX.to_be_bytes());
    last[12..16].copy_from_slice(&(MESSAGE_MAX - 65_487).to_be_bytes());
    for sequence in 0..1000_u32 {
        for datagram in [&mut first, &mut last] {
            datagram[4..8].copy_from_slice(&(2 * sequence).to_be_bytes());
            bench.insert(A, datagram);
            assert!(bench.reassembly.bytes() <= limits.bytes);
        }
        last[4..8].copy_from_slice(&(2 * sequence + 1).to_be_bytes());
        bench.insert(A, &last);
        assert!(bench.reassembly.bytes() <= limits.bytes.max(largest + DATAGRAM_MAX));
    }
    assert!(bench.reassembly.partials.len() <= limits.messages);
}

#[test]
fn fragments_that_lie_about_their_size_are_no_message() {
    let mut datagrams = fragments(0, "BIG", 3000, 1000);
    datagrams[1].truncate(500);
    let mut bench = Bench::new(Limits::default());
    let outcomes = bench.all(A, &datagrams);
    assert!(!outcomes.contains(&Outcome::Complete), "{outcomes:?}");
    assert_eq!(bench.reassembly.given_up(), 1);
}

#[test]
fn fragments_that_lie_upon_each_other_make_no_message() {
    let mut bench = Bench::new(Limits::default());
    // Four quarters of the payload, each of which says that it is the first.
    let mut datagrams = fragments(7, "BIG", 200_000, 50_020);
    datagrams.truncate(4);
    let size = datagrams[1].len() - 20;
    for (number, datagram) in datagrams.iter_mut().enumerate() {
        let channel: &[u8] = if number == 0 { b"BIG\0" } else { b"" };
        datagram.truncate(8);
        datagram.extend((4 * size as u32).to_be_bytes());
        datagram.extend([0; 4]);
        datagram.extend([0, number as u8, 0, 4]);
        datagram.extend(channel);
        datagram.extend(vec![7; size]);
    }
    let outcomes = bench.all(A, &datagrams);
    assert_eq!(outcomes, [[Outcome::Incomplete; 3].as_slice(), &[Outcome::Needless]].concat());
    assert_eq!((bench.reassembly.complete(), bench.reassembly.given_up()), (None, 1));
}

/// A datagram with 8 bytes of data at `offset` of a message of `total` bytes, fragment `number` of two.
fn far(sequence: u32, total: u32, offset: u32, number: u16) -> Vec<u8> {
    let numbers = [udpm::FRAGMENT_MAGIC, sequence, total, offset].map(u32::to_be_bytes);
    let counts = [number, 2].map(u16::to_be_bytes);
    [numbers.as_flattened(), counts.as_flattened(), if number == 0 { b"BIG\0" } else { b"" }, &[7; 8]].concat()
}

#[test]
fn an_announced_size_costs_no_memory() {
    let mut bench = Bench::new(Limits::default());
    assert_eq!(bench.insert(A, &far(0, MESSAGE_MAX, MESSAGE_MAX - 10, 1)), Outcome::Incomplete);
    assert!(bench.reassembly.bytes() < 200, "{} bytes for a datagram of 28", bench.reassembly.bytes());
    assert_eq!(bench.insert(A, &far(1, MESSAGE_MAX, 0, 0)), Outcome::Incomplete);
    assert!(bench.reassembly.bytes() < 500, "{} bytes for two datagrams", bench.reassembly.bytes());
}

#[test]
fn each_byte_that_is_held_has_arrived() {
    let (len, mut arrived) = (3_000_000, 0);
    let datagrams = fragments(7, "BIG", len, 1452);
    let backwards: Vec<_> = datagrams.iter().rev().cloned().collect();
    for order in [datagrams, backwards] {
        let mut bench = Bench::new(Limits::default());
        for datagram in &order {
            arrived += datagram.len() + EARLY_OVERHEAD;
            bench.insert(A, datagram);
            assert!(bench.reassembly.bytes() <= 2 * arrived);
        }
        assert!(bench.complete() == ("BIG", &payload(len)[..]));
    }
}

#[test]
fn a_budget_keeps_what_is_wanted_and_gives_up_the_oldest_of_what_nobody_named() {
    let limits = Limits { bytes: 300_000, ..Limits::default() };
    let mut bench = Bench::new(limits);
    let datagrams = fragments(9, "BIG", 100_000, 1452);
    let (last, all) = (datagrams.len() - 1, &datagrams);
    for (number, datagram) in all.iter().enumerate().take(last) {
        assert_eq!(bench.insert(A, datagram), Outcome::Incomplete);
        for k in 0..3 {
            let mut early = fragments(0, "X", 100_000, 30_000).swap_remove(1);
            early[4..8].copy_from_slice(&(100 + 3 * number as u32 + k).to_be_bytes());
            bench.insert(B, &early);
            assert!(bench.reassembly.bytes() <= limits.bytes);
        }
    }
    assert!(bench.reassembly.given_up() > 100);
    assert_eq!(bench.insert(A, &all[last]), Outcome::Complete);
    assert!(bench.complete() == ("BIG", &payload(100_000)[..]));
}

#[test]
fn a_message_larger_than_the_budget_is_refused_by_its_first_fragment() {
    let mut bench = Bench::new(Limits { bytes: 1 << 20, ..Limits::default() });
    let datagrams = fragments(0, "BIG", 1 << 20, DATAGRAM_MAX);
    assert_eq!(bench.insert(A, &datagrams[1]), Outcome::Needless);
    assert_eq!((bench.reassembly.bytes(), bench.reassembly.given_up()), (0, 0), "perhaps nobody wants it");
    assert!(bench.all(A, &datagrams).iter().all(|outcome| *outcome == Outcome::Needless));
    assert_eq!((bench.reassembly.bytes(), bench.reassembly.given_up()), (0, 1));
}
