//! Faults and reports, those of one fault and subject together.
//!
//! Which faults are active the modules list themselves (`CM_DATA_FAULTS`); how often and when, the reports tell
//! (`CM_EVENT_ERROR`). A module that lists nothing, of another language or in an older log, is judged by its reports, which
//! have no subjects.

use crate::subjects::{Subjects, listed};
use base::{Duration, Instant};
use messages::common::{self, DataFaults};
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};
use std::ops::Deref;

/// Maximum number of groups; beyond, the one that was seen longest ago goes, rather one that is cleared.
const GROUPS_MAX: usize = 256;
/// Maximum number of reports that are kept one by one.
const REPORTS_MAX: usize = 500;
/// Maximum number of modules whose lists are kept.
const MODULES_MAX: usize = 200;
/// A list older than this says nothing (`docs/design.md` 5).
pub const LIST_VALID: Duration = Duration::from_secs(3);

/// All reports of one fault with one subject by one module.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ErrorGroup {
    /// The module that reports.
    pub module: String,
    /// The fault's number (docs/faults.md).
    pub number: i32,
    /// Which of several: a board, a drive. Empty where there is only one, and where nothing but reports is known.
    pub subject: String,
    /// Number of times it was reported, its ends not counted.
    pub count: u64,
    /// When it was reported first, microseconds since the UNIX epoch.
    pub first: i64,
    /// When it was reported last.
    pub last: i64,
    /// The severity of the last report that was not its end; values of `error_t`.
    pub severity: i8,
    /// True while it is active, as far as is known.
    pub standing: bool,
    /// The last message.
    pub message: String,
    /// For the order.
    #[serde(skip)]
    seen: Instant,
    /// Since when it is active, by its module's list.
    #[serde(skip)]
    since: Option<i64>,
}

/// A group at a moment.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ShownGroup<'a> {
    /// The group.
    #[serde(flatten)]
    pub group: &'a ErrorGroup,
    /// False while it is not known which faults of its module are active: `standing` is as it was then.
    pub known: bool,
}

impl Deref for ShownGroup<'_> {
    type Target = ErrorGroup;

    fn deref(&self) -> &ErrorGroup {
        self.group
    }
}

/// A report, and what it is about.
#[derive(Clone, Debug, PartialEq)]
pub struct Reported {
    /// The report.
    pub error: common::Error,
    /// Its subject; none: not known.
    pub subject: Option<String>,
}

/// What is known of the active faults of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Knowledge {
    /// It lists them.
    Listed,
    /// It did once and does not any more, or it does not run.
    Unknown,
    /// It never did: only reports are known.
    Reported,
}

/// What was last listed in a module's name.
#[derive(Clone, Copy, Debug)]
struct List {
    at: Instant,
    /// By the watchdog: the module has no process.
    down: bool,
    /// The module itself has listed its faults, now or before.
    own: bool,
}

/// The faults and reports that were received.
#[derive(Clone, Debug, Default)]
pub struct Errors {
    groups: Vec<ErrorGroup>,
    reports: VecDeque<Reported>,
    lists: BTreeMap<String, List>,
    subjects: Subjects,
}

impl Errors {
    /// Takes a list of active faults.
    pub fn list(&mut self, at: Instant, list: &DataFaults) {
        let down = list.is_down();
        let before = self.lists.get(&list.module);
        if before.is_none() && self.lists.len() == MODULES_MAX {
            return;
        }
        let own = !down || before.is_some_and(|before| before.own);
        self.lists.insert(list.module.clone(), List { at, down, own });
        if down {
            return;
        }
        self.subjects.list(list);
        let faults = listed(list);
        for group in self.groups.iter_mut().filter(|group| group.standing && group.module == list.module) {
            if !faults.iter().any(|fault| group.is(fault)) {
                (group.standing, group.since, group.seen) = (false, None, at);
            }
        }
        for fault in faults {
            self.take(at, &list.module, fault);
        }
    }

    /// An active fault of a list.
    fn take(&mut self, at: Instant, module: &str, fault: &common::Fault) {
        let begun = match self.groups.iter_mut().find(|group| group.module == module && group.is(fault)) {
            Some(group) => {
                let known = group.since == Some(fault.since);
                // One whose report was received before the first list was counted then.
                if !known && group.last != fault.since {
                    group.count += 1;
                }
                if !known {
                    (group.last, group.seen) = (fault.since, at);
                }
                group
            }
            None => self.add(ErrorGroup {
                module: module.into(),
                number: fault.number,
                subject: fault.subject.clone(),
                count: 1,
                first: fault.since,
                last: fault.since,
                severity: fault.severity,
                standing: true,
                message: String::new(),
                seen: at,
                since: None,
            }),
        };
        (begun.standing, begun.since, begun.severity) = (true, Some(fault.since), fault.severity);
        if begun.message != fault.message {
            begun.message.clone_from(&fault.message);
        }
    }

    fn add(&mut self, group: ErrorGroup) -> &mut ErrorGroup {
        if self.groups.len() == GROUPS_MAX {
            self.forget_one();
        }
        let place = self.groups.len();
        self.groups.push(group);
        &mut self.groups[place]
    }

    /// Takes a report.
    pub fn hear(&mut self, at: Instant, error: &common::Error) {
        let over = error.severity == common::Error::NOTICE;
        let subject = self.subjects.of(error);
        match &subject {
            // The list has counted it, and has the message of what is active.
            Some(subject) => {
                let same = |group: &&mut ErrorGroup| {
                    group.module == error.module && group.number == error.number && group.subject == *subject
                };
                if let Some(group) = self.groups.iter_mut().find(same).filter(|_| over) {
                    group.message.clone_from(&error.message);
                }
            }
            None => self.count(at, error, over),
        }
        if self.reports.len() == REPORTS_MAX {
            self.reports.pop_front();
        }
        self.reports.push_back(Reported { error: error.clone(), subject });
    }

    /// A report of which no list knows: of a module that lists nothing, or of something that happened once.
    fn count(&mut self, at: Instant, error: &common::Error, over: bool) {
        let listed = self.lists.get(&error.module).is_some_and(|list| list.own);
        let same = |group: &&mut ErrorGroup| {
            group.module == error.module && group.number == error.number && group.subject.is_empty()
        };
        if let Some(group) = self.groups.iter_mut().find(same) {
            if !listed {
                group.standing = !over;
            }
            if !over {
                group.count += 1;
                if group.since.is_none() {
                    (group.last, group.severity) = (error.timestamp, error.severity);
                }
            }
            group.message.clone_from(&error.message);
            group.seen = at;
            return;
        }
        self.add(ErrorGroup {
            module: error.module.clone(),
            number: error.number,
            subject: String::new(),
            count: 1,
            first: error.timestamp,
            last: error.timestamp,
            severity: error.severity,
            standing: !over && !listed,
            message: error.message.clone(),
            seen: at,
            since: None,
        });
    }

    fn forget_one(&mut self) {
        let oldest = self.groups.iter().enumerate().min_by_key(|(_, group)| (group.standing, group.seen));
        if let Some(place) = oldest.map(|(place, _)| place) {
            self.groups.swap_remove(place);
        }
    }

    /// What is known of the active faults of a module.
    #[must_use]
    pub fn knowledge(&self, module: &str, now: Instant) -> Knowledge {
        match self.lists.get(module) {
            None => Knowledge::Reported,
            Some(list) if now.since(list.at) > LIST_VALID => {
                // One that never listed anything itself goes on by its reports once the watchdog has nothing to say of it.
                if list.own { Knowledge::Unknown } else { Knowledge::Reported }
            }
            Some(list) if list.down => Knowledge::Unknown,
            Some(_) => Knowledge::Listed,
        }
    }

    /// Number of active faults of a module; none: not known.
    #[must_use]
    pub fn active(&self, module: &str, now: Instant) -> Option<usize> {
        let count = self.groups.iter().filter(|group| group.standing && group.module == module).count();
        match self.knowledge(module, now) {
            Knowledge::Listed => Some(count),
            Knowledge::Unknown => None,
            Knowledge::Reported => Some(count).filter(|count| *count > 0),
        }
    }

    /// The groups: the active ones first, then those that were active when that was known, then the gravest, then the
    /// latest.
    #[must_use]
    pub fn groups(&self, now: Instant) -> Vec<ShownGroup<'_>> {
        let known = |module: &str| self.knowledge(module, now) != Knowledge::Unknown;
        let shown = self.groups.iter().map(|group| ShownGroup { group, known: known(&group.module) });
        let mut groups: Vec<_> = shown.collect();
        groups.sort_by_key(|group| (!group.standing, !group.known, -group.severity, std::cmp::Reverse(group.seen)));
        groups
    }

    /// The reports one by one, the latest first.
    pub fn reports(&self) -> impl Iterator<Item = &Reported> {
        self.reports.iter().rev()
    }

    /// The gravest fault of a module that is active.
    #[must_use]
    pub fn of(&self, module: &str, now: Instant) -> Option<&ErrorGroup> {
        self.groups(now).into_iter().find(|shown| shown.standing && shown.module == module).map(|shown| shown.group)
    }
}

impl ErrorGroup {
    fn is(&self, fault: &common::Fault) -> bool {
        self.number == fault.number && self.subject == fault.subject
    }

    /// Name and subject of its fault for people: `BoardLost sd1_front`.
    #[must_use]
    pub fn about(&self) -> String {
        let name = messages::fault_name(self.number);
        if self.subject.is_empty() { name.into_owned() } else { format!("{name} {}", self.subject) }
    }
}
