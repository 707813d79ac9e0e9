//! LCM on this machine: one context per process, no threads; receiving happens in the caller's.
//!
//! The context is a descriptor for an event loop ([`AsFd`]): when it is readable, call [`Lcm::recv`] until `None`.
//! Simple clients use [`Lcm::wait`]. A file per provider of [`Url`](crate::Url); sockets and interfaces of UDP
//! multicast: `live/socket.rs`.

mod socket;
mod udpm;

use crate::receiver::{Rejections, Stats};
use crate::subscription::{PatternError, Queue, SubscriptionId};
use crate::udpm::EncodeError;
use crate::url::Url;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;
use std::{fmt, io};
pub use udpm::Udpm;

/// A moment on the wall clock: nanoseconds since 1970-01-01 00:00 UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RealtimeNanos(pub i64);

/// A message, valid until the next call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received<'a> {
    /// Its channel, at most 63 bytes.
    pub channel: &'a str,
    /// Its payload.
    pub payload: &'a [u8],
    /// When the kernel received it.
    pub at: RealtimeNanos,
}

/// Why a message was not published.
#[derive(Debug)]
pub enum PublishError {
    /// It cannot be sent: a wrong name, or too long.
    Encode(EncodeError),
    /// The kernel has no room for it now; counted in [`Stats::send_refused`].
    Busy,
    /// The network does not take it.
    Io(io::Error),
}

impl fmt::Display for PublishError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Encode(error) => write!(f, "LCM publish: {error}"),
            Self::Busy => write!(f, "LCM publish: the kernel's send buffer is full"),
            Self::Io(error) => write!(f, "LCM publish: {error}"),
        }
    }
}

impl std::error::Error for PublishError {}

/// Why a subscription was not made.
#[derive(Debug)]
pub enum SubscribeError {
    /// The pattern is not one.
    Pattern(PatternError),
    /// The bus could not be joined.
    Io(io::Error),
}

impl fmt::Display for SubscribeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pattern(error) => write!(f, "LCM subscribe: {error}"),
            Self::Io(error) => write!(f, "LCM subscribe: {error}"),
        }
    }
}

impl std::error::Error for SubscribeError {}

/// A process's place on the bus: publishes, subscribes, receives. Hears its own messages where it subscribes to them.
#[derive(Debug)]
pub struct Lcm(Provider);

/// Each has the methods of [`Lcm`].
#[derive(Debug)]
enum Provider {
    Udpm(Udpm),
}

/// Hands a call to the provider.
macro_rules! provider {
    ($lcm:expr, $it:ident => $call:expr) => {
        match $lcm {
            Provider::Udpm($it) => $call,
        }
    };
}

impl Lcm {
    /// Opens what the URL names. A UDP multicast group is joined at the first subscription; until then nothing is
    /// received.
    ///
    /// # Errors
    /// The machine refuses a socket or a file, or has not even a loopback interface; the text says what was tried.
    pub fn new(url: &Url) -> io::Result<Self> {
        let provider = match url {
            Url::Udpm(url) => Provider::Udpm(Udpm::new(url)?),
            _ => return Err(io::Error::new(io::ErrorKind::Unsupported, format!("{url}: not supported yet"))),
        };
        Ok(Self(provider))
    }

    /// Sends a message of at most [`crate::udpm::MESSAGE_MAX`] bytes. Never blocks.
    ///
    /// # Errors
    /// A wrong name or size: nothing was sent. Otherwise the message is lost.
    pub fn publish(&mut self, channel: &str, payload: &[u8]) -> Result<(), PublishError> {
        provider!(&mut self.0, it => it.publish(channel, payload))
    }

    /// Receives the channels that `pattern` matches as a whole; see [`crate::subscription::Pattern`]. A message that
    /// several subscriptions match is received once. What waits to be received is limited by the receive buffer.
    ///
    /// # Errors
    /// A wrong pattern; at the first subscription also a bus that cannot be joined. Nothing is subscribed then.
    pub fn subscribe(&mut self, pattern: &str) -> Result<SubscriptionId, SubscribeError> {
        self.subscribe_with(pattern, Queue::default())
    }

    /// Like [`Lcm::subscribe`], with a limit on the messages that wait to be received.
    ///
    /// # Errors
    /// As [`Lcm::subscribe`].
    pub fn subscribe_with(&mut self, pattern: &str, queue: Queue) -> Result<SubscriptionId, SubscribeError> {
        provider!(&mut self.0, it => it.subscribe(pattern, queue))
    }

    /// Ends a subscription; false when there is none such.
    pub fn unsubscribe(&mut self, id: SubscriptionId) -> bool {
        provider!(&mut self.0, it => it.unsubscribe(id))
    }

    /// The next message of a subscribed channel; never blocks. `None`: nothing more now, or a good many unwanted
    /// datagrams were dropped and more may wait; then the descriptor is still readable, so poll it level-triggered.
    ///
    /// # Errors
    /// The socket failed. What is wrong with a datagram is no error; see [`Lcm::stats`].
    pub fn recv(&mut self) -> io::Result<Option<Received<'_>>> {
        provider!(&mut self.0, it => it.recv())
    }

    /// Waits until something can be received, at most `timeout`; false when nothing came, or a signal did.
    ///
    /// # Errors
    /// The system call failed.
    pub fn wait(&self, timeout: Duration) -> io::Result<bool> {
        // Rounded up: a wait of half a millisecond is not a busy loop.
        let millis = timeout.as_nanos().div_ceil(1_000_000).min(i32::MAX as u128) as i32;
        let timeout = PollTimeout::try_from(millis).map_err(io::Error::other)?;
        match poll(&mut [PollFd::new(self.as_fd(), PollFlags::POLLIN)], timeout) {
            Ok(ready) => Ok(ready > 0),
            Err(Errno::EINTR) => Ok(false),
            Err(errno) => Err(context("cannot wait for messages")(errno)),
        }
    }

    /// What became of all messages so far.
    #[must_use]
    pub fn stats(&self) -> &Stats {
        provider!(&self.0, it => it.stats())
    }

    /// What was rejected so far, by kind: at most one of each.
    #[must_use]
    pub fn rejections(&self) -> &[Rejections] {
        match &self.0 {
            Provider::Udpm(udpm) => udpm.rejections(),
        }
    }

    /// The UDP multicast behind it, if it is that.
    #[must_use]
    pub fn udpm(&self) -> Option<&Udpm> {
        match &self.0 {
            Provider::Udpm(udpm) => Some(udpm),
        }
    }
}

impl AsFd for Lcm {
    /// Readable when [`Lcm::recv`] has something to do. It is the same descriptor before and after the first
    /// subscription.
    fn as_fd(&self) -> BorrowedFd<'_> {
        provider!(&self.0, it => it.as_fd())
    }
}

/// Says what was tried when a system call failed.
fn context(what: impl fmt::Display) -> impl FnOnce(Errno) -> io::Error {
    move |errno| {
        let error = io::Error::from(errno);
        io::Error::new(error.kind(), format!("{what}: {error}"))
    }
}
