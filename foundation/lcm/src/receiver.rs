//! The receiving side without its socket: datagrams in, wanted messages out, everything counted.

use crate::subscription::{Pattern, PatternError, SubscriptionId, Subscriptions};
use crate::udpm::{self, Datagram, DecodeError, Fragment, Short};
use core::fmt;
use core::net::SocketAddrV4;

/// What became of the datagrams. Everything only grows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Messages handed out.
    pub received: u64,
    /// Messages on channels that nobody here subscribed to.
    pub unwanted: u64,
    /// Datagrams that are not LCM's; the newest is in `last_rejected`.
    pub malformed: u64,
    /// Fragments of messages larger than [`udpm::SHORT_MAX`], dropped: not supported yet.
    pub fragments: u64,
    /// Messages missing in the sequence numbers of their publishers, wherever they were lost; those that
    /// `kernel_dropped` counts are among them.
    pub lost: u64,
    /// Datagrams that the kernel dropped because the receive buffer was full, as of the last one received.
    pub kernel_dropped: u64,
    /// Messages given to the kernel.
    pub sent: u64,
    /// Messages that the kernel had no room for.
    pub send_refused: u64,
    /// The newest datagram that should have been understood and was not.
    pub last_rejected: Option<Rejected>,
}

/// A datagram that was dropped for what it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rejected {
    /// Who sent it.
    pub from: SocketAddrV4,
    /// What is wrong with it.
    pub why: Rejection,
}

/// Why a datagram was dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rejection {
    /// It is not one of LCM's.
    Malformed(DecodeError),
    /// It starts a message of `total` bytes on a wanted channel, in fragments: not supported yet.
    Fragmented {
        /// Payload bytes of the message.
        total: u32,
    },
}

impl Rejection {
    /// Its kind, without what differs from datagram to datagram: one word.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Malformed(why) => why.kind(),
            Self::Fragmented { .. } => "Fragmented",
        }
    }
}

/// All rejected datagrams of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rejections {
    /// The newest.
    pub last: Rejected,
    /// How many so far.
    pub count: u64,
}

impl fmt::Display for Rejected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "LCM datagram from {} dropped: ", self.from)?;
        match self.why {
            Rejection::Malformed(why) => write!(f, "{why}"),
            Rejection::Fragmented { total } => {
                write!(f, "a message of {total} bytes in fragments, which are not supported yet")
            }
        }
    }
}

/// Subscriptions, the sequence numbers of the publishers, and the counters.
#[derive(Debug, Default)]
pub struct Receiver {
    subscriptions: Subscriptions,
    sources: Sources,
    /// One for each kind that came.
    rejections: Vec<Rejections>,
    /// The counters; a transport adds its own.
    pub stats: Stats,
}

impl Receiver {
    /// Wants the channels of `pattern` from now on.
    ///
    /// # Errors
    /// The pattern is not a regular expression.
    pub fn subscribe(&mut self, pattern: &str) -> Result<SubscriptionId, PatternError> {
        Pattern::new(pattern).map(|pattern| self.subscriptions.add(pattern))
    }

    /// Ends a subscription; false when there is none such.
    pub fn unsubscribe(&mut self, id: SubscriptionId) -> bool {
        self.subscriptions.remove(id)
    }

    /// Takes a datagram in; returns the message if it is a wanted one.
    pub fn handle_rx<'a>(&mut self, from: SocketAddrV4, datagram: &'a [u8]) -> Option<Short<'a>> {
        let decoded = udpm::decode(datagram);
        if let Ok(datagram) = &decoded {
            self.stats.lost += u64::from(self.sources.missing(from, datagram.sequence()));
        }
        match decoded {
            Ok(Datagram::Short(short)) if self.subscriptions.wants(short.channel) => {
                self.stats.received += 1;
                return Some(short);
            }
            Ok(Datagram::Short(_)) => self.stats.unwanted += 1,
            Ok(Datagram::Fragment(fragment)) => self.on_fragment(from, fragment),
            Err(why) => {
                self.stats.malformed += 1;
                self.reject(Rejected { from, why: Rejection::Malformed(why) });
            }
        }
        None
    }

    fn on_fragment(&mut self, from: SocketAddrV4, fragment: Fragment<'_>) {
        self.stats.fragments += 1;
        if fragment.channel.is_some_and(|channel| self.subscriptions.wants(channel)) {
            self.reject(Rejected { from, why: Rejection::Fragmented { total: fragment.total } });
        }
    }

    fn reject(&mut self, rejected: Rejected) {
        self.stats.last_rejected = Some(rejected);
        let kind = rejected.why.kind();
        match self.rejections.iter_mut().find(|known| known.last.why.kind() == kind) {
            Some(known) => *known = Rejections { last: rejected, count: known.count + 1 },
            None => self.rejections.push(Rejections { last: rejected, count: 1 }),
        }
    }

    /// What was rejected so far, by kind.
    #[must_use]
    pub fn rejections(&self) -> &[Rejections] {
        &self.rejections
    }
}

/// How many publishers are followed; of more, the one silent for longest is forgotten.
const SOURCES_MAX: usize = 64;
/// A jump by more than this is another publisher at the same address, not a loss.
const JUMP_MAX: u32 = 1 << 20;
/// A number behind by no more than this is a datagram that was overtaken, or came twice.
const LATE_MAX: u32 = 64;

/// The next sequence number of each publisher.
#[derive(Debug, Default)]
struct Sources {
    entries: Vec<Source>,
    heard: u64,
}

#[derive(Debug)]
struct Source {
    from: SocketAddrV4,
    next: u32,
    /// Value of [`Sources::heard`] when it was last heard.
    last: u64,
}

impl Sources {
    /// How many messages of this publisher are missing before `sequence`.
    fn missing(&mut self, from: SocketAddrV4, sequence: u32) -> u32 {
        self.heard += 1;
        let next = sequence.wrapping_add(1);
        let Some(source) = self.entries.iter_mut().find(|source| source.from == from) else {
            self.insert(Source { from, next, last: self.heard });
            return 0;
        };
        source.last = self.heard;
        let ahead = sequence.wrapping_sub(source.next);
        if ahead.wrapping_neg() <= LATE_MAX && ahead != 0 {
            return 0; // also: the other fragments of the newest message
        }
        source.next = next;
        if ahead <= JUMP_MAX { ahead } else { 0 }
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

    fn datagram(sequence: u32, channel: &str, payload: &[u8]) -> Vec<u8> {
        let header = udpm::ShortHeader::new(sequence, channel, payload.len()).unwrap();
        [header.as_bytes(), payload].concat()
    }

    /// Messages lost when one publisher's sequence numbers arrive as given.
    fn lost(sequences: &[u32]) -> u64 {
        let mut receiver = Receiver::default();
        for &sequence in sequences {
            receiver.handle_rx(publisher(1), &datagram(sequence, "A", b""));
        }
        receiver.stats.lost
    }

    #[test]
    fn only_subscribed_channels_are_handed_out() {
        let mut receiver = Receiver::default();
        let id = receiver.subscribe("A.").unwrap();
        let wanted = datagram(0, "AB", b"x");
        assert_eq!(receiver.handle_rx(publisher(1), &wanted).map(|short| short.payload), Some(&b"x"[..]));
        assert_eq!(receiver.handle_rx(publisher(1), &datagram(1, "B", b"x")), None);
        assert!(receiver.unsubscribe(id));
        assert_eq!(receiver.handle_rx(publisher(1), &datagram(2, "AB", b"x")), None);
        let Stats { received, unwanted, malformed, lost, .. } = receiver.stats;
        assert_eq!((received, unwanted, malformed, lost), (1, 2, 0, 0));
    }

    #[test]
    fn what_is_not_understood_is_counted_and_the_last_kept() {
        let mut receiver = Receiver::default();
        receiver.subscribe("BIG").unwrap();
        assert_eq!(receiver.handle_rx(publisher(5), b"hello"), None);
        let line = "LCM datagram from 127.0.0.1:5 dropped: 5 bytes do not hold an LCM header";
        assert_eq!(receiver.stats.last_rejected.unwrap().to_string(), line);
        let first = b"LC03\0\0\0\0\0\x01\0\0\0\0\0\0\0\0\0\x02BIG\0abc";
        assert_eq!(receiver.handle_rx(publisher(6), first), None);
        let line = "LCM datagram from 127.0.0.1:6 dropped: a message of 65536 bytes in fragments, which are not \
                    supported yet";
        assert_eq!(receiver.stats.last_rejected.unwrap().to_string(), line);
        assert_eq!((receiver.stats.malformed, receiver.stats.fragments), (1, 1));
        for _ in 0..9 {
            receiver.handle_rx(publisher(5), b"hello you");
        }
        let by_kind: Vec<_> = receiver.rejections().iter().map(|kind| (kind.last.why.kind(), kind.count)).collect();
        assert_eq!(by_kind, [("TooShort", 1), ("Fragmented", 1), ("Magic", 9)]);
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
        let mut receiver = Receiver::default();
        for round in [0, 1, 2, 4] {
            for port in 1..=SOURCES_MAX as u16 {
                receiver.handle_rx(publisher(port), &datagram(round, "A", b""));
            }
        }
        assert_eq!(receiver.stats.lost, SOURCES_MAX as u64);
        for port in 0..u16::MAX {
            receiver.handle_rx(publisher(port), &datagram(9, "A", b""));
        }
        assert_eq!(receiver.sources.entries.len(), SOURCES_MAX);
    }
}
