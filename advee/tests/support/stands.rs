//! Figures of the column "stands after" in the table "What stops the robot" of ARCHITECTURE.md.

use std::path::Path;

/// Figures of a unit, "m" or "s", in the row of an event, in their order.
#[track_caller]
pub fn figures(event: &str, unit: &str) -> Vec<f64> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../ARCHITECTURE.md");
    let text = std::fs::read_to_string(path).expect("ARCHITECTURE.md");
    let mut rows = text.lines().filter(|line| line.trim_start_matches("| ").starts_with(event));
    let (Some(row), None) = (rows.next(), rows.next()) else { panic!("not the beginning of one row: {event}") };
    let cell = row.trim_end_matches(['|', ' ']).rsplit('|').next().unwrap_or_default();
    let words: Vec<&str> = cell.split_whitespace().collect();
    let is_unit = |word: &str| word.trim_end_matches([',', ';', '.']) == unit;
    words.windows(2).filter(|pair| is_unit(pair[1])).filter_map(|pair| pair[0].parse().ok()).collect()
}
