//! A page as both sides reach it: mapped, so that a heartbeat and a look at one need no system call.
//!
//! Somebody may truncate the file. The mapping then shows zeros that no other process sees, and is marked as cut; from
//! there on the words are reached by system calls, which extend the file again.

use super::PAGE_SIZE;
use lcm::memory::{Access, Memory};
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::sync::atomic::Ordering;

/// A mapped page.
#[derive(Debug)]
pub(super) struct Page {
    file: File,
    memory: Memory,
    access: Access,
}

impl Page {
    /// Maps a file that is open for this access.
    pub fn new(file: File, access: Access) -> io::Result<Self> {
        let memory = Memory::map(&file, PAGE_SIZE, access)?;
        Ok(Self { file, memory, access })
    }

    /// True if an access found the file truncated.
    pub fn is_cut(&self) -> bool {
        self.memory.is_cut()
    }

    /// True if the file is shorter than a page now. A system call.
    pub fn is_short(&self) -> bool {
        self.file.metadata().is_ok_and(|found| found.len() < PAGE_SIZE as u64)
    }

    /// The number at `place`, a multiple of 4; 0 if it cannot be read.
    pub fn load(&self, place: usize) -> u32 {
        let word = self.memory.words32()[place / 4].load(Ordering::Acquire);
        if !self.is_cut() {
            return u32::from_le(word);
        }
        let mut bytes = [0; 4];
        match self.file.read_exact_at(&mut bytes, place as u64) {
            Ok(()) => u32::from_le_bytes(bytes),
            Err(_) => 0,
        }
    }

    /// Stores a number at `place`, a multiple of 4; nothing in a page that is mapped for reading. A failure is not
    /// reported: what is missing is noticed by the side that reads it.
    pub fn store(&self, place: usize, value: u32) {
        if self.access == Access::Read {
            return;
        }
        self.memory.words32()[place / 4].store(value.to_le(), Ordering::Release);
        if self.is_cut() {
            let _ = self.file.write_all_at(&value.to_le_bytes(), place as u64);
        }
    }

    /// Writes bytes by a system call.
    pub fn write(&self, place: usize, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all_at(bytes, place as u64)
    }

    /// Reads bytes by a system call.
    pub fn read(&self, place: usize, bytes: &mut [u8]) -> io::Result<()> {
        self.file.read_exact_at(bytes, place as u64)
    }
}
