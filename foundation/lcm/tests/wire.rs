//! The wire against datagrams captured from the official LCM, and against noise.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use lcm::receiver::Receiver;
use lcm::udpm::{self, Datagram, ShortHeader};
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
    let lines = include_str!("udpm_vectors.txt").lines();
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
fn short_messages_are_those_of_the_official_lcm() {
    let mut shorts = 0;
    for captured in captured() {
        let Ok(Datagram::Short(short)) = udpm::decode(&captured.datagram) else {
            continue;
        };
        shorts += 1;
        assert_eq!(short.channel, captured.channel);
        assert_eq!(short.payload.len(), captured.payload_size);
        let header = ShortHeader::new(short.sequence, short.channel, short.payload.len()).unwrap();
        let encoded = [header.as_bytes(), short.payload].concat();
        assert!(encoded == captured.datagram, "{}", captured.channel);
    }
    assert_eq!(shorts, 6);
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

/// Takes it in; every datagram is counted exactly once, and what is understood keeps its bounds.
fn feed(receiver: &mut Receiver, datagram: &[u8]) {
    let from = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 9);
    let count = |receiver: &Receiver| {
        let stats = receiver.stats;
        stats.received + stats.unwanted + stats.malformed + stats.fragments
    };
    let before = count(receiver);
    if let Some(short) = receiver.handle_rx(from, datagram) {
        assert_eq!(8 + short.channel.len() + 1 + short.payload.len(), datagram.len());
        assert!(short.channel.len() <= udpm::CHANNEL_MAX);
    }
    assert_eq!(count(receiver), before + 1);
    if let Ok(Datagram::Fragment(fragment)) = udpm::decode(datagram) {
        assert!(fragment.number < fragment.count && fragment.total <= udpm::MESSAGE_MAX);
        assert!(fragment.offset as usize + fragment.data.len() <= fragment.total as usize);
    }
}

#[test]
fn random_bytes_are_counted_and_survived() {
    let mut noise = Noise(0x9E37_79B9_7F4A_7C15);
    let mut receiver = Receiver::default();
    receiver.subscribe("[A-M].*").unwrap();
    let seeds: Vec<_> =
        captured().into_iter().map(|captured| captured.datagram[..captured.datagram.len().min(120)].to_vec()).collect();
    for _ in 0..100_000 {
        let len = noise.below(120);
        let raw: Vec<u8> = (0..len).map(|_| noise.next() as u8).collect();
        feed(&mut receiver, &raw);
        let mut mutated = seeds[noise.below(seeds.len())].clone();
        for _ in 0..=noise.below(4) {
            let at = noise.below(mutated.len());
            mutated[at] = noise.next() as u8;
        }
        mutated.truncate(noise.below(mutated.len() + 1));
        feed(&mut receiver, &mutated);
    }
    let stats = receiver.stats;
    assert!(stats.received > 0 && stats.unwanted > 0 && stats.malformed > 0 && stats.fragments > 0);
}
