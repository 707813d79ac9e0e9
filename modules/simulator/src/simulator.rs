//! The simulator: a module that sits on the robot's buses and answers as its boards would.

use crate::auxiliary::{Auxiliary, HostConfig, I2cConfig, W1Config};
use crate::boards::battery::BatteryConfig;
use crate::boards::can_line::CanLine;
use crate::boards::drive::{Disobedience, Drive, DriveConfig, Layout};
use crate::boards::drive_line::{DriveLine, DriveLineConfig};
use crate::boards::encoder::{Axis, Wrong};
use crate::boards::feed_line::FeedLine;
use crate::boards::io_node::{IoNode, IoNodeConfig};
use crate::boards::line::{Board, Kind, SerialLine, Wire};
use crate::boards::output::{Output as FeedOutput, OutputConfig};
use crate::boards::psc1::{self, Psc1};
use crate::boards::sbs1::{Sbs1, Sbs1Config};
use crate::boards::sd1::{RANGER_PERIOD, Sd1, Sd1Config};
use crate::boards::so1::So1;
use crate::body::{Parameters, STEP};
use crate::faults::{self, InjectedFault};
use crate::gamepad::{self, Gamepad};
use crate::imu::{ImuConfig, Imus};
use crate::io::{ComputerConfig, ExchangeConfig, Io, LineConfig, ModbusConfig};
use crate::lidar::{LidarConfig, Lidars};
use crate::random::Random;
use crate::scene::Scene;
use crate::sonar::Sonar;
use crate::world::World;
use base::can::Frame;
use base::{Deadlines, Duration, Fault, Instant, Severity};
use kinematics::Chassis;
use messages::{Channel, Message, simulation};
use module::{Actions, Event, Input, Line, Module, Output, PortId, PortSpec};
use rs485::boards::sd1::PauseSource;
use rs485::crc::Crc8;
use rs485::slave::{self, Slave};

/// The target of what is done to the whole of it.
const ROBOT: &str = "robot";
/// Period of `SIM_DATA_TRUTH`.
const TRUTH: Duration = Duration::from_millis(50);
/// Period of `SIM_DATA_CLOCK`.
const CLOCK: Duration = Duration::from_secs(1);
/// Period of `SIM_DATA_PEOPLE`.
const PEOPLE: Duration = Duration::from_millis(200);

/// A board of a serial bus.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardConfig {
    /// Name, the target of faults: `sd1_front`.
    pub name: String,
    /// Address on the bus.
    pub address: u8,
    /// Kind.
    pub kind: BoardKind,
}

/// Kinds of boards.
#[derive(Clone, Debug, PartialEq)]
pub enum BoardKind {
    /// BR-SD1 and what hangs on it.
    Sd1(Sd1Config),
    /// BR-SO1.
    So1,
    /// BR-SBS1, where it sits, and how well it sees.
    Sbs1(Sbs1Config),
    /// BR-PSC1 and its battery. It feeds the other boards and the motors.
    Psc1(BatteryConfig),
}

/// A serial bus and its boards.
#[derive(Clone, Debug, PartialEq)]
pub struct SerialConfig {
    /// The bus's name, as its driver has it: `rs485.a`.
    pub bus: String,
    /// Bd.
    pub baud: u32,
    /// The bus's CRC.
    pub crc: Crc8,
    /// True if the port has a wire of its own, whatever [`Config::wire_time`] is for the others.
    pub real: bool,
    /// The boards on it.
    pub boards: Vec<BoardConfig>,
}

/// A CAN bus and its drives.
#[derive(Clone, Debug, PartialEq)]
pub struct CanConfig {
    /// The bus's name, as its driver has it: `can.main`.
    pub bus: String,
    /// bit/s.
    pub bitrate: u32,
    /// Its drives, in the order in which each step asks them.
    pub drives: Vec<DriveConfig>,
    /// Output of another node that feeds the motors, if there is one.
    pub output: Option<OutputConfig>,
    /// Devices with inputs and outputs.
    pub devices: Vec<IoNodeConfig>,
}

/// Configuration of the simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// World with the robot's start pose.
    pub world: World,
    /// Body.
    pub parameters: Parameters,
    /// Its wheels, each with a motor; absent: a driven axle and steered wheels.
    pub wheels: Option<Chassis>,
    /// Acoustics of its sonars.
    pub sonar: Sonar,
    /// The seed of all noise.
    pub seed: u64,
    /// The CAN bus.
    pub can: Option<CanConfig>,
    /// Further CAN buses, with names of their own.
    pub further: Vec<CanConfig>,
    /// Serial lines with motor controllers.
    pub drive_lines: Vec<DriveLineConfig>,
    /// The serial buses.
    pub serial: Vec<SerialConfig>,
    /// The I2C buses.
    pub i2c: Vec<I2cConfig>,
    /// The 1-Wire bus.
    pub w1: Option<W1Config>,
    /// Temperatures of the computer.
    pub host: Option<HostConfig>,
    /// Port of the GPIO line that feeds the motors, as in its driver, if there is one.
    pub line: Option<String>,
    /// Modbus lines of `driver_io`.
    pub modbus: Vec<ModbusConfig>,
    /// Other serial lines of `driver_io`.
    pub exchange: Vec<ExchangeConfig>,
    /// GPIO lines of `driver_io`.
    pub gpio: Vec<LineConfig>,
    /// Computers that the power controller feeds.
    pub computers: Vec<ComputerConfig>,
    /// Lidars.
    pub lidars: Vec<LidarConfig>,
    /// Inertial measurement units; those on CAN are on the bus of the drives.
    pub imus: Vec<ImuConfig>,
    /// The PAUSE line makes the propulsion drive brake, and cuts the motors' feed after this time; zero: at once.
    pub pause_delay: Duration,
    /// Port of a gamepad, as in its driver: `joystick`. It is unplugged until requested.
    pub gamepad: Option<String>,
    /// True if answers are delayed by the time that request and answer take on the wire: true where the port has no
    /// wire (a pseudo-terminal), false where the host models it (`host::Virtual`) or it is real.
    pub wire_time: bool,
    /// Value of `SIM_DATA_CLOCK`: the factor by which it runs faster than real time.
    pub rate: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            world: World::hall(20.0, 12.0),
            parameters: Parameters::default(),
            wheels: None,
            sonar: Sonar::default(),
            seed: 1,
            can: None,
            further: Vec::new(),
            drive_lines: Vec::new(),
            serial: Vec::new(),
            i2c: Vec::new(),
            w1: None,
            host: None,
            line: None,
            modbus: Vec::new(),
            exchange: Vec::new(),
            gpio: Vec::new(),
            computers: Vec::new(),
            lidars: Vec::new(),
            imus: Vec::new(),
            pause_delay: Duration::ZERO,
            gamepad: None,
            wire_time: false,
            rate: 1.0,
        }
    }
}

base::deadlines! {
    /// Periodic work of the simulator; its boards have deadlines of their own.
    enum Timer {
        /// `SIM_DATA_TRUTH` is published.
        Truth,
        /// `SIM_DATA_CLOCK` is published.
        Clock,
        /// `SIM_DATA_PEOPLE` is published. Set in a world with people.
        People,
        /// The floor rangers measure. Set in a world with drops.
        Rangers,
        /// The PAUSE line cuts the motors' feed. Set from its engagement on.
        Cut,
    }
}

/// The module `simulator`. Its ports: the first CAN bus, if there is one, then the serial and the I2C buses in the
/// order of its configuration, then the 1-Wire bus, if there is one, the computer's temperatures, the gamepad, the GPIO
/// line, the lines of `driver_io`, the lidars, the inertial measurement units that have a line of their own, the lines
/// of motor controllers, and the further CAN buses.
pub struct Simulator {
    config: Config,
    ports: Vec<PortSpec>,
    scene: Scene,
    drives: Vec<Drive>,
    drive_lines: Vec<DriveLine>,
    /// Output of a node that feeds the motors, and the number of its CAN bus.
    output: Option<(FeedOutput, usize)>,
    devices: Vec<IoNode>,
    feed_line: Option<FeedLine>,
    /// The CAN buses; a robot without one has an idle one.
    can: Vec<CanLine>,
    lines: Vec<SerialLine>,
    auxiliary: Auxiliary,
    gamepad: Gamepad,
    io: Io,
    lidars: Lidars,
    imus: Imus,
    deadlines: Deadlines<Timer>,
    /// True if the motors are fed.
    motors: bool,
    /// True if the PAUSE line cuts their feed.
    cut: bool,
    /// Ports whose state is known; modules that depend on the simulator start when all are.
    told: Vec<PortId>,
}

impl Simulator {
    /// The simulator of this configuration; its time begins with its start.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let of_can = |can: &CanConfig| PortSpec { bus: can.bus.clone(), line: Line::Can { bitrate: can.bitrate } };
        let can = config.can.iter().map(of_can);
        let serial = config
            .serial
            .iter()
            .map(|serial| PortSpec { bus: serial.bus.clone(), line: Line::Serial { baud: serial.baud } });
        let i2c = config.i2c.iter().map(|i2c| PortSpec { bus: i2c.bus.clone(), line: Line::I2c { hz: i2c.hz } });
        let w1 = config.w1.iter().map(|w1| PortSpec { bus: w1.bus.clone(), line: Line::OneWire });
        let host = config.host.iter().map(|host| PortSpec { bus: host.bus.clone(), line: Line::Thermal });
        let gamepad = config.gamepad.iter().map(|bus| PortSpec { bus: bus.clone(), line: Line::Gamepad });
        let line = config.line.iter().map(|bus| PortSpec { bus: bus.clone(), line: Line::Gpio });
        let modbus = config
            .modbus
            .iter()
            .map(|modbus| PortSpec { bus: modbus.bus.clone(), line: Line::Serial { baud: modbus.line.baud() } });
        let exchange = config.exchange.iter();
        let exchange = exchange.map(|line| PortSpec { bus: line.bus.clone(), line: Line::Serial { baud: line.baud } });
        let gpio = config.gpio.iter().map(|line| PortSpec { bus: line.bus.clone(), line: Line::Gpio });
        let lidars = config
            .lidars
            .iter()
            .map(|lidar| PortSpec { bus: lidar.bus.clone(), line: Line::Serial { baud: lidar.baud } });
        let own_line =
            |imu: &ImuConfig| Some(PortSpec { bus: imu.bus.clone(), line: Line::Serial { baud: imu.baud? } });
        let imus = config.imus.iter().filter_map(own_line);
        let ports = can.chain(serial).chain(i2c).chain(w1).chain(host).chain(gamepad).chain(line).chain(modbus);
        let ports = ports.chain(exchange).chain(gpio);
        let drive_lines = config
            .drive_lines
            .iter()
            .map(|line| PortSpec { bus: line.bus.clone(), line: Line::Serial { baud: line.baud } });
        let ports = ports.chain(lidars).chain(imus).chain(drive_lines).chain(config.further.iter().map(of_can));
        let ports = ports.collect();
        Self {
            scene: scene(&config, Instant::ZERO),
            drives: Vec::new(),
            drive_lines: Vec::new(),
            output: None,
            devices: Vec::new(),
            feed_line: None,
            can: can_lines(&config),
            lines: Vec::new(),
            auxiliary: Auxiliary::new(&[], None, None, Instant::ZERO),
            gamepad: Gamepad::default(),
            io: Io::default(),
            lidars: Lidars::default(),
            imus: Imus::default(),
            config,
            ports,
            deadlines: Deadlines::new(),
            motors: true,
            cut: false,
            told: Vec::new(),
        }
    }

    /// The robot in its world.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    fn start(&mut self, now: Instant, out: &mut Actions) {
        self.scene = scene(&self.config, now);
        (self.motors, self.cut) = (true, false);
        self.gamepad = Gamepad::default();
        self.io = Io::new(&self.config.modbus, &self.config.exchange, &self.config.gpio, &self.config.computers);
        self.lidars = Lidars::new(&self.config.lidars, now);
        self.imus = Imus::new(&self.config.imus, now, &self.scene);
        self.lines = self.config.serial.iter().map(|serial| self.line(serial, now)).collect();
        let (w1, host) = (self.config.w1.as_ref(), self.config.host.as_ref());
        self.auxiliary = Auxiliary::new(&self.config.i2c, w1, host, now);
        let body = self.scene.body();
        self.can = can_lines(&self.config);
        let drives = self.buses().flat_map(|(bus, can)| can.drives.iter().map(move |drive| (bus, drive)));
        let drive = |(bus, config): (usize, &DriveConfig)| {
            let mut drive = Drive::new(config.clone(), body);
            drive.bus = bus;
            drive
        };
        self.drives = drives.map(drive).collect();
        for drive in &mut self.drives {
            drive.power_on(now, body);
        }
        let lines = self.config.drive_lines.iter();
        self.drive_lines = lines.map(|line| drive_line(line, self.config.wire_time, &self.scene)).collect();
        for line in &mut self.drive_lines {
            line.power_on(now, self.scene.body());
        }
        let output = self.buses().find_map(|(bus, can)| Some((can.output?, bus)));
        self.output = output.map(|(output, bus)| (FeedOutput::new(output, now), bus));
        let devices = self.buses().flat_map(|(bus, can)| can.devices.iter().map(move |device| (bus, device)));
        let device = |(bus, config): (usize, &IoNodeConfig)| {
            let mut device = IoNode::new(config.clone(), now);
            device.bus = bus;
            device
        };
        self.devices = devices.map(device).collect();
        self.feed_line = self.config.line.as_ref().map(|_| FeedLine::default());
        self.deadlines = Deadlines::new().with(Timer::Truth, now).with(Timer::Clock, now);
        // Without drops the floor rangers find nothing.
        if !self.scene.world().drops.is_empty() {
            self.deadlines.set(Timer::Rangers, now + RANGER_PERIOD);
        }
        if !self.scene.people().is_empty() {
            self.deadlines.set(Timer::People, now);
        }
        if self.ports.is_empty() {
            out.working();
        }
    }

    /// The number of the I2C bus at a port; one more for the 1-Wire bus.
    fn i2c_of(&self, port: PortId) -> Option<usize> {
        usize::from(port.0).checked_sub(self.first_i2c())
    }

    /// The number of the line of `driver_io` at a port.
    fn io_of(&self, port: PortId) -> Option<usize> {
        let place = usize::from(port.0).checked_sub(self.first_io())?;
        (place < self.io_ports()).then_some(place)
    }

    /// The number of the lidar at a port.
    fn lidar_of(&self, port: PortId) -> Option<usize> {
        let place = usize::from(port.0).checked_sub(self.first_lidar())?;
        (place < self.config.lidars.len()).then_some(place)
    }

    /// True for the port of an inertial measurement unit: nothing is sent to it.
    fn is_imu(&self, port: PortId) -> bool {
        (self.first_imu()..self.first_drive_line()).contains(&usize::from(port.0))
    }

    /// The number of the line of a motor controller at a port.
    fn drive_line_of(&self, port: PortId) -> Option<usize> {
        usize::from(port.0).checked_sub(self.first_drive_line())
    }

    fn first_drive_line(&self) -> usize {
        self.first_further() - self.config.drive_lines.len()
    }

    fn first_further(&self) -> usize {
        self.ports.len() - self.config.further.len()
    }

    /// The CAN buses with their numbers.
    fn buses(&self) -> impl Iterator<Item = (usize, &CanConfig)> {
        let first = self.config.can.iter().map(|can| (0, can));
        first.chain((1..).zip(&self.config.further))
    }

    /// Port of a CAN bus.
    fn can_port(&self, bus: usize) -> PortId {
        PortId(bus.checked_sub(1).map_or(0, |place| self.first_further() + place) as u8)
    }

    /// Number of the CAN bus at a port.
    fn can_of(&self, port: PortId) -> Option<usize> {
        self.buses().map(|(bus, _)| bus).find(|bus| self.can_port(*bus) == port)
    }

    fn first_imu(&self) -> usize {
        self.first_drive_line() - self.config.imus.iter().filter(|imu| imu.baud.is_some()).count()
    }

    fn first_lidar(&self) -> usize {
        self.first_imu() - self.config.lidars.len()
    }

    fn first_io(&self) -> usize {
        self.first_lidar() - self.io_ports()
    }

    /// Ports of `driver_io`'s lines.
    fn io_ports(&self) -> usize {
        self.config.modbus.len() + self.config.exchange.len() + self.config.gpio.len()
    }

    fn first_i2c(&self) -> usize {
        usize::from(self.config.can.is_some()) + self.config.serial.len()
    }

    fn on_port_state(&mut self, now: Instant, port: PortId, up: bool, out: &mut Actions) {
        if let Some(line) = self.io_of(port) {
            self.io.forget(line);
        }
        match self.i2c_of(port) {
            Some(bus) if bus < self.config.i2c.len() => self.auxiliary.forget(bus),
            Some(bus) if up && bus == self.config.i2c.len() && self.config.w1.is_some() => self.auxiliary.on_w1_up(now),
            _ => {}
        }
        if up && self.ports.get(usize::from(port.0)).is_some_and(|spec| spec.line == Line::Thermal) {
            self.show_computer(now, out);
        }
        if !self.told.contains(&port) {
            self.told.push(port);
            if self.told.len() == self.ports.len() {
                out.working();
            }
        }
    }

    /// Sends the temperatures of the computer.
    fn show_computer(&self, now: Instant, out: &mut Actions) {
        if let Some(port) = self.ports.iter().position(|port| port.line == Line::Thermal) {
            let state = self.auxiliary.computer(now);
            out.push(module::Action::Send(PortId(port as u8), Output::ThermalState(state)));
        }
    }

    fn line(&self, serial: &SerialConfig, now: Instant) -> SerialLine {
        let board = |board: &BoardConfig| {
            let config = slave::Config { baud: serial.baud, crc: serial.crc, ..slave::Config::new(board.address) };
            let kind = match &board.kind {
                BoardKind::Sd1(config) => Kind::Sd1(Box::new(Sd1::new(board.address, config.clone(), now))),
                BoardKind::So1 => Kind::So1(So1::new(&self.scene)),
                BoardKind::Sbs1(config) => Kind::Sbs1(Sbs1::new(board.address, *config, now)),
                BoardKind::Psc1(battery) => Kind::Psc1(Box::new(Psc1::new(*battery, now))),
            };
            Board::new(&board.name, Slave::new(config), kind)
        };
        let boards: Vec<Board> = serial.boards.iter().map(board).collect();
        let chance = self.scene.random(serial.bus.bytes().fold(0, |sum, byte| sum << 8 | u64::from(byte)));
        let wire = match (self.config.wire_time, serial.real) {
            (_, true) => Wire::Real,
            (true, false) => Wire::None,
            (false, false) => Wire::Modelled,
        };
        SerialLine::new(serial.baud, serial.crc, wire, boards, chance)
    }

    /// The number of the serial line at a port.
    fn line_of(&self, port: PortId) -> Option<usize> {
        usize::from(port.0).checked_sub(usize::from(self.config.can.is_some()))
    }

    /// Lets drives and body move up to `now`.
    fn catch_up(&mut self, now: Instant) {
        while !self.rests() && self.scene.next_step() <= now {
            self.step();
        }
        self.scene.skip(now);
    }

    /// True if no step is needed until something comes from outside.
    fn rests(&self) -> bool {
        self.scene.rests() && self.drives.iter().all(Drive::rests) && self.drive_lines.iter().all(DriveLine::rests)
    }

    fn step(&mut self) {
        let (at, dt) = (self.scene.next_step(), STEP.as_nanos() as f64 / 1e9);
        for drive in &mut self.drives {
            let demand = drive.step(at, self.scene.body(), dt);
            match drive.axis() {
                Axis::Wheel(wheel) => {
                    if let Some(own) = self.scene.demand.wheels.get_mut(usize::from(wheel)) {
                        *own = demand;
                    }
                }
                Axis::Steering => self.scene.demand.steering = demand,
            }
        }
        let wheels = self.scene.demand.wheels.len();
        for line in &mut self.drive_lines {
            let demands: Vec<_> = line.demands(at, self.scene.body()).collect();
            for (wheel, demand) in demands.into_iter().filter(|(wheel, _)| usize::from(*wheel) < wheels) {
                self.scene.demand.wheels[usize::from(wheel)] = demand;
            }
        }
        let before = self.scene.body().steering_output();
        self.scene.step();
        let turned = (self.scene.body().steering_output() - before) / dt;
        for drive in &mut self.drives {
            drive.stepped(at, self.scene.body(), turned);
        }
        for line in &mut self.drive_lines {
            line.handle_timeout(at, self.scene.body());
        }
        if self.scene.body().is_blocked() {
            for board in boards(&mut self.lines) {
                if let Kind::Psc1(psc1) = &mut board.kind {
                    psc1.bump(at, &self.scene);
                }
            }
            self.wire_up(at);
        }
    }

    /// Wired connections: the PAUSE line, which cuts the motors' supply by itself, and the supply of motors and boards.
    fn wire_up(&mut self, now: Instant) {
        let scene = &self.scene;
        let pulls = boards(&mut self.lines).find_map(|board| match &board.kind {
            Kind::Sd1(sd1) if sd1.pause() != PauseSource::None => Some(sd1.address()),
            _ => None,
        });
        let (mut engaged, mut feeds, mut sensors) = (pulls.is_some(), true, true);
        for board in boards(&mut self.lines) {
            if let Kind::Psc1(psc1) = &mut board.kind {
                psc1.pull(pulls);
                psc1.handle_timeout(now, scene);
                engaged = psc1.is_engaged();
                feeds = psc1.feeds(psc1::MOTORS);
                self.io.supply(now, |channel| psc1.feeds(channel));
                sensors = psc1.feeds(psc1::SENSORS);
            }
        }
        for board in boards(&mut self.lines).filter(|board| !matches!(board.kind, Kind::Psc1(_))) {
            board.feed(now, sensors, scene);
        }
        for line in &mut self.lines {
            line.speak(now);
        }
        let feeds = feeds && self.output.as_ref().is_none_or(|(output, _)| output.feeds());
        let feeds = feeds && self.feed_line.as_ref().is_none_or(FeedLine::feeds);
        let motors = feeds && !self.cuts(now, engaged);
        self.scene.demand.unfed = !motors;
        if self.motors != motors {
            self.motors = motors;
            for drive in &mut self.drives {
                drive.feed_motor(now, motors, self.scene.body());
            }
            for line in &mut self.drive_lines {
                line.feed(now, motors, self.scene.body());
            }
        }
    }

    /// True if the PAUSE line cuts the motors' feed.
    fn cuts(&mut self, now: Instant, engaged: bool) -> bool {
        if !engaged {
            self.deadlines.clear(Timer::Cut);
            self.cut = false;
        } else if !self.cut && !self.deadlines.is_set(Timer::Cut) {
            self.deadlines.set(Timer::Cut, now + self.config.pause_delay);
            if self.config.pause_delay > Duration::ZERO {
                for drive in &mut self.drives {
                    drive.brake(now, self.scene.body());
                }
            }
        }
        if self.deadlines.take(Timer::Cut, now) {
            self.cut = true;
        }
        self.cut
    }

    fn timer(&mut self, now: Instant, out: &mut Actions) {
        if self.deadlines.tick(Timer::Truth, now, TRUTH) {
            out.publish(self.truth(out.timestamp(now)));
        }
        if self.deadlines.tick(Timer::Clock, now, CLOCK) {
            out.publish(simulation::DataClock { timestamp: out.timestamp(now), rate: self.config.rate });
        }
        if self.deadlines.tick(Timer::People, now, PEOPLE) {
            out.publish(self.people(now, out.timestamp(now)));
        }
        if self.deadlines.tick(Timer::Rangers, now, RANGER_PERIOD) {
            for board in boards(&mut self.lines) {
                if let Kind::Sd1(board) = &mut board.kind {
                    board.sample(now, &self.scene);
                }
            }
        }
        for drive in &mut self.drives {
            drive.handle_timeout(now, self.scene.body());
        }
        for line in &mut self.drive_lines {
            line.handle_timeout(now, self.scene.body());
        }
        if let Some((output, _)) = &mut self.output {
            output.handle_timeout(now);
        }
        self.devices.iter_mut().for_each(|device| device.handle_timeout(now));
        self.can.iter_mut().for_each(|can| can.handle_timeout(now));
        self.gamepad.handle_timeout(now);
        for line in &mut self.lines {
            line.handle_timeout(now);
        }
        if self.auxiliary.handle_timeout(now, self.scene.body().speed()) {
            self.show_computer(now, out);
        }
        self.lidars.handle_timeout(now, &self.scene);
        self.imus.handle_timeout(now, &self.scene);
    }

    /// A frame on a CAN bus: all on that bus receive it.
    fn on_frame(&mut self, now: Instant, port: PortId, frame: &Frame) {
        let Some(bus) = self.can_of(port) else { return };
        if !self.can[bus].passes(now, frame) {
            return;
        }
        self.can[bus].handle_rx(now, frame);
        if let Some((output, _)) = self.output.as_mut().filter(|(_, own)| *own == bus) {
            output.handle_rx(now, frame);
        }
        let devices = self.devices.iter_mut().filter(|device| device.bus == bus);
        devices.for_each(|device| device.handle_rx(now, frame));
        for drive in self.drives.iter_mut().filter(|drive| drive.bus == bus) {
            drive.handle_rx(now, frame, self.scene.body());
        }
    }

    fn truth(&self, timestamp: i64) -> simulation::DataTruth {
        let body = self.scene.body();
        let clearance = self.scene.clearance();
        simulation::DataTruth {
            timestamp,
            x: body.pose().x,
            y: body.pose().y,
            theta: body.pose().theta.radians(),
            speed: body.speed(),
            steering: body.steering(),
            // What is infinite has no place in JSON.
            clearance: if clearance.is_finite() { clearance } else { f64::NAN },
            collisions: i32::try_from(body.collisions()).unwrap_or(i32::MAX),
        }
    }

    fn people(&self, now: Instant, timestamp: i64) -> simulation::DataPeople {
        let mut people = simulation::DataPeople { timestamp, ..simulation::DataPeople::default() };
        for (at, radius) in self.scene.people_at(now) {
            people.x.push(at.x);
            people.y.push(at.y);
            people.radius.push(radius);
        }
        people
    }

    fn fault(&mut self, now: Instant, command: &simulation::CmdFault, out: &mut Actions) {
        let until = faults::until(now, command.duration);
        let known = match &*command.target {
            ROBOT => self.carry_off(&command.fault, command.value),
            gamepad::TARGET if self.config.gamepad.is_some() => {
                self.gamepad.ask(now, &command.fault, command.value, until)
            }
            target => InjectedFault::from_name(&command.fault, command.value)
                .is_some_and(|injected| self.inject(now, target, injected, until)),
        };
        if !known {
            let subject = format!("{} {}", command.target, command.fault);
            let why =
                format!("fault {} of {}: no such target, or not a fault of its kind", command.fault, command.target);
            out.report(Severity::Warning, Fault::FaultUnknown, subject, why);
        }
    }

    /// Moves the robot by hand (kidnapped robot).
    fn carry_off(&mut self, fault: &str, value: f64) -> bool {
        match fault.strip_prefix("put:") {
            Some(pose) => faults::pose(pose).is_some_and(|pose| self.scene.put(pose)),
            None => fault == "kidnap" && self.scene.kidnap(value.to_bits()),
        }
    }

    /// Injects a fault into a target; false if there is no such target, or it cannot have that fault.
    fn inject(&mut self, now: Instant, target: &str, injected: InjectedFault, until: Instant) -> bool {
        let wheels = self.drives.iter().filter(|drive| drive.axis() != Axis::Steering).count();
        let wheels = wheels + self.drive_lines.iter().flat_map(DriveLine::motors).count();
        if let Some(drive) = self.drives.iter_mut().find(|drive| drive.config.name == target) {
            match injected {
                InjectedFault::Silent => drive.silent_until = until,
                InjectedFault::None => {
                    drive.silent_until = now;
                    drive.disobey(None, now);
                    drive.open(None, now);
                    drive.misread(None, now, self.scene.body());
                    drive.set_layout(now, Layout::Usual, self.scene.body());
                    self.can[drive.bus].heal_node(drive.config.node);
                }
                InjectedFault::Fault(code) => drive.fault(now, code, self.scene.body()),
                InjectedFault::Reboot => drive.power_on(now, self.scene.body()),
                InjectedFault::Unbraked => return drive.disobey(Some(Disobedience::Unbraked), until),
                InjectedFault::Runaway(by) => return drive.disobey(Some(Disobedience::Runaway(by)), until),
                InjectedFault::Encoder(factor) => {
                    return drive.misread(Some(Wrong::Scaled(factor)), until, self.scene.body());
                }
                InjectedFault::Swapped(wheel) if usize::from(wheel) <= wheels => {
                    return drive.misread(Some(Wrong::Of(wheel - 1)), until, self.scene.body());
                }
                InjectedFault::Swapped(_) => return false,
                InjectedFault::Opened(bit) => return drive.open(Some(bit), until),
                InjectedFault::Layout => return drive.set_layout(now, Layout::Other, self.scene.body()),
                injected => {
                    let DriveConfig { node, kind, .. } = &drive.config;
                    let objects = kind.dictionary(*node);
                    return self.can[drive.bus].inject_node(now, *node, injected, until, objects);
                }
            }
            return true;
        }
        let body = self.scene.body();
        if let Some(line) = self.drive_lines.iter_mut().find(|line| line.motors().any(|name| name == target)) {
            return line.inject(now, target, injected, until, (wheels, body));
        }
        if let Some(line) = self.drive_lines.iter_mut().find(|line| line.config.bus == target) {
            return line.disturb(now, injected, until);
        }
        if let Some((output, _)) = self.output.as_mut().filter(|_| target == FeedOutput::NAME) {
            let silent = match injected {
                InjectedFault::Silent => until,
                InjectedFault::None => now,
                _ => return false,
            };
            output.silent_until = silent;
            return true;
        }
        if let Some(device) = self.devices.iter_mut().find(|device| device.config.name == target) {
            return device.inject(now, injected, until);
        }
        if let Some(line) = self.feed_line.as_mut().filter(|_| target == FeedLine::NAME) {
            return line.inject(now, injected, until);
        }
        let bus = self.buses().find(|(_, can)| can.bus == target).map(|(bus, _)| bus);
        if let Some(can) = bus.and_then(|bus| self.can.get_mut(bus)) {
            return can.inject(now, injected, until);
        }
        if let Some(line) = self.config.serial.iter().position(|serial| serial.bus == target) {
            return self.lines[line].disturb(now, injected, until);
        }
        if self.auxiliary.inject(now, target, injected, until)
            || self.io.inject(now, target, injected, until)
            || self.lidars.inject(now, target, injected, until)
            || self.imus.inject(now, target, injected, until)
        {
            return true;
        }
        let board = boards(&mut self.lines).find(|board| board.name == target);
        board.is_some_and(|board| board.inject(now, injected, until, &self.scene))
    }

    fn drain_can(&mut self, now: Instant, bus: usize, out: &mut Actions) {
        let (port, can) = (self.can_port(bus), &mut self.can[bus]);
        for drive in self.drives.iter_mut().filter(|drive| drive.bus == bus) {
            while let Some(frame) = drive.poll_tx() {
                if can.passes(now, &frame) {
                    out.send_can(port, frame);
                }
            }
        }
        let mut output = self.output.as_mut().filter(|(_, own)| *own == bus);
        while let Some(frame) = output.as_mut().and_then(|(output, _)| output.poll_tx(now)) {
            if can.passes(now, &frame) {
                out.send_can(port, frame);
            }
        }
        for device in self.devices.iter_mut().filter(|device| device.bus == bus) {
            while let Some(frame) = device.poll_tx(now) {
                if can.passes(now, &frame) {
                    out.send_can(port, frame);
                }
            }
        }
        while let Some(frame) = can.poll_tx(now) {
            if can.passes(now, &frame) {
                out.send_can(port, frame);
            }
        }
    }

    fn drain(&mut self, now: Instant, out: &mut Actions) {
        for bus in 0..self.can.len() {
            self.drain_can(now, bus, out);
        }
        let first = usize::from(self.config.can.is_some());
        for (port, line) in (first..).zip(&mut self.lines) {
            while let Some(words) = line.poll_tx(now) {
                out.push(module::Action::Send(PortId(port as u8), Output::Words(words)));
            }
        }
        let first = self.first_io();
        while let Some((line, words)) = self.io.poll_tx(now) {
            out.push(module::Action::Send(PortId((first + line) as u8), Output::Words(words)));
        }
        let first = self.first_lidar();
        while let Some((lidar, words)) = self.lidars.poll_tx(now) {
            out.push(module::Action::Send(PortId((first + lidar) as u8), Output::Words(words)));
        }
        let first = self.first_imu();
        while let Some((line, words)) = self.imus.poll_tx() {
            out.push(module::Action::Send(PortId((first + line) as u8), Output::Words(words)));
        }
        let first = self.first_drive_line();
        for (port, line) in (first..).zip(&mut self.drive_lines) {
            while let Some(words) = line.poll_tx(now) {
                out.push(module::Action::Send(PortId(port as u8), Output::Words(words)));
            }
        }
        while let Some(frame) = self.imus.poll_frame() {
            // Those on CAN are on the first bus.
            if self.config.can.is_some() && self.can[0].passes(now, &frame) {
                out.send_can(PortId(0), frame);
            }
        }
        let first = self.first_i2c();
        while let Some((bus, outcome)) = self.auxiliary.poll_outcome(now) {
            out.push(module::Action::Send(PortId((first + bus) as u8), Output::I2cAnswer(outcome)));
        }
        while let Some(answer) = self.auxiliary.poll_w1() {
            let port = PortId((first + self.config.i2c.len()) as u8);
            out.push(module::Action::Send(port, Output::OneWireState(answer)));
        }
        while let Some(event) = self.gamepad.poll() {
            if let Some(port) = self.ports.iter().position(|port| port.line == Line::Gamepad) {
                out.push(module::Action::Send(PortId(port as u8), Output::Gamepad(event)));
            }
        }
    }
}

fn boards(lines: &mut [SerialLine]) -> impl Iterator<Item = &mut Board> {
    lines.iter_mut().flat_map(|line| &mut line.boards)
}

fn can_lines(config: &Config) -> Vec<CanLine> {
    let first = config.can.as_ref().map_or(1, |can| can.bitrate);
    let bitrates = std::iter::once(first).chain(config.further.iter().map(|can| can.bitrate));
    let line = |(number, bitrate): (u64, u32)| {
        let chance = u64::from_le_bytes(*b"can line").wrapping_add(number);
        CanLine::new(bitrate, config.wire_time, Random::stream(config.seed, chance))
    };
    (0..).zip(bitrates).map(line).collect()
}

fn drive_line(config: &DriveLineConfig, wire_time: bool, scene: &Scene) -> DriveLine {
    let chance = config.bus.bytes().fold(0, |sum, byte| sum << 8 | u64::from(byte));
    DriveLine::new(config.clone(), wire_time, scene.random(chance ^ u64::from_le_bytes(*b"uart    ")))
}

fn scene(config: &Config, start: Instant) -> Scene {
    let scene = Scene::new(start, config.world.clone(), config.parameters, config.sonar, config.seed);
    match &config.wheels {
        Some(chassis) => scene.on_wheels(chassis),
        None => scene,
    }
}

impl Module for Simulator {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::SimCmdFault]
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        if !matches!(event, Event::Start) {
            self.catch_up(now);
        }
        match event {
            Event::Start => self.start(now, out),
            Event::Timer => self.timer(now, out),
            Event::Port { port, input: Input::Words(words) } if !self.is_imu(port) => {
                if let Some(line) = self.drive_line_of(port).and_then(|line| self.drive_lines.get_mut(line)) {
                    line.handle_rx(now, words, self.scene.body());
                } else if let Some(lidar) = self.lidar_of(port) {
                    self.lidars.on_words(now, lidar, words);
                } else if let Some(line) = self.io_of(port) {
                    self.io.on_words(now, line, words);
                } else if let Some(line) = self.line_of(port).and_then(|line| self.lines.get_mut(line)) {
                    line.handle_rx(now, words, &self.scene);
                }
            }
            Event::Port { port, input: Input::I2cRequested(transfer) } => {
                if let Some(bus) = self.i2c_of(port).filter(|bus| *bus < self.config.i2c.len()) {
                    let answered = self.imus.answer(now, &self.config.i2c[bus].bus, transfer);
                    self.auxiliary.on_asked(now, bus, transfer, answered, self.config.wire_time);
                }
            }
            Event::Port { port, input: Input::Up } => self.on_port_state(now, port, true, out),
            Event::Port { port, input: Input::Down(_) } => self.on_port_state(now, port, false, out),
            Event::Port { port, input: Input::Can { frame, .. } } => self.on_frame(now, port, &frame),
            Event::Port { port, input: Input::Gpio(signal) } => {
                let answer = match self.io_of(port) {
                    Some(line) => self.io.on_signal(now, line, signal),
                    None => self.feed_line.as_mut().and_then(|line| line.answer(now, signal)),
                };
                if let Some(signal) = answer {
                    out.push(module::Action::Send(port, Output::Gpio(signal)));
                }
            }
            Event::Port { input: Input::Gamepad(input), .. } => self.gamepad.play(now, input.into()),
            Event::Message { message: Message::SimCmdFault(command), .. } => self.fault(now, command, out),
            _ => {}
        }
        self.wire_up(now);
        for contact in self.scene.take_contacts() {
            out.note(contact.to_string());
        }
        self.drain(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let step = (!self.rests()).then(|| self.scene.next_step());
        let parts = [self.gamepad.poll_timeout(), self.auxiliary.poll_timeout()].into_iter();
        let parts = parts.chain(self.lines.iter().map(SerialLine::poll_timeout));
        let drives = self.drives.iter().filter_map(Drive::poll_timeout);
        let drives = drives.chain(self.drive_lines.iter().filter_map(DriveLine::poll_timeout));
        let drives = drives.chain(self.output.as_ref().and_then(|(output, _)| output.poll_timeout()));
        let drives = drives.chain(self.devices.iter().filter_map(IoNode::poll_timeout));
        let can = self.can.iter().filter_map(CanLine::poll_timeout).min();
        let own = [self.deadlines.next(), step, can, self.io.poll_timeout()];
        let own = own.into_iter().chain([self.lidars.poll_timeout(), self.imus.poll_timeout()]).flatten();
        own.chain(parts).chain(drives).min()
    }
}

mod offered;

#[cfg(test)]
mod drive_tests;
#[cfg(test)]
mod tests;
