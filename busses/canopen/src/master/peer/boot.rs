//! The boot-up of a node: reset, plan, heartbeat, start. Its SDO channel is shared with requests on demand.

use super::{Peer, Phase, RESTLESS, STARTS, Shared};
use crate::master::channel::Transfer;
use crate::master::plan::Work;
use crate::master::{BootError, ConfigWrite, Event, Expect, LostReason, Step};
use crate::sdo;
use crate::wire::{self, NmtCommand, NmtState};
use base::Instant;

impl Peer {
    pub(super) fn step(&self) -> Step {
        match self.phase {
            Phase::Resting { .. } | Phase::Resetting { .. } => Step::BootUp,
            Phase::Working { at, .. } => self.plan[at].0,
            Phase::Listening { .. } => Step::ErrorControl,
            Phase::Starting { .. } | Phase::Running { .. } => Step::Start,
        }
    }

    /// A new attempt. It begins with a reset even when the node has just booted: only so a second node with the
    /// same id shows, by its own boot-up message.
    pub(super) fn begin(&mut self, now: Instant, shared: &mut Shared) {
        self.channel.abandon(shared);
        self.nmt_state = None;
        if self.config.reset {
            shared.outbox.push(wire::nmt(NmtCommand::ResetCommunication, self.id()));
            self.phase = Phase::Resetting { until: now + self.config.boot_timeout };
        } else {
            self.work(now, shared, 0, false);
        }
    }

    pub(super) fn first(&mut self, now: Instant, shared: &mut Shared) {
        self.boot_ups = 0;
        self.begin(now, shared);
    }

    pub(super) fn work(&mut self, now: Instant, shared: &mut Shared, at: usize, verify: bool) {
        let retries_left = shared.config.sdo_retries;
        let heard = self.nmt_state == Some(NmtState::PreOperational);
        self.phase = match self.plan.get(at) {
            Some(_) => Phase::Working { at, verify, retries_left },
            // A write of 0x1017 starts the heartbeat at once, so it may have come during the read-back.
            None if heard => return self.start(now, shared, STARTS),
            None => Phase::Listening { until: now + self.config.heartbeat_limit },
        };
        self.pump(now, shared);
    }

    /// Gives the free SDO channel its next transfer.
    pub(super) fn pump(&mut self, now: Instant, shared: &mut Shared) {
        if !self.channel.is_idle() {
            return;
        }
        match self.phase {
            Phase::Working { at, verify, .. } => self.transfer(now, at, verify, shared),
            Phase::Running { .. } => self.channel.serve(now, &mut self.stats, shared),
            Phase::Resting { until } if now < until => self.channel.serve(now, &mut self.stats, shared),
            Phase::Resting { .. } | Phase::Resetting { .. } | Phase::Listening { .. } | Phase::Starting { .. } => {}
        }
    }

    fn transfer(&mut self, now: Instant, at: usize, verify: bool, shared: &mut Shared) {
        let (index, sub, transfer) = match (&self.plan[at].1, verify) {
            (Work::Write(write), false) => (write.index, write.sub, Transfer::Write(write.value.clone())),
            (Work::Write(ConfigWrite { index, sub, .. }) | Work::Read(Expect { index, sub, .. }), _) => {
                (*index, *sub, Transfer::Read)
            }
        };
        self.channel.begin(now, index, sub, transfer, &mut self.stats, shared);
    }

    /// Takes the end of a transfer and goes on.
    pub(super) fn advance(&mut self, now: Instant, shared: &mut Shared) {
        if let Some(done) = self.channel.poll_done(&mut self.stats, shared)
            && let Phase::Working { at, verify, retries_left } = self.phase
        {
            self.worked(now, shared, done, (at, verify, retries_left));
        }
        self.pump(now, shared);
    }

    pub(super) fn worked(
        &mut self,
        now: Instant,
        shared: &mut Shared,
        done: sdo::Done,
        (at, verify, retries_left): (usize, bool, u8),
    ) {
        let (index, sub) = (done.index, done.sub);
        let data = match done.result {
            Ok(data) => data,
            Err(sdo::Error::Timeout) if retries_left > 0 => {
                self.stats.retries = self.stats.retries.saturating_add(1);
                self.phase = Phase::Working { at, verify, retries_left: retries_left - 1 };
                return;
            }
            Err(error) => return self.fail(now, shared, BootError::Sdo { index, sub, error }),
        };
        let mismatch = match &self.plan[at].1 {
            Work::Write(_) if !verify => return self.work(now, shared, at, true),
            Work::Write(write) => (data != write.value).then_some((u32::MAX, write.value.bits().unwrap_or(0))),
            Work::Read(expect) => {
                let holds = data.bits().is_some_and(|found| expect.holds(found));
                (!holds).then_some((expect.mask, expect.min))
            }
        };
        match mismatch {
            None => self.work(now, shared, at + 1, false),
            Some((mask, expected)) => {
                let found = data.bits().unwrap_or(0) & mask;
                self.fail(now, shared, BootError::Mismatch { index, sub, expected, found });
            }
        }
    }

    pub(super) fn fail(&mut self, now: Instant, shared: &mut Shared, reason: BootError) {
        let step = self.step();
        if self.reported.replace((step, reason)) != Some((step, reason)) {
            shared.events.push(Event::BootFailed { node: self.id(), step, reason });
        }
        self.channel.abandon(shared);
        self.phase = Phase::Resting { until: now + shared.config.retry };
    }

    pub(super) fn lose(&mut self, now: Instant, shared: &mut Shared, reason: LostReason) {
        self.stats.losses = self.stats.losses.saturating_add(1);
        shared.outbox.drop_pdos(self.id());
        shared.events.push(Event::Lost { node: self.id(), reason });
        self.channel.forget(shared);
        self.first(now, shared);
    }

    pub(super) fn booted_unasked(&mut self, now: Instant, shared: &mut Shared) {
        self.boot_ups += 1;
        if self.boot_ups >= RESTLESS {
            return self.fail(now, shared, BootError::Restless);
        }
        self.begin(now, shared);
    }

    pub(super) fn start(&mut self, now: Instant, shared: &mut Shared, starts_left: u8) {
        shared.outbox.push(wire::nmt(NmtCommand::Start, self.id()));
        let until = now + self.config.heartbeat_limit;
        self.phase = Phase::Starting { until, starts_left: starts_left - 1 };
    }

    pub(super) fn booted(&mut self, now: Instant, shared: &mut Shared) {
        self.phase = Phase::Running { until: now + self.config.heartbeat_limit };
        self.reported = None;
        self.stats.boots = self.stats.boots.saturating_add(1);
        shared.events.push(Event::Booted { node: self.id() });
        self.pump(now, shared);
    }
}
