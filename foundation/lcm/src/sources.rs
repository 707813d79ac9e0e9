//! Who publishes, and what of theirs is missing: the sequence numbers of each publisher.

use core::net::SocketAddrV4;

/// Maximum number of publishers that are followed; of more, the one silent for longest is forgotten.
pub const SOURCES_MAX: usize = 64;
/// A jump by more than this is another publisher at the same address, not a loss.
const JUMP_MAX: u32 = 1 << 20;
/// A number behind by no more than this is a datagram that was overtaken, or came twice.
const LATE_MAX: u32 = 64;

/// A publisher: one context of one process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Source {
    /// Address.
    pub from: SocketAddrV4,
    /// Datagrams of it that came.
    pub datagrams: u64,
    /// Messages of it that are missing.
    pub lost: u64,
    next: u32,
    /// Value of [`Sources::heard`] at its last message.
    last: u64,
}

/// The publishers.
#[derive(Clone, Debug, Default)]
pub struct Sources {
    entries: Vec<Source>,
    heard: u64,
}

impl Sources {
    /// All publishers that are followed.
    #[must_use]
    pub fn as_slice(&self) -> &[Source] {
        &self.entries
    }

    /// Notes a datagram of a publisher; how many of its messages are missing before it.
    pub fn heard(&mut self, from: SocketAddrV4, sequence: u32) -> u32 {
        self.heard += 1;
        let next = sequence.wrapping_add(1);
        let Some(source) = self.entries.iter_mut().find(|source| source.from == from) else {
            self.insert(Source { from, datagrams: 1, lost: 0, next, last: self.heard });
            return 0;
        };
        source.last = self.heard;
        source.datagrams += 1;
        let ahead = sequence.wrapping_sub(source.next);
        if ahead.wrapping_neg() <= LATE_MAX && ahead != 0 {
            return 0; // also: the other fragments of the newest message
        }
        source.next = next;
        let missing = if ahead <= JUMP_MAX { ahead } else { 0 };
        source.lost += u64::from(missing);
        missing
    }

    fn insert(&mut self, source: Source) {
        if self.entries.len() < SOURCES_MAX {
            self.entries.push(source);
        } else if let Some(oldest) = self.entries.iter_mut().min_by_key(|entry| entry.last) {
            *oldest = source;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::net::Ipv4Addr;

    fn publisher(port: u16) -> SocketAddrV4 {
        SocketAddrV4::new(Ipv4Addr::LOCALHOST, port)
    }

    /// Messages lost when one publisher's sequence numbers arrive as given.
    fn lost(sequences: &[u32]) -> u64 {
        let mut sources = Sources::default();
        let missing: u32 = sequences.iter().map(|&sequence| sources.heard(publisher(1), sequence)).sum();
        assert_eq!(sources.as_slice()[0].lost, u64::from(missing));
        u64::from(missing)
    }

    #[test]
    fn gaps_in_a_publishers_numbers_are_losses() {
        assert_eq!(lost(&[0, 1, 2]), 0);
        assert_eq!(lost(&[7, 8, 11, 12, 14]), 3, "the first number heard is where we came in");
        assert_eq!(lost(&[u32::MAX - 1, 1]), 2, "the numbers wrap");
    }

    #[test]
    fn twice_late_or_begun_anew_is_no_loss() {
        assert_eq!(lost(&[5, 5, 6]), 0);
        assert_eq!(lost(&[5, 4, 6]), 0);
        assert_eq!(lost(&[5000, 0, 1, 2]), 0, "another process got the port");
        assert_eq!(lost(&[0, 3_000_000_000, 3_000_000_001]), 0);
    }

    #[test]
    fn publishers_do_not_disturb_each_other_and_are_bounded() {
        let mut sources = Sources::default();
        let mut lost = 0;
        for round in [0, 1, 2, 4] {
            for port in 1..=SOURCES_MAX as u16 {
                lost += sources.heard(publisher(port), round);
            }
        }
        assert_eq!(lost as usize, SOURCES_MAX);
        assert!(sources.as_slice().iter().all(|source| (source.datagrams, source.lost) == (4, 1)));
        for port in 0..u16::MAX {
            sources.heard(publisher(port), 9);
        }
        assert_eq!(sources.as_slice().len(), SOURCES_MAX);
    }
}
