//! Lines of devices with simple request and answer; what they answer is typed here, checks by another program.

use super::super::serial::{Serial, SerialKeys};
use super::{Io, NAME};
use base::serial::Word;
use base::{Duration, Instant};
use messages::Message;
use messages::common::CmdState;
use messages::lowlevel::{CmdOutput, DataBus, DataIo};
use module::bench::Bench;
use module::{Action, Event, Input, Output, PortId, Shell, ShellConfig, State};
use settings::Node;
use std::path::Path;

/// A board with two temperatures, a door and a fan, and another one on the same line.
const BOARD: &str = r#"
check = "crc16-modbus"
retries = 1
[[requests]]
name = "temperatures"
request = "01 03"
answer_length = 9
answer_prefix = "01 03"
signals = [
    { name = "inside", at = 2, format = "i16", scale = 0.1 },
    { name = "outside", at = 4, format = "i16", scale = 0.1, unknown = -32768 },
    { name = "door", at = 6, format = "bit", bit = 2 },
]
[[requests]]
name = "fan"
request = "01 06 00 00"
echo = true
signals = [
    { name = "fan", at = 2, format = "u16", scale = 0.1, output = true, safe = 100, min = 0, max = 100 },
]
[[requests]]
name = "level"
device = "tank"
request = "02 03"
answer_length = 6
answer_prefix = "02 03"
signals = [ { name = "level", at = 2, format = "u16" } ]
"#;

const ASK: [u8; 4] = [0x01, 0x03, 0x40, 0x21];
const TEMPERATURES: [u8; 9] = [0x01, 0x03, 0x00, 0xF3, 0xFF, 0xC4, 0x05, 0x9A, 0x44];
const NO_OUTSIDE: [u8; 9] = [0x01, 0x03, 0x00, 0xF3, 0x80, 0x00, 0x00, 0x39, 0x5F];
const FULL: [u8; 6] = [0x01, 0x06, 0x03, 0xE8, 0xE1, 0x67];
const SLOW: [u8; 6] = [0x01, 0x06, 0x00, 0xC8, 0xE0, 0x4F];
const ASK_LEVEL: [u8; 4] = [0x02, 0x03, 0x40, 0xD1];
const LEVEL: [u8; 6] = [0x02, 0x03, 0x00, 0x11, 0x31, 0x90];

fn keys(text: &str) -> Result<SerialKeys, String> {
    let node = Node::parse(Path::new("robot.toml"), text).map_err(|lines| lines.join("\n"))?;
    settings::read_as(&node).map_err(|error| error.to_string())
}

struct Rig {
    bench: Bench,
    /// What is answered to a request, and to how many of them.
    answers: Vec<(Vec<u8>, Vec<u8>, usize)>,
    sent: Vec<Vec<u8>>,
    log: Vec<(Instant, Action)>,
}

impl Rig {
    fn new(table: &str, answers: &[(&[u8], &[u8])]) -> Self {
        let line = Serial { bus: "io.serial.board".into(), baud: Some(9600), keys: keys(table).unwrap() };
        let config = super::Config {
            modbus: Vec::new(),
            serial: vec![line],
            gpio: Vec::new(),
            batteries: Vec::new(),
            ..super::config(modbus::Line::Tcp)
        };
        let bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(Io::new(config).unwrap())));
        let answers = answers.iter().map(|(request, answer)| (request.to_vec(), answer.to_vec(), usize::MAX));
        let mut rig = Self { bench, answers: answers.collect(), sent: Vec::new(), log: Vec::new() };
        rig.bench.start();
        rig
    }

    /// Time passes in steps of 1 ms; an answer comes in the next one.
    fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            let mut answers = Vec::new();
            for (at, action) in self.bench.done() {
                if let Action::Send(PortId(0), Output::Words(words)) = &action {
                    let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
                    let known = self.answers.iter_mut().find(|(request, _, left)| *request == bytes && *left > 0);
                    if let Some((_, answer, left)) = known {
                        *left -= 1;
                        answers.push(answer.clone());
                    }
                    self.sent.push(bytes);
                }
                self.log.push((at, action));
            }
            self.bench.pass(Duration::from_millis(1));
            answers.iter().for_each(|answer| self.receive(answer));
        }
    }

    fn receive(&mut self, bytes: &[u8]) {
        let words: Vec<Word> = bytes.iter().copied().map(Word::data).collect();
        self.bench.words(PortId(0), &words);
    }

    fn answer(&mut self, request: &[u8], answer: &[u8]) {
        self.answers.retain(|(known, ..)| known != request);
        self.answers.push((request.to_vec(), answer.to_vec(), usize::MAX));
    }

    fn published(&self) -> impl DoubleEndedIterator<Item = &Message> {
        self.log
            .iter()
            .filter_map(|(_, action)| if let Action::Publish(message) = action { Some(message) } else { None })
    }

    fn value(&self, name: &str) -> (f64, bool) {
        let last: Option<&DataIo> = self.published().rev().find_map(|message| match message {
            Message::LlDataIo(io) => Some(io),
            _ => None,
        });
        let last = last.unwrap();
        let found = last.signals.iter().find(|signal| signal.name == name).unwrap();
        (found.value, found.valid)
    }

    fn bus(&self) -> DataBus {
        let last: Option<&DataBus> = self.published().rev().find_map(|message| match message {
            Message::LlDataBus(bus) => Some(bus),
            _ => None,
        });
        last.unwrap().clone()
    }

    fn news(&mut self) -> Vec<String> {
        let log = std::mem::take(&mut self.log);
        let news = |(_, action): &(Instant, Action)| match action {
            Action::Report(report) => Some(format!("{:?} {} {}", report.severity, report.fault.name(), report.subject)),
            Action::State(state) => Some(state.to_string()),
            _ => None,
        };
        log.iter().filter_map(news).collect()
    }
}

fn close(value: (f64, bool), expected: f64) -> bool {
    (value.0 - expected).abs() < 1e-9 && value.1
}

const ALL: [(&[u8], &[u8]); 4] = [(&ASK, &TEMPERATURES), (&FULL, &FULL), (&SLOW, &SLOW), (&ASK_LEVEL, &LEVEL)];

#[test]
fn a_board_is_read_and_its_output_is_written() {
    let mut rig = Rig::new(BOARD, &ALL);
    rig.run(1200);
    assert!(close(rig.value("inside"), 24.3) && close(rig.value("outside"), -6.0));
    assert_eq!((rig.value("door"), rig.value("level")), ((1.0, true), (17.0, true)));
    assert_eq!(rig.value("fan"), (100.0, true), "its safe value");
    assert!(rig.sent.contains(&FULL.to_vec()) && !rig.sent.contains(&SLOW.to_vec()));
    rig.bench.message(CmdOutput { name: "fan".into(), value: 20.0, source: "test".into(), ..Default::default() });
    rig.run(200);
    assert_eq!(rig.value("fan"), (20.0, true));
    assert!(rig.sent.contains(&SLOW.to_vec()));
    rig.run(1200);
    assert_eq!(rig.value("fan"), (100.0, true), "its commander is silent");
    let bus = rig.bus();
    assert_eq!((&*bus.bus, bus.errors, bus.nodes.len()), ("io.serial.board", 0, 2));
    assert_eq!((&*bus.nodes[1].name, bus.nodes[1].timeouts), ("tank", 0));
    assert!(rig.news().contains(&"RUN".to_owned()));
}

#[test]
fn a_value_that_the_device_does_not_have_is_unknown_and_the_others_are_not() {
    let mut rig = Rig::new(BOARD, &ALL);
    rig.run(1200);
    rig.answer(&ASK, &NO_OUTSIDE);
    rig.run(300);
    assert!(!rig.value("outside").1 && close(rig.value("inside"), 24.3));
    assert_eq!(rig.value("door"), (0.0, true));
}

#[test]
fn a_device_that_is_silent_or_answers_something_else_is_lost_and_the_other_one_is_not() {
    for wrong in [None, Some(&[0x01, 0x83, 0x02][..]), Some(&TEMPERATURES[..8]), Some(&LEVEL[..])] {
        let mut rig = Rig::new(BOARD, &ALL);
        rig.run(1200);
        rig.news();
        rig.answers.retain(|(request, ..)| *request == ASK_LEVEL);
        wrong.iter().for_each(|wrong| rig.answer(&ASK, wrong));
        rig.run(2600);
        assert!(!rig.value("inside").1 && !rig.value("fan").1, "{wrong:?}: older than age_max_s");
        assert_eq!(rig.value("level"), (17.0, true));
        let bus = rig.bus();
        assert!(bus.errors > 0 && bus.nodes[0].state != bus.nodes[1].state, "{bus:?}");
        let attempts = rig.sent.len();
        assert_eq!(rig.news(), ["Error IoDeviceLost io.serial.board device", "ERROR"], "{wrong:?}");
        rig.run(1000);
        let to_device = rig.sent[attempts..].iter().filter(|sent| sent[0] == 1).count();
        assert!((1..=4).contains(&to_device), "{to_device}: once a second, with one retry");
        ALL.iter().for_each(|(request, answer)| rig.answer(request, answer));
        rig.run(1500);
        assert!(close(rig.value("inside"), 24.3));
        let news = rig.news();
        assert_eq!(news, ["Notice IoDeviceLost io.serial.board device", "RUN"], "{wrong:?}");
    }
}

#[test]
fn a_line_that_is_down_is_reported_and_bytes_of_it_are_not_taken() {
    let mut rig = Rig::new(BOARD, &ALL);
    rig.run(1200);
    rig.news();
    let port = PortId(0);
    rig.bench.event(Event::Port { port, input: Input::Down("unplugged") });
    rig.receive(&TEMPERATURES);
    let sent = rig.sent.len();
    rig.run(2000);
    assert!(rig.sent.len() <= sent + 1, "nothing is sent");
    assert!(!rig.value("inside").1);
    assert!(rig.news().contains(&"Error PortDown io.serial.board".to_owned()));
    rig.bench.event(Event::Port { port, input: Input::Up });
    rig.run(1200);
    assert!(close(rig.value("inside"), 24.3));
}

#[test]
fn outputs_get_their_safe_values_in_pause_and_in_stop_nothing_is_read() {
    let mut rig = Rig::new(BOARD, &ALL);
    rig.run(1200);
    rig.bench.message(CmdOutput { name: "fan".into(), value: 20.0, source: "test".into(), ..Default::default() });
    rig.run(100);
    assert_eq!(rig.value("fan"), (20.0, true));
    let state = State::Stop as i8;
    rig.bench.message(CmdState { module: NAME.into(), state, manual: true, ..Default::default() });
    rig.run(300);
    let sent = rig.sent.len();
    rig.run(1500);
    assert_eq!(rig.value("fan"), (100.0, true));
    assert!(rig.sent[sent..].iter().all(|sent| *sent == FULL), "{:?}", &rig.sent[sent..]);
    assert!(rig.sent.len() > sent, "it is refreshed");
}

#[test]
fn an_ascii_board_is_read_and_written() {
    let table = r#"
        request_end = "0D"
        answer_end = "0D"
        [[requests]]
        name = "temperature"
        request = "'>A1?'"
        signals = [ { name = "t", format = "decimal" } ]
        [[requests]]
        name = "heater"
        request = "'>B1='"
        answer = "'OK'"
        signals = [
            { name = "heater", at = 4, format = "decimal", length = 4, decimals = 1, output = true, safe = 0 },
        ]
    "#;
    assert!(keys(table).unwrap_err().contains("requests[1].signals[0].at = 4"), "beyond the request");
    let table = table.replace("'>B1='", "'>B1=0000'");
    let mut rig = Rig::new(&table, &[(b">A1?\r", b"+023.4\r"), (b">B1=00.0\r", b"OK\r"), (b">B1=37.5\r", b"OK\r")]);
    rig.run(1200);
    assert_eq!((rig.value("t"), rig.value("heater")), ((23.4, true), (0.0, true)));
    rig.bench.message(CmdOutput { name: "heater".into(), value: 37.5, source: "test".into(), ..Default::default() });
    rig.run(300);
    assert_eq!(rig.value("heater"), (37.5, true));
    rig.answer(b">A1?\r", b"----\r");
    rig.run(300);
    assert!(!rig.value("t").1, "no number");
    assert!(!rig.news().iter().any(|news| news.contains("IoDeviceLost")));
}

#[test]
fn mistakes_are_refused_with_their_line_and_what_would_be_right() {
    for (from, to, why) in [
        (
            "at = 6,",
            "at = 7,",
            "at = 7: expected a place within the 7 bytes of the answer before suffix, check and end",
        ),
        ("at = 4,", "at = 3,", "at = 3: expected a place that \"inside\" does not overlap"),
        ("at = 4,", "at = 1,", "at = 1: expected at least 2, behind answer_prefix"),
        ("at = 2, format = \"u16\", scale", "at = 3, format = \"u16\", scale", "within the 4 bytes of the request"),
        ("name = \"fan\"\nrequest", "request", "requests[1].name: missing"),
        ("name = \"fan\"\nrequest", "name = \"level\"\nrequest", "a name that no other request of the line has"),
        ("name = \"door\"", "nam = \"door\"", "name: missing"),
        ("answer_length = 9", "", "answer_length: missing, expected its bytes: a check in bytes may be equal"),
        ("answer_length = 9", "answer_length = 3", "answer_length = 3: expected at least 4"),
        ("answer_length = 9", "answer_length = 257", "an integer from 1 to 256"),
        ("\"crc16-modbus\"", "\"crc99\"", "check = \"crc99\": expected"),
        ("\"01 03\"\nanswer_length", "\"1 03\"\nanswer_length", "hexadecimal digits and text in single quotes"),
        ("\"01 03\"\nanswer_length", "\"\"\nanswer_length", "expected at least one byte"),
        ("echo = true", "echo = true\nanswer = \"01\"", "expected nothing beside echo"),
        ("echo = true", "echo = true\nanswer_prefix = \"01\"", "expected nothing beside echo or answer"),
        ("safe = 100,", "safe = 101,", "safe = 101: expected a value that the output has"),
        ("safe = 100,", "", "safe: missing"),
        ("scale = 0.1 }", "scale = 0 }", "scale = 0: expected a number other than 0"),
        ("scale = 0.1 }", "length = 3 }", "a key of \"decimal\" and \"hex\" only"),
        ("bit = 2", "output = true, safe = 0", "an output, as others of this request: inputs need one of their own"),
        ("output = true, safe = 100,", "", "an output: with echo or answer no value is read"),
        ("retries = 1", "retries = 11", "retries = 11"),
        ("retries = 1", "check_polynomial = 7", "a key of check = \"crc8\" only"),
    ] {
        assert!(BOARD.contains(from), "{from}");
        let error = keys(&BOARD.replacen(from, to, 1)).unwrap_err();
        assert!(error.contains(why) && error.starts_with("robot.toml:"), "{why}: {error}");
    }
    assert!(keys("check = \"xor8\"").unwrap_err().contains("requests: missing, expected at least one request"));
}
