//! Rules for the values in the file of a world: lists of coordinates, people.

use super::{Beacon, Column, Crowd, Segment};
use navitools::{Point, Pose};
use settings::{Declared, Entry, Rows, Rule, Value, robot};

/// Coordinates are within this, m.
const MAX: f64 = 1e4;

/// A list of lists of `N` numbers, each an item.
pub struct Lists<const N: usize, T>(pub fn([f64; N]) -> T);

/// A list of polygons.
pub struct Drops;

/// A list of tables with `id`, `x` and `y`.
pub struct Beacons;

/// The number of people, or a table.
pub struct People;

/// Three numbers.
pub struct Start;

pub fn point([x, y]: [f64; 2]) -> Point {
    Point { x, y }
}

pub fn wall([ax, ay, bx, by]: [f64; 4]) -> Segment {
    Segment { a: Point { x: ax, y: ay }, b: Point { x: bx, y: by } }
}

pub fn column([x, y, radius]: [f64; 3]) -> Column {
    Column { centre: Point { x, y }, radius }
}

/// `N` numbers within ±10 km.
fn numbers<const N: usize>(entry: &Entry<'_>) -> Option<[f64; N]> {
    let Value::Array(items) = &entry.node.value else { return refused(entry, &of::<N>()) };
    let found: Option<Vec<f64>> = items.iter().map(|item| item.value.number()).collect();
    let found = found.and_then(|found| <[f64; N]>::try_from(found).ok());
    let found = found.filter(|found| found.iter().all(|value| (-MAX..=MAX).contains(value)));
    found.or_else(|| refused(entry, &of::<N>()))
}

fn of<const N: usize>() -> String {
    format!("a list of {N} numbers within ±{MAX}")
}

fn refused<T>(entry: &Entry<'_>, expected: &str) -> Option<T> {
    entry.refuse(expected);
    None
}

/// Each item of a list as `each` reads it; items that are refused are left out.
fn items<T>(entry: &Entry<'_>, expected: &str, each: impl Fn(&Entry<'_>) -> Option<T>) -> Option<Vec<T>> {
    let Value::Array(items) = &entry.node.value else { return refused(entry, expected) };
    Some((0..items.len()).filter_map(|n| each(&entry.item(n)?)).collect())
}

impl<const N: usize, T> Rule<Vec<T>> for Lists<N, T> {
    fn read(&self, entry: &Entry<'_>) -> Option<Vec<T>> {
        items(entry, "a list", |item| numbers(item).map(self.0))
    }

    fn expected(&self) -> String {
        format!("a list of lists of {N} numbers within ±{MAX}")
    }

    fn stand_in(&self) -> Vec<T> {
        Vec::new()
    }

    fn shown(&self, _: &Vec<T>) -> String {
        "[]".into()
    }
}

impl Rule<Vec<Vec<Point>>> for Drops {
    fn read(&self, entry: &Entry<'_>) -> Option<Vec<Vec<Point>>> {
        items(entry, "a list", |drop| items(drop, "a list of corners [x, y]", |corner| numbers(corner).map(point)))
    }

    fn expected(&self) -> String {
        "a list of lists of corners [x, y]".into()
    }

    fn stand_in(&self) -> Vec<Vec<Point>> {
        Vec::new()
    }

    fn shown(&self, _: &Vec<Vec<Point>>) -> String {
        "[]".into()
    }
}

impl Rule<Vec<Beacon>> for Beacons {
    fn read(&self, entry: &Entry<'_>) -> Option<Vec<Beacon>> {
        let at = |beacon: robot::Beacon| Beacon { id: beacon.id, at: Point { x: beacon.x, y: beacon.y } };
        let beacons: Vec<robot::Beacon> = ().read(entry)?;
        Some(beacons.into_iter().map(at).collect())
    }

    fn expected(&self) -> String {
        Rule::<Vec<robot::Beacon>>::expected(&())
    }

    fn stand_in(&self) -> Vec<Beacon> {
        Vec::new()
    }

    fn shown(&self, _: &Vec<Beacon>) -> String {
        "[]".into()
    }

    fn rows(&self, rows: &mut Rows) {
        Rule::<Vec<robot::Beacon>>::rows(&(), rows);
    }
}

impl Rule<Crowd> for People {
    fn read(&self, entry: &Entry<'_>) -> Option<Crowd> {
        match &entry.node.value {
            Value::Table(_) => Crowd::take(entry),
            _ => Some(Crowd { count: (0..=Crowd::MOST).read(entry)?, ..Crowd::default() }),
        }
    }

    fn expected(&self) -> String {
        format!("{}, or a table", Rule::<u32>::expected(&(0..=Crowd::MOST)))
    }

    fn stand_in(&self) -> Crowd {
        Crowd::default()
    }

    fn shown(&self, crowd: &Crowd) -> String {
        crowd.count.to_string()
    }

    fn rows(&self, rows: &mut Rows) {
        <Crowd as Declared>::rows(rows);
    }
}

impl Rule<Pose> for Start {
    fn read(&self, entry: &Entry<'_>) -> Option<Pose> {
        numbers(entry).map(|[x, y, theta]| Pose::new(x, y, theta))
    }

    fn expected(&self) -> String {
        format!("{}: x, y, theta", of::<3>())
    }

    fn stand_in(&self) -> Pose {
        Pose::default()
    }

    fn shown(&self, start: &Pose) -> String {
        format!("[{}, {}, {}]", start.x, start.y, start.theta)
    }
}
