//! What a node is told, and what it is not.

use super::*;
use crate::dictionary::{Access, DataType, Entry};

/// A node's objects as it keeps them through a reset.
fn kept(objects: Dictionary, entries: &[(u16, u8, DataType, i64)]) -> Dictionary {
    let entries: Vec<_> = entries
        .iter()
        .map(|(index, sub, data_type, value)| Entry::new(*index, *sub, *data_type, Access::ReadWrite, *value))
        .collect();
    objects.with(&entries)
}

fn serial(number: i64) -> Entry {
    Entry::new(0x1018, 4, DataType::U32, Access::ReadOnly, number)
}

#[test]
fn what_a_node_holds_already_is_not_written() {
    let config = NodeConfig {
        writes: [ConfigWrite::new(0x6060, 0, 3_i8), ConfigWrite::new(0x6083, 0, 777_u32)].into(),
        master_limit: Some(Duration::from_millis(200)),
        ..NodeConfig::new(1, "a")
    };
    let mut bus = one(MasterConfig::default(), config.clone(), epos::dictionary(1));
    bus.run_to(500, is_booted(1));
    assert_eq!(written(&bus, 1, 0), [(0x6060, 0), (0x6083, 0), (0x1016, 1), (0x1017, 0)]);
    // Booted again without a power cycle: of its own profile it has forgotten nothing.
    let from = bus.sent.len();
    bus.master.reboot(bus.now, 1);
    bus.run_to(1000, is_booted(1));
    assert_eq!(written(&bus, 1, from), [(0x1016, 1), (0x1017, 0)]);
    // And one that kept everything is told nothing.
    let objects = kept(
        epos::dictionary(1),
        &[
            (0x6060, 0, DataType::I8, 3),
            (0x6083, 0, DataType::U32, 777),
            (0x1016, 1, DataType::U32, 0x007F_00C8),
            (0x1017, 0, DataType::U16, 100),
        ],
    );
    let mut bus = one(MasterConfig::default(), config, objects);
    bus.run_to(500, is_booted(1));
    assert_eq!(written(&bus, 1, 0), []);
}

#[test]
fn what_is_written_in_order_is_written_in_full_or_not_at_all() {
    let cob_id = 0x4000_0481_u32;
    let writes: Vec<_> = [
        ConfigWrite::new(0x1803, 1, cob_id | 1 << 31),
        ConfigWrite::new(0x1803, 2, 255_u8),
        ConfigWrite::new(0x1803, 3, 100_u16),
        ConfigWrite::new(0x1803, 1, cob_id),
        ConfigWrite::new(0x6083, 0, 777_u32),
    ]
    .into();
    let config = NodeConfig { writes, ..NodeConfig::new(1, "a") };
    let mut bus = one(MasterConfig::default(), config.clone(), epos::dictionary(1));
    bus.run_to(500, is_booted(1));
    let pdo = [(0x1803, 1), (0x1803, 2), (0x1803, 3), (0x1803, 1)];
    assert_eq!(written(&bus, 1, 0)[..4], pdo);
    assert_eq!(bus.nodes[0].get(0x1803, 1), Some(i64::from(cob_id)));
    // A node that keeps it is left alone; where one object of them differs, all are written.
    for (inhibit, expected) in [(100, &[][..]), (99, &pdo)] {
        let config = NodeConfig { reset: false, ..config.clone() };
        let mut bus = one(MasterConfig::default(), config, epos::dictionary(1));
        bus.nodes[0].set(0x1803, 3, inhibit);
        bus.nodes[0].set(0x1803, 1, i64::from(cob_id));
        bus.nodes[0].set(0x6083, 0, 777);
        bus.run_to(500, is_booted(1));
        let written = written(&bus, 1, 0);
        assert_eq!(written[..written.len() - 1], *expected, "{inhibit}");
    }
}

#[test]
fn objects_that_cannot_be_read_are_written_all_the_same() {
    let hidden = Entry::new(0x2F00, 1, DataType::U32, Access::WriteOnly, 0);
    let writes = [
        ConfigWrite::new(0x2F00, 1, 5_u32),
        ConfigWrite::new(0x6083, 0, 10_000_u32).always(),
        ConfigWrite::new(0x6084, 0, 4_000_u32).blindly(),
    ];
    let config = NodeConfig { writes: writes.into(), ..NodeConfig::new(1, "a") };
    let mut bus = one(MasterConfig::default(), config, epos::dictionary(1).with(&[hidden]));
    bus.run_to(500, is_booted(1));
    assert_eq!(written(&bus, 1, 0)[..3], [(0x2F00, 1), (0x6083, 0), (0x6084, 0)]);
    assert_eq!((bus.nodes[0].get(0x2F00, 1), bus.nodes[0].get(0x6084, 0)), (Some(5), Some(4_000)));
    let read_6084 = Frame::standard(0x601, &[0x40, 0x84, 0x60, 0, 0, 0, 0, 0]);
    assert!(!bus.sent.iter().any(|(_, frame)| *frame == read_6084));
}

#[test]
fn long_values_are_configured_and_compared_too() {
    let text = Entry::new(0x2F01, 0, DataType::Text, Access::ReadWrite, 0);
    let writes = [ConfigWrite::new(0x2F01, 0, &b"a name of some length"[..])];
    let config = NodeConfig { writes: writes.into(), ..NodeConfig::new(1, "a") };
    let mut bus = one(MasterConfig::default(), config, epos::dictionary(1).with(&[text]));
    bus.run_to(500, is_booted(1));
    let from = bus.sent.len();
    bus.master.reboot(bus.now, 1);
    bus.run_to(1000, is_booted(1));
    assert_eq!(written(&bus, 1, from), [(0x1017, 0)]);
}

#[test]
fn a_mapping_is_changed_by_the_procedure_where_that_is_allowed() {
    // RPDO2 of the twin carries controlword and mode.
    let mapping = PdoMapping::rpdo(1, 2, &[0x6040_0010, 0x607A_0020]);
    let config = |mapping| NodeConfig { mappings: [mapping].into(), ..NodeConfig::new(1, "a") };
    let mut bus = one(MasterConfig::default(), config(mapping.clone()), epos::dictionary(1));
    bus.run(500);
    let error = BootError::Mismatch { index: 0x1601, sub: 2, expected: 0x607A_0020, found: 0x6060_0008 };
    assert_eq!(told(&bus, 0), [Event::BootFailed { node: 1, step: Step::Mapping, reason: error }]);

    let mut bus = one(MasterConfig::default(), config(mapping.clone().adjusted()), epos::dictionary(1));
    bus.run_to(500, is_booted(1));
    let procedure = [(0x1401, 1), (0x1601, 0), (0x1601, 1), (0x1601, 2), (0x1601, 0), (0x1401, 2), (0x1401, 1)];
    assert_eq!(written(&bus, 1, 0)[..7], procedure);
    bus.master.send_pdo(1, 2, &[0x06, 0, 0x39, 0x30, 0, 0]).unwrap();
    bus.run(1);
    assert_eq!(bus.nodes[0].get(0x607A, 0), Some(12345));

    // What is right already is left alone.
    let right = PdoMapping::rpdo(1, 4, &[0x6040_0010, 0x60FF_0020]).adjusted();
    let mut bus = one(MasterConfig::default(), config(right), epos::dictionary(1));
    bus.run_to(500, is_booted(1));
    assert_eq!(written(&bus, 1, 0), [(0x1017, 0)]);
}

#[test]
fn a_stamp_that_is_right_saves_the_configuration() {
    let stamp = Stamp { date: 10_013, time: 43_200_000, store: true };
    let writes = [ConfigWrite::new(0x6060, 0, 3_i8), ConfigWrite::new(0x6083, 0, 777_u32)];
    let config = NodeConfig { writes: writes.into(), stamp: Some(stamp), ..NodeConfig::new(1, "a") };
    let mut bus = one(MasterConfig::default(), config, epos::dictionary(1));
    bus.run_to(500, is_booted(1));
    let all = [(0x6060, 0), (0x6083, 0), (0x1020, 1), (0x1020, 2), (0x1010, 1), (0x1017, 0)];
    assert_eq!(written(&bus, 1, 0), all);
    // It was stored: a power cycle changes nothing.
    let from = bus.sent.len();
    bus.nodes[0].power_on(bus.now);
    bus.run_to(1000, is_booted(1));
    assert_eq!(written(&bus, 1, from), [(0x1017, 0)]);
    let reads = |index: u16| {
        bus.sent[from..].iter().filter(move |(_, frame)| frame.data().get(1..3) == Some(&index.to_le_bytes()))
    };
    assert_eq!(reads(0x6060).count(), 0);
    // Another device with the same stamp is not trusted.
    let stamps = [(0x1020, 1, DataType::U32, 10_013), (0x1020, 2, DataType::U32, 43_200_000)];
    let other = kept(epos::dictionary(1), &stamps).with(&[serial(99)]);
    bus.nodes[0] = Node::new(other, Duration::from_millis(5));
    let from = bus.sent.len();
    bus.nodes[0].power_on(bus.now);
    bus.run_to(1000, |event| *event == Event::Swapped { node: 1, serial: 99 });
    bus.run_to(1000, is_booted(1));
    assert_eq!(written(&bus, 1, from), all);
}

#[test]
fn a_node_that_is_swapped_between_two_boots_is_told_and_configured() {
    let mut bus = booted();
    let other = epos::dictionary(1).with(&[serial(4711)]);
    bus.nodes[0].power_off();
    bus.run(1000);
    bus.nodes[0] = Node::new(other, Duration::from_millis(5));
    bus.nodes[0].power_on(bus.now);
    assert_eq!(bus.nodes[0].get(0x6060, 0), Some(1));
    let from = bus.events.len();
    let swapped = bus.run_to(5000, |event| *event == Event::Swapped { node: 1, serial: 4711 });
    let again = bus.run_to(5000, is_booted(1));
    assert!(swapped < again);
    assert_eq!((bus.nodes[0].get(0x6060, 0), bus.nodes[0].get(0x1803, 1)), (Some(3), Some(0x4000_0481)));
    // Told once.
    bus.master.reboot(bus.now, 1);
    bus.run_to(3000, is_booted(1));
    assert_eq!(told(&bus, from).iter().filter(|event| matches!(event, Event::Swapped { .. })).count(), 1);
}

#[test]
fn rpdos_that_are_not_used_are_switched_off_and_do_nothing_any_more() {
    let mut bus = booted();
    for (at, used) in [(0, 4), (1, 2)] {
        let on = |number: u16| bus.nodes[at].get(0x13FF + number, 1).unwrap() & 1 << 31 == 0;
        assert_eq!([1, 2, 3, 4].map(on), [1, 2, 3, 4].map(|number| number == used), "node {}", at + 1);
    }
    // RPDO2 of the EPOS carries controlword and mode.
    bus.put(usize::MAX, Frame::standard(0x301, &[0x0F, 0x00, 0xFC]));
    bus.run(5);
    assert_eq!((bus.nodes[0].get(0x6060, 0), bus.nodes[0].get(0x6040, 0)), (Some(3), Some(0x0B)));
}

/// A node with these RPDOs: index of the record and COB-ID.
fn with_rpdos(records: &[(u16, u32)]) -> Dictionary {
    let record = |(index, cob_id): &(u16, u32)| {
        [
            Entry::new(*index, 0, DataType::U8, Access::ReadOnly, 2),
            Entry::new(*index, 1, DataType::U32, Access::ReadWrite, i64::from(*cob_id)),
        ]
    };
    let entries: Vec<_> = records.iter().flat_map(record).collect();
    let heartbeat = Entry::new(0x1017, 0, DataType::U16, Access::ReadWrite, 0);
    let device_type = Entry::new(0x1000, 0, DataType::U32, Access::ReadOnly, 0);
    Dictionary::new(1).with(&[device_type, heartbeat]).with(&entries)
}

#[test]
fn rpdos_beyond_the_pre_defined_ones_are_switched_off_too() {
    let config = NodeConfig { only_mapped_rpdos: true, ..NodeConfig::new(1, "any") };
    let gaps = [(0x1401, 0x345), (0x1404, 0x346), (0x1405, 0x8000_0347), (0x1407, 0x348)];
    let later = [(0x1408, 0x349), (0x140A, 0x34A), (0x1414, 0x34B)];
    // Read, written where it is on, read back: the first eight, and up to the first that is missing beyond them.
    let first = [(2, 0), (2, 1), (1, 1), (2, 1), (2, 2), (2, 3), (2, 4), (1, 4), (2, 4), (2, 5), (2, 6)];
    let eighth = [(2, 7), (1, 7), (2, 7)];
    let asked = |config: &NodeConfig, records: &[(u16, u32)]| {
        let mut bus = one(MasterConfig::default(), config.clone(), with_rpdos(records));
        bus.run_to(1000, is_booted(1));
        let frames = bus.sent.iter().filter(|(_, frame)| frame.id() == base::can::Id::Standard(0x601));
        let asked: Vec<_> = frames.map(|(_, frame)| (frame.data()[0] >> 5, frame.data()[1], frame.data()[2])).collect();
        let rpdos = asked.iter().filter(|(_, _, high)| *high == 0x14).map(|(kind, low, _)| (*kind, *low));
        let on =
            records.iter().map(|(index, _)| *index).filter(|index| bus.nodes[0].get(*index, 1).unwrap() >> 31 == 0);
        (rpdos.collect::<Vec<_>>(), on.collect::<Vec<_>>())
    };
    assert_eq!(asked(&config, &gaps), ([&first[..], &eighth, &[(2, 8)]].concat(), vec![]));
    // Beyond the eighth a gap hides what follows it,
    let all = [&gaps[..], &later].concat();
    let ninth = [(2, 8), (1, 8), (2, 8)];
    assert_eq!(asked(&config, &all), ([&first[..], &eighth, &ninth, &[(2, 9)]].concat(), vec![0x140A, 0x1414]));
    // unless the data sheet lists it. What is listed and is no RPDO, or is not there, does nothing.
    let config = NodeConfig { rpdos: vec![0x1407, 0x1414, 0x140A, 0x140A, 0x1600, 0x1500], ..config };
    let (rpdos, on) = asked(&config, &all);
    assert_eq!(on, []);
    assert!(rpdos.starts_with(&[&first[..], &eighth, &[(2, 0x0A), (1, 0x0A), (2, 0x0A)]].concat()), "{rpdos:?}");
    assert_eq!(rpdos.last(), Some(&(2, 9)));
}

#[test]
fn a_node_whose_rpdo_stays_on_is_not_booted() {
    let config = NodeConfig { only_mapped_rpdos: true, ..NodeConfig::new(1, "any") };
    let mut master = Master::new(MasterConfig::default(), &[config]).unwrap();
    check(
        &mut master,
        "
          0ms < 77F 05
          0ms < 000 82 01
          5ms > 701 00
          5ms < 601 40 00 10 00 00 00 00 00
          6ms > 581 43 00 10 00 92 01 02 00
          6ms < 601 40 18 10 04 00 00 00 00
          7ms > 581 80 18 10 04 11 00 09 06
          7ms < 601 40 00 14 01 00 00 00 00
          8ms > 581 43 00 14 01 01 02 00 00
          8ms < 601 23 00 14 01 01 02 00 80     # off
          9ms > 581 60 00 14 01 00 00 00 00
          9ms < 601 40 00 14 01 00 00 00 00
         10ms > 581 43 00 14 01 01 02 00 00     # it says that it is on
         10ms < failed 1 PDO mapping: 0x1400:1 is 0x0, expected 0x80000000
         50ms < 77F 05
        ",
    );
}
