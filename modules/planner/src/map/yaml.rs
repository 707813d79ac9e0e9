//! YAML text that describes a map's picture, as nav2's `map_server` reads and writes it.
//!
//! Not YAML in general: a flat list of `key: value` lines with comments, quotes, and lists in brackets or with dashes,
//! which is all that such files contain. Unknown keys are skipped, as in nav2; other lines are rejected. `mode` is
//! `trinary` (the default), `scale` or `raw`. Cells follow nav2's `map_io.cpp` and the static layer of its costmap with
//! default settings: a cell that is neither occupied (100) nor unknown (-1) is free.

use super::pgm::Picture;
use super::{Cell, Frame, FrameError, Map, RESOLUTION};
use std::fmt;

/// Conversion of grey values to cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Occupied, free, or unknown between the thresholds.
    #[default]
    Trinary,
    /// Occupied above its threshold; all other cells are free to some degree.
    Scale,
    /// The grey value, of 255, is the occupancy: 100 is occupied, above is unknown.
    Raw,
}

/// Content of the text.
#[derive(Clone, Debug, PartialEq)]
pub struct Info {
    /// File of the picture, relative to that of the text.
    pub image: String,
    /// Side of a pixel, m.
    pub resolution: f64,
    /// Lower left corner, m.
    pub origin: (f64, f64),
    /// True if white means occupied.
    pub negate: bool,
    /// Darkness, 0 to 1, above which cells are occupied.
    pub occupied_thresh: f64,
    /// Darkness below which cells are free.
    pub free_thresh: f64,
    /// Conversion of grey values to cells.
    pub mode: Mode,
}

/// Position and cause of a parse error.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct YamlError {
    /// Line, from 1; 0 if a key is missing.
    pub line: usize,
    /// Cause, and the expected value.
    pub why: String,
}

impl fmt::Display for YamlError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => write!(f, "{}", self.why),
            line => write!(f, "line {line}: {}", self.why),
        }
    }
}

impl std::error::Error for YamlError {}

/// Keys in the order of the standard example; all but the last are mandatory.
const KEYS: [&str; 7] = ["image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode"];
/// Maximum length of a text, bytes.
const TEXT_MAX: usize = 64 << 10;

/// Parses the text.
///
/// # Errors
/// A key is missing or duplicate, or its value is invalid; with the line.
pub fn read(text: &str) -> Result<Info, YamlError> {
    if text.len() > TEXT_MAX {
        return Err(YamlError { line: 0, why: format!("{} bytes: too long for a map's text", text.len()) });
    }
    let values = Values::read(text)?;
    let info = Info {
        image: values.text("image")?.into(),
        resolution: values.number("resolution", *RESOLUTION.start(), *RESOLUTION.end())?,
        origin: values.origin()?,
        negate: values.flag("negate")?,
        occupied_thresh: values.number("occupied_thresh", 0.0, 1.0)?,
        free_thresh: values.number("free_thresh", 0.0, 1.0)?,
        mode: values.mode()?,
    };
    if info.free_thresh > info.occupied_thresh {
        return Err(values.refuse("free_thresh", "is above occupied_thresh"));
    }
    Ok(info)
}

impl Info {
    /// Converts a picture to a map.
    ///
    /// # Errors
    /// The picture is too large, or its origin is too far away.
    pub fn map(&self, picture: &Picture) -> Result<Map, FrameError> {
        let (width, height) = (picture.width, picture.height);
        let frame = Frame { x: self.origin.0, y: self.origin.1, resolution: self.resolution, width, height };
        let mut map = Map::new(frame)?;
        for (row, pixels) in picture.grey.chunks_exact(width).rev().enumerate() {
            for (cell, grey) in map.cells[row * width..].iter_mut().zip(pixels) {
                *cell = self.cell(f64::from(*grey) / f64::from(picture.max));
            }
        }
        Ok(map)
    }

    /// Cell of a shade from 0 (black) to 1 (white).
    fn cell(&self, shade: f64) -> Cell {
        let occupancy = if self.negate { shade } else { 1.0 - shade };
        match self.mode {
            Mode::Raw => match libm::round(shade * 255.0) {
                100.0 => Cell::Occupied,
                above if above > 100.0 => Cell::Unknown,
                _ => Cell::Free,
            },
            _ if occupancy > self.occupied_thresh => Cell::Occupied,
            Mode::Trinary if occupancy >= self.free_thresh => Cell::Unknown,
            _ => Cell::Free,
        }
    }
}

/// Value and its line; lists are in brackets.
type Value = Option<(usize, String)>;

/// Key that the following lines belong to.
#[derive(Clone, Copy, PartialEq)]
enum Open {
    Nothing,
    List(usize),
    Foreign,
}

struct Values([Value; KEYS.len()]);

impl Values {
    fn read(text: &str) -> Result<Self, YamlError> {
        let mut values = Self(Default::default());
        // Key of the list whose items follow; an unknown key is skipped with all its lines.
        let mut open = Open::Nothing;
        for (number, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
            let number = number + 1;
            let refuse = |why: String| Err(YamlError { line: number, why });
            let content = uncommented(line).trim_end();
            let item = content.trim_start();
            if item.is_empty() || content == "---" || content == "..." {
                continue;
            }
            let foreign = open == Open::Foreign && (item.len() < content.len() || item.starts_with('-'));
            if foreign {
                continue;
            }
            if let Some(item) = item.strip_prefix("- ") {
                let Open::List(key) = open else { return refuse("a list item without a list".into()) };
                if let Some((_, list)) = values.0[key].as_mut() {
                    list.insert_str(list.len() - 1, if list.len() > 2 { "," } else { "" });
                    list.insert_str(list.len() - 1, item);
                }
                continue;
            }
            let Some((key, value)) = content.split_once(':') else {
                return refuse(format!("expected `key: value`, found {:?}", brief(content)));
            };
            let Some(index) = KEYS.iter().position(|known| *known == key) else {
                open = Open::Foreign;
                continue;
            };
            if values.0[index].is_some() {
                return refuse(format!("{key} occurs twice"));
            }
            let value = value.trim();
            open = if value.is_empty() { Open::List(index) } else { Open::Nothing };
            values.0[index] = Some((number, if value.is_empty() { "[]".into() } else { unquoted(value).into() }));
        }
        Ok(values)
    }

    fn get(&self, key: &str) -> Option<&(usize, String)> {
        KEYS.iter().position(|known| *known == key).and_then(|index| self.0[index].as_ref())
    }

    fn refuse(&self, key: &str, why: &str) -> YamlError {
        match self.get(key) {
            Some((line, value)) => YamlError { line: *line, why: format!("{key}: {:?} {why}", brief(value)) },
            None => YamlError { line: 0, why: format!("{key} is missing") },
        }
    }

    fn text(&self, key: &str) -> Result<&str, YamlError> {
        let value = self.get(key).map(|(_, value)| value.as_str());
        value
            .filter(|value| !value.is_empty() && !value.starts_with('['))
            .ok_or_else(|| self.refuse(key, "is not a text"))
    }

    fn number(&self, key: &str, low: f64, high: f64) -> Result<f64, YamlError> {
        let number = self.text(key)?.parse().ok().filter(|value| (low..=high).contains(value));
        number.ok_or_else(|| self.refuse(key, &format!("is not a number from {low} to {high}")))
    }

    fn flag(&self, key: &str) -> Result<bool, YamlError> {
        match self.text(key)? {
            "0" | "false" | "False" | "no" => Ok(false),
            "1" | "true" | "True" | "yes" => Ok(true),
            _ => Err(self.refuse(key, "is neither 0 nor 1")),
        }
    }

    fn mode(&self) -> Result<Mode, YamlError> {
        if self.get("mode").is_none() {
            return Ok(Mode::default());
        }
        match self.text("mode")? {
            "trinary" => Ok(Mode::Trinary),
            "scale" => Ok(Mode::Scale),
            "raw" => Ok(Mode::Raw),
            _ => Err(self.refuse("mode", "is not one of trinary, scale, raw")),
        }
    }

    fn origin(&self) -> Result<(f64, f64), YamlError> {
        let list = self.get("origin").map_or("", |(_, value)| value.as_str());
        let items = list.strip_prefix('[').and_then(|list| list.strip_suffix(']'));
        let numbers: Option<Vec<f64>> =
            items.and_then(|items| items.split(',').map(|item| item.trim().parse().ok()).collect());
        match numbers.as_deref() {
            Some([x, y, theta]) if [x, y, theta].iter().all(|value| value.is_finite()) => match theta {
                0.0 => Ok((*x, *y)),
                _ => Err(self.refuse("origin", "is turned: only maps with theta 0 are read")),
            },
            _ => Err(self.refuse("origin", "is not a list of three numbers: x, y, theta")),
        }
    }
}

/// Removes the comment from a line; a `#` within quotes or within a word does not begin one.
fn uncommented(line: &str) -> &str {
    let (mut quote, mut before) = (None, ' ');
    for (at, letter) in line.char_indices() {
        match (letter, quote) {
            ('#', None) if before.is_whitespace() => return &line[..at],
            ('\'' | '"', None) => quote = Some(letter),
            (letter, Some(open)) if letter == open => quote = None,
            _ => {}
        }
        before = letter;
    }
    line
}

fn unquoted(value: &str) -> &str {
    let within = |quote| value.strip_prefix(quote).and_then(|value: &str| value.strip_suffix(quote));
    within('"').or_else(|| within('\'')).unwrap_or(value)
}

/// Beginning of a text, short enough for an error message.
fn brief(text: &str) -> String {
    text.chars().take(40).collect()
}
