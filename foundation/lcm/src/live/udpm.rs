//! The UDP multicast provider: the two sockets and the receiver between them.

use super::socket::{Arrival, ReceiveSocket, SendSocket};
use super::{PublishError, Received, SubscribeError};
use crate::receiver::{Receiver, Rejections, Stats};
use crate::subscription::{Queue, SubscriptionId};
use crate::udpm::{DATAGRAM_MAX, ShortHeader};
use crate::url;
use nix::errno::Errno;
use std::io;
use std::os::fd::{AsFd, BorrowedFd};

/// How many datagrams in a row one [`Udpm::recv`] drops before it returns to its caller, so that a flood of messages
/// that nobody wants cannot hold a process that has other work to do.
const UNWANTED_MAX: usize = 64;

/// A process's place on the bus: publishes, subscribes, receives. Hears its own messages where it subscribes to them.
#[derive(Debug)]
pub struct Udpm {
    receiver: Receiver,
    receive: ReceiveSocket,
    send: SendSocket,
    sequence: u32,
    datagram: Box<[u8]>,
    channel: String,
}

impl Udpm {
    /// Opens the sockets. The bus is joined at the first subscription; until then nothing is received.
    ///
    /// # Errors
    /// The machine refuses a socket, or has not even a loopback interface; the text says what was tried.
    pub fn new(url: &url::Udpm) -> io::Result<Self> {
        Ok(Self {
            receiver: Receiver::default(),
            receive: ReceiveSocket::open(url)?,
            send: SendSocket::open(url)?,
            sequence: 0,
            datagram: vec![0; DATAGRAM_MAX].into(),
            channel: String::new(),
        })
    }

    /// Sends a message of at most [`crate::udpm::SHORT_MAX`] bytes, the channel's name and a NUL included.
    /// Never blocks.
    ///
    /// # Errors
    /// A wrong name or size: nothing was sent. Otherwise the message is lost, and its sequence number shows that to
    /// receivers.
    pub fn publish(&mut self, channel: &str, payload: &[u8]) -> Result<(), PublishError> {
        let header = ShortHeader::new(self.sequence, channel, payload.len()).map_err(PublishError::Encode)?;
        self.sequence = self.sequence.wrapping_add(1);
        match self.send.send(header.as_bytes(), payload) {
            Ok(()) => {
                self.receiver.stats.sent += 1;
                Ok(())
            }
            Err(Errno::EAGAIN | Errno::ENOBUFS) => {
                self.receiver.stats.send_refused += 1;
                Err(PublishError::Busy)
            }
            Err(error) => Err(PublishError::Io(error.into())),
        }
    }

    /// Receives the channels that `pattern` matches as a whole; see [`crate::subscription::Pattern`]. A message that
    /// several subscriptions match is received once.
    ///
    /// # Errors
    /// A wrong pattern; at the first subscription also a bus that cannot be joined. Nothing is subscribed then.
    pub fn subscribe(&mut self, pattern: &str, _queue: Queue) -> Result<SubscriptionId, SubscribeError> {
        let id = self.receiver.subscribe(pattern).map_err(SubscribeError::Pattern)?;
        if let Err(error) = self.receive.join() {
            self.receiver.unsubscribe(id);
            return Err(SubscribeError::Io(error));
        }
        Ok(id)
    }

    /// Ends a subscription; false when there is none such.
    pub fn unsubscribe(&mut self, id: SubscriptionId) -> bool {
        self.receiver.unsubscribe(id)
    }

    /// The next message of a subscribed channel; never blocks. `None`: nothing more now, or a good many unwanted
    /// datagrams were dropped and more may wait; then the descriptor is still readable, so poll it level-triggered.
    ///
    /// # Errors
    /// The socket failed. What is wrong with a datagram is no error; see [`Udpm::stats`].
    pub fn recv(&mut self) -> io::Result<Option<Received<'_>>> {
        for _ in 0..UNWANTED_MAX {
            let Some(Arrival { from, len, at }) = self.receive.receive(&mut self.datagram)? else {
                return Ok(None);
            };
            self.receiver.stats.kernel_dropped = self.receive.dropped();
            let Some(short) = self.receiver.handle_rx(from, &self.datagram[..len]) else {
                continue;
            };
            self.channel.clear();
            self.channel.push_str(short.channel);
            let start = len - short.payload.len();
            return Ok(Some(Received { channel: &self.channel, payload: &self.datagram[start..len], at }));
        }
        Ok(None)
    }

    /// What became of all messages so far.
    #[must_use]
    pub fn stats(&self) -> &Stats {
        &self.receiver.stats
    }

    /// What was rejected so far, by kind: at most one of each.
    #[must_use]
    pub fn rejections(&self) -> &[Rejections] {
        self.receiver.rejections()
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
}

impl AsFd for Udpm {
    /// Readable when [`Udpm::recv`] has something to do. It is the same descriptor before and after the first
    /// subscription.
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.receive.as_fd()
    }
}
