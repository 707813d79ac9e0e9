//! The configuration folder: strict, and wrong as a whole if anything in it is wrong.
//!
//! `robot.toml` says what the robot is made of; in simulation `sim.toml` is laid over it, then every `--set`.
//! `modules.toml` lists the modules (`--set modules.NAME.key=value`), a world where the simulated robot is (`--set
//! world.key=value`). What is found wrong is a list of lines `file:line: key = value: expected …`. Keys that have a new
//! name are read under the old one, too.

pub mod drives;
mod modules;
mod robot;
mod scenario;
#[cfg(test)]
mod tests;
mod world;

pub use modules::{HardwareWatchdog, ModuleEntry, Modules, SIMULATOR};
pub use robot::{
    CanBus, Gamepad, General, Host, I2cBus, Imu, Io, IoLine, Lidar, Log, ModbusBus, Robot, Rs485Bus, Sensors,
    SerialLine, Srf08, W1, gpio_bus, lidar_port,
};
pub use scenario::{built_in_scenario, regressions, scenario};
pub use world::{
    Source as WorldSource, is_of_world, parsed as parsed_world, place as world_place, recorded as recorded_world,
    without_files as world_without_files, world,
};

pub use settings::ConfigError;

use base::Level;
use drivers::canbus::tables::DriveTables;
use settings::{Moved, Moves, Node, Problems, Rows, Section, Table, read};
use std::path::Path;

/// The files of a folder.
pub const FILES: [&str; 3] = ["robot.toml", "sim.toml", "modules.toml"];

/// The whole folder.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// `robot.toml` and what was laid over it.
    pub robot: Robot,
    /// `modules.toml`; the simulator only in simulation.
    pub modules: Vec<ModuleEntry>,
    /// What guards all of it, as `modules.toml` has it.
    pub hardware_watchdog: Option<HardwareWatchdog>,
}

impl Config {
    /// Reads the folder `dir`; with `sim` the simulated robot; `sets` are overrides `table.key=value`.
    ///
    /// # Errors
    /// A line for each thing that is wrong.
    pub fn load(dir: &Path, sim: bool, sets: &[String]) -> Result<Self, ConfigError> {
        Self::load_with_notices(dir, sim, sets).map(|(config, _)| config)
    }

    /// The same, and a line for each key that was found under its old name.
    ///
    /// # Errors
    /// A line for each thing that is wrong.
    pub fn load_with_notices(dir: &Path, sim: bool, sets: &[String]) -> Result<(Self, Vec<String>), ConfigError> {
        let mut problems = Vec::new();
        let mut take = |name: &str| match read(&dir.join(name)) {
            Ok(node) => Some(node),
            Err(ConfigError(lines)) => {
                problems.extend(lines);
                None
            }
        };
        let robot = take("robot.toml");
        let over = if sim { take("sim.toml").map(Some) } else { Some(None) };
        let modules = take("modules.toml");
        let tables = drives::read(dir).map_err(|ConfigError(lines)| problems.extend(lines)).ok();
        let (Some(robot), Some(over), Some(modules), Some(tables)) = (robot, over, modules, tables) else {
            return Err(ConfigError(problems));
        };
        let mut found = Vec::new();
        let config = Self::merged(robot, over, modules, &tables, sets, &mut found)?;
        Ok((config, [settings::notices(&found), tables.remarks()].concat()))
    }

    /// The same of files that were read: `robot.toml`, `sim.toml` for the simulated robot, `modules.toml`.
    ///
    /// # Errors
    /// A line for each thing that is wrong.
    pub fn merge<S: AsRef<str>>(
        robot: Node,
        over: Option<Node>,
        modules: Node,
        sets: &[S],
    ) -> Result<Self, ConfigError> {
        Self::merge_with(robot, over, modules, &DriveTables::default(), sets)
    }

    /// The same with these tables of drives.
    ///
    /// # Errors
    /// A line for each thing that is wrong.
    pub fn merge_with<S: AsRef<str>>(
        robot: Node,
        over: Option<Node>,
        modules: Node,
        tables: &DriveTables,
        sets: &[S],
    ) -> Result<Self, ConfigError> {
        Self::merged(robot, over, modules, tables, sets, &mut Vec::new())
    }

    fn merged<S: AsRef<str>>(
        mut robot: Node,
        over: Option<Node>,
        mut modules: Node,
        tables: &DriveTables,
        sets: &[S],
        found: &mut Vec<Moved>,
    ) -> Result<Self, ConfigError> {
        let (of_robot, of_modules) = (moves::<Robot>(), moves::<Modules>());
        let sim = over.is_some();
        of_robot.rename(&mut robot, found)?;
        if let Some(mut over) = over {
            of_robot.rename(&mut over, found)?;
            robot.merge(over);
        }
        of_modules.rename(&mut modules, found)?;
        // `world.key` is of the world, which is read elsewhere.
        for set in sets.iter().map(AsRef::as_ref).filter(|set| !world::is_of_world(set)) {
            match set.trim_start().starts_with("modules.") {
                true => of_modules.set(&mut modules, set, found)?,
                false => of_robot.set(&mut robot, set, found)?,
            }
        }
        Self::check(robot, &modules, tables, sim)
    }

    /// `robot.toml` as [`Config::load`] reads it, with what is laid over it, and where each value is from.
    ///
    /// # Errors
    /// A line for each thing that is wrong.
    pub(crate) fn tree(dir: &Path, sim: bool, sets: &[String]) -> Result<Node, ConfigError> {
        let of_robot = moves::<Robot>();
        let found = &mut Vec::new();
        let mut robot = read(&dir.join("robot.toml"))?;
        of_robot.rename(&mut robot, found)?;
        if sim {
            let mut over = read(&dir.join("sim.toml"))?;
            of_robot.rename(&mut over, found)?;
            robot.merge(over);
        }
        for set in sets.iter().filter(|set| !world::is_of_world(set) && !set.trim_start().starts_with("modules.")) {
            of_robot.set(&mut robot, set, found)?;
        }
        Ok(robot)
    }

    /// Configured lowest levels of a module's texts and reports that are printed, and that are published.
    #[must_use]
    pub fn levels(&self, name: &str) -> (Option<Level>, Option<Level>) {
        let entry = self.modules.iter().find(|module| module.name() == name);
        let (print, send) = entry.map_or((None, None), |entry| (entry.print_from, entry.send_from));
        (print.or(self.robot.general.print_from), send.or(self.robot.general.send_from))
    }

    /// Takes a module off the list; no other waits for it then.
    pub fn leave_out(&mut self, name: &str) {
        modules::leave_out(&mut self.modules, name);
    }

    /// Names of the modules without which the robot does not move.
    pub fn critical(&self) -> impl Iterator<Item = String> {
        self.modules.iter().filter(|module| module.guard.critical).map(|module| module.name().into())
    }

    /// Checks both files, parsed; with `sim` for the simulated robot.
    fn check(mut root: Node, modules: &Node, tables: &DriveTables, sim: bool) -> Result<Self, ConfigError> {
        let problems = Problems::default();
        tables.expand(&mut root, &problems);
        let mut robot = Table::root(&root, &problems).map(Table::whole::<Robot>);
        for bus in robot.iter_mut().flat_map(|robot| &mut robot.can) {
            let name = &bus.name;
            bus.driver.nodes.iter_mut().enumerate().for_each(|(n, node)| tables.bind(&root, name, n, &mut node.drive));
        }
        let modules = Table::root(modules, &problems).map(Table::whole::<Modules>);
        match (robot, modules, problems.lines()) {
            (Some(robot), Some(mut modules), lines) if lines.is_empty() => {
                if !sim {
                    modules.leave_out(SIMULATOR);
                }
                if !robot.web.enabled {
                    modules.leave_out(web::NAME);
                }
                if robot.guard.ranging != guard::Ranging::None {
                    modules.add_guard();
                }
                match &robot.io {
                    Some(_) => modules.add(drivers::io::NAME),
                    None => modules.leave_out(drivers::io::NAME),
                }
                match robot.ros2.enabled {
                    true => modules.add(ros2::NAME),
                    false => modules.leave_out(ros2::NAME),
                }
                if robot.lidar.is_empty() {
                    modules.leave_out(drivers::lidar::NAME);
                } else {
                    modules.add(drivers::lidar::NAME);
                }
                if robot.imu.is_empty() {
                    modules.leave_out(drivers::imu::NAME);
                } else {
                    modules.add(drivers::imu::NAME);
                }
                match robot.bridge.is_empty() {
                    true => modules.leave_out(bridge::NAME),
                    false => modules.add_bridge(robot.bridge.iter().any(|link| link.critical)),
                }
                let Modules { hardware_watchdog, hardware_watchdog_timeout_s: timeout_s, modules } = modules;
                let hardware_watchdog = hardware_watchdog.map(|path| HardwareWatchdog { path, timeout_s });
                Ok(Self { robot, modules, hardware_watchdog })
            }
            (_, _, lines) => Err(ConfigError(lines)),
        }
    }
}

fn moves<T: Section>() -> Moves {
    Moves::of(&Rows::of::<T>())
}

/// The text of a file of the folder with the new names of its keys.
///
/// # Errors
/// It is no TOML, or has a key under both names.
pub fn migrated(path: &Path, text: &str) -> Result<String, ConfigError> {
    let of_modules = path.file_name().is_some_and(|name| name == "modules.toml");
    let moves = if of_modules { moves::<Modules>() } else { moves::<Robot>() };
    moves.migrate(path, text)
}

/// The table `estimator` of a file that may have others, too: for the filter without its robot. `sets` are overrides
/// `estimator.key=value`.
///
/// # Errors
/// A line for each thing that is wrong.
pub fn estimator_of(path: &Path, sets: &[String]) -> Result<Option<::estimator::filter::Config>, ConfigError> {
    let mut node = read(path)?;
    let of_robot = moves::<Robot>();
    for set in sets {
        if !set.trim_start().starts_with("estimator.") {
            return Err(ConfigError(vec![format!("--set {set}: expected estimator.key=value")]));
        }
        of_robot.set(&mut node, set, &mut Vec::new())?;
    }
    let problems = Problems::default();
    let config = Table::root(&node, &problems).and_then(|mut root| root.optional("estimator", &()));
    let lines = problems.lines();
    if lines.is_empty() { Ok(config) } else { Err(ConfigError(lines)) }
}
