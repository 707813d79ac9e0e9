//! The second way to stop (docs/design.md, section 4): the driver orders the motors' feed to be cut if the drive does
//! not brake as commanded, within the time of the table *What stops the robot*, and never if the drive brakes; a robot
//! that is faster than commanded is ordered to stop; and after a cut nothing moves until a person switches the motors
//! on.
//!
//! The speed is taken from the body, the order from the wire, the cut from `LL_CMD_POWER`. A drive without power, out
//! of reach, or under the PAUSE line, which cuts its feed by itself, is not judged. An order to stop outlasts that: it
//! is sent once, and what counts for its time limit is when the drive is judged again.

use super::Verdict;
use super::facts::Facts;
use base::{Duration, Instant};
use messages::lowlevel;
use rs485::boards::psc1::CHANNELS;
use std::collections::VecDeque;

/// Channel that feeds the motors.
const MOTORS: &str = "motors";
/// Maximum time from the order to stop to the order to cut the feed: the table's figure.
const CUT_WITHIN: Duration = Duration::from_millis(650);
/// Maximum time for which the robot may be faster than commanded: the table's figure, and that in which a constant
/// speed is measured.
const EXCEEDED_MAX: Duration = Duration::from_millis(700);
/// Speed above the commanded one that counts as faster, m/s; also the speed below which a stop is not judged.
const MARGIN_MPS: f64 = 0.15;
/// Decrease of the speed since the order by which a drive counts as braking, m/s.
const BRAKED_MPS: f64 = 0.05;
/// Part of the quick stop's ramp from which a drive counts as braking as commanded.
const RAMP_MIN: f64 = 0.8;
/// Time after the last lower set-point after which the robot must have that speed.
const SETTLED: Duration = Duration::from_millis(2500);
/// Period of the body's samples.
const SAMPLE: Duration = Duration::from_millis(50);
/// Number of samples over which the deceleration is taken.
const SAMPLES: usize = 4;
/// Interval beyond which an order to cut is a new one: it is repeated each 500 ms.
const REPEATED: Duration = Duration::from_millis(700);
/// Time within which orders of two senders may cross each other.
const CROSSING_MAX: Duration = Duration::from_millis(5);

/// Order to stop, the time since which it is judged, and the speed at that time, m/s.
#[derive(Clone, Copy, Debug)]
struct Order {
    at: Instant,
    speed: f64,
}

/// The propulsion's feed and speed.
#[derive(Debug)]
pub(super) struct Rule {
    recent: VecDeque<(Instant, f64)>,
    /// The power stage of each wheel is on, by the statusword.
    powered: Vec<bool>,
    order: Option<Order>,
    /// Time of the last order to cut, and of the last one by a person to switch on.
    cut: Option<Instant>,
    on: Instant,
    /// That one may not have reached the driver, which then repeats its order.
    unheard: bool,
    /// The last order to cut is such a repetition: the one to switch on may be carried out after it.
    crossed: bool,
    /// Last set-point, and the time since which it was not lowered.
    set_point: f64,
    settled: Instant,
    /// Time since which the robot is faster than commanded.
    exceeds: Option<Instant>,
}

impl Rule {
    pub fn new(wheels: usize) -> Self {
        Self {
            recent: VecDeque::new(),
            powered: vec![false; wheels],
            order: None,
            cut: None,
            on: Instant::ZERO,
            unheard: false,
            crossed: false,
            set_point: 0.0,
            settled: Instant::ZERO,
            exceeds: None,
        }
    }

    /// A process of the driver is started. It knows neither of an earlier order to cut the feed, nor how long the drive
    /// has been commanded to stop.
    pub fn on_driver(&mut self, now: Instant) {
        self.cut = None;
        if let Some(order) = &mut self.order {
            order.at = now;
        }
    }

    /// Processes a frame on the wire, except those to the propulsion.
    pub fn on_frame(&mut self, id: u16, data: &[u8], facts: &Facts) {
        if let Some((wheel, status)) = facts.limits.reported(id, data) {
            // CiA 402-2, statusword: operation enabled, quick stop active.
            self.powered[wheel] = matches!(status & 0x6F, 0x27 | 0x07);
        }
    }

    /// An RPDO of the propulsion that does not move the robot has left the wire.
    pub fn on_still(&mut self, now: Instant, facts: &Facts) {
        (self.set_point, self.settled, self.exceeds) = (0.0, now, None);
        // A command to stand replaces the order.
        let order = facts.set_point.is_stop().then(|| self.order.unwrap_or(Order { at: now, speed: self.speed() }));
        self.order = order;
    }

    /// A set-point has left the wire.
    pub fn on_set_point(&mut self, now: Instant, speed: f64) -> Verdict {
        self.order = None;
        if speed.abs() < self.set_point.abs() || speed * self.set_point < 0.0 {
            self.settled = now;
        }
        self.set_point = speed;
        match self.cut.filter(|cut| *cut > self.on && !self.crossed) {
            Some(cut) => Err(format!("{speed:.3} m/s, and nobody switched the motors on since the cut at {cut:?}")),
            None => Ok(()),
        }
    }

    /// Processes an order to switch a power channel, of the driver or of somebody who may command.
    pub fn on_power(&mut self, now: Instant, by_driver: bool, command: &lowlevel::CmdPower, facts: &Facts) -> Verdict {
        let motors = CHANNELS.iter().position(|name| *name == MOTORS);
        if usize::try_from(command.device).ok() != motors {
            return Ok(());
        }
        if !by_driver {
            if command.action != lowlevel::CmdPower::OFF {
                self.on = now;
                self.unheard = facts.lcm_disturbed(now) == Some(now);
            }
            return Ok(());
        }
        let unheard = self.unheard || now.since(self.on) < CROSSING_MAX;
        // A feed that was cut, and that somebody switched on unheard by the driver, has returned by itself for it.
        let repeats = |cut| if cut > self.on { now.since(cut) < REPEATED } else { unheard };
        let repeated = self.cut.is_some_and(repeats);
        self.crossed = unheard && self.cut.is_some_and(|cut| cut <= self.on);
        self.cut = Some(now);
        if repeated || is_unreached(now, facts) {
            return Ok(());
        }
        let Some(order) = self.order else {
            return Err("the motors' feed is cut, and the drive is not told to stop".into());
        };
        let (first, last) = (self.recent.front(), self.recent.back());
        let slope = first
            .zip(last)
            .filter(|((from, _), (to, _))| from < to)
            .map(|((from, before), (to, after))| (before.abs() - after.abs()) / to.since(*from).as_secs_f64());
        if slope.is_some_and(|slope| slope >= RAMP_MIN * facts.limits.quick_stop) {
            return Err(format!("the motors' feed is cut, and the drive brakes as told since {:?}", order.at));
        }
        Ok(())
    }

    /// Processes a sample of the body's speed, m/s.
    pub fn on_truth(&mut self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        if self.recent.len() >= SAMPLES {
            self.recent.pop_front();
        }
        self.recent.push_back((now, speed));
        let paused = facts.limits.power.is_some() && facts.pause.cuts_feed();
        if paused || self.powered.contains(&false) || is_unreached(now, facts) {
            (self.exceeds, self.settled) = (None, now);
            self.order = facts.set_point.is_stop().then_some(Order { at: now, speed });
            return Ok(());
        }
        if facts.limits.feed_is_cut {
            self.judge_order(now, speed)?;
        }
        self.judge_speed(now, speed)
    }

    fn judge_order(&mut self, now: Instant, speed: f64) -> Verdict {
        let Some(order) = &mut self.order else { return Ok(()) };
        if speed.abs() <= MARGIN_MPS {
            // While it stands its time has not begun: another master may move it later.
            order.at = now;
        }
        let order = *order;
        let unbraked = order.speed.abs() > MARGIN_MPS && speed.abs() > order.speed.abs() - BRAKED_MPS;
        // One from before is in force until a person switches the motors on.
        let cut = self.cut.is_some_and(|cut| cut >= order.at || cut > self.on);
        if unbraked && !cut && now.since(order.at) > CUT_WITHIN + SAMPLE {
            return Err(format!("{speed:.3} m/s, told to stop at {:?}, and the motors' feed is not cut", order.at));
        }
        Ok(())
    }

    fn judge_speed(&mut self, now: Instant, speed: f64) -> Verdict {
        let faster = self.set_point != 0.0 && speed.abs() > self.set_point.abs() + MARGIN_MPS;
        if !faster || now.since(self.settled) < SETTLED {
            self.exceeds = None;
            return Ok(());
        }
        let since = *self.exceeds.get_or_insert(now);
        if now.since(since) > EXCEEDED_MAX {
            return Err(format!("{speed:.3} m/s since {since:?}, and {:.3} m/s are commanded", self.set_point));
        }
        Ok(())
    }

    fn speed(&self) -> f64 {
        self.recent.back().map_or(0.0, |(_, speed)| *speed)
    }
}

/// True while the propulsion may be out of reach, or the driver does not work as usual.
fn is_unreached(now: Instant, facts: &Facts) -> bool {
    facts.is_disturbed(now) || facts.is_cut_off(now) || !facts.driver.is_well()
}
