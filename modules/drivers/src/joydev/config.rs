//! How a gamepad drives the robot: what is set, and what cannot be.

use base::Duration;
use std::fmt;

/// Configuration of `driver_joydev`.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The port's name: `joystick`.
    pub bus: String,
    /// What asks for a speed; its limit in m/s.
    pub speed: StickConfig,
    /// What asks for a steering angle; its limit in rad.
    pub steering: StickConfig,
    /// The dead-man button; none: what such a device has in its place.
    pub dead_man: Option<u16>,
    /// The share of the speed's limit that the stick reaches with no button held, above 0 to 1.
    pub scale: f64,
    /// A button that makes it another one while it is held, and counts before `fast`.
    pub slow: Option<Gear>,
    /// Another such button.
    pub fast: Option<Gear>,
    /// While it drives, a gamepad that says nothing for so long counts as let go; none: it may rest for ever.
    pub quiet: Option<Duration>,
}

/// An axis, and how what it says becomes what it asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StickConfig {
    /// Its code; none: what such a device has for this.
    pub axis: Option<u16>,
    /// Towards its greater values is forward or left. Sticks have these where they are pulled, and to the right.
    pub inverted: bool,
    /// So much around the middle is the middle, 0 to 0.9 of the way to either end; at least what the device says.
    pub dead_zone: f64,
    /// 0: straight; 1: the cube of the way, fine near the middle.
    pub expo: f64,
    /// What it asks for at its ends, above 0.
    pub limit: f64,
}

/// A button and the share of the speed's limit that it gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gear {
    /// `BTN_…`
    pub button: u16,
    /// Above 0 to 1.
    pub scale: f64,
}

/// Why a configuration is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigError {
    /// One axis for speed and steering.
    OneAxis,
    /// One button for two things.
    OneButton,
    /// A number that is out of its range, or none.
    Number,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::OneAxis => "speed and steering need an axis each",
            Self::OneButton => "dead_man, slow and fast need a button each",
            Self::Number => "a dead zone, expo, scale or limit is out of range",
        })
    }
}

impl std::error::Error for ConfigError {}

impl Config {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        if self.speed.axis.is_some() && self.speed.axis == self.steering.axis {
            return Err(ConfigError::OneAxis);
        }
        let gears = [self.slow, self.fast];
        let buttons: Vec<u16> = gears.iter().flatten().map(|gear| gear.button).chain(self.dead_man).collect();
        if buttons.iter().enumerate().any(|(place, button)| buttons[..place].contains(button)) {
            return Err(ConfigError::OneButton);
        }
        let scales = gears.iter().flatten().map(|gear| gear.scale).chain([self.scale]);
        let good = [self.speed, self.steering].iter().all(|stick| {
            (0.0..=0.9).contains(&stick.dead_zone)
                && (0.0..=1.0).contains(&stick.expo)
                && stick.limit > 0.0
                && stick.limit.is_finite()
        });
        let good = good && scales.into_iter().all(|scale| scale > 0.0 && scale <= 1.0);
        if good { Ok(()) } else { Err(ConfigError::Number) }
    }
}
