//! Settings of the guard; SI units.

use crate::law::Law;
use base::Duration;
use kinematics::Polygon;
use kinematics::reach::{Ackermann, Base};
use navitools::Point;
use settings::robot::{Geometry, Limits};
use settings::{Corners, settings};
use surroundings::{Lidar, Rules, Sonar};

settings! {
    /// `[guard]`: with what the robot senses what is in its way, and how fast it may be (docs/guard.md). With
    /// `ranging = "none"` it senses nothing: it drives at most at `speed_blind_mps`, whoever commands it. So does a
    /// robot without this table: it has no guard, and 0.3 m/s, the default of `speed_blind_mps`.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Settings {
        /// What it senses with.
        ranging: Ranging = Ranging::None;
        /// Highest speed where nothing is sensed.
        speed_blind_mps as speed_blind: f64 = 0.3, 0.0..=2.0;
        /// Highest speed by hand past the guard, while a second input is held.
        creep_mps as creep: f64 = 0.15, 0.0..=0.3;
        /// From a measurement's arrival to the beginning of the deceleration; also the time in which the steering moves
        /// on.
        reaction_s as reaction: f64 = 0.12, 0.05..=2.0;
        /// From an obstacle's appearance to the arrival of its measurement.
        sensing_s as sensing: f64 = 0.25, 0.0..=2.0;
        /// Uncertainty of what is sensed, and of where the robot is when it is used.
        uncertainty_m as uncertainty: f64 = 0.05, 0.0..=0.5;
        /// Distance that is kept beyond that.
        clearance_m as clearance: f64 = 0.1, 0.0..=1.0;
        /// Speed of a person who approaches (ISO 13855: 1.6 m/s).
        approach_mps as approach: f64 = 1.6, 0.0..=2.5;
        /// Speed down to which the robot slows for somebody who may approach.
        slow_mps as slow: f64 = 0.3, 0.05..=2.0;
        /// Distance at which a sensor still finds a leg in clothes.
        reach_m as reach: f64 = 2.5, 0.3..=50.0;
        /// A sonar whose last reading is older than this is unknown.
        age_max_s as age_max: Duration = 0.8, 0.05..=5.0;
        /// Number of readings within twice `window_s` by which a sensor proves its space free; as many refute an echo.
        readings: u32 = 3, 1..=20;
        /// Time for which an echo counts.
        window_s as window: Duration = 1.0, 0.1..=5.0;
        /// Revolutions of a lidar in succession that must find something, or find a direction free.
        evaluations: u32 = 2, 1..=16;
        /// A direction of a lidar that was measured longer ago than this is unknown.
        scan_age_max_s as scan_age_max: Duration = 0.3, 0.05..=1.0;
        /// Fields of a form of their own, at most 8, beside those that are computed: they can only lower a bound.
        fields: Vec<FieldKeys> = [];
    }
    check Settings::check;
}

settings! {
    /// `[[guard.fields]]`: a polygon in the robot's frame; while something sensed or unknown is in it, the robot is no
    /// faster than it permits (docs/guard.md).
    #[derive(Clone, Debug, PartialEq)]
    pub struct FieldKeys {
        /// `"protective"`: the robot stands, but for moving away at `slow_mps`; `"warning"`: it slows to `slow_mps`.
        kind: FieldKind = required;
        /// Speed from which on the field counts: the robot slows to it, if that is more than the kind says.
        from_mps as from: f64 = 0.0, 0.0..=10.0;
        /// Corners, forward and to the left, one after the other around it; at most `reach_m` from the robot's outline.
        polygon_m as polygon: Vec<[f64; 2]> = required, Corners(-60.0..=60.0);
    }
}

settings! {
    /// What a field of a form of its own does.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum FieldKind {
        /// The robot stops.
        Protective = "protective",
        /// The robot slows down.
        Warning = "warning",
    }
}

settings! {
    /// What senses.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Ranging {
        /// Nothing.
        None = "none",
        /// The sonars of `srfs`.
        Sonar = "sonar",
        /// The lidars.
        Lidar = "lidar",
        /// Both: what either senses, or does not know, is in the way.
        SonarAndLidar = "sonar+lidar",
    }
}

impl Ranging {
    /// True if the sonars count.
    #[must_use]
    pub fn has_sonars(self) -> bool {
        matches!(self, Self::Sonar | Self::SonarAndLidar)
    }

    /// True if the lidars count.
    #[must_use]
    pub fn has_lidars(self) -> bool {
        matches!(self, Self::Lidar | Self::SonarAndLidar)
    }
}

/// Fields of a form of their own at most: as many are shown, too.
pub const FIELDS_MAX: usize = 8;

/// Configuration of the guard.
#[derive(Clone, Debug)]
pub struct Config {
    /// Keys of `[guard]`.
    pub settings: Settings,
    /// Outline of the robot; its convex hull counts.
    pub footprint: Vec<Point>,
    /// Sonars that the robot has; they are used if the settings say so.
    pub sonars: Vec<Sonar>,
    /// Lidars that it has, likewise.
    pub lidars: Vec<Lidar>,
    /// Kind of base.
    pub base: Base,
    /// Deceleration of a commanded stop, m/s².
    pub braking: f64,
    /// Deceleration when the motors lose their feed, m/s².
    pub power_lost: f64,
    /// Highest speed of any source, m/s.
    pub speed: f64,
}

impl Settings {
    fn check(&self, table: &settings::Table<'_>) {
        if self.age_max > self.window {
            table.refuse("age_max_s", "at most window_s");
        }
        if self.ranging == Ranging::None && !self.fields.is_empty() {
            table.refuse("fields", "none with ranging = \"none\": nothing would sense what is in them");
        }
        if self.fields.len() > FIELDS_MAX {
            table.refuse("fields", format_args!("at most {FIELDS_MAX} fields"));
        }
    }

    /// The law with these settings; decelerations of a commanded stop, and of a robot whose motors lose their feed,
    /// m/s².
    #[must_use]
    pub fn law(&self, braking: f64, power_lost: f64) -> Law {
        let worst = braking.min(power_lost);
        Law { reaction: self.reaction + self.sensing, braking, worst, approach: self.approach, slow: self.slow }
    }

    /// What proves space free, and for how long.
    #[must_use]
    pub fn rules(&self) -> Rules {
        let &Self { reach, uncertainty, age_max, readings, window, evaluations, scan_age_max, .. } = self;
        Rules { reach, uncertainty, age_max, readings, window, evaluations, scan_age_max }
    }
}

impl Config {
    /// The sonars that are used.
    #[must_use]
    pub fn sonars(&self) -> &[Sonar] {
        if self.settings.ranging.has_sonars() { &self.sonars } else { &[] }
    }

    /// The lidars that are used.
    #[must_use]
    pub fn lidars(&self) -> &[Lidar] {
        if self.settings.ranging.has_lidars() { &self.lidars } else { &[] }
    }

    /// Fields of a form of their own, by their places in the settings, that the sensors do not reach.
    #[must_use]
    pub fn beyond_reach(&self) -> Vec<usize> {
        let Some(body) = Polygon::hull(&self.footprint) else { return Vec::new() };
        let is_far = |[x, y]: &[f64; 2]| body.distance(Point { x: *x, y: *y }) > self.settings.reach;
        let fields = self.settings.fields.iter().enumerate();
        fields.filter(|(_, keys)| keys.polygon.iter().any(is_far)).map(|(place, _)| place).collect()
    }

    /// Configuration of a robot of these measures that steers.
    #[must_use]
    pub fn of(settings: Settings, geometry: &Geometry, limits: &Limits, power_lost: f64, sonars: Vec<Sonar>) -> Self {
        Self {
            settings,
            footprint: geometry.corners(),
            sonars,
            lidars: Vec::new(),
            base: Ackermann {
                wheelbase: geometry.wheelbase_m,
                steering: limits.steering_rad,
                steering_rate: limits.steering_rate_radps,
            }
            .into(),
            braking: limits.deceleration_mps2,
            power_lost,
            speed: limits.speed_mps,
        }
    }
}
