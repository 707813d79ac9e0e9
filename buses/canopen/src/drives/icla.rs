//! Berger Lahr IclA N065: the steering's position axis.
//!
//! No manual was found: all of this is a stated assumption, that of the simulated drive (`eds/icla_sim.eds`). The
//! master compares identity and PDO mapping with it at each boot-up and refuses to run another layout; or, where the
//! configuration says so, changes the mapping of its PDOs to this one
//! ([`Parameters::remap`](cia402::Parameters::remap)). Identity and modes are never forgiven.
//!
//! Protocol  CiA 402 profile position over RPDO2 (controlword, target position),
//!           homing by SDO ([`hm`](crate::axis::modes::hm))
//! Units     increments of the drive; rpm and rpm/s for speeds and ramps
//! Silence   the drive watches the master's heartbeat (0x1016); 0x6007 = 3: quick stop

use super::cia402::{self, CONTROLWORD, DEVICE_TYPE, Parameters, Pdo, Quantity, RAMPS, STATUSWORD, Setting, Table};
use super::icla_objects::OBJECTS;
use crate::Dictionary;
use crate::axis::control;
use crate::axis::modes::Mode;
use crate::dictionary::DataType;
use crate::master::{Expect, NodeConfig};
use alloc::borrow::Cow;

/// Bit of the statusword: the position counts from home (`ref_ok`). It survives a reset of the communication, and not
/// a loss of power.
pub const HOMED: u16 = 1 << 15;

const VENDOR: u32 = 0x0200_005A;
const PRODUCT: u32 = 0x4E30_3635;
const REVISION_MIN: u32 = 0x0001_0002;

/// The drive: target position and actual position in increments, by RPDO2 and TPDO2. It stops by the quick stop ramp,
/// stays in Quick Stop Active and holds; the same when the master is silent. `icla.toml` of the crate `drivers` is the
/// same.
pub static TABLE: Table = Table {
    device_type: Some(DEVICE_TYPE),
    identity: Cow::Borrowed(&[
        Expect::equal(0x1018, 1, VENDOR),
        Expect::equal(0x1018, 2, PRODUCT),
        Expect::at_least(0x1018, 3, REVISION_MIN),
        Mode::expect(&[Mode::ProfilePosition, Mode::Homing]),
    ]),
    settings: Cow::Borrowed(&[
        Setting::mode(Mode::ProfilePosition),
        Setting::new(0x6081, DataType::U32, Quantity::Velocity),
        RAMPS[0],
        RAMPS[1],
        RAMPS[2],
        Setting::new(0x605A, DataType::I16, Quantity::Fixed(6)),
        Setting::new(0x6007, DataType::I16, Quantity::Fixed(3)),
    ]),
    mode: Mode::ProfilePosition,
    rpdo: Pdo::fixed(2, &[CONTROLWORD, 0x607A_0020]),
    rpdos: Cow::Borrowed(&[]),
    target: 0x607A_0020,
    tpdos: Cow::Borrowed(&[Pdo::fixed(1, &[STATUSWORD]), cia402::reporting(2, &[STATUSWORD, 0x6064_0020])]),
    value: 0x6064_0020,
    quick_stop: control::QUICK_STOP,
    keeps_quick_stop: true,
    homed: HOMED,
    watches_master: true,
    guarding: None,
    // No manual was found: none is assumed.
    motor: Cow::Borrowed(&[]),
};

/// Speed and ramps that suit a steering.
#[must_use]
pub fn parameters(node: u8) -> Parameters {
    Parameters {
        node,
        velocity: 600,
        acceleration: 6_000,
        deceleration: 6_000,
        quick_stop_deceleration: 20_000,
        remap: false,
    }
}

/// Node configuration of the drive for the master.
#[must_use]
pub fn node_config(name: &str, parameters: &Parameters) -> NodeConfig {
    TABLE.node_config(name, parameters)
}

/// The dictionary of a drive that is the same but for its PDOs: position in RPDO3 and TPDO3, as in EPOS drives and
/// the profile's own suggestion. What the simulator offers to see refusal and remapping.
#[must_use]
pub fn dictionary_of_profile(node: u8) -> Dictionary {
    dictionary(node)
        .with_rpdo(2, 0x300, &[CONTROLWORD, 0x6060_0008], true)
        .with_rpdo(3, 0x400, &TABLE.rpdo.entries, true)
        .with_tpdo(2, 0x4000_0280, &[STATUSWORD, 0x6061_0008], true)
        .with_tpdo(3, 0x4000_0380, &TABLE.tpdos[1].entries, true)
}

/// The dictionary of the simulated drive (`eds/icla_sim.eds`).
#[must_use]
pub fn dictionary(node: u8) -> Dictionary {
    cia402::dictionary(node, OBJECTS)
        .with_rpdo(1, 0x200, &[CONTROLWORD], true)
        .with_rpdo(2, 0x300, &TABLE.rpdo.entries, true)
        .with_rpdo(3, 0x8000_0400, &[CONTROLWORD, 0x60FF_0020], true)
        .with_rpdo(4, 0x8000_0500, &[CONTROLWORD, 0x6060_0008], true)
        .with_tpdo(1, 0x4000_0180, &[STATUSWORD], true)
        .with_tpdo(2, 0x4000_0280, &TABLE.tpdos[1].entries, true)
        .with_tpdo(3, 0xC000_0380, &[STATUSWORD, 0x606C_0020], true)
        .with_tpdo(4, 0xC000_0480, &[STATUSWORD, 0x6061_0008], true)
}
