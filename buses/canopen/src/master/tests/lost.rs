//! A node, the bus or the master itself in trouble.

use super::*;

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

#[test]
fn when_the_bus_goes_down_nothing_is_left_to_send() {
    let mut bus = booted();
    for _ in 0..5 {
        bus.master.send_pdo(1, 4, &epos::TABLE.pack(0x0F, 1500)).unwrap();
    }
    bus.master.handle_bus_down(bus.now);
    assert_eq!(bus.master.poll_tx(), None);
    bus.run_to(10, |event| *event == Event::Lost { node: 1, reason: LostReason::BusDown });
    bus.run_to(3000, is_booted(2));
    assert_eq!(bus.nodes[0].get(0x60FF, 0), Some(0));

    // Also when one node is lost: its set-points go, those of the other stay.
    let mut bus = booted();
    bus.master.send_pdo(1, 4, &epos::TABLE.pack(0x0F, 1500)).unwrap();
    bus.master.send_pdo(2, 2, &icla::TABLE.pack(0x0F, 77)).unwrap();
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
    let told = bus.events.iter().filter(|(_, event)| matches!(event, Event::SecondMaster { .. })).count();
    assert_eq!(told, 1);

    let mut bus = robot(MasterConfig::default());
    bus.run(100);
    bus.put(usize::MAX, wire::heartbeat(127, NmtState::Operational));
    bus.run_to(10, |event| matches!(event, Event::SecondMaster { .. }));
}

#[test]
fn commands_of_another_master_are_told_at_once() {
    let commands = [
        (Frame::standard(0x501, &[0x0F, 0, 0xE9, 2, 0, 0]), Foreign::Rpdo { node: 1 }),
        (wire::nmt(NmtCommand::Stop, 0), Foreign::Nmt { node: 0 }),
        (wire::nmt(NmtCommand::ResetNode, 2), Foreign::Nmt { node: 2 }),
        (wire::sync(), Foreign::Sync),
        (Frame::standard(0x602, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0]), Foreign::SdoRequest { node: 2 }),
    ];
    for own_frames_return in [false, true] {
        for (frame, by) in &commands {
            let mut bus = robot(MasterConfig { own_frames_return, ..MasterConfig::default() });
            bus.echo = own_frames_return;
            bus.run(500);
            let seen = |bus: &Bus| {
                let by = |event: &Event| if let Event::SecondMaster { by } = event { Some(*by) } else { None };
                bus.events.iter().filter_map(|(_, event)| by(event)).collect::<Vec<_>>()
            };
            assert_eq!(seen(&bus), []);
            bus.put(usize::MAX, *frame);
            bus.run(2);
            assert_eq!(seen(&bus), [*by], "own frames return: {own_frames_return}");
        }
    }
    // Nodes that are not ours are none of our business.
    let mut bus = booted();
    for frame in [wire::nmt(NmtCommand::Stop, 9), Frame::standard(0x509, &[0; 6]), Frame::standard(0x609, &[0x40; 8])] {
        bus.put(usize::MAX, frame);
        bus.run(2);
    }
    assert!(!bus.events.iter().any(|(_, event)| matches!(event, Event::SecondMaster { .. })), "{:?}", bus.events);
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
fn a_drive_that_is_not_heard_is_told_to_stop_and_given_time_before_it_is_reset() {
    let mut bus = booted();
    bus.master.send_pdo(1, 4, &epos::TABLE.pack(0x0F, 1500)).unwrap();
    bus.run(5);
    bus.unheard = Some(0);
    bus.run_to(400, |event| matches!(event, Event::Lost { node: 1, reason: LostReason::Heartbeat }));
    bus.run(2);
    assert_eq!(bus.nodes[0].get(0x6040, 0), Some(0x0B), "quick stop");
    assert_eq!(bus.nodes[0].nmt_state(), Some(NmtState::Operational));
    bus.unheard = None;
    // 25 000 rpm at 10 000 rpm/s, and no more than 2 s.
    bus.run(1990);
    assert_eq!(bus.nodes[0].nmt_state(), Some(NmtState::Operational));
    bus.run_to(500, is_booted(1));
}

#[test]
fn a_heartbeat_that_waited_to_be_read_extends_no_life() {
    let mut bus = booted();
    let lost = |bus: &mut Bus| {
        let events = std::iter::from_fn(|| bus.master.poll_event());
        events.filter(|event| matches!(event, Event::Lost { node: 1, reason: LostReason::Heartbeat })).count()
    };
    let (beat, last) = (wire::heartbeat(1, NmtState::Operational), bus.now + Duration::from_millis(10));
    bus.master.handle_rx(last, &beat);
    let limit = Duration::from_millis(200);
    let read = last + limit - Duration::from_millis(10);
    // The second one has a receive time before a step of the clock.
    for arrived in [last + Duration::from_millis(1), Instant::ZERO] {
        bus.master.handle_rx_at(read, arrived, &beat);
    }
    bus.master.handle_timeout(last + limit);
    assert_eq!(lost(&mut bus), 0);
    bus.master.handle_timeout(last + limit + Duration::from_millis(1));
    assert_eq!(lost(&mut bus), 1, "it lived 200 ms ago");
}

#[test]
fn a_master_that_leaves_resets_the_communication_of_its_nodes_and_boots_none_again() {
    let mut bus = booted();
    let from = bus.sent.len();
    bus.master.leave(bus.now);
    assert!(!bus.master.has_left(), "they are being reset");
    bus.run(2000);
    assert!(bus.master.has_left());
    let commands: Vec<_> =
        bus.sent[from..].iter().filter(|(_, frame)| Service::of(frame) == Some(Service::Nmt)).collect();
    let data: Vec<_> = commands.iter().map(|(_, frame)| frame.data().to_vec()).collect();
    assert_eq!(data, [[0x82, 1], [0x82, 2]]);
    // Nobody watches the master any more.
    assert_eq!([0, 1].map(|at| bus.nodes[at].get(0x1016, 1)), [Some(0); 2]);
    assert_eq!([0, 1].map(|at| bus.nodes[at].nmt_state()), [Some(NmtState::PreOperational); 2]);
    assert_eq!(bus.master.send_pdo(1, 4, &[0; 6]), Err(PdoError::NotOperational));
}
