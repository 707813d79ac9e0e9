//! Inputs and outputs of the whole robot: driver and emulated devices, on a serial line and on a connection.

use super::{Robot, with_tables};
use base::Duration;
use messages::lowlevel::{CmdOutput, CmdPower, DataBattery, DataIo, DataPower};
use messages::simulation::CmdFault;
use messages::{Hold, Message};
use sim::host::{Config, News};
use std::cell::RefCell;
use std::rc::Rc;

const IO: &str = r#"
[io.modbus.plc]
address = "127.0.0.1:1502"
signals = [
    { name = "horn", table = "coil", address = 3, output = true, safe = 0 },
    { name = "door", table = "discrete", address = 0, simulated = 1 },
]
[io.modbus.line]
port = "modbus-line"
baud = 19200
unit = 5
signals = [
    { name = "volts", table = "input", address = 16, scale = 0.01, simulated = 24.5 },
    { name = "amps", table = "input", address = 17, format = "i32", scale = 0.001, simulated = -1.25 },
    { name = "fan", table = "holding", address = 2, scale = 0.5, output = true, safe = 50, max = 100 },
]
[[io.gpio]]
name = "button"
chip = "gpio-button"
line = 17
simulated = true
[[io.gpio]]
name = "lamp"
chip = "gpio-lamp"
line = 18
output = true
safe = 0
[[io.battery]]
name = "main"
voltage = "volts"
current = "amps"
"#;

/// A horn and lamps, and what they show.
const SIGNALS: &str = r#"
[[io.gpio]]
name = "horn"
chip = "gpio-horn"
line = 1
output = true
safe = 0
[[io.gpio]]
name = "left"
chip = "gpio-left"
line = 2
output = true
safe = 0
[[io.gpio]]
name = "beacon"
chip = "gpio-beacon"
line = 3
output = true
safe = 0
[signals]
signal_s = 1.0
[[signals.show]]
output = "horn"
when = "starting"
pattern = "beep 1 0.3 0.1"
[[signals.show]]
output = "left"
when = "turning_left"
pattern = "blink 2"
[[signals.show]]
output = "beacon"
when = "pause"
pattern = "on"
[[signals.show]]
output = "beacon"
when = "driving"
pattern = "pulses 2 0.1 0.1 0.7"
"#;

/// A computer with its power button and its power LED.
const COMPUTER: &str = r#"
[[io.gpio]]
name = "power_button"
chip = "gpio-power-button"
line = 1
output = true
safe = 0
[[io.gpio]]
name = "power_led"
chip = "gpio-power-led"
line = 2
[[power.computers]]
channel = "computer1"
button = "power_button"
alive = "power_led"
shutdown_s = 10
"#;

#[derive(Default)]
struct Observed {
    news: Vec<String>,
    io: Option<DataIo>,
    battery: Option<DataBattery>,
    power: Option<DataPower>,
    /// Reports of the power driver.
    computers: Vec<String>,
}

impl Observed {
    fn take(&mut self, news: &News<'_>) {
        match news {
            News::Report { module: "driver_io", report } => {
                self.news.push(format!("{:?} {} {}", report.severity, report.fault.name(), report.subject));
            }
            News::Report { module: "driver_power", report } => {
                self.computers.push(format!("{:?} {} {}", report.severity, report.fault.name(), report.subject));
            }
            News::Message { message: Message::LlDataPower(power), .. } => self.power = Some(power.clone()),
            News::State { module: "driver_io", state } => self.news.push(state.to_string()),
            News::Message { message: Message::LlDataIo(io), .. } => self.io = Some(io.clone()),
            News::Message { message: Message::LlDataBattery(battery), .. } => self.battery = Some(battery.clone()),
            _ => {}
        }
    }
}

struct Rig {
    robot: Robot,
    observed: Rc<RefCell<Observed>>,
}

impl Rig {
    fn new(name: &str) -> Self {
        Self::with(name, IO)
    }

    /// The shipped robot with these tables.
    fn with(name: &str, tables: &str) -> Self {
        let place = with_tables(&format!("io-{name}"), tables);
        let config = Config { seed: 7, lcm_jitter: Duration::from_micros(200), ..Config::default() };
        let mut robot = Robot::at(&place, config);
        let observed = Rc::new(RefCell::new(Observed::default()));
        let keep = observed.clone();
        robot.machine.observe(move |_, news| keep.borrow_mut().take(news));
        robot.pass(12.0);
        Self { robot, observed }
    }

    fn value(&self, name: &str) -> (f64, bool) {
        let observed = self.observed.borrow();
        let signal = observed.io.as_ref().unwrap().signals.iter().find(|signal| signal.name == name).unwrap();
        (signal.value, signal.valid)
    }

    fn command(&mut self, name: &str, value: f64) {
        let (now, name) = (self.robot.machine.now(), name.to_owned());
        self.robot.machine.inject(now, CmdOutput { timestamp: 0, name, value, source: "test".into() });
    }

    fn news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.observed.borrow_mut().news)
    }
}

#[test]
fn inputs_are_read_outputs_are_set_and_fall_back() {
    let mut rig = Rig::new("values");
    assert_eq!(rig.news(), ["INIT", "RUN"]);
    assert_eq!((rig.value("volts"), rig.value("amps")), ((24.5, true), (-1.25, true)));
    assert_eq!((rig.value("door"), rig.value("button")), ((1.0, true), (1.0, true)));
    assert_eq!((rig.value("horn"), rig.value("fan"), rig.value("lamp")), ((0.0, true), (50.0, true), (0.0, true)));
    let battery = rig.observed.borrow().battery.clone().unwrap();
    assert_eq!((&*battery.name, battery.voltage, battery.current), ("main", 24.5, -1.25));
    for (name, value) in [("horn", 1.0), ("fan", 20.0), ("lamp", 1.0)] {
        rig.command(name, value);
    }
    rig.robot.pass(0.3);
    assert_eq!((rig.value("horn"), rig.value("fan"), rig.value("lamp")), ((1.0, true), (20.0, true), (1.0, true)));
    rig.robot.pass(1.2);
    assert_eq!((rig.value("horn"), rig.value("fan"), rig.value("lamp")), ((0.0, true), (50.0, true), (0.0, true)));
    rig.command("horn", 2.0);
    rig.robot.pass(0.1);
    assert_eq!(rig.news(), ["Warning OutputRefused horn"]);
}

#[test]
fn a_line_that_is_silent_is_reported_and_comes_back_and_the_robot_drives_on() {
    let mut rig = Rig::new("silent");
    rig.news();
    let fault =
        CmdFault { timestamp: 0, target: "modbus.line".into(), fault: "silent".into(), value: 0.0, duration: 5.0 };
    rig.robot.machine.inject(rig.robot.machine.now(), fault);
    rig.robot.drive_anew(0.3, 0.0, 4.0);
    rig.robot.pass(3.9);
    assert!(rig.robot.speed() > 0.25, "{}", rig.robot.motion().reason);
    assert_eq!(rig.news(), ["Error IoDeviceLost modbus.line unit 5", "ERROR"]);
    assert_eq!((rig.value("volts").1, rig.value("door").1), (false, true));
    rig.robot.pass(4.0);
    assert_eq!(rig.news(), ["Notice IoDeviceLost modbus.line unit 5", "RUN"]);
    assert_eq!(rig.value("volts"), (24.5, true));
}

/// A binary board and an ASCII board with simple request and answer.
const SERIAL: &str = r#"
[io.serial.climate]
port = "io-climate"
check = "crc16-modbus"
[[io.serial.climate.requests]]
name = "temperatures"
request = "01 03"
answer_length = 9
answer_prefix = "01 03"
signals = [
    { name = "inside", at = 2, format = "i16", scale = 0.5, simulated = 24.5 },
    { name = "door", at = 6, format = "bit", bit = 2, simulated = 1 },
]
[[io.serial.climate.requests]]
name = "fan"
request = "01 06 00 00"
echo = true
signals = [ { name = "fan", at = 2, format = "u16", output = true, safe = 50, max = 100 } ]
[io.serial.heater]
address = "127.0.0.1:4001"
request_end = "0D"
answer_end = "0D"
[[io.serial.heater.requests]]
name = "temperature"
request = "'>A1?'"
answer_prefix = "'T='"
signals = [ { name = "heater_t", at = 2, format = "decimal", simulated = -7 } ]
[[io.serial.heater.requests]]
name = "power"
request = "'>B1='"
answer = "'OK'"
signals = [ { name = "heater", at = 4, format = "decimal", output = true, safe = 0, max = 60 } ]
"#;

#[test]
fn serial_devices_with_request_and_answer_are_read_and_written_and_may_be_silent() {
    let mut rig = Rig::with("serial", SERIAL);
    assert_eq!(rig.news(), ["INIT", "RUN"]);
    assert_eq!((rig.value("inside"), rig.value("door")), ((24.5, true), (1.0, true)));
    assert_eq!((rig.value("heater_t"), rig.value("heater")), ((-7.0, true), (0.0, true)));
    assert_eq!(rig.value("fan"), (50.0, true));
    rig.command("fan", 20.0);
    rig.command("heater", 60.0);
    rig.robot.pass(0.3);
    assert_eq!((rig.value("fan"), rig.value("heater")), ((20.0, true), (60.0, true)));
    rig.robot.pass(1.2);
    assert_eq!((rig.value("fan"), rig.value("heater")), ((50.0, true), (0.0, true)));
    let target = "io.serial.climate".into();
    let fault = CmdFault { timestamp: 0, target, fault: "silent".into(), value: 0.0, duration: 4.0 };
    rig.robot.machine.inject(rig.robot.machine.now(), fault);
    rig.robot.pass(3.9);
    assert_eq!(rig.news(), ["Error IoDeviceLost io.serial.climate device", "ERROR"]);
    assert_eq!((rig.value("inside").1, rig.value("heater_t").1), (false, true));
    rig.robot.pass(3.0);
    assert_eq!(rig.news(), ["Notice IoDeviceLost io.serial.climate device", "RUN"]);
    assert_eq!(rig.value("inside"), (24.5, true));
}

#[test]
fn outputs_show_what_the_robot_does() {
    let mut rig = Rig::with("signals", SIGNALS);
    let names = ["horn", "left", "beacon"];
    // Rising edges of each output.
    let watch = |rig: &mut Rig, seconds: f64| {
        let (mut was, mut rises) = (names.map(|name| rig.value(name).0), [0; 3]);
        for _ in 0..(seconds / 0.02) as u32 {
            rig.robot.pass(0.02);
            let is = names.map(|name| rig.value(name).0);
            for n in 0..3 {
                rises[n] += u32::from(is[n] > was[n]);
            }
            was = is;
        }
        rises
    };
    assert_eq!(watch(&mut rig, 3.0), [0; 3], "the robot stands");
    rig.robot.drive_anew(0.4, 0.5, 6.0);
    let [horn, left, beacon] = watch(&mut rig, 5.0);
    assert_eq!(horn, 1, "once, at the start");
    assert!((7..=10).contains(&left), "{left}: twice a second");
    assert!((9..=10).contains(&beacon), "{beacon}: two of a second");
    let fault = CmdFault { target: "psc1".into(), fault: "stop_button".into(), duration: 3.0, ..CmdFault::default() };
    rig.robot.machine.inject(rig.robot.machine.now(), fault);
    rig.robot.pass(2.5);
    assert_eq!(names.map(|name| rig.value(name)), [(0.0, true), (0.0, true), (1.0, true)]);
    // A person lights the left lamp meanwhile.
    rig.command("left", 1.0);
    rig.robot.pass(0.3);
    assert_eq!(rig.value("left"), (1.0, true));
    rig.robot.pass(1.2);
    assert_eq!(rig.value("left"), (0.0, true));
    assert_eq!(rig.news(), ["INIT", "RUN"]);
}

#[test]
fn a_computer_is_shut_down_by_its_button_before_its_supply_is_cut() {
    let mut rig = Rig::with("computer", COMPUTER);
    let switch = |rig: &mut Rig, action| {
        rig.robot.machine.inject(rig.robot.machine.now(), CmdPower { timestamp: 0, device: 1, action });
    };
    let supplied = |rig: &Rig| {
        let power = rig.observed.borrow().power.clone().expect("LL_DATA_POWER each second");
        power.channels.iter().find(|channel| channel.name == "computer1").expect("all channels").on
    };
    assert!(rig.value("power_led") == (1.0, true) && supplied(&rig));
    switch(&mut rig, CmdPower::OFF);
    rig.robot.pass(0.2);
    assert_eq!(rig.value("power_button"), (1.0, true));
    rig.robot.pass(1.0);
    assert_eq!((rig.value("power_button"), supplied(&rig)), ((0.0, true), true));
    // The simulated one needs half of its time.
    let pressed = rig.robot.machine.now();
    while rig.value("power_led").0 == 1.0 {
        rig.robot.pass(0.1);
        assert!(supplied(&rig), "it is not down yet");
        assert!(rig.robot.machine.now().since(pressed) < Duration::from_secs(8), "it does not shut down");
    }
    rig.robot.pass(4.5);
    assert!(!supplied(&rig));
    switch(&mut rig, CmdPower::ON);
    rig.robot.pass(4.0);
    assert!(rig.value("power_led") == (1.0, true) && supplied(&rig), "it starts with its supply");
    assert_eq!(rig.observed.borrow().computers, [] as [String; 0]);
    // It hangs, and loses its supply nevertheless.
    let fault = CmdFault { target: "computer1".into(), fault: "silent".into(), duration: 60.0, ..CmdFault::default() };
    rig.robot.machine.inject(rig.robot.machine.now(), fault);
    switch(&mut rig, CmdPower::OFF);
    rig.robot.pass(9.0);
    assert!(supplied(&rig));
    rig.robot.pass(4.0);
    assert!(!supplied(&rig) && rig.value("power_led") == (0.0, true));
    assert_eq!(rig.observed.borrow().computers, ["Warning ComputerStuck computer1"]);
}

#[test]
fn before_the_supply_is_cut_the_computers_are_asked_to_shut_down_while_the_modules_end() {
    let mut rig = Rig::with("shutdown", COMPUTER);
    rig.robot.drive_anew(0.4, 0.0, 5.0);
    rig.robot.pass(1.5);
    let fault = CmdFault { target: "psc1".into(), fault: "power_off".into(), value: 30.0, ..CmdFault::default() };
    rig.robot.machine.inject(rig.robot.machine.now(), fault);
    rig.robot.pass(5.0);
    assert!(rig.robot.speed().abs() < 0.001, "it does not wait for the computer");
    assert!(!rig.news().contains(&"TERMINATE".into()), "the power LED is still read");
    rig.robot.pass(4.0);
    assert_eq!(rig.value("power_led").0, 0.0);
    assert!(rig.news().contains(&"TERMINATE".into()));
}

/// A switch on the 1-Wire bus, beside its thermometers.
const SWITCH: &str = r#"
[[io.w1]]
name = "lamp"
id = "3a-000000000007"
channel = "A"
output = true
safe = 0
hold_s = 5
[[io.w1]]
name = "door"
id = "3a-000000000007"
channel = "B"
active_low = true
simulated = true
"#;

#[test]
fn switches_on_the_bus_of_the_thermometers_are_outputs_and_inputs() {
    let mut rig = Rig::with("w1", SWITCH);
    assert_eq!(rig.news(), ["INIT", "RUN"]);
    assert_eq!((rig.value("lamp"), rig.value("door")), ((0.0, true), (1.0, true)));
    rig.command("lamp", 1.0);
    // Measurements of thermometers may come first.
    rig.robot.pass(3.0);
    assert_eq!(rig.value("lamp"), (1.0, true));
    rig.robot.pass(5.0);
    assert_eq!(rig.value("lamp"), (0.0, true));
    assert!(rig.news().is_empty());
}

/// An emergency stop on a Modbus device, and one on a digital input of the steering's drive.
const STOPS: &str = r#"
[io.modbus.plc]
address = "127.0.0.1:1502"
signals = [{ name = "estop", table = "discrete", address = 0, simulated = 1 }]
[[stop.inputs]]
signal = "estop"
[[stop.inputs]]
axis = "steering"
bit = 16
"#;

#[test]
fn an_input_of_stop_that_opens_or_is_not_known_stops_the_robot_and_nothing_resumes_by_itself() {
    let mut rig = Rig::with("stops", STOPS);
    // Unplugged, it is noticed after 0.5 s.
    for (target, fault, value) in [("steering", "opened", 16.0), ("modbus.plc", "silent", 0.0)] {
        rig.robot.drive_anew(0.3, 0.0, 8.0);
        rig.robot.pass(2.0);
        assert!(rig.robot.speed() > 0.25, "{fault}: {} m/s, {:?}", rig.robot.speed(), rig.robot.hold());
        let now = rig.robot.machine.now();
        let (target, fault) = (target.to_owned(), fault.to_owned());
        let open = CmdFault { target, fault: fault.clone(), value, duration: 2.0, ..CmdFault::default() };
        rig.robot.machine.inject(now, open);
        // 0.5 s, and the way from 0.3 m/s to standstill.
        rig.robot.pass(1.2);
        assert_eq!(rig.robot.hold(), Some(Hold::PauseInput), "{fault}");
        assert!(rig.robot.speed().abs() < 0.01, "{fault}: {} m/s", rig.robot.speed());
        rig.robot.pass(6.0);
        assert_eq!(rig.robot.hold(), Some(Hold::PauseLatched), "{fault}");
        assert!(rig.robot.speed().abs() < 0.01, "{fault}: it resumed by itself");
    }
}
