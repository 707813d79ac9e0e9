//! Modules that drive the robot's buses, one folder each. They depend on their devices and messages only, not on each
//! other, on names of ports, or on processes.
#![forbid(unsafe_code)]

pub mod auxiliary;
pub mod canbus;
pub mod joydev;
mod line;
pub mod power;
pub mod rs485a;
pub mod rs485b;
#[cfg(test)]
mod testing;
