//! Codecs of the ninth bit on serial lines.

use base::serial::Word;
use base::{Duration, Instant};
use rs485::boards::{psc1, sbs1, sd1, so1};
use rs485::crc::Crc8;
use rs485::frame::{Frame, Words};
use rs485::reader::{Reader, Received};
use rs485::transport::{NinthFirst, Parity, TwoByte};

const DATA: [u8; 4] = [1, 0, 0xFF, 0xFF];

/// Bytes of two-byte lines of either order and of one with parity, through the receivers of a master and a slave; and
/// boards' data.
///
/// The next good frame is received; what is parsed encodes to the same bytes.
pub fn rs485_line(bytes: &[u8]) {
    let mut transport = TwoByte::default();
    let mut master = Reader::new(Crc8::SAE_J1850, None);
    let mut slave = Reader::new(Crc8::SAE_J1850, Some(Duration::from_millis(5)));
    let mut at = Instant::ZERO;
    for byte in bytes {
        at += Duration::from_millis(1);
        if let Some(word) = transport.decode(*byte) {
            for reader in [&mut master, &mut slave] {
                if let Some(Received::Frame(frame)) = reader.push(at, word) {
                    parse(frame.instruction, frame.data);
                }
            }
        }
    }
    parse(bytes.first().copied().unwrap_or(0), bytes);
    // Whatever came, half a word included: the next good frame is understood.
    let mut good = Words::new();
    Frame { address: so1::ADDRESS, instruction: 1, flags: 0, data: &DATA }.encode(Crc8::SAE_J1850, &mut good);
    let words: Vec<Word> =
        good.iter().flat_map(|word| TwoByte::encode(*word)).filter_map(|byte| transport.decode(byte)).collect();
    assert!(words.ends_with(&good), "{words:?}");
    for reader in [&mut master, &mut slave] {
        assert!(understood(reader, at, &words));
    }
    let mut ninth_first = NinthFirst::new();
    bytes.iter().for_each(|byte| {
        let _ = ninth_first.decode(*byte);
    });
    let bytes_of_good = good.iter().flat_map(|word| NinthFirst::encode(*word));
    let words: Vec<Word> = bytes_of_good.filter_map(|byte| ninth_first.decode(byte)).collect();
    assert!(words.ends_with(&good), "{words:?}");
    // The kernel's marks are longer: half a mark may cost a frame, never two.
    let mut parity = Parity::new();
    bytes.iter().filter_map(|byte| parity.decode(*byte)).for_each(|word| {
        let _ = master.push(at, word);
    });
    let marked: Vec<u8> = good.iter().flat_map(|word| mark(*word)).collect();
    let words: Vec<Word> = marked.repeat(2).into_iter().filter_map(|byte| parity.decode(byte)).collect();
    assert!(understood(&mut master, at, &words));
}

/// Whether a frame is complete, and right, with the last of `words`.
fn understood(reader: &mut Reader, at: Instant, words: &[Word]) -> bool {
    let (last, before) = words.split_last().expect("a frame");
    for word in before {
        let _ = reader.push(at, *word);
    }
    matches!(reader.push(at, *last), Some(Received::Frame(frame)) if frame.data == DATA)
}

/// A word as the kernel hands it over from a port in space parity.
fn mark(word: Word) -> Vec<u8> {
    match word {
        Word { byte, ninth: true } => vec![0xFF, 0x00, byte],
        Word { byte: 0xFF, ninth: false } => vec![0xFF, 0xFF],
        Word { byte, .. } => vec![byte],
    }
}

/// What is read is what would be built.
fn parse(instruction: u8, data: &[u8]) {
    if let Ok(both) = sd1::Both::parse(data) {
        assert_eq!(both.build(), data);
    }
    if let Ok(srfs) = sd1::parse_srfs(data) {
        assert_eq!(sd1::build_srfs(&srfs), data);
    }
    if let Ok(ticks) = so1::parse_ticks(data) {
        assert_eq!(so1::build_ticks(&ticks), data);
    }
    if let Ok(sightings) = sbs1::parse_beacons(data) {
        assert_eq!(sbs1::build_beacons(&sightings), data);
    }
    if let Ok(debug) = sbs1::parse_debug(data) {
        assert_eq!(sbs1::build_debug(debug), data);
    }
    if let Ok(currents) = psc1::parse_currents(data) {
        assert_eq!(psc1::build_currents(&currents), data);
    }
    if let Ok(unasked) = psc1::parse_unasked(instruction, data) {
        let (instruction_built, built) = unasked.build();
        assert_eq!((instruction_built.code, &built[..]), (instruction, data));
    }
}
