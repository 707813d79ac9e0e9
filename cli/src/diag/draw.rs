//! The screen as a function of the state: head, one view, foot. Each value has its age; a stale one is grey, its age
//! has a `!`, and nothing is shown by colour alone.

mod buses;
mod errors;
mod help;
mod logs;
mod messages;
mod modules;
mod near;
mod overview;

use super::app::{App, Mode, Tab};
use super::command;
use base::{Duration, Instant};
use diagnostics::{Concern, Freshness, RobotStatus, Slot, Status};
use host::log::TimeOfDay;
use ratatui::Frame;
use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Row, Table, TableState, Wrap};

/// Outline of the robot's body for the picture, by the configuration: m from the rear axle's centre.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    pub rear: f64,
    pub front: f64,
    pub half_width: f64,
    /// Full opening angle of a sonar's beam where the message does not have it, rad.
    pub sonar_beam: f64,
}

/// The least that a view can be read on.
const LEAST: (u16, u16) = (40, 10);
/// Lines of the status.
const STATUS_MAX: usize = 3;
/// Maximum number of characters shown of a text.
const TEXT_MAX: usize = 600;
/// Maximum number of concerns in the status line.
const CONCERNS_SHOWN: usize = 3;
const GREY: Color = Color::DarkGray;

/// Draws everything.
pub fn draw(frame: &mut Frame<'_>, app: &App, body: Body, now: Instant) {
    draw_all(frame, app, body, now);
    make_harmless(frame.buffer_mut());
}

fn draw_all(frame: &mut Frame<'_>, app: &App, body: Body, now: Instant) {
    let area = frame.area();
    let (status, concerns) = (app.status(now), app.concerns(now));
    let headline = || status_line(&status, &concerns);
    if area.width < LEAST.0 || area.height < LEAST.1 {
        let small = Line::from("(the terminal is too small)").dim();
        let drive = Line::from(drive_text(app, now).unwrap_or_default());
        frame.render_widget(Paragraph::new(vec![headline(), drive, small]).wrap(Wrap { trim: false }), area);
        return;
    }
    // A reason that is longer than a line has more; words are wrapped, which costs some room.
    let lines = match headline().width() {
        fits if fits <= usize::from(area.width) => 1,
        long => long.div_ceil(usize::from(area.width - 10)).min(STATUS_MAX) as u16,
    };
    let [first, tabs, view, foot] =
        Layout::vertical([Constraint::Length(lines), Constraint::Length(1), Constraint::Min(1), Constraint::Length(1)])
            .areas(area);
    frame.render_widget(Paragraph::new(headline()).wrap(Wrap { trim: false }), first);
    draw_tabs(frame, app, tabs, now);
    match app.tab {
        _ if app.mode == Mode::Help => help::draw(frame, app, view),
        Tab::Overview => overview::draw(frame, app, body, view, now),
        Tab::Modules => modules::draw(frame, app, view, now),
        Tab::Buses => buses::draw(frame, app, view, now),
        Tab::Errors => errors::draw(frame, app, view, now),
        Tab::Messages => messages::draw(frame, app, view, now),
        Tab::Logs => logs::draw(frame, app, view, now),
    }
    draw_foot(frame, app, foot, now);
}

/// The bus is hostile input: what could move a terminal's cursor or turn its text around is not handed on.
fn make_harmless(buffer: &mut Buffer) {
    for cell in &mut buffer.content {
        if cell.symbol().contains(is_harmful) {
            cell.set_symbol("?");
        }
    }
}

/// Controls, C1 among them, and what directs, joins or hides text.
pub fn is_harmful(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{ad}' | '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

/// The status is what is now, even while the rest is frozen: whether the robot may be driven, and whether it is well.
fn status_line(status: &Status, concerns: &[Concern]) -> Line<'static> {
    let colour = match status.word {
        RobotStatus::Driving | RobotStatus::Ready | RobotStatus::Waiting if !concerns.is_empty() => Color::Yellow,
        RobotStatus::Driving | RobotStatus::Ready => Color::Green,
        RobotStatus::Waiting => Color::Cyan,
        RobotStatus::Stopped | RobotStatus::Paused => Color::Yellow,
        RobotStatus::Fault | RobotStatus::Silent => Color::Red,
    };
    let word = Span::styled(format!(" {} ", status.word.text()), Style::new().bg(colour).fg(Color::Black).bold());
    let reason = Span::raw(format!(" {}", clip(&status.reason)));
    let (shown, more) = concerns.split_at(concerns.len().min(CONCERNS_SHOWN));
    let mut concerns = shown.iter().map(|concern| format!(" ! {}", concern.words)).collect::<String>();
    if !more.is_empty() {
        concerns += &format!(" ! and {} more", more.len());
    }
    let concerns = Span::styled(clip(&concerns), Style::new().fg(Color::Yellow));
    match status.word {
        // Without contact nothing is known; a fault is what matters.
        RobotStatus::Silent | RobotStatus::Fault => Line::from(vec![word, reason]),
        RobotStatus::Ready | RobotStatus::Driving if !concerns.content.is_empty() => {
            Line::from(vec![word, concerns, Span::raw(" \u{b7}"), reason])
        }
        _ => Line::from(vec![word, reason, concerns]),
    }
}

fn draw_tabs(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let mut tabs = vec![Span::raw(format!(" {} ", clip(app.robot()))).bold()];
    let (unwell, errors) = app.troubles(now);
    for (n, tab) in Tab::ALL.into_iter().enumerate() {
        let style = if tab == app.tab { Style::new().reversed() } else { Style::new() };
        let trouble = match tab {
            Tab::Modules if unwell > 0 => format!("!{unwell}"),
            Tab::Errors if errors > 0 => format!("!{errors}"),
            _ => String::new(),
        };
        tabs.push(Span::styled(format!(" {}{}{trouble} ", n + 1, tab.name()), style));
    }
    if let Some(frozen) = &app.frozen {
        let age = age(Some(now.since(frozen.at)));
        tabs.push(format!(" FROZEN {} ", age.trim()).bold().reversed());
    }
    if app.read_only {
        tabs.push(" read-only".dim());
    }
    frame.render_widget(Paragraph::new(Line::from(tabs)), area);
}

fn draw_foot(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let text = match &app.mode {
        Mode::Command(line) => {
            let (model, at) = app.shown(now);
            let modules: Vec<String> = model.modules(at).into_iter().map(|row| row.module).collect();
            let choices = command::choices(line, &modules, &app.faults);
            let room = usize::from(area.width).saturating_sub(line.chars().count() + 5);
            let usage = match command::usage(line) {
                _ if !choices.is_empty() => format!("   {}", listed(&choices, room)),
                Some((usage, what)) => format!("   {usage}: {what}"),
                None => "   tab completes, up: earlier, esc: none".into(),
            };
            // What is typed is seen to its end.
            let over = line.chars().count().saturating_sub(usize::from(area.width).saturating_sub(3));
            format!(":{}\u{2588}{usage}", line.chars().skip(over).collect::<String>())
        }
        Mode::Filter(line) => format!("/{line}\u{2588}   only what contains it; enter keeps it, esc: all"),
        Mode::Confirm(what, _) => format!("{what}? y: yes, any other key: no"),
        _ => match (app.said(now), drive_text(app, now)) {
            (Some(said), _) => clip(said),
            (None, Some(text)) => format!("{text}  +- speed  space stop  d end"),
            (None, None) if !app.filter.is_empty() => format!("filter /{}   esc: all", app.filter),
            (None, None) if app.tab == Tab::Overview => {
                "space STOP  d drive  h home  : command  f freeze  enter more  ? help  q quit".into()
            }
            (None, None) => "space STOP  d drive  : command  / filter  o order  enter more  ? help  q quit".into(),
        },
    };
    frame.render_widget(Paragraph::new(text).style(Style::new().add_modifier(Modifier::REVERSED)), area);
}

/// As many whole words as there is room for; a `…` stands for the others.
fn listed(words: &[&str], room: usize) -> String {
    let mut text = String::new();
    for (place, word) in words.iter().enumerate() {
        let gap = if place == 0 { "" } else { " " };
        let len = text.chars().count() + gap.len() + word.chars().count();
        let sign = if place + 1 == words.len() { 0 } else { " …".chars().count() };
        if len + sign > room {
            return text + gap + "…";
        }
        text += gap;
        text += word;
    }
    text
}

/// Keys while driving, and the remaining time of the last one.
fn drive_text(app: &App, now: Instant) -> Option<String> {
    let what = match app.drive.runs_for(now) {
        _ if !app.drive.is_taken() => return None,
        None => format!("you drive: zero; hold an arrow ({:.2} m/s)", app.drive.speed),
        Some(left) => format!("you drive: RUNS {:.1} s more, {:+.2} m/s", left.as_secs_f64(), app.drive.command()),
    };
    Some(what)
}

/// A text of others: not longer than anybody reads.
pub(super) fn clip(text: &str) -> String {
    let end = text.char_indices().nth(TEXT_MAX).map_or(text.len(), |(end, _)| end);
    text[..end].into()
}

/// Style of a value that may be stale.
pub(super) fn style<T>(slot: &Slot<T>, now: Instant) -> Style {
    match slot.freshness(now) {
        Freshness::Fresh => Style::new(),
        Freshness::Stale | Freshness::Never => Style::new().fg(GREY),
    }
}

/// An age in five characters.
pub(super) fn age(age: Option<Duration>) -> String {
    match age.map(|age| age.as_secs_f64()) {
        None => "    -".into(),
        Some(s) if s < 9.95 => format!("{s:4.1}s"),
        Some(s) if s < 100.0 => format!("{s:4.0}s"),
        Some(s) if s < 6000.0 => format!("{:4.0}m", s / 60.0),
        Some(s) => format!("{:4.0}h", (s / 3600.0).min(9999.0)),
    }
}

/// Age of a value; a stale one with a `!` before it.
pub(super) fn mark_of_age<T>(slot: &Slot<T>, now: Instant) -> String {
    let text = age(slot.age(now));
    match slot.freshness(now) {
        Freshness::Stale => format!("!{}", text.trim()),
        Freshness::Fresh | Freshness::Never => text.trim().to_owned(),
    }
}

/// Line of a value: name, age, text; or its absence.
pub(super) fn line<T>(name: &str, slot: &Slot<T>, now: Instant, text: impl FnOnce(&T) -> String) -> Line<'static> {
    let text = slot.get().map_or("-".into(), |value| clip(&text(value)));
    let style = style(slot, now);
    let head = Span::raw(format!("{name:<9}")).bold();
    let age = Span::styled(format!("{:>6} ", mark_of_age(slot, now)), Style::new().fg(GREY));
    Line::from(vec![head, age, Span::styled(text, style)])
}

/// Table with a marked row.
pub(super) struct Listing<'a> {
    pub title: String,
    pub head: &'a [&'a str],
    pub widths: &'a [Constraint],
    pub rows: Vec<Row<'a>>,
    pub marked: usize,
}

/// Draws it.
pub(super) fn table(frame: &mut Frame<'_>, area: Rect, listing: Listing<'_>) {
    let Listing { title, head, widths, rows, marked } = listing;
    let selected = if rows.is_empty() { None } else { Some(marked.min(rows.len() - 1)) };
    let table = Table::new(rows, widths.iter().copied())
        .header(Row::new(head.to_vec()).bold().underlined())
        .row_highlight_style(Style::new().reversed())
        .block(Block::bordered().title(title));
    frame.render_stateful_widget(table, area, &mut TableState::new().with_selected(selected));
}

/// Splits an area: `lower` lines below, if there is room.
pub(super) fn split(area: Rect, lower: usize) -> [Rect; 2] {
    let lower = u16::try_from(lower + 2).unwrap_or(u16::MAX).min(area.height.saturating_sub(5));
    Layout::vertical([Constraint::Min(3), Constraint::Length(lower)]).areas(area)
}

/// Some lines in a frame.
pub(super) fn pane(frame: &mut Frame<'_>, area: Rect, title: String, lines: Vec<Line<'_>>) {
    let text = Paragraph::new(lines).wrap(Wrap { trim: false });
    frame.render_widget(text.block(Block::bordered().title(title)), area);
}

/// A line of a pane that has no age of its own.
pub(super) fn fact(name: &str, text: &str) -> Line<'static> {
    Line::from(vec![Span::raw(format!("{name:<12}")).bold(), Span::raw(clip(text))])
}

/// Duration for people; s.
pub(super) fn time(seconds: f64) -> String {
    crate::duration(seconds)
}

/// Size for people; bytes.
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
