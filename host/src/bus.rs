//! The LCM bus as hosts and tools use it: typed messages, and datagrams that are not ours.

use super::clock;
use base::Instant;
use lcm::Url;
use lcm::live::Lcm;
use lcm::receiver::Rejected;
use messages::{DecodeError, Message};
use std::os::fd::{AsFd, BorrowedFd};

/// A connection to the bus.
pub struct Bus {
    lcm: Lcm,
    /// Buffer of the encoded message.
    buffer: Vec<u8>,
    /// Number of datagrams that LCM rejected, by kind, as of the last report.
    reported: Vec<(&'static str, u64)>,
}

/// Result of a receive call.
pub enum Received {
    /// Empty: nothing more for now.
    Nothing,
    /// A message of this robot.
    Message {
        /// Time at which the kernel received it, at most the `now` that was passed.
        at: Instant,
        /// The decoded message.
        message: Message,
    },
    /// A message that matched a pattern, on a channel that is not ours.
    Foreign,
    /// Something on a channel of ours that is no message of it.
    Malformed {
        /// Channel and kind of error; equal for errors of the same kind.
        subject: String,
        /// Explanation in one line.
        why: String,
    },
    /// The socket failed; the next call tries again.
    Broken(String),
}

/// A received message, not decoded.
pub struct Raw<'a> {
    /// The channel's name.
    pub channel: &'a str,
    /// Payload.
    pub data: &'a [u8],
    /// Time at which the kernel received it, nanoseconds since the UNIX epoch.
    pub received_ns: u64,
}

impl Bus {
    /// Joins the bus and subscribes to channels: names, or regular expressions that must match a whole name.
    pub fn open(url: &str, channels: &[&str]) -> Result<Self, String> {
        Self::open_with_buffer(url, channels, 0)
    }

    /// Like [`Bus::open`], with a receive buffer of at least `buffer_size` bytes, or the size in the URL if that is
    /// larger. The kernel limits it to `net.core.rmem_max`.
    pub fn open_with_buffer(url: &str, channels: &[&str], buffer_size: usize) -> Result<Self, String> {
        let (mut place, _) = Url::parse(url).map_err(|error| error.to_string())?;
        if let Url::Udpm(udpm) = &mut place {
            udpm.recv_buf_size = udpm.recv_buf_size.max(buffer_size);
        }
        let mut lcm = Lcm::new(&place).map_err(|error| format!("LCM bus {url}: {error}"))?;
        for channel in channels {
            lcm.subscribe(channel).map_err(|error| error.to_string())?;
        }
        Ok(Self { lcm, buffer: Vec::new(), reported: Vec::new() })
    }

    /// Publishes a message on its channel.
    pub fn publish(&mut self, message: &Message) -> Result<(), String> {
        let channel = message.channel_name();
        self.buffer.clear();
        message.encode(&mut self.buffer).map_err(|error| format!("{channel} cannot be sent: {error}"))?;
        self.lcm.publish(&channel, &self.buffer).map_err(|error| format!("{channel} cannot be sent: {error}"))
    }

    /// Number of datagrams that the kernel dropped because the receive buffer was full.
    pub fn kernel_dropped(&self) -> u64 {
        self.lcm.stats().kernel_dropped
    }

    /// Number of published messages that did not arrive here, wherever they were lost. Correct only if every channel is
    /// subscribed to.
    pub fn missed(&self) -> u64 {
        let stats = self.lcm.stats();
        stats.lost.max(stats.kernel_dropped) + stats.queue_dropped
    }

    /// Reports datagrams rejected since the last call because they are not LCM's: cause, one line, number. They reach
    /// every process on the bus.
    pub fn rejected(&mut self, mut report: impl FnMut(String, String, u64)) {
        for rejections in self.lcm.rejections() {
            let Rejected { why, .. } = rejections.last;
            let reported = match self.reported.iter_mut().find(|(kind, _)| *kind == why.kind()) {
                Some((_, reported)) => std::mem::replace(reported, rejections.count),
                None => {
                    self.reported.push((why.kind(), rejections.count));
                    0
                }
            };
            if rejections.count > reported {
                report(format!("lcm {}", why.kind()), rejections.last.to_string(), rejections.count - reported);
            }
        }
    }

    /// Receives the next message and decodes it.
    pub fn receive(&mut self, now: Instant) -> Received {
        self.receive_with(now, |_, _| true)
    }

    /// Receives the next message and passes its bytes to `on_raw`, which returns true if it is to be decoded too.
    pub fn receive_with(&mut self, now: Instant, on_raw: impl FnOnce(Instant, &Raw<'_>) -> bool) -> Received {
        let raw = match self.receive_raw() {
            Ok(Some(raw)) => raw,
            Ok(None) => return Received::Nothing,
            Err(why) => return Received::Broken(why),
        };
        let at = clock::received(now, raw.received_ns);
        if !on_raw(at, &raw) {
            return Received::Foreign;
        }
        match Message::receive(raw.channel, raw.data) {
            Some(Ok(message)) => Received::Message { at, message },
            Some(Err(error)) => malformed(&raw, &error),
            None => Received::Foreign,
        }
    }

    /// Receives the next message without decoding it.
    pub fn receive_raw(&mut self) -> Result<Option<Raw<'_>>, String> {
        let received = self.lcm.recv().map_err(|error| format!("LCM bus: {error}"))?;
        Ok(received.map(|message| Raw {
            channel: message.channel,
            data: message.payload,
            received_ns: u64::try_from(message.at.0).unwrap_or_default(),
        }))
    }
}

fn malformed(raw: &Raw<'_>, error: &DecodeError) -> Received {
    // The kind of error without its numbers, which differ from message to message.
    let kind = format!("{error:?}");
    let kind = kind.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
    let subject = format!("{} {kind}", raw.channel);
    Received::Malformed {
        subject,
        why: format!("{}: a message of {} bytes is dropped: {error}", raw.channel, raw.data.len()),
    }
}

impl AsFd for Bus {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.lcm.as_fd()
    }
}
