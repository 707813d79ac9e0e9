//! What can be known of a robot before anything of it starts: whether each module accepts its part of the
//! configuration, and what can be broken in the simulated one.

use crate::config::{Config, ConfigError};
use crate::place::RobotLocation;
use crate::simulated;
use crate::topology::{self, HostOptions, shell_in};
use module::State;
use simulator::Simulator;
use simulator::world::World;

/// Makes every module of a configuration, as its process would, and drops it: a module that refuses its part of the
/// configuration would otherwise end at each start. Modules of other executables are not looked at. `world`: that of
/// the simulated robot.
///
/// # Errors
/// A line for each thing that a module refuses.
pub fn check(place: &RobotLocation, config: &Config, world: &World) -> Result<(), ConfigError> {
    let options = HostOptions { guarded: true, ..HostOptions::LIVE };
    let own = config.modules.iter().filter(|module| module.command.is_none());
    let refused = own
        .filter_map(|module| shell_in(place, config, module.name(), State::Run, options, || Ok(world.clone())).err());
    let mut lines: Vec<String> = refused.flat_map(|ConfigError(lines)| lines).collect();
    lines.dedup();
    if lines.is_empty() { Ok(()) } else { Err(ConfigError(lines)) }
}

/// What is allowed, and may not be meant, in the data sheets of the drives; with file and line. Of a configuration that
/// [`check`] refuses: nothing.
#[must_use]
pub fn remarks(place: &RobotLocation, config: &Config) -> Vec<String> {
    topology::remarks_on_sheets(place, config)
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
        assert_eq!(remarks(&["limits.speed_mps=2"], shipped), ["left", "right"].map(expected));
    }
}
