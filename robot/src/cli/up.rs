//! `advee up`: the minimal parent of the watchdog; everything else is the watchdog's.

mod guards;
mod parent;

use super::{Common, Failed, Outcome};
use crate::config::{self, Config};
use crate::live::log::Log;
use crate::live::{beats, clock, processes};
use crate::recording;
use crate::run_folder::RunFolder;
use guards::Guards;
use parent::Parent;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Up {
    /// The simulated robot
    #[arg(long)]
    sim: bool,
    /// The simulated world: a file, or a name in conf/worlds
    #[arg(long, value_name = "FILE", requires = "sim")]
    world: Option<PathBuf>,
    /// Where to go; this version has no planner and knows only `none`
    #[arg(long, value_name = "NAME")]
    goal: Option<String>,
    /// The web diagnostic center; this version has none
    #[arg(long, value_name = "ADDR")]
    http: Option<String>,
    /// No web diagnostic center
    #[arg(long)]
    headless: bool,
}

pub fn up(common: &Common, command: &Up) -> Outcome {
    let log = Log::new("up");
    if let Some(goal) = command.goal.as_deref().filter(|goal| *goal != "none") {
        return Err(format!("--goal {goal}: this version has no planner; use --goal none, or advee drive").into());
    }
    match &command.http {
        Some(address) if !command.headless => {
            return Err(format!("--http {address}: this version has no web server; use --headless").into());
        }
        _ if !command.headless => {
            log.line("there is no web diagnostic center in this version (--headless hides this line)");
        }
        _ => {}
    }
    // Whatever is wrong is said here, once, and nothing starts.
    let config = common.load(command.sim)?;
    if command.sim {
        config::world(&common.config_dir(), command.world.as_deref(), &common.sets)?;
    }
    let watchdog = watchdog(common, command)?;
    // Signals are held back before there is anything to leave behind.
    let guards = Guards::new(log.clone(), config.hardware_watchdog.clone(), command.sim)?;
    let mut parent = Parent::new(log.clone(), guards)?;
    let folder = RunFolder::take(&common.run_dir())?;
    parent.log_to(run(common, &config, &log));
    let result = parent.run(&watchdog);
    let beats = beats::folder(folder.path());
    clean(&folder, &config);
    // Also what one that was killed has left there.
    if let Ok(beats) = beats {
        let _ = std::fs::remove_dir_all(beats);
    }
    processes::clean(folder.path());
    folder.give_back();
    result
}

/// The folder of this run's logs, where anything is to be written there. Without one the robot runs all the same.
fn run(common: &Common, config: &Config, log: &Log) -> Option<PathBuf> {
    if !config.robot.log.inputs {
        return None;
    }
    let folder = match &config.robot.log.folder {
        Some(folder) => common.config_dir().join(folder),
        None => common.log_dir(),
    };
    let made = std::path::absolute(&folder).and_then(|folder| recording::make_run(&folder, clock::wall()));
    let refused = |error| log.line(format_args!("inputs are not recorded: {}: {error}", folder.display()));
    made.map_err(refused).ok()
}

/// Removes what modules leave in the run folder when they are killed.
fn clean(folder: &RunFolder, config: &Config) {
    for bus in config.robot.rs485.iter().filter(|bus| bus.port.is_relative()) {
        let link = folder.path().join(&bus.port);
        for link in [link.with_extension("new"), link] {
            if link.is_symlink() {
                let _ = std::fs::remove_file(link);
            }
        }
    }
}

/// The command line of the watchdog; all modules get the same.
fn watchdog(common: &Common, command: &Up) -> Result<Vec<std::ffi::OsString>, Failed> {
    let absolute =
        |path: &Path| std::path::absolute(path).map_err(|error| Failed::from(format!("{}: {error}", path.display())));
    let mut args: Vec<std::ffi::OsString> = vec!["run".into(), watchdog::NAME.into()];
    args.extend(["--config".into(), absolute(&common.config_dir())?.into()]);
    args.extend(["--run-dir".into(), absolute(&common.run_dir())?.into()]);
    args.extend(["--lcm-url".into(), common.lcm_url().into()]);
    for set in &common.sets {
        args.extend(["--set".into(), set.into()]);
    }
    if command.sim {
        args.push("--sim".into());
    }
    if let Some(world) = &command.world {
        args.extend(["--world".into(), world.into()]);
    }
    Ok(args)
}
