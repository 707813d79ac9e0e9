//! The simulator's end of a 1-Wire bus: a folder with the layout of `/sys/bus/w1/devices` as `w1_therm` and `w1_ds2413`
//! fill it. A switch follows its file `output` each time the simulator sends the levels at its pins.
//!
//! The run folder may be on a disk, which may block a writer for seconds: a separate thread writes. It writes the
//! latest state and skips those superseded meanwhile.

use crate::ports::worker::{Life, Worker};
use crate::ports::{Device, Lost, Received};
use base::Instant;
use base::w1::{Answer, Error, Rom, switch_state};
use module::Output;
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::os::fd::BorrowedFd;
use std::path::PathBuf;
use std::thread;
use std::time::Duration;

/// Maximum time that the end of the process waits for the removal of the folder.
const REMOVED_WITHIN: Duration = Duration::from_millis(100);

/// Value of each device that is present; `None`: none yet.
type Bus = BTreeMap<Rom, Option<Value>>;

/// Value of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Value {
    /// Result of a thermometer.
    Temperature(Result<i32, Error>),
    /// Levels at the pins of a switch.
    Pins(u8),
}

/// Port with the folder.
pub struct Folder {
    path: PathBuf,
    bus: Bus,
    worker: Option<Worker<Bus, ()>>,
    life: Life,
    /// The thread is writing a state that is out of date.
    writes: bool,
    stale: bool,
}

/// The thread's side; dropping it removes the folder.
struct FolderWriter {
    path: PathBuf,
    written: Bus,
}

impl Folder {
    /// Creates the port of a folder that does not exist yet.
    pub fn new(path: PathBuf) -> Self {
        Self { path, bus: Bus::new(), worker: None, life: Life::default(), writes: false, stale: false }
    }

    /// True if the thread has not written everything yet.
    #[cfg(test)]
    pub(super) fn is_writing(&self) -> bool {
        self.writes
    }

    fn write(&mut self) {
        match &mut self.worker {
            Some(worker) if !self.writes => (self.writes, self.stale) = (worker.queue(self.bus.clone()), false),
            _ => self.stale = true,
        }
    }
}

impl FolderWriter {
    fn fill(&mut self, bus: Bus) -> io::Result<()> {
        fs::create_dir_all(&self.path)?;
        for rom in self.written.keys().filter(|rom| !bus.contains_key(rom)) {
            fs::remove_dir_all(self.path.join(rom.to_string()))?;
        }
        for (rom, value) in &bus {
            if !self.written.contains_key(rom) {
                fs::create_dir_all(self.path.join(rom.to_string()))?;
            }
            match value {
                Some(Value::Pins(pins)) => self.put_switch(*rom, *pins)?,
                Some(Value::Temperature(result)) if self.written.get(rom) != Some(value) => self.put(*rom, *result)?,
                _ => {}
            }
        }
        self.written = bus;
        Ok(())
    }

    /// The state of a switch follows from its pins and from what was written to it.
    fn put_switch(&self, rom: Rom, pins: u8) -> io::Result<()> {
        let device = self.path.join(rom.to_string());
        let latches = match fs::read(device.join("output")) {
            Ok(bytes) => bytes.first().copied().unwrap_or(0xFF),
            // Without power its latches do not conduct.
            Err(_) => {
                fs::write(device.join("output"), [0xFF])?;
                0xFF
            }
        };
        let state = switch_state(pins, latches);
        let fresh = device.join("new");
        fs::write(&fresh, [state | !state << 4])?;
        fs::rename(&fresh, device.join("state"))
    }

    fn put(&self, rom: Rom, value: Result<i32, Error>) -> io::Result<()> {
        let device = self.path.join(rom.to_string());
        let put = |name: &str, text: String| {
            // Atomically, as the kernel does.
            let fresh = device.join("new");
            fs::write(&fresh, text)?;
            fs::rename(&fresh, device.join(name))
        };
        let pad = scratchpad(value.unwrap_or(0));
        let bytes: Vec<String> = pad.iter().map(|byte| format!("{byte:02x}")).collect();
        let (bytes, crc) = (bytes.join(" "), pad[8]);
        match value {
            Ok(value) => {
                put("w1_slave", format!("{bytes} : crc={crc:02x} YES\n{bytes} t={value}\n"))?;
                put("temperature", format!("{value}\n"))
            }
            Err(Error::Crc) => put("w1_slave", format!("{bytes} : crc={:02x} NO\n{bytes} t=0\n", !crc)),
            Err(Error::Nonsense) => put("w1_slave", format!("{bytes} : crc={crc:02x} YES\n{bytes} t=999999\n")),
            Err(Error::Absent | Error::Other) => put("w1_slave", String::new()),
        }
    }
}

impl Drop for FolderWriter {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.path);
    }
}

/// Memory of a DS18B20: temperature in sixteenths of a degree, alarms, 12-bit resolution, reserved bytes, CRC.
fn scratchpad(millidegrees: i32) -> [u8; 9] {
    let [low, high, ..] = (millidegrees * 2 / 125).to_le_bytes();
    let mut pad = [low, high, 0x4B, 0x46, 0x7F, 0xFF, 0x0C, 0x10, 0];
    pad[8] = pad[..8].iter().fold(0, |crc, byte| crc8(crc ^ byte));
    pad
}

/// Dallas CRC-8: x^8 + x^5 + x^4 + 1, least significant bit first.
fn crc8(byte: u8) -> u8 {
    (0..8).fold(byte, |crc, _| (crc >> 1) ^ if crc & 1 == 0 { 0 } else { 0x8C })
}

impl Device for Folder {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        if self.life.is_alive() {
            return Err("its former folder is still being removed".into());
        }
        let mut filler = FolderWriter { path: self.path.clone(), written: Bus::new() };
        let mut fresh = true;
        let work = move |bus| {
            // Left by an earlier process.
            if std::mem::take(&mut fresh) {
                let _ = fs::remove_dir_all(&filler.path);
            }
            filler.fill(bus).map_err(|error| format!("{}: {error}", filler.path.display()))
        };
        let worker = Worker::start("w1", &mut self.life, work).map_err(|error| format!("its thread: {error}"))?;
        self.worker = Some(worker);
        self.write();
        Ok(())
    }

    fn close(&mut self) {
        self.worker = None;
        self.bus.clear();
        (self.writes, self.stale) = (false, false);
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.worker.as_ref().map(Worker::fd)
    }

    fn receive(&mut self, _now: Instant) -> Result<Received<'_>, Lost> {
        if let Some(done) = self.worker.as_mut().and_then(Worker::take) {
            done?;
            self.writes = false;
            if self.stale {
                self.write();
            }
        }
        Ok(Received::Nothing)
    }

    fn send(&mut self, _now: Instant, output: &Output) -> Result<bool, Lost> {
        match output {
            Output::OneWireState(Answer::List(list)) => {
                self.bus.retain(|rom, _| list.contains(rom));
                for rom in list {
                    self.bus.entry(*rom).or_default();
                }
            }
            Output::OneWireState(Answer::Temperature(rom, value)) => {
                if let Some(said) = self.bus.get_mut(rom) {
                    *said = Some(Value::Temperature(*value));
                }
            }
            Output::OneWireState(Answer::Switch(rom, Ok(pins))) => {
                if let Some(said) = self.bus.get_mut(rom) {
                    *said = Some(Value::Pins(*pins));
                }
            }
            _ => return Ok(false),
        }
        self.write();
        Ok(true)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        self.close();
        let tries = REMOVED_WITHIN.as_millis();
        (0..tries).take_while(|_| self.life.is_alive()).for_each(|_| thread::sleep(Duration::from_millis(1)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scratchpad_is_one_of_a_real_ds18b20() {
        // 21.5 °C; CRC by the table of Maxim application note 27.
        let pad = scratchpad(21_500);
        assert_eq!(pad[..2], [0x58, 0x01]);
        assert_eq!(pad.iter().fold(0, |crc, byte| crc8(crc ^ byte)), 0, "with its check the remainder is 0");
        // Application note 27: 02 1C B8 01 00 00 00 has the CRC A2.
        assert_eq!([0x02, 0x1C, 0xB8, 0x01, 0, 0, 0].iter().fold(0, |crc, byte| crc8(crc ^ byte)), 0xA2);
        assert_eq!(scratchpad(-10_125)[..2], [0x5E, 0xFF]);
    }
}
