//! `advee i2c get`, `advee i2c set`: one register.

use super::bus::Bus;
use super::decode::{is_max6615, meaning, name, named};
use super::target::{Known, Target, Where};
use crate::{Common, Failed, Outcome, print, whole};
use ::i2c::max6615::{Access, find};
use ::i2c::smbus::{Answer, Command};
use serde_json::json;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Get {
    #[command(flatten)]
    place: Where,
    /// Name in the configuration, or address: fan1, 0x18
    chip: String,
    /// Number, or, of a known chip, its name: 0x0d, duty_1
    register: String,
    /// Read a word, the low byte first
    #[arg(long, conflicts_with = "block")]
    word: bool,
    /// Read a block of 1 to 32 bytes, whose first byte is its length
    #[arg(long)]
    block: bool,
    /// With a packet error code behind it
    #[arg(long)]
    pec: bool,
    /// Print one JSON line
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
pub struct Set {
    #[command(flatten)]
    place: Where,
    /// Name in the configuration, or address: fan1, 0x18
    chip: String,
    /// Number, or, of a known chip, its name: 0x0b, target_duty_1
    register: String,
    /// Value: 0 to 255, or to 65535 with --word; 0x… is hexadecimal
    #[arg(value_parser = value)]
    value: u16,
    /// Write a word, the low byte first
    #[arg(long)]
    word: bool,
    /// With a packet error code behind it
    #[arg(long)]
    pec: bool,
    /// Print one JSON line
    #[arg(long)]
    json: bool,
}

fn value(text: &str) -> Result<u16, String> {
    whole(text).ok_or_else(|| "expected a number from 0 to 65535".into())
}

/// Selected bus and chip.
struct Asked {
    target: Target,
    bus: Bus,
    chip: Known,
    register: u8,
    /// Registers have names.
    known: bool,
}

impl Asked {
    fn find(common: &Common, place: &Where, chip: &str, register: &str) -> Result<Self, Failed> {
        let target = place.find(common)?;
        let chip = target.chip(chip)?;
        let (number, row) = (whole(register), named(register));
        let Some(register) = number.or(row.map(|row| row.address)) else {
            let what = format!("no register {register:?}: expected a number from 0x00 to 0xff");
            return Err(format!("{what}, or a name that advee i2c dump shows").into());
        };
        let mut bus = Bus::open(&target)?;
        let known = is_max6615(&mut bus, &chip)?;
        if number.is_none() && !known {
            return Err(format!("{} is no MAX6615, whose registers have names", chip.text()).into());
        }
        Ok(Self { target, bus, chip, register, known })
    }

    fn ask(&mut self, command: &Command<'_>, pec: bool) -> Result<Answer, Failed> {
        let answer = self.bus.ask(&self.chip, command, pec)?;
        answer.map_err(|error| format!("{} on {}: {error}", self.chip.text(), self.target.name).into())
    }

    fn show(&self, json: bool, wrote: Option<u16>, answer: &Answer) -> Outcome {
        let (text, value) = match answer {
            Answer::Byte(value) => (format!("{value:#04x}"), json!(value)),
            Answer::Word(value) => (format!("{value:#06x}"), json!(value)),
            Answer::Block(bytes) => {
                let text: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
                (text.join(" "), json!(bytes.as_slice()))
            }
            other => (format!("{other:?}"), json!(null)),
        };
        let means = match answer {
            Answer::Byte(value) if self.known => meaning(self.register, *value),
            _ => None,
        };
        let name = self.known.then(|| name(self.register));
        if json {
            let mut line = json!({
                "bus": self.target.name, "address": self.chip.address.get(), "name": self.chip.name,
                "register": self.register, "register_name": name, "value": value, "meaning": means,
            });
            if let Some(wrote) = wrote {
                line["wrote"] = wrote.into();
            }
            print(line)?;
        } else {
            let name = name.map_or(String::new(), |name| format!(" {name}"));
            let means = means.map_or(String::new(), |means| format!("  {means}"));
            print(format!("{} {:02x}{name}: {text}{means}", self.chip.text(), self.register))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

pub fn get(common: &Common, command: &Get) -> Outcome {
    let mut asked = Asked::find(common, &command.place, &command.chip, &command.register)?;
    let code = asked.register;
    let read = match (command.word, command.block) {
        (true, _) => Command::ReadWord { code },
        (_, true) => Command::BlockRead { code },
        _ => Command::ReadByte { code },
    };
    let answer = asked.ask(&read, command.pec)?;
    asked.show(command.json, None, &answer)
}

pub fn set(common: &Common, command: &Set) -> Outcome {
    let byte = u8::try_from(command.value);
    if !command.word && byte.is_err() {
        return Err(format!("{}: a register has a byte, 0 to 255; --word writes two", command.value).into());
    }
    let mut asked = Asked::find(common, &command.place, &command.chip, &command.register)?;
    let code = asked.register;
    if asked.known && find(code).is_none_or(|register| register.access == Access::Read) {
        return Err(format!("{}: register {code:02x}, {}, cannot be written", asked.chip.text(), name(code)).into());
    }
    let (write, read) = match byte {
        Ok(value) if !command.word => (Command::WriteByte { code, value }, Command::ReadByte { code }),
        _ => (Command::WriteWord { code, value: command.value }, Command::ReadWord { code }),
    };
    asked.ask(&write, command.pec)?;
    let answer = asked.ask(&read, command.pec)?;
    asked.show(command.json, Some(command.value), &answer)
}
