//! maxon EPOS 70/10: a wheel's velocity axis.
//!
//! Protocol  CiA 402 profile velocity over its default RPDO4; maxon EPOS Firmware Specification, Apr 2010
//! Units     rpm of the motor shaft, rpm/s; gear and wheel are the caller's business
//! Silence   the drive watches the master's heartbeat (firmware 2030h and later, else refused): quick stop, then Fault
//! Traps     no 0x605A: quick stop is kept until enabled again; Refresh and Measure Init look like Switched On

use super::epos_objects::OBJECTS;
use super::{inhibit, quick_stop};
use crate::Dictionary;
use crate::axis::AxisConfig;
use crate::axis::modes::Mode;
use crate::master::{ConfigWrite, Expect, NodeConfig, PdoMapping};
use base::Duration;

/// The RPDO that carries controlword and target velocity.
pub const RPDO: u8 = 4;
/// The TPDO that carries the statusword alone.
pub const TPDO_STATUS: u8 = 1;
/// The TPDO that carries statusword and actual velocity; off until configured.
pub const TPDO_VELOCITY: u8 = 4;
/// The oldest firmware whose heartbeat consumer and quick stop in velocity mode work.
pub const FIRMWARE_MIN: u32 = 0x2030;
/// The controlword that stops: enable, quick stop and switch on as maxon's notes have it.
pub const QUICK_STOP: u16 = 0x000B;

const DEVICE_TYPE: u32 = 0x0002_0192;
const VENDOR: u32 = 0x0000_00FB;
/// 0x2003:2 of the 70/10, any revision; the product code may be an application number instead.
const HARDWARE: u32 = 0x6410;
const CONTROL_VELOCITY: [u32; 2] = [0x6040_0010, 0x60FF_0020];
const STATUS: [u32; 1] = [0x6041_0010];
const STATUS_VELOCITY: [u32; 2] = [0x6041_0010, 0x606C_0020];

/// What the drive is set up with at each boot-up; nothing is stored in it.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Node id.
    pub node: u8,
    /// Limit of the demanded velocity, 1..=25000 rpm.
    pub velocity_max_rpm: u32,
    /// Acceleration ramp, rpm/s, at least 1.
    pub acceleration: u32,
    /// Deceleration ramp, rpm/s, at least 1.
    pub deceleration: u32,
    /// Quick stop ramp, rpm/s, at least 1.
    pub quick_stop_deceleration: u32,
    /// The least time between two frames of actual velocity; default 10 ms. Zero floods the bus.
    pub velocity_inhibit: Duration,
    /// 0x6402: 1 brushed, 10 sinus, 11 block; `None`: as the drive has it.
    pub motor_type: Option<u16>,
    /// 0x2210:1, encoder pulses per turn; `None`: as the drive has it.
    pub encoder_pulses: Option<u16>,
    /// 0x2008, miscellaneous configuration; bit 3 measures velocity by pulse time. `None`: as the drive has it.
    pub miscellaneous: Option<u16>,
    /// Period of the drive's heartbeat; default 50 ms.
    pub heartbeat: Duration,
    /// How long that may be missing; default 200 ms: two lost in a row are forgiven.
    pub heartbeat_limit: Duration,
    /// How long the master's heartbeat may be missing before the drive stops by itself; default 200 ms.
    pub master_limit: Duration,
    /// From reset to boot-up message at most; default 1 s.
    pub boot_timeout: Duration,
}

impl Parameters {
    /// The drive's own defaults, the project's time limits.
    #[must_use]
    pub fn new(node: u8) -> Self {
        Self {
            node,
            velocity_max_rpm: 25_000,
            acceleration: 10_000,
            deceleration: 10_000,
            quick_stop_deceleration: 10_000,
            velocity_inhibit: Duration::from_millis(10),
            motor_type: None,
            encoder_pulses: None,
            miscellaneous: None,
            heartbeat: Duration::from_millis(50),
            heartbeat_limit: Duration::from_millis(200),
            master_limit: Duration::from_millis(200),
            boot_timeout: Duration::from_secs(1),
        }
    }
}

/// What the master must know to boot the drive.
#[must_use]
pub fn node_config(name: &str, parameters: &Parameters) -> NodeConfig {
    let node = parameters.node;
    let optional = [
        parameters.motor_type.map(|value| ConfigWrite::new(0x6402, 0, value)),
        parameters.encoder_pulses.map(|value| ConfigWrite::new(0x2210, 1, value)),
        parameters.miscellaneous.map(|value| ConfigWrite::new(0x2008, 0, value)),
    ];
    let velocity_cob_id = 0x4000_0480 + u32::from(node);
    let fixed = [
        ConfigWrite::new(0x6060, 0, Mode::ProfileVelocity.code()),
        ConfigWrite::new(0x607F, 0, parameters.velocity_max_rpm),
        ConfigWrite::new(0x6083, 0, parameters.acceleration),
        ConfigWrite::new(0x6084, 0, parameters.deceleration),
        ConfigWrite::new(0x6085, 0, parameters.quick_stop_deceleration),
        ConfigWrite::new(0x1803, 1, velocity_cob_id | 1 << 31),
        ConfigWrite::new(0x1803, 2, 255_u8),
        ConfigWrite::new(0x1803, 3, inhibit(parameters.velocity_inhibit)),
        ConfigWrite::new(0x1803, 1, velocity_cob_id),
    ];
    let Parameters { velocity_max_rpm, quick_stop_deceleration, .. } = *parameters;
    NodeConfig {
        farewell: Some(quick_stop(RPDO, &pack(QUICK_STOP, 0), velocity_max_rpm, quick_stop_deceleration)),
        device_type: Some(DEVICE_TYPE),
        identity: [
            Expect::equal(0x1018, 1, VENDOR),
            Expect::masked(0x2003, 2, 0xFFF0, HARDWARE),
            Expect::at_least(0x2003, 1, FIRMWARE_MIN),
            Mode::expect(&[Mode::ProfileVelocity]),
        ]
        .into(),
        writes: optional.into_iter().flatten().chain(fixed).collect(),
        mappings: [
            PdoMapping::rpdo(node, RPDO, &CONTROL_VELOCITY),
            PdoMapping::tpdo(node, TPDO_STATUS, &STATUS),
            PdoMapping::tpdo(node, TPDO_VELOCITY, &STATUS_VELOCITY),
        ]
        .into(),
        master_limit: Some(parameters.master_limit),
        heartbeat: parameters.heartbeat,
        heartbeat_limit: parameters.heartbeat_limit,
        boot_timeout: parameters.boot_timeout,
        ..NodeConfig::new(node, name)
    }
}

/// How the axis behaves: quick stop is kept and left by enabling (T16).
#[must_use]
pub fn axis_config() -> AxisConfig {
    AxisConfig { quick_stop: QUICK_STOP, resumes: true, ..AxisConfig::default() }
}

/// The data of [`RPDO`].
#[must_use]
pub fn pack(controlword: u16, velocity_rpm: i32) -> [u8; 6] {
    let ([a, b], [c, d, e, f]) = (controlword.to_le_bytes(), velocity_rpm.to_le_bytes());
    [a, b, c, d, e, f]
}

/// What the drive says of itself in a TPDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Statusword.
    pub statusword: u16,
    /// Actual velocity in rpm, when the TPDO carries it.
    pub velocity_rpm: Option<i32>,
}

/// The content of TPDO `number`; `None` when it is another one or too short.
#[must_use]
pub fn unpack(number: u8, data: &[u8]) -> Option<Status> {
    let (status, rest) = data.split_first_chunk::<2>()?;
    let statusword = u16::from_le_bytes(*status);
    match number {
        TPDO_STATUS => Some(Status { statusword, velocity_rpm: None }),
        TPDO_VELOCITY => {
            let velocity = i32::from_le_bytes(*rest.first_chunk()?);
            Some(Status { statusword, velocity_rpm: Some(velocity) })
        }
        _ => None,
    }
}

/// The dictionary of the simulated drive (`eds/epos_sim.eds`).
#[must_use]
pub fn dictionary(node: u8) -> Dictionary {
    Dictionary::new(node)
        .with(OBJECTS)
        .with_rpdo(1, 0x200, &[0x6040_0010], false)
        .with_rpdo(2, 0x300, &[0x6040_0010, 0x6060_0008], false)
        .with_rpdo(3, 0x400, &[0x6040_0010, 0x607A_0020], false)
        .with_rpdo(4, 0x500, &CONTROL_VELOCITY, false)
        .with_tpdo(1, 0x4000_0180, &STATUS, false)
        .with_tpdo(2, 0xC000_0280, &[0x6041_0010, 0x6061_0008], false)
        .with_tpdo(3, 0xC000_0380, &[0x6041_0010, 0x6064_0020], false)
        .with_tpdo(4, 0xC000_0480, &STATUS_VELOCITY, false)
}
