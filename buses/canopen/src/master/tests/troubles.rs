//! Nodes that babble, nodes that nobody configured, two nodes with one id.

use super::*;

/// Lets a node's emergencies come, `per_second` for a time.
fn flood(bus: &mut Bus, id: u16, per_second: u64, millis: u64) {
    for _ in 0..per_second * millis / 1000 {
        bus.put(usize::MAX, Frame::standard(id, &[0x10, 0x32, 4, 0, 0, 0, 0, 0]));
        bus.run_until(bus.now + Duration::from_nanos(1_000_000_000 / per_second));
    }
}

#[test]
fn a_node_that_babbles_is_told_and_when_it_stops() {
    let mut bus = booted();
    flood(&mut bus, 0x82, 900, 500);
    assert!(!bus.events.iter().any(|(_, event)| matches!(event, Event::Babbling { .. })));
    let from = bus.events.len();
    flood(&mut bus, 0x82, 1250, 500);
    bus.run(300);
    let babble = told(&bus, from)
        .into_iter()
        .filter(|event| matches!(event, Event::Babbling { .. } | Event::BabblingOver { .. }));
    let babble: Vec<_> = babble.collect();
    assert!(
        matches!(babble[..], [Event::Babbling { node: 2, rate: 1000..=1300 }, Event::BabblingOver { node: 2 }]),
        "{babble:?}"
    );
    assert_eq!(bus.master.state(1), Some(State::Operational));
}

#[test]
fn a_slow_bus_is_babbled_full_by_fewer_frames_and_by_nobody_too() {
    let mut bus = robot(MasterConfig { bit_rate: 125_000, ..MasterConfig::default() });
    bus.run(1000);
    let foreign = bus.master.foreign_frames();
    let from = bus.events.len();
    flood(&mut bus, 0x7D0, 800, 500);
    assert!(matches!(told(&bus, from)[..], [Event::Babbling { node: 0, rate: 750..=850 }]), "{:?}", told(&bus, from));
    assert_eq!(bus.master.foreign_frames() - foreign, 400);
}

#[test]
fn answers_that_were_asked_for_are_no_babble() {
    let mut bus = booted();
    for _ in 0..3000 {
        bus.master.sdo_read(bus.now, 1, 0x1000, 0).unwrap();
        bus.run_until(bus.now + Duration::from_micros(300));
    }
    assert!(!bus.events.iter().any(|(_, event)| matches!(event, Event::Babbling { .. })));
}

#[test]
fn a_node_that_nobody_configured_is_told_once() {
    let mut bus = booted();
    bus.nodes.push(Node::new(epos::dictionary(9), Duration::from_millis(5)));
    for _ in 0..3 {
        let now = bus.now;
        bus.nodes[2].power_on(now);
        bus.run(100);
    }
    assert_eq!(bus.events.iter().filter(|(_, event)| *event == Event::Stranger { node: 9 }).count(), 1);
    assert_eq!(bus.master.nmt_state(9), Some(NmtState::Initialising));
    bus.master.sdo_write(bus.now, 9, 0x1017, 0, 50_u16).unwrap();
    bus.master.nmt(Target::Node(9), NmtCommand::Start);
    bus.run(100);
    assert_eq!(bus.master.nmt_state(9), Some(NmtState::Operational));
    assert_eq!((bus.master.nmt_state(10), bus.master.nmt_state(200)), (None, None));
}

#[test]
fn two_nodes_that_boot_with_one_id_are_told() {
    let mut bus = booted();
    let from = bus.events.len();
    bus.nodes.push(Node::new(epos::dictionary(1), Duration::from_millis(9)));
    bus.nodes[2].power_on(bus.now);
    bus.run(10_000);
    assert_eq!(told(&bus, from).iter().filter(|event| **event == Event::DuplicateId { node: 1 }).count(), 1);
    assert_ne!(bus.master.state(1), Some(State::Operational));
}

#[test]
fn a_second_node_that_beats_in_silence_is_told_by_the_rate_of_the_heartbeats() {
    let mut bus = booted();
    for _ in 0..40 {
        bus.put(usize::MAX, wire::heartbeat(1, NmtState::Operational));
        bus.run(50);
    }
    assert!(bus.events.iter().any(|(_, event)| *event == Event::DuplicateId { node: 1 }));
    assert!(bus.events.iter().any(|(_, event)| *event == Event::Lost { node: 1, reason: LostReason::DuplicateId }));
}

#[test]
fn a_second_node_is_told_whatever_the_period_and_the_phase_of_its_heartbeats() {
    // 50 ms are the node's own.
    for (period, phase) in [(50, 0), (50, 1), (50, 25), (40, 0), (60, 0), (80, 3), (95, 0), (20, 0)] {
        let mut bus = booted();
        bus.run(phase);
        let begin = bus.now;
        for _ in 0..8000 / period {
            bus.put(usize::MAX, wire::heartbeat(1, NmtState::Operational));
            bus.run(period);
        }
        let told = bus.events.iter().find(|(_, event)| *event == Event::DuplicateId { node: 1 });
        let after = told.expect("within 8 s").0.since(begin);
        let most = if period < 80 { 2500 } else { 8000 };
        assert!(after < Duration::from_millis(most), "{period} ms, phase {phase}: {after:?}");
    }
}

#[test]
fn heartbeats_that_lay_in_a_queue_speak_for_nobody() {
    let mut bus = booted();
    bus.unheard = Some(0);
    for round in 0..400 {
        // Two of them come at once each time, and none when it is due.
        bus.run(if round % 5 == 0 { 190 } else { 100 });
        let now = bus.now;
        bus.master.handle_rx(now, &wire::heartbeat(1, NmtState::Operational));
        bus.master.handle_rx(now, &wire::heartbeat(1, NmtState::Operational));
    }
    assert!(!bus.events.iter().any(|(_, event)| matches!(event, Event::DuplicateId { .. })));
}

#[test]
fn two_nodes_that_answer_one_request_are_told() {
    let mut bus = booted();
    let from = bus.events.len();
    bus.doubling = 1000;
    for _ in 0..20 {
        bus.master.sdo_read(bus.now, 2, 0x1000, 0).unwrap();
        bus.run(10);
    }
    bus.doubling = 0;
    assert!(told(&bus, from).contains(&Event::DuplicateId { node: 2 }));

    // Another client that asks too is no second node.
    let mut bus = booted();
    let from = bus.events.len();
    for _ in 0..40 {
        bus.master.sdo_read(bus.now, 2, 0x1000, 0).unwrap();
        bus.put(usize::MAX, Frame::standard(0x602, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0]));
        bus.run(10);
    }
    assert!(!told(&bus, from).iter().any(|event| matches!(event, Event::DuplicateId { .. } | Event::Lost { .. })));
}

#[test]
fn a_pdo_shorter_than_its_mapping_is_counted_and_not_processed() {
    let mut bus = booted();
    let from = bus.events.len();
    for _ in 0..5 {
        // TPDO4 has six bytes.
        bus.put(usize::MAX, Frame::standard(0x481, &[0x37, 0x02]));
        bus.run(20);
    }
    let malformed = |count| Event::Malformed { node: 1, count };
    assert_eq!(told(&bus, from), [malformed(1), malformed(2), malformed(4)]);
    // Longer ones, and those that are not mapped here, are the caller's.
    bus.put(usize::MAX, Frame::standard(0x481, &[0x37, 0x02, 0, 0, 0, 0, 0, 0]));
    bus.put(usize::MAX, Frame::standard(0x381, &[1]));
    bus.run(1);
    assert_eq!(bus.master.stats(1).unwrap().malformed, 5);
    assert!(matches!(
        told(&bus, from)[3..],
        [Event::Pdo { number: 4, len: 8, .. }, Event::Pdo { number: 3, len: 1, .. }]
    ));
}

#[test]
fn a_set_point_of_another_is_told_on_every_rpdo() {
    for (id, node) in [(0x201, 1), (0x301, 1), (0x401, 1), (0x501, 1), (0x202, 2), (0x302, 2), (0x402, 2), (0x502, 2)] {
        let mut bus = booted();
        let from = bus.events.len();
        bus.put(usize::MAX, Frame::standard(id, &[0x0F, 0x00, 0xFC]));
        bus.run(5);
        let told = told(&bus, from);
        assert!(told.contains(&Event::SecondMaster { by: Foreign::Rpdo { node } }), "{id:X}: {told:?}");
    }
}
