//! Encoding of I2C transfers, 1-Wire requests and temperatures of the computer.

use super::Malformed;
use super::wire::{self, Decoder};
use base::i2c::{Outcome, Transfer, codec};
use base::thermal::{State, Throttle};
use base::w1::{self, Answer, Request, Rom};

// Requests and answers of a 1-Wire bus; then the possible errors of a temperature.
const LIST: u8 = 0;
const TEMPERATURE: u8 = 1;
const ABSENT: u8 = 2;
const CRC: u8 = 3;
const NONSENSE: u8 = 4;
const UNREADABLE: u8 = 5;
// Requests of switches; the answer, whose errors follow it by the numbers above.
const READ: u8 = 6;
const WRITE: u8 = 7;
const SWITCH: u8 = 8;
const SWITCH_FAILED: u8 = 9;

pub(super) fn transfer(out: &mut Vec<u8>, transfer: &Transfer) {
    wire::bytes(out, &codec::transfer(transfer));
}

pub(super) fn take_transfer(take: &mut Decoder<'_>) -> Result<Transfer, Malformed> {
    codec::parse_transfer(take.bytes()?).ok_or(Malformed("a transfer on an I2C bus"))
}

pub(super) fn outcome(out: &mut Vec<u8>, outcome: &Outcome) {
    wire::bytes(out, &codec::outcome(outcome));
}

pub(super) fn take_outcome(take: &mut Decoder<'_>) -> Result<Outcome, Malformed> {
    codec::parse_outcome(take.bytes()?).ok_or(Malformed("what can come of a transfer"))
}

pub(super) fn request(out: &mut Vec<u8>, request: Request) {
    match request {
        Request::List => out.push(LIST),
        Request::Temperature(of) => {
            out.push(TEMPERATURE);
            rom(out, of);
        }
        Request::Read(of) => {
            out.push(READ);
            rom(out, of);
        }
        Request::Write(of, latches) => {
            out.extend([WRITE, latches]);
            rom(out, of);
        }
    }
}

pub(super) fn take_request(take: &mut Decoder<'_>) -> Result<Request, Malformed> {
    match take.u8()? {
        LIST => Ok(Request::List),
        TEMPERATURE => take_rom(take).map(Request::Temperature),
        READ => take_rom(take).map(Request::Read),
        WRITE => {
            let latches = take.u8()?;
            Ok(Request::Write(take_rom(take)?, latches))
        }
        _ => Err(Malformed("a request of a 1-Wire bus")),
    }
}

pub(super) fn answer(out: &mut Vec<u8>, answer: &Answer) {
    match answer {
        Answer::List(list) => {
            out.push(LIST);
            wire::varint(out, list.len() as u64);
            list.iter().for_each(|of| rom(out, *of));
        }
        Answer::Temperature(of, Ok(millidegrees)) => {
            out.push(TEMPERATURE);
            rom(out, *of);
            wire::signed(out, (*millidegrees).into());
        }
        Answer::Temperature(of, Err(error)) => {
            out.push(code(*error));
            rom(out, *of);
        }
        Answer::Switch(of, Ok(state)) => {
            out.extend([SWITCH, *state]);
            rom(out, *of);
        }
        Answer::Switch(of, Err(error)) => {
            out.extend([SWITCH_FAILED, code(*error)]);
            rom(out, *of);
        }
    }
}

fn code(error: w1::Error) -> u8 {
    match error {
        w1::Error::Absent => ABSENT,
        w1::Error::Crc => CRC,
        w1::Error::Nonsense => NONSENSE,
        w1::Error::Other => UNREADABLE,
    }
}

fn error(code: u8) -> Option<w1::Error> {
    [w1::Error::Absent, w1::Error::Crc, w1::Error::Nonsense, w1::Error::Other]
        .into_iter()
        .find(|one| self::code(*one) == code)
}

pub(super) fn take_answer(take: &mut Decoder<'_>) -> Result<Answer, Malformed> {
    let error = match take.u8()? {
        LIST => {
            let mut list = w1::List::new();
            for _ in 0..take.count()? {
                list.push(take_rom(take)?).map_err(|_| Malformed("as many thermometers as are listed"))?;
            }
            return Ok(Answer::List(list));
        }
        TEMPERATURE => {
            let (rom, value) = (take_rom(take)?, i32::try_from(take.signed()?));
            return Ok(Answer::Temperature(rom, Ok(value.map_err(|_| Malformed("a number in its range"))?)));
        }
        SWITCH => {
            let state = take.u8()?;
            return Ok(Answer::Switch(take_rom(take)?, Ok(state)));
        }
        SWITCH_FAILED => {
            let error = error(take.u8()?).ok_or(Malformed("an error of a 1-Wire bus"))?;
            return Ok(Answer::Switch(take_rom(take)?, Err(error)));
        }
        code => error(code).ok_or(Malformed("an answer of a 1-Wire bus"))?,
    };
    Ok(Answer::Temperature(take_rom(take)?, Err(error)))
}

pub(super) fn thermal(out: &mut Vec<u8>, state: &State) {
    wire::varint(out, state.readings().len() as u64);
    for reading in state.readings() {
        wire::text(out, &reading.zone);
        wire::signed(out, reading.millidegrees.into());
    }
    // 0: not known; else 4, and a bit for each.
    out.push(
        state.throttle.map_or(0, |throttle| 4 | u8::from(throttle.slowed) | u8::from(throttle.under_voltage) << 1),
    );
}

pub(super) fn take_thermal(take: &mut Decoder<'_>) -> Result<State, Malformed> {
    let mut state = State::default();
    for _ in 0..take.count()? {
        let (zone, value) = (take.text()?, i32::try_from(take.signed()?));
        if !state.push(zone, value.map_err(|_| Malformed("a number in its range"))?) {
            return Err(Malformed("temperatures of a computer"));
        }
    }
    state.throttle = match take.u8()? {
        0 => None,
        bits @ 4..=7 => Some(Throttle { slowed: bits & 1 != 0, under_voltage: bits & 2 != 0 }),
        _ => return Err(Malformed("what a computer does about heat")),
    };
    Ok(state)
}

fn rom(out: &mut Vec<u8>, rom: Rom) {
    out.push(rom.family());
    wire::varint(out, rom.serial());
}

fn take_rom(take: &mut Decoder<'_>) -> Result<Rom, Malformed> {
    Rom::new(take.u8()?, take.varint()?).ok_or(Malformed("a ROM code"))
}
