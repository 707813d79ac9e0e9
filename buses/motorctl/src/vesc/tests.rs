use super::device::Device as Board;
use super::payload::{ABS_OVER_CURRENT, Request};
use super::{Commands, Device, Link, VescCan, VescUart, can, uart};
use crate::motor::{Drive, Encoder};
use crate::{Axis, Config, ConfigError, Engine, Event, LostReason, Reaction, Refusal, State, Step};
use base::can::{Frame, Id};
use base::{Duration, Instant};
use std::vec::Vec;
use testing::Random;

const AXIS: Axis = Axis { gear: -10.0, velocity_max_radps: 20.0, acceleration_radps2: 40.0 };
const DEVICE: Device = Device::EXAMPLE;
const HOST: u8 = 254;
const STARTED: Duration = Duration::from_millis(1000);

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// What is sent can be received.
trait Wire: Link {
    fn both() -> (Engine<Commands<Self>, 1>, Board<Self>)
    where
        Self: Sized;
    fn rx(tx: &Self::Tx) -> &Self::Rx;
}

impl Wire for uart::Link {
    fn both() -> (Engine<Commands<Self>, 1>, Board<Self>) {
        (VescUart::uart(&Config::new([AXIS]), DEVICE).unwrap(), Board::new(DEVICE, Self::new()))
    }
    fn rx(tx: &Self::Tx) -> &[u8] {
        tx
    }
}

impl Wire for can::Link {
    fn both() -> (Engine<Commands<Self>, 1>, Board<Self>) {
        (VescCan::can(&Config::new([AXIS]), DEVICE, HOST).unwrap(), Board::new(DEVICE, Self::device(DEVICE.id)))
    }
    fn rx(tx: &Self::Tx) -> &Frame {
        tx
    }
}

struct Bench<L: Wire> {
    now: Instant,
    engine: Engine<Commands<L>, 1>,
    board: Board<L>,
    events: Vec<(Instant, Event)>,
    cut: bool,
    target: Option<f64>,
}

impl<L: Wire> Bench<L> {
    fn new() -> Self {
        let (engine, board) = L::both();
        let now = Instant::from_millis(1000);
        Self { now, engine, board, events: Vec::new(), cut: false, target: None }
    }

    fn driving(target: f64) -> Self {
        let mut bench = Self::new();
        bench.pass(STARTED);
        assert_eq!(bench.engine.state(), State::Ready, "{:?}", bench.events);
        bench.events.clear();
        bench.target = Some(target);
        bench.pass(ms(1000));
        let measured = bench.engine.feedback(0).unwrap().velocity_radps;
        assert!((measured - target).abs() < 0.01, "{measured}");
        bench
    }

    fn truth(&self) -> f64 {
        self.board.motor.velocity() / AXIS.turns_per_rad()
    }

    fn step(&mut self) {
        self.now += ms(1);
        let now = self.now;
        self.engine.handle_timeout(now);
        self.board.handle_timeout(now);
        if let Some(target) = self.target.filter(|_| self.engine.state() == State::Ready) {
            let _ = self.engine.command(now, [target]);
        }
        while let Some(tx) = self.board.poll_tx() {
            self.engine.handle_rx(now, L::rx(&tx));
        }
        while let Some(tx) = self.engine.poll_tx(now) {
            if !self.cut {
                self.board.handle_rx(now, L::rx(&tx));
            }
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

/// Runs a test on both links.
macro_rules! on_both {
    ($($(#[$attribute:meta])* fn $name:ident($bench:ident) $body:block)*) => {
        mod on_uart {
            use super::*;
            $(#[test] fn $name() { super::$name::<uart::Link>(); })*
        }
        mod on_can {
            use super::*;
            $(#[test] fn $name() { super::$name::<can::Link>(); })*
        }
        $($(#[$attribute])* fn $name<$bench: Wire>() $body)*
    };
}

on_both! {
    fn the_start_up_proves_the_timeout_by_silence_before_anything_turns(L) {
        let mut bench = Bench::<L>::new();
        bench.pass(STARTED);
        let [(_, Event::Ready { acted_after: Some(after), reaction })] = &bench.events[..] else {
            panic!("{:?}", bench.events)
        };
        assert_eq!(reaction, &Reaction::Brakes { current_a: 10.0 });
        assert!(*after > ms(200) && *after <= ms(200 + 10 + 20 + 2), "{after:?}");
        assert_eq!(bench.board.motor.turns(), 0.0);
    }

    fn velocity_and_position_return_in_units_of_the_output(L) {
        let bench = Bench::<L>::driving(5.0);
        assert!(bench.board.motor.velocity() < 0.0, "the gear reverses");
        let feedback = bench.engine.feedback(0).unwrap();
        assert!(feedback.position_rad > 4.0 && feedback.position_rad < 5.0, "{feedback:?}");
        assert_eq!((feedback.supply_v, feedback.temperature_c, feedback.current_a), (24.1, 33.0, 1.2));
        assert_eq!(bench.engine.rejected(), 0);
    }

    fn the_tachometer_wraps_without_a_jump_of_the_position(L) {
        let mut bench = Bench::<L>::new();
        bench.board.offset = i32::MIN + 100;
        bench.target = Some(5.0);
        bench.pass(ms(1500));
        let position = bench.engine.feedback(0).unwrap().position_rad;
        assert!(position > 3.0 && position < 6.0, "{position}");
    }

    fn a_stop_ends_braked_and_a_quick_stop_begins_so(L) {
        let mut bench = Bench::<L>::driving(10.0);
        (bench.target, _) = (None, bench.engine.stop());
        bench.pass(ms(100));
        assert!(bench.truth() > 5.0 && bench.truth() < 8.0, "{}", bench.truth());
        bench.pass(ms(200));
        assert!(bench.truth().abs() < 1e-3 && bench.board.motor.drive == Drive::Brake, "{}", bench.truth());

        let mut bench = Bench::<L>::driving(10.0);
        bench.engine.quick_stop();
        bench.pass(ms(25));
        assert_eq!(bench.board.motor.drive, Drive::Brake);
        bench.pass(ms(200));
        assert!(bench.truth().abs() < 1e-3);
    }

    /// There the speed control of the device would release the motor.
    fn below_the_least_speed_of_the_device_it_is_braked(L) {
        let mut bench = Bench::<L>::driving(5.0);
        // 900 ERPM are 1.35 rad/s here.
        bench.target = Some(1.3);
        bench.pass(ms(500));
        assert_eq!((bench.board.motor.drive, bench.truth()), (Drive::Brake, 0.0));
    }

    fn when_the_engine_is_cut_off_the_device_brakes_within_its_limit(L) {
        let mut bench = Bench::<L>::driving(10.0);
        bench.cut = true;
        bench.pass(ms(180));
        assert!(!bench.board.is_timed_out());
        bench.pass(ms(35));
        assert_eq!((bench.board.is_timed_out(), bench.board.motor.drive), (true, Drive::Brake));
    }

    fn unplugged_at_speed_is_lost_within_100_ms(L) {
        let mut bench = Bench::<L>::driving(10.0);
        let since = bench.now;
        bench.board.faults.unplugged = true;
        bench.pass(ms(100));
        assert_eq!(bench.event(), &Event::Lost { reason: LostReason::Silent });
        assert!(bench.events[0].0.since(since) <= ms(100));
        bench.board.faults.unplugged = false;
        bench.pass(ms(3000));
        assert!(matches!(bench.event(), Event::Ready { .. }), "{:?}", bench.events);
    }

    fn commands_that_do_not_arrive_are_seen_at_the_timeout_of_the_device(L) {
        let mut bench = Bench::<L>::driving(10.0);
        bench.board.faults.deaf = true;
        bench.pass(ms(250));
        assert_eq!(bench.event(), &Event::Lost { reason: LostReason::TimeLimitActed });
    }

    fn an_absent_device_is_refused_once_and_tried_for_ever(L) {
        let mut bench = Bench::<L>::new();
        bench.board.faults.mute = true;
        bench.pass(Duration::from_secs(10));
        let refused = Event::Refused { step: Step::Contact, reason: Refusal::Silent };
        assert_eq!(bench.events.iter().map(|(_, event)| event).collect::<Vec<_>>(), [&refused]);
        assert_eq!(bench.board.motor.drive, Drive::Brake, "by its own timeout: it was sent no command");
        bench.board.faults.mute = false;
        bench.pass(ms(3000));
        assert_eq!(bench.engine.state(), State::Ready);
    }

    fn another_kind_or_an_old_firmware_is_refused(L) {
        for (firmware, kind, words) in
            [([5, 3], 0, &b"firmware 5.03, kind 0, 60_MK5"[..]), ([6, 5], 1, &b"firmware 6.05, kind 1, 60_MK5"[..])]
        {
            let mut bench = Bench::<L>::new();
            (bench.board.firmware, bench.board.kind) = (firmware, kind);
            bench.pass(STARTED);
            let found = words.iter().copied().collect();
            let refused = Event::Refused { step: Step::Identity, reason: Refusal::Identity { found } };
            assert_eq!(bench.event(), &refused);
        }
    }

    fn a_time_limit_that_is_off_or_too_long_or_shorter_than_four_periods_is_refused(L) {
        for timeout_ms in [0, 79, 201, 1000, u32::MAX] {
            let mut bench = Bench::<L>::new();
            bench.board.timeout_ms = timeout_ms;
            bench.pass(STARTED);
            let reason = Refusal::TimeLimit { found: ms(timeout_ms.into()) };
            assert_eq!(bench.event(), &Event::Refused { step: Step::TimeLimit, reason });
        }
    }

    fn a_timeout_that_does_not_act_is_refused_and_the_torque_removed(L) {
        let mut bench = Bench::<L>::new();
        bench.board.faults.timeout_dead = true;
        bench.pass(STARTED);
        let Event::Refused { step: Step::Silence, reason: Refusal::NoReaction { after } } = bench.event() else {
            panic!("{:?}", bench.events)
        };
        assert!(*after <= ms(200 + 40 + 20 + 2), "{after:?}");
        assert_eq!((bench.board.motor.drive, bench.board.motor.turns()), (Drive::Free, 0.0));
    }

    fn faults_and_the_kill_switch_are_a_loss_and_refuse_the_next_start(L) {
        let mut bench = Bench::<L>::driving(5.0);
        bench.board.raise(ABS_OVER_CURRENT);
        bench.pass(ms(25));
        let errors = u32::from(ABS_OVER_CURRENT);
        assert_eq!(bench.event(), &Event::Lost { reason: LostReason::Fault { errors } });
        bench.pass(ms(2000));
        assert_eq!(bench.event(), &Event::Refused { step: Step::Enable, reason: Refusal::Fault { errors } });
        bench.board.raise(0);
        bench.pass(ms(3000));
        assert_eq!(bench.engine.state(), State::Ready);
        bench.board.killed = true;
        bench.pass(ms(25));
        assert_eq!(bench.event(), &Event::Lost { reason: LostReason::Disabled });
    }

    fn encoders_that_are_dead_or_reversed_are_reported_as_they_count(L) {
        for (encoder, shown) in [(Encoder::Dead, 0.0), (Encoder::Reversed, -5.0)] {
            let mut bench = Bench::<L>::driving(5.0);
            bench.board.motor.encoder = encoder;
            bench.pass(ms(50));
            let measured = bench.engine.feedback(0).unwrap().velocity_radps;
            assert!((measured - shown).abs() < 0.01, "{measured}");
        }
    }

    fn an_axis_that_turns_at_the_start_is_braked(L) {
        let mut bench = Bench::<L>::new();
        bench.board.motor.push(30.0);
        bench.pass(ms(2000));
        assert_eq!(bench.engine.state(), State::Ready);
    }

    fn disarm_removes_the_torque_and_lasts_until_the_restart(L) {
        let mut bench = Bench::<L>::driving(10.0);
        bench.engine.disarm(bench.now);
        bench.pass(ms(2));
        assert_eq!(bench.board.motor.drive, Drive::Free);
        bench.pass(Duration::from_secs(2));
        assert_eq!((bench.engine.state(), bench.engine.poll_timeout()), (State::Off, None));
        bench.engine.restart(bench.now);
        bench.pass(STARTED);
        assert_eq!(bench.engine.state(), State::Ready);
    }
}

#[test]
fn another_id_is_refused_on_a_uart_and_silent_on_can() {
    let mut bench = Bench::<uart::Link>::new();
    bench.board = Board::new(Device { id: 24, ..DEVICE }, uart::Link::new());
    bench.pass(STARTED);
    let found = b"id 24".iter().copied().collect();
    assert_eq!(bench.event(), &Event::Refused { step: Step::Identity, reason: Refusal::Identity { found } });

    let mut bench = Bench::<can::Link>::new();
    bench.board = Board::new(Device { id: 24, ..DEVICE }, can::Link::device(24));
    bench.pass(STARTED);
    assert_eq!(bench.event(), &Event::Refused { step: Step::Contact, reason: Refusal::Silent });
}

#[test]
fn commands_on_can_are_frames_of_their_own() {
    let mut bench = Bench::<can::Link>::driving(5.0);
    bench.now += ms(20);
    bench.engine.handle_timeout(bench.now);
    let frames: Vec<Frame> = core::iter::from_fn(|| bench.engine.poll_tx(bench.now)).collect();
    let ids: Vec<Id> = frames.iter().map(Frame::id).collect();
    assert_eq!(ids, [Id::Extended(0x0317), Id::Extended(0x0817)]);
    assert_eq!(frames[1].data()[..3], [HOST, 0, Request::Values.bytes()[0]]);
}

#[test]
fn wrong_figures_of_the_device_are_refused() {
    let config = Config::new([AXIS]);
    for device in [
        Device { pole_pairs: 0, ..DEVICE },
        Device { erpm_min: f64::NAN, ..DEVICE },
        Device { hold_current_a: 0.0, ..DEVICE },
        Device { quick_stop_current_a: f64::INFINITY, ..DEVICE },
    ] {
        assert_eq!(VescUart::uart(&config, device).map(|_| ()), Err(ConfigError::Device));
    }
    for host in [DEVICE.id, can::TO_ALL] {
        assert_eq!(VescCan::can(&config, DEVICE, host).map(|_| ()), Err(ConfigError::Device));
    }
}

#[test]
fn hostile_bytes_in_any_state_do_no_harm() {
    let mut random = Random::new(13);
    let mut bench = Bench::<uart::Link>::new();
    for n in 0..100_000_u32 {
        let len = random.index(6);
        let bytes: Vec<u8> = (0..len).map(|_| random.edge_byte()).collect();
        bench.engine.handle_rx(bench.now, &bytes);
        bench.board.handle_rx(bench.now, &bytes);
        if n % 8 == 0 {
            bench.step();
        }
    }
    assert!(bench.engine.rejected() > 0);
    bench.board = Board::new(DEVICE, uart::Link::new());
    bench.pass(ms(4000));
    assert_eq!(bench.engine.state(), State::Ready, "{:?}", bench.events.last());
}

#[test]
fn hostile_frames_in_any_state_do_no_harm() {
    let mut random = Random::new(17);
    let mut bench = Bench::<can::Link>::new();
    for n in 0..100_000_u32 {
        let len = random.index(9);
        let data: Vec<u8> = (0..len).map(|_| random.edge_byte()).collect();
        let to = [HOST, DEVICE.id, random.edge_byte()][random.index(3)];
        let frame = Frame::new(Id::Extended((random.below(12) as u32) << 8 | u32::from(to)), &data).unwrap();
        bench.engine.handle_rx(bench.now, &frame);
        bench.board.handle_rx(bench.now, &frame);
        if n % 8 == 0 {
            bench.step();
        }
    }
    assert!(bench.engine.rejected() > 0);
    bench.board = Board::new(DEVICE, can::Link::device(DEVICE.id));
    bench.pass(ms(4000));
    assert_eq!(bench.engine.state(), State::Ready, "{:?}", bench.events.last());
}
