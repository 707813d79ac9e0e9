//! No restart storm (docs/design.md, section 6): a module that dies is restarted at once, then after 100 ms, doubling
//! up to the configured maximum; ten seconds of uptime undo one doubling. An operator's command lifts the delay, and a
//! restarted watchdog does not know the former delays.

use super::Verdict;
use super::facts::{DELAY_MAX, Facts};
use super::names::Names;
use base::{Duration, Instant};

/// First delay.
const DELAY_FIRST: Duration = Duration::from_millis(100);
/// Uptime that undoes one doubling.
const DECAY_UPTIME: Duration = Duration::from_secs(10);

/// A module.
#[derive(Debug, Default)]
struct Module {
    started: Instant,
    ended: Option<Instant>,
    /// Minimum next delay, before reductions.
    delay: Duration,
    commanded: bool,
}

/// All modules.
#[derive(Debug, Default)]
pub(super) struct Rule {
    modules: Names<Module>,
}

impl Rule {
    /// Processes a state command.
    pub fn on_command(&mut self, module: &str) {
        match module {
            "*" => self.modules.all().for_each(|(_, module)| module.commanded = true),
            name => self.modules.of(name).commanded = true,
        }
    }

    /// A process ended.
    pub fn on_exited(&mut self, now: Instant, name: &str) {
        self.modules.of(name).ended = Some(now);
    }

    /// Processes the start of a watchdog, which begins with new delays.
    pub fn on_watchdog(&mut self) {
        self.modules.all().for_each(|(_, module)| (module.ended, module.delay) = (None, Duration::ZERO));
    }

    /// A process is started.
    pub fn on_started(&mut self, now: Instant, name: &str, facts: &Facts) -> Verdict {
        let module = self.modules.of(name);
        let paid = now.since(module.started).as_nanos() / DECAY_UPTIME.as_nanos();
        let delay =
            module.delay.checked_div(1 << paid.min(20)).filter(|delay| *delay >= DELAY_FIRST).unwrap_or_default();
        let waited = module.ended.take().map(|ended| now.since(ended));
        (module.started, module.delay) = (now, (delay * 2).clamp(DELAY_FIRST, facts.limits.restart_max));
        let commanded = std::mem::take(&mut module.commanded);
        match waited {
            None => module.delay = Duration::ZERO,
            Some(waited) if waited + DELAY_MAX < delay && !commanded && name != facts.limits.watchdog => {
                return Err(format!("{name} is started again after {waited:?}, and not after {delay:?}"));
            }
            Some(_) => {}
        }
        Ok(())
    }
}
