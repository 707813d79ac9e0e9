//! What a command to drive releases: causes that wait only for a deliberate act of an operator, since the command is
//! one. It does so only before the motion: a stop on the way is left for the operator to look at.

use super::Failed;
use super::bus::Tool;
use diagnostics::orders;
use messages::lowlevel::DataHold;
use messages::{Hold, Message};
use module::State;

/// What was released so far: the latch of PAUSE once; homing repeatedly until it begins, because a drive whose power
/// has just returned does not accept it yet.
#[derive(Debug, Default)]
pub struct Release {
    pause: bool,
}

/// An act that releases.
#[derive(Debug, PartialEq, Eq)]
enum Act {
    /// The PAUSE line was engaged, and is open: RUN for the module that moves the robot.
    Run,
    /// The steering is to be homed.
    Home,
}

impl Release {
    /// Publishes the act for which the causes in the list of the module that moves the robot wait.
    pub fn on_holds(&mut self, tool: &mut Tool, list: &DataHold) -> Result<(), Failed> {
        match self.act(tool.timestamp(), &tool.source, list) {
            Some(message) => tool.publish(message),
            None => Ok(()),
        }
    }

    /// That act as the message of `source`.
    pub fn act(&mut self, timestamp: i64, source: &str, list: &DataHold) -> Option<Message> {
        Some(match self.due(list)? {
            Act::Run => orders::manual(timestamp, &list.module, State::Run, source).into(),
            Act::Home => orders::home(timestamp, "steering").into(),
        })
    }

    fn due(&mut self, list: &DataHold) -> Option<Act> {
        // An act counts only when all other causes have ended; causes that concern other sources do not matter.
        let ends = |cause: Hold| {
            use Hold::{Contested, NotReleased, Overruled, PauseLatched, PlannerLatched, ToBeHomed};
            let of_sources = matches!(cause, Contested | NotReleased | Overruled | PlannerLatched);
            matches!(cause, PauseLatched | ToBeHomed) || of_sources || cause.is_idle() || cause.is_notice()
        };
        if !list.is_of_motion() || !list.holds.iter().all(|hold| hold.cause().is_some_and(ends)) {
            return None;
        }
        if list.has(Hold::PauseLatched) {
            return (!std::mem::replace(&mut self.pause, true)).then_some(Act::Run);
        }
        list.has(Hold::ToBeHomed).then_some(Act::Home)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::lowlevel;

    fn due(release: &mut Release, holds: &[Hold]) -> Option<Act> {
        let row = |hold: &Hold| lowlevel::Hold { code: hold.code(), ..Default::default() };
        let module = "driver_canbus".into();
        release.due(&DataHold { timestamp: 0, module, holds: holds.iter().map(row).collect() })
    }

    #[test]
    fn the_latch_of_pause_is_released_once_and_homing_until_it_begins() {
        let mut release = Release::default();
        assert_eq!(due(&mut release, &[Hold::PauseLatched, Hold::ToBeHomed]), Some(Act::Run));
        assert_eq!(due(&mut release, &[Hold::PauseLatched, Hold::ToBeHomed]), None);
        assert_eq!(due(&mut release, &[Hold::ToBeHomed, Hold::NobodyCommands]), Some(Act::Home));
        assert_eq!(due(&mut release, &[Hold::ToBeHomed]), Some(Act::Home));
        assert_eq!(due(&mut release, &[Hold::Homing]), None);
        assert_eq!(due(&mut release, &[Hold::PauseLatched]), None, "engaged and opened once more");
    }

    #[test]
    fn nothing_is_released_while_there_is_another_cause() {
        let mut release = Release::default();
        for other in [Hold::PauseButton, Hold::SpeedExceeded, Hold::FeedCut, Hold::CriticalModule, Hold::HomingFailed] {
            assert_eq!(due(&mut release, &[other, Hold::PauseLatched, Hold::ToBeHomed]), None, "{other:?}");
        }
        assert_eq!(due(&mut release, &[]), None);
        assert_eq!(due(&mut release, &[Hold::PauseLatched, Hold::PlannerLatched]), Some(Act::Run));
    }
}
