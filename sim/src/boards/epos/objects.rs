//! The object dictionary of the emulated EPOS 70/10, firmware 2033h.
//!
//! Source: `facts/canopen.md` 2.1 to 2.4, `data/eds/epos_sim.eds`.

use canopen::Dictionary;
use canopen::dictionary::Access::{Const, ReadOnly, ReadWrite};
use canopen::dictionary::DataType::{I8, I16, I32, Text, U8, U16, U32};
use canopen::dictionary::Entry;

/// Everything but the PDO records.
#[rustfmt::skip]
const OBJECTS: &[Entry] = &[
    Entry::new(0x1000, 0, U32, ReadOnly, 0x0002_0192), // Device type
    Entry::new(0x1001, 0, U8, ReadOnly, 0).mappable(), // Error register
    Entry::new(0x1003, 0, U8, ReadWrite, 0), // Number of entries
    Entry::new(0x1003, 1, U32, ReadOnly, 0), // Error 1
    Entry::new(0x1003, 2, U32, ReadOnly, 0), // Error 2
    Entry::new(0x1003, 3, U32, ReadOnly, 0), // Error 3
    Entry::new(0x1003, 4, U32, ReadOnly, 0), // Error 4
    Entry::new(0x1003, 5, U32, ReadOnly, 0), // Error 5
    Entry::new(0x1005, 0, U32, ReadWrite, 0x80), // COB-ID SYNC
    Entry::new(0x1008, 0, Text, Const, 0).text("EPOS"), // Device name
    Entry::new(0x100C, 0, U16, ReadWrite, 0), // Guard time
    Entry::new(0x100D, 0, U8, ReadWrite, 0), // Life time factor
    Entry::new(0x1010, 0, U8, ReadOnly, 1), // Number of entries
    Entry::new(0x1010, 1, U32, ReadWrite, 1), // Save all parameters
    Entry::new(0x1011, 0, U8, ReadOnly, 5), // Number of entries
    Entry::new(0x1011, 1, U32, ReadWrite, 1), // All
    Entry::new(0x1011, 5, U32, ReadWrite, 1), // PDO COB-IDs
    Entry::new(0x1014, 0, U32, ReadOnly, 0x80).plus_node_id(), // COB-ID EMCY
    Entry::new(0x1016, 0, U8, ReadOnly, 2), // Number of entries
    Entry::new(0x1016, 1, U32, ReadWrite, 0), // Consumer 1
    Entry::new(0x1016, 2, U32, ReadWrite, 0), // Consumer 2
    Entry::new(0x1017, 0, U16, ReadWrite, 0), // Producer heartbeat time
    Entry::new(0x1018, 0, U8, ReadOnly, 4), // Number of entries
    Entry::new(0x1018, 1, U32, ReadOnly, 0xFB), // Vendor ID
    Entry::new(0x1018, 2, U32, ReadOnly, 0x6410_0000), // Product code
    Entry::new(0x1018, 3, U32, ReadOnly, 0x2033_0000), // Revision
    Entry::new(0x1018, 4, U32, ReadOnly, 1), // Serial
    Entry::new(0x1020, 0, U8, ReadOnly, 2), // Number of entries
    Entry::new(0x1020, 1, U32, ReadWrite, 0), // Date
    Entry::new(0x1020, 2, U32, ReadWrite, 0), // Time
    Entry::new(0x1200, 0, U8, ReadOnly, 2), // Number of entries
    Entry::new(0x1200, 1, U32, ReadOnly, 0x600).plus_node_id(), // Client to server
    Entry::new(0x1200, 2, U32, ReadOnly, 0x580).plus_node_id(), // Server to client
    Entry::new(0x2000, 0, U8, ReadWrite, 1).limits(1, 127), // Node ID
    Entry::new(0x2001, 0, U16, ReadWrite, 0).limits(0, 6), // CAN bit rate
    Entry::new(0x2003, 0, U8, ReadOnly, 4), // Number of entries
    Entry::new(0x2003, 1, U16, ReadOnly, 0x2033), // Software
    Entry::new(0x2003, 2, U16, ReadOnly, 0x6410), // Hardware
    Entry::new(0x2003, 3, U16, ReadOnly, 0), // Application number
    Entry::new(0x2003, 4, U16, ReadOnly, 0), // Application version
    Entry::new(0x2008, 0, U16, ReadWrite, 0), // Miscellaneous configuration
    Entry::new(0x2028, 0, I32, ReadOnly, 0).mappable(), // Velocity actual averaged
    Entry::new(0x206B, 0, I32, ReadWrite, 0).mappable(), // Velocity mode setting value
    Entry::new(0x2071, 0, U8, ReadOnly, 4), // Number of entries
    Entry::new(0x2071, 1, U16, ReadOnly, 0).mappable(), // State
    Entry::new(0x2071, 2, U16, ReadWrite, 0xE007), // Mask
    Entry::new(0x2071, 3, U16, ReadWrite, 0), // Polarity
    Entry::new(0x2071, 4, U16, ReadWrite, 8), // Execution mask
    Entry::new(0x2080, 0, U16, ReadWrite, 500).mappable(), // Current threshold homing
    Entry::new(0x2081, 0, I32, ReadWrite, 0).mappable(), // Home position
    Entry::new(0x20F4, 0, I16, ReadOnly, 0).mappable(), // Following error actual
    Entry::new(0x2210, 0, U8, ReadOnly, 4), // Number of entries
    Entry::new(0x2210, 1, U16, ReadWrite, 500).limits(16, 7500), // Pulse number
    Entry::new(0x2210, 2, U16, ReadWrite, 1).limits(1, 3), // Sensor type
    Entry::new(0x2210, 4, U16, ReadWrite, 0), // Polarity
    Entry::new(0x6040, 0, U16, ReadWrite, 0).mappable(), // Controlword
    Entry::new(0x6041, 0, U16, ReadOnly, 0).mappable(), // Statusword
    Entry::new(0x6060, 0, I8, ReadWrite, 1).mappable(), // Modes of operation
    Entry::new(0x6061, 0, I8, ReadOnly, 1).mappable(), // Modes of operation display
    Entry::new(0x6062, 0, I32, ReadOnly, 0).mappable(), // Position demand
    Entry::new(0x6064, 0, I32, ReadOnly, 0).mappable(), // Position actual
    Entry::new(0x6065, 0, U32, ReadWrite, 2000).mappable(), // Max following error
    Entry::new(0x6067, 0, U32, ReadWrite, u32::MAX as i64), // Position window
    Entry::new(0x6068, 0, U16, ReadWrite, 0), // Position window time
    Entry::new(0x6069, 0, I32, ReadOnly, 0).mappable(), // Velocity sensor actual
    Entry::new(0x606B, 0, I32, ReadOnly, 0).mappable(), // Velocity demand
    Entry::new(0x606C, 0, I32, ReadOnly, 0).mappable(), // Velocity actual
    Entry::new(0x6078, 0, I16, ReadOnly, 0).mappable(), // Current actual
    Entry::new(0x607A, 0, I32, ReadWrite, 0).mappable(), // Target position
    Entry::new(0x607C, 0, I32, ReadWrite, 0).mappable(), // Home offset
    Entry::new(0x607D, 0, U8, ReadOnly, 2), // Number of entries
    Entry::new(0x607D, 1, I32, ReadWrite, i32::MIN as i64), // Min
    Entry::new(0x607D, 2, I32, ReadWrite, i32::MAX as i64), // Max
    Entry::new(0x607F, 0, U32, ReadWrite, 25_000).limits(1, 25_000), // Max profile velocity
    Entry::new(0x6081, 0, U32, ReadWrite, 1000).limits(1, 25_000).mappable(), // Profile velocity
    Entry::new(0x6083, 0, U32, ReadWrite, 10_000).limits(1, u32::MAX as i64).mappable(), // Profile acceleration
    Entry::new(0x6084, 0, U32, ReadWrite, 10_000).limits(1, u32::MAX as i64).mappable(), // Profile deceleration
    Entry::new(0x6085, 0, U32, ReadWrite, 10_000).limits(1, u32::MAX as i64).mappable(), // Quick stop deceleration
    Entry::new(0x6086, 0, I16, ReadWrite, 0).limits(0, 1).mappable(), // Motion profile type
    Entry::new(0x6098, 0, I8, ReadWrite, 7).mappable(), // Homing method
    Entry::new(0x6099, 0, U8, ReadOnly, 2), // Number of entries
    Entry::new(0x6099, 1, U32, ReadWrite, 100).mappable(), // Switch search
    Entry::new(0x6099, 2, U32, ReadWrite, 10).mappable(), // Zero search
    Entry::new(0x609A, 0, U32, ReadWrite, 1000).mappable(), // Homing acceleration
    Entry::new(0x60FF, 0, I32, ReadWrite, 0).mappable(), // Target velocity
    Entry::new(0x6402, 0, U16, ReadWrite, 10), // Motor type
    Entry::new(0x6410, 0, U8, ReadOnly, 5), // Number of entries
    Entry::new(0x6410, 1, U16, ReadWrite, 5000).limits(0, 10_000).mappable(), // Continuous current limit
    Entry::new(0x6410, 2, U16, ReadWrite, 10_000).limits(0, 25_000).mappable(), // Output current limit
    Entry::new(0x6410, 3, U8, ReadWrite, 1).limits(1, 255), // Pole pairs
    Entry::new(0x6410, 4, U16, ReadWrite, 30_000).limits(1, 65_535).mappable(), // Max speed in current mode
    Entry::new(0x6410, 5, U16, ReadWrite, 40).limits(1, 5400), // Thermal time constant
    Entry::new(0x6502, 0, U32, Const, 0x003F_0025), // Supported drive modes
];

/// An EPOS 70/10 with this node id, as it is after power-on.
#[must_use]
pub fn dictionary(node: u8) -> Dictionary {
    Dictionary::new(node)
        .with(OBJECTS)
        .with_rpdo(1, 0x200, &[0x6040_0010], false)
        .with_rpdo(2, 0x300, &[0x6040_0010, 0x6060_0008], false)
        .with_rpdo(3, 0x400, &[0x6040_0010, 0x607A_0020], false)
        .with_rpdo(4, 0x500, &[0x6040_0010, 0x60FF_0020], false)
        .with_tpdo(1, 0x4000_0180, &[0x6041_0010], false)
        .with_tpdo(2, 0xC000_0280, &[0x6041_0010, 0x6061_0008], false)
        .with_tpdo(3, 0xC000_0380, &[0x6041_0010, 0x6064_0020], false)
        .with_tpdo(4, 0xC000_0480, &[0x6041_0010, 0x606C_0020], false)
}
