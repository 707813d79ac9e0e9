//! Upper part of a picture: the world from above, and the robot's path in it.

use super::axis;
use super::canvas::{Anchor, Canvas, Colour, Font, Rect, Stroke};
use super::data::{Ellipse, Picture};
use super::page::Sheet;
use super::series::Track;
use super::style::{
    self, BEACON, COLUMN, DROP, ESTIMATE, FRAME, GREY, GRID, INK, OBSTACLE, PLAN, SMALL, TEXT, TRUTH, WHITE,
};
use navitools::{Point, Pose};

/// Margin around everything, m.
const MARGIN_M: f64 = 0.5;
/// Distance from the world beyond which points do not enlarge the map, m.
const BEYOND_MAX_M: f64 = 5.0;
/// Maximum and minimum height of the map, units.
const HEIGHT_MAX: f64 = 560.0;
const HEIGHT_MIN: f64 = 110.0;
/// Size of the ellipses, standard deviations.
pub const DEVIATIONS: f64 = 2.0;
/// Maximum number of drawn obstacles and walls, and of named beacons.
const DRAWN_MAX: usize = 20_000;
const NAMED_MAX: usize = 40;

/// Mapping from metres to the page.
struct View {
    rect: Rect,
    least: Point,
    /// Units per metre.
    scale: f64,
}

impl View {
    fn at(&self, point: Point) -> Point {
        let (x, y) = (point.x - self.least.x, point.y - self.least.y);
        Point { x: self.rect.x + x * self.scale, y: self.rect.bottom() - y * self.scale }
    }

    fn all(&self, points: &[Point]) -> Vec<Point> {
        points.iter().map(|point| self.at(*point)).collect()
    }
}

impl Picture {
    /// Draws the map below `top`, with its legend; returns its lower end.
    pub(super) fn draw_map(&self, canvas: &mut dyn Canvas, sheet: &Sheet, top: f64) -> f64 {
        let Some((least, most)) = self.bounds() else { return top };
        let (width, height) = (most.x - least.x, most.y - least.y);
        let scale = (sheet.width / width).min(HEIGHT_MAX / height);
        let high = (height * scale).max(HEIGHT_MIN);
        // If it is narrower than the page, it shows more on both sides.
        let more = Point { x: (sheet.width / scale - width) / 2.0, y: (high / scale - height) / 2.0 };
        let least = Point { x: least.x - more.x, y: least.y - more.y };
        let top = self.draw_legend(canvas, sheet, top + 6.0) + 10.0;
        let view = View { rect: Rect { x: sheet.left, y: top, w: sheet.width, h: high }, least, scale };
        canvas.begin("map");
        draw_grid(canvas, &view);
        self.draw_world(canvas, &view);
        self.draw_plan_and_obstacles(canvas, &view);
        draw_track(canvas, &view, "truth", &self.truth, &Stroke::new(TRUTH, 1.6));
        draw_track(canvas, &view, "estimate", &self.estimate, &Stroke::new(ESTIMATE, 1.2).dashed(5.0, 3.0));
        self.draw_ellipses(canvas, &view);
        self.draw_fields(canvas, &view);
        self.draw_robot(canvas, &view);
        self.draw_moments(canvas, &view, sheet);
        canvas.begin("contacts");
        for at in self.contacts.iter().map(|at| view.at(*at)).filter(|at| view.rect.has(*at)) {
            style::contact(canvas, at, 5.0);
        }
        canvas.end();
        frame(canvas, &view.rect);
        canvas.end();
        view.rect.bottom() + 34.0
    }

    /// Part of the floor that is shown; `None` without any position.
    fn bounds(&self) -> Option<(Point, Point)> {
        let world = &self.world;
        let walls = world.walls.iter().flat_map(|wall| [wall.a, wall.b]);
        let beacons = world.beacons.iter().map(|beacon| beacon.at);
        let drops = world.drops.iter().flatten().copied();
        let columns = world.columns.iter().map(|column| column.centre);
        let known = around(walls.chain(beacons).chain(drops).chain(columns));
        let spots = || self.truth.spots().iter().chain(self.estimate.spots()).map(|spot| spot.point);
        let all = match known {
            Some((least, most)) => {
                let near = |p: &Point| {
                    (least.x - BEYOND_MAX_M..=most.x + BEYOND_MAX_M).contains(&p.x)
                        && (least.y - BEYOND_MAX_M..=most.y + BEYOND_MAX_M).contains(&p.y)
                };
                around(spots().filter(near).chain([least, most]))?
            }
            None => bounds_without_outliers(spots().collect())?,
        };
        let (least, most) = all;
        let least = Point { x: least.x - MARGIN_M, y: least.y - MARGIN_M };
        Some((least, Point { x: most.x + MARGIN_M, y: most.y + MARGIN_M }))
    }

    fn draw_world(&self, canvas: &mut dyn Canvas, view: &View) {
        canvas.begin("world");
        for drop in self.world.drops.iter().take(DRAWN_MAX) {
            canvas.area(&view.all(drop), DROP, Some(&Stroke::new(FRAME, 0.8).dashed(3.0, 2.0)));
        }
        for wall in self.world.walls.iter().take(DRAWN_MAX) {
            canvas.line(&view.all(&[wall.a, wall.b]), &Stroke::new(INK, 2.2));
        }
        for column in self.world.columns.iter().take(DRAWN_MAX) {
            let radius = (column.radius * view.scale).max(1.0);
            canvas.disc(view.at(column.centre), radius, COLUMN, Some(&Stroke::new(INK, 0.8)));
        }
        canvas.end();
        canvas.begin("beacons");
        for beacon in self.world.beacons.iter().take(DRAWN_MAX) {
            let at = view.at(beacon.at);
            canvas.disc(at, 5.0, BEACON, Some(&Stroke::new(INK, 0.8)));
            if self.world.beacons.len() <= NAMED_MAX {
                // Towards the middle: beacons hang on walls, and walls are at the frame.
                let (right, low) = (at.x > view.rect.x + view.rect.w / 2.0, at.y > view.rect.y + view.rect.h / 2.0);
                let anchor = if right { Anchor::End } else { Anchor::Start };
                let place = Point { x: at.x + if right { -8.0 } else { 8.0 }, y: at.y + if low { -6.0 } else { 12.0 } };
                canvas.text(place, &beacon.id.to_string(), &Font::new(SMALL, GREY).at(anchor));
            }
        }
        canvas.end();
    }

    /// Draws the planner's last path and obstacles.
    fn draw_plan_and_obstacles(&self, canvas: &mut dyn Canvas, view: &View) {
        canvas.begin("obstacles");
        let half = (self.cell / 2.0 * view.scale).clamp(0.6, 50.0);
        let cells = self.cells.iter().map(|cell| view.at(*cell)).filter(|at| view.rect.has(*at));
        for at in cells.take(DRAWN_MAX) {
            let cell = Rect { x: at.x - half, y: at.y - half, w: 2.0 * half, h: 2.0 * half };
            canvas.area(&cell.corners(), OBSTACLE, None);
        }
        canvas.end();
        canvas.begin("plan");
        for part in view.rect.cut_line(&view.all(&self.plan)) {
            canvas.line(&part, &Stroke::new(PLAN.cover(0.75), 3.2));
        }
        canvas.end();
    }

    fn draw_ellipses(&self, canvas: &mut dyn Canvas, view: &View) {
        canvas.begin("ellipses");
        for ellipse in &self.ellipses {
            for part in view.rect.cut_line(&view.all(&outline(ellipse))) {
                canvas.line(&part, &Stroke::new(ESTIMATE, 0.8));
            }
        }
        canvas.end();
    }

    /// Draws the guard's fields at the end of the run.
    fn draw_fields(&self, canvas: &mut dyn Canvas, view: &View) {
        let Some(pose) = self.pose.filter(|_| !self.fields().is_empty()) else { return };
        canvas.begin("fields");
        for field in self.fields() {
            let mut outline: Vec<Point> = field.corners.iter().map(|corner| view.at(pose * *corner)).collect();
            if field.occupied && outline.iter().all(|corner| view.rect.has(*corner)) {
                canvas.area(&outline, style::field(field.protective).colour.cover(0.3), None);
            }
            outline.extend(outline.first().copied());
            for part in view.rect.cut_line(&outline) {
                canvas.line(&part, &style::field(field.protective));
            }
        }
        canvas.end();
    }

    /// Draws the robot at the end of the run, and a ring at its beginning.
    fn draw_robot(&self, canvas: &mut dyn Canvas, view: &View) {
        if let Some(first) = self.truth.spots().first().or(self.estimate.spots().first())
            && view.rect.has(view.at(first.point))
        {
            canvas.disc(view.at(first.point), 4.5, WHITE, Some(&Stroke::new(INK, 1.4)));
        }
        let (Some(pose), Some(g)) = (self.pose, &self.geometry) else { return };
        let (rear, front, half) = (-g.rear_overhang_m, g.length_m - g.rear_overhang_m, g.width_m / 2.0);
        // The nose shows the heading.
        let corners = [(rear, -half), (front - 0.15, -half), (front, 0.0), (front - 0.15, half), (rear, half)];
        let polygon = !g.corners.is_empty();
        let corners: Vec<Point> = if polygon { g.corners.clone() } else { corners.map(|(x, y)| Point { x, y }).into() };
        let corners: Vec<Point> = corners.iter().map(|corner| view.at(pose * *corner)).collect();
        if corners.iter().all(|corner| view.rect.has(*corner)) {
            canvas.begin("robot");
            canvas.area(&corners, TRUTH.cover(0.25), Some(&Stroke::new(INK, 1.2)));
            if polygon {
                let heading = [(0.0, 0.0), (front, 0.0)].map(|(x, y)| view.at(pose * Point { x, y }));
                canvas.line(&heading, &Stroke::new(INK, 1.2));
            }
            canvas.end();
        }
    }

    /// Dots on the path at the ticks of the time axis.
    fn draw_moments(&self, canvas: &mut dyn Canvas, view: &View, sheet: &Sheet) {
        let track = if self.truth.spots().is_empty() { &self.estimate } else { &self.truth };
        canvas.begin("moments");
        let mut taken: Vec<Point> = Vec::new();
        for (second, text) in sheet.moments.iter().skip(1) {
            let next = track.spots().partition_point(|spot| spot.at < sheet.from + second);
            // Position at that time: the robot stood there until it moved on.
            let Some(spot) = track.spots().get(next).filter(|_| next > 0) else { continue };
            let at = view.at(spot.point);
            if !view.rect.has(at) || taken.iter().any(|other| other.distance(at) < 22.0) {
                continue;
            }
            taken.push(at);
            canvas.disc(at, 2.4, WHITE, Some(&Stroke::new(INK, 1.0)));
            canvas.text(Point { x: at.x + 5.0, y: at.y - 5.0 }, text, &Font::new(SMALL, INK));
        }
        canvas.end();
    }

    fn draw_legend(&self, canvas: &mut dyn Canvas, sheet: &Sheet, y: f64) -> f64 {
        let contacts = format!("contacts ({})", self.contacts());
        let ellipses = format!("ellipses: {DEVIATIONS} σ");
        let end = if self.pose.is_some() { "start; robot at the end" } else { "start" };
        let mut entries: Vec<(&str, &str)> = Vec::new();
        let mut add = |shown: bool, entry| entries.extend(shown.then_some(entry));
        add(!self.truth.spots().is_empty(), ("truth", "truth"));
        add(!self.estimate.spots().is_empty(), ("estimate", "estimate"));
        add(!self.ellipses.is_empty(), ("ellipse", &ellipses));
        add(!self.plan.is_empty(), ("plan", "last plan"));
        add(!self.cells.is_empty(), ("cell", "last obstacles"));
        let fields = if self.pose.is_some() { self.fields() } else { &[] };
        add(fields.iter().any(|field| field.protective), ("protective", "protective field"));
        add(fields.iter().any(|field| !field.protective), ("warning", "warning field"));
        add(fields.iter().any(|field| field.occupied), ("occupied", "something is in it"));
        add(!self.world.beacons.is_empty(), ("beacon", "beacons"));
        add(true, ("begin", end));
        add(sheet.moments.len() > 1, ("moment", sheet.unit_in_words));
        add(!self.contacts.is_empty(), ("contact", &contacts));
        canvas.begin("legend");
        let (mut x, mut y) = (sheet.left, y);
        for (kind, text) in entries {
            let width = 24.0 + sheet.letters.width(text, TEXT, false) + 16.0;
            if x + width > sheet.left + sheet.width + 16.0 {
                (x, y) = (sheet.left, y + 16.0);
            }
            sample(canvas, kind, Point { x, y: y - 3.5 });
            canvas.text(Point { x: x + 24.0, y }, text, &Font::new(TEXT, INK));
            x += width;
        }
        canvas.end();
        y
    }
}

fn sample(canvas: &mut dyn Canvas, kind: &str, at: Point) {
    let ends = [at, Point { x: at.x + 19.0, y: at.y }];
    let middle = Point { x: at.x + 10.0, y: at.y };
    let thin = Stroke::new(INK, 0.8);
    match kind {
        "truth" => canvas.line(&ends, &Stroke::new(TRUTH, 1.6)),
        "estimate" => canvas.line(&ends, &Stroke::new(ESTIMATE, 1.4).dashed(5.0, 3.0)),
        "plan" => canvas.line(&ends, &Stroke::new(PLAN.cover(0.75), 3.2)),
        "cell" => {
            canvas.area(&Rect { x: middle.x - 4.0, y: at.y - 4.0, w: 8.0, h: 8.0 }.corners(), OBSTACLE, None);
        }
        "protective" | "warning" => canvas.line(&ends, &style::field(kind == "protective")),
        "occupied" => {
            let area = Rect { x: at.x, y: at.y - 5.0, w: 19.0, h: 10.0 };
            canvas.area(&area.corners(), style::field(true).colour.cover(0.3), None);
        }
        "beacon" => canvas.disc(middle, 5.0, BEACON, Some(&thin)),
        "begin" => canvas.disc(middle, 4.5, WHITE, Some(&Stroke::new(INK, 1.4))),
        "moment" => canvas.disc(middle, 2.4, WHITE, Some(&Stroke::new(INK, 1.0))),
        "contact" => style::contact(canvas, middle, 4.5),
        _ => {
            let points: Vec<Point> = (0..=24)
                .map(|n| {
                    let (sin, cos) = (f64::from(n) * std::f64::consts::TAU / 24.0).sin_cos();
                    Point { x: middle.x + 8.0 * cos, y: middle.y + 4.5 * sin }
                })
                .collect();
            canvas.line(&points, &Stroke::new(ESTIMATE, 0.8));
        }
    }
}

fn draw_grid(canvas: &mut dyn Canvas, view: &View) {
    let rect = &view.rect;
    canvas.area(&rect.corners(), WHITE, None);
    let most = |length: f64| (length / 55.0).ceil() as usize;
    let (wide, high) = (rect.w / view.scale, rect.h / view.scale);
    let line = Stroke::new(GRID, 0.8);
    let font = Font::new(TEXT, GREY);
    for (value, text) in axis::numbers(view.least.x, view.least.x + wide, most(rect.w)) {
        let x = rect.x + (value - view.least.x) * view.scale;
        canvas.line(&[Point { x, y: rect.y }, Point { x, y: rect.bottom() }], &line);
        canvas.text(Point { x, y: rect.bottom() + 13.0 }, &text, &font.at(Anchor::Middle));
    }
    for (value, text) in axis::numbers(view.least.y, view.least.y + high, most(rect.h)) {
        let y = rect.bottom() - (value - view.least.y) * view.scale;
        canvas.line(&[Point { x: rect.x, y }, Point { x: rect.right(), y }], &line);
        canvas.text(Point { x: rect.x - 6.0, y: y + 3.5 }, &text, &font.at(Anchor::End));
    }
    let font = Font::new(TEXT, INK).at(Anchor::Middle);
    canvas.text(Point { x: rect.x + rect.w / 2.0, y: rect.bottom() + 26.0 }, "x / m", &font);
    canvas.text(Point { x: rect.x - 40.0, y: rect.y + rect.h / 2.0 }, "y / m", &font.upwards());
}

/// Frame of a panel.
pub(super) fn frame(canvas: &mut dyn Canvas, rect: &Rect) {
    const NOTHING: Colour = WHITE.cover(0.0);
    canvas.area(&rect.corners(), NOTHING, Some(&Stroke::new(FRAME, 0.8)));
}

fn draw_track(canvas: &mut dyn Canvas, view: &View, name: &str, track: &Track, stroke: &Stroke) {
    canvas.begin(name);
    for line in track.lines() {
        for part in view.rect.cut_line(&view.all(&line)) {
            canvas.line(&part, stroke);
        }
    }
    canvas.end();
}

/// Outline of an ellipse of [`DEVIATIONS`], m; empty if the covariance is invalid.
fn outline(ellipse: &Ellipse) -> Vec<Point> {
    let [xx, xy, yy] = ellipse.covariance;
    let (mean, half) = (f64::midpoint(xx, yy), (xx - yy) / 2.0);
    let spread = half.hypot(xy);
    let axis = |variance: f64| DEVIATIONS * variance.max(0.0).sqrt();
    let (long, short) = (axis(mean + spread), axis(mean - spread));
    let pose = Pose::new(ellipse.middle.x, ellipse.middle.y, 0.5 * xy.atan2(half));
    if !(long < 1e6 && short < 1e6 && xy.is_finite()) {
        return Vec::new();
    }
    let at = |n: u32| {
        let (sin, cos) = (f64::from(n) * std::f64::consts::TAU / 36.0).sin_cos();
        pose * Point { x: long * cos, y: short * sin }
    };
    (0..=36).map(at).collect()
}

fn around(points: impl Iterator<Item = Point>) -> Option<(Point, Point)> {
    let finite = points.filter(|point| point.x.is_finite() && point.y.is_finite());
    finite.fold(None, |all, point| {
        let (least, most) = all.unwrap_or((point, point));
        let least = Point { x: point.x.min(least.x), y: point.y.min(least.y) };
        Some((least, Point { x: point.x.max(most.x), y: point.y.max(most.y) }))
    })
}

/// Bounds of these points, without a few outliers.
fn bounds_without_outliers(points: Vec<Point>) -> Option<(Point, Point)> {
    let (least, most) = around(points.iter().copied())?;
    let trim = |mut values: Vec<f64>, least: f64, most: f64| {
        values.sort_by(f64::total_cmp);
        let few = values.len() / 100;
        let (low, high) = (values[few], values[values.len() - 1 - few]);
        let room = 3.0 * (high - low) + 2.0;
        (least.max(low - room), most.min(high + room))
    };
    let x = trim(points.iter().map(|point| point.x).collect(), least.x, most.x);
    let y = trim(points.iter().map(|point| point.y).collect(), least.y, most.y);
    Some((Point { x: x.0, y: y.0 }, Point { x: x.1, y: y.1 }))
}
