//! Processes that are being started. A start waits for the kernel: to read the program from a disk, and to move to a
//! cgroup, which takes a grace period of the whole machine (10 to 30 ms, more under load). The watchdog's loop must not
//! wait with it, so each start has its own short-lived thread.

use super::PendingStart;
use crate::limits::Refused;
use nix::sys::eventfd::{EfdFlags, EventFd};
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::process::{Child, Command};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

/// Stack of a thread that only starts a process, bytes.
const STACK: usize = 64 << 10;

/// Starts in progress.
pub struct Starts {
    /// Counts completed starts.
    done: Arc<EventFd>,
    send: Sender<(PendingStart, StartResult)>,
    receive: Receiver<(PendingStart, StartResult)>,
}

/// Result of a start.
pub struct StartResult {
    /// Process id, and the child if it is ours; or one line with the reason why there is no process.
    pub process: Result<(u32, Option<Child>), String>,
    /// Warnings about the limits that the machine refused.
    pub refused: Vec<String>,
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
        let (done, send) = (Arc::clone(&self.done), self.send.clone());
        let work = move || {
            // The receiver exists as long as this process.
            let _ = send.send((pending, start(command, refused)));
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
    let process = match other {
        Some(pid) => {
            // The intermediate process, which has ended.
            let _ = child.wait();
            (pid, None)
        }
        None => (child.id(), Some(child)),
    };
    StartResult { process: Ok(process), refused }
}
