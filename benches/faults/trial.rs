//! One fault, from its injection until the module is back.

use super::canary::{Canary, STALL};
use super::kind::Kind;
use super::rig::Rig;
use super::{RUN_MS, STOP_MS};
use crate::support;
use host::beats;
use robot::config::SIMULATOR;
use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What has not happened by then does not.
const PATIENCE: Duration = Duration::from_secs(6);
/// A burden lasts for 2 s; meanwhile the operator stops the robot.
const BURDEN: Duration = Duration::from_millis(2300);
const OBEY: Duration = Duration::from_millis(500);
/// Whoever moves the robot misses the watchdog after this time, and stops.
const WATCHDOG_MISSED: Duration = Duration::from_millis(250);
/// Between two beats of the simulator, which come every 50 ms: hardware does not stand still.
const HARDWARE_PAUSE: Duration = Duration::from_millis(150);
/// The operator, who is this bench, must not pause as long himself: a command lives for 250 ms.
const OWN_PAUSE: Duration = Duration::from_millis(100);

/// What came of a fault.
#[derive(Debug)]
pub struct Outcome {
    pub module: String,
    pub kind: Kind,
    pub critical: bool,
    /// From the fault, or where it has no instant of hanging from the first missed beat, or the operator's word, on.
    pub stop: Option<Duration>,
    pub run: Option<Duration>,
    pub ending: Ending,
}

/// How it ended.
#[derive(Debug, PartialEq)]
pub enum Ending {
    /// The module is in RUN: again, or all the time under a burden.
    Back,
    /// It is not.
    Never,
    /// The machine stood still for this long meanwhile: no figure.
    Stalled(Duration),
    /// The simulator, which plays the hardware, was not there all the time, or stood still: no figure.
    NoHardware,
}

impl Outcome {
    /// A hang unseen, or a robot out of control.
    pub fn is_missed(&self) -> bool {
        // A watchdog that is back before it is missed need stop nobody.
        let unmissed = self.module == watchdog::NAME && self.run.is_some_and(|took| took < WATCHDOG_MISSED);
        let stop_owed = (self.critical && !unmissed) || self.kind.is_burden();
        self.ending == Ending::Never || (self.ending == Ending::Back && stop_owed && self.stop.is_none())
    }
}

impl Outcome {
    /// What to tell people of at once: a miss, or a time beyond its bound.
    pub fn objection(&self) -> Option<&'static str> {
        let beyond = |took: Option<Duration>, bound: f64| took.is_some_and(|took| took.as_secs_f64() * 1e3 > bound);
        match self {
            _ if self.ending.is_void() => None,
            _ if self.is_missed() => Some("missed"),
            _ if beyond(self.stop, STOP_MS) => Some("late stop"),
            _ if beyond(self.run, RUN_MS) => Some("late RUN"),
            _ => None,
        }
    }
}

/// The last sign of life of a process: its beats, or where it has none that it is there.
struct Vital {
    page: Option<PathBuf>,
    pid: i32,
    count: Option<[u8; 4]>,
    last: Instant,
    /// The longest time between two.
    pause: Duration,
}

impl Vital {
    fn new(rig: &Rig, module: &str, pid: i32, now: Instant) -> Self {
        let page = beats::folder(&rig.run_dir).ok().map(|folder| folder.join(module)).filter(|page| page.exists());
        Self { page, pid, count: None, last: now, pause: Duration::ZERO }
    }

    fn look(&mut self) {
        let now = Instant::now();
        let Some(page) = &self.page else {
            let stat = fs::read_to_string(format!("/proc/{}/stat", self.pid)).unwrap_or_default();
            if stat.rsplit(") ").next().is_some_and(|rest| !rest.is_empty() && !rest.starts_with('Z')) {
                self.last = now;
            }
            return;
        };
        let bytes = fs::read(page).unwrap_or_default();
        // docs/beats.md: whose it is, and the count of its first thread.
        let (Some(pid), Some(count)) = (bytes.get(8..12), bytes.get(112..116)) else { return };
        if pid == self.pid.to_le_bytes() && self.count.is_none_or(|last| last != count) {
            self.count = count.try_into().ok();
            self.pause = self.pause.max(now - self.last);
            self.last = now;
        }
    }
}

impl Vital {
    /// When the first beat was missed.
    fn missed(&self) -> Instant {
        let period = if self.page.is_some() { beats::PERIOD } else { Duration::ZERO };
        self.last + period
    }
}

impl Ending {
    /// Whether it says nothing, and is to be tried again.
    pub fn is_void(&self) -> bool {
        matches!(self, Self::Stalled(_) | Self::NoHardware)
    }
}

/// Harms a module of a robot that drives; none when it stopped by itself before, or has no such process.
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
    let mut outcome = Outcome { module: module.into(), kind, critical, stop: None, run: None, ending: Ending::Never };
    if kind.is_burden() {
        burden(rig, fault, pid, &mut simulator, &mut outcome);
    } else {
        hang(rig, fault, pid, &mut simulator, &mut outcome);
    }
    if outcome.ending == Ending::Never && rig.pid(module) == Some(pid) {
        // Nobody else does.
        support::signal(pid, "KILL");
    }
    if let Some(stall) = canary.stalled(fault, Instant::now()).or(Some(rig.slowest).filter(|pause| *pause >= OWN_PAUSE))
    {
        outcome.ending = Ending::Stalled(stall.max(STALL));
    } else if rig.process(SIMULATOR) != Some(hardware) || simulator.pause >= HARDWARE_PAUSE {
        outcome.ending = Ending::NoHardware;
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
        if back.is_some_and(|at| rig.stop.is_some() || !outcome.critical || at.elapsed() >= WATCHDOG_MISSED) {
            break;
        }
    }
    let since = if outcome.kind == Kind::Memory { vital.missed() } else { fault };
    outcome.run = back.map(|at| at.saturating_duration_since(since));
    if outcome.critical {
        outcome.stop = rig.stop.map(|at| at.saturating_duration_since(since));
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
            // Where it has stopped already the operator has nothing to add.
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
