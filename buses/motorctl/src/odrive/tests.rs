use super::device::{Device as Drive, HEARTBEAT};
use super::wire::{Command, Message, Version, error};
use super::{Device, Odrive};
use crate::motor::Encoder;
use crate::{Axis, CommandError, Config, ConfigError, Event, LostReason, Reaction, Refusal, ReleaseError, State, Step};
use base::can::{Frame, Id};
use base::{Duration, Instant};
use std::vec::Vec;
use testing::Random;

const AXIS: Axis = Axis { gear: -8.0, velocity_max_radps: 10.0, acceleration_radps2: 20.0 };
const DEVICE: Device = Device { node: 3, ..Device::EXAMPLE };
/// Longer than a start-up.
const STARTED: Duration = Duration::from_secs(2);

struct Bench {
    now: Instant,
    engine: Odrive,
    drive: Drive,
    events: Vec<(Instant, Event)>,
    /// Frames of the engine, with their time.
    sent: Vec<(Instant, Frame)>,
    /// True if no frame of the engine arrives.
    cut: bool,
    /// Target, commanded each period.
    target: Option<f64>,
}

impl Bench {
    fn new() -> Self {
        let engine = Odrive::new(&Config::new([AXIS]), DEVICE).unwrap();
        let drive = Drive::new(DEVICE);
        let now = Instant::from_millis(1000);
        Self { now, engine, drive, events: Vec::new(), sent: Vec::new(), cut: false, target: None }
    }

    fn started() -> Self {
        let mut bench = Self::new();
        bench.pass(STARTED);
        assert_eq!(bench.engine.state(), State::Ready, "{:?}", bench.events);
        bench.events.clear();
        bench
    }

    fn driving(target: f64) -> Self {
        let mut bench = Self::started();
        bench.target = Some(target);
        bench.pass(Duration::from_secs(1));
        assert!((bench.velocity() - target).abs() < 0.01, "{}", bench.velocity());
        bench
    }

    fn velocity(&self) -> f64 {
        self.engine.feedback(0).unwrap().velocity_radps
    }

    /// True velocity of the output.
    fn truth(&self) -> f64 {
        self.drive.motor.velocity() / AXIS.turns_per_rad()
    }

    fn step(&mut self) {
        self.now += Duration::from_millis(1);
        let now = self.now;
        self.engine.handle_timeout(now);
        self.drive.handle_timeout(now);
        if let Some(target) = self.target.filter(|_| self.engine.state() == State::Ready) {
            let _ = self.engine.command(now, [target]);
        }
        while let Some(frame) = self.engine.poll_tx(now) {
            self.sent.push((now, frame));
            if !self.cut {
                self.drive.handle_rx(now, &frame);
            }
        }
        while let Some(frame) = self.drive.poll_tx() {
            self.engine.handle_rx(now, &frame);
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
}

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

#[test]
fn the_start_up_proves_the_watchdog_by_silence_before_anything_turns() {
    let mut bench = Bench::new();
    bench.pass(STARTED);
    let [(_, Event::Ready { acted_after: Some(after), reaction: Reaction::Disarms })] = &bench.events[..] else {
        panic!("{:?}", bench.events)
    };
    assert!(*after >= ms(200) && *after <= ms(200) + HEARTBEAT + ms(2), "{after:?}");
    assert_eq!(bench.drive.motor.turns(), 0.0);
    // Between the last command before the proof and the question for the cause the bus was silent.
    let cause = bench.sent.iter().position(|(_, frame)| *frame == Command::GetError.frame(3)).expect("asked");
    assert!(bench.sent[cause].0.since(bench.sent[cause - 1].0) >= ms(200));
}

#[test]
fn the_start_up_sends_these_commands() {
    let mut bench = Bench::new();
    bench.pass(STARTED);
    let names = |(_, frame): &(Instant, Frame)| Command::decode(frame).map(|(_, command)| command);
    let mut commands: Vec<Command> = bench.sent.iter().filter_map(names).collect();
    commands.dedup();
    let write = |endpoint, value| Command::Write { endpoint, value };
    let endpoints = DEVICE.endpoints;
    let expected = [
        Command::GetVersion,
        Command::SetInputVel(0.0),
        Command::SetAxisState(1),
        write(endpoints.watchdog_timeout, super::wire::Value::Float(0.2)),
        Command::Read { endpoint: endpoints.watchdog_timeout },
        write(endpoints.enable_watchdog, super::wire::Value::Bool(true)),
        Command::Read { endpoint: endpoints.enable_watchdog },
        Command::ClearErrors,
        Command::SetControllerMode { control: 1, input: 1 },
        Command::SetInputTorque(0.0),
        Command::SetAxisState(8),
    ];
    assert_eq!(commands[..expected.len()], expected);
    let rest: Vec<&Command> =
        commands[expected.len()..].iter().skip_while(|command| **command != Command::GetError).take(5).collect();
    let then = [
        Command::GetError,
        Command::ClearErrors,
        Command::SetControllerMode { control: 2, input: 1 },
        Command::SetInputVel(0.0),
        Command::SetAxisState(8),
    ];
    assert_eq!(rest, then.iter().collect::<Vec<_>>());
}

#[test]
fn velocity_and_position_return_in_units_of_the_output() {
    let bench = Bench::driving(2.0);
    assert!(bench.drive.motor.velocity() < 0.0, "the gear reverses");
    assert!((bench.truth() - 2.0).abs() < 1e-3);
    let feedback = bench.engine.feedback(0).unwrap();
    assert!(feedback.position_rad > 1.0 && feedback.position_rad < 2.0, "{feedback:?}");
    assert_eq!((feedback.supply_v, feedback.temperature_c, feedback.current_a), (24.0, 31.0, 0.5));
    assert_eq!(bench.engine.feedback(1), None);
    assert_eq!(bench.engine.rejected(), 0);
}

#[test]
fn a_stop_follows_the_ramp_and_a_quick_stop_does_not() {
    let mut bench = Bench::driving(4.0);
    bench.target = None;
    bench.engine.stop();
    bench.pass(ms(100));
    assert!(bench.truth() > 1.5 && bench.truth() < 3.0, "{}", bench.truth());
    bench.pass(ms(200));
    assert!(bench.truth().abs() < 1e-3);

    let mut bench = Bench::driving(4.0);
    bench.engine.quick_stop();
    bench.pass(ms(100));
    assert!(bench.truth().abs() < 1e-3, "{}", bench.truth());
    assert_eq!(bench.engine.command(bench.now, [1.0]), Err(CommandError::QuickStop));
    assert_eq!(bench.engine.release(bench.now), Ok(()));
    bench.pass(ms(500));
    assert!((bench.truth() - 4.0).abs() < 1e-3);
}

#[test]
fn a_quick_stop_is_not_released_while_the_axis_turns() {
    let mut bench = Bench::driving(4.0);
    bench.engine.quick_stop();
    assert_eq!(bench.engine.release(bench.now), Err(ReleaseError::Moving));
}

#[test]
fn a_caller_that_falls_silent_stops_the_axis() {
    let mut bench = Bench::driving(4.0);
    bench.target = None;
    bench.pass(ms(150));
    assert!((bench.truth() - 4.0).abs() < 1e-3);
    bench.pass(ms(350));
    assert!(bench.truth().abs() < 1e-3);
    assert_eq!(bench.engine.state(), State::Ready);
}

#[test]
fn of_a_bus_that_takes_nothing_only_the_newest_setpoint_waits() {
    let mut bench = Bench::driving(4.0);
    bench.engine.quick_stop();
    for _ in 0..60 {
        bench.now += ms(1);
        bench.engine.handle_timeout(bench.now);
    }
    let frames: Vec<Frame> = core::iter::from_fn(|| bench.engine.poll_tx(bench.now)).collect();
    let velocities = frames.iter().filter(|frame| **frame == Command::SetInputVel(0.0).frame(3)).count();
    assert_eq!(velocities, 1, "{frames:?}");
}

#[test]
fn commands_out_of_range_or_before_the_start_are_refused() {
    let mut bench = Bench::new();
    assert_eq!(bench.engine.command(bench.now, [0.0]), Err(CommandError::NotReady));
    bench.pass(STARTED);
    for wrong in [10.1, -10.1, f64::NAN] {
        assert_eq!(bench.engine.command(bench.now, [wrong]), Err(CommandError::OutOfRange { axis: 0 }));
    }
}

#[test]
fn when_the_engine_is_cut_off_the_device_disarms_within_its_limit() {
    let mut bench = Bench::driving(4.0);
    bench.cut = true;
    bench.pass(ms(180));
    assert!(bench.drive.is_armed());
    bench.pass(ms(25));
    assert!(!bench.drive.is_armed());
    bench.pass(HEARTBEAT);
    assert_eq!(bench.event(), &Event::Lost { reason: LostReason::TimeLimitActed });
    bench.pass(Duration::from_secs(20));
    assert!(bench.truth().abs() < 1e-3, "friction stops it");
}

#[test]
fn unplugged_at_speed_is_lost_within_100_ms() {
    let mut bench = Bench::driving(4.0);
    let since = bench.now;
    bench.drive.faults.unplugged = true;
    bench.pass(ms(100));
    let (at, event) = bench.events.last().unwrap();
    assert_eq!(event, &Event::Lost { reason: LostReason::Silent });
    assert!(at.since(since) <= ms(100), "{:?}", at.since(since));
    assert_eq!(bench.engine.command(bench.now, [1.0]), Err(CommandError::NotReady));
    // The drive stops by itself, and comes back from the first step on.
    bench.pass(ms(200));
    assert!(!bench.drive.is_armed());
    bench.drive.faults.unplugged = false;
    bench.pass(Duration::from_secs(10));
    assert!(matches!(bench.event(), Event::Ready { .. }), "{:?}", bench.events);
}

#[test]
fn mute_estimates_or_heartbeats_are_a_loss_each() {
    for missing in [0x09, 0x01] {
        let mut bench = Bench::driving(1.0);
        for _ in 0..100 {
            bench.now += ms(1);
            bench.drive.handle_timeout(bench.now);
            bench.engine.handle_timeout(bench.now);
            while let Some(frame) = bench.drive.poll_tx() {
                if frame.id() != Id::Standard(3 << 5 | missing) {
                    bench.engine.handle_rx(bench.now, &frame);
                }
            }
        }
        assert_eq!(bench.engine.poll_event(), Some(Event::Lost { reason: LostReason::Silent }), "{missing:#x}");
    }
}

#[test]
fn an_absent_device_is_refused_once_and_tried_for_ever() {
    let mut bench = Bench::new();
    bench.drive.faults.unplugged = true;
    bench.pass(Duration::from_secs(10));
    let refused = Event::Refused { step: Step::Contact, reason: Refusal::Silent };
    assert_eq!(bench.events.iter().map(|(_, event)| event).collect::<Vec<_>>(), [&refused]);
    assert_eq!(bench.sent, [], "an unknown device is sent nothing");
    bench.drive.faults.unplugged = false;
    bench.pass(Duration::from_secs(4));
    assert_eq!(bench.engine.state(), State::Ready);
}

#[test]
fn another_firmware_is_refused_and_sent_no_parameter() {
    let mut bench = Bench::new();
    let version = Version { firmware: [0, 6, 11], ..DEVICE.version };
    bench.drive = Drive::new(Device { version, ..DEVICE });
    bench.pass(STARTED);
    let Event::Refused { step: Step::Identity, reason: Refusal::Identity { found } } = bench.event() else {
        panic!("{:?}", bench.events)
    };
    assert_eq!(found.as_slice(), b"hardware 4.4.58, firmware 0.6.11");
    assert!(bench.sent.iter().all(|(_, frame)| *frame == Command::GetVersion.frame(3)));
}

#[test]
fn a_time_limit_that_does_not_take_is_refused() {
    let mut bench = Bench::new();
    bench.drive.faults.read_only = true;
    bench.pass(STARTED);
    let reason = Refusal::TimeLimit { found: Duration::ZERO };
    assert_eq!(bench.event(), &Event::Refused { step: Step::TimeLimit, reason });
}

#[test]
fn a_watchdog_that_does_not_act_is_refused_and_the_torque_removed() {
    let mut bench = Bench::new();
    bench.drive.faults.watchdog_dead = true;
    bench.pass(STARTED);
    let Event::Refused { step: Step::Silence, reason: Refusal::NoReaction { after } } = bench.event() else {
        panic!("{:?}", bench.events)
    };
    assert!(*after <= ms(200) + DEVICE.heartbeat_within + ms(2), "{after:?}");
    assert!(!bench.drive.is_armed());
    assert_eq!(bench.drive.motor.turns(), 0.0);
}

#[test]
fn a_disarm_for_another_reason_is_no_proof() {
    let mut bench = Bench::new();
    while !bench.drive.is_armed() {
        bench.step();
    }
    bench.pass(ms(50));
    bench.drive.raise(error::DC_BUS_OVER_CURRENT);
    bench.pass(ms(100));
    let reason = Refusal::Fault { errors: error::DC_BUS_OVER_CURRENT };
    assert_eq!(bench.event(), &Event::Refused { step: Step::Silence, reason });
}

#[test]
fn an_answer_from_before_the_disarm_is_not_taken_for_the_cause() {
    let mut bench = Bench::new();
    while bench.sent.last().is_none_or(|(_, frame)| *frame != Command::GetError.frame(3)) {
        bench.now += ms(1);
        bench.engine.handle_timeout(bench.now);
        bench.drive.handle_timeout(bench.now);
        while let Some(frame) = bench.engine.poll_tx(bench.now) {
            bench.sent.push((bench.now, frame));
            if frame != Command::GetError.frame(3) {
                bench.drive.handle_rx(bench.now, &frame);
            }
        }
        while let Some(frame) = bench.drive.poll_tx() {
            bench.engine.handle_rx(bench.now, &frame);
        }
    }
    bench.engine.handle_rx(bench.now, &Message::Errors { active: 0, disarm: 0 }.frame(3));
    bench.pass(ms(400));
    assert_eq!(bench.engine.state(), State::Ready, "{:?}", bench.events);
}

#[test]
fn over_current_and_a_reversed_encoder_are_lost_with_their_error() {
    let mut bench = Bench::driving(2.0);
    bench.drive.raise(error::CURRENT_LIMIT_VIOLATION);
    bench.pass(HEARTBEAT + ms(1));
    let errors = error::CURRENT_LIMIT_VIOLATION;
    assert_eq!(bench.event(), &Event::Lost { reason: LostReason::Fault { errors } });

    let mut bench = Bench::started();
    bench.drive.motor.encoder = Encoder::Reversed;
    bench.target = Some(2.0);
    bench.pass(ms(300));
    let errors = error::SPINOUT_DETECTED;
    assert_eq!(bench.event(), &Event::Lost { reason: LostReason::Fault { errors } });
}

#[test]
fn a_dead_encoder_shows_as_zero_velocity() {
    let mut bench = Bench::started();
    bench.drive.motor.encoder = Encoder::Dead;
    bench.target = Some(2.0);
    bench.pass(ms(500));
    assert_eq!((bench.velocity(), bench.engine.state()), (0.0, State::Ready));
}

#[test]
fn an_axis_that_turns_at_the_start_is_waited_for() {
    let mut bench = Bench::new();
    bench.drive.motor.push(10.0);
    bench.pass(ms(1000));
    assert_eq!(bench.engine.state(), State::Starting);
    assert!(!bench.drive.is_armed());
    bench.pass(Duration::from_secs(3));
    assert_eq!(bench.engine.state(), State::Ready);

    let mut bench = Bench::new();
    bench.drive.motor.push(100.0);
    bench.pass(Duration::from_secs(6));
    assert_eq!(bench.event(), &Event::Refused { step: Step::Standstill, reason: Refusal::Moving });
}

#[test]
fn disarm_removes_the_torque_and_lasts_until_the_restart() {
    let mut bench = Bench::driving(4.0);
    bench.engine.disarm(bench.now);
    bench.pass(ms(2));
    assert!(!bench.drive.is_armed() && bench.truth() > 3.9, "it rolls");
    bench.pass(Duration::from_secs(30));
    assert_eq!((bench.engine.state(), bench.engine.poll_timeout()), (State::Off, None));
    bench.engine.restart(bench.now);
    bench.pass(STARTED);
    assert_eq!(bench.engine.state(), State::Ready);
}

#[test]
fn frames_with_wrong_data_are_counted_and_change_nothing() {
    let mut bench = Bench::driving(2.0);
    let nan = Frame::standard(3 << 5 | 0x09, &[0, 0, 0xC0, 0x7F, 0, 0, 0, 0]);
    bench.engine.handle_rx(bench.now, &nan);
    bench.engine.handle_rx(bench.now, &Frame::standard(3 << 5 | 0x01, &[1]));
    bench.engine.handle_rx(bench.now, &Message::Estimates { position: 9.0, velocity: 9.0 }.frame(4));
    assert_eq!(bench.engine.rejected(), 2);
    assert!((bench.velocity() - 2.0).abs() < 0.01);
}

#[test]
fn wrong_figures_of_the_device_are_refused() {
    let config = Config::new([AXIS]);
    for device in [
        Device { node: 63, ..DEVICE },
        Device { heartbeat_within: ms(101), ..DEVICE },
        Device { heartbeat_within: Duration::ZERO, ..DEVICE },
    ] {
        assert_eq!(Odrive::new(&config, device).map(|_| ()), Err(ConfigError::Device));
    }
}

#[test]
fn hostile_frames_in_any_state_do_no_harm() {
    let mut random = Random::new(7);
    let mut bench = Bench::new();
    for n in 0..100_000_u32 {
        // Mostly frames of this node, mostly of a length that is looked at.
        let node = if random.one_in(4) { random.below(64) as u16 } else { 3 };
        let len = if random.one_in(2) { 8 } else { random.index(9) };
        let data: Vec<u8> = (0..len).map(|_| random.edge_byte()).collect();
        let frame = Frame::standard(node << 5 | random.below(32) as u16, &data);
        bench.engine.handle_rx(bench.now, &frame);
        bench.drive.handle_rx(bench.now, &frame);
        if n % 8 == 0 {
            bench.step();
        }
    }
    assert!(bench.engine.rejected() > 0);
    // The drive as it was at power-on: what came before is overcome.
    bench.drive = Drive::new(DEVICE);
    bench.pass(Duration::from_secs(4));
    assert_eq!(bench.engine.state(), State::Ready, "{:?}", bench.events.last());
}
