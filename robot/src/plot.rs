//! A picture of a run from above, as SVG: world, truth, estimate with its covariance, beacons, obstacles, plan, contacts.
//!
//! Fed with messages, from wherever: a recording (`advee plot`) or an observer of a virtual machine.

use crate::config::Geometry;
use messages::{Message, middlelevel, simulation};
use navitools::{Point, Pose};
use sim::people::Contact;
use sim::world::World;
use std::fmt::Write;

/// Pixels per metre.
const SCALE: f64 = 50.0;
/// Around everything, m.
const MARGIN: f64 = 0.5;
/// A point of a line is this far from the one before, m; one that is farther than `JUMP` begins a new line.
const STEP: f64 = 0.02;
const JUMP: f64 = 1.0;
/// Between two ellipses, s, and how many deviations they show.
const ELLIPSES: f64 = 2.0;
const DEVIATIONS: f64 = 2.0;
/// Below the picture, pixels.
const LEGEND: f64 = 30.0;

const TRUTH: &str = "#1f6fb4";
const ESTIMATE: &str = "#d1351b";
const PLAN: &str = "#2a9d3a";
const BEACON: &str = "#e08a00";
const OBSTACLE: &str = "#9b7fb8";

/// What is drawn.
#[derive(Debug)]
pub struct Picture {
    world: World,
    geometry: Geometry,
    truth: Vec<Point>,
    robot: Option<Pose>,
    estimate: Vec<Point>,
    ellipses: Vec<(f64, middlelevel::DataEstimate)>,
    plan: Option<middlelevel::DataPlan>,
    obstacles: Option<middlelevel::DataObstacles>,
    contacts: Vec<Contact>,
}

impl Picture {
    /// An empty one of this world, for a robot of this geometry.
    #[must_use]
    pub fn new(world: World, geometry: Geometry) -> Self {
        Self {
            world,
            geometry,
            truth: Vec::new(),
            robot: None,
            estimate: Vec::new(),
            ellipses: Vec::new(),
            plan: None,
            obstacles: None,
            contacts: Vec::new(),
        }
    }

    /// Whether nothing of a robot is in it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.truth.is_empty() && self.estimate.is_empty()
    }

    /// Takes a message; those that have no place in a picture change nothing.
    pub fn take(&mut self, message: &Message) {
        match message {
            Message::SimDataTruth(truth) => self.on_truth(truth),
            Message::MlDataEstimate(estimate) if estimate.quality >= middlelevel::DataEstimate::COARSE => {
                self.on_estimate(estimate);
            }
            Message::MlDataPlan(plan) => self.plan = Some(plan.clone()),
            Message::MlDataObstacles(obstacles) => self.obstacles = Some(obstacles.clone()),
            _ => {}
        }
    }

    /// Takes a line that a module printed: contacts are told so.
    pub fn note(&mut self, line: &str) {
        self.contacts.extend(line.parse::<Contact>());
    }

    fn on_truth(&mut self, truth: &simulation::DataTruth) {
        let pose = Pose::new(truth.x, truth.y, truth.theta);
        self.robot = Some(pose);
        extend(&mut self.truth, pose.point());
    }

    fn on_estimate(&mut self, estimate: &middlelevel::DataEstimate) {
        let seconds = estimate.timestamp as f64 / 1e6;
        if self.ellipses.last().is_none_or(|(last, _)| seconds - last >= ELLIPSES) {
            self.ellipses.push((seconds, estimate.clone()));
        }
        extend(&mut self.estimate, Point { x: estimate.x, y: estimate.y });
    }

    /// The picture.
    #[must_use]
    pub fn svg(&self) -> String {
        let (least, most) = self.bounds();
        let (width, height) = ((most.x - least.x) * SCALE, (most.y - least.y) * SCALE);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{:.0}\" viewBox=\"0 0 {width:.0} \
             {0:.0}\" font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
            height + LEGEND
        );
        // Metres, y up, from here on.
        let _ = writeln!(
            out,
            "<g transform=\"translate({:.2} {:.2}) scale({SCALE} -{SCALE})\" fill=\"none\" stroke-width=\"0.03\">",
            -least.x * SCALE,
            most.y * SCALE
        );
        self.draw_world(&mut out);
        self.draw_planner(&mut out);
        lines(&mut out, &self.truth, TRUTH, "");
        lines(&mut out, &self.estimate, ESTIMATE, " stroke-dasharray=\"0.12 0.06\"");
        self.draw_ellipses(&mut out);
        self.draw_robot(&mut out);
        self.draw_contacts(&mut out);
        out.push_str("</g>\n");
        self.draw_legend(&mut out, height);
        out.push_str("</svg>\n");
        out
    }

    fn bounds(&self) -> (Point, Point) {
        let walls = self.world.walls.iter().flat_map(|wall| [wall.a, wall.b]);
        let beacons = self.world.beacons.iter().map(|beacon| beacon.at);
        let all = walls.chain(beacons).chain(self.truth.iter().chain(&self.estimate).copied());
        let (mut least, mut most) = (self.world.start.point(), self.world.start.point());
        for point in all.filter(|point| point.x.is_finite() && point.y.is_finite()) {
            least = Point { x: least.x.min(point.x), y: least.y.min(point.y) };
            most = Point { x: most.x.max(point.x), y: most.y.max(point.y) };
        }
        let (x, y) = (least.x - MARGIN, least.y - MARGIN);
        (Point { x, y }, Point { x: most.x + MARGIN, y: most.y + MARGIN })
    }

    fn draw_world(&self, out: &mut String) {
        for drop in &self.world.drops {
            let _ = writeln!(out, "<polygon points=\"{}\" fill=\"#f3c9c9\" stroke=\"none\"/>", points(drop));
        }
        for wall in &self.world.walls {
            let (a, b) = (wall.a, wall.b);
            let _ = writeln!(
                out,
                "<line x1=\"{:.3}\" y1=\"{:.3}\" x2=\"{:.3}\" y2=\"{:.3}\" stroke=\"black\" stroke-width=\"0.06\"/>",
                a.x, a.y, b.x, b.y
            );
        }
        for column in &self.world.columns {
            circle(out, column.centre, column.radius, "fill=\"#777\"");
        }
        for beacon in &self.world.beacons {
            circle(out, beacon.at, 0.12, &format!("fill=\"{BEACON}\""));
        }
    }

    fn draw_planner(&self, out: &mut String) {
        if let Some(obstacles) = &self.obstacles {
            let size = obstacles.size;
            for (x, y) in obstacles.x.iter().zip(&obstacles.y) {
                let (x, y) = (x - size / 2.0, y - size / 2.0);
                let _ = writeln!(
                    out,
                    "<rect x=\"{x:.3}\" y=\"{y:.3}\" width=\"{size:.3}\" height=\"{size:.3}\" fill=\"{OBSTACLE}\"/>"
                );
            }
        }
        if let Some(plan) = &self.plan {
            let way: Vec<Point> = plan.x.iter().zip(&plan.y).map(|(x, y)| Point { x: *x, y: *y }).collect();
            lines(out, &way, PLAN, " stroke-width=\"0.06\"");
        }
    }

    fn draw_ellipses(&self, out: &mut String) {
        for (_, estimate) in &self.ellipses {
            let [[xx, xy, _], [_, yy, _], _] = estimate.covariance;
            let (mean, half) = ((xx + yy) / 2.0, (xx - yy) / 2.0);
            let spread = half.hypot(xy);
            let axis = |variance: f64| DEVIATIONS * variance.max(0.0).sqrt();
            let (long, short) = (axis(mean + spread), axis(mean - spread));
            let turn = (0.5 * xy.atan2(half)).to_degrees();
            if long.is_finite() && turn.is_finite() {
                let _ = writeln!(
                    out,
                    "<ellipse rx=\"{long:.3}\" ry=\"{short:.3}\" transform=\"translate({:.3} {:.3}) rotate({turn:.1})\" \
                     stroke=\"{ESTIMATE}\" stroke-width=\"0.015\"/>",
                    estimate.x, estimate.y
                );
            }
        }
    }

    fn draw_robot(&self, out: &mut String) {
        let (Some(pose), g) = (self.robot, &self.geometry) else { return };
        let (rear, front, half) = (-g.rear_overhang_m, g.length_m - g.rear_overhang_m, g.width_m / 2.0);
        // Its nose shows where it looks.
        let corners = [(rear, -half), (front - 0.15, -half), (front, 0.0), (front - 0.15, half), (rear, half)];
        let outline: Vec<Point> = corners.iter().map(|(x, y)| pose * Point { x: *x, y: *y }).collect();
        let _ = writeln!(
            out,
            "<polygon points=\"{}\" stroke=\"{TRUTH}\" fill=\"{TRUTH}\" fill-opacity=\"0.25\"/>",
            points(&outline)
        );
    }

    fn draw_contacts(&self, out: &mut String) {
        for contact in &self.contacts {
            circle(out, contact.at, 0.2, "stroke=\"red\" stroke-width=\"0.06\"");
        }
    }

    fn draw_legend(&self, out: &mut String, top: f64) {
        let entries = [
            (TRUTH, "truth".to_string()),
            (ESTIMATE, format!("estimate, ellipses of {DEVIATIONS} deviations")),
            (PLAN, "plan".into()),
            (OBSTACLE, "obstacles".into()),
            (BEACON, "beacons".into()),
            ("red", format!("contacts ({})", self.contacts.len())),
        ];
        let mut x = 10.0;
        for (colour, text) in entries {
            let y = top + LEGEND / 2.0;
            let _ = writeln!(
                out,
                "<rect x=\"{x:.0}\" y=\"{:.0}\" width=\"14\" height=\"6\" fill=\"{colour}\"/><text x=\"{:.0}\" y=\"{:.0}\">{text}</text>",
                y - 3.0,
                x + 19.0,
                y + 5.0
            );
            x += 40.0 + 7.0 * text.len() as f64;
        }
    }
}

fn extend(line: &mut Vec<Point>, point: Point) {
    if point.x.is_finite() && point.y.is_finite() && line.last().is_none_or(|last| last.distance(point) >= STEP) {
        line.push(point);
    }
}

/// A line through these points, interrupted where it jumps.
fn lines(out: &mut String, all: &[Point], colour: &str, style: &str) {
    for piece in all.chunk_by(|a, b| a.distance(*b) < JUMP).filter(|piece| piece.len() > 1) {
        let _ = writeln!(out, "<polyline points=\"{}\" stroke=\"{colour}\"{style}/>", points(piece));
    }
}

fn points(all: &[Point]) -> String {
    let text: Vec<String> = all.iter().map(|point| format!("{:.3},{:.3}", point.x, point.y)).collect();
    text.join(" ")
}

fn circle(out: &mut String, at: Point, radius: f64, style: &str) {
    let _ = writeln!(out, "<circle cx=\"{:.3}\" cy=\"{:.3}\" r=\"{radius:.3}\" {style}/>", at.x, at.y);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Picture {
        let geometry = Geometry {
            wheelbase_m: 0.6,
            track_m: 0.5,
            wheel_radius_m: 0.1,
            length_m: 0.9,
            width_m: 0.6,
            rear_overhang_m: 0.15,
            ticks_per_turn: 4096,
        };
        Picture::new(World::hall(20.0, 12.0), geometry)
    }

    #[test]
    fn everything_that_was_told_is_in_it() {
        let mut picture = picture();
        assert!(picture.is_empty());
        for n in 0..100 {
            let (x, timestamp) = (4.0 + 0.1 * f64::from(n), i64::from(n) * 100_000);
            picture.take(&simulation::DataTruth { timestamp, x, y: 6.0, ..simulation::DataTruth::default() }.into());
            let covariance = [[0.04, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0; 3]];
            let quality = middlelevel::DataEstimate::FINE;
            let estimate =
                middlelevel::DataEstimate { timestamp, x, y: 6.1, covariance, quality, ..Default::default() };
            picture.take(&estimate.into());
        }
        picture.take(&middlelevel::DataPlan { timestamp: 0, x: vec![1.0, 1.5], y: vec![2.0, 2.0] }.into());
        picture.take(&middlelevel::DataObstacles { timestamp: 0, size: 0.1, x: vec![3.0], y: vec![2.0] }.into());
        picture.note("contact: by robot, robot 0.400 m/s, wall, at 13.900 6.000");
        picture.note("something else");
        let svg = picture.svg();
        let count = |what: &str| svg.matches(what).count();
        // Each has its entry below the picture, too.
        assert_eq!((count("<line "), count("<polyline"), count("<ellipse"), count("<circle")), (4, 3, 5, 1));
        assert!(svg.contains("<ellipse rx=\"0.400\" ry=\"0.200\" transform=\"translate(4.000 6.100) rotate(0.0)\""));
        assert!(svg.contains("contacts (1)") && svg.contains("width=\"1050\" height=\"680\""), "{}", &svg[..200]);
        assert!(!svg.contains("NaN") && svg.ends_with("</svg>\n"));
    }

    #[test]
    fn a_line_is_interrupted_where_it_jumps_and_what_is_no_number_is_left_out() {
        let mut picture = picture();
        for x in [1.0, 1.5, f64::NAN, 2.0, 9.0, 9.5, f64::INFINITY] {
            picture.take(&simulation::DataTruth { x, y: 6.0, ..simulation::DataTruth::default() }.into());
        }
        assert_eq!(picture.svg().matches("<polyline").count(), 2);
    }
}
