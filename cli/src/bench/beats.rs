//! How even the threads of a running robot beat, seen where its watchdog sees it: in their pages in memory.

use super::histogram::Histogram;
use super::report::{Report, Row, kernel};
use crate::bus::interrupt;
use crate::{Failed, holder};
use base::{Duration, Instant, Ticker};
use host::beats::{self, PageReader, Reading};
use host::clock;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::signalfd::SignalFd;
use nix::sys::time::TimeSpec;
use std::os::fd::AsFd;
use std::path::Path;

/// The pages are looked at this often: gaps are known to this.
const LOOK: Duration = Duration::from_millis(1);
/// Gaps of this length and more are counted together, µs: longer than the limit of a hang.
const LIMIT: usize = 250_000;
/// Maximum number of threads that are measured.
const THREADS_MAX: usize = 64;

/// Heartbeats of a thread.
struct Thread {
    name: String,
    /// Instant of the last heartbeat seen; `None` before the first.
    last: Option<Instant>,
    seen: Instant,
    gaps: Histogram,
}

/// A module's page.
struct Watched {
    module: String,
    pid: u32,
    page: PageReader,
    threads: Vec<Thread>,
    bad: u64,
}

impl Watched {
    /// Reads the heartbeat page; adds new threads up to `room`.
    fn look(&mut self, now: Instant, room: &mut usize) {
        if let Reading::Bad(_) = self.page.read(now, self.pid, Duration::ZERO) {
            self.bad += 1;
            return;
        }
        for (index, (name, last)) in self.page.threads().enumerate() {
            match self.threads.get_mut(index) {
                Some(thread) if thread.seen != last => {
                    if let Some(before) = thread.last.replace(last) {
                        thread.gaps.add(last.since(before).as_micros() as u64);
                    }
                    thread.seen = last;
                }
                Some(_) => {}
                None if *room > 0 => {
                    *room -= 1;
                    let gaps = Histogram::new(LIMIT);
                    self.threads.push(Thread { name: name.into(), last: None, seen: last, gaps });
                }
                None => {}
            }
        }
    }

    fn rows(&self, now: Instant) -> impl Iterator<Item = Row> {
        let row = move |thread: &Thread| {
            let mut counts = Vec::new();
            let silent = now.since(thread.seen);
            // The one that is still open.
            if silent > 2 * beats::PERIOD {
                counts.push(("us silent at the end", silent.as_micros() as u64));
            }
            if self.bad > 0 {
                counts.push(("looks at a page that is bad or another process's", self.bad));
            }
            let name = format!("{} {}", self.module, thread.name);
            Row { name, period_us: Some(beats::PERIOD.as_micros() as u64), times: thread.gaps.clone(), counts }
        };
        self.threads.iter().map(row)
    }
}

/// Measures until the time is over, or until Ctrl-C.
pub fn measure(run_dir: &Path, time: Option<Duration>) -> Result<Report, Failed> {
    let interrupt = interrupt()?;
    let mut watched = open(run_dir)?;
    let mut room = THREADS_MAX;
    let mut looks = Ticker::new(clock::now(), LOOK);
    let until = time.map_or(Instant::NEVER, |time| clock::now() + time);
    let (mut looked, mut late) = (clock::now(), Duration::ZERO);
    while clock::now() < until && !pause(&interrupt, looks.next())? {
        let now = clock::now();
        if looks.due(now) {
            late = late.max(now.since(looked));
            looked = now;
            watched.iter_mut().for_each(|watched| watched.look(now, &mut room));
        }
    }
    let rows: Vec<Row> = watched.iter().flat_map(|watched| watched.rows(looked)).collect();
    let worst = late.as_micros();
    let how = format!("gaps between beats, looked at each 1000 us and at worst after {worst}, kernel {}", kernel());
    Ok(Report { how, times: "from beat to beat", rows })
}

/// The pages of the robot that runs here.
fn open(run_dir: &Path) -> Result<Vec<Watched>, Failed> {
    let nobody = || Failed::from(format!("no module beats: does a robot run in {}?", run_dir.display()));
    let here = std::fs::canonicalize(run_dir).map_err(|_| nobody())?;
    let folder = beats::folder_path(&here);
    let of_ours = |running: &holder::Running| running.place.run_dir.canonicalize().is_ok_and(|dir| dir == here);
    let open = |running: holder::Running| {
        let page = PageReader::look_on(&folder.join(&running.module)).ok()?;
        Some(Watched { module: running.module, pid: running.pid, page, threads: Vec::new(), bad: 0 })
    };
    let mut watched: Vec<Watched> = holder::modules().filter(of_ours).filter_map(open).collect();
    watched.sort_by(|one, other| one.module.cmp(&other.module));
    if watched.is_empty() { Err(nobody()) } else { Ok(watched) }
}

/// Waits until then; true at Ctrl-C.
fn pause(interrupt: &SignalFd, until: Instant) -> Result<bool, Failed> {
    let wait = TimeSpec::from_duration(until.since(clock::now()));
    let mut fds = [PollFd::new(interrupt.as_fd(), PollFlags::POLLIN)];
    match ppoll(&mut fds, Some(wait), None) {
        Ok(0) | Err(nix::errno::Errno::EINTR) => Ok(false),
        Ok(_) => Ok(true),
        Err(errno) => Err(format!("poll: {}", errno.desc()).into()),
    }
}
