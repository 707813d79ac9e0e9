//! The server: one transfer at a time, of anything that has objects.

mod block;

use super::MAX_LEN;
use super::block::{BLOCK_SIZE, Receiver, Sender, Strays};
use crate::wire::sdo::{Initiate, Malformed, Request, Response, Segment};
use crate::{Abort, Dictionary, Payload};
use base::{Duration, Instant};
use core::mem;

/// Objects that a server gives access to.
pub trait Objects {
    /// Reads an object.
    ///
    /// # Errors
    /// The abort code.
    fn read(&mut self, index: u16, sub: u8) -> Result<Payload, Abort>;

    /// True if `size` bytes (`None`: not known yet) may be written; gives the object's fixed length, if it has one.
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
        toggle: bool,
        size: Option<u32>,
        data: Payload,
        until: Instant,
    },
    Upload {
        toggle: bool,
        data: Payload,
        sent: usize,
        until: Instant,
    },
    /// Segments, then the end.
    BlockDownload(Receiver),
    /// The client's start is awaited, then acknowledges.
    BlockUpload {
        started: bool,
        sender: Sender,
    },
    /// All is acknowledged, and the end has been sent.
    BlockUploadEnd {
        until: Instant,
    },
}

/// One SDO channel of a node. Takes the data of requests; to be sent: its answer, then the frames of [`Self::poll_tx`].
pub struct Server {
    timeout: Duration,
    /// Segments of a block when it is written to; `None`: block transfers are refused.
    blksize: Option<u8>,
    state: State,
    /// Object of the running transfer.
    object: (u16, u8),
    strays: Strays,
}

/// An answer, or none, or the code to abort with.
type Answer = Result<Option<Response>, Abort>;

impl Server {
    /// Idle; each segment may take `timeout`.
    #[must_use]
    pub fn new(timeout: Duration) -> Self {
        Self { timeout, blksize: Some(BLOCK_SIZE), state: State::Idle, object: (0, 0), strays: Strays::default() }
    }

    /// With blocks of at most `blksize` segments (1..=127, kept in that range) when it is written to.
    #[must_use]
    pub fn with_block_size(self, blksize: u8) -> Self {
        Self { blksize: Some(blksize.clamp(1, BLOCK_SIZE)), ..self }
    }

    /// A server without block transfers: they are refused with [`Abort::UNKNOWN_COMMAND`], as by many small devices.
    #[must_use]
    pub fn without_block(self) -> Self {
        Self { blksize: None, ..self }
    }

    /// Forgets what runs.
    pub fn reset(&mut self) {
        (self.state, self.object) = (State::Idle, (0, 0));
    }

    /// The data of a request; gives the data of the response. A new transfer replaces one that runs.
    pub fn handle_rx(&mut self, now: Instant, data: &[u8], objects: &mut impl Objects) -> Option<[u8; 8]> {
        let frame = <[u8; 8]>::try_from(data).ok()?;
        if self.strays.swallow(now, frame) {
            return None;
        }
        let answer = if let State::BlockDownload(_) = self.state {
            self.block_download(now, frame, objects)
        } else {
            self.request(now, frame, objects)
        };
        let (index, sub) = self.object;
        let response = answer.unwrap_or_else(|code| {
            self.state = State::Idle;
            Some(Response::Abort { index, sub, code })
        });
        if let State::Idle = self.state {
            self.object = (0, 0);
        }
        response.map(Response::encode)
    }

    fn request(&mut self, now: Instant, frame: [u8; 8], objects: &mut impl Objects) -> Answer {
        let request = Request::decode(&frame);
        if let Some(object) = begins(&request) {
            (self.state, self.object) = (State::Idle, object);
        }
        let (index, sub) = self.object;
        match request {
            Ok(Request::Abort { .. }) => {
                self.state = State::Idle;
                Ok(None)
            }
            Ok(Request::Upload { .. }) => self.upload(now, objects.read(index, sub)?),
            Ok(Request::UploadSegment { toggle }) => self.upload_segment(now, toggle),
            Ok(Request::Download { initiate, .. }) => self.download(now, initiate, objects),
            Ok(Request::DownloadSegment(segment)) => self.download_segment(now, segment, objects),
            Ok(Request::BlockUpload { crc, blksize, threshold, .. }) => {
                self.begin_block_upload(now, (crc, blksize, threshold), objects)
            }
            Ok(Request::BlockUploadStart) => self.start_block_upload(now),
            Ok(Request::BlockUploadAck { ackseq, blksize }) => self.acknowledged(now, ackseq, blksize),
            Ok(Request::BlockUploadEnd) => self.end_block_upload(),
            Ok(Request::BlockDownload { crc, size, .. }) => self.begin_block_download(now, (crc, size), frame, objects),
            Ok(Request::BlockDownloadEnd(_)) | Err(_) => Err(Abort::UNKNOWN_COMMAND),
        }
    }

    fn upload(&mut self, now: Instant, data: Payload) -> Answer {
        let initiate = match data.len() {
            len @ 1..=4 => {
                let mut bytes = [0; 4];
                bytes[..len].copy_from_slice(&data);
                Initiate::Expedited { data: bytes, len: Some(len as u8) }
            }
            len => {
                self.state = State::Upload { toggle: false, data, sent: 0, until: now + self.timeout };
                Initiate::Segmented { size: Some(len as u32) }
            }
        };
        let (index, sub) = self.object;
        Ok(Some(Response::Upload { index, sub, initiate }))
    }

    fn upload_segment(&mut self, now: Instant, asked: bool) -> Answer {
        let State::Upload { toggle, data, sent, .. } = mem::take(&mut self.state) else {
            return Err(Abort::UNKNOWN_COMMAND);
        };
        if asked != toggle {
            return Err(Abort::TOGGLE);
        }
        let end = data.len().min(sent + 7);
        let segment = Segment::new(toggle, end == data.len(), &data[sent..end]);
        if !segment.last {
            self.state = State::Upload { toggle: !toggle, data, sent: end, until: now + self.timeout };
        }
        Ok(Some(Response::UploadSegment(segment)))
    }

    fn download(&mut self, now: Instant, how: Initiate, objects: &mut impl Objects) -> Answer {
        let (index, sub) = self.object;
        match how {
            Initiate::Expedited { data, len } => {
                let len = match len {
                    Some(len) => usize::from(len),
                    None => objects.check_write(index, sub, None)?.unwrap_or(4).min(4),
                };
                objects.write(index, sub, &data[..len])?;
            }
            Initiate::Segmented { size } => {
                objects.check_write(index, sub, size.map(|size| size as usize))?;
                if size.is_some_and(|size| size as usize > MAX_LEN) {
                    return Err(Abort::OUT_OF_MEMORY);
                }
                self.state = State::Download { toggle: false, size, data: Payload::EMPTY, until: now + self.timeout };
            }
        }
        Ok(Some(Response::Download { index, sub }))
    }

    fn download_segment(&mut self, now: Instant, segment: Segment, objects: &mut impl Objects) -> Answer {
        let State::Download { toggle, size, mut data, .. } = mem::take(&mut self.state) else {
            return Err(Abort::UNKNOWN_COMMAND);
        };
        if segment.toggle != toggle {
            return Err(Abort::TOGGLE);
        }
        data.extend(segment.data());
        let (index, sub) = self.object;
        match size {
            Some(size) if data.len() > size as usize => return Err(Abort::TOO_LONG),
            Some(size) if segment.last && data.len() < size as usize => return Err(Abort::TOO_SHORT),
            Some(_) => {}
            None => check_room(objects, self.object, data.len())?,
        }
        match segment.last {
            true => objects.write(index, sub, &data)?,
            // Nothing, and more to follow: that could go on for ever.
            false if segment.data().is_empty() => return Err(Abort::TOO_SHORT),
            false => self.state = State::Download { toggle: !toggle, size, data, until: now + self.timeout },
        }
        Ok(Some(Response::DownloadSegment { toggle }))
    }

    /// Next segment of a block upload, made on request: a slow sender needs no queue. To be drained after the answer.
    pub fn poll_tx(&mut self) -> Option<[u8; 8]> {
        match &mut self.state {
            State::BlockUpload { started: true, sender } => sender.segment(),
            _ => None,
        }
    }

    /// Gives up a transfer whose client fell silent, and asks again for what was lost of a block; gives the data of
    /// the abort or acknowledge. Late or needless calls do no harm.
    pub fn handle_timeout(&mut self, now: Instant) -> Option<[u8; 8]> {
        let answer = match self.state {
            State::BlockDownload(_) | State::BlockUpload { .. } => self.block_timeout(now)?,
            _ if self.poll_timeout()? > now => return None,
            _ => Err(Abort::TIMEOUT),
        };
        let response = answer.unwrap_or_else(|code| {
            let (index, sub) = self.object;
            self.reset();
            Response::Abort { index, sub, code }
        });
        Some(response.encode())
    }

    /// Instant of the next [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match &self.state {
            State::Idle => None,
            State::Download { until, .. } | State::Upload { until, .. } | State::BlockUploadEnd { until } => {
                Some(*until)
            }
            State::BlockDownload(receiver) => Some(receiver.due()),
            State::BlockUpload { sender, .. } => Some(sender.due()),
        }
    }
}

/// The object of a request that begins a transfer, or wants to.
fn begins(request: &Result<Request, Malformed>) -> Option<(u16, u8)> {
    match *request {
        Ok(
            Request::Upload { index, sub }
            | Request::Download { index, sub, .. }
            | Request::BlockUpload { index, sub, .. }
            | Request::BlockDownload { index, sub, .. },
        )
        | Err(Malformed::Command { index, sub, .. }) => Some((index, sub)),
        _ => None,
    }
}

/// Checks that `len` bytes of a transfer without an announced size fit.
fn check_room(objects: &impl Objects, (index, sub): (u16, u8), len: usize) -> Result<(), Abort> {
    match objects.check_write(index, sub, Some(len)) {
        Err(Abort::TOO_LONG) => Err(Abort::TOO_LONG),
        _ if len > MAX_LEN => Err(Abort::OUT_OF_MEMORY),
        _ => Ok(()),
    }
}
