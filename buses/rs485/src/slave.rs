//! The answering side of the bus, for emulated boards: what any board does before it looks at the instruction.
//!
//! Feed it words with [`Slave::handle_rx`]; when [`Slave::poll_request`] gives a request, the board's logic answers
//! with [`Slave::respond`]; send what [`Slave::poll_tx`] gives when its time has come.

use crate::crc::Crc8;
use crate::frame::{BROADCAST, Frame, MAX_DATA, NO_ACK, RESEND, Status, Words};
use crate::reader::{Counters, Reader, Received};
use crate::{Data, Transmit, word_time};
use base::serial::Word;
use base::{Duration, Instant};

/// Configuration of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Own address.
    pub address: u8,
    /// bit/s on the wire.
    pub baud: u32,
    /// The bus's CRC.
    pub crc: Crc8,
    /// From the request's last bit to the answer's first.
    pub delay: Duration,
    /// A frame with a longer gap between two words is dropped.
    pub gap: Duration,
    /// Time limit for the board's logic; a request not answered until then is dropped.
    pub answer_within: Duration,
}

impl Config {
    /// 115200 Bd, the default CRC, answers after 200 us, a gap of 5 ms, 20 ms for the board (`docs/facts/boards.md` 1).
    #[must_use]
    pub const fn new(address: u8) -> Self {
        Self {
            address,
            baud: 115_200,
            crc: Crc8::SAE_J1850,
            delay: Duration::from_micros(200),
            gap: Duration::from_millis(5),
            answer_within: Duration::from_millis(20),
        }
    }
}

/// Request of the master.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asked {
    /// Instruction.
    pub instruction: u8,
    /// With which data.
    pub data: Data,
    /// True if the master waits for [`Slave::respond`].
    pub answered: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Listening,
    /// The board's logic owes an answer to `instruction`, until `until`.
    Asked {
        instruction: u8,
        due: Instant,
        until: Instant,
    },
    /// The answer is in `answer`.
    Answering {
        due: Instant,
    },
}

/// The answering side of a board.
#[derive(Debug)]
pub struct Slave {
    config: Config,
    word: Duration,
    reader: Reader,
    state: State,
    asked: Option<Asked>,
    /// The last response, for RESEND, while `repeatable` names its instruction.
    answer: Words,
    repeatable: Option<u8>,
}

impl Slave {
    /// A slave that listens.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            config,
            word: word_time(config.baud),
            reader: Reader::new(config.crc, Some(config.gap)),
            state: State::Listening,
            asked: None,
            answer: Words::new(),
            repeatable: None,
        }
    }

    /// Configuration.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Answers after `delay` from the next request on: a board in haste, or a faulty one.
    pub fn set_delay(&mut self, delay: Duration) {
        self.config.delay = delay;
    }

    /// Counters of reception.
    #[must_use]
    pub fn reception(&self) -> Counters {
        self.reader.counters()
    }

    /// Takes words from the wire, one after the other without a gap, the last of them at `now`.
    pub fn handle_rx(&mut self, now: Instant, words: &[Word]) {
        let mut at = now - self.word * words.len().saturating_sub(1) as u32;
        for word in words {
            self.handle_word(at, *word);
            at += self.word;
        }
    }

    fn handle_word(&mut self, at: Instant, word: Word) {
        let (frame, intact) = match self.reader.push(at, word) {
            None => return,
            Some(Received::Frame(frame)) => (frame, true),
            Some(Received::BadCrc(frame)) => (frame, false),
        };
        let broadcast = frame.address == BROADCAST;
        if frame.address != self.config.address && !broadcast {
            return;
        }
        let Frame { instruction, flags, .. } = frame;
        let answered = !broadcast && flags & NO_ACK == 0;
        let due = at + self.config.delay;
        if !intact {
            self.repeatable = None;
            if answered {
                self.encode(instruction, Status::BadCrc, &[]);
                self.state = State::Answering { due };
            }
        } else if answered && flags & RESEND != 0 && self.repeatable == Some(instruction) {
            self.state = State::Answering { due };
        } else {
            self.repeatable = None;
            self.asked = Some(Asked { instruction, data: frame.data.iter().copied().collect(), answered });
            let until = due + self.config.answer_within;
            self.state = if answered { State::Asked { instruction, due, until } } else { State::Listening };
        }
    }

    /// Next request of the master, to be answered by [`Slave::respond`]. A request that was not fetched is replaced by
    /// the next.
    pub fn poll_request(&mut self) -> Option<Asked> {
        self.asked.take()
    }

    /// Answers the request that was polled last, at most [`MAX_DATA`] bytes (more are cut off). Does nothing when
    /// the master does not wait: a broadcast, `NO_ACK`, or answered already.
    pub fn respond(&mut self, status: Status, data: &[u8]) {
        if let State::Asked { instruction, due, .. } = self.state {
            self.encode(instruction, status, &data[..data.len().min(MAX_DATA)]);
            self.repeatable = Some(instruction);
            self.state = State::Answering { due };
        }
    }

    /// Forgets a request that its board did not answer in time.
    pub fn handle_timeout(&mut self, now: Instant) {
        if let State::Asked { until, .. } = self.state
            && until <= now
        {
            self.state = State::Listening;
            self.asked = None;
        }
    }

    /// Next output, to be sent at once and without a gap.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Transmit<'_>> {
        match self.state {
            State::Answering { due } if due <= now => {
                self.state = State::Listening;
                Some(Transmit { words: &self.answer })
            }
            _ => None,
        }
    }

    /// Instant of the next [`Slave::handle_timeout`] and [`Slave::poll_tx`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.state {
            State::Listening => None,
            State::Asked { until, .. } => Some(until),
            State::Answering { due } => Some(due),
        }
    }

    /// Resets as after power-on: nothing received, nothing to repeat or send. The counters stay.
    pub fn reset(&mut self) {
        self.reader.reset();
        self.state = State::Listening;
        self.asked = None;
        self.repeatable = None;
    }

    fn encode(&mut self, instruction: u8, status: Status, data: &[u8]) {
        let address = self.config.address;
        Frame { address, instruction, flags: status as u8, data }.encode(self.config.crc, &mut self.answer);
    }
}

#[cfg(test)]
mod tests;
