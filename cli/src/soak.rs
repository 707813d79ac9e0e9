//! `advee soak`: robot-hours in virtual time, under chaos and calm, with rules that must hold.

mod attend;
mod inputs;
mod trace;

pub use attend::Progress;

use super::{Common, Failed, Outcome, print};
use base::Duration;
use inputs::Inputs;
use robot::checks;
use robot::config::{self, ConfigError, built_in_scenario, scenario};
use robot::place::RobotLocation;
use robot::preflight;
use robot::topology::{virtual_machine, virtual_machine_recorded};
use serde_json::json;
use sim::check::Limits;
use sim::check::wire::Protocol;
use sim::host::{self, Virtual};
use sim::soak::{self, Behaviour, Disk, Fault, Goals, Report, Scenario, Shares, Stage, Touches, draw, shrink};
use simulator::world::World;
use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Display};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use std::{panic, thread};
use trace::Trace;

/// What is asked for.
#[derive(clap::Args)]
pub struct Soak {
    /// Robot-hours; rounded up to whole episodes
    #[arg(long, value_name = "H", value_parser = hours, default_value = "1", conflicts_with = "episode")]
    hours: f64,
    /// What all chance follows from
    #[arg(long, value_name = "S", default_value = "1")]
    seed: u64,
    /// The simulated world: a file, also a map in YAML, or a name in conf/worlds [default: the scenario's, in turn]
    #[arg(long, value_name = "FILE")]
    world: Option<PathBuf>,
    /// What happens [default: scenarios/default.toml in a checkout or beside the configuration, else as built in]
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Episodes at once [default: as many as there are processors]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024), conflicts_with = "episode")]
    jobs: Option<u16>,
    /// Only the episode of this number
    #[arg(long, value_name = "N")]
    episode: Option<u64>,
    /// Of its faults only those of these numbers, from 0; `none` for none
    #[arg(long, value_name = "LIST", requires = "episode", conflicts_with_all = ["hours", "jobs"],
          value_parser = numbers)]
    faults: Option<Numbers>,
    /// Print what the rules observe between these times of the episode, s
    #[arg(long, value_name = "A,B", requires = "episode", conflicts_with_all = ["hours", "jobs", "json"],
          value_parser = trace::part)]
    trace: Option<Trace>,
    /// Machine-readable
    #[arg(long)]
    json: bool,
}

/// Which of an episode's faults.
#[derive(Clone, Debug)]
struct Numbers(Vec<usize>);

impl Display for Numbers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            return f.write_str("none");
        }
        let list: Vec<String> = self.0.iter().map(usize::to_string).collect();
        f.write_str(&list.join(","))
    }
}

thread_local! {
    /// The episode that this thread runs.
    static EPISODE: Cell<u64> = const { Cell::new(0) };
}

/// Fault of a drive that its own checks find.
const FAULT: &str = "fault";
/// Fault of a wheel that only one on a serial line has.
const GARBLED: &str = "garbled";

/// Fewer faults are sought with at most so many runs.
const TRIES: u32 = 200;
/// Exit code of a signal without its number.
const SIGNALLED: u8 = 128;

/// Runs the command.
///
/// # Errors
/// A file is refused, or the robot cannot be made.
pub fn soak(common: &Common, command: &Soak) -> Outcome {
    let robot = Robot::load(common, command)?;
    if !robot.without.is_empty() {
        let names: Vec<&str> = robot.without.iter().map(String::as_str).collect();
        eprintln!("left out of the scenario, which this robot does not have: {}", names.join(", "));
    }
    let begun = Instant::now();
    let hook = panic::take_hook();
    tell_of_panics(robot.again.clone(), command.faults.clone());
    let each = robot.scenario.episode();
    let episodes = match command.episode {
        Some(_) => 1,
        None => (command.hours * 3600.0 / each.as_secs_f64()).ceil().max(1.0) as u64,
    };
    let progress = Progress::new(episodes, each)?;
    let report = match command.episode {
        Some(number) => robot.one(number, command.faults.as_ref(), command.trace, &progress),
        None => robot.many(episodes, command.jobs.map_or_else(processors, usize::from), &progress),
    }?;
    let minimal = match (report.violations.first(), &command.faults) {
        (Some((number, violation)), None) => robot.minimal(*number, violation.rule, &progress),
        _ => None,
    };
    panic::set_hook(hook);
    let took = begun.elapsed().as_secs_f64();
    if command.json {
        print(robot.json(&report, minimal.as_ref(), took))?;
    } else {
        robot.show(&report, took, command.faults.as_ref(), minimal.as_ref())?;
    }
    match progress.signal() {
        Some(signal) if report.violations.is_empty() => {
            let why = format!("interrupted: {} of {episodes} episodes were judged", report.episodes);
            Err(Failed { code: SIGNALLED + signal, why })
        }
        _ => Ok(ExitCode::from(u8::from(!report.violations.is_empty()))),
    }
}

/// The robot in a world.
struct Ground {
    /// Name of the world.
    name: String,
    place: RobotLocation,
    world: World,
}

impl Ground {
    fn new(place: &RobotLocation, world: Option<PathBuf>) -> Result<Self, ConfigError> {
        let place = RobotLocation { world, ..place.clone() };
        let path = config::world_place(&place.config, place.world.as_deref());
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let world = config::world(&place.config, place.world.as_deref(), &place.sets)?;
        // Made once here, so that a mistake in the configuration is reported as one.
        drop(virtual_machine(&place, host::Config::default())?);
        Ok(Self { name, place, world })
    }
}

/// A robot that can be made again and again, and what it is put through.
pub struct Robot {
    /// The robot in each world; episodes take them in turn.
    grounds: Vec<Ground>,
    scenario: Scenario,
    /// Targets of the scenario that the robot does not have.
    without: BTreeSet<String>,
    limits: Limits,
    seed: u64,
    /// All modules that run, which in virtual time the logger does not: one of them is recorded in each episode, in
    /// turn, and played again.
    modules: Vec<String>,
    /// What of the command line makes the same robot again.
    again: String,
}

impl Robot {
    /// The simulated robot of the configuration under a scenario: in the world of `place`, else in those of the
    /// scenario.
    ///
    /// # Errors
    /// What is wrong with any of the files.
    pub fn new(place: RobotLocation, scenario: Scenario, seed: u64) -> Result<Self, ConfigError> {
        let worlds: Vec<Option<PathBuf>> = match place.world {
            None if !scenario.worlds.is_empty() => scenario.worlds.iter().map(|world| Some(world.into())).collect(),
            _ => vec![place.world.clone()],
        };
        let grounds = worlds.into_iter().map(|world| Ground::new(&place, world)).collect::<Result<_, _>>()?;
        let limits = checks::limits(&place, scenario.restart_delay_max)?;
        let offered = preflight::faults(&place)?;
        let wheels: Vec<&str> = limits.wheels.iter().map(|wheel| wheel.name.as_str()).collect();
        let has = |target: &str| offered.iter().any(|(name, _)| name == target);
        let on_line = |name: &str| {
            limits.wheels.iter().find(|wheel| wheel.name == name).is_some_and(|wheel| wheel.drive.line().is_some())
        };
        let buses: Vec<&str> = limits.buses.iter().map(String::as_str).collect();
        let mut lines: Vec<&str> = limits.wheels.iter().filter_map(|wheel| wheel.drive.line()).collect();
        lines.dedup();
        // An error of a RoboClaw remains until somebody restarts it, which no operator of a soak does.
        let is_roboclaw = |name: &str| {
            let own = limits.wheels.iter().find(|wheel| wheel.name == name);
            own.is_some_and(|wheel| matches!(wheel.drive.protocol, Protocol::RoboClaw { .. }))
        };
        // What a drive on a serial line can have, and what only one there can.
        let can_have = |target: &str, fault: &str| {
            if is_roboclaw(target) && fault == FAULT {
                return false;
            }
            let offers = || offered.iter().any(|(name, faults)| name == target && faults.contains(&fault));
            match wheels.contains(&target) {
                true if on_line(target) => offers(),
                true => fault != GARBLED,
                false => true,
            }
        };
        // What the shipped scenario names a robot need not have. Any other name is a mistake, which a run reports.
        let shipped = built_in_scenario()?;
        let is_usual = |target: &str| shipped.kinds.iter().any(|kind| kind.targets.iter().any(|own| own == target));
        let (scenario, mut without) = scenario.suited(&wheels, &buses, &lines, |target, fault| {
            (has(target) || !is_usual(target)) && can_have(target, fault)
        });
        without.retain(|target| !has(target));
        // The reference robot may have lidars and inertial units, and is complete without them.
        if without.iter().all(|target| target.starts_with("lidar.") || target.starts_with("imu.")) {
            without.clear();
        }
        let scenario = Scenario { operator: behaviour(&place, &scenario.operator)?, ..scenario };
        let config = config::Config::load(&place.config, place.sim, &place.sets)?;
        let run = config.modules.iter().filter(|module| module.name() != logger::NAME);
        let mut modules: Vec<String> = run.map(|module| module.name().to_owned()).collect();
        modules.push(watchdog::NAME.into());
        Ok(Self { grounds, scenario, without, limits, seed, modules, again: String::new() })
    }

    fn load(common: &Common, command: &Soak) -> Result<Self, Failed> {
        let path = command.scenario.clone().or_else(|| usual_scenario(&common.config_dir()));
        let scenario = path.map_or_else(built_in_scenario, |path| scenario(&path))?;
        // Names the keys with old names, once for all episodes.
        common.load(true)?;
        let place = RobotLocation { world: command.world.clone(), ..common.place(true) };
        let mut again = format!("advee soak --seed {}", command.seed);
        let mut option = |name: &str, value: String| again.push_str(&format!(" --{name} {}", quoted(&value)));
        for (name, path) in [("world", &command.world), ("scenario", &command.scenario), ("config", &common.config)] {
            path.iter().for_each(|path| option(name, path.display().to_string()));
        }
        common.sets.iter().for_each(|set| option("set", set.clone()));
        Ok(Self { again, ..Self::new(place, scenario, command.seed)? })
    }

    /// The world of an episode, and the robot in it.
    fn ground(&self, episode: u64) -> &Ground {
        &self.grounds[(episode % self.grounds.len() as u64) as usize]
    }

    /// The faults of an episode.
    #[must_use]
    pub fn faults(&self, number: u64) -> Vec<Fault> {
        draw(&self.scenario, self.seed, number)
    }

    /// Runs one episode with some of its faults, or all.
    ///
    /// # Errors
    /// One line why it cannot be run.
    pub fn episode(&self, number: u64, faults: &[Fault]) -> Result<soak::Outcome, String> {
        self.run(number, faults, None, &AtomicBool::new(false))
    }

    fn run(
        &self,
        number: u64,
        faults: &[Fault],
        trace: Option<Trace>,
        stop: &AtomicBool,
    ) -> Result<soak::Outcome, String> {
        EPISODE.set(number);
        let Self { scenario, limits, seed, .. } = self;
        let Ground { place, world, .. } = self.ground(number);
        let disk = Disk::default();
        let stage = Stage { scenario, world, limits, seed: *seed, disk: &disk, stop };
        let recorded = self.modules[(number % self.modules.len() as u64) as usize].as_str();
        let inputs = Inputs::new(recorded, disk.clone());
        let mut outcome = soak::episode(&stage, number, faults, &mut |config| {
            let mut machine = machine(place, config, &inputs)?;
            if let Some(trace) = trace {
                trace.observe(&mut machine);
            }
            Ok(machine)
        })?;
        if outcome.complete {
            outcome.violation = outcome.violation.or_else(|| inputs.violation());
        }
        Ok(outcome)
    }

    /// Runs as many episodes as asked for, so many at once. After a violation no further ones are begun, and those
    /// after the first that has one do not count: what comes out does not depend on who ran what when. After an
    /// interruption those that were judged until then count.
    ///
    /// # Errors
    /// One line why one of them cannot be run.
    pub fn many(&self, episodes: u64, jobs: usize, progress: &Progress) -> Result<Report, String> {
        let (left, done) = (Mutex::new(0..episodes), Mutex::new(BTreeMap::new()));
        let work = || {
            loop {
                let Some(number) = left.lock().unwrap_or_else(PoisonError::into_inner).next() else { return };
                let outcome = self.run(number, &self.faults(number), None, progress.stop());
                if outcome.as_ref().is_ok_and(|outcome| !outcome.complete) {
                    return;
                }
                if let Some(violation) = outcome.as_ref().ok().and_then(|outcome| outcome.violation.as_ref()) {
                    progress.found(number, violation);
                }
                if outcome.as_ref().map_or(true, |outcome| outcome.violation.is_some()) {
                    let mut left = left.lock().unwrap_or_else(PoisonError::into_inner);
                    left.end = left.end.min(number + 1);
                }
                done.lock().unwrap_or_else(PoisonError::into_inner).insert(number, outcome);
                progress.judged();
            }
        };
        progress.run(jobs, work);
        let mut report = Report::new(self.seed);
        let end = left.into_inner().unwrap_or_else(PoisonError::into_inner).end;
        let done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
        for (number, outcome) in done.into_iter().take_while(|(number, _)| *number < end) {
            report.add(number, &outcome?);
        }
        Ok(report)
    }

    fn one(
        &self,
        number: u64,
        only: Option<&Numbers>,
        trace: Option<Trace>,
        progress: &Progress,
    ) -> Result<Report, String> {
        let mut faults = self.faults(number);
        if let Some(Numbers(only)) = only {
            if let Some(none) = only.iter().find(|place| **place >= faults.len()) {
                return Err(format!("--faults {none}: episode {number} has {} faults, from 0 on", faults.len()));
            }
            faults = only.iter().map(|place| faults[*place].clone()).collect();
            faults.sort_by_key(|fault| fault.at);
        }
        let mut report = Report::new(self.seed);
        let outcomes = progress.run(1, || self.run(number, &faults, trace, progress.stop()));
        for outcome in outcomes {
            let outcome = outcome?;
            if !outcome.complete {
                continue;
            }
            if let Some(violation) = &outcome.violation {
                progress.found(number, violation);
            }
            report.add(number, &outcome);
        }
        Ok(report)
    }

    /// The fewest faults of an episode that were found with which the same rule breaks, by their numbers. This can take
    /// minutes: each reduction is shown. `None` if it was interrupted before the first one.
    fn minimal(&self, number: u64, rule: &str, progress: &Progress) -> Option<Minimal> {
        progress.run(1, || self.fewest(number, rule, progress)).into_iter().next().flatten()
    }

    fn fewest(&self, number: u64, rule: &str, progress: &Progress) -> Option<Minimal> {
        let all: Vec<(usize, Fault)> = self.faults(number).into_iter().enumerate().collect();
        let mut runs = 0;
        let faults = shrink(&all, TRIES, |some| {
            if progress.stop().load(Ordering::Relaxed) {
                return false;
            }
            let faults: Vec<Fault> = some.iter().map(|(_, fault)| fault.clone()).collect();
            let outcome = self.run(number, &faults, None, progress.stop());
            runs += 1;
            let fails = outcome.is_ok_and(|outcome| outcome.violation.is_some_and(|violation| violation.rule == rule));
            if fails {
                let line = format!("episode {number}: {} of {} faults are enough ({runs} runs)", some.len(), all.len());
                progress.tell(&line);
            }
            fails
        });
        let numbers = Numbers(faults.iter().map(|(place, _)| *place).collect());
        let interrupted = progress.signal().is_some() && faults.len() == all.len();
        let command = repeat(&self.again, number, Some(&numbers));
        (!interrupted).then_some(Minimal { command, faults, of: all.len() })
    }

    /// `only`: the faults that were asked for.
    fn show(
        &self,
        report: &Report,
        took: f64,
        only: Option<&Numbers>,
        minimal: Option<&Minimal>,
    ) -> Result<(), Failed> {
        let hours = report.time.as_secs_f64() / 3600.0;
        let Report { episodes, figures, faults, .. } = report;
        print(format_args!("robot-hours     {hours:.2} in {episodes} episodes, seed {}", self.seed))?;
        print(format_args!("worlds          {}", self.worlds().join(", ")))?;
        print(format_args!("faults          {}", faults.values().sum::<u64>()))?;
        for (kind, count) in faults {
            print(format_args!("  {kind:<22} {count:>6}"))?;
        }
        print(format_args!("distance        {:.2} km", figures.distance / 1000.0))?;
        for (source, metres) in shares(figures) {
            let percent = 100.0 * metres / figures.distance.max(1e-9);
            print(format_args!("  {source:<22} {:>6.2} km, {percent:.0} %", metres / 1000.0))?;
        }
        print(format_args!("stops           {}", figures.stops))?;
        print(format_args!("contacts        {} by the robot", figures.contacts))?;
        for (kind, Touches { count, fastest_mps }) in touches(figures) {
            let fastest = if count > 0 { format!(", fastest {fastest_mps:.2} m/s") } else { String::new() };
            print(format_args!("  {kind:<22} {count:>6}{fastest}"))?;
        }
        let Goals { sent, reached, given_up } = figures.goals;
        print(format_args!("goals           {reached} reached of {sent}, {given_up} blocked or failed"))?;
        for (name, time) in worst(figures) {
            let time = time.map_or("-".into(), |time| format!("{:.1} ms", time.as_secs_f64() * 1e3));
            print(format_args!("worst, {name:<24} {time:>10}"))?;
        }
        print(format_args!("digest          {:016x}", report.digest()))?;
        print(format_args!("speed factor    {:.0} ({took:.1} s)", hours * 3600.0 / took.max(1e-9)))?;
        print(format_args!("violations      {}", report.violations.len()))?;
        for (number, violation) in &report.violations {
            print(format_args!("episode {number}, in {}: {violation}", self.ground(*number).name))?;
            if minimal.is_none() {
                print(format_args!("repeat: {}", repeat(&self.again, *number, only)))?;
            }
        }
        if let Some(Minimal { command, faults, of }) = minimal {
            print(format_args!("of its {of} faults these are enough:"))?;
            for (_, fault) in faults {
                print(format_args!("  {fault}"))?;
            }
            print(format_args!("repeat: {command}"))?;
        }
        Ok(())
    }

    fn worlds(&self) -> Vec<&str> {
        self.grounds.iter().map(|ground| ground.name.as_str()).collect()
    }

    fn json(&self, report: &Report, minimal: Option<&Minimal>, took: f64) -> serde_json::Value {
        let hours = report.time.as_secs_f64() / 3600.0;
        let violations = report.violations.iter().map(|(number, violation)| {
            let at = violation.at.as_nanos() as f64 / 1e9;
            let world = &self.ground(*number).name;
            json!({ "episode": number, "world": world, "at": at, "rule": violation.rule, "what": violation.what })
        });
        let minimal = minimal.map(|minimal| {
            let faults = minimal.faults.iter().map(|(number, fault)| {
                json!({ "number": number, "at": fault.at.as_secs_f64(), "kind": fault.kind, "target": fault.target,
                    "fault": fault.fault, "value": fault.value, "lasts": fault.lasts })
            });
            json!({ "repeat": minimal.command, "faults": faults.collect::<Vec<_>>() })
        });
        let seconds = |time: Option<Duration>| json!(time.map(|time| time.as_secs_f64()));
        let worst = keyed(worst(&report.figures).map(|(name, time)| (name, seconds(time))));
        json!({
            "hours": hours,
            "seed": self.seed,
            "worlds": self.worlds(),
            "episodes": report.episodes,
            "digest": format!("{:016x}", report.digest()),
            "violations": violations.collect::<Vec<_>>(),
            "minimal": minimal,
            "faults": report.faults,
            "distance": report.figures.distance,
            "distance_by": keyed(shares(&report.figures).map(|(name, metres)| (name, json!(metres)))),
            "stops": report.figures.stops,
            "goals": report.figures.goals.reached,
            "goals_sent": report.figures.goals.sent,
            "goals_given_up": report.figures.goals.given_up,
            "contacts": report.figures.contacts,
            "contacts_by": keyed(touches(&report.figures).map(|(name, touches)| {
                (name, json!({ "count": touches.count, "fastest_mps": touches.fastest_mps }))
            })),
            "worst": worst,
            "speed_factor": hours * 3600.0 / took.max(1e-9),
        })
    }
}

/// A module that panics is a find: where that unwinds the episode tells of it, where it aborts the last word is this.
fn tell_of_panics(again: String, only: Option<Numbers>) {
    panic::set_hook(Box::new(move |panic| {
        if cfg!(panic = "abort") {
            let line = format!("advee: {panic}\nrepeat: {}\n", repeat(&again, EPISODE.get(), only.as_ref()));
            let _ = std::io::stderr().write_all(line.as_bytes());
        }
    }));
}

/// The command that repeats an episode with only these faults, or all. `again`: what makes the same robot.
fn repeat(again: &str, episode: u64, only: Option<&Numbers>) -> String {
    let faults = only.map(|only| format!(" --faults {only}")).unwrap_or_default();
    format!("{again} --episode {episode}{faults}")
}

/// The faults that are enough for a violation.
struct Minimal {
    command: String,
    faults: Vec<(usize, Fault)>,
    of: usize,
}

fn machine(place: &RobotLocation, config: host::Config, inputs: &Inputs) -> Result<Virtual, String> {
    let inputs = inputs.clone();
    let machine = virtual_machine_recorded(place, config, move |module| inputs.sink(module));
    let mut machine = machine.map_err(|error| error.to_string())?;
    machine.keep(watchdog::NAME)?;
    Ok(machine)
}

/// The operator knows the robot.
fn behaviour(place: &RobotLocation, operator: &Behaviour) -> Result<Behaviour, ConfigError> {
    let config = config::Config::load(&place.config, true, &place.sets)?;
    let geometry = &config.robot.geometry;
    let body = (geometry.rear_m(), geometry.front_m(), geometry.width_m() / 2.0);
    Ok(Behaviour { wheelbase: geometry.wheelbase_m, body, shape: geometry.footprint().copied(), ..*operator })
}

/// The first that exists: in a checkout, or beside the configuration.
fn usual_scenario(config: &Path) -> Option<PathBuf> {
    let places = [PathBuf::from("scenarios/default.toml"), config.join("../scenarios/default.toml")];
    places.into_iter().find(|place| place.exists())
}

fn worst(figures: &soak::Figures) -> [(&'static str, Option<Duration>); 6] {
    let soak::Worst { silence_to_stop, rules, loss_to_run, calm_to_motion } = figures.worst;
    [
        ("silence to stop", silence_to_stop),
        ("PAUSE known to stop", rules.pause_to_stop),
        ("hang or death to stop", rules.loss_to_stop),
        ("hang or death to RUN", loss_to_run),
        ("calm to wanted states", rules.calm_to_wanted),
        ("calm to motion", calm_to_motion),
    ]
}

fn shares(figures: &soak::Figures) -> [(&'static str, f64); 3] {
    let Shares { operator, planner, others } = figures.shares;
    [("operator", operator), ("planner", planner), ("others", others)]
}

fn touches(figures: &soak::Figures) -> [(&'static str, Touches); 5] {
    let soak::Contacts { robot_into_wall, robot_into_person, person_into_robot, in_sight, out_of_hiding } =
        figures.touched;
    [
        ("robot into wall", robot_into_wall),
        ("robot into person", robot_into_person),
        ("person into robot", person_into_robot),
        ("in sight", in_sight),
        ("out of hiding", out_of_hiding),
    ]
}

/// An object whose keys are names with `_` for spaces.
fn keyed<const N: usize>(values: [(&str, serde_json::Value); N]) -> serde_json::Value {
    values.into_iter().map(|(name, value)| (name.replace(' ', "_"), value)).collect::<serde_json::Map<_, _>>().into()
}

fn processors() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:".contains(c);
    if word.chars().all(plain) { word.into() } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

fn hours(text: &str) -> Result<f64, String> {
    let hours: f64 = text.parse().map_err(|_| "expected hours".to_string())?;
    (hours > 0.0 && hours <= 1e6).then_some(hours).ok_or_else(|| "expected hours above 0, up to 1e6".into())
}

fn numbers(text: &str) -> Result<Numbers, String> {
    if text == "none" {
        return Ok(Numbers(Vec::new()));
    }
    let numbers = text.split(',').map(str::parse).collect::<Result<Vec<usize>, _>>();
    numbers.map(Numbers).map_err(|_| "expected numbers with commas between, or none".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration as StdDuration;

    /// A robot of short episodes in an empty world.
    fn robot() -> Robot {
        within(Some("empty".into()), &[]).unwrap()
    }

    /// The same in a world, or in those of its scenario.
    fn within(world: Option<PathBuf>, worlds: &[&str]) -> Result<Robot, ConfigError> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let shipped = scenario(&root.join("scenarios/default.toml")).unwrap();
        let (settle, chaos, calm) = (12, 1, 15);
        let seconds = Duration::from_secs;
        let scenario = Scenario {
            settle: seconds(settle),
            chaos: seconds(chaos),
            calm: seconds(calm),
            turns: 1,
            kinds: Vec::new(),
            worlds: worlds.iter().map(|world| (*world).into()).collect(),
            ..shipped
        };
        let place = RobotLocation {
            config: root.join("conf/advee"),
            run_dir: "/run/advee".into(),
            lcm_url: "memq://".into(),
            sets: Vec::new(),
            sim: true,
            world,
        };
        Robot::new(place, scenario, 1)
    }

    #[test]
    fn episodes_take_the_worlds_of_the_scenario_in_turn_unless_one_is_given() {
        let names = |robot: &Robot| [0, 1, 2].map(|episode| robot.ground(episode).name.clone());
        let drawn = within(None, &["corridor", "empty"]).unwrap();
        assert_eq!(names(&drawn), ["corridor", "empty", "corridor"]);
        assert!(drawn.grounds[0].world != drawn.grounds[1].world);
        assert_eq!(names(&within(Some("warehouse".into()), &["corridor", "empty"]).unwrap()), ["warehouse"; 3]);
        assert_eq!(names(&within(None, &[]).unwrap()), ["hall"; 3]);
        assert!(within(None, &["hall", "nowhere"]).is_err());
    }

    #[test]
    fn an_interrupted_soak_keeps_the_episodes_that_were_judged() {
        let (robot, progress) = (robot(), Progress::none());
        let report = thread::scope(|scope| {
            let soak = scope.spawn(|| robot.many(1_000_000, 2, &progress));
            while progress.done() == 0 {
                thread::sleep(StdDuration::from_millis(1));
            }
            progress.stop().store(true, Ordering::Relaxed);
            soak.join().unwrap().unwrap()
        });
        assert!((1..1000).contains(&report.episodes), "{}", report.episodes);
        assert_eq!(report.episodes, progress.done());
        assert!(report.figures.distance > 0.0 && report.violations.is_empty(), "{:?}", report.violations);
        let figures = &report.figures;
        let all: f64 = shares(figures).iter().map(|(_, metres)| metres).sum();
        assert!((all - figures.distance).abs() < 1e-6, "{figures:?}");
    }

    #[test]
    fn options_without_effect_are_refused() {
        let parse = |line: &str| crate::command().try_get_matches_from(line.split(' ')).map(drop);
        for line in [
            "advee soak --episode 1 --jobs 2",
            "advee soak --episode 1 --hours 2",
            "advee soak --faults 1",
            "advee soak --trace 1,2",
            // What conflicts with a required option must not make up for it.
            "advee soak --faults none --hours 0.1",
            "advee soak --faults none --jobs 2",
            "advee soak --trace 1,2 --hours 0.1",
            "advee goal 1,2 --world hall",
            "advee can scan --bus main --bitrate 125000",
            "advee rs485 scan --bus a --baud 9600",
            "advee rs485 scan --bus a --transport parity",
            "advee i2c scan --bus aux --hz 1000",
            "advee power --json on",
            "advee soak --episode 1 --trace 2,1",
            "advee soak --episode 1 --trace 1,2 --json",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
        assert!(parse("advee soak --episode 1 --trace 1,2.5").is_ok());
    }

    #[test]
    fn options_of_all_commands_without_effect_are_refused() {
        use clap::FromArgMatches as _;
        let refused = |line: &str| {
            let matches = crate::command().try_get_matches_from(line.split(' ')).expect(line);
            let crate::Cli { common, command } = crate::Cli::from_arg_matches(&matches).expect(line);
            command.refuse_idle(&common).map_err(|Failed { code, why }| (code, why)).err()
        };
        let csv = "advee estimate --odometry o --bearings b --beacons s";
        for (line, option) in [
            ("advee soak".to_string(), "--run-dir"),
            ("advee soak".into(), "--lcm-url"),
            ("advee gym".into(), "--run-dir"),
            ("advee gym".into(), "--lcm-url"),
            ("advee plan --world hall --start 1,2,0 --goal 3,4".into(), "--lcm-url"),
            ("advee plan --world hall --start 1,2,0 --goal 3,4".into(), "--run-dir"),
            ("advee world map --out m.yaml".into(), "--lcm-url"),
            (csv.into(), "--lcm-url"),
            (csv.into(), "--run-dir"),
            ("advee estimate log/run".into(), "--config"),
            ("advee replay log/run".into(), "--run-dir"),
            ("advee plot log/run".into(), "--set"),
        ] {
            assert_eq!(refused(&line), None, "{line}");
            let (code, why) = refused(&format!("{line} {option} a=b")).expect(&line);
            assert!(code == 2 && why.starts_with(&format!("{option} has no effect: ")), "{line}: {why}");
        }
        for line in [
            format!("{csv} --config conf/advee --set a=b"),
            "advee replay log/run --set a=b".into(),
            "advee plan --world hall --start 1,2,0 --goal 3,4 --config conf/advee --set a=b".into(),
            "advee state --lcm-url memq:// --run-dir run".into(),
        ] {
            assert_eq!(refused(&line), None, "{line}");
        }
        assert!(crate::command().try_get_matches_from("advee estimate log/run --hold after".split(' ')).is_err());
    }
}
