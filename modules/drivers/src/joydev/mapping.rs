//! Assignment of a device's axes and buttons, and reasons why a device cannot drive the robot.
//!
//! A gamepad by the kernel's rule (`Documentation/input/gamepad.rst`) has `BTN_SOUTH`, its left stick is `ABS_X` and
//! `ABS_Y`, its right one `ABS_RX` and `ABS_RY`. A joystick has `BTN_TRIGGER` and `ABS_X`, `ABS_Y`. Values grow to the
//! right and towards the user.

use super::config::{Commands, Config, StickConfig};
use base::gamepad::{
    ABS_HAT0X, ABS_HAT0Y, ABS_RX, ABS_RY, ABS_RZ, ABS_WHEEL, ABS_X, ABS_Y, Axis, BTN_SOUTH, BTN_TL, BTN_TR,
    BTN_TRIGGER, Device, axis_name, button_name, is_button,
};
use std::borrow::Cow;
use std::fmt;

/// Axes for the speed, in order of preference.
const SPEED: &[u16] = &[ABS_Y, ABS_RY, ABS_HAT0Y];
/// Axes for the steering of a gamepad, and of other devices.
const STEERING_OF_PAD: &[u16] = &[ABS_RX, ABS_X, ABS_HAT0X];
const STEERING: &[u16] = &[ABS_X, ABS_RX, ABS_WHEEL, ABS_HAT0X];
/// Axes to go sideways of a gamepad, whose `ABS_RZ` is a trigger or goes forward and back, and of other devices.
const SIDEWAYS_OF_PAD: &[u16] = &[ABS_X, ABS_RX, ABS_HAT0X];
const SIDEWAYS: &[u16] = &[ABS_X, ABS_RX, ABS_RZ, ABS_HAT0X];
/// Dead-man buttons, in order of preference.
const DEAD_MAN: &[u16] = &[BTN_TL, BTN_TRIGGER];
/// Creep button.
const CREEP: u16 = BTN_TR;

/// Assignment of a device's axes and buttons.
#[derive(Clone, Debug, PartialEq)]
pub struct Mapping {
    /// Axis of the speed, m/s; forward is positive.
    pub speed: Stick,
    /// Axis of the steering, rad, or of the rotation, rad/s; left is positive.
    pub steering: Stick,
    /// Axis to go sideways, m/s; left is positive. `None`: the base does not, or the device has no axis for it.
    pub sideways: Option<Stick>,
    /// Button that must be held for the sticks to move the robot.
    pub dead_man: u16,
    /// Button by which the robot creeps past the guard; `None`: the gamepad has none.
    pub creep: Option<u16>,
}

/// Reason why a device cannot drive the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// It has no axis for this purpose.
    NoAxis(&'static str),
    /// It lacks the axis that is configured for this purpose.
    AxisMissing(&'static str, u16),
    /// It has only one axis for both.
    OneAxis(u16),
    /// The range of an axis is too small or inverted.
    NoRange(Axis),
    /// It has no button.
    NoButton,
    /// It lacks the configured dead-man button.
    ButtonMissing(u16),
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NoAxis(what) => write!(f, "it has no axis for the {what}"),
            Self::AxisMissing(what, code) => write!(f, "it has no {}, which is configured for the {what}", axis(code)),
            Self::OneAxis(code) => write!(f, "it has only {} for speed and steering", axis(code)),
            Self::NoRange(Axis { code, min, max, .. }) => write!(f, "its {} goes from {min} to {max}", axis(code)),
            Self::NoButton => f.write_str("it has no button for the dead man"),
            Self::ButtonMissing(code) => write!(f, "it has no {}, which is configured for the dead man", button(code)),
        }
    }
}

/// Name of an axis for people.
pub fn axis(code: u16) -> Cow<'static, str> {
    axis_name(code).map_or_else(|| format!("axis {code:#04x}").into(), Cow::Borrowed)
}

/// Name of a button for people.
pub fn button(code: u16) -> Cow<'static, str> {
    button_name(code).map_or_else(|| format!("button {code:#05x}").into(), Cow::Borrowed)
}

impl Mapping {
    /// Assigns axes and buttons by the configuration, or else by those that the device has.
    pub fn of(config: &Config, commands: Commands, device: &Device) -> Result<Self, Refusal> {
        let is_pad = device.button(BTN_SOUTH).is_some();
        let (steering, aside) = if is_pad { (STEERING_OF_PAD, SIDEWAYS_OF_PAD) } else { (STEERING, SIDEWAYS) };
        let goes_sideways = commands == Commands::Velocity { sideways: true };
        // An axis that is configured for one purpose is not used for another.
        let sideways = config.sideways.axis.filter(|_| goes_sideways);
        let speed = pick(device, "speed", config.speed.axis, [config.steering.axis, sideways], SPEED)?;
        let steering = pick(device, "steering", config.steering.axis, [Some(speed.code), sideways], steering)?;
        let taken = [Some(speed.code), Some(steering.code)];
        let sideways = match sideways {
            Some(_) => Some(pick(device, "motion sideways", sideways, taken, aside)?),
            None => aside.iter().filter(|_| goes_sideways).find_map(|code| free(device, *code, taken)),
        };
        let has = |code: &u16| device.button(*code).is_some();
        let dead_man = match config.dead_man {
            Some(code) if has(&code) => code,
            Some(code) => return Err(Refusal::ButtonMissing(code)),
            None => {
                let any = device.buttons().iter().map(|button| button.code).filter(|code| is_button(*code)).min();
                DEAD_MAN.iter().copied().find(has).or(any).ok_or(Refusal::NoButton)?
            }
        };
        Ok(Self {
            speed: Stick::new(&config.speed, speed)?,
            steering: Stick::new(&config.steering, steering)?,
            sideways: sideways.map(|axis| Stick::new(&config.sideways, axis)).transpose()?,
            dead_man,
            creep: creep(config, dead_man).filter(has),
        })
    }

    /// All its axes.
    pub fn sticks(&self) -> impl Iterator<Item = &Stick> {
        [&self.speed, &self.steering].into_iter().chain(&self.sideways)
    }
}

/// Creep button: the configured one, else the usual one unless it has another function.
fn creep(config: &Config, dead_man: u16) -> Option<u16> {
    let gears = [config.slow, config.fast].into_iter().flatten().map(|gear| gear.button);
    config.creep.or_else(|| gears.chain([dead_man]).all(|taken| taken != CREEP).then_some(CREEP))
}

/// Selects the axis for a purpose: the configured one, else the first of the usual ones, else any.
fn pick<'a>(
    device: &'a Device,
    what: &'static str,
    set: Option<u16>,
    taken: [Option<u16>; 2],
    usual: &[u16],
) -> Result<&'a Axis, Refusal> {
    if let Some(code) = set {
        return match device.axis(code) {
            Some(axis) if !taken.contains(&set) => Ok(axis),
            Some(_) => Err(Refusal::OneAxis(code)),
            None => Err(Refusal::AxisMissing(what, code)),
        };
    }
    let any = || device.axes().iter().filter(|axis| !taken.contains(&Some(axis.code))).min_by_key(|axis| axis.code);
    match usual.iter().find_map(|code| free(device, *code, taken)).or_else(any) {
        Some(axis) => Ok(axis),
        None => Err(device.axes().first().map_or(Refusal::NoAxis(what), |axis| Refusal::OneAxis(axis.code))),
    }
}

/// An axis that the device has and nothing else uses.
fn free(device: &Device, code: u16, taken: [Option<u16>; 2]) -> Option<&Axis> {
    device.axis(code).filter(|_| !taken.contains(&Some(code)))
}

/// An axis with its conversion to a requested value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stick {
    /// `ABS_…`
    pub code: u16,
    min: i32,
    max: i32,
    sign: f64,
    dead_zone: f64,
    expo: f64,
    limit: f64,
}

impl Stick {
    fn new(config: &StickConfig, axis: &Axis) -> Result<Self, Refusal> {
        // With minimum above maximum the device's description is wrong: the kernel passes on 0 to -1 for a byte whose
        // upper end was misread.
        if i64::from(axis.max) - i64::from(axis.min) < 2 {
            return Err(Refusal::NoRange(*axis));
        }
        let half = (f64::from(axis.max) - f64::from(axis.min)) / 2.0;
        // A dead zone that leaves less than a tenth of the range is invalid.
        let flat = Some(f64::from(axis.flat) / half).filter(|flat| (0.0..=0.9).contains(flat));
        Ok(Self {
            code: axis.code,
            min: axis.min,
            max: axis.max,
            sign: if config.inverted { 1.0 } else { -1.0 },
            dead_zone: config.dead_zone.max(flat.unwrap_or(0.0)),
            expo: config.expo,
            limit: config.limit,
        })
    }

    /// Relative deflection, -1 to 1; values beyond an end are clamped.
    fn deflection(&self, raw: i32) -> f64 {
        let (min, max, raw) = (f64::from(self.min), f64::from(self.max), f64::from(raw.clamp(self.min, self.max)));
        (2.0 * (raw - min) / (max - min) - 1.0).clamp(-1.0, 1.0)
    }

    /// True if the stick is centred.
    pub fn is_centred(&self, raw: i32) -> bool {
        // The middle of 0 to 255 is between two values.
        let step = 1.0 / (f64::from(self.max) - f64::from(self.min));
        self.deflection(raw).abs() <= self.dead_zone.max(step)
    }

    /// Requested value, limited to the configured limit either way.
    pub fn value(&self, raw: i32) -> f64 {
        if self.is_centred(raw) {
            return 0.0;
        }
        let deflection = self.deflection(raw);
        let size = (deflection.abs() - self.dead_zone) / (1.0 - self.dead_zone);
        let size = (1.0 - self.expo) * size + self.expo * size * size * size;
        (self.limit * size.min(1.0)).copysign(self.sign * deflection)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{config, pad};
    use super::*;
    use base::gamepad::{ABS_Z, BTN_THUMB, Button};

    const STICK: StickConfig = StickConfig { axis: None, inverted: false, dead_zone: 0.1, expo: 0.0, limit: 0.6 };

    fn raw(code: u16, min: i32, max: i32) -> Axis {
        Axis { code, min, max, fuzz: 0, flat: 0, value: 0 }
    }

    fn stick(config: StickConfig, min: i32, max: i32) -> Stick {
        Stick::new(&config, &raw(ABS_Y, min, max)).unwrap()
    }

    fn device(axes: &[Axis], buttons: &[u16]) -> Device {
        let mut device = Device::new("odd");
        axes.iter().for_each(|axis| assert!(device.add_axis(*axis)));
        buttons.iter().for_each(|code| assert!(device.add_button(Button { code: *code, pressed: false })));
        device
    }

    fn mapped(device: &Device) -> Result<(u16, u16, u16), String> {
        let mapping = Mapping::of(&config(), Commands::Motion, device).map_err(|refusal| refusal.to_string())?;
        Ok((mapping.speed.code, mapping.steering.code, mapping.dead_man))
    }

    #[test]
    fn the_ends_give_the_limit_and_the_middle_zero() {
        let stick = stick(STICK, 0, 255);
        assert_eq!([0, 127, 128, 255].map(|raw| stick.value(raw)), [0.6, 0.0, 0.0, -0.6]);
        // 10 % of 127.5 around 127.5.
        assert!(stick.is_centred(115) && !stick.is_centred(114) && stick.is_centred(140) && !stick.is_centred(141));
        assert!(stick.value(114) > 0.0 && stick.value(114) < 0.01, "it begins softly");
        assert_eq!([i32::MIN, i32::MAX].map(|raw| stick.value(raw)), [0.6, -0.6], "beyond the ends");
    }

    #[test]
    fn expo_is_fine_near_the_middle_and_keeps_the_ends() {
        let stick = stick(StickConfig { expo: 0.5, dead_zone: 0.0, inverted: true, ..STICK }, -1000, 1000);
        assert_eq!([-1000, 0, 1000].map(|raw| stick.value(raw)), [-0.6, 0.0, 0.6]);
        assert!((stick.value(500) - 0.6 * (0.25 + 0.0625)).abs() < 1e-12);
    }

    #[test]
    fn every_range_gives_numbers_within_the_limit() {
        let values = [i32::MIN, i32::MIN + 1, -40_000, -1, 0, 1, 255, 40_000, i32::MAX - 1, i32::MAX];
        for min in values {
            for max in values.into_iter().filter(|max| i64::from(*max) - i64::from(min) > 1) {
                for config in [STICK, StickConfig { expo: 1.0, dead_zone: 0.9, ..STICK }] {
                    let stick = stick(config, min, max);
                    let all = values.map(|raw| stick.value(raw));
                    assert!(all.iter().all(|demand| demand.abs() <= 0.6), "{min} {max} {all:?}");
                    assert!(all.is_sorted_by(|a, b| a >= b), "{min} {max} {all:?}");
                    assert!(stick.value(min) == 0.6 && stick.value(max) == -0.6, "{min} {max} {all:?}");
                }
            }
        }
    }

    #[test]
    fn a_valid_dead_zone_of_the_device_is_used() {
        let dead_zone = |flat| Stick::new(&STICK, &Axis { flat, ..raw(ABS_Y, -100, 100) }).unwrap().dead_zone;
        assert_eq!([0, 5, 30, 90, 91, -7, i32::MAX].map(dead_zone), [0.1, 0.1, 0.3, 0.9, 0.1, 0.1, 0.1]);
    }

    #[test]
    fn an_axis_without_a_range_is_rejected() {
        for (min, max) in [(5, 5), (0, 1), (0, -1), (i32::MAX, i32::MIN)] {
            let odd = device(&[raw(ABS_X, 0, 255), raw(ABS_Y, min, max)], &[BTN_TL]);
            assert_eq!(mapped(&odd), Err(format!("its ABS_Y goes from {min} to {max}")));
        }
    }

    #[test]
    fn axes_and_buttons_are_assigned_by_kind_of_device() {
        let axes = |codes: &[u16]| codes.iter().map(|code| raw(*code, -1, 1)).collect::<Vec<_>>();
        let of = |codes: &[u16], buttons: &[u16]| mapped(&device(&axes(codes), buttons));
        assert_eq!(mapped(&pad()), Ok((ABS_Y, ABS_RX, BTN_TL)));
        // A gamepad without a right stick; a joystick; a wheel; a pad with only a D-pad; two sticks of any name.
        assert_eq!(of(&[ABS_X, ABS_Y], &[BTN_SOUTH, BTN_TL]), Ok((ABS_Y, ABS_X, BTN_TL)));
        assert_eq!(of(&[ABS_X, ABS_Y, ABS_RX], &[BTN_THUMB, BTN_TRIGGER]), Ok((ABS_Y, ABS_X, BTN_TRIGGER)));
        assert_eq!(of(&[ABS_WHEEL, ABS_Y], &[0x123]), Ok((ABS_Y, ABS_WHEEL, 0x123)));
        assert_eq!(of(&[ABS_HAT0X, ABS_HAT0Y], &[0x2C5, 0x104]), Ok((ABS_HAT0Y, ABS_HAT0X, 0x104)));
        assert_eq!(of(&[0x29, ABS_Z], &[BTN_SOUTH]), Ok((ABS_Z, 0x29, BTN_SOUTH)));
    }

    #[test]
    fn an_incomplete_device_is_rejected_with_the_reason() {
        let one = device(&[raw(ABS_Y, 0, 255)], &[BTN_TL]);
        assert_eq!(mapped(&one).unwrap_err(), "it has only ABS_Y for speed and steering");
        assert_eq!(mapped(&device(&[], &[BTN_TL])).unwrap_err(), "it has no axis for the speed");
        let (left_of_a_mouse, axes) = (0x110, [raw(ABS_X, 0, 255), raw(ABS_Y, 0, 255)]);
        assert_eq!(mapped(&device(&axes, &[left_of_a_mouse])).unwrap_err(), "it has no button for the dead man");
    }

    #[test]
    fn configured_axes_and_buttons_must_exist() {
        let refused = |change: fn(&mut Config)| {
            let mut config = config();
            change(&mut config);
            Mapping::of(&config, Commands::Motion, &pad()).unwrap_err().to_string()
        };
        assert_eq!(
            refused(|c| c.speed.axis = Some(ABS_WHEEL)),
            "it has no ABS_WHEEL, which is configured for the speed"
        );
        assert_eq!(
            refused(|c| c.steering.axis = Some(0x3F)),
            "it has no axis 0x3f, which is configured for the steering"
        );
        assert_eq!(
            refused(|c| c.dead_man = Some(0x2FF)),
            "it has no button 0x2ff, which is configured for the dead man"
        );
        let creep = |config: &Config| Mapping::of(config, Commands::Motion, &pad()).unwrap().creep;
        assert_eq!(creep(&config()), Some(BTN_TR));
        assert_eq!(creep(&Config { creep: Some(BTN_SOUTH), ..config() }), Some(BTN_SOUTH));
        assert_eq!(creep(&Config { creep: Some(BTN_THUMB), ..config() }), None, "it drives without");
        assert_eq!(creep(&Config { dead_man: Some(BTN_TR), ..config() }), None);
        let slow = Some(super::super::Gear { button: BTN_TR, scale: 0.5 });
        assert_eq!(creep(&Config { slow, ..config() }), None, "as it was configured before there was a guard");
        let swapped = Config { steering: StickConfig { axis: Some(ABS_Y), ..STICK }, ..config() };
        let mapping = Mapping::of(&swapped, Commands::Motion, &pad()).unwrap();
        assert_eq!((mapping.speed.code, mapping.steering.code), (ABS_RY, ABS_Y), "the speed takes the remaining axis");
    }

    #[test]
    fn the_axis_to_go_sideways_is_one_that_is_free_and_the_device_may_lack_it() {
        let axes = |codes: &[u16]| codes.iter().map(|code| raw(*code, -1, 1)).collect::<Vec<_>>();
        let sideways = |config: &Config, commands, device: &Device| {
            Mapping::of(config, commands, device).map(|mapping| mapping.sideways.map(|stick| stick.code))
        };
        let able = Commands::Velocity { sideways: true };
        assert_eq!(sideways(&config(), able, &pad()), Ok(Some(ABS_X)));
        for commands in [Commands::Motion, Commands::Velocity { sideways: false }] {
            assert_eq!(sideways(&config(), commands, &pad()), Ok(None));
        }
        let joystick = device(&axes(&[ABS_X, ABS_Y, ABS_RZ]), &[BTN_TRIGGER]);
        assert_eq!(sideways(&config(), able, &joystick), Ok(Some(ABS_RZ)), "a stick that turns");
        let triggers = device(&axes(&[ABS_X, ABS_Y, ABS_Z, ABS_RZ]), &[BTN_SOUTH, BTN_TL]);
        assert_eq!(sideways(&config(), able, &triggers), Ok(None), "a trigger is no stick");
        let two = device(&axes(&[ABS_X, ABS_Y]), &[BTN_TRIGGER]);
        assert_eq!(sideways(&config(), able, &two), Ok(None), "it drives without");
        let set = |code| Config { sideways: StickConfig { axis: Some(code), ..STICK }, ..config() };
        assert_eq!(sideways(&set(ABS_RX), able, &pad()), Ok(Some(ABS_RX)));
        let mapping = Mapping::of(&set(ABS_RX), able, &pad()).unwrap();
        assert_eq!(mapping.steering.code, ABS_X, "the steering takes the remaining axis");
        assert_eq!(sideways(&set(ABS_WHEEL), able, &pad()), Err(Refusal::AxisMissing("motion sideways", ABS_WHEEL)));
    }
}
