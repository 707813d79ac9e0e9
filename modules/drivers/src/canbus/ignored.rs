//! Sources whose last command was not followed, with one cause each, for the time to live of a command.

use super::arbiter::{Arbiter, PLANNER, SOURCES_MAX, SourceId};
use base::{Deadlines, Instant, Key};
use messages::Hold;
use module::ActiveHold;

/// Cause of each source of the arbiter. A source that takes a row of the arbiter's table is entered here with the same
/// command.
#[derive(Debug, Default)]
pub(super) struct Ignored {
    causes: [Option<Hold>; SOURCES_MAX],
    deadlines: Deadlines<SourceId>,
}

impl Ignored {
    /// Enters the cause for which the last command of a source was not followed; `None` if it was, or commands no
    /// motion.
    pub(super) fn put(&mut self, until: Instant, source: SourceId, hold: Option<Hold>) {
        self.causes[source.index()] = hold;
        self.deadlines.replace(source, hold.map(|_| until));
    }

    /// Removes entries older than a command's time to live.
    pub(super) fn expire(&mut self, now: Instant) {
        while let Some(source) = self.deadlines.pop(now) {
            self.causes[source.index()] = None;
        }
    }

    /// Deadline of [`Self::forget`].
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.deadlines.next()
    }

    /// True if the planner is among the sources.
    pub(super) fn has_planner(&self, arbiter: &Arbiter) -> bool {
        self.rows().any(|(source, _)| arbiter.priority(source) == PLANNER)
    }

    /// Rows for `LL_DATA_HOLD`, highest priority first.
    pub(super) fn active_holds<'a>(&'a self, arbiter: &'a Arbiter) -> impl Iterator<Item = ActiveHold<'a>> + Clone {
        let of_priority = move |priority| self.rows().filter(move |(source, _)| arbiter.priority(*source) == priority);
        let rows = super::arbiter::PRIORITIES.rev().flat_map(of_priority);
        rows.map(|(source, hold)| ActiveHold::new(hold, arbiter.name(source)))
    }

    fn rows(&self) -> impl Iterator<Item = (SourceId, Hold)> + Clone + '_ {
        SourceId::ALL.iter().zip(self.causes).filter_map(|(source, hold)| Some((*source, hold?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::Duration;
    use messages::lowlevel::CmdMotion;

    #[test]
    fn a_source_has_one_row_the_highest_priority_first_and_many_names_take_no_memory() {
        let (mut arbiter, mut ignored) = (Arbiter::new(Duration::from_millis(250)), Ignored::default());
        let command = |priority: i8, name: &str| CmdMotion {
            timestamp: 0,
            speed: 0.1,
            steering: 0.0,
            priority,
            source: name.into(),
        };
        let mut source = |ms, command| arbiter.command(Instant::from_millis(ms), &command, true).0;
        let planner = source(0, command(PLANNER, "planner"));
        let (web, nobody) = (source(0, command(1, "web")), source(0, command(1, "nobody")));
        let (early, late) = (Instant::from_millis(250), Instant::from_millis(300));
        ignored.put(early, planner, Some(Hold::Overruled));
        ignored.put(early, web, Some(Hold::Contested));
        ignored.put(late, planner, Some(Hold::PlannerLatched));
        ignored.put(late, nobody, None);
        let told = |ignored: &Ignored, arbiter: &Arbiter| {
            ignored.active_holds(arbiter).map(|row| (row.hold, row.subject.to_owned())).collect::<Vec<_>>()
        };
        let latched = (Hold::PlannerLatched, "planner".to_owned());
        assert_eq!(told(&ignored, &arbiter), [(Hold::Contested, "web".into()), latched.clone()]);
        assert_eq!((ignored.poll_timeout(), ignored.has_planner(&arbiter)), (Some(early), true));
        ignored.expire(early);
        assert_eq!(told(&ignored, &arbiter), [latched]);
        for n in 0..1000 {
            let (source, _) = arbiter.command(Instant::from_millis(1 + n), &command(1, &format!("s{n}")), true);
            ignored.put(Instant::from_millis(2000), source, Some(Hold::NotReleased));
        }
        let rows = told(&ignored, &arbiter);
        assert!(rows.len() == SOURCES_MAX && !ignored.has_planner(&arbiter));
        assert!(rows.contains(&(Hold::NotReleased, "s999".into())), "{rows:?}");
        ignored.expire(Instant::from_millis(2000));
        assert_eq!((told(&ignored, &arbiter), ignored.poll_timeout()), (vec![], None));
    }
}
