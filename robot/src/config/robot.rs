//! `robot.toml`: what the robot is made of. Each module declares its own keys; here they are put together, and checked
//! against each other.

use super::modules::LEVELS;
use base::{Duration, Level, Severity};
use bridge::settings::{Link, forwarded, sharing_a_key};
use drivers::auxiliary::{Chips, HostSensors, ThermometerKeys};
use drivers::canbus::PauseStop;
use drivers::canbus::ranging::RangingBoard;
use drivers::rs485_bus::{Kind, Node};
use drivers::rs485a::Ranger;
use drivers::{canbus, imu, io, joydev, lidar, power, rs485_bus};
use estimator::filter;
use host::ports::settings::{
    BytePort, CanInterface, CanPort, GamepadPort, HostPort, I2cPlace, I2cPort, ImuPort, LidarPort, LinePort,
    SerialPort, StreamPort, W1Port,
};
use host::ports::{PortConfig, TerminalConfig};
use module::Line;
use module::admission::Commands;
use navitools::{Point, Pose};
use ros2::settings::Ros2;
use settings::robot::{Base, BaseKeys, Beacon, DrivenAxle, Geometry, Limits};
use settings::{Bytes, Choice, Section as _, Table, settings};
use std::path::{Path, PathBuf};
use web::settings::Web;

settings! {
    /// `robot.toml`: what the robot is made of. SI units; angles in radians, counter-clockwise. The robot's frame has
    /// its origin on the floor under the middle of the rear axle, x forward, y to the left.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Robot {
        /// The robot as a whole.
        robot as general: General = required;
        /// The LCM bus.
        bus: BusSettings = table;
        /// Measures.
        geometry as lengths: Geometry = required;
        /// Kind of the base, and the places of its wheels.
        base as kind: Option<BaseKeys> = optional;
        /// Measures, with the wheels of a base that steers.
        measures as geometry: Geometry = unset kind.map_or(lengths, |kind| kind.measures(lengths));
        /// Wheels of a base without steering.
        wheels as base: Option<Base> = unset kind.and_then(|kind| kind.base());
        /// Bounds of motion.
        limits: Limits = required;
        /// How the robot comes to a stand.
        stop: canbus::Stop = table;
        /// CAN buses by name.
        can: Vec<CanBus> = named;
        /// EIA-485 buses by name.
        rs485: Vec<Rs485Bus> = named;
        /// Serial lines with a drive of wheels each, by name (docs/motor-controllers.md).
        serial: Vec<SerialLine> = named;
        /// I2C buses by name.
        i2c: Vec<I2cBus> = named;
        /// The 1-Wire bus.
        w1: Option<W1> = optional;
        /// Temperatures of the computer.
        host: Option<Host> = optional;
        /// Inputs and outputs by name (docs/io.md).
        io: Option<Io> = optional;
        /// What the robot does, shown on outputs (docs/io.md).
        signals: io::Shows = table;
        /// Lidars by name (docs/lidars.md).
        lidar: Vec<Lidar> = named;
        /// Inertial measurement units by name (docs/imu.md).
        imu: Vec<Imu> = named;
        /// Sonars.
        srfs: Vec<Ranger> = [];
        /// Infrared rangers.
        irs: Vec<Ranger> = [];
        /// Properties of sensors, whichever board serves them.
        sensors: Sensors = table;
        /// Infrared beacons of where the robot drives, in the frame of the map; those of the world in simulation.
        beacons: Vec<Beacon> = [];
        /// Accuracy of the sensors of the pose.
        estimator: filter::Config = table;
        /// The power controller and its battery. With this table the robot does not move unless the state of the PAUSE
        /// line is known.
        power: Option<power::Config> = optional;
        /// The gamepad (docs/gamepad.md).
        gamepad was joystick: Option<Gamepad> = optional;
        /// What senses what is in the way, and bounds the speed by it (docs/guard.md).
        guard: guard::Settings = table;
        /// Behaviour of the robot that drives by itself.
        planner: planner::Settings = table;
        /// Records of a run.
        log: Log = table;
        /// The web server.
        web: Web = table;
        /// The robot as a node of ROS 2 (docs/ros2.md).
        ros2: Ros2 = table;
        /// Connections to the other computers of the robot by name (docs/two-computers.md).
        bridge: Vec<Link> = named;
    }
    check Robot::check;
}

settings! {
    /// `[robot]`: the robot as a whole.
    #[derive(Clone, Debug, PartialEq)]
    pub struct General {
        /// Its name.
        name: String = required;
        /// Lowest severity of reports that are printed, and published on `CM_EVENT_ERROR`.
        report_from: Severity = Severity::Notice, Choice(&[
            ("notice", Severity::Notice), ("warning", Severity::Warning), ("error", Severity::Error)
        ]);
        /// Lowest level of texts and reports that are printed. Absent: `report_from` for reports, `"info"` for texts.
        print_from: Option<Level> = optional, LEVELS;
        /// Lowest level of texts and reports that are published. Absent: `report_from` for reports, `"info"` for texts.
        send_from: Option<Level> = optional, LEVELS;
    }
}

settings! {
    /// `[bus]`: the LCM bus.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct BusSettings {
        /// Who may command the robot: `"memory"`: programs of the robot's users, through shared memory; `"host"`: any
        /// program of this computer, as with the official LCM; `"network"`: any program of any computer that the bus
        /// reaches (`ttl` in the LCM URL). What stops the robot is accepted from any sender; that all is well, only
        /// from the robot's watchdog, power controller, guard and ranging boards (docs/lcm.md).
        commands: Commands = Commands::Host, Choice(&[
            ("memory", Commands::Memory), ("host", Commands::Host), ("network", Commands::Network)
        ]);
    }
}

settings! {
    /// `[can.<name>]`: a CAN bus.
    #[derive(Clone, Debug, PartialEq)]
    pub struct CanBus {
        name: String = key;
        port: CanPort = flat;
        driver: canbus::BusConfig = flat;
    }
}

settings! {
    /// `[rs485.<name>]`: an EIA-485 bus.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Rs485Bus {
        name: String = key;
        line: SerialPort = flat;
        driver: rs485_bus::BusConfig = flat;
    }
}

settings! {
    /// `[serial.<name>]`: a serial line with a drive of one or two wheels.
    #[derive(Clone, Debug, PartialEq)]
    pub struct SerialLine {
        name: String = key;
        port: LinePort = flat;
        driver: canbus::LineKeys = flat;
    }
}

settings! {
    /// `[i2c.<name>]`: an I2C bus.
    #[derive(Clone, Debug, PartialEq)]
    pub struct I2cBus {
        name: String = key;
        port: I2cPort = flat;
        driver: Chips = flat;
    }
}

settings! {
    /// `[w1]`: the 1-Wire bus.
    #[derive(Clone, Debug, PartialEq)]
    pub struct W1 {
        port: W1Port = flat;
        driver: ThermometerKeys = flat;
    }
}

settings! {
    /// `[host]`: temperatures of the computer (docs/i2c.md).
    #[derive(Clone, Debug, PartialEq)]
    pub struct Host {
        port: HostPort = flat;
        driver: HostSensors = flat;
    }
}

settings! {
    /// `[io]`: inputs and outputs by name.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Io {
        /// Period of `LL_DATA_IO` and `LL_DATA_BATTERY`.
        publish_s as publish: Duration = 1.0, 0.05..=60.0;
        /// Modbus lines by name.
        modbus: Vec<ModbusBus> = named;
        /// Serial lines with devices of simple request and answer, by name.
        serial: Vec<IoLine> = named;
        /// GPIO lines of the computer.
        gpio: Vec<io::GpioKeys> = [];
        /// Channels of switches on the 1-Wire bus.
        w1: Vec<io::SwitchKeys> = [];
        /// Channels of the power controller that are outputs.
        power: Vec<io::PowerKeys> = [];
        /// CANopen devices on the bus of the drives, by name.
        canopen: Vec<CanopenDevice> = named;
        /// Batteries whose values are inputs.
        battery: Vec<io::BatteryKeys> = [];
    }
    check Io::check;
}

settings! {
    /// `[io.modbus.<name>]`: a Modbus line, serial or a TCP connection.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ModbusBus {
        name: String = key;
        port: StreamPort = flat;
        driver: io::ModbusKeys = flat;
    }
}

settings! {
    /// `[io.serial.<name>]`: a serial line, or a serial server, with devices of simple request and answer.
    #[derive(Clone, Debug, PartialEq)]
    pub struct IoLine {
        name: String = key;
        port: BytePort = flat;
        driver: io::SerialKeys = flat;
    }
}

settings! {
    /// `[io.canopen.<name>]`: a CANopen device with inputs and outputs.
    #[derive(Clone, Debug, PartialEq)]
    pub struct CanopenDevice {
        name: String = key;
        driver: io::CanopenKeys = flat;
    }
}

settings! {
    /// `[lidar.<name>]`: a lidar, on a serial line or a TCP connection.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Lidar {
        name: String = key;
        port: LidarPort = flat;
        driver: lidar::LidarKeys = flat;
        stop: lidar::StopKeys = flat;
    }
    check Lidar::check;
}

settings! {
    /// `[imu.<name>]`: an inertial measurement unit, on a serial line, an I2C or a CAN bus.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Imu {
        name: String = key;
        port: ImuPort = flat;
        driver: imu::ImuKeys = flat;
    }
}

settings! {
    /// `[sensors]`: properties of sensors.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Sensors {
        /// The sonars of `srfs`.
        srf08: Srf08 = table;
        /// Greatest age of a range finder's measurement by which the robot drives, since it fired: two polls of 4 Hz
        /// and a bit. Older is unknown: the robot stops.
        age_max_s as age_max: Duration = 0.6, 0.3..=2.0;
    }
}

settings! {
    /// `[sensors.srf08]`
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Srf08 {
        /// Full opening angle of the beam at -6 dB; 0.96 is 55° (docs/facts/robot.md 2.1).
        beam_rad: f64 = 0.96, 0.05..=3.0;
    }
}

settings! {
    /// `[gamepad]`: the gamepad.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Gamepad {
        port: GamepadPort = flat;
        driver: joydev::Config = flat;
    }
}

settings! {
    /// `[log]`: records of a run.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Log {
        /// The host of each module records what the module receives and answers, for `advee replay` (docs/replay.md).
        inputs: bool = false;
        /// Maximum size of one such file.
        inputs_max_bytes: u64 = 256_000_000, Bytes(1e6..=1e12);
        /// Folder that gets a folder for each run, from the configuration folder on. Absent: `log` in a checkout, else
        /// `/opt/advee/log`.
        folder: Option<PathBuf> = optional;
        logger: logger::Config = flat;
    }
}

impl Io {
    fn check(&self, table: &Table<'_>) {
        let gpio = self.gpio.iter().map(|line| &line.name);
        let signals = self.modbus.iter().flat_map(|bus| &bus.driver.signals).map(|signal| &signal.name);
        let w1 = self.w1.iter().map(|keys| &keys.name);
        let power = self.power.iter().map(|keys| &keys.name);
        let canopen = self.objects().map(|keys| &keys.name);
        let fields = self.fields().map(|keys| &keys.name);
        let names: Vec<&String> = signals.chain(fields).chain(gpio).chain(w1).chain(power).chain(canopen).collect();
        self.check_fields(table, &names);
        self.check_names(table, &names);
        let lines: Vec<_> = self.gpio.iter().map(|keys| (&keys.chip, &keys.line)).collect();
        table.unique("gpio", "line", &lines, "one that no other entry of this chip has");
        let powered: Vec<_> = self.power.iter().map(|keys| keys.channel).collect();
        table.unique("power", "channel", &powered, "one that no other entry has");
        let channels: Vec<_> = self.w1.iter().map(|keys| (keys.rom, keys.channel)).collect();
        table.unique("w1", "channel", &channels, "one that no other entry of this id has");
        for (n, battery) in self.battery.iter().enumerate() {
            let Some(item) = table.item("battery", n) else { continue };
            for (key, named) in battery.signals() {
                if !names.contains(&named) {
                    item.refuse(key, format_args!("the name of a signal; {named:?} is none"));
                }
            }
        }
    }

    /// Each signal has a name of its own. Those of serial lines are compared in [`Self::check_fields`].
    fn check_names(&self, table: &Table<'_>, names: &[&String]) {
        let is_taken = |name: &String| names.iter().filter(|other| **other == name).count() > 1;
        let refuse = |table: Option<&Table<'_>>, key: &str, of: &mut dyn Iterator<Item = &String>| {
            for (n, _) in of.enumerate().filter(|(_, name)| is_taken(name)) {
                if let Some(item) = table.and_then(|table| table.item(key, n)) {
                    item.refuse("name", "one that no other signal has");
                }
            }
        };
        refuse(Some(table), "gpio", &mut self.gpio.iter().map(|keys| &keys.name));
        refuse(Some(table), "w1", &mut self.w1.iter().map(|keys| &keys.name));
        refuse(Some(table), "power", &mut self.power.iter().map(|keys| &keys.name));
        for bus in &self.modbus {
            let line = table.below("modbus").and_then(|buses| buses.below(&bus.name));
            refuse(line.as_ref(), "signals", &mut bus.driver.signals.iter().map(|signal| &signal.name));
        }
    }

    /// Signals of serial lines have names of their own: the reader knows the line of a mistake.
    fn check_fields(&self, table: &Table<'_>, names: &[&String]) {
        let lines = table.below("serial");
        for line in &self.serial {
            let item = lines.as_ref().and_then(|lines| lines.below(&line.name));
            for (n, request) in line.driver.requests.iter().enumerate() {
                let item = item.as_ref().and_then(|item| item.item("requests", n));
                for (n, signal) in request.signals.iter().enumerate() {
                    let is_taken = names.iter().filter(|name| **name == &signal.name).count() > 1;
                    let item = item.as_ref().and_then(|item| item.item("signals", n)).filter(|_| is_taken);
                    item.iter().for_each(|item| item.refuse("name", "a name that no other signal of the robot has"));
                }
            }
        }
    }

    /// Signals of serial lines.
    fn fields(&self) -> impl Iterator<Item = &io::FieldKeys> {
        self.serial.iter().flat_map(|line| line.driver.signals())
    }

    /// Signals of CANopen devices.
    fn objects(&self) -> impl Iterator<Item = &io::ObjectKeys> {
        self.canopen.iter().flat_map(|device| &device.driver.signals)
    }

    /// Its CANopen devices, for `driver_canbus` and `driver_io`.
    #[must_use]
    pub fn devices(&self) -> Vec<io::Canopen> {
        let device = |device: &CanopenDevice| io::Canopen { name: device.subject(), keys: device.driver.clone() };
        self.canopen.iter().map(device).collect()
    }

    /// True if it has an output of this name that takes these values.
    fn takes(&self, name: &str, values: &[f64]) -> bool {
        let all = |takes: &dyn Fn(f64) -> bool| values.iter().all(|value| takes(*value));
        let mut modbus = self.modbus.iter().flat_map(|bus| &bus.driver.signals);
        modbus.any(|keys| keys.name == name && all(&|value| keys.takes(value)))
            || self.gpio.iter().any(|keys| keys.name == name && all(&|value| keys.takes(value)))
            || self.w1.iter().any(|keys| keys.name == name && all(&|value| keys.takes(value)))
            || self.power.iter().any(|keys| keys.name == name && all(&|value| keys.takes(value)))
            || self.objects().any(|keys| keys.name == name && all(&|value| keys.takes(value)))
            || self.fields().any(|keys| keys.name == name && all(&|value| keys.takes(value)))
    }

    /// What its output of this name has, if that follows at once: on 1-Wire a pulse could be lost, or become too long.
    fn prompt_output(&self, name: &str) -> Option<&io::OutputKeys> {
        let mut modbus = self.modbus.iter().flat_map(|bus| &bus.driver.signals);
        let found = modbus.find(|keys| keys.output && keys.name == name).map(|keys| &keys.limits);
        let gpio = || Some(&self.gpio.iter().find(|keys| keys.output && keys.name == name)?.limits);
        let canopen = || Some(&self.objects().find(|keys| keys.is_output() && keys.name == name)?.limits);
        let serial = || Some(&self.fields().find(|keys| keys.output && keys.name == name)?.limits);
        found.or_else(gpio).or_else(canopen).or_else(serial)
    }

    /// True if it has an input of this name.
    fn has_input(&self, name: &str) -> bool {
        let mut modbus = self.modbus.iter().flat_map(|bus| &bus.driver.signals);
        modbus.any(|keys| !keys.output && keys.name == name)
            || self.gpio.iter().any(|keys| !keys.output && keys.name == name)
            || self.w1.iter().any(|keys| !keys.output && keys.name == name)
            || self.objects().any(|keys| !keys.is_output() && keys.name == name)
            || self.fields().any(|keys| !keys.output && keys.name == name)
    }

    /// True if it has an input of this name that is 0 or 1, and read often enough to stop the robot.
    fn has_stop_input(&self, name: &str) -> bool {
        let is_bit = |keys: &io::SignalKeys| {
            let of_bits = matches!(keys.table, modbus::Table::Coils | modbus::Table::DiscreteInputs);
            !keys.output && keys.name == name && (of_bits || keys.format == modbus::value::Kind::Bit)
        };
        let prompt = |bus: &&ModbusBus| bus.driver.period <= STOP_PERIOD_MAX;
        let mut modbus = self.modbus.iter().filter(prompt).flat_map(|bus| &bus.driver.signals);
        let prompt = |device: &&CanopenDevice| device.driver.period <= STOP_PERIOD_MAX;
        let mut canopen = self.canopen.iter().filter(prompt).flat_map(|device| &device.driver.signals);
        modbus.any(is_bit)
            || self.gpio.iter().any(|keys| !keys.output && keys.name == name)
            || canopen.any(|keys| keys.is_bit_input() && keys.name == name)
    }

    /// Inputs that stop the robot and that `driver_io` reads: those of CANopen devices `driver_canbus` reads itself.
    pub fn stops<'a>(&'a self, stop: &'a canbus::Stop) -> impl Iterator<Item = &'a str> {
        stop.signals().filter(|name| !self.objects().any(|keys| keys.name == *name))
    }

    /// Configuration of `driver_io`, whose outputs show `signals`; `w1_bus`: name of the 1-Wire bus; `stop`: its
    /// inputs.
    #[must_use]
    pub fn config(&self, signals: &io::Shows, w1_bus: &str, stop: &canbus::Stop) -> io::Config {
        let modbus = |bus: &ModbusBus| io::Modbus { bus: bus.bus(), line: bus.line(), keys: bus.driver.clone() };
        io::Config {
            publish: self.publish,
            modbus: self.modbus.iter().map(modbus).collect(),
            serial: self.serial.iter().map(IoLine::device).collect(),
            gpio: self.gpio.iter().map(|keys| io::Gpio { bus: gpio_bus(keys), keys: keys.clone() }).collect(),
            w1_bus: w1_bus.into(),
            switches: self.w1.clone(),
            power: self.power.clone(),
            batteries: self.battery.clone(),
            signals: signals.clone(),
            canopen: self.devices(),
            stops: self.stops(stop).map(Into::into).collect(),
        }
    }
}

/// Longest period in which an input that stops the robot is read: older than 0.5 s it counts as open.
const STOP_PERIOD_MAX: Duration = Duration::from_millis(200);
/// Name of the CAN bus that is the first one of several.
const MAIN: &str = "main";
const BUS_EXPECTED: &str = r#"the name of a CAN bus of this file, as "can.main""#;

/// The name of a line's port.
#[must_use]
pub fn gpio_bus(keys: &io::GpioKeys) -> String {
    format!("gpio.{}", keys.name)
}

/// A port as a lidar of this model needs it.
#[must_use]
pub fn lidar_port(port: PortConfig, model: lidar::Model) -> PortConfig {
    match port {
        PortConfig::Terminal(terminal) => {
            PortConfig::Terminal(TerminalConfig { dtr_low: model.wants_dtr_low(), ..terminal })
        }
        other => other,
    }
}

impl Lidar {
    /// What stops the robot is evaluated by the device.
    fn check(&self, table: &Table<'_>) {
        let model = self.driver.model;
        if !model.has_outputs() {
            let keys = ["stop_fields", "stop_outputs", "simulated_fields_m"];
            keys.iter().for_each(|key| table.refuse(key, "none: only a SICK evaluates fields by itself"));
        } else if !model.has_fields() {
            table.refuse("stop_fields", "none: this model reports its outputs, not its fields: stop_outputs");
        }
    }

    /// Its name as a bus.
    #[must_use]
    pub fn bus(&self) -> String {
        format!("lidar.{}", self.name)
    }

    /// Its line.
    #[must_use]
    pub fn stream(&self) -> StreamPort {
        self.port.stream(self.driver.model.usual_baud())
    }

    /// The driver's port.
    #[must_use]
    pub fn driver_port(&self, run_dir: &Path) -> PortConfig {
        lidar_port(self.stream().port(run_dir), self.driver.model)
    }

    /// For `driver_lidar`.
    #[must_use]
    pub fn device(&self) -> lidar::Device {
        let line = self.stream();
        let baud = line.address.is_none().then_some(line.baud);
        let (name, bus, stop) = (self.name.clone(), self.bus(), self.stop.clone());
        lidar::Device { name, bus, baud, keys: self.driver, stop }
    }
}

impl CanopenDevice {
    /// Its name with its kind: subject and target of its faults.
    #[must_use]
    pub fn subject(&self) -> String {
        format!("canopen.{}", self.name)
    }
}

impl SerialLine {
    /// Its name as a bus.
    #[must_use]
    pub fn bus(&self) -> String {
        format!("serial.{}", self.name)
    }

    /// For `driver_canbus`.
    #[must_use]
    pub fn line(&self) -> canbus::LineConfig {
        self.driver.line(self.bus(), self.port.baud)
    }
}

impl Imu {
    /// Its name with its kind: subject and target of its faults.
    #[must_use]
    pub fn subject(&self) -> String {
        format!("imu.{}", self.name)
    }

    /// The name of its port: its own line, or the bus that it is on.
    #[must_use]
    pub fn bus(&self) -> String {
        self.port.bus.clone().unwrap_or_else(|| self.subject())
    }

    /// For `driver_imu`; absent if the robot does not have its bus.
    #[must_use]
    pub fn device(&self, robot: &Robot) -> Option<imu::Device> {
        let line = match self.port.bus.as_deref().map(|bus| bus.split_once('.').unwrap_or((bus, ""))) {
            None => Line::Serial { baud: self.port.baud },
            Some(("i2c", name)) => Line::I2c { hz: robot.i2c.iter().find(|bus| bus.name == name)?.port.hz },
            Some(("can", name)) => Line::Can { bitrate: robot.can.iter().find(|bus| bus.name == name)?.driver.bitrate },
            Some(_) => return None,
        };
        Some(imu::Device { name: self.name.clone(), bus: self.bus(), line, keys: self.driver })
    }
}

impl ModbusBus {
    /// Its name as a bus.
    #[must_use]
    pub fn bus(&self) -> String {
        format!("modbus.{}", self.name)
    }

    /// Serial line or connection.
    #[must_use]
    pub fn line(&self) -> modbus::Line {
        match self.port.address {
            Some(_) => modbus::Line::Tcp,
            None => modbus::Line::Rtu { baud: self.port.baud },
        }
    }
}

impl CanBus {
    /// Its name as a bus: that of its table.
    #[must_use]
    pub fn bus(&self) -> String {
        format!("can.{}", self.name)
    }

    /// True for UDP multicast, on which simulated drives are.
    fn is_virtual(&self) -> bool {
        matches!(self.port.interface, CanInterface::Udp { .. })
    }
}

impl IoLine {
    /// Its name as a bus: that of its table.
    #[must_use]
    pub fn bus(&self) -> String {
        format!("io.serial.{}", self.name)
    }

    /// For `driver_io`.
    #[must_use]
    pub fn device(&self) -> io::Serial {
        let baud = self.port.address.is_none().then_some(self.port.baud);
        io::Serial { bus: self.bus(), baud, keys: self.driver.clone() }
    }
}

impl Robot {
    /// The EIA-485 bus that is called so, `rs485.a`.
    #[must_use]
    pub fn rs485_bus(&self, name: &str) -> Option<&Rs485Bus> {
        let name = name.strip_prefix("rs485.")?;
        self.rs485.iter().find(|bus| bus.name == name)
    }

    /// Its outline, as pictures of runs show it.
    #[must_use]
    pub fn footprint(&self) -> plot::Footprint {
        let geometry = &self.geometry;
        plot::Footprint {
            length_m: geometry.length_m(),
            width_m: geometry.width_m(),
            rear_overhang_m: geometry.rear_m(),
            corners: geometry.footprint().map_or_else(Vec::new, |shape| shape.corners().into()),
        }
    }

    /// What its base does beside curves.
    #[must_use]
    pub fn abilities(&self) -> planner::search::Abilities {
        let sideways = self.base.is_some_and(|base| base.goes_sideways());
        planner::search::Abilities { turns: self.base.is_some(), sideways }
    }

    /// Configuration of its guard: the outline, the sonars, the lidars and the limits.
    #[must_use]
    pub fn guard_config(&self) -> guard::Config {
        let beam = self.sensors.srf08.beam_rad;
        let sonar = |ranger: &Ranger| {
            let Ranger { id, x, y, theta, .. } = *ranger;
            guard::Sonar { id: id.into(), at: Point { x, y }, theta, beam }
        };
        let sonars = self.srfs.iter().map(sonar).collect();
        let config =
            guard::Config::of(self.guard.clone(), &self.geometry, &self.limits, self.power_lost_mps2(), sonars);
        let planner::search::Abilities { turns, sideways } = self.abilities();
        let lidar = |lidar: &Lidar| {
            let keys = &lidar.driver;
            let mount = Pose::new(keys.x, keys.y, keys.theta);
            guard::Lidar { name: lidar.name.clone(), mount, view: keys.view_rad() }
        };
        let lidars = self.lidar.iter().map(lidar).collect();
        guard::Config { lidars, base: guard::Base { turns, sideways, ..config.base }, ..config }
    }

    /// Deceleration when the motors lose their feed, or controllers that then roll their commands, m/s²: only a brake
    /// that needs no power acts then.
    #[must_use]
    pub fn power_lost_mps2(&self) -> f64 {
        match self.stop.pause {
            PauseStop::Brake if self.rolls_without_commands() => self.stop.brake_mps2.min(self.stop.coasting_mps2),
            PauseStop::Brake => self.stop.brake_mps2,
            PauseStop::Coast | PauseStop::Delayed => self.stop.coasting_mps2,
        }
    }

    /// True if it rolls, braked by nothing, once its drives get no commands.
    fn rolls_without_commands(&self) -> bool {
        !self.serial.is_empty() || self.can.iter().any(|bus| bus.driver.rolls_without_commands())
    }

    /// What `driver_canbus` is configured with, and the number of its first CAN bus among `buses`, if it has one;
    /// absent unless each axis of the base has a drive on a CAN bus or on a serial line. The other modules are to be
    /// set.
    #[must_use]
    pub fn motion(&self, buses: &[CanBus]) -> Option<(Option<usize>, canbus::Config)> {
        let devices = self.io.as_ref().map(Io::devices).unwrap_or_default();
        let needs_bus = self.stop.feed_output().is_some() || !devices.is_empty();
        let lines: Vec<canbus::LineConfig> = self.serial.iter().map(SerialLine::line).collect();
        let with = |driver: &canbus::BusConfig, bus| {
            let config = driver.driver_with(bus, lines.clone(), self.base, &self.geometry, self.limits)?;
            Some(canbus::Config { devices: devices.clone(), ..config })
        };
        let used = self.motion_buses(buses);
        if let [first, _, ..] = used[..] {
            let several: Vec<_> = used.iter().map(|n| (buses[*n].bus(), &buses[*n].driver)).collect();
            let lines = lines.clone();
            let config = canbus::Config::on_buses(&several, lines, self.base, &self.geometry, self.limits)?;
            return Some((Some(first), canbus::Config { devices, ..config }));
        }
        let mut candidates = (0..buses.len()).filter(|n| used.contains(n) || used.is_empty() && needs_bus);
        let on_bus = candidates.find_map(|n| Some((Some(n), with(&buses[n].driver, Some(buses[n].bus()))?)));
        on_bus.or_else(|| Some((None, with(&canbus::BusConfig::usual(), None)?)).filter(|_| devices.is_empty()))
    }

    /// Numbers of the CAN buses that have drives of the base, or that are named by the output that feeds the motors or
    /// by a CANopen device: `main` first, then the others in their order.
    fn motion_buses(&self, buses: &[CanBus]) -> Vec<usize> {
        let axes = self.axes();
        let output = self.stop.feed_output().and(self.stop.output_bus.as_deref());
        let devices = self.io.iter().flat_map(|io| &io.canopen).filter_map(|device| device.driver.bus.as_deref());
        let named: Vec<&str> = output.into_iter().chain(devices).collect();
        let is_used = |bus: &CanBus| {
            let drives = bus.driver.nodes.iter().any(|node| axes.contains(&node.axis.name()));
            drives || named.contains(&bus.bus().as_str())
        };
        let mut used: Vec<usize> = (0..buses.len()).filter(|n| is_used(&buses[*n])).collect();
        used.sort_by_key(|n| buses[*n].name != MAIN);
        used
    }

    /// The number by which `LL_CMD_SDO` names a node of a CAN bus.
    #[must_use]
    pub fn node_number(&self, bus: &CanBus, id: u8) -> i32 {
        let place = self.buses_of_motion(&self.can).iter().position(|own| own.name == bus.name);
        canbus::node_number(place.unwrap_or_default(), id)
    }

    /// The CAN buses of `driver_canbus`, in its order; empty: all drives are on serial lines.
    #[must_use]
    pub fn buses_of_motion<'a>(&self, buses: &'a [CanBus]) -> Vec<&'a CanBus> {
        let Some((first, config)) = self.motion(buses) else { return Vec::new() };
        let further = config.further.iter().filter_map(|own| buses.iter().find(|bus| bus.bus() == own.bus));
        first.map(|first| &buses[first]).into_iter().chain(further).collect()
    }

    /// Highest speed of a robot that senses nothing, m/s; `None`: it senses something.
    #[must_use]
    pub fn blind_mps(&self) -> Option<f64> {
        (self.guard.ranging == guard::Ranging::None).then_some(self.guard.speed_blind)
    }

    /// Highest speed at which a hand drives it, m/s: by its limits, by the distance in which PAUSE must stop it, and by
    /// the guard where nothing is sensed.
    #[must_use]
    pub fn hand_mps(&self) -> f64 {
        let stops = self.stop.speed_max_mps(self.limits.quick_stop_mps2, self.rolls_without_commands());
        self.limits.manual_mps().min(stops).min(self.blind_mps().unwrap_or(f64::INFINITY))
    }

    /// True if a board counts the way of wheels that are not driven.
    #[must_use]
    pub fn has_odometry(&self) -> bool {
        self.rs485.iter().any(|bus| bus.driver.nodes.iter().any(|node| node.kind == Kind::So1))
    }

    /// True if its motion is measured by its drives alone, `LL_DATA_VELOCITY`: no board counts other wheels, or the
    /// only steered wheel is driven.
    #[must_use]
    pub fn is_measured_by_drives(&self) -> bool {
        self.base.is_some() || self.geometry.driven == DrivenAxle::Steered || !self.has_odometry()
    }

    /// Boards of range finders, front and rear, with what they serve.
    pub fn ranging_boards(&self) -> impl Iterator<Item = (&Rs485Bus, &Node, RangingBoard)> {
        let of = |rangers: &[Ranger], node: &Node| {
            let served = rangers.iter().filter(|ranger| ranger.board == node.address);
            served.map(|ranger| ranger.id.into()).collect()
        };
        let nodes = self.rs485.iter().flat_map(|bus| bus.driver.nodes.iter().map(move |node| (bus, node)));
        nodes.filter(|(_, node)| node.kind == Kind::Sd1).map(move |(bus, node)| {
            let (sonars, infrareds) = (of(&self.srfs, node), of(&self.irs, node));
            (bus, node, RangingBoard { name: node.name.clone(), sonars, infrareds })
        })
    }

    /// Axes of its base, each of which has a drive.
    #[must_use]
    pub fn axes(&self) -> &'static [&'static str] {
        self.base.as_ref().map_or(&["propulsion", "steering"], Base::axes)
    }

    fn check(&self, table: &Table<'_>) {
        if let Some(geometry) = table.below("geometry") {
            self.geometry.check_wheels(self.base.as_ref().map(|base| (base, &self.limits)), &geometry);
        }
        self.check_axes(table);
        self.check_interfaces(table);
        self.check_lines(table);
        self.check_feed_line(table);
        self.check_imus(table);
        self.check_rangers(table, "srfs", &self.srfs, 7);
        self.check_rangers(table, "irs", &self.irs, 1);
        let ids: Vec<u8> = self.beacons.iter().map(|beacon| beacon.id).collect();
        table.unique("beacons", "id", &ids, "one that no other of the beacons has");
        if let (Some(output), Some(table)) = (self.stop.feed_output(), table.below("stop")) {
            let on = self.stop.output_bus.as_deref();
            let buses = || self.can.iter().filter(|bus| on.is_none_or(|on| bus.bus() == on));
            let taken = |bus: &CanBus| {
                bus.driver.master == output.node || bus.driver.nodes.iter().any(|node| node.id == output.node)
            };
            let ambiguous = |bus: &CanBus| bus.driver.is_ambiguous(output.node);
            if on.is_some() && buses().next().is_none() {
                table.refuse("output_bus", BUS_EXPECTED);
            }
            if let Some(table) = table.below("output") {
                if buses().any(taken) {
                    table.refuse("node", "a node of its own, which is neither a drive nor the master");
                } else if buses().any(ambiguous) {
                    table
                        .refuse("node", "a node that has no identifier of a drive without CANopen, nor has the master");
                }
            }
        }
        self.check_devices(table);
        if self.guard.ranging.has_lidars()
            && self.lidar.is_empty()
            && let Some(guard) = table.below("guard")
        {
            guard.refuse("ranging", "a robot with a table [lidar.<name>]");
        }
        self.check_fields(table);
        self.check_signals(table);
        self.check_stop(table);
        self.check_computers(table);
        if self.w1.is_none()
            && self.io.as_ref().is_some_and(|io| !io.w1.is_empty())
            && let Some(item) = table.below("io").and_then(|io| io.item("w1", 0))
        {
            item.refuse("id", "a switch of a robot with a table [w1]");
        }
        if self.power.is_none()
            && self.io.as_ref().is_some_and(|io| !io.power.is_empty())
            && let Some(item) = table.below("io").and_then(|io| io.item("power", 0))
        {
            item.refuse("channel", "a channel of a robot with a table [power]");
        }
        if let Some((link, channel)) = forwarded(&self.bridge)
            && let Some(table) = table.below("bridge").and_then(|links| links.below(&link.name))
        {
            table.refuse("send", format_args!("no channel that this computer receives from another one: {channel}"));
        }
        if let Some(link) = sharing_a_key(&self.bridge)
            && let Some(table) = table.below("bridge").and_then(|links| links.below(&link.name))
        {
            table.refuse("key_file", "a key of its own: another connection has this file");
        }
        if let (Some(power), Some(table)) = (&self.power, table.below("power")) {
            let nodes = self.rs485_bus(&power.bus).map(|bus| &bus.driver.nodes[..]);
            let expected = "an rs485 bus with one node, whose driver is \"psc1\"";
            match nodes {
                Some([Node { kind: Kind::Psc1, .. }]) => {}
                _ if table.has("bus") => table.refuse("bus", expected),
                _ => table.refuse_missing("bus", expected),
            }
        }
    }

    /// Power buttons of computers are outputs that nobody presses by accident, power LEDs inputs that are published
    /// often enough.
    fn check_computers(&self, table: &Table<'_>) {
        let (Some(power), Some(table)) = (&self.power, table.below("power")) else { return };
        for (n, computer) in power.computers.iter().enumerate() {
            let Some(item) = table.item("computers", n) else { continue };
            let button = self.io.as_ref().filter(|io| io.takes(&computer.button, &[0.0, 1.0]));
            let button = button.and_then(|io| io.prompt_output(&computer.button));
            let short = |keys: &io::OutputKeys| keys.hold.is_some_and(|hold| hold <= Duration::from_secs(2));
            if button.is_none_or(|keys| keys.safe != Some(0.0) || !short(keys)) {
                let expected = "the name of an output of [io] with safe = 0 and a hold_s of at most 2, not on 1-Wire";
                item.refuse("button", expected);
            }
            let Some(alive) = &computer.alive else { continue };
            let often = |io: &&Io| io.publish <= Duration::from_secs(2);
            if !self.io.as_ref().filter(often).is_some_and(|io| io.has_input(alive)) {
                item.refuse("alive", "the name of an input of [io], whose publish_s is at most 2");
            }
        }
    }

    /// What is shown, is shown by outputs that there are.
    fn check_signals(&self, table: &Table<'_>) {
        let Some(signals) = table.below("signals") else { return };
        for (n, keys) in self.signals.show.iter().enumerate() {
            let values = [keys.value, keys.value_off];
            let relay = |io: &Io| io.power.iter().any(|power| power.name == keys.output);
            if keys.pattern.changes()
                && self.io.as_ref().is_some_and(relay)
                && let Some(item) = signals.item("show", n)
            {
                item.refuse("pattern", "\"on\" or \"off\" for a power channel, a relay that is switched slowly");
            }
            if !self.io.as_ref().is_some_and(|io| io.takes(&keys.output, &values))
                && let Some(item) = signals.item("show", n)
            {
                item.refuse("output", "the name of an output of [io] that takes value and value_off");
            }
            let presses = |power: &power::Config| power.computers.iter().any(|computer| computer.button == keys.output);
            if self.power.as_ref().is_some_and(presses)
                && let Some(item) = signals.item("show", n)
            {
                item.refuse("output", "an output that is not the power button of a computer");
            }
        }
    }

    /// Inputs that stop the robot exist, can be read often enough, and are named once.
    fn check_stop(&self, table: &Table<'_>) {
        let Some(stop) = table.below("stop") else { return };
        for (n, input) in self.stop.inputs.iter().enumerate() {
            let Some(item) = stop.item("inputs", n) else { continue };
            let key = if input.signal.is_some() { "signal" } else { "axis" };
            if self.stop.inputs[..n].contains(input) {
                item.refuse(key, "an input that no other of the inputs is");
            }
            if let Some(name) = &input.signal
                && !self.io.as_ref().is_some_and(|io| io.has_stop_input(name))
            {
                let expected = "an input of [io] that is 0 or 1: a GPIO line, or a bit of a Modbus line or a CANopen \
                                device whose period_s is at most 0.2";
                item.refuse(key, expected);
            }
            let is_its = |node: &&canbus::Node| Some(node.axis) == input.axis && node.is_canopen();
            if input.axis.is_some() && !self.can.iter().any(|bus| bus.driver.nodes.iter().any(|node| is_its(&node))) {
                item.refuse(key, "an axis with a drive of CANopen");
            }
        }
    }

    /// CANopen devices are nodes of their own on the bus of the drives.
    fn check_devices(&self, table: &Table<'_>) {
        let (Some(io), Some(table)) = (&self.io, table.below("io").and_then(|io| io.below("canopen"))) else { return };
        for (n, device) in io.canopen.iter().enumerate() {
            let Some(table) = table.below(&device.name) else { continue };
            let node = device.driver.node;
            let is_drive = |bus: &CanBus| bus.driver.nodes.iter().any(|own| own.id == node);
            let on = device.driver.bus.as_deref();
            let buses = || self.can.iter().filter(|bus| on.is_none_or(|on| bus.bus() == on));
            // One without the key may be on the same bus.
            let shares = |other: Option<&str>| on.is_none() || other.is_none() || on == other;
            if self.can.is_empty() {
                table.refuse("node", "a node of a robot with a table [can.<name>]");
            } else if buses().next().is_none() {
                table.refuse("bus", BUS_EXPECTED);
            } else if buses().any(is_drive) {
                table.refuse("node", "a node that is no drive of [[can.<name>.nodes]]");
            } else if buses().any(|bus| bus.driver.master == node) {
                table.refuse("node", "a node other than the master of [can.<name>]");
            } else if self.stop.feed_output().is_some_and(|output| output.node == node)
                && shares(self.stop.output_bus.as_deref())
            {
                table.refuse("node", "a node other than that of [stop.output], which feeds the motors");
            } else if io.canopen[..n]
                .iter()
                .any(|other| other.driver.node == node && shares(other.driver.bus.as_deref()))
            {
                table.refuse("node", "a node that no other table [io.canopen.<name>] has");
            } else if buses().any(|bus| bus.driver.is_ambiguous(node)) {
                table.refuse("node", "a node that has no identifier of a drive without CANopen, nor has the master");
            }
        }
    }

    /// The sensors reach as far as the fields of the guard.
    fn check_fields(&self, table: &Table<'_>) {
        let Some(guard) = table.below("guard").filter(|_| !self.guard.fields.is_empty()) else { return };
        let reach = self.guard.reach;
        for item in self.guard_config().beyond_reach().into_iter().filter_map(|n| guard.item("fields", n)) {
            item.refuse("polygon_m", format_args!("corners at most reach_m, {reach} m, from the robot's outline"));
        }
    }

    /// The bus of an inertial measurement unit is of its kind, and can be shared with what else is on it.
    fn check_imus(&self, table: &Table<'_>) {
        for imu in &self.imu {
            let Some(table) = table.below("imu").and_then(|imus| imus.below(&imu.name)) else { continue };
            let bus = imu.port.bus.as_deref().map(|bus| bus.split_once('.').unwrap_or((bus, "")));
            let expected = match (imu.driver.model, bus) {
                (imu::Model::WitMotion, None) => continue,
                (imu::Model::Bno055, Some(("i2c", name))) => match self.i2c.iter().find(|bus| bus.name == name) {
                    // Two processes cannot both make the clock.
                    Some(bus) if matches!(bus.port.place, I2cPlace::Gpio { .. }) && !bus.driver.chips.is_empty() => {
                        "a bus of an adapter of the kernel, or one without chips: two lines have one master"
                    }
                    Some(_) => continue,
                    None => "the name of an I2C bus of this file, as \"i2c.main\"",
                },
                (imu::Model::Xsens, Some(("can", name))) => match self.can.iter().find(|bus| bus.name == name) {
                    Some(bus) if matches!(bus.port.interface, CanInterface::Slcan(_)) => {
                        "a bus of a network interface: the serial device of an slcan adapter has one user"
                    }
                    Some(bus) if bus.driver.nodes.iter().any(|node| matches!(node.drive, canbus::Drive::Odrive(_))) => {
                        "a bus without ODrive controllers, which have identifiers of the device"
                    }
                    Some(_) => continue,
                    None => "the name of a CAN bus of this file, as \"can.main\"",
                },
                (imu::Model::WitMotion, Some(_)) => "none: this model has a serial line, port",
                (imu::Model::Bno055, _) => "the name of an I2C bus of this file, as \"i2c.main\"",
                (imu::Model::Xsens, _) => "the name of a CAN bus of this file, as \"can.main\"",
            };
            if table.has("bus") { table.refuse("bus", expected) } else { table.refuse_missing("bus", expected) }
        }
    }

    /// Ways to stop that are written and are none.
    fn unused_ways(&self) -> impl Iterator<Item = String> {
        let canbus::Stop { second_way, output, gpio, .. } = &self.stop;
        let tables = [
            ("output", output.is_some(), canbus::SecondWay::Canopen),
            ("gpio", gpio.is_some(), canbus::SecondWay::Gpio),
        ];
        let way = second_way.name();
        let unused = tables.into_iter().filter(|(_, is_there, of)| *is_there && second_way != of);
        let unused: Vec<_> =
            unused.map(|(key, ..)| format!("stop.{key} cuts nothing: stop.second_way is {way:?}")).collect();
        let drives = self.can.iter().any(|bus| !bus.driver.nodes.is_empty()) || !self.serial.is_empty();
        let without = drives && *second_way == canbus::SecondWay::Power && self.power.is_none();
        let without = without.then(|| {
            "nothing cuts the motors' feed: stop.second_way is \"power\", and there is no table [power]".to_owned()
        });
        unused.into_iter().chain(without)
    }

    /// What is allowed, and may not be meant; for `advee config check`.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        let filled_m2 = self.geometry.footprint_m.map_or(0.0, |footprint| footprint.filled_m2);
        let hull = (filled_m2 > 0.0).then(|| {
            format!(
                "geometry.footprint_m is not convex; the robot keeps its convex hull clear, which has {filled_m2:.3} m² \
                 more"
            )
        });
        let most = self.limits.speed_mps;
        let sources = [
            ("speed_manual_mps", self.limits.speed_manual_mps),
            ("speed_autonomous_mps", self.limits.speed_autonomous_mps),
        ];
        let above = sources.into_iter().filter(|(_, speed)| *speed > most);
        let above = above.map(|(key, speed)| {
            format!("limits.{key} = {speed} is above limits.speed_mps = {most}: more than that is refused")
        });
        let nodes = self.can.iter().flat_map(|bus| (0..).zip(&bus.driver.nodes).map(|(n, node)| (bus.bus(), n, node)));
        let homing = nodes.filter(|(.., node)| node.axis == canbus::Axis::Steering).filter_map(|(bus, n, node)| {
            let remark = node.drive.homing()?.remark()?;
            Some(format!("{bus}.nodes[{n}].{remark}"))
        });
        hull.into_iter().chain(above).chain(homing).chain(self.unused_ways()).collect()
    }

    /// A drive on a CAN bus moves an axis that the base has, and nothing else says what is driven.
    fn check_axes(&self, table: &Table<'_>) {
        if let Some(kind) = self.kind
            && let Some(geometry) = table.below("geometry").filter(|geometry| geometry.has("driven"))
        {
            let expected = match kind.base() {
                Some(_) => "nothing beside [base], whose wheels are all driven",
                None => "nothing beside [base], whose own key is driven = \"fixed\" or \"steered\"",
            };
            geometry.refuse("driven", expected);
        }
        let (left, most) = (self.geometry.steered.driven_left_m, self.geometry.driven_left_max_m(&self.limits));
        if let Some(base) = table.below("base").filter(|_| left != 0.0) {
            if self.geometry.driven == DrivenAxle::Steered {
                base.refuse("driven_left_m", "nothing beside driven = \"steered\", a wheel in the middle");
            } else if left.abs() > most {
                let most = (most * 1e3).floor() / 1e3;
                let expected = format!(
                    "at most {most} either way: in the narrowest curve by limits.steering_rad the wheel would be at \
                     its \
                     centre, or turn the other way"
                );
                base.refuse("driven_left_m", expected);
            }
        }
        let axes = self.axes();
        for (place, bus) in self.can.iter().enumerate() {
            let Some(table) = table.below("can").and_then(|buses| buses.below(&bus.name)) else { continue };
            for (n, node) in bus.driver.nodes.iter().enumerate() {
                let moves = |other: &&CanBus| other.driver.nodes.iter().any(|own| own.axis == node.axis);
                if let (Some(other), Some(item)) = (self.can[..place].iter().find(moves), table.item("nodes", n)) {
                    item.refuse("axis", format_args!("one that no drive of [{}] moves", other.bus()));
                }
            }
            let others = bus.driver.nodes.iter().enumerate().filter(|(_, node)| !axes.contains(&node.axis.name()));
            for (n, _) in others {
                if let Some(item) = table.item("nodes", n) {
                    item.refuse("axis", format_args!("an axis of the base: {}", axes.join(", ")));
                }
            }
            for (n, node) in bus.driver.nodes.iter().enumerate() {
                if let (Some(most), Some(item)) = (node.motor_rpm_max, table.item("nodes", n)) {
                    self.check_motor(node, most, &item);
                }
                if let (canbus::Drive::Vesc(keys), Some(item)) = (&node.drive, table.item("nodes", n)) {
                    self.check_slowest(&keys.motor, &item);
                }
            }
        }
    }

    /// Each CAN bus with drives has a wire of its own: two masters on one wire would disturb each other. All of them
    /// are virtual or none: on one that `sim.toml` has left out a simulated robot would command real drives.
    fn check_interfaces(&self, table: &Table<'_>) {
        let used = self.motion_buses(&self.can);
        let simulated = used.iter().map(|n| &self.can[*n]).find(|bus| bus.is_virtual());
        for (place, bus) in used.iter().enumerate().map(|(place, n)| (place, &self.can[*n])) {
            let table = table.below("can").and_then(|buses| buses.below(&bus.name));
            let same = |other: &&CanBus| other.port.interface == bus.port.interface;
            let other = used[..place].iter().map(|n| &self.can[*n]).find(same);
            let Some(table) = table else { continue };
            if let Some(other) = other {
                table.refuse("interface", format_args!("one that [{}] does not have", other.bus()));
            }
            if let Some(other) = simulated.filter(|_| !bus.is_virtual()) {
                table.refuse(
                    "interface",
                    format_args!("\"udp:GROUP\", as [{}] has: both are simulated or none", other.bus()),
                );
            }
        }
    }

    /// The limits of the robot demand no more of a motor than it and its gear can bear, rpm.
    fn check_motor(&self, node: &canbus::Node, most: f64, table: &Table<'_>) {
        let Some(gear) = node.drive.gear() else {
            table.refuse_missing("gear", "the gear of a motor with motor_rpm_max");
            return;
        };
        let (key, limit, per_turn) = match node.axis {
            canbus::Axis::Steering => ("steering_rate_radps", self.limits.steering_rate_radps, std::f64::consts::TAU),
            _ => ("speed_mps", self.limits.speed_mps, self.geometry.wheel_circumference_m()),
        };
        let rpm_per_unit = 60.0 * gear.abs() / per_turn;
        if limit * rpm_per_unit > most {
            // Rounded so that either of both is good.
            let (rpm, reachable) = ((limit * rpm_per_unit).ceil(), (most / rpm_per_unit * 1e3).floor() / 1e3);
            let expected = format!("at least {rpm}, by limits.{key} and gear; or a {key} of at most {reachable}");
            table.refuse("motor_rpm_max", expected);
        }
    }

    /// A VESC turns its wheel at some speed at which the robot may drive: slower set-points than `erpm_min` brake.
    fn check_slowest(&self, motor: &canbus::VescMotor, table: &Table<'_>) {
        let driven = self.limits.speed_manual_mps.max(self.limits.speed_autonomous_mps).min(self.limits.speed_mps);
        let most = self.blind_mps().map_or(driven, |blind| driven.min(blind));
        let erpm_per_mps =
            60.0 * motor.gear.abs() * f64::from(motor.pole_pairs) / self.geometry.wheel_circumference_m();
        if motor.gear == 0.0 || motor.erpm_min <= most * erpm_per_mps {
            return;
        }
        let slowest = (motor.erpm_min / erpm_per_mps * 1e3).ceil() / 1e3;
        let expected = format!(
            "at most {}: the robot drives at {most} m/s at most, and by gear and pole_pairs the wheel stands below \
             {slowest} m/s",
            (most * erpm_per_mps).floor()
        );
        match table.has("erpm_min") {
            true => table.refuse("erpm_min", expected),
            false => table.refuse_missing("erpm_min", expected),
        }
    }

    /// A drive on a serial line moves axes that the base has, and that no other drive moves, on a line of its own; one
    /// whose command time limit cannot be proven needs a second way to stop.
    fn check_lines(&self, table: &Table<'_>) {
        let Some(lines) = table.below("serial") else { return };
        let axes = self.axes();
        let mut taken: Vec<canbus::Axis> =
            self.can.iter().flat_map(|bus| bus.driver.nodes.iter().map(|node| node.axis)).collect();
        let mut ports: Vec<&PathBuf> = Vec::new();
        for line in &self.serial {
            let Some(table) = lines.below(&line.name) else { continue };
            for ((axis, _), place) in line.driver.motors().into_iter().zip(line.driver.tables()) {
                let below = place.and_then(|name| table.below(name));
                let table = below.as_ref().unwrap_or(&table);
                if !axes.contains(&axis.name()) {
                    table.refuse("axis", format_args!("an axis of the base: {}", axes.join(", ")));
                } else if taken.contains(&axis) {
                    table.refuse("axis", "one that no other drive moves");
                }
                taken.push(axis);
            }
            if let canbus::LineKeys::Vesc(keys) = &line.driver {
                self.check_slowest(&keys.motor, &table);
            }
            if ports.contains(&&line.port.port) {
                table.refuse("port", "a line of its own: another drive has this one");
            }
            ports.push(&line.port.port);
            if !line.line().device.proves_time_limit() && !self.stop.has_second_way(self.power.is_some()) {
                table.refuse("driver", self.missing_way());
            }
        }
        if self.stop.feed_output().is_some()
            && self.can.is_empty()
            && let Some(stop) = table.below("stop")
        {
            stop.refuse("second_way", "another one than a node of a CAN bus, of which there is none");
        }
    }

    /// The line that cuts the motors' feed is no signal.
    fn check_feed_line(&self, table: &Table<'_>) {
        let (Some(feed), Some(io)) = (self.stop.feed_line(), table.below("io")) else { return };
        let lines = self.io.iter().flat_map(|io| &io.gpio);
        for (n, _) in lines.enumerate().filter(|(_, keys)| (&keys.chip, &keys.line) == (&feed.chip, &feed.line)) {
            if let Some(item) = io.item("gpio", n) {
                item.refuse("line", "another one than that of [stop] gpio, which cuts the motors' feed");
            }
        }
    }

    /// What a drive needs whose command time limit cannot be proven, and which key is missing.
    fn missing_way(&self) -> &'static str {
        match self.stop.second_way {
            canbus::SecondWay::Power => {
                "a robot with a second way to stop, since its command time limit cannot be proven: a table [power], or \
                 stop.second_way = \"gpio\" or \"canopen\""
            }
            _ => {
                "a robot with a second way to stop, since its command time limit cannot be proven: stop.second_way = \
                 \"gpio\" or \"canopen\", or \"power\" with a table [power]"
            }
        }
    }

    fn check_rangers(&self, table: &Table<'_>, key: &str, rangers: &[Ranger], channel_max: u8) {
        let nodes = || self.rs485.iter().flat_map(|bus| &bus.driver.nodes);
        for (n, ranger) in rangers.iter().enumerate() {
            let Some(item) = table.item(key, n) else { continue };
            if !nodes().any(|node| node.kind == Kind::Sd1 && node.address == ranger.board) {
                item.refuse("board", "the address of an sd1 in rs485");
            }
            if ranger.channel > channel_max {
                item.refuse("channel", format_args!("an integer from 0 to {channel_max}"));
            }
        }
        let ids: Vec<u8> = rangers.iter().map(|ranger| ranger.id).collect();
        table.unique(key, "id", &ids, format_args!("one that no other of the {key} has"));
        let channels: Vec<_> = rangers.iter().map(|ranger| (ranger.board, ranger.channel)).collect();
        table.unique(key, "channel", &channels, format_args!("one that no other of the {key} on this board has"));
    }
}
