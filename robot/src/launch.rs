//! How the watchdog's host starts the processes of modules.

use crate::config::{Config, ConfigError};
use crate::place::RobotLocation;
use crate::topology;
use drivers::{canbus, power};
use host::keepers;
use host::processes::{Launch, LinesFrom, Start};
use host::sys;
use module::State;
use module::admission::Commands;
use std::process::Command;

/// How the watchdog's host starts a module: our own executable with our own arguments, unless the list says otherwise.
pub(crate) fn launcher(
    place: &RobotLocation,
    config: &Config,
    mut notices: Vec<String>,
) -> Result<Launch, ConfigError> {
    notices.extend(warning(&place.lcm_url, config.robot.bus.commands));
    notices.extend(anybody_releases(config));
    let own = std::env::current_exe().map_err(|error| ConfigError(vec![format!("own executable: {error}")]))?;
    let (place, modules, config) = (place.clone(), config.modules.clone(), config.clone());
    let run_dir = Some(place.run_dir.clone());
    let divides = modules.iter().any(|module| module.limits.memory_max.is_some() || module.limits.cpu_max.is_some());
    let rt_priority = modules.iter().filter_map(|module| module.limits.rt_priority).max().map(|highest| highest + 1);
    let keepers = keepers(&config)?;
    let start = move |name: &str, state: State| {
        let keeper = keepers.iter().find(|keeper| keeper.module == name).cloned();
        let entry = modules.iter().find(|module| module.name() == name);
        let args = entry.map(|entry| entry.args.as_slice()).unwrap_or_default();
        let mut command = match entry.and_then(|entry| entry.command.as_ref()) {
            Some(command) => {
                // docs/writing-a-module.md
                let mut command = Command::new(command);
                command.env("ADVEE_MODULE", name).env("ADVEE_STATE", state.name());
                command.env("LCM_DEFAULT_URL", foreign_url(&place.lcm_url));
                command
            }
            None => {
                let mut command = Command::new(&own);
                let place = if keeper.is_some() { shared(&place) } else { place.clone() };
                command.args(["run", name, "--state", state.name()]).args(place.arguments());
                command
            }
        };
        command.args(args);
        let foreign = entry.is_some_and(|entry| entry.command.is_some());
        let ((print, send), usual) = (config.levels(name), LinesFrom::default());
        let lines_from = LinesFrom { print: print.unwrap_or(usual.print), send: send.unwrap_or(usual.send) };
        let limits = entry.map(|entry| entry.limits.clone()).unwrap_or_default();
        // Only the master of the CAN bus restarts an interface.
        let capabilities: &[u8] = if name == canbus::NAME && !foreign { &[sys::CAP_NET_ADMIN] } else { &[] };
        Start { command, limits, capabilities, foreign, lines_from, keeper }
    };
    Ok(Launch { start: Box::new(start), run_dir, divides, rt_priority, notices })
}

/// The keepers of modules that run as other users. A program in another language has none. A module whose messages are
/// accepted from its process alone has none either, because it is accepted only as a process of the watchdog's user.
fn keepers(config: &Config) -> Result<Vec<keepers::Place>, ConfigError> {
    let keepers = keepers::Place::all().map_err(|why| ConfigError(vec![why]))?;
    let policy = topology::policy(config);
    for keepers::Place { module, .. } in &keepers {
        let foreign = config.modules.iter().any(|entry| entry.name() == module && entry.command.is_some());
        let is_due = [power::NAME, watchdog::NAME].contains(&module.as_str()) || policy.is_witness(module);
        if foreign || is_due {
            let why = "this module has to run as the robot's user";
            return Err(ConfigError(vec![format!("{}: {module}: {why}", keepers::VARIABLE)]));
        }
    }
    Ok(keepers)
}

/// The robot's location for a module of another user: its shared memory is this user's.
fn shared(place: &RobotLocation) -> RobotLocation {
    let lcm_url = match lcm::Url::parse(&place.lcm_url) {
        Ok((lcm::Url::Udpm(udpm), _)) if udpm.shm == lcm::url::Shm::Auto => {
            let shm = lcm::url::Shm::Of(keepers::own_user());
            lcm::Url::from(lcm::url::Udpm { shm, ..udpm }).to_string()
        }
        _ => place.lcm_url.clone(),
    };
    RobotLocation { lcm_url, ..place.clone() }
}

/// Warning at each start if the bus does not end at this computer, or if other computers may command through it.
pub(crate) fn warning(lcm_url: &str, commands: Commands) -> Option<String> {
    let open = match lcm::Url::parse(lcm_url) {
        Ok((lcm::Url::Udpm(udpm), _)) => udpm.ttl > 0,
        Ok((lcm::Url::Tcpq(hub), _)) => !hub.ip().is_loopback(),
        _ => false,
    };
    match (open, commands) {
        (true, Commands::Network) => Some(format!(
            "ANY COMPUTER OF THE NETWORK COMMANDS THIS ROBOT: the bus {lcm_url} leaves this computer, and [bus] \
             commands is \"network\""
        )),
        (true, _) => Some(format!(
            "THE BUS LEAVES THIS COMPUTER: {lcm_url}; others of the network read it; they may not command ([bus] \
             commands), and measurements are believed from them where no module of the robot is due to publish them \
             (odometry, bearings of beacons)"
        )),
        (false, Commands::Network) => Some(format!(
            "[bus] commands is \"network\", but the bus {lcm_url} ends at this computer; with another bus ANY COMPUTER \
             OF THE NETWORK COMMANDS THIS ROBOT"
        )),
        (false, Commands::Memory | Commands::Host) => None,
    }
}

/// Warning at each start if the power controller is not a process that the modules can identify.
fn anybody_releases(config: &Config) -> Option<String> {
    let unknown = config.robot.power.is_some() && topology::policy(config).power.is_none();
    unknown.then(|| {
        format!(
            "{} is not this program's: whoever may command ([bus] commands) is believed that nothing engages PAUSE",
            power::NAME
        )
    })
}

/// The bus as programs on the official library are told of it, which warns of options that are ours alone.
fn foreign_url(url: &str) -> String {
    match lcm::Url::parse(url) {
        Ok((lcm::Url::Udpm(udpm), _)) => lcm::Url::from(lcm::url::Udpm { shm: lcm::url::Shm::Off, ..udpm }).to_string(),
        _ => url.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bus_that_leaves_this_computer_is_said_in_large_letters() {
        let (local, open) = ("udpm://239.255.76.67:7667?ttl=0", "udpm://239.255.76.67:7667?ttl=1");
        let large =
            |url, commands| warning(url, commands).unwrap_or_default().contains("THE NETWORK COMMANDS THIS ROBOT");
        for commands in [Commands::Memory, Commands::Host] {
            assert_eq!(warning(local, commands), None);
            assert!(warning(open, commands).unwrap().starts_with("THE BUS LEAVES THIS COMPUTER"));
        }
        assert!(large(open, Commands::Network) && large(local, Commands::Network));
        assert_eq!(warning("tcpq://127.0.0.1:7700", Commands::Host), None);
        assert!(large("tcpq://10.0.0.2:7700", Commands::Network));
    }

    #[test]
    fn a_power_controller_of_another_program_is_said_at_the_start() {
        let shipped = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee");
        let mut config = Config::load(&shipped, true, &[]).unwrap();
        assert_eq!(anybody_releases(&config), None);
        let driver = config.modules.iter_mut().find(|module| module.name() == power::NAME).unwrap();
        driver.command = Some("psc1.py".into());
        let said = anybody_releases(&config).unwrap();
        assert!(said.starts_with("driver_power is not this program's: whoever may command"), "{said}");
        config.modules.retain(|module| module.name() != power::NAME);
        assert!(anybody_releases(&config).is_some(), "somebody else starts it");
        config.robot.power = None;
        assert_eq!(anybody_releases(&config), None, "without a PAUSE line nothing is released");
    }
}
