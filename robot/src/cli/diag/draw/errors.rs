//! What went wrong, those of one kind together.

use super::{table, time_of_day};
use crate::cli::diag::app::App;
use base::Instant;
use ratatui::Frame;
use ratatui::layout::{Constraint, Rect};
use ratatui::style::{Color, Style};
use ratatui::widgets::Row;

const SEVERITY: [&str; 3] = ["notice", "warning", "ERROR"];

pub fn draw(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let (model, _) = app.shown(now);
    let groups = model.errors.groups().into_iter();
    let rows = groups.filter(|group| app.lists(&group.module) || app.lists(&group.message)).map(|group| {
        let severity = SEVERITY.get(group.severity.max(0) as usize).copied().unwrap_or("?");
        let cells = [
            if group.standing { "stands".into() } else { "over".into() },
            severity.to_owned(),
            group.module.clone(),
            format!("{:04X}", group.number),
            group.count.to_string(),
            time_of_day(group.first),
            time_of_day(group.last),
            group.message.clone(),
        ];
        let grave = if group.standing { Style::new().fg(Color::Red) } else { Style::new().fg(Color::DarkGray) };
        Row::new(cells).style(if group.severity == 2 || !group.standing { grave } else { Style::new() })
    });
    let head = ["", "severity", "module", "fault", "count", "first", "last", "what"];
    let widths = [6, 7, 14, 5, 5, 8, 8].map(Constraint::Length).into_iter().chain([Constraint::Min(20)]);
    let widths: Vec<_> = widths.collect();
    table(frame, app, area, " errors ", &head, &widths, rows.collect());
}
