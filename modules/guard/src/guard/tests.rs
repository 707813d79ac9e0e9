//! The module on its bench: what it publishes, also when it knows nothing.

use super::*;
use crate::config::{FieldKeys, FieldKind, Settings};
use kinematics::reach::Ackermann;
use messages::lowlevel::{DataRanges, Reading};
use module::bench::Bench;
use module::{Shell, ShellConfig};
use navitools::Point;
use settings::Section;
use surroundings::Sonar;

const IDS: [(i32, f64, f64, f64); 8] = [
    (0, 0.75, 0.28, 60.0),
    (1, 0.75, 0.15, 25.0),
    (2, 0.75, 0.0, 0.0),
    (3, 0.75, -0.15, -25.0),
    (4, 0.75, -0.28, -60.0),
    (5, -0.15, 0.15, 155.0),
    (6, -0.15, 0.0, 180.0),
    (7, -0.15, -0.15, -155.0),
];

fn config(ranging: Ranging) -> Config {
    let corner = |(x, y)| Point { x, y };
    let sensor = |(id, x, y, degrees): (i32, f64, f64, f64)| Sonar {
        id,
        at: Point { x, y },
        theta: degrees.to_radians(),
        beam: 0.96,
    };
    Config {
        settings: Settings { ranging, ..Settings::usual() },
        footprint: [(-0.15, -0.3), (0.75, -0.3), (0.75, 0.3), (-0.15, 0.3)].map(corner).into(),
        sonars: IDS.map(sensor).into(),
        lidars: Vec::new(),
        base: Ackermann { wheelbase: 0.6, steering: 0.61, steering_rate: 0.7 }.into(),
        braking: 0.8,
        power_lost: 0.8,
        speed: 1.2,
    }
}

struct Robot {
    bench: Bench,
    speed: f64,
    /// Distance that each sonar measures, m; infinite: silent; NaN: unknown.
    distances: [f64; 8],
    moves: bool,
    ranges: bool,
}

impl Robot {
    fn new(ranging: Ranging) -> Self {
        Self::of(&config(ranging))
    }

    /// With fields of a form of their own.
    fn with(fields: Vec<FieldKeys>) -> Self {
        let config = config(Ranging::Sonar);
        Self::of(&Config { settings: Settings { fields, ..config.settings.clone() }, ..config })
    }

    fn of(config: &Config) -> Self {
        let guard = Guard::new(config).expect("an outline");
        let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(guard)));
        bench.start();
        Self { bench, speed: 0.0, distances: [f64::INFINITY; 8], moves: true, ranges: true }
    }

    /// Motion at 20 Hz, ranges at 4 Hz; the last message of the guard, and how many there were.
    fn pass(&mut self, ms: u64) -> (DataGuard, usize) {
        self.bench.published();
        for _ in 0..ms / 10 {
            self.bench.pass(Duration::from_millis(10));
            let now = self.bench.now().as_nanos() / 1_000_000;
            if self.moves && now.is_multiple_of(50) {
                self.bench.message(DataMotion { speed: self.speed, ..DataMotion::default() });
            }
            if self.ranges && now.is_multiple_of(250) {
                let ranges = self.ranges(now as i64 * 1000);
                self.bench.message(ranges);
            }
        }
        let said = self.bench.published().into_iter().filter_map(|message| match message {
            Message::LlDataGuard(guard) => Some(guard),
            _ => None,
        });
        let said: Vec<DataGuard> = said.collect();
        (said.last().cloned().expect("it is published"), said.len())
    }

    fn ranges(&self, timestamp: i64) -> DataRanges {
        let reading = |(&(id, ..), distance): (&(i32, f64, f64, f64), &f64)| {
            let status = match distance {
                distance if distance.is_nan() => Reading::UNKNOWN,
                distance if distance.is_infinite() => Reading::SILENT,
                _ => Reading::MEASURED,
            };
            let timestamp = timestamp - 100_000;
            Reading { timestamp, id, kind: Reading::SONAR, status, distance: *distance, ..Reading::default() }
        };
        DataRanges { timestamp, readings: IDS.iter().zip(&self.distances).map(reading).collect() }
    }
}

#[test]
fn twenty_times_a_second_it_says_what_an_empty_hall_permits() {
    let mut robot = Robot::new(Ranging::Sonar);
    let (first, count) = robot.pass(500);
    assert_eq!((first.forward, first.code, count), (0.0, Hold::GuardUnknown.code(), 10), "nothing is known yet");
    let (guard, _) = robot.pass(1000);
    assert!(guard.forward > 0.6 && guard.backward > 0.6 && guard.code == 0, "{guard:?}");
    assert_eq!([guard.left, guard.right, guard.turn_left, guard.turn_right], [0.0; 4]);
    assert_eq!(guard.fields.iter().map(|field| field.kind).collect::<Vec<_>>(), [Field::PROTECTIVE, Field::WARNING]);
}

#[test]
fn an_echo_bounds_the_speed_and_names_its_sonar() {
    let mut robot = Robot::new(Ranging::Sonar);
    robot.pass(1500);
    robot.distances[2] = 0.2;
    let (guard, _) = robot.pass(600);
    assert!(guard.forward == 0.0 && guard.backward > 0.6, "{guard:?}");
    assert_eq!((guard.code, guard.subject.as_str()), (Hold::GuardStops.code(), "sonar 2"));
    assert!(guard.fields.iter().all(|field| field.occupied == (field.kind == Field::PROTECTIVE)), "it stands");
}

fn field(kind: FieldKind, polygon: [[f64; 2]; 4]) -> FieldKeys {
    FieldKeys { kind, from: 0.0, polygon: polygon.into() }
}

#[test]
fn a_field_of_the_configuration_bounds_the_speed_beside_the_others_and_is_shown_with_them() {
    let ahead = [[0.75, -0.3], [2.2, -0.3], [2.2, 0.3], [0.75, 0.3]];
    for (kind, forward, backward, hold) in [
        (FieldKind::Protective, 0.0, 0.3, Hold::GuardStops),
        (FieldKind::Warning, 0.3, f64::INFINITY, Hold::GuardSlows),
    ] {
        let mut robot = Robot::with(vec![field(kind, ahead)]);
        let (free, _) = robot.pass(1500);
        assert!(free.forward > 0.6 && free.backward > 0.6 && free.code == 0, "{free:?}");
        assert!(free.fields.len() == 3 && free.fields.iter().all(|field| !field.occupied), "{free:?}");
        robot.distances[2] = 1.2;
        let (guard, _) = robot.pass(600);
        assert_eq!((guard.forward, guard.backward.min(0.3)), (forward, backward.min(0.3)), "{guard:?}");
        assert_eq!((guard.code, guard.subject.as_str()), (hold.code(), "sonar 2"));
        let [.., own] = &guard.fields[..] else { panic!("{guard:?}") };
        let x = ahead.map(|[x, _]| x);
        assert_eq!(
            (own.kind == Field::PROTECTIVE, own.occupied, &own.x[..]),
            (kind == FieldKind::Protective, true, &x[..])
        );
        // Without it the robot would drive on.
        let mut robot = Robot::new(Ranging::Sonar);
        robot.pass(1500);
        robot.distances[2] = 1.2;
        assert!(robot.pass(600).0.forward > 0.5);
    }
}

#[test]
fn a_sonar_that_is_unknown_occupies_the_fields_that_it_looks_into() {
    let ahead = [[1.5, -0.3], [2.2, -0.3], [2.2, 0.3], [1.5, 0.3]];
    let mut robot = Robot::with(vec![field(FieldKind::Protective, ahead)]);
    robot.pass(1500);
    robot.distances[2] = f64::NAN;
    let (guard, _) = robot.pass(300);
    assert_eq!((guard.forward, guard.code, guard.subject.as_str()), (0.0, Hold::GuardUnknown.code(), "sonar 2"));
    assert!(guard.fields.last().is_some_and(|field| field.occupied), "though none of its points is there");
    assert_eq!(guard.backward, 0.3, "it moves away, slowly");
}

#[test]
fn fields_of_the_configuration_never_raise_a_bound() {
    let mut random = testing::Random::new(47);
    let ahead = [[0.5, -0.6], [1.8, -0.5], [1.6, 0.6], [0.4, 0.5]];
    let behind = [[-1.2, -0.4], [-0.1, -0.4], [-0.1, 0.4], [-1.2, 0.4]];
    let own = |from| FieldKeys { from, ..field(FieldKind::Protective, behind) };
    let fields = vec![field(FieldKind::Warning, ahead), own(0.4), own(0.0)];
    let mut robots = [Robot::new(Ranging::Sonar), Robot::with(fields[..2].to_vec()), Robot::with(fields)];
    let mut lower = 0;
    for _ in 0..300 {
        let distances = [(); 8].map(|()| match random.below(8) {
            0 => f64::NAN,
            1 | 2 => 0.2 + random.below(100) as f64 / 50.0,
            _ => f64::INFINITY,
        });
        let speed = if random.below(2) == 0 { 0.0 } else { 0.3 };
        let bounds = robots.each_mut().map(|robot| {
            (robot.distances, robot.speed) = (distances, speed);
            let (guard, _) = robot.pass(300);
            [guard.forward, guard.backward, guard.turn_left, guard.turn_right]
        });
        for pair in bounds.windows(2) {
            assert!(pair[0].iter().zip(&pair[1]).all(|(before, after)| after <= before), "{bounds:?} {distances:?}");
            lower += u32::from(pair[0] != pair[1]);
        }
    }
    assert!(lower > 100, "{lower}");
}

#[test]
fn a_sonar_that_is_unknown_or_silent_for_too_long_stops_the_robot() {
    let mut robot = Robot::new(Ranging::Sonar);
    robot.speed = 0.5;
    robot.pass(1500);
    robot.distances[1] = f64::NAN;
    let (guard, _) = robot.pass(300);
    assert_eq!((guard.forward, guard.code, guard.subject.as_str()), (0.0, Hold::GuardUnknown.code(), "sonar 1"));
    robot.distances[1] = f64::INFINITY;
    assert!(robot.pass(300).0.forward > 0.6, "one reading of it again");
    robot.ranges = false;
    assert!(robot.pass(400).0.forward > 0.6, "as long as the readings are new enough");
    assert_eq!(robot.pass(500).0.forward, 0.0);
}

#[test]
fn without_the_measured_motion_nothing_is_permitted() {
    let mut robot = Robot::new(Ranging::Sonar);
    robot.pass(1500);
    robot.moves = false;
    let (guard, count) = robot.pass(300);
    assert_eq!((guard.forward, guard.backward, guard.code, count), (0.0, 0.0, Hold::GuardMotion.code(), 6));
    robot.moves = true;
    robot.speed = f64::NAN;
    assert_eq!(robot.pass(300).0.code, Hold::GuardMotion.code());
}

#[test]
fn after_a_gap_in_the_motion_of_a_robot_that_moves_everything_is_unknown() {
    for (speed, gap, is_unknown) in [(0.3, 250, true), (-0.3, 250, true), (0.0, 250, false), (0.3, 100, false)] {
        let mut robot = Robot::new(Ranging::Sonar);
        robot.speed = speed;
        assert!(robot.pass(1500).0.forward > 0.6, "{speed}");
        robot.moves = false;
        robot.pass(gap);
        robot.moves = true;
        let (guard, _) = robot.pass(110);
        let expected = if is_unknown { (true, Hold::GuardUnknown.code()) } else { (false, 0) };
        assert_eq!((guard.forward == 0.0, guard.code), expected, "{speed} m/s, {gap} ms: {guard:?}");
        assert!(robot.pass(1000).0.forward > 0.6, "{speed} m/s, {gap} ms");
    }
}

#[test]
fn a_robot_without_sensors_is_slow_in_every_direction() {
    let mut robot = Robot::new(Ranging::None);
    let (guard, _) = robot.pass(300);
    assert_eq!((guard.forward, guard.backward, guard.code), (0.3, 0.3, Hold::GuardBlind.code()));
    assert!(guard.fields.is_empty());
}

#[test]
fn any_message_is_survived() {
    let mut robot = Robot::new(Ranging::Sonar);
    robot.pass(1000);
    for value in [f64::NAN, f64::INFINITY, -1e308, 1e308, 0.0] {
        let bad = |stamp: i64| {
            let reading =
                Reading { timestamp: stamp, id: 2, kind: 0, status: 2, distance: value, ..Reading::default() };
            DataRanges { timestamp: i64::MAX, readings: vec![reading] }
        };
        for stamp in [i64::MIN, 0, i64::MAX] {
            robot.bench.message(bad(stamp));
        }
        robot.bench.message(DataMotion { speed: value, steering: value, ..DataMotion::default() });
        robot.bench.pass(Duration::from_millis(100));
    }
    let (guard, _) = robot.pass(2000);
    assert!(guard.forward.is_finite());
}

#[test]
fn motion_that_no_robot_has_is_unknown_and_does_not_move_what_was_sensed() {
    for bad in [(1e19, 0.0), (-1e19, 0.3), (1e308, 0.0), (f64::INFINITY, 0.0), (2.5, 0.0), (0.0, 1.3), (0.0, -1e9)] {
        let mut robot = Robot::new(Ranging::Sonar);
        robot.pass(1500);
        robot.distances[2] = 0.2;
        assert_eq!(robot.pass(600).0.forward, 0.0);
        for _ in 0..2 {
            let (speed, steering) = bad;
            robot.bench.message(DataMotion { speed, steering, ..DataMotion::default() });
            robot.bench.pass(Duration::from_millis(50));
            let said = robot.bench.published().into_iter().find_map(|message| match message {
                Message::LlDataGuard(guard) => Some(guard),
                _ => None,
            });
            let said = said.expect("it is published");
            assert_eq!((said.forward, said.backward, said.code), (0.0, 0.0, Hold::GuardMotion.code()), "{bad:?}");
        }
        let (guard, _) = robot.pass(2000);
        assert_eq!((guard.forward, guard.subject.as_str()), (0.0, "sonar 2"), "{bad:?}: it is still there");
        assert!(guard.backward > 0.6, "{bad:?}: {guard:?}");
        robot.distances[2] = f64::INFINITY;
        assert!(robot.pass(2000).0.forward > 0.6, "{bad:?}");
    }
}

#[test]
fn a_trail_that_is_lost_begins_anew_and_everything_is_unknown() {
    let ms = Instant::from_millis;
    for speed in [1e19, 1e308, f64::NAN] {
        let mut guard = Guard::new(&config(Ranging::Sonar)).expect("an outline");
        let readings = |at: u64| {
            let timestamp = at as i64 * 1000;
            let reading = |id| Reading { timestamp, id, status: Reading::SILENT, ..Reading::default() };
            DataRanges { timestamp, readings: (0..8).map(reading).collect() }
        };
        for at in (0..1000).step_by(50) {
            guard.on_motion(ms(at), &DataMotion::default());
            guard.echoes.on_ranges(ms(at), &readings(at), &guard.trail);
        }
        let unknown = |guard: &mut Guard, at| {
            guard.obstacles.clear();
            guard.echoes.obstacles(ms(at), &guard.trail, &mut guard.obstacles);
            assert!(guard.obstacles.iter().all(|obstacle| obstacle.at.x.is_finite() && obstacle.at.y.is_finite()));
            !guard.obstacles.is_empty()
        };
        assert!(!unknown(&mut guard, 950), "an empty hall");
        guard.trail.on_motion(ms(950), Twist { vx: speed, vy: 0.0, omega: 0.0 }, guard.window);
        guard.on_motion(ms(1000), &DataMotion::default());
        assert!(guard.trail.is_sane() && guard.trail.pose(ms(1050)).x.abs() < 1.0, "{speed}");
        assert!(unknown(&mut guard, 1000), "{speed}");
        for at in (1050..2000).step_by(50) {
            guard.on_motion(ms(at), &DataMotion::default());
            guard.echoes.on_ranges(ms(at), &readings(at), &guard.trail);
        }
        assert!(!unknown(&mut guard, 1950), "{speed}");
    }
}

/// A guard of a base with these motions, and what it says after a second in which the robot moved with this velocity,
/// or did not publish any; the sonar ahead measures this distance.
fn of_wheels(sideways: bool, velocity: Option<Twist>, ahead: f64) -> DataGuard {
    let base = Base { turns: true, sideways, ..config(Ranging::Sonar).base };
    let guard = Guard::new(&Config { base, ..config(Ranging::Sonar) }).expect("an outline");
    let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(guard)));
    bench.start();
    let mut robot = Robot { bench, ..Robot::new(Ranging::Sonar) };
    robot.distances[2] = ahead;
    for _ in 0..40 {
        if let Some(Twist { vx, vy, omega }) = velocity {
            robot.bench.message(DataVelocity { vx, vy, omega, ..DataVelocity::default() });
        }
        robot.pass(50);
    }
    if let Some(Twist { vx, vy, omega }) = velocity {
        robot.bench.message(DataVelocity { vx, vy, omega, ..DataVelocity::default() });
    }
    robot.pass(50).0
}

#[test]
fn a_base_with_wheels_turns_on_the_spot_and_goes_sideways_slowly_where_nothing_looks() {
    let blind = Settings::usual().speed_blind;
    for sideways in [false, true] {
        let guard = of_wheels(sideways, Some(Twist::default()), f64::INFINITY);
        assert!(guard.forward > 0.6 && guard.backward > 0.6, "{guard:?}");
        // The sides are not covered: the farthest corner is no faster than where nothing is sensed.
        let turns = [guard.turn_left, guard.turn_right];
        assert!(turns.iter().all(|turn| *turn > 0.1 && *turn * 0.8 <= blind), "{guard:?}");
        let aside = if sideways { [blind; 2] } else { [0.0; 2] };
        assert_eq!([guard.left, guard.right], aside);
    }
}

#[test]
fn beside_what_is_within_the_margin_it_turns_slowly() {
    // An echo ahead, within the margin: the corners pass it at 0.1 m/s at most.
    let guard = of_wheels(true, Some(Twist::default()), 0.13);
    assert!(guard.forward == 0.0 && guard.turn_left * 0.9 <= 0.1 && guard.turn_right * 0.9 <= 0.1, "{guard:?}");
    assert!(guard.backward > 0.6, "{guard:?}");
}

#[test]
fn a_base_with_wheels_whose_velocity_is_unknown_may_not_move() {
    let odd = |vx, vy, omega| Some(Twist { vx, vy, omega });
    for velocity in [None, odd(0.0, f64::NAN, 0.0), odd(0.0, 3.0, 0.0), odd(0.0, 0.0, 9.0)] {
        let guard = of_wheels(true, velocity, f64::INFINITY);
        let bounds = [guard.forward, guard.backward, guard.left, guard.right, guard.turn_left, guard.turn_right];
        assert_eq!((bounds, guard.code), ([0.0; 6], Hold::GuardMotion.code()), "{velocity:?}");
    }
}

/// A robot with a lidar ahead, ten revolutions a second of eight sectors with 45 beams, that drives at 0.5 m/s.
struct Scanned {
    bench: Bench,
    sectors: u64,
    /// Range of the beams in `within`, m; elsewhere nothing is.
    ahead: f32,
    /// Directions of what is ahead, degrees.
    within: std::ops::RangeInclusive<f64>,
}

/// Time of a sector.
const SECTOR: Duration = Duration::from_micros(12_500);

impl Scanned {
    fn new(evaluations: u32, ranging: Ranging) -> Self {
        let config = config(ranging);
        let lidar = crate::Lidar { name: "front".into(), mount: navitools::Pose::new(0.7, 0.0, 0.0), view: 6.3 };
        let settings = Settings { evaluations, reach: 4.0, ..config.settings };
        let guard = Guard::new(&Config { settings, lidars: vec![lidar], ..config }).expect("an outline");
        let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(guard)));
        bench.start();
        Self { bench, sectors: 0, ahead: f32::INFINITY, within: -10.0..=10.0 }
    }

    /// A sector, and the motion; the messages of the guard.
    fn sector(&mut self) -> Vec<DataGuard> {
        let begun = self.bench.now();
        self.bench.message(DataMotion { speed: 0.5, ..DataMotion::default() });
        self.bench.pass(SECTOR);
        let (turn, first) = (self.sectors / 8, self.sectors % 8 * 45);
        self.sectors += 1;
        let degrees = |k: u64| (first + k) as f64 - 180.0;
        let ranges =
            (0..45).map(|k| if self.within.contains(&degrees(k)) { self.ahead } else { f32::INFINITY }).collect();
        let scan = DataScan {
            timestamp: (begun.as_nanos() / 1000) as i64,
            name: "front".into(),
            revolution: turn as i64,
            angle_min: degrees(0).to_radians(),
            angle_step: 1f64.to_radians(),
            beam_time: SECTOR.as_secs_f64() / 45.0,
            range_max: 8.0,
            ranges,
            ..DataScan::default()
        };
        self.bench.message(scan);
        let said = self.bench.published().into_iter().filter_map(|message| match message {
            Message::LlDataGuard(guard) => Some(guard),
            _ => None,
        });
        said.collect()
    }
}

#[test]
fn what_comes_into_the_field_of_a_lidar_is_told_after_so_many_revolutions_and_at_once() {
    for evaluations in [1, 2] {
        let mut worst = Duration::ZERO;
        for phase in 0..200 {
            let mut robot = Scanned::new(evaluations, Ranging::Lidar);
            let before = (0..80 + phase % 8).flat_map(|_| robot.sector()).last().expect("20 Hz");
            assert!(before.forward > 0.6, "{before:?}");
            robot.bench.pass(Duration::from_micros(1_700 * (phase % 30)));
            robot.ahead = 0.4;
            let appeared = robot.bench.now();
            let told = loop {
                let said = robot.sector();
                if let Some(guard) = said.iter().find(|guard| guard.forward < 0.4) {
                    assert_eq!((guard.code, guard.subject.as_str()), (Hold::GuardStops.code(), "lidar front"));
                    break robot.bench.now().since(appeared);
                }
                assert!(robot.bench.now().since(appeared) < Duration::from_secs(1), "{phase}");
            };
            worst = worst.max(told);
        }
        // A sector is published when it is complete.
        let most = Duration::from_millis(100) * evaluations + SECTOR;
        assert!(worst <= most, "{evaluations}: {worst:?}");
    }
}

#[test]
fn what_one_sector_finds_does_not_wait_because_a_message_has_just_been_sent() {
    // The sector that sees what appears arrives at any time after the message of the 20 Hz, in step with it.
    for ms in 0..50 {
        let mut robot = Scanned::new(2, Ranging::Lidar);
        robot.within = 2.0..=10.0;
        robot.bench.pass(Duration::from_millis(ms));
        let before = (0..80).flat_map(|_| robot.sector()).last().expect("20 Hz");
        assert!(before.forward > 0.6, "{before:?}");
        robot.ahead = 0.4;
        let appeared = robot.bench.now();
        while robot.sector().iter().all(|guard| guard.forward >= 0.4) {
            assert!(robot.bench.now().since(appeared) < Duration::from_secs(1), "{ms}");
        }
        let took = robot.bench.now().since(appeared);
        // The fifth sector of the second revolution.
        assert!(took <= SECTOR * 13, "{ms} ms: {took:?}");
    }
}

#[test]
fn finds_are_published_at_most_each_10_ms_whatever_a_lidar_sends() {
    let mut robot = Scanned::new(1, Ranging::Lidar);
    for _ in 0..80 {
        robot.sector();
    }
    let mut count = 0;
    for n in 0..1000_u32 {
        robot.bench.pass(Duration::from_millis(1));
        if n % 40 == 0 {
            robot.bench.message(DataMotion { speed: 0.5, ..DataMotion::default() });
        }
        // Something new in each scan.
        let range = if n % 2 == 0 { 0.4 } else { 0.5 };
        robot.bench.message(DataScan {
            timestamp: (robot.bench.now().as_nanos() / 1000) as i64,
            name: "front".into(),
            angle_min: (-22f64).to_radians(),
            angle_step: 1f64.to_radians(),
            beam_time: 1e-5,
            range_max: 8.0,
            ranges: vec![range; 45],
            ..DataScan::default()
        });
        let published = robot.bench.published();
        count += published.iter().filter(|message| matches!(message, Message::LlDataGuard(_))).count();
    }
    // A hundred a second, and the 20 of each second between them.
    assert!((95..=121).contains(&count), "{count}");
}

#[test]
fn a_robot_with_both_moves_where_neither_is_unknown() {
    let mut robot = Scanned::new(2, Ranging::SonarAndLidar);
    let last = (0..80).flat_map(|_| robot.sector()).last().expect("20 Hz");
    assert_eq!((last.forward, last.code), (0.0, Hold::GuardUnknown.code()), "its sonars are silent");
    let mut robot = Scanned::new(2, Ranging::Sonar);
    let last = (0..80).flat_map(|_| robot.sector()).last().expect("20 Hz");
    assert_eq!(last.forward, 0.0, "its lidar does not count");
}
