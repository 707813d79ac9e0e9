//! Which subject a report is about. The report does not say so; the list of active faults of its moment does, which comes
//! before it (`docs/design.md` 5).

use messages::common::{self, DataFaults, Error};
use std::collections::BTreeMap;

/// Maximum number of modules whose lists are kept.
const MODULES_MAX: usize = 200;
/// Maximum number of faults of a list that are looked at: as many as a shell lists.
pub(crate) const LISTED_MAX: usize = 256;

/// The faults of a list that are looked at.
pub(crate) fn listed(list: &DataFaults) -> &[common::Fault] {
    &list.faults[..list.faults.len().min(LISTED_MAX)]
}

/// The last list of each module.
#[derive(Clone, Debug, Default)]
pub struct Subjects {
    modules: BTreeMap<String, Listed>,
}

#[derive(Clone, Debug, Default)]
struct Listed {
    timestamp: i64,
    active: Vec<Entry>,
    /// Those that the last list was the first to have, until they are reported: each with its message.
    begun: Vec<(Entry, String)>,
    /// Those that the last list was the first not to have, until that is reported.
    ended: Vec<Entry>,
}

/// A fault of a list.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Entry {
    number: i32,
    subject: String,
    since: i64,
}

impl Subjects {
    /// Takes a list of active faults.
    pub fn list(&mut self, list: &DataFaults) {
        if list.is_down() || (self.modules.len() == MODULES_MAX && !self.modules.contains_key(&list.module)) {
            return;
        }
        let entry =
            |fault: &common::Fault| Entry { number: fault.number, subject: fault.subject.clone(), since: fault.since };
        let known = self.modules.entry(list.module.clone()).or_default();
        let before = std::mem::replace(&mut known.active, listed(list).iter().map(entry).collect());
        let begun = listed(list).iter().filter(|fault| fault.since == list.timestamp);
        known.begun = begun.map(|fault| (entry(fault), fault.message.clone())).collect();
        known.ended = before.into_iter().filter(|entry| !known.active.contains(entry)).collect();
        known.timestamp = list.timestamp;
    }

    /// The subject of a report; none where no list tells. Of several in one moment each is told once.
    pub fn of(&mut self, error: &Error) -> Option<String> {
        let known = self.modules.get_mut(&error.module).filter(|known| known.timestamp == error.timestamp)?;
        if error.severity == Error::NOTICE {
            let place = known.ended.iter().position(|entry| entry.number == error.number)?;
            return Some(known.ended.remove(place).subject);
        }
        let begun = |same_message: bool| {
            let of_it = |(entry, message): &(Entry, String)| {
                entry.number == error.number && (!same_message || *message == error.message)
            };
            known.begun.iter().position(of_it)
        };
        let place = begun(true).or_else(|| begun(false))?;
        Some(known.begun.remove(place).0.subject)
    }
}
