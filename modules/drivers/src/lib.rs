//! Modules that drive the robot's buses, one folder each. They depend on their devices and messages only, not on each
//! other, on names of ports, or on processes.
//!
//! The driver of thermometers on a 1-Wire bus; on a robot the port answers what the driver sends to it:
//!
//! ```
//! use base::{Duration, w1};
//! use drivers::auxiliary::{Auxiliary, Config, NAME, Thermometer, W1Config};
//! use module::bench::Bench;
//! use module::{Message, PortId, Shell, ShellConfig};
//!
//! let rom = w1::Rom::parse("28-0316a2795bff").expect("a DS18B20");
//! let thermometers = vec![Thermometer { rom, name: "battery".into(), limit_c: Some(50.0) }];
//! let w1 = Some(W1Config { bus: "w1".into(), thermometers });
//! let driver = Auxiliary::new(Config { bus: None, w1, host: None })?;
//! let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(driver)));
//! bench.start();
//! bench.w1(PortId(0), &w1::Answer::List([rom].into_iter().collect()));
//! bench.w1(PortId(0), &w1::Answer::Temperature(rom, Ok(51_500)));
//! bench.pass(Duration::from_secs(1));
//!
//! let measured = bench.published().into_iter().filter_map(|message| match message {
//!     Message::LlDataTemperature(message) => message.temperatures.into_iter().next(),
//!     _ => None,
//! });
//! let battery = measured.last().expect("LL_DATA_TEMPERATURE each second");
//! assert_eq!((&*battery.name, battery.value, battery.over), ("battery", 51.5, true));
//! # Ok::<(), drivers::auxiliary::ConfigError>(())
//! ```
#![forbid(unsafe_code)]

pub mod auxiliary;
pub mod canbus;
mod gpio_line;
pub mod imu;
pub mod io;
pub mod joydev;
pub mod lidar;
mod line;
pub mod power;
pub mod rs485_bus;
pub mod rs485a;
pub mod rs485b;
#[cfg(test)]
mod testing;
