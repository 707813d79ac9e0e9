//! What a drive measures of its motor, by its data sheet.

use super::description::Quirks;
use super::refusal::{Reason, Refusal};
use super::sheet::Sheet;
use crate::drives::motor::{Own, Reading, Topic, Unit};
use alloc::vec::Vec;

const MILLI: Unit = Unit::Decimal(-3);

/// The readings of CiA 402-2 that the drive has, and those that its manual names in place of them.
pub(super) fn readings(sheet: Sheet<'_>, quirks: &Quirks) -> Result<Vec<Reading>, Refusal> {
    let standard = |topic, index, unit| {
        let object = sheet.integer(index, 0).ok().filter(|object| object.access.reads())?;
        Some(Reading::new(topic, index, object.data_type, unit))
    };
    let own = |topic, Own { index, sub, unit }| {
        let object = sheet.integer(index, sub)?;
        let reading = Reading { topic, index, sub, data_type: object.data_type, unit };
        if object.access.reads() { Ok(reading) } else { Err(Refusal::new(index, sub, Reason::Type)) }
    };
    let rated_current = standard(Topic::RatedCurrent, 0x6075, MILLI);
    let current = match quirks.current {
        Some(named) => Some(own(Topic::Current, named)?),
        // Without the rated current the unit is not that of CiA 402: the EPOS has mA there.
        None => rated_current.and_then(|_| standard(Topic::Current, 0x6078, Unit::PerMille)),
    };
    let rated_torque = standard(Topic::RatedTorque, 0x6076, MILLI);
    let torque = rated_torque.and_then(|_| standard(Topic::Torque, 0x6077, Unit::PerMille));
    let temperature = quirks.temperature.map(|named| own(Topic::Temperature, named)).transpose()?;
    let rated = [rated_current.filter(|_| current.is_some()), rated_torque.filter(|_| torque.is_some())];
    Ok(rated.into_iter().chain([current, torque, temperature]).flatten().collect())
}
