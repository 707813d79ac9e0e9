//! The modules and their processes.

use super::{size, table, time};
use crate::cli::diag::app::App;
use base::Instant;
use ratatui::Frame;
use ratatui::layout::{Constraint, Rect};
use ratatui::style::{Color, Style};
use ratatui::widgets::Row;

pub fn draw(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let (model, at) = app.shown(now);
    let rows = model.modules(at).into_iter().filter(|row| app.lists(&row.module)).map(|row| {
        let state = match row.wanted {
            "" => row.state.to_owned(),
            wanted if wanted == row.state => row.state.to_owned(),
            wanted => format!("{} (want {wanted})", row.state),
        };
        let name = format!("{}{}", row.module, if row.critical { " !" } else { "" });
        let well = if row.well { Style::new() } else { Style::new().fg(Color::Red) };
        let pid = if row.pid == 0 { "-".into() } else { row.pid.to_string() };
        let cells = [
            name,
            state,
            row.phase.to_owned(),
            time(row.uptime),
            format!("{:.1} %", 100.0 * row.cpu),
            row.last_exit,
            row.restarts.to_string(),
            size(row.rss as f64),
            pid,
        ];
        Row::new(cells).style(well)
    });
    // What has no room is on the right.
    let head = ["module (! critical)", "state", "process", "up", "cpu", "last end", "again", "memory", "pid"];
    let widths = [19, 16, 8, 9, 6, 14].map(Constraint::Length).into_iter();
    let more = [5, 8, 7].map(Constraint::Length).into_iter().filter(|_| area.width >= 110);
    let widths: Vec<_> = widths.chain(more).collect();
    table(frame, app, area, " modules   :state MODULE STATE ", &head, &widths, rows.collect());
}
