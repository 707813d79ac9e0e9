//! The drive's side of the CiA 402 power state machine (facts/canopen.md 1.9).

use base::{Duration, Instant};

/// States of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// Off, and not to be switched on before a shutdown command.
    SwitchOnDisabled,
    /// Off; may be switched on.
    Ready,
    /// Supply on, not in operation.
    SwitchedOn,
    /// On its way to operation; EPOS only: Refresh, then Measure Init.
    Enabling {
        /// When it is in operation.
        until: Instant,
    },
    /// In operation.
    Enabled,
    /// Braking by command, or braked and held.
    QuickStop,
    /// Braking because of a fault.
    FaultReaction,
    /// Off because of a fault.
    Fault,
}

/// How drives differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Manner {
    /// Time in Refresh and Measure Init.
    pub enabling: Duration,
    /// Whether Enable Operation leads out of Quick Stop Active (transition 16).
    pub resumes: bool,
}

impl Power {
    /// What a controlword does; `before` is the one before it, for the edge of the fault reset.
    #[must_use]
    pub fn command(self, word: u16, before: u16, now: Instant, manner: Manner) -> Self {
        use Power::{
            Enabled, Enabling, Fault, FaultReaction, QuickStop, Ready, SwitchOnDisabled, SwitchedOn,
        };
        let enabled = || match manner.enabling {
            Duration::ZERO => Enabled,
            time => Enabling { until: now + time },
        };
        match (self, word & 0x0F) {
            (Fault, _) if word & !before & 0x80 != 0 => SwitchOnDisabled, // 15
            (Fault | FaultReaction, _) => self,
            (SwitchOnDisabled, low) if low & 0x7 == 0x6 => Ready, // 2
            (SwitchOnDisabled, _) => self,
            // Disable voltage: bit 1 clear.
            (_, low) if low & 0x2 == 0 => SwitchOnDisabled, // 7, 9, 10, 12
            // Quick stop: bit 2 clear.
            (Enabled | QuickStop, low) if low & 0x4 == 0 => QuickStop, // 11
            (_, low) if low & 0x4 == 0 => SwitchOnDisabled,            // 7, 10
            (QuickStop, 0xF) if manner.resumes => enabled(),           // 16
            (QuickStop, _) => self,
            (_, 0x6 | 0xE) => Ready,                // 6, 8
            (Ready | SwitchedOn, 0xF) => enabled(), // 3, 4
            (Enabled | Enabling { .. }, 0xF) => self,
            _ => SwitchedOn, // 3, 5
        }
    }

    /// What time alone does.
    #[must_use]
    pub fn elapse(self, now: Instant) -> Self {
        match self {
            Self::Enabling { until } if until <= now => Self::Enabled,
            other => other,
        }
    }

    /// Whether the motor is driven.
    #[must_use]
    pub fn drives(self) -> bool {
        matches!(self, Self::Enabled | Self::QuickStop | Self::FaultReaction)
    }

    /// Bits 0 to 6 of the statusword; bit 4 (voltage) is the drive's own.
    #[must_use]
    pub fn status(self) -> u16 {
        match self {
            Self::SwitchOnDisabled => 0x40,
            Self::Ready => 0x21,
            Self::SwitchedOn | Self::Enabling { .. } => 0x23,
            Self::Enabled => 0x27,
            Self::QuickStop => 0x07,
            Self::FaultReaction => 0x0F,
            Self::Fault => 0x08,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Power::{Enabled, Fault, FaultReaction, QuickStop, Ready, SwitchOnDisabled, SwitchedOn};

    #[test]
    fn commands_lead_where_the_standard_says() {
        let table = [
            // state, then: shutdown, switch on, enable, disable voltage, quick stop, fault reset
            (
                SwitchOnDisabled,
                [
                    Ready,
                    SwitchOnDisabled,
                    SwitchOnDisabled,
                    SwitchOnDisabled,
                    SwitchOnDisabled,
                    SwitchOnDisabled,
                ],
            ),
            (
                Ready,
                [
                    Ready,
                    SwitchedOn,
                    Enabled,
                    SwitchOnDisabled,
                    SwitchOnDisabled,
                    SwitchOnDisabled,
                ],
            ),
            (
                SwitchedOn,
                [
                    Ready,
                    SwitchedOn,
                    Enabled,
                    SwitchOnDisabled,
                    SwitchOnDisabled,
                    SwitchOnDisabled,
                ],
            ),
            (
                Enabled,
                [
                    Ready,
                    SwitchedOn,
                    Enabled,
                    SwitchOnDisabled,
                    QuickStop,
                    SwitchOnDisabled,
                ],
            ),
            (
                QuickStop,
                [
                    QuickStop,
                    QuickStop,
                    Enabled,
                    SwitchOnDisabled,
                    QuickStop,
                    SwitchOnDisabled,
                ],
            ),
            (FaultReaction, [FaultReaction; 6]),
            (Fault, [Fault, Fault, Fault, Fault, Fault, SwitchOnDisabled]),
        ];
        let manner = Manner {
            enabling: Duration::ZERO,
            resumes: true,
        };
        for (from, expected) in table {
            let words = [0x06, 0x07, 0x0F, 0x00, 0x02, 0x80];
            let reached = words.map(|word| from.command(word, 0, Instant::ZERO, manner));
            assert_eq!(reached, expected, "{from:?}");
        }
        // The EPOS notes' quick stop, and a fault reset without an edge.
        assert_eq!(Enabled.command(0x0B, 0, Instant::ZERO, manner), QuickStop);
        assert_eq!(Fault.command(0x80, 0x80, Instant::ZERO, manner), Fault);
        let held = Manner {
            resumes: false,
            ..manner
        };
        assert_eq!(QuickStop.command(0x0F, 0, Instant::ZERO, held), QuickStop);
    }

    #[test]
    fn enabling_takes_its_time_and_can_be_left() {
        let manner = Manner {
            enabling: Duration::from_millis(40),
            resumes: true,
        };
        let enabling = SwitchedOn.command(0x0F, 0, Instant::ZERO, manner);
        assert_eq!(enabling.status(), 0x23);
        assert_eq!(enabling.elapse(Instant::from_millis(39)), enabling);
        assert_eq!(enabling.elapse(Instant::from_millis(40)), Enabled);
        assert_eq!(
            enabling.command(0x0F, 0x0F, Instant::from_millis(20), manner),
            enabling
        );
        assert_eq!(
            enabling.command(0x02, 0x0F, Instant::from_millis(20), manner),
            SwitchOnDisabled
        );
        assert_eq!(
            enabling.command(0x00, 0x0F, Instant::from_millis(20), manner),
            SwitchOnDisabled
        );
    }
}
