//! Mappings typed from CiA 301; frames as the EPOS has them.

use super::*;
use crate::Dictionary;
use crate::Node;
use crate::dictionary::DataType;
use crate::master::ConfigWrite;
use base::{Duration, Instant};
use std::vec::Vec;

fn epos() -> Layout {
    Layout::new(&[0x6040_0010, 0x60FF_0020]).unwrap().with_name((0x6040, 0), "Controlword", DataType::U16).with_name(
        (0x60FF, 0),
        "Target velocity",
        DataType::I32,
    )
}

#[test]
fn a_mapping_entry_is_index_sub_and_bits() {
    let mapped = Mapped { index: 0x6040, sub: 2, bits: 16 };
    assert_eq!((u32::from(mapped), Mapped::from(0x6040_0210)), (0x6040_0210, mapped));
    assert!(Mapped::new(0x0005_0008).is_dummy() && !mapped.is_dummy());
}

#[test]
fn values_are_packed_by_name_and_by_object() {
    let layout = epos();
    let frame = layout.pack([("controlword", 0x0F), ("TARGET-VELOCITY", -1500)]).unwrap();
    assert_eq!(&*frame, &[0x0F, 0x00, 0x24, 0xFA, 0xFF, 0xFF]);
    assert_eq!(layout.pack([((0x6040, 0), 0x0F), ((0x60FF, 0), -1500)]).unwrap(), frame);
    assert_eq!(layout.get(&frame, "target_velocity"), Some(-1500));
    assert_eq!((layout.get(&frame, 0), layout.get(&frame, 2), layout.get(&frame, "speed")), (Some(15), None, None));
    let all: Vec<_> = layout.unpack(&frame).unwrap().map(|(item, value)| (&*item.name, value)).collect();
    assert_eq!(all, [("Controlword", 15), ("Target velocity", -1500)]);
    let mut changed = frame;
    layout.set(&mut changed, "Controlword", 0x06).unwrap();
    assert_eq!(&*changed, &[0x06, 0x00, 0x24, 0xFA, 0xFF, 0xFF]);
}

#[test]
fn a_frame_that_is_too_short_has_no_values_and_a_longer_one_its_first_bytes() {
    let layout = epos();
    assert!(layout.unpack(&[0; 5]).is_none() && layout.get(&[0; 5], "Controlword").is_none());
    assert_eq!(layout.get(&[1, 0, 0, 0, 0, 0, 9, 9], "Controlword"), Some(1));
}

#[test]
fn a_value_that_does_not_fit_is_refused_not_cut() {
    let layout = epos();
    let refused = |name, value| layout.pack([(name, value)]).unwrap_err();
    assert_eq!(refused("Controlword", 0x1_0000), PackError::OutOfRange { value: 0x1_0000, bits: 16 });
    assert_eq!(refused("Controlword", -1), PackError::OutOfRange { value: -1, bits: 16 });
    assert_eq!(refused("Target velocity", 1 << 31), PackError::OutOfRange { value: 1 << 31, bits: 32 });
    assert_eq!(refused("Speed", 0), PackError::Unknown);
    let unknown = Layout::new(&[0x2000_0008]).unwrap();
    let fits: Vec<_> = [-129, -128, 255, 256].map(|value| unknown.pack([(0, value)]).is_ok()).into();
    assert_eq!(fits, [false, true, true, false]);
}

#[test]
fn bits_lie_side_by_side() {
    // Two BOOLEANs, six bits of a gap, 3 bits, 5 bits with a sign, 48 bits.
    let entries = [0x2005_0001, 0x2006_0001, 0x0005_0006, 0x2007_0003, 0x2008_0005, 0x2009_0030];
    let layout = Layout::new(&entries).unwrap().with_name((0x2008, 0), "tilt", DataType::I8);
    assert_eq!((layout.bits(), layout.len()), (64, 8));
    let frame = layout.pack([(0, 1), (1, 1), (3, 0b101), (4, -2), (5, 0x1122_3344_5566)]).unwrap();
    assert_eq!(&*frame, &[0b11, 0b1111_0101, 0x66, 0x55, 0x44, 0x33, 0x22, 0x11]);
    let values: Vec<_> = layout.unpack(&frame).unwrap().map(|(_, value)| value).collect();
    assert_eq!(values, [1, 1, 0b101, -2, 0x1122_3344_5566]);
    let short = Layout::new(&[0x2005_0001, 0x2006_0001]).unwrap();
    assert_eq!(&*short.pack([(1, 1)]).unwrap(), &[2]);
}

#[test]
fn a_whole_frame_may_be_one_value() {
    let layout = Layout::new(&[0x2000_0040]).unwrap().with_name((0x2000, 0), "distance", DataType::F64);
    let value = 0.25_f64.to_bits() as i64;
    let frame = layout.pack([(0, value)]).unwrap();
    assert_eq!((layout.get(&frame, 0), layout.items()[0].show(value)), (Some(value), "0.25".into()));
    let layout = Layout::new(&[0x2000_0040]).unwrap().with_name((0x2000, 0), "count", DataType::U64);
    assert_eq!(layout.items()[0].show(-1), "18446744073709551615");
}

#[test]
fn what_no_pdo_can_hold_is_refused() {
    assert_eq!(Layout::new(&[0x2000_0040, 0x2001_0001]), Err(LayoutError::TooLong { bits: 65 }));
    assert_eq!(Layout::new(&[0x2000_00FF]), Err(LayoutError::TooLong { bits: 255 }));
    assert_eq!(Layout::new(&[0x2000_0001; 65]), Err(LayoutError::TooManyEntries { count: 65 }));
    assert_eq!(Layout::new(&[0x2000_0008, 0x2000_0000]), Err(LayoutError::NoBits { sub: 2 }));
    assert_eq!(Layout::new(&[0x2000_0001; 64]).unwrap().len(), 8);
    assert_eq!(Layout::new(&[]).unwrap().len(), 0);
}

fn shown(writes: &[ConfigWrite]) -> Vec<(u16, u8, u32)> {
    writes.iter().map(|write| (write.index, write.sub, write.value.bits().unwrap())).collect()
}

#[test]
fn a_mapping_is_changed_in_the_order_of_the_standard() {
    let writes = remap(0x1803, 0x4000_0481, &[0x6041_0010, 0x606C_0020], 255, Some(100), None);
    assert_eq!(
        shown(&writes),
        [
            (0x1803, 1, 0xC000_0481),
            (0x1A03, 0, 0),
            (0x1A03, 1, 0x6041_0010),
            (0x1A03, 2, 0x606C_0020),
            (0x1A03, 0, 2),
            (0x1803, 2, 255),
            (0x1803, 3, 100),
            (0x1803, 1, 0x4000_0481),
        ]
    );
    let off = remap(0x1400, 0x8000_0201, &[], 255, None, None);
    assert_eq!(shown(&off), [(0x1400, 1, 0x8000_0201), (0x1600, 0, 0), (0x1400, 2, 255)]);
}

/// A node answers both procedures; `None` where it refuses.
fn read(dictionary: &Dictionary, record: u16) -> Option<Pdo> {
    let mut reading = read_plan(record);
    while let Some((index, sub)) = reading.object() {
        reading.found(dictionary.read(index, sub).ok().as_deref());
    }
    reading.finish()
}

#[test]
fn a_node_takes_what_was_remapped_and_reads_back_the_same() {
    let now = Instant::from_millis(1);
    let mut node = Node::new(crate::drives::epos::dictionary(1), Duration::ZERO);
    node.power_on(now);
    node.handle_timeout(now);
    let wanted = Pdo {
        record: 0x1801,
        cob_id: 0x4000_0281,
        kind: 1,
        inhibit: Some(50),
        event_timer: None,
        entries: [0x606C_0020, 0x6041_0010].into(),
    };
    let mut client = crate::sdo::Client::new(Duration::from_millis(500));
    for write in wanted.writes() {
        assert!(client.write(now, write.index, write.sub, write.value));
        while let Some(request) = client.poll_tx() {
            node.handle_rx(now, &base::can::Frame::standard(0x601, &request));
            while let Some(frame) = node.poll_tx() {
                if frame.id() == base::can::Id::Standard(0x581) {
                    client.handle_rx(now, frame.data());
                }
            }
        }
        assert!(client.poll_done().unwrap().result.is_ok(), "{:04X}:{}", write.index, write.sub);
    }
    assert_eq!(read(node.dictionary(), 0x1801).as_ref(), Some(&wanted));
    assert_eq!((wanted.id(), wanted.layout().unwrap().len()), (Some(0x281), 6));
}

#[test]
fn a_record_that_is_missing_or_makes_no_sense_is_not_learnt() {
    let dictionary = crate::drives::epos::dictionary(1);
    assert_eq!(read(&dictionary, 0x1900), None);
    let mut reading = read_plan(0x1400);
    for data in [&[1, 2, 0, 0][..], &[255], &[], &[254]] {
        reading.found(Some(data));
    }
    assert_eq!((reading.object(), reading.finish()), (None, None));
}
