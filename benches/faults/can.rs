//! Listener on the CAN bus: commands to the drives, and their own reactions.

use base::can::Id;
use host::ports::can_udp_codec;
use nix::sys::socket::{AddressFamily, SockFlag, SockType, SockaddrIn, bind, setsockopt, socket, sockopt};
use std::net::{Ipv4Addr, UdpSocket};
use std::os::fd::AsRawFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Target velocity and emergencies of the propulsion, node 1.
const RPDO4: Id = Id::Standard(0x501);
const EMERGENCY: Id = Id::Standard(0x081);
/// CiA 301: life guard or heartbeat error.
const HEARTBEAT_LOST: [u8; 2] = 0x8130u16.to_le_bytes();

/// Effect of a frame on the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// The drive is commanded to turn.
    Drives,
    /// The drive is commanded to stop, or stops by itself.
    Stops,
}

/// Listener with its thread.
pub struct Can {
    pub signs: Receiver<(Instant, Sign)>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Can {
    pub fn listen(port: u16) -> Self {
        let socket = open(port);
        let (send, signs) = channel();
        let end = Arc::new(AtomicBool::new(false));
        let ended = end.clone();
        let thread = Some(std::thread::spawn(move || forward(&socket, &send, &ended)));
        Self { signs, end, thread }
    }
}

impl Drop for Can {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Socket that hears the bus beside all its nodes.
pub fn open(port: u16) -> UdpSocket {
    let fd = socket(AddressFamily::Inet, SockType::Datagram, SockFlag::SOCK_CLOEXEC, None).expect("a socket");
    setsockopt(&fd, sockopt::ReuseAddr, &true).expect("reuse");
    setsockopt(&fd, sockopt::ReusePort, &true).expect("reuse");
    bind(fd.as_raw_fd(), &SockaddrIn::new(0, 0, 0, 0, port)).expect("bind");
    let can = UdpSocket::from(fd);
    can.join_multicast_v4(&Ipv4Addr::new(239, 74, 163, 2), &Ipv4Addr::UNSPECIFIED).expect("join");
    can.set_read_timeout(Some(Duration::from_millis(100))).expect("a time limit");
    can
}

fn forward(can: &UdpSocket, signs: &Sender<(Instant, Sign)>, end: &AtomicBool) {
    let mut datagram = [0; 512];
    while !end.load(Ordering::Relaxed) {
        let Ok(length) = can.recv(&mut datagram) else { continue };
        let now = Instant::now();
        let Ok(frame) = can_udp_codec::decode(&datagram[..length]) else { continue };
        if let Some(sign) = sign(frame.id(), frame.data()) {
            let _ = signs.send((now, sign));
        }
    }
}

/// CiA 402: bit 2 of the controlword is low for a quick stop, bits 0 to 3 are high in operation.
fn sign(id: Id, data: &[u8]) -> Option<Sign> {
    match (id, data) {
        (RPDO4, [control, _, speed @ ..]) => {
            let operates = control & 0x0F == 0x0F && speed.iter().any(|byte| *byte != 0);
            Some(if operates { Sign::Drives } else { Sign::Stops })
        }
        (EMERGENCY, data) if data.starts_with(&HEARTBEAT_LOST) => Some(Sign::Stops),
        _ => None,
    }
}
