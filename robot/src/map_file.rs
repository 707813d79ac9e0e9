//! Map files of nav2's map_server: a YAML text and the PGM picture that it names; and worlds as maps.

use planner::map::{Map, pgm, yaml};
use std::fs;
use std::path::Path;

/// Cell size of a world's map, m.
const WORLD_CELL_M: f64 = 0.05;
/// Maximum size of a file: a plain picture of the largest map, with a margin.
const FILE_MAX: u64 = 128 << 20;

/// Loads the map of a YAML file and the picture that it names.
///
/// # Errors
/// A file cannot be read, or is invalid; with its line or byte.
pub fn load(file: &Path) -> Result<Map, String> {
    let named = |file: &Path, why: &dyn std::fmt::Display| format!("{}: {why}", file.display());
    let text = String::from_utf8(read(file)?).map_err(|_| named(file, &"is not a text"))?;
    let info = yaml::read(&text).map_err(|error| named(file, &error))?;
    let image = file.parent().unwrap_or(Path::new("")).join(&info.image);
    let picture = pgm::read(&read(&image)?).map_err(|error| named(&image, &error))?;
    info.map(&picture).map_err(|error| named(file, &error))
}

fn read(file: &Path) -> Result<Vec<u8>, String> {
    let told = |error: std::io::Error| format!("{}: {error}", file.display());
    let about = fs::metadata(file).map_err(told)?;
    if !about.is_file() || about.len() > FILE_MAX {
        return Err(format!("{}: not a file, or longer than {} MiB", file.display(), FILE_MAX >> 20));
    }
    fs::read(file).map_err(told)
}

/// Converts a world to a map, with the edge of its floor.
///
/// # Errors
/// The world is too large for a map.
pub fn of_world(world: &simulator::world::World) -> Result<Map, String> {
    let flat = |point: &navitools::Point| (point.x, point.y);
    let walls = world.walls.iter().map(|wall| (flat(&wall.a), flat(&wall.b))).collect::<Vec<_>>();
    let columns = world.columns.iter().map(|column| (flat(&column.centre), column.radius)).collect::<Vec<_>>();
    let drops = world.drops.iter().map(|drop| drop.iter().map(flat).collect()).collect::<Vec<Vec<_>>>();
    Map::drawn(&walls, &columns, &drops, flat(&world.start.point()), WORLD_CELL_M).map_err(|error| error.to_string())
}
