//! The driver and a gamepad in virtual time.

use super::*;
use base::gamepad::{ABS_RX, ABS_RY, ABS_X, ABS_Y, Axis, BTN_NORTH, BTN_SOUTH, BTN_TL, BTN_TR, BTN_WEST, Button};
use messages::{Message, common};
use module::bench::Bench;
use module::{Action, Shell, ShellConfig};

pub(super) fn config() -> Config {
    let stick = StickConfig { axis: None, inverted: false, dead_zone: 0.1, expo: 0.0, limit: 0.6 };
    Config {
        bus: "joystick".into(),
        speed: stick,
        steering: stick,
        sideways: stick,
        dead_man: None,
        creep: None,
        scale: 1.0,
        slow: None,
        fast: None,
        quiet: None,
    }
}

/// A gamepad with two sticks of 16 bits, the common type.
pub(super) fn pad() -> Device {
    let mut device = Device::new("a pad");
    for code in [ABS_X, ABS_Y, ABS_RX, ABS_RY] {
        device.add_axis(Axis { code, min: -32_768, max: 32_767, fuzz: 16, flat: 128, value: 0 });
    }
    for code in [BTN_SOUTH, BTN_NORTH, BTN_WEST, BTN_TL, BTN_TR] {
        device.add_button(Button { code, pressed: false });
    }
    device
}

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

struct Rig {
    bench: Bench,
    commands: Vec<(Instant, f64)>,
    lines: Vec<String>,
    /// Its creep command says that the button is held.
    creeps: bool,
}

impl Rig {
    /// The module runs, its port is open.
    fn new(config: Config) -> Self {
        Self::of(config, Commands::Motion)
    }

    /// The same for another base.
    fn of(config: Config, commands: Commands) -> Self {
        let shell = Shell::new(ShellConfig::new(NAME), Box::new(Joydev::new(config, commands).unwrap()));
        let mut rig = Self { bench: Bench::new(shell), commands: Vec::new(), lines: Vec::new(), creeps: false };
        rig.bench.start();
        rig
    }

    /// Additionally with a gamepad at rest.
    fn with_pad() -> Self {
        let mut rig = Self::new(config());
        rig.found(&pad());
        rig.take();
        rig
    }

    fn found(&mut self, device: &Device) {
        self.news(News::Found(device));
    }

    fn news(&mut self, news: News<'_>) {
        self.bench.event(Event::Port { port: PORT, input: Input::Gamepad(news) });
        self.collect();
    }

    fn press(&mut self, code: u16, pressed: bool) {
        self.news(News::Button { code, pressed });
        self.news(News::Frame);
    }

    fn push(&mut self, code: u16, value: i32) {
        self.news(News::Axis { code, value });
        self.news(News::Frame);
    }

    fn pass(&mut self, duration: Duration) {
        self.bench.pass(duration);
        self.collect();
    }

    fn command(&mut self, state: State) {
        let (module, state) = (NAME.into(), state as i8);
        self.bench.message(common::CmdState { module, state, manual: true, ..Default::default() });
        self.collect();
    }

    /// A line for each command, report, note and state, without `LL_DATA_JOYDEV`.
    fn collect(&mut self) {
        for (at, action) in self.bench.done() {
            let ms = at.as_nanos() / 1_000_000;
            self.lines.push(match action {
                Action::Publish(Message::LlCmdMotion(command)) => {
                    assert_eq!((command.priority, command.source.as_str()), (2, "gamepad"));
                    self.commands.push((at, command.speed));
                    format!("{ms} {:.3} {:.3}", command.speed, command.steering)
                }
                Action::Publish(Message::LlCmdVelocity(command)) => {
                    let CmdVelocity { vx, vy, omega, priority, ref source, session, .. } = command;
                    assert_eq!((priority, source.as_str(), session), (2, "gamepad", 0));
                    format!("{ms} {vx:.3} {vy:.3} {omega:.3}")
                }
                Action::Publish(Message::LlCmdCreep(CmdCreep { source, session, held, .. })) => {
                    // Started at the epoch.
                    assert_eq!((source.as_str(), session), ("gamepad", 0));
                    self.creeps = held;
                    format!("{ms} creep {held}")
                }
                Action::Report(report) => {
                    format!("{ms} {:?} {}: {}", report.severity, report.fault.name(), report.message)
                }
                Action::Note(_, line) => format!("{ms} {line}"),
                Action::State(state) => format!("{ms} {state}"),
                _ => continue,
            });
        }
    }

    fn take(&mut self) -> String {
        std::mem::take(&mut self.lines).join("\n")
    }

    fn data(&mut self, duration: Duration) -> Vec<DataJoydev> {
        self.bench.pass(duration);
        let joydev = |message| if let Message::LlDataJoydev(data) = message { Some(data) } else { None };
        self.bench.published().into_iter().filter_map(joydev).collect()
    }
}

#[test]
fn while_the_button_is_held_the_sticks_are_followed_at_20_hz_and_then_there_is_one_zero() {
    let mut rig = Rig::with_pad();
    rig.press(BTN_TL, true);
    rig.pass(ms(60));
    rig.push(ABS_Y, -32_768);
    rig.push(ABS_RX, 32_767);
    rig.pass(ms(60));
    rig.press(BTN_TL, false);
    rig.pass(ms(1000));
    assert_eq!(rig.take(), "0 0.000 0.000\n50 0.000 0.000\n100 0.600 -0.600\n120 0.000 -0.600");
}

#[test]
fn a_base_that_does_not_steer_is_commanded_a_velocity_and_sideways_where_it_can() {
    let mut rig = Rig::of(config(), Commands::Velocity { sideways: true });
    rig.found(&pad());
    assert_eq!(
        rig.take(),
        "0 INIT\n0 RUN\n\
         0 a pad: speed ABS_Y, rotation ABS_RX, sideways ABS_X, dead man BTN_TL, creep BTN_TR"
    );
    rig.press(BTN_TL, true);
    rig.pass(ms(60));
    rig.push(ABS_Y, -32_768);
    rig.push(ABS_X, 32_767);
    rig.push(ABS_RX, -32_768);
    rig.pass(ms(60));
    rig.press(BTN_TL, false);
    rig.pass(ms(1000));
    let zero = "0.000 0.000 0.000";
    assert_eq!(rig.take(), format!("0 {zero}\n50 {zero}\n100 0.600 -0.600 0.600\n120 {zero}"));
    // One that cannot go sideways: its left stick to the side moves nothing.
    let mut rig = Rig::of(config(), Commands::Velocity { sideways: false });
    rig.found(&pad());
    rig.push(ABS_X, -32_768);
    rig.take();
    rig.press(BTN_TL, true);
    rig.pass(ms(60));
    rig.push(ABS_RX, -32_768);
    rig.pass(ms(60));
    assert_eq!(rig.take(), format!("0 {zero}\n50 {zero}\n100 0.000 0.000 0.600"));
}

#[test]
fn the_stick_to_go_sideways_must_be_centred_too() {
    let mut rig = Rig::of(config(), Commands::Velocity { sideways: true });
    rig.found(&pad());
    rig.push(ABS_X, -32_768);
    rig.take();
    rig.press(BTN_TL, true);
    rig.pass(ms(10));
    assert_eq!(
        rig.take(),
        "0 Warning GamepadNotReleased: BTN_TL was pressed with ABS_X off centre: release that first\n\
         0 0.000 0.000 0.000"
    );
}

#[test]
fn nothing_is_commanded_without_the_button() {
    let mut rig = Rig::with_pad();
    rig.push(ABS_Y, -32_768);
    rig.press(BTN_TR, true);
    rig.pass(ms(1000));
    assert_eq!(rig.take(), "");
}

#[test]
fn an_absent_gamepad_is_not_an_error() {
    let mut rig = Rig::new(config());
    rig.news(News::Gone);
    rig.news(News::Gone);
    assert_eq!(rig.take(), "0 INIT\n0 RUN\n0 no gamepad connected");
    let data = rig.data(ms(1000));
    assert_eq!(data.len(), 6);
    let expected = DataJoydev { timestamp: 1_000_000, ..DataJoydev::default() };
    assert_eq!(data[5], expected);
    let mut rig = Rig::new(config());
    rig.bench.event(Event::Port { port: PORT, input: Input::Down("/dev/input: no such folder") });
    rig.collect();
    assert_eq!(rig.take(), "0 INIT\n0 RUN\n0 no gamepad connected: /dev/input: no such folder");
    rig.found(&pad());
    assert_eq!(rig.take(), "0 a pad: speed ABS_Y, steering ABS_RX, dead man BTN_TL, creep BTN_TR");
}

#[test]
fn the_gamepad_is_published_five_times_a_second() {
    let mut rig = Rig::with_pad();
    rig.push(ABS_Y, -32_768);
    rig.press(BTN_TL, true);
    let data = rig.data(ms(999));
    assert_eq!(data.len(), 5);
    let DataJoydev { name, connected, dead_man, speed, steering, .. } = &data[4];
    assert_eq!((name.as_str(), connected, dead_man, speed, steering), ("a pad", &true, &true, &0.6, &0.0));
}

#[test]
fn unplugging_is_one_zero_at_once_and_then_nothing() {
    let mut rig = Rig::with_pad();
    rig.press(BTN_TL, true);
    rig.push(ABS_Y, -32_768);
    rig.pass(ms(70));
    rig.take();
    rig.news(News::Gone);
    rig.pass(ms(1000));
    assert_eq!(rig.take(), "70 0.000 0.000\n70 no gamepad connected");
    // Plugged in again with the button held.
    let mut held = pad();
    held.set_button(BTN_TL, true);
    rig.found(&held);
    rig.pass(ms(130));
    let told = "1070 a pad: speed ABS_Y, steering ABS_RX, dead man BTN_TL, creep BTN_TR\n\
                1070 Warning GamepadNotReleased: BTN_TL was held before: release it first";
    assert_eq!(rig.take(), told);
    rig.press(BTN_TL, false);
    rig.press(BTN_TL, true);
    rig.pass(ms(40));
    let told = "1200 Notice GamepadNotReleased: the dead-man button is effective again\n1200 0.000 0.000";
    assert_eq!(rig.take(), told);
}

#[test]
fn a_lost_port_is_an_unplugged_gamepad() {
    let mut rig = Rig::with_pad();
    rig.press(BTN_TL, true);
    rig.pass(ms(10));
    rig.take();
    rig.bench.event(Event::Port { port: PORT, input: Input::Down("it broke") });
    rig.pass(ms(500));
    assert_eq!(rig.take(), "10 0.000 0.000\n10 no gamepad connected: it broke");
}

#[test]
fn a_stick_off_the_middle_must_go_there_first() {
    for (code, name) in [(ABS_Y, "ABS_Y"), (ABS_RX, "ABS_RX")] {
        let mut rig = Rig::with_pad();
        rig.push(code, 20_000);
        rig.press(BTN_TL, true);
        rig.pass(ms(60));
        let told = format!(
            "0 Warning GamepadNotReleased: BTN_TL was pressed with {name} off centre: release that first\n\
             0 0.000 0.000\n50 0.000 0.000"
        );
        assert_eq!(rig.take(), told);
        rig.push(code, 3000);
        rig.push(ABS_Y, -32_768);
        rig.pass(ms(45));
        let told = "60 Notice GamepadNotReleased: the dead-man button is effective again\n100 0.600 0.000";
        assert_eq!(rig.take(), told, "{name}");
    }
}

#[test]
fn events_of_one_frame_are_evaluated_together() {
    let mut rig = Rig::with_pad();
    rig.news(News::Button { code: BTN_TL, pressed: true });
    rig.news(News::Axis { code: ABS_Y, value: -32_768 });
    rig.news(News::Frame);
    rig.pass(ms(10));
    assert!(rig.take().contains("ABS_Y off centre"));
}

#[test]
fn a_release_within_a_frame_counts() {
    let mut rig = Rig::with_pad();
    rig.press(BTN_TL, true);
    rig.push(ABS_Y, -32_768);
    rig.pass(ms(60));
    rig.take();
    rig.news(News::Button { code: BTN_TL, pressed: false });
    rig.news(News::Button { code: BTN_TL, pressed: true });
    rig.news(News::Frame);
    rig.pass(ms(40));
    assert!(rig.take().starts_with("60 0.000 0.000\n60 Warning GamepadNotReleased"), "{}", rig.take());
}

#[test]
fn after_lost_events_the_button_must_be_released() {
    let mut rig = Rig::with_pad();
    rig.press(BTN_TL, true);
    rig.push(ABS_Y, -32_768);
    rig.pass(ms(60));
    rig.take();
    let mut device = pad();
    device.set_button(BTN_TL, true);
    device.set_axis(ABS_Y, -32_768);
    rig.found(&device);
    rig.pass(ms(500));
    assert_eq!(rig.take(), "60 0.000 0.000\n60 Warning GamepadNotReleased: BTN_TL was held before: release it first");
}

#[test]
fn in_pause_it_publishes_without_commands_and_in_stop_neither() {
    let mut rig = Rig::with_pad();
    rig.press(BTN_TL, true);
    rig.push(ABS_Y, -32_768);
    rig.pass(ms(60));
    rig.take();
    rig.command(State::Pause);
    assert_eq!(rig.take(), "60 PAUSE\n60 0.000 0.000");
    assert_eq!(rig.data(ms(1000)).len(), 5);
    rig.command(State::Run);
    rig.pass(ms(500));
    let told = "1060 RUN\n1060 Warning GamepadNotReleased: BTN_TL was held before: release it first";
    assert_eq!(rig.take(), told, "nothing resumes by itself");
    rig.command(State::Stop);
    assert_eq!(rig.data(ms(1000)).len(), 0);
    rig.take();
    // Pressed in STOP it does not count either.
    rig.push(ABS_Y, 0);
    rig.press(BTN_TL, false);
    rig.press(BTN_TL, true);
    rig.command(State::Run);
    rig.pass(ms(100));
    assert!(rig.take().contains("was held before"));
    rig.press(BTN_TL, false);
    rig.press(BTN_TL, true);
    rig.pass(ms(10));
    assert!(rig.take().ends_with(" 0.000 0.000"));
    rig.command(State::Terminate);
    assert!(rig.take().ends_with(" 0.000 0.000"), "the last word is zero");
}

#[test]
fn the_creep_button_counts_from_a_press_while_the_robot_is_driven_until_its_release() {
    let mut rig = Rig::with_pad();
    rig.press(BTN_TL, true);
    rig.pass(ms(20));
    rig.press(BTN_TR, true);
    rig.pass(ms(100));
    rig.press(BTN_TR, false);
    rig.pass(ms(30));
    let told = "0 0.000 0.000\n50 creep true\n50 0.000 0.000\n100 creep true\n100 0.000 0.000\n120 creep false\n\
                150 0.000 0.000";
    assert_eq!(rig.take(), told);
    // It ends with the dead-man button.
    rig.press(BTN_TR, true);
    rig.pass(ms(60));
    rig.take();
    rig.press(BTN_TL, false);
    assert_eq!(rig.take(), "210 0.000 0.000\n210 creep false");
    // A button held since before, alone or within one frame, is not a deliberate act.
    rig.press(BTN_TL, true);
    rig.pass(ms(90));
    assert!(!rig.take().contains("creep"));
    rig.press(BTN_TR, false);
    rig.press(BTN_TR, true);
    rig.pass(ms(50));
    assert!(rig.take().contains("creep true"), "pressed anew");
    for button in [BTN_TL, BTN_TR] {
        rig.press(button, false);
    }
    rig.take();
    for button in [BTN_TL, BTN_TR] {
        rig.news(News::Button { code: button, pressed: true });
    }
    rig.news(News::Frame);
    rig.pass(ms(100));
    assert!(!rig.take().contains("creep"));
}

#[test]
fn slow_and_fast_scale_the_limit() {
    let gear = |button, scale| Some(Gear { button, scale });
    let config = Config { scale: 0.5, slow: gear(BTN_WEST, 0.25), fast: gear(BTN_NORTH, 1.0), ..config() };
    let mut rig = Rig::new(config);
    rig.found(&pad());
    rig.push(ABS_Y, 32_767);
    let mut speed = |held: &[u16]| {
        for code in [BTN_WEST, BTN_NORTH] {
            rig.press(code, held.contains(&code));
        }
        rig.data(ms(200)).last().unwrap().speed
    };
    assert_eq!([speed(&[]), speed(&[BTN_NORTH]), speed(&[BTN_WEST])], [-0.3, -0.6, -0.15]);
    assert_eq!(speed(&[BTN_WEST, BTN_NORTH]), -0.15, "slow counts first");
}

#[test]
fn a_gamepad_that_may_be_out_of_range_counts_as_released() {
    // A receiver is a USB device just as a cable is, so all gamepads are judged unless the configuration says
    // otherwise.
    let quiet = <Config as settings::Section>::usual().quiet;
    assert_eq!(quiet, Some(ms(500)));
    let mut rig = Rig::new(Config { quiet, ..config() });
    rig.found(&pad());
    rig.press(BTN_TL, true);
    rig.pass(ms(490));
    rig.push(ABS_Y, -32_768);
    rig.take();
    rig.pass(ms(480));
    assert!(rig.take().ends_with("950 0.600 0.000"));
    rig.pass(ms(500));
    let told = "990 0.000 0.000\n990 the gamepad has been silent for too long: it counts as released \
     (gamepad.quiet_s = 0 for one with a cable)\n\
                990 Warning GamepadNotReleased: BTN_TL was held before: release it first";
    assert_eq!(rig.take(), told);
}

#[test]
fn an_unsuitable_device_is_reported_and_commands_nothing() {
    let mut odd = Device::new("one stick");
    odd.add_axis(Axis { code: ABS_Y, min: 0, max: 255, fuzz: 0, flat: 0, value: 0 });
    odd.add_button(Button { code: BTN_TL, pressed: false });
    let mut rig = Rig::with_pad();
    rig.found(&odd);
    rig.press(BTN_TL, true);
    rig.pass(ms(100));
    let why = "one stick cannot drive the robot: it has only ABS_Y for speed and steering";
    assert_eq!(rig.take(), format!("0 Warning GamepadRefused: {why}"));
    let data = rig.data(ms(200));
    assert_eq!((data[0].connected, data[0].dead_man, data[0].name.as_str()), (true, false, "one stick"));
    rig.found(&pad());
    assert!(rig.take().contains("Notice GamepadRefused"));
}

#[test]
fn a_contradictory_configuration_is_rejected() {
    let refused = |change: fn(&mut Config)| {
        let mut config = config();
        change(&mut config);
        Joydev::new(config, Commands::Motion).unwrap_err()
    };
    assert_eq!(refused(|c| (c.speed.axis, c.steering.axis) = (Some(1), Some(1))), ConfigError::OneAxis);
    assert_eq!(
        refused(|c| (c.dead_man, c.slow) = (Some(7), Some(Gear { button: 7, scale: 0.5 }))),
        ConfigError::OneButton
    );
    assert_eq!(refused(|c| (c.dead_man, c.creep) = (Some(7), Some(7))), ConfigError::OneButton);
    assert_eq!(refused(|c| c.speed.dead_zone = 0.95), ConfigError::Number);
    assert_eq!(refused(|c| c.steering.expo = f64::NAN), ConfigError::Number);
    assert_eq!(refused(|c| c.speed.limit = f64::INFINITY), ConfigError::Number);
    assert_eq!(refused(|c| c.scale = 0.0), ConfigError::Number);
}

/// For any sequence of inputs: commands are within the limits, only in RUN and while the button is held; the last one
/// before a silence is zero. It creeps only while both buttons are held.
#[test]
fn nothing_moves_the_robot_but_a_button_that_is_held() {
    let mut chance = 0x2545_F491_4F6C_DD1D_u64;
    let mut next = |count: u64| {
        chance ^= chance << 13;
        chance ^= chance >> 7;
        chance ^= chance << 17;
        chance % count
    };
    let mut rig = Rig::with_pad();
    let (mut held, mut second, mut there, mut moved, mut crept) = (false, false, true, 0, 0);
    let mut last = (Instant::ZERO, 0.0);
    for _ in 0..20_000 {
        match next(40) {
            0 if next(4) == 0 => {
                there = false;
                rig.news(News::Gone);
            }
            1 => {
                (there, held) = (true, next(2) == 0);
                let mut device = pad();
                device.set_button(BTN_TL, held);
                second = next(2) == 0;
                device.set_button(BTN_TR, second);
                rig.found(&device);
            }
            2..7 => rig.news(News::Axis { code: ABS_Y, value: next(1 << 32) as u32 as i32 }),
            7 => rig.news(News::Axis { code: next(6) as u16, value: next(1 << 32) as u32 as i32 }),
            8..11 => rig.news(News::Axis { code: ABS_Y, value: 0 }),
            11..15 => rig.news(News::Axis { code: ABS_RX, value: 0 }),
            15..20 => {
                held = next(4) != 0;
                rig.news(News::Button { code: BTN_TL, pressed: held });
            }
            20..24 => {
                second = next(4) != 0;
                rig.news(News::Button { code: BTN_TR, pressed: second });
            }
            24..30 => rig.news(News::Frame),
            30 if next(4) == 0 => rig.command(State::Stop),
            30 => rig.command(State::Pause),
            31..34 => rig.command(State::Run),
            _ => rig.pass(ms(next(120))),
        }
        let may = held && there && rig.bench.shell.state() == State::Run;
        assert!(!rig.creeps || (may && second), "it creeps without both buttons");
        crept += u32::from(rig.creeps);
        for (at, speed) in std::mem::take(&mut rig.commands) {
            assert!(speed == 0.0 || (may && speed.abs() <= 0.6), "{speed} m/s at {at:?}");
            moved += u32::from(speed != 0.0);
            last = (at, speed);
        }
        assert!(last.1 == 0.0 || (may && rig.bench.now().since(last.0) <= ms(50)), "silent after {last:?}");
    }
    assert!(moved > 100 && crept > 100, "{moved} {crept}");
}
