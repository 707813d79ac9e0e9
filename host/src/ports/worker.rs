//! Calls that may block, on a thread of their own: jobs go in, a few at most, answers come out in order, and a
//! descriptor says when.
//!
//! The thread does not beat ([beats](../../../../docs/beats.md)): an adapter that does not come back is a fault of a
//! device, which the module tells of; it is no hang of the module, which goes on without.

use super::Lost;
use module::OUTSTANDING;
use nix::sys::eventfd::{EfdFlags, EventFd};
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Weak};
use std::thread;

/// The thread's handle. Without it the thread ends when what it does just now comes back.
pub struct Worker<J, A> {
    jobs: SyncSender<J>,
    done: Receiver<Result<A, Lost>>,
    ready: Arc<EventFd>,
    waiting: usize,
}

/// Knows whether a thread has ended.
#[derive(Default)]
pub struct Life(Weak<()>);

impl Life {
    /// True if it lives, perhaps in a call that does not come back.
    pub fn lasts(&self) -> bool {
        self.0.strong_count() > 0
    }
}

impl<J: Send + 'static, A: Send + 'static> Worker<J, A> {
    /// Starts a thread that does `work` with each job. After an error it does no more.
    pub fn start(
        name: &str,
        life: &mut Life,
        work: impl FnMut(J) -> Result<A, Lost> + Send + 'static,
    ) -> io::Result<Self> {
        let ready = Arc::new(EventFd::from_flags(EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK)?);
        let (jobs, todo) = sync_channel::<J>(OUTSTANDING);
        // One more, so that the thread never waits for whoever takes them.
        let (tell, done) = sync_channel(OUTSTANDING + 1);
        let (tells, token) = (ready.clone(), Arc::new(()));
        *life = Life(Arc::downgrade(&token));
        thread::Builder::new().name(name.into()).spawn(move || {
            // Locals go in reverse order: when the token does, what the work held has gone.
            let _token = token;
            let mut work = work;
            for job in todo {
                let answer = work(job);
                let lost = answer.is_err();
                if tell.send(answer).is_err() || tells.write(1).is_err() || lost {
                    return;
                }
            }
        })?;
        Ok(Self { jobs, done, ready, waiting: 0 })
    }

    /// Readable when an answer is there.
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.ready.as_fd()
    }

    /// Hands over a job; false when too many wait.
    pub fn give(&mut self, job: J) -> bool {
        let room = self.waiting < OUTSTANDING && self.jobs.try_send(job).is_ok();
        self.waiting += usize::from(room);
        room
    }

    /// The next answer.
    pub fn take(&mut self) -> Option<Result<A, Lost>> {
        let answer = self.done.try_recv().ok().or_else(|| {
            // What makes it quiet; another answer that comes just now makes it ready again.
            let _ = self.ready.read();
            self.done.try_recv().ok()
        });
        self.waiting -= usize::from(answer.is_some());
        answer
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
    use std::sync::mpsc::channel;

    fn answer(worker: &mut Worker<u32, u32>) -> Result<u32, Lost> {
        loop {
            if let Some(answer) = worker.take() {
                return answer;
            }
            poll(&mut [PollFd::new(worker.fd(), PollFlags::POLLIN)], PollTimeout::NONE).unwrap();
        }
    }

    #[test]
    fn a_call_that_does_not_come_back_leaves_its_caller_free_and_its_queue_bounded() {
        let (go, gate) = channel::<()>();
        let mut life = Life::default();
        let work = move |job| gate.recv().map(|()| job * 2).map_err(|_| "gone".into());
        let mut worker = Worker::start("test", &mut life, work).unwrap();
        let given = (0..20).filter(|n| worker.give(*n)).count();
        assert_eq!((given, worker.take()), (OUTSTANDING, None));
        go.send(()).unwrap();
        assert_eq!(answer(&mut worker), Ok(0));
        assert!(worker.give(20) && !worker.give(21));
        drop(worker);
        assert!(life.lasts(), "it is still in its call");
        drop(go);
        while life.lasts() {
            thread::yield_now();
        }
    }
}
