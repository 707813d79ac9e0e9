//! The drives' tables against their EDS and literal frames.

use super::cia402::{Status, pack};
use super::{epos, icla};
use crate::Dictionary;
use crate::eds::Eds;
use std::vec::Vec;

/// Same objects, same defaults, same types, same access, same limits.
fn compare(dictionary: &Dictionary, eds: &[u8]) {
    let eds = Eds::parse(eds).unwrap();
    assert!(eds.objects().len() > 150, "{} objects", eds.objects().len());
    let (ours, theirs) = (dictionary.described(), eds.dictionary(dictionary.node()).described());
    let differ: Vec<_> = ours.iter().filter(|object| !theirs.contains(object)).collect();
    let missing: Vec<_> = theirs.iter().filter(|object| !ours.contains(object)).collect();
    assert!(differ.is_empty() && missing.is_empty(), "table: {differ:#?}\nEDS: {missing:#?}");
}

#[test]
fn the_dictionaries_are_those_of_the_eds_files() {
    compare(&epos::dictionary(1), include_bytes!("../../eds/epos_sim.eds"));
    compare(&icla::dictionary(2), include_bytes!("../../eds/icla_sim.eds"));
}

#[test]
fn pdos_are_packed_as_on_the_wire() {
    assert_eq!(pack(0x0F, 1500), [0x0F, 0x00, 0xDC, 0x05, 0x00, 0x00]);
    assert_eq!(pack(0x0F, -1500), [0x0F, 0x00, 0x24, 0xFA, 0xFF, 0xFF]);
    let status = Status { statusword: 0x0237, value: Some(-1500) };
    assert_eq!(epos::PDOS.unpack(4, &[0x37, 0x02, 0x24, 0xFA, 0xFF, 0xFF]), Some(status));
    assert_eq!(epos::PDOS.unpack(1, &[0x37, 0x02]), Some(Status { value: None, ..status }));
    assert_eq!((epos::PDOS.unpack(4, &[0x37, 0x02, 0, 0, 0]), epos::PDOS.unpack(2, &[0; 8])), (None, None));
    let status = Status { statusword: 0x1237, value: Some(-2) };
    assert_eq!(icla::PDOS.unpack(2, &[0x37, 0x12, 0xFE, 0xFF, 0xFF, 0xFF]), Some(status));
    assert_eq!((icla::PDOS.unpack(1, &[0x37]), icla::PDOS.unpack(3, &[0; 8])), (None, None));
}
