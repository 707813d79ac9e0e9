//! Whether a reader sleeps: one word that it writes and that publishers answer; and another that it alone writes, from
//! which publishers know whether it has read all ([`has_read_all`]).
//!
//! An odd value is a sleep, each with another value; an even one means awake, or woken already. A reader first
//! announces its sleep, then checks all rings again, and sleeps only if they are empty; a publisher first writes, then
//! checks if the reader sleeps. One of the two sees the other, because both sides have a full fence between store and
//! load. A publisher first rings and then marks exactly that sleep as woken: one that dies in between has rung, and a
//! late one does not change the word of a later sleep.
//!
//! The bell is a FIFO that its reader watches edge-triggered: a byte wakes, whatever lies in the FIFO already, so the
//! reader need not read it. A hop costs two system calls: the publisher's write and the reader's wait. The FIFO is
//! emptied once in [`EMPTIED_AFTER`] sleeps, and, for a caller that watches level-triggered, before each. A full one
//! does not wake: its writer sends a datagram as well.

use super::sync::{Ordering, Value, Word, fence};

/// Number of sleeps after which the bell is emptied. A publisher rings at most once for each, so that the 64 KiB of a
/// FIFO hold the bytes of 256 publishers.
pub const EMPTIED_AFTER: u32 = 256;

/// The reader's side.
#[derive(Debug, Default)]
pub struct Sleeper {
    /// The value of the latest sleep.
    sleep: Value,
}

impl Sleeper {
    /// A new sleep begins. Look into the rings after this.
    pub fn sleep(&mut self, word: &Word) {
        self.sleep = self.sleep.wrapping_add(2) | 1;
        // A swap, not a store: its place among the rings for the sleep before is then certain. Who sees it also sees
        // that the reader counted as awake before it.
        word.swap(self.sleep, Ordering::Release);
        fence(Ordering::SeqCst);
    }

    /// Announces a sleep: publishers ring from now on. It counts as awake until it has [`found_nothing`]. Look into the
    /// rings after this.
    pub fn announce(&mut self, word: &Word, awake: &Word) {
        received(awake);
        self.sleep(word);
    }

    /// Marks the reader as awake: no bell is needed.
    pub fn wake(&self, word: &Word) {
        word.store(self.sleep.wrapping_add(1), Ordering::Relaxed);
    }
}

/// The reader has received something, or perhaps will.
pub fn received(awake: &Word) {
    awake.store(1, Ordering::Relaxed);
}

/// The reader found all rings empty after it announced its sleep.
pub fn found_nothing(awake: &Word) {
    awake.store(0, Ordering::Relaxed);
}

/// True if a reader has read all that a publisher wrote for it; `behind` is the sleep in which that publisher last
/// found it when it wrote for it. The reader sleeps, found all rings empty after it announced that, and nothing came
/// since. Its word of sleep alone does not show it: a sleep is announced before the rings are looked into, and not
/// everybody who rings may mark the reader as woken.
pub fn has_read_all(word: &Word, awake: &Word, behind: Option<Value>) -> bool {
    // The sleep first: the one that it shows began before the answer to whether it is awake.
    asleep(word).is_some_and(|sleep| behind != Some(sleep)) && awake.load(Ordering::Relaxed) == 0
}

/// A publisher's side, before it looks at any sleeper: what it has written comes first.
pub fn written() {
    fence(Ordering::SeqCst);
}

/// The sleep that the reader is in.
pub fn asleep(word: &Word) -> Option<Value> {
    Some(word.load(Ordering::Acquire)).filter(|value| value & 1 == 1)
}

/// The bell has been rung for this sleep; others need not.
pub fn rang(word: &Word, sleep: Value) {
    let _ = word.compare_exchange(sleep, sleep.wrapping_add(1), Ordering::Relaxed, Ordering::Relaxed);
}
