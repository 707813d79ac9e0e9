//! What stands on the wire in LSS: always eight bytes, the first of which is the command specifier; numbers are little
//! endian, unused bytes 0 (CiA 305 v3.0, 6). Requests carry identifier 0x7E5, responses 0x7E4.

use super::{Mode, Part};
use crate::wire::Service;
use base::can::Frame;
use base::listed;

const SWITCH_GLOBAL: u8 = 0x04;
const NODE_ID: u8 = 0x11;
const BIT_TIMING: u8 = 0x13;
const ACTIVATE: u8 = 0x15;
const STORE: u8 = 0x17;
const SELECT: u8 = 0x40; // and the three after it
const SELECTED: u8 = 0x44;
const IDENTIFY: u8 = 0x46; // and the five after it
const IDENTIFY_NON_CONFIGURED: u8 = 0x4C;
const IDENTIFIED: u8 = 0x4F;
const NON_CONFIGURED: u8 = 0x50;
const FAST_SCAN: u8 = 0x51;
const INQUIRE: u8 = 0x5A; // and the three after it
const INQUIRE_NODE_ID: u8 = 0x5E;

listed! {
    /// What one frame of "identify remote slave" asks of an address; a slave that meets all six in this order answers.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[repr(u8)]
    pub enum Bound {
        /// This vendor.
        Vendor,
        /// This product.
        Product,
        /// This revision or a higher one.
        RevisionLow,
        /// This revision or a lower one.
        RevisionHigh,
        /// This serial number or a higher one.
        SerialLow,
        /// This serial number or a lower one.
        SerialHigh,
    }
}

/// One question of a fastscan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FastScan {
    /// What the word is compared with.
    pub number: u32,
    /// 0 to 31: its bits from here up are compared. [`Self::RESET`]: nothing is, a new scan begins.
    pub bit_check: u8,
    /// Which word, 0 to 3: only slaves that are at it answer.
    pub sub: u8,
    /// Which word slaves that answer are at then. Less than `sub`, with bit check 0: they enter configuration.
    pub next: u8,
}

impl FastScan {
    /// The bit check that begins a scan.
    pub const RESET: u8 = 0x80;
}

/// From the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs)] // the names are those of the standard
pub enum Request {
    /// All slaves; not answered.
    SwitchGlobal(Mode),
    /// Four of these choose a slave; it answers the last.
    Select {
        part: Part,
        number: u32,
    },
    /// 1 to 127, or [`super::UNCONFIGURED`].
    SetNodeId(u8),
    /// Table 0 is CiA 301's.
    SetBitTiming {
        table: u8,
        index: u8,
    },
    /// Not answered.
    Activate {
        delay_ms: u16,
    },
    Store,
    Inquire(Part),
    InquireNodeId,
    Identify {
        bound: Bound,
        number: u32,
    },
    IdentifyNonConfigured,
    FastScan(FastScan),
}

/// How a setting went: 0 is well; 255: `specific` tells more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[allow(missing_docs)]
pub struct Confirm {
    pub error: u8,
    pub specific: u8,
}

/// From a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs)] // each answers the request of its name
pub enum Response {
    Selected,
    NodeIdSet(Confirm),
    BitTimingSet(Confirm),
    Stored(Confirm),
    Inquired {
        part: Part,
        number: u32,
    },
    NodeId(u8),
    /// To a fastscan too.
    Identified,
    NonConfigured,
}

fn short(specifier: u8, [a, b]: [u8; 2]) -> [u8; 8] {
    [specifier, a, b, 0, 0, 0, 0, 0]
}

fn long(specifier: u8, number: u32, [e, f, g]: [u8; 3]) -> [u8; 8] {
    let [a, b, c, d] = number.to_le_bytes();
    [specifier, a, b, c, d, e, f, g]
}

fn number(data: &[u8; 8]) -> u32 {
    u32::from_le_bytes([data[1], data[2], data[3], data[4]])
}

impl Request {
    /// The data of the frame.
    #[must_use]
    pub fn encode(self) -> [u8; 8] {
        match self {
            Self::SwitchGlobal(mode) => short(SWITCH_GLOBAL, [mode as u8, 0]),
            Self::Select { part, number } => long(SELECT + part as u8, number, [0; 3]),
            Self::SetNodeId(id) => short(NODE_ID, [id, 0]),
            Self::SetBitTiming { table, index } => short(BIT_TIMING, [table, index]),
            Self::Activate { delay_ms } => short(ACTIVATE, delay_ms.to_le_bytes()),
            Self::Store => short(STORE, [0; 2]),
            Self::Inquire(part) => short(INQUIRE + part as u8, [0; 2]),
            Self::InquireNodeId => short(INQUIRE_NODE_ID, [0; 2]),
            Self::Identify { bound, number } => long(IDENTIFY + bound as u8, number, [0; 3]),
            Self::IdentifyNonConfigured => short(IDENTIFY_NON_CONFIGURED, [0; 2]),
            Self::FastScan(FastScan { number, bit_check, sub, next }) => {
                long(FAST_SCAN, number, [bit_check, sub, next])
            }
        }
    }

    /// From the data of a frame; `None` when it is no request.
    #[must_use]
    pub fn decode(data: &[u8]) -> Option<Self> {
        let data: &[u8; 8] = data.try_into().ok()?;
        let number = number(data);
        Some(match data[0] {
            SWITCH_GLOBAL => Self::SwitchGlobal(match data[1] {
                0 => Mode::Waiting,
                1 => Mode::Configuration,
                _ => return None,
            }),
            NODE_ID => Self::SetNodeId(data[1]),
            BIT_TIMING => Self::SetBitTiming { table: data[1], index: data[2] },
            ACTIVATE => Self::Activate { delay_ms: u16::from_le_bytes([data[1], data[2]]) },
            STORE => Self::Store,
            at @ SELECT..SELECTED => Self::Select { part: Part::ALL[usize::from(at - SELECT)], number },
            at @ IDENTIFY..IDENTIFY_NON_CONFIGURED => {
                Self::Identify { bound: Bound::ALL[usize::from(at - IDENTIFY)], number }
            }
            IDENTIFY_NON_CONFIGURED => Self::IdentifyNonConfigured,
            FAST_SCAN => Self::FastScan(FastScan { number, bit_check: data[5], sub: data[6], next: data[7] }),
            at @ INQUIRE..INQUIRE_NODE_ID => Self::Inquire(Part::ALL[usize::from(at - INQUIRE)]),
            INQUIRE_NODE_ID => Self::InquireNodeId,
            _ => return None,
        })
    }

    /// As a frame.
    #[must_use]
    pub fn frame(self) -> Frame {
        Frame::standard(Service::LssRequest.cob_id(), &self.encode())
    }
}

impl Response {
    /// The data of the frame.
    #[must_use]
    pub fn encode(self) -> [u8; 8] {
        let confirm = |specifier, Confirm { error, specific }| short(specifier, [error, specific]);
        match self {
            Self::Selected => short(SELECTED, [0; 2]),
            Self::NodeIdSet(how) => confirm(NODE_ID, how),
            Self::BitTimingSet(how) => confirm(BIT_TIMING, how),
            Self::Stored(how) => confirm(STORE, how),
            Self::Inquired { part, number } => long(INQUIRE + part as u8, number, [0; 3]),
            Self::NodeId(id) => short(INQUIRE_NODE_ID, [id, 0]),
            Self::Identified => short(IDENTIFIED, [0; 2]),
            Self::NonConfigured => short(NON_CONFIGURED, [0; 2]),
        }
    }

    /// From the data of a frame; `None` when it is no response.
    #[must_use]
    pub fn decode(data: &[u8]) -> Option<Self> {
        let data: &[u8; 8] = data.try_into().ok()?;
        let how = Confirm { error: data[1], specific: data[2] };
        Some(match data[0] {
            SELECTED => Self::Selected,
            NODE_ID => Self::NodeIdSet(how),
            BIT_TIMING => Self::BitTimingSet(how),
            STORE => Self::Stored(how),
            at @ INQUIRE..INQUIRE_NODE_ID => {
                Self::Inquired { part: Part::ALL[usize::from(at - INQUIRE)], number: number(data) }
            }
            INQUIRE_NODE_ID => Self::NodeId(data[1]),
            IDENTIFIED => Self::Identified,
            NON_CONFIGURED => Self::NonConfigured,
            _ => return None,
        })
    }

    /// As a frame.
    #[must_use]
    pub fn frame(self) -> Frame {
        Frame::standard(Service::LssResponse.cob_id(), &self.encode())
    }
}
