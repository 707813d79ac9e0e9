//! Operation modes: what the planner drives to.

use messages::middlelevel::CmdMode;

/// Operation mode of `ML_CMD_MODE` and `ML_DATA_MODE`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(i8)]
pub enum Mode {
    /// The planner commands nothing, and refuses goals: only people drive.
    Manual = CmdMode::MANUAL,
    /// Goals as they are commanded; the mode after the start.
    #[default]
    Route = CmdMode::ROUTE,
    /// Stands where it is, and turns to a person who comes near, if the base turns on the spot.
    Wait = CmdMode::WAIT,
    /// Drives to the nearest person who stands.
    Approach = CmdMode::APPROACH,
    /// Drives to the configured home place.
    Home = CmdMode::HOME,
}

impl Mode {
    /// Mode of a number; `None` for one that does not exist.
    #[must_use]
    pub fn of(number: i8) -> Option<Self> {
        const ALL: [Mode; 5] = [Mode::Manual, Mode::Route, Mode::Wait, Mode::Approach, Mode::Home];
        ALL.into_iter().find(|mode| *mode as i8 == number)
    }

    /// True for the modes in which a person decides what the robot does.
    #[must_use]
    pub const fn attends(self) -> bool {
        matches!(self, Self::Wait | Self::Approach)
    }

    /// Number of the goals that the mode sets by itself, in `ML_DATA_GOAL`: negative, as senders of goals choose none.
    #[must_use]
    pub const fn goal_id(self) -> i32 {
        -(self as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_number_is_its_mode_and_others_are_none() {
        for number in -128..=127 {
            assert_eq!(Mode::of(number).map(|mode| mode as i8), (0..5).contains(&number).then_some(number));
        }
        assert_eq!(Mode::default(), Mode::Route);
        assert_eq!((Mode::Approach.goal_id(), Mode::Home.goal_id()), (-3, -4));
    }
}
