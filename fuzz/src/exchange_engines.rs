//! Master and device of serial lines with simple request and answer, on disturbed lines.

use arbitrary::Arbitrary;
use base::{Duration, Instant};
use exchange::check::{Check, Method};
use exchange::device::{Device, Known, answer_data};
use exchange::value::{Kind, Place};
use exchange::{Answer, Bytes, Config, Master, Octets, Protocol};

#[derive(Arbitrary, Debug)]
enum Step<'a> {
    /// Bytes from nowhere.
    Receive {
        to_device: bool,
        bytes: &'a [u8],
    },
    /// Time passes; what is sent arrives, or does not.
    Pass {
        ms: u8,
        lost: bool,
    },
    Ask,
    Reset,
}

#[derive(Arbitrary, Debug)]
struct Table {
    method: u8,
    text: bool,
    from: u8,
    polynomial: u8,
    kind: u8,
    at: u8,
    length: u8,
    low_first: bool,
}

fn octets(text: &str) -> Octets {
    Octets::parse(text).unwrap()
}

fn place(table: &Table) -> Place {
    let kind = Kind::ALL[usize::from(table.kind) % Kind::ALL.len()];
    Place {
        at: usize::from(table.at),
        after: Default::default(),
        kind,
        low_first: table.low_first,
        bit: table.kind % 8,
        length: kind.is_text().then_some(usize::from(table.length % 16) + 1),
        decimals: 0,
        signed: false,
        scale: 1.0,
        offset: 0.0,
        unknown: None,
    }
}

fn pass(master: &mut Master, device: &mut Device, now: &mut Instant, lost: bool) {
    *now += Duration::from_millis(1);
    master.handle_timeout(*now);
    while let Some(frame) = master.poll_tx(*now) {
        if !lost {
            device.handle_rx(*now, &frame);
        }
    }
    assert!(master.poll_timeout().is_none_or(|due| due > *now), "due after it was served");
    while let Some(frame) = device.poll_tx(*now) {
        if !lost {
            master.handle_rx(*now, &frame);
        }
    }
}

/// The master and its device by an arbitrary table, with arbitrary bytes and lost ones, at any time; bytes as people
/// write them.
///
/// A request has one end. After a call and its draining nothing is due. After silence the next request is answered by
/// its own value. A value that is written is read again.
pub fn exchange_engines(data: &[u8]) {
    if let Some(octets) = core::str::from_utf8(data).ok().and_then(Octets::parse) {
        assert_eq!(Octets::parse(&octets.to_string()), Some(octets));
    }
    let Some((table, steps)) = crate::input::<(Table, Vec<Step>)>(data) else { return };
    let method = Method::ALL[usize::from(table.method) % Method::ALL.len()];
    let (from, polynomial, text) = (usize::from(table.from % 4), table.polynomial, table.text);
    let check = Check { method, polynomial, from, text };
    let protocol = Protocol { check, request_end: octets("0D"), answer_end: octets("0A") };
    let place = place(&table);
    let length = (!place.kind.is_text() || check.is_binary()).then_some(100);
    let answer = Answer::Data { length, prefix: octets("'>A'"), suffix: Octets::default() };
    let place = Place { at: 2 + place.at % 40, ..place };
    let frame = protocol.request(b">A?").unwrap();
    let expected = protocol.expect(&answer, &frame).unwrap();
    let mut device = Device::new(protocol.clone());
    let data = answer_data(&protocol, &answer, &[(place.clone(), 1.0)]);
    let request = octets("'>A?'");
    assert!(device.add(Known { request, outputs: Default::default(), answer, data }));
    let mut master = Master::new(Config::new(Some(9600)));
    let mut now = Instant::from_millis(1000);
    let mut open = 0;
    for step in steps.iter().take(200) {
        match step {
            Step::Receive { to_device: true, bytes } => {
                device.handle_rx(now, bytes);
                values(&place, bytes);
            }
            Step::Receive { to_device: false, bytes } => master.handle_rx(now, bytes),
            Step::Pass { ms, lost } => (0..*ms).for_each(|_| pass(&mut master, &mut device, &mut now, *lost)),
            Step::Ask => open += i32::from(master.request(now, frame.clone(), expected.clone())),
            Step::Reset => master.reset(now),
        }
        while master.poll_event().is_some() {
            open -= 1;
        }
        assert!((0..=1).contains(&open), "a request without an end, or with two");
    }
    // Whatever came before: after silence the device is read.
    for _ in 0..4000 {
        pass(&mut master, &mut device, &mut now, true);
        let _ = master.poll_event();
    }
    assert!(master.is_idle() && master.request(now, frame, expected));
    (0..2000).for_each(|_| pass(&mut master, &mut device, &mut now, false));
    let answer = master.poll_event().and_then(|event| event.result.ok()).expect("an answer");
    assert_eq!(place.value(&answer), Some(1.0), "{place:?}");
}

/// What is written is read again.
fn values(place: &Place, bytes: &[u8]) {
    let Some(value) = place.value(bytes) else { return };
    let mut data: Bytes = bytes.iter().copied().take(exchange::LEN_MAX).collect();
    if place.write(value, &mut data) {
        let read = place.value(&data).expect("it was written");
        assert!(read == value || place.kind == Kind::Decimal, "{place:?} {value} {read}");
    }
}
