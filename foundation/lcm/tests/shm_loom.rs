//! The shared-memory ring and its doorbell under `loom`: every interleaving and every value that the memory model
//! allows each load to see, of the very source files that run on the robot. `loom` has atomics of 64 bits only where
//! pointers have as many.
#![cfg(target_has_atomic = "64")]
#![cfg(target_pointer_width = "64")]
#![allow(dead_code, reason = "only the parts that two threads meet in are run here")]

#[path = "../src/shm/bell.rs"]
mod bell;
#[path = "../src/shm/ring.rs"]
mod ring;

mod sync {
    pub use loom::sync::atomic::{AtomicU64 as Word, Ordering, fence};
    pub type Value = u64;

    pub fn store_all(words: &[Word], values: &[[u8; 8]]) {
        for (word, value) in words.iter().zip(values) {
            word.store(u64::from_ne_bytes(*value), Ordering::Relaxed);
        }
    }

    pub fn load_all(words: &[Word], values: &mut [[u8; 8]]) {
        for (word, value) in words.iter().zip(values) {
            *value = word.load(Ordering::Relaxed).to_ne_bytes();
        }
    }
}

use bell::Sleeper;
use loom::sync::{Arc, Mutex};
use loom::thread;
use ring::{CONTROL, Copy, Kind, Message, Read, Reader, Ring, Writer};
use sync::{Ordering, Value, Word};

/// 32 grains: six records of five, and a rest that holds no header.
const GRAINS: usize = 32;

struct Shared {
    control: Vec<Word>,
    data: Vec<Word>,
}

impl Shared {
    fn new() -> Arc<Self> {
        let words = |count| (0..count).map(|_| Word::new(0)).collect();
        Arc::new(Self { control: words(CONTROL), data: words(GRAINS) })
    }

    fn ring(&self) -> Ring<'_> {
        Ring { control: &self.control, data: &self.data }
    }

    fn write(&self, writer: &mut Writer, sequence: u32) {
        self.write_after(writer, sequence, || false);
    }

    /// Perhaps at the start of a lap: `drained` as in [`Writer::place`].
    fn write_after(&self, writer: &mut Writer, sequence: u32, drained: impl FnOnce() -> bool) {
        let place = writer.place(self.ring(), "C", 8, drained).expect("it fits");
        let payload = u64::from(sequence).wrapping_mul(0x0101_0101_0101_0101).to_ne_bytes();
        let message =
            Message { sequence, at: i64::from(sequence), channel: "C", payload: &payload, kind: Kind::Message };
        writer.write(self.ring(), place, &message);
    }

    /// The next record: the sequence number if it is a message, which must be whole.
    fn read(&self, reader: &mut Reader, copy: &mut Copy) -> Option<u32> {
        if reader.read(self.ring(), copy, |_| true, |_| true) != Read::Message(Kind::Message) {
            return None;
        }
        let sequence = copy.header.sequence;
        let payload = u64::from(sequence).wrapping_mul(0x0101_0101_0101_0101).to_ne_bytes();
        assert_eq!((copy.channel(), copy.header.at), ("C", i64::from(sequence)), "torn");
        assert_eq!(copy.payload[..copy.header.len as usize], payload, "torn");
        Some(sequence)
    }
}

fn model(preemptions: usize, check: impl Fn() + Sync + Send + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = Some(preemptions);
    builder.check(check);
}

#[test]
fn a_message_is_read_whole_while_the_next_is_written() {
    model(3, || {
        let shared = Shared::new();
        let mut writer = Writer::new(shared.ring());
        let theirs = shared.clone();
        let publisher = thread::spawn(move || {
            theirs.write(&mut writer, 0);
            theirs.write(&mut writer, 1);
        });
        let (mut reader, mut copy) = (Reader::from_start(), Copy::default());
        let mut next = 0;
        for _ in 0..3 {
            if let Some(sequence) = shared.read(&mut reader, &mut copy) {
                assert_eq!(sequence, next, "in order, each once");
                next += 1;
            }
        }
        publisher.join().expect("no panic");
        assert_eq!((reader.lost, reader.corrupt), (0, 0));
    });
}

#[test]
fn what_is_overwritten_while_it_is_read_is_not_delivered() {
    model(2, || {
        let shared = Shared::new();
        let mut writer = Writer::new(shared.ring());
        (0..6).for_each(|sequence| shared.write(&mut writer, sequence));
        let theirs = shared.clone();
        // The second lap begins: over the message that is read.
        let publisher = thread::spawn(move || theirs.write(&mut writer, 6));
        let (mut reader, mut copy) = (Reader::from_start(), Copy::default());
        let first = shared.read(&mut reader, &mut copy);
        let second = shared.read(&mut reader, &mut copy);
        publisher.join().expect("no panic");
        match (first, second) {
            (Some(0), Some(1)) | (Some(0), None) | (None, _) => {}
            other => panic!("{other:?}"),
        }
        // Whatever happened, the newest message can be had, and what is missing was counted.
        let mut got: Vec<u32> = [first, second].into_iter().flatten().collect();
        for _ in 0..16 {
            got.extend(shared.read(&mut reader, &mut copy));
        }
        assert!(got.is_sorted_by(|a, b| a < b) && got.last() == Some(&6), "{got:?}");
        assert_eq!((got.len() as u64 + reader.lost, reader.corrupt), (7, 0));
    });
}

/// A publisher's message: written, then the bell if the reader sleeps.
fn publish(tail: &Word, sleep: &Word, rings: &Mutex<u32>) {
    tail.fetch_add(1, Ordering::Release);
    bell::written();
    if let Some(value) = bell::asleep(sleep) {
        *rings.lock().expect("no panic") += 1;
        bell::rang(sleep, value);
    }
}

#[test]
fn a_reader_that_goes_to_sleep_is_rung_or_sees_the_message() {
    model(3, || {
        let shared = Arc::new((Word::new(0), Word::new(0), Mutex::new(0)));
        let publishers: Vec<_> = (0..2)
            .map(|_| {
                let shared = shared.clone();
                thread::spawn(move || publish(&shared.0, &shared.1, &shared.2))
            })
            .collect();
        let (tail, sleep, rings) = &*shared;
        let mut sleeper = Sleeper::default();
        sleeper.sleep(sleep);
        let seen = tail.load(Ordering::Acquire);
        publishers.into_iter().for_each(|publisher| publisher.join().expect("no panic"));
        assert!(seen == 2 || *rings.lock().expect("no panic") > 0, "asleep with a message");
    });
}

#[test]
fn a_reader_that_found_a_message_in_time_is_rung_in_its_next_sleep() {
    model(3, || {
        let shared = Arc::new((Word::new(0), Word::new(0), Mutex::new(0)));
        let publishers: Vec<_> = (0..2)
            .map(|_| {
                let shared = shared.clone();
                thread::spawn(move || publish(&shared.0, &shared.1, &shared.2))
            })
            .collect();
        let (tail, sleep, rings) = &*shared;
        let mut sleeper = Sleeper::default();
        sleeper.sleep(sleep);
        if tail.load(Ordering::Acquire) > 0 {
            // It does not wait, so it takes no ring.
            sleeper.wake(sleep);
            sleeper.sleep(sleep);
        }
        let seen = tail.load(Ordering::Acquire);
        publishers.into_iter().for_each(|publisher| publisher.join().expect("no panic"));
        assert!(seen == 2 || *rings.lock().expect("no panic") > 0, "asleep with a message");
    });
}

#[test]
fn a_late_ring_does_not_spoil_the_next_sleep() {
    model(3, || {
        let shared = Arc::new((Word::new(0), Word::new(0), Mutex::new(0)));
        let (tail, sleep, rings) = &*shared;
        let mut sleeper = Sleeper::default();
        sleeper.sleep(sleep);
        let first = {
            let shared = shared.clone();
            thread::spawn(move || publish(&shared.0, &shared.1, &shared.2))
        };
        let second = {
            let shared = shared.clone();
            thread::spawn(move || publish(&shared.0, &shared.1, &shared.2))
        };
        // Wakes for whatever reason, takes what is there and the rings, sleeps anew, looks again.
        *rings.lock().expect("no panic") = 0;
        sleeper.sleep(sleep);
        let seen = tail.load(Ordering::Acquire);
        first.join().expect("no panic");
        second.join().expect("no panic");
        assert!(seen == 2 || *rings.lock().expect("no panic") > 0, "asleep with a message");
    });
}

/// A publisher's ring, and the words of the one reader that it has.
struct Pair {
    shared: Arc<Shared>,
    sleep: Word,
    awake: Word,
}

struct Publisher {
    writer: Writer,
    behind: Option<Value>,
    /// It is of the reader's user, and may mark it as woken.
    ours: bool,
}

struct Receiver {
    reader: Reader,
    copy: Copy,
    sleeper: Sleeper,
    got: Vec<u32>,
}

impl Pair {
    fn new(ours: bool) -> (Arc<Self>, Publisher, Receiver) {
        let pair = Self { shared: Shared::new(), sleep: Word::new(0), awake: Word::new(0) };
        let publisher = Publisher { writer: Writer::new(pair.shared.ring()), behind: None, ours };
        let (reader, copy, sleeper) = (Reader::from_start(), Copy::default(), Sleeper::default());
        (Arc::new(pair), publisher, Receiver { reader, copy, sleeper, got: Vec::new() })
    }

    /// As a bus does it; true if this message starts a lap before the end of the one before.
    fn publish(&self, publisher: &mut Publisher, sequence: u32) -> bool {
        let (behind, mut early) = (publisher.behind, false);
        self.shared.write_after(&mut publisher.writer, sequence, || {
            early = bell::has_read_all(&self.sleep, &self.awake, behind);
            early
        });
        bell::written();
        if let Some(sleep) = bell::asleep(&self.sleep) {
            publisher.behind = Some(sleep);
            if publisher.ours {
                bell::rang(&self.sleep, sleep);
            }
        }
        early
    }

    /// Takes a record.
    fn recv(&self, receiver: &mut Receiver) {
        if let Some(sequence) = self.shared.read(&mut receiver.reader, &mut receiver.copy) {
            bell::received(&self.awake);
            receiver.got.push(sequence);
        }
    }

    /// As a bus does it; false if there is something to read.
    fn sleep(&self, receiver: &mut Receiver) -> bool {
        receiver.sleeper.announce(&self.sleep, &self.awake);
        let pending = receiver.reader.pending(self.shared.ring());
        match pending {
            false => bell::found_nothing(&self.awake),
            true => receiver.sleeper.wake(&self.sleep),
        }
        !pending
    }
}

#[test]
fn no_lap_starts_early_over_what_a_reader_that_goes_to_sleep_has_not_read() {
    for ours in [true, false] {
        model(2, move || {
            let (pair, mut publisher, mut receiver) = Pair::new(ours);
            let theirs = pair.clone();
            let reading = thread::spawn(move || {
                // The ring was empty just now. Something else wakes it after the first sleep.
                theirs.sleep(&mut receiver);
                theirs.sleep(&mut receiver);
                receiver
            });
            // The third one goes where the first one is, if it starts a lap.
            for sequence in 0..3 {
                assert!(!pair.publish(&mut publisher, sequence), "a lap over {sequence} messages");
            }
            let mut receiver = reading.join().expect("no panic");
            (0..3).for_each(|_| pair.recv(&mut receiver));
            assert_eq!((receiver.got, receiver.reader.lost, receiver.reader.corrupt), (vec![0, 1, 2], 0, 0));
        });
    }
}

#[test]
fn a_lap_starts_early_once_the_reader_has_read_all() {
    for ours in [true, false] {
        let lapped = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
        let seen = lapped.clone();
        model(2, move || {
            let (pair, mut publisher, mut receiver) = Pair::new(ours);
            assert!(!pair.publish(&mut publisher, 0) && !pair.publish(&mut publisher, 1));
            (0..2).for_each(|_| pair.recv(&mut receiver));
            assert!(pair.sleep(&mut receiver));
            assert!(pair.publish(&mut publisher, 2) && !pair.publish(&mut publisher, 3));
            let theirs = pair.clone();
            let reading = thread::spawn(move || {
                // The end of the lap, and two messages.
                (0..3).for_each(|_| theirs.recv(&mut receiver));
                theirs.sleep(&mut receiver);
                receiver
            });
            if pair.publish(&mut publisher, 4) {
                seen.store(true, Ordering::Relaxed);
            }
            let mut receiver = reading.join().expect("no panic");
            (0..2).for_each(|_| pair.recv(&mut receiver));
            let (got, lost, corrupt) = (receiver.got, receiver.reader.lost, receiver.reader.corrupt);
            assert_eq!((got, lost, corrupt), (vec![0, 1, 2, 3, 4], 0, 0));
        });
        assert!(lapped.load(Ordering::Relaxed), "never");
    }
}
