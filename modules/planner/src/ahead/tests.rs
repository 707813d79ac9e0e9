//! Speed limits among people that the sonars detect.

use super::*;
use crate::config::{Behaviour, Body, Limits};
use crate::obstacles::Fired;
use crate::ranges::{Measurement, Mount, Sounding};
use crate::search::Abilities;

const LEG: f64 = 0.06;

fn config() -> Config {
    let body = Body { wheelbase: 0.60, front: 0.75, rear: 0.15, width: 0.60, shape: None };
    let limits = Limits {
        speed: 0.8,
        steering: 0.6109,
        steering_rate: 0.698,
        acceleration: 0.5,
        deceleration: 0.8,
        lateral_acceleration: 0.8,
        rotation: f64::INFINITY,
    };
    Config {
        body,
        limits,
        behaviour: Behaviour::default(),
        law: guard::law::Law { reaction: 0.37, braking: 0.8, worst: 0.8, approach: 1.6, slow: 0.3 },
        sonar_beam: 0.96,
        age_max: base::Duration::from_millis(600),
        has_sonars: true,
        abilities: Abilities::default(),
        map: None,
        home: None,
    }
}

/// Readings of sixteen sonars around the body with a person at this point; the robot is at the origin.
fn round(at: Instant, person: Option<Point>) -> Vec<Fired> {
    let sonar = |id: i32| {
        let theta = f64::from(id) * core::f64::consts::TAU / 16.0;
        let (sin, cos) = libm::sincos(theta);
        // On the edge of the body, facing outwards.
        let to_edge = (0.45 / cos.abs()).min(0.30 / sin.abs());
        let (x, y) = (0.30 + to_edge * cos, to_edge * sin);
        let nearest = person.map(|at| (libm::hypot(at.x - x, at.y - y) - LEG, libm::atan2(at.y - y, at.x - x)));
        let within = |&(distance, bearing): &(f64, f64)| {
            navitools::wrap(bearing - theta).abs() < 0.48 && (0.03..2.5).contains(&distance)
        };
        let measurement =
            nearest.filter(within).map_or(Measurement::Silent, |(distance, _)| Measurement::Echo(distance));
        let mount = Mount { at: Point { x, y }, theta, beam: 0.96 };
        let sounding = Sounding { id, at, stamp: at.as_nanos() as i64, mount, measurement };
        Fired { sounding, robot: Pose::default(), speed: 0.0 }
    };
    (0..16).map(sonar).collect()
}

/// Result of `rounds` rounds, four per second, of a person who is at `at` when the last round fires and has walked with
/// `velocity`; and the instant of that round.
fn observe(at: Point, (vx, vy): (f64, f64), rounds: i32) -> (Instant, Obstacles) {
    let (mut obstacles, config) = (Obstacles::new(), config());
    let mut now = Instant::from_millis(10_000);
    for n in (0..rounds).rev() {
        now += Duration::from_millis(250);
        let ago = 0.25 * f64::from(n);
        let there = Point { x: at.x - vx * ago, y: at.y - vy * ago };
        obstacles.update(
            now,
            Pose::default(),
            &round(now, Some(there)),
            |point| config.body.covers(point, 0.0),
            |_| false,
        );
    }
    (now + Duration::from_millis(170), obstacles)
}

/// Straight path, forwards or in reverse.
fn path(forward: bool) -> Vec<Sample> {
    let along = if forward { 0.05 } else { -0.05 };
    let sample = |n: i32| {
        let distance = 0.05 * f64::from(n);
        Sample {
            pose: Pose::new(along * f64::from(n), 0.0, 0.0),
            direction: if forward { Direction::Forward } else { Direction::Backward },
            distance,
            curvature: 0.0,
            narrow: false,
            speed: 0.8,
        }
    };
    (0..60).map(sample).collect()
}

/// Speed allowed by [`person_speed_limit`] on a straight path forwards after a person was detected.
fn allowed(x: f64, y: f64, velocity: (f64, f64), rounds: i32) -> f64 {
    let (now, obstacles) = observe(Point { x, y }, velocity, rounds);
    person_speed_limit(now, &path(true), &obstacles, &config())
}

#[test]
fn without_people_around_the_full_speed_is_allowed() {
    let config = config();
    let mut obstacles = Obstacles::new();
    let now = Instant::from_millis(10_000);
    obstacles.update(now, Pose::default(), &round(now, None), |point| config.body.covers(point, 0.0), |_| false);
    assert_eq!(person_speed_limit(now, &path(true), &obstacles, &config), config.limits.speed);
    assert_eq!(person_speed_limit(now, &[], &obstacles, &config), config.limits.speed, "no way, no meeting");
}

#[test]
fn the_closer_a_person_the_lower_the_speed_down_to_zero() {
    let speeds = [2.2, 1.8, 1.5, 1.2, 0.98].map(|x| allowed(x, 0.0, (0.0, 0.0), 8));
    assert!(speeds.is_sorted_by(|far, near| far >= near), "{speeds:?}");
    assert!(speeds[0] > 0.7 && speeds[3] <= PERSON_BESIDE_SPEED_MPS && speeds[4] == 0.0, "{speeds:?}");
}

#[test]
fn with_a_greater_margin_the_robot_does_not_creep_closer_to_a_person() {
    // 0.55, 0.6 and 0.9 m before the front.
    for (x, greatest) in [(1.30, 0.0), (1.35, 0.0), (1.65, 0.8)] {
        let (now, obstacles) = observe(Point { x, y: 0.0 }, (0.0, 0.0), 12);
        let mut config = config();
        let usual = person_speed_limit(now, &path(true), &obstacles, &config);
        config.behaviour.people_margin = 0.7;
        let greater = person_speed_limit(now, &path(true), &obstacles, &config);
        assert!(usual > 0.0 && greater < usual && greater <= greatest, "{x}: {usual} {greater}");
    }
}

#[test]
fn an_approaching_person_slows_more_than_a_standing_one_and_a_leaving_one_less() {
    let [comes, stands, leaves] = [-1.0, 0.0, 1.0].map(|vx| allowed(2.2, 0.0, (vx, 0.0), 6));
    assert!(comes < 0.6 * stands && stands <= leaves, "{comes} {stands} {leaves}");
}

#[test]
fn a_person_who_was_just_found_is_expected_to_come() {
    for x in [1.8, 2.0, 2.2] {
        let [found, known] = [2, 12].map(|rounds| allowed(x, 0.0, (0.0, 0.0), rounds));
        assert!(found < 0.8 * known, "{x}: {found} {known}");
    }
}

#[test]
fn a_person_who_walks_may_turn_round_however_often_heard() {
    // Away from the robot; a standing one there does not slow it.
    let [walks, stands] = [0.4, 0.0].map(|vx| allowed(2.3, 0.0, (vx, 0.0), 12));
    assert!(walks < 0.8 * stands, "{walks} {stands}");
}

#[test]
fn a_person_about_to_cross_the_path_stops_the_robot_and_one_who_has_crossed_does_not() {
    let crosses = allowed(1.4, 0.7, (0.0, -0.9), 6);
    let crossed = allowed(1.4, 0.7, (0.0, 0.9), 6);
    assert!(crosses < 0.5 && crossed > crosses + 0.2, "{crosses} {crossed}");
}

#[test]
fn a_person_beside_the_path_is_passed_slowly() {
    let beside = allowed(0.4, 0.62, (0.0, 0.0), 8);
    assert!((SPEED_MIN_MPS..=PERSON_BESIDE_SPEED_MPS).contains(&beside), "{beside}");
}

#[test]
fn a_person_behind_does_not_slow_forward_motion() {
    let (now, obstacles) = observe(Point { x: -0.65, y: 0.0 }, (0.0, 0.0), 8);
    let config = config();
    assert_eq!(person_speed_limit(now, &path(true), &obstacles, &config), config.limits.speed);
    assert!(person_speed_limit(now, &path(false), &obstacles, &config) < 0.3);
}
