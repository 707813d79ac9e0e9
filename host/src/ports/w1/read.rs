//! Files of `w1_therm` (Documentation/w1/slaves/w1_therm.rst) and `w1_ds2413` (w1_ds2413.rst). Their driver may be on
//! a slow, long or unplugged wire: any content is an answer.

use base::w1::{Answer, Error, List, MAX, Request, Rom};
use nix::errno::Errno;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::Path;

/// Maximum size of a thermometer's file, bytes.
const FILE_MAX: u64 = 256;
/// Measuring range of the family, thousandths of a degree.
const RANGE: std::ops::RangeInclusive<i32> = -55_000..=125_000;

/// Answers a request from the files in `folder`.
pub fn answer(folder: &Path, request: Request) -> Answer {
    match request {
        Request::List => Answer::List(list(folder)),
        Request::Temperature(rom) => Answer::Temperature(rom, temperature(&folder.join(rom.to_string()))),
        Request::Read(rom) => Answer::Switch(rom, state(&folder.join(rom.to_string()))),
        Request::Write(rom, latches) => {
            let device = folder.join(rom.to_string());
            Answer::Switch(rom, set(&device, latches).and_then(|()| state(&device)))
        }
    }
}

fn list(folder: &Path) -> List {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let roms = entries.filter_map(|entry| Rom::parse(entry.file_name().to_str()?));
    let mut roms: Vec<Rom> = roms.filter(|rom| rom.is_thermometer()).collect();
    roms.sort_unstable();
    roms.into_iter().take(MAX).collect()
}

/// Reads `w1_slave`, which every version of the driver has and which includes the CRC check; `temperature` if that file
/// is absent.
fn temperature(device: &Path) -> Result<i32, Error> {
    match file(&device.join("w1_slave")) {
        Ok(text) => slave(&text),
        // An empty file belongs to a device that has just gone.
        Err(Error::Absent) => match file(&device.join("temperature"))?.as_str() {
            "" => Err(Error::Absent),
            text => number(text),
        },
        Err(error) => Err(error),
    }
}

/// Reads `state` of a switch: one byte, whose upper half is the complement of the lower one.
fn state(device: &Path) -> Result<u8, Error> {
    let mut byte = [0];
    let read = File::open(device.join("state")).and_then(|mut file| file.read(&mut byte));
    match (read.map_err(|error| why(&error))?, byte) {
        (1, [byte]) if byte >> 4 == !byte & 0x0F => Ok(byte & 0x0F),
        (1, _) => Err(Error::Crc),
        // An empty file belongs to a device that has just gone.
        _ => Err(Error::Absent),
    }
}

/// Writes `output` of a switch: its latches in the lower two bits, the others 1.
fn set(device: &Path, latches: u8) -> Result<(), Error> {
    let file = File::options().write(true).open(device.join("output"));
    file.and_then(|mut file| file.write_all(&[latches | 0xFC])).map_err(|error| why(&error))
}

fn file(path: &Path) -> Result<String, Error> {
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(FILE_MAX).read_to_end(&mut bytes));
    read.map_err(|error| why(&error))?;
    String::from_utf8(bytes).map_err(|_| Error::Nonsense)
}

/// A device that goes while its file is open fails with one of the kernel's errors for a missing device.
fn why(error: &io::Error) -> Error {
    match Errno::from_raw(error.raw_os_error().unwrap_or(0)) {
        Errno::ENOENT | Errno::ENOTDIR | Errno::ENODEV | Errno::ENXIO => Error::Absent,
        // Error of the driver if no attempt had a valid CRC.
        Errno::EIO => Error::Crc,
        _ => Error::Other,
    }
}

/// Parses `w1_slave`: the scratchpad twice, once with `crc=57 YES`, once with `t=23125`.
pub fn slave(text: &str) -> Result<i32, Error> {
    let mut lines = text.lines();
    let (check, value) = (lines.next().unwrap_or(""), lines.next().unwrap_or(""));
    match check.split_whitespace().last() {
        Some("YES") => number(value.rsplit_once("t=").ok_or(Error::Nonsense)?.1),
        Some("NO") => Err(Error::Crc),
        // The driver found no device, or was interrupted.
        None => Err(Error::Absent),
        Some(_) => Err(Error::Nonsense),
    }
}

/// Parses `temperature`: thousandths of a degree.
pub fn number(text: &str) -> Result<i32, Error> {
    text.trim().parse().ok().filter(|value| RANGE.contains(value)).ok_or(Error::Nonsense)
}
