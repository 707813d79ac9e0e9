//! A scenario of the soak, and the list of what once failed; their keys stand in `docs/soak.md`.

use base::Duration;
use settings::{ConfigError, read};
use settings::{Node, Value};
use settings::{Problems, Table};
use sim::soak::{Behaviour, Fault, Kind, Scenario};
use std::path::Path;

/// A day, s.
const DAY: f64 = 86_400.0;

/// An episode that once failed.
#[derive(Clone, Debug, PartialEq)]
pub struct Regression {
    /// What was wrong, in words.
    pub cause: String,
    /// The seed of the soak.
    pub seed: u64,
    /// The number of the episode.
    pub episode: u64,
    /// The world.
    pub world: String,
    /// The faults that it took.
    pub faults: Vec<Fault>,
}

/// Reads a scenario; the operator drives the robot that he is given.
pub fn scenario(path: &Path) -> Result<Scenario, ConfigError> {
    let node = read(path)?;
    let problems = Problems::default();
    let scenario = Table::new(&node, "", &problems).map(take);
    done(scenario, &problems)
}

/// Reads what once failed.
pub fn regressions(path: &Path) -> Result<Vec<Regression>, ConfigError> {
    let node = read(path)?;
    let problems = Problems::default();
    let regressions = Table::new(&node, "", &problems).map(|mut root| {
        let regressions = root.tables("regressions").into_iter().map(regression).collect();
        root.end();
        regressions
    });
    done(regressions, &problems)
}

fn done<T>(value: Option<T>, problems: &Problems) -> Result<T, ConfigError> {
    match (value, problems.lines()) {
        (Some(value), lines) if lines.is_empty() => Ok(value),
        (_, lines) => Err(ConfigError(lines)),
    }
}

fn take(mut root: Table<'_>) -> Scenario {
    let usual = Scenario::default();
    let time = |root: &mut Table<'_>, key, usual: Duration, least| {
        seconds(root.number(key, Some(usual.as_secs_f64()), least..=DAY))
    };
    let scenario = Scenario {
        settle: time(&mut root, "settle_s", usual.settle, 0.0),
        chaos: time(&mut root, "chaos_s", usual.chaos, 1.0),
        calm: time(&mut root, "calm_s", usual.calm, 1.0),
        turns: root.integer("turns", Some(usual.turns), 1..=10_000),
        restart_delay_max: time(&mut root, "restart_delay_max_s", usual.restart_delay_max, 0.1),
        moves_within: time(&mut root, "moves_within_s", usual.moves_within, 1.0),
        lcm_jitter: seconds(root.number("lcm_jitter_s", Some(usual.lcm_jitter.as_secs_f64()), 0.0..=0.1)),
        lcm_loss: root.number("lcm_loss", Some(usual.lcm_loss), 0.0..=1.0),
        operator: root.table_if_any("operator").map_or(usual.operator, operator),
        kinds: root.named_tables("faults").into_iter().map(|(name, table)| kind(name, table)).collect(),
    };
    root.end();
    scenario
}

fn seconds(seconds: f64) -> Duration {
    Duration::from_secs_f64(seconds)
}

fn operator(mut table: Table<'_>) -> Behaviour {
    let usual = Behaviour::default();
    let behaviour = Behaviour {
        speed: table.number("speed_mps", Some(usual.speed), 0.1..=10.0),
        steering: table.number("steering_rad", Some(usual.steering), 0.1..=1.5),
        clearance: table.number("clearance_m", Some(usual.clearance), 0.0..=100.0),
        leg: range(&mut table, "leg_s", Some(usual.leg), 0.1..=DAY),
        silence: table.number("silence", Some(usual.silence), 0.0..=1.0),
        zero: table.number("zero", Some(usual.zero), 0.0..=1.0),
        ..usual
    };
    table.end();
    behaviour
}

fn kind(name: String, mut table: Table<'_>) -> Kind {
    let targets = table.texts("targets");
    if targets.is_empty() {
        table.refuse_missing("targets", "a list of modules, buses, boards, drives, \"lcm\" or \"clock\"");
    }
    let kind = Kind {
        name,
        targets,
        fault: table.text("fault", None),
        per_hour: table.number("per_hour", None, 0.0..=3600.0),
        value: range(&mut table, "value", Some((0.0, 0.0)), -1e9..=1e9),
        lasts: range(&mut table, "lasts_s", Some((0.0, 0.0)), 0.0..=DAY),
    };
    table.end();
    kind
}

/// One number, or the least and the greatest.
fn range(
    table: &mut Table<'_>,
    key: &'static str,
    usual: Option<(f64, f64)>,
    within: std::ops::RangeInclusive<f64>,
) -> (f64, f64) {
    let number = |node: &Node| match node.value {
        Value::Integer(value) => Some(value as f64),
        Value::Float(value) => Some(value),
        _ => None,
    };
    let found = match table.node(key) {
        None => usual,
        Some(Node { value: Value::Array(items), .. }) => match &items[..] {
            [least, most] => number(least).zip(number(most)),
            _ => None,
        },
        Some(node) => number(node).map(|value| (value, value)),
    };
    let good = |(least, most): &(f64, f64)| within.contains(least) && within.contains(most) && least <= most;
    found.filter(good).unwrap_or_else(|| {
        let (least, most) = (within.start(), within.end());
        table.refuse(key, format_args!("a number from {least} to {most}, or a list of two, the lesser first"));
        (*least, *least)
    })
}

fn regression(mut table: Table<'_>) -> Regression {
    let regression = Regression {
        cause: table.text("cause", None),
        seed: table.integer("seed", None, 0..=u64::MAX),
        episode: table.integer("episode", None, 0..=u64::MAX),
        world: table.text("world", Some("hall")),
        faults: table.tables("faults").into_iter().map(fault).collect(),
    };
    table.end();
    regression
}

fn fault(mut table: Table<'_>) -> Fault {
    let fault = Fault {
        at: seconds(table.number("at_s", None, 0.0..=DAY)),
        kind: table.text("kind", Some("regression")),
        target: table.text("target", None),
        fault: table.text("fault", None),
        value: table.number("value", Some(0.0), -1e9..=1e9),
        lasts: table.number("lasts_s", Some(0.0), 0.0..=DAY),
    };
    table.end();
    fault
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Scenario, String> {
        let problems = Problems::default();
        let node = Node::parse(Path::new("s.toml"), text).map_err(|lines| lines.join("\n"))?;
        let scenario = Table::new(&node, "", &problems).map(take);
        done(scenario, &problems).map_err(|error| error.to_string())
    }

    #[test]
    fn an_empty_scenario_is_the_usual_one() {
        assert_eq!(parse(""), Ok(Scenario::default()));
    }

    #[test]
    fn what_is_wrong_is_told_with_file_line_and_what_is_allowed() {
        let wrong = "chaos_s = 0\nfoo = 1\n[faults.x]\nfault = \"hang\"\nper_hour = 1\nlasts_s = [2, 1]";
        let why = parse(wrong).unwrap_err();
        let lines: Vec<&str> = why.lines().collect();
        assert_eq!(lines[0], "s.toml:1: chaos_s = 0: expected a number from 1 to 86400");
        assert!(lines[1].starts_with("s.toml:2: foo: unknown key, expected one of settle_s, "), "{why}");
        assert!(lines[2].starts_with("s.toml:3: faults.x.targets: missing, expected a list of modules"), "{why}");
        let range =
            "faults.x.lasts_s = [2 items]: expected a number from 0 to 86400, or a list of two, the lesser first";
        assert_eq!(lines[3], format!("s.toml:6: {range}"));
    }

    #[test]
    fn the_shipped_files_are_good() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios");
        let scenario = scenario(&folder.join("default.toml")).unwrap();
        assert!(scenario.kinds.len() > 20);
        regressions(&folder.join("regressions.toml")).unwrap();
    }
}
