//! The watchdog's hands: starts module processes, each in a group of its own, hears of their end, measures them, and
//! takes over those of an earlier watchdog.
//!
//! A process outlives the watchdog that started it, so that a new one finds a robot that works. What that must know
//! stands in a file ([`record`]). An end is told by a pidfd, of a child as of one that was adopted; how an adopted one
//! ended, its parent keeps visible for a moment (`advee up` does).

mod births;
mod identity;
mod record;
mod stderr;
#[cfg(test)]
mod tests;

use self::record::Record;
use super::beats::{self, Page, Reading};
use super::cgroups::{Cgroups, Leaf};
use super::clock;
use super::limits::Limits;
use super::notify;
use super::sys;
use base::{Duration, Instant, Level, Ticker};
use births::{Births, Born};
use identity::Stat;
pub use identity::{VARIABLE, children};
use module::{ExitStatus, ProcessCommand, ProcessEvent, State};
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags};
use nix::sys::signal::{Signal, killpg};
use nix::sys::wait::{Id, WaitPidFlag, WaitStatus, waitid};
use nix::unistd::{Pid, SysconfVar, sysconf};
use std::collections::{BTreeSet, VecDeque};
use std::fs;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use stderr::Stderr;

/// How often it is measured what processes use.
const USAGE: Duration = Duration::from_secs(1);
/// How often it is looked whether they beat.
const LOOK: Duration = Duration::from_millis(20);
/// Beats are missing when a thread is this late.
const LATE: Duration = Duration::from_millis(2 * beats::PERIOD.as_millis() as u64);
/// Period of reading the standard error of foreign modules.
const LINES: Duration = Duration::from_millis(100);
/// Of the record in the run folder.
const RECORD: &str = "processes";

/// How a module is started.
pub struct Start {
    /// The command.
    pub command: Command,
    /// What it may use.
    pub limits: Limits,
    /// A program that may not know that it must end when nobody guards it: our parent takes it over at once, and it
    /// dies with that one. What it writes to its standard error is read and sent on `CM_EVENT_TEXT`.
    pub foreign: bool,
    /// Lowest levels of its lines that are printed and sent; used for foreign modules.
    pub lines_from: LinesFrom,
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

/// Makes the start of a module, by its name and its first state.
pub type Starter = Box<dyn Fn(&str, State) -> Start>;

/// How modules are started: makes the start of one, its first state included.
pub struct Launch {
    /// By name and first state.
    pub start: Starter,
    /// The run folder; none: nothing is written down, and nobody is adopted.
    pub run_dir: Option<PathBuf>,
    /// True if any module has a limit that takes a cgroup which divides.
    pub divides: bool,
    /// The watchdog's own `SCHED_FIFO` priority: above that of any module, so that none can keep it from ending it.
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
    births: Births,
    /// The pidfds; one that is readable has ended. And the births: one may be done.
    ends: Epoll,
    usage: Ticker,
    /// Where their pages are; none: they are judged by their announcements alone.
    beats: Option<PathBuf>,
    looks: Ticker,
    looked: Instant,
    reads: Ticker,
    lines: VecDeque<Line>,
    news: VecDeque<News>,
    /// Lines for people; each is told once.
    notes: VecDeque<String>,
    noted: BTreeSet<String>,
    ticks_per_second: f64,
    page: f64,
}

struct Process {
    pid: u32,
    module: String,
    /// When it started; none: it ended at once.
    start: Option<u64>,
    /// None: it is another's, or was adopted.
    child: Option<Child>,
    /// None where the kernel has none: it is looked after.
    end: Option<OwnedFd>,
    leaf: Option<Leaf>,
    page: Option<Page>,
    /// Standard error of a foreign module.
    stderr: Option<(Stderr, LinesFrom)>,
    /// What stands in its page cannot be.
    bad: bool,
    beats: bool,
    /// Processor time at the last measurement, and when that was.
    ticks: u64,
    measured: Instant,
}

/// What is known of a process before it is there.
struct Unborn {
    module: String,
    leaf: Option<Leaf>,
    page: Option<io::Result<Page>>,
    stderr: Option<(Stderr, LinesFrom)>,
}

/// What the watchdog is to hear.
#[derive(Debug)]
enum News {
    Started { module: String, pid: u32 },
    Earlier { module: String, wanted: State, held: bool, pid: Option<u32> },
    Unstartable { module: String, reason: String },
    Exited { pid: u32, status: ExitStatus },
    Usage { pid: u32, cpu: f64, rss: i64 },
    Beating { pid: u32 },
    Silent { pid: u32, thread: String, last: Instant },
    BadBeats { pid: u32, why: String },
}

/// Removes what a robot's processes left behind; for whoever ends last.
pub fn clean(run_dir: &Path) {
    let _ = fs::remove_file(run_dir.join(RECORD));
    let _ = fs::remove_file(run_dir.join(RECORD).with_extension("new"));
    stderr::clean(run_dir);
    Cgroups::remove(&group_name(run_dir));
}

impl Processes {
    /// Those of an earlier watchdog, if its record says so and they live. Pages of beats are in the folder `beats`.
    ///
    /// # Errors
    /// The machine has no epoll left, in one line.
    pub fn new(now: Instant, launch: Launch, beats: Option<PathBuf>) -> Result<Self, String> {
        let value = |name, usual| sysconf(name).ok().flatten().map_or(usual, |value| value as f64);
        let ends = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).map_err(|errno| format!("epoll: {}", errno.desc()))?;
        let births = Births::new().map_err(|error| format!("eventfd: {error}"))?;
        ends.add(&births, EpollEvent::new(EpollFlags::EPOLLIN, 0))
            .map_err(|errno| format!("epoll: {}", errno.desc()))?;
        let groups = launch.run_dir.as_ref().and_then(|run_dir| Cgroups::open(&group_name(run_dir), launch.divides));
        let mut processes = Self {
            launch,
            running: Vec::new(),
            record: None,
            groups,
            births,
            ends,
            usage: Ticker::new(now + USAGE, USAGE),
            beats,
            looks: Ticker::new(now + LOOK, LOOK),
            looked: now,
            reads: Ticker::new(now + LINES, LINES),
            lines: VecDeque::new(),
            news: VecDeque::new(),
            notes: VecDeque::new(),
            noted: BTreeSet::new(),
            ticks_per_second: value(SysconfVar::CLK_TCK, 100.0),
            page: value(SysconfVar::PAGE_SIZE, 4096.0),
        };
        if let Some(Err(error)) = processes.launch.rt_priority.map(|priority| sys::set_fifo(priority, true)) {
            processes.note(format!("rt_priority of the watchdog: {error}; it runs without"));
        }
        processes.adopt(now);
        Ok(processes)
    }

    /// Takes over what an earlier watchdog wrote down.
    fn adopt(&mut self, now: Instant) {
        let Some(run_dir) = &self.launch.run_dir else { return };
        // As a child sees it, whatever folder it runs in.
        let run_dir = fs::canonicalize(run_dir).unwrap_or_else(|_| run_dir.clone());
        let (mut record, told) = Record::read(&run_dir.join(RECORD), identity::boot());
        self.notes.extend(told.err());
        for entry in record.entries().to_vec() {
            let owner = identity::owner(record.path(), &entry.module);
            let found = match entry.process {
                None if entry.starting => identity::find(&owner),
                other => other,
            };
            let process = found.and_then(|(pid, start)| self.take_over(now, &entry.module, pid, start, &owner));
            // One that was started otherwise than it would be now is of no use.
            let start = (self.launch.start)(&entry.module, State::Run);
            let mark = identity::mark(record.path(), &entry.module, &start.command);
            if let (Some(process), true) = (self.running.last_mut().filter(|_| process.is_some()), start.foreign) {
                process.stderr = Stderr::open(&run_dir, &entry.module).ok().map(|stderr| (stderr, start.lines_from));
            }
            let process = match process {
                Some((pid, _)) if identity::mark_of(pid) != Some(mark) => {
                    self.signal(pid, Signal::SIGKILL);
                    None
                }
                other => other,
            };
            let _ = record.change(&entry.module, |entry| (entry.process, entry.starting) = (process, false));
            let (module, wanted, held) = (entry.module, entry.wanted, entry.held);
            self.news.push_back(News::Earlier { module, wanted, held, pid: process.map(|(pid, _)| pid) });
        }
        self.record = Some(record);
    }

    fn take_over(&mut self, now: Instant, module: &str, pid: u32, start: u64, owner: &str) -> Option<(u32, u64)> {
        let end = sys::pidfd_open(pid).ok();
        // The descriptor is of whoever has the number now: that must be the one that was written down.
        Stat::of(pid).filter(|stat| stat.start == start && !stat.zombie)?;
        identity::mark_of(pid).filter(|mark| mark.starts_with(owner))?;
        let page = self.beats.as_ref().and_then(|folder| Page::open(&folder.join(module)).ok());
        let leaf = self.groups.as_ref().and_then(|groups| groups.leaf(module).ok());
        let mut process = Process {
            pid,
            module: module.into(),
            start: Some(start),
            child: None,
            end,
            leaf,
            page,
            stderr: None,
            bad: false,
            beats: false,
            ticks: 0,
            measured: now,
        };
        process.ticks = Stat::of(pid).map_or(0, |stat| stat.ticks);
        self.watch(&process);
        self.running.push(process);
        Some((pid, start))
    }

    fn watch(&self, process: &Process) {
        if let Some(end) = &process.end {
            // One that cannot be watched is looked after.
            let _ = self.ends.add(end, EpollEvent::new(EpollFlags::EPOLLIN, u64::from(process.pid)));
        }
    }

    /// Does what the watchdog asks.
    pub fn command(&mut self, command: ProcessCommand) {
        match command {
            ProcessCommand::Spawn { module, wanted } => self.spawn(module, wanted),
            ProcessCommand::Terminate { pid } => self.signal(pid, Signal::SIGTERM),
            ProcessCommand::Kill { pid } => self.signal(pid, Signal::SIGKILL),
            ProcessCommand::Remember { module, wanted, held } => {
                self.write_down(&module, |entry| (entry.wanted, entry.held) = (wanted, held));
            }
            // Its host tells whoever guards it.
            ProcessCommand::Health { .. } => {}
        }
    }

    fn spawn(&mut self, module: String, wanted: State) {
        let Start { mut command, limits, foreign, lines_from } = (self.launch.start)(&module, wanted);
        command.stdin(Stdio::null()).process_group(0);
        if let Some(record) = &self.record {
            let mark = identity::mark(record.path(), &module, &command);
            command.env(VARIABLE, mark);
        }
        let page = self.beats.as_ref().map(|folder| {
            let path = folder.join(&module);
            command.env(beats::VARIABLE, &path);
            Page::create(&path)
        });
        // Before it is there: whoever comes after us must look for it.
        self.write_down(&module, |entry| (entry.process, entry.starting, entry.wanted) = (None, true, wanted));
        let leaf = self.groups.as_ref().and_then(|groups| groups.leaf(&module).ok());
        let stderr = self.launch.run_dir.as_ref().filter(|_| foreign).map(|run_dir| Stderr::create(run_dir, &module));
        let stderr = match stderr {
            Some(Ok((stderr, written))) => {
                command.stderr(written);
                Some((stderr, lines_from))
            }
            Some(Err(error)) => {
                self.note(format!("{module}: what it writes to its standard error is not read: {error}"));
                None
            }
            None => None,
        };
        let unborn = Unborn { module: module.clone(), leaf, page, stderr };
        let begun = limits.prepare(unborn.leaf.as_ref()).and_then(|(birth, refused)| {
            sys::give_limits(&mut command, birth, foreign.then(foster).flatten());
            self.births.begin(command, refused, unborn)
        });
        if let Err(error) = begun {
            self.stillborn(module, error.to_string());
        }
    }

    /// A process is there, or is not.
    fn on_birth(&mut self, Unborn { module, leaf, page, stderr }: Unborn, born: Born) {
        for line in born.refused {
            self.note(format!("{module}: {line}"));
        }
        let (pid, child) = match born.process {
            Ok(process) => process,
            Err(reason) => return self.stillborn(module, reason),
        };
        let start = Stat::of(pid).map(|stat| stat.start);
        self.write_down(&module, |entry| {
            (entry.process, entry.starting) = (start.map(|start| (pid, start)), false);
        });
        self.news.push_back(News::Started { module: module.clone(), pid });
        let (page, refused) = page.transpose().map_or_else(|error| (None, Some(error)), |page| (page, None));
        if let Some(error) = refused {
            self.news.push_back(News::BadBeats { pid, why: format!("cannot be made: {error}") });
        }
        let end = sys::pidfd_open(pid).ok();
        let measured = clock::now();
        let process = Process {
            pid,
            module,
            start,
            child,
            end,
            leaf,
            page,
            stderr,
            bad: false,
            beats: false,
            ticks: 0,
            measured,
        };
        self.watch(&process);
        self.running.push(process);
    }

    fn stillborn(&mut self, module: String, reason: String) {
        self.write_down(&module, |entry| entry.starting = false);
        self.news.push_back(News::Unstartable { module, reason });
    }

    fn write_down(&mut self, module: &str, change: impl FnOnce(&mut record::Entry)) {
        let Some(record) = &mut self.record else { return };
        if let Err(error) = record.change(module, change) {
            let line = format!("{}: {error}: a new watchdog will not know these processes", record.path().display());
            self.note(line);
        }
    }

    /// The same line is told once.
    fn note(&mut self, line: String) {
        if self.noted.insert(line.clone()) {
            self.notes.push_back(line);
        }
    }

    /// To a group of ours; a pid that is none of ours is left alone.
    fn signal(&self, pid: u32, signal: Signal) {
        if let Some(process) = self.running.iter().find(|process| process.pid == pid && process.is_itself()) {
            process.signal(signal);
        }
    }

    /// Some may have ended, or begun; which, is looked up.
    pub fn on_ends(&mut self) {
        while let Some((unborn, born)) = self.births.poll() {
            self.on_birth(unborn, born);
        }
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
            self.write_down(&module, |entry| entry.process = entry.process.filter(|(own, _)| *own != pid));
        }
    }

    /// Looks and measures when that is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.looks.due(now) {
            self.look(now);
            if self.running.iter().any(|process| process.end.is_none()) {
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
            let Some(Stat { ticks, pages, .. }) = Stat::of(process.pid) else { continue };
            let seconds = now.since(process.measured).as_secs_f64().max(1e-3);
            let cpu = ticks.saturating_sub(process.ticks) as f64 / self.ticks_per_second / seconds;
            (process.ticks, process.measured) = (ticks, now);
            self.news.push_back(News::Usage { pid: process.pid, cpu, rss: (pages as f64 * self.page) as i64 });
        }
    }

    /// True if they beat.
    fn look(&mut self, now: Instant) {
        let held_up = now.since(self.looked + LOOK);
        // A look that is a little late is no excuse for them.
        let held_up = if held_up < LATE { Duration::ZERO } else { held_up };
        self.looked = now;
        for process in &mut self.running {
            let (Some(page), pid) = (&mut process.page, process.pid) else { continue };
            page.show(now);
            if process.bad {
                continue;
            }
            match page.read(now, pid, held_up) {
                Reading::Blank => {}
                Reading::Oldest { thread, last } => {
                    if !std::mem::replace(&mut process.beats, true) {
                        self.news.push_back(News::Beating { pid });
                    }
                    if now.since(last) >= LATE {
                        self.news.push_back(News::Silent { pid, thread: thread.into(), last });
                    }
                }
                Reading::Bad(why) => {
                    self.news.push_back(News::BadBeats { pid, why: why.into() });
                    process.bad = true;
                }
            }
        }
    }

    /// Looks at the same moments as something else that is due then: one waking less.
    pub fn align(&mut self, now: Instant, due: Instant) {
        let ahead = due.since(now).as_nanos() % LOOK.as_nanos();
        self.looks = Ticker::new(now + Duration::from_nanos(ahead as u64), LOOK);
    }

    /// When to look or to measure next.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let looked_after = |process: &Process| process.page.is_some() || process.end.is_none();
        match self.running.iter().any(looked_after) {
            // Measuring and reading wait for the next look.
            true => Some(self.looks.next()),
            false if self.running.iter().any(|process| process.stderr.is_some()) => {
                Some(self.usage.next().min(self.reads.next()))
            }
            false => (!self.running.is_empty()).then(|| self.usage.next()),
        }
    }

    /// Takes the oldest news and hands it to `take`; false when there is none.
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
            News::Beating { pid } => ProcessEvent::Beating { pid: *pid },
            News::Silent { pid, thread, last } => ProcessEvent::Silent { pid: *pid, thread, last: *last },
            News::BadBeats { pid, why } => ProcessEvent::BadBeats { pid: *pid, why },
        });
        true
    }

    /// Takes a line of a foreign module.
    pub fn poll_line(&mut self) -> Option<Line> {
        self.lines.pop_front()
    }

    /// Takes a line for people.
    pub fn poll_note(&mut self) -> Option<String> {
        self.notes.pop_front()
    }
}

/// Readable when some have ended or begun.
impl AsFd for Processes {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.ends.0.as_fd()
    }
}

impl Process {
    /// True if its number is still its own: a child's is until it is waited for.
    fn is_itself(&self) -> bool {
        self.child.is_some() || Stat::of(self.pid).is_some_and(|stat| Some(stat.start) == self.start)
    }

    /// To all of it. It may just have ended: then its end is on the way.
    fn signal(&self, signal: Signal) {
        let _ = killpg(Pid::from_raw(self.pid as i32), signal);
        if let (Signal::SIGKILL, Some(leaf)) = (signal, &self.leaf) {
            leaf.kill();
        }
    }

    /// How it ended, if it did. What it left in its group is killed before its number may be given away.
    fn ended(&mut self) -> Option<ExitStatus> {
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

    /// Parent waits for it; until then, and if we may, the kernel shows how it ended.
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

    /// Reads the lines that a foreign module wrote; the last one too if it has ended.
    fn read_lines(&mut self, ended: bool, lines: &mut VecDeque<Line>) {
        if let Some((stderr, from)) = &mut self.stderr {
            let (module, from) = (&self.module, *from);
            stderr.read(ended, |level, text| lines.push_back(Line { module: module.clone(), level, text, from }));
        }
    }

    fn clear(&self) {
        if let Some(leaf) = &self.leaf {
            leaf.kill();
        }
    }
}

fn exit_status(status: std::process::ExitStatus) -> ExitStatus {
    match status.signal() {
        Some(signal) => ExitStatus::Signal(signal),
        None => ExitStatus::Code(status.code().unwrap_or_default()),
    }
}

/// Our parent, where that is `advee up`, which cares for orphans.
fn foster() -> Option<Pid> {
    std::env::var_os(notify::VARIABLE).map(|_| nix::unistd::getppid())
}

fn group_name(run_dir: &Path) -> String {
    format!("advee-{:016x}", beats::hash(run_dir))
}
