//! Packets of LDROBOT lidars: encode and decode, without state.

/// Length of a packet, bytes.
pub const LENGTH: usize = 47;
/// Samples of a packet.
pub const SAMPLES: usize = 12;
/// First byte of a packet.
pub const HEADER: u8 = 0x54;
/// Second byte: type 1 in the upper 3 bits, number of samples in the lower 5.
pub const TYPE_AND_COUNT: u8 = 0x2C;
/// The clock starts again at this value, ms.
pub const CLOCK_MODULUS_MS: u16 = 30_000;
/// Bits per second of the line.
pub const BAUD: u32 = 230_400;

/// A sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sample {
    /// mm; 0: no echo.
    pub range_mm: u16,
    /// 0 to 255.
    pub intensity: u8,
}

/// A packet. Angles count clockwise, seen from above, from the front.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet {
    /// Degrees per second.
    pub speed: u16,
    /// Direction of the first sample, 0.01°.
    pub start_angle: u16,
    /// Samples, equally spaced from the first angle to the last.
    pub samples: [Sample; SAMPLES],
    /// Direction of the last sample, 0.01°.
    pub end_angle: u16,
    /// Clock of the device, ms, below [`CLOCK_MODULUS_MS`].
    pub timestamp_ms: u16,
}

/// CRC-8 with the polynomial 0x4D, from 0, not reflected.
#[must_use]
pub fn crc(bytes: &[u8]) -> u8 {
    const TABLE: [u8; 256] = {
        let mut table = [0; 256];
        let mut n = 0;
        while n < 256 {
            let (mut crc, mut bit) = (n as u8, 0);
            while bit < 8 {
                crc = if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ 0x4D };
                bit += 1;
            }
            table[n] = crc;
            n += 1;
        }
        table
    };
    bytes.iter().fold(0, |crc, byte| TABLE[usize::from(crc ^ byte)])
}

fn word(bytes: &[u8; LENGTH], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

impl Packet {
    /// Decodes a packet. `None`: header, checksum, an angle or the clock is not valid.
    #[must_use]
    pub fn decode(bytes: &[u8; LENGTH]) -> Option<Self> {
        if bytes[0] != HEADER || bytes[1] != TYPE_AND_COUNT || crc(&bytes[..LENGTH - 1]) != bytes[LENGTH - 1] {
            return None;
        }
        let mut samples = [Sample::default(); SAMPLES];
        for (n, sample) in samples.iter_mut().enumerate() {
            let at = 6 + 3 * n;
            *sample = Sample { range_mm: word(bytes, at), intensity: bytes[at + 2] };
        }
        let packet = Self {
            speed: word(bytes, 2),
            start_angle: word(bytes, 4),
            samples,
            end_angle: word(bytes, 42),
            timestamp_ms: word(bytes, 44),
        };
        let is_valid =
            packet.start_angle < 36_000 && packet.end_angle < 36_000 && packet.timestamp_ms <= CLOCK_MODULUS_MS;
        is_valid.then_some(packet)
    }

    /// Encodes a packet.
    #[must_use]
    pub fn encode(&self) -> [u8; LENGTH] {
        let mut bytes = [0; LENGTH];
        (bytes[0], bytes[1]) = (HEADER, TYPE_AND_COUNT);
        bytes[2..4].copy_from_slice(&self.speed.to_le_bytes());
        bytes[4..6].copy_from_slice(&self.start_angle.to_le_bytes());
        for (n, sample) in self.samples.iter().enumerate() {
            let at = 6 + 3 * n;
            bytes[at..at + 2].copy_from_slice(&sample.range_mm.to_le_bytes());
            bytes[at + 2] = sample.intensity;
        }
        bytes[42..44].copy_from_slice(&self.end_angle.to_le_bytes());
        bytes[44..46].copy_from_slice(&self.timestamp_ms.to_le_bytes());
        bytes[LENGTH - 1] = crc(&bytes[..LENGTH - 1]);
        bytes
    }

    /// Angle from the first sample to the last, 0.01°.
    #[must_use]
    pub fn span(&self) -> u32 {
        (36_000 + u32::from(self.end_angle) - u32::from(self.start_angle)) % 36_000
    }
}
