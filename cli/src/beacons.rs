//! `advee beacons [ID|all [on|off]]`: shows what the estimator makes of each beacon, excludes one or permits it again.

use super::bus::{Heard, Tool};
use super::{Common, Failed, Outcome, print};
use base::Duration;
use diagnostics::{BeaconState, normalized_residual, orders};
use host::clock;
use messages::middlelevel::{BeaconUse, DataBeaconUse};
use messages::{Channel, Message};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Beacons {
    /// Number of a beacon, or `all`
    #[arg(value_name = "ID|all", value_parser = which)]
    beacon: Option<Which>,
    /// `off` excludes it from the estimate until `on`, or until the estimator is restarted
    #[arg(value_parser = ["on", "off"], requires = "beacon", conflicts_with = "json")]
    action: Option<String>,
    /// A JSON object
    #[arg(long)]
    json: bool,
}

/// A beacon, or all of them.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Which {
    One(i32),
    All,
}

/// The estimator publishes once a second, and at once after a command.
const HEARD: Duration = Duration::from_millis(2500);

fn which(text: &str) -> Result<Which, String> {
    match text.parse::<i32>() {
        Ok(id) if id >= 0 => Ok(Which::One(id)),
        _ if text == "all" => Ok(Which::All),
        _ => Err("expected the number of a beacon, or all".into()),
    }
}

impl Which {
    fn is(self, beacon: &BeaconUse) -> bool {
        self == Self::All || self == Self::One(beacon.id)
    }

    fn id(self) -> Option<i32> {
        match self {
            Self::One(id) => Some(id),
            Self::All => None,
        }
    }
}

pub fn beacons(common: &Common, command: &Beacons) -> Outcome {
    let mut tool = Tool::join(common, "beacons", &[Channel::MlDataBeaconUse])?;
    let Some(first) = heard(&mut tool)? else {
        let url = common.lcm_url();
        return Err(format!("ML_DATA_BEACON_USE is not heard on {url}; is the estimator in RUN, with a map?").into());
    };
    let beacon = command.beacon.unwrap_or(Which::All);
    if !first.beacons.iter().any(|there| beacon.is(there)) {
        let ids: Vec<String> = first.beacons.iter().map(|there| there.id.to_string()).collect();
        return Err(format!("beacons of the map are {}", ids.join(", ")).into());
    }
    match command.action.as_deref() {
        Some(action) => order(&mut tool, first, beacon, action == "on"),
        None => show(first, beacon, command.json),
    }
}

/// The next report, if one arrives in time.
fn heard(tool: &mut Tool) -> Result<Option<DataBeaconUse>, Failed> {
    let until = clock::now() + HEARD;
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::MlDataBeaconUse(uses)) => return Ok(Some(uses)),
            Heard::Message(_) => {}
            Heard::Nothing => return Ok(None),
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
}

fn order(tool: &mut Tool, first: DataBeaconUse, beacon: Which, permitted: bool) -> Outcome {
    let is_so =
        |uses: &DataBeaconUse| uses.beacons.iter().all(|there| !beacon.is(there) || there.permitted == permitted);
    let mut last = first;
    if !is_so(&last) {
        tool.publish(orders::beacon(tool.timestamp(), beacon.id(), permitted))?;
        // The first report may have been sent before the command arrived.
        for _ in 0..2 {
            let Some(uses) = heard(tool)? else { break };
            last = uses;
            if is_so(&last) {
                break;
            }
        }
    }
    if !is_so(&last) {
        return Err("the estimator does not obey: see its errors, and commands of [bus] in robot.toml".into());
    }
    show(last, beacon, false)
}

fn show(mut uses: DataBeaconUse, beacon: Which, json: bool) -> Outcome {
    uses.beacons.retain(|there| beacon.is(there));
    if json {
        print(serde_json::to_string(&uses).map_err(|error| error.to_string())?)?;
        return Ok(ExitCode::SUCCESS);
    }
    print("BEACON       X m      Y m  STATE         RESIDUAL °  DEVIATION °  RATIO  ACCEPTED  REFUSED  LAST")?;
    for beacon in &uses.beacons {
        print(line(beacon, uses.timestamp))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// A row: `-` for what there is not.
fn line(beacon: &BeaconUse, timestamp: i64) -> String {
    let degrees = |value: f64| if value.is_finite() { format!("{:.2}", value.to_degrees()) } else { "-".into() };
    let ratio = normalized_residual(beacon).map_or_else(|| "-".into(), |ratio| format!("{ratio:.1}"));
    let age = timestamp.saturating_sub(beacon.last).max(0) as f64 * 1e-6;
    format!(
        "{:>6} {:>9.2} {:>8.2}  {:<12} {:>11} {:>12} {:>6} {:>9} {:>8}  {}",
        beacon.id,
        beacon.x,
        beacon.y,
        BeaconState::of(beacon, timestamp).name(),
        degrees(beacon.residual),
        degrees(beacon.deviation),
        ratio,
        beacon.accepted,
        beacon.refused,
        if beacon.last > 0 { format!("{age:.1} s ago") } else { "never".into() },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_beacon_is_a_line_with_its_residual_in_degrees() {
        let seen = BeaconUse {
            id: 3,
            x: 19.9,
            y: 11.9,
            active: true,
            permitted: true,
            last: 8_500_000,
            residual: -0.01,
            deviation: 0.02,
            fits: true,
            accepted: 120,
            refused: 2,
        };
        let words =
            |beacon: &BeaconUse| line(beacon, 10_000_000).split_whitespace().map(String::from).collect::<Vec<_>>();
        assert_eq!(
            words(&seen),
            ["3", "19.90", "11.90", "used", "-0.57", "1.15", "-0.5", "120", "2", "1.5", "s", "ago"]
        );
        let (residual, deviation) = (f64::NAN, f64::NAN);
        let unseen = BeaconUse { permitted: false, last: 0, residual, deviation, ..seen };
        assert_eq!(words(&unseen)[3..], ["excluded", "-", "-", "-", "120", "2", "never"]);
    }

    #[test]
    fn a_beacon_is_named_by_its_number_or_all_of_them() {
        assert_eq!([which("0"), which("255"), which("all")], [Ok(Which::One(0)), Ok(Which::One(255)), Ok(Which::All)]);
        for wrong in ["-1", "", "ALL", "1.5", "99999999999"] {
            assert!(which(wrong).is_err(), "{wrong}");
        }
        let parse = |line: &str| crate::command().try_get_matches_from(line.split(' ')).map(drop);
        for line in
            ["advee beacons", "advee beacons 3", "advee beacons 3 off", "advee beacons all on", "advee beacons --json"]
        {
            assert!(parse(line).is_ok(), "{line}");
        }
        for line in ["advee beacons off", "advee beacons 3 away", "advee beacons 3 off --json"] {
            assert!(parse(line).is_err(), "{line}");
        }
    }
}
