//! Module that starts all other modules, supervises them, and keeps the wanted state of each.
//!
//! Policy only: it requests processes from its host ([`module::ProcessCommand`]) and receives their news, so the live
//! and the virtual host run the same watchdog. A module with heartbeats is judged by them: 200 ms of silence of any of
//! its threads is a hang. In addition all modules are judged by their announcement (`CM_DATA_STATE`) as in 2011: two
//! seconds without one, checked every 200 ms, is a hang; for foreign modules without heartbeats this is the only
//! criterion.
//!
//! A module is started, dies and is started again:
//!
//! ```
//! use base::Duration;
//! use module::bench::Bench;
//! use module::{Action, Event, ExitStatus, ProcessCommand, ProcessEvent, Shell, ShellConfig};
//! use watchdog::{Config, ModuleConfig, NAME, Watchdog};
//!
//! let (name, beat_timeout) = ("planner".to_string(), Duration::from_millis(200));
//! let planner = ModuleConfig { name, depends: Vec::new(), beat_timeout, restart: true, critical: false };
//! let watchdog = Watchdog::new(Config { modules: vec![planner], ..Config::default() });
//! let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(watchdog)));
//! let spawned = |bench: &mut Bench| {
//!     let is_spawn = |action| matches!(action, Action::Process(ProcessCommand::Spawn { .. }));
//!     bench.done().into_iter().any(|(_, action)| is_spawn(action))
//! };
//!
//! bench.event(Event::Start);
//! assert!(spawned(&mut bench));
//! bench.event(Event::Process(ProcessEvent::Started { module: "planner", pid: 7 }));
//! bench.pass(Duration::from_secs(1));
//! assert!(!spawned(&mut bench));
//!
//! bench.event(Event::Process(ProcessEvent::Exited { pid: 7, status: ExitStatus::Signal(11) }));
//! bench.pass(Duration::from_secs(1));
//! assert!(spawned(&mut bench));
//! ```
#![forbid(unsafe_code)]

mod guard;
#[cfg(test)]
mod tests;

use base::{Deadlines, Duration, Fault, Instant, Severity, earliest};
use guard::{Guard, Phase};
use messages::{Channel, Message, common, source_in_words};
use module::{Actions, Cause, Event, ExitStatus, Module, ProcessCommand, ProcessEvent, State, exit};
use settings::{Choice, Table, settings};
use std::collections::BTreeMap;

/// Name of the watchdog as a module.
pub const NAME: &str = "watchdog";

/// Period of `CM_DATA_PROCESSES`, which is also published at every change.
const PUBLISH_PERIOD: Duration = Duration::from_millis(100);
/// Period of the lists in the name of modules without a process.
const LISTS_PERIOD: Duration = Duration::from_secs(1);
/// Period of checking the modules.
const CHECK_PERIOD: Duration = Duration::from_millis(200);
/// A module that others depend on counts as up when it announces another state than INIT, or after this time.
const DEPENDENCY_TIMEOUT: Duration = Duration::from_secs(2);
/// Time between SIGTERM and SIGKILL for a process that hangs.
const HANG_GRACE: Duration = Duration::from_millis(200);
/// Faults that report that a module is down.
const DOWN: [Fault; 3] = [Fault::ModuleDied, Fault::ModuleHung, Fault::ModuleUnstartable];
/// Time for which modules that are not supervised here are remembered after their last announcement, and
/// [`OTHERS_MAX`], their maximum number.
const OTHER_TIMEOUT: Duration = Duration::from_secs(5);
const OTHERS_MAX: usize = 64;
/// Time between two calls beyond which the watchdog itself was held up, so that silence of the modules does not count;
/// this applies once in [`HELD_UP_PERIOD`], otherwise a watchdog that is always held up would never find a module
/// silent.
const HELD_UP_MIN: Duration = Duration::from_millis(500);
const HELD_UP_PERIOD: Duration = Duration::from_secs(10);
/// Two late checks of the heartbeats within this time: a hang would be found too late, so the phases of all processes
/// are unknown, until no check has been late for this time.
const LATE_WINDOW: Duration = Duration::from_secs(1);

/// What to guard and how.
#[derive(Clone, Debug)]
pub struct Config {
    /// The modules, in the order in which to start them.
    pub modules: Vec<ModuleConfig>,
    /// A module that does not announce itself for this long hangs.
    pub announce_timeout: Duration,
    /// A process that was asked to end has this long before it is killed. A drive's driver needs it to let the
    /// robot come to a stand.
    pub end_within: Duration,
    /// The delay before a restart doubles up to this.
    pub delay_max: Duration,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            modules: Vec::new(),
            announce_timeout: Duration::from_secs(2),
            end_within: Duration::from_millis(1500),
            delay_max: Duration::from_secs(10),
        }
    }
}

settings! {
    /// Keys of `[[modules]]` for the watchdog.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ModuleConfig {
        /// Name on the bus.
        name: String = required;
        /// Modules, listed before, that must have come up before it is started.
        depends: Vec<String> = Vec::<String>::new();
        /// Time without a beat of one of its threads after which it counts as hung (docs/beats.md).
        beat_timeout_s was beat_timeout as beat_timeout: Duration = 0.2, 0.02..=60.0;
        /// True (`"always"`) if it is started again when it ends unasked.
        restart: bool = true, Choice(&[("always", true), ("never", false)]);
        /// The robot must not move without it.
        critical: bool = false;
    }
    check ModuleConfig::check;
}

impl ModuleConfig {
    fn check(&self, table: &Table<'_>) {
        if !self.name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-') {
            table.refuse("name", "letters, digits, _ and -");
        }
    }
}

base::deadlines! {
    /// Periodic work; the deadlines of a module are in its guard.
    enum Timer {
        /// `CM_DATA_PROCESSES` is published.
        Publish,
        /// Lists of faults of modules without a process are published.
        Lists,
        /// All modules are checked.
        Check,
        /// No check of the heartbeats has been late for [`LATE_WINDOW`]. Set while the phases are unknown.
        Late,
    }
}

/// The watchdog.
pub struct Watchdog {
    config: Config,
    guards: Vec<Guard>,
    /// Modules that are not supervised here, with the time of their last announcement.
    others: BTreeMap<String, Instant>,
    /// Last health of the critical modules reported to the host.
    health: Option<(bool, String)>,
    deadlines: Deadlines<Timer>,
    started: Instant,
    /// Time of the last call; everything due by then has been served.
    now: Instant,
    /// Time at which the watchdog's own delay was last not charged to the modules.
    held_up: Option<Instant>,
    /// Time of the last late check of the heartbeats.
    late: Option<Instant>,
    /// Data in `CM_DATA_PROCESSES` has changed.
    changed: bool,
    ending: bool,
    all_up: bool,
}

impl Watchdog {
    /// Creates a watchdog that has started nothing yet. The host must check the configuration: names are unique,
    /// dependencies exist and are not circular.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let guards = config.modules.iter().map(|module| Guard::new(module.clone())).collect();
        Self {
            config,
            guards,
            others: BTreeMap::new(),
            health: None,
            deadlines: Deadlines::new(),
            started: Instant::ZERO,
            now: Instant::ZERO,
            held_up: None,
            late: None,
            changed: true,
            ending: false,
            all_up: false,
        }
    }

    fn on_start(&mut self, now: Instant, out: &mut Actions) {
        self.started = now;
        let adopted = self.guards.iter().filter(|guard| guard.phase.pid().is_some()).count();
        if adopted > 0 {
            out.note(format!("{adopted} modules of an earlier watchdog were adopted"));
        }
        for guard in self.guards.iter().filter(|guard| guard.died_unseen()) {
            let name = &guard.config.name;
            let message = format!("{name} ended while no watchdog was running");
            out.raise(Severity::Error, Fault::ModuleDied, name.as_str(), message);
        }
        // When idle modules are awake too, and the host for its own checks.
        for (timer, period) in
            [(Timer::Publish, PUBLISH_PERIOD), (Timer::Lists, LISTS_PERIOD), (Timer::Check, CHECK_PERIOD)]
        {
            self.deadlines.set(timer, Instant::ZERO.next_on_grid(now, period));
        }
    }

    fn on_message(&mut self, now: Instant, message: &Message, out: &mut Actions) {
        match message {
            Message::CmDataState(state) => self.on_state(now, state, out),
            Message::CmCmdState(command) => self.on_command(now, command, out),
            _ => {}
        }
    }

    /// Processes a module of an earlier watchdog. One that is no longer configured is ended.
    fn on_earlier(&mut self, module: &str, wanted: State, held: bool, pid: Option<u32>, out: &mut Actions) {
        let guard = match (self.guards.iter_mut().position(|guard| guard.config.name == module), pid) {
            (Some(index), _) => {
                self.guards[index].earlier(self.now, wanted, held, pid);
                &mut self.guards[index]
            }
            (None, None) => return,
            (None, Some(_)) => {
                let mut guard = Guard::new(ModuleConfig {
                    name: module.into(),
                    depends: Vec::new(),
                    beat_timeout: self.config.announce_timeout,
                    restart: false,
                    critical: false,
                });
                guard.earlier(self.now, State::Terminate, held, pid);
                guard.unconfigured = true;
                self.guards.push(guard);
                let last = self.guards.len() - 1;
                &mut self.guards[last]
            }
        };
        if guard.wanted == State::Terminate {
            guard.end(self.now, self.config.end_within, out);
        }
    }

    fn on_state(&mut self, now: Instant, announced: &common::DataState, out: &mut Actions) {
        let Some(guard) = self.guards.iter_mut().find(|guard| guard.config.name == announced.module) else {
            self.on_other(now, &announced.module);
            return;
        };
        let Some(state) = State::from_value(announced.state) else {
            return;
        };
        // Which process is the module's is not known before the news of its start.
        if let Phase::Spawning { .. } = guard.phase {
            return;
        }
        if !matches!(guard.phase, Phase::Running { .. }) {
            if guard.claim(now) {
                let message = format!("{} {state} is announced, but its process does not run", guard.config.name);
                out.report(Severity::Warning, Fault::NameClaimed, guard.config.name.as_str(), message);
            }
            return;
        }
        // A change of state is announced at once and not counted.
        let counted = if guard.state == state { guard.count(now) } else { None };
        match counted {
            Some(true) => {
                let message = format!("{} is announced by more than one sender", guard.config.name);
                out.raise(Severity::Warning, Fault::NameClaimed, guard.config.name.as_str(), message);
            }
            Some(false) => {
                let message = format!("{} is announced by one sender again", guard.config.name);
                out.clear(Fault::NameClaimed, guard.config.name.as_str(), message);
            }
            None => {}
        }
        guard.heard = now;
        self.changed |= guard.reconcile(now, state, out);
        if guard.state == state {
            return;
        }
        guard.state = state;
        self.changed = true;
        if matches!(state, State::Run | State::Pause | State::Stop) {
            guard.settle(now, state, out);
            let took = now.since(guard.since).as_secs_f64();
            let name = &guard.config.name;
            // In a storm its return is not reported either.
            if !guard.storm {
                for fault in DOWN {
                    out.clear(fault, name.as_str(), format!("{name} is back: {state} {took:.2} s after its start"));
                }
            }
        }
        self.start_ready(now, out);
        if !self.all_up && self.guards.iter().all(|guard| guard.state == State::Run) {
            self.all_up = true;
            let took = now.since(self.started).as_secs_f64();
            out.note(format!("all {} modules RUN after {took:.2} s", self.guards.len()));
        }
    }

    /// Processes an announcement of a module that another program started.
    fn on_other(&mut self, now: Instant, name: &str) {
        if let Some(heard) = self.others.get_mut(name) {
            *heard = now;
            return;
        }
        self.others.retain(|_, heard| now.since(*heard) < OTHER_TIMEOUT);
        if self.others.len() < OTHERS_MAX {
            self.others.insert(name.into(), now);
        }
    }

    /// Reason why no process can execute a command, if so. A running module reports its own refusals.
    fn reason_unexecutable(&self, now: Instant, command: &common::CmdState) -> Option<&'static str> {
        let name = command.module.as_str();
        let guard = self.guards.iter().find(|guard| guard.config.name == name);
        match (guard, State::from_value(command.state)) {
            (None, _) if [NAME, "*"].contains(&name) => None,
            (None, _) if self.others.get(name).is_some_and(|heard| now.since(*heard) < OTHER_TIMEOUT) => None,
            (None, _) => Some("there is no such module"),
            (Some(guard), _) if guard.phase.pid().is_some() => None,
            (Some(_), None) => Some("that is no state"),
            (Some(guard), Some(to))
                if guard.wanted == State::Terminate && ![State::Run, State::Terminate].contains(&to) =>
            {
                Some("it is down; only RUN starts it")
            }
            _ => None,
        }
    }

    fn on_command(&mut self, now: Instant, command: &common::CmdState, out: &mut Actions) {
        if let Some(why) = self.reason_unexecutable(now, command) {
            let common::CmdState { module, state, source, .. } = command;
            let state = State::from_value(*state).map_or_else(|| state.to_string(), |state| state.to_string());
            let message = format!("command {state} to {module} from {} refused: {why}", source_in_words(source));
            out.report(Severity::Warning, Fault::CommandForbidden, module.as_str(), message);
            return;
        }
        let Some(to) = State::from_value(command.state) else {
            return;
        };
        let cause = if command.manual { Cause::Manual } else { Cause::Command };
        for guard in &mut self.guards {
            if command.module != "*" && command.module != guard.config.name {
                continue;
            }
            self.changed |= guard.command(now, to, cause, self.config.end_within);
        }
        self.start_ready(now, out);
    }

    fn on_process(&mut self, now: Instant, event: &ProcessEvent<'_>, out: &mut Actions) {
        match *event {
            ProcessEvent::Started { module, pid } => {
                if let Some(guard) = self.guards.iter_mut().find(|guard| guard.config.name == module) {
                    guard.on_started(now, pid, out);
                    // A TERMINATE during the start could not be received by the process.
                    if self.ending || guard.wanted == State::Terminate {
                        guard.end(now, self.config.end_within, out);
                    }
                }
            }
            ProcessEvent::Unstartable { module, reason } => {
                if let Some(guard) = self.guards.iter_mut().find(|guard| guard.config.name == module) {
                    unstartable(now, guard, reason, self.config.delay_max, out);
                    guard.list_faults(now, self.started, out);
                }
            }
            ProcessEvent::Exited { pid, status } => self.on_exited(now, pid, status, out),
            ProcessEvent::HeartbeatLate { pid, thread, last } => {
                if let Some(guard) = self.guards.iter_mut().find(|guard| guard.is_running(pid))
                    && now.since(last) >= guard.config.beat_timeout
                {
                    let ms = now.since(last).as_millis();
                    on_hang(now, guard, &format!("its thread {thread} has sent no heartbeat for {ms} ms"), out);
                    self.changed = true;
                }
                return;
            }
            ProcessEvent::BadHeartbeat { pid, why } => {
                if let Some(guard) = self.guards.iter().find(|guard| guard.is_running(pid)) {
                    let name = &guard.config.name;
                    let message =
                        format!("{name}: its heartbeat page {why}; it is supervised by its announcements only");
                    out.raise(Severity::Warning, Fault::BeatsBad, name.as_str(), message);
                }
                return;
            }
            ProcessEvent::HeartbeatStarted { pid } => {
                if let Some(guard) = self.guards.iter().find(|guard| guard.is_running(pid)) {
                    let name = &guard.config.name;
                    out.clear(Fault::BeatsBad, name.as_str(), format!("{name} beats"));
                }
                return;
            }
            ProcessEvent::CheckLate { by } => {
                self.on_check_late(now, by, out);
                return;
            }
            ProcessEvent::Earlier { module, wanted, held, pid } => {
                self.on_earlier(module, wanted, held, pid, out);
                return;
            }
            ProcessEvent::Usage { pid, cpu, rss } => {
                if let Some(guard) = self.guards.iter_mut().find(|guard| guard.phase.pid() == Some(pid)) {
                    (guard.cpu, guard.rss) = (cpu, rss);
                }
                return;
            }
        }
        self.changed = true;
        self.start_ready(now, out);
        self.end_unneeded(now, out);
    }

    /// Processes a late check of the heartbeats.
    fn on_check_late(&mut self, now: Instant, by: Duration, out: &mut Actions) {
        let before = self.late.replace(now);
        if before.is_some_and(|before| now.since(before) < LATE_WINDOW) {
            self.deadlines.set(Timer::Late, now + LATE_WINDOW);
            let message = format!(
                "the watchdog is late repeatedly, last by {} ms: the robot must not move; the computer is overloaded",
                by.as_millis()
            );
            out.raise(Severity::Error, Fault::WatchdogLate, NAME, message);
            self.changed = true;
        }
    }

    fn on_exited(&mut self, now: Instant, pid: u32, status: ExitStatus, out: &mut Actions) {
        let Some(index) = self.guards.iter().position(|guard| guard.phase.pid() == Some(pid)) else {
            return;
        };
        if self.guards[index].unconfigured {
            self.guards.remove(index);
            return;
        }
        let guard = &mut self.guards[index];
        let asked = matches!(guard.phase, Phase::Terminating { .. });
        let delay = guard.on_down(now, self.config.delay_max);
        guard.last_exit = status.number();
        guard.list_faults(now, self.started, out);
        if asked || self.ending {
            return;
        }
        let name = &guard.config.name;
        let how = match status {
            ExitStatus::Code(..0) => "with an unknown status".into(),
            ExitStatus::Code(code) => {
                let meaning = exit::meaning(code).map(|meaning| format!(" ({meaning})")).unwrap_or_default();
                format!("with exit code {code:#04x}{meaning}")
            }
            ExitStatus::Signal(signal) => format!("by signal {signal}"),
        };
        let then = match (guard.config.restart, delay.as_millis()) {
            (false, _) => "it stays down".into(),
            (true, 0) => "it is started again".into(),
            (true, ms) => format!("it is started again in {ms} ms"),
        };
        out.raise(Severity::Error, Fault::ModuleDied, name.as_str(), format!("{name} ended {how}: {then}"));
        if guard.storm && guard.config.restart {
            report_storm(guard, out);
        }
    }

    fn on_timer(&mut self, now: Instant, out: &mut Actions) {
        let check = self.deadlines.tick(Timer::Check, now, CHECK_PERIOD);
        for guard in &mut self.guards {
            match guard.phase {
                Phase::Running { .. } if check && now.since(guard.heard) >= self.config.announce_timeout => {
                    let silent = now.since(guard.heard).as_secs_f64();
                    on_hang(now, guard, &format!("it has not announced itself for {silent:.1} s"), out);
                    self.changed = true;
                }
                Phase::Spawning { until } if until <= now => {
                    unstartable(now, guard, "the host does not answer", self.config.delay_max, out);
                    self.changed = true;
                }
                Phase::Terminating { pid, kill_at: Some(kill_at) } if kill_at <= now => {
                    out.push(module::Action::Process(ProcessCommand::Kill { pid }));
                    guard.phase = Phase::Terminating { pid, kill_at: None };
                }
                _ => {}
            }
            if check && guard.storm_ended(now) {
                let name = &guard.config.name;
                for fault in DOWN.into_iter().chain([Fault::RestartStorm]) {
                    out.clear(fault, name.as_str(), format!("{name} has been stable again: {}", guard.state));
                }
            }
        }
        if self.deadlines.take(Timer::Late, now) {
            out.clear(Fault::WatchdogLate, NAME, "the watchdog is on time again");
            self.changed = true;
        }
        if self.deadlines.tick(Timer::Lists, now, LISTS_PERIOD) {
            self.guards.iter().for_each(|guard| guard.list_faults(now, self.started, out));
        }
        self.start_ready(now, out);
        if self.deadlines.tick(Timer::Publish, now, PUBLISH_PERIOD) {
            self.changed = true;
        }
    }

    /// Starts every module that is wanted, down and not delayed, and whose dependencies are up.
    fn start_ready(&mut self, now: Instant, out: &mut Actions) {
        if self.ending {
            return;
        }
        for index in 0..self.guards.len() {
            let guard = &self.guards[index];
            let ready = guard.may_start(now) && guard.config.depends.iter().all(|name| self.is_up(now, name));
            if ready {
                let guard = &mut self.guards[index];
                guard.on_spawn(now);
                let (module, wanted) = (guard.config.name.clone(), guard.wanted);
                out.push(module::Action::Process(ProcessCommand::Spawn { module, wanted }));
                self.changed = true;
            }
        }
    }

    fn is_up(&self, now: Instant, name: &str) -> bool {
        self.guards.iter().find(|guard| guard.config.name == name).is_none_or(|guard| match guard.phase {
            Phase::Running { since, .. } => {
                !matches!(guard.state, State::Unknown | State::Init) || now.since(since) >= DEPENDENCY_TIMEOUT
            }
            _ => false,
        })
    }

    /// Shutting down: ends every module that no running one depends on.
    fn end_unneeded(&mut self, now: Instant, out: &mut Actions) {
        if !self.ending {
            return;
        }
        for index in 0..self.guards.len() {
            let name = &self.guards[index].config.name;
            let needed = self
                .guards
                .iter()
                .any(|other| other.phase.pid().is_some() && other.config.depends.iter().any(|depends| depends == name));
            if !needed {
                self.guards[index].end(now, self.config.end_within, out);
            }
        }
    }

    /// Reports the health of the critical modules to the host if it changed.
    fn report_health(&mut self, out: &mut Actions) {
        let critical = || self.guards.iter().filter(|guard| guard.config.critical);
        let sick = critical().find(|guard| !guard.is_healthy());
        let unable = critical().find(|guard| guard.state == State::Error);
        let run = self.guards.iter().filter(|guard| guard.state == State::Run).count();
        let status = match (sick, unable) {
            (Some(guard), _) if !self.ending => format!("{} does not run", guard.config.name),
            _ if self.ending => "ending".into(),
            (_, Some(guard)) => format!("{} is in ERROR", guard.config.name),
            _ => format!("{run} of {} modules RUN", self.guards.len()),
        };
        let health = (sick.is_none() || self.ending, status);
        if self.health.as_ref() != Some(&health) {
            let (healthy, status) = health.clone();
            out.push(module::Action::Process(ProcessCommand::Health { healthy, status }));
            self.health = Some(health);
        }
    }

    fn publish_processes(&self, now: Instant, out: &mut Actions) {
        let judged = !self.deadlines.is_set(Timer::Late);
        let processes = self.guards.iter().map(|guard| guard.process(now, judged)).collect();
        out.publish(common::DataProcesses { timestamp: out.timestamp(now), processes });
    }
}

/// A process hangs: reported, then ended.
fn on_hang(now: Instant, guard: &mut Guard, why: &str, out: &mut Actions) {
    let name = &guard.config.name;
    out.raise(Severity::Error, Fault::ModuleHung, name.as_str(), format!("{name} hangs, {why}: it is ended"));
    guard.end(now, HANG_GRACE, out);
    guard.state = State::Unknown;
}

/// It was restarted too often: reported once, until its uptime is sufficient.
fn report_storm(guard: &Guard, out: &mut Actions) {
    let name = &guard.config.name;
    let message = format!("{name} ends repeatedly: further restarts are not reported until it is stable");
    out.raise(Severity::Error, Fault::RestartStorm, name.as_str(), message);
}

fn unstartable(now: Instant, guard: &mut Guard, reason: &str, delay_max: Duration, out: &mut Actions) {
    let delay = guard.on_down(now, delay_max);
    let name = &guard.config.name;
    let message = format!("{name} cannot be started: {reason}; again in {} ms", delay.as_millis());
    out.raise(Severity::Error, Fault::ModuleUnstartable, name.as_str(), message);
}

impl Module for Watchdog {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::CmDataState, Channel::CmCmdState]
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        if now.since(self.now) >= HELD_UP_MIN && self.held_up.is_none_or(|before| now.since(before) >= HELD_UP_PERIOD) {
            self.held_up = Some(now);
            for guard in &mut self.guards {
                guard.heard = now;
            }
        }
        self.now = now;
        if let Event::Process(event @ (ProcessEvent::Earlier { .. } | ProcessEvent::BadHeartbeat { .. })) = event {
            // Before the start no list of processes is sent.
            self.on_process(now, &event, out);
            return;
        }
        match event {
            Event::Start => {
                self.on_start(now, out);
                out.working();
                self.start_ready(now, out);
            }
            Event::Message { message, .. } => self.on_message(now, message, out),
            Event::Process(event) => self.on_process(now, &event, out),
            Event::Timer => self.on_timer(now, out),
            Event::State(State::Terminate) => {
                self.ending = true;
                self.changed = true;
                self.end_unneeded(now, out);
            }
            Event::State(_) | Event::RawMessage { .. } | Event::Port { .. } => {}
        }
        if self.changed {
            self.changed = false;
            for guard in self.guards.iter_mut().filter(|guard| !guard.unconfigured) {
                guard.remember(out);
            }
            self.report_health(out);
            self.publish_processes(now, out);
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        // A module that waits for its dependencies, not for time, is evaluated when they change and at each check.
        let guards = self.guards.iter().filter_map(Guard::poll_timeout).filter(|due| *due > self.now).min();
        earliest([self.deadlines.next(), guards])
    }

    fn finished(&self) -> bool {
        self.guards.iter().all(|guard| guard.phase.pid().is_none() && !matches!(guard.phase, Phase::Spawning { .. }))
    }
}
