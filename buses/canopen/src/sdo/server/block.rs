//! The server's side of block transfers.

use super::super::block::{Expired, Receiver, Sender, check_size};
use super::{Answer, Objects, Server, State, check_room};
use crate::Abort;
use crate::wire::sdo::{Request, Response};
use base::Instant;
use core::mem;

impl Server {
    fn block_size(&self) -> Result<u8, Abort> {
        self.blksize.ok_or(Abort::UNKNOWN_COMMAND)
    }

    /// Begins a block download; `frame`: the request.
    pub(super) fn begin_block_download(
        &mut self,
        now: Instant,
        (crc, size): (bool, Option<u32>),
        frame: [u8; 8],
        objects: &mut impl Objects,
    ) -> Answer {
        let (blksize, (index, sub)) = (self.block_size()?, self.object);
        objects.check_write(index, sub, size.map(|size| size as usize))?;
        self.state = State::BlockDownload(Receiver::new(now, self.timeout, (size, blksize, crc), frame)?);
        Ok(Some(Response::BlockDownload { index, sub, crc, blksize }))
    }

    /// Any frame while the client writes: a segment, unless it can be none.
    pub(super) fn block_download(&mut self, now: Instant, frame: [u8; 8], objects: &mut impl Objects) -> Answer {
        let State::BlockDownload(receiver) = &mut self.state else {
            return Ok(None);
        };
        match Request::decode(&frame) {
            // Some clients give up without saying what (python-canopen).
            Ok(Request::Abort { index, sub, .. })
                if frame[0] == 0x80 && [self.object, (0, 0)].contains(&(index, sub)) =>
            {
                self.state = State::Idle;
                return Ok(None);
            }
            Ok(Request::BlockDownloadEnd(end)) if receiver.is_complete() => {
                let Some(data) = receiver.finish(end, frame) else {
                    return Ok(None);
                };
                self.state = State::Idle;
                let (index, sub) = self.object;
                objects.write(index, sub, &data?)?;
                return Ok(Some(Response::BlockDownloadEnd));
            }
            _ if receiver.is_complete() && receiver.repeats(frame) => return Ok(None),
            _ => {}
        }
        let answer = match receiver.is_complete() {
            true => Err(Abort::UNKNOWN_COMMAND),
            false => receiver.take(now, frame),
        };
        let room = receiver.unannounced().map_or(Ok(()), |len| check_room(objects, self.object, len));
        match room.and(answer) {
            Ok(ackseq) => Ok(ackseq.and_then(|ackseq| self.acknowledge(ackseq))),
            Err(code) => {
                self.strays.follow(frame, now + self.timeout);
                Err(code)
            }
        }
    }

    fn acknowledge(&self, ackseq: u8) -> Option<Response> {
        self.blksize.map(|blksize| Response::BlockDownloadAck { ackseq, blksize })
    }

    /// The client reads.
    pub(super) fn begin_block_upload(
        &mut self,
        now: Instant,
        (crc, blksize, threshold): (bool, u8, u8),
        objects: &mut impl Objects,
    ) -> Answer {
        let ((index, sub), _) = (self.object, self.block_size()?);
        let blksize = check_size(blksize)?;
        let data = objects.read(index, sub)?;
        if data.len() <= usize::from(threshold) && threshold > 0 {
            return self.upload(now, data);
        }
        let size = Some(data.len() as u32);
        let sender = Sender::new(now, self.timeout, data, blksize, crc);
        self.state = State::BlockUpload { started: false, sender };
        // Only to who has one too: python-canopen takes this alone for the promise of a CRC.
        Ok(Some(Response::BlockUpload { index, sub, crc, size }))
    }

    /// Takes the client's start of the upload, which may be repeated.
    pub(super) fn start_block_upload(&mut self, now: Instant) -> Answer {
        match &mut self.state {
            State::BlockUpload { started, sender } => {
                if !mem::replace(started, true) {
                    sender.start(now);
                }
                Ok(None)
            }
            _ => Err(Abort::UNKNOWN_COMMAND),
        }
    }

    pub(super) fn acknowledged(&mut self, now: Instant, ackseq: u8, blksize: u8) -> Answer {
        match &mut self.state {
            State::BlockUpload { started: true, sender } => {
                let end = sender.acknowledge(now, ackseq, blksize)?;
                if end.is_some() {
                    self.state = State::BlockUploadEnd { until: now + self.timeout };
                }
                Ok(end.map(Response::BlockUploadEnd))
            }
            State::BlockUploadEnd { .. } => Ok(None),
            _ => Err(Abort::UNKNOWN_COMMAND),
        }
    }

    /// Takes the client's end of the upload, which may be repeated.
    pub(super) fn end_block_upload(&mut self) -> Answer {
        match self.state {
            State::BlockUploadEnd { .. } | State::Idle => {
                self.state = State::Idle;
                Ok(None)
            }
            _ => Err(Abort::UNKNOWN_COMMAND),
        }
    }

    /// Timeout due at `now`, if any.
    pub(super) fn block_timeout(&mut self, now: Instant) -> Option<Result<Response, Abort>> {
        match &mut self.state {
            State::BlockDownload(receiver) => match receiver.expired(now)? {
                Expired::Quiet(ackseq) => self.acknowledge(ackseq).map(Ok),
                Expired::Silent => {
                    self.strays.expect(receiver.awaited(), now + self.timeout);
                    Some(Err(Abort::TIMEOUT))
                }
            },
            State::BlockUpload { sender, .. } => sender.expired(now).then_some(Err(Abort::TIMEOUT)),
            _ => None,
        }
    }
}
