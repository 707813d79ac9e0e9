//! `advee up`: the minimal parent of the watchdog; everything else is the watchdog's.

mod guards;
mod paced;
mod parent;
mod welcome;

use super::{Common, Failed, Outcome, neighbours, web};
use guards::Guards;
use host::log::Log;
use host::run_folder::RunFolder;
use host::runs;
use host::{beats, clock, processes};
use parent::Parent;
use robot::config::{self, Config};
use robot::place::RobotLocation;
use robot::preflight;
use robot::topology;
use sim::paced::pacer::Speed;
use simulator::world::World;
use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

#[derive(clap::Args)]
pub struct Up {
    /// The simulated robot
    #[arg(long)]
    sim: bool,
    /// The simulated world: a file, also a map in YAML, or a name in conf/worlds
    #[arg(long, value_name = "FILE", requires = "sim")]
    world: Option<PathBuf>,
    /// In virtual time, in one process: simulated seconds per real second, 0.05 to 1000, or max
    #[arg(long, value_name = "N", requires = "sim")]
    speed: Option<Speed>,
    /// Route of the simulated world to drive once the robot is ready, or none [default: patrol, if the world has it]
    #[arg(long, value_name = "NAME")]
    goal: Option<String>,
    /// Where the web server listens [default: web.listen of robot.toml, 127.0.0.1:8080]
    #[arg(long, value_name = "ADDR", conflicts_with = "headless")]
    http: Option<SocketAddr>,
    /// No web server
    #[arg(long)]
    headless: bool,
    /// Continue although a robot is on the bus
    #[arg(long)]
    force: bool,
}

impl Up {
    /// True for a robot in virtual time.
    pub fn is_paced(&self) -> bool {
        self.sim && self.speed.is_some()
    }

    /// The robot that is started.
    pub fn place(&self, common: &Common) -> RobotLocation {
        RobotLocation { world: self.world.clone(), ..common.place(self.sim) }
    }
}

pub fn up(common: &Common, command: &Up) -> Outcome {
    let log = Log::new("up");
    let mut common = common.clone();
    common.sets.extend(command.http.map(web::listen));
    common.sets.extend(command.headless.then(|| "web.enabled=false".into()));
    let common = &common;
    // Whatever is wrong is said here, once, and nothing starts; notices are the watchdog's to publish.
    let (config, _) = common.load_with_notices(command.sim)?;
    let world = match command.sim {
        true => config::world(&common.config_dir(), command.world.as_deref(), &common.sets)?,
        false => World::default(),
    };
    let place = common.place(command.sim);
    match command.speed {
        Some(_) => preflight::check(&place, &config, &world)?,
        None => preflight::check_live(&place, &config, &world)?,
    }
    host::keepers::Place::all()?;
    if let Some(at) = command.http.filter(|_| config.modules.iter().all(|module| module.name() != ::web::NAME)) {
        return Err(format!("--http {at}: modules.toml has no module {}", ::web::NAME).into());
    }
    let route = route(command, &config, &world)?;
    if let Some(speed) = command.speed {
        return paced::run(common, command, config, &world, speed);
    }
    let watchdog = watchdog(common, command)?;
    let goal = route.map(|route| goal(&watchdog, command, &route));
    // Signals are held back before there is anything to leave behind.
    let guards = Guards::new(log.clone(), config.hardware_watchdog.clone(), command.sim)?;
    let mut parent = Parent::new(log.clone(), guards)?;
    let folder = RunFolder::take(&common.run_dir())?;
    if !command.force {
        let own = std::path::absolute(common.run_dir()).ok();
        if let Err(refused) = neighbours::refuse(&common.lcm_url(), "this robot is not started", own.as_deref()) {
            folder.release();
            return Err(refused);
        }
    }
    parent.log_to(run(common, &config, &log));
    parent.run_errand(goal);
    let (run_dir, begun) = (common.run_dir(), SystemTime::now());
    let serves = config.modules.iter().any(|module| module.name() == ::web::NAME);
    parent.when_up(move || welcome::greet(run_dir, serves));
    let result = parent.run(&watchdog);
    let beats = beats::folder(folder.path());
    clean(&folder, &config);
    // Also what one that was killed has left there.
    if let Ok(beats) = beats {
        let _ = std::fs::remove_dir_all(beats);
    }
    processes::clean(folder.path());
    folder.release();
    if result.is_ok() {
        welcome::farewell(&log, &topology::log_folder(&common.place(command.sim), &config.robot), begun);
    }
    result
}

/// The way that the robot drives when all is ready. A name that the world does not have is refused.
fn route(command: &Up, config: &Config, world: &World) -> Result<Option<String>, Failed> {
    let wanted = command.goal.as_deref();
    if !command.sim {
        let named = wanted.filter(|goal| *goal != "none");
        return named.map_or(Ok(None), |goal| Err(format!("--goal {goal}: only with --sim; see advee goal").into()));
    }
    let has = |name: &str| world.routes.iter().any(|route| route.name == name);
    let plans = config.modules.iter().any(|module| module.name() == planner::NAME);
    match wanted {
        None => Ok((plans && has(PATROL)).then(|| PATROL.into())),
        Some("none") => Ok(None),
        Some(goal) if !has(goal) => Err(format!("--goal {goal}: the world has no route of that name").into()),
        Some(goal) if !plans => Err(format!("--goal {goal}: modules.toml has no planner").into()),
        Some(goal) => Ok(Some(goal.into())),
    }
}

/// What a simulated robot does where nothing else was asked for.
const PATROL: &str = "patrol";

/// The command line of the operator who sends it there once: the planner is let go by nobody else.
fn goal(watchdog: &[OsString], command: &Up, route: &str) -> Vec<OsString> {
    let mut args: Vec<OsString> = vec!["goal".into(), "--when-ready".into(), "--route".into(), route.into()];
    // As the watchdog is told, but for what is for modules alone.
    args.extend(watchdog[2..].iter().take_while(|arg| *arg != "--sim").cloned());
    if let Some(world) = &command.world {
        args.extend(["--world".into(), world.into()]);
    }
    args
}

/// The folder of this run's logs, where anything is to be written there. Without one the robot runs all the same.
fn run(common: &Common, config: &Config, log: &Log) -> Option<PathBuf> {
    if !config.robot.log.inputs {
        return None;
    }
    let folder = match &config.robot.log.folder {
        Some(folder) => common.config_dir().join(folder),
        None => robot::place::log_folder(),
    };
    let made = std::path::absolute(&folder).and_then(|folder| runs::make_run(&folder, clock::wall()));
    let refused = |error| log.line(format_args!("inputs are not recorded: {}: {error}", folder.display()));
    made.map_err(refused).ok()
}

/// Removes what modules leave in the run folder when they are killed.
fn clean(folder: &RunFolder, config: &Config) {
    for name in config.robot.rs485.iter().filter_map(|bus| bus.line.offered()) {
        let link = folder.path().join(name);
        for link in [link.with_extension("new"), link] {
            if link.is_symlink() {
                let _ = std::fs::remove_file(link);
            }
        }
    }
}

/// The command line of the watchdog; all modules get the same.
fn watchdog(common: &Common, command: &Up) -> Result<Vec<OsString>, Failed> {
    let absolute =
        |path: &Path| std::path::absolute(path).map_err(|error| Failed::from(format!("{}: {error}", path.display())));
    let mut args: Vec<OsString> = vec!["run".into(), watchdog::NAME.into()];
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
