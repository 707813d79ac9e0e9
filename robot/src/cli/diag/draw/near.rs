//! What is near the robot: a picture in its own frame, ahead is up.

use super::{Body, GREY, style};
use base::Instant;
use diagnostics::Model;
use messages::lowlevel::Range;
use navitools::{Point, Pose};
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::Block;
use ratatui::widgets::canvas::{Canvas, Context, Line as Stroke, Points};

/// So far around the robot is drawn, m.
const REACH: f64 = 3.0;
/// Half of a sonar's beam, rad.
const HALF_BEAM: f64 = 0.48;
/// Nearer than this it is red, and said in figures, m.
const NEAR: f64 = 0.6;
/// Of a plan, and of what stands around, so many points are drawn.
const POINTS_MAX: usize = 2000;

const SIDES: [&str; 8] =
    ["ahead", "ahead left", "left", "behind left", "behind", "behind right", "right", "ahead right"];

/// The sonar that hears something nearest, and on which side.
pub fn nearest(sonars: &[Range]) -> Option<(&Range, &'static str)> {
    let nearest = heard(sonars).min_by(|one, other| one.distance.total_cmp(&other.distance))?;
    // Where it looks is where its thing is.
    let turns = nearest.theta / std::f64::consts::TAU;
    let side = if turns.is_finite() { (turns.rem_euclid(1.0) * 8.0).round() as usize % 8 } else { 0 };
    Some((nearest, SIDES[side]))
}

fn heard(sonars: &[Range]) -> impl Iterator<Item = &Range> {
    sonars.iter().filter(|sonar| sonar.valid && sonar.distance.is_finite())
}

/// Obstacles, plan, sonars, the body.
pub fn draw(frame: &mut Frame<'_>, model: &Model, body: Body, area: Rect, at: Instant) {
    // A character is about twice as high as wide, and the picture's metres are square.
    let (columns, rows) = (f64::from(area.width.saturating_sub(2)), f64::from(area.height.saturating_sub(2)));
    let across = if rows > 0.0 { REACH * columns / (2.0 * rows) } else { REACH };
    let is_stale = style(&model.sonars, at).fg.is_some();
    let title = if is_stale { " no news of the sonars " } else { " around it, 3 m " };
    let legend = Line::from(" ) sonar  . obstacle  -X plan ").dim();
    let canvas = Canvas::default()
        .block(Block::bordered().title(title).title_bottom(legend))
        .marker(Marker::Braille)
        .x_bounds([-across, across])
        .y_bounds([-REACH + 0.5, REACH + 0.5])
        .paint(move |ctx| {
            draw_map(ctx, model, at);
            draw_sonars(ctx, model, is_stale);
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

/// What is told in the map's frame, seen from the robot.
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

fn draw_sonars(ctx: &mut Context<'_>, model: &Model, is_stale: bool) {
    let Some(sonars) = model.sonars.get() else { return };
    for sonar in heard(&sonars.srfs) {
        let color = match sonar.distance {
            _ if is_stale => GREY,
            near if near < NEAR => Color::Red,
            _ => Color::Yellow,
        };
        let end = |angle: f64| {
            let sound = Pose::new(sonar.x, sonar.y, sonar.theta + angle);
            across(sound * Point { x: sonar.distance, y: 0.0 })
        };
        stroke(ctx, end(-HALF_BEAM), end(0.0), color);
        stroke(ctx, end(0.0), end(HALF_BEAM), color);
        if sonar.distance < NEAR && !is_stale {
            let (x, y) = end(0.0);
            ctx.print(x, y, format!("{:.1}", sonar.distance).red().bold());
        }
    }
}
