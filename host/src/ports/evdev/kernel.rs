//! An event device of the kernel (`linux/input.h`): its description and its events.

use crate::sys;
use base::gamepad::{self, Axis, Button, Device, Event};
use nix::errno::Errno;
use nix::fcntl::{OFlag, open};
use nix::libc;
use nix::sys::stat::Mode;
use nix::unistd::read;
use std::collections::VecDeque;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::Path;

// Event types and codes (linux/input-event-codes.h).
const EV_SYN: u16 = 0;
const EV_KEY: u16 = 1;
const EV_ABS: u16 = 3;
const SYN_REPORT: u16 = 0;
const SYN_DROPPED: u16 = 3;
const ABS_COUNT: usize = 0x40;
const KEY_COUNT: usize = 0x300;
/// Codes below are keyboard keys.
const BTN_MISC: u16 = 0x100;
const BTN_TOOL_PEN: u16 = 0x140;
const BTN_TOUCH: u16 = 0x14A;

// Numbers of EVIOCG… requests (linux/input.h).
const NAME: u8 = 0x06;
const KEYS_HELD: u8 = 0x18;
const BITS: u8 = 0x20;
const ABS: u8 = 0x40;

/// Size of `struct input_event`: a time, then type, code, value.
const EVENT: usize = size_of::<libc::input_event>();
/// Maximum number of events per read.
const EVENTS: usize = 32;

/// An open event device.
pub struct Kernel {
    file: OwnedFd,
    /// Events were lost: the rest of the frame is discarded, then the state is queried.
    lost: bool,
}

/// A bit of a bit field that the kernel fills in machine words.
fn bit(bits: &[u8], number: usize) -> bool {
    // On a big-endian machine the bytes of a word are in reverse order.
    let word = size_of::<libc::c_ulong>();
    let byte = if cfg!(target_endian = "big") { (number / 8) ^ (word - 1) } else { number / 8 };
    bits.get(byte).is_some_and(|byte| byte >> (number % 8) & 1 != 0)
}

fn errno(error: io::Error) -> Errno {
    Errno::from_raw(error.raw_os_error().unwrap_or(0))
}

impl Kernel {
    /// Opens a device file.
    pub fn open(path: &Path) -> nix::Result<Self> {
        let flags = OFlag::O_RDONLY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC | OFlag::O_NOCTTY;
        Ok(Self { file: open(path, flags, Mode::empty())?, lost: false })
    }

    /// Grabs the device exclusively.
    pub fn grab(&self) -> nix::Result<()> {
        sys::grab_events(self.file.as_fd()).map_err(errno)
    }

    pub fn fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }

    fn ask<const N: usize>(&self, number: u8) -> nix::Result<[u8; N]> {
        let mut answer = [0; N];
        sys::event_query(self.file.as_fd(), number, &mut answer).map_err(errno)?;
        Ok(answer)
    }

    /// Queries the description and the current state.
    pub fn describe(&self) -> nix::Result<Device> {
        let name = self.ask::<256>(NAME)?;
        let name = String::from_utf8_lossy(name.split(|byte| *byte == 0).next().unwrap_or_default()).into_owned();
        let (axes, keys) =
            (self.ask::<{ ABS_COUNT / 8 }>(BITS + EV_ABS as u8)?, self.ask::<{ KEY_COUNT / 8 }>(BITS + EV_KEY as u8)?);
        let held = self.ask::<{ KEY_COUNT / 8 }>(KEYS_HELD)?;
        let mut device = Device::new(&name);
        for code in (0..ABS_COUNT as u16).filter(|code| bit(&axes, usize::from(*code))) {
            // value, minimum, maximum, fuzz, flat, resolution
            let info = self.ask::<24>(ABS + code as u8)?;
            let (numbers, _) = info.as_chunks::<4>();
            let [value, min, max, fuzz, flat, _] = std::array::from_fn(|place| i32::from_ne_bytes(numbers[place]));
            device.add_axis(Axis { code, min, max, fuzz, flat, value });
        }
        for code in (BTN_MISC..KEY_COUNT as u16).filter(|code| bit(&keys, usize::from(*code))) {
            device.add_button(Button { code, pressed: bit(&held, usize::from(code)) });
        }
        Ok(device)
    }

    /// Reads available events. An error means that the device is lost: ENODEV after unplugging.
    pub fn read(&mut self, events: &mut VecDeque<Event>) -> nix::Result<()> {
        let mut bytes = [0; EVENT * EVENTS];
        let count = match read(&self.file, &mut bytes) {
            Ok(0) => return Err(Errno::ENODEV),
            Ok(count) => count,
            Err(Errno::EAGAIN | Errno::EINTR) => return Ok(()),
            Err(errno) => return Err(errno),
        };
        for event in bytes[..count].chunks_exact(EVENT) {
            let Some(&[a, b, c, d, value @ ..]) = event.last_chunk::<8>() else { continue };
            let (kind, code) = (u16::from_ne_bytes([a, b]), u16::from_ne_bytes([c, d]));
            self.on_event(kind, code, i32::from_ne_bytes(value), events)?;
        }
        Ok(())
    }

    fn on_event(&mut self, kind: u16, code: u16, value: i32, events: &mut VecDeque<Event>) -> nix::Result<()> {
        match (kind, code, value) {
            (EV_SYN, SYN_DROPPED, _) => self.lost = true,
            (EV_SYN, SYN_REPORT, _) if self.lost => {
                self.lost = false;
                events.push_back(Event::Found(Box::new(self.describe()?)));
            }
            _ if self.lost => {}
            (EV_SYN, SYN_REPORT, _) => events.push_back(Event::Frame),
            (EV_ABS, ..) => events.push_back(Event::Axis { code, value }),
            // Value 2 is the repetition of a key that is held.
            (EV_KEY, BTN_MISC.., 0 | 1) => events.push_back(Event::Button { code, pressed: value == 1 }),
            _ => {}
        }
        Ok(())
    }
}

/// True if `auto` accepts the device: two axes and a button, and not a tablet or touch screen.
pub fn is_gamepad(device: &Device) -> bool {
    let has = |code: u16| device.button(code).is_some();
    device.axes().len() >= 2
        && device.buttons().iter().any(|button| gamepad::is_button(button.code))
        && !has(BTN_TOUCH)
        && !has(BTN_TOOL_PEN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bit_is_found_in_words_of_the_machine() {
        let words: [libc::c_ulong; 2] = [1 << 3 | 1 << 9, 1];
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_ne_bytes()).collect();
        let set: Vec<usize> = (0..200).filter(|number| bit(&bytes, *number)).collect();
        assert_eq!(set, [3, 9, libc::c_ulong::BITS as usize]);
    }

    #[test]
    fn a_gamepad_is_distinguished_from_other_input_devices() {
        let device = |axes: &[u16], buttons: &[u16]| {
            let mut device = Device::new("x");
            for code in axes {
                device.add_axis(Axis { code: *code, min: 0, max: 255, fuzz: 0, flat: 0, value: 0 });
            }
            buttons.iter().for_each(|code| assert!(device.add_button(Button { code: *code, pressed: false })));
            is_gamepad(&device)
        };
        assert!(device(&[0, 1], &[gamepad::BTN_SOUTH]) && device(&[0x10, 0x11], &[0x2C0]));
        // An absolute mouse of a virtual machine; a tablet with keys; the touch pad of a gamepad; its motion sensor.
        for (axes, buttons) in
            [(&[0, 1][..], &[0x110, 0x111][..]), (&[0, 1, 2], &[0x100, 0x140, 0x14A]), (&[0, 1], &[0x110, 0x14A])]
        {
            assert!(!device(axes, buttons), "{buttons:x?}");
        }
        assert!(!device(&[0, 1, 2, 3, 4, 5], &[]) && !device(&[0], &[gamepad::BTN_SOUTH]));
    }
}
