//! Temperatures and fans of the whole robot: faults there are reported, and the robot continues to drive.

use super::{Robot, place};
use base::Duration;
use messages::{Message, lowlevel, simulation};
use module::State;
use robot::place::RobotLocation;
use sim::host::{Config, News};
use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

#[derive(Default)]
struct Observed {
    /// Reports and notes of `driver_aux`, in order.
    news: Vec<String>,
    temperatures: Option<lowlevel::DataTemperature>,
    bus: Option<lowlevel::DataBus>,
}

impl Observed {
    fn take(&mut self, news: &News<'_>) {
        match news {
            News::Report { module: "driver_aux", report } => {
                self.news.push(format!("{:?} {} {}", report.severity, report.fault.name(), report.subject));
            }
            News::State { module: "driver_aux", state } => self.news.push(state.to_string()),
            News::Note { module: "driver_aux", line } => self.news.push((*line).into()),
            News::Message { message: Message::LlDataTemperature(message), .. } => {
                self.temperatures = Some(message.clone());
            }
            News::Message { message: Message::LlDataBus(bus), .. } if bus.bus == "i2c.aux" => {
                self.bus = Some(bus.clone());
            }
            _ => {}
        }
    }
}

struct Rig {
    robot: Robot,
    observed: Rc<RefCell<Observed>>,
}

impl Rig {
    fn new(seed: u64) -> Self {
        Self::of(Robot::ready(seed))
    }

    fn of(mut robot: Robot) -> Self {
        let observed = Rc::new(RefCell::new(Observed::default()));
        let keep = observed.clone();
        robot.machine.observe(move |_, news| keep.borrow_mut().take(news));
        robot.pass(3.0);
        let mut rig = Self { robot, observed };
        rig.news();
        rig
    }

    fn fault(&mut self, target: &str, fault: &str, value: f64, seconds: f64) {
        let (target, fault, now) = (target.into(), fault.into(), self.robot.machine.now());
        self.robot.machine.inject(now, simulation::CmdFault { timestamp: 0, target, fault, value, duration: seconds });
    }

    fn news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.observed.borrow_mut().news)
    }

    fn temperature(&self, name: &str) -> lowlevel::Temperature {
        let observed = self.observed.borrow();
        let all = &observed.temperatures.as_ref().unwrap().temperatures;
        all.iter().find(|temperature| temperature.name == name).unwrap().clone()
    }

    fn fan(&self, name: &str) -> lowlevel::Fan {
        let observed = self.observed.borrow();
        observed.temperatures.as_ref().unwrap().fans.iter().find(|fan| fan.name == name).unwrap().clone()
    }

    /// None of these faults stops the robot.
    fn drives(&mut self) {
        let seconds = 1.5;
        self.robot.drive(0.3, 0.0, seconds);
        self.robot.pass(seconds - 0.1);
        assert!(self.robot.speed() > 0.25, "{}", self.robot.motion().reason);
        self.robot.pass(2.0);
    }
}

#[test]
fn temperatures_and_fans_are_published_with_little_bus_load() {
    let mut rig = Rig::new(1);
    rig.robot.pass(8.0);
    let names = |observed: &Observed| {
        let message = observed.temperatures.clone().unwrap();
        let temperatures = message.temperatures.into_iter().map(|temperature| temperature.name);
        temperatures.chain(message.fans.into_iter().map(|fan| fan.name)).collect::<Vec<_>>()
    };
    let expected = ["box", "drives", "battery", "cabin", "fan_left", "fan_right"];
    assert_eq!(names(&rig.observed.borrow()), expected);
    assert!(
        (30.0..45.0).contains(&rig.temperature("box").value)
            && (20.0..25.0).contains(&rig.temperature("battery").value)
    );
    let fan = rig.fan("fan_left");
    assert!(fan.duty > 0.15 && fan.rpm > 400.0 && !fan.failed, "{fan:?}");
    let bus = rig.observed.borrow().bus.clone().unwrap();
    assert_eq!((bus.state, bus.errors, bus.nodes[0].state), (lowlevel::DataBus::ACTIVE, 0, lowlevel::Node::OK));
    assert!((0.004..0.01).contains(&bus.load), "{}", bus.load);
    assert!((bus.nodes[0].round_trip_mean - 400e-6).abs() < 1e-9, "{}", bus.nodes[0].round_trip_mean);
    assert_eq!(rig.news(), [""; 0]);
}

#[test]
fn an_over_temperature_is_reported_the_fans_run_and_it_is_cleared() {
    let mut rig = Rig::new(2);
    rig.fault("fan1", "hot", 70.0, 12.0);
    rig.robot.pass(8.0);
    assert_eq!(rig.news(), ["Error OverTemperature box"]);
    assert!(rig.temperature("box").over && rig.fan("fan_left").duty > 0.9);
    rig.fault("battery", "hot", 60.0, 3.0);
    rig.robot.pass(8.0);
    let told = rig.news();
    for line in ["Error OverTemperature battery", "Notice OverTemperature battery", "Notice OverTemperature box"] {
        assert!(told.iter().any(|news| news == line), "{told:?}");
    }
    assert_eq!(told.len(), 3);
    rig.drives();
}

#[test]
fn a_blocked_fan_is_reported_and_the_other_compensates() {
    let mut rig = Rig::new(3);
    rig.robot.pass(5.0);
    rig.fault("fan1", "stall", 2.0, 15.0);
    rig.robot.pass(12.0);
    assert_eq!(rig.news(), ["Error FanFailed fan_right"]);
    assert!(rig.fan("fan_right").failed && rig.fan("fan_left").duty > 0.9);
    rig.robot.pass(15.0);
    assert_eq!(rig.news(), ["Notice FanFailed fan_right"]);
}

#[test]
fn a_chip_that_is_lost_is_an_error_of_its_module_alone_and_comes_back() {
    for (seed, fault) in [(4, "silent"), (5, "wrong"), (6, "hold")] {
        let mut rig = Rig::new(seed);
        rig.fault("fan1", fault, 0.0, 5.0);
        rig.robot.pass(3.0);
        assert_eq!(rig.news(), ["Error ChipLost fan1", "ERROR"], "{fault}");
        assert!(rig.temperature("box").value.is_nan() && !rig.temperature("battery").value.is_nan());
        let node = rig.observed.borrow().bus.as_ref().unwrap().nodes[0].state;
        assert_eq!(node, lowlevel::Node::LOST);
        let pid = rig.robot.machine.pid("driver_canbus").unwrap();
        assert_eq!(rig.robot.machine.state(pid), Some(State::Run));
        rig.robot.pass(4.0);
        let told = rig.news();
        assert_eq!(told[1..], ["Notice ChipLost fan1", "RUN"], "{fault}: {told:?}");
    }
}

#[test]
fn a_disconnected_thermometer_is_a_state_and_not_an_error() {
    let mut rig = Rig::new(7);
    rig.fault("battery", "silent", 0.0, 5.0);
    rig.robot.pass(4.0);
    assert_eq!(rig.news(), ["battery (28-000000000001 on w1): not connected"]);
    assert!(rig.temperature("battery").value.is_nan());
    rig.robot.pass(5.0);
    assert_eq!(rig.news(), ["battery (28-000000000001 on w1): connected"]);
    assert!((20.0..25.0).contains(&rig.temperature("battery").value));
    rig.fault("cabin", "wrong", 0.0, 20.0);
    rig.robot.pass(10.0);
    assert_eq!(rig.news(), ["Warning ThermometerBad cabin"]);
    rig.drives();
}

#[test]
fn the_chip_is_found_again_after_a_restart_of_the_simulator() {
    let mut rig = Rig::new(8);
    rig.robot.machine.kill(rig.robot.machine.pid("driver_aux").unwrap());
    rig.robot.pass(3.0);
    let told = rig.news();
    assert!(told.contains(&"RUN".into()) && told.iter().any(|line| line.contains("MAX6615 revision 1")), "{told:?}");
}

#[test]
fn temperatures_of_the_computer_are_beside_the_others_and_heat_is_reported() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("host-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let shipped = place();
    for file in ["sim.toml", "modules.toml"] {
        std::fs::copy(shipped.config.join(file), folder.join(file)).expect("the shipped configuration");
    }
    let robot = std::fs::read_to_string(shipped.config.join("robot.toml")).expect("the shipped configuration");
    let host = "[host]\nfolder = \"host\"\nsensors = [{ zone = \"cpu-thermal\", name = \"host.cpu\", limit_c = 80 }]\n";
    std::fs::write(folder.join("robot.toml"), robot + host).expect("a file");
    let config = Config { seed: 9, lcm_jitter: Duration::from_micros(200), ..Config::default() };
    let mut robot = Robot::at(&RobotLocation { config: folder, ..shipped }, config);
    robot.pass(12.0);
    let mut rig = Rig::of(robot);
    assert!((40.0..60.0).contains(&rig.temperature("host.cpu").value), "{:?}", rig.temperature("host.cpu"));
    assert!(!rig.temperature("box").value.is_nan());
    rig.fault("host.cpu", "hot", 105.0, 5.0);
    rig.robot.pass(4.0);
    assert!(rig.temperature("host.cpu").over);
    assert_eq!(rig.news(), ["Error OverTemperature host.cpu", "Warning HostThrottled host"]);
    rig.drives();
    rig.robot.pass(4.0);
    assert_eq!(rig.news(), ["Notice OverTemperature host.cpu", "Notice HostThrottled host"]);
    rig.fault("host.cpu", "silent", 0.0, 5.0);
    rig.robot.pass(3.0);
    assert!(rig.temperature("host.cpu").value.is_nan() && !rig.temperature("box").value.is_nan());
}
