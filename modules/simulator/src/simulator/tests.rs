//! The simulator on its ports: transcripts typed from `docs/facts/boards.md`.

use super::*;
use base::serial::Word;
use module::bench::Bench;
use module::{Shell, ShellConfig};
use navitools::{Point, Pose};

/// A word by word text: `20! 01`: `!` marks the ninth bit.
fn words(text: &str) -> Vec<Word> {
    let word = |token: &str| match token.strip_suffix('!') {
        Some(byte) => Word::address(u8::from_str_radix(byte, 16).unwrap()),
        None => Word::data(u8::from_str_radix(token, 16).unwrap()),
    };
    text.split_whitespace().map(word).collect()
}

fn text(words: &[Word]) -> String {
    let word = |word: &Word| format!("{:02x}{}", word.byte, if word.ninth { "!" } else { "" });
    words.iter().map(word).collect::<Vec<_>>().join(" ")
}

fn config(wire_time: bool) -> Config {
    let irs = vec![Point { x: 0.8, y: 0.2 }, Point { x: 0.8, y: -0.2 }];
    let front = Sd1Config { srfs: vec![Pose::new(0.75, 0.0, 0.0)], irs };
    let board = |name: &str, address, kind| BoardConfig { name: name.into(), address, kind };
    let boards = vec![board("sd1_front", 0x10, BoardKind::Sd1(front)), board("so1", 0x20, BoardKind::So1)];
    let serial = SerialConfig { bus: "rs485.a".into(), baud: 115_200, crc: Crc8::SAE_J1850, real: false, boards };
    Config { serial: vec![serial], wire_time, ..Config::default() }
}

fn bench(config: Config) -> Bench {
    let mut bench = Bench::new(Shell::new(ShellConfig::new("simulator"), Box::new(Simulator::new(config))));
    bench.start();
    bench.pass(Duration::from_millis(10));
    bench
}

/// Asks on the serial line; what comes back within 20 ms, and after how many ns.
fn ask(bench: &mut Bench, request: &str) -> Option<(u64, String)> {
    bench.done();
    let asked = bench.now();
    bench.words(PortId(0), &words(request));
    bench.pass(Duration::from_millis(20));
    let answer = bench.done().into_iter().find_map(|(at, action)| match action {
        module::Action::Send(PortId(0), Output::Words(words)) => Some((at, text(&words))),
        _ => None,
    });
    answer.map(|(at, words)| (at.since(asked).as_nanos() as u64, words))
}

fn fault(bench: &mut Bench, target: &str, fault: &str, duration: f64) {
    let (target, fault) = (target.into(), fault.into());
    bench.message(simulation::CmdFault { timestamp: 0, target, fault, value: 0.0, duration });
}

/// Ticks of a robot that stands: request and answer typed from the table, the CRCs by another program.
const TICKS: &str = "20! 01 00 00 9c";

#[test]
fn the_odometry_board_answers_after_200_us() {
    let mut bench = bench(config(false));
    let (after, answer) = ask(&mut bench, TICKS).unwrap();
    assert_eq!(after, 200_000);
    assert!(answer.starts_with("20! 01 00 04 00 00 00 00 "), "{answer}");
}

#[test]
fn where_the_port_has_no_wire_its_time_is_added() {
    let mut bench = bench(config(true));
    let (after, answer) = ask(&mut bench, TICKS).unwrap();
    // 5 words of request, 9 of answer, each 11 bits at 115200 Bd, rounded up to a nanosecond.
    assert_eq!((after, answer.split(' ').count()), (200_000 + 14 * 95_487, 9));
}

#[test]
fn an_unknown_instruction_and_a_wrong_crc_are_said() {
    let mut bench = bench(config(false));
    assert!(ask(&mut bench, "20! 01 00 00 9d").unwrap().1.starts_with("20! 01 02 00 "));
    let crc = Crc8::SAE_J1850.of([0x20, 0x77, 0, 0]);
    assert!(ask(&mut bench, &format!("20! 77 00 00 {crc:02x}")).unwrap().1.starts_with("20! 77 03 00 "));
    assert_eq!(ask(&mut bench, "33! 01 00 00 9c"), None);
}

#[test]
fn faults_come_last_and_go() {
    let mut bench = bench(config(false));
    let (_, good) = ask(&mut bench, TICKS).unwrap();
    fault(&mut bench, "so1", "silent", 0.1);
    assert_eq!(ask(&mut bench, TICKS), None);
    bench.pass(Duration::from_millis(100));
    assert_eq!(ask(&mut bench, TICKS).unwrap().1, good);
    fault(&mut bench, "so1", "bad_crc", 0.0);
    bench.pass(Duration::from_secs(100));
    let (_, bad) = ask(&mut bench, TICKS).unwrap();
    assert!(bad[..23] == good[..23] && bad != good);
    fault(&mut bench, "so1", "none", 0.0);
    assert_eq!(ask(&mut bench, TICKS).unwrap().1, good);
    fault(&mut bench, "so1", "refuses", 0.1);
    assert!(ask(&mut bench, TICKS).unwrap().1.starts_with("20! 01 03 00 "));
    bench.pass(Duration::from_millis(100));
    assert_eq!(ask(&mut bench, TICKS).unwrap().1, good);
}

#[test]
fn a_fault_that_it_does_not_know_is_reported() {
    let mut bench = bench(config(false));
    for (target, name) in [("so1", "melted"), ("nobody", "silent"), ("sbs1", "stuck")] {
        bench.done();
        fault(&mut bench, target, name, 1.0);
        let reported = bench
            .done()
            .into_iter()
            .any(|(_, action)| matches!(action, module::Action::Report(report) if report.fault == Fault::FaultUnknown));
        assert!(reported, "{target} {name}");
    }
}

#[test]
fn it_can_be_carried_off() {
    let mut bench = bench(config(false));
    fault(&mut bench, "robot", "put:4,5,0.5", 0.0);
    bench.done();
    bench.pass(Duration::from_millis(60));
    let at = |bench: &mut Bench| {
        let truths = bench.published().into_iter().filter_map(|message| match message {
            Message::SimDataTruth(truth) => Some((truth.x, truth.y, truth.theta)),
            _ => None,
        });
        truths.collect::<Vec<_>>().pop().unwrap()
    };
    assert_eq!(at(&mut bench), (4.0, 5.0, 0.5));
    bench.done();
    fault(&mut bench, "robot", "put:0,0,0", 0.0);
    let refused = |(_, action): (_, module::Action)| matches!(action, module::Action::Report(_));
    assert!(bench.done().into_iter().any(refused), "in the corner there is no room");
    fault(&mut bench, "robot", "kidnap", 0.0);
    bench.done();
    bench.pass(Duration::from_millis(60));
    assert_ne!(at(&mut bench), (4.0, 5.0, 0.5));
}

#[test]
fn a_line_is_disturbed_where_no_wire_is_modelled() {
    let mut bench = bench(config(true));
    let answered = |bench: &mut Bench| (0..20).filter(|_| ask(bench, TICKS).is_some()).count();
    assert_eq!(answered(&mut bench), 20);
    fault_of(&mut bench, "rs485.a", "loss", 1.0);
    bench.done();
    assert_eq!(answered(&mut bench), 0);
    fault(&mut bench, "rs485.a", "none", 0.0);
    assert_eq!(answered(&mut bench), 20);
}

#[test]
fn the_truth_is_told_20_times_a_second_and_the_clock_once() {
    let mut bench = bench(config(false));
    bench.done();
    bench.pass(Duration::from_secs(2));
    let (mut truths, mut clocks) = (0, 0);
    for message in bench.published() {
        match message {
            Message::SimDataTruth(truth) => {
                assert_eq!((truth.x, truth.y, truth.collisions), (10.0, 6.0, 0));
                assert!((truth.clearance - 5.7).abs() < 1e-12);
                truths += 1;
            }
            Message::SimDataClock(clock) => {
                assert_eq!(clock.rate, 1.0);
                clocks += 1;
            }
            _ => {}
        }
    }
    assert_eq!((truths, clocks), (40, 2));
}

#[test]
fn people_are_told_5_times_a_second_where_there_are_some() {
    let told = |count: u32| {
        let mut config = config(false);
        config.world.people = crate::world::Crowd { count, ..crate::world::Crowd::default() };
        let mut bench = bench(config);
        bench.done();
        bench.pass(Duration::from_secs(2));
        let people = bench.published().into_iter().filter_map(|message| match message {
            Message::SimDataPeople(people) => Some(people),
            _ => None,
        });
        people.collect::<Vec<_>>()
    };
    assert!(told(0).is_empty());
    let told = told(3);
    assert_eq!(told.len(), 10);
    for people in &told {
        assert_eq!([people.x.len(), people.y.len(), people.radius.len()], [3; 3]);
        let inside = people.x.iter().zip(&people.y).all(|(x, y)| (0.0..20.0).contains(x) && (0.0..12.0).contains(y));
        assert!(inside && people.radius.iter().all(|radius| (0.1..0.5).contains(radius)), "{people:?}");
    }
    assert_ne!(told[0].x, told[9].x, "they walk");
}

#[test]
fn random_words_never_stop_it() {
    let mut bench = bench(config(true));
    let mut random = crate::Random::new(5);
    for _ in 0..20_000 {
        let bits = random.bits();
        bench.words(PortId(0), &[Word { byte: bits as u8, ninth: bits & 0xF00 == 0 }]);
        bench.pass(Duration::from_micros(bits >> 32 & 0x1FF));
    }
    bench.pass(Duration::from_millis(50));
    assert!(ask(&mut bench, TICKS).is_some());
}

/// Every word that the board sends within 20 ms after a request, as text.
fn heard(bench: &mut Bench, request: &str) -> String {
    bench.done();
    bench.words(PortId(0), &words(request));
    bench.pass(Duration::from_millis(20));
    let sent = bench.sent();
    let said =
        sent.iter().filter_map(|(_, output)| if let Output::Words(words) = output { Some(text(words)) } else { None });
    said.collect::<Vec<_>>().join(" ")
}

fn fault_of(bench: &mut Bench, target: &str, fault: &str, value: f64) {
    let (target, fault) = (target.into(), fault.into());
    bench.message(simulation::CmdFault { timestamp: 0, target, fault, value, duration: 0.0 });
}

#[test]
fn a_slow_board_answers_late_until_its_fault_is_over() {
    let mut bench = bench(config(false));
    fault_of(&mut bench, "so1", "slow", 0.012);
    assert_eq!(ask(&mut bench, TICKS).unwrap().0, 12_000_000);
    fault_of(&mut bench, "so1", "none", 0.0);
    assert_eq!(ask(&mut bench, TICKS).unwrap().0, 200_000);
}

#[test]
fn a_wrong_length_has_a_right_crc() {
    let mut bench = bench(config(false));
    fault_of(&mut bench, "so1", "bad_length", 0.0);
    let answer = words(&heard(&mut bench, TICKS));
    assert_eq!((answer[3].byte, answer.len()), (5, 10));
    let (crc, covered) = answer.split_last().unwrap();
    assert_eq!(Crc8::SAE_J1850.of(covered.iter().map(|word| word.byte)), crc.byte);
}

#[test]
fn a_garbled_board_has_some_words_wrong() {
    let mut bench = bench(config(false));
    let good = words(&heard(&mut bench, TICKS));
    fault_of(&mut bench, "so1", "garbled", 0.1);
    let (mut wrong, mut all) = (0, 0);
    for _ in 0..200 {
        let said = words(&heard(&mut bench, TICKS));
        wrong += said.iter().zip(&good).filter(|(said, good)| said != good).count();
        all += said.len();
    }
    assert_eq!(all, 200 * 9);
    assert!((120..240).contains(&wrong), "{wrong} of {all}");
}

#[test]
fn of_two_boards_with_one_address_both_answer() {
    let mut bench = bench(config(false));
    let good = heard(&mut bench, TICKS);
    fault_of(&mut bench, "so1", "clash", 0.0);
    let answers: Vec<String> = (0..100).map(|_| heard(&mut bench, TICKS)).collect();
    let twice = answers.iter().filter(|answer| **answer == format!("{good} {good}")).count();
    let damaged = answers.iter().filter(|answer| words(answer).len() > 9 && !answer.starts_with(&good)).count();
    assert!(twice > 5 && damaged > 50, "{twice} one after the other, {damaged} at once");
}

#[test]
fn who_babbles_talks_unasked_and_through_the_others() {
    let mut bench = bench(config(false));
    fault_of(&mut bench, "sd1_front", "babble", 0.0);
    bench.done();
    bench.pass(Duration::from_millis(100));
    let said = bench.sent();
    assert_eq!(said.len(), 11);
    let Output::Words(first) = &said[0].1 else { panic!("words") };
    assert!(text(first).starts_with("10! 01 00 04 00 00 00 00 "), "{}", text(first));
    // Noise of 20 words lasts 1.9 ms of every 10: it is heard through one answer in five.
    fault_of(&mut bench, "sd1_front", "babble", 1.0);
    let mut whole = 0;
    for n in 0..100 {
        bench.pass(Duration::from_micros(700 + 13 * n));
        whole += usize::from(heard(&mut bench, TICKS).contains("20! 01 00 04 00 00 00 00 "));
    }
    assert!((60..100).contains(&whole), "{whole} of 100");
    fault_of(&mut bench, "sd1_front", "none", 0.0);
    bench.done();
    bench.pass(Duration::from_millis(100));
    assert!(bench.sent().is_empty());
}

#[test]
fn a_reset_takes_100_ms_and_the_counters() {
    let mut bench = bench(config(false));
    fault_of(&mut bench, "so1", "reset", 0.0);
    assert_eq!(ask(&mut bench, TICKS), None);
    bench.pass(Duration::from_millis(100));
    assert!(ask(&mut bench, TICKS).unwrap().1.starts_with("20! 01 00 04 00 00 00 00 "));
}

/// The power controller on the second line.
fn powered() -> Bench {
    let mut config = config(false);
    let psc1 = BoardConfig { name: "psc1".into(), address: 0x40, kind: BoardKind::Psc1(BatteryConfig::default()) };
    let serial = SerialConfig { bus: "rs485.power".into(), boards: vec![psc1], ..config.serial[0].clone() };
    config.serial.push(serial);
    bench(config)
}

/// What comes on the second line, with the time in ms.
fn from_psc1(bench: &mut Bench) -> Vec<(u64, String)> {
    let words = bench.done().into_iter().filter_map(|(at, action)| match action {
        module::Action::Send(PortId(1), Output::Words(words)) => Some((at.as_nanos() / 1_000_000, text(&words))),
        _ => None,
    });
    words.collect()
}

#[test]
fn the_power_controller_tells_of_the_pause_line_by_itself() {
    let mut bench = powered();
    bench.pass(Duration::from_millis(990));
    // Every 500 ms: released, nobody has pulled it yet. CRCs by another program.
    let open = |ms| (ms, format!("40! 80 00 02 00 00 {:02x}", Crc8::SAE_J1850.of([0x40, 0x80, 0, 2, 0, 0])));
    assert_eq!(from_psc1(&mut bench), [open(0), open(500), open(1000)]);
    fault_of(&mut bench, "psc1", "stop_button", 0.0);
    let said = from_psc1(&mut bench);
    assert!(said[0].0 == 1000 && said[0].1.starts_with("40! 80 00 02 01 20 "), "at once: {said:?}");
    fault_of(&mut bench, "psc1", "silent", 0.0);
    bench.pass(Duration::from_secs(2));
    assert!(from_psc1(&mut bench).is_empty());
    fault_of(&mut bench, "psc1", "none", 0.0);
    let said = from_psc1(&mut bench);
    assert!(said[0].1.starts_with("40! 80 00 02 00 20 "), "{said:?}");
}

#[test]
fn the_power_controller_feeds_the_other_boards() {
    let mut bench = powered();
    let crc = Crc8::SAE_J1850.of([0x40, 0x02, 0, 2, 0x40, 0]);
    bench.words(PortId(1), &words(&format!("40! 02 00 02 40 00 {crc:02x}")));
    bench.pass(Duration::from_millis(10));
    assert_eq!(ask(&mut bench, TICKS), None, "sensors are off");
    let crc = Crc8::SAE_J1850.of([0x40, 0x02, 0, 2, 0x40, 0x40]);
    bench.words(PortId(1), &words(&format!("40! 02 00 02 40 40 {crc:02x}")));
    bench.pass(Duration::from_millis(700));
    assert!(ask(&mut bench, TICKS).is_some(), "on again, and booted");
}
