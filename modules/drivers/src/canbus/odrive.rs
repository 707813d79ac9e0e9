//! Keys of an ODrive by CAN Simple, and its place on the bus.

use super::keys::{not_zero, refuse_canopen};
use base::Duration;
use motorctl::{can, odrive};
use settings::{Parsed, Table, settings};
use std::fmt;

/// Greatest node id of an ODrive on CAN.
const NODE_MAX: u8 = odrive::wire::NODE_MAX;

settings! {
    /// An ODrive with firmware 0.6 by CAN Simple, for a wheel (docs/motor-controllers.md).
    #[derive(Clone, Debug, PartialEq)]
    pub struct OdriveConfig {
        /// Motor turns per wheel turn, not 0; negative when the motor is mounted the other way round.
        gear: f64 = required, -1000.0..=1000.0;
        /// Product line, version and variant of the hardware.
        hardware: Release = required, Parsed(Release::parse, "three numbers with dots: \"4.4.58\"", "4.4.58");
        /// Version of the firmware, for which the endpoints hold: the drive must have exactly this one.
        firmware: Release = required, Parsed(Release::parse, "three numbers with dots: \"0.6.10\"", "0.6.10");
        /// Endpoint of `axis0.config.enable_watchdog` in `flat_endpoints.json` of this hardware and firmware.
        enable_watchdog: u16 = required, 1..=65_535;
        /// Endpoint of `axis0.config.watchdog_timeout`, likewise.
        watchdog_timeout: u16 = required, 1..=65_535;
        /// Age of the heartbeat at which the drive is lost: at least twice the interval that is set in it.
        heartbeat_within_s as heartbeat_within: Duration = 0.06, 0.02..=0.1;
    }
    check OdriveConfig::check;
}

/// Three numbers of a version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Release(pub [u8; 3]);

impl Release {
    fn parse(text: &str) -> Option<Self> {
        let numbers: Option<Vec<u8>> = text.split('.').map(|number| number.parse().ok()).collect();
        numbers?.try_into().ok().map(Self)
    }
}

impl fmt::Display for Release {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [major, minor, revision] = self.0;
        write!(f, "{major}.{minor}.{revision}")
    }
}

impl OdriveConfig {
    fn check(&self, table: &Table<'_>) {
        not_zero(table, self.gear);
        if self.enable_watchdog == self.watchdog_timeout {
            table.refuse("watchdog_timeout", "another endpoint than enable_watchdog");
        }
    }

    /// Keys of its node that it cannot have.
    pub(super) fn check_node(id: u8, table: &Table<'_>) {
        if id > NODE_MAX {
            table.refuse("id", format_args!("an integer from 1 to {NODE_MAX}: that of an ODrive"));
        }
        refuse_canopen(table);
    }

    /// What it must be; `node`: its id.
    #[must_use]
    pub fn device(&self, node: u8) -> can::Device {
        let usual = odrive::Device::EXAMPLE;
        can::Device::Odrive(odrive::Device {
            node,
            version: odrive::wire::Version { hardware: self.hardware.0, firmware: self.firmware.0, ..usual.version },
            endpoints: odrive::Endpoints {
                enable_watchdog: self.enable_watchdog,
                watchdog_timeout: self.watchdog_timeout,
            },
            heartbeat_within: self.heartbeat_within,
        })
    }
}

/// True if identifiers of the ODrive with this node id are those of CANopen's services or of this node of CANopen.
pub(super) fn is_ambiguous(node: u8, canopen: u8) -> bool {
    let other = u16::from(canopen);
    // NMT; SYNC and emergencies; TIME; PDOs, SDOs and heartbeats of the node; LSS (CiA 301, CiA 305).
    let services = [0, 0x80, 0x100, 0x7E4, 0x7E5].into_iter();
    let own = [0x80].into_iter().chain((0x180..=0x600).step_by(0x80)).chain([0x700]).map(|first| first + other);
    services.chain(own).any(|id: u16| odrive::wire::node_of(id) == node)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_is_three_numbers() {
        assert_eq!(Release::parse("0.6.10"), Some(Release([0, 6, 10])));
        assert_eq!(Release([4, 4, 58]).to_string(), "4.4.58");
        for odd in ["", "0.6", "0.6.10.1", "0.6.x", "0.6.256", "v0.6.1"] {
            assert_eq!(Release::parse(odd), None, "{odd}");
        }
    }

    #[test]
    fn identifiers_of_an_odrive_are_those_of_canopen_or_not() {
        // 0x200 to 0x21F: RPDO1 of the nodes below 32.
        for (odrive, canopen, expected) in
            [(0x10, 31, true), (0x10, 32, false), (4, 64, true), (8, 64, true), (1, 127, false), (0x38, 1, true)]
        {
            assert_eq!(is_ambiguous(odrive, canopen), expected, "{odrive:#x} {canopen}");
        }
    }
}
