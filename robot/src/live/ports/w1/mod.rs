//! 1-Wire thermometers: those that the kernel's `w1_therm` has under `/sys/bus/w1/devices`, and the simulator's end, which
//! offers a folder that looks the same.

mod folder;
pub mod read;

pub use folder::Folder;

use super::worker::{Life, Worker};
use super::{Device, Lost, Received};
use base::Instant;
use base::w1::{Answer, Request};
use module::{Input, Output};
use std::os::fd::BorrowedFd;
use std::path::PathBuf;

/// The kernel's thermometers. Each measurement takes most of a second, so a thread of its own reads them.
pub struct W1 {
    folder: PathBuf,
    worker: Option<Worker<Request, Answer>>,
    life: Life,
    answer: Option<Answer>,
}

impl W1 {
    /// Those in this folder. That there is none is an answer, no error: a bus may come with its adapter.
    pub fn new(folder: PathBuf) -> Self {
        Self { folder, worker: None, life: Life::default(), answer: None }
    }
}

impl Device for W1 {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        if self.life.lasts() {
            return Err("its last measurement has not come back".into());
        }
        let folder = self.folder.clone();
        let work = move |request| Ok(read::answer(&folder, request));
        self.worker = Some(Worker::start("w1", &mut self.life, work).map_err(|error| format!("its thread: {error}"))?);
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
            Some(answer) => Ok(Received::Input(Input::OneWire(self.answer.insert(answer?)))),
            None => Ok(Received::Nothing),
        }
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(worker), Output::OneWire(request)) = (&mut self.worker, output) else { return Ok(false) };
        Ok(worker.give(*request))
    }
}

#[cfg(test)]
mod tests;
