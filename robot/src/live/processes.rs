//! The watchdog's hands: starts module processes, each in a group of its own, hears of their end, measures them.
//!
//! A module's process is killed by the kernel when the one that started it ends, however that happens: nothing outlives
//! its watchdog. An end is told by SIGCHLD through the host's signalfd, which is as quick as a pidfd for one's own
//! children and needs no descriptor for each.

use super::beats::{self, Page, Reading};
use super::sys;
use base::{Duration, Instant, Ticker};
use module::{ExitStatus, ProcessCommand, ProcessEvent, State};
use nix::sys::signal::{Signal, killpg};
use nix::sys::wait::{Id, WaitPidFlag, WaitStatus, waitid};
use nix::unistd::{Pid, SysconfVar, sysconf};
use std::collections::VecDeque;
use std::fs;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

/// How often it is measured what processes use.
const USAGE: Duration = Duration::from_secs(1);
/// How often it is looked whether they beat.
const LOOK: Duration = Duration::from_millis(20);
/// Beats are missing when a thread is this late.
const LATE: Duration = Duration::from_millis(2 * beats::PERIOD.as_millis() as u64);

/// Makes the command that runs a module, first state included.
pub type Launch = Box<dyn Fn(&str, State) -> Command>;

/// The processes of a watchdog.
pub struct Processes {
    launch: Launch,
    running: Vec<Process>,
    usage: Ticker,
    /// Where their pages are; none: they are judged by their announcements alone.
    beats: Option<PathBuf>,
    looks: Ticker,
    looked: Instant,
    news: VecDeque<News>,
    ticks_per_second: f64,
    page: f64,
}

struct Process {
    child: Child,
    page: Option<Page>,
    beats: bool,
    /// Processor time at the last measurement, and when that was.
    ticks: u64,
    measured: Instant,
}

/// What the watchdog is to hear.
#[derive(Debug)]
enum News {
    Started { module: String, pid: u32 },
    Unstartable { module: String, reason: String },
    Exited { pid: u32, status: ExitStatus },
    Usage { pid: u32, cpu: f64, rss: i64 },
    Beating { pid: u32 },
    Silent { pid: u32, thread: String, last: Instant },
    BadBeats { pid: u32, why: String },
}

impl Processes {
    /// None yet. Their pages of beats are in the folder `beats`.
    #[must_use]
    pub fn new(now: Instant, launch: Launch, beats: Option<PathBuf>) -> Self {
        let value = |name, usual| sysconf(name).ok().flatten().map_or(usual, |value| value as f64);
        Self {
            launch,
            running: Vec::new(),
            usage: Ticker::new(now + USAGE, USAGE),
            beats,
            looks: Ticker::new(now + LOOK, LOOK),
            looked: now,
            news: VecDeque::new(),
            ticks_per_second: value(SysconfVar::CLK_TCK, 100.0),
            page: value(SysconfVar::PAGE_SIZE, 4096.0),
        }
    }

    /// Does what the watchdog asks.
    pub fn command(&mut self, now: Instant, command: ProcessCommand) {
        match command {
            ProcessCommand::Spawn { module, wanted } => self.spawn(now, module, wanted),
            ProcessCommand::Terminate { pid } => self.signal(pid, Signal::SIGTERM),
            ProcessCommand::Kill { pid } => self.signal(pid, Signal::SIGKILL),
            ProcessCommand::Remember { .. } | ProcessCommand::Health { .. } => {}
        }
    }

    fn spawn(&mut self, now: Instant, module: String, wanted: State) {
        let mut command = (self.launch)(&module, wanted);
        command.stdin(Stdio::null()).process_group(0);
        sys::die_with_parent(&mut command);
        let page = self.beats.as_ref().map(|folder| {
            let path = folder.join(&module);
            command.env(beats::VARIABLE, &path);
            Page::create(&path)
        });
        match command.spawn() {
            Ok(child) => {
                let pid = child.id();
                self.news.push_back(News::Started { module, pid });
                let (page, refused) = page.transpose().map_or_else(|error| (None, Some(error)), |page| (page, None));
                if let Some(error) = refused {
                    self.news.push_back(News::BadBeats { pid, why: format!("cannot be made: {error}") });
                }
                self.running.push(Process { child, page, beats: false, ticks: 0, measured: now });
            }
            Err(error) => {
                let reason = format!("{}: {error}", command.get_program().display());
                self.news.push_back(News::Unstartable { module, reason });
            }
        }
    }

    /// To a group of ours; a pid that is none of ours is left alone.
    fn signal(&self, pid: u32, signal: Signal) {
        if self.running.iter().any(|process| process.child.id() == pid) {
            // It may just have ended: then its end is on the way.
            let _ = killpg(Pid::from_raw(pid as i32), signal);
        }
    }

    /// A child has ended; which, is looked up: signals of several ends may be one.
    pub fn on_child_signal(&mut self) {
        let news = &mut self.news;
        self.running.retain_mut(|process| {
            let status = end_of(process);
            news.extend(status.map(|status| News::Exited { pid: process.child.id(), status }));
            status.is_none()
        });
    }

    /// Looks and measures when that is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.looks.due(now) {
            self.look(now);
        }
        if !self.usage.due(now) {
            return;
        }
        for process in &mut self.running {
            let pid = process.child.id();
            let Some((ticks, pages)) = usage_of(pid) else {
                continue;
            };
            let seconds = now.since(process.measured).as_secs_f64().max(1e-3);
            let cpu = ticks.saturating_sub(process.ticks) as f64 / self.ticks_per_second / seconds;
            (process.ticks, process.measured) = (ticks, now);
            self.news.push_back(News::Usage { pid, cpu, rss: (pages as f64 * self.page) as i64 });
        }
    }

    /// Whether they beat.
    fn look(&mut self, now: Instant) {
        let held_up = now.since(self.looked + LOOK);
        // A look that is a little late is no excuse for them.
        let held_up = if held_up < LATE { Duration::ZERO } else { held_up };
        self.looked = now;
        for process in &mut self.running {
            let (Some(page), pid) = (&mut process.page, process.child.id()) else { continue };
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
                    process.page = None;
                }
            }
        }
    }

    /// When to look or to measure next.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let looks = self.running.iter().any(|process| process.page.is_some()).then(|| self.looks.next());
        let usage = (!self.running.is_empty()).then(|| self.usage.next());
        looks.into_iter().chain(usage).min()
    }

    /// Takes the oldest news and hands it to `take`; false when there is none.
    pub fn poll_event(&mut self, take: impl FnOnce(ProcessEvent<'_>)) -> bool {
        let Some(news) = self.news.pop_front() else {
            return false;
        };
        take(match &news {
            News::Started { module, pid } => ProcessEvent::Started { module, pid: *pid },
            News::Unstartable { module, reason } => ProcessEvent::Unstartable { module, reason },
            News::Exited { pid, status } => ProcessEvent::Exited { pid: *pid, status: *status },
            News::Usage { pid, cpu, rss } => ProcessEvent::Usage { pid: *pid, cpu: *cpu, rss: *rss },
            News::Beating { pid } => ProcessEvent::Beating { pid: *pid },
            News::Silent { pid, thread, last } => ProcessEvent::Silent { pid: *pid, thread, last: *last },
            News::BadBeats { pid, why } => ProcessEvent::BadBeats { pid: *pid, why },
        });
        true
    }
}

/// How a process ended, if it did. What it left in its group is killed before its number may be given away.
fn end_of(process: &mut Process) -> Option<ExitStatus> {
    let pid = Pid::from_raw(process.child.id() as i32);
    let flags = WaitPidFlag::WEXITED | WaitPidFlag::WNOHANG | WaitPidFlag::WNOWAIT;
    if let Ok(WaitStatus::StillAlive) = waitid(Id::Pid(pid), flags) {
        return None;
    }
    let _ = killpg(pid, Signal::SIGKILL);
    let status = process.child.try_wait().ok().flatten()?;
    Some(match status.signal() {
        Some(signal) => ExitStatus::Signal(signal),
        None => ExitStatus::Code(status.code().unwrap_or_default()),
    })
}

/// Processor time in ticks, and resident pages (proc_pid_stat(5), proc_pid_statm(5)).
fn usage_of(pid: u32) -> Option<(u64, u64)> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name, in parentheses, may hold anything.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let user: u64 = fields.next()?.parse().ok()?;
    let system: u64 = fields.next()?.parse().ok()?;
    let statm = fs::read_to_string(format!("/proc/{pid}/statm")).ok()?;
    let pages = statm.split_whitespace().nth(1)?.parse().ok()?;
    Some((user + system, pages))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::clock;
    use std::path::Path;
    use std::thread::sleep;

    /// Runs `script` by a shell and waits for the start.
    fn start(script: &'static str) -> (Processes, u32) {
        let launch: Launch = Box::new(move |_, _| {
            let mut command = Command::new("/bin/sh");
            command.args(["-c", script]);
            command
        });
        let mut processes = Processes::new(clock::now(), launch, None);
        let spawn = ProcessCommand::Spawn { module: "m".into(), wanted: State::Run };
        processes.command(clock::now(), spawn);
        let mut started = 0;
        assert!(processes.poll_event(|event| match event {
            ProcessEvent::Started { module: "m", pid } => started = pid,
            other => panic!("{other:?}"),
        }));
        (processes, started)
    }

    /// Waits up to 5 s for the end of the one process.
    fn end(processes: &mut Processes) -> ExitStatus {
        for _ in 0..500 {
            processes.on_child_signal();
            let mut status = None;
            processes.poll_event(|event| match event {
                ProcessEvent::Exited { status: how, .. } => status = Some(how),
                other => panic!("{other:?}"),
            });
            if let Some(status) = status {
                return status;
            }
            sleep(std::time::Duration::from_millis(10));
        }
        panic!("it does not end");
    }

    fn gone(pid: u32) -> bool {
        // An orphan may stay a zombie where nobody reaps.
        fs::read_to_string(format!("/proc/{pid}/stat")).map_or(true, |stat| stat.contains(") Z "))
    }

    #[test]
    fn an_exit_code_is_told() {
        let (mut processes, _) = start("exit 32");
        assert_eq!(end(&mut processes), ExitStatus::Code(32));
    }

    #[test]
    fn terminate_ends_the_whole_group() {
        let dir = std::env::temp_dir().join(format!("advee-group-{}", std::process::id()));
        let path = dir.display().to_string();
        // The shell waits for a child of its own; both get the signal.
        let script: &'static str = format!("sleep 100 & echo $! > {path}.new; mv {path}.new {path}; wait").leak();
        let (mut processes, pid) = start(script);
        let child = loop {
            match fs::read_to_string(&dir) {
                Ok(text) => break text.trim().parse().unwrap(),
                Err(_) => sleep(std::time::Duration::from_millis(5)),
            }
        };
        fs::remove_file(&dir).unwrap();
        processes.command(clock::now(), ProcessCommand::Terminate { pid });
        assert_eq!(end(&mut processes), ExitStatus::Signal(15));
        for _ in 0..500 {
            if gone(child) {
                return;
            }
            sleep(std::time::Duration::from_millis(10));
        }
        panic!("{child} is left over");
    }

    #[test]
    fn what_a_process_leaves_in_its_group_is_killed() {
        let dir = std::env::temp_dir().join(format!("advee-orphan-{}", std::process::id()));
        let path = dir.display().to_string();
        let script: &'static str = format!("trap '' TERM; sleep 100 & echo $! > {path}").leak();
        let (mut processes, _) = start(script);
        assert_eq!(end(&mut processes), ExitStatus::Code(0));
        let child = fs::read_to_string(&dir).unwrap().trim().parse().unwrap();
        fs::remove_file(&dir).unwrap();
        for _ in 0..500 {
            if gone(child) {
                return;
            }
            sleep(std::time::Duration::from_millis(10));
        }
        panic!("{child} is left over");
    }

    #[test]
    fn a_strange_pid_is_left_alone() {
        let (mut processes, pid) = start("sleep 100");
        // Ourselves: this test would not live to tell.
        processes.command(clock::now(), ProcessCommand::Kill { pid: std::process::id() });
        processes.command(clock::now(), ProcessCommand::Kill { pid });
        assert_eq!(end(&mut processes), ExitStatus::Signal(9));
    }

    #[test]
    fn what_a_process_uses_is_measured() {
        let (mut processes, pid) = start("while :; do :; done");
        assert!(Path::new(&format!("/proc/{pid}")).exists());
        sleep(std::time::Duration::from_millis(1100));
        processes.handle_timeout(clock::now());
        let mut used = (0.0, 0);
        assert!(processes.poll_event(|event| match event {
            ProcessEvent::Usage { cpu, rss, .. } => used = (cpu, rss),
            other => panic!("{other:?}"),
        }));
        processes.command(clock::now(), ProcessCommand::Kill { pid });
        end(&mut processes);
        assert!(used.0 > 0.05 && used.0 < 1.5 && used.1 > 10_000, "{used:?}");
    }

    #[test]
    fn a_command_that_is_not_there_is_told() {
        let launch: Launch = Box::new(|_, _| Command::new("/nonexistent/module"));
        let mut processes = Processes::new(clock::now(), launch, None);
        let spawn = ProcessCommand::Spawn { module: "m".into(), wanted: State::Run };
        processes.command(clock::now(), spawn);
        let mut told = String::new();
        assert!(processes.poll_event(|event| match event {
            ProcessEvent::Unstartable { reason, .. } => told = reason.into(),
            other => panic!("{other:?}"),
        }));
        assert_eq!(told, "/nonexistent/module: No such file or directory (os error 2)");
    }
}
