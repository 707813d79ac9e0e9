//! Listener on the CAN bus: commands to the drives, and their own reactions.

use base::can::Id;
use host::ports::can_udp_codec;
use nix::sys::socket::{AddressFamily, SockFlag, SockType, SockaddrIn, bind, setsockopt, socket, sockopt};
use sim::check::wire::Drive;
use std::net::{Ipv4Addr, UdpSocket};
use std::os::fd::AsRawFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Effect of a frame on the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// A wheel is commanded to turn.
    Drives,
    /// Each wheel is commanded to stop, or stops by itself.
    Stops,
    /// The target of each wheel has decreased by a tenth since [`Can::mark`].
    Slows,
}

/// Part of its former target at which a wheel counts as slower: one that is commanded to stand slows down on a ramp.
const SLOWER: f64 = 0.9;

/// Listener with its thread.
pub struct Can {
    pub signs: Receiver<(Instant, Sign)>,
    marked: Arc<AtomicBool>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Can {
    /// Listens to the bus of this port, with these drives of the wheels.
    pub fn listen(port: u16, drives: Vec<Drive>) -> Self {
        let socket = open(port);
        let (send, signs) = channel();
        let [marked, end] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
        let (mark, ended) = (marked.clone(), end.clone());
        let thread = Some(std::thread::spawn(move || forward(&socket, &drives, &send, &mark, &ended)));
        Self { signs, marked, end, thread }
    }

    /// Compares the targets with the present ones from the next frame on.
    pub fn mark(&self) {
        self.marked.store(true, Ordering::Relaxed);
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

fn forward(can: &UdpSocket, drives: &[Drive], signs: &Sender<(Instant, Sign)>, mark: &AtomicBool, end: &AtomicBool) {
    let (mut moves, mut targets) = (vec![false; drives.len()], vec![0.0; drives.len()]);
    let mut before: Option<Vec<f64>> = None;
    let mut datagram = [0; 512];
    while !end.load(Ordering::Relaxed) {
        let Ok(length) = can.recv(&mut datagram) else { continue };
        let now = Instant::now();
        let Ok(frame) = can_udp_codec::decode(&datagram[..length]) else { continue };
        let Id::Standard(id) = frame.id() else { continue };
        if mark.swap(false, Ordering::Relaxed) {
            before = Some(targets.clone());
        }
        let found = drives.iter().enumerate().find_map(|(wheel, drive)| Some((wheel, drive.turns(id, frame.data())?)));
        let Some((wheel, now_moves)) = found else { continue };
        moves[wheel] = now_moves;
        let commanded = drives[wheel].commanded(frame.data()).filter(|_| now_moves);
        targets[wheel] = commanded.map_or(0.0, |(_, target): (u8, f64)| target.abs());
        if now_moves || !moves.contains(&true) {
            let _ = signs.send((now, if now_moves { Sign::Drives } else { Sign::Stops }));
        }
        let slower = |before: &mut Vec<f64>| before.iter().zip(&targets).all(|(before, now)| *now <= SLOWER * before);
        if before.take_if(slower).is_some() {
            let _ = signs.send((now, Sign::Slows));
        }
    }
}
