//! Objections to any motion with their details: compared by value after every event, converted to text only for
//! messages.

use super::{Axis, Canbus, NAME, drive, steering, surroundings};
use base::Fault;
use messages::Hold;
use module::ActiveHold;

/// Reason why the robot must not move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Objection {
    /// [`Hold::BusDown`] or [`Hold::BusUnacknowledged`], of the bus of this number.
    Bus(usize, Hold),
    /// On the bus of this number.
    SecondMaster(usize),
    /// [`Hold::SpeedExceeded`], [`Hold::FeedCut`], [`Hold::WheelStood`], [`Hold::WheelsDisagree`], or one of the
    /// output that cuts the feed.
    Speed(Hold),
    /// An object of the drive on which the stop depends was changed.
    Parameter(Axis),
    Drive(Axis, drive::Objection),
    /// The module is not in RUN: the cause of its state.
    State(Hold),
    Around(surroundings::Objection),
    /// The guard is silent.
    Guard(Hold),
    /// A command was out of limits recently.
    Refused,
    NotHomed(steering::NotHomed),
}

impl Objection {
    /// Fault as which the stop is reported; `None` for causes with their own reports.
    pub(super) fn fault(self) -> Option<Fault> {
        match self {
            Self::Around(around) => around.fault(),
            _ => None,
        }
    }
}

impl Canbus {
    /// Row in `LL_DATA_HOLD`.
    pub(super) fn active_hold(&self, objection: Objection) -> ActiveHold<'_> {
        let (hold, subject) = match objection {
            Objection::Bus(bus, hold) => (hold, self.bus_name(bus)),
            Objection::SecondMaster(bus) => (Hold::SecondMaster, self.bus_name(bus)),
            Objection::Speed(hold) => (hold, ""),
            Objection::Parameter(axis) => (Hold::DriveParameter, axis.name()),
            Objection::Drive(axis, objection) => (objection.hold(), axis.name()),
            Objection::State(hold) => (hold, NAME),
            Objection::Around(objection) => self.around.hold(objection),
            Objection::Guard(hold) => (hold, ""),
            Objection::Refused => (Hold::CommandRefused, ""),
            Objection::NotHomed(why) => (why.hold(), Axis::Steering.name()),
        };
        ActiveHold::new(hold, subject)
    }

    /// Text in `LL_DATA_MOTION`, with the details of the cause.
    pub(super) fn words(&self, objection: Objection) -> String {
        match objection {
            Objection::Drive(axis, objection) => format!("the {} drive {objection}", axis.name()),
            Objection::NotHomed(steering::NotHomed::Failed(error)) => {
                let ActiveHold { hold, subject, .. } = self.active_hold(objection);
                format!("{}: {error}", hold.words(subject))
            }
            _ => {
                let ActiveHold { hold, subject, .. } = self.active_hold(objection);
                hold.words(subject)
            }
        }
    }
}
