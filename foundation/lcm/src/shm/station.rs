//! What one context shares with the others: who it is, what it wants, whether it sleeps, and the ring of what it has
//! published. Words of a mapped file; the first page holds all but the ring's data, and the last word the layout.

use super::folder::StationFile;
use super::memory::{Access, Memory, reserve};
use super::ring::{self, Ring};
use super::sync::{Ordering, Value, Word, fence};
use std::fs::File;
use std::io;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::unix::fs::MetadataExt;

/// Changes with every change of anything in shared memory. It is part of the folder's name, so that programs with
/// different layouts never meet there: they are plain listeners to each other.
pub const LAYOUT: usize = 32 + size_of::<Value>();
/// Bytes of the ring: some 20 ms of the heaviest traffic that one robot's publisher makes. Memory is behind it only as
/// far as it was used.
pub const RING: usize = 4 << 20;
/// Bytes of the first page.
pub const HEAD: usize = 4096;
/// Bytes of a station. Its end lies behind the ring: whatever the file is truncated to, the last word goes with it,
/// also where a page stays that is then partly zeroes.
pub const SIZE: usize = HEAD + RING + 4096;
/// Granularity of memory reservation, bytes.
const PIECE: usize = 64 << 10;

// Words that different processes write are in different cache lines.
const LAYOUT_AT: usize = SIZE / size_of::<Value>() - 1;
/// Value of that word. No byte of it is zero: a file that lacks only its last byte reads differently.
const MARK: Value = !(LAYOUT as Value);
const ADDRESS: usize = 2;
const PORT: usize = 3;
const INODE: usize = 4;
const READS: usize = 5;
const PLAIN: usize = 6;
const RETIRED: usize = 7;
const RETIRED_AT: usize = 8;
const ENDED: usize = 32;
const DRAINED: usize = 48;
const SLEEP: usize = 64;
const AWAKE: usize = 65;
const INTEREST: usize = 96;
const INTEREST_END: usize = INTEREST + INTEREST_BITS / Value::BITS as usize;
const INTEREST_BITS: usize = 2048;
const CONTROL: usize = 192;

/// Channels that a reader wants, as bits by hash: what is not in it is not wanted.
#[derive(Clone, Copy)]
pub struct Interest([usize; 2]);

impl Interest {
    /// The bits of one channel.
    pub fn of(channel: &str) -> Self {
        let (_, hash) = ring::bucket(channel);
        Self([hash as usize % INTEREST_BITS, (hash >> 12) as usize % INTEREST_BITS])
    }
}

/// A context's shared memory. That of another user is read-only.
#[derive(Debug)]
pub struct Station {
    memory: Memory,
    uid: u32,
    ours: bool,
}

impl Station {
    /// Makes one of an empty file.
    pub fn create(file: &File, source: SocketAddrV4, inode: u32) -> io::Result<Self> {
        file.set_len(SIZE as u64)?;
        reserve(file, 0, HEAD)?;
        reserve(file, HEAD + RING, SIZE)?;
        let (memory, uid) = (Memory::map(file, SIZE, Access::Write)?, file.metadata()?.uid());
        let station = Self { memory, uid, ours: true };
        station.set(INODE, Value::from(inode));
        station.set(LAYOUT_AT, MARK);
        station.set_source(source);
        Ok(station)
    }

    /// Opens a station that another process made.
    pub fn open(StationFile { file, uid, ours }: &StationFile) -> io::Result<Self> {
        if !Self::is_whole(file) {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "too short"));
        }
        let access = if *ours { Access::Write } else { Access::Read };
        let station = Self { memory: Memory::map(file, SIZE, access)?, uid: *uid, ours: *ours };
        match station.get(LAYOUT_AT) == MARK {
            true => Ok(station),
            false => Err(io::Error::new(io::ErrorKind::InvalidData, "another layout")),
        }
    }

    /// Owner of the file, the only user who writes there.
    pub fn uid(&self) -> u32 {
        self.uid
    }

    /// True if this process may write there: it is of the same user.
    pub fn is_ours(&self) -> bool {
        self.ours
    }

    /// True if its file was truncated: then nothing that was read here counts, also just before.
    pub fn is_cut(&self) -> bool {
        self.get(LAYOUT_AT) != MARK
    }

    /// True if the file of a station is as long as it was made.
    pub fn is_whole(file: &File) -> bool {
        file.metadata().is_ok_and(|found| found.len() >= SIZE as u64)
    }

    fn word(&self, at: usize) -> &Word {
        &self.memory.words()[at]
    }

    fn get(&self, at: usize) -> Value {
        self.word(at).load(Ordering::Acquire)
    }

    fn set(&self, at: usize, value: Value) {
        self.word(at).store(value, Ordering::Release);
    }

    /// The ring of what it publishes.
    pub fn ring(&self) -> Ring<'_> {
        let words = self.memory.words();
        let data = HEAD / size_of::<Value>()..(HEAD + RING) / size_of::<Value>();
        Ring { control: &words[CONTROL..CONTROL + ring::CONTROL], data: &words[data] }
    }

    /// Reserves memory for the first `reach` bytes of the ring, `reserved` of which are there; gives how many are then.
    pub fn reserve(file: &File, reserved: usize, reach: usize) -> io::Result<usize> {
        let reach = reach.next_multiple_of(PIECE).min(RING);
        if reach > reserved {
            reserve(file, HEAD + reserved, HEAD + reach)?;
        }
        Ok(reach.max(reserved))
    }

    /// Source address of its datagrams.
    pub fn source(&self) -> SocketAddrV4 {
        SocketAddrV4::new(Ipv4Addr::from(self.get(ADDRESS) as u32), self.get(PORT) as u16)
    }

    /// Datagrams come from there from now on.
    pub fn set_source(&self, source: SocketAddrV4) {
        self.set(ADDRESS, Value::from(u32::from(*source.ip())));
        self.set(PORT, Value::from(source.port()));
    }

    /// True if this is the inode of its socket and it needs no datagrams.
    pub fn owns(&self, inode: u32) -> bool {
        self.get(INODE) as u32 == inode && self.get(PLAIN) == 0
    }

    /// Marks it as unable to read a ring: it listens to datagrams.
    pub fn set_plain(&self) {
        self.set(PLAIN, 1);
    }

    /// True if it needs datagrams.
    pub fn is_plain(&self) -> bool {
        self.get(PLAIN) != 0
    }

    /// True if it subscribes to anything, or did.
    pub fn reads(&self) -> bool {
        self.get(READS) != 0
    }

    /// Marks it as a subscriber.
    pub fn set_reads(&self) {
        self.set(READS, 1);
    }

    /// From this sequence number on its messages are datagrams only.
    pub fn retire(&self, sequence: u32) {
        self.set(RETIRED_AT, Value::from(sequence));
        self.set(RETIRED, 1);
    }

    /// True if it publishes datagrams only.
    pub fn has_retired(&self) -> bool {
        self.get(RETIRED) != 0
    }

    /// True if a message is a datagram only.
    pub fn retired(&self, sequence: u32) -> bool {
        self.has_retired() && sequence.wrapping_sub(self.get(RETIRED_AT) as u32) < 1 << 31
    }

    /// The folder's generation in which it left or was found dead; 0 before.
    pub fn ended(&self) -> Value {
        self.get(ENDED)
    }

    /// Marks it as departed or dead in this generation.
    pub fn set_ended(&self, generation: Value) {
        self.set(ENDED, generation);
    }

    /// The latest generation of the folder of which it has read all rings to their ends.
    pub fn drained(&self) -> Value {
        self.get(DRAINED)
    }

    /// Marks that it has read all rings of this generation.
    pub fn set_drained(&self, generation: Value) {
        self.set(DRAINED, generation);
        fence(Ordering::SeqCst);
    }

    /// The word of [`super::bell`] that says whether it sleeps.
    pub fn sleep(&self) -> &Word {
        self.word(SLEEP)
    }

    /// Its other word: whether it may have something left to read.
    pub fn awake(&self) -> &Word {
        self.word(AWAKE)
    }

    /// True if it may want a channel.
    pub fn wants(&self, Interest(bits): Interest) -> bool {
        bits.iter().all(|bit| {
            let word = self.word(INTEREST + bit / Value::BITS as usize).load(Ordering::Relaxed);
            word >> (bit % Value::BITS as usize) & 1 == 1
        })
    }

    /// Wants these channels, or (`None`) all.
    pub fn set_interest(&self, channels: Option<&[&str]>) {
        let mut bits = [if channels.is_some() { 0 } else { Value::MAX }; INTEREST_END - INTEREST];
        for Interest(channel) in channels.unwrap_or_default().iter().map(|channel| Interest::of(channel)) {
            for bit in channel {
                bits[bit / Value::BITS as usize] |= 1 << (bit % Value::BITS as usize);
            }
        }
        // Bits that stay are set in both: nothing that is wanted all along is missed in between.
        for (word, bits) in self.memory.words()[INTEREST..INTEREST_END].iter().zip(bits) {
            word.store(bits, Ordering::Relaxed);
        }
        fence(Ordering::SeqCst);
    }
}

/// State shared by all contexts of a bus: the generation of the folder, and the presence of other listeners.
#[derive(Debug)]
pub struct Board(Memory);

const GENERATION: usize = 0;
const LISTENERS: usize = 16;
const LOOKED_AT: usize = 32;

impl Board {
    /// Opens the board of a file that may still be empty.
    pub fn open(file: &File) -> io::Result<Self> {
        if file.metadata()?.len() < HEAD as u64 {
            file.set_len(HEAD as u64)?;
        }
        reserve(file, 0, HEAD)?;
        Memory::map(file, HEAD, Access::Write).map(Self)
    }

    /// True if its file was found cut short: then this context knows nothing of the others any more.
    pub fn is_cut(&self) -> bool {
        self.0.is_cut()
    }

    /// Goes up with every change in the folder.
    pub fn generation(&self) -> Value {
        self.0.words()[GENERATION].load(Ordering::Acquire)
    }

    /// Records a change of the folder; returns its generation, never 0.
    pub fn changed(&self) -> Value {
        self.0.words()[GENERATION].fetch_add(1, Ordering::SeqCst).wrapping_add(1).max(1)
    }

    /// Presence of other listeners, in the low bits of a word that changes with every update.
    pub fn listeners(&self) -> &Word {
        &self.0.words()[LISTENERS]
    }

    /// Start of the last check for listeners, ms of the monotonic clock.
    pub fn looked_at(&self) -> &Word {
        &self.0.words()[LOOKED_AT]
    }
}
