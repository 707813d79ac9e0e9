//! Sources of the PAUSE line, from the names in `LL_EVENT_STOP`, and who of several engages it.

use crate::{Hold, lowlevel};
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

    /// True for the name of a source that the power controller reports: one of the list, or none.
    #[must_use]
    pub fn is_of_line(name: &str) -> bool {
        name.is_empty() || Self::from_name(name) != Self::Unknown
    }

    /// True for the name of a lidar whose own fields stop the robot, such as `lidar.front`: `driver_lidar` reports it.
    #[must_use]
    pub fn is_lidar(name: &str) -> bool {
        name.strip_prefix("lidar.").is_some_and(|name| !name.is_empty())
    }

    /// True for the name of a signal of `[io]` that stops the robot, such as `io.estop`: `driver_io` reports it.
    #[must_use]
    pub fn is_signal(name: &str) -> bool {
        name.strip_prefix("io.").is_some_and(|name| !name.is_empty())
    }

    /// True for the name of a digital input of a drive that stops the robot, such as `drive.left.3`: `driver_canbus`
    /// reads it.
    #[must_use]
    pub fn is_drive_input(name: &str) -> bool {
        name.strip_prefix("drive.").is_some_and(|name| !name.is_empty())
    }

    /// Cause while the source of this name engages the line.
    #[must_use]
    pub fn hold_of(name: &str) -> Hold {
        if Self::is_lidar(name) {
            Hold::PauseField
        } else if Self::is_signal(name) || Self::is_drive_input(name) {
            Hold::PauseInput
        } else {
            Self::from_name(name).hold()
        }
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
            Self::Unknown if Self::is_lidar(name) => format!("the lidar {}", name.trim_start_matches("lidar.")),
            Self::Unknown if Self::is_signal(name) => format!("the input {}", name.trim_start_matches("io.")),
            Self::Unknown if Self::is_drive_input(name) => match name.trim_start_matches("drive.").rsplit_once('.') {
                Some((axis, bit)) => format!("digital input {bit} of the {axis} drive"),
                None => name.into(),
            },
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

/// Silence of a source beside the power controller after which it is not shown any more, µs: a person may have
/// overruled it.
const SILENT_US: u64 = 1_200_000;
/// Sources beside the power controller that are distinguished.
const OTHERS_MAX: usize = 8;

/// Who engages PAUSE, as a reader of `LL_EVENT_STOP` shows it: each sender reports for its own sources, and what one of
/// them reports says nothing of the others. By these reports nothing is decided.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StopReports {
    /// Source that the power controller reports; `None` within: the line is open; without: it reports nothing.
    line: Option<Option<String>>,
    /// Others that engage it, and the timestamps of their last reports.
    others: Vec<(String, i64)>,
}

impl StopReports {
    /// Processes a report. Returns the state of PAUSE with the source that is named first; `None` if the report changes
    /// nothing of it, and is none of a power controller that reports the line.
    pub fn on_report(&mut self, stop: &lowlevel::EventStop) -> Option<lowlevel::EventStop> {
        let before = self.engaged().map(str::to_owned);
        let of_line = StopSource::is_of_line(&stop.source);
        if of_line {
            self.line = Some(stop.engaged.then(|| stop.source.clone()));
        } else {
            self.others.retain(|(name, _)| *name != stop.source);
            if stop.engaged && self.others.len() < OTHERS_MAX {
                self.others.push((stop.source.clone(), stop.timestamp));
            }
        }
        self.others.retain(|(_, at)| stop.timestamp.abs_diff(*at) < SILENT_US);
        let engaged = self.engaged();
        let is_news = of_line || self.line.is_none() || engaged != before.as_deref();
        is_news.then(|| lowlevel::EventStop {
            timestamp: stop.timestamp,
            engaged: engaged.is_some(),
            source: engaged.unwrap_or_default().into(),
        })
    }

    /// The source that is named first, if any engages PAUSE.
    fn engaged(&self) -> Option<&str> {
        let line = self.line.iter().flatten().map(String::as_str);
        line.chain(self.others.iter().map(|(name, _)| name.as_str())).next()
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
    fn a_lidar_is_a_source_by_its_name() {
        assert_eq!(StopSource::hold_of("lidar.front"), Hold::PauseField);
        assert_eq!([StopSource::is_of_line("lidar.front"), StopSource::is_of_line("")], [false, true]);
        for input in ["io.estop", "drive.left.3"] {
            assert_eq!((StopSource::hold_of(input), StopSource::is_of_line(input)), (Hold::PauseInput, false));
        }
        assert_eq!(StopSource::in_words("io.estop"), "the input estop");
        assert_eq!(StopSource::in_words("drive.left.3"), "digital input 3 of the left drive");
        for other in ["lidar", "lidar.", "crane", "a lidar.front", "io.", "drive.", "drive"] {
            assert_eq!(StopSource::hold_of(other), Hold::PauseOther, "{other:?}");
        }
        assert_eq!(StopSource::hold_of("bumper2"), Hold::PauseBumper);
    }

    #[test]
    fn the_reports_of_several_sources_are_one_state() {
        let stop = |ms: i64, engaged, source: &str| lowlevel::EventStop {
            timestamp: 1000 * ms,
            engaged,
            source: source.into(),
        };
        let mut reports = StopReports::default();
        let mut told = |ms, engaged, source: &str| reports.on_report(&stop(ms, engaged, source));
        assert_eq!(
            told(0, false, "lidar.front"),
            Some(stop(0, false, "")),
            "of a robot without a power controller, too"
        );
        assert_eq!(told(10, false, ""), Some(stop(10, false, "")));
        assert_eq!(told(100, false, "lidar.front"), None);
        assert_eq!(told(200, true, "lidar.front"), Some(stop(200, true, "lidar.front")));
        assert_eq!(told(300, true, "lidar.front"), None);
        assert_eq!(told(510, false, ""), Some(stop(510, true, "lidar.front")), "the line does not end it");
        assert_eq!(told(600, true, "bumper2"), Some(stop(600, true, "bumper2")));
        assert_eq!(told(700, false, "lidar.front"), None, "nor does it end the line");
        assert_eq!(told(800, false, ""), Some(stop(800, false, "")));
        assert_eq!(told(900, true, "a rope"), Some(stop(900, true, "a rope")));
        assert_eq!(told(2100, false, ""), Some(stop(2100, false, "")), "the rope fell silent");
    }

    #[test]
    fn bumpers_1_to_4_are_in_front() {
        let front = |front| StopSource::ALL.into_iter().filter(move |source| source.is_front() == Some(front));
        assert_eq!(front(true).map(|source| source as u8).collect::<Vec<_>>(), [1, 2, 3, 4, 0x10]);
        assert_eq!(front(false).map(|source| source as u8).collect::<Vec<_>>(), [5, 6, 7, 8, 0x11]);
    }
}
