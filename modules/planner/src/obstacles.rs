//! What the sonars say stands around the robot: cells of 5 cm, in the frame of the map.
//!
//! A sonar hears the nearest echo in its cone, not where in the cone it came from. So an echo puts an arc of suspicion
//! at its distance, less what other cones have just found free; space nearer than the echo is free. Silence frees only
//! what even a leg would have been heard in, and only within the specular limit (docs/facts/robot.md 2.1, 4.3). A cell
//! counts when it was suspected twice within about a second: one crosstalk is no obstacle. What is not heard again is
//! forgotten. Clothes swallow sound: beyond a metre that a cone did not hear somebody says little.

use crate::people::{Heard, People, Person};
use base::{Duration, Instant};
use messages::lowlevel::Range;
use navitools::{Point, Pose};
use std::mem;

/// Edge of a cell, m.
pub const CELL: f64 = 0.05;
/// Cells along an edge of the grid, which goes with the robot: 8 m.
const SIDE: i32 = 160;
/// A leg is heard to here, m; what is farther is no news for the next stop.
const REACH: f64 = 2.5;
/// Silence frees to here, m: a leg would have been heard.
const SILENT_REACH: f64 = 2.0;
/// Half of a sonar's beam, rad: 55° at -6 dB.
const HALF_BEAM: f64 = 0.48;
/// cos² of the specular limit, 25°: within it of the axis a smooth wall that stands square to the sound would be heard.
const COS2_SPECULAR: f64 = 0.8214;
/// An echo's distance is known to this, m: noise, a reading's age and the pose.
const BLUR: f64 = 0.10;
/// What a suspicion counts, and how much makes an obstacle: two.
const SUSPICION: u8 = 4;
const CONFIRMED: u8 = 6;
/// More is not counted, so that what has left is forgotten soon.
const EVIDENCE_MAX: u8 = 12;
/// What a round counts in which a cone found it free: near, and where it may just not have heard.
const FREE_NEAR: u8 = 3;
const FREE_FAR: u8 = 1;
/// Near is up to here, m.
const NEAR: f64 = 1.0;
/// A cell that was not suspected for this long is free.
const DECAY: Duration = Duration::from_secs(5);
/// The second suspicion must come within this time.
const CONFIRM_WITHIN: Duration = Duration::from_secs(1);
/// Edge of a patch of space that was seen, m.
const PATCH: f64 = 0.25;
/// Patches along an edge.
const PATCHES: i32 = 32;
/// Sonars that are listened to.
const SONARS_MAX: usize = 32;
/// Suspected cells that are remembered.
const HITS_MAX: usize = 2000;
/// Nobody walks faster, m/s (ISO 13855).
const WALKING: f64 = 1.6;
/// Echoes of a sonar that differ by less, m, are of one thing.
const SAME: f64 = 0.7;
/// Slower than this nobody comes nearer: the jitter of a reading's age, m/s.
const CLOSING_LEAST: f64 = 0.3;

/// A cell where something stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Its middle, m.
    pub at: Point,
    /// How fast it comes nearer by itself, m/s; 0 when it stands.
    pub closing: f64,
}

#[derive(Clone, Copy, Debug)]
struct Cell {
    place: (i32, i32),
    evidence: u8,
    heard: Instant,
    closing: f64,
}

/// What one sonar heard last.
#[derive(Clone, Copy, Debug, Default)]
struct Echo {
    at: Instant,
    /// m; none: nothing.
    distance: Option<f64>,
    closing: f64,
    /// Where it looks in the robot's frame, rad.
    theta: f64,
    /// The map says what was heard.
    mapped: bool,
    /// The reading before was about the same.
    again: bool,
    /// Where the reading before found something of the map, that this one did not find, m.
    held: Option<f64>,
}

/// An echo in a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Echoed {
    /// m from the sonar.
    pub distance: f64,
    /// How fast it comes nearer by itself, m/s.
    pub closing: f64,
    /// It stands where the map has something.
    pub mapped: bool,
    /// The reading before was of it too: it is no crosstalk.
    pub again: bool,
}

/// A cone at the moment of its reading.
#[derive(Debug)]
struct Cone {
    /// Its number in the message.
    sonar: usize,
    from: Point,
    cos: f64,
    sin: f64,
    echo: Option<f64>,
    /// Free up to here, m.
    free: f64,
    closing: f64,
}

impl Cone {
    /// How sure it is that `point` is free; 0: it is not.
    fn frees(&self, point: Point) -> u8 {
        let (dx, dy) = (point.x - self.from.x, point.y - self.from.y);
        let along = dx * self.cos + dy * self.sin;
        let d2 = dx * dx + dy * dy;
        let frees = along > 0.0 && d2 < self.free * self.free && along * along >= COS2_SPECULAR * d2;
        match frees {
            true if d2 < NEAR * NEAR => FREE_NEAR,
            true => FREE_FAR,
            false => 0,
        }
    }
}

/// The obstacles that were sensed.
#[derive(Debug)]
pub struct Obstacles {
    cells: Vec<Cell>,
    /// By place modulo [`SIDE`]: the number of a cell plus one, or 0.
    index: Vec<u16>,
    /// By place modulo [`PATCHES`]: which patch, and when it was last seen free.
    seen: Vec<((i32, i32), Instant)>,
    echoes: Vec<Echo>,
    people: People,
    /// Of the round that is taken: kept for its memory.
    cones: Vec<Cone>,
    round: Vec<Heard>,
}

impl Default for Obstacles {
    fn default() -> Self {
        Self {
            cells: Vec::new(),
            index: vec![0; (SIDE * SIDE) as usize],
            seen: vec![((i32::MAX, i32::MAX), Instant::ZERO); (PATCHES * PATCHES) as usize],
            echoes: Vec::new(),
            people: People::default(),
            cones: Vec::with_capacity(SONARS_MAX),
            round: Vec::with_capacity(SONARS_MAX),
        }
    }
}

impl Obstacles {
    /// Nothing heard.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// What is around has changed altogether: the robot was put elsewhere.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// Takes a round of the sonars received at `now`. `robot` is where the robot was when they were fired, `speed` how
    /// fast it went, m/s; `footprint(point)` tells points of the robot's frame that it covers, `mapped(point)` those
    /// of the map near which an echo is no news.
    pub fn update(
        &mut self,
        now: Instant,
        robot: Pose,
        speed: f64,
        srfs: &[Range],
        footprint: impl Fn(Point) -> bool,
        mapped: impl Fn(Point) -> bool,
    ) {
        self.listen(now, robot, speed, srfs);
        let cones = mem::take(&mut self.cones);
        let inverse = robot.inverse();
        let near = CELL * f64::from(SIDE) / 2.0 - CELL;
        self.keep(|cell| {
            let at = middle(cell.place);
            let limit = if cell.evidence < CONFIRMED { CONFIRM_WITHIN } else { DECAY };
            let freed = cones.iter().map(|cone| cone.frees(at)).max().unwrap_or(0);
            cell.evidence = cell.evidence.saturating_sub(freed);
            let inside = (at.x - robot.x).abs() < near && (at.y - robot.y).abs() < near;
            cell.evidence > 0 && now.since(cell.heard) < limit && inside && !footprint(inverse * at)
        });
        for (number, cone) in cones.iter().enumerate() {
            self.look(now, cone);
            self.suspect(now, number, &cones, |point| footprint(inverse * point), &mapped);
        }
        self.round.clear();
        self.round.extend(cones.iter().map(|cone| Heard {
            from: cone.from,
            axis: (cone.cos, cone.sin),
            echo: cone.echo,
            mapped: self.echoes[cone.sonar].mapped,
        }));
        self.people.update(now, &self.round, |point| footprint(inverse * point));
        self.cones = cones;
    }

    fn listen(&mut self, now: Instant, robot: Pose, speed: f64, srfs: &[Range]) {
        let srfs = &srfs[..srfs.len().min(SONARS_MAX)];
        self.echoes.resize(srfs.len(), Echo::default());
        self.cones.clear();
        for (sonar, (range, last)) in srfs.iter().zip(&mut self.echoes).enumerate() {
            let mount = [range.x, range.y, range.theta];
            if mount.iter().any(|value| !value.is_finite() || value.abs() > 10.0) {
                *last = Echo::default();
                continue;
            }
            let distance =
                (range.valid && range.distance > 0.0 && range.distance.is_finite()).then_some(range.distance);
            let dt = now.since(last.at).as_secs_f64();
            let closing = match (last.distance, distance) {
                (Some(before), Some(after)) if dt > 0.05 && dt < 0.6 => {
                    let closing = (before - after) / dt - speed * libm::cos(range.theta);
                    // A jump is another thing that is heard, not one that runs.
                    if (CLOSING_LEAST..2.0 * WALKING).contains(&closing) { closing.min(WALKING) } else { 0.0 }
                }
                _ => 0.0,
            };
            let same = |(before, after): (f64, f64)| (before - after).abs() < SAME;
            let again = dt < 0.6 && last.distance.zip(distance).is_some_and(same);
            // Walls do not go away: one that a single reading misses is still there, and the robot nearer to it.
            let nearer = |before: f64| before - speed * libm::cos(range.theta) * dt;
            let held = last.distance.filter(|_| last.mapped && dt < 0.6).map(nearer);
            *last = Echo { at: now, distance, closing, theta: range.theta, mapped: false, again, held };
            let pose = robot * Pose::new(range.x, range.y, range.theta);
            let (sin, cos) = pose.theta.sin_cos();
            let free = distance.map_or(SILENT_REACH, |distance| (distance - BLUR).min(REACH));
            self.cones.push(Cone { sonar, from: pose.point(), cos, sin, echo: distance, free, closing });
        }
    }

    /// The space that a cone found free was seen.
    fn look(&mut self, now: Instant, cone: &Cone) {
        for tan in [-0.42, -0.21, 0.0, 0.21, 0.42] {
            let steps = (cone.free / PATCH) as i32;
            for step in 0..=steps {
                let along = f64::from(step) * PATCH;
                let (x, y) = (along * (cone.cos - tan * cone.sin), along * (cone.sin + tan * cone.cos));
                let patch = place(Point { x: cone.from.x + x, y: cone.from.y + y }, PATCH);
                self.seen[slot(patch, PATCHES)] = (patch, now);
            }
        }
    }

    /// Suspects the arc that an echo may have come from.
    fn suspect(
        &mut self,
        now: Instant,
        number: usize,
        cones: &[Cone],
        footprint: impl Fn(Point) -> bool,
        mapped: &impl Fn(Point) -> bool,
    ) {
        let cone = &cones[number];
        let Some(distance) = cone.echo.filter(|distance| *distance <= REACH) else { return };
        let count = libm::ceil(HALF_BEAM * distance / CELL).max(1.0) as i32;
        let point = |step: i32| {
            let angle = f64::from(step) * HALF_BEAM / f64::from(count);
            // Four digits of sine and cosine are finer than a cell.
            let (sin, cos) = (angle - angle * angle * angle / 6.0, 1.0 - angle * angle / 2.0);
            let (along, across) = (distance * cos, distance * sin);
            Point {
                x: cone.from.x + along * cone.cos - across * cone.sin,
                y: cone.from.y + along * cone.sin + across * cone.cos,
            }
        };
        // The map says what was heard.
        if (-count..=count).any(|step| mapped(point(step))) {
            self.echoes[cone.sonar].mapped = true;
            return;
        }
        let mut last = None;
        for step in -count..=count {
            let at = point(step);
            let cell = place(at, CELL);
            let carved = cones.iter().enumerate().any(|(other, cone)| other != number && cone.frees(at) == FREE_NEAR);
            if last == Some(cell) || carved || footprint(at) {
                continue;
            }
            last = Some(cell);
            self.add(now, cell, cone.closing);
        }
    }

    /// Who is around at `now`.
    pub fn people(&self, now: Instant) -> impl Iterator<Item = Person> + '_ {
        self.people.around(now)
    }

    fn add(&mut self, now: Instant, place: (i32, i32), closing: f64) {
        let slot = slot(place, SIDE);
        match self.index[slot].checked_sub(1) {
            Some(number) => {
                let cell = &mut self.cells[usize::from(number)];
                if cell.place == place {
                    *cell =
                        Cell { evidence: (cell.evidence + SUSPICION).min(EVIDENCE_MAX), heard: now, closing, ..*cell };
                }
            }
            None if self.cells.len() < HITS_MAX => {
                self.cells.push(Cell { place, evidence: SUSPICION, heard: now, closing });
                self.index[slot] = self.cells.len() as u16;
            }
            None => {}
        }
    }

    fn keep(&mut self, mut wanted: impl FnMut(&mut Cell) -> bool) {
        let mut number = 0;
        while number < self.cells.len() {
            if wanted(&mut self.cells[number]) {
                number += 1;
                continue;
            }
            let gone = self.cells.swap_remove(number);
            self.index[slot(gone.place, SIDE)] = 0;
            if let Some(moved) = self.cells.get(number) {
                self.index[slot(moved.place, SIDE)] = number as u16 + 1;
            }
        }
    }

    /// The cells where something stands.
    pub fn hits(&self) -> impl Iterator<Item = Hit> + '_ {
        let confirmed = self.cells.iter().filter(|cell| cell.evidence >= CONFIRMED);
        confirmed.map(|cell| Hit { at: middle(cell.place), closing: cell.closing })
    }

    /// Whether the space at `point` was found free within the last `age`.
    #[must_use]
    pub fn seen_within(&self, now: Instant, point: Point, age: Duration) -> bool {
        let patch = place(point, PATCH);
        let (which, at) = self.seen[slot(patch, PATCHES)];
        which == patch && now.since(at) <= age
    }

    /// What sonars looking forward, or back, heard within the last second. One reading is enough here: who is near is
    /// braked for at once.
    pub fn echoes(&self, now: Instant, forward: bool) -> impl Iterator<Item = Echoed> + '_ {
        let looks = move |theta: f64| if forward { theta.abs() < 0.6 } else { theta.abs() > 2.5 };
        let fresh = move |echo: &&Echo| looks(echo.theta) && now.since(echo.at) < Duration::from_secs(1);
        let told = |echo: &Echo| {
            let Echo { distance, closing, mapped, again, held, .. } = *echo;
            let heard = distance.map(|distance| Echoed { distance, closing, mapped, again });
            let held = held.map(|distance| Echoed { distance, closing: 0.0, mapped: true, again: true });
            [heard, held]
        };
        self.echoes.iter().filter(fresh).flat_map(told).flatten()
    }
}

fn place(point: Point, size: f64) -> (i32, i32) {
    // Casts saturate: what is not on the grid is far from the robot.
    (libm::floor(point.x / size) as i32, libm::floor(point.y / size) as i32)
}

fn middle(place: (i32, i32)) -> Point {
    Point { x: (f64::from(place.0) + 0.5) * CELL, y: (f64::from(place.1) + 0.5) * CELL }
}

fn slot((x, y): (i32, i32), side: i32) -> usize {
    (y.rem_euclid(side) * side + x.rem_euclid(side)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRONT: [(f64, f64, f64); 3] = [(0.75, 0.15, 0.4363), (0.75, 0.0, 0.0), (0.75, -0.15, -0.4363)];

    fn covers(point: Point) -> bool {
        (-0.15..=0.75).contains(&point.x) && point.y.abs() <= 0.30
    }

    /// Readings of the three front sonars.
    fn round(distances: [f64; 3]) -> Vec<Range> {
        let range = |(id, ((x, y, theta), distance)): (usize, ((f64, f64, f64), f64))| Range {
            id: id as i32,
            x,
            y,
            theta,
            distance,
            valid: distance.is_finite(),
        };
        FRONT.into_iter().zip(distances).enumerate().map(range).collect()
    }

    struct Bench(Obstacles, Instant);

    impl Bench {
        fn hear(&mut self, distances: [f64; 3]) {
            self.1 += Duration::from_millis(250);
            self.0.update(self.1, Pose::default(), 0.0, &round(distances), covers, |point| point.x > 4.0);
        }

        fn count(&self) -> usize {
            self.0.hits().count()
        }
    }

    fn bench() -> Bench {
        Bench(Obstacles::new(), Instant::from_millis(1000))
    }

    #[test]
    fn one_echo_is_no_obstacle_and_two_are() {
        let mut bench = bench();
        bench.hear([f64::NAN, 1.0, f64::NAN]);
        assert_eq!(bench.count(), 0);
        bench.hear([f64::NAN, 1.0, f64::NAN]);
        assert!(bench.count() > 0);
        for Hit { at, .. } in bench.0.hits() {
            assert!((at.distance(Point { x: 0.75, y: 0.0 }) - 1.0).abs() < 0.06, "{at:?}");
            assert!(at.y.abs() < 0.5, "on the arc: {at:?}");
        }
    }

    #[test]
    fn echoes_of_two_rounds_that_are_far_apart_in_time_are_no_obstacle() {
        let mut bench = bench();
        bench.hear([f64::NAN, 1.0, f64::NAN]);
        bench.1 += Duration::from_secs(2);
        bench.hear([f64::NAN, 1.0, f64::NAN]);
        assert_eq!(bench.count(), 0);
    }

    #[test]
    fn other_cones_carve_the_arc() {
        let mut alone = bench();
        let mut carved = bench();
        for _ in 0..2 {
            alone.hear([0.85, 0.8, 0.85]);
            carved.hear([2.5, 0.8, 2.5]);
        }
        let near = |hit: &Hit| hit.at.distance(Point { x: 0.75, y: 0.0 }) < 0.86;
        let width = |bench: &Bench| bench.0.hits().filter(near).map(|hit| hit.at.y.abs()).fold(0.0, f64::max);
        assert!(width(&carved) < 0.6 * width(&alone), "{} {}", width(&carved), width(&alone));
    }

    #[test]
    fn who_has_left_is_forgotten_as_the_space_is_seen_free() {
        let mut bench = bench();
        for _ in 0..8 {
            bench.hear([2.0, 1.0, 2.0]);
        }
        assert!(bench.count() > 0);
        let before = bench.count();
        for _ in 0..6 {
            bench.hear([2.5, 2.4, 2.5]);
        }
        let old = |bench: &Bench| bench.0.hits().filter(|hit| hit.at.distance(Point { x: 0.75, y: 0.0 }) < 1.5).count();
        assert!(old(&bench) * 4 < before, "but for the arc's ends: {} of {before}", old(&bench));
        for _ in 0..15 {
            bench.hear([2.5, 2.4, 2.5]);
        }
        assert_eq!(old(&bench), 0, "not heard for 5 s");
    }

    #[test]
    fn silence_frees_no_more_than_what_a_leg_would_be_heard_in() {
        let mut bench = bench();
        for _ in 0..3 {
            bench.hear([2.4, 2.3, 2.4]);
        }
        let before = bench.count();
        assert!(before > 0);
        bench.hear([f64::NAN; 3]);
        assert_eq!(bench.count(), before);
        for _ in 0..21 {
            bench.hear([f64::NAN; 3]);
        }
        assert_eq!(bench.count(), 0, "not heard for 5 s");
    }

    #[test]
    fn an_echo_of_the_map_is_no_obstacle() {
        let mut bench = Bench(Obstacles::new(), Instant::from_millis(1000));
        for _ in 0..4 {
            bench.1 += Duration::from_millis(250);
            let wall = |point: Point| (point.x - 2.75).abs() < 0.1;
            bench.0.update(bench.1, Pose::default(), 0.0, &round([2.2, 2.0, 2.2]), covers, wall);
        }
        assert_eq!(bench.count(), 0);
    }

    #[test]
    fn who_walks_towards_the_robot_is_known_by_the_readings() {
        let mut bench = bench();
        bench.hear([f64::NAN, 2.0, f64::NAN]);
        bench.hear([f64::NAN, 1.75, f64::NAN]);
        let echo = bench.0.echoes(bench.1, true).next().unwrap();
        assert!((echo.distance - 1.75).abs() < 1e-9 && (echo.closing - 1.0).abs() < 1e-9, "{echo:?}");
        assert_eq!(bench.0.echoes(bench.1, false).next(), None);
    }

    #[test]
    fn space_is_seen_for_a_while() {
        let mut bench = bench();
        bench.hear([2.0, 2.0, 2.0]);
        let (second, now) = (Duration::from_secs(1), bench.1);
        assert!(bench.0.seen_within(now, Point { x: 2.0, y: 0.1 }, second));
        assert!(!bench.0.seen_within(now, Point { x: 3.2, y: 0.0 }, second), "behind the echo");
        assert!(!bench.0.seen_within(now, Point { x: 0.0, y: 2.0 }, second), "no sonar looks there");
        assert!(!bench.0.seen_within(now + 2 * second, Point { x: 2.0, y: 0.1 }, second));
    }

    #[test]
    fn nonsense_in_a_message_does_no_harm() {
        let mut bench = bench();
        let wild = [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e300, 1e-300, 2.0];
        for x in wild {
            for theta in wild {
                for distance in wild {
                    let range = Range { id: 7, x, y: x, theta, distance, valid: true };
                    bench.1 += Duration::from_millis(10);
                    let pose = Pose::new(x.clamp(-1e9, 1e9), 0.0, 0.0);
                    bench.0.update(bench.1, pose, 0.0, &vec![range; 40], covers, |_| false);
                }
            }
        }
        assert!(bench.count() <= HITS_MAX);
    }
}
