//! What besides the drives the motion depends on: the critical modules, the watchdog, the PAUSE line, the estimate.

use base::{Duration, Fault, Instant};
use messages::{common, lowlevel, middlelevel};
use module::sabotage::{self, Bug};
use std::fmt;

/// `CM_DATA_PROCESSES` comes ten times a second; without it for this long the watchdog is not heard.
const WATCHDOG_SILENT: Duration = Duration::from_millis(250);
/// `LL_EVENT_STOP` comes every 500 ms; without it for this long the PAUSE line is unknown.
const PAUSE_UNKNOWN: Duration = Duration::from_millis(1200);
/// The planner may not drive by an estimate older than this.
const ESTIMATE_OLD: Duration = Duration::from_millis(200);

/// Why the robot must not move, whatever anybody commands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Objection {
    /// A module that the motion depends on does not run.
    Critical(String),
    /// The watchdog was heard once and is not heard now.
    WatchdogSilent,
    /// The PAUSE line is engaged, by this source.
    Paused(String),
    /// The PAUSE line is not heard of.
    PauseUnknown,
}

impl Objection {
    /// The fault to report it as; an engaged PAUSE line is not a fault.
    #[must_use]
    pub fn fault(&self) -> Option<Fault> {
        match self {
            Self::Critical(_) => Some(Fault::CriticalModule),
            Self::WatchdogSilent => Some(Fault::WatchdogSilent),
            Self::Paused(_) | Self::PauseUnknown => None,
        }
    }
}

impl fmt::Display for Objection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Critical(module) => write!(f, "critical module {module} is not running"),
            Self::WatchdogSilent => f.write_str("the watchdog is not heard"),
            Self::Paused(source) => write!(f, "PAUSE is engaged by {source}"),
            Self::PauseUnknown => f.write_str("the state of the PAUSE line is unknown"),
        }
    }
}

/// What was last heard of the surroundings, each with when.
#[derive(Debug)]
pub struct Surroundings {
    critical: Vec<String>,
    /// Those that the motion depends on while the planner commands it.
    planning: Vec<String>,
    has_pause_line: bool,
    /// None until the watchdog was heard: without it this module is run by hand, and nothing guards the others.
    processes: Option<(Instant, Option<String>)>,
    /// One of `planning` that does not run.
    planning_missing: Option<String>,
    /// Since when the PAUSE line is listened to, or its last message.
    pause: (Instant, Option<String>),
    estimate: Option<Instant>,
}

impl Surroundings {
    /// Nothing heard yet. `has_pause_line`: the robot has a power controller that tells of the PAUSE line.
    #[must_use]
    pub fn new(critical: Vec<String>, planning: Vec<String>, has_pause_line: bool) -> Self {
        let pause = (Instant::ZERO, has_pause_line.then(|| "nobody heard of yet".into()));
        Self { critical, planning, has_pause_line, processes: None, planning_missing: None, pause, estimate: None }
    }

    /// The watchdog's list, received at `at`.
    pub fn on_processes(&mut self, at: Instant, list: &common::DataProcesses) {
        let runs = |name: &str| list.processes.iter().any(|p| p.module == name && p.phase == common::Process::RUNNING);
        let missing = self.critical.iter().find(|name| !runs(name) && !sabotage::is(Bug::CriticalIgnored)).cloned();
        self.processes = Some((at, missing));
        self.planning_missing = self.planning.iter().find(|name| !runs(name)).cloned();
    }

    /// The PAUSE line, received at `at`.
    pub fn on_stop(&mut self, at: Instant, stop: &lowlevel::EventStop) {
        let engaged = stop.engaged && !sabotage::is(Bug::PauseIgnored);
        self.pause = (at, engaged.then(|| stop.source.clone()));
    }

    /// An estimate, received at `at`; a lost one does not count.
    pub fn on_estimate(&mut self, at: Instant, estimate: &middlelevel::DataEstimate) {
        let known = estimate.quality >= middlelevel::DataEstimate::COARSE;
        self.estimate = known.then_some(at);
    }

    /// What stands against any motion at `now`.
    #[must_use]
    pub fn objection(&self, now: Instant) -> Option<Objection> {
        match &self.pause {
            (at, _) if self.has_pause_line && now.since(*at) >= PAUSE_UNKNOWN => return Some(Objection::PauseUnknown),
            // Whoever says so: without a power controller too.
            (_, Some(source)) => return Some(Objection::Paused(source.clone())),
            (_, None) => {}
        }
        match self.processes.as_ref()? {
            (at, _) if now.since(*at) >= WATCHDOG_SILENT && !sabotage::is(Bug::WatchdogNotMissed) => {
                Some(Objection::WatchdogSilent)
            }
            (_, Some(module)) => Some(Objection::Critical(module.clone())),
            (_, None) => None,
        }
    }

    /// Why the planner may not drive, beyond what stands against any motion: it, or the estimator, does not run, or it
    /// has no estimate to drive by.
    #[must_use]
    pub fn objection_to_planner(&self, now: Instant) -> Option<String> {
        if let Some(module) = &self.planning_missing {
            return Some(format!("the planner may not drive: {module} is not running"));
        }
        let located =
            self.estimate.is_some_and(|at| now.since(at) < ESTIMATE_OLD) || sabotage::is(Bug::EstimateIgnored);
        (!located).then(|| "the planner has no estimate to drive by".into())
    }

    /// When, after `now`, silence may make an objection or an old estimate, if nothing is heard until then.
    #[must_use]
    pub fn poll_timeout(&self, now: Instant) -> Option<Instant> {
        let watchdog = self.processes.as_ref().map(|(at, _)| *at + WATCHDOG_SILENT);
        let pause = self.has_pause_line.then(|| self.pause.0 + PAUSE_UNKNOWN);
        let estimate = self.estimate.map(|at| at + ESTIMATE_OLD);
        [watchdog, pause, estimate].into_iter().flatten().filter(|due| *due > now).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn processes(running: &[&str]) -> common::DataProcesses {
        let process = |name: &&str| common::Process {
            module: (*name).into(),
            phase: common::Process::RUNNING,
            ..common::Process::default()
        };
        common::DataProcesses { timestamp: 0, processes: running.iter().map(process).collect() }
    }

    #[test]
    fn a_critical_module_that_does_not_run_stands_against_motion() {
        let mut around = Surroundings::new(vec!["eyes".into()], vec![], false);
        assert_eq!(around.objection(at(0)), None, "run by hand, without a watchdog");
        around.on_processes(at(0), &processes(&["nerves"]));
        assert_eq!(around.objection(at(0)), Some(Objection::Critical("eyes".into())));
        around.on_processes(at(100), &processes(&["nerves", "eyes"]));
        assert_eq!(around.objection(at(349)), None);
        assert_eq!(around.objection(at(350)), Some(Objection::WatchdogSilent));
        assert_eq!(around.poll_timeout(at(349)), Some(at(350)));
        assert_eq!(around.poll_timeout(at(350)), None);
    }

    #[test]
    fn the_pause_line_must_be_known_and_open_where_there_is_one() {
        let mut around = Surroundings::new(vec![], vec![], true);
        assert!(around.objection(at(0)).is_some());
        let open = lowlevel::EventStop { timestamp: 0, engaged: false, source: String::new() };
        around.on_stop(at(100), &open);
        assert_eq!(around.objection(at(1299)), None);
        assert_eq!(around.objection(at(1300)), Some(Objection::PauseUnknown));
        around.on_stop(at(1400), &lowlevel::EventStop { engaged: true, source: "button".into(), ..open });
        assert_eq!(around.objection(at(1400)), Some(Objection::Paused("button".into())));
    }

    #[test]
    fn an_engaged_pause_line_counts_without_a_power_controller_too() {
        let mut around = Surroundings::new(vec![], vec![], false);
        assert_eq!(around.objection(at(5000)), None);
        around.on_stop(at(5000), &lowlevel::EventStop { timestamp: 0, engaged: true, source: "bumper1".into() });
        assert_eq!(around.objection(at(9000)), Some(Objection::Paused("bumper1".into())));
        around.on_stop(at(9000), &lowlevel::EventStop { timestamp: 0, engaged: false, source: "bumper1".into() });
        assert_eq!(around.objection(at(19_000)), None);
    }

    #[test]
    fn a_deadline_that_is_past_hides_none_that_comes() {
        let mut around = Surroundings::new(vec![], vec![], true);
        around.on_processes(at(0), &processes(&[]));
        around.on_stop(at(100), &lowlevel::EventStop { timestamp: 0, engaged: false, source: String::new() });
        assert_eq!(around.poll_timeout(at(300)), Some(at(1300)));
    }

    #[test]
    fn a_lost_or_old_estimate_does_not_carry_the_planner() {
        let mut around = Surroundings::new(vec![], vec![], false);
        let fine = middlelevel::DataEstimate { quality: middlelevel::DataEstimate::FINE, ..Default::default() };
        around.on_estimate(at(0), &fine);
        assert!(around.objection_to_planner(at(199)).is_none() && around.objection_to_planner(at(200)).is_some());
        assert_eq!(around.poll_timeout(at(0)), Some(at(200)));
        around.on_estimate(at(300), &middlelevel::DataEstimate { quality: middlelevel::DataEstimate::LOST, ..fine });
        assert_eq!(around.objection_to_planner(at(300)).unwrap(), "the planner has no estimate to drive by");
    }

    #[test]
    fn a_module_that_the_planner_needs_stands_against_the_planner_alone() {
        let mut around = Surroundings::new(vec![], vec!["map".into()], false);
        let fine = middlelevel::DataEstimate { quality: middlelevel::DataEstimate::FINE, ..Default::default() };
        around.on_estimate(at(0), &fine);
        assert_eq!(around.objection_to_planner(at(0)), None, "run by hand, without a watchdog");
        around.on_processes(at(0), &processes(&["eyes"]));
        assert_eq!(around.objection_to_planner(at(0)).unwrap(), "the planner may not drive: map is not running");
        assert_eq!(around.objection(at(0)), None);
        around.on_processes(at(100), &processes(&["map"]));
        assert_eq!(around.objection_to_planner(at(100)), None);
    }
}
