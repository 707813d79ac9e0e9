//! `advee errors [MODULE] [--follow]`: the active faults of all modules, whenever they began; then every change.

use super::bus::Tool;
use super::listen::{ANNOUNCED, Listener, OF_TIME};
use super::{Common, Outcome, print};
use base::{Duration, Instant};
use diagnostics::{ErrorGroup, Knowledge, Model, ShownGroup};
use host::log::{OneLine, TimeOfDay};
use messages::Channel;
use messages::common::Error;
use serde_json::json;
use std::collections::BTreeMap;
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Errors {
    /// Only those of this module
    module: Option<String>,
    /// Print each change until Ctrl-C
    #[arg(long)]
    follow: bool,
    /// A JSON object for each fault; with --follow also for each change
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "Examples:
  advee errors                  what is active now
  advee errors --follow         and what begins and ends from now on
  advee errors driver_aux       of one module";

/// Interval at which it is looked whether lists have expired.
const LOOK: Duration = Duration::from_millis(500);

pub fn errors(common: &Common, command: &Errors) -> Outcome {
    let of_faults = [Channel::CmDataFaults, Channel::CmEventError];
    let of_modules = [Channel::CmDataState, Channel::CmDataProcesses, OF_TIME];
    let mut tool = Tool::join(common, "errors", &[&of_faults[..], &of_modules].concat())?;
    let mut listener = Listener::default();
    if !listener.listen(&mut tool, ANNOUNCED, |_| ())? {
        return Err("interrupted".into());
    }
    let (now, model) = (listener.now(), &listener.model);
    let is_wanted = |module: &str| command.module.as_deref().is_none_or(|wanted| wanted == module);
    let heard = model.modules(now);
    if !heard.iter().any(|row| is_wanted(&row.module)) {
        let who = command.module.as_deref().unwrap_or("no module");
        return Err(format!("{who} is not heard on {}; {}", common.lcm_url(), listener.why_silent()).into());
    }
    listener.notice_pause();
    let mut seen = Seen::default();
    let active = groups(model, now, command.module.as_deref());
    let active: Vec<_> = active.into_iter().filter(|group| group.standing).collect();
    if command.json {
        active.iter().try_for_each(|group| print(json!(group)))?;
    } else {
        let unknown = heard.iter().map(|row| row.module.as_str()).filter(|module| is_wanted(module));
        let unknown: Vec<_> =
            unknown.filter(|module| model.errors.knowledge(module, now) == Knowledge::Unknown).collect();
        list(&active, &unknown).iter().try_for_each(print)?;
    }
    if !command.follow {
        return Ok(ExitCode::SUCCESS);
    }
    drop(seen.changes(&groups(model, now, command.module.as_deref())));
    loop {
        if !listener.listen(&mut tool, LOOK, |_| ())? {
            return Ok(ExitCode::SUCCESS);
        }
        for (word, group) in seen.changes(&groups(&listener.model, listener.now(), command.module.as_deref())) {
            match command.json {
                true => print(json!({ "change": word.to_lowercase(), "fault": group })),
                false => print(line(word, &group)),
            }?;
        }
    }
}

fn groups<'a>(model: &'a Model, now: Instant, module: Option<&str>) -> Vec<ShownGroup<'a>> {
    let mut groups = model.errors.groups(now);
    groups.retain(|group| module.is_none_or(|module| module == group.module));
    groups
}

/// The table, and what is not known.
fn list(active: &[ShownGroup<'_>], unknown: &[&str]) -> Vec<String> {
    let mut lines = Vec::new();
    if active.is_empty() {
        lines.push("no fault is active".into());
    } else {
        lines.push("STATUS   SEVERITY SINCE (UTC) MODULE           FAULT".into());
    }
    lines.extend(active.iter().map(|group| {
        let since = time(group.last);
        let status = if group.known { "ACTIVE" } else { "UNKNOWN" };
        format!("{status:8} {:8} {since:11} {:16} {}", severity(group), module(group), what(group))
    }));
    if !unknown.is_empty() {
        lines.push(format!("not known: the faults of {}", OneLine(&unknown.join(", "))));
    }
    lines
}

/// A change, with the time of its report.
fn line(word: &str, group: &ErrorGroup) -> String {
    format!("{} {word:8} {:8} {:16} {}", time(group.last), severity(group), module(group), what(group))
}

fn module(group: &ErrorGroup) -> String {
    OneLine(&group.module).to_string()
}

fn what(group: &ErrorGroup) -> String {
    format!("{}: {}", OneLine(&group.about()), OneLine(&group.message))
}

fn severity(group: &ErrorGroup) -> &'static str {
    match group.severity {
        Error::NOTICE => "NOTICE",
        Error::WARNING => "WARNING",
        _ => "ERROR",
    }
}

/// Time of the day, to the second.
fn time(timestamp: i64) -> String {
    let mut text = TimeOfDay(u64::try_from(timestamp).unwrap_or_default().saturating_mul(1000)).to_string();
    text.truncate(8);
    text
}

/// What was shown of each fault.
#[derive(Default)]
struct Seen(BTreeMap<(String, i32, String), (bool, bool, u64)>);

impl Seen {
    /// What has changed, in words: a fault begins, is cleared or becomes unknown; a report that is no active fault.
    fn changes(&mut self, groups: &[ShownGroup<'_>]) -> Vec<(&'static str, ErrorGroup)> {
        let mut changes = Vec::new();
        for shown in groups {
            let key = (shown.module.clone(), shown.number, shown.subject.clone());
            let is = (shown.standing, shown.known, shown.count);
            let was = self.0.insert(key, is).unwrap_or((false, true, 0));
            let word = match (was, is) {
                ((false, ..), (true, true, _)) | ((true, false, _), (true, true, _)) => "ACTIVE",
                ((_, true, _), (true, false, _)) | ((false, ..), (true, false, _)) => "UNKNOWN",
                ((true, ..), (false, ..)) => "CLEARED",
                ((.., before), (.., count)) if count > before => "REPORTED",
                _ => continue,
            };
            changes.push((word, shown.group.clone()));
        }
        // Forgotten groups need no memory here.
        let known = |(module, number, subject): &(String, i32, String)| {
            groups.iter().any(|group| (&group.module, group.number, &group.subject) == (module, *number, subject))
        };
        self.0.retain(|key, _| known(key));
        changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Message;
    use messages::common::{DataFaults, Fault};

    fn at(millis: u64) -> Instant {
        Instant::from_millis(10_000 + millis)
    }

    fn lists(model: &mut Model, millis: u64, faults: Vec<Fault>) {
        let message = Message::from(DataFaults { timestamp: 7, module: "driver_aux".into(), faults });
        model.receive(at(millis), &message.channel_name(), 0, Some(message));
    }

    fn stalled() -> Fault {
        let number = base::Fault::FanFailed as i32;
        Fault { number, subject: "fan1".into(), severity: Error::ERROR, since: 3_600_000_000, message: "a\nb".into() }
    }

    fn shown(model: &Model, millis: u64, seen: &mut Seen) -> Vec<String> {
        let changes = seen.changes(&model.errors.groups(at(millis)));
        changes.into_iter().map(|(word, group)| line(word, &group)).collect()
    }

    #[test]
    fn a_fault_is_listed_that_began_before_anybody_listened_and_its_end_is_a_change() {
        let (mut model, mut seen) = (Model::new(diagnostics::Config::default()), Seen::default());
        lists(&mut model, 0, vec![stalled()]);
        let lines = list(&model.errors.groups(at(0)), &["planner"]);
        assert!(lines[1].starts_with("ACTIVE   ERROR    01:00:00    driver_aux       FanFailed fan1: a"), "{lines:?}");
        assert!(!lines[1].contains('\n') && lines[2] == "not known: the faults of planner", "{lines:?}");
        assert!(shown(&model, 0, &mut seen)[0].starts_with("01:00:00 ACTIVE   ERROR    driver_aux "));
        lists(&mut model, 1000, vec![stalled()]);
        assert_eq!(shown(&model, 1000, &mut seen), [""; 0], "the same");
        assert!(shown(&model, 5000, &mut seen)[0].contains("UNKNOWN"), "its module has not listed it for 3 s");
        lists(&mut model, 6000, vec![]);
        assert!(shown(&model, 6000, &mut seen)[0].contains("CLEARED"));
        assert_eq!(list(&[], &[]), ["no fault is active"]);
    }

    #[test]
    fn a_refused_request_is_reported_and_not_active() {
        let (mut model, mut seen) = (Model::new(diagnostics::Config::default()), Seen::default());
        lists(&mut model, 0, vec![]);
        let number = base::Fault::CommandForbidden as i32;
        let message = "homing is refused".into();
        let error = Error { module: "driver_aux".into(), number, message, severity: 1, ..Error::default() };
        model.receive(at(10), "CM_EVENT_ERROR", 0, Some(error.into()));
        assert!(model.errors.groups(at(10)).iter().all(|group| !group.standing));
        assert!(shown(&model, 10, &mut seen)[0].contains("REPORTED"));
    }
}
