//! What a motor controller reports: progress of its start-up, refusals, losses, measurements.

use base::{Duration, Instant, listed};
use core::fmt::{self, Write};
use heapless::Vec;

listed! {
    /// A step of the start-up, in their order.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum Step {
        /// The device sends messages or answers.
        Contact => "contact",
        /// Model and firmware are those expected.
        Identity => "identity",
        /// The axes stand.
        Standstill => "standstill",
        /// The command time limit is set, or read back.
        TimeLimit => "command time limit",
        /// The device is armed without torque, and left without commands.
        Silence => "silence",
        /// Errors are cleared, the axes hold zero velocity.
        Enable => "enable",
    }
}

/// Progress of an engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Not started: new, or disarmed until [`Engine::restart`](crate::Engine::restart).
    Off,
    /// The start-up is under way.
    Starting,
    /// The last start-up failed, or the device was lost; the next start-up waits.
    Resting,
    /// Velocity commands are accepted.
    Ready,
}

/// Model and firmware as text: of at most 48 bytes, as the device sent them.
pub type Text = Vec<u8, 48>;

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

/// Why a start-up failed. Start-ups go on at a calm rate.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// No answer, or no cyclic message.
    Silent,
    /// Another model, firmware or id than configured, in the words of the device.
    Identity {
        /// As the device sent it.
        found: Text,
    },
    /// The command time limit is not the one that was set, is above the limit, or is too short for the period. Zero: it
    /// is off.
    TimeLimit {
        /// As it was read back.
        found: Duration,
    },
    /// The command time limit was left to expire, and the device went on.
    NoReaction {
        /// Time without commands.
        after: Duration,
    },
    /// The device cannot show its command time limit, and no second way to stop is configured.
    NotProvable,
    /// An axis does not come to a standstill.
    Moving,
    /// The device reports errors; bits or code of its own protocol.
    Fault {
        /// Bits or code.
        errors: u32,
    },
    /// The device does not enter its operating state.
    NotEnabled,
}

/// Predicate of a sentence whose subject is the device.
impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent => f.write_str("does not answer"),
            Self::Identity { found } => {
                write!(f, "is another one than configured: {}", core::str::from_utf8(found).unwrap_or("unreadable"))
            }
            Self::TimeLimit { found } if found.is_zero() => f.write_str("has no command time limit"),
            Self::TimeLimit { found } => write!(f, "has a command time limit of {found:?}"),
            Self::NoReaction { after } => write!(f, "did not stop by itself {after:?} after the last command"),
            Self::NotProvable => f.write_str("cannot show its command time limit, and there is no second way to stop"),
            Self::Moving => f.write_str("does not come to a standstill"),
            Self::Fault { errors } => write!(f, "is in fault, errors 0x{errors:X}"),
            Self::NotEnabled => f.write_str("does not enter its operating state"),
        }
    }
}

/// Why a device that was ready is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LostReason {
    /// No feedback, or no other message that must come, within its time.
    Silent,
    /// The device reports errors; bits or code of its own protocol.
    Fault {
        /// Bits or code.
        errors: u32,
    },
    /// The device left its operating state without an error.
    Disabled,
    /// The command time limit of the device acted, although commands were sent.
    TimeLimitActed,
    /// The command time limit of the device is no longer the one that was proven: it was reset, or reconfigured.
    TimeLimitChanged,
}

/// Predicate of a sentence whose subject is the device.
impl fmt::Display for LostReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent => f.write_str("is silent"),
            Self::Fault { errors } => write!(f, "is in fault, errors 0x{errors:X}"),
            Self::Disabled => f.write_str("left its operating state by itself"),
            Self::TimeLimitActed => f.write_str("stopped by itself: it received no commands in time"),
            Self::TimeLimitChanged => f.write_str("has another command time limit than was proven"),
        }
    }
}

/// What a device does when its command time limit expires.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reaction {
    /// It removes the torque: the axis rolls.
    Disarms,
    /// It brakes with this current, A; with 0 the axis rolls.
    Brakes {
        /// As configured in the device.
        current_a: f64,
    },
    /// It stops the motor, in a way that its documents leave open.
    Stops,
}

/// Predicate of a sentence whose subject is the device.
impl fmt::Display for Reaction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Disarms => f.write_str("rolls"),
            Self::Brakes { current_a } => write!(f, "brakes with {current_a} A"),
            Self::Stops => f.write_str("stops"),
        }
    }
}

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// The start-up has ended; velocity commands are accepted.
    Ready {
        /// Time from the last command to the reaction of the device, seen in its messages; none for a device that
        /// cannot show it.
        acted_after: Option<Duration>,
        /// What the device does without commands.
        reaction: Reaction,
    },
    /// A start-up failed; reported once for each cause.
    Refused {
        /// The step.
        step: Step,
        /// Why.
        reason: Refusal,
    },
    /// A device that was ready is lost; it is started again after a pause.
    Lost {
        /// Why.
        reason: LostReason,
    },
}

/// Measurements of an axis, at the output of the gear. NaN: not measured, or not yet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feedback {
    /// When velocity and position arrived.
    pub at: Instant,
    /// rad/s.
    pub velocity_radps: f64,
    /// rad, from wherever the device counts.
    pub position_rad: f64,
    /// Current of the motor, A.
    pub current_a: f64,
    /// Supply of the device, V.
    pub supply_v: f64,
    /// Power stage of the device, °C.
    pub temperature_c: f64,
}

impl Feedback {
    pub(crate) const UNKNOWN: Self = Self {
        at: Instant::ZERO,
        velocity_radps: f64::NAN,
        position_rad: f64::NAN,
        current_a: f64::NAN,
        supply_v: f64::NAN,
        temperature_c: f64::NAN,
    };
}

/// Why a velocity command was not taken. The setpoints are unchanged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CommandError {
    /// The engine is not in [`State::Ready`].
    NotReady,
    /// A quick stop is active: [`Engine::release`](crate::Engine::release).
    QuickStop,
    /// Not a number, or above the limit of this axis.
    OutOfRange {
        /// Index of the axis.
        axis: usize,
    },
}

/// Why a quick stop was not released.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReleaseError {
    /// An axis turns, or its velocity is not known.
    Moving,
}
