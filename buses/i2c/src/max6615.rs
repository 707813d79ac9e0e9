//! MAX6615 (board BR-FAN1): two temperatures, two fans, over SMBus bytes. Register map and rules: `docs/facts/robot.md`
//! 2.3; where that page is silent, the data sheet (19-3713 rev. 2) and that of its sibling MAX6678.
//!
//! [`fields`] converts register values to physical values and back; [`Max6615`] is the driver: it gives the next
//! transfer and takes its outcome; [`chip::Chip`] is the other end, for the simulator; [`hal::FanController`] runs the
//! driver on any `embedded-hal` bus.

pub mod chip;
mod config;
mod driver;
pub mod fields;
pub mod hal;

pub use config::{Config, Fan, Invalid, Mode};
pub use driver::{Event, Max6615, Reading, Why};

/// Access to a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Read only: a write changes nothing.
    Read,
    /// Read and write.
    ReadWrite,
}

/// A row of the register map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// Address: the SMBus command code.
    pub address: u8,
    /// Name, for people.
    pub name: &'static str,
    /// Access.
    pub access: Access,
    /// Power-on value; `None` where it depends on the surroundings.
    pub power_on: Option<u8>,
    /// The bits that there are; the others read 0.
    pub mask: u8,
}

macro_rules! registers {
    ($($constant:ident $address:literal $name:literal $access:ident $power_on:expr, $mask:literal;)*) => {
        /// Addresses of the registers; those of channel or fan 2 follow theirs.
        #[allow(missing_docs, reason = "the table has each one's name")]
        pub mod register {
            $(pub const $constant: u8 = $address;)*
        }
        /// The register map, by address.
        pub const REGISTERS: &[Register] = &[
            $(Register { address: $address, name: $name, access: Access::$access, power_on: $power_on, mask: $mask },)*
        ];
    };
}

registers! {
    TEMPERATURE       0x00 "temperature 1"           Read      None,       0xFF;
    TEMPERATURE_2     0x01 "temperature 2"           Read      None,       0xFF;
    CONFIGURATION     0x02 "configuration"           ReadWrite Some(0x18), 0xFF;
    LIMIT             0x03 "over-temperature limit 1" ReadWrite Some(0x6E), 0xFF;
    LIMIT_2           0x04 "over-temperature limit 2" ReadWrite Some(0x50), 0xFF;
    OVER              0x05 "over-temperature status" Read      None,       0xC0;
    OVER_MASK         0x06 "over-temperature mask"   ReadWrite Some(0x00), 0xC0;
    START_DUTY        0x07 "fan-start duty 1"        ReadWrite Some(0x60), 0xFF;
    START_DUTY_2      0x08 "fan-start duty 2"        ReadWrite Some(0x60), 0xFF;
    MAXIMUM_DUTY      0x09 "maximum duty 1"          ReadWrite Some(0xF0), 0xFF;
    MAXIMUM_DUTY_2    0x0A "maximum duty 2"          ReadWrite Some(0xF0), 0xFF;
    TARGET_DUTY       0x0B "target duty 1"           ReadWrite Some(0x00), 0xFF;
    TARGET_DUTY_2     0x0C "target duty 2"           ReadWrite Some(0x00), 0xFF;
    DUTY              0x0D "duty 1"                  Read      Some(0x00), 0xFE;
    DUTY_2            0x0E "duty 2"                  Read      Some(0x00), 0xFE;
    START_TEMPERATURE 0x0F "fan-start temperature 1" ReadWrite Some(0x00), 0xFF;
    START_TEMPERATURE_2 0x10 "fan-start temperature 2" ReadWrite Some(0x00), 0xFF;
    FAN_CONFIGURATION 0x11 "fan configuration"       ReadWrite Some(0x00), 0xFC;
    RATE              0x12 "duty rate of change"     ReadWrite Some(0xB4), 0xFC;
    STEP              0x13 "duty step"               ReadWrite Some(0x55), 0xFF;
    FREQUENCY         0x14 "PWM frequency"           ReadWrite Some(0x40), 0xE0;
    GPIO_FUNCTION     0x15 "GPIO function, MAX6616"  ReadWrite None,       0x3F;
    GPIO_VALUE        0x16 "GPIO value, MAX6616"     ReadWrite None,       0x3F;
    OFFSET            0x17 "thermistor offsets"      ReadWrite Some(0x00), 0xFF;
    TACH              0x18 "tachometer count 1"      Read      Some(0xFF), 0xFF;
    TACH_2            0x19 "tachometer count 2"      Read      Some(0xFF), 0xFF;
    TACH_LIMIT        0x1A "tachometer limit 1"      ReadWrite Some(0xFF), 0xFF;
    TACH_LIMIT_2      0x1B "tachometer limit 2"      ReadWrite Some(0xFF), 0xFF;
    FAN_STATUS        0x1C "fan status"              ReadWrite Some(0x00), 0xFF;
    FRACTION          0x1E "temperature 1, fraction" Read      None,       0xE0;
    FRACTION_2        0x1F "temperature 2, fraction" Read      None,       0xE0;
    REVISION          0xFD "revision"                Read      Some(0x01), 0xFF;
    DEVICE            0xFE "device"                  Read      Some(0x68), 0xFF;
    MANUFACTURER      0xFF "manufacturer"            Read      Some(0x4D), 0xFF;
}

/// The row of a register; `None` where the map has none.
#[must_use]
pub fn find(address: u8) -> Option<&'static Register> {
    REGISTERS.iter().find(|register| register.address == address)
}

/// Value of [`register::DEVICE`].
pub const DEVICE: u8 = 0x68;
/// Value of [`register::MANUFACTURER`]: Maxim.
pub const MANUFACTURER: u8 = 0x4D;
/// The address with both select pins low, as on BR-FAN1.
pub const ADDRESS: u8 = 0x18;
/// The nine addresses that its select pins give it.
pub const ADDRESSES: [u8; 9] = [0x18, 0x19, 0x1A, 0x29, 0x2A, 0x2B, 0x4C, 0x4D, 0x4E];

#[cfg(test)]
mod tests;
