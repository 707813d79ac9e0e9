//! Fields of a form of their own, by configuration: polygons in the robot's frame (docs/guard.md). They bound the speed
//! beside the fields that are computed, and only ever lower it.

use crate::config::{Config, FieldKeys, FieldKind, Ranging};
use crate::fields::{Bound, Cause, is_place};
use crate::law::SPEED_MIN;
use kinematics::reach::Direction;
use kinematics::{Polygon, Twist};
use messages::lowlevel::Field;
use navitools::Point;
use surroundings::{Obstacle, Source, Unseen};

/// Half of the distance of the points with which something that was sensed is covered, m: a field between two of them
/// has it within.
const POINTS_M: f64 = 0.08;
/// Part of a point's own speed with which the robot must move away from it to leave it.
const LEAVING: f64 = 0.5;
/// Distance of the places by which a field is looked for in the views of the sensors, m.
const GRID_M: f64 = 0.05;

/// Something, or what is not known, within a field.
#[derive(Clone, Copy, Debug)]
struct Occupant {
    at: Point,
    /// Unit vector from the robot's outline to it; zero if it may be anywhere.
    out: Point,
    source: Source,
    sensed: bool,
}

/// A field of the configuration.
#[derive(Debug)]
struct Zone {
    kind: FieldKind,
    /// Speed from which on it counts, m/s.
    from: f64,
    /// Counter-clockwise, m.
    corners: Vec<Point>,
    occupants: Vec<Occupant>,
}

/// All fields of the configuration.
#[derive(Debug)]
pub struct Zones {
    all: Vec<Zone>,
    body: Polygon,
    uncertainty: f64,
    /// Speed to which a warning field slows, m/s, and with which a protective one is left.
    slow: f64,
}

impl Zones {
    /// The fields of a robot with this outline.
    #[must_use]
    pub fn new(config: &Config, body: &Polygon) -> Self {
        let settings = &config.settings;
        let zone = |keys: &FieldKeys| Zone {
            kind: keys.kind,
            from: keys.from,
            corners: counter_clockwise(&keys.polygon),
            occupants: Vec::new(),
        };
        // Without a sensor nothing is in them; such a configuration is refused.
        let fields = if settings.ranging == Ranging::None { &[][..] } else { &settings.fields[..] };
        let all = fields.iter().map(zone).collect();
        Self { all, body: body.clone(), uncertainty: settings.uncertainty, slow: settings.slow }
    }

    /// True if there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Distance of the farthest corner of any from the robot's reference point, m.
    #[must_use]
    pub fn reach(&self) -> f64 {
        let corners = self.all.iter().flat_map(|zone| &zone.corners);
        corners.map(|corner| corner.distance(Point::default())).fold(0.0, f64::max)
    }

    /// Takes note of what is in each of them: obstacles, and what is not known, both in the robot's frame.
    pub fn update(&mut self, obstacles: &[Obstacle], unseen: &[Unseen]) {
        let Self { all, body, uncertainty, .. } = self;
        let margin = *uncertainty + POINTS_M;
        let out = |at: Point| body.nearest_edge(at).1;
        for Zone { corners, occupants, .. } in all {
            occupants.clear();
            occupants.extend(obstacles.iter().filter_map(|&Obstacle { at, source, sensed, .. }| {
                if !is_place(at) {
                    return Some(Occupant { at: Point::default(), out: Point::default(), source, sensed });
                }
                let at = first_within(corners, at, at, margin)?;
                Some(Occupant { at, out: out(at), source, sensed })
            }));
            occupants.extend(unseen.iter().filter_map(|part| {
                let at = first_within(corners, part.from, part.to, part.half)?;
                Some(Occupant { at, out: out(at), source: part.source, sensed: false })
            }));
        }
    }

    /// The bound of a direction, in which the base can take these paths, lowered by what is in the fields. `radius`:
    /// distance of the farthest corner of the outline, whose speed counts on the spot, m.
    #[must_use]
    pub fn lowered(&self, bound: Bound, direction: Direction, paths: &[Twist], radius: f64) -> Bound {
        let scale = if direction.turns() { radius } else { 1.0 };
        let permitted = self.all.iter().filter_map(|zone| zone.permits(paths, self.slow));
        permitted.fold(bound, |bound, (speed, cause)| {
            let speed = if speed < SPEED_MIN { 0.0 } else { speed / scale };
            if speed < bound.speed { Bound { speed, cause: Some(cause), ..bound } } else { bound }
        })
    }

    /// Those that count at a speed, m/s, and those in which something is.
    pub fn shown(&self, speed: f64) -> impl Iterator<Item = Field> + '_ {
        let counts = move |zone: &&Zone| zone.from <= speed || !zone.occupants.is_empty();
        self.all.iter().filter(counts).map(|zone| {
            let (x, y) = zone.corners.iter().map(|corner| (corner.x, corner.y)).unzip();
            let kind = match zone.kind {
                FieldKind::Protective => Field::PROTECTIVE,
                FieldKind::Warning => Field::WARNING,
            };
            Field { kind, occupied: !zone.occupants.is_empty(), x, y }
        })
    }
}

impl Zone {
    /// Greatest speed on these paths, m/s, and what bounds it; `None`: nothing in this field does.
    fn permits(&self, paths: &[Twist], slow: f64) -> Option<(f64, Cause)> {
        let cause = |occupant: &Occupant, sensed: fn(Source) -> Cause| {
            if occupant.sensed { sensed(occupant.source) } else { Cause::Unknown(occupant.source) }
        };
        let slow = slow.max(self.from);
        let stays = self.occupants.iter().find(|occupant| !paths.iter().all(|path| occupant.is_left(*path)));
        match (self.kind, stays, self.occupants.first()) {
            (FieldKind::Protective, Some(occupant), _) => Some((self.from, cause(occupant, Cause::Stops))),
            (FieldKind::Protective, None, Some(occupant)) | (FieldKind::Warning, Some(occupant), _) => {
                Some((slow, cause(occupant, Cause::Slows)))
            }
            (_, None, None) | (FieldKind::Warning, None, _) => None,
        }
    }
}

impl Occupant {
    /// True if the robot moves away from it on this path.
    fn is_left(&self, path: Twist) -> bool {
        let (x, y) = path.at(self.at.x, self.at.y);
        let away = -(x * self.out.x + y * self.out.y);
        away > 0.0 && away >= LEAVING * libm::hypot(x, y)
    }
}

/// Part of each field of the configuration, outside of the robot's outline, that no sensor looks at, 0 to 1: what is
/// there is not sensed.
#[must_use]
pub fn unwatched(config: &Config) -> Vec<f64> {
    let Some(body) = Polygon::hull(&config.footprint) else { return Vec::new() };
    let reach = config.settings.reach;
    let is_seen = |point: Point| {
        config.sonars().iter().any(|sonar| sonar.covers(point) && point.distance(sonar.at) <= reach)
            || config.lidars().iter().any(|lidar| lidar.covers(point))
    };
    let part = |polygon: &Vec<[f64; 2]>| {
        let corners = counter_clockwise(polygon);
        let most = |measure: &dyn Fn(&Point) -> f64| corners.iter().map(measure).fold(f64::NEG_INFINITY, f64::max);
        let (rear, front) = (-most(&|corner| -corner.x), most(&|corner| corner.x));
        let (right, left) = (-most(&|corner| -corner.y), most(&|corner| corner.y));
        let steps =
            |from: f64, to: f64| (0..=((to - from) / GRID_M) as u32).map(move |n| from + (f64::from(n) + 0.5) * GRID_M);
        let places = steps(rear, front).flat_map(|x| steps(right, left).map(move |y| Point { x, y }));
        let places = places.filter(|point| body.outside(*point) > 0.0 && contains(&corners, *point));
        let (all, seen) = places.fold((0_u32, 0_u32), |(all, seen), point| (all + 1, seen + u32::from(is_seen(point))));
        f64::from(all - seen) / f64::from(all.max(1))
    };
    config.settings.fields.iter().map(|keys| part(&keys.polygon)).collect()
}

/// The same polygon with its corners counter-clockwise.
fn counter_clockwise(polygon: &[[f64; 2]]) -> Vec<Point> {
    let mut corners: Vec<Point> = polygon.iter().map(|[x, y]| Point { x: *x, y: *y }).collect();
    let twice: f64 = edges(&corners).map(|(a, b)| a.x * b.y - b.x * a.y).sum();
    if twice < 0.0 {
        corners.reverse();
    }
    corners
}

/// Ends of the edges: from, to.
fn edges(corners: &[Point]) -> impl Iterator<Item = (Point, Point)> + '_ {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

/// True if a point is within a polygon: it crosses an odd number of edges on its way to the left.
fn contains(corners: &[Point], point: Point) -> bool {
    let crosses = |(a, b): &(Point, Point)| {
        (a.y > point.y) != (b.y > point.y) && point.x < (b.x - a.x) * (point.y - a.y) / (b.y - a.y) + a.x
    };
    edges(corners).filter(crosses).count() % 2 == 1
}

/// The first place of a line that is within a polygon, or as near to it as the margin, m.
fn first_within(corners: &[Point], from: Point, to: Point, margin: f64) -> Option<Point> {
    if contains(corners, from) || edges(corners).any(|(a, b)| distance(from, a, b).0 <= margin) {
        return Some(from);
    }
    let crossed = edges(corners).filter_map(|(a, b)| crossing((from, to), (a, b)));
    // What it passes nearby: a corner, or its own end.
    let passed = corners.iter().map(|corner| distance(*corner, from, to));
    let passed = passed.filter(|(apart, _)| *apart <= margin).map(|(_, part)| part);
    let ends = edges(corners).any(|(a, b)| distance(to, a, b).0 <= margin).then_some(1.0);
    let part = crossed.chain(passed).chain(ends).fold(f64::INFINITY, f64::min);
    let at = |part: f64| Point { x: from.x + part * (to.x - from.x), y: from.y + part * (to.y - from.y) };
    part.is_finite().then(|| at(part))
}

/// Part of the first line, 0 to 1, at which it crosses the second one.
fn crossing((from, to): (Point, Point), (a, b): (Point, Point)) -> Option<f64> {
    let (dx, dy) = (to.x - from.x, to.y - from.y);
    let (ex, ey) = (b.x - a.x, b.y - a.y);
    let across = dx * ey - dy * ex;
    let (px, py) = (a.x - from.x, a.y - from.y);
    let (part, other) = ((px * ey - py * ex) / across, (px * dy - py * dx) / across);
    // Lines that are parallel meet at an end, or nowhere.
    ((0.0..=1.0).contains(&part) && (0.0..=1.0).contains(&other)).then_some(part)
}

/// Distance of a point from a line, m, and the nearest part of the line, 0 to 1.
fn distance(point: Point, a: Point, b: Point) -> (f64, f64) {
    let (dx, dy) = (b.x - a.x, b.y - a.y);
    let square = dx * dx + dy * dy;
    let part = if square > 0.0 { ((point.x - a.x) * dx + (point.y - a.y) * dy) / square } else { 0.0 };
    let part = part.clamp(0.0, 1.0);
    (point.distance(Point { x: a.x + part * dx, y: a.y + part * dy }), part)
}

#[cfg(test)]
mod tests;
