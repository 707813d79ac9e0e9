//! The UDP multicast provider: the two sockets and the receiver between them.

use super::socket::{Arrival, ReceiveSocket, SendSocket};
use super::{PublishError, RealtimeNanos, Received, SubscribeError};
use crate::filter;
use crate::queue::Line;
use crate::reassembly::Buffer;
use crate::receiver::{Place, Receiver, Rejections, Stats};
use crate::sources::Source;
use crate::subscription::{Queue, SubscriptionId};
use crate::udpm::Message;
use crate::url;
use nix::errno::Errno;
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// How many datagrams in a row one [`Udpm::recv`] drops before it returns to its caller, so that a flood of messages
/// that nobody wants cannot hold a process that has other work to do.
const UNWANTED_MAX: usize = 64;
/// How many datagrams one [`Udpm::recv`] puts in line.
const DRAIN_MAX: usize = 256;
/// How long a large message waits for room in the kernel's send buffer, all in all.
const SEND_PATIENCE: Duration = Duration::from_millis(10);
/// What the self test says.
const SELF_TEST_PAYLOAD: &[u8] = b"lcm self test";

/// What has become of the self test: of what is sent here, does anything come back?
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SelfTest {
    /// Nothing is subscribed yet.
    #[default]
    NotStarted,
    /// A message was sent at the first subscription and has not come back yet. After a second: routing or a firewall
    /// keeps the bus apart.
    Waiting,
    /// It came back.
    Passed,
}

/// What one datagram was.
enum Taken {
    Nothing,
    Unwanted,
    Message(Place, RealtimeNanos),
}

/// A place on a UDP multicast bus.
#[derive(Debug)]
pub struct Udpm {
    receiver: Receiver,
    line: Line,
    receive: ReceiveSocket,
    send: SendSocket,
    sequence: u32,
    buffer: Buffer,
    self_test: SelfTest,
    /// Large messages of our own are wanted here, too.
    own_fragments: bool,
}

impl Udpm {
    pub(super) fn new(url: &url::Udpm) -> io::Result<Self> {
        let receive = ReceiveSocket::open(url)?;
        Ok(Self {
            receiver: Receiver::default(),
            line: Line::new(receive.granted_size()?),
            receive,
            send: SendSocket::open(url)?,
            sequence: 0,
            buffer: Buffer::default(),
            self_test: SelfTest::NotStarted,
            own_fragments: false,
        })
    }

    pub(super) fn publish(&mut self, channel: &str, payload: &[u8]) -> Result<(), PublishError> {
        let result = self.send(channel, payload);
        match result {
            Ok(()) => self.receiver.stats.sent += 1,
            Err(PublishError::Busy) => self.receiver.stats.send_refused += 1,
            Err(_) => {}
        }
        result
    }

    fn send(&mut self, channel: &str, payload: &[u8]) -> Result<(), PublishError> {
        let message = Message::new(self.sequence, channel, payload, self.send.datagram_max());
        let message = message.map_err(PublishError::Encode)?;
        self.sequence = self.sequence.wrapping_add(1);
        let count = message.count();
        if count > 1 && !self.own_fragments && self.receiver.subscriptions().wants(channel) {
            self.own_fragments = true;
            self.set_filter();
        }
        let mut patience = SEND_PATIENCE;
        for number in 0..count {
            let (header, rest) = message.datagram(number);
            let sent = loop {
                match self.send.send(&header, rest) {
                    // A message of several datagrams may fill the buffer by itself.
                    Err(Errno::EAGAIN | Errno::ENOBUFS) if count > 1 && !patience.is_zero() => {
                        patience = self.send.wait(patience);
                    }
                    result => break result,
                }
            };
            match sent {
                Ok(()) => {}
                Err(Errno::EAGAIN | Errno::ENOBUFS) => return Err(PublishError::Busy),
                Err(error) => return Err(PublishError::Io(error.into())),
            }
        }
        Ok(())
    }

    pub(super) fn subscribe(&mut self, pattern: &str, queue: Queue) -> Result<SubscriptionId, SubscribeError> {
        let id = self.receiver.subscribe(pattern, queue).map_err(SubscribeError::Pattern)?;
        self.set_filter();
        let first = self.self_test == SelfTest::NotStarted;
        if let Err(error) = self.receive.join() {
            self.receiver.unsubscribe(id);
            return Err(SubscribeError::Io(error));
        }
        if first {
            self.self_test = SelfTest::Waiting;
            // That it cannot be sent is what the test is there to tell.
            let _ = self.send(filter::SELF_TEST, SELF_TEST_PAYLOAD);
        }
        Ok(id)
    }

    pub(super) fn unsubscribe(&mut self, id: SubscriptionId) -> bool {
        let was = self.receiver.unsubscribe(id);
        if was {
            self.line.forget(id);
            self.set_filter();
        }
        was
    }

    /// Lets the kernel pass what is subscribed, as far as that can be said in names.
    fn set_filter(&mut self) {
        let program = self.receiver.subscriptions().names().and_then(|names| {
            let own = self.send.source();
            filter::program(&names, own, self.own_fragments)
        });
        let was = self.receive.filtered();
        match (was, self.receive.filter(program.as_deref())) {
            (_, true) => self.receiver.hears_some(),
            (false, false) if self.self_test != SelfTest::NotStarted => {}
            (_, false) => self.receiver.hears_all(now()),
        }
    }

    pub(super) fn recv(&mut self) -> io::Result<Option<Received<'_>>> {
        if self.line.is_empty() && self.receiver.subscriptions().unlimited() {
            for _ in 0..UNWANTED_MAX {
                match self.take(None)? {
                    Taken::Nothing => return Ok(None),
                    Taken::Unwanted => {}
                    Taken::Message(place, at) => return Ok(Some(self.received(place, at))),
                }
            }
            return Ok(None);
        }
        for _ in 0..DRAIN_MAX {
            match self.take(None)? {
                Taken::Nothing => break,
                Taken::Unwanted => {}
                Taken::Message(place, at) => self.put_in_line(place, at),
            }
        }
        Ok(self.pop())
    }

    /// Like [`Udpm::recv`]; waits for a message.
    #[allow(clippy::disallowed_methods, reason = "how long is left to wait")]
    pub(super) fn recv_timeout(&mut self, timeout: Duration) -> io::Result<Option<Received<'_>>> {
        if !self.line.is_empty() || !self.receiver.subscriptions().unlimited() {
            if self.line.is_empty()
                && let Taken::Message(place, at) = self.take(Some(timeout))?
            {
                self.put_in_line(place, at);
            }
            return self.recv();
        }
        let mut left = timeout;
        let mut since = None;
        loop {
            match self.take(Some(left))? {
                Taken::Nothing => return Ok(None),
                Taken::Message(place, at) => return Ok(Some(self.received(place, at))),
                Taken::Unwanted => {
                    // The clock is asked only here: a wanted message takes one system call.
                    let since = *since.get_or_insert_with(Instant::now);
                    left = timeout.saturating_sub(since.elapsed());
                    if left.is_zero() {
                        return Ok(None);
                    }
                }
            }
        }
    }

    /// Takes one datagram; waits for it if there is a time to.
    fn take(&mut self, wait: Option<Duration>) -> io::Result<Taken> {
        let arrival = self.receive.receive(self.buffer.room(), wait)?;
        let Some(Arrival { from, len, at }) = arrival else { return Ok(Taken::Nothing) };
        self.receiver.stats.kernel_dropped = self.receive.dropped();
        let place = self.receiver.handle_rx(at.0, from, &mut self.buffer, len);
        if self.self_test == SelfTest::Waiting && from == self.send.source() {
            self.self_test = SelfTest::Passed;
        }
        Ok(place.map_or(Taken::Unwanted, |place| Taken::Message(place, at)))
    }

    fn received(&self, place: Place, at: RealtimeNanos) -> Received<'_> {
        let (channel, payload) = self.receiver.message(place, &self.buffer);
        Received { channel, payload, at }
    }

    fn put_in_line(&mut self, place: Place, at: RealtimeNanos) {
        self.receiver.put_in_line(place, &self.buffer, at.0, &mut self.line);
    }

    fn pop(&mut self) -> Option<Received<'_>> {
        let waiting = self.line.pop(self.receiver.subscriptions_mut())?;
        Some(Received { channel: &waiting.channel, payload: &waiting.payload, at: RealtimeNanos(waiting.at) })
    }

    /// Whether a message waits that the descriptor does not tell of.
    pub(super) fn ready(&self) -> bool {
        !self.line.is_empty()
    }

    pub(super) fn stats(&self) -> &Stats {
        &self.receiver.stats
    }

    pub(super) fn rejections(&self) -> &[Rejections] {
        self.receiver.rejections()
    }

    pub(super) fn dropped(&self, id: SubscriptionId) -> Option<u64> {
        self.receiver.subscriptions().dropped(id)
    }

    /// The size of the receive buffer in bytes that the kernel granted; less than the URL asks for where
    /// `net.core.rmem_max` is less and the process may not exceed it.
    ///
    /// # Errors
    /// The system call failed.
    pub fn granted_recv_buf_size(&self) -> io::Result<usize> {
        self.receive.granted_size()
    }

    /// Whether messages go out on the loopback interface: there was no route to the group at the start, or there is
    /// none any more.
    #[must_use]
    pub fn on_loopback(&self) -> bool {
        self.send.on_loopback()
    }

    /// Whether what was sent at the first subscription came back.
    #[must_use]
    pub fn self_test(&self) -> SelfTest {
        self.self_test
    }

    /// Whether the kernel keeps unwanted channels away: all subscriptions are plain names.
    #[must_use]
    pub fn filtered(&self) -> bool {
        self.receive.filtered()
    }

    /// Who publishes on this bus, with their losses; empty while the kernel keeps unwanted channels away.
    #[must_use]
    pub fn sources(&self) -> &[Source] {
        self.receiver.sources()
    }
}

/// The wall clock, ns since 1970: the scale of the kernel's receive times.
#[allow(clippy::disallowed_methods, reason = "a live transport")]
fn now() -> i64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(now.as_nanos()).unwrap_or(i64::MAX)
}

impl AsFd for Udpm {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.receive.as_fd()
    }
}
