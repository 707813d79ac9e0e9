//! Faults that belong to a cause for which the robot does not act: what stops it, and what was reported of it.

use crate::Hold;
use base::Fault;

/// A fault that belongs to a cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Related {
    /// The fault.
    pub fault: Fault,
    /// True if it belongs to the cause only with the same subject, or where one of both has none.
    pub same_subject: bool,
}

impl Related {
    /// True if a fault with this number and subject belongs to the cause with the subject `of`.
    #[must_use]
    pub fn is(&self, number: i32, subject: &str, of: &str) -> bool {
        let is_its = subject.is_empty() || of.is_empty() || subject == of;
        self.fault as i32 == number && (is_its || !self.same_subject)
    }
}

const fn any(fault: Fault) -> Related {
    Related { fault, same_subject: false }
}

const fn same(fault: Fault) -> Related {
    Related { fault, same_subject: true }
}

/// PAUSE takes the drives out of operation: they report it.
const PAUSED: [Related; 2] = [any(Fault::DriveEmergency), any(Fault::DriveFault)];
const DRIVE: [Related; 6] = [
    same(Fault::DriveLost),
    same(Fault::DriveEmergency),
    same(Fault::DriveFault),
    same(Fault::DriveBootFailed),
    same(Fault::DriveMismatch),
    same(Fault::DriveParameter),
];
const MODULE: [Related; 5] = [
    same(Fault::CriticalModule),
    same(Fault::ModuleDied),
    same(Fault::ModuleHung),
    same(Fault::ModuleUnstartable),
    same(Fault::RestartStorm),
];
const LIDAR: [Related; 7] = [
    same(Fault::LidarLost),
    same(Fault::LidarBlocked),
    same(Fault::LidarSpeed),
    same(Fault::LidarIncomplete),
    same(Fault::LidarDisturbed),
    same(Fault::LidarError),
    same(Fault::LidarNoResult),
];
const INPUT: [Related; 4] =
    [any(Fault::PortDown), any(Fault::IoDeviceLost), any(Fault::IoDeviceRefused), any(Fault::DriveLost)];
const POSITION: [Related; 5] = [
    any(Fault::PoseLost),
    any(Fault::OdometrySilent),
    any(Fault::OdometryStuck),
    any(Fault::BeaconUnknown),
    any(Fault::EstimateBad),
];
const RANGING: [Related; 3] = [any(Fault::RangingLost), any(Fault::BoardLost), any(Fault::BoardImplausible)];

impl Hold {
    /// Faults that belong to the cause, so that a reader can list them under it; empty where no fault does.
    #[must_use]
    pub const fn faults(self) -> &'static [Related] {
        match self {
            Self::PauseUnknown => const { &[any(Fault::PauseUnknown)] },
            Self::PauseBumper | Self::PauseButton | Self::PauseOther | Self::PauseLatched => &PAUSED,
            Self::PauseFloor => {
                const { &[same(Fault::FloorMissing), any(Fault::DriveEmergency), any(Fault::DriveFault)] }
            }
            Self::PauseField => {
                const FIELD: [Related; 9] = joined(&LIDAR, &PAUSED);
                &FIELD
            }
            Self::PauseFieldUnknown => &LIDAR,
            Self::PauseInput => {
                const OPEN: [Related; 6] = joined(&INPUT, &PAUSED);
                &OPEN
            }
            Self::PauseInputUnknown => &INPUT,

            Self::BusDown => const { &[same(Fault::PortDown)] },
            Self::BusUnacknowledged => {
                const { &[same(Fault::CanUnacknowledged), same(Fault::CanPassive), same(Fault::CanErrors)] }
            }
            Self::SecondMaster => const { &[any(Fault::SecondMaster), any(Fault::NodeClash)] },
            _ if self.is_about_a_drive() => &DRIVE,
            Self::NotHomed | Self::HomingFailed | Self::ToBeHomed => const { &[same(Fault::HomingFailed)] },
            Self::SpeedExceeded => const { &[any(Fault::SpeedExceeded)] },
            Self::FeedCut => const { &[any(Fault::StopFailed)] },
            Self::SecondWayLost => const { &[any(Fault::SecondWayLost)] },
            Self::WheelStood => const { &[any(Fault::DriveFault)] },
            Self::WheelsDisagree => const { &[any(Fault::WheelsDisagree)] },

            Self::CriticalModule | Self::PlannerModule | Self::ModuleSilent => &MODULE,
            Self::WatchdogSilent => const { &[any(Fault::WatchdogSilent), any(Fault::WatchdogLate)] },
            Self::SecondRobot => const { &[any(Fault::SecondRobot)] },

            Self::CommandRefused => const { &[any(Fault::MotionRefused)] },
            Self::Contested => const { &[any(Fault::MotionContested)] },

            Self::NoEstimate
            | Self::EstimateLost
            | Self::EstimateSearching
            | Self::EstimateBad
            | Self::PlannerNoEstimate => &POSITION,
            Self::SonarsSilent | Self::SonarsUnknown => &RANGING,
            Self::RangingLost => {
                const { &[same(Fault::RangingLost), same(Fault::BoardLost), same(Fault::BoardImplausible)] }
            }
            Self::GoalInvalid => const { &[any(Fault::GoalRefused)] },
            _ => &[],
        }
    }
}

/// Both lists, one after the other.
const fn joined<const A: usize, const B: usize, const N: usize>(
    first: &[Related; A],
    rest: &[Related; B],
) -> [Related; N] {
    let mut all = [first[0]; N];
    let mut place = 0;
    while place < N {
        all[place] = if place < A { first[place] } else { rest[place - A] };
        place += 1;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn belongs(hold: Hold, of: &str, fault: Fault, subject: &str) -> bool {
        hold.faults().iter().any(|related| related.is(fault as i32, subject, of))
    }

    #[test]
    fn what_the_drives_report_in_pause_belongs_to_what_engages_it() {
        for axis in ["propulsion", "steering"] {
            assert!(belongs(Hold::PauseBumper, "bumper2", Fault::DriveFault, axis));
            assert!(belongs(Hold::PauseField, "lidar.front", Fault::DriveEmergency, axis));
        }
        assert!(belongs(Hold::PauseFloor, "sd1_front", Fault::FloorMissing, "sd1_front"));
        assert!(!belongs(Hold::PauseFloor, "sd1_front", Fault::FloorMissing, "sd1_rear"));
        assert!(!belongs(Hold::PauseBumper, "bumper2", Fault::FanFailed, "fan1"));
    }

    #[test]
    fn a_fault_of_another_drive_or_module_belongs_elsewhere() {
        assert!(belongs(Hold::DriveLost, "steering", Fault::DriveLost, "steering"));
        assert!(!belongs(Hold::DriveLost, "steering", Fault::DriveLost, "propulsion"));
        assert!(belongs(Hold::DriveLost, "steering", Fault::DriveLost, ""), "of a log without subjects");
        assert!(belongs(Hold::CriticalModule, "driver_power", Fault::ModuleDied, "driver_power"));
        assert!(!belongs(Hold::CriticalModule, "driver_power", Fault::ModuleDied, "logger"));
    }

    #[test]
    fn no_fault_is_listed_twice_for_a_cause_and_a_notice_has_none() {
        for hold in Hold::ALL {
            let faults: Vec<Fault> = hold.faults().iter().map(|related| related.fault).collect();
            assert!((1..faults.len()).all(|place| !faults[..place].contains(&faults[place])), "{hold:?} {faults:?}");
            assert!(faults.is_empty() || !(hold.is_idle() || hold.is_notice()), "{hold:?}");
        }
    }
}
