//! A drive as a table: what the master boots and verifies, which PDOs command and report, how it stops. The robot's two
//! drives are written here by hand; that of any other one follows from its data sheet ([`derive`](super::derive)).

use super::cia402_objects::OBJECTS;
use super::motor::Reading;
use crate::Dictionary;
use crate::Payload;
use crate::axis::AxisConfig;
use crate::axis::modes::Mode;
use crate::dictionary::DataType;
use crate::master::{ConfigWrite, Expect, Farewell, Guarding, NodeConfig, PdoMapping};
use crate::pdo::{Data, INVALID, Mapped};
use alloc::borrow::Cow;
use alloc::vec::Vec;
use base::Duration;

pub(super) const DEVICE_TYPE: u32 = 0x0002_0192;
/// The controlword in a mapping.
pub const CONTROLWORD: u32 = 0x6040_0010;
/// The statusword in a mapping.
pub const STATUSWORD: u32 = 0x6041_0010;
/// The torque in a mapping, per mille of the rated torque.
pub const TORQUE: u32 = 0x6077_0010;
/// Period of the drive's heartbeat.
const HEARTBEAT: Duration = Duration::from_millis(50);
/// Time limit for a heartbeat, the drive's or the master's: two lost in a row are tolerated.
pub(super) const HEARTBEAT_LIMIT: Duration = Duration::from_millis(200);
/// Minimum time between two frames of actual values, in 100 us: 10 ms. Zero floods the bus.
pub(super) const INHIBIT: u16 = 100;
/// Bit 30 of a COB-ID: no remote frames.
const NO_RTR: u32 = 1 << 30;
/// Greatest pause after a farewell, ms: the drive may be dead.
const RAMP_MAX_MS: u64 = 2000;

/// Parameters written to a drive at each boot-up, in its own units; nothing is stored in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameters {
    /// Node id.
    pub node: u8,
    /// The greatest velocity: the limit of what is demanded, or the speed of a move; at least 1.
    pub velocity: u32,
    /// Acceleration ramp, at least 1.
    pub acceleration: u32,
    /// Deceleration ramp, at least 1.
    pub deceleration: u32,
    /// Quick stop ramp, at least 1.
    pub quick_stop_deceleration: u32,
    /// True changes a drive with other PDO mappings to these, by the procedure of CiA 301; false leaves that to each
    /// [`Pdo`].
    pub remap: bool,
}

/// Value of a [`Setting`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// [`Parameters::velocity`].
    Velocity,
    /// [`Parameters::acceleration`].
    Acceleration,
    /// [`Parameters::deceleration`].
    Deceleration,
    /// [`Parameters::quick_stop_deceleration`].
    QuickStop,
    /// The same for all.
    Fixed(i64),
}

/// An object that is written and read back at each boot-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    /// The object's index.
    pub index: u16,
    /// The object's sub-index.
    pub sub: u8,
    /// Its type: an integer of at most 32 bits.
    pub data_type: DataType,
    /// Its value.
    pub value: Quantity,
}

impl Setting {
    /// Sub-index 0 of an object.
    #[must_use]
    pub const fn new(index: u16, data_type: DataType, value: Quantity) -> Self {
        Self { index, sub: 0, data_type, value }
    }

    /// The mode of operation.
    #[must_use]
    pub const fn mode(mode: Mode) -> Self {
        Self::new(0x6060, DataType::I8, Quantity::Fixed(mode.code() as i64))
    }

    /// Its value with these parameters, in the drive's unit. It may be beyond what its type holds.
    #[must_use]
    pub fn number(&self, parameters: &Parameters) -> i64 {
        match self.value {
            Quantity::Velocity => parameters.velocity.into(),
            Quantity::Acceleration => parameters.acceleration.into(),
            Quantity::Deceleration => parameters.deceleration.into(),
            Quantity::QuickStop => parameters.quick_stop_deceleration.into(),
            Quantity::Fixed(value) => value,
        }
    }

    fn write(&self, parameters: &Parameters) -> ConfigWrite {
        let (low, high) = self.data_type.range();
        let value = self.number(parameters).clamp(low, high).to_le_bytes();
        let width = self.data_type.width().unwrap_or(4).min(value.len());
        ConfigWrite::new(self.index, self.sub, Payload::from(&value[..width]))
    }
}

/// Communication parameters that a PDO gets at each boot-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transmission {
    /// Transmission type.
    pub kind: u8,
    /// Inhibit time in 100 us, where the drive has one.
    pub inhibit: Option<u16>,
    /// Event timer in ms: it is sent that often at least. `None`: it stays as it is.
    pub event_timer: Option<u16>,
}

/// A PDO in use, with its identifier of the pre-defined connection set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pdo {
    /// Which one, 1 to 4.
    pub number: u8,
    /// Mapping entries in the form of 0x1600, at most 64 bits.
    pub entries: Cow<'static, [u32]>,
    /// `None`: its communication parameters stay as they are.
    pub transmission: Option<Transmission>,
    /// True if a drive that maps it otherwise is changed; false refuses it.
    pub adjust: bool,
}

impl Pdo {
    /// A PDO that must be as it is.
    #[must_use]
    pub const fn fixed(number: u8, entries: &'static [u32]) -> Self {
        Self { number, entries: Cow::Borrowed(entries), transmission: None, adjust: false }
    }

    /// Switches it off, sets its communication parameters, and switches it on: `record` is its communication record.
    fn writes(&self, record: u16, cob_id: u32) -> Vec<ConfigWrite> {
        let Some(Transmission { kind, inhibit, event_timer }) = self.transmission else {
            return Vec::new();
        };
        let off = ConfigWrite::new(record, 1, cob_id | INVALID);
        let inhibit = inhibit.map(|inhibit| ConfigWrite::new(record, 3, inhibit));
        let event_timer = event_timer.map(|timer| ConfigWrite::new(record, 5, timer));
        let writes = [off, ConfigWrite::new(record, 2, kind)].into_iter().chain(inhibit).chain(event_timer);
        writes.chain([ConfigWrite::new(record, 1, cob_id)]).collect()
    }

    /// Each entry and the bits before it; what does not fit into a frame is left out.
    fn places(&self) -> impl Iterator<Item = (u32, Mapped, u32)> + '_ {
        let mut next = 0;
        self.entries.iter().filter_map(move |entry| {
            let (mapped, at) = (Mapped::new(*entry), next);
            let fits = mapped.bits > 0 && at + u32::from(mapped.bits) <= u64::BITS;
            next += if fits { u32::from(mapped.bits) } else { 0 };
            fits.then_some((*entry, mapped, at))
        })
    }
}

/// Content of a TPDO of the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Statusword, when the TPDO carries it.
    pub statusword: Option<u16>,
    /// Actual velocity or position in the drive's unit, when the TPDO carries it.
    pub value: Option<i32>,
    /// Torque of the motor, per mille of its rated torque, when the TPDO carries it.
    pub torque: Option<i16>,
}

/// A drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table {
    /// Required value of 0x1000; `None`: `identity` has what matters of it.
    pub device_type: Option<u32>,
    /// What the drive must be before anything but a stop is written to it.
    pub identity: Cow<'static, [Expect]>,
    /// What is written and read back, in this order.
    pub settings: Cow<'static, [Setting]>,
    /// Mode of operation in which it is commanded.
    pub mode: Mode,
    /// The RPDO that carries controlword and target.
    pub rpdo: Pdo,
    /// Communication records of all RPDOs that its data sheet lists: [`NodeConfig::rpdos`].
    pub rpdos: Cow<'static, [u16]>,
    /// The target, as in a mapping: `0x60FF_0020`.
    pub target: u32,
    /// TPDOs that carry the statusword, the actual value, or both; or the torque ([`TORQUE`]).
    pub tpdos: Cow<'static, [Pdo]>,
    /// The actual value, as in a mapping: `0x606C_0020`.
    pub value: u32,
    /// The controlword that stops.
    pub quick_stop: u16,
    /// True if Quick Stop Active is kept, and left by enabling (T16).
    pub keeps_quick_stop: bool,
    /// Bit of the statusword that says that the position counts from home; 0: it has none.
    pub homed: u16,
    /// True if the drive watches the master's heartbeat.
    pub watches_master: bool,
    /// Node guarding, for a drive without heartbeats.
    pub guarding: Option<Guarding>,
    /// What it measures of its motor beside its motion, rated values first.
    pub motor: Cow<'static, [Reading]>,
}

impl Table {
    /// The node as the master boots it.
    #[must_use]
    pub fn node_config(&self, name: &str, parameters: &Parameters) -> NodeConfig {
        let node = parameters.node;
        let adjust = |mapping, pdo: &Pdo| PdoMapping {
            adjust: pdo.adjust || parameters.remap,
            kind: pdo.transmission.map_or(255, |transmission| transmission.kind),
            ..mapping
        };
        let rpdo = adjust(PdoMapping::rpdo(node, self.rpdo.number, &self.rpdo.entries), &self.rpdo);
        let tpdo = |pdo: &Pdo| adjust(PdoMapping::tpdo(node, pdo.number, &pdo.entries), pdo);
        let tpdos: Vec<_> = self.tpdos.iter().map(tpdo).collect();
        let mut writes: Vec<_> = self.settings.iter().map(|setting| setting.write(parameters)).collect();
        writes.extend(self.rpdo.writes(rpdo.record, rpdo.cob_id.into()));
        for (pdo, mapping) in self.tpdos.iter().zip(&tpdos) {
            writes.extend(pdo.writes(mapping.record, NO_RTR | u32::from(mapping.cob_id)));
        }
        NodeConfig {
            farewell: Some(self.farewell(parameters)),
            device_type: self.device_type,
            stop: Some(ConfigWrite::new(0x6040, 0, self.quick_stop).blindly()),
            identity: self.identity.to_vec(),
            writes,
            mappings: core::iter::once(rpdo).chain(tpdos).collect(),
            only_mapped_rpdos: true,
            rpdos: self.rpdos.to_vec(),
            master_limit: self.watches_master.then_some(HEARTBEAT_LIMIT),
            guarding: self.guarding,
            heartbeat: HEARTBEAT,
            heartbeat_limit: HEARTBEAT_LIMIT,
            ..NodeConfig::new(node, name)
        }
    }

    /// Behaviour of the axis.
    #[must_use]
    pub fn axis_config(&self) -> AxisConfig {
        AxisConfig { quick_stop: self.quick_stop, resumes: self.keeps_quick_stop, ..AxisConfig::default() }
    }

    /// The data of the RPDO. A target beyond its bits saturates.
    #[must_use]
    pub fn pack(&self, controlword: u16, target: i32) -> Data {
        let mut frame = 0;
        let mut len = 0;
        for (entry, mapped, at) in self.rpdo.places() {
            let bits = u32::from(mapped.bits);
            let value = match entry {
                CONTROLWORD => i64::from(controlword),
                entry if entry == self.target => saturated(target.into(), bits),
                _ if mapped.index == 0x6060 => self.mode.code().into(),
                _ => 0,
            };
            frame |= (value as u64 & u64::MAX >> (u64::BITS - bits)) << at;
            len = (at + bits).div_ceil(8) as usize;
        }
        frame.to_le_bytes().into_iter().take(len).collect()
    }

    /// The content of TPDO `number`; `None` when it is another one or too short.
    #[must_use]
    pub fn unpack(&self, number: u8, data: &[u8]) -> Option<Status> {
        let pdo = self.tpdos.iter().find(|pdo| pdo.number == number)?;
        let mut bytes = [0; 8];
        let len = data.len().min(8);
        bytes[..len].copy_from_slice(&data[..len]);
        let (frame, bits_there) = (u64::from_le_bytes(bytes), 8 * len as u32);
        let mut status = Status { statusword: None, value: None, torque: None };
        for (entry, mapped, at) in pdo.places() {
            let (bits, unused) = (u32::from(mapped.bits), u64::BITS - u32::from(mapped.bits));
            if at + bits > bits_there {
                return None;
            }
            let value = ((frame >> at) << unused) as i64 >> unused;
            match entry {
                STATUSWORD => status.statusword = Some(value as u16),
                entry if entry == self.value => status.value = i32::try_from(value).ok(),
                TORQUE => status.torque = i16::try_from(value).ok(),
                _ => {}
            }
        }
        Some(status)
    }

    /// True if a TPDO carries the torque.
    #[must_use]
    pub fn reports_torque(&self) -> bool {
        self.tpdos.iter().any(|pdo| pdo.entries.contains(&TORQUE))
    }

    /// A quick stop for a drive that is lost, and the time that its ramp takes from the greatest velocity.
    fn farewell(&self, parameters: &Parameters) -> Farewell {
        let ramp = u64::from(parameters.velocity) * 1000 / u64::from(parameters.quick_stop_deceleration.max(1));
        let data = self.pack(self.quick_stop, 0);
        Farewell { number: self.rpdo.number, data, pause: Duration::from_millis(ramp.min(RAMP_MAX_MS)) }
    }
}

fn saturated(value: i64, bits: u32) -> i64 {
    value.clamp(i64::MIN >> (u64::BITS - bits), i64::MAX >> (u64::BITS - bits))
}

/// The three ramps that every drive has.
pub(super) const RAMPS: [Setting; 3] = [
    Setting::new(0x6083, DataType::U32, Quantity::Acceleration),
    Setting::new(0x6084, DataType::U32, Quantity::Deceleration),
    Setting::new(0x6085, DataType::U32, Quantity::QuickStop),
];

/// An event-driven TPDO that must be mapped so and is switched on, with a pause between two frames.
pub(super) const fn reporting(number: u8, entries: &'static [u32]) -> Pdo {
    let transmission = Some(Transmission { kind: 255, inhibit: Some(INHIBIT), event_timer: None });
    Pdo { number, entries: Cow::Borrowed(entries), transmission, adjust: false }
}

/// The dictionary of a simulated drive: the objects that all have, and its own, without its PDOs.
pub(super) fn dictionary(node: u8, own: &[crate::dictionary::Entry]) -> Dictionary {
    Dictionary::new(node).with(OBJECTS).with(own)
}
