//! Reasons why a description is refused.

use crate::WHEELS_MAX;
use core::fmt;

/// Description of a base that cannot be. Wheels are counted from 0, in the order of the description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Error {
    /// There is no wheel.
    NoWheels,
    /// There are more wheels than [`WHEELS_MAX`].
    TooManyWheels {
        /// Number of wheels.
        count: usize,
    },
    /// A quantity is outside of its range, or NaN.
    OutOfRange {
        /// Wheel to which it belongs; `None`: to the whole base.
        wheel: Option<usize>,
        /// Name of the field or parameter, with its unit.
        quantity: &'static str,
        /// Value that was refused.
        value: f64,
        /// Least permitted value.
        min: f64,
        /// Greatest permitted value.
        max: f64,
    },
    /// Two axes on one wheel: two wheels have the same contact point.
    SamePlace {
        /// Later of the two wheels.
        wheel: usize,
        /// Earlier one.
        other: usize,
    },
    /// A wheel that neither steers nor slides is not on the line of the axle that an earlier one defines, so the base
    /// could not turn.
    OffAxle {
        /// Wheel beside the axle.
        wheel: usize,
        /// Wheel that defines the axle.
        other: usize,
    },
    /// The driven wheels cannot produce every motion that the undriven ones permit.
    NotDriven {
        /// First wheel that adds nothing to those before it; `None`: there are too few.
        wheel: Option<usize>,
    },
    /// The measured wheels do not determine the velocity of the base.
    NotMeasured {
        /// First wheel that adds nothing to those before it; `None`: there are too few.
        wheel: Option<usize>,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NoWheels => write!(f, "the base has no wheels; it must have 1 to {WHEELS_MAX}"),
            Self::TooManyWheels { count } => {
                write!(f, "the base has {count} wheels; it must have 1 to {WHEELS_MAX}")
            }
            Self::OutOfRange { wheel: Some(wheel), quantity, value, min, max } => {
                write!(f, "wheel {wheel}: {quantity} is {value}; it must be {min} to {max}")
            }
            Self::OutOfRange { wheel: None, quantity, value, min, max } => {
                write!(f, "{quantity} is {value}; it must be {min} to {max}")
            }
            Self::SamePlace { wheel, other } => {
                write!(
                    f,
                    "wheel {wheel} is where wheel {other} is; each wheel needs its own contact point and one drive"
                )
            }
            Self::OffAxle { wheel, other } => write!(
                f,
                "wheel {wheel} is fixed, but not on the axle of wheel {other}; it must be on that line and roll across \
                 it, or be steered, skidding, or have rollers"
            ),
            Self::NotDriven { wheel: Some(wheel) } => write!(
                f,
                "wheel {wheel} moves the base only as the wheels before it; the directions or places of the driven \
                 wheels must differ so that together they cause every motion of the base"
            ),
            Self::NotDriven { wheel: None } => {
                write!(f, "too few wheels are driven to cause every motion of the base; more must be driven or steered")
            }
            Self::NotMeasured { wheel: Some(wheel) } => write!(
                f,
                "wheel {wheel} measures only what the wheels before it measure; the directions or places of the \
                 measured wheels must differ so that together they determine the velocity of the base"
            ),
            Self::NotMeasured { wheel: None } => {
                write!(f, "too few wheels are measured to determine the velocity of the base; more must be measured")
            }
        }
    }
}

impl core::error::Error for Error {}

/// Checks a quantity of a wheel, or of the base, against its range; NaN is outside.
pub(crate) fn in_range(
    wheel: Option<usize>,
    quantity: &'static str,
    value: f64,
    (min, max): (f64, f64),
) -> Result<(), Error> {
    match (min..=max).contains(&value) {
        true => Ok(()),
        false => Err(Error::OutOfRange { wheel, quantity, value, min, max }),
    }
}
