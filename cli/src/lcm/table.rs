//! `advee lcm list, hz, bw`: what travels on the bus, a line a channel. On a terminal the table is renewed in place;
//! elsewhere, and with `--json`, it is printed once at the end.

use super::ear::{Ear, Heard, Losses, silence};
use super::stats::{Channel, Rates, Stats};
use super::types::{Dictionary, Found, TypesArg};
use crate::{Common, Failed, Outcome, print, seconds};
use base::{Duration, Instant};
use host::clock;
use lcm::subscription::Pattern;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::{self, IsTerminal, Write as _};
use std::process::ExitCode;

/// Arguments common to list, hz and bw.
#[derive(clap::Args)]
pub struct Table {
    /// Channels, by a regular expression that must match the whole name
    #[arg(default_value = ".*", hide_default_value = true)]
    filter: String,
    /// JSON lines at the end: one a channel, then {"total": …}
    #[arg(long)]
    json: bool,
    /// Duration, s; without it until Ctrl-C on a terminal, else 2 s
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
    /// Length of the window of rates, s
    #[arg(long, value_name = "S", value_parser = seconds, default_value = "5")]
    window: Duration,
    #[command(flatten)]
    types: TypesArg,
}

/// Which of them.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum View {
    List,
    Hz,
    Bw,
}

/// Default duration without a terminal: modules announce themselves once a second.
const GLANCE: Duration = Duration::from_secs(2);
/// Period of updates of the table.
const RENEW: Duration = Duration::from_millis(500);

pub fn table(common: &Common, command: &Table, view: View) -> Outcome {
    let types = Dictionary::load(&command.types)?;
    let live = !command.json && io::stdout().is_terminal();
    let time = command.time.or((!live).then_some(GLANCE));
    let filter = Pattern::new(&command.filter).map_err(|error| Failed::from(error.to_string()))?;
    // What is lost shows only in all messages of a publisher.
    let mut ear = Ear::open(common, ".*", time)?;
    let mut stats = Stats::new(u64::try_from(command.window.as_nanos()).unwrap_or(u64::MAX));
    let mut screen = Screen::default();
    let mut wake = if live { clock::now() } else { Instant::NEVER };
    let interrupted = loop {
        match ear.hear(wake)? {
            Heard::Message(raw) if !filter.matches(raw.channel) => {}
            Heard::Message(raw) => {
                if let Some(channel) = stats.hear(raw.channel, raw.data.len(), raw.received_ns) {
                    channel.fingerprint = lcm::codec::fingerprint(raw.data);
                    let bad = matches!(types.find(raw.channel, raw.data), Found::Malformed(..) | Found::Misplaced(..));
                    channel.bad += u64::from(bad);
                }
            }
            Heard::Nothing => {
                let now = clock::now();
                if now >= wake {
                    screen.renew(&lines(view, &types, &stats, &ear.losses(), clock::wall()))?;
                    wake = now + RENEW;
                }
            }
            Heard::End => break false,
            Heard::Interrupt => break true,
        }
    };
    if stats.is_empty() && !interrupted {
        silence(common, &command.filter, time);
    }
    let now = clock::wall();
    if command.json {
        stats.rows(now).try_for_each(|(name, channel, rates)| print(object(&types, name, channel, &rates)))?;
        print(total(&stats, &ear.losses(), now))?;
    } else {
        drop(screen);
        lines(view, &types, &stats, &ear.losses(), now).iter().try_for_each(print)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The type, and what is wrong with it.
fn type_of(types: &Dictionary, name: &str, channel: &Channel) -> String {
    let mut text = match channel.fingerprint {
        None => "no message".into(),
        Some(fingerprint) => match types.by_fingerprint(name, fingerprint) {
            Some(ty) => ty.name().into(),
            None => format!("unknown {fingerprint:016x}"),
        },
    };
    if channel.bad > 0 {
        let _ = write!(text, ", {} wrong", channel.bad);
    }
    text
}

/// A line of JSON; the keys stay.
fn object(types: &Dictionary, name: &str, channel: &Channel, rates: &Rates) -> Value {
    let ty = channel.fingerprint.and_then(|fingerprint| types.by_fingerprint(name, fingerprint));
    json!({
        "channel": name,
        "type": ty.map(lcm_gen::dynamic::Type::name),
        "fingerprint": channel.fingerprint.map(|fingerprint| format!("{fingerprint:016x}")),
        "messages": channel.messages,
        "bytes": channel.bytes,
        "wrong": channel.bad,
        "hz": rates.hz,
        "bytes_per_s": rates.bytes_per_s,
        "size": {"min": rates.size.0, "mean": rates.size.1, "max": rates.size.2},
        "gap_s": {"min": rates.gap_s.0, "mean": rates.gap_s.1, "max": rates.gap_s.2, "std": rates.gap_std_s},
        "age_s": rates.age_s,
    })
}

/// The last line of JSON; the keys stay.
fn total(stats: &Stats, losses: &Losses, now_ns: u64) -> Value {
    let sum = |what: fn(&Channel) -> u64| stats.rows(now_ns).map(|(_, channel, _)| what(channel)).sum::<u64>();
    let publisher = |(address, datagrams, lost): &(String, u64, u64)| json!({"address": address, "datagrams": datagrams, "lost": lost});
    json!({"total": {
        "channels": stats.rows(now_ns).count(),
        "messages": sum(|channel| channel.messages),
        "bytes": sum(|channel| channel.bytes),
        "lost": losses.lost,
        "kernel_dropped": losses.kernel_dropped,
        "incomplete": losses.incomplete,
        "not_lcm": losses.malformed,
        "not_followed": stats.beyond,
        "publishers": losses.publishers.iter().map(publisher).collect::<Vec<_>>(),
    }})
}

/// Heading, a line a channel, and what all of them make together.
fn lines(view: View, types: &Dictionary, stats: &Stats, losses: &Losses, now_ns: u64) -> Vec<String> {
    let heading: &[&str] = match view {
        View::List => &["CHANNEL", "TYPE", "HZ", "kB/s", "BYTES", "GAP ms", "", "AGE s", "COUNT"],
        View::Hz => &["CHANNEL", "HZ", "MEAN ms", "MIN ms", "MAX ms", "STD ms", "COUNT"],
        View::Bw => &["CHANNEL", "kB/s", "HZ", "BYTES", "MIN", "MAX", "TOTAL kB"],
    };
    let mut cells: Vec<Vec<String>> = vec![heading.iter().map(ToString::to_string).collect()];
    for (name, channel, rates) in stats.rows(now_ns) {
        cells.push(row(view, types, name, channel, &rates));
    }
    let left = if view == View::List { 2 } else { 1 };
    let mut lines = aligned(&cells, left);
    lines.push(summary(stats, losses, now_ns));
    lines
}

fn row(view: View, types: &Dictionary, name: &str, channel: &Channel, rates: &Rates) -> Vec<String> {
    let known = |value: Option<f64>, decimals: usize| value.map_or("-".into(), |value| format!("{value:.decimals$}"));
    let (hz, kb) = (known(rates.hz, 2), known(rates.bytes_per_s.map(|bytes| bytes / 1e3), 2));
    let has_gap = channel.messages > 1;
    let ms = |s: f64, decimals: usize| known(has_gap.then_some(s * 1e3), decimals);
    let name = shown(name);
    match view {
        View::List => {
            let decimals = if rates.gap_s.2 < 1.0 { 1 } else { 0 };
            let gaps = [
                ms(rates.gap_s.0, decimals),
                if has_gap { format!("..{}", ms(rates.gap_s.2, decimals)) } else { String::new() },
            ];
            let [least, greatest] = gaps;
            let age = format!("{:.1}", rates.age_s);
            let ty = type_of(types, &name, channel);
            vec![name, ty, hz, kb, channel.size.to_string(), least, greatest, age, channel.messages.to_string()]
        }
        View::Hz => vec![
            name,
            hz,
            ms(rates.gap_s.1, 2),
            ms(rates.gap_s.0, 2),
            ms(rates.gap_s.2, 2),
            ms(rates.gap_std_s, 2),
            rates.messages.to_string(),
        ],
        View::Bw => vec![
            name,
            kb,
            hz,
            format!("{:.0}", rates.size.1),
            rates.size.0.to_string(),
            rates.size.2.to_string(),
            format!("{:.1}", channel.bytes as f64 / 1e3),
        ],
    }
}

/// A channel's name as a terminal may have it: nothing in it acts.
pub fn shown(name: &str) -> String {
    name.escape_debug().to_string()
}

/// Columns as wide as their widest cell; the first `left` of them begin together, the others end together.
pub fn aligned(cells: &[Vec<String>], left: usize) -> Vec<String> {
    let columns = cells.first().map_or(0, Vec::len);
    let width = |column: usize| cells.iter().map(|row| row[column].chars().count()).max().unwrap_or_default();
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let mut line = String::new();
        for (i, (cell, width)) in row.iter().zip(&widths).enumerate() {
            let gap = match (i, cell.starts_with("..")) {
                (0, _) | (_, true) => "",
                _ => "  ",
            };
            let _ = if i < left || cell.starts_with("..") {
                write!(line, "{gap}{cell:width$}")
            } else {
                write!(line, "{gap}{cell:>width$}")
            };
        }
        line.truncate(line.trim_end().len());
        line
    };
    cells.iter().map(line).collect()
}

fn summary(stats: &Stats, losses: &Losses, now_ns: u64) -> String {
    let (mut channels, mut hz, mut bytes) = (0, 0.0, 0.0);
    for (_, _, rates) in stats.rows(now_ns) {
        channels += 1;
        hz += rates.hz.unwrap_or_default();
        bytes += rates.bytes_per_s.unwrap_or_default();
    }
    let s = if channels == 1 { "" } else { "s" };
    let mut line = format!("{channels} channel{s}, {hz:.1} messages/s, {:.1} kB/s; ", bytes / 1e3);
    if losses.lost == 0 {
        line.push_str("none lost");
    } else {
        let by = losses.publishers.iter().filter(|(_, _, lost)| *lost > 0).take(3);
        let by: Vec<String> = by.map(|(address, _, lost)| format!("{lost} of {address}")).collect();
        let _ = write!(line, "{} LOST ({})", losses.lost, by.join(", "));
    }
    for (count, what) in [
        (losses.kernel_dropped, "found no room in the receive buffer"),
        (losses.incomplete, "came in part"),
        (losses.malformed, "datagrams are not LCM's"),
    ] {
        if count > 0 {
            let _ = write!(line, ", {count} {what}");
        }
    }
    if stats.beyond > 0 {
        let _ = write!(line, ", {} messages on channels beyond {}", stats.beyond, super::stats::CHANNELS_MAX);
    }
    line
}

/// The terminal's other screen while the table is renewed. Every line is put in its place, so that the terminal's size
/// need not be known: what is too wide is cut, and of what is too much the last line, the summary, remains.
#[derive(Default)]
struct Screen {
    open: bool,
}

impl Screen {
    fn renew(&mut self, lines: &[String]) -> Result<(), Failed> {
        // Other screen, no cursor, no wrapping.
        let mut text = String::from(if self.open { "" } else { "\x1b[?1049h\x1b[?25l\x1b[?7l" });
        self.open = true;
        for (i, line) in lines.iter().enumerate() {
            let _ = write!(text, "\x1b[{};1H{line}\x1b[K", i + 1);
        }
        text.push_str("\x1b[J");
        put(&text).map_err(|error| Failed::from(format!("stdout: {error}")))
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        if self.open {
            let _ = put("\x1b[?7h\x1b[?25h\x1b[?1049l");
        }
    }
}

fn put(text: &str) -> io::Result<()> {
    let mut stdout = io::stdout();
    stdout.write_all(text.as_bytes())?;
    stdout.flush()
}
