//! What is near the robot: a picture in its own frame, ahead is up.

use super::{Body, GREY};
use base::Instant;
use diagnostics::Model;
use messages::lowlevel::Reading;
use navitools::{Point, Pose};
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::Block;
use ratatui::widgets::canvas::{Canvas, Context, Line as Stroke, Points};

/// Half side of the drawn area around the robot, m.
const REACH: f64 = 3.0;
/// Distance from a silent or unknown sonar to its mark, m.
const QUIET: f64 = 0.35;
/// Maximum number of sonars drawn.
const SONARS_MAX: usize = 64;
/// Distance below which a reading is red, and shown in figures, m.
const NEAR: f64 = 0.6;
/// Maximum number of points drawn of a path and of obstacles.
const POINTS_MAX: usize = 2000;

const SIDES: [&str; 8] =
    ["ahead", "ahead left", "left", "behind left", "behind", "behind right", "right", "ahead right"];

/// Distance and side of the nearest reading, and how many sonars are not known.
pub fn nearest(sonars: &[Reading]) -> String {
    let measured = sonars.iter().filter(|sonar| sonar.status == Reading::MEASURED && sonar.distance.is_finite());
    let nearest = measured.min_by(|one, other| one.distance.total_cmp(&other.distance)).map(|nearest| {
        // Where it looks is where its thing is.
        let turns = nearest.theta / std::f64::consts::TAU;
        let side = if turns.is_finite() { (turns.rem_euclid(1.0) * 8.0).round() as usize % 8 } else { 0 };
        format!("{:.2} m {}", nearest.distance, SIDES[side])
    });
    let nearest = nearest.unwrap_or_else(|| "no echo".into());
    let unknown = sonars.iter().filter(|sonar| is_unknown(sonar)).count();
    if unknown > 0 { format!("{nearest}, {unknown} NOT KNOWN") } else { nearest }
}

/// True unless it measured a distance, or silence.
fn is_unknown(sonar: &Reading) -> bool {
    !matches!(sonar.status, Reading::SILENT | Reading::MEASURED)
}

/// Obstacles, plan, sonars, the body.
pub fn draw(frame: &mut Frame<'_>, model: &Model, body: Body, area: Rect, at: Instant) {
    // A character is about twice as high as wide, and the picture's metres are square.
    let (columns, rows) = (f64::from(area.width.saturating_sub(2)), f64::from(area.height.saturating_sub(2)));
    let across = if rows > 0.0 { REACH * columns / (2.0 * rows) } else { REACH };
    let sonars = model.sonar_readings(at, body.sonar_beam);
    let is_stale = super::overview::sonar_style(model, at).fg.is_some();
    let title = if is_stale { " no news of the sonars " } else { " around it, 3 m " };
    let legend = Line::from(" ) sonar ? unknown . cell -X plan ").dim();
    let canvas = Canvas::default()
        .block(Block::bordered().title(title).title_bottom(legend))
        .marker(Marker::Braille)
        .x_bounds([-across, across])
        .y_bounds([-REACH + 0.5, REACH + 0.5])
        .paint(move |ctx| {
            draw_map(ctx, model, at);
            draw_sonars(ctx, sonars.as_ref().map_or(&[], |sonars| &sonars.readings), is_stale);
            let corners = [(body.rear, 1.0), (body.front, 1.0), (body.front, -1.0), (body.rear, -1.0)];
            let corner = |n: usize| (corners[n % 4].1 * body.half_width, corners[n % 4].0);
            for n in 0..4 {
                stroke(ctx, corner(n), corner(n + 1), Color::White);
            }
            // Its nose.
            let middle = f64::midpoint(body.rear, body.front);
            stroke(ctx, corner(1), (0.0, middle), Color::White);
            stroke(ctx, corner(2), (0.0, middle), Color::White);
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

/// Draws map-frame data in the robot frame.
fn draw_map(ctx: &mut Context<'_>, model: &Model, at: Instant) {
    let Some(pose) = model.estimate.fresh(at) else { return };
    let inverse = Pose::new(pose.x, pose.y, pose.theta).inverse();
    let seen = |x: &f64, y: &f64| across(inverse * Point { x: *x, y: *y });
    if let Some(obstacles) = model.obstacles.fresh(at) {
        let coords = obstacles.x.iter().zip(&obstacles.y).take(POINTS_MAX).map(|(x, y)| seen(x, y));
        ctx.draw(&Points { coords: &coords.collect::<Vec<_>>(), color: Color::Magenta });
    }
    if let Some(plan) = model.plan.fresh(at) {
        let points: Vec<_> = plan.x.iter().zip(&plan.y).take(POINTS_MAX).map(|(x, y)| seen(x, y)).collect();
        for pair in points.windows(2) {
            stroke(ctx, pair[0], pair[1], Color::Green);
        }
        if let Some((x, y)) = points.last() {
            ctx.print(*x, *y, "X".green().bold());
        }
    }
}

fn draw_sonars(ctx: &mut Context<'_>, sonars: &[Reading], is_stale: bool) {
    for sonar in sonars.iter().take(SONARS_MAX) {
        let half_beam = sonar.beam / 2.0;
        let end = |angle: f64, distance: f64| {
            let sound = Pose::new(sonar.x, sonar.y, sonar.theta + angle);
            across(sound * Point { x: distance, y: 0.0 })
        };
        if is_unknown(sonar) {
            let (x, y) = end(0.0, QUIET);
            ctx.print(x, y, if is_stale { "?".fg(GREY) } else { "?".red().bold() });
            continue;
        }
        if sonar.status == Reading::SILENT {
            let coords = [-half_beam, 0.0, half_beam].map(|angle| end(angle, QUIET));
            ctx.draw(&Points { coords: &coords, color: GREY });
            continue;
        }
        let color = match sonar.distance {
            _ if is_stale => GREY,
            near if near < NEAR => Color::Red,
            _ => Color::Yellow,
        };
        stroke(ctx, end(-half_beam, sonar.distance), end(0.0, sonar.distance), color);
        stroke(ctx, end(0.0, sonar.distance), end(half_beam, sonar.distance), color);
        if sonar.distance < NEAR && !is_stale {
            let (x, y) = end(0.0, sonar.distance);
            ctx.print(x, y, format!("{:.1}", sonar.distance).red().bold());
        }
    }
}
