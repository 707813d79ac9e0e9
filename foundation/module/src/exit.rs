//! Exit codes of a module's process, as in 2011: a class plus a number 0..=16. For a process that a signal ended, 128 +
//! the signal's number.

/// Ended as commanded.
pub const OK: u8 = 0;
/// A resource was refused: a file, memory, a permission, the configuration.
pub const RESOURCE: u8 = 0x10;
/// A device failed.
pub const DEVICE: u8 = 0x20;
/// Any other cause.
pub const OTHER: u8 = 0x40;
