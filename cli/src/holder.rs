//! Who has a device open, and which modules of a robot run on this machine.

use super::run::Run;
use super::{Cli, Command, Common};
use clap::Parser;
use robot::config::SIMULATOR;
use robot::place::RobotLocation;
use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

/// A process that has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Which.
    pub pid: u32,
    /// Module, if the process is one of ours.
    pub module: Option<String>,
    /// Name of the program.
    name: String,
}

impl Holder {
    /// For people: `driver_rs485a, process 123`.
    pub fn text(&self) -> String {
        format!("{}, process {}", self.module.as_ref().unwrap_or(&self.name), self.pid)
    }

    /// A module for tests.
    #[cfg(test)]
    pub fn test(module: &str, pid: u32) -> Self {
        Self { pid, module: Some(module.into()), name: module.into() }
    }
}

impl From<&Running> for Holder {
    fn from(Running { pid, module, .. }: &Running) -> Self {
        Self { pid: *pid, module: Some(module.clone()), name: module.clone() }
    }
}

/// A module that runs.
#[derive(Clone, Debug)]
pub struct Running {
    /// Process.
    pub pid: u32,
    /// Name.
    pub module: String,
    /// The robot that it is of.
    pub place: RobotLocation,
}

/// The process that has the device open, as far as `/proc` lets us see: none for a device that is not there.
pub fn holder(device: &Path) -> Option<Holder> {
    let device = fs::canonicalize(device).ok()?;
    let pid = others().find(|pid| has_open(*pid, &device))?;
    let name = fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    Some(Holder { pid, module: module_of(&command_line(pid)), name: name.trim().escape_debug().to_string() })
}

/// Running modules of any robot, as far as `/proc` shows them.
pub fn modules() -> impl Iterator<Item = Running> {
    others().filter_map(|pid| {
        let command = command_line(pid);
        let module = module_of(&command)?;
        let mut place = place_of(&command)?;
        // Paths in its arguments are relative to its working directory.
        let folder = fs::read_link(format!("/proc/{pid}/cwd")).unwrap_or_default();
        (place.config, place.run_dir) = (folder.join(place.config), folder.join(place.run_dir));
        Some(Running { pid, module, place })
    })
}

fn others() -> impl Iterator<Item = u32> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    pids.filter(|pid| *pid != std::process::id())
}

fn command_line(pid: u32) -> Vec<u8> {
    fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default()
}

fn has_open(pid: u32, device: &Path) -> bool {
    let files = fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
    files.filter_map(|file| fs::read_link(file.path()).ok()).any(|target| target == device)
}

/// The `MODULE` of `advee run MODULE …`, wherever its options are. Of an executable with other options it is known if
/// `run MODULE` come first.
fn module_of(command: &[u8]) -> Option<String> {
    let mut words = command.split(|byte| *byte == 0);
    if !words.next()?.ends_with(b"advee") {
        return None;
    }
    if let Some(Cli { command: Command::Up(up), .. }) = parsed(command) {
        // All modules are in this process.
        return up.is_paced().then(|| SIMULATOR.into());
    }
    let mut first = || words.next().filter(|word| *word == b"run").and(words.next());
    let module = match run_of(command) {
        Some((_, run)) => run.module,
        None => std::str::from_utf8(first()?).ok()?.into(),
    };
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
    (!module.is_empty() && module.chars().all(plain)).then_some(module)
}

/// Robot of a module, by its arguments.
fn place_of(command: &[u8]) -> Option<RobotLocation> {
    match parsed(command)? {
        Cli { common, command: Command::Run(run) } => Some(run.place(&common)),
        Cli { common, command: Command::Up(up) } if up.is_paced() => Some(up.place(&common)),
        _ => None,
    }
}

/// Options of `advee … run …`.
fn run_of(command: &[u8]) -> Option<(Common, Run)> {
    match parsed(command)? {
        Cli { common, command: Command::Run(run) } => Some((common, run)),
        _ => None,
    }
}

fn parsed(command: &[u8]) -> Option<Cli> {
    let words = command.strip_suffix(&[0]).unwrap_or(command).split(|byte| *byte == 0).map(OsStr::from_bytes);
    Cli::try_parse_from(words).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_module_is_known_by_how_it_was_started() {
        let module = |command: &str| module_of(command.replace(' ', "\0").as_bytes());
        assert_eq!(module("/opt/advee/bin/advee run driver_rs485a --state RUN"), Some("driver_rs485a".into()));
        // Options may come first.
        assert_eq!(module("advee --config /c run driver_canbus"), Some("driver_canbus".into()));
        assert_eq!(module("advee --set a.b=1 run --state STOP driver_canbus"), Some("driver_canbus".into()));
        assert_eq!(module("advee run driver_canbus --of-another-version"), Some("driver_canbus".into()));
        assert_eq!(module("advee --config run rs485 monitor"), None);
        assert_eq!(module("/usr/bin/minicom run driver_rs485a"), None);
        assert_eq!(module("advee rs485 monitor"), None);
        assert_eq!(module("advee run \u{1b}[2J"), None);
        assert_eq!(module(""), None);
    }

    #[test]
    fn the_robot_of_a_module_is_read_from_how_it_was_started() {
        let place = |command: &str| place_of(command.replace(' ', "\0").as_bytes());
        let command =
            "advee run driver_canbus --state RUN --config /c --run-dir /r --lcm-url memq:// --set a.b=1 --sim ";
        let told = place(command).unwrap();
        assert_eq!((told.config.as_path(), told.run_dir.as_path()), (Path::new("/c"), Path::new("/r")));
        assert_eq!(
            (told.lcm_url.as_str(), told.sets.as_slice(), told.sim),
            ("memq://", &["a.b=1".to_string()][..], true)
        );
        assert!(place("advee run driver_canbus --no-such").is_none() && place("advee up").is_none());
    }

    #[test]
    fn a_robot_in_virtual_time_is_one_process_and_counts_as_its_simulator() {
        let zeroed = |command: &str| command.replace(' ', "\0");
        let command = zeroed("advee up --sim --speed 20 --world corridor --run-dir /r");
        assert_eq!(module_of(command.as_bytes()), Some(SIMULATOR.into()));
        let place = place_of(command.as_bytes()).unwrap();
        assert_eq!((place.run_dir.as_path(), place.world.as_deref()), (Path::new("/r"), Some(Path::new("corridor"))));
        assert!(place.sim && module_of(zeroed("advee up --sim").as_bytes()).is_none());
    }

    #[test]
    fn a_file_that_nobody_else_has_is_free() {
        let file = std::env::temp_dir().join(format!("advee-holder-{}", std::process::id()));
        let open = fs::File::create(&file).unwrap();
        assert_eq!(holder(&file), None, "one's own does not count");
        drop(open);
        fs::remove_file(&file).unwrap();
        assert_eq!(holder(&file), None);
    }
}
