//! Resource limits of a module's process: scheduling, processors, memory. The new process applies them to itself before
//! exec.

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

/// Limits prepared for application between fork and exec, where nothing may be allocated.
pub struct PreparedLimits {
    nice: i8,
    cpus: Option<CpuSet>,
    fifo: Option<u8>,
    data: Option<rlim_t>,
    /// Capabilities that the process keeps.
    capabilities: &'static [u8],
    leaf: Option<File>,
    refused: OwnedFd,
}

/// Limits that the machine may refuse; the number is the code in the pipe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Limit {
    Group = 1,
    Nice,
    Cpus,
    Memory,
    Fifo,
    Capabilities,
    /// No limit: the process id.
    Number,
}

/// Length of a record in the pipe: code, number, and a zero.
const RECORD_LEN: usize = 6;

impl Limits {
    /// Prepares the limits of a process and the reader of refusals. `leaf` is the module's cgroup, `capabilities` are
    /// the numbers of those of its parent that it keeps.
    ///
    /// # Errors
    /// No descriptor is left.
    #[allow(clippy::useless_conversion, reason = "machines of 32 bits have narrower ones")]
    pub fn prepare(&self, leaf: Option<&Leaf>, capabilities: &'static [u8]) -> io::Result<(PreparedLimits, Refused)> {
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
            unprepared.push("cpu_max: no cgroup with a cpu controller; not limited".into());
        }
        let birth = PreparedLimits {
            nice: self.nice,
            cpus: (!self.cpus.is_empty()).then_some(cpus),
            fifo: self.rt_priority,
            data: self.memory_max.filter(|_| !held.memory).map(|bytes| bytes.try_into().unwrap_or(RLIM_INFINITY)),
            capabilities,
            leaf: leaf.and_then(Leaf::join_file),
            refused,
        };
        Ok((birth, Refused { pipe: File::from(read), unprepared }))
    }
}

impl PreparedLimits {
    /// Applies the limits in the new process. System calls only: nothing may be allocated here.
    pub(super) fn apply(&self) {
        if let Some(leaf) = &self.leaf {
            self.report(Limit::Group, write(leaf, b"0").map(|_| ()).map_err(Into::into));
        }
        if self.nice != 0 {
            self.report(Limit::Nice, sys::set_nice(self.nice));
        }
        if let Some(cpus) = &self.cpus {
            self.report(Limit::Cpus, sched_setaffinity(Pid::from_raw(0), cpus).map_err(Into::into));
        }
        if let Some(bytes) = self.data {
            self.report(Limit::Memory, setrlimit(Resource::RLIMIT_DATA, bytes, bytes).map_err(Into::into));
        }
        if let Some(priority) = self.fifo {
            self.report(Limit::Fifo, sys::set_fifo(priority, false));
        }
        // Last: the capabilities may be needed for the limits.
        self.report(Limit::Capabilities, sys::keep_capabilities(self.capabilities));
    }

    /// Reports the id of the process that will run the module. System calls only, here too.
    pub(super) fn report_pid(&self) {
        let [a, b, c, d] = std::process::id().to_le_bytes();
        let _ = write(&self.refused, &[Limit::Number as u8, a, b, c, d, 0]);
    }

    fn report(&self, limit: Limit, result: io::Result<()>) {
        if let Err(error) = result {
            let [a, b, c, d] = error.raw_os_error().unwrap_or(0).to_le_bytes();
            let _ = write(&self.refused, &[limit as u8, a, b, c, d, 0]);
        }
    }
}

/// Reader of the limits that the machine refused.
pub struct Refused {
    pipe: File,
    unprepared: Vec<String>,
}

impl Refused {
    /// To be called once the process has started: returns a line for each refused limit, and the process id if it was
    /// reported.
    pub fn read(self) -> (Vec<String>, Option<u32>) {
        let (mut lines, mut pid) = (self.unprepared, None);
        let mut report = [0; 8 * RECORD_LEN];
        let length = (&self.pipe).read(&mut report).unwrap_or(0);
        for report in report[..length].chunks_exact(RECORD_LEN) {
            let number = i32::from_le_bytes([report[1], report[2], report[3], report[4]]);
            let error = io::Error::from_raw_os_error(number);
            lines.push(match report[0] {
                limit if limit == Limit::Group as u8 => format!("cgroup: {error}; the process group is used instead"),
                limit if limit == Limit::Nice as u8 => format!("nice: {error}; not set"),
                limit if limit == Limit::Cpus as u8 => format!("cpus: {error}; all may be used"),
                limit if limit == Limit::Memory as u8 => format!("memory_max: {error}; not limited"),
                limit if limit == Limit::Capabilities as u8 => format!("capabilities: {error}; it keeps them all"),
                limit if limit == Limit::Fifo as u8 => format!("rt_priority: {error}; not set"),
                _ => {
                    pid = Some(number.unsigned_abs());
                    continue;
                }
            });
        }
        (lines, pid)
    }
}

fn on_fault() -> MlockAllFlags {
    MlockAllFlags::from_bits_retain(nix::libc::MCL_ONFAULT)
}

/// Locks the memory of a real-time process, because fetching a page would delay a cycle. Does nothing for other
/// processes.
///
/// # Errors
/// The reason in one line.
pub fn lock_memory() -> Result<(), String> {
    if !sys::is_fifo() {
        return Ok(());
    }
    let _ = setrlimit(Resource::RLIMIT_MEMLOCK, RLIM_INFINITY, RLIM_INFINITY);
    // With a limit, later allocations would fail at run time.
    match getrlimit(Resource::RLIMIT_MEMLOCK) {
        // What is mapped now is fetched now. What is mapped later, a ring of the bus of 4 MiB for each process that
        // joins, is locked page by page as it is touched: fetched as a whole, inside the loop, it would take a
        // millisecond and memory that nobody uses. A kernel before 4.4 has no such flag.
        Ok((RLIM_INFINITY, _)) => mlockall(MlockAllFlags::MCL_CURRENT)
            .and_then(|()| mlockall(MlockAllFlags::MCL_FUTURE | on_fault()))
            .or_else(|_| mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE))
            .map_err(|errno| format!("mlockall: {}; its memory may be paged out", errno.desc())),
        _ => Err("RLIMIT_MEMLOCK is limited; its memory may be paged out".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::process::CommandExt;
    use std::process::{Command, Stdio};

    /// Output of `script` in a shell with these limits, and the refused limits.
    fn run(limits: &Limits, script: &str) -> (String, Vec<String>) {
        let (birth, refused) = limits.prepare(None, &[]).unwrap();
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
    fn a_process_keeps_the_capabilities_that_it_is_given_and_no_others() {
        // In a thread of its own, whose capabilities end with it.
        let kept = |kept: &'static [u8]| {
            std::thread::spawn(move || {
                sys::add_capability(sys::CAP_NET_ADMIN)?;
                let (birth, _refused) = Limits::default().prepare(None, kept)?;
                let mut command = Command::new("grep");
                command.args(["CapAmb", "/proc/self/status"]).stdout(Stdio::piped());
                sys::give_limits(&mut command, birth, None);
                Ok::<String, io::Error>(String::from_utf8_lossy(&command.output()?.stdout).trim().into())
            })
            .join()
            .unwrap()
        };
        let Some(none) = testing::machine_or_skip(kept(&[]).map_err(|error| format!("capabilities: {error}"))) else {
            return;
        };
        assert_eq!(none, "CapAmb:\t0000000000000000");
        assert_eq!(kept(&[sys::CAP_NET_ADMIN]).unwrap(), "CapAmb:\t0000000000001000");
    }

    #[test]
    fn real_time_priority_is_set_or_its_refusal_reported() {
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
    fn unsupported_limits_are_reported_and_the_process_starts() {
        let limits = Limits { cpus: vec![1023], cpu_max: Some(0.5), ..Limits::default() };
        let (said, refused) = run(&limits, "echo here");
        assert_eq!(said, "here\n");
        assert!(refused[0].starts_with("cpu_max: no cgroup") && refused[1].starts_with("cpus: "), "{refused:?}");
    }
}
