//! A folder of log files. Its disk may be slow, full, or gone, and a call to it then takes its time or fails: a thread of
//! its own makes them, one after the other, and a port of this kind is never lost.

pub(crate) mod disk;

use super::worker::{Life, Worker};
use super::{Device, Lost, Received};
use base::Instant;
use base::store::{Answer, Request};
use disk::Disk;
use module::{Input, Output};
use std::os::fd::BorrowedFd;
use std::path::PathBuf;

/// The folder, and the thread that has it.
pub struct Store {
    folder: PathBuf,
    worker: Option<Worker<Request, Answer>>,
    life: Life,
    answer: Option<Answer>,
    /// Called by the thread before each request.
    #[cfg(test)]
    before: fn(&Request),
}

impl Store {
    /// A folder that is made when the first file is.
    pub fn new(folder: PathBuf) -> Self {
        Self {
            folder,
            worker: None,
            life: Life::default(),
            answer: None,
            #[cfg(test)]
            before: |_| (),
        }
    }
}

impl Device for Store {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        if self.life.lasts() {
            return Err("the last write has not come back".into());
        }
        let mut disk = Disk::new(&self.folder);
        #[cfg(test)]
        let before = self.before;
        let work = move |request| {
            #[cfg(test)]
            before(&request);
            Ok(disk.perform(request))
        };
        let worker = Worker::start("store", &mut self.life, work).map_err(|error| format!("its thread: {error}"))?;
        self.worker = Some(worker);
        Ok(())
    }

    fn close(&mut self) {
        self.worker = None;
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.worker.as_ref().map(Worker::fd)
    }

    fn receive(&mut self, _now: Instant) -> Result<Received<'_>, Lost> {
        match self.worker.as_mut().and_then(Worker::take) {
            Some(answer) => Ok(Received::Input(Input::Store(self.answer.insert(answer?)))),
            None => Ok(Received::Nothing),
        }
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(worker), Output::Store(request)) = (&mut self.worker, output) else { return Ok(false) };
        Ok(worker.give(request.clone()))
    }
}

#[cfg(test)]
mod tests;
