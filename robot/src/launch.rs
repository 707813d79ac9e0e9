//! How the watchdog's host starts the processes of modules.

use crate::config::{Config, ConfigError};
use crate::place::Place;
use host::processes::{Launch, LinesFrom, Start};
use module::State;
use std::process::Command;

/// How the watchdog's host starts a module: our own executable with our own arguments, unless the list says otherwise.
pub(crate) fn launcher(place: &Place, config: &Config, notices: Vec<String>) -> Result<Launch, ConfigError> {
    let own = std::env::current_exe().map_err(|error| ConfigError(vec![format!("own executable: {error}")]))?;
    let (place, modules, config) = (place.clone(), config.modules.clone(), config.clone());
    let run_dir = Some(place.run_dir.clone());
    let divides = modules.iter().any(|module| module.limits.memory_max.is_some() || module.limits.cpu_max.is_some());
    let rt_priority = modules.iter().filter_map(|module| module.limits.rt_priority).max().map(|highest| highest + 1);
    let start = move |name: &str, state: State| {
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
                command.args(["run", name, "--state", state.name()]).args(place.arguments());
                command
            }
        };
        command.args(args);
        let foreign = entry.is_some_and(|entry| entry.command.is_some());
        let ((print, send), usual) = (config.levels(name), LinesFrom::default());
        let lines_from = LinesFrom { print: print.unwrap_or(usual.print), send: send.unwrap_or(usual.send) };
        Start { command, limits: entry.map(|entry| entry.limits.clone()).unwrap_or_default(), foreign, lines_from }
    };
    Ok(Launch { start: Box::new(start), run_dir, divides, rt_priority, notices })
}

/// The bus as programs on the official library are told of it, which warns of options that are ours alone.
fn foreign_url(url: &str) -> String {
    match lcm::Url::parse(url) {
        Ok((lcm::Url::Udpm(udpm), _)) => lcm::Url::from(lcm::url::Udpm { shm: lcm::url::Shm::Off, ..udpm }).to_string(),
        _ => url.into(),
    }
}
