//! The recorder, and the reports one by one.

use super::{line, size, time_of_day};
use crate::cli::diag::app::App;
use base::Instant;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph};

pub fn draw(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let (model, at) = app.shown(now);
    let [upper, lower] = Layout::vertical([Constraint::Length(6), Constraint::Min(3)]).areas(area);
    let lines = vec![
        line("recorder", &model.log, at, |log| if log.recording { "records".into() } else { "does not record".into() }),
        line("run", &model.log, at, |log| log.run.clone()),
        line("written", &model.log, at, |log| format!("{}, {} free", size(log.bytes as f64), size(log.free as f64))),
        line("lost", &model.log, at, |log| format!("{} messages", log.dropped)),
    ];
    let title = " log   :log start  :log stop  :mark TEXT ";
    frame.render_widget(Paragraph::new(lines).block(Block::bordered().title(title)), upper);
    let reports = model.errors.reports().filter(|report| app.lists(&report.module) || app.lists(&report.message));
    let line = |report: &messages::common::Error| {
        Line::from(format!("{} {:<14} {}", time_of_day(report.timestamp), report.module, report.message))
    };
    let lines: Vec<_> = reports.skip(app.selected).take(usize::from(lower.height)).map(line).collect();
    frame.render_widget(Paragraph::new(lines).block(Block::bordered().title(" reports, the latest first ")), lower);
}
