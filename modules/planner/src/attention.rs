//! The person to whom the robot attends in the modes WAIT and APPROACH: the nearest one who stands, among those whom
//! the planner tracks. Anything of a leg's size that the map does not have is tracked.

use crate::ahead;
use crate::config::{Behaviour, Body};
use crate::goal::Waypoint;
use crate::obstacles::Obstacles;
use crate::people::Person;
use base::{Duration, Instant};
use navitools::{Point, Pose, wrap};

/// Greatest distance between two places of the same person, m.
const SAME_PERSON_M: f64 = 0.6;
/// Speed above which a person walks, if it also exceeds its uncertainty, m/s.
const WALKS_MPS: f64 = 0.5;
/// Time without a confirmed track after which the person has left.
const LEFT_AFTER: Duration = Duration::from_secs(2);
/// Distance by which another person must be nearer to become the one that is attended to, m.
const NEARER_M: f64 = 0.5;
/// Distance of a person from the place for which the goal was set above which the goal is set again, m.
const MOVED_M: f64 = 0.5;
/// Distance beyond `approach_distance_m` from which the robot drives up to a person, and distance within it at which
/// it stops on the way, m.
const BEGIN_BEYOND_M: f64 = 0.3;
const STOP_WITHIN_M: f64 = 0.1;
/// Least distance at which the robot can stand before the middle of a person, m: beyond `people_margin_m`; and beyond
/// `margin_m` and `stop_distance_m`, which count from the leg, with the length that the guard keeps and the raster in
/// which the path is checked.
const BEYOND_PEOPLE_M: f64 = 0.15;
const BEYOND_LEG_M: f64 = 0.4;
/// Distance within which the robot turns to a person, m, and direction off the heading from which it does, rad; more
/// than the deviation with which a turn ends.
const TURN_WITHIN_M: f64 = 2.0;
const TURN_FROM_RAD: f64 = 0.5;
/// Time after a goal that failed before the next one.
const REST: Duration = Duration::from_secs(10);

/// Person that is attended to.
#[derive(Clone, Debug, Default)]
pub struct Attention {
    /// Place in the map, m, and when a track was last confirmed there.
    person: Option<(Point, Instant)>,
    /// What the present goal was set for.
    aim: Option<Aim>,
    /// No goal is set before this instant: the last one failed.
    rests_until: Option<Instant>,
}

/// What a goal is set for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Place of the person at that time, m.
    pub person: Point,
    /// True if the robot drives to the person, false if it only turns.
    pub drives: bool,
}

/// What a robot that attends to a person does next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// Nothing: it stands where it shall, or goes on to where it goes.
    Nothing,
    /// Stands.
    Stop,
    /// Drives to this waypoint.
    Go(Waypoint),
}

/// What a robot that attends to people may do.
#[derive(Clone, Copy, Debug)]
pub struct Manner {
    /// Distance from the robot to the middle of a person up to which it drives, m; `None`: it stays at its place.
    pub distance: Option<f64>,
    /// It turns on the spot.
    pub turns: bool,
}

/// Distance from the robot to the middle of a person at which it stops in mode APPROACH, m: `approach_distance_m`, but
/// not where its other distances stop it before, since it would try to arrive there again and again.
#[must_use]
pub fn stopping_distance(behaviour: &Behaviour) -> f64 {
    let Behaviour { approach_distance, people_margin, margin, stop_distance, .. } = *behaviour;
    approach_distance.max(people_margin + BEYOND_PEOPLE_M).max(margin + stop_distance + BEYOND_LEG_M)
}

impl Attention {
    /// Chooses the person at `now`; called in each step of the control loop.
    pub fn look(&mut self, now: Instant, robot: Pose, body: &Body, obstacles: &Obstacles) {
        let robot_from_map = robot.inverse().to_outer();
        let gap = |at: Point| ahead::gap(body, robot_from_map(at));
        if let Some((at, seen)) = self.person {
            let there = |person: &Person| person.confirmed && person.at.distance(at) < SAME_PERSON_M;
            let off = |person: &Person| person.at.distance(at);
            let same = obstacles.people(now).filter(there).min_by(|a, b| off(a).total_cmp(&off(b)));
            self.person = match same {
                Some(person) if walks(&person) => None,
                Some(person) => Some((person.at, now)),
                None => Some((at, seen)).filter(|_| now.since(seen) < LEFT_AFTER),
            };
        }
        let standing = obstacles.people(now).filter(|person| person.confirmed && person.stands && !walks(person));
        let nearest = standing.min_by(|a, b| gap(a.at).total_cmp(&gap(b.at)));
        if let Some(Person { at, .. }) = nearest
            && self.person.is_none_or(|(known, _)| gap(at) + NEARER_M < gap(known))
        {
            self.person = Some((at, now));
        }
    }

    /// Place of the person in the map, m; `None`: nobody is there.
    #[must_use]
    pub fn person(&self) -> Option<Point> {
        self.person.map(|(at, _)| at)
    }

    /// What the present goal was set for.
    #[must_use]
    pub fn aim(&self) -> Option<Aim> {
        self.aim
    }

    /// True while no goal is set since the last one failed.
    #[must_use]
    pub fn rests(&self, now: Instant) -> bool {
        self.rests_until.is_some_and(|until| now < until)
    }

    /// The goal that was set failed.
    pub fn fail(&mut self, now: Instant) {
        self.aim = None;
        self.rests_until = Some(now + REST);
    }

    /// What a robot that drives to a person, or turns to one, does next.
    pub fn on_the_way(&mut self, robot: Pose, body: &Body, manner: Manner) -> Step {
        let Some((person, aim)) = self.person().zip(self.aim) else {
            self.aim = None;
            return Step::Stop;
        };
        let gap = ahead::gap(body, robot.inverse() * person);
        if aim.drives && manner.distance.is_some_and(|distance| gap < distance - STOP_WITHIN_M) {
            self.aim = None;
            return Step::Stop;
        }
        if person.distance(aim.person) <= MOVED_M {
            return Step::Nothing;
        }
        self.aim = None;
        match self.at_rest(robot, body, manner) {
            // It shall be where it is.
            Step::Nothing => Step::Stop,
            step => step,
        }
    }

    /// What a robot that stands does next.
    pub fn at_rest(&mut self, robot: Pose, body: &Body, manner: Manner) -> Step {
        self.aim = None;
        let Some(person) = self.person() else { return Step::Nothing };
        let gap = ahead::gap(body, robot.inverse() * person);
        let heading = libm::atan2(person.y - robot.y, person.x - robot.x);
        // With its front towards the person.
        let left = robot.point().distance(person) - body.front;
        let (drives, waypoint) = match manner.distance {
            Some(distance) if left > distance + BEGIN_BEYOND_M => {
                let (sin, cos) = libm::sincos(heading);
                let keep = body.front + distance;
                let at = Point { x: person.x - keep * cos, y: person.y - keep * sin };
                // A base that steers would manoeuvre for the heading, beside a person.
                (true, Waypoint::new(at, manner.turns.then_some(heading)))
            }
            _ if manner.turns && gap < TURN_WITHIN_M && wrap(heading - robot.theta.radians()).abs() > TURN_FROM_RAD => {
                (false, Waypoint::new(robot.point(), Some(heading)))
            }
            _ => return Step::Nothing,
        };
        self.aim = Some(Aim { person, drives });
        Step::Go(waypoint)
    }
}

fn walks(person: &Person) -> bool {
    let speed = libm::hypot(person.velocity.0, person.velocity.1);
    speed > WALKS_MPS.max(person.velocity_sigma)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BODY: Body = Body { wheelbase: 0.6, front: 0.75, rear: 0.15, width: 0.6, shape: None };
    const DRIVES: Manner = Manner { distance: Some(1.2), turns: false };
    const TURNS: Manner = Manner { distance: None, turns: true };

    fn with(x: f64, y: f64) -> Attention {
        Attention { person: Some((Point { x, y }, Instant::ZERO)), ..Attention::default() }
    }

    #[test]
    fn it_drives_up_to_the_distance_and_not_nearer() {
        let robot = Pose::new(0.0, 0.0, 0.0);
        let mut attention = with(4.0, 0.0);
        let Step::Go(to) = attention.at_rest(robot, &BODY, DRIVES) else { panic!("it goes") };
        assert!((to.at.x - (4.0 - 0.75 - 1.2)).abs() < 1e-9 && to.at.y == 0.0 && to.heading.is_none(), "{to:?}");
        assert_eq!(attention.aim(), Some(Aim { person: Point { x: 4.0, y: 0.0 }, drives: true }));
        assert_eq!(attention.on_the_way(robot, &BODY, DRIVES), Step::Nothing);
        assert_eq!(attention.on_the_way(Pose::new(2.2, 0.0, 0.0), &BODY, DRIVES), Step::Stop, "1.05 m before");
        for near in [0.75 + 1.0, 0.75 + 1.2, 0.75 + 1.45] {
            assert_eq!(with(near, 0.0).at_rest(robot, &BODY, DRIVES), Step::Nothing, "{near}");
        }
    }

    #[test]
    fn a_person_who_moved_is_followed_and_one_who_left_is_not() {
        let robot = Pose::new(0.0, 0.0, 0.0);
        let mut attention = with(4.0, 0.0);
        attention.at_rest(robot, &BODY, DRIVES);
        attention.person = Some((Point { x: 4.0, y: 0.8 }, Instant::ZERO));
        assert!(matches!(attention.on_the_way(robot, &BODY, DRIVES), Step::Go(_)));
        attention.person = None;
        assert_eq!((attention.on_the_way(robot, &BODY, DRIVES), attention.aim()), (Step::Stop, None));
    }

    #[test]
    fn only_a_base_that_turns_on_the_spot_turns_to_a_person_and_only_to_one_who_is_near() {
        let robot = Pose::new(1.0, 2.0, 0.0);
        let Step::Go(to) = with(1.3, 3.5).at_rest(robot, &BODY, TURNS) else { panic!("it turns") };
        assert_eq!(to.at, robot.point());
        assert!((to.heading.unwrap() - libm::atan2(1.5, 0.3)).abs() < 1e-9);
        let stays = Manner { turns: false, ..TURNS };
        for (person, manner) in [((1.3, 3.5), stays), ((1.3, 5.0), TURNS), ((3.0, 2.5), TURNS)] {
            assert_eq!(with(person.0, person.1).at_rest(robot, &BODY, manner), Step::Nothing, "{person:?}");
        }
    }

    #[test]
    fn it_does_not_aim_at_a_place_before_which_other_distances_stop_it() {
        use settings::Section;
        let usual = Behaviour::usual();
        assert_eq!(stopping_distance(&usual), usual.approach_distance);
        let near = Behaviour { approach_distance: 0.5, ..usual };
        let people = Behaviour { people_margin: 0.7, ..near };
        assert!((stopping_distance(&people) - (0.7 + BEYOND_PEOPLE_M)).abs() < 1e-9);
        let things = Behaviour { margin: 0.3, stop_distance: 0.2, ..near };
        assert!((stopping_distance(&things) - (0.5 + BEYOND_LEG_M)).abs() < 1e-9);
    }

    #[test]
    fn after_a_failure_it_rests() {
        let mut attention = with(4.0, 0.0);
        let at = Instant::from_millis(1000);
        assert!(!attention.rests(at));
        attention.fail(at);
        assert!(attention.rests(at + Duration::from_secs(9)) && !attention.rests(at + Duration::from_secs(10)));
    }
}
