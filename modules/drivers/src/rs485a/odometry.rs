//! Conversion of the SO1's counters to `LL_DATA_ODO`, without jumps over gaps, resets and wraps.

use super::config::Wheels;
use base::{Duration, Instant};
use messages::lowlevel::DataOdo;
use navitools::odometry::{Odometry, SteeredWheels, tick_difference};

/// Maximum speed of a wheel relative to the robot's top speed: at full lock the outer front wheel travels 1.5 times the
/// distance of the rear axle's middle, and a robot may be pushed.
const WHEEL_SPEED_RATIO_MAX: f64 = 2.5;
/// Tolerance of the difference between two answers, ticks: a wheel may rock.
const ROCKING_TICKS: f64 = 32.0;
/// Maximum acceleration, m/s²; a greater change of a counter that is back near 0 indicates a reset.
const ACCELERATION_MPS2: f64 = 3.0;

/// Interpretation of an answer of the SO1.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// First values of the counters, or values after too long a gap: the distance is unknown.
    First,
    /// The change is impossible by driving: the board was reset. Used as first values.
    Jump {
        /// Difference of the left and the right wheel, ticks.
        ticks: (i32, i32),
    },
    /// Motion since the last answer.
    Motion(DataOdo),
}

/// Tracks the counters.
#[derive(Debug)]
pub struct Follower {
    odometry: Odometry,
    metres_per_tick: f64,
    ticks_per_s: f64,
    gap_max: Duration,
    last: Option<Last>,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    asked: Instant,
    /// Maximum time from `asked` to the measurement.
    late: Duration,
    counts: (i16, i16),
    /// The interval that ended with it, if known.
    interval: Option<Interval>,
}

/// Motion between two answers.
#[derive(Clone, Copy, Debug)]
struct Interval {
    seconds: f64,
    /// Ticks per second.
    speeds: (f64, f64),
    /// Uncertainty of `seconds`, since it is not known when exactly the board measured.
    late: f64,
}

impl Follower {
    pub fn new(wheels: &Wheels) -> Self {
        let metres_per_tick = wheels.metres_per_tick();
        let ticks_per_s = wheels.speed_max_mps / metres_per_tick;
        Self {
            odometry: Odometry::new(SteeredWheels::new(wheels.wheelbase_m, wheels.track_m), metres_per_tick),
            metres_per_tick,
            ticks_per_s: ticks_per_s * WHEEL_SPEED_RATIO_MAX,
            // Half the range of a 16-bit counter: 4.2 s for Advee (docs/facts/robot.md 1.2).
            gap_max: Duration::from_secs_f64((f64::from(i16::MAX) / ticks_per_s).min(3600.0)),
            last: None,
        }
    }

    /// Processes the counters of an answer, which the board read between `asked` and its reception at `at`, later than
    /// those of the previous one; `timestamp` goes into the message.
    pub fn answer(&mut self, asked: Instant, at: Instant, timestamp: i64, counts: (i16, i16)) -> Step {
        let first = Last { asked, late: at.since(asked), counts, interval: None };
        let Some(last) = self.last.replace(first).filter(|last| asked.since(last.asked) <= self.gap_max) else {
            self.start(counts);
            return Step::First;
        };
        let seconds = asked.since(last.asked).as_secs_f64().max(1e-6);
        let late = (first.late + last.late).as_secs_f64();
        let ticks = (tick_difference(counts.0, last.counts.0), tick_difference(counts.1, last.counts.1));
        let speeds = (f64::from(ticks.0) / seconds, f64::from(ticks.1) / seconds);
        let interval = Interval { seconds, speeds, late };
        if self.is_too_far(ticks, seconds + late) || self.was_reset(&last, counts, &interval) {
            self.start(counts);
            return Step::Jump { ticks };
        }
        self.last = Some(Last { interval: Some(interval), ..first });
        let motion = self.odometry.update(counts.0, counts.1);
        let path = self.odometry.path();
        let (ticks_left, ticks_right) = self.odometry.ticks();
        Step::Motion(DataOdo {
            timestamp,
            translation: motion.translation / seconds,
            rotation: motion.rotation / seconds,
            path: path.translation,
            heading: path.rotation,
            ticks_left,
            ticks_right,
        })
    }

    fn start(&mut self, (left, right): (i16, i16)) {
        self.odometry.lost();
        self.odometry.update(left, right);
    }

    fn is_too_far(&self, (left, right): (i32, i32), seconds: f64) -> bool {
        f64::from(left.abs().max(right.abs())) > self.ticks_per_s * seconds + ROCKING_TICKS
    }

    /// True if both counters moved towards 0, as near as driving since a reset allows, with a jump of the speed.
    fn was_reset(&self, last: &Last, counts: (i16, i16), now: &Interval) -> bool {
        let Some(before) = last.interval else {
            return false;
        };
        let near = self.ticks_per_s * now.seconds + ROCKING_TICKS;
        let nearer = |new: i16, old: i16| f64::from(new).abs() <= near && new.unsigned_abs() < old.unsigned_abs();
        let change = (now.speeds.0 - before.speeds.0).abs().max((now.speeds.1 - before.speeds.1).abs());
        // The speeds are means over two intervals: the acceleration acts over both.
        let accelerated = ACCELERATION_MPS2 * (now.seconds + before.seconds) / self.metres_per_tick;
        let fastest = [now.speeds.0, now.speeds.1, before.speeds.0, before.speeds.1].map(f64::abs);
        let fastest = fastest.into_iter().fold(0.0, f64::max).min(self.ticks_per_s);
        let unsure = fastest * (now.late + before.late * now.seconds / before.seconds);
        nearer(counts.0, last.counts.0)
            && nearer(counts.1, last.counts.1)
            && change * now.seconds > accelerated * now.seconds + unsure + ROCKING_TICKS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn follow(follower: &mut Follower, ms: u64, left: i16, right: i16) -> Step {
        follower.answer(Instant::from_millis(ms), Instant::from_millis(ms), 0, (left, right))
    }

    fn motion(step: Step) -> DataOdo {
        match step {
            Step::Motion(odo) => odo,
            other => panic!("{other:?}"),
        }
    }

    fn advee() -> Follower {
        Follower::new(&Wheels::default())
    }

    #[test]
    fn straight_driving_over_a_wrap_is_measured_in_metres_per_second() {
        let mut follower = advee();
        assert_eq!(follow(&mut follower, 0, 32_700, 32_700), Step::First);
        let odo = motion(follow(&mut follower, 100, -32_510, -32_510));
        // 326 ticks of 0.1534 mm in 0.1 s.
        assert!((odo.translation - 0.5001).abs() < 1e-3, "{odo:?}");
        assert_eq!((odo.rotation, odo.heading, odo.ticks_left, odo.ticks_right), (0.0, 0.0, 326, 326));
        assert!((odo.path - 0.0500).abs() < 1e-4);
    }

    #[test]
    fn standing_still_nothing_turns() {
        let mut follower = advee();
        follow(&mut follower, 0, 5, 7);
        let odo = motion(follow(&mut follower, 50, 5, 7));
        assert_eq!((odo.translation, odo.rotation), (0.0, 0.0));
    }

    #[test]
    fn after_a_gap_of_more_than_half_a_wrap_the_counters_start_anew() {
        let mut follower = advee();
        follow(&mut follower, 0, 0, 0);
        let odo = motion(follow(&mut follower, 100, 300, 300));
        assert_eq!(motion(follow(&mut follower, 4200, 20_300, 20_300)).ticks_left, 20_300);
        // 4.2 s later than the answer at 4.2 s: one more millisecond is too long.
        assert_eq!(follow(&mut follower, 8400, 30_000, 30_000), Step::First);
        let later = motion(follow(&mut follower, 8500, 30_010, 30_010));
        assert_eq!(later.ticks_left, 20_310);
        assert!(later.path > odo.path && later.translation < 0.1);
    }

    #[test]
    fn a_board_that_was_reset_makes_no_jump() {
        let mut follower = advee();
        follow(&mut follower, 0, 5000, 5000);
        follow(&mut follower, 50, 5200, 5200);
        assert_eq!(follow(&mut follower, 100, 12, 13), Step::Jump { ticks: (-5188, -5187) });
        let odo = motion(follow(&mut follower, 150, 212, 213));
        assert_eq!((odo.ticks_left, odo.ticks_right), (400, 400));
    }

    #[test]
    fn a_reset_at_small_counts_is_found_by_the_jump_of_the_speed() {
        let mut follower = advee();
        follow(&mut follower, 0, 300, 300);
        follow(&mut follower, 50, 400, 400);
        assert_eq!(follow(&mut follower, 100, 0, 0), Step::Jump { ticks: (-400, -400) });
    }

    #[test]
    fn braking_and_turning_back_near_zero_is_no_reset() {
        let mut follower = advee();
        let mut count = -2000.0;
        let mut speed: f64 = 1.2;
        follow(&mut follower, 10, -2000, -2000);
        for poll in 1..200 {
            // Quick stops from 1.2 m/s, back and forth across zero.
            speed = if poll % 40 < 20 { (speed - 1.5 * 0.05).max(-1.2) } else { (speed + 1.5 * 0.05).min(1.2) };
            count += speed * 0.05 / 1.534e-4;
            assert!(matches!(follow(&mut follower, 50 * poll, count as i16, count as i16), Step::Motion(_)), "{poll}");
        }
    }

    /// At 1.2 m/s across 0, with one answer of which the host hears 5 to 45 ms late, and one that it asks for late.
    #[test]
    fn a_late_turn_of_the_host_is_no_reset() {
        for late in (5..=45).step_by(5) {
            for phase in 0..50 {
                let mut follower = advee();
                let counts = |ms: u64| (-4000.0 - 7.8 * phase as f64 + 7.823 * ms as f64) as i16;
                for poll in 0..20 {
                    let asked = 50 * poll + if poll == 14 { late } else { 0 };
                    let at = asked + 3 + if poll == 9 { late } else { 0 };
                    let read = asked + if poll == 9 { late } else { 1 };
                    let (asked, at) = (Instant::from_millis(asked), Instant::from_millis(at));
                    let step = follower.answer(asked, at, 0, (counts(read), counts(read)));
                    assert!(!matches!(step, Step::Jump { .. }), "{late} ms late, poll {poll}, {phase}: {step:?}");
                }
            }
        }
    }

    #[test]
    fn a_reset_after_a_late_answer_is_found() {
        let mut follower = advee();
        let mut answer = |asked: u64, at: u64, count: i16| {
            follower.answer(Instant::from_millis(asked), Instant::from_millis(at), 0, (count, count))
        };
        answer(0, 3, 3000);
        answer(50, 83, 3391);
        assert_eq!(answer(100, 103, 5), Step::Jump { ticks: (-3386, -3386) });
    }
}
