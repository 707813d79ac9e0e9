//! The screen as a function of the state: head, one view, foot. Values that are stale are grey and say how old they are;
//! nothing is said by colour alone.

mod busses;
mod errors;
mod help;
mod logs;
mod messages;
mod modules;
mod overview;

use super::app::{App, Mode, Tab};
use crate::live::log::TimeOfDay;
use base::Instant;
use diagnostics::{Freshness, Slot, Word};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Row, Table, TableState};

/// What the configuration says of the robot's body, for the picture: m from the rear axle's middle.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    pub rear: f64,
    pub front: f64,
    pub half_width: f64,
}

/// The least that anything can be read on.
const LEAST: (u16, u16) = (40, 10);

/// Draws everything.
pub fn draw(frame: &mut Frame<'_>, app: &App, body: Body, now: Instant) {
    let area = frame.area();
    if area.width < LEAST.0 || area.height < LEAST.1 {
        frame.render_widget(Paragraph::new("the terminal is too small"), area);
        return;
    }
    let [head, view, foot] =
        Layout::vertical([Constraint::Length(2), Constraint::Min(1), Constraint::Length(1)]).areas(area);
    draw_head(frame, app, head, now);
    match app.tab {
        _ if app.mode == Mode::Help => help::draw(frame, view),
        Tab::Overview => overview::draw(frame, app, body, view, now),
        Tab::Modules => modules::draw(frame, app, view, now),
        Tab::Busses => busses::draw(frame, app, view, now),
        Tab::Errors => errors::draw(frame, app, view, now),
        Tab::Messages => messages::draw(frame, app, view, now),
        Tab::Logs => logs::draw(frame, app, view, now),
    }
    draw_foot(frame, app, foot, now);
}

/// The status is what is now, even while the rest is frozen.
fn draw_head(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let status = app.status(now);
    let colour = match status.word {
        Word::Driving | Word::Ready => Color::Green,
        Word::Waiting => Color::Cyan,
        Word::Stopped | Word::Paused => Color::Yellow,
        Word::Fault | Word::Silent => Color::Red,
    };
    let word = Span::styled(format!(" {} ", status.word.text()), Style::new().bg(colour).fg(Color::Black).bold());
    let reason = Span::raw(format!(" {}", status.reason));
    let mut tabs = vec![Span::raw(format!(" {} ", app.robot())).bold()];
    for (n, tab) in Tab::ALL.into_iter().enumerate() {
        let style = if tab == app.tab { Style::new().reversed() } else { Style::new() };
        tabs.push(Span::styled(format!(" {}{} ", n + 1, tab.name()), style));
    }
    if app.frozen.is_some() {
        tabs.push(" FROZEN (f) ".bold().reversed());
    }
    if app.read_only {
        tabs.push(" read-only ".dim());
    }
    frame.render_widget(Paragraph::new(vec![Line::from(vec![word, reason]), Line::from(tabs)]), area);
}

fn draw_foot(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let text = match &app.mode {
        Mode::Command(line) => format!(":{line}\u{2588}"),
        Mode::Filter(line) => format!("/{line}\u{2588}"),
        Mode::Confirm(what) => format!("{what}? y: yes, any other key: no"),
        _ => match app.said(now) {
            Some(said) => said.to_owned(),
            None if app.drive.is_taken() => {
                "DRIVE: hold arrows, let go = stop (up to 0.7 s after one press)  +- speed  space stop  d give back"
                    .into()
            }
            None if !app.filter.is_empty() => format!("filter /{}  (esc clears)", app.filter),
            None => "space STOP  d drive  h home  : command  / filter  f freeze  ? help  q quit".into(),
        },
    };
    frame.render_widget(Paragraph::new(text).style(Style::new().add_modifier(Modifier::REVERSED)), area);
}

/// How a value is written that may be stale.
pub(super) fn style<T>(slot: &Slot<T>, now: Instant) -> Style {
    match slot.freshness(now) {
        Freshness::Fresh => Style::new(),
        Freshness::Stale | Freshness::Never => Style::new().fg(Color::DarkGray),
    }
}

/// A line about a value: as it is, with its age where it is stale, or that there is none.
pub(super) fn line<T>(name: &str, slot: &Slot<T>, now: Instant, text: impl FnOnce(&T) -> String) -> Line<'static> {
    let text = match (slot.get(), slot.freshness(now), slot.age(now)) {
        (Some(value), Freshness::Stale, Some(age)) => format!("{} ({:.1} s old)", text(value), age.as_secs_f64()),
        (Some(value), _, _) => text(value),
        (None, _, _) => "-".into(),
    };
    Line::from(vec![Span::raw(format!("{name:<11}")).bold(), Span::styled(text, style(slot, now))])
}

/// A table of which one row is marked.
pub(super) fn table<'a>(
    frame: &mut Frame<'_>,
    app: &App,
    area: Rect,
    title: &'a str,
    head: &[&'a str],
    widths: &[Constraint],
    rows: Vec<Row<'a>>,
) {
    let selected = if rows.is_empty() { None } else { Some(app.selected.min(rows.len() - 1)) };
    let table = Table::new(rows, widths.iter().copied())
        .header(Row::new(head.to_vec()).bold().underlined())
        .row_highlight_style(Style::new().reversed())
        .block(Block::bordered().title(title));
    frame.render_stateful_widget(table, area, &mut TableState::new().with_selected(selected));
}

/// s, as people say it.
pub(super) fn time(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() => "-".into(),
        s if s < 60.0 => format!("{s:.1} s"),
        s if s < 3600.0 => format!("{:.0} min {:02.0} s", (s / 60.0).floor(), (s % 60.0).floor()),
        s => format!("{:.0} h {:02.0} min", (s / 3600.0).floor(), (s % 3600.0 / 60.0).floor()),
    }
}

/// Bytes, as people say them.
pub(super) fn size(bytes: f64) -> String {
    match bytes {
        b if b < 1e3 => format!("{b:.0} B"),
        b if b < 1e6 => format!("{:.1} kB", b / 1e3),
        b if b < 1e9 => format!("{:.1} MB", b / 1e6),
        b => format!("{:.1} GB", b / 1e9),
    }
}

/// A message's timestamp as the time of the day, to the second.
pub(super) fn time_of_day(timestamp: i64) -> String {
    let mut text = TimeOfDay(u64::try_from(timestamp).unwrap_or_default().saturating_mul(1000)).to_string();
    text.truncate(8);
    text
}
