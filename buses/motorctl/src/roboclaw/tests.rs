use super::device::Device as Board;
use super::wire::{self, Asked, Packet, Request};
use super::{Device, Model, RoboClaw};
use crate::motor::{Drive, Encoder};
use crate::{Axis, Config, ConfigError, Event, LostReason, Reaction, Refusal, State, Step};
use base::{Duration, Instant};
use std::vec::Vec;
use testing::Random;

const LEFT: Axis = Axis { gear: 20.0, velocity_max_radps: 10.0, acceleration_radps2: 20.0 };
const RIGHT: Axis = Axis { gear: -20.0, ..LEFT };
const DEVICE: Device = Device::EXAMPLE;
const STARTED: Duration = Duration::from_millis(500);

struct Bench {
    now: Instant,
    engine: RoboClaw,
    board: Board,
    events: Vec<(Instant, Event)>,
    sent: Vec<(Instant, Packet)>,
    cut: bool,
    target: Option<[f64; 2]>,
}

fn config() -> Config<2> {
    Config { second_way: true, ..Config::new([LEFT, RIGHT]) }
}

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

impl Bench {
    fn with(config: &Config<2>) -> Self {
        Self {
            now: Instant::from_millis(1000),
            engine: RoboClaw::new(config, DEVICE).unwrap(),
            board: Board::new(DEVICE),
            events: Vec::new(),
            sent: Vec::new(),
            cut: false,
            target: None,
        }
    }

    fn new() -> Self {
        Self::with(&config())
    }

    fn driving(target: [f64; 2]) -> Self {
        let mut bench = Self::new();
        bench.pass(STARTED);
        assert_eq!(bench.engine.state(), State::Ready, "{:?}", bench.events);
        bench.events.clear();
        bench.target = Some(target);
        bench.pass(ms(1000));
        for (axis, target) in target.into_iter().enumerate() {
            let measured = bench.engine.feedback(axis).unwrap().velocity_radps;
            assert!((measured - target).abs() < 0.01, "{axis}: {measured}");
        }
        bench
    }

    fn truth(&self) -> [f64; 2] {
        let velocity = |axis: usize, figures: Axis| self.board.motors[axis].velocity() / figures.turns_per_rad();
        [velocity(0, LEFT), velocity(1, RIGHT)]
    }

    fn step(&mut self) {
        self.now += ms(1);
        let now = self.now;
        self.engine.handle_timeout(now);
        self.board.handle_timeout(now);
        if let Some(target) = self.target.filter(|_| self.engine.state() == State::Ready) {
            let _ = self.engine.command(now, target);
        }
        while let Some(bytes) = self.board.poll_tx(now) {
            // In two parts: a port splits where it likes.
            let (first, second) = bytes.split_at(bytes.len() / 2);
            self.engine.handle_rx(now, first);
            self.engine.handle_rx(now, second);
        }
        while let Some(packet) = self.engine.poll_tx(now) {
            if !self.cut {
                self.board.handle_rx(now, &packet);
            }
            self.sent.push((now, packet));
        }
        while let Some(event) = self.engine.poll_event() {
            self.events.push((now, event));
        }
        assert!(self.engine.poll_timeout().is_none_or(|at| at > now), "due at {now:?}, after it was served");
    }

    fn pass(&mut self, duration: Duration) {
        let end = self.now + duration;
        while self.now < end {
            self.step();
        }
    }

    fn event(&self) -> &Event {
        &self.events.last().expect("an event").1
    }

    fn requests(&self) -> Vec<Request> {
        let decode = |(_, packet): &(Instant, Packet)| match Request::decode(DEVICE.address, packet) {
            Asked::Request(request) => request,
            other => panic!("{other:?}"),
        };
        self.sent.iter().map(decode).collect()
    }
}

#[test]
fn the_start_up_sets_the_time_limit_and_reads_it_back() {
    let mut bench = Bench::new();
    bench.pass(STARTED);
    assert_eq!(bench.event(), &Event::Ready { acted_after: None, reaction: Reaction::Stops });
    let expected = [
        Request::Version,
        Request::Drive([0; 2]),
        Request::Status,
        Request::SetTimeLimit(2),
        Request::TimeLimit,
        Request::Position(0),
        Request::Position(1),
        Request::Speed(0),
        Request::Speed(1),
    ];
    assert_eq!(bench.requests()[..expected.len()], expected);
    assert_eq!(bench.board.time_limit, 2);
}

#[test]
fn without_a_second_way_to_stop_it_is_refused() {
    let mut bench = Bench::with(&Config::new([LEFT, RIGHT]));
    bench.pass(STARTED);
    assert_eq!(bench.event(), &Event::Refused { step: Step::Silence, reason: Refusal::NotProvable });
    assert_eq!(bench.requests().last(), Some(&Request::Duty([0; 2])));
    assert!(bench.board.motors.iter().all(|motor| motor.drive == Drive::Free));
}

#[test]
fn velocities_and_positions_return_in_units_of_the_output() {
    let bench = Bench::driving([2.0, -3.0]);
    assert!(bench.board.motors.iter().all(|motor| motor.velocity() > 0.0), "one gear reverses");
    let feedback = [0, 1].map(|axis| *bench.engine.feedback(axis).unwrap());
    assert!(feedback[0].position_rad > 1.5 && feedback[1].position_rad < -2.0, "{feedback:?}");
    assert_eq!((feedback[0].supply_v, feedback[0].temperature_c), (24.0, 35.0));
    assert_eq!(feedback.map(|axis| axis.current_a), [0.5, 0.6]);
    assert_eq!(bench.engine.rejected(), 0);
}

#[test]
fn the_counter_wraps_without_a_jump_of_the_position() {
    let mut bench = Bench::new();
    bench.board.offset = i32::MAX - 8192;
    bench.target = Some([2.0, -2.0]);
    bench.pass(ms(2000));
    let positions = [0, 1].map(|axis| bench.engine.feedback(axis).unwrap().position_rad);
    assert!(positions[0] > 3.0 && positions[0] < 4.0, "{positions:?}");
    assert!((positions[0] + positions[1]).abs() < 0.1, "{positions:?}");
}

#[test]
fn a_stop_follows_the_ramp_and_a_quick_stop_does_not() {
    let mut bench = Bench::driving([4.0, 4.0]);
    bench.target = None;
    bench.engine.stop();
    bench.pass(ms(100));
    assert!(bench.truth().iter().all(|velocity| *velocity > 1.5 && *velocity < 3.0), "{:?}", bench.truth());
    let mut bench = Bench::driving([4.0, 4.0]);
    bench.engine.quick_stop();
    bench.pass(ms(180));
    assert!(bench.truth().iter().all(|velocity| velocity.abs() < 1e-3), "{:?}", bench.truth());
}

#[test]
fn when_the_engine_is_cut_off_the_device_stops_driving_within_its_limit() {
    let mut bench = Bench::driving([4.0, 4.0]);
    bench.cut = true;
    bench.pass(ms(180));
    assert!(bench.board.motors.iter().all(|motor| motor.drive != Drive::Free));
    bench.pass(ms(25));
    assert!(bench.board.motors.iter().all(|motor| motor.drive == Drive::Free));
}

#[test]
fn unplugged_at_speed_is_lost_within_100_ms() {
    let mut bench = Bench::driving([4.0, 4.0]);
    let since = bench.now;
    bench.board.faults.unplugged = true;
    bench.pass(ms(100));
    assert_eq!(bench.event(), &Event::Lost { reason: LostReason::Silent });
    assert!(bench.events[0].0.since(since) <= ms(100));
    bench.board.faults.unplugged = false;
    bench.pass(Duration::from_secs(15));
    assert!(matches!(bench.event(), Event::Ready { .. }), "{:?}", bench.events);
}

#[test]
fn answers_that_are_missing_or_damaged_are_a_loss() {
    for garbled in [false, true] {
        let mut bench = Bench::driving([1.0, 1.0]);
        (bench.board.faults.garbled, bench.board.faults.mute) = (garbled, !garbled);
        bench.pass(ms(100));
        assert_eq!(bench.event(), &Event::Lost { reason: LostReason::Silent });
        assert_eq!(bench.engine.rejected() > 0, garbled);
    }
}

#[test]
fn drive_commands_that_are_not_acknowledged_are_a_loss_although_reads_are_answered() {
    let mut bench = Bench::driving([1.0, 1.0]);
    bench.board.faults.deaf = true;
    bench.pass(ms(100));
    assert_eq!(bench.event(), &Event::Lost { reason: LostReason::Silent });
}

#[test]
fn another_model_is_refused_and_sent_no_command() {
    let mut bench = Bench::new();
    bench.board.model = Model::new("RoboClaw 2x30a v4.1.34").unwrap();
    bench.pass(STARTED);
    let found = b"RoboClaw 2x30a v4.1.34".iter().copied().collect();
    assert_eq!(bench.event(), &Event::Refused { step: Step::Identity, reason: Refusal::Identity { found } });
    assert_eq!(bench.requests(), [Request::Version]);
}

#[test]
fn an_absent_device_is_refused_once_and_tried_for_ever() {
    let mut bench = Bench::new();
    bench.board.faults.unplugged = true;
    bench.pass(Duration::from_secs(10));
    let refused = Event::Refused { step: Step::Contact, reason: Refusal::Silent };
    assert_eq!(bench.events.iter().map(|(_, event)| event).collect::<Vec<_>>(), [&refused]);
    assert!(bench.requests().iter().all(|request| *request == Request::Version));
    bench.board.faults.unplugged = false;
    bench.pass(ms(2000));
    assert_eq!(bench.engine.state(), State::Ready);
}

#[test]
fn a_time_limit_that_does_not_take_is_refused() {
    let mut bench = Bench::new();
    bench.board.faults.read_only = true;
    bench.board.time_limit = 10;
    bench.pass(STARTED);
    let reason = Refusal::TimeLimit { found: Duration::from_secs(1) };
    assert_eq!(bench.event(), &Event::Refused { step: Step::TimeLimit, reason });
}

#[test]
fn a_time_limit_that_is_reset_while_it_drives_is_a_loss() {
    let mut bench = Bench::driving([1.0, 1.0]);
    bench.board.time_limit = 0;
    bench.pass(ms(200));
    assert_eq!(bench.event(), &Event::Lost { reason: LostReason::TimeLimitChanged });
    bench.pass(ms(100));
    assert!(bench.truth().iter().all(|velocity| velocity.abs() < 1e-3), "the last command was zero");
}

#[test]
fn errors_of_the_status_are_a_loss_and_refuse_the_next_start() {
    let mut bench = Bench::driving([1.0, 1.0]);
    bench.board.raise(wire::M1_CURRENT_ERROR | 0x0001_0000);
    bench.pass(ms(60));
    let errors = wire::M1_CURRENT_ERROR;
    assert_eq!(bench.event(), &Event::Lost { reason: LostReason::Fault { errors } });
    bench.pass(ms(1500));
    assert_eq!(bench.event(), &Event::Refused { step: Step::Enable, reason: Refusal::Fault { errors } });
    bench.board.clear();
    bench.pass(ms(2000));
    assert_eq!(bench.engine.state(), State::Ready);
}

#[test]
fn encoders_that_are_dead_or_reversed_are_reported_as_they_count() {
    let mut bench = Bench::driving([2.0, 2.0]);
    bench.board.motors[0].encoder = Encoder::Dead;
    bench.board.motors[1].encoder = Encoder::Reversed;
    bench.pass(ms(100));
    let measured = [0, 1].map(|axis| bench.engine.feedback(axis).unwrap().velocity_radps);
    assert!(measured[0] == 0.0 && (measured[1] + 2.0).abs() < 0.01, "{measured:?}");
}

#[test]
fn disarm_sends_duty_zero_and_lasts_until_the_restart() {
    let mut bench = Bench::driving([4.0, 4.0]);
    bench.engine.disarm(bench.now);
    bench.pass(ms(2));
    assert_eq!(bench.requests().last(), Some(&Request::Duty([0; 2])));
    assert!(bench.board.motors.iter().all(|motor| motor.drive == Drive::Free));
    bench.pass(Duration::from_secs(20));
    assert_eq!((bench.engine.state(), bench.engine.poll_timeout()), (State::Off, None));
    bench.engine.restart(bench.now);
    bench.pass(STARTED);
    assert_eq!(bench.engine.state(), State::Ready);
}

#[test]
fn wrong_figures_of_the_device_are_refused() {
    let new = |config: &Config<2>, device| RoboClaw::new(config, device).map(|_| ());
    for device in [
        Device { address: 0x7F, ..DEVICE },
        Device { address: 0x88, ..DEVICE },
        Device { baud: 0, ..DEVICE },
        Device { counts_per_turn: [4096.0, f64::NAN], ..DEVICE },
    ] {
        assert_eq!(new(&config(), device), Err(ConfigError::Device));
    }
    let long = std::string::String::from_utf8(std::vec![b'a'; 47]).unwrap();
    assert!(Model::new("").is_none() && Model::new(&long).is_none() && Model::new(&long[1..]).is_some());
    let mut odd = config();
    odd.timing.time_limit = ms(150);
    assert_eq!(new(&odd, DEVICE), Err(ConfigError::TimeLimit));
}

#[test]
fn hostile_bytes_in_any_state_do_no_harm() {
    let mut random = Random::new(11);
    let mut bench = Bench::new();
    for n in 0..100_000_u32 {
        let len = random.index(4);
        let bytes: Vec<u8> = (0..len).map(|_| random.edge_byte()).collect();
        bench.engine.handle_rx(bench.now, &bytes);
        bench.board.handle_rx(bench.now, &bytes);
        if n % 8 == 0 {
            bench.step();
        }
    }
    assert!(bench.engine.rejected() > 0);
    bench.board = Board::new(DEVICE);
    bench.pass(Duration::from_secs(3));
    assert_eq!(bench.engine.state(), State::Ready, "{:?}", bench.events.last());
}
