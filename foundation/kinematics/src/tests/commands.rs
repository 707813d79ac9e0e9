//! What a base cannot do, and limits.

use super::*;

fn curvatures(a: Twist, b: Twist) -> bool {
    let parallel = |p: f64, q: f64, r: f64, s: f64| near(p * s, q * r, 1e-9);
    parallel(a.vx, a.omega, b.vx, b.omega) && parallel(a.vx, a.vy, b.vx, b.vy) && parallel(a.vy, a.omega, b.vy, b.omega)
}

#[test]
fn what_a_base_cannot_do_is_zero_with_its_cause() {
    let refused = |base: &Chassis, command: Twist| {
        let feasible = base.feasible(command);
        (feasible.twist, feasible.refused.to_vec())
    };
    let car = Chassis::ackermann(&steered(End::Front, Driven::Fixed, STEERING), 0.5).unwrap();
    assert_eq!(refused(&car, Twist::new(0.5, 0.2, 0.0)), (Twist::new(0.5, 0.0, 0.0), vec![Refusal::Sideways]));
    assert_eq!(refused(&car, Twist::new(0.0, 0.0, 0.5)), (Twist::ZERO, vec![Refusal::OnTheSpot]));
    assert_eq!(refused(&car, Twist::new(0.0, 0.2, 0.0)), (Twist::ZERO, vec![Refusal::Sideways]));
    let both = vec![Refusal::Sideways, Refusal::OnTheSpot];
    assert_eq!(refused(&car, Twist::new(0.0, 0.2, 0.5)), (Twist::ZERO, both));
    let (twist, causes) = refused(&car, Twist::new(-0.5, 0.0, 3.0));
    assert!(twist.vx == -0.5 && near(twist.omega, 0.5 * libm::tan(0.61) / 0.6, 1e-12), "{twist:?}");
    assert_eq!(causes, [Refusal::TooNarrow]);
    assert_eq!(refused(&car, Twist::new(0.5, 0.0, 0.1)), (Twist::new(0.5, 0.0, 0.1), vec![]));

    let differential = Chassis::differential(0.42, LIMITS).unwrap();
    assert_eq!(refused(&differential, Twist::new(0.0, 0.0, 0.5)), (Twist::new(0.0, 0.0, 0.5), vec![]));
    let tricycle = Chassis::tricycle(&steered(End::Front, Driven::Steered, ACROSS), 0.5).unwrap();
    assert_eq!(refused(&tricycle, Twist::new(0.0, 0.0, 0.5)), (Twist::new(0.0, 0.0, 0.5), vec![]));
    for base in [Chassis::mecanum(0.5, 0.4, LIMITS).unwrap(), Chassis::omni(0.25, 3, 0.3, LIMITS).unwrap()] {
        assert_eq!(refused(&base, Twist::new(0.1, 0.2, 0.5)), (Twist::new(0.1, 0.2, 0.5), vec![]));
    }
}

#[test]
fn what_is_permitted_is_permitted_again_and_can_be_rolled() {
    for (name, base) in bases() {
        let mut random = Random::new(9);
        for _ in 0..2000 {
            let command = any_twist(&mut random);
            let once = base.feasible(command);
            let twice = base.feasible(once.twist);
            assert!(equal(once.twist, twice.twist, 1e-9), "{name}: {once:?} {twice:?}");
            assert!(twice.refused.is_empty(), "{name}: {command:?} {once:?} {twice:?}");
            // No wheel slides: each rolls with the speed of the floor under it.
            for (wheel, state) in base.wheels().iter().zip(base.wheel_states(once.twist, &[])) {
                if wheel.steering().is_some() {
                    let (vx, vy) = once.twist.at(wheel.x_m, wheel.y_m);
                    assert!(near(libm::fabs(state.speed_mps), libm::hypot(vx, vy), 1e-7), "{name}: {once:?} {state:?}");
                }
            }
        }
    }
}

#[test]
fn the_speed_limit_scales_all_wheels_together() {
    for (name, base) in bases() {
        let mut random = Random::new(10);
        for _ in 0..1000 {
            let twist = base.feasible(any_twist(&mut random) * 3.0).twist;
            let within = base.within_speed(twist);
            assert!(curvatures(twist, within), "{name}: {twist:?} {within:?}");
            let fastest = |twist| {
                let states = base.wheel_states(twist, &[]);
                let driven = base.wheels().iter().zip(states).filter(|(wheel, _)| wheel.driven);
                driven.map(|(_, state)| libm::fabs(state.speed_mps)).fold(0.0, f64::max)
            };
            // Where it was needed, one wheel is at its limit.
            let expected = fastest(twist).min(LIMITS.speed_mps);
            assert!(near(fastest(within), expected, 1e-7), "{name}: {twist:?} {within:?}");
        }
    }
}

/// Steps to a velocity until it is reached; the velocity after each of them.
fn ramp(base: &Chassis, states: &mut PerWheel<WheelState>, target: Twist) -> Vec<Twist> {
    let mut way = Vec::new();
    for _ in 0..2000 {
        *states = base.step(target, states, 0.02);
        let twist = base.estimate(states).unwrap().twist;
        way.push(twist);
        if equal(twist, target, 1e-9) {
            return way;
        }
    }
    panic!("{target:?} is not reached: {states:?}");
}

#[test]
fn acceleration_and_braking_keep_the_curvature() {
    for (name, base) in bases() {
        let mut random = Random::new(11);
        for _ in 0..20 {
            let target = base.within_speed(base.feasible(any_twist(&mut random)).twist);
            // The steering points there already.
            let mut states = base.wheel_states(target, &[]);
            states.iter_mut().for_each(|state| state.speed_mps = 0.0);
            let way = ramp(&base, &mut states, target);
            assert!(way.iter().all(|twist| curvatures(*twist, target)), "{name}: {target:?} {way:?}");
            let way = ramp(&base, &mut states, Twist::ZERO);
            assert!(way.iter().all(|twist| curvatures(*twist, target)), "{name}: {target:?} {way:?}");
        }
    }
}

#[test]
fn every_step_is_within_every_limit_and_every_velocity_is_reached() {
    for (name, base) in bases() {
        let mut random = Random::new(12);
        let mut states = base.standing();
        for _ in 0..40 {
            let target = base.within_speed(base.feasible(any_twist(&mut random)).twist);
            for _ in 0..400 {
                let next = base.step(target, &states, 0.02);
                for (wheel, (now, next)) in base.wheels().iter().zip(states.iter().zip(&next)) {
                    let change = libm::fabs(next.speed_mps - now.speed_mps);
                    let faster = libm::fabs(next.speed_mps) > libm::fabs(now.speed_mps);
                    let same_way = next.speed_mps * now.speed_mps >= 0.0;
                    let most = if faster && same_way { 0.8 } else { 1.1 };
                    let in_limits = change <= most * 0.02 + 1e-9 && libm::fabs(next.speed_mps) <= 1.2 + 1e-9;
                    assert!(!wheel.driven || in_limits, "{name}: {now:?} {next:?}");
                    let turned = libm::fabs(next.steering_rad - now.steering_rad);
                    let Some(range) = wheel.steering() else { continue };
                    assert!(turned <= range.rate_radps * 0.02 + 1e-9, "{name}: {now:?} {next:?}");
                    assert!((range.min_rad..=range.max_rad).contains(&next.steering_rad), "{name}: {next:?}");
                }
                states = next;
            }
            let reached = base.estimate(&states).unwrap().twist;
            assert!(equal(reached, target, 1e-9), "{name}: {target:?} {reached:?} {states:?}");
        }
    }
}

#[test]
fn from_one_direction_to_the_other_a_wheel_brakes_and_then_accelerates() {
    let base = Chassis::differential(0.42, LIMITS).unwrap();
    // 0.011 m/s are braked within 0.01 s; 0.01 s remain for 0.008 m/s the other way.
    let next = base.step(Twist::new(-1.0, 0.0, 0.0), &rolling(&[0.011, 0.011]), 0.02);
    assert!(near(next[0].speed_mps, -0.008, 1e-12) && next[0] == next[1], "{next:?}");
}

#[test]
fn braking_does_not_wait_for_the_steering() {
    let base = Chassis::bicycle(&steered(End::Front, Driven::Fixed, STEERING)).unwrap();
    let mut states = base.wheel_states(Twist::new(1.0, 0.0, 0.0), &[]);
    // Slower and into a turn that takes the steering 0.8 s: 0.396 m/s are gone after 0.36 s.
    let target = base.feasible(Twist::new(0.6, 0.0, 0.6)).twist;
    for _ in 0..18 {
        let before = states[0].speed_mps;
        states = base.step(target, &states, 0.02);
        assert!(near(before - states[0].speed_mps, 1.1 * 0.02, 1e-9), "{states:?}");
    }
}

#[test]
fn steering_turns_the_short_way_and_the_wheel_rolls_in_reverse_where_that_is_nearer() {
    let half_turns = Kind::Steered(Steering { min_rad: -PI, max_rad: PI, rate_radps: 3.0 });
    let base = Chassis::new(&[wheel(0.3, 0.0, 0.0, half_turns), wheel(-0.3, 0.0, 0.0, half_turns)]).unwrap();
    let ahead = base.wheel_states(Twist::new(1.0, 0.0, 0.0), &[]);
    let back = base.wheel_states(Twist::new(-1.0, 0.0, 0.0), &ahead);
    assert!(back.iter().all(|state| state.speed_mps == -1.0 && near(state.steering_rad, 0.0, 1e-12)), "{back:?}");
    // A direction that goes round once: no angle jumps, until the range ends.
    let mut states = ahead;
    for degree in 0..170 {
        let (sin, cos) = libm::sincos(f64::from(degree).to_radians());
        let next = base.wheel_states(Twist::new(cos, sin, 0.0), &states);
        assert!(near(next[0].steering_rad, states[0].steering_rad, 0.02) && next[0].speed_mps > 0.0, "{degree}");
        states = next;
    }
    // At standstill it stays.
    assert_eq!(base.wheel_states(Twist::ZERO, &states)[0].steering_rad, states[0].steering_rad);
}

#[test]
fn a_wheel_that_points_across_does_not_drive_yet() {
    let base = Chassis::tricycle(&steered(End::Front, Driven::Steered, ACROSS), 0.5).unwrap();
    let spot = Twist::new(0.0, 0.0, 0.5);
    let first = base.step(spot, &base.standing(), 0.02);
    assert!(near(first[2].steering_rad, 0.03, 1e-12) && first[2].speed_mps == 0.0, "{first:?}");
    let mut states = base.standing();
    let way = ramp(&base, &mut states, spot);
    assert!(way.iter().all(|twist| near(twist.vx, 0.0, 1e-12)), "{way:?}");
}

#[test]
fn a_wheel_does_not_drive_against_its_goal_while_it_turns_by_more_than_90_degrees() {
    let wide = Steering { min_rad: -1.05, max_rad: 1.05, rate_radps: 1.0 };
    let base = Chassis::bicycle(&steered(End::Front, Driven::Steered, wide)).unwrap();
    let turned = [WheelState::default(), WheelState { speed_mps: 0.0, steering_rad: -1.0 }];
    let target = base.feasible(Twist::new(0.3, 0.0, 0.7)).twist;
    let next = base.step(target, &turned, 0.02);
    assert!(near(next[1].steering_rad, -0.98, 1e-12) && next[1].speed_mps == 0.0, "{next:?}");
}

#[test]
fn a_wheel_about_which_the_base_turns_keeps_its_angle() {
    let free = Kind::Steered(Steering { min_rad: -PI, max_rad: PI, rate_radps: 3.0 });
    let base = Chassis::new(&[wheel(0.3, 0.1, 0.0, free), wheel(-0.3, 0.0, 0.0, free)]).unwrap();
    let present = [WheelState { speed_mps: 0.0, steering_rad: 0.5 }, WheelState::default()];
    // Its velocity is not zero, but the rounding of 0.3 - 3 · 0.1 and -0.9 + 3 · 0.3.
    let about = Twist::new(0.3, -0.9, 3.0);
    assert_ne!(about.at(0.3, 0.1), (0.0, 0.0));
    assert_eq!(base.wheel_states(about, &present)[0].steering_rad, 0.5);
}
