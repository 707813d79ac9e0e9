//! What the report of a soak counts: contacts by who moved into whom, goals, and who drove.

use crate::check::Hits;
use messages::middlelevel::DataGoal;
use messages::{Message, lowlevel, simulation};
use simulator::people::{Contact, Mover};

/// Contacts of the robot's body, by who moved into whom.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contacts {
    /// The robot, into a wall, a column or another thing.
    pub robot_into_wall: Touches,
    /// The robot, into a person.
    pub robot_into_person: Touches,
    /// A person, into the robot.
    pub person_into_robot: Touches,
    /// Those of the robot at more than 0.05 m/s with what was in sight of a lidar for the time that it takes to stop.
    /// Counted only with a guard that uses lidars.
    pub in_sight: Touches,
    /// All others of the robot at such a speed: with what came out of hiding, or was never in sight.
    pub out_of_hiding: Touches,
}

/// Contacts of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Touches {
    /// Number.
    pub count: u64,
    /// Greatest speed of the one that moved, towards the other, m/s; 0 without a contact.
    pub fastest_mps: f64,
}

impl Contacts {
    /// Counts a contact.
    pub(super) fn take(&mut self, contact: &Contact) {
        match (contact.mover, contact.person) {
            (Mover::Robot, None) => self.robot_into_wall.take(contact.robot_mps),
            (Mover::Robot, Some(_)) => self.robot_into_person.take(contact.robot_mps),
            (Mover::Person, person) => self.person_into_robot.take(person.map_or(0.0, |person| person.towards_mps)),
        }
    }

    /// Adds those of another episode.
    pub fn add(&mut self, other: &Self) {
        self.robot_into_wall.add(other.robot_into_wall);
        self.robot_into_person.add(other.robot_into_person);
        self.person_into_robot.add(other.person_into_robot);
        self.in_sight.add(other.in_sight);
        self.out_of_hiding.add(other.out_of_hiding);
    }
}

impl From<Hits> for Touches {
    fn from(Hits { count, fastest_mps }: Hits) -> Self {
        Self { count, fastest_mps }
    }
}

impl Touches {
    fn take(&mut self, mps: f64) {
        self.add(Self { count: 1, fastest_mps: mps });
    }

    fn add(&mut self, other: Self) {
        self.count += other.count;
        self.fastest_mps = self.fastest_mps.max(other.fastest_mps);
    }
}

/// Goals that the operator sent to the planner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Goals {
    /// Sent.
    pub sent: u64,
    /// Reached.
    pub reached: u64,
    /// Failed, or blocked: then the operator drives by hand at once. The others ended by a stop, after their time, or
    /// with the episode.
    pub given_up: u64,
}

impl Goals {
    /// Counts what the planner reports about the goal under way.
    pub(super) fn take(&mut self, goal: &DataGoal) {
        match goal.status {
            DataGoal::REACHED => self.reached += 1,
            DataGoal::BLOCKED | DataGoal::FAILED => self.given_up += 1,
            _ => {}
        }
    }

    /// Adds those of another episode.
    pub fn add(&mut self, other: &Self) {
        self.sent += other.sent;
        self.reached += other.reached;
        self.given_up += other.given_up;
    }
}

/// Distances by whose commands the robot drove, m. A robot that brakes is counted for its last source.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shares {
    /// The operator.
    pub operator: f64,
    /// The planner.
    pub planner: f64,
    /// Sources that are faults of the scenario, and motion without a source.
    pub others: f64,
}

impl Shares {
    /// Adds those of another episode.
    pub fn add(&mut self, other: &Self) {
        self.operator += other.operator;
        self.planner += other.planner;
        self.others += other.others;
    }
}

/// Whose commands the robot obeys, and how far it has driven by them.
#[derive(Debug, Default)]
pub(super) struct Driven {
    pub shares: Shares,
    source: Option<Source>,
    place: Option<(f64, f64)>,
}

#[derive(Clone, Copy, Debug)]
enum Source {
    Operator,
    Planner,
    Other,
}

impl Driven {
    /// Processes a message of the robot or of the simulator. Returns the distance driven since the last true pose, m.
    pub fn observe(&mut self, message: &Message, operator: &str, planner: &str) -> f64 {
        match message {
            Message::LlDataMotion(motion) => self.on_motion(motion, operator, planner),
            Message::SimDataTruth(truth) => return self.on_truth(truth),
            _ => {}
        }
        0.0
    }

    fn on_motion(&mut self, motion: &lowlevel::DataMotion, operator: &str, planner: &str) {
        match motion.source.as_str() {
            // It brakes.
            "" => {}
            source if source == operator => self.source = Some(Source::Operator),
            source if source == planner => self.source = Some(Source::Planner),
            _ => self.source = Some(Source::Other),
        }
    }

    fn on_truth(&mut self, truth: &simulation::DataTruth) -> f64 {
        let place = (truth.x, truth.y);
        let from = self.place.replace(place).unwrap_or(place);
        let distance = libm::hypot(place.0 - from.0, place.1 - from.1);
        let share = match self.source {
            Some(Source::Operator) => &mut self.shares.operator,
            Some(Source::Planner) => &mut self.shares.planner,
            Some(Source::Other) | None => &mut self.shares.others,
        };
        *share += distance;
        distance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contacts_are_counted_by_who_moved_into_whom_with_the_greatest_speed() {
        let mut contacts = Contacts::default();
        for line in [
            "contact: by robot, robot 0.400 m/s, wall, at 0.000 0.000",
            "contact: by robot, robot 0.200 m/s, wall, at 0.000 0.000",
            "contact: by robot, robot 0.300 m/s, person 3 -0.500 of 0.500 m/s, at 1.000 0.000",
            "contact: by person, robot -0.100 m/s, person 3 1.250 of 1.250 m/s, at 1.000 0.000",
        ] {
            contacts.take(&line.parse().unwrap());
        }
        let touches = |count, fastest_mps| Touches { count, fastest_mps };
        assert_eq!(contacts.robot_into_wall, touches(2, 0.4));
        assert_eq!((contacts.robot_into_person, contacts.person_into_robot), (touches(1, 0.3), touches(1, 1.25)));
        let mut sum = contacts;
        sum.add(&contacts);
        assert_eq!(sum.robot_into_wall, touches(4, 0.4));
    }

    #[test]
    fn a_goal_that_is_blocked_or_fails_is_given_up() {
        let mut goals = Goals { sent: 4, ..Goals::default() };
        for status in [DataGoal::DRIVING, DataGoal::BLOCKED, DataGoal::FAILED, DataGoal::REACHED, DataGoal::CANCELLED] {
            goals.take(&DataGoal { status, ..DataGoal::default() });
        }
        assert_eq!(goals, Goals { sent: 4, reached: 1, given_up: 2 });
    }

    #[test]
    fn a_distance_is_counted_for_the_source_that_is_obeyed_or_was_before_it_brakes() {
        let mut driven = Driven::default();
        let mut all = 0.0;
        let mut x = 0.0;
        for (source, metres) in [("", 0.0), ("", 1.0), ("op", 2.0), ("", 3.0), ("planner", 4.0), ("gamepad", 5.0)] {
            let motion = lowlevel::DataMotion { source: source.into(), ..Default::default() };
            driven.observe(&motion.into(), "op", "planner");
            x += metres;
            all += driven.observe(&simulation::DataTruth { x, ..Default::default() }.into(), "op", "planner");
        }
        assert_eq!(driven.shares, Shares { operator: 5.0, planner: 4.0, others: 6.0 });
        assert_eq!(all, 15.0);
    }
}
