//! Who has a device open.

use std::fs;
use std::path::Path;

/// A process that has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Which.
    pub pid: u32,
    /// The module that it is, if it is one of ours.
    pub module: Option<String>,
    /// What it is called.
    name: String,
}

impl Holder {
    /// For people: `driver_rs485a, process 123`.
    pub fn text(&self) -> String {
        format!("{}, process {}", self.module.as_ref().unwrap_or(&self.name), self.pid)
    }
}

/// The process that has the device open, as far as `/proc` lets us see: none for a device that is not there.
pub fn holder(device: &Path) -> Option<Holder> {
    let device = fs::canonicalize(device).ok()?;
    let pids = fs::read_dir("/proc").ok()?.flatten().filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    let mut others = pids.filter(|pid: &u32| *pid != std::process::id());
    let pid = others.find(|pid| has_open(*pid, &device))?;
    let command = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let name = fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    Some(Holder { pid, module: module_of(&command), name: name.trim().escape_debug().to_string() })
}

fn has_open(pid: u32, device: &Path) -> bool {
    let files = fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
    files.filter_map(|file| fs::read_link(file.path()).ok()).any(|target| target == device)
}

/// The `MODULE` of `advee run MODULE …`.
fn module_of(command: &[u8]) -> Option<String> {
    let mut words = command.split(|byte| *byte == 0);
    let program = words.next()?;
    if !program.ends_with(b"advee") || words.next() != Some(b"run") {
        return None;
    }
    let module = std::str::from_utf8(words.next()?).ok()?;
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
    (!module.is_empty() && module.chars().all(plain)).then(|| module.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_module_is_known_by_how_it_was_started() {
        let module = |command: &str| module_of(command.replace(' ', "\0").as_bytes());
        assert_eq!(module("/opt/advee/bin/advee run driver_rs485a --state RUN"), Some("driver_rs485a".into()));
        assert_eq!(module("/usr/bin/minicom run driver_rs485a"), None);
        assert_eq!(module("advee rs485 monitor"), None);
        assert_eq!(module("advee run \u{1b}[2J"), None);
        assert_eq!(module(""), None);
    }

    #[test]
    fn a_file_that_nobody_else_has_is_free() {
        let file = std::env::temp_dir().join(format!("advee-holder-{}", std::process::id()));
        let open = fs::File::create(&file).unwrap();
        assert_eq!(holder(&file), None, "one's own does not count");
        drop(open);
        fs::remove_file(&file).unwrap();
        assert_eq!(holder(&file), None);
    }
}
