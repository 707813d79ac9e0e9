//! Recording of a module's inputs: from a module to the header of its file, and from a file back to the module.
//!
//! A file of inputs contains the configuration of the module as texts, so that it can be replayed on another machine
//! and after the configuration has changed: `robot.toml`, `modules.toml`, each `--set`, and for the simulated robot
//! `sim.toml` and its world, whose beacons are the robot's map, and the walls of the world's map; the tables of the
//! folder `drives`; of those that know the drives, the data sheets by which these are driven. Other data sheets are
//! left out: they are checked when a module is created and do not affect its behavior.

use crate::config::{self, Config, ConfigError, SIMULATOR};
use crate::place::RobotLocation;
use crate::scene;
use crate::sheets;
use crate::topology::{self, HostOptions};
use base::Duration;
use canopen::eds::Eds;
use drivers::canbus;
use host::recorder::Inputs;
use host::runs::{MODULES, OVERRIDES, ROBOT, SET, SIM, WALLS, WORLD};
use logger::Attachment;
use module::{Shell, State};
use record::Header;
use settings::Node;
use simulator::world::World;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use web::center::Scene;

/// Environment variable with the folder of the run.
pub const VARIABLE: &str = "ADVEE_LOG";
/// Values chosen by the host: [`HostOptions`].
const WIRE_TIME: &str = "wire_time";
const SEED: &str = "seed";
const DELAY_MAX: &str = "restart_delay_max_ns";
const LOGS: &str = "logs";
const GUARDED: &str = "guarded";
/// Data sheet of a drive, before the name of its file.
const SHEET: &str = "sheet:";

/// Inputs to be recorded by a module's host, if the configuration and the run require it.
pub fn inputs(
    place: &RobotLocation,
    config: &Config,
    name: &str,
    wanted: State,
) -> Result<Option<Inputs>, ConfigError> {
    // Requests to the web server and of ROS cannot be replayed, and the inputs of the logger are what it writes.
    let wanted_here = config.robot.log.inputs && ![web::NAME, ros2::NAME, bridge::NAME, logger::NAME].contains(&name);
    let Some(run) = std::env::var_os(VARIABLE).filter(|_| wanted_here) else {
        return Ok(None);
    };
    let header = header(place, name, wanted, HostOptions::live())?;
    Ok(Some(Inputs { run: run.into(), header, limit: config.robot.log.inputs_max_bytes }))
}

/// Header of a module's file.
pub fn header(place: &RobotLocation, name: &str, wanted: State, options: HostOptions) -> Result<Header, ConfigError> {
    let mut texts = Vec::new();
    let mut add = |name: &str, path: PathBuf| match fs::read_to_string(&path) {
        Ok(text) => {
            texts.push((name.to_string(), text));
            Ok(())
        }
        Err(error) => Err(ConfigError(vec![format!("{}: {error}", path.display())])),
    };
    add(ROBOT, place.config.join(ROBOT))?;
    add(MODULES, place.config.join(MODULES))?;
    let tables = config::drives::texts(&place.config)?;
    if place.sim {
        add(SIM, place.config.join(SIM))?;
        let source = config::WorldSource::read(&place.config, place.world.as_deref(), &place.sets)?;
        texts.push((WORLD.into(), source.text));
        texts.extend(source.walls.map(|walls| (WALLS.into(), walls)));
    }
    texts.extend(tables);
    if [canbus::NAME, SIMULATOR, web::NAME].contains(&name) {
        let buses = Config::load(&place.config, place.sim, &place.sets)?.robot.can;
        for (path, text) in buses.iter().map(|bus| sheets::texts(place, bus)).collect::<Result<Vec<_>, _>>()?.concat() {
            texts.push((format!("{SHEET}{}", path.display()), text));
        }
    }
    texts.extend(place.sets.iter().map(|set| (SET.to_string(), set.clone())));
    let delay_max = options.restart_delay_max.map(|delay| u64::try_from(delay.as_nanos()).unwrap_or(u64::MAX));
    texts.extend(options.wire_time.then(|| (WIRE_TIME.into(), String::new())));
    texts.extend(options.logs.then(|| (LOGS.into(), String::new())));
    texts.extend(options.guarded.then(|| (GUARDED.into(), String::new())));
    texts.extend(options.seed.map(|seed| (SEED.into(), seed.to_string())));
    texts.extend(delay_max.map(|delay| (DELAY_MAX.into(), delay.to_string())));
    Ok(Header { program: program(), module: name.into(), wanted, texts })
}

/// Attachments of a log: the configuration as read, its overrides, and the version. For a module created from a
/// recording, the recorded configuration.
#[must_use]
pub fn attachments(place: &RobotLocation, options: HostOptions) -> Vec<Attachment> {
    let header = header(place, logger::NAME, State::Run, options);
    let texts = header.map(|header| header.texts).unwrap_or_default();
    let overrides: String = texts.iter().filter(|(name, _)| name == SET).map(|(_, set)| format!("{set}\n")).collect();
    let files = texts.into_iter().filter(|(name, _)| name.ends_with(".toml"));
    let others = [(OVERRIDES.to_owned(), overrides), ("version.txt".to_owned(), program() + "\n")];
    let attachment = |(name, text): (String, String)| Attachment {
        media_type: if name.ends_with(".toml") { "application/toml" } else { "text/plain" }.into(),
        data: text.into_bytes(),
        name,
    };
    files.chain(others).map(attachment).collect()
}

/// Program and version, as in a header.
#[must_use]
pub fn program() -> String {
    format!("advee {}", env!("CARGO_PKG_VERSION"))
}

/// Creates the module of a header again; `sets` are further overrides, after the recorded ones.
pub fn rebuild(header: &Header, sets: &[String]) -> Result<Shell, ConfigError> {
    let sim = header.text(SIM).is_some();
    let sets = [&header.texts(SET), sets].concat();
    let mut config = config(header, &sets)?;
    for node in config.robot.can.iter_mut().flat_map(|can| &mut can.driver.nodes) {
        let path = node.eds.take();
        let text = path.and_then(|path| header.text(&format!("{SHEET}{}", path.display())));
        node.sheet = text.and_then(|text| Eds::parse(text.as_bytes()).ok()).map(Arc::new);
    }
    let nowhere = RobotLocation {
        config: PathBuf::new(),
        run_dir: PathBuf::new(),
        lcm_url: String::new(),
        sets: sets.clone(),
        sim,
        world: None,
    };
    let world = || parsed_world(header, &sets);
    topology::shell_in(&nowhere, &config, &header.module, header.wanted, options(header)?, world)
}

/// Configuration of a header with these overrides.
pub fn config(header: &Header, sets: &[String]) -> Result<Config, ConfigError> {
    let over = if header.text(SIM).is_some() { Some(node(header, SIM)?) } else { None };
    let tables = config::drives::recorded(&header.texts)?;
    Config::merge_with(node(header, ROBOT)?, over, node(header, MODULES)?, &tables, sets)
}

fn node(header: &Header, name: &str) -> Result<Node, ConfigError> {
    let text = header.text(name).ok_or_else(|| ConfigError(vec![format!("{name}: not in the file")]))?;
    Node::parse(Path::new(name), text).map_err(ConfigError)
}

/// World of a header; `None` without a simulation.
pub fn world(header: &Header) -> Result<Option<World>, ConfigError> {
    let sets: Vec<String> = header.texts(SET);
    header.text(WORLD).map(|_| parsed_world(header, &sets)).transpose()
}

/// Robot and world of a header, with its overrides.
///
/// # Errors
/// The configuration in the header is refused.
pub fn described(header: &Header) -> Result<(config::Robot, World), ConfigError> {
    Ok((config(header, &header.texts(SET))?.robot, world(header)?.unwrap_or_default()))
}

/// Scene of a recorded robot, if its log contains the necessary files.
#[must_use]
pub fn scene(header: &Header) -> Option<Scene> {
    let config = config(header, &header.texts(SET)).ok()?;
    let world = world(header).ok()?;
    Some(scene::of(&topology::mapped(&config.robot, world.as_ref()), world.as_ref(), None))
}

fn parsed_world(header: &Header, sets: &[String]) -> Result<World, ConfigError> {
    let walls = header.text(WALLS).map(|_| node(header, WALLS)).transpose()?;
    config::recorded_world(node(header, WORLD)?, Path::new(WORLD), sets, walls)
}

fn options(header: &Header) -> Result<HostOptions, ConfigError> {
    let number = |name: &str| {
        let read = |text: &str| {
            text.parse().map_err(|_| ConfigError(vec![format!("{name} = {text:?}: expected a number of nanoseconds")]))
        };
        header.text(name).map(read).transpose()
    };
    Ok(HostOptions {
        wire_time: header.text(WIRE_TIME).is_some(),
        logs: header.text(LOGS).is_some(),
        guarded: header.text(GUARDED).is_some(),
        seed: number(SEED)?,
        restart_delay_max: number(DELAY_MAX)?.map(Duration::from_nanos),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::ModuleEntry;

    #[test]
    fn every_module_is_rebuilt_from_its_header() {
        let place = RobotLocation {
            config: Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee"),
            run_dir: "/run/advee".into(),
            lcm_url: String::new(),
            sets: vec!["limits.command_ttl_s=0.5".into()],
            sim: true,
            world: Some("empty".into()),
        };
        let config = Config::load(&place.config, true, &place.sets).unwrap();
        let listed = config.modules.iter().map(ModuleEntry::name);
        for name in listed.chain([watchdog::NAME]) {
            let header = header(&place, name, State::Pause, HostOptions::LIVE).unwrap();
            assert_eq!(rebuild(&header, &[]).unwrap().name(), name);
            let refused = rebuild(&header, &["limits.command_ttl_s=9".into()]).err().unwrap().to_string();
            assert!(refused.starts_with("--set: limits.command_ttl_s = 9: expected"), "{refused}");
        }
    }

    #[test]
    fn a_drive_by_its_sheet_is_rebuilt_without_the_file() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let folder = std::env::temp_dir().join(format!("advee-recording-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let robot = fs::read_to_string(root.join("conf/advee").join(ROBOT)).unwrap();
        let by_sheet = robot.replace("driver = \"epos\"", "driver = \"cia402\"\neds = \"wheel.dcf\"");
        assert_ne!(by_sheet, robot);
        fs::write(folder.join(ROBOT), by_sheet).unwrap();
        fs::copy(root.join("conf/advee").join(MODULES), folder.join(MODULES)).unwrap();
        let sheet = root.join("buses/canopen/eds/others/maxon_epos4_50_15_node1.dcf");
        fs::copy(sheet, folder.join("wheel.dcf")).unwrap();
        let place = RobotLocation {
            config: folder.clone(),
            run_dir: "/run/advee".into(),
            lcm_url: String::new(),
            sets: Vec::new(),
            sim: false,
            world: None,
        };
        fs::copy(root.join("conf/advee").join(SIM), folder.join(SIM)).unwrap();
        let simulated = RobotLocation { sim: true, world: Some(root.join("conf/worlds/empty.toml")), ..place.clone() };
        let names = [(canbus::NAME, &place), (canbus::NAME, &simulated), (SIMULATOR, &simulated)];
        let headers = names.map(|(name, place)| header(place, name, State::Run, HostOptions::LIVE).unwrap());
        fs::remove_dir_all(&folder).unwrap();
        for ((name, _), header) in names.iter().zip(headers) {
            assert_eq!(rebuild(&header, &[]).unwrap().name(), *name);
        }
    }

    #[test]
    fn drives_by_tables_of_the_folder_are_rebuilt_without_their_files() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let folder = std::env::temp_dir().join(format!("advee-recording-tables-{}", std::process::id()));
        fs::create_dir_all(folder.join("drives")).unwrap();
        for file in [MODULES, SIM] {
            fs::copy(root.join("conf/advee").join(file), folder.join(file)).unwrap();
        }
        let robot = fs::read_to_string(root.join("conf/advee").join(ROBOT)).unwrap();
        let own = robot.replace("driver = \"epos\"", "driver = \"wheel\"");
        let own = own.replace("driver = \"icla\"", "driver = \"turn\"");
        fs::write(folder.join(ROBOT), own).unwrap();
        let sheets = [("others/maxon_epos4_50_15_node1.dcf", "wheel.dcf"), ("icla_sim.eds", "turn.eds")];
        for (sheet, name) in sheets {
            fs::copy(root.join("buses/canopen/eds").join(sheet), folder.join("drives").join(name)).unwrap();
        }
        let icla = fs::read_to_string(root.join("modules/drivers/src/canbus/drives/icla.toml")).unwrap();
        let turn = icla.replace("simulated = \"icla\"", "eds = \"turn.eds\"");
        fs::write(folder.join("drives/wheel.toml"), "form = \"sheet\"\neds = \"wheel.dcf\"\n").unwrap();
        fs::write(folder.join("drives/turn.toml"), turn).unwrap();
        let place = RobotLocation {
            config: folder.clone(),
            run_dir: "/run/advee".into(),
            lcm_url: String::new(),
            sets: Vec::new(),
            sim: true,
            world: Some(root.join("conf/worlds/empty.toml")),
        };
        let names = [canbus::NAME, SIMULATOR, watchdog::NAME];
        let headers = names.map(|name| header(&place, name, State::Run, HostOptions::LIVE).unwrap());
        let logged = attachments(&place, HostOptions::LIVE);
        fs::remove_dir_all(&folder).unwrap();
        for (name, header) in names.iter().zip(headers) {
            assert_eq!(rebuild(&header, &[]).unwrap().name(), *name);
        }
        assert!(logged.iter().any(|file| file.name == "drives/turn.toml"));
    }
}
