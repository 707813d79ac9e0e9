//! An emulated serial line: the boards on it, and the wire's time where the real wire has none.

use super::sd1::Sd1;
use super::so1::So1;
use crate::scene::Scene;
use base::serial::Word;
use base::{Duration, Instant};
use rs485::boards::{DO_RESET, GET_VERSION, Version};
use rs485::frame::Status;
use rs485::slave::{Asked, Slave};
use rs485::{Data, word_time};
use std::collections::VecDeque;

/// The emulated boards' firmware.
const VERSION: Version = Version { major: 1, minor: 0 };

/// What a board is.
#[derive(Debug)]
pub(crate) enum Kind {
    Sd1(Sd1),
    So1(So1),
}

/// A board and what ails it.
#[derive(Debug)]
pub(crate) struct Board {
    pub name: String,
    pub kind: Kind,
    slave: Slave,
    /// It neither hears nor answers until then.
    pub silent_until: Instant,
    /// Its answers have a wrong CRC until then.
    pub bad_crc_until: Instant,
    /// It knows no instruction until then.
    pub refuses_until: Instant,
    /// Its encoders stand until then.
    pub stuck_until: Instant,
}

impl Board {
    pub fn new(name: &str, slave: Slave, kind: Kind) -> Self {
        let never = Instant::ZERO;
        Self {
            name: name.into(),
            kind,
            slave,
            silent_until: never,
            bad_crc_until: never,
            refuses_until: never,
            stuck_until: never,
        }
    }

    fn answer(&mut self, now: Instant, asked: &Asked, scene: &Scene) {
        let (status, data) = match (asked.instruction, &mut self.kind) {
            _ if self.refuses_until > now => (Status::UnknownInstruction, Data::new()),
            (code, _) if code == GET_VERSION.code => (Status::Ok, VERSION.build().into_iter().collect()),
            (code, Kind::Sd1(board)) if code == DO_RESET.code => {
                board.reset(now);
                (Status::Ok, Data::new())
            }
            (code, Kind::So1(board)) if code == DO_RESET.code => {
                *board = So1::new(scene);
                (Status::Ok, Data::new())
            }
            (_, Kind::Sd1(board)) => board.answer(now, asked, scene),
            (_, Kind::So1(board)) => {
                board.stick(now < self.stuck_until, scene);
                board.answer(asked, scene)
            }
        };
        self.slave.respond(status, &data);
    }
}

/// The line.
#[derive(Debug)]
pub(crate) struct SerialLine {
    pub boards: Vec<Board>,
    word: Duration,
    /// What has left the boards and is not yet over.
    wire: VecDeque<(Instant, Vec<Word>)>,
    /// When the last received word is over.
    heard: Instant,
}

impl SerialLine {
    /// A line; with `wire_time` it delays everything by the words' time on the wire, for a port that has none.
    pub fn new(baud: u32, wire_time: bool, boards: Vec<Board>) -> Self {
        let word = if wire_time { word_time(baud) } else { Duration::ZERO };
        Self { boards, word, wire: VecDeque::new(), heard: Instant::ZERO }
    }

    pub fn handle_rx(&mut self, now: Instant, words: &[Word], scene: &Scene) {
        let at = self.heard.max(now) + self.word * words.len() as u32;
        self.heard = at;
        for board in self.boards.iter_mut().filter(|board| board.silent_until <= now) {
            board.slave.handle_rx(at, words);
            while let Some(asked) = board.slave.poll_request() {
                board.answer(now, &asked, scene);
            }
        }
    }

    pub fn handle_timeout(&mut self, now: Instant) {
        for board in &mut self.boards {
            board.slave.handle_timeout(now);
            while let Some(transmit) = board.slave.poll_tx(now) {
                let mut words = transmit.words.to_vec();
                if board.silent_until > now {
                    continue;
                }
                if let Some(crc) = words.last_mut()
                    && board.bad_crc_until > now
                {
                    crc.byte ^= 0x55;
                }
                self.wire.push_back((now + self.word * words.len() as u32, words));
            }
        }
    }

    /// What is to be handed to the port now.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Vec<Word>> {
        let place = self.wire.iter().position(|(due, _)| *due <= now)?;
        self.wire.remove(place).map(|(_, words)| words)
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        let slaves = self.boards.iter().filter_map(|board| board.slave.poll_timeout());
        slaves.chain(self.wire.iter().map(|(due, _)| *due)).min()
    }
}
