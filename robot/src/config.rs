//! The configuration folder: strict, and wrong as a whole if anything in it is wrong.
//!
//! `robot.toml` says what the robot is made of; in simulation `sim.toml` is laid over it, then every `--set`.
//! `modules.toml` lists the modules (`--set modules.NAME.key=value`), a world where the simulated robot is (`--set
//! world.key=value`). What is found wrong is a list of lines `file:line: key = value: expected …`.

mod auxiliary;
mod estimator;
mod joystick;
mod log;
mod modules;
mod planner;
mod robot;
mod scenario;
mod sensors;
#[cfg(test)]
mod tests;
mod world;

pub use auxiliary::{I2cBus, I2cChip, I2cFan, I2cPlace, I2cTemperature, W1, W1Sensor};
pub use joystick::{Joystick, JoystickDevice, JoystickGear, JoystickStick};
pub use log::Log;
pub use modules::{HardwareWatchdog, ModuleEntry, SIMULATOR};
pub use planner::Planner;
pub use robot::{
    Axis, Beacon, CanBus, CanDriver, CanInterface, CanNode, Crc, Geometry, Limits, Power, Ranger, Robot, Rs485Bus,
    Rs485Driver, Rs485Node,
};
pub use scenario::{Regression, regressions, scenario};
pub use sensors::{Sensors, Srf08};
pub use world::{parsed as parsed_world, place as world_place, world};

pub use settings::ConfigError;

use settings::{Node, Problems, Table, read};
use std::path::Path;

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
    pub fn load(dir: &Path, sim: bool, sets: &[String]) -> Result<Self, ConfigError> {
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
        let (Some(robot), Some(over), Some(modules)) = (robot, over, modules) else {
            return Err(ConfigError(problems));
        };
        Self::merge(robot, over, modules, sets)
    }

    /// The same of files that were read: `robot.toml`, `sim.toml` for the simulated robot, `modules.toml`.
    pub fn merge(mut robot: Node, over: Option<Node>, mut modules: Node, sets: &[String]) -> Result<Self, ConfigError> {
        let sim = over.is_some();
        if let Some(over) = over {
            robot.merge(over);
        }
        override_by(sets, &mut robot, &mut modules).map_err(|line| ConfigError(vec![line]))?;
        Self::check(&robot, &modules, sim)
    }

    /// Checks both files, parsed; with `sim` for the simulated robot.
    pub fn check(robot: &Node, modules: &Node, sim: bool) -> Result<Self, ConfigError> {
        let problems = Problems::default();
        let robot = Table::new(robot, "", &problems).and_then(Robot::read);
        let modules = Table::new(modules, "", &problems).map(|root| modules::read(root, sim));
        match (robot, modules, problems.lines()) {
            (Some(robot), Some((modules, hardware_watchdog)), lines) if lines.is_empty() => {
                let mut config = Self { robot, modules, hardware_watchdog };
                if !config.robot.web.enabled {
                    config.leave_out(web::NAME);
                }
                Ok(config)
            }
            (_, _, lines) => Err(ConfigError(lines)),
        }
    }

    /// Takes a module off the list; nobody waits for it then.
    fn leave_out(&mut self, name: &str) {
        self.modules.retain(|module| module.name != name);
        self.modules.iter_mut().for_each(|module| module.depends.retain(|other| other != name));
    }
}

/// Applies every `--set`: `modules.NAME.key` goes to `modules.toml`, `world.key` to the world, which is read elsewhere,
/// everything else to `robot.toml`.
fn override_by<S: AsRef<str>>(sets: &[S], robot: &mut Node, modules: &mut Node) -> Result<(), String> {
    let sets = sets.iter().map(AsRef::as_ref).filter(|set| !world::is_of_world(set));
    sets.into_iter().try_for_each(|set| match set.trim_start().starts_with("modules.") {
        true => modules.set(set),
        false => robot.set(set),
    })
}

/// The table `estimator` of a file that may have others, too: for the filter without its robot.
pub fn estimator_of(path: &Path) -> Result<Option<::estimator::filter::Config>, ConfigError> {
    let node = read(path)?;
    let problems = Problems::default();
    let table = Table::new(&node, "", &problems).and_then(|mut root| root.table_if_any("estimator"));
    let config = table.map(estimator::read);
    let lines = problems.lines();
    if lines.is_empty() { Ok(config) } else { Err(ConfigError(lines)) }
}
