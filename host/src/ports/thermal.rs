//! Temperatures of the computer: thermal zones and hardware monitors of the kernel, and the simulator's end, a folder
//! of the same layout.

pub mod read;

use super::Lost;
use super::threaded::Service;
use base::thermal::State;
use module::{Input, Output};
use read::Reader;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The kernel's temperatures below this folder, `/sys`. What is missing is an answer, not an error. A sensor behind a
/// slow bus delays its answer.
pub struct Zones(pub PathBuf);

impl Service for Zones {
    type Request = ();
    type Answer = State;
    const THREAD: &'static str = "thermal";
    const BUSY: &'static str = "its last reading has not finished";

    fn work(&self) -> impl FnMut(()) -> Result<State, Lost> + Send + 'static {
        let mut reader = Reader::new(self.0.clone());
        move |()| Ok(reader.read())
    }

    fn request(output: &Output) -> Option<&()> {
        matches!(output, Output::Thermal).then_some(&())
    }

    fn input(answer: &State) -> Input<'_> {
        Input::Thermal(answer)
    }
}

/// The simulator's end: writes thermal zones into a folder, which is removed at the end, and returns what was written.
pub struct Folder(pub PathBuf);

impl Service for Folder {
    type Request = State;
    type Answer = State;
    const THREAD: &'static str = "thermal";
    const BUSY: &'static str = "its former folder is still being removed";

    fn work(&self) -> impl FnMut(State) -> Result<State, Lost> + Send + 'static {
        let mut writer = Writer { path: self.0.clone(), fresh: true };
        move |state| match writer.write(&state) {
            Ok(()) => Ok(state),
            Err(error) => Err(format!("{}: {error}", writer.path.display())),
        }
    }

    fn request(output: &Output) -> Option<&State> {
        if let Output::ThermalState(state) = output { Some(state) } else { None }
    }

    fn input(answer: &State) -> Input<'_> {
        Input::Thermal(answer)
    }
}

/// The thread's side; dropping it removes the folder.
struct Writer {
    path: PathBuf,
    fresh: bool,
}

impl Writer {
    fn write(&mut self, state: &State) -> io::Result<()> {
        if std::mem::take(&mut self.fresh) {
            // Left by an earlier process.
            let _ = fs::remove_dir_all(&self.path);
        }
        let zones = self.path.join(read::ZONES);
        for (n, reading) in state.readings().iter().enumerate() {
            let zone = zones.join(format!("thermal_zone{n}"));
            fs::create_dir_all(&zone)?;
            put(&zone, "type", &format!("{}\n", reading.zone))?;
            put(&zone, "temp", &format!("{}\n", reading.millidegrees))?;
        }
        if let Some(throttle) = state.throttle {
            let bits = u32::from(throttle.under_voltage) | u32::from(throttle.slowed) << 2;
            let folder = self.path.join(read::FIRMWARE);
            fs::create_dir_all(&folder)?;
            put(&folder, read::GET_THROTTLED, &format!("{bits:x}\n"))?;
        }
        Ok(())
    }
}

/// Writes a file as a whole, as the kernel shows it.
fn put(folder: &Path, name: &str, text: &str) -> io::Result<()> {
    let fresh = folder.join("new");
    fs::write(&fresh, text)?;
    fs::rename(&fresh, folder.join(name))
}

impl Drop for Writer {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.path);
    }
}

#[cfg(test)]
mod tests;
