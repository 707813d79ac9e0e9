//! Configuration of a master and its nodes.

use crate::sdo;
use crate::write::ConfigWrite;
use alloc::string::String;
use alloc::vec::Vec;
use base::Duration;
use core::fmt;

/// A master's own parameters.
#[derive(Clone, Debug)]
pub struct MasterConfig {
    /// Node id, 1..=127; default 127.
    pub id: u8,
    /// Bits per second of the bus, at least 1; default 1 000 000. SDO frames are handed out no faster than it takes
    /// them, so that a set-point never waits behind many.
    pub bit_rate: u32,
    /// Period of its heartbeat, at least 1 ms; default 50 ms.
    pub heartbeat: Duration,
    /// Period of SYNC; default none.
    pub sync: Option<Duration>,
    /// Up to what SYNC counts, 2..=240 (0x1019); default none: it carries no counter.
    pub sync_overflow: Option<u8>,
    /// Period of TIME, at least 1 ms; default none. It begins with [`Master::set_time`](super::Master::set_time).
    pub time: Option<Duration>,
    /// True if no node is started before all mandatory ones are configured; default false.
    pub together: bool,
    /// Frames per second, averaged over 100 ms, from which a node counts as babbling; default 1000. Answers to our own
    /// requests do not count.
    pub babbling: u32,
    /// Share of the bus in percent from which a node is called babbling, however few its frames; default 30.
    pub babbling_share: u8,
    /// Time limit of an SDO answer; default 500 ms.
    pub sdo_timeout: Duration,
    /// Immediate retries of an unanswered boot-up step; default 2.
    pub sdo_retries: u8,
    /// Rest between two attempts to boot a node; default 1 s.
    pub retry: Duration,
    /// True if the bus returns own frames (UDP multicast does, SocketCAN does not); default false. Each frame of our
    /// own may then come back once before a second master is reported.
    pub own_frames_return: bool,
    /// Series of its tickets; default 0. Masters of several buses whose tickets are kept together have one each.
    pub tickets: u8,
}

impl Default for MasterConfig {
    fn default() -> Self {
        Self {
            id: 127,
            bit_rate: 1_000_000,
            heartbeat: Duration::from_millis(50),
            sync: None,
            sync_overflow: None,
            time: None,
            together: false,
            babbling: 1000,
            babbling_share: 30,
            sdo_timeout: sdo::TIMEOUT,
            sdo_retries: 2,
            retry: Duration::from_secs(1),
            own_frames_return: false,
            tickets: 0,
        }
    }
}

/// Required value of an object before a node is configured: `min <= value & mask <= max`, unsigned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Expect {
    /// The object's index.
    pub index: u16,
    /// The object's sub-index.
    pub sub: u8,
    /// The bits that count.
    pub mask: u32,
    /// The least value.
    pub min: u32,
    /// The greatest value.
    pub max: u32,
}

impl Expect {
    /// Exactly `value`.
    #[must_use]
    pub const fn equal(index: u16, sub: u8, value: u32) -> Self {
        Self::masked(index, sub, u32::MAX, value)
    }

    /// `value` in the bits of `mask`.
    #[must_use]
    pub const fn masked(index: u16, sub: u8, mask: u32, value: u32) -> Self {
        Self { index, sub, mask, min: value & mask, max: value & mask }
    }

    /// At least `min`.
    #[must_use]
    pub const fn at_least(index: u16, sub: u8, min: u32) -> Self {
        Self { index, sub, mask: u32::MAX, min, max: u32::MAX }
    }

    pub(crate) const fn holds(self, found: u32) -> bool {
        let found = found & self.mask;
        self.min <= found && found <= self.max
    }
}

/// Mapping of a PDO after the node's configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PdoMapping {
    /// Index of the communication record: 0x1400 and up for RPDOs, 0x1800 and up for TPDOs.
    pub record: u16,
    /// The identifier. The PDO must exist.
    pub cob_id: u16,
    /// Mapping entries in the form of 0x1600.
    pub entries: Vec<u32>,
    /// True if the node may be changed to it, by the procedure of CiA 301; default false: another layout is refused.
    pub adjust: bool,
    /// The transmission type that it gets when it is changed; default 255. Its times stay as they are.
    pub kind: u8,
}

impl PdoMapping {
    /// RPDO `number` (1..=4) with its identifier of the pre-defined connection set.
    #[must_use]
    pub fn rpdo(node: u8, number: u8, entries: &[u32]) -> Self {
        let cob_id = crate::wire::Service::Rpdo { node, number }.cob_id();
        Self { record: 0x13FF + u16::from(number), cob_id, entries: entries.to_vec(), adjust: false, kind: 255 }
    }

    /// TPDO `number` (1..=4) with its identifier of the pre-defined connection set.
    #[must_use]
    pub fn tpdo(node: u8, number: u8, entries: &[u32]) -> Self {
        let cob_id = crate::wire::Service::Tpdo { node, number }.cob_id();
        Self { record: 0x17FF + u16::from(number), cob_id, entries: entries.to_vec(), adjust: false, kind: 255 }
    }

    /// A mapping to which the node is changed where it differs.
    #[must_use]
    pub fn adjusted(self) -> Self {
        Self { adjust: true, ..self }
    }
}

/// Node guarding by the master, the older way to watch a node (CiA 301, 7.2.8.2.2.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Guarding {
    /// Period of the requests, 1 ms to 65 s; written to 0x100C.
    pub period: Duration,
    /// Requests without an answer until the node is lost, at least 1; written to 0x100D.
    pub factor: u8,
}

impl Guarding {
    pub(super) fn limit(self) -> Duration {
        self.period.saturating_mul(u32::from(self.factor) + 1)
    }
}

/// Date and time of a configuration, as in 0x1020.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// 0x1020:1, days since 1984-01-01.
    pub date: u32,
    /// 0x1020:2, ms after midnight.
    pub time: u32,
    /// True if the node stores what was written, by 0x1010:1: it keeps it through its next reset.
    pub store: bool,
}

/// An RPDO for a node that counts as lost, and the time that it is given before it is reset: a drive stops by its
/// ramp meanwhile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Farewell {
    /// The RPDO, 1 to 4.
    pub number: u8,
    /// Data, at most 8 bytes.
    pub data: heapless::Vec<u8, 8>,
    /// The time; a boot-up message of the node ends it.
    pub pause: Duration,
}

/// Required identity and configuration of a node.
#[derive(Clone, Debug)]
pub struct NodeConfig {
    /// Node id, 1..=127.
    pub id: u8,
    /// Name, for people.
    pub name: String,
    /// True if [`Event::Ready`](super::Event::Ready) waits for it; default true.
    pub mandatory: bool,
    /// True if an attempt begins with NMT reset communication; default true.
    pub reset: bool,
    /// Time limit from the reset to the boot-up message; default 1 s. After it the node is asked anyway.
    pub boot_timeout: Duration,
    /// Required value of 0x1000.
    pub device_type: Option<u32>,
    /// Written as soon as the device type is right, at each boot-up: a drive that was reset while it turned receives no
    /// PDO until it is Operational, and its time limit for the master's heartbeat may be gone. Before that it is
    /// written every 50 ms, and no answer awaited, as long as the boot-up message after a reset does not come: that
    /// message may be lost. At most 4 bytes; default none.
    pub stop: Option<ConfigWrite>,
    /// Required values of 0x1018, or of a firmware version elsewhere.
    pub identity: Vec<Expect>,
    /// Objects to write, in this order.
    pub writes: Vec<ConfigWrite>,
    /// Time stamp of this configuration. A node whose 0x1020 has the same stamp keeps its configuration, except PDOs
    /// and error control; any other node is stamped after its configuration. Default `None`: each object is compared.
    pub stamp: Option<Stamp>,
    /// Required PDO mappings.
    pub mappings: Vec<PdoMapping>,
    /// True if every RPDO that `mappings` does not name is switched off at each boot-up: a frame on its identifier
    /// could move a drive, or change its mode. Default false.
    pub only_mapped_rpdos: bool,
    /// Communication records of the RPDOs that the node's data sheet lists. Each of the first eight is switched off
    /// where it exists without being listed; beyond them, and beyond these, the search ends at the first that is
    /// missing, the sixteenth at the latest. Default none.
    pub rpdos: Vec<u16>,
    /// Value of 0x1016:1, the node's time limit for the master's heartbeat; `None`: not monitored.
    pub master_limit: Option<Duration>,
    /// True if it is guarded by requests; default none: it sends its heartbeat.
    pub guarding: Option<Guarding>,
    /// Value of 0x1017, the period of the node's heartbeat: 1 ms to 65 s; default 100 ms.
    pub heartbeat: Duration,
    /// Frame sent to a node that counts as lost, in case it only cannot be received. Default none.
    pub farewell: Option<Farewell>,
    /// Time limit for the node's heartbeat, longer than its period; default 200 ms.
    pub heartbeat_limit: Duration,
}

impl NodeConfig {
    /// A node of which nothing is asked, with the defaults.
    #[must_use]
    pub fn new(id: u8, name: &str) -> Self {
        Self {
            id,
            name: String::from(name),
            mandatory: true,
            reset: true,
            boot_timeout: Duration::from_secs(1),
            device_type: None,
            stop: None,
            identity: Vec::new(),
            writes: Vec::new(),
            stamp: None,
            mappings: Vec::new(),
            only_mapped_rpdos: false,
            rpdos: Vec::new(),
            master_limit: None,
            guarding: None,
            heartbeat: Duration::from_millis(100),
            farewell: None,
            heartbeat_limit: Duration::from_millis(200),
        }
    }
}

/// Error of a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // node: whose
pub enum ConfigError {
    /// A node id is not within 1..=127.
    NodeId { node: u8 },
    /// Two nodes, or a node and the master, have the same id.
    SameId { node: u8 },
    /// A period or a limit is shorter than 1 ms (SYNC: 1 µs) or does not fit the object that holds it, or the bus has
    /// no bit rate.
    Period { node: u8 },
    /// A limit is not longer than the heartbeat it watches, or a guarding has no factor.
    Limit { node: u8 },
    /// SYNC cannot count up to that.
    SyncOverflow { overflow: u8 },
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NodeId { node } => write!(f, "node id {node} is not within 1..=127"),
            Self::SameId { node } => write!(f, "node id {node} is given twice"),
            Self::Period { node } => {
                write!(f, "node {node}: a heartbeat, guarding or TIME period or limit is not within 1 ms..=65535 ms")
            }
            Self::Limit { node } => write!(f, "node {node}: a heartbeat limit is not longer than the heartbeat"),
            Self::SyncOverflow { overflow } => write!(f, "SYNC cannot count up to {overflow}, only to 2..=240"),
        }
    }
}

impl MasterConfig {
    pub(super) fn check(&self, nodes: &[NodeConfig]) -> Result<(), ConfigError> {
        let fits = |period: Duration| (1..=0xFFFF).contains(&period.as_millis());
        let ids = || core::iter::once(self.id).chain(nodes.iter().map(|node| node.id));
        if let Some(node) = ids().find(|id| !(1..=127).contains(id)) {
            return Err(ConfigError::NodeId { node });
        }
        if let Some(node) = ids().find(|id| ids().filter(|other| other == id).count() > 1) {
            return Err(ConfigError::SameId { node });
        }
        let short = |period: Option<Duration>, least| period.is_some_and(|period| period < least);
        let (us, ms) = (Duration::from_micros(1), Duration::from_millis(1));
        if !fits(self.heartbeat) || short(self.sync, us) || short(self.time, ms) || self.bit_rate == 0 {
            return Err(ConfigError::Period { node: self.id });
        }
        if let Some(overflow) = self.sync_overflow.filter(|overflow| !(2..=240).contains(overflow)) {
            return Err(ConfigError::SyncOverflow { overflow });
        }
        nodes.iter().try_for_each(|node| {
            let id = node.id;
            let guarded = node.guarding.map(|guarding| guarding.period);
            if [Some(node.heartbeat), node.master_limit, guarded].into_iter().flatten().any(|period| !fits(period)) {
                return Err(ConfigError::Period { node: id });
            }
            if node.guarding.is_some_and(|guarding| guarding.factor == 0) {
                return Err(ConfigError::Limit { node: id });
            }
            let watched = node.master_limit.is_none_or(|limit| limit > self.heartbeat);
            if watched && node.heartbeat_limit > node.heartbeat { Ok(()) } else { Err(ConfigError::Limit { node: id }) }
        })
    }
}
