//! A control group (cgroup v2) for each module, where the machine permits it: limits that hold for all processes that a
//! module starts, and an end that none of them escapes.
//!
//! Path: `OWN/advee-HASH/MODULE`, where OWN is the group of this process and HASH identifies the run folder. In a group
//! that systemd delegated (`Delegate=yes`) memory and processors can be limited; elsewhere, if the folder is writable,
//! a group can still be killed as a whole. The kernel lets a group either hold processes or distribute resources, so
//! the processes in OWN first move to `OWN/advee-HASH/guard` (cgroups(7), "no internal processes").

use super::sys;
use nix::sys::signal::Signal;
use nix::sys::statfs::{CGROUP2_SUPER_MAGIC, statfs};
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};

/// Group of the supervising processes once their own group distributes resources.
const GUARD: &str = "guard";
/// Period of the processor limit, µs: a module that used up its share waits at most this long.
const PERIOD_US: u64 = 100_000;

/// Groups of one robot.
#[derive(Debug)]
pub struct Cgroups {
    own: PathBuf,
    robot: PathBuf,
}

/// Group of one module.
#[derive(Debug)]
pub struct Leaf {
    path: PathBuf,
}

/// Limits that a group enforces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EnforcedLimits {
    /// Memory.
    pub memory: bool,
    /// Processor time.
    pub cpu: bool,
}

impl Cgroups {
    /// Opens the groups of the robot `name` below the group of this process. With `divide` they can limit memory and
    /// processors as far as the machine permits. `None` if no group can be created.
    #[must_use]
    pub fn open(name: &str, divide: bool) -> Option<Self> {
        let groups = Self::find(name)?;
        fs::create_dir(&groups.robot).or_else(exists).ok()?;
        if divide {
            groups.divide();
        }
        Some(groups)
    }

    /// Removes the groups of the robot `name` that are empty.
    pub fn remove(name: &str) {
        if let Some(groups) = Self::find(name) {
            for entry in fs::read_dir(&groups.robot).into_iter().flatten().flatten() {
                let _ = fs::remove_dir(entry.path());
            }
            let _ = fs::remove_dir(groups.robot);
        }
    }

    fn find(name: &str) -> Option<Self> {
        let mounts = fs::read_to_string("/proc/self/mountinfo").ok()?;
        let own = own_group(&fs::read_to_string("/proc/self/cgroup").ok()?, &mounts, name)?;
        let is_there = statfs(&own).is_ok_and(|system| system.filesystem_type() == CGROUP2_SUPER_MAGIC);
        is_there.then(|| Self::at(own, name))
    }

    fn at(own: PathBuf, name: &str) -> Self {
        let robot = own.join(name);
        Self { own, robot }
    }

    /// Enables the memory and processor controllers for the groups below.
    fn divide(&self) {
        let pass_on = |group: &Path| {
            let has = fs::read_to_string(group.join("cgroup.controllers")).unwrap_or_default();
            let wanted =
                ["memory", "cpu"].into_iter().filter(|name| has.split_whitespace().any(|other| other == *name));
            wanted
                .map(|name| fs::write(group.join("cgroup.subtree_control"), format!("+{name}")))
                .all(|done| done.is_ok())
        };
        if !pass_on(&self.own) {
            let guard = self.robot.join(GUARD);
            let _ = fs::create_dir(&guard);
            for pid in fs::read_to_string(self.own.join("cgroup.procs")).unwrap_or_default().lines() {
                let _ = fs::write(guard.join("cgroup.procs"), pid);
            }
            pass_on(&self.own);
        }
        pass_on(&self.robot);
    }

    /// Creates or opens the group of a module.
    ///
    /// # Errors
    /// The group cannot be created.
    pub fn leaf(&self, module: &str) -> io::Result<Leaf> {
        let path = self.robot.join(module);
        fs::create_dir(&path).or_else(exists)?;
        Ok(Leaf { path })
    }
}

impl Leaf {
    /// Sets the limits, bytes and cores, `None` being unlimited; returns those that are in effect.
    #[must_use]
    pub fn limit(&self, memory_max: Option<u64>, cpu_max: Option<f64>) -> EnforcedLimits {
        let memory = memory_max.map_or("max".into(), |bytes| bytes.to_string());
        let cpu = cpu_max.map_or("max".into(), |cores| format!("{:.0}", cores * PERIOD_US as f64));
        // Existing files only: on another file system, or without the controller, the file is absent.
        let set = |file: &str, value: String| {
            let mut file = OpenOptions::new().write(true).open(self.path.join(file))?;
            io::Write::write_all(&mut file, value.as_bytes())
        };
        EnforcedLimits {
            memory: set("memory.max", memory).is_ok() && memory_max.is_some(),
            cpu: set("cpu.max", format!("{cpu} {PERIOD_US}")).is_ok() && cpu_max.is_some(),
        }
    }

    /// File to which a process writes `0` to join this group.
    #[must_use]
    pub fn join_file(&self) -> Option<File> {
        OpenOptions::new().write(true).open(self.path.join("cgroup.procs")).ok()
    }

    /// Sends a signal to all processes of the group but `leader`.
    pub fn signal_others(&self, leader: u32, signal: Signal) {
        for pid in self.processes().into_iter().filter(|pid| *pid != leader) {
            let Ok(process) = sys::pidfd_open(pid) else { continue };
            // The process id was that of a member before; only if it is one now as well does the descriptor refer to
            // that process.
            if self.processes().contains(&pid) {
                let _ = sys::pidfd_send_signal(process.as_fd(), signal);
            }
        }
    }

    fn processes(&self) -> Vec<u32> {
        let listed = fs::read_to_string(self.path.join("cgroup.procs")).unwrap_or_default();
        listed.lines().filter_map(|line| line.parse().ok()).collect()
    }

    /// Kills all processes of the group (Linux 5.14).
    pub fn kill(&self) {
        if let Ok(mut file) = OpenOptions::new().write(true).open(self.path.join("cgroup.kill")) {
            let _ = io::Write::write_all(&mut file, b"1");
        }
    }
}

fn exists(error: io::Error) -> io::Result<()> {
    if error.kind() == io::ErrorKind::AlreadyExists { Ok(()) } else { Err(error) }
}

/// Finds the folder of our own group from `/proc/self/cgroup` and `/proc/self/mountinfo`. A process that an earlier run
/// moved to the guard's group belongs to the group above.
fn own_group(cgroup: &str, mounts: &str, name: &str) -> Option<PathBuf> {
    let path = cgroup.lines().find_map(|line| line.strip_prefix("0::/"))?;
    // The number of fields before " - " varies; the fourth is the root of the mount, the fifth the mount point
    // (proc(5)).
    let (root, point) = mounts.lines().find_map(|line| {
        let (fields, kind) = line.split_once(" - ")?;
        let mut fields = fields.split(' ').skip(3);
        (kind.split(' ').next() == Some("cgroup2")).then_some((fields.next()?, fields.next()?))
    })?;
    let below = Path::new("/").join(path);
    let below = below.strip_prefix(root).ok()?.to_owned();
    let own = Path::new(point).join(below);
    Some(match own.strip_prefix(point).ok()?.ends_with(Path::new(name).join(GUARD)) {
        true => own.parent()?.parent()?.into(),
        false => own,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOUNTS: &str = "24 1 0:22 / /proc rw,nosuid - proc proc rw\n\
        35 25 0:30 / /sys/fs/cgroup rw,nosuid shared:9 - cgroup2 cgroup2 rw,nsdelegate\n";

    #[test]
    fn our_own_group_is_found() {
        let own = |cgroup: &str| own_group(cgroup, MOUNTS, "advee-1").map(|path| path.display().to_string());
        let service = Some("/sys/fs/cgroup/system.slice/advee.service".to_string());
        assert_eq!(own("0::/system.slice/advee.service\n"), service);
        assert_eq!(own("0::/system.slice/advee.service/advee-1/guard\n"), service, "moved by an earlier life");
        assert_eq!(own("4:memory:/x\n0::/\n"), Some("/sys/fs/cgroup/".into()));
        assert_eq!(own("4:memory:/x\n"), None, "cgroup v1 alone");
        assert_eq!(own_group("0::/", "24 1 0:22 / /proc rw - proc proc rw\n", "n"), None);
        let within = "35 25 0:30 /docker/1 /sys/fs/cgroup rw - cgroup2 cgroup rw\n";
        assert_eq!(own_group("0::/docker/1/a", within, "n"), Some("/sys/fs/cgroup/a".into()));
        assert_eq!(own_group("0::/else", within, "n"), None);
    }

    /// Plain files in place of the kernel's.
    fn played(controllers: &str) -> Cgroups {
        let own = std::env::temp_dir().join(format!("advee-cgroups-{}-{}", std::process::id(), controllers.len()));
        let groups = Cgroups::at(own, "advee-1");
        fs::create_dir_all(groups.robot.join("m")).unwrap();
        for group in [&groups.own, &groups.robot] {
            fs::write(group.join("cgroup.controllers"), controllers).unwrap();
        }
        groups
    }

    #[test]
    fn limits_are_written_where_the_group_supports_them() {
        let groups = played("cpuset cpu io memory pids\n");
        groups.divide();
        for group in [&groups.own, &groups.robot] {
            assert_eq!(fs::read_to_string(group.join("cgroup.subtree_control")).unwrap(), "+cpu");
        }
        let leaf = groups.leaf("m").unwrap();
        let file = |name: &str| groups.robot.join("m").join(name);
        for name in ["memory.max", "cpu.max", "cgroup.kill"] {
            fs::write(file(name), "").unwrap();
        }
        assert_eq!(leaf.limit(Some(1 << 20), Some(0.25)), EnforcedLimits { memory: true, cpu: true });
        let said = ["memory.max", "cpu.max"].map(|name| fs::read_to_string(file(name)).unwrap());
        assert_eq!(said, ["1048576", "25000 100000"]);
        assert_eq!(leaf.limit(None, None), EnforcedLimits::default());
        leaf.kill();
        assert_eq!(fs::read_to_string(file("cgroup.kill")).unwrap(), "1");
        fs::remove_dir_all(&groups.own).unwrap();
    }

    #[test]
    fn a_group_without_controllers_limits_nothing() {
        let groups = played("");
        groups.divide();
        assert!(!groups.own.join("cgroup.subtree_control").exists());
        assert_eq!(groups.leaf("m").unwrap().limit(Some(1), Some(1.0)), EnforcedLimits::default());
        fs::remove_dir_all(&groups.own).unwrap();
    }
}
