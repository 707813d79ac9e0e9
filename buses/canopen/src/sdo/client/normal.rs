//! The client's side of expedited and segmented transfers.

use super::super::MAX_LEN;
use super::{Client, Transfer, Wait};
use crate::wire::sdo::{Initiate, Request, Segment};
use crate::{Abort, Payload};
use base::Instant;

impl Client {
    /// Begins to read; false when busy.
    pub fn read(&mut self, now: Instant, index: u16, sub: u8) -> bool {
        self.begin(now, index, sub, Wait::Upload, Request::Upload { index, sub })
    }

    /// Begins to write; false when busy.
    pub fn write(&mut self, now: Instant, index: u16, sub: u8, data: Payload) -> bool {
        let (wait, request) = download(index, sub, data);
        self.begin(now, index, sub, wait, request)
    }

    pub(super) fn take_segment(
        &mut self,
        now: Instant,
        transfer: Transfer,
        segment: Segment,
        (toggle, size, mut data): (bool, Option<u32>, Payload),
    ) {
        data.extend(segment.data());
        let limit = size.map_or(MAX_LEN, |size| size as usize);
        match () {
            () if data.len() > limit && size.is_none() => {
                self.give_up(now, transfer, Abort::OUT_OF_MEMORY);
            }
            () if data.len() > limit => self.give_up(now, transfer, Abort::TOO_LONG),
            // Nothing, and more to follow: that could go on for ever.
            () if !segment.last && segment.data().is_empty() => self.give_up(now, transfer, Abort::TOO_SHORT),
            () if !segment.last => self.ask_segment(now, transfer, !toggle, size, data),
            () if size.is_some() && data.len() < limit => {
                self.give_up(now, transfer, Abort::TOO_SHORT);
            }
            () => self.finish(now, transfer, Ok(data)),
        }
    }

    pub(super) fn ask_segment(
        &mut self,
        now: Instant,
        mut transfer: Transfer,
        toggle: bool,
        size: Option<u32>,
        data: Payload,
    ) {
        transfer.wait = Wait::UploadSegment { toggle, size, data };
        self.go_on(now, transfer, Request::UploadSegment { toggle });
    }

    pub(super) fn send_segment(
        &mut self,
        now: Instant,
        mut transfer: Transfer,
        toggle: bool,
        data: Payload,
        sent: usize,
    ) {
        let end = data.len().min(sent + 7);
        let segment = Segment::new(toggle, end == data.len(), &data[sent..end]);
        transfer.wait = Wait::DownloadSegment { toggle, data, sent: end };
        self.go_on(now, transfer, Request::DownloadSegment(segment));
    }
}

/// A normal write: at once when it fits, else in segments.
pub(super) fn download(index: u16, sub: u8, data: Payload) -> (Wait, Request) {
    let mut bytes = [0; 4];
    let (initiate, data) = match data.len() {
        len @ 1..=4 => {
            bytes[..len].copy_from_slice(&data);
            (Initiate::Expedited { data: bytes, len: Some(len as u8) }, None)
        }
        len => (Initiate::Segmented { size: Some(len as u32) }, Some(data)),
    };
    (Wait::Download { data }, Request::Download { index, sub, initiate })
}
