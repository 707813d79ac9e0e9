//! `ML_DATA_PERSONS` of a robot that stands, with a lidar in the middle of its rear axle.

use super::*;
use messages::middlelevel::DataPersons;

/// Revolutions per second, and their sectors of one tick each.
const SECTORS: u64 = 10;
const BEAMS: usize = 36;
/// Half the width of two legs side by side, and their distance before the middle of the person, m.
const LEGS_M: (f64, f64) = (0.08, 0.1);

impl Robot {
    /// A robot whose sonars send nothing, so that scans alone count.
    fn with_lidar() -> Self {
        let mut robot = Self::new();
        robot.deaf = true;
        robot
    }

    /// The next sector of the lidar, with a person at this place of the map.
    fn scan(&mut self, person: Option<Point>) {
        let step = 1f64.to_radians();
        let angle_min = (self.ticks % SECTORS) as f64 * BEAMS as f64 * step;
        let seen = person.map(|at| self.pose.inverse() * at);
        let seen = seen.map(|at| (libm::atan2(at.y, at.x), libm::hypot(at.x, at.y)));
        let range = |beam: usize| match seen {
            Some((angle, distance)) if wrap(angle_min + beam as f64 * step - angle).abs() < LEGS_M.0 / distance => {
                (distance - LEGS_M.1) as f32
            }
            _ => f32::INFINITY,
        };
        let scan = DataScan {
            timestamp: self.micros() - 10_000,
            name: "top".into(),
            status: DataScan::OK,
            angle_min,
            angle_step: step,
            beam_time: 0.01 / BEAMS as f64,
            range_max: 8.0,
            ranges: (0..BEAMS).map(range).collect(),
            ..DataScan::default()
        };
        self.bench.message(scan);
    }

    /// Lets time pass with the lidar and a person who starts at `from` with this velocity; the messages of that time.
    fn watch(&mut self, seconds: f64, person: Option<(Point, (f64, f64))>) -> Vec<(DataPersons, Option<Point>)> {
        let mut all = Vec::new();
        for n in 0..(seconds * 100.0) as u32 {
            let passed = f64::from(n) * STEP.as_secs_f64();
            let at = person.map(|(from, (vx, vy))| Point { x: from.x + vx * passed, y: from.y + vy * passed });
            self.scan(at);
            self.step();
            all.extend(self.persons.drain(..).map(|persons| (persons, at)));
        }
        all
    }
}

#[test]
fn a_person_who_walks_by_is_one_track_with_one_number() {
    let mut robot = Robot::with_lidar();
    robot.pass(1.0);
    for id in 1..3 {
        // Past the robot, 1.2 m beside its middle.
        let by = robot.watch(4.0, Some((Point { x: 4.5, y: 3.2 }, (-1.0, 0.1))));
        assert!((19..=21).contains(&by.len()), "5 Hz: {}", by.len());
        for (message, at) in &by[5..] {
            let [person] = &message.persons[..] else { panic!("{message:?}") };
            let at = at.expect("somebody");
            assert_eq!(person.id, id);
            assert!(at.distance(Point { x: person.x, y: person.y }) < 0.25, "{person:?} {at:?}");
            assert!((person.vx + 1.0).abs() < 0.3 && (person.vy - 0.1).abs() < 0.3, "{person:?}");
            assert!(person.sigma < 0.3 && person.velocity_sigma < 0.6, "{person:?}");
        }
        let after = robot.watch(3.0, None);
        assert_eq!(after.last().map(|(message, _)| message.persons.len()), Some(0), "gone");
    }
}

#[test]
fn without_anybody_the_list_is_empty_and_without_scans_there_is_none() {
    let mut robot = Robot::new();
    robot.pass(3.0);
    assert_eq!(robot.persons, [], "a robot without lidars publishes none");
    let mut robot = Robot::with_lidar();
    robot.pass(1.0);
    let nobody = robot.watch(2.0, None);
    assert!((9..=11).contains(&nobody.len()) && nobody.iter().all(|(message, _)| message.persons.is_empty()));
    let stands = robot.watch(2.0, Some((Point { x: 3.5, y: 2.0 }, (0.0, 0.0))));
    assert_eq!(stands.last().map(|(message, _)| message.persons.len()), Some(1));
    robot.pass(5.0);
    let (last, before) = robot.persons.split_last().expect("a last one");
    assert!(last.persons.is_empty() && before.len() <= 5, "{last:?} after {}", before.len());
    assert_eq!(before.iter().filter(|message| message.persons.is_empty()).count(), 0);
}

#[test]
fn without_a_position_nobody_is_placed_on_the_map() {
    let mut robot = Robot::with_lidar();
    robot.pass(1.0);
    let person = Some((Point { x: 3.5, y: 2.0 }, (0.0, 0.0)));
    assert!(robot.watch(2.0, person).last().is_some_and(|(message, _)| message.persons.len() == 1));
    robot.lost = true;
    let lost = robot.watch(4.0, person);
    assert!(lost.last().is_some_and(|(message, _)| message.persons.is_empty()), "{lost:?}");
    assert!(lost.len() <= 12, "no more than one empty message: {}", lost.len());
}
