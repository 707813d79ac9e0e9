//! A context's place on the shared-memory bus.

use super::bell::{self, EMPTIED_AFTER, Sleeper};
use super::folder::Folder;
use super::listeners::{Listeners, look};
use super::ring::{BUCKETS, Copy, Kind, Message, Read, Reader, Writer, bucket};
use super::station::{Board, Interest, Station};
use super::sync::{Ordering, Value};
use crate::live::sys;
use crate::origin::Process;
use crate::udpm::MESSAGE_MAX;
use crate::url::Udpm;
use nix::fcntl::{Flock, OFlag};
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::time::{ClockId, clock_gettime};
use nix::unistd::{pipe2, read, write};
use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::mem;
use std::net::SocketAddrV4;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::Path;
use std::sync::OnceLock;
use std::time::Duration;

/// Capacity of a FIFO, bytes.
const BELL_SIZE: usize = 64 << 10;
/// Folder of shared memory.
const ROOT: &str = "/dev/shm";
/// Validity of a check for other listeners, ms.
const LOOK_MS: Value = 1000;
/// Age of the last check from which a thread with a real-time priority sends datagrams, too. It never checks by itself:
/// that takes 2 ms on a small processor, and other threads do it.
const OVERDUE_MS: Value = 2 * LOOK_MS;
/// Maximum time by which another's look may be later than the time that was taken here, ms. Words of 32 bits come
/// around after 50 days: any other age is that of a bus on which nobody has published for as long.
const AHEAD_MS: Value = 60_000;
/// Maximum number of records that one [`Bus::recv`] passes over before it returns.
const PASSED_MAX: usize = 4096;
/// Cost of a payload that could not be fetched from its file, in such records: a system call or three.
const FETCH_COST: usize = 16;
/// Maximum number of attempts to join.
const JOIN_TRIES: u32 = 10;
/// Messages in a row from one ring.
const TURN: u32 = 32;
/// Time for which datagrams of a publisher that has left may still arrive, ns.
const LATE_NS: i64 = 2_000_000_000;
/// Maximum number of stations that are followed; others are received by datagrams.
const STATIONS_MAX: usize = 1024;
/// Bytes and number of the payloads in files of their own that stay readable.
const ASIDE: (usize, usize) = (64 << 20, 8);
/// Lifetime of such files, ms.
const ASIDE_MS: Value = 5000;

/// A context's place on the shared-memory bus: its own station, and those of the others.
#[derive(Debug)]
pub struct Bus {
    folder: Folder,
    board: Board,
    name: String,
    /// Locked until this context leaves.
    file: Option<Flock<File>>,
    station: Station,
    /// It subscribes to something, or did. Others read that, and the next, in the station; a context itself never does:
    /// the station may have been truncated.
    reads: bool,
    /// It needs datagrams.
    plain: bool,
    /// Its board was truncated, or the folder could not be listed, so it does not learn of all who come: those that it
    /// does not know yet are received by datagrams.
    blind: bool,
    bus: SocketAddrV4,
    ttl: u8,
    /// Everybody's stations, the own one too.
    peers: Vec<Peer>,
    /// The generation of `peers`.
    generation: Value,
    left: Vec<Left>,
    /// Publishers that went over to datagrams: their files were truncated, or they have retired and left.
    cut: Vec<Left>,
    /// Publishers of other users who were found dead, with the generation of that: they cannot be marked.
    found_dead: Vec<(String, Value)>,
    /// Stations that could not be opened when they were found: they are reached, and received, by datagrams. They are
    /// not opened later, since the messages in their rings may have been received as datagrams.
    unopened: Vec<String>,
    writer: Writer,
    /// Bytes of the own ring that have memory behind them.
    reserved: usize,
    asides: VecDeque<Aside>,
    retired: bool,
    bell: OwnedFd,
    sleeper: Sleeper,
    /// Number of sleeps until the bell is emptied.
    empty_in: u32,
    /// Something was received since the latest sleep.
    received: bool,
    /// The latest [`Bus::recv`] did not come to the end.
    busy: bool,
    /// True if the ring of a departed peer was read to its end since the latest sleep.
    buried: bool,
    /// By bucket, what may be wanted.
    buckets: Box<[bool; BUCKETS]>,
    turn: usize,
    in_turn: u32,
    copy: Copy,
    /// Publisher of the message in `copy`.
    from: Option<Process>,
    lost: u64,
}

#[derive(Debug)]
struct Peer {
    name: String,
    station: Station,
    source: SocketAddrV4,
    process: Option<Process>,
    /// While this context subscribes.
    reader: Option<Reader>,
    bell: Option<OwnedFd>,
    /// The sleep for which its bell was rung last from here, if it is another user's and cannot be marked as woken.
    rung: Option<Value>,
    /// The sleep during which something was written that it wants: it has not read all, whether it was woken or not.
    behind: Option<Value>,
    /// Sequence number up to which all was taken, from the ring or as datagrams.
    taken: Option<u32>,
    /// True if it will publish nothing more.
    ended: bool,
}

/// A publisher whose ring was read to its end, or can no longer be read.
#[derive(Debug)]
struct Left {
    name: String,
    source: SocketAddrV4,
    process: Option<Process>,
    taken: Option<u32>,
    at: i64,
}

/// A payload in a file of its own.
#[derive(Debug)]
struct Aside {
    sequence: u32,
    len: usize,
    at: Value,
}

impl Bus {
    /// Joins the bus of a URL. `source` is where the datagrams of this context come from, `inode` that of its receive
    /// socket, which must not be bound yet.
    ///
    /// # Errors
    /// There is no usable shared memory; then datagrams are all there is.
    pub fn join(url: &Udpm, source: SocketAddrV4, inode: u32) -> io::Result<Self> {
        Self::join_in(Path::new(ROOT), url, source, inode)
    }

    pub(super) fn join_in(root: &Path, url: &Udpm, source: SocketAddrV4, inode: u32) -> io::Result<Self> {
        let mut tries = 1..=JOIN_TRIES;
        loop {
            match Self::try_join(root, url, source, inode) {
                // The last of the others left at the same time and took the folder with it; or another one that joins
                // looked whether the owner of the new station is dead before it was locked.
                Err(error)
                    if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::WouldBlock)
                        && tries.next().is_some() => {}
                result => return result,
            }
        }
    }

    fn try_join(root: &Path, url: &Udpm, source: SocketAddrV4, inode: u32) -> io::Result<Self> {
        let folder = Folder::open(root, url)?;
        let (board_file, lock) = folder.board()?;
        let board = Board::open(&board_file)?;
        folder.clean()?;
        let name = format!("{}-{:x}", std::process::id(), realtime());
        let file = folder.create(&name)?;
        let made = Station::create(&file, source, inode).and_then(|station| {
            let bell = folder.create_bell(&name)?;
            folder.show(&name)?;
            Ok((station, bell))
        });
        let joined =
            made.and_then(
                |made| if folder.has_board(&board_file) { Ok(made) } else { Err(io::ErrorKind::NotFound.into()) },
            );
        let (station, bell) = joined.inspect_err(|_| folder.remove(&name))?;
        board.changed();
        drop(lock);
        let writer = Writer::new(station.ring());
        let mut bus = Self {
            folder,
            board,
            name,
            file: Some(file),
            station,
            reads: false,
            plain: false,
            blind: false,
            bus: url.address(),
            ttl: url.ttl,
            peers: Vec::new(),
            generation: 0,
            left: Vec::new(),
            cut: Vec::new(),
            found_dead: Vec::new(),
            unopened: Vec::new(),
            writer,
            reserved: 0,
            asides: VecDeque::new(),
            retired: false,
            bell,
            sleeper: Sleeper::default(),
            empty_in: 0,
            received: false,
            busy: false,
            buried: false,
            buckets: Box::new([false; BUCKETS]),
            turn: 0,
            in_turn: 0,
            copy: Copy::default(),
            from: None,
            lost: 0,
        };
        bus.scan();
        bus.census();
        Ok(bus)
    }

    /// Datagrams of this context come from elsewhere from now on. Call it before the first one.
    pub fn moved(&mut self, source: SocketAddrV4) {
        self.station.set_source(source);
        self.board.changed();
    }

    // Publishing

    /// Writes a message to the ring and wakes who wants it. The result: a datagram is needed, too. Never waits.
    pub fn publish(&mut self, sequence: u32, channel: &str, payload: &[u8], at: i64) -> bool {
        self.refresh();
        if !self.retired {
            if self.write(sequence, channel, payload, at).is_err() || self.station.is_cut() {
                self.retire(sequence);
            } else if self.board.is_cut() {
                // This one is in the ring.
                self.retire(sequence.wrapping_add(1));
            }
        }
        bell::written();
        // A reader that came since may sleep already: then its coming is seen here.
        if self.board.generation() != self.generation {
            self.scan();
        }
        let interest = Interest::of(channel);
        let mut deaf = !self.unopened.is_empty();
        for peer in &mut self.peers {
            if let Some(sleep) = bell::asleep(peer.station.sleep())
                && peer.station.wants(interest)
            {
                peer.behind = Some(sleep);
                // A datagram wakes it, too.
                deaf |= !peer.ring(&self.folder, sleep);
            }
            // The one cannot say whether it sleeps, the other has perhaps not found this ring.
            deaf |= peer.station.is_cut() || peer.station.is_plain();
        }
        self.mirror(sequence) || deaf
    }

    /// Fails where memory does.
    fn write(&mut self, sequence: u32, channel: &str, payload: &[u8], at: i64) -> io::Result<()> {
        loop {
            let ring = self.station.ring();
            let (kind, place) = match self.writer.place(ring, channel, payload.len(), || self.drained()) {
                Some(place) => (Kind::Message, place),
                None => {
                    self.put_aside(sequence, payload)?;
                    let place = self.writer.place(self.station.ring(), channel, 0, || self.drained());
                    (Kind::Aside, place.ok_or(io::ErrorKind::OutOfMemory)?)
                }
            };
            if place.reach <= self.reserved {
                let message = Message { sequence, at, channel, payload, kind };
                self.writer.write(self.station.ring(), place, &message);
                return Ok(());
            }
            let file = self.file.as_deref().ok_or(io::ErrorKind::NotFound)?;
            match Station::reserve(file, self.reserved, place.reach) {
                Ok(reserved) => self.reserved = reserved,
                Err(error) if self.reserved == 0 => return Err(error),
                Err(_) => self.writer.limit(self.reserved),
            }
        }
    }

    /// True if no reader has anything left to read that it wants: the others sleep, found all rings empty before that,
    /// and nothing was written for them since; and this context has read its own. A reader whose station cannot be
    /// opened, or was truncated, reads this ring as well, and does not show how far.
    fn drained(&self) -> bool {
        let has_read_all = |Peer { name, station, reader, behind, .. }: &Peer| match reader {
            Some(reader) if *name == self.name => !reader.pending(station.ring()),
            _ => !station.reads() || bell::has_read_all(station.sleep(), station.awake(), *behind),
        };
        self.unopened.is_empty()
            && self.cut.is_empty()
            && self.peers.iter().all(|peer| has_read_all(peer) && !peer.station.is_cut())
    }

    fn put_aside(&mut self, sequence: u32, payload: &[u8]) -> io::Result<()> {
        if self.asides.back().is_some_and(|aside| aside.sequence == sequence) {
            return Ok(());
        }
        self.folder.put_aside(&self.name, sequence, payload)?;
        self.asides.push_back(Aside { sequence, len: payload.len(), at: now() });
        while self.asides.len() > 1
            && (self.asides.len() > ASIDE.1 || self.asides.iter().map(|aside| aside.len).sum::<usize>() > ASIDE.0)
        {
            self.drop_aside();
        }
        Ok(())
    }

    fn drop_aside(&mut self) {
        if let Some(aside) = self.asides.pop_front() {
            self.folder.drop_aside(&self.name, aside.sequence);
        }
    }

    /// From this message on there are datagrams only. There is no way back.
    fn retire(&mut self, sequence: u32) {
        self.station.retire(sequence);
        self.retired = true;
    }

    /// True if the own part of shared memory is not shared any more: somebody truncated a file. From then on this
    /// context publishes datagrams only.
    pub fn is_cut(&self) -> bool {
        self.station.is_cut() || self.board.is_cut()
    }

    /// True if a process without a station may be listening.
    fn mirror(&mut self, sequence: u32) -> bool {
        // Readers notice a new listener by its self test; without readers there is nothing to save.
        if self.ttl > 0 || self.retired || !self.peers.iter().any(|peer| peer.station.reads()) {
            return true;
        }
        let now = now();
        let looked_at = self.board.looked_at().load(Ordering::Relaxed);
        let age = now.wrapping_sub(looked_at);
        let overdue = match due(age, sys::is_real_time) {
            Due::No => false,
            Due::Here => {
                self.look(now, looked_at, age, sequence);
                false
            }
            Due::Elsewhere => age >= OVERDUE_MS,
        };
        overdue || self.retired || self.board.listeners().load(Ordering::Acquire) & 3 != Listeners::None as Value
    }

    /// Looks who listens, unless another does just now.
    fn look(&mut self, now: Value, looked_at: Value, age: Value, sequence: u32) {
        let mine = self.board.looked_at().compare_exchange(looked_at, now, Ordering::AcqRel, Ordering::Relaxed);
        if mine.is_err() {
            return;
        }
        let listeners = self.board.listeners();
        if age >= 2 * LOOK_MS {
            // No publication for a while: the last check is out of date.
            self.tell(Listeners::Unknown);
        }
        let before = listeners.load(Ordering::Acquire);
        let found = look(self.bus, |inode| self.peers.iter().any(|peer| peer.station.owns(inode)));
        // Does not overwrite a result stored since.
        let after = (before & !3).wrapping_add(4) | found as Value;
        let _ = self.board.listeners().compare_exchange(before, after, Ordering::AcqRel, Ordering::Relaxed);
        while self.asides.front().is_some_and(|aside| now.wrapping_sub(aside.at) > ASIDE_MS) {
            self.drop_aside();
        }
        // The folder may be removed (by a logout, for example); a ring that cannot be found, or opened, is useless.
        let whole = self.file.as_deref().is_some_and(Station::is_whole) && self.folder.has(&self.name);
        if !self.retired && !whole {
            self.retire(sequence.wrapping_add(1));
        }
        self.census();
    }

    /// The next message comes with a look at the listeners.
    #[cfg(test)]
    pub(super) fn look_again(&self) {
        self.board.looked_at().fetch_sub(LOOK_MS, Ordering::Relaxed);
    }

    /// Looks around, as with a look at the listeners.
    #[cfg(test)]
    pub(super) fn look_around(&mut self) {
        self.census();
    }

    /// Its word of sleep, as if no publisher had marked it as woken.
    #[cfg(test)]
    pub(super) fn sleep_word(&self, value: Value) {
        self.station.sleep().store(value, Ordering::Relaxed);
    }

    fn tell(&self, news: Listeners) {
        let tell = |before: Value| Some((before & !3).wrapping_add(4) | news as Value);
        let _ = self.board.listeners().fetch_update(Ordering::AcqRel, Ordering::Relaxed, tell);
    }

    // Receiving

    /// Wants these channels from now on, or (`None`) all. The first call starts receiving: what is published after it
    /// is received.
    pub fn set_interest(&mut self, channels: Option<&[&str]>) {
        self.station.set_interest(channels);
        let mut wanted = [channels.is_none(); BUCKETS];
        channels.unwrap_or_default().iter().for_each(|channel| wanted[bucket(channel).0] = true);
        for new in (0..BUCKETS).filter(|&bucket| wanted[bucket] && !self.buckets[bucket]) {
            self.peers.iter_mut().filter_map(|peer| peer.reader.as_mut()).for_each(|reader| reader.forget(new));
        }
        *self.buckets = wanted;
        if !mem::replace(&mut self.reads, true) {
            self.refresh();
            for peer in &mut self.peers {
                peer.reader = Some(Reader::from_now(peer.station.ring()));
            }
            self.station.set_drained(self.generation);
            self.station.set_reads();
            self.board.changed();
        }
        // What came before the new interest was known has rung no bell.
        self.stay_readable();
    }

    /// Takes the next wanted message, for [`Bus::message`]. False: no more messages now, or so many unwanted ones that
    /// the caller should do its other work; the bell is readable then.
    ///
    /// `takes` decides, by its size in bytes, about a payload that lies in a file of its own.
    pub fn recv(&mut self, mut wants: impl FnMut(&str) -> bool, takes: impl Fn(&str, usize) -> bool) -> bool {
        self.refresh();
        let (mut passed, mut empty) = (0, 0);
        while empty < self.peers.len() {
            self.turn %= self.peers.len();
            let peer = &mut self.peers[self.turn];
            let Some(reader) = &mut peer.reader else { return false };
            let read = reader.read(peer.station.ring(), &mut self.copy, |bucket| self.buckets[bucket], &mut wants);
            if peer.station.is_cut() {
                self.abandon();
                continue;
            }
            match read {
                Read::Empty if peer.ended => {
                    self.bury();
                    continue;
                }
                Read::Empty => {
                    self.next_turn();
                    empty += 1;
                    continue;
                }
                Read::Message(Kind::Message) => {}
                Read::Message(_)
                    if takes(self.copy.channel(), self.copy.header.len as usize)
                        && fetch(&self.folder, (&peer.name, peer.station.uid()), &mut self.copy) => {}
                read => {
                    let fetched = read != Read::Passed;
                    self.lost += u64::from(fetched);
                    (passed, empty) = (passed + if fetched { FETCH_COST } else { 1 }, 0);
                    if passed >= PASSED_MAX {
                        self.stay_readable();
                        self.busy = true;
                        return false;
                    }
                    continue;
                }
            }
            self.lost += mem::take(&mut reader.lost);
            (self.from, peer.taken) = (peer.process, Some(self.copy.header.sequence));
            self.in_turn += 1;
            if self.in_turn >= TURN {
                self.next_turn();
            }
            if !mem::replace(&mut self.received, true) {
                bell::received(self.station.awake());
            }
            return true;
        }
        false
    }

    /// The message that [`Bus::recv`] took: channel, payload, and when it was published, ns of the monotonic clock,
    /// which all processes of this machine share.
    pub fn message(&self) -> (&str, &[u8], i64) {
        let header = self.copy.header;
        (self.copy.channel(), &self.copy.payload[..header.len as usize], header.at)
    }

    /// When that message was published: as in [`Bus::message`], without a look at the rest of it.
    pub fn published(&self) -> i64 {
        self.copy.header.at
    }

    /// Publisher of that message.
    pub fn from(&self) -> Option<Process> {
        self.from
    }

    /// The process whose datagrams come from `source`, if it has, or had, a station.
    pub fn process_at(&self, source: SocketAddrV4) -> Option<Process> {
        let peers = self.peers.iter().map(|peer| (peer.source, peer.process));
        let others = self.cut.iter().chain(&self.left).map(|left| (left.source, left.process));
        peers.chain(others).find(|(known, _)| *known == source)?.1
    }

    /// True if [`Bus::recv`] took anything since the latest sleep.
    pub fn received(&self) -> bool {
        self.received
    }

    fn next_turn(&mut self) {
        (self.turn, self.in_turn) = (self.turn + 1, 0);
    }

    /// Forgets the publisher whose turn it is: it has left, and its ring is read to the end.
    fn bury(&mut self) {
        let peer = self.peers.swap_remove(self.turn);
        self.buried = true;
        let with = if peer.station.has_retired() { &mut self.cut } else { &mut self.left };
        with.push(peer.leave());
    }

    /// Gives up the ring whose turn it is: its file was truncated. Its content is lost, and what its publisher and all
    /// others send from now on arrives by datagrams.
    fn abandon(&mut self) {
        let peer = self.peers.swap_remove(self.turn);
        self.lost += 1;
        self.cut.push(peer.leave());
        self.be_plain();
    }

    /// Others send datagrams from now on.
    fn be_plain(&mut self) {
        self.plain = true;
        self.station.set_plain();
        self.tell(Listeners::Some);
    }

    /// True if a datagram, received at `at`, is dropped: its publisher's ring has that message, or had it.
    pub fn takes(&mut self, source: SocketAddrV4, sequence: u32, at: i64) -> bool {
        // A station is shown before its first datagram is sent, so it is known now.
        self.refresh();
        if let Some(peer) = self.peers.iter_mut().find(|peer| peer.source == source) {
            return peer.reader.is_some()
                && (!peer.station.is_cut() && !peer.station.retired(sequence) || !passes(&mut peer.taken, sequence));
        }
        // Its waiting datagrams carry messages that were read before its file was truncated.
        if let Some(cut) = self.cut.iter_mut().find(|cut| cut.source == source) {
            return !passes(&mut cut.taken, sequence);
        }
        self.left.iter().any(|left| left.source == source && at < left.at.saturating_add(LATE_NS))
    }

    /// True if a publisher has retired whose ring is not yet read to its end: what is there comes before its datagrams.
    pub fn is_behind(&self) -> bool {
        self.peers.iter().any(Peer::is_behind)
    }

    /// True if a datagram has overtaken what its publisher wrote to its ring before it. It counts as lost then.
    pub fn overtakes(&mut self, source: SocketAddrV4, sequence: u32) -> bool {
        self.refresh();
        let overtakes = |peer: &Peer| peer.source == source && peer.station.retired(sequence) && peer.is_behind();
        let found = self.peers.iter().any(overtakes);
        self.lost += u64::from(found);
        found
    }

    /// Takes a self test from `source`: a process begins to listen, unless it has a station.
    pub fn self_test(&mut self, source: SocketAddrV4) {
        self.refresh();
        let left = |left: &Left| left.source == source && left.at.saturating_add(LATE_NS) > realtime();
        if !self.peers.iter().any(|peer| peer.source == source) && !self.left.iter().any(left) {
            self.tell(Listeners::Some);
        }
    }

    /// Messages of wanted channels, and of others that share their buckets, that were gone before they were read; since
    /// the last call.
    pub fn take_lost(&mut self) -> u64 {
        mem::take(&mut self.lost)
    }

    /// Readable, with an edge for each byte, if [`Bus::recv`] has work to do after [`Bus::sleep`] returned true.
    pub fn doorbell(&self) -> BorrowedFd<'_> {
        self.bell.as_fd()
    }

    /// The caller has nothing left to do and will wait for the bell: for an edge, or (`by_level`) until it is readable.
    /// False: something has come, it must not wait.
    pub fn sleep(&mut self, by_level: bool) -> bool {
        if mem::take(&mut self.busy) || !self.reads {
            return true;
        }
        if by_level || self.empty_in == 0 {
            self.empty();
        }
        self.empty_in -= 1;
        let pending = |peer: &Peer| peer.reader.as_ref().is_some_and(|reader| reader.pending(peer.station.ring()));
        // After a turn of the socket, for example, there may be something left to read.
        if self.station.drained() != self.generation && !self.peers.iter().any(pending) {
            self.station.set_drained(self.generation);
            if mourns(&mut self.buried, sys::is_real_time) {
                self.census();
            }
        }
        self.announce();
        if self.board.generation() == self.generation && !self.peers.iter().any(pending) {
            bell::found_nothing(self.station.awake());
            return true;
        }
        // What has come in between has perhaps rung no bell.
        self.sleeper.wake(self.station.sleep());
        if by_level {
            self.stay_readable();
        }
        false
    }

    /// Announces a sleep: publishers ring from now on. It counts as awake until it has found all rings empty.
    pub(super) fn announce(&mut self) {
        self.received = false;
        self.sleeper.announce(self.station.sleep(), self.station.awake());
    }

    /// Empties the bell.
    fn empty(&mut self) {
        self.empty_in = if bell_has_edges() { EMPTIED_AFTER } else { 1 };
        let mut bytes = [0; 1024];
        // Bounded: others may write all the while.
        for _ in 0..BELL_SIZE / bytes.len() {
            if read(&self.bell, &mut bytes) != Ok(bytes.len()) {
                break;
            }
        }
    }

    /// Makes the bell readable, with an edge, so that a caller that waits before it has received all does not wait.
    fn stay_readable(&mut self) {
        // Where only the first byte makes an edge, it must be this one.
        if !bell_has_edges() || write(&self.bell, &[0]).is_err() {
            self.empty();
            let _ = write(&self.bell, &[0]);
            // The next sleep begins with an empty bell.
            self.empty_in = 0;
        }
    }

    // The folder

    fn refresh(&mut self) {
        if self.board.generation() != self.generation {
            self.scan();
        }
        if !self.blind && self.board.is_cut() {
            // Once more, for those who came just before.
            self.scan();
            self.blind = true;
        }
        if !self.plain && self.is_cut() {
            self.be_plain();
        }
    }

    /// Finds who has come and who has left.
    fn scan(&mut self) {
        let generation = self.board.generation();
        let names = self.folder.stations().unwrap_or_else(|_| {
            // Those who are found later may have been received by datagrams before.
            (self.plain, self.blind) = (true, true);
            self.peers.iter().map(|peer| peer.name.clone()).collect()
        });
        for peer in &mut self.peers {
            peer.ended |= peer.station.ended() != 0 || !names.contains(&peer.name);
            let source = peer.station.source();
            if !peer.station.is_cut() {
                peer.source = source;
            }
        }
        if !self.reads {
            self.peers.retain(|peer| !peer.ended);
        }
        // As long as its station is there it must not be taken for a new one, and read again.
        let now = realtime();
        self.left.retain(|left| now < left.at.saturating_add(LATE_NS) || names.contains(&left.name));
        self.cut.retain_mut(|cut| {
            let there = names.contains(&cut.name);
            if there {
                cut.at = now;
            }
            there || now < cut.at.saturating_add(LATE_NS)
        });
        self.unopened.retain(|name| names.contains(name));
        for name in names {
            let known = self.left.iter().chain(&self.cut).any(|left| left.name == name);
            if known || self.unopened.contains(&name) || self.peers.iter().any(|peer| peer.name == name) {
                continue;
            }
            let opened = match self.blind || self.peers.len() >= STATIONS_MAX {
                true => Err(io::ErrorKind::QuotaExceeded.into()),
                false => self.folder.station(&name).and_then(|file| Station::open(&file)),
            };
            match opened {
                Ok(station) => {
                    let (source, ended) = (station.source(), station.ended() != 0);
                    let process = process(&name, station.uid());
                    let reader = self.reads.then(Reader::from_start);
                    let (bell, rung, behind, taken) = (None, None, None, None);
                    self.peers.push(Peer { name, station, source, process, reader, bell, rung, behind, taken, ended });
                }
                // It has left meanwhile.
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(_) => {
                    self.plain = true;
                    self.unopened.push(name);
                }
            }
        }
        if self.plain {
            self.be_plain();
        }
        self.generation = generation;
    }

    /// Finds who has died, and takes away what the dead left once everybody has read it.
    fn census(&mut self) {
        match self.blind {
            true => self.scan(),
            false => self.refresh(),
        }
        let Ok(names) = self.folder.stations() else { return };
        let mut dead = Vec::new();
        for name in names.into_iter().filter(|name| *name != self.name) {
            if let Some((lock, ours)) = self.folder.dead(&name) {
                dead.push((name, lock, ours));
            }
        }
        self.found_dead.retain(|(name, _)| dead.iter().any(|(dead, ..)| dead == name));
        let mut changed = false;
        for (name, _lock, ours) in &dead {
            // What another user left is removed by that user, or by the folder's owner.
            if !ours && !self.folder.is_ours() {
                continue;
            }
            let Ok(station) = self.folder.station(name).and_then(|file| Station::open(&file)) else {
                self.folder.remove(name);
                continue;
            };
            let known = self.found_dead.iter().find(|(dead, _)| dead == name).map_or(0, |(_, ended)| *ended);
            let mut ended = if *ours { station.ended() } else { known };
            if ended == 0 {
                ended = self.board.changed();
                changed = true;
                match ours {
                    true => station.set_ended(ended),
                    false => self.found_dead.push((name.clone(), ended)),
                }
            }
            let live =
                |peer: &&Peer| peer.station.reads() && !peer.ended && !dead.iter().any(|(dead, ..)| *dead == peer.name);
            if self.peers.iter().filter(live).all(|peer| reached(peer.station.drained(), ended)) {
                self.folder.remove(name);
                self.board.changed();
            }
        }
        drop(dead);
        if changed {
            self.ring_all();
        }
        self.refresh();
    }

    /// Wakes all readers.
    fn ring_all(&mut self) {
        bell::written();
        for peer in &mut self.peers {
            if let Some(sleep) = bell::asleep(peer.station.sleep()) {
                peer.ring(&self.folder, sleep);
            }
        }
    }
}

impl Peer {
    /// True if it has retired, and its ring is not yet read to its end.
    fn is_behind(&self) -> bool {
        let pending = || self.reader.as_ref().is_some_and(|reader| reader.pending(self.station.ring()));
        self.station.has_retired() && pending() && !self.station.is_cut()
    }

    fn leave(self) -> Left {
        Left { name: self.name, source: self.source, process: self.process, taken: self.taken, at: realtime() }
    }

    /// Wakes it; false if that is not possible.
    fn ring(&mut self, folder: &Folder, sleep: Value) -> bool {
        if self.rung == Some(sleep) {
            return true;
        }
        let ours = self.station.is_ours();
        if self.bell.is_none() {
            self.bell = folder.bell(&self.name, ours).ok();
        }
        let rang = self.bell.as_ref().is_some_and(|bell| write(bell, &[0]).is_ok());
        match (rang, ours) {
            (true, true) => bell::rang(self.station.sleep(), sleep),
            (true, false) => self.rung = Some(sleep),
            (false, _) => {}
        }
        rang
    }
}

impl Drop for Bus {
    fn drop(&mut self) {
        let ended = self.board.changed();
        self.station.set_ended(ended);
        self.refresh();
        // From now on the station counts as dead.
        self.file = None;
        let behind = |peer: &Peer| {
            peer.name != self.name && peer.station.reads() && !peer.ended && !reached(peer.station.drained(), ended)
        };
        if self.writer.used() && self.peers.iter().any(behind) {
            self.ring_all();
        } else {
            self.folder.remove(&self.name);
            self.board.changed();
        }
        // Publishers no longer wait for this reader.
        self.census();
        self.folder.close();
    }
}

/// True if each byte written to a FIFO makes an edge, however many lie in it: not so in Linux 5.5 to 5.13.
pub(super) fn bell_has_edges() -> bool {
    static EDGES: OnceLock<bool> = OnceLock::new();
    let probe = || {
        let (end, bell) = pipe2(OFlag::O_NONBLOCK | OFlag::O_CLOEXEC)?;
        let epoll = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC)?;
        epoll.add(&end, EpollEvent::new(EpollFlags::EPOLLIN | EpollFlags::EPOLLET, 0))?;
        let mut edges = 0;
        for _ in 0..2 {
            write(&bell, &[0])?;
            edges += epoll.wait(&mut [EpollEvent::empty()], EpollTimeout::ZERO)?;
        }
        nix::Result::Ok(edges == 2)
    };
    *EDGES.get_or_init(|| probe().unwrap_or(false))
}

/// The process that has a station.
fn process(name: &str, uid: u32) -> Option<Process> {
    let pid = name.split_once('-')?.0.parse().ok()?;
    Some(Process { pid, uid })
}

fn fetch(folder: &Folder, (name, uid): (&str, u32), copy: &mut Copy) -> bool {
    let (sequence, len) = (copy.header.sequence, copy.header.len);
    len <= MESSAGE_MAX && folder.fetch_aside(name, uid, sequence, &mut copy.payload, len as usize).is_ok()
}

/// True if a datagram carries nothing that was taken before. All before it count as taken then; it itself does not, as
/// the other fragments of its message follow.
fn passes(taken: &mut Option<u32>, sequence: u32) -> bool {
    let new = taken.is_none_or(|taken| taken.wrapping_sub(sequence) >= 1 << 31);
    if new {
        *taken = Some(sequence.wrapping_sub(1));
    }
    new
}

fn reached(generation: Value, wanted: Value) -> bool {
    generation.wrapping_sub(wanted) < Value::MAX / 2
}

/// Whose turn it is to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Due {
    No,
    Here,
    Elsewhere,
}

/// Whose turn it is, `age` ms after the last look; ages come around.
fn due(age: Value, is_real_time: impl FnOnce() -> bool) -> Due {
    match (LOOK_MS..Value::MAX - AHEAD_MS).contains(&age) {
        false => Due::No,
        true if is_real_time() => Due::Elsewhere,
        true => Due::Here,
    }
}

fn nanos(clock: ClockId) -> io::Result<i64> {
    let time = Duration::from(clock_gettime(clock)?);
    Ok(time.as_nanos() as i64)
}

/// Whether a census is due: a departed peer was read to its end. It walks the folder and opens what is there; threads
/// with a real-time priority leave that to the looks of others.
fn mourns(buried: &mut bool, is_real_time: impl FnOnce() -> bool) -> bool {
    *buried && !is_real_time() && mem::take(buried)
}

/// ns since 1970.
pub(super) fn realtime() -> i64 {
    nanos(ClockId::CLOCK_REALTIME).unwrap_or_default()
}

/// ms of the monotonic clock; they come around where words have 32 bits.
fn now() -> Value {
    nanos(ClockId::CLOCK_MONOTONIC_COARSE).map_or(0, |nanos| (nanos / 1_000_000) as Value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_look_is_left_to_those_without_a_real_time_priority() {
        let turn = |age| [false, true].map(|real_time| due(age, || real_time));
        assert_eq!(turn(LOOK_MS - 1), [Due::No; 2]);
        for age in [LOOK_MS, OVERDUE_MS, 100 * LOOK_MS, Value::MAX / 4 * 3] {
            assert_eq!(turn(age), [Due::Here, Due::Elsewhere]);
        }
        assert_eq!(turn(Value::MAX), [Due::No; 2], "another looked after we took the time");
    }

    #[test]
    fn a_census_is_left_to_those_without_a_real_time_priority() {
        let mut buried = true;
        assert!(!mourns(&mut buried, || true) && buried);
        assert!(mourns(&mut buried, || false) && !buried);
        assert!(!mourns(&mut buried, || false));
    }
}
