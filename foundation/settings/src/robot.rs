//! Sections that several modules share: measures and limits of the robot, beacons of where it drives.
//!
//! The robot's frame: origin on the floor under the middle of the rear axle, x forward, y to the left, angles
//! counter-clockwise.

use crate::settings;
use base::Duration;
use kinematics::Chassis;

settings! {
    /// `[geometry]`: measures of the robot.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Geometry {
        /// Rear axle to front axle.
        wheelbase_m: f64 = required, 0.05..=5.0;
        /// Distance of the front wheels.
        track_m: f64 = required, 0.05..=5.0;
        /// Radius of all wheels.
        wheel_radius_m: f64 = required, 0.01..=1.0;
        /// Bumper to bumper.
        length_m: f64 = required, 0.1..=10.0;
        /// Width.
        width_m: f64 = required, 0.1..=10.0;
        /// Rear axle to rear bumper.
        rear_overhang_m: f64 = required, 0.0..=5.0;
        /// Counts of a front wheel's encoder per turn.
        ticks_per_turn: u32 = required, 1..=1_000_000;
        /// What the propulsion of a base that steers drives.
        driven: DrivenAxle = DrivenAxle::Rear;
    }
}

settings! {
    /// DrivenAxle wheels of a base that steers.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum DrivenAxle {
        /// The rear axle.
        #[default]
        Rear = "rear",
        /// The single front wheel, which is steered too: a tricycle. Its drive measures the speed of its tread, which
        /// `limits.speed_mps` bounds as well.
        Front = "front",
    }
}

impl DrivenAxle {
    /// Speed of the driven tread per speed of the rear axle's middle, at this angle of the (equivalent) front wheel,
    /// rad.
    #[must_use]
    pub fn tread_ratio(self, steering_rad: f64) -> f64 {
        match self {
            Self::Rear => 1.0,
            Self::Front => 1.0 / libm::cos(steering_rad),
        }
    }
}

settings! {
    /// `[limits]`: bounds of motion. A command beyond `speed_mps` or `steering_rad` is refused and stops the robot; the
    /// others only slow it down.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Limits {
        /// Speed, either way.
        speed_mps: f64 = required, 0.01..=10.0;
        /// Highest speed under a manual source.
        speed_manual_mps: f64 = required, 0.01..=10.0;
        /// Highest speed under the planner.
        speed_autonomous_mps: f64 = required, 0.01..=10.0;
        /// Angle of the equivalent single front wheel, either way.
        steering_rad: f64 = required, 0.01..=1.5;
        /// Acceleration.
        acceleration_mps2: f64 = required, 0.01..=20.0;
        /// Deceleration of a stop that is commanded.
        deceleration_mps2: f64 = required, 0.01..=20.0;
        /// Deceleration of a stop after a fault.
        quick_stop_mps2: f64 = required, 0.01..=20.0;
        /// Lateral acceleration at the rear axle; caps the speed in curves.
        lateral_acceleration_mps2: f64 = required, 0.01..=20.0;
        /// Rate of the steering angle.
        steering_rate_radps: f64 = required, 0.01..=20.0;
        /// Rotation of a base without steering, either way; a command beyond it is refused and stops the robot. That of
        /// a steered base follows from speed and steering angle.
        rotation_radps: f64 = 1.0, 0.01..=20.0;
        /// Validity of a motion command.
        command_ttl_s as command_ttl: Duration = 0.25, 0.05..=1.0;
    }
}

settings! {
    /// `[base]`: a base that does not steer; the robot's frame has its origin in the middle of the wheels. Absent: a
    /// driven rear axle and steered front wheels, by `[geometry]`.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Base {
        layout: Layout = flat;
        /// Part of the rated torque of its motor by which a wheel may work against the others, of a base with more
        /// wheels than motions (mecanum, skid-steer, four or more omni wheels) whose drives report their torque (0x6077
        /// in a TPDO); more than that for 0.15 s stops the robot.
        strain: f64 = 0.3, 0.05..=10.0;
    }
}

settings! {
    /// Wheels of a base that does not steer, each with a drive of its own.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub enum Layout by kind {
        /// Two wheels on one axle, or two rows of wheels or tracks with one drive each. Axes `left`, `right`.
        Differential(Differential) = "differential",
        /// Two axles of two wheels that are dragged sideways in turns. Axes `front_left`, `front_right`, `rear_left`,
        /// `rear_right`.
        SkidSteer(Rectangle) = "skid-steer",
        /// Four mecanum wheels, whose rollers seen from above form an X. Axes as of `"skid-steer"`.
        Mecanum(Rectangle) = "mecanum",
        /// Omni wheels evenly on a circle, each rolling along it counter-clockwise. Axes `wheel_1` and so on.
        Omni(Circle) = "omni",
    }
}

settings! {
    /// Place of the wheels of a differential base.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Differential {
        /// Distance of the left and the right wheels. Of rows of wheels: the effective one, by which the difference of
        /// both sides' ways has to be divided to get the angle that the robot has turned by.
        track_m: f64 = required, 0.05..=5.0;
    }
}

settings! {
    /// Places of four wheels.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Rectangle {
        /// Rear wheels to front wheels.
        wheelbase_m: f64 = required, 0.05..=5.0;
        /// Distance of the left and the right wheels; of a skid-steer base the effective one.
        track_m: f64 = required, 0.05..=5.0;
    }
}

settings! {
    /// Places of wheels on a circle.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Circle {
        /// Radius of the circle.
        radius_m: f64 = required, 0.05..=5.0;
        /// Number of wheels.
        wheels: u8 = 3, 3..=6;
        /// Direction from the origin to the first wheel.
        first_rad: f64 = 0.0, -6.3..=6.3;
    }
}

settings! {
    /// An item of `beacons`: an infrared beacon in the frame of the map.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Beacon {
        /// Transmitted number.
        id: u8 = required, 0..=255;
        /// Position.
        x: f64 = required, -1e4..=1e4;
        /// Position.
        y: f64 = required, -1e4..=1e4;
    }
}

impl Geometry {
    /// Rear axle to front bumper, m.
    #[must_use]
    pub fn front_m(&self) -> f64 {
        self.length_m - self.rear_overhang_m
    }

    /// Distance of the farthest corner of the outline from the origin, m.
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        self.front_m().max(self.rear_overhang_m).hypot(self.width_m / 2.0)
    }

    /// Distance driven in one turn of a wheel, m.
    #[must_use]
    pub fn wheel_circumference_m(&self) -> f64 {
        2.0 * std::f64::consts::PI * self.wheel_radius_m
    }
}

/// Axes of four wheels.
const FOUR: [&str; 4] = ["front_left", "front_right", "rear_left", "rear_right"];
/// Axes of wheels on a circle.
const CIRCLE: [&str; 6] = ["wheel_1", "wheel_2", "wheel_3", "wheel_4", "wheel_5", "wheel_6"];

impl Base {
    /// Names of the axes, one for each wheel, in the order of the wheels of [`Base::chassis`].
    #[must_use]
    pub fn axes(&self) -> &'static [&'static str] {
        match &self.layout {
            Layout::Differential(_) => &["left", "right"],
            Layout::SkidSteer(_) | Layout::Mecanum(_) => &FOUR,
            Layout::Omni(circle) => CIRCLE.get(..usize::from(circle.wheels)).unwrap_or(&CIRCLE),
        }
    }

    /// True for a base that goes sideways.
    #[must_use]
    pub fn goes_sideways(&self) -> bool {
        matches!(self.layout, Layout::Mecanum(_) | Layout::Omni(_))
    }

    /// Distance of its wheels' treads from the middle, m: what they roll for each rad of a turn on the spot.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        match self.layout {
            Layout::Differential(Differential { track_m }) | Layout::SkidSteer(Rectangle { track_m, .. }) => {
                track_m / 2.0
            }
            Layout::Mecanum(Rectangle { wheelbase_m, track_m }) => (wheelbase_m + track_m) / 2.0,
            Layout::Omni(Circle { radius_m, .. }) => radius_m,
        }
    }

    /// Kinematics of the base.
    ///
    /// # Errors
    /// The first quantity that no base has.
    pub fn chassis(&self, limits: &Limits) -> Result<Chassis, kinematics::Error> {
        let wheel = kinematics::Limits {
            speed_mps: limits.speed_mps,
            acceleration_mps2: limits.acceleration_mps2,
            deceleration_mps2: limits.deceleration_mps2,
        };
        match self.layout {
            Layout::Differential(Differential { track_m }) => Chassis::differential(track_m, wheel),
            Layout::SkidSteer(Rectangle { wheelbase_m, track_m }) => {
                Chassis::skid_steer(track_m, &[wheelbase_m / 2.0, -wheelbase_m / 2.0], wheel)
            }
            Layout::Mecanum(Rectangle { wheelbase_m, track_m }) => Chassis::mecanum(wheelbase_m, track_m, wheel),
            Layout::Omni(Circle { radius_m, wheels, first_rad }) => {
                Chassis::omni(radius_m, usize::from(wheels), first_rad, wheel)
            }
        }
    }
}

impl Limits {
    /// Highest speed that a manual source can demand, m/s.
    #[must_use]
    pub fn manual_mps(&self) -> f64 {
        self.speed_manual_mps.min(self.speed_mps)
    }
}
