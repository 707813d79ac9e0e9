//! The driver against an emulated scanner, on a small wire in virtual time.

use super::*;
use crate::rs485_bus::Kind;
use crate::testing::Rig;
use messages::lowlevel::DataBeacons;
use module::State;
use rs485::boards::sbs1::{Debug, Sighting, build_beacons, build_debug};
use rs485::frame::Status;
use rs485::slave::Asked;

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn config() -> Config {
    Config {
        bus: "rs485.b".into(),
        baud: 115_200,
        crc: Crc8::SAE_J1850,
        node: Node { name: "sbs1".into(), address: sbs1::ADDRESS, kind: Kind::Sbs1, rate_hz: 1.0, timeout: ms(20) },
        beacons: vec![1, 2],
    }
}

/// What it was told, in order; what it sees; when it was switched on.
#[derive(Default)]
struct Scanner {
    told: Vec<Vec<u8>>,
    sees: Vec<Sighting>,
    on: Instant,
}

fn answer(board: &mut Scanner, now: Instant, asked: &Asked) -> (Status, Vec<u8>) {
    match asked.instruction {
        code if code == SET_BEACON_IDS.code => {
            board.told.push(asked.data.to_vec());
            (Status::Ok, Vec::new())
        }
        code if code == GET_BEACON_DATA.code => (Status::Ok, build_beacons(&board.sees).to_vec()),
        code if code == GET_DEBUG_DATA.code => {
            let sweeps = now.since(board.on).as_secs() as u16;
            (Status::Ok, build_debug(Debug { sweeps, ..Debug::default() }).to_vec())
        }
        _ => (Status::UnknownInstruction, Vec::new()),
    }
}

fn rig() -> Rig<Scanner> {
    let sees = vec![Sighting { id: 1, bearing: -9000, strength: 255, age_ms: 400 }];
    let scanner = Scanner { sees, ..Scanner::default() };
    Rig::new(NAME, Box::new(Rs485b::new(config()).unwrap()), sbs1::ADDRESS, scanner, answer)
}

fn beacons(rig: &mut Rig<Scanner>) -> Vec<(Instant, DataBeacons)> {
    rig.take(|message| if let Message::LlDataBeacons(beacons) = message { Some(beacons) } else { None })
}

fn active(rig: &mut Rig<Scanner>, ids: &[i32]) {
    rig.message(DataActiveBeacons { timestamp: 0, ids: ids.to_vec() });
}

#[test]
fn it_tells_the_board_its_beacons_and_publishes_once_a_second() {
    let mut rig = rig();
    rig.run(ms(100));
    assert_eq!(rig.board.told, [[1, 2]]);
    assert_eq!(rig.news(), "INIT\nsbs1 (0x30 on rs485.b): firmware 1.4\nRUN");
    rig.run(ms(5000));
    let beacons = beacons(&mut rig);
    assert_eq!(beacons.len(), 6);
    let (at, last) = beacons.last().unwrap();
    assert_eq!(last.timestamp, (at.as_nanos() / 1000) as i64);
    // 12 words of 95.487 us, rounded down to a microsecond twice.
    assert!((last.timestamp - last.beacons[0].timestamp - 401_146).abs() <= 1, "{last:?}");
    assert_eq!(rig.board.told.len(), 1, "told once");
}

#[test]
fn commanded_beacons_are_told_and_nonsense_is_refused() {
    let mut rig = rig();
    rig.run(ms(1500));
    rig.news();
    active(&mut rig, &[7, 3]);
    rig.run(ms(50));
    assert_eq!(rig.board.told.last().unwrap(), &[7, 3]);
    active(&mut rig, &[]);
    rig.run(ms(50));
    assert_eq!(rig.board.told.last().unwrap(), &[] as &[u8], "all");
    for nonsense in [&[256][..], &[-1], &[4, 4], &[9; 50]] {
        active(&mut rig, nonsense);
        rig.run(ms(50));
        assert_eq!(rig.news(), "Warning CommandForbidden beacons", "{nonsense:?}");
    }
    assert_eq!(rig.board.told.len(), 3);
}

#[test]
fn a_board_that_was_reset_is_told_again() {
    let mut rig = rig();
    rig.run(ms(15_000));
    assert_eq!(rig.board.told.len(), 1);
    rig.board.on = rig.bench.now();
    rig.run(ms(10_000));
    assert_eq!(rig.board.told, [[1, 2], [1, 2]], "its sweeps began anew");
    rig.board.sees[0].id = 9;
    rig.run(ms(1000));
    assert_eq!(rig.board.told.len(), 3, "it sees what it was not to look for");
}

#[test]
fn a_lost_board_is_reported_not_pestered_and_told_when_it_is_back() {
    let mut rig = rig();
    rig.run(ms(1500));
    rig.news();
    rig.dead = true;
    active(&mut rig, &[5]);
    rig.run(ms(20_000));
    assert_eq!(rig.news(), "Warning BoardDegraded sbs1\nError BoardLost sbs1\nERROR");
    beacons(&mut rig);
    rig.board.told.clear();
    rig.dead = false;
    rig.run(ms(2000));
    assert_eq!(rig.board.told, [[5]]);
    let back = "Notice BoardDegraded sbs1\nNotice BoardLost sbs1\nRUN\nsbs1 (0x30 on rs485.b): firmware 1.4";
    assert_eq!(rig.news(), back);
    assert!(!beacons(&mut rig).is_empty());
}

#[test]
fn in_stop_it_asks_nothing_and_tells_later_what_was_commanded() {
    let mut rig = rig();
    rig.run(ms(1500));
    rig.command(State::Stop);
    rig.run(ms(50));
    beacons(&mut rig);
    active(&mut rig, &[5]);
    rig.run(ms(3000));
    assert!(beacons(&mut rig).is_empty() && rig.board.told.len() == 1);
    rig.command(State::Run);
    rig.run(ms(100));
    assert_eq!(rig.board.told.last().unwrap(), &[5]);
}

#[test]
fn what_cannot_be_is_reported_once_and_not_published() {
    let mut rig = rig();
    rig.run(ms(500));
    beacons(&mut rig);
    rig.news();
    rig.board.sees[0].bearing = 18_000;
    rig.run(ms(3000));
    assert_eq!((beacons(&mut rig).len(), rig.news().as_str()), (0, "Warning BoardImplausible sbs1"));
    rig.board.sees[0].bearing = 0;
    rig.run(ms(1000));
    assert_eq!((beacons(&mut rig).len(), rig.news().as_str()), (1, "Notice BoardImplausible sbs1"));
}

#[test]
fn a_configuration_that_cannot_be_is_refused() {
    let refused = |change: fn(&mut Config)| {
        let mut config = config();
        change(&mut config);
        Rs485b::new(config).unwrap_err()
    };
    assert_eq!(refused(|config| config.node.rate_hz = 0.0), ConfigError::Rate);
    assert_eq!(refused(|config| config.beacons = vec![1, 1]), ConfigError::Beacons);
    assert_eq!(refused(|config| config.beacons = (0..43).collect()), ConfigError::Beacons);
}
