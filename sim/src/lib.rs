//! The virtual host, the rules that must always hold, and the soak.
//!
//! In [`host::Virtual`] all processes, buses and the LCM bus share one deterministic process in virtual time; the other
//! ends of the wires are the module [`simulator`]. [`check`] observes all traffic for violations of the rules, and
//! [`mod@soak`] draws episodes of work and faults from a seed. [`paced`] has virtual time pass beside real time, and
//! decides what passes between the robot's bus and a real one. No files, sockets or clocks.
//!
//! The simulated robot alone, for ten virtual seconds; the same seed gives the same run to the last bit:
//!
//! ```
//! use base::Instant;
//! use module::{Shell, ShellConfig, State};
//! use sim::host::{Config, News, Virtual};
//! use simulator::Simulator;
//! use std::{cell::Cell, rc::Rc};
//!
//! let run = |seed| {
//!     let mut machine = Virtual::new(Config { seed, ..Config::default() }, move |name, _wanted| {
//!         let simulator = Simulator::new(simulator::Config { seed, ..simulator::Config::default() });
//!         Ok(Shell::new(ShellConfig::new(name), Box::new(simulator)))
//!     });
//!     let count = Rc::new(Cell::new(0));
//!     let counted = count.clone();
//!     machine.observe(move |_now, news| {
//!         counted.set(counted.get() + u32::from(matches!(news, News::Message { .. })));
//!     });
//!     let pid = machine.spawn("simulator", State::Run).expect("the factory makes every module");
//!     machine.run_until(Instant::from_millis(10_000));
//!     assert_eq!(machine.state(pid), Some(State::Run));
//!     (machine.digest(), count.get())
//! };
//! assert_eq!(run(1), run(1));
//! assert_ne!(run(1).0, run(2).0);
//! assert!(run(1).1 > 200, "SIM_DATA_TRUTH at 20 Hz, and more");
//! ```
#![forbid(unsafe_code)]

pub mod check;
pub mod host;
pub mod paced;
pub mod soak;
