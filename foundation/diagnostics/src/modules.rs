//! Modules: their announced states, and the watchdog's report on their processes.

use crate::Slot;
use base::{Duration, Instant, Level};
use messages::common::{self, DataLevel, Process};
use module::{State, exit};
use serde::Serialize;
use std::collections::BTreeMap;

/// Maximum number of modules.
const MODULES_MAX: usize = 200;
/// Period of announcements.
const ANNOUNCED: Duration = Duration::from_secs(1);
/// Silence after which a program that no watchdog guards is no longer listed beside guarded modules: it has ended.
const FORGOTTEN: Duration = Duration::from_secs(30);

/// Module.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModuleRow {
    /// Name.
    pub module: String,
    /// Last announced state.
    pub state: &'static str,
    /// Commanded state; empty if no watchdog guards the module.
    pub wanted: &'static str,
    /// Phase of its process: `running`, `ending`, `down`; `not judged` while the watchdog itself is late; `stranger` if
    /// no watchdog guards it.
    pub phase: &'static str,
    /// Process id; 0 without a process.
    pub pid: i32,
    /// Time since the start of the process, s.
    pub uptime: f64,
    /// Number of restarts.
    pub restarts: i32,
    /// Sentence on how the last process ended; empty if none has.
    pub last_exit: String,
    /// Processor load, cores.
    pub cpu: f64,
    /// Resident memory, bytes.
    pub rss: i64,
    /// True if the robot does not move without it.
    pub critical: bool,
    /// True if it runs and is in the wanted state.
    pub well: bool,
    /// Time since its last announcement, s; `None` without one.
    pub age: Option<f64>,
    /// Number of its active faults; `None` if unknown.
    pub faults: Option<usize>,
    /// Name of the level from which its texts and reports are printed; empty if unknown: it was not asked since its
    /// start.
    pub print_from: &'static str,
    /// Name of the level from which its texts and reports are sent; empty likewise.
    pub send_from: &'static str,
    /// True if an operator has changed these levels.
    pub levels_changed: bool,
}

/// All modules.
#[derive(Clone, Debug)]
pub struct Modules {
    announced: Vec<(String, Slot<State>)>,
    /// Last answers of modules about their levels, with the names.
    levels: BTreeMap<String, DataLevel>,
    critical: Vec<String>,
}

impl Modules {
    /// Creates an empty table; without `critical` modules the robot does not move.
    #[must_use]
    pub fn new(critical: Vec<String>) -> Self {
        Self { announced: Vec::new(), levels: BTreeMap::new(), critical }
    }

    /// Processes the announcement of a module's state.
    pub fn on_state(&mut self, at: Instant, announced: &common::DataState) {
        let state = State::from_value(announced.state).unwrap_or(State::Unknown);
        if state == State::Init {
            // A new process has the levels of the configuration.
            self.levels.remove(&announced.module);
        }
        if let Some((_, slot)) = self.announced.iter_mut().find(|(name, _)| *name == announced.module) {
            slot.put(at, state);
        } else if self.announced.len() < MODULES_MAX {
            let mut slot = Slot::every(ANNOUNCED);
            slot.put(at, state);
            self.announced.push((announced.module.clone(), slot));
        }
    }

    /// Processes the answer of a module about its levels.
    pub fn on_level(&mut self, level: &DataLevel) {
        if self.levels.contains_key(&level.module) || self.levels.len() < MODULES_MAX {
            self.levels.insert(level.module.clone(), level.clone());
        }
    }

    /// Names of the levels from which a module prints and sends, empty if unknown; true if they were changed.
    fn levels(&self, module: &str) -> (&'static str, &'static str, bool) {
        let name = |value| Level::from_value(value).map_or("", Level::name);
        let level = self.levels.get(module);
        level.map_or(("", "", false), |level| (name(level.print_from), name(level.send_from), level.commanded))
    }

    /// Last announced state of a module, unless it is stale.
    #[must_use]
    pub fn state(&self, now: Instant, module: &str) -> Option<State> {
        self.slot(module)?.fresh(now).copied()
    }

    /// True if the robot does not move without the module.
    #[must_use]
    pub fn is_critical(&self, module: &str) -> bool {
        self.critical.iter().any(|name| name == module)
    }

    fn slot(&self, module: &str) -> Option<&Slot<State>> {
        self.announced.iter().find(|(name, _)| name == module).map(|(_, slot)| slot)
    }

    /// Modules: the watchdog's in its order, then those that only announce themselves.
    #[must_use]
    pub fn rows(&self, now: Instant, processes: &[Process]) -> Vec<ModuleRow> {
        let mut rows = self.rows_without_levels(now, processes);
        for row in &mut rows {
            (row.print_from, row.send_from, row.levels_changed) = self.levels(&row.module);
        }
        rows
    }

    fn rows_without_levels(&self, now: Instant, processes: &[Process]) -> Vec<ModuleRow> {
        let guarded = processes.iter().take(MODULES_MAX).map(|process| self.guarded(now, process));
        let strangers = self.announced.iter().filter(|(name, _)| processes.iter().all(|p| p.module != *name));
        let listed = |name: &str, slot: &Slot<State>| {
            processes.is_empty() || self.is_critical(name) || slot.age(now).is_some_and(|age| age <= FORGOTTEN)
        };
        let strangers = strangers.filter(|(name, slot)| listed(name, slot)).map(|(name, slot)| ModuleRow {
            module: name.clone(),
            state: slot.get().map_or("UNKNOWN", |state| state.name()),
            wanted: "",
            phase: "stranger",
            pid: 0,
            uptime: 0.0,
            restarts: 0,
            last_exit: String::new(),
            cpu: 0.0,
            rss: 0,
            critical: self.is_critical(name),
            well: slot.fresh(now).is_some_and(|state| *state != State::Error),
            age: slot.age(now).map(|age| age.as_secs_f64()),
            faults: None,
            print_from: "",
            send_from: "",
            levels_changed: false,
        });
        guarded.chain(strangers).collect()
    }

    fn guarded(&self, now: Instant, process: &Process) -> ModuleRow {
        let name = |value| State::from_value(value).unwrap_or(State::Unknown).name();
        let phase = match process.phase {
            Process::RUNNING => "running",
            Process::TERMINATING => "ending",
            Process::UNKNOWN => "not judged",
            _ => "down",
        };
        let age = self.slot(&process.module).and_then(|slot| slot.age(now));
        ModuleRow {
            module: process.module.clone(),
            state: name(process.state),
            wanted: name(process.wanted),
            phase,
            pid: process.pid,
            uptime: process.uptime,
            restarts: process.restarts,
            last_exit: if process.restarts > 0 || process.phase == Process::TERMINATED {
                exit_in_words(process.last_exit)
            } else {
                String::new()
            },
            cpu: process.cpu,
            rss: process.rss,
            critical: self.is_critical(&process.module),
            well: process.phase == Process::RUNNING && process.state == process.wanted,
            age: age.map(|age| age.as_secs_f64()),
            faults: None,
            print_from: "",
            send_from: "",
            levels_changed: false,
        }
    }
}

/// Describes how a process ended, from `process_t.last_exit`: the exit codes of `docs/design.md` 4, or 128 + n for
/// signal n.
#[must_use]
pub fn exit_in_words(code: i32) -> String {
    let class = |name: &str, base: u8| {
        let more = exit::meaning(code).map(|meaning| format!(": {meaning}")).unwrap_or_default();
        format!("{name} ({:#04x}){more}", code.max(i32::from(base)))
    };
    match code {
        0 => "ended on command".into(),
        -1 => "ended unseen".into(),
        0x10..=0x1F => class("a resource is unavailable", exit::RESOURCE),
        0x20..=0x2F => class("a device failed", exit::DEVICE),
        0x40..=0x4F => class("failed", exit::OTHER),
        129..=192 => {
            let name = match code - 128 {
                1 => "SIGHUP",
                2 => "SIGINT",
                4 => "SIGILL: crashed",
                6 => "SIGABRT: aborted",
                7 => "SIGBUS: crashed",
                8 => "SIGFPE: crashed",
                9 => "SIGKILL: killed",
                11 => "SIGSEGV: crashed",
                14 => "SIGALRM: hung",
                15 => "SIGTERM: terminated",
                number => return format!("signal {number}"),
            };
            name.into()
        }
        _ => format!("ended with {code}"),
    }
}
