//! How a gamepad drives the robot: what is set, and what cannot be.

use base::listed;
use base::{Duration, gamepad};
use settings::robot::{Base, Limits};
use settings::{Off, Rule, Table, Value, ZeroOr, settings};
use std::ops::RangeInclusive;

settings! {
    /// Keys of `[gamepad]` for the driver.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Config {
        /// The port's name.
        bus: String = unset "joystick";
        /// Stick for the speed; its limit in m/s.
        speed: StickConfig = table;
        /// Stick for the steering angle; its limit in rad. Of a base that does not steer: for the rotation, its limit
        /// in rad/s.
        steering: StickConfig = table;
        /// Stick to go sideways, of a base that can; its limit in m/s.
        sideways: StickConfig = table;
        /// Dead-man button, by name or code. Absent: `BTN_TL`, else `BTN_TRIGGER`, else the first.
        dead_man: Option<u16> = optional, BUTTON;
        /// Button that lets the robot creep past the guard while it is held beside the dead-man button (docs/guard.md).
        /// Absent: `BTN_TR`, unless that is another of these buttons.
        creep: Option<u16> = optional, BUTTON;
        /// Share of the speed's limit that the stick reaches with no button held.
        scale: f64 = 1.0, 0.01..=1.0;
        /// Button that makes it another share while it is held; takes precedence over `fast`.
        slow: Option<Gear> = optional;
        /// Another such button.
        fast: Option<Gear> = optional;
        /// A gamepad that drives and sends nothing for this long counts as released: it may be out of range. 0: never,
        /// for a gamepad with a cable.
        quiet_s as quiet: Option<Duration> = Some(Duration::from_millis(500)), Off(ZeroOr(0.5..=3600.0));
    }
    check Config::refuse_double;
}

settings! {
    /// `speed = { … }`, `steering = { … }`, `sideways = { … }`: an axis, and the conversion of its position.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct StickConfig {
        /// Name or code. Absent: of a gamepad (it has `BTN_SOUTH`) `ABS_Y` and `ABS_RX`, else `ABS_X`; of others
        /// `ABS_Y` and `ABS_X`; else what there is. To go sideways: `ABS_X` of a gamepad, else `ABS_RX`, `ABS_RZ` of
        /// others, or `ABS_HAT0X`, if it is free; else the base does not go sideways by this device.
        axis: Option<u16> = optional, AXIS;
        /// Greater values are forward or left. Sticks have these where they are pulled, and to the right.
        inverted: bool = false;
        /// Share of the way to either end that counts as the middle; at least the device's `flat`.
        dead_zone: f64 = 0.1, 0.0..=0.9;
        /// Shape of the curve: 0 a straight line; 1 the cube, fine near the middle.
        expo: f64 = 0.3, 0.0..=1.0;
        /// Demand at its ends, m/s, rad or rad/s. Absent, and at most: `limits.speed_manual_mps`,
        /// `limits.steering_rad`; of a base that does not steer `limits.rotation_radps`.
        limit: f64 = derived f64::INFINITY, 0.01..=10.0;
    }
}

settings! {
    /// `slow = { … }`, `fast = { … }`: a button and the share of the speed's limit that it gives.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Gear {
        /// Name or code.
        button: u16 = required, BUTTON;
        /// Share of the limit.
        scale: f64 = required, 0.01..=1.0;
    }
}

/// What the sticks command; see [`Commands::of`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Commands {
    /// Speed and steering angle of a base that steers: `LL_CMD_MOTION`.
    #[default]
    Motion,
    /// Velocity of a base that does not: `LL_CMD_VELOCITY`.
    Velocity {
        /// The base goes sideways, too.
        sideways: bool,
    },
}

impl Commands {
    /// Those that a base obeys best; `None`: it steers.
    #[must_use]
    pub fn of(base: Option<&Base>) -> Self {
        base.map_or(Self::Motion, |base| Self::Velocity { sideways: base.goes_sideways() })
    }
}

/// A code by its name, or as a number for a code without one.
struct Code {
    by_name: fn(&str) -> Option<u16>,
    range: RangeInclusive<u16>,
    example: &'static str,
}

const AXIS: Code = Code { by_name: gamepad::axis_code, range: 0..=0x3F, example: "ABS_Y" };
const BUTTON: Code = Code { by_name: gamepad::button_code, range: 0x100..=0x2FF, example: "BTN_TL" };

impl Rule<u16> for Code {
    fn accept(&self, value: &Value) -> Option<u16> {
        match value {
            Value::String(name) => (self.by_name)(name),
            number => self.range.accept(number),
        }
    }

    fn expected(&self) -> String {
        let (start, end) = (self.range.start(), self.range.end());
        format!("a name as {:?}, or a code from {start:#x} to {end:#x}", self.example)
    }

    fn stand_in(&self) -> u16 {
        *self.range.start()
    }

    fn shown(&self, code: &u16) -> String {
        format!("{code:#x}")
    }
}

listed! {
    /// Why a configuration is refused.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum ConfigError {
        /// One axis for two things.
        OneAxis => "speed, steering and sideways need an axis each",
        /// One button for two things.
        OneButton => "dead_man, creep, slow and fast need a button each",
        /// A number that is out of its range, or none.
        Number => "a dead zone, expo, scale or limit is out of range",
    }
}

impl std::error::Error for ConfigError {}

impl Config {
    fn refuse_double(&self, table: &Table<'_>) {
        let [speed, steering, sideways] = self.sticks().map(|stick| stick.axis);
        if speed.is_some() && speed == steering {
            table.refuse("steering", "another axis than that of the speed");
        }
        if sideways.is_some() && [speed, steering].contains(&sideways) {
            table.refuse("sideways", "another axis than those of speed and steering");
        }
        let [slow, fast] = [self.slow, self.fast].map(|gear| gear.map(|gear| gear.button));
        if self.creep.is_some() && [self.dead_man, slow, fast].contains(&self.creep) {
            table.refuse("creep", "another button than dead_man, slow and fast");
        }
        if slow.is_some() && slow == self.dead_man {
            table.refuse("slow", "another button than dead_man");
        }
        if fast.is_some() && [self.dead_man, slow].contains(&fast) {
            table.refuse("fast", "another button than dead_man and slow");
        }
    }

    /// The same within the limits of a manual source, m/s, and rad or rad/s by what the sticks command.
    #[must_use]
    pub fn within(mut self, limits: &Limits, commands: Commands) -> Self {
        let turn = if commands == Commands::Motion { limits.steering_rad } else { limits.rotation_radps };
        self.speed.limit = self.speed.limit.min(limits.manual_mps());
        self.steering.limit = self.steering.limit.min(turn);
        self.sideways.limit = self.sideways.limit.min(limits.manual_mps());
        self
    }

    /// Those for speed, steering and sideways.
    fn sticks(&self) -> [&StickConfig; 3] {
        [&self.speed, &self.steering, &self.sideways]
    }

    pub(super) fn check(&self) -> Result<(), ConfigError> {
        let axes = self.sticks().map(|stick| stick.axis);
        if axes.iter().enumerate().any(|(place, axis)| axis.is_some() && axes[..place].contains(axis)) {
            return Err(ConfigError::OneAxis);
        }
        let gears = [self.slow, self.fast];
        let buttons: Vec<u16> =
            gears.iter().flatten().map(|gear| gear.button).chain(self.dead_man).chain(self.creep).collect();
        if buttons.iter().enumerate().any(|(place, button)| buttons[..place].contains(button)) {
            return Err(ConfigError::OneButton);
        }
        let scales = gears.iter().flatten().map(|gear| gear.scale).chain([self.scale]);
        let good = self.sticks().iter().all(|stick| {
            (0.0..=0.9).contains(&stick.dead_zone)
                && (0.0..=1.0).contains(&stick.expo)
                && stick.limit > 0.0
                && stick.limit.is_finite()
        });
        let good = good && scales.into_iter().all(|scale| scale > 0.0 && scale <= 1.0);
        if good { Ok(()) } else { Err(ConfigError::Number) }
    }
}
