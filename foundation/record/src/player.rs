//! Plays records to a shell and holds its answers against the recorded ones.

use super::{Record, Refusal, answer};
use base::Instant;
use module::{Action, Actions, Shell};

/// A shell that is told again what another one was told.
pub struct Player {
    shell: Shell,
    out: Actions,
    wake: Option<Instant>,
    answer: Vec<u8>,
}

/// A call that was answered otherwise than recorded.
#[derive(Clone, Debug)]
pub struct Difference {
    /// The number of the record.
    pub record: u32,
    /// When the call came.
    pub at: Instant,
    /// What the call was, for people.
    pub call: String,
    /// What differs first.
    pub first: First,
}

/// What differs first in an answer.
#[derive(Clone, Debug)]
pub enum First {
    /// An action.
    Action {
        /// Its place in the answer, from 0.
        place: usize,
        /// The recorded one; none: there were fewer.
        was: Option<Box<Action>>,
        /// The one of now; none: there are fewer.
        is: Option<Box<Action>>,
    },
    /// When the shell wants to be woken.
    Wake {
        /// As recorded.
        was: Option<Instant>,
        /// As of now.
        is: Option<Instant>,
    },
}

impl Player {
    /// Around a shell as it was when the recorder was put into its like.
    #[must_use]
    pub fn new(shell: Shell) -> Self {
        Self { shell, out: Actions::default(), wake: None, answer: Vec::new() }
    }

    /// The shell, to look at.
    #[must_use]
    pub fn shell(&self) -> &Shell {
        &self.shell
    }

    /// Plays one record; tells how many actions followed, or what differs. After a difference the shell is another one
    /// than the recorded, and further records prove nothing.
    ///
    /// # Errors
    /// The record holds what no recorder writes.
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
