//! The master against nodes on a simulated wire.

use super::*;
use crate::Node;
use crate::drives::{epos, icla};
use crate::testing::{Bus, Engine, Random, check, parse};
use crate::{Dictionary, Event};
use base::Duration;
use std::vec;
use std::vec::Vec;

/// Both drives of the robot and their master; nodes are switched on.
fn robot(config: MasterConfig) -> Bus {
    let epos_parameters = epos::Parameters::new(1);
    let icla_parameters = icla::Parameters::new(2);
    let nodes = [epos::node_config("propulsion", &epos_parameters), icla::node_config("steering", &icla_parameters)];
    let master = Master::new(config, &nodes).unwrap();
    let boot_time = Duration::from_millis(5);
    let twins = vec![Node::new(epos::dictionary(1), boot_time), Node::new(icla::dictionary(2), boot_time)];
    let mut bus = Bus::new(master, twins);
    for node in &mut bus.nodes {
        node.power_on(bus.now);
    }
    bus
}

/// The robot with both drives Operational.
fn booted() -> Bus {
    let mut bus = robot(MasterConfig::default());
    bus.run(500);
    assert_eq!([1, 2].map(|id| bus.master.state(id)), [Some(State::Operational); 2], "{:#?}", bus.events);
    bus
}

fn is_booted(id: u8) -> impl Fn(&Event) -> bool {
    move |event| *event == Event::Booted { node: id }
}

#[test]
fn both_drives_boot_and_take_pdos() {
    let mut bus = robot(MasterConfig::default());
    assert_eq!(bus.master.send_pdo(1, 4, &epos::pack(0x0F, 1500)), Err(PdoError::NotOperational));
    bus.run_to(500, is_booted(1));
    bus.run(200);
    assert_eq!([1, 2].map(|id| bus.master.state(id)), [Some(State::Operational); 2], "{:#?}", bus.events);
    bus.master.send_pdo(1, 4, &epos::pack(0x0F, 1500)).unwrap();
    bus.run(1);
    assert_eq!(bus.nodes[0].get(0x60FF, 0), Some(1500));
    assert_eq!(bus.nodes[0].get(0x6040, 0), Some(0x0F));
}

#[test]
fn a_boot_up_on_the_wire() {
    let config = NodeConfig {
        device_type: Some(0x0002_0192),
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
        6506ms < failed 1 device type: 0x1000:0 refused: EPOS: wrong NMT state (0x0F00FFC0)
        6600ms > 701 7F
        ",
    );
}

#[test]
fn the_heartbeat_keeps_its_grid_however_late_it_is_served() {
    let mut master = Master::new(MasterConfig::default(), &[]).unwrap();
    let mut sent = Vec::new();
    let mut now = Instant::ZERO;
    for _ in 0..20_000 {
        master.handle_timeout(now);
        while let Some(frame) = master.poll_tx() {
            assert_eq!(frame, wire::heartbeat(127, NmtState::Operational));
            sent.push(now);
        }
        let next = master.poll_timeout().unwrap();
        assert_eq!(next.as_nanos() % 50_000_000, 0);
        now = next + Duration::from_micros(sent.len() as u64 % 900);
    }
    let drift = sent.last().unwrap().since(Instant::from_millis(50 * (sent.len() as u64 - 1)));
    assert!(drift < Duration::from_millis(1), "{drift:?} after {} heartbeats", sent.len());
}

#[test]
fn a_node_that_dies_is_lost_in_time_and_no_pdo_follows() {
    for die_after in (0..200).step_by(7) {
        let mut bus = booted();
        bus.run(die_after);
        let died = bus.now;
        bus.nodes[0].power_off();
        let lost = bus.run_to(300, |event| matches!(event, Event::Lost { node: 1, reason: LostReason::Heartbeat }));
        assert!(lost.since(died) <= Duration::from_millis(200), "{:?}", lost.since(died));
        assert_eq!(bus.master.send_pdo(1, 4, &[0; 6]), Err(PdoError::NotOperational));
        bus.master.send_pdo(2, 2, &[0; 6]).unwrap();
        bus.nodes[0].power_on(bus.now);
        bus.run_to(2000, is_booted(1));
        assert_eq!(bus.nodes[0].get(0x6060, 0), Some(3));
    }
}

#[test]
fn a_node_that_reboots_is_lost_at_once_and_set_up_again() {
    let mut bus = booted();
    assert_eq!(bus.nodes[0].get(0x6060, 0), Some(3));
    bus.nodes[0].power_on(bus.now);
    assert_eq!(bus.nodes[0].get(0x6060, 0), Some(1));
    let lost = bus.run_to(10, |event| matches!(event, Event::Lost { node: 1, reason: LostReason::BootUp }));
    let again = bus.run_to(400, is_booted(1));
    assert!(again.since(lost) < Duration::from_millis(300));
    assert_eq!(bus.nodes[0].get(0x6060, 0), Some(3));
    assert_eq!(bus.nodes[0].get(0x1803, 1), Some(0x4000_0481));
    assert_eq!(bus.master.stats(1).unwrap().boots, 2);
}

#[test]
fn a_node_that_leaves_operational_is_lost() {
    for (command, state) in
        [(NmtCommand::Stop, NmtState::Stopped), (NmtCommand::EnterPreOperational, NmtState::PreOperational)]
    {
        let mut bus = booted();
        bus.master.nmt(Target::Node(2), command);
        bus.run_to(200, |event| *event == Event::Lost { node: 2, reason: LostReason::State(state) });
        bus.run_to(1000, is_booted(2));
    }
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
fn the_robot_boots_over_a_wire_that_loses_and_doubles() {
    for seed in 1..=30 {
        let mut bus = robot(MasterConfig { own_frames_return: true, ..MasterConfig::default() });
        bus.seed(seed);
        (bus.loss, bus.doubling, bus.echo) = (30, 30, true);
        bus.run(20_000);
        (bus.loss, bus.doubling) = (0, 0);
        bus.run(8_000);
        let states = [1, 2].map(|id| bus.master.state(id));
        assert_eq!(states, [Some(State::Operational); 2], "seed {seed}");
        assert!(bus.master.stats(1).unwrap().boots > 0);
        assert_eq!(bus.master.dropped(), 0);
    }
}

#[test]
fn own_frames_come_back_without_harm_and_a_second_master_is_told() {
    let mut bus = robot(MasterConfig { own_frames_return: true, ..MasterConfig::default() });
    bus.echo = true;
    bus.run(2000);
    assert!(
        bus.events.iter().all(|(_, event)| matches!(event, Event::Booted { .. } | Event::Pdo { .. } | Event::Ready))
    );
    for _ in 0..20 {
        bus.put(usize::MAX, wire::heartbeat(127, NmtState::Operational));
        bus.run(50);
    }
    let told = bus.events.iter().filter(|(_, event)| *event == Event::SecondMaster).count();
    assert_eq!(told, 1);

    let mut bus = robot(MasterConfig::default());
    bus.run(100);
    bus.put(usize::MAX, wire::heartbeat(127, NmtState::Operational));
    bus.run_to(10, |event| *event == Event::SecondMaster);
}

#[test]
fn objects_are_read_and_written_on_demand() {
    let mut bus = booted();
    let now = bus.now;
    let name = bus.master.sdo_read(now, 2, 0x1008, 0).unwrap();
    let ramp = bus.master.sdo_write(now, 2, 0x6083, 0, crate::Value::U32(500)).unwrap();
    let none = bus.master.sdo_read(now, 2, 0x5000, 0).unwrap();
    for node in [0, 127, 128, 255] {
        assert_eq!(bus.master.sdo_read(now, node, 0x1000, 0), Err(RequestError::UnknownNode));
    }
    bus.run(50);
    let mut sdo =
        bus.events.iter().map(|(_, event)| event.clone()).filter(|event| {
            matches!(event, Event::SdoRead { .. } | Event::SdoWritten { .. } | Event::SdoFailed { .. })
        });
    let data = Payload::from(&b"Position drive, simulated, with a long device name"[..]);
    assert_eq!(sdo.next(), Some(Event::SdoRead { node: 2, ticket: name, index: 0x1008, sub: 0, data }));
    assert_eq!(sdo.next(), Some(Event::SdoWritten { node: 2, ticket: ramp, index: 0x6083, sub: 0 }));
    let error = sdo::Error::Refused(crate::Abort::NO_OBJECT);
    assert_eq!(sdo.next(), Some(Event::SdoFailed { node: 2, ticket: none, index: 0x5000, sub: 0, error }));
    assert_eq!(bus.nodes[1].get(0x6083, 0), Some(500));

    // A node that is lost answers for what it had; what waits goes to the next life.
    bus.nodes[1].power_off();
    let now = bus.now;
    for _ in 0..16 {
        bus.master.sdo_read(now, 2, 0x1000, 0).unwrap();
    }
    bus.master.sdo_read(now, 2, 0x1000, 0).unwrap();
    assert_eq!(bus.master.sdo_read(now, 2, 0x1000, 0), Err(RequestError::QueueFull));
    bus.nodes[1].power_on(bus.now);
    bus.run(3000);
    let answered = bus.events.iter().filter(|(at, event)| {
        *at > now && matches!(event, Event::SdoRead { .. } | Event::SdoFailed { error: sdo::Error::Cancelled, .. })
    });
    assert_eq!(answered.count(), 17);
}

#[test]
fn nodes_that_are_not_configured_answer_too_eight_at_a_time() {
    let mut bus = booted();
    for id in 10..30 {
        let mut node = Node::new(epos::dictionary(id), Duration::from_millis(5));
        node.power_on(bus.now);
        bus.nodes.push(node);
    }
    bus.run(10);
    for round in 0..3 {
        let (now, from) = (bus.now, bus.events.len());
        let ids = 10 + round * 5..18 + round * 5;
        for id in ids.clone() {
            bus.master.sdo_read(now, id, 0x1018, 1).unwrap();
            bus.master.sdo_write(now, id, 0x6083, 0, 500_u32 + u32::from(id)).unwrap();
        }
        assert_eq!(bus.master.sdo_read(now, 100, 0x1018, 1), Err(RequestError::QueueFull));
        bus.run(20);
        for id in ids {
            let events = || bus.events[from..].iter().map(|(_, event)| event);
            let vendor = Payload::from(0xFB_u32);
            assert!(
                events()
                    .any(|event| matches!(event, Event::SdoRead { node, data, .. } if *node == id && *data == vendor))
            );
            assert!(events().any(|event| matches!(event, Event::SdoWritten { node, .. } if *node == id)));
            assert_eq!(bus.nodes[usize::from(id) - 8].get(0x6083, 0), Some(500 + i64::from(id)));
        }
    }
    // One that is not there costs its time limit, and leaves room again.
    let ticket = bus.master.sdo_read(bus.now, 100, 0x1000, 0).unwrap();
    bus.run_to(600, |event| {
        matches!(event, Event::SdoFailed { node: 100, ticket: failed, error: sdo::Error::Timeout, .. } if *failed == ticket)
    });
    assert!(bus.master.foreign_frames() < 30, "{}", bus.master.foreign_frames());
}

#[test]
fn an_emergency_flood_is_told_by_its_first_and_last() {
    let mut bus = booted();
    let from = bus.events.len();
    for code in 0..50 {
        bus.nodes[0].emergency(0x3210 + code, 4, [0; 5]);
        bus.run(1);
    }
    bus.run(200);
    let told: Vec<_> = bus.events[from..]
        .iter()
        .filter_map(|(_, event)| match event {
            Event::Emergency { emergency, suppressed, .. } => Some((emergency.code, *suppressed)),
            _ => None,
        })
        .collect();
    assert_eq!(told, [(0x3210, 0), (0x3210 + 49, 48)]);
    assert_eq!(bus.master.stats(1).unwrap().emergencies, 50);
}

#[test]
fn when_the_bus_goes_down_nothing_is_left_to_send() {
    let mut bus = booted();
    for _ in 0..5 {
        bus.master.send_pdo(1, 4, &epos::pack(0x0F, 1500)).unwrap();
    }
    bus.master.handle_bus_down(bus.now);
    assert_eq!(bus.master.poll_tx(), None);
    bus.run_to(10, |event| *event == Event::Lost { node: 1, reason: LostReason::BusDown });
    bus.run_to(3000, is_booted(2));
    assert_eq!(bus.nodes[0].get(0x60FF, 0), Some(0));

    // Also when one node is lost: its set-points go, those of the other stay.
    let mut bus = booted();
    bus.master.send_pdo(1, 4, &epos::pack(0x0F, 1500)).unwrap();
    bus.master.send_pdo(2, 2, &icla::pack(0x0F, 77)).unwrap();
    assert!(bus.master.reboot(bus.now, 1) && !bus.master.reboot(bus.now, 9));
    bus.run(100);
    assert_eq!((bus.nodes[0].get(0x60FF, 0), bus.nodes[1].get(0x607A, 0)), (Some(0), Some(77)));
}

#[test]
fn what_was_asked_of_a_node_before_it_was_lost_is_not_written_after() {
    let mut bus = booted();
    let now = bus.now;
    let first = bus.master.sdo_write(now, 2, 0x6083, 0, crate::Value::U32(500)).unwrap();
    let second = bus.master.sdo_write(now, 2, 0x6060, 0, crate::Value::I8(6)).unwrap();
    // It reboots before anything of this has reached it.
    while bus.master.poll_tx().is_some() {}
    bus.nodes[1].power_on(now);
    bus.run_to(3000, is_booted(2));
    let cancelled = |event: &&(Instant, Event)| {
        let error = crate::sdo::Error::Cancelled;
        matches!(event.1, Event::SdoFailed { ticket, error: why, .. } if [first, second].contains(&ticket) && why == error)
    };
    assert_eq!(bus.events.iter().filter(cancelled).count(), 2, "{:?}", bus.events);
    bus.run(1000);
    assert_eq!(bus.nodes[1].get(0x6060, 0), Some(1), "the mode it was set up with");
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

#[test]
fn no_frames_panic_and_nothing_stays_due() {
    let mut random = Random::new(11);
    let mut bus = booted();
    for _ in 0..200_000 {
        bus.now += Duration::from_micros(random.below(20_000));
        let ids = [0x000, 0x081, 0x181, 0x481, 0x581, 0x581, 0x582, 0x701, 0x702, 0x77F];
        let id = ids[random.below(ids.len() as u64) as usize];
        let mut data = random.next().to_le_bytes();
        if id > 0x700 && random.below(2) == 0 {
            data[0] = [0x00, 0x05, 0x7F, 0x04][random.below(4) as usize];
        }
        let len = if id > 0x700 { random.below(2) as usize } else { random.below(9) as usize };
        let now = bus.now;
        bus.master.handle_rx(now, &Frame::standard(id, &data[..len]));
        bus.master.handle_timeout(now);
        while bus.master.poll_tx().is_some() || bus.master.poll_event().is_some() {}
        assert!(bus.master.poll_timeout().unwrap() > now);
    }
}

/// A node's states on the way up, each with the frames that lead there from the one before.
const WAY_UP: [(&str, &[&str]); 5] = [
    ("resetting", &[]),
    ("working", &["701 00"]),
    ("listening", &["581 43 00 10 00 92 01 02 00", "581 80 18 10 04 11 00 09 06", "581 4B 17 10 00 64 00 00 00"]),
    ("starting", &["701 7F"]),
    ("running", &["701 05"]),
];

/// A master whose node is `steps` states up; nothing waits to be sent or told.
fn climbed(steps: usize) -> Master {
    let config = MasterConfig { heartbeat: Duration::from_secs(60), ..MasterConfig::default() };
    let mut master = Master::new(config, &[NodeConfig::new(1, "propulsion")]).unwrap();
    master.handle_timeout(Instant::ZERO);
    for frame in WAY_UP[..=steps].iter().flat_map(|(_, frames)| *frames) {
        master.handle_rx(Instant::ZERO, &parse(&frame.split(' ').collect::<Vec<_>>()));
    }
    while master.poll_tx().is_some() || master.poll_event().is_some() {}
    master
}

/// State × input → next state, and what is sent.
#[test]
fn the_states_of_a_node_and_what_leads_from_one_to_the_next() {
    let inputs = ["701 00", "701 7F", "701 05", "701 04", "581 80 00 10 00 00 00 02 06", "time"];
    let mut table = Vec::new();
    for (steps, (name, _)) in WAY_UP.iter().enumerate() {
        for input in inputs {
            let mut master = climbed(steps);
            let before = master.state(1).unwrap();
            if input == "time" {
                let until = master.poll_timeout().unwrap();
                master.handle_timeout(until);
            } else {
                master.handle_rx(Instant::ZERO, &parse(&input.split(' ').collect::<Vec<_>>()));
            }
            let after = master.state(1).unwrap();
            let sent: Vec<_> = master.outputs();
            if before != after || !sent.is_empty() {
                let after = std::format!("{after:?}").replace("Booting", "");
                table.push(std::format!("{name}, {input}: {after} {}", sent.join("; ")));
            }
        }
    }
    let expected = "
resetting, 701 00: (DeviceType) 601 40 00 10 00 00 00 00 00
resetting, time: (DeviceType) 601 40 00 10 00 00 00 00 00
working, 701 00: (BootUp) 000 82 01
working, 581 80 00 10 00 00 00 02 06: Resting failed 1 device type: 0x1000:0 refused: object does not exist (0x06020000)
working, time: (DeviceType) 601 80 00 10 00 00 00 04 05; 601 40 00 10 00 00 00 00 00
listening, 701 00: (BootUp) 000 82 01
listening, 701 7F: (Start) 000 01 01
listening, 701 05: (Start) 000 01 01
listening, 701 04: (Start) 000 01 01
listening, time: Resting failed 1 error control: no heartbeat
starting, 701 00: (BootUp) 000 82 01
starting, 701 05: Operational booted 1; Ready
starting, time: (Start) 000 01 01
running, 701 00: (BootUp) 000 82 01; lost 1: booted by itself; NotReady
running, 701 7F: (BootUp) 000 82 01; lost 1: went to PreOperational; NotReady
running, 701 04: (BootUp) 000 82 01; lost 1: went to Stopped; NotReady
running, time: (BootUp) 000 82 01; lost 1: heartbeat missing; NotReady
";
    assert_eq!(table.join("\n"), expected.trim());
}
