//! What participants and endpoints say of themselves (8.5, 9.6.2): lists of parameters.

use crate::bytes::{Cursor, Put};
use crate::guid::{Entity, Guid, Prefix};
use crate::qos::{Qos, Reliability};
use crate::wire::{SENTINEL, VERSION};
use alloc::string::String;
use alloc::vec::Vec;
use base::Duration;
use core::net::{Ipv4Addr, SocketAddrV4};

const LEASE: u16 = 0x0002;
const TOPIC_NAME: u16 = 0x0005;
const TYPE_NAME: u16 = 0x0007;
const DOMAIN_ID: u16 = 0x000f;
const PROTOCOL_VERSION: u16 = 0x0015;
const VENDOR_ID: u16 = 0x0016;
const RELIABILITY: u16 = 0x001a;
const LIVELINESS: u16 = 0x001b;
const DURABILITY: u16 = 0x001d;
const OWNERSHIP: u16 = 0x001f;
const DEADLINE: u16 = 0x0023;
const PARTITION: u16 = 0x0029;
const USER_DATA: u16 = 0x002c;
const UNICAST: u16 = 0x002f;
const DEFAULT_UNICAST: u16 = 0x0031;
const METATRAFFIC_UNICAST: u16 = 0x0032;
const HISTORY: u16 = 0x0040;
const PARTICIPANT_GUID: u16 = 0x0050;
const BUILTIN_ENDPOINTS: u16 = 0x0058;
const ENDPOINT_GUID: u16 = 0x005a;
const ENTITY_NAME: u16 = 0x0062;
const DOMAIN_TAG: u16 = 0x4014;
/// Bit of an id: who does not know the parameter must not use the rest (9.6.2.2.1).
const MUST_UNDERSTAND: u16 = 0x4000;

/// Parameters in the sender's byte order, as the encapsulation says: `00 02` or `00 03`.
const BIG: [u8; 2] = [0, 2];
const LITTLE: [u8; 2] = [0, 3];

/// Locators that are kept of a list.
const LOCATORS_MAX: usize = 8;
/// Longest name of a topic or type, bytes.
pub(crate) const NAME_MAX: usize = 256;
/// Kind of a locator: UDP over IPv4.
const UDP_V4: u32 = 1;
/// Built-in endpoints that are there: both ways of the discovery of participants, publications and subscriptions.
const BUILTIN: u32 = 0x3f;
/// Seconds of a duration without end.
const INFINITE_S: i32 = i32::MAX;

/// What a participant says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ParticipantData {
    pub prefix: Prefix,
    pub vendor: [u8; 2],
    pub domain: Option<u32>,
    /// Time after its last sign of life from which it is gone.
    pub lease: Duration,
    pub metatraffic: Vec<SocketAddrV4>,
    pub default: Vec<SocketAddrV4>,
    pub name: String,
    pub user_data: Vec<u8>,
}

/// What an endpoint says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct EndpointData {
    pub guid: Guid,
    pub topic: String,
    pub type_name: String,
    pub qos: Qos,
    /// What its user has others know; of others' endpoints it is not read.
    pub user_data: Vec<u8>,
    /// It asks for what a writer or reader of this implementation does not have: a deadline, liveliness by hand,
    /// exclusive ownership, a partition.
    pub is_special: bool,
    /// Where it is reached, if not where its participant is.
    pub unicast: Vec<SocketAddrV4>,
}

impl ParticipantData {
    pub fn encode(&self) -> Vec<u8> {
        let mut list = List::new();
        list.add(PROTOCOL_VERSION, |to| to.extend_from_slice(&VERSION));
        list.add(VENDOR_ID, |to| to.extend_from_slice(&self.vendor));
        let guid = Guid { prefix: self.prefix, entity: Entity::PARTICIPANT };
        list.add(PARTICIPANT_GUID, |to| to.extend_from_slice(&guid.bytes()));
        list.add(BUILTIN_ENDPOINTS, |to| to.put_u32(BUILTIN));
        if let Some(domain) = self.domain {
            list.add(DOMAIN_ID, |to| to.put_u32(domain));
        }
        list.add(LEASE, |to| duration(to, self.lease));
        self.metatraffic.iter().for_each(|at| list.add(METATRAFFIC_UNICAST, |to| locator(to, *at)));
        self.default.iter().for_each(|at| list.add(DEFAULT_UNICAST, |to| locator(to, *at)));
        list.add(ENTITY_NAME, |to| string(to, &self.name));
        list.add(USER_DATA, |to| octets(to, &self.user_data));
        list.end()
    }

    /// `None`: malformed, of another major version, or of a domain with a tag.
    pub fn decode(payload: &[u8]) -> Option<Self> {
        let mut data = Self {
            prefix: Prefix::default(),
            vendor: [0; 2],
            domain: None,
            lease: Duration::from_secs(100),
            metatraffic: Vec::new(),
            default: Vec::new(),
            name: String::new(),
            user_data: Vec::new(),
        };
        let mut guid = None;
        parameters(payload, |id, mut value| {
            match id {
                PARTICIPANT_GUID => guid = Some(Guid::from_bytes(value.array()?)),
                PROTOCOL_VERSION if value.array::<2>()?[0] != VERSION[0] => return None,
                VENDOR_ID => data.vendor = value.array()?,
                DOMAIN_ID => data.domain = Some(value.u32()?),
                DOMAIN_TAG if !read_string(&mut value)?.is_empty() => return None,
                LEASE => data.lease = read_duration(&mut value)?,
                METATRAFFIC_UNICAST => read_locator(&mut value, &mut data.metatraffic)?,
                DEFAULT_UNICAST => read_locator(&mut value, &mut data.default)?,
                ENTITY_NAME => data.name = read_string(&mut value)?,
                _ => {}
            }
            Some(())
        })?;
        data.prefix = guid.filter(|guid| guid.entity == Entity::PARTICIPANT)?.prefix;
        Some(data)
    }
}

impl EndpointData {
    pub fn encode(&self) -> Vec<u8> {
        let mut list = List::new();
        list.add(ENDPOINT_GUID, |to| to.extend_from_slice(&self.guid.bytes()));
        let participant = Guid { prefix: self.guid.prefix, entity: Entity::PARTICIPANT };
        list.add(PARTICIPANT_GUID, |to| to.extend_from_slice(&participant.bytes()));
        list.add(TOPIC_NAME, |to| string(to, &self.topic));
        list.add(TYPE_NAME, |to| string(to, &self.type_name));
        list.add(RELIABILITY, |to| {
            to.put_u32(if self.qos.reliability == Reliability::Reliable { 2 } else { 1 });
            duration(to, Duration::from_millis(100));
        });
        list.add(DURABILITY, |to| to.put_u32(self.qos.transient_local.into()));
        list.add(HISTORY, |to| {
            to.put_u32(0); // keep last
            to.put_u32(self.qos.depth.into());
        });
        if !self.user_data.is_empty() {
            list.add(USER_DATA, |to| octets(to, &self.user_data));
        }
        list.end()
    }

    /// `None`: malformed, or names that are too long.
    pub fn decode(payload: &[u8]) -> Option<Self> {
        let (mut guid, mut topic, mut type_name) = (None, None, None);
        let mut data = Self {
            guid: Guid::default(),
            topic: String::new(),
            type_name: String::new(),
            qos: Qos { reliability: Reliability::BestEffort, transient_local: false, depth: 1 },
            user_data: Vec::new(),
            is_special: false,
            unicast: Vec::new(),
        };
        let mut has_reliability = false;
        parameters(payload, |id, mut value| {
            match id {
                ENDPOINT_GUID => guid = Some(Guid::from_bytes(value.array()?)),
                TOPIC_NAME => topic = Some(read_string(&mut value)?),
                TYPE_NAME => type_name = Some(read_string(&mut value)?),
                RELIABILITY => {
                    has_reliability = true;
                    let reliable = value.u32()? >= 2;
                    data.qos.reliability = if reliable { Reliability::Reliable } else { Reliability::BestEffort };
                }
                DURABILITY => data.qos.transient_local = value.u32()? >= 1,
                DEADLINE => data.is_special |= value.i32()? != INFINITE_S,
                LIVELINESS => data.is_special |= value.u32()? != 0 || value.i32()? != INFINITE_S,
                OWNERSHIP => data.is_special |= value.u32()? != 0,
                // The partition without a name is where everybody is who names none.
                PARTITION => data.is_special |= value.u32()? != 0 && !read_string(&mut value)?.is_empty(),
                UNICAST => read_locator(&mut value, &mut data.unicast)?,
                _ => {}
            }
            Some(())
        })?;
        (data.guid, data.topic, data.type_name) = (guid?, topic?, type_name?);
        if !has_reliability {
            // What is not said is the default: of writers (kinds 2 and 3) reliable.
            let is_writer = matches!(data.guid.entity.0[3] & 0x0f, 2 | 3);
            data.qos.reliability = if is_writer { Reliability::Reliable } else { Reliability::BestEffort };
        }
        Some(data)
    }
}

/// The key of an endpoint or participant that is gone, as a payload.
pub(crate) fn key(guid: Guid) -> Vec<u8> {
    let id = if guid.entity == Entity::PARTICIPANT { PARTICIPANT_GUID } else { ENDPOINT_GUID };
    let mut list = List::new();
    list.add(id, |to| to.extend_from_slice(&guid.bytes()));
    list.end()
}

/// The GUID of a payload that is a key.
pub(crate) fn key_of(payload: &[u8]) -> Option<Guid> {
    let mut found = None;
    parameters(payload, |id, mut value| {
        if [PARTICIPANT_GUID, ENDPOINT_GUID].contains(&id) {
            found = Some(Guid::from_bytes(value.array()?));
        }
        Some(())
    })?;
    found
}

/// Calls `each` with each parameter; `None` if the list or a parameter is malformed.
fn parameters<'a>(payload: &'a [u8], mut each: impl FnMut(u16, Cursor<'a>) -> Option<()>) -> Option<()> {
    let (encapsulation, rest) = payload.split_at_checked(4)?;
    let little = match encapsulation {
        [a, b, ..] if [*a, *b] == LITTLE => true,
        [a, b, ..] if [*a, *b] == BIG => false,
        _ => return None,
    };
    let mut cursor = Cursor::new(rest, little);
    loop {
        let (id, length) = (cursor.u16()?, cursor.u16()?);
        if id == SENTINEL {
            return Some(());
        }
        let value = cursor.take(length.into())?;
        // That of the domain's tag is part of its number.
        let id = if id == DOMAIN_TAG { id } else { id & !MUST_UNDERSTAND };
        each(id, Cursor::new(value, little))?;
    }
}

fn read_string(value: &mut Cursor<'_>) -> Option<String> {
    let length = value.u32()? as usize;
    let text = value.take(length)?.strip_suffix(&[0])?;
    (text.len() <= NAME_MAX).then_some(())?;
    core::str::from_utf8(text).ok().map(String::from)
}

fn read_duration(value: &mut Cursor<'_>) -> Option<Duration> {
    let (seconds, fraction) = (value.i32()?, value.u32()?);
    let seconds = u64::try_from(seconds).ok()?;
    Some(Duration::new(seconds, ((u64::from(fraction) * 1_000_000_000) >> 32) as u32))
}

fn read_locator(value: &mut Cursor<'_>, to: &mut Vec<SocketAddrV4>) -> Option<()> {
    let (kind, port, address) = (value.u32()?, value.u32()?, value.array::<16>()?);
    let [.., a, b, c, d] = address;
    let ip = Ipv4Addr::new(a, b, c, d);
    let is_usable = kind == UDP_V4 && !ip.is_unspecified() && !ip.is_multicast() && !ip.is_broadcast();
    if let Ok(port @ 1..) = u16::try_from(port)
        && is_usable
        && to.len() < LOCATORS_MAX
    {
        to.push(SocketAddrV4::new(ip, port));
    }
    Some(())
}

struct List(Vec<u8>);

impl List {
    fn new() -> Self {
        let mut bytes = Vec::with_capacity(256);
        bytes.extend_from_slice(&[LITTLE[0], LITTLE[1], 0, 0]);
        Self(bytes)
    }

    fn add(&mut self, id: u16, write: impl FnOnce(&mut Vec<u8>)) {
        self.0.put_u16(id);
        let at = self.0.len();
        self.0.put_u16(0);
        write(&mut self.0);
        self.0.resize(self.0.len().next_multiple_of(4), 0);
        let length = (self.0.len() - at - 2) as u16;
        self.0[at..at + 2].copy_from_slice(&length.to_le_bytes());
    }

    fn end(mut self) -> Vec<u8> {
        self.0.put_u16(SENTINEL);
        self.0.put_u16(0);
        self.0
    }
}

fn string(to: &mut Vec<u8>, text: &str) {
    to.put_u32(text.len() as u32 + 1);
    to.extend_from_slice(text.as_bytes());
    to.push(0);
}

fn octets(to: &mut Vec<u8>, octets: &[u8]) {
    to.put_u32(octets.len() as u32);
    to.extend_from_slice(octets);
}

fn duration(to: &mut Vec<u8>, duration: Duration) {
    to.put_u32(u32::try_from(duration.as_secs()).unwrap_or(u32::MAX));
    to.put_u32(((u64::from(duration.subsec_nanos()) << 32) / 1_000_000_000) as u32);
}

fn locator(to: &mut Vec<u8>, at: SocketAddrV4) {
    to.put_u32(UDP_V4);
    to.put_u32(at.port().into());
    to.extend_from_slice(&[0; 12]);
    to.extend_from_slice(&at.ip().octets());
}
