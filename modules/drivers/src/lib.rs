//! Modules that drive the robot's buses: a folder each. They know their devices and their messages, and have never
//! heard of each other, of ports' names or of processes.
#![forbid(unsafe_code)]

pub mod auxiliary;
pub mod canbus;
pub mod joydev;
mod line;
pub mod power;
pub mod rs485_bus;
pub mod rs485a;
pub mod rs485b;
#[cfg(test)]
mod testing;
