//! Nodes that answer what nobody would.

use super::*;

/// Boots a node whose answers come from `answer`, given the request; gives what was told within 20 s.
fn boot(mut answer: impl FnMut(&[u8], &mut Random) -> Vec<[u8; 8]>, seed: u64) -> Vec<Event> {
    let mut random = Random::new(seed);
    let mapping = PdoMapping::rpdo(1, 4, &[0x6040_0010, 0x60FF_0020]).adjusted();
    let config = NodeConfig {
        device_type: Some(0x0002_0192),
        writes: [ConfigWrite::new(0x6060, 0, 3_i8), ConfigWrite::new(0x2F01, 0, &b"some text to write"[..])].into(),
        mappings: [mapping].into(),
        stamp: Some(Stamp { date: 1, time: 2, store: true }),
        ..NodeConfig::new(1, "a")
    };
    let mut master = Master::new(MasterConfig::default(), &[config]).unwrap();
    let (mut now, mut events, mut answers) = (Instant::ZERO, Vec::new(), 0_u32);
    while now < Instant::from_millis(20_000) {
        master.handle_timeout(now);
        while let Some(frame) = master.poll_tx() {
            let replies = match Service::of(&frame) {
                Some(Service::SdoRequest { node: 1 }) => answer(frame.data(), &mut random),
                Some(Service::Nmt) => {
                    master.handle_rx(now, &wire::heartbeat(1, NmtState::Initialising));
                    Vec::new()
                }
                _ => Vec::new(),
            };
            for reply in replies {
                answers += 1;
                master.handle_rx(now, &Frame::standard(0x581, &reply));
            }
            // An endless conversation at one instant is the test's own fault; time passes.
            now += Duration::from_micros(260);
        }
        events.extend(core::iter::from_fn(|| master.poll_event()));
        now = now.max(master.poll_timeout().unwrap());
    }
    assert!(answers > 0);
    assert_eq!(master.dropped(), 0);
    events
}

fn is_never_booted(events: &[Event]) {
    assert!(!events.iter().any(|event| matches!(event, Event::Booted { .. } | Event::Ready)), "{events:?}");
    assert!(events.iter().any(|event| matches!(event, Event::BootFailed { .. })), "{events:?}");
}

#[test]
fn random_answers_never_boot_a_node() {
    for seed in 1..=20 {
        is_never_booted(&boot(|_, random| vec![random.next().to_le_bytes()], seed));
    }
}

#[test]
fn a_node_that_agrees_to_everything_and_holds_nothing_is_refused() {
    let agree = |request: &[u8], _: &mut Random| {
        let mut reply = [0; 8];
        reply[1..4].copy_from_slice(&request[1..4]);
        reply[0] = match request[0] >> 5 {
            1 => 0x60,
            2 => 0x43,
            0 => 0x20 | request[0] & 0x10,
            _ => return Vec::new(),
        };
        vec![reply]
    };
    is_never_booted(&boot(agree, 1));
}

#[test]
fn answers_of_other_objects_and_sizes_are_refused_or_time_out() {
    type Reply = fn(&[u8]) -> [u8; 8];
    let replies: [Reply; 5] = [
        // Of another object; a size beyond all bounds; segments for ever; an abort of nothing; a block.
        |_| [0x43, 0x00, 0x20, 0, 0x92, 1, 2, 0],
        |request| [0x41, request[1], request[2], request[3], 0xFF, 0xFF, 0xFF, 0xFF],
        |request| {
            if request[0] == 0x40 {
                [0x40, request[1], request[2], request[3], 0, 0, 0, 0]
            } else {
                [request[0] & 0x10; 8]
            }
        },
        |_| [0x80, 0, 0, 0, 0, 0, 0, 0],
        |request| [0xC6, request[1], request[2], request[3], 0xFF, 0, 0, 0],
    ];
    for reply in replies {
        is_never_booted(&boot(|request, _| vec![reply(request)], 1));
    }
}
