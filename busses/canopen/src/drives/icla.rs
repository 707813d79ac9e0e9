//! Berger Lahr IclA N065: the steering's position axis.
//!
//! No manual was found: all of this is a stated assumption, that of the simulated drive (`eds/icla_sim.eds`). The
//! master compares identity and PDO mapping with it at each boot-up and refuses to run another layout; or, where the
//! configuration says so, changes the mapping of its PDOs to this one ([`Parameters::remap`]). Identity and modes are
//! never forgiven.
//!
//! Protocol  CiA 402 profile position over RPDO2 (controlword, target position), homing by SDO ([`hm`](crate::axis::modes::hm))
//! Units     increments of the drive; rpm and rpm/s for speeds and ramps
//! Silence   the drive watches the master's heartbeat (0x1016); 0x6007 = 3: quick stop

use super::icla_objects::OBJECTS;
use super::{inhibit, quick_stop};
use crate::Dictionary;
use crate::axis::modes::Mode;
use crate::axis::{AxisConfig, control};
use crate::master::{ConfigWrite, Expect, NodeConfig, PdoMapping};
use base::Duration;

/// The RPDO that carries controlword and target position.
pub const RPDO: u8 = 2;
/// The TPDO that carries the statusword alone.
pub const TPDO_STATUS: u8 = 1;
/// The TPDO that carries statusword and actual position.
pub const TPDO_POSITION: u8 = 2;
/// The mode of operation for [`pp`](crate::axis::modes::pp).
pub const PROFILE_POSITION: i8 = Mode::ProfilePosition.code();

const DEVICE_TYPE: u32 = 0x0002_0192;
const VENDOR: u32 = 0x0200_005A;
const PRODUCT: u32 = 0x4E30_3635;
const REVISION_MIN: u32 = 0x0001_0002;
const CONTROL_POSITION: [u32; 2] = [0x6040_0010, 0x607A_0020];
const STATUS: [u32; 1] = [0x6041_0010];
const STATUS_POSITION: [u32; 2] = [0x6041_0010, 0x6064_0020];

/// What the drive is set up with at each boot-up; nothing is stored in it.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Node id.
    pub node: u8,
    /// Speed of a move, 1..=10000 rpm.
    pub velocity_rpm: u32,
    /// Acceleration ramp, rpm/s, at least 1.
    pub acceleration: u32,
    /// Deceleration ramp, rpm/s, at least 1.
    pub deceleration: u32,
    /// Quick stop ramp, rpm/s, at least 1.
    pub quick_stop_deceleration: u32,
    /// Software limits in increments, counted from home; `None`: as the drive has them.
    pub position_limits: Option<(i32, i32)>,
    /// The least time between two frames of actual position; default 10 ms.
    pub position_inhibit: Duration,
    /// Period of the drive's heartbeat; default 50 ms.
    pub heartbeat: Duration,
    /// How long that may be missing; default 200 ms: two lost in a row are forgiven.
    pub heartbeat_limit: Duration,
    /// How long the master's heartbeat may be missing before the drive stops by itself; default 200 ms. `None`: the
    /// drive's dictionary has no 0x1016.
    pub master_limit: Option<Duration>,
    /// From reset to boot-up message at most; default 1 s.
    pub boot_timeout: Duration,
    /// Whether a drive with other PDO mappings is changed to these, by the procedure of CiA 301; default false: it is
    /// refused.
    pub remap: bool,
}

impl Parameters {
    /// The drive's own defaults, the project's time limits.
    #[must_use]
    pub fn new(node: u8) -> Self {
        Self {
            node,
            velocity_rpm: 600,
            acceleration: 6_000,
            deceleration: 6_000,
            quick_stop_deceleration: 20_000,
            position_limits: None,
            position_inhibit: Duration::from_millis(10),
            heartbeat: Duration::from_millis(50),
            heartbeat_limit: Duration::from_millis(200),
            master_limit: Some(Duration::from_millis(200)),
            boot_timeout: Duration::from_secs(1),
            remap: false,
        }
    }
}

/// What the master must know to boot the drive.
#[must_use]
pub fn node_config(name: &str, parameters: &Parameters) -> NodeConfig {
    let node = parameters.node;
    let position_cob_id = 0x4000_0280 + u32::from(node);
    let mut writes = [
        ConfigWrite::new(0x6060, 0, PROFILE_POSITION),
        ConfigWrite::new(0x6081, 0, parameters.velocity_rpm),
        ConfigWrite::new(0x6083, 0, parameters.acceleration),
        ConfigWrite::new(0x6084, 0, parameters.deceleration),
        ConfigWrite::new(0x6085, 0, parameters.quick_stop_deceleration),
        // Stop by the quick stop ramp, stay in Quick Stop Active and hold; the same when the master is silent.
        ConfigWrite::new(0x605A, 0, 6_i16),
        ConfigWrite::new(0x6007, 0, 3_i16),
        ConfigWrite::new(0x1801, 1, position_cob_id | 1 << 31),
        ConfigWrite::new(0x1801, 2, 255_u8),
        ConfigWrite::new(0x1801, 3, inhibit(parameters.position_inhibit)),
        ConfigWrite::new(0x1801, 1, position_cob_id),
    ]
    .to_vec();
    if let Some((min, max)) = parameters.position_limits {
        writes.extend([ConfigWrite::new(0x607D, 1, min), ConfigWrite::new(0x607D, 2, max)]);
    }
    let Parameters { velocity_rpm, quick_stop_deceleration, .. } = *parameters;
    NodeConfig {
        farewell: Some(quick_stop(RPDO, &pack(control::QUICK_STOP, 0), velocity_rpm, quick_stop_deceleration)),
        device_type: Some(DEVICE_TYPE),
        identity: [
            Expect::equal(0x1018, 1, VENDOR),
            Expect::equal(0x1018, 2, PRODUCT),
            Expect::at_least(0x1018, 3, REVISION_MIN),
            Mode::expect(&[Mode::ProfilePosition, Mode::Homing]),
        ]
        .into(),
        writes,
        mappings: [
            PdoMapping::rpdo(node, RPDO, &CONTROL_POSITION),
            PdoMapping::tpdo(node, TPDO_STATUS, &STATUS),
            PdoMapping::tpdo(node, TPDO_POSITION, &STATUS_POSITION),
        ]
        .map(|mapping| PdoMapping { adjust: parameters.remap, ..mapping })
        .into(),
        master_limit: parameters.master_limit,
        heartbeat: parameters.heartbeat,
        heartbeat_limit: parameters.heartbeat_limit,
        boot_timeout: parameters.boot_timeout,
        ..NodeConfig::new(node, name)
    }
}

/// How the axis behaves: with 0x605A = 6 quick stop is kept and left by enabling (T16).
#[must_use]
pub fn axis_config() -> AxisConfig {
    AxisConfig { resumes: true, ..AxisConfig::default() }
}

/// The data of [`RPDO`].
#[must_use]
pub fn pack(controlword: u16, position: i32) -> [u8; 6] {
    let ([a, b], [c, d, e, f]) = (controlword.to_le_bytes(), position.to_le_bytes());
    [a, b, c, d, e, f]
}

/// What the drive says of itself in a TPDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Statusword.
    pub statusword: u16,
    /// Actual position in increments, when the TPDO carries it.
    pub position: Option<i32>,
}

/// The content of TPDO `number`; `None` when it is another one or too short.
#[must_use]
pub fn unpack(number: u8, data: &[u8]) -> Option<Status> {
    let (status, rest) = data.split_first_chunk::<2>()?;
    let statusword = u16::from_le_bytes(*status);
    match number {
        TPDO_STATUS => Some(Status { statusword, position: None }),
        TPDO_POSITION => {
            let position = i32::from_le_bytes(*rest.first_chunk()?);
            Some(Status { statusword, position: Some(position) })
        }
        _ => None,
    }
}

/// The dictionary of a drive that is the same but for its PDOs: position in RPDO3 and TPDO3, as in EPOS drives and
/// the profile's own suggestion. What the simulator offers to see refusal and remapping.
#[must_use]
pub fn dictionary_of_profile(node: u8) -> Dictionary {
    dictionary(node)
        .with_rpdo(2, 0x300, &[0x6040_0010, 0x6060_0008], true)
        .with_rpdo(3, 0x400, &CONTROL_POSITION, true)
        .with_tpdo(2, 0x4000_0280, &[0x6041_0010, 0x6061_0008], true)
        .with_tpdo(3, 0x4000_0380, &STATUS_POSITION, true)
}

/// The dictionary of the simulated drive (`eds/icla_sim.eds`).
#[must_use]
pub fn dictionary(node: u8) -> Dictionary {
    Dictionary::new(node)
        .with(OBJECTS)
        .with_rpdo(1, 0x200, &[0x6040_0010], true)
        .with_rpdo(2, 0x300, &CONTROL_POSITION, true)
        .with_rpdo(3, 0x8000_0400, &[0x6040_0010, 0x60FF_0020], true)
        .with_rpdo(4, 0x8000_0500, &[0x6040_0010, 0x6060_0008], true)
        .with_tpdo(1, 0x4000_0180, &STATUS, true)
        .with_tpdo(2, 0x4000_0280, &STATUS_POSITION, true)
        .with_tpdo(3, 0xC000_0380, &[0x6041_0010, 0x606C_0020], true)
        .with_tpdo(4, 0xC000_0480, &[0x6041_0010, 0x6061_0008], true)
}
