//! A classic CAN frame (ISO 11898-1), as engines, hosts and the simulator exchange it.

/// A CAN identifier: 11 bits (base format) or 29 bits (extended format).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Id {
    /// Base format, 0..=0x7FF.
    Standard(u16),
    /// Extended format, 0..=0x1FFF_FFFF.
    Extended(u32),
}

/// A data or remote frame; at most 8 data bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Frame {
    id: Id,
    remote: bool,
    len: u8,
    data: [u8; 8],
}

impl Frame {
    /// A data frame. `None` when the identifier is out of range or there are more than 8 bytes.
    #[must_use]
    pub fn new(id: Id, data: &[u8]) -> Option<Self> {
        let fits = match id {
            Id::Standard(id) => id <= 0x7FF,
            Id::Extended(id) => id <= 0x1FFF_FFFF,
        };
        if !fits || data.len() > 8 {
            return None;
        }
        let mut bytes = [0; 8];
        bytes[..data.len()].copy_from_slice(data);
        Some(Self { id, remote: false, len: data.len() as u8, data: bytes })
    }

    /// A remote frame that asks for `len` bytes (0..=8).
    #[must_use]
    pub fn remote(id: Id, len: u8) -> Option<Self> {
        let frame = Self::new(id, &[])?;
        (len <= 8).then_some(Self { remote: true, len, ..frame })
    }

    /// A data frame with an 11-bit identifier, of which only the low 11 bits count; data beyond 8 bytes is cut
    /// off. For engines, whose identifiers and lengths are right by construction.
    #[must_use]
    pub fn standard(id: u16, data: &[u8]) -> Self {
        let len = data.len().min(8);
        let mut bytes = [0; 8];
        bytes[..len].copy_from_slice(&data[..len]);
        Self { id: Id::Standard(id & 0x7FF), remote: false, len: len as u8, data: bytes }
    }

    /// A remote frame with an 11-bit identifier, of which only the low 11 bits count, that asks for `len` bytes, at
    /// most 8; see [`Self::standard`].
    #[must_use]
    pub fn standard_remote(id: u16, len: u8) -> Self {
        Self { remote: true, len: len.min(8), ..Self::standard(id, &[]) }
    }

    /// The identifier.
    #[must_use]
    pub fn id(&self) -> Id {
        self.id
    }

    /// True if it is a remote frame (it asks for data and carries none).
    #[must_use]
    pub fn is_remote(&self) -> bool {
        self.remote
    }

    /// Data length code: bytes carried, or requested by a remote frame.
    #[must_use]
    pub fn dlc(&self) -> u8 {
        self.len
    }

    /// The data; empty for a remote frame.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        if self.remote { &[] } else { &self.data[..usize::from(self.len)] }
    }
}

/// Bits between two frames (intermission).
pub const INTERMISSION: u32 = 3;
/// After the CRC: its delimiter, acknowledgement and its delimiter, end of frame.
const TAIL: u32 = 10;

/// Bits of a frame on the wire from its start to the end of its end, with the stuffed bits that its content needs.
#[must_use]
pub fn frame_bits(frame: &Frame) -> u32 {
    let remote = u128::from(frame.is_remote());
    // What follows the start of the frame, which is 0.
    let (mut bits, mut count) = match frame.id() {
        // RTR, IDE 0, r0.
        Id::Standard(id) => (u128::from(id) << 3 | remote << 2, 14),
        // 11 bits, SRR, IDE, 18 bits, RTR, r1, r0.
        Id::Extended(id) => (u128::from(id >> 18) << 23 | 3 << 21 | u128::from(id & 0x3_FFFF) << 3 | remote << 2, 34),
    };
    bits = bits << 4 | u128::from(frame.dlc());
    count += 4;
    for byte in frame.data() {
        bits = bits << 8 | u128::from(*byte);
        count += 8;
    }
    // The CRC begins with 0, so zeros in front change nothing.
    let bytes = (count as usize).div_ceil(8);
    let crc = bits.to_be_bytes()[16 - bytes..].iter().fold(0, |crc, byte| crc_of(crc, *byte));
    bits = bits << 15 | u128::from(crc);
    count += 15;
    // Left-aligned; what is behind the end is not looked at.
    let mut rest = bits << (128 - count);
    let (mut level_run, mut stuffed) = (LevelRun(0), 0);
    for _ in 0..count / 8 {
        let next = STUFF[usize::from(level_run.0)][(rest >> 120) as usize];
        (level_run, stuffed) = (LevelRun(next & 7), stuffed + u32::from(next >> 3));
        rest <<= 8;
    }
    for _ in 0..count % 8 {
        let next = level_run.take((rest >> 127) as u8);
        (level_run, stuffed) = (LevelRun(next & 7), stuffed + u32::from(next >> 3));
        rest <<= 1;
    }
    1 + count + stuffed + TAIL
}

/// CRC-15/CAN, goes on by a byte.
const fn crc_of(crc: u16, byte: u8) -> u16 {
    (crc << 8 ^ CRC[(crc >> 7) as usize ^ byte as usize]) & 0x7FFF
}

const CRC: [u16; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut crc, mut bit) = ((byte as u16) << 7, 0);
        while bit < 8 {
            crc = (crc << 1) ^ if crc & 0x4000 == 0 { 0 } else { 0x4599 };
            bit += 1;
        }
        table[byte] = crc & 0x7FFF;
        byte += 1;
    }
    table
};

/// The level of the last bit (4), and how many of that level it ends, less one (0 to 3).
#[derive(Clone, Copy)]
struct LevelRun(u8);

impl LevelRun {
    /// State after a bit; 8 is added if a bit is stuffed after it: the opposite, and the first of its run.
    const fn take(self, bit: u8) -> u8 {
        match (bit == self.0 >> 2, self.0 & 3) {
            (false, _) => bit << 2,
            (true, 3) => 8 + ((bit ^ 1) << 2),
            (true, _) => self.0 + 1,
        }
    }
}

/// State after eight bits, for each level and run.
static STUFF: [[u8; 256]; 8] = {
    let mut table = [[0; 256]; 8];
    let mut cell = 0;
    while cell < 8 * 256 {
        let (mut level_run, mut stuffed, mut bit) = (LevelRun((cell >> 8) as u8), 0, 8);
        while bit > 0 {
            bit -= 1;
            let next = level_run.take((cell >> bit & 1) as u8);
            level_run = LevelRun(next & 7);
            stuffed += next >> 3;
        }
        table[cell >> 8][cell & 255] = stuffed << 3 | level_run.0;
        cell += 1;
    }
    table
};

/// Fault confinement state of a controller (ISO 11898-1), with the warning level that controllers report besides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BusState {
    /// Error-active, both counters below 96.
    #[default]
    Active,
    /// Error-active, a counter at 96 or more.
    Warning,
    /// Error-passive: a counter above 127.
    Passive,
    /// Off the bus: the transmit counter went above 255. Nothing is sent or received until the controller is restarted.
    Off,
}

impl BusState {
    /// The state that the two error counters name; bus-off no counter of eight bits can show.
    #[must_use]
    pub const fn of(transmit_errors: u8, receive_errors: u8) -> Self {
        match if transmit_errors > receive_errors { transmit_errors } else { receive_errors } {
            0..96 => Self::Active,
            96..128 => Self::Warning,
            128.. => Self::Passive,
        }
    }
}

/// State of a controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Health {
    /// State.
    pub state: BusState,
    /// Transmit error counter.
    pub transmit_errors: u8,
    /// Receive error counter.
    pub receive_errors: u8,
}

/// Notice of a controller beside frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Notice {
    /// State or its counters changed.
    Health(Health),
    /// A frame was sent and not acknowledged: the controller is alone on its bus, or cut off.
    NoAcknowledge,
    /// Number of frames with an error on the wire since the last such notice.
    Errors(u32),
    /// Number of received frames lost for want of room since the last such notice.
    Lost(u32),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_a_frame_is_refused() {
        assert!(Frame::new(Id::Standard(0x800), &[]).is_none());
        assert!(Frame::new(Id::Extended(0x2000_0000), &[]).is_none());
        assert!(Frame::new(Id::Standard(1), &[0; 9]).is_none());
        assert!(Frame::remote(Id::Standard(1), 9).is_none());
        let frame = Frame::remote(Id::Standard(1), 4).unwrap();
        assert_eq!((frame.dlc(), frame.data()), (4, &[][..]));
    }

    #[test]
    fn the_warning_level_is_96_and_passive_begins_at_128() {
        let state = |errors| BusState::of(errors, 0);
        assert_eq!(
            [95, 96, 127, 128].map(state),
            [BusState::Active, BusState::Warning, BusState::Warning, BusState::Passive]
        );
        assert_eq!(BusState::of(0, 255), BusState::Passive);
    }

    /// As the standard has it, bit by bit: counts bits with stuffing; keeps the CRC-15.
    #[derive(Default)]
    struct Bits {
        count: u32,
        crc: u16,
        level: u32,
        run: u32,
    }

    impl Bits {
        fn push(&mut self, value: u32, width: u32) {
            for shift in (0..width).rev() {
                let bit = value >> shift & 1;
                let feedback = bit ^ u32::from(self.crc >> 14 & 1);
                self.crc = (self.crc << 1 & 0x7FFF) ^ if feedback == 1 { 0x4599 } else { 0 };
                self.run = if self.count > 0 && bit == self.level { self.run + 1 } else { 1 };
                self.level = bit;
                self.count += 1;
                if self.run == 5 {
                    // The stuffed bit is the opposite, and the first of the next run.
                    self.count += 1;
                    self.level ^= 1;
                    self.run = 1;
                }
            }
        }
    }

    #[test]
    fn after_five_equal_bits_comes_one_that_begins_the_next_run() {
        let mut bits = Bits::default();
        bits.push(0, 13); // 00000 [1] 00000 [1] 000
        assert_eq!(bits.count, 13 + 2);
        let mut bits = Bits::default();
        bits.push(0b00000_11110, 10); // 00000 [1] 1111 [0] 0
        assert_eq!(bits.count, 12);
    }

    #[test]
    fn the_crc_is_that_of_the_standard() {
        // CRC-15/CAN: check value of "123456789" is 0x059E.
        let mut bits = Bits::default();
        for byte in b"123456789" {
            bits.push(u32::from(*byte), 8);
        }
        assert_eq!(bits.crc, 0x059E);
    }

    fn bit_by_bit(frame: &Frame) -> u32 {
        let mut bits = Bits::default();
        bits.push(0, 1); // Start of frame.
        let remote = u32::from(frame.is_remote());
        match frame.id() {
            Id::Standard(id) => {
                bits.push(u32::from(id), 11);
                bits.push(remote << 2, 3); // RTR, IDE 0, r0.
            }
            Id::Extended(id) => {
                bits.push(id >> 18, 11);
                bits.push(3, 2); // SRR, IDE.
                bits.push(id & 0x3_FFFF, 18);
                bits.push(remote << 2, 3); // RTR, r1, r0.
            }
        }
        bits.push(u32::from(frame.dlc()), 4);
        for byte in frame.data() {
            bits.push(u32::from(*byte), 8);
        }
        let crc = bits.crc;
        bits.push(u32::from(crc), 15);
        bits.count + TAIL
    }

    #[test]
    fn the_tables_say_what_the_bits_say() {
        let mut chance = 1u64;
        let mut random = || {
            chance = chance.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            chance >> 16
        };
        for n in 0..50_000 {
            // Long runs, too: random bits hardly have any.
            let sparse = if n % 2 == 0 { u64::MAX } else { random() & random() & random() };
            let invert = if n % 3 == 0 { u64::MAX } else { 0 };
            let data = (((random() | random() << 40) & sparse) ^ invert).to_le_bytes();
            let len = (random() % 9) as usize;
            let id = (random() & sparse) as u32;
            let id = if n % 5 < 2 { Id::Extended(id & 0x1FFF_FFFF) } else { Id::Standard(id as u16 & 0x7FF) };
            let frame = match n % 7 {
                0 => Frame::remote(id, len as u8),
                _ => Frame::new(id, &data[..len]),
            };
            let frame = frame.unwrap();
            assert_eq!(frame_bits(&frame), bit_by_bit(&frame), "{frame:?}");
        }
    }
}
