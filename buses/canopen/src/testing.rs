//! A simulated wire between engines: in order, with latency, loss and duplication from a seed.

use crate::wire::TimeOfDay;
use crate::{Event, Master, Node, NodeEvent};
use base::can::{Frame, Id};
use base::{Duration, Instant};
use std::collections::VecDeque;
use std::string::String;
use std::vec::Vec;
use std::{assert_eq, format, panic};

pub(crate) use ::testing::Random;

/// A frame takes this long.
pub(crate) const LATENCY: Duration = Duration::from_micros(130);

/// One master, its nodes, and the wire between them.
pub(crate) struct Bus {
    pub(crate) now: Instant,
    pub(crate) master: Master,
    pub(crate) nodes: Vec<Node>,
    pub(crate) events: Vec<(Instant, Event)>,
    pub(crate) node_events: Vec<(Instant, u8, NodeEvent)>,
    /// Every frame that was sent, lost ones too.
    pub(crate) sent: Vec<(Instant, Frame)>,
    /// Of 1000 frames, lost and doubled.
    pub(crate) loss: u64,
    pub(crate) doubling: u64,
    /// The frame that is lost, by its number, the first one being 0.
    pub(crate) lost: Option<usize>,
    /// The node that the master does not hear, counted from 0.
    pub(crate) unheard: Option<usize>,
    /// True if senders get their own frames back.
    pub(crate) echo: bool,
    random: Random,
    /// When it arrives, who sent it (0: the master, n: node n - 1), what.
    wire: VecDeque<(Instant, usize, Frame)>,
}

impl Bus {
    pub(crate) fn new(master: Master, nodes: Vec<Node>) -> Self {
        Self {
            now: Instant::from_millis(1000),
            master,
            nodes,
            events: Vec::new(),
            node_events: Vec::new(),
            sent: Vec::new(),
            loss: 0,
            doubling: 0,
            lost: None,
            unheard: None,
            echo: false,
            random: Random::new(1),
            wire: VecDeque::new(),
        }
    }

    pub(crate) fn seed(&mut self, seed: u64) {
        self.random = Random::new(seed);
    }

    /// Takes what the engines have to say.
    pub(crate) fn drain(&mut self) {
        while let Some(frame) = self.master.poll_tx() {
            self.put(0, frame);
        }
        for at in 0..self.nodes.len() {
            while let Some(frame) = self.nodes[at].poll_tx() {
                self.put(at + 1, frame);
            }
            while let Some(event) = self.nodes[at].poll_event() {
                self.node_events.push((self.now, self.nodes[at].id(), event));
            }
        }
        while let Some(event) = self.master.poll_event() {
            self.events.push((self.now, event));
        }
    }

    /// Puts a frame on the wire, as sender `from`; `usize::MAX`: as somebody else.
    pub(crate) fn put(&mut self, from: usize, frame: Frame) {
        self.sent.push((self.now, frame));
        if self.lost == Some(self.sent.len() - 1) {
            return;
        }
        let copies = match self.random.below(1000) {
            draw if draw < self.loss => 0,
            draw if draw < self.loss + self.doubling => 2,
            _ => 1,
        };
        for _ in 0..copies {
            self.wire.push_back((self.now + LATENCY, from, frame));
        }
    }

    fn deadline(&self) -> Option<Instant> {
        let timers = self.nodes.iter().filter_map(Node::poll_timeout).chain(self.master.poll_timeout());
        timers.chain(self.wire.front().map(|(at, ..)| *at)).min()
    }

    /// Lets time pass until `until`.
    pub(crate) fn run_until(&mut self, until: Instant) {
        self.drain();
        let mut rounds = 0;
        while let Some(next) = self.deadline().filter(|next| *next <= until) {
            rounds = if next > self.now { 0 } else { rounds + 1 };
            assert!(rounds < 1000, "something is due at {next:?} for ever");
            self.now = self.now.max(next);
            self.step();
        }
        self.now = until;
    }

    fn step(&mut self) {
        while let Some((_, from, frame)) = self.wire.pop_front_if(|(at, ..)| *at <= self.now) {
            if (from != 0 || self.echo) && self.unheard.is_none_or(|node| from != node + 1) {
                self.master.handle_rx(self.now, &frame);
            }
            for at in 0..self.nodes.len() {
                if from != at + 1 || self.echo {
                    self.nodes[at].handle_rx(self.now, &frame);
                }
            }
            self.drain();
        }
        self.master.handle_timeout(self.now);
        for node in &mut self.nodes {
            node.handle_timeout(self.now);
        }
        self.drain();
    }

    pub(crate) fn run(&mut self, millis: u64) {
        self.run_until(self.now + Duration::from_millis(millis));
    }

    /// Runs until the master tells something that `is` likes; fails after `millis`.
    pub(crate) fn run_to(&mut self, millis: u64, is: impl Fn(&Event) -> bool) -> Instant {
        let from = self.events.len();
        let end = self.now + Duration::from_millis(millis);
        while self.now < end {
            if let Some((at, _)) = self.events[from..].iter().find(|(_, event)| is(event)) {
                return *at;
            }
            self.run(1);
        }
        panic!("not seen in {millis} ms; events: {:#?}", &self.events[from..]);
    }
}

/// What a transcript plays with.
pub(crate) trait Engine {
    fn input(&mut self, now: Instant, words: &[&str]);
    fn timeout(&mut self, now: Instant);
    fn outputs(&mut self) -> Vec<String>;
    fn deadline(&self) -> Option<Instant>;
}

/// Plays a transcript: `TIMEms > what the world does`, `TIMEms < what the engine answers`, `# remarks`. Frames are
/// written as `ID DATA`, in hexadecimal. Time jumps from deadline to deadline up to the last line's.
pub(crate) fn check(engine: &mut impl Engine, script: &str) {
    let lines = script.lines().filter_map(|line| line.split('#').next()).map(|line| {
        let words: Vec<_> = line.split_whitespace().collect();
        words.join(" ")
    });
    let expected: Vec<_> = lines.filter(|line| !line.is_empty()).collect();
    let mut actual = Vec::new();
    for line in &expected {
        let (time, rest) = line.split_once("ms ").expect("a line begins with its time");
        let until = Instant::from_millis(time.parse().expect("milliseconds"));
        let input = rest.strip_prefix("> ");
        // What is due at the moment of an input comes before it; what an output awaits, by then.
        play(engine, until, &mut actual);
        if let Some(input) = input {
            actual.push(line.clone());
            engine.input(until, &input.split(' ').collect::<Vec<_>>());
            engine.timeout(until);
            tell(engine, until, &mut actual);
        }
    }
    assert_eq!(actual.join("\n"), expected.join("\n"));
}

fn play(engine: &mut impl Engine, until: Instant, actual: &mut Vec<String>) {
    for _ in 0..10_000 {
        let Some(next) = engine.deadline().filter(|next| *next <= until) else {
            return;
        };
        engine.timeout(next);
        tell(engine, next, actual);
    }
    panic!("something is due for ever");
}

fn tell(engine: &mut impl Engine, now: Instant, actual: &mut Vec<String>) {
    let millis = now.as_nanos() / 1_000_000;
    actual.extend(engine.outputs().into_iter().map(|output| format!("{millis}ms < {output}")));
}

/// A frame of a transcript; `R` in place of its data: a remote frame that asks for one byte.
pub(crate) fn parse(words: &[&str]) -> Frame {
    let id = u16::from_str_radix(words[0], 16).expect("an identifier");
    if words[1..] == ["R"] {
        return Frame::standard_remote(id, 1);
    }
    let data: Vec<_> = words[1..].iter().map(|word| u8::from_str_radix(word, 16).expect("a byte")).collect();
    Frame::new(Id::Standard(id), &data).expect("a frame")
}

fn print(frame: &Frame) -> String {
    let Id::Standard(id) = frame.id() else { panic!("29 bits") };
    let mut text = format!("{id:03X}");
    if frame.is_remote() {
        text += " R";
    }
    for byte in frame.data() {
        text += &format!(" {byte:02X}");
    }
    text
}

impl Engine for Node {
    /// `on`, `set INDEX SUB VALUE`, or a frame.
    fn input(&mut self, now: Instant, words: &[&str]) {
        let number = |word: &str| u16::from_str_radix(word, 16).expect("a number");
        match words {
            ["on"] => self.power_on(now),
            ["set", index, sub, value] => {
                self.set(number(index), number(sub) as u8, value.parse().expect("a value"));
            }
            frame => self.handle_rx(now, &parse(frame)),
        }
    }

    fn timeout(&mut self, now: Instant) {
        self.handle_timeout(now);
    }

    fn outputs(&mut self) -> Vec<String> {
        let mut all = Vec::new();
        while let Some(frame) = self.poll_tx() {
            all.push(print(&frame));
        }
        while let Some(event) = self.poll_event() {
            all.push(match event {
                NodeEvent::ObjectWritten { index, sub } => format!("written {index:04X} {sub}"),
                NodeEvent::NmtState(state) => format!("state {state:?}"),
                NodeEvent::HeartbeatLost { node } => format!("lost {node}"),
                NodeEvent::HeartbeatBack { node } => format!("back {node}"),
                NodeEvent::ResetApplication => String::from("reset"),
                NodeEvent::PdoTooShort { number } => format!("short {number}"),
                NodeEvent::PdoTooLong { number } => format!("long {number}"),
                NodeEvent::PdoLate { number } => format!("late {number}"),
                NodeEvent::GuardLost => String::from("guard lost"),
                NodeEvent::GuardBack => String::from("guard back"),
                NodeEvent::Time(TimeOfDay { millis, days }) => format!("time {days} {millis}"),
                NodeEvent::BitRate(rate) => format!("rate {rate:?}"),
                NodeEvent::LssStored { node_id, bit_rate } => format!("stored {node_id:?} {bit_rate:?}"),
            });
        }
        all
    }

    fn deadline(&self) -> Option<Instant> {
        self.poll_timeout()
    }
}

impl Engine for Master {
    /// A frame.
    fn input(&mut self, now: Instant, words: &[&str]) {
        self.handle_rx(now, &parse(words));
    }

    fn timeout(&mut self, now: Instant) {
        self.handle_timeout(now);
    }

    fn outputs(&mut self) -> Vec<String> {
        let mut all = Vec::new();
        while let Some(frame) = self.poll_tx() {
            all.push(print(&frame));
        }
        while let Some(event) = self.poll_event() {
            all.push(match event {
                Event::Booted { node } => format!("booted {node}"),
                Event::BootFailed { node, step, reason } => {
                    format!("failed {node} {step}: {reason}")
                }
                Event::Lost { node, reason } => format!("lost {node}: {reason}"),
                other => format!("{other:?}"),
            });
        }
        all
    }

    fn deadline(&self) -> Option<Instant> {
        self.poll_timeout()
    }
}
