//! The server: one transfer at a time, of anything that has objects.

use crate::wire::sdo::{Initiate, Malformed, Request, Response, Segment};
use crate::{Abort, Dictionary, Payload};
use base::{Duration, Instant};
use core::mem;

/// What a server serves.
pub trait Objects {
    /// What an object holds.
    ///
    /// # Errors
    /// The abort code.
    fn read(&mut self, index: u16, sub: u8) -> Result<Payload, Abort>;

    /// Whether `size` bytes (`None`: not known yet) may be written; gives the object's fixed length, if it has one.
    ///
    /// # Errors
    /// The abort code.
    fn check_write(&self, index: u16, sub: u8, size: Option<usize>) -> Result<Option<usize>, Abort>;

    /// Writes an object.
    ///
    /// # Errors
    /// The abort code; nothing was written.
    fn write(&mut self, index: u16, sub: u8, data: &[u8]) -> Result<(), Abort>;
}

impl Objects for Dictionary {
    fn read(&mut self, index: u16, sub: u8) -> Result<Payload, Abort> {
        Dictionary::read(self, index, sub)
    }

    fn check_write(&self, index: u16, sub: u8, size: Option<usize>) -> Result<Option<usize>, Abort> {
        Dictionary::check_write(self, index, sub, size)
    }

    fn write(&mut self, index: u16, sub: u8, data: &[u8]) -> Result<(), Abort> {
        Dictionary::write(self, index, sub, data)
    }
}

#[derive(Default)]
enum State {
    #[default]
    Idle,
    Download {
        index: u16,
        sub: u8,
        toggle: bool,
        size: Option<u32>,
        data: Payload,
        until: Instant,
    },
    Upload {
        index: u16,
        sub: u8,
        toggle: bool,
        data: Payload,
        sent: usize,
        until: Instant,
    },
}

impl State {
    fn object(&self) -> (u16, u8) {
        match *self {
            Self::Idle => (0, 0),
            Self::Download { index, sub, .. } | Self::Upload { index, sub, .. } => (index, sub),
        }
    }
}

/// One SDO channel of a node. Feed it the data of requests, send what it answers.
pub struct Server {
    timeout: Duration,
    state: State,
}

/// An answer, or the code to abort with.
type Answer = Result<Response, Abort>;

impl Server {
    /// Idle; each segment may take `timeout`.
    #[must_use]
    pub fn new(timeout: Duration) -> Self {
        Self { timeout, state: State::Idle }
    }

    /// Forgets what runs.
    pub fn reset(&mut self) {
        self.state = State::Idle;
    }

    /// The data of a request; gives the data of the response. A new transfer replaces one that runs.
    pub fn handle_rx(&mut self, now: Instant, data: &[u8], objects: &mut impl Objects) -> Option<[u8; 8]> {
        let running = self.state.object();
        let ((index, sub), answer) = match Request::decode(data) {
            Ok(Request::Abort { .. }) => {
                self.state = State::Idle;
                return None;
            }
            Err(Malformed::Length) => return None,
            Err(Malformed::Command { index, sub, .. }) => ((index, sub), Err(Abort::UNKNOWN_COMMAND)),
            Ok(Request::Upload { index, sub }) => ((index, sub), self.upload(now, index, sub, objects)),
            Ok(Request::Download { index, sub, initiate }) => {
                ((index, sub), self.download(now, index, sub, initiate, objects))
            }
            Ok(Request::UploadSegment { toggle }) => (running, self.upload_segment(now, toggle)),
            Ok(Request::DownloadSegment(segment)) => (running, self.download_segment(now, segment, objects)),
        };
        let response = answer.unwrap_or_else(|code| {
            self.state = State::Idle;
            Response::Abort { index, sub, code }
        });
        Some(response.encode())
    }

    fn upload(&mut self, now: Instant, index: u16, sub: u8, objects: &mut impl Objects) -> Answer {
        let data = objects.read(index, sub)?;
        self.state = State::Idle;
        let initiate = match data.len() {
            len @ 1..=4 => {
                let mut bytes = [0; 4];
                bytes[..len].copy_from_slice(&data);
                Initiate::Expedited { data: bytes, len: Some(len as u8) }
            }
            len => {
                let until = now + self.timeout;
                self.state = State::Upload { index, sub, toggle: false, data, sent: 0, until };
                Initiate::Segmented { size: Some(len as u32) }
            }
        };
        Ok(Response::Upload { index, sub, initiate })
    }

    fn upload_segment(&mut self, now: Instant, asked: bool) -> Answer {
        let State::Upload { index, sub, toggle, data, sent, .. } = mem::take(&mut self.state) else {
            return Err(Abort::UNKNOWN_COMMAND);
        };
        if asked != toggle {
            return Err(Abort::TOGGLE);
        }
        let end = data.len().min(sent + 7);
        let segment = Segment::new(toggle, end == data.len(), &data[sent..end]);
        if !segment.last {
            let until = now + self.timeout;
            self.state = State::Upload { index, sub, toggle: !toggle, data, sent: end, until };
        }
        Ok(Response::UploadSegment(segment))
    }

    fn download(&mut self, now: Instant, index: u16, sub: u8, how: Initiate, objects: &mut impl Objects) -> Answer {
        match how {
            Initiate::Expedited { data, len } => {
                let len = match len {
                    Some(len) => usize::from(len),
                    None => objects.check_write(index, sub, None)?.unwrap_or(4).min(4),
                };
                objects.write(index, sub, &data[..len])?;
                self.state = State::Idle;
            }
            Initiate::Segmented { size } => {
                objects.check_write(index, sub, size.map(|size| size as usize))?;
                let until = now + self.timeout;
                self.state = State::Download { index, sub, toggle: false, size, data: Payload::EMPTY, until };
            }
        }
        Ok(Response::Download { index, sub })
    }

    fn download_segment(&mut self, now: Instant, segment: Segment, objects: &mut impl Objects) -> Answer {
        let State::Download { index, sub, toggle, size, mut data, .. } = mem::take(&mut self.state) else {
            return Err(Abort::UNKNOWN_COMMAND);
        };
        if segment.toggle != toggle {
            return Err(Abort::TOGGLE);
        }
        data.extend(segment.data());
        let promised = size.map_or(usize::MAX, |size| size as usize);
        if data.len() > promised {
            return Err(Abort::TOO_LONG);
        }
        if segment.last {
            if size.is_some() && data.len() < promised {
                return Err(Abort::TOO_SHORT);
            }
            objects.write(index, sub, &data)?;
        } else {
            if data.len() > crate::dictionary::MAX_BYTES {
                return Err(Abort::TOO_LONG);
            }
            let until = now + self.timeout;
            self.state = State::Download { index, sub, toggle: !toggle, size, data, until };
        }
        Ok(Response::DownloadSegment { toggle })
    }

    /// Gives up a transfer whose client fell silent; gives the data of the abort.
    pub fn handle_timeout(&mut self, now: Instant) -> Option<[u8; 8]> {
        if self.poll_timeout()? > now {
            return None;
        }
        let (index, sub) = mem::take(&mut self.state).object();
        Some(Response::Abort { index, sub, code: Abort::TIMEOUT }.encode())
    }

    /// When to call [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.state {
            State::Idle => None,
            State::Download { until, .. } | State::Upload { until, .. } => Some(until),
        }
    }
}
