//! The folder `drives` beside `robot.toml`: a table of a drive in each file.

pub use drivers::canbus::tables::DriveTables;

use drivers::canbus::tables::{BYTES_MAX, FOLDER};
use settings::{ConfigError, Node};
use std::fs::{self, File};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

/// The built-in tables, and those of the folder of a configuration.
///
/// # Errors
/// A line for each thing that is wrong in a file.
pub fn read(dir: &Path) -> Result<DriveTables, ConfigError> {
    let mut problems = Vec::new();
    let mut tables = DriveTables::default();
    for path in files(dir)? {
        let added = text(&path).and_then(|text| tables.add(&name(&path), &path, &text));
        problems.extend(added.err().unwrap_or_default());
    }
    if problems.is_empty() { Ok(tables) } else { Err(ConfigError(problems)) }
}

/// The tables of a recording: names and texts of its files.
///
/// # Errors
/// A line for each thing that is wrong in a file.
pub fn recorded(texts: &[(String, String)]) -> Result<DriveTables, ConfigError> {
    let mut tables = DriveTables::default();
    for (path, text) in texts.iter().map(|(path, text)| (Path::new(path), text)).filter(|(path, _)| is_table(path)) {
        tables.add(&name(path), path, text).map_err(ConfigError)?;
    }
    Ok(tables)
}

/// Name and text of each file, for a recording.
///
/// # Errors
/// A file cannot be read.
pub(crate) fn texts(dir: &Path) -> Result<Vec<(String, String)>, ConfigError> {
    let entry = |path: PathBuf| {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        Ok((format!("{FOLDER}/{file}"), text(&path).map_err(ConfigError)?))
    };
    files(dir)?.into_iter().map(entry).collect()
}

/// File and line where a table of the folder names this data sheet, by its path from `robot.toml` on.
pub(crate) fn line_of_sheet(dir: &Path, sheet: &Path) -> Option<String> {
    files(dir).ok()?.into_iter().find_map(|path| {
        let eds = Node::parse(&path, &text(&path).ok()?).ok()?.below("eds").cloned()?;
        let settings::Value::String(own) = &eds.value else { return None };
        (Path::new(FOLDER).join(own) == sheet).then(|| eds.origin.to_string())
    })
}

fn is_table(path: &Path) -> bool {
    path.starts_with(FOLDER) && path.extension().is_some_and(|ending| ending == "toml")
}

fn name(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The files of the folder, by name; none where there is no folder. Something else of this name is an error: a table of
/// the user's would silently be the built-in one.
fn files(dir: &Path) -> Result<Vec<PathBuf>, ConfigError> {
    let folder = dir.join(FOLDER);
    if !dir.is_dir() || fs::symlink_metadata(&folder).is_err_and(|error| error.kind() == ErrorKind::NotFound) {
        return Ok(Vec::new());
    }
    let error = |error: std::io::Error| ConfigError(vec![format!("{}: {error}", folder.display())]);
    let mut files = Vec::new();
    for entry in fs::read_dir(&folder).map_err(error)? {
        let path = entry.map_err(error)?.path();
        if path.extension().is_some_and(|ending| ending == "toml") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// The text of a file, of one byte more than is accepted at most.
fn text(path: &Path) -> Result<String, Vec<String>> {
    let error = |error: std::io::Error| vec![format!("{}: {error}", path.display())];
    let mut text = String::new();
    if !path.is_file() {
        return Err(vec![format!("{}: expected a file", path.display())]);
    }
    File::open(path).map_err(error)?.take(BYTES_MAX as u64 + 1).read_to_string(&mut text).map_err(error)?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_in_place_of_the_folder_is_refused() {
        let dir = std::env::temp_dir().join(format!("advee-drives-{}", std::process::id()));
        fs::create_dir_all(&dir).unwrap();
        assert!(read(&dir).is_ok());
        fs::write(dir.join(FOLDER), "").unwrap();
        let ConfigError(lines) = read(&dir).unwrap_err();
        fs::remove_dir_all(&dir).unwrap();
        assert_eq!(lines.len(), 1);
        assert!(lines[0].starts_with(&dir.join(FOLDER).display().to_string()), "{lines:?}");
    }
}
