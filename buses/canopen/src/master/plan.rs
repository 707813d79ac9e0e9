//! The SDO work of a boot-up, planned beforehand (CiA 302-2, 5.4): a list of steps, walked from its begin, with jumps
//! over those that a node does not need.

use super::{ConfigWrite, Expect, How, MasterConfig, NodeConfig, PdoMapping, Step};
use crate::pdo;
use alloc::vec::Vec;

/// "save" as 0x1010 wants it.
const SAVE: u32 = u32::from_le_bytes(*b"save");
/// Bit 30 of a COB-ID: no remote frames. That of the node does not count, but a TPDO that is set up gets it.
const NO_RTR: u32 = 1 << 30;
/// Communication record of the first RPDO.
const RPDO: u16 = 0x1400;
/// Communication record of the last RPDO (CiA 301, 7.5.2.35).
const RPDO_LAST: u16 = 0x15FF;
/// First RPDOs, each of which is asked for, whichever are missing. The drives known have four.
const RPDOS_ASKED: u16 = 8;
/// RPDOs of which those that follow [`RPDOS_ASKED`] are asked for up to the first that is missing.
const RPDOS_MAX: u16 = 16;

/// One step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Work {
    /// Read; it must hold this.
    Read(Expect),
    /// Read the serial number, where there is one: is it the device that was here before?
    Serial,
    /// Writes an object.
    Write(ConfigWrite),
    /// Read; where it is not this, go on at `otherwise`.
    Compare { write: ConfigWrite, otherwise: usize },
    /// Compares an object with a range, and jumps if it differs.
    Probe { expect: Expect, otherwise: usize },
    /// Switches an RPDO off; where there is none, go on at `otherwise`.
    Close { record: u16, otherwise: usize },
    /// Go on there.
    Jump(usize),
}

/// All reads and writes of a node before its heartbeat is awaited.
pub(super) fn plan(master: &MasterConfig, node: &NodeConfig) -> Vec<(Step, Work)> {
    let device_type = match node.device_type {
        Some(value) => Expect::equal(0x1000, 0, value),
        // Read nevertheless: the answer shows that the node lives.
        None => Expect::masked(0x1000, 0, 0, 0),
    };
    let mut plan = Plan::default();
    plan.push(Step::DeviceType, Work::Read(device_type));
    plan.extend(Step::Stop, node.stop.clone().map(Work::Write));
    for expect in &node.identity {
        plan.push(Step::Identity, Work::Read(*expect));
    }
    plan.push(Step::Identity, Work::Serial);
    plan.configuration(node);
    if node.only_mapped_rpdos {
        plan.close(node);
    }
    node.mappings.iter().for_each(|mapping| plan.mapping(mapping));
    let mut watched = Vec::new();
    if let Some(limit) = node.master_limit {
        watched.push(ConfigWrite::new(0x1016, 1, u32::from(master.id) << 16 | limit.as_millis() as u32));
    }
    match node.guarding {
        None => watched.push(ConfigWrite::new(0x1017, 0, node.heartbeat.as_millis() as u16)),
        // A node that sends its heartbeat does not let itself be guarded.
        Some(guarding) => watched.extend([
            ConfigWrite::new(0x1017, 0, 0_u16).where_there(),
            ConfigWrite::new(0x100C, 0, guarding.period.as_millis() as u16),
            ConfigWrite::new(0x100D, 0, guarding.factor),
        ]),
    }
    plan.extend(Step::ErrorControl, watched.into_iter().map(Work::Write));
    plan.0
}

#[derive(Default)]
struct Plan(Vec<(Step, Work)>);

impl Plan {
    fn push(&mut self, step: Step, work: Work) {
        self.0.push((step, work));
    }

    fn extend(&mut self, step: Step, works: impl IntoIterator<Item = Work>) {
        self.0.extend(works.into_iter().map(|work| (step, work)));
    }

    fn configuration(&mut self, node: &NodeConfig) {
        let Some(stamp) = node.stamp else {
            return self.writes(&node.writes);
        };
        let date = ConfigWrite::new(0x1020, 1, stamp.date);
        let time = ConfigWrite::new(0x1020, 2, stamp.time);
        let marks = [date.clone(), time.clone()];
        self.unless(
            Step::Configuration,
            marks,
            |write, otherwise| Work::Compare { write, otherwise },
            |plan| {
                plan.writes(&node.writes);
                plan.extend(Step::Configuration, [date, time].map(|write| Work::Write(write.always())));
                if stamp.store {
                    plan.push(Step::Configuration, Work::Write(ConfigWrite::new(0x1010, 1, SAVE).blindly()));
                }
            },
        );
    }

    /// Compares `goals`; where one differs, `body` follows.
    fn unless<T>(
        &mut self,
        step: Step,
        goals: impl IntoIterator<Item = T, IntoIter: ExactSizeIterator>,
        ask: impl Fn(T, usize) -> Work,
        body: impl FnOnce(&mut Self),
    ) {
        let goals = goals.into_iter();
        let jump = self.0.len() + goals.len();
        self.extend(step, goals.map(|goal| ask(goal, jump + 1)));
        self.push(step, Work::Jump(0));
        body(self);
        self.0[jump].1 = Work::Jump(self.0.len());
    }

    /// Writes in their order, cut where the order does not matter.
    fn writes(&mut self, mut writes: &[ConfigWrite]) {
        while !writes.is_empty() {
            let (group, rest) = writes.split_at(group_len(writes));
            writes = rest;
            match group {
                [write] => self.push(Step::Configuration, Work::Write(write.clone())),
                _ => self.group(Step::Configuration, group),
            }
        }
    }

    fn group(&mut self, step: Step, group: &[ConfigWrite]) {
        let body = |plan: &mut Self| {
            plan.extend(
                step,
                group.iter().cloned().map(|write| match write.how {
                    How::WhereDifferent => Work::Write(write.always()),
                    How::WhereThere | How::Always | How::Blindly => Work::Write(write),
                }),
            );
        };
        if group.iter().any(|write| write.how != How::WhereDifferent) {
            return body(self);
        }
        let is_last = |at: usize| !group[at + 1..].iter().any(|later| same(later, &group[at]));
        let goals: Vec<_> = (0..group.len()).filter(|at| is_last(*at)).map(|at| group[at].clone()).collect();
        self.unless(step, goals, |write, otherwise| Work::Compare { write, otherwise }, body);
    }

    /// Switches off all RPDOs that are not mapped: each of the first ones and of those that the data sheet lists, which
    /// may have gaps, and what follows the first ones up to the first that is missing. One that is missing costs one
    /// answer.
    fn close(&mut self, node: &NodeConfig) {
        let is_used = |record: &u16| node.mappings.iter().any(|pdo| pdo.record == *record);
        let followers = RPDO + RPDOS_ASKED..RPDO + RPDOS_MAX;
        let listed = node.rpdos.iter().copied().filter(|record| (RPDO..=RPDO_LAST).contains(record));
        let mut certain: Vec<_> = (RPDO..RPDO + RPDOS_ASKED).chain(listed).filter(|record| !is_used(record)).collect();
        certain.sort_unstable();
        certain.dedup();
        let followers: Vec<_> =
            followers.filter(|record| !is_used(record) && certain.binary_search(record).is_err()).collect();
        for record in certain {
            let otherwise = self.0.len() + 1;
            self.push(Step::Mapping, Work::Close { record, otherwise });
        }
        let otherwise = self.0.len() + followers.len();
        self.extend(Step::Mapping, followers.into_iter().map(|record| Work::Close { record, otherwise }));
    }

    fn mapping(&mut self, pdo: &PdoMapping) {
        // The PDO exists (bit 31), has 11 bits (bit 29) and this identifier.
        let cob_id = Expect::masked(pdo.record, 1, !NO_RTR, u32::from(pdo.cob_id));
        let count = Expect::equal(pdo.record + 0x200, 0, pdo.entries.len() as u32);
        let entries = pdo.entries.iter().zip(1..);
        let entries = entries.map(|(entry, sub)| Expect::equal(pdo.record + 0x200, sub, *entry));
        let all: Vec<_> = [cob_id, count].into_iter().chain(entries).collect();
        if !pdo.adjust {
            return self.extend(Step::Mapping, all.into_iter().map(Work::Read));
        }
        let no_rtr = if pdo.record >= 0x1800 { NO_RTR } else { 0 };
        let procedure = pdo::remap(pdo.record, u32::from(pdo.cob_id) | no_rtr, &pdo.entries, pdo.kind, None, None);
        self.unless(
            Step::Mapping,
            all,
            |expect, otherwise| Work::Probe { expect, otherwise },
            |plan| {
                plan.extend(Step::Mapping, procedure.into_iter().map(|write| Work::Write(write.always())));
            },
        );
    }
}

fn same(one: &ConfigWrite, other: &ConfigWrite) -> bool {
    (one.index, one.sub) == (other.index, other.sub)
}

/// Number of first writes that belong together: no object is written both among them and after them.
fn group_len(writes: &[ConfigWrite]) -> usize {
    let mut end = 1;
    let mut at = 0;
    while at < end {
        let last = writes.iter().rposition(|later| same(later, &writes[at])).unwrap_or(at);
        end = end.max(last + 1);
        at += 1;
    }
    end
}
