//! How people walk, give way, and touch the robot.

use super::*;
use crate::world::{Segment, Walker};

const OUTLINE: (f64, f64, f64) = (-0.15, 0.75, 0.30);

fn hall(count: u32) -> World {
    let mut world = World::hall(20.0, 12.0);
    let point = |x, y| Point { x, y };
    world.walls.extend([Segment { a: point(6.0, 0.0), b: point(6.0, 8.0) }]);
    world.places = vec![point(2.0, 2.0), point(18.0, 10.0), point(10.0, 1.0), point(3.0, 11.0), point(15.0, 3.0)];
    world.people = Crowd { count, ..Crowd::default() };
    world
}

fn standing(pose: Pose) -> Hull {
    Hull::new(pose, OUTLINE, Twist::ZERO)
}

/// Where everybody is at the end of each step.
fn walk(world: &World, seed: u64, steps: u64, robot: &Hull) -> (People, Vec<Vec<Point>>) {
    let mut people = People::new(world, seed, robot);
    let mut seen = Vec::new();
    for step in 1..=steps {
        people.step(world, robot);
        seen.push(people.at(step * NS).map(|(at, _)| at).collect());
    }
    (people, seen)
}

#[test]
fn they_go_to_places_at_their_pace_and_through_no_wall_nor_robot() {
    let world = hall(20);
    let robot = standing(Pose::new(10.0, 6.0, 0.0));
    let (people, seen) = walk(&world, 1, 6000, &robot);
    assert_eq!(people.count(), 20);
    let mut visits = vec![0; world.places.len()];
    let (mut way, mut moving, mut near) = (0.0, 0.0, f64::INFINITY);
    for pair in seen.windows(2) {
        for (number, (old, new)) in pair[0].iter().zip(&pair[1]).enumerate() {
            let step = old.distance(*new);
            assert!(step < FASTEST * DT, "{step}");
            way += step;
            moving += if step > 0.03 { DT } else { 0.0 };
            let person = &people.persons[number];
            near = near.min(robot.gap(*new).gap - person.radius);
            let wall = world.ray(*old, unit((new.x - old.x, new.y - old.y)), step);
            assert!(wall.is_none() && new.x > 0.0 && new.x < 20.0 && new.y > 0.0 && new.y < 12.0, "{new:?}");
            for (place, visits) in world.places.iter().zip(&mut visits) {
                *visits += u32::from(new.distance(*place) < 1.0 && old.distance(*place) >= 1.0);
            }
        }
    }
    let pace = way / moving;
    assert!((0.6..1.6).contains(&pace), "{pace} m/s");
    assert!(visits.iter().all(|visits| *visits > 30), "{visits:?} in ten minutes");
    assert!(near > 0.0, "{near}");
}

#[test]
fn they_hardly_ever_walk_into_each_other() {
    let world = hall(20);
    let (people, seen) = walk(&world, 2, 6000, &standing(Pose::new(10.0, 6.0, 0.0)));
    let (mut close, mut all) = (0u32, 0u32);
    for at in &seen {
        for (n, one) in at.iter().enumerate() {
            for (m, other) in at.iter().enumerate().skip(n + 1) {
                let gap = one.distance(*other) - people.persons[n].radius - people.persons[m].radius;
                close += u32::from(gap < -0.1);
                all += 1;
            }
        }
    }
    assert!(f64::from(close) < 1e-3 * f64::from(all), "{close} of {all}");
}

#[test]
fn groups_stay_together() {
    let mut world = hall(12);
    world.people.grouped = 1.0;
    let (people, seen) = walk(&world, 3, 3000, &standing(Pose::new(10.0, 6.0, 0.0)));
    let members = people.persons.iter().enumerate();
    let members: Vec<_> = members
        .filter_map(
            |(number, person)| if let Goal::Group(first, _) = person.goal { Some((number, first)) } else { None },
        )
        .collect();
    assert!(members.len() >= 6, "{members:?}");
    let together = |at: &Vec<Point>| members.iter().filter(|(n, first)| at[*n].distance(at[*first]) < 2.5).count();
    let share =
        seen[600..].iter().map(together).sum::<usize>() as f64 / (seen.len() - 600) as f64 / members.len() as f64;
    assert!(share > 0.8, "{share}");
}

#[test]
fn the_same_seed_is_the_same_crowd_and_the_past_does_not_change() {
    let world = hall(20);
    let robot = standing(Pose::new(10.0, 6.0, 0.0));
    let (mut people, seen) = walk(&world, 4, 200, &robot);
    assert!(seen == walk(&world, 4, 200, &robot).1 && seen != walk(&world, 5, 200, &robot).1);
    let moment = 200 * NS - NS / 3;
    let asked: Vec<_> = people.at(moment).map(|(at, _)| at).collect();
    let legs: Vec<_> = people.legs(moment, Point { x: 10.0, y: 6.0 }, 30.0).collect();
    for _ in 0..MEMORY - 2 {
        people.step(&world, &robot);
    }
    assert_eq!(people.at(moment).map(|(at, _)| at).collect::<Vec<_>>(), asked);
    assert_eq!(people.legs(moment, Point { x: 10.0, y: 6.0 }, 30.0).collect::<Vec<_>>(), legs);
    for (legs, at) in legs.iter().zip(&asked) {
        let apart = legs[0].distance(legs[1]);
        assert!(apart > 0.15 && apart < 0.6 && legs[0].distance(*at) < 0.3, "{legs:?} {at:?}");
    }
}

/// One person at a point, who walks to the right or stands.
fn one(at: Point, velocity: (f64, f64)) -> People {
    let mut world = World::hall(20.0, 12.0);
    world.people.count = 1;
    let mut people = People::new(&world, 1, &standing(Pose::new(1.0, 1.0, 0.0)));
    let person = &mut people.persons[0];
    (person.at, person.velocity, person.radius) = (at, velocity, 0.2);
    let to = Point { x: at.x + velocity.0 * DT, y: at.y + velocity.1 * DT };
    people.tracks[0][0] = Track { from: at, to, legs: [person.legs; 2], gone: 1.0 };
    people
}

#[test]
fn a_contact_says_who_moved() {
    let mut contacts = Vec::new();
    // The robot's front is at 10.75; it comes at 0.5 m/s to somebody who stands there.
    let robot = Hull::new(Pose::new(10.0, 6.0, 0.0), OUTLINE, Twist::new(0.5, 0.0, 0.0));
    let mut people = one(Point { x: 10.951, y: 6.0 }, (0.0, 0.0));
    assert!(people.meet(0, &robot, &mut contacts), "he is in its way");
    let [contact] = contacts[..] else { panic!("{contacts:?}") };
    let stands = Touched { number: 0, towards_mps: 0.0, speed_mps: 0.0 };
    assert_eq!((contact.mover, contact.person, contact.robot_mps), (Mover::Robot, Some(stands), 0.5));
    assert!(people.meet(NS / 20, &robot, &mut contacts) && contacts.len() == 1, "once");
    // It stands, and somebody walks into its side.
    contacts.clear();
    let robot = standing(Pose::new(10.0, 6.0, 0.0));
    let mut people = one(Point { x: 10.3, y: 5.4 }, (0.0, 1.2));
    let mut moment = 0;
    while contacts.is_empty() {
        moment += NS / 20;
        assert!(!people.meet(moment, &robot, &mut contacts), "he is not in the way of one that stands");
    }
    let [contact] = contacts[..] else { panic!("{contacts:?}") };
    assert_eq!((contact.mover, contact.robot_mps), (Mover::Person, 0.0));
    assert!(
        (contact.person.unwrap().towards_mps - 1.2).abs() < 1e-9 && (contact.at.y - 5.5).abs() < 0.007,
        "{contact}"
    );
    // He stops there, and steps back.
    assert_eq!(people.at(NS).next().unwrap().0, contact.at);
    let world = World::hall(20.0, 12.0);
    for _ in 0..20 {
        people.step(&world, &robot);
    }
    assert!(people.clearance(people.step * NS, &robot) > 0.1);
    // Somebody stands beside its tail, and that swings out as it turns at its rear axle.
    contacts.clear();
    let turning = Hull::new(Pose::new(10.0, 6.0, 0.0), OUTLINE, Twist::new(0.0, 0.0, 0.5));
    let mut people = one(Point { x: 10.7, y: 6.501 }, (0.0, 0.0));
    assert!(people.meet(0, &turning, &mut contacts));
    assert!(contacts[0].mover == Mover::Robot && (contacts[0].robot_mps - 0.35).abs() < 1e-9, "{contacts:?}");
}

/// The contacts of a robot that drives up and down a line through the hall for ten minutes and stops for nobody, among
/// twenty who look where they go.
fn run_down(speed: f64) -> Vec<Contact> {
    let mut world = hall(20);
    world.people.attentive = 1.0;
    let mut contacts = Vec::new();
    // Front first.
    let pose = |time: f64| {
        let leg = 6.0 / speed;
        let (lap, part) = (libm::floor(time / leg) as u64, speed * (time % leg));
        if lap.is_multiple_of(2) {
            Pose::new(9.0 + part, 7.0, 0.0)
        } else {
            Pose::new(15.0 - part, 7.0, core::f64::consts::PI)
        }
    };
    let hull = |time| Hull::new(pose(time), OUTLINE, Twist::new(speed, 0.0, 0.0));
    let mut people = People::new(&world, 6, &hull(0.0));
    for step in 1..=120_000u64 {
        let time = step as f64 * 0.005;
        if step.is_multiple_of(20) {
            people.step(&world, &hull(time));
        }
        people.meet(step * 5_000_000, &hull(time), &mut contacts);
    }
    contacts
}

#[test]
fn those_who_look_step_aside_for_a_robot_that_comes_slowly() {
    let contacts = run_down(0.3);
    assert!(contacts.len() <= 1, "it stops for nobody: {contacts:?}");
}

#[test]
fn those_who_look_see_a_robot_that_comes_fast_in_time() {
    let contacts = run_down(0.8);
    assert!(contacts.len() <= 3, "eight, if they saw it by distance alone: {contacts:?}");
}

#[test]
fn a_walker_goes_to_and_fro_and_one_with_one_point_stands() {
    let mut world = hall(0);
    let [a, b, c] = [(12.0, 2.0), (18.0, 2.0), (3.0, 3.0)].map(|(x, y)| Point { x, y });
    world.walkers = vec![Walker { points: vec![a, b] }, Walker { points: vec![c] }];
    world.check().unwrap();
    let robot = standing(Pose::new(10.0, 6.0, 0.0));
    let (people, seen) = walk(&world, 1, 600, &robot);
    assert_eq!(people.count(), 2);
    let mut ends = vec![];
    for at in &seen {
        for (name, end) in [('a', a), ('b', b)] {
            if at[0].distance(end) < 0.5 && ends.last() != Some(&name) {
                ends.push(name);
            }
        }
        assert!((at[0].y - 2.0).abs() < 1.0, "{:?} is far from his way", at[0]);
        assert!(at[1].distance(c) < 0.05, "{:?} does not stand", at[1]);
    }
    assert!(ends.starts_with(&['a', 'b', 'a', 'b', 'a']), "{ends:?} in a minute");
}

#[test]
fn walkers_change_nothing_for_visitors_of_the_same_seed_at_first_and_none_begins_in_the_robot() {
    let robot = standing(Pose::new(10.0, 6.0, 0.0));
    let mut world = hall(5);
    let alone = People::new(&world, 1, &robot).at(0).collect::<Vec<_>>();
    world.walkers = vec![Walker { points: vec![Point { x: 10.2, y: 6.0 }] }];
    let with = People::new(&world, 1, &robot).at(0).collect::<Vec<_>>();
    assert_eq!(alone, with);
    assert!(World { walkers: vec![Walker::default()], ..World::hall(20.0, 12.0) }.check().is_err(), "no point");
    assert!(world.check().is_err(), "he begins where the robot starts");
}
