//! `advee lidar align`: where a lidar sits on the robot, measured by straight walls and a drive.
//!
//! The tool moves nothing: a person or `advee drive` does. It records scans and measured velocities from the bus, and
//! estimates again and again, until the place is determined and the robot stands.

mod estimate;
mod odometry;
mod solve;
#[cfg(test)]
mod tests;
mod walls;

use crate::bus::{Heard, Tool};
use crate::progress::Progress;
use crate::{Common, Failed, Outcome, complain, counted, print, seconds};
use base::{Duration, Instant};
use estimate::{Estimate, Recording, Refusal, STILL_S, estimate, standing};
use host::clock;
use messages::lowlevel::{DataScan, DataVelocity};
use messages::{Channel, Message};
use odometry::Velocity;
use serde_json::{Value, json};
use std::process::ExitCode;
use std::thread::{JoinHandle, spawn};
use walls::Beam;

#[derive(clap::Args)]
#[command(after_help = HELP)]
pub struct Align {
    /// Name of the lidar
    name: String,
    /// End after this time, s
    #[arg(long = "for", value_name = "S", value_parser = seconds, default_value = "180")]
    time: Duration,
    /// A JSON object with the result
    #[arg(long)]
    json: bool,
}

const HELP: &str = "Place the robot before a straight wall, at best in sight of a second one, and let it stand.
Start this, then move the robot, for example:
  advee drive 0.2 0 --for 5                   1 m straight on
  advee drive 0 --rotation 0.5 --for 3        on the spot by 86°, or an arc
  advee drive 0.2 0 --for 5                   1 m at an angle to the wall
Its lines of robot.toml are printed once the robot stands again and all is determined.";

/// Time limit of the first scan and velocity.
const HEARD: Duration = Duration::from_secs(5);
/// Interval at which an estimate is begun, or its end awaited.
const EVERY: Duration = Duration::from_millis(700);
/// Time for which the robot stands before a complete result is taken, s.
const ENDS_S: f64 = 1.0;
/// Least angle between two beams that are used, rad, and least time between two revolutions, s: of a lidar that has
/// more of them the others are left out.
const STEP_RAD: f64 = 0.008;
const REVOLUTION_S: f64 = 0.09;
/// Beams that are kept: three minutes of a fast lidar.
const BEAMS_MAX: usize = 2_000_000;
const VELOCITIES_MAX: usize = 40_000;
/// Shortest range that is used, and what is left out before the longest, m.
const RANGE_MIN_M: f32 = 0.05;
const RANGE_END_M: f32 = 0.2;
/// A message whose time stamp is this far from the one before it is left out, s.
const JUMP_S: f64 = 10.0;

/// What the bus says about the robot, and where the lidar is configured to be.
#[derive(Default)]
struct Session {
    recording: Recording,
    /// Time stamp that is zero of the recording, µs.
    zero: Option<i64>,
    /// x, m, y, m, and direction, rad, as its driver has them.
    configured: Option<[f64; 3]>,
    /// The last revolution, and whether it is kept; when the last one that is kept began, s.
    revolution: Option<(i64, bool)>,
    kept: Option<f64>,
    /// The robot has moved; since when it stands, s.
    moved: bool,
    stands: Option<f64>,
    is_full: bool,
}

impl Session {
    fn time(&mut self, timestamp: i64) -> f64 {
        let zero = *self.zero.get_or_insert(timestamp);
        timestamp.saturating_sub(zero) as f64 / 1e6
    }

    fn velocity(&mut self, velocity: &DataVelocity) {
        let at = self.time(velocity.timestamp);
        let new = Velocity { at, vx: velocity.vx, vy: velocity.vy, omega: velocity.omega };
        let known = &mut self.recording.velocities;
        let follows = known.last().is_none_or(|last| at > last.at && at - last.at < JUMP_S);
        // Not measured is no number: the gap is seen by the estimation.
        let is_number = [new.vx, new.vy, new.omega].iter().all(|value| value.abs() < 10.0);
        if !follows || !is_number {
            return;
        }
        if known.len() >= VELOCITIES_MAX {
            self.is_full = true;
            return;
        }
        known.push(new);
        if new.is_zero() {
            self.stands.get_or_insert(at);
        } else {
            (self.moved, self.stands) = (true, None);
        }
    }

    fn scan(&mut self, scan: &DataScan) {
        self.configured = Some([scan.x, scan.y, scan.theta]);
        let begin = self.time(scan.timestamp);
        let near = |at: f64, last: f64| (at - last).abs() < JUMP_S;
        let last = self.recording.velocities.last().map_or(0.0, |last| last.at);
        let is_number = [scan.angle_min, scan.angle_step, scan.beam_time].iter().all(|value| value.abs() < 100.0);
        if scan.status != DataScan::OK || !near(begin, last) || !is_number {
            return;
        }
        if self.recording.beams.len() + scan.ranges.len() > BEAMS_MAX {
            self.is_full = true;
            return;
        }
        if !self.keeps(scan.revolution, begin) {
            return;
        }
        // Of a wall at the end of the range the noise decides which points are seen.
        let usable = scan.range_min.max(RANGE_MIN_M)..=scan.range_max - RANGE_END_M;
        let ranges = scan.ranges.iter().enumerate().filter(|(_, range)| usable.contains(range));
        let step = (STEP_RAD / scan.angle_step.abs()).clamp(1.0, 64.0) as usize;
        let ranges = ranges.filter(|(n, _)| n % step == 0);
        self.recording.beams.extend(ranges.map(|(n, range)| Beam {
            at: begin + n as f64 * scan.beam_time,
            revolution: scan.revolution,
            angle: scan.angle_min + n as f64 * scan.angle_step,
            range: f64::from(*range),
        }));
    }

    /// True if a revolution, of which a sector begins at this time, is kept: as a whole, or not at all.
    fn keeps(&mut self, revolution: i64, begin: f64) -> bool {
        if let Some((last, keeps)) = self.revolution
            && last == revolution
        {
            return keeps;
        }
        let keeps = self.kept.is_none_or(|kept| !(0.0..REVOLUTION_S).contains(&(begin - kept)));
        self.revolution = Some((revolution, keeps));
        if keeps {
            self.kept = Some(begin);
        }
        keeps
    }

    /// Time of the last velocity, s.
    fn now(&self) -> f64 {
        self.recording.velocities.last().map_or(0.0, |last| last.at)
    }

    /// True once the robot stands again after it has moved.
    fn stands_again(&self) -> bool {
        self.moved && self.stands.is_some_and(|since| self.now() - since >= ENDS_S)
    }
}

pub fn align(common: &Common, command: &Align) -> Outcome {
    let channels = [Channel::LlDataScan, Channel::LlDataVelocity];
    let mut tool = Tool::join(common, "lidar", &channels)?;
    let begin = clock::now();
    let mut session = Session::default();
    if wait_still(&mut tool, &mut session, command, begin)? {
        return Err("interrupted".into());
    }
    record(&mut tool, &mut session, command, begin)?;
    if !session.moved {
        return Err(format!("{}: the robot has not moved", command.name).into());
    }
    let found = estimate(&session.recording).map_err(|refusal| format!("{}: {refusal}", command.name))?;
    let configured = session.configured.unwrap_or_default();
    match command.json {
        true => print(to_json(&command.name, &found, configured))?,
        false => lines(&command.name, &found, configured).iter().try_for_each(print)?,
    }
    if found.lacks.is_empty() {
        return Ok(ExitCode::SUCCESS);
    }
    found.lacks.iter().for_each(complain);
    Err(format!("{}: not all of its place is determined", command.name).into())
}

/// Records until the place is determined and the robot stands again, or until the time is over, or Ctrl-C.
fn record(tool: &mut Tool, session: &mut Session, command: &Align, begin: Instant) -> Result<(), Failed> {
    let end = begin + command.time;
    let mut progress = Progress::new("aligning");
    // Beside this thread: what is not received in time is lost, and a pause of the velocities spoils all.
    let mut pending: Option<JoinHandle<Result<Estimate, Refusal>>> = None;
    let mut next = clock::now() + EVERY;
    loop {
        match tool.hear(next.min(end))? {
            Heard::Message(message) => {
                take(session, message, &command.name);
                continue;
            }
            Heard::Interrupt => return Ok(()),
            Heard::Nothing if clock::now() >= end || session.is_full => return Ok(()),
            Heard::Nothing => next = clock::now() + EVERY,
        }
        if let Some(ended) = pending.take_if(|pending| pending.is_finished()) {
            let result = ended.join().map_err(|_| "the estimation has failed")?;
            let share = clock::now().since(begin).as_secs_f64() / command.time.as_secs_f64();
            progress.show(share, |_| result.as_ref().map_or_else(ToString::to_string, short));
            if result.is_ok_and(|found| found.lacks.is_empty()) && session.stands_again() {
                return Ok(());
            }
        }
        if pending.is_none() && session.moved {
            let recording = session.recording.clone();
            pending = Some(spawn(move || estimate(&recording)));
        }
    }
}

fn take(session: &mut Session, message: Message, name: &str) {
    match message {
        Message::LlDataScan(scan) if scan.name == name => session.scan(&scan),
        Message::LlDataVelocity(velocity) => session.velocity(&velocity),
        _ => {}
    }
}

/// Waits until the robot has stood for long enough, and says which walls are seen; true at Ctrl-C.
fn wait_still(tool: &mut Tool, session: &mut Session, command: &Align, begin: Instant) -> Result<bool, Failed> {
    let Align { name, json, .. } = command;
    let end = begin + command.time.min(Duration::from_secs(30));
    let mut next = clock::now() + Duration::from_millis(500);
    let mut has_velocity = false;
    loop {
        match tool.hear(next)? {
            Heard::Message(message) => {
                take(session, message, name);
                continue;
            }
            Heard::Interrupt => return Ok(true),
            Heard::Nothing => next = clock::now() + Duration::from_millis(500),
        }
        let now = clock::now();
        has_velocity |= !session.recording.velocities.is_empty();
        if session.moved {
            // It has not stood yet: from the next stand on.
            let configured = session.configured;
            *session = Session { configured, ..Session::default() };
        }
        if now >= begin + HEARD && session.configured.is_none() {
            return Err(
                format!("no LL_DATA_SCAN of {name} is heard; is advee up, and [lidar.{name}] configured?").into()
            );
        }
        if now >= begin + HEARD && !has_velocity {
            return Err("no LL_DATA_VELOCITY is heard; is advee up, and are its drives connected?".into());
        }
        let stood = session.stands.is_some_and(|since| session.now() - since >= 1.5 * STILL_S);
        match standing(&session.recording) {
            Ok(walls) if stood => {
                if !json {
                    let walls: Vec<String> = walls.iter().map(wall_text).collect();
                    print(format!("{name} sees straight walls at {}", walls.join(", ")))?;
                    print("Now drive: straight on at an angle to the wall or along it, and a turn of 60° or more.")?;
                }
                return Ok(false);
            }
            Err(refusal) if now >= end => return Err(format!("{name}: {refusal}").into()),
            _ => {}
        }
    }
}

/// `2.31 m in 3°`, in the lidar's frame.
fn wall_text(wall: &walls::Wall) -> String {
    format!("{:.2} m in {:.0}°", wall.distance, navitools::wrap(wall.normal).to_degrees())
}

/// A line of progress.
fn short(found: &Estimate) -> String {
    let [x, y, theta] = found.solution.deviation;
    let way = format!("way {:.1} m, turn {:.0}°", found.travelled, found.turned.to_degrees());
    let place = format!("x ±{:.0} mm, y ±{:.0} mm, ±{:.2}°", x * 1e3, y * 1e3, theta.to_degrees());
    let lacks = if found.lacks.is_empty() { "; let it stand" } else { "" };
    format!("{way}; {place}{lacks}")
}

/// Names of the place's three numbers, decimals, and whether they are determined.
fn keys(found: &Estimate) -> [(&'static str, usize, bool); 3] {
    let (place, direction) = (found.has_place(), found.has_direction());
    [("x_m", 3, place), ("y_m", 3, place), ("theta_rad", 4, direction)]
}

/// Rounded to its decimals, without a minus before zero.
fn rounded(value: f64, decimals: usize) -> f64 {
    let scale = 10_f64.powi(decimals as i32);
    (value * scale).round() / scale + 0.0
}

fn lines(name: &str, found: &Estimate, configured: [f64; 3]) -> Vec<String> {
    let solution = &found.solution;
    let mut lines = vec!["           CONFIGURED  MEASURED  STD. DEVIATION".to_string()];
    for (n, (key, decimals, determined)) in keys(found).into_iter().enumerate() {
        let [before, now] = [configured[n], solution.place[n]].map(|value| rounded(value, decimals));
        let deviation = solution.deviation[n];
        let (now, deviation) = match determined {
            true => (format!("{now:.decimals$}"), format!("{deviation:.0$}", decimals + 1)),
            false => ("-".into(), "not determined".into()),
        };
        lines.push(format!("{key:<10} {before:>10.decimals$}  {now:>8}  {deviation:>14}"));
    }
    let errors = solution.errors;
    let walls = counted(solution.walls.len() as u32, "wall");
    let beams = format!("±{:.0} mm on {walls}", solution.rms * 1e3);
    let (way, turn) = (found.travelled, found.turned.to_degrees());
    lines.push(format!(
        "{beams}, way {way:.1} m, turn {turn:.0}°; odometry: way {:+.1} %, turn {:+.1} %, {:+.1}° per metre, {:.0} ms",
        rounded(errors.travel * 100.0, 1),
        rounded(errors.turn * 100.0, 1),
        rounded(errors.drift.to_degrees(), 1),
        rounded(errors.delay * 1e3, 0)
    ));
    if found.has_direction() {
        lines.push(String::new());
        lines.push(format!("[lidar.{name}]"));
        for (n, (key, decimals, determined)) in keys(found).into_iter().enumerate() {
            if determined {
                lines.push(format!("{key} = {:?}", rounded(solution.place[n], decimals)));
            }
        }
    }
    lines
}

fn to_json(name: &str, found: &Estimate, configured: [f64; 3]) -> Value {
    let solution = &found.solution;
    let mut value = json!({
        "name": name,
        "rms_m": solution.rms,
        "walls": solution.walls.len(),
        "way_m": found.travelled,
        "turn_rad": found.turned,
        "share": found.share,
        "lacks": found.lacks.iter().map(ToString::to_string).collect::<Vec<_>>(),
    });
    for (n, (key, _, determined)) in keys(found).into_iter().enumerate() {
        value[key] = json!({
            "configured": configured[n],
            "measured": determined.then_some(solution.place[n]),
            "deviation": solution.deviation[n],
        });
    }
    value
}
