//! The SDO work of a boot-up, laid out beforehand.

use super::{ConfigWrite, Expect, MasterConfig, NodeConfig, Step};
use alloc::vec::Vec;

/// One piece of work; a write is followed by its read-back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Work {
    Read(Expect),
    Write(ConfigWrite),
}

/// Everything a node is asked and told before its heartbeat is awaited.
pub(super) fn plan(master: &MasterConfig, node: &NodeConfig) -> Vec<(Step, Work)> {
    let device_type = match node.device_type {
        Some(value) => Expect::equal(0x1000, 0, value),
        // Read nevertheless: the answer shows that the node lives.
        None => Expect::masked(0x1000, 0, 0, 0),
    };
    let mut plan = Vec::new();
    plan.push((Step::DeviceType, Work::Read(device_type)));
    plan.extend(node.identity.iter().map(|expect| (Step::Identity, Work::Read(*expect))));
    plan.extend(node.writes.iter().map(|write| (Step::Configuration, Work::Write(write.clone()))));
    for pdo in &node.mappings {
        // The PDO exists (bit 31), has 11 bits (bit 29) and this identifier.
        let cob_id = Expect::masked(pdo.record, 1, 0xBFFF_FFFF, u32::from(pdo.cob_id));
        let count = Expect::equal(pdo.record + 0x200, 0, pdo.entries.len() as u32);
        let entries = pdo.entries.iter().zip(1..);
        let entries = entries.map(|(entry, sub)| Expect::equal(pdo.record + 0x200, sub, *entry));
        let all = [cob_id, count].into_iter().chain(entries);
        plan.extend(all.map(|expect| (Step::Mapping, Work::Read(expect))));
    }
    if let Some(limit) = node.master_limit {
        let entry = u32::from(master.id) << 16 | limit.as_millis() as u32;
        plan.push((Step::ErrorControl, Work::Write(ConfigWrite::new(0x1016, 1, entry))));
    }
    let period = node.heartbeat.as_millis() as u16;
    plan.push((Step::ErrorControl, Work::Write(ConfigWrite::new(0x1017, 0, period))));
    plan
}
