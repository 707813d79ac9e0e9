//! Messages of a log, read ahead by a thread: playback does not wait for the disk.

use super::select::Selection;
use super::source::{Item, Log};
use crate::Failed;
use logger::read::Schema;
use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Size of the read-ahead, bytes; at least one message.
const AHEAD_MAX: usize = 16 << 20;
/// Size of a batch, bytes, and in messages.
const BATCH_BYTES: usize = 256 << 10;
const BATCH_MESSAGES: usize = 4096;

/// Messages in a row.
#[derive(Default)]
pub struct Batch {
    heads: Vec<Head>,
    bytes: Vec<u8>,
}

struct Head {
    log_time: u64,
    publish_time: u64,
    sequence: u32,
    about: Arc<About>,
    data: Range<usize>,
}

/// Properties shared by many messages.
struct About {
    channel: String,
    encoding: String,
    schema: Option<Schema>,
    metadata: BTreeMap<String, String>,
    key: (usize, u16),
    /// Place among all of the feed, in order of their first messages.
    number: usize,
}

/// What a feed's messages have shared so far.
#[derive(Default)]
struct Known {
    by_channel: BTreeMap<String, Vec<Arc<About>>>,
    count: usize,
}

impl Batch {
    pub fn len(&self) -> usize {
        self.heads.len()
    }

    /// All messages, in order.
    pub fn items(&self) -> impl Iterator<Item = Item<'_>> {
        (0..self.len()).filter_map(|place| self.get(place))
    }

    /// All messages, in order; those of one channel and encoding of a file have the same number, counted from 0.
    pub fn numbered(&self) -> impl Iterator<Item = (usize, Item<'_>)> {
        self.items().zip(&self.heads).map(|(item, head)| (head.about.number, item))
    }

    /// Size in memory, bytes.
    pub fn size(&self) -> usize {
        self.bytes.capacity() + self.heads.capacity() * size_of::<Head>()
    }

    pub fn get(&self, place: usize) -> Option<Item<'_>> {
        let head = self.heads.get(place)?;
        Some(Item {
            log_time: head.log_time,
            publish_time: head.publish_time,
            sequence: head.sequence,
            channel: &head.about.channel,
            encoding: &head.about.encoding,
            schema: head.about.schema.as_ref(),
            metadata: &head.about.metadata,
            key: head.about.key,
            data: &self.bytes[head.data.clone()],
        })
    }
}

#[derive(Default)]
struct Queue {
    batches: VecDeque<Batch>,
    bytes: usize,
    progress: (u64, u64),
    left_out: Option<String>,
    failed: Option<Failed>,
    /// The reader has read all, or cannot go on.
    ended: bool,
    /// True if no more messages are wanted.
    closed: bool,
}

#[derive(Default)]
struct Shared {
    queue: Mutex<Queue>,
    changed: Condvar,
}

impl Shared {
    /// A thread that panicked ends the process; there is no poison to fear.
    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread, and what it has read.
pub struct Feed {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// Next item of a feed.
pub enum Fed {
    Batch(Batch),
    /// Nothing yet.
    Nothing,
    End,
}

impl Feed {
    pub fn start(log: &Arc<Log>, selection: &Selection) -> Result<Self, Failed> {
        let mut items = log.items_ahead(selection)?;
        let shared = Arc::new(Shared::default());
        let theirs = shared.clone();
        let read = move || {
            let mut known = Known::default();
            loop {
                let batch = fill(&mut items, &mut known);
                let mut queue = theirs.lock();
                queue.progress = items.progress();
                queue.left_out = items.left_out();
                match batch {
                    Ok(batch) if batch.heads.is_empty() => queue.ended = true,
                    Ok(batch) => {
                        queue.bytes += batch.bytes.len();
                        queue.batches.push_back(batch);
                    }
                    Err(failed) => (queue.failed, queue.ended) = (Some(failed), true),
                }
                theirs.changed.notify_all();
                while queue.bytes > AHEAD_MAX && !queue.closed {
                    queue = theirs.changed.wait(queue).unwrap_or_else(PoisonError::into_inner);
                }
                if queue.ended || queue.closed {
                    return;
                }
            }
        };
        let thread = thread::Builder::new().name("log reader".into()).spawn(read);
        let thread = thread.map_err(|error| Failed::from(format!("a thread: {error}")))?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Next item; waits for it up to `patience`.
    pub fn next(&self, patience: Duration) -> Result<Fed, Failed> {
        let mut queue = self.shared.lock();
        if queue.batches.is_empty() && !queue.ended {
            let waited = self.shared.changed.wait_timeout(queue, patience);
            queue = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        if let Some(batch) = queue.batches.pop_front() {
            queue.bytes -= batch.bytes.len();
            self.shared.changed.notify_all();
            return Ok(Fed::Batch(batch));
        }
        match queue.failed.take() {
            Some(failed) => Err(failed),
            None if queue.ended => Ok(Fed::End),
            None => Ok(Fed::Nothing),
        }
    }

    /// Bytes of the log read, and to be read.
    pub fn progress(&self) -> (u64, u64) {
        self.shared.lock().progress
    }

    /// Text about omitted parts so far.
    pub fn left_out(&self) -> Option<String> {
        self.shared.lock().left_out.clone()
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.shared.lock().closed = true;
        self.shared.changed.notify_all();
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

fn fill(items: &mut super::source::Items, known: &mut Known) -> Result<Batch, Failed> {
    let mut batch = Batch { heads: Vec::new(), bytes: Vec::with_capacity(BATCH_BYTES + BATCH_BYTES / 8) };
    while batch.bytes.len() < BATCH_BYTES && batch.heads.len() < BATCH_MESSAGES {
        let Some(item) = items.next()? else { break };
        let about = about(&item, known);
        let begin = batch.bytes.len();
        batch.bytes.extend_from_slice(item.data);
        let data = begin..batch.bytes.len();
        let Item { log_time, publish_time, sequence, .. } = item;
        batch.heads.push(Head { log_time, publish_time, sequence, about, data });
    }
    Ok(batch)
}

fn about(item: &Item<'_>, known: &mut Known) -> Arc<About> {
    let is = |about: &&Arc<About>| about.key == item.key && about.encoding == item.encoding;
    if let Some(about) = known.by_channel.get(item.channel).and_then(|same| same.iter().find(is)) {
        return about.clone();
    }
    let about = Arc::new(About {
        channel: item.channel.into(),
        encoding: item.encoding.into(),
        schema: item.schema.cloned(),
        metadata: item.metadata.clone(),
        key: item.key,
        number: known.count,
    });
    known.count += 1;
    known.by_channel.entry(item.channel.into()).or_default().push(about.clone());
    about
}
