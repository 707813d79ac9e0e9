//! Memory that processes share: a file in `/dev/shm`, mapped, and copies of many words. The one file of the bus with
//! `unsafe`.
//! All accesses are to atomic words, so a concurrent write by another process gives some value, never undefined
//! behaviour.
//!
//! A file can be truncated while it is mapped; the kernel answers an access beyond its end by SIGBUS, which would end
//! every process that has it mapped. A handler maps a page of zeroes there instead, private to this process, and marks
//! the mapping as [cut](Memory::is_cut): zeroes are valid words, and the caller checks the mark before it relies on
//! them. Any other SIGBUS goes on to the handler that was there before.
#![allow(unsafe_code, reason = "a mapping is a pointer, and a copy of what others write is no `memcpy`")]

use super::sync::{Ordering, Value, Word};
use core::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize};
use nix::errno::Errno;
use nix::fcntl::{FallocateFlags, fallocate};
use nix::libc;
use nix::sys::mman::{MapFlags, ProtFlags, mmap, munmap};
use nix::sys::signal::{SaFlags, SigAction, SigHandler, SigSet, Signal, sigaction};
use nix::unistd::{SysconfVar, sysconf};
use std::ffi::c_void;
use std::num::NonZeroUsize;
use std::os::fd::AsFd;
use std::ptr::NonNull;
use std::sync::OnceLock;
use std::{io, slice};

/// Maximum number of mappings in a process.
const MAPPINGS_MAX: usize = 2048;
/// Starts of a mapping's entry that is free, and of one that is being made.
const FREE: usize = 0;
const BUSY: usize = 1;

/// A mapping as the handler finds it.
#[derive(Debug)]
struct Entry {
    start: AtomicUsize,
    bytes: AtomicUsize,
    cut: AtomicBool,
}

static MAPPINGS: [Entry; MAPPINGS_MAX] =
    [const { Entry { start: AtomicUsize::new(FREE), bytes: AtomicUsize::new(0), cut: AtomicBool::new(false) } };
        MAPPINGS_MAX];
/// The page size, and the previous action on SIGBUS.
static BEFORE: OnceLock<io::Result<(usize, SigAction)>> = OnceLock::new();

impl Entry {
    /// A free entry, which is taken now.
    fn take() -> Option<&'static Self> {
        MAPPINGS.iter().find(|entry| {
            let free = entry.start.load(Ordering::Relaxed) == FREE;
            free && entry.start.compare_exchange(FREE, BUSY, Ordering::Acquire, Ordering::Relaxed).is_ok()
        })
    }

    fn set(&self, start: usize, bytes: usize) {
        self.bytes.store(bytes, Ordering::Relaxed);
        self.cut.store(false, Ordering::Relaxed);
        self.start.store(start, Ordering::Release);
    }

    fn free(&self) {
        self.start.store(FREE, Ordering::Release);
    }

    /// True if `address` lies in it. While another thread makes or frees this entry, perhaps also where it does not.
    fn has(&self, address: usize) -> bool {
        let start = self.start.load(Ordering::Acquire);
        start > BUSY && address.checked_sub(start).is_some_and(|at| at < self.bytes.load(Ordering::Relaxed))
    }
}

/// Installs the handler, once in a process.
fn guard() -> io::Result<()> {
    let install = || {
        let page = sysconf(SysconfVar::PAGE_SIZE)?.and_then(|size| usize::try_from(size).ok()).unwrap_or(4096);
        // On the thread's alternate stack, where it has one; the action before may be one that looks for overflows.
        let flags = SaFlags::SA_SIGINFO | SaFlags::SA_ONSTACK | SaFlags::SA_RESTART;
        let action = SigAction::new(SigHandler::SigAction(on_bus_error), flags, SigSet::empty());
        // SAFETY: the handler makes system calls and reaches atomics, nothing else.
        Ok((page, unsafe { sigaction(Signal::SIGBUS, &action) }?))
    };
    match BEFORE.get_or_init(install) {
        Ok(_) => Ok(()),
        Err(error) => Err(io::Error::new(error.kind(), error.to_string())),
    }
}

/// Maps a page of zeroes where a mapped file has no page any more.
extern "C" fn on_bus_error(signal: libc::c_int, info: *mut libc::siginfo_t, context: *mut c_void) {
    let errno = Errno::last_raw();
    // SAFETY: the kernel passes a valid `siginfo_t`, and with SIGBUS an address in it.
    let (code, address) = unsafe { ((*info).si_code, (*info).si_addr() as usize) };
    // Not installed yet: we have no mapping so far, so a signal in between cannot concern one.
    let Some(Ok((page, before))) = BEFORE.get() else { return };
    let mut ours = false;
    if code == libc::BUS_ADRERR {
        // Without a break: an entry that another thread just changes may seem to have it.
        for entry in MAPPINGS.iter().filter(|entry| entry.has(address)) {
            entry.cut.store(true, Ordering::Release);
            ours = true;
        }
    }
    if !(ours && put_zeroes(address & !(page - 1), *page)) {
        pass_on(before, signal, info, context);
    }
    Errno::set_raw(errno);
}

/// True if there are zeroes now.
fn put_zeroes(start: usize, bytes: usize) -> bool {
    let access = libc::PROT_READ | libc::PROT_WRITE;
    let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED;
    // SAFETY: the page was accessed just now, and found to be mapped to a file that has ended before it; it holds
    // nothing. It belongs to a `Memory`, whose words may have any value at any time.
    unsafe { libc::mmap(start as *mut c_void, bytes, access, flags, -1, 0) != libc::MAP_FAILED }
}

/// Does what would have happened without our handler.
fn pass_on(before: &SigAction, signal: libc::c_int, info: *mut libc::siginfo_t, context: *mut c_void) {
    match before.handler() {
        SigHandler::SigAction(handler) => handler(signal, info, context),
        SigHandler::Handler(handler) => handler(signal),
        SigHandler::SigDfl | SigHandler::SigIgn => {
            // The access is repeated when this returns, and ends the process as it would have before.
            let action = SigAction::new(SigHandler::SigDfl, SaFlags::empty(), SigSet::empty());
            // SAFETY: the default action is no code of this process.
            let _ = unsafe { sigaction(Signal::SIGBUS, &action) };
        }
    }
}

/// A mapped file.
#[derive(Debug)]
pub struct Memory {
    start: NonNull<c_void>,
    bytes: NonZeroUsize,
    entry: &'static Entry,
}

/// Permitted access to the words of a mapping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Loads alone: a store would end the process (SIGSEGV).
    Read,
    /// Loads and stores.
    Write,
}

// SAFETY: the mapping belongs to this value alone, is valid in every thread until `drop`, and is reached only as
// atomics.
unsafe impl Send for Memory {}
// SAFETY: as above; atomics may be shared.
unsafe impl Sync for Memory {}

impl Memory {
    /// Maps the first `bytes` of a file that is open for that access. Where it is shorter, the first access finds it
    /// [cut](Self::is_cut).
    ///
    /// # Errors
    /// The kernel refuses the mapping, or this process has too many.
    pub fn map(file: impl AsFd, bytes: usize, access: Access) -> io::Result<Self> {
        guard()?;
        let bytes = NonZeroUsize::new(bytes).ok_or(Errno::EINVAL)?;
        let entry = Entry::take().ok_or(io::ErrorKind::QuotaExceeded)?;
        let access = match access {
            Access::Read => ProtFlags::PROT_READ,
            Access::Write => ProtFlags::PROT_READ | ProtFlags::PROT_WRITE,
        };
        // SAFETY: a new mapping at an address that the kernel chooses; it replaces none of this process.
        let start =
            unsafe { mmap(None, bytes, access, MapFlags::MAP_SHARED, file, 0) }.inspect_err(|_| entry.free())?;
        entry.set(start.as_ptr() as usize, bytes.get());
        Ok(Self { start, bytes, entry })
    }

    /// True if an access found the file truncated: from then on the words there are zeroes that no other process sees.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.entry.cut.load(Ordering::Acquire)
    }

    /// All words of 32 bits: for a file whose layout has such.
    #[must_use]
    pub fn words32(&self) -> &[AtomicU32] {
        // SAFETY: as in `words`; the size of these is smaller, and so is their alignment.
        unsafe { slice::from_raw_parts(self.start.as_ptr().cast(), self.bytes.get() / size_of::<u32>()) }
    }

    /// All words.
    #[must_use]
    pub fn words(&self) -> &[Word] {
        // SAFETY: `start` is the start of a page, so it is aligned; `bytes` from there are mapped until `drop`, which
        // the lifetime excludes. The kernel gave zeroes or what processes stored, every bit pattern is a valid word,
        // and processes that share it reach it as atomic words only.
        unsafe { slice::from_raw_parts(self.start.as_ptr().cast(), self.bytes.get() / size_of::<Value>()) }
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        // Nothing accesses it any more, so no SIGBUS can occur; the address may be reused as soon as it is free.
        self.entry.free();
        // SAFETY: made by `mmap` in `map` with this length; no slice of it outlives `self`.
        let _ = unsafe { munmap(self.start, self.bytes.get()) };
    }
}

/// Makes sure that a part of a file has memory behind it. Without, the first touch of a page when `/dev/shm` is full
/// would end the process (SIGBUS). The file keeps its length: one that was truncated stays short, so that its readers
/// notice.
pub fn reserve(file: impl AsFd, from: usize, to: usize) -> io::Result<()> {
    let offset = from.try_into().map_err(io::Error::other)?;
    let len = (to - from).try_into().map_err(io::Error::other)?;
    loop {
        match fallocate(&file, FallocateFlags::FALLOC_FL_KEEP_SIZE, offset, len) {
            Err(Errno::EINTR) => {}
            result => return Ok(result?),
        }
    }
}

/// Size from which the processor's own copy instruction is faster, bytes. Miri, which runs no assembly, checks the
/// other path.
#[cfg(all(target_arch = "x86_64", not(miri)))]
const LONG: usize = 512;

/// Stores words, relaxed each; both slices have the same length.
pub fn store_all(words: &[Word], values: &[[u8; size_of::<Value>()]]) {
    assert_eq!(words.len(), values.len());
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    if size_of_val(values) >= LONG {
        // SAFETY: both are `size_of_val(values)` bytes long; the words may be written through a shared reference, being
        // atomics.
        return unsafe { copy(values.as_ptr().cast(), words.as_ptr().cast_mut().cast(), size_of_val(values)) };
    }
    for (word, value) in words.iter().zip(values) {
        word.store(Value::from_ne_bytes(*value), Ordering::Relaxed);
    }
}

/// Loads words, relaxed each; both slices have the same length.
pub fn load_all(words: &[Word], values: &mut [[u8; size_of::<Value>()]]) {
    assert_eq!(words.len(), values.len());
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    if size_of_val(values) >= LONG {
        // SAFETY: both are `size_of_val(values)` bytes long.
        return unsafe { copy(words.as_ptr().cast(), values.as_mut_ptr().cast(), size_of_val(values)) };
    }
    for (word, value) in words.iter().zip(values) {
        *value = word.load(Ordering::Relaxed).to_ne_bytes();
    }
}

/// Copies memory that others may write or read at the same time. The compiler knows nothing of it but that bytes are
/// read and written here, and the processor does that in pieces of at least a byte: a relaxed load and store of each,
/// in any order, which is all that a ring asks of a copy before it looks whether to believe it.
///
/// # Safety
/// `len` bytes can be read at `from` and written at `to`, and the two are apart.
#[cfg(all(target_arch = "x86_64", not(miri)))]
unsafe fn copy(from: *const u8, to: *mut u8, len: usize) {
    // SAFETY: the caller's; the direction flag is clear, as everywhere.
    unsafe {
        std::arch::asm!(
            "rep movsb",
            inout("rcx") len => _,
            inout("rsi") from => _,
            inout("rdi") to => _,
            options(nostack, preserves_flags)
        );
    }
}
