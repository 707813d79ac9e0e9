//! What a lidar reports: identity, health, sectors, faults, loss and recovery.

use crate::scan::Sector;
use base::{Duration, listed};
use core::fmt::{self, Write};
use heapless::Vec;

/// Model, firmware and serial number as text: at most 96 bytes, as the device sent them.
pub type Text = Vec<u8, 96>;

/// A text for operators; what has no room is left out.
pub(crate) fn text(arguments: fmt::Arguments<'_>) -> Text {
    struct Cut(Text);
    impl Write for Cut {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            text.bytes().for_each(|byte| _ = self.0.push(byte));
            Ok(())
        }
    }
    let mut cut = Cut(Text::new());
    // It cannot fail.
    let _ = cut.write_fmt(arguments);
    cut.0
}

/// State of an engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// The start-up is under way.
    Starting,
    /// The last start-up failed, or the device was lost; the next start-up waits.
    Resting,
    /// Sectors arrive.
    Running,
}

/// Health as the device reports it, with the code of its own protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Health {
    /// It works.
    Good,
    /// It works, and may fail soon.
    Warning {
        /// Code of the device.
        code: u32,
    },
    /// It does not work.
    Error {
        /// Code of the device.
        code: u32,
    },
}

listed! {
    /// A fault of a device that still sends. Each is reported when it begins, and when it has ended.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum Fault {
        /// The optics are dirty; the device still measures.
        Dirty => "dirty optics",
        /// The optics are too dirty to measure: sectors are [`Status::Blocked`](crate::Status::Blocked).
        Blocked => "blocked optics",
        /// The motor turns too slowly or too fast: sectors are [`Status::Slow`](crate::Status::Slow).
        Slow => "motor speed out of range",
        /// Part of the field of view does not arrive.
        Incomplete => "incomplete revolutions",
        /// The line is disturbed: sectors are [`Status::Fault`](crate::Status::Fault).
        Noise => "disturbed line",
        /// The device reports an error: sectors are [`Status::Fault`](crate::Status::Fault).
        Device => "error of the device",
    }
}

/// Why a device is lost, or could not be started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LostReason {
    /// Nothing arrives.
    Silent,
    /// Bytes arrive, and none of them is valid.
    Garbled,
    /// Valid messages arrive without new measurements: the motor stands, or the device repeats itself.
    Stalled,
    /// The device refused a request.
    Refused {
        /// Code of the device, in its own protocol.
        code: u32,
    },
    /// Another model than configured; [`Event::Identity`] has its name.
    Identity,
    /// The device reports an error that does not let it measure.
    Device {
        /// Code of the device.
        code: u32,
    },
    /// The connection was closed.
    Closed,
}

/// What a device evaluates by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Zone {
    /// A field, by its number from 1.
    Field(u8),
    /// A switching output, by its number from 1.
    Output(u8),
}

impl fmt::Display for Zone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Field(number) => write!(f, "field {number}"),
            Self::Output(number) => write!(f, "output {number}"),
        }
    }
}

/// Result of one field evaluation of the device, or the state of an output that goes by it. Not a safety function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldResult {
    /// Not evaluated, not valid, or too old; an output that is not used.
    Unknown,
    /// Nothing in the field; the output is active.
    Free,
    /// An object is in the field; the output is not active.
    Infringed,
}

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'a> {
    /// Model and firmware, in the words of the device; at each start-up. Devices that cannot be asked have none.
    Identity(&'a Text),
    /// The device's own judgement, at each start-up and on change.
    Health(Health),
    /// Measurements.
    Sector(&'a Sector),
    /// A result of the device's own evaluation, on change. What is in force now is
    /// [`Lidar::result`](crate::Lidar::result).
    Zone {
        /// The field or output.
        zone: Zone,
        /// Its result.
        result: FieldResult,
    },
    /// A fault began or has ended.
    Fault {
        /// The fault.
        fault: Fault,
        /// True: it began.
        active: bool,
    },
    /// The device is lost, or could not be started; reported once for each cause. Start-ups go on.
    Lost {
        /// Why.
        reason: LostReason,
    },
    /// The first sector since the engine was made, or since the device was lost.
    Recovered {
        /// Time since the loss was reported; zero at the first start.
        after: Duration,
    },
}

/// Counters since the engine was made. They saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Valid messages.
    pub messages: u32,
    /// Messages that were damaged, repeated or not allowed, and pieces between them.
    pub rejected: u32,
    /// Sectors that had no room because the events were not drained.
    pub dropped: u32,
    /// Losses.
    pub losses: u32,
}
