//! Errors, those of one kind together.

use base::Instant;
use messages::common;
use serde::Serialize;
use std::collections::VecDeque;

/// Kinds that are kept; beyond, the one that was seen longest ago goes, rather one that is over.
const GROUPS_MAX: usize = 256;
/// Reports that are kept one by one.
const REPORTS_MAX: usize = 500;

/// All reports with one number by one module.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ErrorGroup {
    /// The module that reports.
    pub module: String,
    /// The fault's number (docs/faults.md).
    pub number: i32,
    /// How often it was reported, its ends not counted.
    pub count: u64,
    /// When it was reported first, microseconds since the UNIX epoch.
    pub first: i64,
    /// When it was reported last.
    pub last: i64,
    /// The severity of the last report that was not its end; values of `error_t`.
    pub severity: i8,
    /// Whether it stands: no end was reported since.
    pub standing: bool,
    /// What was said last.
    pub message: String,
    /// For the order.
    #[serde(skip)]
    seen: Instant,
}

/// The errors that were heard.
#[derive(Clone, Debug, Default)]
pub struct Errors {
    groups: Vec<ErrorGroup>,
    reports: VecDeque<common::Error>,
}

impl Errors {
    /// Takes a report.
    pub fn hear(&mut self, at: Instant, error: &common::Error) {
        if self.reports.len() == REPORTS_MAX {
            self.reports.pop_front();
        }
        self.reports.push_back(error.clone());
        let over = error.severity == common::Error::NOTICE;
        let same = |group: &&mut ErrorGroup| group.module == error.module && group.number == error.number;
        if let Some(group) = self.groups.iter_mut().find(same) {
            group.standing = !over;
            if !over {
                (group.count, group.last, group.severity) = (group.count + 1, error.timestamp, error.severity);
            }
            group.message.clone_from(&error.message);
            group.seen = at;
            return;
        }
        if self.groups.len() == GROUPS_MAX {
            self.forget_one();
        }
        self.groups.push(ErrorGroup {
            module: error.module.clone(),
            number: error.number,
            count: 1,
            first: error.timestamp,
            last: error.timestamp,
            severity: error.severity,
            standing: !over,
            message: error.message.clone(),
            seen: at,
        });
    }

    fn forget_one(&mut self) {
        let oldest = self.groups.iter().enumerate().min_by_key(|(_, group)| (group.standing, group.seen));
        if let Some(place) = oldest.map(|(place, _)| place) {
            self.groups.swap_remove(place);
        }
    }

    /// The kinds: those that stand first, then the gravest, then the latest.
    #[must_use]
    pub fn groups(&self) -> Vec<&ErrorGroup> {
        let mut groups: Vec<_> = self.groups.iter().collect();
        groups.sort_by_key(|group| (!group.standing, -group.severity, std::cmp::Reverse(group.seen)));
        groups
    }

    /// The reports one by one, the latest first.
    pub fn reports(&self) -> impl Iterator<Item = &common::Error> {
        self.reports.iter().rev()
    }

    /// The gravest error of a module that stands.
    #[must_use]
    pub fn of(&self, module: &str) -> Option<&ErrorGroup> {
        self.groups().into_iter().find(|group| group.standing && group.module == module)
    }
}
