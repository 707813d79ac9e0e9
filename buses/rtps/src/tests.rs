//! Participants with a network between them that loses what the test wants.

mod related;
mod user_data;

use crate::wire::{Submessage, parse};
use crate::{Config, Limits, Participant, Prefix, Qos, Reliability, Sample, multicast_port, unicast_port};
use alloc::vec;
use alloc::vec::Vec;
use base::{Duration, Instant};
use core::net::SocketAddrV4;
use testing::Random;

const TOPIC: (&str, &str) = ("rt/topic", "pkg::msg::dds_::Type_");

fn address(n: usize) -> SocketAddrV4 {
    SocketAddrV4::new([127, 0, 0, 1 + n as u8].into(), 7410)
}

fn config(n: usize, peers: usize) -> Config {
    Config {
        domain: 3,
        prefix: Prefix([1 + n as u8; 12]),
        locators: vec![address(n)],
        announce_to: (0..peers).filter(|peer| *peer != n).map(address).collect(),
        announce_period: Duration::from_secs(3),
        lease: Duration::from_secs(20),
        name: "test".into(),
        user_data: b"enclave=/;".to_vec(),
        endpoint_data: |_| Vec::new(),
        limits: Limits::default(),
    }
}

struct Net {
    now: Instant,
    all: Vec<Participant>,
    random: Random,
    /// A datagram is lost with a probability of one divided by this; 0: never.
    loss: u64,
    sent: usize,
}

impl Net {
    fn new(count: usize) -> Self {
        let all = (0..count).map(|n| Participant::new(config(n, count))).collect();
        Self { now: Instant::from_millis(1), all, random: Random::new(1), loss: 0, sent: 0 }
    }

    fn run(&mut self, millis: u64) {
        for _ in 0..millis {
            self.now += Duration::from_millis(1);
            self.all.iter_mut().for_each(|one| one.handle_timeout(self.now));
            while self.exchange() {}
        }
    }

    fn exchange(&mut self) -> bool {
        let mut any = false;
        for n in 0..self.all.len() {
            while let Some(transmit) = self.all[n].poll_tx() {
                any = true;
                self.sent += 1;
                if self.loss > 0 && self.random.one_in(self.loss) {
                    continue;
                }
                let to = (0..self.all.len()).find(|to| address(*to) == transmit.to);
                if let Some(to) = to {
                    self.all[to].handle_rx(self.now, address(n), &transmit.datagram);
                }
            }
        }
        any
    }

    fn taken(&mut self, n: usize) -> Vec<Vec<u8>> {
        core::iter::from_fn(|| self.all[n].poll_event()).map(|Sample { payload, .. }| payload).collect()
    }
}

/// A sample; on the wire its length is a multiple of four.
fn payload(n: u32, len: usize) -> Vec<u8> {
    let len = len.next_multiple_of(4);
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend(n.to_le_bytes());
    bytes.extend((0..len).map(|k| (k as u32 ^ n) as u8));
    bytes
}

#[test]
fn a_reader_hears_a_writer_that_was_there_before_or_comes_later() {
    for reader_first in [false, true] {
        let mut net = Net::new(2);
        if reader_first {
            net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
            net.run(300);
        }
        let writer = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
        net.run(300);
        if !reader_first {
            net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
            net.run(300);
        }
        assert_eq!(net.all[0].matched(writer), 1);
        for n in 0..20 {
            let now = net.now;
            net.all[0].write(now, writer, 0, &payload(n, 3));
            net.run(10);
        }
        assert_eq!(net.taken(1), (0..20).map(|n| payload(n, 3)).collect::<Vec<_>>());
    }
}

#[test]
fn nothing_reliable_is_lost_on_a_network_that_loses_a_third() {
    let mut net = Net::new(2);
    net.loss = 3;
    let qos = Qos { depth: 100, ..Qos::RELIABLE };
    let writer = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, qos).unwrap();
    net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    net.run(5000);
    assert_eq!(net.all[0].matched(writer), 1);
    let expected: Vec<_> = (0..100).map(|n| payload(n, if n % 10 == 0 { 20_000 } else { 8 })).collect();
    let mut got = Vec::new();
    for sample in &expected {
        let now = net.now;
        net.all[0].write(now, writer, 0, sample);
        net.run(20);
        got.extend(net.taken(1));
    }
    net.run(30_000);
    got.extend(net.taken(1));
    // The first may be from before the reader knew of its writer.
    let missed = expected.len() - got.len();
    assert!(missed <= 3, "{missed}");
    assert_eq!(got, expected[missed..]);
}

#[test]
fn a_late_reader_gets_the_last_sample_of_a_latched_topic_and_no_other_at_once() {
    for (qos, expected) in [(Qos::LATCHED, vec![payload(4, 30_000)]), (Qos::RELIABLE, vec![])] {
        let mut net = Net::new(2);
        let writer = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, qos).unwrap();
        net.run(500);
        for n in 0..5 {
            let now = net.now;
            net.all[0].write(now, writer, 0, &payload(n, 30_000));
        }
        net.run(500);
        net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, Qos { depth: 1, ..qos }).unwrap();
        net.run(50);
        assert_eq!(net.taken(1), expected);
        let now = net.now;
        net.all[0].write(now, writer, 0, &payload(9, 1));
        net.run(300);
        assert_eq!(net.taken(1), [payload(9, 1)]);
    }
}

#[test]
fn a_reader_that_asks_for_more_than_is_offered_hears_nothing() {
    let effort = |reliability, transient_local| Qos { reliability, transient_local, depth: 1 };
    let (best, sure) = (Reliability::BestEffort, Reliability::Reliable);
    for (offered, asked, hears) in [
        (effort(best, false), effort(sure, false), false),
        (effort(sure, false), effort(sure, true), false),
        (effort(sure, true), effort(best, false), true),
        (effort(best, true), effort(best, true), true),
    ] {
        let mut net = Net::new(2);
        let writer = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, offered).unwrap();
        net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, asked).unwrap();
        net.all[1].add_reader(net.now, TOPIC.0, "pkg::msg::dds_::Other_", asked).unwrap();
        net.all[1].add_reader(net.now, "rt/other", TOPIC.1, asked).unwrap();
        net.run(500);
        assert_eq!(net.all[0].matched(writer), usize::from(hears), "{offered:?} {asked:?}");
    }
}

#[test]
fn who_leaves_or_falls_silent_is_forgotten() {
    let mut net = Net::new(3);
    let writer = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    for n in [1, 2] {
        net.all[n].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    }
    net.run(500);
    assert_eq!((net.all[0].participants(), net.all[0].matched(writer)), (2, 2));
    net.all[1].leave();
    while net.exchange() {}
    assert_eq!((net.all[0].participants(), net.all[0].matched(writer)), (1, 1));
    // The others are silent.
    net.all.truncate(1);
    net.run(19_000);
    assert_eq!(net.all[0].participants(), 1);
    net.run(1_600);
    assert_eq!((net.all[0].participants(), net.all[0].matched(writer)), (0, 0));
}

#[test]
fn who_misses_the_answer_to_its_first_announcements_is_answered_again() {
    let mut net = Net::new(2);
    net.run(1000);
    // A program that starts: its first announcements leave before it listens.
    net.all.push(Participant::new(Config { announce_to: vec![address(0)], ..config(2, 3) }));
    let begin = net.now;
    while net.now < begin + Duration::from_millis(250) {
        net.now += Duration::from_millis(1);
        net.all[2].handle_timeout(net.now);
        while let Some(transmit) = net.all[2].poll_tx() {
            net.all[0].handle_rx(net.now, address(2), &transmit.datagram);
        }
        net.all[0].handle_timeout(net.now);
        while net.all[0].poll_tx().is_some() {}
    }
    assert_eq!((net.all[0].participants(), net.all[2].participants()), (2, 0));
    net.run(120);
    assert_eq!(net.all[2].participants(), 1, "not only with the next announcement after 3 s");
}

#[test]
fn an_idle_pair_is_silent_but_for_its_announcements() {
    let mut net = Net::new(2);
    let writer = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, Qos::LATCHED).unwrap();
    net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::LATCHED).unwrap();
    let now = net.now;
    net.all[0].write(now, writer, 0, &payload(1, 1));
    net.run(2000);
    net.sent = 0;
    net.run(9000);
    assert_eq!(net.sent, 2 * 3);
}

#[test]
fn another_domain_is_not_heard() {
    let mut net = Net::new(2);
    net.all[1] = Participant::new(Config { domain: 4, ..config(1, 2) });
    net.run(1000);
    assert_eq!([net.all[0].participants(), net.all[1].participants()], [0, 0]);
}

#[test]
fn a_flood_of_participants_is_bounded_and_counted_and_the_known_ones_keep_their_places() {
    let mut net = Net::new(2);
    let writer = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    net.run(500);
    for n in 0..1000_u32 {
        let mut prefix = [9; 12];
        prefix[..4].copy_from_slice(&n.to_le_bytes());
        let mut other = Participant::new(Config { prefix: Prefix(prefix), ..config(0, 2) });
        other.handle_timeout(net.now);
        let now = net.now;
        let datagram = other.poll_tx().unwrap().datagram;
        net.all[0].handle_rx(now, address(5), &datagram);
    }
    assert_eq!(net.all[0].participants(), Limits::default().participants);
    assert_eq!(net.all[0].counters().refused, 1001 - Limits::default().participants as u64);
    net.run(100);
    let now = net.now;
    net.all[0].write(now, writer, 0, &payload(7, 1));
    net.run(100);
    assert_eq!(net.taken(1), [payload(7, 1)]);
    // They never answer: what waits for them is bounded, too.
    (0..1000).for_each(|_| net.all[0].write(now, writer, 0, &payload(7, 10_000)));
    assert!(net.all[0].counters().dropped_out > 0);
    let waiting: usize = core::iter::from_fn(|| net.all[0].poll_tx()).map(|sent| sent.datagram.len()).sum();
    assert!(waiting <= Limits::default().outbox, "{waiting}");
}

#[test]
fn samples_that_nobody_takes_are_bounded() {
    let mut net = Net::new(2);
    let writer = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, Qos::SENSOR).unwrap();
    net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::SENSOR).unwrap();
    net.run(500);
    for n in 0..300 {
        let now = net.now;
        net.all[0].write(now, writer, 0, &payload(n, 1));
        net.exchange();
    }
    let counters = net.all[1].counters();
    assert_eq!((net.taken(1).len(), counters.dropped_in), (Limits::default().events, 300 - 256));
}

#[test]
fn a_sample_that_is_too_long_is_left_out_and_the_next_one_comes() {
    let mut net = Net::new(2);
    let writer = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    net.run(300);
    for length in [4, 100_000, 8] {
        let now = net.now;
        net.all[0].write(now, writer, 0, &payload(1, length));
        net.run(50);
    }
    assert_eq!(net.taken(1), [payload(1, 4), payload(1, 8)]);
    assert_eq!(net.all[1].counters().dropped_in, 1);
    net.run(500);
    net.sent = 0;
    net.run(2000);
    assert!(net.sent <= 4, "nothing is asked for again: {}", net.sent);
}

/// Datagrams of a whole acquaintance, as they were sent.
fn recorded() -> Vec<(usize, Vec<u8>)> {
    let mut net = Net::new(2);
    net.all[0].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    let writer = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, Qos::LATCHED).unwrap();
    let back = net.all[1].add_writer(net.now, TOPIC.0, TOPIC.1, Qos::LATCHED).unwrap();
    net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    let mut sent = Vec::new();
    for n in 0..40 {
        net.now += Duration::from_millis(50);
        let now = net.now;
        net.all[0].write(now, writer, 0, &payload(n, 20_000));
        net.all[1].write(now, back, 0, &payload(n, 20_000));
        net.all.iter_mut().for_each(|one| one.handle_timeout(now));
        for from in 0..2 {
            while let Some(transmit) = net.all[from].poll_tx() {
                net.all[1 - from].handle_rx(now, address(from), &transmit.datagram);
                sent.push((from, transmit.datagram));
            }
        }
    }
    sent
}

#[test]
fn whatever_arrives_is_survived_and_the_way_of_honest_ones_stays_open() {
    let sent = recorded();
    assert!(sent.len() > 100, "{}", sent.len());
    let mut random = Random::new(5);
    for _ in 0..200 {
        let mut one = Participant::new(config(0, 2));
        let now = Instant::from_millis(1);
        one.add_reader(now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
        let writer = one.add_writer(now, TOPIC.0, TOPIC.1, Qos::LATCHED).unwrap();
        for (n, (_, datagram)) in sent.iter().enumerate().filter(|(_, (from, _))| *from == 1) {
            let now = Instant::from_millis(2 + n as u64);
            let mut bytes = datagram.clone();
            for _ in 0..random.below(4) {
                let at = random.index(bytes.len());
                bytes[at] = random.edge_byte();
            }
            if random.one_in(8) {
                bytes.truncate(random.index(bytes.len()));
            }
            one.handle_rx(now, address(1), &bytes);
            one.write(now, writer, 0, &payload(n as u32, 20_000));
            one.handle_timeout(now);
            let due = one.poll_timeout().unwrap();
            assert!(due > now, "nothing is due after it was done");
            while one.poll_tx().is_some() {}
            while one.poll_event().is_some() {}
        }
        assert!(one.participants() <= Limits::default().participants);
    }
}

#[test]
fn messages_are_read_as_they_were_written() {
    let (mut data, mut frags, mut heartbeats, mut acknacks) = (0, 0, 0, 0);
    for (_, datagram) in recorded() {
        let (_, submessages) = parse(&datagram).unwrap();
        for submessage in submessages {
            match submessage.unwrap() {
                Submessage::Data(_) => data += 1,
                Submessage::DataFrag(_) => frags += 1,
                Submessage::Heartbeat(_) => heartbeats += 1,
                Submessage::AckNack(_) => acknacks += 1,
                _ => {}
            }
        }
    }
    assert!(data > 4 && frags > 20 && heartbeats > 4 && acknacks > 4, "{data} {frags} {heartbeats} {acknacks}");
}

#[test]
fn ports_are_those_of_the_standard() {
    assert_eq!([multicast_port(0), unicast_port(0, 0), unicast_port(0, 1)], [Some(7400), Some(7410), Some(7412)]);
    assert_eq!([multicast_port(42), unicast_port(42, 3)], [Some(17_900), Some(17_916)]);
    assert_eq!([multicast_port(232), multicast_port(233), unicast_port(232, 70)], [Some(65_400), None, None]);
    assert_eq!(unicast_port(0, u32::MAX), None);
}
