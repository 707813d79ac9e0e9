//! `advee up`: the minimal parent. It starts the watchdog and starts it again when it dies; everything else is the
//! watchdog's. Whoever is killed, nothing is left over: each process dies with the one that started it, and what is
//! orphaned on the way comes to this one to be waited for.

use super::bus::wait;
use super::{Common, Failed, Outcome};
use crate::config::{self, Config};
use crate::live::log::Log;
use crate::live::{beats, clock, sys};
use crate::run_folder::RunFolder;
use base::{Duration, Instant};
use nix::errno::Errno;
use nix::sys::signal::{SigSet, Signal, killpg};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;
use std::os::fd::AsFd;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

#[derive(clap::Args)]
pub struct Up {
    /// The simulated robot
    #[arg(long)]
    sim: bool,
    /// The simulated world: a file, or a name in conf/worlds
    #[arg(long, value_name = "FILE", requires = "sim")]
    world: Option<PathBuf>,
    /// Where to go; this version has no planner and knows only `none`
    #[arg(long, value_name = "NAME")]
    goal: Option<String>,
    /// The web diagnostic center; this version has none
    #[arg(long, value_name = "ADDR")]
    http: Option<String>,
    /// No web diagnostic center
    #[arg(long)]
    headless: bool,
}

/// The first delay after an immediate restart of the watchdog; doubles up to `DELAY_MAX`.
const DELAY_FIRST: Duration = Duration::from_millis(100);
const DELAY_MAX: Duration = Duration::from_secs(10);
/// A watchdog that lived this long starts with no delay again.
const LIVED: Duration = Duration::from_secs(10);
/// A watchdog that was asked to end is killed after this time. Its own limit is shorter.
const END: Duration = Duration::from_secs(10);

pub fn up(common: &Common, command: &Up) -> Outcome {
    let log = Log::new("up");
    if let Some(goal) = command.goal.as_deref().filter(|goal| *goal != "none") {
        return Err(format!("--goal {goal}: this version has no planner; use --goal none, or advee drive").into());
    }
    match &command.http {
        Some(address) if !command.headless => {
            return Err(format!("--http {address}: this version has no web server; use --headless").into());
        }
        _ if !command.headless => {
            log.line("there is no web diagnostic center in this version (--headless hides this line)");
        }
        _ => {}
    }
    // Whatever is wrong is said here, once, and nothing starts.
    let config = common.load(command.sim)?;
    if command.sim {
        config::world(&common.config_dir(), command.world.as_deref())?;
    }
    let watchdog = watchdog(common, command)?;
    // Signals are held back before there is anything to leave behind.
    let parent = Parent::new(log)?;
    let folder = RunFolder::take(&common.run_dir())?;
    let result = parent.run(&watchdog);
    let beats = beats::folder(folder.path());
    clean(&folder, &config);
    // Also what one that was killed has left there.
    if let Ok(beats) = beats {
        let _ = std::fs::remove_dir_all(beats);
    }
    folder.give_back();
    result
}

/// Removes what modules leave in the run folder when they are killed.
fn clean(folder: &RunFolder, config: &Config) {
    for bus in config.robot.rs485.iter().filter(|bus| bus.port.is_relative()) {
        let link = folder.path().join(&bus.port);
        for link in [link.with_extension("new"), link] {
            if link.is_symlink() {
                let _ = std::fs::remove_file(link);
            }
        }
    }
}

/// The command line of the watchdog; all modules get the same.
fn watchdog(common: &Common, command: &Up) -> Result<Vec<std::ffi::OsString>, Failed> {
    let absolute =
        |path: &Path| std::path::absolute(path).map_err(|error| Failed::from(format!("{}: {error}", path.display())));
    let mut args: Vec<std::ffi::OsString> = vec!["run".into(), watchdog::NAME.into()];
    args.extend(["--config".into(), absolute(&common.config_dir())?.into()]);
    args.extend(["--run-dir".into(), absolute(&common.run_dir())?.into()]);
    args.extend(["--lcm-url".into(), common.lcm_url().into()]);
    for set in &common.sets {
        args.extend(["--set".into(), set.into()]);
    }
    if command.sim {
        args.push("--sim".into());
    }
    if let Some(world) = &command.world {
        args.extend(["--world".into(), world.into()]);
    }
    Ok(args)
}

/// The parent of the watchdog.
struct Parent {
    log: Log,
    signals: SignalFd,
    state: State,
    delay: Duration,
}

enum State {
    /// To be started at this moment.
    Down { start: Instant },
    /// Alive since.
    Running { pid: Pid, since: Instant },
    /// Asked to end; killed at this moment.
    Ending { pid: Pid, kill: Instant },
    /// Over, and how.
    Over { code: u8 },
}

impl Parent {
    fn new(log: Log) -> Result<Self, Failed> {
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
        Ok(Self { log, signals, state: State::Down { start: Instant::ZERO }, delay: Duration::ZERO })
    }

    fn run(mut self, watchdog: &[std::ffi::OsString]) -> Outcome {
        let exe = std::env::current_exe().map_err(|error| format!("own executable: {error}"))?;
        loop {
            let now = clock::now();
            match self.state {
                State::Down { start } if start <= now => self.start(now, &exe, watchdog),
                State::Ending { pid, kill } if kill <= now => {
                    self.log.line("the watchdog does not end: it is killed");
                    let _ = killpg(pid, Signal::SIGKILL);
                    self.state = State::Ending { pid, kill: Instant::NEVER };
                }
                State::Over { code } => {
                    self.wait_for_orphans()?;
                    return Ok(ExitCode::from(code));
                }
                _ => {}
            }
            let until = match self.state {
                State::Down { start } => start,
                State::Ending { kill, .. } => kill,
                State::Running { .. } => Instant::NEVER,
                State::Over { .. } => continue,
            };
            wait(&[self.signals.as_fd()], until.since(clock::now()))?;
            while let Ok(Some(signal)) = self.signals.read_signal() {
                match signal.ssi_signo == Signal::SIGCHLD as u32 {
                    true => self.reap(),
                    false => self.end(),
                }
            }
        }
    }

    fn start(&mut self, now: Instant, exe: &Path, args: &[std::ffi::OsString]) {
        let mut command = Command::new(exe);
        command.args(args).stdin(Stdio::null()).process_group(0);
        sys::die_with_parent(&mut command);
        match command.spawn() {
            Ok(child) => self.state = State::Running { pid: Pid::from_raw(child.id() as i32), since: now },
            Err(error) => {
                self.log.line(format_args!("the watchdog cannot be started: {}: {error}", exe.display()));
                self.again(now, Duration::ZERO);
            }
        }
    }

    /// Ctrl-C and its like: the watchdog is told, and ends everything in order.
    fn end(&mut self) {
        match self.state {
            State::Running { pid, .. } => {
                let _ = killpg(pid, Signal::SIGTERM);
                self.state = State::Ending { pid, kill: clock::now() + END };
            }
            State::Down { .. } => self.state = State::Over { code: 0 },
            State::Ending { .. } | State::Over { .. } => {}
        }
    }

    fn reap(&mut self) {
        while let Some(ended) = reap_one() {
            let now = clock::now();
            match (&self.state, ended) {
                (State::Running { pid, since }, (gone, how)) if *pid == gone => {
                    let (pid, lived) = (*pid, now.since(*since));
                    let _ = killpg(pid, Signal::SIGKILL);
                    if how == "exit code 0" {
                        self.state = State::Over { code: 0 };
                    } else {
                        self.again(now, lived);
                        self.log.line(format_args!("the watchdog ended with {how}: it is started again"));
                    }
                }
                (State::Ending { pid, .. }, (gone, how)) if *pid == gone => {
                    let _ = killpg(gone, Signal::SIGKILL);
                    self.state = State::Over { code: u8::from(how != "exit code 0") };
                }
                _ => {}
            }
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

    /// Everything below ended or is being killed by the kernel: it takes moments.
    fn wait_for_orphans(&mut self) -> Result<(), Failed> {
        let until = clock::now() + END;
        while clock::now() < until {
            while reap_one().is_some() {}
            if waitpid(Pid::from_raw(-1), Some(WaitPidFlag::WNOHANG)) == Err(Errno::ECHILD) {
                return Ok(());
            }
            wait(&[self.signals.as_fd()], Duration::from_millis(50))?;
            while let Ok(Some(_)) = self.signals.read_signal() {}
        }
        Err("processes of this robot do not end although they were killed; they are left over".into())
    }
}

/// Takes one child, or orphan, that has ended.
fn reap_one() -> Option<(Pid, String)> {
    match waitpid(Pid::from_raw(-1), Some(WaitPidFlag::WNOHANG)) {
        Ok(WaitStatus::Exited(pid, code)) => Some((pid, format!("exit code {code}"))),
        Ok(WaitStatus::Signaled(pid, signal, _)) => Some((pid, signal.as_str().into())),
        _ => None,
    }
}
