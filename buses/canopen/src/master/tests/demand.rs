//! SDO on demand.

use super::*;

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
fn nodes_that_are_not_configured_answer_too_sixteen_at_a_time() {
    let mut bus = booted();
    for id in 10..40 {
        let mut node = Node::new(epos::dictionary(id), Duration::from_millis(5));
        node.power_on(bus.now);
        bus.nodes.push(node);
    }
    bus.run(10);
    for round in 0..3 {
        let (now, from) = (bus.now, bus.events.len());
        let ids = 10 + round * 5..26 + round * 5;
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
    // Their boot-up messages, and nothing of what they answered.
    assert!(bus.master.foreign_frames() <= 30, "{}", bus.master.foreign_frames());
}

#[test]
fn a_block_download_leaves_room_for_everything_else() {
    let mut bus = booted();
    let text = crate::dictionary::Entry::new(
        0x2F01,
        0,
        crate::dictionary::DataType::Domain,
        crate::dictionary::Access::ReadWrite,
        0,
    );
    let mut node = Node::new(epos::dictionary(9).with(&[text]), Duration::from_millis(5));
    node.power_on(bus.now);
    bus.nodes.push(node);
    bus.run(100);
    let data: Vec<u8> = (0..4096_u32).map(|n| n as u8).collect();
    let (start, first) = (bus.now, bus.sent.len());
    let mut last = None;
    for _ in 0..5 {
        last = Some(bus.master.sdo_write_block(start, 9, 0x2F01, 0, &data[..]).unwrap());
    }
    let mut set_points = 0;
    let is_last =
        |(_, event): &(Instant, Event)| matches!(event, Event::SdoWritten { ticket, .. } if Some(*ticket) == last);
    while !bus.events.iter().any(is_last) {
        bus.master.send_pdo(1, 4, &epos::TABLE.pack(0x0F, 1500)).unwrap();
        bus.master.sdo_read(bus.now, 2, 0x6041, 0).unwrap();
        bus.run_until(bus.now + Duration::from_millis(2));
        set_points += 1;
        assert!(bus.now.since(start) < Duration::from_secs(2), "{set_points}: {:?}", told(&bus, 0));
    }
    // As fast as the wire would have it, and no faster.
    let took = bus.now.since(start);
    let bits: u32 = bus.sent[first..].iter().map(|(_, frame)| base::can::frame_bits(frame) + 3).sum();
    let wire = Duration::from_micros(u64::from(bits));
    assert!(took < wire * 11 / 10 && took > wire * 8 / 10, "{took:?}, on the wire {wire:?}");
    // In no millisecond more was handed out than it and the next one hold, other frames in between.
    for (n, (at, _)) in bus.sent.iter().enumerate().skip(first) {
        let burst = bus.sent[n..].iter().take_while(|(then, _)| then.since(*at) < Duration::from_millis(1)).count();
        assert!(burst < 24, "{burst} frames within a millisecond");
    }
    // Everybody else was served meanwhile.
    let reads = bus.events.iter().filter(|(_, event)| matches!(event, Event::SdoRead { node: 2, .. })).count();
    assert!(reads + 2 > set_points, "{reads} of {set_points}");
    assert_eq!([1, 2].map(|id| bus.master.stats(id).unwrap().losses), [0, 0]);
    let ticket = bus.master.sdo_read_block(bus.now, 9, 0x2F01, 0).unwrap();
    bus.run(200);
    let data = Payload::from(&data[..]);
    assert!(told(&bus, 0).contains(&Event::SdoRead { node: 9, ticket, index: 0x2F01, sub: 0, data }));
}

#[test]
fn a_block_upload_comes_from_any_node() {
    let mut bus = booted();
    let ticket = bus.master.sdo_read_block(bus.now, 2, 0x1008, 0).unwrap();
    bus.run(50);
    let data = Payload::from(&b"Position drive, simulated, with a long device name"[..]);
    assert_eq!(told(&bus, 0).last(), Some(&Event::SdoRead { node: 2, ticket, index: 0x1008, sub: 0, data }));
}
