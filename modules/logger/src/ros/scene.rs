//! `/scene`: markers other than sensors and paths.

use messages::lowlevel::{DataGuard, Field};
use messages::middlelevel::{DataEstimate, DataObstacles, DataPersons, TrackedPerson};

use super::robot::{Beacon, RobotScene};
use super::standard::Standard;
use super::write::{Color, Fields, Pose, To};

/// Period at which static markers are repeated, for viewers that join later: µs.
const REPEAT_PERIOD_US: u64 = 1_000_000;
/// Least interval of the guard's fields, which are published at 20 Hz: µs.
const FIELDS_PERIOD_US: u64 = 200_000;
/// Maximum number of corners of a field; one with more is left out.
const CORNERS_MAX: usize = 64;
/// Maximum number of fields of a kind.
const FIELDS_MAX: usize = 10;

/// Maximum number of tracked people, and the diameter of their spheres, m.
const PERSONS_MAX: usize = 64;
const PERSON_M: f64 = 0.4;

const CUBE_LIST: i32 = 6;
const SPHERE_LIST: i32 = 7;
const CYLINDER: i32 = 3;
const LINE_STRIP: i32 = 4;
const LINE_LIST: i32 = 5;
const TEXT: i32 = 9;
const TRIANGLES: i32 = 11;

const ADD: i32 = 0;
const DELETE: i32 = 2;

const OUTLINE: Color = [0.2, 0.6, 1.0, 1.0];
const BEACON: Color = [1.0, 0.7, 0.0, 1.0];
const ELLIPSE: Color = [0.9, 0.1, 0.9, 0.3];
const OBSTACLE: Color = [0.8, 0.1, 0.1, 0.6];
const PERSON: Color = [0.1, 0.6, 0.3, 0.8];
const PROTECTIVE: Color = [0.84, 0.37, 0.0, 1.0];
const WARNING: Color = [0.94, 0.89, 0.26, 1.0];
/// Opacity of an occupied field.
const OCCUPIED: f32 = 0.35;

/// Robot as shown, and the time at which it was last sent.
#[derive(Clone, Debug)]
pub struct Scene {
    pub robot: RobotScene,
    shown: Option<i64>,
    /// Time at which the guard's fields were sent last, and how many of each kind.
    fields: Option<i64>,
    counts: [usize; 2],
}

/// Marker; fields that its kind does not use stay empty.
#[derive(Clone, Copy)]
struct Marker<'a> {
    frame: &'a str,
    ns: &'a str,
    id: i32,
    ty: i32,
    action: i32,
    pose: Pose,
    scale: [f64; 3],
    color: Color,
    points: &'a [[f64; 2]],
    text: &'a str,
}

impl Scene {
    pub fn new(robot: RobotScene) -> Self {
        Self { robot, shown: None, fields: None, counts: [0; 2] }
    }

    /// Ellipse of two standard deviations around the robot; periodically its outline and the beacons too.
    pub fn estimate(&mut self, message: &DataEstimate, to: &mut To<'_, '_>) {
        let again = self.shown.is_none_or(|shown| shown.abs_diff(message.timestamp) >= REPEAT_PERIOD_US);
        if again {
            self.shown = Some(message.timestamp);
        }
        let robot = &self.robot;
        let (beacons, outline): (&[Beacon], _) =
            if again { (&robot.beacons, !robot.outline.is_empty()) } else { (&[], false) };
        to.send("/scene", Standard::Markers, |fields| {
            fields.to.count(1 + usize::from(outline) + 2 * beacons.len());
            ellipse(message, fields);
            if outline {
                let mut points = robot.outline.clone();
                points.extend(robot.outline.first());
                let line = Marker { ns: "outline", ty: LINE_STRIP, scale: [0.02, 0.0, 0.0], ..Marker::new(OUTLINE) };
                Marker { frame: "base_link", points: &points, ..line }.write(message.timestamp, fields);
            }
            for beacon in beacons {
                let pose = Pose { x: beacon.x, y: beacon.y, theta: 0.0 };
                let number = beacon.id.to_string();
                let place = Marker { ns: "beacons", id: beacon.id, pose, ..Marker::new(BEACON) };
                let label = Marker { ns: "beacon_numbers", ty: TEXT, text: &number, scale: [0.0, 0.0, 0.3], ..place };
                Marker { ty: CYLINDER, scale: [0.15, 0.15, 0.02], ..place }.write(message.timestamp, fields);
                label.write(message.timestamp, fields);
            }
        });
    }
}

impl Scene {
    /// Fields of the guard in the robot's frame, each as its outline, and filled while something is in it.
    pub fn guard(&mut self, message: &DataGuard, to: &mut To<'_, '_>) {
        if self.fields.is_some_and(|last| last.abs_diff(message.timestamp) < FIELDS_PERIOD_US) {
            return;
        }
        self.fields = Some(message.timestamp);
        let names = [
            (Field::PROTECTIVE, "protective_field", PROTECTIVE, 0.03),
            (Field::WARNING, "warning_field", WARNING, 0.015),
        ];
        let of = |kind: i8| message.fields.iter().filter(move |field| field.kind == kind).take(FIELDS_MAX);
        let counts = names.map(|(kind, ..)| of(kind).count());
        // Those that were sent last, and are gone, are deleted.
        let rows = [0, 1].map(|n| counts[n].max(self.counts[n]).max(1));
        self.counts = counts;
        to.send("/scene", Standard::Markers, |fields| {
            fields.to.count(2 * (rows[0] + rows[1]));
            for ((kind, ns, color, width), rows) in names.into_iter().zip(rows) {
                let mut of_kind = of(kind);
                for id in (0..2 * rows as i32).step_by(2) {
                    let (outline, filling) = of_kind.next().map_or_else(Default::default, shape);
                    let line = Marker { frame: "base_link", ns, id, ty: LINE_STRIP, ..Marker::new(color) };
                    let action = |points: &[[f64; 2]]| if points.is_empty() { DELETE } else { ADD };
                    let line = Marker { action: action(&outline), scale: [width, 0.0, 0.0], points: &outline, ..line };
                    line.write(message.timestamp, fields);
                    let [r, g, b, _] = color;
                    let (scale, color) = ([1.0; 3], [r, g, b, OCCUPIED]);
                    let area = Marker { id: id + 1, ty: TRIANGLES, action: action(&filling), scale, color, ..line };
                    Marker { points: &filling, ..area }.write(message.timestamp, fields);
                }
            }
        });
    }
}

/// Closed outline of a field, and its triangles if it is occupied; empty if its corners are invalid.
fn shape(field: &Field) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    let corners: Vec<[f64; 2]> = field.x.iter().zip(&field.y).map(|(&x, &y)| [x, y]).collect();
    let [first, rest @ ..] = &corners[..] else { return Default::default() };
    if !(2..CORNERS_MAX).contains(&rest.len()) || corners.iter().flatten().any(|place| !place.is_finite()) {
        return Default::default();
    }
    let filling = if field.occupied { triangles(&corners) } else { Vec::new() };
    (corners.iter().chain([first]).copied().collect(), filling)
}

/// Triangles of a polygon whose corners are counter-clockwise and whose edges do not cross, corner by corner; as far as
/// one can be cut off.
fn triangles(corners: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let (mut left, mut found) = (corners.to_vec(), Vec::new());
    let turn =
        |[ax, ay]: [f64; 2], [bx, by]: [f64; 2], [cx, cy]: [f64; 2]| (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    while left.len() >= 3 {
        let count = left.len();
        let around = |n: usize| [left[(n + count - 1) % count], left[n % count], left[(n + 1) % count]];
        // It is convex, and no other corner is within.
        let is_ear = |n: &usize| {
            let [a, b, c] = around(*n);
            let mut others = left.iter().filter(|other| ![a, b, c].contains(other));
            let within = |p: &[f64; 2]| turn(a, b, *p) >= 0.0 && turn(b, c, *p) >= 0.0 && turn(c, a, *p) >= 0.0;
            turn(a, b, c) > 0.0 && !others.any(within)
        };
        let Some(ear) = (1..=count).find(is_ear) else { break };
        found.extend(around(ear));
        left.remove(ear % count);
    }
    found
}

/// Cells that the planner avoids.
pub fn obstacles(message: &DataObstacles, to: &mut To<'_, '_>) {
    let points: Vec<[f64; 2]> = message.x.iter().zip(&message.y).map(|(&x, &y)| [x, y]).collect();
    let action = if points.is_empty() { DELETE } else { ADD };
    let marker = Marker { ns: "obstacles", ty: CUBE_LIST, action, ..Marker::new(OBSTACLE) };
    to.send("/scene", Standard::Markers, |fields| {
        fields.to.count(1);
        let marker = Marker { scale: [message.size, message.size, 0.05], points: &points, ..marker };
        marker.write(message.timestamp, fields);
    });
}

/// People that the planner tracks: spheres, and from each a line to where it is in a second.
pub fn persons(message: &DataPersons, to: &mut To<'_, '_>) {
    let is_sane =
        |person: &&TrackedPerson| [person.x, person.y, person.vx, person.vy].iter().all(|value| value.is_finite());
    let all = || message.persons.iter().filter(is_sane).take(PERSONS_MAX);
    let places: Vec<[f64; 2]> = all().map(|person| [person.x, person.y]).collect();
    let ways: Vec<[f64; 2]> =
        all().flat_map(|person| [[person.x, person.y], [person.x + person.vx, person.y + person.vy]]).collect();
    let action = if places.is_empty() { DELETE } else { ADD };
    let marker = Marker { ns: "persons", ty: SPHERE_LIST, action, scale: [PERSON_M; 3], ..Marker::new(PERSON) };
    to.send("/scene", Standard::Markers, |fields| {
        fields.to.count(2);
        Marker { points: &places, ..marker }.write(message.timestamp, fields);
        let ways = Marker { id: 1, ty: LINE_LIST, scale: [0.04, 0.0, 0.0], points: &ways, ..marker };
        ways.write(message.timestamp, fields);
    });
}

/// Disc with the ellipse's axes as diameters; omitted if the covariance is invalid.
fn ellipse(message: &DataEstimate, fields: &mut Fields<'_>) {
    let [[xx, xy, _], [_, yy, _], _] = message.covariance;
    let (middle, half) = ((xx + yy) / 2.0, (xx - yy) / 2.0);
    let root = (half * half + xy * xy).sqrt();
    let [long, short] = [middle + root, (middle - root).max(0.0)].map(|variance| 4.0 * variance.sqrt());
    let pose = Pose { x: message.x, y: message.y, theta: 0.5 * libm::atan2(xy, half) };
    let marker = Marker { ns: "estimate", ty: CYLINDER, ..Marker::new(ELLIPSE) };
    let marker = if pose.is_finite() && long.is_finite() && short.is_finite() {
        // Viewers reject a disc of zero width.
        Marker { pose, scale: [long.max(1e-3), short.max(1e-3), 0.01], ..marker }
    } else {
        Marker { action: DELETE, ..marker }
    };
    marker.write(message.timestamp, fields);
}

impl Marker<'_> {
    /// Marker at the origin of the map.
    fn new(color: Color) -> Self {
        let (pose, scale) = (Pose::default(), [0.0; 3]);
        Self { frame: "map", ns: "", id: 0, ty: 0, action: ADD, pose, scale, color, points: &[], text: "" }
    }

    /// `visualization_msgs/Marker`.
    fn write(&self, timestamp: i64, fields: &mut Fields<'_>) {
        fields.header(timestamp, self.frame);
        fields.to.string(self.ns);
        [self.id, self.ty, self.action].into_iter().for_each(|number| fields.to.i32(number));
        fields.pose(self.pose);
        let [x, y, z] = self.scale;
        fields.vector(x, y, z);
        fields.color(self.color);
        fields.time(0); // lifetime: unlimited
        fields.to.bool(true); // moves with its frame
        fields.to.count(self.points.len());
        for &[x, y] in self.points {
            fields.vector(x, y, 0.0);
        }
        fields.to.count(0); // colors
        fields.to.string(""); // texture_resource
        fields.header(0, ""); // texture: header, format, data
        fields.to.string("");
        fields.to.count(0);
        fields.to.count(0); // uv_coordinates
        fields.to.string(self.text);
        fields.to.string(""); // mesh_resource
        fields.to.string(""); // mesh_file: filename, data
        fields.to.count(0);
        fields.to.bool(false); // mesh_use_embedded_materials
    }
}
