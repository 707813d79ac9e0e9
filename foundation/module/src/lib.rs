//! Definition of a module, independent of the way it is run: events in, actions out, time passed in.
//!
//! A [`Module`] is a pure state machine. Hosts run it inside a [`Shell`], which does what all modules share: it
//! announces the state, follows state commands by the transition table, reports faults once and lists the active ones,
//! publishes texts, and ends in good order.
//! The live host (`host`) and the virtual one (`sim`) use the shell only. This crate does not depend on sockets,
//! processes or any single module.
//!
//! A module, and the shell that makes its fault one report however often it is raised:
//!
//! ```
//! use base::{Fault, Instant, Severity};
//! use module::bench::Bench;
//! use module::{Actions, Channel, Event, Message, Module, Shell, ShellConfig};
//!
//! /// Raises a fault while the battery is below 24 V.
//! struct Battery;
//!
//! impl Module for Battery {
//!     fn subscriptions(&self) -> &[Channel] {
//!         &[Channel::LlDataPower]
//!     }
//!
//!     fn handle(&mut self, _now: Instant, event: Event<'_>, out: &mut Actions) {
//!         match event {
//!             Event::Start => out.working(),
//!             Event::Message { message: Message::LlDataPower(power), .. } if power.voltage < 24.0 => {
//!                 out.raise(Severity::Warning, Fault::BatteryLow, "", format!("{} V", power.voltage));
//!             }
//!             Event::Message { .. } => out.clear(Fault::BatteryLow, "", "charged"),
//!             _ => {}
//!         }
//!     }
//!
//!     fn poll_timeout(&self) -> Option<Instant> {
//!         None
//!     }
//! }
//!
//! let mut bench = Bench::new(Shell::new(ShellConfig::new("battery"), Box::new(Battery)));
//! bench.start();
//! for voltage in [23.5, 23.4, 23.3, 25.0] {
//!     bench.message(messages::lowlevel::DataPower { voltage, ..Default::default() });
//! }
//! let reports = bench.published().into_iter().filter(|message| message.channel() == Channel::CmEventError);
//! assert_eq!(reports.count(), 2); // raised and cleared
//! ```
#![forbid(unsafe_code)]

mod action;
pub mod admission;
pub mod bench;
mod call;
mod event;
pub mod exit;
mod holds;
mod levels;
mod shell;
mod state;
#[cfg(test)]
mod tests;
pub mod texts;

pub use action::{Action, Actions, Condition, OUTSTANDING, Output, ProcessCommand};
pub use call::{Call, CallLog};
pub use event::{Event, ExitStatus, Input, Line, PortId, PortSpec, ProcessEvent};
pub use holds::{ActiveHold, Holds};
pub use levels::Levels;
pub use messages::{Channel, Message};
pub use shell::{Shell, ShellConfig};
pub use state::{Cause, State};

use base::{Fault, Instant};

/// A module: drivers of sensors and drives, the watchdog, the simulator.
///
/// After any call its host drains the actions and arms one timer for [`Module::poll_timeout`].
pub trait Module {
    /// Channels that it subscribes to, in addition to `CM_CMD_STATE` and `CM_CMD_LEVEL`, which the shell handles.
    fn subscriptions(&self) -> &[Channel] {
        &[]
    }

    /// True if it wants all messages on the bus as bytes: [`Event::RawMessage`]. Used by the logger.
    fn wants_raw_bus(&self) -> bool {
        false
    }

    /// Ports that it needs, in the order of their [`PortId`]s. The host opens them before `Event::Start` and again
    /// whenever they are lost.
    fn ports(&self) -> &[PortSpec] {
        &[]
    }

    /// Processes one event; pushes the resulting actions. `now` is the host's monotonic time and never decreases.
    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions);

    /// Deadline of the next `Event::Timer`; a past instant means at once. After a drain nothing is due at `now`.
    fn poll_timeout(&self) -> Option<Instant>;

    /// The host found a fault that may concern the module, [`Fault::SecondRobot`] for instance: it is active from now
    /// on, or cleared. Called each time the host raises it. The shell reports it.
    fn handle_host_fault(&mut self, _now: Instant, _fault: Fault, _active: bool, _out: &mut Actions) {}

    /// Called after TERMINATE: true once everything is done that must precede the end of the process (the robot stands,
    /// the modules are ended). Until then, at most for [`ShellConfig::end_within`], it continues to receive events.
    fn finished(&self) -> bool {
        true
    }
}
