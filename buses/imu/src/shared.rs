//! What the protocols work with: events, counters, faults.

use crate::event::{Counters, Event, Fault, Identity, LostReason, Sample, Status};
use crate::judge::{Judge, Limits};
use base::i2c::Transfer;
use base::{Disturbance, Instant, Queue};

/// Events that wait to be drained.
const EVENTS: usize = 64;

/// What a protocol made of an input or a deadline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Progress {
    /// Nothing that changes the life.
    Pending,
    /// The start-up failed, or the device is lost.
    Lost(LostReason),
}

/// What a protocol works with, beside its own state.
#[derive(Debug)]
pub(crate) struct Shared {
    pub events: Queue<Event, EVENTS>,
    pub transfer: Option<Transfer>,
    pub faults: [bool; Fault::ALL.len()],
    /// Number of the last error that the device measures with.
    pub error: u8,
    pub counters: Counters,
    /// It measures: what is rejected disturbs its line.
    pub runs: bool,
    pub line: Disturbance,
    pub limits: Limits,
    pub judge: Judge,
    /// Instant of the input that is handled, of the last input, and of the last valid message.
    pub now: Instant,
    pub arrived: Option<Instant>,
    pub valid: Option<Instant>,
    /// Samples were added since the last check.
    pub measured: bool,
}

impl Shared {
    pub fn new(limits: Limits) -> Self {
        Self {
            events: Queue::new(),
            transfer: None,
            faults: [false; Fault::ALL.len()],
            error: 0,
            counters: Counters::default(),
            runs: false,
            line: Disturbance::default(),
            limits,
            judge: Judge::default(),
            now: Instant::ZERO,
            arrived: None,
            valid: None,
            measured: false,
        }
    }

    /// Requests a transfer; the protocol has at most one under way.
    pub fn ask(&mut self, transfer: Transfer) {
        self.transfer = Some(transfer);
    }

    /// Counts a valid message.
    pub fn accept(&mut self) {
        (self.arrived, self.valid) = (Some(self.now), Some(self.now));
        self.counters.messages = self.counters.messages.saturating_add(1);
    }

    /// Counts input that the protocol does not allow.
    pub fn reject(&mut self) {
        self.arrived = Some(self.now);
        self.counters.rejected = self.counters.rejected.saturating_add(1);
        // In a start-up what is left of the time before it is rejected, too; it may only keep a disturbed line so.
        if (self.runs || self.is_active(Fault::Noise)) && self.line.damaged(self.now) {
            self.fault(Fault::Noise, true);
        }
    }

    /// Counts a transfer to which nobody answered: nothing arrived.
    pub fn miss(&mut self) {
        self.counters.rejected = self.counters.rejected.saturating_add(1);
    }

    pub fn identify(&mut self, identity: Identity) {
        self.push(Event::Identity(identity));
    }

    /// Sets or clears a fault; reported on change.
    pub fn fault(&mut self, fault: Fault, active: bool) {
        let known = &mut self.faults[fault as usize];
        if *known != active {
            *known = active;
            self.push(Event::Fault { fault, active });
        }
    }

    pub fn is_active(&self, fault: Fault) -> bool {
        self.faults[fault as usize]
    }

    fn status(&self) -> Status {
        let is = |fault| self.is_active(fault);
        match () {
            () if is(Fault::Noise) || is(Fault::Device) => Status::Fault,
            () if is(Fault::Implausible) || is(Fault::Frozen) => Status::Implausible,
            () if is(Fault::Uncalibrated) => Status::Uncalibrated,
            () => Status::Ok,
        }
    }

    /// Adds a sample; its status is that of the device.
    pub fn sample(&mut self, sample: Sample) {
        let verdict = self.judge.take(sample.at, sample.acceleration_mps2, sample.rotation_radps, self.limits);
        if verdict.beyond {
            self.fault(Fault::Implausible, true);
        }
        self.fault(Fault::Frozen, verdict.frozen);
        self.measured = true;
        self.push(Event::Sample(Sample { status: self.status(), ..sample }));
    }

    pub fn push(&mut self, event: Event) {
        // Room is left for what is not a sample.
        let fits = self.events.len() < EVENTS / 2 || !matches!(event, Event::Sample(_));
        if !(fits && self.events.push(event)) {
            self.counters.dropped = self.counters.dropped.saturating_add(1);
        }
    }
}
