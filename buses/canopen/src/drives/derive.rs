//! Any CiA 402 drive by its data sheet: a [`Table`] out of an EDS and a few facts that no sheet states.
//!
//! What the table relies on is written and read back, or compared, at each boot-up, before the first motion. What a
//! drive lacks to stop by itself refuses it, unless another way to stop the motor exists or its manual vouches for it.
//! A sheet is hostile input: whatever it says, the result is a table or a [`Refusal`].
//!
//! Read `stop` first: what a drive must have; then `pdos` and `units`.

mod description;
mod draft;
mod modes;
mod motor;
mod motor_speed;
mod pdos;
mod refusal;
mod sheet;
mod stop;
#[cfg(test)]
mod tests;
mod units;

pub use description::{Description, Limits, Quirks, VelocityUnit};
pub use refusal::{Reason, Refusal};
pub use units::{Ratio, Scale};

use super::cia402::{Parameters, Quantity, Setting, Table};
use crate::axis::modes::Mode;
use crate::axis::{Units, control};
use crate::dictionary::DataType;
use crate::eds::Eds;
use crate::master::Expect;
use alloc::borrow::Cow;
use alloc::vec::Vec;
use draft::Draft;
use sheet::Sheet;

/// Margin of the drive's own limit of velocity above what is demanded, for its controller.
const MARGIN: f64 = 1.1;
/// Low word of 0x1000.
const PROFILE: u16 = 402;

/// A drive as its sheet and its description make it.
#[derive(Clone, Debug)]
pub struct Derived {
    /// What is booted and commanded. It belongs to one node: identifiers are in it.
    pub table: Table,
    /// The values.
    pub parameters: Parameters,
    /// SI of the output to the drive's units.
    pub units: Units,
    /// The same per turn of the motor, exact.
    pub scale: Scale,
    /// Turns of the motor per m or rad of the output; negative when they turn in opposite directions.
    pub turns: f64,
    /// Modes of operation that the drive offers.
    pub modes: Vec<Mode>,
    /// Homing methods that it lists; `None`: it lists none.
    pub methods: Option<Vec<i8>>,
    /// True if homing has an acceleration of its own, 0x609A.
    pub homing_acceleration: bool,
    /// What the drive lacks to stop by itself: the second way stands in for it.
    pub reservations: Vec<Refusal>,
}

/// The drive of a data sheet, as node `node`.
///
/// # Errors
/// The first object that is missing, or unfit.
pub fn derive(eds: &Eds, node: u8, description: &Description) -> Result<Derived, Refusal> {
    let sheet = Sheet { eds, node: node.clamp(1, 127) };
    is_drive(sheet)?;
    let parameters = Parameters {
        node: sheet.node,
        velocity: 1,
        acceleration: 1,
        deceleration: 1,
        quick_stop_deceleration: 1,
        remap: false,
    };
    let (settings, identity, reservations) = (Vec::new(), identity(sheet, description), Vec::new());
    let mut draft = Draft { sheet, description, parameters, settings, identity, reservations };
    let (target, value) = modes::mode(&mut draft)?;
    let (scale, turns, units) = units::units(&mut draft)?;
    if objects_are_positions(description.mode) && scale.position.is_none() {
        return Err(Refusal::new(0x608F, 1, Reason::NoUnit));
    }
    limits(&mut draft, &units)?;
    motor_speed::motor_speed(&mut draft, turns)?;
    let keeps_quick_stop = stop::stops(&mut draft)?;
    let supervision = stop::supervision(&mut draft)?;
    modes::period(&mut draft)?;
    let homing_acceleration = modes::homing(&draft)?;
    // The direction is that of the gear.
    draft.set_where_there(0x607E, 0, 0);
    let pdos = pdos::pdos(&mut draft, target, value)?;
    let (offered, _) = modes::offered(sheet);
    let motor = motor::readings(sheet, &description.quirks)?;
    let Draft { parameters, settings, identity, reservations, .. } = draft;
    let table = Table {
        device_type: None,
        identity: Cow::Owned(identity),
        settings: Cow::Owned(settings),
        mode: description.mode,
        rpdo: pdos.rpdo,
        rpdos: pdos.rpdos.into(),
        target,
        tpdos: Cow::Owned(pdos.tpdos),
        value,
        quick_stop: description.quirks.quick_stop.unwrap_or(control::QUICK_STOP),
        keeps_quick_stop,
        homed: description.quirks.homed,
        watches_master: supervision.watches_master,
        guarding: supervision.guarding,
        motor: Cow::Owned(motor),
    };
    Ok(Derived {
        table,
        parameters,
        units,
        scale,
        turns,
        modes: Mode::ALL.into_iter().filter(|mode| mode.is_supported(offered)).collect(),
        methods: modes::methods(sheet),
        homing_acceleration,
        reservations,
    })
}

/// The mode in which a wheel is driven by this sheet if nobody says it: profile velocity, unless the drive offers only
/// cyclic synchronous velocity.
#[must_use]
pub fn velocity_mode(eds: &Eds, node: u8) -> Mode {
    modes::of_velocity(Sheet { eds, node: node.clamp(1, 127) })
}

/// The same of a steering: profile position, unless the drive offers only cyclic synchronous or interpolated position.
#[must_use]
pub fn position_mode(eds: &Eds, node: u8) -> Mode {
    modes::of_position(Sheet { eds, node: node.clamp(1, 127) })
}

/// The output of a holding brake, bit 0 of 0x60FE:1, can be switched and read back; true if it has a mask, 0x60FE:2.
///
/// # Errors
/// The output is missing, is no number of 32 bits, or cannot be written.
pub fn brake_output(eds: &Eds) -> Result<bool, Refusal> {
    let sheet = Sheet { eds, node: 1 };
    let switched = |sub| {
        let object = sheet.typed(0x60FE, sub, DataType::U32)?;
        let switched = object.access.writes() && object.access.reads();
        if switched { Ok(()) } else { Err(Refusal::new(0x60FE, sub, Reason::NotWritable)) }
    };
    switched(1)?;
    if eds.object(0x60FE, 2).is_some() { switched(2).map(|()| true) } else { Ok(false) }
}

/// True if set-points of this mode are positions.
const fn objects_are_positions(mode: Mode) -> bool {
    matches!(mode, Mode::ProfilePosition | Mode::CyclicPosition | Mode::Interpolated)
}

/// A device without a profile in its sheet is one if it has a controlword.
fn is_drive(sheet: Sheet<'_>) -> Result<(), Refusal> {
    let profile = sheet.stated(0x1000, 0).map(|device| device as u16);
    match profile {
        Some(PROFILE) => Ok(()),
        None | Some(0) if sheet.has(0x6040) => Ok(()),
        _ => Err(Refusal::new(0x1000, 0, Reason::Profile(profile.unwrap_or(0)))),
    }
}

/// What the device must be.
fn identity(sheet: Sheet<'_>, description: &Description) -> Vec<Expect> {
    // The upper word is the kind of motor, or says that there are several axes.
    let device = Expect::masked(0x1000, 0, 0xFFFF, PROFILE.into());
    let stated = |sub| {
        let number = sheet.stated(0x1018, sub).filter(|number| *number != 0)?;
        Some(Expect::equal(0x1018, sub, number as u32))
    };
    let own = description.quirks.identity.iter().copied();
    let is_given = own.clone().any(|expect| expect.index == 0x1018 && expect.sub <= 2);
    let of_sheet = [1, 2].into_iter().filter_map(stated).filter(|_| !is_given);
    core::iter::once(device).chain(own).chain(of_sheet).collect()
}

/// Mode, greatest velocity, and the values of the ramps.
fn limits(draft: &mut Draft<'_>, units: &Units) -> Result<(), Refusal> {
    let (sheet, limits, mode) = (draft.sheet, draft.description.limits, draft.description.mode);
    draft.parameters.acceleration = units.acceleration(limits.acceleration);
    draft.parameters.deceleration = units.acceleration(limits.deceleration);
    draft.parameters.quick_stop_deceleration = units.acceleration(limits.quick_stop);
    draft.parameters.velocity = units.speed(limits.velocity);
    sheet.typed(0x6060, 0, DataType::I8)?;
    draft.set(0x6060, 0, Quantity::Fixed(mode.code().into()))?;
    match mode {
        Mode::ProfilePosition => {
            let result = draft.set(0x6081, 0, Quantity::Velocity);
            draft.excused(result).map(drop)
        }
        Mode::ProfileVelocity | Mode::CyclicVelocity => greatest_velocity(draft, units.speed(limits.velocity * MARGIN)),
        _ => Ok(()),
    }?;
    if let Some(range) = draft.description.range {
        let [one, other] = range.map(|position| i64::from(units.position(position)));
        draft.set_where_there(0x607D, 1, one.min(other));
        draft.set_where_there(0x607D, 2, one.max(other));
    }
    Ok(())
}

/// The drive's own limit, where it has one: with the margin, as far as the drive takes it.
fn greatest_velocity(draft: &mut Draft<'_>, with_margin: u32) -> Result<(), Refusal> {
    let Ok(object) = draft.sheet.writable(0x607F, 0) else {
        return Ok(());
    };
    draft.sheet.check(object, draft.parameters.velocity.into())?;
    let (_, high) = draft.sheet.limits(object);
    draft.parameters.velocity = with_margin.min(u32::try_from(high).unwrap_or(u32::MAX));
    draft.settings.push(Setting::new(0x607F, object.data_type, Quantity::Velocity));
    Ok(())
}
