//! Datagrams of python-can's `udp_multicast`: one frame each, as a msgpack map of eleven pairs.
//!
//! The output equals that of python-can 4.6 byte for byte. Input may come from any sender: keys in any order, numbers
//! of any width, some keys missing; anything but a classic CAN frame is rejected with a reason. Nothing is allocated.

use base::can::{Frame, Id};
use base::listed;
use rmp::{Marker, decode, encode};

/// Maximum length of a valid datagram, bytes.
pub const DATAGRAM_MAX: usize = 512;
/// Maximum number of pairs in a map; python-can sends 11.
const PAIRS_MAX: u32 = 32;

listed! {
    /// Reason why a datagram is rejected.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Malformed {
        /// Truncated, or not msgpack.
        Broken => "truncated, or not msgpack",
        /// Not a map, or one of too many pairs.
        NotAMap => "it is not a map",
        /// An unknown key, or a value of the wrong type.
        Key => "a key is unknown or of a wrong type",
        /// Bytes after the map.
        Trailing => "bytes follow the frame",
        /// `arbitration_id` is missing or out of range for its kind.
        Identifier => "its identifier is missing or out of range",
        /// More than 8 bytes, or `dlc` and data do not agree.
        Length => "dlc and data do not agree",
        /// CAN FD or an error frame, which are not supported.
        NotClassic => "it is a CAN FD or error frame",
    }
}

/// Encodes `frame`; `timestamp` is in seconds since the UNIX epoch (receivers replace it).
pub fn encode(frame: &Frame, timestamp: f64, datagram: &mut Vec<u8>) {
    datagram.clear();
    // Writing to a Vec cannot fail.
    let _ = write(frame, timestamp, datagram);
}

fn write(frame: &Frame, timestamp: f64, out: &mut Vec<u8>) -> Result<(), encode::ValueWriteError> {
    let (id, extended) = match frame.id() {
        Id::Standard(id) => (u32::from(id), false),
        Id::Extended(id) => (id, true),
    };
    encode::write_map_len(out, 11)?;
    encode::write_str(out, "timestamp")?;
    encode::write_f64(out, timestamp)?;
    encode::write_str(out, "arbitration_id")?;
    encode::write_uint(out, id.into())?;
    flag(out, "is_extended_id", extended)?;
    flag(out, "is_remote_frame", frame.is_remote())?;
    flag(out, "is_error_frame", false)?;
    encode::write_str(out, "channel")?;
    encode::write_nil(out).map_err(encode::ValueWriteError::InvalidMarkerWrite)?;
    encode::write_str(out, "dlc")?;
    encode::write_uint(out, frame.dlc().into())?;
    encode::write_str(out, "data")?;
    encode::write_bin(out, frame.data())?;
    flag(out, "is_fd", false)?;
    flag(out, "bitrate_switch", false)?;
    flag(out, "error_state_indicator", false)
}

fn flag(out: &mut Vec<u8>, key: &str, value: bool) -> Result<(), encode::ValueWriteError> {
    encode::write_str(out, key)?;
    encode::write_bool(out, value).map_err(encode::ValueWriteError::InvalidMarkerWrite)
}

/// Values of a map parsed so far.
struct Parts<'a> {
    id: Option<u64>,
    // Default of python-can.
    extended: bool,
    remote: bool,
    classic: bool,
    dlc: Option<u64>,
    data: &'a [u8],
}

/// Decodes a datagram.
pub fn decode(datagram: &[u8]) -> Result<Frame, Malformed> {
    let mut rest = datagram;
    let pairs = decode::read_map_len(&mut rest).map_err(|_| Malformed::NotAMap)?;
    if pairs > PAIRS_MAX {
        return Err(Malformed::NotAMap);
    }
    let mut parts = Parts { id: None, extended: true, remote: false, classic: true, dlc: None, data: &[] };
    for _ in 0..pairs {
        let (key, after) = decode::read_str_from_slice(rest).map_err(|_| Malformed::Broken)?;
        rest = parts.take(key, after)?;
    }
    if rest.is_empty() { parts.frame() } else { Err(Malformed::Trailing) }
}

impl<'a> Parts<'a> {
    /// Parses the value of `key` at the front of `rest`; returns the remainder.
    fn take(&mut self, key: &str, mut rest: &'a [u8]) -> Result<&'a [u8], Malformed> {
        match key {
            "arbitration_id" => self.id = Some(uint(&mut rest)?),
            "is_extended_id" => self.extended = boolean(&mut rest)?,
            "is_remote_frame" => self.remote = boolean(&mut rest)?,
            "is_error_frame" | "is_fd" => self.classic &= !boolean(&mut rest)?,
            "bitrate_switch" | "error_state_indicator" => drop(boolean(&mut rest)?),
            "dlc" => self.dlc = Some(uint(&mut rest)?),
            "data" => self.data = bytes(&mut rest)?,
            "timestamp" => number(&mut rest)?,
            "channel" => text_or_nothing(&mut rest)?,
            _ => return Err(Malformed::Key),
        }
        Ok(rest)
    }

    fn frame(&self) -> Result<Frame, Malformed> {
        if !self.classic {
            return Err(Malformed::NotClassic);
        }
        let id = self.id.ok_or(Malformed::Identifier)?;
        let id = match self.extended {
            true => Id::Extended(u32::try_from(id).map_err(|_| Malformed::Identifier)?),
            false => Id::Standard(u16::try_from(id).map_err(|_| Malformed::Identifier)?),
        };
        if Frame::new(id, &[]).is_none() {
            return Err(Malformed::Identifier);
        }
        let dlc = self.dlc.unwrap_or(self.data.len() as u64);
        let frame = match self.remote {
            true if self.data.is_empty() => u8::try_from(dlc).ok().and_then(|dlc| Frame::remote(id, dlc)),
            false if dlc == self.data.len() as u64 => Frame::new(id, self.data),
            _ => None,
        };
        frame.ok_or(Malformed::Length)
    }
}

fn uint(rest: &mut &[u8]) -> Result<u64, Malformed> {
    decode::read_int(rest).map_err(|_| Malformed::Key)
}

fn boolean(rest: &mut &[u8]) -> Result<bool, Malformed> {
    decode::read_bool(rest).map_err(|_| Malformed::Key)
}

fn bytes<'a>(rest: &mut &'a [u8]) -> Result<&'a [u8], Malformed> {
    let length = decode::read_bin_len(rest).map_err(|_| Malformed::Key)?;
    split(rest, length as usize)
}

/// Skips a time, which may be a float of either width or an integer.
fn number(rest: &mut &[u8]) -> Result<(), Malformed> {
    let mut copy = *rest;
    let width = match decode::read_marker(&mut copy).map_err(|_| Malformed::Broken)? {
        Marker::F64 | Marker::U64 | Marker::I64 => 8,
        Marker::F32 | Marker::U32 | Marker::I32 => 4,
        Marker::U16 | Marker::I16 => 2,
        Marker::U8 | Marker::I8 => 1,
        Marker::FixPos(_) | Marker::FixNeg(_) => 0,
        _ => return Err(Malformed::Key),
    };
    split(&mut copy, width)?;
    *rest = copy;
    Ok(())
}

fn text_or_nothing(rest: &mut &[u8]) -> Result<(), Malformed> {
    if rest.first() == Some(&Marker::Null.to_u8()) {
        *rest = &rest[1..];
        return Ok(());
    }
    let length = decode::read_str_len(rest).map_err(|_| Malformed::Key)?;
    split(rest, length as usize).map(|_| ())
}

fn split<'a>(rest: &mut &'a [u8], length: usize) -> Result<&'a [u8], Malformed> {
    let (taken, after) = rest.split_at_checked(length).ok_or(Malformed::Broken)?;
    *rest = after;
    Ok(taken)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `docs/facts/canopen.md` 6.1: an SDO upload request of 0x6041 to node 1, as python-can 4.6.1 sends it.
    const SDO: &str = "8b a9 74 69 6d 65 73 74 61 6d 70 cb 00 00 00 00 00 00 00 00
        ae 61 72 62 69 74 72 61 74 69 6f 6e 5f 69 64 cd 06 01
        ae 69 73 5f 65 78 74 65 6e 64 65 64 5f 69 64 c2
        af 69 73 5f 72 65 6d 6f 74 65 5f 66 72 61 6d 65 c2
        ae 69 73 5f 65 72 72 6f 72 5f 66 72 61 6d 65 c2
        a7 63 68 61 6e 6e 65 6c c0
        a3 64 6c 63 08
        a4 64 61 74 61 c4 08 40 41 60 00 00 00 00 00
        a5 69 73 5f 66 64 c2
        ae 62 69 74 72 61 74 65 5f 73 77 69 74 63 68 c2
        b5 65 72 72 6f 72 5f 73 74 61 74 65 5f 69 6e 64 69 63 61 74 6f 72 c2";

    fn hex(text: &str) -> Vec<u8> {
        text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
    }

    fn encoded(frame: &Frame) -> Vec<u8> {
        let mut datagram = Vec::new();
        encode(frame, 0.0, &mut datagram);
        datagram
    }

    /// A map of raw pairs.
    fn map(pairs: &[(&str, &[u8])]) -> Vec<u8> {
        let mut datagram = vec![0x80 | pairs.len() as u8];
        for (key, value) in pairs {
            datagram.push(0xA0 | key.len() as u8);
            datagram.extend_from_slice(key.as_bytes());
            datagram.extend_from_slice(value);
        }
        datagram
    }

    #[test]
    fn a_frame_is_byte_for_byte_what_python_can_sends() {
        let frame = Frame::standard(0x601, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0]);
        assert_eq!(encoded(&frame), hex(SDO));
        assert_eq!(decode(&hex(SDO)), Ok(frame));
    }

    #[test]
    fn identifiers_take_their_shortest_form() {
        let id_of = |frame: &Frame| encoded(frame)[35..].to_vec();
        assert_eq!(id_of(&Frame::standard(0, &[]))[0], 0x00);
        assert_eq!(id_of(&Frame::standard(0x80, &[]))[..2], [0xCC, 0x80]);
        let extended = Frame::new(Id::Extended(0x1234_5678), &[]).unwrap();
        assert_eq!(id_of(&extended)[..5], [0xCE, 0x12, 0x34, 0x56, 0x78]);
    }

    #[test]
    fn every_kind_of_frame_survives() {
        let frames = [
            Frame::standard(0x7FF, &[]),
            Frame::standard(0x181, &[1, 2, 3]),
            Frame::remote(Id::Standard(0x701), 1).unwrap(),
            Frame::new(Id::Extended(0x1FFF_FFFF), &[0xFF; 8]).unwrap(),
        ];
        for frame in frames {
            assert_eq!(decode(&encoded(&frame)), Ok(frame));
        }
    }

    #[test]
    fn three_keys_are_enough_in_any_order() {
        let datagram = map(&[("data", b"\xC4\x02\x01\x02"), ("is_extended_id", b"\xC2"), ("arbitration_id", b"\x05")]);
        assert_eq!(decode(&datagram), Ok(Frame::standard(5, &[1, 2])));
        let datagram = map(&[("arbitration_id", b"\x05")]);
        assert_eq!(decode(&datagram), Ok(Frame::new(Id::Extended(5), &[]).unwrap()));
    }

    #[test]
    fn anything_but_a_classic_frame_is_rejected_with_the_reason() {
        let id: (&str, &[u8]) = ("arbitration_id", b"\x05");
        let base: (&str, &[u8]) = ("is_extended_id", b"\xC2");
        let refused = |pairs: &[(&str, &[u8])]| decode(&map(pairs)).unwrap_err();
        assert_eq!(refused(&[]), Malformed::Identifier);
        assert_eq!(refused(&[base, ("arbitration_id", b"\xCD\x08\x00")]), Malformed::Identifier);
        assert_eq!(refused(&[("arbitration_id", b"\xCE\x20\x00\x00\x00")]), Malformed::Identifier);
        assert_eq!(refused(&[("arbitration_id", b"\xCF\xFF\x00\x00\x00\x00\x00\x00\x00")]), Malformed::Identifier);
        assert_eq!(refused(&[("arbitration_id", b"\xFF")]), Malformed::Key);
        assert_eq!(refused(&[id, ("colour", b"\x05")]), Malformed::Key);
        assert_eq!(refused(&[id, ("is_fd", b"\x01")]), Malformed::Key);
        assert_eq!(refused(&[id, ("is_fd", b"\xC3")]), Malformed::NotClassic);
        assert_eq!(refused(&[id, ("is_error_frame", b"\xC3")]), Malformed::NotClassic);
        assert_eq!(refused(&[id, ("data", b"\xA2ab")]), Malformed::Key);
        assert_eq!(refused(&[id, ("data", b"\xC4\x02\x01\x02"), ("dlc", b"\x03")]), Malformed::Length);
        assert_eq!(refused(&[id, ("data", b"\xC4\x09123456789")]), Malformed::Length);
        assert_eq!(refused(&[id, ("is_remote_frame", b"\xC3"), ("dlc", b"\x09")]), Malformed::Length);
        assert_eq!(refused(&[id, ("data", b"\xC6\xFF\xFF\xFF\xFF")]), Malformed::Broken);
        assert_eq!(refused(&[id, ("channel", b"\xDB\xFF\xFF\xFF\xFF")]), Malformed::Broken);
        assert_eq!(decode(&[0xDF, 0xFF, 0xFF, 0xFF, 0xFF]), Err(Malformed::NotAMap));
        assert_eq!(decode(b"hello"), Err(Malformed::NotAMap));
        assert_eq!(decode(&[]), Err(Malformed::NotAMap));
        let mut trailing = hex(SDO);
        trailing.push(0);
        assert_eq!(decode(&trailing), Err(Malformed::Trailing));
    }

    #[test]
    fn no_damage_to_a_datagram_does_harm() {
        let good = hex(SDO);
        for end in 0..good.len() {
            assert!(decode(&good[..end]).is_err());
        }
        for at in 0..good.len() {
            for byte in 0..=255 {
                let mut bad = good.clone();
                bad[at] = byte;
                let _ = decode(&bad);
            }
        }
    }
}
