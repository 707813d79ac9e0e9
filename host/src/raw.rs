//! Raw frames of a bus for `LL_DATA_RAW_<BUS>`: the tap on a port whose bus has `raw = true`.

use base::i2c::{self, Read};
use base::serial::Word;
use base::{Duration, Instant, can};
use messages::lowlevel::DataRaw;
use module::{Input, Output};
use rs485::frame::{HEADER, MAX_WORDS, OVERHEAD};
use std::collections::VecDeque;

/// Flag of an incomplete frame on EIA-485: cut short, or of another length than it states.
pub const INCOMPLETE: i32 = 1;
/// Flag of words on EIA-485 without an address word before them; `id` is -1.
pub const STRAY: i32 = 2;
/// Flags of a CAN frame: extended identifier, remote frame.
const EXTENDED: i32 = 1;
const REMOTE: i32 = 2;
// Flags of an I2C transfer: number of bytes to read, and whether their length comes first as in an SMBus block. Flags
// of an outcome: 0, or the reason of the failure.
const BLOCK: i32 = 0x100;
const NO_ADDRESS: i32 = 1;
const NO_DATA: i32 = 2;
const ARBITRATION: i32 = 3;
const STRETCHED: i32 = 4;
const STUCK: i32 = 5;
const OTHER: i32 = 6;

/// Pause after which a frame counts as finished: longer than any board may pause between two words.
const FRAME_PAUSE: Duration = Duration::from_millis(20);

/// The tap on one port.
#[derive(Debug, Default)]
pub struct Tap {
    /// Words of the current frame, its address first if it has one, with the time of the first and of the last.
    words: Vec<Word>,
    first: Instant,
    last: Instant,
    ready: Vec<(Instant, DataRaw)>,
    /// Addresses of transfers whose outcome is pending.
    asked: VecDeque<i2c::Address>,
}

impl Tap {
    /// Records an input of the port.
    pub fn received(&mut self, now: Instant, input: &Input<'_>) {
        match input {
            Input::Words(words) => words.iter().for_each(|word| self.push(now, *word, DataRaw::RECEIVED)),
            Input::Can { frame, .. } => self.ready.push((now, of_can(frame, DataRaw::RECEIVED))),
            Input::I2c(outcome) => {
                if let Some(address) = self.asked.pop_front() {
                    self.ready.push((now, of_outcome(address, outcome)));
                }
            }
            Input::Up | Input::Down(_) => {
                self.asked.clear();
                self.finish(DataRaw::RECEIVED);
            }
            Input::CanNotice(_) | Input::Sent => self.finish(DataRaw::RECEIVED),
            // The simulator's end of a bus has no tap, and a 1-Wire bus, operated by the kernel, has no frames.
            Input::I2cRequested(_)
            | Input::OneWire(_)
            | Input::Thermal(_)
            | Input::Gamepad(_)
            | Input::Gpio(_)
            | Input::Store(_) => {}
        }
    }

    /// Records an output of the port.
    pub fn sent(&mut self, now: Instant, output: &Output) {
        self.finish(DataRaw::RECEIVED);
        match output {
            Output::Words(words) => {
                words.iter().for_each(|word| self.push(now, *word, DataRaw::SENT));
                self.finish(DataRaw::SENT);
            }
            Output::Can(frame) => self.ready.push((now, of_can(frame, DataRaw::SENT))),
            Output::I2c(transfer) => {
                self.asked.push_back(transfer.address);
                self.ready.push((now, of_transfer(transfer)));
            }
            Output::I2cAnswer(_)
            | Output::OneWire(_)
            | Output::OneWireState(_)
            | Output::Thermal
            | Output::ThermalState(_)
            | Output::Gamepad(_)
            | Output::Gpio(_)
            | Output::Store(_) => {}
        }
    }

    /// Ends a frame after its pause.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.poll_timeout().is_some_and(|due| due <= now) {
            self.finish(DataRaw::RECEIVED);
        }
    }

    /// Deadline of [`Tap::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        (!self.words.is_empty()).then(|| self.last + FRAME_PAUSE)
    }

    /// Removes and returns the next frame with the time of its first word; its timestamp is not set yet.
    pub fn take(&mut self) -> Option<(Instant, DataRaw)> {
        if self.ready.is_empty() { None } else { Some(self.ready.remove(0)) }
    }

    fn push(&mut self, now: Instant, word: Word, direction: i8) {
        if word.ninth {
            self.finish(direction);
        }
        if self.words.is_empty() {
            self.first = now;
        }
        self.last = now;
        self.words.push(word);
        if is_whole(&self.words) || self.words.len() >= MAX_WORDS {
            self.finish(direction);
        }
    }

    fn finish(&mut self, direction: i8) {
        let Some(first) = self.words.first() else {
            return;
        };
        let (id, flags, from) = match first.ninth {
            true => (i32::from(first.byte), if is_whole(&self.words) { 0 } else { INCOMPLETE }, 1),
            false => (-1, STRAY, 0),
        };
        let data = self.words.drain(..).skip(from).map(|word| word.byte).collect();
        self.ready.push((self.first, DataRaw { timestamp: 0, direction, id, flags, data }));
    }
}

fn is_whole(words: &[Word]) -> bool {
    let addressed = words.first().is_some_and(|word| word.ninth);
    addressed && words.get(HEADER - 1).is_some_and(|length| words.len() == usize::from(length.byte) + OVERHEAD)
}

fn of_can(frame: &can::Frame, direction: i8) -> DataRaw {
    let (id, extended) = match frame.id() {
        can::Id::Standard(id) => (i32::from(id), 0),
        can::Id::Extended(id) => (id.cast_signed(), EXTENDED),
    };
    let flags = extended | if frame.is_remote() { REMOTE } else { 0 };
    DataRaw { timestamp: 0, direction, id, flags, data: frame.data().to_vec() }
}

fn of_transfer(transfer: &i2c::Transfer) -> DataRaw {
    let flags = match transfer.read {
        Read::None => 0,
        Read::Exactly(count) => i32::from(count),
        Read::Block { extra } => BLOCK | i32::from(extra),
    };
    let (id, data) = (i32::from(transfer.address.get()), transfer.write.to_vec());
    DataRaw { timestamp: 0, direction: DataRaw::SENT, id, flags, data }
}

fn of_outcome(address: i2c::Address, outcome: &i2c::Outcome) -> DataRaw {
    let (flags, data) = match outcome {
        Ok(read) => (0, read.to_vec()),
        Err(i2c::Error::NoAddress) => (NO_ADDRESS, Vec::new()),
        Err(i2c::Error::NoData { at }) => (NO_DATA, vec![*at]),
        Err(i2c::Error::Arbitration) => (ARBITRATION, Vec::new()),
        Err(i2c::Error::Stretched) => (STRETCHED, Vec::new()),
        Err(i2c::Error::Stuck) => (STUCK, Vec::new()),
        Err(i2c::Error::Other) => (OTHER, Vec::new()),
    };
    DataRaw { timestamp: 0, direction: DataRaw::RECEIVED, id: i32::from(address.get()), flags, data }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<Word> {
        let word = |token: &str| match token.strip_suffix('!') {
            Some(byte) => Word::address(u8::from_str_radix(byte, 16).unwrap()),
            None => Word::data(u8::from_str_radix(token, 16).unwrap()),
        };
        text.split_whitespace().map(word).collect()
    }

    fn taken(tap: &mut Tap) -> Vec<String> {
        let text = |(at, raw): (Instant, DataRaw)| {
            let DataRaw { direction, id, flags, data, .. } = raw;
            format!("{} {direction} {id:02x} {flags} {data:02x?}", at.as_nanos() / 1_000_000)
        };
        std::iter::from_fn(|| tap.take()).map(text).collect()
    }

    fn ms(ms: u64) -> Instant {
        Instant::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn a_request_and_its_answer_in_pieces_are_a_frame_each() {
        let mut tap = Tap::default();
        tap.sent(ms(1), &Output::Words(words("20! 01 00 00 9c")));
        tap.received(ms(3), &Input::Words(&words("20! 01 00")));
        assert_eq!(taken(&mut tap), ["1 1 20 0 [01, 00, 00, 9c]"]);
        tap.received(ms(4), &Input::Words(&words("02 07 00 55 11! 01 00 00 aa")));
        assert_eq!(taken(&mut tap), ["3 0 20 0 [01, 00, 02, 07, 00, 55]", "4 0 11 0 [01, 00, 00, aa]"]);
        assert_eq!(tap.poll_timeout(), None);
    }

    #[test]
    fn incomplete_frames_are_recorded_too() {
        let mut tap = Tap::default();
        tap.received(ms(0), &Input::Words(&words("07 08 20! 01 00 11! 01")));
        assert_eq!(taken(&mut tap), ["0 0 -1 2 [07, 08]".replace("-1", "ffffffff"), "0 0 20 1 [01, 00]".into()]);
        tap.handle_timeout(ms(19));
        assert_eq!(taken(&mut tap).len(), 0);
        tap.handle_timeout(tap.poll_timeout().unwrap());
        assert_eq!(taken(&mut tap), ["0 0 11 1 [01]"]);
    }

    #[test]
    fn endless_noise_is_recorded_in_bounded_pieces() {
        let mut tap = Tap::default();
        (0..1000).for_each(|n| tap.received(ms(n), &Input::Words(&[Word::data(n as u8)])));
        assert_eq!(taken(&mut tap).len(), 1000 / MAX_WORDS);
    }

    #[test]
    fn an_outcome_names_the_addressed_chip() {
        let mut tap = Tap::default();
        let transfer = |address, read| i2c::Transfer {
            address: i2c::Address::new(address).unwrap(),
            write: i2c::Bytes::from_slice(&[0x0D]).unwrap(),
            read,
        };
        tap.sent(ms(0), &Output::I2c(transfer(0x18, Read::Exactly(1))));
        tap.sent(ms(0), &Output::I2c(transfer(0x29, Read::Block { extra: 1 })));
        tap.received(ms(1), &Input::I2c(&Ok(i2c::Bytes::from_slice(&[0x60]).unwrap())));
        tap.received(ms(2), &Input::I2c(&Err(i2c::Error::NoAddress)));
        tap.received(ms(3), &Input::I2c(&Err(i2c::Error::NoAddress)));
        assert_eq!(taken(&mut tap), ["0 1 18 1 [0d]", "0 1 29 257 [0d]", "1 0 18 0 [60]", "2 0 29 1 []"]);
    }

    #[test]
    fn a_can_frame_has_its_kind() {
        let mut tap = Tap::default();
        tap.received(ms(0), &Input::Can { frame: can::Frame::standard(0x181, &[1]), at: ms(0) });
        tap.sent(ms(1), &Output::Can(can::Frame::remote(can::Id::Extended(0x1234), 2).unwrap()));
        assert_eq!(taken(&mut tap), ["0 0 181 0 [01]", "1 1 1234 3 []"]);
    }
}
