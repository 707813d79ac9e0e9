//! The parent of the watchdog: starts it, again when it dies or hangs. Whoever is killed, nothing is left over: the
//! watchdog dies with this process, the modules end by themselves when no new watchdog comes, and what is orphaned on
//! the way comes to this process to be waited for.

use super::guards::Guards;
use crate::bus::wait;
use crate::{Failed, Outcome};
use base::{Duration, Instant};
use host::log::Log;
use host::notify::{self, FromWatchdog};
use host::{clock, processes, sys};
use nix::errno::Errno;
use nix::sys::signal::{SigSet, Signal, kill, killpg};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;
use robot::recording;
use std::ffi::OsString;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

/// The first delay after an immediate restart of the watchdog; doubles up to `DELAY_MAX`.
const DELAY_FIRST: Duration = Duration::from_millis(100);
const DELAY_MAX: Duration = Duration::from_secs(10);
/// A watchdog that lived this long starts with no delay again.
const LIVED: Duration = Duration::from_secs(10);
/// A watchdog that was asked to end is killed after this time. Its own limit is shorter.
const END: Duration = Duration::from_secs(10);
/// A watchdog that was started must tell its first pulse within this time.
const BEGIN: Duration = Duration::from_secs(5);
/// One that has told none for this long hangs. Meanwhile the robot has stopped: nobody drives without a watchdog.
const SILENT: Duration = Duration::from_millis(500);
/// An orphan that ended is waited for after this time: until then the new watchdog sees how it ended.
const SHOWN: Duration = Duration::from_secs(1);
/// Orphans end by themselves when they hear of no watchdog for 3 s, and have this long altogether.
const ORPHANS: Duration = Duration::from_secs(5);

/// The parent of the watchdog.
pub struct Parent {
    log: Log,
    guards: Guards,
    signals: SignalFd,
    state: State,
    delay: Duration,
    /// A watchdog has given a pulse. One that ends before with an exit code cannot run here, and is not started again.
    ran: bool,
    /// Time when to wait for orphans that have ended.
    sweep: Instant,
    /// The folder of the run's logs, if it has any.
    run: Option<PathBuf>,
    /// A command of ours that is run once, beside the watchdog.
    errand: Errand,
    /// What is done once, as soon as all critical modules are healthy.
    greeting: Option<Box<dyn FnOnce()>>,
}

enum Errand {
    None,
    Wanted(Vec<OsString>),
    Running(Pid),
}

enum State {
    /// To be started at this moment.
    Down { start: Instant },
    /// Alive since; hangs when it is not heard until then.
    Running { pid: Pid, since: Instant, heard: FromWatchdog, until: Instant },
    /// Asked to end; killed at this moment.
    Ending { pid: Pid, kill: Instant },
    /// Over, and how.
    Over { code: u8 },
}

impl Parent {
    /// Signals are held back from now on.
    pub fn new(log: Log, guards: Guards) -> Result<Self, Failed> {
        let refused = |what: &str| {
            let what = what.to_string();
            move |errno: Errno| Failed::from(format!("{what}: {}", errno.desc()))
        };
        nix::sys::prctl::set_child_subreaper(true).map_err(refused("prctl"))?;
        let mut set = SigSet::empty();
        for signal in [Signal::SIGTERM, Signal::SIGINT, Signal::SIGHUP, Signal::SIGCHLD] {
            set.add(signal);
        }
        set.thread_block().map_err(refused("sigprocmask"))?;
        let signals = SignalFd::with_flags(&set, SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC);
        let signals = signals.map_err(refused("signalfd"))?;
        let state = State::Down { start: Instant::ZERO };
        Ok(Self {
            log,
            guards,
            signals,
            state,
            delay: Duration::ZERO,
            ran: false,
            sweep: Instant::NEVER,
            run: None,
            errand: Errand::None,
            greeting: None,
        })
    }

    /// Tells all processes where the run's logs are.
    pub fn log_to(&mut self, run: Option<PathBuf>) {
        self.run = run;
    }

    /// Runs a command of ours once, when the watchdog has started; how it fares is its own affair.
    pub fn run_errand(&mut self, args: Option<Vec<OsString>>) {
        self.errand = args.map_or(Errand::None, Errand::Wanted);
    }

    /// Does something once, as soon as the robot is up.
    pub fn when_up(&mut self, greeting: impl FnOnce() + 'static) {
        self.greeting = Some(Box::new(greeting));
    }

    /// Until the watchdog has ended in good order; `watchdog` are its arguments.
    pub fn run(mut self, watchdog: &[OsString]) -> Outcome {
        let exe = std::env::current_exe().map_err(|error| format!("own executable: {error}"))?;
        loop {
            let now = clock::now();
            self.listen(now);
            match self.state {
                State::Down { start } if start <= now => self.start(now, &exe, watchdog),
                State::Running { pid, until, .. } if until <= now => self.end_hung(now, pid, until),
                State::Ending { pid, kill } if kill <= now => {
                    self.log.line("the watchdog does not end: it is killed");
                    let _ = killpg(pid, Signal::SIGKILL);
                    self.state = State::Ending { pid, kill: Instant::NEVER };
                }
                State::Over { code } => {
                    self.wait_for_orphans()?;
                    // Whatever went before: all has ended, and nothing moves.
                    self.guards.disarm();
                    return Ok(ExitCode::from(code));
                }
                _ => {}
            }
            if self.sweep <= now {
                self.sweep = Instant::NEVER;
                while let Some(ended) = wait_for(Pid::from_raw(-1)) {
                    self.on_end(ended);
                }
            }
            let until = match self.state {
                State::Down { start } => start,
                State::Ending { kill, .. } => kill,
                State::Running { until, .. } => until,
                State::Over { .. } => continue,
            };
            let mut sources = vec![self.signals.as_fd()];
            if let State::Running { heard, .. } = &self.state {
                sources.push(heard.as_fd());
            }
            wait(&sources, until.min(self.sweep).since(clock::now()))?;
            while let Ok(Some(signal)) = self.signals.read_signal() {
                match signal.ssi_signo == Signal::SIGCHLD as u32 {
                    true => self.reap(),
                    false => self.end(),
                }
            }
        }
    }

    /// The watchdog's pulse, passed on to those that guard us.
    fn listen(&mut self, now: Instant) {
        if let State::Running { heard, until, .. } = &mut self.state {
            while let Some(pulse) = heard.poll() {
                *until = now + SILENT;
                self.ran = true;
                self.guards.pulse(now, &pulse);
                if pulse.healthy
                    && let Some(greeting) = self.greeting.take()
                {
                    greeting();
                }
            }
        }
    }

    fn start(&mut self, now: Instant, exe: &Path, args: &[OsString]) {
        if let Errand::Wanted(args) = &self.errand {
            let mut command = Command::new(exe);
            command.args(args).stdin(Stdio::null()).process_group(0);
            sys::die_with_parent(&mut command);
            self.errand = match command.spawn() {
                Ok(child) => Errand::Running(Pid::from_raw(child.id() as i32)),
                Err(error) => {
                    self.log.line(format_args!("{}: {error}", exe.display()));
                    Errand::None
                }
            };
        }
        match self.give_birth(exe, args) {
            Ok((pid, heard)) => self.state = State::Running { pid, since: now, heard, until: now + BEGIN },
            Err(error) => {
                self.log.line(format_args!("the watchdog cannot be started: {}: {error}", exe.display()));
                self.again(now, Duration::ZERO);
            }
        }
    }

    fn give_birth(&self, exe: &Path, args: &[OsString]) -> std::io::Result<(Pid, FromWatchdog)> {
        let (heard, told) = FromWatchdog::pair()?;
        let mut command = Command::new(exe);
        command.args(args).stdin(OwnedFd::from(told)).process_group(0).env(notify::VARIABLE, "stdin");
        // Whom others mean by these is us.
        for variable in ["NOTIFY_SOCKET", "WATCHDOG_PID", "WATCHDOG_USEC", processes::VARIABLE, recording::VARIABLE] {
            command.env_remove(variable);
        }
        command.envs(self.run.iter().map(|run| (recording::VARIABLE, run)));
        sys::die_with_parent(&mut command);
        Ok((Pid::from_raw(command.spawn()?.id() as i32), heard))
    }

    /// It does not go round: a new one takes over. Who was held up himself does not blame it.
    fn end_hung(&mut self, now: Instant, hung: Pid, due: Instant) {
        if let State::Running { until, .. } = &mut self.state
            && now.since(due) >= SILENT
        {
            *until = now + SILENT;
            return;
        }
        self.log.line(format_args!("the watchdog, process {hung}, hangs: it is killed"));
        let _ = killpg(hung, Signal::SIGKILL);
        if let State::Running { until, .. } = &mut self.state {
            *until = Instant::NEVER;
        }
    }

    /// Ctrl-C and its like: the watchdog is told, and ends everything in order.
    fn end(&mut self) {
        if let Errand::Running(pid) = self.errand {
            let _ = kill(pid, Signal::SIGTERM);
        }
        match self.state {
            State::Running { pid, .. } => {
                self.guards.stopping();
                let _ = killpg(pid, Signal::SIGTERM);
                self.state = State::Ending { pid, kill: clock::now() + END };
            }
            State::Down { .. } => self.state = State::Over { code: 0 },
            State::Ending { .. } | State::Over { .. } => {}
        }
    }

    /// Somebody has ended: the watchdog, or an orphan, which is waited for a little later.
    fn reap(&mut self) {
        if let State::Running { pid, .. } | State::Ending { pid, .. } = self.state
            && let Some(ended) = wait_for(pid)
        {
            self.on_end(ended);
        }
        self.sweep = clock::now() + SHOWN;
    }

    fn on_end(&mut self, (gone, how): (Pid, String)) {
        let now = clock::now();
        // Its last pulse may still be unread.
        self.listen(now);
        if matches!(self.errand, Errand::Running(pid) if pid == gone) {
            self.errand = Errand::None;
        }
        match &self.state {
            State::Running { pid, since, .. } if *pid == gone => {
                let lived = now.since(*since);
                let _ = killpg(gone, Signal::SIGKILL);
                if how == "exit code 0" {
                    self.state = State::Over { code: 0 };
                } else if !self.ran && how.starts_with("exit code") {
                    self.log.line(format_args!("the watchdog cannot run: it ended with {how}"));
                    self.state = State::Over { code: 1 };
                } else {
                    self.again(now, lived);
                    self.log.line(format_args!("the watchdog ended with {how}: it is started again"));
                }
            }
            State::Ending { pid, .. } if *pid == gone => {
                let _ = killpg(gone, Signal::SIGKILL);
                self.state = State::Over { code: u8::from(how != "exit code 0") };
            }
            _ => {}
        }
    }

    /// The watchdog is to be started again, after a delay that grows while it does not live.
    fn again(&mut self, now: Instant, lived: Duration) {
        if lived >= LIVED {
            self.delay = Duration::ZERO;
        }
        self.state = State::Down { start: now + self.delay };
        self.delay = (self.delay * 2).clamp(DELAY_FIRST, DELAY_MAX);
    }

    /// Whoever is left ends by itself, having no watchdog any more, or is killed.
    fn wait_for_orphans(&mut self) -> Result<(), Failed> {
        let begin = clock::now();
        while clock::now() < begin + ORPHANS + END {
            while wait_for(Pid::from_raw(-1)).is_some() {}
            if waitpid(Pid::from_raw(-1), Some(WaitPidFlag::WNOHANG)) == Err(Errno::ECHILD) {
                return Ok(());
            }
            if clock::now() >= begin + ORPHANS {
                for pid in processes::children(std::process::id()) {
                    let _ = kill(Pid::from_raw(pid as i32), Signal::SIGKILL);
                }
            }
            wait(&[self.signals.as_fd()], Duration::from_millis(50))?;
            while let Ok(Some(_)) = self.signals.read_signal() {}
        }
        Err("processes of this robot do not end although they were killed; they are left over".into())
    }
}

/// Takes one child, or orphan, that has ended.
fn wait_for(pid: Pid) -> Option<(Pid, String)> {
    match waitpid(pid, Some(WaitPidFlag::WNOHANG)) {
        Ok(WaitStatus::Exited(pid, code)) => Some((pid, format!("exit code {code}"))),
        Ok(WaitStatus::Signaled(pid, signal, _)) => Some((pid, signal.as_str().into())),
        _ => None,
    }
}
