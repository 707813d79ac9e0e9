//! What is said on the bus: channels with their rates, and the latest message of the marked one.

use super::{size, table};
use crate::cli::diag::app::App;
use base::Instant;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style};
use ratatui::widgets::{Block, Paragraph, Row};
use serde_json::Value;

/// Lines of a message that are shown.
const LINES_MAX: usize = 200;

pub fn draw(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let (model, at) = app.shown(now);
    let channels: Vec<_> = model.traffic.rows(at).into_iter().filter(|row| app.lists(&row.channel)).collect();
    let [left, right] = Layout::horizontal([Constraint::Length(48), Constraint::Min(20)]).areas(area);
    let rows = channels.iter().map(|row| {
        let silent = row.rate == 0.0;
        let cells = [row.channel.clone(), format!("{:.1}", row.rate), size(row.bandwidth), row.count.to_string()];
        Row::new(cells).style(if silent { Style::new().fg(Color::DarkGray) } else { Style::new() })
    });
    let head = ["channel", "Hz", "a second", "count"];
    let widths = [Constraint::Min(22), Constraint::Length(6), Constraint::Length(8), Constraint::Length(7)];
    table(frame, app, left, " channels   arrows mark, / filters ", &head, &widths, rows.collect());
    let Some(marked) = channels.get(app.selected.min(channels.len().saturating_sub(1))) else { return };
    let mut lines = Vec::new();
    match app.latest(&marked.channel).map(serde_json::to_value) {
        Some(Ok(value)) => flatten(&mut lines, "", &value),
        Some(Err(_)) | None => lines.push(format!("{} bytes of a type that is not ours", marked.bytes)),
    }
    let title = format!(" {} {} ", marked.channel, marked.r#type);
    frame.render_widget(Paragraph::new(lines.join("\n")).block(Block::bordered().title(title)), right);
}

/// A line for each number and text, with the way to it.
fn flatten(lines: &mut Vec<String>, path: &str, value: &Value) {
    if lines.len() >= LINES_MAX {
        return;
    }
    match value {
        Value::Object(fields) => {
            for (name, value) in fields {
                let dot = if path.is_empty() { "" } else { "." };
                flatten(lines, &format!("{path}{dot}{name}"), value);
            }
        }
        Value::Array(items) if items.iter().all(Value::is_number) && items.len() > 4 => {
            let few: Vec<String> = items.iter().take(8).map(Value::to_string).collect();
            lines.push(format!(
                "{path}[{}] {}{}",
                items.len(),
                few.join(" "),
                if items.len() > 8 { " ..." } else { "" }
            ));
        }
        Value::Array(items) => {
            for (n, value) in items.iter().enumerate() {
                flatten(lines, &format!("{path}[{n}]"), value);
            }
        }
        Value::Null => lines.push(format!("{path:<24} -")),
        other => lines.push(format!("{path:<24} {other}")),
    }
}
