//! `advee lidar monitor`: what the lidars measure, a line each second for each of them.

use crate::bus::{Heard, Tool};
use crate::{Common, Outcome, print, seconds};
use base::{Duration, Instant};
use host::clock;
use messages::lowlevel::DataScan;
use messages::{Channel, Message};
use serde::Serialize;
use std::collections::BTreeMap;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Monitor {
    /// Name of a lidar
    name: Option<String>,
    /// End after this time, s
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
    /// A JSON object a line
    #[arg(long)]
    json: bool,
}

/// Time limit for the first sector.
const HEARD: Duration = Duration::from_secs(5);
const PERIOD: Duration = Duration::from_secs(1);

pub fn monitor(common: &Common, command: &Monitor) -> Outcome {
    let mut tool = Tool::join(common, "lidar", &[Channel::LlDataScan])?;
    let begin = clock::now();
    let end = command.time.map_or(Instant::NEVER, |time| begin + time);
    let mut seen: BTreeMap<String, Seen> = BTreeMap::new();
    let (mut next, mut is_first) = (begin + PERIOD, true);
    loop {
        match tool.hear(next.min(end))? {
            Heard::Message(Message::LlDataScan(scan)) => {
                if command.name.as_ref().is_none_or(|name| *name == scan.name) {
                    seen.entry(scan.name.clone()).or_default().add(&scan);
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
            return Err(
                format!("no LL_DATA_SCAN{whose} is heard on {url}; is advee up, and [lidar] configured?").into()
            );
        }
        if next <= now || end <= now {
            if !seen.is_empty() && std::mem::take(&mut is_first) && !command.json {
                print("LIDAR            STATUS   TURNS/S  BEAMS/S  MEASURED  NEAREST")?;
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

/// Sectors of a lidar since the last line.
#[derive(Default)]
pub struct Seen {
    status: i8,
    beams: usize,
    measured: usize,
    /// The first revolution, of which the beginning is missing.
    first: Option<i64>,
    /// The next and the last one, with the instants of their first beams, µs.
    turns: Option<[(i64, i64); 2]>,
    /// Distance, m, and direction in the robot's frame, rad.
    nearest: Option<(f32, f64)>,
}

impl Seen {
    /// Adds a sector, with directions in the robot's frame.
    pub fn add(&mut self, scan: &DataScan) {
        let direction = |n: usize| scan.theta + scan.angle_min + n as f64 * scan.angle_step;
        self.add_beams((scan.revolution, scan.timestamp), scan.status, &scan.ranges, direction);
    }

    /// Adds the beams of a sector: number of the revolution and instant of the first beam, µs; ranges, m, and the
    /// direction of each, rad.
    pub fn add_beams(&mut self, turn: (i64, i64), status: i8, ranges: &[f32], direction: impl Fn(usize) -> f64) {
        self.status = self.status.max(status);
        self.beams += ranges.len();
        let is_first = *self.first.get_or_insert(turn.0) == turn.0;
        match &mut self.turns {
            _ if is_first => {}
            Some([_, last]) if last.0 == turn.0 => {}
            Some([_, last]) => *last = turn,
            None => self.turns = Some([turn, turn]),
        }
        for (n, range) in ranges.iter().enumerate().filter(|(_, range)| range.is_finite()) {
            self.measured += 1;
            if self.nearest.is_none_or(|(nearest, _)| *range < nearest) {
                self.nearest = Some((*range, direction(n)));
            }
        }
    }
}

/// A line of output.
#[derive(Serialize)]
pub struct Row<'a> {
    name: &'a str,
    /// `SILENT`: no sector arrived for a second.
    pub status: &'static str,
    /// Revolutions per second.
    pub turns_per_s: Option<f64>,
    /// Beams of the second, and those among them that measured a distance.
    pub beams: usize,
    pub measured: usize,
    /// m.
    nearest: Option<f32>,
    /// Direction of the nearest, robot frame, rad.
    direction: Option<f64>,
}

impl<'a> Row<'a> {
    /// The line of a second.
    pub fn of(name: &'a str, seen: &Seen) -> Self {
        let status = match seen.status {
            _ if seen.beams == 0 => "SILENT",
            DataScan::OK => "OK",
            DataScan::BLOCKED => "BLOCKED",
            DataScan::SLOW => "SLOW",
            _ => "FAULT",
        };
        let rate = |[(first, from), (last, to)]: [(i64, i64); 2]| {
            (to > from).then(|| last.saturating_sub(first) as f64 * 1e6 / to.saturating_sub(from) as f64)
        };
        Self {
            name,
            status,
            turns_per_s: seen.turns.and_then(rate),
            beams: seen.beams,
            measured: seen.measured,
            nearest: seen.nearest.map(|(distance, _)| distance),
            direction: seen.nearest.map(|(_, angle)| angle.sin().atan2(angle.cos())),
        }
    }

    fn line(&self) -> String {
        let turns = self.turns_per_s.map_or_else(|| "-".into(), |turns| format!("{turns:.1}"));
        let part = (100 * self.measured).checked_div(self.beams).map_or_else(|| "-".into(), |part| format!("{part} %"));
        let nearest = self.nearest.zip(self.direction).map_or_else(
            || "-".into(),
            |(distance, direction)| format!("{distance:.2} m at {:.0}°", direction.to_degrees()),
        );
        format!("{:<16} {:<8} {turns:>7}  {:>7}  {part:>8}  {nearest}", self.name, self.status, self.beams)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_of_sectors_is_a_line() {
        let mut seen = Seen::default();
        for n in 0..81 {
            let mut ranges = vec![2.0; 10];
            ranges[3] = f32::NAN;
            if n == 40 {
                ranges[5] = 0.75;
            }
            seen.add(&DataScan {
                timestamp: 12_500 * n,
                name: "front".into(),
                revolution: n / 8,
                theta: 3.0,
                angle_min: 0.5,
                angle_step: 0.01,
                ranges,
                ..DataScan::default()
            });
        }
        let row = Row::of("front", &seen);
        assert_eq!(row.line(), "front            OK          10.0      810      90 %  0.75 m at -157°");
        assert_eq!(Row::of("rear", &Seen::default()).line(), "rear             SILENT         -        0         -  -");
    }
}
