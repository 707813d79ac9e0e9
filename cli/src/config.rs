//! `advee config …`: checks a configuration folder, lists its keys, gives keys that have moved their new names.

use crate::{Common, Failed, Outcome, print};
use clap::{Args, Subcommand};
use drivers::canbus::table::DriveFile;
use robot::config::{self, Config, Modules, Robot};
use robot::place::RobotLocation;
use robot::preflight;
use settings::{Need, Row, Rows};
use sim::soak::Scenario;
use simulator::world::World;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Subcommand)]
pub enum Command {
    /// Check a configuration folder, for the robot and for the simulated one
    Check(Check),
    /// List all keys: type, unit, default, range, meaning
    Keys(Keys),
    /// Show the new names of keys that have moved, as a diff, or write them
    Migrate(Migrate),
}

#[derive(Args)]
pub struct Check {
    /// Configuration folder [default: that of --config]
    dir: Option<PathBuf>,
    /// The world of the simulated robot, as that of advee up: a file, or a name in the folder worlds [default: hall]
    #[arg(long, value_name = "FILE")]
    world: Option<PathBuf>,
}

#[derive(Args)]
pub struct Keys {
    /// As the page docs/configuration.md
    #[arg(long)]
    markdown: bool,
}

#[derive(Args)]
pub struct Migrate {
    /// Configuration folder [default: that of --config]
    dir: Option<PathBuf>,
    /// Write the files
    #[arg(long)]
    write: bool,
}

pub fn config(common: &Common, command: &Command) -> Outcome {
    let dir = |dir: &Option<PathBuf>| dir.clone().unwrap_or_else(|| common.config_dir());
    match command {
        Command::Check(command) => check(common, &dir(&command.dir), command.world.as_deref()),
        Command::Keys(Keys { markdown: true }) => print(page().trim_end()),
        Command::Keys(_) => print(list().trim_end()),
        Command::Migrate(command) => migrate(&dir(&command.dir), command.write),
    }?;
    Ok(ExitCode::SUCCESS)
}

fn check(common: &Common, dir: &Path, world: Option<&Path>) -> Result<(), Failed> {
    let simulated = dir.join("sim.toml").exists();
    let sides: &[bool] = if simulated { &[false, true] } else { &[false] };
    // Those of the simulated robot, which comes last, have those of the robot among them.
    let mut notices = Vec::new();
    let mut remarks = Vec::new();
    let mut sheets = Vec::new();
    for sim in sides {
        let config;
        (config, notices) = Config::load_with_notices(dir, *sim, &common.sets)?;
        remarks = config.robot.remarks();
        let place = RobotLocation { config: dir.into(), world: world.map(Into::into), ..common.place(*sim) };
        let world = if *sim { config::world(dir, world, &common.sets)? } else { World::default() };
        preflight::check_live(&place, &config, &world)?;
        sheets = preflight::remarks(&place, &config);
    }
    let file = dir.join("robot.toml");
    notices.extend(remarks.iter().map(|remark| format!("{}: {remark}", file.display())));
    notices.extend(sheets);
    crate::notice(&notices);
    let of = if simulated { "the robot and the simulated robot" } else { "the robot" };
    print(format_args!("{}: good, for {of}", dir.display()))
}

fn migrate(dir: &Path, write: bool) -> Result<(), Failed> {
    let named = |path: &Path, error: std::io::Error| Failed::from(format!("{}: {error}", path.display()));
    let files = config::FILES.map(|name| dir.join(name));
    let mut changes = Vec::new();
    // All are read before one is written.
    for path in files.iter().filter(|path| path.exists()) {
        let old = fs::read_to_string(path).map_err(|error| named(path, error))?;
        let new = config::migrated(path, &old)?;
        if new != old {
            changes.push((path, old, new));
        }
    }
    if changes.is_empty() {
        return print(format_args!("{}: no key has moved", dir.display()));
    }
    for (path, old, new) in &changes {
        print(diff(path, old, new).trim_end())?;
    }
    if !write {
        return print("nothing is written: --write does that");
    }
    for (path, _, new) in &changes {
        // A reader sees the old file or the new one.
        let beside = path.with_extension("toml.new");
        fs::write(&beside, new).and_then(|()| fs::rename(&beside, path)).map_err(|error| named(path, error))?;
    }
    print(format_args!("{} files are written", changes.len()))
}

/// Lines around a change.
const CONTEXT: usize = 3;

/// A unified diff of two texts with the same number of lines.
fn diff(path: &Path, old: &str, new: &str) -> String {
    let (old, new): (Vec<&str>, Vec<&str>) = (old.lines().collect(), new.lines().collect());
    let changed: Vec<usize> = (0..old.len().min(new.len())).filter(|n| old[*n] != new[*n]).collect();
    let mut text = format!("--- {0}\n+++ {0}\n", path.display());
    for hunk in changed.chunk_by(|one, next| next - one <= 2 * CONTEXT + 1) {
        let (from, to) = (hunk[0].saturating_sub(CONTEXT), (hunk[hunk.len() - 1] + CONTEXT + 1).min(old.len()));
        // Writing to a string does not fail.
        let _ = writeln!(text, "@@ -{0},{1} +{0},{1} @@", from + 1, to - from);
        for run in (from..to).collect::<Vec<_>>().chunk_by(|one, next| hunk.contains(one) == hunk.contains(next)) {
            let lines = |sign: char, of: &[&str]| run.iter().map(|n| format!("{sign}{}\n", of[*n])).collect::<String>();
            match hunk.contains(&run[0]) {
                true => text += &(lines('-', &old) + &lines('+', &new)),
                false => text += &lines(' ', &old),
            }
        }
    }
    text
}

/// The files with their keys.
fn files() -> [(&'static str, &'static str, Vec<Row>); 5] {
    const ROBOT: &str = "What the robot is made of. SI units; angles in radians, counter-clockwise. The robot's frame \
        has its origin on the floor under the middle of the rear axle, x forward, y to the left. In simulation \
        `sim.toml` is laid over it, key by key, then every `--set table.key=value`.";
    const MODULES: &str = "The modules that the watchdog starts, in this order; the simulator with `--sim` only. \
        `--set modules.NAME.key=value` overrides a key.";
    const DRIVE: &str = "A drive as a file of the folder `drives` beside `robot.toml`, `drives/NAME.toml`, for nodes \
        with `driver = \"NAME\"` ([adding-a-drive.md](adding-a-drive.md)). A file with the name of a built-in table, \
        `epos` or `icla`, is used in its place.";
    const WORLD: &str = "A [world](../conf/worlds/README.md) for the simulated robot. Metres and radians; x to the \
        right, y up, angles counter-clockwise. `--set world.key=value` overrides a key.";
    const SCENARIO: &str = "A scenario of the [soak](soak.md).";
    [
        ("robot.toml", ROBOT, Rows::of::<Robot>()),
        ("modules.toml", MODULES, Rows::of::<Modules>()),
        ("drives", DRIVE, common(Rows::of::<DriveFile>())),
        ("worlds", WORLD, Rows::of::<World>()),
        ("scenarios", SCENARIO, Rows::of::<Scenario>()),
    ]
}

/// Rows of a choice, where a key that all its tables have alike is one row.
fn common(rows: Vec<Row>) -> Vec<Row> {
    let mut common: Vec<Row> = Vec::new();
    for row in rows {
        let alike = |other: &&mut Row| Row { only: row.only, ..(**other).clone() } == row;
        match common.iter_mut().find(alike) {
            Some(other) => other.only = "",
            None => common.push(row),
        }
    }
    common
}

/// `docs/configuration.md`.
fn page() -> String {
    let mut page = String::from(
        "# Configuration\n\n\
         <!-- Generated: advee config keys --markdown > docs/configuration.md -->\n\n\
         All keys of a configuration folder; [conf/advee](../conf/advee/) is that of the reference robot. Every key \
         is checked: what is unknown or out of range is refused with file and line, and nothing starts. `advee \
         config check` does that without a robot, `advee config keys` prints this list. A renamed key is read under \
         its old name, too, with a notice; `advee config migrate` shows the new names as a diff, and with `--write` \
         writes them.\n",
    );
    for (file, about, rows) in files() {
        // Writing to a string does not fail.
        let _ = write!(page, "\n## {file}\n\n{about}\n{}", settings::markdown(&rows));
    }
    page.lines().map(wrapped).collect()
}

/// Columns of a page.
const COLUMNS: usize = 120;

/// A line of prose, broken between words; rows of tables stay.
fn wrapped(line: &str) -> String {
    let (mut text, mut column) = (String::new(), 0);
    for word in line.split(' ') {
        let length = word.chars().count();
        let end = match column {
            0 => "",
            _ if !line.starts_with('|') && column + 1 + length > COLUMNS => {
                column = 0;
                "\n"
            }
            _ => " ",
        };
        column += end.trim_matches('\n').len() + length;
        text += end;
        text += word;
    }
    text + "\n"
}

/// The same as a list for a terminal.
fn list() -> String {
    let mut text = String::new();
    for (file, _, rows) in files() {
        for row in rows {
            let unit = if row.unit().is_empty() { String::new() } else { format!(" {}", row.unit()) };
            let need = match &row.need {
                Need::Required => "required".into(),
                Need::Optional => "may be left out".into(),
                Need::Derived => "follows from other keys".into(),
                Need::Default(value) => format!("default {value}"),
            };
            let only = if row.only.is_empty() { String::new() } else { format!(" ({})", row.only) };
            let was = row.was.map(|was| format!("; was {was}")).unwrap_or_default();
            // Writing to a string does not fail.
            let _ =
                writeln!(text, "{file} {}{only}: {}{unit}; {need}{was}\n    {}", row.name(), row.expected, row.about);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_of_the_keys_is_that_of_the_declarations() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/configuration.md");
        let written = fs::read_to_string(path).unwrap_or_default();
        assert!(written == page(), "make it again: advee config keys --markdown > docs/configuration.md");
    }

    #[test]
    fn every_key_has_a_row_with_its_range_and_its_default() {
        let list = list();
        let row = "robot.toml limits.command_ttl_s: a number from 0.05 to 1 s; default 0.25";
        assert!(list.lines().any(|line| line == row), "{list}");
        let row = "robot.toml rs485.<name>.nodes[].rate_hz: a number from 0.1 to 100 Hz; required; was rate";
        assert!(list.lines().any(|line| line == row), "{list}");
        assert!(list.contains("modules.toml modules[].nice: an integer from -20 to 19; default 0\n"), "{list}");
    }

    #[test]
    fn a_key_of_both_forms_of_a_drive_is_one_row() {
        let rows = common(Rows::of::<DriveFile>());
        let only = |name: &str| rows.iter().filter(|row| row.name() == name).map(|row| row.only).collect::<Vec<_>>();
        assert_eq!(only("identity[].mask"), [""]);
        assert_eq!((only("rpdo.map"), only("current_object")), (vec!["objects"], vec!["sheet"]));
        assert_eq!(only("form"), [""]);
    }

    #[test]
    fn a_diff_has_hunks_with_three_lines_around_each_change() {
        let old = "a\nb\nc\nd\ne\nf\ng\nh\ni\nj\nk\nl\nm\nn\n";
        let new = old.replace("b\n", "B\n").replace("e\nf\n", "E\nF\n").replace("n\n", "N\n");
        let hunks =
            "@@ -1,9 +1,9 @@\n a\n-b\n+B\n c\n d\n-e\n-f\n+E\n+F\n g\n h\n i\n@@ -11,4 +11,4 @@\n k\n l\n m\n-n\n+N\n";
        assert_eq!(diff(Path::new("f"), old, &new), format!("--- f\n+++ f\n{hunks}"));
    }
}
