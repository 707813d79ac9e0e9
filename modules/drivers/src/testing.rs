//! A driver with one emulated board on a simulated wire in virtual time.

use base::serial::Word;
use base::{Duration, Instant};
use messages::Message;
use module::bench::Bench;
use module::{Action, Event, Input, Module, Output, PortId, Shell, ShellConfig, State};
use rs485::boards::{GET_VERSION, Version};
use rs485::crc::Crc8;
use rs485::frame::{Frame, Status, Words};
use rs485::slave::{self, Asked, Slave};
use rs485::word_time;
use std::collections::VecDeque;

const PORT: PortId = PortId(0);

/// Behaviour of the board: from a request to its answer.
pub(crate) type Answer<B> = fn(&mut B, Instant, &Asked) -> (Status, Vec<u8>);

/// The wire with the driver at one end and the board at the other.
pub(crate) struct Rig<B> {
    pub bench: Bench,
    pub board: B,
    pub dead: bool,
    answer: Answer<B>,
    slave: Slave,
    words: VecDeque<(Instant, Word, bool)>,
    sent: Option<Instant>,
    pub log: Vec<(Instant, Action)>,
}

impl<B> Rig<B> {
    /// The driver has started, its port is open.
    pub fn new(name: &str, module: Box<dyn Module>, address: u8, board: B, answer: Answer<B>) -> Self {
        let mut rig = Self {
            bench: Bench::new(Shell::new(ShellConfig::new(name), module)),
            board,
            dead: false,
            answer,
            slave: Slave::new(slave::Config::new(address)),
            words: VecDeque::new(),
            sent: None,
            log: Vec::new(),
        };
        rig.bench.event(Event::Start);
        rig.port(Input::Up);
        rig
    }

    pub fn port(&mut self, input: Input<'_>) {
        self.bench.event(Event::Port { port: PORT, input });
        self.collect();
    }

    /// The board sends an unsolicited frame now.
    pub fn says(&mut self, instruction: u8, data: &[u8]) {
        let mut words = Words::new();
        let address = self.slave.config().address;
        Frame { address, instruction, flags: 0, data }.encode(Crc8::SAE_J1850, &mut words);
        // After what it is already sending.
        let busy = self.words.iter().filter(|(.., from_driver)| !from_driver).map(|(at, ..)| *at).max();
        let at = busy.unwrap_or_default().max(self.bench.now());
        self.put(at, &words, false);
    }

    pub fn message(&mut self, message: impl Into<Message>) {
        self.bench.message(message);
        self.collect();
    }

    pub fn command(&mut self, state: State) {
        let module = self.bench.shell.name().to_owned();
        let state = state as i8;
        self.message(messages::common::CmdState { module, state, manual: true, ..Default::default() });
    }

    fn put(&mut self, at: Instant, words: &[Word], from_driver: bool) {
        let times = (1..).map(|n| at + word_time(115_200) * n);
        self.words.extend(times.zip(words).map(|(at, word)| (at, *word, from_driver)));
        self.words.make_contiguous().sort_by_key(|(at, ..)| *at);
    }

    pub fn run(&mut self, duration: Duration) {
        let end = self.bench.now() + duration;
        loop {
            let slave = self.slave.poll_timeout().filter(|_| !self.dead);
            let due = [slave, self.bench.shell.poll_timeout(), self.sent, self.words.front().map(|(at, ..)| *at)];
            let next = due.into_iter().flatten().min().unwrap_or(end).min(end);
            self.bench.pass(next.since(self.bench.now()));
            self.collect();
            if next == end {
                return;
            }
            self.step(next);
        }
    }

    fn step(&mut self, now: Instant) {
        while let Some((_, word, from_driver)) = self.words.front().copied().filter(|(at, ..)| *at <= now) {
            self.words.pop_front();
            if !from_driver {
                self.port(Input::Words(&[word]));
            } else if !self.dead {
                self.slave.handle_rx(now, &[word]);
            }
        }
        if self.sent.take_if(|sent| *sent <= now).is_some() {
            self.port(Input::Sent);
        }
        if self.dead {
            return;
        }
        if let Some(asked) = self.slave.poll_request() {
            let (status, data) = match asked.instruction {
                code if code == GET_VERSION.code => (Status::Ok, Version { major: 1, minor: 4 }.build().to_vec()),
                _ => (self.answer)(&mut self.board, now, &asked),
            };
            self.slave.respond(status, &data);
        }
        self.slave.handle_timeout(now);
        if let Some(words) = self.slave.poll_tx(now).map(|transmit| transmit.words.to_vec()) {
            self.put(now, &words, false);
        }
    }

    fn collect(&mut self) {
        for (at, action) in self.bench.done() {
            if let Action::Send(PORT, Output::Words(words)) = &action {
                self.put(at, words, true);
                self.sent = Some(at + word_time(115_200) * words.len() as u32);
            }
            self.log.push((at, action));
        }
    }

    /// Takes the messages of one kind since the last call, with their times.
    pub fn take<T>(&mut self, kind: impl Fn(&Message) -> Option<&T>) -> Vec<(Instant, T)>
    where
        T: Clone,
    {
        let mut taken = Vec::new();
        self.log.retain(|(at, action)| match action {
            Action::Publish(message) => kind(message).map(|found| taken.push((*at, found.clone()))).is_none(),
            _ => true,
        });
        taken
    }

    /// Reports, states and notes as an operator sees them.
    pub fn news(&mut self) -> String {
        let mut news = Vec::new();
        self.log.retain(|(_, action)| {
            match action {
                Action::Report(report) => {
                    news.push(format!("{:?} {} {}", report.severity, report.fault.name(), report.subject));
                }
                Action::State(state) => news.push(state.to_string()),
                Action::Note(_, line) => news.push(line.clone()),
                _ => return true,
            }
            false
        });
        news.join("\n")
    }
}
