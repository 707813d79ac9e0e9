//! The socket options and the system call that have no safe wrapper.
#![allow(unsafe_code)]

use crate::filter::Instruction;
use nix::errno::Errno;
use nix::libc;
use std::mem;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::{AsRawFd, BorrowedFd};

/// True if this thread goes before all that have no real-time priority.
#[cfg(feature = "shm")]
pub fn is_real_time() -> bool {
    // SAFETY: it takes a number, and answers with one.
    let policy = unsafe { libc::sched_getscheduler(0) };
    policy >= 0 && matches!(policy & !libc::SCHED_RESET_ON_FORK, libc::SCHED_FIFO | libc::SCHED_RR)
}

/// Has the kernel run `program` on each datagram, instead of any program before.
pub fn attach_filter(fd: BorrowedFd<'_>, program: &[Instruction]) -> nix::Result<()> {
    let code = |&Instruction { code, jt, jf, k }: &Instruction| libc::sock_filter { code, jt, jf, k };
    let mut filter: Vec<libc::sock_filter> = program.iter().map(code).collect();
    let len = u16::try_from(filter.len()).map_err(|_| Errno::EINVAL)?;
    let program = libc::sock_fprog { len, filter: filter.as_mut_ptr() };
    // SAFETY: `program` points at `len` instructions, which live until the call returns; the kernel copies them.
    unsafe { set(fd, libc::SOL_SOCKET, libc::SO_ATTACH_FILTER, &program) }
}

/// Detaches the socket filter; no error if there is none.
pub fn detach_filter(fd: BorrowedFd<'_>) -> nix::Result<()> {
    // SAFETY: the option takes an int and does not look at it.
    match unsafe { set(fd, libc::SOL_SOCKET, libc::SO_DETACH_FILTER, &0_i32) } {
        Err(Errno::ENOENT) => Ok(()),
        result => result,
    }
}

/// Used and total size of the receive buffer, bytes, including the kernel's overhead.
pub fn receive_memory(fd: BorrowedFd<'_>) -> nix::Result<(u32, u32)> {
    // SAFETY: SO_MEMINFO fills an array of 32-bit numbers (linux/sock_diag.h: SK_MEMINFO_RMEM_ALLOC 0, RCVBUF 1).
    let [taken, size] = unsafe { get::<[u32; 2]>(fd, libc::SOL_SOCKET, libc::SO_MEMINFO) }?;
    Ok((taken, size))
}

/// Sends multicasts by the interface that has `address` now; 0.0.0.0: by the routing table.
pub fn set_multicast_interface(fd: BorrowedFd<'_>, address: Ipv4Addr) -> nix::Result<()> {
    let address = libc::in_addr { s_addr: u32::from_ne_bytes(address.octets()) };
    // SAFETY: the option takes an `in_addr`.
    unsafe { set(fd, libc::IPPROTO_IP, libc::IP_MULTICAST_IF, &address) }
}

/// The largest IP packet on the way to where the socket is connected to, in bytes.
pub fn path_mtu(fd: BorrowedFd<'_>) -> nix::Result<usize> {
    // SAFETY: IP_MTU is an int.
    let mtu = unsafe { get::<i32>(fd, libc::IPPROTO_IP, libc::IP_MTU) }?;
    usize::try_from(mtu).map_err(|_| Errno::EINVAL)
}

/// A datagram as the kernel handed it over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Datagram {
    /// Sender.
    pub from: SocketAddrV4,
    /// Bytes of it that are in the buffer.
    pub len: usize,
    /// Time when the kernel received it, ns since 1970; of a socket with SO_TIMESTAMPNS.
    pub at: Option<i64>,
    /// Number of datagrams that the kernel dropped before it, which wraps; of a socket with SO_RXQ_OVFL. `None`: zero,
    /// or not asked for.
    pub overflows: Option<u32>,
}

/// Sizes of the control messages of a datagram, in the kernel's order.
// SAFETY: these compute numbers from numbers.
const TIME_SPACE: usize = unsafe { libc::CMSG_SPACE(mem::size_of::<libc::timespec>() as u32) } as usize;
// SAFETY: as above.
const COUNT_SPACE: usize = unsafe { libc::CMSG_SPACE(mem::size_of::<u32>() as u32) } as usize;
/// Words of 64 bits that have room for both, aligned as they must be.
const CONTROL: usize = (TIME_SPACE + COUNT_SPACE).div_ceil(mem::size_of::<u64>());

/// The next datagram of a UDP socket of IPv4, with its receive time and, if `counts`, its count of drops. A count that
/// is not asked for costs nothing: the kernel finds no room for it, and leaves it out.
#[allow(clippy::unnecessary_cast, reason = "the types of lengths and times are not the same everywhere")]
pub fn receive(fd: BorrowedFd<'_>, buffer: &mut [u8], counts: bool, flags: i32) -> nix::Result<Datagram> {
    let mut part = libc::iovec { iov_base: buffer.as_mut_ptr().cast(), iov_len: buffer.len() };
    // SAFETY: both are numbers and pointers, for which zeroes are valid.
    let (mut name, mut head) = unsafe { (mem::zeroed::<libc::sockaddr_in>(), mem::zeroed::<libc::msghdr>()) };
    let mut control = [0_u64; CONTROL];
    head.msg_name = (&raw mut name).cast();
    head.msg_namelen = mem::size_of_val(&name) as libc::socklen_t;
    head.msg_iov = &raw mut part;
    head.msg_iovlen = 1;
    head.msg_control = control.as_mut_ptr().cast();
    head.msg_controllen = if counts { TIME_SPACE + COUNT_SPACE } else { TIME_SPACE } as _;
    // SAFETY: all pointers in `head` are to memory of this function or of the caller, of the sizes that stand there.
    let len = Errno::result(unsafe { libc::recvmsg(fd.as_raw_fd(), &raw mut head, flags) })? as usize;
    let (mut at, mut overflows) = (None, None);
    // SAFETY: the kernel has written whole control messages, and their total size, to `head`.
    let mut message = unsafe { libc::CMSG_FIRSTHDR(&raw const head) };
    // SAFETY: `message` is null, or points to a header within `control`, which is aligned for it.
    while let Some(&libc::cmsghdr { cmsg_level, cmsg_type, cmsg_len, .. }) = unsafe { message.as_ref() } {
        // SAFETY: numbers from numbers.
        let has = |size| cmsg_len as usize >= unsafe { libc::CMSG_LEN(size as u32) } as usize;
        // SAFETY: as above; a header of that length is followed by the bytes that are read.
        unsafe {
            let data = libc::CMSG_DATA(message);
            match (cmsg_level, cmsg_type) {
                (libc::SOL_SOCKET, libc::SCM_TIMESTAMPNS) if has(mem::size_of::<libc::timespec>()) => {
                    let time = data.cast::<libc::timespec>().read_unaligned();
                    at = Some((time.tv_sec as i64).saturating_mul(1_000_000_000).saturating_add(time.tv_nsec as i64));
                }
                (libc::SOL_SOCKET, libc::SO_RXQ_OVFL) if has(mem::size_of::<u32>()) => {
                    overflows = Some(data.cast::<u32>().read_unaligned());
                }
                _ => {}
            }
            message = libc::CMSG_NXTHDR(&raw const head, message);
        }
    }
    let from = SocketAddrV4::new(Ipv4Addr::from(u32::from_be(name.sin_addr.s_addr)), u16::from_be(name.sin_port));
    Ok(Datagram { from, len, at, overflows })
}

/// # Safety
/// `value` must be what the option takes.
unsafe fn set<T>(fd: BorrowedFd<'_>, level: i32, option: i32, value: &T) -> nix::Result<()> {
    let len = mem::size_of::<T>() as libc::socklen_t;
    // SAFETY: `len` bytes can be read at `value`; what they mean is the caller's promise.
    let result = unsafe { libc::setsockopt(fd.as_raw_fd(), level, option, std::ptr::from_ref(value).cast(), len) };
    Errno::result(result).map(drop)
}

/// # Safety
/// Any bytes must be a `T`, and the option must fill all of it.
unsafe fn get<T: Default>(fd: BorrowedFd<'_>, level: i32, option: i32) -> nix::Result<T> {
    let mut value = T::default();
    let mut len = mem::size_of::<T>() as libc::socklen_t;
    // SAFETY: `len` bytes can be written at `value`; what they mean is the caller's promise.
    let result =
        unsafe { libc::getsockopt(fd.as_raw_fd(), level, option, std::ptr::from_mut(&mut value).cast(), &raw mut len) };
    Errno::result(result).map(|_| value)
}
