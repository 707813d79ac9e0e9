//! Encoding of requests to a folder of log files, and their answers.

use super::Malformed;
use super::wire::{self, Decoder};
use base::store::{Answer, Entry, Request, Trouble};
use std::sync::Arc;

const CREATE: u8 = 0;
const APPEND: u8 = 1;
const REMOVE: u8 = 2;
const LIST: u8 = 3;

const DONE: u8 = 0;
const LISTED: u8 = 1;
const FULL: u8 = 2;
const READ_ONLY: u8 = 3;
const OTHER: u8 = 4;

pub(super) fn request(out: &mut Vec<u8>, request: &Request) {
    match request {
        Request::Create { name } => {
            out.push(CREATE);
            wire::text(out, name);
        }
        Request::Append { bytes, sync } => {
            out.extend([APPEND, u8::from(*sync)]);
            wire::bytes(out, bytes);
        }
        Request::Remove { name } => {
            out.push(REMOVE);
            wire::text(out, name);
        }
        Request::List => out.push(LIST),
    }
}

pub(super) fn take_request(take: &mut Decoder<'_>) -> Result<Request, Malformed> {
    Ok(match take.u8()? {
        CREATE => Request::Create { name: take.text()?.into() },
        APPEND => {
            let sync = take.flag()?;
            Request::Append { bytes: Arc::new(take.bytes()?.to_vec()), sync }
        }
        REMOVE => Request::Remove { name: take.text()?.into() },
        LIST => Request::List,
        _ => return Err(Malformed("a request to a folder")),
    })
}

pub(super) fn answer(out: &mut Vec<u8>, answer: &Answer) {
    match answer {
        Answer::Done { free } => {
            out.push(DONE);
            wire::varint(out, *free);
        }
        Answer::Listed { entries, free } => {
            out.push(LISTED);
            wire::varint(out, *free);
            wire::varint(out, entries.len() as u64);
            for Entry { name, bytes } in entries {
                wire::text(out, name);
                wire::varint(out, *bytes);
            }
        }
        Answer::Failed(Trouble::Full) => out.push(FULL),
        Answer::Failed(Trouble::ReadOnly) => out.push(READ_ONLY),
        Answer::Failed(Trouble::Other(why)) => {
            out.push(OTHER);
            wire::text(out, why);
        }
    }
}

pub(super) fn take_answer(take: &mut Decoder<'_>) -> Result<Answer, Malformed> {
    Ok(match take.u8()? {
        DONE => Answer::Done { free: take.varint()? },
        LISTED => {
            let free = take.varint()?;
            let mut entries = Vec::new();
            for _ in 0..take.count()? {
                entries.push(Entry { name: take.text()?.into(), bytes: take.varint()? });
            }
            Answer::Listed { entries, free }
        }
        FULL => Answer::Failed(Trouble::Full),
        READ_ONLY => Answer::Failed(Trouble::ReadOnly),
        OTHER => Answer::Failed(Trouble::Other(take.text()?.into())),
        _ => return Err(Malformed("an answer of a folder")),
    })
}
