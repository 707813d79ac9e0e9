//! SDO frames, expedited, segmented and block (CiA 301, 9.2.2.2). Always 8 bytes.
//! A segment of a block transfer has no command specifier: its first byte may equal that of any other frame. It is
//! recognized only by expecting it, so [`BlockSegment`] is apart from [`Request`] and [`Response`].

use crate::Abort;

/// Begin of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Initiate {
    /// All data in this frame; `len` (1..=4) is `None` if the sender did not indicate it.
    Expedited {
        /// The data, padded with zeros.
        data: [u8; 4],
        /// Number of bytes that count.
        len: Option<u8>,
    },
    /// Segments follow.
    Segmented {
        /// Size of the whole transfer, bytes, if the sender indicated it.
        size: Option<u32>,
    },
}

/// Up to seven bytes of a segmented transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    /// Alternates, beginning with false.
    pub toggle: bool,
    /// True if no more segments follow.
    pub last: bool,
    len: u8,
    bytes: [u8; 7],
}

impl Segment {
    /// A segment with the first seven bytes of `data`.
    #[must_use]
    pub fn new(toggle: bool, last: bool, data: &[u8]) -> Self {
        let len = data.len().min(7);
        let mut bytes = [0; 7];
        bytes[..len].copy_from_slice(&data[..len]);
        Self { toggle, last, len: len as u8, bytes }
    }

    /// The data.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        &self.bytes[..usize::from(self.len)]
    }

    fn encode(self) -> [u8; 8] {
        let mut frame = [0; 8];
        frame[0] = toggle_bit(self.toggle) | (7 - self.len) << 1 | u8::from(self.last);
        frame[1..].copy_from_slice(&self.bytes);
        frame
    }

    fn decode(frame: [u8; 8]) -> Self {
        let [command, data @ ..] = frame;
        let len = 7 - usize::from(command >> 1 & 7);
        Self::new(is_toggled(command), command & 1 != 0, &data[..len])
    }
}

/// Seven bytes of a block transfer, in either direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockSegment {
    /// True if it is the last of the whole transfer.
    pub last: bool,
    /// Number in the sub-block, 1..=127; 0 is invalid ([`Request::Abort`] begins so, with `last`).
    pub seqno: u8,
    /// Data; [`BlockEnd`] gives the number of valid bytes of the last segment.
    pub data: [u8; 7],
}

impl BlockSegment {
    /// The data of the frame.
    #[must_use]
    pub const fn encode(self) -> [u8; 8] {
        let [a, b, c, d, e, f, g] = self.data;
        [(self.last as u8) << 7 | self.seqno & 0x7F, a, b, c, d, e, f, g]
    }

    /// From the data of a frame that is known to be a segment.
    #[must_use]
    pub const fn decode(frame: [u8; 8]) -> Self {
        let [first, data @ ..] = frame;
        Self { last: first & 0x80 != 0, seqno: first & 0x7F, data }
    }
}

/// End of a block transfer, by the sender of the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockEnd {
    /// Bytes of the last segment that do not count, 0..=7.
    pub unused: u8,
    /// CRC of all data; means nothing unless both sides announced that they can do it.
    pub crc: u16,
}

impl BlockEnd {
    const fn encode(self) -> [u8; 8] {
        let [low, high] = self.crc.to_le_bytes();
        [0xC1 | (self.unused & 7) << 2, low, high, 0, 0, 0, 0, 0]
    }

    const fn decode([command, low, high, ..]: [u8; 8]) -> Self {
        Self { unused: command >> 2 & 7, crc: u16::from_le_bytes([low, high]) }
    }
}

/// From client to server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // index and sub: the object
pub enum Request {
    /// Begin to write an object.
    Download { index: u16, sub: u8, initiate: Initiate },
    /// Go on writing.
    DownloadSegment(Segment),
    /// Begin to read an object.
    Upload { index: u16, sub: u8 },
    /// Go on reading.
    UploadSegment { toggle: bool },
    /// Begin to write an object in blocks; `crc`: the client can do it.
    BlockDownload { index: u16, sub: u8, crc: bool, size: Option<u32> },
    /// All data sent and acknowledged.
    BlockDownloadEnd(BlockEnd),
    /// Begin to read an object in blocks of `blksize` segments; up to `threshold` bytes (0: none) the server may
    /// answer with a normal upload. `crc`: the client can do it.
    BlockUpload { index: u16, sub: u8, crc: bool, blksize: u8, threshold: u8 },
    /// Send the first block.
    BlockUploadStart,
    /// Segments up to `ackseq` came; the next block has `blksize` segments.
    BlockUploadAck { ackseq: u8, blksize: u8 },
    /// All data received.
    BlockUploadEnd,
    /// Give up.
    Abort { index: u16, sub: u8, code: Abort },
}

/// From server to client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // index and sub: the object
pub enum Response {
    /// Writing begun, or done when it was expedited.
    Download { index: u16, sub: u8 },
    /// A segment was taken.
    DownloadSegment { toggle: bool },
    /// Reading begun, or all of it when it is expedited.
    Upload { index: u16, sub: u8, initiate: Initiate },
    /// A segment.
    UploadSegment(Segment),
    /// Writing in blocks begun, the first of `blksize` segments; `crc`: the server can do it.
    BlockDownload { index: u16, sub: u8, crc: bool, blksize: u8 },
    /// Segments up to `ackseq` came; the next block has `blksize` segments.
    BlockDownloadAck { ackseq: u8, blksize: u8 },
    /// All data received and written.
    BlockDownloadEnd,
    /// Reading in blocks begun; `crc`: the server can do it.
    BlockUpload { index: u16, sub: u8, crc: bool, size: Option<u32> },
    /// All data sent and acknowledged.
    BlockUploadEnd(BlockEnd),
    /// Refused.
    Abort { index: u16, sub: u8, code: Abort },
}

/// Why a frame is not an SDO frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Malformed {
    /// Not 8 bytes long.
    Length,
    /// The command specifier is reserved. Index and sub-index where most frames have them.
    Command {
        /// Byte 0.
        command: u8,
        /// Bytes 1 and 2.
        index: u16,
        /// Byte 3.
        sub: u8,
    },
}

const fn toggle_bit(toggle: bool) -> u8 {
    if toggle { 0x10 } else { 0 }
}

const fn is_toggled(command: u8) -> bool {
    command & 0x10 != 0
}

fn object(command: u8, index: u16, sub: u8, data: [u8; 4]) -> [u8; 8] {
    let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), data);
    [command, low, high, sub, a, b, c, d]
}

fn initiate(command: u8, index: u16, sub: u8, initiate: Initiate) -> [u8; 8] {
    match initiate {
        Initiate::Expedited { data, len: None } => object(command | 2, index, sub, data),
        Initiate::Expedited { data, len: Some(len) } => {
            object(command | 3 | (4 - len.clamp(1, 4)) << 2, index, sub, data)
        }
        Initiate::Segmented { size: None } => object(command, index, sub, [0; 4]),
        Initiate::Segmented { size: Some(size) } => object(command | 1, index, sub, size.to_le_bytes()),
    }
}

fn decode_initiate(command: u8, data: [u8; 4]) -> Initiate {
    match (command & 2 != 0, command & 1 != 0) {
        (true, false) => Initiate::Expedited { data, len: None },
        (true, true) => Initiate::Expedited { data, len: Some(4 - (command >> 2 & 3)) },
        (false, false) => Initiate::Segmented { size: None },
        (false, true) => Initiate::Segmented { size: Some(u32::from_le_bytes(data)) },
    }
}

/// Encodes the begin of a block by the sender of the data.
fn block_of_data(index: u16, sub: u8, crc: bool, size: Option<u32>) -> [u8; 8] {
    let command = 0xC0 | u8::from(crc) << 2 | u8::from(size.is_some()) << 1;
    object(command, index, sub, size.unwrap_or(0).to_le_bytes())
}

fn decode_size(command: u8, data: [u8; 4]) -> Option<u32> {
    (command & 2 != 0).then_some(u32::from_le_bytes(data))
}

const fn has_crc(command: u8) -> bool {
    command & 4 != 0
}

/// An object's address and the four bytes behind it.
type Parts = ([u8; 8], u8, u16, u8, [u8; 4]);

fn split(data: &[u8]) -> Result<Parts, Malformed> {
    let frame: [u8; 8] = data.try_into().map_err(|_| Malformed::Length)?;
    let [command, low, high, sub, rest @ ..] = frame;
    Ok((frame, command, u16::from_le_bytes([low, high]), sub, rest))
}

impl Request {
    /// The data of the frame.
    #[must_use]
    pub fn encode(self) -> [u8; 8] {
        match self {
            Self::Download { index, sub, initiate: how } => initiate(0x20, index, sub, how),
            Self::DownloadSegment(segment) => segment.encode(),
            Self::Upload { index, sub } => object(0x40, index, sub, [0; 4]),
            Self::UploadSegment { toggle } => [0x60 | toggle_bit(toggle), 0, 0, 0, 0, 0, 0, 0],
            Self::BlockDownload { index, sub, crc, size } => block_of_data(index, sub, crc, size),
            Self::BlockDownloadEnd(end) => end.encode(),
            Self::BlockUpload { index, sub, crc, blksize, threshold } => {
                object(0xA0 | u8::from(crc) << 2, index, sub, [blksize, threshold, 0, 0])
            }
            Self::BlockUploadStart => [0xA3, 0, 0, 0, 0, 0, 0, 0],
            Self::BlockUploadAck { ackseq, blksize } => [0xA2, ackseq, blksize, 0, 0, 0, 0, 0],
            Self::BlockUploadEnd => [0xA1, 0, 0, 0, 0, 0, 0, 0],
            Self::Abort { index, sub, code } => object(0x80, index, sub, code.0.to_le_bytes()),
        }
    }

    /// From the data of a frame.
    ///
    /// # Errors
    /// Why it is none that is spoken here.
    pub fn decode(data: &[u8]) -> Result<Self, Malformed> {
        let (frame, command, index, sub, rest) = split(data)?;
        Ok(match command >> 5 {
            0 => Self::DownloadSegment(Segment::decode(frame)),
            1 => Self::Download { index, sub, initiate: decode_initiate(command, rest) },
            2 => Self::Upload { index, sub },
            3 => Self::UploadSegment { toggle: is_toggled(command) },
            4 => Self::Abort { index, sub, code: Abort(u32::from_le_bytes(rest)) },
            5 => match command & 3 {
                0 => Self::BlockUpload { index, sub, crc: has_crc(command), blksize: rest[0], threshold: rest[1] },
                1 => Self::BlockUploadEnd,
                2 => Self::BlockUploadAck { ackseq: frame[1], blksize: frame[2] },
                _ => Self::BlockUploadStart,
            },
            6 if command & 1 != 0 => Self::BlockDownloadEnd(BlockEnd::decode(frame)),
            6 => Self::BlockDownload { index, sub, crc: has_crc(command), size: decode_size(command, rest) },
            _ => return Err(Malformed::Command { command, index, sub }),
        })
    }
}

impl Response {
    /// The data of the frame.
    #[must_use]
    pub fn encode(self) -> [u8; 8] {
        match self {
            Self::Download { index, sub } => object(0x60, index, sub, [0; 4]),
            Self::DownloadSegment { toggle } => [0x20 | toggle_bit(toggle), 0, 0, 0, 0, 0, 0, 0],
            Self::Upload { index, sub, initiate: how } => initiate(0x40, index, sub, how),
            Self::UploadSegment(segment) => segment.encode(),
            Self::BlockDownload { index, sub, crc, blksize } => {
                object(0xA0 | u8::from(crc) << 2, index, sub, [blksize, 0, 0, 0])
            }
            Self::BlockDownloadAck { ackseq, blksize } => [0xA2, ackseq, blksize, 0, 0, 0, 0, 0],
            Self::BlockDownloadEnd => [0xA1, 0, 0, 0, 0, 0, 0, 0],
            Self::BlockUpload { index, sub, crc, size } => block_of_data(index, sub, crc, size),
            Self::BlockUploadEnd(end) => end.encode(),
            Self::Abort { index, sub, code } => object(0x80, index, sub, code.0.to_le_bytes()),
        }
    }

    /// From the data of a frame.
    ///
    /// # Errors
    /// Why it is none that is spoken here.
    pub fn decode(data: &[u8]) -> Result<Self, Malformed> {
        let (frame, command, index, sub, rest) = split(data)?;
        Ok(match command >> 5 {
            0 => Self::UploadSegment(Segment::decode(frame)),
            1 => Self::DownloadSegment { toggle: is_toggled(command) },
            2 => Self::Upload { index, sub, initiate: decode_initiate(command, rest) },
            3 => Self::Download { index, sub },
            4 => Self::Abort { index, sub, code: Abort(u32::from_le_bytes(rest)) },
            5 if command & 3 == 0 => Self::BlockDownload { index, sub, crc: has_crc(command), blksize: rest[0] },
            5 if command & 3 == 1 => Self::BlockDownloadEnd,
            5 if command & 3 == 2 => Self::BlockDownloadAck { ackseq: frame[1], blksize: frame[2] },
            6 if command & 1 != 0 => Self::BlockUploadEnd(BlockEnd::decode(frame)),
            6 => Self::BlockUpload { index, sub, crc: has_crc(command), size: decode_size(command, rest) },
            _ => return Err(Malformed::Command { command, index, sub }),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_commands_are_those_of_the_standard() {
        let four = |len| Initiate::Expedited { data: [1, 2, 3, 4], len };
        let command = |initiate| Request::Download { index: 0x6083, sub: 1, initiate }.encode()[0];
        assert_eq!([4, 3, 2, 1].map(|len| command(four(Some(len)))), [0x23, 0x27, 0x2B, 0x2F]);
        assert_eq!(command(four(None)), 0x22);
        assert_eq!(command(Initiate::Segmented { size: Some(9) }), 0x21);
        assert_eq!(command(Initiate::Segmented { size: None }), 0x20);
        assert_eq!(Request::Upload { index: 0x6041, sub: 0 }.encode(), [0x40, 0x41, 0x60, 0, 0, 0, 0, 0]);
        let answer = [0x4B, 0x41, 0x60, 0, 0x40, 0x02, 0, 0];
        let initiate = Initiate::Expedited { data: [0x40, 0x02, 0, 0], len: Some(2) };
        assert_eq!(Response::decode(&answer), Ok(Response::Upload { index: 0x6041, sub: 0, initiate }));
        assert_eq!(Request::UploadSegment { toggle: true }.encode()[0], 0x70);
        assert_eq!(Response::DownloadSegment { toggle: true }.encode()[0], 0x30);
        assert_eq!(Segment::new(true, true, &[1, 2, 3]).encode(), [0x19, 1, 2, 3, 0, 0, 0, 0]);
    }

    #[test]
    fn the_block_commands_are_those_of_the_standard() {
        let (index, sub) = (0x1008, 0);
        let request = |request: Request, frame: [u8; 8]| {
            assert_eq!(request.encode(), frame);
            assert_eq!(Request::decode(&frame), Ok(request));
        };
        request(Request::BlockDownload { index, sub, crc: true, size: Some(50) }, [0xC6, 0x08, 0x10, 0, 50, 0, 0, 0]);
        request(Request::BlockDownload { index, sub, crc: false, size: None }, [0xC0, 0x08, 0x10, 0, 0, 0, 0, 0]);
        request(Request::BlockDownloadEnd(BlockEnd { unused: 6, crc: 0x6A15 }), [0xD9, 0x15, 0x6A, 0, 0, 0, 0, 0]);
        let upload = Request::BlockUpload { index, sub, crc: true, blksize: 127, threshold: 28 };
        request(upload, [0xA4, 0x08, 0x10, 0, 127, 28, 0, 0]);
        request(Request::BlockUploadStart, [0xA3, 0, 0, 0, 0, 0, 0, 0]);
        request(Request::BlockUploadAck { ackseq: 8, blksize: 127 }, [0xA2, 8, 127, 0, 0, 0, 0, 0]);
        request(Request::BlockUploadEnd, [0xA1, 0, 0, 0, 0, 0, 0, 0]);
        let response = |response: Response, frame: [u8; 8]| {
            assert_eq!(response.encode(), frame);
            assert_eq!(Response::decode(&frame), Ok(response));
        };
        let download = Response::BlockDownload { index, sub, crc: true, blksize: 127 };
        response(download, [0xA4, 0x08, 0x10, 0, 127, 0, 0, 0]);
        response(Response::BlockDownloadAck { ackseq: 8, blksize: 1 }, [0xA2, 8, 1, 0, 0, 0, 0, 0]);
        response(Response::BlockDownloadEnd, [0xA1, 0, 0, 0, 0, 0, 0, 0]);
        response(Response::BlockUpload { index, sub, crc: true, size: Some(50) }, [0xC6, 0x08, 0x10, 0, 50, 0, 0, 0]);
        response(Response::BlockUploadEnd(BlockEnd { unused: 6, crc: 0x6A15 }), [0xD9, 0x15, 0x6A, 0, 0, 0, 0, 0]);
        let segment = BlockSegment { last: true, seqno: 8, data: [b'e', 0, 0, 0, 0, 0, 0] };
        assert_eq!(segment.encode(), [0x88, b'e', 0, 0, 0, 0, 0, 0]);
        assert_eq!(BlockSegment::decode(segment.encode()), segment);
    }

    #[test]
    fn what_is_decoded_encodes_to_itself() {
        for command in 0..=0xFF_u8 {
            let frame = [command, 0x34, 0x12, 5, 6, 7, 8, 9];
            let request = Request::decode(&frame);
            assert_eq!(request.is_err(), command >= 0xE0);
            assert!(request.is_err() || Request::decode(&request.unwrap().encode()) == request);
            let response = Response::decode(&frame);
            assert_eq!(response.is_err(), command >= 0xE0 || command & 0xE3 == 0xA3);
            assert!(response.is_err() || Response::decode(&response.unwrap().encode()) == response);
            assert_eq!(BlockSegment::decode(frame).encode(), frame);
        }
    }

    #[test]
    fn reserved_commands_and_short_frames_are_refused_with_their_object() {
        let refused = Err(Malformed::Command { command: 0xE6, index: 0x1F50, sub: 1 });
        assert_eq!(Request::decode(&[0xE6, 0x50, 0x1F, 1, 0, 0, 0, 0]), refused);
        assert_eq!(Request::decode(&[0x40; 7]), Err(Malformed::Length));
        assert_eq!(Response::decode(&[]), Err(Malformed::Length));
    }
}
