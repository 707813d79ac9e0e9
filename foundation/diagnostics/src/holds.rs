//! All for which the robot does not act, one row a cause, with the words that people read.

use crate::Model;
use base::Instant;
use messages::lowlevel;
use serde::Serialize;

/// Rows that are shown; a robot has a few.
const ROWS_MAX: usize = 64;
/// Of a robot, or a log, from before `LL_DATA_HOLD`: only the text is known.
const TEXT_ALONE: i32 = 0;

/// A cause for which a module does not act.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct HoldRow {
    /// The module that does not act.
    pub module: String,
    /// What, by number (docs/holds.md); 0 where only the words are known, as of a log from before the numbers.
    pub code: i32,
    /// The number's name; empty of a number that this version does not know.
    pub name: &'static str,
    /// Which drive, bus, module, source or waypoint, as on the wire.
    pub subject: String,
    /// The same as people call it.
    pub who: String,
    /// In a sentence.
    pub words: String,
    /// What to do about it; empty where that is not known.
    pub remedy: String,
    /// Stays until a person acts.
    pub latched: bool,
    /// Since when, microseconds since the UNIX epoch; `null` where that is not known.
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
    /// Everything that keeps the robot from acting: first what stops the motion, then what stops the goal, each in order of
    /// weight. A cause of the goal that is the motion's is listed once.
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
