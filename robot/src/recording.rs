//! From a module to what its recording needs to begin with, and from a recording back to the module.
//!
//! A file of inputs carries the configuration that made the module, as texts, so that it can be played on another machine
//! and after the configuration has changed: `robot.toml`, `modules.toml`, each `--set`, and of the simulated robot
//! `sim.toml` and its world, whose beacons are the robot's map. Data sheets of drives are checked when a module is made
//! and say nothing about what it does; they are left out.

use crate::config::{self, Config, ConfigError, Node};
use crate::live::recorder::Inputs;
use crate::topology::{self, Made, Place};
use crate::web;
use base::Duration;
use logger::Attachment;
use logger::read::Index;
use module::record::Header;
use module::{Shell, State};
use sim::world::World;
use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Where a process finds the folder of its run.
pub const VARIABLE: &str = "ADVEE_LOG";
/// Names of texts in a header.
pub(crate) const ROBOT: &str = "robot.toml";
pub(crate) const SIM: &str = "sim.toml";
pub(crate) const MODULES: &str = "modules.toml";
pub(crate) const WORLD: &str = "world.toml";
/// Name of the texts that are overrides.
pub const SET: &str = "--set";
/// The overrides of a run, one a line.
pub(crate) const OVERRIDES: &str = "overrides.txt";
/// A configuration is not longer than this, bytes.
const TEXT_MAX: u64 = 1 << 20;
/// What the host decided: [`Made`].
const WIRE_TIME: &str = "wire_time";
const SEED: &str = "seed";
const DELAY_MAX: &str = "restart_delay_max_ns";
const LOGS: &str = "logs";

/// What the host of a module is to record, where the configuration and the run want that.
pub fn inputs(place: &Place, config: &Config, name: &str, wanted: State) -> Result<Option<Inputs>, ConfigError> {
    // What the web server is asked is nothing that could be asked again, and what the logger is told is what it writes.
    let wanted_here = config.robot.log.inputs && ![web::NAME, logger::NAME].contains(&name);
    let Some(run) = std::env::var_os(VARIABLE).filter(|_| wanted_here) else {
        return Ok(None);
    };
    let header = header(place, name, wanted, Made::LIVE)?;
    Ok(Some(Inputs { run: run.into(), header, limit: config.robot.log.inputs_max_bytes }))
}

/// The beginning of the file of a module.
pub fn header(place: &Place, name: &str, wanted: State, made: Made) -> Result<Header, ConfigError> {
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
    if place.sim {
        add(SIM, place.config.join(SIM))?;
        add(WORLD, config::world_place(&place.config, place.world.as_deref()))?;
    }
    texts.extend(place.sets.iter().map(|set| (SET.to_string(), set.clone())));
    let delay_max = made.restart_delay_max.map(|delay| u64::try_from(delay.as_nanos()).unwrap_or(u64::MAX));
    texts.extend(made.wire_time.then(|| (WIRE_TIME.into(), String::new())));
    texts.extend(made.logs.then(|| (LOGS.into(), String::new())));
    texts.extend(made.seed.map(|seed| (SEED.into(), seed.to_string())));
    texts.extend(delay_max.map(|delay| (DELAY_MAX.into(), delay.to_string())));
    Ok(Header { program: program(), module: name.into(), wanted, texts })
}

/// What a log carries: the configuration as it was read, its overrides, and the version. Of a module that is made again
/// from a recording the configuration is there.
#[must_use]
pub fn attachments(place: &Place, made: Made) -> Vec<Attachment> {
    let header = header(place, logger::NAME, State::Run, made);
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

/// The files of a run, in order; the one file that is named; none.
pub(crate) fn log_files(run: &Path) -> Vec<PathBuf> {
    if run.is_file() {
        return if run.extension().is_some_and(|ending| ending == "mcap") { vec![run.into()] } else { Vec::new() };
    }
    let number = |path: &Path| {
        let name = path.file_name()?.to_str()?;
        name.strip_prefix("log_")?.strip_suffix(".mcap")?.parse::<u64>().ok()
    };
    let entries = fs::read_dir(run).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    let mut files: Vec<(u64, PathBuf)> = entries.filter_map(|path| Some((number(&path)?, path))).collect();
    files.sort();
    files.into_iter().map(|(_, path)| path).collect()
}

/// A file, what is in it, and of its attachments the texts that were not known yet.
pub(crate) fn open_log(path: &Path, texts: &mut Vec<(String, String)>) -> io::Result<(File, Index)> {
    let mut file = File::open(path)?;
    let index = Index::read(&mut file, &mut |_, _| ())?;
    let names = [ROBOT, MODULES, SIM, WORLD, OVERRIDES];
    for attachment in index.attachments.iter().filter(|attachment| names.contains(&attachment.name.as_str())) {
        if attachment.data_len <= TEXT_MAX && texts.iter().all(|(name, _)| *name != attachment.name) {
            let mut bytes = Vec::new();
            file.seek(SeekFrom::Start(attachment.data_offset))?;
            (&mut file).take(attachment.data_len).read_to_end(&mut bytes)?;
            texts.push((attachment.name.clone(), String::from_utf8_lossy(&bytes).into_owned()));
        }
    }
    Ok((file, index))
}

/// The configuration that is attached to a log, as recorded inputs have theirs.
pub(crate) fn attached(texts: Vec<(String, String)>) -> Header {
    let (overrides, mut texts): (Vec<_>, Vec<_>) = texts.into_iter().partition(|(name, _)| name == OVERRIDES);
    let sets = overrides.iter().flat_map(|(_, text)| text.lines()).filter(|line| !line.trim().is_empty());
    texts.extend(sets.map(|line| (SET.into(), line.into())));
    Header { program: String::new(), module: String::new(), wanted: State::Run, texts }
}

/// This program, as it stands in a header.
#[must_use]
pub fn program() -> String {
    format!("advee {}", env!("CARGO_PKG_VERSION"))
}

/// Makes the module of a header again; `sets` are further overrides, after the recorded ones.
pub fn rebuild(header: &Header, sets: &[String]) -> Result<Shell, ConfigError> {
    let sim = header.text(SIM).is_some();
    let sets = [&header.texts(SET), sets].concat();
    let mut config = config(header, &sets)?;
    for node in config.robot.can.iter_mut().flat_map(|can| &mut can.nodes) {
        node.eds = None;
    }
    let nowhere = Place {
        config: PathBuf::new(),
        run_dir: PathBuf::new(),
        lcm_url: String::new(),
        sets: sets.clone(),
        sim,
        world: None,
    };
    let world = || parsed_world(header, &sets);
    topology::shell_in(&nowhere, &config, &header.module, header.wanted, made(header)?, world)
}

/// The configuration of a header, with these overrides laid over it.
pub fn config(header: &Header, sets: &[String]) -> Result<Config, ConfigError> {
    let over = if header.text(SIM).is_some() { Some(node(header, SIM)?) } else { None };
    Config::merge(node(header, ROBOT)?, over, node(header, MODULES)?, sets)
}

fn node(header: &Header, name: &str) -> Result<Node, ConfigError> {
    let text = header.text(name).ok_or_else(|| ConfigError(vec![format!("{name}: not in the file")]))?;
    Node::parse(Path::new(name), text).map_err(ConfigError)
}

/// The world of a header; none where it was no simulation.
pub fn world(header: &Header) -> Result<Option<World>, ConfigError> {
    let sets: Vec<String> = header.texts(SET);
    header.text(WORLD).map(|_| parsed_world(header, &sets)).transpose()
}

fn parsed_world(header: &Header, sets: &[String]) -> Result<World, ConfigError> {
    config::parsed_world(node(header, WORLD)?, Path::new(WORLD), sets)
}

fn made(header: &Header) -> Result<Made, ConfigError> {
    let number = |name: &str| {
        let read = |text: &str| {
            text.parse().map_err(|_| ConfigError(vec![format!("{name} = {text:?}: expected a number of nanoseconds")]))
        };
        header.text(name).map(read).transpose()
    };
    Ok(Made {
        wire_time: header.text(WIRE_TIME).is_some(),
        logs: header.text(LOGS).is_some(),
        seed: number(SEED)?,
        restart_delay_max: number(DELAY_MAX)?.map(Duration::from_nanos),
    })
}

/// Makes the folder of a run that begins now: `YYYY_MM_DD_HH_MM_SS`, in UTC. Where another run has that name it is the
/// next free second's.
pub fn make_run(folder: &Path, wall_ns: u64) -> io::Result<PathBuf> {
    fs::create_dir_all(folder)?;
    let first = wall_ns / 1_000_000_000;
    for second in first..first + 60 {
        let run = folder.join(run_name(second));
        match fs::create_dir(&run) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            result => return result.map(|()| run),
        }
    }
    Err(io::ErrorKind::AlreadyExists.into())
}

/// The name of a second since the UNIX epoch.
pub(crate) fn run_name(second: u64) -> String {
    let (mut days, time) = (second / 86_400, second % 86_400);
    let leap = |year: u64| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let mut year = 1970;
    while days >= 365 + u64::from(leap(year)) {
        days -= 365 + u64::from(leap(year));
        year += 1;
    }
    let lengths = [31, 28 + u64::from(leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 0;
    while days >= lengths[month] {
        days -= lengths[month];
        month += 1;
    }
    let (hour, minute, second) = (time / 3600, time / 60 % 60, time % 60);
    format!("{year:04}_{:02}_{:02}_{hour:02}_{minute:02}_{second:02}", month + 1, days + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_named_by_its_second() {
        assert_eq!(run_name(0), "1970_01_01_00_00_00");
        assert_eq!(run_name(951_782_399), "2000_02_28_23_59_59");
        assert_eq!(run_name(951_782_400), "2000_02_29_00_00_00");
        assert_eq!(run_name(1_767_225_599), "2025_12_31_23_59_59");
        assert_eq!(run_name(4_107_542_400), "2100_03_01_00_00_00");
    }

    #[test]
    fn two_runs_of_one_second_have_two_folders() {
        let folder = std::env::temp_dir().join(format!("advee-runs-{}", std::process::id()));
        let runs = [1, 1, 2].map(|second| make_run(&folder, second * 1_000_000_000).unwrap());
        let names = runs.map(|run| run.file_name().unwrap().to_string_lossy().into_owned());
        fs::remove_dir_all(&folder).unwrap();
        assert_eq!(names, ["1970_01_01_00_00_01", "1970_01_01_00_00_02", "1970_01_01_00_00_03"]);
    }

    #[test]
    fn every_module_is_made_again_of_what_its_file_begins_with() {
        let place = Place {
            config: Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee"),
            run_dir: "/run/advee".into(),
            lcm_url: String::new(),
            sets: vec!["limits.command_ttl_s=0.5".into()],
            sim: true,
            world: Some("empty".into()),
        };
        let config = Config::load(&place.config, true, &place.sets).unwrap();
        let listed = config.modules.iter().map(|module| module.name.as_str());
        for name in listed.chain([watchdog::NAME]) {
            let header = header(&place, name, State::Pause, Made::LIVE).unwrap();
            assert_eq!(rebuild(&header, &[]).unwrap().name(), name);
            let refused = rebuild(&header, &["limits.command_ttl_s=9".into()]).err().unwrap().to_string();
            assert!(refused.starts_with("--set: limits.command_ttl_s = 9: expected"), "{refused}");
        }
    }
}
