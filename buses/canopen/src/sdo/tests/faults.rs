//! Block transfers on a line that loses, repeats and damages frames: they end right, or in an error at the client.

use super::line::{Fate, INDEX, Line, clean};
use crate::sdo::{Error, MAX_LEN, TIMEOUT};
use crate::testing::Random;
use crate::{Abort, Payload};
use std::vec;
use std::vec::Vec;

fn bytes(len: usize) -> Vec<u8> {
    let mut random = Random::new(len as u64);
    (0..len).map(|_| random.next() as u8).collect()
}

/// Writes and reads back; gives the frames that took.
fn there_and_back(line: &mut Line, data: &[u8]) -> [usize; 2] {
    let (len, before) = (data.len(), line.client.ignored());
    assert_eq!(line.transfer(Some(data), clean).result, Ok(Payload::EMPTY), "{len}");
    assert!(line.store.data == data, "{len}");
    let write = line.frames;
    assert_eq!(line.transfer(None, clean).result.as_deref(), Ok(data), "{len}");
    assert_eq!(line.client.ignored(), before);
    [write, line.frames]
}

#[test]
fn every_size_travels_both_ways_in_blocks() {
    let large = [2666, 2667, 2668, 4096, 8890, 8891, 65_535, 65_536, 100_000, MAX_LEN];
    for greedy in [false, true] {
        let mut line = Line::new(127);
        line.greedy = greedy;
        for len in (0..=2000).chain(large) {
            let segments = len.div_ceil(7).max(1);
            let write = 2 + segments + segments.div_ceil(127) + 2;
            let normal = if len == 0 || len > 4 { 2 + 2 * segments } else { 2 };
            let read = if len <= 28 { normal } else { write + 1 };
            assert_eq!(there_and_back(&mut line, &bytes(len)), [write, read], "frames of {len} bytes");
        }
        assert_eq!(line.store.writes, 2011);
    }
}

#[test]
fn blocks_of_any_size_carry_any_data() {
    for blksize in [1, 2, 3, 64, 126] {
        let mut line = Line::new(blksize);
        for len in 0..=300 {
            there_and_back(&mut line, &bytes(len));
            there_and_back(&mut line, &vec![0; len]);
        }
    }
}

#[test]
fn more_than_a_transfer_can_be_is_refused() {
    let mut line = Line::new(127);
    let result = line.transfer(Some(&vec![0; MAX_LEN + 1]), clean).result;
    assert_eq!(result, Err(Error::Refused(Abort::TOO_LONG)));
    line.store.data = vec![0; MAX_LEN + 1];
    assert_eq!(line.transfer(None, clean).result, Err(Error::Protocol(Abort::OUT_OF_MEMORY)));
}

/// How a transfer ended.
struct End {
    result: Result<(), Error>,
    /// True if each end has what it says it has: the server all data or none, the client too.
    right: bool,
}

/// Runs a transfer, to write or to read, with `fate`; when late frames are gone too, the channel is free again.
fn spoiled((write, greedy, blksize): (bool, bool, u8), data: &[u8], fate: impl FnMut(usize, [u8; 8]) -> Fate) -> End {
    let mut line = Line::new(blksize);
    line.greedy = greedy;
    if !write {
        line.store.data = data.to_vec();
    }
    let result = line.transfer(write.then_some(data), fate).result;
    let server = match line.store.writes {
        0 => !write || result.is_err(),
        writes => write && writes == 1 && line.store.data == data,
    };
    let client = result.as_ref().map_or(true, |read| if write { read.is_empty() } else { **read == *data });
    line.now += TIMEOUT * 4;
    there_and_back(&mut line, &bytes(30));
    End { result: result.map(|_| ()), right: server && client }
}

/// The same where nothing may make it wrong.
fn sure(how: (bool, bool, u8), data: &[u8], fate: impl FnMut(usize, [u8; 8]) -> Fate) -> Result<(), Error> {
    let end = spoiled(how, data, fate);
    assert!(end.right, "{how:?}: {:?}, but wrong", end.result);
    end.result
}

/// Frames of an undisturbed transfer.
fn count(write: bool, greedy: bool, blksize: u8, data: &[u8]) -> usize {
    let mut frames = 0;
    let counted = |at: usize, frame| {
        frames = at + 1;
        Fate::Arrives(frame)
    };
    assert_eq!(sure((write, greedy, blksize), data, counted), Ok(()));
    frames
}

#[test]
fn a_lost_segment_is_sent_again_and_any_other_lost_frame_is_an_error() {
    for (write, greedy) in [(true, true), (true, false), (false, true), (false, false)] {
        let data = bytes(2 * 889 + 300);
        let frames = count(write, greedy, 127, &data);
        let failed: Vec<_> = (0..frames)
            .filter_map(|lost| {
                let fate = |at, frame| if at == lost { Fate::Lost } else { Fate::Arrives(frame) };
                sure((write, greedy, 127), &data, fate).err().map(|error| (lost, error))
            })
            .collect();
        // Initiate, its answer, (start,) three acknowledges, the end and its answer. The client of a read has it all
        // when it says so.
        let (first, kept) = if write { (2, 0) } else { (3, 1) };
        let (acknowledges, last) = ([127, 255, 299].map(|at| first + at), frames - 1);
        let mut expected: Vec<_> = (0..first).chain(acknowledges).chain([last - 1, last]).collect();
        expected.truncate(expected.len() - kept);
        assert_eq!(failed, expected.iter().map(|at| (*at, Error::Timeout)).collect::<Vec<_>>(), "{write} {greedy}");
    }
}

#[test]
fn a_normal_transfer_that_loses_a_frame_is_an_error() {
    let data = bytes(30);
    for lost in 0..12 {
        for write in [true, false] {
            let mut line = Line::new(127);
            line.store.data = data.clone();
            let begun = match write {
                true => line.client.write(line.now, INDEX, 0, Payload::from(&data[..])),
                false => line.client.read(line.now, INDEX, 0),
            };
            let done = line.run(|at, frame| if at == lost { Fate::Lost } else { Fate::Arrives(frame) });
            assert!(begun && line.store.data == data);
            assert_eq!(done.result, Err(Error::Timeout), "{lost}");
            there_and_back(&mut line, &data);
        }
    }
}

#[test]
fn two_frames_lost_or_repeated_never_make_wrong_data() {
    let data = bytes(100);
    for (write, greedy) in [(true, true), (true, false), (false, true), (false, false)] {
        let frames = count(write, greedy, 4, &data);
        // What was lost makes frames that come later.
        let pairs = (0..frames).flat_map(|first| (first..frames + 10).map(move |second| (first, second)));
        for ((first, second), kinds) in pairs.flat_map(|pair| (0..4).map(move |kinds| (pair, kinds))) {
            let fate = |at, frame| match (at == first, at == second) {
                (true, _) if kinds & 1 == 0 => Fate::Lost,
                (_, true) if kinds & 2 == 0 => Fate::Lost,
                (true, _) | (_, true) => Fate::Twice,
                _ => Fate::Arrives(frame),
            };
            let result = sure((write, greedy, 4), &data, fate);
            assert!(result.is_ok() || kinds < 3, "{first} {second}: {result:?}");
        }
    }
}

#[test]
fn a_frame_that_comes_twice_does_no_harm() {
    for (write, greedy, blksize) in [(true, true, 8), (true, false, 8), (false, true, 8), (false, false, 8)] {
        for data in [bytes(150), vec![0; 150]] {
            for twice in 0..count(write, greedy, blksize, &data) {
                let fate = |at, frame| if at == twice { Fate::Twice } else { Fate::Arrives(frame) };
                assert_eq!(sure((write, greedy, blksize), &data, fate), Ok(()), "{write} {greedy} {twice}");
            }
        }
    }
}

#[test]
fn a_damaged_byte_is_never_taken_for_data() {
    let data = bytes(100);
    for (write, unprotected) in [(true, 16), (false, 32)] {
        let (mut right, mut refused, mut wrong) = (0, 0, 0);
        let frames = count(write, false, 5, &data);
        for hit in 0..frames * 8 * 255 {
            let (frame, byte, bits) = (hit / 255 / 8, hit / 255 % 8, (hit % 255 + 1) as u8);
            let fate = |at, mut data: [u8; 8]| {
                data[byte] ^= if at == frame { bits } else { 0 };
                Fate::Arrives(data)
            };
            let end = spoiled((write, false, 5), &data, fate);
            match end.result {
                _ if !end.right => {
                    // What begins a block transfer became an expedited one: no CRC covers that.
                    assert!(byte == 0 && frame <= usize::from(!write), "{write} {frame} {byte} {bits:02X}");
                    wrong += 1;
                }
                Ok(()) => right += 1,
                Err(_) => refused += 1,
            }
        }
        assert_eq!(wrong, unprotected);
        assert!(right > 1000 && refused > 10_000, "{right} right, {refused} refused");
    }
}

#[test]
fn a_line_on_which_everything_happens_carries_right_data_or_none() {
    let mut random = Random::new(11);
    let (mut right, mut failed) = (0, 0);
    for round in 0..20_000 {
        let data = bytes(random.below(400) as usize);
        let (write, greedy) = (random.below(2) == 0, random.below(2) == 0);
        let blksize = 1 + random.below(20) as u8;
        let odds = 1 + random.below(60);
        let mut draws = Random::new(round);
        let result = sure((write, greedy, blksize), &data, |_, frame| match draws.below(3 * odds) {
            0 => Fate::Lost,
            1 => Fate::Twice,
            _ => Fate::Arrives(frame),
        });
        (right, failed) = if result.is_ok() { (right + 1, failed) } else { (right, failed + 1) };
    }
    assert!(right > 1000 && failed > 1000, "{right} right, {failed} failed");
}
