//! A steering drive whose PDOs differ from the descriptor: rejected, or reconfigured if the configuration permits that.

use super::*;

fn robot(remap: bool) -> Robot {
    let mut config = config();
    steering_of(&mut config).drive = icla_with(remap);
    let mut robot = Robot::with(epos::dictionary(1), config);
    robot.icla = Fake::new(icla::dictionary_of_profile(2), 6);
    robot.pass(5000);
    robot
}

#[test]
fn a_steering_drive_with_another_layout_is_refused() {
    let robot = robot(false);
    assert!(robot.errors.contains(&(Fault::DriveMismatch, Severity::Error)), "{:?}", robot.errors);
    assert!(
        !robot.motion().homed && robot.holds().contains(&(Hold::DriveBootFailed, "steering")),
        "{}",
        robot.reason()
    );
    assert_eq!(robot.icla.node.get(0x1601, 2), Some(0x6060_0008), "nothing was changed in it");
}

#[test]
fn with_remap_it_is_given_the_layout_and_steers() {
    let mut robot = robot(true);
    assert_eq!(robot.icla.node.get(0x1601, 2), Some(0x607A_0020));
    assert_eq!(robot.icla.node.get(0x1A01, 2), Some(0x6064_0020));
    assert!(robot.motion().homed, "{}", robot.reason());
    robot.command(0.4, 0.2);
    robot.pass(50);
    robot.drive(0.4, 500);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_drive_without_the_modes_is_refused_even_with_remap() {
    let mut config = config();
    steering_of(&mut config).drive = icla_with(true);
    let mut robot = Robot::with(epos::dictionary(1), config);
    robot.icla = Fake::new(icla::dictionary(2), 6);
    robot.icla.node.set(0x6502, 0, 0x05);
    robot.pass(5000);
    assert!(robot.errors.contains(&(Fault::DriveMismatch, Severity::Error)), "{:?}", robot.errors);
}
