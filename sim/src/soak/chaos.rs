//! Faults: drawn from the seed before an episode begins, then injected into the machine at their times.

use super::rivals;
use super::scenario::{Phase, Scenario};
use crate::check::Limits;
use crate::host::Virtual;
use base::{Duration, Instant};
use messages::{common, simulation};
use module::State;
use settings::settings;
use simulator::Random;
use std::cell::Cell;
use std::fmt;
use std::rc::Rc;

/// Target of the fault `full`.
const DISK: &str = "disk";
/// Target of a step of the wall clock, by `value` s.
const CLOCK: &str = "clock";
/// Source of the chaos's state commands, distinct from the operator.
const SOURCE: &str = "chaos";

settings! {
    /// A fault. Its instant and its numbers are complete: removing another fault does not change it.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Fault {
        /// Instant.
        at_s as at: Duration = required, 0.0..=86_400.0;
        /// The name of its [kind](super::Kind).
        kind: String = "regression";
        /// Target.
        target: String = required;
        /// What happens. To a module: `kill`; `hang`; `crawl`, served `value` s late; `pause`, `stop`, `terminate`, a
        /// person's command, and `run`, one that is nobody's. To the `clock`: `step`. To the `disk`: `full`. Of others
        /// who command the robot: `drive`, `plan`, `plan_unasked`, `plan_blind`, `engage`, and those with `foreign_`
        /// (see `rivals`). The rest by the names of `SIM_CMD_FAULT`.
        fault: String = required;
        /// Value.
        value: f64 = 0.0, -1e9..=1e9;
        /// Duration, s; 0: momentary.
        lasts_s as lasts: f64 = 0.0, 0.0..=86_400.0;
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:10.6} s  {} {}", self.at.as_secs_f64(), self.target, self.fault)?;
        if self.value != 0.0 {
            write!(f, " {:.6}", self.value)?;
        }
        if self.lasts > 0.0 {
            write!(f, " for {:.6} s", self.lasts)?;
        }
        Ok(())
    }
}

/// Faults of an episode in order of time. Each kind has its own random stream: the rate of one does not affect the
/// others.
#[must_use]
pub fn draw(scenario: &Scenario, seed: u64, episode: u64) -> Vec<Fault> {
    let mut faults = Vec::new();
    for kind in &scenario.kinds {
        let name = kind
            .name
            .bytes()
            .fold(0xCBF2_9CE4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3));
        let mut random = Random::stream(Random::stream(seed, episode).bits(), name);
        let mut begin = Duration::ZERO;
        for (phase, end) in scenario.phases() {
            if phase == Phase::Chaos {
                let mut at = begin;
                loop {
                    // Exponentially distributed gaps: equally likely at any time.
                    let gap = -libm::log(1.0 - random.uniform()) * 3600.0 / kind.per_hour.max(1e-9);
                    at += Duration::from_nanos((gap * 1e9) as u64);
                    if at >= end {
                        break;
                    }
                    faults.push(fault(kind, at, end, &mut random));
                }
            }
            begin = end;
        }
    }
    // Equal times are in the order of the kinds.
    faults.sort_by_key(|fault| fault.at);
    faults
}

fn fault(kind: &super::Kind, at: Duration, end: Duration, random: &mut Random) -> Fault {
    let target = (random.bits() % kind.targets.len().max(1) as u64) as usize;
    let value = between(kind.value, random);
    let lasts = between(kind.lasts, random).min((end - at).as_secs_f64());
    Fault {
        at,
        kind: kind.name.clone(),
        target: kind.targets.get(target).cloned().unwrap_or_default(),
        fault: kind.fault.clone(),
        value,
        lasts,
    }
}

fn between((least, most): (f64, f64), random: &mut Random) -> f64 {
    least + (most - least) * random.uniform()
}

/// Pending end of a fault.
#[derive(Debug)]
enum Undo {
    Resume(u32),
    Uncrawl(u32),
    Free,
}

/// Disk of an episode, shared with its writer: the number of faults that keep it full.
#[derive(Clone, Debug, Default)]
pub struct Disk(Rc<Cell<u32>>);

impl Disk {
    /// True if the disk is currently full.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.0.get() > 0
    }
}

/// Injector of faults.
#[derive(Debug)]
pub(super) struct Chaos<'a> {
    faults: std::slice::Iter<'a, Fault>,
    undo: Vec<(Instant, Undo)>,
    disk: Disk,
    limits: &'a Limits,
}

impl<'a> Chaos<'a> {
    pub fn new(faults: &'a [Fault], disk: Disk, limits: &'a Limits) -> Self {
        Self { faults: faults.iter(), undo: Vec::new(), disk, limits }
    }

    /// Instant of the next event.
    pub fn poll_timeout(&self) -> Option<Instant> {
        let next = self.faults.as_slice().first().map(|fault| Instant::ZERO + fault.at);
        self.undo.iter().map(|(at, _)| *at).chain(next).min()
    }

    /// Injects the faults that are due at the machine's time; passes each to `did`.
    pub fn handle_timeout(&mut self, machine: &mut Virtual, mut did: impl FnMut(&Fault)) {
        let now = machine.now();
        // Ends come first: a module that is hung again at this time hangs.
        for (_, undo) in self.undo.extract_if(.., |(at, _)| *at <= now) {
            match undo {
                Undo::Resume(pid) => machine.resume(pid),
                Undo::Uncrawl(pid) => machine.crawl(pid, Duration::ZERO),
                Undo::Free => self.disk.0.update(|faults| faults - 1),
            }
        }
        while let Some(fault) = self.faults.as_slice().first().filter(|fault| Instant::ZERO + fault.at <= now) {
            self.faults.next();
            if self.befall(machine, fault) {
                did(fault);
            }
        }
    }

    /// Injects a fault; false if it has no target.
    fn befall(&mut self, machine: &mut Virtual, fault: &Fault) -> bool {
        let (now, target) = (machine.now(), fault.target.as_str());
        let over = now + Duration::from_secs_f64(fault.lasts.clamp(0.0, 1e6));
        let pid = machine.pid(target);
        match (fault.fault.as_str(), pid) {
            ("step", _) if target == CLOCK => machine.step_clock((fault.value * 1e6) as i64),
            ("full", _) if target == DISK => {
                self.disk.0.update(|faults| faults + 1);
                self.undo.push((over, Undo::Free));
            }
            ("kill" | "hang" | "crawl", None) => return false,
            ("kill", Some(pid)) => machine.kill(pid),
            ("hang", Some(pid)) => {
                machine.hang(pid);
                self.undo.push((over, Undo::Resume(pid)));
            }
            ("crawl", Some(pid)) => {
                machine.crawl(pid, Duration::from_secs_f64(fault.value.clamp(0.0, 10.0)));
                self.undo.push((over, Undo::Uncrawl(pid)));
            }
            ("pause", _) => order(machine, target, State::Pause, true),
            ("stop", _) => order(machine, target, State::Stop, true),
            ("terminate", _) => order(machine, target, State::Terminate, true),
            ("run", _) => order(machine, target, State::Run, false),
            (name, _) => {
                if !rivals::speak(machine, fault, self.limits) && !machine.fault(target, name, fault.value, fault.lasts)
                {
                    let (target, fault_name) = (fault.target.clone(), fault.fault.clone());
                    let (value, duration) = (fault.value, fault.lasts);
                    let command = simulation::CmdFault { timestamp: 0, target, fault: fault_name, value, duration };
                    machine.inject(now, command);
                }
            }
        }
        true
    }
}

fn order(machine: &mut Virtual, module: &str, state: State, manual: bool) {
    let (module, state, source) = (module.into(), state as i8, SOURCE.into());
    machine.inject(machine.now(), common::CmdState { timestamp: 0, module, state, manual, source });
}

#[cfg(test)]
mod tests {
    use super::super::Kind;
    use super::*;

    fn kind(name: &str, per_hour: f64) -> Kind {
        let targets = vec!["a".into(), "b".into()];
        Kind { name: name.into(), targets, fault: "hang".into(), per_hour, value: (1.0, 2.0), lasts: (0.5, 30.0) }
    }

    fn scenario(kinds: Vec<Kind>) -> Scenario {
        Scenario { kinds, ..Scenario::default() }
    }

    #[test]
    fn faults_occur_in_chaos_only_with_their_configured_frequency() {
        let scenario = scenario(vec![kind("x", 120.0)]);
        let mut count = 0;
        for episode in 0..100 {
            for fault in draw(&scenario, 1, episode) {
                let end = fault.at.as_secs_f64() + fault.lasts;
                let turn = (fault.at.as_secs_f64() - 20.0).rem_euclid(120.0);
                assert!(turn < 60.0 && end - fault.at.as_secs_f64() + turn <= 60.000_001, "{fault}");
                assert!((1.0..2.0).contains(&fault.value));
                count += 1;
            }
        }
        // Five chaos phases of a minute in each of a hundred episodes: 1000 faults are expected, with a deviation of
        // 32.
        assert!((900..1100).contains(&count), "{count}");
    }

    #[test]
    fn equal_seeds_draw_equal_faults_independent_of_other_kinds() {
        let one = scenario(vec![kind("x", 120.0)]);
        let both = scenario(vec![kind("w", 500.0), kind("x", 120.0)]);
        assert_eq!(draw(&one, 7, 3), draw(&one, 7, 3));
        assert_ne!(draw(&one, 7, 3), draw(&one, 8, 3));
        assert_ne!(draw(&one, 7, 3), draw(&one, 7, 4));
        let of_x: Vec<_> = draw(&both, 7, 3).into_iter().filter(|fault| fault.kind == "x").collect();
        assert_eq!(of_x, draw(&one, 7, 3));
        assert!(draw(&both, 7, 3).is_sorted_by_key(|fault| fault.at));
    }
}
