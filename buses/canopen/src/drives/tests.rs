//! The drives' tables against their EDS and literal frames.

use super::cia402::Status;
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
    assert_eq!(epos::TABLE.pack(0x0F, 1500), [0x0F, 0x00, 0xDC, 0x05, 0x00, 0x00]);
    assert_eq!(icla::TABLE.pack(0x0F, -1500), [0x0F, 0x00, 0x24, 0xFA, 0xFF, 0xFF]);
    let status = Status { statusword: Some(0x0237), value: Some(-1500), torque: None };
    let epos = |number, data: &[u8]| epos::TABLE.unpack(number, data);
    assert_eq!(epos(4, &[0x37, 0x02, 0x24, 0xFA, 0xFF, 0xFF]), Some(status));
    assert_eq!(epos(1, &[0x37, 0x02]), Some(Status { value: None, ..status }));
    assert_eq!((epos(4, &[0x37, 0x02, 0, 0, 0]), epos(2, &[0; 8])), (None, None));
    let status = Status { statusword: Some(0x1237), value: Some(-2), torque: None };
    let icla = |number, data: &[u8]| icla::TABLE.unpack(number, data);
    assert_eq!(icla(2, &[0x37, 0x12, 0xFE, 0xFF, 0xFF, 0xFF]), Some(status));
    assert_eq!((icla(1, &[0x37]), icla(3, &[0; 8])), (None, None));
}

/// The frames of a boot-up stay what they were when both drives were code: written out.
#[test]
fn the_tables_write_these_objects_in_this_order() {
    let objects = |config: &crate::NodeConfig| -> Vec<_> {
        config.writes.iter().map(|write| (write.index, write.sub, write.value.bits().unwrap())).collect()
    };
    let epos = epos::node_config("propulsion", &epos::parameters(1));
    let ramps = [(0x6083, 0, 10_000), (0x6084, 0, 10_000), (0x6085, 0, 10_000)];
    let tpdo =
        |record, cob_id: u32| [(record, 1, cob_id | 1 << 31), (record, 2, 255), (record, 3, 100), (record, 1, cob_id)];
    assert_eq!(
        objects(&epos),
        [&[(0x6060, 0, 3), (0x607F, 0, 25_000)][..], &ramps, &tpdo(0x1803, 0x4000_0481)].concat()
    );
    let farewell = epos.farewell.unwrap();
    assert_eq!(
        (farewell.number, &farewell.data[..], farewell.pause.as_millis()),
        (4, &[0x0B, 0, 0, 0, 0, 0][..], 2000)
    );
    let icla = icla::node_config("steering", &icla::parameters(2));
    let ramps = [(0x6083, 0, 6_000), (0x6084, 0, 6_000), (0x6085, 0, 20_000), (0x605A, 0, 6), (0x6007, 0, 3)];
    assert_eq!(objects(&icla), [&[(0x6060, 0, 1), (0x6081, 0, 600)][..], &ramps, &tpdo(0x1801, 0x4000_0282)].concat());
    assert_eq!(icla.farewell.unwrap().pause.as_millis(), 30);
    assert!([&epos.mappings, &icla.mappings].iter().all(|all| all.len() == 3 && all.iter().all(|pdo| !pdo.adjust)));
}
