//! A port of requests and answers whose calls may block: a separate thread executes them in order.

use super::worker::{Life, Worker};
use super::{Device, Lost, Received};
use base::Instant;
use module::{Input, Output};
use std::os::fd::BorrowedFd;

/// Executor of the requests of a [`Threaded`] port.
pub trait Service {
    /// A request of the module.
    type Request: Clone + Send + 'static;
    /// Its answer.
    type Answer: Send + 'static;
    /// Name of the thread.
    const THREAD: &'static str;
    /// Reason why the port cannot be reopened while a call of the previous thread lasts.
    const BUSY: &'static str;
    /// Creates the thread's function when the port is opened. An error of that means that the port is lost.
    fn work(&self) -> impl FnMut(Self::Request) -> Result<Self::Answer, Lost> + Send + 'static;
    /// The request of an output; `None` if it is not for this port.
    fn request(output: &Output) -> Option<&Self::Request>;
    /// Converts an answer to an input.
    fn input(answer: &Self::Answer) -> Input<'_>;
}

/// A service and its thread.
pub struct Threaded<S: Service> {
    pub(super) service: S,
    worker: Option<Worker<S::Request, S::Answer>>,
    pub(super) life: Life,
    answer: Option<S::Answer>,
}

impl<S: Service> Threaded<S> {
    /// Creates a port that is closed.
    pub fn new(service: S) -> Self {
        Self { service, worker: None, life: Life::default(), answer: None }
    }
}

impl<S: Service> Device for Threaded<S> {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        if self.life.is_alive() {
            return Err(S::BUSY.into());
        }
        let worker = Worker::start(S::THREAD, &mut self.life, self.service.work());
        self.worker = Some(worker.map_err(|error| format!("its thread: {error}"))?);
        Ok(())
    }

    fn close(&mut self) {
        self.worker = None;
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.worker.as_ref().map(Worker::fd)
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        match self.worker.as_mut().and_then(Worker::take) {
            Some(answer) => Ok(Received::input(now, S::input(self.answer.insert(answer?)))),
            None => Ok(Received::Nothing),
        }
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(worker), Some(request)) = (&mut self.worker, S::request(output)) else { return Ok(false) };
        Ok(worker.queue(request.clone()))
    }
}
