//! Sections that several modules share: measures and limits of the robot, beacons of where it drives.
//!
//! The robot's frame: origin on the floor under the middle of the rear axle, x forward, y to the left, angles
//! counter-clockwise.

use crate::settings;
use base::Duration;

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
        /// Validity of a motion command.
        command_ttl_s as command_ttl: Duration = 0.25, 0.05..=1.0;
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

    /// Distance driven in one turn of a wheel, m.
    #[must_use]
    pub fn wheel_circumference_m(&self) -> f64 {
        2.0 * std::f64::consts::PI * self.wheel_radius_m
    }
}

impl Limits {
    /// Highest speed that a manual source can demand, m/s.
    #[must_use]
    pub fn manual_mps(&self) -> f64 {
        self.speed_manual_mps.min(self.speed_mps)
    }
}
