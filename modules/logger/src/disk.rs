//! What waits for the disk, what it is asked, and room on it.
//!
//! One request at a time: what is appended stands in the order in which it was made, and what failed is asked again as it
//! was. Pieces that come faster than the disk takes them leave as one.
//!
//! Durability: a piece is synchronized when something in it, or before it, is older than [`SYNC_AGE`], and at the latest
//! [`SYNC_BY`] after that was heard; so a power cut costs [`SYNC_BY`], what the request takes that is being served then,
//! and one synchronization.

use crate::names;
use base::store::{Answer, Entry, Request, Trouble};
use base::{Duration, Instant};
use std::collections::{BTreeSet, VecDeque};
use std::mem;
use std::sync::Arc;

/// A piece with something as old as this is synchronized.
const SYNC_AGE: Duration = Duration::from_millis(150);
/// What was heard so long ago is synchronized whatever else there is to do.
const SYNC_BY: Duration = Duration::from_millis(200);
/// Pieces leave together up to this many bytes.
const TOGETHER: usize = 1 << 20;
/// A disk that refused something is asked again after this time.
const AGAIN: Duration = Duration::from_secs(1);
/// One that refuses this often in a row for no known reason takes nothing more for this file.
const REFUSALS_MAX: u32 = 3;
/// How often a full disk is looked at.
const LOOK: Duration = Duration::from_secs(5);
/// What a full disk must have free beside what waits for it.
const SPARE: u64 = 1 << 20;

/// What the module learns from an answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum News {
    /// What is there is known: a file may be begun.
    Known,
    /// The file that was asked for last is there.
    Begun,
    /// It cannot be, as it was asked for.
    NotBegun,
    /// So much more is in the file.
    Wrote(u64),
    /// It takes nothing more for the file that is being written.
    Lost,
    /// There is less free than there should be, and nothing more to remove: the file should be brought to its end.
    Full,
}

/// A piece of a file.
#[derive(Clone, Debug)]
struct Piece {
    bytes: Arc<Vec<u8>>,
    /// When the oldest message in it was heard.
    oldest: Instant,
    messages: u64,
    /// It is the last of its file: it is synchronized whatever its age.
    last: bool,
}

#[derive(Clone, Debug)]
enum Job {
    Create { name: String, awaited: bool },
    Append(Piece),
}

/// What was asked and is not answered.
#[derive(Clone, Debug)]
enum Asked {
    Job(Job, bool),
    Sync,
    List,
    Remove(String),
}

/// Whether there is room.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Room {
    Enough,
    /// Find out what is there; `hard` when the disk has refused something as full.
    Look {
        hard: bool,
    },
    /// Remove these, the last first.
    Remove {
        victims: Vec<String>,
        hard: bool,
    },
    /// Nothing to be removed; look again then.
    Full {
        until: Instant,
    },
}

/// The disk.
#[derive(Debug)]
pub struct Disk {
    keep_free: u64,
    keep_runs: u64,
    up: bool,
    known: bool,
    asked: Option<Asked>,
    jobs: VecDeque<Job>,
    /// Bytes that wait, those being appended among them.
    waiting: usize,
    /// The oldest message that was appended and may be gone after a power cut.
    unsynced: Option<Instant>,
    held_until: Option<Instant>,
    refusals: u32,
    trouble: Option<Trouble>,
    room: Room,
    free: u64,
    entries: Vec<Entry>,
    /// A run that is never removed.
    always: Option<String>,
    /// Those that are not removed: this one, the current one, and what could not be.
    kept: BTreeSet<String>,
}

impl Disk {
    pub fn new(keep_free: u64, keep_runs: u64, always: Option<String>) -> Self {
        Self {
            keep_free,
            keep_runs,
            up: false,
            known: false,
            asked: None,
            jobs: VecDeque::new(),
            waiting: 0,
            unsynced: None,
            held_until: None,
            refusals: 0,
            trouble: None,
            room: Room::Enough,
            free: 0,
            entries: Vec::new(),
            kept: always.iter().cloned().collect(),
            always,
        }
    }

    /// The folder can be asked.
    pub fn up(&mut self) {
        *self = Self { up: true, room: Room::Look { hard: false }, ..self.emptied() };
    }

    /// It cannot: what waited for it is lost. So many messages were in that.
    pub fn down(&mut self) -> u64 {
        let lost = self.abandon();
        *self = self.emptied();
        lost
    }

    fn emptied(&mut self) -> Self {
        let new = Self::new(self.keep_free, self.keep_runs, self.always.clone());
        Self { kept: mem::take(&mut self.kept), entries: mem::take(&mut self.entries), free: self.free, ..new }
    }

    /// Gives up what waits for the file; so many messages were in it.
    pub fn abandon(&mut self) -> u64 {
        let messages = |job: &Job| if let Job::Append(piece) = job { piece.messages } else { 0 };
        let on_its_way = if let Some(Asked::Job(job, _)) = &self.asked { messages(job) } else { 0 };
        let lost = self.jobs.iter().map(messages).sum::<u64>() + on_its_way;
        self.jobs.clear();
        self.waiting = 0;
        self.unsynced = None;
        self.held_until = None;
        self.refusals = 0;
        lost
    }

    /// Bytes that wait for the disk.
    pub fn waiting(&self) -> usize {
        self.waiting
    }

    /// Bytes that are free, as the disk said last.
    pub fn free(&self) -> u64 {
        self.free
    }

    /// Why it takes nothing now, if that is so.
    pub fn trouble(&self) -> Option<&Trouble> {
        match self.room {
            Room::Full { .. } => Some(&Trouble::Full),
            _ => self.trouble.as_ref(),
        }
    }

    /// Whether a file may be begun.
    pub fn is_ready(&self) -> bool {
        self.up
            && self.known
            && self.jobs.is_empty()
            && self.asked.is_none()
            && self.held_until.is_none()
            && self.room == Room::Enough
    }

    /// Whether everything is written that can be.
    pub fn is_idle(&self) -> bool {
        !self.up || self.trouble.is_some() || (self.asked.is_none() && self.jobs.is_empty())
    }

    /// Whether there is anything of that name.
    pub fn has(&self, name: &str) -> bool {
        self.entries.iter().any(|entry| entry.name == name)
    }

    /// That this run is not removed from now on, and others than the one that never is may be.
    pub fn keep(&mut self, run: &str) {
        self.kept = self.always.iter().cloned().chain([run.to_owned()]).collect();
    }

    /// A file is to be made, of this run. What is appended before that is done goes there; `awaited` when nothing is.
    pub fn create(&mut self, run: &str, number: u32, awaited: bool) {
        if !self.has(run) {
            self.entries.push(Entry { name: run.into(), bytes: 0 });
        }
        self.jobs.push_back(Job::Create { name: names::file(run, number), awaited });
        // What is there is known well enough only now and then.
        if self.room == Room::Enough && !awaited {
            self.room = Room::Look { hard: false };
        }
    }

    /// What was appended last is the last of its file.
    pub fn close(&mut self) {
        if let Some(Job::Append(piece)) = self.jobs.back_mut() {
            piece.last = true;
        }
    }

    /// Something is to be appended, with so many messages, the oldest heard at `oldest`.
    pub fn append(&mut self, bytes: Vec<u8>, oldest: Instant, messages: u64) {
        self.waiting += bytes.len();
        if let Some(Job::Append(piece)) = self.jobs.back_mut()
            && piece.bytes.len() + bytes.len() <= TOGETHER
            // A piece that is asked for again is as it was.
            && let Some(together) = Arc::get_mut(&mut piece.bytes)
        {
            together.extend_from_slice(&bytes);
            piece.oldest = piece.oldest.min(oldest);
            piece.messages += messages;
            return;
        }
        self.jobs.push_back(Job::Append(Piece { bytes: Arc::new(bytes), oldest, messages, last: false }));
    }

    /// When something is to be done.
    pub fn poll_timeout(&self) -> Option<Instant> {
        if !self.up || self.asked.is_some() {
            return None;
        }
        let look = if let Room::Full { until } = self.room { Some(until) } else { None };
        let sync = self.unsynced.map(|oldest| oldest + SYNC_BY);
        self.held_until.or_else(|| look.into_iter().chain(sync).min())
    }

    /// Whether what was appended must be synchronized now, and nothing waits that could be with it: the chunk that is
    /// open, if there is one, should be closed.
    pub fn sync_is_due(&self, now: Instant) -> bool {
        let due = self.unsynced.is_some_and(|oldest| oldest + SYNC_BY <= now);
        due && self.up && self.asked.is_none() && self.jobs.is_empty() && self.held_until.is_none()
    }

    /// What is to be asked now, if anything.
    pub fn poll_request(&mut self, now: Instant) -> Option<Request> {
        if !self.up || self.asked.is_some() {
            return None;
        }
        let asked = self.next(now)?;
        let request = match &asked {
            Asked::Job(Job::Create { name, .. }, _) => Request::Create { name: name.clone() },
            Asked::Job(Job::Append(piece), sync) => Request::Append { bytes: piece.bytes.clone(), sync: *sync },
            Asked::Sync => Request::Append { bytes: Arc::default(), sync: true },
            Asked::List => Request::List,
            Asked::Remove(name) => Request::Remove { name: name.clone() },
        };
        self.asked = Some(asked);
        Some(request)
    }

    fn next(&mut self, now: Instant) -> Option<Asked> {
        if self.held_until.is_some_and(|until| now < until) {
            return None;
        }
        self.held_until = None;
        match &mut self.room {
            Room::Look { .. } => return Some(Asked::List),
            Room::Full { until } if *until <= now => return Some(Asked::List),
            Room::Remove { victims, .. } => {
                if let Some(victim) = victims.pop() {
                    return Some(Asked::Remove(victim));
                }
            }
            Room::Enough | Room::Full { .. } => {}
        }
        match self.jobs.pop_front() {
            Some(Job::Append(piece)) => {
                let oldest = self.unsynced.map_or(piece.oldest, |unsynced| unsynced.min(piece.oldest));
                let sync = piece.last || oldest + SYNC_AGE <= now;
                Some(Asked::Job(Job::Append(piece), sync))
            }
            Some(job) => Some(Asked::Job(job, false)),
            None => self.sync_is_due(now).then_some(Asked::Sync),
        }
    }

    /// Takes the answer to what was asked.
    pub fn answered(&mut self, now: Instant, answer: &Answer) -> Option<News> {
        let asked = self.asked.take()?;
        match answer {
            Answer::Done { free } => self.done(now, asked, *free),
            Answer::Listed { entries, free } => self.listed(now, entries, *free),
            Answer::Failed(trouble) => self.failed(now, asked, trouble),
        }
    }

    fn done(&mut self, now: Instant, asked: Asked, free: u64) -> Option<News> {
        self.free = free;
        if !matches!(asked, Asked::Remove(_)) {
            self.trouble = None;
            self.refusals = 0;
        }
        let news = match asked {
            Asked::Job(Job::Create { awaited, .. }, _) => {
                self.unsynced = None;
                awaited.then_some(News::Begun)
            }
            Asked::Job(Job::Append(piece), sync) => {
                self.waiting = self.waiting.saturating_sub(piece.bytes.len());
                let oldest = self.unsynced.map_or(piece.oldest, |unsynced| unsynced.min(piece.oldest));
                self.unsynced = (!sync).then_some(oldest);
                Some(News::Wrote(piece.bytes.len() as u64))
            }
            Asked::Sync => {
                self.unsynced = None;
                None
            }
            Asked::Remove(name) => {
                self.entries.retain(|entry| entry.name != name);
                return self.removed(now);
            }
            Asked::List => None,
        };
        if self.free < self.keep_free && self.room == Room::Enough {
            self.room = Room::Look { hard: false };
        }
        news
    }

    /// After something was removed, or could not be.
    fn removed(&mut self, now: Instant) -> Option<News> {
        let Room::Remove { victims, hard } = &self.room else { return None };
        if !victims.is_empty() {
            return None;
        }
        // One that is full by its own word is asked again; else what is free now decides.
        let full = !hard && self.free < self.keep_free;
        self.room = if full { Room::Full { until: now + LOOK } } else { Room::Enough };
        full.then_some(News::Full)
    }

    fn listed(&mut self, now: Instant, entries: &[Entry], free: u64) -> Option<News> {
        (self.entries, self.free) = (entries.to_vec(), free);
        let first = !mem::replace(&mut self.known, true);
        if self.jobs.is_empty() {
            self.trouble = None;
        }
        let hard = self.room == (Room::Look { hard: true });
        // Who has stopped for want of room goes on only when that lasts a while.
        let margin = if matches!(self.room, Room::Full { .. }) { self.keep_free / 10 + SPARE } else { 0 };
        let wanted = self.keep_free.saturating_add(margin);
        let victims = self.victims(wanted, hard);
        let short = free < wanted || (hard && victims.is_empty());
        self.room = match (victims.is_empty(), short) {
            (false, _) => Room::Remove { victims, hard },
            (true, true) => Room::Full { until: now + LOOK },
            (true, false) => Room::Enough,
        };
        match self.room {
            // What is refused as full with nothing to remove will not be taken.
            Room::Full { .. } if hard => Some(News::Lost),
            Room::Full { .. } => Some(News::Full),
            _ => first.then_some(News::Known),
        }
    }

    /// Runs that must go, the oldest last.
    fn victims(&self, wanted: u64, hard: bool) -> Vec<String> {
        let mut runs: Vec<&Entry> = self.entries.iter().filter(|entry| names::place(&entry.name).is_some()).collect();
        runs.sort_by_key(|entry| names::place(&entry.name));
        let mut total: u64 = runs.iter().fold(0, |sum, entry| sum.saturating_add(entry.bytes));
        // Beside the floor what waits must find room, too.
        let spare = if hard { self.waiting as u64 + SPARE } else { 0 };
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

    fn failed(&mut self, now: Instant, asked: Asked, trouble: &Trouble) -> Option<News> {
        if let Asked::Remove(name) = asked {
            // It is not tried for ever.
            self.kept.insert(name);
            return self.removed(now);
        }
        self.trouble = Some(trouble.clone());
        self.held_until = Some(now + AGAIN);
        let awaited = matches!(asked, Asked::Job(Job::Create { awaited: true, .. }, _));
        match asked {
            Asked::Job(job, _) if !awaited => self.jobs.push_front(job),
            Asked::List => return None,
            _ => {}
        }
        match trouble {
            Trouble::Full => {
                self.held_until = None;
                self.room = Room::Look { hard: true };
                awaited.then_some(News::NotBegun)
            }
            _ if awaited => Some(News::NotBegun),
            Trouble::ReadOnly => None,
            Trouble::Other(_) => {
                self.refusals += 1;
                (self.refusals >= REFUSALS_MAX).then_some(News::Lost)
            }
        }
    }
}
