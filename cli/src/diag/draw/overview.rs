//! Pose, commands, state and surroundings of the robot.

use super::near::{self, nearest};
use super::{Body, GREY, age, clip, line, size, time};
use super::{errors, modules};
use crate::diag::app::App;
use crate::diag::drive::Motion;
use crate::{goal, mode};
use base::{Duration, Instant};
use diagnostics::{BeaconState, CHARGE_EMPTY, CHARGE_LOW, Ellipse, HoldRow, Model, normalized_residual};
use messages::lowlevel::{DataPower, DataTemperature, Reading};
use messages::middlelevel::{BeaconUse, DataBeaconUse};
use messages::{Hold, StopSource, source_in_words};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Wrap};

const QUALITY: [&str; 4] = ["LOST", "SEARCHING", "COARSE", "FINE"];
/// Maximum number of command sources shown.
const SOURCES: usize = 4;
/// Width from which errors and modules are beside the overview, columns.
const WIDE: u16 = 160;
/// Beacons that are listed.
const BEACONS: usize = 12;
/// Causes for which it stands that are listed.
const HOLDS: usize = 8;

pub fn draw(frame: &mut Frame<'_>, app: &App, body: Body, area: Rect, now: Instant) {
    let (model, at) = app.shown(now);
    let title = if app.expanded { " robot   enter: less " } else { " robot   enter: more " };
    let (area, aside) = match area.width >= WIDE {
        true => {
            let [area, aside] = Layout::horizontal([Constraint::Fill(3), Constraint::Fill(2)]).areas(area);
            (area, Some(aside))
        }
        false => (area, None),
    };
    let left = if area.width < 100 { Constraint::Length(46) } else { Constraint::Percentage(50) };
    let [left, right] = Layout::horizontal([left, Constraint::Min(20)]).areas(area);
    if let Some(aside) = aside {
        draw_aside(frame, app, aside, now);
    }
    let lines = lines(app, model, at, now);
    if app.expanded {
        let more = more(model, at);
        let text = Paragraph::new(more).wrap(Wrap { trim: false });
        frame.render_widget(text.block(Block::bordered().title(" in detail ")), right);
    } else {
        near::draw(frame, model, body, right, at);
    }
    let text = Paragraph::new(lines).wrap(Wrap { trim: false });
    frame.render_widget(text.block(Block::bordered().title(title)), left);
}

/// Errors and modules, in a line each.
fn draw_aside(frame: &mut Frame<'_>, app: &App, area: Rect, now: Instant) {
    let modules = modules::brief(app, now);
    let height = u16::try_from(modules.len() + 2).unwrap_or(u16::MAX).min(area.height / 2);
    let [upper, lower] = Layout::vertical([Constraint::Min(3), Constraint::Length(height)]).areas(area);
    for (area, title, lines) in [(upper, " 4 errors ", errors::brief(app, now)), (lower, " 2 modules ", modules)] {
        // Lines are cut, so that each row stays one.
        frame.render_widget(Paragraph::new(lines).block(Block::bordered().title(title)), area);
    }
}

fn word(words: &[&'static str], number: i8) -> &'static str {
    usize::try_from(number).ok().and_then(|place| words.get(place)).copied().unwrap_or("?")
}

/// The most important lines come first: a small screen has no more.
fn lines(app: &App, model: &Model, at: Instant, now: Instant) -> Vec<Line<'static>> {
    let degrees = f64::to_degrees;
    let mut lines = Vec::new();
    if app.drive.is_taken() {
        let what = match app.drive.runs_for(now) {
            Some(left) => format!("RUNS {:.1} s", left.as_secs_f64()),
            None => "zero".into(),
        };
        let speed = app.drive.speed;
        let turn = match app.drive.motion() {
            Motion::Curve(_, angle) => format!("{:+.1} deg", degrees(angle)),
            Motion::Velocity(_, _, omega) => format!("{:+.1} deg/s", degrees(omega)),
        };
        lines.push(Line::from(format!("you drive  {what}  {speed:.2} m/s  {turn}")).bold());
    }
    lines.extend([
        line("position", &model.estimate, at, |e| format!("{:.2} {:.2} m {:+.1} deg", e.x, e.y, degrees(e.theta))),
        line("estimate", &model.estimate, at, |e| {
            let deviation = Ellipse::of(&e.covariance).map(|ellipse| format!("  +-{:.2} m", ellipse.long));
            format!("{}{}", word(&QUALITY, e.quality), deviation.unwrap_or_default())
        }),
        line("speed", &model.motion, at, |m| format!("{:+.2} m/s, target {:+.2}", m.speed, m.speed_target)),
    ]);
    // Of a robot that has a guard.
    lines.extend(model.bound(at).map(|bound| line("guard", &model.guard, at, |_| bound.words)));
    let turn = if app.drive.is_free() {
        line("rotation", &model.velocity, at, |v| {
            let aside = if app.drive.goes_sideways() { format!(", left {:+.2} m/s", v.vy) } else { String::new() };
            format!("{:+.1} deg/s, target {:+.1}{aside}", degrees(v.omega), degrees(v.omega_target))
        })
    } else {
        line("steering", &model.motion, at, |m| {
            let homed = if m.homed { "" } else { " NOT HOMED" };
            format!("{:+.1} deg, target {:+.1}{homed}", degrees(m.steering), degrees(m.steering_target))
        })
    };
    lines.extend([
        turn,
        line("source", &model.motion, at, |m| if m.source.is_empty() { "none".into() } else { model.driver() }),
    ]);
    lines.extend(holds(model, at));
    lines.extend([
        line("PAUSE", &model.stop, at, |s| {
            if s.engaged {
                format!("ENGAGED by {}", StopSource::in_words(&s.source))
            } else {
                "line is released".into()
            }
        }),
        sonar_line("nearest", model, at, nearest),
        battery(model, at),
        line("heat", &model.temperatures, at, hottest),
        line("fans", &model.temperatures, at, fans),
        line("power", &model.power, at, |heard| switched_off(model, heard)),
        line("recorder", &model.log, at, |l| {
            let what = if l.recording { "writes, " } else { "RECORDS NOTHING, " };
            format!("{what}{} free", size(l.free as f64))
        }),
        line("goal", &model.goal, at, |g| {
            let left = if g.remaining.is_finite() { format!(" {:.1} m", g.remaining) } else { String::new() };
            format!("{}{left}  {}", word(&goal::STATUS, g.status), g.message)
        }),
    ]);
    if model.beacon_use.get().is_some() {
        lines.push(line("beacons", &model.beacon_use, at, beacons));
    }
    // Of a planner that has modes.
    lines.extend(model.mode.get().map(|_| line("mode", &model.mode, at, mode::in_words)));
    lines.push(line("gamepad", &model.gamepad, at, |g| match (g.connected, g.dead_man) {
        (false, _) => "not there".into(),
        (true, held) => format!("{}{}", g.name, if held { "  dead man held" } else { "" }),
    }));
    if model.truth.get().is_some() {
        let text = |t: &messages::simulation::DataTruth| {
            format!("{:.2} {:.2} m  {}", t.x, t.y, crate::counted(t.collisions, "contact"))
        };
        lines.push(line("in truth", &model.truth, at, text));
    }
    lines
}

/// All for which it does not act, each with how long it has stood.
fn holds(model: &Model, at: Instant) -> Vec<Line<'static>> {
    let newest = model.motion.get().map(|motion| motion.timestamp);
    let rows = model.hold_rows(at);
    let is_notice = |row: &HoldRow| Hold::from_code(row.code).is_some_and(Hold::is_notice);
    // A bound may leave it some speed.
    let name = if rows.iter().all(is_notice) { "bounded" } else { "held" };
    let rows = rows.into_iter().take(HOLDS).enumerate();
    rows.flat_map(|(n, row)| {
        let stood = newest.zip(row.since).map(|(newest, since)| u64::try_from(newest - since).unwrap_or_default());
        let name = Span::raw(format!("{:<9}", if n == 0 { name } else { "" })).bold();
        let age = Span::raw(format!("{:>6} ", age(stood.map(Duration::from_micros)).trim())).fg(GREY);
        let cause = Line::from(vec![name, age, Span::raw(clip(&row.words))]);
        let latched = row.latched.then(|| Line::from(format!("{:16}latched until commanded", "")));
        [Some(cause), latched].into_iter().flatten()
    })
    .collect()
}

/// How many beacons there are in each state.
fn beacons(heard: &DataBeaconUse) -> String {
    let count = |state: &BeaconState| {
        let count = heard.beacons.iter().filter(|beacon| BeaconState::of(beacon, heard.timestamp) == *state).count();
        (count > 0).then(|| format!("{count} {}", state.name()))
    };
    let counts: Vec<String> = BeaconState::ALL.iter().filter_map(count).collect();
    if counts.is_empty() { "none on the map".into() } else { counts.join(", ") }
}

/// A beacon, with the residual of its last bearing.
fn beacon(beacon: &BeaconUse, timestamp: i64) -> String {
    let state = BeaconState::of(beacon, timestamp).name();
    let residual = match normalized_residual(beacon) {
        Some(ratio) => format!("{:+.2} deg {:.1} sigma", beacon.residual.to_degrees(), ratio.abs()),
        None => "-".into(),
    };
    format!("  {:>4} {state:<12} {residual}  {} ok {} refused", beacon.id, beacon.accepted, beacon.refused)
}

/// Coloured by the charge, beside the figure.
fn battery(model: &Model, at: Instant) -> Line<'static> {
    let text = line("battery", &model.power, at, |p| {
        format!("{:.0} %, {}, {:.1} V", 100.0 * p.charge, minutes(p.remaining), p.voltage)
    });
    match model.power.fresh(at).map(|power| power.charge) {
        Some(charge) if charge < CHARGE_EMPTY => text.patch_style(Style::new().fg(Color::Red).bold()),
        Some(charge) if charge < CHARGE_LOW => text.patch_style(Style::new().fg(Color::Yellow)),
        Some(charge) if charge.is_finite() => text.patch_style(Style::new().fg(Color::Green)),
        _ => text,
    }
}

fn minutes(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() => "time unknown".into(),
        s => time(s),
    }
}

fn hottest(heard: &DataTemperature) -> String {
    let known = heard.temperatures.iter().filter(|t| t.value.is_finite());
    let hottest = known.max_by(|a, b| a.value.total_cmp(&b.value));
    let over = heard.temperatures.iter().filter(|t| t.over).count();
    let over = if over > 0 { format!(", {over} OVER LIMIT") } else { String::new() };
    hottest.map_or("no thermometer answers".into(), |t| format!("{:.1} C {}{over}", t.value, clip(&t.name)))
}

fn fans(heard: &DataTemperature) -> String {
    let fans = heard.fans.iter().take(4).map(|fan| match fan.failed {
        true => format!("{} FAILED", clip(&fan.name)),
        false => format!("{:.0} rpm", fan.rpm),
    });
    let fans: Vec<String> = fans.collect();
    if fans.is_empty() { "none".into() } else { fans.join(", ") }
}

/// True if a channel switched itself off, as far as known.
fn has_tripped(model: &Model, channel: &messages::lowlevel::Channel) -> bool {
    model.errors.is_active(base::Fault::ChannelTripped, &channel.name)
}

fn switched_off(model: &Model, heard: &DataPower) -> String {
    let name = |c: &messages::lowlevel::Channel| {
        let name = clip(&c.name);
        if has_tripped(model, c) { format!("{name} (TRIPPED)") } else { name }
    };
    let off: Vec<String> = heard.channels.iter().filter(|c| !c.on).take(8).map(name).collect();
    let current: f64 = heard.channels.iter().map(|channel| channel.current).filter(|a| a.is_finite()).sum();
    let off = if off.is_empty() { "all on".into() } else { format!("OFF: {}", off.join(" ")) };
    format!("{current:.1} A, {off}")
}

/// Thermometers, fans, power channels, sonars and sources one by one.
fn more(model: &Model, at: Instant) -> Vec<Line<'static>> {
    let mut lines = Vec::new();
    let over = Style::new().fg(Color::Red).bold();
    if let Some(heard) = model.temperatures.get() {
        lines.push(line("heat", &model.temperatures, at, |_| String::new()));
        for t in &heard.temperatures {
            let value = if t.value.is_finite() { format!("{:>6.1} C", t.value) } else { "     - C".into() };
            let text = format!("  {:<12}{value}{}", clip(&t.name), if t.over { " OVER LIMIT" } else { "" });
            lines.push(Line::styled(text, if t.over { over } else { super::style(&model.temperatures, at) }));
        }
        for fan in &heard.fans {
            let failed = if fan.failed { " FAILED" } else { "" };
            let text = format!("  {:<12}{:>6.0} rpm {:.0} %{failed}", clip(&fan.name), fan.rpm, 100.0 * fan.duty);
            lines.push(Line::styled(text, if fan.failed { over } else { super::style(&model.temperatures, at) }));
        }
    }
    if let Some(heard) = model.power.get() {
        lines.push(line("power", &model.power, at, |_| ":power NAME off|on".into()));
        for pair in heard.channels.chunks(2) {
            let text = |c: &messages::lowlevel::Channel| {
                let current = match c.on {
                    true => format!("{:.1}A", c.current),
                    false if has_tripped(model, c) => "TRIP".into(),
                    false => "OFF".into(),
                };
                format!(" {:<10}{current:>4}", clip(&c.name))
            };
            let text: String = pair.iter().map(text).collect();
            lines.push(Line::styled(text, super::style(&model.power, at)));
        }
    }
    if let Some(heard) = model.beacon_use.get() {
        lines.push(line("beacons", &model.beacon_use, at, |_| "last residual, advee beacons ID off|on".into()));
        let style = super::style(&model.beacon_use, at);
        let rows = heard.beacons.iter().take(BEACONS).map(|seen| Line::styled(beacon(seen, heard.timestamp), style));
        lines.extend(rows);
    }
    if let Some(sonars) = model.sonar_readings(at, 0.0) {
        let style = sonar_style(model, at);
        lines.push(sonar_line("sonars", model, at, |_| "m, by number".into()));
        lines.extend(ranges(&sonars.readings).into_iter().map(|text| Line::styled(text, style)));
    }
    if let Some(infrareds) = model.infrared_readings(at) {
        let text = "m, by number";
        let (head, style) = match infrareds.of_2011 {
            false => (line("infrared", &model.ranges, at, |_| text.into()), super::style(&model.ranges, at)),
            true => (line("infrared", &model.infrareds, at, |_| text.into()), super::style(&model.infrareds, at)),
        };
        lines.push(head);
        lines.extend(ranges(&infrareds.readings).into_iter().map(|text| Line::styled(text, style)));
    }
    let motions = model.commands(at).map(|command| {
        let (source, speed) = (clip(&source_in_words(&command.source)), command.speed);
        format!("source    {source} priority {} {speed:+.2} m/s", command.priority)
    });
    let velocities = model.velocity_commands(at).map(|command| {
        let (source, vx, omega) = (clip(&source_in_words(&command.source)), command.vx, command.omega);
        format!("source    {source} priority {} {vx:+.2} m/s {omega:+.2} rad/s", command.priority)
    });
    lines.extend(motions.chain(velocities).take(SOURCES).map(Line::from));
    lines
}

/// A line about the sonars, with the age of the message that has them.
fn sonar_line(name: &str, model: &Model, at: Instant, text: impl FnOnce(&[Reading]) -> String) -> Line<'static> {
    let sonars = model.sonar_readings(at, 0.0);
    let readings = sonars.as_ref().map_or(&[][..], |sonars| &sonars.readings);
    match sonars.as_ref().is_some_and(|sonars| sonars.of_2011) {
        true => line(name, &model.sonars, at, |_| text(readings)),
        false => line(name, &model.ranges, at, |_| text(readings)),
    }
}

/// Style of the sonars' readings: grey where they are stale.
pub fn sonar_style(model: &Model, at: Instant) -> Style {
    match model.sonar_readings(at, 0.0).is_some_and(|sonars| sonars.of_2011) {
        true => super::style(&model.sonars, at),
        false => super::style(&model.ranges, at),
    }
}

/// Four of them in a line: a distance, `-` where nothing is in range, `?` where that is not known.
fn ranges(readings: &[Reading]) -> Vec<String> {
    let text = |reading: &Reading| match reading.status {
        Reading::MEASURED => format!("{:>3}:{:4.2}", reading.id, reading.distance),
        Reading::SILENT => format!("{:>3}: -  ", reading.id),
        _ => format!("{:>3}: ?  ", reading.id),
    };
    readings.chunks(4).take(16).map(|four| four.iter().map(text).collect::<String>()).collect()
}
