//! The LCM bus as hosts and tools use it: typed messages, and datagrams that are not ours.

use super::clock;
use crate::keepers;
use base::{Duration, Instant};
use lcm::Url;
use lcm::live::Lcm;
use lcm::origin::Origin;
use lcm::receiver::Rejected;
use lcm::url::Shm;
use messages::{Channel, DecodeError, Message};
use module::admission::{Process, Sender, Way};
use std::os::fd::{AsFd, BorrowedFd};

/// A connection to the bus.
pub struct Bus {
    lcm: Lcm,
    /// Buffer of the encoded message.
    buffer: Vec<u8>,
    /// Number of datagrams that LCM rejected, by kind, as of the last report.
    reported: Vec<(&'static str, u64)>,
    /// Sender of the message that was received last.
    sender: Sender,
    /// Users whose places in shared memory are the robot's.
    users: Vec<u32>,
    clocks: Clocks,
}

/// Maximum memory of messages of which fragments are missing, bytes: of a reader of single channels, and of one of the
/// whole bus.
const INCOMPLETE_MAX: (usize, usize) = (1 << 20, 32 << 20);

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
        let mut users = keepers::users();
        if let Url::Udpm(udpm) = &mut place {
            udpm.recv_buf_size = udpm.recv_buf_size.max(buffer_size);
            match udpm.shm {
                // Modules of other users come there, too.
                Shm::Auto if keepers::are_any() => udpm.shm = Shm::Of(keepers::own_user()),
                // This process is of another user than the robot.
                Shm::Of(robot) => users.push(robot),
                Shm::Auto | Shm::Off => {}
            }
        }
        let mut lcm = Lcm::new(&place).map_err(|error| format!("LCM bus {url}: {error}"))?;
        let overhears = channels.iter().any(|channel| Channel::from_name(channel).is_none());
        lcm.set_memory_max(if overhears { INCOMPLETE_MAX.1 } else { INCOMPLETE_MAX.0 });
        for name in channels {
            let id = lcm.subscribe(name).map_err(|error| error.to_string())?;
            if let Some(channel) = Channel::from_name(name) {
                lcm.set_size_max(id, channel.size_max());
            }
        }
        let sender = Sender { way: Way::Network, process: None };
        Ok(Self { lcm, buffer: Vec::new(), reported: Vec::new(), sender, users, clocks: Clocks::default() })
    }

    /// Sender of the message that was received last, as far as it is known.
    #[must_use]
    pub fn sender(&self) -> Sender {
        self.sender
    }

    /// True if senders on this computer can be told from each other: by their places in shared memory.
    #[must_use]
    pub fn knows_senders(&self) -> bool {
        self.lcm.udpm().is_some_and(lcm::live::Udpm::shares_memory)
    }

    /// True if somebody truncated this process's file in shared memory: the others no longer know who publishes its
    /// messages, and a new process is to take its place.
    #[must_use]
    pub fn is_cut_off(&self) -> bool {
        self.lcm.udpm().is_some_and(lcm::live::Udpm::is_cut_off)
    }

    /// Publishes a message on its channel.
    pub fn publish(&mut self, message: &Message) -> Result<(), String> {
        let channel = message.channel_name();
        self.buffer.clear();
        message.encode(&mut self.buffer).map_err(|error| format!("{channel} cannot be sent: {error}"))?;
        self.lcm.publish(&channel, &self.buffer).map_err(|error| format!("{channel} cannot be sent: {error}"))
    }

    /// Publishes the bytes of a message, fingerprint and all, on any channel.
    pub fn publish_raw(&mut self, channel: &str, bytes: &[u8]) -> Result<(), String> {
        self.lcm.publish(channel, bytes).map_err(|error| format!("{channel} cannot be sent: {error}"))
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
        let raw = match self.lcm.recv() {
            Ok(Some(message)) => message,
            Ok(None) => {
                self.clocks.on_empty(now);
                return Received::Nothing;
            }
            Err(error) => return Received::Broken(format!("LCM bus: {error}")),
        };
        self.sender = sender(raw.origin, &self.users);
        let (published, raw) = (raw.published, self::raw(raw));
        let at = match published {
            None => self.clocks.received(now, clock::both(), raw.received_ns),
            Some(ns) => match published_at(now, ns) {
                Some(at) => at,
                None => {
                    let why = format!("{}: dropped, because its time of publication is in the future", raw.channel);
                    return Received::Malformed { subject: format!("{} time", raw.channel), why };
                }
            },
        };
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
        Ok(received.map(raw))
    }
}

fn raw(message: lcm::live::Received<'_>) -> Raw<'_> {
    Raw {
        channel: message.channel,
        data: message.payload,
        received_ns: u64::try_from(message.at.0).unwrap_or_default(),
    }
}

/// Sender by the origin of a message. A user that does not belong to the robot may claim any process id.
fn sender(origin: Origin, users: &[u32]) -> Sender {
    let known = origin.process().filter(|process| users.contains(&process.uid));
    let way = match origin {
        Origin::Memory(_) if known.is_some() => Way::Memory,
        Origin::Memory(_) | Origin::Host(_) => Way::Host,
        Origin::Network => Way::Network,
    };
    Sender { way, process: known.map(|lcm::origin::Process { pid, uid }| Process { pid, uid }) }
}

/// Maximum difference between this process's time, read a moment ago, and that of a publisher on another processor.
const FUTURE_MAX: Duration = Duration::from_millis(20);

/// Time of publication by the publisher's monotonic clock, which is this process's too; at most `now`. `None`: a time
/// that no correct publisher would state.
fn published_at(now: Instant, ns: i64) -> Option<Instant> {
    let at = Instant::from_nanos(u64::try_from(ns).ok()?);
    (at <= now + FUTURE_MAX || at <= clock::now() + FUTURE_MAX).then(|| at.min(now))
}

/// The wall clock beside the monotonic one, to find its steps: the kernel stamps datagrams by the wall clock alone.
#[derive(Debug, Default)]
struct Clocks {
    /// Wall clock minus monotonic clock, ns, at the last message.
    offset: Option<i128>,
    /// Last time at which nothing waited: what is received now came later.
    empty: Instant,
    /// The wall clock stepped back since: the age of what waits is not known.
    stepped: bool,
}

impl Clocks {
    /// Difference of the offset that is no step: adjustments of the wall clock while a process slept, ns.
    const STEP_MIN: i128 = 5_000_000;

    /// Nothing waits at `now`.
    fn on_empty(&mut self, now: Instant) {
        (self.empty, self.stepped) = (now, false);
    }

    /// Time of reception of a datagram that the kernel stamped with `kernel_ns`, at most `now`, with both clocks read
    /// at once, later than `now`. After a backward step of the wall clock it is the earliest possible one: an old
    /// message never counts as new. After a forward step it is too early by the step.
    fn received(&mut self, now: Instant, (monotonic, wall): (Instant, u64), kernel_ns: u64) -> Instant {
        let offset = i128::from(wall) - i128::from(monotonic.as_nanos());
        if self.offset.replace(offset).is_some_and(|before| offset < before - Self::STEP_MIN) {
            self.stepped = true;
        }
        let at = now.min(monotonic - std::time::Duration::from_nanos(wall.saturating_sub(kernel_ns)));
        if self.stepped { at.min(self.empty) } else { at }
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

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn at(s: u64) -> Instant {
        Instant::from_nanos(s * S)
    }

    #[test]
    fn memory_of_the_robots_users_alone_counts_as_such() {
        let of = |uid| lcm::origin::Process { pid: 7, uid };
        let (process, users) = (Process { pid: 7, uid: 1001 }, [1000, 1001]);
        let way = |way| Sender { way, process: Some(process) };
        assert_eq!(sender(Origin::Memory(of(1001)), &users), way(Way::Memory));
        assert_eq!(sender(Origin::Host(Some(of(1001))), &users), way(Way::Host));
        let unknown = |way| Sender { way, process: None };
        assert_eq!(sender(Origin::Memory(of(1002)), &users), unknown(Way::Host), "in the robot's group, and not named");
        assert_eq!(sender(Origin::Host(Some(of(1002))), &users), unknown(Way::Host));
        assert_eq!(sender(Origin::Network, &users), unknown(Way::Network));
    }

    #[test]
    fn a_process_that_was_held_up_sees_no_step_of_the_clock() {
        let mut clocks = Clocks::default();
        let (wall, held_up) = (|at: Instant| 1000 * S + at.as_nanos(), Duration::from_millis(30));
        // It never was idle, and is held up before it reads the clocks.
        let read = at(2) + held_up;
        assert_eq!(clocks.received(at(2), (read, wall(read)), wall(at(2)) - S / 2), at(2) - Duration::from_millis(500));
        assert_eq!(clocks.received(at(3), (at(3), wall(at(3))), wall(at(3))), at(3));
        // What arrived meanwhile is not from the future.
        assert_eq!(clocks.received(at(4), (at(4) + held_up, wall(at(4) + held_up)), wall(at(4) + held_up)), at(4));
    }

    #[test]
    fn what_waited_over_a_backward_step_of_the_clock_is_old() {
        let mut clocks = Clocks::default();
        let wall = |s: u64| (1000 + s) * S;
        clocks.on_empty(at(1));
        assert_eq!(clocks.received(at(2), (at(2), wall(2)), wall(2) - S / 2), at(2) - Duration::from_millis(500));
        clocks.on_empty(at(2));
        // It waits for 3 s; the clock is set back by 10 s in between.
        let before = wall(3);
        assert_eq!(clocks.received(at(6), (at(6), wall(6) - 10 * S), before), at(2));
        assert_eq!(
            clocks.received(at(6), (at(6), wall(6) - 10 * S), wall(6) - 10 * S),
            at(2),
            "which of them waited is unknown"
        );
        clocks.on_empty(at(6));
        assert_eq!(clocks.received(at(7), (at(7), wall(7) - 10 * S), wall(7) - 10 * S), at(7));
        // A forward step makes it older, never newer.
        assert_eq!(
            clocks.received(at(8), (at(8), wall(8)), wall(8) - 10 * S),
            Instant::ZERO.max(at(8) - Duration::from_secs(10))
        );
    }

    #[test]
    fn a_publisher_from_the_future_is_not_believed() {
        let now = clock::now();
        let ns = |at: Instant| i64::try_from(at.as_nanos()).unwrap();
        assert_eq!(published_at(now, ns(now - Duration::from_secs(1))), Some(now - Duration::from_secs(1)));
        assert_eq!(published_at(now, ns(now + Duration::from_millis(1))), Some(now));
        assert_eq!(published_at(now, ns(now + Duration::from_secs(3600))), None);
        assert_eq!(published_at(now, i64::MAX), None);
        assert_eq!(published_at(now, -1), None);
    }
}
