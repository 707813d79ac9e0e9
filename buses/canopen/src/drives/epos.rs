//! maxon EPOS 70/10: a wheel's velocity axis.
//!
//! Protocol  CiA 402 profile velocity over its default RPDO4; maxon EPOS Firmware Specification, Apr 2010
//! Units     rpm of the motor shaft, rpm/s; gear and wheel are the caller's business
//! Silence   the drive watches the master's heartbeat (firmware 2030h and later, else refused): quick stop, then Fault
//! Traps     no 0x605A: quick stop is kept until enabled again; Refresh and Measure Init look like Switched On

use super::cia402::{self, CONTROLWORD, DEVICE_TYPE, Parameters, Pdo, Quantity, RAMPS, STATUSWORD, Setting, Table};
use super::epos_objects::OBJECTS;
use super::motor::{Reading, Topic, Unit};
use crate::axis::modes::Mode;
use crate::dictionary::DataType;
use crate::master::{Expect, NodeConfig};
use crate::{Abort, Dictionary};
use alloc::borrow::Cow;

/// Limit of the demanded velocity at most, 0x607F.
pub const VELOCITY_MAX_RPM: u32 = 25_000;
/// The oldest firmware whose heartbeat consumer and quick stop in velocity mode work.
pub const FIRMWARE_MIN: u32 = 0x2030;

/// Vendor id, 0x1018:1.
pub const VENDOR: u32 = 0x0000_00FB;
/// 0x2003:2 of the 70/10, any revision; the product code may be an application number instead.
const HARDWARE: u32 = 0x6410;

/// The drive: target velocity and actual velocity in rpm, by RPDO4 and TPDO4, which is off until configured. It stops
/// by 0x000B, enable, quick stop and switch on, as maxon's notes have it. `epos.toml` of the crate `drivers`
/// is the same.
pub static TABLE: Table = Table {
    device_type: Some(DEVICE_TYPE),
    identity: Cow::Borrowed(&[
        Expect::equal(0x1018, 1, VENDOR),
        Expect::masked(0x2003, 2, 0xFFF0, HARDWARE),
        Expect::at_least(0x2003, 1, FIRMWARE_MIN),
        Mode::expect(&[Mode::ProfileVelocity]),
    ]),
    settings: Cow::Borrowed(&[
        Setting::mode(Mode::ProfileVelocity),
        Setting::new(0x607F, DataType::U32, Quantity::Velocity),
        RAMPS[0],
        RAMPS[1],
        RAMPS[2],
    ]),
    mode: Mode::ProfileVelocity,
    rpdo: Pdo::fixed(4, &[CONTROLWORD, 0x60FF_0020]),
    rpdos: Cow::Borrowed(&[]),
    target: 0x60FF_0020,
    tpdos: Cow::Borrowed(&[Pdo::fixed(1, &[STATUSWORD]), cia402::reporting(4, &[STATUSWORD, 0x606C_0020])]),
    value: 0x606C_0020,
    quick_stop: 0x000B,
    keeps_quick_stop: true,
    homed: 0,
    watches_master: true,
    guarding: None,
    // In mA; CiA 402 has per mille of 0x6075, which the EPOS does not have. Its continuous current limit is the rated
    // current of the motor (docs/facts/canopen.md 2.4).
    motor: Cow::Borrowed(&[
        Reading { sub: 1, ..Reading::new(Topic::RatedCurrent, 0x6410, DataType::U16, Unit::Decimal(-3)) },
        Reading::new(Topic::Current, 0x6078, DataType::I16, Unit::Decimal(-3)),
    ]),
};

/// The defaults of the drive itself, but for its supervision.
#[must_use]
pub fn parameters(node: u8) -> Parameters {
    let ramp = 10_000;
    Parameters {
        node,
        velocity: VELOCITY_MAX_RPM,
        acceleration: ramp,
        deceleration: ramp,
        quick_stop_deceleration: ramp,
        remap: false,
    }
}

/// Node configuration of the drive for the master.
#[must_use]
pub fn node_config(name: &str, parameters: &Parameters) -> NodeConfig {
    TABLE.node_config(name, parameters)
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
        .with_rpdo(4, 0x500, &TABLE.rpdo.entries, false)
        .with_tpdo(1, 0x4000_0180, &[STATUSWORD], false)
        .with_tpdo(2, 0xC000_0280, &[STATUSWORD, 0x6061_0008], false)
        .with_tpdo(3, 0xC000_0380, &[STATUSWORD, 0x6064_0020], false)
        .with_tpdo(4, 0xC000_0480, &TABLE.tpdos[1].entries, false)
}
