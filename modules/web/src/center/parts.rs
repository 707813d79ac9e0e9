//! The parts of the view that are sent again and again, from the model.

use super::authority::Holder;
use base::Instant;
use diagnostics::{Bound, ChannelRow, Ellipse, HoldRow, Model, ModuleRow, Shown, ShownGroup, ShownText, Status};
use messages::{common, lowlevel, middlelevel, simulation};
use serde::Serialize;

/// Maximum number of texts in a part, the latest: it is sent once a second.
const TEXTS_MAX: usize = 100;

/// State that is not published on the bus.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExtraState<'a> {
    /// Web user that holds the motion authority.
    pub holder: Option<&'a Holder>,
    /// Number of viewers, including those of Foxglove.
    pub viewers: usize,
}

/// Motion, position and goal: 10 Hz, always. Without one for 1 s the connection is lost.
#[derive(Serialize)]
#[serde(tag = "part", rename = "drive")]
pub struct DrivePart<'a> {
    status: Status,
    motion: Shown<'a, lowlevel::DataMotion>,
    /// All causes for which the robot or its goal is held; empty: it acts.
    holds: Vec<HoldRow>,
    /// The motion commands of all sources.
    commands: Vec<&'a lowlevel::CmdMotion>,
    /// Greatest speeds that can still be stopped, and the fields in the robot's frame: at most 4, of 64 corners.
    guard: Shown<'a, lowlevel::DataGuard>,
    /// The bound of these that holds; `null`: the robot has no guard.
    bound: Option<Bound>,
    stop: Shown<'a, lowlevel::EventStop>,
    odometry: Shown<'a, lowlevel::DataOdo>,
    estimate: Shown<'a, middlelevel::DataEstimate>,
    ellipse: Option<Ellipse>,
    goal: Shown<'a, middlelevel::DataGoal>,
    truth: Shown<'a, simulation::DataTruth>,
    gamepad: Shown<'a, lowlevel::DataJoydev>,
    /// Holder of the motion authority among the web clients.
    holder: Option<&'a Holder>,
}

impl<'a> DrivePart<'a> {
    /// State at `now`.
    pub fn of(model: &'a Model, now: Instant, beside: ExtraState<'a>) -> Self {
        Self {
            status: model.status(now),
            motion: model.motion.shown(now),
            holds: model.hold_rows(now),
            commands: model.commands(now).collect(),
            guard: model.guard.shown(now),
            bound: model.bound(now),
            stop: model.stop.shown(now),
            odometry: model.odometry.shown(now),
            estimate: model.estimate.shown(now),
            ellipse: model.estimate.get().and_then(|estimate| Ellipse::of(&estimate.covariance)),
            goal: model.goal.shown(now),
            truth: model.truth.shown(now),
            gamepad: model.gamepad.shown(now),
            holder: beside.holder,
        }
    }
}

/// Range finders and beacons: 5 Hz.
#[derive(Serialize)]
#[serde(tag = "part", rename = "sensors")]
pub struct SensorsPart<'a> {
    sonars: Shown<'a, lowlevel::DataSrfs>,
    infrareds: Shown<'a, lowlevel::DataIrs>,
    /// All range finders, each with its own instant; `sonars` and `infrareds` are the view of 2011.
    ranges: Shown<'a, lowlevel::DataRanges>,
    beacons: Shown<'a, lowlevel::DataBeacons>,
}

impl<'a> SensorsPart<'a> {
    /// State at `now`.
    pub fn of(model: &'a Model, now: Instant) -> Self {
        Self {
            sonars: model.sonars.shown(now),
            infrareds: model.infrareds.shown(now),
            ranges: model.ranges.shown(now),
            beacons: model.beacons.shown(now),
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
    power: Shown<'a, lowlevel::DataPower>,
    temperatures: Shown<'a, lowlevel::DataTemperature>,
    #[serde(rename = "busses")]
    buses: Vec<Shown<'a, lowlevel::DataBus>>,
    log: Shown<'a, common::DataLog>,
    clock: Shown<'a, simulation::DataClock>,
    errors: Vec<ShownGroup<'a>>,
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
            power: model.power.shown(now),
            temperatures: model.temperatures.shown(now),
            buses: model.buses().map(|bus| bus.shown(now)).collect(),
            log: model.log.shown(now),
            clock: model.clock.shown(now),
            errors: model.errors.groups(now),
            texts: model.texts.latest().take(TEXTS_MAX).collect(),
            channels: model.traffic.rows(now),
            viewers: beside.viewers,
        }
    }
}
