//! Records the inputs and outputs of a module in `RUN/inputs/<module>`, beside the loop that does the work.
//!
//! The loop never waits for the disk: it appends records to a buffer of bounded size, which a separate thread empties
//! ten times a second. If the disk is so slow that the buffer is full, records are lost; the file and a report state
//! so. That thread has no heartbeat on purpose: a watchdog that ended a module because of a slow disk would stop the
//! robot for the sake of a log. Its failures are reported as faults instead.

use super::clock;
use module::Shell;
use nix::sys::statvfs::fstatvfs;
use record::{Header, Recorder};
use std::fs::{File, OpenOptions, create_dir_all};
use std::io::{self, ErrorKind, Write};
use std::mem;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Folder of these files in a run.
pub const FOLDER: &str = "inputs";
/// Period of emptying the buffer.
const PERIOD: Duration = Duration::from_millis(100);
/// Size of the buffer, bytes: more than a minute of a driver's inputs.
const BUFFER_MAX: usize = 1 << 20;
/// Free space that is left on the disk, bytes.
const FREE_MIN: u64 = 64 << 20;
/// Number of bytes written between two checks of the free space.
const FREE_CHECK_BYTES: u64 = 1 << 20;
/// Maximum time that the end of the module waits for the disk.
const CLOSE_TIMEOUT: Duration = Duration::from_millis(500);

/// Settings of a recording.
pub struct Inputs {
    /// Folder of the run.
    pub run: PathBuf,
    /// Header of the file; it names the module.
    pub header: Header,
    /// Maximum length of the file, bytes.
    pub limit: u64,
}

/// A file that is being written. Dropped after its shell, it waits for the last record.
pub struct Recording {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    told: bool,
}

#[derive(Default)]
struct Shared {
    waiting: Mutex<Vec<u8>>,
    /// No further records will be added.
    closed: AtomicBool,
    /// A record did not fit into the buffer.
    full: AtomicBool,
    /// Reason why nothing more is written.
    failed: Mutex<Option<String>>,
}

/// The loop's side.
struct Feeder {
    shared: Arc<Shared>,
    /// Records added while the other thread held the buffer.
    held: Vec<u8>,
}

impl Recording {
    /// Creates the file and records the calls of `shell` from now on.
    ///
    /// # Errors
    /// The file cannot be created; the module runs without it.
    pub fn start(shell: &mut Shell, inputs: &Inputs) -> io::Result<Self> {
        let folder = inputs.run.join(FOLDER);
        create_dir_all(&folder)?;
        let file = create(&folder, &inputs.header.module)?;
        let shared = Arc::new(Shared::default());
        let mut feeder = Feeder { shared: shared.clone(), held: Vec::new() };
        let writer = shared.clone();
        let thread = thread::Builder::new().name("inputs".into()).spawn(move || writer.write(file))?;
        shell.record(Recorder::new(&inputs.header, inputs.limit, move |record| feeder.take(record)));
        Ok(Self { shared, thread: Some(thread), told: false })
    }

    /// Reason why the recording is incomplete, once.
    pub fn trouble(&mut self) -> Option<String> {
        if self.told {
            return None;
        }
        let failed = self.shared.failed.try_lock().ok().and_then(|why| why.clone());
        let full = self.shared.full.load(Ordering::Relaxed).then(|| "the disk is too slow".into());
        let trouble = failed.or(full).map(|why| format!("the record of inputs is incomplete: {why}"));
        self.told = trouble.is_some();
        trouble
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        let Some(thread) = self.thread.take() else { return };
        // The feeder closed the buffer when the shell was dropped; should it still exist, it adds nothing more.
        self.shared.closed.store(true, Ordering::Release);
        thread.thread().unpark();
        let until = Instant::now() + CLOSE_TIMEOUT;
        while !thread.is_finished() && Instant::now() < until {
            thread::sleep(Duration::from_millis(1));
        }
    }
}

/// Creates a new file for each start of the module: `driver_canbus`, `driver_canbus.2`, …
fn create(folder: &Path, module: &str) -> io::Result<File> {
    let open = |name: &str| OpenOptions::new().write(true).create_new(true).open(folder.join(name));
    let mut life = 1;
    loop {
        let name = if life == 1 { module.to_string() } else { format!("{module}.{life}") };
        match open(&name) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists && life < 100_000 => life += 1,
            result => return result,
        }
    }
}

impl Feeder {
    /// Passes a record to the writer without waiting; false if it does not fit.
    fn take(&mut self, record: &[u8]) -> bool {
        let room = match self.shared.waiting.try_lock() {
            Ok(mut waiting) => {
                waiting.append(&mut self.held);
                let room = waiting.len() + record.len() <= BUFFER_MAX;
                if room {
                    waiting.extend_from_slice(record);
                }
                room
            }
            Err(_) => {
                let room = self.held.len() + record.len() <= BUFFER_MAX;
                if room {
                    self.held.extend_from_slice(record);
                }
                room
            }
        };
        if !room {
            self.shared.full.store(true, Ordering::Relaxed);
        }
        room
    }
}

impl Drop for Feeder {
    fn drop(&mut self) {
        self.shared.waiting.lock().unwrap_or_else(PoisonError::into_inner).append(&mut self.held);
        self.shared.closed.store(true, Ordering::Release);
    }
}

impl Shared {
    /// Thread function: writes the buffered records until no more are added.
    fn write(&self, mut file: File) {
        let (mut taken, mut unchecked, mut works) = (Vec::new(), FREE_CHECK_BYTES, true);
        loop {
            // Read before the last look into the buffer, which then contains everything added before the close.
            let closed = self.closed.load(Ordering::Acquire);
            mem::swap(&mut *self.waiting.lock().unwrap_or_else(PoisonError::into_inner), &mut taken);
            if works && let Err(error) = put(&mut file, &taken, &mut unchecked) {
                works = false;
                *self.failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error.to_string());
            }
            taken.clear();
            if closed {
                return;
            }
            // When idle modules are awake for their heartbeats: to wake up together costs less than one by one.
            let now = clock::now();
            thread::park_timeout(base::Instant::ZERO.next_on_grid(now, PERIOD).since(now));
        }
    }
}

fn put(file: &mut File, bytes: &[u8], unchecked: &mut u64) -> io::Result<()> {
    *unchecked += bytes.len() as u64;
    if *unchecked >= FREE_CHECK_BYTES {
        *unchecked = 0;
        let disk = fstatvfs(&*file)?;
        if (disk.blocks_available() as u128 * disk.fragment_size() as u128) < FREE_MIN.into() {
            return Err(io::Error::new(ErrorKind::StorageFull, format!("less than {} MiB are free", FREE_MIN >> 20)));
        }
    }
    file.write_all(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::{Epoch, Instant as Moment};
    use module::{Actions, Event, Module, ShellConfig, State};
    use record::{End, Item, Reader, Why};

    struct Idle;

    impl Module for Idle {
        fn handle(&mut self, _: Moment, _: Event<'_>, _: &mut Actions) {}
        fn poll_timeout(&self) -> Option<Moment> {
            None
        }
    }

    struct Run(PathBuf);

    impl Run {
        fn new(name: &str) -> Self {
            Self(std::env::temp_dir().join(format!("advee-inputs-{name}-{}", std::process::id())))
        }

        fn inputs(&self) -> Inputs {
            let header =
                Header { program: "test".into(), module: "idle".into(), wanted: State::Run, texts: Vec::new() };
            Inputs { run: self.0.clone(), header, limit: 1 << 30 }
        }
    }

    impl Drop for Run {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    fn shell() -> Shell {
        Shell::new(ShellConfig::new("idle"), Box::new(Idle))
    }

    fn live(shell: &mut Shell, calls: u64) {
        let mut out = Actions::new(Epoch::default());
        shell.handle(Moment::ZERO, Event::Start, &mut out);
        for n in 0..calls {
            shell.handle(Moment::from_nanos(n), Event::Timer, &mut out);
            out.drain().for_each(drop);
        }
    }

    fn read(path: &Path) -> (u64, Result<End, Why>) {
        let bytes = std::fs::read(path).unwrap();
        let (mut reader, mut count) = (Reader::open(&bytes).unwrap(), 0);
        loop {
            match reader.read() {
                Ok(Some(Item::Record(_))) => count += 1,
                Ok(Some(Item::End(end))) => return (count, Ok(end)),
                Ok(None) => unreachable!("it has an end"),
                Err(refusal) => return (count, Err(refusal.why)),
            }
        }
    }

    #[test]
    fn each_start_has_its_own_complete_file() {
        let run = Run::new("lives");
        for calls in [10_000, 20] {
            let mut shell = shell();
            let recording = Recording::start(&mut shell, &run.inputs()).unwrap();
            live(&mut shell, calls);
            shell.terminate(Moment::from_millis(1), &mut Actions::default());
            drop(shell);
            drop(recording);
        }
        assert_eq!(read(&run.0.join("inputs/idle")), (10_002, Ok(End::Exited)));
        assert_eq!(read(&run.0.join("inputs/idle.2")), (22, Ok(End::Exited)));
    }

    #[test]
    fn a_blocked_disk_does_not_stop_the_module_and_leaves_a_gap() {
        let run = Run::new("slow");
        std::fs::create_dir_all(&run.0).unwrap();
        // A writer that never runs, like a disk that hangs.
        let shared = Arc::new(Shared::default());
        let mut feeder = Feeder { shared: shared.clone(), held: Vec::new() };
        let mut shell = shell();
        shell.record(Recorder::new(&run.inputs().header, 1 << 30, move |record| feeder.take(record)));
        live(&mut shell, 200_000);
        let mut recording = Recording { shared: shared.clone(), thread: None, told: false };
        assert_eq!(recording.trouble().unwrap(), "the record of inputs is incomplete: the disk is too slow");
        assert_eq!(recording.trouble(), None, "reported once");
        assert!(shared.waiting.lock().unwrap().len() <= BUFFER_MAX);
        // Now the writer runs.
        let path = run.0.join("file");
        let file = File::create(&path).unwrap();
        let writer = thread::spawn(move || shared.write(file));
        thread::sleep(2 * PERIOD);
        live(&mut shell, 10);
        drop(shell);
        writer.join().unwrap();
        let (count, end) = read(&path);
        assert!(count > 10_000 && count < 200_000, "{count}");
        assert!(matches!(end, Err(Why::Gap(lost)) if u64::from(lost) + count == 200_001), "{count} {end:?}");
    }

    #[test]
    fn a_file_that_cannot_be_written_is_reported() {
        let run = Run::new("full");
        let mut shell = shell();
        let shared = Arc::new(Shared::default());
        let mut feeder = Feeder { shared: shared.clone(), held: Vec::new() };
        shell.record(Recorder::new(&run.inputs().header, 1 << 30, move |record| feeder.take(record)));
        live(&mut shell, 10);
        drop(shell);
        shared.write(OpenOptions::new().write(true).open("/dev/full").unwrap());
        let mut recording = Recording { shared, thread: None, told: false };
        let trouble = recording.trouble().unwrap();
        assert!(trouble.starts_with("the record of inputs is incomplete: "), "{trouble}");
    }
}
