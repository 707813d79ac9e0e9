//! Authentication and integrity: a key that both computers have, HMAC-SHA256 (RFC 2104, FIPS 198-1), a nonce of each
//! end for the session, and a counter of each direction for its records. Nothing is encrypted.

use hmac::{Hmac, Mac};
use sha2::Sha256;
use std::fmt::{self, Write};

/// Length of a key, bytes.
pub const KEY_LEN: usize = 32;
/// Length of a nonce, bytes.
pub const NONCE_LEN: usize = 32;
/// Length of a tag, bytes.
pub const TAG_LEN: usize = 32;

/// Labels of what is computed from the key: for no two uses the same.
const PROOFS: [&[u8]; 2] = [b"advee bridge 1 proof of connector", b"advee bridge 1 proof of listener."];
const RECORDS: [&[u8]; 2] = [b"advee bridge 1 key of connector..", b"advee bridge 1 key of listener..."];

/// Secret that both computers have.
#[derive(Clone, PartialEq, Eq)]
pub struct Key([u8; KEY_LEN]);

/// Does not show the secret.
impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key")
    }
}

impl Key {
    /// Key of random bytes.
    #[must_use]
    pub const fn new(bytes: [u8; KEY_LEN]) -> Self {
        Self(bytes)
    }

    /// Key as it is written in a file: 64 hexadecimal digits, and white space around them. `None` for any other text.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let digits = text.trim().as_bytes();
        if digits.len() != 2 * KEY_LEN {
            return None;
        }
        let mut bytes = [0; KEY_LEN];
        for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
            let [high, low] = [pair[0], pair[1]].map(|digit| char::from(digit).to_digit(16));
            *byte = (high? * 16 + low?) as u8;
        }
        Some(Self(bytes))
    }

    /// The text that [`Key::parse`] reads, without a line end.
    #[must_use]
    pub fn to_text(&self) -> String {
        self.0.iter().fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        })
    }
}

/// End of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// It opens the connection.
    Connector,
    /// It waits for it.
    Listener,
}

impl Role {
    /// The role of the other end.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::Connector => Self::Listener,
            Self::Listener => Self::Connector,
        }
    }
}

/// Nonces of both ends, by which a session differs from every other one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transcript {
    /// Drawn by the connector.
    pub connector: [u8; NONCE_LEN],
    /// Drawn by the listener.
    pub listener: [u8; NONCE_LEN],
}

impl Transcript {
    /// Proof that the end of this role has the key, in this session.
    #[must_use]
    pub fn proof(&self, key: &Key, role: Role) -> [u8; TAG_LEN] {
        self.mac(key, PROOFS[role as usize]).finalize().into_bytes().into()
    }

    /// True if `proof` is that of the end of this role; takes the same time for every wrong one.
    #[must_use]
    pub fn is_proof(&self, key: &Key, role: Role, proof: &[u8]) -> bool {
        self.mac(key, PROOFS[role as usize]).verify_slice(proof).is_ok()
    }

    /// Session of the end of this role.
    #[must_use]
    pub fn session(&self, key: &Key, role: Role) -> Session {
        let of = |role: Role| mac(&self.mac(key, RECORDS[role as usize]).finalize().into_bytes());
        Session { seals: of(role), sealed: 0, opens: of(role.other()), opened: 0 }
    }

    fn mac(&self, key: &Key, label: &[u8]) -> Hmac<Sha256> {
        let mut mac = mac(&key.0);
        [label, &self.connector, &self.listener].into_iter().for_each(|part| mac.update(part));
        mac
    }
}

fn mac(key: &[u8]) -> Hmac<Sha256> {
    // HMAC takes keys of any length.
    Hmac::new_from_slice(key).unwrap_or_else(|_| unreachable!("a key of {} bytes", key.len()))
}

/// Keys and counters of a session: a record is accepted once, in its place, and in its direction only.
pub struct Session {
    seals: Hmac<Sha256>,
    sealed: u64,
    opens: Hmac<Sha256>,
    opened: u64,
}

impl Session {
    /// Tag of the next record that this end sends.
    pub fn seal(&mut self, body: &[u8]) -> [u8; TAG_LEN] {
        let tag = numbered(&self.seals, self.sealed, body).finalize().into_bytes().into();
        self.sealed += 1;
        tag
    }

    /// True if `tag` is that of the next record of the other end, with this body. A record that was changed, left out,
    /// repeated, or is of another session or direction is not; the session is then to be ended.
    #[must_use]
    pub fn open(&mut self, body: &[u8], tag: &[u8]) -> bool {
        let is_next = numbered(&self.opens, self.opened, body).verify_slice(tag).is_ok();
        self.opened += u64::from(is_next);
        is_next
    }
}

fn numbered(mac: &Hmac<Sha256>, number: u64, body: &[u8]) -> Hmac<Sha256> {
    let mut mac = mac.clone();
    mac.update(&number.to_be_bytes());
    mac.update(body);
    mac
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRANSCRIPT: Transcript = Transcript { connector: [1; NONCE_LEN], listener: [2; NONCE_LEN] };

    fn key(byte: u8) -> Key {
        Key::new([byte; KEY_LEN])
    }

    #[test]
    fn a_key_is_read_as_it_is_written() {
        let key = Key::new(std::array::from_fn(|n| n as u8 * 7));
        assert_eq!(Key::parse(&format!("{}\n", key.to_text())), Some(key.clone()));
        assert_eq!(format!("{key:?}"), "Key");
        let text = key.to_text();
        for wrong in ["", "00", &text[1..], &format!("{text}0"), &text.replace('0', "g"), &text.replace('0', "é")] {
            assert_eq!(Key::parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_proof_is_of_one_key_one_role_and_one_session() {
        let proof = TRANSCRIPT.proof(&key(7), Role::Connector);
        assert!(TRANSCRIPT.is_proof(&key(7), Role::Connector, &proof));
        assert!(!TRANSCRIPT.is_proof(&key(8), Role::Connector, &proof));
        assert!(!TRANSCRIPT.is_proof(&key(7), Role::Listener, &proof), "sent back to where it came from");
        assert!(!Transcript { listener: [3; NONCE_LEN], ..TRANSCRIPT }.is_proof(&key(7), Role::Connector, &proof));
        assert!(!TRANSCRIPT.is_proof(&key(7), Role::Connector, &proof[..31]));
    }

    #[test]
    fn a_record_is_accepted_once_in_its_place_and_direction() {
        let sessions = || [Role::Connector, Role::Listener].map(|role| TRANSCRIPT.session(&key(7), role));
        let [mut near, mut far] = sessions();
        let (first, second) = (near.seal(b"first"), near.seal(b"second"));
        assert!(!far.open(b"second", &second), "the first one is missing");
        assert!(far.open(b"first", &first));
        assert!(!far.open(b"first", &first), "repeated");
        assert!(!far.open(b"secone", &second), "changed");
        assert!(!near.open(b"first", &first), "reflected");
        assert!(far.open(b"second", &second));
        let other = Transcript { connector: [9; NONCE_LEN], ..TRANSCRIPT };
        assert!(!other.session(&key(7), Role::Listener).open(b"first", &first), "recorded in another session");
    }

    /// RFC 4231, test case 2: the library computes HMAC-SHA256.
    #[test]
    fn tags_are_hmac_sha256() {
        let mut mac = mac(b"Jefe");
        mac.update(b"what do ya want for nothing?");
        let tag: [u8; TAG_LEN] = mac.finalize().into_bytes().into();
        assert_eq!(Key::new(tag).to_text(), "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843");
    }
}
