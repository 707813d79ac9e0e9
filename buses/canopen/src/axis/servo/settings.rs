//! What the objects ask of an emulated drive, in its counts and seconds; read when they are written, not at each step.

use super::Config;
use super::profile::Limits;
use crate::Dictionary;
use crate::axis::modes::Mode;
use base::Duration;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Settings {
    /// Absolute or relative target, counts.
    pub position: f64,
    /// Interpolation data, counts.
    pub interpolated: f64,
    /// Counts/s, within its limit.
    pub velocity: f64,
    pub max_speed: f64,
    pub profile_speed: f64,
    pub acceleration: f64,
    pub deceleration: f64,
    pub quick_stop: f64,
    /// Software limits, counted from home.
    pub range: [f64; 2],
    /// Beyond this lag, and for how long, the drive does not follow.
    pub following_window: f64,
    pub following_time: Duration,
    pub position_window: f64,
    pub velocity_window: f64,
    pub standstill: f64,
    /// From one set-point to the next, s.
    pub interpolation: f64,
    pub homing_method: i8,
    pub homing_speeds: [f64; 2],
    pub homing_acceleration: f64,
    pub home_offset: f64,
    /// 0x2081 of an EPOS.
    pub home_position: f64,
    /// Bits of 0x6502.
    pub supported: u32,
    pub mode: Option<Mode>,
}

impl Settings {
    pub fn read(objects: &Dictionary, config: &Config) -> Self {
        let get = |index, sub| objects.get(index, sub).map(|value| value as f64);
        let rate = |index, sub, factor: f64| get(index, sub).map(|value| value.max(1.0) * factor);
        let window = |index| get(index, 0).filter(|window| *window < f64::from(u32::MAX)).unwrap_or(f64::INFINITY);
        // In 1/min of the motor, whatever the other units.
        let of_motor = get(0x6080, 0).map_or(f64::INFINITY, |rpm| rpm.max(0.0) / 60.0 * config.index);
        let max_speed = rate(0x607F, 0, config.velocity).unwrap_or(f64::INFINITY).min(of_motor);
        let acceleration = rate(0x6083, 0, config.acceleration).unwrap_or(config.hardest);
        let deceleration = rate(0x6084, 0, config.acceleration).unwrap_or(acceleration);
        let millis = |index| Duration::from_millis(objects.get(index, 0).unwrap_or(0).max(0) as u64);
        let mut settings = Self {
            max_speed,
            profile_speed: rate(0x6081, 0, config.velocity).unwrap_or(max_speed).min(max_speed),
            acceleration,
            deceleration,
            quick_stop: rate(0x6085, 0, config.acceleration).unwrap_or(deceleration),
            range: [get(0x607D, 1).unwrap_or(f64::from(i32::MIN)), get(0x607D, 2).unwrap_or(f64::from(i32::MAX))],
            following_window: window(0x6065),
            following_time: millis(0x6066),
            position_window: window(0x6067),
            velocity_window: get(0x606D, 0).map_or(f64::INFINITY, |window| window * config.velocity),
            standstill: get(0x606F, 0).unwrap_or(0.0).max(0.5) * config.velocity,
            interpolation: period(objects.get(0x60C2, 1), objects.get(0x60C2, 2)),
            homing_method: objects.get(0x6098, 0).unwrap_or(0) as i8,
            homing_speeds: [1, 2].map(|sub| rate(0x6099, sub, config.velocity).unwrap_or(config.velocity)),
            homing_acceleration: rate(0x609A, 0, config.acceleration).unwrap_or(acceleration),
            home_offset: get(0x607C, 0).unwrap_or(0.0),
            home_position: get(0x2081, 0).unwrap_or(0.0),
            supported: objects.get(0x6502, 0).map_or(u32::MAX, |bits| bits as u32),
            mode: objects.get(0x6060, 0).and_then(|code| Mode::from_code(code as i8)),
            ..Self::default()
        };
        settings.targets(objects, config);
        settings
    }

    /// The set-points alone: they come with each PDO.
    pub fn targets(&mut self, objects: &Dictionary, config: &Config) {
        let get = |index, sub| objects.get(index, sub).unwrap_or(0) as f64;
        self.position = get(0x607A, 0);
        self.interpolated = get(0x60C1, 1);
        self.velocity = (get(0x60FF, 0) * config.velocity).max(-self.max_speed).min(self.max_speed);
    }

    /// The limits of a profile at this speed.
    pub fn limits(&self, speed: f64) -> Limits {
        Limits { speed, acceleration: self.acceleration, deceleration: self.deceleration }
    }
}

/// 0x60C2 in seconds: mantissa times ten to the exponent; 0 if absent.
fn period(mantissa: Option<i64>, exponent: Option<i64>) -> f64 {
    let (Some(mantissa), Some(exponent)) = (mantissa, exponent) else {
        return 0.0;
    };
    let power = (0..exponent.unsigned_abs().min(9)).fold(1.0, |power, _| power * 10.0);
    let mantissa = mantissa as f64;
    if exponent < 0 { mantissa / power } else { mantissa * power }
}
