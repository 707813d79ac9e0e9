//! What a module is, not how it runs: events in, actions out, time handed in.
//!
//! A [`Module`] is a pure state machine. Hosts run it inside a [`Shell`], which does what all modules share: it
//! announces the state, obeys state commands by the transition table, reports faults once and lists the active ones,
//! sends texts, ends in good order.
//! The live host (`robot`) and the virtual one (`sim`) see nothing but the shell. This crate has never heard of
//! sockets, processes or any single module.
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
pub mod bench;
mod call;
mod event;
pub mod exit;
mod holds;
pub mod sabotage;
mod shell;
mod state;
#[cfg(test)]
mod tests;
pub mod texts;

pub use action::{Action, Actions, Condition, OUTSTANDING, Output, ProcessCommand};
pub use call::{Call, CallLog};
pub use event::{Event, ExitStatus, Input, Line, PortId, PortSpec, ProcessEvent};
pub use holds::{Holds, Standing};
pub use messages::{Channel, Message};
pub use shell::{Shell, ShellConfig};
pub use state::{Cause, State};

use base::Instant;

/// A module: sensors' and drives' drivers, the watchdog, the simulator.
///
/// After any call its host drains the actions and arms one timer for [`Module::poll_timeout`].
pub trait Module {
    /// Channels whose messages it wants, besides `CM_CMD_STATE`, which the shell obeys for it.
    fn subscriptions(&self) -> &[Channel] {
        &[]
    }

    /// Whether it wants everything that is said on the bus, as bytes: [`Event::Heard`]. The logger does.
    fn overhears(&self) -> bool {
        false
    }

    /// The ports it needs, in the order of their [`PortId`]s. The host opens them before `Event::Start` and again
    /// whenever they are lost.
    fn ports(&self) -> &[PortSpec] {
        &[]
    }

    /// Takes one event; pushes what follows from it. `now` is the host's monotonic time and never goes back.
    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions);

    /// When it wants the next `Event::Timer`; a past moment means at once. After a drain nothing is due at `now`.
    fn poll_timeout(&self) -> Option<Instant>;

    /// Asked after TERMINATE: whether all is done that must be done before the process ends (the robot stands, the
    /// modules are ended). Until then, at most [`ShellConfig::end_within`], it goes on getting events.
    fn finished(&self) -> bool {
        true
    }
}
