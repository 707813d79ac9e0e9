//! A master and boards on one simulated wire: half-duplex, optionally noisy, and with babbling devices.
//!
//! What two send at once reaches a third as nonsense or not at all: words that overlap come out with random bits, every
//! other one of them is lost in framing. Who sends does not hear. Boards hear each other's answers.

use crate::boards::{sd1, so1};
use crate::frame::Status;
use crate::master::{Config, Event, Master};
use crate::slave::{self, Slave};
use crate::testing::Random;
use crate::{Transmit, word_time};
use base::serial::Word;
use base::{Duration, Instant};
use std::vec::Vec;

mod culprits;
mod noise;

const BAUD: u32 = 115_200;

/// Who sends: the master, a board by its index, or a talker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Station {
    Master,
    Board(usize),
    Talker(usize),
}

#[derive(Clone, Copy, Debug)]
struct Flight {
    from: Station,
    start: Instant,
    end: Instant,
    word: Word,
    delivered: bool,
}

/// Sends the same words again and again, whatever the others do.
struct Talker {
    words: Vec<Word>,
    every: Duration,
    next: Instant,
}

struct Wire {
    now: Instant,
    master: Master,
    slaves: Vec<Slave>,
    talkers: Vec<Talker>,
    /// What the boards measure now: changes from request to request.
    measured: u32,
    answered: Vec<Vec<u8>>,
    flights: Vec<Flight>,
    sent: Option<Instant>,
    random: Random,
    /// One bit in so many is flipped.
    flips: Option<u64>,
    flipped: u64,
    events: Vec<Event>,
}

impl Wire {
    fn new(flips: Option<u64>) -> Self {
        Self::with(&[sd1::FRONT, so1::ADDRESS], flips)
    }

    /// Boards at these addresses; those that repeat are one node of the master.
    fn with(addresses: &[u8], flips: Option<u64>) -> Self {
        let mut master = Master::new(Config::default());
        let board = |address: &u8| {
            assert!(master.add_node(*address, Config::default().timeout));
            Slave::new(slave::Config::new(*address))
        };
        Self {
            now: Instant::ZERO,
            slaves: addresses.iter().map(board).collect(),
            master,
            talkers: Vec::new(),
            measured: 0,
            answered: Vec::new(),
            flights: Vec::new(),
            sent: None,
            random: Random::new(3),
            flips,
            flipped: 0,
            events: Vec::new(),
        }
    }

    /// When something happens next.
    fn next(&self) -> Option<Instant> {
        let talkers = self.talkers.iter().map(|talker| talker.next);
        let flights = self.flights.iter().filter(|flight| !flight.delivered).map(|flight| flight.end);
        let boards = self.slaves.iter().filter_map(Slave::poll_timeout);
        let master = [self.master.poll_timeout(), self.sent].into_iter().flatten();
        talkers.chain(flights).chain(boards).chain(master).min().map(|next| next.max(self.now))
    }

    /// Runs until the outstanding transaction has ended.
    fn run(&mut self) {
        self.drain();
        while !self.master.is_idle() {
            self.now = self.next().expect("a state that waits has a deadline");
            self.step();
        }
    }

    /// Runs until `end`.
    fn pass(&mut self, end: Instant) {
        self.drain();
        while let Some(next) = self.next().filter(|next| *next < end) {
            self.now = next;
            self.step();
        }
        self.now = end;
    }

    fn step(&mut self) {
        while let Some(index) = self.ended() {
            self.flights[index].delivered = true;
            self.deliver(self.flights[index]);
        }
        let old = self.now - word_time(BAUD);
        self.flights.retain(|flight| !flight.delivered || flight.end > old);
        if self.sent.is_some_and(|sent| sent <= self.now) {
            self.sent = None;
            self.master.handle_tx_done(self.now);
        }
        self.master.handle_timeout(self.now);
        self.slaves.iter_mut().for_each(|slave| slave.handle_timeout(self.now));
        self.drain();
    }

    /// The flight that ends first, if it has.
    fn ended(&self) -> Option<usize> {
        let under_way = self.flights.iter().enumerate().filter(|(_, flight)| !flight.delivered);
        let (index, flight) = under_way.min_by_key(|(_, flight)| flight.end)?;
        (flight.end <= self.now).then_some(index)
    }

    fn deliver(&mut self, flight: Flight) {
        let overlaps =
            |other: &&Flight| other.from != flight.from && other.start < flight.end && flight.start < other.end;
        let others: Vec<Station> = self.flights.iter().filter(overlaps).map(|other| other.from).collect();
        let mut word = flight.word;
        if !others.is_empty() {
            if self.random.one_in(2) {
                return;
            }
            let bits = self.random.next();
            word = Word { byte: bits as u8, ninth: bits & 0x100 != 0 };
        }
        let hears = |station: Station| station != flight.from && !others.contains(&station);
        if hears(Station::Master) {
            self.master.handle_rx(flight.end, &[word]);
        }
        for (index, slave) in self.slaves.iter_mut().enumerate() {
            if hears(Station::Board(index)) {
                slave.handle_rx(flight.end, &[word]);
            }
        }
    }

    fn drain(&mut self) {
        let mut sent: Vec<(Station, Vec<Word>)> = Vec::new();
        if let Some(Transmit { words }) = self.master.poll_tx(self.now) {
            sent.push((Station::Master, words.to_vec()));
            self.sent = Some(self.now + word_time(BAUD) * words.len() as u32);
        }
        for (index, slave) in self.slaves.iter_mut().enumerate() {
            if let Some(asked) = slave.poll_request() {
                self.measured = self.measured.wrapping_add(1);
                let data = measure(asked.instruction, self.measured);
                slave.respond(if data.is_empty() { Status::UnknownInstruction } else { Status::Ok }, &data);
                self.answered.push(data);
            }
            if let Some(Transmit { words }) = slave.poll_tx(self.now) {
                sent.push((Station::Board(index), words.to_vec()));
            }
        }
        for (index, talker) in self.talkers.iter_mut().enumerate().filter(|(_, talker)| talker.next <= self.now) {
            talker.next = self.now + talker.every;
            sent.push((Station::Talker(index), talker.words.clone()));
        }
        for (from, words) in sent {
            let mut start = self.now;
            for word in words {
                let (end, word) = (start + word_time(BAUD), self.disturb(word));
                self.flights.push(Flight { from, start, end, word, delivered: false });
                start = end;
            }
        }
        while let Some(event) = self.master.poll_event() {
            self.events.push(event);
        }
    }

    fn disturb(&mut self, word: Word) -> Word {
        let Some(flips) = self.flips else { return word };
        let mask = (0..9).fold(0_u16, |mask, bit| mask | u16::from(self.random.one_in(flips)) << bit);
        self.flipped += u64::from(mask.count_ones());
        Word { byte: word.byte ^ mask as u8, ninth: word.ninth ^ (mask & 0x100 != 0) }
    }
}

fn measure(instruction: u8, n: u32) -> Vec<u8> {
    match instruction {
        code if code == sd1::GET_BOTH_DATA.code => {
            let srfs = (0..8).map(|i| (n * 7 + i * 300) as u16 % 6000).collect();
            let irs = [120, n as u8].into_iter().collect();
            sd1::Both { srfs, irs }.build().to_vec()
        }
        code if code == so1::GET_TICKS.code => {
            so1::build_ticks(&[n as i16, (n as i16).wrapping_neg()].into_iter().collect()).to_vec()
        }
        _ => Vec::new(),
    }
}
