//! Heartbeats: each thread of a module increments a counter in a page that the watchdog reads.
//!
//! The page is a file of 4 KiB in memory; `docs/beats.md` specifies its format, which modules in any language may
//! write. Both sides map it; a page in a memory file system never waits for a disk, and somebody who truncates the file
//! harms nobody (`page`).

mod page;

use crate::keepers;
use base::{Duration, Instant};
use lcm::memory::Access;
use module::admission::Process;
use nix::sys::statfs::{TMPFS_MAGIC, statfs};
use page::Page;
use std::fs::{self, DirBuilder, OpenOptions, Permissions};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Environment variable with the path of the module's page.
pub const VARIABLE: &str = "ADVEE_BEATS";
/// Period of a thread's heartbeat; it may come up to `EARLY_MAX` earlier if the thread is awake: 10 ms, and the jitter
/// of a thread with that period, so that this one always takes its heartbeats along.
pub const PERIOD: Duration = Duration::from_millis(50);
const EARLY_MAX: Duration = Duration::from_micros(10_500);
/// Period at which the watchdog shows that it reads a page.
const SHOW_PERIOD: Duration = Duration::from_millis(500);

const PAGE_SIZE: usize = 4096;
const MAGIC: [u8; 4] = *b"BEAT";
const VERSION: u32 = 1;
/// Offset of the first thread's entry; [`ENTRY_SIZE`] is the length of each.
const ENTRIES_OFFSET: usize = 64;
/// Offset of the watchdog's own counter; its process id follows.
const READER_OFFSET: usize = 16;
const WATCHDOG_OFFSET: usize = 20;
const ENTRY_SIZE: usize = 64;
/// Times that a header is read again because it has changed meanwhile.
const HEAD_READS_MAX: usize = 4;
/// Length of the name in an entry; the counter follows it.
const NAME_SIZE: usize = 48;
/// Maximum number of threads in a page.
pub const THREADS_MAX: usize = (PAGE_SIZE - ENTRIES_OFFSET) / ENTRY_SIZE;

/// A module's own page.
pub struct HeartbeatPage {
    page: Arc<Page>,
    /// User of the watchdog, who made the page.
    uid: u32,
    threads: usize,
}

/// Heartbeat of one thread, owned by that thread.
pub struct Heartbeat {
    page: Arc<Page>,
    uid: u32,
    place: usize,
    count: u32,
    next: Instant,
}

impl HeartbeatPage {
    /// Opens the page that the watchdog created for this process; `None` if a person started it.
    ///
    /// # Errors
    /// The page does not exist or has no valid header.
    pub fn open() -> io::Result<Option<Self>> {
        match std::env::var_os(VARIABLE) {
            Some(path) => Self::at(Path::new(&path)).map(Some),
            None => Ok(None),
        }
    }

    /// The watchdog that reads this page; `None` if none has written it.
    #[must_use]
    pub fn watchdog(&self) -> Option<Process> {
        reader_of(&self.page, self.uid).1
    }

    pub(crate) fn at(path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().read(true).write(true).custom_flags(nix::libc::O_NOFOLLOW).open(path)?;
        let found = file.metadata()?;
        if !found.is_file() {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        Ok(Self { page: Arc::new(Page::new(file, Access::Write)?), uid: found.uid(), threads: 0 })
    }

    /// Registers a thread, whose first heartbeat is `now`. From the first registration on, the watchdog judges the
    /// process by its heartbeats.
    ///
    /// # Errors
    /// The page cannot be written or is full.
    pub fn thread(&mut self, now: Instant, name: &str) -> io::Result<Heartbeat> {
        if self.threads == THREADS_MAX {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let place = ENTRIES_OFFSET + ENTRY_SIZE * self.threads;
        let mut entry = [0; ENTRY_SIZE];
        let name = &name.as_bytes()[..name.len().min(NAME_SIZE)];
        entry[..name.len()].copy_from_slice(name);
        entry[NAME_SIZE] = 1;
        self.page.write(place, &entry)?;
        self.threads += 1;
        // The number of threads is written last: an entry counts once it is complete.
        let mut head = [0; 16];
        head[..4].copy_from_slice(&MAGIC);
        head[4..8].copy_from_slice(&VERSION.to_le_bytes());
        head[8..12].copy_from_slice(&std::process::id().to_le_bytes());
        head[12..].copy_from_slice(&(self.threads as u32).to_le_bytes());
        self.page.write(0, &head)?;
        Ok(Heartbeat { page: self.page.clone(), uid: self.uid, place: place + NAME_SIZE, count: 1, next: now + PERIOD })
    }
}

/// Offset of a thread's counter.
fn counter_of(index: usize) -> usize {
    ENTRIES_OFFSET + ENTRY_SIZE * index + NAME_SIZE
}

/// The watchdog's counter and its process.
fn reader_of(page: &Page, uid: u32) -> (u32, Option<Process>) {
    let count = page.load(READER_OFFSET);
    let process = Process { pid: page.load(WATCHDOG_OFFSET), uid };
    (count, Some(process).filter(|process| process.pid != 0))
}

impl Heartbeat {
    /// Increments the counter if that is due; true if it did. The loop that does the work calls it at least every
    /// [`PERIOD`].
    ///
    /// A thread that is awake for its work takes the heartbeat along. Those of idle threads, of all processes, come at
    /// the same moments: to wake up together costs half of what it costs to wake up one by one.
    pub fn beat(&mut self, now: Instant) -> bool {
        let due = self.next <= now + EARLY_MAX;
        if due {
            self.next = if now < self.next { now + PERIOD } else { Instant::ZERO.next_on_grid(now, PERIOD) };
            self.count = self.count.wrapping_add(1);
            self.page.store(self.place, self.count);
        }
        due
    }

    /// Counter that the watchdog increments while it reads this page, 0 if it cannot be read, and that watchdog, `None`
    /// if none has written it.
    #[must_use]
    pub fn reader(&self) -> (u32, Option<Process>) {
        reader_of(&self.page, self.uid)
    }

    /// Deadline of the next heartbeat.
    #[must_use]
    pub fn next(&self) -> Instant {
        self.next
    }
}

/// Creates the folder of a robot's pages: in its run folder if that is in memory, otherwise in `/dev/shm`.
///
/// # Errors
/// The folder cannot be created or belongs to another user.
pub fn folder(run_dir: &Path) -> io::Result<PathBuf> {
    let path = folder_path(run_dir);
    match DirBuilder::new().mode(0o700).create(&path) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
        _ => {}
    }
    let found = fs::symlink_metadata(&path)?;
    if !found.is_dir() || found.uid() != nix::unistd::geteuid().as_raw() {
        return Err(io::Error::new(
            io::ErrorKind::PermissionDenied,
            format!("{} belongs to another user", path.display()),
        ));
    }
    // Modules of other users find their own pages by their paths.
    let mode = if keepers::are_any() { 0o710 } else { 0o700 };
    fs::set_permissions(&path, Permissions::from_mode(mode))?;
    Ok(path)
}

/// Path of that folder, whether or not it exists.
#[must_use]
pub fn folder_path(run_dir: &Path) -> PathBuf {
    let within = run_dir.join("beats");
    match statfs(run_dir) {
        Ok(system) if system.filesystem_type() == TMPFS_MAGIC => within,
        _ if Path::new("/dev/shm").is_dir() => Path::new("/dev/shm").join(shared_name(run_dir)),
        _ => within,
    }
}

fn shared_name(run_dir: &Path) -> String {
    format!("advee-beats-{}-{:016x}", nix::unistd::geteuid(), hash(run_dir))
}

/// Hash that identifies a run folder by its path.
#[must_use]
pub fn hash(run_dir: &Path) -> u64 {
    let path = fs::canonicalize(run_dir).unwrap_or_else(|_| run_dir.into());
    fnv(path.as_os_str().as_encoded_bytes())
}

/// FNV-1a, 64 bits; for names, not for secrets.
#[must_use]
pub fn fnv(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xCBF2_9CE4_8422_2325, |hash: u64, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01B3))
}

/// State of a thread as the watchdog sees it.
#[derive(Debug)]
struct ThreadState {
    name: String,
    count: u32,
    /// Time at which its counter was last seen to change.
    last: Instant,
}

/// A module's page as its watchdog reads it.
#[derive(Debug)]
pub struct PageReader {
    page: Page,
    /// The file was shorter than a page when the watchdog last showed that it reads it.
    short: bool,
    threads: Vec<ThreadState>,
    /// Next time at which the watchdog shows that it reads the page.
    show: Instant,
}

/// Result of reading a page.
#[derive(Debug, PartialEq, Eq)]
pub enum Reading<'a> {
    /// No thread is registered yet: the process is judged by its announcements.
    Blank,
    /// The thread whose last heartbeat is oldest.
    Oldest {
        /// Name of the thread, for people.
        thread: &'a str,
        /// Time of its last heartbeat.
        last: Instant,
    },
    /// Invalid content: forged, torn or of another version.
    Bad(&'static str),
}

impl PageReader {
    /// Creates an empty page for a process that is about to start; it replaces that of an earlier process. `for_group`:
    /// a process of another user writes it.
    ///
    /// # Errors
    /// The page cannot be created.
    pub fn create(path: &Path, for_group: bool) -> io::Result<Self> {
        match fs::remove_file(path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let file = OpenOptions::new().read(true).write(true).create_new(true).mode(0o600).open(path)?;
        file.set_len(PAGE_SIZE as u64)?;
        if for_group {
            file.set_permissions(Permissions::from_mode(0o660))?;
        }
        let page = Page::new(file, Access::Write)?;
        page.write(WATCHDOG_OFFSET, &std::process::id().to_le_bytes())?;
        Ok(Self { page, short: false, threads: Vec::new(), show: Instant::ZERO })
    }

    /// Opens the page of a running process as its watchdog, whom the page names from then on.
    ///
    /// # Errors
    /// The page does not exist, or cannot be mapped.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().read(true).write(true).custom_flags(nix::libc::O_NOFOLLOW).open(path)?;
        let page = Page::new(file, Access::Write)?;
        // Before this watchdog publishes anything, so that the module knows who guards it now.
        let _ = page.write(WATCHDOG_OFFSET, &std::process::id().to_le_bytes());
        Ok(Self { page, short: false, threads: Vec::new(), show: Instant::ZERO })
    }

    /// Opens the page of a running process for a tool that looks on: it changes nothing in it, and
    /// [`show`](Self::show) has no effect on the page.
    ///
    /// # Errors
    /// The page does not exist, or cannot be mapped.
    pub fn look_on(path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().read(true).custom_flags(nix::libc::O_NOFOLLOW).open(path)?;
        Ok(Self { page: Page::new(file, Access::Read)?, short: false, threads: Vec::new(), show: Instant::ZERO })
    }

    /// Increments the watchdog's counter if that is due, even if the module's part of the page is invalid. A truncated
    /// file is noticed here, at the latest.
    pub fn show(&mut self, now: Instant) {
        if self.show <= now {
            self.show = now + SHOW_PERIOD;
            // An earlier watchdog may have incremented it.
            self.short |= self.page.is_short();
            let count = self.page.load(READER_OFFSET).wrapping_add(1);
            // Before the counter, whose change says that there is news.
            self.page.store(WATCHDOG_OFFSET, std::process::id());
            self.page.store(READER_OFFSET, count);
        }
    }

    /// Names of the threads as of the last reading, and when each was last seen to beat.
    pub fn threads(&self) -> impl Iterator<Item = (&str, Instant)> {
        self.threads.iter().map(|thread| (thread.name.as_str(), thread.last))
    }

    /// The header: signature, version, process id and number of threads. A thread that registers meanwhile changes
    /// more than one of them, so they count once they have been read twice.
    fn head(&self) -> [u32; 4] {
        let read = || [0, 4, 8, 12].map(|place| self.page.load(place));
        let mut head = read();
        for _ in 0..HEAD_READS_MAX {
            let again = read();
            if again == head {
                break;
            }
            head = again;
        }
        head
    }

    /// Reads the page. `held_up` is the part of the watchdog's own delay beyond its period that is not charged to the
    /// threads.
    pub fn read(&mut self, now: Instant, pid: u32, held_up: Duration) -> Reading<'_> {
        let [magic, version, owner, count] = self.head();
        let count = count as usize;
        let known = self.threads.len();
        let why = match () {
            () if self.short || self.page.is_cut() => "is cut short",
            () if [magic, version, owner] == [0; 3] && count + known == 0 => return Reading::Blank,
            () if magic != u32::from_le_bytes(MAGIC) => "has no valid header",
            () if version != VERSION => "is of another version",
            () if owner != pid => "is of another process",
            () if count == 0 || count > THREADS_MAX => "has an invalid number of threads",
            () if count < known => "has lost threads",
            () => "",
        };
        if !why.is_empty() {
            return Reading::Bad(if self.page.is_short() { "is cut short" } else { why });
        }
        for (index, thread) in self.threads.iter_mut().enumerate() {
            let beats = self.page.load(counter_of(index));
            thread.last = if beats == thread.count { (thread.last + held_up).min(now) } else { now };
            thread.count = beats;
        }
        for index in known..count {
            let mut name = [0; NAME_SIZE];
            if self.page.read(ENTRIES_OFFSET + ENTRY_SIZE * index, &mut name).is_err() {
                return Reading::Bad("is cut short");
            }
            let end = name.iter().position(|byte| *byte == 0).unwrap_or(NAME_SIZE);
            let name = String::from_utf8_lossy(&name[..end]).escape_debug().to_string();
            self.threads.push(ThreadState { name, count: self.page.load(counter_of(index)), last: now });
        }
        // Zeros instead of counters would look like heartbeats, once.
        if self.page.is_cut() {
            return Reading::Bad("is cut short");
        }
        match self.threads.iter().min_by_key(|thread| thread.last) {
            Some(ThreadState { name, last, .. }) => Reading::Oldest { thread: name, last: *last },
            None => Reading::Blank,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    struct Dir(PathBuf);

    impl Dir {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("advee-beats-{name}-{}", std::process::id()));
            fs::create_dir_all(&path).unwrap();
            Self(path)
        }
    }

    impl Drop for Dir {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn pair(dir: &Dir) -> (PageReader, HeartbeatPage) {
        let path = dir.0.join("module");
        (PageReader::create(&path, false).unwrap(), HeartbeatPage::at(&path).unwrap())
    }

    #[test]
    fn the_thread_with_the_oldest_heartbeat_is_reported() {
        let dir = Dir::new("oldest");
        let (mut page, mut beats) = pair(&dir);
        let me = std::process::id();
        assert_eq!(page.read(at(0), me, Duration::ZERO), Reading::Blank);
        let mut loop_ = beats.thread(at(0), "main").unwrap();
        let mut worker = beats.thread(at(0), "worker").unwrap();
        assert_eq!(page.read(at(10), me, Duration::ZERO), Reading::Oldest { thread: "main", last: at(10) });
        for ms in [60, 120, 180, 240] {
            loop_.beat(at(ms));
            if ms < 130 {
                worker.beat(at(ms));
            }
            page.read(at(ms), me, Duration::ZERO);
        }
        assert_eq!(page.read(at(250), me, Duration::ZERO), Reading::Oldest { thread: "worker", last: at(120) });
    }

    #[test]
    fn a_heartbeat_is_written_at_most_once_per_period() {
        let dir = Dir::new("period");
        let (mut page, mut beats) = pair(&dir);
        let mut beat = beats.thread(at(0), "main").unwrap();
        for ms in 0..500 {
            beat.beat(at(ms));
        }
        page.read(at(500), std::process::id(), Duration::ZERO);
        assert_eq!(page.threads[0].count, 13, "each 40 ms: it was always awake");
        assert_eq!(beat.next(), at(530));
    }

    #[test]
    fn idle_threads_beat_at_the_same_moments() {
        let dir = Dir::new("together");
        let (_page, mut beats) = pair(&dir);
        for start in [0, 7, 33, 49] {
            let mut beat = beats.thread(at(start), "main").unwrap();
            let mut last = at(start);
            for _ in 0..4 {
                let now = beat.next();
                assert!(beat.beat(now) && now.since(last) <= PERIOD && beat.next() > now);
                last = now;
            }
            assert_eq!(last.as_nanos() % PERIOD.as_nanos() as u64, 0, "{start}");
        }
    }

    #[test]
    fn a_thread_with_work_each_10_ms_never_wakes_for_its_heartbeat() {
        let dir = Dir::new("work");
        let (_page, mut beats) = pair(&dir);
        for (start, lateness) in [(3, 0), (9, 70), (0, 450)] {
            let mut beat = beats.thread(at(start), "main").unwrap();
            // Late by another time at each turn, us.
            let turn = |n: u64| Instant::from_nanos(((start + 10 * n) * 1000 + n * 37 % (lateness + 1)) * 1000);
            for n in 1..200 {
                beat.beat(turn(n));
                assert!(beat.next() > turn(n + 1), "{start} {n}: {:?}", beat.next());
            }
        }
    }

    #[test]
    fn a_module_sees_whether_its_page_is_read() {
        let dir = Dir::new("read");
        let (mut page, mut beats) = pair(&dir);
        let beat = beats.thread(at(0), "main").unwrap();
        let me = beats.watchdog();
        assert_eq!(me.map(|process| process.pid), Some(std::process::id()));
        assert_eq!(beat.reader(), (0, me));
        for ms in (0..1000).step_by(20) {
            page.show(at(ms));
        }
        assert_eq!(beat.reader(), (2, me));
        PageReader::open(&dir.0.join("module")).unwrap().show(at(5000));
        assert_eq!(beat.reader(), (3, me), "the next watchdog continues");
    }

    #[test]
    fn a_delay_of_the_watchdog_is_not_charged_to_threads() {
        let dir = Dir::new("held");
        let (mut page, mut beats) = pair(&dir);
        let _beat = beats.thread(at(0), "main").unwrap();
        let me = std::process::id();
        page.read(at(0), me, Duration::ZERO);
        assert_eq!(page.read(at(1000), me, 980 * MS), Reading::Oldest { thread: "main", last: at(980) });
    }

    #[test]
    fn invalid_pages_are_rejected_without_harm() {
        let dir = Dir::new("bad");
        let path = dir.0.join("module");
        let me = std::process::id();
        let file = |bytes: &[u8]| {
            let mut whole = vec![0; PAGE_SIZE];
            whole[..bytes.len()].copy_from_slice(bytes);
            fs::write(&path, whole).unwrap();
            PageReader::open(&path).unwrap()
        };
        let head = |version: u32, pid: u32, threads: u32| {
            [MAGIC, version.to_le_bytes(), pid.to_le_bytes(), threads.to_le_bytes()].concat()
        };
        let bad = |bytes: &[u8]| matches!(file(bytes).read(at(0), me, Duration::ZERO), Reading::Bad(_));
        assert!(!bad(&head(1, me, 1)));
        assert!(bad(b"FEAT"), "another magic");
        assert!(bad(&head(2, me, 1)), "another version");
        assert!(bad(&head(1, me + 1, 1)), "another process");
        assert!(bad(&head(1, me, 0)) && bad(&head(1, me, THREADS_MAX as u32 + 1)) && bad(&head(1, me, u32::MAX)));
        let mut two = file(&head(1, me, 2));
        two.read(at(0), me, Duration::ZERO);
        fs::write(&path, vec![0xFF; PAGE_SIZE]).unwrap();
        assert!(matches!(two.read(at(1), me, Duration::ZERO), Reading::Bad(_)));
        fs::write(&path, b"short").unwrap();
        assert_eq!(two.read(at(1), me, Duration::ZERO), Reading::Bad("is cut short"));
        let mut seed = 1_u64;
        for _ in 0..2000 {
            let random: Vec<u8> = (0..PAGE_SIZE)
                .map(|_| {
                    seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    (seed >> 56) as u8
                })
                .collect();
            let mut page = file(&[&head(1, me, (seed >> 40) as u32 % 64), &random[16..]].concat());
            page.read(at(0), me, Duration::ZERO);
        }
    }

    #[test]
    fn a_truncated_page_ends_neither_side() {
        let me = std::process::id();
        for (name, length) in [("nothing", 0), ("head", 8), ("part", 100)] {
            let dir = Dir::new(name);
            let (mut page, mut beats) = pair(&dir);
            let mut beat = beats.thread(at(0), "main").unwrap();
            page.show(at(0));
            assert_eq!(page.read(at(10), me, Duration::ZERO), Reading::Oldest { thread: "main", last: at(10) });
            let file = OpenOptions::new().write(true).open(dir.0.join("module")).unwrap();
            file.set_len(length).unwrap();
            let found = (20..=500).step_by(20).find(|ms| {
                page.show(at(*ms));
                page.read(at(*ms), me, Duration::ZERO) == Reading::Bad("is cut short")
            });
            assert!(found.is_some(), "{length}");
            // Heartbeats go on, and the module still sees its watchdog.
            assert!(beat.beat(at(600)));
            let (before, _) = beat.reader();
            page.show(at(2000));
            assert_eq!(beat.reader(), (before + 1, Some(Process { pid: me, uid: beat.uid })), "{length}");
        }
    }

    #[test]
    fn a_tool_that_looks_on_changes_nothing_in_the_page() {
        let dir = Dir::new("look-on");
        let path = dir.0.join("module");
        let (mut page, mut beats) = pair(&dir);
        let mut beat = beats.thread(at(0), "main").unwrap();
        page.show(at(0));
        let before = fs::read(&path).unwrap();
        let mut other = PageReader::look_on(&path).unwrap();
        other.show(at(0));
        assert_eq!(
            other.read(at(10), std::process::id(), Duration::ZERO),
            Reading::Oldest { thread: "main", last: at(10) }
        );
        assert_eq!(fs::read(&path).unwrap(), before);
        assert!(beat.beat(at(60)));
        assert_eq!(
            other.read(at(70), std::process::id(), Duration::ZERO),
            Reading::Oldest { thread: "main", last: at(70) }
        );
        // Truncated, it is bad for a tool, too, which does not extend it.
        OpenOptions::new().write(true).open(&path).unwrap().set_len(0).unwrap();
        other.show(at(600));
        assert_eq!(other.read(at(600), std::process::id(), Duration::ZERO), Reading::Bad("is cut short"));
        assert_eq!(fs::read(&path).unwrap(), [0_u8; 0]);
    }

    #[test]
    fn a_page_that_was_cleared_after_a_heartbeat_is_bad() {
        let dir = Dir::new("cleared");
        let (mut page, mut beats) = pair(&dir);
        let _beat = beats.thread(at(0), "main").unwrap();
        let me = std::process::id();
        page.read(at(0), me, Duration::ZERO);
        let file = OpenOptions::new().write(true).open(dir.0.join("module")).unwrap();
        std::os::unix::fs::FileExt::write_all_at(&file, &[0; PAGE_SIZE], 0).unwrap();
        assert_eq!(page.read(at(20), me, Duration::ZERO), Reading::Bad("has no valid header"));
    }

    #[test]
    fn the_number_of_threads_is_bounded() {
        let dir = Dir::new("full");
        let (mut page, mut beats) = pair(&dir);
        for n in 0..THREADS_MAX {
            beats.thread(at(0), &"n".repeat(n + 1)).unwrap();
        }
        assert!(beats.thread(at(0), "one more").is_err());
        assert!(matches!(page.read(at(0), std::process::id(), Duration::ZERO), Reading::Oldest { .. }));
    }

    #[test]
    fn every_run_folder_has_its_own_pages() {
        let (a, b) = (Dir::new("a"), Dir::new("b"));
        let [a, again, b] = [&a, &a, &b].map(|dir| folder(&dir.0).unwrap());
        assert_eq!(a, again);
        assert_ne!(a, b);
        for path in [a, b] {
            fs::remove_dir(path).unwrap();
        }
    }
}
