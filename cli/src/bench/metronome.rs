//! How late our loop wakes up: a module that does nothing but look at the clock, in the host that runs all modules.

use super::histogram::Histogram;
use super::report::{Report, Row, kernel};
use crate::Failed;
use base::{Duration, Instant};
use host::{self, HostConfig};
use module::{Action, Actions, Event, Module, Shell, ShellConfig, State, exit};
use nix::sys::resource::{UsageWho, getrusage};
use std::cell::RefCell;
use std::rc::Rc;

/// Latencies of this length and more are counted together, µs.
const LIMIT: usize = 100_000;
/// The first moment waited for, after the start: what happens once has happened by then.
const SETTLE: Duration = Duration::from_millis(100);

/// Parameters of a measurement.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// From one moment to the next.
    pub interval: Duration,
    /// `SCHED_FIFO`; none: the normal scheduler.
    pub priority: Option<u8>,
    /// Duration; `None`: until it is ended.
    pub time: Option<Duration>,
}

/// Result so far.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Latency from the requested instant to the event of the module.
    pub late: Histogram,
    /// Number of instants that passed before their turn.
    pub missed: u64,
    /// Page faults of its thread between the first moment and the last.
    pub faults: u64,
}

/// The module.
pub struct Metronome {
    plan: Plan,
    next: Option<Instant>,
    until: Instant,
    faults: Option<u64>,
    measured: Rc<RefCell<Measured>>,
}

impl Metronome {
    /// A module, and what it measures.
    pub fn new(plan: Plan) -> (Self, Rc<RefCell<Measured>>) {
        let measured = Measured { late: Histogram::new(LIMIT), missed: 0, faults: 0 };
        let measured = Rc::new(RefCell::new(measured));
        (Self { plan, next: None, until: Instant::NEVER, faults: None, measured: measured.clone() }, measured)
    }

    fn tick(&mut self, now: Instant, due: Instant) {
        let mut measured = self.measured.borrow_mut();
        // Cut off, not rounded: as cyclictest does.
        measured.late.add((now.since(due).as_nanos() / 1000) as u64);
        let mut next = due + self.plan.interval;
        while next <= now {
            measured.missed += 1;
            next += self.plan.interval;
        }
        self.next = Some(next);
        if self.faults.is_none() {
            self.faults = Some(page_faults());
        }
    }

    fn end(&mut self) {
        self.next = None;
        if let Some(before) = self.faults {
            self.measured.borrow_mut().faults = page_faults() - before;
        }
    }
}

impl Module for Metronome {
    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                out.working();
                self.next = Some(now + SETTLE);
                self.until = self.plan.time.map_or(Instant::NEVER, |time| now + SETTLE + time);
            }
            Event::Timer => match self.next {
                Some(due) if due <= now => {
                    self.tick(now, due);
                    if now >= self.until {
                        self.end();
                        out.push(Action::Exit(exit::OK));
                    }
                }
                _ => {}
            },
            Event::State(State::Terminate) => self.end(),
            _ => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.next
    }
}

fn page_faults() -> u64 {
    getrusage(UsageWho::RUSAGE_THREAD).map_or(0, |usage| (usage.minor_page_faults() + usage.major_page_faults()) as u64)
}

/// Bus of the measurement: within this process, since a module on the robot's bus would be one of the robot's.
const BUS: &str = "memq://";

/// Measures until the time is over, or until Ctrl-C, in the host that runs the robot's modules.
pub fn measure(plan: Plan) -> Result<Report, Failed> {
    let (module, measured) = Metronome::new(plan);
    let shell = Shell::new(ShellConfig::new("jitter"), Box::new(module));
    let host = HostConfig {
        lcm_url: BUS.into(),
        ports: Vec::new(),
        raw: Vec::new(),
        policy: module::admission::Policy::default(),
        launch: None,
        beats: None,
        inputs: None,
    };
    host::run(shell, host).map_err(|failure| failure.why)?;
    let Measured { late, missed, faults } = measured.borrow().clone();
    let scheduler = plan.priority.map_or("normal scheduler".into(), |priority| format!("SCHED_FIFO {priority}"));
    Ok(Report {
        how: format!("the live host's loop, {scheduler}, kernel {}", kernel()),
        times: "wake-up",
        rows: vec![Row {
            name: "late by".into(),
            period_us: Some(plan.interval.as_micros() as u64),
            times: late,
            counts: vec![("missed", missed), ("page faults", faults)],
        }],
    })
}
