//! Whether a reader sleeps: one word that it writes and that publishers answer.
//!
//! An odd value is a sleep, each with another value; an even one says awake, or rung already. A reader first says that
//! it sleeps, then looks into all rings again, and sleeps only if there is nothing; a publisher first writes, then
//! looks whether the reader sleeps. One of the two sees the other: between store and load stands a full fence on both
//! sides. A publisher rings first and then says so, and only about that very sleep: one that dies in between has rung,
//! and one that is late does not wake a later sleep's word.

use super::sync::{Ordering, Value, Word, fence};

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
        // A swap, not a store: its place among the rings for the sleep before is then certain.
        word.swap(self.sleep, Ordering::Relaxed);
        fence(Ordering::SeqCst);
    }

    /// Whether somebody rang since; the bell holds something then.
    pub fn rung(&self, word: &Word) -> bool {
        word.load(Ordering::Relaxed) != self.sleep
    }

    /// Nobody needs to ring.
    pub fn wake(&self, word: &Word) {
        word.store(self.sleep.wrapping_add(1), Ordering::Relaxed);
    }
}

/// A publisher's side, before it looks at any sleeper: what it has written comes first.
pub fn written() {
    fence(Ordering::SeqCst);
}

/// The sleep that the reader is in.
pub fn asleep(word: &Word) -> Option<Value> {
    Some(word.load(Ordering::Relaxed)).filter(|value| value & 1 == 1)
}

/// The bell has been rung for this sleep; others need not.
pub fn rang(word: &Word, sleep: Value) {
    let _ = word.compare_exchange(sleep, sleep.wrapping_add(1), Ordering::Relaxed, Ordering::Relaxed);
}
