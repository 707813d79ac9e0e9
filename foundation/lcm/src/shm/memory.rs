//! Memory that processes share: a file in `/dev/shm`, mapped. The one file of this crate with `unsafe`.
//!
//! All that it hands out are atomic words, so whatever another process does to them is a value, never undefined.
#![allow(unsafe_code, reason = "a mapping is a pointer; nothing else here is")]

use super::sync::{Value, Word};
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

    /// Its words.
    pub fn words(&self) -> &[Word] {
        // SAFETY: `start` is the start of a page, so it is aligned; `bytes` from there are mapped until `drop`, which
        // the lifetime excludes. The kernel gave zeroes or what processes stored, every bit pattern is a valid word, and
        // processes that share it reach it as atomic words only.
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
