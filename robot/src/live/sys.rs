//! The few system calls that have no safe wrapper.
#![allow(unsafe_code)]

use nix::libc;
use std::io;
use std::mem;
use std::os::fd::{AsRawFd, BorrowedFd, FromRawFd, OwnedFd};
use std::os::unix::process::CommandExt;
use std::process::Command;

/// Lets no one else open this terminal until it is closed.
pub fn take_exclusively(terminal: BorrowedFd<'_>) -> io::Result<()> {
    // SAFETY: TIOCEXCL takes no argument; the descriptor is open for as long as it is borrowed.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), libc::TIOCEXCL) })
}

/// Makes the command's process one that is killed when the calling thread ends, and that starts with no signal
/// blocked.
pub fn die_with_parent(command: &mut Command) {
    let parent = nix::unistd::getpid();
    let prepare = move || {
        nix::sys::prctl::set_pdeathsig(nix::sys::signal::Signal::SIGKILL)?;
        // A parent that ended before the line above will send nothing.
        if nix::unistd::getppid() != parent {
            return Err(io::ErrorKind::NotFound.into());
        }
        nix::sys::signal::SigSet::empty().thread_set_mask()?;
        Ok(())
    };
    // SAFETY: between fork and exec only system calls are made: prctl, getppid, sigprocmask. Nothing allocates: the
    // errors are plain numbers.
    unsafe { command.pre_exec(prepare) };
}

/// A raw CAN socket on an interface: non-blocking, frames of the error classes `errors` delivered (linux/can/error.h),
/// and a send buffer that holds a few frames only, so that none of them gets old in it.
pub fn open_can(interface: &str, errors: u32) -> io::Result<OwnedFd> {
    let flags = libc::SOCK_RAW | libc::SOCK_NONBLOCK | libc::SOCK_CLOEXEC;
    // SAFETY: plain numbers in, a new descriptor or -1 out.
    let fd = unsafe { libc::socket(libc::AF_CAN, flags, libc::CAN_RAW) };
    check(fd)?;
    // SAFETY: `fd` was just opened and belongs to nobody else.
    let socket = unsafe { OwnedFd::from_raw_fd(fd) };
    set_option(&socket, libc::SOL_CAN_RAW, libc::CAN_RAW_ERR_FILTER, &errors)?;
    // The kernel takes no less than SOCK_MIN_SNDBUF, room for six frames.
    set_option(&socket, libc::SOL_SOCKET, libc::SO_SNDBUF, &(0 as libc::c_int))?;
    let index = nix::net::if_::if_nametoindex(interface)?;
    // SAFETY: all zeros is a valid sockaddr_can.
    let mut address: libc::sockaddr_can = unsafe { mem::zeroed() };
    address.can_family = libc::AF_CAN as libc::sa_family_t;
    address.can_ifindex = index as libc::c_int;
    let length = mem::size_of_val(&address) as libc::socklen_t;
    // SAFETY: the address is a live sockaddr_can of the length given.
    check(unsafe { libc::bind(socket.as_raw_fd(), (&raw const address).cast(), length) })?;
    Ok(socket)
}

/// The kernel's clock as NTP disciplines it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockState {
    /// Whether someone keeps it right.
    pub synchronized: bool,
    /// How wrong it may be at most, µs.
    pub error_us: i64,
}

/// Reads the clock's state; changes nothing.
pub fn clock_state() -> io::Result<ClockState> {
    // SAFETY: all zeros is a valid timex, and asks for no change.
    let mut timex: libc::timex = unsafe { mem::zeroed() };
    // SAFETY: the kernel fills a live timex.
    let state = unsafe { libc::adjtimex(&raw mut timex) };
    check(state)?;
    Ok(ClockState { synchronized: state != libc::TIME_ERROR, error_us: timex.maxerror as i64 })
}

fn set_option<T>(socket: &OwnedFd, level: libc::c_int, name: libc::c_int, value: &T) -> io::Result<()> {
    let length = mem::size_of::<T>() as libc::socklen_t;
    // SAFETY: `value` is live and of the length given; the kernel only reads it.
    check(unsafe { libc::setsockopt(socket.as_raw_fd(), level, name, (&raw const *value).cast(), length) })
}

fn check(result: libc::c_int) -> io::Result<()> {
    if result < 0 { Err(io::Error::last_os_error()) } else { Ok(()) }
}
