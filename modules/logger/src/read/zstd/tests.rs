use super::Decoder;
use std::io::Read;
use testing::Random;

const MAX: usize = 1 << 20;

fn expand(frame: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    Decoder::default().expand(frame, MAX, &mut out)?;
    Some(out)
}

/// The same by another decoder.
fn expected(mut frame: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    let decoder = ruzstd::decoding::StreamingDecoder::new(&mut frame).ok()?;
    decoder.take(MAX as u64 + 1).read_to_end(&mut out).ok()?;
    Some(out)
}

/// Contents of many kinds: empty, constant, random, few symbols, repetitions at all distances, records of a log.
fn contents() -> Vec<Vec<u8>> {
    let mut rng = Random::new(8878);
    let mut contents = vec![Vec::new(), vec![7], vec![0; 300_000], b"abcabcabd".repeat(20_000)];
    for size in [10, 100, 1000, 50_000, 400_000] {
        contents.push((0..size).map(|_| rng.below(256) as u8).collect());
        for symbols in [2, 3, 17, 100, 255] {
            contents.push((0..size).map(|_| (rng.below(symbols) * rng.below(symbols) / symbols) as u8).collect());
        }
        let mut repeated: Vec<u8> = (0..size.min(64)).map(|_| rng.below(256) as u8).collect();
        while repeated.len() < size as usize {
            if rng.below(4) == 0 {
                repeated.push(rng.below(256) as u8);
            }
            let end = repeated.len();
            let offset = 1 + rng.below(end as u64) as usize;
            let longest = [10, 70, 3000][rng.index(3)];
            let len = 1 + rng.below(longest) as usize;
            (0..len).for_each(|place| repeated.push(repeated[end - offset + place]));
        }
        contents.push(repeated);
    }
    let mut records = Vec::new();
    for n in 0..9000_u64 {
        records.extend_from_slice(&(n / 13).to_le_bytes());
        records.extend_from_slice(&(1_700_000_000_000_000_000 + 50_000_000 * n + rng.below(9999)).to_be_bytes());
        records.extend_from_slice(&(libm::sin(n as f64 / 100.0) + rng.below(100) as f64 * 1e-6).to_be_bytes());
    }
    contents.push(records);
    contents
}

#[test]
fn frames_of_the_c_library_give_back_their_content() {
    for content in contents() {
        for level in [-7, 1, 3, 9, 19] {
            let frame = zstd::bulk::compress(&content, level).unwrap();
            assert!(expand(&frame).as_deref() == Some(&content), "{} bytes, level {level}", content.len());
            // Without the size of the content, and with a checksum.
            let mut encoder = zstd::stream::Encoder::new(Vec::new(), level).unwrap();
            encoder.include_checksum(true).unwrap();
            for part in content.chunks(70_001) {
                std::io::Write::write_all(&mut encoder, part).unwrap();
                std::io::Write::flush(&mut encoder).unwrap();
            }
            let stream = encoder.finish().unwrap();
            assert!(expand(&stream).as_deref() == Some(&content), "{} bytes, level {level}", content.len());
        }
    }
}

#[test]
fn frames_follow_each_other_and_some_are_skipped() {
    let skipped = [0x184D_2A53_u32.to_le_bytes(), 3_u32.to_le_bytes()].concat();
    let frame = |text: &str| zstd::bulk::compress(text.as_bytes(), 1).unwrap();
    let frames = [frame("first"), skipped.clone(), b"xyz".to_vec(), frame("second")].concat();
    assert_eq!(expand(&frames).as_deref(), Some(&b"firstsecond"[..]));
    assert_eq!(expand(&[skipped, b"xy".to_vec()].concat()), None);
    assert_eq!(expand(b"none"), None);
}

#[test]
fn more_than_the_maximum_is_refused() {
    for content in [vec![1; 5000], b"0123456789".repeat(500), contents().pop().unwrap()] {
        let frame = zstd::bulk::compress(&content, 3).unwrap();
        let len = content.len();
        for (max, fits) in [(len, true), (len + 1, true), (len - 1, false), (10, false), (0, false)] {
            let mut out = Vec::new();
            assert_eq!(Decoder::default().expand(&frame, max, &mut out).is_some(), fits, "{max} of {len}");
            assert!(out.len() <= max);
        }
    }
}

#[test]
fn a_frame_that_needs_a_dictionary_or_is_cut_off_is_refused() {
    let frame = zstd::bulk::compress(&contents().pop().unwrap()[..3000], 3).unwrap();
    (0..frame.len()).skip(1).for_each(|len| assert_eq!(expand(&frame[..len]), None, "{len} bytes"));
    let mut other = frame.clone();
    // The flag of a dictionary's number, of one byte, and the number.
    other[4] |= 1;
    other.insert(5 + usize::from(other[4] & 0x20 == 0), 9);
    assert_eq!(expand(&other), None);
}

#[test]
fn damaged_frames_never_give_what_another_decoder_does_not() {
    let mut rng = Random::new(3);
    let (mut same, mut refused) = (0, 0);
    for content in contents().iter().filter(|content| (1..60_000).contains(&content.len())) {
        for level in [1, 3, 19] {
            let frame = zstd::bulk::compress(content, level).unwrap();
            for _ in 0..60 {
                let mut damaged = frame.clone();
                for _ in 0..=rng.below(3) {
                    let end = if rng.one_in(2) { frame.len() } else { frame.len().min(40) };
                    let at = rng.index(end);
                    damaged[at] ^= if rng.one_in(2) { rng.below(256) as u8 } else { 1 << rng.below(8) };
                }
                match expand(&damaged) {
                    Some(out) => {
                        // The other one knows no frames behind the first, and limits windows.
                        if let Some(expected) = expected(&damaged).filter(|_| damaged[..5] == frame[..5]) {
                            assert!(out == expected, "{damaged:02x?}");
                        }
                        same += 1;
                    }
                    None => refused += 1,
                }
            }
        }
    }
    assert!(same > 100 && refused > 1000, "{same} read, {refused} refused");
}
