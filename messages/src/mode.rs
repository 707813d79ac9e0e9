//! Operation modes of the planner by their names, and which of them drive.

use crate::middlelevel::CmdMode;

impl CmdMode {
    /// Names of the modes for commands and displays, by their numbers.
    pub const NAMES: [&'static str; 5] = ["manual", "route", "wait", "approach", "home"];

    /// Name of a mode; `None` for a number that this version does not know.
    #[must_use]
    pub fn name_of(mode: i8) -> Option<&'static str> {
        Self::NAMES.get(usize::try_from(mode).ok()?).copied()
    }

    /// Number of a mode by its name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<i8> {
        Self::NAMES.iter().position(|known| *known == name).map(|mode| mode as i8)
    }

    /// True if the mode is an order to drive: like a goal it releases the robot from a stop.
    #[must_use]
    pub const fn is_order_to_drive(&self) -> bool {
        matches!(self.mode, Self::APPROACH | Self::HOME)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_mode_has_its_name_and_only_two_are_orders_to_drive() {
        let modes = [CmdMode::MANUAL, CmdMode::ROUTE, CmdMode::WAIT, CmdMode::APPROACH, CmdMode::HOME];
        let drives = [false, false, false, true, true];
        for ((mode, name), drives) in modes.into_iter().zip(CmdMode::NAMES).zip(drives) {
            assert_eq!((CmdMode::name_of(mode), CmdMode::from_name(name)), (Some(name), Some(mode)));
            assert_eq!(CmdMode { mode, ..CmdMode::default() }.is_order_to_drive(), drives, "{name}");
        }
        assert_eq!((CmdMode::name_of(-1), CmdMode::name_of(5), CmdMode::from_name("HOME")), (None, None, None));
        assert!(!CmdMode { mode: 5, ..CmdMode::default() }.is_order_to_drive());
    }
}
