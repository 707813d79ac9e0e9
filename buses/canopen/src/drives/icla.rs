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

use super::cia402::{self, CONTROLWORD, Parameters, Pdos, STATUSWORD};
use super::icla_objects::OBJECTS;
use crate::Dictionary;
use crate::axis::modes::Mode;
use crate::axis::{AxisConfig, control};
use crate::master::{ConfigWrite, Expect, NodeConfig};

/// Target position and actual position in increments.
pub const PDOS: Pdos = Pdos { rpdo: 2, target: 0x607A_0020, tpdo: 2, value: 0x6064_0020 };
/// The mode of operation for [`pp`](crate::axis::modes::pp).
pub const PROFILE_POSITION: i8 = Mode::ProfilePosition.code();

/// Bit of the statusword: the position counts from home (`ref_ok`). It survives a reset of the communication, and not
/// a loss of power.
pub const HOMED: u16 = 1 << 15;

const VENDOR: u32 = 0x0200_005A;
const PRODUCT: u32 = 0x4E30_3635;
const REVISION_MIN: u32 = 0x0001_0002;

/// Speed and ramps that suit a steering.
#[must_use]
pub fn parameters(node: u8) -> Parameters {
    Parameters {
        node,
        velocity_rpm: 600,
        acceleration: 6_000,
        deceleration: 6_000,
        quick_stop_deceleration: 20_000,
        remap: false,
    }
}

/// Node configuration of the drive for the master.
#[must_use]
pub fn node_config(name: &str, parameters: &Parameters) -> NodeConfig {
    let first = [ConfigWrite::new(0x6060, 0, PROFILE_POSITION), ConfigWrite::new(0x6081, 0, parameters.velocity_rpm)];
    // Stop by the quick stop ramp, stay in Quick Stop Active and hold; the same when the master is silent.
    let last = [ConfigWrite::new(0x605A, 0, 6_i16), ConfigWrite::new(0x6007, 0, 3_i16)];
    let identity = [
        Expect::equal(0x1018, 1, VENDOR),
        Expect::equal(0x1018, 2, PRODUCT),
        Expect::at_least(0x1018, 3, REVISION_MIN),
        Mode::expect(&[Mode::ProfilePosition, Mode::Homing]),
    ];
    let base = PDOS.node_config(name, parameters, control::QUICK_STOP, &first, &last);
    NodeConfig { identity: identity.into(), ..base }
}

/// Behaviour of the axis: with 0x605A = 6 quick stop is kept, and left by enabling (T16).
#[must_use]
pub fn axis_config() -> AxisConfig {
    AxisConfig { resumes: true, ..AxisConfig::default() }
}

/// The dictionary of a drive that is the same but for its PDOs: position in RPDO3 and TPDO3, as in EPOS drives and
/// the profile's own suggestion. What the simulator offers to see refusal and remapping.
#[must_use]
pub fn dictionary_of_profile(node: u8) -> Dictionary {
    dictionary(node)
        .with_rpdo(2, 0x300, &[CONTROLWORD, 0x6060_0008], true)
        .with_rpdo(3, 0x400, &PDOS.command(), true)
        .with_tpdo(2, 0x4000_0280, &[STATUSWORD, 0x6061_0008], true)
        .with_tpdo(3, 0x4000_0380, &PDOS.status(), true)
}

/// The dictionary of the simulated drive (`eds/icla_sim.eds`).
#[must_use]
pub fn dictionary(node: u8) -> Dictionary {
    cia402::dictionary(node, OBJECTS)
        .with_rpdo(1, 0x200, &[CONTROLWORD], true)
        .with_rpdo(2, 0x300, &PDOS.command(), true)
        .with_rpdo(3, 0x8000_0400, &[CONTROLWORD, 0x60FF_0020], true)
        .with_rpdo(4, 0x8000_0500, &[CONTROLWORD, 0x6060_0008], true)
        .with_tpdo(1, 0x4000_0180, &[STATUSWORD], true)
        .with_tpdo(2, 0x4000_0280, &PDOS.status(), true)
        .with_tpdo(3, 0xC000_0380, &[STATUSWORD, 0x606C_0020], true)
        .with_tpdo(4, 0xC000_0480, &[STATUSWORD, 0x6061_0008], true)
}
