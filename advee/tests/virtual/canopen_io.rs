//! CANopen devices with inputs and outputs, and a battery by table, of the whole robot: emulated on the bus of the
//! drives, faults included.

use super::{Robot, with_tables};
use base::Duration;
use messages::lowlevel::{CmdOutput, DataBattery, DataIo, DataNodeIo, NodeValue};
use messages::simulation::CmdFault;
use messages::{Hold, Message};
use module::admission::{Process, Sender, Way};
use sim::host::{Config, News};
use std::cell::RefCell;
use std::rc::Rc;

/// An I/O module, and a battery whose objects are the maker's.
const DEVICES: &str = r#"
[io.canopen.plc]
node = 20
vendor = 0x1234
product = 7
signals = [
    { name = "gate", kind = "digital-in", channel = 4, simulated = 1 },
    { name = "level", kind = "analogue-in", channel = 1, scale = 0.01, simulated = -1.5 },
    { name = "lamp", kind = "digital-out", channel = 0, safe = 0 },
    { name = "valve", kind = "analogue-out", channel = 0, scale = 0.5, safe = 0 },
]
[io.canopen.pack]
node = 21
profile = 0
pdo = false
signals = [
    { name = "volts", kind = "object", index = 0x2060, format = "u16", scale = 0.01, simulated = 25.2 },
    { name = "amps", kind = "object", index = 0x2061, format = "i16", scale = 0.1, simulated = -4.5 },
    { name = "soc", kind = "object", index = 0x2081, format = "u8", scale = 0.01, simulated = 0.75 },
]
[[io.battery]]
name = "main"
voltage = "volts"
current = "amps"
charge = "soc"
"#;

/// The gate stops the robot.
const STOP: &str = "[[stop.inputs]]\nsignal = \"gate\"\n";

#[derive(Default)]
struct Observed {
    io: Option<DataIo>,
    battery: Option<DataBattery>,
    reports: Vec<String>,
}

struct Rig {
    robot: Robot,
    observed: Rc<RefCell<Observed>>,
}

impl Rig {
    /// The shipped robot with these tables; `fault` from the start on.
    fn with(name: &str, tables: &str, fault: Option<CmdFault>) -> Self {
        let place = with_tables(&format!("canopen-{name}"), tables);
        let config = Config { seed: 7, lcm_jitter: Duration::from_micros(200), ..Config::default() };
        let mut robot = Robot::at(&place, config);
        let observed = Rc::new(RefCell::new(Observed::default()));
        let keep = observed.clone();
        robot.machine.observe(move |_, news| {
            let mut observed = keep.borrow_mut();
            match news {
                News::Message { message: Message::LlDataIo(io), .. } => observed.io = Some(io.clone()),
                News::Message { message: Message::LlDataBattery(battery), .. } => {
                    observed.battery = Some(battery.clone());
                }
                News::Report { module: "driver_canbus", report } => {
                    observed.reports.push(format!("{:?} {} {}", report.severity, report.fault.name(), report.subject));
                }
                _ => {}
            }
        });
        if let Some(fault) = fault {
            robot.pass(0.5);
            robot.machine.inject(robot.machine.now(), fault);
        }
        robot.pass(12.0);
        Self { robot, observed }
    }

    fn value(&self, name: &str) -> (f64, bool) {
        let observed = self.observed.borrow();
        let signal = observed.io.as_ref().unwrap().signals.iter().find(|signal| signal.name == name).unwrap();
        (signal.value, signal.valid)
    }

    fn reports(&self) -> Vec<String> {
        std::mem::take(&mut self.observed.borrow_mut().reports)
    }

    fn inject(&mut self, target: &str, fault: &str, value: f64, duration: f64) {
        let now = self.robot.machine.now();
        self.robot.machine.inject(now, injected(target, fault, value, duration));
    }

    /// Passes until a cause holds the motion after a fault, at most two seconds; the time that it took.
    fn until(&mut self, hold: Hold, fault: &str) -> Duration {
        let begin = self.robot.machine.now();
        while self.robot.hold() != Some(hold) {
            self.robot.pass(0.001);
            let took = self.robot.machine.now().since(begin);
            assert!(
                took < Duration::from_secs(2),
                "{fault}: {:?} instead of {hold:?}; {:?}",
                self.robot.hold(),
                self.reports()
            );
        }
        self.robot.machine.now().since(begin)
    }
}

fn injected(target: &str, fault: &str, value: f64, duration: f64) -> CmdFault {
    CmdFault { timestamp: 0, target: target.into(), fault: fault.into(), value, duration }
}

#[test]
fn inputs_and_outputs_of_canopen_devices_and_a_battery_by_table_are_signals_as_any_others() {
    let mut rig = Rig::with("values", DEVICES, None);
    assert_eq!(rig.reports(), [] as [String; 0]);
    assert_eq!((rig.value("gate"), rig.value("level")), ((1.0, true), (-1.5, true)));
    assert_eq!((rig.value("lamp"), rig.value("valve")), ((0.0, true), (0.0, true)));
    let battery = rig.observed.borrow().battery.clone().unwrap();
    assert_eq!((&*battery.name, battery.voltage, battery.current, battery.charge), ("main", 25.2, -4.5, 0.75));
    for (name, value) in [("lamp", 1.0), ("valve", 20.0)] {
        let output = CmdOutput { timestamp: 0, name: name.into(), value, source: "test".into() };
        rig.robot.machine.inject(rig.robot.machine.now(), output);
    }
    rig.robot.pass(0.1);
    assert_eq!((rig.value("lamp"), rig.value("valve")), ((1.0, true), (20.0, true)));
    rig.robot.pass(1.2);
    assert_eq!((rig.value("lamp"), rig.value("valve")), ((0.0, true), (0.0, true)), "nobody repeats the command");
    // A device that is silent: its values are unknown, the other's are not, and the robot drives on.
    rig.inject("canopen.plc", "silent", 0.0, 3.0);
    rig.robot.drive_anew(0.3, 0.0, 2.5);
    rig.robot.pass(2.0);
    assert!(rig.robot.speed() > 0.25, "{}", rig.robot.motion().reason);
    assert_eq!(rig.value("gate"), (1.0, false), "the last one stays, as not valid");
    assert_eq!((rig.value("lamp").1, rig.value("volts").1), (false, true));
    assert_eq!(rig.reports(), ["Error IoDeviceLost canopen.plc"]);
    rig.robot.pass(5.0);
    assert_eq!((rig.value("gate"), rig.value("lamp")), ((1.0, true), (0.0, true)));
    assert_eq!(rig.reports(), ["Notice IoDeviceLost canopen.plc"]);
}

#[test]
fn values_of_canopen_devices_are_not_accepted_from_another_sender_than_their_driver() {
    let mut rig = Rig::with("stranger", DEVICES, None);
    let begin = rig.robot.machine.now();
    for n in 0..50 {
        let values = vec![NodeValue { name: "level".into(), value: 7.0 }];
        let stranger = Sender { way: Way::Memory, process: Some(Process { pid: 0, uid: 0 }) };
        let at = begin + n * Duration::from_millis(10);
        rig.robot.machine.inject_by(at, stranger, DataNodeIo { timestamp: 0, values });
    }
    for _ in 0..100 {
        rig.robot.pass(0.005);
        assert_eq!(rig.value("level"), (-1.5, true));
    }
}

#[test]
fn an_input_of_stop_at_a_canopen_device_stops_the_robot_within_its_bound_whatever_the_device_does() {
    let mut rig = Rig::with("stops", &format!("{DEVICES}{STOP}"), None);
    // Open: by its TPDO. Silent: by its heartbeat. Lies: by age, 0.5 s after the last answer. Restarts: by its boot-up
    // message, 0.1 s later.
    let cases = [
        ("opened", 4.0, Hold::PauseInput, Duration::from_millis(10)),
        ("silent", 0.0, Hold::PauseInputUnknown, Duration::from_millis(510)),
        ("reboot", 0.0, Hold::PauseInputUnknown, Duration::from_millis(120)),
        ("bad_length", 0.0, Hold::PauseInputUnknown, Duration::from_millis(510)),
        ("layout", 0.0, Hold::PauseInputUnknown, Duration::from_millis(510)),
    ];
    for (fault, value, hold, bound) in cases {
        rig.robot.drive_anew(0.3, 0.0, 12.0);
        rig.robot.pass(2.0);
        assert!(rig.robot.speed() > 0.25, "{fault}: {} m/s, {:?}", rig.robot.speed(), rig.robot.hold());
        rig.inject("canopen.plc", fault, value, 2.0);
        let took = rig.until(hold, fault);
        assert!(took <= bound, "{fault}: {took:?}");
        rig.robot.pass(1.0);
        assert!(rig.robot.speed().abs() < 0.01, "{fault}: {} m/s", rig.robot.speed());
        rig.robot.pass(2.0);
        rig.inject("canopen.plc", "none", 0.0, 0.0);
        rig.robot.pass(4.0);
        assert_eq!(rig.robot.hold(), Some(Hold::PauseLatched), "{fault}");
        rig.robot.pass(3.0);
        assert!(rig.robot.speed().abs() < 0.01, "{fault}: it resumed by itself");
    }
}

#[test]
fn a_device_that_is_missing_or_another_one_at_the_start_keeps_the_robot_if_an_input_of_it_stops_it() {
    for fault in ["silent", "layout"] {
        let fault_from_the_start = injected("canopen.plc", fault, 0.0, 0.0);
        let tables = format!("{DEVICES}{STOP}");
        let mut rig = Rig::with(fault, &tables, Some(fault_from_the_start));
        rig.robot.drive_anew(0.3, 0.0, 1.0);
        rig.robot.pass(1.0);
        assert!(rig.robot.speed().abs() < 0.01, "{fault}");
        let holds: Vec<Hold> =
            rig.robot.seen.borrow().holds.holds.iter().filter_map(messages::lowlevel::Hold::cause).collect();
        assert!(holds.contains(&Hold::PauseInputUnknown), "{fault}: {holds:?}");
        assert!(rig.reports().contains(&"Error IoDeviceLost canopen.plc".into()), "{fault}");
        assert!(!rig.value("gate").1 && rig.value("volts").1, "{fault}");
    }
}
