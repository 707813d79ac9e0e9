//! Obstacle map around the robot from sonar readings and scans of lidars: cells of 5 cm in the map frame.
//!
//! A reading counts once, at the instant at which its sonar fired, however often it is sent; an unknown reading neither
//! frees nor marks anything. A sonar measures the nearest echo in its cone, but not its direction. An echo therefore
//! marks an arc at its distance as suspected, except for cells that other cones have just found free; the space nearer
//! than the echo is free. Silence frees only the space in which even a leg would return an echo, within the specular
//! limit (docs/facts/robot.md 2.1, 4.3). Space is free only as far as several readings of a sonar in succession were
//! free: a leg is often missed once, and seldom [`FREE_READINGS`] times. A sonar that is repeatedly silent where the
//! map has a wall that faces it does not work: what it measures is unknown. A cell counts as an obstacle after two
//! suspicions within about a second, and within a metre at once; farther away a single crosstalk echo is not one. Cells
//! without new echoes expire. Clothes absorb sound, so silence beyond a metre is weak evidence. Where a floor ranger
//! saw no floor is an edge, which stays.

use crate::config::Body;
use crate::people::{People, Person, Reading, SONAR_DETECTION};
use crate::ranges::{self, Mount, SONARS_MAX, Sounding};
use base::{Duration, Instant};
use navitools::{Point, Pose};
use std::collections::VecDeque;
use std::mem;

mod hearing;
mod scan;

use hearing::Hearing;

/// Side of a cell, m.
pub const CELL_M: f64 = 0.05;
/// Number of cells along a side of the grid (8 m), which moves with the robot.
const SIDE_CELLS: i32 = 160;
/// Range within which a leg returns an echo, m; anything farther does not matter for the next stop.
const LEG_RANGE_M: f64 = 2.5;
/// Range up to which silence frees space, m: a leg would return an echo.
const SILENCE_RANGE_M: f64 = 2.0;
/// Specular limit, 25°, rad: within this angle of the axis a smooth wall perpendicular to the beam returns an echo.
const SPECULAR_LIMIT_RAD: f64 = 0.4363;
/// Share of a cone's width that counts as observed.
const OBSERVED_SHARE: f64 = 0.9;
/// Longest time between two firings for which a cone frees cells of the other's arc.
const CARVE_WITHIN: Duration = Duration::from_millis(300);
/// Time between two readings of a sonar within which they give the closing speed of one obstacle, s: minimum and
/// maximum.
const CLOSING_INTERVAL_S: (f64, f64) = (0.05, 0.6);
/// Accuracy of an echo's position, m: noise, age of the reading, and pose.
const ECHO_ACCURACY_M: f64 = 0.10;
/// Weight of a suspicion, and the sum that makes an obstacle: two suspicions.
const SUSPICION_WEIGHT: u8 = 4;
const OBSTACLE_EVIDENCE: u8 = 6;
/// Upper bound of the evidence, so that an obstacle that has left expires soon.
const EVIDENCE_MAX: u8 = 12;
/// Decrease per round in which a cone is free: near, and where the echo may have been missed.
const FREE_WEIGHT_NEAR: u8 = 3;
const FREE_WEIGHT_FAR: u8 = 1;
/// Number of successive readings that free space, and the time within which they must have fired. A leg within a metre
/// is missed three times in succession with a probability of 1.6 %, beyond with 24 % (`people`).
pub const FREE_READINGS: usize = 3;
const FREE_WITHIN: Duration = Duration::from_secs(1);
/// Limit of the near range, m.
const NEAR_M: f64 = 1.0;
/// Time without a suspicion after which a cell is free.
const CELL_LIFETIME: Duration = Duration::from_secs(5);
/// Time within which the second suspicion must follow.
const CONFIRM_WITHIN: Duration = Duration::from_secs(1);
/// Side of a patch of observed space, m.
const PATCH_M: f64 = 0.25;
/// Number of patches along a side.
const PATCHES_PER_SIDE: i32 = 32;
/// Maximum number of cells at edges; the oldest is forgotten first.
const EDGES_MAX: usize = 500;
/// Number of cells, one behind the other, that a floor ranger without floor marks.
const EDGE_CELLS: i32 = 3;
/// Maximum number of suspected cells.
const HITS_MAX: usize = 2000;
/// Fastest walking speed, m/s (ISO 13855).
const WALKING_SPEED_MAX_MPS: f64 = 1.6;
/// Closing speed below which a change is jitter of the readings' age, m/s.
const CLOSING_SPEED_MIN_MPS: f64 = 0.3;

/// Occupied cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Middle of the cell in the map, m.
    pub at: Point,
    /// Closing speed of the obstacle itself, m/s; 0 if it is stationary.
    pub closing: f64,
}

#[derive(Clone, Copy, Debug)]
struct Cell {
    place: (i32, i32),
    evidence: u8,
    suspected: Instant,
    closing: f64,
    /// Its last echo was nearer than [`NEAR_M`]: also unconfirmed it counts, until two readings find nothing there.
    near: bool,
}

/// Last reading of one sonar.
#[derive(Clone, Copy, Debug, Default)]
struct Echo {
    /// Number of the sonar.
    sonar: i32,
    /// Firing instant; `None` without a known reading.
    at: Option<Instant>,
    /// The sender's name of the reading.
    stamp: i64,
    /// Distance, m; `None` for silence.
    distance: Option<f64>,
    mount: Mount,
    /// Firing instants of the last readings, the newest one first, and the range up to which each found no echo, m.
    free: [(Instant, f64); FREE_READINGS],
    /// Its hearing, as far as the map shows.
    hearing: Hearing,
}

/// Reading with the motion of the robot when the sonar fired.
#[derive(Clone, Copy, Debug)]
pub struct Fired {
    /// Reading.
    pub sounding: Sounding,
    /// Pose of the robot.
    pub robot: Pose,
    /// Speed of the robot, m/s.
    pub speed: f64,
}

/// Cone of a sonar's last reading.
#[derive(Debug)]
struct Cone {
    sonar: i32,
    at: Instant,
    /// True if the reading was not processed before.
    is_new: bool,
    from: Point,
    cos: f64,
    sin: f64,
    half_beam: f64,
    /// Half of the opening angle within which the cone frees space: cos², and the tangent.
    clear: (f64, f64),
    echo: Option<f64>,
    /// Range up to which the cone is free, m: the last [`FREE_READINGS`] readings found nothing nearer.
    free: f64,
    /// Range up to which this reading found nothing, m. It frees no space, but refutes suspicions, and shows where
    /// another sonar's echo cannot have come from.
    quiet: f64,
    closing: f64,
}

impl Cone {
    /// Weight of the evidence that `point` is free, where the cone is free up to `range`; 0 outside of it.
    fn frees(&self, point: Point, range: f64) -> u8 {
        match self.squared_distance_within(point, range) {
            Some(d2) if d2 < NEAR_M * NEAR_M => FREE_WEIGHT_NEAR,
            Some(_) => FREE_WEIGHT_FAR,
            None => 0,
        }
    }

    /// True if this reading would have heard an echo from `point`: it is near, and the reading heard nothing there.
    fn carves(&self, point: Point) -> bool {
        self.squared_distance_within(point, self.quiet).is_some_and(|d2| d2 < NEAR_M * NEAR_M)
    }

    /// Squared distance of `point`, m², if it is in the middle of the cone and nearer than `range`.
    fn squared_distance_within(&self, point: Point, range: f64) -> Option<f64> {
        let (dx, dy) = (point.x - self.from.x, point.y - self.from.y);
        let along = dx * self.cos + dy * self.sin;
        let d2 = dx * dx + dy * dy;
        (along > 0.0 && d2 < range * range && along * along >= self.clear.0 * d2).then_some(d2)
    }
}

/// Sensed obstacles.
#[derive(Debug)]
pub struct Obstacles {
    cells: Vec<Cell>,
    /// Index of a cell plus one, or 0, by its coordinates modulo [`SIDE_CELLS`].
    index: Vec<u16>,
    /// Patch, and the instant at which it was last observed free, by its coordinates modulo [`PATCHES_PER_SIDE`].
    seen: Vec<((i32, i32), Instant)>,
    echoes: Vec<Echo>,
    /// Cells where a floor ranger saw no floor. They do not expire: an edge stays.
    edges: VecDeque<(i32, i32)>,
    people: People,
    /// What the last narrow sectors of lidars met at their end.
    open: Vec<scan::Open>,
    /// Cones of the current round; a reused buffer.
    cones: Vec<Cone>,
    round: Vec<Reading>,
    /// Points of an arc; a reused buffer.
    arc: Vec<Point>,
}

impl Default for Obstacles {
    fn default() -> Self {
        Self {
            cells: Vec::new(),
            index: vec![0; (SIDE_CELLS * SIDE_CELLS) as usize],
            seen: vec![((i32::MAX, i32::MAX), Instant::ZERO); (PATCHES_PER_SIDE * PATCHES_PER_SIDE) as usize],
            echoes: Vec::new(),
            edges: VecDeque::new(),
            people: People::default(),
            open: Vec::new(),
            cones: Vec::with_capacity(SONARS_MAX),
            round: Vec::with_capacity(SONARS_MAX),
            arc: Vec::new(),
        }
    }
}

impl Obstacles {
    /// Creates an empty obstacle map.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Clears everything, after a jump of the pose.
    pub fn clear(&mut self) {
        let mut people = mem::take(&mut self.people);
        people.clear();
        *self = Self { people, ..Self::default() };
    }

    /// Processes a round of readings at `now`; a reading that was processed before is ignored. `robot` is the pose when
    /// the last sonar fired; `footprint(point)` is true for points of the robot's frame that its body covers,
    /// `mapped(point)` for points of the map at which the map explains an echo.
    pub fn update(
        &mut self,
        now: Instant,
        robot: Pose,
        round: &[Fired],
        footprint: impl Fn(Point) -> bool,
        mapped: impl Fn(Point) -> bool,
    ) {
        self.process(&round[..round.len().min(SONARS_MAX)], &mapped);
        let cones = mem::take(&mut self.cones);
        let new: Vec<&Cone> = cones.iter().filter(|cone| cone.is_new).collect();
        let robot_from_map = robot.inverse().to_outer();
        let is_body = |point: Point| footprint(robot_from_map(point));
        self.expire(now, robot, is_body, |cell, is_obstacle| {
            // Readings that hear nothing refute a suspicion; an obstacle stays until several found its place free.
            let at = middle(cell.place);
            let freed = new.iter().map(|cone| cone.frees(at, if is_obstacle { cone.free } else { cone.quiet }));
            freed.max().unwrap_or(0)
        });
        self.round.clear();
        for cone in new {
            self.mark_observed(cone);
            let mapped = self.mark_arc(cone, &cones, is_body, &mapped);
            self.round.push(Reading {
                at: cone.at,
                from: cone.from,
                axis: (cone.cos, cone.sin),
                spread: libm::tan(cone.half_beam),
                echo: cone.echo,
                reach: LEG_RANGE_M,
                detection: SONAR_DETECTION,
                mapped,
            });
        }
        self.round.sort_by_key(|reading| reading.at);
        self.people.update(&self.round, is_body);
        self.cones = cones;
    }

    fn process(&mut self, round: &[Fired], mapped: &impl Fn(Point) -> bool) {
        let is_there = |sonar: i32| round.iter().any(|fired| fired.sounding.id == sonar);
        self.echoes.retain(|echo| is_there(echo.sonar));
        self.cones.retain(|cone| is_there(cone.sonar));
        self.cones.iter_mut().for_each(|cone| cone.is_new = false);
        for Fired { sounding, robot, speed } in round {
            let Sounding { id: sonar, at, stamp, mount, measurement } = *sounding;
            let number = self.echoes.iter().position(|echo| echo.sonar == sonar).unwrap_or_else(|| {
                self.echoes.push(Echo { sonar, ..Echo::default() });
                self.echoes.len() - 1
            });
            let last = &mut self.echoes[number];
            last.mount = mount;
            let distance = match measurement {
                ranges::Measurement::Echo(distance) => Some(distance),
                ranges::Measurement::Silent | ranges::Measurement::NoEcho => None,
                ranges::Measurement::Unknown => continue,
            };
            // A reading that is sent again seems to be somewhat younger or older, as messages take different times.
            if last.at.is_some_and(|fired| at <= fired || stamp == last.stamp) {
                continue;
            }
            let dt = last.at.map_or(f64::INFINITY, |last| at.since(last).as_secs_f64());
            let closing = match (last.distance, distance) {
                (Some(before), Some(after)) if dt > CLOSING_INTERVAL_S.0 && dt < CLOSING_INTERVAL_S.1 => {
                    let closing = (before - after) / dt - speed * libm::cos(mount.theta);
                    // A jump is an echo of another obstacle, not a fast one.
                    if (CLOSING_SPEED_MIN_MPS..2.0 * WALKING_SPEED_MAX_MPS).contains(&closing) {
                        closing.min(WALKING_SPEED_MAX_MPS)
                    } else {
                        0.0
                    }
                }
                _ => 0.0,
            };
            let pose = *robot * Pose::new(mount.at.x, mount.at.y, mount.theta);
            let (sin, cos) = pose.theta.sin_cos();
            let half_beam = mount.beam / 2.0;
            let clear = half_beam.min(SPECULAR_LIMIT_RAD);
            let clear = (libm::cos(clear) * libm::cos(clear), libm::tan(clear));
            let clear_now = match measurement {
                ranges::Measurement::Echo(distance) => (distance - ECHO_ACCURACY_M).min(LEG_RANGE_M),
                ranges::Measurement::Silent => SILENCE_RANGE_M,
                ranges::Measurement::NoEcho | ranges::Measurement::Unknown => 0.0,
            };
            let mut hearing = last.hearing;
            match measurement {
                ranges::Measurement::Echo(_) => hearing.on_echo(),
                ranges::Measurement::Silent => hearing.on_silence(pose, mapped),
                ranges::Measurement::NoEcho | ranges::Measurement::Unknown => {}
            }
            let [first, second, _] = last.free;
            let readings = [(at, clear_now), first, second];
            *last = Echo { sonar, at: Some(at), stamp, distance, mount, free: readings, hearing };
            let (free, quiet) = if hearing.is_deaf() { (0.0, 0.0) } else { (last.free_range(at), clear_now) };
            let (from, echo) = (pose.point(), distance);
            let cone = Cone { sonar, at, is_new: true, from, cos, sin, half_beam, clear, echo, free, quiet, closing };
            match self.cones.iter_mut().find(|cone| cone.sonar == sonar) {
                Some(last) => *last = cone,
                None => self.cones.push(cone),
            }
        }
    }

    /// Marks the space that a cone found free as observed at its firing instant.
    fn mark_observed(&mut self, cone: &Cone) {
        for share in [-1.0, -0.5, 0.0, 0.5, 1.0] {
            let tan = share * OBSERVED_SHARE * cone.clear.1;
            let steps = if cone.free > 0.0 { (cone.free / PATCH_M) as i32 } else { -1 };
            for step in 0..=steps {
                let along = f64::from(step) * PATCH_M;
                let (x, y) = (along * (cone.cos - tan * cone.sin), along * (cone.sin + tan * cone.cos));
                let patch = place(Point { x: cone.from.x + x, y: cone.from.y + y }, PATCH_M);
                let seen = &mut self.seen[slot(patch, PATCHES_PER_SIDE)];
                if seen.0 != patch || seen.1 < cone.at {
                    *seen = (patch, cone.at);
                }
            }
        }
    }

    /// Marks the arc of an echo as suspected; true if the map explains the echo.
    fn mark_arc(
        &mut self,
        cone: &Cone,
        cones: &[Cone],
        footprint: impl Fn(Point) -> bool,
        mapped: &impl Fn(Point) -> bool,
    ) -> bool {
        let Some(distance) = cone.echo.filter(|distance| *distance <= LEG_RANGE_M) else { return false };
        let count = libm::ceil(cone.half_beam * distance / CELL_M).max(1.0) as i32;
        let point = |step: i32| {
            let (sin, cos) = libm::sincos(f64::from(step) * cone.half_beam / f64::from(count));
            let (along, across) = (distance * cos, distance * sin);
            Point {
                x: cone.from.x + along * cone.cos - across * cone.sin,
                y: cone.from.y + along * cone.sin + across * cone.cos,
            }
        };
        let mut arc = mem::take(&mut self.arc);
        arc.clear();
        let is_mapped = (-count..=count).map(point).any(|at| {
            arc.push(at);
            mapped(at)
        });
        if !is_mapped {
            self.suspect(cone, cones, &arc, footprint);
        }
        self.arc = arc;
        is_mapped
    }

    /// Suspects the points of an echo's arc, except for those that other cones found free.
    fn suspect(&mut self, cone: &Cone, cones: &[Cone], arc: &[Point], footprint: impl Fn(Point) -> bool) {
        let is_other = |other: &&Cone| other.sonar != cone.sonar && apart(other.at, cone.at) < CARVE_WITHIN;
        let others: Vec<&Cone> = cones.iter().filter(is_other).collect();
        let mut last = None;
        for at in arc.iter().copied() {
            let cell = place(at, CELL_M);
            if last == Some(cell) || footprint(at) || others.iter().any(|cone| cone.carves(at)) {
                continue;
            }
            last = Some(cell);
            let near = cone.echo.is_some_and(|distance| distance < NEAR_M);
            self.suspect_cell(cell, cone.at, cone.closing, near);
        }
    }

    /// Marks the place at which a floor ranger sees no floor, and what is behind it.
    pub fn add_edge(&mut self, at: Pose) {
        for number in 0..EDGE_CELLS {
            let behind = at * Pose::new(f64::from(number) * CELL_M, 0.0, 0.0);
            let cell = place(behind.point(), CELL_M);
            if self.edges.contains(&cell) {
                continue;
            }
            if self.edges.len() == EDGES_MAX {
                self.edges.pop_front();
            }
            self.edges.push_back(cell);
        }
    }

    /// Tracked people, extrapolated to `now`.
    pub fn people(&self, now: Instant) -> impl Iterator<Item = Person> + '_ {
        self.people.around(now)
    }

    fn suspect_cell(&mut self, place: (i32, i32), suspected: Instant, closing: f64, near: bool) {
        let slot = slot(place, SIDE_CELLS);
        match self.index[slot].checked_sub(1) {
            Some(number) => {
                let cell = &mut self.cells[usize::from(number)];
                if cell.place == place {
                    let evidence = (cell.evidence + SUSPICION_WEIGHT).min(EVIDENCE_MAX);
                    *cell = Cell { evidence, suspected: suspected.max(cell.suspected), closing, near, ..*cell };
                }
            }
            None if self.cells.len() < HITS_MAX => {
                self.cells.push(Cell { place, evidence: SUSPICION_WEIGHT, suspected, closing, near });
                self.index[slot] = self.cells.len() as u16;
            }
            None => {}
        }
    }

    /// Drops cells that are old, far away, or under the robot, and those that `freed` leaves without evidence: what it
    /// takes from a cell, which is an obstacle or only suspected.
    fn expire(
        &mut self,
        now: Instant,
        robot: Pose,
        is_body: impl Fn(Point) -> bool,
        freed: impl Fn(&Cell, bool) -> u8,
    ) {
        let near = CELL_M * f64::from(SIDE_CELLS) / 2.0 - CELL_M;
        self.keep(|cell| {
            let at = middle(cell.place);
            let is_obstacle = cell.evidence >= OBSTACLE_EVIDENCE;
            let limit = if is_obstacle { CELL_LIFETIME } else { CONFIRM_WITHIN };
            let inside = (at.x - robot.x).abs() < near && (at.y - robot.y).abs() < near;
            if !inside || now.since(cell.suspected) >= limit || is_body(at) {
                return false;
            }
            cell.evidence = cell.evidence.saturating_sub(freed(cell, is_obstacle));
            cell.evidence > 0
        });
    }

    fn keep(&mut self, mut wanted: impl FnMut(&mut Cell) -> bool) {
        let mut number = 0;
        while number < self.cells.len() {
            if wanted(&mut self.cells[number]) {
                number += 1;
                continue;
            }
            let gone = self.cells.swap_remove(number);
            self.index[slot(gone.place, SIDE_CELLS)] = 0;
            if let Some(moved) = self.cells.get(number) {
                self.index[slot(moved.place, SIDE_CELLS)] = number as u16 + 1;
            }
        }
    }

    /// Occupied cells, near ones after one echo, and those at edges.
    pub fn hits(&self) -> impl Iterator<Item = Hit> + '_ {
        let confirmed = self.cells.iter().filter(|cell| cell.evidence >= OBSTACLE_EVIDENCE || cell.near);
        let edges = self.edges.iter().map(|cell| Hit { at: middle(*cell), closing: 0.0 });
        confirmed.map(|cell| Hit { at: middle(cell.place), closing: cell.closing }).chain(edges)
    }

    /// True if the space at `point` was observed free within the last `age`.
    #[must_use]
    pub fn seen_within(&self, now: Instant, point: Point, age: Duration) -> bool {
        let patch = place(point, PATCH_M);
        let (which, at) = self.seen[slot(patch, PATCHES_PER_SIDE)];
        which == patch && now.since(at) <= age
    }

    /// True if the state of any sonar that covers the path before the front, or the rear, is unknown: it has not
    /// measured within `age_max`, or it does not hear what the map says it must.
    #[must_use]
    pub fn is_blind(&self, now: Instant, forward: bool, body: &Body, age_max: Duration) -> bool {
        let is_unknown = |echo: &&Echo| echo.hearing.is_deaf() || echo.at.is_none_or(|at| now.since(at) >= age_max);
        self.echoes.iter().filter(is_unknown).any(|echo| echo.mount.covers(forward, body))
    }
}

impl Echo {
    /// Range up to which all of the last readings found no echo, m; 0 if there are too few at `now`.
    fn free_range(&self, now: Instant) -> f64 {
        let known = |(at, free): (Instant, f64)| if now.since(at) < FREE_WITHIN { free } else { 0.0 };
        self.free.into_iter().map(known).fold(f64::INFINITY, f64::min)
    }
}

/// Absolute difference of two instants.
fn apart(a: Instant, b: Instant) -> Duration {
    a.since(b).max(b.since(a))
}

fn place(point: Point, size: f64) -> (i32, i32) {
    (floor(point.x / size), floor(point.y / size))
}

/// Greatest integer that is not above a number. Casts saturate: a point outside the grid is far from the robot.
fn floor(number: f64) -> i32 {
    let cut = number as i32;
    cut.saturating_sub(i32::from(number < f64::from(cut)))
}

fn middle(place: (i32, i32)) -> Point {
    Point { x: (f64::from(place.0) + 0.5) * CELL_M, y: (f64::from(place.1) + 0.5) * CELL_M }
}

fn slot((x, y): (i32, i32), side: i32) -> usize {
    (y.rem_euclid(side) * side + x.rem_euclid(side)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::lowlevel::{DataRanges, Reading};

    const FRONT: [(f64, f64, f64); 3] = [(0.75, 0.15, 0.4363), (0.75, 0.0, 0.0), (0.75, -0.15, -0.4363)];

    fn covers(point: Point) -> bool {
        (-0.15..=0.75).contains(&point.x) && point.y.abs() <= 0.30
    }

    const AGE_MAX: Duration = Duration::from_millis(600);
    const BODY: Body = Body { wheelbase: 0.60, front: 0.75, rear: 0.15, width: 0.60, shape: None };

    fn echo(distance: f64) -> ranges::Measurement {
        if distance.is_nan() { ranges::Measurement::Silent } else { ranges::Measurement::Echo(distance) }
    }

    /// Readings of the three front sonars of a robot at the origin.
    fn fired(at: Instant, measured: [ranges::Measurement; 3]) -> Vec<Fired> {
        let fired = |(id, ((x, y, theta), measurement)): (usize, ((f64, f64, f64), ranges::Measurement))| {
            let mount = Mount { at: Point { x, y }, theta, beam: 0.96 };
            let sounding = Sounding { id: id as i32, at, stamp: at.as_nanos() as i64, mount, measurement };
            Fired { sounding, robot: Pose::default(), speed: 0.0 }
        };
        FRONT.into_iter().zip(measured).enumerate().map(fired).collect()
    }

    struct Bench(Obstacles, Instant);

    impl Bench {
        fn receive(&mut self, distances: [f64; 3]) {
            self.take(distances.map(echo));
        }

        fn take(&mut self, measured: [ranges::Measurement; 3]) {
            self.1 += Duration::from_millis(250);
            self.again(measured);
        }

        /// Without a new measurement.
        fn again(&mut self, measured: [ranges::Measurement; 3]) {
            self.0.update(self.1, Pose::default(), &fired(self.1, measured), covers, |point| point.x > 4.0);
        }

        fn count(&self) -> usize {
            self.0.hits().count()
        }
    }

    fn bench() -> Bench {
        Bench(Obstacles::new(), Instant::from_millis(1000))
    }

    #[test]
    fn one_echo_is_not_an_obstacle_and_two_are() {
        let mut bench = bench();
        bench.receive([f64::NAN, 1.0, f64::NAN]);
        assert_eq!(bench.count(), 0);
        bench.receive([f64::NAN, 1.0, f64::NAN]);
        assert!(bench.count() > 0);
        for Hit { at, .. } in bench.0.hits() {
            assert!((at.distance(Point { x: 0.75, y: 0.0 }) - 1.0).abs() < 0.06, "{at:?}");
            assert!(at.y.abs() < 0.5, "on the arc: {at:?}");
        }
    }

    #[test]
    fn an_edge_stays_where_it_was_seen_and_takes_no_more_memory_than_its_bound() {
        let mut bench = bench();
        bench.0.add_edge(Pose::new(0.80, 0.32, 0.0));
        let found: Vec<Point> = bench.0.hits().map(|hit| hit.at).collect();
        assert_eq!(found.len(), 3);
        assert!(found.iter().all(|at| (0.80..0.95).contains(&at.x) && (at.y - 0.325).abs() < 1e-9), "{found:?}");
        for _ in 0..100 {
            bench.receive([f64::NAN; 3]);
        }
        bench.0.add_edge(Pose::new(0.80, 0.32, 0.0));
        assert_eq!(bench.count(), 3);
        (0..1000).for_each(|n| bench.0.add_edge(Pose::new(f64::from(n), 0.0, 0.0)));
        assert_eq!(bench.count(), EDGES_MAX);
    }

    #[test]
    fn echoes_far_apart_in_time_are_not_an_obstacle() {
        let mut bench = bench();
        bench.receive([f64::NAN, 1.0, f64::NAN]);
        bench.1 += Duration::from_secs(2);
        bench.receive([f64::NAN, 1.0, f64::NAN]);
        assert_eq!(bench.count(), 0);
    }

    #[test]
    fn other_cones_carve_the_arc() {
        let mut alone = bench();
        let mut carved = bench();
        for _ in 0..2 {
            // The others have been free for a while.
            alone.receive([2.5, 2.5, 2.5]);
            carved.receive([2.5, 2.5, 2.5]);
        }
        for _ in 0..2 {
            alone.receive([0.85, 0.8, 0.85]);
            carved.receive([2.5, 0.8, 2.5]);
        }
        let near = |hit: &Hit| hit.at.distance(Point { x: 0.75, y: 0.0 }) < 0.86;
        let width = |bench: &Bench| bench.0.hits().filter(near).map(|hit| hit.at.y.abs()).fold(0.0, f64::max);
        assert!(width(&carved) < 0.6 * width(&alone), "{} {}", width(&carved), width(&alone));
    }

    #[test]
    fn a_person_who_has_left_is_removed_as_the_space_is_observed_free() {
        let mut bench = bench();
        for _ in 0..8 {
            bench.receive([2.0, 1.0, 2.0]);
        }
        assert!(bench.count() > 0);
        let before = bench.count();
        for _ in 0..6 {
            bench.receive([2.5, 2.4, 2.5]);
        }
        let old = |bench: &Bench| bench.0.hits().filter(|hit| hit.at.distance(Point { x: 0.75, y: 0.0 }) < 1.5).count();
        assert!(old(&bench) * 4 < before, "but for the arc's ends: {} of {before}", old(&bench));
        for _ in 0..15 {
            bench.receive([2.5, 2.4, 2.5]);
        }
        assert_eq!(old(&bench), 0, "without an echo for 5 s");
    }

    #[test]
    fn silence_frees_only_the_space_in_which_a_leg_would_echo() {
        let mut bench = bench();
        for _ in 0..3 {
            bench.receive([2.4, 2.3, 2.4]);
        }
        let before = bench.count();
        assert!(before > 0);
        bench.receive([f64::NAN; 3]);
        assert_eq!(bench.count(), before);
        for _ in 0..21 {
            bench.receive([f64::NAN; 3]);
        }
        assert_eq!(bench.count(), 0, "without an echo for 5 s");
    }

    #[test]
    fn a_mapped_echo_is_not_an_obstacle() {
        let mut bench = Bench(Obstacles::new(), Instant::from_millis(1000));
        for _ in 0..4 {
            bench.1 += Duration::from_millis(250);
            let wall = |point: Point| (point.x - 2.75).abs() < 0.1;
            let fired = fired(bench.1, [2.2, 2.0, 2.2].map(echo));
            bench.0.update(bench.1, Pose::default(), &fired, covers, wall);
        }
        assert_eq!(bench.count(), 0);
    }

    #[test]
    fn an_unknown_reading_frees_and_marks_nothing() {
        let silent = ranges::Measurement::Silent;
        for (unknown, kept) in
            [(ranges::Measurement::Unknown, true), (ranges::Measurement::NoEcho, true), (silent, false)]
        {
            let mut bench = bench();
            bench.receive([f64::NAN, 1.0, f64::NAN]);
            bench.receive([f64::NAN, 1.0, f64::NAN]);
            let before = bench.count();
            for _ in 0..6 {
                bench.take([unknown; 3]);
            }
            assert!(before > 0 && (bench.count() == before) == kept, "{unknown:?}: {} of {before}", bench.count());
            let ahead = Point { x: 2.0, y: 0.1 };
            assert_eq!(bench.0.seen_within(bench.1, ahead, Duration::from_secs(1)), !kept, "{unknown:?}");
            assert_eq!(bench.0.is_blind(bench.1, true, &BODY, AGE_MAX), unknown == ranges::Measurement::Unknown);
            assert!(!bench.0.is_blind(bench.1, false, &BODY, AGE_MAX), "no sonar looks back");
        }
    }

    #[test]
    fn a_direction_is_blind_when_its_last_reading_is_too_old() {
        let mut bench = bench();
        bench.receive([f64::NAN, 0.5, f64::NAN]);
        bench.take([ranges::Measurement::Unknown; 3]);
        assert!(!bench.0.is_blind(bench.1, true, &BODY, AGE_MAX));
        bench.1 += Duration::from_secs(1);
        assert!(bench.0.is_blind(bench.1, true, &BODY, AGE_MAX));
    }

    #[test]
    fn a_repeated_reading_does_not_count_twice() {
        let mut bench = bench();
        let measured = [f64::NAN, 1.0, f64::NAN].map(echo);
        bench.take(measured);
        for _ in 0..5 {
            bench.again(measured);
        }
        assert_eq!(bench.count(), 0, "one echo is no obstacle");
        bench.take(measured);
        assert!(bench.count() > 0);
    }

    #[test]
    fn a_narrow_beam_marks_and_frees_only_its_own_width() {
        let width = |beam: f64| {
            let mut bench = bench();
            for _ in 0..FREE_READINGS {
                bench.1 += Duration::from_millis(250);
                let mount = Mount { at: Point { x: 0.75, y: 0.0 }, theta: 0.0, beam };
                let (at, measurement) = (bench.1, ranges::Measurement::Echo(2.0));
                let sounding = Sounding { id: 0, at, stamp: at.as_nanos() as i64, mount, measurement };
                let fired = [Fired { sounding, robot: Pose::default(), speed: 0.0 }];
                bench.0.update(bench.1, Pose::default(), &fired, covers, |_| false);
            }
            let beside = Point { x: 2.2, y: 0.45 };
            let seen = bench.0.seen_within(bench.1, beside, Duration::from_secs(1));
            (bench.0.hits().map(|hit| hit.at.y.abs()).fold(0.0, f64::max), seen)
        };
        let (wide, narrow) = (width(0.96), width(0.2));
        assert!(wide.0 > 0.85 && wide.1, "{wide:?}");
        assert!(narrow.0 < 0.25 && !narrow.1, "{narrow:?}");
    }

    #[test]
    fn a_person_walking_towards_the_robot_has_a_closing_speed() {
        let mut bench = bench();
        bench.receive([2.0; 3]);
        bench.receive([1.75; 3]);
        let closing = bench.0.hits().map(|hit| hit.closing).fold(0.0, f64::max);
        assert!((closing - 1.0).abs() < 1e-9, "{closing}");
    }

    #[test]
    fn space_is_free_only_after_several_readings_in_succession() {
        let (second, ahead) = (Duration::from_secs(1), Point { x: 2.0, y: 0.1 });
        for free in [[f64::NAN; 3], [2.4; 3]] {
            let mut bench = bench();
            let seen = |bench: &Bench| bench.0.seen_within(bench.1, ahead, second);
            for receive in [free, free, [0.9; 3], free, free] {
                bench.receive(receive);
                assert!(!seen(&bench), "an echo begins anew");
            }
            bench.receive(free);
            assert!(seen(&bench));
            // Too old together.
            bench.1 += 2 * second;
            bench.receive(free);
            bench.receive(free);
            assert!(!seen(&bench));
        }
        // Obstacles stay as well.
        let mut bench = bench();
        for _ in 0..4 {
            bench.receive([f64::NAN, 0.8, f64::NAN]);
        }
        let before = bench.count();
        bench.receive([f64::NAN; 3]);
        bench.receive([f64::NAN; 3]);
        assert_eq!(bench.count(), before, "a leg is missed twice in succession now and then");
        (0..4).for_each(|_| bench.receive([f64::NAN; 3]));
        assert!(bench.count() < before, "{before}");
    }

    #[test]
    fn one_unknown_sonar_ahead_is_enough_to_be_blind_in_that_direction() {
        let silent = ranges::Measurement::Silent;
        let mut bench = bench();
        bench.take([silent; 3]);
        for unknown in 0..3 {
            let mut measured = [silent; 3];
            measured[unknown] = ranges::Measurement::Unknown;
            bench.take([silent; 3]);
            bench.take(measured);
            bench.take(measured);
            assert!(!bench.0.is_blind(bench.1, true, &BODY, AGE_MAX), "0.5 s old");
            bench.take(measured);
            assert!(bench.0.is_blind(bench.1, true, &BODY, AGE_MAX));
        }
    }

    #[test]
    fn a_sonar_that_does_not_hear_the_wall_ahead_is_unknown() {
        let mut bench = bench();
        let wall = |point: Point| point.x > 1.75;
        let receive = |bench: &mut Bench, distances: [f64; 3]| {
            bench.1 += Duration::from_millis(250);
            let fired = fired(bench.1, distances.map(echo));
            bench.0.update(bench.1, Pose::default(), &fired, covers, wall);
        };
        for _ in 0..7 {
            receive(&mut bench, [1.0, f64::NAN, 1.0]);
        }
        assert!(!bench.0.is_blind(bench.1, true, &BODY, AGE_MAX));
        receive(&mut bench, [1.0, f64::NAN, 1.0]);
        assert!(bench.0.is_blind(bench.1, true, &BODY, AGE_MAX), "the middle one is dead");
        receive(&mut bench, [1.0, 1.0, 1.0]);
        assert!(!bench.0.is_blind(bench.1, true, &BODY, AGE_MAX), "it hears again");
    }

    #[test]
    fn a_reading_that_is_sent_again_proves_nothing_more() {
        let mut bench = bench();
        let wall = |point: Point| point.x > 1.75;
        bench.1 += Duration::from_millis(250);
        let first = fired(bench.1, [f64::NAN; 3].map(echo));
        for n in 0..20 {
            // Each message takes a little longer than the one before.
            let later = |one: &Fired| {
                let at = one.sounding.at + Duration::from_micros(40 * n);
                Fired { sounding: Sounding { at, ..one.sounding }, ..*one }
            };
            let again: Vec<Fired> = first.iter().map(later).collect();
            bench.0.update(bench.1 + Duration::from_millis(n), Pose::default(), &again, covers, wall);
        }
        assert!(!bench.0.is_blind(bench.1, true, &BODY, AGE_MAX), "one silent reading makes nobody deaf");
        let (second, now) = (Duration::from_secs(1), bench.1);
        assert!(!bench.0.seen_within(now, Point { x: 1.2, y: 0.0 }, second), "and frees no space");
    }

    #[test]
    fn a_near_echo_counts_until_two_readings_miss_it_and_a_far_one_when_it_is_confirmed() {
        let ahead = |bench: &Bench| bench.0.hits().any(|hit| hit.at.y.abs() < 0.1);
        let mut bench = bench();
        bench.receive([f64::NAN, 0.8, f64::NAN]);
        assert!(ahead(&bench));
        bench.receive([f64::NAN; 3]);
        assert!(ahead(&bench), "a leg is missed now and then");
        bench.receive([f64::NAN; 3]);
        assert!(!ahead(&bench), "it was crosstalk");
        bench.receive([f64::NAN, 1.5, f64::NAN]);
        assert!(!ahead(&bench));
        bench.receive([f64::NAN, 1.5, f64::NAN]);
        assert!(ahead(&bench));
    }

    #[test]
    fn observed_space_expires() {
        let mut bench = bench();
        for _ in 0..FREE_READINGS {
            bench.receive([2.0, 2.0, 2.0]);
        }
        let (second, now) = (Duration::from_secs(1), bench.1);
        assert!(bench.0.seen_within(now, Point { x: 2.0, y: 0.1 }, second));
        assert!(!bench.0.seen_within(now, Point { x: 3.2, y: 0.0 }, second), "behind the echo");
        assert!(!bench.0.seen_within(now, Point { x: 0.0, y: 2.0 }, second), "no sonar looks there");
        assert!(!bench.0.seen_within(now + 2 * second, Point { x: 2.0, y: 0.1 }, second));
    }

    #[test]
    fn invalid_values_in_a_message_do_no_harm() {
        let mut bench = bench();
        let wild = [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e300, 1e-300, 2.0];
        for x in wild {
            for theta in wild {
                for distance in wild {
                    let reading = Reading {
                        id: 7,
                        x,
                        y: x,
                        theta,
                        distance,
                        status: Reading::MEASURED,
                        beam: x,
                        ..Default::default()
                    };
                    bench.1 += Duration::from_millis(10);
                    let pose = Pose::new(x.clamp(-1e9, 1e9), 0.0, 0.0);
                    let message = DataRanges { timestamp: 0, readings: vec![reading; 40] };
                    let fired = |sounding| Fired { sounding, robot: pose, speed: 0.0 };
                    let round: Vec<Fired> = ranges::of_ranges(bench.1, &message).into_iter().map(fired).collect();
                    bench.0.update(bench.1, pose, &round, covers, |_| false);
                }
            }
        }
        assert!(bench.count() <= HITS_MAX);
    }
}
