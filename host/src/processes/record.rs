//! Record of the modules for the next watchdog: the process and the wanted state of each. A file in the run folder that
//! is replaced atomically.
//!
//! ```text
//! advee processes 1
//! boot eb80845d-a7f5-4217-9c14-af32a892ea02
//! driver_power 4711 883412 RUN
//! driver_aux 0 0 TERMINATE held
//! driver_canbus 0 0 RUN starting
//! ```
//! Columns: module, process id (0: none), its start in ticks since the machine's start, wanted state. `starting`: it
//! may have a process whose id is not recorded yet.

use module::State;
use std::fs;
use std::io::{self, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

const HEAD: &str = "advee processes 1";
/// Maximum size of a valid record, bytes.
const SIZE_MAX: u64 = 64 << 10;

/// Record of one module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Name.
    pub module: String,
    /// Process id and start time; `None` without a process.
    pub process: Option<(u32, u64)>,
    /// A process is being started.
    pub starting: bool,
    /// Wanted state.
    pub wanted: State,
    /// True if only an operator leads it out of TERMINATE.
    pub held: bool,
}

/// The file and its content.
#[derive(Debug)]
pub struct Record {
    path: PathBuf,
    boot: String,
    entries: Vec<Entry>,
}

impl Record {
    /// Reads the file that an earlier watchdog left; empty if there is none, or if it is from an earlier start of the
    /// machine.
    ///
    /// # Errors
    /// One line: the file exists but cannot be read. The returned record is empty and will replace it.
    pub fn read(path: &Path, boot: String) -> (Self, Result<(), String>) {
        let mut record = Self { path: path.into(), boot, entries: Vec::new() };
        let why = |why: String| format!("{}: {why}; processes of an earlier watchdog are not adopted", path.display());
        let mut text = String::new();
        let read = fs::File::open(path).and_then(|file| file.take(SIZE_MAX).read_to_string(&mut text));
        match read {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return (record, Ok(())),
            Err(error) => return (record, Err(why(error.to_string()))),
            Ok(_) => {}
        }
        match parse(&text) {
            Ok((boot, entries)) if boot == record.boot => {
                record.entries = entries;
                (record, Ok(()))
            }
            Ok(_) => (record, Ok(())),
            Err(line) => (record, Err(why(format!("line {line} is invalid")))),
        }
    }

    /// All modules.
    #[must_use]
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Changes the entry of a module, which is created if absent, and writes the file.
    ///
    /// # Errors
    /// The file cannot be written: its former content stays.
    pub fn change(&mut self, module: &str, change: impl FnOnce(&mut Entry)) -> io::Result<()> {
        let place = self.entries.iter().position(|entry| entry.module == module).unwrap_or_else(|| {
            let (module, wanted) = (module.to_string(), State::Run);
            self.entries.push(Entry { module, process: None, starting: false, wanted, held: false });
            self.entries.len() - 1
        });
        let before = self.entries[place].clone();
        change(&mut self.entries[place]);
        if self.entries[place] == before { Ok(()) } else { self.write() }
    }

    fn write(&self) -> io::Result<()> {
        let mut text = format!("{HEAD}\nboot {}\n", self.boot);
        for Entry { module, process, starting, wanted, held } in &self.entries {
            let (pid, start) = process.unwrap_or_default();
            let marks = [("starting", starting), ("held", held)];
            let marks: String = marks.iter().filter(|(_, is)| **is).map(|(mark, _)| format!(" {mark}")).collect();
            text += &format!("{module} {pid} {start} {wanted}{marks}\n");
        }
        // If the process is killed, either the old or the new file is there. No fsync: the record is void after a
        // restart of the machine.
        let new = self.path.with_extension("new");
        let mut file = fs::OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(&new)?;
        file.write_all(text.as_bytes())?;
        fs::rename(new, &self.path)
    }
}

/// Boot identifier and all entries, or the number of the invalid line.
fn parse(text: &str) -> Result<(String, Vec<Entry>), usize> {
    let mut lines = text.lines();
    if lines.next() != Some(HEAD) {
        return Err(1);
    }
    let boot = lines.next().and_then(|line| line.strip_prefix("boot ")).ok_or(2_usize)?;
    let entries = lines.enumerate().map(|(index, line)| parse_entry(line).ok_or(index + 3));
    Ok((boot.into(), entries.collect::<Result<_, _>>()?))
}

fn parse_entry(line: &str) -> Option<Entry> {
    let mut words = line.split(' ');
    let module = words.next().filter(|name| !name.is_empty())?;
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    let (pid, start): (u32, u64) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    let wanted = State::from_name(words.next()?)?;
    let mut entry = Entry {
        module: module.into(),
        process: (pid > 0).then_some((pid, start)),
        starting: false,
        wanted,
        held: false,
    };
    for word in words {
        match word {
            "starting" => entry.starting = true,
            "held" => entry.held = true,
            _ => return None,
        }
    }
    // Neither a kernel thread nor the first process can be a module.
    (module.chars().all(plain) && pid != 1 && pid <= i32::MAX as u32).then_some(entry)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fresh(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("advee-record-{name}-{}", std::process::id()))
    }

    #[test]
    fn a_record_is_read_back_within_the_same_boot() {
        let path = fresh("same");
        let (mut first, told) = Record::read(&path, "b".into());
        told.unwrap();
        first.change("nerves", |entry| entry.process = Some((7, 99))).unwrap();
        first.change("eyes", |entry| (entry.wanted, entry.held) = (State::Terminate, true)).unwrap();
        first.change("ears", |entry| entry.starting = true).unwrap();
        let (next, told) = Record::read(&path, "b".into());
        told.unwrap();
        assert_eq!(next.entries(), first.entries());
        assert_eq!(Record::read(&path, "c".into()).0.entries(), [], "another start of the machine");
        fs::remove_file(path).unwrap();
    }

    #[test]
    fn an_invalid_record_is_reported_and_empty() {
        let path = fresh("bad");
        let told = |text: &str| {
            fs::write(&path, text).unwrap();
            let (record, told) = Record::read(&path, "b".into());
            assert!(told.is_ok() || record.entries().is_empty());
            told.err().unwrap_or_default()
        };
        let head = "advee processes 1\nboot b\n";
        assert_eq!(told(&format!("{head}m 7 9 RUN\n")), "");
        for bad in [
            "m 1 9 RUN",
            "m 7 9 DANCE",
            "m 7 9",
            "m -1 9 RUN",
            "m 7 9 RUN maybe",
            "m/../x 7 9 RUN",
            "",
            "m 4294967295 9 RUN",
        ] {
            let told = told(&format!("{head}n 8 9 RUN\n{bad}\n"));
            assert!(told.contains("line 4 is invalid"), "{bad}: {told}");
        }
        assert!(told("FEAT").contains("line 1") && told("advee processes 1\n").contains("line 2"));
        fs::write(&path, [0xFF; 100]).unwrap();
        assert!(Record::read(&path, "b".into()).1.is_err());
        fs::remove_file(path).unwrap();
    }
}
