//! The receiving side without its socket: datagrams in, wanted messages out, everything counted.
//!
//! ```
//! use lcm::{reassembly::Buffer, receiver::Receiver, subscription::Queue};
//!
//! let (mut receiver, mut buffer) = (Receiver::default(), Buffer::default());
//! receiver.subscribe("POSE", Queue::Transport).unwrap();
//! // Into the room of the buffer a socket would receive.
//! let datagram = b"LC02\0\0\0\x07POSE\0payload";
//! buffer.room()[..datagram.len()].copy_from_slice(datagram);
//! let (at, from) = (0, "127.0.0.1:4000".parse().unwrap());
//! let place = receiver.handle_rx(at, from, &mut buffer, datagram.len()).unwrap();
//! assert_eq!(receiver.message(place, &buffer), ("POSE", &b"payload"[..]));
//! ```

use crate::filter::SELF_TEST;
use crate::origin::Provenance;
use crate::queue::Line;
use crate::reassembly::{Buffer, Complete, Limits, Outcome, Reassembly};
use crate::sources::{Source, Sources};
use crate::subscription::{Pattern, PatternError, Queue, SubscriptionId, Subscriptions};
use crate::udpm::{self, Datagram, DecodeError};
use core::fmt;
use core::net::SocketAddrV4;

/// Counters of messages; they only grow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Messages on subscribed channels.
    pub received: u64,
    /// Messages received on channels without subscription.
    pub unwanted: u64,
    /// Datagrams that are not LCM's; the newest is in `last_rejected`.
    pub malformed: u64,
    /// Messages of which some fragments arrived and others did not, or for which there was no memory.
    pub incomplete: u64,
    /// Messages larger than their subscription takes.
    pub too_large: u64,
    /// Messages missing in the sequence numbers of their publishers, wherever they were lost, including those in
    /// `kernel_dropped`. See [`Receiver::sources`] for when this is known.
    pub lost: u64,
    /// Datagrams that the kernel dropped because the receive buffer was full, as of the last one received. While the
    /// kernel filters channels, unwanted ones that came in the same moment are among them.
    pub kernel_dropped: u64,
    /// Messages that the limits of subscriptions cost; see [`Queue`].
    pub queue_dropped: u64,
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
    /// Sender.
    pub from: SocketAddrV4,
    /// Defect.
    pub why: DecodeError,
}

/// Rejected datagrams of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rejections {
    /// The newest.
    pub last: Rejected,
    /// Number of them so far.
    pub count: u64,
}

impl fmt::Display for Rejected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "LCM datagram from {} dropped: {}", self.from, self.why)
    }
}

/// Place of a received message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// In the datagram, from here to its end.
    Datagram {
        /// Start of the payload.
        start: usize,
        /// End of the payload.
        end: usize,
    },
    /// In the receiver, where its fragments were put together.
    Assembled,
}

/// Subscriptions, large messages that are being put together, the sequence numbers of the publishers, and the
/// counters.
#[derive(Debug, Default)]
pub struct Receiver {
    subscriptions: Subscriptions,
    reassembly: Reassembly,
    sources: Sources,
    /// Sequence numbers of datagrams received before are not looked at; ns since 1970. `None`: of none.
    whole_since: Option<i64>,
    announced: Option<SocketAddrV4>,
    /// One entry for each kind that occurred.
    rejections: Vec<Rejections>,
    /// The counters; a transport adds its own.
    pub stats: Stats,
}

impl Receiver {
    /// Wants the channels of `pattern` from now on.
    ///
    /// # Errors
    /// The pattern is not a regular expression.
    pub fn subscribe(&mut self, pattern: &str, queue: Queue) -> Result<SubscriptionId, PatternError> {
        Pattern::new(pattern).map(|pattern| self.subscriptions.add(pattern, queue))
    }

    /// Ends a subscription; false if it does not exist.
    pub fn unsubscribe(&mut self, id: SubscriptionId) -> bool {
        self.subscriptions.remove(id)
    }

    /// Subscriptions.
    #[must_use]
    pub fn subscriptions(&self) -> &Subscriptions {
        &self.subscriptions
    }

    /// Subscriptions, for a queue of waiting messages.
    pub fn subscriptions_mut(&mut self) -> &mut Subscriptions {
        &mut self.subscriptions
    }

    /// Limits the payloads of a subscription to `size_max` bytes from now on; false if it does not exist.
    pub fn set_size_max(&mut self, id: SubscriptionId, size_max: usize) -> bool {
        self.subscriptions.set_size_max(id, size_max)
    }

    /// Limits the memory of messages of which fragments are missing, bytes; larger messages are refused.
    pub fn set_memory_max(&mut self, bytes: usize) {
        self.reassembly.set_limits(Limits { bytes, ..Limits::default() });
    }

    /// From `at` on (ns since 1970) all datagrams of the bus arrive here, so that gaps in sequence numbers are losses.
    pub fn hears_all(&mut self, at: i64) {
        (self.sources, self.whole_since) = (Sources::default(), Some(at));
    }

    /// To be called when the kernel filters datagrams: sequence numbers have gaps then.
    pub fn hears_some(&mut self) {
        (self.sources, self.whole_since) = (Sources::default(), None);
    }

    /// Publishers with their losses; empty while the kernel filters datagrams.
    #[must_use]
    pub fn sources(&self) -> &[Source] {
        self.sources.as_slice()
    }

    /// Takes the datagram in the first `len` bytes of `buffer`, received at `at`, ns since 1970. Returns the place of
    /// the wanted message that it completes, if any.
    pub fn handle_rx(&mut self, at: i64, from: SocketAddrV4, buffer: &mut Buffer, len: usize) -> Option<Place> {
        let decoded = udpm::decode(&buffer.room()[..len]);
        if let Ok(datagram) = &decoded
            && self.whole_since.is_some_and(|since| at >= since)
        {
            self.stats.lost += u64::from(self.sources.heard(from, datagram.sequence()));
        }
        match decoded {
            Ok(Datagram::Short(short)) if short.channel == SELF_TEST && !self.subscriptions.names_it(SELF_TEST) => {
                self.announced = Some(from);
                None
            }
            Ok(Datagram::Short(short)) if self.subscriptions.wants(short.channel) => {
                if !self.subscriptions.takes(short.channel, short.payload.len()) {
                    self.stats.too_large += 1;
                    return None;
                }
                self.stats.received += 1;
                Some(Place::Datagram { start: len - short.payload.len(), end: len })
            }
            Ok(Datagram::Short(_)) => {
                self.stats.unwanted += 1;
                None
            }
            Ok(Datagram::Fragment(_)) => self.on_fragment(at, from, buffer, len),
            Err(why) => {
                self.stats.malformed += 1;
                self.reject(Rejected { from, why });
                None
            }
        }
    }

    fn on_fragment(&mut self, at: i64, from: SocketAddrV4, buffer: &mut Buffer, len: usize) -> Option<Place> {
        let mut too_large = false;
        let wants = |channel: &str, size: usize| {
            let takes = self.subscriptions.takes(channel, size);
            too_large = !takes && self.subscriptions.wants(channel);
            takes
        };
        let outcome = self.reassembly.insert(at, from, buffer, len, wants);
        self.stats.incomplete = self.reassembly.given_up();
        match outcome {
            Outcome::Complete => {
                self.stats.received += 1;
                Some(Place::Assembled)
            }
            Outcome::Unwanted => {
                self.stats.too_large += u64::from(too_large);
                self.stats.unwanted += u64::from(!too_large);
                None
            }
            Outcome::Incomplete | Outcome::Needless => None,
        }
    }

    /// The message that [`Receiver::handle_rx`] found last is no longer needed, and `buffer` is: gives memory back.
    pub fn reclaim(&mut self, buffer: &mut Buffer) {
        self.reassembly.reclaim(buffer);
    }

    /// Channel and payload of a message that [`Receiver::handle_rx`] found in `buffer`.
    #[must_use]
    pub fn message<'a>(&'a self, place: Place, buffer: &'a Buffer) -> (&'a str, &'a [u8]) {
        message(&self.reassembly, place, buffer)
    }

    /// Puts such a message in line, as far as its subscriptions have room.
    pub fn put_in_line(&mut self, place: Place, buffer: &Buffer, from: Provenance, line: &mut Line) {
        let (channel, payload) = message(&self.reassembly, place, buffer);
        line.push(&mut self.subscriptions, channel, payload, from);
        self.stats.queue_dropped = line.dropped();
    }

    /// Bytes that messages hold of which fragments are missing.
    #[must_use]
    pub fn incomplete_bytes(&self) -> usize {
        self.reassembly.bytes()
    }

    /// Sender of LCM's self test since the last call: a process that has just subscribed.
    pub fn take_announced(&mut self) -> Option<SocketAddrV4> {
        self.announced.take()
    }

    fn reject(&mut self, rejected: Rejected) {
        self.stats.last_rejected = Some(rejected);
        let kind = rejected.why.kind();
        match self.rejections.iter_mut().find(|known| known.last.why.kind() == kind) {
            Some(known) => *known = Rejections { last: rejected, count: known.count + 1 },
            None => self.rejections.push(Rejections { last: rejected, count: 1 }),
        }
    }

    /// Rejected datagrams so far, by kind.
    #[must_use]
    pub fn rejections(&self) -> &[Rejections] {
        &self.rejections
    }
}

fn message<'a>(reassembly: &'a Reassembly, place: Place, buffer: &'a Buffer) -> (&'a str, &'a [u8]) {
    match place {
        Place::Datagram { start, end } => {
            // handle_rx has seen that it is UTF-8.
            let channel = core::str::from_utf8(buffer.bytes(udpm::CHANNEL_AT..start - 1)).unwrap_or_default();
            (channel, buffer.bytes(start..end))
        }
        Place::Assembled => match reassembly.complete() {
            Some(Complete { channel, payload }) => (channel, payload),
            None => ("", &[]),
        },
    }
}

#[cfg(test)]
mod tests;
