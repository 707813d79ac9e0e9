//! The engine of a wheel's motor controller: its own one on CAN, or a channel of the one of a serial line, which may
//! turn two wheels.

use super::lines::Channel;
use base::Instant;
use base::can::Frame;
use motorctl::can::{Device, OnCan};
use motorctl::{CommandError, Event, Feedback, ReleaseError, State};
use std::iter;

/// See [`motorctl::Engine`], whose methods these are, for one wheel.
pub(super) enum Engine {
    Can { device: Device, engine: Box<OnCan> },
    Line(Channel),
}

/// Passes a call on.
macro_rules! pass {
    ($engine:expr, $own:ident => $call:expr) => {
        match $engine {
            Engine::Can { engine: $own, .. } => $call,
            Engine::Line($own) => $call,
        }
    };
}

impl Engine {
    pub(super) fn restart(&mut self, now: Instant) {
        pass!(self, own => own.restart(now));
    }

    pub(super) fn disarm(&mut self, now: Instant) {
        pass!(self, own => own.disarm(now));
    }

    /// Nothing that waits to be sent is sent.
    pub(super) fn drop_tx(&mut self, now: Instant) {
        match self {
            Self::Can { engine, .. } => iter::from_fn(|| engine.poll_tx(now)).for_each(drop),
            Self::Line(channel) => iter::from_fn(|| channel.poll_tx(now)).for_each(drop),
        }
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) {
        pass!(self, own => own.handle_timeout(now));
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        pass!(self, own => own.poll_timeout())
    }

    pub(super) fn poll_event(&mut self) -> Option<Event> {
        pass!(self, own => own.poll_event())
    }

    pub(super) fn state(&self) -> State {
        pass!(self, own => own.state())
    }

    pub(super) fn feedback(&self) -> Option<Feedback> {
        match self {
            Self::Can { engine, .. } => engine.feedback(0).copied(),
            Self::Line(channel) => channel.feedback(),
        }
    }

    /// Sets the target velocity, rad/s of the wheel.
    pub(super) fn command(&mut self, now: Instant, velocity_radps: f64) -> Result<(), CommandError> {
        match self {
            Self::Can { engine, .. } => engine.command(now, [velocity_radps]),
            Self::Line(channel) => channel.command(now, velocity_radps),
        }
    }

    pub(super) fn quick_stop(&mut self) {
        pass!(self, own => own.quick_stop());
    }

    pub(super) fn is_quick_stop(&self) -> bool {
        pass!(self, own => own.is_quick_stop())
    }

    pub(super) fn release(&mut self, now: Instant) -> Result<(), ReleaseError> {
        pass!(self, own => own.release(now))
    }

    /// The next frame, on CAN.
    pub(super) fn poll_frame(&mut self, now: Instant) -> Option<Frame> {
        if let Self::Can { engine, .. } = self { engine.poll_tx(now) } else { None }
    }
}
