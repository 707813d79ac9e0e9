//! Complete view at one instant: the output of `--json` and the data of the web page.

use crate::{Bound, ChannelRow, HoldRow, Model, ModuleRow, Scan, Shown, ShownGroup, ShownText, Status};
use base::Instant;
use messages::{common, lowlevel, middlelevel, simulation};
use serde::Serialize;

/// Model at one instant. Fields are those of the messages (`docs/design.md` 5), each with its age.
#[derive(Clone, Debug, Serialize)]
pub struct View<'a> {
    /// Name of the robot.
    pub robot: &'a str,
    /// Status.
    pub status: Status,
    /// Motion.
    pub motion: Shown<'a, lowlevel::DataMotion>,
    /// Velocity of the body.
    pub velocity: Shown<'a, lowlevel::DataVelocity>,
    /// Causes that hold the robot, the most important first.
    pub holds: Vec<HoldRow>,
    /// Recent motion commands.
    pub commands: Vec<&'a lowlevel::CmdMotion>,
    /// Recent motion commands of sources that command a velocity.
    pub velocity_commands: Vec<&'a lowlevel::CmdVelocity>,
    /// Greatest speeds that can still be stopped, and the fields.
    pub guard: Shown<'a, lowlevel::DataGuard>,
    /// The bound of these that holds; `null`: the robot has no guard.
    pub bound: Option<Bound>,
    /// PAUSE line.
    pub stop: Shown<'a, lowlevel::EventStop>,
    /// Estimated pose.
    pub estimate: Shown<'a, middlelevel::DataEstimate>,
    /// What the estimator makes of each beacon.
    pub beacon_use: Shown<'a, middlelevel::DataBeaconUse>,
    /// Ellipse of two standard deviations around the estimate.
    pub ellipse: Option<Ellipse>,
    /// State of the goal.
    pub goal: Shown<'a, middlelevel::DataGoal>,
    /// Operation mode of the planner.
    pub mode: Shown<'a, middlelevel::DataMode>,
    /// Parameters of the planner that can be changed while it runs.
    pub parameters: Shown<'a, middlelevel::DataParameters>,
    /// Planned path.
    pub plan: Shown<'a, middlelevel::DataPlan>,
    /// People that the planner tracks.
    pub persons: Shown<'a, middlelevel::DataPersons>,
    /// Sensed obstacles.
    pub obstacles: Shown<'a, middlelevel::DataObstacles>,
    /// Sonars.
    pub sonars: Shown<'a, lowlevel::DataSrfs>,
    /// Infrared sensors.
    pub infrareds: Shown<'a, lowlevel::DataIrs>,
    /// Sonars and infrared sensors, each at its own instant, with the status of its reading.
    pub ranges: Shown<'a, lowlevel::DataRanges>,
    /// What lidars see.
    pub scans: Vec<Shown<'a, Scan>>,
    /// Sighted beacons.
    pub beacons: Shown<'a, lowlevel::DataBeacons>,
    /// State of the beacon scanner.
    pub scanner: Shown<'a, lowlevel::DataScanner>,
    /// Inertial measurement units.
    pub imus: Vec<Shown<'a, lowlevel::DataImu>>,
    /// Odometry.
    pub odometry: Shown<'a, lowlevel::DataOdo>,
    /// Drives.
    pub axes: Shown<'a, lowlevel::DataAxes>,
    /// What the drives do and bear.
    pub wheels: Shown<'a, lowlevel::DataWheels>,
    /// Battery and channels.
    pub power: Shown<'a, lowlevel::DataPower>,
    /// Temperatures and fans.
    pub temperatures: Shown<'a, lowlevel::DataTemperature>,
    /// Gamepad.
    pub gamepad: Shown<'a, lowlevel::DataJoydev>,
    /// Logger.
    pub log: Shown<'a, common::DataLog>,
    /// True pose, in a simulation.
    pub truth: Shown<'a, simulation::DataTruth>,
    /// Modules.
    pub modules: Vec<ModuleRow>,
    /// Buses.
    #[serde(rename = "busses")]
    pub buses: Vec<Shown<'a, lowlevel::DataBus>>,
    /// Faults and reports.
    pub errors: Vec<ShownGroup<'a>>,
    /// Texts of modules, the newest first.
    pub texts: Vec<&'a ShownText>,
    /// Traffic by channel.
    pub channels: Vec<ChannelRow>,
}

/// Ellipse of two standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ellipse {
    /// Semi-major axis, m.
    pub long: f64,
    /// Semi-minor axis, m.
    pub short: f64,
    /// Direction of the major axis, rad.
    pub angle: f64,
    /// Two standard deviations of the heading, rad.
    pub heading: f64,
}

impl Ellipse {
    /// Ellipse of the covariance of x, y, heading; `None` if one of its values is not finite.
    #[must_use]
    pub fn of(covariance: &[[f64; 3]; 3]) -> Option<Self> {
        let (xx, xy, yy) = (covariance[0][0], covariance[0][1], covariance[1][1]);
        let (mean, half) = ((xx + yy) / 2.0, (xx - yy) / 2.0);
        let spread = libm::sqrt(half * half + xy * xy);
        let ellipse = Self {
            long: 2.0 * libm::sqrt(mean + spread),
            short: 2.0 * libm::sqrt((mean - spread).max(0.0)),
            angle: libm::atan2(xy, half + spread),
            heading: 2.0 * libm::sqrt(covariance[2][2]),
        };
        let numbers = [ellipse.long, ellipse.short, ellipse.angle, ellipse.heading];
        numbers.iter().all(|number| number.is_finite()).then_some(ellipse)
    }
}

impl Model {
    /// Everything that is shown.
    #[must_use]
    pub fn view(&self, now: Instant) -> View<'_> {
        View {
            robot: self.robot(),
            status: self.status(now),
            motion: self.motion.shown(now),
            velocity: self.velocity.shown(now),
            holds: self.hold_rows(now),
            commands: self.commands(now).collect(),
            velocity_commands: self.velocity_commands(now).collect(),
            guard: self.guard.shown(now),
            bound: self.bound(now),
            stop: self.stop.shown(now),
            estimate: self.estimate.shown(now),
            beacon_use: self.beacon_use.shown(now),
            ellipse: self.estimate.get().and_then(|estimate| Ellipse::of(&estimate.covariance)),
            goal: self.goal.shown(now),
            mode: self.mode.shown(now),
            parameters: self.parameters.shown(now),
            plan: self.plan.shown(now),
            persons: self.persons.shown(now),
            obstacles: self.obstacles.shown(now),
            sonars: self.sonars.shown(now),
            infrareds: self.infrareds.shown(now),
            ranges: self.ranges.shown(now),
            scans: self.scans.shown(now),
            beacons: self.beacons.shown(now),
            scanner: self.scanner.shown(now),
            imus: self.imus().map(|imu| imu.shown(now)).collect(),
            odometry: self.odometry.shown(now),
            axes: self.axes.shown(now),
            wheels: self.wheels.shown(now),
            power: self.power.shown(now),
            temperatures: self.temperatures.shown(now),
            gamepad: self.gamepad.shown(now),
            log: self.log.shown(now),
            truth: self.truth.shown(now),
            modules: self.modules(now),
            buses: self.buses().map(|bus| bus.shown(now)).collect(),
            errors: self.errors.groups(now),
            texts: self.texts.latest().collect(),
            channels: self.traffic.rows(now),
        }
    }
}
