//! Hosts and cables: network name spaces of one process, joined by pairs of virtual interfaces. Nothing of them
//! outlives the process. No privilege is needed where the kernel lets users make name spaces.
#![allow(dead_code, reason = "each test binary uses its part")]
#![allow(clippy::disallowed_methods, reason = "real sockets, threads and processes")]

use nix::sched::{CloneFlags, setns, unshare};
use nix::sys::socket::{
    AddressFamily, LinkAddr, SockFlag, SockProtocol, SockType, recvfrom, setsockopt, socket, sockopt,
};
use nix::sys::time::{TimeVal, TimeValLike};
use std::fs::File;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsRawFd, OwnedFd};
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};
use testing::{Found, machine_or_skip};

/// Set in a copy of this program that runs in a network name space of its own.
const INSIDE: &str = "ADVEE_TEST_HOST";

/// Runs `body` on a host that has a loopback interface and no more; the rest of the test is to do nothing. `test` is
/// the test's name. Skips where the machine does not permit it.
pub fn on_a_host(test: &str, body: impl FnOnce(Host)) {
    if std::env::var_os(INSIDE).is_some() {
        let here = Host::here();
        here.ip("link set lo up");
        return body(here);
    }
    if testing::peer_or_skip(testing::tool("ip", "-V")).is_none() || machine_or_skip(may()).is_none() {
        return;
    }
    let this = std::env::current_exe().expect("a running program");
    let mut child = Command::new("unshare");
    child.arg("-rn").arg(this).args([test, "--nocapture"]).env(INSIDE, "1");
    // The share of the machine that the caller holds is the child's, too.
    child.env_remove("ADVEE_TURNS");
    let output = child.output().expect("unshare runs");
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{out}{err}");
    assert!(out.contains("1 passed"), "{test} is not the name of one test: {out}");
}

/// Whether this user may make a network name space.
fn may() -> Found<()> {
    let output = Command::new("unshare").args(["-rn", "ip", "link", "set", "lo", "up"]).output();
    let output = output.map_err(|error| format!("unshare: {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => Err(format!("no network name space: {}", String::from_utf8_lossy(&output.stderr).trim())),
    }
}

/// A network name space.
pub struct Host(File);

impl Host {
    /// The one this thread is on.
    pub fn here() -> Self {
        Self(File::open("/proc/thread-self/ns/net").expect("a thread has a name space"))
    }

    /// Another one, with its loopback up.
    pub fn new() -> Self {
        let made = thread::spawn(|| {
            unshare(CloneFlags::CLONE_NEWNET).expect("a host may make another");
            Self::here()
        });
        let host = made.join().expect("made");
        host.ip("link set lo up");
        host
    }

    /// Does something on this host. Sockets and processes that it makes stay there.
    pub fn run<T: Send>(&self, body: impl FnOnce() -> T + Send) -> T {
        thread::scope(|scope| {
            let on = scope.spawn(|| {
                setns(&self.0, CloneFlags::CLONE_NEWNET).expect("the name space is there");
                body()
            });
            on.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }

    /// The `ip` command.
    #[track_caller]
    pub fn ip(&self, arguments: &str) {
        let output = self.run(|| Command::new("ip").args(arguments.split(' ')).output().expect("ip runs"));
        assert!(output.status.success(), "ip {arguments}: {}", String::from_utf8_lossy(&output.stderr));
    }

    /// Connects two hosts by a cable that is plugged in; each end has an address in the same /24.
    pub fn cable(&self, (name, address): (&str, &str), to: &Self, (to_name, to_address): (&str, &str)) {
        let (pid, fd) = (std::process::id(), to.0.as_raw_fd());
        self.ip(&format!("link add {name} type veth peer name {to_name}"));
        self.ip(&format!("link set {to_name} netns /proc/{pid}/fd/{fd}"));
        for (host, name, address) in [(self, name, address), (to, to_name, to_address)] {
            // No IPv6: its own multicast would only be in the way.
            host.ip(&format!("link set {name} addrgenmode none"));
            host.ip(&format!("addr add {address}/24 dev {name}"));
            host.ip(&format!("link set {name} up"));
        }
    }

    /// Listens on the wire from now on, at this host's end of every cable.
    pub fn tap(&self) -> Tap {
        let flags = SockFlag::SOCK_CLOEXEC;
        let open = || socket(AddressFamily::Packet, SockType::Raw, flags, SockProtocol::EthAll);
        let fd = self.run(open).expect("a host may listen on its wire");
        setsockopt(&fd, sockopt::ReceiveTimeout, &TimeVal::milliseconds(100)).expect("a time limit");
        Tap(fd)
    }

    /// Everything for `group` that `tap`, at the far ends of this host's cables `interfaces`, has seen until now.
    pub fn seen(&self, interfaces: &[&str], tap: &Tap, group: Ipv4Addr) -> Vec<Seen> {
        let mut seen = Vec::new();
        for interface in interfaces {
            seen.extend(self.all_seen(interface, tap).into_iter().filter(|datagram| datagram.to == group));
        }
        seen
    }

    /// Everything but marks.
    pub fn all_seen(&self, interface: &str, tap: &Tap) -> Vec<Seen> {
        static MARKS: AtomicU32 = AtomicU32::new(0);
        let mark = MARKS.fetch_add(1, Ordering::Relaxed).to_be_bytes();
        let deadline = Instant::now() + PATIENCE;
        let mut seen = Vec::new();
        loop {
            assert!(Instant::now() < deadline, "no mark comes through {interface}");
            // Again and again: a cable that was just plugged in carries nothing at first.
            self.mark(interface, mark);
            while let Some(datagram) = tap.next() {
                match datagram.to == *MARK.ip() {
                    true if datagram.payload == mark => return seen,
                    true => {}
                    false => seen.push(datagram),
                }
            }
        }
    }

    /// Sends a datagram that shows how far a tap has come.
    fn mark(&self, interface: &str, mark: [u8; 4]) {
        self.run(|| {
            let socket = UdpSocket::bind("0.0.0.0:0").expect("a socket");
            setsockopt(&socket, sockopt::BindToDevice, &interface.into()).expect("the interface is there");
            socket.set_multicast_ttl_v4(1).expect("a TTL");
            socket.send_to(&mark, MARK).expect("sent");
        });
    }
}

/// Long enough for a loaded machine.
const PATIENCE: Duration = Duration::from_secs(10);
/// Where a mark is sent.
const MARK: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(239, 1, 1, 1), 9);

/// A capture of what arrives by the cables of a host.
pub struct Tap(OwnedFd);

/// An IPv4 UDP datagram, or its first fragment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seen {
    /// Index of this host's interface.
    pub by: usize,
    pub to: Ipv4Addr,
    pub ttl: u8,
    pub payload: Vec<u8>,
}

impl Tap {
    /// The next datagram; none when there is none for a moment.
    fn next(&self) -> Option<Seen> {
        let mut frame = [0; 65_536];
        loop {
            let (len, from) = recvfrom::<LinkAddr>(self.0.as_raw_fd(), &mut frame).ok()?;
            let datagram = datagram(&frame[..len], from?.ifindex());
            if datagram.is_some() {
                return datagram;
            }
        }
    }
}

/// Ethernet, then IPv4 (RFC 791), then UDP.
fn datagram(frame: &[u8], by: usize) -> Option<Seen> {
    let (ethernet, packet) = frame.split_at_checked(14)?;
    let header = usize::from(packet.first()? & 0x0F) * 4;
    let is_udp = ethernet[12..] == [0x08, 0x00] && packet.len() >= header + 8 && header >= 20 && packet[9] == 17;
    let to: [u8; 4] = packet.get(16..20)?.try_into().ok()?;
    is_udp.then(|| Seen { by, to: to.into(), ttl: packet[8], payload: packet[header + 8..].into() })
}
