//! Sources of the PAUSE line, from the names in `LL_EVENT_STOP`.

use crate::Hold;
use base::listed;

listed! {
    /// Source of PAUSE. The numbers are those of the power controller; 0 is a source without a known name.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    #[repr(u8)]
    pub enum StopSource {
        /// Name outside the contract, or an empty one.
        Unknown = 0 => "",
        /// Bumper switch 1, in front.
        Bumper1 = 1 => "bumper1",
        /// Bumper switch 2, in front.
        Bumper2 = 2 => "bumper2",
        /// Bumper switch 3, in front.
        Bumper3 = 3 => "bumper3",
        /// Bumper switch 4, in front.
        Bumper4 = 4 => "bumper4",
        /// Bumper switch 5, at the rear.
        Bumper5 = 5 => "bumper5",
        /// Bumper switch 6, at the rear.
        Bumper6 = 6 => "bumper6",
        /// Bumper switch 7, at the rear.
        Bumper7 = 7 => "bumper7",
        /// Bumper switch 8, at the rear.
        Bumper8 = 8 => "bumper8",
        /// Floor sensors of the front ranging board.
        Sd1Front = 0x10 => "sd1_front",
        /// Floor sensors of the rear ranging board.
        Sd1Rear = 0x11 => "sd1_rear",
        /// Stop button.
        Button = 0x20 => "button",
    }
}

impl StopSource {
    /// Source of a name, as in `source` of `LL_EVENT_STOP`. The only parser of these names.
    #[must_use]
    pub fn from_name(name: &str) -> Self {
        Self::ALL.into_iter().find(|source| !name.is_empty() && source.name() == name).unwrap_or(Self::Unknown)
    }

    /// Name for operators.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Unknown => "an unknown source",
            Self::Bumper1 => "bumper 1",
            Self::Bumper2 => "bumper 2",
            Self::Bumper3 => "bumper 3",
            Self::Bumper4 => "bumper 4",
            Self::Bumper5 => "bumper 5",
            Self::Bumper6 => "bumper 6",
            Self::Bumper7 => "bumper 7",
            Self::Bumper8 => "bumper 8",
            Self::Sd1Front => "the front floor sensors",
            Self::Sd1Rear => "the rear floor sensors",
            Self::Button => "the red button",
        }
    }

    /// Name as in `source` of `LL_EVENT_STOP` for operators; one outside the contract as it is.
    #[must_use]
    pub fn in_words(name: &str) -> String {
        match Self::from_name(name) {
            Self::Unknown if !name.is_empty() => name.into(),
            known => known.words().into(),
        }
    }

    /// True for a bumper or a floor ranger at the front, false for one at the rear, `None` for any other source.
    #[must_use]
    pub const fn is_front(self) -> Option<bool> {
        match self {
            Self::Bumper1 | Self::Bumper2 | Self::Bumper3 | Self::Bumper4 | Self::Sd1Front => Some(true),
            Self::Bumper5 | Self::Bumper6 | Self::Bumper7 | Self::Bumper8 | Self::Sd1Rear => Some(false),
            Self::Unknown | Self::Button => None,
        }
    }

    /// True for the floor rangers of a board: they see no floor.
    #[must_use]
    pub const fn is_floor(self) -> bool {
        matches!(self, Self::Sd1Front | Self::Sd1Rear)
    }

    /// Cause while the source engages the line.
    #[must_use]
    pub const fn hold(self) -> Hold {
        match self {
            Self::Unknown => Hold::PauseOther,
            Self::Sd1Front | Self::Sd1Rear => Hold::PauseFloor,
            Self::Button => Hold::PauseButton,
            _ => Hold::PauseBumper,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_name_of_the_contract_is_its_source_and_no_other_text_is_one() {
        for source in StopSource::ALL {
            assert_eq!(StopSource::from_name(source.name()), source);
        }
        for other in ["", "bumper", "bumper0", "bumper9", "bumper01", "bumper1 ", "Button", "an unknown source"] {
            assert_eq!(StopSource::from_name(other), StopSource::Unknown, "{other:?}");
        }
    }

    #[test]
    fn bumpers_1_to_4_are_in_front() {
        let front = |front| StopSource::ALL.into_iter().filter(move |source| source.is_front() == Some(front));
        assert_eq!(front(true).map(|source| source as u8).collect::<Vec<_>>(), [1, 2, 3, 4, 0x10]);
        assert_eq!(front(false).map(|source| source as u8).collect::<Vec<_>>(), [5, 6, 7, 8, 0x11]);
    }
}
