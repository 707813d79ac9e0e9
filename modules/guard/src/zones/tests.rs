use super::*;
use crate::config::Settings;
use kinematics::reach::{Ackermann, Base, Kinematics, Motion};
use settings::Section;
use surroundings::{Lidar, Sonar};
use testing::Random;

/// A base that can do all.
const BASE: Base =
    Base { curves: Ackermann { wheelbase: 0.6, steering: 0.61, steering_rate: 0.7 }, turns: true, sideways: true };
/// What is permitted without fields of the configuration: more than they do.
const FREE: Bound = Bound { speed: 1.0, free: [f64::INFINITY; 2], cause: None };
/// Distance of the farthest corner, m.
const RADIUS: f64 = 0.8;
/// Right of the robot, which is 0.6 m wide.
const RIGHT: [[f64; 2]; 4] = [[0.0, -1.0], [0.8, -1.0], [0.8, -0.3], [0.0, -0.3]];

fn config(fields: Vec<FieldKeys>) -> Config {
    let corner = |(x, y)| Point { x, y };
    Config {
        settings: Settings { ranging: Ranging::SonarAndLidar, fields, ..Settings::usual() },
        footprint: [(-0.15, -0.3), (0.75, -0.3), (0.75, 0.3), (-0.15, 0.3)].map(corner).into(),
        sonars: Vec::new(),
        lidars: Vec::new(),
        base: BASE,
        braking: 0.8,
        power_lost: 0.8,
        speed: 1.2,
    }
}

fn field(kind: FieldKind, from: f64, polygon: &[[f64; 2]]) -> FieldKeys {
    FieldKeys { kind, from, polygon: polygon.to_vec() }
}

fn zones(fields: Vec<FieldKeys>) -> Zones {
    let config = config(fields);
    Zones::new(&config, &Polygon::hull(&config.footprint).expect("a body"))
}

fn at(x: f64, y: f64) -> Obstacle {
    Obstacle { at: Point { x, y }, source: Source::Sonar(2), sensed: true, approaches: false, moves: false }
}

fn line(from: (f64, f64), to: (f64, f64), half: f64) -> Unseen {
    let point = |(x, y)| Point { x, y };
    Unseen { from: point(from), to: point(to), half, source: Source::Lidar(0) }
}

/// Bounds of all directions.
fn lowered(zones: &Zones, bound: Bound) -> [Bound; 6] {
    Direction::ALL.map(|direction| {
        let mut paths = Vec::new();
        BASE.reachable(direction, &Motion::default(), 0.12, &mut paths);
        zones.lowered(bound, direction, &paths, RADIUS)
    })
}

fn speeds(zones: &Zones) -> [f64; 6] {
    lowered(zones, FREE).map(|bound| bound.speed)
}

#[test]
fn with_something_in_a_protective_field_the_robot_moves_away_from_it_only_and_slowly() {
    let mut zones = zones(vec![field(FieldKind::Protective, 0.0, &RIGHT)]);
    zones.update(&[at(0.4, -1.2), at(1.0, 0.0)], &[]);
    assert_eq!(speeds(&zones), [1.0; 6], "nothing is in it");
    zones.update(&[at(0.4, -0.6)], &[]);
    // Forward and backward it would pass it.
    assert_eq!(speeds(&zones), [0.0, 0.0, 0.3, 0.0, 0.3 / RADIUS, 0.0]);
    let [forward, _, left, ..] = lowered(&zones, FREE).map(|bound| bound.cause);
    assert_eq!((forward, left), (Some(Cause::Stops(Source::Sonar(2))), Some(Cause::Slows(Source::Sonar(2)))));
    zones.update(&[at(0.4, -0.6), at(0.85, -0.35)], &[]);
    assert_eq!(speeds(&zones), [0.0; 6], "one beside it, and one before its corner: no motion leaves both");
}

#[test]
fn unknown_is_not_free_in_a_field_either_wherever_it_begins() {
    let beyond = [[0.0, -1.6], [0.8, -1.6], [0.8, -1.2], [0.0, -1.2]];
    for polygon in [RIGHT, beyond] {
        let mut zones = zones(vec![field(FieldKind::Protective, 0.0, &polygon)]);
        let unknown = [
            line((0.4, -0.32), (0.4, -2.5), 0.01),
            // Through it, from one side to the other.
            line((-1.0, polygon[0][1] + 0.2), (2.0, polygon[0][1] + 0.2), 0.01),
            // Beside it, by less than its width.
            line((0.85, -0.32), (0.85, -2.5), 0.06),
            // It ends there.
            line((-1.0, polygon[0][1] + 0.2), (-0.02, polygon[0][1] + 0.2), 0.05),
        ];
        for part in unknown {
            zones.update(&[], &[part]);
            let [forward, ..] = lowered(&zones, FREE);
            assert_eq!((forward.speed, forward.cause), (0.0, Some(Cause::Unknown(Source::Lidar(0)))), "{part:?}");
        }
        zones.update(&[], &[line((0.85, -0.32), (0.85, -2.5), 0.04), line((0.4, 0.32), (0.4, 2.5), 0.1)]);
        assert_eq!(speeds(&zones), [1.0; 6], "beside it");
    }
}

#[test]
fn a_field_counts_from_its_speed_on_and_raises_nothing() {
    for (kind, from, forward, left) in [
        (FieldKind::Protective, 0.0, 0.0, 0.3),
        (FieldKind::Protective, 0.02, 0.0, 0.3),
        (FieldKind::Protective, 0.2, 0.2, 0.3),
        (FieldKind::Protective, 0.5, 0.5, 0.5),
        (FieldKind::Protective, 1.5, 1.0, 1.0),
        (FieldKind::Warning, 0.0, 0.3, 1.0),
        (FieldKind::Warning, 0.6, 0.6, 1.0),
    ] {
        let mut zones = zones(vec![field(kind, from, &RIGHT)]);
        zones.update(&[at(0.4, -0.6)], &[]);
        let [ahead, _, aside, ..] = speeds(&zones);
        assert_eq!((ahead, aside), (forward, left), "{kind:?} from {from}");
        let slow = Bound { speed: 0.01, ..FREE };
        assert!(lowered(&zones, slow).iter().all(|bound| bound.speed <= 0.01), "{kind:?} from {from}");
    }
}

/// Number in `from..to`.
fn between(random: &mut Random, from: f64, to: f64) -> f64 {
    from + (to - from) * random.below(1_000_000) as f64 / 1e6
}

/// Corners around a middle, none behind another one.
fn star(random: &mut Random) -> Vec<[f64; 2]> {
    let (x, y) = (between(random, -1.5, 2.0), between(random, -1.5, 1.5));
    let count = 3 + random.below(5);
    let corner = |n: u64| {
        let (sin, cos) = libm::sincos(n as f64 * std::f64::consts::TAU / count as f64);
        let radius = between(random, 0.2, 1.0);
        [x + radius * cos, y + radius * sin]
    };
    (0..count).map(corner).collect()
}

#[test]
fn adding_fields_never_raises_a_bound() {
    let mut random = Random::new(41);
    let mut lower = 0;
    for _ in 0..2000 {
        let fields: Vec<FieldKeys> = (0..1 + random.below(4))
            .map(|_| {
                let kind = if random.below(2) == 0 { FieldKind::Protective } else { FieldKind::Warning };
                let from = if random.below(2) == 0 { 0.0 } else { between(&mut random, 0.0, 1.2) };
                field(kind, from, &star(&mut random))
            })
            .collect();
        let place = |random: &mut Random| (between(random, -3.0, 3.0), between(random, -3.0, 3.0));
        let obstacles: Vec<Obstacle> = (0..random.below(4))
            .map(|_| {
                let (x, y) = place(&mut random);
                at(x, y)
            })
            .collect();
        let unseen: Vec<Unseen> =
            (0..random.below(3)).map(|_| line(place(&mut random), place(&mut random), 0.05)).collect();
        let bound = Bound { speed: between(&mut random, 0.0, 1.2), ..FREE };
        let bounds = |count: usize| {
            let mut zones = zones(fields[..count].to_vec());
            zones.update(&obstacles, &unseen);
            lowered(&zones, bound).map(|bound| bound.speed)
        };
        let all: Vec<[f64; 6]> = (0..=fields.len()).map(bounds).collect();
        assert_eq!(all[0], [bound.speed; 6]);
        for pair in all.windows(2) {
            assert!(pair[0].iter().zip(&pair[1]).all(|(before, after)| after <= before), "{pair:?} {fields:?}");
            lower += usize::from(pair[0] != pair[1]);
        }
    }
    assert!(lower > 500, "{lower}");
}

#[test]
fn the_first_place_of_a_line_within_a_polygon_is_that_of_small_steps() {
    let mut random = Random::new(43);
    let (mut met, mut missed) = (0, 0);
    for _ in 0..4000 {
        let corners = counter_clockwise(&star(&mut random));
        let mut point = || Point { x: between(&mut random, -3.0, 3.0), y: between(&mut random, -3.0, 3.0) };
        let (from, to) = (point(), point());
        let steps = 400;
        let place = |n: u32| {
            let part = f64::from(n) / f64::from(steps);
            Point { x: from.x + part * (to.x - from.x), y: from.y + part * (to.y - from.y) }
        };
        let stepped = (0..=steps).map(place).find(|place| contains(&corners, *place));
        let found = first_within(&corners, from, to, 0.0);
        let Some(found) = found else {
            assert_eq!(stepped, None, "{corners:?} {from:?} {to:?}");
            missed += 1;
            continue;
        };
        let apart = edges(&corners).map(|(a, b)| distance(found, a, b).0).fold(f64::INFINITY, f64::min);
        assert!(apart < 1e-9 || contains(&corners, found), "{found:?} {corners:?}");
        // A corner that is cut off by less than a step is met by no step.
        let before = stepped.map_or(f64::INFINITY, |stepped| from.distance(stepped));
        assert!(from.distance(found) <= before + 1e-9, "{found:?} {stepped:?}");
        met += 1;
    }
    assert!(met > 500 && missed > 500, "{met} {missed}");
}

#[test]
fn a_point_that_is_not_a_place_is_in_every_field_and_cannot_be_left() {
    let mut zones = zones(vec![field(FieldKind::Protective, 0.0, &RIGHT)]);
    for (x, y) in [(f64::NAN, 0.0), (0.0, f64::INFINITY), (1e300, -1e300)] {
        zones.update(&[at(x, y)], &[]);
        assert_eq!(speeds(&zones), [0.0; 6], "{x} {y}");
    }
}

#[test]
fn fields_are_shown_counter_clockwise_while_they_count_or_something_is_in_them() {
    let clockwise: Vec<[f64; 2]> = RIGHT.iter().rev().copied().collect();
    let fields = vec![field(FieldKind::Warning, 0.0, &clockwise), field(FieldKind::Protective, 0.5, &RIGHT)];
    let mut zones = zones(fields);
    let shown = |zones: &Zones, speed| -> Vec<(i8, bool, Vec<f64>)> {
        zones.shown(speed).map(|field| (field.kind, field.occupied, field.x)).collect()
    };
    let x: Vec<f64> = RIGHT.iter().map(|[x, _]| *x).collect();
    assert_eq!(shown(&zones, 0.2).len(), 1);
    let both = shown(&zones, 0.6);
    assert_eq!((both[0].0, both[1].0, both[0].1), (Field::WARNING, Field::PROTECTIVE, false));
    for field in zones.shown(0.6) {
        let corners: Vec<Point> = field.x.iter().zip(&field.y).map(|(x, y)| Point { x: *x, y: *y }).collect();
        assert!(edges(&corners).map(|(a, b)| a.x * b.y - b.x * a.y).sum::<f64>() > 0.0, "{corners:?}");
    }
    assert_eq!(both[1].2, x);
    zones.update(&[at(0.4, -0.6)], &[]);
    assert!(shown(&zones, 0.0).len() == 2 && shown(&zones, 0.0).iter().all(|(_, occupied, _)| *occupied));
}

#[test]
fn without_a_sensor_there_are_no_fields() {
    let mut config = config(vec![field(FieldKind::Protective, 0.0, &RIGHT)]);
    config.settings.ranging = Ranging::None;
    assert!(Zones::new(&config, &Polygon::hull(&config.footprint).expect("a body")).is_empty());
}

#[test]
fn what_no_sensor_looks_at_is_a_part_of_a_field() {
    let ahead = [[0.75, -0.5], [1.75, -0.5], [1.75, 0.5], [0.75, 0.5]];
    let behind = [[-1.0, -0.2], [-0.15, -0.2], [-0.15, 0.2], [-1.0, 0.2]];
    let fields = [ahead, behind].map(|polygon| field(FieldKind::Warning, 0.0, &polygon));
    let mount = navitools::Pose::new(0.75, 0.0, 0.0);
    let lidar = Lidar { name: "front".into(), mount, view: std::f64::consts::PI };
    let seen = Config { lidars: vec![lidar], ..config(fields.to_vec()) };
    let [front, rear] = unwatched(&seen)[..] else { panic!() };
    assert!(front < 0.02 && rear > 0.98, "{front} {rear}");
    let sonar = Sonar { id: 0, at: Point { x: -0.15, y: 0.0 }, theta: std::f64::consts::PI, beam: 1.0 };
    let [front, rear] = unwatched(&Config { sonars: vec![sonar], ..config(fields.to_vec()) })[..] else { panic!() };
    assert!(front > 0.98 && (0.01..0.5).contains(&rear), "{front} {rear}");
}
