//! `advee imu monitor`: what the inertial measurement units measure, a line each second for each of them.

use super::bus::{Heard, Tool};
use super::{Common, Outcome, print, seconds};
use base::{Duration, Instant};
use host::clock;
use messages::lowlevel::DataImu;
use messages::{Channel, Message};
use serde::Serialize;
use std::collections::BTreeMap;
use std::process::ExitCode;

#[derive(clap::Subcommand)]
pub enum Imu {
    /// Show what the inertial measurement units measure, each second, until Ctrl-C
    Monitor(Monitor),
}

#[derive(clap::Args)]
pub struct Monitor {
    /// Name of a unit
    name: Option<String>,
    /// End after this time, s
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
    /// A JSON object a line
    #[arg(long)]
    json: bool,
}

/// Time limit for the first measurement.
const HEARD: Duration = Duration::from_secs(5);
const PERIOD: Duration = Duration::from_secs(1);

pub fn imu(common: &Common, command: &Imu) -> Outcome {
    let Imu::Monitor(command) = command;
    let mut tool = Tool::join(common, "imu", &[Channel::LlDataImu])?;
    let begin = clock::now();
    let end = command.time.map_or(Instant::NEVER, |time| begin + time);
    let mut seen: BTreeMap<String, Seen> = BTreeMap::new();
    let (mut next, mut is_first) = (begin + PERIOD, true);
    loop {
        match tool.hear(next.min(end))? {
            Heard::Message(Message::LlDataImu(imu)) => {
                if command.name.as_ref().is_none_or(|name| *name == imu.name) {
                    seen.entry(imu.name.clone()).or_default().add(&imu);
                }
                continue;
            }
            Heard::Message(_) => continue,
            Heard::Interrupt => return Ok(ExitCode::SUCCESS),
            Heard::Nothing => {}
        }
        let now = clock::now();
        if seen.is_empty() && now >= begin + HEARD.min(end.since(begin)) {
            let whose = command.name.as_ref().map_or_else(String::new, |name| format!(" of {name}"));
            let url = common.lcm_url();
            return Err(format!("no LL_DATA_IMU{whose} is heard on {url}; is advee up, and [imu] configured?").into());
        }
        if next <= now || end <= now {
            if !seen.is_empty() && std::mem::take(&mut is_first) && !command.json {
                print("IMU              STATUS        HZ  ROTATION °/s            ACCELERATION m/s²       YAW °   °C")?;
            }
            for (name, seen) in &mut seen {
                let row = Row::of(name, &std::mem::take(seen));
                match command.json {
                    true => print(serde_json::to_string(&row).map_err(|error| error.to_string())?)?,
                    false => print(row.line())?,
                }
            }
            next = now + PERIOD;
        }
        if end <= now {
            return Ok(ExitCode::SUCCESS);
        }
    }
}

/// Measurements of a unit since the last line.
#[derive(Default)]
struct Seen {
    count: u32,
    rotation: [f64; 3],
    acceleration: [f64; 3],
    last: Option<DataImu>,
}

impl Seen {
    fn add(&mut self, imu: &DataImu) {
        self.count += 1;
        self.rotation.iter_mut().zip(imu.rotation).for_each(|(sum, value)| *sum += value);
        self.acceleration.iter_mut().zip(imu.acceleration).for_each(|(sum, value)| *sum += value);
        self.last = Some(imu.clone());
    }
}

/// A line of output: means of a second, the last orientation and temperature.
#[derive(Serialize)]
struct Row<'a> {
    name: &'a str,
    /// `SILENT`: no measurement arrived for a second.
    status: &'static str,
    measurements: u32,
    /// Robot frame, rad/s.
    rotation: Option<[f64; 3]>,
    /// Robot frame, m/s².
    acceleration: Option<[f64; 3]>,
    /// rad.
    yaw: Option<f64>,
    /// °C.
    temperature: Option<f64>,
}

impl<'a> Row<'a> {
    fn of(name: &'a str, seen: &Seen) -> Self {
        let last = seen.last.as_ref();
        let status = match last.map(|last| last.status) {
            None => "SILENT",
            Some(DataImu::OK) => "OK",
            Some(DataImu::UNCALIBRATED) => "UNCALIBRATED",
            Some(DataImu::IMPLAUSIBLE) => "IMPLAUSIBLE",
            Some(_) => "FAULT",
        };
        let mean = |sum: [f64; 3]| last.map(|_| sum.map(|sum| sum / f64::from(seen.count)));
        let yaw = |[x, y, z, w]: [f64; 4]| (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
        Self {
            name,
            status,
            measurements: seen.count,
            rotation: mean(seen.rotation),
            acceleration: mean(seen.acceleration),
            yaw: last.filter(|last| last.oriented).map(|last| yaw(last.orientation)),
            temperature: last.map(|last| last.temperature).filter(|celsius| !celsius.is_nan()),
        }
    }

    fn line(&self) -> String {
        let vector = |vector: Option<[f64; 3]>, scale: f64| {
            vector.map_or_else(
                || "-".into(),
                |[x, y, z]| format!("{:6.2} {:6.2} {:6.2}", x * scale, y * scale, z * scale),
            )
        };
        let number = |value: Option<f64>| value.map_or_else(|| "-".into(), |value| format!("{value:.1}"));
        format!(
            "{:<16} {:<12} {:>3}  {:<22}  {:<22} {:>6} {:>5}",
            self.name,
            self.status,
            self.measurements,
            vector(self.rotation, 1f64.to_degrees()),
            vector(self.acceleration, 1.0),
            number(self.yaw.map(f64::to_degrees)),
            number(self.temperature)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_of_measurements_is_a_line() {
        let mut seen = Seen::default();
        for n in 0..100 {
            seen.add(&DataImu {
                name: "base".into(),
                rotation: [0.0, 0.0, if n % 2 == 0 { 0.4 } else { 0.6 }],
                acceleration: [0.0, -0.5, 9.81],
                orientation: [0.0, 0.0, 0.5f64.sqrt(), 0.5f64.sqrt()],
                oriented: true,
                temperature: 31.0,
                ..DataImu::default()
            });
        }
        let line = Row::of("base", &seen).line();
        let words: Vec<&str> = line.split_whitespace().collect();
        assert_eq!(words, ["base", "OK", "100", "0.00", "0.00", "28.65", "0.00", "-0.50", "9.81", "90.0", "31.0"]);
        let silent = Row::of("top", &Seen::default()).line();
        assert_eq!(silent.split_whitespace().collect::<Vec<_>>(), ["top", "SILENT", "0", "-", "-", "-", "-"]);
    }
}
