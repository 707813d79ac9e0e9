//! System calls without a safe wrapper.
#![allow(unsafe_code)]

use super::limits::PreparedLimits;
use nix::errno::Errno;
use nix::libc;
use nix::sys::epoll::{Epoll, EpollEvent};
use nix::sys::stat::{fstat, major};
use std::fmt;
use std::io;
use std::mem;
use std::os::fd::{AsRawFd, BorrowedFd, FromRawFd, OwnedFd};
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::ptr;
use std::time::Duration;

/// Major numbers of the ends of pseudo-terminals that look like serial ports (`linux/major.h`).
const PSEUDO_TERMINALS: std::ops::RangeInclusive<u64> = 136..=143;

/// Locks a terminal against being opened by others until it is closed. `TIOCEXCL` does not stop root, so an advisory
/// lock is taken too; `WouldBlock` if another process holds it. A pseudo-terminal gets the advisory lock alone:
/// `TIOCEXCL` outlives its last close for as long as the other end is open, and then only root could open it again.
pub fn take_exclusively(terminal: BorrowedFd<'_>) -> io::Result<()> {
    // SAFETY: plain numbers; the descriptor is open for as long as it is borrowed.
    check(unsafe { libc::flock(terminal.as_raw_fd(), libc::LOCK_EX | libc::LOCK_NB) })?;
    if is_pseudo_terminal(terminal) {
        return Ok(());
    }
    // SAFETY: TIOCEXCL takes no argument; the descriptor is open for as long as it is borrowed.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), libc::TIOCEXCL) })
}

/// True if only root can open this terminal now: `TIOCEXCL` is in force.
#[cfg(test)]
pub fn is_for_root_alone(terminal: BorrowedFd<'_>) -> io::Result<bool> {
    let mut exclusive: libc::c_int = 0;
    // SAFETY: the kernel fills a live int.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), libc::TIOCGEXCL, &raw mut exclusive) })?;
    Ok(exclusive != 0)
}

/// True for the end of a pseudo-terminal that looks like a serial port.
pub fn is_pseudo_terminal(terminal: BorrowedFd<'_>) -> bool {
    fstat(terminal).is_ok_and(|state| PSEUDO_TERMINALS.contains(&major(state.st_rdev)))
}

/// Ends the process now with this code: nothing of its memory is used any more, no destructor and no handler runs.
pub fn exit_now(code: u8) -> ! {
    // SAFETY: a plain number; the call does not return.
    unsafe { libc::_exit(libc::c_int::from(code)) }
}

/// Number of columns of a terminal; `None` if it is not a terminal.
pub fn columns(terminal: BorrowedFd<'_>) -> Option<usize> {
    // SAFETY: all zeros is a valid winsize.
    let mut size: libc::winsize = unsafe { mem::zeroed() };
    // SAFETY: the kernel fills a live winsize.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), libc::TIOCGWINSZ, &raw mut size) }).ok()?;
    (size.ws_col > 0).then_some(usize::from(size.ws_col))
}

/// Mark and space parity (`asm/termbits.h`; the same on every architecture that the robot is built for).
pub const CMSPAR: libc::tcflag_t = 0o10_000_000_000;

/// Settings of a terminal, speeds in Bd; of the terminal itself rather than the device that it may lead to.
pub fn line_settings(terminal: BorrowedFd<'_>) -> io::Result<libc::termios2> {
    // SAFETY: all zeros is a valid termios2.
    let mut settings: libc::termios2 = unsafe { mem::zeroed() };
    // SAFETY: the kernel fills a live termios2.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), libc::TCGETS2, &raw mut settings) })?;
    Ok(settings)
}

/// Changes the settings; with `drain` once all written data has left, which it waits for. Success does not mean that
/// all settings are in effect: drivers drop silently what they do not support, so read them back.
pub fn set_line_settings(terminal: BorrowedFd<'_>, settings: &libc::termios2, drain: bool) -> io::Result<()> {
    let request = if drain { libc::TCSETSW2 } else { libc::TCSETS2 };
    // SAFETY: the kernel reads a live termios2.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), request, &raw const *settings) })
}

/// Number of bytes written but not yet handed to the device by the driver.
pub fn line_waiting(terminal: BorrowedFd<'_>) -> io::Result<usize> {
    let mut waiting: libc::c_int = 0;
    // SAFETY: the kernel fills a live int.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), libc::TIOCOUTQ, &raw mut waiting) })?;
    Ok(usize::try_from(waiting).unwrap_or(0))
}

/// True if all written data has left the wire, including the shift register; `None` if the driver cannot report it.
pub fn line_has_sent(terminal: BorrowedFd<'_>) -> io::Result<Option<bool>> {
    /// `TIOCSERGETLSR` and its result (asm-generic/ioctls.h, asm-generic/termios.h), which libc lacks.
    const TIOCSERGETLSR: libc::Ioctl = 0x5459;
    const TIOCSER_TEMT: libc::c_int = 1;
    let mut status: libc::c_int = 0;
    // Some drivers report the state of the device only.
    let waiting = line_waiting(terminal)?;
    // SAFETY: the kernel fills a live int.
    match check(unsafe { libc::ioctl(terminal.as_raw_fd(), TIOCSERGETLSR, &raw mut status) }) {
        Ok(()) => Ok(Some(waiting == 0 && status & TIOCSER_TEMT != 0)),
        Err(error) if matches!(error.raw_os_error(), Some(libc::ENOTTY | libc::EINVAL)) => Ok(None),
        Err(error) => Err(error),
    }
}

/// `struct serial_struct` (linux/serial.h).
#[repr(C)]
struct SerialStruct {
    kind: libc::c_int,
    line: libc::c_int,
    port: libc::c_uint,
    irq: libc::c_int,
    flags: libc::c_int,
    xmit_fifo_size: libc::c_int,
    custom_divisor: libc::c_int,
    baud_base: libc::c_int,
    close_delay: libc::c_ushort,
    io_type: libc::c_char,
    reserved_char: [libc::c_char; 1],
    hub6: libc::c_int,
    closing_wait: libc::c_ushort,
    closing_wait2: libc::c_ushort,
    iomem_base: *mut libc::c_uchar,
    iomem_reg_shift: libc::c_ushort,
    port_high: libc::c_uint,
    iomap_base: libc::c_ulong,
}

/// Requests that the driver delivers received bytes immediately (`ASYNC_LOW_LATENCY`).
pub fn set_low_latency(terminal: BorrowedFd<'_>) -> io::Result<()> {
    const ASYNC_LOW_LATENCY: libc::c_int = 1 << 13;
    // SAFETY: all zeros is a valid serial_struct.
    let mut serial: SerialStruct = unsafe { mem::zeroed() };
    // SAFETY: the kernel fills a live serial_struct.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), libc::TIOCGSERIAL, &raw mut serial) })?;
    serial.flags |= ASYNC_LOW_LATENCY;
    // SAFETY: the kernel reads a live serial_struct, which it filled itself.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), libc::TIOCSSERIAL, &raw const serial) })
}

/// Lowers DTR: the data terminal is not ready.
pub fn lower_dtr(terminal: BorrowedFd<'_>) -> io::Result<()> {
    let lines: libc::c_int = libc::TIOCM_DTR;
    // SAFETY: the kernel reads a live int.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), libc::TIOCMBIC, &raw const lines) })
}

/// `struct serial_rs485` (linux/serial.h): control of the transceiver's direction.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rs485Direction {
    /// Bit 0: enabled; 1: RTS high while sending; 2: RTS high after sending; 4: receive while sending.
    pub flags: u32,
    /// Delay from RTS to the first start bit, ms.
    pub delay_before_ms: u32,
    /// Delay from the last stop bit to RTS, ms.
    pub delay_after_ms: u32,
    padding: [u32; 5],
}

impl Rs485Direction {
    /// Flags and delays.
    #[must_use]
    pub const fn new(flags: u32, delay_before_ms: u32, delay_after_ms: u32) -> Self {
        Self { flags, delay_before_ms, delay_after_ms, padding: [0; 5] }
    }
}

impl fmt::Display for Rs485Direction {
    /// Displayed as its keys in `robot.toml`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is = |bit: u32| self.flags >> bit & 1 == 1;
        if !is(0) {
            return f.write_str("none");
        }
        let (on, after) = (is(1), is(2));
        let (before_ms, after_ms) = (self.delay_before_ms, self.delay_after_ms);
        write!(f, "rts_on_send = {on}, rts_after_send = {after}, delays {before_ms} and {after_ms} ms")
    }
}

/// Enables the driver's direction control of an EIA-485 line; returns the settings in effect.
pub fn set_rs485_direction(terminal: BorrowedFd<'_>, direction: Rs485Direction) -> io::Result<Rs485Direction> {
    let mut direction = direction;
    // SAFETY: the kernel reads and fills a live serial_rs485.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), libc::TIOCSRS485, &raw mut direction) })?;
    // SAFETY: the kernel fills a live serial_rs485.
    check(unsafe { libc::ioctl(terminal.as_raw_fd(), libc::TIOCGRS485, &raw mut direction) })?;
    Ok(direction)
}

/// Lets the kernel kill the command's process when the calling thread ends; it starts with no signal blocked.
pub fn die_with_parent(command: &mut Command) {
    let parent = nix::unistd::getpid();
    let prepare = move || {
        nix::sys::prctl::set_pdeathsig(nix::sys::signal::Signal::SIGKILL)?;
        // If the parent ended before the line above, no signal will come.
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

/// Prepares a command whose process outlives this one, starts with no signal blocked, and has these limits. Limits
/// that the machine refuses are reported through the birth's pipe; the process starts without them.
///
/// With `subreaper`, our parent and a subreaper, the process becomes its child and is killed when it ends. `spawn` then
/// returns an intermediate process that has ended already; the birth's pipe reports the id of the real one.
pub fn give_limits(command: &mut Command, limits: PreparedLimits, subreaper: Option<nix::unistd::Pid>) {
    let parent = nix::unistd::getpid();
    let prepare = move || {
        nix::sys::signal::SigSet::empty().thread_set_mask()?;
        if let Some(subreaper) = subreaper {
            move_to(subreaper, &limits)?;
        }
        limits.apply();
        // No process would know it and be able to end it.
        if nix::unistd::getppid() != subreaper.unwrap_or(parent) {
            return Err(io::ErrorKind::NotFound.into());
        }
        Ok(())
    };
    // SAFETY: between fork and exec only system calls are made, on what was prepared before. Nothing allocates: the
    // errors are plain numbers.
    unsafe { command.pre_exec(prepare) };
}

/// Continues in a child with its own process group, which the kernel gives to the next subreaper when the intermediate
/// process ends.
fn move_to(subreaper: nix::unistd::Pid, limits: &PreparedLimits) -> io::Result<()> {
    // SAFETY: the caller is the only thread of a process that was just forked, and makes system calls only.
    match unsafe { libc::fork() } {
        -1 => return Err(io::Error::last_os_error()),
        0 => {}
        // SAFETY: ends this process without running anything of ours.
        _ => unsafe { libc::_exit(0) },
    }
    nix::unistd::setpgid(nix::unistd::Pid::from_raw(0), nix::unistd::Pid::from_raw(0))?;
    limits.report_pid();
    let between = nix::unistd::getppid();
    while nix::unistd::getppid() == between && between != subreaper {
        // SAFETY: takes and returns plain numbers.
        unsafe { libc::sched_yield() };
    }
    Ok(nix::sys::prctl::set_pdeathsig(nix::sys::signal::Signal::SIGKILL)?)
}

/// Reduces the ambient capabilities of the calling thread (capabilities(7)) to `kept`, by their numbers. A program of
/// an ordinary user has no others. System calls only.
pub fn keep_capabilities(kept: &[u8]) -> io::Result<()> {
    for number in 0..=libc::c_ulong::from(CAPABILITY_MAX) {
        let ambient = |what: libc::c_int, number: libc::c_ulong| {
            // SAFETY: plain numbers.
            unsafe {
                libc::prctl(libc::PR_CAP_AMBIENT, what as libc::c_ulong, number, 0 as libc::c_ulong, 0 as libc::c_ulong)
            }
        };
        let is_kept = kept.iter().any(|own| libc::c_ulong::from(*own) == number);
        if ambient(libc::PR_CAP_AMBIENT_IS_SET, number) == 1 && !is_kept {
            check(ambient(libc::PR_CAP_AMBIENT_LOWER, number))?;
        }
    }
    Ok(())
}

/// `CAP_NET_ADMIN` (linux/capability.h).
pub const CAP_NET_ADMIN: u8 = 12;
/// Greatest number that a kernel may know: they have 64 bits.
const CAPABILITY_MAX: u8 = 63;

/// Makes a capability of the calling thread ambient, for a test; only root may.
#[cfg(test)]
pub fn add_capability(number: u8) -> io::Result<()> {
    // struct __user_cap_header_struct and two of struct __user_cap_data_struct (linux/capability.h): effective,
    // permitted, inheritable.
    let header: [u32; 2] = [0x2008_0522, 0];
    let mut data = [0u32; 6];
    // SAFETY: the kernel reads the live header and fills the live data of this version's size.
    check(unsafe { libc::syscall(libc::SYS_capget, header.as_ptr(), data.as_mut_ptr()) } as libc::c_int)?;
    data[2] |= 1 << number;
    // SAFETY: the kernel reads both.
    check(unsafe { libc::syscall(libc::SYS_capset, header.as_ptr(), data.as_ptr()) } as libc::c_int)?;
    let [raise, none] = [libc::PR_CAP_AMBIENT_RAISE as libc::c_ulong, 0];
    // SAFETY: plain numbers.
    check(unsafe { libc::prctl(libc::PR_CAP_AMBIENT, raise, libc::c_ulong::from(number), none, none) })
}

/// Nice value of the calling process, from -20 (served most) to 19 (least).
pub fn set_nice(nice: i8) -> io::Result<()> {
    // SAFETY: plain numbers.
    check(unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, libc::c_int::from(nice)) })
}

/// Sets `SCHED_FIFO` for the calling thread, priority 1 to 99; with `alone`, processes that it starts do not inherit
/// it.
pub fn set_fifo(priority: u8, alone: bool) -> io::Result<()> {
    let parameter = libc::sched_param { sched_priority: libc::c_int::from(priority) };
    let policy = libc::SCHED_FIFO | if alone { libc::SCHED_RESET_ON_FORK } else { 0 };
    // SAFETY: the kernel reads a live sched_param.
    check(unsafe { libc::sched_setscheduler(0, policy, &raw const parameter) })
}

/// True if the calling thread has a real-time priority.
#[must_use]
pub fn is_fifo() -> bool {
    // SAFETY: plain numbers.
    unsafe { libc::sched_getscheduler(0) & !libc::SCHED_RESET_ON_FORK == libc::SCHED_FIFO }
}

/// Descriptor that becomes readable when the process ends, whatever its parent (Linux 5.3).
pub fn pidfd_open(pid: u32) -> io::Result<OwnedFd> {
    // SAFETY: plain numbers in, a new descriptor or -1 out.
    let fd = unsafe { libc::syscall(libc::SYS_pidfd_open, pid as libc::pid_t, 0) } as libc::c_int;
    check(fd)?;
    // SAFETY: `fd` was just opened and belongs to nobody else. The kernel closes it at exec.
    Ok(unsafe { OwnedFd::from_raw_fd(fd) })
}

/// Sends a signal to the process of a pidfd, which cannot refer to another process in the meantime (Linux 5.1).
///
/// # Errors
/// The process has ended and was reaped, or may not be signalled.
pub fn pidfd_send_signal(process: BorrowedFd<'_>, signal: nix::sys::signal::Signal) -> io::Result<()> {
    let no_info = ptr::null::<libc::siginfo_t>();
    // SAFETY: plain numbers; without siginfo the kernel reads nothing. The descriptor is open for as long as it is
    // borrowed.
    let sent =
        unsafe { libc::syscall(libc::SYS_pidfd_send_signal, process.as_raw_fd(), signal as libc::c_int, no_info, 0) };
    check(sent as libc::c_int)
}

/// Sets the timeout of a hardware watchdog, s; returns the timeout in effect (linux/watchdog.h).
pub fn set_watchdog_timeout(device: BorrowedFd<'_>, seconds: u32) -> io::Result<u32> {
    const WDIOC_SETTIMEOUT: libc::Ioctl =
        nix::request_code_readwrite!(b'W', 6, size_of::<libc::c_int>()) as libc::Ioctl;
    let mut timeout = seconds as libc::c_int;
    // SAFETY: the kernel reads and fills a live int.
    check(unsafe { libc::ioctl(device.as_raw_fd(), WDIOC_SETTIMEOUT, &raw mut timeout) })?;
    Ok(timeout.unsigned_abs())
}

/// Query of an event device that fills a buffer of any length below 16 KiB (`EVIOCG…`, linux/input.h).
pub fn event_query(device: BorrowedFd<'_>, number: u8, answer: &mut [u8]) -> io::Result<()> {
    let request = nix::request_code_read!(b'E', number, answer.len()) as libc::Ioctl;
    // SAFETY: the request carries the buffer's length, and the kernel fills no more of it; the buffer is live.
    check(unsafe { libc::ioctl(device.as_raw_fd(), request, answer.as_mut_ptr()) })
}

/// Grabs an event device exclusively until it is closed.
pub fn grab_events(device: BorrowedFd<'_>) -> io::Result<()> {
    const EVIOCGRAB: libc::Ioctl = nix::request_code_write!(b'E', 0x90, size_of::<libc::c_int>()) as libc::Ioctl;
    // SAFETY: takes a plain number.
    check(unsafe { libc::ioctl(device.as_raw_fd(), EVIOCGRAB, 1 as libc::c_int) })
}

/// Raw CAN socket on the interface with this index: non-blocking, with error frames of the classes `errors`
/// (linux/can/error.h), frames with 29-bit identifiers only if `extended`, and a send buffer of a few frames only, so
/// that none gets old in it.
pub fn open_can(index: u32, errors: u32, extended: bool) -> io::Result<OwnedFd> {
    let flags = libc::SOCK_RAW | libc::SOCK_NONBLOCK | libc::SOCK_CLOEXEC;
    // SAFETY: plain numbers in, a new descriptor or -1 out.
    let fd = unsafe { libc::socket(libc::AF_CAN, flags, libc::CAN_RAW) };
    check(fd)?;
    // SAFETY: `fd` was just opened and belongs to nobody else.
    let socket = unsafe { OwnedFd::from_raw_fd(fd) };
    set_option(&socket, libc::SOL_CAN_RAW, libc::CAN_RAW_ERR_FILTER, &errors)?;
    if !extended {
        let short = libc::can_filter { can_id: 0, can_mask: libc::CAN_EFF_FLAG };
        set_option(&socket, libc::SOL_CAN_RAW, libc::CAN_RAW_FILTER, &short)?;
    }
    // The kernel's minimum is SOCK_MIN_SNDBUF, room for six frames.
    set_option(&socket, libc::SOL_SOCKET, libc::SO_SNDBUF, &(0 as libc::c_int))?;
    // SAFETY: all zeros is a valid sockaddr_can.
    let mut address: libc::sockaddr_can = unsafe { mem::zeroed() };
    address.can_family = libc::AF_CAN as libc::sa_family_t;
    address.can_ifindex = index as libc::c_int;
    let length = mem::size_of_val(&address) as libc::socklen_t;
    // SAFETY: the address is a live sockaddr_can of the length given.
    check(unsafe { libc::bind(socket.as_raw_fd(), (&raw const address).cast(), length) })?;
    Ok(socket)
}

/// `struct __kernel_timespec` (linux/time_types.h): 64 bits on every architecture.
#[repr(C)]
struct KernelTimespec {
    seconds: i64,
    nanoseconds: i64,
}

/// Waits for events, at most for `limit` with nanosecond resolution (Linux 5.11); without a limit indefinitely.
pub fn epoll_wait_exactly(epoll: &Epoll, ready: &mut [EpollEvent], limit: Option<Duration>) -> nix::Result<usize> {
    let limit = limit.map(|limit| KernelTimespec {
        seconds: i64::try_from(limit.as_secs()).unwrap_or(i64::MAX),
        nanoseconds: limit.subsec_nanos().into(),
    });
    let limit = limit.as_ref().map_or(ptr::null(), ptr::from_ref);
    let room = libc::c_int::try_from(ready.len()).unwrap_or(libc::c_int::MAX);
    // SAFETY: the kernel fills at most `room` live epoll_events, which is what EpollEvent is, and reads a live timespec
    // or none; no signal mask is given. The descriptor is open for as long as it is borrowed.
    let count = unsafe {
        libc::syscall(
            libc::SYS_epoll_pwait2,
            epoll.0.as_raw_fd(),
            ready.as_mut_ptr(),
            room,
            limit,
            ptr::null::<libc::sigset_t>(),
            0_usize,
        )
    };
    Errno::result(count).map(|count| count as usize)
}

/// State of the kernel's clock as disciplined by NTP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockState {
    /// True if it is being synchronized.
    pub synchronized: bool,
    /// Estimated maximum error, µs.
    pub error_us: i64,
}

/// Reads the clock's state without changing it.
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
