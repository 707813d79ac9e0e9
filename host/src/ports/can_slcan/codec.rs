//! Lawicel's ASCII protocol as `slcan` adapters, `slcand` and python-can use it: one line per frame, ended by CR.
//!
//! | line | meaning |
//! |---|---|
//! | `tIIILDD…`, `TIIIIIIIILDD…` | data frame with an 11-bit or 29-bit identifier, hexadecimal |
//! | `rIIIL`, `RIIIIIIIIL` | remote frame |
//! | empty; BEL in place of CR | acknowledged; rejected |
//! | `z`, `Z` | frame accepted |
//! | `FXX` | flags of the controller |
//! | `saRRRTTT` | state (a, w, p, b) and error counters, decimal, as Linux's driver expects from some adapters |
//!
//! Four hexadecimal digits may follow a frame: a time in ms that some adapters add. Nothing here allocates.

use base::can::{BusState, Frame, Health, Id};
use std::fmt::Write;

/// Length of the longest line: a frame with a time, and the end of line.
pub const LINE_MAX: usize = 1 + 8 + 1 + 16 + 4 + 1;
const CR: u8 = 0x0D;
const BEL: u8 = 0x07;
/// Flags: receive queue full, transmit queue full, data overrun.
const OVERRUN: u8 = 0x01 | 0x08;
const WARNING: u8 = 0x04;
const PASSIVE: u8 = 0x20;
const BUS_ERROR: u8 = 0x80;

/// Decoded line of an adapter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AdapterLine {
    /// A frame from the bus.
    Frame(Frame),
    /// The last command was executed.
    Acknowledged,
    /// The last command was rejected.
    Rejected,
    /// Flags of the controller.
    Flags(Flags),
    /// State and error counters.
    Health(Health),
    /// Not a valid line.
    Malformed,
    /// A valid line that is of no interest.
    Other,
}

/// Flags of an adapter; they do not include the error counters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flags {
    /// The controller's state; bus-off has no flag.
    pub state: BusState,
    /// Frames were lost because of a full queue.
    pub lost: bool,
    /// An error occurred on the wire.
    pub error: bool,
}

/// Command for a bit rate; `None` if the protocol has none.
pub fn bitrate_command(bitrate: u32) -> Option<&'static str> {
    const COMMANDS: [(u32, &str); 9] = [
        (10_000, "S0\r"),
        (20_000, "S1\r"),
        (50_000, "S2\r"),
        (100_000, "S3\r"),
        (125_000, "S4\r"),
        (250_000, "S5\r"),
        (500_000, "S6\r"),
        (800_000, "S7\r"),
        (1_000_000, "S8\r"),
    ];
    COMMANDS.iter().find(|(rate, _)| *rate == bitrate).map(|(_, command)| *command)
}

/// Appends the line of a frame.
pub fn encode(frame: &Frame, line: &mut String) {
    // Writing to a String cannot fail.
    let _ = match (frame.id(), frame.is_remote()) {
        (Id::Standard(id), false) => write!(line, "t{id:03X}"),
        (Id::Standard(id), true) => write!(line, "r{id:03X}"),
        (Id::Extended(id), false) => write!(line, "T{id:08X}"),
        (Id::Extended(id), true) => write!(line, "R{id:08X}"),
    };
    let _ = write!(line, "{}", frame.dlc());
    for byte in frame.data() {
        let _ = write!(line, "{byte:02X}");
    }
    line.push('\r');
}

/// Splits received bytes into lines.
#[derive(Debug, Default)]
pub struct Lines {
    line: Vec<u8>,
    /// Line too long: bytes are skipped until its end.
    too_long: bool,
}

impl Lines {
    /// Adds a byte; returns the decoded line if the byte ends one.
    pub fn push(&mut self, byte: u8) -> Option<AdapterLine> {
        if byte != CR && byte != BEL {
            self.too_long |= self.line.len() >= LINE_MAX;
            if !self.too_long {
                self.line.push(byte);
            }
            return None;
        }
        let decoded = match &self.line[..] {
            _ if self.too_long => AdapterLine::Malformed,
            // BEL aborts an incomplete line.
            _ if byte == BEL => AdapterLine::Rejected,
            line => decode(line),
        };
        self.clear();
        Some(decoded)
    }

    /// Discards an incomplete line.
    pub fn clear(&mut self) {
        self.line.clear();
        self.too_long = false;
    }
}

fn decode(line: &[u8]) -> AdapterLine {
    let Some((kind, rest)) = line.split_first() else {
        return AdapterLine::Acknowledged;
    };
    let said = match kind {
        b't' | b'T' | b'r' | b'R' => frame(*kind, rest).map(AdapterLine::Frame),
        b'z' | b'Z' if rest.is_empty() => Some(AdapterLine::Acknowledged),
        b'F' if rest.len() == 2 => hex(rest).map(|flags| AdapterLine::Flags(of_flags(flags as u8))),
        b's' => health(rest).map(AdapterLine::Health),
        // A version, a number, or another computer's command on the same line: C, O, S, L, F, V, N and others.
        b'A'..=b'Z' | b'a'..=b'z' => Some(AdapterLine::Other),
        _ => None,
    };
    said.unwrap_or(AdapterLine::Malformed)
}

fn frame(kind: u8, rest: &[u8]) -> Option<Frame> {
    let digits = if kind.is_ascii_uppercase() { 8 } else { 3 };
    let (id, rest) = rest.split_at_checked(digits)?;
    let id = hex(id)?;
    let id = if digits == 8 { Id::Extended(id) } else { Id::Standard(id as u16) };
    let (length, rest) = rest.split_first()?;
    let length = length.checked_sub(b'0').filter(|length| *length <= 8)?;
    let remote = kind.eq_ignore_ascii_case(&b'r');
    let (text, time) = rest.split_at_checked(if remote { 0 } else { 2 * usize::from(length) })?;
    if !time.is_empty() && (time.len() != 4 || hex(time).is_none()) {
        return None;
    }
    let mut data = [0; 8];
    for (byte, text) in data.iter_mut().zip(text.chunks_exact(2)) {
        *byte = hex(text)? as u8;
    }
    if remote { Frame::remote(id, length) } else { Frame::new(id, &data[..usize::from(length)]) }
}

fn of_flags(flags: u8) -> Flags {
    let state = match flags {
        flags if flags & PASSIVE != 0 => BusState::Passive,
        flags if flags & WARNING != 0 => BusState::Warning,
        _ => BusState::Active,
    };
    Flags { state, lost: flags & OVERRUN != 0, error: flags & BUS_ERROR != 0 }
}

fn health(rest: &[u8]) -> Option<Health> {
    let (state, counters) = rest.split_first()?;
    let state = match state {
        b'a' => BusState::Active,
        b'w' => BusState::Warning,
        b'p' => BusState::Passive,
        b'b' => BusState::Off,
        _ => return None,
    };
    let (receive, transmit) = counters.split_at_checked(3).filter(|(_, transmit)| transmit.len() == 3)?;
    let number = |text: &[u8]| std::str::from_utf8(text).ok().filter(|text| !text.starts_with('+'))?.parse().ok();
    Some(Health { state, transmit_errors: number(transmit)?, receive_errors: number(receive)? })
}

/// Parses up to eight digits.
fn hex(digits: &[u8]) -> Option<u32> {
    digits.iter().try_fold(0, |number, digit| Some(number << 4 | char::from(*digit).to_digit(16)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(text: &str) -> Vec<AdapterLine> {
        let mut lines = Lines::default();
        text.bytes().filter_map(|byte| lines.push(byte)).collect()
    }

    #[test]
    fn frames_are_as_python_can_and_slcand_write_them() {
        let cases = [
            ("t60184041600000000000\r", Frame::standard(0x601, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0])),
            ("t0000\r", Frame::standard(0, &[])),
            ("T1FFFFFFF2ABCD\r", Frame::new(Id::Extended(0x1FFF_FFFF), &[0xAB, 0xCD]).unwrap()),
            ("r7011\r", Frame::remote(Id::Standard(0x701), 1).unwrap()),
            ("R000000018\r", Frame::remote(Id::Extended(1), 8).unwrap()),
        ];
        for (text, frame) in cases {
            let mut line = String::new();
            encode(&frame, &mut line);
            assert_eq!((line.as_str(), said(text)), (text, vec![AdapterLine::Frame(frame)]));
            assert!(line.len() <= LINE_MAX);
        }
        // Lower-case letters, and a time.
        assert_eq!(said("t1811ab1F2a\r"), [AdapterLine::Frame(Frame::standard(0x181, &[0xAB]))]);
    }

    #[test]
    fn answers_flags_and_foreign_lines_are_distinguished() {
        let flags = |state, lost, error| AdapterLine::Flags(Flags { state, lost, error });
        assert_eq!(
            said("\rz\rZ\r\x07"),
            [AdapterLine::Acknowledged, AdapterLine::Acknowledged, AdapterLine::Acknowledged, AdapterLine::Rejected]
        );
        assert_eq!(
            said("F00\rF24\rF84\rF09\r"),
            [
                flags(BusState::Active, false, false),
                flags(BusState::Passive, false, false),
                flags(BusState::Warning, false, true),
                flags(BusState::Active, true, false),
            ]
        );
        let health = |state, transmit_errors, receive_errors| {
            AdapterLine::Health(Health { state, transmit_errors, receive_errors })
        };
        assert_eq!(
            said("sw100000\rsp000130\rsb000255\rsa000000\r"),
            [
                health(BusState::Warning, 0, 100),
                health(BusState::Passive, 130, 0),
                health(BusState::Off, 255, 0),
                health(BusState::Active, 0, 0),
            ]
        );
        assert_eq!(said("V1013\rNA123\rC\rS8\rO\r"), [AdapterLine::Other; 5]);
    }

    #[test]
    fn a_malformed_line_does_not_affect_the_next_one() {
        for bad in [
            "t",
            "t18",
            "t1819",
            "t181",
            "t1812AB",
            "t1811GG",
            "t8000",
            "T200000000",
            "r7019",
            "t1811AB123",
            "F",
            "FGG",
            "s",
            "sx000000",
            "sw256000",
            "sw00000",
            "s+w",
            "sw+01000",
            "t181-",
            "1234",
            "t1811\u{e9}",
        ] {
            let bytes = format!("{bad}\rt1811AB\r");
            let expected = match bad {
                // Another computer polls the flags.
                "F" | "FGG" => vec![AdapterLine::Other, AdapterLine::Malformed],
                _ => vec![AdapterLine::Malformed],
            };
            let heard = said(&bytes);
            assert!(expected.contains(&heard[0]), "{bad}: {heard:?}");
            assert_eq!(heard[1..], [AdapterLine::Frame(Frame::standard(0x181, &[0xAB]))], "{bad}");
        }
        let flood = "t".repeat(100_000) + "\rt1811AB\r";
        assert_eq!(said(&flood), [AdapterLine::Malformed, AdapterLine::Frame(Frame::standard(0x181, &[0xAB]))]);
    }

    #[test]
    fn no_bytes_do_harm() {
        let (mut lines, mut random) = (Lines::default(), 1u64);
        let letters = b"tTrRzZFs0123456789abcdefABCDEF\r\r\r\x07\xff";
        for _ in 0..300_000 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            lines.push(letters[(random >> 40) as usize % letters.len()]);
            assert!(lines.line.len() <= LINE_MAX);
        }
    }
}
