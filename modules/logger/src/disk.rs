//! Write queue of the logger: data waiting for the disk, requests to the store, and free space.
//!
//! One request at a time: data is appended in the order in which it was produced, and a failed request is repeated
//! unchanged. Pieces that arrive faster than the disk accepts them are merged.
//!
//! Durability: a piece is synchronized when it, or one before it, contains a message older than [`SYNC_AGE`], and at
//! the latest [`SYNC_DEADLINE`] after the message was received. A power cut therefore costs [`SYNC_DEADLINE`], the
//! duration of the request in progress, and one synchronization.

use crate::names;
use base::store::{Answer, Entry, Request, Trouble};
use base::{Duration, Instant};
use std::collections::{BTreeSet, VecDeque};
use std::mem;
use std::sync::Arc;

/// Age of a piece's oldest message from which it is synchronized.
const SYNC_AGE: Duration = Duration::from_millis(150);
/// Age of an unsynchronized message after which synchronization takes precedence over other work.
const SYNC_DEADLINE: Duration = Duration::from_millis(200);
/// Maximum size of merged pieces, bytes.
const MERGED_BYTES_MAX: usize = 1 << 20;
/// Delay before a failed request is repeated.
const RETRY_DELAY: Duration = Duration::from_secs(1);
/// Number of consecutive failures without a known cause after which the file is given up.
const REFUSALS_MAX: u32 = 3;
/// Period at which a full disk is checked.
const FULL_CHECK_PERIOD: Duration = Duration::from_secs(5);
/// Free space that a full disk needs beyond the data waiting for it, bytes.
const SPARE_BYTES: u64 = 1 << 20;

/// Result of an answer for the module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DiskEvent {
    /// The content of the folder is known: a file may be created.
    Listed,
    /// The last requested file was created.
    Created,
    /// The last requested file cannot be created under its name.
    NotCreated,
    /// Number of bytes appended to the file.
    Written(u64),
    /// The disk accepts nothing more for the current file.
    FileLost,
    /// Free space is below the limit and nothing can be removed: the file should be closed.
    Full,
}

/// Piece of a file.
#[derive(Clone, Debug)]
struct Piece {
    bytes: Arc<Vec<u8>>,
    /// Reception of the oldest message in it.
    oldest: Instant,
    messages: u64,
    /// True for the last piece of a file, which is synchronized whatever its age.
    last: bool,
}

#[derive(Clone, Debug)]
enum Job {
    Create { name: String, awaited: bool },
    Append(Piece),
}

/// Request in progress.
#[derive(Clone, Debug)]
enum Pending {
    Job(Job, bool),
    Sync,
    List,
    Remove(String),
}

/// State of the free space.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
enum Room {
    #[default]
    Enough,
    /// List the folder; `hard` if the disk reported that it is full.
    List { hard: bool },
    /// Remove these runs, the last first.
    Remove { victims: Vec<String>, hard: bool },
    /// Nothing can be removed; list the folder again at this instant.
    Full { until: Instant },
}

/// Queue of requests to the disk.
#[derive(Debug, Default)]
pub struct Disk {
    keep_free: u64,
    keep_runs: u64,
    up: bool,
    known: bool,
    asked: Option<Pending>,
    jobs: VecDeque<Job>,
    /// Bytes waiting, including those being appended.
    waiting: usize,
    /// Oldest appended message that a power cut may lose.
    unsynced: Option<Instant>,
    held_until: Option<Instant>,
    refusals: u32,
    trouble: Option<Trouble>,
    room: Room,
    free: u64,
    entries: Vec<Entry>,
    /// Run that is never removed.
    always: Option<String>,
    /// Runs that are not removed: the protected one, the current one, and those that could not be removed.
    kept: BTreeSet<String>,
}

impl Disk {
    pub fn new(keep_free: u64, keep_runs: u64, always: Option<String>) -> Self {
        Self { keep_free, keep_runs, kept: always.iter().cloned().collect(), always, ..Self::default() }
    }

    /// The folder is available.
    pub fn up(&mut self) {
        *self = Self { up: true, room: Room::List { hard: false }, ..self.emptied() };
    }

    /// The folder is unavailable; the data waiting for it is lost. Returns the number of messages lost.
    pub fn down(&mut self) -> u64 {
        let lost = self.abandon();
        *self = self.emptied();
        lost
    }

    fn emptied(&mut self) -> Self {
        let new = Self::new(self.keep_free, self.keep_runs, self.always.clone());
        Self { kept: mem::take(&mut self.kept), entries: mem::take(&mut self.entries), free: self.free, ..new }
    }

    /// Discards the data waiting for the file. Returns the number of messages lost.
    pub fn abandon(&mut self) -> u64 {
        let messages = |job: &Job| if let Job::Append(piece) = job { piece.messages } else { 0 };
        let on_its_way = if let Some(Pending::Job(job, _)) = &self.asked { messages(job) } else { 0 };
        let lost = self.jobs.iter().map(messages).sum::<u64>() + on_its_way;
        self.jobs.clear();
        self.waiting = 0;
        self.unsynced = None;
        self.held_until = None;
        self.refusals = 0;
        lost
    }

    /// Bytes waiting for the disk.
    pub fn waiting(&self) -> usize {
        self.waiting
    }

    /// Free bytes, as last reported by the disk.
    pub fn free(&self) -> u64 {
        self.free
    }

    /// Reason why the disk accepts nothing at present.
    pub fn trouble(&self) -> Option<&Trouble> {
        match self.room {
            Room::Full { .. } => Some(&Trouble::Full),
            _ => self.trouble.as_ref(),
        }
    }

    /// True if a file may be created.
    pub fn is_ready(&self) -> bool {
        self.up
            && self.known
            && self.jobs.is_empty()
            && self.asked.is_none()
            && self.held_until.is_none()
            && self.room == Room::Enough
    }

    /// True if everything is written that can be.
    pub fn is_idle(&self) -> bool {
        !self.up || self.trouble.is_some() || (self.asked.is_none() && self.jobs.is_empty())
    }

    /// True if there is an entry of that name.
    pub fn has(&self, name: &str) -> bool {
        self.entries.iter().any(|entry| entry.name == name)
    }

    /// Protects this run from removal instead of the previous current one.
    pub fn keep(&mut self, run: &str) {
        self.kept = self.always.iter().cloned().chain([run.to_owned()]).collect();
    }

    /// Requests a file of this run. Data appended before it exists goes there; `awaited` if there is none.
    pub fn create(&mut self, run: &str, number: u32, awaited: bool) {
        if !self.has(run) {
            self.entries.push(Entry { name: run.into(), bytes: 0 });
        }
        self.jobs.push_back(Job::Create { name: names::file(run, number), awaited });
        // The listing is only recent enough from time to time.
        if self.room == Room::Enough && !awaited {
            self.room = Room::List { hard: false };
        }
    }

    /// Marks the last appended piece as the last of its file.
    pub fn close(&mut self) {
        if let Some(Job::Append(piece)) = self.jobs.back_mut() {
            piece.last = true;
        }
    }

    /// Appends data with `messages` messages, the oldest received at `oldest`.
    pub fn append(&mut self, bytes: Vec<u8>, oldest: Instant, messages: u64) {
        self.waiting += bytes.len();
        if let Some(Job::Append(piece)) = self.jobs.back_mut()
            && piece.bytes.len() + bytes.len() <= MERGED_BYTES_MAX
            // A repeated piece must not change.
            && let Some(together) = Arc::get_mut(&mut piece.bytes)
        {
            together.extend_from_slice(&bytes);
            piece.oldest = piece.oldest.min(oldest);
            piece.messages += messages;
            return;
        }
        self.jobs.push_back(Job::Append(Piece { bytes: Arc::new(bytes), oldest, messages, last: false }));
    }

    /// Next deadline.
    pub fn poll_timeout(&self) -> Option<Instant> {
        if !self.up || self.asked.is_some() {
            return None;
        }
        let look = if let Room::Full { until } = self.room { Some(until) } else { None };
        let sync = self.unsynced.map(|oldest| oldest + SYNC_DEADLINE);
        self.held_until.or_else(|| look.into_iter().chain(sync).min())
    }

    /// True if appended data must be synchronized now and no piece waits that could include it: the open chunk, if any,
    /// should be closed.
    pub fn sync_is_due(&self, now: Instant) -> bool {
        let due = self.unsynced.is_some_and(|oldest| oldest + SYNC_DEADLINE <= now);
        due && self.up && self.asked.is_none() && self.jobs.is_empty() && self.held_until.is_none()
    }

    /// Next request, if any.
    pub fn poll_request(&mut self, now: Instant) -> Option<Request> {
        if !self.up || self.asked.is_some() {
            return None;
        }
        let asked = self.next(now)?;
        let request = match &asked {
            Pending::Job(Job::Create { name, .. }, _) => Request::Create { name: name.clone() },
            Pending::Job(Job::Append(piece), sync) => Request::Append { bytes: piece.bytes.clone(), sync: *sync },
            Pending::Sync => Request::Append { bytes: Arc::default(), sync: true },
            Pending::List => Request::List,
            Pending::Remove(name) => Request::Remove { name: name.clone() },
        };
        self.asked = Some(asked);
        Some(request)
    }

    fn next(&mut self, now: Instant) -> Option<Pending> {
        if self.held_until.is_some_and(|until| now < until) {
            return None;
        }
        self.held_until = None;
        match &mut self.room {
            Room::List { .. } => return Some(Pending::List),
            Room::Full { until } if *until <= now => return Some(Pending::List),
            Room::Remove { victims, .. } => {
                if let Some(victim) = victims.pop() {
                    return Some(Pending::Remove(victim));
                }
            }
            Room::Enough | Room::Full { .. } => {}
        }
        match self.jobs.pop_front() {
            Some(Job::Append(piece)) => {
                let oldest = self.unsynced.map_or(piece.oldest, |unsynced| unsynced.min(piece.oldest));
                let sync = piece.last || oldest + SYNC_AGE <= now;
                Some(Pending::Job(Job::Append(piece), sync))
            }
            Some(job) => Some(Pending::Job(job, false)),
            None => self.sync_is_due(now).then_some(Pending::Sync),
        }
    }

    /// Processes the answer to the request in progress.
    pub fn answered(&mut self, now: Instant, answer: &Answer) -> Option<DiskEvent> {
        let asked = self.asked.take()?;
        match answer {
            Answer::Done { free } => self.done(now, asked, *free),
            Answer::Listed { entries, free } => self.listed(now, entries, *free),
            Answer::Failed(trouble) => self.failed(now, asked, trouble),
        }
    }

    fn done(&mut self, now: Instant, asked: Pending, free: u64) -> Option<DiskEvent> {
        self.free = free;
        if !matches!(asked, Pending::Remove(_)) {
            self.trouble = None;
            self.refusals = 0;
        }
        let news = match asked {
            Pending::Job(Job::Create { awaited, .. }, _) => {
                self.unsynced = None;
                awaited.then_some(DiskEvent::Created)
            }
            Pending::Job(Job::Append(piece), sync) => {
                self.waiting = self.waiting.saturating_sub(piece.bytes.len());
                let oldest = self.unsynced.map_or(piece.oldest, |unsynced| unsynced.min(piece.oldest));
                self.unsynced = (!sync).then_some(oldest);
                Some(DiskEvent::Written(piece.bytes.len() as u64))
            }
            Pending::Sync => {
                self.unsynced = None;
                None
            }
            Pending::Remove(name) => {
                self.entries.retain(|entry| entry.name != name);
                return self.removed(now);
            }
            Pending::List => None,
        };
        if self.free < self.keep_free && self.room == Room::Enough {
            self.room = Room::List { hard: false };
        }
        news
    }

    /// After an entry was removed or could not be.
    fn removed(&mut self, now: Instant) -> Option<DiskEvent> {
        let Room::Remove { victims, hard } = &self.room else { return None };
        if !victims.is_empty() {
            return None;
        }
        // A disk that reported full is asked again; otherwise the free space decides.
        let full = !hard && self.free < self.keep_free;
        self.room = if full { Room::Full { until: now + FULL_CHECK_PERIOD } } else { Room::Enough };
        full.then_some(DiskEvent::Full)
    }

    fn listed(&mut self, now: Instant, entries: &[Entry], free: u64) -> Option<DiskEvent> {
        (self.entries, self.free) = (entries.to_vec(), free);
        let first = !mem::replace(&mut self.known, true);
        if self.jobs.is_empty() {
            self.trouble = None;
        }
        let hard = self.room == (Room::List { hard: true });
        // After a stop for lack of space, recording continues only with a reserve.
        let margin = if matches!(self.room, Room::Full { .. }) { self.keep_free / 10 + SPARE_BYTES } else { 0 };
        let wanted = self.keep_free.saturating_add(margin);
        let victims = self.victims(wanted, hard);
        let short = free < wanted || (hard && victims.is_empty());
        self.room = match (victims.is_empty(), short) {
            (false, _) => Room::Remove { victims, hard },
            (true, true) => Room::Full { until: now + FULL_CHECK_PERIOD },
            (true, false) => Room::Enough,
        };
        match self.room {
            // A write refused as full with nothing to remove will not succeed.
            Room::Full { .. } if hard => Some(DiskEvent::FileLost),
            Room::Full { .. } => Some(DiskEvent::Full),
            _ => first.then_some(DiskEvent::Listed),
        }
    }

    /// Runs to remove, the oldest last.
    fn victims(&self, wanted: u64, hard: bool) -> Vec<String> {
        let mut runs: Vec<&Entry> = self.entries.iter().filter(|entry| names::place(&entry.name).is_some()).collect();
        runs.sort_by_key(|entry| names::place(&entry.name));
        let mut total: u64 = runs.iter().fold(0, |sum, entry| sum.saturating_add(entry.bytes));
        // The waiting data needs space beyond the limit, too.
        let spare = if hard { self.waiting as u64 + SPARE_BYTES } else { 0 };
        let (mut free, wanted) = (self.free, wanted.max(spare));
        let mut victims = Vec::new();
        for run in runs.into_iter().filter(|run| !self.kept.contains(&run.name)) {
            let needless = free >= wanted && total <= self.keep_runs && (!hard || !victims.is_empty());
            if needless {
                break;
            }
            free = free.saturating_add(run.bytes);
            total -= run.bytes;
            victims.push(run.name.clone());
        }
        victims.reverse();
        victims
    }

    fn failed(&mut self, now: Instant, asked: Pending, trouble: &Trouble) -> Option<DiskEvent> {
        if let Pending::Remove(name) = asked {
            // Not attempted again.
            self.kept.insert(name);
            return self.removed(now);
        }
        self.trouble = Some(trouble.clone());
        self.held_until = Some(now + RETRY_DELAY);
        let awaited = matches!(asked, Pending::Job(Job::Create { awaited: true, .. }, _));
        match asked {
            Pending::Job(job, _) if !awaited => self.jobs.push_front(job),
            Pending::List => return None,
            _ => {}
        }
        match trouble {
            Trouble::Full => {
                self.held_until = None;
                self.room = Room::List { hard: true };
                awaited.then_some(DiskEvent::NotCreated)
            }
            _ if awaited => Some(DiskEvent::NotCreated),
            Trouble::ReadOnly => None,
            Trouble::Other(_) => {
                self.refusals += 1;
                (self.refusals >= REFUSALS_MAX).then_some(DiskEvent::FileLost)
            }
        }
    }
}
