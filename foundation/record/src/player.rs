//! Replays records to a shell and compares its answers with the recorded ones.

use super::{Record, Refusal, answer};
use base::Instant;
use module::{Action, Actions, Shell};

/// A shell that receives the calls of a recorded one.
pub struct Player {
    shell: Shell,
    out: Actions,
    wake: Option<Instant>,
    answer: Vec<u8>,
}

/// A call whose answer differs from the recorded one.
#[derive(Clone, Debug)]
pub struct Difference {
    /// Number of the record.
    pub record: u32,
    /// Time of the call.
    pub at: Instant,
    /// Description of the call, for people.
    pub call: String,
    /// First difference.
    pub first: First,
}

/// First difference of an answer.
#[derive(Clone, Debug)]
pub enum First {
    /// An action.
    Action {
        /// Index in the answer, from 0.
        place: usize,
        /// Recorded action; `None` if there were fewer.
        was: Option<Box<Action>>,
        /// Action of the replay; `None` if there are fewer.
        is: Option<Box<Action>>,
    },
    /// The next deadline.
    Wake {
        /// Recorded deadline.
        was: Option<Instant>,
        /// Deadline of the replay.
        is: Option<Instant>,
    },
}

impl Player {
    /// Creates a player for a shell in the same state as the recorded one at the start of the recording.
    #[must_use]
    pub fn new(shell: Shell) -> Self {
        Self { shell, out: Actions::default(), wake: None, answer: Vec::new() }
    }

    /// The shell, for inspection.
    #[must_use]
    pub fn shell(&self) -> &Shell {
        &self.shell
    }

    /// Replays one record; returns the number of resulting actions, or the difference. After a difference the shell has
    /// diverged, and further records prove nothing.
    ///
    /// # Errors
    /// The record contains what no recorder writes.
    pub fn play(&mut self, record: &Record<'_>) -> Result<Result<usize, Box<Difference>>, Refusal> {
        let now = record.at;
        if self.out.epoch() != record.epoch {
            self.out = Actions::new(record.epoch);
        }
        let (shell, out) = (&mut self.shell, &mut self.out);
        let ((), recorded) = record.call(|call| call.tell(shell, now, out))?;
        let wake = self.shell.poll_timeout();
        let changed = (wake != self.wake).then_some(wake);
        self.answer.clear();
        answer::put(&mut self.answer, now, self.out.as_slice(), changed);
        let count = self.out.as_slice().len();
        if self.answer == recorded {
            self.wake = wake;
            self.out.drain().for_each(drop);
            return Ok(Ok(count));
        }
        let is: Vec<Action> = self.out.drain().collect();
        self.difference(record, is, wake).map(|difference| Err(Box::new(difference)))
    }

    fn difference(
        &mut self,
        record: &Record<'_>,
        is: Vec<Action>,
        wake: Option<Instant>,
    ) -> Result<Difference, Refusal> {
        let was = record.answer()?;
        let (call, _) = record.call(|call| call.to_string())?;
        let bytes = |action: Option<&Action>| {
            let mut bytes = Vec::new();
            action.into_iter().for_each(|action| answer::put_action(&mut bytes, action));
            bytes
        };
        let longest = was.actions.len().max(is.len());
        let place = (0..longest).find(|place| bytes(was.actions.get(*place)) != bytes(is.get(*place)));
        let first = match place {
            Some(place) => {
                let boxed = |actions: &[Action]| actions.get(place).cloned().map(Box::new);
                First::Action { place, was: boxed(&was.actions), is: boxed(&is) }
            }
            None => First::Wake { was: was.wake.unwrap_or(self.wake), is: wake },
        };
        Ok(Difference { record: record.number, at: record.at, call, first })
    }
}
