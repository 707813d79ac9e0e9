//! The modules and their processes.

use super::{Listing, age, clip, fact, pane, size, split, table, time, time_of_day};
use crate::diag::app::App;
use crate::diag::rows;
use base::{Duration, Instant};
use diagnostics::{Knowledge, Model, ModuleRow};
use ratatui::Frame;
use ratatui::layout::{Constraint, Rect};
use ratatui::style::{Color, Style};
use ratatui::text::Line;
use ratatui::widgets::Row;

pub fn draw(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let modules = rows::modules(app, now);
    let keys: Vec<String> = modules.iter().map(|row| row.module.clone()).collect();
    let marked = app.marked(&keys);
    let detail = modules.get(marked).filter(|_| app.expanded).map(|row| {
        let (model, at) = app.shown(now);
        (clip(&row.module), lines(model, row, at))
    });
    let [upper, lower] = split(area, detail.as_ref().map_or(0, |(_, lines)| lines.len()));
    let upper = if detail.is_some() { upper } else { area };
    let wide = area.width >= 100;
    let cells = |row: ModuleRow| {
        let name = format!("{}{}", clip(&row.module), if row.critical { " *" } else { "" });
        let pid = if row.pid == 0 { "-".into() } else { row.pid.to_string() };
        let is_guarded = row.phase != "stranger";
        let of_process = |text: String| if is_guarded { text } else { "-".into() };
        let cells = [
            if row.well { "".into() } else { "!".into() },
            name,
            state(&row),
            process(&row).to_owned(),
            age(row.age.filter(|age| age.is_finite()).map(Duration::from_secs_f64)),
            of_process(time(row.uptime)),
            of_process(format!("{:.1} %", 100.0 * row.cpu)),
            of_process(size(row.rss as f64)),
            of_process(row.restarts.to_string()),
            of_process(pid),
            row.last_exit,
        ];
        Row::new(cells).style(if row.well { Style::new() } else { Style::new().fg(Color::Red).bold() })
    };
    let head = ["", "module", "state", "process", "age", "up", "cpu", "memory", "again", "pid", "last exit"];
    let widths = [1, 15, if wide { 22 } else { 13 }, 8, 5, 9, 6, 8, 5, 7].map(Constraint::Length);
    let widths: Vec<_> = widths.into_iter().chain([Constraint::Min(10)]).collect();
    // Columns without room on a narrow screen are in the marked row's details.
    let widths = if wide { &widths[..] } else { &widths[..9] };
    let title = format!(" modules  * critical  order: {} (o)  c command ", app.order());
    let rows = modules.into_iter().map(cells).collect();
    table(frame, upper, Listing { title, head: &head, widths, rows, marked });
    if let Some((name, lines)) = detail {
        pane(frame, lower, format!(" {name} "), lines);
    }
}

/// A line each, for a place beside another view.
pub fn brief(app: &App, now: Instant) -> Vec<Line<'static>> {
    let line = |row: ModuleRow| {
        let mark = if row.well { ' ' } else { '!' };
        let age = age(row.age.filter(|age| age.is_finite()).map(Duration::from_secs_f64));
        let cpu = 100.0 * row.cpu;
        let text = format!("{mark} {:<16}{:<18}{:<9}{age} {cpu:5.1} %", clip(&row.module), state(&row), process(&row));
        Line::styled(text, if row.well { Style::new() } else { Style::new().fg(Color::Red).bold() })
    };
    let (model, at) = app.shown(now);
    model.modules(at).into_iter().map(line).collect()
}

/// State of its process; unknown without a watchdog.
fn process(row: &ModuleRow) -> &'static str {
    match row.phase {
        "stranger" if row.module == watchdog::NAME => "-",
        "stranger" => "external",
        phase => phase,
    }
}

fn state(row: &ModuleRow) -> String {
    match row.wanted {
        "" => row.state.into(),
        wanted if wanted == row.state => row.state.into(),
        wanted => format!("{} ({wanted}!)", row.state),
    }
}

/// All about one.
fn lines(model: &Model, row: &ModuleRow, now: Instant) -> Vec<Line<'static>> {
    let announced = row.age.map_or("never announced".into(), |age| format!("announced {age:.1} s ago"));
    let wanted = if row.wanted.is_empty() { "nobody commands it" } else { row.wanted };
    let last = if row.last_exit.is_empty() { "it never ended" } else { &row.last_exit };
    let critical = if row.critical { "yes: the robot does not move without it" } else { "no" };
    let mut lines = vec![
        fact("state", &format!("{}, {announced}; wanted: {wanted}", row.state)),
        fact(
            "process",
            &match row.phase {
                "stranger" => "not supervised by a watchdog".into(),
                phase => format!("{phase}, pid {}, up {}", row.pid, time(row.uptime)),
            },
        ),
        fact("last exit", last),
        fact("restarts", &row.restarts.to_string()),
        fact("takes", &format!("{:.1} % of a core, {}", 100.0 * row.cpu, size(row.rss as f64))),
        fact("critical", critical),
    ];
    if !row.print_from.is_empty() {
        let changed = if row.levels_changed { ", changed until its process ends" } else { "" };
        lines.push(fact("levels", &format!("prints from {}, sends from {}{changed}", row.print_from, row.send_from)));
    }
    if model.errors.knowledge(&row.module, now) == Knowledge::Unknown {
        lines.push(fact("faults", "not known: it does not list them, or does not run"));
    }
    let errors = model.errors.groups(now).into_iter().filter(|group| group.standing && group.module == row.module);
    lines.extend(errors.take(3).map(|group| {
        let word = if group.known { "active" } else { "was active" };
        fact(word, &format!("{} since {}: {}", group.about(), time_of_day(group.last), group.message))
    }));
    lines
}
