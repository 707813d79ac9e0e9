//! Every data sheet in the tree: driven as a drive by what it states and a few lines, or refused with object and
//! reason. The table of the results is the one in `docs/adding-a-drive.md`.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(clippy::disallowed_methods, reason = "a test reads the files of the tree")]

mod rig;

use base::Duration;
use canopen::axis::modes::Mode;
use canopen::axis::{Goal, PowerState};
use canopen::drives::derive::{Derived, Description, Limits, Quirks, Reason, Refusal, VelocityUnit, derive};
use canopen::eds::Eds;
use rig::{NODE, PERIOD, Rig};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A wheel: gear, its circumference in m, and what it does.
const GEAR: f64 = 20.0;
const PER_TURN: f64 = 0.5;
const LIMITS: Limits = Limits { velocity: 1.0, acceleration: 1.0, deceleration: 1.0, quick_stop: 2.0 };

fn description(mode: Mode) -> Description {
    Description {
        mode,
        per_turn: PER_TURN,
        gear: Some(GEAR),
        counts_per_turn: None,
        velocity_unit: None,
        limits: LIMITS,
        range: (mode != Mode::ProfileVelocity && mode != Mode::CyclicVelocity).then_some([-100.0, 100.0]),
        homing: None,
        sync: Some(PERIOD),
        setpoints: None,
        master: 127,
        torque: false,
        second_way: false,
        quirks: Quirks::default(),
    }
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn files() -> Vec<PathBuf> {
    let folders = ["buses/canopen/eds", "buses/canopen/eds/others", "advee/tests/it/canopen_peers"];
    let entries = folders.iter().flat_map(|folder| std::fs::read_dir(root().join(folder)).unwrap());
    let is_sheet = |path: &PathBuf| path.extension().is_some_and(|end| end == "eds" || end == "dcf");
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).filter(is_sheet).collect();
    files.sort_by_key(|path| path.file_name().unwrap().to_owned());
    files
}

fn sheet(name: &str) -> Eds {
    let path = files().into_iter().find(|path| path.ends_with(name)).unwrap();
    Eds::parse(&std::fs::read(path).unwrap()).unwrap()
}

/// Lines of the configuration beside the gear, the fewest first.
fn given(mode: Mode) -> [(&'static str, Description); 4] {
    let usual = description(mode);
    let unit = Some(VelocityUnit::Rpm);
    [
        ("", usual.clone()),
        ("`velocity_unit = \"rpm\"`", Description { velocity_unit: unit, ..usual.clone() }),
        ("`counts_per_turn`", Description { counts_per_turn: Some(4096), ..usual.clone() }),
        (
            "`velocity_unit = \"rpm\"`, `counts_per_turn`",
            Description { velocity_unit: unit, counts_per_turn: Some(4096), ..usual },
        ),
    ]
}

/// What must be given until units are known, and the result without and with a second way.
fn judged(eds: &Eds, mode: Mode) -> (&'static str, Result<Derived, Refusal>, Result<Derived, Refusal>) {
    let is_unit = |result: &Result<Derived, Refusal>| matches!(result, Err(Refusal { reason: Reason::NoUnit, .. }));
    let all = given(mode);
    let both = |(lines, description): &(&'static str, Description)| {
        let with = Description { second_way: true, ..description.clone() };
        (*lines, derive(eds, NODE, description), derive(eds, NODE, &with))
    };
    all.iter().map(both).find(|(_, first, _)| !is_unit(first)).unwrap_or_else(|| both(&all[0]))
}

#[track_caller]
fn near(found: f64, expected: f64) {
    assert!((found - expected).abs() <= 0.02 * expected.abs().max(0.1), "{found}, not {expected}");
}

/// Drives in velocity mode: both directions, a quick stop by its ramp, and a stop when the master is gone.
fn drive_velocity(eds: &Eds, derived: Derived) {
    let turns = GEAR / PER_TURN;
    let mut rig = Rig::new(eds, derived);
    rig.enable().unwrap();
    for target in [0.5, -0.5] {
        rig.target = target;
        rig.run(1500);
        near(rig.value, target);
        near(rig.speed(turns), target);
    }
    rig.target = 1.0;
    rig.run(2500);
    near(rig.value, 1.0);
    rig.go(Goal::QuickStop);
    rig.run(100);
    assert!(rig.speed(turns) > 0.75, "it does not stop at once, but by its ramp");
    rig.run(450);
    assert_eq!(rig.speed(turns), 0.0, "{:?}", rig.state());
    let kept = rig.derived.table.keeps_quick_stop;
    let stopped = if kept { PowerState::QuickStopActive } else { PowerState::SwitchOnDisabled };
    assert_eq!(rig.state(), Some(stopped));
    rig.go(Goal::Enabled);
    rig.run(1500);
    near(rig.value, 1.0);
    rig.alone = true;
    rig.run(900);
    assert_eq!(rig.twin.load.speed, 0.0, "the master is gone");
}

fn drive_position(eds: &Eds, derived: Derived) {
    let counts = derived.units.position(0.25);
    let mut rig = Rig::new(eds, derived);
    rig.enable().unwrap();
    rig.target = 0.25;
    rig.run(2500);
    near(rig.value, 0.25);
    assert_eq!(rig.twin.load.position.round() as i32, counts);
}

fn refused(refusal: Refusal) -> String {
    format!("refused: {refusal}")
}

fn row(file: &Path, eds: &Eds, mode: Mode) -> Option<String> {
    let (lines, without, with) = judged(eds, mode);
    let name = file.file_name().unwrap().to_str().unwrap();
    let cells = match (&without, &with) {
        (Err(Refusal { reason: Reason::Profile(_), .. }), _) if mode != Mode::ProfileVelocity => return None,
        (Ok(_), _) => ["driven".into(), String::new()],
        (Err(one), Ok(derived)) => {
            let lacking: Vec<_> = derived.reservations.iter().map(|lack| format!("0x{:04X}", lack.index)).collect();
            [refused(*one), format!("driven, without {}", lacking.join(", "))]
        }
        (Err(one), Err(_)) => [refused(*one), "the same".into()],
    };
    let lines = if lines.is_empty() { "none" } else { lines };
    let row = format!("| {name} | {mode} | {lines} | {} | {} |", cells[0], cells[1]);
    for derived in [without, with].into_iter().flatten() {
        match mode {
            Mode::ProfileVelocity => drive_velocity(eds, derived),
            _ => drive_position(eds, derived),
        }
    }
    Some(row)
}

#[test]
fn every_sheet_is_driven_or_refused_as_the_guide_says() {
    let mut table = String::new();
    let mut drives = 0;
    for file in files() {
        let eds = Eds::parse(&std::fs::read(&file).unwrap()).unwrap();
        let rows = [Mode::ProfileVelocity, Mode::ProfilePosition].map(|mode| row(&file, &eds, mode));
        drives += usize::from(rows.iter().flatten().any(|row| row.contains("driven")));
        rows.iter().flatten().for_each(|row| writeln!(table, "{row}").unwrap());
    }
    assert!(drives >= 4, "{table}");
    let guide = std::fs::read_to_string(root().join("docs/adding-a-drive.md")).unwrap();
    assert!(guide.contains(&table), "docs/adding-a-drive.md has another table than this one:\n{table}");
}

#[test]
fn a_drive_is_driven_at_sync_too() {
    let eds = sheet("maxon_epos4_50_15_node1.dcf");
    for mode in [Mode::CyclicVelocity, Mode::CyclicPosition] {
        let description = Description { counts_per_turn: Some(4096), ..description(mode) };
        let derived = derive(&eds, NODE, &description).unwrap();
        assert!(derived.table.node_config("drive", &derived.parameters).mappings.iter().all(|pdo| pdo.kind == 1));
        let mut rig = Rig::new(&eds, derived);
        rig.enable().unwrap();
        for step in 1..=100 {
            rig.target = 0.0025 * f64::from(step);
            rig.run(10);
        }
        rig.run(50);
        near(rig.value, 0.25);
        let none = derive(&eds, NODE, &Description { sync: None, ..description });
        assert_eq!(none.unwrap_err().reason, Reason::NoSync);
    }
}

/// A drive without heartbeats of either kind is guarded, and stops when the requests end.
#[test]
fn a_drive_without_heartbeats_is_guarded() {
    let path = root().join("buses/canopen/eds/icla_sim.eds");
    let text = std::fs::read_to_string(path).unwrap();
    let without: String = ["1016", "1016sub0", "1016sub1", "1016sub2", "1017"].iter().fold(text, |text, section| {
        let begin = text.find(&format!("[{section}]")).unwrap();
        let end = text[begin + 1..].find("\n[").unwrap() + begin + 2;
        text[..begin].to_string() + &text[end..]
    });
    let eds = Eds::parse(without.as_bytes()).unwrap();
    let description = Description { velocity_unit: Some(VelocityUnit::Rpm), ..description(Mode::ProfileVelocity) };
    let description =
        Description { counts_per_turn: Some(4096), ..Description { mode: Mode::ProfilePosition, ..description } };
    let derived = derive(&eds, NODE, &description).unwrap();
    let node = derived.table.node_config("drive", &derived.parameters);
    assert_eq!((node.master_limit, node.guarding.map(|g| g.period)), (None, Some(Duration::from_millis(50))));
    let mut rig = Rig::new(&eds, derived);
    rig.enable().unwrap();
    rig.target = 5.0;
    rig.run(2000);
    near(rig.speed(GEAR / PER_TURN), 1.0);
    rig.alone = true;
    rig.run(800);
    assert_eq!(rig.twin.load.speed, 0.0);
}
