//! The object dictionary of the emulated IclA N065.
//!
//! Source: the stated assumption of `facts/canopen.md` 3 and `data/eds/icla_sim.eds`; no document of the real drive
//! was found.

use canopen::Dictionary;
use canopen::dictionary::Access::{Const, ReadOnly, ReadWrite, WriteOnly};
use canopen::dictionary::DataType::{Domain, I8, I16, I32, Text, U8, U16, U32};
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
    Entry::new(0x1008, 0, Text, Const, 0).text("Position drive, simulated, with a long device name"), // Device name
    Entry::new(0x100C, 0, U16, ReadWrite, 0), // Guard time
    Entry::new(0x100D, 0, U8, ReadWrite, 0), // Life time factor
    Entry::new(0x1010, 0, U8, ReadOnly, 1), // Number of entries
    Entry::new(0x1010, 1, U32, ReadWrite, 1), // Save all parameters
    Entry::new(0x1011, 0, U8, ReadOnly, 1), // Number of entries
    Entry::new(0x1011, 1, U32, ReadWrite, 1), // All
    Entry::new(0x1012, 0, U32, ReadWrite, 0x8000_0100), // COB-ID TIME
    Entry::new(0x1014, 0, U32, ReadOnly, 0x80).plus_node_id(), // COB-ID EMCY
    Entry::new(0x1015, 0, U16, ReadWrite, 0), // Inhibit time EMCY
    Entry::new(0x1016, 0, U8, ReadOnly, 2), // Number of entries
    Entry::new(0x1016, 1, U32, ReadWrite, 0), // Consumer 1
    Entry::new(0x1016, 2, U32, ReadWrite, 0), // Consumer 2
    Entry::new(0x1017, 0, U16, ReadWrite, 0), // Producer heartbeat time
    Entry::new(0x1018, 0, U8, ReadOnly, 4), // Number of entries
    Entry::new(0x1018, 1, U32, ReadOnly, 0x0200_005A), // Vendor ID
    Entry::new(0x1018, 2, U32, ReadOnly, 0x4E30_3635), // Product code
    Entry::new(0x1018, 3, U32, ReadOnly, 0x0001_0002), // Revision
    Entry::new(0x1018, 4, U32, ReadOnly, 2), // Serial
    Entry::new(0x1019, 0, U8, ReadWrite, 0), // SYNC counter overflow
    Entry::new(0x1020, 0, U8, ReadOnly, 2), // Number of entries
    Entry::new(0x1020, 1, U32, ReadWrite, 0), // Date
    Entry::new(0x1020, 2, U32, ReadWrite, 0), // Time
    Entry::new(0x1029, 0, U8, ReadOnly, 1), // Number of entries
    Entry::new(0x1029, 1, U8, ReadWrite, 0).limits(0, 2), // Communication error
    Entry::new(0x1200, 0, U8, ReadOnly, 2), // Number of entries
    Entry::new(0x1200, 1, U32, ReadOnly, 0x600).plus_node_id(), // Client to server
    Entry::new(0x1200, 2, U32, ReadOnly, 0x580).plus_node_id(), // Server to client
    Entry::new(0x2F00, 0, Domain, ReadWrite, 0), // Data block
    Entry::new(0x2F01, 0, U16, WriteOnly, 0), // Write-only test
    Entry::new(0x6007, 0, I16, ReadWrite, 3).limits(0, 3), // Abort connection option code
    Entry::new(0x603F, 0, U16, ReadOnly, 0).mappable(), // Error code
    Entry::new(0x6040, 0, U16, ReadWrite, 0).mappable(), // Controlword
    Entry::new(0x6041, 0, U16, ReadOnly, 0).mappable(), // Statusword
    Entry::new(0x605A, 0, I16, ReadWrite, 2).limits(0, 7), // Quick stop option code
    Entry::new(0x605B, 0, I16, ReadWrite, 0).limits(0, 1), // Shutdown option code
    Entry::new(0x605C, 0, I16, ReadWrite, 1).limits(0, 1), // Disable operation option code
    Entry::new(0x605D, 0, I16, ReadWrite, 1).limits(1, 2), // Halt option code
    Entry::new(0x605E, 0, I16, ReadWrite, 2).limits(0, 2), // Fault reaction option code
    Entry::new(0x6060, 0, I8, ReadWrite, 0).mappable(), // Modes of operation
    Entry::new(0x6061, 0, I8, ReadOnly, 0).mappable(), // Modes of operation display
    Entry::new(0x6062, 0, I32, ReadOnly, 0).mappable(), // Position demand
    Entry::new(0x6064, 0, I32, ReadOnly, 0).mappable(), // Position actual
    Entry::new(0x6065, 0, U32, ReadWrite, 8192).mappable(), // Following error window
    Entry::new(0x6067, 0, U32, ReadWrite, 16), // Position window
    Entry::new(0x6068, 0, U16, ReadWrite, 0), // Position window time
    Entry::new(0x606B, 0, I32, ReadOnly, 0).mappable(), // Velocity demand
    Entry::new(0x606C, 0, I32, ReadOnly, 0).mappable(), // Velocity actual
    Entry::new(0x607A, 0, I32, ReadWrite, 0).mappable(), // Target position
    Entry::new(0x607C, 0, I32, ReadWrite, 0), // Home offset
    Entry::new(0x607D, 0, U8, ReadOnly, 2), // Number of entries
    Entry::new(0x607D, 1, I32, ReadWrite, i32::MIN as i64), // Min
    Entry::new(0x607D, 2, I32, ReadWrite, i32::MAX as i64), // Max
    Entry::new(0x607F, 0, U32, ReadWrite, 5000).limits(1, 10_000), // Max profile velocity
    Entry::new(0x6081, 0, U32, ReadWrite, 600).limits(1, 10_000).mappable(), // Profile velocity
    Entry::new(0x6083, 0, U32, ReadWrite, 6000).limits(1, u32::MAX as i64).mappable(), // Profile acceleration
    Entry::new(0x6084, 0, U32, ReadWrite, 6000).limits(1, u32::MAX as i64).mappable(), // Profile deceleration
    Entry::new(0x6085, 0, U32, ReadWrite, 20_000).limits(1, u32::MAX as i64).mappable(), // Quick stop deceleration
    Entry::new(0x6098, 0, I8, ReadWrite, 0).mappable(), // Homing method
    Entry::new(0x6099, 0, U8, ReadOnly, 2), // Number of entries
    Entry::new(0x6099, 1, U32, ReadWrite, 300).limits(1, u32::MAX as i64), // Switch search
    Entry::new(0x6099, 2, U32, ReadWrite, 60).limits(1, u32::MAX as i64), // Zero search
    Entry::new(0x609A, 0, U32, ReadWrite, 6000).limits(1, u32::MAX as i64), // Homing acceleration
    Entry::new(0x60F4, 0, I32, ReadOnly, 0).mappable(), // Following error actual
    Entry::new(0x60FD, 0, U32, ReadOnly, 0).mappable(), // Digital inputs
    Entry::new(0x60FF, 0, I32, ReadWrite, 0).mappable(), // Target velocity
    Entry::new(0x6502, 0, U32, Const, 0x25), // Supported drive modes
];

/// An IclA N065 with this node id, as it is after power-on.
#[must_use]
pub fn dictionary(node: u8) -> Dictionary {
    Dictionary::new(node)
        .with(OBJECTS)
        .with_rpdo(1, 0x200, &[0x6040_0010], true)
        .with_rpdo(2, 0x300, &[0x6040_0010, 0x607A_0020], true)
        .with_rpdo(3, 0x8000_0400, &[0x6040_0010, 0x60FF_0020], true)
        .with_rpdo(4, 0x8000_0500, &[0x6040_0010, 0x6060_0008], true)
        .with_tpdo(1, 0x4000_0180, &[0x6041_0010], true)
        .with_tpdo(2, 0x4000_0280, &[0x6041_0010, 0x6064_0020], true)
        .with_tpdo(3, 0xC000_0380, &[0x6041_0010, 0x606C_0020], true)
        .with_tpdo(4, 0xC000_0480, &[0x6041_0010, 0x6061_0008], true)
}
