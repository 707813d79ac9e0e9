//! Protocol of `advee gym`: a request and an answer per line, each a JSON object (docs/other-planners.md).
//!
//! A line that is too long, is no JSON, has an unknown key or a value out of range is answered by `{"error": …}` and
//! changes nothing.

use serde::{Deserialize, Serialize};
use simulator::world::Crowd;
use std::io::{self, BufRead};
use std::ops::RangeInclusive;

/// Number of this protocol; a later one with another number is not understood by programs for this one.
pub const PROTOCOL: u32 = 1;
/// Maximum length of a request, bytes, without the end of its line.
pub const LINE_MAX: usize = 64 * 1024;
/// Maximum length of an error in an answer, characters: it may quote the request.
const ERROR_MAX: usize = 400;
/// Maximum length of the name of a world, characters.
const NAME_MAX: usize = 64;
/// Coordinates, either way, m; as of a world.
const FAR_M: f64 = 1e4;
/// Distance at which a goal can count as reached, m.
const TOLERANCES_M: RangeInclusive<f64> = 0.05..=10.0;
/// Duration of an episode, s.
const EPISODES_S: RangeInclusive<f64> = 1.0..=86_400.0;
/// Duration of a step, s.
const STEPS_S: RangeInclusive<f64> = 0.02..=10.0;

/// Line of the input.
#[derive(Debug, PartialEq, Eq)]
pub enum Line {
    /// Its bytes, without the end of the line.
    Text(Vec<u8>),
    /// Longer than [`LINE_MAX`]; it was read to its end and dropped.
    TooLong,
}

/// Reads a line; `None` at the end of the input. The last line needs no end of its own.
///
/// # Errors
/// The input cannot be read.
pub fn line(input: &mut impl BufRead) -> io::Result<Option<Line>> {
    let (mut text, mut long, mut read) = (Vec::new(), false, false);
    loop {
        let buffer = match input.fill_buf() {
            Ok(buffer) => buffer,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(error),
        };
        let end = buffer.iter().position(|byte| *byte == b'\n');
        let part = &buffer[..end.unwrap_or(buffer.len())];
        let (used, is_end) = (part.len() + usize::from(end.is_some()), end.is_some() || buffer.is_empty());
        read |= used > 0;
        long |= text.len() + part.len() > LINE_MAX;
        if long {
            text.clear();
        } else {
            text.extend_from_slice(part);
        }
        input.consume(used);
        if is_end {
            return Ok(read.then_some(if long { Line::TooLong } else { Line::Text(text) }));
        }
    }
}

/// Request: an object with one key.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// `{"robot": {}}`: what the robot is. Answered by [`Answer::Robot`].
    Robot(Empty),
    /// `{"reset": {…}}`: begins an episode.
    Reset(Reset),
    /// `{"step": {…}}`: moves the robot for a while.
    Step(Step),
}

/// Object without keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Empty {}

/// Episode that is to begin.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Reset {
    /// What all chance follows from.
    pub seed: u64,
    /// Name of a world in the folder `worlds`; absent: that of the command line.
    pub world: Option<String>,
    /// Pose of the robot at first, m and rad, in the world; absent: that of the world.
    pub start: Option<[f64; 3]>,
    /// Goal, m, in the world; absent: one of the points of the world's routes, drawn by the seed.
    pub goal: Option<[f64; 2]>,
    /// Distance of the robot's origin from the goal that counts as reached, m.
    pub tolerance: f64,
    /// Number of visitors; absent: that of the world.
    pub people: Option<u32>,
    /// Longest duration of the episode, s of virtual time.
    pub seconds: f64,
}

impl Default for Reset {
    fn default() -> Self {
        Self { seed: 1, world: None, start: None, goal: None, tolerance: 0.5, people: None, seconds: 120.0 }
    }
}

/// Motion for a while.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Speed forward, m/s.
    pub v: f64,
    /// Steering angle of the equivalent front wheel, rad, counter-clockwise; excludes `omega` and `vy`.
    #[serde(default)]
    pub steering: Option<f64>,
    /// Rotation, rad/s, counter-clockwise.
    #[serde(default)]
    pub omega: Option<f64>,
    /// Velocity to the left, m/s.
    #[serde(default)]
    pub vy: Option<f64>,
    /// Duration, s of virtual time.
    #[serde(default = "step_s")]
    pub seconds: f64,
}

fn step_s() -> f64 {
    0.1
}

/// Parses a request and checks its ranges.
///
/// # Errors
/// What is wrong with it, in one line.
pub fn parse(text: &[u8]) -> Result<Request, String> {
    let request: Request = serde_json::from_slice(text).map_err(|error| error.to_string())?;
    match &request {
        Request::Robot(_) => {}
        Request::Reset(reset) => check_reset(reset)?,
        Request::Step(step) => check_step(step)?,
    }
    Ok(request)
}

fn check_reset(reset: &Reset) -> Result<(), String> {
    let named = |name: &String| {
        let letters = name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_".contains(&byte));
        letters && (1..=NAME_MAX).contains(&name.len())
    };
    if !reset.world.as_ref().is_none_or(named) {
        return Err("world: expected the name of a world, of letters, digits, - and _".into());
    }
    let start = reset.start.iter().flatten();
    if !start.chain(reset.goal.iter().flatten()).all(|number| number.abs() <= FAR_M) {
        return Err(format!("start, goal: expected numbers within ±{FAR_M}"));
    }
    if reset.people.is_some_and(|count| count > Crowd::MOST) {
        return Err(format!("people: expected 0 to {}", Crowd::MOST));
    }
    within("tolerance", reset.tolerance, TOLERANCES_M)?;
    within("seconds", reset.seconds, EPISODES_S)
}

fn check_step(step: &Step) -> Result<(), String> {
    if step.steering.is_some() && (step.omega.is_some() || step.vy.is_some()) {
        return Err("steering: it excludes omega and vy".into());
    }
    // A command out of the robot's limits is the robot's to refuse.
    within("seconds", step.seconds, STEPS_S)
}

fn within(key: &str, value: f64, range: RangeInclusive<f64>) -> Result<(), String> {
    let expected = || format!("{key}: expected a number from {} to {}", range.start(), range.end());
    range.contains(&value).then_some(()).ok_or_else(expected)
}

/// Answer: an object. Numbers that are unknown are `null`.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub enum Answer {
    /// Of `robot`.
    Robot {
        /// The robot.
        robot: Robot,
    },
    /// Of `reset` and `step`.
    State(Box<State>),
    /// Of a request that was refused; it changed nothing, but for a `reset` that failed: then there is no episode.
    Error {
        /// What is wrong, in one line.
        error: String,
    },
}

impl Answer {
    /// Answer to a refused request.
    #[must_use]
    pub fn error(why: &str) -> Self {
        let mut error: String = why.chars().map(|c| if c.is_control() { ' ' } else { c }).take(ERROR_MAX).collect();
        if why.chars().count() > ERROR_MAX {
            error.push('…');
        }
        Self::Error { error }
    }
}

/// What the robot is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Robot {
    /// [`PROTOCOL`].
    pub protocol: u32,
    /// Its name.
    pub name: String,
    /// True if it steers; else it turns by its wheels, and takes `omega`.
    pub steers: bool,
    /// True if it can move to the side.
    pub sideways: bool,
    /// Highest speed under priority 0, m/s; a command up to `speed_max` is followed at this one.
    pub speed: f64,
    /// Highest speed of a command, m/s; one beyond it stops the robot.
    pub speed_max: f64,
    /// Greatest steering angle of a command, rad.
    pub steering: f64,
    /// Greatest rotation of a command, rad/s; of a robot that steers, its tightest turn at `speed`.
    pub rotation: f64,
    /// Distance of the axles, m.
    pub wheelbase: f64,
    /// Outline, m, in the robot's frame: rear end, front end, half of the width.
    pub outline: [f64; 3],
    /// Number of sonars.
    pub sonars: usize,
    /// Directions of the sonars, rad, in the robot's frame.
    pub sonar_directions: Vec<f64>,
    /// Distance up to which a sonar can measure, m.
    pub sonar_reach: f64,
    /// Number of sectors of [`Observation::lidar`]; 0 without a lidar.
    pub sectors: usize,
    /// Modules that run, in the order of their start, beside the watchdog.
    pub modules: Vec<String>,
}

/// Why an episode is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// The goal is reached: terminated.
    Reached,
    /// The robot was in contact with somebody or something: terminated.
    Contact,
    /// A cause holds the robot that ends only by an act of a person, such as a latched PAUSE: truncated.
    Held,
    /// The time of the episode is over: truncated.
    Time,
}

/// State after a reset or a step.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct State {
    /// What a planner on the robot knows.
    pub observation: Observation,
    /// What only the simulation knows.
    pub info: Info,
    /// Parts of a reward, for the caller to weigh; zeroes after a reset.
    pub reward: Reward,
    /// The episode is over: the goal is reached, or there was a contact.
    pub terminated: bool,
    /// The episode is over for another reason.
    pub truncated: bool,
}

/// What a planner on the robot knows.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Observation {
    /// Virtual time since the reset, s.
    pub time: f64,
    /// `ML_DATA_ESTIMATE`.
    pub estimate: Estimate,
    /// `LL_DATA_VELOCITY` and `LL_DATA_MOTION`.
    pub velocity: Velocity,
    /// `LL_DATA_GUARD`; `null` without a guard.
    pub guard: Option<Bounds>,
    /// Distance that each sonar measured, m, in the order of their numbers; `null` if none: see `sonar_status`.
    pub sonars: Vec<f64>,
    /// Status of each: 0 unknown, which is not free; 1 nothing within reach; 2 measured.
    pub sonar_status: Vec<i8>,
    /// Distance of the nearest point from the robot's origin in each sector of equal width around it, m, from the
    /// direction -π on, counter-clockwise; `null` where nothing was measured, which is not free. Empty without a lidar.
    pub lidar: Vec<f64>,
    /// The goal by the estimate.
    pub goal: Goal,
    /// `LL_DATA_HOLD` of the motion.
    pub holds: Vec<Hold>,
}

/// Estimated pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// m, in the world.
    pub x: f64,
    /// m, in the world.
    pub y: f64,
    /// Heading in the world, rad.
    pub theta: f64,
    /// Standard deviation of x, m.
    pub sd_x: f64,
    /// Standard deviation of y, m.
    pub sd_y: f64,
    /// Standard deviation of the heading, rad.
    pub sd_theta: f64,
    /// 0 lost, 1 searching, 2 coarse, 3 fine.
    pub quality: i8,
}

/// Measured velocity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Velocity {
    /// Forward, m/s.
    pub vx: f64,
    /// To the left, m/s.
    pub vy: f64,
    /// Rotation, rad/s.
    pub omega: f64,
    /// Steering angle, rad.
    pub steering: f64,
}

/// Bounds of the guard.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bounds {
    /// m/s.
    pub forward: f64,
    /// m/s.
    pub backward: f64,
    /// m/s.
    pub left: f64,
    /// m/s.
    pub right: f64,
    /// rad/s.
    pub turn_left: f64,
    /// rad/s.
    pub turn_right: f64,
    /// Number of the cause (docs/holds.md); 0: none.
    pub code: i32,
}

/// The goal in the robot's frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Goal {
    /// Forward, m.
    pub x: f64,
    /// To the left, m.
    pub y: f64,
    /// m.
    pub distance: f64,
    /// Direction, rad, counter-clockwise from ahead.
    pub bearing: f64,
}

/// Cause that holds the robot, or slows it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Hold {
    /// Number (docs/holds.md).
    pub code: i32,
    /// What it concerns.
    pub subject: String,
    /// It ends only by an act of a person.
    pub latched: bool,
}

/// What only the simulation knows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Info {
    /// True pose: x, y in m, heading in rad.
    pub truth: [f64; 3],
    /// True speed, m/s.
    pub speed: f64,
    /// Distance from the outline to the nearest obstacle, m; `null` without an obstacle.
    pub clearance: f64,
    /// Goal in the world, m.
    pub goal: [f64; 2],
    /// True distance to it, m.
    pub distance: f64,
    /// Number of contacts in which the robot moved, since the reset.
    pub contacts: u32,
    /// Number of contacts in which a person walked into the robot.
    pub touched: u32,
    /// Why the episode is over; `null` while it is not.
    pub end: Option<End>,
    /// True if the command of the step moves the robot, as far as the guard permits.
    pub commanded: bool,
}

/// Parts of a reward.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Reward {
    /// By how much the true distance to the goal has become less in this step, m.
    pub progress: f64,
    /// Virtual time of this step, s; less than asked for if the episode ended within it.
    pub time: f64,
    /// Number of contacts in which the robot moved, in this step.
    pub contact: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_has_defaults_and_is_one_object_with_one_key() {
        assert_eq!(parse(b"{\"robot\": {}}"), Ok(Request::Robot(Empty {})));
        assert_eq!(parse(b" {\"reset\": {}} "), Ok(Request::Reset(Reset::default())));
        let reset = br#"{"reset": {"seed": 7, "world": "hall", "goal": [3, -4.5], "start": [1, 2, 0.5], "people": 0}}"#;
        let expected = Reset {
            seed: 7,
            world: Some("hall".into()),
            goal: Some([3.0, -4.5]),
            start: Some([1.0, 2.0, 0.5]),
            people: Some(0),
            ..Reset::default()
        };
        assert_eq!(parse(reset), Ok(Request::Reset(expected)));
        let step = Step { v: 0.5, steering: None, omega: Some(-0.1), vy: None, seconds: 0.1 };
        assert_eq!(parse(br#"{"step": {"v": 0.5, "omega": -0.1}}"#), Ok(Request::Step(step)));
        for bad in [
            "",
            "{}",
            "[]",
            "null",
            "reset",
            "{\"reset\": {}, \"robot\": {}}",
            "{\"reset\": {}} {}",
            "{\"robot\": {\"x\": 1}}",
            "{\"walk\": {}}",
        ] {
            assert!(parse(bad.as_bytes()).is_err(), "{bad}");
        }
        assert!(parse(&[0xFF, b'{']).is_err());
    }

    #[test]
    fn values_out_of_range_are_refused_with_the_key() {
        let long = format!("{{\"reset\": {{\"world\": \"{}\"}}}}", "a".repeat(NAME_MAX + 1));
        for (line, key) in [
            (r#"{"reset": {"world": "../../etc/passwd"}}"#, "world"),
            (r#"{"reset": {"world": ""}}"#, "world"),
            (&long, "world"),
            (r#"{"reset": {"goal": [1e5, 0]}}"#, "goal"),
            (r#"{"reset": {"goal": [1]}}"#, "line 1"),
            (r#"{"reset": {"goal": [1, 1e999]}}"#, "number out of range"),
            (r#"{"reset": {"people": 201}}"#, "people"),
            (r#"{"reset": {"people": -1}}"#, "u32"),
            (r#"{"reset": {"seed": 1, "seed": 2}}"#, "duplicate field"),
            (r#"{"reset": {"tolerance": 0}}"#, "tolerance"),
            (r#"{"reset": {"seconds": 0}}"#, "seconds"),
            (r#"{"step": {}}"#, "missing field `v`"),
            (r#"{"step": {"v": null}}"#, "f64"),
            (r#"{"step": {"v": 0, "seconds": 11}}"#, "seconds"),
            (r#"{"step": {"v": 0, "seconds": 0.01}}"#, "seconds"),
            (r#"{"step": {"v": 0, "steering": 0, "omega": 0}}"#, "steering"),
            (r#"{"step": {"v": 0, "steering": 0, "vy": 0}}"#, "steering"),
            (r#"{"step": {"v": 0, "speed": 1}}"#, "unknown field"),
        ] {
            let why = parse(line.as_bytes()).expect_err(line);
            assert!(why.contains(key), "{line}: {why}");
        }
    }

    #[test]
    fn deep_nesting_is_an_error_and_an_error_is_short_and_one_line() {
        assert!(parse("[".repeat(LINE_MAX).as_bytes()).is_err());
        let why = parse(format!("{{\"{}\": {{}}}}", "x\\n".repeat(10_000)).as_bytes()).unwrap_err();
        let Answer::Error { error } = Answer::error(&why) else { panic!("it is an error") };
        assert!(error.chars().count() <= ERROR_MAX + 1 && !error.contains('\n'), "{error}");
    }

    #[test]
    fn lines_are_bounded_and_a_long_one_takes_nothing_from_the_next() {
        let longest = "a".repeat(LINE_MAX);
        let text = format!("{{}}\n\n{longest}\n{longest}b\nnext\nlast");
        // A buffer smaller than a line.
        let mut input = io::BufReader::with_capacity(7, text.as_bytes());
        let mut next = || line(&mut input).unwrap();
        let text = |text: &str| Some(Line::Text(text.into()));
        assert_eq!(next(), text("{}"));
        assert_eq!(next(), text(""));
        assert_eq!(next(), text(&longest));
        assert_eq!(next(), Some(Line::TooLong));
        assert_eq!(next(), text("next"));
        assert_eq!(next(), text("last"));
        assert_eq!(next(), None);
    }

    #[test]
    fn unknown_numbers_are_null() {
        let bounds = Velocity { vx: f64::NAN, vy: 0.0, omega: 0.5, steering: f64::INFINITY };
        let text = serde_json::to_string(&bounds).unwrap();
        assert_eq!(text, r#"{"vx":null,"vy":0.0,"omega":0.5,"steering":null}"#);
    }
}
