//! Channels of the bus with their rates, and the newest message of the marked one.

use super::{GREY, Listing, age, clip, size, table};
use crate::diag::app::App;
use crate::diag::rows;
use base::{Duration, Instant};
use diagnostics::ChannelRow;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::Style;
use ratatui::widgets::{Block, Paragraph, Row};
use serde_json::Value;

/// Lines of a message that are shown.
const LINES_MAX: usize = 200;
/// A channel that is silent for longer is grey, s.
const SILENT: f64 = 5.0;

pub fn draw(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let channels = rows::channels(app, now);
    let keys: Vec<String> = channels.iter().map(|row| row.channel.clone()).collect();
    let marked = app.marked(&keys);
    let list = if area.width < 100 { 46 } else { 56 };
    let [left, right] = match app.expanded {
        true => [Rect::default(), area],
        false => Layout::horizontal([Constraint::Length(list), Constraint::Min(20)]).areas(area),
    };
    if !app.expanded {
        let cells = |row: &ChannelRow| {
            let silent = row.age > SILENT;
            let cells = [
                clip(&row.channel),
                format!("{:.1}", row.rate),
                format!("{}{}", if silent { "!" } else { "" }, age(Some(Duration::from_secs_f64(row.age))).trim()),
                size(row.bandwidth),
                row.count.to_string(),
            ];
            Row::new(cells).style(if silent { Style::new().fg(GREY) } else { Style::new() })
        };
        let head = ["channel", "Hz", "age", "a second", "count"];
        let widths = [Constraint::Min(21), Constraint::Length(5), Constraint::Length(5)].into_iter();
        let widths: Vec<_> = widths.chain([8, 7].map(Constraint::Length)).collect();
        let widths = if area.width < 100 { &widths[..4] } else { &widths[..] };
        let title = format!(" {} channels by {} (o) ", channels.len(), app.order());
        let rows = channels.iter().map(cells).collect();
        table(frame, left, Listing { title, head: &head, widths, rows, marked });
    }
    let Some(row) = channels.get(marked) else { return };
    draw_message(frame, app, row, right);
}

fn draw_message(frame: &mut Frame<'_>, app: &App, row: &ChannelRow, area: Rect) {
    let mut lines = Vec::new();
    match app.latest(&row.channel).map(serde_json::to_value) {
        Some(Ok(value)) => flatten(&mut lines, "", &value),
        Some(Err(_)) => lines.push("not to be shown".into()),
        None if row.r#type.is_empty() => lines.push(format!("{} bytes of a type that is not ours", row.bytes)),
        None => lines.push(format!("{} bytes: too long, or malformed", row.bytes)),
    }
    let room = usize::from(area.height.saturating_sub(2));
    let scroll = usize::from(app.scroll).min(lines.len().saturating_sub(room));
    let more = if app.expanded && lines.len() > room { "  pgdn: more" } else { "" };
    let enter = if app.expanded { "  enter: list" } else { "" };
    let title = format!(" {} {}{enter}{more} ", clip(&row.channel), row.r#type);
    let text = Paragraph::new(lines.join("\n")).scroll((scroll as u16, 0));
    frame.render_widget(text.block(Block::bordered().title(title)), area);
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
            let few: Vec<String> = items.iter().take(16).map(Value::to_string).collect();
            let more = if items.len() > 16 { " ..." } else { "" };
            lines.push(format!("{path}[{}] {}{more}", items.len(), few.join(" ")));
        }
        Value::Array(items) => {
            for (n, value) in items.iter().enumerate().take(LINES_MAX) {
                flatten(lines, &format!("{path}[{n}]"), value);
            }
        }
        Value::Null => lines.push(format!("{path:<16} -")),
        Value::String(text) => lines.push(format!("{path:<16} {:?}", clip(text))),
        other => lines.push(format!("{path:<16} {other}")),
    }
}
