//! A scenario of the soak, and the list of what once failed; their keys are described in `docs/soak.md`.

use settings::{ConfigError, Node, read, read_as};
use sim::soak::{Regression, Regressions, Scenario};
use std::path::Path;

/// Reads a scenario; the operator drives the robot that he is given.
///
/// # Errors
/// A line for each thing that is wrong.
pub fn scenario(path: &Path) -> Result<Scenario, ConfigError> {
    read_as(&read(path)?)
}

/// The scenario that the executable brings along: `scenarios/default.toml` as it was built.
///
/// # Errors
/// As [`scenario`].
pub fn built_in_scenario() -> Result<Scenario, ConfigError> {
    const TEXT: &str = include_str!("../../../scenarios/default.toml");
    let node = Node::parse(Path::new("scenarios/default.toml"), TEXT).map_err(ConfigError)?;
    read_as(&node)
}

/// Reads what once failed.
///
/// # Errors
/// A line for each thing that is wrong.
pub fn regressions(path: &Path) -> Result<Vec<Regression>, ConfigError> {
    read_as(&read(path)?).map(|file: Regressions| file.regressions)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Scenario, String> {
        let node = Node::parse(Path::new("s.toml"), text).map_err(|lines| lines.join("\n"))?;
        read_as(&node).map_err(|error| error.to_string())
    }

    #[test]
    fn the_executable_brings_the_shipped_scenario_along() {
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/default.toml");
        assert_eq!(built_in_scenario(), scenario(&shipped));
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
