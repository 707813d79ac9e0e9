//! What can be broken: found by trying everything on everything, so that no list can differ from what is done.

use super::{Config, DriveLine, FeedLine, FeedOutput, ROBOT, Simulator, boards};
use crate::faults::{InjectedFault, NAMES};
use crate::gamepad::{self, Gamepad};
use crate::world::World;
use base::Instant;
use module::Actions;

/// Values tried: many faults take any, some one of a few.
const VALUES: [f64; 3] = [0.0, 1.0, 24.0];

impl Simulator {
    /// The targets of `SIM_CMD_FAULT` that there are with this configuration, each with the faults that it can have.
    /// The robot can be `put:X,Y,THETA`, too, which is no name.
    #[must_use]
    pub fn offered(config: Config) -> Vec<(String, Vec<&'static str>)> {
        let now = Instant::ZERO;
        let mut simulator = Self::new(Config { world: World::default(), ..config });
        simulator.start(now, &mut Actions::default());
        let mut offered = vec![(ROBOT.to_owned(), vec!["kidnap"])];
        if simulator.config.gamepad.is_some() {
            let does = |what: &&str| Gamepad::default().ask(now, what, 0.0, Instant::NEVER);
            offered.push((gamepad::TARGET.into(), gamepad::NAMES.iter().copied().filter(does).collect()));
        }
        for target in simulator.targets() {
            let mut accepts = |name: &&str| {
                let mut candidates = VALUES.iter().filter_map(|value| InjectedFault::from_name(name, *value));
                candidates.any(|injected| simulator.inject(now, &target, injected, now))
            };
            let faults = NAMES.iter().copied().filter(|name| accepts(name)).collect();
            offered.push((target, faults));
        }
        offered
    }

    /// All names: drives, motors on serial lines, output, CANopen devices, GPIO line, boards, chips, thermometers,
    /// temperatures of the computer, then buses, those of `[io]`, computers, the lidars and the inertial measurement
    /// units last.
    fn targets(&mut self) -> Vec<String> {
        let config = &self.config;
        let mut targets: Vec<String> = self.drives.iter().map(|drive| drive.config.name.clone()).collect();
        targets.extend(self.drive_lines.iter().flat_map(DriveLine::motors).map(String::from));
        targets.extend(self.output.iter().map(|_| FeedOutput::NAME.into()));
        targets.extend(self.devices.iter().map(|device| device.config.name.clone()));
        targets.extend(self.feed_line.iter().map(|_| FeedLine::NAME.into()));
        targets.extend(boards(&mut self.lines).map(|board| board.name.clone()));
        targets.extend(config.i2c.iter().flat_map(|i2c| &i2c.fans).map(|(name, _)| name.clone()));
        targets.extend(config.w1.iter().flat_map(|w1| &w1.thermometers).map(|(_, name)| name.clone()));
        targets.extend(config.host.iter().flat_map(|host| &host.sensors).map(|(_, name)| name.clone()));
        targets.extend(config.can.iter().chain(&config.further).map(|can| can.bus.clone()));
        targets.extend(config.drive_lines.iter().map(|line| line.bus.clone()));
        targets.extend(config.serial.iter().map(|serial| serial.bus.clone()));
        targets.extend(config.modbus.iter().map(|modbus| modbus.bus.clone()));
        targets.extend(config.exchange.iter().map(|line| line.bus.clone()));
        targets.extend(config.computers.iter().map(|computer| computer.channel.1.clone()));
        targets.extend(config.lidars.iter().map(|lidar| lidar.bus.clone()));
        targets.extend(config.imus.iter().map(|imu| imu.name.clone()));
        targets
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::auxiliary::{I2cConfig, W1Config};
    use crate::boards::drive::{DriveConfig, DriveKind};
    use crate::boards::drive_line::{DriveLineConfig, MotorConfig};
    use crate::boards::icla::Gearing;
    use crate::boards::output::OutputConfig;
    use crate::simulator::{BoardConfig, BoardKind, CanConfig, SerialConfig};
    use messages::simulation;
    use module::bench::Bench;
    use module::{Shell, ShellConfig};
    use rs485::crc::Crc8;

    fn drive_line() -> DriveLineConfig {
        let motor = |name: &str| MotorConfig { name: name.into(), wheel: 0, gear: 8.0 };
        DriveLineConfig {
            bus: "serial.wheels".into(),
            baud: 115_200,
            device: motorctl::serial::Device::RoboClaw(motorctl::roboclaw::Device::EXAMPLE),
            motors: vec![motor("left"), motor("right")],
        }
    }

    fn config() -> Config {
        let drive = |name: &str, node, kind| DriveConfig { name: name.into(), node, kind };
        let drives = vec![
            drive("propulsion", 1, DriveKind::Epos { wheel: 0, gear: 26.0 }),
            drive("steering", 2, DriveKind::Icla(Gearing::default())),
        ];
        let output = Some(OutputConfig { node: 5, index: 0x6200, sub: 1, bits: 8, on: 1 });
        let can = CanConfig { bus: "can.main".into(), bitrate: 500_000, drives, output, devices: Vec::new() };
        let board = |name: &str, address, kind| BoardConfig { name: name.into(), address, kind };
        let boards = vec![
            board("so1", 0x20, BoardKind::So1),
            board("sbs1", 0x30, BoardKind::Sbs1(Default::default())),
            board("psc1", 0x40, BoardKind::Psc1(Default::default())),
        ];
        let serial = SerialConfig { bus: "rs485.a".into(), baud: 115_200, crc: Crc8::SAE_J1850, real: false, boards };
        let fans = vec![("fan1".into(), base::i2c::Address::new(0x18).unwrap())];
        Config {
            can: Some(can),
            serial: vec![serial],
            i2c: vec![I2cConfig { bus: "i2c.aux".into(), hz: 100_000, fans }],
            w1: Some(W1Config {
                bus: "w1".into(),
                thermometers: vec![(base::w1::Rom::new(0x28, 1).unwrap(), "cabin".into())],
                switches: Vec::new(),
            }),
            drive_lines: vec![drive_line()],
            gamepad: Some("joystick".into()),
            line: Some("stop.gpio".into()),
            wire_time: true,
            ..Config::default()
        }
    }

    /// True if a simulator accepts the fault, with any value.
    fn takes(target: &str, fault: &str) -> bool {
        VALUES.into_iter().any(|value| {
            let mut bench = Bench::new(Shell::new(ShellConfig::new("simulator"), Box::new(Simulator::new(config()))));
            bench.start();
            bench.done();
            let (target, fault) = (target.into(), fault.into());
            bench.message(simulation::CmdFault { timestamp: 0, target, fault, value, duration: 0.1 });
            let refused = |action: &module::Action| {
                matches!(action, module::Action::Report(report) if report.fault == base::Fault::FaultUnknown)
            };
            !bench.done().iter().any(|(_, action)| refused(action))
        })
    }

    #[test]
    fn what_is_offered_is_taken_and_nothing_else_is() {
        let offered = Simulator::offered(config());
        let targets: Vec<&str> = offered.iter().map(|(target, _)| target.as_str()).collect();
        let all = [
            "robot",
            "gamepad",
            "propulsion",
            "steering",
            "left",
            "right",
            "output",
            "line",
            "so1",
            "sbs1",
            "psc1",
            "fan1",
            "cabin",
            "can.main",
            "serial.wheels",
            "rs485.a",
        ];
        assert_eq!(targets, all);
        for (target, faults) in &offered {
            assert!(!faults.is_empty(), "{target}");
            for name in NAMES.iter().chain(gamepad::NAMES).chain(&["kidnap"]) {
                assert_eq!(takes(target, name), faults.contains(name), "{target} {name}");
            }
        }
        let of = |target: &str| offered.iter().find(|(name, _)| name == target).unwrap().1.as_slice();
        assert!(of("psc1").contains(&"bumper") && of("psc1").contains(&"battery") && !of("so1").contains(&"bumper"));
        assert!(
            of("left").contains(&"garbled")
                && of("serial.wheels") == ["noise", "cut", "loss", "duplicate", "delay", "none"]
        );
        assert!(of("steering").contains(&"layout") && !of("propulsion").contains(&"layout"));
    }
}
