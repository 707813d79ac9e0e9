//! Messages of a page's command socket and their answers, the required roles, and the equivalent messages on the bus.

use super::access::Role;
use super::authority::{Drive, Holder, Limits, Motion};
use diagnostics::orders;
pub use diagnostics::orders::SCENARIO_MAX;
use messages::Message;
use messages::common::CmdLog;
use messages::lowlevel::CmdSdo;
use messages::middlelevel::Waypoint;
use messages::simulation::CmdFault;
use serde::{Deserialize, Deserializer, Serialize};

/// Maximum length of a frame, bytes; only a `scenario` may be longer.
pub const FRAME_MAX: usize = 4 << 10;
/// Maximum length of a frame with a `scenario`, bytes: its text, with room for escapes of JSON.
pub const SCENARIO_FRAME_MAX: usize = 48 << 10;
/// Maximum number of waypoints of a goal.
const WAYPOINTS_MAX: usize = 100;
/// Maximum magnitude of a number: m, rad, s.
const NUMBER_MAX: f64 = 1e6;
/// Maximum length of a name of a module, channel, axis or target, bytes.
const WORD_MAX: usize = 64;
/// Maximum number of bytes written to an object.
const DATA_MAX: usize = 1024;
/// Greatest integer that JavaScript represents exactly.
const INTEGER_MAX: u64 = (1 << 53) - 1;
/// What is said of a number that names no node.
const NO_NODE: &str = "CANopen nodes are 1 to 127, 1000 more for each CAN bus before theirs";

/// Page to `/ws/command`. `id`: a number of the page's choice, which the answer carries.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
#[allow(missing_docs, reason = "the comment of a variant covers its fields")]
pub enum Command {
    /// Sent every 250 ms and answered at once. `t`: the page's clock, ms, monotonic.
    Ping { t: f64 },
    /// Takes the motion authority. `from`: the holder that the page shows, `null` for nobody. Refused if the holder has
    /// changed meanwhile, so that nobody is taken over from by mistake.
    Take { id: i64, from: Option<u32> },
    /// Gives the motion authority back.
    Release { id: i64 },
    /// Sent at 20 Hz while the drive pad is pressed. `hold`: one more than at the last press; `seq`: one more than in
    /// the last command of any hold; `t`: the page's clock when it was sent. Late, repeated and reordered commands are
    /// dropped. A hold that has ended is never resumed: the robot moves again only after a new press. `creep`: true
    /// while a second input is held, by which the robot creeps past the guard; its release is sent at once.
    /// `sideways`, m/s to the left, and `rotation`, rad/s counter-clockwise: instead of `steering`, which is 0 beside
    /// them, for a base that does not steer (limits above 0).
    Drive {
        hold: u64,
        seq: u64,
        t: f64,
        speed: f64,
        steering: f64,
        #[serde(default)]
        sideways: Option<f64>,
        #[serde(default)]
        rotation: Option<f64>,
        #[serde(default)]
        creep: bool,
    },
    /// The drive pad is released: one zero command, then silence.
    Zero { hold: u64, seq: u64 },
    /// Any operator: zero, and PAUSE of `driver_canbus`; the quick stop is active until `resume`.
    Stop { id: i64 },
    /// Ends PAUSE of `driver_canbus` and releases the planner. Needs the motion authority.
    Resume { id: i64 },
    /// Waypoints to drive to. Needs the motion authority.
    Goal { id: i64, waypoints: Vec<WaypointRequest>, r#loop: bool },
    /// A named route of the world. Needs the motion authority.
    Route { id: i64, name: String },
    /// Operation mode of the planner: `manual`, `route`, `wait`, `approach` or `home`. Needs the motion authority.
    Mode { id: i64, mode: String },
    /// Parameter of the planner, by its name in the view; the planner refuses what is out of its range. Needs the
    /// motion authority.
    Parameter { id: i64, name: String, value: f64 },
    /// Position for the estimator, m and rad, map frame. Needs the motion authority.
    Pose { id: i64, x: f64, y: f64, theta: f64 },
    /// Permits a beacon of the map for the estimate, or excludes it. Needs the motion authority.
    Beacon { id: i64, beacon: i32, permitted: bool },
    /// Homes an axis. Needs the motion authority.
    Home { id: i64, axis: String },
    /// Cancels the goal. Any operator.
    Cancel { id: i64 },
    /// `action`: `start`, `stop` or `mark`, which takes `text`. Any operator.
    Log {
        id: i64,
        action: String,
        #[serde(default)]
        text: String,
    },
    /// `state`: `RUN`, `PAUSE`, `STOP` or `TERMINATE`. Engineers.
    State { id: i64, module: String, state: String },
    /// From which level a module prints and sends its texts and reports: `DEBUG`, `INFO`, `WARNING`, `ERROR`,
    /// `UNCHANGED`, or `CONFIGURED` for that of the configuration. The module answers with both. Engineers.
    Level { id: i64, module: String, print: String, send: String },
    /// `action`: `on`, `off` or `reboot`. Engineers.
    Power { id: i64, channel: String, action: String },
    /// Object of a CANopen node, as `LL_CMD_SDO` names it: 1000 more for each CAN bus before its own. `data`:
    /// hexadecimal, least significant byte first; absent: the object is read. Engineers.
    Sdo {
        id: i64,
        node: i32,
        index: u16,
        subindex: u8,
        #[serde(default, deserialize_with = "there")]
        data: Option<String>,
    },
    /// Fault of the simulation; `duration` in s. Engineers.
    Fault { id: i64, target: String, fault: String, value: f64, duration: f64 },
    /// Time of a simulation with `--speed`. `action`: `pause`, `run`, `speed` with the `value` in simulated seconds per
    /// real second, 0 for as fast as possible, `step` with the `value` in s, 0 for one tick, or `reset`. The view shows
    /// whether it was executed. Engineers.
    Simulation { id: i64, action: String, value: f64 },
    /// A new start of a simulation with `--speed` in a world of this text: that of a file, TOML, at most 32 KiB. The
    /// view shows whether it was executed. At most five a second, with those of `publish`. Engineers.
    Scenario { id: i64, text: String },
    /// A message of a known type, as JSON; the server sets its `timestamp`, and in commands its `source`. The scene
    /// lists the robot's channels that are free. `message_type`: for a channel that is not the robot's. At most five a
    /// second. Engineers, with the motion authority.
    Publish {
        id: i64,
        channel: String,
        #[serde(default)]
        message_type: String,
        message: String,
    },
}

/// A waypoint; without an angle any heading is accepted.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WaypointRequest {
    /// x, m.
    pub x: f64,
    /// y, m.
    pub y: f64,
    /// Heading, rad.
    #[serde(default, deserialize_with = "there")]
    pub theta: Option<f64>,
    /// Tolerance, m.
    #[serde(default, deserialize_with = "there")]
    pub tolerance: Option<f64>,
}

/// Optional; an explicit null is rejected (it would decode as NaN).
fn there<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    T::deserialize(deserializer).map(Some)
}

/// Invalid command: its number, if it has one, and the defect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Malformed {
    /// Number.
    pub id: Option<i64>,
    /// Defect, in one line.
    pub why: String,
}

/// `/ws/command` to page.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "lowercase")]
#[allow(missing_docs, reason = "the comment of a variant covers its fields")]
pub enum Answer<'a> {
    /// First message: the number of this socket, and what its user may do. `limits` in m/s and rad.
    Welcome { you: u32, name: &'a str, role: Role, limits: Limits },
    /// Answer to `ping`, with its `t`.
    Pong { t: f64 },
    /// Sent after `welcome` and on each change. `why`: the reason, for the reader; empty at the start.
    Authority { holder: Option<Holder>, yours: bool, why: &'a str },
    /// The server has ended a hold: zero was sent.
    Ended { hold: u64, why: &'a str },
    /// The command was published; its effect appears in the view. `timestamp`: that of its message, by which an answer
    /// such as `command` in `SIM_DATA_RUN` is recognized; null where it is no single message.
    Done { id: i64, timestamp: Option<i64> },
    /// The command was rejected.
    Refused { id: Option<i64>, why: &'a str },
    /// Answer to `sdo`. `abort`: abort code of CiA 301, 0 where there is data.
    Sdo { id: i64, data: String, abort: u32, why: String },
}

impl Answer<'_> {
    /// Text of a frame.
    #[must_use]
    pub fn text(&self) -> String {
        // Numbers and strings always serialize.
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// Requirements of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needs {
    /// Minimum role.
    pub role: Role,
    /// True if it needs the motion authority too.
    pub authority: bool,
}

impl Command {
    /// Parses a frame.
    ///
    /// # Errors
    /// The defect.
    pub fn read(text: &str) -> Result<Self, Malformed> {
        let command: Self = serde_json::from_str(text).map_err(|error| {
            #[derive(Deserialize)]
            struct Numbered {
                id: i64,
            }
            let id = serde_json::from_str::<Numbered>(text).ok().map(|numbered| numbered.id);
            let why: String = error.to_string().chars().filter(|c| !c.is_control()).take(120).collect();
            Malformed { id, why: format!("this is no command: {why}") }
        })?;
        command.checked().map_err(|why| Malformed { id: command.id(), why })?;
        Ok(command)
    }

    /// Whether a frame of `length` bytes may have carried it: those of more than [`FRAME_MAX`] carry a scenario.
    #[must_use]
    pub fn fits(&self, length: usize) -> bool {
        length <= if matches!(self, Self::Scenario { .. }) { SCENARIO_FRAME_MAX } else { FRAME_MAX }
    }

    /// Number for the answer.
    #[must_use]
    pub fn id(&self) -> Option<i64> {
        match self {
            Self::Ping { .. } | Self::Drive { .. } | Self::Zero { .. } => None,
            Self::Take { id, .. }
            | Self::Release { id }
            | Self::Stop { id }
            | Self::Resume { id }
            | Self::Goal { id, .. }
            | Self::Route { id, .. }
            | Self::Mode { id, .. }
            | Self::Parameter { id, .. }
            | Self::Pose { id, .. }
            | Self::Beacon { id, .. }
            | Self::Home { id, .. }
            | Self::Cancel { id }
            | Self::Log { id, .. }
            | Self::State { id, .. }
            | Self::Level { id, .. }
            | Self::Power { id, .. }
            | Self::Sdo { id, .. }
            | Self::Fault { id, .. }
            | Self::Simulation { id, .. }
            | Self::Scenario { id, .. }
            | Self::Publish { id, .. } => Some(*id),
        }
    }

    /// Required role.
    #[must_use]
    pub fn needs(&self) -> Needs {
        let needs = |role, authority| Needs { role, authority };
        match self {
            Self::Ping { .. } => needs(Role::Viewer, false),
            // The authority itself checks the holder: it reports a rejected hold once.
            Self::Drive { .. } | Self::Zero { .. } => needs(Role::Operator, false),
            Self::Take { .. } | Self::Release { .. } | Self::Stop { .. } => needs(Role::Operator, false),
            Self::Cancel { .. } | Self::Log { .. } => needs(Role::Operator, false),
            Self::Resume { .. } | Self::Goal { .. } | Self::Route { .. } => needs(Role::Operator, true),
            Self::Pose { .. } | Self::Beacon { .. } | Self::Home { .. } => needs(Role::Operator, true),
            Self::Mode { .. } | Self::Parameter { .. } => needs(Role::Operator, true),
            Self::State { .. } | Self::Level { .. } | Self::Power { .. } | Self::Sdo { .. } => {
                needs(Role::Engineer, false)
            }
            Self::Fault { .. } | Self::Simulation { .. } | Self::Scenario { .. } => needs(Role::Engineer, false),
            Self::Publish { .. } => needs(Role::Engineer, true),
        }
    }

    /// Checks lengths and ranges, which types do not express.
    fn checked(&self) -> Result<(), String> {
        let words: &[&str] = match self {
            Self::Drive { hold, seq, .. } | Self::Zero { hold, seq } if *hold.max(seq) > INTEGER_MAX => {
                return Err("a number is too large".into());
            }
            Self::Drive { steering, sideways, rotation, .. }
                if *steering != 0.0 && (sideways.is_some() || rotation.is_some()) =>
            {
                return Err("a steering angle beside a rotation".into());
            }
            Self::Goal { waypoints, .. } => {
                if !(1..=WAYPOINTS_MAX).contains(&waypoints.len()) {
                    return Err(format!("a goal has 1 to {WAYPOINTS_MAX} waypoints"));
                }
                let good = |place: &WaypointRequest| {
                    let [theta, tolerance] = [place.theta, place.tolerance].map(Option::unwrap_or_default);
                    [place.x, place.y, theta].into_iter().all(in_range) && (0.0..=NUMBER_MAX).contains(&tolerance)
                };
                return if waypoints.iter().all(good) { Ok(()) } else { Err("a waypoint is out of range".into()) };
            }
            Self::Pose { x, y, theta, .. } if ![*x, *y, *theta].into_iter().all(in_range) => {
                return Err("a place out of range".into());
            }
            Self::Fault { value, duration, .. } if !in_range(*value) || !(0.0..=NUMBER_MAX).contains(duration) => {
                return Err("a value out of range".into());
            }
            Self::Parameter { value, .. } | Self::Simulation { value, .. } if !in_range(*value) => {
                return Err("a value out of range".into());
            }
            Self::Sdo { node, .. } => return is_node(*node).then_some(()).ok_or_else(|| NO_NODE.into()),
            Self::Route { name, .. } | Self::Parameter { name, .. } => &[name],
            Self::Mode { mode, .. } => &[mode],
            Self::Simulation { action, .. } => &[action],
            Self::Home { axis, .. } => &[axis],
            Self::State { module, .. } | Self::Level { module, .. } => &[module],
            Self::Fault { target, fault, .. } => &[target, fault],
            Self::Publish { channel, message_type, .. } => &[channel, message_type],
            _ => &[],
        };
        let good = |word: &&str| word.len() <= WORD_MAX && !word.chars().any(char::is_control);
        if words.iter().all(good) { Ok(()) } else { Err(format!("a name has at most {WORD_MAX} visible characters")) }
    }

    /// Motion command, if it is one.
    #[must_use]
    pub fn drive(&self) -> Option<Drive> {
        match *self {
            Self::Drive { hold, seq, t, speed, steering, sideways, rotation, creep } => {
                let motion = match (sideways, rotation) {
                    (None, None) => Motion::Curve { speed, steering },
                    (left, turn) => Motion::Velocity { vx: speed, vy: left.unwrap_or(0.0), omega: turn.unwrap_or(0.0) },
                };
                Some(Drive { hold, seq, t, motion, creep })
            }
            _ => None,
        }
    }
}

/// True for the number of a node in `LL_CMD_SDO`: its id, and 1000 more for each CAN bus before its own.
fn is_node(number: i32) -> bool {
    number > 0 && (1..=127).contains(&(number % 1000))
}

fn in_range(number: f64) -> bool {
    number.abs() <= NUMBER_MAX
}

/// A named route of the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    /// Name.
    pub name: String,
    /// Points in order, m.
    pub points: Vec<[f64; 2]>,
    /// True if the first point follows the last.
    pub looped: bool,
}

/// Data of the robot for checking commands.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Limits of a manual source.
    pub limits: Limits,
    /// Named routes of the world.
    pub routes: Vec<Route>,
    /// True if it is simulated and accepts faults.
    pub simulated: bool,
}

/// Message of a command on the bus; `None` for those that belong to the authority or to an answer.
///
/// # Errors
/// Reason of the refusal, for the user.
pub fn message(command: &Command, robot: &Robot, timestamp: i64, source: &str) -> Result<Option<Message>, String> {
    let waypoint = |place: &WaypointRequest| Waypoint {
        x: place.x,
        y: place.y,
        theta: place.theta.unwrap_or_default(),
        tolerance: place.tolerance.unwrap_or_default(),
        heading: place.theta.is_some(),
    };
    Ok(Some(match command {
        Command::Goal { waypoints, r#loop, .. } => {
            orders::goal(timestamp, waypoints.iter().map(waypoint).collect(), *r#loop).into()
        }
        Command::Route { name, .. } => {
            let route = robot.routes.iter().find(|route| route.name == *name);
            let route = route.ok_or_else(|| format!("there is no route {name:?}"))?;
            let point = |[x, y]: &[f64; 2]| waypoint(&WaypointRequest { x: *x, y: *y, theta: None, tolerance: None });
            orders::goal(timestamp, route.points.iter().map(point).collect(), route.looped).into()
        }
        Command::Mode { mode, .. } => orders::mode(timestamp, mode, source)?.into(),
        Command::Parameter { name, value, .. } => orders::parameter(timestamp, name, *value, source).into(),
        Command::Cancel { .. } => orders::goal(timestamp, Vec::new(), false).into(),
        Command::Pose { x, y, theta, .. } => orders::pose(timestamp, [*x, *y, *theta], orders::DEVIATIONS).into(),
        Command::Beacon { beacon, permitted, .. } => orders::beacon(timestamp, Some(*beacon), *permitted).into(),
        Command::Home { axis, .. } => orders::home(timestamp, axis).into(),
        Command::Log { action, text, .. } => match action.as_str() {
            "mark" => orders::mark(timestamp, text)?.into(),
            "start" => CmdLog { timestamp, action: CmdLog::START, text: String::new() }.into(),
            "stop" => CmdLog { timestamp, action: CmdLog::STOP, text: String::new() }.into(),
            _ => return Err("the recorder is started or stopped, or given a mark".into()),
        },
        Command::State { module, state, .. } => orders::state(timestamp, module, state, source)?.into(),
        Command::Level { module, print, send, .. } => orders::level(timestamp, module, print, send, source)?.into(),
        Command::Power { channel, action, .. } => orders::power(timestamp, channel, action)?.into(),
        Command::Fault { .. } | Command::Simulation { .. } | Command::Scenario { .. } if !robot.simulated => {
            return Err("this robot is not simulated".into());
        }
        Command::Fault { target, fault, value, duration, .. } => {
            let (target, fault) = (target.clone(), fault.clone());
            CmdFault { timestamp, target, fault, value: *value, duration: *duration }.into()
        }
        Command::Simulation { action, value, .. } => orders::simulation(timestamp, action, *value, source)?.into(),
        Command::Scenario { text, .. } => orders::scenario(timestamp, text, source)?.into(),
        _ => return Ok(None),
    }))
}

/// Access to an object, without its request number.
///
/// # Errors
/// The data to be written is invalid; one line.
pub fn sdo(node: i32, index: u16, subindex: u8, data: Option<&str>) -> Result<CmdSdo, String> {
    if !is_node(node) {
        return Err(NO_NODE.into());
    }
    let wrong = || format!("expected an even number of hexadecimal digits, 1 to {DATA_MAX} bytes");
    let bytes = data.map(|data| bytes(data).ok_or_else(wrong)).transpose()?;
    Ok(CmdSdo {
        timestamp: 0,
        request: 0,
        node,
        index: index.into(),
        subindex: subindex.into(),
        write: bytes.is_some(),
        data: bytes.unwrap_or_default(),
    })
}

fn bytes(hexadecimal: &str) -> Option<Vec<u8>> {
    let digits: Vec<u32> = hexadecimal.chars().map(|c| c.to_digit(16)).collect::<Option<_>>()?;
    let (pairs, rest) = digits.as_chunks::<2>();
    let good = rest.is_empty() && (1..=DATA_MAX).contains(&pairs.len());
    good.then(|| pairs.iter().map(|[high, low]| (high << 4 | low) as u8).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [&str; 26] = [
        r#"{"type":"ping","t":1.5}"#,
        r#"{"type":"take","id":1,"from":null}"#,
        r#"{"type":"release","id":1}"#,
        r#"{"type":"drive","hold":1,"seq":1,"t":1,"speed":0.1,"steering":-0.1}"#,
        r#"{"type":"drive","hold":1,"seq":1,"t":1,"speed":0.1,"steering":-0.1,"creep":true}"#,
        r#"{"type":"drive","hold":1,"seq":1,"t":1,"speed":0.1,"steering":0,"sideways":0.1,"rotation":-0.2}"#,
        r#"{"type":"zero","hold":1,"seq":2}"#,
        r#"{"type":"stop","id":1}"#,
        r#"{"type":"resume","id":1}"#,
        r#"{"type":"goal","id":1,"waypoints":[{"x":1,"y":2},{"x":1,"y":2,"theta":3,"tolerance":0.5}],"loop":true}"#,
        r#"{"type":"route","id":1,"name":"patrol"}"#,
        r#"{"type":"mode","id":1,"mode":"approach"}"#,
        r#"{"type":"parameter","id":1,"name":"speed_mps","value":0.3}"#,
        r#"{"type":"pose","id":1,"x":1,"y":2,"theta":3}"#,
        r#"{"type":"beacon","id":1,"beacon":3,"permitted":false}"#,
        r#"{"type":"home","id":1,"axis":"steering"}"#,
        r#"{"type":"cancel","id":1}"#,
        r#"{"type":"log","id":1,"action":"mark","text":"here"}"#,
        r#"{"type":"state","id":1,"module":"planner","state":"PAUSE"}"#,
        r#"{"type":"level","id":1,"module":"planner","print":"DEBUG","send":"UNCHANGED"}"#,
        r#"{"type":"power","id":1,"channel":"motors","action":"off"}"#,
        r#"{"type":"sdo","id":1,"node":1,"index":4096,"subindex":0}"#,
        r#"{"type":"fault","id":1,"target":"robot","fault":"kidnap","value":1,"duration":0}"#,
        r#"{"type":"simulation","id":1,"action":"speed","value":0.2}"#,
        r#"{"type":"scenario","id":1,"text":"start = [0, 0, 0]"}"#,
        r#"{"type":"publish","id":1,"channel":"CM_CMD_LOG","message":"{}"}"#,
    ];

    fn robot() -> Robot {
        let routes = vec![Route { name: "patrol".into(), points: vec![[1.0, 2.0]], looped: true }];
        Robot { limits: Limits { speed: 0.5, steering: 0.4, sideways: 0.0, rotation: 0.0 }, routes, simulated: true }
    }

    #[test]
    fn each_command_is_parsed_with_its_role_and_output() {
        let mut said = Vec::new();
        for text in ALL {
            let command = Command::read(text).unwrap();
            assert!(command.needs().role >= Role::Viewer, "{text}");
            let viewer = matches!(command, Command::Ping { .. });
            let publishes = matches!(command, Command::Publish { .. });
            assert_eq!(publishes, command.needs() == Needs { role: Role::Engineer, authority: true }, "{text}");
            assert_eq!(command.needs().role == Role::Viewer, viewer, "{text}");
            said.extend(
                message(&command, &robot(), 7, "web:x").unwrap().map(|message| message.channel_name().into_owned()),
            );
        }
        let expected = "ML_CMD_GOAL ML_CMD_GOAL ML_CMD_MODE ML_CMD_PARAMETER ML_CMD_ESTIMATE ML_CMD_BEACON_USE \
            LL_CMD_HOMING ML_CMD_GOAL CM_CMD_LOG CM_CMD_STATE CM_CMD_LEVEL LL_CMD_POWER SIM_CMD_FAULT \
            SIM_CMD_RUN SIM_CMD_RUN";
        assert_eq!(said.join(" "), expected);
    }

    #[test]
    fn an_invalid_command_is_rejected_with_reason_and_number() {
        for (text, id) in [
            ("", None),
            ("null", None),
            ("[]", None),
            (r#"{"type":"fly","id":3}"#, Some(3)),
            (r#"{"id":3}"#, Some(3)),
            (r#"{"type":"stop","id":"3"}"#, None),
            (r#"{"type":"stop","id":3,"more":1}"#, Some(3)),
            (r#"{"type":"drive","hold":1,"seq":1,"t":1,"speed":null,"steering":0}"#, None),
            (r#"{"type":"drive","hold":1,"seq":1,"t":1,"speed":NaN,"steering":0}"#, None),
            (r#"{"type":"drive","hold":1,"seq":1,"t":1,"speed":1e999,"steering":0}"#, None),
            (r#"{"type":"drive","hold":-1,"seq":1,"t":1,"speed":0,"steering":0}"#, None),
            (r#"{"type":"drive","hold":1,"seq":1,"t":1,"speed":0,"steering":0,"creep":1}"#, None),
            (r#"{"type":"drive","hold":1,"seq":9007199254740992,"t":1,"speed":0,"steering":0}"#, None),
            (r#"{"type":"drive","hold":1,"seq":1,"t":1,"speed":0,"steering":0.1,"rotation":0.1}"#, None),
            (r#"{"type":"drive","hold":1,"seq":1,"t":1,"speed":0,"steering":0,"sideways":"left"}"#, None),
            (r#"{"type":"goal","id":3,"waypoints":[],"loop":false}"#, Some(3)),
            (r#"{"type":"goal","id":3,"waypoints":[{"x":1,"y":1e9}],"loop":false}"#, Some(3)),
            (r#"{"type":"goal","id":3,"waypoints":[{"x":1,"y":1,"theta":null}],"loop":false}"#, Some(3)),
            (r#"{"type":"goal","id":3,"waypoints":[{"x":1,"y":1,"tolerance":-1}],"loop":false}"#, Some(3)),
            (r#"{"type":"beacon","id":3,"beacon":1}"#, Some(3)),
            (r#"{"type":"beacon","id":3,"beacon":4294967296,"permitted":true}"#, Some(3)),
            (r#"{"type":"mode","id":3,"mode":"a\nb"}"#, Some(3)),
            (r#"{"type":"parameter","id":3,"name":"speed_mps","value":1e9}"#, Some(3)),
            (r#"{"type":"parameter","id":3,"name":"speed_mps","value":null}"#, Some(3)),
            (r#"{"type":"sdo","id":3,"node":256,"index":1,"subindex":0}"#, Some(3)),
            (r#"{"type":"state","id":3,"module":"a\nb","state":"RUN"}"#, Some(3)),
            (r#"{"type":"level","id":3,"module":"a\nb","print":"INFO","send":"INFO"}"#, Some(3)),
            (r#"{"type":"level","id":3,"module":"a","print":"INFO"}"#, Some(3)),
            (r#"{"type":"fault","id":3,"target":"x","fault":"y","value":0,"duration":-1}"#, Some(3)),
            (r#"{"type":"simulation","id":3,"action":"step","value":1e9}"#, Some(3)),
            (r#"{"type":"simulation","id":3,"action":"step","value":null}"#, Some(3)),
            (r#"{"type":"simulation","id":3,"action":"a\nb","value":0}"#, Some(3)),
            (r#"{"type":"publish","id":3,"channel":"A\nB","message":"{}"}"#, Some(3)),
            (r#"{"type":"publish","id":3,"channel":"A","message":{}}"#, Some(3)),
        ] {
            let refused = Command::read(text).expect_err(text);
            assert!(refused.id == id && !refused.why.is_empty(), "{text}: {refused:?}");
        }
        let deep = format!("{}{}", "[".repeat(2000), "]".repeat(2000));
        assert!(Command::read(&deep).is_err());
    }

    #[test]
    fn a_scenario_reaches_a_simulated_robot_as_it_is_and_alone_may_be_long() {
        let text = format!("start = [0, 0, 0] # {}", "x".repeat(2 * FRAME_MAX));
        let frame = serde_json::json!({ "type": "scenario", "id": 1, "text": text }).to_string();
        let command = Command::read(&frame).unwrap();
        assert!(command.fits(frame.len()) && !command.fits(SCENARIO_FRAME_MAX + 1));
        assert!(!Command::Stop { id: 1 }.fits(FRAME_MAX + 1));
        assert_eq!(command.needs(), Needs { role: Role::Engineer, authority: false });
        let Ok(Some(Message::SimCmdRun(said))) = message(&command, &robot(), 7, "web:x") else { panic!("{command:?}") };
        assert_eq!((said.action, said.world), (messages::simulation::CmdRun::SCENARIO, text));
        let long = Command::Scenario { id: 1, text: "#".repeat(orders::SCENARIO_MAX + 1) };
        assert!(message(&long, &robot(), 7, "web:x").is_err());
        let real = Robot { simulated: false, ..robot() };
        assert_eq!(message(&command, &real, 7, "web:x"), Err("this robot is not simulated".into()));
    }

    #[test]
    fn impossible_commands_are_explained() {
        let real = Robot { simulated: false, ..robot() };
        for text in [
            r#"{"type":"fault","id":1,"target":"robot","fault":"kidnap","value":1,"duration":0}"#,
            r#"{"type":"simulation","id":1,"action":"pause","value":0}"#,
            r#"{"type":"scenario","id":1,"text":"start = [0, 0, 0]"}"#,
            r#"{"type":"route","id":1,"name":"nowhere"}"#,
            r#"{"type":"mode","id":1,"mode":"fly"}"#,
            r#"{"type":"power","id":1,"channel":"motor","action":"off"}"#,
            r#"{"type":"state","id":1,"module":"planner","state":"INIT"}"#,
            r#"{"type":"level","id":1,"module":"planner","print":"LOUD","send":"INFO"}"#,
            r#"{"type":"log","id":1,"action":"mark","text":""}"#,
            r#"{"type":"log","id":1,"action":"erase","text":""}"#,
        ] {
            assert!(message(&Command::read(text).unwrap(), &real, 7, "web:x").is_err(), "{text}");
        }
        let written = sdo(1, 0x1017, 0, Some("e803")).unwrap();
        assert!(written.write && written.data == [0xe8, 3] && !sdo(1, 0x1017, 0, None).unwrap().write);
        for (node, data) in [(0, None), (128, None), (1, Some("")), (1, Some("e80")), (1, Some("+1")), (1, Some("zz"))]
        {
            assert!(sdo(node, 1, 0, data).is_err(), "{node} {data:?}");
        }
    }

    #[test]
    fn answers_match_the_page() {
        let limits = Limits { speed: 0.5, steering: 0.25, sideways: 0.0, rotation: 0.0 };
        for (answer, text) in [
            (
                Answer::Welcome { you: 3, name: "x", role: Role::Operator, limits },
                concat!(
                    r#"{"type":"welcome","you":3,"name":"x","role":"operator","#,
                    r#""limits":{"speed":0.5,"steering":0.25,"sideways":0.0,"rotation":0.0}}"#
                ),
            ),
            (Answer::Pong { t: 1.5 }, r#"{"type":"pong","t":1.5}"#),
            (
                Answer::Authority { holder: None, yours: false, why: "" },
                r#"{"type":"authority","holder":null,"yours":false,"why":""}"#,
            ),
            (Answer::Ended { hold: 4, why: "y" }, r#"{"type":"ended","hold":4,"why":"y"}"#),
            (Answer::Done { id: 1, timestamp: None }, r#"{"type":"done","id":1,"timestamp":null}"#),
            (Answer::Done { id: 1, timestamp: Some(7) }, r#"{"type":"done","id":1,"timestamp":7}"#),
            (Answer::Refused { id: None, why: "z" }, r#"{"type":"refused","id":null,"why":"z"}"#),
            (
                Answer::Sdo { id: 1, data: "00".into(), abort: 0, why: String::new() },
                r#"{"type":"sdo","id":1,"data":"00","abort":0,"why":""}"#,
            ),
        ] {
            assert_eq!(answer.text(), text);
        }
    }
}
