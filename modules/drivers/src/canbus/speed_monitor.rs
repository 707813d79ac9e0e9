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

    /// `ramp` of a fall, `rise` that of the drive if it has one, m/s².
    fn pass(&mut self, from: Instant, now: Instant, ramp: f64, rise: Option<f64>) {
        if let Some(falls) = self.falls {
            let time = now.since(from.max(falls)).as_secs_f64();
            self.allowed = (self.allowed - ramp * time).max(self.target);
        }
        let risen = rise.map(|rise| self.risen + rise * now.since(from).as_secs_f64());
        self.risen = risen.unwrap_or(self.allowed).min(self.allowed);
    }
}

/// The monitor.
#[derive(Debug)]
pub(super) struct SpeedMonitor {
    /// Deceleration of a command and of a quick stop, m/s².
    ramps: (f64, f64),
    /// Acceleration, m/s², if the drive itself keeps it.
    rise: Option<f64>,
    order: Order,
    /// Forward and backward.
    envelopes: [Envelope; 2],
    at: Instant,
    measured: f64,
    exceeded: Option<Instant>,
    /// Since when it gains speed beyond its ramp.
    rises: Option<Instant>,
    recent: VecDeque<(Instant, f64)>,
    /// The stop of a wheel that moved by its own power, until it stands.
    braking: Option<Braking>,
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
            rise,
            order: Order::None,
            envelopes: [Envelope::default(); 2],
            at: Instant::ZERO,
            measured: 0.0,
            exceeded: None,
            rises: None,
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
        let before = self.recent.back().map_or(now, |(at, _)| *at);
        self.measured = speed;
        if self.recent.len() == MEASUREMENTS_MAX {
            self.recent.pop_front();
        }
        self.recent.push_back((now, speed));
        let speeds = self.speeds();
        if self.order == Order::Stop {
            for (envelope, speed) in self.envelopes.iter_mut().zip(speeds) {
                envelope.allowed = envelope.allowed.min(speed + MARGIN_MPS);
            }
        }
        if let Some(alarm) = self.judge_braking(now) {
            return Some(alarm);
        }
        let rises = self.judge_rise(now, before);
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
        let rise = self.rise?;
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
        let (at, speed) = self.recent.iter().rev().find(|(at, _)| now.since(*at) >= SLOPE)?;
        Some((self.measured.abs() - speed.abs()) / now.since(*at).as_secs_f64())
    }

    fn pass(&mut self, now: Instant) {
        let (ramp, rise) = (self.ramp(), self.rise);
        for envelope in &mut self.envelopes {
            envelope.pass(self.at, now, ramp, rise);
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

    /// When a wheel that is to stop, and changes its speed by `slope`, is found to gain speed. That it does not stop may
    /// be found before.
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
