//! maxon EPOS 70/10: a wheel's velocity axis.
//!
//! Protocol  CiA 402 profile velocity over its default RPDO4; maxon EPOS Firmware Specification, Apr 2010
//! Units     rpm of the motor shaft, rpm/s; gear and wheel are the caller's business
//! Silence   the drive watches the master's heartbeat (firmware 2030h and later, else refused): quick stop, then Fault
//! Traps     no 0x605A: quick stop is kept until enabled again; Refresh and Measure Init look like Switched On

use super::cia402::{self, CONTROLWORD, Parameters, Pdos, STATUSWORD};
use super::epos_objects::OBJECTS;
use crate::axis::AxisConfig;
use crate::axis::modes::Mode;
use crate::master::{ConfigWrite, Expect, NodeConfig};
use crate::{Abort, Dictionary};

/// Target velocity and actual velocity in rpm; TPDO4 is off until configured.
pub const PDOS: Pdos = Pdos { rpdo: 4, target: 0x60FF_0020, tpdo: 4, value: 0x606C_0020 };
/// Limit of the demanded velocity at most, 0x607F.
pub const VELOCITY_MAX_RPM: u32 = 25_000;
/// The oldest firmware whose heartbeat consumer and quick stop in velocity mode work.
pub const FIRMWARE_MIN: u32 = 0x2030;
/// The controlword that stops: enable, quick stop and switch on as maxon's notes have it.
pub const QUICK_STOP: u16 = 0x000B;

/// Vendor id, 0x1018:1.
pub const VENDOR: u32 = 0x0000_00FB;
/// 0x2003:2 of the 70/10, any revision; the product code may be an application number instead.
const HARDWARE: u32 = 0x6410;

/// The defaults of the drive itself, but for its supervision.
#[must_use]
pub fn parameters(node: u8) -> Parameters {
    let ramp = 10_000;
    Parameters {
        node,
        velocity_rpm: VELOCITY_MAX_RPM,
        acceleration: ramp,
        deceleration: ramp,
        quick_stop_deceleration: ramp,
        remap: false,
    }
}

/// Node configuration of the drive for the master.
#[must_use]
pub fn node_config(name: &str, parameters: &Parameters) -> NodeConfig {
    let first = [
        ConfigWrite::new(0x6060, 0, Mode::ProfileVelocity.code()),
        ConfigWrite::new(0x607F, 0, parameters.velocity_rpm),
    ];
    let identity = [
        Expect::equal(0x1018, 1, VENDOR),
        Expect::masked(0x2003, 2, 0xFFF0, HARDWARE),
        Expect::at_least(0x2003, 1, FIRMWARE_MIN),
        Mode::expect(&[Mode::ProfileVelocity]),
    ];
    NodeConfig { identity: identity.into(), ..PDOS.node_config(name, parameters, QUICK_STOP, &first, &[]) }
}

/// Behaviour of the axis: quick stop is kept, and left by enabling (T16).
#[must_use]
pub fn axis_config() -> AxisConfig {
    AxisConfig { quick_stop: QUICK_STOP, resumes: true, ..AxisConfig::default() }
}

/// Name of an abort code of the manufacturer's own (Firmware Specification).
#[must_use]
pub const fn abort_name(code: Abort) -> Option<&'static str> {
    Some(match code.0 {
        0x0F00_FFB9 => "wrong CAN id",
        0x0F00_FFBC => "not in service mode",
        0x0F00_FFBE => "wrong password",
        0x0F00_FFC0 => "wrong NMT state",
        _ => return None,
    })
}

/// The dictionary of the simulated drive (`eds/epos_sim.eds`).
#[must_use]
pub fn dictionary(node: u8) -> Dictionary {
    cia402::dictionary(node, OBJECTS)
        .with_rpdo(1, 0x200, &[CONTROLWORD], false)
        .with_rpdo(2, 0x300, &[CONTROLWORD, 0x6060_0008], false)
        .with_rpdo(3, 0x400, &[CONTROLWORD, 0x607A_0020], false)
        .with_rpdo(4, 0x500, &PDOS.command(), false)
        .with_tpdo(1, 0x4000_0180, &[STATUSWORD], false)
        .with_tpdo(2, 0xC000_0280, &[STATUSWORD, 0x6061_0008], false)
        .with_tpdo(3, 0xC000_0380, &[STATUSWORD, 0x6064_0020], false)
        .with_tpdo(4, 0xC000_0480, &PDOS.status(), false)
}
