//! Conditions of motion outside the drives: the critical modules, the watchdog, the PAUSE line, the ranging boards, the
//! estimate.

use super::NAME;
use super::pause::{InputName, PauseLine, Paused};
use super::ranging::Ranging;
use base::{Deadlines, Duration, Fault, Instant, earliest};
use messages::{Hold, common, lowlevel, middlelevel};
use module::admission::Origin;

/// `CM_DATA_PROCESSES` is sent ten times a second; after this time without it the watchdog counts as silent.
const WATCHDOG_TIMEOUT: Duration = Duration::from_millis(250);
/// States in which a critical module does its work.
const WORKING: [i8; 2] = [common::DataState::RUN, common::DataState::PAUSE];
/// Maximum age of an estimate by which the planner may drive.
const ESTIMATE_AGE_MAX: Duration = Duration::from_millis(200);

base::deadlines! {
    /// Deadlines of received data. A past deadline stays, and so does its consequence.
    enum Timer {
        /// The watchdog is silent. Set from its first list on, and from the start in a process that a watchdog started:
        /// any other process was started by a person, and the other modules are not supervised.
        Watchdog,
        /// The estimate is too old for the planner. Set if there is one.
        Estimate,
    }
}

/// Reason why the robot must not move, whatever the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Objection {
    /// A module that motion depends on does not run, or is not in RUN or PAUSE: its index in the configuration's list.
    Critical(usize),
    /// The watchdog has become silent.
    WatchdogSilent,
    /// The watchdog that started this process has not been received yet.
    WatchdogUnheard,
    /// The PAUSE line.
    Paused(Paused),
    /// A ranging board does not measure: its index.
    Ranging(usize),
    /// The watchdog of another robot is on the message bus.
    SecondRobot,
}

impl Objection {
    /// Fault as which it is reported; an engaged PAUSE line is not a fault.
    #[must_use]
    pub fn fault(&self) -> Option<Fault> {
        match self {
            Self::Critical(_) => Some(Fault::CriticalModule),
            Self::WatchdogSilent => Some(Fault::WatchdogSilent),
            Self::Ranging(_) => Some(Fault::RangingLost),
            // The host has reported a second robot.
            Self::Paused(_) | Self::WatchdogUnheard | Self::SecondRobot => None,
        }
    }
}

/// Last received data about the surroundings.
#[derive(Debug)]
pub struct Surroundings {
    critical: Vec<String>,
    /// Modules that motion depends on while the planner commands it.
    planning: Vec<String>,
    /// Indices in `critical` of modules that do not run.
    critical_missing: Vec<usize>,
    /// Indices in `planning` of modules that do not run.
    planning_missing: Vec<usize>,
    /// The watchdog has started this module again since its own start.
    restarted: bool,
    pub(super) pause: PauseLine,
    ranging: Ranging,
    /// Another robot is on the message bus.
    second_robot: bool,
    deadlines: Deadlines<Timer>,
}

impl Surroundings {
    /// Creates the state with nothing received. `has_pause_line`: a power controller reports the PAUSE line; the pair:
    /// lidars whose own fields stop the robot, and inputs that do; `guarded`: a watchdog started this process.
    #[must_use]
    pub(super) fn new(
        critical: Vec<String>,
        planning: Vec<String>,
        has_pause_line: bool,
        (fields, inputs): (&[String], &[InputName]),
        guarded: bool,
        ranging: Ranging,
    ) -> Self {
        let mut deadlines = Deadlines::new();
        if guarded {
            deadlines.set(Timer::Watchdog, Instant::ZERO);
        }
        let pause = PauseLine::new(has_pause_line, fields, inputs);
        let (critical_missing, planning_missing) = (Vec::new(), Vec::new());
        Self {
            critical,
            planning,
            critical_missing,
            planning_missing,
            restarted: false,
            pause,
            ranging,
            second_robot: false,
            deadlines,
        }
    }

    /// Processes the watchdog's list, received at `at`.
    pub fn on_processes(&mut self, at: Instant, list: &common::DataProcesses) {
        let row = |name: &str| list.processes.iter().find(|row| row.module == name);
        let runs = |name: &str| row(name).is_some_and(|row| row.phase == common::Process::RUNNING);
        // A watchdog that has just adopted a module lists it without a state until it announces itself, within a
        // second: until then its last known state counts.
        let is_first = self.deadlines.get(Timer::Watchdog).is_none_or(|deadline| deadline == Instant::ZERO);
        let worked = |place| !is_first && !self.critical_missing.contains(&place);
        // In PAUSE, sensor drivers go on measuring; in ERROR and STOP a module does not do the work on which motion
        // depends. Of itself this module knows the state earlier than the watchdog.
        let works = |place: usize| {
            let name = &self.critical[place];
            if name == NAME {
                return runs(name);
            }
            let state = row(name).map_or(common::DataState::STOP, |row| row.state);
            runs(name) && (WORKING.contains(&state) || state == common::DataState::UNKNOWN && worked(place))
        };
        let missing = (0..self.critical.len()).filter(|place| !works(*place)).collect();
        self.deadlines.set(Timer::Watchdog, at + WATCHDOG_TIMEOUT);
        self.restarted |= row(NAME).is_some_and(|row| row.restarts > 0);
        self.planning_missing.clear();
        self.planning_missing.extend((0..self.planning.len()).filter(|place| !runs(&self.planning[*place])));
        self.critical_missing = missing;
    }

    /// True if the watchdog has started this module again, or is not known yet to have started it only once.
    pub(super) fn is_restarted(&self) -> bool {
        self.restarted || self.is_watchdog_unheard()
    }

    fn is_watchdog_unheard(&self) -> bool {
        self.deadlines.get(Timer::Watchdog) == Some(Instant::ZERO)
    }

    /// Processes a state of the PAUSE line, received at `at` from that sender.
    pub fn on_stop(&mut self, at: Instant, from: Origin, stop: &lowlevel::EventStop) {
        self.pause.on_stop(at, from, stop);
    }

    /// The host found the watchdog of another robot on the message bus, or has not heard it for some time.
    pub fn on_second_robot(&mut self, active: bool) {
        self.second_robot = active;
    }

    /// Processes readings of the range finders, received at `at`.
    pub fn on_ranges(&mut self, at: Instant, ranges: &lowlevel::DataRanges) {
        self.ranging.on_ranges(at, ranges);
    }

    /// Processes an estimate, received at `at`; a lost one does not count.
    pub fn on_estimate(&mut self, at: Instant, estimate: &middlelevel::DataEstimate) {
        let known = estimate.quality >= middlelevel::DataEstimate::COARSE;
        self.deadlines.replace(Timer::Estimate, known.then_some(at + ESTIMATE_AGE_MAX));
    }

    /// Reasons of the PAUSE line that object to any motion at `now`, but for one that is open and latched.
    pub fn pauses(&self, now: Instant) -> impl Iterator<Item = Objection> + Clone + '_ {
        self.pause.reasons(now).filter(|paused| *paused != Paused::Latched).map(Objection::Paused)
    }

    /// All other objections to any motion at `now`, main one first.
    pub fn others(&self, now: Instant) -> impl Iterator<Item = Objection> + Clone + '_ {
        let latched = self.pause.reasons(now).filter(|paused| *paused == Paused::Latched).map(Objection::Paused);
        let unheard = self.is_watchdog_unheard();
        let silent = !unheard && self.deadlines.is_due(Timer::Watchdog, now);
        // An outdated list says nothing about the modules.
        let missing = if silent { &[][..] } else { &self.critical_missing };
        let missing = missing.iter().map(|place| Objection::Critical(*place));
        let watchdog = unheard.then_some(Objection::WatchdogUnheard).or(silent.then_some(Objection::WatchdogSilent));
        let ranging = self.ranging.lost(now).map(Objection::Ranging);
        let second_robot = self.second_robot.then_some(Objection::SecondRobot);
        // A line that is open and latched comes last: an operator's act ends it.
        watchdog.into_iter().chain(missing).chain(second_robot).chain(ranging).chain(latched)
    }

    /// Cause in `LL_DATA_HOLD` with its subject.
    #[must_use]
    pub fn hold(&self, objection: Objection) -> (Hold, &str) {
        match objection {
            Objection::Critical(place) => (Hold::CriticalModule, name(&self.critical, place)),
            Objection::WatchdogSilent | Objection::WatchdogUnheard => (Hold::WatchdogSilent, ""),
            Objection::Paused(paused) => self.pause.hold(paused),
            Objection::SecondRobot => (Hold::SecondRobot, ""),
            Objection::Ranging(place) => (Hold::RangingLost, self.ranging.name(place)),
        }
    }

    /// Further objections to motion by the planner: planner or estimator does not run, or there is no valid estimate.
    /// Each with its subject.
    pub fn objections_to_planner(&self, now: Instant) -> impl Iterator<Item = (Hold, &str)> + Clone + '_ {
        let missing = self.planning_missing.iter().map(|place| (Hold::PlannerModule, name(&self.planning, *place)));
        let located = self.deadlines.get(Timer::Estimate).is_some_and(|old| now < old);
        missing.chain((!located).then_some((Hold::PlannerNoEstimate, "")))
    }

    /// True if a module without which the planner must not drive does not run.
    #[must_use]
    pub fn is_planning_missing(&self) -> bool {
        !self.planning_missing.is_empty()
    }

    /// Next deadline after `now` at which missing data becomes an objection.
    #[must_use]
    pub fn poll_timeout(&self, now: Instant) -> Option<Instant> {
        earliest([self.deadlines.next_after(now), self.pause.poll_timeout(now), self.ranging.poll_timeout(now)])
    }
}

fn name(names: &[String], place: usize) -> &str {
    names.get(place).map_or("", String::as_str)
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::StopSource;

    impl Surroundings {
        fn objections(&self, now: Instant) -> impl Iterator<Item = Objection> + Clone + '_ {
            self.pauses(now).chain(self.others(now))
        }

        fn objection(&self, now: Instant) -> Option<Objection> {
            self.objections(now).next()
        }

        fn objection_to_planner(&self, now: Instant) -> Option<(Hold, &str)> {
            self.objections_to_planner(now).next()
        }
    }

    fn surroundings(critical: Vec<String>, planning: Vec<String>, has_pause_line: bool) -> Surroundings {
        Surroundings::new(critical, planning, has_pause_line, (&[], &[]), false, Ranging::new(&[], Duration::ZERO))
    }

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn processes(running: &[&str]) -> common::DataProcesses {
        let process = |name: &&str| common::Process {
            module: (*name).into(),
            phase: common::Process::RUNNING,
            state: common::DataState::RUN,
            ..common::Process::default()
        };
        common::DataProcesses { timestamp: 0, processes: running.iter().map(process).collect() }
    }

    #[test]
    fn a_critical_module_that_does_not_run_blocks_motion() {
        let mut around = surroundings(vec!["eyes".into()], vec![], false);
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
        let mut around = surroundings(vec![], vec![], true);
        assert_eq!(around.objection(at(0)), Some(Objection::Paused(Paused::Unknown)), "nothing was received yet");
        let open = lowlevel::EventStop { timestamp: 0, engaged: false, source: String::new() };
        around.on_stop(at(100), Origin::DUE, &open);
        assert_eq!(around.objection(at(1299)), None);
        assert_eq!(around.objection(at(1300)), Some(Objection::Paused(Paused::Unknown)));
        around.on_stop(at(1400), Origin::DUE, &lowlevel::EventStop { engaged: true, source: "button".into(), ..open });
        assert_eq!(around.objection(at(1400)), Some(Objection::Paused(Paused::Engaged(StopSource::Button))));
    }

    #[test]
    fn an_engaged_pause_line_counts_without_a_power_controller_too() {
        let mut around = surroundings(vec![], vec![], false);
        assert_eq!(around.objection(at(5000)), None);
        around.on_stop(
            at(5000),
            Origin::DUE,
            &lowlevel::EventStop { timestamp: 0, engaged: true, source: "bumper1".into() },
        );
        assert_eq!(around.objection(at(9000)), Some(Objection::Paused(Paused::Engaged(StopSource::Bumper1))));
        around.on_stop(
            at(9000),
            Origin::DUE,
            &lowlevel::EventStop { timestamp: 0, engaged: false, source: "bumper1".into() },
        );
        assert_eq!(around.objection(at(19_000)), Some(Objection::Paused(Paused::Latched)));
        around.pause.release();
        assert_eq!(around.objection(at(19_000)), None);
    }

    #[test]
    fn all_objections_are_listed_with_their_subjects() {
        let mut around = surroundings(vec!["eyes".into(), "nerves".into(), "ears".into()], vec![], true);
        around.on_processes(at(0), &processes(&["nerves"]));
        let told = |around: &Surroundings, now| {
            let told = around.objections(now).map(|objection| around.hold(objection));
            told.map(|(hold, subject)| (hold, subject.to_owned())).collect::<Vec<_>>()
        };
        let missing = |name: &str| (Hold::CriticalModule, name.to_owned());
        around.on_stop(
            at(0),
            Origin::DUE,
            &lowlevel::EventStop { timestamp: 0, engaged: true, source: "a rope".into() },
        );
        assert_eq!(
            told(&around, at(100)),
            [
                (Hold::PauseUnknown, String::new()),
                (Hold::PauseOther, "a rope".into()),
                missing("eyes"),
                missing("ears")
            ],
            "a source without a name in the contract keeps the one it gave"
        );
        around.on_stop(
            at(100),
            Origin::DUE,
            &lowlevel::EventStop { timestamp: 0, engaged: true, source: "bumper7".into() },
        );
        let silent = (Hold::WatchdogSilent, String::new());
        let rope = (Hold::PauseOther, "a rope".to_owned());
        assert_eq!(told(&around, at(300)), [(Hold::PauseBumper, "bumper7".into()), rope.clone(), silent.clone()]);
        assert_eq!(told(&around, at(1300)), [(Hold::PauseUnknown, String::new()), rope, silent]);
    }

    #[test]
    fn a_past_deadline_does_not_hide_a_future_one() {
        let mut around = surroundings(vec![], vec![], true);
        around.on_processes(at(0), &processes(&[]));
        around.on_stop(
            at(100),
            Origin::DUE,
            &lowlevel::EventStop { timestamp: 0, engaged: false, source: String::new() },
        );
        assert_eq!(around.poll_timeout(at(300)), Some(at(1300)));
    }

    #[test]
    fn a_lost_or_old_estimate_stops_the_planner() {
        let mut around = surroundings(vec![], vec![], false);
        let fine = middlelevel::DataEstimate { quality: middlelevel::DataEstimate::FINE, ..Default::default() };
        around.on_estimate(at(0), &fine);
        assert!(around.objection_to_planner(at(199)).is_none() && around.objection_to_planner(at(200)).is_some());
        assert_eq!(around.poll_timeout(at(0)), Some(at(200)));
        around.on_estimate(at(300), &middlelevel::DataEstimate { quality: middlelevel::DataEstimate::LOST, ..fine });
        assert_eq!(around.objection_to_planner(at(300)), Some((Hold::PlannerNoEstimate, "")));
    }

    #[test]
    fn a_module_that_the_planner_needs_blocks_only_the_planner() {
        let mut around = surroundings(vec![], vec!["map".into()], false);
        let fine = middlelevel::DataEstimate { quality: middlelevel::DataEstimate::FINE, ..Default::default() };
        around.on_estimate(at(0), &fine);
        assert_eq!(around.objection_to_planner(at(0)), None, "run by hand, without a watchdog");
        around.on_processes(at(0), &processes(&["eyes"]));
        assert_eq!(around.objection_to_planner(at(0)), Some((Hold::PlannerModule, "map")));
        assert_eq!(around.objection(at(0)), None);
        around.on_processes(at(100), &processes(&["map"]));
        assert_eq!(around.objection_to_planner(at(100)), None);
    }

    #[test]
    fn a_process_that_a_watchdog_started_waits_for_it() {
        let no_boards = Ranging::new(&[], Duration::ZERO);
        let mut around = Surroundings::new(vec![], vec![], false, (&[], &[]), true, no_boards);
        assert_eq!(around.objection(at(0)), Some(Objection::WatchdogUnheard));
        assert_eq!(around.objection(at(60_000)), Some(Objection::WatchdogUnheard));
        assert!(around.is_restarted(), "not known");
        around.on_processes(at(60_000), &processes(&[]));
        assert_eq!(around.objection(at(60_000)), None);
        assert!(!around.is_restarted());
        let restarts = |restarts| {
            let mut list = processes(&[NAME]);
            list.processes[0].restarts = restarts;
            list
        };
        around.on_processes(at(60_100), &restarts(0));
        assert!(!around.is_restarted());
        around.on_processes(at(60_200), &restarts(1));
        assert!(around.is_restarted());
    }

    #[test]
    fn a_critical_module_that_runs_and_does_not_work_blocks_motion() {
        let mut around = surroundings(vec!["eyes".into()], vec![], false);
        let mut list = processes(&["eyes"]);
        for (state, works) in [
            (common::DataState::RUN, true),
            (common::DataState::PAUSE, true),
            (common::DataState::ERROR, false),
            (common::DataState::STOP, false),
            (common::DataState::INIT, false),
            (common::DataState::UNKNOWN, false),
        ] {
            list.processes[0].state = state;
            around.on_processes(at(0), &list);
            assert_eq!(around.objection(at(0)).is_none(), works, "{state}");
        }
        let mut own = surroundings(vec![NAME.into()], vec![], false);
        let mut rows = processes(&[NAME]);
        rows.processes[0].state = common::DataState::INIT;
        own.on_processes(at(0), &rows);
        assert_eq!(own.objection(at(0)), None, "its state as the watchdog knew it before it began to run");
        rows.processes[0].phase = common::Process::TERMINATING;
        own.on_processes(at(0), &rows);
        assert_eq!(own.objection(at(0)), Some(Objection::Critical(0)));
        for state in [common::DataState::RUN, common::DataState::UNKNOWN] {
            list.processes[0].state = state;
            around.on_processes(at(0), &list);
            assert_eq!(around.objection(at(0)), None, "adopted by another watchdog: {state}");
        }
        let mut around = surroundings(vec!["eyes".into()], vec![], false);
        around.on_processes(at(0), &list);
        assert_eq!(around.objection(at(0)), Some(Objection::Critical(0)), "not known yet");
    }
}
