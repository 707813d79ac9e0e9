//! The buses with their nodes, the drives, and requested objects.

use super::{Listing, clip, fact, line, mark_of_age, pane, split, style, table};
use crate::diag::app::App;
use crate::diag::rows::{self, BusRow};
use base::Instant;
use canopen::NmtState;
use canopen::axis::PowerState;
use messages::lowlevel::{Axis, DataBus, Node, Wheel};
use ratatui::Frame;
use ratatui::layout::{Constraint, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::Line;
use ratatui::widgets::{Block, Row, Table};

const BUS: [&str; 5] = ["ACTIVE", "WARNING", "PASSIVE", "OFF", "CLOSED"];
const NODE: [&str; 3] = ["ok", "degraded", "LOST"];
/// Axes that are shown.
const AXES_MAX: usize = 6;
/// Answers that are shown.
const ANSWERS: usize = 5;

fn word(words: &[&'static str], number: i32) -> &'static str {
    usize::try_from(number).ok().and_then(|place| words.get(place)).copied().unwrap_or("?")
}

pub fn draw(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let (model, at) = app.shown(now);
    let rows = rows::buses(app, now);
    let keys = rows::keys(app, now);
    let marked = app.marked(&keys);
    let answers: Vec<String> = app.objects.lines().take(ANSWERS).collect();
    let detail = rows.get(marked).filter(|_| app.expanded).map(|row| lines(app, row, at));
    let axes = model.axes.get().map_or(&[][..], |axes| &axes.axes[..]);
    let axes = &axes[..axes.len().min(AXES_MAX)];
    // Below: what was asked for, or more of the marked row; above that the drives.
    let below = detail.as_ref().map_or(answers.len(), Vec::len);
    let [area, lowest] = if below > 0 { split(area, below) } else { [area, Rect::default()] };
    let [upper, lower] = if axes.is_empty() { [area, Rect::default()] } else { split(area, axes.len() + 1) };
    let head = ["bus, node", "addr", "state", "load", "frames", "retry", "silent", "errors", "ms mean/max", "age"];
    let widths = [12, 4, 8, 6, 8, 5, 6, 6, 11].map(Constraint::Length).into_iter().chain([Constraint::Min(5)]);
    let widths: Vec<_> = widths.collect();
    let title = " buses   enter more  c command ".into();
    let cells = rows.iter().map(|row| cells(row, at)).collect();
    table(frame, upper, Listing { title, head: &head, widths: &widths, rows: cells, marked });
    if !axes.is_empty() {
        let wheels = model.wheels.get().map_or(&[][..], |wheels| &wheels.wheels[..]);
        draw_axes(frame, (axes, wheels), style(&model.axes, at), &mark_of_age(&model.axes, at), lower);
    }
    match detail {
        Some(lines) => pane(frame, lowest, " the marked one ".into(), lines),
        None if answers.is_empty() => {}
        None => {
            let lines = answers.into_iter().map(Line::from).collect();
            pane(frame, lowest, " objects   :sdo NODE INDEX [SUB [VALUE [TYPE]]] ".into(), lines);
        }
    }
}

fn cells(row: &BusRow<'_>, at: Instant) -> Row<'static> {
    match row {
        BusRow::Bus(slot, bus) => {
            let ill = if bus.state == DataBus::ACTIVE { style(slot, at) } else { style(slot, at).fg(Color::Red) };
            let cells = [
                clip(&bus.bus),
                String::new(),
                word(&BUS, bus.state).to_owned(),
                format!("{:.1} %", 100.0 * bus.load),
                bus.frames.to_string(),
                String::new(),
                String::new(),
                bus.errors.to_string(),
                String::new(),
                mark_of_age(slot, at),
            ];
            Row::new(cells).style(ill.bold())
        }
        BusRow::Node(slot, _, node) => {
            let cells = [
                format!("  {}", clip(&node.name)),
                format!("{:#04x}", node.address),
                word(&NODE, node.state).to_owned(),
                String::new(),
                node.requests.to_string(),
                node.retries.to_string(),
                node.timeouts.to_string(),
                node.crc_errors.to_string(),
                round_trip(node),
                mark_of_age(slot, at),
            ];
            let style = style(slot, at);
            Row::new(cells).style(if node.state == Node::OK { style } else { style.fg(Color::Red) })
        }
    }
}

fn round_trip(node: &Node) -> String {
    if !node.round_trip_max.is_finite() {
        return "-".into();
    }
    format!("{:.1} / {:.1}", 1e3 * node.round_trip_mean, 1e3 * node.round_trip_max)
}

/// NMT state in words (CiA 301, 7.2.8.3.2); -1: none.
fn nmt(state: i8) -> String {
    if state < 0 && state != -1 {
        return format!("? ({state})");
    }
    match u8::try_from(state).ok().map(|state| (state, NmtState::from_byte(state))) {
        None => "LOST".into(),
        Some((_, Some(NmtState::Initialising))) => "boot-up".into(),
        Some((_, Some(NmtState::Stopped))) => "stopped".into(),
        Some((_, Some(NmtState::Operational))) => "operational".into(),
        Some((_, Some(NmtState::PreOperational))) => "pre-operational".into(),
        Some((state, None)) => format!("? ({state})"),
    }
}

fn draw_axes(frame: &mut Frame<'_>, drives: (&[Axis], &[Wheel]), style: Style, age: &str, area: Rect) {
    let (axes, wheels) = drives;
    let row = |axis: &Axis| {
        let borne = wheels.iter().find(|wheel| wheel.name == axis.name);
        let (load, temperature) = borne.map_or((f64::NAN, f64::NAN), |wheel| (wheel.load, wheel.temperature));
        let (status, error) = (axis.statusword as u16, axis.error_code as u16);
        let state = PowerState::decode(status).map_or("?".into(), |state| state.to_string());
        let ill = error != 0 || axis.nmt_state != NmtState::Operational as i8;
        let is_angle = axis.name == "steering";
        let (position, unit) = if is_angle { (axis.position.to_degrees(), "deg") } else { (axis.position, "m") };
        let velocity = if is_angle { axis.velocity.to_degrees() } else { axis.velocity };
        let cells = [
            clip(&axis.name),
            nmt(axis.nmt_state),
            state,
            if error == 0 { "-".into() } else { format!("{error:04X}") },
            if velocity.is_nan() { "-".into() } else { format!("{velocity:+.2} {unit}/s") },
            if axis.current.is_nan() { "-".into() } else { format!("{:+.1} A", axis.current) },
            format!("{status:04X}"),
            if position.is_nan() { "-".into() } else { format!("{position:+.2} {unit}") },
            if load.is_nan() { "-".into() } else { format!("{:.0} %", 100.0 * load) },
            if temperature.is_nan() { "-".into() } else { format!("{temperature:.0} degC") },
        ];
        Row::new(cells).style(if ill { style.fg(Color::Red).bold() } else { style })
    };
    let head = ["drive", "NMT", "CiA 402", "error", "velocity", "current", "status", "position", "load", "temp"];
    let widths = [10, 15, 22, 5, 12, 8, 6, 12, 6, 8].map(Constraint::Length);
    // A narrow screen has no room for the last ones.
    let widths = match area.width {
        0..100 => &widths[..6],
        100..117 => &widths[..8],
        _ => &widths[..],
    };
    let table = Table::new(axes.iter().map(row), widths.iter().copied())
        .header(Row::new(head.to_vec()).bold().underlined())
        .block(Block::bordered().title(format!(" drives  age {age} ")));
    frame.render_widget(table, area);
}

/// All about one.
fn lines(app: &App, row: &BusRow<'_>, at: Instant) -> Vec<Line<'static>> {
    match row {
        BusRow::Bus(slot, bus) => vec![
            line("bus", slot, at, |bus| format!("{}, {}", bus.bus, word(&BUS, bus.state))),
            fact("carried", &format!("{} frames, {} errors, load {:.1} %", bus.frames, bus.errors, 100.0 * bus.load)),
        ],
        BusRow::Node(slot, bus, node) => {
            let part = |count: i64| match node.requests {
                requests if requests > 0 => format!("{count} ({:.2} %)", 100.0 * count as f64 / requests as f64),
                _ => count.to_string(),
            };
            let ms = |s: f64| if s.is_finite() { format!("{:.2}", 1e3 * s) } else { "-".into() };
            let (min, mean, max) = (node.round_trip_min, node.round_trip_mean, node.round_trip_max);
            let mut lines = vec![
                line("node", slot, at, |_| {
                    format!("{} at {:#04x} on {}: {}", node.name, node.address, bus.bus, word(&NODE, node.state))
                }),
                fact("requests", &format!("{}, sent again {}", node.requests, part(node.retries))),
                fact("no answer", &part(node.timeouts)),
                fact("bad check", &part(node.crc_errors)),
                fact("round trip", &format!("{} / {} / {} ms, least, mean, most", ms(min), ms(mean), ms(max))),
            ];
            // What a scanner says of itself.
            if let Some(scanner) = app.shown(at).0.scanner.get().filter(|scanner| scanner.name == node.name) {
                let rate = scanner.rejected_rate;
                let now = if rate.is_nan() { String::new() } else { format!(", {rate:.1}/s now") };
                lines.push(fact("supply", &format!("{:.2} V", scanner.supply)));
                lines.push(fact("rejected", &format!("{} pulses{now}", scanner.rejected)));
            }
            if let Some((id, _)) = app.nodes.iter().find(|(_, axis)| *axis == node.name) {
                lines.push(fact("objects", &format!(":sdo {id} 0x6041 reads one; c begins the command")));
            }
            lines
        }
    }
}
