//! The wanted state of a module is the one that was commanded, and in calm every module reaches that state within 10 s
//! (docs/design.md, section 6), as reported in `CM_DATA_PROCESSES`, which must be received.

use super::Verdict;
use super::names::Names;
use base::{Duration, Instant};
use messages::common;
use module::State;

/// Maximum time from the begin of calm, or of a difference in it.
const SETTLING_MAX: Duration = Duration::from_secs(10);
/// Timeout of the list in calm; it is sent ten times a second.
const LIST_TIMEOUT: Duration = Duration::from_secs(1);
/// Maximum delay with which a watchdog that was held up follows a command.
const COMMAND_DELAY_MAX: Duration = Duration::from_secs(60);

/// Time when each state was last commanded.
#[derive(Clone, Copy, Debug, Default)]
struct Commands([Option<Instant>; State::ALL.len()]);

impl Commands {
    fn has(&self, now: Instant, state: i8) -> bool {
        let at = usize::try_from(state).ok().and_then(|state| *self.0.get(state)?);
        at.is_some_and(|at| now.since(at) < COMMAND_DELAY_MAX)
    }
}

/// A module.
#[derive(Debug, Default)]
struct Module {
    wanted: Option<i8>,
    commands: Commands,
    /// Instant since which it differs from the wanted state.
    differs: Option<Instant>,
}

/// All modules.
#[derive(Debug, Default)]
pub(super) struct Rule {
    modules: Names<Module>,
    all: Commands,
    /// Watchdog that sent the list.
    watchdog: u32,
    heard: Instant,
    calm: Option<Instant>,
    /// Longest time in calm until a module reached its wanted state.
    pub worst: Option<Duration>,
}

impl Rule {
    pub fn calm(&mut self, now: Instant) {
        self.calm = Some(now);
    }

    pub fn chaos(&mut self) {
        self.calm = None;
    }

    /// Processes a state command.
    pub fn on_command(&mut self, now: Instant, module: &str, to: State) {
        let commands = if module == "*" { &mut self.all } else { &mut self.modules.of(module).commands };
        commands.0[to as usize] = Some(now);
    }

    /// Processes the watchdog's list.
    pub fn on_list(&mut self, now: Instant, pid: u32, list: &common::DataProcesses) -> Verdict {
        let new = std::mem::replace(&mut self.watchdog, pid) != pid;
        self.heard = now;
        for row in &list.processes {
            let module = self.modules.of(&row.module);
            let before = module.wanted.replace(row.wanted).filter(|before| !new && *before != row.wanted);
            let commanded = |state| module.commands.has(now, state) || self.all.has(now, state);
            // RUN leads a module that was ended in STOP only back into STOP.
            let back = row.wanted == State::Stop as i8 && commanded(State::Run as i8);
            if let Some(before) = before.filter(|_| !commanded(row.wanted) && !back) {
                let name = &row.module;
                return Err(format!(
                    "{} is wanted of {name}, not {} any more; nobody commanded that",
                    row.wanted, before
                ));
            }
            let agreed = judge(now, self.calm, module, row)?;
            self.worst = self.worst.max(agreed);
        }
        Ok(())
    }

    /// Evaluates the time since the begin of calm.
    pub fn on_time(&self, now: Instant) -> Verdict {
        match self.calm {
            Some(calm) if now.since(calm) > SETTLING_MAX && now.since(self.heard) > LIST_TIMEOUT => {
                Err(format!("no list of processes in calm since {:?}", self.heard))
            }
            _ => Ok(()),
        }
    }
}

/// Duration in calm until the wanted state was reached.
fn judge(
    now: Instant,
    calm: Option<Instant>,
    module: &mut Module,
    row: &common::Process,
) -> Result<Option<Duration>, String> {
    let down = row.wanted == State::Terminate as i8 && row.phase == common::Process::TERMINATED;
    let agrees = row.state == row.wanted && row.phase == common::Process::RUNNING;
    if down || agrees {
        let differed = module.differs.take().zip(calm);
        return Ok(differed.map(|(since, calm)| now.since(since.max(calm))));
    }
    let since = *module.differs.get_or_insert(now);
    if calm.is_some_and(|calm| now.since(since.max(calm)) > SETTLING_MAX) {
        let common::Process { module, state, phase, wanted, .. } = row;
        return Err(format!("{module} is in state {state}, phase {phase}, and {wanted} is wanted since {since:?}"));
    }
    Ok(None)
}
