//! A map on disk: the YAML text and the PGM picture that it names, as nav2 has them.

use planner::map::{Map, pgm, yaml};
use std::path::Path;

/// Neither text nor picture is larger, bytes: 4096 × 4096 pixels of 16 bits, and a header.
const BYTES_MAX: u64 = (1 << 25) + 4096;

/// Reads the map whose YAML text is at `path`.
///
/// # Errors
/// One line: which file, where in it, and what is wrong.
pub fn load(path: &Path) -> Result<Map, String> {
    let text = String::from_utf8(bytes(path)?).map_err(|_| format!("{}: not UTF-8 text", path.display()))?;
    let info = yaml::read(&text).map_err(|error| format!("{}: {error}", path.display()))?;
    let picture = path.parent().unwrap_or(Path::new("")).join(&info.image);
    let pixels = pgm::read(&bytes(&picture)?).map_err(|error| format!("{}: {error}", picture.display()))?;
    info.map(&pixels).map_err(|error| format!("{}: {error}", path.display()))
}

fn bytes(path: &Path) -> Result<Vec<u8>, String> {
    let named = |error: std::io::Error| format!("{}: {error}", path.display());
    let length = std::fs::metadata(path).map_err(named)?.len();
    if length > BYTES_MAX {
        return Err(format!("{}: {length} bytes; a map has at most {BYTES_MAX}", path.display()));
    }
    std::fs::read(path).map_err(named)
}
