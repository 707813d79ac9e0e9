//! Bus interface of a sensor, without an operating system and without allocation.
#![no_std]

use lcm::codec::{DecodeError, EncodeError, Type, View};
use sensor::{CommandRef, Range};

include!(concat!(env!("OUT_DIR"), "/types.rs"));

/// Size of a range message, which is constant: fingerprint and body.
pub const RANGE_SIZE: usize = 8 + Range::MIN_SIZE;

/// Message for a distance in metres.
///
/// # Errors
/// Not expected: every range can be encoded and fits.
pub fn report(timestamp: i64, distance: f32) -> Result<[u8; RANGE_SIZE], EncodeError> {
    let status = if distance.is_finite() { Range::OK } else { Range::NO_ECHO };
    let mut message = [0; RANGE_SIZE];
    Range { timestamp, distance, status }.encode_into(&mut message)?;
    Ok(message)
}

/// Measuring range and new firmware, if the command is for `name`. Both borrow from the message.
///
/// # Errors
/// The message is not a command.
pub fn obey<'a>(name: &str, message: &'a [u8]) -> Result<Option<(f32, &'a [u8])>, DecodeError> {
    let command = CommandRef::decode(message)?;
    Ok((command.name == name).then_some((command.range_max, command.firmware)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_is_a_message() {
        assert_eq!(Range::decode(&report(7, 1.5).unwrap()), Ok(Range { timestamp: 7, distance: 1.5, status: 0 }));
    }

    #[test]
    fn a_command_is_executed_by_its_addressee() {
        let command = sensor::Command { name: "front".into(), range_max: 4.0, firmware: [1, 2].into() };
        let mut message = lcm::codec::Vec::new();
        command.encode(&mut message).unwrap();
        assert_eq!(obey("front", &message), Ok(Some((4.0, &[1, 2][..]))));
        assert_eq!(obey("rear", &message), Ok(None));
    }
}
