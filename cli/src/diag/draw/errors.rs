//! What went wrong, those of one kind together.

use super::{GREY, Listing, clip, fact, pane, split, table, time_of_day};
use crate::diag::app::App;
use crate::diag::rows;
use base::{Fault, Instant};
use diagnostics::{Model, Reported, ShownGroup};
use messages::common::Error;
use messages::fault_remedy;
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
    let wide = area.width >= 100;
    let cells = |group: &ShownGroup<'_>| {
        let mut cells = vec![
            status(group).to_owned(),
            severity(group.severity).to_owned(),
            clip(&group.module),
            group.count.to_string(),
            time_of_day(group.last),
            clip(&group.message),
        ];
        if wide {
            cells.insert(3, clip(&group.subject));
        }
        Row::new(cells).style(style(group))
    };
    // On a narrow screen the subject stands in the marked row's lines.
    let (mut head, mut widths) = (vec!["", "severity", "module", "count", "last", "what"], vec![7, 8, 13, 5, 8]);
    if wide {
        head.insert(3, "about");
        widths.insert(3, 14);
    }
    let widths: Vec<_> = widths.into_iter().map(Constraint::Length).chain([Constraint::Min(20)]).collect();
    let standing = groups.iter().filter(|group| group.standing && group.known).count();
    let unknown = groups.iter().filter(|group| group.standing && !group.known).count();
    let cleared = groups.len() - standing - unknown;
    let unknown = if unknown > 0 { format!(", not known {unknown}") } else { String::new() };
    let title = format!(" errors  active {standing}{unknown}, cleared {cleared}  order: {} (o) ", app.order());
    let rows = groups.iter().map(cells).collect();
    table(frame, upper, Listing { title, head: &head, widths: &widths, rows, marked });
    if let Some(lines) = detail {
        pane(frame, lower, " the marked one ".into(), lines);
    }
}

/// A line each, for a place beside another view.
pub fn brief(app: &App, now: Instant) -> Vec<Line<'static>> {
    let (model, at) = app.shown(now);
    let groups = model.errors.groups(at);
    if groups.is_empty() {
        return none(app, model);
    }
    let line = |group: &ShownGroup<'_>| {
        let text = format!(
            "{:7} {} {:<14} {}",
            status(group),
            time_of_day(group.last),
            clip(&group.module),
            clip(&group.message)
        );
        Line::styled(text, style(group))
    };
    groups.iter().map(line).collect()
}

fn status(group: &ShownGroup<'_>) -> &'static str {
    match (group.standing, group.known) {
        (true, true) => "ACTIVE",
        (true, false) => "UNKNOWN",
        (false, _) => "cleared",
    }
}

fn style(group: &ShownGroup<'_>) -> Style {
    match group.severity {
        _ if !group.standing => Style::new().fg(GREY),
        Error::ERROR => Style::new().fg(Color::Red).bold(),
        _ => Style::new(),
    }
}

/// What was reported and cleared before this program listened is not known; nor are the active faults of modules that
/// do not list them.
fn none(app: &App, model: &Model) -> Vec<Line<'static>> {
    if !app.filter.is_empty() {
        return vec![Line::from("none of that")];
    }
    let mut lines = vec![Line::from("no fault is active, and nothing was reported since this began to listen")];
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
fn lines(model: &Model, group: &ShownGroup<'_>) -> Vec<Line<'static>> {
    let known = Fault::ALL.iter().find(|fault| **fault as i32 == group.number);
    let name = known.map_or("a number of its own".into(), |fault| format!("{} (docs/faults.md)", fault.name()));
    let mut lines = vec![
        Line::from(clip(&group.message)).bold(),
        fact("fault", &format!("{:#06x} {name}, by {}", group.number, clip(&group.module))),
        fact("what to do", fault_remedy(group.number).unwrap_or("see the documentation of the module")),
        fact("about", if group.subject.is_empty() { "-" } else { &group.subject }),
        fact(
            "first",
            &format!("{}, last {}, count {}", time_of_day(group.first), time_of_day(group.last), group.count),
        ),
    ];
    let reports = model.errors.reports();
    let of_it = |report: &&Reported| {
        (report.error.number, &report.error.module) == (group.number, &group.module)
            && report.subject.as_ref().is_none_or(|subject| *subject == group.subject)
    };
    if group.standing && !group.known {
        lines.push(fact(
            "not known",
            "whether it is active: its module has not listed its faults for 3 s, or does not run",
        ));
    }
    lines.extend(reports.filter(of_it).take(REPORTS).map(|Reported { error: report, .. }| {
        let severity = if report.severity == Error::NOTICE { "cleared" } else { severity(report.severity) };
        let place = if report.file.is_empty() { String::new() } else { format!(" ({}:{})", report.file, report.line) };
        fact(&time_of_day(report.timestamp), &format!("{severity}: {}{place}", report.message))
    }));
    lines
}
