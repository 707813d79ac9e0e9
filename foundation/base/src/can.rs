//! A classic CAN frame (ISO 11898-1), as engines, hosts and the simulator exchange it.

/// A CAN identifier: 11 bits (base format) or 29 bits (extended format).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Id {
    /// Base format, 0..=0x7FF.
    Standard(u16),
    /// Extended format, 0..=0x1FFF_FFFF.
    Extended(u32),
}

/// One data or remote frame; at most 8 data bytes.
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

    /// The identifier.
    #[must_use]
    pub fn id(&self) -> Id {
        self.id
    }

    /// Whether it is a remote frame (it asks for data and carries none).
    #[must_use]
    pub fn is_remote(&self) -> bool {
        self.remote
    }

    /// The data length code: bytes carried, or asked for by a remote frame.
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
}
