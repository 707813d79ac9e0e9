//! `[joystick]`: where the gamepad is, and what its axes and buttons are for.

use base::gamepad;
use settings::Table;
use settings::Value;
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// `[joystick]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Joystick {
    /// Where it is.
    pub device: JoystickDevice,
    /// Whether nobody else hears it; default false.
    pub grab: bool,
    /// What asks for the speed; its limit in m/s.
    pub speed: JoystickStick,
    /// What asks for the steering angle; its limit in rad.
    pub steering: JoystickStick,
    /// The dead-man button; none: what such a device has in its place.
    pub dead_man: Option<u16>,
    /// The share of the speed's limit without a button, 0.01..=1; default 1.
    pub scale: f64,
    /// While its button is held the share is another one.
    pub slow: Option<JoystickGear>,
    /// The same.
    pub fast: Option<JoystickGear>,
    /// One that drives and says nothing for so long counts as let go, 0.5..=3600 s; default never.
    pub quiet_s: Option<f64>,
}

/// Where a gamepad is found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum JoystickDevice {
    /// `auto`: the first with two axes and a button.
    Auto,
    /// An event device: `/dev/input/event5`.
    Path(PathBuf),
    /// `file:PATH`: a file, FIFO or socket of lines; a relative path lies in the run folder, where the simulator has a
    /// gamepad.
    Stream(PathBuf),
}

/// `speed = { … }`, `steering = { … }`
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JoystickStick {
    /// Its code; none: what such a device has for this.
    pub axis: Option<u16>,
    /// Towards its greater values is forward or left; default false, as sticks are.
    pub inverted: bool,
    /// The middle is so wide, 0..=0.9 of the way; default 0.1.
    pub dead_zone: f64,
    /// 0..=1, from straight to the cube; default 0.3.
    pub expo: f64,
    /// At its ends, 0.01..=10; default, and at most, what `limits` has for a manual source.
    pub limit: Option<f64>,
}

/// `slow = { … }`, `fast = { … }`
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JoystickGear {
    /// Its code.
    pub button: u16,
    /// 0.01..=1.
    pub scale: f64,
}

const AXES: RangeInclusive<u16> = 0..=0x3F;
const BUTTONS: RangeInclusive<u16> = 0x100..=0x2FF;

impl Joystick {
    pub(super) fn read(mut table: Table<'_>) -> Self {
        let device = table.text("device", Some("auto"));
        let device = match (device.as_str(), device.strip_prefix("file:")) {
            ("auto", _) => JoystickDevice::Auto,
            (_, Some(path)) if !path.is_empty() => JoystickDevice::Stream(path.into()),
            (path, None) if path.starts_with('/') => JoystickDevice::Path(path.into()),
            _ => {
                table.refuse("device", "\"auto\", a device file as \"/dev/input/event5\", or \"file:PATH\"");
                JoystickDevice::Auto
            }
        };
        let grab = table.boolean("grab", false);
        let speed = JoystickStick::read(table.table_if_any("speed"));
        let steering = JoystickStick::read(table.table_if_any("steering"));
        if speed.axis.is_some() && speed.axis == steering.axis {
            table.refuse("steering", "another axis than that of the speed");
        }
        let dead_man = button(&mut table, "dead_man");
        let scale = table.number("scale", Some(1.0), 0.01..=1.0);
        let slow = table.table_if_any("slow").and_then(JoystickGear::read);
        let fast = table.table_if_any("fast").and_then(JoystickGear::read);
        let [slow_button, fast_button] = [slow, fast].map(|gear| gear.map(|gear| gear.button));
        if slow_button.is_some() && slow_button == dead_man {
            table.refuse("slow", "another button than dead_man");
        }
        if fast_button.is_some() && [dead_man, slow_button].contains(&fast_button) {
            table.refuse("fast", "another button than dead_man and slow");
        }
        let quiet_s = number_if_any(&mut table, "quiet_s", 0.5..=3600.0);
        table.end();
        Self { device, grab, speed, steering, dead_man, scale, slow, fast, quiet_s }
    }
}

impl JoystickStick {
    fn read(table: Option<Table<'_>>) -> Self {
        let usual = Self { axis: None, inverted: false, dead_zone: 0.1, expo: 0.3, limit: None };
        let Some(mut table) = table else { return usual };
        let stick = Self {
            axis: code(&mut table, "axis", gamepad::axis_code, AXES, "\"ABS_Y\""),
            inverted: table.boolean("inverted", usual.inverted),
            dead_zone: table.number("dead_zone", Some(usual.dead_zone), 0.0..=0.9),
            expo: table.number("expo", Some(usual.expo), 0.0..=1.0),
            limit: number_if_any(&mut table, "limit", 0.01..=10.0),
        };
        table.end();
        stick
    }
}

impl JoystickGear {
    fn read(mut table: Table<'_>) -> Option<Self> {
        if !table.has("button") {
            table.refuse_missing("button", "the name of a button");
        }
        let button = button(&mut table, "button");
        let scale = table.number("scale", None, 0.01..=1.0);
        table.end();
        Some(Self { button: button?, scale })
    }
}

/// A key that is not there is known all the same.
fn number_if_any(table: &mut Table<'_>, key: &'static str, range: RangeInclusive<f64>) -> Option<f64> {
    table.node(key).is_some().then(|| table.number(key, None, range))
}

fn button(table: &mut Table<'_>, key: &'static str) -> Option<u16> {
    code(table, key, gamepad::button_code, BUTTONS, "\"BTN_TL\"")
}

/// A code by its name, or as a number for what has no name here.
fn code(
    table: &mut Table<'_>,
    key: &'static str,
    by_name: fn(&str) -> Option<u16>,
    range: RangeInclusive<u16>,
    example: &str,
) -> Option<u16> {
    let code = match &table.node(key)?.value {
        Value::String(name) => by_name(name),
        Value::Integer(code) => u16::try_from(*code).ok().filter(|code| range.contains(code)),
        _ => None,
    };
    if code.is_none() {
        table.refuse(
            key,
            format_args!("a name as {example}, or a code from {:#x} to {:#x}", range.start(), range.end()),
        );
    }
    code
}
