//! The command line: one file per command. Exit 0 only on success; an error is one clear line on stderr.
//!
//! ```
//! let command = cli::command();
//! assert_eq!(command.get_name(), "advee");
//!
//! // What `advee drive 0.3 -0.1 --for 2 --config conf/small` means.
//! let line = ["advee", "drive", "0.3", "-0.1", "--for", "2", "--config", "conf/small"];
//! let matches = command.clone().try_get_matches_from(line)?;
//! let (name, drive) = matches.subcommand().expect("every line has a command");
//! assert_eq!((name, drive.get_one::<f64>("speed")), ("drive", Some(&0.3)));
//!
//! // A speed that is not a number is an error, and nothing is sent.
//! assert!(command.try_get_matches_from(["advee", "drive", "fast", "0"]).is_err());
//! # Ok::<(), clap::Error>(())
//! ```
#![forbid(unsafe_code)]

mod action;
mod beacons;
mod bench;
mod bridge;
mod bus;
mod can;
mod choice;
mod commands;
mod completion;
mod config;
mod diag;
mod doctor;
mod drive;
mod errors;
mod estimate;
mod fault;
mod goal;
mod gym;
mod help;
mod holder;
mod home;
mod i2c;
mod imu;
mod io;
mod keep;
mod lcm;
mod level;
mod lidar;
mod listen;
mod log;
mod mode;
mod neighbours;
mod parameters;
mod plan;
mod plot;
mod port;
mod pose;
mod power;
mod progress;
mod qr;
mod release;
mod replay;
mod rs485;
mod run;
mod sim;
pub mod soak;
mod state;
mod style;
mod up;
mod web;
mod world;

use clap::error::ErrorKind;
use clap::{Args, CommandFactory, FromArgMatches, Parser};
use commands::commands;
use robot::config::{Config, ConfigError, Robot, Rs485Bus};
use robot::place::{CHECKOUT, INSTALLED, LCM_URL, RobotLocation, in_checkout};
use std::env;
use std::fmt::Display;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Embedded control system of an autonomous mobile robot.
#[derive(Parser)]
#[command(name = "advee", version, max_term_width = 120)]
struct Cli {
    #[command(flatten)]
    common: Common,
    #[command(subcommand)]
    command: Command,
}

/// Heading of the options of all commands.
const COMMON: &str = "Options of all commands";

/// Arguments of all commands.
#[derive(Args, Clone, Debug)]
pub struct Common {
    /// Configuration folder [default: conf/advee in a checkout, else /opt/advee/conf]
    #[arg(long, global = true, value_name = "DIR", help_heading = COMMON)]
    config: Option<PathBuf>,
    /// LCM bus [default: $LCM_DEFAULT_URL, else udpm://239.255.76.67:7667?ttl=0&shm=auto]
    #[arg(long, global = true, value_name = "URL", help_heading = COMMON)]
    lcm_url: Option<String>,
    /// Folder for what a running robot makes [default: run in a checkout, else /run/advee]
    #[arg(long, global = true, value_name = "DIR", help_heading = COMMON)]
    run_dir: Option<PathBuf>,
    /// Override a key of robot.toml; may be given often
    #[arg(long = "set", global = true, value_name = "KEY=VALUE", help_heading = COMMON)]
    sets: Vec<String>,
}

commands! {
    |common, command|
    enum Command {
        /// Start the robot: watchdog and all modules
        Up(up::Up) => up::up(common, command),
        /// Run one module in the foreground
        Run(run::Run) => run::run(common, command),
        /// Start and end a module as this user, for the watchdog of another user's robot
        #[command(hide = true)]
        Keep(keep::Keep) => keep::keep(command),
        /// The diagnostic center in a terminal: see everything, drive, command
        Diag(diag::Diag) => diag::diag(common, command),
        /// Show the modules' states, or command one
        State(state::State) => state::state(common, command),
        /// Show the active faults of all modules, and follow them
        Errors(errors::Errors) => errors::errors(common, command),
        /// Show from which level modules print and send their texts and reports, or change it
        Level(level::Level) => level::level(common, command),
        /// Drive by hand: speed in m/s, steering in rad; until Ctrl-C or for a time
        Drive(drive::Drive) => drive::drive(common, command),
        /// Show the goal, send the robot somewhere, or let it stand
        Goal(goal::Goal) => goal::goal(common, command),
        /// Show the operation mode of the planner, or command one
        Mode(mode::Mode) => mode::mode(common, command),
        /// Show the planner's parameters, or change one until it restarts
        Parameters(parameters::Parameters) => parameters::parameters(common, command),
        /// Command an action of the high level, cancel one, or list what is under way
        Action(action::Action) => action::action(common, command),
        /// Set the position of the robot by hand
        Pose(pose::Pose) => pose::tell(common, command),
        /// Show what the estimator makes of each beacon, exclude one, or permit it again
        Beacons(beacons::Beacons) => beacons::beacons(common, command),
        /// Show the power channels, or switch one
        Power(power::Power) => power::power(common, command),
        /// Show inputs and outputs, or set an output
        Io(io::Io) => io::io(common, command),
        /// Commission lidars, and see what they measure
        #[command(subcommand)]
        Lidar(lidar::Lidar) => command.run(common),
        /// See what the inertial measurement units measure
        #[command(subcommand)]
        Imu(imu::Imu) => imu::imu(common, command),
        /// Home the steering
        Home(home::Home) => home::home(common, command),
        /// List what can be broken in the simulation, inject a fault, or end it
        Fault(fault::Fault) => fault::fault(common, command),
        /// Run, pause, step or restart a simulation that was started with `up --sim --speed`
        Sim(sim::Sim) => sim::sim(common, command),
        /// Plan a drivable way on a map file
        Plan(plan::Plan) => plan::plan(common, command),
        /// Write a world of the simulation as a map
        #[command(subcommand)]
        World(world::Command) => world::world(common, command),
        /// Feed the modules of a run their recorded inputs again, and compare what they answer
        Replay(replay::Replay) => replay::replay(common, command),
        /// Draw a recorded run from above
        Plot(plot::Plot) => plot::plot(command),
        /// Run the estimator over a recorded run, or over recorded data of any robot
        Estimate(estimate::Estimate) => estimate::estimate(common, command),
        /// Robot-hours in virtual time: everything breaks, and rules must hold
        Soak(soak::Soak) => soak::soak(common, command),
        /// The simulated robot in virtual time, for programs that plan or learn: a JSON object per line
        Gym(gym::Gym) => gym::gym(common, command),
        /// Check machine and configuration: what is wrong, why it matters, what helps
        Doctor(doctor::Doctor) => doctor::doctor(common, command),
        /// Check the configuration, list its keys, rename those that have moved
        #[command(subcommand)]
        Config(config::Command) => config::config(common, command),
        /// Measure this machine: how late the robot's loops wake up
        Bench(bench::Bench) => bench::bench(common, command),
        /// Logs of runs: show, play, convert, recover, compare
        #[command(subcommand)]
        Log(log::Log) => command.run(common),
        /// Look at the LCM bus: channels, rates, messages
        #[command(subcommand)]
        Lcm(lcm::Lcm) => command.run(common),
        /// Serve the robot's web page, and Foxglove
        Web(web::Web) => web::web(common, command),
        /// Commission CANopen nodes
        #[command(subcommand)]
        Can(can::Can) => command.run(common),
        /// Commission the boards on EIA-485
        #[command(subcommand)]
        Rs485(rs485::Rs485) => command.run(common),
        /// Commission chips on I2C and SMBus
        #[command(subcommand)]
        I2c(i2c::I2c) => command.run(common),
        /// Make keys for connections to the other computers of the robot
        #[command(subcommand)]
        Bridge(bridge::Bridge) => command.run(common),
        /// Print the completion of a shell
        Completion(completion::Completion) => completion::completion(command),
    }
}

/// Exit code of a command line that is refused.
const USAGE: u8 = 2;

impl Command {
    /// Options of all commands that have no effect on this one, and why.
    fn idle(&self) -> (&'static [&'static str], &'static str) {
        const RUNNING: &[&str] = &["--lcm-url", "--run-dir"];
        const BUT_SETS: &[&str] = &["--lcm-url", "--run-dir", "--config"];
        match self {
            Self::Soak(_) => (RUNNING, "a soak has neither a bus nor a run folder"),
            Self::Gym(_) => (RUNNING, "a gym has neither a bus nor a run folder"),
            Self::Plan(_) | Self::World(_) => (RUNNING, "it asks no running robot"),
            Self::Estimate(estimate) if estimate.is_of_files() => (RUNNING, "it asks no running robot"),
            Self::Estimate(_) | Self::Replay(_) => (BUT_SETS, "the run has its own configuration"),
            Self::Plot(_) => (&["--lcm-url", "--run-dir", "--config", "--set"], "the run has its own configuration"),
            _ => (&[], ""),
        }
    }

    /// Refuses options of all commands that have no effect on this one.
    fn refuse_idle(&self, common: &Common) -> Result<(), Failed> {
        let (idle, why) = self.idle();
        let given = [
            ("--config", common.config.is_some()),
            ("--lcm-url", common.lcm_url.is_some()),
            ("--run-dir", common.run_dir.is_some()),
            ("--set", !common.sets.is_empty()),
        ];
        match given.iter().find(|(option, given)| *given && idle.contains(option)) {
            Some((option, _)) => Err(Failed { code: USAGE, why: format!("{option} has no effect: {why}") }),
            None => Ok(()),
        }
    }

    /// True for tools that reach lines and servers of a simulated robot through its run folder.
    fn is_of_a_run_folder(&self) -> bool {
        matches!(self, Self::Can(_) | Self::Rs485(_) | Self::I2c(_) | Self::Lidar(_) | Self::Web(_))
    }
}

/// The command line as it is defined: what manual pages and completion are made from.
#[must_use]
pub fn command() -> clap::Command {
    help::grouped(Cli::command())
}

/// Runs the executable.
#[must_use]
pub fn main() -> ExitCode {
    let parsed = command().try_get_matches().and_then(|matches| Cli::from_arg_matches(&matches));
    let Cli { common, command } = match parsed {
        Ok(cli) => cli,
        // Help and version are no errors. Who gives no arguments where some are needed is helped, too.
        Err(error) if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            error.exit()
        }
        Err(error) => {
            complain(&one_line(&error.to_string()));
            return ExitCode::from(USAGE);
        }
    };
    if let Err(Failed { code, why }) = command.refuse_idle(&common) {
        complain(&why);
        return ExitCode::from(code);
    }
    for warning in lcm_warnings(&common.lcm_url()) {
        complain(&warning);
    }
    command.run(&common).unwrap_or_else(|Failed { code, why }| {
        if !why.is_empty() {
            let elsewhere = command.is_of_a_run_folder().then(|| common.elsewhere()).flatten();
            complain(&(why + &elsewhere.unwrap_or_default()));
        }
        ExitCode::from(code)
    })
}

/// Prints a line on stderr; a failure cannot be reported.
fn complain(what: &impl Display) {
    let _ = std::io::stderr().write_all(format!("advee: {what}\n").as_bytes());
}

/// Joins clap's lines, without its usage hints.
fn one_line(error: &str) -> String {
    let lines =
        error.lines().map(str::trim).take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"));
    let text = lines.filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ");
    format!("{}; see --help", text.trim_start_matches("error: "))
}

/// Reason for a command's failure.
#[derive(Debug)]
pub struct Failed {
    code: u8,
    why: String,
}

impl From<String> for Failed {
    fn from(why: String) -> Self {
        Self { code: 1, why }
    }
}

impl From<&str> for Failed {
    fn from(why: &str) -> Self {
        Self { code: 1, why: why.into() }
    }
}

impl From<ConfigError> for Failed {
    fn from(error: ConfigError) -> Self {
        let heading = if error.0.len() > 1 { "the configuration is refused:\n" } else { "" };
        Self { code: module::exit::RESOURCE, why: format!("{heading}{error}") }
    }
}

impl From<host::Failure> for Failed {
    fn from(host::Failure { code, why }: host::Failure) -> Self {
        Self { code, why }
    }
}

type Outcome = Result<ExitCode, Failed>;

impl Common {
    fn config_dir(&self) -> PathBuf {
        self.config.clone().unwrap_or_else(|| Path::new(if in_checkout() { CHECKOUT.0 } else { INSTALLED.0 }).into())
    }

    fn run_dir(&self) -> PathBuf {
        self.run_dir.clone().unwrap_or_else(|| Path::new(if in_checkout() { CHECKOUT.1 } else { INSTALLED.1 }).into())
    }

    fn lcm_url(&self) -> String {
        let from_environment = || env::var("LCM_DEFAULT_URL").ok().filter(|url| !url.is_empty());
        self.lcm_url.clone().or_else(from_environment).unwrap_or_else(|| LCM_URL.into())
    }

    /// The configuration; a notice on stderr for each key that was found under its old name.
    fn load(&self, sim: bool) -> Result<Config, ConfigError> {
        let (config, notices) = self.load_with_notices(sim)?;
        notice(&notices);
        Ok(config)
    }

    fn load_with_notices(&self, sim: bool) -> Result<(Config, Vec<String>), ConfigError> {
        Config::load_with_notices(&self.config_dir(), sim, &self.sets)
    }

    fn place(&self, sim: bool) -> RobotLocation {
        RobotLocation {
            config: self.config_dir(),
            run_dir: self.run_dir(),
            lcm_url: self.lcm_url(),
            sets: self.sets.clone(),
            sim,
            world: None,
        }
    }

    /// The robot that runs in the run folder of this command, with its own arguments; also one whose configuration is
    /// not that of this command.
    fn running(&self) -> Option<RobotLocation> {
        let ours = std::fs::canonicalize(self.run_dir()).ok()?;
        let is_ours = |place: &RobotLocation| std::fs::canonicalize(&place.run_dir).is_ok_and(|theirs| theirs == ours);
        holder::modules().map(|running| running.place).find(is_ours)
    }

    /// End of a sentence about a failure, if a simulated robot runs, but none in the run folder of this command, which
    /// is the usual one or holds nothing.
    fn elsewhere(&self) -> Option<String> {
        let real = |folder: &Path| std::fs::canonicalize(folder).ok();
        let ours = real(&self.run_dir());
        let running: Vec<PathBuf> =
            holder::modules().filter(|running| running.place.sim).map(|running| running.place.run_dir).collect();
        let is_ours = |folder: &PathBuf| ours.is_some() && real(folder) == ours;
        let is_empty = |folder: &PathBuf| folder.read_dir().map_or(true, |mut entries| entries.next().is_none());
        let is_likely = self.run_dir.as_ref().is_none_or(is_empty);
        let other = running.first().filter(|_| is_likely && !running.iter().any(is_ours))?;
        Some(format!("; a simulated robot runs with --run-dir {}", other.display()))
    }

    /// The robot that runs here: the simulated one while one runs in the run folder, else the configured one.
    fn robot(&self) -> Result<(RobotLocation, Robot), Failed> {
        let is_offered = |bus: &Rs485Bus| bus.line.offered().is_some_and(|name| self.run_dir().join(name).exists());
        let is_here = |running: holder::Running| {
            let folders = [&running.place.run_dir, &self.run_dir()].map(std::fs::canonicalize);
            running.place.sim && matches!(folders, [Ok(theirs), Ok(ours)] if theirs == ours)
        };
        if let Ok((simulated, notices)) = self.load_with_notices(true)
            && (simulated.robot.rs485.iter().any(is_offered) || holder::modules().any(is_here))
        {
            notice(&notices);
            return Ok((self.place(true), simulated.robot));
        }
        Ok((self.place(false), self.load(false)?.robot))
    }
}

/// Options of a URL without effect; an invalid URL is reported by the command itself.
fn lcm_warnings(url: &str) -> Vec<::lcm::url::Warning> {
    ::lcm::Url::parse(url).map(|(_, warnings)| warnings).unwrap_or_default()
}

/// Prints notices about the configuration on stderr.
fn notice(lines: &[String]) {
    lines.iter().for_each(|line| complain(&format_args!("NOTICE: {line}")));
}

/// Prints a line of output. A reader that has read enough (`| head`) ends the command, without a word.
fn print(line: impl Display) -> Result<(), Failed> {
    writeln!(std::io::stdout(), "{line}").map_err(|error| match error.kind() {
        std::io::ErrorKind::BrokenPipe => Failed { code: 0, why: String::new() },
        _ => Failed::from(format!("stdout: {error}")),
    })
}

/// A duration in seconds as people give it.
fn seconds(text: &str) -> Result<std::time::Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| "expected seconds".to_string())?;
    let in_range = seconds > 0.0 && seconds <= 1e9;
    in_range.then(|| std::time::Duration::from_secs_f64(seconds)).ok_or_else(|| "expected seconds above 0".into())
}

/// A number of things: `1 message`, `2 messages`.
fn counted(number: impl Into<i128>, thing: &str) -> String {
    let number = number.into();
    format!("{number} {thing}{}", if number == 1 { "" } else { "s" })
}

/// A duration for people; s: `42 s`, `18 min`, `6 h 07 min`.
fn duration(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() => "-".into(),
        s if s < 60.0 => format!("{s:.0} s"),
        s if s < 3600.0 => format!("{:.0} min", (s / 60.0).floor()),
        s => format!("{:.0} h {:02.0} min", (s / 3600.0).floor(), (s % 3600.0 / 60.0).floor()),
    }
}

/// A whole number, decimal or 0x….
fn whole<T: TryFrom<u64>>(text: &str) -> Option<T> {
    let number = match text.strip_prefix("0x") {
        Some(hex) => u64::from_str_radix(hex, 16),
        None => text.parse(),
    };
    T::try_from(number.ok()?).ok()
}

/// A number that is one.
fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| "expected a number".into())
}
