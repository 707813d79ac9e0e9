//! What can be known of a robot before anything of it starts: whether each module accepts its part of the
//! configuration, and what can be broken in the simulated one.

use crate::config::{Config, ConfigError, SIMULATOR};
use crate::place::RobotLocation;
use crate::topology::{self, HostOptions, shell_in};
use crate::{ports, simulated};
use drivers::canbus;
use module::{Shell, State};
use simulator::Simulator;
use simulator::world::World;

/// Makes every module of a configuration, as its process would, and drops it: a module that refuses its part of the
/// configuration would otherwise end at each start. Modules of other executables are not looked at. `world`: that of
/// the simulated robot. In virtual time that is all: its ports are nowhere.
///
/// # Errors
/// A line for each thing that a module refuses.
pub fn check(place: &RobotLocation, config: &Config, world: &World) -> Result<(), ConfigError> {
    made(place, config, world).map(drop)
}

/// The same for a robot of processes, whose ports are somewhere: each is one that its module can open, as far as the
/// text tells. Without the simulator a name in the run folder is no port; the simulator has no devices.
///
/// # Errors
/// A line for each thing that a module refuses, or for each key that names no such port.
pub fn check_live(place: &RobotLocation, config: &Config, world: &World) -> Result<(), ConfigError> {
    let shells = made(place, config, world)?;
    let ports = |shell: &Shell| {
        let simulated = shell.name() == SIMULATOR;
        shell.module().ports().iter().map(|port| (port.bus.clone(), simulated)).collect::<Vec<_>>()
    };
    ports::check(place, config, &shells.iter().flat_map(ports).collect::<Vec<_>>())
}

fn made(place: &RobotLocation, config: &Config, world: &World) -> Result<Vec<Shell>, ConfigError> {
    let options = HostOptions { guarded: true, ..HostOptions::LIVE };
    let own = config.modules.iter().filter(|module| module.command.is_none());
    let (mut shells, mut lines) = (Vec::new(), Vec::new());
    for module in own {
        match shell_in(place, config, module.name(), State::Run, options, || Ok(world.clone())) {
            Ok(shell) => shells.push(shell),
            Err(ConfigError(refused)) => lines.extend(refused),
        }
    }
    if place.sim && lines.is_empty() {
        let misfits = topology::misfits(place, config).into_iter().filter(|misfit| misfit.is_simulated);
        lines.extend(misfits.map(|misfit| misfit.remark + "; the simulated drive is so"));
    }
    lines.dedup();
    if lines.is_empty() { Ok(shells) } else { Err(ConfigError(lines)) }
}

/// What is allowed, and may not be meant: in the data sheets of the drives, with file and line, and in the list of
/// modules. Of a configuration that [`check`] refuses: nothing of the sheets.
#[must_use]
pub fn remarks(place: &RobotLocation, config: &Config) -> Vec<String> {
    let robot = &config.robot;
    let has_drives = !robot.serial.is_empty() || robot.can.iter().any(|bus| !bus.driver.nodes.is_empty());
    // Of several computers each has modules of its own.
    let is_moved = !robot.bridge.is_empty() || config.modules.iter().any(|module| module.name() == canbus::NAME);
    let unmoved = (has_drives && !is_moved).then(|| {
        let file = place.config.join("modules.toml");
        format!("{}: no module {}, which moves the drives of robot.toml", file.display(), canbus::NAME)
    });
    let misfits = topology::misfits(place, config).into_iter().map(|misfit| misfit.remark);
    misfits.chain(unmoved).collect()
}

/// The targets of `SIM_CMD_FAULT` of the simulated robot, each with the faults that it can have.
///
/// # Errors
/// The configuration is invalid.
pub fn faults(place: &RobotLocation) -> Result<Vec<(String, Vec<&'static str>)>, ConfigError> {
    let config = Config::load(&place.config, true, &place.sets)?;
    let wire_time = HostOptions::LIVE.wire_time;
    Ok(Simulator::offered(simulated::config(place, World::default(), &config.robot, wire_time)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::{Path, PathBuf};

    fn place(config: PathBuf, sim: bool) -> RobotLocation {
        RobotLocation {
            config,
            run_dir: "/run/advee".into(),
            lcm_url: "memq://".into(),
            sets: Vec::new(),
            sim,
            world: None,
        }
    }

    fn shipped() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee")
    }

    /// A copy of the shipped folder, with its `robot.toml` changed and the worlds beside it.
    fn copy(name: &str, change: impl Fn(String) -> String) -> (PathBuf, PathBuf) {
        let folder = std::env::temp_dir().join(format!("advee-preflight-{name}-{}", std::process::id()));
        for part in ["advee", "worlds"] {
            let from = shipped().join("..").join(part);
            std::fs::create_dir_all(folder.join(part)).unwrap();
            for entry in std::fs::read_dir(from).unwrap().flatten() {
                std::fs::copy(entry.path(), folder.join(part).join(entry.file_name())).unwrap();
            }
        }
        let robot = folder.join("advee/robot.toml");
        std::fs::write(&robot, change(std::fs::read_to_string(&robot).unwrap())).unwrap();
        (folder.clone(), folder.join("advee"))
    }

    fn problems(place: &RobotLocation) -> Vec<String> {
        let config = Config::load(&place.config, place.sim, &place.sets).expect("its files are right by themselves");
        check(place, &config, &World::default()).err().map_or_else(Vec::new, |ConfigError(lines)| lines)
    }

    #[test]
    fn the_shipped_robot_and_the_simulated_one_can_be_made() {
        for sim in [false, true] {
            assert_eq!(problems(&place(shipped(), sim)), [""; 0]);
        }
    }

    #[test]
    fn a_robot_with_a_single_drive_is_refused_before_anything_starts() {
        let (folder, config) = copy("drive", |text| {
            let nodes: Vec<usize> = text.match_indices("[[can.main.nodes]]").map(|(at, _)| at).collect();
            let end = nodes[1] + text[nodes[1] + 1..].find("\n[").map_or(text.len() - nodes[1], |at| at + 1);
            text[..nodes[1]].to_owned() + &text[end..]
        });
        let found = problems(&place(config, true));
        let why = "driver_canbus: robot.toml has no [can.<bus>] with both axes: no drive has axis = \"steering\"";
        assert_eq!(found, [why]);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_module_that_is_not_there_is_refused_with_its_line() {
        let (folder, config) = copy("cook", |text| text);
        std::fs::write(
            config.join("modules.toml"),
            "modules = [\n    { name = \"guard\" },\n    { name = \"cook\" },\n]",
        )
        .unwrap();
        let wrong = problems(&place(config, true));
        let expected = "modules.toml:3: modules[1].name = \"cook\": expected watchdog, simulator, ";
        assert!(matches!(&wrong[..], [line] if line.contains(expected)), "{wrong:?}");
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_base_with_an_axis_that_no_drive_turns_is_refused_with_its_line() {
        let (folder, config) = copy("axis", |_| {
            let courier = std::fs::read_to_string(shipped().join("../courier/robot.toml")).unwrap();
            let (at, _) = courier.match_indices("[[can.main.nodes]]").nth(1).unwrap();
            let end = at + courier[at..].find("\n[rs485").unwrap();
            courier[..at].to_owned() + &courier[end..]
        });
        for file in ["sim.toml", "modules.toml", "wheel.eds"] {
            std::fs::copy(shipped().join("../courier").join(file), config.join(file)).unwrap();
        }
        let wrong = problems(&place(config, true));
        let expected = "robot.toml:18: base.kind = \"differential\": expected a drive of each axis: no \
                        [[can.<bus>.nodes]] or [serial.<name>] has \"right\"";
        assert!(matches!(&wrong[..], [line] if line.ends_with(expected)), "{wrong:?}");
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_robot_with_drives_on_two_buses_can_be_made() {
        let (folder, config) = copy("buses", |text| {
            let (at, _) = text.match_indices("[[can.main.nodes]]").nth(1).unwrap();
            let second = text[at..].replacen("can.main", "can.second", 1);
            text[..at].to_owned() + "[can.second]\ninterface = \"udp:239.74.163.3\"\n" + &second
        });
        assert_eq!(problems(&place(config, true)), [""; 0]);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_data_sheet_that_is_missing_is_refused_with_the_line_that_names_it() {
        let folder = std::env::temp_dir().join(format!("advee-preflight-sheet-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        for file in ["robot.toml", "modules.toml"] {
            std::fs::copy(shipped().join("../courier").join(file), folder.join(file)).unwrap();
        }
        let text = std::fs::read_to_string(folder.join("robot.toml")).unwrap();
        let line = text.lines().position(|line| line.starts_with("eds = \"wheel.eds\"")).unwrap() + 1;
        let found = problems(&place(folder.clone(), false));
        let folder_text = folder.display();
        let expected = format!(
            "{folder_text}/robot.toml:{line}: can.main.nodes[0].eds = \"wheel.eds\": expected a data sheet: \
             {folder_text}/wheel.eds: there is no such file"
        );
        assert!(found.contains(&expected), "{expected}\n{found:#?}");
        // A FIFO has no end that would be reached.
        let fifo = folder.join("wheel.eds");
        assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
        let found = problems(&place(folder.clone(), false));
        assert!(found.contains(&expected), "{expected}\n{found:#?}");
        std::fs::remove_dir_all(folder).unwrap();
    }

    /// What is refused of the ports of the shipped folder with these tables more at the end of `robot.toml`, each named
    /// by the text from its key on, with its line.
    fn ports_refused(name: &str, sim: bool, tables: &str, sets: &[&str]) -> Vec<String> {
        let (folder, config) = copy(name, |text| format!("{text}\n{tables}"));
        let sets = sets.iter().map(|set| (*set).to_owned()).collect();
        let place = RobotLocation { sets, ..place(config.clone(), sim) };
        let config = Config::load(&place.config, sim, &place.sets).expect("its files are right by themselves");
        let found = check_live(&place, &config, &World::default()).err();
        std::fs::remove_dir_all(folder).unwrap();
        let lines = found.map_or_else(Vec::new, |ConfigError(lines)| lines);
        let short = |line: String| line.replace(&format!("{}/", place.config.display()), "");
        lines.into_iter().map(short).collect()
    }

    #[test]
    fn every_shipped_robot_and_its_simulator_can_open_their_ports() {
        for folder in ["advee", "advee-lidar", "courier", "porter", "rover", "tripod", "tug"] {
            for sim in [false, true] {
                let place = place(shipped().join("..").join(folder), sim);
                let config = Config::load(&place.config, sim, &[]).unwrap();
                let checked = check_live(&place, &config, &World::default()).map_err(|error| error.to_string());
                assert_eq!(checked, Ok(()), "{folder}");
            }
        }
    }

    const INPUTS_AND_OUTPUTS: &str = "[[io.gpio]]\nname = \"a\"\nchip = \"CHIP\"\nline = 1\n\n[io.modbus.m]\nPORT\n\
         signals = [ { name = \"b\", table = \"coil\", address = 0 } ]\n\n\
         [io.serial.s]\nPORT\nrequests = [ { name = \"r\", request = \"01\", answer_length = 2, signals = [\n\
         { name = \"c\", at = 1, format = \"u8\" } ] } ]\n";

    #[test]
    fn a_simulator_without_its_end_of_a_port_is_refused_with_the_line_of_the_key() {
        let tables = INPUTS_AND_OUTPUTS.replace("CHIP", "/dev/gpiochip0").replace("PORT", "port = \"/dev/ttyLAB9\"");
        let sets = ["stop.second_way=gpio", "stop.gpio.chip=/dev/gpiochip1", "stop.gpio.line=17"];
        let found = ports_refused("sim-ports", true, &tables, &sets);
        let lines = std::fs::read_to_string(shipped().join("robot.toml")).unwrap().lines().count();
        let end = "a name in the run folder, as \"line\", where the simulator has the other end";
        for expected in [
            format!(
                "robot.toml:{}: io.gpio[0].chip = \"/dev/gpiochip0\": expected {end}: sim.toml has the whole list \
                 [[io.gpio]] once more",
                lines + 4
            ),
            format!(
                "robot.toml:{}: io.modbus.m.port = \"/dev/ttyLAB9\": expected {end}; or simulated_at beside it \
                 (sim.toml)",
                lines + 8
            ),
            format!(
                "robot.toml:{}: io.serial.s.port = \"/dev/ttyLAB9\": expected {end}; or simulated_at beside it \
                 (sim.toml)",
                lines + 12
            ),
            format!("--set: stop.gpio.chip = \"/dev/gpiochip1\": expected {end} (sim.toml)"),
        ] {
            assert!(found.contains(&expected), "{expected}\n{found:#?}");
        }
        assert_eq!(found.len(), 4, "{found:#?}");
        let sets = [
            "can.main.interface=slcan:/dev/ttyACM0",
            "rs485.a.port=/dev/ttyS1",
            "i2c.aux.bus=/dev/i2c-1",
            "w1.folder=/sys/bus/w1/devices",
        ];
        let found = ports_refused("sim-devices", true, "", &sets);
        let keys: Vec<&str> = found.iter().filter_map(|line| line.split(' ').nth(1)).collect();
        assert_eq!(keys.len(), 4, "{found:#?}");
        assert!(sets.iter().all(|set| keys.contains(&set.split_once('=').unwrap().0)), "{found:#?}");
        let far = INPUTS_AND_OUTPUTS.replace("CHIP", "a").replace("PORT", "address = \"192.168.0.5:502\"");
        let found = ports_refused("sim-far", true, &far, &[]);
        assert_eq!(found.len(), 2, "{found:#?}");
        let expected = "io.modbus.m.address = \"192.168.0.5:502\": expected an address of this computer, as ";
        assert!(found[0].contains(expected), "{found:#?}");
        let near = INPUTS_AND_OUTPUTS.replace("CHIP", "a").replace("PORT", "port = \"line\"");
        assert_eq!(ports_refused("sim-near", true, &near, &[]), [""; 0]);
    }

    #[test]
    fn a_robot_whose_port_is_the_simulator_s_is_refused_with_the_line_of_the_key() {
        let tables = INPUTS_AND_OUTPUTS.replace("CHIP", "gpiochip0").replace("PORT", "port = \"ttyUSB0\"");
        let sets = ["rs485.a.port=tt8s0", "i2c.aux.bus=unix:i2c-1", "w1.folder=devices"];
        let found = ports_refused("real-ports", false, &tables, &sets);
        let lines = std::fs::read_to_string(shipped().join("robot.toml")).unwrap().lines().count();
        let expected = format!(
            "robot.toml:{}: io.gpio[0].chip = \"gpiochip0\": expected a device file, which begins with /, as \
             \"/dev/gpiochip0\": a name in the run folder is the simulator's",
            lines + 4
        );
        assert!(found.contains(&expected), "{expected}\n{found:#?}");
        let keys: Vec<&str> = found.iter().filter_map(|line| line.split(' ').nth(1)).collect();
        for key in
            ["io.gpio[0].chip", "io.modbus.m.port", "io.serial.s.port", "rs485.a.port", "i2c.aux.bus", "w1.folder"]
        {
            assert!(keys.contains(&key), "{key}: {found:#?}");
        }
        assert_eq!(found.len(), 6, "{found:#?}");
    }

    #[test]
    fn faults_are_those_of_the_configured_boards() {
        let faults = faults(&place(shipped(), true)).unwrap();
        let of = |target: &str| faults.iter().find(|(name, _)| name == target).map(|(_, faults)| faults.as_slice());
        assert!(of("fan1").unwrap().contains(&"stall") && of("robot").unwrap().contains(&"kidnap"), "{faults:?}");
        assert!(of("fan7").is_none());
    }

    #[test]
    fn a_sheet_whose_motor_is_slower_than_the_limits_is_remarked_with_line_and_figures() {
        let shipped = shipped().join("../courier");
        let remarks = |sets: &[&str], config: PathBuf| {
            let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
            let place = RobotLocation { sets: sets.clone(), ..place(config, false) };
            let config = Config::load(&place.config, false, &sets).expect("a configuration");
            assert_eq!(check(&place, &config, &World::default()).map_err(|error| error.to_string()), Ok(()));
            super::remarks(&place, &config)
        };
        assert_eq!(remarks(&[], shipped.clone()), <[String; 0]>::default());
        // 2 m/s of a wheel with a radius of 0.085 m behind a gear of 20; the sheet has 4000.
        let sheet = shipped.join("wheel.eds");
        let expected = |axis| {
            format!(
                "{}:480: 0x6080:0 (greatest motor speed) is 4000 rpm by the sheet, and the limits demand 4494 rpm of \
                 the {axis} drive: one that is set so is refused at its boot-up; motor_rpm_max writes it",
                sheet.display()
            )
        };
        assert_eq!(remarks(&["limits.speed_mps=2"], shipped.clone()), ["left", "right"].map(expected));
        // The simulated drives are made of that sheet.
        let refused = |more: &[String]| {
            let sets = [&["limits.speed_mps=2".to_owned()], more].concat();
            let place = RobotLocation { sets: sets.clone(), ..place(shipped.clone(), true) };
            let config = Config::load(&place.config, true, &sets).expect("a configuration");
            check(&place, &config, &World::default()).err().map_or_else(Vec::new, |ConfigError(lines)| lines)
        };
        let set_so = |axis| expected(axis) + "; the simulated drive is so";
        assert_eq!(refused(&[]), ["left", "right"].map(set_so));
        let written = ["0.gear=20", "0.motor_rpm_max=5000", "1.gear=-20", "1.motor_rpm_max=5000"];
        let written = written.map(|key| format!("can.main.nodes.{key}"));
        assert_eq!(refused(&written), [""; 0]);
    }

    #[test]
    fn a_robot_with_drives_and_without_their_driver_is_remarked() {
        let without = |sets: &[&str]| {
            let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
            let place = RobotLocation { sets: sets.clone(), ..place(shipped(), false) };
            let mut config = Config::load(&place.config, false, &sets).unwrap();
            config.leave_out(canbus::NAME);
            (remarks(&place, &config), place.config.join("modules.toml"))
        };
        let (found, file) = without(&[]);
        let expected = format!("{}: no module driver_canbus, which moves the drives of robot.toml", file.display());
        assert_eq!(found, [expected]);
        assert_eq!(without(&["can.main.nodes=[]"]).0, [""; 0]);
    }
}
