//! Messages of standard types from those of the robot's, and what has to be remembered for them.

use std::collections::BTreeMap;
use std::sync::Arc;

use base::Fault;
use messages::common::{CmdLog, DataProcesses, DataState, Error, Process};
use messages::lowlevel::{DataOdo, DataPower, DataTemperature, Range};
use messages::middlelevel::{DataEstimate, DataPlan};
use messages::{Channel, Message};

use super::scene::{self, Scene};
use super::standard::Standard;
use super::write::{Pose, To};
use super::{RobotScene, Sensor};

/// Where sensors sit is told again after so long: µs.
const AGAIN: u64 = 1_000_000;
/// Odometry with a gap longer than this goes on where it was: µs.
const ODOMETRY_GAP: i64 = 1_000_000;
/// How far the robot may have come in that gap, m; more is an odometry that began anew.
const ODOMETRY_STEP: f64 = 5.0;
/// How many range finders, and how many thermometers, have topics.
const SENSORS_MAX: usize = 64;
/// The longest name of a thermometer that has a topic, bytes.
const NAME_MAX: usize = 64;

const OK: u8 = 0;
const WARN: u8 = 1;
const ERROR: u8 = 2;
const STALE: u8 = 3;

/// What is remembered between messages.
#[derive(Clone, Debug, Default)]
pub struct State {
    odometry: Odometry,
    sonars: Sensors,
    infrared: Sensors,
    temperatures: BTreeMap<String, Arc<str>>,
}

/// Where odometry alone says that the robot is, in the frame `odom`: there it began.
#[derive(Clone, Debug, Default)]
struct Odometry {
    last: Option<DataOdo>,
    pose: Pose,
}

#[derive(Clone, Debug, Default)]
struct Sensors {
    /// Topic and frame by the sensor's number.
    known: BTreeMap<i32, [String; 2]>,
    shown: Option<i64>,
}

/// Whether messages on the channel have a standard form.
pub fn has_standard(channel: Channel) -> bool {
    matches!(
        channel,
        Channel::CmDataState
            | Channel::CmEventError
            | Channel::CmDataProcesses
            | Channel::CmCmdLog
            | Channel::LlDataOdo
            | Channel::LlDataSrfs
            | Channel::LlDataIrs
            | Channel::LlDataPower
            | Channel::LlDataTemperature
            | Channel::MlDataEstimate
            | Channel::MlDataPlan
            | Channel::MlDataObstacles
    )
}

impl State {
    /// Sends what there is in ROS 2 for a message of the robot's.
    pub fn translate(&mut self, scene: &mut Scene, message: &Message, to: &mut To<'_, '_>) {
        let robot = &scene.robot;
        match message {
            Message::CmDataState(state) => module_state(robot, state, to),
            Message::CmEventError(error) => module_error(robot, error, to),
            Message::CmDataProcesses(processes) => module_processes(robot, processes, to),
            Message::CmCmdLog(command) if command.action == CmdLog::MARK => {
                mark(&robot.name, command.timestamp, &command.text, to);
            }
            Message::LlDataOdo(odo) => self.odometry.translate(odo, to),
            Message::LlDataSrfs(sonars) => {
                self.sonars.translate(("", "sonar_", 0), robot.sonar, sonars.timestamp, &sonars.srfs, to);
            }
            Message::LlDataIrs(infrared) => {
                self.infrared.translate(("ir_", "ir_", 1), robot.infrared, infrared.timestamp, &infrared.irs, to);
            }
            Message::LlDataPower(power) => battery(power, to),
            Message::LlDataTemperature(temperatures) => self.temperatures(temperatures, to),
            Message::MlDataEstimate(estimate) => {
                pose(estimate, to);
                scene.estimate(estimate, to);
            }
            Message::MlDataPlan(plan) => path(plan, to),
            Message::MlDataObstacles(obstacles) => scene::obstacles(obstacles, to),
            _ => {}
        }
    }

    fn temperatures(&mut self, message: &DataTemperature, to: &mut To<'_, '_>) {
        for thermometer in &message.temperatures {
            let topic = match self.temperatures.get(&thermometer.name) {
                Some(topic) => topic.clone(),
                None if self.temperatures.len() < SENSORS_MAX && thermometer.name.len() <= NAME_MAX => {
                    let word = |letter: char| if letter.is_ascii_alphanumeric() { letter } else { '_' };
                    let topic = format!("/temperature/{}", thermometer.name.chars().map(word).collect::<String>());
                    self.temperatures.entry(thermometer.name.clone()).or_insert(topic.into()).clone()
                }
                None => {
                    to.topics.leave_out();
                    continue;
                }
            };
            to.send(&topic, Standard::Temperature, |fields| {
                fields.header(message.timestamp, "base_link");
                fields.to.f64(thermometer.value);
                fields.to.f64(0.0); // variance: unknown
            });
        }
    }
}

impl Odometry {
    /// Way and turn between two messages make an arc; what is between two lives of the driver's makes nothing.
    fn translate(&mut self, odo: &DataOdo, to: &mut To<'_, '_>) {
        if let Some(last) = &self.last {
            let (way, turn) = (odo.path - last.path, odo.heading - last.heading);
            let gap = odo.timestamp.saturating_sub(last.timestamp);
            if (0..=ODOMETRY_GAP).contains(&gap) && way.abs() < ODOMETRY_STEP && turn.abs() < ODOMETRY_STEP {
                let (sin, cos) = libm::sincos(self.pose.theta + turn / 2.0);
                self.pose.x += way * cos;
                self.pose.y += way * sin;
                self.pose.theta += turn;
            }
        }
        self.last = Some(odo.clone());
        to.send("/odometry", Standard::Odometry, |fields| {
            fields.header(odo.timestamp, "odom");
            fields.to.string("base_link");
            fields.pose(self.pose);
            fields.covariance(&[[0.0; 3]; 3]);
            fields.vector(odo.translation, 0.0, 0.0);
            fields.vector(0.0, 0.0, odo.rotation);
            fields.covariance(&[[0.0; 3]; 3]);
        });
    }
}

impl Sensors {
    /// `(beginning of topics, beginning of frames, radiation)`.
    fn translate(
        &mut self,
        (topics, frames, radiation): (&str, &str, u8),
        sensor: Sensor,
        timestamp: i64,
        ranges: &[Range],
        to: &mut To<'_, '_>,
    ) {
        for range in ranges {
            if self.known.len() < SENSORS_MAX && !self.known.contains_key(&range.id) {
                let names = [format!("/range/{topics}{}", range.id), format!("{frames}{}", range.id)];
                self.known.insert(range.id, names);
            }
            let Some([topic, frame]) = self.known.get(&range.id) else {
                to.topics.leave_out();
                continue;
            };
            to.send(topic, Standard::Range, |fields| {
                fields.header(timestamp, frame);
                fields.to.u8(radiation);
                let distance = if range.valid { range.distance } else { f64::INFINITY }; // REP 117: nothing in reach
                for number in [sensor.field_of_view, sensor.min, sensor.max, distance] {
                    fields.to.f32(number as f32);
                }
                fields.to.f32(0.0); // variance: unknown
            });
        }
        if self.shown.is_none_or(|shown| shown.abs_diff(timestamp) >= AGAIN) {
            self.shown = Some(timestamp);
            self.transforms(timestamp, ranges, to);
        }
    }

    fn transforms(&self, timestamp: i64, ranges: &[Range], to: &mut To<'_, '_>) {
        let known = ranges.iter().filter_map(|range| {
            let [_, frame] = self.known.get(&range.id)?;
            let pose = Pose { x: range.x, y: range.y, theta: range.theta };
            pose.is_finite().then_some((frame, pose))
        });
        let known: Vec<_> = known.collect();
        to.send("/tf", Standard::Transforms, |fields| {
            fields.to.count(known.len());
            for (frame, pose) in known {
                fields.transform(timestamp, "base_link", frame, pose);
            }
        });
    }
}

fn pose(message: &DataEstimate, to: &mut To<'_, '_>) {
    let pose = Pose { x: message.x, y: message.y, theta: message.theta };
    to.send("/pose", Standard::Pose, |fields| {
        fields.header(message.timestamp, "map");
        fields.pose(pose);
        fields.covariance(&message.covariance);
    });
    if pose.is_finite() {
        to.send("/tf", Standard::Transforms, |fields| {
            fields.to.count(1);
            fields.transform(message.timestamp, "map", "base_link", pose);
        });
    }
}

/// Each pose looks at the next; the last one as the one before.
fn path(message: &DataPlan, to: &mut To<'_, '_>) {
    let points: Vec<(f64, f64)> = message.x.iter().copied().zip(message.y.iter().copied()).collect();
    to.send("/plan", Standard::Path, |fields| {
        fields.header(message.timestamp, "map");
        fields.to.count(points.len());
        let mut theta = 0.0;
        for (i, &(x, y)) in points.iter().enumerate() {
            if let Some((to_x, to_y)) = points.get(i + 1) {
                theta = libm::atan2(to_y - y, to_x - x);
            }
            fields.header(message.timestamp, "map");
            fields.pose(Pose { x, y, theta });
        }
    });
}

/// What the robot does not measure is NaN, as `BatteryState` wants it.
fn battery(message: &DataPower, to: &mut To<'_, '_>) {
    let current: f64 = message.channels.iter().map(|channel| channel.current).sum();
    to.send("/battery", Standard::Battery, |fields| {
        fields.header(message.timestamp, "base_link");
        fields.to.f32(message.voltage as f32);
        fields.to.f32(f32::NAN); // temperature
        fields.to.f32(if message.channels.is_empty() { f32::NAN } else { -current as f32 }); // out of the battery
        [f32::NAN; 3].into_iter().for_each(|unknown| fields.to.f32(unknown)); // charge, capacity, design capacity
        fields.to.f32(message.charge as f32);
        [0; 3].into_iter().for_each(|unknown| fields.to.u8(unknown)); // status, health, technology
        fields.to.bool(true); // present
        fields.to.count(0); // cell voltages
        fields.to.count(0); // cell temperatures
        fields.to.string(""); // location
        fields.to.string(""); // serial number
    });
}

/// A mark in the run.
pub fn mark(robot: &str, timestamp: i64, text: &str, to: &mut To<'_, '_>) {
    to.send("/marks", Standard::Log, |fields| {
        fields.time(timestamp);
        fields.to.u8(20); // INFO
        fields.to.string(robot);
        fields.to.string(text);
        fields.to.string(""); // file
        fields.to.string(""); // function
        fields.to.u32(0); // line
    });
}

fn state_name(state: i8) -> (u8, &'static str) {
    match state {
        DataState::INIT => (WARN, "INIT"),
        DataState::STOP => (WARN, "STOP"),
        DataState::RUN => (OK, "RUN"),
        DataState::ERROR => (ERROR, "ERROR"),
        DataState::TERMINATE => (STALE, "TERMINATE"),
        DataState::PAUSE => (WARN, "PAUSE"),
        _ => (STALE, "UNKNOWN"),
    }
}

fn module_state(robot: &RobotScene, message: &DataState, to: &mut To<'_, '_>) {
    let (level, state) = state_name(message.state);
    to.send("/diagnostics", Standard::DiagnosticArray, |fields| {
        fields.header(message.timestamp, "");
        fields.to.count(1);
        let name = format!("{}/state", message.module);
        fields.status(level, &name, state, &robot.name, &[("state", message.state.to_string())]);
    });
}

/// One status for each fault of a module: it is OK again when the fault is cleared.
fn module_error(robot: &RobotScene, message: &Error, to: &mut To<'_, '_>) {
    let level = match message.severity {
        Error::NOTICE => OK,
        Error::WARNING => WARN,
        _ => ERROR,
    };
    let fault = Fault::ALL.iter().find(|fault| i32::from(**fault as u16) == message.number);
    let fault = fault.map_or_else(|| format!("0x{:04X}", message.number), |fault| fault.name().to_owned());
    let values = [
        ("number", format!("0x{:04X}", message.number)),
        ("type", message.r#type.to_string()),
        ("fatal", message.fatal.to_string()),
        ("source", format!("{}:{}", message.file, message.line)),
    ];
    to.send("/diagnostics", Standard::DiagnosticArray, |fields| {
        fields.header(message.timestamp, "");
        fields.to.count(1);
        fields.status(level, &format!("{}/{fault}", message.module), &message.message, &robot.name, &values);
    });
}

fn module_processes(robot: &RobotScene, message: &DataProcesses, to: &mut To<'_, '_>) {
    to.send("/diagnostics", Standard::DiagnosticArray, |fields| {
        fields.header(message.timestamp, "");
        fields.to.count(message.processes.len());
        for process in &message.processes {
            let (level, phase) = match process.phase {
                Process::RUNNING => (OK, "running"),
                Process::TERMINATING => (WARN, "terminating"),
                Process::TERMINATED if process.wanted == DataState::TERMINATE => (OK, "terminated, as wanted"),
                Process::TERMINATED => (ERROR, "terminated"),
                _ => (STALE, "unknown"),
            };
            let values = [
                ("pid", process.pid.to_string()),
                ("state", state_name(process.state).1.to_owned()),
                ("wanted", state_name(process.wanted).1.to_owned()),
                ("restarts", process.restarts.to_string()),
                ("last_exit", process.last_exit.to_string()),
                ("uptime", process.uptime.to_string()),
                ("cpu", process.cpu.to_string()),
                ("rss", process.rss.to_string()),
            ];
            fields.status(level, &format!("{}/process", process.module), phase, &robot.name, &values);
        }
    });
}
