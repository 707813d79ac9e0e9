//! The recorder, the runs of this machine, and reports and texts one by one.

use super::{Listing, clip, fact, line, pane, size, split, table, time_of_day};
use crate::diag::app::App;
use crate::diag::rows;
use crate::diag::runs::Run;
use base::Instant;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::Style;
use ratatui::text::Line;
use ratatui::widgets::Row;
use std::cmp::Reverse;

/// Files of a run that are shown.
const FILES: usize = 12;
/// Reports, and texts, that are looked through.
const REPORTS: usize = 100;

pub fn draw(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let (model, at) = app.shown(now);
    let [upper, rest] = Layout::vertical([Constraint::Length(5), Constraint::Min(3)]).areas(area);
    let lines = vec![
        line("recorder", &model.log, at, |log| match (log.recording, log.run.as_str()) {
            (false, _) => "RECORDS NOTHING; :log start".into(),
            (true, run) => format!("writes {run}"),
        }),
        line("log file", &model.log, at, |log| format!("{}, {} free", size(log.bytes as f64), size(log.free as f64))),
        line("lost", &model.log, at, |log| crate::counted(log.dropped, "message")),
    ];
    pane(frame, upper, " recorder   :log start  :log stop  m mark ".into(), lines);
    let runs = rows::runs(app);
    let keys: Vec<String> = runs.iter().map(|run| run.name.clone()).collect();
    let marked = app.marked(&keys);
    let lower = match runs.get(marked).filter(|_| app.expanded) {
        Some(run) => files(app, run),
        None => reports(app, now),
    };
    let least = usize::from(rest.height / 2).saturating_sub(2);
    let [middle, lowest] = split(rest, least);
    draw_runs(frame, app, &runs, marked, middle);
    let title = if app.expanded && !runs.is_empty() {
        " files of the marked run "
    } else {
        " reports and texts, the latest first "
    };
    pane(frame, lowest, title.into(), lower);
}

fn draw_runs(frame: &mut Frame<'_>, app: &App, runs: &[&Run], marked: usize, area: Rect) {
    let folder = clip(&app.runs.folder().display().to_string());
    if runs.is_empty() {
        let why = app.runs.why.clone().unwrap_or_else(|| "none here".into());
        pane(frame, area, format!(" runs in {folder} "), vec![Line::from(why)]);
        return;
    }
    let cells = |run: &&Run| {
        let count = run.files.as_ref().map_or("-".into(), |files| files.len().to_string());
        let bytes = run.bytes().map_or("-".into(), |bytes| size(bytes as f64));
        let cells = [run.name.clone(), bytes, count, if run.recorded { "being written".into() } else { String::new() }];
        Row::new(cells).style(if run.recorded { Style::new().bold() } else { Style::new() })
    };
    let head = ["run (UTC)", "size", "files", ""];
    let widths = [22, 9, 5].map(Constraint::Length).into_iter().chain([Constraint::Min(5)]);
    let widths: Vec<_> = widths.collect();
    let title = format!(" {} in {folder} ", crate::counted(runs.len() as u64, "run"));
    table(frame, area, Listing { title, head: &head, widths: &widths, rows: runs.iter().map(cells).collect(), marked });
}

fn files(app: &App, run: &Run) -> Vec<Line<'static>> {
    let path = app.runs.folder().join(&run.name);
    let mut lines = vec![fact("look into it", &format!("advee log info {}", path.display()))];
    let files = run.files.as_deref().unwrap_or_default();
    lines.extend(files.iter().take(FILES).map(|(name, bytes)| fact(&size(*bytes as f64), name)));
    if let Some(more @ 1..) = files.len().checked_sub(FILES) {
        lines.push(Line::from(format!("and {more} more")));
    }
    lines
}

fn reports(app: &App, now: Instant) -> Vec<Line<'static>> {
    let (model, _) = app.shown(now);
    let reports = model.errors.reports().map(|reported| {
        let report = &reported.error;
        let what = if report.severity == messages::common::Error::NOTICE { "cleared: " } else { "report: " };
        (report.timestamp, &report.module, what, &report.message)
    });
    let texts = model.texts.latest().map(|text| {
        // News need no word for it.
        let what = match text.level() {
            "WARNING" => "warning: ",
            "ERROR" => "error: ",
            "DEBUG" => "debug: ",
            _ => "",
        };
        (text.timestamp, &text.module, what, &text.text)
    });
    let listed = |(_, module, _, text): &(i64, &String, &str, &String)| app.lists(module) || app.lists(text);
    let mut all: Vec<_> = reports.filter(listed).take(REPORTS).chain(texts.filter(listed).take(REPORTS)).collect();
    all.sort_by_key(|(timestamp, ..)| Reverse(*timestamp));
    let line = |(timestamp, module, what, text): (i64, &String, &str, &String)| {
        Line::from(format!("{} {:<14} {what}{}", time_of_day(timestamp), clip(module), clip(text)))
    };
    all.into_iter().take(REPORTS).map(line).collect()
}
