//! Folder of log files. Its disk may be slow, full or gone, and calls then block or fail: a separate thread executes
//! them in order, and a port of this kind is never lost.

pub(crate) mod disk;

use super::Lost;
use super::threaded::Service;
use base::store::{Answer, Request};
use disk::Disk;
use module::{Input, Output};
use std::path::PathBuf;

/// Log files in a folder, which is created with the first file.
pub struct Files {
    folder: PathBuf,
    /// Hook of the tests, called by the thread before each request.
    #[cfg(test)]
    before: fn(&Request),
}

impl Files {
    /// Creates the port of a folder.
    pub fn new(folder: PathBuf) -> Self {
        Self {
            folder,
            #[cfg(test)]
            before: |_| (),
        }
    }
}

impl Service for Files {
    type Request = Request;
    type Answer = Answer;
    const THREAD: &'static str = "store";
    const BUSY: &'static str = "the last write has not finished";

    fn work(&self) -> impl FnMut(Request) -> Result<Answer, Lost> + Send + 'static {
        let mut disk = Disk::new(&self.folder);
        #[cfg(test)]
        let before = self.before;
        move |request| {
            #[cfg(test)]
            before(&request);
            Ok(disk.perform(request))
        }
    }

    fn request(output: &Output) -> Option<&Request> {
        if let Output::Store(request) = output { Some(request) } else { None }
    }

    fn input(answer: &Answer) -> Input<'_> {
        Input::Store(answer)
    }
}

#[cfg(test)]
mod tests;
