//! What the drives here share: an RPDO with controlword and target, TPDO1 with the statusword alone, another TPDO with
//! statusword and actual value, ramps, supervision, and the objects that each of them has.

use super::cia402_objects::OBJECTS;
use crate::Dictionary;
use crate::master::{ConfigWrite, Farewell, NodeConfig, PdoMapping};
use base::Duration;

/// The TPDO that carries the statusword alone.
pub const TPDO_STATUS: u8 = 1;

const DEVICE_TYPE: u32 = 0x0002_0192;
pub(super) const CONTROLWORD: u32 = 0x6040_0010;
pub(super) const STATUSWORD: u32 = 0x6041_0010;
/// Period of the drive's heartbeat.
const HEARTBEAT: Duration = Duration::from_millis(50);
/// Time limit for a heartbeat, the drive's or the master's: two lost in a row are tolerated.
const HEARTBEAT_LIMIT: Duration = Duration::from_millis(200);
/// Minimum time between two frames of actual values, in 100 us: 10 ms. Zero floods the bus.
const INHIBIT: u16 = 100;
/// Greatest pause after a farewell, ms: the drive may be dead.
const RAMP_MAX_MS: u64 = 2000;

/// Parameters written to a drive at each boot-up; nothing is stored in it.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Node id.
    pub node: u8,
    /// The greatest velocity: the limit of what is demanded, or the speed of a move; rpm, at least 1.
    pub velocity_rpm: u32,
    /// Acceleration ramp, rpm/s, at least 1.
    pub acceleration: u32,
    /// Deceleration ramp, rpm/s, at least 1.
    pub deceleration: u32,
    /// Quick stop ramp, rpm/s, at least 1.
    pub quick_stop_deceleration: u32,
    /// True changes a drive with other PDO mappings to these, by the procedure of CiA 301; false refuses it.
    pub remap: bool,
}

/// The PDOs of an axis: which ones, and what they carry besides controlword and statusword.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pdos {
    /// The RPDO that carries controlword and target.
    pub rpdo: u8,
    /// The target, as in a mapping: `0x60FF_0020`.
    pub target: u32,
    /// The TPDO that carries statusword and actual value.
    pub tpdo: u8,
    /// The actual value, as in a mapping: `0x606C_0020`.
    pub value: u32,
}

/// Content of a TPDO of the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Statusword.
    pub statusword: u16,
    /// Actual velocity or position in the drive's unit, when the TPDO carries it.
    pub value: Option<i32>,
}

/// The data of the RPDO.
#[must_use]
pub fn pack(controlword: u16, target: i32) -> [u8; 6] {
    let ([a, b], [c, d, e, f]) = (controlword.to_le_bytes(), target.to_le_bytes());
    [a, b, c, d, e, f]
}

impl Pdos {
    /// The content of TPDO `number`; `None` when it is another one or too short.
    #[must_use]
    pub fn unpack(&self, number: u8, data: &[u8]) -> Option<Status> {
        let (statusword, rest) = data.split_first_chunk()?;
        let value = match number {
            TPDO_STATUS => None,
            number if number == self.tpdo => Some(i32::from_le_bytes(*rest.first_chunk()?)),
            _ => return None,
        };
        Some(Status { statusword: u16::from_le_bytes(*statusword), value })
    }

    /// The mapping of the RPDO.
    pub(super) const fn command(&self) -> [u32; 2] {
        [CONTROLWORD, self.target]
    }

    /// The mapping of the TPDO with the actual value.
    pub(super) const fn status(&self) -> [u32; 2] {
        [STATUSWORD, self.value]
    }

    /// The node as the master boots it, all but what it must be: farewell by the controlword `quick_stop`, `first` and
    /// ramps, mappings, supervision.
    pub(super) fn node_config(
        &self,
        name: &str,
        parameters: &Parameters,
        quick_stop: u16,
        first: &[ConfigWrite],
        last: &[ConfigWrite],
    ) -> NodeConfig {
        let node = parameters.node;
        let communication = 0x1800 + u16::from(self.tpdo) - 1;
        let cob_id = 0x4000_0080 + 0x100 * u32::from(self.tpdo) + u32::from(node);
        let ramps = [
            ConfigWrite::new(0x6083, 0, parameters.acceleration),
            ConfigWrite::new(0x6084, 0, parameters.deceleration),
            ConfigWrite::new(0x6085, 0, parameters.quick_stop_deceleration),
        ];
        let actual = [
            ConfigWrite::new(communication, 1, cob_id | 1 << 31),
            ConfigWrite::new(communication, 2, 255_u8),
            ConfigWrite::new(communication, 3, INHIBIT),
            ConfigWrite::new(communication, 1, cob_id),
        ];
        let mappings = [
            PdoMapping::rpdo(node, self.rpdo, &self.command()),
            PdoMapping::tpdo(node, TPDO_STATUS, &[STATUSWORD]),
            PdoMapping::tpdo(node, self.tpdo, &self.status()),
        ];
        NodeConfig {
            farewell: Some(self.farewell(parameters, quick_stop)),
            device_type: Some(DEVICE_TYPE),
            stop: Some(ConfigWrite::new(0x6040, 0, quick_stop).blindly()),
            writes: [first, &ramps, last, &actual].concat(),
            mappings: mappings.map(|mapping| PdoMapping { adjust: parameters.remap, ..mapping }).into(),
            only_mapped_rpdos: true,
            master_limit: Some(HEARTBEAT_LIMIT),
            heartbeat: HEARTBEAT,
            heartbeat_limit: HEARTBEAT_LIMIT,
            ..NodeConfig::new(node, name)
        }
    }

    /// A quick stop for a drive that is lost, and the time that its ramp takes from the greatest velocity.
    fn farewell(&self, parameters: &Parameters, quick_stop: u16) -> Farewell {
        let ramp = u64::from(parameters.velocity_rpm) * 1000 / u64::from(parameters.quick_stop_deceleration.max(1));
        let data = heapless::Vec::from_slice(&pack(quick_stop, 0)).unwrap_or_default();
        Farewell { number: self.rpdo, data, pause: Duration::from_millis(ramp.min(RAMP_MAX_MS)) }
    }
}

/// The dictionary of a simulated drive: the objects that all have, and its own, without its PDOs.
pub(super) fn dictionary(node: u8, own: &[crate::dictionary::Entry]) -> Dictionary {
    Dictionary::new(node).with(OBJECTS).with(own)
}
