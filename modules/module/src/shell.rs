//! What all modules share, done around them once: the state machine, its announcement, commands, reports, the end.

use crate::record::{Call, Recorder};
use crate::sabotage::{self, Bug};
use crate::{Action, Actions, Cause, Condition, Event, Module, State, exit};
use base::{Duration, Fault, Instant, Report, Severity, Ticker};
use messages::{Channel, Message, common};
use std::collections::BTreeMap;
use std::mem;

/// The state is announced this often, and at every change.
const ANNOUNCE: Duration = Duration::from_secs(1);
/// More different faults than this at once are not told apart: the oldest stay, further ones are not sent.
const FAULTS_MAX: usize = 256;

/// How a shell treats its module.
#[derive(Clone, Debug)]
pub struct ShellConfig {
    /// The module's name: `driver_canbus`.
    pub name: String,
    /// The state after INIT: RUN, or what an operator wanted before a restart. Others count as RUN.
    pub wanted: State,
    /// Reports of at least this severity are sent on `CM_EVENT_ERROR` and printed, and so is the end of such a fault;
    /// others are dropped.
    pub report_from: Severity,
    /// Whether commands to module `*` are for it (for the watchdog they are not).
    pub obeys_all: bool,
    /// After TERMINATE it has ended within this time, finished or not.
    pub end_within: Duration,
}

impl ShellConfig {
    /// A module that wants to RUN, sends all reports and obeys commands to all.
    #[must_use]
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            wanted: State::Run,
            report_from: Severity::Notice,
            obeys_all: true,
            end_within: Duration::from_secs(2),
        }
    }
}

/// A module with what all modules share around it; what a host runs.
pub struct Shell {
    config: ShellConfig,
    module: Box<dyn Module>,
    state: State,
    /// Where ERROR was entered from.
    before_error: State,
    /// What the module said last of its device.
    failed: bool,
    announce: Ticker,
    /// Faults that stand, with the severity they were reported with.
    faults: BTreeMap<(Fault, String), Severity>,
    /// When the module wants its next timer: as it said after its last event, asked once.
    due: Option<Instant>,
    /// Room for what the module answers.
    inner: Actions,
    ending: Ending,
    recorder: Option<Recorder>,
}

/// How far the end has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ending {
    No,
    By(Instant),
    Done,
}

impl Shell {
    /// A shell around `module`, in INIT. `out` of later calls must have the same epoch as the first.
    #[must_use]
    pub fn new(config: ShellConfig, module: Box<dyn Module>) -> Self {
        Self {
            config,
            due: module.poll_timeout(),
            module,
            state: State::Init,
            before_error: State::Init,
            failed: false,
            announce: Ticker::new(Instant::ZERO, ANNOUNCE),
            faults: BTreeMap::new(),
            inner: Actions::default(),
            ending: Ending::No,
            recorder: None,
        }
    }

    /// Writes down from now on what it is told and what it answers; to be called before anything else.
    pub fn record(&mut self, recorder: Recorder) {
        self.recorder = Some(recorder);
    }

    /// Whether some of what it was told is not written down, for want of room: the host reports that.
    #[must_use]
    pub fn has_lost_inputs(&self) -> bool {
        self.recorder.as_ref().is_some_and(Recorder::has_gaps)
    }

    /// The module's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.config.name
    }

    /// The state it is in.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// The module inside, for its ports and subscriptions.
    #[must_use]
    pub fn module(&self) -> &dyn Module {
        &*self.module
    }

    /// Whether it wants messages of this channel.
    #[must_use]
    pub fn wants(&self, channel: Channel) -> bool {
        channel == Channel::CmCmdState || self.module.subscriptions().contains(&channel)
    }

    /// Takes one event; pushes what the host is to do: `Publish`, `Send`, `Report`, `Note`, `Process`,
    /// `State`, and `Exit` last.
    pub fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        self.recorded(now, &Call::Event(event), out, |shell, out| shell.take(now, event, out));
    }

    /// Lets the recorder see a call and what follows from it.
    fn recorded(&mut self, now: Instant, call: &Call<'_>, out: &mut Actions, f: impl FnOnce(&mut Self, &mut Actions)) {
        let Some(mut recorder) = self.recorder.take().filter(|_| self.ending != Ending::Done) else {
            return f(self, out);
        };
        recorder.call(now, out.epoch(), call);
        let before = out.as_slice().len();
        f(self, out);
        recorder.answer(&out.as_slice()[before..], self.poll_timeout());
        self.recorder = Some(recorder);
    }

    fn take(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        if self.ending == Ending::Done {
            return;
        }
        match event {
            Event::Start => {
                self.announce = Ticker::new(now + ANNOUNCE, ANNOUNCE);
                out.push(Action::State(self.state));
                self.announce(now, out);
                self.pass(now, Event::Start, out);
            }
            Event::Timer => {
                if self.announce.due(now) {
                    self.announce(now, out);
                }
                if self.due.is_some_and(|due| due <= now) {
                    self.pass(now, Event::Timer, out);
                }
            }
            Event::Message { at, message } => {
                if self.module.subscriptions().contains(&message.channel()) {
                    self.pass(now, Event::Message { at, message }, out);
                }
                if let Message::CmCmdState(command) = message {
                    self.obey(now, command, out);
                }
            }
            other => self.pass(now, other, out),
        }
        if let Ending::By(end) = self.ending
            && (self.module.finished() || end <= now)
        {
            self.ending = Ending::Done;
            out.push(Action::Exit(exit::OK));
        }
    }

    /// The process was asked to end (SIGTERM, Ctrl-C): as a TERMINATE command.
    pub fn terminate(&mut self, now: Instant, out: &mut Actions) {
        self.recorded(now, &Call::Terminate, out, |shell, out| {
            if shell.state != State::Terminate {
                shell.enter(now, State::Terminate, out);
                shell.take(now, Event::Timer, out);
            }
        });
    }

    /// A fault that the host found: reported once until [`Shell::clear`].
    pub fn raise(&mut self, now: Instant, report: Report, out: &mut Actions) {
        self.recorded(now, &Call::Raise(&report), out, |shell, out| shell.fault(now, &report, out));
    }

    fn fault(&mut self, now: Instant, report: &Report, out: &mut Actions) {
        let key = (report.fault, report.subject.clone());
        if self.faults.len() < FAULTS_MAX && !self.faults.contains_key(&key) {
            self.faults.insert(key, report.severity);
            self.send(now, report.clone(), out);
        }
    }

    /// A fault that the host found stands no more; who was told of it is told of its end.
    pub fn clear(&mut self, now: Instant, report: Report, out: &mut Actions) {
        self.recorded(now, &Call::Clear(&report), out, |shell, out| shell.fault_over(now, &report, out));
    }

    fn fault_over(&mut self, now: Instant, report: &Report, out: &mut Actions) {
        let raised = self.faults.remove(&(report.fault, report.subject.clone()));
        if raised.is_some_and(|severity| severity >= self.config.report_from) {
            self.tell(now, report.clone(), out);
        }
    }

    /// When it wants the next `Event::Timer`.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let shell = match self.ending {
            Ending::No => self.announce.next(),
            Ending::By(end) => self.announce.next().min(end),
            Ending::Done => return None,
        };
        Some(self.due.map_or(shell, |due| due.min(shell)))
    }

    fn pass(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        let before = out.as_slice().len();
        self.module.handle(now, event, out);
        self.due = self.module.poll_timeout();
        if !out.as_slice()[before..].iter().any(is_for_the_shell) {
            return;
        }
        // Entering a state on the way calls the module again, with a list of its own.
        let mut inner = mem::take(&mut self.inner);
        out.split_off(before, &mut inner);
        for action in inner.drain() {
            match action {
                Action::Raise(report) => self.fault(now, &report, out),
                Action::Clear(report) => self.fault_over(now, &report, out),
                Action::Report(report) => self.send(now, report, out),
                Action::Condition(condition) => self.condition(now, condition, out),
                other => out.push(other),
            }
        }
        self.inner = inner;
    }

    fn condition(&mut self, now: Instant, condition: Condition, out: &mut Actions) {
        self.failed = condition == Condition::Failed;
        let next = match (condition, self.state) {
            (Condition::Working, State::Init) => self.wanted(),
            (Condition::Working, State::Error) => match self.before_error {
                State::Init => self.wanted(),
                State::Stop if sabotage::is(Bug::StopLeftByError) => State::Run,
                before => before,
            },
            (Condition::Failed, state) if state.allows(State::Error, Cause::Itself) => {
                self.before_error = state;
                State::Error
            }
            _ => return,
        };
        self.enter(now, next, out);
    }

    fn wanted(&self) -> State {
        match self.config.wanted {
            wanted @ (State::Pause | State::Stop) => wanted,
            _ => State::Run,
        }
    }

    fn obey(&mut self, now: Instant, command: &common::CmdState, out: &mut Actions) {
        let all = command.module == "*" && self.config.obeys_all;
        if !all && command.module != self.config.name {
            return;
        }
        let cause = if command.manual || sabotage::is(Bug::StopLeft) { Cause::Manual } else { Cause::Command };
        match State::from_value(command.state) {
            Some(to) if to == self.state => {}
            Some(to) if self.state.allows(to, cause) => {
                if self.state == State::Init {
                    self.config.wanted = to;
                }
                self.enter(now, to, out);
                // It was led through STOP out of ERROR; its device is lost as before.
                if self.failed && matches!(self.state, State::Run | State::Pause) {
                    self.before_error = self.state;
                    self.enter(now, State::Error, out);
                }
            }
            Some(to) => {
                let manner = if command.manual { "manual " } else { "" };
                let message = format!("{manner}command {to} from {} refused in {}", command.source, self.state);
                self.send(now, Report::new(Severity::Warning, Fault::CommandForbidden, "", message), out);
            }
            None => {
                let message = format!("command from {} refused: {} is no state", command.source, command.state);
                self.send(now, Report::new(Severity::Warning, Fault::CommandForbidden, "", message), out);
            }
        }
    }

    fn enter(&mut self, now: Instant, state: State, out: &mut Actions) {
        self.state = state;
        if state == State::Terminate {
            self.ending = Ending::By(now + self.config.end_within);
        }
        out.push(Action::State(state));
        self.announce(now, out);
        self.pass(now, Event::State(state), out);
    }

    fn announce(&self, now: Instant, out: &mut Actions) {
        out.publish(common::DataState {
            timestamp: out.timestamp(now),
            module: self.config.name.clone(),
            state: self.state as i8,
        });
    }

    fn send(&self, now: Instant, report: Report, out: &mut Actions) {
        if report.severity >= self.config.report_from {
            self.tell(now, report, out);
        }
    }

    fn tell(&self, now: Instant, report: Report, out: &mut Actions) {
        out.publish(common::Error {
            timestamp: out.timestamp(now),
            module: self.config.name.clone(),
            number: i32::from(report.fault as u16),
            message: report.message.clone(),
            fatal: report.fatal,
            r#type: report.fault.kind() as i8,
            severity: report.severity as i8,
            file: report.location.file.clone().into_owned(),
            line: i32::try_from(report.location.line).unwrap_or(i32::MAX),
        });
        out.push(Action::Report(report));
    }
}

fn is_for_the_shell(action: &Action) -> bool {
    matches!(action, Action::Raise(_) | Action::Clear(_) | Action::Report(_) | Action::Condition(_))
}
