//! The greatest speed of the motor that the drive permits, 0x6080: a smaller one bounds the motion in silence.

use super::draft::Draft;
use super::refusal::{Reason, Refusal};
use crate::drives::cia402::Quantity;
use crate::master::Expect;

/// In 1/min, whatever the unit of the velocities (CiA 402-2).
const MOTOR_SPEED: u16 = 0x6080;
/// A speed that exceeds a whole number by less is that number, 1/min.
const ROUNDING: f64 = 1e-6;

/// Writes what motor and gear can bear, where that is given and the object can be written; else the drive must permit
/// the speed of the limits at each boot-up. `turns`: of the motor per m or rad.
pub(super) fn motor_speed(draft: &mut Draft<'_>, turns: f64) -> Result<(), Refusal> {
    let Ok(object) = draft.sheet.integer(MOTOR_SPEED, 0) else {
        return Ok(());
    };
    let needed = libm::fabs(draft.description.limits.velocity * turns) * 60.0;
    match draft.description.quirks.motor_rpm_max {
        Some(most) if draft.sheet.writable(MOTOR_SPEED, 0).is_ok() => {
            let (low, high) = draft.sheet.limits(object);
            let value = i64::from(most).min(high);
            let whole = libm::floor(needed) as i64;
            if value < whole {
                return Err(Refusal::new(MOTOR_SPEED, 0, Reason::OutOfLimits { value: whole, low, high }));
            }
            draft.set(MOTOR_SPEED, 0, Quantity::Fixed(value))
        }
        _ => {
            draft.verify(Expect::at_least(MOTOR_SPEED, 0, libm::ceil(needed - ROUNDING) as u32));
            Ok(())
        }
    }
}
