//! Conditions of motion outside the drives: the critical modules, the watchdog, the PAUSE line, the estimate.

use base::{Deadlines, Duration, Fault, Instant};
use messages::{Hold, StopSource, common, lowlevel, middlelevel};

/// `CM_DATA_PROCESSES` is sent ten times a second; after this time without it the watchdog counts as silent.
const WATCHDOG_TIMEOUT: Duration = Duration::from_millis(250);
/// `LL_EVENT_STOP` is sent every 500 ms; after this time without it the state of the PAUSE line is unknown.
const PAUSE_TIMEOUT: Duration = Duration::from_millis(1200);
/// Maximum age of an estimate by which the planner may drive.
const ESTIMATE_AGE_MAX: Duration = Duration::from_millis(200);

base::deadlines! {
    /// Deadlines of received data. A past deadline stays, and so does its consequence.
    enum Timer {
        /// The watchdog is silent. Set from its first list on: without a list this module was started by a person, and
        /// the others are not supervised.
        Watchdog,
        /// The state of the PAUSE line is unknown. Set if there is a power controller.
        Pause,
        /// The estimate is too old for the planner. Set if there is one.
        Estimate,
    }
}

/// Reason why the robot must not move, whatever the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Objection {
    /// A module that motion depends on does not run: its index in the configuration's list.
    Critical(usize),
    /// The watchdog has become silent.
    WatchdogSilent,
    /// The PAUSE line is engaged by this source.
    Paused(StopSource),
    /// The state of the PAUSE line is unknown.
    PauseUnknown,
}

impl Objection {
    /// Fault as which it is reported; an engaged PAUSE line is not a fault.
    #[must_use]
    pub fn fault(&self) -> Option<Fault> {
        match self {
            Self::Critical(_) => Some(Fault::CriticalModule),
            Self::WatchdogSilent => Some(Fault::WatchdogSilent),
            Self::Paused(_) | Self::PauseUnknown => None,
        }
    }
}

/// Last reported state of the PAUSE line.
#[derive(Clone, Debug, PartialEq)]
enum PauseLine {
    /// Nothing was received yet.
    Unknown,
    Open,
    /// Source, and its name as reported.
    Engaged(StopSource, String),
}

/// Last received data about the surroundings.
#[derive(Debug)]
pub struct Surroundings {
    critical: Vec<String>,
    /// Modules that motion depends on while the planner commands it.
    planning: Vec<String>,
    has_pause_line: bool,
    /// Indices in `critical` of modules that do not run.
    critical_missing: Vec<usize>,
    /// Indices in `planning` of modules that do not run.
    planning_missing: Vec<usize>,
    pause: PauseLine,
    deadlines: Deadlines<Timer>,
}

impl Surroundings {
    /// Creates the state with nothing received. `has_pause_line`: a power controller reports the PAUSE line.
    #[must_use]
    pub fn new(critical: Vec<String>, planning: Vec<String>, has_pause_line: bool) -> Self {
        let mut deadlines = Deadlines::new();
        if has_pause_line {
            deadlines.set(Timer::Pause, Instant::ZERO + PAUSE_TIMEOUT);
        }
        let pause = if has_pause_line { PauseLine::Unknown } else { PauseLine::Open };
        let (critical_missing, planning_missing) = (Vec::new(), Vec::new());
        Self { critical, planning, has_pause_line, critical_missing, planning_missing, pause, deadlines }
    }

    /// Processes the watchdog's list, received at `at`.
    pub fn on_processes(&mut self, at: Instant, list: &common::DataProcesses) {
        let runs = |name: &str| list.processes.iter().any(|p| p.module == name && p.phase == common::Process::RUNNING);
        let missing = |names: &[String], missing: &mut Vec<usize>| {
            missing.clear();
            missing.extend((0..names.len()).filter(|place| !runs(&names[*place])));
        };
        self.deadlines.set(Timer::Watchdog, at + WATCHDOG_TIMEOUT);
        missing(&self.planning, &mut self.planning_missing);
        missing(&self.critical, &mut self.critical_missing);
    }

    /// Processes the state of the PAUSE line, received at `at`.
    pub fn on_stop(&mut self, at: Instant, stop: &lowlevel::EventStop) {
        let source = StopSource::from_name(&stop.source);
        self.pause = if stop.engaged { PauseLine::Engaged(source, stop.source.clone()) } else { PauseLine::Open };
        if self.has_pause_line {
            self.deadlines.set(Timer::Pause, at + PAUSE_TIMEOUT);
        }
    }

    /// Processes an estimate, received at `at`; a lost one does not count.
    pub fn on_estimate(&mut self, at: Instant, estimate: &middlelevel::DataEstimate) {
        let known = estimate.quality >= middlelevel::DataEstimate::COARSE;
        self.deadlines.replace(Timer::Estimate, known.then_some(at + ESTIMATE_AGE_MAX));
    }

    /// All objections to any motion at `now`, main one first.
    pub fn objections(&self, now: Instant) -> impl Iterator<Item = Objection> + Clone + '_ {
        let pause = match &self.pause {
            _ if self.deadlines.is_due(Timer::Pause, now) => Some(Objection::PauseUnknown),
            PauseLine::Unknown => Some(Objection::PauseUnknown),
            // From any sender, even without a power controller.
            PauseLine::Engaged(source, _) => Some(Objection::Paused(*source)),
            PauseLine::Open => None,
        };
        let silent = self.deadlines.is_due(Timer::Watchdog, now);
        // An outdated list says nothing about the modules.
        let missing = if silent { &[][..] } else { &self.critical_missing };
        let missing = missing.iter().map(|place| Objection::Critical(*place));
        pause.into_iter().chain(silent.then_some(Objection::WatchdogSilent)).chain(missing)
    }

    /// Cause in `LL_DATA_HOLD` with its subject.
    #[must_use]
    pub fn hold(&self, objection: Objection) -> (Hold, &str) {
        match objection {
            Objection::Critical(place) => (Hold::CriticalModule, name(&self.critical, place)),
            Objection::WatchdogSilent => (Hold::WatchdogSilent, ""),
            Objection::PauseUnknown => (Hold::PauseUnknown, ""),
            Objection::Paused(source) => match &self.pause {
                PauseLine::Engaged(_, name) => (source.hold(), name),
                PauseLine::Unknown | PauseLine::Open => (source.hold(), source.name()),
            },
        }
    }

    /// Further objections to motion by the planner: planner or estimator does not run, or there is no valid estimate.
    /// Each with its subject.
    pub fn objections_to_planner(&self, now: Instant) -> impl Iterator<Item = (Hold, &str)> + Clone + '_ {
        let missing = self.planning_missing.iter().map(|place| (Hold::PlannerModule, name(&self.planning, *place)));
        let located = self.deadlines.get(Timer::Estimate).is_some_and(|old| now < old);
        missing.chain((!located).then_some((Hold::PlannerNoEstimate, "")))
    }

    /// Next deadline after `now` at which missing data becomes an objection.
    #[must_use]
    pub fn poll_timeout(&self, now: Instant) -> Option<Instant> {
        self.deadlines.next_after(now)
    }
}

fn name(names: &[String], place: usize) -> &str {
    names.get(place).map_or("", String::as_str)
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Surroundings {
        fn objection(&self, now: Instant) -> Option<Objection> {
            self.objections(now).next()
        }

        fn objection_to_planner(&self, now: Instant) -> Option<(Hold, &str)> {
            self.objections_to_planner(now).next()
        }
    }

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
    fn a_critical_module_that_does_not_run_blocks_motion() {
        let mut around = Surroundings::new(vec!["eyes".into()], vec![], false);
        assert_eq!(around.objection(at(0)), None, "run by hand, without a watchdog");
        around.on_processes(at(0), &processes(&["nerves"]));
        assert_eq!(around.objection(at(0)), Some(Objection::Critical(0)));
        around.on_processes(at(100), &processes(&["nerves", "eyes"]));
        assert_eq!(around.objection(at(349)), None);
        assert_eq!(around.objection(at(350)), Some(Objection::WatchdogSilent));
        assert_eq!(around.poll_timeout(at(349)), Some(at(350)));
        assert_eq!(around.poll_timeout(at(350)), None);
    }

    #[test]
    fn the_pause_line_must_be_known_and_released_if_present() {
        let mut around = Surroundings::new(vec![], vec![], true);
        assert_eq!(around.objection(at(0)), Some(Objection::PauseUnknown), "nothing was received yet");
        let open = lowlevel::EventStop { timestamp: 0, engaged: false, source: String::new() };
        around.on_stop(at(100), &open);
        assert_eq!(around.objection(at(1299)), None);
        assert_eq!(around.objection(at(1300)), Some(Objection::PauseUnknown));
        around.on_stop(at(1400), &lowlevel::EventStop { engaged: true, source: "button".into(), ..open });
        assert_eq!(around.objection(at(1400)), Some(Objection::Paused(StopSource::Button)));
    }

    #[test]
    fn an_engaged_pause_line_counts_without_a_power_controller_too() {
        let mut around = Surroundings::new(vec![], vec![], false);
        assert_eq!(around.objection(at(5000)), None);
        around.on_stop(at(5000), &lowlevel::EventStop { timestamp: 0, engaged: true, source: "bumper1".into() });
        assert_eq!(around.objection(at(9000)), Some(Objection::Paused(StopSource::Bumper1)));
        around.on_stop(at(9000), &lowlevel::EventStop { timestamp: 0, engaged: false, source: "bumper1".into() });
        assert_eq!(around.objection(at(19_000)), None);
    }

    #[test]
    fn all_objections_are_listed_with_their_subjects() {
        let mut around = Surroundings::new(vec!["eyes".into(), "nerves".into(), "ears".into()], vec![], true);
        around.on_processes(at(0), &processes(&["nerves"]));
        let told = |around: &Surroundings, now| {
            let told = around.objections(now).map(|objection| around.hold(objection));
            told.map(|(hold, subject)| (hold, subject.to_owned())).collect::<Vec<_>>()
        };
        let missing = |name: &str| (Hold::CriticalModule, name.to_owned());
        around.on_stop(at(0), &lowlevel::EventStop { timestamp: 0, engaged: true, source: "a rope".into() });
        assert_eq!(
            told(&around, at(100)),
            [(Hold::PauseOther, "a rope".into()), missing("eyes"), missing("ears")],
            "a source without a name in the contract keeps the one it gave"
        );
        around.on_stop(at(100), &lowlevel::EventStop { timestamp: 0, engaged: true, source: "bumper7".into() });
        let silent = (Hold::WatchdogSilent, String::new());
        assert_eq!(told(&around, at(300)), [(Hold::PauseBumper, "bumper7".into()), silent.clone()]);
        assert_eq!(told(&around, at(1300)), [(Hold::PauseUnknown, String::new()), silent]);
    }

    #[test]
    fn a_past_deadline_does_not_hide_a_future_one() {
        let mut around = Surroundings::new(vec![], vec![], true);
        around.on_processes(at(0), &processes(&[]));
        around.on_stop(at(100), &lowlevel::EventStop { timestamp: 0, engaged: false, source: String::new() });
        assert_eq!(around.poll_timeout(at(300)), Some(at(1300)));
    }

    #[test]
    fn a_lost_or_old_estimate_stops_the_planner() {
        let mut around = Surroundings::new(vec![], vec![], false);
        let fine = middlelevel::DataEstimate { quality: middlelevel::DataEstimate::FINE, ..Default::default() };
        around.on_estimate(at(0), &fine);
        assert!(around.objection_to_planner(at(199)).is_none() && around.objection_to_planner(at(200)).is_some());
        assert_eq!(around.poll_timeout(at(0)), Some(at(200)));
        around.on_estimate(at(300), &middlelevel::DataEstimate { quality: middlelevel::DataEstimate::LOST, ..fine });
        assert_eq!(around.objection_to_planner(at(300)), Some((Hold::PlannerNoEstimate, "")));
    }

    #[test]
    fn a_module_that_the_planner_needs_blocks_only_the_planner() {
        let mut around = Surroundings::new(vec![], vec!["map".into()], false);
        let fine = middlelevel::DataEstimate { quality: middlelevel::DataEstimate::FINE, ..Default::default() };
        around.on_estimate(at(0), &fine);
        assert_eq!(around.objection_to_planner(at(0)), None, "run by hand, without a watchdog");
        around.on_processes(at(0), &processes(&["eyes"]));
        assert_eq!(around.objection_to_planner(at(0)), Some((Hold::PlannerModule, "map")));
        assert_eq!(around.objection(at(0)), None);
        around.on_processes(at(100), &processes(&["map"]));
        assert_eq!(around.objection_to_planner(at(100)), None);
    }
}
