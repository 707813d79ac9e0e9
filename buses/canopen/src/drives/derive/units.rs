//! Units of a drive: exact, as its data sheet or a person states them.

use super::description::VelocityUnit;
use super::draft::Draft;
use super::refusal::{Reason, Refusal};
use crate::axis::Units;
use crate::master::Expect;

/// A positive fraction in its lowest terms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ratio {
    above: u64,
    below: u64,
}

impl Ratio {
    /// `None`: a part of it is 0.
    #[must_use]
    pub const fn new(above: u64, below: u64) -> Option<Self> {
        if above == 0 || below == 0 {
            return None;
        }
        let (mut a, mut b) = (above, below);
        while b != 0 {
            (a, b) = (b, a % b);
        }
        Some(Self { above: above / a, below: below / a })
    }

    /// Numerator and denominator.
    #[must_use]
    pub const fn parts(self) -> (u64, u64) {
        (self.above, self.below)
    }

    /// Times 10 to the power of `exponent`; `None`: too large.
    fn scaled(self, exponent: i8) -> Option<Self> {
        let power = 10_u64.checked_pow(u32::from(exponent.unsigned_abs()))?;
        match exponent {
            0.. => Self::new(self.above.checked_mul(power)?, self.below),
            _ => Self::new(self.above, self.below.checked_mul(power)?),
        }
    }

    fn value(self) -> f64 {
        self.above as f64 / self.below as f64
    }
}

/// The drive's units per turn of the motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scale {
    /// Position units per turn; `None`: not known, and not needed.
    pub position: Option<Ratio>,
    /// Velocity units per turn/s.
    pub velocity: Ratio,
    /// Acceleration units per turn/s².
    pub acceleration: Ratio,
}

const PER_MINUTE: Ratio = Ratio { above: 60, below: 1 };
const PER_SECOND: Ratio = Ratio { above: 1, below: 1 };
/// Codes in 0x60A9 and 0x60AA (CiA 303-2; maxon EPOS4 Firmware Specification).
const TURN: u8 = 0xB4;
const INCREMENT: u8 = 0xB5;
const RPM: u8 = 0xC0;
const SECOND: u8 = 0x03;
const MINUTE: u8 = 0x47;

impl Scale {
    /// SI to the drive's units: `turns` of the motor per m or rad.
    fn units(&self, turns: f64) -> Units {
        let [position, velocity, acceleration] =
            [self.position.unwrap_or(self.velocity), self.velocity, self.acceleration].map(Ratio::value);
        Units::new(position * turns, velocity * turns, acceleration * turns)
    }
}

/// The units, exact and as the engine needs them, and the turns of the motor per m or rad between. What was taken
/// from the sheet is compared at boot-up.
pub(super) fn units(draft: &mut Draft<'_>) -> Result<(Scale, f64, Units), Refusal> {
    let scale = scale(draft)?;
    let gear = match draft.description.gear {
        Some(gear) => gear,
        None => gear_ratio(draft).ok_or(Refusal::new(0x6091, 1, Reason::NoUnit))?.value(),
    };
    let turns = gear / draft.description.per_turn;
    if !turns.is_finite() || turns == 0.0 {
        return Err(Refusal::new(0x6091, 1, Reason::NoUnit));
    }
    Ok((scale, turns, scale.units(turns)))
}

fn scale(draft: &mut Draft<'_>) -> Result<Scale, Refusal> {
    let position = match draft.description.counts_per_turn {
        Some(counts) => Ratio::new(counts.into(), 1),
        None => position(draft),
    };
    let counts = position.ok_or(Refusal::new(0x608F, 1, Reason::NoUnit));
    let has_factors = draft.sheet.has(0x608F) || draft.sheet.has(0x6092);
    let given = draft.description.velocity_unit;
    let stated = if given.is_none() { stated_velocity(draft, position) } else { None };
    let velocity = match given {
        Some(VelocityUnit::Rpm) => PER_MINUTE,
        Some(VelocityUnit::TenthRpm) => Ratio { above: 600, below: 1 },
        Some(VelocityUnit::MilliRpm) => Ratio { above: 60_000, below: 1 },
        Some(VelocityUnit::CountsPerSecond) => counts?,
        None => match stated {
            Some(velocity) => velocity,
            None if has_factors => counts?,
            None => return Err(Refusal::new(0x60A9, 0, Reason::NoUnit)),
        },
    };
    let acceleration = stated_acceleration(draft).filter(|_| stated.is_some()).unwrap_or(velocity);
    Ok(Scale { position, velocity, acceleration })
}

/// Position units per turn of the motor: by the feed where there is one, else increments (CiA 402-2, 8.1).
fn position(draft: &mut Draft<'_>) -> Option<Ratio> {
    let (encoder, feed) = (factor(draft, 0x608F), factor(draft, 0x6092));
    let Some((feed, shaft_turns)) = feed else {
        let (increments, turns) = encoder?;
        confirm(draft, 0x608F, (increments, turns));
        return Ratio::new(increments.into(), turns.into());
    };
    confirm(draft, 0x6092, (feed, shaft_turns));
    let gear = gear_ratio(draft).unwrap_or(PER_SECOND);
    let (motor_turns, turns) = gear.parts();
    Ratio::new(u64::from(feed).checked_mul(turns)?, u64::from(shaft_turns).checked_mul(motor_turns)?)
}

/// Turns of the motor per turn of the driving shaft.
fn gear_ratio(draft: &mut Draft<'_>) -> Option<Ratio> {
    let (motor, shaft) = factor(draft, 0x6091)?;
    confirm(draft, 0x6091, (motor, shaft));
    Ratio::new(motor.into(), shaft.into())
}

/// Both parts of a factor, as the sheet states them.
fn factor(draft: &Draft<'_>, index: u16) -> Option<(u32, u32)> {
    let part =
        |sub| draft.sheet.stated(index, sub).and_then(|value| u32::try_from(value).ok()).filter(|part| *part > 0);
    Some((part(1)?, part(2)?))
}

fn confirm(draft: &mut Draft<'_>, index: u16, (above, below): (u32, u32)) {
    draft.verify(Expect::equal(index, 1, above));
    draft.verify(Expect::equal(index, 2, below));
}

/// An SI unit of 0x60A8 to 0x60AA: exponent, numerator, denominator.
fn si_unit(draft: &mut Draft<'_>, index: u16) -> Option<(i8, u8, u8)> {
    let unit = draft.sheet.stated(index, 0)? as u32;
    let [_, denominator, numerator, exponent] = unit.to_le_bytes();
    draft.verify(Expect::equal(index, 0, unit));
    Some((exponent as i8, numerator, denominator))
}

fn stated_velocity(draft: &mut Draft<'_>, position: Option<Ratio>) -> Option<Ratio> {
    let (exponent, numerator, denominator) = si_unit(draft, 0x60A9)?;
    let unit = match (numerator, denominator) {
        (TURN, MINUTE) => PER_MINUTE,
        (TURN, SECOND) => PER_SECOND,
        (INCREMENT, SECOND) => position?,
        _ => return None,
    };
    unit.scaled(exponent.checked_neg()?)
}

/// Where it is stated otherwise it is the unit of velocity per second.
fn stated_acceleration(draft: &mut Draft<'_>) -> Option<Ratio> {
    match si_unit(draft, 0x60AA)? {
        (exponent, RPM, SECOND) => PER_MINUTE.scaled(exponent.checked_neg()?),
        _ => None,
    }
}
