//! A wire that loses, doubles and lies.

use super::*;

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
