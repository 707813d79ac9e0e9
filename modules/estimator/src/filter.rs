//! An extended Kalman filter over odometry and beacon bearings, with a measure of its own reliability.
//!
//! A bearing is applied at its own instant: the motion steps and bearings of the last two seconds are kept with the
//! state after each, and a late measurement is inserted in its place and the later ones are processed again
//! (docs/facts/robot.md 3.1). The probability that a bearing belongs to its beacon follows from its innovation. When
//! bearings contradict the pose, or no pose is known, `crate::search` looks for one among all that the bearings of
//! the last seconds allow.

mod config;
mod history;
mod state;
#[cfg(test)]
mod tests;

pub use config::{Beacon, Config, ConfigError, Mount, Noise};
pub(crate) use state::{DELAY, PLACE_KNOWN, PLACE_UNKNOWN, Sight, State, THETA, X, Y, deviations};

use crate::search::{self, Bearing};
use crate::trail::{Trail, shifted};
use base::listed;
use base::{Duration, Instant};
use core::f64::consts::TAU;
use history::{Entry, History, Kind};
use navitools::odometry::SteeredWheels;
use navitools::{Motion, Point, Pose, wrap};
use state::{PLACE_X, PLACE_Y, Step, TURN};
use std::collections::VecDeque;

listed! {
    /// Quality of an estimate; values of `data_estimate_t`.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Quality {
        /// No pose known, no beacons received.
        Lost = 0 => "LOST",
        /// No reliable pose; beacons are received.
        Searching = 1 => "SEARCHING",
        /// Pose known to `Config::coarse`.
        Coarse = 2 => "COARSE",
        /// Pose known to `Config::fine`.
        Fine = 3 => "FINE",
    }
}

/// Estimate at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Pose of the rear axle's centre in the map, m and rad; meaningless below COARSE.
    pub pose: Pose,
    /// Velocity of the rear axle's centre, m/s and rad/s; of a base that goes sideways along its direction of travel.
    pub motion: Motion,
    /// That direction in the robot's frame, rad.
    pub drift: f64,
    /// Covariance of x, y, θ; m², m rad, rad².
    pub covariance: [[f64; 3]; 3],
    /// Quality.
    pub quality: Quality,
}

/// Estimated calibration parameters of the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Nuisances {
    /// Mounting angle of the sensor, rad.
    pub turn: f64,
    /// Relative error of measured distance: positive if the true distance is longer.
    pub scale: f64,
    /// Rotation that the odometry does not measure, rad/m (wheels of unequal size).
    pub bend: f64,
    /// Relative error of measured rotation: positive if the true rotation is larger.
    pub track: f64,
    /// Delay from a bearing's measurement to its time stamp, s.
    pub delay: f64,
    /// Place of the sensor in the robot's frame, m.
    pub place: Point,
}

/// Standard deviations of [`Nuisances`], in their units.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "those of the parameters")]
pub struct NuisanceDeviations {
    pub turn: f64,
    pub scale: f64,
    pub bend: f64,
    pub track: f64,
    pub delay: f64,
    pub place: f64,
}

/// Reason for refusing a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// Not finite, or beyond the limits of any robot of this kind.
    Value,
    /// Older than the last one.
    Backwards,
    /// Older than the history, or as far in the future.
    Time,
    /// Number of no beacon on the map.
    Unknown,
}

/// Accepted and refused measurements since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Motion steps accepted.
    pub ways: u64,
    /// Bearings accepted.
    pub bearings: u64,
    /// Accepted bearings outside the gate or classified as outliers.
    pub gated: u64,
    /// Accepted bearings not applied: the robot stood and the beacon had been used often enough.
    pub repeated: u64,
    /// Poses found by the global search.
    pub found: u64,
    /// Times that bearings contradicted the pose.
    pub doubted: u64,
    /// Refused: [`Refused::Value`].
    pub values: u64,
    /// Refused: [`Refused::Backwards`].
    pub backwards: u64,
    /// Refused: [`Refused::Time`].
    pub times: u64,
    /// Refused: [`Refused::Unknown`].
    pub unknown: u64,
}

/// What became of the bearings of a beacon since the start. For people: the filter decides nothing by it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BeaconUse {
    /// The last bearing that was compared with a known pose; `None`: none was.
    pub last: Option<Judged>,
    /// Bearings that were accepted, those of a standing robot that repeat and are not applied among them.
    pub accepted: u64,
    /// Bearings that were refused as outliers, at once or later.
    pub refused: u64,
}

/// A bearing and its fit to the pose at its instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// Its time stamp.
    pub stamp: Instant,
    /// Measured minus expected direction, rad, counter-clockwise.
    pub residual: f64,
    /// Expected standard deviation of the residual, of pose and measurement, rad; above 0.
    pub deviation: f64,
    /// Accepted; false if refused as an outlier.
    pub fits: bool,
}

impl BeaconUse {
    fn judge(&mut self, judged: Judged) {
        self.last = Some(judged);
        if judged.fits {
            self.accepted += 1;
        } else {
            self.refused += 1;
        }
    }

    /// Counts a bearing as refused that had been accepted.
    fn take_back(&mut self, stamp: Instant) {
        self.accepted = self.accepted.saturating_sub(1);
        self.refused += 1;
        if let Some(last) = self.last.as_mut().filter(|last| last.stamp == stamp) {
            last.fits = false;
        }
    }
}

/// Greatest plausible speed, m/s.
pub const SPEED_MAX: f64 = 10.0;
/// Greatest plausible rotation, rad/s.
pub const ROTATION_MAX: f64 = 20.0;
/// Longest gap in the odometry that is bridged.
const GAP: Duration = Duration::from_secs(2);
/// Standard deviation of unmeasured motion, m/√s and rad/√s.
const BLIND: (f64, f64) = (0.5, 0.5);
/// Maximum number of bearings that wait for the odometry to reach their instant.
const WAITING: usize = 64;
/// Maximum number of bearings of one beacon that are applied during one standstill.
const WHILE_STANDING: u8 = 3;
/// Log-likelihood ratio against the pose from which it is doubted: four outliers in a row.
const DOUBT: f64 = 11.5;
/// Log-likelihood ratio against the pose from which its quality is at most COARSE.
const UNEASY: f64 = 5.75;
/// Averaging length, in bearings, of the fraction of misfits, and the fraction from which other poses are searched for,
/// beyond twice that of the outliers: after a displacement by little, half of the bearings may still fit.
const LOOKED_AT: f64 = 8.0;
const MISFITS: f64 = 0.2;
/// Bearings of this time decide between the pose and its rivals.
const LATELY: Duration = Duration::from_secs(3);
/// Consecutive fitting bearings that end a doubt, and the deviations of the pose, m and rad, that they must have
/// reached: less than is left of [`WIDENED`] where they do not determine all of the pose, as those of one or two
/// beacons from one place.
const GOOD_AGAIN: u32 = 6;
const KNOWN_AGAIN: (f64, f64) = (0.3, 0.15);
/// Standard deviations, m and rad, that a doubted pose is given where too few beacons are seen for the search.
const WIDENED: (f64, f64) = (0.5, 0.25);
/// Ratio of expected variance to measurement variance from which a bearing has leverage, and the log-likelihood ratio
/// of all later bearings from which such a bearing is taken back.
const LEVERAGE: f64 = 4.0;
const TAKEN_BACK: f64 = 1.0;
/// Time after which a doubted pose without confirmation is given up.
const GIVEN_UP: Duration = Duration::from_secs(10);
/// Least time between two global searches.
const SEARCH_EVERY: Duration = Duration::from_millis(250);
/// Number of searches in vain after which the time between two grows once more, and its greatest factor.
const PATIENCE_STEP: u32 = 12;
const PATIENCE_MAX: u32 = 20;
/// Standard deviations of a pose, m and rad, from which the global search runs too.
const VAGUE: (f64, f64) = (0.7, 0.2);
/// Factor of the probabilities below which the search accepts a pose of a robot of which little is known.
const UNKNOWN_STRICTNESS: f64 = 0.05;
/// Log-likelihood ratio of bearings after a search, each as far as it is independent of the one before, that confirms
/// its pose: until then its quality is at most COARSE.
const CONFIRMED: f64 = 20.0;
/// Time within which sightings of a beacon belong to the same sweep or to consecutive ones.
const SWEEPS: Duration = Duration::from_secs(3);
/// Two misfits of a beacon whose innovations differ by less than this, rad, are no outliers.
const AGREE: f64 = 0.1;
/// Least time between two bearings of a beacon that the search uses.
const SEEN_APART: Duration = Duration::from_millis(300);
/// Time since the last bearing for which beacons count as received.
const SEEN_WITHIN: Duration = Duration::from_secs(3);
/// Standard deviations of the position, m, and heading, rad, without a pose.
const ANYWHERE: (f64, f64) = (1000.0, 3.2);
/// Time in which the random walk of a calibration parameter reaches its initial variance, s.
const CHANGES_IN: f64 = 2e5;

#[derive(Clone, Copy, Debug)]
struct Pending {
    at: Instant,
    stamp: Instant,
    beacon: usize,
    bearing: f64,
}

/// Bearings of one beacon applied last.
#[derive(Clone, Copy, Debug, Default)]
struct Applied {
    last: Option<Instant>,
    /// Number applied during the present standstill.
    standing: u8,
    misfit: Option<Misfit>,
}

/// Misfits of a beacon that agree with each other.
#[derive(Clone, Copy, Debug)]
struct Misfit {
    /// Time stamp of the first.
    since: Instant,
    last: Instant,
    innovation: f64,
    again: bool,
}

impl Applied {
    /// Records how the bearing of `at` fitted; `innovation` in rad.
    fn judge(&mut self, sight: &Sight, at: Instant, fits: bool, innovation: f64) {
        let before = self.misfit.filter(|misfit| at.since(misfit.last) <= SWEEPS);
        self.misfit = match before {
            _ if fits => None,
            Some(before) if wrap(innovation - before.innovation).abs() < AGREE => {
                Some(Misfit { last: at, innovation, again: true, ..before })
            }
            _ => Some(Misfit { since: sight.stamp(at), last: at, innovation, again: false }),
        };
    }
}

/// The filter of a robot whose sensor's place is known: `Config::place` has no effect.
pub type Filter = Kalman<PLACE_KNOWN>;
/// The filter of a robot whose sensor's place is known to `Config::place`, and found while it turns.
pub type PlacingFilter = Kalman<PLACE_UNKNOWN>;

/// The extended Kalman filter: takes motion steps and bearings, gives the pose. `N`: dimension of its state.
#[derive(Debug)]
pub struct Kalman<const N: usize> {
    config: Config,
    walk: [f64; N],
    history: History<N>,
    /// True if a pose is known; the calibration parameters are valid either way.
    has_pose: bool,
    started: bool,
    pending: VecDeque<Pending>,
    seen: VecDeque<Bearing>,
    trail: Trail,
    applied: Vec<Applied>,
    /// Log-likelihood ratio of the bearings against the pose.
    against: f64,
    /// Fraction of misfits among the last bearings, 0 to 1.
    misfits: f64,
    /// Log-likelihood ratio of the bearings for the pose since it was found, and whether it ever was [`CONFIRMED`].
    confirmed: f64,
    is_confirmed: bool,
    doubt: Option<Instant>,
    good: u32,
    /// Time stamp of the last bearing after which nothing contradicted the pose.
    clean: Instant,
    last_seen: Option<Instant>,
    searched: Instant,
    to_search: bool,
    /// Number of searches since the last one that found a pose.
    failed: u32,
    counts: Counts,
    /// By beacon, in the order of the map.
    uses: Vec<BeaconUse>,
}

impl<const N: usize> Kalman<N> {
    /// Makes a filter without a pose.
    ///
    /// # Errors
    /// The configuration is inconsistent.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        config.check()?;
        let state = State::new(&config);
        let applied = vec![Applied::default(); config.beacons.len()];
        let uses = vec![BeaconUse::default(); config.beacons.len()];
        Ok(Self {
            walk: core::array::from_fn(|place| state.cov[place][place] / CHANGES_IN),
            history: History::new(Instant::ZERO, &state),
            has_pose: false,
            started: false,
            pending: VecDeque::with_capacity(WAITING),
            seen: VecDeque::with_capacity(WAITING),
            trail: Trail::default(),
            applied,
            against: 0.0,
            misfits: 0.0,
            confirmed: 0.0,
            is_confirmed: false,
            doubt: None,
            good: 0,
            clean: Instant::ZERO,
            last_seen: None,
            searched: Instant::ZERO,
            to_search: false,
            failed: 0,
            counts: Counts::default(),
            uses,
            config,
        })
    }

    /// Accepted and refused measurements.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// What became of the bearings of each beacon, in the order of the map.
    #[must_use]
    pub fn uses(&self) -> &[BeaconUse] {
        &self.uses
    }

    /// Estimated calibration parameters.
    #[must_use]
    pub fn nuisances(&self) -> Nuisances {
        self.history.last().state.nuisances(self.config.mount.into())
    }

    /// Standard deviations of [`Self::nuisances`]; of the place the larger one, m.
    #[must_use]
    pub fn nuisance_deviations(&self) -> NuisanceDeviations {
        self.history.last().state.nuisance_deviations()
    }

    /// Instant of the last motion step.
    #[must_use]
    pub fn at(&self) -> Instant {
        self.history.last().at
    }

    /// Takes the velocity since the last step, m/s and rad/s, as the wheels measured it at `at`. The first call only
    /// sets the time.
    ///
    /// # Errors
    /// The measurement is refused; the state is unchanged.
    pub fn odometry(&mut self, at: Instant, rates: Motion) -> Result<(), Refused> {
        self.take_way(at, rates, 0.0, self.config.odometry, self.config.wheels)
    }

    /// Takes the velocity since the last step of a base that does not steer, as its wheels measured it at `at`: of its
    /// origin forward and to the left, m/s, and rad/s.
    ///
    /// # Errors
    /// The measurement is refused; the state is unchanged.
    pub fn velocity(&mut self, at: Instant, forward: f64, left: f64, rotation: f64) -> Result<(), Refused> {
        let (way, drift) = along(forward, left);
        self.take_way(at, Motion { rotation, ..way }, drift, self.config.odometry, None)
    }

    /// Takes the same where the rotation was not measured by the wheels, with the noise of both.
    ///
    /// # Errors
    /// The measurement is refused; the state is unchanged.
    pub fn turned(&mut self, at: Instant, forward: f64, left: f64, rotation: f64, noise: Noise) -> Result<(), Refused> {
        let (way, drift) = along(forward, left);
        self.take(at, Motion { rotation, ..way }, |seconds, rates, spin| {
            let step = step(seconds, rates, noise, None, spin);
            Step { drift, bend: Motion::default(), gyro: true, ..step }
        })
    }

    /// Takes a velocity from a source with other noise.
    ///
    /// # Errors
    /// The measurement is refused; the state is unchanged.
    pub fn way(&mut self, at: Instant, rates: Motion, noise: Noise) -> Result<(), Refused> {
        self.take_way(at, rates, 0.0, noise, None)
    }

    fn take_way(
        &mut self,
        at: Instant,
        rates: Motion,
        drift: f64,
        noise: Noise,
        wheels: Option<SteeredWheels>,
    ) -> Result<(), Refused> {
        self.take(at, rates, |time, rates, spin| Step { drift, ..step(time, rates, noise, wheels, spin) })
    }

    /// Takes a way with the step that it makes of the time since the last one.
    fn take(
        &mut self,
        at: Instant,
        rates: Motion,
        step: impl FnOnce(Duration, Motion, f64) -> Step,
    ) -> Result<(), Refused> {
        // Comparisons with NaN are false.
        if !(rates.translation.abs() <= SPEED_MAX && rates.rotation.abs() <= ROTATION_MAX) {
            self.counts.values += 1;
            return Err(Refused::Value);
        }
        if !self.started {
            self.started = true;
            let state = self.history.last().state;
            self.history = History::new(at, &state);
            self.trail.push(at, Motion::default(), 0.0, (0.0, 0.0));
            self.counts.ways += 1;
            return Ok(());
        }
        if at <= self.at() {
            self.counts.backwards += 1;
            return Err(Refused::Backwards);
        }
        self.counts.ways += 1;
        let step = step(at.since(self.at()), rates, self.config.spin);
        self.push(at, step);
        Ok(())
    }

    /// Bridges unmeasured motion up to `at`: the pose becomes less certain.
    pub fn blind(&mut self, at: Instant) {
        if self.started && at > self.at() {
            let seconds = at.since(self.at()).as_secs_f64();
            let variance = |rate: f64| rate * rate * seconds;
            let (along, turn) = (variance(BLIND.0), variance(BLIND.1));
            self.push(at, Step { seconds, along, turn, ..Step::default() });
        }
    }

    fn push(&mut self, at: Instant, step: Step) {
        self.settle();
        if step.way != Motion::default() {
            self.applied.iter_mut().for_each(|applied| applied.standing = 0);
        }
        let way = self.history.last().state.corrected(&step);
        self.trail.push(at, way, step.drift, (step.along, step.turn));
        self.history.push(at, step);
        while let Some(next) = self.pending.front().copied().filter(|next| next.at <= at) {
            self.pending.pop_front();
            self.insert(next);
        }
    }

    /// Takes a bearing, rad counter-clockwise from the robot's x axis, with time stamp `stamp`. Bearings may come in
    /// any order, up to two seconds late.
    ///
    /// # Errors
    /// The measurement is refused; the state is unchanged.
    pub fn bearing(&mut self, stamp: Instant, id: i32, bearing: f64) -> Result<(), Refused> {
        let refused = self.take_bearing(stamp, id, bearing);
        match refused {
            Ok(()) => self.counts.bearings += 1,
            Err(Refused::Value) => self.counts.values += 1,
            Err(Refused::Unknown) => self.counts.unknown += 1,
            Err(Refused::Time | Refused::Backwards) => self.counts.times += 1,
        }
        refused
    }

    fn take_bearing(&mut self, stamp: Instant, id: i32, bearing: f64) -> Result<(), Refused> {
        // A value of many turns is not an angle.
        if !bearing.is_finite() || bearing.abs() > 100.0 {
            return Err(Refused::Value);
        }
        let beacon = self.config.beacons.iter().position(|beacon| beacon.id == id).ok_or(Refused::Unknown)?;
        if !self.started {
            return Err(Refused::Time);
        }
        let delay = self.history.last().state.mean[DELAY].clamp(-1.0, 1.5);
        let at = shifted(stamp, -delay);
        if at < self.history.first_at() || at > self.at() + history::HISTORY {
            return Err(Refused::Time);
        }
        let pending = Pending { at, stamp, beacon, bearing: wrap(bearing) };
        if at <= self.at() {
            self.insert(pending);
        } else if self.pending.len() < WAITING {
            let place = self.pending.partition_point(|other| other.at <= at);
            self.pending.insert(place, pending);
        } else {
            return Err(Refused::Time);
        }
        Ok(())
    }

    /// Inserts a bearing into the history at its instant.
    fn insert(&mut self, pending: Pending) {
        let Pending { at, stamp, beacon, bearing } = pending;
        if at < self.history.first_at() {
            return;
        }
        let place = self.history.place(at);
        let step = self.history.step_at(place);
        let before = *self.history.before(place);
        let applied = &mut self.applied[beacon];
        let standing = step.way == Motion::default();
        let used = !standing || applied.standing < WHILE_STANDING;
        let variance = self.config.bearing * self.config.bearing;
        // Noise that lasts repeats in the next bearing of this beacon, which therefore carries less information.
        let apart = |last: Instant| at.since(last).max(last.since(at)).as_secs_f64();
        let weight = applied.last.map_or(1.0, |last| self.config.independence(apart(last)));
        if used {
            applied.last = applied.last.max(Some(at));
            applied.standing = if standing { applied.standing + 1 } else { 0 };
        } else {
            self.counts.repeated += 1;
        }
        let later = if stamp >= at { stamp.since(at).as_secs_f64() } else { -at.since(stamp).as_secs_f64() };
        let place_of = self.config.beacons[beacon].at;
        let (mount, rates) = (self.config.mount.into(), step.rates());
        let sight = Sight { number: beacon, beacon: place_of, bearing, variance, weight, mount, rates, later };
        let kind = Kind::Bearing { sight, fresh: true, used, accepted: false };
        self.history.insert(place, &Entry { at, kind, ..before });
        self.see(Bearing { stamp, beacon, place: place_of, bearing });
        self.last_seen = self.last_seen.max(Some(at));
        self.to_search = true;
    }

    /// Keeps a bearing for the global search; those of one beacon at some distance, so that they span its window.
    fn see(&mut self, seen: Bearing) {
        let stamp = seen.stamp;
        let near = |other: &Bearing| {
            other.beacon == seen.beacon && stamp.since(other.stamp).max(other.stamp.since(stamp)) < SEEN_APART
        };
        if self.seen.iter().any(near) {
            return;
        }
        let place = self.seen.partition_point(|other| other.stamp <= stamp);
        self.seen.insert(place, seen);
        let old = |seen: &Bearing| stamp.since(seen.stamp) > search::BEARING_WINDOW;
        while self.seen.len() > search::BEARINGS_MAX || self.seen.front().is_some_and(old) {
            self.seen.pop_front();
        }
    }

    /// Processes new measurements, and runs the global search where needed.
    fn settle(&mut self) {
        let before = self.misfits;
        let worst = self.work_out();
        if self.has_pose && self.misfits > before {
            self.reconsider();
        }
        if self.has_pose {
            self.judge(worst);
        }
        if self.to_search && (!self.has_pose || self.doubt.is_some() || self.is_vague() || self.has_misfits()) {
            self.search();
        }
        self.to_search = false;
    }

    /// Processes new measurements; returns the largest log-likelihood ratio against the pose on the way.
    fn work_out(&mut self) -> f64 {
        let (mut against, mut good, mut clean) = (self.against, self.good, self.clean);
        let mut worst = against;
        let wild = self.config.wild;
        while let Some((mut state, entry)) = self.history.next() {
            match &mut entry.kind {
                Kind::Begin => {}
                Kind::Way(step) => state.predict(step, &self.walk),
                Kind::Bearing { sight, fresh, used, accepted } if self.has_pose => {
                    if let Some(fit) = state.fit(sight) {
                        let (own, other) = ((1.0 - wild) * fit.density(), wild / TAU);
                        let right = own / (own + other);
                        let inside = fit.distance() <= self.config.gate;
                        if inside && *used {
                            state.update(&fit, right);
                        }
                        if std::mem::take(fresh) {
                            let likely = libm::log((own + other) * TAU);
                            against = (against - likely).max(0.0);
                            self.confirmed += sight.weight * likely;
                            self.is_confirmed |= self.confirmed >= CONFIRMED;
                            worst = worst.max(against);
                            let fits = inside && right > 0.5;
                            good = if fits { good + 1 } else { 0 };
                            if against <= 0.0 {
                                clean = sight.stamp(entry.at);
                            }
                            self.applied[sight.number].judge(sight, entry.at, fits, fit.innovation);
                            *accepted = fits;
                            let (residual, deviation) = (fit.innovation, libm::sqrt(fit.variance));
                            let stamp = sight.stamp(entry.at);
                            self.uses[sight.number].judge(Judged { stamp, residual, deviation, fits });
                            self.counts.gated += u64::from(!fits);
                            self.misfits += (f64::from(u8::from(!fits)) - self.misfits) / LOOKED_AT;
                        }
                    }
                }
                Kind::Bearing { fresh, .. } => *fresh = false,
            }
            entry.state = state;
        }
        (self.against, self.good, self.clean) = (against, good, clean);
        worst
    }

    /// Takes back a bearing of high leverage after which others do not fit, if all later measurements are likelier
    /// without it.
    fn reconsider(&mut self) {
        let mut best = (TAKEN_BACK, None);
        for place in self.history.bearings() {
            let before = self.history.before(place).state;
            let mut entries = self.history.from(place);
            let Some(Entry { kind: Kind::Bearing { sight, .. }, .. }) = entries.next() else { continue };
            if before.fit(sight).is_none_or(|fit| fit.lasting <= LEVERAGE * sight.variance / sight.weight) {
                continue;
            }
            let with = self.likely(before, self.history.from(place));
            let without = libm::log(self.config.wild) + self.likely(before, entries);
            if without - with > best.0 {
                best = (without - with, Some(place));
            }
        }
        if let (gain, Some(place)) = best {
            if let Some((at, sight)) = self.history.take_back(place) {
                self.uses[sight.number].take_back(sight.stamp(at));
            }
            self.counts.gated += 1;
            self.against = (self.against - gain).max(0.0);
            self.work_out();
        }
    }

    /// Log-likelihood of the bearings from a state on, relative to uniformly distributed directions.
    fn likely<'a>(&self, mut state: State<N>, entries: impl Iterator<Item = &'a Entry<N>>) -> f64 {
        let mut sum = 0.0;
        for entry in entries {
            match &entry.kind {
                Kind::Begin => {}
                Kind::Way(step) => state.predict(step, &self.walk),
                Kind::Bearing { sight, used, .. } => {
                    let Some(fit) = state.fit(sight) else { continue };
                    let (own, other) = ((1.0 - self.config.wild) * fit.density(), self.config.wild / TAU);
                    sum += libm::log((own + other) * TAU);
                    if *used && fit.distance() <= self.config.gate {
                        state.update(&fit, own / (own + other));
                    }
                }
            }
        }
        sum
    }

    fn judge(&mut self, worst: f64) {
        let now = self.at();
        let displaced = self.displaced();
        match self.doubt {
            None if worst >= DOUBT || displaced.is_some() => {
                self.counts.doubted += 1;
                self.doubt = Some(now);
                self.against = 0.0;
                // Bearings from before the error would support the old pose.
                let clean = displaced.map_or(self.clean, |since| since.min(self.clean));
                self.seen.retain(|seen| seen.stamp > clean);
                self.good = 0;
                if self.distinct() < 3 {
                    self.widen();
                }
            }
            Some(_) if self.good >= GOOD_AGAIN && self.against < 1.0 && self.is_within(KNOWN_AGAIN) => {
                self.doubt = None;
            }
            Some(since) if now.since(since) >= GIVEN_UP || worst >= DOUBT => self.give_up(),
            _ => {}
        }
    }

    /// Instant since which two beacons repeatedly appear in the same wrong direction: the robot was displaced. Outliers
    /// have random directions; bearings that happen to fit do not refute this.
    fn displaced(&self) -> Option<Instant> {
        let now = self.at();
        let again = |misfit: &Misfit| misfit.again && now.since(misfit.last) <= SWEEPS;
        let again = || self.applied.iter().filter_map(|applied| applied.misfit).filter(again);
        let since = again().map(|misfit| misfit.since).min()?;
        // A bearing with this time stamp was measured at the new place.
        (again().count() >= 2).then_some(since - Duration::from_millis(1))
    }

    /// Number of different beacons among the kept bearings.
    fn distinct(&self) -> usize {
        (0..self.config.beacons.len()).filter(|place| self.seen.iter().any(|seen| seen.beacon == *place)).count()
    }

    /// Widens the covariance when there are too few beacons for the search: after a small displacement the filter
    /// recovers by itself.
    fn widen(&mut self) {
        let mut state = self.history.last().state;
        state.cov[X][X] += WIDENED.0 * WIDENED.0;
        state.cov[Y][Y] += WIDENED.0 * WIDENED.0;
        state.cov[THETA][THETA] += WIDENED.1 * WIDENED.1;
        self.history.restart(&state);
        self.applied.fill(Applied::default());
    }

    fn give_up(&mut self) {
        self.has_pose = false;
        self.doubt = None;
        self.against = 0.0;
    }

    fn is_vague(&self) -> bool {
        !self.is_within(VAGUE)
    }

    fn is_within(&self, (most, turn): (f64, f64)) -> bool {
        let (position, heading) = self.history.last().state.deviations();
        position <= most && heading <= turn
    }

    fn has_misfits(&self) -> bool {
        self.misfits > MISFITS + 2.0 * self.config.wild
    }

    fn search(&mut self) {
        let last = *self.history.last();
        // What does not lead to a pose of an unknown robot is tried less and less often.
        let patience = if N == PLACE_UNKNOWN { (1 + self.failed / PATIENCE_STEP).min(PATIENCE_MAX) } else { 1 };
        if last.at.since(self.searched) < SEARCH_EVERY * patience {
            return;
        }
        self.searched = last.at;
        self.failed += 1;
        let delay = (last.state.mean[DELAY], libm::sqrt(last.state.cov[DELAY][DELAY]));
        let mut sensor = search::Sensor {
            mount: self.config.mount.into(),
            spread: 0.0,
            turn: last.state.mean[TURN],
            delay,
            strictness: 1.0,
        };
        if N == PLACE_UNKNOWN {
            sensor.strictness = UNKNOWN_STRICTNESS;
            sensor.mount = last.state.place(sensor.mount);
            sensor.spread = last.state.cov[PLACE_X][PLACE_X].max(last.state.cov[PLACE_Y][PLACE_Y]);
        }
        let certain = self.has_pose && self.doubt.is_none() && !self.is_vague();
        let seen = self.seen.make_contiguous();
        // While only the misfits contradict the pose, older bearings may belong to another place.
        let (since, share) = if certain { (self.clean.max(last.at - LATELY), 0.7) } else { (Instant::ZERO, 0.6) };
        let seen = &seen[seen.partition_point(|seen| seen.stamp < since)..];
        let own = self.has_pose.then(|| last.state.pose());
        let Some(found) = search::search(&self.config, seen, &self.trail, sensor, own, share) else { return };
        self.failed = 0;
        if let Some(own) = own
            && !self.is_vague()
            && search::is_same(own, found.pose)
            && self.explains(&found)
        {
            (self.doubt, self.against, self.misfits) = (None, 0.0, 0.0);
            // What was displaced must show itself again.
            self.applied.iter_mut().for_each(|applied| applied.misfit = None);
            return;
        }
        self.counts.doubted += u64::from(certain);
        self.begin(found.pose, &found.covariance, Some((found.delay, found.d_pose_d_delay)));
        self.counts.found += 1;
    }

    /// True if the pose lies as close to one that was found as their covariances allow. Where it does not, it is wrong
    /// by little, and no bearing within the gate would put it right.
    fn explains(&self, found: &search::Fix) -> bool {
        let own = self.history.last().state;
        let off = [
            own.mean[X] - found.pose.x,
            own.mean[Y] - found.pose.y,
            wrap(own.mean[THETA] - found.pose.theta.radians()),
        ];
        let both = own.pose_covariance();
        let both = core::array::from_fn(|row| core::array::from_fn(|col| both[row][col] + found.covariance[row][col]));
        search::inverse::<3>(&both).is_some_and(|(inverse, _)| {
            let square = (0..3).flat_map(|row| (0..3).map(move |column| (row, column)));
            square.map(|(row, column)| off[row] * inverse[row][column] * off[column]).sum::<f64>() <= self.config.gate
        })
    }

    /// Sets the pose at the last motion step. `delay`, for a pose found by bearings: the delay with its standard
    /// deviation, s, and the derivative of the pose by it.
    fn begin(&mut self, pose: Pose, covariance: &[[f64; 3]; 3], delay: Option<((f64, f64), [f64; 3])>) {
        let mut old = self.history.last().state;
        let mut state = State { mean: old.mean, cov: [[0.0; N]; N] };
        (state.mean[X], state.mean[Y], state.mean[THETA]) = (pose.x, pose.y, pose.theta.radians());
        // Correlations of the pose with mounting angle, delay and the sensor's place.
        let mut by = [[0.0; N]; 3];
        if let Some(((mean, deviation), by_delay)) = delay {
            state.mean[DELAY] = mean;
            let less = deviation / libm::sqrt(old.cov[DELAY][DELAY]).max(1e-9);
            (0..N).for_each(|place| {
                old.cov[DELAY][place] *= less.min(1.0);
                old.cov[place][DELAY] *= less.min(1.0);
            });
            by[THETA][TURN] = -1.0;
            (by[X][DELAY], by[Y][DELAY], by[THETA][DELAY]) = (by_delay[0], by_delay[1], by_delay[2]);
            if N == PLACE_UNKNOWN {
                let (sin, cos) = pose.theta.sin_cos();
                (by[X][PLACE_X], by[X][PLACE_Y]) = (-cos, sin);
                (by[Y][PLACE_X], by[Y][PLACE_Y]) = (-sin, -cos);
            }
        }
        for row in 3..N {
            state.cov[row][3..].copy_from_slice(&old.cov[row][3..]);
        }
        for row in 0..3 {
            for column in 3..N {
                let value = (3..N).map(|place| by[row][place] * old.cov[place][column]).sum();
                state.cov[row][column] = value;
                state.cov[column][row] = value;
            }
        }
        for row in 0..3 {
            for column in 0..3 {
                let rest: f64 = (3..N).map(|place| state.cov[row][place] * by[column][place]).sum();
                state.cov[row][column] = covariance[row][column] + rest;
            }
        }
        self.history.restart(&state);
        // A standing robot must take bearings for the new pose, too.
        self.applied.fill(Applied::default());
        self.has_pose = true;
        self.doubt = None;
        (self.against, self.misfits, self.good) = (0.0, 0.0, 0);
        // A pose that was set by hand is believed.
        (self.confirmed, self.is_confirmed) = (0.0, delay.is_none());
        self.clean = self.at();
    }

    /// Sets the pose by hand, with its covariance of x, y, θ; m², m rad, rad².
    ///
    /// # Errors
    /// A value is not finite, or the covariance is not positive semidefinite.
    pub fn set(&mut self, pose: Pose, covariance: [[f64; 3]; 3]) -> Result<(), Refused> {
        let whole = covariance.iter().flatten().chain([&pose.x, &pose.y]).all(|number| number.abs() < 1e9);
        let definite = (0..3).all(|row| {
            covariance[row][row] >= 0.0
                && (0..row).all(|column| {
                    let (upper, lower) = (covariance[column][row], covariance[row][column]);
                    (upper - lower).abs() < 1e-9 && upper * lower <= covariance[row][row] * covariance[column][column]
                })
        });
        if !(whole && definite && pose.theta.radians().is_finite()) {
            self.counts.values += 1;
            return Err(Refused::Value);
        }
        self.settle();
        // A pose given by hand is never exact.
        let mut wide = covariance;
        for (place, least) in [1e-4, 1e-4, 1e-4].iter().enumerate() {
            wide[place][place] += least;
        }
        self.begin(pose, &wide, None);
        self.seen.clear();
        Ok(())
    }

    /// The estimate at `now`, predicted from the last motion step with its velocity.
    pub fn estimate(&mut self, now: Instant) -> Estimate {
        self.settle();
        let last = self.history.last();
        let mut state = last.state;
        let step = self.history.last_step();
        let ahead = now.since(last.at).min(GAP);
        if step.seconds > 0.0 && self.has_pose {
            state.predict(&step.part(ahead.as_secs_f64() / step.seconds), &self.walk);
        }
        let motion = state.corrected(&step.rates());
        let heard = self.last_seen.is_some_and(|seen| now.since(seen) <= SEEN_WITHIN);
        let without = if heard { Quality::Searching } else { Quality::Lost };
        if !self.has_pose {
            let (far, round) = (ANYWHERE.0 * ANYWHERE.0, ANYWHERE.1 * ANYWHERE.1);
            let covariance = [[far, 0.0, 0.0], [0.0, far, 0.0], [0.0, 0.0, round]];
            return Estimate { pose: Pose::default(), motion, drift: step.drift, covariance, quality: without };
        }
        let mut covariance = state.pose_covariance();
        let (position, heading) = deviations(&covariance);
        let mut quality = match () {
            () if self.doubt.is_some() => without,
            () if position <= self.config.fine_m && heading <= self.config.fine_rad => Quality::Fine,
            () if position <= self.config.coarse_m && heading <= self.config.coarse_rad => Quality::Coarse,
            () => without,
        };
        let doubtful = match () {
            () if self.doubt.is_some() => (25.0, 3.0),
            () if self.against >= UNEASY => (0.25, 0.03),
            () => (0.0, 0.0),
        };
        if self.against >= UNEASY || !self.is_confirmed {
            quality = quality.min(Quality::Coarse);
        }
        covariance[X][X] += doubtful.0;
        covariance[Y][Y] += doubtful.0;
        covariance[THETA][THETA] += doubtful.1;
        Estimate { pose: state.pose(), motion, drift: step.drift, covariance, quality }
    }
}

/// The way, m/s, and its direction in the robot's frame, rad, of a velocity forward and to the left.
fn along(forward: f64, left: f64) -> (Motion, f64) {
    // Backward is a negative way, whichever direction it goes aside.
    let drift = if left == 0.0 { 0.0 } else { libm::atan2(libm::copysign(left, forward * left), libm::fabs(forward)) };
    (Motion { translation: libm::copysign(libm::hypot(forward, left), forward), rotation: 0.0 }, drift)
}

/// Motion step of this duration at these velocities, by these wheels if they are known; `spin`: way of the wheels by a
/// turn on the spot, m/rad.
pub(crate) fn step(time: Duration, rates: Motion, noise: Noise, wheels: Option<SteeredWheels>, spin: f64) -> Step {
    let seconds = time.as_secs_f64();
    if time > GAP {
        let variance = |rate: f64| rate * rate * seconds * seconds;
        return Step { seconds, along: variance(BLIND.0), turn: variance(BLIND.1), ..Step::default() };
    }
    let way = Motion { translation: rates.translation * seconds, rotation: rates.rotation * seconds };
    // Standing wheels add no noise.
    if way == Motion::default() {
        return Step { seconds, ..Step::default() };
    }
    let metres = way.translation.abs().max(way.rotation.abs() * spin);
    let variance = |per_m: f64, per_s: f64| per_m * per_m * metres + per_s * per_s * seconds;
    // What makes the wheels unequal adds more in a turn, its noise too.
    let straight = Motion { translation: 0.0, rotation: 1.0 };
    let turns = way.translation != 0.0;
    let more = wheels.filter(|_| turns).map_or(straight, |wheels| wheels.unequal(way.rotation / way.translation));
    let bend = Motion { translation: more.translation * way.translation, rotation: more.rotation * way.translation };
    let turn = variance(noise.turn_per_m, noise.turn_per_s);
    let along = variance(noise.along_per_m, noise.along_per_s) + more.translation * more.translation * turn;
    Step { seconds, way, drift: 0.0, bend, along, turn: more.rotation * more.rotation * turn, gyro: false }
}
