//! Causes that hold the robot, one row each, with their text for people.

use crate::Model;
use base::Instant;
use messages::lowlevel;
use serde::Serialize;

/// Maximum number of rows shown; a robot has a few.
const ROWS_MAX: usize = 64;
/// Code of rows from a robot or a log before `LL_DATA_HOLD`, of which only the text is known.
const TEXT_ALONE: i32 = 0;

/// Cause for which a module does not act.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct HoldRow {
    /// Module that does not act.
    pub module: String,
    /// Number of the cause (docs/holds.md); 0 if only the text is known, as in a log from before the numbers.
    pub code: i32,
    /// Name of the number; empty for one unknown to this version.
    pub name: &'static str,
    /// Drive, bus, module, source or waypoint, as on the wire.
    pub subject: String,
    /// Subject for people.
    pub who: String,
    /// Sentence for people.
    pub words: String,
    /// Action of an operator; empty if unknown.
    pub remedy: String,
    /// True if it remains until a person acts.
    pub latched: bool,
    /// Time since which it applies, microseconds since the UNIX epoch; `null` if unknown.
    pub since: Option<i64>,
}

impl HoldRow {
    fn of(module: &str, hold: &lowlevel::Hold) -> Self {
        let cause = hold.cause();
        let subject = hold.subject.as_str();
        Self {
            module: module.into(),
            code: hold.code,
            name: cause.map_or("", messages::Hold::name),
            who: cause.map_or_else(|| subject.into(), |cause| cause.who(subject)),
            words: hold.words(),
            remedy: cause.map_or_else(String::new, |cause| cause.remedy(subject)),
            subject: subject.into(),
            latched: hold.latched,
            since: Some(hold.since),
        }
    }

    fn text_alone(module: &str, words: &str) -> Self {
        Self {
            module: module.into(),
            code: TEXT_ALONE,
            name: "",
            subject: String::new(),
            who: String::new(),
            words: words.into(),
            remedy: String::new(),
            latched: false,
            since: None,
        }
    }
}

impl Model {
    /// Causes that hold the robot: of the motion, then of the goal, each the most important first. A cause of the
    /// motion that also holds the goal is listed once.
    #[must_use]
    pub fn hold_rows(&self, now: Instant) -> Vec<HoldRow> {
        let mut rows: Vec<HoldRow> = Vec::new();
        if !self.knows_holds()
            && let Some(motion) = self.motion.fresh(now).filter(|motion| !motion.reason.is_empty())
        {
            rows.push(HoldRow::text_alone(messages::MOTION_MODULE, &motion.reason));
        }
        for list in self.holds(now) {
            for hold in &list.holds {
                let known = rows.iter().any(|row| row.code == hold.code && row.subject == hold.subject);
                if !known && rows.len() < ROWS_MAX {
                    rows.push(HoldRow::of(&list.module, hold));
                }
            }
        }
        rows
    }
}
