//! Identifiers of participants and endpoints (9.3.1).

/// Identifier of a participant: unique in the domain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Prefix(pub [u8; 12]);

/// Identifier of an endpoint within its participant. The last byte is its kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Entity(pub [u8; 4]);

impl Entity {
    /// Any endpoint that matches the sender's.
    pub const UNKNOWN: Self = Self([0; 4]);
    /// The participant itself.
    pub const PARTICIPANT: Self = Self([0, 0, 1, 0xc1]);
    pub(crate) const SPDP_WRITER: Self = Self([0, 1, 0, 0xc2]);
    pub(crate) const SPDP_READER: Self = Self([0, 1, 0, 0xc7]);
    pub(crate) const PUBLICATIONS_WRITER: Self = Self([0, 0, 3, 0xc2]);
    pub(crate) const PUBLICATIONS_READER: Self = Self([0, 0, 3, 0xc7]);
    pub(crate) const SUBSCRIPTIONS_WRITER: Self = Self([0, 0, 4, 0xc2]);
    pub(crate) const SUBSCRIPTIONS_READER: Self = Self([0, 0, 4, 0xc7]);

    /// The writer number `n` of a user's, for topics without keys.
    pub(crate) fn writer(n: u16) -> Self {
        let [high, low] = n.to_be_bytes();
        Self([0, high, low, 0x03])
    }

    /// The reader number `n` of a user's, for topics without keys.
    pub(crate) fn reader(n: u16) -> Self {
        let [high, low] = n.to_be_bytes();
        Self([0, high, low, 0x04])
    }
}

/// Identifier of an endpoint or, with [`Entity::PARTICIPANT`], of a participant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Guid {
    /// Its participant.
    pub prefix: Prefix,
    /// Which of the participant's endpoints.
    pub entity: Entity,
}

impl Guid {
    /// The 16 bytes of the wire.
    #[must_use]
    pub fn bytes(self) -> [u8; 16] {
        let mut bytes = [0; 16];
        bytes[..12].copy_from_slice(&self.prefix.0);
        bytes[12..].copy_from_slice(&self.entity.0);
        bytes
    }

    pub(crate) fn from_bytes(bytes: [u8; 16]) -> Self {
        let (mut prefix, mut entity) = ([0; 12], [0; 4]);
        prefix.copy_from_slice(&bytes[..12]);
        entity.copy_from_slice(&bytes[12..]);
        Self { prefix: Prefix(prefix), entity: Entity(entity) }
    }
}

/// Identifier of a sample: who wrote it, and its sequence number (8.3.5.4). A request is known by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SampleIdentity {
    /// Who wrote it.
    pub writer: Guid,
    /// Its number, from 1; [`UNKNOWN_NUMBER`](Self::UNKNOWN_NUMBER) where the writer of a request names the reader of
    /// its answers by `writer`, as Fast DDS does.
    pub number: i64,
}

impl SampleIdentity {
    /// SEQUENCENUMBER_UNKNOWN (9.3.2.9).
    pub const UNKNOWN_NUMBER: i64 = -1 << 32;
}
