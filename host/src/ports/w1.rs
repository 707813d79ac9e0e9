//! 1-Wire thermometers: those of the kernel's `w1_therm` under `/sys/bus/w1/devices`, and the simulator's end, a folder
//! of the same layout.

mod folder;
pub mod read;

pub use folder::Folder;

use super::Lost;
use super::threaded::Service;
use base::w1::{Answer, Request};
use module::{Input, Output};
use std::path::PathBuf;

/// The kernel's thermometers in this folder. A missing folder is an answer, not an error: a bus may appear with its
/// adapter. Each measurement takes most of a second.
pub struct Thermometers(pub PathBuf);

impl Service for Thermometers {
    type Request = Request;
    type Answer = Answer;
    const THREAD: &'static str = "w1";
    const BUSY: &'static str = "its last measurement has not finished";

    fn work(&self) -> impl FnMut(Request) -> Result<Answer, Lost> + Send + 'static {
        let folder = self.0.clone();
        move |request| Ok(read::answer(&folder, request))
    }

    fn request(output: &Output) -> Option<&Request> {
        if let Output::OneWire(request) = output { Some(request) } else { None }
    }

    fn input(answer: &Answer) -> Input<'_> {
        Input::OneWire(answer)
    }
}

#[cfg(test)]
mod tests;
