//! Transcripts: an emulated fan controller and thermometers in virtual time. Lines of a transcript are what an operator
//! sees and what is published once a second.

use super::*;
use base::i2c::{Address, Bytes, Error};
use base::w1::{Answer, List, Request, Rom};
use i2c::max6615::{self, Fan, Mode};
use i2c::target::answer;
use messages::Message;
use module::bench::Bench;
use module::{Action, Output, Shell, ShellConfig};
use std::collections::{BTreeMap, VecDeque};

const I2C: PortId = PortId(0);
const W1: PortId = PortId(1);
/// Duration of any transfer: about that of reading a byte at 100 kHz.
const TRANSFER: Duration = Duration::from_micros(400);
const CONVERSION: Duration = Duration::from_millis(750);

/// Fault of the chip.
#[derive(Clone, Copy, Debug, PartialEq)]
enum ChipFault {
    Nothing,
    Silent,
    AllOnes,
    Stuck,
    /// The adapter does not finish its transfer.
    Hangs,
}

struct Rig {
    bench: Bench,
    chip: max6615::chip::Chip,
    fault: ChipFault,
    thermometers: BTreeMap<Rom, Result<i32, base::w1::Error>>,
    outcomes: VecDeque<(Instant, base::i2c::Outcome)>,
    answers: VecDeque<(Instant, Answer)>,
    log: Vec<String>,
    transfers: u32,
}

fn rom(serial: u64) -> Rom {
    Rom::new(0x28, serial).unwrap()
}

fn config() -> Config {
    let address = Address::new(0x18).unwrap();
    let mode = Mode::Automatic { follows: [true, false], start_duty: 0.3, maximum_duty: 1.0, step: 10 };
    let fan = Fan { mode, rate: 1, minimum_rpm: 400.0, full_only: false };
    let chip = max6615::Config {
        limit_c: [60, 70],
        start_c: [35, 35],
        fans: [fan; 2],
        minimum_duty: true,
        ..max6615::Config::new(address)
    };
    let channel = |name: &str| Some(Channel { name: name.into() });
    let fan = |name: &str| Some(FanConfig { name: name.into() });
    let chip = ChipConfig {
        name: "fan1".into(),
        channels: [channel("box"), channel("drives")],
        fans: [fan("fan_left"), fan("fan_right")],
        chip,
    };
    let thermometer = Thermometer { rom: rom(1), name: "battery".into(), limit_c: Some(50.0) };
    Config {
        bus: Some(BusConfig { bus: "i2c.aux".into(), hz: 100_000, chips: vec![chip] }),
        w1: Some(W1Config { bus: "w1".into(), thermometers: vec![thermometer] }),
        host: None,
    }
}

impl Rig {
    fn new() -> Self {
        let driver = Auxiliary::new(config()).unwrap();
        let mut chip = max6615::chip::Chip::new(Address::new(0x18).unwrap(), [2600.0; 2]);
        chip.set_temperature(0, 40.0);
        chip.set_temperature(1, 30.5);
        let mut rig = Self {
            bench: Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(driver))),
            chip,
            fault: ChipFault::Nothing,
            thermometers: [(rom(1), Ok(21_500))].into(),
            outcomes: VecDeque::new(),
            answers: VecDeque::new(),
            log: Vec::new(),
            transfers: 0,
        };
        rig.bench.start();
        rig.collect();
        rig
    }

    fn port(&mut self, port: PortId, input: Input<'_>) {
        self.bench.event(Event::Port { port, input });
        self.collect();
    }

    fn command(&mut self, state: State) {
        let module = NAME.to_owned();
        let state = state as i8;
        self.bench.message(messages::common::CmdState { module, state, manual: true, ..Default::default() });
        self.collect();
    }

    /// Runs for this time, s; returns what was logged.
    fn run(&mut self, seconds: f64) -> String {
        let end = self.bench.now() + Duration::from_secs_f64(seconds);
        loop {
            let outcome = self.outcomes.front().map(|(at, _)| *at);
            let answer = self.answers.front().map(|(at, _)| *at);
            let due = [outcome, answer, self.bench.shell.poll_timeout()].into_iter().flatten().min();
            let next = due.unwrap_or(end).min(end);
            self.bench.pass(next.since(self.bench.now()));
            self.collect();
            if outcome.is_some_and(|at| at <= next)
                && let Some((_, outcome)) = self.outcomes.pop_front()
            {
                self.port(I2C, Input::I2c(&outcome));
            } else if answer.is_some_and(|at| at <= next)
                && let Some((_, answer)) = self.answers.pop_front()
            {
                self.port(W1, Input::OneWire(&answer));
            } else if next == end {
                return std::mem::take(&mut self.log).join("\n");
            }
        }
    }

    fn collect(&mut self) {
        for (at, action) in self.bench.done() {
            match action {
                Action::Send(I2C, Output::I2c(transfer)) => {
                    self.transfers += 1;
                    self.chip.advance(at);
                    let outcome = match self.fault {
                        ChipFault::Nothing => answer(&mut [&mut self.chip], &transfer),
                        ChipFault::Silent => Err(Error::NoAddress),
                        ChipFault::AllOnes if transfer.reads() => Ok(Bytes::from_slice(&[0xFF]).unwrap()),
                        ChipFault::AllOnes => Ok(Bytes::new()),
                        ChipFault::Stuck => Err(Error::Stuck),
                        ChipFault::Hangs => continue,
                    };
                    assert!(self.outcomes.is_empty(), "one transfer at a time");
                    self.outcomes.push_back((at + TRANSFER, outcome));
                }
                Action::Send(W1, Output::OneWire(request)) => {
                    let (takes, answer) = match request {
                        Request::List => {
                            let list: List = self.thermometers.keys().copied().collect();
                            (Duration::from_millis(20), Answer::List(list))
                        }
                        Request::Temperature(rom) => {
                            let said = self.thermometers.get(&rom).copied();
                            (CONVERSION, Answer::Temperature(rom, said.unwrap_or(Err(base::w1::Error::Absent))))
                        }
                        Request::Read(_) | Request::Write(..) => unreachable!("no switches are asked"),
                    };
                    assert!(self.answers.is_empty(), "one request at a time");
                    self.answers.push_back((at + takes, answer));
                }
                Action::Publish(Message::LlDataTemperature(message)) => self.log.push(show(&message)),
                Action::Report(report) => {
                    self.log.push(format!("{:?} {}: {}", report.severity, report.fault.name(), report.message));
                }
                Action::State(state) => self.log.push(state.to_string()),
                Action::Note(_, line) => self.log.push(line),
                _ => {}
            }
        }
    }
}

fn show(message: &DataTemperature) -> String {
    let temperatures = message.temperatures.iter().map(|temperature| {
        format!("{} {}{}", temperature.name, temperature.value, if temperature.over { "!" } else { "" })
    });
    let fans = message.fans.iter().map(|fan| {
        let failed = if fan.failed { " failed" } else { "" };
        format!("{} {:.0}% {}{failed}", fan.name, fan.duty * 100.0, if fan.rpm > 0.0 { "turns" } else { "stands" })
    });
    temperatures.chain(fans).collect::<Vec<_>>().join(", ")
}

/// Lines of a transcript for operators, without the published data.
fn news(log: &str) -> Vec<&str> {
    log.lines().filter(|line| !line.starts_with("box ")).collect()
}

const COMMON: &str = "fan1 (0x18 on i2c.aux)";

#[test]
fn chips_are_found_configured_and_published_once_a_second() {
    let mut rig = Rig::new();
    let log = rig.run(0.9);
    assert_eq!(
        news(&log),
        [
            "INIT",
            "fan1 (0x18 on i2c.aux): MAX6615 revision 1, configured",
            "RUN",
            "battery (28-000000000001 on w1): connected",
        ]
    );
    rig.run(9.0);
    let log = rig.run(1.0);
    // The fans start at 35 °C with 30 %; each further degree adds 10/240.
    assert_eq!(log, "box 40, drives 30.5, battery 21.5, fan_left 51% turns, fan_right 51% turns");
    rig.transfers = 0;
    assert_eq!(rig.run(10.0).lines().count(), 10);
    assert_eq!(rig.transfers, 160, "sixteen registers a second");
}

#[test]
fn an_over_temperature_is_reported_once_and_ends_two_degrees_below() {
    let mut rig = Rig::new();
    rig.run(10.0);
    rig.chip.set_temperature(0, 61.0);
    let log = rig.run(8.0);
    assert_eq!(news(&log), ["Error OverTemperature: box is at 61.0 °C, above its limit of 60 °C"]);
    assert!(log.ends_with("fan_left 100% turns, fan_right 100% turns") && log.contains("box 61!, "), "{log}");
    rig.chip.set_temperature(0, 59.0);
    assert!(news(&rig.run(3.0)).is_empty());
    rig.chip.set_temperature(0, 57.5);
    assert_eq!(news(&rig.run(3.0)), ["Notice OverTemperature: box is at 57.5 °C, below its limit of 60 °C"]);
}

#[test]
fn a_stopped_fan_and_its_return_are_reported() {
    let mut rig = Rig::new();
    rig.run(10.0);
    rig.chip.set_stalled(1, true);
    let log = rig.run(10.0);
    assert!(news(&log)[0].starts_with("Error FanFailed: fan_right failed: 0 rpm at "), "{log}");
    // The other fan compensates.
    assert!(log.ends_with("fan_left 100% turns, fan_right 51% stands failed"), "{log}");
    rig.chip.set_stalled(1, false);
    let log = rig.run(10.0);
    assert!(news(&log)[0].starts_with("Notice FanFailed: fan_right turns again: "), "{log}");
    assert_eq!(news(&log).len(), 1);
}

#[test]
fn a_chip_that_is_lost_is_an_error_and_comes_back_configured() {
    for (fault, why) in [
        (ChipFault::Silent, "nobody answers at this address"),
        (ChipFault::AllOnes, "the chip reads FF everywhere"),
        (ChipFault::Stuck, "a line of the bus is held low, and nine clocks did not free it"),
    ] {
        let mut rig = Rig::new();
        rig.run(10.0);
        rig.fault = fault;
        let log = rig.run(3.0);
        let lost = format!("Error ChipLost: {COMMON}: {why}; retried once a second");
        assert_eq!(news(&log), [&*lost, "ERROR"], "{fault:?}");
        let unknown = "box NaN, drives NaN, battery 21.5, fan_left NaN% stands, fan_right NaN% stands";
        assert!(log.ends_with(unknown), "{log}");
        rig.transfers = 0;
        rig.run(10.0);
        assert!((10..=30).contains(&rig.transfers), "{fault:?}: {} in 10 s", rig.transfers);
        // It lost its supply, too.
        rig.chip.reset();
        rig.fault = ChipFault::Nothing;
        let log = rig.run(3.0);
        let found = format!("{COMMON}: MAX6615 revision 1, configured");
        let back = format!("Notice ChipLost: {COMMON} answers again");
        assert_eq!(news(&log), [&*found, &back, "RUN"], "{fault:?}");
        assert!(rig.run(10.0).ends_with("fan_left 51% turns, fan_right 51% turns"));
    }
}

#[test]
fn a_chip_that_was_reset_is_configured_again() {
    let mut rig = Rig::new();
    rig.run(10.0);
    rig.chip.reset();
    assert_eq!(news(&rig.run(2.0)), [format!("{COMMON} had lost its configuration: configured again")]);
}

#[test]
fn a_blocked_adapter_is_reported_and_the_thermometers_continue() {
    let mut rig = Rig::new();
    rig.run(10.0);
    rig.fault = ChipFault::Hangs;
    let log = rig.run(5.0);
    let hangs = format!("Error ChipLost: {COMMON}: the adapter does not finish a transfer");
    assert_eq!(news(&log), [&*hangs, "ERROR"]);
    assert!(log.ends_with("box NaN, drives NaN, battery 21.5, fan_left NaN% stands, fan_right NaN% stands"));
    // The adapter finishes at last.
    rig.fault = ChipFault::Nothing;
    rig.port(I2C, Input::I2c(&Err(Error::Other)));
    let log = rig.run(2.0);
    assert_eq!(news(&log), [&*format!("Notice ChipLost: {COMMON} answers again"), "RUN"], "{log}");
}

#[test]
fn a_lost_port_clears_its_values_and_late_outcomes_are_ignored() {
    let mut rig = Rig::new();
    rig.run(10.0002);
    rig.port(I2C, Input::Down("the adapter is gone"));
    rig.outcomes.clear();
    let log = rig.run(2.0);
    assert_eq!(news(&log)[..2], ["Error PortDown: i2c.aux is down: the adapter is gone; retrying", "ERROR"]);
    assert!(log.ends_with("box NaN, drives NaN, battery 21.5, fan_left NaN% stands, fan_right NaN% stands"));
    rig.port(I2C, Input::I2c(&Ok(Bytes::from_slice(&[1]).unwrap())));
    rig.port(I2C, Input::Up);
    let log = rig.run(2.0);
    let found = format!("{COMMON}: MAX6615 revision 1, configured");
    assert_eq!(news(&log), ["Notice PortDown: i2c.aux is up", &*found, "RUN"]);
}

#[test]
fn nothing_is_read_in_stop_and_everything_in_pause() {
    let mut rig = Rig::new();
    rig.run(10.0);
    rig.command(State::Stop);
    rig.run(1.5);
    rig.transfers = 0;
    assert_eq!(rig.run(5.0), "");
    assert_eq!(rig.transfers, 0);
    let duty = rig.chip.read_register(max6615::register::DUTY);
    assert!(duty > 0, "the fans keep running");
    rig.command(State::Pause);
    assert_eq!(rig.run(3.0).lines().filter(|line| line.starts_with("box 40")).count(), 3);
}

#[test]
fn an_absent_thermometer_is_a_note_and_not_an_error() {
    let mut rig = Rig::new();
    rig.run(10.0);
    rig.thermometers.clear();
    let log = rig.run(3.0);
    assert_eq!(news(&log), ["battery (28-000000000001 on w1): not connected"]);
    assert!(log.contains("battery NaN, "), "{log}");
    rig.thermometers.insert(rom(1), Ok(-10_125));
    rig.thermometers.insert(rom(7), Ok(30_000));
    let log = rig.run(5.0);
    assert_eq!(news(&log).len(), 2);
    assert!(log.ends_with("battery -10.125, 28-000000000007 30, fan_left 51% turns, fan_right 51% turns"), "{log}");
    rig.port(W1, Input::Down("its thread: no memory"));
    rig.answers.clear();
    assert!(rig.run(2.0).contains("battery NaN, 28-000000000007 NaN"));
    rig.port(W1, Input::Up);
    assert!(rig.run(5.0).ends_with("battery -10.125, 28-000000000007 30, fan_left 51% turns, fan_right 51% turns"));
}

#[test]
fn thermometers_are_asked_when_their_port_comes_up_after_the_chips() {
    let mut rig = Rig::new();
    rig.run(10.0);
    rig.port(W1, Input::Down("not there yet"));
    rig.answers.clear();
    rig.port(I2C, Input::Up);
    assert!(rig.answers.is_empty(), "requests to a closed port are not answered");
    rig.port(W1, Input::Up);
    assert!(rig.run(3.0).contains("battery 21.5, "));
}

#[test]
fn values_after_a_supply_loss_or_damage_are_rejected() {
    for (said, why) in [
        (Ok(85_000), "it reads 85 °C after a loss of its supply"),
        (Err(base::w1::Error::Crc), "what it sends is damaged"),
        (Err(base::w1::Error::Nonsense), "what it says is no temperature"),
    ] {
        let mut rig = Rig::new();
        rig.run(10.0);
        rig.thermometers.insert(rom(1), said);
        // A single failure is tolerated: the last value is kept.
        assert!(rig.run(2.0).ends_with("battery 21.5, fan_left 51% turns, fan_right 51% turns"), "{said:?}");
        let log = rig.run(5.0);
        assert_eq!(news(&log), [format!("Warning ThermometerBad: battery (28-000000000001 on w1): {why}")]);
        assert!(log.contains("battery NaN"), "{log}");
        rig.thermometers.insert(rom(1), Ok(22_000));
        assert_eq!(news(&rig.run(3.0)), ["Notice ThermometerBad: battery measures again"]);
    }
    // A thermometer that was hot before may read 85 °C.
    let mut rig = Rig::new();
    rig.thermometers.insert(rom(1), Ok(84_500));
    assert!(news(&rig.run(3.0)).contains(&"Error OverTemperature: battery is at 84.5 °C, above its limit of 50 °C"));
    rig.thermometers.insert(rom(1), Ok(85_000));
    assert!(rig.run(4.0).contains("battery 85!"));
}

#[test]
fn an_invalid_configuration_is_rejected() {
    let refused = |change: &dyn Fn(&mut Config)| {
        let mut config = config();
        change(&mut config);
        Auxiliary::new(config).err()
    };
    assert_eq!(refused(&|_| {}), None);
    assert_eq!(refused(&|config| (config.bus, config.w1) = (None, None)), Some(ConfigError::Nothing));
    let chips =
        |config: &mut Config, change: &dyn Fn(&mut Vec<ChipConfig>)| change(&mut config.bus.as_mut().unwrap().chips);
    let twice = |config: &mut Config| {
        chips(config, &|chips| {
            let mut other = chips[0].clone();
            (other.name, other.channels, other.fans) = ("fan2".into(), [None, None], [None, None]);
            chips.push(other);
        });
    };
    assert_eq!(refused(&twice), Some(ConfigError::Address(0x18)));
    let named = |config: &mut Config| chips(config, &|chips| chips[0].fans[0].as_mut().unwrap().name = "box".into());
    assert_eq!(refused(&named), Some(ConfigError::Name("box".into())));
    let slow = |config: &mut Config| chips(config, &|chips| chips[0].chip.fans[0].minimum_rpm = 3.0);
    assert!(matches!(refused(&slow), Some(ConfigError::Chip(name, _)) if name == "fan1"));
    let same = |config: &mut Config| {
        let w1 = config.w1.as_mut().unwrap();
        w1.thermometers.push(Thermometer { name: "other".into(), ..w1.thermometers[0].clone() });
    };
    assert_eq!(refused(&same), Some(ConfigError::Thermometers));
    // Without chips it works at once.
    let mut config = config();
    config.bus = None;
    let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(Auxiliary::new(config).unwrap())));
    bench.start();
    assert_eq!(bench.shell.state(), State::Run);
}

#[test]
fn any_input_of_the_ports_is_survived() {
    let mut seed = 0x2545_F491_4F6C_DD1D_u64;
    let mut random = move || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        seed
    };
    for _ in 0..200 {
        let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(Auxiliary::new(config()).unwrap())));
        bench.start();
        for _ in 0..300 {
            let bits = random();
            let byte = (bits >> 32) as u8;
            let bytes = [byte, (bits >> 40) as u8];
            let outcome = match bits % 5 {
                0 | 1 => Ok(Bytes::from_slice(&bytes[..1]).unwrap()),
                2 => Ok(Bytes::from_slice(&bytes[..(byte % 3).into()]).unwrap()),
                3 => Err(Error::NoData { at: byte }),
                _ => Err(Error::Other),
            };
            let rom = rom(u64::from(byte % 4));
            match (bits >> 8) % 9 {
                0..=3 => bench.i2c(I2C, &outcome),
                4 => bench.w1(W1, &Answer::List([rom, self::rom(9)].into_iter().collect())),
                5 => bench.w1(W1, &Answer::Temperature(rom, Ok(bits as i32))),
                6 => bench.pass(Duration::from_millis(bits >> 50 & 0x7FF)),
                7 => bench.event(Event::Port { port: PortId(byte % 3), input: Input::Down("gone") }),
                _ => bench.event(Event::Port { port: PortId(byte % 3), input: Input::Up }),
            }
            let sent = bench.sent();
            assert!(sent.len() <= 4, "{sent:?}");
        }
    }
}

/// A driver of the computer's temperatures alone, which runs.
fn computer() -> Bench {
    let sensor = |zone: &str, name: &str, limit_c| HostSensor { zone: zone.into(), name: name.into(), limit_c };
    let sensors = vec![sensor("x86_pkg_temp", "host.cpu", Some(85.0)), sensor("nvme/Composite", "host.disk", None)];
    let config = Config { bus: None, w1: None, host: Some(HostConfig { bus: "host".into(), sensors }) };
    let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(Auxiliary::new(config).unwrap())));
    bench.start();
    bench
}

/// The computer answers; returns what was published and reported a second later.
fn answers(bench: &mut Bench, readings: &[(&str, i32)], throttle: Option<base::thermal::Throttle>) -> Vec<String> {
    let mut state = base::thermal::State::default();
    state.throttle = throttle;
    readings.iter().for_each(|(zone, value)| assert!(state.push(zone, *value)));
    bench.done();
    bench.event(Event::Port { port: PortId(0), input: Input::Thermal(&state) });
    bench.pass(PERIOD);
    let line = |(_, action): (Instant, Action)| match action {
        Action::Publish(Message::LlDataTemperature(message)) => {
            let all = message.temperatures.iter();
            Some(all.map(|t| format!("{} {}{}", t.name, t.value, if t.over { "!" } else { "" })).collect::<Vec<_>>())
        }
        Action::Report(report) => Some(vec![format!("{:?} {}", report.severity, report.fault.name())]),
        _ => None,
    };
    bench.done().into_iter().filter_map(line).flatten().collect()
}

#[test]
fn temperatures_of_the_computer_are_published_by_name_and_have_limits() {
    let mut bench = computer();
    assert_eq!(bench.shell.state(), State::Run);
    let cool = [("acpitz", 20_000), ("x86_pkg_temp", 45_500), ("nvme/Composite", 38_000)];
    assert_eq!(answers(&mut bench, &cool, None), ["host.cpu 45.5", "host.disk 38"]);
    let hot = [("x86_pkg_temp", 90_000)];
    assert_eq!(answers(&mut bench, &hot, None), ["Error OverTemperature", "host.cpu 90!", "host.disk NaN"]);
    assert_eq!(answers(&mut bench, &[("x86_pkg_temp", 84_000)], None), ["host.cpu 84!", "host.disk NaN"]);
    let expected = ["Notice OverTemperature", "host.cpu 50", "host.disk NaN"];
    assert_eq!(answers(&mut bench, &[("x86_pkg_temp", 50_000)], None), expected);
}

#[test]
fn a_computer_that_slows_itself_down_is_reported_once_and_one_that_hangs_has_no_temperatures() {
    let mut bench = computer();
    let throttle = |slowed, under_voltage| Some(base::thermal::Throttle { slowed, under_voltage });
    let state = [("x86_pkg_temp", 80_000), ("nvme/Composite", 38_000)];
    let values = ["host.cpu 80", "host.disk 38"];
    assert_eq!(answers(&mut bench, &state, throttle(false, false)), values);
    assert_eq!(answers(&mut bench, &state, throttle(true, false))[0], "Warning HostThrottled");
    assert_eq!(answers(&mut bench, &state, throttle(false, true)), values);
    assert_eq!(answers(&mut bench, &state, throttle(false, false))[0], "Notice HostThrottled");
    // One request is under way, and no further one.
    bench.pass(Duration::from_secs(8));
    let (mut sent, mut last) = (0, Vec::new());
    for (_, action) in bench.done() {
        match action {
            Action::Send(..) => sent += 1,
            Action::Publish(Message::LlDataTemperature(message)) => last = message.temperatures,
            _ => {}
        }
    }
    assert_eq!(sent, 0);
    assert!(last.len() == 2 && last.iter().all(|temperature| temperature.value.is_nan()), "{last:?}");
    // It answers after all.
    assert_eq!(answers(&mut bench, &state, None), values);
}
