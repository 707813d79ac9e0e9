//! Processes that are being started. A start waits for the kernel: to read the program from a disk, and to move to a
//! cgroup, which takes a grace period of the whole machine (10 to 30 ms, more under load). The watchdog's loop must not
//! wait with it, so each start has its own short-lived thread.

use super::PendingStart;
use super::kept::{Answer, Kept};
use crate::keepers::Place;
use crate::limits::Refused;
use nix::sys::eventfd::{EfdFlags, EventFd};
use std::ffi::OsString;
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;
use std::process::{Child, Command};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

/// Stack of a thread that only starts a process, bytes: twice the longest datagram to a keeper.
const STACK: usize = 128 << 10;

/// Starts in progress.
pub struct Starts {
    /// Counts completed starts.
    done: Arc<EventFd>,
    send: Sender<(PendingStart, StartResult)>,
    receive: Receiver<(PendingStart, StartResult)>,
}

/// Result of a start.
pub struct StartResult {
    /// The process, or one line with the reason why there is none.
    pub process: Result<Born, String>,
    /// Warnings about the limits that the machine refused.
    pub refused: Vec<String>,
}

/// A new process.
pub struct Born {
    /// Process id.
    pub pid: u32,
    /// Its start time, if its keeper reports it.
    pub start: Option<u64>,
    /// The child, if it is ours.
    pub child: Option<Child>,
    /// The keeper whose child it is.
    pub kept: Option<Kept>,
}

/// Start of a module by its keeper.
pub struct Order {
    /// The keeper.
    pub place: Place,
    /// Mark of the process.
    pub mark: String,
    /// Its heartbeat page.
    pub page: Option<PathBuf>,
    /// Arguments of `advee run MODULE`.
    pub args: Vec<OsString>,
}

impl Starts {
    /// Creates an empty set.
    ///
    /// # Errors
    /// No descriptor is left.
    pub fn new() -> io::Result<Self> {
        let (send, receive) = channel();
        let done = EventFd::from_flags(EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK)?;
        Ok(Self { done: Arc::new(done), send, receive })
    }

    /// Starts a process; `pending` is returned together with the result.
    ///
    /// # Errors
    /// No thread can be created.
    pub fn begin(&self, command: Command, refused: Refused, pending: PendingStart) -> io::Result<()> {
        self.run(pending, move || start(command, refused))
    }

    /// Has a process started by its keeper.
    ///
    /// # Errors
    /// No thread can be created.
    pub fn begin_kept(&self, order: Order, pending: PendingStart) -> io::Result<()> {
        self.run(pending, move || StartResult { process: kept(&order), refused: Vec::new() })
    }

    fn run(&self, pending: PendingStart, start: impl FnOnce() -> StartResult + Send + 'static) -> io::Result<()> {
        let (done, send) = (Arc::clone(&self.done), self.send.clone());
        let work = move || {
            // The receiver exists as long as this process.
            let _ = send.send((pending, start()));
            let _ = done.write(1);
        };
        thread::Builder::new().name("birth".into()).stack_size(STACK).spawn(work)?;
        Ok(())
    }

    /// Removes and returns a completed start.
    pub fn poll(&mut self) -> Option<(PendingStart, StartResult)> {
        // Reset first: a start that completes from now on sets it again.
        let _ = self.done.read();
        self.receive.try_recv().ok()
    }
}

/// Readable if a start may be complete.
impl AsFd for Starts {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.done.as_fd()
    }
}

fn start(mut command: Command, refused: Refused) -> StartResult {
    let mut child = match command.spawn() {
        Ok(child) => child,
        Err(error) => {
            let reason = format!("{}: {error}", command.get_program().display());
            return StartResult { process: Err(reason), refused: Vec::new() };
        }
    };
    let (refused, other) = refused.read();
    let (pid, child) = match other {
        Some(pid) => {
            // The intermediate process, which has ended.
            let _ = child.wait();
            (pid, None)
        }
        None => (child.id(), Some(child)),
    };
    StartResult { process: Ok(Born { pid, start: None, child, kept: None }), refused }
}

fn kept(Order { place, mark, page, args }: &Order) -> Result<Born, String> {
    let args: Vec<&[u8]> = args.iter().map(|arg| arg.as_bytes()).collect();
    let reason = |error: io::Error| format!("its keeper in {}: {error}", place.folder.display());
    match Kept::start(place, mark, page.as_deref(), &args).map_err(reason)? {
        (kept, Answer::Running { pid, start, .. }) => {
            Ok(Born { pid, start: Some(start), child: None, kept: Some(kept) })
        }
        (_, Answer::Failed(why)) => Err(reason(io::Error::other(why))),
        (_, other) => Err(reason(io::Error::other(format!("{other:?}")))),
    }
}
