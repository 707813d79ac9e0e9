//! `robot.toml`: what the robot is made of. Lengths in metres, angles in radians, as the keys say.
//!
//! The robot's frame: origin on the floor under the middle of the rear axle, x forward, y to the left, angles
//! counter-clockwise.

use super::auxiliary::{I2cBus, W1};
use super::joystick::Joystick;
use super::log::Log;
use super::modules::level;
use super::planner::Planner;
use super::sensors::Sensors;
use base::{Level, Severity};
use host::ports::{Direction, Transport};
use settings::Table;
use std::net::Ipv4Addr;
use std::path::{Path, PathBuf};
use web::settings::Web;

/// The robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Its name.
    pub name: String,
    /// Its measures.
    pub geometry: Geometry,
    /// How it may move.
    pub limits: Limits,
    /// Reports of at least this severity are printed, and sent on `CM_EVENT_ERROR`.
    pub report_from: Severity,
    /// Lowest level of texts and reports that are printed; none: `report_from` for reports, INFO for texts.
    pub print_from: Option<Level>,
    /// Lowest level of texts and reports that are sent; none: `report_from` for reports, INFO for texts.
    pub send_from: Option<Level>,
    /// CAN buses by name.
    pub can: Vec<CanBus>,
    /// EIA-485 buses by name.
    pub rs485: Vec<Rs485Bus>,
    /// I2C buses by name.
    pub i2c: Vec<I2cBus>,
    /// The 1-Wire bus, where there is one.
    pub w1: Option<W1>,
    /// Sonars.
    pub srfs: Vec<Ranger>,
    /// Infrared rangers.
    pub irs: Vec<Ranger>,
    /// What its sensors are like.
    pub sensors: Sensors,
    /// The infrared beacons of where the robot drives.
    pub beacons: Vec<Beacon>,
    /// How well the robot measures where it is; without the beacons.
    pub estimator: estimator::filter::Config,
    /// The power controller, where there is one that tells of the PAUSE line.
    pub power: Option<Power>,
    /// The gamepad.
    pub joystick: Option<Joystick>,
    /// How it drives by itself.
    pub planner: Planner,
    /// What a run writes down.
    pub log: Log,
    /// The web server.
    pub web: Web,
}

/// `[geometry]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Rear axle to front axle, 0.05..=5 m.
    pub wheelbase_m: f64,
    /// Distance of the front wheels, 0.05..=5 m.
    pub track_m: f64,
    /// Of all wheels, 0.01..=1 m.
    pub wheel_radius_m: f64,
    /// Bumper to bumper, 0.1..=10 m.
    pub length_m: f64,
    /// 0.1..=10 m.
    pub width_m: f64,
    /// From the rear axle to the rear bumper, 0..=5 m.
    pub rear_overhang_m: f64,
    /// Counts of a front wheel's encoder per turn, 1..=1 000 000.
    pub ticks_per_turn: u32,
}

/// `[limits]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Either way, 0.01..=10 m/s; a command beyond it is refused.
    pub speed_mps: f64,
    /// What a manual source gets at most, 0.01..=10 m/s.
    pub speed_manual_mps: f64,
    /// What the planner gets at most, 0.01..=10 m/s.
    pub speed_autonomous_mps: f64,
    /// Of the equivalent single front wheel, either way, 0.01..=1.5 rad.
    pub steering_rad: f64,
    /// 0.01..=20 m/s².
    pub acceleration_mps2: f64,
    /// Of a stop that was commanded, 0.01..=20 m/s².
    pub deceleration_mps2: f64,
    /// 0.01..=20 m/s².
    pub quick_stop_mps2: f64,
    /// Sideways at the rear axle, 0.01..=20 m/s²; caps the speed in curves.
    pub lateral_acceleration_mps2: f64,
    /// 0.01..=20 rad/s.
    pub steering_rate_radps: f64,
    /// A motion command holds this long, 0.05..=1 s; default 0.25.
    pub command_ttl_s: f64,
}

/// `[can.<bus>]`.
#[derive(Clone, Debug, PartialEq)]
pub struct CanBus {
    /// `main`.
    pub name: String,
    /// Where it is found.
    pub interface: CanInterface,
    /// bit/s, 10 000..=1 000 000; default 500 000.
    pub bitrate: u32,
    /// CANopen node of the master, 1..=127; default 127.
    pub master: u8,
    /// Period of SYNC, 0.001..=10 s; default none.
    pub sync_s: Option<f64>,
    /// Whether every frame is sent as `LL_DATA_RAW_<BUS>`; default false.
    pub raw: bool,
    /// What is on it.
    pub nodes: Vec<CanNode>,
}

/// Where a CAN bus is found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CanInterface {
    /// A network interface: `can0`.
    Socket(String),
    /// An adapter on a serial device that speaks slcan: `slcan:/dev/ttyACM0`.
    Slcan(PathBuf),
    /// UDP multicast as python-can speaks it: `udp:239.74.163.2:43113`. Without a port it follows the port of LCM.
    Udp {
        /// The multicast group.
        group: Ipv4Addr,
        /// The port, which is what keeps buses apart.
        port: Option<u16>,
    },
}

/// `[[can.<bus>.nodes]]`.
#[derive(Clone, Debug, PartialEq)]
pub struct CanNode {
    /// CANopen node, 1..=127.
    pub id: u8,
    /// `propulsion` or `steering`.
    pub axis: Axis,
    /// Its electronic data sheet, beside `robot.toml`; none: the one that is built in.
    pub eds: Option<PathBuf>,
    /// What drive it is.
    pub driver: CanDriver,
}

/// CANopen drives that there are drivers for, and what each needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CanDriver {
    /// `epos`: maxon EPOS 70/10.
    Epos {
        /// Motor turns per wheel turn, -1000..=1000, not 0; negative when the motor is mounted the other way round.
        gear: f64,
    },
    /// `icla`: Berger Lahr IclA.
    Icla {
        /// Motor turns per turn of the equivalent single front wheel, -10 000..=10 000, not 0; negative when counts
        /// fall counter-clockwise.
        gear: f64,
        /// Position counts per turn of the motor, 1..=1e6; default 4096.
        counts_per_turn: f64,
        /// The angle at which the homing switch closes, -2..=2 rad.
        switch_rad: f64,
        /// CiA 402 homing method, -128..=127; default 27: onto the switch from above, and off it.
        homing_method: i8,
        /// Towards the switch, 0.001..=10 rad/s.
        homing_speed_radps: f64,
        /// Homing takes at most this long, 1..=120 s; default 15.
        homing_timeout_s: f64,
        /// Maps the PDOs as the driver needs them where the drive has others; default false: such a drive is refused.
        remap: bool,
    },
}

/// What a drive moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// The rear wheels.
    Propulsion,
    /// The front wheels' angle.
    Steering,
}

/// `[rs485.<bus>]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Rs485Bus {
    /// `a`.
    pub name: String,
    /// A device file; a relative path lies in the run folder, where the simulator puts its ends.
    pub port: PathBuf,
    /// Bd, 1200..=4 000 000; default 115 200.
    pub baud: u32,
    /// How nine bits cross the port.
    pub transport: Transport,
    /// Where the simulator has the boards when `port` is a device file: another one that is wired to it, or, relative, a
    /// pseudo-terminal that it makes in the run folder, of two-byte words. Default: it makes `port` itself.
    pub simulated_at: Option<PathBuf>,
    /// A program and its arguments that make the port an EIA-485 port, run before each opening; default none.
    pub setup: Vec<String>,
    /// Lets the port's driver switch the direction of the line; default: the adapter does.
    pub direction: Option<Direction>,
    /// Asks the port's driver not to collect bytes; default false.
    pub low_latency: bool,
    /// The check of its frames; default CRC-8/SAE-J1850.
    pub crc: Crc,
    /// Whether every word is sent as `LL_DATA_RAW_<BUS>`; default false.
    pub raw: bool,
    /// What is on it.
    pub nodes: Vec<Rs485Node>,
}

/// `crc = { … }`, in the words of the Rocksoft model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crc {
    /// Without the leading 1; default 0x1D.
    pub polynomial: u8,
    /// Default 0xFF.
    pub initial: u8,
    /// Both input and output; default false.
    pub reflected: bool,
    /// Default 0xFF.
    pub final_xor: u8,
}

/// `[[rs485.<bus>.nodes]]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Rs485Node {
    /// What messages and reports call it: `sd1_front`; default driver and address.
    pub name: String,
    /// 1..=254.
    pub address: u8,
    /// What board it is.
    pub driver: Rs485Driver,
    /// How often it is asked, 0.1..=100 Hz.
    pub rate_hz: f64,
    /// How long its answer may take, 0.001..=1 s; default 0.02.
    pub timeout_s: f64,
}

/// Boards on EIA-485 that there are drivers for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rs485Driver {
    /// BR-SD1, distances.
    Sd1,
    /// BR-SO1, odometry.
    So1,
    /// BR-SBS1, beacon scanner.
    Sbs1,
    /// BR-PSC1, power controller.
    Psc1,
}

/// An item of `srfs` or `irs`: a ranger and where it sits in the robot's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ranger {
    /// Its number in messages, 0..=255.
    pub id: u8,
    /// The address of the SD1 that serves it.
    pub board: u8,
    /// Its place in that board's answer.
    pub channel: u8,
    /// m.
    pub x: f64,
    /// m.
    pub y: f64,
    /// Where it looks, rad.
    pub theta: f64,
}

/// An item of `beacons`: an infrared beacon and where it hangs, in the frame of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beacon {
    /// What it sends, 0..=255.
    pub id: u8,
    /// m.
    pub x: f64,
    /// m.
    pub y: f64,
}

/// `[power]`: the power controller and its battery.
#[derive(Clone, Debug, PartialEq)]
pub struct Power {
    /// The link to it, `rs485.power` unless it says otherwise; a bus with a node of driver `psc1`, and no other.
    pub bus: String,
    /// Of a full battery, 0.1..=10 000 Ah.
    pub capacity_ah: f64,
    /// In series, 1..=16.
    pub cells: u8,
    /// Below this charge a warning is reported, 0..=1; default 0.2.
    pub reserve: f64,
    /// What halts the computer, program and arguments; default none. Never run in simulation.
    pub halt_command: Vec<String>,
    /// What restarts it; default none: a restart is refused.
    pub reboot_command: Vec<String>,
}

impl Robot {
    /// Reads the merged tree.
    pub(super) fn read(mut root: Table<'_>) -> Option<Self> {
        let robot = root.table("robot").map(|mut table| {
            let name = table.text("name", None);
            let severities = [("notice", Severity::Notice), ("warning", Severity::Warning), ("error", Severity::Error)];
            let report_from = table.choice("report_from", Some(Severity::Notice), &severities);
            let (print_from, send_from) = (level(&mut table, "print_from"), level(&mut table, "send_from"));
            table.end();
            (name, report_from, print_from, send_from)
        });
        let geometry = root.table("geometry").map(Geometry::read);
        let limits = root.table("limits").map(Limits::read);
        let can = root.named_tables("can").into_iter().map(|(name, table)| CanBus::read(name, table)).collect();
        let rs485: Vec<Rs485Bus> =
            root.named_tables("rs485").into_iter().map(|(name, table)| Rs485Bus::read(name, table)).collect();
        let i2c = root.named_tables("i2c").into_iter().map(|(name, table)| I2cBus::read(name, table)).collect();
        let w1 = root.table_if_any("w1").map(W1::read);
        let srfs = Ranger::read_all(&mut root, "srfs", 7, &rs485);
        let irs = Ranger::read_all(&mut root, "irs", 1, &rs485);
        let sensors = root.table_if_any("sensors").map_or_else(Sensors::default, Sensors::read);
        let beacons = Beacon::read_all(&mut root);
        let estimator = root.table_if_any("estimator").map_or_else(Default::default, super::estimator::read);
        let power = root.table_if_any("power").map(|table| Power::read(table, &rs485));
        let joystick = root.table_if_any("joystick").map(Joystick::read);
        let planner = root.table_if_any("planner").map_or_else(Planner::default, Planner::read);
        let log = root.table_if_any("log").map_or_else(Log::default, Log::read);
        let web = root.table_if_any("web").map_or_else(Web::default, Web::read);
        root.end();
        let (name, report_from, print_from, send_from) = robot?;
        let (geometry, limits) = (geometry?, limits?);
        Some(Self {
            name,
            report_from,
            print_from,
            send_from,
            geometry,
            limits,
            can,
            rs485,
            i2c,
            w1,
            srfs,
            irs,
            sensors,
            beacons,
            estimator,
            power,
            joystick,
            planner,
            log,
            web,
        })
    }

    /// The EIA-485 bus that is called so, `rs485.a`.
    #[must_use]
    pub fn rs485_bus(&self, name: &str) -> Option<&Rs485Bus> {
        let name = name.strip_prefix("rs485.")?;
        self.rs485.iter().find(|bus| bus.name == name)
    }
}

impl Beacon {
    fn read_all(root: &mut Table<'_>) -> Vec<Self> {
        let mut beacons: Vec<Self> = Vec::new();
        for mut item in root.tables("beacons") {
            let beacon = Self {
                id: item.integer("id", None, 0..=255),
                x: item.number("x", None, -1e4..=1e4),
                y: item.number("y", None, -1e4..=1e4),
            };
            if beacons.iter().any(|other| other.id == beacon.id) {
                item.refuse("id", "one that no other of the beacons has");
            }
            item.end();
            beacons.push(beacon);
        }
        beacons
    }
}

impl Power {
    fn read(mut table: Table<'_>, buses: &[Rs485Bus]) -> Self {
        let bus = table.text("bus", Some("rs485.power"));
        let line = bus.strip_prefix("rs485.").and_then(|name| buses.iter().find(|line| line.name == name));
        if !line.is_some_and(|line| matches!(line.nodes[..], [Rs485Node { driver: Rs485Driver::Psc1, .. }])) {
            let expected = "an rs485 bus with one node, whose driver is \"psc1\"";
            if table.has("bus") { table.refuse("bus", expected) } else { table.refuse_missing("bus", expected) }
        }
        let power = Self {
            bus,
            capacity_ah: table.number("capacity_ah", None, 0.1..=10_000.0),
            cells: table.integer("cells", None, 1..=16),
            reserve: table.number("reserve", Some(0.2), 0.0..=1.0),
            halt_command: table.texts("halt_command"),
            reboot_command: table.texts("reboot_command"),
        };
        table.end();
        power
    }
}

impl Geometry {
    /// Its outline, as pictures of runs show it.
    #[must_use]
    pub fn footprint(&self) -> plot::Footprint {
        plot::Footprint { length_m: self.length_m, width_m: self.width_m, rear_overhang_m: self.rear_overhang_m }
    }

    fn read(mut table: Table<'_>) -> Self {
        let geometry = Self {
            wheelbase_m: table.number("wheelbase_m", None, 0.05..=5.0),
            track_m: table.number("track_m", None, 0.05..=5.0),
            wheel_radius_m: table.number("wheel_radius_m", None, 0.01..=1.0),
            length_m: table.number("length_m", None, 0.1..=10.0),
            width_m: table.number("width_m", None, 0.1..=10.0),
            rear_overhang_m: table.number("rear_overhang_m", None, 0.0..=5.0),
            ticks_per_turn: table.integer("ticks_per_turn", None, 1..=1_000_000),
        };
        table.end();
        geometry
    }
}

impl Limits {
    fn read(mut table: Table<'_>) -> Self {
        let limits = Self {
            speed_mps: table.number("speed_mps", None, 0.01..=10.0),
            speed_manual_mps: table.number("speed_manual_mps", None, 0.01..=10.0),
            speed_autonomous_mps: table.number("speed_autonomous_mps", None, 0.01..=10.0),
            steering_rad: table.number("steering_rad", None, 0.01..=1.5),
            acceleration_mps2: table.number("acceleration_mps2", None, 0.01..=20.0),
            deceleration_mps2: table.number("deceleration_mps2", None, 0.01..=20.0),
            quick_stop_mps2: table.number("quick_stop_mps2", None, 0.01..=20.0),
            lateral_acceleration_mps2: table.number("lateral_acceleration_mps2", None, 0.01..=20.0),
            steering_rate_radps: table.number("steering_rate_radps", None, 0.01..=20.0),
            command_ttl_s: table.number("command_ttl_s", Some(0.25), 0.05..=1.0),
        };
        table.end();
        limits
    }
}

impl CanBus {
    fn read(name: String, mut table: Table<'_>) -> Self {
        let text = table.text("interface", None);
        let interface = CanInterface::parse(&text).unwrap_or_else(|| {
            if !text.is_empty() {
                table.refuse(
                    "interface",
                    r#""can0" or another network interface, "slcan:DEVICE", or "udp:GROUP[:PORT]""#,
                );
            }
            CanInterface::Socket(String::new())
        });
        let bitrate = table.integer("bitrate", Some(500_000), 10_000..=1_000_000);
        let master = table.integer("master", Some(127), 1..=127);
        let sync_s = table.number("sync_s", Some(0.0), 0.0..=10.0);
        if sync_s > 0.0 && sync_s < 0.001 {
            table.refuse("sync_s", "0 (none), or 0.001 to 10");
        }
        let sync_s = (sync_s > 0.0).then_some(sync_s);
        let raw = table.boolean("raw", false);
        let mut nodes: Vec<CanNode> = Vec::new();
        for mut item in table.tables("nodes") {
            let node = CanNode::read(&mut item);
            if node.id == master || nodes.iter().any(|other| other.id == node.id) {
                item.refuse("id", "one that no other node of the bus has");
            }
            if nodes.iter().any(|other| other.axis == node.axis) {
                item.refuse("axis", "one that no other node has");
            }
            item.end();
            nodes.push(node);
        }
        table.end();
        Self { name, interface, bitrate, master, sync_s, raw, nodes }
    }
}

impl CanInterface {
    /// As `robot.toml` and the command line have it; none when it is no interface's name.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        if let Some(device) = text.strip_prefix("slcan:") {
            return device.starts_with('/').then(|| Self::Slcan(device.into()));
        }
        let Some(udp) = text.strip_prefix("udp:") else {
            // IFNAMSIZ counts the end of the string.
            let name = !text.is_empty()
                && text.len() < 16
                && !text.contains(['/', ':'])
                && !text.contains(char::is_whitespace);
            return name.then(|| Self::Socket(text.into()));
        };
        let (group, port) = match udp.split_once(':') {
            Some((group, port)) => (group, Some(port.parse().ok().filter(|port| *port != 0)?)),
            None => (udp, None),
        };
        let group: Ipv4Addr = group.parse().ok()?;
        group.is_multicast().then_some(Self::Udp { group, port })
    }
}

impl CanNode {
    fn read(table: &mut Table<'_>) -> Self {
        let node = Self {
            id: table.integer("id", None, 1..=127),
            axis: table.choice("axis", None, &[("propulsion", Axis::Propulsion), ("steering", Axis::Steering)]),
            eds: Some(table.text("eds", Some(""))).filter(|eds| !eds.is_empty()).map(PathBuf::from),
            driver: match table.choice("driver", None, &[("epos", true), ("icla", false)]) {
                true => CanDriver::Epos { gear: not_zero(table, "gear", 1000.0) },
                false => CanDriver::Icla {
                    gear: not_zero(table, "gear", 10_000.0),
                    counts_per_turn: table.number("counts_per_turn", Some(4096.0), 1.0..=1e6),
                    switch_rad: table.number("switch_rad", None, -2.0..=2.0),
                    homing_method: table.integer("homing_method", Some(27), -128..=127),
                    homing_speed_radps: table.number("homing_speed_radps", None, 0.001..=10.0),
                    homing_timeout_s: table.number("homing_timeout_s", Some(15.0), 1.0..=120.0),
                    remap: table.boolean("remap", false),
                },
            },
        };
        let moves = match node.driver {
            CanDriver::Epos { .. } => (Axis::Propulsion, r#""propulsion", which is all that this driver can move"#),
            CanDriver::Icla { .. } => (Axis::Steering, r#""steering", which is all that this driver can move"#),
        };
        if node.axis != moves.0 {
            table.refuse("axis", moves.1);
        }
        node
    }
}

fn not_zero(table: &mut Table<'_>, key: &'static str, max: f64) -> f64 {
    let value = table.number(key, None, -max..=max);
    if value == 0.0 {
        table.refuse(key, "a number that is not 0");
    }
    value
}

impl Rs485Bus {
    /// The name in the run folder of the pseudo-terminal that the simulator makes, if it makes one.
    #[must_use]
    pub fn offered(&self) -> Option<&Path> {
        let path = self.simulated_at.as_ref().unwrap_or(&self.port);
        path.is_relative().then_some(path)
    }

    fn read(name: String, mut table: Table<'_>) -> Self {
        let port = PathBuf::from(table.text("port", None));
        let baud = table.integer("baud", Some(115_200), 1200..=4_000_000);
        let transports = [("two-byte", Transport::TwoByte), ("parity", Transport::Parity)];
        let transport = table.choice("transport", None, &transports);
        let simulated_at = table.has("simulated_at").then(|| PathBuf::from(table.text("simulated_at", None)));
        if port.is_relative() || simulated_at.as_ref() == Some(&port) {
            table.refuse("simulated_at", "a place other than port, where that is a device file");
        }
        let setup = table.texts("setup");
        let direction = table.table_if_any("rs485_direction").map(direction);
        let low_latency = table.boolean("low_latency", false);
        let crc = table.table_if_any("crc").map_or_else(Crc::default, Crc::read);
        let raw = table.boolean("raw", false);
        let mut nodes: Vec<Rs485Node> = Vec::new();
        for mut item in table.tables("nodes") {
            let node = Rs485Node::read(&mut item);
            if nodes.iter().any(|other| other.address == node.address) {
                item.refuse("address", "one that no other node of the bus has");
            }
            if nodes.iter().any(|other| other.name == node.name) {
                item.refuse("name", "one that no other node of the bus has");
            }
            if node.driver == Rs485Driver::So1 && nodes.iter().any(|other| other.driver == node.driver) {
                item.refuse("driver", "no second so1 on the bus");
            }
            item.end();
            nodes.push(node);
        }
        table.end();
        Self { name, port, baud, transport, simulated_at, setup, direction, low_latency, crc, raw, nodes }
    }
}

fn direction(mut table: Table<'_>) -> Direction {
    let rts_on_send = table.boolean("rts_on_send", true);
    let direction = Direction {
        rts_on_send,
        rts_after_send: table.boolean("rts_after_send", !rts_on_send),
        delay_before_ms: table.integer("delay_before_ms", Some(0), 0..=100),
        delay_after_ms: table.integer("delay_after_ms", Some(0), 0..=100),
    };
    if direction.rts_on_send == direction.rts_after_send {
        table.refuse("rts_after_send", "the opposite of rts_on_send");
    }
    table.end();
    direction
}

impl Default for Crc {
    /// CRC-8/SAE-J1850.
    fn default() -> Self {
        Self { polynomial: 0x1D, initial: 0xFF, reflected: false, final_xor: 0xFF }
    }
}

impl Crc {
    fn read(mut table: Table<'_>) -> Self {
        let default = Self::default();
        let crc = Self {
            polynomial: table.integer("polynomial", Some(default.polynomial), 1..=255),
            initial: table.integer("initial", Some(default.initial), 0..=255),
            reflected: table.boolean("reflected", default.reflected),
            final_xor: table.integer("final_xor", Some(default.final_xor), 0..=255),
        };
        table.end();
        crc
    }
}

impl Rs485Node {
    fn read(table: &mut Table<'_>) -> Self {
        let drivers = [
            ("sd1", Rs485Driver::Sd1),
            ("so1", Rs485Driver::So1),
            ("sbs1", Rs485Driver::Sbs1),
            ("psc1", Rs485Driver::Psc1),
        ];
        let address = table.integer("address", None, 1..=254);
        let driver = table.choice("driver", None, &drivers);
        let kind = drivers.iter().find(|(_, kind)| *kind == driver).map_or("", |(name, _)| name);
        Self {
            name: table.text("name", Some(&format!("{kind}_{address:02x}"))),
            address,
            driver,
            rate_hz: table.number("rate", None, 0.1..=100.0),
            timeout_s: table.number("timeout_s", Some(0.02), 0.001..=1.0),
        }
    }
}

impl Ranger {
    fn read_all(root: &mut Table<'_>, key: &'static str, channel_max: u8, buses: &[Rs485Bus]) -> Vec<Self> {
        let mut rangers: Vec<Self> = Vec::new();
        for mut item in root.tables(key) {
            let ranger = Self::read(&mut item, channel_max);
            let mut boards = buses.iter().flat_map(|bus| &bus.nodes).filter(|node| node.driver == Rs485Driver::Sd1);
            if !boards.any(|node| node.address == ranger.board) {
                item.refuse("board", "the address of an sd1 in rs485");
            }
            if rangers.iter().any(|other| other.id == ranger.id) {
                item.refuse("id", format_args!("one that no other of the {key} has"));
            }
            if rangers.iter().any(|other| (other.board, other.channel) == (ranger.board, ranger.channel)) {
                item.refuse("channel", format_args!("one that no other of the {key} on this board has"));
            }
            item.end();
            rangers.push(ranger);
        }
        rangers
    }

    fn read(table: &mut Table<'_>, channel_max: u8) -> Self {
        use std::f64::consts::PI;
        Self {
            id: table.integer("id", None, 0..=255),
            board: table.integer("board", None, 1..=254),
            channel: table.integer("channel", None, 0..=channel_max),
            x: table.number("x", None, -10.0..=10.0),
            y: table.number("y", None, -10.0..=10.0),
            theta: table.number("theta", None, -PI..=PI),
        }
    }
}
