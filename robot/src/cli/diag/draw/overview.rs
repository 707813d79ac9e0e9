//! Where the robot is, what it is told, and what is near it.

use super::{Body, line, style, time};
use crate::cli::diag::app::App;
use base::Instant;
use diagnostics::Model;
use navitools::{Point, Pose};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::Color;
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::canvas::{Canvas, Context, Line as Stroke, Points};
use ratatui::widgets::{Block, Paragraph, Wrap};

/// So far around the robot is drawn, m.
const REACH: f64 = 3.0;
/// Half of a sonar's beam, rad.
const HALF_BEAM: f64 = 0.48;
const QUALITY: [&str; 4] = ["LOST", "SEARCHING", "COARSE", "FINE"];
const GOAL: [&str; 6] = ["idle", "driving", "reached", "blocked", "failed", "cancelled"];

pub fn draw(frame: &mut Frame<'_>, app: &App, body: Body, area: Rect, now: Instant) {
    let (model, at) = app.shown(now);
    let [left, right] = Layout::horizontal([Constraint::Min(38), Constraint::Percentage(50)]).areas(area);
    let text = Paragraph::new(lines(app, model, at, now)).wrap(Wrap { trim: false });
    frame.render_widget(text.block(Block::bordered().title(" robot ")), left);
    draw_near(frame, model, body, right, at);
}

fn word(words: &[&'static str], number: i8) -> &'static str {
    usize::try_from(number).ok().and_then(|place| words.get(place)).copied().unwrap_or("?")
}

fn lines(app: &App, model: &Model, at: Instant, now: Instant) -> Vec<Line<'static>> {
    let degrees = f64::to_degrees;
    let mut lines = vec![
        line("position", &model.estimate, at, |e| format!("{:.2} {:.2} m  {:.1} deg", e.x, e.y, degrees(e.theta))),
        line("estimate", &model.estimate, at, |e| {
            let deviation = e.covariance[0][0].max(e.covariance[1][1]).max(0.0).sqrt();
            format!("{}  +-{deviation:.2} m", word(&QUALITY, e.quality))
        }),
        line("speed", &model.motion, at, |m| format!("{:+.2} m/s  (told {:+.2})", m.speed, m.speed_target)),
        line("steering", &model.motion, at, |m| {
            let homed = if m.homed { "" } else { "  NOT HOMED" };
            format!("{:+.1} deg  (told {:+.1}){homed}", degrees(m.steering), degrees(m.steering_target))
        }),
        line("commands", &model.motion, at, |m| if m.source.is_empty() { "nobody".into() } else { m.source.clone() }),
        line("goal", &model.goal, at, |g| {
            let left = if g.remaining.is_finite() && g.remaining > 0.0 {
                format!(" {:.1} m", g.remaining)
            } else {
                String::new()
            };
            format!("{}{left}  {}", word(&GOAL, g.status), g.message)
        }),
        line("PAUSE line", &model.stop, at, |s| {
            if s.engaged { format!("ENGAGED by {}", s.source) } else { "released".into() }
        }),
        line("battery", &model.power, at, |p| {
            format!("{:.1} V  {:.0} %  {}", p.voltage, 100.0 * p.charge, minutes(p.remaining))
        }),
        line("hottest", &model.temperatures, at, |t| {
            let known = t.temperatures.iter().filter(|t| t.value.is_finite());
            let hottest = known.max_by(|a, b| a.value.total_cmp(&b.value));
            hottest.map_or("-".into(), |t| format!("{} {:.1} C{}", t.name, t.value, if t.over { "  OVER" } else { "" }))
        }),
        line("gamepad", &model.gamepad, at, |g| match (g.connected, g.dead_man) {
            (false, _) => "not there".into(),
            (true, held) => format!("{}{}", g.name, if held { "  dead man held" } else { "" }),
        }),
        line("recorder", &model.log, at, |l| {
            if l.recording { format!("writes {}", l.run) } else { "does not record".into() }
        }),
    ];
    if model.truth.get().is_some() {
        lines.push(line("simulated", &model.truth, at, |t| {
            format!("truth {:.2} {:.2} m  {} contacts", t.x, t.y, t.collisions)
        }));
    }
    if app.drive.is_taken() {
        let held = if app.drive.is_held(now) { "RUNS" } else { "zero" };
        let (speed, angle) = (app.drive.speed, degrees(app.drive.steering));
        lines.push(Line::from(format!("you drive  {held}  {speed:.2} m/s  {angle:+.1} deg")));
    }
    lines
}

fn minutes(seconds: f64) -> String {
    if seconds.is_finite() { format!("{} left", time(seconds)) } else { String::new() }
}

/// The robot's frame, x up: obstacles, plan, sonars, the body.
fn draw_near(frame: &mut Frame<'_>, model: &Model, body: Body, area: Rect, at: Instant) {
    // A character is about twice as high as wide, and the picture's metres are square.
    let (columns, rows) = (f64::from(area.width.saturating_sub(2)), f64::from(area.height.saturating_sub(2)));
    let across = if rows > 0.0 { REACH * columns / (2.0 * rows) } else { REACH };
    let heard = style(&model.sonars, at).fg.unwrap_or(Color::Yellow);
    let canvas = Canvas::default()
        .block(Block::bordered().title(format!(" {REACH:.0} m around ")))
        .marker(Marker::Braille)
        .x_bounds([-across, across])
        .y_bounds([-REACH + 0.5, REACH + 0.5])
        .paint(move |ctx| {
            draw_map(ctx, model, at);
            draw_sonars(ctx, model, heard);
            let corners = [(body.rear, 1.0), (body.front, 1.0), (body.front, -1.0), (body.rear, -1.0)];
            let corner = |n: usize| (corners[n % 4].1 * body.half_width, corners[n % 4].0);
            for n in 0..4 {
                stroke(ctx, corner(n), corner(n + 1), Color::White);
            }
            // Its nose.
            stroke(ctx, (0.0, body.front), (0.0, body.front - 0.25), Color::White);
        });
    frame.render_widget(canvas, area);
}

fn stroke(ctx: &mut Context<'_>, from: (f64, f64), to: (f64, f64), color: Color) {
    ctx.draw(&Stroke { x1: from.0, y1: from.1, x2: to.0, y2: to.1, color });
}

/// A point of the robot's frame on the picture, whose top is ahead.
fn across(point: Point) -> (f64, f64) {
    (-point.y, point.x)
}

/// What is told in the map's frame, seen from the robot.
fn draw_map(ctx: &mut Context<'_>, model: &Model, at: Instant) {
    let Some(pose) = model.estimate.fresh(at) else { return };
    let inverse = Pose::new(pose.x, pose.y, pose.theta).inverse();
    let seen = |x: &f64, y: &f64| across(inverse * Point { x: *x, y: *y });
    if let Some(obstacles) = model.obstacles.fresh(at) {
        let coords: Vec<_> = obstacles.x.iter().zip(&obstacles.y).map(|(x, y)| seen(x, y)).collect();
        ctx.draw(&Points { coords: &coords, color: Color::Red });
    }
    if let Some(plan) = model.plan.fresh(at) {
        let points: Vec<_> = plan.x.iter().zip(&plan.y).map(|(x, y)| seen(x, y)).collect();
        for pair in points.windows(2) {
            stroke(ctx, pair[0], pair[1], Color::Green);
        }
    }
}

fn draw_sonars(ctx: &mut Context<'_>, model: &Model, color: Color) {
    let Some(sonars) = model.sonars.get() else { return };
    for sonar in sonars.srfs.iter().filter(|sonar| sonar.valid && sonar.distance.is_finite()) {
        let end = |angle: f64| {
            let sound = Pose::new(sonar.x, sonar.y, sonar.theta + angle);
            across(sound * Point { x: sonar.distance, y: 0.0 })
        };
        stroke(ctx, end(-HALF_BEAM), end(0.0), color);
        stroke(ctx, end(0.0), end(HALF_BEAM), color);
    }
}
