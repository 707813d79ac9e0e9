//! Proof that no datagram of another computer enters a bus with TTL 0: in a network name space of its own, where a pair
//! of virtual interfaces acts as a cable. What leaves by one end enters by the other as if from another computer.

use crate::Failed;
use lcm::live::keep_local;
use nix::errno::Errno;
use nix::sys::socket::{
    AddressFamily, IpMembershipRequest, MsgFlags, SockFlag, SockType, SockaddrIn, bind, recv, sendto, setsockopt,
    socket, sockopt,
};
use std::fs;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Number of datagrams that are sent.
const SHOTS: u32 = 16;
/// Ends of the cable, with their addresses.
const ENDS: [(&str, Ipv4Addr); 2] = [("advee0", Ipv4Addr::new(10, 9, 8, 1)), ("advee1", Ipv4Addr::new(10, 9, 8, 2))];
const BUS: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(239, 255, 76, 67), 7667);
/// Time that datagrams take at most.
const PATIENCE: Duration = Duration::from_millis(500);

/// Datagrams of another computer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Incoming {
    pub sent: u32,
    /// Those that a socket without a filter received.
    pub control: u32,
    /// Those that a socket of the bus received.
    pub passed: u32,
}

/// Why there is no proof.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unproven {
    /// The filter cannot be attached.
    NoFilter(String),
    /// This user, or this machine, has no name spaces.
    NoNetwork(String),
}

/// Runs the proof in a copy of this program.
pub fn prove() -> Result<Incoming, Unproven> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(|error| Unproven::NoFilter(error.to_string()))?;
    keep_local(socket.as_fd()).map_err(|error| Unproven::NoFilter(error.to_string()))?;
    let unproven = |why: &str| Unproven::NoNetwork(why.trim().into());
    let this = std::env::current_exe().map_err(|error| unproven(&error.to_string()))?;
    let mut child = Command::new("unshare");
    child.arg("-rn").arg(this).args(["doctor", "--entering"]).stdin(Stdio::null());
    let output = child.output().map_err(|error| unproven(&format!("unshare: {error}")))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let counts = text.trim().strip_prefix("entering ").and_then(|counts| counts.split_once(' '));
    match counts.map(|(control, passed)| (control.parse(), passed.parse())) {
        Some((Ok(control), Ok(passed))) => Ok(Incoming { sent: SHOTS, control, passed }),
        _ => Err(unproven(String::from_utf8_lossy(&output.stderr).lines().next().unwrap_or("no answer"))),
    }
}

/// Runs the test in this name space, which must be empty; returns the two counts as [`prove`] reads them.
pub fn inside() -> Result<String, Failed> {
    let [(from, source), (to, target)] = ENDS;
    let commands = [
        "link set lo up".to_string(),
        format!("link add {from} type veth peer name {to}"),
        format!("addr add {source}/24 dev {from}"),
        format!("addr add {target}/24 dev {to}"),
        format!("link set {from} up"),
        format!("link set {to} up"),
    ];
    for command in commands {
        let output = Command::new("ip").args(command.split(' ')).output();
        let output = output.map_err(|error| Failed::from(format!("ip: {error}")))?;
        if !output.status.success() {
            return Err(format!("ip {command}: {}", String::from_utf8_lossy(&output.stderr).trim()).into());
        }
    }
    // Both ends are on this host. The kernel normally drops packets from outside with an address of the host: here it
    // must accept them.
    for (key, value) in
        [(format!("{to}/accept_local"), "1"), (format!("{to}/rp_filter"), "0"), ("all/rp_filter".into(), "0")]
    {
        let path = format!("/proc/sys/net/ipv4/conf/{key}");
        fs::write(&path, value).map_err(|error| Failed::from(format!("{path}: {error}")))?;
    }
    let (control, ours) = (ear(target, false)?, ear(target, true)?);
    let mouth = socket(AddressFamily::Inet, SockType::Datagram, SockFlag::SOCK_CLOEXEC, None).map_err(refused)?;
    setsockopt(&mouth, sockopt::IpMulticastTtl, &1).map_err(refused)?;
    setsockopt(&mouth, sockopt::IpMulticastLoop, &false).map_err(refused)?;
    bind(mouth.as_raw_fd(), &SockaddrIn::from(SocketAddrV4::new(source, 0))).map_err(refused)?;
    let (mut heard, mut passed) = (0, 0);
    let begin = Instant::now();
    for _ in 0..SHOTS {
        sendto(mouth.as_raw_fd(), b"advee doctor", &SockaddrIn::from(BUS), MsgFlags::MSG_DONTWAIT).map_err(refused)?;
    }
    while heard < SHOTS && begin.elapsed() < PATIENCE {
        thread::sleep(Duration::from_millis(5));
        heard += drain(&control);
    }
    // What the control socket has received has been passed to all sockets.
    passed += drain(&ours);
    Ok(format!("entering {heard} {passed}"))
}

/// A socket on the bus, with the filter or without.
fn ear(on: Ipv4Addr, local: bool) -> Result<OwnedFd, Failed> {
    let ear = socket(AddressFamily::Inet, SockType::Datagram, SockFlag::SOCK_CLOEXEC, None).map_err(refused)?;
    setsockopt(&ear, sockopt::ReuseAddr, &true).map_err(refused)?;
    if local {
        keep_local(ear.as_fd()).map_err(|error| Failed::from(error.to_string()))?;
    }
    bind(ear.as_raw_fd(), &SockaddrIn::from(BUS)).map_err(refused)?;
    setsockopt(&ear, sockopt::IpAddMembership, &IpMembershipRequest::new(*BUS.ip(), Some(on))).map_err(refused)?;
    Ok(ear)
}

fn refused(errno: Errno) -> Failed {
    format!("a socket: {}", errno.desc()).into()
}

fn drain(ear: &OwnedFd) -> u32 {
    let mut count = 0;
    while recv(ear.as_raw_fd(), &mut [0; 64], MsgFlags::MSG_DONTWAIT).is_ok() {
        count += 1;
    }
    count
}
