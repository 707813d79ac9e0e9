//! `advee i2c dump`: all registers of a chip; those of a known one by name, with what they mean.

use super::bus::Bus;
use super::decode::{is_max6615, meaning};
use super::target::{Known, Target, Where};
use crate::{Common, Failed, Outcome, print};
use ::i2c::max6615::{Access, REGISTERS};
use ::i2c::smbus;
use base::i2c::Error;
use serde_json::json;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Dump {
    #[command(flatten)]
    place: Where,
    /// Name in the configuration, or address: fan1, 0x18
    chip: String,
    /// JSON lines: one a register
    #[arg(long)]
    json: bool,
}

pub fn dump(common: &Common, command: &Dump) -> Outcome {
    let target = command.place.find(common)?;
    let chip = target.chip(&command.chip)?;
    let mut bus = Bus::open(&target)?;
    if is_max6615(&mut bus, &chip)? {
        named(&target, &chip, &mut bus, command.json)?;
    } else {
        plain(&target, &chip, &mut bus, command.json)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn named(target: &Target, chip: &Known, bus: &mut Bus, json: bool) -> Result<(), Failed> {
    if !json {
        print(format!("{} on {}: MAX6615", chip.text(), target.name))?;
    }
    for register in REGISTERS {
        let value = read(target, chip, bus, register.address)?;
        let Some(value) = value else { continue };
        let means = meaning(register.address, value);
        if json {
            print(json!({
                "bus": target.name, "address": chip.address.get(), "name": chip.name, "register": register.address,
                "register_name": register.name, "value": value, "meaning": means,
                "writable": register.access == Access::ReadWrite, "power_on": register.power_on,
            }))?;
            continue;
        }
        let changed = if register.power_on.is_some_and(|before| before != value) { '*' } else { ' ' };
        let means = means.unwrap_or_default();
        print(format!("{:02x}  {value:02x}{changed} {:25}  {means}", register.address, register.name).trim_end())?;
    }
    if !json {
        print("* is not as at power-on")?;
    }
    Ok(())
}

fn plain(target: &Target, chip: &Known, bus: &mut Bus, json: bool) -> Result<(), Failed> {
    let mut row = String::new();
    if !json {
        print("     0  1  2  3  4  5  6  7  8  9  a  b  c  d  e  f")?;
    }
    for register in 0..=255_u8 {
        let value = read(target, chip, bus, register)?;
        if json {
            if let Some(value) = value {
                let (bus, address) = (&target.name, chip.address.get());
                print(
                    json!({"bus": bus, "address": address, "name": chip.name, "register": register, "value": value}),
                )?;
            }
            continue;
        }
        let text = value.map_or("XX".into(), |value| format!("{value:02x}"));
        row.push_str(&format!(" {text}"));
        if register % 16 == 15 {
            print(format!("{:02x}: {row}", register & 0xF0))?;
            row.clear();
        }
    }
    Ok(())
}

/// A register; none where the chip has none.
fn read(target: &Target, chip: &Known, bus: &mut Bus, register: u8) -> Result<Option<u8>, Failed> {
    match bus.byte(chip, register)? {
        Ok(value) => Ok(Some(value)),
        Err(smbus::Error::Bus(Error::NoData { .. })) => Ok(None),
        Err(error) => Err(format!("{} on {}: {error}", chip.text(), target.name).into()),
    }
}
