//! Master and device of Modbus on disturbed lines.

use arbitrary::Arbitrary;
use base::{Duration, Instant};
use modbus::device::Device;
use modbus::pdu::Bits;
use modbus::value::{Kind, Place};
use modbus::{Config, Exception, Line, Master, Request, Table};

const UNIT: u8 = 17;

#[derive(Arbitrary, Debug)]
enum Step<'a> {
    /// Bytes from nowhere.
    Receive { to_device: bool, bytes: &'a [u8] },
    /// Time passes; what is sent arrives, or does not.
    Pass { ms: u8, lost: bool },
    Read { table: u8, address: u16, count: u16 },
    Write { several: bool, coils: bool, address: u16, words: Vec<u16> },
    Reset,
    Fault { number: u8, on: bool },
}

fn table(number: u8) -> Table {
    Table::ALL[usize::from(number) % Table::ALL.len()]
}

fn written(several: bool, coils: bool, address: u16, words: &[u16]) -> Request {
    let first = words.first().copied().unwrap_or_default();
    match (several, coils) {
        (false, true) => Request::WriteCoil { address, on: first & 1 != 0 },
        (false, false) => Request::WriteRegister { address, word: first },
        (true, true) => {
            let mut bits = Bits::default();
            words.iter().for_each(|word| _ = bits.push(word & 1 != 0));
            Request::WriteCoils { address, bits }
        }
        (true, false) => Request::WriteRegisters { address, words: words.iter().copied().take(123).collect() },
    }
}

fn device(line: Line) -> Device {
    let mut device = Device::new(line, UNIT);
    for (table, address) in Table::ALL.into_iter().flat_map(|table| (0..20).map(move |address| (table, address))) {
        assert!(device.set(table, address, u16::from(table.is_bits()) & address));
    }
    device
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

/// The master and its device with arbitrary bytes, lost ones, requests and faults, at any time; values of arbitrary
/// registers.
///
/// A request has one end. After a call and its draining nothing is due. With a device at power-on the next request is
/// answered by its own values. A value that is written is read again.
pub fn modbus_engines(data: &[u8]) {
    let Some((tcp, steps)) = crate::input::<(bool, Vec<Step>)>(data) else { return };
    let line = if tcp { Line::Tcp } else { Line::Rtu { baud: 115_200 } };
    let mut master = Master::new(Config::new(line)).unwrap();
    let mut other = device(line);
    let mut now = Instant::from_millis(1000);
    let mut open = 0;
    for step in steps.iter().take(200) {
        match step {
            Step::Receive { to_device: true, bytes } => other.handle_rx(now, bytes),
            Step::Receive { to_device: false, bytes } => master.handle_rx(now, bytes),
            Step::Pass { ms, lost } => (0..*ms).for_each(|_| pass(&mut master, &mut other, &mut now, *lost)),
            Step::Read { table: number, address, count } => {
                let request = Request::Read { table: table(*number), address: *address, count: *count };
                open += u32::from(master.request(UNIT, request).is_ok());
            }
            Step::Write { several, coils, address, words } => {
                let request = written(*several, *coils, *address, words);
                values(*address, words);
                open += u32::from(master.request(UNIT, request).is_ok());
            }
            Step::Reset => master.reset(now),
            Step::Fault { number, on } => {
                let faults = &mut other.faults;
                faults.exception = (*on && number & 8 != 0).then_some(Exception(*number));
                let modbus::device::Faults { unplugged, mute, garbled, stranger, stale, cut, .. } = faults;
                *[unplugged, mute, garbled, stranger, stale, cut][usize::from(number % 6)] = *on;
            }
        }
        while master.poll_event().is_some() {
            open -= 1;
        }
        assert!(open <= 1, "a request without an end");
    }
    // Whatever came before: a device at power-on is read after the line has been silent.
    other = device(line);
    for _ in 0..2000 {
        pass(&mut master, &mut other, &mut now, true);
        let _ = master.poll_event();
    }
    assert!(master.is_idle());
    other.set(Table::HoldingRegisters, 3, 0xABCD);
    let request = Request::Read { table: Table::HoldingRegisters, address: 3, count: 1 };
    master.request(UNIT, request).unwrap();
    (0..2000).for_each(|_| pass(&mut master, &mut other, &mut now, false));
    let answer = master.poll_event().and_then(|event| event.result.ok()).expect("an answer");
    assert_eq!(answer.word(0), Some(0xABCD));
}

fn values(address: u16, words: &[u16]) {
    let word = |n: usize| words.get(n).copied().unwrap_or_default();
    for kind in Kind::ALL {
        let place = Place {
            table: Table::HoldingRegisters,
            address,
            kind,
            bit: word(2) as u8 % 16,
            low_first: word(2) & 16 != 0,
            scale: 1.0,
            offset: 0.0,
        };
        let value = place.of_words([word(0), word(1)]);
        assert_eq!(place.number(value).is_some(), !value.is_nan(), "{place:?} {value}");
    }
}
