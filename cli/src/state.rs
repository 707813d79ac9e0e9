//! `advee state [MODULE [STATE]]`: shows what modules do and their active faults, or commands one as an operator.

use super::bus::{Heard, Tool, error_of};
use super::{Common, Failed, Outcome, print};
use base::{Duration, Fault as Code};
use diagnostics::orders;
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

/// Modules announce themselves once a second.
const LISTEN: Duration = Duration::from_millis(1200);
/// A command must have been obeyed within this time: a module may have to be started.
const OBEY: Duration = Duration::from_secs(5);

pub fn state(common: &Common, command: &State) -> Outcome {
    let channels = [Channel::CmDataState, Channel::CmDataProcesses, Channel::CmDataFaults, Channel::CmEventError];
    let mut tool = Tool::join(common, "state", &channels)?;
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

fn listen(tool: &mut Tool) -> Result<BTreeMap<String, Row>, Failed> {
    let until = clock::now() + LISTEN;
    let mut rows: BTreeMap<String, Row> = BTreeMap::new();
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::CmDataState(state)) => {
                rows.entry(state.module).or_default().announced = Value::from_value(state.state);
            }
            Heard::Message(Message::CmDataProcesses(DataProcesses { processes, .. })) => {
                for process in processes {
                    let name = process.module.clone();
                    rows.entry(name).or_default().process = Some(process);
                }
            }
            Heard::Message(Message::CmDataFaults(list)) => {
                let name = list.module.clone();
                rows.entry(name).or_default().list = Some(list);
            }
            Heard::Message(_) => {}
            Heard::Nothing => return Ok(rows),
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
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
            Some(_) => "TERMINATED",
        }
    }

    fn line(&self, module: &str) -> String {
        let head = format!("{module:16} {:10} {:11}", self.state().name(), self.phase());
        let Some(process) = &self.process else {
            return head.trim_end().into();
        };
        let wanted = Value::from_value(process.wanted).unwrap_or(Value::Unknown).name();
        let (restarts, last) = (process.restarts, process.last_exit);
        let (cpu, rss) = (process.cpu * 100.0, process.rss as f64 / (1024.0 * 1024.0));
        format!("{head} {wanted:9} {:7} {restarts:8} {last:9} {:8.1} {cpu:6.1} {rss:7.1}", process.pid, process.uptime)
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
    let mut rows = listen(tool)?;
    if let Some(module) = module {
        rows.retain(|name, _| name == module);
    }
    if rows.is_empty() {
        let who = module.unwrap_or("no module");
        let what = if module.is_some() { "is not heard" } else { "is heard" };
        return Err(format!("{who} {what} on {}; is advee up?", common.lcm_url()).into());
    }
    if json {
        let all: serde_json::Map<_, _> = rows.iter().map(|(name, row)| (name.clone(), row.json())).collect();
        print(serde_json::Value::from(all))?;
        return Ok(ExitCode::SUCCESS);
    }
    print("MODULE           STATE      PHASE       WANTED        PID RESTARTS LAST EXIT UPTIME s  CPU % RSS MiB")?;
    for (name, row) in &rows {
        print(row.line(name))?;
    }
    let lines: Vec<String> = rows.iter().flat_map(|(name, row)| row.fault_lines(name)).collect();
    if !lines.is_empty() {
        print("\nMODULE           ACTIVE FAULTS (times are UTC)")?;
    }
    lines.iter().try_for_each(print)?;
    Ok(ExitCode::SUCCESS)
}

/// Commands, and waits until all that are meant show the state, or one says no.
fn order(tool: &mut Tool, module: &str, state: Value) -> Outcome {
    let heard = listen(tool)?;
    let mut waiting: Vec<String> = match module {
        "*" => heard.keys().filter(|name| *name != watchdog::NAME).cloned().collect(),
        name => vec![name.into()],
    };
    if let Some(unknown) = waiting.iter().find(|name| !heard.contains_key(*name)) {
        return Err(format!("{unknown} is not heard; is advee up?").into());
    }
    if waiting.is_empty() {
        return Err("no module is heard; is advee up?".into());
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
