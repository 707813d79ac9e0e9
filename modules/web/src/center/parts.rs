//! The parts of the view as modules/web/page/src/protocol.ts has them, from the model.

use base::Instant;
use diagnostics::{ChannelRow, Ellipse, HoldRow, Model, ModuleRow, Shown, ShownGroup, ShownText, Status};
use messages::{common, lowlevel, middlelevel, simulation};
use serde::Serialize;

/// Maximum number of texts in a part, the latest: it is sent once a second.
const TEXTS_MAX: usize = 100;

/// State that is not published on the bus.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExtraState<'a> {
    /// Web user that holds the motion authority.
    pub holder: Option<&'a serde_json::Value>,
    /// Number of viewers, including those of Foxglove.
    pub viewers: usize,
}

/// `DrivePart`
#[derive(Serialize)]
pub struct Drive<'a> {
    part: &'static str,
    status: Status,
    motion: Shown<'a, lowlevel::DataMotion>,
    holds: Vec<HoldRow>,
    commands: Vec<&'a lowlevel::CmdMotion>,
    stop: Shown<'a, lowlevel::EventStop>,
    odometry: Shown<'a, lowlevel::DataOdo>,
    estimate: Shown<'a, middlelevel::DataEstimate>,
    ellipse: Option<Ellipse>,
    goal: Shown<'a, middlelevel::DataGoal>,
    truth: Shown<'a, simulation::DataTruth>,
    gamepad: Shown<'a, lowlevel::DataJoydev>,
    holder: Option<&'a serde_json::Value>,
}

impl<'a> Drive<'a> {
    /// State at `now`.
    pub fn of(model: &'a Model, now: Instant, beside: ExtraState<'a>) -> Self {
        Self {
            part: "drive",
            status: model.status(now),
            motion: model.motion.shown(now),
            holds: model.hold_rows(now),
            commands: model.commands(now).collect(),
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

/// `SensorsPart`
#[derive(Serialize)]
pub struct Sensors<'a> {
    part: &'static str,
    sonars: Shown<'a, lowlevel::DataSrfs>,
    infrareds: Shown<'a, lowlevel::DataIrs>,
    ranges: Shown<'a, lowlevel::DataRanges>,
    beacons: Shown<'a, lowlevel::DataBeacons>,
}

impl<'a> Sensors<'a> {
    /// State at `now`.
    pub fn of(model: &'a Model, now: Instant) -> Self {
        Self {
            part: "sensors",
            sonars: model.sonars.shown(now),
            infrareds: model.infrareds.shown(now),
            ranges: model.ranges.shown(now),
            beacons: model.beacons.shown(now),
        }
    }
}

/// `MapPart`
#[derive(Serialize)]
pub struct Map<'a> {
    part: &'static str,
    plan: Shown<'a, middlelevel::DataPlan>,
    obstacles: Shown<'a, middlelevel::DataObstacles>,
}

impl<'a> Map<'a> {
    /// State at `now`.
    pub fn of(model: &'a Model, now: Instant) -> Self {
        Self { part: "map", plan: model.plan.shown(now), obstacles: model.obstacles.shown(now) }
    }
}

/// `SystemPart`
#[derive(Serialize)]
pub struct System<'a> {
    part: &'static str,
    modules: Vec<ModuleRow>,
    axes: Shown<'a, lowlevel::DataAxes>,
    power: Shown<'a, lowlevel::DataPower>,
    temperatures: Shown<'a, lowlevel::DataTemperature>,
    #[serde(rename = "busses")]
    buses: Vec<Shown<'a, lowlevel::DataBus>>,
    log: Shown<'a, common::DataLog>,
    clock: Shown<'a, simulation::DataClock>,
    errors: Vec<ShownGroup<'a>>,
    texts: Vec<&'a ShownText>,
    channels: Vec<ChannelRow>,
    viewers: usize,
}

impl<'a> System<'a> {
    /// State at `now`.
    pub fn of(model: &'a Model, now: Instant, beside: ExtraState<'a>) -> Self {
        Self {
            part: "system",
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
