//! The bounds against a simulation of the stop in small steps, over random fields, for three kinds of base.

use super::*;
use crate::config::Ranging;
use crate::config::Settings;
use kinematics::reach::{Ackermann, Table};
use settings::Section;
use surroundings::Sonar;
use testing::Random;

const BASE: Ackermann = Ackermann { wheelbase: 0.6, steering: 0.61, steering_rate: 0.7 };

fn sensor(id: i32, x: f64, y: f64, degrees: f64) -> Sonar {
    Sonar { id, at: Point { x, y }, theta: degrees.to_radians(), beam: 0.96 }
}

fn config() -> Config {
    let corner = |(x, y)| Point { x, y };
    let front = [(0, 0.28, 60.0), (1, 0.15, 25.0), (2, 0.0, 0.0), (3, -0.15, -25.0), (4, -0.28, -60.0)];
    let rear = [(5, 0.15, 155.0), (6, 0.0, 180.0), (7, -0.15, -155.0)];
    let front = front.map(|(id, y, degrees)| sensor(id, 0.75, y, degrees));
    let rear = rear.map(|(id, y, degrees)| sensor(id, -0.15, y, degrees));
    Config {
        settings: Settings { ranging: Ranging::Sonar, ..Settings::usual() },
        footprint: [(-0.15, -0.3), (0.75, -0.3), (0.75, 0.3), (-0.15, 0.3)].map(corner).into(),
        sonars: front.into_iter().chain(rear).collect(),
        lidars: Vec::new(),
        base: BASE.into(),
        braking: 0.8,
        power_lost: 0.25,
        speed: 1.2,
    }
}

fn at(x: f64, y: f64) -> Obstacle {
    Obstacle { at: Point { x, y }, source: Source::Sonar(2), sensed: true, approaches: true, moves: false }
}

/// Within the robot itself, without any margin.
fn touches(point: Point) -> bool {
    (-0.15..=0.75).contains(&point.x) && (-0.3..=0.3).contains(&point.y)
}

/// Number in `from..to`.
fn between(random: &mut Random, from: f64, to: f64) -> f64 {
    from + (to - from) * random.below(1_000_000) as f64 / 1e6
}

/// Obstacles around the robot, not in it.
fn obstacles(random: &mut Random) -> Vec<Obstacle> {
    let count = 1 + random.below(6);
    let place = |_| at(between(random, -2.0, 3.0), between(random, -1.5, 1.5));
    (0..count).map(place).filter(|obstacle| !touches(obstacle.at)).collect()
}

/// Drives a path of a length in small steps; true if the robot touches an obstacle.
fn hits(path: Twist, length: f64, obstacles: &[Obstacle]) -> bool {
    let steps = (length / 0.004).ceil().max(1.0);
    let (mut x, mut y, mut theta) = (0.0, 0.0, 0.0);
    let step = length / steps;
    for _ in 0..steps as u32 {
        // The middle of the step's rotation: exact to the third order.
        let (sin, cos) = libm::sincos(theta + path.omega * step / 2.0);
        x += step * (path.vx * cos - path.vy * sin);
        y += step * (path.vx * sin + path.vy * cos);
        theta += path.omega * step;
        let (sin, cos) = libm::sincos(theta);
        let seen = |at: Point| Point { x: cos * (at.x - x) + sin * (at.y - y), y: cos * (at.y - y) - sin * (at.x - x) };
        if obstacles.iter().any(|obstacle| touches(seen(obstacle.at))) {
            return true;
        }
    }
    false
}

/// Length until the robot stands, m: reaction and the worst braking.
fn stop(speed: f64, law: &Law) -> f64 {
    speed * law.reaction + speed * speed / (2.0 * law.worst)
}

#[test]
fn no_permitted_speed_reaches_an_obstacle_on_any_steering_within_reach() {
    let mut random = Random::new(21);
    let mut fields = Fields::new(&config(), BASE).expect("a body");
    let law = *fields.law();
    let (mut bounded, mut free) = (0, 0);
    for _ in 0..6000 {
        let obstacles = obstacles(&mut random);
        let motion = Motion { steering: between(&mut random, -0.61, 0.61), ..Motion::default() };
        for (direction, sign) in [(Direction::Forward, 1.0), (Direction::Backward, -1.0)] {
            let bound = fields.bound(direction, &motion, &obstacles);
            for _ in 0..4 {
                let reach = BASE.steering_rate * config().settings.reaction;
                let angle = (motion.steering + between(&mut random, -reach, reach)).clamp(-0.61, 0.61);
                let path = Twist { vx: sign, vy: 0.0, omega: sign * libm::tan(angle) / 0.6 };
                assert!(
                    !hits(path, stop(bound.speed, &law), &obstacles),
                    "{direction:?} {bound:?}, steering {angle}, {obstacles:?}"
                );
            }
            if bound.speed < 0.5 { bounded += 1 } else { free += 1 }
        }
    }
    assert!(bounded > 1000 && free > 1000, "{bounded} {free}: the fields are neither empty nor full");
}

#[test]
fn no_permitted_speed_of_a_base_that_moves_in_any_direction_reaches_an_obstacle() {
    let unit = |vx: f64, vy: f64, omega: f64| Twist { vx, vy, omega };
    let lanes = |vx: f64, vy: f64| [0.0, -0.4, 0.4].map(|omega| unit(vx, vy, omega)).to_vec();
    let paths = [
        lanes(1.0, 0.0),
        lanes(-1.0, 0.0),
        lanes(0.0, 1.0),
        lanes(0.0, -1.0),
        vec![unit(0.0, 0.0, 1.0)],
        vec![unit(0.0, 0.0, -1.0)],
    ];
    let table = Table { paths };
    let mut random = Random::new(5);
    let mut fields = Fields::new(&config(), table.clone()).expect("a body");
    let law = *fields.law();
    // Distance of the farthest corner: speeds on the spot are those of that corner.
    let radius = libm::hypot(0.75, 0.3);
    let mut bounded = [0; 6];
    for _ in 0..3000 {
        let obstacles = obstacles(&mut random);
        for direction in Direction::ALL {
            let bound = fields.bound(direction, &Motion::default(), &obstacles);
            for path in &table.paths[direction as usize] {
                let length =
                    if direction.turns() { stop(bound.speed * radius, &law) / radius } else { stop(bound.speed, &law) };
                assert!(!hits(*path, length, &obstacles), "{direction:?} {bound:?}, {path:?}, {obstacles:?}");
            }
            bounded[direction as usize] += u32::from(bound.speed < 0.3);
        }
    }
    assert!(bounded.iter().all(|count| *count > 200), "{bounded:?}");
}

/// Bounds of all obstacles and of those within the area are the same, as far as a field reaches.
#[test]
fn what_is_outside_of_the_swept_area_bounds_nothing() {
    let mut random = Random::new(23);
    // The unit of a path is 1 m, on the spot 1 rad.
    let path = |random: &mut Random, direction: Direction| {
        let (sin, cos) = libm::sincos(between(random, -3.1, 3.1));
        let turn = between(random, -1.5, 1.5);
        if direction.turns() {
            Twist { vx: 0.0, vy: 0.0, omega: turn.signum() }
        } else {
            Twist { vx: cos, vy: sin, omega: turn }
        }
    };
    let mut left_out = 0;
    for round in 0..4000 {
        let steering = between(&mut random, -0.6, 0.6);
        let motion = Motion { velocity: BASE.velocity(between(&mut random, -0.3, 1.0), steering), steering };
        let obstacles: Vec<Obstacle> =
            (0..3).map(|_| at(between(&mut random, -4.0, 4.0), between(&mut random, -4.0, 4.0))).collect();
        let paths = Direction::ALL.map(|direction| [(); 2].map(|()| path(&mut random, direction)).to_vec());
        let (base, direction) = (Table { paths }, Direction::ALL[round % 6]);
        let (mut steered, mut any) =
            (Fields::new(&config(), BASE).expect("an area"), Fields::new(&config(), base).expect("an area"));
        left_out += same(&mut steered, direction, &motion, &obstacles) + same(&mut any, direction, &motion, &obstacles);
    }
    assert!(left_out > 4000, "{left_out} of 24000 are left out");
}

/// Number of obstacles that are left out without effect.
fn same<K: Kinematics>(fields: &mut Fields<K>, direction: Direction, motion: &Motion, obstacles: &[Obstacle]) -> usize {
    let mut paths = Vec::new();
    fields.base.reachable(direction, motion, fields.reaction, &mut paths);
    if paths.is_empty() {
        return 0;
    }
    let whole = fields.bound_on(direction, &paths, obstacles, &mut Search::default());
    let bound = fields.bound(direction, motion, obstacles);
    assert_eq!(bound.speed, whole.speed, "{direction:?} {motion:?} {obstacles:?}");
    for (free, whole) in bound.free.into_iter().zip(whole.free) {
        let reach = fields.reach[direction as usize];
        assert_eq!(free.min(reach), whole.min(reach), "as far as a field reaches");
    }
    obstacles.len() - fields.buffers.within.len()
}

/// Protective bound of all outlines, all paths and all obstacles, none of them left out: speed, m/s, free path, and
/// number of the obstacle that ends it.
fn in_full<K: Kinematics>(
    fields: &Fields<K>,
    direction: Direction,
    paths: &[Twist],
    seen: &[Obstacle],
) -> (f64, Nearest) {
    let scale = if direction.turns() { fields.radius } else { 1.0 };
    let outlines = fields.outlines[direction as usize].iter().zip(BESIDE);
    let nearest = outlines.map(|(outline, (_, most, within))| {
        let mut nearest = (f64::INFINITY, None);
        for path in paths {
            for (n, obstacle) in seen.iter().enumerate() {
                let free = fields.free(outline, *path, obstacle.at, fields.see(outline, within, obstacle.at));
                nearest = if free < nearest.0 { (free, Some(n)) } else { nearest };
            }
        }
        (fields.law.stops_within((nearest.0 * scale).min(fields.reach[direction as usize])).min(most), nearest)
    });
    let nearest: Vec<(f64, Nearest)> = nearest.collect();
    (nearest.iter().fold(0.0, |most, (speed, _)| f64::max(most, *speed)), nearest[0].1)
}

#[test]
fn what_is_left_out_of_the_search_changes_nothing() {
    let mut random = Random::new(31);
    let (mut bounded, mut touching, mut equal) = (0, 0, 0);
    for _ in 0..4000 {
        let steering = if random.below(4) == 0 { 0.0 } else { between(&mut random, -0.61, 0.61) };
        let motion = Motion { steering, ..Motion::default() };
        let reach = if random.below(2) == 0 { 0.6 } else { 3.0 };
        let place = |n| Obstacle {
            source: Source::Sonar(n),
            approaches: n % 3 == 0,
            moves: false,
            ..at(between(&mut random, -reach, reach), between(&mut random, -1.0, 1.0))
        };
        let mut seen: Vec<Obstacle> = (0..12).map(place).collect();
        // Two sensors that measure the same, and two that are each other's mirror image.
        let (first, second) = (seen[0], seen[1]);
        seen.push(Obstacle { source: Source::Sonar(20), ..first });
        seen.push(Obstacle { source: Source::Sonar(21), at: Point { x: second.at.x, y: -second.at.y }, ..second });
        let fields = Fields::new(&config(), BASE).expect("a body");
        for direction in [Direction::Forward, Direction::Backward] {
            let mut paths = Vec::new();
            fields.base.reachable(direction, &motion, fields.reaction, &mut paths);
            let (speed, (free, by)) = in_full(&fields, direction, &paths, &seen);
            let search = &mut Search::default();
            let bound = fields.bound_on(direction, &paths, &seen, search);
            let (usual, outline) = (paths[0], &fields.outlines[direction as usize][0]);
            assert_eq!(fields.nearest(outline, Within::Kept, &paths, &seen, f64::INFINITY, search), (free, by));
            assert_eq!(bound.free[0], free);
            let alone =
                |seen: &Obstacle| fields.free(outline, usual, seen.at, fields.see(outline, Within::Kept, seen.at));
            let approaching = seen.iter().filter(|seen| seen.approaches).map(alone);
            assert_eq!(bound.free[1], approaching.fold(f64::INFINITY, f64::min));
            let slows = fields.law.slows_within(bound.free[1]);
            let least = speed.min(slows).min(fields.speed_max);
            assert_eq!(bound.speed, if least < SPEED_MIN { 0.0 } else { least }, "{direction:?} {motion:?} {seen:?}");
            bounded += u32::from(speed < 0.5);
            touching += u32::from(free == 0.0);
            equal += u32::from(seen.iter().filter(|seen| alone(seen) == free).nth(1).is_some());
        }
    }
    assert!(bounded > 1000 && touching > 500 && equal > 200, "{bounded} {touching} {equal}");
}

#[test]
fn an_empty_field_permits_what_the_sensors_reach_and_no_more() {
    let mut fields = Fields::new(&config(), BASE).expect("a body");
    let bound = fields.bound(Direction::Forward, &Motion::default(), &[]);
    // From 1.02 m/s it stands at the end of the reach, even without power.
    assert!((bound.speed - 1.02).abs() < 0.01 && bound.cause.is_none(), "{bound:?}");
    assert_eq!(fields.bound(Direction::Left, &Motion::default(), &[]).speed, 0.0, "it cannot move so");
}

#[test]
fn the_reach_of_a_sensor_counts_from_where_it_sits() {
    let permitted = |x: f64, direction: Direction| {
        let mount = navitools::Pose::new(x, 0.0, 0.0);
        let lidar = surroundings::Lidar { name: "top".into(), mount, view: std::f64::consts::TAU };
        let settings = Settings { ranging: Ranging::Lidar, ..config().settings };
        let mut fields = Fields::new(&Config { settings, lidars: vec![lidar], ..config() }, BASE).expect("a body");
        fields.bound(direction, &Motion::default(), &[]).speed
    };
    let law = *Fields::new(&config(), BASE).expect("a body").law();
    // At the corners, 0.3 m aside, it reaches less far.
    let reach = libm::sqrt(2.5 * 2.5 - 0.09);
    for (x, forward, backward) in
        [(0.75, reach, reach - 0.9), (0.3, reach - 0.45, reach - 0.45), (1.0, 2.5, reach - 1.15)]
    {
        let expected = [forward, backward].map(|free| law.stops_within(free));
        let found = [Direction::Forward, Direction::Backward].map(|direction| permitted(x, direction));
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 0.001), "{x}: {found:?}");
    }
}

#[test]
fn somebody_ahead_slows_first_and_stops_then() {
    let mut fields = Fields::new(&config(), BASE).expect("a body");
    let mut ahead = |x| {
        let bound = fields.bound(Direction::Forward, &Motion::default(), &[at(0.9 + x, 0.1)]);
        ((bound.speed * 100.0).round() / 100.0, bound.cause)
    };
    assert_eq!(ahead(2.0), (0.51, Some(Cause::Slows(Source::Sonar(2)))));
    assert_eq!(ahead(1.0), (0.3, Some(Cause::Slows(Source::Sonar(2)))));
    assert_eq!(ahead(0.2), (0.19, Some(Cause::Stops(Source::Sonar(2)))));
    assert_eq!(ahead(0.0), (0.0, Some(Cause::Stops(Source::Sonar(2)))));
}

#[test]
fn a_corner_that_sticks_out_stops_earlier_and_one_that_is_missing_later() {
    let permitted = |corners: &[(f64, f64)], obstacle: Obstacle| {
        let footprint = corners.iter().map(|&(x, y)| Point { x, y }).collect();
        let mut fields = Fields::new(&Config { footprint, ..config() }, BASE).expect("a body");
        let still = Obstacle { approaches: false, ..obstacle };
        fields.bound(Direction::Forward, &Motion::default(), &[still]).speed
    };
    let rectangle = [(-0.15, -0.3), (0.75, -0.3), (0.75, 0.3), (-0.15, 0.3)];
    // An L, by its hull, and a triangle.
    let ell = [(-0.15, -0.3), (0.75, -0.3), (0.75, 0.1), (1.15, 0.1), (1.15, 0.3), (-0.15, 0.3)];
    let triangle = [(-0.15, -0.3), (0.75, 0.0), (-0.15, 0.3)];
    let law = *Fields::new(&config(), BASE).expect("a body").law();
    let [of_rectangle, of_ell] = [&rectangle[..], &ell].map(|corners| permitted(corners, at(1.65, 0.2)));
    assert!(of_ell < of_rectangle - 0.1, "{of_ell} {of_rectangle}");
    assert!(of_ell <= law.stops_within(0.5) + 1e-9, "{of_ell}");
    // Beside the tip.
    let [of_rectangle, of_triangle] = [&rectangle[..], &triangle].map(|corners| permitted(corners, at(1.05, 0.28)));
    assert!(of_rectangle < of_triangle - 0.05, "{of_rectangle} {of_triangle}");
    // Before the tip both stop.
    let [of_rectangle, of_triangle] = [&rectangle[..], &triangle].map(|corners| permitted(corners, at(0.95, 0.0)));
    assert!(of_rectangle < 0.2 && of_triangle < 0.2, "{of_rectangle} {of_triangle}");
}

#[test]
fn what_stands_stops_but_does_not_slow() {
    let mut fields = Fields::new(&config(), BASE).expect("a body");
    let mut standing = |x| {
        let obstacle = Obstacle { approaches: false, ..at(0.9 + x, 0.1) };
        fields.bound(Direction::Forward, &Motion::default(), &[obstacle]).speed
    };
    assert!(standing(1.0) > 0.5 && standing(0.2) < 0.3);
}

#[test]
fn what_is_beside_the_robot_is_passed_but_not_approached() {
    let mut fields = Fields::new(&config(), BASE).expect("a body");
    let mut beside = |y: f64, steering| {
        let motion = Motion { steering, ..Motion::default() };
        fields.bound(Direction::Forward, &motion, &[at(0.5, y)]).speed
    };
    let passed = [0.5, 0.44, 0.37, 0.34].map(|y| beside(y, 0.0));
    assert!(passed[0] > 0.5 && passed[1..] == [0.3, 0.15, 0.1], "the nearer a leg, the slower: {passed:?}");
    assert!(beside(0.31, 0.3) < 0.15, "turning towards it");
    assert!(beside(0.31, -0.3) > 0.5, "turning away from it");
}

#[test]
fn the_robot_gives_way_to_who_walks_beside_it() {
    let mut fields = Fields::new(&config(), BASE).expect("a body");
    let mut beside = |x: f64, y: f64, moves: bool| {
        let obstacle = Obstacle { approaches: false, moves, ..at(x, y) };
        let [ahead, back] = [Direction::Forward, Direction::Backward]
            .map(|direction| fields.bound(direction, &Motion::default(), &[obstacle]));
        let known = [ahead, back].iter().all(|bound| bound.speed > 1.0 || bound.cause.is_some());
        assert!(known, "{x} {y}: {ahead:?} {back:?}");
        [ahead.speed, back.speed]
    };
    for y in [0.5, 0.59] {
        assert_eq!(beside(0.5, y, true), [GIVES_WAY_MPS; 2], "a person may be as near as the leg at {y} m is far");
    }
    let [near, far] = [0.75, 0.95].map(|y| beside(0.5, y, true)[0]);
    assert!(0.2 < near && near < 0.4 && 0.4 < far && far < 0.7, "{near} {far}");
    assert!(beside(0.5, 0.59, false)[0] > 1.0, "what stands there is passed");
    // Who follows is left behind.
    let [ahead, back] = beside(-0.4, 0.1, true);
    assert!(ahead > 1.0 && back <= GIVES_WAY_MPS, "{ahead} {back}");
    assert!(beside(0.5, 2.5, true)[0] > 1.0);
}

#[test]
fn what_is_narrow_is_passed_slowly() {
    let mut fields = Fields::new(&config(), BASE).expect("a body");
    // Two legs, 23 cm ahead of the front.
    let mut gate = |y: f64| {
        let legs = [at(0.98, y), at(0.98, -y)];
        fields.bound(Direction::Forward, &Motion::default(), &legs).speed
    };
    let speeds = [0.8, 0.42, 0.37, 0.2].map(&mut gate);
    let [wide, half, narrow, closed] = speeds;
    assert!(wide > 0.6 && half <= 0.3 && narrow <= 0.15, "{speeds:?}");
    // With the whole clearance both gates would be closed.
    assert!(half > 0.15 && narrow > 0.1 && closed < 0.1, "{speeds:?}");
}

#[test]
fn an_obstacle_that_touches_is_left_but_not_pressed() {
    let mut fields = Fields::new(&config(), BASE).expect("a body");
    let touching = [at(0.74, 0.0)];
    assert_eq!(fields.bound(Direction::Forward, &Motion::default(), &touching).speed, 0.0);
    assert!(fields.bound(Direction::Backward, &Motion::default(), &touching).speed > 0.5);
}

#[test]
fn a_direction_without_sensors_is_blind() {
    let mut config = config();
    config.sonars.retain(|sensor| sensor.at.x > 0.0);
    let mut fields = Fields::new(&config, BASE).expect("a body");
    let bound = fields.bound(Direction::Backward, &Motion::default(), &[]);
    assert_eq!((bound.speed, bound.cause), (0.3, Some(Cause::Blind)));
    assert!(fields.bound(Direction::Forward, &Motion::default(), &[]).speed > 0.5);
    config.settings.ranging = Ranging::None;
    let mut fields = Fields::new(&config, BASE).expect("a body");
    assert_eq!(fields.bound(Direction::Forward, &Motion::default(), &[]).speed, 0.3);
}

#[test]
fn fields_are_drawn_along_the_path() {
    let mut fields = Fields::new(&config(), BASE).expect("a body");
    let motion = Motion { velocity: BASE.velocity(0.6, 0.0), steering: 0.0 };
    let bound = fields.bound(Direction::Forward, &motion, &[at(1.5, 0.0)]);
    let [(protective, occupied), (warning, warned)] = fields.shown(&motion, &bound, Direction::Forward);
    let front = |corners: &[Point]| corners.iter().map(|corner| corner.x).fold(0.0, f64::max);
    assert!((front(&protective) - (0.9 + 0.99)).abs() < 0.01 && (front(&warning) - (0.9 + 2.29)).abs() < 0.01);
    assert!(occupied && warned);
}

#[test]
fn a_point_that_is_not_a_place_counts_as_touching() {
    let mut fields = Fields::new(&config(), BASE).unwrap();
    let bad = [f64::NAN, -f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308, -1e19];
    for (x, y) in bad.into_iter().flat_map(|bad| [(bad, bad), (bad, 0.0), (0.0, bad)]) {
        for (steering, approaches) in [(0.0, true), (0.3, true), (-0.6, false)] {
            let motion = Motion { steering, ..Motion::default() };
            for direction in [Direction::Forward, Direction::Backward] {
                let obstacle = Obstacle { approaches, ..at(x, y) };
                let bound = fields.bound(direction, &motion, &[obstacle]);
                assert_eq!(
                    (bound.speed, bound.cause),
                    (0.0, Some(Cause::Stops(Source::Sonar(2)))),
                    "{x} {y} {steering}"
                );
            }
        }
    }
}
