//! The simulator in the virtual host, with a scripted driver.

use crate::host::{self, News, Virtual};
use base::can::Frame;
use base::serial::Word;
use base::{Duration, Instant, Ticker};
use messages::{Message, simulation};
use module::{Actions, Event, Input, Line, Module, PortId, PortSpec, Shell, ShellConfig, State};
use navitools::Pose;
use rs485::crc::Crc8;
use simulator::boards::icla::Gearing;
use simulator::boards::sd1::Sd1Config;
use simulator::body::Parameters;
use simulator::world::World;
use simulator::{BoardConfig, BoardKind, CanConfig, Config, DriveConfig, DriveKind, SerialConfig, Simulator};
use std::cell::{Cell, RefCell};
use std::rc::Rc;

/// Initializes the propulsion, drives it at 0.5 m/s with a heartbeat of 50 ms, polls the odometry board at 4 Hz.
struct Script {
    ports: [PortSpec; 2],
    beat: Ticker,
    poll: Ticker,
    step: u32,
    ticks: Rc<Cell<i16>>,
    asked: Instant,
    round_trip: Rc<Cell<u64>>,
    told: Rc<RefCell<Vec<String>>>,
}

impl Script {
    fn frames(&mut self) -> Vec<Frame> {
        self.step += 1;
        let frame = |id, data: &[u8]| Frame::standard(id, data);
        let beat = frame(0x77F, &[5]);
        match self.step {
            3 => vec![beat, frame(0x601, &[0x2F, 0x60, 0x60, 0, 3, 0, 0, 0])],
            4 => vec![beat, frame(0x601, &[0x23, 0x16, 0x10, 1, 0xC8, 0, 0x7F, 0])],
            5 => vec![frame(0, &[1, 0]), beat],
            6 => vec![beat, frame(0x501, &[6, 0, 0, 0, 0, 0])],
            step if step > 6 => vec![beat, frame(0x501, &[0x0F, 0, 0xD9, 4, 0, 0])],
            _ => vec![beat],
        }
    }
}

impl Module for Script {
    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Port { input: Input::Words(words), .. } if words.len() == 9 => {
                self.ticks.set(i16::from_le_bytes([words[4].byte, words[5].byte]));
                self.round_trip.set(now.since(self.asked).as_nanos() as u64);
            }
            Event::Port { port: PortId(0), input: input @ (Input::Up | Input::Down(_) | Input::CanNotice(_)) } => {
                self.told.borrow_mut().push(format!("{} {input:?}", now.as_nanos() / 1_000_000));
            }
            Event::Timer => {
                if self.beat.due(now) {
                    self.frames().into_iter().for_each(|frame| out.send_can(PortId(0), frame));
                }
                if self.poll.due(now) {
                    self.asked = now;
                    let request = [0x01, 0x00, 0x00, 0x9C].map(Word::data);
                    out.send_words(PortId(1), &[&[Word::address(0x20)][..], &request].concat());
                }
            }
            _ => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Some(self.beat.next().min(self.poll.next()))
    }
}

struct Run {
    machine: Virtual,
    ticks: Rc<Cell<i16>>,
    round_trip: Rc<Cell<u64>>,
    truth: Rc<RefCell<simulation::DataTruth>>,
    /// Events of the script's CAN port apart from frames: ms, event.
    told: Rc<RefCell<Vec<String>>>,
}

fn config() -> Config {
    let board = BoardConfig { name: "so1".into(), address: 0x20, kind: BoardKind::So1 };
    let drive = |name: &str, node, kind| DriveConfig { name: name.into(), node, kind };
    let propulsion = drive("propulsion", 1, DriveKind::Epos { wheel: 0, gear: 26.0 });
    let steering = drive("steering", 2, DriveKind::Icla(Gearing::default()));
    let mut world = World::hall(400.0, 12.0);
    world.start = Pose::new(5.0, 6.0, 0.0);
    Config {
        world,
        can: Some(CanConfig {
            bus: "can.main".into(),
            bitrate: 1_000_000,
            drives: vec![propulsion, steering],
            output: None,
            devices: Vec::new(),
        }),
        serial: vec![SerialConfig {
            bus: "rs485.a".into(),
            baud: 115_200,
            crc: Crc8::SAE_J1850,
            real: false,
            boards: vec![board],
        }],
        ..Config::default()
    }
}

fn run(seed: u64) -> Run {
    run_in(seed, |_| {})
}

fn run_in(seed: u64, change: impl Fn(&mut Config) + 'static) -> Run {
    let (ticks, round_trip) = (Rc::new(Cell::new(0)), Rc::new(Cell::new(0)));
    let told = Rc::new(RefCell::new(Vec::new()));
    let inner = (ticks.clone(), round_trip.clone(), told.clone());
    let factory = move |name: &str, wanted| {
        let module: Box<dyn Module> = match name {
            "simulator" => {
                let mut config = Config { seed, ..config() };
                change(&mut config);
                Box::new(Simulator::new(config))
            }
            _ => Box::new(Script {
                ports: [
                    PortSpec { bus: "can.main".into(), line: Line::Can { bitrate: 1_000_000 } },
                    PortSpec { bus: "rs485.a".into(), line: Line::Serial { baud: 115_200 } },
                ],
                beat: Ticker::new(Instant::from_millis(50), Duration::from_millis(50)),
                poll: Ticker::new(Instant::from_millis(333), Duration::from_millis(250)),
                step: 0,
                ticks: inner.0.clone(),
                asked: Instant::ZERO,
                round_trip: inner.1.clone(),
                told: inner.2.clone(),
            }),
        };
        Ok(Shell::new(ShellConfig { wanted, ..ShellConfig::new(name) }, module))
    };
    let mut machine = Virtual::new(host::Config { seed, ..host::Config::default() }, factory);
    let truth = Rc::new(RefCell::new(simulation::DataTruth::default()));
    let seen = truth.clone();
    machine.observe(move |_, news| {
        if let News::Message { message: Message::SimDataTruth(new), .. } = news {
            *seen.borrow_mut() = new.clone();
        }
    });
    machine.spawn("simulator", State::Run).unwrap();
    machine.spawn("script", State::Run).unwrap();
    Run { machine, ticks, round_trip, truth, told }
}

#[test]
fn the_wires_time_is_counted_once() {
    let mut run = run(1);
    run.machine.run_until(Instant::from_millis(1000));
    // 5 and 9 words of 11 bits at 115200 Bd, and 200 us of the board between.
    assert_eq!(run.round_trip.get(), 477_430 + 859_375 + 200_000);
}

#[test]
fn it_drives_and_stops_when_its_master_dies_and_repeats_to_the_bit() {
    let go = |seed| {
        let mut run = run(seed);
        run.machine.run_until(Instant::from_millis(10_000));
        assert!((run.truth.borrow().speed - 0.5).abs() < 0.001, "{:?}", run.truth);
        let expected = ((run.truth.borrow().x - 5.0) * 4096.0 / (0.2 * core::f64::consts::PI)) as i64 as i16;
        assert!((run.ticks.get().wrapping_sub(expected)).abs() < 1000, "{} {expected}", run.ticks.get());
        let script = run.machine.pid("script").unwrap();
        run.machine.kill(script);
        run.machine.run_until(Instant::from_millis(10_140));
        assert!(run.truth.borrow().speed > 0.49, "the heartbeat is not yet missed");
        run.machine.run_until(Instant::from_millis(11_000));
        assert_eq!(run.truth.borrow().speed, 0.0);
        run.machine.digest()
    };
    let digest = go(1);
    assert!(digest == go(1) && digest != go(2));
}

fn fault(fault: &str, value: f64, duration: f64) -> simulation::CmdFault {
    simulation::CmdFault { timestamp: 0, target: "can.main".into(), fault: fault.into(), value, duration }
}

#[test]
fn a_master_that_is_bus_off_stops_the_robot_and_recovers() {
    let mut run = run(1);
    run.machine.inject(Instant::from_millis(10_000), fault("bus_off", 0.0, 0.5));
    run.machine.run_until(Instant::from_millis(10_140));
    assert!(run.truth.borrow().speed > 0.49, "the heartbeat is not yet missed");
    run.machine.run_until(Instant::from_millis(12_000));
    assert_eq!(run.truth.borrow().speed, 0.0);
    let health =
        |state: &str| format!("CanNotice(Health(Health {{ state: {state}, transmit_errors: 0, receive_errors: 0 }}))");
    // 100, 200 and 400 ms, and each time 1.408 ms of silence on the bus.
    let expected = [
        "20 Up".to_string(),
        format!("10000 {}", health("Off")),
        "10000 Down(\"bus-off\")".into(),
        "10704 Up".into(),
        format!("10704 {}", health("Active")),
    ];
    assert_eq!(*run.told.borrow(), expected);
    assert!(run.machine.traffic("can.main").unwrap().dropped > 0, "output sent in between");
}

#[test]
fn a_master_that_is_cut_off_detects_missing_acknowledgements() {
    let mut run = run(1);
    run.machine.inject(Instant::from_millis(10_000), fault("cut", 0.0, 0.3));
    run.machine.run_until(Instant::from_millis(11_000));
    assert_eq!(run.truth.borrow().speed, 0.0);
    let told = run.told.borrow();
    let position =
        |what: &str| told.iter().position(|line| line.contains(what)).unwrap_or_else(|| panic!("{what} {told:?}"));
    assert!(position("NoAcknowledge") < position("Passive, transmit_errors: 128"), "{told:?}");
    assert!(!told.iter().any(|line| line.contains("Down")), "{told:?}");
    // It is connected again: its counter decreases with the frame.
    assert!(told.last().unwrap().contains("Warning") || told.last().unwrap().contains("Active"), "{told:?}");
}

#[test]
fn noise_costs_time_and_no_frame() {
    let mut run = run(1);
    run.machine.inject(Instant::from_millis(1), fault("noise", 1e-3, 0.0));
    run.machine.run_until(Instant::from_millis(10_000));
    assert!((run.truth.borrow().speed - 0.5).abs() < 0.001, "{:?}", run.truth);
    let traffic = run.machine.traffic("can.main").unwrap();
    assert!(traffic.errors > 15 && traffic.dropped == 0, "{traffic:?}");
    assert!(run.told.borrow().iter().any(|line| line.contains("Errors(")), "{:?}", run.told);
}

#[test]
fn over_a_drop_the_board_cuts_the_motors_feed_without_the_host() {
    let mut run = run_in(1, |config| {
        let p = |x, y| navitools::Point { x, y };
        config.world.drops.push(vec![p(8.0, 0.0), p(9.0, 0.0), p(9.0, 12.0), p(8.0, 12.0)]);
        let front = Sd1Config { srfs: Vec::new(), irs: vec![p(0.9, 0.2), p(0.9, -0.2)] };
        let board = BoardConfig { name: "sd1_front".into(), address: 0x10, kind: BoardKind::Sd1(front) };
        config.serial[0].boards.push(board);
    });
    run.machine.run_until(Instant::from_millis(10_000));
    let truth = run.truth.borrow().clone();
    assert_eq!(truth.speed, 0.0);
    // The rangers see the edge at x = 7.1, two samples later it coasts: 0.72 m from 0.5 m/s.
    let coasting = 0.25 / (2.0 * Parameters::default().coasting());
    assert!((truth.x - 7.1 - coasting).abs() < 0.03, "{} {coasting}", truth.x);
}
