//! `[estimator]`: how well the robot measures; defaults are those of [`estimator::filter::Config`].

use estimator::filter::Config;
use navitools::Point;
use settings::Table;

/// Reads the table into what the filter is told; the map of beacons is not in it.
pub(super) fn read(mut table: Table<'_>) -> Config {
    let usual = Config::default();
    let mut number = |key, default: f64, range| table.number(key, Some(default), range);
    let config = Config {
        beacons: Vec::new(),
        mount: Point {
            x: number("sensor_x_m", usual.mount.x, -10.0..=10.0),
            y: number("sensor_y_m", usual.mount.y, -10.0..=10.0),
        },
        odometry: estimator::filter::Noise {
            along_per_m: number("odometry_along_per_m", usual.odometry.along_per_m, 0.0..=1.0),
            along_per_s: number("odometry_along_per_s", usual.odometry.along_per_s, 0.0..=1.0),
            turn_per_m: number("odometry_turn_per_m", usual.odometry.turn_per_m, 0.0..=1.0),
            turn_per_s: number("odometry_turn_per_s", usual.odometry.turn_per_s, 0.0..=1.0),
        },
        bearing: number("bearing_rad", usual.bearing, 1e-5..=0.5),
        lasting: number("bearing_lasting", usual.lasting, 0.0..=0.99),
        lasting_s: number("bearing_lasting_s", usual.lasting_s, 0.01..=100.0),
        wild: number("bearing_wild", usual.wild, 1e-4..=0.5),
        gate: number("gate", usual.gate, 4.0..=100.0),
        range: number("range_m", usual.range, 0.5..=1000.0),
        turn: number("sensor_turn_rad", usual.turn, 0.0..=1.0),
        scale: number("scale", usual.scale, 0.0..=0.5),
        bend: number("bend_radpm", usual.bend, 0.0..=1.0),
        track: number("track", usual.track, 0.0..=0.5),
        delay: number("delay_s", usual.delay, 0.0..=1.0),
        fine: (number("fine_m", usual.fine.0, 0.001..=10.0), number("fine_rad", usual.fine.1, 0.001..=3.0)),
        coarse: (number("coarse_m", usual.coarse.0, 0.001..=100.0), number("coarse_rad", usual.coarse.1, 0.001..=3.0)),
    };
    table.end();
    config
}
