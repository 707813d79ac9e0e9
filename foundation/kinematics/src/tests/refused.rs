//! Descriptions that cannot be.

use super::*;

fn refused(wheels: &[Wheel]) -> Error {
    Chassis::new(wheels).expect_err("cannot be")
}

#[test]
fn without_wheels_and_with_too_many() {
    assert_eq!(refused(&[]), Error::NoWheels);
    let nine: Vec<Wheel> = (0..9).map(|n| wheel(f64::from(n), 0.5, 0.0, Kind::Skid)).collect();
    assert_eq!(refused(&nine), Error::TooManyWheels { count: 9 });
    assert_eq!(Chassis::omni(0.2, 0, 0.0, LIMITS), Err(Error::NoWheels));
    assert_eq!(Chassis::omni(0.2, usize::MAX, 0.0, LIMITS), Err(Error::TooManyWheels { count: usize::MAX }));
    assert_eq!(Chassis::skid_steer(0.8, &[], LIMITS), Err(Error::NoWheels));
}

#[test]
fn two_axes_on_one_wheel() {
    let twice =
        [wheel(0.0, 0.2, 0.0, Kind::Fixed), wheel(0.0, -0.2, 0.0, Kind::Fixed), wheel(0.0, 0.2, 0.0, Kind::Fixed)];
    assert_eq!(refused(&twice), Error::SamePlace { wheel: 2, other: 0 });
}

#[test]
fn fixed_wheels_that_block_each_other() {
    let beside = [wheel(0.0, 0.2, 0.0, Kind::Fixed), wheel(0.3, -0.2, 0.0, Kind::Fixed)];
    assert_eq!(refused(&beside), Error::OffAxle { wheel: 1, other: 0 });
    let askew = [wheel(0.0, 0.2, 0.0, Kind::Fixed), wheel(0.0, -0.2, 0.1, Kind::Fixed)];
    assert_eq!(refused(&askew), Error::OffAxle { wheel: 1, other: 0 });
    let skew = [wheel(0.3, 0.2, 0.0, Kind::Skid), wheel(-0.3, -0.2, 0.1, Kind::Skid)];
    assert_eq!(refused(&skew), Error::OffAxle { wheel: 1, other: 0 });
}

#[test]
fn omni_wheels_that_are_parallel() {
    let omni = Kind::Rollers { angle_rad: 0.0 };
    let parallel = [wheel(0.0, 0.2, 0.0, omni), wheel(0.0, -0.2, 0.0, omni), wheel(0.3, 0.4, 0.0, omni)];
    assert_eq!(refused(&parallel), Error::NotDriven { wheel: Some(2) });
    assert_eq!(refused(&parallel[..2]), Error::NotDriven { wheel: None });
    // All roll towards the origin: none turns the base.
    let radial = [0.0, 2.1, 4.2].map(|angle| wheel(0.2 * libm::cos(angle), 0.2 * libm::sin(angle), angle, omni));
    assert_eq!(refused(&radial), Error::NotDriven { wheel: Some(2) });
    // Mecanum wheels mounted with rollers in an O, on a square: their pushes meet in the middle.
    let (left, right) = (Kind::Rollers { angle_rad: PI / 4.0 }, Kind::Rollers { angle_rad: -PI / 4.0 });
    let circle = [
        wheel(0.2, 0.2, 0.0, left),
        wheel(0.2, -0.2, 0.0, right),
        wheel(-0.2, 0.2, 0.0, right),
        wheel(-0.2, -0.2, 0.0, left),
    ];
    assert_eq!(refused(&circle), Error::NotDriven { wheel: Some(2) });
}

#[test]
fn wheels_that_are_not_driven_or_not_measured() {
    let passive = |wheel: Wheel| Wheel { driven: false, ..wheel };
    let blind = |wheel: Wheel| Wheel { measured: false, ..wheel };
    let pair = [wheel(0.0, 0.2, 0.0, Kind::Fixed), wheel(0.0, -0.2, 0.0, Kind::Fixed)];
    assert_eq!(refused(&pair.map(passive)), Error::NotDriven { wheel: None });
    assert_eq!(refused(&[pair[0], passive(pair[1])]), Error::NotDriven { wheel: None });
    assert_eq!(refused(&[pair[0], blind(pair[1])]), Error::NotMeasured { wheel: None });
    // One steered wheel alone does not hold the base.
    assert_eq!(refused(&[wheel(0.0, 0.0, 0.0, Kind::Steered(STEERING))]), Error::NotDriven { wheel: None });
    // A wheel on the fixed axle does not turn the base about itself, so the steering must not be across.
    let across = steered(End::Front, Driven::Fixed, ACROSS);
    assert_eq!(Chassis::bicycle(&across), Err(Error::NotDriven { wheel: Some(1) }));
    assert!(Chassis::tricycle(&across, 0.5).is_ok(), "two wheels there do");
}

#[test]
fn numbers_out_of_range() {
    let good = wheel(0.0, 0.2, 0.0, Kind::Fixed);
    let quantity = |wheel: Wheel| match refused(&[good, wheel]) {
        Error::OutOfRange { wheel: Some(1), quantity, .. } => quantity,
        other => panic!("{other:?}"),
    };
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300] {
        assert_eq!(quantity(Wheel { x_m: bad, ..good }), "x_m");
        assert_eq!(quantity(Wheel { y_m: bad, ..good }), "y_m");
        assert_eq!(quantity(Wheel { direction_rad: bad, ..good }), "direction_rad");
        assert_eq!(quantity(Wheel { limits: Limits { speed_mps: bad, ..LIMITS }, ..good }), "speed_mps");
        let slow = Limits { acceleration_mps2: bad, ..LIMITS };
        assert_eq!(quantity(Wheel { limits: slow, ..good }), "acceleration_mps2");
        let slow = Limits { deceleration_mps2: bad, ..LIMITS };
        assert_eq!(quantity(Wheel { limits: slow, ..good }), "deceleration_mps2");
        assert_eq!(quantity(Wheel { kind: Kind::Rollers { angle_rad: bad }, ..good }), "angle_rad");
        let kind = |steering| Wheel { kind: Kind::Steered(steering), ..good };
        assert_eq!(quantity(kind(Steering { min_rad: bad, ..STEERING })), "min_rad");
        assert_eq!(quantity(kind(Steering { max_rad: bad, ..STEERING })), "max_rad");
        assert_eq!(quantity(kind(Steering { rate_radps: bad, ..STEERING })), "rate_radps");
        assert!(Chassis::differential(bad, LIMITS).is_err() && Chassis::mecanum(0.4, bad, LIMITS).is_err());
        assert!(Chassis::omni(bad, 3, 0.0, LIMITS).is_err() && Chassis::omni(0.2, 3, bad, LIMITS).is_err());
        assert!(Chassis::skid_steer(bad, &[0.0], LIMITS).is_err() && Chassis::skid_steer(0.5, &[bad], LIMITS).is_err());
        let base = SteeredBase { wheelbase_m: bad, ..steered(End::Rear, Driven::All, STEERING) };
        assert!(Chassis::bicycle(&base).is_err() && Chassis::tricycle(&base, 0.5).is_err());
        assert!(Chassis::ackermann(&base, 0.5).is_err());
    }
    // Rollers that turn in the direction of rolling.
    assert_eq!(quantity(Wheel { kind: Kind::Rollers { angle_rad: FRAC_PI_2 }, ..good }), "angle_rad");
    // A track of nothing, or of the wrong sign, and a range of the steering without straight ahead.
    assert!(Chassis::differential(0.0, LIMITS).is_err() && Chassis::differential(-0.4, LIMITS).is_err());
    assert_eq!(quantity(Wheel { kind: Kind::Steered(Steering { min_rad: 0.1, ..STEERING }), ..good }), "min_rad");
    // The inner wheel of an axle of 0.5 m at 0.6 m is across when the middle one is at 67.4°.
    let wide = |degrees: f64| {
        let stop = degrees.to_radians();
        let steering = Steering { min_rad: -stop, max_rad: stop, rate_radps: 1.0 };
        Chassis::ackermann(&steered(End::Front, Driven::Fixed, steering), 0.5)
    };
    assert!(wide(67.2).is_ok() && wide(67.4).is_err());
}

#[test]
fn errors_say_which_wheel_and_what_would_be_right() {
    let nan = wheel(0.0, f64::NAN, 0.0, Kind::Fixed);
    assert_eq!(refused(&[nan]).to_string(), "wheel 0: y_m is NaN; it must be -100 to 100");
    let track = Chassis::differential(-0.4, LIMITS).expect_err("negative");
    assert_eq!(track.to_string(), "track_m is -0.4; it must be 0.01 to 100");
    for error in [
        Error::SamePlace { wheel: 3, other: 1 },
        Error::OffAxle { wheel: 3, other: 0 },
        Error::NotDriven { wheel: Some(3) },
        Error::NotMeasured { wheel: Some(3) },
    ] {
        let text = error.to_string();
        assert!(text.starts_with("wheel 3 ") && (text.contains("must") || text.contains("needs")), "{text}");
    }
    for error in [Error::NoWheels, Error::NotDriven { wheel: None }, Error::NotMeasured { wheel: None }] {
        assert!(error.to_string().contains("must"), "{error}");
    }
}
