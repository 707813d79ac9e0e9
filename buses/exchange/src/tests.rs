//! Transcripts typed from the manuals of three boards, their checks by another program. Both ends are judged by them.
//!
//! `TEMP`  binary, CRC-16/MODBUS: `01 03` is answered by two temperatures in 0.1 degC and a byte of switches;
//!         `01 06 HH LL` sets a fan per mille, and is repeated as its answer
//! `ASCII` `>A1?` is answered by a temperature, `>B1=N` by `OK`; each ends with CR
//! `NMEA`  sentences: `$TMP,?` is answered by `$TMP,T1,T2`

use crate::check::{Check, Method};
use crate::device::{Device, Known, answer_data};
use crate::value::{Kind, Place};
use crate::{Answer, Bytes, Config, Counters, Failure, Master, Octets, Protocol};
use base::{Duration, Instant};
use heapless::Vec;
use std::string::ToString;

fn octets(text: &str) -> Octets {
    Octets::parse(text).unwrap()
}

fn ms(ms: u64) -> Instant {
    Instant::from_millis(1000 + ms)
}

fn place(kind: Kind, at: usize) -> Place {
    Place {
        at,
        after: Vec::new(),
        kind,
        low_first: false,
        bit: 0,
        length: None,
        decimals: 0,
        signed: false,
        scale: 1.0,
        offset: 0.0,
        unknown: None,
    }
}

fn protocol(method: Method, end: &str) -> Protocol {
    let from = usize::from(method == Method::Nmea);
    let check = Check { method, from, ..Check::NONE };
    Protocol { check, request_end: octets(end), answer_end: octets(end) }
}

fn data(length: Option<usize>, prefix: &str) -> Answer {
    Answer::Data { length, prefix: octets(prefix), suffix: Octets::default() }
}

/// What the master sends, and what it makes of the bytes that come 10 ms later.
struct Asked {
    sent: Bytes,
    result: Option<Result<Bytes, Failure>>,
    counters: Counters,
}

fn ask(protocol: &Protocol, request: &[u8], answer: &Answer, received: &[&[u8]]) -> Asked {
    let mut master = Master::new(Config { retries: 0, ..Config::new(Some(9600)) });
    let frame = protocol.request(request).unwrap();
    let expected = protocol.expect(answer, &frame).unwrap();
    assert!(master.request(ms(0), frame, expected));
    let sent = master.poll_tx(ms(0)).unwrap();
    received.iter().for_each(|bytes| master.handle_rx(ms(10), bytes));
    master.handle_timeout(ms(2000));
    master.handle_timeout(ms(4000));
    Asked { sent, result: master.poll_event().map(|event| event.result), counters: *master.counters() }
}

const TEMP: &[u8] = &[0x01, 0x03, 0x00, 0xF3, 0xFF, 0xC4, 0x05, 0x9A, 0x44];

fn temp() -> (Protocol, Answer) {
    (protocol(Method::Crc16Modbus, ""), data(Some(9), "01 03"))
}

#[test]
fn a_binary_board_is_read() {
    let (protocol, answer) = temp();
    let asked = ask(&protocol, &[0x01, 0x03], &answer, &[TEMP]);
    assert_eq!(&asked.sent[..], [0x01, 0x03, 0x40, 0x21]);
    let data = asked.result.unwrap().unwrap();
    let celsius = |at| Place { scale: 0.1, ..place(Kind::I16, at) }.value(&data).unwrap();
    assert!((celsius(2) - 24.3).abs() < 1e-9 && (celsius(4) + 6.0).abs() < 1e-9);
    let bit = |bit| Place { bit, ..place(Kind::Bit, 6) }.value(&data);
    assert_eq!([0, 1, 2].map(bit), [Some(1.0), Some(0.0), Some(1.0)]);
    assert_eq!(place(Kind::U8, 7).value(&data), None, "the check is no data");
}

#[test]
fn an_ascii_board_is_read_in_pieces() {
    let protocol = protocol(Method::None, "0D");
    let asked = ask(&protocol, b">A1?", &data(None, ""), &[b"+02", b"3", b".4\r"]);
    assert_eq!(&asked.sent[..], b">A1?\r");
    let data = asked.result.unwrap().unwrap();
    assert_eq!(place(Kind::Decimal, 0).value(&data), Some(23.4));
}

#[test]
fn a_sentence_is_read_by_its_check() {
    let protocol = protocol(Method::Nmea, "0D 0A");
    let whole = data(None, "'$TMP,'");
    let asked = ask(&protocol, b"$TMP,?", &whole, &[b"$TMP,023.5,-04.0*54\r\n"]);
    assert_eq!(&asked.sent[..], b"$TMP,?*5A\r\n");
    let values = asked.result.unwrap().unwrap();
    assert_eq!(place(Kind::Decimal, 5).value(&values), Some(23.5));
    assert_eq!(Place { length: Some(5), ..place(Kind::Decimal, 11) }.value(&values), Some(-4.0));
    for damaged in [&b"$TMP,023.5,-04.0*55\r\n"[..], b"$TMP,023.5,-04.1*54\r\n", b"$TMP,023.5,-04.0\r\n", b"$TMP\r\n"] {
        assert_eq!(ask(&protocol, b"$TMP,?", &whole, &[damaged]).result, Some(Err(Failure::Damaged)));
    }
}

#[test]
fn what_is_no_answer_is_counted_and_not_taken() {
    let (protocol, answer) = temp();
    let wrong_crc = [&TEMP[..8], &[0x45]].concat();
    let long = [TEMP, &[0x00]].concat();
    let other = [0x02, 0x03, 0x00, 0xF3, 0xFF, 0xC4, 0x05, 0x9A, 0x44];
    for damaged in [&wrong_crc[..], &long, &other, &TEMP[..8], &[0; 300], &[0x01]] {
        let asked = ask(&protocol, &[0x01, 0x03], &answer, &[damaged]);
        assert_eq!((asked.result, asked.counters.damaged), (Some(Err(Failure::Damaged)), 1), "{damaged:?}");
        assert_eq!(asked.counters.answers, 0);
    }
    let asked = ask(&protocol, &[0x01, 0x03], &answer, &[]);
    assert_eq!((asked.result, asked.counters.silent), (Some(Err(Failure::Silent)), 1));
    // Ended by a delimiter: it does not come, or twice.
    let ascii = Protocol { check: Check::NONE, ..self::protocol(Method::None, "0D") };
    for damaged in [&[b'1'; 300][..], b"+023.4", b"+023.4\r+023.4\r", b"+023.4\r\n"] {
        let asked = ask(&ascii, b">A1?", &data(None, ""), &[damaged]);
        assert_eq!(asked.result, Some(Err(Failure::Damaged)), "{damaged:?}");
    }
}

#[test]
fn noise_before_an_answer_with_a_known_beginning_is_left_out() {
    let (protocol, answer) = temp();
    let noisy = [&[0x00, 0xFF, 0x01][..], TEMP].concat();
    let asked = ask(&protocol, &[0x01, 0x03], &answer, &[&noisy[..2], &noisy[2..]]);
    assert_eq!(&asked.result.unwrap().unwrap()[..], &TEMP[..7]);
    assert_eq!((asked.counters.noisy, asked.counters.damaged), (1, 0));
    let much = [&[0xFF; 9][..], TEMP].concat();
    assert_eq!(ask(&protocol, &[0x01, 0x03], &answer, &[&much]).result, Some(Err(Failure::Damaged)));
}

#[test]
fn an_output_is_confirmed_by_the_answer_that_is_expected_only() {
    let (protocol, _) = temp();
    let mut request = Bytes::from_slice(&[0x01, 0x06, 0x00, 0x00]).unwrap();
    assert!(Place { scale: 0.1, ..place(Kind::U16, 2) }.write(100.0, &mut request));
    let frame = [0x01, 0x06, 0x03, 0xE8, 0xE1, 0x67];
    let asked = ask(&protocol, &request, &Answer::Echo, &[&frame]);
    assert_eq!((&asked.sent[..], asked.result.is_some_and(|result| result.is_ok())), (&frame[..], true));
    let other = [0x01, 0x06, 0x03, 0xE7, 0xE1, 0x67];
    assert_eq!(ask(&protocol, &request, &Answer::Echo, &[&other]).result, Some(Err(Failure::Damaged)));

    let ascii = self::protocol(Method::None, "0D");
    let mut request = Bytes::from_slice(b">B1=").unwrap();
    assert!(Place { decimals: 1, ..place(Kind::Decimal, 4) }.write(-7.25, &mut request));
    assert_eq!(&request[..], b">B1=-7.2", "the nearest, ties to even");
    let ok = Answer::Exact(octets("'OK'"));
    let asked = ask(&ascii, &request, &ok, &[b"OK\r"]);
    assert_eq!((&asked.sent[..], &asked.result.unwrap().unwrap()[..]), (&b">B1=-7.2\r"[..], &b"OK"[..]));
    assert_eq!(ask(&ascii, &request, &ok, &[b"NO\r"]).result, Some(Err(Failure::Damaged)));
}

#[test]
fn a_late_answer_is_not_taken_for_the_next_request() {
    let protocol = protocol(Method::None, "0D");
    let config = Config { retries: 1, ..Config::new(Some(9600)) };
    let mut master = Master::new(config);
    let frame = protocol.request(b">A1?").unwrap();
    let expected = protocol.expect(&data(None, ""), &frame).unwrap();
    assert!(master.request(ms(0), frame.clone(), expected.clone()));
    assert!(!master.request(ms(0), frame, expected), "one at a time");
    assert!(master.poll_tx(ms(0)).is_some());
    // Five characters of 11 bits at 9600 Bd, and 100 ms.
    let due = master.poll_timeout().unwrap();
    assert!(due > ms(105) && due < ms(106), "{due:?}");
    master.handle_timeout(due);
    assert!(master.poll_tx(due + Duration::from_millis(99)).is_none(), "the line rests");
    master.handle_rx(due + Duration::from_millis(99), b"+011.1\r");
    assert!(master.poll_event().is_none());
    assert!(master.poll_tx(due + Duration::from_millis(103)).is_none(), "not silent for long enough");
    assert!(master.poll_tx(due + Duration::from_millis(104)).is_some());
    master.handle_rx(due + Duration::from_millis(120), b"+022.2\r");
    assert_eq!(&master.poll_event().unwrap().result.unwrap()[..], b"+022.2");
    let Counters { sent, answers, silent, late, .. } = *master.counters();
    assert_eq!((sent, answers, silent, late), (2, 1, 1, 1));
}

#[test]
fn a_line_on_which_something_is_received_all_the_time_is_an_error_and_not_a_wait() {
    let protocol = protocol(Method::None, "0D");
    let mut master = Master::new(Config::new(Some(9600)));
    master.handle_rx(ms(0), &[0xFF]);
    let frame = protocol.request(b">A1?").unwrap();
    let expected = protocol.expect(&data(None, ""), &frame).unwrap();
    assert!(master.request(ms(1), frame, expected));
    for n in 1..=1100 {
        master.handle_rx(ms(n), &[0xFF]);
        assert!(master.poll_tx(ms(n)).is_none());
    }
    assert_eq!(master.poll_event().map(|event| event.result), Some(Err(Failure::Babble)));
}

#[test]
fn values_of_all_types() {
    let bytes = [0x80, 0x01, 0x02, 0xFE];
    let value = |kind, low_first| Place { low_first, ..place(kind, 0) }.value(&bytes);
    for (kind, high, low) in [
        (Kind::U8, 128.0, 128.0),
        (Kind::I8, -128.0, -128.0),
        (Kind::U16, 32_769.0, 384.0),
        (Kind::I16, -32_767.0, 384.0),
        (Kind::U32, 2_147_549_950.0, 4_261_544_320.0),
        (Kind::I32, -2_147_417_346.0, -33_422_976.0),
    ] {
        assert_eq!((value(kind, false), value(kind, true)), (Some(high), Some(low)), "{kind}");
    }
    assert_eq!(place(Kind::F32, 0).value(&[0x41, 0xC4, 0x00, 0x00]), Some(24.5));
    assert_eq!(place(Kind::F32, 0).value(&[0x7F, 0xC0, 0x00, 0x00]), None, "not a number");
    assert_eq!(place(Kind::U16, 3).value(&bytes), None, "beyond the end");
    assert_eq!(place(Kind::U8, usize::MAX).value(&bytes), None);
    let no_sensor = Place { unknown: Some(-32_768.0), ..place(Kind::I16, 0) };
    assert_eq!((no_sensor.value(&[0x80, 0]), no_sensor.value(&[0x80, 1])), (None, Some(-32_767.0)));
    // In all types what is written is read.
    for kind in Kind::ALL {
        for low_first in [false, true] {
            let place = Place { low_first, bit: 5, length: kind.is_text().then_some(4), ..place(kind, 1) };
            let mut data = Bytes::from_slice(&[0xFF; 6]).unwrap();
            assert!(place.write(1.0, &mut data), "{kind}");
            assert_eq!(place.value(&data), Some(1.0), "{kind}");
            assert!(!place.write(1e16, &mut data) || kind == Kind::F32);
            assert!(!place.write(f64::NAN, &mut data) && !Place { at: 6, ..place.clone() }.write(1.0, &mut data));
        }
    }
}

#[test]
fn numbers_in_text_are_read_and_what_is_none_is_unknown() {
    let decimal = |length, text: &[u8]| Place { length, ..place(Kind::Decimal, 0) }.value(text);
    assert_eq!(decimal(None, b" -12.50 degC"), Some(-12.5));
    assert_eq!(decimal(Some(6), b" 1.5  9"), Some(1.5));
    for text in [&b"----"[..], b"", b"+", b".", b"nan", b"inf", b"12345678901234567", b"OVL", b"-\xFF"] {
        assert_eq!(decimal(None, text), None, "{text:?}");
    }
    for text in [&b"12"[..], b"1x3", b"1e3", b"   "] {
        assert_eq!(decimal(Some(3), text), None, "{text:?}");
    }
    let hex = |length, text: &[u8]| Place { length, ..place(Kind::Hex, 0) }.value(text);
    assert_eq!((hex(Some(4), b"00fFA"), hex(None, b"1F;")), (Some(255.0), Some(31.0)));
    assert_eq!((hex(Some(4), b"+0FF"), hex(None, b"123456789")), (None, None));
    let after = |text: &[u8]| Place { after: Vec::from_slice(b"T=").unwrap(), ..place(Kind::Decimal, 0) }.value(text);
    assert_eq!((after(b"H=40;T=21.5;"), after(b"H=40"), after(b"T=")), (Some(21.5), None, None));
}

#[test]
fn text_is_written_with_the_width_that_the_device_takes() {
    let text = |place: &Place, value| place.text(value).map(|text| text.to_string());
    let fixed = Place { length: Some(5), decimals: 1, signed: true, ..place(Kind::Decimal, 0) };
    assert_eq!(text(&fixed, 7.0).as_deref(), Some("+07.0"));
    assert_eq!(text(&fixed, -7.0).as_deref(), Some("-07.0"));
    assert_eq!(text(&fixed, -0.01).as_deref(), Some("+00.0"), "no minus zero");
    assert_eq!(text(&fixed, 100.0), None, "no room");
    assert_eq!(text(&Place { length: Some(2), ..place(Kind::Hex, 0) }, 10.0).as_deref(), Some("0A"));
    assert_eq!(text(&place(Kind::Decimal, 0), -0.4).as_deref(), Some("0"));
}

#[test]
fn checks_meet_the_values_of_the_catalogue() {
    let all: [(Method, &[u8]); 8] = [
        (Method::Sum8, &[0xDD]),
        (Method::Sum8Negative, &[0x23]),
        (Method::Xor8, &[0x31]),
        (Method::Crc8, &[0xF4]),
        (Method::Crc16Modbus, &[0x37, 0x4B]),
        (Method::Crc16Ccitt, &[0x29, 0xB1]),
        (Method::Crc16Xmodem, &[0x31, 0xC3]),
        (Method::Nmea, b"*31"),
    ];
    for (method, sent) in all {
        let check = Check { method, ..Check::NONE };
        assert_eq!(&protocol_of(check).answer(b"123456789").unwrap()[9..], sent, "{method}");
        assert_eq!((check.len(), check.holds(b"123456789", sent)), (sent.len(), true), "{method}");
        assert!(!check.holds(b"123456788", sent) && !check.holds(b"123456789", &[]), "{method}");
    }
    let crc8 = Check { method: Method::Crc8, polynomial: 0x31, ..Check::NONE };
    assert!(crc8.holds(b"123456789", &[0xA2]));
    let text = Check { method: Method::Crc16Modbus, text: true, from: 1, ..Check::NONE };
    assert!(text.holds(b":123456789", b"4B37") && text.holds(b":123456789", b"4b37"));
    assert!(!text.holds(b":123456789", b"374B") && !text.holds(b":123456789", b"4B3"));
    assert_eq!(&protocol_of(text).answer(b":123456789").unwrap()[10..], b"4B37");
}

fn protocol_of(check: Check) -> Protocol {
    Protocol { check, request_end: Octets::default(), answer_end: Octets::default() }
}

#[test]
fn bytes_are_written_in_hexadecimal_and_as_text() {
    let bytes = |text| Octets::parse(text).map(|octets| octets.as_slice().to_vec());
    assert_eq!(bytes("01 03"), Some(std::vec![1, 3]));
    assert_eq!(bytes("02'A 1'0d0A"), Some(b"\x02A 1\r\n".to_vec()));
    assert_eq!(bytes(""), Some(std::vec![]));
    for wrong in ["1", "0x01", "01,03", "'A", "'ü'", "G0", "0 1"] {
        assert_eq!(bytes(wrong), None, "{wrong}");
    }
    assert_eq!(bytes(&"00".repeat(65)), None);
    assert_eq!(octets("'>A1?' 0D").to_string(), "3E 41 31 3F 0D");
}

/// What the emulated board answers.
fn answers(board: &mut Device, request: &[u8]) -> Option<Bytes> {
    board.handle_rx(ms(0), request);
    let due = board.poll_timeout()?;
    board.poll_tx(due)
}

#[test]
fn the_emulated_boards_answer_as_the_transcripts() {
    let (protocol, answer) = temp();
    let celsius = |at| Place { scale: 0.1, ..place(Kind::I16, at) };
    let bit = |bit| Place { bit, ..place(Kind::Bit, 6) };
    let values = [(celsius(2), 24.3), (celsius(4), -6.0), (bit(0), 1.0), (bit(1), 0.0), (bit(2), 1.0)];
    let mut board = Device::new(protocol.clone());
    let data_of = answer_data(&protocol, &answer, &values);
    let read = Known { request: octets("01 03"), outputs: Vec::new(), answer, data: data_of };
    let outputs = Vec::from_slice(&[place(Kind::U16, 2)]).unwrap();
    let write = Known { request: octets("01 06 00 00"), outputs, answer: Answer::Echo, data: Bytes::new() };
    assert!(board.add(read) && board.add(write));
    assert_eq!(answers(&mut board, &[0xFF, 0x01, 0x03, 0x40, 0x21]).as_deref(), Some(TEMP));
    let set = [0x01, 0x06, 0x03, 0xE8, 0xE1, 0x67];
    assert_eq!(answers(&mut board, &set).as_deref(), Some(&set[..]));
    assert_eq!(answers(&mut board, &[0x01, 0x03, 0x40, 0x22]), None, "a damaged request");

    let ascii = self::protocol(Method::None, "0D");
    let mut board = Device::new(ascii.clone());
    let fixed = Place { length: Some(6), decimals: 1, signed: true, ..place(Kind::Decimal, 0) };
    let data_of = answer_data(&ascii, &data(None, ""), &[(fixed, 23.4)]);
    let read = Known { request: octets("'>A1?'"), outputs: Vec::new(), answer: data(None, ""), data: data_of };
    let outputs = Vec::from_slice(&[place(Kind::Decimal, 4)]).unwrap();
    let answer = Answer::Exact(octets("'OK'"));
    let write = Known { request: octets("'>B1=;'"), outputs, answer, data: Bytes::new() };
    assert!(board.add(read) && board.add(write));
    assert_eq!(answers(&mut board, b">A1?\r").as_deref(), Some(&b"+023.4\r"[..]));
    assert_eq!(answers(&mut board, b">B1=-17;\r").as_deref(), Some(&b"OK\r"[..]));
    assert_eq!(answers(&mut board, b">B1=x;\r"), None);
    assert_eq!(answers(&mut board, b">A1?\r").as_deref(), Some(&b"+023.4\r"[..]));

    let nmea = self::protocol(Method::Nmea, "0D 0A");
    let number = |at| Place { length: Some(5), decimals: 1, ..place(Kind::Decimal, at) };
    let after = Place { after: Vec::from_slice(b",").unwrap(), ..number(0) };
    let answer = data(None, "'$TMP,'");
    let values = answer_data(&nmea, &answer, &[(after, 23.5), (Place { at: 11, ..number(0) }, -4.0)]);
    assert_eq!(&values[..], b"$TMP,023.5 -04.0");
}
