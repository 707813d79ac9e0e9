//! The wire against datagrams captured from the official LCM, and against noise.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use lcm::filter::SELF_TEST;
use lcm::reassembly::Buffer;
use lcm::receiver::Receiver;
use lcm::subscription::Queue;
use lcm::udpm::{self, DATAGRAM_MAX, Datagram, Message};
use std::net::{Ipv4Addr, SocketAddrV4};

/// One line of `udpm_vectors.txt`.
struct Captured {
    channel: &'static str,
    payload_size: usize,
    datagram: Vec<u8>,
}

fn unhex(text: &str) -> Vec<u8> {
    let digits = text.as_bytes().chunks(2);
    digits.map(|two| u8::from_str_radix(std::str::from_utf8(two).unwrap(), 16).unwrap()).collect()
}

/// The payload where the file has `..`.
fn pattern(i: usize) -> u8 {
    (7 * i + (i >> 8)) as u8
}

fn captured() -> Vec<Captured> {
    let lines = include_str!("../udpm_vectors.txt").lines();
    lines.filter(|line| !line.is_empty() && !line.starts_with('#')).map(parse).collect()
}

fn parse(line: &'static str) -> Captured {
    let [channel, payload_size, size, hex] = line.split(' ').collect::<Vec<_>>()[..] else { panic!("{line}") };
    let (front, back) = hex.split_once("..").unwrap_or((hex, ""));
    let (mut datagram, back) = (unhex(front), unhex(back));
    let size: usize = size.parse().unwrap();
    if size > datagram.len() {
        let fragment = datagram.starts_with(b"LC03");
        let first = !fragment || datagram[16..18] == [0, 0];
        let start = if fragment { 20 } else { 8 } + if first { channel.len() + 1 } else { 0 };
        let offset = match fragment {
            true => u32::from_be_bytes(datagram[12..16].try_into().unwrap()) as usize,
            false => 0,
        };
        datagram.extend((datagram.len()..size).map(|at| pattern(offset + at - start)));
    }
    assert!(datagram.len() == size && datagram.ends_with(&back), "{line}");
    let payload_size = payload_size.parse().unwrap();
    Captured { channel, payload_size, datagram }
}

#[test]
fn we_send_what_the_official_lcm_sends() {
    let mut captured = captured().into_iter().peekable();
    let mut messages = 0;
    while let Some(Captured { channel, payload_size, datagram }) = captured.next() {
        let (sequence, payload) = match udpm::decode(&datagram) {
            Ok(Datagram::Short(short)) => (short.sequence, short.payload.to_vec()),
            Ok(Datagram::Fragment(fragment)) => (fragment.sequence, (0..payload_size).map(pattern).collect()),
            Err(error) => panic!("{channel}: {error}"),
        };
        let message = Message::new(sequence, channel, &payload, DATAGRAM_MAX).unwrap();
        let mut theirs = vec![datagram];
        while theirs.len() < message.count() {
            theirs.push(captured.next().expect("all fragments of a message").datagram);
        }
        for (number, theirs) in theirs.iter().enumerate() {
            let (header, rest) = message.datagram(number);
            assert!([&header[..], rest].concat() == *theirs, "{channel} {number}");
        }
        messages += 1;
    }
    assert_eq!(messages, 9);
}

#[test]
fn fragments_of_the_official_lcm_cover_their_message() {
    let mut covered = 0;
    let mut messages = Vec::new();
    for captured in captured() {
        let Ok(Datagram::Fragment(fragment)) = udpm::decode(&captured.datagram) else {
            continue;
        };
        let channel = (fragment.number == 0).then_some(captured.channel);
        assert_eq!(fragment.channel, channel);
        assert_eq!(fragment.total as usize, captured.payload_size);
        assert_eq!(fragment.offset as usize, covered);
        let data = fragment.data.iter().enumerate();
        assert!(data.into_iter().all(|(i, &byte)| byte == pattern(covered + i)));
        covered += fragment.data.len();
        if fragment.number + 1 == fragment.count {
            messages.push((captured.channel, fragment.count, covered));
            covered = 0;
        }
    }
    assert_eq!(messages, [("FRAG", 2, 65_600), ("EDGE", 2, 65_495), ("BIG", 4, 200_000)]);
}

/// Marsaglia's xorshift64.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// Takes it in; what is no fragment is counted exactly once, and what is understood keeps its bounds.
fn feed(receiver: &mut Receiver, now: i64, datagram: &[u8]) {
    let from = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 9);
    let count = |receiver: &Receiver| {
        let stats = receiver.stats;
        stats.received + stats.unwanted + stats.malformed
    };
    let before = count(receiver);
    let mut buffer = Buffer::default();
    buffer.room()[..datagram.len()].copy_from_slice(datagram);
    if let Some(place) = receiver.handle_rx(now, from, &mut buffer, datagram.len()) {
        let (channel, payload) = receiver.message(place, &buffer);
        assert!(channel.len() <= udpm::CHANNEL_MAX && payload.len() <= datagram.len());
    }
    match udpm::decode(datagram) {
        Ok(Datagram::Fragment(fragment)) => {
            assert!(count(receiver) <= before + 1);
            assert!(fragment.number < fragment.count && fragment.total <= udpm::MESSAGE_MAX);
            assert!(fragment.offset as usize + fragment.data.len() <= fragment.total as usize);
        }
        Ok(Datagram::Short(short)) if short.channel == SELF_TEST => assert_eq!(count(receiver), before),
        _ => assert_eq!(count(receiver), before + 1),
    }
}

#[test]
fn random_bytes_are_counted_and_survived() {
    let mut noise = Noise(0x9E37_79B9_7F4A_7C15);
    let mut receiver = Receiver::default();
    receiver.hears_all(0);
    receiver.subscribe("[A-M].*", Queue::Transport).unwrap();
    let seeds: Vec<_> =
        captured().into_iter().map(|captured| captured.datagram[..captured.datagram.len().min(120)].to_vec()).collect();
    for now in 0..100_000 {
        let len = noise.below(120);
        let raw: Vec<u8> = (0..len).map(|_| noise.next() as u8).collect();
        feed(&mut receiver, now * 1_000_000, &raw);
        let mut mutated = seeds[noise.below(seeds.len())].clone();
        for _ in 0..=noise.below(4) {
            let at = noise.below(mutated.len());
            mutated[at] = noise.next() as u8;
        }
        mutated.truncate(noise.below(mutated.len() + 1));
        feed(&mut receiver, now * 1_000_000, &mutated);
    }
    let stats = receiver.stats;
    assert!(stats.received > 0 && stats.unwanted > 0 && stats.malformed > 0 && stats.incomplete > 0, "{stats:?}");
}
