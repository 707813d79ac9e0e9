//! Calls that may block, on a separate thread: a few jobs are queued, answers come out in order, and a descriptor
//! becomes readable for them.
//!
//! The thread has no heartbeat ([beats](../../../../docs/beats.md)): an adapter that does not respond is a fault of a
//! device, which the module reports, and not a hang of the module, which continues without it.

use super::Lost;
use module::OUTSTANDING;
use nix::sys::eventfd::{EfdFlags, EventFd};
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Weak};
use std::thread;

/// Handle of the thread. After it was dropped, the thread ends when its current call returns.
pub struct Worker<J, A> {
    jobs: SyncSender<J>,
    done: Receiver<Result<A, Lost>>,
    ready: Arc<EventFd>,
    waiting: usize,
}

/// Shows whether a thread has ended.
#[derive(Default)]
pub struct Life(Weak<()>);

impl Life {
    /// True if it is alive, possibly in a call that does not return.
    pub fn is_alive(&self) -> bool {
        self.0.strong_count() > 0
    }
}

impl<J: Send + 'static, A: Send + 'static> Worker<J, A> {
    /// Starts a thread that passes each job to `work`. An error ends it.
    pub fn start(
        name: &str,
        life: &mut Life,
        work: impl FnMut(J) -> Result<A, Lost> + Send + 'static,
    ) -> io::Result<Self> {
        let ready = Arc::new(EventFd::from_flags(EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK)?);
        let (jobs, todo) = sync_channel::<J>(OUTSTANDING);
        // One more than can be outstanding, so that the thread never waits for the receiver.
        let (tell, done) = sync_channel(OUTSTANDING + 1);
        let (tells, token) = (ready.clone(), Arc::new(()));
        *life = Life(Arc::downgrade(&token));
        thread::Builder::new().name(name.into()).spawn(move || {
            // Locals are dropped in reverse order: once the token is dropped, everything that `work` held is gone.
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

    /// Descriptor that is readable if an answer is available.
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.ready.as_fd()
    }

    /// Queues a job; false if too many are outstanding.
    pub fn queue(&mut self, job: J) -> bool {
        let room = self.waiting < OUTSTANDING && self.jobs.try_send(job).is_ok();
        self.waiting += usize::from(room);
        room
    }

    /// Removes and returns the next answer.
    pub fn take(&mut self) -> Option<Result<A, Lost>> {
        let answer = self.done.try_recv().ok().or_else(|| {
            // Clears the readiness; an answer that arrives from now on sets it again.
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
    fn a_blocked_call_does_not_block_the_caller_and_its_queue_is_bounded() {
        let (go, gate) = channel::<()>();
        let mut life = Life::default();
        let work = move |job| gate.recv().map(|()| job * 2).map_err(|_| "gone".into());
        let mut worker = Worker::start("test", &mut life, work).unwrap();
        let given = (0..20).filter(|n| worker.queue(*n)).count();
        assert_eq!((given, worker.take()), (OUTSTANDING, None));
        go.send(()).unwrap();
        assert_eq!(answer(&mut worker), Ok(0));
        assert!(worker.queue(20) && !worker.queue(21));
        drop(worker);
        assert!(life.is_alive(), "it is still in its call");
        drop(go);
        while life.is_alive() {
            thread::yield_now();
        }
    }
}
