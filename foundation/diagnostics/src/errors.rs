//! Faults and reports, grouped by fault and subject.
//!
//! Modules list their active faults themselves (`CM_DATA_FAULTS`); number and times of occurrences follow from the
//! reports (`CM_EVENT_ERROR`). A module without a list, in another language or in an older log, is judged by its
//! reports, which have no subjects.

use crate::subjects::{Subjects, listed};
use base::{Duration, Fault, Instant};
use messages::common::{self, DataFaults};
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};
use std::ops::Deref;

/// Maximum number of groups; beyond it the one seen longest ago is dropped, cleared ones first.
const GROUPS_MAX: usize = 256;
/// Maximum number of single reports.
const REPORTS_MAX: usize = 500;
/// Maximum number of modules whose lists are kept.
const MODULES_MAX: usize = 200;
/// Time for which a list is valid (`docs/design.md` 5).
pub const LIST_VALID: Duration = Duration::from_secs(3);

/// Reports of one fault with one subject by one module.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ErrorGroup {
    /// Reporting module.
    pub module: String,
    /// Number of the fault (docs/faults.md).
    pub number: i32,
    /// Subject, such as a board or a drive. Empty if there is only one, or if only reports are known.
    pub subject: String,
    /// Number of reports, without the clearing ones.
    pub count: u64,
    /// First report, microseconds since the UNIX epoch.
    pub first: i64,
    /// Last report, microseconds since the UNIX epoch.
    pub last: i64,
    /// Severity of the last report that was not a clearing one; values of `error_t`.
    pub severity: i8,
    /// True while the fault is active, as far as known.
    pub standing: bool,
    /// Last message that was not a clearing one: of a cleared fault the cause.
    pub cause: String,
    /// Last message.
    pub message: String,
    /// Time of the last change, for the order.
    #[serde(skip)]
    seen: Instant,
    /// Time since which it is active, by its module's list.
    #[serde(skip)]
    since: Option<i64>,
}

/// Group at one instant.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ShownGroup<'a> {
    /// Group.
    #[serde(flatten)]
    pub group: &'a ErrorGroup,
    /// False while the active faults of its module are unknown: `standing` is then the last known value.
    pub known: bool,
}

impl Deref for ShownGroup<'_> {
    type Target = ErrorGroup;

    fn deref(&self) -> &ErrorGroup {
        self.group
    }
}

/// Report with its subject.
#[derive(Clone, Debug, PartialEq)]
pub struct Reported {
    /// Report.
    pub error: common::Error,
    /// Subject; `None` if unknown.
    pub subject: Option<String>,
}

/// Source of the knowledge about a module's active faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Knowledge {
    /// The module lists them.
    Listed,
    /// The module listed them once and no longer does, or it does not run.
    Unknown,
    /// The module never listed them: only reports are known.
    Reported,
}

/// Last list in a module's name.
#[derive(Clone, Copy, Debug)]
struct List {
    at: Instant,
    /// True if published by the watchdog: the module has no process.
    down: bool,
    /// True if the module itself has published a list, now or before.
    own: bool,
}

/// Received faults and reports.
#[derive(Clone, Debug, Default)]
pub struct Errors {
    groups: Vec<ErrorGroup>,
    reports: VecDeque<Reported>,
    lists: BTreeMap<String, List>,
    subjects: Subjects,
}

impl Errors {
    /// Processes a list of active faults.
    pub fn on_list(&mut self, at: Instant, list: &DataFaults) {
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
        self.subjects.on_list(list);
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

    /// Adds or updates an active fault of a list.
    fn take(&mut self, at: Instant, module: &str, fault: &common::Fault) {
        let begun = match self.groups.iter_mut().find(|group| group.module == module && group.is(fault)) {
            Some(group) => {
                let known = group.since == Some(fault.since);
                // A fault whose report arrived before the first list was counted then.
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
                cause: String::new(),
                message: String::new(),
                seen: at,
                since: None,
            }),
        };
        (begun.standing, begun.since, begun.severity) = (true, Some(fault.since), fault.severity);
        if begun.message != fault.message || begun.cause != fault.message {
            begun.say(&fault.message, false);
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

    /// Processes a report.
    pub fn on_report(&mut self, at: Instant, error: &common::Error) {
        let over = error.severity == common::Error::NOTICE;
        let subject = self.subjects.of(error);
        match &subject {
            // Already counted with the list, which has the message of the active fault.
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

    /// Counts a report without a list: of a module that publishes none, or of a single event.
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
            group.say(&error.message, over);
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
            cause: if over { String::new() } else { error.message.clone() },
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

    /// Source of the knowledge about a module's active faults.
    #[must_use]
    pub fn knowledge(&self, module: &str, now: Instant) -> Knowledge {
        match self.lists.get(module) {
            None => Knowledge::Reported,
            Some(list) if now.since(list.at) > LIST_VALID => {
                // A module that never published a list is judged by its reports again once the watchdog's list expires.
                if list.own { Knowledge::Unknown } else { Knowledge::Reported }
            }
            Some(list) if list.down => Knowledge::Unknown,
            Some(_) => Knowledge::Listed,
        }
    }

    /// Number of active faults of a module; `None` if unknown.
    #[must_use]
    pub fn active(&self, module: &str, now: Instant) -> Option<usize> {
        let count = self.groups.iter().filter(|group| group.standing && group.module == module).count();
        match self.knowledge(module, now) {
            Knowledge::Listed => Some(count),
            Knowledge::Unknown => None,
            Knowledge::Reported => Some(count).filter(|count| *count > 0),
        }
    }

    /// Groups: active ones first, then those active when last known, then by severity, then by time.
    #[must_use]
    pub fn groups(&self, now: Instant) -> Vec<ShownGroup<'_>> {
        let known = |module: &str| self.knowledge(module, now) != Knowledge::Unknown;
        let shown = self.groups.iter().map(|group| ShownGroup { group, known: known(&group.module) });
        let mut groups: Vec<_> = shown.collect();
        groups.sort_by_key(|group| (!group.standing, !group.known, -group.severity, std::cmp::Reverse(group.seen)));
        groups
    }

    /// True if this fault is active with this subject, as far as known.
    #[must_use]
    pub fn is_active(&self, fault: Fault, subject: &str) -> bool {
        self.groups.iter().any(|group| group.standing && group.number == fault as i32 && group.subject == subject)
    }

    /// Single reports, the newest first.
    pub fn reports(&self) -> impl Iterator<Item = &Reported> {
        self.reports.iter().rev()
    }

    /// Most severe active fault of a module.
    #[must_use]
    pub fn of(&self, module: &str, now: Instant) -> Option<&ErrorGroup> {
        self.groups(now).into_iter().find(|shown| shown.standing && shown.module == module).map(|shown| shown.group)
    }
}

impl ErrorGroup {
    /// Stores the message of a report.
    fn say(&mut self, message: &str, over: bool) {
        message.clone_into(&mut self.message);
        if !over {
            message.clone_into(&mut self.cause);
        }
    }

    fn is(&self, fault: &common::Fault) -> bool {
        self.number == fault.number && self.subject == fault.subject
    }

    /// Name and subject of the fault for people: `BoardLost sd1_front`.
    #[must_use]
    pub fn about(&self) -> String {
        let name = messages::fault_name(self.number);
        if self.subject.is_empty() { name.into_owned() } else { format!("{name} {}", self.subject) }
    }
}
