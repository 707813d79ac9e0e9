//! The node's life cycle (`lifecycle_msgs`), as the lifecycle manager of Nav2 and `ros2 lifecycle` expect it: ROS
//! commands the robot only while the node is active. What the node publishes goes on in every state.
//!
//! States and transitions are those of managed nodes (<https://design.ros2.org/articles/node_lifecycle.html>), with the
//! numbers of `lifecycle_msgs` 2.3.

mod bond;

pub use bond::Bond;

use crate::cdr::Reader;
use crate::topics::{Quality, Topic};
use lcm_gen::cdr::Writer;

/// A state in which the node stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// It waits for a manager.
    Unconfigured = 1,
    /// ROS commands nothing.
    Inactive = 2,
    /// ROS may command.
    Active = 3,
    /// Until the module is started again.
    Finalized = 4,
}

/// A service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Service {
    /// `change_state`.
    ChangeState,
    /// `get_state`.
    GetState,
    /// `get_available_states`.
    AvailableStates,
    /// `get_available_transitions`: those from the present state.
    AvailableTransitions,
    /// `get_transition_graph`: all.
    TransitionGraph,
}

/// A transition: number, label, state before it and state after it.
type Transition = (u8, &'static str, u8, u8);

/// States: number and label. Those from 10 on last as long as a transition does; here that is no time.
const STATES: [(u8, &str); 11] = [
    (0, "unknown"),
    (1, "unconfigured"),
    (2, "inactive"),
    (3, "active"),
    (4, "finalized"),
    (10, "configuring"),
    (11, "cleaningup"),
    (12, "shuttingdown"),
    (13, "activating"),
    (14, "deactivating"),
    (15, "errorprocessing"),
];

const TRANSITIONS: [Transition; 25] = [
    (1, "configure", 1, 10),
    (10, "transition_success", 10, 2),
    (11, "transition_failure", 10, 1),
    (12, "transition_error", 10, 15),
    (2, "cleanup", 2, 11),
    (20, "transition_success", 11, 1),
    (21, "transition_failure", 11, 2),
    (22, "transition_error", 11, 15),
    (3, "activate", 2, 13),
    (30, "transition_success", 13, 3),
    (31, "transition_failure", 13, 2),
    (32, "transition_error", 13, 15),
    (4, "deactivate", 3, 14),
    (40, "transition_success", 14, 2),
    (41, "transition_failure", 14, 3),
    (42, "transition_error", 14, 15),
    (5, "shutdown", 1, 12),
    (6, "shutdown", 2, 12),
    (7, "shutdown", 3, 12),
    (50, "transition_success", 12, 4),
    (51, "transition_failure", 12, 4),
    (52, "transition_error", 12, 15),
    (60, "transition_success", 15, 1),
    (61, "transition_failure", 15, 4),
    (62, "transition_error", 15, 4),
];

impl Service {
    /// All.
    pub const ALL: [Self; 5] =
        [Self::ChangeState, Self::GetState, Self::AvailableStates, Self::AvailableTransitions, Self::TransitionGraph];

    /// Name below that of the node, and type in ROS.
    #[must_use]
    pub const fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::ChangeState => ("change_state", "lifecycle_msgs/srv/ChangeState"),
            Self::GetState => ("get_state", "lifecycle_msgs/srv/GetState"),
            Self::AvailableStates => ("get_available_states", "lifecycle_msgs/srv/GetAvailableStates"),
            Self::AvailableTransitions => ("get_available_transitions", "lifecycle_msgs/srv/GetAvailableTransitions"),
            Self::TransitionGraph => ("get_transition_graph", "lifecycle_msgs/srv/GetAvailableTransitions"),
        }
    }
}

/// The life of the node.
#[derive(Clone, Debug)]
pub struct Lifecycle {
    state: State,
    /// Transitions that happened and are not yet published.
    happened: Vec<Transition>,
}

impl Lifecycle {
    /// Without leave to command the node is inactive for good; else it begins active, or, if it is `managed`,
    /// unconfigured.
    #[must_use]
    pub fn new(may_command: bool, managed: bool) -> Self {
        let state = match (may_command, managed) {
            (false, _) => State::Inactive,
            (true, true) => State::Unconfigured,
            (true, false) => State::Active,
        };
        Self { state, happened: Vec::new() }
    }

    /// True if ROS may command, as far as this is concerned.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.state == State::Active
    }

    /// The answer to a request; `None`: it is malformed. `acts`: the module acts, and ROS may command; otherwise an
    /// active node says that it is inactive, and no state changes.
    #[must_use]
    pub fn answer(&mut self, service: Service, sample: &[u8], acts: bool) -> Option<Vec<u8>> {
        let mut reader = Reader::new(sample)?;
        let mut cdr = Vec::new();
        let mut to = Writer::new(&mut cdr);
        let shown = if acts || self.state != State::Active { self.state } else { State::Inactive } as u8;
        match service {
            Service::ChangeState => {
                let (number, label) = (reader.u8()?, reader.string()?);
                to.bool(acts && self.change(number, label));
            }
            Service::GetState => state(&mut to, shown),
            Service::AvailableStates => {
                to.count(STATES.len());
                STATES.iter().for_each(|(number, _)| state(&mut to, *number));
            }
            Service::AvailableTransitions => {
                let from: Vec<_> = TRANSITIONS.iter().filter(|(_, _, from, _)| *from == shown).collect();
                to.count(from.len());
                from.into_iter().for_each(|transition| describe(&mut to, transition));
            }
            Service::TransitionGraph => {
                to.count(TRANSITIONS.len());
                TRANSITIONS.iter().for_each(|transition| describe(&mut to, transition));
            }
        }
        Some(cdr)
    }

    /// Makes a transition, named by its label or, without one, by its number. False if it is not possible now.
    fn change(&mut self, number: u8, label: &str) -> bool {
        let is_asked = |(of, name, from, _): &&Transition| {
            *from == self.state as u8 && if label.is_empty() { *of == number } else { *name == label }
        };
        let Some(begun) = TRANSITIONS.iter().find(is_asked) else { return false };
        let (_, _, _, through) = *begun;
        let Some(ended) = TRANSITIONS.iter().find(|(_, _, from, _)| *from == through) else { return false };
        self.state = match ended.3 {
            1 => State::Unconfigured,
            2 => State::Inactive,
            3 => State::Active,
            _ => State::Finalized,
        };
        self.happened.extend([*begun, *ended]);
        true
    }

    /// `lifecycle_msgs/msg/TransitionEvent` of each transition since the last call; `micros`: since the UNIX epoch.
    pub fn take_events(&mut self, micros: i64) -> Vec<Vec<u8>> {
        let events = std::mem::take(&mut self.happened).into_iter().map(|(number, label, from, goal)| {
            let mut cdr = Vec::new();
            let mut to = Writer::new(&mut cdr);
            to.i64(micros.saturating_mul(1000));
            to.u8(number);
            to.string(label);
            state(&mut to, from);
            state(&mut to, goal);
            cdr
        });
        events.collect()
    }
}

/// Topic of the transitions of the node `name`, below its namespace.
#[must_use]
pub fn topic(name: &str) -> Topic {
    Topic::new(&format!("/{name}/transition_event"), "lifecycle_msgs/msg/TransitionEvent", Quality::Reliable)
}

/// `lifecycle_msgs/msg/State`.
fn state(to: &mut Writer<'_>, number: u8) {
    to.u8(number);
    to.string(STATES.iter().find(|(other, _)| *other == number).map_or("", |(_, label)| label));
}

/// `lifecycle_msgs/msg/TransitionDescription`.
fn describe(to: &mut Writer<'_>, (number, label, from, goal): &Transition) {
    to.u8(*number);
    to.string(label);
    state(to, *from);
    state(to, *goal);
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::Random;

    const CONFIGURE: u8 = 1;
    const CLEANUP: u8 = 2;
    const ACTIVATE: u8 = 3;
    const DEACTIVATE: u8 = 4;
    const SHUTDOWN: [u8; 3] = [5, 6, 7];

    fn request(number: u8, label: &str) -> Vec<u8> {
        let mut cdr = Vec::new();
        let mut to = Writer::new(&mut cdr);
        to.u8(number);
        to.string(label);
        cdr
    }

    fn changed(life: &mut Lifecycle, number: u8, label: &str) -> bool {
        let answer = life.answer(Service::ChangeState, &request(number, label), true).unwrap();
        Reader::new(&answer).unwrap().bool().unwrap()
    }

    fn shown(life: &mut Lifecycle, acts: bool) -> (u8, String) {
        let answer = life.answer(Service::GetState, &[0, 1, 0, 0, 0], acts).unwrap();
        let mut reader = Reader::new(&answer).unwrap();
        (reader.u8().unwrap(), reader.string().unwrap().to_owned())
    }

    #[test]
    fn a_manager_brings_the_node_up_and_down_and_a_finalized_one_stays_so() {
        let mut life = Lifecycle::new(true, true);
        assert_eq!(shown(&mut life, true), (1, "unconfigured".into()));
        assert!(!changed(&mut life, ACTIVATE, "") && !changed(&mut life, DEACTIVATE, "") && !life.is_active());
        assert!(changed(&mut life, CONFIGURE, "") && !life.is_active());
        assert!(changed(&mut life, 0, "activate") && life.is_active());
        assert_eq!(shown(&mut life, true), (3, "active".into()));
        assert!(!changed(&mut life, CONFIGURE, ""));
        assert!(changed(&mut life, DEACTIVATE, "") && !life.is_active());
        assert!(changed(&mut life, CLEANUP, ""));
        assert!(!changed(&mut life, SHUTDOWN[2], ""), "that is the number from another state");
        assert!(changed(&mut life, SHUTDOWN[0], ""));
        assert_eq!(shown(&mut life, true), (4, "finalized".into()));
        for number in 0..=u8::MAX {
            assert!(!changed(&mut life, number, "") && !changed(&mut life, number, "configure"));
        }
    }

    #[test]
    fn a_node_begins_active_unless_it_is_managed_and_inactive_where_ros_may_not_command() {
        assert!(Lifecycle::new(true, false).is_active());
        for managed in [false, true] {
            let mut life = Lifecycle::new(false, managed);
            assert_eq!(shown(&mut life, false), (2, "inactive".into()));
            let answer = life.answer(Service::ChangeState, &request(ACTIVATE, ""), false).unwrap();
            assert_eq!(answer[4..], [0]);
            assert!(!life.is_active());
        }
    }

    #[test]
    fn a_module_in_pause_shows_an_inactive_node_and_changes_nothing() {
        let mut life = Lifecycle::new(true, false);
        assert_eq!(shown(&mut life, false), (2, "inactive".into()));
        let answer = life.answer(Service::ChangeState, &request(DEACTIVATE, ""), false).unwrap();
        assert_eq!(answer[4..], [0]);
        assert_eq!(shown(&mut life, true), (3, "active".into()));
    }

    #[test]
    fn transitions_are_listed_by_state_and_published_with_the_state_that_they_pass() {
        let mut life = Lifecycle::new(true, false);
        let mut count = |service| {
            let answer = life.answer(service, &[0, 1, 0, 0, 0], true).unwrap();
            Reader::new(&answer).unwrap().u32()
        };
        assert_eq!(count(Service::AvailableStates), Some(11));
        assert_eq!(count(Service::AvailableTransitions), Some(2));
        assert_eq!(count(Service::TransitionGraph), Some(25));
        assert!(changed(&mut life, DEACTIVATE, ""));
        let events = life.take_events(5);
        let read = |event: &[u8]| {
            let mut reader = Reader::new(event).unwrap();
            assert_eq!(reader.u64(), Some(5000));
            [(); 3].map(|()| (reader.u8().unwrap(), reader.string().unwrap().to_owned()).0)
        };
        assert_eq!(events.iter().map(|event| read(event)).collect::<Vec<_>>(), [[4, 3, 14], [40, 14, 2]]);
        assert!(life.take_events(6).is_empty());
    }

    #[test]
    fn random_requests_are_survived() {
        let mut random = Random::new(9);
        let mut life = Lifecycle::new(true, false);
        for _ in 0..20_000 {
            let length = random.index(40);
            let mut bytes = random.bytes(length);
            bytes.splice(..4.min(length), [0, 1, 0, 0]);
            for service in Service::ALL {
                assert!(life.answer(service, &bytes, true).is_none_or(|answer| answer.len() < 4096));
            }
        }
    }
}
