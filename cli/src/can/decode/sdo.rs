//! SDO transfers of one node, followed frame by frame: expedited, segmented and block, both ways.

use super::{Look, Told};
use crate::can::book::Book;
use crate::can::value::{self, bytes};
use canopen::Abort;
use canopen::wire::sdo::{BlockSegment, Initiate, Request, Response, Segment};
use serde_json::{Value, json};

/// Bytes kept of longer data.
const KEPT: usize = 1024;

/// Effect of a frame on its transfer. `index` and `sub` are the object.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // the names are the description
pub enum Step {
    /// The client wants to read or write; short data comes at once.
    Asked { write: bool, index: u16, sub: u8, block: bool, size: Option<u32>, data: Option<Vec<u8>> },
    /// The server agrees.
    Begun { write: bool, index: u16, sub: u8, size: Option<u32> },
    /// Data: number of bytes so far.
    Moved { index: u16, sub: u8, len: usize, size: Option<u32> },
    /// Request for more, or acknowledge of what was sent.
    Confirmed { index: u16, sub: u8, len: usize, size: Option<u32> },
    /// Transfer complete: number of bytes; the data unless it is long, or frames were missed.
    Done { write: bool, index: u16, sub: u8, len: Option<usize>, data: Option<Vec<u8>> },
    /// Transfer aborted.
    Aborted { index: u16, sub: u8, code: Abort },
    /// Frame that fits no known transfer.
    Stray { data: Vec<u8> },
}

struct Transfer {
    write: bool,
    index: u16,
    sub: u8,
    size: Option<u32>,
    /// The first [`KEPT`] bytes of the data, and how many there are in all.
    head: Vec<u8>,
    len: usize,
    block: Option<Block>,
    /// The last segment was sent.
    last: bool,
}

/// Progress of a block transfer.
#[derive(Default)]
struct Block {
    /// Segments are due, which have no command.
    flows: bool,
    /// Segments in each block, and the last that came in order.
    size: u8,
    at: u8,
    /// Bytes before this block.
    before: usize,
}

/// The SDO channel of one node.
#[derive(Default)]
pub struct Channel(Option<Transfer>);

impl Channel {
    /// Takes the data of a frame, from the client or from the server.
    pub fn step(&mut self, is_request: bool, data: &[u8]) -> Step {
        let stray = || Step::Stray { data: data.into() };
        let Ok(frame) = <[u8; 8]>::try_from(data) else {
            return stray();
        };
        if let Some(step) = self.0.as_mut().and_then(|transfer| transfer.block_segment(is_request, frame)) {
            return step;
        }
        let step = match is_request {
            true => Request::decode(data).ok().and_then(|request| self.request(request)),
            false => Response::decode(data).ok().and_then(|response| self.response(response)),
        };
        step.unwrap_or_else(stray)
    }

    fn request(&mut self, request: Request) -> Option<Step> {
        let mut asked = |write, index, sub, size, block: bool, data: Option<Vec<u8>>| {
            let head = data.clone().unwrap_or_default();
            let len = head.len();
            let block_state = block.then(Block::default);
            self.0 = Some(Transfer { write, index, sub, size, head, len, block: block_state, last: data.is_some() });
            Some(Step::Asked { write, index, sub, block, size, data })
        };
        match request {
            Request::Upload { index, sub } => asked(false, index, sub, None, false, None),
            Request::BlockUpload { index, sub, blksize, .. } => {
                let step = asked(false, index, sub, None, true, None);
                self.block()?.1.size = blksize;
                step
            }
            Request::Download { index, sub, initiate: Initiate::Expedited { data, len } } => {
                asked(true, index, sub, None, false, Some(cut(data, len)))
            }
            Request::Download { index, sub, initiate: Initiate::Segmented { size } } => {
                asked(true, index, sub, size, false, None)
            }
            Request::BlockDownload { index, sub, size, .. } => asked(true, index, sub, size, true, None),
            Request::DownloadSegment(segment) => self.segment(segment, true),
            Request::BlockDownloadEnd(end) => self.block_end(true, end.unused),
            Request::UploadSegment { .. } => self.confirmed(false),
            Request::BlockUploadStart => {
                self.block()?.1.flows = true;
                self.confirmed(false)
            }
            Request::BlockUploadAck { ackseq, blksize } => self.acknowledged(false, ackseq, blksize),
            Request::BlockUploadEnd => {
                let step = self.confirmed(false);
                self.0 = None;
                step
            }
            Request::Abort { index, sub, code } => self.aborted(index, sub, code),
        }
    }

    fn response(&mut self, response: Response) -> Option<Step> {
        match response {
            Response::Upload { index, sub, initiate: Initiate::Expedited { data, len } } => {
                self.0 = None;
                let data = cut(data, len);
                Some(Step::Done { write: false, index, sub, len: Some(data.len()), data: Some(data) })
            }
            Response::Upload { index, sub, initiate: Initiate::Segmented { size } } => {
                // To a request for blocks, too.
                self.of(false, index, sub)?.block = None;
                self.begun(false, index, sub, size)
            }
            Response::BlockUpload { index, sub, size, .. } => self.begun(false, index, sub, size),
            Response::Download { index, sub } => match self.of(true, index, sub) {
                None => Some(Step::Done { write: true, index, sub, len: None, data: None }),
                Some(transfer) if transfer.last => self.done(),
                Some(_) => self.begun(true, index, sub, None),
            },
            Response::BlockDownload { index, sub, blksize, .. } => {
                self.of(true, index, sub)?;
                let (_, block) = self.block()?;
                *block = Block { flows: true, size: blksize, ..Block::default() };
                self.begun(true, index, sub, None)
            }
            Response::UploadSegment(segment) => self.segment(segment, false),
            Response::BlockUploadEnd(end) => self.block_end(false, end.unused),
            Response::DownloadSegment { .. } if self.0.as_ref().is_some_and(|t| t.write && t.last) => self.done(),
            Response::DownloadSegment { .. } => self.confirmed(true),
            Response::BlockDownloadAck { ackseq, blksize } => self.acknowledged(true, ackseq, blksize),
            Response::BlockDownloadEnd => self.done(),
            Response::Abort { index, sub, code } => self.aborted(index, sub, code),
        }
    }

    /// The transfer that runs, if it is this one.
    fn of(&mut self, write: bool, index: u16, sub: u8) -> Option<&mut Transfer> {
        self.0.as_mut().filter(|transfer| (transfer.write, transfer.index, transfer.sub) == (write, index, sub))
    }

    /// A block transfer that runs: whether it writes, and where it is.
    fn block(&mut self) -> Option<(bool, &mut Block)> {
        let transfer = self.0.as_mut()?;
        Some((transfer.write, transfer.block.as_mut()?))
    }

    fn begun(&mut self, write: bool, index: u16, sub: u8, size: Option<u32>) -> Option<Step> {
        let transfer = self.of(write, index, sub)?;
        transfer.size = transfer.size.or(size);
        Some(Step::Begun { write, index, sub, size: transfer.size })
    }

    fn segment(&mut self, segment: Segment, write: bool) -> Option<Step> {
        let transfer = self.0.as_mut().filter(|transfer| transfer.write == write && transfer.block.is_none())?;
        transfer.take(segment.data());
        transfer.last = segment.last;
        // A write is complete with the server's confirmation.
        if segment.last && !write { self.done() } else { Some(transfer.moved()) }
    }

    fn acknowledged(&mut self, write: bool, ackseq: u8, blksize: u8) -> Option<Step> {
        let transfer = self.0.as_mut().filter(|transfer| transfer.write == write)?;
        let block = transfer.block.as_mut()?;
        let all = ackseq == block.at;
        transfer.len = block.before + 7 * usize::from(ackseq);
        transfer.head.truncate(transfer.len);
        // What is missing is sent again.
        transfer.last &= all;
        *block = Block { flows: !transfer.last, size: blksize, at: 0, before: transfer.len };
        self.confirmed(write)
    }

    fn block_end(&mut self, write: bool, unused: u8) -> Option<Step> {
        let transfer = self.0.as_mut().filter(|transfer| transfer.write == write && transfer.block.is_some())?;
        transfer.len = transfer.len.saturating_sub(usize::from(unused));
        transfer.head.truncate(transfer.len);
        let step = transfer.moved();
        if write {
            return Some(step);
        }
        // The client's last word is still to come.
        let Transfer { write, index, sub, len, .. } = *transfer;
        Some(Step::Done { write, index, sub, len: Some(len), data: transfer.data() })
    }

    fn confirmed(&mut self, write: bool) -> Option<Step> {
        let &Transfer { index, sub, len, size, .. } = self.0.as_ref().filter(|transfer| transfer.write == write)?;
        Some(Step::Confirmed { index, sub, len, size })
    }

    fn done(&mut self) -> Option<Step> {
        let transfer = self.0.take()?;
        let Transfer { write, index, sub, len, .. } = transfer;
        Some(Step::Done { write, index, sub, len: Some(len), data: transfer.data() })
    }

    fn aborted(&mut self, index: u16, sub: u8, code: Abort) -> Option<Step> {
        self.0 = None;
        Some(Step::Aborted { index, sub, code })
    }
}

impl Transfer {
    fn take(&mut self, data: &[u8]) {
        self.len += data.len();
        self.head.extend(data.iter().take(KEPT - self.head.len()));
    }

    fn data(&self) -> Option<Vec<u8>> {
        (self.head.len() == self.len).then(|| self.head.clone())
    }

    fn moved(&self) -> Step {
        Step::Moved { index: self.index, sub: self.sub, len: self.len, size: self.size }
    }

    /// A frame of the side that sends data while segments are due; none when it is no segment.
    fn block_segment(&mut self, is_request: bool, frame: [u8; 8]) -> Option<Step> {
        let block = self.block.as_mut().filter(|block| block.flows && self.write == is_request)?;
        let BlockSegment { last, seqno, data } = BlockSegment::decode(frame);
        // An abort looks like the last segment of that number.
        if seqno == 0 {
            return None;
        }
        let in_order = seqno == block.at + 1;
        if in_order {
            block.at = seqno;
        }
        block.flows = !last && seqno < block.size;
        self.last |= last;
        if in_order {
            self.take(&data);
        }
        Some(self.moved())
    }
}

fn cut(data: [u8; 4], len: Option<u8>) -> Vec<u8> {
    data[..usize::from(len.unwrap_or(4)).min(4)].into()
}

impl Step {
    /// Line and JSON of the effect.
    pub fn told(&self, book: &Book, node: u8, is_request: bool) -> Told {
        let name = |index, sub| book.titled(node, index, sub);
        let of = |size: &Option<u32>| size.map(|size| format!(" of {size}")).unwrap_or_default();
        let (step, look, says) = match self {
            Self::Asked { write: false, index, sub, block, .. } => {
                let blocks = if *block { ", in blocks" } else { "" };
                ("asked", Look::Command, format!("read {}{blocks}", name(*index, *sub)))
            }
            Self::Asked { index, sub, data: Some(data), .. } => {
                let shown = book.show(node, *index, *sub, data);
                ("asked", Look::Command, format!("write {} = {}", name(*index, *sub), shown.text))
            }
            Self::Asked { index, sub, block, size, .. } => {
                let size = size.map(|size| format!(", {size} bytes")).unwrap_or_default();
                let blocks = if *block { ", in blocks" } else { "" };
                ("asked", Look::Command, format!("write {}{size}{blocks}", name(*index, *sub)))
            }
            Self::Begun { write, index, sub, size } => {
                let what = match (write, size) {
                    (true, _) => "may be written".into(),
                    (false, Some(size)) => format!("{size} bytes follow"),
                    (false, None) => "data follows".into(),
                };
                ("begun", Look::Plain, format!("{}: {what}", name(*index, *sub)))
            }
            Self::Moved { index, sub, len, size } => {
                ("moved", Look::Dim, format!("{}: {len}{} bytes", value::object(*index, *sub), of(size)))
            }
            Self::Confirmed { index, sub, len, size } => {
                ("confirmed", Look::Dim, format!("{}: after {len}{} bytes", value::object(*index, *sub), of(size)))
            }
            Self::Done { write: false, index, sub, data: Some(data), .. } => {
                let shown = book.show(node, *index, *sub, data);
                ("done", Look::Good, format!("{} = {}", name(*index, *sub), shown.text))
            }
            Self::Done { write, index, sub, len, .. } => {
                let len = len.filter(|len| *len > 8).map(|len| format!(", {len} bytes")).unwrap_or_default();
                let done = if *write { "written" } else { "read" };
                ("done", Look::Good, format!("{} {done}{len}", name(*index, *sub)))
            }
            Self::Aborted { index, sub, code } => {
                ("aborted", Look::Bad, format!("{}: aborted: {}", name(*index, *sub), book.abort(node, *code)))
            }
            Self::Stray { data } => ("stray", Look::Notable, format!("fits nothing heard before: {}", bytes(data))),
        };
        let what = if is_request { "SDO →" } else { "SDO ←" };
        Told::new(Some(node), what, look, says, self.json(book, node, step, is_request))
    }

    fn json(&self, book: &Book, node: u8, step: &str, is_request: bool) -> Value {
        let mut json = json!({"step": step, "request": is_request});
        let object = match self {
            Self::Asked { index, sub, .. }
            | Self::Begun { index, sub, .. }
            | Self::Moved { index, sub, .. }
            | Self::Confirmed { index, sub, .. }
            | Self::Done { index, sub, .. }
            | Self::Aborted { index, sub, .. } => Some((*index, *sub)),
            Self::Stray { .. } => None,
        };
        if let Some((index, sub)) = object {
            (json["index"], json["sub"]) = (index.into(), sub.into());
            json["object"] = book.name(node, index, sub).into();
        }
        match self {
            Self::Asked { write, block, size, .. } => {
                (json["write"], json["block"], json["size"]) = ((*write).into(), (*block).into(), (*size).into());
            }
            Self::Begun { write, size, .. } => (json["write"], json["size"]) = ((*write).into(), (*size).into()),
            Self::Moved { len, size, .. } | Self::Confirmed { len, size, .. } => {
                (json["len"], json["size"]) = ((*len).into(), (*size).into());
            }
            Self::Done { write, len, .. } => (json["write"], json["len"]) = ((*write).into(), (*len).into()),
            Self::Aborted { code, .. } => {
                (json["abort_code"], json["abort"]) = (code.0.into(), code.name().into());
            }
            Self::Stray { .. } => {}
        }
        if let (Self::Asked { data: Some(data), .. } | Self::Done { data: Some(data), .. }, Some((index, sub))) =
            (self, object)
        {
            json["value"] = book.show(node, index, sub, data).json;
        }
        json
    }
}
