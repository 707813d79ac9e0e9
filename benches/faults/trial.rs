//! One fault, from its injection until the module is back.

use super::canary::Canary;
use super::kind::Kind;
use super::rig::Rig;
use super::{RUN_MS, STOP_MS, table};
use crate::support;
use host::beats;
use robot::config::SIMULATOR;
use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Timeout.
const PATIENCE: Duration = Duration::from_secs(6);
/// Duration of a burden, and delay after which the operator stops the robot meanwhile.
const BURDEN: Duration = Duration::from_millis(2300);
const OBEY: Duration = Duration::from_millis(500);
/// Time after which the motion driver misses the watchdog, and stops.
const WATCHDOG_MISSED: Duration = Duration::from_millis(250);
/// Longest time between two heartbeats of the simulator (period 50 ms): hardware does not stall.
const HARDWARE_PAUSE: Duration = Duration::from_millis(150);
/// Longest pause of the operator, which is this bench: a command is valid for 250 ms.
const OWN_PAUSE: Duration = Duration::from_millis(100);

/// Outcome of a fault.
#[derive(Debug)]
pub struct Outcome {
    pub module: String,
    pub kind: Kind,
    pub critical: bool,
    /// Time from the fault, or from the first missed heartbeat if a hang has no exact instant, or from the operator's
    /// command.
    pub stop: Option<Duration>,
    pub run: Option<Duration>,
    /// Time from the fault to standstill of a robot that had to stop, and that of the table "What stops the robot".
    pub stands: Option<Duration>,
    pub table: Option<Duration>,
    pub ending: Ending,
}

/// Ending of a fault.
#[derive(Debug, PartialEq)]
pub enum Ending {
    /// The module is in RUN: again, or all the time under a burden.
    Back,
    /// The module is not in RUN.
    Never,
    /// No figure, for this reason.
    Void(Void),
}

/// Reason why a trial has no figure, with the length of the pause.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Void {
    /// A processor ran nothing of this bench.
    Machine(Duration),
    /// The operator, which is this bench, did not command.
    Operator(Duration),
    /// The simulator, which plays the hardware, was another process afterwards.
    HardwareRestarted,
    /// The simulator did not run.
    Hardware(Duration),
}

impl Void {
    /// Words for people, and the pause.
    pub fn told(self) -> (&'static str, Duration) {
        match self {
            Self::Machine(pause) => ("the machine stood still for 40 ms or more", pause),
            Self::Operator(pause) => ("the operator did not command for 100 ms or more", pause),
            Self::HardwareRestarted => ("the simulator was started again", Duration::ZERO),
            Self::Hardware(pause) => ("the simulator stood still for 150 ms or more", pause),
        }
    }
}

impl Outcome {
    /// True for an undetected hang, or a robot out of control.
    pub fn is_missed(&self) -> bool {
        // A watchdog that is back before it is missed need not cause a stop.
        let unmissed = self.module == watchdog::NAME && self.run.is_some_and(|took| took < WATCHDOG_MISSED);
        let stop_owed = (self.critical && !unmissed) || self.kind.is_burden();
        self.ending == Ending::Never || (self.ending == Ending::Back && stop_owed && self.stop.is_none())
    }
}

impl Outcome {
    /// Immediate report for people: a miss, or a time beyond its bound.
    pub fn objection(&self) -> Option<&'static str> {
        let beyond = |took: Option<Duration>, bound: f64| took.is_some_and(|took| took.as_secs_f64() * 1e3 > bound);
        match self {
            _ if self.ending.is_void() => None,
            _ if self.is_missed() => Some("missed"),
            _ if self.stands > self.table && self.table.is_some() => Some("stands late"),
            _ if beyond(self.stop, STOP_MS) => Some("late stop"),
            _ if beyond(self.run, RUN_MS) => Some("late RUN"),
            _ => None,
        }
    }
}

/// Last sign of life of a process: its heartbeat, or its existence if it has none.
struct Vital {
    page: Option<PathBuf>,
    pid: i32,
    count: Option<[u8; 4]>,
    last: Instant,
    /// Longest time between two.
    pause: Duration,
    /// Last time at which a thread of the process was there.
    alive: Instant,
}

impl Vital {
    fn new(rig: &Rig, module: &str, pid: i32, now: Instant) -> Self {
        let page = beats::folder(&rig.run_dir).ok().map(|folder| folder.join(module)).filter(|page| page.exists());
        Self { page, pid, count: None, last: now, pause: Duration::ZERO, alive: now }
    }

    fn look(&mut self) {
        let now = Instant::now();
        if self.lives() {
            self.alive = now;
        }
        let Some(page) = &self.page else {
            self.last = self.alive;
            return;
        };
        let bytes = fs::read(page).unwrap_or_default();
        // docs/beats.md: process id, and heartbeat count of its first thread.
        let (Some(pid), Some(count)) = (bytes.get(8..12), bytes.get(112..116)) else { return };
        if pid == self.pid.to_le_bytes() && self.count.is_none_or(|last| last != count) {
            self.count = count.try_into().ok();
            self.pause = self.pause.max(now - self.last);
            self.last = now;
        }
    }
}

impl Vital {
    /// False once all threads have ended, and what they held is free. A first thread that has ended waits for the rest.
    fn lives(&self) -> bool {
        let process = PathBuf::from(format!("/proc/{}", self.pid));
        let stat = fs::read_to_string(process.join("stat")).unwrap_or_default();
        let runs = stat.rsplit(") ").next().is_some_and(|rest| !rest.is_empty() && !rest.starts_with('Z'));
        runs || fs::read_dir(process.join("task")).is_ok_and(|threads| threads.count() > 1)
    }

    /// Instant of the first missed heartbeat.
    fn missed(&self) -> Instant {
        let period = if self.page.is_some() { beats::PERIOD } else { Duration::ZERO };
        self.last + period
    }
}

impl Ending {
    /// True if the result is void and the fault must be repeated.
    pub fn is_void(&self) -> bool {
        matches!(self, Self::Void(_))
    }
}

/// Harms a module of a driving robot; `None` if it stopped by itself before, or has no such process.
pub fn run(
    rig: &mut Rig,
    module: &str,
    kind: Kind,
    critical: bool,
    phase: Duration,
    canary: &Canary,
) -> Option<Outcome> {
    rig.pass(phase);
    let pid = rig.pid(module).filter(|_| rig.drives() && rig.all_run())?;
    let hardware = rig.process(SIMULATOR)?;
    let fault = rig.mark();
    let mut simulator = Vital::new(rig, SIMULATOR, hardware, fault);
    kind.inject(pid);
    let mut outcome = Outcome {
        module: module.into(),
        kind,
        critical,
        stop: None,
        run: None,
        stands: None,
        table: None,
        ending: Ending::Never,
    };
    if kind.is_burden() {
        burden(rig, fault, pid, &mut simulator, &mut outcome);
    } else {
        hang(rig, fault, pid, &mut simulator, &mut outcome);
    }
    if outcome.ending == Ending::Never && rig.pid(module) == Some(pid) {
        // No other process does.
        support::signal(pid, "KILL");
    }
    let machine = canary.stalled(fault, Instant::now()).map(Void::Machine);
    let operator = Some(rig.slowest).filter(|pause| *pause >= OWN_PAUSE).map(Void::Operator);
    let restarted = (rig.process(SIMULATOR) != Some(hardware)).then_some(Void::HardwareRestarted);
    let stalled = Some(simulator.pause).filter(|pause| *pause >= HARDWARE_PAUSE).map(Void::Hardware);
    if let Some(why) = machine.or(operator).or(restarted).or(stalled) {
        outcome.ending = Ending::Void(why);
    }
    Some(outcome)
}

fn hang(rig: &mut Rig, fault: Instant, pid: i32, simulator: &mut Vital, outcome: &mut Outcome) {
    let mut vital = Vital::new(rig, &outcome.module, pid, fault);
    let mut back = None;
    while fault.elapsed() < PATIENCE {
        rig.turn();
        simulator.look();
        if outcome.kind == Kind::Memory {
            vital.look();
        }
        if rig.stop.is_some() {
            rig.drive(false);
        }
        if back.is_none() && rig.is_back(&outcome.module, pid) {
            back = Some(Instant::now());
        }
        // A watchdog that is back before it is missed causes no stop.
        let owed = |at: Instant| outcome.critical && (rig.stop.is_some() || at.elapsed() < WATCHDOG_MISSED);
        if back.is_some_and(|at| rig.stood.is_some() || !owed(at)) {
            break;
        }
    }
    let since = if outcome.kind == Kind::Memory { vital.missed() } else { fault };
    outcome.run = back.map(|at| at.saturating_duration_since(since));
    if outcome.critical {
        outcome.stop = rig.stop.map(|at| at.saturating_duration_since(since));
        // A stop for which nobody missed the watchdog has another cause, such as a late message of the guard, to which
        // the robot brakes slower.
        let required = outcome.module != watchdog::NAME || back.is_none() || rig.missed_watchdog;
        if rig.stop.is_some() && required {
            let dying = vital.alive.saturating_duration_since(since);
            outcome.stands = rig.stood.map(|at| at.saturating_duration_since(since)).or(Some(PATIENCE));
            outcome.table = rig.reference.then(|| table::stands_after(&outcome.module, outcome.kind, dying));
        }
    }
    if back.is_some() {
        outcome.ending = Ending::Back;
    }
}

fn burden(rig: &mut Rig, fault: Instant, pid: i32, simulator: &mut Vital, outcome: &mut Outcome) {
    let mut vital = Vital::new(rig, &outcome.module, pid, fault);
    let (mut told, mut back) = (None, None);
    while fault.elapsed() < BURDEN
        || (back.is_none() && rig.pid(&outcome.module) != Some(pid) && fault.elapsed() < PATIENCE)
    {
        rig.turn();
        simulator.look();
        vital.look();
        if told.is_none() && fault.elapsed() >= OBEY {
            // If it has already stopped, the operator need not command it.
            told = Some(rig.stop.is_none().then(Instant::now));
            rig.drive(false);
        }
        if back.is_none() && rig.is_back(&outcome.module, pid) {
            back = Some(Instant::now());
        }
    }
    outcome.run = back.map(|at| at.saturating_duration_since(vital.missed()));
    let since = told.flatten().unwrap_or(vital.missed());
    outcome.stop = rig.stop.map(|at| at.saturating_duration_since(since));
    if back.is_some() || (rig.pid(&outcome.module) == Some(pid) && rig.all_run()) {
        outcome.ending = Ending::Back;
    }
}
