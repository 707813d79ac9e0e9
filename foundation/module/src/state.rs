//! States of a module and the permitted transitions (values as in 2011).

use base::listed;
use messages::Hold;
use messages::common::DataState;

listed! {
    /// State of a module as announced in `CM_DATA_STATE`.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    #[repr(i8)]
    pub enum State {
        /// No announcement was received.
        Unknown = DataState::UNKNOWN => "UNKNOWN",
        /// Starting: initializes its devices, does not act.
        Init = DataState::INIT => "INIT",
        /// Stopped by an operator: device safe and in contact, no action; only an operator leads out.
        Stop = DataState::STOP => "STOP",
        /// Working.
        Run = DataState::RUN => "RUN",
        /// Its device is lost; it keeps retrying and returns to the previous state.
        Error = DataState::ERROR => "ERROR",
        /// Ending.
        Terminate = DataState::TERMINATE => "TERMINATE",
        /// Not acting for now; any sender may end it.
        Pause = DataState::PAUSE => "PAUSE",
    }
}

/// Origin of a change of state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Decision of the module.
    Itself,
    /// A `cmd_state_t` with `manual = false`.
    Command,
    /// A `cmd_state_t` with `manual = true`, from an operator.
    Manual,
}

impl State {
    /// State of a value on the wire; `None` for other values.
    #[must_use]
    pub fn from_value(value: i8) -> Option<Self> {
        Self::ALL.into_iter().find(|state| *state as i8 == value)
    }

    /// State of a name (`RUN`, in any case).
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.name().eq_ignore_ascii_case(name))
    }

    /// Cause for which a module in this state does not act; `None` in RUN.
    #[must_use]
    pub const fn hold(self) -> Option<Hold> {
        match self {
            Self::Run => None,
            Self::Unknown | Self::Init => Some(Hold::ModuleInit),
            Self::Pause => Some(Hold::ModulePaused),
            Self::Stop => Some(Hold::ModuleStopped),
            Self::Error => Some(Hold::ModuleError),
            Self::Terminate => Some(Hold::ModuleEnding),
        }
    }

    /// Transition table (docs/design.md, section 4): true if `cause` may lead from this state to `to`.
    ///
    /// The return from ERROR is not covered: it leads to the state from which ERROR was entered, even STOP.
    #[must_use]
    pub const fn allows(self, to: Self, cause: Cause) -> bool {
        use State::{Error, Init, Pause, Run, Stop, Terminate};
        let itself = matches!(cause, Cause::Itself);
        let manual = matches!(cause, Cause::Manual);
        match (self, to) {
            (Init, Run | Pause) | (Init | Run | Pause | Stop, Error) | (Error, Run | Pause) => itself,
            (Run, Pause) | (Pause, Run) | (Init | Run | Pause | Stop | Error, Terminate) => !itself,
            (Init | Run | Pause | Error, Stop) | (Stop, Run | Pause) => manual,
            _ => false,
        }
    }

    /// True if it may act on the world.
    #[must_use]
    pub const fn acts(self) -> bool {
        matches!(self, Self::Run)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write;

    /// The table as in the design, for comparison by eye.
    const TABLE: &str = "\
from \\ to | RUN    | PAUSE  | STOP   | ERROR  | TERMINATE
INIT      | itself | itself | manual | itself | any
RUN       | -      | any    | manual | itself | any
PAUSE     | any    | -      | manual | itself | any
STOP      | manual | manual | -      | itself | any
ERROR     | itself | itself | manual | -      | any
TERMINATE | -      | -      | -      | -      | -
";

    #[test]
    fn the_transition_table_matches_the_design() {
        use State::{Error, Init, Pause, Run, Stop, Terminate};
        let mut text = String::from("from \\ to | RUN    | PAUSE  | STOP   | ERROR  | TERMINATE\n");
        for from in [Init, Run, Pause, Stop, Error, Terminate] {
            write!(text, "{from:9}").unwrap();
            for to in [Run, Pause, Stop, Error, Terminate] {
                let allowed = [Cause::Itself, Cause::Command, Cause::Manual].map(|cause| from.allows(to, cause));
                let word = match allowed {
                    [false, false, false] => "-",
                    [true, false, false] => "itself",
                    [false, true, true] => "any",
                    [false, false, true] => "manual",
                    other => panic!("{from} to {to}: {other:?}"),
                };
                if to == Terminate {
                    write!(text, " | {word}").unwrap();
                } else {
                    write!(text, " | {word:6}").unwrap();
                }
            }
            text.push('\n');
        }
        assert_eq!(text, TABLE);
    }

    #[test]
    fn states_have_the_values_of_2011() {
        assert_eq!(State::ALL.map(|state| state as i8), [0, 1, 2, 3, 4, 5, 6]);
        assert_eq!(State::from_value(7), None);
        assert_eq!(State::from_name("pause"), Some(State::Pause));
    }
}
