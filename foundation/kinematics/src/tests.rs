//! Tests of all kinds of bases through the public functions.

mod commands;
mod formulas;
mod measured;
mod refused;
mod unusable;

use crate::*;
use core::f64::consts::{FRAC_PI_2, PI};
use std::string::{String, ToString};
use std::vec::Vec;
use std::{format, vec};
use testing::Random;

const LIMITS: Limits = Limits { speed_mps: 1.2, acceleration_mps2: 0.8, deceleration_mps2: 1.1 };
const STEERING: Steering = Steering { min_rad: -0.61, max_rad: 0.61, rate_radps: 0.7 };
const ACROSS: Steering = Steering { min_rad: -1.7, max_rad: 1.7, rate_radps: 1.5 };

fn steered(end: End, driven: Driven, steering: Steering) -> SteeredBase {
    SteeredBase { wheelbase_m: 0.6, end, driven, steering, limits: LIMITS }
}

/// A wheel that is driven and measured.
fn wheel(x_m: f64, y_m: f64, direction_rad: f64, kind: Kind) -> Wheel {
    Wheel { x_m, y_m, direction_rad, kind, driven: true, measured: true, limits: LIMITS }
}

/// The same base with all wheels measured.
fn all_measured(chassis: &Chassis) -> Chassis {
    let wheels: PerWheel<Wheel> = chassis.wheels().iter().map(|wheel| Wheel { measured: true, ..*wheel }).collect();
    Chassis::new(&wheels).unwrap()
}

/// Every kind, with each place of the driven and the steered wheels, and bases without a name.
fn bases() -> Vec<(String, Chassis)> {
    let mut all = vec![
        ("differential".into(), Chassis::differential(0.42, LIMITS)),
        ("skid-steer".into(), Chassis::skid_steer(0.8, &[0.3, -0.3], LIMITS)),
        ("six wheels".into(), Chassis::skid_steer(0.9, &[0.5, 0.0, -0.4], LIMITS)),
        ("mecanum".into(), Chassis::mecanum(0.5, 0.4, LIMITS)),
    ];
    for count in 3..=WHEELS_MAX {
        all.push((format!("omni {count}"), Chassis::omni(0.25, count, 0.3, LIMITS)));
    }
    for end in [End::Front, End::Rear] {
        for driven in [Driven::Fixed, Driven::Steered, Driven::All] {
            let base = steered(end, driven, STEERING);
            all.push((format!("bicycle {end:?} {driven:?}"), Chassis::bicycle(&base)));
            all.push((format!("tricycle {end:?} {driven:?}"), Chassis::tricycle(&base, 0.5)));
            all.push((format!("ackermann {end:?} {driven:?}"), Chassis::ackermann(&base, 0.5)));
        }
        all.push((format!("across {end:?}"), Chassis::tricycle(&steered(end, Driven::Steered, ACROSS), 0.5)));
    }
    let half_turns = Kind::Steered(Steering { min_rad: -PI, max_rad: PI, rate_radps: 3.0 });
    let corners = [(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)];
    all.push(("four steered".into(), Chassis::new(&corners.map(|(x, y)| wheel(x, y, 0.0, half_turns)))));
    let narrow = corners.map(|(x, y)| wheel(x, y, 0.0, Kind::Steered(STEERING)));
    all.push(("four steered, narrow".into(), Chassis::new(&narrow)));
    // Origin beside the axle, which is not across x; one wheel is mounted the other way round.
    let askew = [wheel(0.3, 0.5, 0.4, Kind::Fixed), {
        let (sin, cos) = libm::sincos(0.4);
        wheel(0.3 + 0.6 * sin, 0.5 - 0.6 * cos, 0.4 - PI, Kind::Fixed)
    }];
    all.push(("askew".into(), Chassis::new(&askew)));
    all.into_iter().map(|(name, base)| (name.clone(), base.unwrap_or_else(|error| panic!("{name}: {error}")))).collect()
}

/// Number in -1 to 1.
fn unit(random: &mut Random) -> f64 {
    random.below(1 << 32) as f64 / f64::from(1u32 << 31) - 1.0
}

fn any_twist(random: &mut Random) -> Twist {
    let mut component = |most: f64| if random.one_in(6) { 0.0 } else { most * unit(random) };
    Twist::new(component(1.5), component(1.5), component(3.0))
}

fn speeds(states: &[WheelState]) -> Vec<f64> {
    states.iter().map(|state| state.speed_mps).collect()
}

fn near(a: f64, b: f64, tolerance: f64) -> bool {
    libm::fabs(a - b) <= tolerance
}

fn equal(a: Twist, b: Twist, tolerance: f64) -> bool {
    near(a.vx, b.vx, tolerance) && near(a.vy, b.vy, tolerance) && near(a.omega, b.omega, tolerance)
}

/// States of the wheels at measured speeds, for bases without steering.
fn rolling(speeds: &[f64]) -> Vec<WheelState> {
    speeds.iter().map(|speed_mps| WheelState { speed_mps: *speed_mps, steering_rad: 0.0 }).collect()
}
