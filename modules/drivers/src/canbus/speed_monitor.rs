//! Monitors by the measured speed that the robot is not faster than commanded, and that it stops when it must.
//!
//! An envelope for each direction: at least the commanded speed, and after a lower command, or an order to stop, the
//! speed that the robot had, falling after [`REACTION`] at half the configured ramp (IEC 61800-5-2, SS1 with monitored
//! ramp). Faster than the envelope for [`CONFIRMATION`] is an alarm. Under an order to stop the envelope is never far
//! above the lowest speed measured, so that a drive that brakes at first and then no more is found as soon as one that
//! does not brake at all. Evaluated at each measurement and at no other time, so late or lost frames raise no alarm.
//!
//! Under an order to stop a wheel that moved by its own power, and gains speed against full braking, is accelerated by
//! the drive that is to brake it: its encoder counts backwards. That is an alarm of its own. A wheel that stood, or was
//! without power, and is pushed is not such a one, nor one that a slope accelerates by less than half the quick stop's
//! deceleration: there the brake helps, and is kept.
//!
//! A drive that gains speed on a ramp of its own is judged by that ramp, too: faster than it would permit, and gaining
//! more speed for [`CONFIRMATION`], is an alarm below the commanded speed as well. A drive that has reached the
//! commanded speed too early and keeps it raises no alarm.
//!
//! A wheel that runs away is found sooner: a set-point that rises itself hides half of what the motor gains. Beyond
//! [`RUNAWAY_MPS`] for [`RUNAWAY`], at last beyond the whole tolerance, and still on its way from the set-point, of
//! which the ramp counts and not the final command, is an alarm. An excess that no longer grows, or a wheel that does
//! not gain speed, has the longer [`CONFIRMATION`].

use super::STANDSTILL_MPS;
use base::{Duration, Instant};
use std::collections::VecDeque;

/// Time from an order until the speed must fall: bus, drive, and the report of the measured speed.
const REACTION: Duration = Duration::from_millis(150);
/// Time for which the speed must exceed the envelope.
const CONFIRMATION: Duration = Duration::from_millis(150);
/// Tolerance of the measured speed: control deviation, and its resolution of 0.012 m/s.
pub(super) const MARGIN_MPS: f64 = 0.1;
/// Part of the configured ramp that must be reached at least, or up to which a speed counts as constant.
const RAMP_MIN: f64 = 0.5;
/// Interval over which the measured acceleration is taken, and longest time between two measurements of a rise.
const SLOPE: Duration = Duration::from_millis(100);
/// Excess from which on a wheel may be running away: half of the tolerance, several times the resolution.
const RUNAWAY_MPS: f64 = 0.5 * MARGIN_MPS;
/// Time for which the excess of a wheel that runs away must be greater: twelve measurements of a CANopen drive.
const RUNAWAY: Duration = Duration::from_millis(120);
/// Least growth over [`SLOPE`] of the excess and of the speed of a wheel that runs away, m/s: 0.3 m/s² more than its
/// set-point gains. One motor of three accelerates the drawn robot of 95 kg by 0.5 m/s² more, of one or two by 1.5.
const GROWTH_MPS: f64 = 0.03;
/// Maximum number of measurements kept: 100 a second for somewhat more than [`SLOPE`].
const MEASUREMENTS_MAX: usize = 32;

/// Commanded motion of the propulsion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Order {
    /// Not to be judged: the power stage is off, or the line cuts the feed.
    None,
    /// Drive at this speed, m/s.
    Drive(f64),
    /// Quick stop.
    Stop,
}

/// Result of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Alarm {
    /// Faster than commanded: the robot is to be braked.
    Exceeded { measured: f64, allowed: f64 },
    /// Commanded to stop, and does not: the feed is to be cut.
    NotStopping { measured: f64, allowed: f64 },
    /// Commanded to stop, and gains speed since: its drive must not brake it any more.
    Accelerates { measured: f64, lowest: f64 },
}

/// Envelope of one direction.
#[derive(Clone, Copy, Debug, Default)]
struct Envelope {
    allowed: f64,
    /// What the ramp permits by now, at most `allowed`.
    risen: f64,
    target: f64,
    /// Beginning of the fall.
    falls: Option<Instant>,
}

impl Envelope {
    fn command(&mut self, now: Instant, target: f64, measured: f64) {
        if target >= self.allowed {
            (self.allowed, self.falls) = (target, None);
        } else if target < self.target || self.falls.is_none() {
            self.allowed = self.allowed.min(measured.max(target) + MARGIN_MPS).max(target);
            self.falls = self.falls.or(Some(now + REACTION));
        }
        self.target = target;
    }

    /// `ramp` of a fall; `own`: acceleration and deceleration of the drive if it keeps them itself; m/s².
    fn pass(&mut self, from: Instant, now: Instant, ramp: f64, own: Option<(f64, f64)>) {
        let passed = now.since(from).as_secs_f64();
        let fallen = self.falls.map_or(0.0, |falls| now.since(from.max(falls)).as_secs_f64());
        if fallen > 0.0 {
            self.allowed = (self.allowed - ramp * fallen).max(self.target);
        }
        self.risen = match own {
            None => self.allowed,
            // Until it must fall the drive may still follow the command before.
            Some((_, fall)) if fallen > 0.0 && self.risen > self.target => {
                (self.risen - fall * fallen).max(self.target).min(self.allowed)
            }
            Some((rise, _)) => (self.risen + rise * passed).min(self.allowed),
        };
    }
}

/// The monitor.
#[derive(Debug)]
pub(super) struct SpeedMonitor {
    /// Deceleration of a command and of a quick stop, m/s².
    ramps: (f64, f64),
    /// Acceleration and deceleration, m/s², if the drive itself keeps them.
    own: Option<(f64, f64)>,
    order: Order,
    /// Forward and backward.
    envelopes: [Envelope; 2],
    at: Instant,
    measured: f64,
    exceeded: Option<Instant>,
    /// Since when it gains speed beyond its ramp.
    rises: Option<Instant>,
    /// Since when it may be running away.
    runs_away: Option<Instant>,
    recent: VecDeque<Measurement>,
    /// The stop of a wheel that moved by its own power, until it stands.
    braking: Option<Braking>,
}

/// A measurement.
#[derive(Clone, Copy, Debug)]
struct Measurement {
    at: Instant,
    /// m/s.
    speed: f64,
    /// How much faster it was than its set-point on its ramp, m/s; NaN if it was not to drive.
    excess: f64,
}

/// A stop of a moving wheel.
#[derive(Clone, Copy, Debug)]
struct Braking {
    since: Instant,
    /// Least speed after [`REACTION`], m/s; infinite before.
    lowest: f64,
}

impl SpeedMonitor {
    /// `deceleration` of a command and of a quick stop as configured, m/s². `rise`: acceleration with which the drive
    /// itself approaches a command; absent: not judged.
    pub(super) fn new(deceleration: f64, quick_stop: f64, rise: Option<f64>) -> Self {
        Self {
            ramps: (deceleration, quick_stop),
            own: rise.map(|rise| (rise, deceleration)),
            order: Order::None,
            envelopes: [Envelope::default(); 2],
            at: Instant::ZERO,
            measured: 0.0,
            exceeded: None,
            rises: None,
            runs_away: None,
            recent: VecDeque::with_capacity(MEASUREMENTS_MAX),
            braking: None,
        }
    }

    /// Takes the order in force at `now`; to be called after each decision.
    pub(super) fn command(&mut self, now: Instant, order: Order) {
        self.pass(now);
        let begins = self.order == Order::None && order != Order::None;
        if begins || order == Order::Stop && self.order != Order::Stop {
            // Whatever the robot does now, it must reach the new order from its present speed.
            let speeds = self.speeds();
            for (envelope, speed) in self.envelopes.iter_mut().zip(speeds) {
                *envelope = Envelope { allowed: speed, risen: speed, target: speed, falls: None };
            }
            self.exceeded = None;
        }
        let starts = !matches!(self.order, Order::Drive(_));
        match (self.order, order) {
            (_, Order::Stop) if !starts && self.measured.abs() >= STANDSTILL_MPS => {
                self.braking = Some(Braking { since: now, lowest: f64::INFINITY });
            }
            (Order::Stop, Order::Stop) => {}
            _ => self.braking = None,
        }
        self.order = order;
        let speed = match order {
            Order::None => return,
            Order::Drive(speed) => speed,
            Order::Stop => 0.0,
        };
        let speeds = self.speeds();
        for ((envelope, target), speed) in self.envelopes.iter_mut().zip([speed, -speed]).zip(speeds) {
            envelope.command(now, target.max(0.0), speed);
            if starts {
                // The drive's ramp begins at its present speed.
                envelope.risen = envelope.risen.max(speed);
            }
        }
    }

    /// Processes a measured speed, m/s.
    pub(super) fn measure(&mut self, now: Instant, speed: f64) -> Option<Alarm> {
        self.pass(now);
        let before = self.recent.back().map_or(now, |last| last.at);
        self.measured = speed;
        if self.recent.len() == MEASUREMENTS_MAX {
            self.recent.pop_front();
        }
        let excess = self.excess();
        self.recent.push_back(Measurement { at: now, speed, excess });
        let speeds = self.speeds();
        if self.order == Order::Stop {
            for (envelope, speed) in self.envelopes.iter_mut().zip(speeds) {
                envelope.allowed = envelope.allowed.min(speed + MARGIN_MPS);
            }
        }
        if let Some(alarm) = self.judge_braking(now) {
            return Some(alarm);
        }
        let rises = self.judge_rise(now, before).or(self.judge_runaway(now, before, excess));
        let over =
            speeds.into_iter().zip(self.envelopes).find(|(speed, envelope)| *speed > envelope.allowed + MARGIN_MPS);
        let Some((measured, envelope)) = over.filter(|_| self.order != Order::None) else {
            self.exceeded = None;
            return rises;
        };
        let since = *self.exceeded.get_or_insert(now);
        if now.since(since) < CONFIRMATION {
            return rises;
        }
        let allowed = envelope.allowed;
        match self.order {
            Order::Stop if self.brakes(now) => None,
            Order::Stop => Some(Alarm::NotStopping { measured, allowed }),
            _ => Some(Alarm::Exceeded { measured, allowed }),
        }
    }

    /// Judges whether it gains speed while it is to stop.
    fn judge_braking(&mut self, now: Instant) -> Option<Alarm> {
        let slope = self.slope(now);
        let speed = self.measured.abs();
        let braking = self.braking.as_mut()?;
        if speed < STANDSTILL_MPS {
            self.braking = None;
            return None;
        }
        if now.since(braking.since) < REACTION {
            return None;
        }
        braking.lowest = braking.lowest.min(speed);
        let lowest = braking.lowest;
        let gains = slope.is_some_and(|slope| slope >= RAMP_MIN * self.ramps.1);
        (gains && speed > lowest + MARGIN_MPS).then_some(Alarm::Accelerates { measured: speed, lowest })
    }

    /// Judges whether it gains speed faster than the drive's ramp; `before`: instant of the previous measurement.
    fn judge_rise(&mut self, now: Instant, before: Instant) -> Option<Alarm> {
        let (rise, _) = self.own?;
        let gains = self.slope(now).is_some_and(|slope| slope >= RAMP_MIN * rise);
        let drives = matches!(self.order, Order::Drive(_));
        let beyond = |(speed, envelope): &(f64, Envelope)| *speed > envelope.risen + MARGIN_MPS;
        let over = self.speeds().into_iter().zip(self.envelopes).find(beyond);
        let Some((measured, envelope)) = over.filter(|_| drives && gains) else {
            self.rises = None;
            return None;
        };
        if now.since(before) > SLOPE {
            // What it did meanwhile is not known.
            self.rises = None;
        }
        let since = *self.rises.get_or_insert(now);
        (now.since(since) >= CONFIRMATION).then_some(Alarm::Exceeded { measured, allowed: envelope.risen })
    }

    /// How much faster it is than its set-point on its ramp, m/s; NaN if it is not to drive.
    fn excess(&self) -> f64 {
        let [forward, backward] = self.envelopes;
        let permitted = if self.measured < 0.0 { backward } else { forward };
        if matches!(self.order, Order::Drive(_)) { self.measured.abs() - permitted.risen } else { f64::NAN }
    }

    /// Judges whether it gains speed, and leaves its set-point behind; `before`: instant of the previous measurement.
    fn judge_runaway(&mut self, now: Instant, before: Instant, excess: f64) -> Option<Alarm> {
        // NaN: it is not to drive.
        if excess.is_nan() || excess <= RUNAWAY_MPS {
            self.runs_away = None;
            return None;
        }
        if now.since(before) > SLOPE {
            // What it did meanwhile is not known.
            self.runs_away = None;
        }
        let since = *self.runs_away.get_or_insert(now);
        let then = self.measured_before(now)?;
        // NaN grows by nothing.
        let grows = excess - then.excess >= GROWTH_MPS && self.measured.abs() - then.speed.abs() >= GROWTH_MPS;
        let runs_away = grows && excess > MARGIN_MPS && now.since(since) >= RUNAWAY;
        let (measured, allowed) = (self.measured.abs(), self.measured.abs() - excess);
        runs_away.then_some(Alarm::Exceeded { measured, allowed })
    }

    fn speeds(&self) -> [f64; 2] {
        [self.measured.max(0.0), (-self.measured).max(0.0)]
    }

    fn ramp(&self) -> f64 {
        RAMP_MIN * if self.order == Order::Stop { self.ramps.1 } else { self.ramps.0 }
    }

    /// True if the measured deceleration is that of the ramp: a drive that brakes as commanded is not disturbed.
    fn brakes(&self, now: Instant) -> bool {
        self.slope(now).is_some_and(|slope| -slope >= self.ramp())
    }

    /// Measured acceleration over [`SLOPE`], m/s², negative if it slows down; `None`: not measured for that long.
    fn slope(&self, now: Instant) -> Option<f64> {
        let then = self.measured_before(now)?;
        Some((self.measured.abs() - then.speed.abs()) / now.since(then.at).as_secs_f64())
    }

    /// The last measurement at least [`SLOPE`] ago.
    fn measured_before(&self, now: Instant) -> Option<Measurement> {
        self.recent.iter().rev().find(|then| now.since(then.at) >= SLOPE).copied()
    }

    fn pass(&mut self, now: Instant) {
        let (ramp, own) = (self.ramp(), self.own);
        for envelope in &mut self.envelopes {
            envelope.pass(self.at, now, ramp, own);
        }
        self.at = self.at.max(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Bench {
        monitor: SpeedMonitor,
        ms: u64,
        speed: f64,
    }

    impl Bench {
        /// Drives at this speed.
        fn driving(speed: f64) -> Self {
            let mut bench = Self { monitor: SpeedMonitor::new(0.8, 1.5, Some(0.5)), ms: 1000, speed };
            assert_eq!(bench.run(Order::Drive(speed), 0.0, 500), None);
            bench
        }

        /// The speed changes by `slope` m/s² (towards zero if negative), measured each 10 ms; the first alarm and its
        /// time.
        fn run(&mut self, order: Order, slope: f64, ms: u64) -> Option<(u64, Alarm)> {
            let begin = self.ms;
            while self.ms < begin + ms {
                self.ms += 10;
                let now = Instant::from_millis(self.ms);
                self.monitor.command(now, order);
                let change = slope * 0.01;
                self.speed = if change < 0.0 && self.speed.abs() < -change {
                    0.0
                } else {
                    self.speed + change * self.speed.signum()
                };
                if let Some(alarm) = self.monitor.measure(now, self.speed) {
                    return Some((self.ms - begin, alarm));
                }
            }
            None
        }
    }

    #[test]
    fn a_robot_that_brakes_as_told_raises_no_alarm() {
        for (speed, slope) in [(0.6, -1.5), (0.6, -0.9), (-0.8, -1.5), (1.2, -0.8)] {
            let mut bench = Bench::driving(speed);
            assert_eq!(bench.run(Order::Stop, 0.0, 120), None, "reaction");
            assert_eq!(bench.run(Order::Stop, slope, 3000), None, "{speed} {slope}");
        }
        let mut bench = Bench::driving(0.6);
        assert_eq!(bench.run(Order::Drive(0.2), -0.8, 500), None);
        assert_eq!(bench.run(Order::Drive(0.2), 0.0, 500), None);
    }

    #[test]
    fn a_robot_that_does_not_stop_raises_one_within_half_a_second() {
        for (speed, slope) in [(0.6, 0.0), (0.6, -0.024), (-0.8, 0.0), (0.3, 0.5)] {
            let mut bench = Bench::driving(speed);
            let (ms, alarm) = bench.run(Order::Stop, slope, 2000).expect("an alarm");
            assert!(matches!(alarm, Alarm::NotStopping { .. }) && ms <= 650, "{speed} {slope}: {ms} ms, {alarm:?}");
        }
    }

    /// When a wheel that is to stop, and changes its speed by `slope`, is found to gain speed. That it does not stop
    /// may be found before.
    fn found(bench: &mut Bench, slope: f64) -> Option<u64> {
        let begin = bench.ms;
        while bench.ms < begin + 1500 {
            if let Some((_, Alarm::Accelerates { .. })) = bench.run(Order::Stop, slope, 1500) {
                return Some(bench.ms - begin);
            }
        }
        None
    }

    #[test]
    fn a_wheel_that_gains_speed_against_its_brake_raises_its_own_alarm() {
        for (speed, slope) in [(0.3, 2.0), (-0.3, 2.0), (0.05, 1.0)] {
            let ms = found(&mut Bench::driving(speed), slope);
            assert!(ms.is_some_and(|ms| ms <= 270), "{speed} {slope}: {ms:?} ms");
        }
        // It brakes at first.
        let mut bench = Bench::driving(0.6);
        assert_eq!(bench.run(Order::Stop, -1.5, 250), None);
        let ms = found(&mut bench, 2.0);
        assert!(ms.is_some_and(|ms| ms <= 200), "{ms:?} ms");
    }

    #[test]
    fn a_wheel_that_stood_or_is_on_a_slope_keeps_its_brake() {
        // A slope that is a little steeper than the brake can hold.
        let mut bench = Bench::driving(0.3);
        assert_eq!(found(&mut bench, 0.7), None);
        // Stopped, then pushed, however hard.
        let mut bench = Bench::driving(0.3);
        assert_eq!(bench.run(Order::Stop, -1.5, 500), None);
        bench.speed = 0.03;
        assert_eq!(found(&mut bench, 2.0), None);
        // Pushed from standstill without having been driven.
        let mut bench = Bench::driving(0.0);
        bench.speed = 0.03;
        assert_eq!(found(&mut bench, 2.0), None);
        // Without power it rolled.
        let mut bench = Bench::driving(0.3);
        assert_eq!(bench.run(Order::None, 0.0, 200), None);
        assert_eq!(found(&mut bench, 2.0), None);
        // It still gains speed as commanded when the order to stop is on its way.
        let mut bench = Bench::driving(0.3);
        assert_eq!(bench.run(Order::Drive(0.6), 0.5, 300), None);
        assert_eq!(bench.run(Order::Stop, 0.5, 100), None);
        assert_eq!(bench.run(Order::Stop, -1.5, 1500), None);
    }

    #[test]
    fn a_robot_that_brakes_at_first_and_then_no_more_raises_one_within_half_a_second() {
        for speed in [0.9, 1.2, -1.2] {
            let mut bench = Bench::driving(speed);
            assert_eq!(bench.run(Order::Stop, 0.0, 50), None);
            assert_eq!(bench.run(Order::Stop, -1.5, 300), None);
            let (ms, alarm) = bench.run(Order::Stop, 0.0, 2000).expect("an alarm");
            assert!(matches!(alarm, Alarm::NotStopping { .. }) && ms <= 500, "{speed}: {ms} ms, {alarm:?}");
        }
    }

    #[test]
    fn a_robot_that_runs_away_raises_one() {
        let mut bench = Bench::driving(0.3);
        let (ms, alarm) = bench.run(Order::Drive(0.3), 0.5, 2000).expect("an alarm");
        // 0.1 m/s too fast after 200 ms, and 150 ms of confirmation.
        assert!(matches!(alarm, Alarm::Exceeded { .. }) && ms <= 380, "{ms} {alarm:?}");
        // Commanded to stand still.
        let mut bench = Bench::driving(0.0);
        bench.speed = 0.3;
        let (ms, alarm) = bench.run(Order::Drive(0.0), 0.0, 2000).expect("an alarm");
        assert!(matches!(alarm, Alarm::Exceeded { .. }) && ms <= 170, "{ms} {alarm:?}");
        // The wrong way round.
        let mut bench = Bench::driving(0.4);
        bench.speed = -0.4;
        assert!(bench.run(Order::Drive(0.4), 0.0, 500).is_some());
    }

    #[test]
    fn a_robot_that_runs_away_while_it_gains_speed_raises_one_below_the_commanded_speed() {
        for gained_ms in [0, 100, 300, 600] {
            let mut bench = Bench::driving(0.0);
            assert_eq!(bench.run(Order::Drive(1.2), 0.5, gained_ms), None);
            let (ms, alarm) = bench.run(Order::Drive(1.2), 2.0, 2000).expect("an alarm");
            // 0.1 m/s too fast after 70 ms, and 150 ms of confirmation.
            assert!((150..=240).contains(&ms), "{gained_ms}: {ms} ms, {alarm:?}");
            assert!(matches!(alarm, Alarm::Exceeded { measured, .. } if measured < 0.9), "{gained_ms}: {alarm:?}");
        }
        // Its ramp is not that of the drive.
        let mut bench = Bench::driving(0.0);
        bench.monitor = SpeedMonitor::new(0.8, 1.5, None);
        assert_eq!(bench.run(Order::Drive(1.2), 2.0, 600), None);
    }

    #[test]
    fn a_drive_that_slowed_down_before_is_judged_by_the_ramp_from_there() {
        let mut bench = Bench::driving(0.4);
        // It follows its own ramp down, and up again from 0.04 m/s; it may have been 150 ms later.
        assert_eq!(bench.run(Order::Drive(0.0), -0.8, 450), None);
        assert_eq!(bench.run(Order::Drive(0.4), 0.5, 100), None);
        let (ms, alarm) = bench.run(Order::Drive(0.4), 2.0, 1000).expect("an alarm");
        assert!(ms <= 260 && matches!(alarm, Alarm::Exceeded { measured, .. } if measured < 0.65), "{ms}: {alarm:?}");
        // One that was as late as it may be, and is late on its way up.
        let mut bench = Bench::driving(0.4);
        assert_eq!(bench.run(Order::Drive(0.0), 0.0, 150), None);
        assert_eq!(bench.run(Order::Drive(0.0), -0.8, 200), None);
        assert_eq!(bench.run(Order::Drive(0.4), 0.5, 300), None);
    }

    /// One of several wheels: its driver makes the ramp of its set-points.
    fn of_several(ms: u64, mut speeds: impl FnMut(f64) -> (f64, f64)) -> Option<(u64, Alarm)> {
        let mut monitor = SpeedMonitor::new(0.8, 1.5, None);
        (0..ms).step_by(10).find_map(|ms| {
            let (now, (set_point, speed)) = (Instant::from_millis(1000 + ms), speeds(ms as f64 / 1000.0));
            monitor.command(now, Order::Drive(set_point));
            monitor.measure(now, speed).map(|alarm| (ms, alarm))
        })
    }

    #[test]
    fn a_wheel_that_leaves_a_rising_set_point_behind_is_found_before_its_excess_has_lasted() {
        for sign in [1.0, -1.0] {
            // The set-point gains 0.5 m/s², and from 200 ms on the wheel 1.0.
            let found = of_several(1000, |s| (sign * 0.5 * s, sign * (0.5 * s + 0.5 * (s - 0.2).max(0.0))));
            let (ms, alarm) = found.expect("an alarm");
            // 0.1 m/s too fast after 200 ms.
            assert!((400..=440).contains(&ms) && matches!(alarm, Alarm::Exceeded { .. }), "{ms}: {alarm:?}");
            // At a speed that is kept the wheel gains 1.15.
            let found = of_several(1000, |s| (sign * 0.3, sign * (0.3 + 1.15 * (s - 0.2).max(0.0))));
            let (ms, _) = found.expect("an alarm");
            assert!((300..=380).contains(&ms), "{ms}");
        }
    }

    #[test]
    fn an_excess_that_does_not_grow_or_is_within_the_tolerance_is_not_a_wheel_that_runs_away() {
        // A bump of 0.12 m/s that is corrected within 100 ms; a deviation that is tolerated; one that grows too slowly
        // to leave the tolerance; a wheel that is late on its ramp and catches up.
        let bump = |s: f64| 0.12 * (1.0 - libm::fabs(s - 0.5) / 0.05).max(0.0);
        assert_eq!(of_several(1000, |s| (0.3, 0.3 + bump(s))), None);
        assert_eq!(of_several(2000, |s| (0.3, 0.3 + (0.5 * (s - 0.2)).clamp(0.0, 0.095))), None);
        assert_eq!(
            of_several(2000, |s| ((0.5 * s).min(0.4), (2.0 * (s - 0.3)).clamp(0.0, (0.5 * s).min(0.4) + 0.04))),
            None
        );
        // Its set-point falls, and it keeps its speed for as long as a drive may need to react.
        assert_eq!(of_several(1150, |s| (if s < 1.0 { 0.4 } else { 0.4 - 0.8 * (s - 1.0) }, 0.4)), None);
        // Not measured for 150 ms in the middle of the excess.
        let mut monitor = SpeedMonitor::new(0.8, 1.5, None);
        for (ms, speed) in [(0, 0.3), (20, 0.32), (40, 0.34), (60, 0.36), (210, 0.45)] {
            monitor.command(Instant::from_millis(1000 + ms), Order::Drive(0.3));
            assert_eq!(monitor.measure(Instant::from_millis(1000 + ms), speed), None, "{ms} ms");
        }
    }

    #[test]
    fn a_robot_on_its_ramp_late_or_at_its_speed_too_early_raises_none() {
        let mut bench = Bench::driving(0.0);
        assert_eq!(bench.run(Order::Drive(0.6), 0.5, 1200), None);
        assert_eq!(bench.run(Order::Drive(0.6), 0.0, 500), None);
        // Held for half a second, then as fast as its motor can to where its ramp is.
        let mut bench = Bench::driving(0.0);
        assert_eq!(bench.run(Order::Drive(0.6), 0.0, 500), None);
        assert_eq!(bench.run(Order::Drive(0.6), 2.0, 160), None);
        assert_eq!(bench.run(Order::Drive(0.6), 0.5, 500), None);
        // It has no ramp.
        for speed in [0.6, -0.6] {
            let mut bench = Bench::driving(0.0);
            bench.speed = speed;
            assert_eq!(bench.run(Order::Drive(speed), 0.0, 1000), None);
        }
        // From a stop that has not ended yet.
        let mut bench = Bench::driving(0.6);
        assert_eq!(bench.run(Order::Stop, -1.5, 200), None);
        assert_eq!(bench.run(Order::Drive(0.6), 0.5, 600), None);
    }

    #[test]
    fn a_drive_without_power_is_not_judged_and_one_that_brakes_late_is_not_cut() {
        let mut bench = Bench::driving(0.6);
        assert_eq!(bench.run(Order::None, -0.1, 2000), None);
        let mut bench = Bench::driving(0.6);
        assert_eq!(bench.run(Order::Stop, 0.0, 300), None);
        assert_eq!(bench.run(Order::Stop, -1.5, 1000), None);
    }
}
