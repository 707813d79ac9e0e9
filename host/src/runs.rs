//! Folders of runs: their names, their files, and the configuration in their logs.

use logger::read::Index;
use logger::run_name;
use module::State;
use record::Header;
use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Name of the text of `robot.toml` in a header.
pub const ROBOT: &str = "robot.toml";
/// Name of the text of `sim.toml`; only the simulated robot has it.
pub const SIM: &str = "sim.toml";
/// Name of the text of `modules.toml`.
pub const MODULES: &str = "modules.toml";
/// Name of the text of the simulated robot's world.
pub const WORLD: &str = "world.toml";
/// Walls of the map of a world, as the text of a world.
pub const WALLS: &str = "world_walls.toml";
/// Name of the text with the overrides.
pub const SET: &str = "--set";
/// The overrides of a run, one a line.
pub const OVERRIDES: &str = "overrides.txt";
/// Maximum length of a configuration text, bytes.
const TEXT_MAX: u64 = 4 << 20;

/// Log files of a run in order; the named file itself; empty if there is none.
pub fn log_files(run: &Path) -> Vec<PathBuf> {
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

/// Opens a log; its attachments that are not in `texts` yet are appended there.
pub fn open_log(path: &Path, texts: &mut Vec<(String, String)>) -> io::Result<(File, Index)> {
    let mut file = File::open(path)?;
    let index = Index::read(&mut file, &mut |_, _| ())?;
    let names = [ROBOT, MODULES, SIM, WORLD, WALLS, OVERRIDES];
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

/// Configuration attached to a log, in the form of recorded inputs.
pub fn attached(texts: Vec<(String, String)>) -> Header {
    let (overrides, mut texts): (Vec<_>, Vec<_>) = texts.into_iter().partition(|(name, _)| name == OVERRIDES);
    let sets = overrides.iter().flat_map(|(_, text)| text.lines()).filter(|line| !line.trim().is_empty());
    texts.extend(sets.map(|line| (SET.into(), line.into())));
    Header { program: String::new(), module: String::new(), wanted: State::Run, texts }
}

/// Creates the folder of a run that begins now: `YYYY_MM_DD_HH_MM_SS`, in UTC. If that name is taken, that of the next
/// free second.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_runs_of_one_second_have_two_folders() {
        let folder = std::env::temp_dir().join(format!("advee-runs-{}", std::process::id()));
        let runs = [1, 1, 2].map(|second| make_run(&folder, second * 1_000_000_000).unwrap());
        let names = runs.map(|run| run.file_name().unwrap().to_string_lossy().into_owned());
        fs::remove_dir_all(&folder).unwrap();
        assert_eq!(names, ["1970_01_01_00_00_01", "1970_01_01_00_00_02", "1970_01_01_00_00_03"]);
    }
}
