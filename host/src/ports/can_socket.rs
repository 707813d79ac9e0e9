//! A CAN interface of the kernel (SocketCAN), through a raw socket.

mod frame;
mod link;
#[cfg(test)]
mod tests;

use super::queue::Queue;
use super::restart::Restart;
use super::{Device, Lost, Received};
use crate::{clock, sys};
use base::can::{BusState, Frame, Health, Notice};
use base::{Duration, Fault, Instant};
use frame::{FRAME, KernelFrame, decode, encode};
use link::Link;
use module::{Input, Line, Output};
use nix::cmsg_space;
use nix::errno::Errno;
use nix::sys::socket::{ControlMessageOwned, MsgFlags, getsockopt, recvmsg, setsockopt, sockopt};
use nix::sys::time::TimeSpec;
use nix::unistd::write;
use std::collections::VecDeque;
use std::io::{self, ErrorKind, IoSliceMut};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::{fs, mem};

/// A frame of the kernel with its receive time, ns of the wall clock.
type Stamped = ([u8; FRAME], Option<u64>);

/// Receive buffer, bytes, if the kernel permits: some thousand frames.
const RECEIVE_BUFFER: usize = 1 << 20;
/// Minimum interval between reports of errors on the wire, and of missing acknowledgements.
const REPORT_INTERVAL: Duration = Duration::from_millis(100);
/// Length of the transmit queue beyond which frames of other programs delay ours by milliseconds.
const QUEUE_LONG: u32 = 100;

/// CAN interface.
pub struct CanSocket {
    interface: String,
    /// Bit rate of the bus, bit/s, if configured.
    bitrate: Option<u32>,
    /// True if frames with 29-bit identifiers are wanted, which CANopen does not use.
    extended: bool,
    socket: Option<OwnedFd>,
    control: Vec<u8>,
    /// The kernel's count of frames lost to a full receive buffer as of the last frame, and the number of them not
    /// reported yet.
    dropped: u32,
    untold: u32,
    /// Results to deliver before the socket is read again.
    pending: VecDeque<Pending>,
    /// Number of unreported errors on the wire, and the earliest time of the next report.
    errors: u32,
    quiet: Instant,
    queue: Queue,
    restart: Restart,
}

/// Pending result of a read.
enum Pending {
    Notice(Notice),
    Note(String),
    Fault(String),
    Frame { frame: Frame, at: Instant, stamp: Option<u64> },
    Off,
}

/// Result of writing a frame.
#[derive(PartialEq)]
enum Written {
    Yes,
    /// The socket must become writable first.
    NotYet,
    Never,
}

impl CanSocket {
    /// Creates the port of a network interface, `can0`.
    pub fn new(interface: String) -> Self {
        Self {
            interface,
            bitrate: None,
            extended: true,
            socket: None,
            control: cmsg_space!(u32, TimeSpec),
            dropped: 0,
            untold: 0,
            pending: VecDeque::new(),
            errors: 0,
            quiet: Instant::ZERO,
            queue: Queue::default(),
            restart: Restart::default(),
        }
    }

    fn lost(&self, errno: Errno) -> Lost {
        let interface = &self.interface;
        match errno {
            Errno::EAFNOSUPPORT => format!("{interface}: this kernel has no CAN"),
            Errno::ENODEV | Errno::ENXIO => format!("{interface}: there is no such interface"),
            Errno::ENETDOWN => format!("{interface}: the interface is down (ip link set {interface} up)"),
            errno => format!("{interface}: {}", errno.desc()),
        }
    }

    /// Checks that frames sent now will leave now. A socket can be opened on an interface that is down, but has an
    /// error pending; an interface that is bus-off keeps frames for later or drops them silently.
    fn check(&self, socket: &impl AsFd) -> Result<(), Lost> {
        match getsockopt(socket, sockopt::SocketError).map_err(|errno| self.lost(errno))? {
            0 => {}
            pending => return Err(self.lost(Errno::from_raw(pending))),
        }
        let interface = &self.interface;
        match fs::read(format!("/sys/class/net/{interface}/carrier")) {
            Ok(carrier) if carrier.starts_with(b"0") => {
                Err(format!("{interface}: no carrier: bus-off (ip link set {interface} type can restart)"))
            }
            // Unknown without sysfs.
            _ => Ok(()),
        }
    }

    /// Queries the kernel about the interface; empty if unavailable.
    fn ask(&self) -> Link {
        Link::ask(&self.interface).unwrap_or_default()
    }

    /// Restarts a controller that is bus-off if that is due; returns the reason why it is still off.
    fn restart_controller(&mut self, now: Instant, link: &Link) -> Result<(), Lost> {
        let interface = &self.interface;
        if link.health.is_none_or(|health| health.state != BusState::Off) {
            return Ok(());
        }
        if let Some(pause) = link.restart_ms.filter(|pause| *pause > 0) {
            return Err(format!("{interface}: bus-off; the kernel restarts it after {pause} ms (restart-ms)"));
        }
        if !self.restart.is_due(now) {
            return Err(format!("{interface}: bus-off"));
        }
        match link::restart(interface) {
            // Opened at the next attempt, with the state reported then.
            Ok(()) => Err(format!("{interface}: bus-off")),
            Err(error) => Err(match error.kind() {
                ErrorKind::PermissionDenied => format!(
                    "{interface}: bus-off, and restarting it needs CAP_NET_ADMIN (ip link set {interface} type can \
                     restart)"
                ),
                _ => format!(
                    "{interface}: bus-off, and its driver does not restart it ({error}): ip link set {interface} \
                     down, and up"
                ),
            }),
        }
    }

    /// Checks that the interface runs at the bit rate of the bus: a different rate destroys the frames of the other
    /// nodes.
    fn check_bitrate(&self, link: &Link) -> Result<(), Lost> {
        match (self.bitrate, link.bitrate) {
            // 1 % tolerance for the clock divider of a controller.
            (Some(wanted), Some(rate)) if rate.abs_diff(wanted) > wanted / 100 => Err(format!(
                "{0}: runs at {rate} bit/s, the bus is configured for {wanted} (ip link set {0} down; \
                 ip link set {0} type can bitrate {wanted}; ip link set {0} up)",
                self.interface
            )),
            _ => Ok(()),
        }
    }

    /// Reads a frame of the kernel and its receive time, nanoseconds of the wall clock, if available.
    fn read(&mut self) -> Result<Option<Stamped>, Lost> {
        let Some(socket) = &self.socket else {
            return Ok(None);
        };
        let mut raw = [0; FRAME];
        let mut parts = [IoSliceMut::new(&mut raw)];
        let message = loop {
            match recvmsg::<()>(socket.as_raw_fd(), &mut parts, Some(&mut self.control), MsgFlags::empty()) {
                Ok(message) => break message,
                Err(Errno::EAGAIN) => return Ok(None),
                Err(Errno::EINTR) => {}
                Err(errno) => return Err(self.lost(errno)),
            }
        };
        let mut stamp = None;
        for control in message.cmsgs().map_err(Errno::desc)? {
            match control {
                ControlMessageOwned::RxqOvfl(count) => {
                    self.untold =
                        self.untold.saturating_add(count.wrapping_sub(mem::replace(&mut self.dropped, count)));
                }
                ControlMessageOwned::ScmTimestampns(time) => {
                    stamp = Some(time.tv_sec() as u64 * 1_000_000_000 + time.tv_nsec() as u64);
                }
                _ => {}
            }
        }
        match message.bytes {
            FRAME => Ok(Some((raw, stamp))),
            _ => Err(format!("{}: frames of invalid length", self.interface)),
        }
    }

    /// Processes a frame of the kernel, which may yield more than one result.
    fn take(&mut self, now: Instant, came: KernelFrame, stamp: Option<u64>) {
        let count = mem::take(&mut self.untold);
        if count > 0 {
            let what = format!("{}: the receive buffer overflowed: {count} frames are lost", self.interface);
            self.pending.extend([Pending::Fault(what), Pending::Notice(Notice::Lost(count))]);
        }
        match came {
            KernelFrame::Frame(frame) => {
                self.report_errors(now);
                let at = stamp.map_or(now, |stamp| clock::received(now, stamp));
                self.pending.push_back(Pending::Frame { frame, at, stamp });
            }
            KernelFrame::Error(error) => {
                self.errors = self.errors.saturating_add(u32::from(error.on_the_wire));
                if error.lost {
                    self.pending.push_back(Pending::Fault("the controller's receive buffer overflowed".into()));
                }
                self.pending.extend(error.note.map(|note| Pending::Note(note.into())));
                let again = now >= self.quiet;
                let told = |notice: &Notice| again || *notice != Notice::NoAcknowledge;
                self.pending.extend(error.notices().filter(told).map(Pending::Notice));
                if error.no_acknowledge && again {
                    self.quiet = now + REPORT_INTERVAL;
                }
                self.report_errors(now);
                if error.is_off() {
                    self.pending.push_back(Pending::Off);
                }
            }
        }
    }

    fn report_errors(&mut self, now: Instant) {
        if self.errors > 0 && now >= self.quiet {
            self.quiet = now + REPORT_INTERVAL;
            self.pending.push_back(Pending::Notice(Notice::Errors(mem::take(&mut self.errors))));
        }
    }

    fn write(&self, frame: &Frame) -> Result<Written, Lost> {
        let Some(socket) = &self.socket else {
            return Ok(Written::Never);
        };
        match write(socket, &encode(frame)) {
            Ok(_) => Ok(Written::Yes),
            Err(Errno::EAGAIN | Errno::EINTR) => Ok(Written::NotYet),
            // The interface's queue is full with frames of other programs: poll does not report when space is
            // available.
            Err(Errno::ENOBUFS) => Ok(Written::Never),
            Err(errno) => Err(self.lost(errno)),
        }
    }

    /// Drops pending frames that are too old. Then queries the reason, because few controllers report it by themselves.
    fn drop_old(&mut self, now: Instant) {
        if !self.queue.drop_old(now) || now < self.quiet {
            return;
        }
        self.quiet = now + REPORT_INTERVAL;
        if let Some(health) = self.ask().health {
            self.pending.push_back(Pending::Notice(Notice::Health(health)));
            // The only node on a bus becomes error-passive, and its counter stops at this value.
            if health.state == BusState::Passive && health.transmit_errors == 128 {
                self.pending.push_back(Pending::Notice(Notice::NoAcknowledge));
            }
        }
    }
}

impl Device for CanSocket {
    fn expect(&mut self, line: Line, everything: bool) {
        if let Line::Can { bitrate } = line {
            self.bitrate = Some(bitrate);
        }
        self.extended = everything;
    }

    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        let (now, link) = (clock::now(), self.ask());
        self.check_bitrate(&link)?;
        self.restart_controller(now, &link)?;
        let reason = |error: io::Error| match error.raw_os_error() {
            Some(errno) => self.lost(Errno::from_raw(errno)),
            None => format!("{}: {error}", self.interface),
        };
        let index = link::index(&self.interface).map_err(reason)?;
        let socket = sys::open_can(index, frame::ERRORS, self.extended).map_err(reason)?;
        self.check(&socket)?;
        setsockopt(&socket, sockopt::RxqOvfl, &1).map_err(|errno| self.lost(errno))?;
        setsockopt(&socket, sockopt::ReceiveTimestampns, &true).map_err(|errno| self.lost(errno))?;
        // Privileged processes get the requested size, others at most net.core.rmem_max.
        setsockopt(&socket, sockopt::RcvBufForce, &RECEIVE_BUFFER)
            .or_else(|_| setsockopt(&socket, sockopt::RcvBuf, &RECEIVE_BUFFER))
            .map_err(|errno| self.lost(errno))?;
        self.socket = Some(socket);
        self.restart.on(now);
        if let Some(length) = link.queue.filter(|length| *length > QUEUE_LONG) {
            let what = format!(
                "{length} frames of other programs may be queued before ours (ip link set {} txqueuelen 10)",
                self.interface
            );
            self.pending.push_back(Pending::Note(what));
        }
        let health = link.health.filter(|health| *health != Health::default());
        self.pending.extend(health.map(|health| Pending::Notice(Notice::Health(health))));
        Ok(())
    }

    fn close(&mut self) {
        (self.socket, self.dropped, self.untold, self.errors) = (None, 0, 0, 0);
        self.pending.clear();
        self.queue.clear();
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.socket.as_ref().map(AsFd::as_fd)
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        loop {
            match self.pending.pop_front() {
                Some(Pending::Frame { frame, at, stamp }) => {
                    return Ok(Received::Input { input: Input::Can { frame, at }, at, stamp });
                }
                Some(Pending::Notice(notice)) => return Ok(Received::input(now, Input::CanNotice(notice))),
                Some(Pending::Note(note)) => return Ok(Received::Note(note)),
                Some(Pending::Fault(what)) => return Ok(Received::Fault(Fault::PortOverrun, what)),
                // Reopened when the controller is back on the bus; until then nothing is sent that would be outdated by
                // then.
                Some(Pending::Off) => {
                    self.restart.off(now);
                    return Err(format!("{}: bus-off", self.interface));
                }
                None => {}
            }
            let Some((raw, stamp)) = self.read()? else {
                return Ok(Received::Nothing);
            };
            if let Some(came) = decode(&raw) {
                self.take(now, came, stamp);
            }
        }
    }

    fn send(&mut self, now: Instant, output: &Output) -> Result<bool, Lost> {
        let Output::Can(frame) = output else {
            return Ok(false);
        };
        self.drop_old(now);
        let written = if self.queue.is_empty() { self.write(frame)? } else { Written::NotYet };
        Ok(match written {
            Written::Yes => {
                self.queue.passed(now);
                true
            }
            Written::NotYet => self.queue.push(now, *frame),
            Written::Never => false,
        })
    }

    fn wants_to_write(&self) -> bool {
        !self.queue.is_empty()
    }

    fn on_writable(&mut self, now: Instant) -> Result<(), Lost> {
        self.drop_old(now);
        while let Some(frame) = self.queue.front()
            && self.write(frame)? == Written::Yes
        {
            self.queue.pop(now);
        }
        Ok(())
    }
}
