//! Rotation by an inertial measurement unit in place of that by the wheels, and their disagreement.

use base::{Duration, Instant};
use messages::lowlevel::DataImu;

/// A measurement older than this says nothing of the present: the wheels count.
const AGE_MAX: Duration = Duration::from_millis(100);
/// Longest step over which the rotation is taken as a whole.
const STEP_MAX: Duration = Duration::from_millis(300);
/// Rotation below which wheels that stand are believed: its zero is known no better, rad/s.
const STANDS_RADPS: f64 = 0.02;
/// Tolerated difference from the rotation by the wheels: rad/s, and relative.
const DIFFERENCE_MAX: (f64, f64) = (0.1, 0.15);
/// Time that they must differ before the wheels count as slipping, and agree before they no longer do.
const SLIPS_AFTER: Duration = Duration::from_millis(300);
const AGREES_AFTER: Duration = Duration::from_secs(1);

/// Rotation over a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Mean over the step, rad/s.
    pub radps: f64,
    /// The wheels turn the robot otherwise: their way is uncertain, too.
    pub slips: bool,
}

/// State of the unit.
#[derive(Debug)]
pub struct Gyro {
    name: String,
    /// Last measurement: its instant, the rate, rad/s, and the rotation since the first one, rad.
    last: Option<(Instant, f64, f64)>,
    /// End of the last step, and the rotation up to there.
    step: Option<(Instant, f64)>,
    /// Since when wheels and unit do not say what `slips` does.
    changes_since: Option<Instant>,
    slips: bool,
}

impl Gyro {
    pub fn new(name: String) -> Self {
        Self { name, last: None, step: None, changes_since: None, slips: false }
    }

    /// Takes a measurement of `at`. One that is not OK ends the use of the unit until the next one.
    pub fn on_imu(&mut self, at: Instant, imu: &DataImu) {
        if imu.name != self.name {
            return;
        }
        let rate = imu.rotation[2];
        if imu.status != DataImu::OK || !rate.is_finite() {
            self.forget();
            return;
        }
        self.last = Some(match self.last {
            Some((then, before, turned)) if at > then && at.since(then) <= AGE_MAX => {
                (at, rate, turned + (before + rate) / 2.0 * at.since(then).as_secs_f64())
            }
            Some((then, ..)) if at <= then => return,
            _ => {
                self.step = None;
                (at, rate, 0.0)
            }
        });
    }

    /// Rotation of the step from `from` to `until`, over which the wheels measured `by_wheels` rad/s. `None`: the
    /// wheels count, since the unit says nothing of the whole step, or since both stand.
    pub fn turn(&mut self, from: Instant, until: Instant, by_wheels: f64, wheels_stand: bool) -> Option<Turn> {
        let Some((at, rate, turned)) = self.last.filter(|(at, ..)| until.since(*at) <= AGE_MAX) else {
            self.forget();
            return None;
        };
        // Up to the end of the step by the last rate; the next step makes good what that errs.
        let rest = until.since(at).as_secs_f64() - at.since(until).as_secs_f64();
        let end = turned + rate * rest;
        let (begun, begin) = self.step.replace((until, end))?;
        if begun != from || until <= from || until.since(from) > STEP_MAX {
            return None;
        }
        let radps = (end - begin) / until.since(from).as_secs_f64();
        self.compare(until, radps, by_wheels);
        if wheels_stand && radps.abs() < STANDS_RADPS {
            return None;
        }
        Some(Turn { radps, slips: self.slips })
    }

    /// True while the wheels turn the robot otherwise than the unit measures.
    pub fn slips(&self) -> bool {
        self.slips
    }

    fn forget(&mut self) {
        (self.last, self.step, self.changes_since, self.slips) = (None, None, None, false);
    }

    fn compare(&mut self, now: Instant, radps: f64, by_wheels: f64) {
        let differ = (radps - by_wheels).abs() > DIFFERENCE_MAX.0 + DIFFERENCE_MAX.1 * radps.abs();
        if differ == self.slips {
            self.changes_since = None;
            return;
        }
        let after = if differ { SLIPS_AFTER } else { AGREES_AFTER };
        if now.since(*self.changes_since.get_or_insert(now)) >= after {
            (self.slips, self.changes_since) = (differ, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn imu(status: i8, rate: f64) -> DataImu {
        DataImu { name: "base".into(), status, rotation: [0.0, 0.0, rate], ..DataImu::default() }
    }

    fn at(ms: u64) -> Instant {
        Instant::from_millis(1000 + ms)
    }

    /// Rotation of steps of 50 ms while a unit of 100 Hz measures `rate`, from `begin` ms to `end` ms.
    fn steps(gyro: &mut Gyro, begin: u64, end: u64, rate: impl Fn(u64) -> f64, by_wheels: f64) -> Vec<Option<Turn>> {
        let mut turns = Vec::new();
        for ms in (begin..=end).step_by(10) {
            // A measurement comes 4 ms late.
            gyro.on_imu(at(ms) - Duration::from_millis(4), &imu(DataImu::OK, rate(ms)));
            if ms % 50 == 0 {
                turns.push(gyro.turn(at(ms.saturating_sub(50)), at(ms), by_wheels, by_wheels == 0.0));
            }
        }
        turns
    }

    #[test]
    fn steps_add_up_to_the_whole_rotation() {
        let mut gyro = Gyro::new("base".into());
        // Speeds up from 0 to 1 rad/s within a second, then turns at 1 rad/s.
        let turns = steps(&mut gyro, 0, 3000, |ms| (ms as f64 / 1000.0).min(1.0), 0.5);
        assert_eq!(turns[0], None, "no step has begun");
        let whole: f64 = turns[1..].iter().map(|turn| turn.unwrap().radps * 0.05).sum();
        assert!((whole - 2.5).abs() < 0.01, "{whole}");
    }

    #[test]
    fn what_is_old_not_ok_or_of_another_unit_leaves_it_to_the_wheels() {
        let mut gyro = Gyro::new("base".into());
        assert!(steps(&mut gyro, 0, 200, |_| 0.3, 0.3)[1..].iter().all(Option::is_some));
        gyro.on_imu(at(205), &DataImu { name: "top".into(), ..imu(DataImu::FAULT, 9.0) });
        assert!(gyro.turn(at(200), at(250), 0.3, false).is_some());
        assert_eq!(gyro.turn(at(250), at(320), 0.3, false), None, "older than 100 ms");
        assert_eq!(steps(&mut gyro, 350, 350, |_| 0.3, 0.3), [None]);
        assert!(steps(&mut gyro, 360, 400, |_| 0.3, 0.3)[0].is_some());
        for status in [DataImu::UNCALIBRATED, DataImu::IMPLAUSIBLE, DataImu::FAULT] {
            gyro.on_imu(at(410), &imu(status, 0.3));
            assert_eq!(gyro.turn(at(400), at(450), 0.3, false), None, "{status}");
        }
        gyro.on_imu(at(460), &imu(DataImu::OK, f64::NAN));
        assert_eq!(gyro.turn(at(450), at(500), 0.3, false), None);
    }

    #[test]
    fn wheels_that_turn_the_robot_otherwise_slip_and_stop_slipping() {
        let mut gyro = Gyro::new("base".into());
        let turns = steps(&mut gyro, 0, 1000, |_| 0.2, 0.6);
        let first = turns.iter().position(|turn| turn.is_some_and(|turn| turn.slips)).unwrap();
        assert!((300..=400).contains(&(50 * first)), "{first}");
        let turns = steps(&mut gyro, 1010, 3000, |_| 0.55, 0.6);
        let end = turns.iter().position(|turn| turn.is_some_and(|turn| !turn.slips)).unwrap();
        assert!((950..=1150).contains(&(50 * end)), "{end}");
    }

    #[test]
    fn a_robot_whose_wheels_stand_stands_unless_it_is_turned() {
        let mut gyro = Gyro::new("base".into());
        assert!(steps(&mut gyro, 0, 500, |_| 0.01, 0.0).iter().all(Option::is_none));
        let turns = steps(&mut gyro, 510, 1500, |_| 0.5, 0.0);
        assert!(turns.last().unwrap().unwrap().slips);
    }
}
