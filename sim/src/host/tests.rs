//! Two small modules, ping and pong, on LCM, CAN and a serial line.

use super::*;
use base::can::{Frame, frame_bits};
use base::{Fault, Severity, Ticker};
use messages::{Channel, simulation};
use module::{Line, Module, PortSpec, ShellConfig};
use std::cell::RefCell;

type Log = Rc<RefCell<Vec<String>>>;

/// Sends on all lines every 10 ms and records the replies, or replies to what it receives.
struct Player {
    ping: bool,
    ports: [PortSpec; 2],
    ticker: Ticker,
    count: u8,
    log: Log,
}

const CAN: PortId = PortId(0);
const SERIAL: PortId = PortId(1);

impl Player {
    fn new(ping: bool, log: Log) -> Self {
        let ports = [
            PortSpec { bus: "can.main".into(), line: Line::Can { bitrate: 1_000_000 } },
            PortSpec { bus: "rs485.a".into(), line: Line::Serial { baud: 115_200 } },
        ];
        let ticker = Ticker::new(Instant::from_millis(100), Duration::from_millis(10));
        Self { ping, ports, ticker, count: 0, log }
    }

    fn note(&self, now: Instant, what: &str) {
        let who = if self.ping { "ping" } else { "pong" };
        self.log.borrow_mut().push(format!("{:9} {who} {what}", now.as_nanos()));
    }
}

impl Module for Player {
    fn subscriptions(&self) -> &[Channel] {
        if self.ping { &[Channel::SimDataTruth] } else { &[Channel::SimDataClock] }
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => self.note(now, "start"),
            Event::Port { input: Input::Up, port: SERIAL } => out.working(),
            Event::Timer if self.ticker.due(now) && self.ping => {
                self.count += 1;
                let timestamp = out.timestamp(now);
                out.publish(simulation::DataClock { timestamp, rate: f64::from(self.count) });
                out.send_can(CAN, Frame::standard(0x100, &[self.count]));
                out.send_words(SERIAL, &[Word::address(self.count), Word::data(0)]);
            }
            Event::Message { at, message: Message::SimDataClock(clock), .. } => {
                self.note(now, &format!("clock {} from {}", clock.rate, at.as_nanos()));
                out.publish(simulation::DataTruth { timestamp: clock.timestamp, x: clock.rate, ..Default::default() });
            }
            Event::Message { message: Message::SimDataTruth(truth), .. } => {
                self.note(now, &format!("truth {}", truth.x));
            }
            Event::Port { input: Input::Can { frame, .. }, .. } => {
                self.note(now, &format!("frame {:?}", frame.data()));
                if !self.ping {
                    out.send_can(CAN, Frame::standard(0x101, frame.data()));
                }
            }
            Event::Port { input: Input::Words(words), .. } => {
                self.note(now, &format!("words {:?}", words.iter().map(|word| word.byte).collect::<Vec<_>>()));
                if !self.ping {
                    out.send_words(SERIAL, &[Word::data(words[0].byte)]);
                }
            }
            Event::Port { input: Input::Sent, .. } => self.note(now, "sent"),
            _ => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.ping.then_some(self.ticker.next())
    }
}

/// Starts other processes and records their news.
struct Parent {
    orders: Vec<ProcessCommand>,
    log: Log,
}

impl Module for Parent {
    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => self.orders.drain(..).for_each(|order| out.push(Action::Process(order))),
            Event::Process(news) => self.log.borrow_mut().push(format!("{:9} {news:?}", now.as_nanos())),
            _ => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

fn machine(config: Config) -> (Virtual, Log) {
    let log = Log::default();
    let inner = log.clone();
    let machine = Virtual::new(config, move |name, wanted| {
        let module: Box<dyn Module> = match name {
            "ping" => Box::new(Player::new(true, inner.clone())),
            "pong" => Box::new(Player::new(false, inner.clone())),
            "parent" => {
                let spawn = |module: &str| ProcessCommand::Spawn { module: module.into(), wanted: State::Run };
                Box::new(Parent { orders: vec![spawn("pong"), spawn("nobody")], log: inner.clone() })
            }
            other => return Err(format!("no module {other}")),
        };
        Ok(Shell::new(ShellConfig { wanted, ..ShellConfig::new(name) }, module))
    });
    (machine, log)
}

fn pair(config: Config) -> (Virtual, Log) {
    let (mut machine, log) = machine(config);
    assert_eq!(machine.spawn("ping", State::Run), Ok(1000));
    assert_eq!(machine.spawn("pong", State::Run), Ok(1001));
    (machine, log)
}

fn ms(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

#[test]
fn everything_takes_its_time_on_its_wire_to_the_nanosecond() {
    let (mut machine, log) = pair(Config::default());
    machine.run_until(ms(109));
    // CAN, 1 byte at 1 Mbit/s: 52 bits and the stuffed ones; a serial word is 11 bits at 115200 Bd (95486.1 ns).
    let there = u64::from(frame_bits(&Frame::standard(0x100, &[1]))) * 1000;
    let back = there + 3000 + u64::from(frame_bits(&Frame::standard(0x101, &[1]))) * 1000;
    let base = 100_000_000;
    let expected = [
        (20_000_000, "ping start".to_string()),
        (20_000_000, "pong start".to_string()),
        (base + 50_000, format!("pong clock 1 from {}", base + 50_000)),
        (base + there, "pong frame [1]".into()),
        (base + 100_000, "ping truth 1".into()),
        (base + back, "ping frame [1]".into()),
        (base + 190_972, "pong words [1, 0]".into()),
        (base + 190_972, "ping sent".into()),
        (base + 190_972 + 95_486, "ping words [1]".into()),
        (base + 190_972 + 95_486, "pong sent".into()),
    ];
    let expected = expected.map(|(at, what)| format!("{at:9} {what}"));
    let mut lines = log.borrow().clone();
    lines.sort();
    let mut expected_sorted = expected.to_vec();
    expected_sorted.sort();
    assert_eq!(lines, expected_sorted);
    assert!(log.borrow().is_sorted_by_key(|line| line[..9].to_string()), "in order of time");
}

#[test]
fn the_same_seed_gives_the_same_run_and_another_seed_another() {
    let run = |seed| {
        let jitter = Duration::from_micros(30);
        let (mut machine, log) = pair(Config { seed, lcm_jitter: jitter, lcm_loss: 0.1, ..Config::default() });
        machine.run_until(ms(2000));
        (machine.digest(), log.take())
    };
    let (one, again, other) = (run(1), run(1), run(2));
    assert!(one == again && one.0 != other.0 && one.1 != other.1);
}

#[test]
fn a_run_in_pieces_is_the_run_in_one() {
    let (mut whole, _) = pair(Config::default());
    whole.run_until(ms(1000));
    let (mut pieces, _) = pair(Config::default());
    for step in 1..=10_000 {
        pieces.run_until(Instant::from_nanos(step * 100_000));
    }
    assert_eq!(whole.digest(), pieces.digest());
}

#[test]
fn a_lost_message_is_lost_for_one_receiver() {
    let (mut machine, log) = pair(Config { lcm_loss: 1.0, ..Config::default() });
    machine.run_until(ms(500));
    assert!(!log.borrow().iter().any(|line| line.contains("clock") || line.contains("truth")));
    assert!(log.borrow().iter().any(|line| line.contains("frame")));
}

#[test]
fn the_frame_of_one_number_is_lost_and_no_other() {
    let (mut machine, log) = pair(Config { can_loss: Some(3), ..Config::default() });
    let lost = Log::default();
    let inner = lost.clone();
    machine.observe(move |_, news| {
        if let News::CanLost { bus, frame } = news {
            inner.borrow_mut().push(format!("{bus} {:?}", frame.data()));
        }
    });
    machine.run_until(ms(135));
    // The third frame is ping's second: 1, its answer, 2.
    assert_eq!(*lost.borrow(), ["can.main [2]"]);
    let heard: Vec<_> = log
        .borrow()
        .iter()
        .filter(|line| line.contains("frame"))
        .map(|line| line.trim_start().split_once(" ").unwrap().1.into())
        .collect();
    let expected = [1, 3, 4].map(|n| [format!("pong frame [{n}]"), format!("ping frame [{n}]")]).concat();
    assert_eq!((heard, machine.traffic("can.main").unwrap().sent), (expected, 7));
}

#[test]
fn a_hung_process_does_nothing_and_reads_its_input_afterwards() {
    let (mut machine, log) = pair(Config::default());
    machine.run_until(ms(105));
    machine.hang(1001);
    log.borrow_mut().clear();
    machine.run_until(ms(125));
    assert!(!log.borrow().iter().any(|line| line.contains("pong")), "{:?}", log.borrow());
    machine.resume(1001);
    let heard: Vec<_> = log.borrow().iter().filter(|line| line.contains("clock")).cloned().collect();
    assert_eq!(heard, ["125000000 pong clock 2 from 110050000", "125000000 pong clock 3 from 120050000"]);
}

#[test]
fn a_process_that_hangs_before_it_starts_starts_when_it_goes_on() {
    let (mut machine, log) = pair(Config::default());
    machine.hang(1001);
    machine.run_until(ms(30));
    assert_eq!(*log.borrow(), [" 20000000 ping start"]);
    machine.resume(1001);
    assert_eq!(log.borrow()[1], " 30000000 pong start");
}

#[test]
fn a_killed_process_is_gone_at_once_and_its_parent_is_informed() {
    let (mut machine, log) = machine(Config::default());
    machine.spawn("parent", State::Run).unwrap();
    machine.run_until(ms(50));
    let pong = machine.pid("pong").unwrap();
    machine.run_until(ms(60));
    machine.kill(pong);
    assert_eq!(machine.pid("pong"), None);
    machine.run_until(ms(70));
    let expected = [
        " 20000000 Started { module: \"pong\", pid: 1001 }",
        " 20000000 Unstartable { module: \"nobody\", reason: \"no module nobody\" }",
        " 40000000 pong start",
        " 60000000 HeartbeatStarted { pid: 1001 }",
        " 60100000 Exited { pid: 1001, status: Signal(9) }",
    ];
    assert_eq!(*log.borrow(), expected);
}

#[test]
fn a_terminated_process_ends_in_good_order() {
    let (mut machine, _) = pair(Config::default());
    let ended = Rc::new(RefCell::new(Vec::new()));
    let inner = ended.clone();
    machine.observe(move |at, news| {
        if let News::State { module, state } = news {
            inner.borrow_mut().push(format!("{} {module} {state}", at.as_nanos()));
        }
        if let News::Exited { pid, status, .. } = news {
            inner.borrow_mut().push(format!("{} {pid} {status:?}", at.as_nanos()));
        }
    });
    machine.run_until(ms(50));
    machine.terminate(1001);
    machine.run_until(ms(60));
    let expected = [
        "20000000 ping INIT",
        "20000000 ping RUN",
        "20000000 pong INIT",
        "20000000 pong RUN",
        "50000000 pong TERMINATE",
        "50000000 1001 Code(0)",
    ];
    assert_eq!(*ended.borrow(), expected);
    assert_eq!(machine.processes().collect::<Vec<_>>(), [(1000, "ping")]);
}

#[test]
fn a_message_from_the_test_comes_at_its_moment() {
    let (mut machine, log) = machine(Config::default());
    machine.spawn("pong", State::Run).unwrap();
    machine.inject(ms(42), simulation::DataClock { timestamp: 0, rate: 7.0 });
    machine.run_until(ms(50));
    assert_eq!(log.borrow()[1], " 42050000 pong clock 7 from 42050000");
}

#[test]
fn a_port_that_does_not_fit_its_bus_is_refused() {
    struct Odd([PortSpec; 1]);
    impl Module for Odd {
        fn ports(&self) -> &[PortSpec] {
            &self.0
        }
        fn handle(&mut self, _: Instant, _: Event<'_>, out: &mut Actions) {
            out.report(Severity::Notice, Fault::PortDown, "", "");
        }
        fn poll_timeout(&self) -> Option<Instant> {
            None
        }
    }
    let mut rate = 125_000;
    let mut machine = Virtual::new(Config::default(), move |name, _| {
        rate *= 2;
        let port = PortSpec { bus: "can.main".into(), line: Line::Can { bitrate: rate } };
        Ok(Shell::new(ShellConfig::new(name), Box::new(Odd([port]))))
    });
    assert!(machine.spawn("a", State::Run).is_ok());
    let refused = machine.spawn("b", State::Run).unwrap_err();
    assert_eq!(refused, "bus can.main is Can { bitrate: 250000 }, not Can { bitrate: 500000 }");
}

/// News of its child reported to the parent until `until`, with times in µs.
fn news_of_pong(until: u64, mut each: impl FnMut(&mut Virtual, u32)) -> Vec<String> {
    let (mut machine, log) = machine(Config::default());
    machine.spawn("parent", State::Run).unwrap();
    machine.run_until(ms(200));
    let pong = machine.pid("pong").unwrap();
    log.borrow_mut().clear();
    each(&mut machine, pong);
    machine.run_until(ms(until));
    log.take()
}

#[test]
fn a_served_process_has_heartbeats_and_a_hung_one_is_reported_every_20_ms() {
    let (mut machine, log) = machine(Config::default());
    machine.spawn("parent", State::Run).unwrap();
    machine.run_until(ms(60));
    assert_eq!(log.borrow()[3], " 60000000 HeartbeatStarted { pid: 1001 }");
    // Its heartbeats began at 40 ms; the last one is at 190 ms.
    let news = news_of_pong(330, Virtual::hang);
    let silent = |at: u64| format!("{at} HeartbeatLate {{ pid: 1001, thread: \"main\", last: 0.190000000 s }}");
    assert_eq!(news, [silent(300_000_000), silent(320_000_000)]);
    let news = news_of_pong(1000, |machine, pong| {
        machine.hang(pong);
        machine.run_until(ms(250));
        machine.resume(pong);
    });
    assert!(news.is_empty(), "{news:?}");
}

#[test]
fn a_hang_of_the_parent_is_not_charged_to_its_children() {
    let news = news_of_pong(1350, |machine, pong| {
        machine.hang(pong);
        machine.hang(1000);
        machine.run_until(ms(1250));
        machine.resume(1000);
    });
    // Its own check was late. The child's last heartbeat was 10 ms before, and is late by 100 ms at the check after 90
    // more.
    let late = "1340000000 HeartbeatLate { pid: 1001, thread: \"main\", last: 1.240000000 s }";
    assert_eq!(news, ["1250000000 CheckLate { by: 1.05s }", late]);
}

#[test]
fn a_parent_that_is_served_late_checks_the_heartbeats_late() {
    let late = |ms| news_of_pong(1000, move |machine, _| machine.crawl(1000, Duration::from_millis(ms)));
    assert!(late(99).is_empty());
    let news = late(100);
    assert!((5..=7).contains(&news.len()), "one in 120 to 140 ms: {news:?}");
    assert!(news.iter().all(|line| line.ends_with("CheckLate { by: 100ms }")), "{news:?}");
}

#[test]
fn a_slowed_process_is_served_late_in_order_with_rare_heartbeats() {
    let (mut machine, log) = pair(Config::default());
    machine.run_until(ms(105));
    machine.crawl(1001, Duration::from_millis(7));
    log.borrow_mut().clear();
    machine.run_until(ms(128));
    let pong: Vec<_> = log.borrow().iter().filter(|line| line.contains("pong")).cloned().collect();
    assert!(pong.iter().any(|line| *line == "117050000 pong clock 2 from 110050000"), "{pong:?}");
    assert!(pong.is_sorted_by_key(|line| line[..9].to_string()), "{pong:?}");
    // Normal again: pending events are not overtaken.
    machine.crawl(1001, Duration::from_millis(50));
    machine.run_until(ms(131));
    machine.crawl(1001, Duration::ZERO);
    log.borrow_mut().clear();
    machine.run_until(ms(300));
    let clocks: Vec<_> = log.borrow().iter().filter(|line| line.contains("pong clock")).cloned().collect();
    assert!(clocks[0].starts_with("180050000 pong clock 4"), "{clocks:?}");
    let order: Vec<u32> = clocks.iter().map(|line| line.split(' ').nth(3).unwrap().parse().unwrap()).collect();
    assert!(order.is_sorted() && order.len() > 10, "{order:?}");
    // A process with a latency of 100 ms has a heartbeat each 150 ms.
    let silent = news_of_pong(1000, |machine, pong| machine.crawl(pong, Duration::from_millis(100)));
    assert!(!silent.is_empty() && silent.iter().all(|line| line.contains("HeartbeatLate")));
    let silent = news_of_pong(1000, |machine, pong| machine.crawl(pong, Duration::from_millis(40)));
    assert!(silent.is_empty());
}

#[test]
fn a_supervised_process_is_restarted_with_back_off_and_adopts_the_living() {
    let (mut machine, log) = machine(Config { restart_delay_max: Duration::from_millis(150), ..Config::default() });
    let mut pid = machine.keep("parent").unwrap();
    machine.run_until(ms(100));
    let pong = machine.pid("pong").unwrap();
    let mut starts = Vec::new();
    for _ in 0..4 {
        let died = machine.now();
        machine.kill(pid);
        while machine.pid("parent").is_none() {
            machine.run_until(machine.now() + Duration::from_micros(100));
        }
        starts.push(machine.now().since(died).as_micros());
        pid = machine.pid("parent").unwrap();
        machine.run_until(machine.now() + Duration::from_millis(50));
    }
    assert_eq!(starts, [100, 100_100, 150_100, 150_100]);
    // This one starts another process each time, and adopts the latest.
    assert_eq!(machine.processes().filter(|(_, module)| *module == "pong").count(), 5);
    let earlier: Vec<String> = log
        .borrow()
        .iter()
        .filter(|line| line.contains("Earlier"))
        .map(|line| line.trim_start().split_once(" ").unwrap().1.into())
        .collect();
    let nobody = "Earlier { module: \"nobody\", wanted: Run, held: false, pid: None }".to_string();
    let found = |pid| format!("Earlier {{ module: \"pong\", wanted: Run, held: false, pid: Some({pid}) }}");
    assert_eq!(earlier[..4], [nobody.clone(), found(pong), nobody, found(pong + 2)]);
    // It ends normally: it is not restarted, and its children end by themselves.
    machine.terminate(pid);
    machine.run_until(machine.now() + Duration::from_millis(2900));
    assert_eq!(machine.processes().count(), 5);
    machine.run_until(machine.now() + Duration::from_millis(200));
    assert_eq!(machine.processes().count(), 0);
}

#[test]
fn children_end_themselves_if_their_parent_hangs_for_three_seconds() {
    let (mut machine, _) = machine(Config::default());
    machine.spawn("parent", State::Run).unwrap();
    machine.run_until(ms(1000));
    machine.hang(1000);
    machine.run_until(ms(3999));
    assert_eq!(machine.processes().count(), 2);
    machine.run_until(ms(4001));
    assert_eq!(machine.processes().collect::<Vec<_>>(), [(1000, "parent")]);
}

#[test]
fn a_clock_step_affects_processes_that_start_after_it() {
    let (mut machine, _) = pair(Config::default());
    let stamps = Rc::new(RefCell::new(Vec::new()));
    let inner = stamps.clone();
    machine.observe(move |at, news| {
        if let News::Message { message: Message::SimDataClock(clock), .. } = news {
            let zero = Config::default().epoch.timestamp(at);
            inner.borrow_mut().push(clock.timestamp - zero);
        }
    });
    machine.run_until(ms(105));
    machine.step_clock(-7_000_000);
    machine.run_until(ms(115));
    machine.kill(1000);
    machine.spawn("ping", State::Run).unwrap();
    machine.run_until(ms(145));
    assert_eq!(*stamps.borrow(), [0, 0, -7_000_000, -7_000_000]);
}

#[test]
fn a_disturbed_lcm_bus_loses_delays_repeats_and_reorders() {
    let heard = |fault: &str, value: f64| {
        let (mut machine, log) = pair(Config::default());
        assert!(machine.fault("lcm", fault, value, 1.0));
        machine.run_until(ms(2000));
        let clocks = log.borrow();
        let clocks = clocks.iter().filter(|line| line.contains("pong clock"));
        let clock = |line: &String| {
            let at: u64 = line[..9.min(line.find(" pong").unwrap())].trim().parse().unwrap_or(0);
            (at, line.split("clock ").nth(1).unwrap().split(' ').next().unwrap().parse::<u32>().unwrap())
        };
        clocks.map(clock).collect::<Vec<_>>()
    };
    let numbers = |heard: &[(u64, u32)]| heard.iter().map(|(_, number)| *number).collect::<Vec<_>>();
    let lossy = numbers(&heard("loss", 0.5));
    assert!((110..170).contains(&lossy.len()) && lossy.ends_with(&[189, 190]), "{}", lossy.len());
    let twice = numbers(&heard("duplicate", 0.5));
    assert!((210..260).contains(&twice.len()) && !twice.is_sorted_by(|a, b| a < b), "{}", twice.len());
    let late = heard("delay", 0.025);
    assert_eq!(late[0], (125_050_000, 1));
    assert!(numbers(&late).is_sorted_by(|a, b| a < b) && late.len() == 189 + 1);
    let mixed = heard("reorder", 0.05);
    assert!(!numbers(&mixed).is_sorted() && mixed.len() == 190);
}

#[test]
fn a_disturbed_wire_loses_delays_repeats_and_garbles() {
    let run = |bus: &str, fault: &str, value: f64| {
        let (mut machine, log) = pair(Config::default());
        machine.run_until(ms(50));
        let known = machine.fault(bus, fault, value, 0.5);
        machine.run_until(ms(599));
        let log = log.borrow();
        let heard = |what: &str| log.iter().filter(|line| line.contains(what)).count();
        (known, heard("pong frame"), heard("pong words"), heard("pong words [1, 0]"))
    };
    assert_eq!(run("can.main", "none", 0.0), (true, 50, 50, 1));
    let (known, frames, words, _) = run("can.main", "loss", 0.5);
    assert!(known && (20..35).contains(&frames) && words == 50, "{frames}");
    let (known, frames, _, _) = run("can.main", "duplicate", 1.0);
    assert!(known && frames == 50 + 45, "{frames}");
    let (known, frames, words, _) = run("rs485.a", "loss", 1.0);
    assert!(known && frames == 50 && words == 5, "{words}");
    let (known, _, words, right) = run("rs485.a", "noise", 0.5);
    assert!(known && words == 50 && right == 0);
    assert!(!run("rs485.a", "reorder", 0.1).0 && !run("rs485.a", "cut", 0.0).0 && !run("can.other", "noise", 0.0).0);
    assert!(!run("lcm", "noise", 0.1).0);
}

/// Reads a register repeatedly, without a pause.
struct Reader {
    ports: [PortSpec; 1],
    read: u32,
}

impl Module for Reader {
    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, _: Instant, event: Event<'_>, out: &mut Actions) {
        let Event::Port { port, input: Input::Up | Input::I2c(Ok(_)) } = event else { return };
        self.read += 1;
        out.transfer(port, read_register());
        out.note(self.read.to_string());
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

/// A chip whose register reads 0x29.
struct Chip([PortSpec; 1]);

impl Module for Chip {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::SimCmdFault]
    }

    fn ports(&self) -> &[PortSpec] {
        &self.0
    }

    fn handle(&mut self, _: Instant, event: Event<'_>, out: &mut Actions) {
        if let Event::Port { port, input: Input::I2cRequested(_) } = event {
            let read = base::i2c::Bytes::from_slice(&[0x29]).unwrap();
            out.push(Action::Send(port, Output::I2cAnswer(Ok(read))));
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

fn read_register() -> base::i2c::Transfer {
    let address = base::i2c::Address::new(0x18).unwrap();
    let write = base::i2c::Bytes::from_slice(&[0x00]).unwrap();
    base::i2c::Transfer { address, write, read: base::i2c::Read::Exactly(1) }
}

#[test]
fn a_register_is_read_as_often_as_the_wire_allows() {
    let port = || [PortSpec { bus: "i2c.aux".into(), line: Line::I2c { hz: 100_000 } }];
    let mut virt = Virtual::new(Config::default(), move |name, _| {
        let module: Box<dyn Module> = match name {
            "chip" => Box::new(Chip(port())),
            _ => Box::new(Reader { ports: port(), read: 0 }),
        };
        Ok(Shell::new(ShellConfig::new(name), module))
    });
    virt.spawn("chip", State::Run).unwrap();
    virt.spawn("reader", State::Run).unwrap();
    virt.run_until(Instant::from_millis(1020));
    // 40 clocks each: two STARTs, four bytes of nine, STOP and the pause after it.
    let bound = 100_000 / 40;
    let traffic = virt.traffic("i2c.aux").unwrap();
    assert!(traffic.sent * 100 >= bound * 95, "{} of {bound}", traffic.sent);
    assert_eq!((traffic.errors, traffic.dropped), (0, 0));
}
