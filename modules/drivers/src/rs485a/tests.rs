//! The driver with emulated boards on a simulated wire in virtual time.

use super::*;
use base::serial::Word;
use messages::Message;
use messages::lowlevel::{DataBus, DataIrs, DataOdo, DataRanges, DataSrfs, Range, Reading};
use module::bench::Bench;
use module::{Action, Input, Output, Shell, ShellConfig, State};
use rs485::boards::{GET_VERSION, Version};
use rs485::frame::Status;
use rs485::slave::{self, Slave};
use rs485::word_time;
use settings::Section as _;
use std::collections::VecDeque;

const FRONT: u8 = sd1::FRONT;
const REAR: u8 = sd1::REAR;
const SO1: u8 = so1::ADDRESS;

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn config() -> Config {
    let node = |name: &str, address, kind, rate_hz| Node {
        name: name.into(),
        address,
        kind,
        rate_hz,
        timeout: ms(20),
        ..Node::usual()
    };
    let ranger = |id: u8, per_board: u8| Ranger {
        id,
        board: if id < per_board { FRONT } else { REAR },
        channel: id % per_board,
        x: f64::from(id),
        y: 0.5,
        theta: -1.0,
        beam: 0.96,
    };
    Config {
        bus: "rs485.a".into(),
        baud: 115_200,
        crc: rs485::crc::Crc8::SAE_J1850,
        nodes: vec![
            node("so1", SO1, Kind::So1, 20.0),
            node("sd1_front", FRONT, Kind::Sd1, 4.0),
            node("sd1_rear", REAR, Kind::Sd1, 4.0),
        ],
        // In reverse: the driver sorts them.
        srfs: (0..16).rev().map(|id| ranger(id, 8)).collect(),
        irs: (0..4).rev().map(|id| ranger(id, 2)).collect(),
        wheels: Wheels::default(),
    }
}

/// A board behind its slave: its measurements and its faults.
struct FakeBoard {
    slave: Slave,
    dead: bool,
    /// Answers this status instead of data.
    status: Status,
    srfs: sd1::Srfs,
    irs: sd1::Irs,
    /// Approaches a wall: its sonars fire in their slots and measure the distance at that time.
    approach: Option<Approach>,
    ticks: Vec<i16>,
    /// Ticks per second, from 0 at `driving_since`.
    speed: f64,
    driving_since: Instant,
    asked: Vec<u8>,
    /// Which floor sensor engages the PAUSE line, as it answers.
    pause: [u8; 1],
}

/// A robot that drives towards a wall that all its sonars face.
#[derive(Clone, Copy, Debug)]
struct Approach {
    /// Begin of the board's first slot.
    phase: Duration,
    /// Speed, m/s.
    speed: f64,
    /// Distance at time zero, m.
    from: f64,
}

impl Approach {
    /// Last finished slot of each channel at `now`, mm.
    fn srfs(&self, now: Instant) -> sd1::Srfs {
        let slots = now.since(Instant::ZERO + self.phase).as_nanos() / sd1::SLOT.as_nanos();
        let measure = |channel: u128| {
            let slot = (0..slots).rev().find(|slot| slot % 3 == channel % 3)?;
            let fired = self.phase + sd1::SLOT * slot as u32;
            Some((1000.0 * (self.from - self.speed * fired.as_secs_f64())).round() as u16)
        };
        (0..8).map(|channel| measure(channel).unwrap_or(sd1::NO_ECHO)).collect()
    }

    /// Time at which the sonar that measured this fired, s.
    fn fired(&self, distance: f64) -> f64 {
        (self.from - distance) / self.speed
    }
}

impl FakeBoard {
    fn new(address: u8) -> Self {
        Self {
            slave: Slave::new(slave::Config::new(address)),
            dead: false,
            status: Status::Ok,
            srfs: [1000; 8].into_iter().collect(),
            irs: [120, 121].into_iter().collect(),
            approach: None,
            ticks: vec![0, 0],
            speed: 0.0,
            driving_since: Instant::ZERO,
            asked: Vec::new(),
            pause: [0],
        }
    }

    fn answer(&mut self, now: Instant) {
        let Some(asked) = self.slave.poll_request() else {
            return;
        };
        self.asked.push(asked.instruction);
        let driven = (now.since(self.driving_since).as_secs_f64() * self.speed) as i64 as i16;
        let ticks = self.ticks.iter().map(|tick| tick.wrapping_add(driven)).collect();
        let srfs = self.approach.map_or_else(|| self.srfs.clone(), |approach| approach.srfs(now));
        let both = sd1::Both { srfs, irs: self.irs.clone() };
        match (asked.instruction, self.slave.config().address) {
            _ if self.status != Status::Ok => self.slave.respond(self.status, &[]),
            (code, _) if code == GET_VERSION.code => {
                self.slave.respond(Status::Ok, &Version { major: 1, minor: 4 }.build());
            }
            (code, SO1) if code == so1::GET_TICKS.code => {
                self.slave.respond(Status::Ok, &so1::build_ticks(&ticks));
            }
            (code, FRONT | REAR) if code == sd1::GET_BOTH_DATA.code => {
                self.slave.respond(Status::Ok, &both.build());
            }
            (code, FRONT | REAR) if code == sd1::CLEAR_PAUSE_SRC.code => {
                self.pause = [0];
                self.slave.respond(Status::Ok, &[]);
            }
            (code, FRONT | REAR) if code == sd1::GET_PAUSE_SRC.code => self.slave.respond(Status::Ok, &self.pause),
            _ => self.slave.respond(Status::UnknownInstruction, &[]),
        }
    }
}

struct Wire {
    bench: Bench,
    boards: [FakeBoard; 3],
    words: VecDeque<(Instant, Word, bool)>,
    sent: Option<Instant>,
    /// The port accepts output but never reports that it has left.
    port_stuck: bool,
    log: Vec<(Instant, Action)>,
}

impl Wire {
    /// Creates a wire whose port is closed.
    fn closed() -> Self {
        Self::with(config())
    }

    fn with(config: Config) -> Self {
        let module = Rs485a::new(config).unwrap();
        let shell = Shell::new(ShellConfig::new("driver_rs485a"), Box::new(module));
        let mut wire = Self {
            bench: Bench::new(shell),
            boards: [FRONT, REAR, SO1].map(FakeBoard::new),
            words: VecDeque::new(),
            sent: None,
            port_stuck: false,
            log: Vec::new(),
        };
        wire.bench.event(Event::Start);
        wire
    }

    fn open() -> Self {
        let mut wire = Self::closed();
        wire.port(Input::Up);
        wire
    }

    fn port(&mut self, input: Input<'_>) {
        self.bench.event(Event::Port { port: PORT, input });
        self.collect();
    }

    fn front(&mut self) -> &mut FakeBoard {
        &mut self.boards[0]
    }

    fn rear(&mut self) -> &mut FakeBoard {
        &mut self.boards[1]
    }

    fn so1(&mut self) -> &mut FakeBoard {
        &mut self.boards[2]
    }

    fn run(&mut self, duration: Duration) {
        let end = self.bench.now() + duration;
        loop {
            let slaves = self.boards.iter().filter(|board| !board.dead).filter_map(|board| board.slave.poll_timeout());
            let due = [self.bench.shell.poll_timeout(), self.sent, self.words.front().map(|(at, ..)| *at)];
            let next = slaves.chain(due.into_iter().flatten()).min().unwrap_or(end).min(end);
            self.bench.pass(next.since(self.bench.now()));
            self.collect();
            if next == end {
                return;
            }
            self.step(next);
        }
    }

    fn step(&mut self, now: Instant) {
        while let Some((_, word, from_master)) = self.words.front().copied().filter(|(at, ..)| *at <= now) {
            self.words.pop_front();
            if from_master {
                self.boards
                    .iter_mut()
                    .filter(|board| !board.dead)
                    .for_each(|board| board.slave.handle_rx(now, &[word]));
            } else {
                self.port(Input::Words(&[word]));
            }
        }
        if self.sent.take_if(|sent| *sent <= now).is_some() {
            self.port(Input::Sent);
        }
        for board in self.boards.iter_mut().filter(|board| !board.dead) {
            board.answer(now);
            board.slave.handle_timeout(now);
            if let Some(transmit) = board.slave.poll_tx(now) {
                let times = (1..).map(|n| now + word_time(115_200) * n);
                self.words.extend(times.zip(transmit.words).map(|(at, word)| (at, *word, false)));
            }
        }
    }

    fn collect(&mut self) {
        for (at, action) in self.bench.done() {
            if let Action::Send(PORT, Output::Words(words)) = &action {
                let times = (1..).map(|n| at + word_time(115_200) * n);
                self.words.extend(times.zip(words).map(|(at, word)| (at, *word, true)));
                self.sent = (!self.port_stuck).then(|| at + word_time(115_200) * words.len() as u32);
            }
            self.log.push((at, action));
        }
    }

    /// Takes the messages of one kind since the last call, with their times.
    fn take<T>(&mut self, kind: impl Fn(&Message) -> Option<T>) -> Vec<(Instant, T)> {
        let mut taken = Vec::new();
        self.log.retain(|(at, action)| match action {
            Action::Publish(message) => kind(message).map(|found| taken.push((*at, found))).is_none(),
            _ => true,
        });
        taken
    }

    fn odo(&mut self) -> Vec<(Instant, DataOdo)> {
        self.take(|message| if let Message::LlDataOdo(odo) = message { Some(odo.clone()) } else { None })
    }

    fn srfs(&mut self) -> Vec<(Instant, DataSrfs)> {
        self.take(|message| if let Message::LlDataSrfs(srfs) = message { Some(srfs.clone()) } else { None })
    }

    fn irs(&mut self) -> Vec<(Instant, DataIrs)> {
        self.take(|message| if let Message::LlDataIrs(irs) = message { Some(irs.clone()) } else { None })
    }

    fn ranges(&mut self) -> Vec<(Instant, DataRanges)> {
        self.take(|message| if let Message::LlDataRanges(ranges) = message { Some(ranges.clone()) } else { None })
    }

    fn bus(&mut self) -> Vec<(Instant, DataBus)> {
        self.take(|message| if let Message::LlDataBus(bus) = message { Some(bus.clone()) } else { None })
    }

    /// Reports and states as an operator sees them.
    fn news(&mut self) -> String {
        let mut news = Vec::new();
        for (_, action) in std::mem::take(&mut self.log) {
            match action {
                Action::Report(report) => {
                    news.push(format!("{:?} {} {}", report.severity, report.fault.name(), report.subject));
                }
                Action::State(state) => news.push(state.to_string()),
                Action::Note(_, line) => news.push(line),
                _ => {}
            }
        }
        news.join("\n")
    }

    /// Texts of the reports so far.
    fn texts(&self) -> Vec<String> {
        let texts = self.log.iter().filter_map(|(_, action)| match action {
            Action::Report(report) => Some(report.message.clone()),
            _ => None,
        });
        texts.collect()
    }

    fn command(&mut self, state: State) {
        self.bench.message(messages::common::CmdState {
            module: "driver_rs485a".into(),
            state: state as i8,
            manual: true,
            ..Default::default()
        });
        self.collect();
    }
}

fn valid(ranges: &[Range]) -> Vec<i32> {
    assert!(ranges.iter().all(|range| range.valid != range.distance.is_nan()));
    ranges.iter().filter(|range| range.valid).map(|range| range.id).collect()
}

#[test]
fn boards_release_the_pause_line_when_a_person_commands_run() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    let asked = |wire: &Wire| {
        wire.boards
            .each_ref()
            .map(|board| board.asked.iter().filter(|code| **code == sd1::CLEAR_PAUSE_SRC.code).count())
    };
    let mut command = |module: &str, state: State, manual| {
        let (module, source) = (module.into(), "test".into());
        wire.bench.message(messages::common::CmdState { timestamp: 0, module, state: state as i8, manual, source });
        wire.run(ms(300));
        asked(&wire)
    };
    assert_eq!(command("driver_rs485a", State::Run, false), [0, 0, 0], "a program has seen nothing");
    assert_eq!(command("planner", State::Run, true), [0, 0, 0]);
    assert_eq!(command("driver_rs485a", State::Run, true), [1, 1, 0]);
    assert_eq!(command("*", State::Run, true), [2, 2, 0]);
    let ranges =
        wire.log.iter().filter(|(_, action)| matches!(action, Action::Publish(Message::LlDataSrfs(_)))).count();
    assert!(ranges >= 6, "the rounds of ranges continue: {ranges}");
    assert!(!wire.log.iter().any(|(_, action)| matches!(action, Action::Report(_))));
}

/// The power controller's report of the PAUSE line each 500 ms, `times` times.
fn report_pause(wire: &mut Wire, engaged: bool, source: &str, times: u32) {
    for _ in 0..times {
        wire.bench.message(messages::lowlevel::EventStop { timestamp: 0, engaged, source: source.into() });
        wire.collect();
        wire.run(ms(500));
    }
}

#[test]
fn the_board_that_engages_pause_is_asked_for_the_corner_and_only_it_ends_the_report() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    wire.news();
    let asked = |wire: &Wire| {
        let asks = |board: &FakeBoard| board.asked.iter().filter(|code| **code == sd1::GET_PAUSE_SRC.code).count();
        wire.boards.each_ref().map(asks)
    };
    report_pause(&mut wire, false, "", 2);
    report_pause(&mut wire, true, "bumper1", 2);
    report_pause(&mut wire, true, "button", 2);
    assert_eq!(asked(&wire), [0, 0, 0], "no business of the boards");
    wire.front().pause = [2];
    report_pause(&mut wire, true, "sd1_front", 3);
    assert_eq!(asked(&wire), [3, 0, 0]);
    assert!(wire.texts().iter().any(|text| text.contains("no floor at the front right corner")), "{:?}", wire.texts());
    assert_eq!(wire.news(), "Warning FloorMissing sd1_front");
    // Another source is named now; the board still engages the line.
    report_pause(&mut wire, true, "button", 2);
    report_pause(&mut wire, false, "", 1);
    assert_eq!((asked(&wire), wire.news().as_str()), ([6, 0, 0], ""));
    wire.command(State::Run);
    report_pause(&mut wire, false, "", 2);
    assert_eq!(wire.news(), "Notice FloorMissing sd1_front");
    let known = asked(&wire);
    report_pause(&mut wire, false, "", 2);
    assert_eq!(asked(&wire), known, "nothing left to ask");
}

#[test]
fn a_flood_of_reports_asks_a_board_no_more_often_and_nonsense_of_it_is_dropped() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    wire.news();
    wire.rear().pause = [7];
    for _ in 0..1000 {
        let source = "sd1_rear".into();
        wire.bench.message(messages::lowlevel::EventStop { timestamp: 0, engaged: true, source });
        wire.collect();
        wire.run(ms(1));
    }
    let asked = wire.rear().asked.iter().filter(|code| **code == sd1::GET_PAUSE_SRC.code).count();
    assert_eq!(
        (asked, wire.news().as_str()),
        (1, "Warning BoardImplausible sd1_rear\nNotice BoardImplausible sd1_rear")
    );
    wire.rear().pause = [1];
    for _ in 0..1000 {
        let source = "sd1_front".into();
        wire.bench.message(messages::lowlevel::EventStop { timestamp: 0, engaged: true, source });
        wire.collect();
        wire.run(ms(1));
    }
    let asked = wire.front().asked.iter().filter(|code| **code == sd1::GET_PAUSE_SRC.code).count();
    assert!((2..=4).contains(&asked), "{asked}");
}

#[test]
fn it_asks_versions_and_runs() {
    let mut wire = Wire::open();
    wire.run(ms(100));
    let expected = "\
INIT
so1 (0x20 on rs485.a): firmware 1.4
RUN
sd1_front (0x10 on rs485.a): firmware 1.4
sd1_rear (0x11 on rs485.a): firmware 1.4";
    assert_eq!(wire.news(), expected);
    assert_eq!(wire.front().asked, [0xFE, 0x10]);
}

#[test]
fn ranges_come_four_times_a_second_all_of_them_in_order() {
    let mut wire = Wire::open();
    wire.front().srfs = [500, 0, 1500, 2000, 2500, 3000, 3500, 4000].into_iter().collect();
    wire.rear().irs = [255, 90].into_iter().collect();
    wire.run(ms(2000));
    let srfs = wire.srfs();
    assert_eq!(srfs.len(), 8);
    let (at, message) = &srfs[3];
    assert_eq!(message.srfs.iter().map(|range| range.id).collect::<Vec<_>>(), (0..16).collect::<Vec<_>>());
    assert_eq!(valid(&message.srfs).len(), 15);
    assert_eq!((message.srfs[0].distance, message.srfs[1].valid, message.srfs[2].distance), (0.5, false, 1.5));
    assert_eq!((message.srfs[9].x, message.srfs[9].y, message.srfs[9].theta), (9.0, 0.5, -1.0));
    assert_eq!(message.timestamp, (at.as_nanos() / 1000) as i64, "sent when the last board had answered");
    let irs = wire.irs();
    assert_eq!((irs.len(), valid(&irs[7].1.irs)), (8, vec![0, 1, 3]));
    assert_eq!(irs[7].1.irs[3].distance, 0.09);
    let between = srfs[5].0.since(srfs[4].0);
    assert!(between > ms(240) && between < ms(260), "{between:?}");
}

#[test]
fn odometry_comes_at_its_rate_in_metres() {
    let mut wire = Wire::open();
    wire.so1().speed = 3259.5;
    wire.run(ms(3000));
    let odo = wire.odo();
    assert!((58..=60).contains(&odo.len()), "{}", odo.len());
    let (at, last) = odo.last().unwrap();
    // 3259.5 ticks of 0.1534 mm in a second.
    let mean: f64 = odo.iter().map(|(_, odo)| odo.translation).sum::<f64>() / odo.len() as f64;
    assert!((mean - 0.5).abs() < 1e-3, "{mean}");
    assert!((last.path - 0.5 * 2.95).abs() < 0.01 && last.heading == 0.0, "{last:?}");
    assert_eq!(last.timestamp, (at.as_nanos() / 1000) as i64);
}

#[test]
fn a_dead_board_is_degraded_then_lost_and_asked_once_a_second() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    wire.news();
    wire.front().dead = true;
    wire.run(ms(5000));
    let (_, srfs) = wire.srfs().pop().unwrap();
    assert_eq!(valid(&srfs.srfs), (8..16).collect::<Vec<_>>());
    assert_eq!(wire.news(), "Warning BoardDegraded sd1_front\nError BoardLost sd1_front");
    wire.run(ms(5000));
    let srfs = wire.srfs();
    assert_eq!(srfs.len(), 20, "the other board's data continues");
    assert_eq!(wire.bus().last().unwrap().1.nodes[1].state, 2);
    // Polled once a second, without retries.
    let timeouts = |wire: &mut Wire| {
        wire.run(ms(4000));
        wire.bus().iter().map(|(_, bus)| bus.nodes[1].timeouts).collect::<Vec<_>>()
    };
    let timeouts = timeouts(&mut wire);
    assert!(timeouts.windows(2).all(|pair| pair[1] == pair[0] + 1), "{timeouts:?}");
    wire.news();
    wire.front().dead = false;
    wire.run(ms(2000));
    let (_, srfs) = wire.srfs().pop().unwrap();
    assert_eq!(valid(&srfs.srfs).len(), 16);
    let expected = "\
Notice BoardDegraded sd1_front
Notice BoardLost sd1_front
sd1_front (0x10 on rs485.a): firmware 1.4";
    assert_eq!(wire.news(), expected);
}

#[test]
fn all_boards_lost_is_an_error_and_one_that_is_back_ends_it() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    wire.boards.iter_mut().for_each(|board| board.dead = true);
    wire.run(ms(10_000));
    assert_eq!(wire.bench.shell.state(), State::Error);
    let (_, srfs) = wire.srfs().pop().unwrap();
    assert_eq!((valid(&srfs.srfs).len(), srfs.srfs.len()), (0, 16));
    wire.rear().dead = false;
    wire.run(ms(1100));
    assert_eq!(wire.bench.shell.state(), State::Run);
}

#[test]
fn a_bus_without_boards_is_an_error_once_they_are_lost() {
    let mut wire = Wire::open();
    wire.boards.iter_mut().for_each(|board| board.dead = true);
    wire.run(ms(500));
    assert_eq!(wire.bench.shell.state(), State::Init);
    wire.run(ms(10_000));
    assert_eq!(wire.bench.shell.state(), State::Error);
}

#[test]
fn a_port_that_goes_down_is_an_error_until_it_is_up_and_a_board_answers() {
    let mut wire = Wire::closed();
    wire.run(ms(500));
    assert_eq!(wire.bench.shell.state(), State::Init);
    wire.port(Input::Down("no such device"));
    assert_eq!(wire.bench.shell.state(), State::Error);
    assert_eq!(wire.texts(), ["rs485.a is down: no such device; retrying"]);
    wire.port(Input::Up);
    wire.run(ms(100));
    assert_eq!(wire.bench.shell.state(), State::Run);
    assert_eq!(wire.texts()[1..], ["rs485.a is up"]);
    wire.run(ms(10));
    wire.port(Input::Down("unplugged"));
    assert_eq!(wire.bench.shell.state(), State::Error);
    wire.words.clear();
    wire.sent = None;
    wire.log.clear();
    wire.run(ms(2500));
    assert!(
        wire.log.iter().all(|(_, action)| !matches!(action, Action::Send(..))),
        "nothing is sent into a closed port"
    );
    assert_eq!(wire.bus().last().unwrap().1.state, DataBus::CLOSED);
    wire.port(Input::Up);
    assert_eq!(wire.bench.shell.state(), State::Error);
    wire.run(ms(100));
    assert_eq!(wire.bench.shell.state(), State::Run);
    assert!(!wire.odo().is_empty(), "a gap of 2.5 s is bridged");
}

#[test]
fn nothing_is_polled_in_stop_and_everything_in_pause() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    wire.command(State::Pause);
    wire.run(ms(1000));
    assert_eq!(wire.srfs().len(), 8);
    wire.command(State::Stop);
    wire.run(ms(30));
    wire.boards.iter_mut().for_each(|board| board.asked.clear());
    wire.run(ms(5000));
    assert!(wire.boards.iter().all(|board| board.asked.is_empty()));
    assert_eq!(wire.bus().len(), 7, "statistics continue");
    wire.odo();
    wire.command(State::Run);
    wire.run(ms(15));
    assert_eq!(wire.odo().len(), 0, "after 5 s the counters restart");
    wire.run(ms(100));
    assert_eq!(wire.odo().len(), 2);
}

#[test]
fn a_port_lost_in_stop_leads_back_to_stop() {
    let mut wire = Wire::open();
    wire.run(ms(100));
    wire.command(State::Stop);
    wire.run(ms(100));
    wire.port(Input::Down("unplugged"));
    assert_eq!(wire.bench.shell.state(), State::Error);
    wire.run(ms(100));
    wire.port(Input::Up);
    wire.run(ms(100));
    assert_eq!(wire.bench.shell.state(), State::Stop);
}

#[test]
fn a_board_that_does_not_know_its_instruction_is_reported_once_and_cleared() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    wire.news();
    wire.rear().status = Status::UnknownInstruction;
    wire.run(ms(1000));
    let (_, srfs) = wire.srfs().pop().unwrap();
    assert_eq!(valid(&srfs.srfs), (0..8).collect::<Vec<_>>());
    wire.rear().status = Status::Ok;
    wire.run(ms(1000));
    assert_eq!(wire.news(), "Warning BoardRefused sd1_rear\nNotice BoardRefused sd1_rear");
}

#[test]
fn an_implausible_answer_is_dropped_and_reported_once() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    wire.news();
    wire.front().srfs[3] = 30_000;
    wire.so1().ticks.truncate(1);
    wire.run(ms(1000));
    let (_, srfs) = wire.srfs().pop().unwrap();
    assert_eq!(valid(&srfs.srfs), (8..16).collect::<Vec<_>>());
    wire.front().srfs[3] = 3000;
    wire.so1().ticks.push(0);
    wire.run(ms(1000));
    let mut news: Vec<String> = wire.news().lines().map(str::to_owned).collect();
    news.sort();
    let expected = [
        "Notice BoardImplausible sd1_front",
        "Notice BoardImplausible so1",
        "Warning BoardImplausible sd1_front",
        "Warning BoardImplausible so1",
    ];
    assert_eq!(news, expected);
}

#[test]
fn a_reset_of_the_odometry_board_makes_no_jump() {
    let mut wire = Wire::open();
    wire.so1().speed = 3259.5;
    wire.run(ms(5000));
    wire.news();
    let now = wire.bench.now();
    wire.so1().driving_since = now;
    wire.run(ms(1000));
    let odo = wire.odo();
    assert!(odo.iter().all(|(_, odo)| (odo.translation - 0.5).abs() < 0.02), "{odo:?}");
    assert!((odo.last().unwrap().1.path - odo[0].1.path - 0.45).abs() < 0.05);
    assert_eq!(wire.news(), "Warning BoardImplausible so1");
}

#[test]
fn repeated_counter_jumps_are_reported_every_ten_seconds_with_their_number() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    wire.news();
    for n in 0..400 {
        wire.so1().ticks = vec![if n % 2 == 0 { 9000 } else { 0 }; 2];
        wire.run(ms(50));
    }
    let texts = wire.texts();
    assert_eq!(texts.len(), 2, "{texts:?}");
    assert_eq!(texts[0], "so1 (0x20 on rs485.a) was reset: its counters jumped by 9000 and 9000; odometry goes on");
    assert!(texts[1].contains(", 200 times since the last report; ") && !texts[1].contains('\n'), "{texts:?}");
}

#[test]
fn a_port_that_does_not_send_is_reported_and_no_board_is_blamed() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    wire.news();
    wire.port_stuck = true;
    // The boards receive nothing of the stuck output.
    wire.boards.iter_mut().for_each(|board| board.dead = true);
    wire.run(ms(20_000));
    wire.port_stuck = false;
    wire.boards.iter_mut().for_each(|board| board.dead = false);
    wire.run(ms(1000));
    assert_eq!(wire.news(), "Warning PortOverrun rs485.a\nNotice PortOverrun rs485.a");
}

#[test]
fn statistics_come_once_a_second() {
    let mut wire = Wire::open();
    wire.run(ms(3500));
    let bus = wire.bus();
    assert_eq!(bus.len(), 3);
    let (at, bus) = bus.last().unwrap();
    assert_eq!(
        (bus.bus.as_str(), bus.state, bus.errors, at.as_nanos()),
        ("rs485.a", DataBus::ACTIVE, 0, 3_000_000_000)
    );
    let [so1, front, _] = &bus.nodes[..] else { panic!("three boards") };
    assert_eq!((so1.name.as_str(), so1.address, so1.state, so1.requests), ("so1", 0x20, 0, 61));
    // 5 words out, 200 us, 9 or 25 words back.
    assert!((so1.round_trip_min - 0.001_537).abs() < 2e-6, "{}", so1.round_trip_min);
    assert!((front.round_trip_max - 0.003_065).abs() < 2e-6, "{}", front.round_trip_max);
    // 20 x 14 and 8 x 30 words of 95.5 us.
    assert!((bus.load - 0.0497).abs() < 0.002, "{}", bus.load);
}

#[test]
fn rates_beyond_the_wire_s_limit_use_all_of_the_wire() {
    let mut config = config();
    config.nodes.iter_mut().for_each(|node| node.rate_hz = 10_000.0);
    let mut wire = Wire::with(config);
    wire.port(Input::Up);
    wire.run(ms(3000));
    let (_, bus) = wire.bus().pop().unwrap();
    // One round is 74 words, plus three times the boards' 200 us and two words of silence.
    let bound = 74.0 / (74.0 + 3.0 * (200.0 / 95.486 + 2.0));
    assert!(bus.load > 0.95 * bound, "{} of {bound}", bus.load);
    let requests: Vec<i64> = bus.nodes.iter().map(|node| node.requests).collect();
    assert!(requests.iter().max().unwrap() - requests.iter().min().unwrap() <= 1, "each has its turn: {requests:?}");
}

#[test]
fn an_invalid_configuration_is_rejected() {
    let refused = |change: fn(&mut Config)| {
        let mut config = config();
        change(&mut config);
        Rs485a::new(config).unwrap_err()
    };
    assert_eq!(refused(|config| config.nodes.clear()), ConfigError::Nodes(0));
    assert_eq!(refused(|config| config.nodes[2].address = FRONT), ConfigError::Twice("sd1_rear".into()));
    assert_eq!(refused(|config| config.nodes[1].kind = Kind::So1), ConfigError::Twice("sd1_front".into()));
    assert_eq!(refused(|config| config.nodes[0].rate_hz = f64::NAN), ConfigError::Rate("so1".into()));
    assert_eq!(refused(|config| config.irs[0].board = SO1), ConfigError::NoBoard(3));
    assert_eq!(refused(|config| config.wheels.track_m = 0.0), ConfigError::Wheels);
}

/// Words typed from `docs/facts/boards.md`: `!` marks the ninth bit.
fn words(text: &str) -> Vec<Word> {
    let word = |token: &str| match token.strip_suffix('!') {
        Some(byte) => Word::address(u8::from_str_radix(byte, 16).unwrap()),
        None => Word::data(u8::from_str_radix(token, 16).unwrap()),
    };
    text.split_whitespace().map(word).collect()
}

#[test]
fn the_wire_traffic_matches_the_documentation() {
    let mut config = config();
    config.nodes.truncate(2);
    config.srfs.retain(|ranger| ranger.board == FRONT);
    config.irs.retain(|ranger| ranger.board == FRONT);
    let shell = Shell::new(ShellConfig::new("driver_rs485a"), Box::new(Rs485a::new(config).unwrap()));
    let mut bench = Bench::new(shell);
    bench.start();
    let transcript = [
        ("20! fe 00 00 92", "20! fe 00 02 01 04 60"),
        ("10! fe 00 00 fd", "10! fe 00 02 01 04 5c"),
        ("20! 01 00 00 9c", "20! 01 00 04 01 00 ff ff 36"),
        ("10! 10 00 00 64", "10! 10 00 14 08 e8 03 00 00 2c 01 00 00 00 00 00 00 00 00 10 27 02 78 ff 27"),
        ("20! 01 00 00 9c", "20! 01 00 04 11 00 0f 00 35"),
    ];
    let mut published = Vec::new();
    for (asked, answer) in transcript {
        let mut sent = Vec::new();
        loop {
            for (_, action) in bench.done() {
                match action {
                    Action::Send(_, Output::Words(words)) => sent = words,
                    Action::Publish(message) => published.push(message),
                    _ => {}
                }
            }
            if !sent.is_empty() {
                break;
            }
            assert!(bench.step(bench.now() + ms(100)), "nothing is polled");
        }
        assert_eq!(sent, words(asked));
        bench.event(Event::Port { port: PORT, input: Input::Sent });
        bench.pass(ms(2));
        bench.words(PORT, &words(answer));
    }
    published.extend(bench.published());
    let srfs =
        published.iter().find_map(|message| if let Message::LlDataSrfs(srfs) = message { Some(srfs) } else { None });
    let distances: Vec<f64> = srfs.unwrap().srfs.iter().map(|range| range.distance).collect();
    assert_eq!((distances[0], distances[2], distances[7], distances[1].is_nan()), (1.0, 0.3, 10.0, true));
    let odo = published.iter().find_map(|message| if let Message::LlDataOdo(odo) = message { Some(odo) } else { None });
    // 16 ticks each in about 50 ms.
    assert_eq!((odo.unwrap().ticks_left, odo.unwrap().ticks_right), (16, 16));
    assert!((odo.unwrap().translation - 16.0 * 1.534e-4 / 0.05).abs() < 0.01);
}

/// A letter for each reading: measured, silent, unknown.
fn statuses(ranges: &DataRanges) -> String {
    let letter = |reading: &Reading| {
        assert_eq!(reading.distance.is_finite(), reading.status == Reading::MEASURED);
        match reading.status {
            Reading::MEASURED => 'm',
            Reading::SILENT => 's',
            _ => 'u',
        }
    };
    ranges.readings.iter().map(letter).collect()
}

#[test]
fn a_reading_is_measured_silent_or_unknown() {
    let mut wire = Wire::closed();
    wire.run(ms(1500));
    let before = wire.ranges();
    assert_eq!(before.len(), 2, "at the start and a second later");
    assert_eq!(statuses(&before[0].1), "uuuuuuuuuuuuuuuuuuuu");
    assert!(before[0].1.readings.iter().all(|reading| reading.timestamp == 0), "never measured");
    wire.port(Input::Up);
    wire.front().srfs = [500, 0, 1500, 2000, 0, 3000, 3500].into_iter().collect();
    wire.rear().irs = [255, 90].into_iter().collect();
    wire.run(ms(2000));
    let (at, last) = wire.ranges().pop().unwrap();
    // The front board has no channel 7.
    assert_eq!(statuses(&last), "msmmsmmummmmmmmmmmsm");
    assert_eq!(last.timestamp, (at.as_nanos() / 1000) as i64);
    let ids: Vec<(i8, i32)> = last.readings.iter().map(|reading| (reading.kind, reading.id)).collect();
    let of = |kind: i8, count: i32| (0..count).map(move |id| (kind, id));
    assert_eq!(ids, of(Reading::SONAR, 16).chain(of(Reading::INFRARED, 4)).collect::<Vec<_>>());
    let Reading { distance, x, y, theta, beam, .. } = last.readings[2];
    assert_eq!((distance, x, y, theta, beam), (1.5, 2.0, 0.5, -1.0, 0.96));
    // Fired 70 to 280 ms before the board was asked; the floor is measured 16.5 to 33 ms before.
    let age = |n: usize| (last.timestamp - last.readings[n].timestamp) as f64 / 1e3;
    assert!((age(2) - 175.0).abs() < 6.0 && (age(19) - 24.75).abs() < 6.0, "{} {}", age(2), age(19));
}

#[test]
fn ranges_of_a_failing_or_implausible_board_are_unknown_at_once() {
    let mut wire = Wire::open();
    wire.rear().srfs = [sd1::NO_ECHO; 8].into_iter().collect();
    wire.run(ms(2500));
    let before = wire.ranges().pop().unwrap().1;
    assert_eq!(statuses(&before), "mmmmmmmmssssssssmmmm");
    wire.front().dead = true;
    wire.run(ms(300));
    let after = wire.ranges().pop().unwrap().1;
    assert_eq!(statuses(&after), "uuuuuuuussssssssuumm", "one poll and its retries");
    assert_eq!(after.readings[0].timestamp, before.readings[0].timestamp, "when it was measured last");
    wire.run(ms(8000));
    assert_eq!(statuses(&wire.ranges().pop().unwrap().1), "uuuuuuuussssssssuumm", "lost");
    wire.front().dead = false;
    wire.front().srfs[3] = 30_000;
    wire.run(ms(3000));
    assert_eq!(statuses(&wire.ranges().pop().unwrap().1), "uuuuuuuussssssssuumm", "implausible");
}

#[test]
fn a_recovered_board_is_silent_only_after_a_sweep() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    wire.front().dead = true;
    wire.run(ms(1000));
    wire.ranges();
    wire.front().dead = false;
    wire.front().srfs = [900, 0, 0, 0, 0, 0, 0, 0].into_iter().collect();
    wire.run(ms(1000));
    let fronts: Vec<String> = wire.ranges().iter().map(|(_, ranges)| statuses(ranges)[..8].to_owned()).collect();
    assert_eq!(fronts, ["muuuuuuu", "msssssss", "msssssss", "msssssss"]);
}

#[test]
fn unknown_ranges_are_published_in_stop_and_without_a_port() {
    let mut wire = Wire::open();
    wire.run(ms(1000));
    wire.ranges();
    wire.command(State::Stop);
    let ranges = wire.ranges();
    assert_eq!(ranges.len(), 1);
    assert_eq!(statuses(&ranges[0].1), "u".repeat(20));
    wire.srfs();
    wire.run(ms(3500));
    assert_eq!((wire.ranges().len(), wire.srfs().len()), (3, 0), "each second; not in the view of 2011");
    wire.command(State::Run);
    wire.run(ms(1000));
    assert_eq!(statuses(&wire.ranges().pop().unwrap().1), "m".repeat(20));
    wire.port(Input::Down("unplugged"));
    assert_eq!(statuses(&wire.ranges().pop().unwrap().1), "u".repeat(20));
}

/// Maximum and root mean square error of the readings' instants, ms, at this rate, over all phases of the board's
/// slots, after `settle`.
fn instants(rate_hz: f64, settle: Duration) -> (f64, f64) {
    let (mut worst, mut squares, mut count) = (0.0f64, 0.0, 0.0);
    for phase in 0..21 {
        let mut config = config();
        config.nodes.iter_mut().filter(|node| node.kind == Kind::Sd1).for_each(|node| node.rate_hz = rate_hz);
        let mut wire = Wire::with(config);
        let approach = Approach { phase: ms(10 * phase), speed: 0.8, from: 8.0 };
        wire.front().approach = Some(approach);
        wire.port(Input::Up);
        wire.run(settle);
        wire.ranges();
        wire.run(ms(5000));
        for (_, ranges) in wire.ranges() {
            for reading in ranges.readings[..8].iter().filter(|reading| reading.status == Reading::MEASURED) {
                let off = 1e3 * (reading.timestamp as f64 / 1e6 - approach.fired(reading.distance));
                worst = worst.max(off.abs());
                squares += off * off;
                count += 1.0;
            }
        }
    }
    (worst, (squares / count).sqrt())
}

#[test]
fn each_reading_has_the_instant_at_which_its_sonar_fired_whatever_the_rate() {
    // At 4 Hz and below a whole sweep may have passed since, and nothing narrows the window.
    for rate in [2.0, 4.0] {
        let (worst, rms) = instants(rate, ms(1000));
        assert!(worst < 112.0 && rms < 68.0, "{rate} Hz: {worst:.1} ms at most, {rms:.1} ms");
    }
    for (rate, limits) in [(5.0, (100.0, 55.0)), (10.0, (20.0, 5.0)), (20.0, (10.0, 5.0))] {
        let (worst, rms) = instants(rate, ms(2000));
        assert!(worst < limits.0 && rms < limits.1, "{rate} Hz: {worst:.1} ms at most, {rms:.1} ms");
    }
}

#[test]
fn a_measurement_that_is_read_again_keeps_its_instant() {
    let mut config = config();
    config.nodes.iter_mut().for_each(|node| node.rate_hz = 20.0);
    let mut wire = Wire::with(config);
    wire.front().approach = Some(Approach { phase: ms(30), speed: 0.8, from: 8.0 });
    wire.port(Input::Up);
    wire.run(ms(5000));
    let read: Vec<(i64, f64)> =
        wire.ranges().iter().map(|(_, ranges)| (ranges.readings[0].timestamp, ranges.readings[0].distance)).collect();
    let read = &read[20..];
    assert!(read.windows(2).all(|pair| (pair[0].0 == pair[1].0) == (pair[0].1 == pair[1].1)), "{read:?}");
    assert!(read.is_sorted_by_key(|(at, _)| *at));
    let measured = read.windows(2).filter(|pair| pair[0].0 != pair[1].0).count();
    assert!((17..=21).contains(&measured), "once in 210 ms of 4 s: {measured}");
}

/// Numbers of polls of the front and of the rear board since the last call.
fn polls(wire: &mut Wire) -> [usize; 2] {
    let count = |board: &mut FakeBoard| {
        let asked = std::mem::take(&mut board.asked);
        asked.iter().filter(|code| **code == sd1::GET_BOTH_DATA.code).count()
    };
    [count(&mut wire.boards[0]), count(&mut wire.boards[1])]
}

/// The front board's sonars look ahead, those of the rear board back.
fn directed() -> Config {
    let mut config = config();
    for ranger in &mut config.srfs {
        ranger.theta = if ranger.board == FRONT { 0.4 } else { 2.7 };
    }
    config
}

fn motion(wire: &mut Wire, speed: f64, speed_target: f64) {
    wire.bench.message(DataMotion { speed, speed_target, ..DataMotion::default() });
    wire.collect();
}

#[test]
fn boards_that_look_in_the_direction_of_travel_are_polled_faster_and_published_at_once() {
    let mut wire = Wire::with(directed());
    wire.port(Input::Up);
    wire.run(ms(2000));
    polls(&mut wire);
    for (speed, target, expected) in [
        (0.0, 0.0, [8, 8]),
        (0.0, 0.3, [40, 20]),
        (0.3, 0.0, [40, 20]),
        (0.1, -0.3, [20, 40]),
        (-0.3, -0.3, [20, 40]),
        (0.01, 0.0, [8, 8]),
    ] {
        motion(&mut wire, speed, target);
        wire.run(ms(500));
        polls(&mut wire);
        wire.ranges();
        wire.srfs();
        wire.run(ms(2000));
        let [front, rear] = polls(&mut wire);
        let near = |count: usize, expected: usize| count.abs_diff(expected) <= 1;
        assert!(near(front, expected[0]) && near(rear, expected[1]), "{speed} {target}: {front} {rear}");
        let (ranges, srfs) = (wire.ranges().len(), wire.srfs().len());
        assert!(near(ranges, expected[0].max(expected[1])), "{speed} {target}: {ranges} messages");
        assert!(near(srfs, expected[0].min(expected[1])), "{speed} {target}: {srfs} of the view of 2011");
    }
}

#[test]
fn a_reading_arrives_sooner_while_the_robot_drives() {
    // Age of the newest reading of each front sonar when it arrives, ms: the greatest, and the mean.
    let ages = |drives: bool| {
        let (mut worst, mut sum, mut count) = (0.0f64, 0.0, 0.0);
        for phase in 0..21 {
            let mut wire = Wire::with(directed());
            let approach = Approach { phase: ms(10 * phase), speed: 0.8, from: 8.0 };
            wire.front().approach = Some(approach);
            wire.port(Input::Up);
            motion(&mut wire, 0.0, if drives { 0.8 } else { 0.0 });
            wire.run(ms(1500));
            wire.ranges();
            wire.run(ms(4000));
            let mut last: Option<[f64; 8]> = None;
            for (at, ranges) in wire.ranges() {
                let read: [f64; 8] = std::array::from_fn(|id| ranges.readings[id].distance);
                for (id, before) in last.replace(read).into_iter().flatten().enumerate() {
                    if read[id] != before {
                        let age = 1e3 * (at.as_nanos() as f64 / 1e9 - approach.fired(read[id]));
                        (worst, sum, count) = (worst.max(age), sum + age, count + 1.0);
                    }
                }
            }
        }
        (worst, sum / count)
    };
    let (standing, driving) = (ages(false), ages(true));
    assert!(driving.0 < 145.0 && driving.1 < 105.0, "{driving:?}");
    assert!(standing.0 > 270.0 && standing.1 > 160.0, "{standing:?}");
}

#[test]
fn with_the_leading_board_lost_the_other_one_is_published_on_its_own() {
    let mut wire = Wire::with(directed());
    wire.port(Input::Up);
    wire.run(ms(1000));
    motion(&mut wire, 0.5, 0.5);
    wire.front().dead = true;
    wire.run(ms(150));
    let last = wire.ranges().pop().unwrap().1;
    assert_eq!(statuses(&last), "uuuuuuuummmmmmmmuumm", "at once, after one poll and its retries");
    wire.run(ms(4000));
    let lost = "sd1_front (0x10 on rs485.a) does not answer: its data is invalid, polled once a second";
    assert!(wire.texts().iter().any(|text| text == lost), "{:?}", wire.texts());
    wire.ranges();
    wire.run(ms(2000));
    let ranges = wire.ranges();
    assert!(ranges.len() >= 19, "{} messages", ranges.len());
    assert!(ranges.iter().all(|(_, ranges)| statuses(ranges) == "uuuuuuuummmmmmmmuumm"));
    wire.front().dead = false;
    wire.run(ms(2000));
    assert_eq!(statuses(&wire.ranges().pop().unwrap().1), "m".repeat(20));
    polls(&mut wire);
    wire.run(ms(1000));
    assert_eq!(polls(&mut wire), [20, 10]);
}

#[test]
fn boards_in_different_phases_do_not_wait_for_each_other() {
    let mut wire = Wire::with(directed());
    wire.port(Input::Up);
    wire.run(ms(1000));
    // Different periods for a while, and a board that was away, leave the phases apart.
    for round in 0..20 {
        motion(&mut wire, 0.3, 0.3);
        // What it drives towards comes nearer.
        wire.front().srfs[0] -= 30;
        wire.rear().srfs[0] += 30;
        wire.run(ms(310 + 37 * round));
        wire.rear().dead = round % 3 == 0;
        motion(&mut wire, 0.0, 0.0);
        wire.run(ms(130));
        wire.rear().dead = false;
        wire.run(ms(600));
        wire.ranges();
        wire.run(ms(1000));
        let ranges = wire.ranges();
        let mut last = ranges[0].1.clone();
        for (at, message) in &ranges[1..] {
            let now = (at.as_nanos() / 1000) as i64;
            let oldest = last.readings.iter().map(|reading| now - reading.timestamp).max().unwrap_or_default();
            assert!(oldest < 570_000, "{round}: {oldest} us just before the next message");
            last = message.clone();
        }
    }
}

/// Drives at a measured speed, m/s, for a duration in ms.
fn drive(wire: &mut Wire, speed: f64, duration: u64) {
    for _ in 0..duration / 50 {
        motion(wire, speed, speed);
        wire.run(ms(50));
    }
}

#[test]
fn a_board_that_repeats_itself_while_the_robot_drives_is_implausible_until_it_measures_again() {
    let mut wire = Wire::with(directed());
    wire.port(Input::Up);
    wire.rear().srfs = [sd1::NO_ECHO; 8].into_iter().collect();
    wire.run(ms(2000));
    wire.news();
    // While the robot stands nothing changes, and silence says nothing.
    drive(&mut wire, 0.0, 5000);
    drive(&mut wire, -0.3, 450);
    assert_eq!(wire.news(), "");
    drive(&mut wire, -0.3, 700);
    let (_, ranges) = wire.ranges().pop().unwrap();
    assert_eq!(wire.news(), "Warning BoardImplausible sd1_front");
    let unknown = |reading: &&Reading| reading.status == Reading::UNKNOWN;
    assert!(ranges.readings.iter().filter(unknown).count() >= 8, "{}", statuses(&ranges));
    // It does not become plausible by standing still.
    drive(&mut wire, 0.0, 2000);
    assert_eq!(wire.news(), "");
    wire.front().srfs[2] = 990;
    drive(&mut wire, 0.0, 1000);
    let (_, ranges) = wire.ranges().pop().unwrap();
    assert_eq!(wire.news(), "Notice BoardImplausible sd1_front");
    assert_eq!(ranges.readings.iter().filter(unknown).count(), 0, "{}", statuses(&ranges));
}

#[test]
fn a_board_that_repeats_itself_is_plausible_while_the_speed_of_a_robot_at_rest_jitters() {
    let mut wire = Wire::with(directed());
    wire.port(Input::Up);
    wire.run(ms(1000));
    wire.news();
    for _ in 0..6000 {
        motion(&mut wire, 0.004, 0.0);
        wire.run(ms(50));
        motion(&mut wire, -0.004, 0.0);
        wire.run(ms(50));
    }
    assert_eq!(wire.news(), "", "10 minutes, 2.4 m of jitter");
}

#[test]
fn sonars_that_look_sideways_may_hear_a_wall_at_one_distance() {
    let mut config = directed();
    config.srfs.iter_mut().for_each(|ranger| ranger.theta = 1.57);
    let mut wire = Wire::with(config);
    wire.port(Input::Up);
    let wall = [1000, 1000, sd1::NO_ECHO, sd1::NO_ECHO];
    wire.front().srfs = wall.into_iter().collect();
    wire.rear().srfs = wall.into_iter().collect();
    wire.run(ms(2000));
    wire.news();
    drive(&mut wire, 0.5, 10_000);
    assert_eq!(wire.news(), "");
    // Three do not hear the same to the millimetre for more than a metre.
    wire.front().srfs = [1000, 1000, 1010, sd1::NO_ECHO].into_iter().collect();
    drive(&mut wire, 0.5, 1800);
    assert_eq!(wire.news(), "");
    drive(&mut wire, 0.5, 1000);
    assert_eq!(wire.news(), "Warning BoardImplausible sd1_front");
}

#[test]
fn a_board_whose_sonars_fall_silent_together_is_deaf_until_one_of_them_hears() {
    let silent: sd1::Srfs = [sd1::NO_ECHO; 8].into_iter().collect();
    for speed in [0.0, 0.3] {
        let mut wire = Wire::with(directed());
        wire.port(Input::Up);
        wire.rear().srfs.clone_from(&silent);
        wire.run(ms(1000));
        wire.news();
        wire.front().srfs.clone_from(&silent);
        drive(&mut wire, speed, 1000);
        let (_, ranges) = wire.ranges().pop().unwrap();
        assert_eq!(wire.news(), "Warning BoardImplausible sd1_front", "{speed}");
        let unknown = |reading: &&Reading| reading.status == Reading::UNKNOWN;
        assert!(ranges.readings.iter().filter(unknown).count() >= 8, "{}", statuses(&ranges));
        drive(&mut wire, speed, 60_000);
        assert_eq!(wire.news(), "", "silence proves nothing");
        wire.front().srfs[3] = 2000;
        drive(&mut wire, 0.0, 1000);
        let (_, ranges) = wire.ranges().pop().unwrap();
        assert_eq!(wire.news(), "Notice BoardImplausible sd1_front");
        assert_eq!(ranges.readings.iter().filter(unknown).count(), 0, "{}", statuses(&ranges));
    }
}

#[test]
fn sonars_lose_what_they_hear_one_after_the_other_and_a_single_sweep_may_miss_all_of_it() {
    let mut wire = Wire::with(directed());
    wire.port(Input::Up);
    wire.rear().srfs = [sd1::NO_ECHO; 8].into_iter().collect();
    wire.run(ms(1000));
    wire.news();
    for channel in [0, 3, 1, 6, 2, 7, 5, 4] {
        wire.front().srfs[channel] = sd1::NO_ECHO;
        drive(&mut wire, 0.3, 400);
    }
    // The open hall.
    drive(&mut wire, 0.3, 60_000);
    assert_eq!(wire.news(), "");
    wire.front().srfs = [1000; 8].into_iter().collect();
    drive(&mut wire, 0.3, 500);
    wire.front().srfs = [sd1::NO_ECHO; 8].into_iter().collect();
    drive(&mut wire, 0.3, 200);
    wire.front().srfs = [1000; 8].into_iter().collect();
    drive(&mut wire, 0.3, 400);
    assert_eq!(wire.news(), "");
}

#[test]
fn a_wall_may_leave_the_range_of_all_sonars_at_once() {
    let mut wire = Wire::with(directed());
    wire.port(Input::Up);
    wire.rear().srfs = [sd1::NO_ECHO; 8].into_iter().collect();
    wire.front().srfs = [5000, 5100, 5200, 5900, 5900, sd1::NO_ECHO].into_iter().collect();
    wire.run(ms(1000));
    wire.news();
    wire.front().srfs = [sd1::NO_ECHO; 8].into_iter().collect();
    drive(&mut wire, 0.3, 5000);
    assert_eq!(wire.news(), "");
}

#[test]
fn a_board_that_answers_no_more_and_then_hears_nothing_is_deaf_if_it_heard_before() {
    let mut wire = Wire::with(directed());
    wire.port(Input::Up);
    wire.run(ms(1000));
    wire.front().dead = true;
    wire.run(ms(5000));
    wire.front().dead = false;
    wire.front().srfs = [sd1::NO_ECHO; 8].into_iter().collect();
    wire.news();
    wire.run(ms(5000));
    assert!(wire.news().contains("Warning BoardImplausible sd1_front"));
}
