//! Every instruction of every board on the wire: bytes typed from `docs/facts/boards.md`, CRCs computed by another
//! program.

use super::{BOARDS, DO_RESET, GET_VERSION, Instruction, psc1, sbs1, sd1, so1};
use crate::crc::Crc8;
use crate::frame::{Frame, Words};
use crate::reader::{Reader, Received};
use crate::testing::{text, words};
use base::Instant;
use std::vec::Vec;

/// Instruction, address, the request's data, the request, a good answer (for what comes unasked: what the board sends).
type Line = (Instruction, u8, &'static [u8], &'static str, &'static str);

#[rustfmt::skip]
const LINES: &[Line] = &[
    (GET_VERSION, sd1::FRONT, &[], "10! fe 00 00 fd", "10! fe 00 02 01 04 5c"),
    (DO_RESET, sd1::FRONT, &[], "10! ff 00 00 72", "10! ff 00 00 72"),
    (sd1::GET_SRF_DATA, sd1::FRONT, &[], "10! 01 00 00 f3", "10! 01 00 04 e8 03 00 00 63"),
    (sd1::GET_IR_DATA, sd1::FRONT, &[], "10! 02 00 00 7f", "10! 02 00 02 78 ff 80"),
    (sd1::GET_BOTH_DATA, sd1::FRONT, &[], "10! 10 00 00 64",
        "10! 10 00 14 08 e8 03 00 00 2c 01 00 00 00 00 00 00 00 00 10 27 02 78 ff 27"),
    (sd1::GET_PAUSE_SRC, sd1::FRONT, &[], "10! 20 00 00 4c", "10! 20 00 01 02 c2"),
    (sd1::CLEAR_PAUSE_SRC, sd1::FRONT, &[], "10! 21 00 00 c3", "10! 21 00 00 c3"),
    (so1::GET_TICKS, so1::ADDRESS, &[], "20! 01 00 00 9c", "20! 01 00 04 01 00 fe ff 7a"),
    (so1::RESET_TICKS, so1::ADDRESS, &[], "20! 02 00 00 10", "20! 02 00 00 10"),
    (sbs1::SET_BEACON_IDS, sbs1::ADDRESS, &[3, 7], "30! 01 00 02 03 07 24", "30! 01 00 00 b9"),
    (sbs1::GET_BEACON_DATA, sbs1::ADDRESS, &[], "30! 02 00 00 35",
        "30! 02 00 0d 02 07 28 23 c8 fa 00 03 b0 b9 0c e8 03 02"),
    (sbs1::GET_DEBUG_DATA, sbs1::ADDRESS, &[], "30! 03 00 00 ba", "30! 03 00 06 01 00 03 02 88 13 b9"),
    (psc1::GET_PWR_STATUS, psc1::ADDRESS, &[], "40! 01 00 00 42", "40! 01 00 01 ff 9a"),
    (psc1::SET_PWR_STATUS, psc1::ADDRESS, &[0x30, 0x00], "40! 02 00 02 30 00 b0", "40! 02 00 01 cf 6a"),
    (psc1::GET_CURRENTS, psc1::ADDRESS, &[], "40! 03 00 00 41",
        "40! 03 00 12 e8 03 d0 07 b8 0b a0 0f 88 13 70 17 58 1b 40 1f 20 67 d5"),
    (psc1::PAUSE_CHANGED, psc1::ADDRESS, &[], "", "40! 80 00 02 01 03 ed"),
    (psc1::POWER_OFF_REQUESTED, psc1::ADDRESS, &[], "", "40! 81 00 01 1e 00"),
];

/// The data of a frame on the wire, after a look at all else.
fn read(instruction: Instruction, address: u8, wire: &str) -> Vec<u8> {
    let mut reader = Reader::new(Crc8::SAE_J1850, None);
    let words = words(wire);
    let (last, before) = words.split_last().unwrap();
    before.iter().for_each(|word| assert_eq!(reader.push(Instant::ZERO, *word), None, "{wire}"));
    let Some(Received::Frame(Frame { address: from, instruction: code, flags: 0, data })) =
        reader.push(Instant::ZERO, *last)
    else {
        panic!("{wire}");
    };
    assert_eq!((from, code), (address, instruction.code), "{wire}");
    data.to_vec()
}

#[test]
fn every_instruction_stands_on_the_wire_as_the_tables_say() {
    for &(instruction, address, data, request, answer) in LINES {
        if !request.is_empty() {
            let asked = instruction.ask(address, data);
            let mut sent = Words::new();
            Frame { address: asked.to, instruction: asked.instruction, flags: 0, data: asked.data }
                .encode(Crc8::SAE_J1850, &mut sent);
            assert_eq!(text(&sent), request, "{}", instruction.name);
            assert!(instruction.request.allow(data.len()), "{}", instruction.name);
        }
        let data = read(instruction, address, answer);
        assert!(instruction.answer.allow(data.len()), "{}", instruction.name);
    }
}

#[test]
fn no_instruction_is_without_its_line() {
    for instruction in BOARDS.iter().flat_map(|board| board.instructions.iter().chain(board.unasked)) {
        assert!(LINES.iter().any(|line| line.0 == *instruction), "{}", instruction.name);
    }
}

#[test]
fn every_answer_reads_as_typed_data() {
    let data = |instruction: Instruction| {
        let line = LINES.iter().find(|line| line.0 == instruction).unwrap();
        read(instruction, line.1, line.4)
    };
    assert_eq!(sd1::parse_srfs(&data(sd1::GET_SRF_DATA)).unwrap(), [1000, sd1::NO_ECHO]);
    assert_eq!(sd1::parse_irs(&data(sd1::GET_IR_DATA)).unwrap(), [120, sd1::OUT_OF_RANGE]);
    assert_eq!(sd1::Both::parse(&data(sd1::GET_BOTH_DATA)).unwrap().srfs[7], 10_000);
    assert_eq!(sd1::PauseSource::parse(&data(sd1::GET_PAUSE_SRC)), Ok(sd1::PauseSource::IrRight));
    assert_eq!(so1::parse_ticks(&data(so1::GET_TICKS)).unwrap(), [1, -2]);
    assert_eq!(sbs1::parse_beacons(&data(sbs1::GET_BEACON_DATA)).unwrap()[1].bearing, -18_000);
    assert_eq!(sbs1::parse_debug(&data(sbs1::GET_DEBUG_DATA)).unwrap().supply_mv, 5000);
    assert_eq!(psc1::parse_status(&data(psc1::GET_PWR_STATUS)), Ok(0xFF));
    assert_eq!(psc1::parse_status(&data(psc1::SET_PWR_STATUS)), Ok(0xCF), "monitor and audio are off");
    assert_eq!(psc1::parse_currents(&data(psc1::GET_CURRENTS)).unwrap().battery_mv, 26_400);
    let unasked = |instruction: Instruction| psc1::parse_unasked(instruction.code, &data(instruction));
    let pause = psc1::Unasked::PauseChanged { engaged: true, source: 3 };
    assert_eq!(unasked(psc1::PAUSE_CHANGED), Ok(pause));
    assert_eq!(unasked(psc1::POWER_OFF_REQUESTED), Ok(psc1::Unasked::PowerOffRequested { seconds: 30 }));
}
