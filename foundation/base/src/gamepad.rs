//! A gamepad or joystick in the terms of Linux's event interface: its axes and buttons, and their events.
//!
//! Codes are those of `linux/input-event-codes.h`, ranges those of `struct input_absinfo` (`linux/input.h`). The
//! purpose of axes and buttons is described in the kernel's `Documentation/input/gamepad.rst`.

use alloc::boxed::Box;
use heapless::{String, Vec};

/// Axes kept of a device; those with the lowest codes.
pub const AXES_MAX: usize = 32;
/// Buttons kept of a device; those with the lowest codes.
pub const BUTTONS_MAX: usize = 64;
/// Bytes kept of a device's name.
pub const NAME_MAX: usize = 80;

/// An axis and where it is. Nothing promises that `min` is below `max`, or that `value` is between them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axis {
    /// `ABS_…`
    pub code: u16,
    /// The least value.
    pub min: i32,
    /// The greatest value.
    pub max: i32,
    /// Changes up to this are noise.
    pub fuzz: i32,
    /// Half width of the dead zone around the middle.
    pub flat: i32,
    /// Present value.
    pub value: i32,
}

/// A button and how it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Button {
    /// `BTN_…`
    pub code: u16,
    /// True if it is held.
    pub pressed: bool,
}

/// Full description and state of a device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Device {
    name: String<NAME_MAX>,
    axes: Vec<Axis, AXES_MAX>,
    buttons: Vec<Button, BUTTONS_MAX>,
}

impl Device {
    /// A device without axes and buttons; of its name so much is kept as there is room for, without control
    /// characters, and without spaces around it.
    #[must_use]
    pub fn new(name: &str) -> Self {
        let mut device = Self::default();
        for letter in name.chars().filter(|letter| !letter.is_control()) {
            let leads = device.name.is_empty() && letter.is_whitespace();
            if !leads && device.name.push(letter).is_err() {
                break;
            }
        }
        while device.name.ends_with(char::is_whitespace) {
            device.name.pop();
        }
        device
    }

    /// Adds an axis, or takes the place of the one with its code; false when there is no room.
    pub fn add_axis(&mut self, axis: Axis) -> bool {
        match self.axes.iter_mut().find(|own| own.code == axis.code) {
            Some(own) => *own = axis,
            None => return self.axes.push(axis).is_ok(),
        }
        true
    }

    /// Adds a button, or takes the place of the one with its code; false when there is no room.
    pub fn add_button(&mut self, button: Button) -> bool {
        match self.buttons.iter_mut().find(|own| own.code == button.code) {
            Some(own) => *own = button,
            None => return self.buttons.push(button).is_ok(),
        }
        true
    }

    /// Name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Axes.
    #[must_use]
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// Buttons.
    #[must_use]
    pub fn buttons(&self) -> &[Button] {
        &self.buttons
    }

    /// The axis of a code.
    #[must_use]
    pub fn axis(&self, code: u16) -> Option<&Axis> {
        self.axes.iter().find(|axis| axis.code == code)
    }

    /// True if the button of a code is held; none when it has no such button.
    #[must_use]
    pub fn button(&self, code: u16) -> Option<bool> {
        self.buttons.iter().find(|button| button.code == code).map(|button| button.pressed)
    }

    /// An axis has moved; what it has not is ignored.
    pub fn set_axis(&mut self, code: u16, value: i32) {
        if let Some(axis) = self.axes.iter_mut().find(|axis| axis.code == code) {
            axis.value = value;
        }
    }

    /// A button was pressed or let go; what it has not is ignored.
    pub fn set_button(&mut self, code: u16, pressed: bool) {
        if let Some(button) = self.buttons.iter_mut().find(|button| button.code == code) {
            button.pressed = pressed;
        }
    }
}

/// Event of a gamepad's port; `D` is the gamepad, borrowed or owned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnyEvent<D> {
    /// Present, with its full state: after plugging in, and after lost events, when the kernel is asked again.
    Found(D),
    /// Unplugged, or absent.
    Gone,
    /// An axis has moved.
    Axis {
        /// `ABS_…`
        code: u16,
        /// New value.
        value: i32,
    },
    /// A button was pressed or let go.
    Button {
        /// `BTN_…`
        code: u16,
        /// True if it is held.
        pressed: bool,
    },
    /// Events since the last frame happened at once (`SYN_REPORT`).
    Frame,
}

/// Event that a port reports.
pub type Input<'a> = AnyEvent<&'a Device>;
/// Owned event: the output of a simulated gamepad.
pub type Event = AnyEvent<Box<Device>>;

impl<D> AnyEvent<D> {
    fn map<'a, E>(&'a self, device: impl FnOnce(&'a D) -> E) -> AnyEvent<E> {
        match *self {
            Self::Found(ref found) => AnyEvent::Found(device(found)),
            Self::Gone => AnyEvent::Gone,
            Self::Axis { code, value } => AnyEvent::Axis { code, value },
            Self::Button { code, pressed } => AnyEvent::Button { code, pressed },
            Self::Frame => AnyEvent::Frame,
        }
    }
}

impl Event {
    /// Borrowed event of a port.
    #[must_use]
    pub fn as_input(&self) -> Input<'_> {
        self.map(|device| &**device)
    }
}

impl From<Input<'_>> for Event {
    fn from(input: Input<'_>) -> Self {
        input.map(|device| Box::new(Device::clone(device)))
    }
}

/// Applies an event to the kept state, so that a late reader gets the full state.
pub fn keep(device: &mut Option<Box<Device>>, event: &Event) {
    match (event, device) {
        (Event::Found(found), device) => *device = Some(found.clone()),
        (Event::Gone, device) => *device = None,
        (Event::Axis { code, value }, Some(device)) => device.set_axis(*code, *value),
        (Event::Button { code, pressed }, Some(device)) => device.set_button(*code, *pressed),
        _ => {}
    }
}

macro_rules! codes {
    ($kind:literal, $list:ident, $($name:ident = $code:literal,)*) => {
        $(#[doc = concat!($kind, " ", stringify!($code), ".")] pub const $name: u16 = $code;)*
        const $list: &[(&str, u16)] = &[$((stringify!($name), $name)),*];
    };
}

codes! { "Axis", AXES,
    ABS_X = 0x00, ABS_Y = 0x01, ABS_Z = 0x02, ABS_RX = 0x03, ABS_RY = 0x04, ABS_RZ = 0x05, ABS_THROTTLE = 0x06,
    ABS_RUDDER = 0x07, ABS_WHEEL = 0x08, ABS_GAS = 0x09, ABS_BRAKE = 0x0A, ABS_HAT0X = 0x10, ABS_HAT0Y = 0x11,
    ABS_HAT1X = 0x12, ABS_HAT1Y = 0x13, ABS_HAT2X = 0x14, ABS_HAT2Y = 0x15, ABS_HAT3X = 0x16, ABS_HAT3Y = 0x17,
}

codes! { "Button", BUTTONS,
    BTN_0 = 0x100, BTN_1 = 0x101, BTN_2 = 0x102, BTN_3 = 0x103, BTN_4 = 0x104, BTN_5 = 0x105, BTN_6 = 0x106,
    BTN_7 = 0x107, BTN_8 = 0x108, BTN_9 = 0x109, BTN_TRIGGER = 0x120, BTN_THUMB = 0x121, BTN_THUMB2 = 0x122,
    BTN_TOP = 0x123, BTN_TOP2 = 0x124, BTN_PINKIE = 0x125, BTN_BASE = 0x126, BTN_BASE2 = 0x127, BTN_BASE3 = 0x128,
    BTN_BASE4 = 0x129, BTN_BASE5 = 0x12A, BTN_BASE6 = 0x12B, BTN_DEAD = 0x12F, BTN_SOUTH = 0x130, BTN_EAST = 0x131,
    BTN_C = 0x132, BTN_NORTH = 0x133, BTN_WEST = 0x134, BTN_Z = 0x135, BTN_TL = 0x136, BTN_TR = 0x137,
    BTN_TL2 = 0x138, BTN_TR2 = 0x139, BTN_SELECT = 0x13A, BTN_START = 0x13B, BTN_MODE = 0x13C, BTN_THUMBL = 0x13D,
    BTN_THUMBR = 0x13E, BTN_DPAD_UP = 0x220, BTN_DPAD_DOWN = 0x221, BTN_DPAD_LEFT = 0x222, BTN_DPAD_RIGHT = 0x223,
}

/// The code of an axis by its name.
#[must_use]
pub fn axis_code(name: &str) -> Option<u16> {
    code_of(AXES, name)
}

/// The code of a button by its name.
#[must_use]
pub fn button_code(name: &str) -> Option<u16> {
    code_of(BUTTONS, name)
}

/// The name of an axis; none for a code that has none here.
#[must_use]
pub fn axis_name(code: u16) -> Option<&'static str> {
    name_of(AXES, code)
}

/// The name of a button; none for a code that has none here.
#[must_use]
pub fn button_name(code: u16) -> Option<&'static str> {
    name_of(BUTTONS, code)
}

fn code_of(list: &[(&str, u16)], name: &str) -> Option<u16> {
    list.iter().find(|(own, _)| *own == name).map(|(_, code)| *code)
}

fn name_of(list: &[(&'static str, u16)], code: u16) -> Option<&'static str> {
    list.iter().find(|(_, own)| *own == code).map(|(name, _)| *name)
}

/// True if a button is one of a gamepad or joystick: not a key, nor a button of a mouse, a tablet or a touch screen.
#[must_use]
pub const fn is_button(code: u16) -> bool {
    matches!(code, BTN_0..=0x10F | BTN_TRIGGER..=BTN_THUMBR | BTN_DPAD_UP..=BTN_DPAD_RIGHT | 0x2C0..=0x2E7)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_keeps_what_it_has_room_for() {
        let mut device = Device::new(&"pad\n".repeat(50));
        assert_eq!(device.name().len(), NAME_MAX);
        assert!(!device.name().contains('\n'));
        for code in 0..100 {
            let axis = Axis { code, min: -1, max: 1, fuzz: 0, flat: 0, value: 0 };
            assert_eq!(device.add_axis(axis), usize::from(code) < AXES_MAX);
            assert_eq!(device.add_button(Button { code, pressed: false }), usize::from(code) < BUTTONS_MAX);
        }
        assert!(device.add_axis(Axis { value: 1, ..device.axes()[3] }), "it takes its own place");
        device.set_axis(3, -1);
        device.set_axis(99, -1);
        device.set_button(5, true);
        assert_eq!((device.axis(3).unwrap().value, device.axis(99)), (-1, None));
        assert_eq!((device.button(5), device.button(6), device.button(99)), (Some(true), Some(false), None));
    }

    #[test]
    fn a_name_is_cut_between_letters() {
        assert_eq!(Device::new(&"ř".repeat(41)).name(), "ř".repeat(40));
        assert_eq!(Device::new(&alloc::format!(" \n{} y", "x".repeat(79))).name(), "x".repeat(79));
        assert_eq!(Device::new(&alloc::format!("x{}", "ř".repeat(40))).name().len(), NAME_MAX - 1);
    }

    #[test]
    fn names_and_codes_are_those_of_the_kernel() {
        for (list, first) in [(AXES, "ABS_X"), (BUTTONS, "BTN_0")] {
            assert_eq!(list[0].0, first);
            assert!(list.is_sorted_by(|a, b| a.1 < b.1), "none twice");
        }
        assert_eq!((axis_code("ABS_RX"), axis_name(3)), (Some(3), Some("ABS_RX")));
        assert_eq!((button_code("BTN_TL"), button_name(0x136)), (Some(0x136), Some("BTN_TL")));
        assert_eq!((axis_code("BTN_TL"), button_name(0x110)), (None, None));
        let (left_button_of_a_mouse, touch) = (0x110, 0x14A);
        assert!(is_button(BTN_SOUTH) && !is_button(left_button_of_a_mouse) && !is_button(touch) && !is_button(30));
    }
}
