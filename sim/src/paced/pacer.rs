//! How far virtual time may pass at an instant of real time, and how fast it did pass.

use base::{Duration, Instant};
use std::collections::VecDeque;
use std::fmt::{self, Display};
use std::str::FromStr;

/// Period of `SIM_DATA_CLOCK` in virtual time: that of motion commands.
pub const TICK: Duration = Duration::from_millis(50);
/// Real time between two parts of virtual time, where these can keep up.
const PERIOD: Duration = Duration::from_millis(5);
/// Real time that a late robot makes up for; what it is later is dropped, so that time never passes in a rush.
const LATE_MAX: Duration = Duration::from_millis(100);
/// Real time over which the achieved factor is measured, and that between two measurements.
const WINDOW: Duration = Duration::from_secs(1);
const SAMPLE: Duration = Duration::from_millis(50);
/// Least real time from which a factor can be stated.
const MEASURED_MIN: Duration = Duration::from_millis(10);
/// Maximum virtual duration of a step.
const STEP_MAX: Duration = Duration::from_secs(3600);

/// Simulated seconds per real second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed(f64);

impl Speed {
    /// That of a robot: motion commands by the wall clock are in time.
    pub const REAL: Self = Self(1.0);
    /// As fast as the computer is.
    pub const FASTEST: Self = Self(0.0);
    /// Least and greatest factor.
    pub const RANGE: (f64, f64) = (0.05, 1000.0);

    /// The factor; 0 stands for [`Speed::FASTEST`].
    ///
    /// # Errors
    /// The range, in words.
    pub fn new(factor: f64) -> Result<Self, String> {
        let (least, greatest) = Self::RANGE;
        let is_valid = factor == 0.0 || (least..=greatest).contains(&factor);
        is_valid.then_some(Self(factor)).ok_or_else(|| format!("expected a speed of {least} to {greatest}, or max"))
    }

    /// The factor; 0 for [`Speed::FASTEST`].
    #[must_use]
    pub fn factor(self) -> f64 {
        self.0
    }

    /// Virtual time that passes within a real time.
    fn virtually(self, real: Duration) -> Duration {
        real.mul_f64(self.0)
    }

    /// Real time within which a virtual time passes.
    fn really(self, virtually: Duration) -> Duration {
        if self == Self::FASTEST { Duration::ZERO } else { virtually.div_f64(self.0) }
    }
}

impl FromStr for Speed {
    type Err = String;

    /// A number, or `max`.
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "max" => Ok(Self::FASTEST),
            // Only `max` means that.
            _ => Self::new(text.parse().ok().filter(|factor| *factor != 0.0).unwrap_or(f64::NAN)),
        }
    }
}

impl Display for Speed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::FASTEST { f.write_str("max") } else { self.0.fmt(f) }
    }
}

/// Whether time passes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Paused,
    Running,
    /// Until this virtual instant, then it stands still.
    Stepping(Instant),
}

/// The pace of virtual time.
#[derive(Debug)]
pub struct Pacer {
    speed: Speed,
    mode: Mode,
    /// Real and virtual instant from which time is counted.
    anchor: (Instant, Instant),
    /// Real and virtual instants of the last second, at least the newest.
    samples: VecDeque<(Instant, Instant)>,
}

impl Pacer {
    /// Time passes at this speed from the real instant `real` and the virtual instant `now` on.
    #[must_use]
    pub fn new(speed: Speed, real: Instant, now: Instant) -> Self {
        Self { speed, mode: Mode::Running, anchor: (real, now), samples: VecDeque::from([(real, now)]) }
    }

    /// Commanded speed.
    #[must_use]
    pub fn speed(&self) -> Speed {
        self.speed
    }

    /// True while time stands still.
    #[must_use]
    pub fn is_paused(&self) -> bool {
        self.mode == Mode::Paused
    }

    /// True while time passes as for a robot.
    #[must_use]
    pub fn is_real(&self) -> bool {
        self.mode == Mode::Running && self.speed == Speed::REAL
    }

    /// Time stands still.
    pub fn pause(&mut self) {
        self.mode = Mode::Paused;
    }

    /// Time passes.
    pub fn run(&mut self, real: Instant, now: Instant) {
        if self.mode == Mode::Paused {
            self.restart(real, now);
        }
        self.mode = Mode::Running;
    }

    /// Time passes at another speed, or will if it stands still.
    pub fn set_speed(&mut self, speed: Speed, real: Instant, now: Instant) {
        self.speed = speed;
        self.anchor = (real, now);
    }

    /// Time passes for a duration, at the commanded speed, then stands still.
    ///
    /// # Errors
    /// The range of the duration, in words.
    pub fn step(&mut self, lasts: Duration, real: Instant, now: Instant) -> Result<(), String> {
        if lasts.is_zero() || lasts > STEP_MAX {
            return Err(format!("expected a step above 0, up to {} s", STEP_MAX.as_secs()));
        }
        self.restart(real, now);
        self.mode = Mode::Stepping(now + lasts);
        Ok(())
    }

    /// Virtual time begins anew at `now`, after a new start of the robot. Where it stood still or stepped, it stands
    /// still.
    pub fn reset(&mut self, real: Instant, now: Instant) {
        if matches!(self.mode, Mode::Stepping(_)) {
            self.mode = Mode::Paused;
        }
        self.restart(real, now);
    }

    fn restart(&mut self, real: Instant, now: Instant) {
        self.anchor = (real, now);
        self.samples = VecDeque::from([(real, now)]);
    }

    /// The virtual instant up to which time may pass on from `now`, a small part at once.
    pub fn due(&mut self, real: Instant, now: Instant) -> Instant {
        let end = match self.mode {
            Mode::Paused => return now,
            Mode::Running => Instant::NEVER,
            Mode::Stepping(end) => end,
        };
        if self.speed == Speed::FASTEST {
            return (now + TICK).min(end);
        }
        let passed = |anchor: (Instant, Instant)| anchor.1 + self.speed.virtually(real.since(anchor.0));
        let mut due = passed(self.anchor);
        if due.since(now) > self.speed.virtually(LATE_MAX) {
            due = now + self.speed.virtually(LATE_MAX);
            self.anchor = (real, due);
        }
        let part = self.speed.virtually(PERIOD).max(PERIOD);
        due.min(now + part).min(end).max(now)
    }

    /// Time has passed to `now`.
    pub fn on_ran(&mut self, real: Instant, now: Instant) {
        if self.samples.back().is_none_or(|(at, _)| real.since(*at) >= SAMPLE) {
            self.samples.push_back((real, now));
        }
        // The first one is the last that is at least as old as the window.
        while self.samples.get(1).is_some_and(|(at, _)| real.since(*at) >= WINDOW) {
            self.samples.pop_front();
        }
        if matches!(self.mode, Mode::Stepping(end) if end <= now) {
            self.mode = Mode::Paused;
        }
    }

    /// The real instant at which time is to pass on.
    #[must_use]
    pub fn next(&self, real: Instant, now: Instant) -> Instant {
        if self.is_paused() {
            return Instant::NEVER;
        }
        if self.speed == Speed::FASTEST {
            return real;
        }
        self.anchor.0 + self.speed.really(now.since(self.anchor.1)) + PERIOD
    }

    /// Virtual seconds per real second over about the last real second; 0 while time stands still, or if none has
    /// passed yet.
    #[must_use]
    pub fn achieved(&self, real: Instant, now: Instant) -> f64 {
        let Some((since, from)) = self.samples.front().copied() else { return 0.0 };
        if self.is_paused() || real.since(since) < MEASURED_MIN {
            return 0.0;
        }
        now.since(from).as_secs_f64() / real.since(since).as_secs_f64()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: fn(u64) -> Instant = Instant::from_millis;

    /// Real time passes in parts of 5 ms; the virtual instant, then.
    fn pass(pacer: &mut Pacer, real: std::ops::Range<u64>, mut now: Instant) -> Instant {
        for real in real.step_by(5).map(|ms| MS(ms + 5)) {
            while pacer.next(real, now) <= real && pacer.due(real, now) > now {
                now = pacer.due(real, now);
                pacer.on_ran(real, now);
            }
        }
        now
    }

    fn speed(text: &str) -> Speed {
        text.parse().unwrap_or_else(|why| panic!("{text}: {why}"))
    }

    #[test]
    fn a_speed_is_a_number_in_range_or_max() {
        for text in ["0.05", "1", "20", "1000", "max"] {
            assert_eq!(speed(text).to_string(), text);
        }
        for text in ["0", "-1", "0.04", "1001", "nan", "inf", "fast", ""] {
            assert!(text.parse::<Speed>().is_err(), "{text}");
        }
        assert_eq!(Speed::new(0.0), Ok(Speed::FASTEST));
        assert!(Speed::new(f64::NAN).is_err());
    }

    #[test]
    fn time_passes_by_the_factor_and_the_factor_is_measured() {
        for (text, factor) in [("1", 1.0), ("20", 20.0), ("0.05", 0.05)] {
            let mut pacer = Pacer::new(speed(text), MS(0), MS(0));
            let now = pass(&mut pacer, 0..2000, MS(0));
            let passed = now.as_nanos() as f64 / 1e9;
            assert!((passed - 2.0 * factor).abs() <= 0.011 * factor, "{text}: {passed} s");
            let achieved = pacer.achieved(MS(2000), now);
            assert!((achieved / factor - 1.0).abs() < 0.02, "{text}: {achieved}");
        }
    }

    #[test]
    fn time_that_a_busy_computer_lost_is_not_made_up_for() {
        let mut pacer = Pacer::new(Speed::REAL, MS(0), MS(0));
        let now = pass(&mut pacer, 0..1000, MS(0));
        assert!((990..=1000).contains(&(now.as_nanos() / 1_000_000)), "{now:?}");
        // A second without service.
        let after = pass(&mut pacer, 2000..3000, now);
        let passed = after.since(now).as_millis();
        assert!((1000..=1110).contains(&passed), "{passed} ms");
        let factor = pacer.achieved(MS(3000), after);
        assert!(factor <= 1.15, "{factor}");
    }

    #[test]
    fn paused_time_stands_still_and_a_step_lasts_as_long_as_asked() {
        let mut pacer = Pacer::new(speed("20"), MS(0), MS(0));
        let now = pass(&mut pacer, 0..500, MS(0));
        pacer.pause();
        assert_eq!(pass(&mut pacer, 500..5000, now), now);
        assert_eq!((pacer.achieved(MS(5000), now), pacer.next(MS(5000), now)), (0.0, Instant::NEVER));
        pacer.step(TICK, MS(5000), now).unwrap();
        assert!(!pacer.is_paused());
        let stepped = pass(&mut pacer, 5000..6000, now);
        assert_eq!((stepped.since(now), pacer.is_paused()), (TICK, true));
        pacer.run(MS(6000), stepped);
        let on = pass(&mut pacer, 6000..7000, stepped);
        assert!((19_800..=20_000).contains(&on.since(stepped).as_millis()), "{on:?}");
        assert!(pacer.step(Duration::ZERO, MS(7000), on).is_err());
        assert!(pacer.step(Duration::from_secs(3601), MS(7000), on).is_err());
    }

    #[test]
    fn the_fastest_speed_never_waits_and_passes_on_in_parts() {
        let mut pacer = Pacer::new(Speed::FASTEST, MS(0), MS(0));
        assert_eq!(pacer.next(MS(3), MS(0)), MS(3));
        assert_eq!(pacer.due(MS(3), MS(70)), MS(70) + TICK);
        assert!(!pacer.is_real() && Pacer::new(Speed::REAL, MS(0), MS(0)).is_real());
    }

    #[test]
    fn a_new_speed_counts_from_now_on() {
        let mut pacer = Pacer::new(Speed::REAL, MS(0), MS(0));
        let now = pass(&mut pacer, 0..1000, MS(0));
        pacer.set_speed(speed("10"), MS(1000), now);
        let after = pass(&mut pacer, 1000..2000, now);
        assert!((9_900..=10_000).contains(&after.since(now).as_millis()), "{after:?}");
    }
}
