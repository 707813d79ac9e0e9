//! What one and two wrong bits do to a frame: all of them, tried on the reception automaton and the master.
//!
//! A CRC is linear: outside the length byte and the ninth bits, a pattern of wrong bits is found or missed whatever the
//! frame says. Inside, the frame's end or beginning moves, and its bytes decide; so each pattern is tried on several
//! frames of random bytes.

use crate::crc::Crc8;
use crate::frame::{Frame, HEADER, OVERHEAD, Words};
use crate::master::{Config, Event, Lengths, Master, Request};
use crate::reader::{Reader, Received};
use crate::testing::Random;
use base::serial::Word;
use base::{Duration, Instant};
use std::format;
use std::string::String;
use std::vec::Vec;

/// Words of the longest frame that the CRC guards with Hamming distance 3 (`docs/facts/boards.md`, CRC).
const WORDS: usize = 30;
/// Frames of each length that patterns are tried on where bytes decide: of two wrong bits, and of one.
const FRAMES: usize = 4;
const FRAMES_ONE: usize = 256;

/// Accepted and tried.
#[derive(Default)]
struct Count {
    tried: u32,
    /// By the CRC alone; by a master that takes any length; by one that knows the answer's.
    accepted: [u32; 3],
}

impl Count {
    fn row(&self, name: &str) -> String {
        let one_in = |n: u32| match (f64::from(self.tried) / f64::from(n)).round() {
            _ if n == 0 => "none".into(),
            one_in => format!("1 in {one_in}"),
        };
        let [crc, any, exact] = self.accepted.map(one_in);
        format!("| {name} | {} | {crc} | {any} | {exact} |\n", self.tried)
    }
}

/// The `bit`-th of a frame's bits: nine a word, the ninth last.
fn flip(words: &mut [Word], bit: usize) {
    let word = &mut words[bit / 9];
    match bit % 9 {
        8 => word.ninth ^= true,
        bit => word.byte ^= 1 << bit,
    }
}

/// True if a wrong bit there moves the frame's beginning or end.
const fn moves(bit: usize) -> bool {
    bit % 9 == 8 || bit / 9 == HEADER - 1
}

fn frame(random: &mut Random, length: usize) -> Words {
    let data: Vec<u8> = (0..length).map(|_| (random.next() >> 16) as u8).collect();
    let mut words = Words::new();
    Frame { address: 0x20, instruction: 0x01, flags: 0, data: &data }.encode(Crc8::SAE_J1850, &mut words);
    words
}

fn crc_accepts(words: &[Word]) -> bool {
    let mut reader = Reader::new(Crc8::SAE_J1850, None);
    words.iter().any(|word| matches!(reader.push(Instant::ZERO, *word), Some(Received::Frame(_))))
}

fn master_accepts(words: &[Word], answer: Lengths) -> bool {
    let mut master = Master::new(Config { retries: 0, ..Config::default() });
    master.request(Request { answer, ..Request::new(0x20, 0x01, &[]) }).unwrap();
    assert!(master.poll_tx(Instant::ZERO).is_some());
    master.handle_tx_done(Instant::ZERO);
    master.handle_rx(Instant::ZERO + Duration::from_millis(1), words);
    matches!(master.poll_event(), Some(Event::Reply { .. }))
}

fn try_on(words: &mut Words, bits: &[usize], count: &mut Count) {
    bits.iter().for_each(|bit| flip(words, *bit));
    count.tried += 1;
    if crc_accepts(words) {
        let exact = Lengths::exactly((words.len() - OVERHEAD) as u8);
        count.accepted[0] += 1;
        count.accepted[1] += u32::from(master_accepts(words, Lengths::ANY));
        count.accepted[2] += u32::from(master_accepts(words, exact));
    }
    bits.iter().for_each(|bit| flip(words, *bit));
}

#[test]
fn no_frame_up_to_30_words_with_one_or_two_wrong_bits_is_accepted_unless_its_beginning_or_end_moves() {
    let mut random = Random::new(1);
    let [mut fixed, mut moved, mut moved_twice] = [(); 3].map(|()| Count::default());
    for length in 0..=WORDS - OVERHEAD {
        for n in 0..FRAMES_ONE {
            let mut words = frame(&mut random, length);
            for a in 0..9 * words.len() {
                match moves(a) {
                    true => try_on(&mut words, &[a], &mut moved),
                    false if n == 0 => try_on(&mut words, &[a], &mut fixed),
                    false => {}
                }
                for b in 0..if n < FRAMES { a } else { 0 } {
                    match moves(a) || moves(b) {
                        true => try_on(&mut words, &[a, b], &mut moved_twice),
                        false if n == 0 => try_on(&mut words, &[a, b], &mut fixed),
                        false => {}
                    }
                }
            }
        }
    }
    assert_eq!(fixed.accepted, [0; 3]);
    let table = [
        "| wrong bits | tried | the CRC alone accepts | a master that allows any length | one that knows the length |\n",
        "|---|---|---|---|---|\n",
        &fixed.row("one or two, outside the length byte and the ninth bits"),
        &moved.row("one, in the length byte or a ninth bit"),
        &moved_twice.row("two, one of them or both there"),
    ]
    .concat();
    let page = include_str!("../../../docs/conformance/rs485.md");
    assert!(page.contains(&table), "docs/conformance/rs485.md says otherwise than\n{table}");
}
