//! Processes that are being started. A start waits for the kernel: for the program to be read from a disk, for the move
//! to a cgroup, which takes a grace period of the whole machine (10 to 30 ms, more when others start much). Whoever
//! guards must not wait with it, so each start has a thread of its own for as long as it lasts.

use super::Unborn;
use crate::limits::Refused;
use nix::sys::eventfd::{EfdFlags, EventFd};
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::process::{Child, Command};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

/// Of a thread that only starts a process.
const STACK: usize = 64 << 10;

/// Those that are on the way.
pub struct Births {
    /// Counts those that are done.
    done: Arc<EventFd>,
    send: Sender<(Unborn, Born)>,
    receive: Receiver<(Unborn, Born)>,
}

/// What came of one.
pub struct Born {
    /// Number, and itself where it is a child of ours; or one line why there is none.
    pub process: Result<(u32, Option<Child>), String>,
    /// Lines on the limits that it runs without.
    pub refused: Vec<String>,
}

impl Births {
    /// None on the way.
    ///
    /// # Errors
    /// There is no descriptor left.
    pub fn new() -> io::Result<Self> {
        let (send, receive) = channel();
        let done = EventFd::from_flags(EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK)?;
        Ok(Self { done: Arc::new(done), send, receive })
    }

    /// Starts a process. What `unborn` says is handed back with it.
    ///
    /// # Errors
    /// There is no thread for it.
    pub fn begin(&self, command: Command, refused: Refused, unborn: Unborn) -> io::Result<()> {
        let (done, send) = (Arc::clone(&self.done), self.send.clone());
        let work = move || {
            // The other side goes only with the whole process.
            let _ = send.send((unborn, start(command, refused)));
            let _ = done.write(1);
        };
        thread::Builder::new().name("birth".into()).stack_size(STACK).spawn(work)?;
        Ok(())
    }

    /// Takes one that is done.
    pub fn poll(&mut self) -> Option<(Unborn, Born)> {
        // First: one that comes from now on is told anew.
        let _ = self.done.read();
        self.receive.try_recv().ok()
    }
}

/// Readable when one may be done.
impl AsFd for Births {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.done.as_fd()
    }
}

fn start(mut command: Command, refused: Refused) -> Born {
    let mut child = match command.spawn() {
        Ok(child) => child,
        Err(error) => {
            let reason = format!("{}: {error}", command.get_program().display());
            return Born { process: Err(reason), refused: Vec::new() };
        }
    };
    let (refused, other) = refused.read();
    let process = match other {
        Some(pid) => {
            // Only the one between, which has ended.
            let _ = child.wait();
            (pid, None)
        }
        None => (child.id(), Some(child)),
    };
    Born { process: Ok(process), refused }
}
