//! What a module's process may use: scheduling, processors, memory. Taken on by the new process itself, before it runs
//! anything else.

use super::cgroups::Leaf;
use super::sys;
use nix::fcntl::OFlag;
use nix::sched::{CpuSet, sched_setaffinity};
use nix::sys::mman::{MlockAllFlags, mlockall};
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit, rlim_t, setrlimit};
use nix::unistd::{Pid, pipe2, write};
use settings::{Bytes, Off, Section, settings};
use std::fs::File;
use std::io::{self, Read};
use std::os::fd::OwnedFd;

settings! {
    /// Limits of one module, keys of `[[modules]]`; what this machine does not permit is reported, and the module runs
    /// without.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Limits {
        /// `SCHED_FIFO` priority, its memory locked; 0: the normal scheduler. The watchdog runs one above the highest.
        rt_priority: Option<u8> = None, Off(0..=98);
        /// Processors it may use; empty: all.
        cpus: Vec<u16> = [], 0..=1023;
        /// Priority in the normal scheduler; the lowest number is served most.
        nice: i8 = 0, -20..=19;
        /// Memory: limit of the cgroup where there is one, else of its data (RLIMIT_DATA); 0: no limit.
        memory_max: Option<u64> = None, Off(Bytes(0.0..=1e15));
        /// Share of processor time, held by a cgroup alone; 0: no limit.
        cpu_max: Option<f64> = None, Off(0.0..=64.0);
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self::usual()
    }
}

/// What a new process takes on between fork and exec; all is prepared before.
pub struct Birth {
    nice: i8,
    cpus: Option<CpuSet>,
    fifo: Option<u8>,
    data: Option<rlim_t>,
    leaf: Option<File>,
    refused: OwnedFd,
}

/// What the machine may refuse; the number is what goes through the pipe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Limit {
    Group = 1,
    Nice,
    Cpus,
    Memory,
    Fifo,
    /// None of them: the number of the process.
    Number,
}

/// Of what goes through the pipe: what, a number, and a zero.
const TOLD: usize = 6;

impl Limits {
    /// Prepares a birth: what is to be taken on, and where to read later what was refused. `leaf` is the module's
    /// cgroup.
    ///
    /// # Errors
    /// There is no descriptor left.
    #[allow(clippy::useless_conversion, reason = "machines of 32 bits have narrower ones")]
    pub fn prepare(&self, leaf: Option<&Leaf>) -> io::Result<(Birth, Refused)> {
        let (read, refused) = pipe2(OFlag::O_CLOEXEC | OFlag::O_NONBLOCK)?;
        let mut unprepared = Vec::new();
        let mut cpus = CpuSet::new();
        for cpu in &self.cpus {
            if cpus.set(usize::from(*cpu)).is_err() {
                unprepared.push(format!("cpus: there is no processor {cpu}"));
            }
        }
        let held = leaf.map(|leaf| leaf.limit(self.memory_max, self.cpu_max)).unwrap_or_default();
        if self.cpu_max.is_some() && !held.cpu {
            unprepared.push("cpu_max: no cgroup that could hold it; it may use more".into());
        }
        let birth = Birth {
            nice: self.nice,
            cpus: (!self.cpus.is_empty()).then_some(cpus),
            fifo: self.rt_priority,
            data: self.memory_max.filter(|_| !held.memory).map(|bytes| bytes.try_into().unwrap_or(RLIM_INFINITY)),
            leaf: leaf.and_then(Leaf::entrance),
            refused,
        };
        Ok((birth, Refused { pipe: File::from(read), unprepared }))
    }
}

impl Birth {
    /// To be called in the new process. Only system calls: nothing may allocate here.
    pub(super) fn take_on(&self) {
        if let Some(leaf) = &self.leaf {
            self.told(Limit::Group, write(leaf, b"0").map(|_| ()).map_err(Into::into));
        }
        if self.nice != 0 {
            self.told(Limit::Nice, sys::set_nice(self.nice));
        }
        if let Some(cpus) = &self.cpus {
            self.told(Limit::Cpus, sched_setaffinity(Pid::from_raw(0), cpus).map_err(Into::into));
        }
        if let Some(bytes) = self.data {
            self.told(Limit::Memory, setrlimit(Resource::RLIMIT_DATA, bytes, bytes).map_err(Into::into));
        }
        if let Some(priority) = self.fifo {
            self.told(Limit::Fifo, sys::set_fifo(priority, false));
        }
    }

    /// Tells the number of the process that will run. Only system calls, here too.
    pub(super) fn is_born(&self) {
        let [a, b, c, d] = std::process::id().to_le_bytes();
        let _ = write(&self.refused, &[Limit::Number as u8, a, b, c, d, 0]);
    }

    fn told(&self, limit: Limit, result: io::Result<()>) {
        if let Err(error) = result {
            let [a, b, c, d] = error.raw_os_error().unwrap_or(0).to_le_bytes();
            let _ = write(&self.refused, &[limit as u8, a, b, c, d, 0]);
        }
    }
}

/// Where a process says which of its limits the machine refused.
pub struct Refused {
    pipe: File,
    unprepared: Vec<String>,
}

impl Refused {
    /// Once it has started: a line for each limit, and the number of the process where it was told.
    pub fn read(self) -> (Vec<String>, Option<u32>) {
        let (mut lines, mut pid) = (self.unprepared, None);
        let mut told = [0; 8 * TOLD];
        let length = (&self.pipe).read(&mut told).unwrap_or(0);
        for told in told[..length].chunks_exact(TOLD) {
            let number = i32::from_le_bytes([told[1], told[2], told[3], told[4]]);
            let error = io::Error::from_raw_os_error(number);
            lines.push(match told[0] {
                limit if limit == Limit::Group as u8 => format!("cgroup: {error}; it is guarded by its process group"),
                limit if limit == Limit::Nice as u8 => format!("nice: {error}; it runs at the usual one"),
                limit if limit == Limit::Cpus as u8 => format!("cpus: {error}; it may use all"),
                limit if limit == Limit::Memory as u8 => format!("memory_max: {error}; it may use more"),
                limit if limit == Limit::Fifo as u8 => format!("rt_priority: {error}; it runs without"),
                _ => {
                    pid = Some(number.unsigned_abs());
                    continue;
                }
            });
        }
        (lines, pid)
    }
}

/// Keeps the memory of a real-time process where it is: a page that must be fetched is a late cycle. Does nothing for
/// others.
///
/// # Errors
/// One line why it cannot be.
pub fn lock_memory() -> Result<(), String> {
    if !sys::is_fifo() {
        return Ok(());
    }
    let _ = setrlimit(Resource::RLIMIT_MEMLOCK, RLIM_INFINITY, RLIM_INFINITY);
    // A limit would refuse further memory later, when that hurts.
    match getrlimit(Resource::RLIMIT_MEMLOCK) {
        Ok((RLIM_INFINITY, _)) => mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE)
            .map_err(|errno| format!("mlockall: {}: its memory may be paged out", errno.desc())),
        _ => Err("RLIMIT_MEMLOCK is limited: its memory may be paged out".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::process::CommandExt;
    use std::process::{Command, Stdio};

    /// What a shell with these limits says to `script`, and what was refused.
    fn run(limits: &Limits, script: &str) -> (String, Vec<String>) {
        let (birth, refused) = limits.prepare(None).unwrap();
        let mut command = Command::new("/bin/sh");
        command.args(["-c", script]).stdout(Stdio::piped()).process_group(0);
        sys::give_limits(&mut command, birth, None);
        let child = command.spawn().unwrap();
        let (refused, pid) = refused.read();
        assert_eq!(pid, None);
        let output = child.wait_with_output().unwrap();
        (String::from_utf8(output.stdout).unwrap(), refused)
    }

    #[test]
    fn a_process_starts_with_its_limits() {
        let limits =
            Limits { cpus: vec![0], nice: 5, memory_max: Some(64 << 20), rt_priority: None, ..Limits::default() };
        let (said, refused) =
            run(&limits, "cut -d' ' -f19 /proc/self/stat; ulimit -d; grep Cpus_allowed_list /proc/self/status");
        assert_eq!(refused, [""; 0]);
        assert_eq!(said, "5\n65536\nCpus_allowed_list:\t0\n");
    }

    #[test]
    fn real_time_is_taken_on_or_said_to_be_refused() {
        let limits = Limits { rt_priority: Some(7), ..Limits::default() };
        // Fields 40 and 41 of stat: priority and policy.
        let (said, refused) = run(&limits, "cut -d' ' -f40,41 /proc/self/stat");
        match refused.as_slice() {
            [] => assert_eq!(said, "7 1\n"),
            [why] => assert!(why.starts_with("rt_priority: ") && said == "0 0\n", "{why}, {said}"),
            more => panic!("{more:?}"),
        }
    }

    #[test]
    fn what_cannot_be_held_is_said_and_the_process_starts() {
        let limits = Limits { cpus: vec![1023], cpu_max: Some(0.5), ..Limits::default() };
        let (said, refused) = run(&limits, "echo here");
        assert_eq!(said, "here\n");
        assert!(refused[0].starts_with("cpu_max: no cgroup") && refused[1].starts_with("cpus: "), "{refused:?}");
    }
}
