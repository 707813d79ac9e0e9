//! MCAP logs: index, reader, recovery.

use logger::read::{Channel, Filter, Index, MAGIC, Messages, Schema};
use logger::recover::{Sealed, recover, seal};
use std::io::Cursor;
use std::sync::Arc;

type Line = (u16, u32, u64, Vec<u8>);

fn lines(file: &[u8]) -> (Index, Vec<Line>) {
    let index = Index::read(Cursor::new(file), &mut |_, _| {}).expect("memory does not fail");
    let all = |_: &Channel, _: Option<&Schema>| true;
    let filter = Filter { from: 0, to: u64::MAX, wants: &all };
    let mut messages = Messages::new(vec![(Cursor::new(file), Arc::new(index.clone()))], &filter);
    let mut lines = Vec::new();
    while let Some(entry) = messages.next_entry().expect("memory does not fail") {
        let message = entry.message;
        lines.push((message.channel, message.sequence, message.log_time, message.data.to_vec()));
    }
    lines.sort();
    (index, lines)
}

fn record(opcode: u8, content: &[u8], out: &mut Vec<u8>) {
    out.push(opcode);
    out.extend((content.len() as u64).to_le_bytes());
    out.extend(content);
}

fn message(channel: u16, time: u64, data: &[u8], out: &mut Vec<u8>) {
    let mut content = channel.to_le_bytes().to_vec();
    content.extend([0; 4]);
    content.extend(time.to_le_bytes());
    content.extend(time.to_le_bytes());
    content.extend(data);
    record(5, &content, out);
}

/// An MCAP file: whole, or made of correct, damaged and arbitrary records, and cut off anywhere.
///
/// A recovered log has an index and the messages that the damaged one had; recovering it again loses none.
pub fn logs(data: &[u8]) {
    if data.starts_with(MAGIC) {
        return check(data);
    }
    let Some(input) = crate::input::<(Vec<(u8, u16, u64, &[u8])>, u16, bool)>(data) else { return };
    let (pieces, cut, begin) = input;
    let mut file = if begin { MAGIC.to_vec() } else { Vec::new() };
    if begin {
        record(1, &[0; 8], &mut file);
    }
    for &(what, channel, time, data) in &pieces {
        match what % 6 {
            0 => file.extend(data),
            1 => record(what, data, &mut file),
            2 => message(channel, time, data, &mut file),
            3 => {
                let mut content = channel.to_le_bytes().to_vec();
                content.extend([0; 14]);
                record(4, &content, &mut file);
            }
            // A chunk, with a check that holds or not.
            4 | 5 => {
                let mut records = Vec::new();
                message(channel, time, data, &mut records);
                message(channel ^ 1, time / 2, data, &mut records);
                let crc = crc32fast::hash(&records) ^ u32::from(what % 6 == 5);
                let mut content = Vec::new();
                content.extend((time / 2).to_le_bytes());
                content.extend(time.to_le_bytes());
                content.extend((records.len() as u64).to_le_bytes());
                content.extend(crc.to_le_bytes());
                content.extend(0_u32.to_le_bytes());
                content.extend((records.len() as u64).to_le_bytes());
                content.extend(records);
                record(6, &content, &mut file);
            }
            _ => {}
        }
    }
    file.truncate(file.len().saturating_sub(usize::from(cut)));
    check(&file);
}

fn check(file: &[u8]) {
    let (index, before) = lines(file);
    let mut new = Vec::new();
    let report = recover(Cursor::new(file), &mut new, &mut |_, _| {}).expect("memory does not fail");
    let (again, after) = lines(&new);
    assert!(again.indexed && again.damage.is_none());
    assert_eq!(report.messages, after.len() as u64);
    if !index.indexed {
        assert_eq!(before, after);
    }
    let mut sealed = Cursor::new(file.to_vec());
    match seal(&mut sealed, &mut |_, _| {}).expect("memory does not fail") {
        Sealed::Sealed(report) => {
            let mut bytes = sealed.into_inner();
            bytes.truncate(report.written as usize);
            let (index, there) = lines(&bytes);
            assert!(index.indexed);
            assert_eq!(there, after);
        }
        Sealed::Whole | Sealed::Damaged(_) => assert_eq!(sealed.into_inner(), file),
    }
}
