//! Texts, reports and marks of a log as lines for people, as a terminal showed them.

use super::select::date;
use super::source::Item;
use base::Level;
use host::log::OneLine;
use messages::common::{CmdLog, Error, EventText};
use messages::{Message, fault_name};

/// Names of the levels, in the order of their values.
pub const LEVELS: [&str; 4] = ["debug", "info", "warning", "error"];

/// The level of that name; INFO for any other.
pub fn level(name: &str) -> Level {
    let place = LEVELS.iter().position(|known| *known == name);
    place.and_then(|place| Level::ALL.get(place)).copied().unwrap_or(Level::Info)
}

/// Line of an item: date (UTC), module, level and text, of reports with file and line; `None` if it is no text, report
/// or mark, or below the level. An unknown level counts as ERROR, and a notice as INFO.
pub fn line(item: &Item<'_>, from: Level) -> Option<String> {
    if item.encoding != "lcm" {
        return None;
    }
    let known = |value| Level::from_value(value).unwrap_or(Level::Error);
    let (module, level, text) = match Message::receive(item.channel, item.data)?.ok()? {
        Message::CmEventText(EventText { module, level, text, .. }) => (module, known(level), text),
        Message::CmEventError(report) => {
            // A severity is of the level above its value.
            let level = known(report.severity.saturating_add(1));
            (report.module.clone(), level, of_report(&report))
        }
        Message::CmCmdLog(CmdLog { action: CmdLog::MARK, text, .. }) => {
            ("-".into(), Level::Info, format!("MARK {text}"))
        }
        _ => return None,
    };
    let shown = || format!("{} {} {:7} {}", date(item.log_time), OneLine(&module), level.name(), OneLine(&text));
    (level >= from).then(shown)
}

fn of_report(report: &Error) -> String {
    let fatal = if report.fatal { " (fatal)" } else { "" };
    let place = if report.file.is_empty() { String::new() } else { format!(" ({}:{})", report.file, report.line) };
    format!("{}: {}{fatal}{place}", fault_name(report.number), report.message)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn shown(message: impl Into<Message>, from: Level) -> Option<String> {
        let (message, mut data, metadata): (Message, _, _) = (message.into(), Vec::new(), BTreeMap::new());
        message.encode(&mut data).unwrap();
        let channel = message.channel().name();
        let (schema, key) = (None, (0, 0));
        let item = Item {
            log_time: 1_500_000_000,
            publish_time: 0,
            sequence: 0,
            channel,
            encoding: "lcm",
            schema,
            metadata: &metadata,
            key,
            data: &data,
        };
        line(&item, from)
    }

    #[test]
    fn texts_reports_and_marks_are_lines_from_a_level_on() {
        let text =
            EventText { module: "toy".into(), level: EventText::DEBUG, text: "a\nb".into(), ..Default::default() };
        let line = shown(text.clone(), Level::Debug);
        assert_eq!(line.as_deref(), Some("1970-01-01 00:00:01.500000 toy DEBUG   a b"));
        assert_eq!(shown(text, Level::Info), None);
        let report = Error {
            module: "toy".into(),
            number: 0x0102,
            message: "silent".into(),
            severity: Error::WARNING,
            file: "src/toy.rs".into(),
            line: 7,
            ..Default::default()
        };
        let line = shown(report.clone(), Level::Warning).unwrap();
        assert!(line.ends_with(" toy WARNING BoardLost: silent (src/toy.rs:7)"), "{line}");
        assert_eq!(shown(report.clone(), Level::Error), None);
        let fatal = shown(Error { fatal: true, severity: 99, ..report }, Level::Error).unwrap();
        assert!(fatal.ends_with(" toy ERROR   BoardLost: silent (fatal) (src/toy.rs:7)"), "{fatal}");
        let mark = CmdLog { action: CmdLog::MARK, text: "here".into(), ..Default::default() };
        assert!(shown(mark, Level::Info).unwrap().ends_with(" - INFO    MARK here"));
        assert_eq!(shown(CmdLog { action: CmdLog::START, ..Default::default() }, Level::Debug), None);
        assert_eq!(LEVELS.map(level), [Level::Debug, Level::Info, Level::Warning, Level::Error]);
    }
}
