//! Hashes of fingerprints (`lcmgen/lcmgen.c`, `lcmgen/emit_c.c`). All arithmetic wraps at 64 bits.

use crate::{Definition, Kind, MemberType, Size};

fn step(v: i64, c: i8) -> i64 {
    ((v << 8) ^ (v >> 55)).wrapping_add(i64::from(c))
}

/// Hashes the length and each byte; both as `char` in C, which is signed on the platform of LCM's origin.
fn steps(v: i64, text: &str) -> i64 {
    text.bytes().fold(step(v, text.len() as i8), |v, byte| step(v, byte as i8))
}

/// Hash of a definition alone, without the type's own name, the names of compound types, and constants.
pub fn base(definition: &Definition) -> u64 {
    let members = match &definition.kind {
        Kind::Struct { members, .. } => members,
        Kind::Enum { .. } => return steps(0x8765_4321, &definition.short) as u64,
    };
    let mut v = 0x1234_5678;
    for member in members {
        v = steps(v, &member.name);
        if let MemberType::Primitive(primitive) = member.ty {
            v = steps(v, primitive.name());
        }
        v = step(v, member.dims.len() as i8);
        for dim in &member.dims {
            v = steps(step(v, i8::from(dim.size == Size::Variable)), &dim.text);
        }
    }
    v as u64
}

/// Fingerprint of a struct from its own hash and the sum of its compound members' fingerprints.
pub fn full(base: u64, members: u64) -> u64 {
    base.wrapping_add(members).rotate_left(1)
}
