//! Input that is not finite, or huge: no panic, nothing that is not finite, standing still.

use super::*;
use navitools::Pose;

const BAD: [f64; 8] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN, 1e300, -1e17, 1.000_001e6];
const ODD: [f64; 6] = [0.0, -0.0, f64::MIN_POSITIVE, 5e-324, 1e6, -1e-300];

fn number(random: &mut Random) -> f64 {
    match random.below(4) {
        0 => BAD[random.index(BAD.len())],
        1 => ODD[random.index(ODD.len())],
        2 => f64::from_bits(random.next()),
        _ => 3.0 * unit(random),
    }
}

fn finite(twist: Twist) -> bool {
    twist.vx.is_finite() && twist.vy.is_finite() && twist.omega.is_finite()
}

#[test]
fn commands_that_are_not_finite_are_standing_still() {
    for (name, base) in bases() {
        let moving = base.wheel_states(base.feasible(Twist::new(0.5, 0.0, 0.1)).twist, &[]);
        for bad in BAD {
            for twist in [Twist::new(bad, 0.0, 0.0), Twist::new(0.1, bad, 0.0), Twist::new(0.1, 0.0, bad)] {
                let feasible = base.feasible(twist);
                assert_eq!(
                    (feasible.twist, feasible.refused.as_slice()),
                    (Twist::ZERO, [Refusal::NotFinite].as_slice())
                );
                assert_eq!(base.within_speed(twist), Twist::ZERO, "{name}");
                assert!(base.wheel_states(twist, &moving).iter().all(|state| state.speed_mps == 0.0), "{name}");
                // It brakes like for a command to stand.
                assert_eq!(base.step(twist, &moving, 0.02), base.step(Twist::ZERO, &moving, 0.02), "{name}");
            }
        }
        for dt in [0.0, -1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(base.step(Twist::ZERO, &moving, dt), moving, "{name}: no time, no change");
        }
    }
}

#[test]
fn nothing_panics_and_nothing_is_other_than_finite() {
    for (name, base) in bases() {
        let mut random = Random::new(13);
        for _ in 0..5000 {
            let mut number = || number(&mut random);
            let twist = Twist::new(number(), number(), number());
            let count = base.wheels().len() + 1;
            let mut states: Vec<WheelState> =
                (0..count).map(|_| WheelState { speed_mps: number(), steering_rad: number() }).collect();
            let dt = number();
            states.truncate(random.index(count + 4).max(1));
            let feasible = base.feasible(twist);
            assert!(finite(feasible.twist), "{name}: {twist:?} {feasible:?}");
            let mut all = base.wheel_states(twist, &states).to_vec();
            all.extend(base.wheel_states(feasible.twist, &states));
            all.extend(base.step(twist, &states, dt));
            all.extend(base.step(feasible.twist, &states, dt));
            assert!(
                all.iter().all(|state| state.speed_mps.is_finite() && state.steering_rad.is_finite()),
                "{name}: {twist:?} {states:?} {dt}: {all:?}"
            );
            if let Some(estimate) = base.estimate(&states) {
                let residuals = estimate.residuals_mps.iter().chain([&estimate.residual_mps]);
                assert!(finite(estimate.twist) && residuals.into_iter().all(|residual| residual.is_finite()), "{name}");
            }
            let _ = base.agreement(&states, 0.01);
            let pose = integrate(Pose::new(1.0, 2.0, 3.0), twist, dt);
            assert!(pose.x.is_finite() && pose.y.is_finite() && pose.theta.radians().is_finite(), "{twist:?} {dt}");
        }
    }
}

#[test]
fn a_measurement_that_is_not_finite_is_not_known_rather_than_standing_still() {
    for (name, base) in bases() {
        let good = base.wheel_states(base.feasible(Twist::new(0.5, 0.0, 0.1)).twist, &[]);
        for (index, wheel) in base.wheels().iter().enumerate() {
            for bad in BAD {
                let mut states = good.clone();
                states[index].speed_mps = bad;
                assert_eq!(base.estimate(&states).is_none(), wheel.measured, "{name}: wheel {index} {bad}");
            }
            let mut states = good.clone();
            states[index].steering_rad = f64::NAN;
            assert_eq!(base.estimate(&states).is_none(), wheel.steering().is_some(), "{name}: wheel {index}");
        }
        assert_eq!(base.estimate(&good[1..]), None, "{name}: a wheel is missing");
    }
}

#[test]
fn any_numbers_in_a_description_are_refused_or_work() {
    let mut random = Random::new(14);
    let mut accepted = 0;
    for _ in 0..20_000 {
        let count = 1 + random.index(4);
        let some = |random: &mut Random| if random.one_in(12) { number(random) } else { unit(random) };
        let mut any = |_| {
            let random = &mut random;
            let kind = match random.below(4) {
                0 => Kind::Fixed,
                1 => Kind::Skid,
                2 => Kind::Rollers { angle_rad: some(random) },
                _ => Kind::Steered(Steering {
                    min_rad: -libm::fabs(some(random)),
                    max_rad: some(random),
                    rate_radps: 1.0,
                }),
            };
            let direction_rad = if random.one_in(2) { 0.0 } else { some(random) };
            let x_m = if random.one_in(2) { 0.0 } else { some(random) };
            let (driven, measured) = (!random.one_in(4), !random.one_in(4));
            Wheel { x_m, y_m: some(random), direction_rad, kind, driven, measured, limits: LIMITS }
        };
        let wheels: Vec<Wheel> = (0..count).map(&mut any).collect();
        let Ok(base) = Chassis::new(&wheels) else { continue };
        accepted += 1;
        let twist = base.feasible(Twist::new(0.3, 0.2, 0.4)).twist;
        let states = base.step(twist, &base.standing(), 0.1);
        assert!(states.iter().all(|state| state.speed_mps.is_finite()), "{wheels:?}");
    }
    assert!(accepted > 500, "{accepted}");
}
