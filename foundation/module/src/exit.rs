//! Exit codes of a module's process, as in 2011: a class plus a number 0..=16. A process that a signal ended counts
//! as 128 + the signal's number.

/// It ended as it was told to.
pub const OK: u8 = 0;
/// A resource was refused: a file, memory, a right, the configuration.
pub const RESOURCE: u8 = 0x10;
/// A device.
pub const DEVICE: u8 = 0x20;
/// Anything else.
pub const OTHER: u8 = 0x40;
