//! An emulated serial line: the boards on it, their injected faults, and the wire's time where the real wire has none.

use super::psc1::Psc1;
use super::sbs1::Sbs1;
use super::sd1::Sd1;
use super::so1::So1;
use crate::disturbance::{Disturbance, garbled};
use crate::faults::InjectedFault;
use crate::random::Random;
use crate::scene::Scene;
use base::serial::Word;
use base::{Duration, Instant};
use rs485::boards::{DO_RESET, GET_VERSION, Version};
use rs485::crc::Crc8;
use rs485::frame::{Frame, HEADER, Status, Words};
use rs485::slave::{Asked, Slave};
use rs485::{Data, word_time};
use std::collections::VecDeque;

/// The emulated boards' firmware.
const VERSION: Version = Version { major: 1, minor: 0 };
/// Time from a reset to the first request that is received.
const BOOT: Duration = Duration::from_millis(100);
/// Pause between two frames of a babbling board.
const BABBLE: Duration = Duration::from_millis(10);
/// Words of noise of one who babbles no frames.
const NOISE: usize = 20;

/// Kind of a board.
#[derive(Debug)]
pub(crate) enum Kind {
    Sd1(Box<Sd1>),
    So1(So1),
    Sbs1(Sbs1),
    Psc1(Box<Psc1>),
}

/// Ends of the faults injected into a board, with their parameters.
#[derive(Debug, Default)]
struct ActiveFaults {
    silent: Instant,
    refuses: Instant,
    stuck: Instant,
    bad_crc: Instant,
    bad_length: Instant,
    slow: (Instant, Duration),
    garbled: (Instant, f64),
    clash: Instant,
    babble: (Instant, bool),
}

/// A board and its injected faults.
#[derive(Debug)]
pub(crate) struct Board {
    pub name: String,
    pub kind: Kind,
    slave: Slave,
    /// Response time without faults.
    delay: Duration,
    active_faults: ActiveFaults,
    /// True while it is supplied; a PSC1 supplies itself.
    fed: bool,
    /// End of its start-up, before which it receives nothing.
    boots_until: Instant,
    babbles: Instant,
    /// End of its transmission.
    talks: Instant,
}

impl Board {
    pub fn new(name: &str, slave: Slave, kind: Kind) -> Self {
        let delay = slave.config().delay;
        Self {
            name: name.into(),
            kind,
            slave,
            delay,
            active_faults: ActiveFaults::default(),
            fed: true,
            boots_until: Instant::ZERO,
            babbles: Instant::NEVER,
            talks: Instant::ZERO,
        }
    }

    /// Injects a fault; false if it is none of its kind.
    pub fn inject(&mut self, now: Instant, injected: InjectedFault, until: Instant, scene: &Scene) -> bool {
        match (injected, &mut self.kind) {
            (InjectedFault::Silent, _) => self.active_faults.silent = until,
            (InjectedFault::Refuses, _) => self.active_faults.refuses = until,
            (InjectedFault::BadCrc, _) => self.active_faults.bad_crc = until,
            (InjectedFault::BadLength, _) => self.active_faults.bad_length = until,
            (InjectedFault::Slow(late), _) => self.active_faults.slow = (until, late),
            (InjectedFault::Garbled(probability), _) => self.active_faults.garbled = (until, probability),
            (InjectedFault::Clash, _) => self.active_faults.clash = until,
            (InjectedFault::Babble { noise, .. }, _) => {
                self.active_faults.babble = (until, noise);
                self.babbles = now;
            }
            (InjectedFault::Reset, _) => self.reset(now, scene),
            (InjectedFault::Stuck, Kind::So1(_)) => self.active_faults.stuck = until,
            (InjectedFault::Wrap, Kind::So1(board)) => board.wrap(scene),
            (InjectedFault::Blind, Kind::Sd1(board)) => board.blind(until),
            (InjectedFault::Stuck, Kind::Sd1(board)) => board.stick(now, until, scene),
            (InjectedFault::Crosstalk(probability), Kind::Sd1(board)) => board.mix(until, probability),
            (InjectedFault::Hidden(beacon), Kind::Sbs1(board)) => board.hide(until, beacon),
            (InjectedFault::False(probability), Kind::Sbs1(board)) => board.mislead(until, probability),
            (InjectedFault::Glare(rate), Kind::Sbs1(board)) => board.glare(now, until, rate),
            (InjectedFault::Supply(volts), Kind::Sbs1(board)) => board.feed(until, volts),
            (InjectedFault::Bumper(number), Kind::Psc1(board)) => board.press(number, until),
            (InjectedFault::StopButton, Kind::Psc1(board)) => board.push_button(until),
            (InjectedFault::Cold, Kind::Psc1(board)) => board.start_cold(now),
            (InjectedFault::Trip(channel), Kind::Psc1(board)) => return board.trip(channel),
            (InjectedFault::Overload(channel), Kind::Psc1(board)) => return board.overload(channel, until),
            (InjectedFault::Battery(volts), Kind::Psc1(board)) => board.set_battery(volts, until),
            (InjectedFault::PowerOff(seconds), Kind::Psc1(board)) => board.power_off(now, seconds),
            (InjectedFault::None, kind) => {
                match kind {
                    Kind::Psc1(board) => {
                        board.let_go(now);
                        board.supply();
                    }
                    Kind::Sd1(board) => board.heal(),
                    Kind::Sbs1(board) => {
                        board.hide(now, 0);
                        board.mislead(now, 0.0);
                        board.heal(now);
                    }
                    Kind::So1(_) => {}
                }
                self.active_faults = ActiveFaults::default();
                self.babbles = Instant::NEVER;
            }
            _ => return false,
        }
        true
    }

    /// Supply comes or goes.
    pub fn feed(&mut self, now: Instant, fed: bool, scene: &Scene) {
        if fed && !self.fed {
            self.reset(now, scene);
        }
        self.fed = fed;
    }

    fn reset(&mut self, now: Instant, scene: &Scene) {
        self.slave.reset();
        self.boots_until = now + BOOT;
        self.forget(now, scene);
    }

    fn forget(&mut self, now: Instant, scene: &Scene) {
        match &mut self.kind {
            Kind::Sd1(board) => board.reset(now),
            Kind::So1(board) => *board = So1::new(scene),
            Kind::Sbs1(board) => board.reset(now),
            Kind::Psc1(board) => board.reset(now),
        }
    }

    fn hears(&self, now: Instant) -> bool {
        self.fed && self.active_faults.silent <= now && self.boots_until <= now
    }

    fn answer(&mut self, now: Instant, asked: &Asked, scene: &Scene) {
        let (status, data) = match (asked.instruction, &mut self.kind) {
            _ if self.active_faults.refuses > now => (Status::UnknownInstruction, Data::new()),
            (code, _) if code == GET_VERSION.code => (Status::Ok, VERSION.build().into_iter().collect()),
            (code, _) if code == DO_RESET.code => (Status::Ok, Data::new()),
            (_, Kind::Sd1(board)) => board.answer(now, asked, scene),
            (_, Kind::So1(board)) => {
                board.stick(now < self.active_faults.stuck, scene);
                board.answer(asked, scene)
            }
            (_, Kind::Sbs1(board)) => board.answer(now, asked, scene),
            (_, Kind::Psc1(board)) => board.answer(now, asked, scene),
        };
        self.slave.respond(status, &data);
    }

    fn handle_rx(&mut self, at: Instant, now: Instant, words: &[Word], scene: &Scene) {
        let (slow, late) = self.active_faults.slow;
        self.slave.set_delay(if slow > now { late } else { self.delay });
        self.slave.handle_rx(at, words);
        while let Some(asked) = self.slave.poll_request() {
            self.answer(now, &asked, scene);
            if asked.instruction == DO_RESET.code && self.active_faults.refuses <= now {
                // The answer is in the slave, and is sent first.
                self.forget(now, scene);
            }
        }
    }

    /// Next unsolicited message.
    fn unasked(&mut self, now: Instant, crc: Crc8) -> Option<Words> {
        let hears = self.hears(now);
        let Kind::Psc1(board) = &mut self.kind else { return None };
        // Messages of a silent board are lost.
        let says = std::iter::from_fn(|| board.poll_unasked()).find(|_| hears)?;
        let (instruction, data) = says.build();
        Some(frame(self.slave.config().address, instruction.code, &data, crc))
    }

    /// The next of its babble, when that is due.
    fn babble(&mut self, now: Instant, crc: Crc8, random: &mut Random) -> Option<Words> {
        if self.babbles > now {
            return None;
        }
        let (until, noise) = self.active_faults.babble;
        self.babbles = if until > now { now + BABBLE } else { Instant::NEVER };
        if until <= now || !self.fed {
            return None;
        }
        let word = |_| {
            let bits = random.bits();
            Word { byte: bits as u8, ninth: bits & 0xF00 == 0 }
        };
        Some(match noise {
            true => (0..NOISE).map(word).collect(),
            false => frame(self.slave.config().address, 0x01, &[0; 4], crc),
        })
    }

    /// Applies its faults to a message.
    fn distort(&self, now: Instant, words: &mut Vec<Word>, crc: Crc8, random: &mut Random) {
        if self.active_faults.bad_length > now && words.len() > HEADER {
            words.insert(HEADER, Word::data(0));
            words[HEADER - 1].byte = words[HEADER - 1].byte.wrapping_add(1);
            seal(words, crc);
        }
        if self.active_faults.bad_crc > now
            && let Some(crc) = words.last_mut()
        {
            crc.byte ^= 0x55;
        }
        if self.active_faults.clash > now {
            clash(words, random);
        }
        let (until, probability) = self.active_faults.garbled;
        if until > now {
            for word in words {
                if random.chance(probability) {
                    *word = garbled(random, *word);
                }
            }
        }
    }

    fn poll_timeout(&self) -> Instant {
        let own = if let Kind::Psc1(board) = &self.kind { board.poll_timeout() } else { Instant::NEVER };
        self.slave.poll_timeout().map_or(own, |due| due.min(own)).min(self.babbles)
    }
}

/// A second board answers alike, a few words later: overlapping words are garbled, the rest stays.
fn clash(words: &mut Vec<Word>, random: &mut Random) {
    let twin = words.clone();
    let offset = random.bits() as usize % (words.len() + 3);
    if offset == 0 {
        // In step and alike: two answers look like one.
        return;
    }
    for word in words.iter_mut().skip(offset) {
        *word = garbled(random, *word);
    }
    // Behind a gap, or where the first one's answer ends.
    words.extend(twin.into_iter().skip(words.len().saturating_sub(offset)));
}

fn frame(address: u8, instruction: u8, data: &[u8], crc: Crc8) -> Words {
    let mut words = Words::new();
    Frame { address, instruction, flags: Status::Ok as u8, data }.encode(crc, &mut words);
    words
}

fn seal(words: &mut [Word], crc: Crc8) {
    if let Some((last, covered)) = words.split_last_mut() {
        last.byte = crc.of(covered.iter().map(|word| word.byte));
    }
}

/// Kind of wire behind the port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wire {
    /// A pseudo-terminal without a wire: the line simulates the words' time and their disturbances.
    None,
    /// A real wire, with its own timing; the line simulates disturbances only.
    Real,
    /// The host models both.
    Modelled,
}

/// The line.
#[derive(Debug)]
pub(crate) struct SerialLine {
    pub boards: Vec<Board>,
    crc: Crc8,
    behind: Wire,
    /// Duration of a word, real or simulated.
    word: Duration,
    played: Duration,
    /// Messages on the wire, with the instants of their ends.
    wire: VecDeque<(Instant, Vec<Word>)>,
    /// End of the last received word.
    heard: Instant,
    random: Random,
    disturbance: Disturbance,
}

impl SerialLine {
    pub fn new(baud: u32, crc: Crc8, wire: Wire, boards: Vec<Board>, random: Random) -> Self {
        let word = word_time(baud);
        let played = if wire == Wire::None { word } else { Duration::ZERO };
        Self {
            boards,
            crc,
            behind: wire,
            word,
            played,
            wire: VecDeque::new(),
            heard: Instant::ZERO,
            random,
            disturbance: Disturbance::default(),
        }
    }

    pub fn handle_rx(&mut self, now: Instant, words: &[Word], scene: &Scene) {
        let at = self.heard.max(now) + self.played * words.len() as u32;
        self.heard = at;
        if self.random.chance(self.disturbance.loss(now)) {
            return;
        }
        for board in self.boards.iter_mut().filter(|board| board.hears(now)) {
            board.handle_rx(at, now, words, scene);
        }
    }

    /// Injects a fault into the line itself; false if it is none. Where the host models a wire, the host does it.
    pub fn disturb(&mut self, now: Instant, injected: InjectedFault, until: Instant) -> bool {
        let known = matches!(
            injected,
            InjectedFault::Noise(_)
                | InjectedFault::Loss(_)
                | InjectedFault::Duplicate(_)
                | InjectedFault::Delay(_)
                | InjectedFault::None
        );
        if known && self.behind != Wire::Modelled {
            self.disturbance.inject(now, injected, until);
        }
        known
    }

    pub fn handle_timeout(&mut self, now: Instant) {
        for place in 0..self.boards.len() {
            let board = &mut self.boards[place];
            board.slave.handle_timeout(now);
            let answer = board.slave.poll_tx(now).map(|transmit| transmit.words.to_vec());
            if let Some(words) = answer.filter(|_| board.hears(now)) {
                self.talk(now, place, words);
            }
            if let Some(words) = self.boards[place].babble(now, self.crc, &mut self.random) {
                self.talk(now, place, words.to_vec());
            }
        }
    }

    /// Sends unsolicited messages of the boards.
    pub fn speak(&mut self, now: Instant) {
        for place in 0..self.boards.len() {
            while let Some(words) = self.boards[place].unasked(now, self.crc) {
                self.talk(now, place, words.to_vec());
            }
        }
    }

    /// Sends a board's message: after its earlier ones, and over those of others.
    fn talk(&mut self, now: Instant, place: usize, mut words: Vec<Word>) {
        let board = &self.boards[place];
        board.distort(now, &mut words, self.crc, &mut self.random);
        let begin = board.talks.max(now);
        let others = self.boards.iter().enumerate().filter(|(other, _)| *other != place).map(|(_, other)| other.talks);
        let taken = others.max().unwrap_or(Instant::ZERO).since(begin);
        let overlap = taken.as_nanos().div_ceil(self.word.as_nanos().max(1)) as usize;
        for word in words.iter_mut().take(overlap) {
            *word = garbled(&mut self.random, *word);
        }
        self.boards[place].talks = begin + self.word * words.len() as u32;
        let due = if self.played == Duration::ZERO { now } else { begin + self.played * words.len() as u32 };
        if self.random.chance(self.disturbance.loss(now)) {
            return;
        }
        self.disturbance.garble(now, &mut words, &mut self.random);
        let due = self.disturbance.arrival(now, due);
        if self.disturbance.duplicates(now, &mut self.random) {
            self.wire.push_back((due, words.clone()));
        }
        self.wire.push_back((due, words));
    }

    /// Next output for the port.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Vec<Word>> {
        let place = self.wire.iter().position(|(due, _)| *due <= now)?;
        self.wire.remove(place).map(|(_, words)| words)
    }

    /// Instant of the next [`SerialLine::handle_timeout`].
    pub fn poll_timeout(&self) -> Instant {
        let boards = self.boards.iter().map(Board::poll_timeout).fold(Instant::NEVER, Instant::min);
        self.wire.iter().map(|(due, _)| *due).fold(boards, Instant::min)
    }
}
