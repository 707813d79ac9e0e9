//! Logs of a run: MCAP files that contain each bus message unchanged and in its ROS 2 form (`docs/logs.md`).
//!
//! [`Logger`] is the module that writes them. Works on any reader and writer; opens no file and reads no clock.
//!
//! A message is logged and found again. On a robot a folder is behind the port; here it is a loop:
//!
//! ```
//! use base::Duration;
//! use base::store::{Answer, Request};
//! use logger::{Config, Logger, NAME, read, ros};
//! use messages::lowlevel::DataOdo;
//! use module::bench::Bench;
//! use module::{Output, Shell, ShellConfig};
//!
//! let logger = Logger::new(Config::default(), ros::Translator::new(ros::RobotScene::default()));
//! let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(logger)));
//! bench.start();
//! bench.raw_message(DataOdo::default());
//! let mut file = Vec::new();
//! for _ in 0..100 {
//!     bench.pass(Duration::from_millis(20));
//!     for (port, output) in bench.sent() {
//!         let Output::Store(request) = output else { continue };
//!         let free = 1 << 40; // bytes
//!         if let Request::Append { bytes, .. } = &request {
//!             file.extend_from_slice(bytes);
//!         }
//!         let is_list = request == Request::List;
//!         let answer = if is_list { Answer::Listed { entries: Vec::new(), free } } else { Answer::Done { free } };
//!         bench.store(port, &answer);
//!     }
//! }
//! let index = read::Index::read(std::io::Cursor::new(file), &mut |_, _| {})?;
//! assert!(index.channels.values().any(|channel| channel.topic == "LL_DATA_ODO"));
//! # Ok::<(), std::io::Error>(())
//! ```
#![forbid(unsafe_code)]

mod config;
mod disk;
mod file;
mod logger;
mod names;
pub mod read;
pub mod recover;
mod ring;
pub mod ros;
mod run_name;
#[cfg(test)]
mod tests;

pub use config::{Attachment, Compression, Config};
pub use file::{TYPES, types};
pub use logger::{Logger, NAME};
pub use run_name::run_name;
