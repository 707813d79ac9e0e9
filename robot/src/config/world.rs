//! A world for the simulated robot; its keys stand in `conf/worlds/README.md`. A map file is a world, too, and a world
//! may have one.

use crate::map_file;
use planner::map::{Cell, Map};
use settings::{ConfigError, Node, Value, read_as};
use simulator::world::{Segment, World};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// What begins a `--set` that is of the world.
const PREFIX: &str = "world.";

/// Where a world that is missing may be: a copy of a configuration folder has none beside it.
const WHERE: &str = "a world is a file that --world names, or in the folder worlds in or beside the configuration";

/// Reads the world of a file, or of a name in the folder `worlds` in or beside the configuration `dir`; without either
/// the hall. Those of the overrides `sets` that begin with `world.` are laid over it.
pub fn world(dir: &Path, file: Option<&Path>, sets: &[String]) -> Result<World, ConfigError> {
    Source::read(dir, file, sets).map(|source| source.world)
}

/// A world, and the texts from which it can be made again without its files.
#[derive(Clone, Debug)]
pub struct Source {
    /// The world.
    pub world: World,
    /// Text of the world's file; for a map without one, a text with its start.
    pub text: String,
    /// Walls of the map as a text, for [`recorded`]; `None` without a map.
    pub walls: Option<String>,
}

impl Source {
    /// Reads a world as [`world`] does.
    ///
    /// # Errors
    /// One line for each thing that is wrong.
    pub fn read(dir: &Path, file: Option<&Path>, sets: &[String]) -> Result<Self, ConfigError> {
        let path = place(dir, file);
        let missing = |error: String| match path.exists() {
            true => refused(error),
            false => refused(format!("{error}; {WHERE}")),
        };
        let (text, own) = match map_file::is_map(&path) {
            true => {
                let map = map_file::load(&path).map_err(missing)?;
                (format!("start = {}\n", start(&map, &path, sets)?), Some(map))
            }
            false => {
                (fs::read_to_string(&path).map_err(|error| missing(format!("{}: {error}", path.display())))?, None)
            }
        };
        let node = Node::parse(&path, &text).map_err(ConfigError)?;
        let mut world = taken(node, sets)?;
        let named = |map: &Path, why: &dyn std::fmt::Display| refused(format!("{}: {why}", map.display()));
        let map = match (world.map.take(), own) {
            (None, own) => own.map(|map| (path.clone(), map)),
            (Some(_), Some(_)) => return Err(named(&path, &"map: the world is a map itself")),
            (Some(file), None) => {
                let file = path.parent().unwrap_or(Path::new("")).join(file);
                let map = map_file::load(&file).map_err(|error| named(&path, &format!("map: {error}")))?;
                Some((file, map))
            }
        };
        let mut walls = None;
        if let Some((file, map)) = map {
            let outline = map_file::walls(&map).map_err(|error| named(&file, &error))?;
            let begin = world.start.point();
            if map.at(begin.x, begin.y) != Some(Cell::Free) {
                return Err(named(&file, &map_file::Refused::NotFree(begin)));
            }
            walls = Some(as_text(&outline));
            world.walls.extend(outline);
        }
        checked(world, &path).map(|world| Self { world, text, walls })
    }
}

/// Refuses the text of a world that names a file: one that comes over the bus must not choose what is read here.
/// `name` stands for its file in errors.
///
/// # Errors
/// It names a map, or is no TOML.
pub fn without_files(name: &Path, text: &str) -> Result<(), ConfigError> {
    let node = Node::parse(name, text).map_err(ConfigError)?;
    match &node.value {
        Value::Table(keys) if keys.contains_key("map") => Err(refused(format!(
            "{}: map: a world that is sent as text names no file; start it with --world",
            name.display()
        ))),
        _ => Ok(()),
    }
}

/// The world of a file that was read, and has no map; `path` is its name in errors.
pub fn parsed(node: Node, path: &Path, sets: &[String]) -> Result<World, ConfigError> {
    let world = taken(node, sets)?;
    match &world.map {
        None => checked(world, path),
        Some(map) => Err(refused(format!("{}: map = {:?}: a file that is not here", path.display(), map.display()))),
    }
}

/// The world of the texts of a [`Source`]; `path` is its name in errors.
///
/// # Errors
/// One line for each thing that is wrong.
pub fn recorded(node: Node, path: &Path, sets: &[String], walls: Option<Node>) -> Result<World, ConfigError> {
    let Some(walls) = walls else { return parsed(node, path, sets) };
    let (mut world, walls) = (taken(node, sets)?, read_as::<World>(&walls)?.walls);
    world.map = None;
    world.walls.extend(walls);
    checked(world, path)
}

fn refused(line: String) -> ConfigError {
    ConfigError(vec![line])
}

/// A world as its file and the overrides have it, its map aside.
fn taken(mut node: Node, sets: &[String]) -> Result<World, ConfigError> {
    for set in sets.iter().filter_map(|set| set.trim_start().strip_prefix(PREFIX)) {
        node.set(set).map_err(refused)?;
    }
    read_as(&node).map(World::with_surfaces)
}

fn checked(world: World, path: &Path) -> Result<World, ConfigError> {
    match world.check() {
        Ok(()) => Ok(world),
        Err(error) => Err(refused(format!("{}: {error}", path.display()))),
    }
}

/// Start in a map, as in a world's file, unless an override has one.
fn start(map: &Map, path: &Path, sets: &[String]) -> Result<String, ConfigError> {
    let is_start = |set: &String| {
        let key = set.trim_start().strip_prefix(PREFIX).and_then(|set| set.split_once('='));
        key.is_some_and(|(key, _)| key.trim() == "start")
    };
    if sets.iter().any(is_start) {
        return Ok("[0.0, 0.0, 0.0]".into());
    }
    let at = map_file::start(map).map_err(|error| refused(format!("{}: {error}", path.display())))?;
    Ok(format!("[{:?}, {:?}, 0.0]", at.x, at.y))
}

/// Walls as the text of a world; its start is not used.
fn as_text(walls: &[Segment]) -> String {
    let mut text = String::from("start = [0.0, 0.0, 0.0]\nwalls = [\n");
    for Segment { a, b } in walls {
        // Writing to a string does not fail.
        let _ = writeln!(text, "[{:?}, {:?}, {:?}, {:?}],", a.x, a.y, b.x, b.y);
    }
    text + "]\n"
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

/// The file of a name: a world, else a map.
fn named(dir: &Path, name: &Path) -> PathBuf {
    let folders = [dir, dir.parent().unwrap_or(dir)].map(|dir| dir.join("worlds"));
    let files = ["toml", "yaml", "yml"].map(|ending| name.with_extension(ending));
    let all = files.iter().flat_map(|file| folders.iter().map(move |folder| folder.join(file)));
    let found = all.into_iter().find(|file| file.exists());
    found.unwrap_or_else(|| folders[1].join(&files[0]))
}
