//! Forms of the values in the file of a world: lists of coordinates, people.

use super::{Beacon, Column, Crowd, Segment};
use navitools::{Point, Pose};
use settings::{Declared, Entry, Form, Rule, Value, robot};

/// Coordinates are within this, m.
const MAX: f64 = 1e4;
/// What lists are.
const LIST: &str = "a list";

pub const START: Form<Pose> = Form(
    |entry| numbers(entry).map(|[x, y, theta]| Pose::new(x, y, theta)),
    "a list of 3 numbers within ±10000: x, y, theta",
    "",
    |_| {},
);
pub const POINTS: Form<Vec<Point>> = Form(points, "a list of [x, y]", "[]", |_| {});
pub const WALLS: Form<Vec<Segment>> = Form(
    |entry| {
        let wall = |[ax, ay, bx, by]: [f64; 4]| Segment { a: point([ax, ay]), b: point([bx, by]) };
        items(entry, LIST, |item| numbers(item).map(wall))
    },
    "a list of [ax, ay, bx, by]",
    "[]",
    |_| {},
);
pub const COLUMNS: Form<Vec<Column>> = Form(
    |entry| {
        let column = |[x, y, radius]: [f64; 3]| Column { centre: point([x, y]), radius };
        items(entry, LIST, |item| numbers(item).map(column))
    },
    "a list of [x, y, radius]",
    "[]",
    |_| {},
);
pub const DROPS: Form<Vec<Vec<Point>>> = Form(
    |entry| items(entry, LIST, |drop| items(drop, "a list of corners [x, y]", |corner| numbers(corner).map(point))),
    "a list of lists of corners [x, y]",
    "[]",
    |_| {},
);
pub const BEACONS: Form<Vec<Beacon>> = Form(
    |entry| {
        let beacons: Vec<robot::Beacon> = ().read(entry)?;
        Some(beacons.into_iter().map(|beacon| Beacon { id: beacon.id, at: point([beacon.x, beacon.y]) }).collect())
    },
    "a list of tables",
    "[]",
    |rows| Rule::<Vec<robot::Beacon>>::rows(&(), rows),
);
pub const PEOPLE: Form<Crowd> = Form(
    |entry| match &entry.node.value {
        Value::Table(_) => Crowd::take(entry),
        _ => Some(Crowd { count: (0..=Crowd::MOST).read(entry)?, ..Crowd::default() }),
    },
    "an integer from 0 to 200, or a table",
    "0",
    <Crowd as Declared>::rows,
);

fn point([x, y]: [f64; 2]) -> Point {
    Point { x, y }
}

fn points(entry: &Entry<'_>) -> Option<Vec<Point>> {
    items(entry, LIST, |item| numbers(item).map(point))
}

/// `N` numbers within ±10 km.
fn numbers<const N: usize>(entry: &Entry<'_>) -> Option<[f64; N]> {
    let within = |value: f64| Some(value).filter(|value| (-MAX..=MAX).contains(value));
    let found: Option<Vec<f64>> = match &entry.node.value {
        Value::Array(items) => items.iter().map(|item| item.value.number().and_then(within)).collect(),
        _ => None,
    };
    let found = found.and_then(|found| found.try_into().ok());
    if found.is_none() {
        entry.refuse(format_args!("a list of {N} numbers within ±{MAX}"));
    }
    found
}

/// Each item of a list as `each` reads it; items that are refused are left out.
fn items<T>(entry: &Entry<'_>, expected: &str, each: impl Fn(&Entry<'_>) -> Option<T>) -> Option<Vec<T>> {
    let Value::Array(items) = &entry.node.value else {
        entry.refuse(expected);
        return None;
    };
    Some((0..items.len()).filter_map(|n| each(&entry.item(n)?)).collect())
}
