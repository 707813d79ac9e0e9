//! Comparison with the formulas of the textbooks, written down here by themselves, and with figures from a hand
//! calculator.

use super::*;
use navitools::Pose;

#[test]
fn differential() {
    let base = Chassis::differential(0.42, LIMITS).unwrap();
    let mut random = Random::new(1);
    for _ in 0..1000 {
        let (left, right) = (unit(&mut random), unit(&mut random));
        let twist = base.estimate(&rolling(&[left, right])).unwrap().twist;
        assert!(equal(twist, Twist::new((right + left) / 2.0, 0.0, (right - left) / 0.42), 1e-12));
    }
    // By hand: 0.5 ∓ 0.21.
    let states = base.wheel_states(Twist::new(0.5, 0.0, 1.0), &[]);
    assert!(near(states[0].speed_mps, 0.29, 1e-15) && near(states[1].speed_mps, 0.71, 1e-15), "{states:?}");
}

#[test]
fn skid_steer() {
    let base = Chassis::skid_steer(0.8, &[0.3, -0.3], LIMITS).unwrap();
    let states = base.wheel_states(Twist::new(0.5, 0.0, 1.0), &[]);
    [0.1, 0.9, 0.1, 0.9].iter().zip(speeds(&states)).for_each(|(right, is)| assert!(near(is, *right, 1e-15)));
    // The mean of each side.
    let twist = base.estimate(&rolling(&[0.1, 0.8, 0.3, 1.0])).unwrap().twist;
    assert!(equal(twist, Twist::new(0.55, 0.0, 0.7 / 0.8), 1e-12), "{twist:?}");
    // It turns about the middle of its axles: with one at 0.4 m and one at 0, the origin moves by -0.2 m/s at 1 rad/s.
    let base = Chassis::skid_steer(0.8, &[0.4, 0.0], LIMITS).unwrap();
    assert!(equal(base.feasible(Twist::new(0.0, 0.0, 1.0)).twist, Twist::new(0.0, -0.2, 1.0), 1e-15));
}

#[test]
fn mecanum_with_rollers_in_an_x() {
    let base = Chassis::mecanum(0.5, 0.4, LIMITS).unwrap();
    let mut random = Random::new(2);
    // Half the wheelbase and half the track.
    let k = 0.25 + 0.2;
    for _ in 0..1000 {
        let Twist { vx, vy, omega } = any_twist(&mut random);
        let states = base.wheel_states(Twist::new(vx, vy, omega), &[]);
        let rows = [vx - vy - k * omega, vx + vy + k * omega, vx + vy - k * omega, vx - vy + k * omega];
        rows.iter().zip(speeds(&states)).for_each(|(row, is)| assert!(near(is, *row, 1e-12)));

        let [fl, fr, rl, rr] = [(); 4].map(|()| unit(&mut random));
        let twist = base.estimate(&rolling(&[fl, fr, rl, rr])).unwrap().twist;
        let expected = Twist::new(fl + fr + rl + rr, -fl + fr + rl - rr, (-fl + fr - rl + rr) / k) * 0.25;
        assert!(equal(twist, expected, 1e-12), "{twist:?} {expected:?}");
    }
}

#[test]
fn three_omni_wheels_at_120_degrees() {
    // Wheels at 0°, 120°, 240° from x, each rolling counter-clockwise: sin 60° = 0.8660254037844386.
    let base = Chassis::omni(0.2, 3, 0.0, LIMITS).unwrap();
    let s = 0.866_025_403_784_438_6;
    let mut random = Random::new(3);
    for _ in 0..1000 {
        let Twist { vx, vy, omega } = any_twist(&mut random);
        let states = base.wheel_states(Twist::new(vx, vy, omega), &[]);
        let rows = [vy + 0.2 * omega, -s * vx - 0.5 * vy + 0.2 * omega, s * vx - 0.5 * vy + 0.2 * omega];
        rows.iter().zip(speeds(&states)).for_each(|(row, is)| assert!(near(is, *row, 1e-12)));

        let [a, b, c] = [(); 3].map(|()| unit(&mut random));
        let twist = base.estimate(&rolling(&[a, b, c])).unwrap().twist;
        let expected = Twist::new((c - b) * s / 1.5, (2.0 * a - b - c) / 3.0, (a + b + c) / 0.6);
        assert!(equal(twist, expected, 1e-12), "{twist:?} {expected:?}");
    }
}

#[test]
fn tricycle() {
    let base = Chassis::tricycle(&steered(End::Front, Driven::Steered, ACROSS), 0.5).unwrap();
    let mut random = Random::new(4);
    for _ in 0..1000 {
        let (v, omega) = (0.05 + (1.0 + unit(&mut random)), unit(&mut random));
        let states = base.wheel_states(Twist::new(v, 0.0, omega), &[]);
        let delta = libm::atan(0.6 * omega / v);
        assert!(near(states[2].steering_rad, delta, 1e-12), "{states:?}");
        assert!(near(states[2].speed_mps, v / libm::cos(delta), 1e-12), "{states:?}");
        assert!(
            near(states[0].speed_mps, v - 0.25 * omega, 1e-12) && near(states[1].speed_mps, v + 0.25 * omega, 1e-12)
        );

        let speed = unit(&mut random);
        let measured = [0.0, 0.0, speed].map(|speed_mps| WheelState { speed_mps, steering_rad: delta });
        let twist = base.estimate(&measured).unwrap().twist;
        assert!(equal(twist, Twist::new(speed * libm::cos(delta), 0.0, speed * libm::sin(delta) / 0.6), 1e-12));
    }
    // On the spot: the wheel is across and rolls at 0.6 m times 0.5 rad/s.
    let states = base.wheel_states(Twist::new(0.0, 0.0, 0.5), &[]);
    assert!(near(states[2].steering_rad, FRAC_PI_2, 1e-12) && near(states[2].speed_mps, 0.3, 1e-12), "{states:?}");
}

#[test]
fn a_wheel_steered_at_the_rear_turns_the_other_way() {
    let base = Chassis::bicycle(&steered(End::Rear, Driven::Fixed, STEERING)).unwrap();
    let states = base.wheel_states(Twist::new(1.0, 0.0, 0.5), &[]);
    assert!(near(states[1].steering_rad, -libm::atan(0.3), 1e-15), "{states:?}");
}

#[test]
fn ackermann() {
    // By hand, for a radius of 2 m: atan(0.6 / 1.75), atan(0.6 / 2.25). Their cotangents differ by track / wheelbase.
    let base = Chassis::ackermann(&steered(End::Front, Driven::Fixed, STEERING), 0.5).unwrap();
    let states = base.wheel_states(Twist::new(1.0, 0.0, 0.5), &[]);
    let (inner, outer) = (states[2].steering_rad, states[3].steering_rad);
    assert!(near(inner, 0.330_297, 1e-6) && near(outer, 0.260_602, 1e-6), "{inner} {outer}");
    assert!(near(1.0 / libm::tan(outer) - 1.0 / libm::tan(inner), 0.5 / 0.6, 1e-12));
    assert!(near(states[0].speed_mps, 0.875, 1e-15) && near(states[1].speed_mps, 1.125, 1e-15), "{states:?}");
    // The robot of docs/facts/robot.md 1.2: 35° give a radius of 0.857 m in the middle of the rear axle.
    let stop = 35f64.to_radians();
    let steering = Steering { min_rad: -stop, max_rad: stop, rate_radps: 0.7 };
    let wide = steered(End::Front, Driven::Fixed, steering);
    for base in [Chassis::bicycle(&wide), Chassis::tricycle(&wide, 0.5), Chassis::ackermann(&wide, 0.5)] {
        for omega in [9.0, -9.0] {
            let feasible = base.as_ref().unwrap().feasible(Twist::new(0.8, 0.0, omega));
            assert!(near(libm::fabs(feasible.twist.vx / feasible.twist.omega), 0.857, 0.0005), "{feasible:?}");
            assert_eq!((feasible.twist.vx, feasible.refused.as_slice()), (0.8, [Refusal::TooNarrow].as_slice()));
        }
    }
}

#[test]
fn the_model_of_navitools_is_the_bicycle() {
    let geometry = navitools::Ackermann { wheelbase_m: 0.6, track_m: 0.5 };
    let base = Chassis::bicycle(&steered(End::Front, Driven::Fixed, STEERING)).unwrap();
    for tenth in -350..=350 {
        let steering_rad = f64::from(tenth) / 10.0 / 180.0 * PI;
        let motion = geometry.motion(0.7, steering_rad);
        let rear = WheelState { speed_mps: 0.7, steering_rad: 0.0 };
        let twist = base.estimate(&[rear, WheelState { speed_mps: f64::NAN, steering_rad }]).unwrap().twist;
        assert!(equal(twist, Twist::new(motion.translation, 0.0, motion.rotation), 1e-14), "{tenth}");
    }
}

#[test]
fn arcs_are_exact() {
    // A quarter of a circle of 2 m to the left, while it drives forward and while it drives to the left.
    let quarter = FRAC_PI_2;
    let forward = integrate(Pose::default(), Twist::new(2.0 * quarter, 0.0, quarter), 1.0);
    assert!(near(forward.x, 2.0, 1e-12) && near(forward.y, 2.0, 1e-12), "{forward:?}");
    let left = integrate(Pose::default(), Twist::new(0.0, quarter, quarter / 2.0), 2.0);
    assert!(near(left.x, -2.0, 1e-12) && near(left.y, 2.0, 1e-12), "{left:?}");
    // A thousand steps of the same velocity, and a slight turn by small steps of Euler's method.
    let mut random = Random::new(5);
    for _ in 0..100 {
        let twist = any_twist(&mut random);
        let start = Pose::new(unit(&mut random), unit(&mut random), 3.0 * unit(&mut random));
        let whole = integrate(start, twist, 1.0);
        let steps = (0..1000).fold(start, |pose, _| integrate(pose, twist, 1e-3));
        assert!(whole.point().distance(steps.point()) < 1e-12, "{twist:?}");
        let euler = (0..20_000).fold(start, |pose, _| {
            let (sin, cos) = pose.theta.sin_cos();
            let (x, y) = (cos * twist.vx - sin * twist.vy, sin * twist.vx + cos * twist.vy);
            Pose { x: pose.x + x / 2e4, y: pose.y + y / 2e4, theta: pose.theta + twist.omega / 2e4 }
        });
        assert!(whole.point().distance(euler.point()) < 5e-4, "{twist:?}");
    }
}
