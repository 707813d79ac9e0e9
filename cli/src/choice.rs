//! Choice of a bus, and of who is on it, by a name of the configuration.

use crate::Failed;

/// Bus that `--bus` names, with or without its kind (`can.main`, `main`); without it the only one of the configuration.
/// `other` is the option that takes a bus outside the configuration.
pub fn bus<'a, B>(
    kind: &str,
    wanted: Option<&str>,
    buses: &'a [B],
    name: impl Fn(&B) -> &str,
    other: &str,
) -> Result<&'a B, Failed> {
    let names = buses.iter().map(&name).collect::<Vec<_>>().join(", ");
    let Some(wanted) = wanted else {
        return match buses {
            [bus] => Ok(bus),
            [] => Err(format!("robot.toml has no table [{kind}.<bus>]; name a bus with {other}").into()),
            _ => Err(format!("which bus? --bus with one of {names}, or {other}").into()),
        };
    };
    let wanted = wanted.strip_prefix(kind).and_then(|rest| rest.strip_prefix('.')).unwrap_or(wanted);
    let found = buses.iter().find(|bus| name(bus) == wanted);
    found.ok_or_else(|| format!("robot.toml has no bus [{kind}.{wanted}]; it has {names}").into())
}

/// End of a sentence about what was expected: `, or one of fan1 (0x18), …`; empty without names.
pub fn or_one_of(names: impl Iterator<Item = String>) -> String {
    let names: Vec<String> = names.collect();
    if names.is_empty() { String::new() } else { format!(", or one of {}", names.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen<'a>(wanted: Option<&str>, buses: &[&'a str]) -> Result<&'a str, String> {
        bus("can", wanted, buses, |bus| bus, "--interface").copied().map_err(|failed| failed.why)
    }

    #[test]
    fn a_bus_is_found_with_or_without_its_kind_and_a_single_one_without_a_name() {
        assert_eq!(chosen(Some("can.rear"), &["main", "rear"]).as_deref(), Ok("rear"));
        assert_eq!(chosen(Some("rear"), &["main", "rear"]).as_deref(), Ok("rear"));
        assert_eq!(chosen(None, &["main"]).as_deref(), Ok("main"));
    }

    #[test]
    fn an_unknown_bus_is_answered_with_those_of_the_configuration() {
        let why = |wanted, buses: &[&str]| chosen(wanted, buses).unwrap_err();
        assert_eq!(why(Some("b"), &["main", "rear"]), "robot.toml has no bus [can.b]; it has main, rear");
        assert_eq!(why(None, &["main", "rear"]), "which bus? --bus with one of main, rear, or --interface");
        assert_eq!(why(None, &[]), "robot.toml has no table [can.<bus>]; name a bus with --interface");
    }
}
