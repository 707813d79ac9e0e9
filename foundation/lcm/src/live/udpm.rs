//! The UDP multicast provider: the two sockets and the receiver between them.

use super::local::Local;
use super::socket::{Arrival, Neighbours, ReceiveSocket, SendSocket};
use super::{PublishError, Received, SubscribeError, clock};
use crate::filter;
use crate::origin::{Origin, Provenance};
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

/// Maximum number of unwanted datagrams that one [`Udpm::recv`] drops before it returns, so that a flood cannot keep a
/// process from its other work.
const UNWANTED_MAX: usize = 64;
/// Maximum number of datagrams one [`Udpm::recv`] puts in line.
const DRAIN_MAX: usize = 256;
/// Total time that a large message waits for room in the kernel's send buffer.
const SEND_PATIENCE: Duration = Duration::from_millis(10);
/// Payload of the self test.
const SELF_TEST_PAYLOAD: &[u8] = b"lcm self test";

/// State of the self test: is a datagram sent here also received here?
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SelfTest {
    /// No subscription yet.
    #[default]
    NotStarted,
    /// A message was sent at the first subscription and has not come back yet. After a second: routing or a firewall
    /// keeps the bus apart.
    Waiting,
    /// Received.
    Passed,
}

/// Kind of a received datagram.
enum Taken {
    Nothing,
    Unwanted,
    /// `None`: in shared memory.
    Message(Option<Place>, Provenance),
}

/// A place on a UDP multicast bus.
#[derive(Debug)]
pub struct Udpm {
    receiver: Receiver,
    line: Line,
    receive: ReceiveSocket,
    send: SendSocket,
    neighbours: Neighbours,
    sequence: u32,
    buffer: Buffer,
    self_test: SelfTest,
    /// Large messages of our own are wanted here, too.
    own_fragments: bool,
    /// The shared-memory bus beside it, if the URL wants it and it can be had.
    local: Option<Local>,
}

impl Udpm {
    pub(super) fn new(url: &url::Udpm) -> io::Result<Self> {
        let receive = ReceiveSocket::open(url)?;
        let send = SendSocket::open(url)?;
        let local = Local::join(url, send.source(), receive.as_fd());
        Ok(Self {
            receiver: Receiver::default(),
            line: Line::new(receive.granted_size()?),
            receive,
            send,
            neighbours: Neighbours::default(),
            sequence: 0,
            buffer: Buffer::default(),
            self_test: SelfTest::NotStarted,
            own_fragments: false,
            local,
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
        let sequence = self.sequence;
        let message = self.number(channel, payload)?;
        if let Some(local) = &mut self.local
            && !local.publish(sequence, channel, payload, clock::monotonic())
        {
            return Ok(());
        }
        self.transmit(channel, message)
    }

    /// The next message.
    fn number<'a>(&mut self, channel: &'a str, payload: &'a [u8]) -> Result<Message<'a>, PublishError> {
        let message = Message::new(self.sequence, channel, payload, self.send.datagram_max());
        self.sequence = self.sequence.wrapping_add(u32::from(message.is_ok()));
        message.map_err(PublishError::Encode)
    }

    fn transmit(&mut self, channel: &str, message: Message<'_>) -> Result<(), PublishError> {
        let source = self.send.source();
        let result = self.transmit_datagrams(channel, message);
        // The filter recognizes our own datagrams by their source. If a new filter is refused the old one stays, which
        // lets fragments of our own through.
        if self.send.source() != source && self.receive.filtered() {
            let _ = self.set_filter();
        }
        result
    }

    fn transmit_datagrams(&mut self, channel: &str, message: Message<'_>) -> Result<(), PublishError> {
        let count = message.count();
        // In shared memory they are our own, too.
        if count > 1 && self.local.is_none() && !self.own_fragments && self.receiver.subscriptions().wants(channel) {
            self.own_fragments = true;
            let _ = self.set_filter();
        }
        let mut patience = SEND_PATIENCE;
        for number in 0..count {
            let (header, rest) = message.datagram(number);
            let sent = loop {
                let moved = |source| self.local.as_mut().into_iter().for_each(|local| local.moved(source));
                match self.send.send(&header, rest, moved) {
                    // A message of several datagrams may fill the buffer by itself.
                    Err(Errno::EAGAIN | Errno::ENOBUFS) if count > 1 && !patience.is_zero() => {
                        patience = self.send.wait(patience);
                    }
                    result => break result,
                }
            };
            match sent {
                // A receiver with a small buffer, on this processor perhaps, gets its turn before the next one.
                Ok(()) if (2..count - 1).contains(&number) => std::thread::yield_now(),
                Ok(()) => {}
                Err(Errno::EAGAIN | Errno::ENOBUFS) => return Err(PublishError::Busy),
                Err(error) => return Err(PublishError::Io(error.into())),
            }
        }
        Ok(())
    }

    pub(super) fn subscribe(&mut self, pattern: &str, queue: Queue) -> Result<SubscriptionId, SubscribeError> {
        let id = self.receiver.subscribe(pattern, queue).map_err(SubscribeError::Pattern)?;
        let first = self.self_test == SelfTest::NotStarted;
        // The filter first: from the moment of joining datagrams are kept.
        if let Err(error) = self.set_filter().and_then(|()| self.receive.join()) {
            self.receiver.unsubscribe(id);
            return Err(SubscribeError::Io(error));
        }
        if first {
            self.self_test = SelfTest::Waiting;
            // A failure to send shows in the result of the test.
            let _ = self
                .number(filter::SELF_TEST, SELF_TEST_PAYLOAD)
                .and_then(|test| self.transmit(filter::SELF_TEST, test));
        }
        self.set_interest();
        Ok(id)
    }

    pub(super) fn unsubscribe(&mut self, id: SubscriptionId) -> bool {
        let was = self.receiver.unsubscribe(id);
        if was {
            self.line.forget(id);
            // If it is refused the old one stays, and what that lets through is dropped here.
            let _ = self.set_filter();
            self.set_interest();
        }
        was
    }

    /// Publishes the set of subscriptions to the writers of shared memory.
    fn set_interest(&mut self) {
        if let Some(local) = &mut self.local {
            local.set_interest(self.receiver.subscriptions().names().as_deref());
        }
    }

    /// Attaches a socket filter for the subscriptions, as far as they are plain names, and against other hosts.
    fn set_filter(&mut self) -> io::Result<()> {
        let (own, local) = (self.send.source(), self.receive.is_local());
        let names = self.receiver.subscriptions().names();
        let program = names.and_then(|names| filter::program(&names, own, self.own_fragments, local));
        let was = self.receive.filtered();
        match (was, self.receive.filter(program.as_deref())?) {
            (_, true) => self.receiver.hears_some(),
            (false, false) if self.self_test != SelfTest::NotStarted => {}
            (_, false) => self.receiver.hears_all(now()),
        }
        Ok(())
    }

    pub(super) fn set_size_max(&mut self, id: SubscriptionId, bytes: usize) -> bool {
        self.receiver.set_size_max(id, bytes)
    }

    pub(super) fn set_memory_max(&mut self, bytes: usize) {
        self.receiver.set_memory_max(bytes);
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
        let begin = (timeout != Duration::MAX).then(Instant::now);
        let left = || begin.map_or(Duration::MAX, |begin| timeout.saturating_sub(begin.elapsed()));
        let mut wait = Some(timeout);
        loop {
            match self.take(wait)? {
                Taken::Message(place, at) => return Ok(Some(self.received(place, at))),
                Taken::Nothing if wait.is_some() => return Ok(None),
                // What had come with it, the other fragments perhaps, is taken before there is a wait again.
                Taken::Unwanted => wait = None,
                Taken::Nothing => wait = Some(left()),
            }
            if left().is_zero() {
                return Ok(None);
            }
        }
    }

    /// Takes one message or datagram; waits for it if there is a time to.
    fn take(&mut self, mut wait: Option<Duration>) -> io::Result<Taken> {
        let waits = wait.is_some_and(|patience| !patience.is_zero());
        if self.local.is_none() {
            return self.take_datagram(wait);
        }
        loop {
            let Some(local) = &mut self.local else { return Ok(Taken::Nothing) };
            let subscriptions = self.receiver.subscriptions();
            if local.recv(|channel| subscriptions.wants(channel), |channel, len| subscriptions.takes(channel, len)) {
                self.receiver.stats.received += 1;
                self.receiver.stats.lost += local.take_lost();
                return Ok(Taken::Message(None, local.provenance()));
            }
            if !local.passes_socket() {
                match self.take_datagram(None)? {
                    Taken::Nothing => {}
                    taken => return Ok(taken),
                }
            }
            let Some(local) = &mut self.local else { return Ok(Taken::Nothing) };
            if !local.sleep(waits) {
                continue;
            }
            match wait.take() {
                Some(patience) if waits => local.wait(patience)?,
                _ => return Ok(Taken::Nothing),
            }
        }
    }

    fn take_datagram(&mut self, wait: Option<Duration>) -> io::Result<Taken> {
        self.receiver.reclaim(&mut self.buffer);
        let arrival = self.receive.receive(self.buffer.room(), wait)?;
        let Some(Arrival { from, len, at }) = arrival else { return Ok(Taken::Nothing) };
        self.receiver.stats.kernel_dropped = self.receive.dropped();
        if self.self_test == SelfTest::Waiting && from == self.send.source() {
            self.self_test = SelfTest::Passed;
        }
        if let Some(local) = &mut self.local
            && local.takes(from, &self.buffer.room()[..len], at.0)
        {
            return Ok(Taken::Unwanted);
        }
        let place = self.receiver.handle_rx(at.0, from, &mut self.buffer, len);
        let Some(place) = place else { return Ok(Taken::Unwanted) };
        let origin = match self.receive.is_local() || self.neighbours.has(*from.ip()) {
            true => Origin::Host(self.local.as_ref().and_then(|local| local.process_at(from))),
            false => Origin::Network,
        };
        Ok(Taken::Message(Some(place), Provenance { at: at.0, published: None, origin }))
    }

    fn received(&self, place: Option<Place>, from: Provenance) -> Received<'_> {
        let (channel, payload) = match (place, &self.local) {
            (Some(place), _) => self.receiver.message(place, &self.buffer),
            (None, Some(local)) => local.message(),
            (None, None) => ("", &[][..]),
        };
        Received::new(channel, payload, from)
    }

    fn put_in_line(&mut self, place: Option<Place>, from: Provenance) {
        match (place, &self.local) {
            (Some(place), _) => self.receiver.put_in_line(place, &self.buffer, from, &mut self.line),
            (None, Some(local)) => {
                let (channel, payload) = local.message();
                self.line.push(self.receiver.subscriptions_mut(), channel, payload, from);
                self.receiver.stats.queue_dropped = self.line.dropped();
            }
            (None, None) => {}
        }
    }

    fn pop(&mut self) -> Option<Received<'_>> {
        self.line.pop(self.receiver.subscriptions_mut()).map(Received::waiting)
    }

    /// True if a message waits that the descriptor does not signal.
    pub(super) fn ready(&self) -> bool {
        !self.line.is_empty() || self.local.as_ref().is_some_and(Local::ready)
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

    /// True if messages are sent on the loopback interface: there was no route to the group at the start, or there is
    /// none any more.
    #[must_use]
    pub fn on_loopback(&self) -> bool {
        self.send.on_loopback()
    }

    /// True if what was sent at the first subscription came back.
    #[must_use]
    pub fn self_test(&self) -> SelfTest {
        self.self_test
    }

    /// True if the kernel keeps datagrams of other hosts away: the bus has a TTL of 0.
    #[must_use]
    pub fn is_local(&self) -> bool {
        self.receive.is_local()
    }

    /// True if the kernel keeps unwanted channels away: all subscriptions are plain names.
    #[must_use]
    pub fn filtered(&self) -> bool {
        self.receive.filtered()
    }

    /// True if messages go through shared memory where both ends can: the URL has `shm=auto` and this machine supports
    /// it.
    #[must_use]
    pub fn shares_memory(&self) -> bool {
        self.local.is_some()
    }

    /// True if somebody truncated the file through which this context publishes in shared memory. It publishes
    /// datagrams from then on, so receivers know neither its process nor its user; a new context is in shared memory
    /// again.
    #[must_use]
    pub fn is_cut_off(&self) -> bool {
        self.local.as_ref().is_some_and(Local::is_cut)
    }

    /// Publishers on this bus, with their losses; empty while the kernel filters channels.
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
        self.local.as_ref().map_or_else(|| self.receive.as_fd(), AsFd::as_fd)
    }
}
