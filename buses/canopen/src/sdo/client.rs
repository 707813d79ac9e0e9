//! The client: one transfer at a time.

mod block;
mod normal;

use super::MAX_LEN;
use super::block::{BLOCK_SIZE, Receiver, Sender, Strays};
use crate::wire::sdo::{Initiate, Malformed, Request, Response};
use crate::{Abort, Payload};
use base::{Duration, Instant, Queue};
use core::{fmt, mem};

/// Why a transfer failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// The node refused, with its code.
    Refused(Abort),
    /// No answer in time; the node got an abort.
    Timeout,
    /// Invalid answer; the node got this abort code.
    Protocol(Abort),
    /// The node was reset or lost meanwhile.
    Cancelled,
}

impl Error {
    /// The code for those who only know abort codes.
    #[must_use]
    pub const fn code(self) -> Abort {
        match self {
            Self::Refused(code) | Self::Protocol(code) => code,
            Self::Timeout => Abort::TIMEOUT,
            Self::Cancelled => Abort::DEVICE_STATE,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            // Not a refusal: the node waited for a frame of ours, or we for one of its.
            Self::Refused(code @ Abort::TIMEOUT) => write!(f, "a frame was lost, the node gave up: {code}"),
            Self::Refused(code) => write!(f, "refused: {code}"),
            Self::Timeout => f.write_str("no answer in time"),
            Self::Protocol(code) => write!(f, "nonsense answered: {code}"),
            Self::Cancelled => f.write_str("the node was reset or lost meanwhile"),
        }
    }
}

/// A transfer that ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Done {
    /// The object's index.
    pub index: u16,
    /// The object's sub-index.
    pub sub: u8,
    /// Data read (empty for a write), or the error.
    pub result: Result<Payload, Error>,
    /// From the first request to the last answer.
    pub took: Duration,
}

/// Awaited answer.
enum Wait {
    Upload,
    UploadSegment {
        toggle: bool,
        size: Option<u32>,
        data: Payload,
    },
    /// `data` is empty when all of it went with the request.
    Download {
        data: Option<Payload>,
    },
    DownloadSegment {
        toggle: bool,
        data: Payload,
        sent: usize,
    },
    BlockUpload,
    /// Segments, then the end.
    BlockReceive(Receiver),
    BlockDownload {
        data: Payload,
    },
    /// Acknowledges.
    BlockSend(Sender),
    BlockDownloadEnd,
}

/// The rest of a transfer.
struct Transfer {
    index: u16,
    sub: u8,
    since: Instant,
    until: Instant,
    wait: Wait,
    /// The last answer taken. It can come twice.
    heard: [u8; 8],
    /// Repeated since: what a server that does not toggle looks like.
    repeated: bool,
}

impl Transfer {
    fn due(&self) -> Instant {
        match &self.wait {
            Wait::BlockReceive(receiver) => receiver.due(),
            Wait::BlockSend(sender) => sender.due(),
            _ => self.until,
        }
    }
}

/// One SDO channel to one node. Takes the data of the node's responses, gives frames for the node.
pub struct Client {
    timeout: Duration,
    blksize: u8,
    transfer: Option<Transfer>,
    tx: Queue<[u8; 8], 4>,
    done: Option<Done>,
    strays: Strays,
    ignored: u32,
}

impl Client {
    /// Idle; each answer may take `timeout`.
    #[must_use]
    pub fn new(timeout: Duration) -> Self {
        Self {
            timeout,
            blksize: BLOCK_SIZE,
            transfer: None,
            tx: Queue::new(),
            done: None,
            strays: Strays::default(),
            ignored: 0,
        }
    }

    /// With blocks of at most `blksize` segments (1..=127, kept in that range) when it reads: what a receiver with a
    /// small buffer can take at once.
    #[must_use]
    pub fn with_block_size(self, blksize: u8) -> Self {
        Self { blksize: blksize.clamp(1, BLOCK_SIZE), ..self }
    }

    /// True if a transfer can begin: none runs and the last one's end was taken.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.transfer.is_none() && self.done.is_none()
    }

    /// Frames that fitted nothing, late answers among them.
    #[must_use]
    pub fn ignored(&self) -> u32 {
        self.ignored
    }

    fn begin(&mut self, now: Instant, index: u16, sub: u8, wait: Wait, request: Request) -> bool {
        let idle = self.is_idle();
        if idle {
            let until = now + self.timeout;
            let transfer = Transfer { index, sub, since: now, until, wait, heard: [0; 8], repeated: false };
            self.transfer = Some(transfer);
            self.tx.push(request.encode());
        }
        idle
    }

    /// Gives up what runs, without a word to the node: it was reset, or is gone.
    pub fn cancel(&mut self) {
        if let Some(Transfer { wait: Wait::BlockReceive(receiver), .. }) = self.transfer.take() {
            self.strays.expect(receiver.awaited(), receiver.until());
        }
        self.done = None;
        self.tx.clear();
    }

    /// The data of a response.
    pub fn handle_rx(&mut self, now: Instant, data: &[u8]) {
        let Ok(frame) = <[u8; 8]>::try_from(data) else {
            self.ignored = self.ignored.saturating_add(1);
            return;
        };
        match self.transfer.take() {
            Some(transfer) if !self.strays.swallow(now, frame) => self.response(now, transfer, frame),
            transfer => {
                self.transfer = transfer;
                self.ignored = self.ignored.saturating_add(1);
            }
        }
    }

    fn response(&mut self, now: Instant, transfer: Transfer, frame: [u8; 8]) {
        let here = (transfer.index, transfer.sub);
        match Response::decode(&frame) {
            // An abort begins with 0x80, which no segment of a block does.
            Ok(Response::Abort { index, sub, code }) if frame[0] == 0x80 && here == (index, sub) => {
                self.refused(now, transfer, code);
            }
            _ if matches!(transfer.wait, Wait::BlockReceive(_)) => self.block_receive(now, transfer, frame),
            Ok(
                Response::Upload { index, sub, .. }
                | Response::Download { index, sub }
                | Response::BlockUpload { index, sub, .. }
                | Response::BlockDownload { index, sub, .. },
            ) if here != (index, sub) => self.ignore(transfer),
            Ok(response) => self.answer(now, transfer, response, frame),
            // A specifier that the standard reserves, of our object.
            Err(Malformed::Command { index, sub, .. }) if here == (index, sub) => {
                self.give_up(now, transfer, Abort::UNKNOWN_COMMAND);
            }
            Err(_) => self.ignore(transfer),
        }
    }

    fn answer(&mut self, now: Instant, mut transfer: Transfer, response: Response, frame: [u8; 8]) {
        let in_step = match (&transfer.wait, response) {
            (Wait::UploadSegment { toggle, .. }, Response::UploadSegment(segment)) => *toggle == segment.toggle,
            (Wait::DownloadSegment { toggle, .. }, Response::DownloadSegment { toggle: answered }) => {
                *toggle == answered
            }
            _ => true,
        };
        if !in_step {
            return self.out_of_step(now, transfer, frame);
        }
        let before = mem::replace(&mut transfer.heard, frame);
        match (mem::replace(&mut transfer.wait, Wait::Upload), response) {
            (Wait::Upload | Wait::BlockUpload, Response::Upload { initiate, .. }) => match initiate {
                Initiate::Expedited { data, len } => {
                    let data = Payload::from(&data[..usize::from(len.unwrap_or(4))]);
                    self.finish(now, transfer, Ok(data));
                }
                Initiate::Segmented { size: Some(size) } if size as usize > MAX_LEN => {
                    self.give_up(now, transfer, Abort::OUT_OF_MEMORY);
                }
                Initiate::Segmented { size } => self.ask_segment(now, transfer, false, size, Payload::EMPTY),
            },
            (Wait::UploadSegment { toggle, size, data }, Response::UploadSegment(segment)) => {
                self.take_segment(now, transfer, segment, (toggle, size, data));
            }
            (Wait::Download { data: None }, Response::Download { .. }) => {
                self.finish(now, transfer, Ok(Payload::EMPTY));
            }
            (Wait::Download { data: Some(data) }, Response::Download { .. }) => {
                self.send_segment(now, transfer, false, data, 0);
            }
            (Wait::DownloadSegment { data, sent, .. }, Response::DownloadSegment { .. }) if sent == data.len() => {
                self.finish(now, transfer, Ok(Payload::EMPTY));
            }
            (Wait::DownloadSegment { toggle, data, sent }, Response::DownloadSegment { .. }) => {
                self.send_segment(now, transfer, !toggle, data, sent);
            }
            (Wait::BlockUpload, Response::BlockUpload { crc, size, .. }) => {
                self.block_upload(now, transfer, (crc, size), frame);
            }
            (Wait::BlockDownload { data }, Response::BlockDownload { crc, blksize, .. }) => {
                self.block_download(now, transfer, data, (crc, blksize));
            }
            (Wait::BlockSend(sender), Response::BlockDownloadAck { ackseq, blksize }) => {
                self.acknowledged(now, transfer, sender, (ackseq, blksize));
            }
            (Wait::BlockDownloadEnd, Response::BlockDownloadEnd) => self.finish(now, transfer, Ok(Payload::EMPTY)),
            // An answer that belongs to an earlier request: go on waiting.
            (wait, _) => self.ignore(Transfer { wait, heard: before, ..transfer }),
        }
    }

    /// A toggle that did not alternate; the last answer, come twice, looks like it.
    fn out_of_step(&mut self, now: Instant, transfer: Transfer, frame: [u8; 8]) {
        if transfer.heard == frame {
            self.ignore(Transfer { repeated: true, ..transfer });
        } else {
            self.give_up(now, transfer, Abort::TOGGLE);
        }
    }

    fn go_on(&mut self, now: Instant, transfer: Transfer, request: Request) {
        self.tx.push(request.encode());
        self.transfer = Some(Transfer { until: now + self.timeout, repeated: false, ..transfer });
    }

    fn ignore(&mut self, transfer: Transfer) {
        self.ignored = self.ignored.saturating_add(1);
        self.transfer = Some(transfer);
    }

    fn give_up(&mut self, now: Instant, transfer: Transfer, code: Abort) {
        let (index, sub) = (transfer.index, transfer.sub);
        self.tx.push(Request::Abort { index, sub, code }.encode());
        let error = if code == Abort::TIMEOUT { Error::Timeout } else { Error::Protocol(code) };
        self.finish(now, transfer, Err(error));
    }

    fn finish(&mut self, now: Instant, transfer: Transfer, result: Result<Payload, Error>) {
        let Transfer { index, sub, since, .. } = transfer;
        self.done = Some(Done { index, sub, result, took: now.since(since) });
    }

    /// Gives up what has waited too long, and asks again for what was lost of a block. Late or needless calls do no
    /// harm.
    pub fn handle_timeout(&mut self, now: Instant) {
        let Some(transfer) = self.transfer.take_if(|transfer| transfer.due() <= now) else {
            return;
        };
        match transfer.wait {
            Wait::BlockReceive(_) | Wait::BlockSend(_) => self.block_timeout(now, transfer),
            _ if transfer.repeated => self.give_up(now, transfer, Abort::TOGGLE),
            _ => self.give_up(now, transfer, Abort::TIMEOUT),
        }
    }

    /// Next request to send. A block is made segment by segment on request, so a slow sender needs no queue; the time
    /// limit for its acknowledge begins when the last segment is taken.
    pub fn poll_tx(&mut self) -> Option<[u8; 8]> {
        self.tx.pop().or_else(|| match &mut self.transfer.as_mut()?.wait {
            Wait::BlockSend(sender) => sender.segment(),
            _ => None,
        })
    }

    /// A transfer that ended.
    pub fn poll_done(&mut self) -> Option<Done> {
        self.done.take()
    }

    /// Instant of the next [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.transfer.as_ref().map(Transfer::due)
    }
}
