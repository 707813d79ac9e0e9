//! Subject of a report. The report does not contain it; the list of active faults of the same instant does, which is
//! published before it (`docs/design.md` 5).

use messages::common::{self, DataFaults, Error};
use std::collections::BTreeMap;

/// Maximum number of modules whose lists are kept.
const MODULES_MAX: usize = 200;
/// Maximum number of faults used of a list: as many as a module publishes.
pub(crate) const LISTED_MAX: usize = 256;

/// Faults of a list that are used.
pub(crate) fn listed(list: &DataFaults) -> &[common::Fault] {
    &list.faults[..list.faults.len().min(LISTED_MAX)]
}

/// Last list of each module.
#[derive(Clone, Debug, Default)]
pub struct Subjects {
    modules: BTreeMap<String, Listed>,
}

#[derive(Clone, Debug, Default)]
struct Listed {
    timestamp: i64,
    active: Vec<Entry>,
    /// Faults that are new in the last list and not reported yet, each with its message.
    begun: Vec<(Entry, String)>,
    /// Faults that are missing in the last list and not reported as cleared yet.
    ended: Vec<Entry>,
}

/// Fault of a list.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Entry {
    number: i32,
    subject: String,
    since: i64,
}

impl Subjects {
    /// Processes a list of active faults.
    pub fn on_list(&mut self, list: &DataFaults) {
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

    /// Subject of a report; `None` if no list contains it. Of several with the same instant each is returned once.
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
