//! Listener on the CAN bus: commands to the drives, and their own reactions.

use base::can::Id;
use host::ports::can_udp_codec;
use nix::sys::socket::{AddressFamily, SockFlag, SockType, SockaddrIn, bind, setsockopt, socket, sockopt};
use sim::check::wire::{Drive, Protocol};
use std::net::{Ipv4Addr, UdpSocket};
use std::os::fd::AsRawFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// First identifier of emergencies (CiA 301).
const EMERGENCY: u16 = 0x80;
/// Statusword (CiA 402-2): operation enabled, and its mask.
const OPERATION_ENABLED: (u16, u16) = (0x27, 0x6F);
/// CiA 301: life guard or heartbeat error.
const HEARTBEAT_LOST: [u8; 2] = 0x8130u16.to_le_bytes();

/// Effect of a frame on the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// A wheel is commanded to turn.
    Drives,
    /// Each wheel is commanded to stop, or stops by itself.
    Stops,
}

/// Listener with its thread.
pub struct Can {
    pub signs: Receiver<(Instant, Sign)>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Can {
    /// Listens to the bus of this port, with these drives of the wheels.
    pub fn listen(port: u16, drives: Vec<Drive>) -> Self {
        let socket = open(port);
        let (send, signs) = channel();
        let end = Arc::new(AtomicBool::new(false));
        let ended = end.clone();
        let thread = Some(std::thread::spawn(move || forward(&socket, &drives, &send, &ended)));
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

fn forward(can: &UdpSocket, drives: &[Drive], signs: &Sender<(Instant, Sign)>, end: &AtomicBool) {
    let mut moves = vec![false; drives.len()];
    let mut datagram = [0; 512];
    while !end.load(Ordering::Relaxed) {
        let Ok(length) = can.recv(&mut datagram) else { continue };
        let now = Instant::now();
        let Ok(frame) = can_udp_codec::decode(&datagram[..length]) else { continue };
        let Id::Standard(id) = frame.id() else { continue };
        let found = drives.iter().enumerate().find_map(|(wheel, drive)| Some((wheel, moved(drive, id, frame.data())?)));
        let Some((wheel, now_moves)) = found else { continue };
        moves[wheel] = now_moves;
        if now_moves || !moves.contains(&true) {
            let _ = signs.send((now, if now_moves { Sign::Drives } else { Sign::Stops }));
        }
    }
}

/// True if a frame commands the drive to turn, false if it commands it to stop, or shows that it stops by itself: the
/// emergency of a CANopen drive whose master is silent, or the heartbeat of an ODrive that is disarmed.
fn moved(drive: &Drive, id: u16, data: &[u8]) -> Option<bool> {
    if id == drive.command.id {
        return drive.commanded(data).map(Drive::moves);
    }
    let stops = match drive.protocol {
        Protocol::Canopen => id == EMERGENCY + u16::from(drive.node) && data.starts_with(&HEARTBEAT_LOST),
        Protocol::CanSimple { .. } => {
            let (enabled, mask) = OPERATION_ENABLED;
            drive.reported(id, data).is_some_and(|statusword| statusword & mask != enabled)
        }
    };
    stops.then_some(false)
}
