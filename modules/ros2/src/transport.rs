//! The node's thread: sockets, the robot's bus, and the clock. It is the module's alone: whatever arrives here, the
//! processes that move the robot do not notice.

use crate::node::{self, Node};
use crate::outgoing::Outgoing;
use crate::servers;
use crate::settings::{Peer, Ros2};
use base::{Duration, Instant};
use host::bus::{Bus, Received};
use host::clock;
use messages::Channel;
use nix::cmsg_space;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::socket::{
    AddressFamily, ControlMessageOwned, MsgFlags, SockFlag, SockType, SockaddrIn, bind, recvmsg, setsockopt, socket,
    sockopt,
};
use nix::sys::time::TimeSpec;
use rtps::{Counters, Prefix};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, IoSliceMut};
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// Programs of one computer that are asked for at their usual ports.
const PROGRAMS: u32 = 10;
/// Ports that are tried, from the first one on: as many programs of DDS may be on this computer.
const PORTS: u32 = 100;
/// Messages of the bus that are read before others have their turn.
const BURST: usize = 256;
/// Datagrams of a socket that are read in a turn, before others have theirs.
const DATAGRAMS: u32 = 16;
/// Datagrams of a socket that are read at once, as when many programs start together; after them one in each
/// [`SPACING`]. A flood takes a bounded part of a processor, and the kernel drops it.
const DATAGRAMS_AT_ONCE: u32 = 1024;
const SPACING: Duration = Duration::from_micros(250);
/// Pause of the thread when a socket has had its share, for [`DATAGRAMS`] of them.
const REST: Duration = Duration::from_millis(4);
/// Longest wait: the module looks whether the thread goes on.
const WAIT_MAX: Duration = Duration::from_millis(200);
/// Receive buffer, bytes: a burst of discovery, while the thread waits for its turn.
const RECEIVE_BUFFER: usize = 1 << 20;
/// Longest datagram of UDP, bytes.
const DATAGRAM_MAX: usize = 65_507;
/// Notes that wait at most.
const NOTES_MAX: usize = 64;
/// Period of notes about what was dropped.
const COUNTED_PERIOD: Duration = Duration::from_secs(10);

/// The thread, as its module sees it.
#[derive(Debug)]
pub struct Transport {
    thread: JoinHandle<()>,
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    end: AtomicBool,
    paused: AtomicBool,
    turns: AtomicU32,
    notes: Mutex<Vec<String>>,
}

/// What the thread works with.
struct Worker {
    node: Node,
    bus: Bus,
    sockets: Sockets,
    shared: Arc<Shared>,
    counted: (Instant, Counters),
}

struct Sockets {
    unicast: Inlet,
    multicast: Option<Inlet>,
    /// Room for times of reception.
    control: Vec<u8>,
    datagram: Box<[u8]>,
}

/// A socket, and how many datagrams of it may be read now.
struct Inlet {
    socket: UdpSocket,
    allowed: u32,
    counted_to: Instant,
}

/// How a turn with the sockets ended, the greatest of both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Turn {
    Empty,
    More,
    /// A socket has had its share.
    Flooded,
}

impl Transport {
    /// Opens the sockets, joins the bus and starts the thread; with it, where the robot is found.
    ///
    /// # Errors
    /// One line: the address is not one of this computer, no port is free, or the bus cannot be joined.
    pub fn start(settings: &Ros2, lcm_url: &str, config: node::Config) -> Result<(Self, SocketAddrV4), String> {
        let (sockets, own) = Sockets::open(settings).map_err(|error| format!("{}: {error}", settings.address))?;
        let participant = rtps::Config { locators: vec![own], ..config.participant };
        let participant = rtps::Config { announce_to: announce_to(settings, own), prefix: prefix(), ..participant };
        let mut channels = Outgoing::channels();
        channels.extend(servers::CHANNELS.map(Channel::name));
        let bus = Bus::open(lcm_url, &channels)?;
        let now = clock::now();
        let node = Node::new(node::Config { participant, ..config }, now);
        let shared = Arc::new(Shared::default());
        let worker = Worker { node, bus, sockets, shared: shared.clone(), counted: (now, Counters::default()) };
        let thread = std::thread::Builder::new().name("ros2 rtps".into()).spawn(move || worker.run());
        let thread = thread.map_err(|error| format!("the thread: {error}"))?;
        Ok((Self { thread, shared }, own))
    }

    /// Ends the thread; [`has_ended`](Self::has_ended) is true soon.
    pub fn end(&self) {
        self.shared.end.store(true, Relaxed);
    }

    /// True if it was told to end.
    #[must_use]
    pub fn is_ending(&self) -> bool {
        self.shared.end.load(Relaxed)
    }

    /// True if it has ended.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }

    /// ROS may command, or not any more: from the thread's next turn on, 200 ms later at most.
    pub fn set_acts(&self, acts: bool) {
        self.shared.paused.store(!acts, Relaxed);
    }

    /// Counts the turns of the thread.
    #[must_use]
    pub fn turns(&self) -> u32 {
        self.shared.turns.load(Relaxed)
    }

    /// Notes for people since the last call.
    #[must_use]
    pub fn take_notes(&self) -> Vec<String> {
        std::mem::take(&mut *self.shared.notes.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Worker {
    fn run(mut self) {
        while !self.shared.end.load(Relaxed) {
            self.shared.turns.fetch_add(1, Relaxed);
            self.node.set_acts(!self.shared.paused.load(Relaxed));
            let more = self.read_bus();
            let turn = self.sockets.read(&mut self.node);
            let now = clock::now();
            self.node.handle_timeout(now);
            self.send();
            self.tell(now);
            if turn == Turn::Flooded {
                std::thread::sleep(REST);
                continue;
            }
            let due = self.node.poll_timeout().map_or(WAIT_MAX, |due| due.since(now));
            let wait = if more || turn == Turn::More { Duration::ZERO } else { due.min(WAIT_MAX) };
            let fds = [Some(self.bus.as_fd()), Some(self.sockets.unicast.socket.as_fd()), self.sockets.multicast_fd()];
            let mut fds: Vec<PollFd<'_>> =
                fds.into_iter().flatten().map(|fd| PollFd::new(fd, PollFlags::POLLIN)).collect();
            // Rounded up: not to spin through the last millisecond.
            let millis = u16::try_from(wait.as_nanos().div_ceil(1_000_000)).unwrap_or(u16::MAX);
            if let Err(errno) = poll(&mut fds, PollTimeout::from(millis))
                && errno != Errno::EINTR
            {
                self.shared.note(format!("poll: {}", errno.desc()));
                break;
            }
        }
        self.node.leave(clock::now());
        self.send();
    }

    /// True if there may be more.
    fn read_bus(&mut self) -> bool {
        for _ in 0..BURST {
            let now = clock::now();
            let node = &mut self.node;
            let received = self.bus.receive_with(now, |_, raw| {
                node.on_bus(now, raw.channel, raw.data);
                false
            });
            match received {
                Received::Nothing => return false,
                Received::Broken(why) => {
                    self.shared.note(why);
                    return false;
                }
                Received::Message { .. } | Received::Foreign | Received::Malformed { .. } => {}
            }
        }
        true
    }

    fn send(&mut self) {
        while let Some(transmit) = self.node.poll_tx() {
            // A full buffer or an address that is not reached loses a datagram, as any network does.
            let _ = self.sockets.unicast.socket.send_to(&transmit.datagram, transmit.to);
        }
        while let Some(message) = self.node.poll_message() {
            if let Err(why) = self.bus.publish(&message) {
                self.shared.note(why);
            }
        }
    }

    fn tell(&mut self, now: Instant) {
        while let Some(note) = self.node.poll_note() {
            self.shared.note(note);
        }
        let (told_at, told) = self.counted;
        if now.since(told_at) < COUNTED_PERIOD {
            return;
        }
        let counted = self.node.counters();
        self.counted = (now, counted);
        let news = [
            (counted.malformed - told.malformed, "datagrams are malformed"),
            (counted.refused - told.refused, "participants or endpoints are refused: too many"),
            (counted.dropped_in - told.dropped_in, "received samples are dropped: too many, or too long"),
            (counted.dropped_out - told.dropped_out, "datagrams are dropped: the network is too slow"),
        ];
        for (count, what) in news.into_iter().filter(|(count, _)| *count > 0) {
            self.shared.note(format!("{count} {what}"));
        }
    }
}

impl Shared {
    fn note(&self, text: String) {
        let mut notes = self.notes.lock().unwrap_or_else(PoisonError::into_inner);
        if notes.len() < NOTES_MAX && !notes.contains(&text) {
            notes.push(text);
        }
    }
}

impl Sockets {
    fn open(settings: &Ros2) -> io::Result<(Self, SocketAddrV4)> {
        let Ros2 { address, domain, multicast, .. } = *settings;
        let mut failed = io::Error::from(io::ErrorKind::AddrInUse);
        let mut bound = None;
        for port in (0..PORTS).map_while(|n| rtps::unicast_port(domain, n)) {
            match UdpSocket::bind((address, port)) {
                Ok(socket) => {
                    bound = Some((socket, SocketAddrV4::new(address, port)));
                    break;
                }
                Err(error) => failed = error,
            }
        }
        let (unicast, own) = bound.ok_or(failed)?;
        let multicast = match rtps::multicast_port(domain).filter(|_| multicast && !address.is_loopback()) {
            Some(port) => Some(group(address, port)?),
            None => None,
        };
        for socket in [Some(&unicast), multicast.as_ref()].into_iter().flatten() {
            socket.set_nonblocking(true)?;
            // At most net.core.rmem_max.
            setsockopt(socket, sockopt::RcvBuf, &RECEIVE_BUFFER)?;
            setsockopt(socket, sockopt::ReceiveTimestampns, &true)?;
        }
        let (control, datagram) = (cmsg_space!(TimeSpec), vec![0; DATAGRAM_MAX].into_boxed_slice());
        let (unicast, multicast) = (Inlet::new(unicast), multicast.map(Inlet::new));
        Ok((Self { unicast, multicast, control, datagram }, own))
    }

    fn multicast_fd(&self) -> Option<BorrowedFd<'_>> {
        self.multicast.as_ref().map(|inlet| inlet.socket.as_fd())
    }

    /// Reads some datagrams of both.
    fn read(&mut self, node: &mut Node) -> Turn {
        let Self { unicast, multicast, control, datagram } = self;
        let inlets = [Some(unicast), multicast.as_mut()].into_iter().flatten();
        inlets.map(|inlet| inlet.read(control, datagram, node)).max().unwrap_or(Turn::Empty)
    }
}

impl Inlet {
    fn new(socket: UdpSocket) -> Self {
        Self { socket, allowed: DATAGRAMS_AT_ONCE, counted_to: clock::now() }
    }

    /// How many datagrams may be read in a turn that begins at `now`.
    fn allow(&mut self, now: Instant) -> u32 {
        let earned = now.since(self.counted_to).as_nanos() / SPACING.as_nanos();
        let earned = u32::try_from(earned).unwrap_or(u32::MAX);
        self.counted_to += SPACING * earned;
        self.allowed = self.allowed.saturating_add(earned).min(DATAGRAMS_AT_ONCE);
        self.allowed.min(DATAGRAMS)
    }

    fn read(&mut self, control: &mut [u8], datagram: &mut [u8], node: &mut Node) -> Turn {
        for _ in 0..self.allow(clock::now()) {
            self.allowed -= 1;
            if !read_one(&self.socket, control, datagram, node) {
                return Turn::Empty;
            }
        }
        if self.allowed == 0 { Turn::Flooded } else { Turn::More }
    }
}

/// False if there is none.
fn read_one(socket: &UdpSocket, control: &mut [u8], datagram: &mut [u8], node: &mut Node) -> bool {
    let mut parts = [IoSliceMut::new(datagram)];
    let received = recvmsg::<SockaddrIn>(socket.as_raw_fd(), &mut parts, Some(&mut *control), MsgFlags::empty());
    let (length, from, stamp) = match received {
        Ok(message) => {
            let stamps = message.cmsgs().into_iter().flatten();
            let stamp = stamps.into_iter().find_map(|control| match control {
                ControlMessageOwned::ScmTimestampns(time) => Some(time),
                _ => None,
            });
            (message.bytes, message.address.map(SocketAddrV4::from), stamp)
        }
        // An error about a datagram that was sent earlier, to a program that is gone.
        Err(Errno::EINTR | Errno::ECONNREFUSED) => return true,
        Err(_) => return false,
    };
    let now = clock::now();
    let nanos = |time: TimeSpec| time.tv_sec() as u64 * 1_000_000_000 + time.tv_nsec() as u64;
    let at = stamp.map_or(now, |stamp| clock::received(now, nanos(stamp)));
    if let Some(from) = from {
        node.on_datagram(now, at, from, &datagram[..length]);
    }
    true
}

/// A socket for the group of the announcements, on the network of `address`.
fn group(address: Ipv4Addr, port: u16) -> io::Result<UdpSocket> {
    let receiver = socket(AddressFamily::Inet, SockType::Datagram, SockFlag::SOCK_CLOEXEC, None)?;
    // Every program of DDS on this computer has one.
    setsockopt(&receiver, sockopt::ReuseAddr, &true)?;
    setsockopt(&receiver, sockopt::ReusePort, &true)?;
    bind(receiver.as_raw_fd(), &SockaddrIn::from(SocketAddrV4::new(rtps::MULTICAST, port)))?;
    let receiver = UdpSocket::from(receiver);
    receiver.join_multicast_v4(&rtps::MULTICAST, &address)?;
    Ok(receiver)
}

/// Where the announcements go: to the group, to the peers, and to the other programs of this computer.
fn announce_to(settings: &Ros2, own: SocketAddrV4) -> Vec<SocketAddrV4> {
    let Ros2 { address, domain, multicast, .. } = *settings;
    let group = rtps::multicast_port(domain).filter(|_| multicast && !address.is_loopback());
    let mut to: Vec<SocketAddrV4> = group.map(|port| SocketAddrV4::new(rtps::MULTICAST, port)).into_iter().collect();
    for peer in settings.peers().into_iter().chain([Peer::Computer(address)]) {
        match peer {
            Peer::Computer(ip) => {
                let ports = (0..PROGRAMS).filter_map(|n| rtps::unicast_port(domain, n));
                to.extend(ports.map(|port| SocketAddrV4::new(ip, port)));
            }
            Peer::Program(program) => to.push(program),
        }
    }
    to.retain(|at| *at != own);
    to
}

/// An identifier that no other participant has: chance, and this process.
fn prefix() -> Prefix {
    let mut prefix = [0; 12];
    let chance = RandomState::new().build_hasher().finish();
    // The first two bytes are the vendor's.
    prefix[2..8].copy_from_slice(&chance.to_le_bytes()[..6]);
    prefix[8..].copy_from_slice(&std::process::id().to_le_bytes());
    Prefix(prefix)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn announcements_go_to_the_group_the_peers_and_this_computer_but_not_to_oneself() {
        let address = Ipv4Addr::new(10, 0, 0, 2);
        let own = SocketAddrV4::new(address, 7410);
        let peers = vec!["10.0.0.3".into(), "10.0.0.4:9000".into()];
        let far = Ros2 { address, peers, ..Ros2::default() };
        let to = announce_to(&far, own);
        assert_eq!(to.len(), 1 + 10 + 1 + 9);
        assert_eq!(to[0], SocketAddrV4::new(rtps::MULTICAST, 7400));
        assert!(to.contains(&"10.0.0.3:7428".parse().unwrap()) && to.contains(&"10.0.0.4:9000".parse().unwrap()));
        assert!(!to.contains(&own));
        let near = announce_to(&Ros2::default(), "127.0.0.1:7412".parse().unwrap());
        assert!(near.len() == 9 && near.iter().all(|at| at.ip().is_loopback()), "{near:?}");
    }

    #[test]
    fn a_flood_is_read_at_a_bounded_rate_and_a_burst_at_once() {
        let mut inlet = Inlet::new(UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap());
        let begin = inlet.counted_to;
        let mut read_until = |end: Instant, from: Instant| {
            let mut count = 0;
            let mut now = from;
            while now < end {
                let allowed = inlet.allow(now);
                inlet.allowed -= allowed;
                count += allowed;
                now += Duration::from_micros(100);
            }
            count
        };
        let burst = read_until(begin + Duration::from_millis(7), begin);
        assert!((DATAGRAMS_AT_ONCE..=DATAGRAMS_AT_ONCE + 28).contains(&burst), "{burst}");
        let flooded = read_until(begin + Duration::from_secs(10), begin + Duration::from_millis(7));
        assert!((39_900..=40_000).contains(&flooded), "{flooded}");
        // After a long silence no more than a burst.
        let later = begin + Duration::from_secs(1_000_000);
        let burst = read_until(later + Duration::from_millis(7), later);
        assert!((DATAGRAMS_AT_ONCE..=DATAGRAMS_AT_ONCE + 28).contains(&burst), "{burst}");
    }

    #[test]
    fn identifiers_differ_from_start_to_start() {
        assert_ne!(prefix(), prefix());
    }
}
