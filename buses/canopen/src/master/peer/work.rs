//! The SDO work of a boot-up: the plan is walked, an object at a time.

use super::{Peer, Phase, Shared, Stage};
use crate::master::channel::{End, Transfer};
use crate::master::plan::Work;
use crate::master::{BootError, ConfigWrite, Event, Expect, How};
use crate::{Abort, Payload, pdo, sdo};
use base::Instant;

/// Step after a piece of work.
enum Next {
    Stage(Stage),
    At(usize),
    Fail(BootError),
}

impl Peer {
    /// Goes on at a piece of work.
    pub(super) fn work(&mut self, now: Instant, shared: &mut Shared, mut at: usize) {
        while let Some((_, Work::Jump(to))) = self.plan.get(at) {
            at = *to;
        }
        let stage = match self.plan.get(at) {
            None => return self.listen(now, shared),
            Some((_, Work::Write(ConfigWrite { how: How::WhereDifferent | How::WhereThere, .. }))) => Stage::Compare,
            Some((_, Work::Close { .. })) => Stage::Compare,
            Some((_, Work::Write(_))) => Stage::Write,
            Some(_) => Stage::Verify,
        };
        self.stage(now, shared, at, stage);
    }

    fn stage(&mut self, now: Instant, shared: &mut Shared, at: usize, stage: Stage) {
        let retries_left = shared.config.sdo_retries;
        self.enter(Phase::Working { at, stage, retries_left }, shared);
        self.pump(now, shared);
    }

    /// Gives the free SDO channel its next transfer.
    pub(super) fn pump(&mut self, now: Instant, shared: &mut Shared) {
        if !self.channel.is_idle() {
            return;
        }
        match self.phase {
            Phase::Working { at, stage, .. } => self.transfer(now, at, stage, shared),
            Phase::Running { .. } => self.channel.serve(now, &mut self.stats, shared),
            Phase::Resting { until } if now < until => self.channel.serve(now, &mut self.stats, shared),
            Phase::Resting { .. } | Phase::Resetting { .. } | Phase::Left(_) => {}
            Phase::Listening { .. } | Phase::Held { .. } | Phase::Starting { .. } => {}
        }
    }

    fn transfer(&mut self, now: Instant, at: usize, stage: Stage, shared: &mut Shared) {
        let (index, sub, value) = match &self.plan[at].1 {
            Work::Write(write) | Work::Compare { write, .. } => (write.index, write.sub, Some(&write.value)),
            Work::Read(expect) | Work::Probe { expect, .. } => (expect.index, expect.sub, None),
            Work::Close { record, .. } => (*record, 1, None),
            Work::Serial | Work::Jump(_) => (0x1018, 4, None),
        };
        let transfer = match (stage, value) {
            (Stage::Write, Some(value)) => Transfer::Write(value.clone()),
            (Stage::Close(cob_id), _) => Transfer::Write(Payload::from(cob_id | pdo::INVALID)),
            _ => Transfer::Read,
        };
        self.channel.begin(now, index, sub, transfer, &mut self.stats, shared);
    }

    /// Takes the end of a transfer and goes on.
    pub(super) fn advance(&mut self, now: Instant, shared: &mut Shared) {
        let timeouts = self.stats.timeouts;
        let Some(end) = self.channel.poll_done(&mut self.stats, shared) else {
            return;
        };
        // With reception of own frames, frames of other clients look like those of this one.
        let is_plain = timeouts == self.stats.timeouts && !shared.config.own_frames_return;
        match (end, self.phase) {
            _ if is_plain && self.duplicate.answered(self.stats.ignored) => self.two(now, shared),
            (End::Given(done), Phase::Working { at, stage, retries_left }) => {
                self.worked(now, shared, done, (at, stage, retries_left));
            }
            _ => {}
        }
        if !is_plain {
            // What was late may still come.
            self.duplicate.forgive(self.stats.ignored);
        }
        self.pump(now, shared);
    }

    fn worked(
        &mut self,
        now: Instant,
        shared: &mut Shared,
        done: sdo::Done,
        (at, stage, retries_left): (usize, Stage, u8),
    ) {
        let next = match done.result {
            Ok(data) => self.answered(at, stage, &data, shared),
            Err(sdo::Error::Timeout) if retries_left > 0 => {
                self.stats.retries = self.stats.retries.saturating_add(1);
                return self.enter(Phase::Working { at, stage, retries_left: retries_left - 1 }, shared);
            }
            Err(error) => {
                let fail = Next::Fail(BootError::Sdo { index: done.index, sub: done.sub, error });
                self.refused(at, stage, error).unwrap_or(fail)
            }
        };
        match next {
            Next::Stage(stage) => self.stage(now, shared, at, stage),
            Next::At(at) => self.work(now, shared, at),
            Next::Fail(reason) => self.fail(now, shared, reason),
        }
    }

    fn answered(&mut self, at: usize, stage: Stage, data: &Payload, shared: &mut Shared) -> Next {
        let on = |holds: bool, otherwise: usize| Next::At(if holds { at + 1 } else { otherwise });
        match (&self.plan[at].1, stage) {
            (Work::Write(write), Stage::Compare) if *data != write.value => Next::Stage(Stage::Write),
            (Work::Write(write), Stage::Write) if write.how != How::Blindly => Next::Stage(Stage::Verify),
            (Work::Write(write), Stage::Verify) if *data != write.value => Next::Fail(differs(write, data)),
            (Work::Read(expect), _) if !holds(*expect, data) => Next::Fail(BootError::Mismatch {
                index: expect.index,
                sub: expect.sub,
                expected: expect.min,
                found: data.bits().unwrap_or(0) & expect.mask,
            }),
            (Work::Close { record, .. }, stage) => match (data.bits(), stage) {
                (_, Stage::Close(_)) => Next::Stage(Stage::Verify),
                (Some(cob_id), _) if cob_id & pdo::INVALID != 0 => Next::At(at + 1),
                (Some(cob_id), Stage::Compare) => Next::Stage(Stage::Close(cob_id)),
                (found, _) => Next::Fail(BootError::Mismatch {
                    index: *record,
                    sub: 1,
                    expected: pdo::INVALID,
                    found: found.unwrap_or(0) & pdo::INVALID,
                }),
            },
            (Work::Write(_) | Work::Read(_), _) => Next::At(at + 1),
            (Work::Compare { write, otherwise }, _) => on(*data == write.value && !self.swapped, *otherwise),
            (Work::Probe { expect, otherwise }, _) => on(holds(*expect, data), *otherwise),
            (Work::Serial, _) => {
                self.identify(data.bits(), shared);
                Next::At(at + 1)
            }
            (Work::Jump(to), _) => Next::At(*to),
        }
    }

    /// Step after a failed read or write; `None`: the attempt has failed.
    fn refused(&self, at: usize, stage: Stage, error: sdo::Error) -> Option<Next> {
        let sdo::Error::Refused(code) = error else {
            return None;
        };
        match (&self.plan[at].1, stage) {
            (Work::Write(ConfigWrite { how: How::WhereThere, .. }), Stage::Compare)
                if matches!(code, Abort::NO_OBJECT | Abort::NO_SUB_INDEX) =>
            {
                Some(Next::At(at + 1))
            }
            // The object may be write-only; if it does not exist, the write fails.
            (Work::Write(_), Stage::Compare) => Some(Next::Stage(Stage::Write)),
            (Work::Write(_), Stage::Verify) if code == Abort::WRITE_ONLY => Some(Next::At(at + 1)),
            (Work::Compare { otherwise, .. } | Work::Probe { otherwise, .. }, _) => Some(Next::At(*otherwise)),
            (Work::Close { otherwise, .. }, Stage::Compare)
                if matches!(code, Abort::NO_OBJECT | Abort::NO_SUB_INDEX) =>
            {
                Some(Next::At(*otherwise))
            }
            // Few devices have all of 0x1018.
            (Work::Serial, _) => Some(Next::At(at + 1)),
            _ => None,
        }
    }

    fn identify(&mut self, serial: Option<u32>, shared: &mut Shared) {
        let Some(serial) = serial else {
            return;
        };
        if self.serial.replace(serial).is_some_and(|before| before != serial) {
            self.swapped = true;
            shared.events.push(Event::Swapped { node: self.id(), serial });
        }
    }
}

fn holds(expect: Expect, data: &Payload) -> bool {
    data.bits().is_some_and(|found| expect.holds(found))
}

fn differs(write: &ConfigWrite, found: &Payload) -> BootError {
    let (index, sub) = (write.index, write.sub);
    match (write.value.bits(), found.bits()) {
        (Some(expected), Some(found)) if expected != found => BootError::Mismatch { index, sub, expected, found },
        _ => BootError::Differs { index, sub },
    }
}
