//! A gamepad as lines of text: the format of a stream or a file of events, described in docs/gamepad.md.
//!
//! Safe against hostile input: the length of a line is bounded, and an invalid line is reported and skipped.

use base::Duration;
use base::gamepad::{self, Axis, Button, Device, Event};
use std::borrow::Cow;
use std::fmt::Write;

/// Maximum length of a line, bytes.
const LINE_MAX: usize = 256;
/// Maximum wait between two lines, s.
const WAIT_MAX: f64 = 3600.0;

/// Effect of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Line {
    /// An event.
    Event(Event),
    /// The next line follows after this time.
    Wait(Duration),
}

/// Parser of the lines.
#[derive(Debug, Default)]
pub struct Reader {
    bytes: Vec<u8>,
    /// Number of bytes already parsed.
    taken: usize,
    /// Skipping the rest of a line that is too long.
    skips: bool,
    /// Device description in progress.
    device: Option<Box<Device>>,
}

impl Reader {
    /// Adds bytes; drain with [`Reader::poll`] before adding more.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.taken);
        self.taken = 0;
        self.bytes.extend_from_slice(bytes);
    }

    /// Returns the next line with an effect, or the error of an invalid one.
    pub fn poll(&mut self) -> Option<Result<Line, String>> {
        loop {
            let rest = &self.bytes[self.taken..];
            let Some(end) = rest.iter().position(|byte| *byte == b'\n') else {
                if rest.len() <= LINE_MAX {
                    return None;
                }
                self.taken = self.bytes.len();
                if std::mem::replace(&mut self.skips, true) {
                    return None;
                }
                return Some(Err(format!("a line is longer than {LINE_MAX} bytes")));
            };
            let line = String::from_utf8_lossy(&rest[..end]).into_owned();
            self.taken += end + 1;
            if std::mem::take(&mut self.skips) {
                continue;
            }
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            match self.take(line) {
                Some(Some(asked)) => return Some(Ok(asked)),
                Some(None) => {}
                None => return Some(Err(format!("not a line of a gamepad: {}", shortened(line)))),
            }
        }
    }

    /// Parses a line; `Some(None)` if it only describes.
    fn take(&mut self, line: &str) -> Option<Option<Line>> {
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        if word == "device" {
            self.device = Some(Box::new(Device::new(rest.trim())));
            return Some(None);
        }
        let mut words = rest.split_whitespace();
        let mut next = || words.next();
        let event = match word {
            "axis" => {
                let code = axis(next()?)?;
                let mut number = || next()?.parse().ok();
                let (min, max, fuzz, flat, value) = (number()?, number()?, number()?, number()?, number()?);
                let axis = Axis { code, min, max, fuzz, flat, value };
                self.device.as_mut()?.add_axis(axis).then_some(())?;
                None
            }
            "button" => {
                let button = Button { code: button(next()?)?, pressed: flag(next()?)? };
                self.device.as_mut()?.add_button(button).then_some(())?;
                None
            }
            "found" => Some(Event::Found(self.device.take()?)),
            "gone" => Some(Event::Gone),
            "abs" => Some(Event::Axis { code: axis(next()?)?, value: next()?.parse().ok()? }),
            "key" => Some(Event::Button { code: button(next()?)?, pressed: flag(next()?)? }),
            "frame" => Some(Event::Frame),
            "wait" => {
                let seconds: f64 = next()?.parse().ok()?;
                let wait = (0.0..=WAIT_MAX).contains(&seconds).then(|| Duration::from_secs_f64(seconds))?;
                return words.next().is_none().then_some(Some(Line::Wait(wait)));
            }
            _ => return None,
        };
        words.next().is_none().then_some(event.map(Line::Event))
    }
}

fn shortened(line: &str) -> String {
    line.chars().take(40).flat_map(char::escape_debug).collect()
}

fn axis(word: &str) -> Option<u16> {
    gamepad::axis_code(word).or_else(|| number(word))
}

fn button(word: &str) -> Option<u16> {
    gamepad::button_code(word).or_else(|| number(word))
}

fn number(word: &str) -> Option<u16> {
    match word.strip_prefix("0x") {
        Some(hex) => u16::from_str_radix(hex, 16).ok(),
        None => word.parse().ok(),
    }
}

fn flag(word: &str) -> Option<bool> {
    match word {
        "0" => Some(false),
        "1" => Some(true),
        _ => None,
    }
}

/// Appends the lines of an event.
pub fn encode(event: &Event, out: &mut String) {
    let axis = |code: u16| named(gamepad::axis_name(code), code);
    let button = |code: u16| named(gamepad::button_name(code), code);
    // Writing to a String cannot fail.
    let _ = match event {
        Event::Found(device) => {
            let _ = writeln!(out, "device {}", device.name());
            for Axis { code, min, max, fuzz, flat, value } in device.axes() {
                let _ = writeln!(out, "axis {} {min} {max} {fuzz} {flat} {value}", axis(*code));
            }
            for Button { code, pressed } in device.buttons() {
                let _ = writeln!(out, "button {} {}", button(*code), u8::from(*pressed));
            }
            writeln!(out, "found")
        }
        Event::Gone => writeln!(out, "gone"),
        Event::Axis { code, value } => writeln!(out, "abs {} {value}", axis(*code)),
        Event::Button { code, pressed } => writeln!(out, "key {} {}", button(*code), u8::from(*pressed)),
        Event::Frame => writeln!(out, "frame"),
    };
}

fn named(name: Option<&'static str>, code: u16) -> Cow<'static, str> {
    name.map_or_else(|| format!("{code:#x}").into(), Cow::Borrowed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8], chunk: usize) -> Vec<Result<Line, String>> {
        let (mut reader, mut lines) = (Reader::default(), Vec::new());
        for bytes in bytes.chunks(chunk) {
            reader.push(bytes);
            while let Some(line) = reader.poll() {
                lines.push(line);
            }
            assert!(reader.bytes.len() <= LINE_MAX + 1 + chunk);
        }
        lines
    }

    const SESSION: &str = "# a session\ndevice  A pad \naxis ABS_Y -32768 32767 16 128 5\naxis 0x28 0 255 0 0 127\n\
        button BTN_TL 0\nbutton 0x2c1 1\nfound\n\nkey BTN_TL 1\nabs ABS_Y -2\nframe\nwait 0.25\ngone\n";

    #[test]
    fn a_session_is_read_however_it_is_cut() {
        let whole = read(SESSION.as_bytes(), SESSION.len());
        assert_eq!(whole.len(), 6);
        let Ok(Line::Event(Event::Found(device))) = &whole[0] else { panic!("{whole:?}") };
        assert_eq!((device.name(), device.axes()[1].max, device.button(0x2C1)), ("A pad", 255, Some(true)));
        assert_eq!(whole[4], Ok(Line::Wait(Duration::from_millis(250))));
        for chunk in 1..20 {
            assert_eq!(read(SESSION.as_bytes(), chunk), whole);
        }
    }

    #[test]
    fn encoded_events_are_decoded_unchanged() {
        for line in read(SESSION.as_bytes(), 64) {
            if let Ok(Line::Event(event)) = line {
                let mut text = String::new();
                encode(&event, &mut text);
                assert_eq!(read(text.as_bytes(), 7), [Ok(Line::Event(event))]);
            }
        }
    }

    #[test]
    fn an_invalid_line_is_reported_and_skipped() {
        for wrong in [
            "found",
            "axis ABS_X 0 1 0 0 0",
            "abs BTN_TL 1",
            "abs ABS_X",
            "abs ABS_X 2147483648",
            "key BTN_TL 2",
            "key 65536 1",
            "frame 1",
            "wait -1",
            "wait NaN",
            "wait 1e9",
            "wait 1 2",
            "jump",
            "\u{1b}[2J",
        ] {
            let found = read(format!("{wrong}\ngone\n").as_bytes(), 999);
            let shown: String = wrong.chars().flat_map(char::escape_debug).collect();
            assert_eq!(found, [Err(format!("not a line of a gamepad: {shown}")), Ok(Line::Event(Event::Gone))]);
        }
        let found = read(format!("device {}\nabs {}\ngone\n", "x".repeat(5000), "\u{fffd}".repeat(90)).as_bytes(), 100);
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found[0].as_ref().is_err_and(|why| why.contains("longer")) && found[2].is_ok());
    }

    #[test]
    fn a_device_description_is_truncated_and_reported() {
        let mut text = String::from("device x\n");
        (0..40).for_each(|code| text.push_str(&format!("axis {code} 0 1 0 0 0\n")));
        text.push_str("found\n");
        let found = read(text.as_bytes(), 4096);
        assert_eq!(found.iter().filter(|line| line.is_err()).count(), 40 - gamepad::AXES_MAX);
    }

    /// Random bytes and damaged sessions: never a panic, never more than a line is buffered.
    #[test]
    fn any_bytes_are_survived() {
        let mut chance = 0x9E37_79B9_7F4A_7C15_u64;
        let mut next = || {
            chance ^= chance << 13;
            chance ^= chance >> 7;
            chance ^= chance << 17;
            chance
        };
        for _ in 0..2000 {
            let mut bytes = SESSION.as_bytes().to_vec();
            for _ in 0..next() % 9 {
                let place = next() as usize % bytes.len();
                bytes[place] = next() as u8;
            }
            read(&bytes, 1 + next() as usize % 40);
        }
    }
}
