//! Tracker of people: finds them in sonar echoes that the map does not explain.
//!
//! Each track is a Kalman filter over position and velocity on the floor, with an existence probability. An echo is
//! precise in distance and as imprecise in direction as the beam is wide. A sonar that covers a track without an echo
//! lowers its existence probability, more at close range, because clothes absorb sound beyond a metre
//! (docs/facts/robot.md 2.1). A single echo does not confirm a track: crosstalk and noise cause false ones in every
//! round. A track without echoes is deleted within seconds, and its position uncertainty grows meanwhile.

use crate::ranges::READING_VALID_FOR;
use base::Instant;
use navitools::Point;

/// Maximum number of tracks.
const TRACKS_MAX: usize = 24;
/// Distance from the leg that returns the echo to the middle of the person, m.
const LEG_TO_MIDDLE_M: f64 = 0.12;
/// Standard deviation of a distance, m: noise, which of the two legs it was, and the age of the reading while the
/// person walks.
const DISTANCE_SIGMA_M: f64 = 0.13;
/// Standard deviation across the beam: share of half the beam's width at that distance, and lower bound in m.
const ACROSS_SIGMA_SHARE: f64 = 0.4226;
const ACROSS_SIGMA_MIN_M: f64 = 0.08;
/// Spectral density of the acceleration: growth of the velocity's variance, m²/s³.
const ACCELERATION_NOISE: f64 = 0.6;
/// Initial standard deviation of the velocity, m/s.
const VELOCITY_SIGMA_MPS: f64 = 0.65;
/// Association gate: an echo belongs to a track if its squared Mahalanobis distance is below this.
const GATE: f64 = 9.0;
/// False alarms per metre of distance and reading: short and random readings.
const FALSE_ALARMS_PER_M: f64 = 0.02;
/// Initial existence probability of a track, from one echo that the map does not explain.
const EXISTENCE_INITIAL: f64 = 0.25;
/// Existence probabilities below which a track is deleted and above which it is confirmed.
const DELETE_BELOW: f64 = 0.04;
const CONFIRM_ABOVE: f64 = 0.7;
/// Existence probability below which a confirmed track loses its confirmation.
const UNCONFIRM_BELOW: f64 = 0.3;
/// Existence probability above which a track is reported; a single echo is enough.
const REPORT_ABOVE: f64 = 0.2;
/// Probability that a working sonar detects a person on its axis: within a metre, and beyond.
pub const SONAR_DETECTION: (f64, f64) = (0.75, 0.38);
/// Time without an echo after which the existence probability is halved, s.
const EXISTENCE_HALF_LIFE_S: f64 = 2.0;
/// Tracks closer to each other than this are merged, m.
const MERGE_DISTANCE_M: f64 = 0.30;
/// Maximum distance of a standing person from the place of its first echo, m.
const STANDS_WITHIN_M: f64 = 0.25;
/// Time, s, and number of echoes at one place from which a person is known to stand.
const STANDS_AFTER_S: f64 = 1.5;
const STANDS_AFTER_ECHOES: u8 = 8;
/// Position uncertainty above which a track is deleted, m.
const SIGMA_MAX_M: f64 = 1.0;
/// Longest gap between two rounds; all tracks are deleted after a longer one, s.
const ROUND_GAP_MAX_S: f64 = 1.0;

/// Reading of one sonar in a round.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Instant at which the sonar fired.
    pub at: Instant,
    /// Position of the sonar in the map, m.
    pub from: Point,
    /// Direction of the beam's axis in the map: cosine and sine.
    pub axis: (f64, f64),
    /// Tangent of half the beam's opening angle.
    pub spread: f64,
    /// Measured distance, m; `None` without an echo.
    pub echo: Option<f64>,
    /// Range within which a leg returns an echo, m.
    pub reach: f64,
    /// Probability that a person on the axis returns one: within a metre, and beyond.
    pub detection: (f64, f64),
    /// True if the map explains the echo.
    pub mapped: bool,
}

/// Person at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Person {
    /// Number of the track, from 1, unchanged while it lasts; 0 as long as it has not been confirmed.
    pub id: i32,
    /// Middle of the person in the map, m.
    pub at: Point,
    /// Velocity in the map, m/s.
    pub velocity: (f64, f64),
    /// Standard deviation of the position, m.
    pub sigma: f64,
    /// Standard deviation of the velocity, m/s.
    pub velocity_sigma: f64,
    /// True if the track is confirmed; otherwise it may be a false alarm.
    pub confirmed: bool,
    /// True if it is known to stand: it was heard often enough for long enough at one place.
    pub stands: bool,
}

/// Position and velocity (x, y, vx, vy) with their covariance.
#[derive(Clone, Copy, Debug)]
struct Track {
    /// Number, from the first confirmation on; 0 before.
    id: i32,
    mean: [f64; 4],
    covariance: [[f64; 4]; 4],
    existence: f64,
    /// True once the existence probability exceeds [`CONFIRM_ABOVE`], until it falls below [`UNCONFIRM_BELOW`].
    confirmed: bool,
    /// Place that it has not left by more than [`STANDS_WITHIN_M`], since when, and its echoes since then.
    here: Point,
    here_since: Instant,
    echoes_here: u8,
}

/// All tracks.
#[derive(Debug)]
pub struct People {
    tracks: Vec<Track>,
    /// Firing instant of the last sonar.
    at: Instant,
    /// Number of the last track that was confirmed.
    last_id: i32,
}

impl Default for People {
    fn default() -> Self {
        Self { tracks: Vec::with_capacity(TRACKS_MAX), at: Instant::ZERO, last_id: 0 }
    }
}

impl People {
    /// Processes a round of readings, ordered by instant. `covered` is true for points under the robot itself.
    pub fn update(&mut self, round: &[Reading], covered: impl Fn(Point) -> bool) {
        for reading in round {
            self.predict(reading.at);
            self.process(reading);
        }
        self.tracks
            .retain(|track| track.existence >= DELETE_BELOW && track.sigma() <= SIGMA_MAX_M && !covered(track.at()));
        self.merge();
        for track in &mut self.tracks {
            track.confirmed = track.existence >= if track.confirmed { UNCONFIRM_BELOW } else { CONFIRM_ABOVE };
            if track.confirmed && track.id == 0 {
                self.last_id = self.last_id.checked_add(1).unwrap_or(1);
                track.id = self.last_id;
            }
        }
    }

    /// Deletes all tracks; the numbers of later ones go on.
    pub fn clear(&mut self) {
        self.tracks.clear();
        self.at = Instant::ZERO;
    }

    /// Predicts all tracks to `at` and lets their existence probabilities decay.
    fn predict(&mut self, at: Instant) {
        let dt = at.since(self.at).as_secs_f64();
        if dt <= 0.0 {
            return;
        }
        self.at = at;
        if dt > ROUND_GAP_MAX_S {
            self.tracks.clear();
        }
        let fade = libm::exp2(-dt / EXISTENCE_HALF_LIFE_S);
        for track in &mut self.tracks {
            track.predict(dt);
            track.existence *= fade;
        }
    }

    /// Updates all tracks with one reading, and starts a new track if the echo belongs to none of them.
    fn process(&mut self, reading: &Reading) {
        let echo = reading.echo.filter(|distance| !reading.mapped && *distance <= reading.reach);
        let nearest = |(number, track): (usize, &Track)| {
            let echo = echo.map(|distance| Echo::of(reading, distance, track))?;
            (echo.off < GATE).then_some((number, echo))
        };
        let found = self.tracks.iter().enumerate().filter_map(nearest).min_by(|a, b| a.1.cost().total_cmp(&b.1.cost()));
        for (number, track) in self.tracks.iter_mut().enumerate() {
            match found {
                Some((of, echo)) if of == number => track.detect(reading, &echo),
                _ => track.miss(reading),
            }
        }
        if let (None, Some(distance)) = (found, echo) {
            self.add(Track::new(reading, distance));
        }
    }

    fn add(&mut self, track: Track) {
        if self.tracks.len() < TRACKS_MAX {
            return self.tracks.push(track);
        }
        let least = self.tracks.iter_mut().min_by(|a, b| a.existence.total_cmp(&b.existence));
        if let Some(least) = least.filter(|least| least.existence < track.existence) {
            *least = track;
        }
    }

    /// Merges tracks at one place: the more probable one remains, under the lower number.
    fn merge(&mut self) {
        let mut number = 0;
        while number < self.tracks.len() {
            let one = self.tracks[number];
            let same = |other: &Track| other.at().distance(one.at()) < MERGE_DISTANCE_M;
            let more_probable = |(n, other): (usize, &Track)| {
                n != number
                    && same(other)
                    && (other.existence > one.existence || (other.existence == one.existence && n < number))
            };
            if let Some(remains) = self.tracks.iter().enumerate().position(more_probable) {
                let id = &mut self.tracks[remains].id;
                *id = if *id == 0 || one.id == 0 { (*id).max(one.id) } else { (*id).min(one.id) };
                self.tracks.swap_remove(number);
            } else {
                number += 1;
            }
        }
    }

    /// Where all tracks are.
    pub fn places(&self) -> impl Iterator<Item = Point> + '_ {
        self.tracks.iter().map(Track::at)
    }

    /// People who are present, or may be, extrapolated to `now`.
    pub fn around(&self, now: Instant) -> impl Iterator<Item = Person> + '_ {
        let late = now.since(self.at);
        let (fresh, late) = (late <= READING_VALID_FOR, late.as_secs_f64());
        let probable = move |track: &&Track| fresh && track.existence >= REPORT_ABOVE;
        self.tracks.iter().filter(probable).map(move |track| {
            let mut track = *track;
            track.predict(late);
            let [.., vx, vy] = track.mean;
            let velocity_sigma = libm::sqrt((track.covariance[2][2] + track.covariance[3][3]) / 2.0);
            Person {
                id: track.id,
                at: track.at(),
                velocity: (vx, vy),
                sigma: track.sigma(),
                velocity_sigma,
                confirmed: track.confirmed,
                stands: track.stands(self.at),
            }
        })
    }
}

/// Echo relative to a track: deviation along the beam and across it, m.
#[derive(Clone, Copy, Debug)]
struct Echo {
    distance: f64,
    along: f64,
    across: f64,
    /// Variances along and across, m².
    spread: (f64, f64),
    /// Squared Mahalanobis distance.
    off: f64,
}

impl Echo {
    fn of(reading: &Reading, distance: f64, track: &Track) -> Self {
        let (cos, sin) = reading.axis;
        let middle = distance + LEG_TO_MIDDLE_M;
        let dx = reading.from.x + middle * cos - track.mean[0];
        let dy = reading.from.y + middle * sin - track.mean[1];
        let (along, across) = (dx * cos + dy * sin, dy * cos - dx * sin);
        let (near, wide) = noise(distance, reading.spread);
        let spread = (track.variance(cos, sin) + near, track.variance(-sin, cos) + wide);
        Self { distance, along, across, spread, off: along * along / spread.0 + across * across / spread.1 }
    }

    fn cost(&self) -> f64 {
        self.off + libm::log(self.spread.0 * self.spread.1)
    }
}

/// Measurement variances along the beam and across it, m².
fn noise(distance: f64, spread: f64) -> (f64, f64) {
    let across = ACROSS_SIGMA_MIN_M + ACROSS_SIGMA_SHARE * spread * distance;
    (DISTANCE_SIGMA_M * DISTANCE_SIGMA_M, across * across)
}

impl Reading {
    fn detection(&self, distance: f64) -> f64 {
        if distance <= 1.0 { self.detection.0 } else { self.detection.1 }
    }
}

impl Track {
    fn new(reading: &Reading, distance: f64) -> Self {
        let (cos, sin) = reading.axis;
        let middle = distance + LEG_TO_MIDDLE_M;
        let here = Point { x: reading.from.x + middle * cos, y: reading.from.y + middle * sin };
        let mean = [here.x, here.y, 0.0, 0.0];
        let (near, wide) = noise(distance, reading.spread);
        let mut covariance = [[0.0; 4]; 4];
        covariance[0][0] = near * cos * cos + wide * sin * sin;
        covariance[1][1] = near * sin * sin + wide * cos * cos;
        covariance[0][1] = (near - wide) * sin * cos;
        covariance[1][0] = covariance[0][1];
        covariance[2][2] = VELOCITY_SIGMA_MPS * VELOCITY_SIGMA_MPS;
        covariance[3][3] = VELOCITY_SIGMA_MPS * VELOCITY_SIGMA_MPS;
        Self {
            id: 0,
            mean,
            covariance,
            existence: EXISTENCE_INITIAL,
            confirmed: false,
            here,
            here_since: reading.at,
            echoes_here: 1,
        }
    }

    fn at(&self) -> Point {
        Point { x: self.mean[0], y: self.mean[1] }
    }

    fn stands(&self, now: Instant) -> bool {
        self.echoes_here >= STANDS_AFTER_ECHOES && now.since(self.here_since).as_secs_f64() >= STANDS_AFTER_S
    }

    fn sigma(&self) -> f64 {
        libm::sqrt((self.covariance[0][0] + self.covariance[1][1]) / 2.0)
    }

    /// Variance of the position along a unit vector.
    fn variance(&self, x: f64, y: f64) -> f64 {
        let p = &self.covariance;
        p[0][0] * x * x + 2.0 * p[0][1] * x * y + p[1][1] * y * y
    }

    fn predict(&mut self, dt: f64) {
        let p = &mut self.covariance;
        for axis in 0..2 {
            self.mean[axis] += dt * self.mean[axis + 2];
            let rates = p[axis + 2];
            for (entry, rate) in p[axis].iter_mut().zip(rates) {
                *entry += dt * rate;
            }
        }
        for row in p.iter_mut() {
            row[0] += dt * row[2];
            row[1] += dt * row[3];
        }
        for axis in 0..2 {
            p[axis][axis] += ACCELERATION_NOISE * dt * dt * dt / 3.0;
            p[axis][axis + 2] += ACCELERATION_NOISE * dt * dt / 2.0;
            p[axis + 2][axis] += ACCELERATION_NOISE * dt * dt / 2.0;
            p[axis + 2][axis + 2] += ACCELERATION_NOISE * dt;
        }
    }

    /// Kalman update with a position deviation of `off` m along a unit vector and the variance of the measurement, m².
    fn correct(&mut self, (x, y): (f64, f64), off: f64, variance: f64) {
        let p = self.covariance;
        let gain = p.map(|row| row[0] * x + row[1] * y);
        let spread = self.variance(x, y) + variance;
        for (row, k) in gain.iter().enumerate() {
            self.mean[row] += k / spread * off;
            for (column, other) in gain.iter().enumerate() {
                self.covariance[row][column] -= k * other / spread;
            }
        }
    }

    fn detect(&mut self, reading: &Reading, echo: &Echo) {
        let (cos, sin) = reading.axis;
        let (near, wide) = noise(echo.distance, reading.spread);
        self.correct((cos, sin), echo.along, near);
        self.correct((-sin, cos), echo.across, wide);
        if self.at().distance(self.here) > STANDS_WITHIN_M {
            (self.here, self.here_since, self.echoes_here) = (self.at(), reading.at, 0);
        }
        self.echoes_here = self.echoes_here.saturating_add(1);
        // Likelihood ratio of the echo: this person against a false alarm.
        let density = libm::exp(-echo.along * echo.along / (2.0 * echo.spread.0))
            / libm::sqrt(core::f64::consts::TAU * echo.spread.0);
        let ratio = reading.detection(echo.distance) * density / FALSE_ALARMS_PER_M;
        self.existence = self.existence * ratio / (self.existence * ratio + 1.0 - self.existence);
    }

    /// Lowers the existence probability if the sonar should have detected the person.
    fn miss(&mut self, reading: &Reading) {
        let (cos, sin) = reading.axis;
        let (dx, dy) = (self.mean[0] - reading.from.x, self.mean[1] - reading.from.y);
        let (along, across) = (dx * cos + dy * sin, dy * cos - dx * sin);
        let hidden = reading.echo.is_some_and(|distance| distance + LEG_TO_MIDDLE_M < along);
        if along <= 0.0 || along > reading.reach || hidden {
            return;
        }
        let off = across / (reading.spread * along);
        if off.abs() >= 1.0 {
            return;
        }
        // Weighted by the probability that the person is within the beam at all.
        let wide = (reading.spread * along) * (reading.spread * along);
        let within = wide / (wide + self.variance(-sin, cos));
        let miss = 1.0 - within * (1.0 - 0.5 * off * off) * reading.detection(along - LEG_TO_MIDDLE_M);
        self.existence = self.existence * miss / (self.existence * miss + 1.0 - self.existence);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
    use super::*;
    use base::Duration;

    /// Sonar at the origin without an echo.
    fn silent(at: Instant, axis: (f64, f64)) -> Reading {
        Reading {
            at,
            from: Point::default(),
            axis,
            spread: 0.52,
            echo: None,
            reach: 2.5,
            detection: SONAR_DETECTION,
            mapped: false,
        }
    }

    /// Readings of three sonars side by side, looking ahead, with a person at `at`.
    fn round(now: Instant, at: Option<Point>) -> Vec<Reading> {
        let sonar = |angle: f64| {
            let (sin, cos) = libm::sincos(angle);
            let within = at.filter(|at| (libm::atan2(at.y, at.x) - angle).abs() < 0.48);
            let echo = within.map(|at| libm::hypot(at.x, at.y) - LEG_TO_MIDDLE_M);
            Reading { echo, ..silent(now, (cos, sin)) }
        };
        [-0.44, 0.0, 0.44].map(sonar).to_vec()
    }

    /// Four rounds per second with a person who starts at `at`.
    fn follow(people: &mut People, at: Point, velocity: (f64, f64), rounds: u64) -> Instant {
        follow_at(people, at, velocity, 250, rounds)
    }

    /// A round every `every_ms`.
    fn follow_at(people: &mut People, at: Point, (vx, vy): (f64, f64), every_ms: u64, rounds: u64) -> Instant {
        let mut now = Instant::from_millis(10_000);
        for n in 0..rounds {
            now = Instant::from_millis(10_000) + Duration::from_millis(every_ms * n);
            let time = every_ms as f64 / 1000.0 * n as f64;
            people.update(&round(now, Some(Point { x: at.x + vx * time, y: at.y + vy * time })), |_| false);
        }
        now
    }

    #[test]
    fn one_echo_is_unconfirmed_and_two_confirm_a_person() {
        let mut people = People::default();
        let now = Instant::from_millis(10_000);
        let then = now + Duration::from_millis(250);
        people.update(&[Reading { echo: Some(1.5), ..silent(now, (1.0, 0.0)) }], |_| false);
        assert!(!people.around(now).next().unwrap().confirmed);
        people.update(&[Reading { echo: Some(1.4), ..silent(then, (1.0, 0.0)) }], |_| false);
        let person = people.around(then).next().unwrap();
        assert!(person.confirmed && (person.at.x - 1.5).abs() < 0.25, "{person:?}");
    }

    #[test]
    fn a_mapped_echo_is_not_a_person() {
        let mut people = People::default();
        let now = Instant::from_millis(10_000);
        let wall = Reading { echo: Some(1.0), mapped: true, ..silent(now, (1.0, 0.0)) };
        people.update(&[wall; 4], |_| false);
        assert_eq!(people.around(now).count(), 0);
    }

    #[test]
    fn a_person_is_known_to_stand_by_echoes_at_one_place_for_some_time() {
        let stands = |velocity, every_ms, rounds| {
            let mut people = People::default();
            let now = follow_at(&mut people, Point { x: 2.4, y: 0.0 }, velocity, every_ms, rounds);
            people.around(now).find(|person| person.confirmed).unwrap().stands
        };
        for (every_ms, rounds) in [(250, 8), (50, 40)] {
            assert!(stands((0.0, 0.0), every_ms, rounds) && !stands((0.0, 0.0), every_ms, rounds / 3));
            for speed in [0.25, 0.4, 0.7, 1.0] {
                assert!(!stands((-speed, 0.0), every_ms, rounds), "{speed} m/s, every {every_ms} ms");
            }
        }
    }

    #[test]
    fn a_walking_person_has_a_velocity_and_a_standing_one_has_none() {
        let mut people = People::default();
        let now = follow(&mut people, Point { x: 2.4, y: 0.0 }, (-1.0, 0.0), 6);
        let person = people.around(now).find(|person| person.confirmed).unwrap();
        assert!((person.velocity.0 + 1.0).abs() < 0.3 && person.velocity.1.abs() < 0.3, "{person:?}");
        let now = follow(&mut people, Point { x: 1.2, y: 0.2 }, (0.0, 0.0), 12);
        let person = people.around(now).find(|person| person.confirmed).unwrap();
        assert!(libm::hypot(person.velocity.0, person.velocity.1) < 0.2 && person.sigma < 0.2, "{person:?}");
        assert!(person.at.distance(Point { x: 1.2, y: 0.2 }) < 0.2, "{person:?}");
    }

    #[test]
    fn a_track_has_one_number_from_its_confirmation_on_and_no_other_has_it() {
        let mut people = People::default();
        for known in 0..2 {
            let mut now = Instant::from_millis(10_000);
            for n in 0..20 {
                now += Duration::from_millis(250);
                people.update(&round(now, Some(Point { x: 2.3 - 0.05 * f64::from(n), y: 0.0 })), |_| false);
                let confirmed = people.around(now).filter(|person| person.confirmed);
                assert!(
                    confirmed.count() <= 1 && people.around(now).all(|person| person.confirmed == (person.id != 0))
                );
            }
            let ids: Vec<i32> = people.around(now).map(|person| person.id).filter(|id| *id != 0).collect();
            assert_eq!(ids, [known + 1]);
            people.clear();
            assert_eq!(people.around(now).count(), 0);
        }
    }

    #[test]
    fn merged_tracks_keep_the_lower_number() {
        let at = Instant::from_millis(10_000);
        let track = |id, existence, distance| Track { id, existence, ..Track::new(&silent(at, (1.0, 0.0)), distance) };
        for (ids, expected) in [([7, 3], 3), ([3, 7], 3), ([0, 4], 4), ([4, 0], 4)] {
            let mut people =
                People { tracks: vec![track(ids[0], 0.9, 1.0), track(ids[1], 0.6, 1.1)], ..People::default() };
            people.merge();
            let [merged] = &people.tracks[..] else { panic!("{:?}", people.tracks) };
            assert_eq!((merged.id, merged.existence), (expected, 0.9), "{ids:?}");
        }
    }

    #[test]
    fn a_track_without_echoes_is_deleted_sooner_at_close_range() {
        let left = |x: f64| {
            let mut people = People::default();
            let mut now = follow(&mut people, Point { x, y: 0.0 }, (0.0, 0.0), 8);
            let mut rounds = 0;
            while people.around(now).any(|person| person.confirmed) {
                now += Duration::from_millis(250);
                people.update(&round(now, None), |_| false);
                rounds += 1;
            }
            rounds
        };
        let (near, far) = (left(0.7), left(2.0));
        assert!(near < far && far <= 20, "{near} {far}");
    }

    #[test]
    fn invalid_values_and_crowds_are_bounded() {
        let mut people = People::default();
        let mut now = Instant::from_millis(10_000);
        for n in 0..200 {
            now += Duration::from_millis(250);
            let reading = |k: usize| {
                let (sin, cos) = libm::sincos((n * 7 + k * 31) as f64);
                let from = Point { x: (k % 5) as f64 - 2.0, y: (k % 3) as f64 - 1.0 };
                Reading { from, echo: Some(0.1 + (k % 24) as f64 / 10.0), ..silent(now, (cos, sin)) }
            };
            let round: Vec<Reading> = (0..32).map(reading).collect();
            people.update(&round, |_| false);
            assert!(people.tracks.len() <= TRACKS_MAX);
            assert!(people.around(now).all(|person| person.at.x.is_finite() && person.sigma.is_finite()));
        }
    }
}
