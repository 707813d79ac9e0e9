//! Robot-hours from a scenario and a seed: the whole robot, injected faults, an operator, and rules that must hold.
//!
//! A soak is a sequence of episodes. Each one starts a robot with a seed derived from the soak's seed and its own
//! number, so episodes can be run in any order and repeated alone. In an episode chaos and calm alternate; the faults
//! are drawn in advance ([`draw`]), so that some of them can be omitted ([`shrink`]).
//!
//! ```text
//! scenario, seed, number --draw--> faults --episode--> outcome --Report::add--> report
//! ```
//!
//! Independent of module names, which are in the scenario and in [`Limits`]. Runs in one thread; reads no clock and no
//! file.

mod chaos;
mod figures;
mod operator;
mod report;
mod rivals;
mod scenario;
mod shrink;
mod tally;
#[cfg(test)]
mod tests;

pub use crate::check::{Limits, Times, Violation};
pub use chaos::{Disk, Fault, draw};
pub use figures::{Figures, Worst};
pub use report::Report;
pub use scenario::{Behaviour, Kind, Phase, Regression, Regressions, Scenario};
pub use shrink::shrink;
pub use tally::{Contacts, Goals, Shares, Touches};

use crate::check::Checkers;
use crate::host::{self, News, Virtual};
use base::{Duration, Fault as Code, Instant, Ticker};
use chaos::Chaos;
use figures::Meter;
use messages::Message;
use operator::Operator;
use simulator::Random;
use simulator::world::World;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Maximum time for homing a steering that was reset, which is not counted.
const HOMING_MAX: Duration = Duration::from_secs(30);
/// Maximum time for which the guard lets the robot move neither way, which is not counted either: visitors move on.
const ENCLOSED_MAX: Duration = Duration::from_secs(50);
/// Distance to somebody, or to a wall, m, within which the time in which the guard lets it move neither way has no
/// limit: a visitor who cannot get past stands there for up to 90 s, before it and behind it.
const ENCLOSED_M: f64 = 0.3;
/// Speed above which the robot counts as moving, m/s.
const MOVING_MPS: f64 = 0.05;

/// Common data of all episodes of a soak.
#[derive(Clone, Copy, Debug)]
pub struct Stage<'a> {
    /// Scenario.
    pub scenario: &'a Scenario,
    /// World in which the operator sees.
    pub world: &'a World,
    /// Bounds of the rules.
    pub limits: &'a Limits,
    /// Seed of all randomness.
    pub seed: u64,
    /// Disk of the recorders, one for each episode.
    pub disk: &'a Disk,
    /// Set to end the episode before its time.
    pub stop: &'a AtomicBool,
}

/// Creates the machine of an episode, on which only the supervised root process runs.
pub type Make<'a> = dyn FnMut(host::Config) -> Result<Virtual, String> + 'a;

/// Result of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Digest of everything sent.
    pub digest: u64,
    /// Duration, to its end or to the first violation.
    pub time: Duration,
    /// Number of injected faults of each kind.
    pub faults: BTreeMap<String, u64>,
    /// Measured figures.
    pub figures: Figures,
    /// First violation of a rule.
    pub violation: Option<Violation>,
    /// False for an episode that was ended before its time ([`Stage::stop`]): it proves nothing.
    pub complete: bool,
}

/// Observers of an episode.
struct Watch {
    checkers: Checkers,
    operator: Operator,
    meter: Meter,
    /// Distance to the nearest obstacle, m.
    clearance: f64,
    homed: bool,
    /// The guard lets the robot move forward or backward.
    free: bool,
    reason: String,
    /// An unknown fault of the scenario.
    unknown: Option<String>,
}

impl Watch {
    fn observe(&mut self, now: Instant, news: &News<'_>) {
        self.checkers.observe(now, news);
        self.operator.observe(news);
        self.meter.observe(now, news);
        match news {
            News::Message { message: Message::SimDataTruth(truth), .. } => self.clearance = truth.clearance,
            News::Message { message: Message::LlDataGuard(guard), .. } => {
                self.free = guard.forward.max(guard.backward) > MOVING_MPS;
            }
            News::Message { message: Message::LlDataMotion(motion), .. } => {
                self.homed = motion.homed;
                self.reason.clone_from(&motion.reason);
            }
            // Somebody stands where the operator would push the robot.
            News::Report { report, .. } if report.subject.contains(operator::PUSHES) => {}
            News::Report { report, .. } if report.fault == Code::FaultUnknown => {
                self.unknown = Some(report.message.clone());
            }
            _ => {}
        }
    }
}

/// Time that the robot has had to move since calm began.
#[derive(Default)]
struct Moves {
    waited: Duration,
    homing: Duration,
    /// Somebody stands before it and somebody, or a wall, behind it.
    enclosed: Duration,
    moved: bool,
}

/// Runs an episode with these faults; all that [`draw`] drew, or some of them.
///
/// # Errors
/// The machine cannot be created; reason in one line.
pub fn episode(stage: &Stage<'_>, number: u64, faults: &[Fault], make: &mut Make<'_>) -> Result<Outcome, String> {
    let scenario = stage.scenario;
    let seed = Random::stream(stage.seed, number).bits();
    let config = host::Config {
        seed,
        lcm_jitter: scenario.lcm_jitter,
        lcm_loss: scenario.lcm_loss,
        restart_delay_max: scenario.restart_delay_max,
        ..host::Config::default()
    };
    let machine = make(config)?;
    let watch = Rc::new(RefCell::new(Watch {
        checkers: Checkers::new(stage.limits.clone()).in_world(stage.world),
        operator: Operator::new(&scenario.operator, stage.limits, stage.world, seed),
        meter: Meter::new(stage.limits.clone()),
        clearance: f64::INFINITY,
        homed: false,
        free: true,
        reason: String::new(),
        unknown: None,
    }));
    Ok(Episode::new(stage, machine, watch).run(faults))
}

struct Episode<'a> {
    scenario: &'a Scenario,
    limits: &'a Limits,
    disk: &'a Disk,
    stop: &'a AtomicBool,
    machine: Virtual,
    watch: Rc<RefCell<Watch>>,
    counts: BTreeMap<String, u64>,
    calm: Option<Moves>,
}

impl<'a> Episode<'a> {
    fn new(stage: &Stage<'a>, mut machine: Virtual, watch: Rc<RefCell<Watch>>) -> Self {
        // Processes that already run were started before the observation began.
        for (pid, module) in machine.processes() {
            watch.borrow_mut().observe(machine.now(), &News::Started { module, pid });
        }
        let keep = watch.clone();
        machine.observe(move |now, news| keep.borrow_mut().observe(now, news));
        let &Stage { scenario, limits, disk, stop, .. } = stage;
        Self { scenario, limits, disk, stop, machine, watch, counts: BTreeMap::new(), calm: None }
    }

    fn run(mut self, faults: &[Fault]) -> Outcome {
        // A module that violates its own invariant would end its process in the live host; here it ends the episode.
        let violation = match catch_unwind(AssertUnwindSafe(|| self.pass(faults))) {
            Ok(violation) => violation,
            Err(panic) => {
                let text = panic.downcast_ref::<String>().map(String::as_str);
                let what = text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("for no reason").into();
                Some(Violation { at: self.machine.now(), rule: "panic", what })
            }
        };
        // After a panic in an observer its borrow has ended with it.
        let watch = self.watch.borrow();
        let mut figures = watch.meter.figures.clone();
        figures.goals = watch.operator.goals();
        figures.worst.rules = watch.checkers.times();
        let (seen, hidden) = watch.checkers.hits();
        (figures.touched.in_sight, figures.touched.out_of_hiding) = (seen.into(), hidden.into());
        Outcome {
            digest: self.machine.digest(),
            time: self.machine.now().since(Instant::ZERO),
            faults: self.counts,
            figures,
            complete: violation.is_some() || !self.stop.load(Ordering::Relaxed),
            violation,
        }
    }

    fn pass(&mut self, faults: &[Fault]) -> Option<Violation> {
        let mut chaos = Chaos::new(faults, self.disk.clone(), self.limits);
        let mut acts = Ticker::new(Instant::ZERO + operator::PERIOD, operator::PERIOD);
        for (phase, end) in self.scenario.phases() {
            let end = Instant::ZERO + end;
            self.begin(phase);
            while self.machine.now() < end {
                if self.stop.load(Ordering::Relaxed) {
                    return None;
                }
                let next = chaos.poll_timeout().unwrap_or(Instant::NEVER).min(acts.next()).min(end);
                self.machine.run_until(next);
                let counts = &mut self.counts;
                chaos.handle_timeout(&mut self.machine, |fault| *counts.entry(fault.kind.clone()).or_default() += 1);
                if acts.due(next) {
                    self.act(next);
                }
                if let Some(violation) = self.violation() {
                    return Some(violation);
                }
            }
        }
        None
    }

    fn begin(&mut self, phase: Phase) {
        let now = self.machine.now();
        let mut watch = self.watch.borrow_mut();
        watch.meter.calm = (phase == Phase::Calm).then_some(now);
        match phase {
            Phase::Settle => {}
            Phase::Chaos => watch.checkers.chaos(),
            Phase::Calm => watch.checkers.calm(now),
        }
        self.calm = (phase == Phase::Calm).then(Moves::default);
    }

    fn act(&mut self, now: Instant) {
        let mut says = Vec::new();
        let mut watch = self.watch.borrow_mut();
        watch.operator.act(now, |message| says.push(message));
        if let Some(calm) = &mut self.calm {
            if !calm.moved && watch.checkers.speed().abs() > MOVING_MPS && watch.reason.is_empty() {
                calm.moved = true;
                watch.meter.on_moved(calm.waited);
            }
            match (watch.homed, watch.free) {
                (false, _) => calm.homing += operator::PERIOD,
                (true, true) => calm.waited += operator::PERIOD,
                (true, false) if watch.clearance < ENCLOSED_M => {}
                (true, false) => calm.enclosed += operator::PERIOD,
            }
        }
        drop(watch);
        for message in says {
            self.machine.inject(now, message);
        }
    }

    fn violation(&self) -> Option<Violation> {
        let watch = self.watch.borrow();
        let own = |rule, what| Some(Violation { at: self.machine.now(), rule, what });
        if let Some(why) = &watch.unknown {
            return own("scenario", why.clone());
        }
        if let Some(Moves { waited, homing, enclosed, moved: false }) = self.calm
            && (waited > self.scenario.moves_within || homing > HOMING_MAX || enclosed > ENCLOSED_MAX)
        {
            let waited = (waited + homing + enclosed).as_secs_f64();
            let (reason, operator) = (&watch.reason, &watch.operator);
            let what =
                format!("it has not moved {waited:.1} s after the last fault: {reason:?}; the operator {operator}");
            return own("moves", what);
        }
        watch.checkers.violation().cloned()
    }
}
