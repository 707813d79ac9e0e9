//! LCM on this machine: one context per process, no threads; receiving happens in the caller's.
//!
//! The context is a descriptor for an event loop ([`AsFd`]): when it is readable, call [`Lcm::recv`] until `None`.
//! Simple clients use [`Lcm::wait`]. A file per provider of [`Url`]; sockets and interfaces of UDP
//! multicast: `live/socket.rs`.
//!
//! ```
//! use lcm::{Url, live::Lcm};
//!
//! let (url, _) = Url::parse("memq://")?; // or udpm://239.255.76.67:7667
//! let mut lcm = Lcm::new(&url)?;
//! lcm.subscribe("POSE_.*")?;
//! lcm.publish("POSE_A", b"payload")?;
//! let message = lcm.recv()?.ok_or("nothing came")?;
//! assert_eq!((message.channel, message.payload), ("POSE_A", &b"payload"[..]));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod clock;
mod file;
mod hub;
#[cfg_attr(not(feature = "shm"), path = "live/no_local.rs")]
mod local;
mod memq;
mod socket;
pub(crate) mod sys;
mod tcpq;
mod udpm;

use crate::origin::{Origin, Provenance};
use crate::queue::Waiting;
use crate::receiver::{Rejections, Stats};
use crate::subscription::{PatternError, Queue, SubscriptionId};
use crate::udpm::EncodeError;
use crate::url::Url;
pub use hub::{Event, Hub, What};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
pub use socket::{Fullness, keep_local};
use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;
use std::{fmt, io};
pub use tcpq::Tcpq;
pub use udpm::{SelfTest, Udpm};

/// A moment on the wall clock: nanoseconds since 1970-01-01 00:00 UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RealtimeNanos(pub i64);

/// A message, valid until the next call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received<'a> {
    /// Channel, at most 63 bytes.
    pub channel: &'a str,
    /// Payload.
    pub payload: &'a [u8],
    /// Time when the kernel received it; of one in shared memory, when it was published.
    pub at: RealtimeNanos,
    /// Time of publication, ns of this machine's monotonic clock, which steps of the wall clock do not touch; of a
    /// message in shared memory. As stated by the publisher: it may be wrong, even in the future.
    pub published: Option<i64>,
    /// Where it came from.
    pub origin: Origin,
}

impl<'a> Received<'a> {
    fn new(channel: &'a str, payload: &'a [u8], from: Provenance) -> Self {
        let Provenance { at, published, origin } = from;
        Self { channel, payload, at: RealtimeNanos(at), published, origin }
    }

    fn waiting(waiting: &'a Waiting) -> Self {
        Self::new(&waiting.channel, &waiting.payload, waiting.provenance)
    }
}

/// Why a message was not published.
#[derive(Debug)]
pub enum PublishError {
    /// Cannot be sent: invalid channel name, or too long.
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

/// A process's place on the bus: publishes, subscribes, receives. It receives its own messages where it subscribes to
/// them.
#[derive(Debug)]
pub struct Lcm(Provider);

/// Providers; each has the methods of [`Lcm`].
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "a process has one or two, nobody keeps a list of them")]
enum Provider {
    Udpm(Udpm),
    Tcpq(Tcpq),
    Memq(memq::Memq),
    File(file::File),
}

/// Hands a call to the provider.
macro_rules! provider {
    ($lcm:expr, $it:ident => $call:expr) => {
        match $lcm {
            Provider::Udpm($it) => $call,
            Provider::Tcpq($it) => $call,
            Provider::Memq($it) => $call,
            Provider::File($it) => $call,
        }
    };
}

impl Lcm {
    /// Opens what the URL names. A UDP multicast group is joined at the first subscription; until then nothing is
    /// received.
    ///
    /// # Errors
    /// The system refuses a socket or a file, or has no loopback interface; the text names the failed call.
    pub fn new(url: &Url) -> io::Result<Self> {
        let provider = match url {
            Url::Udpm(url) => Provider::Udpm(Udpm::new(url)?),
            Url::Tcpq(hub) => Provider::Tcpq(Tcpq::new(*hub)?),
            Url::Memq => Provider::Memq(memq::Memq::new()?),
            Url::File(url) => Provider::File(file::File::new(url)?),
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

    /// True if the system has taken all that was published. Over TCPQ it is false while messages wait for room in the
    /// connection, and without a connection: a program that ends then loses them. Never blocks.
    ///
    /// # Errors
    /// As [`Lcm::recv`].
    pub fn is_sent(&mut self) -> io::Result<bool> {
        match &mut self.0 {
            Provider::Tcpq(tcpq) => tcpq.is_sent(),
            Provider::Udpm(_) | Provider::Memq(_) | Provider::File(_) => Ok(true),
        }
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

    /// Limits the payloads of a subscription to `bytes` from now on: larger ones, fragments of them too, are dropped
    /// and counted in [`Stats::too_large`]. False if it does not exist. Payloads in shared memory files of their own
    /// count; those in a ring have a limit of their own.
    pub fn set_size_max(&mut self, id: SubscriptionId, bytes: usize) -> bool {
        provider!(&mut self.0, it => it.set_size_max(id, bytes))
    }

    /// Limits the memory of incomplete messages to `bytes` from now on; the oldest are given up, and counted in
    /// [`Stats::incomplete`]. Larger messages cannot be received, except through shared memory. Unless it is set, the
    /// limit is a little more than one message of [`crate::udpm::MESSAGE_MAX`].
    pub fn set_memory_max(&mut self, bytes: usize) {
        provider!(&mut self.0, it => it.set_memory_max(bytes));
    }

    /// Ends a subscription; false if it does not exist.
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

    /// Like [`Lcm::recv`], and waits at most `timeout` where there is nothing. `None` may come early: after a signal,
    /// or when what came was not a whole message. The fastest way for a process that waits for nothing else;
    /// [`Duration::MAX`] waits without a limit, which saves the kernel a timer.
    ///
    /// # Errors
    /// As [`Lcm::recv`].
    pub fn recv_timeout(&mut self, timeout: Duration) -> io::Result<Option<Received<'_>>> {
        match self.0 {
            Provider::Udpm(ref mut udpm) => udpm.recv_timeout(timeout),
            Provider::Tcpq(_) | Provider::Memq(_) | Provider::File(_) => {
                self.wait(timeout)?;
                self.recv()
            }
        }
    }

    /// Waits until something can be received, at most `timeout`; false when nothing came, or a signal did.
    ///
    /// # Errors
    /// The system call failed.
    pub fn wait(&self, timeout: Duration) -> io::Result<bool> {
        let ready = match &self.0 {
            Provider::Udpm(udpm) => udpm.ready(),
            Provider::Tcpq(tcpq) => tcpq.ready(),
            Provider::Memq(_) | Provider::File(_) => false,
        };
        if ready { Ok(true) } else { wait(self.as_fd(), timeout) }
    }

    /// Number of messages lost to the limit of a subscription; `None` if it does not exist.
    #[must_use]
    pub fn dropped(&self, id: SubscriptionId) -> Option<u64> {
        provider!(&self.0, it => it.dropped(id))
    }

    /// Counters of all messages.
    #[must_use]
    pub fn stats(&self) -> &Stats {
        provider!(&self.0, it => it.stats())
    }

    /// Rejected datagrams by kind, at most one entry of each.
    #[must_use]
    pub fn rejections(&self) -> &[Rejections] {
        match &self.0 {
            Provider::Udpm(udpm) => udpm.rejections(),
            Provider::Tcpq(_) | Provider::Memq(_) | Provider::File(_) => &[],
        }
    }

    /// The UDP multicast behind it, if it is that.
    #[must_use]
    pub fn udpm(&self) -> Option<&Udpm> {
        match &self.0 {
            Provider::Udpm(udpm) => Some(udpm),
            Provider::Tcpq(_) | Provider::Memq(_) | Provider::File(_) => None,
        }
    }

    /// The connection to a hub behind it, if it is that.
    #[must_use]
    pub fn tcpq(&self) -> Option<&Tcpq> {
        match &self.0 {
            Provider::Tcpq(tcpq) => Some(tcpq),
            Provider::Udpm(_) | Provider::Memq(_) | Provider::File(_) => None,
        }
    }
}

impl AsFd for Lcm {
    /// Readable if [`Lcm::recv`] has work to do; call that until `None`, since messages may wait that the descriptor
    /// does not signal again. The descriptor is the same before and after the first subscription.
    fn as_fd(&self) -> BorrowedFd<'_> {
        provider!(&self.0, it => it.as_fd())
    }
}

/// True if a message can be sent at all.
fn check(channel: &str, payload: &[u8]) -> Result<(), PublishError> {
    let message = crate::udpm::Message::new(0, channel, payload, crate::udpm::DATAGRAM_MAX);
    message.map(drop).map_err(PublishError::Encode)
}

/// Waits until a descriptor is readable, at most `timeout`; false when it is not, or a signal came.
fn wait(fd: BorrowedFd<'_>, timeout: Duration) -> io::Result<bool> {
    // Rounded up: a wait of half a millisecond is not a busy loop.
    let millis = timeout.as_nanos().div_ceil(1_000_000).min(i32::MAX as u128) as i32;
    let timeout = PollTimeout::try_from(millis).map_err(io::Error::other)?;
    match poll(&mut [PollFd::new(fd, PollFlags::POLLIN)], timeout) {
        Ok(ready) => Ok(ready > 0),
        Err(Errno::EINTR) => Ok(false),
        Err(errno) => Err(context("cannot wait")(errno)),
    }
}

/// Names the failed system call in its error.
fn context(what: impl fmt::Display) -> impl FnOnce(Errno) -> io::Error {
    move |errno| {
        let error = io::Error::from(errno);
        io::Error::new(error.kind(), format!("{what}: {error}"))
    }
}
