//! Speed from which the robot can still be stopped: the law of the two fields, as pure functions.
//!
//! **Protective field** (ISO 3691-4:2023, 4.8 and Annex A: the truck stops before what is detected): its length at
//! speed `v` is `Z + v T + v² / 2a`: [`STANDING_GAP_M`], reaction and braking, with the least deceleration that the
//! configuration allows, including that of a robot whose motors lose their feed. Uncertainty and clearance are the
//! margin by which the outline is wider than the robot's.
//!
//! **Warning field** (ISO 13855:2024, S = K T + D_DS + Z; the protective separation distance of ISO/TS 15066:2016,
//! 5.5.4): until the robot stands still, somebody approaches at `K` for the whole time `T + v / b`, where `b` is the
//! deceleration of a commanded stop. Its length is `Z + K (T + v / b) + v T + v² / 2b`. Within it the robot slows down,
//! not below [`Law::slow`].

/// Length that remains free before an obstacle when the robot stands, m: if less is free, the robot does not start.
pub const STANDING_GAP_M: f64 = 0.05;
/// Speed below which a robot does not drive, m/s or rad/s.
pub const SPEED_MIN: f64 = 0.03;

/// Times and decelerations of the law; SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    /// From an obstacle's appearance to the beginning of the deceleration, s.
    pub reaction: f64,
    /// Deceleration of a commanded stop, m/s².
    pub braking: f64,
    /// Least deceleration that the configuration allows, m/s².
    pub worst: f64,
    /// Speed of a person who approaches, m/s.
    pub approach: f64,
    /// Speed down to which the warning field slows, m/s.
    pub slow: f64,
}

impl Law {
    /// Length of the protective field at a speed, m.
    #[must_use]
    pub fn protective(&self, speed: f64) -> f64 {
        STANDING_GAP_M + speed * self.reaction + speed * speed / (2.0 * self.worst)
    }

    /// Length of the warning field at a speed, m.
    #[must_use]
    pub fn warning(&self, speed: f64) -> f64 {
        let time = self.reaction + speed / self.braking;
        STANDING_GAP_M + self.approach * time + speed * self.reaction + speed * speed / (2.0 * self.braking)
    }

    /// Greatest speed whose protective field is at most `free` m long; 0 below [`SPEED_MIN`].
    #[must_use]
    pub fn stops_within(&self, free: f64) -> f64 {
        solve(free - STANDING_GAP_M, self.reaction, self.worst)
    }

    /// The same for a commanded stop: beside what a lidar saw move.
    #[must_use]
    pub fn brakes_within(&self, free: f64) -> f64 {
        self.meets_within(free, 0.0)
    }

    /// Greatest speed whose warning field is at most `free` m long, and not below [`Law::slow`].
    #[must_use]
    pub fn slows_within(&self, free: f64) -> f64 {
        self.meets_within(free, self.approach).max(self.slow)
    }

    /// Greatest speed from which the robot stops before something `free` m ahead that approaches at `closing` m/s all
    /// the time; 0 below [`SPEED_MIN`].
    #[must_use]
    pub fn stops_before(&self, free: f64, closing: f64) -> f64 {
        self.stops_within(free).min(self.meets_within(free, closing))
    }

    fn meets_within(&self, free: f64, closing: f64) -> f64 {
        let left = free - STANDING_GAP_M - closing * self.reaction;
        solve(left, self.reaction + closing / self.braking, self.braking)
    }
}

/// Greatest v with v T + v²/2a ≤ `free`.
fn solve(free: f64, time: f64, deceleration: f64) -> f64 {
    if free <= 0.0 {
        return 0.0;
    }
    let speed = deceleration * (libm::sqrt(time * time + 2.0 * free / deceleration) - time);
    if speed < SPEED_MIN { 0.0 } else { speed }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAW: Law = Law { reaction: 0.37, braking: 0.8, worst: 0.8, approach: 1.6, slow: 0.3 };

    #[test]
    fn speed_and_length_are_each_other_s_inverse() {
        for n in 1..=24 {
            let speed = f64::from(n) * 0.05;
            assert!((LAW.stops_within(LAW.protective(speed)) - speed).abs() < 1e-9, "{speed}");
            let slowed = LAW.slows_within(LAW.warning(speed));
            assert!((slowed - speed.max(LAW.slow)).abs() < 1e-9, "{speed}: {slowed}");
        }
    }

    #[test]
    fn nothing_is_permitted_without_room() {
        assert_eq!([LAW.stops_within(0.0), LAW.stops_within(STANDING_GAP_M), LAW.stops_within(-1.0)], [0.0; 3]);
        assert_eq!(LAW.slows_within(0.0), LAW.slow);
        assert!(LAW.stops_within(f64::INFINITY).is_infinite());
    }

    #[test]
    fn what_comes_nearer_and_what_rolls_without_power_need_more_room() {
        let rolling = Law { worst: 0.15, ..LAW };
        for free in [0.5, 1.0, 2.0] {
            assert!(rolling.stops_before(free, 0.0) < LAW.stops_before(free, 0.0));
            assert!(LAW.stops_before(free, 0.5) < LAW.stops_before(free, 0.0));
            assert_eq!(LAW.stops_before(free, 0.0), LAW.stops_within(free));
        }
    }

    #[test]
    fn the_figures_of_the_page_are_right() {
        let rounded = |value: f64| (value * 100.0).round() / 100.0;
        assert_eq!([0.3, 0.6, 0.8].map(|v| rounded(LAW.protective(v))), [0.22, 0.5, 0.75]);
        assert_eq!([0.3, 0.6, 0.8].map(|v| rounded(LAW.warning(v))), [1.41, 2.29, 2.94]);
    }
}
