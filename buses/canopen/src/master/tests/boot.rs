//! The boot-up of a node.

use super::*;

#[test]
fn both_drives_boot_and_take_pdos() {
    let mut bus = robot(MasterConfig::default());
    assert_eq!(bus.master.send_pdo(1, 4, &epos::TABLE.pack(0x0F, 1500)), Err(PdoError::NotOperational));
    bus.run_to(500, is_booted(1));
    bus.run(200);
    assert_eq!([1, 2].map(|id| bus.master.state(id)), [Some(State::Operational); 2], "{:#?}", bus.events);
    bus.master.send_pdo(1, 4, &epos::TABLE.pack(0x0F, 1500)).unwrap();
    bus.run(1);
    assert_eq!(bus.nodes[0].get(0x60FF, 0), Some(1500));
    assert_eq!(bus.nodes[0].get(0x6040, 0), Some(0x0F));
}

#[test]
fn a_node_that_has_not_heard_its_reset_is_reset_again() {
    let config = NodeConfig { device_type: Some(0x0002_0192), ..NodeConfig::new(1, "propulsion") };
    let mut master = Master::new(MasterConfig::default(), &[config]).unwrap();
    check(
        &mut master,
        "
          0ms < 77F 05
          0ms < 000 82 01
         40ms > 701 05
         50ms < 77F 05
         90ms > 701 05                         # it may still be at it
        100ms < 77F 05
        140ms > 701 05
        140ms < 000 82 01
        145ms > 701 00
        145ms < 601 40 00 10 00 00 00 00 00
        ",
    );
}

#[test]
fn a_boot_up_on_the_wire() {
    let config = NodeConfig {
        device_type: Some(0x0002_0192),
        stop: Some(ConfigWrite::new(0x6040, 0, 0x0B_u16).blindly()),
        identity: [Expect::equal(0x1018, 1, 0xFB)].into(),
        writes: [ConfigWrite::new(0x6060, 0, 3_i8)].into(),
        mappings: [PdoMapping::rpdo(1, 4, &[0x6040_0010])].into(),
        master_limit: Some(Duration::from_millis(200)),
        ..NodeConfig::new(1, "propulsion")
    };
    let mut master = Master::new(MasterConfig::default(), &[config]).unwrap();
    check(
        &mut master,
        "
          0ms < 77F 05
          0ms < 000 82 01
          5ms > 701 00
          5ms < 601 40 00 10 00 00 00 00 00
          6ms > 581 43 00 10 00 92 01 02 00
          6ms < 601 2B 40 60 00 0B 00 00 00     # it may turn since before the reset
          6ms > 581 60 40 60 00 00 00 00 00
          6ms < 601 40 18 10 01 00 00 00 00
          7ms > 581 43 18 10 01 FB 00 00 00
          7ms < 601 40 18 10 04 00 00 00 00     # the one that was here before?
          7ms > 581 43 18 10 04 55 44 33 22
          7ms < 601 40 60 60 00 00 00 00 00     # as it shall be?
          8ms > 581 4F 60 60 00 01 00 00 00
          8ms < 601 2F 60 60 00 03 00 00 00
          8ms > 581 60 60 60 00 00 00 00 00
          8ms < 601 40 60 60 00 00 00 00 00     # read back
          9ms > 581 4F 60 60 00 03 00 00 00
          9ms < 601 40 03 14 01 00 00 00 00     # RPDO4 as expected?
         10ms > 581 43 03 14 01 01 05 00 00
         10ms < 601 40 03 16 00 00 00 00 00
         11ms > 581 4F 03 16 00 01 00 00 00
         11ms < 601 40 03 16 01 00 00 00 00
         12ms > 581 43 03 16 01 10 00 40 60
         12ms < 601 40 16 10 01 00 00 00 00
         12ms > 581 43 16 10 01 00 00 00 00
         12ms < 601 23 16 10 01 C8 00 7F 00     # watch us
         13ms > 581 60 16 10 01 00 00 00 00
         13ms < 601 40 16 10 01 00 00 00 00
         14ms > 581 43 16 10 01 C8 00 7F 00
         14ms < 601 40 17 10 00 00 00 00 00
         16ms > 581 4B 17 10 00 64 00 00 00     # is sent already
         20ms > 701 7F
         20ms < 000 01 01
         50ms < 77F 05
        100ms < 77F 05
        120ms > 701 05
        120ms < booted 1
        120ms < Ready
        150ms < 77F 05
        200ms < 77F 05
        220ms > 701 05
        250ms < 77F 05
        300ms < 77F 05
        350ms < 77F 05
        400ms < 77F 05
        420ms < 000 82 01
        420ms < lost 1: heartbeat missing
        420ms < NotReady
        450ms < 77F 05
        ",
    );
}

#[test]
fn a_drive_whose_boot_up_message_is_lost_is_told_to_stop_meanwhile() {
    let config = NodeConfig {
        device_type: Some(0x0002_0192),
        stop: Some(ConfigWrite::new(0x6040, 0, 0x0B_u16).blindly()),
        ..NodeConfig::new(1, "propulsion")
    };
    let beats = MasterConfig { heartbeat: Duration::from_secs(60), ..MasterConfig::default() };
    let mut master = Master::new(beats, &[config]).unwrap();
    check(
        &mut master,
        "
          0ms < 77F 05
          0ms < 000 82 01
         50ms < 601 2B 40 60 00 0B 00 00 00     # not there yet
        100ms < 601 2B 40 60 00 0B 00 00 00
        101ms > 581 60 40 60 00 00 00 00 00     # it stops; its boot-up message may still come
        150ms < 601 2B 40 60 00 0B 00 00 00
        160ms > 701 00
        160ms < 601 40 00 10 00 00 00 00 00
        161ms > 581 60 40 60 00 00 00 00 00     # late
        162ms > 581 43 00 10 00 92 01 02 00
        162ms < 601 2B 40 60 00 0B 00 00 00
        ",
    );
}

#[test]
fn a_silent_node_is_asked_three_times_then_reported_once_and_tried_for_ever() {
    let config = MasterConfig { heartbeat: Duration::from_secs(60), ..MasterConfig::default() };
    let mut master = Master::new(config, &[NodeConfig::new(1, "propulsion")]).unwrap();
    check(
        &mut master,
        "
           0ms < 77F 05
           0ms < 000 82 01
        1000ms < 601 40 00 10 00 00 00 00 00    # no boot-up message: ask anyway
        1500ms < 601 80 00 10 00 00 00 04 05
        1500ms < 601 40 00 10 00 00 00 00 00
        2000ms < 601 80 00 10 00 00 00 04 05
        2000ms < 601 40 00 10 00 00 00 00 00
        2500ms < 601 80 00 10 00 00 00 04 05
        2500ms < failed 1 device type: 0x1000:0 no answer in time
        3500ms < 000 82 01
        4500ms < 601 40 00 10 00 00 00 00 00
        5000ms < 601 80 00 10 00 00 00 04 05
        5000ms < 601 40 00 10 00 00 00 00 00
        5500ms < 601 80 00 10 00 00 00 04 05
        5500ms < 601 40 00 10 00 00 00 00 00
        6000ms < 601 80 00 10 00 00 00 04 05
        6500ms > 701 00                         # it comes: no more waiting
        6500ms < 000 82 01
        6505ms > 701 00
        6505ms < 601 40 00 10 00 00 00 00 00
        6506ms > 581 80 00 10 00 C0 FF 00 0F
        6506ms < failed 1 device type: 0x1000:0 refused: unknown abort code (0x0F00FFC0)
        6600ms > 701 7F
        ",
    );
}

/// Boots the robot with its first twin changed; gives the failure, and proves that nothing enables it.
fn refused(change: impl Fn(Dictionary) -> Dictionary) -> (Step, BootError) {
    let mut bus = robot(MasterConfig::default());
    bus.nodes[0] = Node::new(change(epos::dictionary(1)), Duration::from_millis(5));
    bus.nodes[0].power_on(bus.now);
    bus.run(5000);
    let ours = |(_, event): &(Instant, Event)| match event {
        Event::BootFailed { node: 1, step, reason } => Some((*step, *reason)),
        _ => None,
    };
    let failures: Vec<_> = bus.events.iter().filter_map(ours).collect();
    assert_eq!(failures.len(), 1, "once for each cause: {failures:?}");
    assert!(!bus.events.iter().any(|(_, event)| is_booted(1)(event)));
    assert_eq!(bus.master.state(2), Some(State::Operational), "the other one is not held up");
    let enabling = |(_, frame): &(Instant, Frame)| matches!(Service::of(frame), Some(Service::Rpdo { node: 1, .. }));
    assert!(!bus.sent.iter().any(enabling));
    let stopped = bus.nodes[0].get(0x6040, 0) == Some(0x0B);
    assert_eq!(stopped, failures[0].0 != Step::DeviceType, "what is a drive is stopped, and nothing else");
    failures[0]
}

#[test]
fn what_is_not_the_configured_drive_is_refused() {
    use crate::dictionary::{Access, DataType, Entry};
    let number = |index, sub, value| {
        let data_type = if index == 0x2003 { DataType::U16 } else { DataType::U32 };
        move |objects: Dictionary| objects.with(&[Entry::new(index, sub, data_type, Access::ReadOnly, value)])
    };
    let mismatch = |index, sub, expected, found| BootError::Mismatch { index, sub, expected, found };
    assert_eq!(refused(number(0x1000, 0, 0x191)), (Step::DeviceType, mismatch(0x1000, 0, 0x0002_0192, 0x191)));
    assert_eq!(refused(number(0x1018, 1, 0x5A)), (Step::Identity, mismatch(0x1018, 1, 0xFB, 0x5A)));
    assert_eq!(refused(number(0x2003, 2, 0x6010)), (Step::Identity, mismatch(0x2003, 2, 0x6410, 0x6010)));
    assert_eq!(refused(number(0x2003, 1, 0x2024)), (Step::Identity, mismatch(0x2003, 1, 0x2030, 0x2024)));
    assert_eq!(
        refused(|objects| objects.with_rpdo(4, 0x500, &[0x6040_0010, 0x206B_0020], false)),
        (Step::Mapping, mismatch(0x1603, 2, 0x60FF_0020, 0x206B_0020))
    );
    assert_eq!(
        refused(|objects| objects.with_rpdo(4, 0x8000_0500, &[0x6040_0010, 0x60FF_0020], false)),
        (Step::Mapping, mismatch(0x1403, 1, 0x501, 0x8000_0501))
    );
    let error = sdo::Error::Refused(crate::Abort::TOO_HIGH);
    assert_eq!(
        refused(|objects| {
            objects.with(&[Entry::new(0x6083, 0, DataType::U32, Access::ReadWrite, 1).limits(0, 9_999)])
        }),
        (Step::Configuration, BootError::Sdo { index: 0x6083, sub: 0, error })
    );
}

#[test]
fn two_nodes_with_one_id_are_refused() {
    let mut bus = booted();
    let twin = Node::new(epos::dictionary(1), Duration::from_millis(9));
    bus.nodes.push(twin);
    bus.nodes[2].power_on(bus.now);
    bus.run(10_000);
    assert_ne!(bus.master.state(1), Some(State::Operational), "{:#?}", bus.events);
}

#[test]
fn a_second_node_that_boots_much_later_is_told_and_the_bus_grows_calm() {
    let mut bus = booted();
    let twin = Node::new(epos::dictionary(1), Duration::from_millis(300));
    bus.nodes.push(twin);
    bus.nodes[2].power_on(bus.now);
    bus.run(20_000);
    let at = |wanted: fn(&Event) -> bool| bus.events.iter().filter(move |(_, event)| wanted(event)).map(|(at, _)| *at);
    assert_eq!(at(|event| matches!(event, Event::DuplicateId { node: 1 })).count(), 1);
    let lost: Vec<_> = at(|event| matches!(event, Event::Lost { node: 1, .. })).collect();
    // Three times at once, then after 1, 2, 4 and 8 s.
    assert!((5..=8).contains(&lost.len()), "{lost:?}");
    assert_eq!(bus.master.state(2), Some(State::Operational), "the other node is not disturbed");
}

#[test]
fn configurations_that_cannot_work_are_refused() {
    let master = MasterConfig::default;
    let node = || NodeConfig::new(1, "a");
    let new = |config, nodes: &[NodeConfig]| Master::new(config, nodes).err();
    let ms = Duration::from_millis;
    assert_eq!(new(MasterConfig { id: 0, ..master() }, &[]), Some(ConfigError::NodeId { node: 0 }));
    assert_eq!(new(master(), &[NodeConfig::new(128, "a")]), Some(ConfigError::NodeId { node: 128 }));
    assert_eq!(new(master(), &[node(), node()]), Some(ConfigError::SameId { node: 1 }));
    assert_eq!(new(MasterConfig { id: 1, ..master() }, &[node()]), Some(ConfigError::SameId { node: 1 }));
    let config = NodeConfig { heartbeat: Duration::ZERO, ..node() };
    assert_eq!(new(master(), &[config]), Some(ConfigError::Period { node: 1 }));
    let config = NodeConfig { heartbeat_limit: ms(100), ..node() };
    assert_eq!(new(master(), &[config]), Some(ConfigError::Limit { node: 1 }));
    let config = NodeConfig { master_limit: Some(ms(50)), ..node() };
    assert_eq!(new(master(), &[config]), Some(ConfigError::Limit { node: 1 }));
    assert_eq!(new(master(), &[node()]), None);
}
