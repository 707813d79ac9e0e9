//! What went wrong, those of one kind together.

use super::{GREY, Listing, clip, fact, pane, split, table, time_of_day};
use crate::cli::diag::app::App;
use crate::cli::diag::rows;
use base::{Fault, Instant};
use diagnostics::{ErrorGroup, Model};
use messages::common::Error;
use ratatui::Frame;
use ratatui::layout::{Constraint, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::Line;
use ratatui::widgets::Row;

const SEVERITY: [&str; 3] = ["notice", "warning", "ERROR"];
/// Single reports of a kind that are shown.
const REPORTS: usize = 5;

pub fn draw(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let groups = rows::errors(app, now);
    let keys: Vec<String> = groups.iter().map(|group| rows::error_key(group)).collect();
    let marked = app.marked(&keys);
    let (model, _) = app.shown(now);
    let detail = groups.get(marked).filter(|_| app.expanded).map(|group| lines(model, group));
    let [upper, lower] = split(area, detail.as_ref().map_or(0, |lines| lines.len() + 1));
    let upper = if detail.is_some() { upper } else { area };
    if groups.is_empty() {
        pane(frame, area, " errors ".into(), none(app, model));
        return;
    }
    let cells = |group: &&ErrorGroup| {
        let cells = [
            if group.standing { "STANDS".into() } else { "over".into() },
            severity(group.severity).to_owned(),
            clip(&group.module),
            group.count.to_string(),
            time_of_day(group.last),
            clip(&group.message),
        ];
        let style = match group.severity {
            _ if !group.standing => Style::new().fg(GREY),
            Error::ERROR => Style::new().fg(Color::Red).bold(),
            _ => Style::new(),
        };
        Row::new(cells).style(style)
    };
    let head = ["", "severity", "module", "count", "last", "what"];
    let widths = [6, 8, 13, 5, 8].map(Constraint::Length).into_iter().chain([Constraint::Min(20)]);
    let widths: Vec<_> = widths.collect();
    let standing = groups.iter().filter(|group| group.standing).count();
    let title = format!(" errors  standing {standing}, over {}  order: {} (o) ", groups.len() - standing, app.order());
    let rows = groups.iter().map(cells).collect();
    table(frame, upper, Listing { title, head: &head, widths: &widths, rows, marked });
    if let Some(lines) = detail {
        pane(frame, lower, " the marked one ".into(), lines);
    }
}

/// A fault that stands is reported once, maybe before anybody listened here.
fn none(app: &App, model: &Model) -> Vec<Line<'static>> {
    if !app.filter.is_empty() {
        return vec![Line::from("none of that")];
    }
    let mut lines = vec![Line::from("nothing was reported since this began to listen")];
    if let Some(log) = model.log.get().filter(|log| log.recording) {
        let run = app.runs.folder().join(clip(&log.run));
        lines.push(Line::from(format!("before: advee log cat {} -c CM_EVENT_ERROR", run.display())).dim());
    }
    lines
}

fn severity(number: i8) -> &'static str {
    usize::try_from(number).ok().and_then(|place| SEVERITY.get(place)).copied().unwrap_or("?")
}

/// All about one.
fn lines(model: &Model, group: &ErrorGroup) -> Vec<Line<'static>> {
    let known = Fault::ALL.iter().find(|fault| **fault as i32 == group.number);
    let name = known.map_or("a number of its own".into(), |fault| format!("{} (docs/faults.md)", fault.name()));
    let mut lines = vec![
        Line::from(clip(&group.message)).bold(),
        fact("fault", &format!("{:#06x} {name}, by {}", group.number, clip(&group.module))),
        fact(
            "first",
            &format!("{}, last {}, count {}", time_of_day(group.first), time_of_day(group.last), group.count),
        ),
    ];
    let reports = model.errors.reports();
    let reports = reports.filter(|report| report.module == group.module && report.number == group.number);
    lines.extend(reports.take(REPORTS).map(|report| {
        let severity = if report.severity == Error::NOTICE { "over" } else { severity(report.severity) };
        let place = if report.file.is_empty() { String::new() } else { format!(" ({}:{})", report.file, report.line) };
        fact(&time_of_day(report.timestamp), &format!("{severity}: {}{place}", report.message))
    }));
    lines
}
