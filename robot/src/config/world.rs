//! A world for the simulated robot; its keys stand in `conf/worlds/README.md`.

use settings::{ConfigError, Node, read, read_as};
use simulator::world::World;
use std::path::{Path, PathBuf};

/// What begins a `--set` that is of the world.
const PREFIX: &str = "world.";

/// Where a world that is missing may be: a copy of a configuration folder has none beside it.
const WHERE: &str = "a world is a file that --world names, or in the folder worlds in or beside the configuration";

/// Reads the world of a file, or of a name in the folder `worlds` in or beside the configuration `dir`; without either
/// the hall. Those of the overrides `sets` that begin with `world.` are laid over it.
pub fn world(dir: &Path, file: Option<&Path>, sets: &[String]) -> Result<World, ConfigError> {
    let path = place(dir, file);
    let node = read(&path).map_err(|error| match path.exists() {
        true => error,
        false => ConfigError(error.0.into_iter().map(|line| format!("{line}; {WHERE}")).collect()),
    })?;
    parsed(node, &path, sets)
}

/// The same of a file that was read; `path` is its name in errors.
pub fn parsed(mut node: Node, path: &Path, sets: &[String]) -> Result<World, ConfigError> {
    for set in sets.iter().filter_map(|set| set.trim_start().strip_prefix(PREFIX)) {
        node.set(set).map_err(|line| ConfigError(vec![line]))?;
    }
    read_as(&node).map(World::with_surfaces).and_then(|world| match world.check() {
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
