//! Faults of several subjects, and a listener that joins late: two boards are lost, one comes back, a module dies.

use super::Robot;
use base::{Fault, Instant};
use diagnostics::{Config, Knowledge, Model};
use messages::common::CmdState;
use messages::simulation::CmdFault;
use module::State;
use sim::host::News;
use std::cell::RefCell;
use std::rc::Rc;

/// View model of a listener, from the instant at which it joins.
#[derive(Clone)]
struct Listener(Rc<RefCell<Model>>);

impl Listener {
    fn join(robot: &mut Robot) -> Self {
        let model = Rc::new(RefCell::new(Model::new(Config::default())));
        let keep = model.clone();
        robot.machine.observe(move |now, news| {
            if let News::Message { message, .. } = news {
                keep.borrow_mut().receive(now, &message.channel_name(), 64, Some((*message).clone()));
            }
        });
        Self(model)
    }

    /// Lost boards of `driver_rs485a`: subject, active, known.
    fn lost(&self, now: Instant) -> Vec<(String, bool, bool)> {
        let model = self.0.borrow();
        let groups = model.errors.groups(now).into_iter();
        let lost = groups.filter(|group| group.module == "driver_rs485a" && group.number == Fault::BoardLost as i32);
        let mut lost: Vec<_> = lost.map(|group| (group.subject.clone(), group.standing, group.known)).collect();
        lost.sort();
        lost
    }
}

fn fault(robot: &mut Robot, target: &str, fault: &str) {
    let now = robot.machine.now();
    let command = CmdFault { target: target.into(), fault: fault.into(), ..CmdFault::default() };
    robot.machine.inject(now, command);
}

fn command(robot: &mut Robot, state: State) {
    let (now, module) = (robot.machine.now(), "driver_rs485a".into());
    let command = CmdState { timestamp: 0, module, state: state as i8, manual: true, source: "test".into() };
    robot.machine.inject(now, command);
}

fn of(boards: &[(&str, bool, bool)]) -> Vec<(String, bool, bool)> {
    boards.iter().map(|(subject, active, known)| ((*subject).into(), *active, *known)).collect()
}

#[test]
fn a_board_that_comes_back_leaves_the_other_s_fault_and_a_late_listener_knows_it() {
    let mut robot = Robot::ready(1);
    let early = Listener::join(&mut robot);
    fault(&mut robot, "sd1_front", "silent");
    fault(&mut robot, "sd1_rear", "silent");
    robot.pass(40.0);
    let now = robot.machine.now();
    assert_eq!(early.lost(now), of(&[("sd1_front", true, true), ("sd1_rear", true, true)]));

    let late = Listener::join(&mut robot);
    robot.pass(1.0);
    let now = robot.machine.now();
    assert_eq!(late.lost(now), early.lost(now), "both, a second after it joined");

    fault(&mut robot, "sd1_front", "none");
    robot.pass(10.0);
    let now = robot.machine.now();
    for listener in [&early, &late] {
        assert_eq!(listener.lost(now), of(&[("sd1_front", false, true), ("sd1_rear", true, true)]));
    }
    let later = Listener::join(&mut robot);
    robot.pass(1.0);
    let now = robot.machine.now();
    assert_eq!(later.lost(now), of(&[("sd1_rear", true, true)]));
    assert_eq!(later.0.borrow().errors.active("driver_rs485b", now), Some(0));
}

#[test]
fn the_faults_of_a_module_without_a_process_are_unknown() {
    let mut robot = Robot::ready(1);
    let early = Listener::join(&mut robot);
    fault(&mut robot, "sd1_rear", "silent");
    robot.pass(40.0);
    // Held down by command.
    command(&mut robot, State::Terminate);
    robot.pass(3.0);
    let late = Listener::join(&mut robot);
    robot.pass(1.0);
    let now = robot.machine.now();
    assert_eq!(early.lost(now), of(&[("sd1_rear", true, false)]));
    assert_eq!(late.lost(now), []);
    for listener in [&early, &late] {
        let model = listener.0.borrow();
        assert_eq!(model.errors.knowledge("driver_rs485a", now), Knowledge::Unknown);
        assert_eq!(model.errors.knowledge("driver_rs485b", now), Knowledge::Listed);
    }
    // The module is back: it lists its current faults.
    command(&mut robot, State::Run);
    robot.pass(0.5);
    let now = robot.machine.now();
    assert_eq!(late.0.borrow().errors.knowledge("driver_rs485a", now), Knowledge::Listed);
}
