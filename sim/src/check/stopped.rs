//! STOP is never left without a manual command (docs/design.md, section 4): not by an error, not by a crash, not by a
//! command of a program.
//!
//! Evaluated by the order in which commands were sent: an operator's command out of STOP must be newer than the one
//! into it.

use super::Verdict;
use super::facts::Facts;
use super::names::Names;
use base::{Duration, Instant};
use module::State;

/// Maximum time by which commands of two senders may overtake each other.
const REORDERING_MAX: Duration = Duration::from_millis(2);
/// The same while LCM is disturbed.
const DISTURBED_REORDERING_MAX: Duration = Duration::from_millis(200);

/// A module.
#[derive(Debug, Default)]
struct Module {
    /// Time since which it is in STOP, or was when its process ended.
    stopped: Option<Instant>,
    commands: Commands,
}

/// Instants of the operator's last STOP command, and of one that leads out of it.
#[derive(Clone, Copy, Debug, Default)]
struct Commands {
    into: Option<Instant>,
    out: Option<Instant>,
    /// The STOP command may not have reached the watchdog, which starts the module again in the state that it knows.
    unheard: bool,
}

impl Commands {
    fn on_manual(&mut self, now: Instant, to: State, disturbed: bool) {
        match to {
            State::Stop => (self.into, self.unheard) = (Some(now), disturbed),
            State::Run | State::Pause => self.out = Some(now),
            _ => {}
        }
    }
}

/// All modules.
#[derive(Debug, Default)]
pub(super) struct Rule {
    modules: Names<Module>,
    /// Commands to all.
    all: Commands,
}

impl Rule {
    /// Processes an operator's state command.
    pub fn on_manual(&mut self, now: Instant, module: &str, to: State, facts: &Facts) {
        let commands = if module == "*" { &mut self.all } else { &mut self.modules.of(module).commands };
        commands.on_manual(now, to, facts.lcm_disturbed(now) == Some(now));
    }

    /// Processes a change of a module's state.
    pub fn on_state(&mut self, now: Instant, name: &str, state: State, facts: &Facts) -> Verdict {
        let all = self.all;
        let module = self.modules.of(name);
        match state {
            State::Stop => module.stopped = module.stopped.or(Some(now)),
            State::Run | State::Pause => {
                let Some(stopped) = module.stopped.take() else { return Ok(()) };
                let into = module.commands.into.max(all.into).unwrap_or(stopped);
                let out = module.commands.out.max(all.out);
                let unheard = if module.commands.into >= all.into { module.commands.unheard } else { all.unheard };
                if unheard && facts.life(name).is_some_and(|life| life.started > into) {
                    return Ok(());
                }
                let disturbed = facts.lcm_disturbed(now).is_some_and(|at| now.since(at) < DISTURBED_REORDERING_MAX);
                let order = if disturbed { DISTURBED_REORDERING_MAX } else { REORDERING_MAX };
                if out.is_none_or(|out| out + order < into) {
                    return Err(format!(
                        "{name} goes to {state}; it was stopped at {stopped:?}, and no operator let it go"
                    ));
                }
            }
            _ => {}
        }
        Ok(())
    }
}
