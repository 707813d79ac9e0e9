//! The module that starts all modules, guards them, and keeps the state that an operator wants of each.
//!
//! Policy only: it asks its host for processes ([`module::ProcessCommand`]) and hears what became of them, so the live
//! and the virtual host run the same watchdog. A module whose threads beat is judged by their beats: 200 ms of silence
//! of any of them is a hang. All are judged by their announcement (`CM_DATA_STATE`) besides, as in 2011: two seconds
//! without one, checked every 200 ms, is a hang; for foreign modules that do not beat it is all there is.
#![forbid(unsafe_code)]

mod guard;
#[cfg(test)]
mod tests;

use base::{Deadlines, Duration, Fault, Instant, Severity, earliest};
use guard::{Guard, Phase};
use messages::{Channel, Message, common};
use module::sabotage::{self, Bug};
use module::{Actions, Cause, Event, ExitStatus, Module, ProcessCommand, ProcessEvent, State};
use settings::{Choice, Table, settings};
use std::collections::BTreeMap;

/// The watchdog's name as a module.
pub const NAME: &str = "watchdog";

/// `CM_DATA_PROCESSES` is sent this often, and at every change.
const PUBLISH: Duration = Duration::from_millis(100);
/// Period of the lists in the name of modules without a process.
const LISTS: Duration = Duration::from_secs(1);
/// Modules are judged this often.
const CHECK: Duration = Duration::from_millis(200);
/// A module that others depend on has come up when it announces another state than INIT, or after this long.
const DEPENDS_PATIENCE: Duration = Duration::from_secs(2);
/// A process that hangs has this long between SIGTERM and SIGKILL.
const HANG_GRACE: Duration = Duration::from_millis(200);
/// What says that a module is down.
const DOWN: [Fault; 3] = [Fault::ModuleDied, Fault::ModuleHung, Fault::ModuleUnstartable];
/// Modules that are not ours to guard are known for this long after their last announcement, and no more than so many.
const OTHER_GONE: Duration = Duration::from_secs(5);
const OTHERS_MAX: usize = 64;
/// A watchdog that was not called for this long was held up itself, and heard nobody.
const HELD_UP: Duration = Duration::from_millis(500);

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
        /// All modules are judged.
        Check,
    }
}

/// The watchdog.
pub struct Watchdog {
    config: Config,
    guards: Vec<Guard>,
    /// Modules that are not ours to guard, and when they were last heard.
    others: BTreeMap<String, Instant>,
    /// What the host was last told of the critical modules.
    health: Option<(bool, String)>,
    deadlines: Deadlines<Timer>,
    started: Instant,
    /// The last time it was called; what was due by then has been served.
    now: Instant,
    /// Something that `CM_DATA_PROCESSES` shows has changed.
    changed: bool,
    ending: bool,
    all_up: bool,
}

impl Watchdog {
    /// A watchdog that has started nothing yet. The configuration is the host's affair to check: names are unique,
    /// dependencies exist and have no circle.
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
            changed: true,
            ending: false,
            all_up: false,
        }
    }

    fn on_start(&mut self, now: Instant, out: &mut Actions) {
        self.started = now;
        let adopted = self.guards.iter().filter(|guard| guard.phase.pid().is_some()).count();
        if adopted > 0 {
            out.note(format!("{adopted} modules of an earlier watchdog are adopted"));
        }
        for guard in self.guards.iter().filter(|guard| guard.died_unseen()) {
            let name = &guard.config.name;
            let message = format!("{name} ended while there was no watchdog");
            out.raise(Severity::Error, Fault::ModuleDied, name.as_str(), message);
        }
        self.deadlines.set(Timer::Publish, now + PUBLISH);
        self.deadlines.set(Timer::Lists, now + LISTS);
        self.deadlines.set(Timer::Check, now + CHECK);
    }

    fn on_message(&mut self, now: Instant, message: &Message, out: &mut Actions) {
        match message {
            Message::CmDataState(state) => self.on_state(now, state, out),
            Message::CmCmdState(command) => self.on_command(now, command, out),
            _ => {}
        }
    }

    /// An earlier watchdog's module. One that is not in the list any more is ended.
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
                guard.stranger = true;
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
        // The announcement may overtake the news of the process's start.
        if !matches!(guard.phase, Phase::Running { .. } | Phase::Spawning { .. }) {
            if guard.claim(now) {
                let message = format!("somebody announces {} {state}, which does not run", guard.config.name);
                out.report(Severity::Warning, Fault::NameClaimed, guard.config.name.as_str(), message);
            }
            return;
        }
        // What changes its state announces itself out of turn.
        let counted = if guard.state == state { guard.count(now) } else { None };
        match counted {
            Some(true) => {
                let message = format!("{} is announced more often than it announces itself", guard.config.name);
                out.raise(Severity::Warning, Fault::NameClaimed, guard.config.name.as_str(), message);
            }
            Some(false) => {
                let message = format!("{} alone announces itself again", guard.config.name);
                out.clear(Fault::NameClaimed, guard.config.name.as_str(), message);
            }
            None => {}
        }
        guard.heard = now;
        self.changed |= guard.agree(now, state, out);
        if guard.state == state {
            return;
        }
        guard.state = state;
        self.changed = true;
        if matches!(state, State::Run | State::Pause | State::Stop) {
            guard.settle(now, state, out);
            let took = now.since(guard.since).as_secs_f64();
            let name = &guard.config.name;
            // In a storm its coming back is no news either.
            if !guard.storm {
                for fault in DOWN {
                    out.clear(fault, name.as_str(), format!("{name} is back: {state} {took:.2} s after its start"));
                }
            }
        }
        self.start_what_may(now, out);
        if !self.all_up && self.guards.iter().all(|guard| guard.state == State::Run) {
            self.all_up = true;
            let took = now.since(self.started).as_secs_f64();
            out.note(format!("all {} modules RUN after {took:.2} s", self.guards.len()));
        }
    }

    /// A module that somebody else started.
    fn on_other(&mut self, now: Instant, name: &str) {
        if let Some(heard) = self.others.get_mut(name) {
            *heard = now;
            return;
        }
        self.others.retain(|_, heard| now.since(*heard) < OTHER_GONE);
        if self.others.len() < OTHERS_MAX {
            self.others.insert(name.into(), now);
        }
    }

    /// Why nobody can execute a command, if that is so. What a running module refuses it reports itself.
    fn unheard(&self, now: Instant, command: &common::CmdState) -> Option<&'static str> {
        let name = command.module.as_str();
        let guard = self.guards.iter().find(|guard| guard.config.name == name);
        match (guard, State::from_value(command.state)) {
            (None, _) if [NAME, "*"].contains(&name) => None,
            (None, _) if self.others.get(name).is_some_and(|heard| now.since(*heard) < OTHER_GONE) => None,
            (None, _) => Some("there is no such module"),
            (Some(guard), _) if guard.phase.pid().is_some() => None,
            (Some(_), None) => Some("that is no state"),
            (Some(guard), Some(to))
                if guard.wanted == State::Terminate && ![State::Run, State::Terminate].contains(&to) =>
            {
                Some("it is down, and only RUN starts it")
            }
            _ => None,
        }
    }

    fn on_command(&mut self, now: Instant, command: &common::CmdState, out: &mut Actions) {
        if let Some(why) = self.unheard(now, command) {
            let common::CmdState { module, state, source, .. } = command;
            let state = State::from_value(*state).map_or_else(|| state.to_string(), |state| state.to_string());
            let message = format!("command {state} to {module} from {source} refused: {why}");
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
        self.start_what_may(now, out);
    }

    fn on_process(&mut self, now: Instant, event: &ProcessEvent<'_>, out: &mut Actions) {
        match *event {
            ProcessEvent::Started { module, pid } => {
                if let Some(guard) = self.guards.iter_mut().find(|guard| guard.config.name == module) {
                    guard.on_started(now, pid, out);
                    // A TERMINATE that came meanwhile was not heard by a process that was not there.
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
            ProcessEvent::Silent { pid, thread, last } => {
                if let Some(guard) = self.guards.iter_mut().find(|guard| guard.is_running(pid))
                    && now.since(last) >= guard.config.beat_timeout
                {
                    let ms = now.since(last).as_millis();
                    hangs(now, guard, &format!("its thread {thread} has not beaten for {ms} ms"), out);
                    self.changed = true;
                }
                return;
            }
            ProcessEvent::BadBeats { pid, why } => {
                if let Some(guard) = self.guards.iter().find(|guard| guard.is_running(pid)) {
                    let name = &guard.config.name;
                    let message = format!("{name}: its page of beats {why}: it is judged by its announcements");
                    out.raise(Severity::Warning, Fault::BeatsBad, name.as_str(), message);
                }
                return;
            }
            ProcessEvent::Beating { pid } => {
                if let Some(guard) = self.guards.iter().find(|guard| guard.is_running(pid)) {
                    let name = &guard.config.name;
                    out.clear(Fault::BeatsBad, name.as_str(), format!("{name} beats"));
                }
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
        self.start_what_may(now, out);
        self.end_what_may(now, out);
    }

    fn on_exited(&mut self, now: Instant, pid: u32, status: ExitStatus, out: &mut Actions) {
        let Some(index) = self.guards.iter().position(|guard| guard.phase.pid() == Some(pid)) else {
            return;
        };
        if self.guards[index].stranger {
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
            ExitStatus::Code(..0) => "and nobody saw how".into(),
            ExitStatus::Code(code) => format!("with exit code {code:#04x}"),
            ExitStatus::Signal(signal) => format!("by signal {signal}"),
        };
        let then = match (guard.config.restart, delay.as_millis()) {
            (false, _) => "it stays down".into(),
            (true, 0) => "it is started again".into(),
            (true, ms) => format!("it is started again in {ms} ms"),
        };
        out.raise(Severity::Error, Fault::ModuleDied, name.as_str(), format!("{name} ended {how}: {then}"));
        if guard.storm && guard.config.restart {
            storms(guard, out);
        }
    }

    fn on_timer(&mut self, now: Instant, out: &mut Actions) {
        let check = self.deadlines.tick(Timer::Check, now, CHECK);
        for guard in &mut self.guards {
            match guard.phase {
                Phase::Running { .. } if check && now.since(guard.heard) >= self.config.announce_timeout => {
                    let silent = now.since(guard.heard).as_secs_f64();
                    hangs(now, guard, &format!("it has not announced itself for {silent:.1} s"), out);
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
            if check && guard.calms(now) {
                let name = &guard.config.name;
                for fault in DOWN.into_iter().chain([Fault::RestartStorm]) {
                    out.clear(fault, name.as_str(), format!("{name} is calm again: {}", guard.state));
                }
            }
        }
        if self.deadlines.tick(Timer::Lists, now, LISTS) {
            self.guards.iter().for_each(|guard| guard.list_faults(now, self.started, out));
        }
        self.start_what_may(now, out);
        if self.deadlines.tick(Timer::Publish, now, PUBLISH) {
            self.changed = true;
        }
    }

    /// Starts every module that is wanted, down, not delayed, and whose dependencies have come up.
    fn start_what_may(&mut self, now: Instant, out: &mut Actions) {
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
                !matches!(guard.state, State::Unknown | State::Init) || now.since(since) >= DEPENDS_PATIENCE
            }
            _ => false,
        })
    }

    /// On the way down: ends every module that no running one depends on.
    fn end_what_may(&mut self, now: Instant, out: &mut Actions) {
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

    /// Tells the host how the critical modules are, where that is news.
    fn tell_health(&mut self, out: &mut Actions) {
        let sick = self.guards.iter().find(|guard| guard.config.critical && !guard.is_healthy());
        let run = self.guards.iter().filter(|guard| guard.state == State::Run).count();
        let status = match sick {
            Some(guard) if !self.ending => format!("{} does not run", guard.config.name),
            _ if self.ending => "ending".into(),
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
        let processes = self.guards.iter().map(|guard| guard.process(now)).collect();
        out.publish(common::DataProcesses { timestamp: out.timestamp(now), processes });
    }
}

/// A process hangs: it is told, then ended, whatever it says.
fn hangs(now: Instant, guard: &mut Guard, why: &str, out: &mut Actions) {
    if sabotage::is(Bug::WatchdogDeaf) {
        return;
    }
    let name = &guard.config.name;
    out.raise(Severity::Error, Fault::ModuleHung, name.as_str(), format!("{name} hangs, {why}: it is ended"));
    guard.end(now, HANG_GRACE, out);
    guard.state = State::Unknown;
    if sabotage::is(Bug::TwoProcesses) {
        guard.on_down(now, Duration::ZERO);
    }
}

/// It was restarted too often: told once, until it has lived for a while.
fn storms(guard: &Guard, out: &mut Actions) {
    let name = &guard.config.name;
    let message = format!("{name} ends again and again: further restarts are not told, until it lives");
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
        if now.since(self.now) >= HELD_UP {
            for guard in &mut self.guards {
                guard.heard = now;
            }
        }
        self.now = now;
        if let Event::Process(event @ ProcessEvent::Earlier { .. }) = event {
            // Before the start nothing is sent.
            self.on_process(now, &event, out);
            return;
        }
        match event {
            Event::Start => {
                self.on_start(now, out);
                out.working();
                self.start_what_may(now, out);
            }
            Event::Message { message, .. } => self.on_message(now, message, out),
            Event::Process(event) => self.on_process(now, &event, out),
            Event::Timer => self.on_timer(now, out),
            Event::State(State::Terminate) => {
                self.ending = true;
                self.changed = true;
                self.end_what_may(now, out);
            }
            Event::State(_) | Event::Heard { .. } | Event::Port { .. } => {}
        }
        if self.changed {
            self.changed = false;
            for guard in self.guards.iter_mut().filter(|guard| !guard.stranger) {
                guard.remember(out);
            }
            self.tell_health(out);
            self.publish_processes(now, out);
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        // A module that waits for its dependencies, not for time, is looked at when they change and at each check.
        let guards = self.guards.iter().filter_map(Guard::poll_timeout).filter(|due| *due > self.now).min();
        earliest([self.deadlines.next(), guards])
    }

    fn finished(&self) -> bool {
        self.guards.iter().all(|guard| guard.phase.pid().is_none() && !matches!(guard.phase, Phase::Spawning { .. }))
    }
}
