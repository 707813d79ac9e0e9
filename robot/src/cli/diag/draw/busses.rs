//! The busses with their nodes, and the drives.

use super::table;
use crate::cli::diag::app::App;
use base::Instant;
use canopen::axis::PowerState;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style};
use ratatui::widgets::{Block, Paragraph, Row};

const BUS: [&str; 5] = ["ACTIVE", "WARNING", "PASSIVE", "OFF", "CLOSED"];
const NODE: [&str; 3] = ["ok", "degraded", "LOST"];

fn word(words: &[&'static str], number: i32) -> &'static str {
    usize::try_from(number).ok().and_then(|place| words.get(place)).copied().unwrap_or("?")
}

pub fn draw(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let (model, at) = app.shown(now);
    let mut rows = Vec::new();
    for slot in model.busses() {
        let Some(bus) = slot.get().filter(|bus| app.lists(&bus.bus)) else { continue };
        let style = if slot.fresh(at).is_some() { Style::new() } else { Style::new().fg(Color::DarkGray) };
        let state = word(&BUS, bus.state).to_owned();
        let load = format!("{:.1} %", 100.0 * bus.load);
        let counts = [bus.frames.to_string(), String::new(), String::new(), bus.errors.to_string(), String::new()];
        let head = [bus.bus.clone(), String::new(), state, load].into_iter().chain(counts);
        rows.push(Row::new(head).style(style.bold()));
        for node in &bus.nodes {
            let lost = if node.state == 0 { style } else { style.fg(Color::Red) };
            let cells = [
                format!("  {}", node.name),
                format!("{:#04x}", node.address),
                word(&NODE, node.state).to_owned(),
                String::new(),
                node.requests.to_string(),
                node.retries.to_string(),
                node.timeouts.to_string(),
                node.crc_errors.to_string(),
                format!("{:.1} / {:.1}", 1e3 * node.round_trip_mean, 1e3 * node.round_trip_max),
            ];
            rows.push(Row::new(cells).style(lost));
        }
    }
    let axes = model.axes.get().map_or(0, |axes| axes.axes.len() as u16);
    let [upper, lower] = Layout::vertical([Constraint::Min(3), Constraint::Length(axes.min(6) + 2)]).areas(area);
    let head = ["bus, node", "address", "state", "load", "frames", "again", "silent", "errors", "ms mean/max"];
    let widths = [13, 7, 8, 6, 8, 5, 6, 6].map(Constraint::Length).into_iter().chain([Constraint::Min(11)]);
    let widths: Vec<_> = widths.collect();
    table(frame, app, upper, " busses ", &head, &widths, rows);
    let lines = model.axes.get().map(|axes| {
        let line = |axis: &messages::lowlevel::Axis| {
            let (status, error) = (axis.statusword as u16, axis.error_code as u16);
            format!(
                "{:<11} NMT {:#04x}  402 {:<22} status {status:04X}  error {error:04X}  {:+.3}  {:+.3}/s  {:+.2} A",
                axis.name,
                axis.nmt_state,
                PowerState::decode(status).map_or("?".into(), |state| state.to_string()),
                axis.position,
                axis.velocity,
                axis.current
            )
        };
        axes.axes.iter().map(line).collect::<Vec<_>>().join("\n")
    });
    let text = Paragraph::new(lines.unwrap_or_default()).style(super::style(&model.axes, at));
    frame.render_widget(text.block(Block::bordered().title(" drives ")), lower);
}
