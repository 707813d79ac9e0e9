//! A lidar with 360 beams and ten revolutions a second, on a robot of 0.8 m by 0.5 m, before walls and people.

use super::*;
use crate::tests::RULES;
use kinematics::Twist;
use navitools::Pose;

const BEAMS: usize = 360;
const SECTORS: usize = 8;

/// Something round: its middle at an instant, s, and its radius, m.
type Round<'a> = &'a dyn Fn(f64) -> (Point, f64);

/// Changes the ranges of a sector.
type Spoils<'a> = Box<dyn FnMut(&mut [f32]) + 'a>;

struct Bench<'a> {
    scans: Scans,
    trail: Trail,
    velocity: Twist,
    robot: Pose,
    us: u64,
    turn: i64,
    /// The number that the sectors have.
    numbers: fn(turn: i64, sector: usize) -> i64,
    range_max: f32,
    status: i8,
    /// Beams at the end of each sector that are measured once more, as a sector of their own.
    again: usize,
    things: Vec<Round<'a>>,
    spoils: Spoils<'a>,
}

fn rules() -> Rules {
    Rules { reach: 4.0, ..RULES }
}

fn lidar(x: f64, theta: f64) -> Lidar {
    Lidar { name: "front".into(), mount: Pose::new(x, 0.0, theta), view: TAU }
}

fn body() -> Polygon {
    let corners = [(-0.4, -0.25), (0.4, -0.25), (0.4, 0.25), (-0.4, 0.25)].map(|(x, y)| Point { x, y });
    Polygon::hull(&corners).expect("a body")
}

impl<'a> Bench<'a> {
    fn new(rules: Rules, lidar: &Lidar) -> Self {
        Self {
            scans: Scans::new(rules, std::slice::from_ref(lidar), &body()),
            trail: Trail::default(),
            velocity: Twist::default(),
            robot: Pose::default(),
            us: 1_000_000,
            turn: 0,
            numbers: |turn, _| turn,
            range_max: 12.0,
            status: DataScan::OK,
            again: 0,
            things: Vec::new(),
            spoils: Box::new(|_| ()),
        }
    }

    fn now(&self) -> Instant {
        Instant::from_nanos(1000 * self.us)
    }

    /// A revolution, during which the robot moves on; true if something new was reported.
    fn revolve(&mut self) -> bool {
        let mount = self.scans.eyes[0].lidar.mount;
        let (per_sector, beam_us) = (BEAMS / SECTORS, 100_000 / BEAMS as u64);
        let mut news = false;
        for sector in 0..SECTORS {
            self.trail.on_motion(self.now(), self.velocity, Duration::from_secs(1));
            let (begun, first) = (self.now(), sector * per_sector);
            let mut ranges = Vec::new();
            for k in first..first + per_sector {
                let at =
                    kinematics::integrate(self.robot, self.velocity, self.now().since(begun).as_secs_f64()) * mount;
                let angle = (at.theta + (k as f64 * TAU / BEAMS as f64 - TAU / 2.0)).radians();
                ranges.push(self.range(at.point(), angle));
                self.us += beam_us;
            }
            self.robot = kinematics::integrate(self.robot, self.velocity, self.now().since(begun).as_secs_f64());
            (self.spoils)(&mut ranges);
            let scan = DataScan {
                name: "front".into(),
                revolution: (self.numbers)(self.turn, sector),
                status: self.status,
                angle_min: first as f64 * TAU / BEAMS as f64 - TAU / 2.0,
                angle_step: TAU / BEAMS as f64,
                beam_time: beam_us as f64 / 1e6,
                range_min: 0.02,
                range_max: self.range_max,
                ranges,
                ..DataScan::default()
            };
            let now = self.now();
            news |= self.scans.on_scan(now, now.since(begun), &scan, &self.trail).is_some();
            if self.again > 0 {
                let from = per_sector - self.again;
                let angle_min = scan.angle_min + from as f64 * scan.angle_step;
                let scan = DataScan { angle_min, ranges: scan.ranges[from..].to_vec(), ..scan };
                let age = Duration::from_micros(self.again as u64 * beam_us);
                news |= self.scans.on_scan(now, age, &scan, &self.trail).is_some();
            }
        }
        self.turn += 1;
        news
    }

    fn revolve_times(&mut self, times: usize) {
        for _ in 0..times {
            self.revolve();
        }
    }

    fn range(&self, from: Point, angle: f64) -> f32 {
        let (sin, cos) = libm::sincos(angle);
        let seconds = self.us as f64 / 1e6;
        let met = self.things.iter().filter_map(|thing| {
            let (middle, radius) = thing(seconds);
            let (x, y) = (middle.x - from.x, middle.y - from.y);
            let (along, across) = (x * cos + y * sin, y * cos - x * sin);
            let within = radius * radius - across * across;
            (within > 0.0).then(|| along - libm::sqrt(within)).filter(|distance| *distance > 0.0)
        });
        met.fold(f64::INFINITY, f64::min) as f32
    }

    /// What is found in the robot's frame: sensed and unknown.
    fn found(&mut self) -> (Vec<Obstacle>, Vec<Obstacle>) {
        let mut found = Vec::new();
        self.scans.obstacles(self.now(), &self.trail, &mut found);
        let to_robot = self.trail.pose(self.now()).inverse().to_outer();
        found.iter_mut().for_each(|obstacle| obstacle.at = to_robot(obstacle.at));
        found.into_iter().partition(|obstacle| obstacle.sensed)
    }

    fn counts(&mut self) -> (usize, usize) {
        let (sensed, unknown) = self.found();
        (sensed.len(), unknown.len())
    }
}

fn leg(x: f64, y: f64) -> impl Fn(f64) -> (Point, f64) {
    move |_| (Point { x, y }, 0.06)
}

#[test]
fn a_direction_is_unknown_until_it_was_measured_in_two_revolutions_and_again_when_it_is_not() {
    let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
    let all = 180 * (COVERED_M.len() + 1);
    assert_eq!(bench.counts(), (0, all));
    bench.revolve();
    assert_eq!(bench.counts(), (0, all), "once is not enough");
    bench.revolve();
    assert_eq!(bench.counts(), (0, 0), "nothing is there");
    // A quarter of the view is not measured any more.
    bench.spoils = Box::new(|ranges| {
        let last = ranges.len() / 2;
        ranges[..last].fill(f32::NAN);
    });
    bench.revolve_times(2);
    assert_eq!(bench.counts(), (0, 0), "for 0.3 s it is known");
    bench.revolve_times(2);
    let (sensed, unknown) = bench.counts();
    assert!(sensed == 0 && (all * 2 / 5..=all * 3 / 5).contains(&unknown), "{unknown} of {all}");
    bench.us += 301_000;
    assert_eq!(bench.counts(), (0, all), "it is silent");
    bench.spoils = Box::new(|_| ());
    bench.revolve();
    assert_eq!(bench.counts(), (0, all), "and begins anew");
    bench.revolve();
    assert_eq!(bench.counts(), (0, 0));
}

#[test]
fn what_is_unknown_begins_at_the_outline() {
    for (x, view) in [(0.0, TAU), (0.39, 4.7), (0.41, TAU)] {
        let lidar = Lidar { view, ..lidar(x, 0.0) };
        let mut bench = Bench::new(rules(), &lidar);
        let (_, unknown) = bench.found();
        let outside = |obstacle: &Obstacle| body().outside(obstacle.at);
        assert!(unknown.iter().all(|obstacle| outside(obstacle) > 0.0), "{x}");
        let beside = unknown.iter().filter(|obstacle| outside(obstacle) < 0.05).count();
        assert!(beside >= (view / SLICE_RAD) as usize / 2, "{x}: {beside}");
        let behind = unknown.iter().any(|obstacle| obstacle.at.x < -0.4 && obstacle.at.y.abs() < 0.1);
        assert_eq!(behind, view == TAU, "{x}");
    }
}

#[test]
fn a_direction_that_is_not_known_is_not_known_up_to_the_reach_and_without_a_gap() {
    let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
    let unseen = |bench: &Bench| {
        let mut unseen = Vec::new();
        bench.scans.unseen(bench.now(), &mut unseen);
        unseen
    };
    let all = unseen(&bench);
    assert_eq!(all.len(), 180);
    let mount = Point { x: 0.3, y: 0.0 };
    for part in &all {
        assert!((part.half / part.to.distance(mount) - libm::tan(SLICE_RAD / 2.0)).abs() < 1e-9, "{part:?}");
        assert!((part.to.distance(part.from) - (rules().reach - COVERED_M[0])).abs() < 1e-9, "{part:?}");
        assert!(body().outside(part.from) > 0.0 && part.source == Source::Lidar(0), "{part:?}");
    }
    bench.revolve_times(2);
    assert_eq!(unseen(&bench), []);
}

#[test]
fn two_revolutions_find_something_and_a_wild_beam_is_nothing() {
    let thing = leg(1.5, 0.1);
    for (evaluations, counts) in [(1, [true, true]), (2, [false, true]), (3, [false, false])] {
        let mut bench = Bench::new(Rules { evaluations, ..rules() }, &lidar(0.3, 0.0));
        bench.revolve_times(4);
        bench.things.push(&thing);
        let mut counted = false;
        for expected in counts {
            let news = bench.revolve();
            let (sensed, _) = bench.found();
            assert_eq!((!sensed.is_empty(), news), (expected, expected && !counted), "{evaluations}");
            counted = expected;
            let right = |hit: &Obstacle| (hit.at.x - 1.45).abs() < 0.05 && (hit.at.y - 0.1).abs() < 0.1;
            assert!(sensed.iter().all(right), "{sensed:?}");
        }
    }
    let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
    for turn in 0..40 {
        // Each revolution the wild beams are a degree farther on; those of every eighth are near each other.
        bench.spoils = Box::new(move |ranges| {
            if turn % 2 == 0 {
                ranges[turn % 45] = 0.7;
            }
        });
        bench.revolve();
        assert_eq!(bench.found().0, [], "{turn}");
    }
}

#[test]
fn a_single_beam_counts_only_where_it_was_before_and_a_leg_that_walks_counts() {
    // Wild beams 15 cm apart, as far as somebody walks in a revolution.
    let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
    for turn in 0..40 {
        bench.spoils = Box::new(move |ranges| ranges[20] = if turn % 2 == 0 { 0.7 } else { 0.85 });
        bench.revolve();
        assert_eq!(bench.found().0, [], "{turn}");
    }
    // One beside it that has not measured hides no leg.
    let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
    for turn in 0..40 {
        bench.spoils = Box::new(move |ranges| {
            (ranges[20], ranges[21]) = (if turn % 2 == 0 { 0.5 } else { 0.65 }, f32::NAN);
        });
        bench.revolve();
        assert_eq!(bench.found().0, [], "{turn}");
    }
    // Beside some that have not measured, or that met something nearer, it may be a part of a leg.
    for beside in [f32::NAN, 0.4] {
        let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
        for turn in 0..4 {
            bench.spoils = Box::new(move |ranges| {
                ranges[20] = if turn % 2 == 0 { 0.7 } else { 0.85 };
                ranges[21..24].fill(beside);
            });
            bench.revolve();
        }
        let far = |hit: &Obstacle| hit.at.distance(Point { x: 0.3, y: 0.0 }) > 0.6;
        assert!(bench.found().0.iter().any(far), "{beside}");
    }
    // A stick that stands, which a beam meets alone, past which the robot drives.
    let stick = |_: f64| (Point { x: 2.2, y: 0.5 }, 0.012);
    let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
    bench.velocity = Twist { vx: 0.7, ..Twist::default() };
    bench.things.push(&stick);
    let mut found = 0;
    for _ in 0..20 {
        bench.revolve();
        found += usize::from(!bench.found().0.is_empty());
    }
    assert!(found >= 15, "{found} of 20 revolutions");
    // Beams beside it prove nothing beyond `range_max`, or while the lidar reports a fault.
    for (range_max, status) in [(0.8, DataScan::OK), (f32::NAN, DataScan::OK), (12.0, DataScan::BLOCKED)] {
        let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
        (bench.range_max, bench.status) = (range_max, status);
        for turn in 0..4 {
            bench.spoils = Box::new(move |ranges| ranges[20] = if turn % 2 == 0 { 0.7 } else { 0.85 });
            bench.revolve();
        }
        assert!(!bench.found().0.is_empty(), "{range_max} m, {status}");
    }
    // The leg of the standard, and an ankle, walk across, near and as far as they must be met by two beams.
    for (ahead, radius) in [(1.0, 0.035), (2.2, 0.035), (1.0, 0.025), (1.6, 0.025)] {
        let leg = move |at: f64| (Point { x: ahead, y: 1.0 - 1.6 * (at - 1.0) }, radius);
        let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
        bench.things.push(&leg);
        bench.revolve_times(2);
        for n in 0..8 {
            bench.revolve();
            assert!(!bench.found().0.is_empty(), "{ahead} m ahead, {radius}, {n}");
        }
    }
}

#[test]
fn a_leg_that_walks_counts_in_the_second_revolution_even_if_its_edges_are_not_measured() {
    // Across, and towards the robot, where three beams should meet it, and where two should.
    for (ahead, walks) in [(1.5, (0.0, -1.6)), (2.2, (0.0, -1.6)), (1.6, (-1.6, 0.0)), (2.3, (-1.6, 0.0))] {
        for phase in 0..20 {
            let begins = f64::from(phase) * 0.002;
            let leg = move |at: f64| {
                let since = at - 1.0;
                // What is farther from its middle than 0.8 of its radius is an edge.
                (Point { x: ahead + walks.0 * since, y: begins + walks.1 * since }, 0.8 * 0.035)
            };
            let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
            bench.things.push(&leg);
            bench.revolve();
            assert_eq!(bench.found().0, [], "{phase}");
            bench.revolve();
            assert!(!bench.found().0.is_empty(), "{ahead} m ahead, {walks:?}, {phase}");
        }
    }
}

#[test]
fn directions_that_are_measured_twice_begin_no_revolution() {
    let thing = leg(1.5, 0.1);
    let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
    // 10 degrees, as behind something near that a lidar sees by triangulation.
    bench.again = 10;
    bench.revolve_times(4);
    assert_eq!(bench.scans.eyes[0].count, 4);
    bench.things.push(&thing);
    bench.revolve();
    assert_eq!(bench.found().0, [], "twice, but in one revolution");
    bench.revolve();
    assert!(!bench.found().0.is_empty());
    assert_eq!(bench.scans.eyes[0].count, 6);
}

#[test]
fn wild_beams_that_only_nearness_to_the_lidar_or_the_end_of_a_sector_made_neighbours_are_nothing() {
    /// Beams and their ranges, in the even revolutions and in the odd ones.
    type Pair = [&'static [(usize, f32)]; 2];
    let pairs: [Pair; 5] = [
        // 18 degrees apart: 4 cm, because the lidar is so near.
        [&[(10, 0.12)], &[(28, 0.13)]],
        // Two that are nearer than anything that can be measured.
        [&[(10, f32::NEG_INFINITY)], &[(30, 0.2)]],
        [&[(10, f32::NEG_INFINITY)], &[(40, 0.15)]],
        // The first beam of a sector, and one before it that has not measured.
        [&[(0, 0.7)], &[(0, 0.85)]],
        [&[(0, 0.5)], &[(0, 0.65), (44, f32::NAN)]],
    ];
    for pair in pairs {
        let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
        for turn in 0..40 {
            bench.spoils =
                Box::new(move |ranges| pair[turn % 2].iter().for_each(|(beam, range)| ranges[*beam] = *range));
            bench.revolve();
            assert_eq!(bench.found().0, [], "{pair:?} {turn}");
        }
    }
}

#[test]
fn the_first_beam_of_a_sector_is_not_alone_beside_one_that_has_not_measured_or_met_something_nor_is_the_last_one() {
    // Beams 12 mm from each other: the second one beside them is too far away to show anything.
    for (beam, beside) in [(0, Some((44, f32::NAN))), (0, Some((44, 0.5))), (44, Some((0, f32::NAN))), (44, None)] {
        let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
        for turn in 0..4 {
            bench.spoils = Box::new(move |ranges| {
                ranges[beam] = if turn % 2 == 0 { 0.7 } else { 0.85 };
                if let Some((beside, range)) = beside {
                    ranges[beside] = range;
                }
            });
            bench.revolve();
        }
        let (sensed, _) = bench.found();
        let it = |hit: &&Obstacle| (hit.at.distance(Point { x: 0.3, y: 0.0 }) - 0.85).abs() < 0.01;
        assert!(sensed.iter().filter(it).count() >= SECTORS - 1, "{beam} {beside:?}: {sensed:?}");
    }
}

#[test]
fn a_sector_continues_another_only_where_and_when_that_ended() {
    let scan = |angle_min: f64, angle_step: f64| DataScan {
        angle_min,
        angle_step,
        beam_time: 1e-4,
        ranges: vec![1.0; 10],
        ..DataScan::default()
    };
    let begun = Instant::from_millis(1000);
    for step in [0.01, -0.01] {
        let tail = Tail::of(&scan(3.1, step), begun);
        let gap = |steps: f64, us: u64| tail.gap(&scan(3.1 + steps * step, step), begun + Duration::from_micros(us));
        assert!(gap(10.0, 1000).is_some_and(|gap| (gap - 1.0).abs() < 1e-6), "{step}");
        assert!(gap(10.4, 4000).is_some_and(|gap| (gap - 1.4).abs() < 1e-6), "{step}");
        // A beam was lost, they overlap, or it is that of another revolution.
        assert_eq!([gap(11.0, 1000), gap(9.0, 1000), gap(10.0, 101_000)], [None; 3], "{step}");
    }
    for step in [0.0, f64::NAN] {
        assert_eq!(Tail::of(&scan(0.0, step), begun).gap(&scan(0.0, step), begun), None);
    }
}

#[test]
fn the_leg_of_a_chair_counts_after_two_revolutions_wherever_it_stands() {
    // As far as a beam meets its 2 cm wherever they are; not where a revolution ends.
    for distance in [0.1, 0.2, 0.35, 0.5, 0.7, 0.9, 1.1] {
        for degrees in -174..174 {
            let (sin, cos) = libm::sincos((f64::from(degrees) + 0.3) * TAU / 360.0);
            let leg = move |_: f64| (Point { x: 0.3 + distance * cos, y: distance * sin }, 0.01);
            let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
            bench.things.push(&leg);
            bench.revolve_times(2);
            assert!(!bench.found().0.is_empty(), "{distance} m, {degrees}");
        }
    }
}

#[test]
fn a_leg_that_walks_counts_in_the_second_revolution_at_the_ends_of_sectors_too() {
    for distance in [0.5, 1.0, 1.8] {
        for speed in [-WALK_MPS, WALK_MPS] {
            for degrees in (-135..=135).step_by(45).flat_map(|end| end - 6..=end + 6) {
                // Across the beam that it is met by first, seen from the lidar.
                let (sin, cos) = libm::sincos(f64::from(degrees) * TAU / 360.0);
                let leg = move |at: f64| {
                    let way = speed * (at - 1.0 - 0.1 * (f64::from(degrees) + 180.0) / 360.0);
                    // What is farther from its middle than 0.8 of its radius is an edge.
                    (Point { x: 0.3 + distance * cos - way * sin, y: distance * sin + way * cos }, 0.8 * 0.035)
                };
                let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
                bench.things.push(&leg);
                bench.revolve();
                assert_eq!(bench.found().0, [], "{distance} m, {degrees}");
                bench.revolve();
                assert!(!bench.found().0.is_empty(), "{distance} m, {speed} m/s, {degrees}");
            }
        }
    }
}

/// A revolution of the bench ends behind; the fourth one begins at this time, s.
const FOURTH_S: f64 = 1.0 + 3.0 * 0.09972;

#[test]
fn who_crosses_the_direction_in_which_a_revolution_ends_and_is_met_twice_in_it_counts() {
    let walks = |seconds: f64| (Point { x: -1.5, y: WALK_MPS * (seconds - FOURTH_S) - 0.03 }, 0.035);
    let mut bench = Bench::new(rules(), &lidar(0.0, 0.0));
    bench.revolve_times(3);
    bench.things.push(&walks);
    assert!(bench.revolve() && bench.counts().0 > 0);
}

#[test]
fn who_crosses_it_and_is_not_met_in_a_revolution_counts_in_the_next_one() {
    let walks = |seconds: f64| (Point { x: -1.5, y: 0.29 - WALK_MPS * (seconds - FOURTH_S) }, 0.035);
    let mut bench = Bench::new(rules(), &lidar(0.0, 0.0));
    bench.revolve_times(3);
    bench.things.push(&walks);
    assert!(!bench.revolve() && !bench.revolve(), "met once");
    assert!(bench.revolve() && bench.counts().0 > 0);
}

/// What a beam met beside others.
fn met(at: Point, bin: usize, distance: f64) -> Met {
    Met { at, bin, distance, follows: true, finding: Finding::Beside, slice: 0 }
}

#[test]
fn a_place_is_compared_up_to_its_tolerance_whatever_the_borders_of_directions() {
    let here = Point::default();
    for n in 0..720 {
        for distance in [0.3, 0.72, 0.96, 1.44, 1.67, 2.5] {
            let at = |angle: f64| {
                let (sin, cos) = libm::sincos(angle);
                Point { x: distance * cos, y: distance * sin }
            };
            // 4.9 cm beside it.
            let angle = f64::from(n) * TAU / 720.0 + 0.001;
            let place = at(angle + 2.0 * libm::asin(0.0245 / distance));
            let hit = Hit { at: place, when: Instant::ZERO, turns: 1, approaches: false, moves: false, slice: 0 };
            let (bin, distance) = seen_from(here, at(angle));
            let met = met(at(angle), bin, distance);
            let arc = Arc::around(&[met], SAME_M);
            assert_eq!(View::new(here, [&hit].into_iter(), &arc).turns(bin, distance, SAME_M), 1, "{n} {distance}");
        }
    }
}

#[test]
fn what_one_revolution_misses_is_still_there() {
    let thing = leg(1.5, 0.1);
    let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
    bench.things.push(&thing);
    bench.revolve_times(4);
    let things = std::mem::take(&mut bench.things);
    bench.revolve();
    assert!(!bench.found().0.is_empty());
    bench.things = things;
    for _ in 0..4 {
        bench.revolve();
        assert!(!bench.found().0.is_empty());
    }
    bench.things.clear();
    bench.revolve_times(3);
    assert_eq!(bench.counts(), (0, 0), "it has gone");
}

#[test]
fn what_is_not_measured_any_more_is_there_until_its_direction_is_unknown() {
    let thing = leg(1.5, 0.1);
    let rules = Rules { scan_age_max: Duration::from_millis(600), ..rules() };
    let mut bench = Bench::new(rules, &lidar(0.3, 0.0));
    bench.things.push(&thing);
    bench.revolve_times(3);
    // Nothing comes back from it, and around it all is measured.
    bench.spoils = Box::new(|ranges| {
        ranges.iter_mut().filter(|range| range.is_finite()).for_each(|range| *range = f32::NAN);
    });
    for n in 1..=5 {
        bench.revolve();
        let (sensed, unknown) = bench.counts();
        assert!(sensed > 0 && unknown == 0, "{n}: {sensed} {unknown}");
    }
    bench.revolve();
    assert!(bench.counts().1 > 0, "0.6 s are over");
}

#[test]
fn a_lidar_that_reports_a_fault_finds_things_and_frees_nothing() {
    let thing = leg(1.5, 0.1);
    let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
    bench.things.push(&thing);
    bench.status = DataScan::SLOW;
    bench.revolve_times(5);
    let (sensed, unknown) = bench.counts();
    assert!(sensed > 0 && unknown == 180 * (COVERED_M.len() + 1), "{sensed} {unknown}");
}

#[test]
fn a_wrong_number_of_the_revolution_neither_frees_nor_hides_anything() {
    let thing = leg(1.5, 0.1);
    let numbers: [fn(i64, usize) -> i64; 3] = [|_, _| 7, |turn, sector| 8 * turn + sector as i64, |turn, _| -turn];
    for numbers in numbers {
        let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
        bench.numbers = numbers;
        bench.revolve_times(4);
        assert_eq!(bench.counts(), (0, 0));
        bench.things.push(&thing);
        bench.revolve();
        assert_eq!(bench.counts(), (0, 0));
        for _ in 0..20 {
            bench.revolve();
            assert!(bench.counts().0 > 0);
        }
    }
}

#[test]
fn nothing_received_frees_no_more_than_the_range_at_which_dark_things_are_seen() {
    let all = 180 * (COVERED_M.len() + 1);
    for (range_max, unknown) in [(4.0, 0), (3.9, all), (f32::NAN, all)] {
        let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
        bench.range_max = range_max;
        bench.revolve_times(4);
        assert_eq!(bench.counts(), (0, unknown), "{range_max}");
    }
}

#[test]
fn what_is_too_near_to_be_measured_is_at_the_lidar() {
    let mut bench = Bench::new(rules(), &lidar(0.41, 0.0));
    bench.spoils = Box::new(|ranges| ranges[3] = f32::NEG_INFINITY);
    bench.revolve_times(3);
    let (sensed, unknown) = bench.found();
    assert!(unknown.is_empty() && sensed.len() >= SECTORS);
    assert!(sensed.iter().all(|hit| hit.at.distance(Point { x: 0.41, y: 0.0 }) < 0.03), "{sensed:?}");
}

#[test]
fn the_robot_s_own_motion_is_taken_out() {
    // A column stands still; the robot drives a curve, and the lidar looks to its left.
    let column = |_: f64| (Point { x: 3.0, y: 0.4 }, 0.2);
    for omega in [0.0, 0.8, -0.8] {
        let mut bench = Bench::new(rules(), &lidar(0.3, TAU / 4.0));
        bench.things.push(&column);
        bench.velocity = Twist { vx: 0.7, vy: 0.0, omega };
        for _ in 0..18 {
            bench.revolve();
            let middle = bench.robot.inverse() * Point { x: 3.0, y: 0.4 };
            for hit in bench.found().0 {
                assert!((hit.at.distance(middle) - 0.2).abs() < 0.03, "{omega}: {hit:?}, column at {middle:?}");
                assert!(!hit.approaches && !hit.moves, "{omega}: {hit:?}");
            }
        }
        assert!(bench.counts().0 > 3, "{omega}");
    }
}

#[test]
fn who_comes_nearer_approaches() {
    for (speed, robot, expected) in
        [(0.0, 0.0, false), (0.0, 0.8, false), (0.15, 0.0, false), (0.6, 0.0, true), (1.6, 0.0, true), (1.0, 0.6, true)]
    {
        // Someone at 3.5 m comes to the robot, past a wall behind.
        let person = move |at: f64| (Point { x: 3.8 - speed * (at - 1.0), y: 0.1 }, 0.08);
        let wall = |_: f64| (Point { x: 103.0, y: 0.0 }, 98.5);
        let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
        bench.velocity = Twist { vx: robot, ..Twist::default() };
        bench.things.extend([&person as Round<'_>, &wall]);
        let mut approaches = 0;
        for _ in 0..8 {
            bench.revolve();
            approaches += bench.found().0.iter().filter(|hit| hit.approaches).count();
        }
        assert_eq!(approaches > 0, expected, "{speed} {robot}: {approaches}");
    }
}

#[test]
fn who_walks_across_comes_to_places_that_were_free() {
    for (speed, robot, expected) in
        [(0.0, 0.0, false), (0.0, 0.5, false), (0.1, 0.0, false), (0.7, 0.0, true), (1.6, 0.0, true), (-1.0, 0.5, true)]
    {
        // Someone crosses 1.5 m ahead of the lidar; the wall is 2 m behind, comes into reach, or is too far away.
        for wall in [100.5, 101.8, 200.0] {
            let person = move |at: f64| (Point { x: 1.8, y: speed * (at - 1.4) }, 0.06);
            let wall = move |_: f64| (Point { x: wall, y: 0.0 }, 97.0);
            let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
            bench.velocity = Twist { vx: robot, ..Twist::default() };
            bench.things.extend([&person as Round<'_>, &wall]);
            let mut moves = 0;
            for _ in 0..8 {
                bench.revolve();
                moves += bench.found().0.iter().filter(|hit| hit.moves).count();
            }
            assert_eq!(moves > 0, expected, "{speed} {robot}: {moves}");
        }
    }
}

#[test]
fn nothing_that_can_arrive_does_harm() {
    let mut random = testing::Random::new(5);
    let mut bench = Bench::new(rules(), &lidar(0.3, 0.0));
    let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0, 1e-9, 1.0, 1e300, f64::MIN_POSITIVE, 3.0];
    let mut pick = || odd[random.below(odd.len() as u64) as usize];
    for n in 0..20_000_u64 {
        let scan = DataScan {
            name: "front".into(),
            revolution: (n / 3) as i64,
            status: (n % 5) as i8,
            angle_min: pick(),
            angle_step: pick(),
            beam_time: pick() / 100.0,
            range_min: pick() as f32,
            ranges: (0..n % 50).map(|_| pick() as f32).collect(),
            ..DataScan::default()
        };
        let age = Duration::from_micros((pick().abs() * 1e5).min(1e12) as u64);
        bench.scans.on_scan(Instant::from_millis(1000 + n), age, &scan, &bench.trail);
        assert!(bench.scans.eyes[0].turns.len() <= TURNS_MAX);
    }
    let full = DataScan { name: "front".into(), beam_time: 1e-6, ranges: vec![1.0; 100_000], ..DataScan::default() };
    bench.scans.on_scan(Instant::from_millis(30_000), Duration::ZERO, &full, &bench.trail);
    assert!(bench.scans.eyes[0].turns.iter().all(|turn| turn.hits.len() <= HITS_MAX));
    // What is measured after that frees nothing.
    let at = Instant::from_millis(31_000);
    let more =
        DataScan { angle_step: 0.0, angle_min: 1.0, ranges: vec![f32::INFINITY; 10], range_max: 9.0, ..full.clone() };
    for _ in 0..2 {
        bench.scans.on_scan(at, Duration::ZERO, &full, &bench.trail);
    }
    bench.scans.on_scan(at, Duration::ZERO, &more, &bench.trail);
    let measured = bench.scans.eyes[0].slices.iter().filter(|slice| slice.at == at).count();
    assert!(measured <= 1, "{measured}: that of the full revolution alone");
    let stranger = DataScan { name: "rear".into(), ..full };
    assert_eq!(bench.scans.on_scan(Instant::from_millis(30_000), Duration::ZERO, &stranger, &bench.trail), None);
}

#[test]
fn a_view_of_an_arc_answers_as_the_whole_one() {
    let mut state = 7_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut narrow = 0;
    for n in 0..400 {
        let here = Point { x: random() - 0.5, y: random() - 0.5 };
        let hit = |distance: f64, angle: f64| {
            let (sin, cos) = libm::sincos(angle);
            Point { x: here.x + distance * cos, y: here.y + distance * sin }
        };
        let hits: Vec<Hit> = (0..300)
            .map(|turns| (hit(4.0 * random(), TAU * random()), turns % 3))
            .chain([(here, 1)])
            .map(|(at, turns)| Hit { at, when: Instant::ZERO, turns, approaches: false, moves: false, slice: 0 })
            .collect();
        // A sector; every tenth one at the lidar, which has directions all around.
        let (first, nearest) = (TAU * random(), if n % 10 == 0 { 0.0 } else { 0.6 });
        let met: Vec<Met> = (0..50)
            .map(|k| {
                let at = hit(nearest + 3.0 * random(), first + f64::from(k) * 0.014);
                let (bin, distance) = seen_from(here, at);
                self::met(at, bin, distance)
            })
            .collect();
        let same = 0.21;
        let arc = Arc::around(&met, same);
        narrow += usize::from(arc.half.is_some());
        let whole = View::new(here, hits.iter(), &Arc { middle: (1.0, 0.0), half: None });
        let part = View::new(here, hits.iter(), &arc);
        for Met { bin, distance, .. } in met {
            assert_eq!(part.turns(bin, distance, same), whole.turns(bin, distance, same));
            assert_eq!(part.nearest(bin), whole.nearest(bin));
        }
    }
    assert!((300..400).contains(&narrow), "{narrow}");
}
