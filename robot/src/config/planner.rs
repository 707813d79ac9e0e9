//! `[planner]`: what stands where the robot drives, and its manners.

use settings::Table;
use std::path::PathBuf;

/// `[planner]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Planner {
    /// A map of walls in YAML and PGM, as nav2 has them, from the configuration folder on; none: an open floor, in
    /// simulation the world's walls.
    pub map: Option<PathBuf>,
    /// Backwards, 0.01..=2 m/s; default 0.3.
    pub speed_reverse_mps: f64,
    /// Through space that was not seen within the last second, 0.01..=2 m/s; default 0.4.
    pub speed_unseen_mps: f64,
    /// Kept free beside the robot of what is sensed, 0.01..=1 m; default 0.2: sonars hear legs, and people are wider.
    pub margin_m: f64,
    /// Kept free before it, 0.05..=2 m, beyond the margin; default 0.25.
    pub stop_distance_m: f64,
    /// From a thing's appearance to the brakes, 0.05..=2 s; default 0.37.
    pub reaction_s: f64,
    /// Of the robot rolling out without its motors, 0.05..=20 m/s²; default 0.25.
    pub coasting_mps2: f64,
    /// So long it waits for who stands in the way before it looks for a way around, 0.5..=600 s; default 3.
    pub patience_s: f64,
    /// So often it tries to get free before a goal that is no loop has failed, 1..=1000; default 8.
    pub attempts: u32,
}

impl Default for Planner {
    fn default() -> Self {
        let planner::Manners {
            speed_reverse,
            speed_unseen,
            margin,
            stop_distance,
            reaction,
            coasting,
            patience,
            attempts,
        } = planner::Manners::default();
        Self {
            map: None,
            speed_reverse_mps: speed_reverse,
            speed_unseen_mps: speed_unseen,
            margin_m: margin,
            stop_distance_m: stop_distance,
            reaction_s: reaction,
            coasting_mps2: coasting,
            patience_s: patience,
            attempts,
        }
    }
}

impl Planner {
    pub(super) fn read(mut table: Table<'_>) -> Self {
        let usual = Self::default();
        let planner = Self {
            map: table.has("map").then(|| table.text("map", None).into()),
            speed_reverse_mps: table.number("speed_reverse_mps", Some(usual.speed_reverse_mps), 0.01..=2.0),
            speed_unseen_mps: table.number("speed_unseen_mps", Some(usual.speed_unseen_mps), 0.01..=2.0),
            margin_m: table.number("margin_m", Some(usual.margin_m), 0.01..=1.0),
            stop_distance_m: table.number("stop_distance_m", Some(usual.stop_distance_m), 0.05..=2.0),
            reaction_s: table.number("reaction_s", Some(usual.reaction_s), 0.05..=2.0),
            coasting_mps2: table.number("coasting_mps2", Some(usual.coasting_mps2), 0.05..=20.0),
            patience_s: table.number("patience_s", Some(usual.patience_s), 0.5..=600.0),
            attempts: table.integer("attempts", Some(usual.attempts), 1..=1000),
        };
        table.end();
        planner
    }

    /// The planner's own words for it.
    #[must_use]
    pub fn manners(&self) -> planner::Manners {
        planner::Manners {
            speed_reverse: self.speed_reverse_mps,
            speed_unseen: self.speed_unseen_mps,
            margin: self.margin_m,
            stop_distance: self.stop_distance_m,
            reaction: self.reaction_s,
            coasting: self.coasting_mps2,
            patience: self.patience_s,
            attempts: self.attempts,
        }
    }
}
