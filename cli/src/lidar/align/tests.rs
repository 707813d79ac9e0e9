//! The estimation against made-up robots: a room, a lidar, wheels with errors, people, and a place that is known.

use super::estimate::{Estimate, Lack, Recording, Refusal, estimate, standing};
use super::odometry::{Errors, Velocity, Way};
use super::walls::Beam;
use super::{Session, lines};
use base::{Duration, Instant};
use messages::Message;
use messages::lowlevel::{CmdMotion, CmdVelocity, DataScan};
use messages::simulation::DataTruth;
use module::State;
use robot::place::RobotLocation;
use robot::topology::virtual_machine;
use sim::host::{Config, News};
use std::cell::RefCell;
use std::f64::consts::TAU;
use std::path::Path;
use std::rc::Rc;

/// A wall from a point to another, m.
type Segment = [[f64; 2]; 2];

/// What is driven: for so many seconds forward, m/s, and turning, rad/s.
type Leg = (f64, f64, f64);

const ROOM: [Segment; 4] =
    [[[2.5, -3.0], [2.5, 4.0]], [[2.5, 4.0], [-4.0, 4.0]], [[-4.0, 4.0], [-4.0, -3.0]], [[-4.0, -3.0], [2.5, -3.0]]];
/// One wall ahead; the rest of the hall is out of sight.
const ONE: [Segment; 1] = [[[2.5, -6.0], [2.5, 6.0]]];
/// Towards the wall, back, turned, and straight on at an angle to it.
const DRIVE: [Leg; 8] = [
    (2.0, 0.0, 0.0),
    (3.0, 0.3, 0.0),
    (1.0, 0.0, 0.0),
    (2.0, 0.0, 0.5),
    (3.0, 0.3, 0.0),
    (1.0, 0.0, 0.0),
    (2.5, 0.0, -0.8),
    (2.0, 0.0, 0.0),
];

struct Rig {
    walls: Vec<Segment>,
    place: [f64; 3],
    legs: Vec<Leg>,
    /// Errors of the odometry.
    errors: Errors,
    noise_m: f64,
    /// People of 0.2 m radius: where they are at the begin, and their velocities.
    people: Vec<[f64; 4]>,
}

impl Rig {
    fn new(walls: &[Segment], place: [f64; 3], legs: &[Leg]) -> Self {
        let errors = Errors { travel: 0.006, turn: -0.01, drift: 0.004, delay: 0.02 };
        Self { walls: walls.to_vec(), place, legs: legs.to_vec(), errors, noise_m: 0.01, people: Vec::new() }
    }

    fn record(&self) -> Recording {
        let mut random = Random(0x9E37_79B9_7F4A_7C15);
        let total: f64 = self.legs.iter().map(|leg| leg.0).sum();
        let truth = |at: f64| {
            let mut left = at;
            for (time, speed, turn) in &self.legs {
                if left < *time {
                    // It gains speed and brakes.
                    let ramp = (left / 0.4).min((time - left) / 0.4).clamp(0.0, 1.0);
                    return (speed * ramp, turn * ramp);
                }
                left -= time;
            }
            (0.0, 0.0)
        };
        let fine: Vec<Velocity> = (0..=(total * 200.0) as u32)
            .map(|n| f64::from(n) / 200.0)
            .map(|at| Velocity { at, vx: truth(at).0, vy: 0.0, omega: truth(at).1 })
            .collect();
        let way = Way::new(&fine, &Errors::default());
        let measured = |n: u32| {
            let at = f64::from(n) * 0.05;
            let (vx, omega) = truth(at + self.errors.delay);
            let vx_measured = vx / (1.0 + self.errors.travel);
            let turn = (omega - self.errors.drift * vx_measured) / (1.0 + self.errors.turn);
            let moves = vx != 0.0 || omega != 0.0;
            let shake = if moves { 0.003 } else { 0.0 };
            Velocity { at, vx: vx_measured + shake * random.normal(), vy: 0.0, omega: turn + shake * random.normal() }
        };
        let velocities: Vec<Velocity> = (0..=(total * 20.0) as u32).map(measured).collect();
        let mut beams = Vec::new();
        for n in 0..(total * 10.0 * 360.0) as u32 {
            let (at, angle) = (f64::from(n) / 3600.0, -f64::from(n % 360) / 360.0 * TAU);
            let [x, y, heading] = way.at(at);
            let (sin, cos) = heading.sin_cos();
            let [mx, my, theta] = self.place;
            let from = [x + cos * mx - sin * my, y + sin * mx + cos * my];
            if let Some(range) = self.ray(from, heading + theta + angle, at) {
                let range = range + self.noise_m * random.normal();
                beams.push(Beam { at, revolution: i64::from(n / 360), angle, range });
            }
        }
        Recording { velocities, beams }
    }

    fn ray(&self, [x, y]: [f64; 2], angle: f64, at: f64) -> Option<f64> {
        let (dy, dx) = angle.sin_cos();
        let wall = |[a, b]: &Segment| {
            let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
            let cross = dx * ey - dy * ex;
            let range = ((a[0] - x) * ey - (a[1] - y) * ex) / cross;
            let along = ((a[0] - x) * dy - (a[1] - y) * dx) / cross;
            (cross.abs() > 1e-9 && range > 0.0 && (0.0..=1.0).contains(&along)).then_some(range)
        };
        let person = |[px, py, vx, vy]: &[f64; 4]| {
            let (ox, oy) = (px + vx * at - x, py + vy * at - y);
            let (middle, aside) = (ox * dx + oy * dy, ox * dy - oy * dx);
            let inside = 0.04 - aside * aside;
            (inside > 0.0 && middle > 0.0).then(|| middle - inside.sqrt())
        };
        let nearest = self.walls.iter().filter_map(wall).chain(self.people.iter().filter_map(person));
        nearest.fold(None, |nearest: Option<f64>, range| Some(nearest.map_or(range, |it| it.min(range))))
    }

    fn estimate(&self) -> Estimate {
        estimate(&self.record()).expect("something is found")
    }
}

/// Normal deviates from a seed.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// Differences from the truth, m, m, rad.
fn off(found: &Estimate, place: [f64; 3]) -> [f64; 3] {
    let [x, y, theta] = found.solution.place;
    [x - place[0], y - place[1], navitools::wrap(theta - place[2])]
}

#[track_caller]
fn assert_right(name: &str, found: &Estimate, place: [f64; 3]) {
    let off = off(found, place);
    println!("{name}: off {off:.4?}, deviations {:.4?}, rms {:.4}", found.solution.deviation, found.solution.rms);
    assert_eq!(found.lacks, [], "{name}");
    for ((off, deviation), most) in off.into_iter().zip(found.solution.deviation).zip([0.012, 0.012, 0.006]) {
        assert!(off.abs() < most && off.abs() < 4.0 * deviation + 1e-3, "{name}: {off} ± {deviation}");
    }
}

#[test]
fn the_place_is_found_in_a_room_wherever_the_lidar_sits() {
    for place in [[0.0, 0.0, 0.0], [0.25, -0.1, 0.15], [-0.3, 0.2, 3.0], [0.1, 0.0, -1.6]] {
        assert_right(&format!("{place:?}"), &Rig::new(&ROOM, place, &DRIVE).estimate(), place);
    }
}

#[test]
fn one_wall_is_enough_if_it_is_met_at_two_angles() {
    let legs = [DRIVE.as_slice(), &[(3.0, 0.25, 0.0), (1.0, 0.0, 0.0)]].concat();
    for place in [[0.2, 0.05, 0.1], [0.2, 0.05, -0.2]] {
        assert_right(&format!("{place:?}"), &Rig::new(&ONE, place, &legs).estimate(), place);
    }
}

#[test]
fn errors_of_the_wheels_do_not_spoil_the_place() {
    let place = [0.2, -0.05, 0.1];
    for errors in [
        Errors { travel: 0.02, turn: 0.03, drift: -0.02, delay: 0.04 },
        Errors { travel: -0.02, turn: -0.03, drift: 0.02, delay: -0.02 },
    ] {
        let rig = Rig { errors, ..Rig::new(&ROOM, place, &DRIVE) };
        let found = rig.estimate();
        assert_right("wheels", &found, place);
        assert!((found.solution.errors.turn - errors.turn).abs() < 0.005, "{:?}", found.solution.errors);
        assert!((found.solution.errors.drift - errors.drift).abs() < 0.005, "{:?}", found.solution.errors);
    }
}

#[test]
fn people_who_walk_about_do_not_spoil_the_place() {
    let place = [0.2, 0.1, -0.1];
    let people = vec![[1.5, -2.5, 0.0, 0.4], [1.9, 3.5, -0.05, -0.5], [-2.0, 1.5, 0.4, 0.0], [0.9, -0.9, 0.1, 0.25]];
    let rig = Rig { people, ..Rig::new(&ROOM, place, &DRIVE) };
    assert_right("people", &rig.estimate(), place);
}

#[test]
fn what_was_not_driven_is_named() {
    let place = [0.2, 0.1, -0.1];
    let lacks = |walls: &[Segment], legs: &[Leg]| Rig::new(walls, place, legs).estimate().lacks;
    // Nothing but a turn.
    let turn = lacks(&ROOM, &[(2.0, 0.0, 0.0), (4.0, 0.0, 0.6), (1.0, 0.0, 0.0)]);
    assert!(matches!(turn[..], [Lack::Travel(_)]), "{turn:?}");
    // Nothing but a straight way.
    let straight = lacks(&ROOM, &[(2.0, 0.0, 0.0), (4.0, 0.3, 0.0), (1.0, 0.0, 0.0)]);
    assert!(matches!(straight[..], [Lack::Turn(_)]), "{straight:?}");
    // Straight towards a single wall, and a turn on the spot: the direction is a cosine near 1.
    let ahead = Rig::new(&ONE, [0.2, 0.1, 0.0], &[(2.0, 0.0, 0.0), (4.0, 0.3, 0.0), (3.0, 0.0, 0.5), (1.0, 0.0, 0.0)]);
    let ahead = ahead.estimate().lacks;
    assert!(matches!(ahead[..], [Lack::Direction(_) | Lack::Rival(_), ..]), "{ahead:?}");
    // At one angle to a single wall two directions fit.
    let legs = [(2.0, 0.0, 0.0), (2.0, 0.0, 0.4), (5.0, 0.3, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, -0.5)];
    let found = Rig::new(&ONE, place, &legs).estimate();
    let rival = &found.lacks;
    assert!(rival.iter().any(|lack| matches!(lack, Lack::Rival(_) | Lack::Direction(_))), "{found:?}");
}

#[test]
fn a_robot_that_does_not_stand_first_and_walls_that_are_none_are_refused() {
    let place = [0.2, 0.1, -0.1];
    let moving = Rig::new(&ROOM, place, &DRIVE[1..]).record();
    assert_eq!(estimate(&moving).err(), Some(Refusal::NotStill));
    let none = Rig { people: vec![[1.0, 0.5, 0.0, 0.0]; 3], ..Rig::new(&[], place, &DRIVE) }.record();
    assert!(matches!(standing(&none), Err(Refusal::NotStill | Refusal::NoWall)));
    let posts: Vec<Segment> = (0..40)
        .map(|n| f64::from(n) / 40.0 * TAU)
        .map(|angle| [[3.0 * angle.cos(), 3.0 * angle.sin()], [3.0 * angle.cos() + 0.2, 3.0 * angle.sin() + 0.1]])
        .collect();
    assert_eq!(standing(&Rig::new(&posts, place, &DRIVE).record()).err(), Some(Refusal::NoWall));
    let mut paused = Rig::new(&ROOM, place, &DRIVE).record();
    paused.velocities.drain(100..120);
    assert!(matches!(estimate(&paused), Err(Refusal::Gap(gap)) if gap > 1.0));
    assert_eq!(estimate(&Recording::default()).err(), Some(Refusal::NotStill));
}

#[test]
fn near_walls_are_found_from_wherever_the_robot_stands() {
    // A hall; its walls are longer than the lidar sees, and met at all angles.
    let hall: [Segment; 4] = [
        [[0.0, 0.0], [20.0, 0.0]],
        [[20.0, 0.0], [20.0, 12.0]],
        [[20.0, 12.0], [0.0, 12.0]],
        [[0.0, 12.0], [0.0, 0.0]],
    ];
    let mut random = Random(7);
    for n in 0..60 {
        let from = [1.0 + 18.0 * random.uniform(), 1.0 + 10.0 * random.uniform()];
        let front = TAU * random.uniform();
        let rig = Rig { noise_m: 0.0, ..Rig::new(&hall, [0.0; 3], &[]) };
        let mut points = Vec::new();
        for beam in 0..4500 {
            // Directions as those of the emulated devices: measured in steps of 0.5°, said in steps of 0.8°.
            let angle = f64::from(beam % 450) / 450.0 * TAU;
            let measured = (angle / TAU * 720.0).round() / 720.0 * TAU;
            let range = rig.ray(from, front + measured, 0.0).unwrap() + 0.01 * random.normal();
            if range < 7.8 {
                points.push(Beam { at: 0.0, revolution: 0, angle, range }.point());
            }
        }
        let walls = super::walls::find(&points);
        let distances = [from[0], 20.0 - from[0], from[1], 12.0 - from[1]];
        for distance in distances.into_iter().filter(|distance| (0.5..6.5).contains(distance)) {
            let is_found = walls.iter().any(|wall| (wall.distance - distance).abs() < 0.02);
            assert!(is_found, "{n}: from {from:?}, front {front}: {distance}, {walls:?}");
        }
    }
}

#[test]
fn revolutions_are_kept_as_a_whole_wherever_the_first_one_is_heard() {
    // Eighths of revolutions of 10 and 40 Hz, heard from the fourth on.
    for (rate, most) in [(10.0, 31), (40.0, 31)] {
        let mut session = Session::default();
        for n in 3..(3.0 * rate * 8.0) as i64 {
            session.scan(&DataScan {
                timestamp: (n as f64 * 1e6 / rate / 8.0) as i64,
                revolution: n / 8,
                angle_min: -((n % 8) as f64) * TAU / 8.0,
                angle_step: -TAU / 8.0 / 50.0,
                range_min: 0.02,
                range_max: 8.0,
                ranges: vec![2.0; 50],
                ..DataScan::default()
            });
        }
        let beams = &session.recording.beams;
        let turns: Vec<usize> = beams.chunk_by(|a, b| a.revolution == b.revolution).map(<[Beam]>::len).collect();
        assert!((25..=most).contains(&turns.len()), "{rate} Hz: {turns:?}");
        assert!(turns[0] == 250 && turns[1..].iter().all(|beams| *beams == 400), "{rate} Hz: {turns:?}");
    }
}

#[test]
fn wheels_that_slip_are_refused_and_not_averaged() {
    let place = [0.2, 0.1, -0.1];
    let mut slips = Rig::new(&ROOM, place, &DRIVE).record();
    // For one second the wheels turn, and the robot stays where it is.
    slips.velocities.iter_mut().filter(|velocity| (3.0..3.6).contains(&velocity.at)).for_each(|it| it.vx += 0.6);
    let found = estimate(&slips);
    let refused = |found: &Estimate| found.lacks.iter().any(|lack| matches!(lack, Lack::Slip(_) | Lack::Misfit(..)));
    assert!(found.as_ref().map_or(true, refused), "{found:?}");
}

/// The shipped courier in virtual time, whose lidar really sits where `sets` say; its driver says that it sits at the
/// robot's origin.
fn courier(place: [f64; 3], start: [f64; 3], legs: &[(f64, [f64; 2])]) -> (Session, DataTruth) {
    let conf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf");
    let world = std::fs::read_to_string(conf.join("worlds/empty.toml")).unwrap();
    let world = world.replace("start = [10.0, 6.0, 0.0]", &format!("start = {start:?}"));
    let file = std::env::temp_dir().join(format!("advee-align-{}-{}.toml", start[0], std::process::id()));
    std::fs::write(&file, world).unwrap();
    let [x, y, theta] = place;
    let sets = vec![
        "world.people=0".to_string(),
        format!("lidar.top.x_m={x}"),
        format!("lidar.top.y_m={y}"),
        format!("lidar.top.theta_rad={theta}"),
    ];
    let place = RobotLocation {
        config: conf.join("courier"),
        run_dir: "/run/advee".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets,
        sim: true,
        world: Some(file.clone()),
    };
    let mut machine = virtual_machine(&place, Config { seed: 3, ..Config::default() }).unwrap();
    let heard = Rc::new(RefCell::new((Session::default(), DataTruth::default(), false)));
    let keep = heard.clone();
    machine.observe(move |_, news| {
        let (session, truth, ready) = &mut *keep.borrow_mut();
        match news {
            News::Message { message: Message::SimDataTruth(now), .. } => *truth = now.clone(),
            News::Message { message: Message::LlDataScan(scan), .. } if *ready => {
                session.scan(&DataScan { x: 0.0, y: 0.0, theta: 0.0, ..scan.clone() });
            }
            News::Message { message: Message::LlDataVelocity(velocity), .. } => {
                *ready |= velocity.ready;
                if *ready {
                    session.velocity(velocity);
                }
            }
            _ => {}
        }
    });
    machine.spawn("watchdog", State::Run).unwrap();
    let mut end = Instant::from_millis(20_000);
    machine.run_until(end);
    std::fs::remove_file(file).unwrap();
    assert!(heard.borrow().2, "its drives are enabled");
    for (seconds, [vx, omega]) in legs {
        // The first commands are zero: a source must be released.
        for n in 0..(seconds * 20.0) as u32 {
            let [vx, omega] = if n < 10 { [0.0; 2] } else { [*vx, *omega] };
            let (source, priority) = ("test".into(), CmdMotion::REMOTE);
            let command = CmdVelocity { timestamp: 0, vx, vy: 0.0, omega, priority, source, session: 1 };
            machine.inject(end + n * Duration::from_millis(50), command);
        }
        end += Duration::from_secs_f64(*seconds + 1.5);
        machine.run_until(end);
    }
    drop(machine);
    let (session, truth, _) = Rc::try_unwrap(heard).ok().unwrap().into_inner();
    (session, truth)
}

#[test]
fn on_the_simulated_courier_the_lidar_is_found_where_it_really_sits() {
    let legs = [(5.5, [0.2, 0.0]), (4.0, [0.0, 0.4]), (5.5, [0.2, 0.0]), (6.0, [0.15, -0.3]), (4.0, [0.0, 0.5])];
    // Of the last one, a wall at the end of its range is soon out of sight.
    for (place, start) in [
        ([0.12, -0.05, 0.08], [16.5, 3.0, 0.1]),
        ([-0.15, 0.1, -0.12], [15.5, 4.0, -0.3]),
        ([0.0, 0.0, 3.0], [3.0, 3.5, 2.9]),
        ([0.24, 0.1, -2.93], [16.35, 4.0, -0.35]),
    ] {
        let (session, truth) = courier(place, start, &legs);
        assert_eq!(truth.collisions, 0, "{truth:?}");
        assert!((truth.x - start[0]).hypot(truth.y - start[1]) > 0.5, "it has moved: {truth:?}");
        assert!(session.stands_again() && session.configured == Some([0.0; 3]));
        let found = estimate(&session.recording).expect("something is found");
        assert_right(&format!("courier {place:?}"), &found, place);
        let lines = lines("top", &found, [0.0; 3]);
        assert!(lines.contains(&"[lidar.top]".to_string()), "{lines:#?}");
        println!("{}", lines.join("\n"));
    }
}

#[test]
fn hostile_numbers_end_in_a_refusal() {
    let mut recording = Rig::new(&ROOM, [0.2, 0.1, -0.1], &DRIVE).record();
    for (n, beam) in recording.beams.iter_mut().enumerate() {
        beam.range = 1.0 + (n as f64 * 0.618).fract() * 7.0;
    }
    let found = estimate(&recording);
    assert!(found.as_ref().map_or(true, |found| !found.lacks.is_empty()), "{found:?}");
}
