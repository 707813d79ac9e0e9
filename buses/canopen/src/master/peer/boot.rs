//! The boot-up of a node: reset, work, heartbeat, start; and what ends it.

use super::guard::Guard;
use super::{Peer, Phase, RESTLESS, SETTLED, STARTS, STOP_EVERY, Shared, UNSETTLED};
use crate::master::{BootError, ConfigWrite, Event, LostReason, Step};
use crate::sdo;
use crate::wire::{self, NmtCommand, NmtState, Service};
use base::can::Frame;
use base::{Duration, Instant};

impl Peer {
    pub(super) fn step(&self) -> Step {
        match self.phase {
            Phase::Resting { .. } | Phase::Resetting { .. } | Phase::Left(_) => Step::BootUp,
            Phase::Working { at, .. } => self.plan[at].0,
            Phase::Listening { .. } => Step::ErrorControl,
            Phase::Held { .. } | Phase::Starting { .. } | Phase::Running { .. } => Step::Start,
        }
    }

    /// The next phase; what all nodes together are follows from it.
    pub(super) fn enter(&mut self, phase: Phase, shared: &mut Shared) {
        let before = core::mem::replace(&mut self.phase, phase);
        if !self.config.mandatory {
            return;
        }
        match (before.is_configured(), phase.is_configured()) {
            (false, true) => shared.unconfigured -= 1,
            (true, false) => shared.unconfigured += 1,
            _ => {}
        }
        match (before.is_running(), phase.is_running()) {
            (false, true) => {
                shared.missing -= 1;
                if shared.missing == 0 {
                    shared.events.push(Event::Ready);
                }
            }
            (true, false) => {
                if shared.missing == 0 {
                    shared.events.push(Event::NotReady);
                }
                shared.missing += 1;
            }
            _ => {}
        }
    }

    /// A new attempt. It begins with a reset even when the node has just booted: only so a second node with the
    /// same id shows, by its own boot-up message.
    fn begin(&mut self, now: Instant, shared: &mut Shared) {
        self.channel.abandon(shared);
        self.duplicate.clear(self.stats.ignored);
        self.guard = None;
        self.nmt_state = None;
        if self.config.reset {
            self.reset(now, now + self.config.boot_timeout, shared);
        } else {
            self.work(now, shared, 0);
        }
    }

    /// Sends the command to reset the communication, and awaits the boot-up message.
    pub(super) fn reset(&mut self, now: Instant, until: Instant, shared: &mut Shared) {
        shared.outbox.push(wire::nmt(NmtCommand::ResetCommunication, self.id()));
        let stop = if self.config.stop.is_some() { now + STOP_EVERY } else { until };
        self.enter(Phase::Resetting { sent: now, until, stop }, shared);
    }

    /// Tells a node to stop whose boot-up message may be lost: it turns on as before the reset, and obeys no PDO. The
    /// node may not be able to answer yet, so no answer is awaited.
    pub(super) fn stop_unasked(&mut self, now: Instant, shared: &mut Shared) {
        let Some(ConfigWrite { index, sub, value, .. }) = self.config.stop.clone() else { return };
        let mut client = sdo::Client::new(shared.config.sdo_timeout);
        client.write(now, index, sub, value);
        if let Some(data) = client.poll_tx() {
            let service = Service::SdoRequest { node: self.id() };
            shared.outbox.push(Frame::standard(service.cob_id(), &data));
        }
    }

    pub(super) fn first(&mut self, now: Instant, shared: &mut Shared) {
        self.boot_ups = 0;
        self.begin(now, shared);
    }

    pub(super) fn booted_unasked(&mut self, now: Instant, shared: &mut Shared) {
        self.boot_ups += 1;
        if self.boot_ups >= RESTLESS {
            return self.fail(now, shared, BootError::Restless);
        }
        self.begin(now, shared);
    }

    /// Waits for the first heartbeat, after all SDO work.
    pub(super) fn listen(&mut self, now: Instant, shared: &mut Shared) {
        if let Some(guarding) = self.config.guarding {
            self.guard = Some(Guard::new(now, guarding, self.config.reset));
            self.enter(Phase::Listening { until: now + self.limit() }, shared);
            return self.watch(now, shared);
        }
        // A write of 0x1017 starts the heartbeat at once, so it may have come during the read-back.
        if self.nmt_state == Some(NmtState::PreOperational) {
            return self.configured(now, shared);
        }
        self.enter(Phase::Listening { until: now + self.limit() }, shared);
    }

    /// Set up, and its heartbeat is received.
    pub(super) fn configured(&mut self, now: Instant, shared: &mut Shared) {
        if !shared.config.together {
            return self.start(now, shared, STARTS);
        }
        self.enter(Phase::Held { until: now + self.limit() }, shared);
        shared.release |= shared.unconfigured == 0;
    }

    /// Starts the node, after all mandatory nodes are set up.
    pub(in crate::master) fn release(&mut self, now: Instant, shared: &mut Shared) {
        if let Phase::Held { .. } = self.phase {
            self.start(now, shared, STARTS);
        }
    }

    pub(super) fn start(&mut self, now: Instant, shared: &mut Shared, starts_left: u8) {
        shared.outbox.push(wire::nmt(NmtCommand::Start, self.id()));
        let until = now + self.limit();
        self.enter(Phase::Starting { until, starts_left: starts_left - 1 }, shared);
    }

    pub(super) fn booted(&mut self, now: Instant, shared: &mut Shared) {
        self.reported = None;
        self.swapped = false;
        self.stats.boots = self.stats.boots.saturating_add(1);
        self.booted_at = now;
        shared.events.push(Event::Booted { node: self.id() });
        self.enter(Phase::Running { until: now + self.limit() }, shared);
        self.pump(now, shared);
    }

    /// Two nodes have this id.
    pub(super) fn two(&mut self, now: Instant, shared: &mut Shared) {
        if self.is_operational() {
            shared.events.push(Event::DuplicateId { node: self.id() });
            self.lose(now, shared, LostReason::DuplicateId);
        } else {
            self.fail(now, shared, BootError::DuplicateId);
        }
    }

    pub(super) fn fail(&mut self, now: Instant, shared: &mut Shared, reason: BootError) {
        let (node, step) = (self.id(), self.step());
        if self.reported.replace((step, reason)) != Some((step, reason)) {
            if let BootError::Restless | BootError::DuplicateId = reason {
                shared.events.push(Event::DuplicateId { node });
            }
            shared.events.push(Event::BootFailed { node, step, reason });
        }
        self.channel.abandon(shared);
        self.rest(now, shared);
    }

    pub(super) fn rest(&mut self, now: Instant, shared: &mut Shared) {
        self.guard = None;
        self.enter(Phase::Resting { until: now + shared.config.retry }, shared);
    }

    pub(super) fn lose(&mut self, now: Instant, shared: &mut Shared, reason: LostReason) {
        self.stats.losses = self.stats.losses.saturating_add(1);
        shared.outbox.drop_pdos(self.id());
        shared.events.push(Event::Lost { node: self.id(), reason });
        self.channel.forget(shared);
        if matches!(reason, LostReason::Heartbeat | LostReason::Guarding) {
            self.nmt_state = None;
        }
        let soon = now.since(self.booted_at) < SETTLED;
        self.unsettled = if soon { self.unsettled.saturating_add(1) } else { 0 };
        let pause = match &self.config.farewell {
            // A node that has just booted, or is not Operational, receives no PDO.
            Some(farewell) if !matches!(reason, LostReason::BootUp | LostReason::State(_)) => {
                let service = Service::Rpdo { node: self.id(), number: farewell.number };
                shared.outbox.push(Frame::standard(service.cob_id(), &farewell.data));
                farewell.pause
            }
            _ => Duration::ZERO,
        };
        let Some(again) = self.unsettled.checked_sub(UNSETTLED) else {
            if pause.is_zero() {
                return self.first(now, shared);
            }
            self.guard = None;
            return self.enter(Phase::Resting { until: now + pause }, shared);
        };
        if again == 0 && reason == LostReason::BootUp {
            // Two nodes that boot one after the other look the same as one that keeps resetting itself.
            shared.events.push(Event::DuplicateId { node: self.id() });
        }
        self.guard = None;
        self.enter(Phase::Resting { until: now + shared.config.retry * (1 << again.min(3)) }, shared);
    }
}
