//! A world for the simulated robot; its keys stand in `conf/worlds/README.md`.

use navitools::{Point, Pose};
use settings::{ConfigError, read};
use settings::{Node, Value};
use settings::{Problems, Table};
use simulator::world::{Beacon, Column, Crowd, Route, Segment, World};
use std::path::{Path, PathBuf};

/// Coordinates are within this, m.
const MAX: f64 = 1e4;

/// What begins a `--set` that is of the world.
const PREFIX: &str = "world.";

/// Reads the world of a file, or of a name in the folder `worlds` in or beside the configuration `dir`; without either
/// the hall. Those of the overrides `sets` that begin with `world.` are laid over it.
pub fn world(dir: &Path, file: Option<&Path>, sets: &[String]) -> Result<World, ConfigError> {
    let path = place(dir, file);
    parsed(read(&path)?, &path, sets)
}

/// The same of a file that was read; `path` is its name in errors.
pub fn parsed(mut node: Node, path: &Path, sets: &[String]) -> Result<World, ConfigError> {
    for set in sets.iter().filter_map(|set| set.trim_start().strip_prefix(PREFIX)) {
        node.set(set).map_err(|line| ConfigError(vec![line]))?;
    }
    check(&node).and_then(|world| match world.check() {
        Ok(()) => Ok(world),
        Err(error) => Err(ConfigError(vec![format!("{}: {error}", path.display())])),
    })
}

/// Whether an override is of the world, and not of the robot.
#[must_use]
pub fn is_of_world(set: &str) -> bool {
    set.trim_start().starts_with(PREFIX)
}

/// The file that [`world`] reads.
#[must_use]
pub fn place(dir: &Path, file: Option<&Path>) -> PathBuf {
    match file {
        Some(file) if file.components().count() > 1 || file.extension().is_some() => file.into(),
        name => named(dir, name.unwrap_or(Path::new("hall"))),
    }
}

fn named(dir: &Path, name: &Path) -> PathBuf {
    let file = name.with_extension("toml");
    let within = dir.join("worlds").join(&file);
    if within.exists() { within } else { dir.parent().unwrap_or(dir).join("worlds").join(file) }
}

/// Checks a world, parsed.
pub fn check(node: &Node) -> Result<World, ConfigError> {
    let problems = Problems::default();
    let world = Table::new(node, "", &problems).map(take);
    match (world, problems.lines()) {
        (Some(world), lines) if lines.is_empty() => Ok(world),
        (_, lines) => Err(ConfigError(lines)),
    }
}

fn take(mut root: Table<'_>) -> World {
    let start = root.node("start");
    if start.is_none() {
        root.refuse_missing("start", "a list of 3 numbers: x, y, theta");
    }
    let start: Option<[f64; 3]> = start.and_then(|node| numbers(&root, "start", node));
    let walls = list(&mut root, "walls");
    let walls = walls.into_iter().map(|[ax, ay, bx, by]| Segment { a: point(ax, ay), b: point(bx, by) });
    let walls = walls.collect();
    let columns = list(&mut root, "columns");
    let columns = columns.into_iter().map(|[x, y, radius]| Column { centre: point(x, y), radius }).collect();
    let drops = drops(&mut root);
    let beacons = root.tables("beacons").into_iter().map(beacon).collect();
    let people = people(&mut root);
    let places = list(&mut root, "places").into_iter().map(|[x, y]| point(x, y)).collect();
    let routes = root.tables("routes").into_iter().map(route).collect();
    root.end();
    let [x, y, theta] = start.unwrap_or_default();
    World { walls, columns, drops, beacons, people, places, routes, start: Pose::new(x, y, theta) }
}

/// How many, or a table of more than that.
fn people(root: &mut Table<'_>) -> Crowd {
    let usual = Crowd::default();
    let count = 0..=Crowd::MOST;
    match root.node("people") {
        None => usual,
        Some(Node { value: Value::Table(_), .. }) => root.table_if_any("people").map_or(usual, |mut table| {
            let crowd = Crowd {
                count: table.integer("count", None, count),
                grouped: table.number("grouped", Some(usual.grouped), 0.0..=1.0),
                attentive: table.number("attentive", Some(usual.attentive), 0.0..=1.0),
            };
            table.end();
            crowd
        }),
        Some(_) => Crowd { count: root.integer("people", None, count), ..usual },
    }
}

fn route(mut table: Table<'_>) -> Route {
    let name = table.text("name", None);
    let waypoints = list(&mut table, "waypoints").into_iter().map(|[x, y]| point(x, y)).collect();
    let looped = table.boolean("loop", false);
    table.end();
    Route { name, waypoints, looped }
}

fn beacon(mut table: Table<'_>) -> Beacon {
    let id = table.integer("id", None, 0..=255);
    let at = point(table.number("x", None, -MAX..=MAX), table.number("y", None, -MAX..=MAX));
    table.end();
    Beacon { id, at }
}

/// A list of lists of `N` numbers.
fn list<const N: usize>(root: &mut Table<'_>, key: &'static str) -> Vec<[f64; N]> {
    items(root, key).iter().filter_map(|item| numbers(root, key, item)).collect()
}

fn drops(root: &mut Table<'_>) -> Vec<Vec<Point>> {
    let mut drops = Vec::new();
    for drop in items(root, "drops") {
        let Value::Array(corners) = &drop.value else {
            root.refuse_item("drops", drop, "a list of corners [x, y]");
            continue;
        };
        drops.push(
            corners.iter().filter_map(|corner| numbers(root, "drops", corner)).map(|[x, y]| point(x, y)).collect(),
        );
    }
    drops
}

fn items<'a>(root: &mut Table<'a>, key: &'static str) -> &'a [Node] {
    match root.node(key) {
        Some(Node { value: Value::Array(items), .. }) => items,
        Some(_) => {
            root.refuse(key, "a list");
            &[]
        }
        None => &[],
    }
}

/// `N` numbers within ±10 km.
fn numbers<const N: usize>(root: &Table<'_>, key: &str, node: &Node) -> Option<[f64; N]> {
    let number = |node: &Node| match node.value {
        Value::Integer(value) => Some(value as f64),
        Value::Float(value) => Some(value),
        _ => None,
    };
    let found = match &node.value {
        Value::Array(items) => items.iter().map(number).collect::<Option<Vec<f64>>>(),
        _ => None,
    };
    let found = found.and_then(|found| <[f64; N]>::try_from(found).ok());
    let found = found.filter(|found| found.iter().all(|value| (-MAX..=MAX).contains(value)));
    if found.is_none() {
        root.refuse_item(key, node, format_args!("a list of {N} numbers within ±{MAX}"));
    }
    found
}

fn point(x: f64, y: f64) -> Point {
    Point { x, y }
}
