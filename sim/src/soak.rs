//! Robot-hours from a scenario and a seed: the whole robot, things that break, an operator, and rules that must hold.
//!
//! A soak is a row of episodes. Each is a robot that starts anew, with a seed that follows from the soak's and its own
//! number: so they can be run in any order, by anybody, and one of them can be repeated alone. In an episode chaos and
//! calm take turns; the faults are drawn before it begins ([`draw`]), so that some of them can be left out
//! ([`shrink`]).
//!
//! ```text
//! scenario, seed, number --draw--> faults --episode--> outcome --Report::add--> report
//! ```
//!
//! Knows no module by name: those are in the scenario and in [`Limits`]. Runs in one thread; reads no clock and no
//! file.

mod chaos;
mod figures;
mod operator;
mod report;
mod rivals;
mod scenario;
mod shrink;
#[cfg(test)]
mod tests;

pub use crate::check::{Limits, Times, Violation};
pub use chaos::{Disk, Fault, draw};
pub use figures::{Figures, Worst};
pub use report::Report;
pub use scenario::{Behaviour, Kind, Phase, Regression, Regressions, Scenario};
pub use shrink::shrink;

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

/// A steering that was reset is homed within this time, which does not count.
const HOMING: Duration = Duration::from_secs(30);
/// Faster than this it has moved, m/s.
const MOVES: f64 = 0.05;

/// What all episodes of a soak have in common.
#[derive(Clone, Copy, Debug)]
pub struct Stage<'a> {
    /// What happens.
    pub scenario: &'a Scenario,
    /// Where, for the operator's eyes.
    pub world: &'a World,
    /// The bounds of the rules.
    pub limits: &'a Limits,
    /// What all chance follows from.
    pub seed: u64,
    /// Where recorders write, one for each episode.
    pub disk: &'a Disk,
}

/// Makes the machine of an episode, on which nothing runs yet but what starts everything else is kept.
pub type Make<'a> = dyn FnMut(host::Config) -> Result<Virtual, String> + 'a;

/// How an episode went.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Of everything that was sent.
    pub digest: u64,
    /// How long it lasted: to its end, or to the first violation.
    pub time: Duration,
    /// How often each kind of fault befell somebody.
    pub faults: BTreeMap<String, u64>,
    /// What was measured.
    pub figures: Figures,
    /// The first rule that broke.
    pub violation: Option<Violation>,
}

/// Those who watch an episode.
struct Watch {
    checkers: Checkers,
    operator: Operator,
    meter: Meter,
    speed: f64,
    homed: bool,
    reason: String,
    /// A fault of the scenario that nobody knows.
    unknown: Option<String>,
}

impl Watch {
    fn observe(&mut self, now: Instant, news: &News<'_>) {
        self.checkers.observe(now, news);
        self.operator.observe(news);
        self.meter.observe(now, news);
        match news {
            News::Message { message: Message::SimDataTruth(truth), .. } => self.speed = truth.speed,
            News::Message { message: Message::LlDataMotion(motion), .. } => {
                self.homed = motion.homed;
                self.reason.clone_from(&motion.reason);
            }
            News::Report { report, .. } if report.fault == Code::FaultUnknown => {
                self.unknown = Some(report.message.clone());
            }
            _ => {}
        }
    }
}

/// How long the robot has had to move since calm began.
#[derive(Default)]
struct Moves {
    waited: Duration,
    homing: Duration,
    moved: bool,
}

/// Runs an episode with these faults; all that [`draw`] drew, or some of them.
///
/// # Errors
/// The machine cannot be made; one line why.
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
        checkers: Checkers::new(stage.limits.clone()),
        operator: Operator::new(scenario.operator, stage.world.clone(), seed),
        meter: Meter::new(stage.limits.clone()),
        speed: 0.0,
        homed: false,
        reason: String::new(),
        unknown: None,
    }));
    Ok(Episode::new(scenario, machine, watch).run(faults, stage.disk))
}

struct Episode<'a> {
    scenario: &'a Scenario,
    machine: Virtual,
    watch: Rc<RefCell<Watch>>,
    counts: BTreeMap<String, u64>,
    calm: Option<Moves>,
}

impl<'a> Episode<'a> {
    fn new(scenario: &'a Scenario, mut machine: Virtual, watch: Rc<RefCell<Watch>>) -> Self {
        let keep = watch.clone();
        machine.observe(move |now, news| keep.borrow_mut().observe(now, news));
        Self { scenario, machine, watch, counts: BTreeMap::new(), calm: None }
    }

    fn run(mut self, faults: &[Fault], disk: &Disk) -> Outcome {
        // A module that breaks an invariant of its own would end its process, live; here it ends the episode.
        let violation = match catch_unwind(AssertUnwindSafe(|| self.pass(faults, disk))) {
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
        Outcome {
            digest: self.machine.digest(),
            time: self.machine.now().since(Instant::ZERO),
            faults: self.counts,
            figures,
            violation,
        }
    }

    fn pass(&mut self, faults: &[Fault], disk: &Disk) -> Option<Violation> {
        let mut chaos = Chaos::new(faults, disk.clone());
        let mut acts = Ticker::new(Instant::ZERO + operator::PERIOD, operator::PERIOD);
        for (phase, end) in self.scenario.phases() {
            let end = Instant::ZERO + end;
            self.begin(phase);
            while self.machine.now() < end {
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
            if !calm.moved && watch.speed.abs() > MOVES && watch.reason.is_empty() {
                calm.moved = true;
                watch.meter.on_moved(calm.waited);
            }
            let time = if watch.homed { &mut calm.waited } else { &mut calm.homing };
            *time += operator::PERIOD;
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
        if let Some(Moves { waited, homing, moved: false }) = self.calm
            && (waited > self.scenario.moves_within || homing > HOMING)
        {
            let waited = (waited + homing).as_secs_f64();
            return own("moves", format!("it has not moved {waited:.1} s after the last fault: {:?}", watch.reason));
        }
        watch.checkers.violation().cloned()
    }
}
