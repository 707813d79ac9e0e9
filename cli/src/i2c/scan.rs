//! `advee i2c scan`: checks which addresses are acknowledged.

use super::bus::Bus;
use super::decode::is_max6615;
use super::target::{Known, Where};
use crate::{Common, Failed, Outcome, print};
use ::i2c::smbus::{self, Command};
use base::i2c::{Address, Error};
use serde_json::json;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Scan {
    #[command(flatten)]
    place: Where,
    /// Ask reserved addresses, too: 0x00 to 0x07 and 0x78 to 0x7f
    #[arg(long)]
    all: bool,
    /// JSON lines: one a chip
    #[arg(long)]
    json: bool,
}

/// Chips there forget what they hold when a quick command writes nothing to them: write-protected memories.
const READ: [std::ops::RangeInclusive<u8>; 2] = [0x30..=0x37, 0x50..=0x5F];

pub fn scan(common: &Common, command: &Scan) -> Outcome {
    let target = command.place.find(common)?;
    let mut bus = Bus::open(&target)?;
    let (mut found, mut asked) = (0, 0);
    let mut rows = Vec::new();
    for address in (0..0x80).filter_map(Address::new).filter(|address| command.all || !address.reserved()) {
        let chip = target.at(address);
        asked += 1;
        let there = look(&mut bus, &chip)?;
        if !there && !target.knows(address) {
            continue;
        }
        found += u32::from(there);
        let kind = if there && is_max6615(&mut bus, &chip)? { "max6615" } else { "?" };
        if command.json {
            print(json!({
                "bus": target.name, "address": address.get(), "name": chip.name, "chip": kind,
                "configured": target.knows(address), "there": there,
            }))?;
        } else {
            let missing = if there { "" } else { "MISSING: configured, does not answer" };
            rows.push(format!("{address}     {:8}  {kind:8}  {missing}", chip.name).trim_end().to_string());
        }
    }
    if !command.json {
        if !rows.is_empty() {
            print("ADDRESS  NAME      CHIP")?;
        }
        rows.iter().try_for_each(print)?;
        let s = if found == 1 { "" } else { "s" };
        print(format!("{found} chip{s} on {}; {asked} addresses asked", target.name))?;
    }
    if found == 0 {
        let what = format!("{}: nobody answers", target.name);
        return Err(format!("{what}: supply, wires, SDA and SCL and their pull-ups are what to look at").into());
    }
    Ok(ExitCode::SUCCESS)
}

/// True if the address is acknowledged.
fn look(bus: &mut Bus, chip: &Known) -> Result<bool, Failed> {
    let read = READ.iter().any(|range| range.contains(&chip.address.get()));
    let command = if read { Command::ReceiveByte } else { Command::Quick { read: false } };
    match bus.ask(chip, &command, false)? {
        Ok(_) => Ok(true),
        Err(smbus::Error::Bus(Error::NoAddress | Error::NoData { .. })) => Ok(false),
        Err(error) => Err(format!("{}: {error}", chip.text()).into()),
    }
}
