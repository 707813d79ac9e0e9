//! The boot-up of a node: reset, plan, heartbeat, start; and its SDO channel, shared with requests on demand.

use super::{Active, Demand, Peer, Phase, RESTLESS, STARTS, Shared};
use crate::master::plan::Work;
use crate::master::{BootError, ConfigWrite, Event, Expect, LostReason, Step};
use crate::sdo;
use crate::wire::{self, NmtCommand, NmtState, Service};
use base::Instant;
use base::can::Frame;

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
        self.abandon(shared);
        self.nmt_state = None;
        if self.config.reset {
            shared.tx.push(wire::nmt(NmtCommand::ResetCommunication, self.id()));
            self.phase = Phase::Resetting { until: now + self.config.boot_timeout };
        } else {
            self.work(now, shared, 0, false);
        }
    }

    /// What was asked on demand before a node was lost was meant for the node that it was.
    pub(super) fn forget_demands(&mut self, shared: &mut Shared) {
        self.abandon(shared);
        while let Some(Demand { ticket, index, sub, .. }) = self.demands.pop() {
            let error = sdo::Error::Cancelled;
            shared.events.push(Event::SdoFailed { node: self.id(), ticket, index, sub, error });
        }
    }

    pub(super) fn first(&mut self, now: Instant, shared: &mut Shared) {
        self.boot_ups = 0;
        self.begin(now, shared);
    }

    /// Gives up the transfer under way; one on demand is told so.
    pub(super) fn abandon(&mut self, shared: &mut Shared) {
        self.sdo.cancel();
        if let Some(Active { ticket, index, sub, .. }) = self.demand.take() {
            let error = sdo::Error::Cancelled;
            shared.events.push(Event::SdoFailed { node: self.id(), ticket, index, sub, error });
        }
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
        if self.sdo.is_idle() {
            match self.phase {
                Phase::Working { at, verify, .. } => self.transfer(now, at, verify),
                Phase::Running { .. } => self.serve(now),
                Phase::Resting { until } if now < until => self.serve(now),
                Phase::Resting { .. } | Phase::Resetting { .. } | Phase::Listening { .. } | Phase::Starting { .. } => {}
            }
        }
        self.flush(shared);
    }

    pub(super) fn flush(&mut self, shared: &mut Shared) {
        while let Some(data) = self.sdo.poll_tx() {
            shared.tx.push(Frame::standard(Service::SdoRequest { node: self.id() }.cob_id(), &data));
        }
    }

    pub(super) fn transfer(&mut self, now: Instant, at: usize, verify: bool) {
        self.stats.requests = self.stats.requests.saturating_add(1);
        match (&self.plan[at].1, verify) {
            (Work::Write(write), false) => self.sdo.write(now, write.index, write.sub, write.value.clone()),
            (Work::Write(ConfigWrite { index, sub, .. }) | Work::Read(Expect { index, sub, .. }), _) => {
                self.sdo.read(now, *index, *sub)
            }
        };
    }

    pub(super) fn serve(&mut self, now: Instant) {
        let Some(Demand { ticket, index, sub, write }) = self.demands.pop() else {
            return;
        };
        self.stats.requests = self.stats.requests.saturating_add(1);
        self.demand = Some(Active { ticket, index, sub, write: write.is_some() });
        match write {
            Some(data) => self.sdo.write(now, index, sub, data),
            None => self.sdo.read(now, index, sub),
        };
    }

    /// Takes the end of a transfer and goes on.
    pub(super) fn advance(&mut self, now: Instant, shared: &mut Shared) {
        self.flush(shared);
        if let Some(done) = self.sdo.poll_done() {
            match done.result {
                Ok(_) => self.stats.succeeded(done.took),
                Err(sdo::Error::Timeout) => {
                    self.stats.timeouts = self.stats.timeouts.saturating_add(1);
                }
                Err(_) => {}
            }
            match (self.demand.take(), self.phase) {
                (Some(active), _) => self.answer(active, done, shared),
                (None, Phase::Working { at, verify, retries_left }) => {
                    self.worked(now, shared, done, (at, verify, retries_left));
                }
                (None, _) => {}
            }
        }
        self.pump(now, shared);
    }

    pub(super) fn answer(&self, active: Active, done: sdo::Done, shared: &mut Shared) {
        let (node, Active { ticket, index, sub, write }) = (self.id(), active);
        shared.events.push(match done.result {
            Ok(_) if write => Event::SdoWritten { node, ticket, index, sub },
            Ok(data) => Event::SdoRead { node, ticket, index, sub, data },
            Err(error) => Event::SdoFailed { node, ticket, index, sub, error },
        });
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
        self.abandon(shared);
        self.phase = Phase::Resting { until: now + shared.config.retry };
    }

    pub(super) fn lose(&mut self, now: Instant, shared: &mut Shared, reason: LostReason) {
        self.stats.losses = self.stats.losses.saturating_add(1);
        self.drop_pdos(shared);
        shared.events.push(Event::Lost { node: self.id(), reason });
        self.forget_demands(shared);
        self.first(now, shared);
    }

    /// No stale command may reach a drive that comes back (yarp-devices #246, #251).
    pub(super) fn drop_pdos(&self, shared: &mut Shared) {
        for _ in 0..shared.tx.len() {
            let Some(frame) = shared.tx.pop() else { break };
            let ours = matches!(Service::of(&frame), Some(Service::Rpdo { node, .. }) if node == self.id());
            if !ours {
                shared.tx.push(frame);
            }
        }
    }

    pub(super) fn booted_unasked(&mut self, now: Instant, shared: &mut Shared) {
        self.boot_ups += 1;
        if self.boot_ups >= RESTLESS {
            return self.fail(now, shared, BootError::Restless);
        }
        self.begin(now, shared);
    }

    pub(super) fn start(&mut self, now: Instant, shared: &mut Shared, starts_left: u8) {
        shared.tx.push(wire::nmt(NmtCommand::Start, self.id()));
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
