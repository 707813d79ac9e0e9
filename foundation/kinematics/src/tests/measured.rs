//! From wheels to the velocity and back, and wheels that lie.

use super::*;
use Agreement::{Agree, Swapped, Unnamed, Wheel as Liar};

#[test]
fn body_to_wheels_to_body_is_the_identity() {
    for (name, base) in bases() {
        let mut random = Random::new(6);
        let mut states = base.standing();
        for _ in 0..2000 {
            let twist = base.feasible(any_twist(&mut random)).twist;
            // A wheel about which the base turns keeps its angle: the states go on from one to the next.
            states = base.wheel_states(twist, &states);
            let estimate = base.estimate(&states).unwrap();
            assert!(equal(estimate.twist, twist, 1e-9), "{name}: {twist:?} {states:?} {estimate:?}");
            assert!(estimate.residual_mps < 1e-9, "{name}: {twist:?} {states:?} {estimate:?}");
            assert_eq!(base.agreement(&states, 1e-9), Some(Agree), "{name}");
        }
    }
}

/// Below half of what the slowest wheel in [`TURN`] lies by.
const TOLERANCE_MPS: f64 = 0.002;

/// How wheels lie.
const LIES: [fn(f64) -> f64; 3] = [|_| 0.0, |speed| -speed, |speed| 0.5 * speed];

/// Judgements of one lie of each wheel, in turns in which its speed differs from that of all others.
fn judged(base: &Chassis, twist: Twist, lie: fn(f64) -> f64) -> Vec<Agreement> {
    let states = base.wheel_states(base.feasible(twist).twist, &[]);
    assert_eq!(base.agreement(&states, TOLERANCE_MPS), Some(Agree));
    let measured = |index: &usize| base.wheels()[*index].measured;
    let judge = |index: usize| {
        let mut lying = states.clone();
        lying[index].speed_mps = lie(lying[index].speed_mps);
        base.agreement(&lying, TOLERANCE_MPS).unwrap()
    };
    (0..states.len()).filter(measured).map(judge).collect()
}

#[test]
fn a_description_in_a_turned_frame_has_the_same_wheels() {
    for (name, base) in bases() {
        let mut random = Random::new(15);
        let (sin, cos) = libm::sincos(0.7);
        let turned: PerWheel<Wheel> = base
            .wheels()
            .iter()
            .map(|wheel| Wheel {
                x_m: cos * wheel.x_m - sin * wheel.y_m,
                y_m: sin * wheel.x_m + cos * wheel.y_m,
                direction_rad: wheel.direction_rad + 0.7,
                ..*wheel
            })
            .collect();
        let turned = Chassis::new(&turned).unwrap();
        for _ in 0..200 {
            let twist = base.feasible(any_twist(&mut random)).twist;
            let in_turned = Twist::new(cos * twist.vx - sin * twist.vy, sin * twist.vx + cos * twist.vy, twist.omega);
            let states = base.wheel_states(twist, &[]);
            let estimate = turned.estimate(&states).unwrap();
            assert!(equal(estimate.twist, in_turned, 1e-9) && estimate.residual_mps < 1e-9, "{name}: {estimate:?}");
            for (one, other) in speeds(&states).iter().zip(speeds(&turned.wheel_states(in_turned, &states))) {
                assert!(near(*one, other, 1e-9), "{name}: {twist:?}");
            }
        }
    }
}

/// Three wheels on the left, one on the right.
fn one_against_three() -> Chassis {
    let places = [(0.3, 0.4), (0.0, 0.4), (-0.3, 0.4), (0.0, -0.4)];
    Chassis::new(&places.map(|(x, y)| wheel(x, y, 0.0, Kind::Skid))).unwrap()
}

const TURN: Twist = Twist::new(0.6, 0.25, 0.5);

#[test]
fn a_wheel_that_lies_is_named_where_the_geometry_can_tell() {
    for (name, base, redundancy) in [
        ("six wheels", Chassis::skid_steer(0.9, &[0.5, 0.0, -0.4], LIMITS).unwrap(), 4),
        ("omni 5", Chassis::omni(0.25, 5, 0.3, LIMITS).unwrap(), 2),
        ("one against three", one_against_three(), 2),
        ("ackermann", Chassis::ackermann(&steered(End::Front, Driven::All, STEERING), 0.5).unwrap(), 4),
    ] {
        assert_eq!(base.redundancy(), redundancy, "{name}");
        for lie in LIES {
            let named: Vec<Agreement> = (0..base.wheels().len()).map(Liar).collect();
            let judged = judged(&base, TURN, lie);
            // Nothing checks the one wheel of its side.
            let checked = if name == "one against three" { 3 } else { named.len() };
            assert_eq!(judged[..checked], named[..checked], "{name}");
            assert!(judged[checked..].iter().all(|judgement| *judgement == Agree), "{name}");
        }
    }
}

#[test]
fn of_a_tricycle_the_steered_wheel_is_named() {
    // Both rear wheels against it. With one rear wheel against the other, speed and angle of the steered wheel may be
    // right, which names the other one, or both be wrong.
    let base = Chassis::tricycle(&steered(End::Front, Driven::All, STEERING), 0.5).unwrap();
    assert_eq!(base.redundancy(), 2);
    for lie in LIES {
        assert_eq!(judged(&base, TURN, lie), [Unnamed, Unnamed, Liar(2)]);
    }
}

#[test]
fn two_wheels_cannot_contradict_each_other() {
    let base = Chassis::differential(0.42, LIMITS).unwrap();
    assert_eq!(base.redundancy(), 0);
    let mut random = Random::new(7);
    for _ in 0..1000 {
        let any = rolling(&[unit(&mut random), unit(&mut random)]);
        let estimate = base.estimate(&any).unwrap();
        assert!(estimate.residual_mps < 1e-15, "{estimate:?}");
    }
    for lie in LIES {
        assert_eq!(judged(&base, TURN, lie), [Agree, Agree]);
    }
    // Nor can three omni wheels, nor the two driven wheels of a tricycle that is not measured in front.
    assert_eq!(Chassis::omni(0.25, 3, 0.3, LIMITS).unwrap().redundancy(), 0);
    assert_eq!(Chassis::bicycle(&steered(End::Front, Driven::Fixed, STEERING)).unwrap().redundancy(), 0);
}

#[test]
fn with_one_equation_too_many_a_lie_is_noticed_but_not_named() {
    let mecanum = Chassis::mecanum(0.5, 0.4, LIMITS).unwrap();
    let omni = Chassis::omni(0.25, 4, 0.3, LIMITS).unwrap();
    // Without its angle's equation a bicycle with two encoders has nothing left to compare: either may be wrong.
    let bicycle = Chassis::bicycle(&steered(End::Front, Driven::All, STEERING)).unwrap();
    for base in [mecanum, omni, bicycle] {
        assert_eq!(base.redundancy(), 1);
        for lie in LIES {
            assert_eq!(judged(&base, TURN, lie), vec![Unnamed; base.wheels().len()]);
        }
    }
    // The one contradiction of four mecanum wheels distributes itself evenly among them.
    let base = Chassis::mecanum(0.5, 0.4, LIMITS).unwrap();
    let estimate = base.estimate(&rolling(&[0.0, 0.4, 0.4, 0.4])).unwrap();
    assert!(estimate.residuals_mps.iter().all(|residual| near(*residual, 0.1, 1e-12)), "{estimate:?}");
    assert!(near(estimate.residual_mps, 0.1, 1e-12));
}

#[test]
fn of_a_pair_on_one_side_the_geometry_cannot_tell_which() {
    // Both wheels of a side have the same equation; of three, two outvote the third (above).
    let base = Chassis::skid_steer(0.8, &[0.3, -0.3], LIMITS).unwrap();
    for lie in LIES {
        assert_eq!(judged(&base, TURN, lie), [Unnamed; 4]);
    }
    let estimate = base.estimate(&rolling(&[0.0, 0.4, 0.4, 0.4])).unwrap();
    let side: Vec<bool> = estimate.residuals_mps.iter().map(|residual| *residual > 0.1).collect();
    assert_eq!(side, [true, false, true, false], "the residual names the side");
}

#[test]
fn swapped_encoders_are_named_in_a_turn() {
    let ackermann = Chassis::ackermann(&steered(End::Front, Driven::All, STEERING), 0.5).unwrap();
    let omni = Chassis::omni(0.25, 6, 0.3, LIMITS).unwrap();
    for base in [ackermann, omni] {
        let twist = base.feasible(TURN).twist;
        let states = base.wheel_states(twist, &[]);
        let mut swapped = states.clone();
        (swapped[0].speed_mps, swapped[1].speed_mps) = (states[1].speed_mps, states[0].speed_mps);
        assert_eq!(base.agreement(&swapped, 0.01), Some(Swapped(0, 1)), "{swapped:?}");
    }
    // Straight ahead they measure the same; two wheels of one side always do.
    let base = Chassis::skid_steer(0.8, &[0.3, -0.3], LIMITS).unwrap();
    let states = base.wheel_states(Twist::new(0.5, 0.0, 0.0), &[]);
    assert!(states.iter().all(|state| *state == states[0]));
    // The encoders of a differential base, exchanged, measure a turn to the other side; no residual can show it.
    let base = Chassis::differential(0.42, LIMITS).unwrap();
    let twist = base.estimate(&rolling(&[0.7, 0.3])).unwrap().twist;
    assert!(equal(twist, Twist::new(0.5, 0.0, -0.4 / 0.42), 1e-12));
}

#[test]
fn a_steering_angle_that_lies_is_named_with_its_wheel() {
    let base = Chassis::ackermann(&steered(End::Front, Driven::All, STEERING), 0.5).unwrap();
    let mut states = base.wheel_states(Twist::new(0.8, 0.0, 0.4), &[]);
    states[3].steering_rad += 0.1;
    assert_eq!(base.agreement(&states, 0.01), Some(Liar(3)));
}

#[test]
fn what_is_not_measured_is_not_used() {
    let base = Chassis::tricycle(&steered(End::Front, Driven::Steered, STEERING), 0.5).unwrap();
    let mut states = base.wheel_states(Twist::new(0.8, 0.0, 0.4), &[]);
    states[0].speed_mps = f64::NAN;
    states[1].speed_mps = 1e9;
    assert!(equal(base.estimate(&states).unwrap().twist, Twist::new(0.8, 0.0, 0.4), 1e-12));
    assert_eq!(all_measured(&base).estimate(&states), None);
}

#[test]
fn noise_of_the_encoders_is_averaged() {
    let base = Chassis::omni(0.25, 8, 0.0, LIMITS).unwrap();
    let mut random = Random::new(8);
    let mut sum = 0.0;
    for _ in 0..2000 {
        let mut states = base.wheel_states(TURN, &[]);
        states.iter_mut().for_each(|state| state.speed_mps += 0.02 * unit(&mut random));
        let estimate = base.estimate(&states).unwrap();
        assert!(estimate.residual_mps < 0.02);
        sum += (estimate.twist.vx - TURN.vx) * (estimate.twist.vx - TURN.vx);
    }
    // Uniform noise has a deviation of 0.02 / √3 m/s; of vx remains √(2/8) of it.
    assert!(near(libm::sqrt(sum / 2000.0), 0.02 / libm::sqrt(3.0) / 2.0, 3e-4));
}

/// Forces at the wheels of a base with equal motors that are to move it: of a force and a moment on the body.
fn shared(base: &Chassis, force: Twist) -> std::vec::Vec<f64> {
    base.wheel_states(base.feasible(force).twist, &[]).iter().map(|wheel| wheel.speed_mps).collect()
}

#[test]
fn forces_that_move_a_base_have_no_part_that_cancels_another() {
    let mut random = Random::new(21);
    for base in [
        Chassis::mecanum(0.45, 0.42, LIMITS).unwrap(),
        Chassis::skid_steer(0.9, &[0.5, 0.0, -0.4], LIMITS).unwrap(),
        Chassis::omni(0.25, 4, 0.3, LIMITS).unwrap(),
    ] {
        for _ in 0..200 {
            let forces = shared(&base, any_twist(&mut random));
            let parts = base.strain(&forces).unwrap();
            assert!(parts.iter().all(|part| part.abs() < 1e-9), "{forces:?} {parts:?}");
        }
    }
}

#[test]
fn of_a_mecanum_base_the_front_wheels_against_the_rear_ones_move_nothing() {
    let base = Chassis::mecanum(0.45, 0.42, LIMITS).unwrap();
    let parts = |forces: [f64; 4]| base.strain(&forces).unwrap();
    let equal = |found: &[f64], wanted: [f64; 4]| found.iter().zip(wanted).all(|(one, other)| near(*one, other, 1e-9));
    // Axes: front left, front right, rear left, rear right.
    assert!(equal(&parts([40.0, 40.0, -40.0, -40.0]), [40.0, 40.0, -40.0, -40.0]));
    assert!(equal(&parts([52.0, 44.0, -28.0, -36.0]), [40.0, 40.0, -40.0, -40.0]));
    // One wheel alone moves the base by three quarters of its force, and strains it by a quarter.
    for wheel in 0..4 {
        let mut forces = [0.0; 4];
        forces[wheel] = 8.0;
        let found = parts(forces);
        assert!(found.iter().all(|part| near(part.abs(), 2.0, 1e-9)) && found[wheel] > 0.0, "{found:?}");
    }
}

#[test]
fn strain_is_unknown_without_all_forces_and_of_a_base_that_is_not_redundant() {
    let mecanum = Chassis::mecanum(0.45, 0.42, LIMITS).unwrap();
    for wrong in [f64::NAN, f64::INFINITY, -1e7] {
        assert_eq!(mecanum.strain(&[1.0, wrong, 1.0, 1.0]), None);
    }
    assert_eq!((mecanum.strain(&[1.0; 3]), mecanum.strain(&[1.0; 5]), mecanum.strain(&[])), (None, None, None));
    assert_eq!(Chassis::differential(0.42, LIMITS).unwrap().strain(&[1.0, -1.0]), None);
    assert_eq!(Chassis::omni(0.25, 3, 0.3, LIMITS).unwrap().strain(&[1.0; 3]), None);
    let steered = Chassis::bicycle(&steered(End::Front, Driven::All, STEERING)).unwrap();
    assert_eq!(steered.strain(&[1.0, 1.0]), None);
}
