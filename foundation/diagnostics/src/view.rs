//! Everything that is shown, at a moment: what `--json` prints and the web page is sent.

use crate::{ChannelRow, HoldRow, Model, ModuleRow, Shown, ShownGroup, ShownText, Status};
use base::Instant;
use messages::{common, lowlevel, middlelevel, simulation};
use serde::Serialize;

/// The model at a moment. Fields are as the messages have them (DESIGN 5), each with its age.
#[derive(Clone, Debug, Serialize)]
pub struct View<'a> {
    /// The robot's name.
    pub robot: &'a str,
    /// How it is.
    pub status: Status,
    /// How it moves.
    pub motion: Shown<'a, lowlevel::DataMotion>,
    /// All for which it does not act, the weightiest first.
    pub holds: Vec<HoldRow>,
    /// Who commands the motion.
    pub commands: Vec<&'a lowlevel::CmdMotion>,
    /// The PAUSE line.
    pub stop: Shown<'a, lowlevel::EventStop>,
    /// Where it is.
    pub estimate: Shown<'a, middlelevel::DataEstimate>,
    /// Where it is to two deviations, around the estimate.
    pub ellipse: Option<Ellipse>,
    /// How its goal fares.
    pub goal: Shown<'a, middlelevel::DataGoal>,
    /// Its way.
    pub plan: Shown<'a, middlelevel::DataPlan>,
    /// What stands around it.
    pub obstacles: Shown<'a, middlelevel::DataObstacles>,
    /// The sonars.
    pub sonars: Shown<'a, lowlevel::DataSrfs>,
    /// The infrared sensors.
    pub infrareds: Shown<'a, lowlevel::DataIrs>,
    /// Sonars and infrared sensors, each at its own instant, and whether its reading is known.
    pub ranges: Shown<'a, lowlevel::DataRanges>,
    /// The beacons that were seen.
    pub beacons: Shown<'a, lowlevel::DataBeacons>,
    /// The odometry.
    pub odometry: Shown<'a, lowlevel::DataOdo>,
    /// The drives.
    pub axes: Shown<'a, lowlevel::DataAxes>,
    /// Battery and channels.
    pub power: Shown<'a, lowlevel::DataPower>,
    /// Temperatures and fans.
    pub temperatures: Shown<'a, lowlevel::DataTemperature>,
    /// The gamepad.
    pub gamepad: Shown<'a, lowlevel::DataJoydev>,
    /// The recorder.
    pub log: Shown<'a, common::DataLog>,
    /// The truth, when simulated.
    pub truth: Shown<'a, simulation::DataTruth>,
    /// The modules.
    pub modules: Vec<ModuleRow>,
    /// The buses.
    #[serde(rename = "busses")]
    pub buses: Vec<Shown<'a, lowlevel::DataBus>>,
    /// What went wrong.
    pub errors: Vec<ShownGroup<'a>>,
    /// What modules say, the latest first.
    pub texts: Vec<&'a ShownText>,
    /// What is said on the bus.
    pub channels: Vec<ChannelRow>,
}

/// An ellipse of two standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ellipse {
    /// The long half axis, m.
    pub long: f64,
    /// The short half axis, m.
    pub short: f64,
    /// Where the long one points, rad.
    pub angle: f64,
    /// Two deviations of the heading, rad.
    pub heading: f64,
}

impl Ellipse {
    /// From the covariance of x, y, heading; none where that is none.
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
            holds: self.hold_rows(now),
            commands: self.commands(now).collect(),
            stop: self.stop.shown(now),
            estimate: self.estimate.shown(now),
            ellipse: self.estimate.get().and_then(|estimate| Ellipse::of(&estimate.covariance)),
            goal: self.goal.shown(now),
            plan: self.plan.shown(now),
            obstacles: self.obstacles.shown(now),
            sonars: self.sonars.shown(now),
            infrareds: self.infrareds.shown(now),
            ranges: self.ranges.shown(now),
            beacons: self.beacons.shown(now),
            odometry: self.odometry.shown(now),
            axes: self.axes.shown(now),
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
