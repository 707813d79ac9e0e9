//! Test bench for one module in virtual time: feed events, jump from deadline to deadline, read the module's actions.

use crate::admission::Origin;
use crate::{Action, Actions, Event, Input, Output, PortId, Shell};
use base::serial::Word;
use base::{Duration, Epoch, Instant, Report, can, i2c, store, w1};
use messages::Message;

/// A shell, a clock that only the test advances, and the shell's actions.
pub struct Bench {
    /// The module under test in its shell.
    pub shell: Shell,
    now: Instant,
    out: Actions,
    done: Vec<(Instant, Action)>,
}

impl Bench {
    /// Creates a bench at time zero; the shell has not started.
    #[must_use]
    pub fn new(shell: Shell) -> Self {
        Self { shell, now: Instant::ZERO, out: Actions::new(Epoch::default()), done: Vec::new() }
    }

    /// Current time.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.now
    }

    /// Feeds any event now.
    pub fn event(&mut self, event: Event<'_>) {
        self.shell.handle(self.now, event, &mut self.out);
        self.collect();
    }

    /// Starts the module and opens its ports.
    pub fn start(&mut self) {
        self.event(Event::Start);
        for port in 0..self.shell.module().ports().len() {
            self.event(Event::Port { port: PortId(port as u8), input: Input::Up });
        }
    }

    /// Feeds a message received now.
    pub fn message(&mut self, message: impl Into<Message>) {
        self.message_from(Origin::DUE, message);
    }

    /// Feeds a message of that sender, received now.
    pub fn message_from(&mut self, from: Origin, message: impl Into<Message>) {
        let message = message.into();
        self.event(Event::Message { at: self.now, from, message: &message });
    }

    /// Raises a fault that the host found.
    pub fn raise(&mut self, report: Report) {
        self.shell.raise(self.now, report, &mut self.out);
        self.collect();
    }

    /// Clears a fault that the host found.
    pub fn clear(&mut self, report: Report) {
        self.shell.clear(self.now, report, &mut self.out);
        self.collect();
    }

    /// Feeds a CAN frame that arrives now.
    pub fn can(&mut self, port: PortId, frame: can::Frame) {
        self.event(Event::Port { port, input: Input::Can { frame, at: self.now } });
    }

    /// Feeds words.
    pub fn words(&mut self, port: PortId, words: &[Word]) {
        self.event(Event::Port { port, input: Input::Words(words) });
    }

    /// Feeds the outcome of a transfer.
    pub fn i2c(&mut self, port: PortId, outcome: &i2c::Outcome) {
        self.event(Event::Port { port, input: Input::I2c(outcome) });
    }

    /// Feeds an answer of a 1-Wire bus.
    pub fn w1(&mut self, port: PortId, answer: &w1::Answer) {
        self.event(Event::Port { port, input: Input::OneWire(answer) });
    }

    /// Feeds an answer of a folder of log files.
    pub fn store(&mut self, port: PortId, answer: &store::Answer) {
        self.event(Event::Port { port, input: Input::Store(answer) });
    }

    /// Feeds a message received now, as raw bytes, to a module that wants the raw bus.
    ///
    /// # Panics
    /// LCM cannot encode the message.
    pub fn raw_message(&mut self, message: impl Into<Message>) {
        let message = message.into();
        let mut data = Vec::new();
        message.encode(&mut data).expect("a message that LCM can express");
        self.event(Event::RawMessage { at: self.now, channel: &message.channel_name(), data: &data });
        self.message(message);
    }

    /// Lets `duration` pass; serves every deadline at its own time.
    ///
    /// # Panics
    /// The module leaves a deadline due after it was served: a live host would spin.
    pub fn pass(&mut self, duration: Duration) {
        let end = self.now + duration;
        while self.step(end) {}
        self.now = end;
    }

    /// Advances to the next deadline up to `end` and serves it; false if there is none.
    ///
    /// # Panics
    /// The module leaves a deadline due after it was served.
    pub fn step(&mut self, end: Instant) -> bool {
        let Some(due) = self.shell.poll_timeout().filter(|due| *due <= end) else {
            return false;
        };
        self.now = self.now.max(due);
        self.event(Event::Timer);
        let next = self.shell.poll_timeout();
        assert!(next.is_none_or(|next| next > self.now), "due again at {:?} after serving it", self.now);
        true
    }

    /// Takes all actions since the last call with their times.
    pub fn done(&mut self) -> Vec<(Instant, Action)> {
        std::mem::take(&mut self.done)
    }

    /// Takes all actions and returns the published messages.
    pub fn published(&mut self) -> Vec<Message> {
        let message = |(_, action)| {
            if let Action::Publish(message) = action { Some(message) } else { None }
        };
        self.done().into_iter().filter_map(message).collect()
    }

    /// Takes all actions and returns the output on ports.
    pub fn sent(&mut self) -> Vec<(PortId, Output)> {
        let sent = |(_, action)| {
            if let Action::Send(port, output) = action { Some((port, output)) } else { None }
        };
        self.done().into_iter().filter_map(sent).collect()
    }

    fn collect(&mut self) {
        self.done.extend(self.out.drain().map(|action| (self.now, action)));
    }
}
