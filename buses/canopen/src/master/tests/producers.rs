//! SYNC, TIME, and the master's own state.

use super::*;
use crate::wire::TimeOfDay;

/// Serves the master `late(n)` µs after each of its deadlines, for a second; gives what it sent, and when.
fn sent(master: &mut Master, late: impl Fn(u64) -> u64) -> Vec<(Instant, Frame)> {
    let (mut now, mut sent) = (Instant::ZERO, Vec::new());
    for n in 0.. {
        master.handle_timeout(now);
        while let Some(frame) = master.poll_tx() {
            sent.push((now, frame));
        }
        let next = master.poll_timeout().unwrap();
        if next > Instant::from_millis(1000) {
            break;
        }
        now = next + Duration::from_micros(late(n));
    }
    sent
}

fn of(sent: &[(Instant, Frame)], service: Service) -> Vec<(Instant, Frame)> {
    sent.iter().filter(|(_, frame)| Service::of(frame) == Some(service)).copied().collect()
}

#[test]
fn sync_keeps_its_grid_counts_and_says_how_late_it_was() {
    let period = Duration::from_millis(5);
    let config = MasterConfig { sync: Some(period), sync_overflow: Some(4), ..MasterConfig::default() };
    let mut master = Master::new(config, &[]).unwrap();
    let sent = sent(&mut master, |n| n % 3 * 100);
    let syncs = of(&sent, Service::Sync);
    assert_eq!(syncs.len(), 201);
    for (n, (at, frame)) in (0..).zip(&syncs) {
        assert!(at.since(Instant::ZERO + period * n) <= Duration::from_micros(200), "{at:?}");
        assert_eq!(frame.data(), [(n % 4 + 1) as u8]);
    }
    let jitter = master.sync_jitter();
    assert_eq!((jitter.count, jitter.min, jitter.max), (201, Duration::ZERO, Duration::from_micros(200)));
    assert!(jitter.mean().abs_diff(Duration::from_micros(100)) < Duration::from_micros(10), "{jitter:?}");
}

#[test]
fn a_sync_that_was_missed_is_not_made_up_for() {
    let config = MasterConfig { sync: Some(Duration::from_millis(5)), ..MasterConfig::default() };
    let mut master = Master::new(config, &[]).unwrap();
    for now in [0, 23, 25] {
        master.handle_timeout(Instant::from_millis(now));
    }
    let sent: Vec<_> = core::iter::from_fn(|| master.poll_tx()).filter(|frame| *frame == wire::sync()).collect();
    assert_eq!(sent.len(), 3);
    assert_eq!(master.sync_jitter().max, Duration::from_millis(18));
}

#[test]
fn time_is_told_once_it_is_known() {
    let config = MasterConfig { time: Some(Duration::from_millis(100)), ..MasterConfig::default() };
    let mut master = Master::new(config, &[]).unwrap();
    assert!(of(&sent(&mut master, |_| 0), Service::Time).is_empty());
    // 2011-06-01 12:00:00 UTC.
    let noon = 1_306_929_600_000_000;
    master.set_time(Instant::from_millis(1010), noon);
    master.handle_timeout(Instant::from_millis(1010));
    let mut time = || {
        let frame = core::iter::from_fn(|| master.poll_tx()).find(|frame| Service::of(frame) == Some(Service::Time));
        let time = frame.and_then(|frame| TimeOfDay::decode(frame.data()));
        let next = master.poll_timeout().unwrap();
        master.handle_timeout(next.max(Instant::from_millis(1110)));
        time
    };
    assert_eq!(time(), Some(TimeOfDay { millis: 43_200_000, days: 10_013 }));
    assert_eq!(time(), Some(TimeOfDay { millis: 43_200_100, days: 10_013 }));
}

#[test]
fn a_broadcast_reset_does_not_reset_the_master() {
    let mut bus = booted();
    bus.master.nmt(Target::All, NmtCommand::ResetNode);
    assert_eq!(bus.master.own_state(), NmtState::Operational);
    let from = bus.sent.len();
    bus.run(60);
    assert!(bus.sent[from..].iter().any(|(_, frame)| *frame == wire::heartbeat(127, NmtState::Operational)));
    for id in [1, 2] {
        assert_eq!(bus.master.stats(id).unwrap().losses, 1);
    }
    bus.run_to(2000, is_booted(2));
}

#[test]
fn the_master_names_its_own_state_and_keeps_to_it() {
    let mut bus = booted();
    bus.master.set_own_state(NmtState::Stopped);
    assert_eq!(bus.master.send_pdo(1, 4, &[0; 6]), Err(PdoError::NotOperational));
    let from = bus.sent.len();
    bus.run(100);
    assert!(bus.sent[from..].iter().any(|(_, frame)| *frame == wire::heartbeat(127, NmtState::Stopped)));
    bus.master.set_own_state(NmtState::Initialising);
    assert_eq!(bus.master.own_state(), NmtState::Stopped);
    bus.master.set_own_state(NmtState::Operational);
    bus.master.send_pdo(1, 4, &[0; 6]).unwrap();
}
