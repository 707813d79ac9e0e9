//! What the trajectory generator of an emulated drive makes of a target: ramps of speed, trapezoids of position.
//!
//! Units are the drive's own; a step is `dt` seconds.

/// A speed that follows its target on ramps (CiA 402 profile velocity with linear ramps).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpeedRamp {
    /// The demanded speed now.
    pub demand: f64,
}

impl SpeedRamp {
    /// Goes towards `target`: away from zero by `acceleration`, towards it by `deceleration`, per second.
    pub fn step(&mut self, target: f64, acceleration: f64, deceleration: f64, dt: f64) {
        let mut left = dt;
        if self.demand * target < 0.0 || libm::fabs(target) < libm::fabs(self.demand) {
            // Down to the target, or to zero on the way to the other side.
            let low = if self.demand * target > 0.0 { target } else { 0.0 };
            let time = libm::fabs(self.demand - low) / deceleration;
            if time > left {
                self.demand -= libm::copysign(deceleration * left, self.demand);
                return;
            }
            self.demand = low;
            left -= time;
        }
        let gap = target - self.demand;
        self.demand = if libm::fabs(gap) <= acceleration * left {
            target
        } else {
            self.demand + libm::copysign(acceleration * left, gap)
        };
    }
}

/// A position that follows its target with a trapezoid of speed (CiA 402 profile position).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PositionProfile {
    /// The demanded position now.
    pub demand: f64,
    /// The demanded speed now.
    pub speed: f64,
}

/// The limits of a profile: speed, and its changes per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Greatest speed.
    pub speed: f64,
    /// Gaining speed.
    pub acceleration: f64,
    /// Losing speed.
    pub deceleration: f64,
}

impl PositionProfile {
    /// Moves towards `target`, which may change at any time. Returns true at standstill on the target.
    pub fn step(&mut self, target: f64, limits: Limits, dt: f64) -> bool {
        let gap = target - self.demand;
        let one_step = limits.deceleration * dt;
        if libm::fabs(gap) <= one_step * dt && libm::fabs(self.speed) <= one_step {
            (self.demand, self.speed) = (target, 0.0);
            return true;
        }
        // The greatest speed at this step's end from which it still stops at the target: v dt/2 more is travelled in
        // the step itself.
        let half = one_step / 2.0;
        let distance = (libm::fabs(gap) - libm::fabs(self.speed) * dt / 2.0).max(0.0);
        let stoppable = libm::sqrt(half * half + 2.0 * limits.deceleration * distance) - half;
        let wanted = libm::copysign(stoppable.min(limits.speed), gap);
        self.run(wanted, limits, dt);
        false
    }

    /// Goes towards `target` and through it at the limit of speed; true when it is there or beyond.
    pub fn pass(&mut self, target: f64, limits: Limits, dt: f64) -> bool {
        let gap = target - self.demand;
        self.run(libm::copysign(limits.speed, gap), limits, dt);
        (target - self.demand) * gap <= 0.0
    }

    /// Runs at `speed` by the ramps.
    pub fn run(&mut self, speed: f64, limits: Limits, dt: f64) {
        let mut ramp = SpeedRamp { demand: self.speed };
        ramp.step(speed, limits.acceleration, limits.deceleration, dt);
        self.demand += (self.speed + ramp.demand) / 2.0 * dt;
        self.speed = ramp.demand;
    }

    /// Decelerates; returns true at standstill.
    pub fn stop(&mut self, deceleration: f64, dt: f64) -> bool {
        self.run(0.0, Limits { speed: 0.0, acceleration: deceleration, deceleration }, dt);
        self.speed == 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 0.005;

    fn steps(mut go_on: impl FnMut() -> bool) -> f64 {
        let mut n = 0;
        while go_on() {
            n += 1;
            assert!(n < 100_000, "it never gets there");
        }
        f64::from(n) * DT
    }

    #[test]
    fn ramps_take_as_long_as_their_slopes_say() {
        let mut ramp = SpeedRamp::default();
        let up = steps(|| {
            ramp.step(1500.0, 1000.0, 500.0, DT);
            ramp.demand < 1500.0
        });
        assert!((up - 1.5).abs() <= DT, "{up}");
        // Through zero: 3 s down at 500/s, 1 s up at 1000/s.
        let over = steps(|| {
            ramp.step(-1000.0, 1000.0, 500.0, DT);
            ramp.demand > -1000.0
        });
        assert!((over - 4.0).abs() <= DT, "{over}");
    }

    #[test]
    fn a_trapezoid_takes_its_time_and_does_not_overshoot() {
        for (start, target, limit) in [(0.0, 100.0, 20.0), (50.0, -50.0, 20.0), (0.0, 5.0, 20.0), (0.0, 0.01, 20.0)] {
            let limits = Limits { speed: limit, acceleration: 10.0, deceleration: 20.0 };
            let mut profile = PositionProfile { demand: start, speed: 0.0 };
            let mut most = 0.0f64;
            let time = steps(|| {
                let there = profile.step(target, limits, DT);
                most = most.max(libm::fabs(profile.demand - start));
                !there
            });
            let way = libm::fabs(target - start);
            let peak = libm::sqrt(2.0 * way / (1.0 / 10.0 + 1.0 / 20.0)).min(limit);
            let ramps = peak * peak / 2.0 * (1.0 / 10.0 + 1.0 / 20.0);
            let expected = peak / 10.0 + peak / 20.0 + (way - ramps) / peak;
            assert!((time - expected).abs() < 0.05, "{start} to {target}: {time} s, not {expected}");
            assert!(most <= way * (1.0 + 1e-9) + 1e-9, "{start} to {target}: overshoot by {}", most - way);
        }
    }

    #[test]
    fn a_target_behind_is_reached_after_turning_round() {
        let limits = Limits { speed: 20.0, acceleration: 10.0, deceleration: 20.0 };
        let mut profile = PositionProfile { demand: 0.0, speed: 20.0 };
        steps(|| !profile.step(1.0, limits, DT));
        assert_eq!((profile.demand, profile.speed), (1.0, 0.0));
    }

    #[test]
    fn a_stop_takes_the_way_of_its_deceleration() {
        let mut profile = PositionProfile { demand: 0.0, speed: 20.0 };
        steps(|| !profile.stop(40.0, DT));
        assert!((profile.demand - 5.0).abs() < 1e-9, "{}", profile.demand);
    }
}
