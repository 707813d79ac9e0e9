//! Map files of nav2's map_server: a YAML text and the PGM picture that it names; worlds as maps, and maps as worlds.

mod outline;
mod rooms;
#[cfg(test)]
mod tests;

pub use outline::{WALLS_MAX, walls};
pub use rooms::{Refused, of_rooms, start};

use planner::map::pgm::{self, Picture};
use planner::map::{Cell, Map, yaml};
use std::fs;
use std::path::Path;

/// Cell size of a world's map, m.
pub const WORLD_CELL_M: f64 = 0.05;
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

/// True if a path names a map's text: it ends in `.yaml` or `.yml`.
#[must_use]
pub fn is_map(file: &Path) -> bool {
    file.extension().is_some_and(|ending| ending == "yaml" || ending == "yml")
}

/// Writes a map: the text `file`, and its picture of the same name beside it, which ends in `.pgm`. Existing files are
/// replaced.
///
/// # Errors
/// `file` does not end in `.yaml` or `.yml`, its name cannot be written in a map's text, or a file cannot be written.
pub fn save(map: &Map, file: &Path) -> Result<(), String> {
    let named = |file: &Path, why: &dyn std::fmt::Display| format!("{}: {why}", file.display());
    if !is_map(file) {
        return Err(named(file, &"a map's name ends in .yaml"));
    }
    let image = file.with_extension("pgm");
    let name = image.file_name().and_then(|name| name.to_str());
    let name = name.filter(|name| !name.contains(|letter: char| letter == '\'' || letter.is_control()));
    let name = name.ok_or_else(|| named(file, &"a name with letters that a map's text cannot contain"))?;
    fs::write(&image, pgm::write(&picture(map))).map_err(|error| named(&image, &error))?;
    fs::write(file, text(map, name)).map_err(|error| named(file, &error))
}

/// Grey values as nav2's map_saver writes them: black is occupied, nearly white is free, between them unknown.
fn picture(map: &Map) -> Picture {
    let grey = |cell: &Cell| match cell {
        Cell::Occupied => 0,
        Cell::Unknown => 205,
        Cell::Free => 254,
    };
    let (width, height) = (map.frame().width, map.frame().height);
    let grey = map.cells().chunks_exact(width).rev().flatten().map(grey).collect();
    Picture { width, height, max: 255, grey }
}

/// Text of a map with the picture `image`. By these thresholds the grey of an unknown cell is unknown.
fn text(map: &Map, image: &str) -> String {
    let frame = map.frame();
    format!(
        "image: '{image}'\nmode: trinary\nresolution: {:?}\norigin: [{:?}, {:?}, 0.0]\nnegate: 0\n\
         occupied_thresh: 0.65\nfree_thresh: 0.196\n",
        frame.resolution, frame.x, frame.y
    )
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
