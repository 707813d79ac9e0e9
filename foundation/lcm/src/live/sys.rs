//! The socket options and the system call that have no safe wrapper.
#![allow(unsafe_code)]

use crate::filter::Instruction;
use nix::errno::Errno;
use nix::libc;
use std::mem;
use std::net::Ipv4Addr;
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
