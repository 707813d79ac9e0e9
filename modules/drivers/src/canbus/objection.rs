//! What stands against any motion, with the figures of each cause: compared by value after every event, put into words only
//! when a message is made.

use super::{Axis, Canbus, NAME, drive, steering, surroundings};
use base::Fault;
use messages::Hold;
use module::Standing;

/// Why the robot must not move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Objection {
    /// [`Hold::BusDown`] or [`Hold::BusUnacknowledged`].
    Bus(Hold),
    SecondMaster,
    Drive(Axis, drive::Objection),
    /// This module is not in RUN: the cause of its state.
    State(Hold),
    Around(surroundings::Objection),
    /// A command was out of limits a moment ago.
    Refused,
    NotHomed(steering::NotHomed),
}

impl Objection {
    /// The fault that the stop is reported as; the others have reports of their own.
    pub(super) fn fault(self) -> Option<Fault> {
        match self {
            Self::Around(around) => around.fault(),
            _ => None,
        }
    }
}

impl Canbus {
    /// As `LL_DATA_HOLD` has it.
    pub(super) fn standing(&self, objection: Objection) -> Standing<'_> {
        let bus = self.config.bus.as_str();
        let (hold, subject) = match objection {
            Objection::Bus(hold) => (hold, bus),
            Objection::SecondMaster => (Hold::SecondMaster, bus),
            Objection::Drive(axis, objection) => (objection.hold(), self.drive(axis).name),
            Objection::State(hold) => (hold, NAME),
            Objection::Around(objection) => self.around.hold(objection),
            Objection::Refused => (Hold::CommandRefused, ""),
            Objection::NotHomed(why) => (why.hold(), self.steering.drive.name),
        };
        Standing::new(hold, subject)
    }

    /// The sentence in `LL_DATA_MOTION`, with the figures that the cause has.
    pub(super) fn words(&self, objection: Objection) -> String {
        match objection {
            Objection::Drive(axis, objection) => format!("the {} drive {objection}", self.drive(axis).name),
            Objection::NotHomed(steering::NotHomed::Failed(error)) => {
                let Standing { hold, subject, .. } = self.standing(objection);
                format!("{}: {error}", hold.words(subject))
            }
            _ => {
                let Standing { hold, subject, .. } = self.standing(objection);
                hold.words(subject)
            }
        }
    }

    fn drive(&self, axis: Axis) -> &drive::Drive {
        match axis {
            Axis::Propulsion => &self.propulsion.drive,
            Axis::Steering => &self.steering.drive,
        }
    }
}
