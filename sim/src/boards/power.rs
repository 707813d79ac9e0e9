//! The power stage of a drive: the CiA 402 state machine of [`canopen::axis::drive`], and the time that enabling takes.

use base::{Duration, Instant};
use canopen::axis::PowerState;
use canopen::axis::drive::Drive;

/// Where the power stage is, as the motion needs to know it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Off, in one of the states before operation.
    Off,
    /// On its way from Switched On to operation; EPOS only: Refresh, then Measure Init.
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

impl Stage {
    /// Whether the motor is driven.
    #[must_use]
    pub fn drives(self) -> bool {
        matches!(self, Self::Enabled | Self::QuickStop | Self::FaultReaction)
    }
}

/// The power stage.
#[derive(Debug)]
pub struct Power {
    drive: Drive,
    enabling: Duration,
    until: Instant,
}

impl Power {
    /// As after power-on: with this quick stop option (0x605A), taking this long from Switched On to operation.
    #[must_use]
    pub fn new(quick_stop_option: i16, enabling: Duration) -> Self {
        Self { drive: Drive::new(quick_stop_option, true), enabling, until: Instant::ZERO }
    }

    /// Obeys a controlword.
    pub fn command(&mut self, now: Instant, word: u16) {
        // Before operation there is nothing to brake: a quick stop switches off (transition 10).
        let word = if self.is_enabling() && word & 0x86 == 0x02 { 0 } else { word };
        if self.drive.apply(word).contains(&4) {
            self.until = now + self.enabling;
        }
        self.elapse(now);
    }

    /// What 0x605A holds.
    pub fn set_quick_stop_option(&mut self, option: i16) {
        self.drive.set_quick_stop_option(option);
    }

    /// What time alone does: enabling is over.
    pub fn elapse(&mut self, now: Instant) {
        if self.until <= now {
            self.until = Instant::ZERO;
        }
    }

    fn is_enabling(&self) -> bool {
        self.until > Instant::ZERO && self.drive.state() == PowerState::OperationEnabled
    }

    /// The motor has come to a stand.
    pub fn stands(&mut self) {
        self.drive.stands();
        self.drive.fault_reaction_done();
    }

    /// A fault; false when there is one already. Without `brakes`, and where there is nothing to brake, off at once.
    pub fn fault(&mut self, brakes: bool) -> bool {
        let brakes = brakes && self.stage().drives();
        let new = self.drive.fault().is_some();
        if new && !brakes {
            self.drive.fault_reaction_done();
        }
        new
    }

    /// Where it is.
    #[must_use]
    pub fn stage(&self) -> Stage {
        match self.drive.state() {
            PowerState::OperationEnabled if self.is_enabling() => Stage::Enabling { until: self.until },
            PowerState::OperationEnabled => Stage::Enabled,
            PowerState::QuickStopActive => Stage::QuickStop,
            PowerState::FaultReactionActive => Stage::FaultReaction,
            PowerState::Fault => Stage::Fault,
            PowerState::NotReady
            | PowerState::SwitchOnDisabled
            | PowerState::ReadyToSwitchOn
            | PowerState::SwitchedOn => Stage::Off,
        }
    }

    /// Bits 0 to 3, 5 and 6 of the statusword; bit 4 (voltage) is the drive's own.
    #[must_use]
    pub fn status(&self) -> u16 {
        let state = if self.is_enabling() { PowerState::SwitchedOn.encode() } else { self.drive.statusword() };
        state & 0x6F
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn enabling() -> Power {
        let mut power = Power::new(6, Duration::from_millis(40));
        power.command(at(1), 0x06);
        power.command(at(1), 0x0F);
        power
    }

    #[test]
    fn enabling_takes_its_time_and_looks_like_switched_on() {
        let mut power = enabling();
        assert_eq!((power.stage(), power.status()), (Stage::Enabling { until: at(41) }, 0x23));
        power.command(at(20), 0x0F);
        power.elapse(at(40));
        assert_eq!(power.stage(), Stage::Enabling { until: at(41) });
        power.elapse(at(41));
        assert_eq!((power.stage(), power.status()), (Stage::Enabled, 0x27));
        power.command(at(50), 0x02);
        assert_eq!(power.stage(), Stage::QuickStop);
        power.command(at(60), 0x0F);
        assert_eq!(power.stage(), Stage::Enabled, "resumed without enabling again");
    }

    #[test]
    fn a_quick_stop_before_operation_switches_off() {
        let mut power = enabling();
        power.command(at(20), 0x02);
        assert_eq!((power.stage(), power.status()), (Stage::Off, 0x40));
    }

    #[test]
    fn a_fault_brakes_only_what_moves() {
        let mut power = enabling();
        assert!(power.fault(true) && !power.fault(true));
        assert_eq!(power.stage(), Stage::Fault);
        let mut power = enabling();
        power.elapse(at(41));
        assert!(power.fault(true));
        assert_eq!(power.stage(), Stage::FaultReaction);
        power.stands();
        assert_eq!((power.stage(), power.status()), (Stage::Fault, 0x08));
        power.command(at(50), 0x80);
        assert_eq!(power.stage(), Stage::Off);
    }
}
