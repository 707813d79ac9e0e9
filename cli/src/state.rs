//! `advee state [MODULE [STATE]]`: shows what modules do, what the guard permits, and active faults; or commands one as
//! an operator.

use super::bus::{Heard, Tool, error_of};
use super::listen::{ANNOUNCED, Listener, OF_TIME};
use super::style::{GREEN, RED, Style};
use super::{Common, Failed, Outcome, duration, print};
use base::{Duration, Fault as Code, Instant};
use diagnostics::{Model, exit_in_words, orders};
use host::clock;
use host::log::{OneLine, TimeOfDay};
use messages::common::{DataFaults, DataProcesses, Error, Fault, Process};
use messages::{Channel, Message};
use module::State as Value;
use std::collections::BTreeMap;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct State {
    /// Which module
    module: Option<String>,
    /// The state to command: RUN, PAUSE, STOP or TERMINATE
    #[arg(value_parser = commanded, conflicts_with = "json")]
    state: Option<Value>,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

fn commanded(text: &str) -> Result<Value, String> {
    let state = Value::from_name(text);
    let state = state.filter(|state| matches!(state, Value::Run | Value::Pause | Value::Stop | Value::Terminate));
    state.ok_or_else(|| "expected RUN, PAUSE, STOP or TERMINATE".into())
}

/// A command must have been obeyed within this time: a module may have to be started.
const OBEY: Duration = Duration::from_secs(5);

pub fn state(common: &Common, command: &State) -> Outcome {
    let modules = [Channel::CmDataState, Channel::CmDataProcesses, Channel::CmDataFaults, Channel::CmEventError];
    let of_the_guard = [Channel::LlDataGuard, Channel::LlDataMotion, Channel::LlDataHold, OF_TIME];
    let mut tool = Tool::join(common, "state", &[&modules[..], &of_the_guard].concat())?;
    match (&command.module, command.state) {
        (Some(module), Some(state)) => order(&mut tool, module, state),
        (module, _) => show(common, &mut tool, module.as_deref(), command.json),
    }
}

/// A row: the announced state, the process if the watchdog guards it, and the last list of active faults.
#[derive(Default)]
struct Row {
    announced: Option<Value>,
    process: Option<Process>,
    list: Option<DataFaults>,
}

/// Rows by module, and what else was received.
fn listen(tool: &mut Tool) -> Result<(BTreeMap<String, Row>, Listener), Failed> {
    let mut rows: BTreeMap<String, Row> = BTreeMap::new();
    let mut listener = Listener::default();
    let is_over = listener.listen(tool, ANNOUNCED, |message| match message {
        Message::CmDataState(state) => {
            rows.entry(state.module.clone()).or_default().announced = Value::from_value(state.state);
        }
        Message::CmDataProcesses(DataProcesses { processes, .. }) => {
            for process in processes {
                rows.entry(process.module.clone()).or_default().process = Some(process.clone());
            }
        }
        Message::CmDataFaults(list) => rows.entry(list.module.clone()).or_default().list = Some(list.clone()),
        _ => {}
    })?;
    if is_over { Ok((rows, listener)) } else { Err("interrupted".into()) }
}

impl Row {
    /// What it announces; what the watchdog knows, where it announced nothing or has ended.
    fn state(&self) -> Value {
        let known = self.process.as_ref().and_then(|process| Value::from_value(process.state));
        match &self.process {
            Some(process) if process.phase == Process::TERMINATED => Value::Unknown,
            _ => self.announced.or(known).unwrap_or(Value::Unknown),
        }
    }

    fn phase(&self) -> &'static str {
        match self.process.as_ref().map(|process| process.phase) {
            None => "-",
            Some(Process::RUNNING) => "RUNNING",
            Some(Process::TERMINATING) => "TERMINATING",
            Some(Process::UNKNOWN) => "UNKNOWN",
            Some(_) => "TERMINATED",
        }
    }

    /// True if its process runs and it is in the state that is wanted; without a watchdog, if it has no error.
    fn is_well(&self) -> bool {
        match &self.process {
            Some(process) => process.phase == Process::RUNNING && self.state() as i8 == process.wanted,
            None => !matches!(self.state(), Value::Error | Value::Unknown),
        }
    }

    fn line(&self, module: &str, style: Style) -> String {
        let state = style.paint(if self.is_well() { GREEN } else { RED }, &format!("{:10}", self.state().name()));
        let head = format!("{module:16} {state} {:11}", self.phase().to_lowercase());
        let Some(process) = &self.process else {
            return head.trim_end().into();
        };
        let wanted = Value::from_value(process.wanted).unwrap_or(Value::Unknown).name();
        let (cpu, rss) = (process.cpu * 100.0, process.rss as f64 / (1024.0 * 1024.0));
        let (pid, restarts, uptime) = (process.pid, process.restarts, duration(process.uptime));
        // A process that has not ended yet has no last exit.
        let has_ended = restarts > 0 || process.phase == Process::TERMINATED;
        let last = if has_ended { exit_in_words(process.last_exit) } else { "-".into() };
        format!("{head} {wanted:9} {pid:7} {restarts:8} {uptime:>11} {cpu:6.1} {rss:7.1}  {last}")
    }

    /// Its active faults; none: not known.
    fn faults(&self) -> Option<&[Fault]> {
        self.list.as_ref().filter(|list| !list.is_down()).map(|list| list.faults.as_slice())
    }

    /// Lines about its active faults, or that they are not known.
    fn fault_lines(&self, module: &str) -> Vec<String> {
        match self.faults() {
            None => vec![format!("{module:16} not known")],
            Some(faults) => faults.iter().map(|fault| format!("{module:16} {}", fault_line(fault))).collect(),
        }
    }

    fn json(&self) -> serde_json::Value {
        let (state, phase) = (self.state().name(), self.phase());
        serde_json::json!({ "state": state, "phase": phase, "process": self.process, "faults": self.faults() })
    }
}

fn fault_line(fault: &Fault) -> String {
    let severity = match fault.severity {
        Error::NOTICE => "NOTICE",
        Error::WARNING => "WARNING",
        _ => "ERROR",
    };
    let since = TimeOfDay(u64::try_from(fault.since).unwrap_or_default().saturating_mul(1000));
    format!("{severity:7} {} since {since}: {}", OneLine(&fault.about()), OneLine(&fault.message))
}

fn show(common: &Common, tool: &mut Tool, module: Option<&str>, json: bool) -> Outcome {
    let (mut rows, listener) = listen(tool)?;
    if let Some(module) = module {
        rows.retain(|name, _| name == module);
    }
    if rows.is_empty() {
        let who = module.unwrap_or("no module");
        let what = if module.is_some() { "is not heard" } else { "is heard" };
        return Err(format!("{who} {what} on {}; {}", common.lcm_url(), listener.why_silent()).into());
    }
    listener.notice_pause();
    if json {
        let all: serde_json::Map<_, _> = rows.iter().map(|(name, row)| (name.clone(), row.json())).collect();
        print(serde_json::Value::from(all))?;
        return Ok(ExitCode::SUCCESS);
    }
    let style = Style::of_stdout();
    print("MODULE           STATE      PROCESS     WANTED        PID RESTARTS      UPTIME  CPU % RSS MiB  LAST EXIT")?;
    for (name, row) in &rows {
        print(row.line(name, style))?;
    }
    if module.is_none_or(|module| module == guard::NAME)
        && let Some(line) = bound_line(&listener.model, listener.now())
    {
        print(format_args!("\n{line}"))?;
    }
    let lines: Vec<String> = rows.iter().flat_map(|(name, row)| row.fault_lines(name)).collect();
    if !lines.is_empty() {
        print("\nMODULE           ACTIVE FAULTS (times are UTC)")?;
    }
    lines.iter().try_for_each(print)?;
    Ok(ExitCode::SUCCESS)
}

/// What the guard permits, and why; `None` for a robot without one.
fn bound_line(model: &Model, now: Instant) -> Option<String> {
    Some(format!("{:16} {}", "GUARD", OneLine(&model.bound(now)?.words)))
}

/// Commands, and waits until all that are meant show the state, or one says no.
fn order(tool: &mut Tool, module: &str, state: Value) -> Outcome {
    let (heard, listener) = listen(tool)?;
    let mut waiting: Vec<String> = match module {
        "*" => heard.keys().filter(|name| *name != watchdog::NAME).cloned().collect(),
        name => vec![name.into()],
    };
    if let Some(unknown) = waiting.iter().find(|name| !heard.contains_key(*name)) {
        return Err(format!("{unknown} is not heard; {}", listener.why_silent()).into());
    }
    if waiting.is_empty() {
        return Err(format!("no module is heard; {}", listener.why_silent()).into());
    }
    // What is down already will not announce that it ends.
    let down = |name: &String| heard.get(name).is_some_and(|row| row.phase() == "TERMINATED");
    waiting.retain(|name| !(state == Value::Terminate && down(name)));
    tool.publish(orders::manual(tool.timestamp(), module, state, &tool.source))?;
    let until = clock::now() + OBEY;
    while let Some(first) = waiting.first() {
        match tool.hear(until)? {
            Heard::Message(Message::CmDataState(announced)) if announced.state == state as i8 => {
                waiting.retain(|name| *name != announced.module);
            }
            Heard::Message(message) => {
                let refusal = |name: &String| {
                    error_of(&message, name).filter(|error| error.number == Code::CommandForbidden as i32)
                };
                if let Some((name, error)) = waiting.iter().find_map(|name| Some((name, refusal(name)?))) {
                    return Err(format!("{name}: {}", error.message).into());
                }
            }
            Heard::Nothing => {
                return Err(format!("{first} does not show {state} within {} s", OBEY.as_secs()).into());
            }
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
    print(format_args!("{module} {state}"))?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::lowlevel::{DataGuard, DataHold, Hold};

    #[test]
    fn a_row_is_in_words_and_coloured_by_whether_it_is_well() {
        let process = Process {
            module: "planner".into(),
            pid: 42,
            phase: Process::RUNNING,
            state: Value::Run as i8,
            wanted: Value::Run as i8,
            uptime: 1114.5,
            ..Process::default()
        };
        let mut row = Row { announced: Some(Value::Run), process: Some(process.clone()), list: None };
        let line = row.line("planner", Style { colour: false });
        assert_eq!(
            line,
            "planner          RUN        running     RUN            42        0      18 min    0.0     0.0  -"
        );
        assert!(row.line("planner", Style { colour: true }).contains("\x1b[32mRUN"));
        row.process = Some(Process { restarts: 1, last_exit: 137, ..process });
        row.announced = Some(Value::Error);
        let line = row.line("planner", Style { colour: true });
        assert!(line.contains("\x1b[1;31mERROR") && line.ends_with("SIGKILL: killed"), "{line}");
        let alone = Row { announced: Some(Value::Run), ..Row::default() };
        assert_eq!(alone.line("lights", Style { colour: false }), "lights           RUN        -");
    }

    #[test]
    fn the_bound_and_its_cause_are_one_line() {
        let mut model = Model::new(diagnostics::Config::default());
        let now = Instant::from_millis(1000);
        let hear = |model: &mut Model, message: Message| {
            model.receive(now, &message.channel_name(), 0, Some(message));
        };
        assert_eq!(bound_line(&model, now), None, "a robot without a guard");
        let (code, subject) = (messages::Hold::GuardStops.code(), "sonar\n3".into());
        let guard = DataGuard { forward: 0.32, backward: 0.8, code, subject, ..DataGuard::default() };
        hear(&mut model, guard.into());
        let line = bound_line(&model, now).unwrap();
        assert!(line.starts_with("GUARD            at most 0.32 m/s forward: sonar") && !line.contains('\n'), "{line}");
        let code = messages::Hold::GuardCreep.code();
        let holds = vec![Hold { code, subject: "gamepad".into(), latched: false, since: 0 }];
        hear(&mut model, DataHold { timestamp: 0, module: messages::MOTION_MODULE.into(), holds }.into());
        assert!(bound_line(&model, now).unwrap().contains("creeping; otherwise at most 0.32 m/s forward"));
    }
}
