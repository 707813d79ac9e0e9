//! The client's side of block transfers.

use super::super::block::{Expired, Receiver, Sender, check_size};
use super::normal::download;
use super::{Client, Error, Transfer, Wait};
use crate::wire::sdo::{Request, Response};
use crate::{Abort, Payload};
use base::Instant;

/// Size up to which a server may answer a block upload by a normal one, bytes: that takes fewer frames.
const THRESHOLD: u8 = 28;

impl Client {
    /// Begins to read in blocks; false when busy. A server that cannot, or that answers with a normal upload, is read
    /// from normally.
    pub fn read_block(&mut self, now: Instant, index: u16, sub: u8) -> bool {
        let request = Request::BlockUpload { index, sub, crc: true, blksize: self.blksize, threshold: THRESHOLD };
        self.begin(now, index, sub, Wait::BlockUpload, request)
    }

    /// Begins to write in blocks; false when busy. A server that cannot is written to normally.
    pub fn write_block(&mut self, now: Instant, index: u16, sub: u8, data: Payload) -> bool {
        let size = Some(data.len() as u32);
        let request = Request::BlockDownload { index, sub, crc: true, size };
        self.begin(now, index, sub, Wait::BlockDownload { data }, request)
    }

    pub(super) fn refused(&mut self, now: Instant, mut transfer: Transfer, code: Abort) {
        let (index, sub) = (transfer.index, transfer.sub);
        let (wait, request) = match (transfer.wait, code) {
            (Wait::BlockUpload, Abort::UNKNOWN_COMMAND) => (Wait::Upload, Request::Upload { index, sub }),
            (Wait::BlockDownload { data }, Abort::UNKNOWN_COMMAND) => download(index, sub, data),
            (wait, _) => return self.finish(now, Transfer { wait, ..transfer }, Err(Error::Refused(code))),
        };
        transfer.wait = wait;
        self.go_on(now, transfer, request);
    }

    /// `frame`: the answer with `crc` and `size`.
    pub(super) fn block_upload(
        &mut self,
        now: Instant,
        mut transfer: Transfer,
        (crc, size): (bool, Option<u32>),
        frame: [u8; 8],
    ) {
        match Receiver::new(now, self.timeout, (size, self.blksize, crc), frame) {
            Ok(receiver) => {
                transfer.wait = Wait::BlockReceive(receiver);
                self.go_on(now, transfer, Request::BlockUploadStart);
            }
            Err(code) => self.give_up(now, transfer, code),
        }
    }

    pub(super) fn block_receive(&mut self, now: Instant, mut transfer: Transfer, frame: [u8; 8]) {
        let Wait::BlockReceive(receiver) = &mut transfer.wait else {
            return self.ignore(transfer);
        };
        if receiver.is_complete() {
            let Ok(Response::BlockUploadEnd(end)) = Response::decode(&frame) else {
                return self.ignore(transfer);
            };
            return match receiver.finish(end, frame) {
                None => self.ignore(transfer),
                Some(Err(code)) => self.give_up(now, transfer, code),
                Some(Ok(data)) => {
                    self.tx.push(Request::BlockUploadEnd.encode());
                    self.finish(now, transfer, Ok(data));
                }
            };
        }
        match receiver.take(now, frame) {
            Ok(None) => self.transfer = Some(transfer),
            Ok(Some(ackseq)) => self.acknowledge(transfer, ackseq),
            Err(code) => {
                self.strays.follow(frame, now + self.timeout);
                self.give_up(now, transfer, code);
            }
        }
    }

    fn acknowledge(&mut self, transfer: Transfer, ackseq: u8) {
        self.tx.push(Request::BlockUploadAck { ackseq, blksize: self.blksize }.encode());
        self.transfer = Some(transfer);
    }

    pub(super) fn block_download(
        &mut self,
        now: Instant,
        mut transfer: Transfer,
        data: Payload,
        (crc, blksize): (bool, u8),
    ) {
        match check_size(blksize) {
            Ok(blksize) => {
                transfer.wait = Wait::BlockSend(Sender::new(now, self.timeout, data, blksize, crc));
                self.transfer = Some(transfer);
            }
            Err(code) => self.give_up(now, transfer, code),
        }
    }

    pub(super) fn acknowledged(
        &mut self,
        now: Instant,
        mut transfer: Transfer,
        mut sender: Sender,
        (ackseq, blksize): (u8, u8),
    ) {
        match sender.acknowledge(now, ackseq, blksize) {
            Ok(None) => {
                transfer.wait = Wait::BlockSend(sender);
                self.transfer = Some(transfer);
            }
            Ok(Some(end)) => {
                transfer.wait = Wait::BlockDownloadEnd;
                self.go_on(now, transfer, Request::BlockDownloadEnd(end));
            }
            Err(code) => self.give_up(now, transfer, code),
        }
    }

    pub(super) fn block_timeout(&mut self, now: Instant, mut transfer: Transfer) {
        let expired = match &mut transfer.wait {
            Wait::BlockReceive(receiver) => match receiver.expired(now) {
                Some(Expired::Quiet(ackseq)) => return self.acknowledge(transfer, ackseq),
                Some(Expired::Silent) => {
                    self.strays.expect(receiver.awaited(), now + self.timeout);
                    true
                }
                None => false,
            },
            Wait::BlockSend(sender) => sender.expired(now),
            _ => true,
        };
        if expired {
            self.give_up(now, transfer, Abort::TIMEOUT);
        } else {
            self.transfer = Some(transfer);
        }
    }
}
