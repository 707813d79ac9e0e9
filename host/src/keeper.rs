//! Keepers: a module that runs as another user than the robot's has a keeper, a process of that user, which starts and
//! ends it as the robot's watchdog commands. So no process of the robot needs the capability to change to another user,
//! or to signal its processes, and the service manager decides what the module may open, by the permissions of the
//! keeper.
//!
//! `ADVEE_KEEPERS` in the robot's unit names them ([`crate::keepers`]). The folder of a keeper belongs to the module's
//! user, and has the socket `keeper` (SOCK_SEQPACKET).
//!
//! A datagram is a list of fields separated by NUL:
//!
//! | watchdog | keeper |
//! |---|---|
//! | `start`, mark, heartbeat page or nothing, arguments of `advee run MODULE` | `running` or `failed` |
//! | `state` | `running` or `idle` |
//! | `signal`, its number | nothing |
//! | | `running`, process id, its start, mark |
//! | | `failed`, reason |
//! | | `used`, processor ticks, resident pages: each second |
//! | | `ended`, status as in wait(2) |
//!
//! The process survives the watchdog, like all modules; the next one asks for `state`.

use crate::keepers::Place;
use crate::processes::kept::{Answer, COMMAND_MAX, receive, wait};
use crate::processes::{self, Stat};
use crate::{beats, clock, sys};
use base::Duration;
use nix::sys::signal::{Signal, killpg};
use nix::sys::socket::{
    AddressFamily, Backlog, MsgFlags, SockFlag, SockType, UnixAddr, bind, getsockopt, listen, send, socket, sockopt,
};
use nix::sys::wait::{Id, WaitPidFlag, WaitStatus, waitid};
use nix::unistd::Pid;
use std::fs::{self, DirBuilder, Permissions};
use std::io;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::os::unix::net::UnixListener;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Period of reports of what the module uses.
const USED_PERIOD: Duration = Duration::from_secs(1);

/// A process of the keeper's module.
struct Running {
    child: Child,
    /// Readable once it has ended.
    end: OwnedFd,
    start: u64,
    mark: String,
}

/// Keeps `module` in `folder` for the watchdog of the user `robot`, until it is ended; the module ends with it.
///
/// # Errors
/// The folder or the machine refuses something, in one line.
pub fn keep(folder: &Path, module: &str, robot: u32) -> Result<(), String> {
    let named = |error: io::Error| format!("{}: {error}", folder.display());
    let place = Place { module: module.into(), folder: folder.into() };
    let state = folder.join(module);
    match DirBuilder::new().mode(0o700).create(&state) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(named(error)),
        _ => {}
    }
    let listener = listener(&place.socket()).map_err(named)?;
    Keeper { module, robot, listener, watchdog: None, running: None }.run().map_err(named)
}

/// The standard library's type is for streams; for accepting connections that makes no difference.
fn listener(path: &Path) -> io::Result<UnixListener> {
    let listener = socket(AddressFamily::Unix, SockType::SeqPacket, SockFlag::SOCK_CLOEXEC, None)?;
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    bind(listener.as_raw_fd(), &UnixAddr::new(path)?)?;
    // For the robot's group; the user who connects is checked.
    fs::set_permissions(path, Permissions::from_mode(0o660))?;
    listen(&listener, Backlog::new(4)?)?;
    let listener = UnixListener::from(listener);
    listener.set_nonblocking(true)?;
    Ok(listener)
}

struct Keeper<'a> {
    module: &'a str,
    robot: u32,
    listener: UnixListener,
    /// The connection of the latest watchdog.
    watchdog: Option<OwnedFd>,
    running: Option<Running>,
}

impl Keeper<'_> {
    fn run(mut self) -> io::Result<()> {
        let mut used = clock::now() + USED_PERIOD;
        loop {
            let mut fds = vec![self.listener.as_fd()];
            fds.extend(self.watchdog.as_ref().map(AsFd::as_fd));
            fds.extend(self.running.as_ref().map(|running| running.end.as_fd()));
            let limit = if self.running.is_some() { used.since(clock::now()) } else { Duration::MAX };
            wait(&fds, limit)?;
            // The end of a process is reported before anything else begins.
            self.reap()?;
            self.accept()?;
            self.obey();
            if used <= clock::now() {
                used = clock::now() + USED_PERIOD;
                if let Some(Stat { ticks, pages, .. }) = self.running.as_ref().and_then(|it| Stat::of(it.child.id())) {
                    self.tell(&Answer::Used { ticks, pages });
                }
            }
        }
    }

    fn accept(&mut self) -> io::Result<()> {
        let connection = match self.listener.accept() {
            Ok((connection, _)) => connection,
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
            Err(error) => return Err(error),
        };
        if getsockopt(&connection, sockopt::PeerCredentials)?.uid() == self.robot {
            self.watchdog = Some(connection.into());
        }
        Ok(())
    }

    fn obey(&mut self) {
        loop {
            let Some(watchdog) = &self.watchdog else { return };
            let datagram = match receive(watchdog, COMMAND_MAX) {
                Ok(Some(datagram)) => datagram,
                Ok(None) => return,
                Err(_) => {
                    self.watchdog = None;
                    return;
                }
            };
            let fields: Vec<&[u8]> = datagram.split(|byte| *byte == 0).collect();
            match fields[..] {
                [b"state"] => self.tell(&self.state()),
                [b"start", mark, page, ref args @ ..] => {
                    let answer = match self.start(mark, page, args) {
                        Ok(()) => self.state(),
                        Err(error) => Answer::Failed(error.to_string()),
                    };
                    self.tell(&answer);
                }
                [b"signal", number] => {
                    let number = std::str::from_utf8(number).ok().and_then(|number| number.parse::<i32>().ok());
                    if let (Some(running), Some(Ok(signal))) = (&self.running, number.map(Signal::try_from)) {
                        // Its process id stays its own until it is reaped here.
                        let _ = killpg(Pid::from_raw(running.child.id() as i32), signal);
                    }
                }
                _ => {}
            }
        }
    }

    fn state(&self) -> Answer {
        match &self.running {
            Some(Running { child, start, mark, .. }) => {
                Answer::Running { pid: child.id(), start: *start, mark: mark.clone() }
            }
            None => Answer::Idle,
        }
    }

    fn start(&mut self, mark: &[u8], page: &[u8], args: &[&[u8]]) -> io::Result<()> {
        if self.running.is_some() {
            return Err(io::Error::new(io::ErrorKind::AlreadyExists, "its keeper has a process of it already"));
        }
        let text = std::ffi::OsStr::from_bytes;
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["run", self.module]).args(args.iter().map(|arg| text(arg)));
        command.stdin(Stdio::null()).process_group(0).env(processes::VARIABLE, text(mark)).env_remove(beats::VARIABLE);
        if !page.is_empty() {
            command.env(beats::VARIABLE, text(page));
        }
        sys::die_with_parent(&mut command);
        let child = command.spawn()?;
        let end = sys::pidfd_open(child.id())?;
        let start = Stat::of(child.id()).map_or(0, |stat| stat.start);
        let mark = String::from_utf8_lossy(mark).into_owned();
        self.running = Some(Running { child, end, start, mark });
        Ok(())
    }

    /// Reaps the process that has ended, and ends all that it left in its group.
    fn reap(&mut self) -> io::Result<()> {
        let Some(running) = &mut self.running else { return Ok(()) };
        let pid = Pid::from_raw(running.child.id() as i32);
        let flags = WaitPidFlag::WEXITED | WaitPidFlag::WNOHANG | WaitPidFlag::WNOWAIT;
        if let Ok(WaitStatus::StillAlive) = waitid(Id::Pid(pid), flags) {
            return Ok(());
        }
        let _ = killpg(pid, Signal::SIGKILL);
        let status = running.child.wait()?.into_raw();
        self.running = None;
        self.tell(&Answer::Ended(status));
        Ok(())
    }

    fn tell(&self, answer: &Answer) {
        if let Some(watchdog) = &self.watchdog {
            // A watchdog that does not read is replaced, and the new one asks again.
            let _ = send(watchdog.as_raw_fd(), &answer.encode(), MsgFlags::MSG_NOSIGNAL | MsgFlags::MSG_DONTWAIT);
        }
    }
}
