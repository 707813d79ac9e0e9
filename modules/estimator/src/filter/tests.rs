//! The filter by itself: late, wild and lasting errors of bearings; a robot that was put elsewhere.

use super::*;
use navitools::Point;

const BEACONS: [(i32, f64, f64); 4] = [(1, 0.1, 0.1), (2, 19.9, 0.1), (3, 19.9, 11.9), (4, 0.1, 11.9)];

fn filter() -> Filter {
    let beacons = BEACONS.iter().map(|(id, x, y)| Beacon { id: *id, at: Point { x: *x, y: *y } }).collect();
    Filter::new(Config { beacons, range: 30.0, ..Config::default() }).unwrap()
}

fn ms(ms: u64) -> Instant {
    Instant::from_millis(ms)
}

/// Straight on from (4, 6) at half a metre a second; its sensor sits where the configuration says.
fn pose(at_ms: u64) -> Pose {
    Pose::new(4.0 + 0.5e-3 * at_ms as f64, 6.0, 0.0)
}

fn bearing(pose: Pose, beacon: usize) -> f64 {
    let (_, x, y) = BEACONS[beacon];
    let sensor = pose * Point { x: 0.25, y: 0.0 };
    wrap(libm::atan2(y - sensor.y, x - sensor.x) - pose.theta.radians())
}

const ON: Motion = Motion { translation: 0.5, rotation: 0.0 };
const SURE: [[f64; 3]; 3] = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]];

/// Drives for so long with all beacons in sight, each once a second.
fn drive(filter: &mut Filter, from_ms: u64, to_ms: u64) {
    for now in (from_ms..=to_ms).step_by(50) {
        let _ = filter.odometry(ms(now), ON);
        if let beacon @ 0..4 = now as usize % 1000 / 50 {
            let _ = filter.bearing(ms(now - 20), BEACONS[beacon].0, bearing(pose(now - 20), beacon));
        }
    }
}

fn off(filter: &mut Filter, at_ms: u64) -> f64 {
    filter.estimate(ms(at_ms)).pose.point().distance(pose(at_ms).point())
}

#[test]
fn it_finds_itself_and_follows() {
    let mut filter = filter();
    assert_eq!(filter.estimate(ms(0)).quality, Quality::Lost);
    drive(&mut filter, 1000, 1400);
    assert_eq!(filter.estimate(ms(1400)).quality, Quality::Searching);
    drive(&mut filter, 1450, 12_000);
    let estimate = filter.estimate(ms(12_030));
    assert_eq!(estimate.quality, Quality::Fine);
    assert!(off(&mut filter, 12_030) < 0.02, "{estimate:?} {:?}", filter.nuisances());
    assert!((estimate.motion.translation - 0.5).abs() < 0.01 && filter.counts().found == 1);
}

#[test]
fn a_bearing_counts_for_its_own_instant_whenever_it_comes() {
    let (mut at_once, mut late) = (filter(), filter());
    for filter in [&mut at_once, &mut late] {
        filter.odometry(ms(1000), ON).unwrap();
        filter.set(pose(1000), SURE).unwrap();
    }
    for now in (1050..2950).step_by(50) {
        at_once.odometry(ms(now), ON).unwrap();
        late.odometry(ms(now), ON).unwrap();
        if let beacon @ 0..4 = now as usize % 1000 / 50 {
            at_once.bearing(ms(now - 13), BEACONS[beacon].0, bearing(pose(now - 13), beacon)).unwrap();
        }
    }
    // All of them later, the newest first.
    for now in (1050..2950).rev().filter(|now| now % 50 == 0) {
        if let beacon @ 0..4 = now as usize % 1000 / 50 {
            late.bearing(ms(now - 13), BEACONS[beacon].0, bearing(pose(now - 13), beacon)).unwrap();
        }
    }
    let (one, other) = (at_once.estimate(ms(2900)), late.estimate(ms(2900)));
    assert!(one.pose.point().distance(other.pose.point()) < 2e-3, "{one:?} {other:?}");
    assert!((one.covariance[0][0] / other.covariance[0][0] - 1.0).abs() < 0.1, "{one:?} {other:?}");
}

#[test]
fn what_is_told_again_to_a_robot_that_stands_adds_nothing() {
    let mut filter = filter();
    filter.odometry(ms(1000), Motion::default()).unwrap();
    filter.set(pose(0), SURE).unwrap();
    let mut before = f64::INFINITY;
    for second in 2..40u64 {
        for part in 0..20 {
            filter.odometry(ms(second * 1000 + part * 50), Motion::default()).unwrap();
        }
        for (beacon, (id, ..)) in BEACONS.iter().enumerate() {
            filter.bearing(ms(second * 1000 + 950), *id, bearing(pose(0), beacon) + 0.002).unwrap();
        }
        let variance = filter.estimate(ms(second * 1000 + 950)).covariance[0][0];
        if second > 6 {
            assert!((variance - before).abs() < 1e-9, "at {second} s: {variance} {before}");
        }
        before = variance;
    }
    assert!(filter.counts().repeated > 100);
    assert!(before > 1e-5, "{before}");
}

#[test]
fn a_pose_by_hand_is_put_right_by_what_is_seen_even_while_it_stands() {
    let mut filter = filter();
    filter.odometry(ms(1000), Motion::default()).unwrap();
    for second in 1..20u64 {
        if second == 10 {
            let Pose { x, y, .. } = pose(0);
            filter.set(Pose::new(x + 0.2, y, 0.05), [[0.04, 0.0, 0.0], [0.0, 0.04, 0.0], [0.0, 0.0, 0.01]]).unwrap();
        }
        filter.odometry(ms(second * 1000 + 500), Motion::default()).unwrap();
        for (beacon, (id, ..)) in BEACONS.iter().enumerate() {
            filter.bearing(ms(second * 1000 + 400), *id, bearing(pose(0), beacon)).unwrap();
        }
    }
    let estimate = filter.estimate(ms(19_500));
    assert!(estimate.pose.point().distance(pose(0).point()) < 0.05, "{estimate:?}");
}

/// A robot that stands; from 10 s on these beacons are seen 0.3 rad off. Says when it was doubted first, s.
fn stand(wrong: &[usize]) -> Option<u64> {
    let mut filter = filter();
    filter.odometry(ms(1000), Motion::default()).unwrap();
    filter.set(pose(0), SURE).unwrap();
    for second in 2..40u64 {
        filter.odometry(ms(second * 1000 + 999), Motion::default()).unwrap();
        for (beacon, (id, ..)) in BEACONS.iter().enumerate() {
            let off = if second >= 10 && wrong.contains(&beacon) { 0.3 } else { 0.0 };
            filter.bearing(ms(second * 1000 + 200 * beacon as u64), *id, bearing(pose(0), beacon) + off).unwrap();
        }
        filter.estimate(ms(second * 1000 + 999));
        if filter.counts().doubted > 0 {
            return Some(second);
        }
    }
    None
}

#[test]
fn two_beacons_that_stay_wrong_are_a_doubt_even_if_others_fit_and_one_is_not() {
    assert_eq!(stand(&[1]), None, "somebody moved it, or it is seen in a mirror");
    for wrong in [[0, 2], [1, 3], [0, 1]] {
        assert_eq!(stand(&wrong), Some(11), "{wrong:?}");
    }
}

#[test]
fn a_wild_bearing_that_was_believed_is_taken_back() {
    let (mut with, mut without) = (filter(), filter());
    for (filter, wild) in [(&mut with, true), (&mut without, false)] {
        filter.odometry(ms(0), ON).unwrap();
        // So little is known of the heading that a bearing 0.3 rad off fits.
        filter.set(pose(0), [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.09]]).unwrap();
        for now in (50..900).step_by(50) {
            filter.odometry(ms(now), ON).unwrap();
            let off = if wild && now == 200 { 0.3 } else { 0.0 };
            if now % 200 == 0 {
                let beacon = now as usize / 200 % 4;
                filter.bearing(ms(now - 10), BEACONS[beacon].0, bearing(pose(now - 10), beacon) + off).unwrap();
            }
        }
    }
    let (one, other) = (with.estimate(ms(850)), without.estimate(ms(850)));
    assert!(one.pose.point().distance(other.pose.point()) < 0.1, "{one:?} {other:?}");
    assert!((one.pose.theta - other.pose.theta).radians().abs() < 0.02, "{one:?} {other:?}");
    assert!(with.counts().gated >= 1 && without.counts().gated == 0);
}

#[test]
fn without_beacons_it_grows_unsure_and_says_so() {
    let mut filter = filter();
    filter.odometry(ms(0), ON).unwrap();
    filter.set(pose(0), SURE).unwrap();
    let mut told = vec![];
    for now in (50..2_000_000).step_by(50) {
        filter.odometry(ms(now), ON).unwrap();
        let quality = filter.estimate(ms(now)).quality;
        if told.last() != Some(&quality) {
            told.push(quality);
        }
    }
    assert_eq!(told, [Quality::Fine, Quality::Coarse, Quality::Lost]);
}

#[test]
fn one_wild_bearing_moves_nothing() {
    let mut filter = filter();
    drive(&mut filter, 1000, 12_000);
    let before = filter.estimate(ms(12_000));
    filter.bearing(ms(11_990), 2, 2.5).unwrap();
    let after = filter.estimate(ms(12_000));
    assert!(before.pose.point().distance(after.pose.point()) < 1e-9 && after.quality == Quality::Fine);
    assert!(filter.counts().gated >= 1);
}

#[test]
fn what_cannot_be_is_counted_and_changes_nothing() {
    let mut filter = filter();
    drive(&mut filter, 1000, 8000);
    let (before, early) = (filter.estimate(ms(8000)), filter.counts().times);
    let odd = |translation, rotation| Motion { translation, rotation };
    for rates in [odd(f64::NAN, 0.0), odd(0.0, f64::INFINITY), odd(1e300, 0.0), odd(0.0, -1e9)] {
        assert_eq!(filter.odometry(ms(8050), rates), Err(Refused::Value));
    }
    assert_eq!(filter.odometry(ms(7000), ON), Err(Refused::Backwards));
    assert_eq!(filter.odometry(ms(8000), ON), Err(Refused::Backwards));
    assert_eq!(filter.bearing(ms(7990), 99, 0.0), Err(Refused::Unknown));
    assert_eq!(filter.bearing(ms(7990), 1, f64::NAN), Err(Refused::Value));
    assert_eq!(filter.bearing(ms(5000), 1, 0.0), Err(Refused::Time));
    assert_eq!(filter.bearing(Instant::NEVER, 1, 0.0), Err(Refused::Time));
    assert_eq!(filter.set(Pose::new(f64::NAN, 0.0, 0.0), SURE), Err(Refused::Value));
    assert_eq!(filter.set(pose(0), [[-1.0; 3]; 3]), Err(Refused::Value));
    assert_eq!(filter.set(pose(0), [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), Err(Refused::Value));
    assert_eq!(filter.estimate(ms(8000)), before);
    let counts = filter.counts();
    assert_eq!((counts.values, counts.backwards, counts.unknown, counts.times - early), (8, 2, 1, 2));
}

#[test]
fn any_sequence_of_anything_leaves_it_finite_and_alive() {
    let mut seed = 1u64;
    let mut next = |n: u64| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) % n
    };
    let numbers = [0.0, -0.0, 0.5, -0.5, 1.2, 3.2, -3.2, 9.9, 20.0, 1e-300, f64::NAN, f64::INFINITY, 1e300];
    for _ in 0..20 {
        let mut filter = filter();
        let mut now = 5000u64;
        for _ in 0..3000 {
            now = (now + next(400)).saturating_sub(next(150));
            let one = numbers[next(numbers.len() as u64) as usize];
            let other = numbers[next(numbers.len() as u64) as usize];
            let _ = match next(8) {
                0..4 => filter.odometry(ms(now), Motion { translation: one, rotation: other }),
                4..7 => filter.bearing(ms((now + next(3000)).saturating_sub(next(3000))), next(6) as i32, one),
                _ => match next(20) {
                    0 => filter.set(Pose::new(one, other, one), SURE),
                    _ => Ok(()),
                },
            };
            let estimate = filter.estimate(ms(now));
            let Pose { x, y, theta } = estimate.pose;
            assert!(x.is_finite() && y.is_finite() && theta.radians().is_finite(), "{estimate:?}");
            for (place, row) in estimate.covariance.iter().enumerate() {
                assert!(row.iter().all(|value| value.is_finite()) && row[place] >= 0.0, "{estimate:?}");
            }
        }
    }
}

#[test]
fn a_configuration_that_cannot_be_is_refused() {
    let refused = |change: fn(&mut Config)| {
        let mut config = Config::default();
        change(&mut config);
        Filter::new(config).map(|_| ()).unwrap_err()
    };
    let twice = Beacon { id: 3, at: Point::default() };
    assert!(matches!(refused(|c| c.bearing = 0.0), ConfigError::Zero("bearing")));
    assert!(matches!(refused(|c| c.wild = 1.0), ConfigError::Part("wild")));
    assert!(matches!(refused(|c| c.lasting = -0.1), ConfigError::Part("lasting")));
    assert!(matches!(refused(|c| c.scale = f64::NAN), ConfigError::Negative("scale")));
    assert!(matches!(refused(|c| c.mount.x = f64::INFINITY), ConfigError::Place));
    let config = Config { beacons: vec![twice, twice], ..Config::default() };
    assert_eq!(Filter::new(config).map(|_| ()).unwrap_err(), ConfigError::Twice(3));
}

/// Drives in circles with all beacons in sight; the sensor sits at `place`.
fn circle<const N: usize>(filter: &mut Kalman<N>, place: Point, seconds: u64) -> Pose {
    let rates = Motion { translation: 0.5, rotation: 0.5 };
    let (mut pose, step) = (Pose::new(10.0, 5.0, 0.0), 0.05);
    for now in (1000..=1000 + 1000 * seconds).step_by(50) {
        let _ = filter.odometry(ms(now), rates);
        if now > 1000 {
            pose = pose.along(Motion { translation: rates.translation * step, rotation: rates.rotation * step });
        }
        if let beacon @ 0..4 = now as usize % 500 / 50 {
            let (_, x, y) = BEACONS[beacon];
            let sensor = pose * place;
            let bearing = wrap(libm::atan2(y - sensor.y, x - sensor.x) - pose.theta.radians());
            let _ = filter.bearing(ms(now), BEACONS[beacon].0, bearing);
        }
    }
    pose
}

#[test]
fn the_place_of_the_sensor_is_found_while_the_robot_turns() {
    let Filter { config, .. } = filter();
    let place = Point { x: -0.2, y: 0.15 };
    let config = Config { mount: Mount { x: 0.0, y: 0.0 }, place: 0.3, delay: 0.1, ..config };
    let mut filter = PlacingFilter::new(config).unwrap();
    let pose = circle(&mut filter, place, 60);
    let (found, deviations) = (filter.nuisances().place, filter.nuisance_deviations());
    assert!(found.distance(place) < 0.03 && deviations.place < 0.05, "{found:?} {deviations:?}");
    let estimate = filter.estimate(ms(61_000));
    assert!(estimate.quality == Quality::Fine && estimate.pose.point().distance(pose.point()) < 0.05, "{estimate:?}");
}

#[test]
fn noise_that_lasts_counts_once() {
    let Filter { config, .. } = filter();
    let config = Config { lasting: 0.9, lasting_s: 5.0, ..config };
    // Twenty bearings within a second say little more than one; twenty in a hundred seconds almost as much as twenty.
    let sum = |apart: f64| (1..20).map(|_| config.independence(apart)).sum::<f64>();
    assert!(sum(0.05) < 0.3 && sum(5.0) > 8.0, "{} {}", sum(0.05), sum(5.0));
    assert!((Config { lasting: 0.0, ..config }.independence(0.0) - 1.0).abs() < 1e-12);
}

#[test]
fn a_pose_that_was_found_is_fine_only_when_later_bearings_confirm_it() {
    let mut filter = filter();
    let mut coarse = 0;
    for until in 1..200 {
        let (from, to) = (1000 + 50 * (until - 1), 1000 + 50 * until);
        drive(&mut filter, from + 50, to);
        match filter.estimate(ms(to)).quality {
            Quality::Coarse => coarse += 1,
            Quality::Fine => break,
            _ => assert_eq!(coarse, 0),
        }
        assert!(until < 199, "never FINE");
    }
    assert!(coarse >= 2, "FINE without a bearing after the search");
}

#[test]
fn a_pose_that_is_wrong_by_little_is_put_right_while_the_robot_stands() {
    let mut filter = Filter::new(Config { turn: 0.003, ..filter().config }).unwrap();
    filter.odometry(ms(1000), Motion::default()).unwrap();
    let Pose { x, y, .. } = pose(0);
    let sure = [[0.003, 0.0, 0.0], [0.0, 0.003, 0.0], [0.0, 0.0, 0.0002]];
    filter.set(Pose::new(x - 0.15, y, 0.15), sure).unwrap();
    let mut wrong = 0;
    for second in 1..40u64 {
        filter.odometry(ms(second * 1000 + 500), Motion::default()).unwrap();
        for (beacon, (id, ..)) in BEACONS.iter().enumerate() {
            filter.bearing(ms(second * 1000 + 400), *id, bearing(pose(0), beacon)).unwrap();
        }
        let estimate = filter.estimate(ms(second * 1000 + 500));
        let off = estimate.pose.point().distance(pose(0).point()) > 0.05 || estimate.pose.theta.radians().abs() > 0.02;
        wrong += u32::from(second > 5 && (off || estimate.quality < Quality::Coarse));
    }
    assert_eq!((wrong, filter.counts().doubted), (0, 1), "{:?}", filter.estimate(ms(39_500)));
}

/// A robot that stands at a known pose, is carried to another one at 8 s, and sees these beacons there five times a
/// second. Qualities from the first doubt on.
fn carried(to: Pose, sees: &[usize]) -> Vec<Quality> {
    let mut filter = filter();
    filter.odometry(ms(1000), Motion::default()).unwrap();
    filter.set(pose(0), SURE).unwrap();
    let mut told = Vec::new();
    for now in (1200..60_000).step_by(200) {
        let (at, sees) = if now < 8000 { (pose(0), &[0, 1, 2, 3][..]) } else { (to, sees) };
        filter.odometry(ms(now), Motion::default()).unwrap();
        for beacon in sees {
            filter.bearing(ms(now - 20), BEACONS[*beacon].0, bearing(at, *beacon)).unwrap();
        }
        let quality = filter.estimate(ms(now)).quality;
        if filter.counts().doubted > 0 {
            told.push(quality);
        }
    }
    told
}

#[test]
fn a_carried_robot_that_sees_too_few_beacons_is_not_known_again() {
    for (x, y) in [(17.0, 7.8), (12.0, 3.0), (4.5, 6.3)] {
        for turn in 0..12 {
            let to = Pose::new(x, y, f64::from(turn) * 0.5 - 3.0);
            for sees in [&[0][..], &[2], &[1, 3]] {
                let told = carried(to, sees);
                let known = told.iter().filter(|quality| **quality >= Quality::Coarse).count();
                assert!(known == 0, "{to:?} sees {sees:?}: known {known} times of {}", told.len());
            }
        }
    }
}

#[test]
fn a_carried_robot_that_sees_three_beacons_is_known_again() {
    for turn in 0..12 {
        let to = Pose::new(12.0, 3.0, f64::from(turn) * 0.5 - 3.0);
        let told = carried(to, &[0, 1, 2]);
        assert!(told.last().is_some_and(|quality| *quality >= Quality::Coarse), "{to:?}: {:?}", told.last());
    }
}

#[test]
fn unequal_wheels_that_were_found_straight_ahead_are_known_in_a_turn() {
    let wheels = SteeredWheels::new(0.6, 0.5);
    let mut filter = Filter::new(Config { wheels: Some(wheels), ..filter().config }).unwrap();
    let mut robot = pose(0);
    filter.odometry(ms(1000), Motion::default()).unwrap();
    filter.set(robot, SURE).unwrap();
    for now in (1050..30_000).step_by(50) {
        // Straight ahead with beacons in sight, then a turn to the left, and one to the right, without.
        let curvature = [0.0, 1.0, -1.0][usize::from(now > 21_000) + usize::from(now > 24_150)];
        if now > 27_300 {
            break;
        }
        robot = robot.along(Motion { translation: 0.025, rotation: 0.025 * curvature });
        let (left, right) = wheels.geometry.hub_speeds(0.5, curvature);
        filter.odometry(ms(now), wheels.motion(left * 1.0075, right * 0.9925)).unwrap();
        if let (0.0, beacon @ 0..4) = (curvature, now as usize % 1000 / 50) {
            filter.bearing(ms(now), BEACONS[beacon].0, bearing(robot, beacon)).unwrap();
        }
        let estimate = filter.estimate(ms(now));
        let off = (estimate.pose.theta - robot.theta).radians().abs();
        let bound = 0.02 + 3.0 * libm::sqrt(estimate.covariance[2][2]);
        assert!(now < 15_000 || off < bound.min(0.04), "{now}: {off} {bound} {:?}", filter.nuisances());
    }
}

#[test]
fn each_beacon_has_the_residual_of_its_last_bearing_and_what_is_refused_is_counted() {
    let mut filter = filter();
    assert_eq!(filter.uses(), [BeaconUse::default(); 4]);
    drive(&mut filter, 1000, 12_000);
    filter.estimate(ms(12_000));
    for seen in filter.uses() {
        let last = seen.last.unwrap();
        assert!(last.fits && last.residual.abs() < 0.01 && seen.accepted >= 8 && seen.refused == 0, "{seen:?}");
        // The deviation of a bearing is half a degree; that of the pose adds to it.
        assert!((0.5f64.to_radians()..0.05).contains(&last.deviation), "{seen:?}");
    }
    let before = filter.uses().to_vec();
    filter.bearing(ms(11_990), BEACONS[2].0, bearing(pose(11_990), 2) + 0.5).unwrap();
    filter.estimate(ms(12_000));
    let after = filter.uses();
    assert_eq!((after[2].accepted, after[2].refused), (before[2].accepted, 1));
    let last = after[2].last.unwrap();
    assert!(!last.fits && (last.residual - 0.5).abs() < 0.02 && last.stamp == ms(11_990), "{last:?}");
    assert_eq!([after[0], after[1], after[3]], [before[0], before[1], before[3]], "others are as before");
}

#[test]
fn a_bearing_that_is_taken_back_counts_as_refused_and_not_twice() {
    let mut seen = BeaconUse::default();
    let judged = |stamp, fits| Judged { stamp, residual: 0.1, deviation: 0.02, fits };
    seen.judge(judged(ms(1), true));
    seen.judge(judged(ms(2), true));
    seen.take_back(ms(1));
    assert_eq!((seen.accepted, seen.refused, seen.last), (1, 1, Some(judged(ms(2), true))));
    seen.take_back(ms(2));
    assert_eq!((seen.accepted, seen.refused, seen.last), (0, 2, Some(judged(ms(2), false))));
}
