//! Conversion of the robot's messages to standard types, and the state that it needs.

use std::collections::BTreeMap;
use std::sync::Arc;

use base::Fault;
use messages::common::{self, CmdLog, DataFaults, DataProcesses, DataState, Error, EventText, Process};
use messages::lowlevel::{
    DataBattery, DataHold, DataImu, DataOdo, DataPower, DataRanges, DataTemperature, Hold, Range, Reading,
};
use messages::middlelevel::{DataEstimate, DataPlan};
use messages::{Channel, Message, fault_name};

use super::robot::{RobotScene, Sensor};
use super::scans::Scans;
use super::scene::{self, Scene};
use super::standard::Standard;
use super::write::{Fields, Pose, To};

/// Period at which sensor mountings are repeated: µs.
const MOUNTING_PERIOD_US: u64 = 1_000_000;
/// Time after the last `LL_DATA_RANGES` (1 Hz) from which the ranges of 2011 are used again: µs.
const RANGES_TIMEOUT_US: u64 = 1_500_000;
/// Gap after which odometry continues from the last pose: µs.
const ODOMETRY_GAP_US: i64 = 1_000_000;
/// Longest plausible distance in that gap, m; a longer one means that the odometry restarted.
const ODOMETRY_STEP_MAX_M: f64 = 5.0;
/// Maximum number of range finders, of thermometers, and of inertial measurement units, with topics.
const SENSORS_MAX: usize = 64;
/// Maximum number of modules whose active faults have statuses, and of faults of each.
const MODULES_MAX: usize = 200;
const FAULTS_MAX: usize = 256;
/// Longest name of a thermometer or an inertial measurement unit with a topic, bytes.
const NAME_BYTES_MAX: usize = 64;

const OK: u8 = 0;
const WARN: u8 = 1;
const ERROR: u8 = 2;
const STALE: u8 = 3;

/// State kept between messages.
#[derive(Clone, Debug, Default)]
pub struct State {
    odometry: Odometry,
    sonars: Sensors,
    infrared: Sensors,
    rangers: Sensors,
    scans: Scans,
    /// Timestamp of the last `LL_DATA_RANGES`: while they arrive, the view of 2011 is ignored.
    ranges: Option<i64>,
    temperatures: BTreeMap<String, Arc<str>>,
    imus: BTreeMap<String, Arc<str>>,
    batteries: BTreeMap<String, Arc<str>>,
    faults: Faults,
}

/// Faults whose status is not OK, by module: their numbers and subjects.
#[derive(Clone, Debug, Default)]
struct Faults {
    modules: BTreeMap<String, Vec<(i32, String)>>,
}

/// Dead reckoning in the frame `odom`, from its start.
#[derive(Clone, Debug, Default)]
struct Odometry {
    last: Option<DataOdo>,
    pose: Pose,
}

#[derive(Clone, Debug, Default)]
struct Sensors {
    /// Topic and frame by number of the sensor.
    known: BTreeMap<i32, [String; 2]>,
    shown: Option<i64>,
    /// Time of the last measurement by number of the sensor.
    last: BTreeMap<i32, i64>,
}

/// Properties of a range finder besides its measurement.
#[derive(Clone, Copy)]
struct Finder {
    id: i32,
    place: Pose,
    sensor: Sensor,
}

/// True if messages on the channel have a standard form.
pub fn has_standard(channel: Channel) -> bool {
    matches!(
        channel,
        Channel::CmDataState
            | Channel::CmEventError
            | Channel::CmDataFaults
            | Channel::CmEventText
            | Channel::CmDataProcesses
            | Channel::CmCmdLog
            | Channel::LlDataHold
            | Channel::LlDataGuard
            | Channel::LlDataOdo
            | Channel::LlDataSrfs
            | Channel::LlDataIrs
            | Channel::LlDataRanges
            | Channel::LlDataScan
            | Channel::LlDataImu
            | Channel::LlDataPower
            | Channel::LlDataBattery
            | Channel::LlDataTemperature
            | Channel::MlDataEstimate
            | Channel::MlDataPlan
            | Channel::MlDataObstacles
            | Channel::MlDataPersons
    )
}

impl State {
    /// Sends the standard messages for one of the robot's messages.
    pub fn translate(&mut self, scene: &mut Scene, message: &Message, to: &mut To<'_, '_>) {
        let robot = &scene.robot;
        match message {
            Message::CmDataState(state) => module_state(robot, state, to),
            Message::CmEventError(error) => {
                // If a module publishes its list of faults, the statuses come from the list.
                if !self.faults.modules.contains_key(&error.module) {
                    module_error(robot, error, to);
                }
                error_text(error, to);
            }
            Message::CmDataFaults(list) => self.faults.translate(robot, list, to),
            Message::CmEventText(text) => module_text(text, to),
            Message::CmDataProcesses(processes) => module_processes(robot, processes, to),
            Message::CmCmdLog(command) if command.action == CmdLog::MARK => {
                mark(&robot.name, command.timestamp, &command.text, to);
            }
            Message::LlDataHold(list) => module_holds(robot, list, to),
            Message::LlDataGuard(guard) => scene.guard(guard, to),
            Message::LlDataOdo(odo) => self.odometry.translate(odo, to),
            Message::LlDataSrfs(sonars) if self.lacks_ranges(sonars.timestamp) => {
                self.sonars.translate_old(SONAR, robot.sonar, sonars.timestamp, &sonars.srfs, to);
            }
            Message::LlDataIrs(infrared) if self.lacks_ranges(infrared.timestamp) => {
                self.infrared.translate_old(INFRARED, robot.infrared, infrared.timestamp, &infrared.irs, to);
            }
            Message::LlDataRanges(ranges) => self.ranges(robot, ranges, to),
            Message::LlDataScan(scan) => self.scans.translate(scan, to),
            Message::LlDataImu(imu) => self.imu(imu, to),
            Message::LlDataPower(power) => battery(power, to),
            Message::LlDataBattery(battery) => self.battery(battery, to),
            Message::LlDataTemperature(temperatures) => self.temperatures(temperatures, to),
            Message::MlDataEstimate(estimate) => {
                pose(estimate, to);
                scene.estimate(estimate, to);
            }
            Message::MlDataPlan(plan) => path(plan, to),
            Message::MlDataObstacles(obstacles) => scene::obstacles(obstacles, to),
            Message::MlDataPersons(persons) => scene::persons(persons, to),
            _ => {}
        }
    }

    fn lacks_ranges(&self, timestamp: i64) -> bool {
        self.ranges.is_none_or(|last| last.abs_diff(timestamp) >= RANGES_TIMEOUT_US)
    }

    fn ranges(&mut self, robot: &RobotScene, message: &DataRanges, to: &mut To<'_, '_>) {
        self.ranges = Some(message.timestamp);
        let of = |kind| message.readings.iter().filter(move |reading| reading.kind == kind);
        let sonars = self.sonars.translate(SONAR, robot.sonar, message.timestamp, of(Reading::SONAR), to);
        let infrared = self.infrared.translate(INFRARED, robot.infrared, message.timestamp, of(Reading::INFRARED), to);
        let others = self.rangers.translate(OTHER, Sensor::default(), message.timestamp, of(Reading::OTHER), to);
        transforms(message.timestamp, &[sonars, infrared, others].concat(), to);
    }

    /// Only what is OK: the standard type has no status.
    fn imu(&mut self, message: &DataImu, to: &mut To<'_, '_>) {
        if message.status != DataImu::OK {
            return;
        }
        let Some(topic) = topic_of(&mut self.imus, "/imu/", &message.name) else { return to.topics.leave_out() };
        // Covariances are not known: 0; an orientation that there is none of begins with -1.
        let covariance = |fields: &mut Fields<'_>, first: f64| {
            (0..9).for_each(|n| fields.to.f64(if n == 0 { first } else { 0.0 }));
        };
        to.send(&topic, Standard::Imu, |fields| {
            fields.header(message.timestamp, "base_link");
            message.orientation.iter().for_each(|part| fields.to.f64(*part));
            covariance(fields, if message.oriented { 0.0 } else { -1.0 });
            for [x, y, z] in [message.rotation, message.acceleration] {
                fields.vector(x, y, z);
                covariance(fields, 0.0);
            }
        });
    }

    /// Values that are not known are NaN, as `BatteryState` requires; its charge and capacities, in Ah, are not.
    fn battery(&mut self, message: &DataBattery, to: &mut To<'_, '_>) {
        let Some(topic) = topic_of(&mut self.batteries, "/battery/", &message.name) else {
            return to.topics.leave_out();
        };
        to.send(&topic, Standard::Battery, |fields| {
            fields.header(message.timestamp, "base_link");
            [message.voltage, message.temperature, message.current]
                .iter()
                .for_each(|known| fields.to.f32(*known as f32));
            [f32::NAN; 3].into_iter().for_each(|unknown| fields.to.f32(unknown));
            fields.to.f32(message.charge as f32);
            // POWER_SUPPLY_STATUS_CHARGING, or unknown: one that is not charged may be used or not.
            fields.to.u8(message.charging.into());
            [0; 2].into_iter().for_each(|unknown| fields.to.u8(unknown)); // health, technology
            fields.to.bool(true); // present
            fields.to.count(message.cells.len());
            message.cells.iter().for_each(|cell| fields.to.f32(*cell as f32));
            fields.to.count(0); // cell temperatures
            fields.to.string(&message.name); // location
            fields.to.string(""); // serial number
        });
    }

    fn temperatures(&mut self, message: &DataTemperature, to: &mut To<'_, '_>) {
        for thermometer in &message.temperatures {
            let Some(topic) = topic_of(&mut self.temperatures, "/temperature/", &thermometer.name) else {
                to.topics.leave_out();
                continue;
            };
            to.send(&topic, Standard::Temperature, |fields| {
                fields.header(message.timestamp, "base_link");
                fields.to.f64(thermometer.value);
                fields.to.f64(0.0); // variance: unknown
            });
        }
    }
}

/// Topic of a sensor by its name, as far as there is room for it.
fn topic_of(known: &mut BTreeMap<String, Arc<str>>, prefix: &str, name: &str) -> Option<Arc<str>> {
    if let Some(topic) = known.get(name) {
        return Some(topic.clone());
    }
    if known.len() == SENSORS_MAX || name.len() > NAME_BYTES_MAX {
        return None;
    }
    let word = |letter: char| if letter.is_ascii_alphanumeric() { letter } else { '_' };
    let topic = format!("{prefix}{}", name.chars().map(word).collect::<String>());
    Some(known.entry(name.into()).or_insert(topic.into()).clone())
}

impl Faults {
    /// One status for each fault and subject: while it is active, and once more, OK, when it is cleared. STALE if the
    /// watchdog reports that the module does not run.
    fn translate(&mut self, robot: &RobotScene, list: &DataFaults, to: &mut To<'_, '_>) {
        if !self.modules.contains_key(&list.module) && self.modules.len() == MODULES_MAX {
            to.topics.leave_out();
            return;
        }
        let active = &list.faults[..list.faults.len().min(FAULTS_MAX)];
        let down = list.is_down();
        let known = self.modules.entry(list.module.clone()).or_default();
        let is = |fault: &common::Fault, (number, subject): &(i32, String)| {
            fault.number == *number && fault.subject == *subject
        };
        let gone: Vec<_> = known.iter().filter(|old| !active.iter().any(|fault| is(fault, old))).cloned().collect();
        if !active.is_empty() || !gone.is_empty() {
            to.send("/diagnostics", Standard::DiagnosticArray, |fields| {
                fields.header(list.timestamp, "");
                fields.to.count(active.len() + gone.len());
                for fault in active {
                    let level = level_of(fault.severity);
                    let values = [
                        ("number", format!("0x{:04X}", fault.number)),
                        ("subject", fault.subject.clone()),
                        ("since", fault.since.to_string()),
                    ];
                    let name = status_name(&list.module, fault.number, &fault.subject);
                    fields.status(level, &name, &fault.message, &robot.name, &values);
                }
                let (level, message) = if down { (STALE, "unknown: the module does not run") } else { (OK, "cleared") };
                for (number, subject) in &gone {
                    let values = [("number", format!("0x{number:04X}")), ("subject", subject.clone())];
                    fields.status(level, &status_name(&list.module, *number, subject), message, &robot.name, &values);
                }
            });
        }
        let now = active.iter().map(|fault| (fault.number, fault.subject.clone()));
        if down {
            // The module itself must clear faults that were known before.
            known.retain(|(number, _)| *number != Fault::ModuleDown as i32);
            known.push((Fault::ModuleDown as i32, list.module.clone()));
        } else {
            *known = now.collect();
        }
    }
}

impl Odometry {
    /// Distance and turn between two messages form an arc; the difference across a restart of the driver is ignored.
    fn translate(&mut self, odo: &DataOdo, to: &mut To<'_, '_>) {
        if let Some(last) = &self.last {
            let (way, turn) = (odo.path - last.path, odo.heading - last.heading);
            let gap = odo.timestamp.saturating_sub(last.timestamp);
            if (0..=ODOMETRY_GAP_US).contains(&gap)
                && way.abs() < ODOMETRY_STEP_MAX_M
                && turn.abs() < ODOMETRY_STEP_MAX_M
            {
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

/// Prefix of topics, prefix of frames, radiation (`sensor_msgs/msg/Range`).
type Names = (&'static str, &'static str, u8);
const SONAR: Names = ("", "sonar_", 0);
const INFRARED: Names = ("ir_", "ir_", 1);
const OTHER: Names = ("other_", "other_", 1);

impl Sensors {
    /// Readings, each at its own instant. A repeated measurement is left out; an unknown one is NaN, at the message's
    /// instant.
    fn translate<'a>(
        &mut self,
        names: Names,
        sensor: Sensor,
        timestamp: i64,
        readings: impl Iterator<Item = &'a Reading> + Clone,
        to: &mut To<'_, '_>,
    ) -> Vec<Frame> {
        let finder = |reading: &Reading| Finder {
            id: reading.id,
            place: Pose { x: reading.x, y: reading.y, theta: reading.theta },
            sensor: Sensor { field_of_view: reading.beam, ..sensor },
        };
        for reading in readings.clone() {
            let (stamp, distance) = match reading.status {
                Reading::MEASURED => (reading.timestamp, reading.distance),
                Reading::SILENT => (reading.timestamp, f64::INFINITY), // REP 117: nothing in range
                _ => (timestamp, f64::NAN),                            // REP 117: unknown
            };
            if self.last.get(&reading.id) == Some(&stamp) {
                continue;
            }
            if self.send(names, finder(reading), stamp, distance, to) {
                self.last.insert(reading.id, stamp);
            }
        }
        self.frames(timestamp, readings.map(finder))
    }

    /// Ranges as in 2011: all at the message's instant.
    fn translate_old(&mut self, names: Names, sensor: Sensor, timestamp: i64, ranges: &[Range], to: &mut To<'_, '_>) {
        let finder =
            |range: &Range| Finder { id: range.id, place: Pose { x: range.x, y: range.y, theta: range.theta }, sensor };
        for range in ranges {
            let distance = if range.valid { range.distance } else { f64::INFINITY }; // REP 117: nothing in range
            self.send(names, finder(range), timestamp, distance, to);
        }
        let frames = self.frames(timestamp, ranges.iter().map(finder));
        transforms(timestamp, &frames, to);
    }

    /// False if there are too many range finders for this one.
    fn send(
        &mut self,
        (topics, frames, radiation): Names,
        Finder { id, sensor, .. }: Finder,
        stamp: i64,
        distance: f64,
        to: &mut To<'_, '_>,
    ) -> bool {
        if self.known.len() < SENSORS_MAX && !self.known.contains_key(&id) {
            self.known.insert(id, [format!("/range/{topics}{id}"), format!("{frames}{id}")]);
        }
        let Some([topic, frame]) = self.known.get(&id) else {
            to.topics.leave_out();
            return false;
        };
        to.send(topic, Standard::Range, |fields| {
            fields.header(stamp, frame);
            fields.to.u8(radiation);
            for number in [sensor.field_of_view, sensor.min, sensor.max, distance] {
                fields.to.f32(number as f32);
            }
            fields.to.f32(0.0); // variance: unknown
        });
        true
    }

    /// Frames of the sensors on the robot, once a second; otherwise empty.
    fn frames(&mut self, timestamp: i64, finders: impl Iterator<Item = Finder>) -> Vec<Frame> {
        if self.shown.is_some_and(|shown| shown.abs_diff(timestamp) < MOUNTING_PERIOD_US) {
            return Vec::new();
        }
        let known = finders.filter(|finder| finder.place.is_finite());
        let frames: Vec<Frame> =
            known.filter_map(|finder| Some((self.known.get(&finder.id)?[1].clone(), finder.place))).collect();
        if !frames.is_empty() {
            self.shown = Some(timestamp);
        }
        frames
    }
}

/// Name of a frame, and its pose on the robot.
type Frame = (String, Pose);

fn transforms(timestamp: i64, frames: &[Frame], to: &mut To<'_, '_>) {
    if !frames.is_empty() {
        to.mount(timestamp, frames);
    }
}

fn pose(message: &DataEstimate, to: &mut To<'_, '_>) {
    let pose = Pose { x: message.x, y: message.y, theta: message.theta };
    to.send("/pose", Standard::Pose, |fields| {
        fields.header(message.timestamp, "map");
        fields.pose(pose);
        fields.covariance(&message.covariance);
    });
    // On a live network the odometry's frame lies between both.
    if pose.is_finite() && to.mounted.is_none() {
        to.send("/tf", Standard::Transforms, |fields| {
            fields.to.count(1);
            fields.transform(message.timestamp, "map", "base_link", pose);
        });
    }
}

/// Each pose points to the next; the last one has the heading of the previous one.
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

/// Values that the robot does not measure are NaN, as `BatteryState` requires.
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

/// Mark in the run.
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

fn level_of(severity: i8) -> u8 {
    match severity {
        Error::NOTICE => OK,
        Error::WARNING => WARN,
        _ => ERROR,
    }
}

/// `MODULE/FAULT/SUBJECT`; the subject is omitted if it repeats the module.
fn status_name(module: &str, number: i32, subject: &str) -> String {
    let fault = fault_name(number);
    if subject.is_empty() || subject == module {
        format!("{module}/{fault}")
    } else {
        format!("{module}/{fault}/{subject}")
    }
}

/// `rcl_interfaces/Log` on `/rosout`.
fn log(timestamp: i64, level: u8, module: &str, text: &str, place: (&str, i32), to: &mut To<'_, '_>) {
    to.send("/rosout", Standard::Log, |fields| {
        fields.time(timestamp);
        fields.to.u8(level);
        fields.to.string(module);
        fields.to.string(text);
        fields.to.string(place.0);
        fields.to.string(""); // function
        fields.to.u32(u32::try_from(place.1).unwrap_or_default());
    });
}

fn module_text(message: &EventText, to: &mut To<'_, '_>) {
    let level = match message.level {
        EventText::DEBUG => 10,
        EventText::INFO => 20,
        EventText::WARNING => 30,
        _ => 40,
    };
    log(message.timestamp, level, &message.module, &message.text, ("", 0), to);
}

fn error_text(message: &Error, to: &mut To<'_, '_>) {
    let level = match message.severity {
        _ if message.fatal => 50,
        Error::NOTICE => 20,
        Error::WARNING => 30,
        _ => 40,
    };
    log(message.timestamp, level, &message.module, &message.message, (&message.file, message.line), to);
}

/// One status for each fault of a module that does not publish its list: OK again when the fault is cleared.
fn module_error(robot: &RobotScene, message: &Error, to: &mut To<'_, '_>) {
    let level = level_of(message.severity);
    let values = [
        ("number", format!("0x{:04X}", message.number)),
        ("type", message.r#type.to_string()),
        ("fatal", message.fatal.to_string()),
        ("source", format!("{}:{}", message.file, message.line)),
    ];
    to.send("/diagnostics", Standard::DiagnosticArray, |fields| {
        fields.header(message.timestamp, "");
        fields.to.count(1);
        let name = status_name(&message.module, message.number, "");
        fields.status(level, &name, &message.message, &robot.name, &values);
    });
}

/// One status for each module that publishes holds: OK while it acts, or while it has no command.
fn module_holds(robot: &RobotScene, message: &DataHold, to: &mut To<'_, '_>) {
    let level = if message.is_free() { OK } else { WARN };
    let words = message.holds.first().map_or_else(|| "acts".to_owned(), Hold::words);
    let values: Vec<(&str, String)> = message
        .holds
        .iter()
        .map(|hold| {
            let latched = if hold.latched { ", until a person acts" } else { "" };
            let name = hold.cause().map_or("unknown", messages::Hold::name);
            (name, format!("{} ({}{latched})", hold.words(), hold.code))
        })
        .collect();
    to.send("/diagnostics", Standard::DiagnosticArray, |fields| {
        fields.header(message.timestamp, "");
        fields.to.count(1);
        fields.status(level, &format!("{}/hold", message.module), &words, &robot.name, &values);
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
