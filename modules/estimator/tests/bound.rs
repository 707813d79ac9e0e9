//! The quick form of benches/estimator.rs and benches/recordings.rs: few runs, loose limits. The figures are the
//! bench's.
#![allow(clippy::needless_range_loop, reason = "rows and columns of matrices are read best by their places")]

#[allow(dead_code, reason = "the bench uses all of it")]
#[path = "../../../benches/estimator/matrix.rs"]
mod matrix;
#[allow(dead_code, reason = "the bench uses all of it")]
#[path = "../../../benches/estimator/robots.rs"]
mod robots;
#[allow(dead_code, reason = "the bench uses all of it")]
#[path = "../../../benches/estimator/trial.rs"]
mod trial;
#[allow(dead_code, reason = "the bench uses all of it")]
#[path = "../../../benches/estimator/truth.rs"]
mod truth;

use trial::{Outcome, known, unknown};
use truth::Row;

const EVERYTHING: Row = Row { hidden: 0.5, wild: 0.1, late: 0.5, scale: 0.03, ..Row::EASY };

/// Means over some runs: error by bound, and the normalized squared error.
fn judge(row: &Row) -> (f64, f64) {
    let outcomes: Vec<Outcome> = (0..6).map(|seed| known(row, seed)).collect();
    let mean = |f: fn(&Outcome) -> f64| outcomes.iter().map(f).sum::<f64>() / outcomes.len() as f64;
    ((mean(|o| o.ours) / mean(|o| o.bound)).sqrt(), mean(|o| o.nees))
}

#[test]
fn the_error_is_about_what_is_possible_and_the_covariance_tells_it() {
    for row in [Row::EASY, EVERYTHING] {
        let (ratio, nees) = judge(&row);
        assert!((0.8..1.3).contains(&ratio) && (0.6..1.6).contains(&nees), "{}: {ratio} {nees}", row.name);
    }
}

#[test]
fn from_nothing_the_pose_is_found_and_never_a_wrong_one() {
    for seed in 0..10 {
        let sought = unknown(&Row { length: 20.0, turn: 0.03, ..Row::EASY }, seed);
        assert!(sought.found.is_some_and(|after| after < 5.0) && sought.wrong == 0.0, "seed {seed}: {sought:?}");
    }
}

#[test]
fn a_robot_that_is_carried_away_notices_and_finds_itself_again() {
    for seed in 0..10 {
        let row = Row { beacons: 6, length: 60.0, kidnapped: Some(40.0), ..Row::EASY };
        let sought = unknown(&row, 100 + seed);
        assert!(sought.noticed.is_some_and(|after| after <= 3.0), "seed {seed}: {sought:?}");
        assert!(sought.found.is_some_and(|after| after < 5.0) && sought.wrong == 0.0, "seed {seed}: {sought:?}");
    }
}

#[test]
fn a_robot_that_is_carried_away_while_it_stands_notices_too() {
    for row in [Row::EASY, Row { beacons: 6, ..Row::EASY }] {
        for seed in 0..20 {
            let row = Row { length: 60.0, kidnapped: Some(40.0), stands: 30.0, ..row };
            let sought = unknown(&row, 200 + seed);
            assert!(sought.noticed.is_some_and(|after| after <= 3.25), "seed {seed}: {sought:?}");
            assert!(sought.found.is_some_and(|after| after < 5.0) && sought.wrong == 0.0, "seed {seed}: {sought:?}");
        }
    }
}

/// A recording of each kind, of the bench's first seed.
#[test]
fn of_a_robot_of_which_nothing_is_known_a_wrong_pose_is_never_fine() {
    for kind in &robots::KINDS {
        let outcome = robots::outcome(kind, 0);
        let (nothing, everything) = (&outcome.nothing, &outcome.everything);
        assert_eq!(nothing.wrong_fine, 0.0, "{}: {outcome:?}", kind.name);
        assert!(nothing.fine > 0.5 && nothing.nees < 5.0, "{}: {outcome:?}", kind.name);
        assert!(nothing.square < 4.0 * everything.square, "{}: {outcome:?}", kind.name);
    }
}

#[test]
fn the_settings_of_an_unknown_robot_are_found() {
    let (scanner, seed) = (&robots::KINDS[2], 1);
    let (made, outcome) = (robots::make(scanner, seed), robots::outcome(scanner, seed));
    let config = &outcome.found.config;
    assert!((config.bearing / robots::SIGMA - 1.0).abs() < 0.5, "{config:?}");
    assert!((config.wild - 0.2).abs() < 0.08 && config.lasting > 0.2, "{config:?}");
    assert!((outcome.delay - made.delay).abs() < 0.1, "{}, not {}", outcome.delay, made.delay);
}
