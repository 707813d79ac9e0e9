//! Speed and yaw rate from two steered, undriven front wheels, without the steering angle (docs/facts/robot.md 1.2).

use crate::{Ackermann, Motion};

/// Difference of two counts of a wrapping 16-bit counter; correct for up to ±32767 ticks between polls.
#[must_use]
pub fn tick_difference(new: i16, old: i16) -> i32 {
    i32::from(new.wrapping_sub(old))
}

/// Two steered front wheels with encoders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteeredWheels {
    /// Wheelbase L and track W.
    pub geometry: Ackermann,
}

impl SteeredWheels {
    /// Wheels of a robot with this wheelbase and track, m; both above zero.
    #[must_use]
    pub fn new(wheelbase_m: f64, track_m: f64) -> Self {
        Self { geometry: Ackermann { wheelbase_m, track_m } }
    }

    /// Motion that gives the hubs these speeds along their wheels, m/s (or distances, m); the sign is that of the
    /// faster wheel.
    ///
    /// Exact while the turning radius of the rear axle exceeds sqrt(L² + W²/4). Hub speeds that no such turn produces
    /// (ticks at standstill, a slipping wheel) are treated as the turn of that radius; opposite signs, as no turn.
    #[must_use]
    pub fn motion(&self, left: f64, right: f64) -> Motion {
        if left * right < 0.0 {
            return Motion { translation: (left + right) / 2.0, rotation: 0.0 };
        }
        let Ackermann { wheelbase_m: l, track_m: w } = self.geometry;
        let k = l * l + w * w / 4.0;
        let s = (left * left + right * right) / 2.0;
        let d = (right - left) * (right + left) / (2.0 * w);
        let root = libm::sqrt((s * s - 4.0 * d * d * k).max(0.0));
        let speed = libm::copysign(libm::sqrt((s + root) / 2.0), left + right);
        if speed == 0.0 {
            return Motion::default();
        }
        let most = libm::fabs(speed) / libm::sqrt(k);
        Motion { translation: speed, rotation: (d / speed).clamp(-most, most) }
    }

    /// Motion that wheels of unequal size add to the measured one, per metre, at this measured curvature, if they add a
    /// rotation of 1 rad/m straight ahead.
    ///
    /// In a turn the hubs' distances depend less on the curvature, so the same difference of the wheels adds more
    /// rotation. Computed for turns up to three quarters of the tightest that [`Self::motion`] can tell; beyond, as
    /// for that turn.
    #[must_use]
    pub fn unequal(&self, curvature: f64) -> Motion {
        let Ackermann { wheelbase_m: l, track_m: w } = self.geometry;
        let tightest = 0.75 / libm::sqrt(l * l + w * w / 4.0);
        let curvature = curvature.clamp(-tightest, tightest);
        let (left, right) = self.geometry.hub_ratios(curvature);
        // Derivatives of the logarithms of both ratios by the curvature.
        let by = |side: f64, ratio: f64| {
            (side * (1.0 + side * curvature * w / 2.0) * w / 2.0 + curvature * l * l) / ratio / ratio
        };
        let (left, right) = (by(-1.0, left), by(1.0, right));
        let more = w / (right - left);
        let translation = -more * (right + left) / 2.0;
        Motion { translation, rotation: more + curvature * translation }
    }
}

/// Number of ticks, of both wheels together, from which their difference determines the curvature; below it the last
/// curvature is kept.
const TICKS_FOR_A_TURN: i32 = 256;

/// Integrates the counts of both wheels to a path and a heading.
///
/// A turn is computed over enough ticks to exceed their quantisation, whatever the polling rate: slow driving neither
/// adds noise to the heading nor loses a part of it.
#[derive(Clone, Copy, Debug)]
pub struct Odometry {
    wheels: SteeredWheels,
    metres_per_tick: f64,
    counts: Option<(i16, i16)>,
    /// Ticks since the last computed turn.
    open: (i32, i32),
    /// Path and heading up to there.
    closed: Motion,
    curvature: f64,
    path: Motion,
    ticks: (i32, i32),
}

impl Odometry {
    /// Creates an odometry at zero; `metres_per_tick` is a wheel's circumference divided by its counts per turn.
    #[must_use]
    pub fn new(wheels: SteeredWheels, metres_per_tick: f64) -> Self {
        Self {
            wheels,
            metres_per_tick,
            counts: None,
            open: (0, 0),
            closed: Motion::default(),
            curvature: 0.0,
            path: Motion::default(),
            ticks: (0, 0),
        }
    }

    /// Processes the board's counters; returns the motion since the last call. The first call, and the first after
    /// [`Odometry::lost`], returns no motion.
    pub fn update(&mut self, left: i16, right: i16) -> Motion {
        let Some((old_left, old_right)) = self.counts.replace((left, right)) else {
            return Motion::default();
        };
        let (dl, dr) = (tick_difference(left, old_left), tick_difference(right, old_right));
        self.ticks = (self.ticks.0.wrapping_add(dl), self.ticks.1.wrapping_add(dr));
        self.open = (self.open.0 + dl, self.open.1 + dr);
        let before = self.path;
        let (l, r) = (f64::from(self.open.0) * self.metres_per_tick, f64::from(self.open.1) * self.metres_per_tick);
        if (self.open.0 + self.open.1).abs() >= TICKS_FOR_A_TURN {
            let way = self.wheels.motion(l, r);
            self.closed.translation += way.translation;
            self.closed.rotation += way.rotation;
            self.curvature = way.rotation / way.translation;
            self.open = (0, 0);
            self.path = self.closed;
        } else {
            let (ratio_left, ratio_right) = self.wheels.geometry.hub_ratios(self.curvature);
            let way = (l + r) / (ratio_left + ratio_right);
            self.path.translation = self.closed.translation + way;
            self.path.rotation = self.closed.rotation + way * self.curvature;
        }
        Motion {
            translation: self.path.translation - before.translation,
            rotation: self.path.rotation - before.rotation,
        }
    }

    /// Restarts from the next counters; called after a loss of the counters (a reset of the board, or silence longer
    /// than half a wrap).
    pub fn lost(&mut self) {
        self.counts = None;
    }

    /// Motion since the start: path, m, positive forwards, and heading, rad, not wrapped.
    #[must_use]
    pub fn path(&self) -> Motion {
        self.path
    }

    /// Ticks since the start, left and right.
    #[must_use]
    pub fn ticks(&self) -> (i32, i32) {
        self.ticks
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;

    const METRES_PER_TICK: f64 = 2.0 * PI * 0.100 / 4096.0;

    fn advee() -> SteeredWheels {
        SteeredWheels::new(0.60, 0.50)
    }

    #[test]
    fn hub_speeds_give_back_speed_and_yaw_rate_over_the_whole_range() {
        let wheels = advee();
        for speed in [-2.4, -1.2, -0.5, -1e-3, 1e-3, 0.3, 0.8, 1.2, 2.4] {
            for tenth in -350..=350 {
                let curvature = wheels.geometry.curvature((f64::from(tenth) / 10.0).to_radians());
                let (left, right) = wheels.geometry.hub_speeds(speed, curvature);
                let motion = wheels.motion(left, right);
                assert!(libm::fabs(motion.translation - speed) < 1e-12 * libm::fabs(speed).max(1.0), "{speed} {tenth}");
                assert!(libm::fabs(motion.rotation - speed * curvature) < 1e-12, "{speed} {tenth}: {motion:?}");
            }
        }
    }

    #[test]
    fn unequal_wheels_add_more_rotation_in_a_turn() {
        let wheels = SteeredWheels::new(0.6, 0.5);
        for curvature in [-1.1, -0.6, -0.1, 0.0, 0.3, 0.8, 1.1] {
            let true_way = Motion { translation: 1.0, rotation: curvature };
            let (left, right) = wheels.geometry.hub_speeds(1.0, curvature);
            let bend = 1e-5;
            // The left wheel counts more, the right one less: rotation to the left is missing.
            let measured = wheels.motion(left * (1.0 + bend * 0.25), right * (1.0 - bend * 0.25));
            let added = wheels.unequal(curvature);
            let (along, turn) = (true_way.translation - measured.translation, true_way.rotation - measured.rotation);
            assert!(libm::fabs(along / bend - added.translation) < 1e-3, "{curvature}: {along} {added:?}");
            assert!(libm::fabs(turn / bend - added.rotation) < 1e-3, "{curvature}: {turn} {added:?}");
        }
        assert!(libm::fabs(wheels.unequal(0.0).rotation - 1.0) < 1e-12);
        assert!(wheels.unequal(1.07).rotation > 2.5 && wheels.unequal(50.0).rotation < 4.0);
        assert!(wheels.unequal(f64::INFINITY).rotation.is_finite());
    }

    #[test]
    fn hub_speeds_that_no_turn_gives_stay_bounded() {
        let wheels = advee();
        assert_eq!(wheels.motion(0.0, 0.0), Motion::default());
        assert_eq!(wheels.motion(-0.1, 0.1), Motion::default());
        let most = 1.0 / libm::sqrt(0.36 + 0.0625);
        for (left, right) in [(0.0, 1e-3), (1e-3, 0.0), (-1e-3, 0.0), (0.1, 5.0), (1e-300, 0.0)] {
            let motion = wheels.motion(left, right);
            assert!(libm::fabs(motion.rotation) <= most * libm::fabs(motion.translation) * (1.0 + 1e-12), "{motion:?}");
        }
    }

    #[test]
    fn a_wrapping_counter_continues() {
        assert_eq!(tick_difference(-32768, 32767), 1);
        assert_eq!(tick_difference(32767, -32768), -1);
        assert_eq!(tick_difference(1000, -1000), 2000);
        let mut odometry = Odometry::new(advee(), METRES_PER_TICK);
        let mut count = 32_000i16;
        for _ in 0..100 {
            odometry.update(count, count);
            count = count.wrapping_add(1956);
        }
        let path = odometry.path();
        assert!(libm::fabs(path.translation - 99.0 * 1956.0 * METRES_PER_TICK) < 1e-9);
        assert_eq!((path.rotation, odometry.ticks()), (0.0, (99 * 1956, 99 * 1956)));
    }

    /// Drives a circle at full lock and polls every `step` metres; returns the true and the measured path and heading.
    fn circle(step: f64) -> (Motion, Motion) {
        let wheels = advee();
        let curvature = wheels.geometry.curvature(35f64.to_radians());
        let (left, right) = wheels.geometry.hub_ratios(curvature);
        let mut odometry = Odometry::new(wheels, METRES_PER_TICK);
        let polls = libm::round(10.0 / step) as i32;
        for poll in 0..=polls {
            let ticks = |ratio| libm::floor(f64::from(poll) * step * ratio / METRES_PER_TICK) as i64 as i16;
            odometry.update(ticks(left), ticks(right));
        }
        (odometry.path(), Motion { translation: 10.0, rotation: 10.0 * curvature })
    }

    #[test]
    fn a_circle_is_measured_alike_at_any_polling_rate() {
        for step in [0.25, 0.05, 0.01, 0.001, 0.0002] {
            let (seen, true_path) = circle(step);
            assert!(libm::fabs(seen.translation - true_path.translation) < 0.03, "{step}: {seen:?}");
            assert!(libm::fabs(seen.rotation - true_path.rotation) < 0.02 * true_path.rotation, "{step}: {seen:?}");
        }
    }

    #[test]
    fn a_lost_counter_restarts() {
        let mut odometry = Odometry::new(advee(), METRES_PER_TICK);
        odometry.update(500, 500);
        odometry.update(600, 600);
        odometry.lost();
        assert_eq!(odometry.update(0, 0), Motion::default());
        assert_eq!(odometry.ticks(), (100, 100));
    }
}
