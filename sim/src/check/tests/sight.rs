//! What a lidar had in sight.

use super::*;
use navitools::{Point, Pose};
use simulator::world::{Column, Segment};

/// Where a person stands that the front of the robot touches, m.
const PERSON: (f64, f64) = (9.8, 0.35);

fn point((x, y): (f64, f64)) -> Point {
    Point { x, y }
}

/// A wall that hides the person until the robot is beside it.
fn screen() -> World {
    World { walls: vec![Segment { a: point((9.6, 0.26)), b: point((9.6, 5.0)) }], ..World::default() }
}

/// A robot with a lidar of this view, rad, that drives for 3 s at 0.5 m/s along x, to x = 9.25 m. The person is where
/// `person` has it at a time before the end, s.
fn drives(
    world: &World,
    view_rad: f64,
    person: impl Fn(f64) -> (f64, f64),
    meanwhile: impl Fn(&mut Bench, f64),
    contact: &str,
) -> (Option<&'static str>, (u64, u64)) {
    let lidar = SeeingLidar { bus: "lidar.top".into(), mount: Pose::new(0.2, 0.0, 0.0), view_rad, reach_m: 6.0 };
    // One that looks backward.
    let rear = SeeingLidar { bus: "lidar.rear".into(), mount: Pose::new(-0.2, 0.0, 3.1), view_rad: 0.2, reach_m: 6.0 };
    let sight = Sight {
        lidars: vec![lidar, rear],
        reaction_s: 0.42,
        braking_mps2: 0.8,
        body: (-0.35, 0.35, 0.25),
        shape: None,
    };
    let mut bench = Bench::with(Limits { sight: Some(sight), promise: None, ..limits() });
    bench.checkers = std::mem::replace(&mut bench.checkers, Checkers::new(limits())).in_world(world);
    bench.act(&["begin", "pad", "0.5"]);
    for n in 0..=60 {
        let left = f64::from(60 - n) * 0.05;
        bench.act(&["say", "pad", "0.5"]);
        (bench.x, bench.speed) = (9.25 - 0.5 * left, 0.5);
        if n % 4 == 0 {
            let (x, y) = person(left);
            let people = simulation::DataPeople { x: vec![x], y: vec![y], radius: vec![0.2], timestamp: 0 };
            bench.sent(bench.simulator, people);
        }
        meanwhile(&mut bench, left);
        bench.pass(50);
    }
    bench.tell(&News::Note { module: "simulator", line: contact });
    let (seen, hidden) = bench.checkers.hits();
    (bench.checkers.violation().map(|violation| violation.rule), (seen.count, hidden.count))
}

fn into_person(contact: &str, world: &World) -> (Option<&'static str>, (u64, u64)) {
    drives(world, 6.3, |_| PERSON, |_, _| {}, contact)
}

const STANDS: &str = "contact: by robot, robot 0.500 m/s, person 0 0.050 of 0.050 m/s, at 9.800 0.350";
const WALL: &str = "contact: by robot, robot 0.500 m/s, wall, at 9.250 0.000";

#[test]
fn who_was_in_sight_for_the_time_to_stop_is_not_hit() {
    let empty = World::default();
    assert_eq!(into_person(STANDS, &empty), (Some("sight"), (1, 0)));
    for (other, counts) in [
        ("contact: by person, robot 0.500 m/s, person 0 0.050 of 0.050 m/s, at 9.800 0.350", (0, 0)),
        ("contact: by robot, robot 0.040 m/s, person 0 0.050 of 0.050 m/s, at 9.800 0.350", (0, 0)),
        // One who walks: counted.
        ("contact: by robot, robot 0.500 m/s, person 0 0.005 of 0.900 m/s, at 9.800 0.350", (1, 0)),
    ] {
        assert_eq!(into_person(other, &empty), (None, counts), "{other}");
    }
    // It stopped just before, having walked up to there.
    let walks = |left: f64| (PERSON.0, PERSON.1 + left);
    assert_eq!(drives(&empty, 6.3, walks, |_, _| {}, STANDS), (None, (1, 0)));
}

#[test]
fn who_comes_out_of_hiding_is_counted_apart() {
    let hidden = (None, (0, 1));
    assert_eq!(into_person(STANDS, &screen()), hidden);
    let column = Column { centre: point((9.5, 0.5)), radius: 0.2 };
    assert_eq!(into_person(STANDS, &World { columns: vec![column], ..World::default() }), hidden);
    // The lidar looks to the other side.
    assert_eq!(drives(&World::default(), 0.2, |_| PERSON, |_, _| {}, STANDS), hidden);
    // It was beyond the reach until 0.8 s before.
    let jumps = |left: f64| if left > 0.8 { (30.0, 0.35) } else { PERSON };
    assert_eq!(drives(&World::default(), 6.3, jumps, |_, _| {}, STANDS), hidden);
}

#[test]
fn a_wall_and_a_column_in_sight_are_not_hit_and_glass_is_not_in_sight() {
    let far = |_| (0.0, 30.0);
    let wall = Segment { a: point((9.6, -3.0)), b: point((9.6, 3.0)) };
    let of_walls = World { walls: vec![wall], ..World::default() };
    let glass = World { glass: vec![wall], ..of_walls.clone() };
    let column = Column { centre: point((9.8, 0.1)), radius: 0.2 };
    let of_columns = World { columns: vec![column], ..World::default() };
    assert_eq!(drives(&of_walls, 6.3, far, |_, _| {}, WALL), (Some("sight"), (1, 0)));
    assert_eq!(drives(&of_columns, 6.3, far, |_, _| {}, WALL), (Some("sight"), (1, 0)));
    assert_eq!(drives(&glass, 6.3, far, |_, _| {}, WALL), (None, (0, 1)));
    // Somebody stands between.
    let between = |left: f64| (9.25 - 0.5 * left + 0.6, 0.0);
    assert_eq!(drives(&of_columns, 6.3, between, |_, _| {}, WALL), (None, (0, 1)));
}

#[test]
fn a_fault_of_the_lidar_excuses_nothing_but_wild_beams() {
    let fault = |fault: &'static str, at: f64, lasts: u64| {
        move |bench: &mut Bench, left: f64| {
            if (left - at).abs() < 0.01 {
                let until = bench.now + Duration::from_millis(lasts);
                bench.tell(&News::Fault { target: "lidar.top", fault, until });
            }
        }
    };
    let with = |meanwhile: &dyn Fn(&mut Bench, f64)| drives(&World::default(), 6.3, |_| PERSON, meanwhile, STANDS).0;
    for name in ["silent", "blind", "stuck", "loss", "garbled", "stall", "reboot"] {
        assert_eq!(with(&fault(name, 0.5, 5000)), Some("sight"), "{name}");
    }
    assert_eq!(with(&fault("false", 0.5, 5000)), None);
    assert_eq!(with(&fault("false", 2.8, 500)), Some("sight"), "over for longer than it takes to stop");
    let other = |target: &'static str| {
        move |bench: &mut Bench, left: f64| {
            fault("false", 0.5, 5000)(bench, left);
            if (left - 0.45).abs() < 0.01 {
                let until = bench.now + Duration::from_secs(1);
                bench.tell(&News::Fault { target, fault: "silent", until });
            }
        }
    };
    assert_eq!(with(&other("lidar.rear")), None, "a fault of another lidar does not end the wild beams");
    assert_eq!(with(&fault("false", 2.8, 5000)), None);
    let ended = |bench: &mut Bench, left: f64| {
        fault("false", 2.8, 5000)(bench, left);
        fault("silent", 2.5, 5000)(bench, left);
    };
    assert_eq!(with(&ended), Some("sight"), "another fault of the same lidar has ended them");
    let driver = |bench: &mut Bench, left: f64| {
        if left == 3.0 {
            bench.start("driver_lidar");
        } else if left == 0.5 {
            bench.act(&["exit", "driver_lidar"]);
        }
    };
    assert_eq!(with(&driver), Some("sight"), "the driver of the lidar");
    assert_eq!(
        with(&|bench, left| if left == 0.5 {
            bench.act(&["exit", "guard"]);
        }),
        None
    );
    let creeps = |bench: &mut Bench, left: f64| {
        if left == 0.5 {
            bench.act(&["creep", "held"]);
        }
    };
    assert_eq!(with(&creeps), None);
}
