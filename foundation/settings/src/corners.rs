//! Polygons, as lists of their corners.

use crate::{Entry, Node, Rule, Value};
use std::ops::RangeInclusive;

/// Corners of a polygon at most.
pub const CORNERS_MAX: usize = 64;
/// Least area between the corners, in the square of their unit.
const AREA_MIN: f64 = 1e-3;

/// Corners of a polygon, `[x, y]` each within a range, one after the other around it, so that no edges cross; or a list
/// of such polygons.
pub struct Corners(pub RangeInclusive<f64>);

impl Corners {
    /// The corners of a polygon with at most `most` corners; what is wrong is refused.
    pub(crate) fn read_at_most(&self, most: usize, entry: &Entry<'_>) -> Option<Vec<[f64; 2]>> {
        let items = match &entry.node.value {
            Value::Array(items) if (3..=most).contains(&items.len()) => items,
            _ => {
                entry.refuse(self.expected_at_most(most));
                return None;
            }
        };
        let read: Vec<Option<[f64; 2]>> = (0..items.len()).map(|n| self.corner(&entry.item(n)?)).collect();
        let corners: Vec<[f64; 2]> = read.into_iter().collect::<Option<_>>()?;
        if let Some((one, other)) = crossing(&corners) {
            entry.refuse(format_args!(
                "corners one after the other around the polygon: the edge from [{one}] meets the one from [{other}]"
            ));
            return None;
        }
        if area(&corners) < AREA_MIN {
            entry.refuse(format_args!("corners with an area of {AREA_MIN} or more between them"));
            return None;
        }
        Some(corners)
    }

    pub(crate) fn expected_at_most(&self, most: usize) -> String {
        format!("a list of 3 to {most} corners [x, y] within {} to {}", self.0.start(), self.0.end())
    }

    fn corner(&self, entry: &Entry<'_>) -> Option<[f64; 2]> {
        let within = |node: &Node| node.value.number().filter(|value| self.0.contains(value));
        let corner = match &entry.node.value {
            Value::Array(items) => match &items[..] {
                [x, y] => within(x).zip(within(y)).map(|(x, y)| [x, y]),
                _ => None,
            },
            _ => None,
        };
        if corner.is_none() {
            entry.refuse(format_args!("two numbers from {} to {}: x, y", self.0.start(), self.0.end()));
        }
        corner
    }
}

impl Rule<Vec<[f64; 2]>> for Corners {
    fn read(&self, entry: &Entry<'_>) -> Option<Vec<[f64; 2]>> {
        self.read_at_most(CORNERS_MAX, entry)
    }

    fn expected(&self) -> String {
        self.expected_at_most(CORNERS_MAX)
    }

    fn stand_in(&self) -> Vec<[f64; 2]> {
        Vec::new()
    }

    fn shown(&self, corners: &Vec<[f64; 2]>) -> String {
        format!("{corners:?}")
    }
}

impl Rule<Vec<Vec<[f64; 2]>>> for Corners {
    fn read(&self, entry: &Entry<'_>) -> Option<Vec<Vec<[f64; 2]>>> {
        let Value::Array(items) = &entry.node.value else {
            entry.refuse(Rule::<Vec<Vec<[f64; 2]>>>::expected(self));
            return None;
        };
        let polygons: Vec<Option<Vec<[f64; 2]>>> =
            (0..items.len()).map(|n| Rule::<Vec<[f64; 2]>>::read(self, &entry.item(n)?)).collect();
        polygons.into_iter().collect()
    }

    fn expected(&self) -> String {
        format!("a list of polygons, each {}", Rule::<Vec<[f64; 2]>>::expected(self))
    }

    fn stand_in(&self) -> Vec<Vec<[f64; 2]>> {
        Vec::new()
    }

    fn shown(&self, polygons: &Vec<Vec<[f64; 2]>>) -> String {
        format!("{polygons:?}")
    }
}

/// Two edges that meet other than at the corner between them, by the numbers of their first corners from 0.
fn crossing(corners: &[[f64; 2]]) -> Option<(usize, usize)> {
    let count = corners.len();
    let edge = |n: usize| (corners[n], corners[(n + 1) % count]);
    let pairs = (0..count).flat_map(|one| (one + 1..count).map(move |other| (one, other)));
    pairs.into_iter().find(|(one, other)| {
        let ((a, b), (c, d)) = (edge(*one), edge(*other));
        match () {
            () if other - one == 1 => folds(a, b, d),
            () if *one == 0 && *other == count - 1 => folds(c, d, b),
            () => meets((a, b), (c, d)),
        }
    })
}

/// Twice the area of a triangle; positive if it is counter-clockwise.
fn turn([ax, ay]: [f64; 2], [bx, by]: [f64; 2], [cx, cy]: [f64; 2]) -> f64 {
    (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
}

/// True if the way from `b` to `c` leads back along the one from `a` to `b`, or one of them is none.
fn folds(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> bool {
    turn(a, b, c) == 0.0 && (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1]) <= 0.0
}

/// True if two lines have a point in common.
fn meets((a, b): ([f64; 2], [f64; 2]), (c, d): ([f64; 2], [f64; 2])) -> bool {
    let overlap =
        |axis: usize| a[axis].min(b[axis]) <= c[axis].max(d[axis]) && c[axis].min(d[axis]) <= a[axis].max(b[axis]);
    let is_between = |a, b, c, d| turn(a, b, c) * turn(a, b, d) <= 0.0;
    overlap(0) && overlap(1) && is_between(a, b, c, d) && is_between(c, d, a, b)
}

/// Area of a polygon without crossing edges.
pub(crate) fn area(corners: &[[f64; 2]]) -> f64 {
    let next = corners.iter().cycle().skip(1);
    let twice: f64 = corners.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
    twice.abs() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{read_as, settings};
    use std::path::Path;

    settings! {
        /// A table.
        #[derive(Clone, Debug, PartialEq)]
        pub struct Plan {
            /// One.
            room_m: Vec<[f64; 2]> = Vec::new(), Corners(-10.0..=10.0);
            /// Several.
            rooms_m: Vec<Vec<[f64; 2]>> = Vec::new(), Corners(-10.0..=10.0);
        }
    }

    fn read(text: &str) -> Result<Plan, Vec<String>> {
        read_as(&Node::parse(Path::new("plan.toml"), text).expect("TOML")).map_err(|errors| errors.0)
    }

    #[test]
    fn a_polygon_is_read_in_either_direction() {
        for room in ["[[0, 0], [2, 0], [2, 1.5]]", "[[0, 0], [0, 1], [1, 1], [0.5, 0.5], [1, 0]]"] {
            let plan = read(&format!("room_m = {room}\nrooms_m = [{room}, {room}]")).expect("a polygon");
            assert!(plan.room_m.len() >= 3 && plan.rooms_m == [plan.room_m.clone(), plan.room_m]);
        }
        assert_eq!(read("").expect("the defaults"), Plan { room_m: vec![], rooms_m: vec![] });
    }

    #[test]
    fn what_is_no_polygon_is_refused_with_what_would_be() {
        let expected = "a list of 3 to 64 corners [x, y] within -10 to 10";
        let around = "corners one after the other around the polygon";
        for (room, name, why) in [
            ("3", " = 3", expected.to_owned()),
            ("[[0, 0], [1, 0]]", " = [2 items]", expected.to_owned()),
            ("[[0, 0], [1, 0], [1, 11]]", "[2] = [2 items]", "two numbers from -10 to 10: x, y".into()),
            ("[[0, 0], [1, nan], [1, 1]]", "[1] = [2 items]", "two numbers from -10 to 10: x, y".into()),
            ("[[0, 0], [1, 0], [1, inf]]", "[2] = [2 items]", "two numbers from -10 to 10: x, y".into()),
            ("[[0, 0], [1, 0], [1]]", "[2] = [1 items]", "two numbers from -10 to 10: x, y".into()),
            ("[[0, 0], [1, 0], \"x\"]", "[2] = \"x\"", "two numbers from -10 to 10: x, y".into()),
            (
                "[[0, 0], [1, 1], [1, 0], [0, 1]]",
                " = [4 items]",
                format!("{around}: the edge from [0] meets the one from [2]"),
            ),
            (
                "[[0, 0], [2, 0], [1, 0], [1, 1]]",
                " = [4 items]",
                format!("{around}: the edge from [0] meets the one from [1]"),
            ),
            (
                "[[0, 0], [0, 0], [1, 0], [1, 1]]",
                " = [4 items]",
                format!("{around}: the edge from [0] meets the one from [1]"),
            ),
            (
                "[[0, 0], [1, 0], [1, 0.001]]",
                " = [3 items]",
                "corners with an area of 0.001 or more between them".into(),
            ),
        ] {
            let line = |key: &str| format!("plan.toml:1: {key}{name}: expected {why}");
            assert_eq!(read(&format!("room_m = {room}")), Err(vec![line("room_m")]));
            assert_eq!(read(&format!("rooms_m = [{room}]")), Err(vec![line("rooms_m[0]")]));
        }
        let many: Vec<String> = (0..65).map(|n| format!("[{}, {}]", f64::from(n) / 10.0, n % 2)).collect();
        assert!(read(&format!("room_m = [{}]", many.join(", "))).is_err_and(|errors| errors[0].contains(expected)));
    }
}
