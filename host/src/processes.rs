//! Processes of the modules: starts them, each in a process group of its own, observes their end, measures their load,
//! and adopts those of an earlier watchdog.
//!
//! A process outlives the watchdog that started it, so that a new watchdog finds a working robot. The information for
//! that is kept in a file (`record`). A pidfd reports the end of a child and of an adopted process alike; the parent
//! of an adopted process (`advee up`) keeps its exit status readable for a moment.

mod identity;
pub(crate) mod kept;
mod punctuality;
mod record;
mod starts;
mod stderr;
#[cfg(test)]
mod tests;

use self::record::Record;
use super::beats::{self, PageReader, Reading};
use super::cgroups::{Cgroups, Leaf};
use super::clock;
use super::keepers::Place;
use super::limits::Limits;
use super::notify;
use super::sys;
use base::{Duration, Instant, Level, Ticker};
pub use identity::{Stat, VARIABLE, children};
use kept::{Answer, Kept};
use messages::common::CmdLevel;
use module::{ExitStatus, Levels, ProcessCommand, ProcessEvent, State};
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags};
use nix::sys::signal::{Signal, kill, killpg};
use nix::sys::wait::{Id, WaitPidFlag, WaitStatus, waitid};
use nix::unistd::{Pid, SysconfVar, sysconf};
use punctuality::Punctuality;
use starts::{Born, Order, StartResult, Starts};
use std::collections::{BTreeSet, VecDeque};
use std::fs;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use stderr::Stderr;

/// Period of measuring the processes' load.
const USAGE_PERIOD: Duration = Duration::from_secs(1);
/// Period of checking their heartbeats.
const HEARTBEAT_CHECK_PERIOD: Duration = punctuality::PERIOD;
/// Delay of a thread at which its heartbeat counts as missing.
const LATE_AFTER: Duration = Duration::from_millis(2 * beats::PERIOD.as_millis() as u64);
/// Period of reading the standard error of foreign modules.
const LINES_PERIOD: Duration = Duration::from_millis(100);
/// Maximum number of answers of a keeper that are read at a time.
const KEEPER_ANSWERS: usize = 16;
/// File name of the record in the run folder.
const RECORD: &str = "processes";

/// Start of a module.
pub struct Start {
    /// Command line.
    pub command: Command,
    /// Its resource limits.
    pub limits: Limits,
    /// Numbers of those of our capabilities that it keeps; without a unit that grants some there are none.
    pub capabilities: &'static [u8],
    /// True for a program in another language, which may not end by itself without a watchdog: our parent adopts it at
    /// once, and it dies with that. Its standard error is read and published on `CM_EVENT_TEXT`.
    pub foreign: bool,
    /// Lowest levels of its lines that are printed and sent; used for foreign modules.
    pub lines_from: LinesFrom,
    /// Keeper that starts it, if it runs as another user. Its arguments are `run`, its name, and those that the keeper
    /// passes on; its limits are the keeper's.
    pub keeper: Option<Place>,
}

/// Lowest levels of a module's lines that are printed and sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinesFrom {
    /// Printed by the watchdog.
    pub print: Level,
    /// Sent on `CM_EVENT_TEXT`.
    pub send: Level,
}

impl Default for LinesFrom {
    fn default() -> Self {
        Self { print: Level::Info, send: Level::Info }
    }
}

impl LinesFrom {
    fn levels(self) -> Levels {
        Levels::new(Some(self.print), Some(self.send))
    }

    fn of(levels: &Levels) -> Self {
        let default = Self::default();
        Self { print: levels.print().unwrap_or(default.print), send: levels.send().unwrap_or(default.send) }
    }
}

/// A line that a foreign module wrote to its standard error.
#[derive(Debug, PartialEq, Eq)]
pub struct Line {
    /// The module.
    pub module: String,
    /// Its level.
    pub level: Level,
    /// The line without its end.
    pub text: String,
    /// The module's thresholds.
    pub from: LinesFrom,
}

/// Creates the start of a module from its name and its first state.
pub type Starter = Box<dyn Fn(&str, State) -> Start>;

/// Starting of modules.
pub struct Launch {
    /// By name and first state.
    pub start: Starter,
    /// Run folder; `None`: nothing is recorded and no process is adopted.
    pub run_dir: Option<PathBuf>,
    /// True if any module has a limit that requires a cgroup with controllers.
    pub divides: bool,
    /// The watchdog's own `SCHED_FIFO` priority: above that of every module, so that none can keep the watchdog from
    /// ending it.
    pub rt_priority: Option<u8>,
    /// Notices about the configuration, each a line, published once after the start.
    pub notices: Vec<String>,
}

/// The processes of a watchdog.
pub struct Processes {
    launch: Launch,
    running: Vec<Process>,
    record: Option<Record>,
    groups: Option<Cgroups>,
    starts: Starts,
    /// Pidfds, readable once their process has ended, and the starts, readable once one may be complete.
    ends: Epoll,
    usage: Ticker,
    /// Folder of the heartbeat pages; `None`: modules are judged by their announcements only.
    beats: Option<PathBuf>,
    looks: Ticker,
    punctuality: Punctuality,
    /// Why the page of the process adopted last cannot be read.
    unread: Option<String>,
    reads: Ticker,
    lines: VecDeque<Line>,
    news: VecDeque<News>,
    /// Warnings for people; each is reported once.
    notes: VecDeque<String>,
    noted: BTreeSet<String>,
    ticks_per_second: f64,
    page: f64,
}

#[derive(Default)]
struct Process {
    pid: u32,
    module: String,
    /// Start time; `None` if the process ended at once.
    start: Option<u64>,
    /// `None` if it is the child of another process or was adopted.
    child: Option<Child>,
    /// The keeper whose child it is.
    kept: Option<Kept>,
    /// `None` if the kernel provides no pidfd: the process is polled.
    end: Option<OwnedFd>,
    leaf: Option<Leaf>,
    page: Option<PageReader>,
    /// Standard error of a foreign module, and the thresholds of its lines.
    stderr: Option<(Stderr, Levels)>,
    /// Its heartbeat page has invalid content.
    bad: bool,
    beats: bool,
    /// The last check found a thread of it silent.
    silent: bool,
    /// Processor time at the last measurement, and the time of that.
    ticks: u64,
    measured: Instant,
    /// Processor time and resident pages as reported by its keeper: `/proc` may not show processes of other users.
    used: Option<(u64, u64)>,
}

/// Data of a process that is being started.
struct PendingStart {
    module: String,
    leaf: Option<Leaf>,
    page: Option<io::Result<PageReader>>,
    stderr: Option<(Stderr, Levels)>,
}

/// News for the watchdog.
#[derive(Debug)]
enum News {
    Started { module: String, pid: u32 },
    Earlier { module: String, wanted: State, held: bool, pid: Option<u32> },
    Unstartable { module: String, reason: String },
    Exited { pid: u32, status: ExitStatus },
    Usage { pid: u32, cpu: f64, rss: i64 },
    HeartbeatStarted { pid: u32 },
    HeartbeatLate { pid: u32, thread: String, last: Instant },
    CheckLate { by: Duration },
    BadHeartbeat { pid: u32, why: String },
}

/// Removes the files and cgroups of a robot's processes; called by the process that ends last.
pub fn clean(run_dir: &Path) {
    let _ = fs::remove_file(run_dir.join(RECORD));
    let _ = fs::remove_file(run_dir.join(RECORD).with_extension("new"));
    stderr::clean(run_dir);
    for link in Place::all().unwrap_or_default().iter().map(|place| run_dir.join(&place.module)) {
        if link.is_symlink() {
            let _ = fs::remove_file(link);
        }
    }
    Cgroups::remove(&group_name(run_dir));
}

impl Processes {
    /// Adopts the processes of an earlier watchdog that its record lists and that are alive. Heartbeat pages are in the
    /// folder `beats`.
    ///
    /// # Errors
    /// The machine refused an epoll, in one line.
    pub fn new(now: Instant, launch: Launch, beats: Option<PathBuf>) -> Result<Self, String> {
        let value = |name, usual| sysconf(name).ok().flatten().map_or(usual, |value| value as f64);
        let ends = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).map_err(|errno| format!("epoll: {}", errno.desc()))?;
        let starts = Starts::new().map_err(|error| format!("eventfd: {error}"))?;
        ends.add(&starts, EpollEvent::new(EpollFlags::EPOLLIN, 0))
            .map_err(|errno| format!("epoll: {}", errno.desc()))?;
        let groups = launch.run_dir.as_ref().and_then(|run_dir| Cgroups::open(&group_name(run_dir), launch.divides));
        let mut processes = Self {
            launch,
            running: Vec::new(),
            record: None,
            groups,
            starts,
            ends,
            usage: Ticker::new(now + USAGE_PERIOD, USAGE_PERIOD),
            beats,
            // With the watchdog's other periods, which saves wake-ups.
            looks: Ticker::new(Instant::ZERO.next_on_grid(now, HEARTBEAT_CHECK_PERIOD), HEARTBEAT_CHECK_PERIOD),
            punctuality: Punctuality::new(now),
            unread: None,
            reads: Ticker::new(now + LINES_PERIOD, LINES_PERIOD),
            lines: VecDeque::new(),
            news: VecDeque::new(),
            notes: VecDeque::new(),
            noted: BTreeSet::new(),
            ticks_per_second: value(SysconfVar::CLK_TCK, 100.0),
            page: value(SysconfVar::PAGE_SIZE, 4096.0),
        };
        if let Some(Err(error)) = processes.launch.rt_priority.map(|priority| sys::set_fifo(priority, true)) {
            processes.note(format!("rt_priority of the watchdog: {error}; not set"));
        }
        processes.adopt(now);
        Ok(processes)
    }

    /// Adopts the processes in the record of an earlier watchdog.
    fn adopt(&mut self, now: Instant) {
        let Some(run_dir) = &self.launch.run_dir else { return };
        // Resolved as a child sees it, whatever its working directory.
        let run_dir = fs::canonicalize(run_dir).unwrap_or_else(|_| run_dir.clone());
        let (mut record, told) = Record::read(&run_dir.join(RECORD), identity::boot());
        self.notes.extend(told.err());
        for entry in record.entries().to_vec() {
            let owner = identity::owner(record.path(), &entry.module);
            let start = (self.launch.start)(&entry.module, State::Run);
            let mark = identity::mark(record.path(), &entry.module, &start.command);
            let (process, its_mark) = match &start.keeper {
                Some(place) => self.take_over_kept(now, place, &owner).unzip(),
                None => {
                    let found = match entry.process {
                        None if entry.starting => identity::find(&owner),
                        other => other,
                    };
                    let process = found.and_then(|(pid, start)| self.take_over(now, &entry.module, pid, start, &owner));
                    (process, process.and_then(|(pid, _)| identity::mark_of(pid)))
                }
            };
            if let (Some(process), true) = (self.running.last_mut().filter(|_| process.is_some()), start.foreign) {
                let levels = start.lines_from.levels();
                process.stderr = Stderr::open(&run_dir, &entry.module).ok().map(|stderr| (stderr, levels));
            }
            let process = match process {
                // Not adopted: its command line differs from today's configuration.
                Some((pid, _)) if its_mark != Some(mark) => {
                    self.signal(pid, Signal::SIGKILL);
                    None
                }
                other => other,
            };
            if let Err(error) = record.change(&entry.module, |entry| (entry.process, entry.starting) = (process, false))
            {
                self.note(not_recorded(&record, &error));
            }
            let (module, wanted, held) = (entry.module, entry.wanted, entry.held);
            self.news.push_back(News::Earlier { module, wanted, held, pid: process.map(|(pid, _)| pid) });
            // After the module is known.
            if let (Some((pid, _)), Some(why)) = (process, self.unread.take()) {
                self.news.push_back(News::BadHeartbeat { pid, why });
            }
        }
        self.record = Some(record);
    }

    fn take_over(&mut self, now: Instant, module: &str, pid: u32, start: u64, owner: &str) -> Option<(u32, u64)> {
        let end = sys::pidfd_open(pid).ok();
        // The descriptor refers to the current owner of the number, which must be the recorded process.
        Stat::of(pid).filter(|stat| stat.start == start && !stat.zombie)?;
        identity::mark_of(pid).filter(|mark| mark.starts_with(owner))?;
        let leaf = self.groups.as_ref().and_then(|groups| groups.leaf(module).ok());
        let ticks = Stat::of(pid).map_or(0, |stat| stat.ticks);
        let page = self.page_of(module);
        let process = Process { end, leaf, page, ticks, ..Process::new(pid, module.into(), Some(start), now) };
        self.watch(&process);
        self.running.push(process);
        Some((pid, start))
    }

    /// Takes over the process that a keeper has; with its mark.
    fn take_over_kept(&mut self, now: Instant, place: &Place, owner: &str) -> Option<((u32, u64), String)> {
        let (kept, Answer::Running { pid, start, mark }) = Kept::find(place).ok()? else { return None };
        if !mark.starts_with(owner) || !is_foreign(pid) {
            return None;
        }
        let page = self.page_of(&place.module);
        let kept = Some(kept);
        let process = Process { kept, page, ..Process::new(pid, place.module.clone(), Some(start), now) };
        self.watch(&process);
        self.running.push(process);
        Some(((pid, start), mark))
    }

    /// Opens the heartbeat page of a running module.
    fn page_of(&mut self, module: &str) -> Option<PageReader> {
        let page = self.beats.as_ref().map(|folder| PageReader::open(&folder.join(module))).transpose();
        let (page, unread) = match page {
            Ok(page) => (page, None),
            Err(error) => (None, Some(format!("cannot be opened: {error}"))),
        };
        self.unread = unread;
        page
    }

    fn watch(&mut self, process: &Process) {
        if self.running.iter().all(|other| other.page.is_none()) {
            self.punctuality.resume(process.measured);
        }
        if let Some(end) = &process.end {
            // Without a descriptor the process is polled.
            let _ = self.ends.add(end, EpollEvent::new(EpollFlags::EPOLLIN, u64::from(process.pid)));
        }
        if let Some(kept) = &process.kept {
            let _ = self.ends.add(kept, EpollEvent::new(EpollFlags::EPOLLIN, u64::from(process.pid)));
        }
    }

    /// Executes a command of the watchdog.
    pub fn command(&mut self, command: ProcessCommand) {
        match command {
            ProcessCommand::Spawn { module, wanted } => self.spawn(module, wanted),
            ProcessCommand::Terminate { pid } => self.signal(pid, Signal::SIGTERM),
            ProcessCommand::Kill { pid } => self.signal(pid, Signal::SIGKILL),
            ProcessCommand::Remember { module, wanted, held } => {
                self.record_entry(&module, |entry| (entry.wanted, entry.held) = (wanted, held));
            }
            // Handled by the host, which reports it to the parent.
            ProcessCommand::Health { .. } => {}
        }
    }

    /// Changes the thresholds of the lines of the foreign modules that a command concerns, until their process or this
    /// watchdog ends; returns each of these modules with its thresholds. A command that is no valid one concerns none.
    pub fn set_levels(&mut self, command: &CmdLevel) -> Vec<(String, Levels)> {
        let meant = self.running.iter_mut().filter(|process| Levels::are_meant(command, &process.module));
        let obeyed = |process: &mut Process| {
            let (_, levels) = process.stderr.as_mut()?;
            levels.obey(command).ok()?;
            Some((process.module.clone(), *levels))
        };
        meant.filter_map(obeyed).collect()
    }

    fn spawn(&mut self, module: String, wanted: State) {
        let start = (self.launch.start)(&module, wanted);
        let Start { mut command, limits, capabilities, foreign, lines_from, keeper } = start;
        command.stdin(Stdio::null()).process_group(0);
        let mark = self.record.as_ref().map(|record| identity::mark(record.path(), &module, &command));
        command.envs(mark.iter().map(|mark| (VARIABLE, mark)));
        let path = self.beats.as_ref().map(|folder| folder.join(&module));
        command.envs(path.iter().map(|path| (beats::VARIABLE, path)));
        let page = path.as_ref().map(|path| PageReader::create(path, keeper.is_some()));
        // Recorded before the process exists, so that a successor can look for it.
        self.record_entry(&module, |entry| (entry.process, entry.starting, entry.wanted) = (None, true, wanted));
        if let Some(place) = keeper {
            return self.spawn_kept(place, &command, &limits, mark.unwrap_or_default(), page);
        }
        let leaf = self.groups.as_ref().and_then(|groups| groups.leaf(&module).ok());
        let stderr = self.launch.run_dir.as_ref().filter(|_| foreign).map(|run_dir| Stderr::create(run_dir, &module));
        let stderr = match stderr {
            Some(Ok((stderr, written))) => {
                command.stderr(written);
                Some((stderr, lines_from.levels()))
            }
            Some(Err(error)) => {
                self.note(format!("{module}: its standard error is not read: {error}"));
                None
            }
            None => None,
        };
        let pending = PendingStart { module: module.clone(), leaf, page, stderr };
        let begun = limits.prepare(pending.leaf.as_ref(), capabilities).and_then(|(birth, refused)| {
            sys::give_limits(&mut command, birth, foreign.then(subreaper).flatten());
            self.starts.begin(command, refused, pending)
        });
        if let Err(error) = begun {
            self.start_failed(module, error.to_string());
        }
    }

    /// Has a module started by its keeper.
    fn spawn_kept(
        &mut self,
        place: Place,
        command: &Command,
        limits: &Limits,
        mark: String,
        page: Option<io::Result<PageReader>>,
    ) {
        let module = place.module.clone();
        if *limits != Limits::default() {
            self.note(format!("{module}: limits in modules.toml are not applied: those of its keeper's unit hold"));
        }
        if let Some(Err(error)) = self.launch.run_dir.as_ref().map(|run_dir| link(&run_dir.join(&module), &place)) {
            self.note(format!("{module}: its folder is not linked in the run folder: {error}"));
        }
        let path = self.beats.as_ref().map(|folder| folder.join(&module));
        let pending = PendingStart { module: module.clone(), leaf: None, page, stderr: None };
        // Without the name of the program, `run` and that of the module, which the keeper knows.
        let args = command.get_args().skip(2).map(Into::into).collect();
        if let Err(error) = self.starts.begin_kept(Order { place, mark, page: path, args }, pending) {
            self.start_failed(module, error.to_string());
        }
    }

    /// Completes a start, successful or not.
    fn on_start_result(&mut self, PendingStart { module, leaf, page, stderr }: PendingStart, result: StartResult) {
        for line in result.refused {
            self.note(format!("{module}: {line}"));
        }
        let Born { pid, start, child, kept } = match result.process {
            Ok(Born { pid, kept: Some(_), .. }) if !is_foreign(pid) => {
                return self.start_failed(module, "its keeper names a process of this user".into());
            }
            Ok(born) => born,
            Err(reason) => return self.start_failed(module, reason),
        };
        // A process id that a keeper reported before, and that now belongs to this process: the keeper's process no
        // longer exists.
        self.forget_kept(pid);
        let start = start.or_else(|| Stat::of(pid).map(|stat| stat.start));
        self.record_entry(&module, |entry| {
            (entry.process, entry.starting) = (start.map(|start| (pid, start)), false);
        });
        self.news.push_back(News::Started { module: module.clone(), pid });
        let (page, refused) = page.transpose().map_or_else(|error| (None, Some(error)), |page| (page, None));
        if let Some(error) = refused {
            self.news.push_back(News::BadHeartbeat { pid, why: format!("cannot be made: {error}") });
        }
        let end = if kept.is_some() { None } else { sys::pidfd_open(pid).ok() };
        let new = Process::new(pid, module, start, clock::now());
        let process = Process { child, kept, end, leaf, page, stderr, ..new };
        self.watch(&process);
        self.running.push(process);
    }

    /// Gives up a keeper's process.
    fn forget_kept(&mut self, pid: u32) {
        let news = &mut self.news;
        self.running.retain(|process| {
            let stays = process.pid != pid || process.kept.is_none();
            if !stays {
                news.push_back(News::Exited { pid, status: ExitStatus::Code(-1) });
            }
            stays
        });
    }

    fn start_failed(&mut self, module: String, reason: String) {
        self.record_entry(&module, |entry| entry.starting = false);
        self.news.push_back(News::Unstartable { module, reason });
    }

    fn record_entry(&mut self, module: &str, change: impl FnOnce(&mut record::Entry)) {
        let Some(record) = &mut self.record else { return };
        if let Err(error) = record.change(module, change) {
            let line = not_recorded(record, &error);
            self.note(line);
        }
    }

    /// Queues a warning; the same line is reported once.
    fn note(&mut self, line: String) {
        if self.noted.insert(line.clone()) {
            self.notes.push_back(line);
        }
    }

    /// Sends a signal to a process group of ours; other pids are ignored.
    fn signal(&self, pid: u32, signal: Signal) {
        if let Some(process) = self.running.iter().find(|process| process.pid == pid && process.is_itself()) {
            process.signal(signal);
        }
    }

    /// Processes starts that are complete.
    pub fn on_starts(&mut self) {
        while let Some((pending, result)) = self.starts.poll() {
            self.on_start_result(pending, result);
        }
    }

    /// Some processes may have ended or been started; finds out which.
    pub fn on_ends(&mut self) {
        self.on_starts();
        let mut ended = Vec::new();
        let (news, lines) = (&mut self.news, &mut self.lines);
        self.running.retain_mut(|process| {
            let status = process.ended();
            if status.is_some() {
                process.read_lines(true, lines);
            }
            news.extend(status.map(|status| News::Exited { pid: process.pid, status }));
            ended.extend(status.map(|_| (process.module.clone(), process.pid)));
            status.is_none()
        });
        for (module, pid) in ended {
            self.record_entry(&module, |entry| entry.process = entry.process.filter(|(own, _)| *own != pid));
        }
    }

    /// Checks and measures the processes if that is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.looks.due(now) {
            self.check_heartbeats(now);
            if self.running.iter().any(Process::is_polled) {
                self.on_ends();
            }
        }
        if self.reads.due(now) {
            for process in &mut self.running {
                process.read_lines(false, &mut self.lines);
            }
        }
        if !self.usage.due(now) {
            return;
        }
        for process in &mut self.running {
            let used = match process.kept {
                Some(_) => process.used,
                None => Stat::of(process.pid).map(|stat| (stat.ticks, stat.pages)),
            };
            let Some((ticks, pages)) = used else { continue };
            let seconds = now.since(process.measured).as_secs_f64().max(1e-3);
            let cpu = ticks.saturating_sub(process.ticks) as f64 / self.ticks_per_second / seconds;
            (process.ticks, process.measured) = (ticks, now);
            self.news.push_back(News::Usage { pid: process.pid, cpu, rss: (pages as f64 * self.page) as i64 });
        }
    }

    /// Checks the heartbeats.
    fn check_heartbeats(&mut self, now: Instant) {
        if self.running.iter().all(|process| process.page.is_none()) {
            return self.punctuality.resume(now);
        }
        let check = self.punctuality.check(now);
        if check.late > Duration::ZERO {
            self.news.push_back(News::CheckLate { by: check.late });
        }
        for process in &mut self.running {
            let (Some(page), pid) = (&mut process.page, process.pid) else { continue };
            page.show(now);
            if process.bad {
                continue;
            }
            match page.read(now, pid, check.forgiven) {
                Reading::Blank => {}
                Reading::Oldest { thread, last } => {
                    if !std::mem::replace(&mut process.beats, true) {
                        self.news.push_back(News::HeartbeatStarted { pid });
                    }
                    if check.reports(now.since(last) >= LATE_AFTER, &mut process.silent) {
                        self.news.push_back(News::HeartbeatLate { pid, thread: thread.into(), last });
                    }
                }
                Reading::Bad(why) => {
                    self.news.push_back(News::BadHeartbeat { pid, why: why.into() });
                    process.bad = true;
                }
            }
        }
    }

    /// Deadline of the next check or measurement.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let looked_after = |process: &Process| process.page.is_some() || process.is_polled();
        match self.running.iter().any(looked_after) {
            // Measuring and reading are done with the next check.
            true => Some(self.looks.next()),
            false if self.running.iter().any(|process| process.stderr.is_some()) => {
                Some(self.usage.next().min(self.reads.next()))
            }
            false => (!self.running.is_empty()).then(|| self.usage.next()),
        }
    }

    /// Passes the oldest event to `take`; false if there is none.
    pub fn poll_event(&mut self, take: impl FnOnce(ProcessEvent<'_>)) -> bool {
        let Some(news) = self.news.pop_front() else {
            return false;
        };
        take(match &news {
            News::Started { module, pid } => ProcessEvent::Started { module, pid: *pid },
            News::Earlier { module, wanted, held, pid } => {
                ProcessEvent::Earlier { module, wanted: *wanted, held: *held, pid: *pid }
            }
            News::Unstartable { module, reason } => ProcessEvent::Unstartable { module, reason },
            News::Exited { pid, status } => ProcessEvent::Exited { pid: *pid, status: *status },
            News::Usage { pid, cpu, rss } => ProcessEvent::Usage { pid: *pid, cpu: *cpu, rss: *rss },
            News::HeartbeatStarted { pid } => ProcessEvent::HeartbeatStarted { pid: *pid },
            News::HeartbeatLate { pid, thread, last } => ProcessEvent::HeartbeatLate { pid: *pid, thread, last: *last },
            News::CheckLate { by } => ProcessEvent::CheckLate { by: *by },
            News::BadHeartbeat { pid, why } => ProcessEvent::BadHeartbeat { pid: *pid, why },
        });
        true
    }

    /// Removes and returns a line of a foreign module.
    pub fn poll_line(&mut self) -> Option<Line> {
        self.lines.pop_front()
    }

    /// Removes and returns a warning for people.
    pub fn poll_note(&mut self) -> Option<String> {
        self.notes.pop_front()
    }
}

/// Readable if some processes have ended or been result.
impl AsFd for Processes {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.ends.0.as_fd()
    }
}

impl Process {
    fn new(pid: u32, module: String, start: Option<u64>, measured: Instant) -> Self {
        Self { pid, module, start, measured, ..Self::default() }
    }

    /// True if nothing becomes readable when it ends.
    fn is_polled(&self) -> bool {
        self.end.is_none() && self.kept.is_none()
    }

    /// True if its number still refers to this process: that of a child does until it is reaped.
    fn is_itself(&self) -> bool {
        self.child.is_some()
            || self.kept.is_some()
            || Stat::of(self.pid).is_some_and(|stat| Some(stat.start) == self.start)
    }

    /// Sends a signal to the process and all that it started, unless it has ended: then its end is about to be
    /// reported.
    fn signal(&self, signal: Signal) {
        if let Some(kept) = &self.kept {
            return kept.signal(signal);
        }
        match (&self.end, &self.leaf) {
            // An adopted process: its parent may reap it at any time, and its process id may be reused.
            (Some(end), Some(leaf)) if self.child.is_none() => {
                if sys::pidfd_send_signal(end.as_fd(), signal).is_ok() {
                    leaf.signal_others(self.pid, signal);
                }
            }
            // The process id of a child stays its own until it is reaped here.
            _ => {
                let _ = killpg(Pid::from_raw(self.pid as i32), signal);
            }
        }
        if let (Signal::SIGKILL, Some(leaf)) = (signal, &self.leaf) {
            leaf.kill();
        }
    }

    /// Exit status, if it ended. Processes left in its group are killed before its number can be reused.
    fn ended(&mut self) -> Option<ExitStatus> {
        if self.kept.is_some() {
            return self.kept_ended();
        }
        let Some(child) = &mut self.child else {
            return self.adopted_ended();
        };
        let flags = WaitPidFlag::WEXITED | WaitPidFlag::WNOHANG | WaitPidFlag::WNOWAIT;
        if let Ok(WaitStatus::StillAlive) = waitid(Id::Pid(Pid::from_raw(self.pid as i32)), flags) {
            return None;
        }
        let status = {
            let _ = killpg(Pid::from_raw(self.pid as i32), Signal::SIGKILL);
            child.try_wait().ok().flatten()?
        };
        self.clear();
        Some(exit_status(status))
    }

    /// The state that its keeper reports; without a keeper it has ended.
    fn kept_ended(&mut self) -> Option<ExitStatus> {
        let kept = self.kept.as_ref()?;
        for _ in 0..KEEPER_ANSWERS {
            match kept.poll() {
                Ok(None) => return None,
                Ok(Some(Answer::Used { ticks, pages })) => self.used = Some((ticks, pages)),
                Ok(Some(Answer::Ended(status))) => {
                    return Some(exit_status(std::process::ExitStatus::from_raw(status)));
                }
                Ok(Some(_)) => {}
                Err(_) => return Some(ExitStatus::Code(-1)),
            }
        }
        None
    }

    /// The parent reaps an adopted process; until then the kernel shows its exit status, if permitted.
    fn adopted_ended(&self) -> Option<ExitStatus> {
        let stat = Stat::of(self.pid).filter(|stat| Some(stat.start) == self.start);
        let status = match stat {
            Some(Stat { zombie: false, .. }) => return None,
            Some(Stat { zombie: true, status, .. }) => {
                let _ = killpg(Pid::from_raw(self.pid as i32), Signal::SIGKILL);
                exit_status(std::process::ExitStatus::from_raw(status))
            }
            None => ExitStatus::Code(-1),
        };
        self.clear();
        Some(status)
    }

    /// Reads the lines that a foreign module wrote, including an unfinished last line if it has ended.
    fn read_lines(&mut self, ended: bool, lines: &mut VecDeque<Line>) {
        if let Some((stderr, levels)) = &mut self.stderr {
            let (module, from) = (&self.module, LinesFrom::of(levels));
            stderr.read(ended, |level, text| lines.push_back(Line { module: module.clone(), level, text, from }));
        }
    }

    fn clear(&self) {
        if let Some(leaf) = &self.leaf {
            leaf.kill();
        }
    }
}

/// True if a process is another user's: one of this user is not what a keeper started.
fn is_foreign(pid: u32) -> bool {
    kill(Pid::from_raw(pid as i32), None).is_err() || nix::unistd::geteuid().is_root()
}

/// Links the folder of a kept module into the run folder.
fn link(name: &Path, place: &Place) -> io::Result<()> {
    let folder = place.folder.join(&place.module);
    if fs::read_link(name).is_ok_and(|to| to == folder) {
        return Ok(());
    }
    match fs::symlink_metadata(name) {
        Ok(found) if found.is_dir() => fs::remove_dir_all(name)?,
        Ok(_) => fs::remove_file(name)?,
        Err(_) => {}
    }
    std::os::unix::fs::symlink(folder, name)
}

fn not_recorded(record: &Record, error: &io::Error) -> String {
    format!("{}: {error}; a restarted watchdog will not adopt these processes", record.path().display())
}

fn exit_status(status: std::process::ExitStatus) -> ExitStatus {
    match status.signal() {
        Some(signal) => ExitStatus::Signal(signal),
        None => ExitStatus::Code(status.code().unwrap_or_default()),
    }
}

/// Our parent if it is `advee up`, which adopts orphans.
fn subreaper() -> Option<Pid> {
    std::env::var_os(notify::VARIABLE).map(|_| nix::unistd::getppid())
}

fn group_name(run_dir: &Path) -> String {
    format!("advee-{:016x}", beats::hash(run_dir))
}
