//! Watches over an axis that is asked to move: at least a quarter of the target speed ([`Follow`]), or of the way to
//! the target position ([`Reach`]), must be reached within twice the time that it takes and a second. They find an axis
//! that stands, creeps, or runs the other way round, in whatever mode and for whatever reason, also where the drive
//! itself has no following error or does not report it; one that is slower for a limit of its current or voltage
//! follows. An axis in a position mode may be allowed less time for making no way at all: with a dead or reversed
//! encoder its loop moves it on.

use base::{Duration, Instant};

/// Part of the target speed, or of the way to the target position, that must be reached.
const PART: f64 = 0.25;
/// Part of the least deviation by which an axis moves that does not stand.
const MOVES: f64 = 1.0 / 3.0;
/// Time in which an axis that moved has stopped, to turn round.
const TURNS: Duration = Duration::from_millis(150);
/// Time allowed beyond the ramp, or the way.
const REACTION: Duration = Duration::from_secs(1);

/// Properties of the axis, in the caller's unit of speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowConfig {
    /// Slower one of the ramps of acceleration and deceleration, per second.
    pub ramp: f64,
    /// Targets below this are not judged: the resolution of the measured speed.
    pub least: f64,
}

/// An axis does not follow its target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NotFollowing {
    /// Commanded speed or position.
    pub target: f64,
    /// Measured speed or position.
    pub measured: f64,
}

/// The watch over an axis in a velocity mode.
#[derive(Clone, Copy, Debug)]
pub struct Follow {
    config: FollowConfig,
    target: f64,
    measured: f64,
    /// The axis must have reached its part by then; absent while it is not asked to move.
    until: Option<Instant>,
}

impl Follow {
    /// An axis that is not asked to move.
    #[must_use]
    pub fn new(config: FollowConfig) -> Self {
        Self { config, target: 0.0, measured: 0.0, until: None }
    }

    /// The target in force; `None` while the axis is not enabled, or stops.
    pub fn command(&mut self, now: Instant, target: Option<f64>) {
        let Some(target) = target.filter(|target| libm::fabs(*target) >= self.config.least) else {
            self.until = None;
            return;
        };
        let turned = (target < 0.0) != (self.target < 0.0);
        self.target = target;
        if self.until.is_none() || turned {
            self.arm(now);
        }
    }

    /// A measured speed. Returns the alarm once, and again after as long a time.
    pub fn measure(&mut self, now: Instant, speed: f64) -> Option<NotFollowing> {
        self.measured = speed;
        let until = self.until?;
        if speed * self.target.signum() >= PART * libm::fabs(self.target) {
            self.arm(now);
            return None;
        }
        if now < until {
            return None;
        }
        self.arm(now);
        Some(NotFollowing { target: self.target, measured: speed })
    }

    fn arm(&mut self, now: Instant) {
        // One that runs the other way round has to stop first.
        let change = libm::fabs(self.target) + (-self.measured * self.target.signum()).max(0.0);
        let ramp = Duration::from_secs_f64(2.0 * change / self.config.ramp.max(f64::MIN_POSITIVE));
        self.until = Some(now + REACTION + ramp.min(Duration::from_secs(60)));
    }
}

/// Properties of the axis, in the caller's unit of position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReachConfig {
    /// Speed of the axis, per second.
    pub speed: f64,
    /// Deviations up to this are not judged: play, and the resolution of the measured position.
    pub least: f64,
    /// For how long it may make less way towards its target than a third of `least`; absent: as long as it is allowed
    /// for a quarter of the way.
    pub stands_max: Option<Duration>,
}

/// The watch over an axis in a position mode.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    config: ReachConfig,
    target: Option<f64>,
    measured: f64,
    /// Way from the position measured before; NaN if unknown.
    step: f64,
    watch: Option<Way>,
}

/// Way that the axis must make.
#[derive(Clone, Copy, Debug)]
struct Way {
    /// Remaining way to be made towards the target.
    left: f64,
    until: Instant,
    /// Remaining way, and when it was last found to be less by what is no standstill.
    moved: (f64, Instant),
    /// The target, direction to it, and the position nearest to it so far: one that moves to and fro makes no way.
    target: f64,
    direction: f64,
    reached: f64,
    /// Since when it turns round: its target has moved to its other side, and it only moves away from it, as it has to
    /// stop first. It makes its way from where it has stopped.
    turns: Option<Instant>,
}

impl Way {
    /// Takes the way made from one measured position to the next.
    fn take(&mut self, now: Instant, target: f64, least: f64, (before, position): (f64, f64)) {
        let direction = (target - self.reached).signum();
        if direction != self.direction || libm::fabs(target - self.target) > least {
            let direction = (target - before).signum();
            if direction != self.direction {
                let moved = now.since(self.moved.1) < TURNS;
                self.turns = moved.then_some(now);
            }
            (self.target, self.direction, self.reached) = (target, direction, before);
        }
        self.turns = self.turns.filter(|_| (position - before) * self.direction < 0.0);
        if let Some(since) = self.turns {
            self.reached = position;
            if now.since(since) < TURNS {
                self.moved.1 = now;
            }
        }
        let made = (position - self.reached) * self.direction;
        if made > 0.0 {
            self.left -= made;
            self.reached = position;
        }
    }
}

impl Reach {
    /// An axis that is not asked to move.
    #[must_use]
    pub fn new(config: ReachConfig) -> Self {
        Self { config, target: None, measured: f64::NAN, step: f64::NAN, watch: None }
    }

    /// The target in force; `None` while the axis is not enabled, or does something else.
    pub fn command(&mut self, now: Instant, target: Option<f64>) {
        self.target = target;
        match target {
            None => self.watch = None,
            Some(_) if self.watch.is_none() => self.arm(now),
            Some(_) => {}
        }
    }

    /// A measured position. Returns the alarm once, and again after as long a time.
    pub fn measure(&mut self, now: Instant, position: f64) -> Option<NotFollowing> {
        let before = core::mem::replace(&mut self.measured, position);
        self.step = position - before;
        let target = self.target?;
        let Some(way) = &mut self.watch else {
            self.arm(now);
            return None;
        };
        way.take(now, target, self.config.least, (before, position));
        if way.left <= way.moved.0 - MOVES * self.config.least {
            way.moved = (way.left, now);
        }
        let stands = self.config.stands_max.is_some_and(|most| now.since(way.moved.1) >= most);
        let alarm = stands || now >= way.until;
        if way.left > 0.0 && !alarm && libm::fabs(target - position) > self.config.least {
            return None;
        }
        let follows = way.left <= 0.0;
        self.arm(now);
        (alarm && !follows && self.watch.is_some()).then_some(NotFollowing { target, measured: position })
    }

    /// True while the axis has a way to make: its position is to be measured often.
    #[must_use]
    pub fn is_under_way(&self) -> bool {
        self.watch.is_some()
    }

    /// Begins with the way from here. Within the least deviation, or at an unknown position, nothing is watched.
    fn arm(&mut self, now: Instant) {
        let target = self.target.unwrap_or(self.measured);
        let way = libm::fabs(target - self.measured);
        let takes = Duration::from_secs_f64((2.0 * way / self.config.speed.max(f64::MIN_POSITIVE)).min(60.0));
        let direction = (target - self.measured).signum();
        self.watch = (way > self.config.least).then(|| Way {
            left: PART * way,
            until: now + REACTION + takes,
            moved: (PART * way, now),
            target,
            direction,
            reached: self.measured,
            turns: (self.step * direction < 0.0).then_some(now),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: FollowConfig = FollowConfig { ramp: 0.5, least: 0.05 };

    /// Commands `target` and measures what `speed` gives for the time in s, each 10 ms; the time of the first alarm.
    fn run(follow: &mut Follow, target: f64, speed: impl Fn(f64) -> f64, s: f64) -> Option<f64> {
        let begin = 100.0;
        (0..(s * 100.0) as u32).map(|step| f64::from(step) / 100.0).find(|at| {
            let now = Instant::ZERO + Duration::from_secs_f64(begin + at);
            follow.command(now, Some(target));
            follow.measure(now, speed(*at)).is_some()
        })
    }

    #[test]
    fn an_axis_that_stands_or_runs_the_wrong_way_is_told_in_its_time() {
        // Twice the ramp of 0.4 / 0.5 s, and a second.
        for speed in [0.0, 0.05, -0.4] {
            let alarm = run(&mut Follow::new(CONFIG), 0.4, |_| speed, 10.0).unwrap();
            assert!((2.6..2.7).contains(&alarm), "{speed}: {alarm}");
        }
        assert!(run(&mut Follow::new(CONFIG), -0.4, |_| 0.3, 10.0).is_some());
        // It drove, then stands.
        let alarm = run(&mut Follow::new(CONFIG), 0.4, |at| if at < 3.0 { 0.4 } else { 0.0 }, 10.0).unwrap();
        assert!((5.5..5.7).contains(&alarm), "{alarm}");
    }

    #[test]
    fn an_axis_on_its_ramp_or_at_a_limit_follows() {
        let ramp = |at: f64| (0.5 * at).min(0.8);
        assert_eq!(run(&mut Follow::new(CONFIG), 0.8, ramp, 20.0), None);
        assert_eq!(run(&mut Follow::new(CONFIG), 0.8, |at| (0.125 * at).min(0.2), 20.0), None, "a quarter of all");
        assert_eq!(run(&mut Follow::new(CONFIG), 0.02, |_| 0.0, 20.0), None, "below the resolution");
        // It turns round from full speed.
        let mut follow = Follow::new(CONFIG);
        follow.measure(Instant::ZERO, 1.2);
        assert_eq!(run(&mut follow, -0.05, |at| (1.2 - 0.5 * at).max(-0.05), 20.0), None);
        follow.command(Instant::NEVER, None);
        assert_eq!(follow.measure(Instant::NEVER, 0.0), None);
    }

    const STEERING: ReachConfig = ReachConfig { speed: 0.7, least: 0.03, stands_max: None };
    const ALONE: ReachConfig = ReachConfig { stands_max: Some(Duration::from_millis(350)), ..STEERING };

    /// Commands `target` and measures the position after each 10 ms, which `step` gives from target and position; the
    /// time of the first alarm.
    fn steer(target: impl Fn(f64) -> f64, step: impl FnMut(f64, f64) -> f64, s: f64) -> Option<f64> {
        steer_by(STEERING, target, step, s)
    }

    fn steer_by(
        config: ReachConfig,
        target: impl Fn(f64) -> f64,
        mut step: impl FnMut(f64, f64) -> f64,
        s: f64,
    ) -> Option<f64> {
        let mut reach = Reach::new(config);
        let mut position = 0.0;
        (0..(s * 100.0) as u32).map(|step| f64::from(step) / 100.0).find(|at| {
            let now = Instant::ZERO + Duration::from_secs_f64(100.0 + at);
            reach.command(now, Some(target(*at)));
            position = step(target(*at), position);
            reach.measure(now, position).is_some()
        })
    }

    #[test]
    fn an_axis_that_does_not_approach_its_position_is_told_in_its_time() {
        // Twice the way of 0.35 rad at 0.7 rad/s, and a second.
        for speed in [0.0, 0.0001, -0.002] {
            let alarm = steer(|_| 0.35, |_, position| position + speed, 10.0).unwrap();
            assert!((1.95..2.1).contains(&alarm), "{speed}: {alarm}");
        }
        let jammed = steer(|at| if at < 3.0 { 0.0 } else { -0.2 }, |_, position| position, 10.0).unwrap();
        assert!((4.5..4.7).contains(&jammed), "{jammed}");
        for (amplitude, period) in [(0.005, 0.2), (0.01, 0.33), (0.02, 1.0)] {
            let mut time = 0.0;
            let hunts = |_, _| {
                time += 0.01;
                amplitude * libm::sin(core::f64::consts::TAU * time / period)
            };
            let alarm = steer(|_| 0.3, hunts, 10.0);
            assert!(alarm.is_some_and(|alarm| alarm < 4.0), "it is jammed and hunts by {amplitude}: {alarm:?}");
        }
        // Its target is never the same twice, nor where it stands.
        let alarm = steer(|at| 0.3 + 0.1 * libm::sin(20.0 * at), |_, position| position, 10.0).unwrap();
        assert!((1.8..2.2).contains(&alarm), "{alarm}");
    }

    #[test]
    fn an_axis_on_its_way_follows_whatever_its_targets() {
        let steps = |target: f64, position: f64| position + (target - position).clamp(-0.007, 0.007);
        let slow = |target: f64, position: f64| position + (target - position).clamp(-0.0018, 0.0018);
        for period in [0.1, 0.3, 1.0, 3.0, 10.0] {
            let wave = |at: f64| 0.6 * libm::sin(core::f64::consts::TAU * at / period);
            assert_eq!(steer(wave, steps, 60.0), None, "{period}");
            let square = |at: f64| 0.6 * wave(at).signum();
            assert_eq!(steer(square, steps, 60.0), None, "{period}");
            assert_eq!(steer_by(ALONE, wave, steps, 60.0), None, "{period}");
            assert_eq!(steer_by(ALONE, square, steps, 60.0), None, "{period}");
        }
        assert_eq!(steer_by(ALONE, |_| 0.6, slow, 20.0), None, "a quarter of its speed");
        assert_eq!(steer_by(ALONE, |at| 0.2 * (at / 0.3).floor(), steps, 1.2), None, "it waits for its next target");
        assert_eq!(steer(|_| 0.6, slow, 20.0), None, "a quarter of its speed");
        assert_eq!(steer(|_| 0.6, |target, _| target - 0.02, 20.0), None, "it has play");
        assert_eq!(steer(|_| 0.02, |_, position| position, 20.0), None, "below the least deviation");
    }

    /// An axis that reaches its speed in 0.25 s, and takes its target 40 ms late; hands steer it away from a limit and
    /// back again within any time.
    #[test]
    fn an_axis_that_has_to_turn_round_follows() {
        for gap in (1..100).map(|step| f64::from(step) / 100.0) {
            let target = |at: f64| if (1.2..1.2 + gap).contains(&at) { 0.0 } else { 0.31 };
            let (mut targets, mut speed) = (std::collections::VecDeque::from([0.0; 4]), 0.0f64);
            let moves = |target: f64, position: f64| {
                targets.push_back(target);
                let way = targets.pop_front().unwrap_or(target) - position;
                // The speed from which it stops in the way that is left.
                let wanted = (2.0 * 2.8 * libm::fabs(way)).sqrt().min(0.7) * way.signum();
                speed += (wanted - speed).clamp(-0.028, 0.028);
                position + 0.01 * speed
            };
            assert_eq!(steer_by(ALONE, target, moves, 4.0), None, "{gap} s");
        }
    }

    #[test]
    fn an_axis_whose_encoder_is_dead_or_reversed_is_found_soon_where_that_is_asked_for() {
        let dies = |after: f64, counts: f64| {
            let mut time = 0.0;
            steer_by(
                ALONE,
                |_| 0.6,
                move |target, position| {
                    time += 0.01;
                    position + if time > after { counts } else { 1.0 } * (target - position).clamp(-0.007, 0.007)
                },
                10.0,
            )
        };
        for counts in [0.0, 0.01, -1.0] {
            for after in [0.0, 0.3, 0.5] {
                let alarm = dies(after, counts).unwrap();
                assert!((0.32..0.4).contains(&(alarm - after)), "{counts} after {after}: {alarm}");
            }
        }
        // The target goes to and fro meanwhile.
        let square = |at: f64| if ((at / 0.3) as u32).is_multiple_of(2) { 0.3 } else { -0.3 };
        for counts in [0.0, -1.0] {
            let reversed = |target: f64, position: f64| position + counts * (target - position).clamp(-0.007, 0.007);
            let alarm = steer_by(ALONE, square, reversed, 4.0).unwrap();
            assert!(alarm <= 0.7, "{counts}: {alarm}");
        }
    }

    #[test]
    fn a_position_that_is_not_commanded_is_not_judged() {
        let mut reach = Reach::new(STEERING);
        let at = |ms| Instant::from_millis(1000 + ms);
        for step in 0..1000_u64 {
            // An order that ends each second.
            reach.command(at(10 * step), Some(0.4).filter(|_| step % 100 != 0));
            assert_eq!(reach.measure(at(10 * step), 0.0), None);
        }
    }
}
