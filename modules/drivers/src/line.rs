//! Common part of the EIA-485 drivers: periodic polls, versions, loss and return of boards, disturbances of the bus,
//! `LL_DATA_BUS` once a second. The meaning of the answers is up to each driver.
//!
//! Nothing is polled in STOP. The module works while at least one board answers: a lost one is reported, the loss of
//! all is an ERROR.

use base::{Duration, Fault, Instant, Severity, Ticker, earliest};
use messages::lowlevel::{DataBus, Node};
use module::{Actions, Input, PortId, PortSpec, State};
use rs485::boards::{GET_VERSION, Implausible, Instruction, Version};
use rs485::frame::Status;
use rs485::master::{self, Event, Master, NODES_MAX, Why};
use rs485::node::{Health, RoundTrips};
use rs485::schedule::{Schedule, Turn};
use rs485::{Data, word_time};
use std::mem;

/// The only port of such a driver.
pub(crate) const PORT: PortId = PortId(0);
/// Period of `LL_DATA_BUS`.
const STATISTICS_PERIOD: Duration = Duration::from_secs(1);

/// A board on the bus.
#[derive(Debug)]
pub(crate) struct Board {
    name: String,
    address: u8,
    /// All its instructions.
    table: &'static [Instruction],
    /// Periodic requests and their periods; the first one continues when the board is lost.
    polls: Vec<(Instruction, Duration)>,
    /// Has answered since the port came up.
    answered: bool,
    /// Number of consecutive answers with a refusal.
    refusals: u32,
    implausible: bool,
    /// Cause of its last failure, for people.
    last_failure: &'static str,
}

impl Board {
    pub fn new(name: &str, address: u8, table: &'static [Instruction], polls: Vec<(Instruction, Duration)>) -> Self {
        Self {
            name: name.into(),
            address,
            table,
            polls,
            answered: false,
            refusals: 0,
            implausible: false,
            last_failure: "",
        }
    }
}

/// Events on the bus that concern a driver.
#[derive(Debug)]
pub(crate) enum BusEvent {
    /// A board answered what it measured after `asked`.
    Answer { to: u8, instruction: u8, asked: Instant, data: Data },
    /// A request failed, which has been reported.
    Failed { to: u8, instruction: u8 },
    /// A lost board answers again; it may have lost its settings.
    Recovered,
    /// A board sent something unsolicited.
    Unsolicited { from: u8, instruction: u8, data: Data },
}

/// A bus and its boards.
#[derive(Debug)]
pub(crate) struct Line {
    bus: String,
    baud: u32,
    boards: Vec<Board>,
    master: Master,
    schedule: Schedule<NODES_MAX>,
    state: State,
    /// `None` until the host has reported the port.
    up: Option<bool>,
    /// A request could not be sent, and none was since.
    stuck: bool,
    /// Last result reported to the shell: true if it works.
    working: Option<bool>,
    statistics: Ticker,
    /// Words on the wire as of the last statistics.
    words: u64,
}

impl Line {
    /// Creates a bus that is not open yet; each board with its response timeout.
    pub fn new(bus: &str, config: master::Config, boards: Vec<(Board, Duration)>) -> Self {
        let mut master = Master::new(config);
        for (board, timeout) in &boards {
            master.add_node(board.address, *timeout);
        }
        Self {
            bus: bus.into(),
            baud: config.baud,
            boards: boards.into_iter().map(|(board, _)| board).collect(),
            master,
            schedule: Schedule::new(),
            state: State::Init,
            up: None,
            stuck: false,
            working: None,
            statistics: Ticker::new(Instant::NEVER, STATISTICS_PERIOD),
            words: 0,
        }
    }

    pub fn port(&self) -> PortSpec {
        PortSpec { bus: self.bus.clone(), line: module::Line::Serial { baud: self.baud } }
    }

    pub fn start(&mut self, now: Instant) {
        self.statistics = Ticker::new(now + STATISTICS_PERIOD, STATISTICS_PERIOD);
    }

    pub fn state(&self) -> State {
        self.state
    }

    pub fn set_state(&mut self, state: State) {
        self.state = state;
    }

    /// Processes an input of the port; `Some(true)` if it just came up, `Some(false)` if it went down.
    pub fn on_port(&mut self, now: Instant, input: &Input<'_>, out: &mut Actions) -> Option<bool> {
        match input {
            Input::Up => {
                out.clear(Fault::PortDown, self.bus.as_str(), format!("{} is up", self.bus));
                self.on_up(now);
                self.up
            }
            Input::Down(why) => {
                self.up = Some(false);
                let message = format!("{} is down: {why}; retrying", self.bus);
                out.raise(Severity::Error, Fault::PortDown, self.bus.as_str(), message);
                self.master.cancel();
                self.boards.iter_mut().for_each(|board| board.answered = false);
                self.up
            }
            Input::Words(words) => {
                self.master.handle_rx(now, words);
                None
            }
            Input::Sent => {
                self.master.handle_tx_done(now);
                None
            }
            Input::Can { .. }
            | Input::CanNotice(_)
            | Input::I2c(_)
            | Input::I2cRequested(_)
            | Input::OneWire(_)
            | Input::Thermal(_)
            | Input::Gamepad(_)
            | Input::Gpio(_)
            | Input::Store(_) => None,
        }
    }

    fn on_up(&mut self, now: Instant) {
        self.up = Some(true);
        self.schedule = Schedule::new();
        for Board { address, polls, .. } in &self.boards {
            for (instruction, period) in polls {
                self.schedule.poll(now, *period, Turn { to: *address, instruction: instruction.code });
            }
            if self.master.health(*address) == Health::Lost {
                self.schedule.lost(now, *address);
            }
            self.schedule.demand(version_of(*address));
        }
    }

    /// Serves the deadlines.
    pub fn on_timer(&mut self, now: Instant, out: &mut Actions) {
        self.master.handle_timeout(now);
        if self.statistics.due(now) {
            self.publish_statistics(now, out);
        }
    }

    /// Next event for the driver; called until `None`.
    pub fn poll_event(&mut self, now: Instant, out: &mut Actions) -> Option<BusEvent> {
        while let Some(event) = self.master.poll_event() {
            if let Some(heard) = self.on_event(now, event, out) {
                return Some(heard);
            }
        }
        None
    }

    fn on_event(&mut self, now: Instant, event: Event, out: &mut Actions) -> Option<BusEvent> {
        match event {
            Event::Reply { to, instruction, asked, status: Status::Ok, data } => {
                return self.on_answer(to, instruction, asked, data, out);
            }
            Event::Reply { to, instruction, status, .. } => {
                self.on_refusal(to, instruction, status, out);
                return Some(BusEvent::Failed { to, instruction });
            }
            Event::Silent { to, instruction } => {
                self.set_failure(to, "does not answer");
                return Some(BusEvent::Failed { to, instruction });
            }
            Event::Garbled { to, instruction, why } => {
                self.set_failure(to, damage(why));
                return Some(BusEvent::Failed { to, instruction });
            }
            Event::Unsent { to, instruction } => {
                self.stuck = true;
                let message = format!("{}: the port does not send; requests are dropped", self.bus);
                out.raise(Severity::Warning, Fault::PortOverrun, self.bus.as_str(), message);
                return Some(BusEvent::Failed { to, instruction });
            }
            Event::Unasked { from, instruction, data } => {
                return Some(BusEvent::Unsolicited { from, instruction, data });
            }
            Event::Sent { .. } => {}
            Event::Degraded { node } => {
                let (name, board) = self.name(node);
                let message = format!("{board} fails repeatedly: it {}; polled on", self.failure(node));
                out.raise(Severity::Warning, Fault::BoardDegraded, name, message);
            }
            Event::Recovered { node } => {
                let (name, board) = self.name(node);
                out.clear(Fault::BoardDegraded, name, format!("{board} answers properly again"));
            }
            Event::Lost { node } => {
                self.schedule.lost(now, node);
                let (name, board) = self.name(node);
                let message = format!("{board} {}: its data is invalid, polled once a second", self.failure(node));
                out.raise(Severity::Error, Fault::BoardLost, name, message);
            }
            Event::Back { node } => {
                self.schedule.back(now, node);
                self.schedule.demand(version_of(node));
                let (name, board) = self.name(node);
                out.clear(Fault::BoardDegraded, name.as_str(), format!("{board} answers properly again"));
                out.clear(Fault::BoardLost, name, format!("{board} answers again"));
                return Some(BusEvent::Recovered);
            }
            Event::Babble { who } => {
                let (subject, who) = self.culprit(who);
                let message = format!("{who} sends on {} unsolicited and disturbs the other boards", self.bus);
                out.raise(Severity::Error, Fault::BusBabble, subject, message);
            }
            Event::BabbleOver { who } => {
                let (subject, who) = self.culprit(who);
                out.clear(Fault::BusBabble, subject, format!("{who} no longer disturbs {}", self.bus));
            }
            Event::Clash { node, certain } => {
                let (name, board) = self.name(node);
                if certain {
                    let message = format!("{board}: two boards answer at this address");
                    out.raise(Severity::Error, Fault::AddressClash, name, message);
                } else {
                    // The failure is reported separately; this is a hint to its cause.
                    out.note(format!("{board}: two boards at this address send at once, or its transmitter is faulty"));
                }
            }
            Event::ClashOver { node } => {
                let (name, board) = self.name(node);
                out.clear(Fault::AddressClash, name, format!("{board}: one board answers again"));
            }
        }
        None
    }

    fn on_answer(
        &mut self,
        to: u8,
        instruction: u8,
        asked: Instant,
        data: Data,
        out: &mut Actions,
    ) -> Option<BusEvent> {
        let board = self.boards.iter_mut().find(|board| board.address == to)?;
        board.answered = true;
        if mem::take(&mut self.stuck) {
            out.clear(Fault::PortOverrun, self.bus.as_str(), format!("{}: the port sends again", self.bus));
        }
        if instruction == GET_VERSION.code {
            if let Some(version) = Version::parse(&data) {
                out.note(format!("{}: firmware {version}", self.name(to).1));
            }
            return None;
        }
        let refusals = mem::take(&mut board.refusals);
        if refusals > 0 {
            let (name, board) = self.name(to);
            let message = format!("{board} executes its instructions again, after {refusals} refusals");
            out.clear(Fault::BoardRefused, name, message);
        }
        Some(BusEvent::Answer { to, instruction, asked, data })
    }

    fn on_refusal(&mut self, to: u8, instruction: u8, status: Status, out: &mut Actions) {
        let Some(board) = self.boards.iter_mut().find(|board| board.address == to) else {
            return;
        };
        board.answered = true;
        let version = instruction == GET_VERSION.code;
        if !version {
            board.refusals = board.refusals.saturating_add(1);
        }
        let verb = if status == Status::UnknownInstruction { "does not know" } else { "could not do" };
        let (name, board) = self.name(to);
        let message = format!("{board} {verb} instruction {instruction:#04x}");
        if version {
            // Asked only once: there will be no answer that would clear it.
            out.report(Severity::Warning, Fault::BoardRefused, name, format!("{message}; its version stays unknown"));
        } else {
            let message = format!("{message}; polled on, its data is missing");
            out.raise(Severity::Warning, Fault::BoardRefused, name, message);
        }
    }

    /// Reports an implausible answer once, and its end; returns the value if plausible.
    pub fn judge<T>(&mut self, to: u8, result: Result<T, Implausible>, out: &mut Actions) -> Option<T> {
        let board = self.boards.iter_mut().find(|board| board.address == to)?;
        let stood = mem::replace(&mut board.implausible, result.is_err());
        match result {
            Ok(said) => {
                if stood {
                    let (name, board) = self.name(to);
                    out.clear(Fault::BoardImplausible, name, format!("{board} is plausible again"));
                }
                Some(said)
            }
            Err(why) => {
                let (name, board) = self.name(to);
                let message = format!("{board} gave an implausible answer: {why}; dropped");
                out.raise(Severity::Warning, Fault::BoardImplausible, name, message);
                None
            }
        }
    }

    fn set_failure(&mut self, address: u8, how: &'static str) {
        if let Some(board) = self.boards.iter_mut().find(|board| board.address == address) {
            board.last_failure = how;
        }
    }

    fn failure(&self, address: u8) -> &'static str {
        self.boards.iter().find(|board| board.address == address).map_or("", |board| board.last_failure)
    }

    /// Changes the period of a board's first poll.
    pub fn set_period(&mut self, now: Instant, address: u8, period: Duration) {
        let board = self.boards.iter_mut().find(|board| board.address == address);
        if let Some((instruction, current)) = board.and_then(|board| board.polls.first_mut()) {
            *current = period;
            self.schedule.set_period(now, Turn { to: address, instruction: instruction.code }, period);
        }
    }

    /// Queues a single request, sent when no poll is due.
    pub fn demand(&mut self, to: u8, instruction: &Instruction) {
        self.schedule.demand(Turn { to, instruction: instruction.code });
    }

    /// True if boards are polled: not in STOP, but in ERROR, to detect its end.
    fn asks(&self) -> bool {
        self.up == Some(true) && !matches!(self.state, State::Stop | State::Terminate)
    }

    /// Next request if the wire is free, to be sent by [`Line::ask`].
    pub fn turn(&mut self, now: Instant) -> Option<Turn> {
        if self.asks() && self.master.is_idle() { self.schedule.due(now) } else { None }
    }

    pub fn ask(&mut self, Turn { to, instruction }: Turn, data: &[u8]) {
        let board = self.boards.iter().find(|board| board.address == to);
        let known = board.and_then(|board| board.table.iter().find(|known| known.code == instruction));
        if let Some(instruction) = known {
            // Idle, and the data fits into a frame: never rejected.
            let _ = self.master.request(instruction.ask(to, data));
        }
    }

    /// Sends pending output, and reports to the shell whether the module works, if that changed.
    pub fn serve(&mut self, now: Instant, out: &mut Actions) {
        if let Some(transmit) = self.master.poll_tx(now) {
            out.send_words(PORT, transmit.words);
        }
        let lost = |board: &Board| self.master.health(board.address) == Health::Lost;
        let working = match self.up {
            None => return,
            Some(false) => false,
            Some(true) if self.boards.iter().any(|board| board.answered && !lost(board)) => true,
            Some(true) if self.boards.iter().all(lost) => false,
            Some(true) => return,
        };
        if self.working.replace(working) != Some(working) {
            if working { out.working() } else { out.failed() }
        }
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        let turn = if self.asks() && self.master.is_idle() { self.schedule.next() } else { None };
        earliest([self.master.poll_timeout(), turn, Some(self.statistics.next())])
    }

    pub fn is_lost(&self, address: u8) -> bool {
        self.master.health(address) == Health::Lost
    }

    /// Name of a board as the subject of reports, and for people with address and bus.
    pub fn name(&self, address: u8) -> (String, String) {
        let board = self.boards.iter().find(|board| board.address == address);
        let name = board.map_or("board", |board| &board.name);
        (name.to_owned(), format!("{name} ({address:#04x} on {})", self.bus))
    }

    /// Name of the source of a disturbance: a board, or unknown.
    fn culprit(&self, who: Option<u8>) -> (String, String) {
        who.map_or_else(|| (self.bus.clone(), "somebody".into()), |address| self.name(address))
    }

    fn publish_statistics(&mut self, now: Instant, out: &mut Actions) {
        let bus = self.master.bus_statistics();
        let busy = word_time(self.baud).as_secs_f64() * (bus.words - self.words) as f64;
        self.words = bus.words;
        let nodes = self.boards.iter().map(|board| node_message(&mut self.master, board)).collect();
        out.publish(DataBus {
            timestamp: out.timestamp(now),
            bus: self.bus.clone(),
            load: (busy / STATISTICS_PERIOD.as_secs_f64()).min(1.0),
            frames: count(bus.frames),
            errors: count(bus.errors),
            state: if self.up == Some(true) { DataBus::ACTIVE } else { DataBus::CLOSED },
            nodes,
        });
    }
}

const fn version_of(address: u8) -> Turn {
    Turn { to: address, instruction: GET_VERSION.code }
}

const fn damage(why: Why) -> &'static str {
    match why {
        Why::Crc => "answers with a wrong CRC",
        Why::Length { .. } => "answers with a wrong length",
        Why::Status { .. } => "answers with an invalid status",
        Why::Incomplete => "answers with an incomplete frame",
        Why::Request => "finds a wrong CRC in its request",
    }
}

fn node_message(master: &mut Master, board: &Board) -> Node {
    let recent = master.take_recent(board.address);
    let health = master.health(board.address);
    let statistics = master.statistics(board.address).copied().unwrap_or_default();
    let seconds = |time: fn(&RoundTrips) -> Option<Duration>| time(&recent).map_or(f64::NAN, |time| time.as_secs_f64());
    Node {
        name: board.name.clone(),
        address: i32::from(board.address),
        state: health as i32,
        requests: count(statistics.requests),
        retries: count(statistics.retries),
        timeouts: count(statistics.timeouts),
        crc_errors: count(statistics.crc_errors),
        round_trip_min: seconds(RoundTrips::min),
        round_trip_mean: seconds(RoundTrips::mean),
        round_trip_max: seconds(RoundTrips::max),
    }
}

fn count(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}
