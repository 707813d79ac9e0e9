//! What a drive can do: its modes, and its homing.

use super::description::Description;
use super::draft::Draft;
use super::refusal::{Reason, Refusal};
use super::sheet::Sheet;
use crate::axis::modes::Mode;
use crate::axis::modes::cyclic::interpolation_period;
use crate::dictionary::DataType;
use crate::drives::cia402::Quantity;
use crate::master::Expect;
use alloc::vec::Vec;
use base::Duration;

/// Longest period of SYNC at which set-points are commanded.
const SYNC_MAX: Duration = Duration::from_millis(20);

/// Modes of a drive in the form of 0x6502, as its sheet states them, else by the objects that it has; true if stated.
pub(super) fn offered(sheet: Sheet<'_>) -> (u32, bool) {
    if let Some(modes) = sheet.stated(0x6502, 0).filter(|modes| *modes != 0) {
        return (modes as u32, true);
    }
    let has = |objects: &[u16]| objects.iter().all(|index| sheet.has(*index));
    let bit = |mode: Mode, objects: &[u16]| if has(objects) { mode.bit() } else { 0 };
    let modes = bit(Mode::ProfileVelocity, &[0x60FF, 0x606C])
        | bit(Mode::ProfilePosition, &[0x607A, 0x6064, 0x6081])
        | bit(Mode::CyclicPosition, &[0x607A, 0x6064, 0x60C2])
        | bit(Mode::CyclicVelocity, &[0x60FF, 0x606C, 0x60C2])
        | bit(Mode::Velocity, &[0x6042, 0x6044])
        | bit(Mode::Interpolated, &[0x60C1])
        | bit(Mode::Homing, &[0x6098]);
    (modes, false)
}

/// Target and actual value of a mode, as in a mapping; `None`: it is not driven.
pub(super) const fn objects(mode: Mode) -> Option<(u32, u32)> {
    match mode {
        Mode::ProfileVelocity | Mode::CyclicVelocity => Some((0x60FF_0020, 0x606C_0020)),
        Mode::ProfilePosition | Mode::CyclicPosition => Some((0x607A_0020, 0x6064_0020)),
        Mode::Interpolated => Some((0x60C1_0120, 0x6064_0020)),
        _ => None,
    }
}

/// The objects of the mode that is wanted.
pub(super) fn mode(draft: &mut Draft<'_>) -> Result<(u32, u32), Refusal> {
    let (sheet, wanted) = (draft.sheet, draft.description.mode);
    let (offered, stated) = offered(sheet);
    let refusal = Refusal::new(0x6502, 0, Reason::Mode { wanted, offered });
    let (target, value) = objects(wanted).filter(|_| wanted.is_supported(offered)).ok_or(refusal)?;
    let homing = draft.description.homing.is_some();
    if homing && !Mode::Homing.is_supported(offered) {
        return Err(Refusal::new(0x6502, 0, Reason::Mode { wanted: Mode::Homing, offered }));
    }
    if stated || sheet.has(0x6502) {
        let expect = if homing { Mode::expect(&[wanted, Mode::Homing]) } else { Mode::expect(&[wanted]) };
        draft.verify(expect);
    }
    sheet.typed(0x6040, 0, DataType::U16)?;
    sheet.typed(0x6041, 0, DataType::U16)?;
    sheet.typed(0x6061, 0, DataType::I8)?;
    for entry in [target, value] {
        sheet.typed((entry >> 16) as u16, (entry >> 8) as u8, DataType::I32)?;
    }
    Ok((target, value))
}

/// The mode in which a wheel is driven if nobody says it: profile velocity, else cyclic synchronous velocity where the
/// drive offers that.
pub(super) fn of_velocity(sheet: Sheet<'_>) -> Mode {
    first_of(sheet, Mode::ProfileVelocity, &[Mode::CyclicVelocity])
}

/// The same of a steering: profile position, else cyclic synchronous or interpolated position.
pub(super) fn of_position(sheet: Sheet<'_>) -> Mode {
    first_of(sheet, Mode::ProfilePosition, &[Mode::CyclicPosition, Mode::Interpolated])
}

/// `usual`, unless only others are offered: then the first of them.
fn first_of(sheet: Sheet<'_>, usual: Mode, others: &[Mode]) -> Mode {
    let (offered, _) = offered(sheet);
    let other = others.iter().copied().find(|mode| mode.is_supported(offered));
    other.filter(|_| !usual.is_supported(offered)).unwrap_or(usual)
}

/// The period of set-points, for the modes that have one. A velocity may come without SYNC, at a period of its own; a
/// command that waits for a slow SYNC would stop the drive late.
pub(super) fn period(draft: &mut Draft<'_>) -> Result<(), Refusal> {
    let Description { mode, sync, setpoints, .. } = *draft.description;
    let period = match mode {
        Mode::CyclicPosition | Mode::Interpolated => sync,
        Mode::CyclicVelocity => sync.or(setpoints),
        _ => return Ok(()),
    };
    if let Some(slow) = sync.filter(|sync| *sync > SYNC_MAX) {
        let micros = |period: Duration| (period.as_nanos() / 1000) as i64;
        let reason = Reason::OutOfLimits { value: micros(slow), low: 1000, high: micros(SYNC_MAX) };
        return Err(Refusal::new(0x1006, 0, reason));
    }
    let period = period.and_then(|period| whole_millis(period).or_else(|| interpolation_period(period)));
    let (mantissa, exponent) = period.ok_or(Refusal::new(0x1006, 0, Reason::NoSync))?;
    if mode == Mode::Interpolated {
        // Along a line.
        draft.set_where_there(0x60C0, 0, 0);
    }
    for (sub, value) in [(1, i64::from(mantissa)), (2, i64::from(exponent))] {
        match draft.set(0x60C2, sub, Quantity::Fixed(value)) {
            // Without the object the drive follows each set-point when it comes; a velocity is followed at any period.
            Ok(()) | Err(Refusal { reason: Reason::Missing, .. }) => {}
            Err(_) if mode == Mode::CyclicVelocity => {}
            // Positions are interpolated over this period: another one makes each of them a jerk.
            Err(Refusal { reason: Reason::NotWritable, .. }) => {
                draft.verify(Expect::masked(0x60C2, sub, 0xFF, u32::from(value.to_le_bytes()[0])));
            }
            Err(refusal) => return Err(refusal),
        }
    }
    Ok(())
}

/// A period in ms, the exponent that most drives have, where it can be had so.
fn whole_millis(period: Duration) -> Option<(u8, i8)> {
    let millis = u8::try_from(period.as_millis()).ok().filter(|millis| *millis > 0)?;
    (Duration::from_millis(millis.into()) == period).then_some((millis, -3))
}

/// The homing methods that the sheet lists (0x60E3); `None`: it lists none.
pub(super) fn methods(sheet: Sheet<'_>) -> Option<Vec<i8>> {
    let listed = (1..=254).filter_map(|sub| sheet.stated(0x60E3, sub));
    let listed: Vec<i8> = listed.filter_map(|method| i8::try_from(method).ok()).collect();
    (!listed.is_empty()).then_some(listed)
}

/// The objects of homing, where it is wanted; true if the drive has an acceleration for it.
pub(super) fn homing(draft: &Draft<'_>) -> Result<bool, Refusal> {
    let sheet = draft.sheet;
    let Some(method) = draft.description.homing else {
        return Ok(false);
    };
    if methods(sheet).is_some_and(|methods| !methods.contains(&method)) {
        return Err(Refusal::new(0x60E3, 0, Reason::Method(method)));
    }
    let typed = |index, sub, data_type| sheet.writable(index, sub).and(sheet.typed(index, sub, data_type));
    sheet.check(typed(0x6098, 0, DataType::I8)?, method.into())?;
    typed(0x6099, 1, DataType::U32)?;
    typed(0x6099, 2, DataType::U32)?;
    typed(0x607C, 0, DataType::I32)?;
    Ok(typed(0x609A, 0, DataType::U32).is_ok())
}
