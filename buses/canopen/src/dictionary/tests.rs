//! Refusals, limits, resets.

use super::*;
use Access::{Const, ReadOnly, ReadWrite, ReadWriteReceive, ReadWriteTransmit, WriteOnly};
use DataType::{Bool, F32, F64, I8, I24, I32, Text, TimeOfDay, U8, U16, U32, U64};

fn dictionary() -> Dictionary {
    Dictionary::new(5).with(&[
        Entry::new(0x6060, 0, I8, ReadWrite, 1),
        Entry::new(0x1008, 0, Text, Const, 0).text("EPOS"),
        Entry::new(0x1000, 0, U32, ReadOnly, 0x0002_0192),
        Entry::new(0x1018, 0, U8, ReadOnly, 4),
        Entry::new(0x1018, 1, U32, ReadOnly, 0xFB),
        Entry::new(0x2F01, 0, U16, WriteOnly, 0),
        Entry::new(0x2F02, 0, Bool, ReadWrite, 0),
        Entry::new(0x607F, 0, U32, ReadWrite, 25000).limits(1, 25000),
        Entry::new(0x60FF, 0, I32, ReadWrite, 0).mappable(),
        Entry::new(0x1014, 0, U32, ReadOnly, 0x80).plus_node_id(),
    ])
}

#[test]
fn each_refusal_has_its_abort_code() {
    let mut objects = dictionary();
    for (index, sub, data, expected) in [
        (0x5000, 0, &[1][..], Abort::NO_OBJECT),
        (0x1018, 9, &[1], Abort::NO_SUB_INDEX),
        (0x1000, 0, &[1, 0, 0, 0], Abort::READ_ONLY),
        (0x1008, 0, b"x", Abort::READ_ONLY),
        (0x6060, 0, &[1, 0], Abort::TOO_LONG),
        (0x60FF, 0, &[1, 0], Abort::TOO_SHORT),
        (0x607F, 0, &[0xA9, 0x61, 0, 0], Abort::TOO_HIGH),
        (0x607F, 0, &[0, 0, 0, 0], Abort::TOO_LOW),
        (0x2F02, 0, &[2], Abort::TOO_HIGH),
    ] {
        assert_eq!(objects.write(index, sub, data), Err(expected), "{index:04X}:{sub}");
    }
    assert_eq!(objects.read(0x2F01, 0), Err(Abort::WRITE_ONLY));
    assert_eq!(objects.read(0x1018, 2), Err(Abort::NO_SUB_INDEX));
}

#[test]
fn numbers_keep_their_sign_and_texts_their_bytes() {
    let mut objects = dictionary();
    objects.write(0x60FF, 0, &[0x24, 0xFA, 0xFF, 0xFF]).unwrap();
    assert_eq!(objects.get(0x60FF, 0), Some(-1500));
    assert_eq!(&*objects.read(0x60FF, 0).unwrap(), &[0x24, 0xFA, 0xFF, 0xFF]);
    objects.write(0x6060, 0, &[0xFF]).unwrap();
    assert_eq!(objects.get(0x6060, 0), Some(-1));
    assert_eq!(&*objects.read(0x1008, 0).unwrap(), b"EPOS");
    assert_eq!(objects.get(0x1014, 0), Some(0x85));
    assert!(!objects.set(0x6060, 0, 0xFF) && objects.set(0x6060, 0, 3));
}

#[test]
fn stored_values_survive_a_reset_and_defaults_come_back() {
    let mut objects = dictionary();
    objects.set(0x607F, 0, 100);
    objects.store();
    objects.set(0x607F, 0, 200);
    objects.reset(0x2000..=0x9FFF);
    assert_eq!(objects.get(0x607F, 0), Some(100));
    objects.restore();
    assert_eq!(objects.get(0x607F, 0), Some(100));
    objects.reset(0x2000..=0x9FFF);
    assert_eq!(objects.get(0x607F, 0), Some(25000));
}

#[test]
fn every_type_is_held_within_its_limits() {
    let real = |value: f32| i64::from(value.to_bits());
    let mut objects = Dictionary::new(1).with(&[
        Entry::new(0x2000, 0, U64, ReadWrite, 0).limits(1, -2),
        Entry::new(0x2001, 0, F32, ReadWrite, real(1.0)).limits(real(-1.5), real(2.0)),
        Entry::new(0x2002, 0, I24, ReadWrite, -1).limits(-5, 5),
        Entry::new(0x2003, 0, F64, ReadWrite, 0),
        Entry::new(0x2004, 0, TimeOfDay, ReadWrite, 0),
        Entry::new(0x2005, 0, I24, ReadWriteReceive, 0).mappable(),
        Entry::new(0x2006, 0, U64, ReadWriteTransmit, 0).mappable(),
    ]);
    for (index, data, expected) in [
        (0x2000, &u64::MAX.to_le_bytes()[..], Err(Abort::TOO_HIGH)),
        (0x2000, &(u64::MAX - 1).to_le_bytes(), Ok(())),
        (0x2000, &[0; 8], Err(Abort::TOO_LOW)),
        (0x2001, &(-1.6_f32).to_le_bytes(), Err(Abort::TOO_LOW)),
        (0x2001, &(-1.4_f32).to_le_bytes(), Ok(())),
        (0x2001, &2.1_f32.to_le_bytes(), Err(Abort::TOO_HIGH)),
        (0x2001, &f32::NAN.to_le_bytes(), Err(Abort::RANGE)),
        (0x2002, &[0xFA, 0xFF, 0xFF], Err(Abort::TOO_LOW)),
        (0x2002, &[0xFB, 0xFF, 0xFF], Ok(())),
        (0x2003, &f64::INFINITY.to_le_bytes(), Ok(())),
        (0x2003, &f64::NAN.to_le_bytes(), Err(Abort::RANGE)),
        (0x2004, &[0xFF; 6], Ok(())),
        (0x2004, &[0xFF; 5], Err(Abort::TOO_SHORT)),
    ] {
        assert_eq!(objects.write(index, 0, data), expected, "{index:04X} {data:02X?}");
        if expected.is_ok() {
            assert_eq!(&*objects.read(index, 0).unwrap(), data);
        }
    }
    assert_eq!((objects.get(0x2000, 0), objects.get(0x2002, 0)), (Some(-2), Some(-5)));
    let maps = |index, bits, received| objects.find_mappable(index, 0, bits, received).is_ok();
    assert_eq!([maps(0x2005, 24, true), maps(0x2005, 24, false)], [true, false]);
    assert_eq!([maps(0x2006, 64, true), maps(0x2006, 64, false)], [false, true]);
}
