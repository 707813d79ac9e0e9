//! Encoding of gamepad inputs.

use super::Malformed;
use super::wire::{self, Decoder};
use base::gamepad::{Axis, Button, Device, Event, Input};

// First byte of each input. Numbers are never reused.
const FOUND: u8 = 1;
const GONE: u8 = 2;
const AXIS: u8 = 3;
const PRESSED: u8 = 4;
const LET_GO: u8 = 5;
const FRAME: u8 = 6;

/// Appends an input.
pub(super) fn gamepad(out: &mut Vec<u8>, input: Input<'_>) {
    let mut coded = |kind: u8, code: u16| {
        out.push(kind);
        wire::varint(out, code.into());
    };
    match input {
        Input::Found(device) => put_device(out, device),
        Input::Gone => out.push(GONE),
        Input::Axis { code, value } => {
            coded(AXIS, code);
            wire::signed(out, value.into());
        }
        Input::Button { code, pressed: true } => coded(PRESSED, code),
        Input::Button { code, pressed: false } => coded(LET_GO, code),
        Input::Frame => out.push(FRAME),
    }
}

fn put_device(out: &mut Vec<u8>, device: &Device) {
    out.push(FOUND);
    wire::text(out, device.name());
    wire::varint(out, device.axes().len() as u64);
    for axis in device.axes() {
        wire::varint(out, axis.code.into());
        for number in [axis.min, axis.max, axis.fuzz, axis.flat, axis.value] {
            wire::signed(out, number.into());
        }
    }
    wire::varint(out, device.buttons().len() as u64);
    for button in device.buttons() {
        wire::varint(out, button.code.into());
        out.push(button.pressed.into());
    }
}

/// Parses an input.
pub(super) fn take_gamepad(take: &mut Decoder<'_>) -> Result<Event, Malformed> {
    Ok(match take.u8()? {
        FOUND => Event::Found(Box::new(take_device(take)?)),
        GONE => Event::Gone,
        AXIS => Event::Axis { code: take.small()?, value: take_i32(take)? },
        PRESSED => Event::Button { code: take.small()?, pressed: true },
        LET_GO => Event::Button { code: take.small()?, pressed: false },
        FRAME => Event::Frame,
        _ => return Err(Malformed("known news of a gamepad")),
    })
}

fn take_device(take: &mut Decoder<'_>) -> Result<Device, Malformed> {
    let name = take.text()?;
    let mut device = Device::new(name);
    let mut fits = device.name() == name;
    for _ in 0..take.count()? {
        let code = take.small()?;
        let mut number = || take_i32(take);
        let (min, max, fuzz, flat, value) = (number()?, number()?, number()?, number()?, number()?);
        fits &= device.axis(code).is_none() && device.add_axis(Axis { code, min, max, fuzz, flat, value });
    }
    for _ in 0..take.count()? {
        let (code, pressed) = (take.small()?, take.flag()?);
        fits &= device.button(code).is_none() && device.add_button(Button { code, pressed });
    }
    if fits { Ok(device) } else { Err(Malformed("a gamepad")) }
}

fn take_i32(take: &mut Decoder<'_>) -> Result<i32, Malformed> {
    i32::try_from(take.signed()?).map_err(|_| Malformed("a number in its range"))
}
