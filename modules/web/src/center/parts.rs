//! The parts of the view that are sent again and again, from the model.

use super::authority::Holder;
use super::demo::Playing;
use base::Instant;
use diagnostics::{
    Bound, ChannelRow, Concern, Ellipse, HoldRow, Model, ModuleRow, Reported, Scan, Shown, ShownGroup, ShownText,
    Status,
};
use messages::{common, lowlevel, middlelevel, simulation};
use serde::Serialize;

/// Maximum number of texts, and of reports, in a part, the latest: it is sent once a second.
const TEXTS_MAX: usize = 100;
const REPORTS_MAX: usize = 100;

/// State that is not published on the bus.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExtraState<'a> {
    /// Web user that holds the motion authority.
    pub holder: Option<&'a Holder>,
    /// Number of viewers, including those of Foxglove.
    pub viewers: usize,
    /// Position in the recorded run being played.
    pub play: Option<Playing>,
}

/// Motion, position and goal: 10 Hz, always. Without one for 1 s the connection is lost.
#[derive(Serialize)]
#[serde(tag = "part", rename = "drive")]
pub struct DrivePart<'a> {
    status: Status,
    /// What is not well, the most severe first; empty: all is well.
    concerns: Vec<Concern>,
    motion: Shown<'a, lowlevel::DataMotion>,
    /// Velocity of the body, of any base.
    velocity: Shown<'a, lowlevel::DataVelocity>,
    /// Source that commands the motion, as people call it; empty: nobody does, or it is not known.
    driver: String,
    /// All causes for which the robot or its goal is held; empty: it acts.
    holds: Vec<HoldRow>,
    /// The motion commands of all sources: of those that command speed and steering,
    commands: Vec<&'a lowlevel::CmdMotion>,
    /// and of those that command a velocity.
    velocity_commands: Vec<&'a lowlevel::CmdVelocity>,
    /// Greatest speeds that can still be stopped, and the fields in the robot's frame: at most 10, of 64 corners.
    guard: Shown<'a, lowlevel::DataGuard>,
    /// The bound of these that holds; `null`: the robot has no guard.
    bound: Option<Bound>,
    stop: Shown<'a, lowlevel::EventStop>,
    odometry: Shown<'a, lowlevel::DataOdo>,
    estimate: Shown<'a, middlelevel::DataEstimate>,
    ellipse: Option<Ellipse>,
    goal: Shown<'a, middlelevel::DataGoal>,
    /// Operation mode of the planner.
    mode: Shown<'a, middlelevel::DataMode>,
    truth: Shown<'a, simulation::DataTruth>,
    gamepad: Shown<'a, lowlevel::DataJoydev>,
    /// Holder of the motion authority among the web clients.
    holder: Option<&'a Holder>,
    /// Position in the recorded run being played; `null` for the live robot.
    play: Option<Playing>,
}

impl<'a> DrivePart<'a> {
    /// State at `now`.
    pub fn of(model: &'a Model, now: Instant, beside: ExtraState<'a>) -> Self {
        Self {
            status: model.status(now),
            concerns: model.concerns(now),
            motion: model.motion.shown(now),
            velocity: model.velocity.shown(now),
            driver: model.driver(),
            holds: model.hold_rows(now),
            commands: model.commands(now).collect(),
            velocity_commands: model.velocity_commands(now).collect(),
            guard: model.guard.shown(now),
            bound: model.bound(now),
            stop: model.stop.shown(now),
            odometry: model.odometry.shown(now),
            estimate: model.estimate.shown(now),
            ellipse: model.estimate.get().and_then(|estimate| Ellipse::of(&estimate.covariance)),
            goal: model.goal.shown(now),
            mode: model.mode.shown(now),
            truth: model.truth.shown(now),
            gamepad: model.gamepad.shown(now),
            holder: beside.holder,
            play: beside.play,
        }
    }
}

/// Range finders, beacons and inertial measurement units: 5 Hz.
#[derive(Serialize)]
#[serde(tag = "part", rename = "sensors")]
pub struct SensorsPart<'a> {
    sonars: Shown<'a, lowlevel::DataSrfs>,
    infrareds: Shown<'a, lowlevel::DataIrs>,
    /// All range finders, each with its own instant; `sonars` and `infrareds` are the view of 2011.
    ranges: Shown<'a, lowlevel::DataRanges>,
    /// What lidars see, each in its last revolution.
    scans: Vec<Shown<'a, Scan>>,
    beacons: Shown<'a, lowlevel::DataBeacons>,
    scanner: Shown<'a, lowlevel::DataScanner>,
    imus: Vec<Shown<'a, lowlevel::DataImu>>,
    /// People that the robot itself tracks.
    persons: Shown<'a, middlelevel::DataPersons>,
    /// True places of people: only the simulation knows them.
    people: Shown<'a, simulation::DataPeople>,
}

impl<'a> SensorsPart<'a> {
    /// State at `now`.
    pub fn of(model: &'a Model, now: Instant) -> Self {
        Self {
            sonars: model.sonars.shown(now),
            infrareds: model.infrareds.shown(now),
            ranges: model.ranges.shown(now),
            scans: model.scans.shown(now),
            beacons: model.beacons.shown(now),
            scanner: model.scanner.shown(now),
            imus: model.imus().map(|imu| imu.shown(now)).collect(),
            persons: model.persons.shown(now),
            people: model.people.shown(now),
        }
    }
}

/// Path and obstacles: on change, at most 2 Hz, and every 5 s.
#[derive(Serialize)]
#[serde(tag = "part", rename = "map")]
pub struct MapPart<'a> {
    plan: Shown<'a, middlelevel::DataPlan>,
    obstacles: Shown<'a, middlelevel::DataObstacles>,
}

impl<'a> MapPart<'a> {
    /// State at `now`.
    pub fn of(model: &'a Model, now: Instant) -> Self {
        Self { plan: model.plan.shown(now), obstacles: model.obstacles.shown(now) }
    }
}

/// Modules, devices, buses and faults: 1 Hz.
#[derive(Serialize)]
#[serde(tag = "part", rename = "system")]
pub struct SystemPart<'a> {
    modules: Vec<ModuleRow>,
    axes: Shown<'a, lowlevel::DataAxes>,
    wheels: Shown<'a, lowlevel::DataWheels>,
    power: Shown<'a, lowlevel::DataPower>,
    temperatures: Shown<'a, lowlevel::DataTemperature>,
    #[serde(rename = "busses")]
    buses: Vec<Shown<'a, lowlevel::DataBus>>,
    /// What the estimator makes of each beacon.
    beacon_use: Shown<'a, middlelevel::DataBeaconUse>,
    /// Parameters of the planner that can be changed while it runs: at most 32.
    parameters: Shown<'a, middlelevel::DataParameters>,
    log: Shown<'a, common::DataLog>,
    clock: Shown<'a, simulation::DataClock>,
    /// Time and world of a simulation with `--speed`; never received from another robot.
    run: Shown<'a, simulation::DataRun>,
    errors: Vec<ShownGroup<'a>>,
    /// Single reports, the latest first, at most 100.
    reports: Vec<Report<'a>>,
    /// The latest first, at most 100.
    texts: Vec<&'a ShownText>,
    channels: Vec<ChannelRow>,
    /// Number of connected pages and Foxglove clients.
    viewers: usize,
}

impl<'a> SystemPart<'a> {
    /// State at `now`.
    pub fn of(model: &'a Model, now: Instant, beside: ExtraState<'a>) -> Self {
        Self {
            modules: model.modules(now),
            axes: model.axes.shown(now),
            wheels: model.wheels.shown(now),
            power: model.power.shown(now),
            temperatures: model.temperatures.shown(now),
            buses: model.buses().map(|bus| bus.shown(now)).collect(),
            beacon_use: model.beacon_use.shown(now),
            parameters: model.parameters.shown(now),
            log: model.log.shown(now),
            clock: model.clock.shown(now),
            run: model.run.shown(now),
            errors: model.errors.groups(now),
            reports: model.errors.reports().take(REPORTS_MAX).map(Report::of).collect(),
            texts: model.texts.latest().take(TEXTS_MAX).collect(),
            channels: model.traffic.rows(now),
            viewers: beside.viewers,
        }
    }
}

/// Report of a fault, or of its end.
#[derive(Serialize)]
struct Report<'a> {
    /// Microseconds since the UNIX epoch.
    timestamp: i64,
    /// Reporting module.
    module: &'a str,
    /// Number of the fault (docs/faults.md).
    number: i32,
    /// Subject, such as a board or a drive; empty if there is none, or if it is unknown.
    subject: &'a str,
    /// Values of `error_t`; 0 also for the end of the fault.
    severity: i8,
    /// For people.
    message: &'a str,
    /// True if its module ends because of it.
    fatal: bool,
    /// Source file where it was made; empty if its module gave none.
    file: &'a str,
    /// Line of the file.
    line: i32,
}

impl<'a> Report<'a> {
    fn of(reported: &'a Reported) -> Self {
        let common::Error { timestamp, module, number, message, severity, fatal, file, line, .. } = &reported.error;
        let (timestamp, number, severity, fatal, line) = (*timestamp, *number, *severity, *fatal, *line);
        let subject = reported.subject.as_deref().unwrap_or_default();
        Self { timestamp, module, number, subject, severity, message, fatal, file, line }
    }
}
