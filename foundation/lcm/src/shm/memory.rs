//! Memory that processes share: a file in `/dev/shm`, mapped, and copies of many words. The one file of the bus with
//! `unsafe`.
//! All accesses are to atomic words, so a concurrent write by another process gives some value, never undefined
//! behaviour.
#![allow(unsafe_code, reason = "a mapping is a pointer, and a copy of what others write is no `memcpy`")]

use super::sync::{Ordering, Value, Word};
use nix::errno::Errno;
use nix::fcntl::{FallocateFlags, fallocate};
use nix::sys::mman::{MapFlags, ProtFlags, mmap, munmap};
use std::ffi::c_void;
use std::num::NonZeroUsize;
use std::os::fd::AsFd;
use std::ptr::NonNull;
use std::{io, slice};

/// A mapped file.
#[derive(Debug)]
pub struct Memory {
    start: NonNull<c_void>,
    bytes: NonZeroUsize,
}

// SAFETY: the mapping belongs to this value alone, is valid in every thread until `drop`, and is reached only as
// atomics.
unsafe impl Send for Memory {}
// SAFETY: as above; atomics may be shared.
unsafe impl Sync for Memory {}

impl Memory {
    /// Maps the first `bytes` of a file that is at least as long.
    pub fn map(file: impl AsFd, bytes: usize) -> io::Result<Self> {
        let bytes = NonZeroUsize::new(bytes).ok_or(Errno::EINVAL)?;
        let access = ProtFlags::PROT_READ | ProtFlags::PROT_WRITE;
        // SAFETY: a new mapping at an address that the kernel chooses; it replaces none of this process.
        let start = unsafe { mmap(None, bytes, access, MapFlags::MAP_SHARED, file, 0) }?;
        Ok(Self { start, bytes })
    }

    /// Words.
    pub fn words(&self) -> &[Word] {
        // SAFETY: `start` is the start of a page, so it is aligned; `bytes` from there are mapped until `drop`, which
        // the lifetime excludes. The kernel gave zeroes or what processes stored, every bit pattern is a valid word,
        // and processes that share it reach it as atomic words only.
        unsafe { slice::from_raw_parts(self.start.as_ptr().cast(), self.bytes.get() / size_of::<Value>()) }
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        // SAFETY: made by `mmap` in `map` with this length; no slice of it outlives `self`.
        let _ = unsafe { munmap(self.start, self.bytes.get()) };
    }
}

/// Makes sure that a part of a file has memory behind it. Without, the first touch of a page when `/dev/shm` is full
/// would end the process (SIGBUS).
pub fn reserve(file: impl AsFd, from: usize, to: usize) -> io::Result<()> {
    let offset = from.try_into().map_err(io::Error::other)?;
    let len = (to - from).try_into().map_err(io::Error::other)?;
    loop {
        match fallocate(&file, FallocateFlags::empty(), offset, len) {
            Err(Errno::EINTR) => {}
            result => return Ok(result?),
        }
    }
}

/// Size from which the processor's own copy instruction is faster, bytes.
#[cfg(target_arch = "x86_64")]
const LONG: usize = 512;

/// Stores words, relaxed each; both slices have the same length.
pub fn store_all(words: &[Word], values: &[[u8; size_of::<Value>()]]) {
    assert_eq!(words.len(), values.len());
    #[cfg(target_arch = "x86_64")]
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
    #[cfg(target_arch = "x86_64")]
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
#[cfg(target_arch = "x86_64")]
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
