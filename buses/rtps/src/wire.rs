//! Messages and submessages: layout only, no state (8.3.7, 9.4.5).

use crate::bytes::{Cursor, Put};
use crate::guid::{Entity, Guid, Prefix, SampleIdentity};
use alloc::vec::Vec;

/// Length of a message's header, bytes.
const HEADER_LEN: usize = 20;
/// Version of the protocol that is announced.
pub(crate) const VERSION: [u8; 2] = [2, 3];
/// No vendor: none is registered for this implementation.
pub(crate) const VENDOR: [u8; 2] = [0, 0];
/// Longest sample that is sent as a whole, and length of the fragments of longer ones, bytes.
pub(crate) const FRAGMENT: u16 = 8192;
/// Numbers that a set may span (9.4.2.6).
pub(crate) const SET_MAX: u32 = 256;

const PAD: u8 = 0x01;
const ACKNACK: u8 = 0x06;
const HEARTBEAT: u8 = 0x07;
const GAP: u8 = 0x08;
const INFO_TIMESTAMP: u8 = 0x09;
const INFO_SOURCE: u8 = 0x0c;
const INFO_DESTINATION: u8 = 0x0e;
const NACK_FRAG: u8 = 0x12;
const DATA: u8 = 0x15;
const DATA_FRAG: u8 = 0x16;

/// Parameters in front of a sample.
const STATUS_INFO: u16 = 0x0071;
const KEY_HASH: u16 = 0x0070;
/// Identity of the request that a sample answers (DDS-RPC 1.0, 7.8.2), and the number that Fast DDS had for it before,
/// which its older releases know alone. Newer ones write both.
const RELATED_SAMPLE_IDENTITY: u16 = 0x0083;
const RELATED_SAMPLE_IDENTITY_FAST_DDS: u16 = 0x800f;
/// Length of an identity, bytes: GUID and sequence number.
const IDENTITY_LEN: u16 = 24;
pub(crate) const SENTINEL: u16 = 0x0001;
/// Bits of a status: the instance is disposed, or unregistered.
const STATUS_GONE: u8 = 3;

/// Numbers out of at most 256 successive ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Set {
    pub base: i64,
    count: u32,
    words: [u32; 8],
}

impl Set {
    /// None, from `base` on.
    pub fn empty(base: i64) -> Self {
        Self { base, count: 0, words: [0; 8] }
    }

    /// All from `base` to `last`, as far as a set reaches.
    pub fn span(base: i64, last: i64) -> Self {
        let count = (last - base + 1).clamp(0, i64::from(SET_MAX)) as u32;
        let mut words = [0; 8];
        for n in 0..count {
            words[(n / 32) as usize] |= 1 << (31 - n % 32);
        }
        Self { base, count, words }
    }

    pub fn is_empty(&self) -> bool {
        self.words == [0; 8]
    }

    pub fn iter(&self) -> impl Iterator<Item = i64> + '_ {
        let has = |n: &u32| self.words[(n / 32) as usize] & (1 << (31 - n % 32)) != 0;
        (0..self.count).filter(has).map(|n| self.base.saturating_add(i64::from(n)))
    }

    fn read(cursor: &mut Cursor<'_>, base: i64) -> Option<Self> {
        let count = cursor.u32()?;
        if count > SET_MAX || base < 0 {
            return None;
        }
        let mut words = [0; 8];
        for word in words.iter_mut().take(count.div_ceil(32) as usize) {
            *word = cursor.u32()?;
        }
        // Bits behind the last one mean nothing.
        for (n, word) in words.iter_mut().enumerate() {
            let valid = count.saturating_sub(32 * n as u32).min(32);
            *word &= u32::MAX.checked_shl(32 - valid).unwrap_or(0);
        }
        Some(Self { base, count, words })
    }

    fn write(&self, to: &mut Vec<u8>) {
        to.put_u32(self.count);
        self.words.iter().take(self.count.div_ceil(32) as usize).for_each(|word| to.put_u32(*word));
    }
}

/// A sample, or the end of an instance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Data<'a> {
    pub reader: Entity,
    pub writer: Entity,
    pub number: i64,
    pub payload: &'a [u8],
    /// Disposed or unregistered: the payload is the key, or empty.
    pub gone: bool,
    /// Key by its hash, which for endpoints and participants is the GUID.
    pub key: Option<Guid>,
    /// The sample that it answers.
    pub related: Option<SampleIdentity>,
}

/// Fragments of a sample.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DataFrag<'a> {
    pub reader: Entity,
    pub writer: Entity,
    pub number: i64,
    /// The first fragment's number, from 1.
    pub first: u32,
    /// Length of each fragment but the sample's last one, bytes.
    pub size: u16,
    /// Length of the whole sample, bytes.
    pub sample: u32,
    pub payload: &'a [u8],
    /// The sample that it answers.
    pub related: Option<SampleIdentity>,
}

/// Which samples a writer has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Heartbeat {
    pub reader: Entity,
    pub writer: Entity,
    pub first: i64,
    pub last: i64,
    pub count: i32,
    pub is_final: bool,
}

/// Which samples a reader has, and which it lacks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AckNack {
    pub reader: Entity,
    pub writer: Entity,
    pub missing: Set,
    pub count: i32,
    pub is_final: bool,
}

/// Which fragments of a sample a reader lacks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NackFrag {
    pub reader: Entity,
    pub writer: Entity,
    pub number: i64,
    pub missing: Set,
}

/// Samples that will not come: from `start` to before the base of `more`, and those of `more`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gap {
    pub reader: Entity,
    pub writer: Entity,
    pub start: i64,
    pub more: Set,
}

/// Part of a message.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Submessage<'a> {
    Source(Prefix),
    Destination(Prefix),
    Data(Data<'a>),
    DataFrag(DataFrag<'a>),
    Heartbeat(Heartbeat),
    AckNack(AckNack),
    NackFrag(NackFrag),
    Gap(Gap),
    /// Of no consequence here: times, padding, what newer versions add.
    Other,
}

/// Submessages of a message. The first malformed one ends it, as an error (8.3.4.1).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Submessages<'a> {
    rest: &'a [u8],
}

/// The submessages of a datagram and its sender; `None`: it is no RTPS.
pub(crate) fn parse(datagram: &[u8]) -> Option<(Prefix, Submessages<'_>)> {
    let (header, rest) = datagram.split_at_checked(HEADER_LEN)?;
    let prefix = header[8..].try_into().ok()?;
    (header.starts_with(b"RTPS") && header[4] == VERSION[0]).then_some((Prefix(prefix), Submessages { rest }))
}

impl<'a> Iterator for Submessages<'a> {
    /// `Err`: malformed.
    type Item = Result<Submessage<'a>, ()>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let read = self.read();
        if read.is_none() {
            self.rest = &[];
        }
        Some(read.ok_or(()))
    }
}

impl<'a> Submessages<'a> {
    fn read(&mut self) -> Option<Submessage<'a>> {
        let [id, flags] = *self.rest.first_chunk()?;
        let mut cursor = Cursor::new(self.rest.get(2..)?, flags & 1 != 0);
        let length = usize::from(cursor.u16()?);
        // The last one may reach to the end.
        let length = if length == 0 && ![PAD, INFO_TIMESTAMP].contains(&id) { cursor.data.len() } else { length };
        let body = cursor.take(length)?;
        self.rest = cursor.data;
        submessage(id, flags, Cursor::new(body, cursor.little))
    }
}

fn submessage(id: u8, flags: u8, mut body: Cursor<'_>) -> Option<Submessage<'_>> {
    let is = |bit: u8| flags & bit != 0;
    Some(match id {
        DATA => Submessage::Data(data(flags, body)?),
        DATA_FRAG => Submessage::DataFrag(data_frag(flags, body)?),
        HEARTBEAT => {
            let (reader, writer) = (Entity(body.array()?), Entity(body.array()?));
            let (first, last) = (body.sequence()?, body.sequence()?);
            let count = body.i32()?;
            let valid = first > 0 && last >= first - 1;
            Submessage::Heartbeat(valid.then_some(Heartbeat { reader, writer, first, last, count, is_final: is(2) })?)
        }
        ACKNACK => {
            let (reader, writer) = (Entity(body.array()?), Entity(body.array()?));
            let base = body.sequence()?;
            let missing = Set::read(&mut body, base)?;
            Submessage::AckNack(AckNack { reader, writer, missing, count: body.i32()?, is_final: is(2) })
        }
        NACK_FRAG => {
            let (reader, writer) = (Entity(body.array()?), Entity(body.array()?));
            let number = body.sequence()?;
            let base = body.u32()?.into();
            Submessage::NackFrag(NackFrag { reader, writer, number, missing: Set::read(&mut body, base)? })
        }
        GAP => {
            let (reader, writer) = (Entity(body.array()?), Entity(body.array()?));
            let start = body.sequence()?;
            let base = body.sequence()?;
            let more = Set::read(&mut body, base)?;
            Submessage::Gap((start > 0 && base >= start).then_some(Gap { reader, writer, start, more })?)
        }
        INFO_SOURCE => {
            body.take(8)?;
            Submessage::Source(Prefix(body.array()?))
        }
        INFO_DESTINATION => Submessage::Destination(Prefix(body.array()?)),
        _ => Submessage::Other,
    })
}

fn data(flags: u8, mut body: Cursor<'_>) -> Option<Data<'_>> {
    body.take(2)?;
    let skip = usize::from(body.u16()?);
    let mut fixed = Cursor::new(body.take(skip)?, body.little);
    let (reader, writer, number) = (Entity(fixed.array()?), Entity(fixed.array()?), fixed.sequence()?);
    let InlineQos { gone, key, related } = if flags & 2 != 0 { inline_qos(&mut body)? } else { InlineQos::default() };
    let (has_data, has_key) = (flags & 4 != 0, flags & 8 != 0);
    let payload = if has_data || has_key { body.data } else { &[] };
    let gone = gone || (has_key && !has_data);
    (number > 0).then_some(Data { reader, writer, number, payload, gone, key, related })
}

fn data_frag(flags: u8, mut body: Cursor<'_>) -> Option<DataFrag<'_>> {
    body.take(2)?;
    let skip = usize::from(body.u16()?);
    let mut fixed = Cursor::new(body.take(skip)?, body.little);
    let (reader, writer, number) = (Entity(fixed.array()?), Entity(fixed.array()?), fixed.sequence()?);
    let (first, _count, size, sample) = (fixed.u32()?, fixed.u16()?, fixed.u16()?, fixed.u32()?);
    let related = if flags & 2 != 0 { inline_qos(&mut body)?.related } else { None };
    let valid = number > 0 && first > 0 && size > 0 && sample > 0;
    valid.then_some(DataFrag { reader, writer, number, first, size, sample, payload: body.data, related })
}

#[derive(Default)]
struct InlineQos {
    gone: bool,
    key: Option<Guid>,
    related: Option<SampleIdentity>,
}

fn inline_qos(body: &mut Cursor<'_>) -> Option<InlineQos> {
    let mut found = InlineQos::default();
    loop {
        let (id, length) = (body.u16()?, body.u16()?);
        if id == SENTINEL {
            return Some(found);
        }
        let value = body.take(length.into())?;
        match id {
            STATUS_INFO => found.gone = value.get(3).is_some_and(|bits| bits & STATUS_GONE != 0),
            KEY_HASH => found.key = value.try_into().ok().map(Guid::from_bytes),
            RELATED_SAMPLE_IDENTITY | RELATED_SAMPLE_IDENTITY_FAST_DDS => {
                let mut value = Cursor::new(value, body.little);
                let identity = value.array().map(Guid::from_bytes).zip(value.sequence());
                let identity = identity.map(|(writer, number)| SampleIdentity { writer, number });
                // Both say the same; one that is too short says nothing.
                found.related = found.related.or(identity);
            }
            _ => {}
        }
    }
}

/// Message that is put together.
pub(crate) struct Builder(Vec<u8>);

impl Builder {
    pub fn new(from: Prefix) -> Self {
        let mut bytes = Vec::with_capacity(128);
        bytes.extend_from_slice(b"RTPS");
        bytes.extend_from_slice(&VERSION);
        bytes.extend_from_slice(&VENDOR);
        bytes.extend_from_slice(&from.0);
        Self(bytes)
    }

    /// A message for one participant.
    pub fn to(from: Prefix, to: Prefix) -> Self {
        let mut message = Self::new(from);
        message.submessage(INFO_DESTINATION, 0, |body| body.extend_from_slice(&to.0));
        message
    }

    pub fn build(self) -> Vec<u8> {
        self.0
    }

    fn submessage(&mut self, id: u8, flags: u8, write: impl FnOnce(&mut Vec<u8>)) {
        // It begins at a multiple of four.
        let padding = self.0.len().next_multiple_of(4);
        self.0.resize(padding, 0);
        let start = self.0.len();
        self.0.extend_from_slice(&[id, flags | 1, 0, 0]);
        write(&mut self.0);
        // One that is longer is the last one, and reaches to the end.
        let length = u16::try_from(self.0.len() - start - 4).unwrap_or_default().to_le_bytes();
        self.0[start + 2..start + 4].copy_from_slice(&length);
    }

    /// Time of what follows, µs since the UNIX epoch.
    pub fn timestamp(&mut self, micros: i64) {
        self.submessage(INFO_TIMESTAMP, 0, |body| {
            body.put_u32(micros.div_euclid(1_000_000) as u32);
            body.put_u32(((micros.rem_euclid(1_000_000) as u64) << 32).div_ceil(1_000_000) as u32);
        });
    }

    /// A whole sample, with the one that it answers.
    pub fn data(
        &mut self,
        reader: Entity,
        writer: Entity,
        number: i64,
        related: Option<SampleIdentity>,
        payload: &[u8],
    ) {
        self.submessage(DATA, 4 | inline_flag(related), |body| {
            body.put_u16(0);
            body.put_u16(16);
            ends(body, reader, writer);
            body.put_sequence(number);
            answers(body, related);
            body.extend_from_slice(payload);
            body.resize(body.len().next_multiple_of(4), 0);
        });
    }

    /// The end of an instance, with its key as the payload.
    pub fn disposed(&mut self, writer: Entity, number: i64, key: &[u8]) {
        self.submessage(DATA, 2 | 8, |body| {
            body.put_u16(0);
            body.put_u16(16);
            ends(body, Entity::UNKNOWN, writer);
            body.put_sequence(number);
            body.put_u16(STATUS_INFO);
            body.put_u16(4);
            body.extend_from_slice(&[0, 0, 0, STATUS_GONE]);
            body.put_u16(SENTINEL);
            body.put_u16(0);
            body.extend_from_slice(key);
        });
    }

    /// The fragment `n`, from 0, of a sample that is divided into fragments of [`FRAGMENT`] bytes.
    pub fn fragment(
        &mut self,
        reader: Entity,
        writer: Entity,
        (number, n): (i64, usize),
        related: Option<SampleIdentity>,
        sample: &[u8],
    ) {
        let at = n * usize::from(FRAGMENT);
        let payload = &sample[at.min(sample.len())..(at + usize::from(FRAGMENT)).min(sample.len())];
        self.submessage(DATA_FRAG, inline_flag(related), |body| {
            body.put_u16(0);
            body.put_u16(28);
            ends(body, reader, writer);
            body.put_sequence(number);
            body.put_u32(n as u32 + 1);
            body.put_u16(1);
            body.put_u16(FRAGMENT);
            body.put_u32(sample.len() as u32);
            answers(body, related);
            body.extend_from_slice(payload);
            body.resize(body.len().next_multiple_of(4), 0);
        });
    }

    pub fn heartbeat(&mut self, heartbeat: &Heartbeat) {
        let Heartbeat { reader, writer, first, last, count, is_final } = *heartbeat;
        self.submessage(HEARTBEAT, if is_final { 2 } else { 0 }, |body| {
            ends(body, reader, writer);
            body.put_sequence(first);
            body.put_sequence(last);
            body.put_u32(count.cast_unsigned());
        });
    }

    pub fn acknack(&mut self, acknack: &AckNack) {
        let AckNack { reader, writer, missing, count, is_final } = *acknack;
        self.submessage(ACKNACK, if is_final { 2 } else { 0 }, |body| {
            ends(body, reader, writer);
            body.put_sequence(missing.base);
            missing.write(body);
            body.put_u32(count.cast_unsigned());
        });
    }

    /// The samples from `start` to before `end` will not come.
    pub fn gap(&mut self, reader: Entity, writer: Entity, start: i64, end: i64) {
        self.submessage(GAP, 0, |body| {
            ends(body, reader, writer);
            body.put_sequence(start);
            body.put_sequence(end);
            Set::empty(end).write(body);
        });
    }
}

fn ends(body: &mut Vec<u8>, reader: Entity, writer: Entity) {
    body.extend_from_slice(&reader.0);
    body.extend_from_slice(&writer.0);
}

/// Flag of a submessage that has parameters in front of its sample.
fn inline_flag(related: Option<SampleIdentity>) -> u8 {
    if related.is_some() { 2 } else { 0 }
}

/// The parameters in front of an answer.
fn answers(body: &mut Vec<u8>, related: Option<SampleIdentity>) {
    let Some(SampleIdentity { writer, number }) = related else { return };
    for id in [RELATED_SAMPLE_IDENTITY, RELATED_SAMPLE_IDENTITY_FAST_DDS] {
        body.put_u16(id);
        body.put_u16(IDENTITY_LEN);
        body.extend_from_slice(&writer.bytes());
        body.put_sequence(number);
    }
    body.put_u16(SENTINEL);
    body.put_u16(0);
}
