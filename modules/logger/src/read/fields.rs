//! Fields of a record, from front to back; `None` if it is too short or invalid.

use super::{Attachment, Channel, HEAD, Message, Metadata, Schema};
use std::collections::BTreeMap;

pub struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    pub fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*head)
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Bytes with a length prefix.
    pub fn block(&mut self) -> Option<&'a [u8]> {
        let len = self.u32()?;
        self.bytes(usize::try_from(len).ok()?)
    }

    pub fn text(&mut self) -> Option<&'a str> {
        str::from_utf8(self.block()?).ok()
    }

    fn texts(&mut self) -> Option<BTreeMap<String, String>> {
        let mut block = Fields(self.block()?);
        let mut texts = BTreeMap::new();
        while !block.0.is_empty() {
            texts.insert(block.text()?.to_owned(), block.text()?.to_owned());
        }
        Some(texts)
    }
}

/// Profile and library.
pub fn header(content: &[u8]) -> Option<(String, String)> {
    let mut fields = Fields(content);
    Some((fields.text()?.to_owned(), fields.text()?.to_owned()))
}

pub fn schema(content: &[u8]) -> Option<(u16, Schema)> {
    let mut fields = Fields(content);
    let id = fields.u16().filter(|id| *id != 0)?;
    let (name, encoding) = (fields.text()?.to_owned(), fields.text()?.to_owned());
    Some((id, Schema { name, encoding, data: fields.block()?.to_vec() }))
}

pub fn channel(content: &[u8]) -> Option<(u16, Channel)> {
    let mut fields = Fields(content);
    let (id, schema_id) = (fields.u16()?, fields.u16()?);
    let (topic, encoding) = (fields.text()?.to_owned(), fields.text()?.to_owned());
    Some((id, Channel { schema_id, topic, encoding, metadata: fields.texts()? }))
}

pub fn message(content: &[u8]) -> Option<Message<'_>> {
    let mut fields = Fields(content);
    let (channel, sequence) = (fields.u16()?, fields.u32()?);
    Some(Message { channel, sequence, log_time: fields.u64()?, publish_time: fields.u64()?, data: fields.0 })
}

pub fn metadata(content: &[u8], offset: u64) -> Option<Metadata> {
    let mut fields = Fields(content);
    let name = fields.text()?.to_owned();
    Some(Metadata { name, values: fields.texts()?, offset, length: HEAD + content.len() as u64 })
}

/// Parses an attachment from the head of its record, whose content is `length` bytes long and mostly not needed.
pub fn attachment(head: &[u8], offset: u64, length: u64) -> Option<Attachment> {
    let mut fields = Fields(head);
    let (log_time, create_time) = (fields.u64()?, fields.u64()?);
    let (name, media_type) = (fields.text()?.to_owned(), fields.text()?.to_owned());
    let data_len = fields.u64()?;
    let before = (head.len() - fields.0.len()) as u64;
    let whole = before.checked_add(data_len)?.checked_add(4)? == length;
    let data_offset = offset + HEAD + before;
    let length = HEAD + length;
    whole.then_some(Attachment { log_time, create_time, name, media_type, offset, length, data_offset, data_len })
}
