//! Identity of processes: a process id is reused; together with the start times of process and machine it is unique.

use crate::beats::fnv;
use std::fs::{self, File};
use std::io::Read;
use std::path::Path;
use std::process::Command;

/// Environment variable that marks a process started by a watchdog: `RECORD:MODULE:HASH`, with the hash of its command
/// line.
pub const VARIABLE: &str = "ADVEE_GUARDED";
/// Maximum length of an environment that is searched, bytes.
const ENVIRONMENT_MAX: u64 = 1 << 20;

/// Fields of `/proc/PID/stat` (proc_pid_stat(5)).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stat {
    /// The process has ended and was not reaped yet.
    pub zombie: bool,
    /// Parent.
    pub parent: u32,
    /// Process group.
    pub group: u32,
    /// Processor time, ticks.
    pub ticks: u64,
    /// Start time, ticks since the machine's start.
    pub start: u64,
    /// Resident memory, pages.
    pub pages: u64,
    /// Exit status as in wait(2); 0 if this process may not know it.
    pub status: i32,
}

impl Stat {
    /// Reads the state of a process; `None` if it does not exist.
    #[must_use]
    pub fn of(pid: u32) -> Option<Self> {
        let mut text = [0; 1024];
        let length = File::open(format!("/proc/{pid}/stat")).ok()?.read(&mut text).ok()?;
        Self::parse(&String::from_utf8_lossy(&text[..length]))
    }

    fn parse(text: &str) -> Option<Self> {
        // The name, in parentheses, may contain anything. The next field is number 3.
        let mut fields = text.rsplit_once(')')?.1.split_whitespace();
        let state = fields.next()?;
        let mut skip = |count| fields.nth(count).and_then(|field| field.parse::<i64>().ok());
        let (parent, group) = (skip(0)?, skip(0)?);
        let (user, system) = (skip(8)?, skip(0)?);
        let start = skip(6)?;
        let pages = skip(1)?;
        let status = skip(27).unwrap_or(0);
        Some(Self {
            zombie: matches!(state, "Z" | "X"),
            parent: u32::try_from(parent).ok()?,
            group: u32::try_from(group).ok()?,
            ticks: (user + system).unsigned_abs(),
            start: start.unsigned_abs(),
            pages: pages.unsigned_abs(),
            status: status as i32,
        })
    }
}

/// Identifier of the current start of the machine.
#[must_use]
pub fn boot() -> String {
    fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default().trim().into()
}

/// Value of [`VARIABLE`] for a module of the record `record` that `command` starts; independent of its first state.
#[must_use]
pub fn mark(record: &Path, module: &str, command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args()).filter(|word| !is_state(word));
    let line = words.flat_map(|word| [word.as_encoded_bytes(), &[0]]).collect::<Vec<_>>().concat();
    format!("{}{:016x}", owner(record, module), fnv(&line))
}

fn is_state(word: &std::ffi::OsStr) -> bool {
    word.to_str().and_then(module::State::from_name).is_some()
}

/// Prefix of the marks of a module of the record `record`.
#[must_use]
pub fn owner(record: &Path, module: &str) -> String {
    format!("{}:{module}:", record.display())
}

/// Mark of a process: its own, or inherited from the process that started it.
#[must_use]
pub fn mark_of(pid: u32) -> Option<String> {
    let mut environment = Vec::new();
    File::open(format!("/proc/{pid}/environ")).ok()?.take(ENVIRONMENT_MAX).read_to_end(&mut environment).ok()?;
    let entries = environment.split(|byte| *byte == 0);
    let mut values = entries.filter_map(|entry| entry.strip_prefix(VARIABLE.as_bytes())?.strip_prefix(b"="));
    values.next().and_then(|value| String::from_utf8(value.to_vec()).ok())
}

/// Finds the leader of a process group whose mark has this prefix: a module whose watchdog died before it could record
/// the process id.
#[must_use]
pub fn find(owner: &str) -> Option<(u32, u64)> {
    let pids = fs::read_dir("/proc").ok()?.flatten().filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    pids.filter(|pid| mark_of(*pid).is_some_and(|mark| mark.starts_with(owner))).find_map(|pid: u32| {
        let stat = Stat::of(pid).filter(|stat| !stat.zombie && stat.group == pid)?;
        Some((pid, stat.start))
    })
}

/// Children of `parent`, including those that have ended.
#[must_use]
pub fn children(parent: u32) -> Vec<u32> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    pids.filter(|pid| Stat::of(*pid).is_some_and(|stat| stat.parent == parent)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stat_line_is_read_whatever_the_name_holds() {
        let line = "12 (a) (b) S 1 12 12 0 -1 4194560 1 0 0 0 30 12 0 0 20 0 1 0 987 8192 55 1 1 1 1 1 1 0 0 0 0 0 0 17 1 0 0 0 0 0 \
                    1 1 1 1 1 1 1 1 256\n";
        let stat = Stat { zombie: false, parent: 1, group: 12, ticks: 42, start: 987, pages: 55, status: 256 };
        assert_eq!(Stat::parse(line), Some(stat));
        assert_eq!(Stat::parse("12 (a) Z 1"), None);
        assert_eq!(Stat::parse(""), None);
    }

    #[test]
    fn a_mark_depends_on_the_command_but_not_on_the_first_state() {
        let mark = |args: &[&str]| super::mark(Path::new("/run/processes"), "m", Command::new("advee").args(args));
        let usual = mark(&["run", "m", "--state", "RUN", "--sim"]);
        assert!(usual.starts_with("/run/processes:m:") && usual.len() == 33, "{usual}");
        assert_eq!(mark(&["run", "m", "--state", "STOP", "--sim"]), usual);
        assert_ne!(mark(&["run", "m", "--state", "RUN"]), usual);
    }

    #[test]
    fn a_process_of_ours_has_a_start_and_no_mark() {
        let me = Stat::of(std::process::id()).unwrap();
        assert!(!me.zombie && me.start > 0 && me.pages > 0);
        assert_eq!((mark_of(std::process::id()), mark_of(u32::MAX)), (None, None));
        assert_eq!(Stat::of(u32::MAX), None);
    }
}
