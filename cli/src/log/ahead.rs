//! Pieces of a log, read and unpacked by several threads, in the order in which they are needed.

use super::source::Mcap;
use crate::Failed;
use logger::read::{Ahead, Content, Loader};
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};

/// Maximum number of threads.
const THREADS_MAX: usize = 8;
/// Maximum size of the pieces that wait, bytes, while they are loaded as the index has it; at least one piece.
const BYTES_MAX: u64 = 8 << 20;

/// A piece: the place of its file, its place in that file's index, and its unpacked size, bytes.
type Place = (usize, usize, u64);

struct Pieces {
    files: Vec<(PathBuf, Arc<logger::read::Index>)>,
    /// In the order in which they are needed.
    order: Vec<Place>,
    /// Maximum number of pieces that are loaded or wait.
    count_max: usize,
    state: Mutex<State>,
    /// The next piece is loaded.
    ready: Condvar,
    /// A piece was taken, or no more are wanted.
    room: Condvar,
}

#[derive(Default)]
struct State {
    /// Number of pieces that threads have begun with, and that were taken.
    begun: usize,
    taken: usize,
    /// Size of those in between, bytes.
    bytes: u64,
    /// Loaded ones, by their place in the order, each with its size as it counts in `bytes`.
    loaded: BTreeMap<usize, (u64, io::Result<Content>)>,
    /// Memory of pieces that were used.
    spare: Vec<Vec<u8>>,
    /// True if no more pieces are wanted.
    closed: bool,
}

impl Pieces {
    /// A thread that panicked ends the process; there is no poison to fear.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Next piece for a thread, and memory for it; waits while enough of them wait. `None` if there are no more.
    fn begin(&self) -> Option<(usize, Place, Vec<u8>)> {
        let mut state = self.lock();
        loop {
            let at = state.begun;
            let place = *self.order.get(at).filter(|_| !state.closed)?;
            let waiting = at - state.taken;
            if waiting == 0 || waiting < self.count_max && state.bytes.saturating_add(place.2) <= BYTES_MAX {
                state.begun += 1;
                state.bytes = state.bytes.saturating_add(place.2);
                let space = state.spare.pop().unwrap_or_default();
                return Some((at, place, space));
            }
            state = self.room.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Work of a thread.
    fn work(&self) {
        let mut loader = Loader::default();
        let mut open: Option<(usize, File)> = None;
        while let Some((at, (file, piece, bytes), space)) = self.begin() {
            let load = || {
                let (path, index) = &self.files[file];
                if open.as_ref().is_none_or(|(place, _)| *place != file) {
                    open = Some((file, File::open(path)?));
                }
                let (_, inner) = open.as_mut().ok_or(io::ErrorKind::NotFound)?;
                loader.load(inner, &index.pieces[piece], space)
            };
            let content = load();
            let mut state = self.lock();
            // The index may be wrong.
            let actual = content.as_ref().map_or(0, Content::size);
            state.bytes = state.bytes.saturating_sub(bytes).saturating_add(actual);
            state.loaded.insert(at, (actual, content));
            let is_next = at == state.taken;
            drop(state);
            if is_next {
                self.ready.notify_one();
            }
        }
    }
}

/// The threads.
pub struct Threads {
    pieces: Arc<Pieces>,
    threads: Vec<JoinHandle<()>>,
}

impl Threads {
    /// Starts a thread for each processor; `None` if there is one only. `order` is [`logger::read::Messages::pending`].
    pub fn start(files: &[Mcap], order: &[(usize, usize)]) -> Result<Option<Self>, Failed> {
        let count = thread::available_parallelism().map_or(1, usize::from).min(THREADS_MAX).min(order.len());
        if count < 2 {
            return Ok(None);
        }
        let place = |&(file, piece): &(usize, usize)| (file, piece, files[file].index.pieces[piece].expanded);
        let pieces = Arc::new(Pieces {
            files: files.iter().map(|file| (file.path.clone(), file.index.clone())).collect(),
            order: order.iter().map(place).collect(),
            count_max: 4 * count,
            state: Mutex::default(),
            ready: Condvar::new(),
            room: Condvar::new(),
        });
        let mut threads = Self { pieces, threads: Vec::new() };
        for _ in 0..count {
            let pieces = threads.pieces.clone();
            let thread = thread::Builder::new().name("log unpacker".into()).spawn(move || pieces.work());
            threads.threads.push(thread.map_err(|error| Failed::from(format!("a thread: {error}")))?);
        }
        Ok(Some(threads))
    }
}

impl Ahead for Threads {
    fn next(&mut self, file: usize, piece: usize, space: Vec<u8>) -> io::Result<Content> {
        let mut state = self.pieces.lock();
        if space.capacity() > 0 && state.spare.len() < self.pieces.count_max {
            state.spare.push(space);
        }
        let at = state.taken;
        let place = self.pieces.order.get(at).filter(|place| (place.0, place.1) == (file, piece));
        place.ok_or_else(|| io::Error::other("a piece out of order"))?;
        loop {
            if let Some((bytes, content)) = state.loaded.remove(&at) {
                state.taken += 1;
                state.bytes = state.bytes.saturating_sub(bytes);
                drop(state);
                self.pieces.room.notify_one();
                return content;
            }
            state = self.pieces.ready.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl Drop for Threads {
    fn drop(&mut self) {
        self.pieces.lock().closed = true;
        self.pieces.room.notify_all();
        self.threads.drain(..).for_each(|thread| drop(thread.join()));
    }
}

#[cfg(test)]
mod tests {
    use crate::log::select::{Select, Selection};
    use crate::log::source::{Items, Log};
    use mcap::{Compression, WriteOptions};
    use std::fs::{self, File};
    use std::path::PathBuf;

    /// A run of two files whose chunks overlap in time, with a damaged one in the middle of the first.
    fn run() -> PathBuf {
        let folder = std::env::temp_dir().join(format!("advee-ahead-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        for (file, compression) in [(0, Compression::Zstd), (1, Compression::Lz4)] {
            let path = folder.join(format!("log_{file:03}.mcap"));
            let options = WriteOptions::new()
                .compression(Some(compression))
                .chunk_size(Some(4 << 10))
                .emit_message_indexes(false);
            let mut writer = options.create(File::create(&path).unwrap()).unwrap();
            let channel = writer.add_channel(0, "TEST", "lcm", &Default::default()).unwrap();
            for n in 0..5000_u32 {
                let log_time = u64::from(n) * 1000 + file;
                let header =
                    mcap::records::MessageHeader { channel_id: channel, sequence: n, log_time, publish_time: 0 };
                writer.write_to_known_channel(&header, &[n.to_le_bytes(), (n / 7).to_le_bytes()].concat()).unwrap();
            }
            writer.finish().unwrap();
        }
        let path = folder.join("log_000.mcap");
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 3;
        bytes[middle..middle + 8].copy_from_slice(b"damaged!");
        fs::write(&path, bytes).unwrap();
        folder
    }

    /// Log time, sequence number, data.
    type Read = (u64, u32, Vec<u8>);

    fn read(mut items: Items) -> (Vec<Read>, Option<String>) {
        let mut messages = Vec::new();
        while let Some(item) = items.next().unwrap() {
            messages.push((item.log_time, item.sequence, item.data.to_vec()));
        }
        (messages, items.left_out())
    }

    #[test]
    fn threads_that_read_ahead_change_neither_messages_nor_counts() {
        let folder = run();
        let log = Log::open(&folder).unwrap();
        let selection = Selection::of(&Select::default(), &log).unwrap();
        let (one, left_out) = read(log.items(&selection).unwrap());
        let ahead = read(log.items_ahead(&selection).unwrap());
        // Not read to its end: the threads end with it.
        assert!(log.items_ahead(&selection).unwrap().next().unwrap().is_some());
        fs::remove_dir_all(&folder).unwrap();
        assert!(one.len() > 9000 && one.len() < 10_000, "{}", one.len());
        assert!(one.is_sorted_by_key(|(time, ..)| *time));
        assert!(left_out.as_ref().is_some_and(|text| text.contains("1 damaged chunks")), "{left_out:?}");
        assert!(ahead == (one, left_out));
    }
}
