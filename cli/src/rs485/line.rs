//! A port of our own with a master on it: one question at a time.

use super::target::{Known, Target};
use crate::Failed;
use crate::port::OpenPort;
use base::serial::Word;
use base::{Duration, Instant};
use host::clock;
use host::ports::{PortConfig, Received};
use module::{Input, Output};
use rs485::boards::psc1;
use rs485::frame::Status;
use rs485::master::{self, Event, Master, Request, Why};

/// What came of a question.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// The board answered.
    Reply {
        /// What it says of the request.
        status: Status,
        /// Data.
        data: Vec<u8>,
        /// From the request's first word to the answer's last.
        round_trip: Duration,
    },
    /// What is not answered has been sent.
    Sent,
    /// Nothing was heard.
    Silent,
    /// What was heard was damaged.
    Garbled(Why),
    /// Ctrl-C.
    Interrupt,
}

/// What came after a question without an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Settled {
    /// A frame, too late.
    Late,
    /// Nothing.
    Quiet,
    /// Ctrl-C.
    Interrupt,
}

/// An opened line.
pub struct Line {
    open: OpenPort,
    master: Master,
    started: Instant,
    words: Vec<Word>,
}

impl Line {
    /// Opens a line that nobody holds. A failed transaction is repeated `retries` times; boards that are not known to
    /// be on the line may take `timeout` to answer.
    pub fn open(target: &Target, retries: u8, timeout: Duration) -> Result<Self, Failed> {
        if let Some(holder) = target.holder() {
            let whose = format!("{} ({}) is held by {}", target.name, target.terminal.path.display(), holder.text());
            let help = match &holder.module {
                Some(module) => {
                    format!("stop it first (advee state {module} TERMINATE), or look on: advee rs485 monitor")
                }
                None => "end it first".into(),
            };
            return Err(format!("{whose}: {help}").into());
        }
        let open = OpenPort::open(&target.name, PortConfig::Terminal(target.terminal.clone()))?;
        let mut master = Master::new(master::Config {
            baud: target.terminal.baud,
            crc: target.crc,
            retries,
            timeout,
            full_duplex: target.known.iter().any(|known| known.board == Some(&psc1::BOARD)),
            unasked: psc1::UNASKED,
            ..master::Config::default()
        });
        for Known { address, timeout, .. } in &target.known {
            master.add_node(*address, *timeout);
        }
        Ok(Self { open, master, started: Instant::ZERO, words: Vec::new() })
    }

    /// Lets a board that is not configured take so long to answer.
    pub fn allow(&mut self, board: &Known) {
        self.master.add_node(board.address, board.timeout);
    }

    /// Asks, and waits for what comes of it.
    pub fn ask(&mut self, request: Request<'_>) -> Result<Answer, Failed> {
        // Idle: the last question ended with its event. Too long: refused where data is read.
        self.master.request(request).map_err(|error| format!("{}: {error:?}", self.open.name))?;
        loop {
            let now = clock::now();
            self.receive(now)?;
            self.master.handle_timeout(now);
            if let Some(transmit) = self.master.poll_tx(now) {
                self.started = now;
                let output = Output::Words(transmit.words.to_vec());
                self.open.port.device.send(now, &output).map_err(|why| self.open.lost(&why))?;
            }
            while let Some(event) = self.master.poll_event() {
                if let Some(answer) = self.answer(now, event) {
                    return Ok(answer);
                }
            }
            if self.wait(self.master.poll_timeout().unwrap_or(now))? {
                self.master.cancel();
                return Ok(Answer::Interrupt);
            }
        }
    }

    /// Awaits the end of a board that is late: until a whole frame came that answers nothing, or nothing for so long.
    /// The protocol does not tell to which request an answer belongs.
    pub fn settle(&mut self, quiet: Duration) -> Result<Settled, Failed> {
        let before = self.master.bus_statistics().stray_frames;
        let until = clock::now() + quiet;
        loop {
            let now = clock::now();
            self.receive(now)?;
            if self.master.bus_statistics().stray_frames > before {
                return Ok(Settled::Late);
            }
            if now >= until {
                return Ok(Settled::Quiet);
            }
            if self.wait(until)? {
                return Ok(Settled::Interrupt);
            }
        }
    }

    fn answer(&self, now: Instant, event: Event) -> Option<Answer> {
        match event {
            Event::Reply { status, data, .. } => {
                Some(Answer::Reply { status, data: data.to_vec(), round_trip: now.since(self.started) })
            }
            Event::Sent { .. } => Some(Answer::Sent),
            Event::Silent { .. } => Some(Answer::Silent),
            Event::Garbled { why, .. } => Some(Answer::Garbled(why)),
            // It did not leave: as good as not heard.
            Event::Unsent { .. } => Some(Answer::Silent),
            _ => None,
        }
    }

    fn receive(&mut self, now: Instant) -> Result<(), Failed> {
        while self.open.port.device.take_sent(now) {
            self.master.handle_tx_done(now);
        }
        loop {
            match self.open.port.device.receive(now) {
                Ok(Received::Nothing) => return Ok(()),
                Ok(Received::Input { input: Input::Words(words), .. }) => self.master.handle_rx(now, words),
                Ok(Received::Note(note)) => self.open.tell(&note),
                Ok(_) => {}
                Err(why) => return Err(self.open.lost(&why)),
            }
        }
    }

    /// The words that came since, with nothing asked; none when `until` came first, or Ctrl-C.
    pub fn listen(&mut self, until: Instant) -> Result<Option<&[Word]>, Failed> {
        loop {
            let now = clock::now();
            self.words.clear();
            match self.open.port.device.receive(now) {
                Ok(Received::Nothing) => {}
                Ok(Received::Input { input: Input::Words(words), .. }) => self.words.extend_from_slice(words),
                Ok(Received::Note(note)) => self.open.tell(&note),
                Ok(_) => {}
                Err(why) => return Err(self.open.lost(&why)),
            }
            if !self.words.is_empty() {
                return Ok(Some(&self.words));
            }
            if now >= until || self.wait(until)? {
                return Ok(None);
            }
        }
    }

    /// Waits for the port, for the end of a sending, or until `until`; true at Ctrl-C.
    pub fn wait(&mut self, until: Instant) -> Result<bool, Failed> {
        self.open.wait(until)
    }
}

/// What is wrong with an answer, for people.
pub fn why(why: Why) -> String {
    match why {
        Why::Crc => "wrong CRC".into(),
        Why::Length { got } => format!("{got} data bytes, which the instruction does not have"),
        Why::Status { got } => format!("status {got:#04x}, which is none"),
        Why::Incomplete => "no whole frame".into(),
        Why::Request => "it read the request with a wrong CRC".into(),
    }
}

/// What a board says of a request, in the words of the thesis.
pub fn status_name(status: Status) -> &'static str {
    match status {
        Status::Ok => "OK",
        Status::Error => "ERROR",
        Status::BadCrc => "BADCRC",
        Status::UnknownInstruction => "UNKINSTR",
    }
}
