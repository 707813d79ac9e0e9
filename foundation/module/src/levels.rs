//! Thresholds of a module's texts and reports: those of the configuration, and those commanded while it runs.

use base::Level;
use messages::common::{CmdLevel, DataLevel};

/// A threshold: the configured one, unless another one is commanded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Threshold {
    configured: Option<Level>,
    commanded: Option<Level>,
}

impl Threshold {
    fn new(configured: Option<Level>) -> Self {
        Self { configured, commanded: None }
    }

    /// The threshold that applies; `None` if nothing is set.
    fn level(self) -> Option<Level> {
        self.commanded.or(self.configured)
    }

    /// The threshold after a command with this value.
    ///
    /// # Errors
    /// The value, which is neither a level nor a constant of `cmd_level_t`.
    fn after(self, value: i8) -> Result<Self, i8> {
        match value {
            CmdLevel::UNCHANGED => Ok(self),
            CmdLevel::CONFIGURED => Ok(Self { commanded: None, ..self }),
            other => {
                let commanded = Level::from_value(other).ok_or(other)?;
                Ok(Self { commanded: Some(commanded), ..self })
            }
        }
    }

    /// The level from which texts are printed or sent, as it is on the wire.
    fn of_texts(self) -> i8 {
        self.level().unwrap_or(Level::Info) as i8
    }
}

/// Thresholds of a module: from which level its texts and reports are printed, and from which they are sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Levels {
    print: Threshold,
    send: Threshold,
}

impl Levels {
    /// Those of the configuration; `None` where it sets none.
    #[must_use]
    pub fn new(print_from: Option<Level>, send_from: Option<Level>) -> Self {
        Self { print: Threshold::new(print_from), send: Threshold::new(send_from) }
    }

    /// Lowest level that is printed; `None` if nothing is set: INFO for texts, `robot.report_from` for reports.
    #[must_use]
    pub fn print(&self) -> Option<Level> {
        self.print.level()
    }

    /// Lowest level that is sent; `None` as with [`Levels::print`].
    #[must_use]
    pub fn send(&self) -> Option<Level> {
        self.send.level()
    }

    /// True if a command concerns the module of this name.
    #[must_use]
    pub fn are_meant(command: &CmdLevel, module: &str) -> bool {
        command.module == module || command.module == "*"
    }

    /// Obeys a command; returns true if a threshold changed. A command that is refused changes nothing.
    ///
    /// # Errors
    /// The first value that is neither a level nor a constant of `cmd_level_t`.
    pub fn obey(&mut self, command: &CmdLevel) -> Result<bool, i8> {
        let next = Self { print: self.print.after(command.print_from)?, send: self.send.after(command.send_from)? };
        let changed = next != *self;
        *self = next;
        Ok(changed)
    }

    /// Answer to a command, in the name of this module; `timestamp` in microseconds since the UNIX epoch.
    #[must_use]
    pub fn answer(&self, timestamp: i64, module: &str) -> DataLevel {
        DataLevel {
            timestamp,
            module: module.into(),
            print_from: self.print.of_texts(),
            send_from: self.send.of_texts(),
            commanded: self.print.commanded.is_some() || self.send.commanded.is_some(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(print_from: i8, send_from: i8) -> CmdLevel {
        CmdLevel { print_from, send_from, module: "toy".into(), ..CmdLevel::default() }
    }

    #[test]
    fn a_command_changes_what_it_names_until_it_is_taken_back() {
        let configured = Levels::new(Some(Level::Error), None);
        let mut levels = configured;
        assert_eq!(levels.obey(&command(CmdLevel::UNCHANGED, 0)), Ok(true));
        assert_eq!((levels.print(), levels.send()), (Some(Level::Error), Some(Level::Debug)));
        assert_eq!(levels.obey(&command(CmdLevel::UNCHANGED, 0)), Ok(false));
        assert_eq!(levels.obey(&command(2, CmdLevel::CONFIGURED)), Ok(true));
        assert_eq!((levels.print(), levels.send()), (Some(Level::Warning), None));
        let answer = levels.answer(7, "toy");
        assert_eq!((answer.print_from, answer.send_from, answer.commanded), (2, 1, true));
        assert_eq!(levels.obey(&command(CmdLevel::CONFIGURED, CmdLevel::CONFIGURED)), Ok(true));
        assert_eq!(levels, configured);
        assert!(!levels.answer(7, "toy").commanded);
    }

    #[test]
    fn a_value_that_is_no_level_refuses_the_whole_command() {
        for bad in (i8::MIN..=i8::MAX).filter(|value| !(-1..=3).contains(value) && *value != 127) {
            let mut levels = Levels::new(None, Some(Level::Warning));
            let before = levels;
            assert_eq!(levels.obey(&command(0, bad)), Err(bad));
            assert_eq!(levels.obey(&command(bad, 0)), Err(bad));
            assert_eq!(levels, before);
        }
    }

    #[test]
    fn a_command_is_meant_for_its_module_or_for_all() {
        let of = |module: &str| CmdLevel { module: module.into(), ..CmdLevel::default() };
        assert!(Levels::are_meant(&of("toy"), "toy") && Levels::are_meant(&of("*"), "toy"));
        assert!(!Levels::are_meant(&of("tool"), "toy") && !Levels::are_meant(&of(""), "toy"));
    }
}
