//! `advee lidar …`: commissioning of lidars, by a port of one's own or by what the bus says.
//!
//! A port that a module holds belongs to it: what the module publishes is shown then, with the module's name.

mod align;
mod held;
mod info;
mod line;
mod monitor;
mod scan;
#[cfg(test)]
mod served;
mod target;

use super::commands::commands;

commands! {
    |common, command|
    pub enum Lidar {
        /// Show what the lidars measure, each second, until Ctrl-C
        Monitor(monitor::Monitor) => monitor::monitor(common, command),
        /// Ask lidars for model, firmware, serial number, health and speed
        Info(info::Info) => info::info(common, command),
        /// Find lidars on serial ports and TCP addresses, and write their lines of robot.toml
        Scan(scan::Scan) => scan::scan(common, command),
        /// Measure where a lidar sits on the robot, by straight walls and a drive
        Align(align::Align) => align::align(common, command),
    }
}
