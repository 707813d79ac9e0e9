//! How a gamepad drives the robot: what is set, and what cannot be.

use base::listed;
use base::{Duration, gamepad};
use settings::robot::Limits;
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
        /// Stick for the steering angle; its limit in rad.
        steering: StickConfig = table;
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
    /// `speed = { … }`, `steering = { … }`: an axis, and the conversion of its position.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct StickConfig {
        /// Name or code. Absent: of a gamepad (it has `BTN_SOUTH`) `ABS_Y` and `ABS_RX`, else `ABS_X`; of others
        /// `ABS_Y` and `ABS_X`; else what there is.
        axis: Option<u16> = optional, AXIS;
        /// Greater values are forward or left. Sticks have these where they are pulled, and to the right.
        inverted: bool = false;
        /// Share of the way to either end that counts as the middle; at least the device's `flat`.
        dead_zone: f64 = 0.1, 0.0..=0.9;
        /// Shape of the curve: 0 a straight line; 1 the cube, fine near the middle.
        expo: f64 = 0.3, 0.0..=1.0;
        /// Demand at its ends, m/s or rad. Absent, and at most: `limits.speed_manual_mps`, `limits.steering_rad`.
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
        /// One axis for speed and steering.
        OneAxis => "speed and steering need an axis each",
        /// One button for two things.
        OneButton => "dead_man, creep, slow and fast need a button each",
        /// A number that is out of its range, or none.
        Number => "a dead zone, expo, scale or limit is out of range",
    }
}

impl std::error::Error for ConfigError {}

impl Config {
    fn refuse_double(&self, table: &Table<'_>) {
        if self.speed.axis.is_some() && self.speed.axis == self.steering.axis {
            table.refuse("steering", "another axis than that of the speed");
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

    /// The same within the limits of a manual source, m/s and rad.
    #[must_use]
    pub fn within(mut self, limits: &Limits) -> Self {
        self.speed.limit = self.speed.limit.min(limits.manual_mps());
        self.steering.limit = self.steering.limit.min(limits.steering_rad);
        self
    }

    pub(super) fn check(&self) -> Result<(), ConfigError> {
        if self.speed.axis.is_some() && self.speed.axis == self.steering.axis {
            return Err(ConfigError::OneAxis);
        }
        let gears = [self.slow, self.fast];
        let buttons: Vec<u16> =
            gears.iter().flatten().map(|gear| gear.button).chain(self.dead_man).chain(self.creep).collect();
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
