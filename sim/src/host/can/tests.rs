//! Timing and order on a wire without faults, and the effects of faults.

use super::*;
use module::PortId;

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::standard(id, data)
}

fn owner(pid: u32) -> Owner {
    Owner { pid, port: PortId(0) }
}

/// A wire with ports 1 to `ports`.
fn wire(bitrate: u32, ports: u32) -> CanWire {
    let mut wire = CanWire::new(bitrate, Random::new(1), None);
    for pid in 1..=ports {
        assert!(wire.join(owner(pid), &format!("module {pid}").into(), false));
    }
    wire
}

#[test]
fn frames_are_as_long_as_their_content_makes_them() {
    // docs/facts/canopen.md 7, with 3 bits of gap: 8 bytes 111 at best, 135 at worst; 0 bytes 47 to 55.
    for seed in 0..20_000u64 {
        let mut random = simulator::Random::new(seed);
        let n = (random.bits() % 9) as usize;
        let data = random.bits().to_le_bytes();
        let bits = frame_bits(&frame(random.bits() as u16, &data[..n])) + INTERMISSION;
        let (best, worst) = (47 + 8 * n as u32, 47 + 8 * n as u32 + (34 + 8 * n as u32 - 1) / 4);
        assert!((best..=worst).contains(&bits), "{n} bytes: {bits}");
    }
    assert!(frame_bits(&frame(0, &[0; 8])) > frame_bits(&frame(0x555, &[0x55; 8])));
    let extended = Frame::new(Id::Extended(0x1234_5678), &[]).unwrap();
    assert!((64..=64 + 13).contains(&frame_bits(&extended)));
}

#[test]
fn the_lowest_identifier_wins_and_each_port_keeps_its_order() {
    let mut wire = wire(1_000_000, 3);
    let now = Instant::from_millis(1);
    wire.send(now, owner(1), frame(0x700, &[]));
    wire.send(now, owner(1), frame(0x001, &[]));
    wire.send(now, owner(2), frame(0x300, &[]));
    wire.send(now, owner(3), frame(0x200, &[]));
    let mut order = Vec::new();
    while let Some(due) = wire.poll_timeout() {
        wire.handle_timeout(due);
        if let Some(WireEvent::Frame(owner, frame)) = wire.poll_event() {
            order.push((owner.pid, frame.id()));
        }
    }
    let ids = [(3, 0x200), (2, 0x300), (1, 0x700), (1, 0x001)];
    assert_eq!(order, ids.map(|(pid, id)| (pid, Id::Standard(id))));
}

#[test]
fn frames_follow_each_other_with_three_bits_between() {
    let mut wire = wire(500_000, 2);
    let owner = owner(1);
    let (a, b) = (frame(0x181, &[1, 2, 3]), frame(0x182, &[]));
    wire.send(Instant::ZERO, owner, a);
    wire.send(Instant::ZERO, owner, b);
    let mut ends = Vec::new();
    while let Some(due) = wire.poll_timeout() {
        wire.handle_timeout(due);
        if wire.poll_event().is_some() {
            ends.push(due.as_nanos());
        }
    }
    let (a, b) = (u64::from(frame_bits(&a)) * 2000, u64::from(frame_bits(&b)) * 2000);
    assert_eq!(ends, [a, a + 3 * 2000 + b]);
}

/// Serves the wire until `end`; returns its events, one per line: µs, port, event.
fn story(wire: &mut CanWire, end: Instant) -> Vec<String> {
    let mut lines = Vec::new();
    while let Some(due) = wire.poll_timeout().filter(|due| *due <= end) {
        wire.handle_timeout(due);
        while let Some(told) = wire.poll_event() {
            let what = match told {
                WireEvent::Frame(owner, frame) => format!("{} frame {:?}", owner.pid, frame.data()),
                WireEvent::Lost(frame) => format!("- lost {:?}", frame.data()),
                WireEvent::Off(owner) => format!("{} off", owner.pid),
                WireEvent::Back(owner) => format!("{} back", owner.pid),
                WireEvent::Notice(owner, Notice::Health(health)) => {
                    let [transmit, receive] = [health.transmit_errors, health.receive_errors];
                    format!("{} {:?} {transmit} {receive}", owner.pid, health.state)
                }
                WireEvent::Notice(owner, notice) => format!("{} {notice:?}", owner.pid),
            };
            lines.push(format!("{} {what}", due.as_nanos() / 1000));
        }
    }
    lines
}

fn us(micros: u64) -> Instant {
    Instant::from_nanos(micros * 1000)
}

#[test]
fn a_port_alone_on_its_wire_becomes_passive_and_never_bus_off() {
    let mut wire = wire(1_000_000, 1);
    let sent = frame(0x181, &[1]);
    wire.send(Instant::ZERO, owner(1), sent);
    // To the acknowledge slot, an error flag of 6 and its delimiter of 8, 3 of intermission; passive 8 more.
    let bits = u64::from(frame_bits(&sent));
    let one = bits - 8 + 14;
    let at = |tries: u64| tries * (one + 3) - 3;
    let expected = [
        format!("{} 1 Active 8 0", at(1)),
        format!("{} 1 NoAcknowledge", at(1)),
        format!("{} 1 Warning 96 0", at(12)),
        format!("{} 1 Passive 128 0", at(16)),
        format!("{} 1 NoAcknowledge", at(1) + 100_000),
        format!("{} 1 NoAcknowledge", at(1) + 200_000),
    ];
    assert_eq!(story(&mut wire, us(250_000)), expected);
    assert_eq!((wire.traffic.sent, wire.traffic.errors), (0, 0));
    // Another node joins and receives the next attempt: the 17th began at 16 * (one + 3) + 8.
    let first = 16 * (one + 3) + 8;
    let next = first + (250_000 - first).div_ceil(one + 3 + 8) * (one + 3 + 8);
    wire.join(owner(2), &"other".into(), false);
    let expected = [format!("{} 1 frame [1]", next + bits), format!("{} 1 Warning 127 0", next + bits)];
    assert_eq!(story(&mut wire, us(260_000)), expected);
}

#[test]
fn a_destroyed_frame_is_sent_again_and_costs_an_error_frame() {
    let mut wire = wire(1_000_000, 2);
    assert!(wire.inject(Instant::ZERO, InjectedFault::Corrupt(2), Instant::NEVER));
    let (a, b) = (frame(0x181, &[1]), frame(0x182, &[2]));
    let [bits_a, bits_b] = [&a, &b].map(|frame| u64::from(frame_bits(frame)));
    wire.send(Instant::ZERO, owner(1), a);
    wire.send(Instant::ZERO, owner(1), b);
    let lines = story(&mut wire, us(1000));
    assert_eq!(lines[0], format!("{bits_a} 1 frame [1]"));
    let destroyed: u64 = lines[1].split(' ').next().unwrap().parse().unwrap();
    let broken = bits_a + 3 + 1 + 20..=bits_a + 3 + bits_b + 20;
    assert!(broken.contains(&destroyed), "{destroyed} {broken:?}");
    let after = destroyed + 3 + bits_b;
    let told = ["1 Active 8 0", "1 Errors(1)", "2 Active 0 1", "2 Errors(1)"].map(|what| format!("{destroyed} {what}"));
    assert_eq!(lines[1..], [&told[..], &[format!("{after} 1 frame [2]")]].concat());
    // The counters decrease with the frame, which is reported with the next minor notice.
    let rest = story(&mut wire, us(200_000));
    assert_eq!(
        rest,
        [format!("{} 1 Active 7 0", destroyed + 100_000), format!("{} 2 Active 0 0", destroyed + 100_000)]
    );
    assert_eq!((wire.traffic.sent, wire.traffic.errors), (2, 1));
}

#[test]
fn a_port_with_only_destroyed_frames_goes_bus_off_with_back_off() {
    let mut wire = wire(1_000_000, 2);
    wire.inject(Instant::ZERO, InjectedFault::Corrupt(1), us(20_000_000));
    let (mut offs, mut backs, mut healths) = (Vec::new(), Vec::new(), Vec::new());
    for turn in 0..200_000 {
        let now = us(turn * 100);
        if turn % 10 == 0 {
            wire.send(now, owner(1), frame(0x181, &[1]));
        }
        for line in story(&mut wire, now) {
            let (at, what) = line.split_once(' ').unwrap();
            let at: u64 = at.parse().unwrap();
            match what {
                "1 off" => offs.push(at),
                "1 back" => backs.push(at),
                what if what.starts_with("1 Off") || what.starts_with("1 Passive") => healths.push(what.to_string()),
                what => assert!(!what.contains("frame"), "{what}"),
            }
        }
    }
    assert_eq!(healths[..2], ["1 Passive 128 0", "1 Off 255 0"]);
    let pauses: Vec<_> = offs.iter().zip(&backs).map(|(off, back)| back - off).collect();
    assert_eq!(pauses, [100, 200, 400, 800, 1600, 3200, 5000, 5000].map(|ms| ms * 1000 + 1408));
    // 32 attempts per frame; at least 5 s without errors reset the delay.
    assert_eq!(wire.traffic.errors, 32 * offs.len() as u64);
    let calm = us(40_000_000);
    story(&mut wire, calm);
    wire.inject(calm, InjectedFault::BusOff, Instant::NEVER);
    let back = story(&mut wire, us(40_200_000));
    assert!(back.contains(&"40101408 1 back".to_string()), "{back:?}");
}

#[test]
fn a_port_that_was_cut_off_sends_no_old_frames_afterwards() {
    let mut wire = CanWire::new(1_000_000, Random::new(1), None);
    wire.join(owner(1), &"master".into(), false);
    wire.join(owner(2), &"boards".into(), true);
    wire.inject(Instant::ZERO, InjectedFault::Cut, us(500_000));
    for n in 0..50 {
        let now = us(n * 10_000);
        wire.send(now, owner(1), frame(0x200, &[n as u8]));
        wire.send(now, owner(2), frame(0x180, &[n as u8]));
        let told = story(&mut wire, now + Duration::from_millis(9));
        assert!(told.iter().any(|line| line.ends_with(&format!("2 frame [{n}]"))), "{told:?}");
        assert!(!told.iter().any(|line| line.contains("1 frame")), "{told:?}");
        assert!(!wire.hears(now, owner(1)) && wire.hears(now, owner(2)));
    }
    assert_eq!(wire.controllers[0].health().transmit_errors, 128);
    // The frame in the controller is first; of the others only those of the last 50 ms are left.
    let told = story(&mut wire, us(520_000));
    let frames: Vec<_> = told.iter().filter_map(|line| line.split_once("frame [")?.1.strip_suffix(']')).collect();
    assert_eq!(frames, ["0", "46", "47", "48", "49"]);
    assert_eq!(wire.traffic.dropped, 45);
}

#[test]
fn a_cable_that_is_repaired_within_a_frame_leaves_the_order_of_frames() {
    for repaired in 1000..1300 {
        let mut wire = CanWire::new(1_000_000, Random::new(1), None);
        wire.join(owner(1), &"master".into(), false);
        wire.join(owner(2), &"boards".into(), true);
        wire.inject(Instant::ZERO, InjectedFault::Cut, us(repaired));
        for n in [1, 2] {
            wire.send(Instant::ZERO, owner(1), frame(0x200, &[n]));
        }
        for n in 3..30 {
            wire.send(Instant::ZERO, owner(2), frame(0x700, &[n]));
        }
        let told = story(&mut wire, us(10_000));
        let frames: Vec<_> =
            told.iter().filter_map(|line| line.split_once(" 1 frame ")).map(|(_, data)| data).collect();
        assert_eq!(frames, ["[1]", "[2]"], "repaired at {repaired} us");
    }
}

#[test]
fn passive_senders_on_both_sides_of_a_cut_settle() {
    let mut wire = CanWire::new(1_000_000, Random::new(1), None);
    wire.join(owner(1), &"master".into(), false);
    wire.join(owner(2), &"boards".into(), false);
    wire.inject(Instant::ZERO, InjectedFault::Cut, us(500_000));
    wire.send(us(0), owner(1), frame(0x200, &[]));
    wire.send(us(0), owner(2), frame(0x180, &[]));
    let mut turns = 0;
    while let Some(due) = wire.poll_timeout().filter(|due| *due < us(500_000)) {
        wire.handle_timeout(due);
        turns += 1;
        assert!(turns < 100_000, "time stands still at {due:?}");
    }
    assert!(wire.controllers.iter().all(Controller::is_passive));
}

#[test]
fn a_passive_sender_yields_to_others() {
    let mut wire = wire(1_000_000, 2);
    wire.inject(Instant::ZERO, InjectedFault::Corrupt(1), us(3000));
    wire.send(Instant::ZERO, owner(1), frame(0x001, &[1]));
    while !wire.controllers[0].is_passive() {
        let due = wire.poll_timeout().unwrap();
        wire.handle_timeout(due);
    }
    wire.corrupt.0 = Instant::ZERO;
    let now = wire.segments[0].free;
    wire.send(now, owner(2), frame(0x700, &[2]));
    let order: Vec<_> = story(&mut wire, us(10_000)).into_iter().filter(|line| line.contains("frame")).collect();
    assert!(order[0].ends_with("2 frame [2]") && order[1].ends_with("1 frame [1]"), "{order:?}");
}

#[test]
fn noise_has_its_configured_rate_and_repeats_with_its_seed() {
    let run = |seed| {
        let mut wire = CanWire::new(1_000_000, Random::new(seed), None);
        wire.join(owner(1), &"a".into(), false);
        wire.join(owner(2), &"b".into(), false);
        wire.inject(Instant::ZERO, InjectedFault::Noise(5e-4), Instant::NEVER);
        for n in 0..10_000 {
            wire.send(us(n * 500), owner(1), frame(0x181, &n.to_le_bytes()));
            story(&mut wire, us(n * 500 + 499));
        }
        wire.traffic
    };
    let traffic = run(1);
    assert_eq!((traffic, traffic.sent, traffic.dropped), (run(1), 10_000, 0));
    // About 120 bits: 6 % of the attempts.
    let share = traffic.errors as f64 / (traffic.errors + traffic.sent) as f64;
    assert!((0.05..0.065).contains(&share), "{share}");
    assert_ne!(traffic.errors, run(2).errors);
}

#[test]
fn the_next_process_of_a_module_finds_its_controller_as_it_is() {
    let mut wire = wire(1_000_000, 2);
    wire.inject(us(10), InjectedFault::BusOff, Instant::NEVER);
    wire.close(1);
    assert!(!wire.join(owner(3), &"module 1".into(), false), "it is still off");
    assert_eq!(wire.controllers.len(), 2);
    let back = story(&mut wire, us(200_000));
    assert!(back.contains(&"101418 3 back".to_string()), "{back:?}");
    wire.close(3);
    // An unused interface acknowledges.
    wire.send(us(300_000), owner(2), frame(0x181, &[1]));
    assert!(story(&mut wire, us(301_000)).iter().any(|line| line.ends_with("2 frame [1]")));
}

#[test]
fn a_lost_frame_is_lost_once() {
    let mut wire = wire(1_000_000, 2);
    wire.inject(Instant::ZERO, InjectedFault::Lose(2), Instant::NEVER);
    for n in 0..3 {
        wire.send(Instant::ZERO, owner(1), frame(0x181, &[n]));
    }
    let told = story(&mut wire, us(1000));
    let told: Vec<_> = told.iter().map(|line| line.split_once(' ').unwrap().1).collect();
    assert_eq!(told, ["1 frame [0]", "- lost [1]", "1 frame [2]"]);
}
