//! The shared-memory ring when a publisher dies between any two of its stores, and when it writes between any two
//! loads of a reader: every such instant, one after the other, in the very source file that runs on the robot.
#![allow(dead_code, reason = "only what a ring needs")]

#[path = "../src/shm/ring.rs"]
mod ring;

/// Words that run something before the n-th store or load of this thread.
mod sync {
    use std::cell::{Cell, RefCell};
    #[cfg(not(target_has_atomic = "64"))]
    use std::sync::atomic::AtomicU32 as Atomic;
    #[cfg(target_has_atomic = "64")]
    use std::sync::atomic::AtomicU64 as Atomic;
    pub use std::sync::atomic::{Ordering, fence};

    #[cfg(not(target_has_atomic = "64"))]
    pub type Value = u32;
    #[cfg(target_has_atomic = "64")]
    pub type Value = u64;
    type Deed = Box<dyn FnOnce()>;

    thread_local! {
        static STORES_LEFT: Cell<Option<u32>> = const { Cell::new(None) };
        static LOADS_LEFT: Cell<Option<u32>> = const { Cell::new(None) };
        static DEED: RefCell<Option<Deed>> = const { RefCell::new(None) };
    }

    /// The thread panics before its store number `n`.
    pub fn die_before_store(n: Option<u32>) {
        STORES_LEFT.set(n);
    }

    /// Does `deed` before load number `n`. Whether it was done: [`forget_deed`].
    pub fn before_load(n: u32, deed: impl FnOnce() + 'static) {
        LOADS_LEFT.set(Some(n));
        DEED.set(Some(Box::new(deed)));
    }

    /// True if the deed was not done.
    pub fn forget_deed() -> bool {
        LOADS_LEFT.set(None);
        DEED.take().is_some()
    }

    #[derive(Default)]
    pub struct Word(Atomic);

    impl Word {
        pub fn store(&self, value: Value, order: Ordering) {
            match STORES_LEFT.get() {
                // No panic message.
                Some(0) => std::panic::resume_unwind(Box::new("killed")),
                left => STORES_LEFT.set(left.map(|left| left - 1)),
            }
            self.0.store(value, order);
        }

        pub fn load(&self, order: Ordering) -> Value {
            match LOADS_LEFT.get() {
                Some(0) => {
                    LOADS_LEFT.set(None);
                    DEED.take().into_iter().for_each(|deed| deed());
                }
                left => LOADS_LEFT.set(left.map(|left| left - 1)),
            }
            self.0.load(order)
        }
    }

    pub fn store_all(words: &[Word], values: &[[u8; size_of::<Value>()]]) {
        for (word, value) in words.iter().zip(values) {
            word.store(Value::from_ne_bytes(*value), Ordering::Relaxed);
        }
    }

    pub fn load_all(words: &[Word], values: &mut [[u8; size_of::<Value>()]]) {
        for (word, value) in words.iter().zip(values) {
            *value = word.load(Ordering::Relaxed).to_ne_bytes();
        }
    }
}

use ring::{CONTROL, Copy, Kind, Message, Read, Reader, Ring, Writer};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;
use sync::Word;

/// Payload lengths by sequence number: laps end in different ways.
const LENGTHS: [usize; 7] = [0, 40, 3, 64, 8, 17, 1];

struct Shared {
    control: Vec<Word>,
    data: Vec<Word>,
}

impl Shared {
    fn new() -> Rc<Self> {
        let words = |count| (0..count).map(|_| Word::default()).collect();
        Rc::new(Self { control: words(CONTROL), data: words(512 / size_of::<sync::Value>()) })
    }

    fn ring(&self) -> Ring<'_> {
        Ring { control: &self.control, data: &self.data }
    }

    fn write(&self, writer: &mut Writer, sequence: u32) {
        let payload = payload(sequence);
        let message = Message { sequence, at: 1, channel: "NAME", payload: &payload, kind: Kind::Message };
        let drained = sequence.is_multiple_of(3);
        let place = writer.place(self.ring(), message.channel, payload.len(), || drained).expect("it fits");
        writer.write(self.ring(), place, &message);
    }

    /// The next message, which must be whole; `None` if there is nothing more.
    fn read(&self, reader: &mut Reader, copy: &mut Copy) -> Option<u32> {
        for _ in 0..1000 {
            match reader.read(self.ring(), copy, |_| true, |_| true) {
                Read::Empty => return None,
                Read::Passed => {}
                Read::Message(_) => {
                    let sequence = copy.header.sequence;
                    assert_eq!(copy.channel(), "NAME");
                    assert!(copy.payload[..copy.header.len as usize] == payload(sequence), "torn");
                    return Some(sequence);
                }
            }
        }
        panic!("a reader that works without end");
    }
}

fn payload(sequence: u32) -> Vec<u8> {
    vec![sequence as u8 ^ 0x5a; LENGTHS[sequence as usize % LENGTHS.len()]]
}

#[test]
fn a_publisher_that_dies_between_two_stores_leaves_whole_messages() {
    for before in 0..40 {
        for store in 0.. {
            let shared = Shared::new();
            let mut writer = Writer::new(shared.ring());
            let (mut early, mut late) = (Reader::from_start(), Reader::from_start());
            let mut copy = Copy::default();
            (0..before).for_each(|sequence| shared.write(&mut writer, sequence));
            let mut got: Vec<u32> = std::iter::from_fn(|| shared.read(&mut early, &mut copy)).collect();
            sync::die_before_store(Some(store));
            let died = catch_unwind(AssertUnwindSafe(|| shared.write(&mut writer, before))).is_err();
            sync::die_before_store(None);
            got.extend(std::iter::from_fn(|| shared.read(&mut early, &mut copy)));
            assert_eq!(got.last().copied(), if died { before.checked_sub(1) } else { Some(before) });
            assert!(got.is_sorted_by(|a, b| a < b), "{got:?}");
            assert_eq!(got.len() as u64 + early.lost, u64::from(before) + u64::from(!died));
            // Who comes later finds what the dead one has not begun to overwrite.
            let got: Vec<u32> = std::iter::from_fn(|| shared.read(&mut late, &mut copy)).collect();
            assert!(got.is_sorted_by(|a, b| b - a == 1), "{got:?}");
            assert_eq!((early.corrupt, late.corrupt), (0, 0));
            if !died {
                break;
            }
        }
    }
}

#[test]
fn a_reader_that_is_overtaken_between_two_loads_delivers_nothing_torn() {
    for before in 0..30 {
        for more in 1..30 {
            for load in 0.. {
                let shared = Shared::new();
                let mut writer = Writer::new(shared.ring());
                let (mut reader, mut copy) = (Reader::from_start(), Copy::default());
                (0..before).for_each(|sequence| shared.write(&mut writer, sequence));
                let theirs = shared.clone();
                sync::before_load(load, move || (before..before + more).for_each(|n| theirs.write(&mut writer, n)));
                let mut got: Vec<u32> = std::iter::from_fn(|| shared.read(&mut reader, &mut copy)).collect();
                let all_read = sync::forget_deed();
                got.extend(std::iter::from_fn(|| shared.read(&mut reader, &mut copy)));
                assert!(got.is_sorted_by(|a, b| a < b), "{got:?}");
                assert_eq!(reader.corrupt, 0);
                if all_read {
                    assert_eq!(got.last().copied(), before.checked_sub(1));
                    break;
                }
                assert_eq!(got.last().copied(), Some(before + more - 1));
                assert_eq!(got.len() as u64 + reader.lost, u64::from(before + more));
            }
        }
    }
}
