//! The driver with an emulated scanner on a simulated wire in virtual time.

use super::*;
use crate::rs485_bus::Kind;
use crate::testing::Rig;
use messages::lowlevel::{DataBeacons, DataScanner};
use module::State;
use rs485::boards::sbs1::{Debug, Sighting, build_beacons, build_debug};
use rs485::frame::Status;
use rs485::slave::Asked;
use settings::Section as _;

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn config() -> Config {
    Config {
        bus: "rs485.b".into(),
        baud: 115_200,
        crc: Crc8::SAE_J1850,
        node: Node {
            name: "sbs1".into(),
            address: sbs1::ADDRESS,
            kind: Kind::Sbs1,
            rate_hz: 1.0,
            timeout: ms(20),
            ..Node::usual()
        },
        beacons: vec![1, 2],
    }
}

/// Received selections in order; sightings; time of switching on.
#[derive(Default)]
struct Scanner {
    sent: Vec<Vec<u8>>,
    sees: Vec<Sighting>,
    on: Instant,
    /// Pulses rejected a second; supply, mV.
    rejects: u32,
    supply_mv: u16,
}

fn answer(board: &mut Scanner, now: Instant, asked: &Asked) -> (Status, Vec<u8>) {
    match asked.instruction {
        code if code == SET_BEACON_IDS.code => {
            board.sent.push(asked.data.to_vec());
            (Status::Ok, Vec::new())
        }
        code if code == GET_BEACON_DATA.code => (Status::Ok, build_beacons(&board.sees).to_vec()),
        code if code == GET_DEBUG_DATA.code => {
            let seconds = now.since(board.on).as_secs();
            let rejected_pulses = (seconds * u64::from(board.rejects)) as u16;
            let debug = Debug { sweeps: seconds as u16, rejected_pulses, supply_mv: board.supply_mv };
            (Status::Ok, build_debug(debug).to_vec())
        }
        _ => (Status::UnknownInstruction, Vec::new()),
    }
}

fn rig() -> Rig<Scanner> {
    let sees = vec![Sighting { id: 1, bearing: -9000, strength: 255, age_ms: 400 }];
    let scanner = Scanner { sees, supply_mv: 5000, ..Scanner::default() };
    Rig::new(NAME, Box::new(Rs485b::new(config()).unwrap()), sbs1::ADDRESS, scanner, answer)
}

fn beacons(rig: &mut Rig<Scanner>) -> Vec<(Instant, DataBeacons)> {
    rig.take(|message| if let Message::LlDataBeacons(beacons) = message { Some(beacons) } else { None })
}

fn active(rig: &mut Rig<Scanner>, ids: &[i32]) {
    rig.message(DataActiveBeacons { timestamp: 0, ids: ids.to_vec() });
}

#[test]
fn beacons_are_selected_and_sightings_published_once_a_second() {
    let mut rig = rig();
    rig.run(ms(100));
    assert_eq!(rig.board.sent, [[1, 2]]);
    assert_eq!(rig.news(), "INIT\nsbs1 (0x30 on rs485.b): firmware 1.4\nRUN");
    rig.run(ms(5000));
    let beacons = beacons(&mut rig);
    assert_eq!(beacons.len(), 6);
    let (at, last) = beacons.last().unwrap();
    assert_eq!(last.timestamp, (at.as_nanos() / 1000) as i64);
    // 12 words of 95.487 us, rounded down to a microsecond twice.
    assert!((last.timestamp - last.beacons[0].timestamp - 401_146).abs() <= 1, "{last:?}");
    assert_eq!(rig.board.sent.len(), 1, "reported once");
}

#[test]
fn commanded_beacons_are_selected_and_invalid_ones_rejected() {
    let mut rig = rig();
    rig.run(ms(1500));
    rig.news();
    active(&mut rig, &[7, 3]);
    rig.run(ms(50));
    assert_eq!(rig.board.sent.last().unwrap(), &[7, 3]);
    active(&mut rig, &[]);
    rig.run(ms(50));
    assert_eq!(rig.board.sent.last().unwrap(), &[] as &[u8], "all");
    for nonsense in [&[256][..], &[-1], &[4, 4], &[9; 50]] {
        active(&mut rig, nonsense);
        rig.run(ms(50));
        assert_eq!(rig.news(), "Warning CommandForbidden beacons", "{nonsense:?}");
    }
    assert_eq!(rig.board.sent.len(), 3);
}

#[test]
fn a_board_that_was_reset_gets_its_beacons_again() {
    let mut rig = rig();
    rig.run(ms(15_000));
    assert_eq!(rig.board.sent.len(), 1);
    rig.board.on = rig.bench.now();
    rig.run(ms(10_000));
    assert_eq!(rig.board.sent, [[1, 2], [1, 2]], "its sweep counter restarted");
    rig.board.sees[0].id = 9;
    rig.run(ms(1000));
    assert_eq!(rig.board.sent.len(), 3, "it reports an unselected beacon");
}

#[test]
fn a_lost_board_is_polled_rarely_and_configured_on_return() {
    let mut rig = rig();
    rig.run(ms(1500));
    rig.news();
    rig.dead = true;
    active(&mut rig, &[5]);
    rig.run(ms(20_000));
    assert_eq!(rig.news(), "Warning BoardDegraded sbs1\nError BoardLost sbs1\nERROR");
    beacons(&mut rig);
    rig.board.sent.clear();
    rig.dead = false;
    rig.run(ms(2000));
    assert_eq!(rig.board.sent, [[5]]);
    let back = "Notice BoardDegraded sbs1\nNotice BoardLost sbs1\nRUN\nsbs1 (0x30 on rs485.b): firmware 1.4";
    assert_eq!(rig.news(), back);
    assert!(!beacons(&mut rig).is_empty());
}

#[test]
fn commands_received_in_stop_are_sent_later() {
    let mut rig = rig();
    rig.run(ms(1500));
    rig.command(State::Stop);
    rig.run(ms(50));
    beacons(&mut rig);
    active(&mut rig, &[5]);
    rig.run(ms(3000));
    assert!(beacons(&mut rig).is_empty() && rig.board.sent.len() == 1);
    rig.command(State::Run);
    rig.run(ms(100));
    assert_eq!(rig.board.sent.last().unwrap(), &[5]);
}

#[test]
fn an_implausible_answer_is_reported_once_and_not_published() {
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

fn status(rig: &mut Rig<Scanner>) -> Vec<(Instant, DataScanner)> {
    rig.take(|message| if let Message::LlDataScanner(scanner) = message { Some(scanner) } else { None })
}

#[test]
fn rejected_pulses_are_counted_over_wraps_and_resets_of_the_board() {
    let mut rig = rig();
    rig.board.rejects = 3000;
    rig.run(ms(5000));
    let first = status(&mut rig).remove(0).1;
    assert_eq!((first.name.as_str(), first.rejected, first.supply), ("sbs1", 0, 5.0));
    assert!(first.rejected_rate.is_nan());
    rig.run(ms(30_000));
    let last = status(&mut rig).pop().unwrap().1;
    assert!(last.rejected > 65_536 && (last.rejected_rate - 3000.0).abs() < 310.0, "{last:?}");
    rig.board.on = rig.bench.now();
    rig.run(ms(10_000));
    let after = status(&mut rig).pop().unwrap().1;
    assert!(after.rejected >= last.rejected && after.rejected - last.rejected <= 31_000, "{after:?}");
}

#[test]
fn a_supply_out_of_its_range_is_reported_once_and_its_end_once() {
    let mut rig = rig();
    rig.run(ms(12_000));
    rig.news();
    rig.board.supply_mv = 4200;
    rig.run(ms(30_000));
    assert_eq!(rig.news(), "Warning BoardSupply sbs1");
    // Within the limit, and not by the margin: neither raised nor cleared again.
    rig.board.supply_mv = 4520;
    rig.run(ms(20_000));
    assert_eq!(rig.news(), "");
    rig.board.supply_mv = 5000;
    rig.run(ms(20_000));
    assert_eq!(rig.news(), "Notice BoardSupply sbs1");
}

#[test]
fn an_invalid_configuration_is_rejected() {
    let refused = |change: fn(&mut Config)| {
        let mut config = config();
        change(&mut config);
        Rs485b::new(config).unwrap_err()
    };
    assert_eq!(refused(|config| config.node.rate_hz = 0.0), ConfigError::Rate);
    assert_eq!(refused(|config| config.beacons = vec![1, 1]), ConfigError::Beacons);
    assert_eq!(refused(|config| config.beacons = (0..43).collect()), ConfigError::Beacons);
}
