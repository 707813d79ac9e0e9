//! Each command as it stands on the bus, with PEC and without, and answers that are none.

use super::*;
use crate::target::{Target, answer};
use crate::testing::{Bench, Random, address, bytes};
use std::string::String;
use std::vec::Vec;
use std::{format, vec};

/// Acknowledges everything, says what it was made for, and writes down what happens in the symbols of the figures.
struct Script {
    says: Vec<u8>,
    log: String,
}

impl Target for Script {
    fn start(&mut self, address: Address, read: bool) -> bool {
        let again = if self.log.is_empty() { "S" } else { " Sr" };
        self.log += &format!("{again} {address:?}{} A", if read { 'R' } else { 'W' });
        true
    }

    fn write(&mut self, byte: u8) -> bool {
        self.log += &format!(" {byte:02x} A");
        true
    }

    fn read(&mut self) -> u8 {
        let byte = if self.says.is_empty() { 0xEE } else { self.says.remove(0) };
        self.log += &format!(" [{byte:02x}]");
        byte
    }

    fn stop(&mut self) {
        self.log += " P";
    }
}

/// The command to 0x5A, to a chip that says these bytes: what was on the bus, and what came of it.
fn check(command: Command<'_>, pec: bool, says: &[u8], bus: &str, expected: &Result<Answer, Error>) {
    let mut script = Script { says: says.into(), log: String::new() };
    let transfer = command.transfer(address(0x5A), pec).unwrap();
    let outcome = answer(&mut [&mut script], &transfer);
    assert_eq!(script.log, bus, "{command:?}");
    assert_eq!(&command.answer(address(0x5A), pec, &outcome), expected, "{command:?}");
}

fn block(data: &[u8]) -> Answer {
    Answer::Block(data.iter().copied().collect())
}

#[test]
fn the_check_value_of_the_pec() {
    assert_eq!(b"123456789".iter().fold(0, |crc, byte| crc8(crc, *byte)), 0xF4);
}

#[test]
fn commands_are_those_of_the_figures() {
    let nothing = &Ok(Answer::Nothing);
    check(Command::Quick { read: false }, false, &[], "S 0x5aW A P", nothing);
    check(Command::Quick { read: true }, false, &[], "S 0x5aR A P", nothing);
    check(Command::SendByte(0x07), false, &[], "S 0x5aW A 07 A P", nothing);
    check(Command::ReceiveByte, false, &[0x2A], "S 0x5aR A [2a] P", &Ok(Answer::Byte(0x2A)));
    check(Command::WriteByte { code: 1, value: 2 }, false, &[], "S 0x5aW A 01 A 02 A P", nothing);
    check(Command::WriteWord { code: 1, value: 0x1234 }, false, &[], "S 0x5aW A 01 A 34 A 12 A P", nothing);
    check(Command::ReadByte { code: 7 }, false, &[3], "S 0x5aW A 07 A Sr 0x5aR A [03] P", &Ok(Answer::Byte(3)));
    check(
        Command::ReadWord { code: 7 },
        false,
        &[0x34, 0x12],
        "S 0x5aW A 07 A Sr 0x5aR A [34] [12] P",
        &Ok(Answer::Word(0x1234)),
    );
    check(
        Command::ProcessCall { code: 7, value: 0x0102 },
        false,
        &[0x34, 0x12],
        "S 0x5aW A 07 A 02 A 01 A Sr 0x5aR A [34] [12] P",
        &Ok(Answer::Word(0x1234)),
    );
    check(
        Command::BlockWrite { code: 7, data: &[1, 2, 3] },
        false,
        &[],
        "S 0x5aW A 07 A 03 A 01 A 02 A 03 A P",
        nothing,
    );
    check(
        Command::BlockRead { code: 7 },
        false,
        &[2, 8, 9],
        "S 0x5aW A 07 A Sr 0x5aR A [02] [08] [09] P",
        &Ok(block(&[8, 9])),
    );
    check(
        Command::BlockProcessCall { code: 7, data: &[1] },
        false,
        &[2, 8, 9],
        "S 0x5aW A 07 A 01 A 01 A Sr 0x5aR A [02] [08] [09] P",
        &Ok(block(&[8, 9])),
    );
    check(
        Command::Write32 { code: 7, value: 0x0403_0201 },
        false,
        &[],
        "S 0x5aW A 07 A 01 A 02 A 03 A 04 A P",
        nothing,
    );
    check(
        Command::Read32 { code: 7 },
        false,
        &[1, 2, 3, 4],
        "S 0x5aW A 07 A Sr 0x5aR A [01] [02] [03] [04] P",
        &Ok(Answer::Word32(0x0403_0201)),
    );
    check(
        Command::Write64 { code: 7, value: 0x0807_0605_0403_0201 },
        false,
        &[],
        "S 0x5aW A 07 A 01 A 02 A 03 A 04 A 05 A 06 A 07 A 08 A P",
        nothing,
    );
    check(
        Command::Read64 { code: 7 },
        false,
        &[1, 2, 3, 4, 5, 6, 7, 8],
        "S 0x5aW A 07 A Sr 0x5aR A [01] [02] [03] [04] [05] [06] [07] [08] P",
        &Ok(Answer::Word64(0x0807_0605_0403_0201)),
    );
}

/// The two worked examples of an infrared thermometer's data sheet (MLX90614, 8.4.3): a word read and a word written.
#[test]
fn the_pec_is_that_of_the_worked_examples() {
    check(
        Command::ReadWord { code: 0x07 },
        true,
        &[0xD2, 0x3A, 0x30],
        "S 0x5aW A 07 A Sr 0x5aR A [d2] [3a] [30] P",
        &Ok(Answer::Word(0x3AD2)),
    );
    check(
        Command::WriteWord { code: 0x22, value: 0xC807 },
        true,
        &[],
        "S 0x5aW A 22 A 07 A c8 A 48 A P",
        &Ok(Answer::Nothing),
    );
}

#[test]
fn a_wrong_pec_is_told_with_the_right_one() {
    check(
        Command::ReadWord { code: 0x07 },
        true,
        &[0xD2, 0x3B, 0x30],
        "S 0x5aW A 07 A Sr 0x5aR A [d2] [3b] [30] P",
        &Err(Error::Pec { got: 0x30, want: 0x37 }),
    );
}

#[test]
fn a_block_of_no_bytes_or_more_than_32_is_not_read_on() {
    for len in [0, 33, 255] {
        check(
            Command::BlockRead { code: 7 },
            true,
            &[len, 1, 2],
            &format!("S 0x5aW A 07 A Sr 0x5aR A [{len:02x}] P"),
            &Err(Error::Length(len)),
        );
    }
    for len in [0, 33] {
        let data = vec![0; len];
        let command = Command::BlockWrite { code: 0, data: &data };
        assert_eq!(command.transfer(address(0x5A), false), Err(BadBlock { len }));
    }
}

#[test]
fn the_longest_commands_fit() {
    let data = [0x55; 32];
    let command = Command::BlockProcessCall { code: 0x10, data: &data };
    let transfer = command.transfer(address(0x5A), true).unwrap();
    let mut says = vec![32];
    says.extend(data);
    says.push(pec_of(&transfer, &says));
    let mut script = Script { says, log: String::new() };
    let outcome = answer(&mut [&mut script], &transfer);
    assert_eq!(command.answer(address(0x5A), true, &outcome), Ok(block(&data)));
    let written = Command::BlockWrite { code: 0x10, data: &data }.transfer(address(0x5A), true).unwrap();
    assert_eq!(written.write.len(), 35);
}

#[test]
fn what_the_bus_says_is_passed_on() {
    let failed = Err(i2c::Error::NoAddress);
    let command = Command::ReadByte { code: 0 };
    assert_eq!(command.answer(address(1), true, &failed), Err(Error::Bus(i2c::Error::NoAddress)));
    assert_eq!(command.answer(address(1), true, &Ok(bytes(&[1]))), Err(Error::Count { got: 1, want: 2 }));
    assert_eq!(command.answer(address(1), false, &Ok(bytes(&[]))), Err(Error::Count { got: 0, want: 1 }));
}

/// Whatever an adapter brings: no panic; and with a PEC nothing is believed that was changed in one or two bits.
#[test]
fn no_outcome_panics_and_one_or_two_wrong_bits_are_found() {
    let mut random = Random::new(7);
    let data = [1, 2, 3];
    let commands = [
        Command::Quick { read: true },
        Command::ReceiveByte,
        Command::SendByte(1),
        Command::ReadByte { code: 3 },
        Command::ReadWord { code: 9 },
        Command::ProcessCall { code: 3, value: 77 },
        Command::BlockRead { code: 4 },
        Command::BlockProcessCall { code: 4, data: &data },
        Command::Read32 { code: 1 },
        Command::Read64 { code: 1 },
    ];
    for _ in 0..20_000 {
        let command = commands[random.below(10) as usize];
        let outcome = match random.below(8) {
            0 => Err(i2c::Error::Other),
            _ => Ok((0..random.below(37)).map(|_| random.next() as u8).collect()),
        };
        let _ = command.answer(address(0x18), random.below(2) == 0, &outcome);
    }
    for command in &commands[1..] {
        let transfer = command.transfer(address(0x5A), true).unwrap();
        let says = match transfer.read {
            Read::None | Read::Exactly(0) => continue,
            Read::Exactly(count) => vec![0xA5; usize::from(count) - 1],
            Read::Block { .. } => vec![3, 7, 8, 9],
        };
        let mut says = says;
        says.push(pec_of(&transfer, &says));
        let bits = says.len() * 8;
        for first in 0..bits {
            for second in 0..bits {
                let mut changed = says.clone();
                changed[first / 8] ^= 1 << (first % 8);
                if second != first {
                    changed[second / 8] ^= 1 << (second % 8);
                }
                assert!(command.answer(address(0x5A), true, &Ok(bytes(&changed))).is_err(), "{command:?}");
            }
        }
    }
}

#[test]
fn commands_cross_the_wire_as_the_figures_draw_them() {
    let mut bench = Bench::standard();
    let mut run = |command: Command<'_>| {
        let transfer = command.transfer(address(0x18), false).unwrap();
        let outcome = bench.run(transfer);
        (bench.symbols(), command.answer(address(0x18), false, &outcome))
    };
    let (bus, answer) = run(Command::WriteByte { code: 0x02, value: 0x18 });
    assert_eq!((&*bus, answer), ("S 18W A 02 A 18 A P", Ok(Answer::Nothing)));
    let (bus, answer) = run(Command::ReadByte { code: 0x02 });
    assert_eq!((&*bus, answer), ("S 18W A 02 A Sr 18R A 18 N P", Ok(Answer::Byte(0x18))));
    let (bus, answer) = run(Command::ReadWord { code: 0x03 });
    assert_eq!((&*bus, answer), ("S 18W A 03 A Sr 18R A 9f A d4 N P", Ok(Answer::Word(0xD49F))));
    let (bus, _) = run(Command::WriteByte { code: 0x10, value: 2 });
    assert_eq!(bus, "S 18W A 10 A 02 A P");
    let (bus, answer) = run(Command::BlockRead { code: 0x10 });
    assert_eq!((&*bus, answer), ("S 18W A 10 A Sr 18R A 02 A 85 A ba N P", Ok(block(&[0x85, 0xBA]))));
    let (bus, answer) = run(Command::BlockRead { code: 0x0 });
    assert_eq!((&*bus, answer), ("S 18W A 00 A Sr 18R A 00 N P", Err(Error::Length(0))));
}
