//! Master and device against the specification's examples, against each other, and against hostile lines.

use crate::crc::crc16;
use crate::device::{Device, Faults};
use crate::pdu::{Bits, Data, Rejection};
use crate::value::{Kind, Number, Place};
use crate::{Bytes, Config, ConfigError, Event, Exception, Failure, Line, Master, Refused, Request, Table};
use base::{Duration, Instant};
use std::vec;
use std::vec::Vec;
use testing::Random;

const RTU: Line = Line::Rtu { baud: 19_200 };
const UNIT: u8 = 17;

fn read(table: Table, address: u16, count: u16) -> Request {
    Request::Read { table, address, count }
}

fn bits(bits: &[u8]) -> Bits {
    let mut packed = Bits::default();
    bits.iter().for_each(|bit| assert!(packed.push(*bit != 0)));
    packed
}

fn words(words: &[u16]) -> Request {
    Request::WriteRegisters { address: 1, words: heapless::Vec::from_slice(words).unwrap() }
}

/// Requests and answers as printed in Application Protocol V1.1b3, 6.1 to 6.6, 6.11 and 6.12.
fn examples() -> Vec<(Request, Vec<u8>, Vec<u8>)> {
    vec![
        (read(Table::Coils, 0x13, 19), vec![1, 0, 0x13, 0, 0x13], vec![1, 3, 0xCD, 0x6B, 0x05]),
        (read(Table::DiscreteInputs, 0xC4, 22), vec![2, 0, 0xC4, 0, 0x16], vec![2, 3, 0xAC, 0xDB, 0x35]),
        (
            read(Table::HoldingRegisters, 0x6B, 3),
            vec![3, 0, 0x6B, 0, 3],
            vec![3, 6, 0x02, 0x2B, 0x00, 0x00, 0x00, 0x64],
        ),
        (read(Table::InputRegisters, 8, 1), vec![4, 0, 8, 0, 1], vec![4, 2, 0x00, 0x0A]),
        (Request::WriteCoil { address: 0xAC, on: true }, vec![5, 0, 0xAC, 0xFF, 0], vec![5, 0, 0xAC, 0xFF, 0]),
        (Request::WriteRegister { address: 1, word: 3 }, vec![6, 0, 1, 0, 3], vec![6, 0, 1, 0, 3]),
        (
            Request::WriteCoils { address: 0x13, bits: bits(&[1, 0, 1, 1, 0, 0, 1, 1, 1, 0]) },
            vec![15, 0, 0x13, 0, 0x0A, 2, 0xCD, 0x01],
            vec![15, 0, 0x13, 0, 0x0A],
        ),
        (words(&[0x000A, 0x0102]), vec![16, 0, 1, 0, 2, 4, 0, 0x0A, 1, 2], vec![16, 0, 1, 0, 2]),
    ]
}

#[test]
fn requests_and_answers_are_those_of_the_specification() {
    for (request, bytes, answer) in examples() {
        assert_eq!(request.encode()[..], bytes[..], "{request:?}");
        assert_eq!(Request::decode(&bytes), Ok(request.clone()));
        let data = request.accept(&answer).unwrap_or_else(|why| panic!("{request:?}: {why:?}"));
        match request {
            Request::Read { table: Table::Coils, .. } => {
                // 6.1: outputs 27-20 are CD, 35-28 are 6B, 38-36 are 5.
                let read: Vec<u8> = (0..19).map(|n| u8::from(data.bit(n).unwrap())).collect();
                assert_eq!(read, [1, 0, 1, 1, 0, 0, 1, 1, 1, 1, 0, 1, 0, 1, 1, 0, 1, 0, 1]);
            }
            Request::Read { table: Table::HoldingRegisters, .. } => {
                assert_eq!([0, 1, 2, 3].map(|n| data.word(n)), [Some(555), Some(0), Some(100), None]);
            }
            _ => {}
        }
    }
}

#[test]
fn every_other_answer_is_refused() {
    for (request, _, answer) in examples() {
        for len in 0..answer.len() {
            assert_eq!(request.accept(&answer[..len]), Err(Rejection::Malformed), "{request:?} cut to {len}");
        }
        assert_eq!(request.accept(&[&answer[..], &[0]].concat()), Err(Rejection::Malformed), "{request:?} and a byte");
        // Function and length; of a write also address and value.
        let checked = if matches!(request, Request::Read { .. }) { 2 } else { answer.len() };
        for (at, bit) in (0..checked).flat_map(|at| (0..8).map(move |bit| (at, bit))) {
            let mut other = answer.clone();
            other[at] ^= 1 << bit;
            assert_eq!(request.accept(&other), Err(Rejection::Malformed), "{request:?}: {other:?}");
        }
        let refused = request.accept(&[request.code() | 0x80, 2]);
        assert_eq!(refused, Err(Rejection::Exception(Exception::ILLEGAL_ADDRESS)));
    }
}

#[test]
fn a_device_answers_bad_requests_by_the_exceptions_of_the_specification() {
    use Exception as E;
    let of = |pdu: &[u8]| Request::decode(pdu).unwrap_err();
    assert_eq!(of(&[]), E::ILLEGAL_FUNCTION);
    assert_eq!(of(&[0x2B, 0x0E, 1, 0, 0]), E::ILLEGAL_FUNCTION);
    assert_eq!(of(&[3, 0, 0, 0, 0]), E::ILLEGAL_VALUE, "no registers");
    assert_eq!(of(&[3, 0, 0, 0, 126]), E::ILLEGAL_VALUE, "too many");
    assert_eq!(of(&[3, 0xFF, 0xFF, 0, 2]), E::ILLEGAL_ADDRESS, "beyond the last");
    assert_eq!(of(&[5, 0, 0, 1, 0]), E::ILLEGAL_VALUE, "neither on nor off");
    assert_eq!(of(&[1, 0, 0, 0, 8, 0]), E::ILLEGAL_VALUE, "a byte too many");
    assert_eq!(of(&[16, 0, 0, 0, 2, 2, 0, 0]), E::ILLEGAL_VALUE, "count and length differ");
    assert_eq!(of(&[15, 0xFF, 0xFF, 0, 2, 1, 3]), E::ILLEGAL_ADDRESS);
}

#[test]
fn the_largest_requests_fit_and_larger_ones_are_refused() {
    let mut master = Master::new(Config::new(Line::Tcp)).unwrap();
    let coils = |count: usize| Request::WriteCoils { address: 0, bits: bits(&vec![1; count]) };
    assert_eq!(coils(0x7B0).encode().len(), 252);
    assert!(!bits(&vec![1; 0x7B0]).push(true));
    assert_eq!(words(&[7; 123]).encode().len(), 252);
    let invalid = [
        read(Table::Coils, 0, 2001),
        read(Table::InputRegisters, 0, 126),
        read(Table::InputRegisters, 0, 0),
        read(Table::InputRegisters, 65_535, 2),
        coils(0),
        words(&[]),
    ];
    for request in invalid {
        assert_eq!(master.request(1, request.clone()), Err(Refused::Invalid), "{request:?}");
    }
    for request in [read(Table::Coils, 0, 2000), read(Table::InputRegisters, 65_535, 1)] {
        assert_eq!(Request::decode(&request.encode()), Ok(request));
    }
}

#[test]
fn times_and_frames_are_those_of_the_serial_line() {
    // 2.5.1.1: 3.5 characters of 11 bits; above 19 200 Bd fixed times.
    let slow = Line::Rtu { baud: 9600 };
    assert_eq!((slow.t3_5().as_micros(), slow.t1_5().as_micros()), (4010, 1718));
    let fast = Line::Rtu { baud: 115_200 };
    assert_eq!((fast.t3_5().as_micros(), fast.t1_5().as_micros()), (1750, 750));
    let frame = RTU.frame(9, 2, &[7]);
    assert_eq!(frame[..], [0x02, 0x07, 0x41, 0x12], "appendix B: low byte first");
    // Messaging on TCP/IP, appendix A: transaction 0x1501, unit 255, register 5.
    let frame = Line::Tcp.frame(0x1501, 0xFF, &[3, 0, 4, 0, 1]);
    assert_eq!(frame[..], [0x15, 0x01, 0, 0, 0, 6, 0xFF, 3, 0, 4, 0, 1]);
}

#[test]
fn a_configuration_out_of_range_is_refused() {
    let usual = Config::new(RTU);
    let of = |config: Config| Master::new(config).err();
    assert_eq!(of(usual), None);
    assert_eq!(of(Config::new(Line::Rtu { baud: 0 })), Some(ConfigError::Baud));
    assert_eq!(of(Config { time_limit: Duration::ZERO, ..usual }), Some(ConfigError::Time));
    assert_eq!(of(Config { quarantine: Duration::from_secs(11), ..usual }), Some(ConfigError::Time));
    assert_eq!(of(Config { retries: 11, ..usual }), Some(ConfigError::Retries));
}

/// A master and a device on one line; a step is 1 ms.
struct Bench {
    master: Master,
    device: Device,
    now: Instant,
    sent: Vec<(Instant, Bytes)>,
}

impl Bench {
    fn new(line: Line) -> Self {
        let mut device = Device::new(line, UNIT);
        for (address, word) in [(0, 100), (1, 200), (2, 0xFFFF), (3, 4)] {
            for table in Table::ALL {
                assert!(device.set(table, address, if table.is_bits() { word & 1 } else { word }));
            }
        }
        let master = Master::new(Config::new(line)).unwrap();
        Self { master, device, now: Instant::from_millis(1000), sent: Vec::new() }
    }

    fn step(&mut self) {
        self.now += Duration::from_millis(1);
        self.master.handle_timeout(self.now);
        while let Some(frame) = self.master.poll_tx(self.now) {
            self.device.handle_rx(self.now, &frame);
            self.sent.push((self.now, frame));
        }
        assert!(self.master.poll_timeout().is_none_or(|due| due > self.now), "due after it was served");
        while let Some(frame) = self.device.poll_tx(self.now) {
            self.master.handle_rx(self.now, &frame);
        }
    }

    fn pass(&mut self, ms: u64) {
        (0..ms).for_each(|_| self.step());
    }

    fn ask(&mut self, request: Request) -> Event {
        self.master.request(UNIT, request).unwrap();
        for _ in 0..3000 {
            self.step();
            if let Some(event) = self.master.poll_event() {
                return event;
            }
        }
        panic!("no end of the request");
    }

    fn read(&mut self, address: u16) -> Result<u16, Failure> {
        self.ask(read(Table::HoldingRegisters, address, 1)).result.map(|data| data.word(0).unwrap())
    }
}

#[test]
fn all_functions_work_on_both_lines() {
    for line in [RTU, Line::Tcp] {
        let mut bench = Bench::new(line);
        let got = |event: Event| event.result.unwrap();
        let data: Data = got(bench.ask(read(Table::InputRegisters, 0, 4)));
        assert_eq!([0, 1, 2, 3].map(|n| data.word(n).unwrap()), [100, 200, 0xFFFF, 4]);
        let data = got(bench.ask(read(Table::DiscreteInputs, 0, 4)));
        assert_eq!([0, 1, 2, 3].map(|n| data.bit(n).unwrap()), [false, false, true, false]);
        got(bench.ask(Request::WriteCoil { address: 3, on: true }));
        got(bench.ask(Request::WriteCoils { address: 0, bits: bits(&[1, 0, 0]) }));
        let data = got(bench.ask(read(Table::Coils, 0, 4)));
        assert_eq!([0, 1, 2, 3].map(|n| data.bit(n).unwrap()), [true, false, false, true]);
        got(bench.ask(Request::WriteRegister { address: 0, word: 9 }));
        got(bench.ask(words(&[10, 11])));
        assert_eq!([0, 1, 2, 3].map(|n| bench.read(n).unwrap()), [9, 10, 11, 4]);
        assert_eq!(bench.read(4), Err(Failure::Exception(Exception::ILLEGAL_ADDRESS)), "there is none");
        let counters = *bench.master.counters();
        assert_eq!((counters.sent, counters.answers, counters.exceptions), (12, 11, 1));
        assert_eq!((counters.rejected(), counters.silent), (0, 0));
    }
}

#[test]
fn a_silent_device_is_asked_again_and_then_given_up() {
    for (line, pause) in [(RTU, 100), (Line::Tcp, 0)] {
        let mut bench = Bench::new(line);
        bench.device.faults.mute = true;
        let before = bench.now;
        assert_eq!(bench.read(0), Err(Failure::Silent));
        assert_eq!((bench.sent.len(), bench.master.counters().silent), (3, 3));
        let took = bench.now.since(before).as_millis();
        assert!((300 + 2 * pause..340 + 2 * pause).contains(&took), "{line:?}: {took} ms");
        bench.device.faults.mute = false;
        assert_eq!(bench.read(0), Ok(100));
    }
}

#[test]
fn whatever_is_no_answer_is_counted_and_never_taken() {
    let faults = |change: fn(&mut Faults)| {
        let mut faults = Faults::default();
        change(&mut faults);
        faults
    };
    for line in [RTU, Line::Tcp] {
        let is_tcp = line == Line::Tcp;
        let cases = [
            (faults(|faults| faults.stranger = true), Failure::Damaged),
            (faults(|faults| faults.cut = true), Failure::Silent),
            (faults(|faults| faults.garbled = true), Failure::Damaged),
            (faults(|faults| faults.stale = true), Failure::Silent),
        ];
        for (fault, failure) in cases {
            // TCP has no checksum of its own, and RTU has no transactions.
            if fault.garbled && is_tcp || fault.stale && !is_tcp {
                continue;
            }
            let mut bench = Bench::new(line);
            bench.device.faults = fault;
            let failure = if is_tcp { Failure::Silent } else { failure };
            assert_eq!(bench.read(0), Err(failure), "{line:?} {fault:?}");
            let counters = bench.master.counters();
            assert!(counters.rejected() >= 3 && counters.answers == 0, "{line:?} {fault:?}: {counters:?}");
            bench.device.faults = Faults::default();
            bench.device.reset();
            assert_eq!(bench.read(0), Ok(100), "{line:?} after {fault:?}");
        }
    }
}

#[test]
fn a_late_answer_is_not_taken_for_that_of_the_next_request() {
    for line in [RTU, Line::Tcp] {
        let mut bench = Bench::new(line);
        bench.master = Master::new(Config { retries: 0, ..Config::new(line) }).unwrap();
        bench.device.delay = Duration::from_millis(150);
        assert_eq!(bench.read(0), Err(Failure::Silent));
        bench.device.delay = Duration::from_millis(2);
        assert_eq!(bench.read(1), Ok(200), "{line:?}: not 100, the answer to the request before");
        assert_eq!(bench.master.counters().late, 1);
    }
}

#[test]
fn a_babbling_line_is_waited_for_until_it_is_silent() {
    let mut bench = Bench::new(RTU);
    bench.master.request(UNIT, read(Table::Coils, 0, 1)).unwrap();
    for _ in 0..20 {
        bench.now += Duration::from_millis(1);
        bench.master.handle_rx(bench.now, &[0x55; 3]);
        assert_eq!(bench.master.poll_tx(bench.now), None);
    }
    let silent = bench.now;
    bench.pass(10);
    assert!(bench.sent[0].0.since(silent) >= RTU.t3_5());
    assert_eq!(bench.master.counters().late, 1, "one babble");
}

#[test]
fn a_frame_in_pieces_is_put_together_and_an_old_piece_is_not() {
    let answer = RTU.frame(0, UNIT, &[3, 2, 0, 7]);
    let mut bench = Bench::new(RTU);
    bench.device.faults.unplugged = true;
    bench.master.request(UNIT, read(Table::HoldingRegisters, 0, 1)).unwrap();
    bench.step();
    bench.master.handle_rx(bench.now, &answer[..3]);
    // The rest after a pause that no computer makes: what came before is noise.
    bench.pass(40);
    for piece in answer.chunks(2) {
        bench.pass(1);
        bench.master.handle_rx(bench.now, piece);
    }
    let event = bench.master.poll_event().unwrap();
    assert_eq!(event.result.unwrap().word(0), Some(7));
    assert_eq!(bench.master.counters().damaged, 1);
}

#[test]
fn a_stream_out_of_step_finds_its_way_back() {
    let mut bench = Bench::new(Line::Tcp);
    bench.device.faults.unplugged = true;
    bench.master.request(UNIT, read(Table::HoldingRegisters, 0, 1)).unwrap();
    bench.step();
    // Protocol 1, then what would be a header.
    bench.master.handle_rx(bench.now, &[0, 1, 0, 1, 0, 5, UNIT, 3, 2, 0, 7]);
    bench.device.faults.unplugged = false;
    bench.pass(200);
    assert_eq!(bench.master.poll_event().unwrap().result.unwrap().word(0), Some(100));
    assert_eq!(bench.master.counters().damaged, 1);
}

#[test]
fn a_busy_device_is_asked_again_after_a_pause() {
    let mut bench = Bench::new(Line::Tcp);
    bench.device.faults.exception = Some(Exception::BUSY);
    bench.master.request(UNIT, read(Table::Coils, 0, 1)).unwrap();
    bench.pass(50);
    bench.device.faults.exception = None;
    bench.pass(150);
    assert!(bench.master.poll_event().unwrap().result.is_ok());
    assert!(bench.sent[1].0.since(bench.sent[0].0) >= Duration::from_millis(100));
    bench.device.faults.exception = Some(Exception(0x77));
    assert_eq!(bench.read(0), Err(Failure::Exception(Exception(0x77))), "any other is final");
    assert_eq!(bench.sent.len(), 3);
}

#[test]
fn one_request_at_a_time_and_a_reset_ends_it() {
    let mut bench = Bench::new(RTU);
    bench.device.faults.unplugged = true;
    let request = || read(Table::Coils, 0, 1);
    assert_eq!(bench.master.request(0, request()), Err(Refused::Unit));
    assert_eq!(bench.master.request(248, request()), Err(Refused::Unit));
    bench.master.request(UNIT, request()).unwrap();
    assert_eq!(bench.master.request(UNIT, request()), Err(Refused::Busy));
    bench.step();
    bench.master.reset(bench.now);
    assert_eq!(bench.master.request(UNIT, request()), Err(Refused::Busy), "its event waits");
    assert_eq!(bench.master.poll_event().unwrap().result, Err(Failure::Reset));
    assert_eq!(bench.master.request(UNIT, request()), Ok(()));
}

#[test]
fn a_device_ignores_other_units_and_damaged_requests() {
    let mut device = Device::new(RTU, 2);
    device.set(Table::HoldingRegisters, 0, 1);
    let now = Instant::from_millis(1);
    let mut hear = |frame: &[u8]| {
        device.handle_rx(now, frame);
        device.poll_tx(now + Duration::from_secs(1)).map(|answer| answer.to_vec())
    };
    let request = [3, 0, 0, 0, 1];
    assert_eq!(hear(&RTU.frame(0, 3, &request)), None, "another unit");
    let mut damaged = RTU.frame(0, 2, &request);
    damaged[3] ^= 1;
    assert_eq!(hear(&damaged), None);
    assert_eq!(hear(&RTU.frame(0, 2, &[3, 0, 0, 0, 1])), Some(RTU.frame(0, 2, &[3, 2, 0, 1]).to_vec()));
    assert_eq!(hear(&RTU.frame(0, 0, &[6, 0, 0, 0, 9])), None, "to all: carried out without an answer");
    assert_eq!(hear(&RTU.frame(0, 2, &[0x2B, 14, 1, 0])), Some(RTU.frame(0, 2, &[0xAB, 1]).to_vec()));
    assert_eq!(device.get(Table::HoldingRegisters, 0), Some(9));
}

#[test]
fn random_bytes_are_never_an_answer_and_stop_nothing() {
    let mut random = Random::new(17);
    let mut below = |limit: u64| random.below(limit);
    for line in [RTU, Line::Tcp] {
        let mut bench = Bench::new(line);
        for _ in 0..400 {
            if bench.master.is_idle() {
                bench.device.faults.unplugged = true;
                bench.master.request(UNIT, read(Table::HoldingRegisters, 0, 1)).unwrap();
            }
            bench.pass(below(30));
            let mut noise: Vec<u8> = (0..below(300)).map(|_| below(256) as u8).collect();
            // Half of them begin as answers do.
            if below(2) == 0 {
                noise.splice(..0, [UNIT, 3, 2]);
            }
            bench.master.handle_rx(bench.now, &noise);
            bench.device.handle_rx(bench.now, &noise);
            if let Some(event) = bench.master.poll_event() {
                assert!(event.result.is_err(), "{event:?}");
            }
        }
        bench.pass(2000);
        let _ = bench.master.poll_event();
        bench.device.faults.unplugged = false;
        bench.device.reset();
        assert_eq!(bench.read(1), Ok(200), "{line:?}");
        assert_eq!(bench.master.counters().answers, 1);
    }
}

#[test]
fn values_are_made_of_registers_and_back() {
    let usual = Place {
        table: Table::HoldingRegisters,
        address: 0,
        kind: Kind::U16,
        bit: 0,
        low_first: false,
        scale: 1.0,
        offset: 0.0,
    };
    let float = 2.6_f32.to_bits();
    let (high, low) = ((float >> 16) as u16, float as u16);
    let cases = [
        (usual, [0xFFFE, 0], 65_534.0),
        (Place { kind: Kind::I16, scale: 0.1, ..usual }, [0xFFFE, 0], -0.2),
        (Place { kind: Kind::U32, ..usual }, [1, 2], 65_538.0),
        (Place { kind: Kind::U32, low_first: true, ..usual }, [2, 1], 65_538.0),
        (Place { kind: Kind::I32, ..usual }, [0xFFFF, 0xFFFF], -1.0),
        (Place { kind: Kind::F32, ..usual }, [high, low], f64::from(2.6_f32)),
        (Place { kind: Kind::F32, low_first: true, ..usual }, [low, high], f64::from(2.6_f32)),
        (Place { offset: -40.0, scale: 0.5, ..usual }, [200, 0], 60.0),
    ];
    for (place, words, value) in cases {
        assert_eq!(place.of_words(words), value, "{place:?}");
        let number = Number::Words(heapless::Vec::from_slice(&words[..usize::from(place.width())]).unwrap());
        assert_eq!(place.number(value), Some(number), "{place:?}");
    }
    let bit = Place { kind: Kind::Bit, bit: 3, ..usual };
    assert_eq!((bit.of_words([8, 0]), bit.of_words([0xFFF7, 0]), bit.number(1.0)), (1.0, 0.0, Some(Number::Bit(true))));
    let coil = Place { table: Table::Coils, kind: Kind::F32, ..usual };
    assert_eq!((coil.of_bit(true), coil.width(), coil.number(0.0)), (1.0, 1, Some(Number::Bit(false))));
    for (place, value) in [(coil, 0.5), (coil, 2.0), (usual, -1.0), (usual, 65_536.0), (usual, f64::NAN)] {
        assert_eq!(place.number(value), None, "{place:?} {value}");
    }
    let float = Place { kind: Kind::F32, ..usual };
    assert!(float.number(1e39).is_none() && float.number(f64::NAN).is_none());
    assert!(float.of_words([0x7FC0, 0]).is_nan() && float.of_words([0x7F80, 0]).is_nan(), "an infinity is no number");
    let last = Place { address: 65_535, ..usual };
    assert!(last.is_valid() && !Place { kind: Kind::I32, ..last }.is_valid());
    assert!(!Place { scale: 0.0, ..usual }.is_valid() && !Place { bit: 16, ..usual }.is_valid());
    assert_ne!(crc16(&[0]), crc16(&[1]));
}
