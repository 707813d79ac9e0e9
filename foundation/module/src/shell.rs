//! Common part of all modules: state machine, announcement, state commands, reports, list of active faults, texts, end.

use crate::call::{Call, CallLog};
use crate::texts::{self, Texts};
use crate::{Action, Actions, Cause, Condition, Event, Levels, Module, State, exit};
use base::{Deadlines, Duration, Fault, Instant, Level, Report, Severity};
use messages::{Channel, Message, common, source_in_words};
use std::collections::BTreeMap;
use std::mem;

/// Period of announcing the state and listing the active faults, both also at every change.
const ANNOUNCE_PERIOD: Duration = Duration::from_secs(1);
/// Maximum number of different active faults: the oldest are kept, further ones are not published.
const FAULTS_MAX: usize = 256;

/// Settings of a shell.
#[derive(Clone, Debug)]
pub struct ShellConfig {
    /// Name of the module: `driver_canbus`.
    pub name: String,
    /// State after INIT: RUN, or the one that an operator wanted before a restart. Other values count as RUN.
    pub wanted: State,
    /// Reports of at least this severity are published on `CM_EVENT_ERROR` and printed, and so is the end of such a
    /// fault; others are dropped. The list on `CM_DATA_FAULTS` contains all active faults, whatever their severity.
    pub report_from: Severity,
    /// Lowest level of texts and reports that are printed, until a command changes it; `None`: `report_from` for
    /// reports, INFO for texts.
    pub print_from: Option<Level>,
    /// Lowest level of texts and reports that are published, until a command changes it; `None`: `report_from` for
    /// reports, INFO for texts.
    pub send_from: Option<Level>,
    /// True if it follows commands to module `*` (the watchdog does not).
    pub obeys_all: bool,
    /// Maximum duration of the end after TERMINATE, finished or not.
    pub end_within: Duration,
}

impl ShellConfig {
    /// Settings of a module in RUN that publishes all reports and follows commands to all.
    #[must_use]
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            wanted: State::Run,
            report_from: Severity::Notice,
            print_from: None,
            send_from: None,
            obeys_all: true,
            end_within: Duration::from_secs(2),
        }
    }
}

base::deadlines! {
    /// Deadlines of a shell.
    enum Timer {
        /// The next announcement of the state.
        Announce,
        /// The latest end after TERMINATE.
        End,
        /// The deadline of the module inside, as it was after its last event.
        Module,
    }
}

/// A module together with the common part; the unit that a host runs.
pub struct Shell {
    config: ShellConfig,
    module: Box<dyn Module>,
    state: State,
    /// State from which ERROR was entered.
    before_error: State,
    /// Last reported condition of the module.
    failed: bool,
    deadlines: Deadlines<Timer>,
    /// The active faults, each with its subject.
    faults: BTreeMap<(Fault, String), ActiveFault>,
    /// The list of active faults is to be published at the end of this call.
    list_due: bool,
    texts: Texts,
    /// Thresholds of texts and reports.
    levels: Levels,
    /// Refused commands for the thresholds since the last report of one, and the time of that report.
    refused_levels: (u32, Option<Instant>),
    /// Buffer for the module's actions.
    inner: Actions,
    ending: Ending,
    recorder: Option<Box<dyn CallLog>>,
}

/// An active fault.
#[derive(Clone, Debug)]
struct ActiveFault {
    /// Severity of the last raise.
    severity: Severity,
    /// Time of the first raise, µs since the UNIX epoch.
    since: i64,
    /// Message of the last raise.
    message: String,
    /// Its report was printed and published; the report of its end is treated alike.
    printed: bool,
    sent: bool,
}

/// Progress of the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ending {
    No,
    Begun,
    Done,
}

impl Shell {
    /// Creates a shell around `module`, in INIT. `out` of later calls must have the same epoch as the first.
    #[must_use]
    pub fn new(config: ShellConfig, module: Box<dyn Module>) -> Self {
        let mut deadlines = Deadlines::new().with(Timer::Announce, Instant::ZERO);
        deadlines.replace(Timer::Module, module.poll_timeout());
        let levels = Levels::new(config.print_from, config.send_from);
        Self {
            config,
            module,
            state: State::Init,
            before_error: State::Init,
            failed: false,
            deadlines,
            faults: BTreeMap::new(),
            list_due: false,
            texts: Texts::default(),
            levels,
            refused_levels: (0, None),
            inner: Actions::default(),
            ending: Ending::No,
            recorder: None,
        }
    }

    /// Records all further calls and answers; to be called before anything else.
    pub fn record(&mut self, recorder: impl CallLog + 'static) {
        self.recorder = Some(Box::new(recorder));
    }

    /// True if part of the record is missing because it did not fit; the host reports that.
    #[must_use]
    pub fn has_lost_inputs(&self) -> bool {
        self.recorder.as_ref().is_some_and(|recorder| recorder.has_gaps())
    }

    /// Name of the module.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.config.name
    }

    /// Current state.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// True if printed reports name the place in the source where they were made: while it prints from DEBUG.
    #[must_use]
    pub fn prints_places(&self) -> bool {
        self.levels.print() == Some(Level::Debug)
    }

    /// The module inside, for its ports and subscriptions.
    #[must_use]
    pub fn module(&self) -> &dyn Module {
        &*self.module
    }

    /// Channels that the host subscribes to, so that other messages need not be decoded: commands for the
    /// state and for the levels, and the module's channels. A channel may be listed twice.
    pub fn subscriptions(&self) -> impl Iterator<Item = Channel> {
        [Channel::CmCmdState, Channel::CmCmdLevel].into_iter().chain(self.module.subscriptions().iter().copied())
    }

    /// True if `channel` is among [`Shell::subscriptions`].
    #[must_use]
    pub fn wants(&self, channel: Channel) -> bool {
        self.subscriptions().any(|subscribed| subscribed == channel)
    }

    /// Processes one event; messages on channels without a subscription are ignored. Pushes actions for the host:
    /// `Publish`, `Send`, `Report`, `Note`, `Process`, `State`, and `Exit` last.
    pub fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        self.recorded(now, &Call::Event(event), out, |shell, out| shell.dispatch(now, event, out));
    }

    /// Passes a call and its result to the recorder.
    fn recorded(&mut self, now: Instant, call: &Call<'_>, out: &mut Actions, f: impl FnOnce(&mut Self, &mut Actions)) {
        let before = out.as_slice().len();
        let Some(mut recorder) = self.recorder.take().filter(|_| self.ending != Ending::Done) else {
            f(self, out);
            return self.list_faults(now, before, out);
        };
        recorder.call(now, out.epoch(), call);
        f(self, out);
        self.list_faults(now, before, out);
        recorder.answer(&out.as_slice()[before..], self.poll_timeout());
        self.recorder = Some(recorder);
    }

    fn dispatch(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        if self.ending == Ending::Done {
            return;
        }
        match event {
            Event::Start => {
                // At full seconds of the machine's clock: idle modules wake up together, and the receivers once for all.
                self.deadlines.set(Timer::Announce, Instant::ZERO.next_on_grid(now, ANNOUNCE_PERIOD));
                out.push(Action::State(self.state));
                self.announce(now, out);
                self.list_due = true;
                self.call_module(now, Event::Start, out);
            }
            Event::Timer => {
                if self.deadlines.tick(Timer::Announce, now, ANNOUNCE_PERIOD) {
                    self.announce(now, out);
                    self.list_due = true;
                    self.publish_omitted(now, out);
                }
                if self.deadlines.is_due(Timer::Module, now) {
                    self.call_module(now, Event::Timer, out);
                }
            }
            Event::Message { message, .. } => {
                if self.module.subscriptions().contains(&message.channel()) {
                    self.call_module(now, event, out);
                }
                match message {
                    Message::CmCmdState(command) => self.on_state_command(now, command, out),
                    Message::CmCmdLevel(command) => self.on_level_command(now, command, out),
                    _ => {}
                }
            }
            other => self.call_module(now, other, out),
        }
        if self.ending == Ending::Begun && (self.module.finished() || self.deadlines.is_due(Timer::End, now)) {
            self.ending = Ending::Done;
            self.publish_omitted(now, out);
            self.deadlines.clear_all();
            out.push(Action::Exit(exit::OK));
        }
    }

    /// The process was asked to end (SIGTERM, Ctrl-C): treated as a TERMINATE command.
    pub fn terminate(&mut self, now: Instant, out: &mut Actions) {
        self.recorded(now, &Call::Terminate, out, |shell, out| {
            if shell.state != State::Terminate {
                shell.enter(now, State::Terminate, out);
                shell.dispatch(now, Event::Timer, out);
            }
        });
    }

    /// Raises a fault found by the host: reported once until [`Shell::clear`].
    pub fn raise(&mut self, now: Instant, report: Report, out: &mut Actions) {
        self.recorded(now, &Call::Raise(&report), out, |shell, out| {
            shell.fault(now, &report, out);
            shell.call(now, out, |module, out| module.handle_host_fault(now, report.fault, true, out));
        });
    }

    fn fault(&mut self, now: Instant, report: &Report, out: &mut Actions) {
        let key = (report.fault, report.subject.clone());
        if let Some(active) = self.faults.get_mut(&key) {
            // A new severity is published at once. A message may differ in each raise: it waits for the next list.
            self.list_due |= active.severity != report.severity;
            active.severity = report.severity;
            if active.message != report.message {
                active.message.clone_from(&report.message);
            }
        } else if self.faults.len() < FAULTS_MAX {
            let severity = report.severity;
            let active = ActiveFault {
                severity,
                since: out.timestamp(now),
                message: report.message.clone(),
                printed: self.prints(severity),
                sent: self.sends(severity),
            };
            let (sent, printed) = (active.sent, active.printed);
            self.faults.insert(key, active);
            self.list_due = true;
            self.report(now, report.clone(), sent, printed, out);
        }
    }

    /// Clears a fault found by the host; its end is reported if its begin was.
    pub fn clear(&mut self, now: Instant, report: Report, out: &mut Actions) {
        self.recorded(now, &Call::Clear(&report), out, |shell, out| {
            shell.clear_fault(now, &report, out);
            shell.call(now, out, |module, out| module.handle_host_fault(now, report.fault, false, out));
        });
    }

    fn clear_fault(&mut self, now: Instant, report: &Report, out: &mut Actions) {
        let Some(active) = self.faults.remove(&(report.fault, report.subject.clone())) else { return };
        self.list_due = true;
        self.report(now, report.clone(), active.sent, active.printed, out);
    }

    /// Adds a text of the host, in the module's name.
    pub fn say(&mut self, now: Instant, level: Level, text: &str, out: &mut Actions) {
        self.recorded(now, &Call::Say(level, text), out, |shell, out| shell.text(now, level, text.into(), out));
    }

    fn text(&mut self, now: Instant, level: Level, text: String, out: &mut Actions) {
        if level >= self.levels.send().unwrap_or(Level::Info)
            && let Some(message) = self.texts.take(now, out.timestamp(now), &self.config.name, level, &text)
        {
            out.publish(message);
        }
        if level >= self.levels.print().unwrap_or(Level::Info) {
            out.push(Action::Note(level, text));
        }
    }

    fn publish_omitted(&mut self, now: Instant, out: &mut Actions) {
        if let Some(message) = self.texts.left_out(now, out.timestamp(now), &self.config.name) {
            out.publish(message);
        }
    }

    /// Publishes the list of active faults if it is due, before the reports of the current call, so that a reader knows
    /// the subject of each report.
    fn list_faults(&mut self, now: Instant, before: usize, out: &mut Actions) {
        if !mem::take(&mut self.list_due) {
            return;
        }
        let faults = self.faults.iter().map(|((fault, subject), active)| common::Fault {
            number: i32::from(*fault as u16),
            subject: texts::clipped(subject),
            severity: active.severity as i8,
            since: active.since,
            message: texts::clipped(&active.message),
        });
        let (timestamp, module) = (out.timestamp(now), self.config.name.clone());
        let list = common::DataFaults { timestamp, module, faults: faults.collect() };
        out.insert(before, Action::Publish(list.into()));
    }

    /// Deadline of the next `Event::Timer`.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.deadlines.next()
    }

    fn call_module(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        self.call(now, out, |module, out| module.handle(now, event, out));
    }

    fn call(&mut self, now: Instant, out: &mut Actions, f: impl FnOnce(&mut dyn Module, &mut Actions)) {
        let before = out.as_slice().len();
        f(&mut *self.module, out);
        self.deadlines.replace(Timer::Module, self.module.poll_timeout());
        if !out.as_slice()[before..].iter().any(is_for_the_shell) {
            return;
        }
        // Entering a state calls the module again, with another list.
        let mut inner = mem::take(&mut self.inner);
        out.split_off(before, &mut inner);
        for action in inner.drain() {
            match action {
                Action::Raise(report) => self.fault(now, &report, out),
                Action::Clear(report) => self.clear_fault(now, &report, out),
                Action::Report(report) => self.publish_report(now, report, out),
                Action::Note(level, text) => self.text(now, level, text, out),
                Action::Condition(condition) => self.on_condition(now, condition, out),
                other => out.push(other),
            }
        }
        self.inner = inner;
    }

    fn on_condition(&mut self, now: Instant, condition: Condition, out: &mut Actions) {
        self.failed = condition == Condition::Failed;
        let next = match (condition, self.state) {
            (Condition::Working, State::Init) => self.wanted(),
            (Condition::Working, State::Error) => match self.before_error {
                State::Init => self.wanted(),
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

    fn on_state_command(&mut self, now: Instant, command: &common::CmdState, out: &mut Actions) {
        let all = command.module == "*" && self.config.obeys_all;
        if !all && command.module != self.config.name {
            return;
        }
        let cause = if command.manual { Cause::Manual } else { Cause::Command };
        match State::from_value(command.state) {
            Some(to) if to == self.state => {}
            Some(to) if self.state.allows(to, cause) => {
                if self.state == State::Init {
                    self.config.wanted = to;
                }
                self.enter(now, to, out);
                // It left ERROR through STOP; its device is still lost.
                if self.failed && matches!(self.state, State::Run | State::Pause) {
                    self.before_error = self.state;
                    self.enter(now, State::Error, out);
                }
            }
            Some(to) => {
                let manner = if command.manual { "manual " } else { "" };
                let by = source_in_words(&command.source);
                let message = format!("{manner}command {to} from {by} refused in {}", self.state);
                self.publish_report(now, Report::new(Severity::Warning, Fault::CommandForbidden, "", message), out);
            }
            None => {
                let by = source_in_words(&command.source);
                let message = format!("command from {by} refused: {} is not a state", command.state);
                self.publish_report(now, Report::new(Severity::Warning, Fault::CommandForbidden, "", message), out);
            }
        }
    }

    /// Changes the thresholds, and answers with those that apply.
    fn on_level_command(&mut self, now: Instant, command: &common::CmdLevel, out: &mut Actions) {
        if !Levels::are_meant(command, &self.config.name) {
            return;
        }
        match self.levels.obey(command) {
            Ok(changed) => {
                let answer = self.levels.answer(out.timestamp(now), &self.config.name);
                if changed {
                    let name = |value| Level::from_value(value).unwrap_or(Level::Info).name();
                    let (print, send) = (name(answer.print_from), name(answer.send_from));
                    let by = source_in_words(&command.source);
                    self.text(now, Level::Info, format!("prints from {print}, sends from {send}, by {by}"), out);
                }
                out.publish(answer);
            }
            Err(value) => self.refuse_level(now, value, &command.source, out),
        }
    }

    /// Counts a refused command for the thresholds; at most one report each second.
    fn refuse_level(&mut self, now: Instant, value: i8, source: &str, out: &mut Actions) {
        let (count, last) = (self.refused_levels.0.saturating_add(1), self.refused_levels.1);
        if last.is_some_and(|at| now.since(at) < ANNOUNCE_PERIOD) {
            self.refused_levels.0 = count;
            return;
        }
        self.refused_levels = (0, Some(now));
        let more = if count > 1 { format!("; {count} refused since the last report") } else { String::new() };
        let message = format!("command from {} refused: {value} is not a level{more}", source_in_words(source));
        self.publish_report(now, Report::new(Severity::Warning, Fault::CommandForbidden, "", message), out);
    }

    fn prints(&self, severity: Severity) -> bool {
        self.levels.print().map_or(severity >= self.config.report_from, |from| severity.level() >= from)
    }

    fn sends(&self, severity: Severity) -> bool {
        self.levels.send().map_or(severity >= self.config.report_from, |from| severity.level() >= from)
    }

    fn enter(&mut self, now: Instant, state: State, out: &mut Actions) {
        self.state = state;
        if state == State::Terminate {
            self.ending = Ending::Begun;
            self.deadlines.set(Timer::End, now + self.config.end_within);
        }
        out.push(Action::State(state));
        self.announce(now, out);
        self.call_module(now, Event::State(state), out);
    }

    fn announce(&self, now: Instant, out: &mut Actions) {
        out.publish(common::DataState {
            timestamp: out.timestamp(now),
            module: self.config.name.clone(),
            state: self.state as i8,
        });
    }

    fn publish_report(&self, now: Instant, report: Report, out: &mut Actions) {
        let (sent, printed) = (self.sends(report.severity), self.prints(report.severity));
        self.report(now, report, sent, printed, out);
    }

    fn report(&self, now: Instant, report: Report, sent: bool, printed: bool, out: &mut Actions) {
        if sent {
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
        }
        if printed {
            out.push(Action::Report(report));
        }
    }
}

fn is_for_the_shell(action: &Action) -> bool {
    matches!(action, Action::Raise(_) | Action::Clear(_) | Action::Report(_) | Action::Note(..) | Action::Condition(_))
}
