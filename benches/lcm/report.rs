//! Medians over rounds, ratios, goals: as a Markdown table or as JSON.

use crate::run::{DISTURBED, Figures, Test};
use std::fmt::Write;

/// Transports by their names, with their labels in the table.
pub const TRANSPORTS: [(&str, &str); 6] = [
    ("raw", "multicast sockets"),
    ("official", "official LCM"),
    ("udpm", "ours"),
    ("udpm-epoll", "ours in epoll"),
    ("shm", "ours with shm"),
    ("shm-epoll", "with shm in epoll"),
];

/// One measurement.
pub struct Row {
    pub round: usize,
    pub test: Test,
    pub transport: &'static str,
    pub figures: Figures,
    /// Share of one CPU taken by other programs meanwhile.
    pub foreign: f64,
}

/// Goal of a figure.
#[derive(Clone, Copy)]
enum Goal {
    AtMost(f64),
    AtLeast(f64),
    /// Maximum ratio to this transport's figure in the same run.
    Ratio(f64, &'static str),
}
use Goal::{AtLeast, AtMost, Ratio};

/// Line of the table.
struct Line {
    test: Test,
    figure: &'static str,
    label: &'static str,
    goals: &'static [(&'static str, Goal)],
}

const fn line(test: Test, figure: &'static str, label: &'static str) -> Line {
    Line { test, figure, label, goals: &[] }
}

impl Line {
    const fn goals(self, goals: &'static [(&'static str, Goal)]) -> Self {
        Self { goals, ..self }
    }
}

const TABLE: [Line; 26] = [
    line(Test::Trip(64), "p50", "round trip 64 B on one processor, median, µs")
        .goals(&[("udpm", Ratio(1.15, "raw")), ("shm", Ratio(0.42, "raw"))]),
    line(Test::Trip(64), "p99", "p99, µs"),
    line(Test::Trip(64), "cpu", "CPU of both, µs"),
    line(Test::Trip(1024), "p50", "round trip 1 KiB on one processor, median, µs")
        .goals(&[("shm", Ratio(0.42, "raw"))]),
    line(Test::Trip(1024), "p99", "p99, µs"),
    line(Test::Trip(1024), "cpu", "CPU of both, µs"),
    line(Test::Trip(65_536), "p50", "round trip 64 KiB on one processor, median, µs")
        .goals(&[("udpm", Ratio(1.15, "raw")), ("shm", Ratio(0.25, "raw"))]),
    line(Test::Trip(65_536), "p99", "p99, µs"),
    line(Test::Trip(65_536), "cpu", "CPU of both, µs"),
    line(Test::Flood(64), "received", "flood of 64 B, received/s")
        .goals(&[("udpm", AtLeast(200_000.0)), ("shm", AtLeast(2_000_000.0))]),
    line(Test::Flood(64), "loss", "lost, %").goals(&[("udpm", AtMost(0.0))]),
    line(Test::Flood(64), "cpu", "CPU per received message, µs").goals(&[("udpm", Ratio(0.65, "official"))]),
    line(Test::Flood(65_536), "received", "flood of 64 KiB, received/s"),
    line(Test::Flood(65_536), "loss", "lost, %"),
    line(Test::Flood(65_536), "cpu", "CPU per received message, µs"),
    line(Test::Crowd, "cpu", "20 subscribers, 1 interested: CPU per message, all, µs")
        .goals(&[("udpm", Ratio(0.3, "official"))]),
    line(Test::Crowd, "loss", "lost, %").goals(&[("udpm", AtMost(0.0)), ("shm", AtMost(0.0))]),
    line(Test::Talos, "sent", "Talos × 10 to 3 subscribers, sent/s")
        .goals(&[("udpm", AtLeast(67_000.0)), ("shm", AtLeast(67_000.0))]),
    line(Test::Talos, "loss", "lost by the worst off, %").goals(&[("udpm", AtMost(0.0)), ("shm", AtMost(0.0))]),
    line(Test::Talos, "cpu", "CPU per message, all, µs"),
    line(Test::Top, "rate", "the same mix: highest rate that loses nothing, /s"),
    line(Test::Idle, "threads", "idle subscriber: threads"),
    line(Test::Idle, "rss", "resident, KiB"),
    line(Test::Idle, "private", "of these its own, KiB"),
    line(Test::Idle, "cpu", "CPU per second, µs"),
    line(Test::Idle, "wakes", "wake-ups per second"),
];

/// Tests of the table, in its order.
pub fn tests() -> Vec<Test> {
    let mut tests: Vec<Test> = TABLE.iter().map(|line| line.test).collect();
    tests.dedup();
    tests
}

fn median(rows: &[Row], line: &Line, transport: &str) -> Option<f64> {
    let rows = rows.iter().filter(|row| row.test == line.test && row.transport == transport);
    let mut values: Vec<f64> = rows.filter_map(|row| row.figures.get(line.figure).copied()).collect();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        len if len % 2 == 1 => Some(values[middle]),
        _ => Some(f64::midpoint(values[middle - 1], values[middle])),
    }
}

/// Table; ratios to multicast sockets, or to the official library without them.
pub fn markdown(rows: &[Row], machine: &str) -> String {
    let present = |name: &str| rows.iter().any(|row| row.transport == name);
    let transports: Vec<_> = TRANSPORTS.into_iter().filter(|(name, _)| present(name)).collect();
    let mut out = String::from("| |");
    transports.iter().for_each(|(_, label)| out += &format!(" {label} |"));
    out += " goal | reached |\n|---|";
    transports.iter().for_each(|_| out += "---|");
    out += "---|---|\n";
    for line in &TABLE {
        let values: Vec<_> = transports.iter().map(|(name, _)| median(rows, line, name)).collect();
        let Some(base) = values.iter().copied().flatten().next() else { continue };
        let _ = write!(out, "| {} |", line.label);
        for value in values {
            out += &value.map_or(" - |".into(), |value| format!(" {}{} |", number(value), times(value, base)));
        }
        let verdicts = line.goals.iter().filter_map(|goal| verdict(rows, line, *goal));
        let (goals, reached): (Vec<_>, Vec<_>) = verdicts.unzip();
        let _ = writeln!(out, " {} | {} |", goals.join("; "), reached.join("; "));
    }
    let disturbed = rows.iter().filter(|row| row.foreign >= DISTURBED).count();
    let rounds = rows.iter().map(|row| row.round + 1).max().unwrap_or(0);
    let _ = write!(
        out,
        "\n{machine} Medians of {rounds} interleaved rounds; {disturbed} of {} measurements disturbed by other \
         programs.\n",
        rows.len()
    );
    out
}

/// Goal in words, and its result; `None` if it was not measured.
fn verdict(rows: &[Row], line: &Line, (transport, goal): (&str, Goal)) -> Option<(String, String)> {
    let value = median(rows, line, transport)?;
    let label = |name: &str| TRANSPORTS.iter().find(|(known, _)| *known == name).map_or("", |(_, label)| *label);
    let (text, reached) = match goal {
        AtMost(bound) => (format!("≤ {}", number(bound)), value <= bound),
        AtLeast(bound) => (format!("≥ {}", number(bound)), value >= bound),
        Ratio(bound, other) => {
            let ratio = value / median(rows, line, other)?;
            (format!("≤ {bound} × {}", label(other)), ratio <= bound)
        }
    };
    Some((format!("{} {text}", label(transport)), if reached { "yes".into() } else { "**no**".into() }))
}

fn times(value: f64, base: f64) -> String {
    let ratio = value / base;
    if ratio.is_finite() && base > 0.0 && value > 0.0 && ratio != 1.0 {
        format!(" ({ratio:.2} ×)")
    } else {
        String::new()
    }
}

fn number(value: f64) -> String {
    match value {
        100.0.. => format!("{value:.0}"),
        0.0 => "0".into(),
        0.0..0.1 => format!("{value:.3}"),
        _ => format!("{value:.1}"),
    }
}

/// All measurements as JSON.
pub fn json(rows: &[Row], machine: &str) -> String {
    let quote = |text: &str| format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""));
    let row = |row: &Row| {
        let figures = row.figures.iter().map(|(name, value)| format!("{}:{value}", quote(name)));
        format!(
            "{{\"round\":{},\"test\":{},\"transport\":{},\"foreign\":{:.4},{}}}",
            row.round,
            quote(&row.test.name()),
            quote(row.transport),
            row.foreign,
            figures.collect::<Vec<_>>().join(",")
        )
    };
    let rows: Vec<String> = rows.iter().map(row).collect();
    format!("{{\"machine\":{},\"rows\":[\n{}\n]}}", quote(machine), rows.join(",\n"))
}
