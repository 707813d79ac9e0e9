//! Sends a robot in virtual time on its route once it is ready, as `advee goal --when-ready` does for a live one.

use crate::goal::by_route;
use crate::release::Release;
use base::{Duration, Instant};
use messages::Message;
use messages::middlelevel::{CmdGoal, DataEstimate};
use robot::config::Config;
use simulator::world::World;

/// Name of this program in its lines and commands.
pub const NAME: &str = "sim";
/// What was published longer ago is not known any more; the slowest of it comes at 5 Hz.
const CURRENT: Duration = Duration::from_millis(500);

/// A route that the robot is to drive as soon as it knows where it is, and nothing holds it.
pub struct Start {
    /// Absent once it was sent.
    goal: Option<CmdGoal>,
    located: Option<Instant>,
    homed: Option<Instant>,
    free: Option<Instant>,
    release: Release,
}

impl Start {
    /// The route of this name; absent if the world has none of that name, or the robot does not plan.
    pub fn new(name: &str, config: &Config, world: &World) -> Option<Self> {
        let plans = config.modules.iter().any(|module| module.name() == planner::NAME);
        let route = world.routes.iter().find(|route| route.name == name).filter(|_| plans)?;
        let goal = Some(by_route(route, 0.0));
        Some(Self { goal, located: None, homed: None, free: None, release: Release::default() })
    }

    /// True if the route was sent.
    pub fn is_done(&self) -> bool {
        self.goal.is_none()
    }

    /// What is to be sent, at the instant `now` and with this timestamp, after a message of the robot's.
    pub fn on_message(&mut self, timestamp: i64, now: Instant, message: &Message) -> Option<Message> {
        let mut act = None;
        match message {
            Message::MlDataEstimate(estimate) => {
                self.located = (estimate.quality >= DataEstimate::COARSE).then_some(now);
            }
            Message::LlDataHold(list) if list.is_of_motion() => {
                self.free = list.is_free().then_some(now);
                act = self.release.act(timestamp, NAME, list);
            }
            Message::LlDataMotion(motion) => self.homed = motion.homed.then_some(now),
            _ => return None,
        }
        let fresh = |at: Option<Instant>| at.is_some_and(|at| now.since(at) < CURRENT);
        if fresh(self.located) && fresh(self.homed) && fresh(self.free) {
            let goal = self.goal.take()?;
            return Some(CmdGoal { timestamp, id: (timestamp / 1000 % 1_000_000_000) as i32, ..goal }.into());
        }
        act
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Hold;
    use messages::lowlevel::{self, DataHold, DataMotion};

    fn start() -> Start {
        let goal = Some(CmdGoal::default());
        Start { goal, located: None, homed: None, free: None, release: Release::default() }
    }

    fn holds(holds: &[Hold]) -> Message {
        let row = |hold: &Hold| lowlevel::Hold { code: hold.code(), ..Default::default() };
        let holds = holds.iter().map(row).collect();
        DataHold { timestamp: 0, module: messages::MOTION_MODULE.into(), holds }.into()
    }

    #[test]
    fn the_route_is_sent_once_when_the_robot_is_located_homed_and_free() {
        let mut start = start();
        let at = Instant::from_millis;
        let homed: Message = DataMotion { homed: true, ..DataMotion::default() }.into();
        let located: Message = DataEstimate { quality: DataEstimate::FINE, ..DataEstimate::default() }.into();
        assert!(start.on_message(1, at(0), &homed).is_none());
        assert!(start.on_message(1, at(10), &holds(&[Hold::NobodyCommands])).is_none());
        // The others are too old by then.
        assert!(start.on_message(1, at(600), &located).is_none());
        assert!(start.on_message(1, at(610), &homed).is_none() && !start.is_done());
        let sent = start.on_message(2_000_000, at(620), &holds(&[Hold::NobodyCommands]));
        assert!(matches!(sent, Some(Message::MlCmdGoal(CmdGoal { timestamp: 2_000_000, id: 2000, .. }))), "{sent:?}");
        assert!(start.is_done() && start.on_message(3, at(630), &homed).is_none());
    }

    #[test]
    fn what_waits_for_an_operator_is_released() {
        let sent = start().on_message(1, Instant::ZERO, &holds(&[Hold::ToBeHomed]));
        assert!(matches!(sent, Some(Message::LlCmdHoming(_))), "{sent:?}");
        assert!(start().on_message(1, Instant::ZERO, &holds(&[Hold::PauseButton, Hold::ToBeHomed])).is_none());
    }
}
