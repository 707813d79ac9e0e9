//! Scans of lidars in the obstacle map. A beam measures one direction: what it meets is suspected, and the way there is
//! free. What is as wide as a leg may be a person.

use super::{CELL_M, FREE_WEIGHT_NEAR, Obstacles, PATCH_M, PATCHES_PER_SIDE, middle, place, slot};
use crate::people::Reading;
use base::{Duration, Instant};
use messages::lowlevel::DataScan;
use navitools::{Point, Pose, wrap};

/// Range up to which a scan counts, m: it stays within the grid around the robot.
const RANGE_M: f64 = 3.8;
/// Distance by which a beam must pass a point to find it free, m: noise, and the accuracy of the pose.
const PASSED_M: f64 = 0.10;
/// The same for a person, whose legs are before or behind the middle, m.
const PERSON_PASSED_M: f64 = 0.35;
/// Greatest distance of two neighbouring points on one thing, m.
const GAP_M: f64 = 0.12;
/// Widths of a leg, or of two side by side, m.
const LEG_WIDTH_M: std::ops::RangeInclusive<f64> = 0.03..=0.5;
/// A sector narrower than this is joined with the next one, rad: in its part of 22.5°, say, a wall within 1.3 m would
/// be as narrow as a leg.
const NARROW_RAD: f64 = 0.5;
/// Time within which a sector continues another one: more than the next one takes.
const CONTINUES_WITHIN: Duration = Duration::from_millis(50);
/// Angle from the last beam of a sector to the first one of a sector that continues it, in steps.
const CONTINUES_STEPS: std::ops::Range<f64> = 0.0..3.0;
/// Lidars whose sectors are joined.
const OPEN_MAX: usize = 8;
/// Distance to either side of a person's middle in which all beams pass somebody who is not there, m.
const PERSON_SIDE_M: f64 = 0.2;
/// Probability that somebody returns an echo: a lidar hardly misses a leg.
const DETECTION: (f64, f64) = (0.9, 0.9);

/// A sector, seen from the lidar.
struct Sector<'a> {
    scan: &'a DataScan,
    at: Instant,
    /// The lidar in the map.
    lidar: Pose,
}

impl Sector<'_> {
    /// Distance up to which the beam is free, m, `RANGE_M` at most; `None` where nothing was measured.
    fn free(&self, beam: usize) -> Option<f64> {
        let range = f64::from(*self.scan.ranges.get(beam)?);
        let sure = f64::from(self.scan.range_max);
        let range = if range.is_infinite() { sure.copysign(range) } else { range };
        (self.scan.status == DataScan::OK && !range.is_nan()).then(|| range.clamp(0.0, RANGE_M))
    }

    fn direction(&self, beam: usize) -> (f64, f64) {
        let (sin, cos) = (self.lidar.theta + (self.scan.angle_min + beam as f64 * self.scan.angle_step)).sin_cos();
        (cos, sin)
    }

    fn point(&self, (cos, sin): (f64, f64), distance: f64) -> Point {
        Point { x: self.lidar.x + distance * cos, y: self.lidar.y + distance * sin }
    }

    /// Angle of all beams, rad.
    fn span(&self) -> f64 {
        self.scan.ranges.len() as f64 * self.scan.angle_step.abs()
    }

    /// Direction of the last beam, rad.
    fn end(&self) -> f64 {
        self.scan.angle_min + self.scan.ranges.len().saturating_sub(1) as f64 * self.scan.angle_step
    }

    /// The beam that is nearest to a point, and the point's distance, m; `None` if none is.
    fn beam(&self, point: Point) -> Option<(usize, f64)> {
        let (x, y) = (point.x - self.lidar.x, point.y - self.lidar.y);
        let bearing = libm::atan2(y, x) - self.lidar.theta.radians() - self.scan.angle_min;
        // Where a turn is whole, the first beam is.
        let ahead = wrap(bearing * self.scan.angle_step.signum());
        let beam = libm::round(ahead / self.scan.angle_step.abs());
        (beam >= 0.0 && beam < self.scan.ranges.len() as f64).then(|| (beam as usize, libm::hypot(x, y)))
    }

    /// True if the beams up to `side` m beside a point pass it by more than `by` m, as far as they belong to this
    /// sector.
    fn passes(&self, point: Point, by: f64, side: f64) -> bool {
        self.beam(point).is_some_and(|(beam, distance)| {
            let most = self.scan.ranges.len();
            let beside = (side / (distance * self.scan.angle_step.abs())).clamp(1.0, most as f64) as usize;
            let mut beams = beam.saturating_sub(beside)..=(beam + beside).min(most);
            let known = self.free(beam).is_some();
            known && beams.all(|beam| self.free(beam).is_none_or(|free| free > distance + by))
        })
    }
}

impl Obstacles {
    /// Processes a sector that was measured at `at` from `lidar`, its pose in the map, by a robot at `robot`;
    /// `footprint` and `mapped` as in [`Self::update`].
    pub fn on_scan(
        &mut self,
        at: Instant,
        (robot, lidar): (Pose, Pose),
        scan: &DataScan,
        footprint: impl Fn(Point) -> bool,
        mapped: impl Fn(Point) -> bool,
    ) {
        let step = scan.angle_step;
        if !step.is_finite() || step == 0.0 || !scan.angle_min.is_finite() {
            return;
        }
        let sector = Sector { scan, at, lidar };
        let robot_from_map = robot.inverse().to_outer();
        let is_body = |point: Point| footprint(robot_from_map(point));
        self.expire(at, robot, is_body, |cell, _| {
            if sector.passes(middle(cell.place), PASSED_M, 0.0) { FREE_WEIGHT_NEAR } else { 0 }
        });
        let mut readings = std::mem::take(&mut self.round);
        readings.clear();
        let open = self.open.iter().position(|open| open.lidar == scan.name).map(|place| self.open.swap_remove(place));
        let (mut thing, ended) = match open {
            Some(open) if open.continues(&sector) => (Some(open.thing), None),
            ended => (None, ended.filter(|open| at.since(open.at) <= CONTINUES_WITHIN)),
        };
        readings.extend(ended.and_then(|open| open.thing.reading(&sector)));
        let mut last = None;
        for beam in 0..scan.ranges.len() {
            let (direction, range) = (sector.direction(beam), f64::from(scan.ranges[beam]));
            if let Some(free) = sector.free(beam) {
                self.observe(&sector, direction, free);
            }
            let met = Some(range).filter(|range| *range > 0.0 && *range <= RANGE_M);
            let met = met.map(|range| (range, sector.point(direction, range)));
            let Some((range, point)) = met.filter(|(_, point)| !is_body(*point) && !mapped(*point)) else {
                readings.extend(thing.take().and_then(|thing| thing.reading(&sector)));
                continue;
            };
            let cell = place(point, CELL_M);
            if last.replace(cell) != Some(cell) {
                self.suspect_cell(cell, at, 0.0, false);
            }
            thing = match thing {
                Some(thing) if thing.to.distance(point) <= GAP_M => Some(thing.with(range, point)),
                other => {
                    readings.extend(other.and_then(|thing| thing.reading(&sector)));
                    Some(Thing { from: point, to: point, nearest: range, width: 0.0 })
                }
            };
        }
        self.open.retain(|open| at.since(open.at) <= CONTINUES_WITHIN);
        match thing {
            Some(thing) if sector.span() < NARROW_RAD && self.open.len() < OPEN_MAX => {
                self.open.push(Open { lidar: scan.name.clone(), thing, at, direction: sector.end() });
            }
            thing => readings.extend(thing.and_then(|thing| thing.reading(&sector))),
        }
        let gone = self.people.places().filter(|place| sector.passes(*place, PERSON_PASSED_M, PERSON_SIDE_M));
        readings.extend(gone.map(|place| sector.nobody(place)));
        self.people.update(&readings, is_body);
        self.round = readings;
    }

    /// Marks the space along a beam as observed.
    fn observe(&mut self, sector: &Sector<'_>, direction: (f64, f64), free: f64) {
        for n in 0..=(free / PATCH_M) as u32 {
            let patch = place(sector.point(direction, f64::from(n) * PATCH_M), PATCH_M);
            self.seen[slot(patch, PATCHES_PER_SIDE)] = (patch, sector.at);
        }
    }
}

/// Something that goes on in the next sector of its lidar, if that continues the last one.
#[derive(Debug)]
pub(super) struct Open {
    lidar: String,
    thing: Thing,
    /// When the sector was measured, and the direction of its last beam, rad.
    at: Instant,
    direction: f64,
}

impl Open {
    fn continues(&self, Sector { scan, at, .. }: &Sector<'_>) -> bool {
        let steps = wrap(scan.angle_min - self.direction) / scan.angle_step;
        at.since(self.at) <= CONTINUES_WITHIN && CONTINUES_STEPS.contains(&steps)
    }
}

/// Points side by side.
#[derive(Debug)]
struct Thing {
    from: Point,
    to: Point,
    /// Least distance, m.
    nearest: f64,
    /// Farthest of them from the first one, m.
    width: f64,
}

impl Thing {
    fn with(self, range: f64, point: Point) -> Self {
        Self { to: point, nearest: self.nearest.min(range), width: self.width.max(self.from.distance(point)), ..self }
    }

    /// What the tracker of people gets of it; `None` if it is no leg.
    fn reading(self, sector: &Sector<'_>) -> Option<Reading> {
        let between = self.nearest * sector.scan.angle_step.abs();
        let width = self.width + between;
        LEG_WIDTH_M.contains(&width).then(|| {
            let middle = Point { x: (self.from.x + self.to.x) / 2.0, y: (self.from.y + self.to.y) / 2.0 };
            sector.reading(middle, width / (2.0 * self.nearest), Some(self.nearest))
        })
    }
}

impl Sector<'_> {
    fn nobody(&self, place: Point) -> Reading {
        self.reading(place, PERSON_SIDE_M / place.distance(self.lidar.point()).max(PERSON_SIDE_M), None)
    }

    fn reading(&self, towards: Point, spread: f64, echo: Option<f64>) -> Reading {
        let (x, y) = (towards.x - self.lidar.x, towards.y - self.lidar.y);
        let distance = libm::hypot(x, y).max(1e-3);
        let axis = (x / distance, y / distance);
        let (at, from) = (self.at, self.lidar.point());
        Reading { at, from, axis, spread, echo, reach: RANGE_M, detection: DETECTION, mapped: false }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::Duration;
    use std::f64::consts::TAU;

    const BEAMS: usize = 360;

    /// The map around a robot at the origin, with a lidar in its middle that turns this way round.
    struct Bench {
        obstacles: Obstacles,
        now: Instant,
        status: i8,
        step: f64,
        /// Of a revolution.
        sectors: usize,
        /// A wall ahead is on the map.
        mapped: bool,
    }

    impl Bench {
        fn new(step: f64) -> Self {
            let now = Instant::from_millis(1000);
            Self { obstacles: Obstacles::new(), now, status: DataScan::OK, step, sectors: 8, mapped: false }
        }

        /// Revolutions of 100 ms, in which each direction has the range that `range` says.
        fn revolve(&mut self, times: usize, range: impl Fn(f64) -> f64) {
            let sectors = self.sectors;
            for sector in (0..times).flat_map(|_| 0..sectors) {
                let count = BEAMS / sectors;
                let angle_min = (sector * count) as f64 * self.step;
                let ranges = (0..count).map(|k| range(wrap(angle_min + k as f64 * self.step)) as f32).collect();
                let scan = DataScan {
                    status: self.status,
                    angle_min,
                    angle_step: self.step,
                    beam_time: 0.1 / BEAMS as f64,
                    range_max: 8.0,
                    ranges,
                    ..DataScan::default()
                };
                let is_body = |point: Point| point.x.abs() < 0.35 && point.y.abs() < 0.25;
                let mapped = self.mapped;
                let is_mapped = |point: Point| mapped && (point.x - 2.0).abs() < 0.15;
                let here = Pose::default();
                self.obstacles.on_scan(self.now, (here, here), &scan, is_body, is_mapped);
                self.now += Duration::from_micros(100_000 / sectors as u64);
            }
        }

        fn hits(&self) -> Vec<Point> {
            self.obstacles.hits().map(|hit| hit.at).collect()
        }
    }

    /// A wall at x = 2 m; elsewhere nothing.
    fn wall(angle: f64) -> f64 {
        if angle.abs() < 0.6 { 2.0 / libm::cos(angle) } else { f64::INFINITY }
    }

    /// Somebody's legs, `side` m beside the middle line, `ahead` m away; elsewhere nothing.
    fn person(ahead: f64, side: f64) -> impl Fn(f64) -> f64 {
        let (at, from) = (libm::atan2(side, ahead), libm::hypot(ahead, side));
        move |angle| if (angle - at).abs() < 0.07 / from { from - 0.1 } else { f64::INFINITY }
    }

    const STEPS: [f64; 2] = [TAU / BEAMS as f64, -TAU / BEAMS as f64];

    #[test]
    fn what_two_revolutions_meet_is_an_obstacle_until_they_pass_it() {
        for step in STEPS {
            let mut bench = Bench::new(step);
            bench.revolve(1, wall);
            bench.revolve(1, wall);
            let hits = bench.hits();
            assert!(hits.len() > 20 && hits.iter().all(|at| (at.x - 2.0).abs() < 0.06), "{hits:?}");
            bench.status = DataScan::FAULT;
            bench.revolve(4, |_| f64::INFINITY);
            assert_eq!(bench.hits().len(), hits.len(), "a lidar with a fault frees nothing");
            bench.status = DataScan::OK;
            bench.revolve(4, |_| f64::NAN);
            assert_eq!(bench.hits().len(), hits.len(), "nor does one that has not measured");
            bench.revolve(4, |_| f64::INFINITY);
            assert_eq!(bench.hits(), []);
        }
    }

    #[test]
    fn the_way_to_what_it_meets_is_seen_and_not_what_is_behind() {
        for step in STEPS {
            let mut bench = Bench::new(step);
            bench.revolve(1, wall);
            let seen = |x, y| bench.obstacles.seen_within(bench.now, Point { x, y }, Duration::from_secs(1));
            assert!(seen(1.6, 0.0) && seen(1.6, 0.8) && seen(-3.0, 0.4) && seen(0.4, -3.0));
            assert!(!seen(2.4, 0.0) && !seen(3.0, 1.0));
        }
    }

    #[test]
    fn what_the_map_has_and_the_robot_itself_are_no_obstacles() {
        let mut bench = Bench::new(STEPS[0]);
        bench.mapped = true;
        bench.revolve(4, wall);
        assert_eq!(bench.hits(), []);
        bench.revolve(4, |_| 0.2);
        assert_eq!(bench.hits(), []);
    }

    #[test]
    fn one_wild_beam_is_no_obstacle() {
        let mut bench = Bench::new(STEPS[0]);
        for n in 0..20 {
            let wild = wrap(f64::from(n) * 0.9);
            bench.revolve(1, |angle| if (angle - wild).abs() < 0.01 { 1.0 } else { f64::INFINITY });
            assert_eq!(bench.hits(), [], "{n}");
        }
    }

    #[test]
    fn legs_are_a_person_who_walks_and_is_gone() {
        for step in STEPS {
            let mut bench = Bench::new(step);
            for n in 0..20 {
                bench.revolve(1, person(3.0 - 0.08 * f64::from(n), 0.3));
            }
            let people: Vec<_> = bench.obstacles.people(bench.now).filter(|person| person.confirmed).collect();
            let [person] = people.as_slice() else { panic!("{people:?}") };
            let ahead = 3.0 - 0.08 * 19.0;
            assert!(person.at.distance(Point { x: ahead, y: 0.3 }) < 0.2, "{person:?}");
            let (vx, vy) = person.velocity;
            assert!((vx + 0.8).abs() < 0.2 && vy.abs() < 0.2, "{person:?}");
            bench.revolve(10, |_| f64::INFINITY);
            assert_eq!(bench.obstacles.people(bench.now).filter(|person| person.confirmed).count(), 0);
        }
        let mut bench = Bench::new(STEPS[0]);
        bench.revolve(20, wall);
        assert_eq!(bench.obstacles.people(bench.now).count(), 0, "a wall is nobody");
    }

    #[test]
    fn what_narrow_sectors_cut_is_as_wide_as_it_is() {
        for (step, sectors) in STEPS.into_iter().flat_map(|step| [(step, 16), (step, 24), (step, 120)]) {
            let mut bench = Bench::new(step);
            bench.sectors = sectors;
            // A wall whose parts of 22.5° are as narrow as legs.
            bench.revolve(20, |angle| if angle.abs() < 0.98 { 1.0 / libm::cos(angle) } else { f64::INFINITY });
            assert_eq!(bench.obstacles.people(bench.now).count(), 0, "{sectors}: a wall is nobody");
            // All around.
            bench.revolve(20, |_| 0.9);
            assert_eq!(bench.obstacles.people(bench.now).count(), 0, "{sectors}: a room is nobody");
            let mut bench = Bench::new(step);
            bench.sectors = sectors;
            // Somebody in the direction in which two sectors meet.
            for n in 0..20 {
                bench.revolve(1, person(3.0 - 0.08 * f64::from(n), 0.0));
            }
            let people: Vec<_> = bench.obstacles.people(bench.now).filter(|person| person.confirmed).collect();
            let [person] = people.as_slice() else { panic!("{sectors}: {people:?}") };
            assert!(person.at.distance(Point { x: 3.0 - 0.08 * 19.0, y: 0.0 }) < 0.2, "{sectors}: {person:?}");
        }
    }

    #[test]
    fn nothing_that_can_arrive_does_harm() {
        let mut random = testing::Random::new(7);
        let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0, 1e-9, 1.0, 1e300, 3.0, 0.01];
        let mut pick = || odd[random.index(odd.len())];
        let mut obstacles = Obstacles::new();
        for n in 0..20_000_u64 {
            let scan = DataScan {
                angle_min: pick(),
                angle_step: pick(),
                range_max: pick() as f32,
                ranges: (0..n % 50).map(|_| pick() as f32).collect(),
                ..DataScan::default()
            };
            let at = Instant::from_millis(1000 + n);
            obstacles.on_scan(at, (Pose::default(), Pose::default()), &scan, |_| false, |_| false);
        }
    }
}
